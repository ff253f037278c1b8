"""A recorded manoeuvre replayed by a model: from the state at the order, under the recorded controls and wind.

What lies before the order stays as it was measured, so that the same functions find the same indices, approach and
all, in the measured run and in the replayed one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd

from seatrial.acquisition.core.errors import DataShortageError
from seatrial.acquisition.core.quantities import Bools, Floats
from seatrial.acquisition.core.ship import ENVIRONMENT, Actuators, control_names, is_circular, unwrap
from seatrial.analysis.manoeuvres.indices import Manoeuvre
from seatrial.analysis.manoeuvres.kinds import REMOVED, circle_indices, current_of, zigzag_indices
from seatrial.analysis.manoeuvres.measures import APPROACH_S, half_width_s, smooth_motion
from seatrial.analysis.manoeuvres.motion import Motion, motion_of
from seatrial.analysis.manoeuvres.runs import acceleration_indices, drift_indices, stopping_indices
from seatrial.analysis.manoeuvres.turning_tests import pull_out_indices
from seatrial.analysis.tables.table import NANO, require, table_actuators, times_ns
from seatrial.hybrid.prediction.prediction_windows import mean_controls
from seatrial.hybrid.vessel.actuators import control_units
from seatrial.hybrid.vessel.channels import STATE_UNITS, WIND_UNITS, check_ship
from seatrial.hybrid.vessel.plant import Plant
from seatrial.hybrid.vessel.simulate import range_error, simulate_batch

_BEFORE_S = 30.0
_HELD_FROM = 0.8  # of a run's time: what the controls are then, they are at its end

Indices = Mapping[str, float]
Water = tuple[float, float]
"""The velocity of the water, north and east [m/s]."""


@dataclass(frozen=True, slots=True)
class RecordedMotion:
    """The motion of a recording on its grid, with the ``controls`` [rows, controls] and the ``wind`` [rows, 2] of
    its rows in SI; what was not recorded is zero."""

    motion: Motion
    controls: Floats
    wind: Floats
    actuators: Actuators

    def seconds(self, time: pd.Timestamp) -> float:
        """A time on the clock of the motion [s]."""
        return float((pd.Timestamp(time).value - self.motion.origin_ns) / NANO)


def recorded_motion(table: pd.DataFrame, plant: Plant) -> RecordedMotion:
    """The motion in a table of samples of the ship that ``plant`` is a model of.

    Raises :class:`InputError` for a ship with other actuators, or without position, heading or controls.
    """
    actuators = table_actuators(table)
    check_ship(actuators, plant)
    require(table, tuple(channel.name for each in actuators if each.drives for channel in each.channels))
    motion = motion_of(table, plant.length_between_perpendiculars_m)
    at_ns = motion.origin_ns + np.round(motion.time_s * NANO)
    controls = np.column_stack([_column(table, name, at_ns) for name in control_names(actuators)])
    direction, speed = (_column(table, name, at_ns) for name in ENVIRONMENT)
    wind = np.column_stack([direction, speed]) * WIND_UNITS
    return RecordedMotion(motion, controls * control_units(actuators), wind, actuators)


def _column(table: pd.DataFrame, name: str, at_ns: Floats) -> Floats:
    """A channel at other times, angles the shorter way round; zero where it was not recorded."""
    samples = table[name].dropna() if name in table else pd.Series(dtype=float)
    if samples.empty:
        return np.zeros(at_ns.size)
    values = samples.to_numpy(dtype=float)
    return np.interp(at_ns, times_ns(samples.to_frame()), unwrap(values) if is_circular(name) else values)


def replay(
    recorded: RecordedMotion, run: Manoeuvre, plant: Plant, until: Callable[[Motion], Bools] | None = None
) -> Motion:
    """The motion of ``plant`` through a recorded run, after the measured motion before its order.

    With ``until`` it ends at the first row after the order of which that is true, and the controls at the end of
    the run are held for as long again, for a model that takes more time; where none is true, it ends after that.
    Raises :class:`ModelRangeError` where the model leaves its range before, :class:`DataShortageError` where
    nothing was recorded before the order.
    """
    measured, step_s = recorded.motion, recorded.motion.step_s
    start, end = recorded.seconds(run.start), recorded.seconds(run.end)
    first, last = (int(np.searchsorted(measured.time_s, time - 1e-6)) for time in (start, end))
    before = _before(measured, first, (end - start) / (2.0 * (len(run.executes) + 1)))
    settings, wind = recorded.controls[first : last + 1], recorded.wind[first : last + 1]
    controls, wind = mean_controls(settings[np.newaxis], recorded.actuators)[0], wind[:-1]
    if until is not None:
        controls, wind = _held_on(controls, int(_HELD_FROM * len(controls))), _held_on(wind, len(wind) - 1)
    state = _state_at_end(before) * STATE_UNITS
    runs = simulate_batch(plant, state, controls, wind, step_s)
    left = int(runs.left_at[0])
    made = runs.states[0, 1 : None if left < 0 else left + 1]
    motion = _joined(before, made / STATE_UNITS)
    reached = np.flatnonzero(until(motion) & (motion.time_s > start)) if until is not None else np.array([])
    if not reached.size and left >= 0:
        raise range_error(runs, plant, step_s)
    return motion.rows(0, int(reached[0]) + 1) if reached.size else motion


def _held_on(values: Floats, row: int) -> Floats:
    """Rows of values with that of a row held from there on, for as long again as all of them."""
    return np.concatenate([values[:row], np.tile(values[row], (2 * len(values) - row, 1))])


_COLUMNS = ("north_m", "east_m", "heading_deg", "surge_mps", "sway_mps", "yaw_rate_dps")


def _before(measured: Motion, first: int, scale_s: float) -> Motion:
    """The motion up to a row, smoothed by what came before it alone: what came after answers the order."""
    order_s = float(measured.time_s[first])
    part = measured.around(order_s, order_s, _BEFORE_S)
    part = part.rows(0, int(np.searchsorted(part.time_s, order_s - 1e-6)) + 1)
    if part.time_s.size < 3:
        raise DataShortageError("nothing was recorded before the order")
    return smooth_motion(part, half_width_s(part, scale_s))


def _state_at_end(before: Motion) -> Floats:
    """The state [6] at the last row, in channels' units: speeds and heading by lines through the approach.

    A parabola's end has more than twice the variance of a line's.
    """
    part = before.between(float(before.time_s[-1]) - APPROACH_S, float(before.time_s[-1]))
    ends = [np.polyfit(part.time_s - part.time_s[-1], getattr(part, name), 1)[-1] for name in _COLUMNS[2:]]
    return np.array([before.north_m[-1], before.east_m[-1], *ends])


def _joined(before: Motion, after: Floats) -> Motion:
    """A motion with rows [rows, 6] in the units of the channels appended, without what the indices do not need."""
    columns: dict[str, Any] = {
        name: np.append(getattr(before, name), after[:, i]) for i, name in enumerate(_COLUMNS)
    }
    rows = before.time_s.size + len(after)
    nothing, everywhere = np.zeros(rows), np.ones(rows, dtype=bool)
    return replace(
        before, time_s=before.time_s[0] + before.step_s * np.arange(rows), helm_deg=nothing,
        thrust=nothing, drives={}, tunnels={}, known=everywhere, broken=~everywhere, helm_order_deg=None, **columns,
    )  # fmt: skip


def replayed_indices(recorded: RecordedMotion, run: Manoeuvre, plant: Plant) -> Indices:
    """The indices of a recorded run as ``plant`` replays it.

    The run is of one of :data:`REPLAYED_KINDS`. Errors as :func:`replay`; :class:`DataShortageError` where the
    model does not do what the ship did.
    """
    return _MEASURES[run.kind](recorded, run, plant)


def _circle(recorded: RecordedMotion, run: Manoeuvre, plant: Plant) -> Indices:
    """Until the model has turned as far as the ship did, if it does."""
    start, motion = recorded.seconds(run.start), _whole_circle(recorded, run, plant)
    found = circle_indices(motion, np.array([start, motion.time_s[-1]]))
    if any(name.endswith(REMOVED) for name in run.indices) and not any(name.endswith(REMOVED) for name in found):
        turned_deg = abs(motion.heading_deg[-1] - motion.at("heading_deg", start))
        raise DataShortageError(
            f"in twice the time the model turns by {turned_deg:.0f} deg, too little to remove the current"
        )
    return found


def _whole_circle(recorded: RecordedMotion, run: Manoeuvre, plant: Plant) -> Motion:
    def turned(motion: Motion) -> Bools:
        off_deg = motion.heading_deg - motion.at("heading_deg", recorded.seconds(run.start))
        return np.asarray(run.sign * off_deg >= run.settings["turned_deg"])

    return replay(recorded, run, plant, turned)


def _zigzag(recorded: RecordedMotion, run: Manoeuvre, plant: Plant) -> Indices:
    orders = np.array([recorded.seconds(time) for time in (run.start, *run.executes, run.end)])
    halves = orders + run.settings.get("half_command_s", 0.0)
    halves[-1] = orders[-1]
    return zigzag_indices(replay(recorded, run, plant), np.array([orders, halves]))


def _stop(recorded: RecordedMotion, run: Manoeuvre, plant: Plant) -> Indices:
    """Until the model is as slow as the ship was at the end."""
    motion = replay(recorded, run, plant, lambda motion: motion.surge_mps <= final_speed_mps(run))
    if motion.surge_mps[-1] > final_speed_mps(run):
        raise DataShortageError("the model does not stop in twice the time of the ship")
    return stopping_indices(motion, np.array([recorded.seconds(run.start), motion.time_s[-1]]))


def final_speed_mps(run: Manoeuvre) -> float:
    """The speed at the end of a stop: none where the ship came to rest."""
    return max(0.0, run.indices["final_speed_mps"].value) if "final_speed_mps" in run.indices else 0.0


def _by(measure: Callable[[Motion, Floats], Indices]) -> Callable[..., Indices]:
    """The indices by a function of a motion and the times of its order and end."""

    def indices(recorded: RecordedMotion, run: Manoeuvre, plant: Plant) -> Indices:
        times = np.array([recorded.seconds(run.start), recorded.seconds(run.end)])
        found = measure(replay(recorded, run, plant), times)
        if not found:
            raise DataShortageError("the rate of turn of the model does not settle in the time of the run")
        return found

    return indices


_MEASURES: dict[str, Callable[..., Indices]] = {
    "turning_circle": _circle, "zigzag": _zigzag, "stopping": _stop, "pull_out": _by(pull_out_indices),
    "acceleration": _by(acceleration_indices), "thruster_test": _by(drift_indices), "crabbing": _by(drift_indices),
}  # fmt: skip
REPLAYED_KINDS = tuple(_MEASURES)
"""The kinds of manoeuvre that can be replayed."""


def with_water(plant: Plant, water: Water) -> Plant:
    """The plant in water that moves so."""
    return plant.replaced(current_north_mps=water[0], current_east_mps=water[1])


def water_in(recorded: RecordedMotion, circle: Manoeuvre, plant: Plant) -> Water | None:
    """The current in a turning circle by its drift, less what the wind adds to that by the model itself.

    None where the drift is not known, or the model cannot replay the circle.
    """
    if circle.current is None:
        return None
    drift = circle.current.north_mps, circle.current.east_mps
    motion = _whole_circle(recorded, circle, with_water(plant, (0.0, 0.0)))
    leeway = current_of(motion, recorded.seconds(circle.start), float(motion.time_s[-1]))
    return drift if leeway is None else (drift[0] - leeway.north_mps, drift[1] - leeway.east_mps)


def at_order(run: Manoeuvre, water: Water | None) -> float:
    """The speed through the water in the approach of a run [m/s]: over ground where the current is not known."""
    over_ground = run.settings["approach_mps"]
    if water is None:
        return over_ground
    heading = np.deg2rad(run.settings["approach_heading_deg"])
    return float(over_ground - water[0] * np.cos(heading) - water[1] * np.sin(heading))
