"""Vessel files: read, checked, resolved from their base, and written back; the objects that they are read into.

A file states a whole vessel: dimensions, a hull model, a wind model, an ``[[actuator]]`` for each actuator. Or it
says ``base = "NAME or FILE"`` and what differs: single numbers, those of an actuator in an ``[[actuator]]`` of its
name, more actuators, and effects added to the model as ``[effects.NAME]`` tables. Names are those of the files in
``trials/vessels``. The reference model of recordings is of the ship that they name, unless another is asked for.

A vessel's numbers are frozen objects, in SI units and radians unless a name says otherwise. The equations that use
them are in ``hulls``, ``actuators``, ``wind.py`` and ``dynamics.py``. Dimensions and the wind's resistance are what
a file tells the analysis of speed and power.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field, is_dataclass, replace
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Union

import numpy as np
import pandas as pd
from pydantic import Discriminator, Tag
from pydantic import StrictFloat as Number  # a text or a truth value is no number

from seatrial.acquisition.config import declarations
from seatrial.acquisition.config.run_sheet import Conditions, Context, non_default_values
from seatrial.acquisition.core.errors import ConfigurationError, InputError
from seatrial.acquisition.core.files import line_of_toml_key, read_text, toml_value, validate_toml, write_text
from seatrial.acquisition.core.named_code import split_code_reference
from seatrial.acquisition.core.result import ChosenModel
from seatrial.acquisition.core.ship import DEFAULT as DEFAULT_ACTUATORS
from seatrial.acquisition.core.ship import (
    DEFAULT_VESSEL,
    VESSELS,
    Actuator,
    Actuators,
    actuators_as_text,
    actuators_of_table,
    check_actuators,
)
from seatrial.acquisition.core.trial import Trial
from seatrial.acquisition.recording.reader import read_recording, read_trial
from seatrial.analysis.quality.wind import recorded_conditions
from seatrial.hybrid.vessel.actuators import KINDS, ActuatorEntry
from seatrial.hybrid.vessel.hulls import HULLS
from seatrial.hybrid.vessel.hulls.kind import HullEntry
from seatrial.hybrid.vessel.wind import HARMONICS, TABLE_SIZE, FujiwaraWind, NoWind, Wind

if TYPE_CHECKING:
    AnyActuator = ActuatorEntry
    AnyHull = HullEntry
else:  # the kinds' and models' entries, distinguished by a word in them
    AnyActuator = Annotated[Union[tuple(kind.entry for kind in KINDS.values())], Discriminator("kind")]  # noqa: UP007
    AnyHull = Annotated[Union[tuple(model.entry for model in HULLS.values())], Discriminator("model")]  # noqa: UP007

_STRICT = {"extra": "forbid"}
Values = Mapping[str, Number]
Provenance = Mapping[str, str | float | int | bool]
_NAMES_SIMULATOR = re.compile(r"(?:\s*(?:#[^\n]*|[\w-]+\s*=[^\n]*)?\n)*?\s*simulator\s*=")  # before any table
LONGEST_MODEL_M = 20.0
"""What is shorter is of a model's size."""


@dataclass(frozen=True, slots=True)
class Dimensions:
    """Main dimensions [m]."""

    length_overall_m: Number
    length_between_perpendiculars_m: Number
    beam_m: Number
    draught_m: Number

    @property
    def is_model(self) -> bool:
        """Whether the ship is of a model's size."""
        return self.length_between_perpendiculars_m < LONGEST_MODEL_M


@dataclass(frozen=True, slots=True)
class Validity:
    """Speeds through the water that the coefficients hold in [m/s, rad/s]; sway and yaw either way."""

    surge_low_mps: Number
    surge_high_mps: Number
    sway_mps: Number
    yaw_rate_radps: Number


@dataclass(frozen=True, slots=True)
class Inertia:
    """Rigid body and added mass; Yrd = Nvd.

    ``yaw_inertia_kgm2`` is about the centre of gravity, ``centre_of_gravity_m`` how far ahead of the origin of the
    body axes that lies; the added masses are about the origin.
    """

    mass_kg: Number
    yaw_inertia_kgm2: Number
    Xud: Number
    Yvd: Number
    Yrd: Number
    Nrd: Number
    centre_of_gravity_m: Number = 0.0
    model: Literal["si"] = "si"

    def in_si(self, vessel: Vessel) -> Inertia:
        """Itself."""
        return self


