"""What is hidden: a term that the model lacks although the sea has it, or an error that the record gets.

Each kind says which effect of the catalogue puts back what is taken, and which others do the same to a ship as far
as her motion shows.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pandas as pd

from seatrial.analysis.tables.table import NANO, times_ns
from seatrial.hybrid.vessel.estimate.new_vessel import new_vessel
from seatrial.hybrid.vessel.files import Vessel, load_vessel
from tests.hybrid.froude import froude_scaled

Values = dict[str, dict[str, float]]
_MOTION_AXES = ("north_m", "east_m")


def _as_it_is(vessel: Vessel) -> Vessel:
    return vessel


def _as_recorded(table: pd.DataFrame) -> pd.DataFrame:
    return table


@dataclass(frozen=True, slots=True)
class Kind:
    """Something hidden: ``model`` is what the analyst has for the good model, ``record`` what for the record.

    ``effect`` with its ``values`` is what returns it. ``alike`` are effects that stand for the same to the ship.
    """

    effect: str
    values: dict[str, float] = field(default_factory=dict)
    alike: tuple[str, ...] = ()
    model: Callable[[Vessel], Vessel] = _as_it_is
    record: Callable[[pd.DataFrame], pd.DataFrame] = _as_recorded

    @property
    def names(self) -> set[str]:
        """Every effect that is a right name of it; none of a whole ship's coefficients, or of nothing."""
        return {self.effect, *self.alike} - {""}

    @property
    def in_record(self) -> bool:
        """Whether it is an error of the record."""
        return self.record is not _as_recorded


def _part(vessel: Vessel, part: str, **factors: float) -> Vessel:
    """A vessel with numbers of one of its parts, or of an actuator of that kind, multiplied."""
    if part in ("hull", "wind", "inertia"):
        return replace(vessel, **{part: _times(getattr(vessel, part), factors)})
    actuators = tuple(_times(each, factors) if each.kind == part else each for each in vessel.actuator)
    return replace(vessel, actuator=actuators)


def _times(entry: Any, factors: dict[str, float]) -> Any:
    return replace(entry, **{name: factor * getattr(entry, name) for name, factor in factors.items()})


def _less(part: str, **factors: float) -> Callable[[Vessel], Vessel]:
    return lambda vessel: _part(vessel, part, **factors)


def _with(vessel: Vessel, part: str, **numbers: float) -> Vessel:
    return replace(vessel, **{part: replace(getattr(vessel, part), **numbers)})


def _without(effect: str, factor: str, *alike: str) -> Kind:
    """A term that the vessel file multiplies by nothing; what returns it is that factor again."""

    def without(vessel: Vessel) -> Vessel:
        return replace(vessel, effects={**vessel.effects, effect: {factor: 0.0}})

    return Kind(effect, {factor: 1.0}, alike, without)


def _moved(column: str, by: float) -> Callable[[pd.DataFrame], pd.DataFrame]:
    return lambda table: table.assign(**{column: table[column] + by})


def _turned(column: str, by_deg: float) -> Callable[[pd.DataFrame], pd.DataFrame]:
    return lambda table: table.assign(**{column: (table[column] + by_deg) % 360.0})


def _scaled(factor: float, *columns: str) -> Callable[[pd.DataFrame], pd.DataFrame]:
    return lambda table: table.assign(**{column: factor * table[column] for column in columns})


def _late(seconds: float, *columns: str) -> Callable[[pd.DataFrame], pd.DataFrame]:
    """Each channel as it was some seconds before, by its own samples."""

    def change(table: pd.DataFrame) -> pd.DataFrame:
        time_s = (times_ns(table) - times_ns(table)[0]) / NANO
        changed = {}
        for column in columns:
            values = table[column].to_numpy(dtype=float)
            known = np.isfinite(values)
            before = np.interp(time_s - seconds, time_s[known], values[known])
            changed[column] = np.where(known, before, np.nan)
        return table.assign(**changed)

    return change


