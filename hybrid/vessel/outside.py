"""What a simulator of another make can be given from outside: a current, other controls and wind than recorded,
pushes on its hull; and what sensors report of it.

These are numbers with the names that a plant has for them, so that one effect changes either. A push is an
acceleration, for a simulator states no mass. Where a number is a force, its mass is that of an ordinary ship of its
length (:func:`assumed_inertia`), which cancels out of everything but the newtons.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache

import numpy as np

from seatrial.acquisition.core.quantities import Floats
from seatrial.acquisition.core.ship import Actuators
from seatrial.hybrid.vessel.actuators import KINDS, PLAY, angle_columns
from seatrial.hybrid.vessel.sensors import SETTINGS, acting_controls, behind_play
from seatrial.hybrid.vessel.signals import BodyPush

Numbers = Mapping[str, float]
DRAG = ("surge_drag_pm", "sway_drag_pm", "yaw_drag_pm")
"""Drag per mass and metre: of the squared surge, of sway and of yaw rate times the speed."""
_CONSTANT = ("constant_X_n", "constant_Y_n", "constant_N_nm")
_DENSITY_KGPM3, _GYRATION = 15.0, 0.25  # of length cubed, R/V Gunnerus 17 and KVLCC2 10; of length


@lru_cache(maxsize=32)
def neutral_numbers(actuators: Actuators) -> dict[str, float]:
    """Every number that can be given to a simulator with these actuators, at the value that changes nothing."""
    names: tuple[str, ...] = (
        *SETTINGS, *DRAG, *_CONSTANT, "current_north_mps", "current_east_mps", "wind_direction_bias_rad",
        "wind_speed_factor", "command_delay_s", "thruster_lag_s", "azimuth_scale",
    )  # fmt: skip
    for actuator in actuators:
        kind = KINDS[actuator.kind]
        numbers = [f"{label}_scale" for label in kind.labels]
        numbers += ["angle_offset_rad"] * any(kind.angles) + [kind.lag] * bool(kind.lag)
        numbers += [PLAY] * (PLAY in kind.numbers)
        names += tuple(f"{actuator.name}_{number}" for number in numbers)
    return {name: 1.0 if name.endswith(("_scale", "_factor")) else 0.0 for name in names}


def assumed_inertia(length_m: float) -> Floats:
    """The mass, twice, and the yaw inertia [kg, kg, kg m2] of an ordinary ship of a length."""
    mass_kg = _DENSITY_KGPM3 * length_m**3
    return np.array([mass_kg, mass_kg, mass_kg * (_GYRATION * length_m) ** 2])


def body_push(value: Callable[[str], float], length_m: float) -> BodyPush | None:
    """The push of the numbers that ``value`` gives; None where there is none."""
    constant = np.array([value(name) for name in _CONSTANT]) / assumed_inertia(length_m)
    drag = tuple(value(name) for name in DRAG)
    return BodyPush(tuple(constant.tolist()), drag) if constant.any() or any(drag) else None


def controls_inside(controls: Floats, value: Callable[[str], float], actuators: Actuators, dt_s: float) -> Floats:
    """What reaches the drives of a simulator [N, K, controls] where ``controls`` were recorded, held over ``dt_s``.

    In this order: recorded late, play, lag, gain and offset.
    """
    angles = angle_columns(actuators)
    acting = acting_controls(controls, value("command_delay_s"), dt_s, angles)
    column = 0
    for actuator in actuators:
        kind = KINDS[actuator.kind]
        own_lag_s = value(f"{actuator.name}_{kind.lag}") if kind.lag else 0.0
        lag_s = value("thruster_lag_s") + own_lag_s
        play_rad = value(f"{actuator.name}_{PLAY}") if PLAY in kind.numbers else 0.0
        for label, is_angle in zip(kind.labels, kind.angles, strict=True):
            gain, offset = value(f"{actuator.name}_{label}_scale"), 0.0
            if is_angle:
                gain *= value("azimuth_scale") if actuator.kind == "azimuth" else 1.0
                offset = value(f"{actuator.name}_angle_offset_rad")
            series = recorded = acting[..., column]
            if is_angle and (play_rad or lag_s):
                series = np.unwrap(series, axis=-1)
            if is_angle and play_rad:
                series = np.array([behind_play(np.ascontiguousarray(run), play_rad) for run in series])
            if lag_s > 0.0:
                series = lagged_means(series, lag_s, dt_s)
            if is_angle and gain != 1.0:  # from ahead either way
                series = series - 2.0 * np.pi * np.round(series / (2.0 * np.pi))
            if series is not recorded or gain != 1.0 or offset:
                acting = acting.copy() if acting is controls else acting
                acting[..., column] = gain * series + offset
            column += 1
    return acting


def lagged_means(series: Floats, lag_s: float, dt_s: float) -> Floats:
    """The means over each step [..., K] of what follows a held ``series`` with a first-order lag from its start."""
    decay, result = np.exp(-dt_s / lag_s), np.empty_like(series)
    share, state = lag_s / dt_s * (1.0 - decay), series[..., 0]
    for step in range(series.shape[-1]):
        target = series[..., step]
        result[..., step] = target + (state - target) * share
        state = target + (state - target) * decay
    return result


def true_wind(wind: Floats, value: Callable[[str], float]) -> Floats:
    """The wind [..., 2] where it was recorded with the errors of its sensor."""
    bias, factor = value("wind_direction_bias_rad"), value("wind_speed_factor")
    return wind if bias == 0.0 and factor == 1.0 else (wind - np.array([bias, 0.0])) / np.array([1.0, factor])