@dataclass(frozen=True, slots=True, kw_only=True)
class PrimedInertia:
    """Rigid body and added mass without dimension, as the MMG method writes them.

    Masses by rho/2 L^2 d, moments of inertia by rho/2 L^4 d, ``x_G`` by L; ``I_zG`` is about the centre of gravity.
    """

    model: Literal["primed"]
    m: Number
    m_x: Number
    m_y: Number
    I_zG: Number
    J_z: Number
    x_G: Number = 0.0

    def in_si(self, vessel: Vessel) -> Inertia:
        """These numbers in SI."""
        L = vessel.dimensions.length_between_perpendiculars_m
        mass = 0.5 * vessel.water_density_kgpm3 * L**2 * vessel.dimensions.draught_m
        inertia = mass * L**2
        return Inertia(
            self.m * mass,
            self.I_zG * inertia,
            -self.m_x * mass,
            -self.m_y * mass,
            0.0,
            -self.J_z * inertia,
            self.x_G * L,
        )


AnyWind = Annotated[Wind | FujiwaraWind | NoWind, Discriminator("model")]


AnyInertia = Annotated[
    Annotated[Inertia, Tag("si")] | Annotated[PrimedInertia, Tag("primed")],
    Discriminator(lambda value: str(value.get("model", "si") if isinstance(value, Mapping) else value.model)),
]


@dataclass(frozen=True, slots=True)
class Vessel:
    """A whole vessel as its file states it.

    ``actuator`` has an entry for each actuator; their order is that of the controls. ``effects`` are additions to
    the model, name to parameter values in the units of the parameters' names; ``base`` is the vessel that the
    file built upon, if it did; ``context`` is what is known of her trials beforehand; ``provenance`` is free text
    and numbers about where the values come from. ``estimated`` are the usual relative errors, one standard
    deviation, of numbers that a regression gave, by ``TABLE.NUMBER`` or ``ACTUATOR.NUMBER``.
    """

    name: str
    water_density_kgpm3: Number
    dimensions: Dimensions
    validity: Validity
    inertia: AnyInertia
    hull: AnyHull
    wind: AnyWind
    actuator: tuple[AnyActuator, ...]
    description: str = ""
    base: str = ""
    effects: Mapping[str, Values] = field(default_factory=dict)
    context: Context = field(default_factory=Context)
    provenance: Provenance = field(default_factory=dict)
    estimated: Mapping[str, Number] = field(default_factory=dict)

    @property
    def actuators(self) -> Actuators:
        """The names and kinds of the actuators, in the order of their controls."""
        return tuple(Actuator(actuator.name, actuator.kind) for actuator in self.actuator)

    def of_kind(self, kind: str) -> tuple[Any, ...]:
        """The actuators of one kind."""
        return tuple(actuator for actuator in self.actuator if actuator.kind == kind)


_PARTS = (Dimensions, Validity, Inertia, PrimedInertia, Wind, FujiwaraWind, NoWind, Vessel)
_ENTRIES = (*(model.entry for model in HULLS.values()), *(kind.entry for kind in KINDS.values()))
for _part in (*_PARTS, *_ENTRIES):
    setattr(_part, "__pydantic_config__", _STRICT)  # noqa: B010 - not an attribute that mypy knows


DEFAULT = DEFAULT_VESSEL
_ADDED = ("effects", "context", "provenance", "estimated")
_OLD = {
    "pods": '[[actuator]] with name, kind = "azimuth", x_m, y_m, propeller_diameter_m ... for each pod',
    "tunnel": '[[actuator]] with name = "tunnel" and kind = "tunnel"',
    **dict.fromkeys(("surge", "sway", "yaw"), '[hull] with model = "polynomial" and all coefficients of X, Y, N'),
}
"""Tables of the files' older form, and what is written instead."""

