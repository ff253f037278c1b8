"""The map of a simulator of another make: which of its variables are the state, the controls and the wind, in which
units and conventions, and what ship it is of.

It is a TOML file beside the simulator, ``ship.toml`` beside ``ship.fmu`` or ``ship.py``. A Python class states ship
and actuators itself, and its map only says in which units and conventions it counts.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf, pi
from pathlib import Path
from typing import Any, Literal, NoReturn

from pydantic import FiniteFloat, PositiveFloat, PositiveInt

from seatrial.acquisition.core import quantities, ship
from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.acquisition.core.files import line_of_toml_key, load_toml, read_text
from seatrial.acquisition.core.ship import Actuators
from seatrial.hybrid.vessel.actuators import control_units
from seatrial.hybrid.vessel.signals import STATES, AffineSignals, Frame, Signals, WindSignals

GEODETIC = {"latitude": "deg", "longitude": "deg"}
"""What may stand for north and east."""
WINDS = {"direction": {"direction": "deg", "speed": "m/s"}, "components": {"north": "m/s", "east": "m/s"}}
"""The two forms of the wind: where it comes from and how fast, or the velocity of the air."""
_IN_SI = {"deg": pi / 180.0, "deg/s": pi / 180.0}
_SIDES = {
    "north": ("north", "south"), "east": ("east", "west"), "heading": ("starboard", "port"),
    "surge": ("ahead", "astern"), "sway": ("starboard", "port"), "yaw_rate": ("starboard", "port"),
    "direction": ("starboard", "port"), "rpm": ("ahead", "astern"), "percent": ("ahead", "astern"),
    "deg": ("starboard", "port"), "tunnel": ("starboard", "port"),
}  # fmt: skip
"""The words for the positive side of a quantity: ours first."""
_HALF_TURN = pi

StartMode = Literal["set", "reset", "run_in"]
"""How runs begin: states are set before any step; only when a run starts; or the ship is run in."""


@dataclass(frozen=True, slots=True)
class SignalEntry:
    """One signal: the ``variable`` of an FMU and its unit, ``300 rpm`` where 1 is that much.

    ``positive`` is the side on which it is positive, where that is not ours; ``zero`` where a heading or a
    direction is zero. A wind direction goes by ``convention`` and ``frame``. ``start`` is the variable that a run
    starts or is set with, where that is not ``variable`` itself, in ``start_unit`` where its unit is another.
    """

    unit: str
    variable: str = ""
    positive: str = ""
    zero: Literal["north", "east"] = "north"
    convention: Literal["from", "to"] = "from"
    frame: Frame = "true"
    start: str = ""
    start_unit: str = ""


SignalEntry.__pydantic_config__ = {"extra": "forbid"}  # type: ignore[attr-defined]


@dataclass(frozen=True, slots=True)
class MappedActuator:
    """An actuator: name and kind, as in vessel files.

    The rest is what a simulated trial needs to handle the ship, named as in vessel files too: where it is, limits
    of its orders, lags and limits of rates. Without ``x_m`` it is astern.
    """

    name: str
    kind: str
    x_m: FiniteFloat = -1.0
    y_m: FiniteFloat = 0.0
    limit_rpm: PositiveFloat = inf
    limit_deg: PositiveFloat = inf
    rate_limit_dps: PositiveFloat = inf
    azimuth_rate_limit_dps: PositiveFloat = inf
    lag_s: FiniteFloat = 0.0
    shaft_lag_s: FiniteFloat = 0.0
    azimuth_lag_s: FiniteFloat = 0.0
    nozzle_lag_s: FiniteFloat = 0.0
    pitch_lag_s: FiniteFloat = 0.0


MappedActuator.__pydantic_config__ = {"extra": "forbid"}  # type: ignore[attr-defined]


@dataclass(frozen=True, slots=True)
class ShipEntry:
    """The ship: its length between perpendiculars [m], and what else is known of it."""

    name: str
    length_m: PositiveFloat
    length_overall_m: PositiveFloat | None = None
    draught_m: PositiveFloat | None = None


ShipEntry.__pydantic_config__ = {"extra": "forbid"}  # type: ignore[attr-defined]


@dataclass(frozen=True, slots=True)
class SolverEntry:
    """How the simulator is run: its own time step, how runs begin, for how long one is run in, how long a step may
    take, and how many instances one process holds. ``own_step`` is the parameter of an FMU that is the longest step
    of its integration; ``fixed_step_s`` the one step that it takes, of which every other is a multiple."""

    step_s: PositiveFloat | None = None
    start: StartMode = "reset"
    run_in_s: PositiveFloat = 120.0
    patience_s: PositiveFloat = 30.0
    instances: PositiveInt = 16
    own_step: str = ""
    fixed_step_s: PositiveFloat | None = None


SolverEntry.__pydantic_config__ = {"extra": "forbid"}  # type: ignore[attr-defined]


@dataclass(frozen=True, slots=True)
class OriginEntry:
    """The place from which latitude and longitude become north and east."""

    latitude_deg: FiniteFloat
    longitude_deg: FiniteFloat


@dataclass(frozen=True, slots=True)
class AccelerationEntry:
    """The inputs of an FMU for what it lacks per mass: ahead, to starboard [m/s2], in yaw [rad/s2]."""

    surge: str
    sway: str
    yaw: str


AccelerationEntry.__pydantic_config__ = {"extra": "forbid"}  # type: ignore[attr-defined]


@dataclass(frozen=True, slots=True)
class SimulatorMap:
    """The file as it is written; ``control`` by the names of the control channels."""

    ship: ShipEntry
    actuator: tuple[MappedActuator, ...] = ()
    state: dict[str, SignalEntry] = field(default_factory=dict)
    control: dict[str, SignalEntry] = field(default_factory=dict)
    wind: dict[str, SignalEntry] = field(default_factory=dict)
    solver: SolverEntry = field(default_factory=SolverEntry)
    origin: OriginEntry | None = None
    acceleration: AccelerationEntry | None = None
    parameters: dict[str, bool | FiniteFloat] = field(default_factory=dict)

    @property
    def actuators(self) -> Actuators:
        """Names and kinds of the actuators."""
        return ship.check_actuators(ship.Actuator(entry.name, entry.kind) for entry in self.actuator)


SimulatorMap.__pydantic_config__ = {"extra": "forbid"}  # type: ignore[attr-defined]


def read_map(path: Path) -> SimulatorMap:
    """The map of a file. Raises :class:`ConfigurationError` naming file, line and key."""
    return load_toml(path, SimulatorMap)


def map_error(path: Path, keys: list[str | int], what: str, fix: str, why: str = "") -> NoReturn:
    """Raise a :class:`ConfigurationError` for a key of a map, with its line where it is written."""
    text = read_text(path) if path.is_file() else ""
    where = f"{path}, line {line_of_toml_key(text, keys)}" if text else str(path)
    raise ConfigurationError(f"{'.'.join(map(str, keys))} {what}", where=where, why=why, fix=fix)


def signals_of_map(mapped: SimulatorMap, actuators: Actuators, path: Path, *, complete: bool) -> Signals:
    """How a simulator's signals translate to ours.

    With ``complete`` every signal has to be mapped, as for an FMU; without, what is not mapped is in our units, as
    of a class. Raises :class:`ConfigurationError` for a signal that is missing, unknown, or of a unit or side that
    does not fit.
    """
    geodetic = mapped.state.keys() & GEODETIC.keys()
    names = [*GEODETIC, *list(STATES)[2:]] if geodetic else list(STATES)
    units = {**STATES, **GEODETIC}
    _refuse_names(mapped.state, names, "state", path, complete=complete)
    if geodetic and mapped.origin is None:
        map_error(path, ["state", "latitude"], "needs an origin",
                  "write [origin] with latitude_deg and longitude_deg, that of the recordings")  # fmt: skip
    in_si = _IN_SI | {"geodetic": 1.0}  # pymap3d takes degrees
    state = [
        _scale_and_offset(
            mapped.state.get(name),
            units[name],
            in_si.get("geodetic" if name in GEODETIC else units[name], 1.0),
            name,
            ["state", name],
            path,
        )
        for name in names
    ]
    channels = ship.control_channels(actuators)
    _refuse_names(mapped.control, [channel.name for channel in channels], "control", path, complete=complete)
    tunnels = {f"{name}_rpm" for name in ship.names_of_kind(actuators, "tunnel")}
    control = [
        _scale_and_offset(mapped.control.get(channel.name), channel.unit, unit,
                "tunnel" if channel.name in tunnels else channel.name.rsplit("_", 1)[-1],
                ["control", channel.name], path)
        for channel, unit in zip(channels, control_units(actuators), strict=True)
    ]  # fmt: skip
    origin = mapped.origin
    return Signals(
        _affine_signals(state), _affine_signals(control), _wind_signals(mapped.wind, path, complete=complete),
        (origin.latitude_deg, origin.longitude_deg) if geodetic and origin else None,
    )  # fmt: skip


def wind_form(wind: Mapping[str, Any]) -> Literal["direction", "components", "none"]:
    """The form of a mapped wind by the names of its signals."""
    return "none" if not wind else "components" if "north" in wind or "east" in wind else "direction"


def _wind_signals(wind: Mapping[str, SignalEntry], path: Path, *, complete: bool) -> WindSignals:
    if not wind:
        return WindSignals("none") if complete else WindSignals()
    form = wind_form(wind)
    names = WINDS["components" if form == "components" else "direction"]
    _refuse_names(wind, list(names), "wind", path, complete=True)
    columns = [
        _scale_and_offset(wind[name], unit, _IN_SI.get(unit, 1.0), name, ["wind", name], path)
        for name, unit in names.items()
    ]
    frame = wind["direction"].frame if form == "direction" else "true"
    return WindSignals(form, frame, _affine_signals(columns))


def _refuse_names(entries: Mapping[str, Any], names: list[str], table: str, path: Path, *, complete: bool) -> None:
    for name in entries:
        if name not in names:
            map_error(path, [table, name], "is not a signal of it", f"write {', '.join(names)}")
    missing = [name for name in names if name not in entries]
    if complete and missing:
        map_error(path, [table], f"lacks {', '.join(missing)}",
                  f'write {missing[0]} = {{ variable = "...", unit = "..." }} there')  # fmt: skip


def _scale_and_offset(
    entry: SignalEntry | None, unit: str, in_si: float, quantity: str, keys: list[str | int], path: Path
) -> tuple[float, float]:
    """Scale and offset from a signal to ours in SI."""
    if entry is None:
        return 1.0, 0.0
    size, name = split_unit(entry.unit)
    try:
        scale = quantities.unit_scale(unit, name) * (size or 1.0) * in_si
    except ConfigurationError as error:
        map_error(path, [*keys, "unit"], f"is {entry.unit!r}, which does not measure it", error.fix)
    ours, opposite = _SIDES.get(quantity, ("", ""))
    if entry.positive not in ("", ours, opposite):
        map_error(path, [*keys, "positive"], f"is {entry.positive!r}", f"write {ours} or {opposite}")
    sign = -1.0 if entry.positive and entry.positive == opposite else 1.0
    offset = 0.0
    if quantity in ("heading", "direction"):
        offset = 0.5 * pi if entry.zero == "east" else 0.0
        offset += _HALF_TURN if quantity == "direction" and entry.convention == "to" else 0.0
        if entry.frame != "true" and entry.zero == "east":
            map_error(path, [*keys, "zero"], "is east of a direction from the bow", "leave it out")
    elif entry.zero != "north":
        map_error(path, [*keys, "zero"], "is not for this signal", "leave it out: headings and directions have one")
    return sign * scale, offset


def split_unit(unit: str) -> tuple[float | None, str]:
    """The number before a unit, None where it has none, and the unit.

    >>> split_unit("300 rpm"), split_unit("deg/s")
    ((300.0, 'rpm'), (None, 'deg/s'))
    """
    number = re.fullmatch(r"(\d+(?:\.\d+)?) *([^\d\s].*)", unit)
    return (float(number[1]), number[2]) if number else (None, unit)


def _affine_signals(scales_and_offsets: list[tuple[float, float]]) -> AffineSignals:
    scale, offset = zip(*scales_and_offsets, strict=True) if scales_and_offsets else ((), ())
    return AffineSignals(tuple(map(float, scale)), tuple(map(float, offset)))