def _in_current(north_mps: float, east_mps: float) -> Callable[[pd.DataFrame], pd.DataFrame]:
    """The same motion through water that moves: over ground the ship goes where the water goes, too."""

    def change(table: pd.DataFrame) -> pd.DataFrame:
        time_s = (times_ns(table) - times_ns(table)[0]) / NANO
        heading = table["heading_deg"].interpolate(limit_direction="both").to_numpy(dtype=float)
        cosine, sine = np.cos(np.deg2rad(heading)), np.sin(np.deg2rad(heading))
        return table.assign(
            north_m=table["north_m"] + north_mps * time_s,
            east_m=table["east_m"] + east_mps * time_s,
            surge_mps=table["surge_mps"] + north_mps * cosine + east_mps * sine,
            sway_mps=table["sway_mps"] - north_mps * sine + east_mps * cosine,
        )

    return change


def _sister(vessel: Vessel) -> Vessel:
    """KVLCC2 at the length of the vessel by Froude's law; the wind's areas are the vessel's own."""
    other = load_vessel("kvlcc2_7m")
    scale = vessel.dimensions.length_between_perpendiculars_m / other.dimensions.length_between_perpendiculars_m
    return replace(froude_scaled(other, scale), wind=vessel.wind, validity=vessel.validity)


def _estimated(vessel: Vessel) -> Vessel:
    """The hull's coefficients as regressions give them for the vessel's dimensions."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "estimated.toml"
        new_vessel(
            path, name="estimated", length_m=3.0, beam_m=0.48925, draught_m=0.20114, block=0.831,
            service_speed_mps=0.6, propellers=["propeller,diameter=0.084,pitch_ratio=0.7151"],
            rudders=["rudder,area=0.01063,span=0.127905,behind=propeller"],
            hull="cross_flow", water_density_kgpm3=998.0,
        )  # fmt: skip
        return replace(vessel, hull=load_vessel(path).hull)


KINDS: dict[str, Kind] = {
    "nothing": Kind(""),
    "wind load": _without("wind_load", "factor", "wind_speed_scale"),
    "cross-flow drag": _without("cross_flow_drag", "factor"),
    "resistance": _without(
        "hull_fouling", "resistance_factor", "towed_load", "thrust_loss_propeller", "thrust_deduction_propeller",
        "wake_propeller",
    ),
    "X_vr of another convention": Kind(
        "turning_drag", {"factor": 0.0}, model=lambda vessel: _with(vessel, "hull", X_vr=0.4535)
    ),
    "rudder-hull interaction": Kind(
        "rudder_interaction_rudder", {"amount": 0.393}, ("rudder_loss_rudder",), _less("rudder", a_H=0.0)
    ),
    "flow straightening": _without("flow_straightening_rudder", "factor"),
    "wake": Kind(
        "wake_propeller", {"fraction": 0.5}, ("thrust_loss_propeller", "rudder_loss_rudder"),
        _less("propeller", wake_0=0.0, wake_1=0.0, wake_2=0.0),
    ),
    "thrust deduction": Kind(
        "thrust_deduction_propeller", {"amount": 0.22},
        ("thrust_loss_propeller", "hull_fouling", "towed_load", "wake_propeller"),
        _less("propeller", thrust_deduction=0.0),
    ),
    "thrust astern": _without("astern_thrust_propeller", "factor"),
    "yaw damping": _without("yaw_damping", "factor"),
    "drift moment": _without("drift_moment", "factor"),
    "drift force": _without("drift_force", "factor"),
    "turning force": _without("turning_force", "factor"),
    "added mass in sway": _without("sway_added_mass", "factor"),
    "rudder offset": Kind("rudder_offset_rudder", {"angle_deg": 8.0}, (), record=_moved("rudder_angle_deg", -8.0)),
    "current": Kind(
        "ocean_current", {"speed_mps": 0.08, "direction_deg": 60.0}, (), record=_in_current(0.04, 0.0693)
    ),
    "heading bias": Kind(
        "heading_bias", {"angle_deg": 4.0}, ("speed_sensor_rotation",), record=_turned("heading_deg", 4.0)
    ),
    "late positions": Kind("position_delay", {"seconds": 2.0}, (), record=_late(2.0, *_MOTION_AXES)),
    "speed scale": Kind("speed_scale", {"factor": 1.1}, (), record=_scaled(1.1, "surge_mps", "sway_mps")),
    "wind vane": Kind("wind_direction_bias", {"angle_deg": 60.0}, (), record=_turned("wind_direction_deg", 60.0)),
    "a sister ship": Kind("", model=_sister),
    "the hull as estimated": Kind("", model=_estimated),
}  # fmt: skip
"""Terms are taken out whole; errors of the record are about four times what is ordinary."""