_POSITIVE = {
    "dimensions": ("length_overall_m", "length_between_perpendiculars_m", "beam_m", "draught_m"),
    "inertia": ("mass_kg", "yaw_inertia_kgm2", "m", "I_zG"),
    "wind": ("lateral_centre_height_m", "bridge_height_m", "superstructure_area_m2"),
}
"""The numbers that must be above zero, by table; those of an actuator its kind says."""


def load_vessel(name_or_file: str | Path | Vessel | None = None) -> Vessel:
    """Read a vessel by the name of a file in ``trials/vessels``, or from a file of one's own; what is one already
    stays it. Without a name R/V Gunnerus.

    Parameters
    ----------
    name_or_file
        One of :func:`seatrial.vessels`, a vessel file, or a vessel.

    Returns
    -------
    Vessel
        Dimensions, masses, coefficients, actuators and wind, in SI, as in the file.

    Raises
    ------
    ConfigurationError
        Naming file, line and key of what is missing, unknown or ill-typed.

    Examples
    --------
    >>> import seatrial as st
    >>> ship = st.load_vessel("gunnerus_short")
    >>> ship.name, ship.dimensions.length_between_perpendiculars_m
    ('gunnerus_short', 28.9)
    """
    if isinstance(name_or_file, Vessel):
        return name_or_file
    refuse_simulator(name_or_file)
    path = declarations.find_vessel(name_or_file or DEFAULT)
    text, merged = read_text(path), declarations.read_vessel_with_bases(path)
    for table, instead in _OLD.items():
        if table in merged:
            raise ConfigurationError(
                f"[{table}] is an outdated form of vessel file",
                where=f"{path}, line {line_of_toml_key(text, [table])}",
                fix=f"write {instead}; {VESSELS / DEFAULT}.toml shows it",
            )
    for name, values in dict(merged.get("effects", {})).items():
        if not isinstance(values, dict):
            raise ConfigurationError(
                f"effects.{name} is not a table of parameters",
                where=f"{path}, line {line_of_toml_key(text, ['effects', name])}",
                fix=f"write [effects.{name}] and its parameters below",
            )
    vessel = validate_toml(merged, text, path, Vessel)
    _check_values(vessel, text, path)
    try:
        check_actuators(vessel.actuators)
    except ConfigurationError as error:
        raise error.at(path) from error
    return vessel


def is_simulator(name_or_file: str | Path) -> bool:
    """Whether a name is that of a simulator of another make: ``FILE.fmu``, ``FILE.py:CLASS``, or a TOML file with
    one and the effects that a diagnosis added to it.

    >>> is_simulator("ship.fmu"), is_simulator("ship.py:Ship"), is_simulator("gunnerus_short")
    (True, True, False)
    """
    text = str(name_or_file)
    return text.lower().endswith(".fmu") or split_code_reference(text) is not None or names_simulator(Path(text))


def names_simulator(file: Path) -> bool:
    """Whether a TOML file names a simulator, so that it is of one."""
    return file.suffix == ".toml" and file.is_file() and bool(_NAMES_SIMULATOR.match(read_text(file)))


def refuse_simulator(name_or_file: str | Path | None) -> None:
    """Raise :class:`ConfigurationError` for a simulator where the numbers of a vessel file are needed."""
    if name_or_file is not None and is_simulator(name_or_file):
        raise ConfigurationError(
            "is a simulator, whose equations cannot be looked into", where=str(name_or_file),
            why="here the numbers of a vessel file are needed",
            fix="give a vessel file, which `seatrial vessel new` makes; simulators are for validate, evaluate, "
            "train, predict, watch, simulate and diagnose",
        )  # fmt: skip


def locate_vessel(name_or_file: str) -> str:
    """What means the same vessel from any folder: the name of one of Seatrial's own, or a file's whole path."""
    refuse_simulator(name_or_file)
    path = declarations.find_vessel(name_or_file)
    return path.stem if path.parent == VESSELS else str(path.resolve())


