"""A ship at another scale, at the same Froude number: every number of her file by its dimension."""

from __future__ import annotations

import re
from dataclasses import fields, replace
from typing import Any

from seatrial.hybrid.vessel.files import Vessel
from seatrial.hybrid.vessel.hulls import HULLS


def froude_scaled(vessel: Vessel, scale: float) -> Vessel:
    """A ship ``scale`` times as large; a hull without dimension stays as it is."""
    root = scale**0.5
    shaft = {
        "limit_rpm": 1.0 / root,
        "shaft_lag_s": root,
        "azimuth_lag_s": root,
        "azimuth_rate_limit_dps": 1.0 / root,
        "rate_limit_dps": 1.0 / root,
        "lag_s": root,
        "area_m2": scale**2,
    }
    lengths = (
        "x_m",
        "y_m",
        "propeller_diameter_m",
        "diameter_m",
        "pitch_m",
        "wake_x_m",
        "span_m",
        "x_H_m",
        "l_R_m",
        "switch_x_m",
    )
    place = dict.fromkeys(lengths, scale)
    tunnel = {
        f"{name}_n": scale**3 * root**power for name, power in (("cubic", 3), ("quadratic", 2), ("linear", 1))
    }
    wind = dict.fromkeys(("frontal_area_m2", "lateral_area_m2", "superstructure_area_m2"), scale**2)
    heights = ("lateral_centre_m", "lateral_centre_height_m", "bridge_centre_m", "bridge_height_m")
    inertia = {"mass_kg": scale**3, "yaw_inertia_kgm2": scale**5, "Xud": scale**3, "Yvd": scale**3,
               "Yrd": scale**4, "Nrd": scale**5, "centre_of_gravity_m": scale}  # fmt: skip
    limits = dict.fromkeys(("surge_low_mps", "surge_high_mps", "sway_mps"), root) | {"yaw_rate_radps": 1.0 / root}
    forces = {each.name: _of_force(each.name, scale) for each in fields(vessel.hull)}
    return replace(
        vessel,
        name=f"{vessel.name}_scaled",
        dimensions=_times(
            vessel.dimensions, dict.fromkeys((each.name for each in fields(vessel.dimensions)), scale)
        ),
        validity=_times(vessel.validity, limits),
        inertia=_times(vessel.inertia, inertia),
        hull=vessel.hull if HULLS[vessel.hull.model].primed else _times(vessel.hull, forces),
        wind=_times(vessel.wind, wind | dict.fromkeys(heights, scale)),
        actuator=tuple(_times(each, shaft | place | tunnel) for each in vessel.actuator),
    )


def _of_force(name: str, scale: float) -> float:
    """The factor of a hull's coefficient: forces go with the cube of the scale, speeds with its root."""
    powers = re.sub("abs|_", "", name[1:])
    exponent = 3.0 + (name[0] == "N") - 0.5 * sum(each in "uv" for each in powers) + 0.5 * powers.count("r")
    return float(scale**exponent)


def _times(part: Any, factors: dict[str, float]) -> Any:
    own = {name: getattr(part, name, None) for name in factors}
    return replace(part, **{name: value * factors[name] for name, value in own.items() if isinstance(value, float)})
