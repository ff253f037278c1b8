"""The effects of the catalogue, once more from their published forms: what each changes on the data sheet.

Signs as the project's contract has them: currents and drift go TO their direction, true azimuth = reported +
offset, reported heading = true + bias, a delayed position is where the ship was.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import cos, inf, radians, sin

from seatrial.acquisition.core.errors import ConfigurationError
from tests.benchmarks.other_ship.hull_effects import add_skeg, lengthen, over_shallows, trim
from tests.benchmarks.other_ship.sheet import Sheet, vessel_sheet

Hidden = Mapping[str, Mapping[str, float]]
Change = Callable[..., None]


def data_sheet(vessel: str, hidden: Hidden) -> Sheet:
    """The vessel's sheet with the hidden effects worked in, in the order given.

    Raises :class:`ConfigurationError` for a vessel, an effect or a parameter that is not known.
    """
    sheet = vessel_sheet(vessel)
    for name, values in hidden.items():
        if name not in EFFECTS:
            raise ConfigurationError(f"no effect {name!r}", fix="use one of " + ", ".join(EFFECTS))
        change, parameters = EFFECTS[name]
        if set(values) - set(parameters):
            raise ConfigurationError(f"{name} takes {', '.join(parameters)}, not {', '.join(values)}")
        change(sheet, *(float(values.get(key, neutral)) for key, neutral in parameters.items()))
    return sheet


def _scale(section: str, *names: str, less: bool = False) -> Change:
    """Numbers of a section times a factor, or times what a loss leaves; names of other sections hold a dot."""

    def change(sheet: Sheet, value: float) -> None:
        for name in names:
            place, _, key = name.rpartition(".")
            numbers = sheet.numbers[place or section]
            factor = 1.0 - value if less else value
            numbers[key] = (
                [factor * each for each in numbers[key]] if key.startswith("C") else factor * numbers[key]
            )

    return change


def _times(slot: str) -> Change:
    def change(sheet: Sheet, factor: float) -> None:
        setattr(sheet, slot, getattr(sheet, slot) * factor)

    return change


def _plus(slot: str) -> Change:
    """An amount more in a slot; degrees into slots of radians."""

    def change(sheet: Sheet, amount: float) -> None:
        angle = slot.endswith(("_rad", "_radps"))
        setattr(sheet, slot, getattr(sheet, slot) + (radians(amount) if angle else amount))

    return change


def _place(slot: str) -> Change:
    def change(sheet: Sheet, forward_m: float, starboard_m: float) -> None:
        getattr(sheet, slot)[:] = [forward_m, starboard_m]

    return change


def _push(axis: int, sign: float = 1.0) -> Change:
    def change(sheet: Sheet, force: float) -> None:
        sheet.steady_force[axis] += sign * force

    return change


def _die_out(sheet: Sheet, *rates_ps: float) -> None:
    sheet.dies_out_ps[:] = rates_ps


def _lose(*pods: int) -> Change:
    def change(sheet: Sheet, fraction: float) -> None:
        for pod in pods:
            sheet.pod_share[pod] *= 1.0 - fraction

    return change


def _weaken_astern(*pods: int) -> Change:
    def change(sheet: Sheet, factor: float) -> None:
        for pod in pods:
            sheet.pod_astern[pod] *= factor

    return change


def _fade(sheet: Sheet, half_speed_mps: float) -> None:
    sheet.tunnel_half_speed_mps = half_speed_mps


def _offset(*pods: int) -> Change:
    def change(sheet: Sheet, angle_deg: float) -> None:
        for pod in pods:
            sheet.pod_offset_rad[pod] += radians(angle_deg)

    return change


def _loosen(*pods: int) -> Change:
    def change(sheet: Sheet, width_deg: float) -> None:
        for pod in pods:
            sheet.pod_play_rad[pod] += radians(width_deg)

    return change


def _current(sheet: Sheet, speed_mps: float, direction_deg: float) -> None:
    sheet.current_mps[0] += speed_mps * cos(radians(direction_deg))
    sheet.current_mps[1] += speed_mps * sin(radians(direction_deg))


def _drift(sheet: Sheet, force_n: float, direction_deg: float) -> None:
    sheet.drift_n[:] = [force_n, radians(direction_deg)]


def _wake(sheet: Sheet, fraction: float) -> None:
    for name, power in (("thrust_nu", 1), ("thrust_uu", 2), ("side_uv", 1)):
        sheet.numbers["pods"][name] *= (1.0 - fraction) ** power


_FACTOR = {"factor": 1.0}
_FRACTION = {"fraction": 0.0}
_ANGLE = {"angle_deg": 0.0}
_SECONDS = {"seconds": 0.0}
_WIDTH = {"width_deg": 0.0}
_POINT = {"forward_m": 0.0, "starboard_m": 0.0}

EFFECTS: dict[str, tuple[Change, dict[str, float]]] = {
    "ocean_current": (_current, {"speed_mps": 0.0, "direction_deg": 0.0}),
    "wave_drift": (_drift, {"force_n": 0.0, "direction_deg": 0.0}),
    "wind_load": (_scale("wind", "CX", "CY", "CN"), _FACTOR),
    "wind_drag": (_scale("wind", "CX"), _FACTOR),
    "wind_side_load": (_scale("wind", "CY"), _FACTOR),
    "wind_yaw_load": (_scale("wind", "CN"), _FACTOR),
    "hull_lengthening": (lengthen, {"length_m": 0.0}),
    "hull_fouling": (_scale("surge", "Xuu"), {"resistance_factor": 1.0}),
    "cross_flow_drag": (_scale("sway", "Y_absv_v", "yaw.N_absv_v"), _FACTOR),
    "yaw_damping": (_scale("yaw", "Nur", "Nuur", "Nrrr", "N_absr_r"), _FACTOR),
    "drift_force": (_scale("sway", "Yuv", "Yuuv", "Yvvv"), _FACTOR),
    "drift_moment": (_scale("yaw", "Nuv", "Nuuv", "Nvvv"), _FACTOR),
    "turning_force": (_scale("sway", "Yur", "Yuur", "Yrrr", "Y_absr_r"), _FACTOR),
    "turning_drag": (_scale("surge", "Xrr", "Xurr", "Xrv", "Xrvu"), _FACTOR),
    "low_speed_damping": (_die_out, dict.fromkeys(("surge_ps", "sway_ps", "yaw_ps"), 0.0)),
    "trim": (trim, {"shift_m": 0.0}),
    "skeg": (add_skeg, {"area_m2": 0.0}),
    "shallow_water": (over_shallows, {"depth_m": inf}),
    "towed_load": (_push(0, -1.0), {"force_n": 0.0}),
    "sway_asymmetry": (_push(1), {"force_n": 0.0}),
    "yaw_asymmetry": (_push(2), {"moment_nm": 0.0}),
    "loading": (_scale("inertia", "mass_kg", "yaw_inertia_kgm2"), {"mass_factor": 1.0}),
    "surge_added_mass": (_scale("inertia", "Xud"), _FACTOR),
    "sway_added_mass": (_scale("inertia", "Yvd"), _FACTOR),
    "yaw_inertia": (_scale("inertia", "yaw_inertia_kgm2", "Nrd"), _FACTOR),
    "thrust_loss_port": (_lose(0), _FRACTION),
    "thrust_loss_starboard": (_lose(1), _FRACTION),
    "thrust_loss_both": (_lose(0, 1), _FRACTION),
    "tunnel_thrust_loss": (_scale("tunnel", "cubic_n", "quadratic_n", "linear_n", less=True), _FRACTION),
    "speed_loss_tunnel": (_fade, {"half_speed_mps": inf}),
    "astern_thrust_port": (_weaken_astern(0), _FACTOR),
    "astern_thrust_starboard": (_weaken_astern(1), _FACTOR),
    "astern_thrust_both": (_weaken_astern(0, 1), _FACTOR),
    "wake_fraction": (_wake, _FRACTION),
    "pod_side_force": (_scale("pods", "side_nv", "side_uv", "side_vv"), _FACTOR),
    "thruster_lag": (_plus("lag_s"), {"time_constant_s": 0.0}),
    "azimuth_offset_port": (_offset(0), _ANGLE),
    "azimuth_offset_starboard": (_offset(1), _ANGLE),
    "azimuth_offset_both": (_offset(0, 1), _ANGLE),
    "azimuth_scale": (_times("azimuth_factor"), _FACTOR),
    "backlash_port": (_loosen(0), _WIDTH),
    "backlash_starboard": (_loosen(1), _WIDTH),
    "backlash_both": (_loosen(0, 1), _WIDTH),
    "command_delay": (_plus("command_delay_s"), _SECONDS),
    "position_delay": (_plus("position_delay_s"), _SECONDS),
    "position_antenna_offset": (_place("antenna_m"), _POINT),
    "heading_delay": (_plus("heading_delay_s"), _SECONDS),
    "heading_bias": (_plus("heading_bias_rad"), _ANGLE),
    "speed_delay": (_plus("speed_delay_s"), _SECONDS),
    "speed_sensor_offset": (_place("speed_point_m"), _POINT),
    "speed_sensor_rotation": (_plus("speed_turned_rad"), _ANGLE),
    "speed_scale": (_times("speed_factor"), _FACTOR),
    "sway_bias": (_plus("sway_bias_mps"), {"speed_mps": 0.0}),
    "yaw_rate_bias": (_plus("yaw_rate_bias_radps"), {"rate_dps": 0.0}),
    "yaw_rate_scale": (_times("yaw_rate_factor"), _FACTOR),
    "wind_direction_bias": (_plus("vane_bias_rad"), _ANGLE),
    "wind_speed_scale": (_times("wind_speed_factor"), _FACTOR),
}
"""By name: what it does to the sheet, and its parameters with the values at which it is not there."""