def save_vessel(vessel: Vessel, path: str | Path) -> None:
    """Write ``vessel`` so that :func:`load_vessel` gives it back.

    A vessel built on one of Seatrial's own states only what differs from it.

    Parameters
    ----------
    vessel
        The vessel.
    path
        The vessel file to write.

    Raises
    ------
    StorageError
        Where it cannot be written.

    Examples
    --------
    >>> import dataclasses, seatrial as st
    >>> ship = dataclasses.replace(st.load_vessel("gunnerus_short"), name="sister")
    >>> st.save_vessel(ship, "sister.toml")
    >>> st.load_vessel("sister.toml") == ship
    True
    """
    tree = _without_defaults(vessel)
    base = (
        declarations.read_vessel_with_bases(declarations.find_vessel(vessel.base))
        if vessel.base in declarations.vessel_names()
        else {}
    )
    base_names, names = ({actuator["name"] for actuator in part.get("actuator", ())} for part in (base, tree))
    if base_names and base_names <= names:
        tree = {key: _difference_from_base(value, base.get(key)) for key, value in tree.items()}
        tree = {key: value for key, value in tree.items() if value not in ({}, None)}
        tree |= {"base": vessel.base, "name": vessel.name}
    else:
        tree = {key: value for key, value in tree.items() if value not in ({}, "")} | {"base": ""}
    write_text(path, tree_as_toml(tree))


def _without_defaults(part: Any) -> Any:
    """A vessel or a part of it as plain data, without what is so by default."""
    if isinstance(part, tuple):
        return [_without_defaults(entry) for entry in part]
    if not is_dataclass(part):
        return dict(part) if isinstance(part, Mapping) else part
    return {name: _without_defaults(value) for name, value in non_default_values(part).items()}


def add_effects(vessel: Vessel, effects: Mapping[str, Mapping[str, float]], **provenance: Any) -> Vessel:
    """``vessel`` with effects added, ready to be saved; its base is then the vessel it was made from."""
    added = {name: dict(values) for name, values in {**vessel.effects, **effects}.items()}
    base = vessel.base or (vessel.name if vessel.name in declarations.vessel_names() else "")
    return replace(vessel, base=base, effects=added, provenance={**vessel.provenance, **provenance})


def _difference_from_base(value: Any, base: Any) -> Any:
    """What of ``value`` its base does not already say; ``None`` or an empty table if it says all."""
    if _is_list_of_tables(value):
        by_name = {table["name"]: table for table in base or ()}
        changed = [table for table in value if table != by_name.get(table["name"])]
        return [
            {**_difference_from_base(table, by_name.get(table["name"], {})), "name": table["name"]}
            for table in changed
        ] or None
    if isinstance(value, Mapping) and isinstance(base, Mapping):
        parts = {key: _difference_from_base(member, base.get(key)) for key, member in value.items()}
        return {key: member for key, member in parts.items() if member is not None and member != {}}
    return None if value == base else value


def _check_values(vessel: Vessel, text: str, path: Path) -> None:
    """What types cannot say: finite numbers, positive where they must be, tables of the right length; a rudder is
    behind a propeller of the ship, and an estimated number is there."""
    for table in ("CX", "CY", "CN") if vessel.wind.model == "coefficients" else ():
        size = len(getattr(vessel.wind, table))
        if size != TABLE_SIZE:
            _raise_configuration_error(
                path, text, ["wind", table], f"has {size} values", f"give {TABLE_SIZE}, at 0, 10 ... 180 deg"
            )
    tables: list[tuple[list[str | int], declarations.Tree]] = []
    for key, value in asdict(vessel).items():
        if key == "actuator":
            tables += [([key, number], table) for number, table in enumerate(value)]
        elif isinstance(value, dict) and key not in _ADDED:
            tables.append(([key], value))
    for keys, numbered in tables:
        positive = KINDS[numbered["kind"]].positive if keys[0] == "actuator" else _POSITIVE.get(str(keys[0]), ())
        for name, number in numbered.items():
            numbers = number if isinstance(number, tuple) else (number,)
            if not all(isinstance(value, str | None) or isfinite(value) for value in numbers):
                _raise_configuration_error(path, text, [*keys, name], f"is {number}", "give a finite number")
            if name in positive and number <= 0.0:
                _raise_configuration_error(path, text, [*keys, name], f"is {number:g}", "give a number above zero")
    propellers = [actuator.name for actuator in vessel.actuators if "propeller" in actuator.kind]
    for number, entry in enumerate(vessel.actuator):
        behind = getattr(entry, "behind", "")
        if behind and behind not in propellers:
            names = ", ".join(propellers) or "none; leave it out"
            _raise_configuration_error(
                path, text, ["actuator", number, "behind"], f"is {behind!r}", f"name a propeller: {names}"
            )
    by_name = {str(numbered["name"] if keys[0] == "actuator" else keys[0]): numbered for keys, numbered in tables}
    for name in vessel.estimated:
        table, _, number_name = name.partition(".")
        if number_name not in by_name.get(table, {}):
            fix = "write TABLE.NUMBER or ACTUATOR.NUMBER of this file"
            _raise_configuration_error(path, text, ["estimated"], f"has {name!r}", fix)


