"""What the sensors report of a motion, from true states, and the channels of a table as the simulator's SI arrays.

Delays look back along the simulated track, and before its first state along the circle that the first speeds
describe. Neutral numbers in the plant leave every value as it is, bit for bit. The effects of the catalogue that
concern the *inputs* of a simulation (drives, wind sensor) act in the simulator, not here, but for a delay of the
drives' feedback (:func:`acting_controls`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from numba import njit
from numpy.typing import ArrayLike

from seatrial.acquisition.core import errors, ship
from seatrial.acquisition.core.quantities import Floats, rotate_earth_to_ship, to_earth
from seatrial.analysis.tables.table import table_actuators
from seatrial.hybrid.vessel.actuators import angle_columns, control_units

if TYPE_CHECKING:
    from seatrial.hybrid.vessel.black_box import MotionModel

NORTH, EAST, HEADING, SURGE, SWAY, YAW_RATE = range(6)
STATE_UNITS = np.array([1.0, 1.0, np.pi / 180.0, 1.0, 1.0, np.pi / 180.0])
WIND_UNITS = np.array([np.pi / 180.0, 1.0])
SETTINGS = (
    "heading_bias_rad", "heading_delay_s", "position_delay_s", "antenna_forward_m", "antenna_starboard_m",
    "speed_delay_s", "speed_scale", "speed_sensor_forward_m", "speed_sensor_starboard_m", "speed_sensor_angle_rad",
    "sway_bias_mps", "yaw_rate_scale", "yaw_rate_bias_radps",
)  # fmt: skip
"""The numbers of a plant that :func:`measure` uses."""


def sensors_are_equal(first: MotionModel, second: MotionModel) -> bool:
    """Whether the sensors of two models report the same motion in the same way."""
    return all(getattr(first, name) == getattr(second, name) for name in SETTINGS)


def differ_only_in_sensors(first: MotionModel, second: MotionModel) -> bool:
    """Whether two models of one ship differ in nothing but what their sensors report."""
    return first.replaced(**{name: getattr(second, name) for name in SETTINGS}) == second


def has_sensor_delay(plant: MotionModel) -> bool:
    """Whether a sensor of the plant reports what was before; if not, each sample says what is."""
    return any((plant.heading_delay_s, plant.position_delay_s, plant.speed_delay_s))


def measure(states: ArrayLike, plant: MotionModel, dt_s: float) -> Floats:
    """States [..., K+1, 6] as the sensors of ``plant`` report them, samples ``dt_s`` apart.

    Reported = factor x true, or true + bias; what is stamped late is the value of ``..._delay_s`` before.
    """
    true = np.asarray(states, dtype=np.float64)
    reported = true.copy()
    located = _delayed_pose(true, plant.position_delay_s, dt_s) if plant.position_delay_s else true
    reported[..., :2] = located[..., :2]
    forward, starboard = plant.antenna_forward_m, plant.antenna_starboard_m
    if forward or starboard:
        reported[..., :2] += np.stack(to_earth(forward, starboard, located[..., HEADING]), axis=-1)
    if plant.heading_delay_s:
        reported[..., HEADING] = _delayed_pose(true, plant.heading_delay_s, dt_s)[..., HEADING]
    reported[..., HEADING] += plant.heading_bias_rad
    reported[..., SURGE:] = _measured_speeds(true, plant, dt_s)
    return reported


def _measured_speeds(true: Floats, plant: MotionModel, dt_s: float) -> Floats:
    """Surge, sway and yaw rate [..., K+1, 3]: late, of a point off the reference point, along turned axes,
    times their factors and plus their biases, in this order.
    """
    speeds, last = true[..., SURGE:].copy(), true.shape[-2] - 1
    if plant.speed_delay_s and last > 0:  # beyond the track's ends they go on as at the end for up to one sample
        slope = np.gradient(speeds, axis=-2)
        times = np.arange(last + 1) - plant.speed_delay_s / dt_s
        overshoot = (times - np.clip(times, 0.0, last)).clip(-1.0, 1.0)[:, np.newaxis]
        ends = np.where(overshoot < 0.0, slope[..., :1, :], slope[..., -1:, :])
        speeds = np.asarray(_interpolate_cubic(speeds, slope, np.clip(times, 0.0, last)) + overshoot * ends)
    surge, sway, yaw_rate = speeds[..., 0], speeds[..., 1], speeds[..., 2]
    surge -= plant.speed_sensor_starboard_m * yaw_rate
    sway += plant.speed_sensor_forward_m * yaw_rate
    if plant.speed_sensor_angle_rad:
        speeds[..., :2] = np.stack(rotate_earth_to_ship(surge, sway, plant.speed_sensor_angle_rad), axis=-1)
    speeds[..., :2] *= plant.speed_scale
    sway += plant.sway_bias_mps
    yaw_rate *= plant.yaw_rate_scale
    yaw_rate += plant.yaw_rate_bias_radps
    return speeds


def _delayed_pose(states: Floats, delay_s: float, dt_s: float) -> Floats:
    """The pose [..., K+1, 3] ``delay_s`` before each sample (after it, if negative).

    What the speeds cover meanwhile is subtracted: they, not differences of measured poses, state the motion, so
    that an error of one pose does not move that of another sample. The integral of the speeds is Hermite's, of
    fourth order.
    """
    last = states.shape[-2] - 1
    times = np.arange(last + 1) - delay_s / dt_s
    rate = pose_rate(states) * dt_s
    covered = np.zeros_like(rate)
    if last > 0:
        bend = np.gradient(rate, axis=-2)
        steps = 0.5 * (rate[..., 1:, :] + rate[..., :-1, :]) - np.diff(bend, axis=-2) / 12.0
        covered[..., 1:, :] = np.cumsum(steps, axis=-2)
    at_times = _interpolate_cubic(covered, rate, np.clip(times, 0.0, last))
    before_start, after_end = times < 0.0, times > last
    at_times[..., before_start, :] += pose_change_along_arc(states[..., :1, :], times[before_start] * dt_s)
    at_times[..., after_end, :] += pose_change_along_arc(states[..., -1:, :], (times[after_end] - last) * dt_s)
    return np.asarray(states[..., :3] + at_times - covered)


def _interpolate_cubic(values: Floats, slope: Floats, times: Floats) -> Floats:
    """Values [..., K+1, n] at ``times`` [m] in samples: the cubics that meet values and slopes per sample."""
    last = values.shape[-2] - 1
    lower = np.clip(np.floor(times), 0, max(last - 1, 0)).astype(int)
    upper = np.minimum(lower + 1, last)
    t = (times - lower)[:, np.newaxis]
    complement, before, after = 1.0 - t, values[..., lower, :], values[..., upper, :]
    return np.asarray(
        complement**2 * ((1.0 + 2.0 * t) * before + t * slope[..., lower, :])
        + t**2 * ((3.0 - 2.0 * t) * after - complement * slope[..., upper, :])
    )


def pose_rate(states: Floats) -> Floats:
    """North, east [m/s] and turning speed [rad/s] of states [..., 6]: [..., 3]."""
    speeds = to_earth(states[..., SURGE], states[..., SWAY], states[..., HEADING])
    return np.stack([*speeds, states[..., YAW_RATE]], axis=-1)


def pose_change_along_arc(states: Floats, ahead_s: Floats) -> Floats:
    """How the pose changes in ``ahead_s`` [n] at the constant speeds of ``states`` [..., 1, 6]: [..., n, 3].

    With yaw rate r the ship goes along the chord of a circle, t sin(r t / 2) / (r t / 2) times its speed, in the
    axes of its heading half way; sinc stays exact for a yaw rate of zero.
    """
    turned = states[..., YAW_RATE] * ahead_s
    middle = states[..., HEADING] + 0.5 * turned
    chord = ahead_s * np.sinc(turned / (2.0 * np.pi))
    north, east = to_earth(states[..., SURGE], states[..., SWAY], middle)
    return np.stack([chord * north, chord * east, turned], axis=-1)


def acting_controls(controls: ArrayLike, delay_s: ArrayLike, dt_s: float, angles: Sequence[int]) -> Floats:
    """The controls that act while ``controls`` [..., K, controls] are recorded ``delay_s`` after they acted.

    ``delay_s`` is one number or one a run, [...]; with a negative one this is what such a record shows of
    controls that act. Linear between samples ``dt_s`` apart (which is the mean over a step of controls that
    are held), those that are ``angles`` [rad] along the shorter way round, held beyond the ends.
    No delay, no change.
    """
    recorded = np.asarray(controls, dtype=np.float64)
    delay = np.asarray(delay_s, dtype=np.float64)
    if not delay.any():
        return recorded
    last, width = recorded.shape[-2] - 1, recorded.shape[-1]
    recorded = np.broadcast_to(recorded, (*np.broadcast_shapes(recorded.shape[:-2], delay.shape), last + 1, width))
    times = np.clip(np.arange(last + 1) + delay[..., np.newaxis] / dt_s, 0.0, last)
    lower = np.broadcast_to(np.floor(times).astype(int), recorded.shape[:-1])[..., np.newaxis]
    part = times[..., np.newaxis] - lower
    before = np.take_along_axis(recorded, lower, axis=-2)
    step = np.take_along_axis(recorded, np.minimum(lower + 1, last), axis=-2) - before
    turn = step[..., angles]
    step[..., angles] = turn - 2.0 * np.pi * np.round(turn / (2.0 * np.pi))
    return np.asarray(before + part * step)


@njit(cache=True)
def behind_play(motor: Floats, width: float) -> Floats:
    """Where the end of a gear with play stands when its motor's side has stood at ``motor`` [K], without jumps.

    The play operator: it stays unless the motor's side is more than half the ``width`` away, and then is dragged
    along at that distance. It begins in the middle of the play.
    """
    end = motor.copy()
    for k in range(1, len(motor)):
        end[k] = min(max(end[k - 1], motor[k] - 0.5 * width), motor[k] + 0.5 * width)
    return end


def check_ship(recorded: ship.Actuators, plant: MotionModel) -> None:
    """Raise :class:`InputError` where a recording is of a ship with other actuators than the model has."""
    if recorded != plant.layout:
        ships = actuator_list_text(recorded), actuator_list_text(plant.layout)
        if set(recorded) == set(plant.layout):
            raise errors.InputError(
                f"the recording has the actuators {ships[0]}, the model the same in another order: {ships[1]}",
                fix="give the vessel file's [[actuator]] the order of the recording",
            )
        raise errors.InputError(
            f"the recording is of a ship with {ships[0]}, the model of one with {ships[1]}",
            fix="give the recorded ship's file with --vessel, or a calibrator of this ship; if it is this ship, "
            "`seatrial import --vessel` names the channels as its file does",
        )


def actuator_list_text(actuators: ship.Actuators) -> str:
    """Actuators by name and kind."""
    return ", ".join(f"{actuator.name} ({actuator.kind})" for actuator in actuators) or "no known actuators"


def states_of(table: pd.DataFrame) -> Floats:
    """North, east [m], heading [rad, unwrapped], surge, sway [m/s], yaw rate [rad/s]: [rows, 6]."""
    values = _columns_as_array(table, ship.POSE_AND_VELOCITY)
    values[:, 2] = ship.unwrap(values[:, 2])
    return np.asarray(values * STATE_UNITS)


def controls_of(table: pd.DataFrame, actuators: ship.Actuators | None = None) -> Floats:
    """The controls of a ship in SI, actuator by actuator: [rows, controls]; by default those that a table is of."""
    actuators = table_actuators(table) if actuators is None else actuators
    return np.asarray(_columns_as_array(table, ship.control_names(actuators)) * control_units(actuators))


def wind_of(table: pd.DataFrame) -> Floats:
    """Direction the wind comes from [rad] and its speed [m/s]: [rows, 2]."""
    return np.asarray(_columns_as_array(table, ship.ENVIRONMENT) * WIND_UNITS)


def states_as_table(
    states: ArrayLike,
    controls: ArrayLike,
    wind: ArrayLike,
    index: pd.Index,
    actuators: ship.Actuators = ship.DEFAULT,
) -> pd.DataFrame:
    """The channels from states [rows, 6], controls [rows, controls] and wind [rows, 2], angles wrapped."""
    motion = np.asarray(states, dtype=np.float64) / STATE_UNITS
    command = np.asarray(controls, dtype=np.float64) / control_units(actuators)
    air = np.asarray(wind, dtype=np.float64) / WIND_UNITS
    motion[:, 2], air[:, 0] = ship.wrap_360(motion[:, 2]), ship.wrap_360(air[:, 0])
    angles = angle_columns(actuators)
    command[:, angles] = ship.wrap_180(command[:, angles])
    names = [*ship.POSE_AND_VELOCITY, *ship.ENVIRONMENT, *ship.control_names(actuators)]
    return pd.DataFrame(np.hstack([motion, air, command]), index=index, columns=names)


def _columns_as_array(table: pd.DataFrame, names: tuple[str, ...]) -> Floats:
    missing = [name for name in names if name not in table.columns]
    if missing:
        raise errors.InputError(
            f"the table lacks {', '.join(missing)}", fix="give all channels, or map the columns to them"
        )
    return table[list(names)].to_numpy(dtype=np.float64, copy=True)
