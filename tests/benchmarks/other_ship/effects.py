"""The effects of the catalogue, once more from their published forms: what each changes on the data sheet.

Signs as the project's contract has them: currents and drift go TO their direction, true azimuth = reported +
offset, reported heading = true + bias, a delayed position is where the ship was.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping
from copy import deepcopy
from dataclasses import dataclass, field
from math import cos, pi, radians, sin, tan
from pathlib import Path
from typing import Any

from acquisition.errors import ConfigurationError

VESSELS = Path(__file__).parents[3] / "trials" / "vessels"
ADDED_LATERAL_AREA_M = 4.0
TURNING = ("Yur", "Yuur", "Yrrr", "Y_absr_r", "Nur", "Nuur", "Nrrr", "N_absr_r")
Values = Mapping[str, float]
Hidden = Mapping[str, Values]


@dataclass(slots=True)
class Sheet:
    """The ship's data sheet: the vessel file's numbers by section, and what effects add to them."""

    numbers: dict[str, Any]
    hull_growth: dict[str, float] = field(default_factory=dict)  # of whole derivatives, by water depth
    added_mass_growth: tuple[float, float] = (1.0, 1.0)  # sway, yaw
    wind_factor: float = 1.0
    current_mps: list[float] = field(default_factory=lambda: [0.0, 0.0])  # north, east
    drift_n: list[float] = field(default_factory=lambda: [0.0, 0.0])  # size, direction it goes to [rad]
    steady_force: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])  # X, Y [N], N [N m]
    pod_share: list[float] = field(default_factory=lambda: [1.0, 1.0])  # port, starboard
    pod_offset_rad: list[float] = field(default_factory=lambda: [0.0, 0.0])
    lag_s: float = 0.0
    heading_bias_rad: float = 0.0
    antenna_m: list[float] = field(default_factory=lambda: [0.0, 0.0])  # forward, starboard
    position_delay_s: float = 0.0
    speed_factor: float = 1.0
    vane_bias_rad: float = 0.0


def data_sheet(vessel: str, hidden: Hidden) -> Sheet:
    """The numbers of ``trials/vessels/<vessel>.toml`` with the hidden effects worked in, in the order given.

    Raises :class:`ConfigurationError` for a vessel, an effect or a parameter that is not known.
    """
    path = VESSELS / f"{vessel}.toml"
    if not path.is_file():
        raise ConfigurationError(f"no vessel {vessel!r}", fix=f"put its file into {VESSELS}")
    sheet = Sheet(deepcopy(tomllib.loads(path.read_text(encoding="utf-8"))))
    for name, values in hidden.items():
        if name not in EFFECTS:
            raise ConfigurationError(f"no effect {name!r}", fix="use one of " + ", ".join(EFFECTS))
        change, parameters = EFFECTS[name]
        if set(values) - set(parameters):
            raise ConfigurationError(f"{name} takes {', '.join(parameters)}, not {', '.join(values)}")
        change(sheet, *(float(values.get(key, neutral)) for key, neutral in parameters.items()))
    return sheet


def _current(sheet: Sheet, speed_mps: float, direction_deg: float) -> None:
    sheet.current_mps[0] += speed_mps * cos(radians(direction_deg))
    sheet.current_mps[1] += speed_mps * sin(radians(direction_deg))


def _drift(sheet: Sheet, force_n: float, direction_deg: float) -> None:
    sheet.drift_n[:] = [force_n, radians(direction_deg)]


def _lengthen(sheet: Sheet, length_m: float) -> None:
    """Strip theory in short: every coefficient with the length, once more for every lever arm in it."""
    size = sheet.numbers["dimensions"]
    s = (size["length_between_perpendiculars_m"] + length_m) / size["length_between_perpendiculars_m"]
    size["length_between_perpendiculars_m"] += length_m
    size["length_overall_m"] += length_m
    for name, power in {"mass_kg": 1, "Xud": 1, "Yvd": 1, "Yrd": 2, "yaw_inertia_kgm2": 3, "Nrd": 3}.items():
        sheet.numbers["inertia"][name] *= s**power
    for section, arms in (("surge", 1), ("sway", 1), ("yaw", 2)):
        for name in sheet.numbers[section]:
            sheet.numbers[section][name] *= s**0.8 if name == "Xuu" else s ** (arms + name.count("r"))
    for side in ("port", "starboard"):
        sheet.numbers["pods"][f"{side}_x_m"] -= length_m / 2
    sheet.numbers["tunnel"]["x_m"] += length_m / 2
    sheet.numbers["wind"]["lateral_area_m2"] += ADDED_LATERAL_AREA_M * length_m


def _shallow(sheet: Sheet, depth_m: float) -> None:
    """Derivatives of whole forces grow with draught over depth (Hirano et al., West-Japan SNA 69, 1985).

    The aspect ratio's own share is that of the catalogue, 1 - g, so that a depth means the same there and here.
    """
    size = sheet.numbers["dimensions"]
    y = 0.5 * pi * size["draught_m"] / depth_m
    slender = size["draught_m"] / size["length_between_perpendiculars_m"]
    below = [(y / tan(y)) ** power if y else 1.0 for power in (2.3, 1.7, 0.7)]
    force, moment, turning = (1.0 / (g + slender * (1.0 - g)) for g in below)
    for section, drifting in (("sway", force), ("yaw", moment)):
        for name in sheet.numbers[section]:
            sheet.hull_growth[name] = turning if name in TURNING else drifting
    sheet.added_mass_growth = (force, moment)


def _scale(section: str, *names: str) -> Callable[[Sheet, float], None]:
    def change(sheet: Sheet, factor: float) -> None:
        for name in names:
            sheet.numbers[section][name] *= factor

    return change


def _cross_flow(sheet: Sheet, factor: float) -> None:
    sheet.numbers["sway"]["Y_absv_v"] *= factor
    sheet.numbers["yaw"]["N_absv_v"] *= factor


def _wind_load(sheet: Sheet, factor: float) -> None:
    sheet.wind_factor *= factor


def _towed(sheet: Sheet, force_n: float) -> None:
    sheet.steady_force[0] -= force_n


def _asymmetry(sheet: Sheet, moment_nm: float) -> None:
    sheet.steady_force[2] += moment_nm


def _loss(*pods: int) -> Callable[[Sheet, float], None]:
    def change(sheet: Sheet, fraction: float) -> None:
        for pod in pods:
            sheet.pod_share[pod] *= 1.0 - fraction

    return change


def _offset(*pods: int) -> Callable[[Sheet, float], None]:
    def change(sheet: Sheet, angle_deg: float) -> None:
        for pod in pods:
            sheet.pod_offset_rad[pod] += radians(angle_deg)

    return change


def _lag(sheet: Sheet, time_constant_s: float) -> None:
    sheet.lag_s = time_constant_s


def _heading_bias(sheet: Sheet, angle_deg: float) -> None:
    sheet.heading_bias_rad += radians(angle_deg)


def _antenna(sheet: Sheet, forward_m: float, starboard_m: float) -> None:
    sheet.antenna_m[:] = [forward_m, starboard_m]


def _delay(sheet: Sheet, seconds: float) -> None:
    sheet.position_delay_s = seconds


def _speed_scale(sheet: Sheet, factor: float) -> None:
    sheet.speed_factor *= factor


def _vane(sheet: Sheet, angle_deg: float) -> None:
    sheet.vane_bias_rad += radians(angle_deg)


EFFECTS: dict[str, tuple[Callable[..., None], dict[str, float]]] = {
    "ocean_current": (_current, {"speed_mps": 0.0, "direction_deg": 0.0}),
    "wave_drift": (_drift, {"force_n": 0.0, "direction_deg": 0.0}),
    "wind_load": (_wind_load, {"factor": 1.0}),
    "hull_lengthening": (_lengthen, {"length_m": 0.0}),
    "hull_fouling": (_scale("surge", "Xuu"), {"resistance_factor": 1.0}),
    "cross_flow_drag": (_cross_flow, {"factor": 1.0}),
    "yaw_damping": (_scale("yaw", "Nur", "Nuur", "Nrrr", "N_absr_r"), {"factor": 1.0}),
    "shallow_water": (_shallow, {"depth_m": float("inf")}),
    "towed_load": (_towed, {"force_n": 0.0}),
    "loading": (_scale("inertia", "mass_kg", "yaw_inertia_kgm2"), {"mass_factor": 1.0}),
    "thrust_loss_port": (_loss(0), {"fraction": 0.0}),
    "thrust_loss_starboard": (_loss(1), {"fraction": 0.0}),
    "thrust_loss_both": (_loss(0, 1), {"fraction": 0.0}),
    "thruster_lag": (_lag, {"time_constant_s": 0.0}),
    "azimuth_offset_port": (_offset(0), {"angle_deg": 0.0}),
    "azimuth_offset_starboard": (_offset(1), {"angle_deg": 0.0}),
    "azimuth_offset_both": (_offset(0, 1), {"angle_deg": 0.0}),
    "yaw_asymmetry": (_asymmetry, {"moment_nm": 0.0}),
    "heading_bias": (_heading_bias, {"angle_deg": 0.0}),
    "position_antenna_offset": (_antenna, {"forward_m": 0.0, "starboard_m": 0.0}),
    "position_delay": (_delay, {"seconds": 0.0}),
    "speed_scale": (_speed_scale, {"factor": 1.0}),
    "wind_direction_bias": (_vane, {"angle_deg": 0.0}),
}
"""By name: what it does to the sheet, and its parameters with the values at which it is not there."""