def _raise_configuration_error(path: Path, text: str, keys: list[str | int], what: str, fix: str) -> None:
    name = ".".join(map(str, keys))
    raise ConfigurationError(f"{name} {what}", where=f"{path}, line {line_of_toml_key(text, keys)}", fix=fix)


def tree_as_toml(tree: declarations.Tree, prefix: str = "") -> str:
    """A tree of tables, texts and numbers as TOML; plain keys before tables, as TOML demands."""
    tables = {key: value for key, value in tree.items() if isinstance(value, Mapping) or _is_list_of_tables(value)}
    lines = [
        f"{_toml_key(key)} = {toml_value(value)}"
        for key, value in tree.items()
        if key not in tables and value not in ("", None)
    ]
    text = "\n".join(lines) + ("\n" if lines else "")
    for key, value in tables.items():
        path = f"{prefix}{_toml_key(key)}"
        if _is_list_of_tables(value):
            text += "".join(f"\n[[{path}]]\n{tree_as_toml(dict(table), f'{path}.')}" for table in value)
            continue
        inner = tree_as_toml(dict(value), f"{path}.")
        holds_tables_only = all(isinstance(member, Mapping) for member in value.values()) and value
        text += inner if holds_tables_only else f"\n[{path}]\n{inner}"
    return text


def _is_list_of_tables(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(entry, Mapping) for entry in value)


def _toml_key(key: str) -> str:
    return key if key.replace("_", "").replace("-", "").isalnum() and key.isascii() else toml_value(key)


Trials = Mapping[Path, Trial]
"""What recordings, or the configuration of one to come, say of themselves, by their paths."""


@dataclass(frozen=True, slots=True)
class ReferenceModel:
    """A vessel as the model of recordings, where it comes from, and a remark on that.

    ``file`` is the name of one of Seatrial's own or a path, and means the same from any folder.
    """

    vessel: Vessel
    file: str
    choice: ChosenModel


def trials_of_recordings(recordings: Iterable[Path]) -> Trials:
    """The run sheets of recordings; one that states no ship gets the actuators that its channels are of.

    Raises :class:`InputError` for what is none.
    """
    trials = {path: read_trial(path) for path in map(Path, recordings)}
    return {
        path: trial if trial.vessel or trial.actuators else with_actuators(trial, read_recording(path).series)
        for path, trial in trials.items()
    }


def with_actuators(trial: Trial, channels: Iterable[str]) -> Trial:
    """The run sheet of a trial with these ``channels``; if it states no ship, with the actuators they are of."""
    if trial.vessel or trial.actuators:
        return trial
    actuators = actuators_of_table(channels, {"trial": asdict(trial)})
    return replace(trial, actuators=actuators_as_text(actuators, omit_default=False))


def reference_model(trials: Trials, vessel: str | Path | Vessel | None = None) -> ReferenceModel:
    """The model of recordings: ``vessel``, else the vessel file of the ship that they name.

    That is one of Seatrial's own, or a file beside the recording or in the working directory. Recordings that name
    no ship and have exactly R/V Gunnerus' actuators, as all had before ships were distinguished, are of that ship,
    which the remark says. Raises :class:`InputError` where no ship is named, no file is of it, or recordings are of
    several ships.
    """
    if isinstance(vessel, Vessel):
        return ReferenceModel(vessel, vessel.name, chosen_model(vessel.name, ship_names_of_vessel(vessel), trials))
    named = {path: trial.vessel for path, trial in trials.items() if trial.vessel}
    ships = sorted(set(named.values()))
    if not vessel and len(ships) > 1:
        raise InputError(
            f"the recordings are of different ships: {', '.join(ships)}",
            fix="give recordings of one ship, or choose the model with --vessel",
        )
    files = (declarations.vessel_file_of_ship(ship, path.parent) for path, ship in named.items())
    chosen = vessel or next(filter(None, files), None)
    default = actuators_as_text(DEFAULT_ACTUATORS, omit_default=False)
    unknown = [path for path, trial in trials.items() if trial.vessel or trial.actuators != default]
    if chosen is None and unknown:
        what = f"names the ship {ships[0]!r}, of which there is no vessel file" if ships else "names no ship"
        raise InputError(
            what, where=str(unknown[0]),
            fix=f"choose one of {', '.join(declarations.vessel_names())} or a file with --vessel, or put the "
                "ship's file beside the recording; `seatrial vessel new` makes one",
        )  # fmt: skip
    file = locate_vessel(str(chosen or DEFAULT))
    ship = load_vessel(file)
    name = ship.name if Path(file).stem == ship.name else f"{ship.name} ({Path(file).name})"
    choice = chosen_model(name, ship_names_of_vessel(ship) | {Path(file).stem}, trials)
    if chosen is None and trials:
        choice = replace(choice, doubt=f"{choice.doubt}: chosen by the actuators")
    return ReferenceModel(ship, file, choice)


def ship_names_of_vessel(vessel: Vessel) -> set[str]:
    """The names of the ships that a vessel is a model of: with its own that of the model it was made from."""
    source_models = {str(vessel.provenance.get(key, "")) for key in ("diagnosis_vessel", "identified_start")}
    base = set() if vessel.name in declarations.vessel_names() else {Path(vessel.base).stem}
    return {vessel.name, *base, *source_models}


def chosen_model(name: str, ships: set[str], trials: Trials) -> ChosenModel:
    """A model that is called ``name`` and is one of ``ships``, and whether the recordings name another."""
    named = [trial.vessel for trial in trials.values()]
    subject = "the recording names" if len(named) == 1 else "the recordings name"
    mismatched = sorted({Path(ship).stem if ship.endswith(".toml") else ship for ship in named if ship} - ships)
    if mismatched:
        return ChosenModel(name, f", not the ship that {subject} ({', '.join(mismatched)})")
    return ChosenModel(
        name, "" if all(named) else f"; {subject} no ship" if not any(named) else "; some name no ship"
    )


_MULTIPLES = (0.0, 1.0, 3.0, 5.0)  # of the angle, in the harmonics of CX


def conditions_of(vessel: Vessel) -> Conditions:
    """The part of the conditions of a speed trial that is the ship's; C_AA is its CX with the other sign.

    How it was loaded and what water it was in is not taken from its file: they are the day's.
    """
    size = vessel.dimensions
    wind = vessel.wind.numbers(size.length_between_perpendiculars_m, size.beam_m)
    ahead = np.asarray(wind["CX"])
    if wind.get("wind_model") == HARMONICS:
        angles = np.linspace(0.0, np.pi, TABLE_SIZE)[:, np.newaxis]
        ahead = np.cos(angles * _MULTIPLES) @ ahead[: len(_MULTIPLES)]
    frontal = float(np.max(wind["frontal_area_m2"]))
    return Conditions(
        length_m=size.length_between_perpendiculars_m, beam_m=size.beam_m,
        frontal_area_m2=frontal or None, wind_resistance=tuple(map(float, -ahead)) if frontal else (),
    )  # fmt: skip


def correction_conditions(
    recorded: Iterable[tuple[Trial, pd.DataFrame]], ship: Vessel | None, stated: Conditions | None = None
) -> Conditions:
    """What is known for the corrections: what is ``stated``, then what recordings say, then the vessel file."""
    conditions = stated or Conditions()
    for trial, table in recorded:
        conditions = conditions.completed_from(recorded_conditions(trial, table))
    return conditions if ship is None else conditions.completed_from(conditions_of(ship))
