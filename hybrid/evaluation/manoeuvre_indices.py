"""The manoeuvres of a recording as a model makes them: measured beside simulated indices, with their difference.

A model is judged in two forms. *Predicted*: the same test, as before a trial, in still air at the approach speed,
helm, helm rate, side and switching angle of the recorded one: what a yard asks of a model. *Replayed*: the recorded
controls and wind from the state at the order. What lies before the order stays as it was measured, so that the same
functions find the same indices, approach and all, in the measured run and in the simulated one.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from itertools import product
from math import inf, isfinite, nan
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from seatrial.acquisition.core.errors import DataShortageError, Progress, SeatrialError
from seatrial.acquisition.core.quantities import Bools, Floats, rotate_earth_to_ship
from seatrial.acquisition.core.ship import ENVIRONMENT, Actuators, control_names, is_circular, unwrap
from seatrial.acquisition.recording.reader import read_parts_of_recording
from seatrial.analysis.manoeuvres import find, kinds, measures, straight_runs
from seatrial.analysis.manoeuvres.indices import Index, Manoeuvre
from seatrial.analysis.manoeuvres.motion import Motion, motion_of
from seatrial.analysis.quality.repairs import Preparation, prepare_table
from seatrial.analysis.tables.table import NANO, require, select, table_actuators, times_ns, trial_of
from seatrial.analysis.windows.held import named_recordings
from seatrial.hybrid.calibrators.predict import Predictor
from seatrial.hybrid.prediction.window_sets import mean_controls
from seatrial.hybrid.simulation import vessel_check
from seatrial.hybrid.simulation.manoeuvres import handling_of, steer
from seatrial.hybrid.vessel import dynamics, files, sensors
from seatrial.hybrid.vessel.actuators import control_units
from seatrial.hybrid.vessel.black_box import BlackBox, MotionModel
from seatrial.hybrid.vessel.plant import Plant

LOG = logging.getLogger("seatrial")
PREDICTED, REPLAYED = "predicted", "replayed"
APPROACH_RPM = "approach_rpm"
"""The mean shaft speed in the approach, as an index."""
PREDICTED_KINDS = ("turning_circle", "zigzag", "stopping", "pull_out", "speed_run")
"""The kinds of manoeuvre that can be predicted."""
JUDGED = {
    **vessel_check.TEST_INDICES,
    "acceleration": ("final_speed_mps", "time_to_90_percent_s", "distance_to_90_percent_m"),
    "thruster_test": ("surge_mps", "sway_mps", "heading_change_deg", "last_yaw_rate_dps"),
    "crabbing": ("sway_mps", "way_to_starboard_m", "heading_change_deg"),
    "speed_run": ("speed_through_water_mps",),
}
"""The indices that a model is judged by, by the kind of manoeuvre."""
_ABOUT_ZERO = {
    "lateral_deviation_m",
    "heading_change_deg",
    "residual_yaw_rate_dps",
    "sway_mps",
    "way_to_starboard_m",
}
_FIXED = {"period_s", "turning_yaw_rate_dps"}  # of a replay, by the recorded orders and by the state at the order
_NO_SHAFTS = ("thrust_rpm", "thrust_before_rpm", "turning_rpm")
_COLUMNS = ("north_m", "east_m", "heading_deg", "surge_mps", "sway_mps", "yaw_rate_dps")
_BEFORE_S = 30.0
_HELD_FROM = 0.8  # of a run's time: what the controls are then, they are at its end
_IDLE_SHARE = 0.08  # of the shaft speed before a stop: below it the shafts stand, as in finding one
_LEAST_TURN_DEG, _SETTLING_LENGTHS, _SAME_HELM = 185.0, 20.0, 1.05
_DRAUGHT_SHARE, _DEEP_DRAUGHTS = 0.05, 4.0  # as MSC/Circ.1053 and MSC.137(76) bound full load and deep water

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


def recorded_motion(table: pd.DataFrame, plant: MotionModel) -> RecordedMotion:
    """The motion in a table of samples of the ship that ``plant`` is a model of.

    Raises :class:`InputError` for a ship with other actuators, or without position, heading or controls.
    """
    sensors.check_ship(table_actuators(table), plant)
    actuators = plant.layout
    require(
        table, tuple(channel.name for actuator in actuators if actuator.drives for channel in actuator.channels)
    )
    motion = motion_of(table, plant.length_between_perpendiculars_m)
    at_ns = motion.origin_ns + np.round(motion.time_s * NANO)

    def resampled(name: str) -> Floats:
        samples = table[name].dropna() if name in table else pd.Series(dtype=float)
        if samples.empty:
            return np.zeros(at_ns.size)
        values = samples.to_numpy(dtype=float)
        return np.interp(at_ns, times_ns(samples.to_frame()), unwrap(values) if is_circular(name) else values)

    controls = np.column_stack([resampled(name) for name in control_names(actuators)])
    wind = np.column_stack([resampled(name) for name in ENVIRONMENT]) * sensors.WIND_UNITS
    return RecordedMotion(motion, controls * control_units(actuators), wind, actuators)


def replay_run(
    recorded: RecordedMotion, run: Manoeuvre, plant: MotionModel, has_ended: Callable[[Motion], Bools] | None = None
) -> Motion:
    """The motion of ``plant`` through a recorded run, after the measured motion before its order.

    With ``has_ended`` it ends at the first row after the order of which that is true, and the controls at the end
    of the run are held for as long again, for a model that takes more time; where none is true, it ends after that.
    Raises :class:`ModelRangeError` where the model leaves its range before, :class:`DataShortageError` where
    nothing was recorded before the order.
    """
    measured, step_s = recorded.motion, recorded.motion.step_s
    start, end = recorded.seconds(run.start), recorded.seconds(run.end)
    first, last = (int(np.searchsorted(measured.time_s, time - 1e-6)) for time in (start, end))
    # Smoothed by the rows before the order alone: those after it answer it.
    order_s = float(measured.time_s[first])
    before = measured.around(order_s, order_s, _BEFORE_S)
    before = before.rows(0, int(np.searchsorted(before.time_s, order_s - 1e-6)) + 1)
    if before.time_s.size < 3:
        raise DataShortageError("nothing was recorded before the order")
    approach = measures.smooth_motion(
        before, measures.smoothing_half_width_s(before, (end - start) / (2.0 * (len(run.executes) + 1)))
    )
    settings, wind = recorded.controls[first : last + 1], recorded.wind[first : last + 1]
    controls, wind = mean_controls(settings[np.newaxis], recorded.actuators)[0], wind[:-1]
    if has_ended is not None:
        controls, wind = (
            _hold_last_row(controls, int(_HELD_FROM * len(controls))),
            _hold_last_row(wind, len(wind) - 1),
        )
    # Speeds and heading by lines through the approach: a parabola's end has more than twice a line's variance.
    part = approach.between(float(approach.time_s[-1]) - measures.APPROACH_S, float(approach.time_s[-1]))
    ends = [np.polyfit(part.time_s - part.time_s[-1], getattr(part, name), 1)[-1] for name in _COLUMNS[2:]]
    state = np.array([approach.north_m[-1], approach.east_m[-1], *ends]) * sensors.STATE_UNITS
    runs = dynamics.simulate_batch(plant, state, controls, wind, step_s)
    range_exit = int(runs.left_at[0])
    simulated = runs.states[0, 1 : None if range_exit < 0 else range_exit + 1] / sensors.STATE_UNITS
    # The indices need no helm, thrust and orders.
    rows = approach.time_s.size + len(simulated)
    zeros, all_rows = np.zeros(rows), np.ones(rows, dtype=bool)
    columns: dict[str, Any] = {
        name: np.append(getattr(approach, name), simulated[:, i]) for i, name in enumerate(_COLUMNS)
    }
    motion = replace(
        approach, time_s=approach.time_s[0] + approach.step_s * np.arange(rows), helm_deg=zeros, thrust=zeros,
        drives={}, tunnels={}, measured=all_rows, broken=~all_rows, helm_order_deg=None, **columns,
    )  # fmt: skip
    reached = np.flatnonzero(has_ended(motion) & (motion.time_s > start)) if has_ended is not None else np.array([])
    if not reached.size and range_exit >= 0:
        raise dynamics.range_error(runs, plant, step_s)
    return motion.rows(0, int(reached[0]) + 1) if reached.size else motion


def _hold_last_row(values: Floats, row: int) -> Floats:
    """Rows of values with that of a row held from there on, for as long again as all of them."""
    return np.concatenate([values[:row], np.tile(values[row], (2 * len(values) - row, 1))])


def _replay_circle(recorded: RecordedMotion, run: Manoeuvre, plant: MotionModel) -> Motion:
    def turned(motion: Motion) -> Bools:
        turned_deg = motion.heading_deg - motion.at("heading_deg", recorded.seconds(run.start))
        return np.asarray(run.sign * turned_deg >= run.settings["turned_deg"])

    return replay_run(recorded, run, plant, turned)


def final_speed_mps(run: Manoeuvre) -> float:
    """The speed at the end of a stop: none where the ship came to rest."""
    return max(0.0, run.indices["final_speed_mps"].value) if "final_speed_mps" in run.indices else 0.0


_MEASURES: dict[str, Callable[[Motion, Floats], Indices]] = {
    "pull_out": kinds.pull_out_indices,
    "acceleration": straight_runs.acceleration_indices,
    "thruster_test": straight_runs.drift_indices,
    "crabbing": straight_runs.drift_indices,
}
REPLAYED_KINDS = ("turning_circle", "zigzag", "stopping", *_MEASURES)
"""The kinds of manoeuvre that can be replayed."""


def replayed_indices(recorded: RecordedMotion, run: Manoeuvre, plant: MotionModel) -> Indices:
    """The indices of a recorded run as ``plant`` replays it: a circle until the model has turned as far as the ship
    did, a stop until it is as slow as the ship was at the end.

    Errors as :func:`replay_run`; :class:`DataShortageError` where the model does not do what the ship did.
    """
    start, end = recorded.seconds(run.start), recorded.seconds(run.end)
    if run.kind == "turning_circle":
        motion = _replay_circle(recorded, run, plant)
        indices = kinds.circle_indices(motion, np.array([start, motion.time_s[-1]]))
        removed = [any(name.endswith(kinds.REMOVED) for name in names) for names in (run.indices, indices)]
        if removed == [True, False]:
            turned_deg = abs(motion.heading_deg[-1] - motion.at("heading_deg", start))
            raise DataShortageError(
                f"in twice the time the model turns by {turned_deg:.0f} deg, too little to remove the current"
            )
        return indices
    if run.kind == "zigzag":
        orders = np.array([start, *map(recorded.seconds, run.executes), end])
        halves = orders + run.settings.get("half_command_s", 0.0)
        halves[-1] = orders[-1]
        return kinds.zigzag_indices(replay_run(recorded, run, plant), np.array([orders, halves]))
    if run.kind == "stopping":
        motion = replay_run(recorded, run, plant, lambda motion: motion.surge_mps <= final_speed_mps(run))
        if motion.surge_mps[-1] > final_speed_mps(run):
            raise DataShortageError("the model does not stop in twice the time of the ship")
        return straight_runs.stopping_indices(motion, np.array([start, motion.time_s[-1]]))
    values = _MEASURES[run.kind](replay_run(recorded, run, plant), np.array([start, end]))
    if not values:
        raise DataShortageError("the rate of turn of the model does not settle in the time of the run")
    return values


def add_current(plant: MotionModel, water: Water) -> MotionModel:
    """The model in water that moves so."""
    return plant.replaced(current_north_mps=water[0], current_east_mps=water[1])


@dataclass(frozen=True, slots=True)
class JudgedModel:
    """A model to be judged: its plant, and the vessel file with its autopilot and drives.

    Without a plant it makes no manoeuvre, without a vessel file it is replayed only; ``why`` says so.
    """

    plant: MotionModel | None
    vessel: files.Vessel | None
    why: str = ""


def predicted_indices(
    recorded: RecordedMotion, run: Manoeuvre, model: JudgedModel, water: Water | None
) -> Mapping[str, float]:
    """The indices of the test that a run was, made by a model in still air, and in the ``water`` of the run or
    its own.

    Where the current is removed from the indices of the run, in still water at its speed through the water. Raises
    :class:`DataShortageError` for a test that the model cannot make, :class:`ModelRangeError` where it leaves its
    range.
    """
    if model.plant is None or model.vessel is None or isinstance(model.plant, BlackBox):
        raise DataShortageError(model.why)
    if run.kind == "speed_run":
        ship = _set_recorded_rpm(_trial_ship_in_water(model.vessel, model.plant, (0.0, 0.0)), run)
        motion, _ = vessel_check.sail_legs(ship, (steer(0.0, inf, ship.rpm),), _SETTLING_LENGTHS)
        return {
            "speed_through_water_mps": measures.approach_state(motion, float(motion.time_s[-1]))["approach_mps"]
        }
    if recorded.motion.at("surge_mps", recorded.seconds(run.start)) <= 0.0:
        raise DataShortageError("the approach was not ahead")
    if "approach_mps" not in run.settings:
        raise DataShortageError("it has no approach whose speed the model could have")
    # at that speed the model's shaft would turn too slowly for all of the test
    if run.kind == "zigzag" and kinds.gathers_way(run.indices):
        raise DataShortageError(f"{kinds.GATHERING_WAY}: its approach is no steady one that the model could have")
    if measures.SHAFTS_CHANGED in run.notes:
        raise DataShortageError(f"{measures.SHAFTS_CHANGED}, and in the same test they would")
    speed_mps, current = run.settings["approach_mps"], (0.0, 0.0)
    if any(name.endswith(kinds.REMOVED) for name in run.indices):
        if water is not None:  # else over ground
            heading = np.deg2rad(run.settings["approach_heading_deg"])
            speed_mps = float(speed_mps - water[0] * np.cos(heading) - water[1] * np.sin(heading))
    else:
        plant_water = model.plant.current_north_mps, model.plant.current_east_mps
        heading = np.deg2rad(run.settings["approach_heading_deg"])  # to the north in a simulated test
        ahead, starboard = rotate_earth_to_ship(*(plant_water if water is None else water), heading)
        current = float(ahead), float(starboard)
    ship, motion = _trial_ship_in_water(model.vessel, model.plant, current), recorded.motion
    if run.helm_deg is not None and not motion.orders_are_events:
        part = motion.around(recorded.seconds(run.start), recorded.seconds(run.end), 2.0 * motion.step_s)
        rate_dps = measures.helm_rate_dps(part.helm_deg, part.step_s)
        steers = handling_of(model.vessel).steering_angles & isfinite(rate_dps)
        rate = np.where(steers, np.deg2rad(rate_dps), ship.drives.rate)
        ship = replace(ship, drives=ship.drives._replace(rate=rate))
    if run.kind == "pull_out":  # its speed is that in the turn before, which is no approach
        return _indices_of_same_test(_set_recorded_rpm(ship, run), run)
    ship, handling = vessel_check.approach_at_speed(ship, speed_mps), handling_of(model.vessel)
    rpm_index = {APPROACH_RPM: ship.rpm * float(handling.ahead[handling.main].mean())}
    return rpm_index | _indices_of_same_test(ship, run)


def _trial_ship_in_water(vessel: files.Vessel, plant: Plant, water: Water) -> vessel_check.TrialShip:
    """A ship in water that moves so, without waves."""
    moved = plant.replaced(current_north_mps=water[0], current_east_mps=water[1], drift_force_n=0.0)
    return replace(vessel_check.trial_ship_at_rpm(vessel, 0.0), plant=moved)


def _indices_of_same_test(ship: vessel_check.TrialShip, run: Manoeuvre) -> dict[str, float]:
    """The indices of the same test as a run; in a stop the shafts are ordered to the same fraction of their speed
    before. Raises :class:`DataShortageError` for a helm that was not recorded or is too large."""
    if run.kind == "stopping":
        share = run.settings["thrust_rpm"] / run.settings["thrust_before_rpm"]
        rpm = ship.rpm * share * (abs(share) > _IDLE_SHARE)
        test = vessel_check.stopping_test(ship, rpm, final_speed_mps(run), run.name)
        return {name: index.value for name, index in test.indices.items()}
    if not handling_of(ship.vessel).steering_angles.any():
        raise DataShortageError("the model is steered by the difference of its shafts, which has no angle of helm")
    if run.helm_deg is None:
        raise DataShortageError("the recording tells no angle of the helm")
    helm_deg, limit_deg = abs(run.helm_deg), vessel_check.largest_helm_deg(ship)
    if helm_deg > _SAME_HELM * limit_deg:
        raise DataShortageError(
            f"the helm of {helm_deg:.0f} deg is beyond the model's limit of {limit_deg:.0f} deg"
        )
    if run.kind == "pull_out":
        test = vessel_check.pull_out_test(ship, run.sign, helm_deg)
    elif run.kind == "turning_circle":
        turn_deg = max(run.settings["turned_deg"], _LEAST_TURN_DEG)
        test = vessel_check.turning_circle_test(ship, run.sign, helm_deg, turn_deg)
    else:
        switch_deg, swings = run.settings["switch_deg"], int(run.settings["swings"])
        test = vessel_check.zigzag_test(ship, run.sign, helm_deg, switch_deg, swings)
    return {name: index.value for name, index in test.indices.items()}


def _set_recorded_rpm(ship: vessel_check.TrialShip, run: Manoeuvre) -> vessel_check.TrialShip:
    """The ship at the mean shaft speed of a run."""
    names, handling = control_names(ship.vessel.actuators), handling_of(ship.vessel)
    rpm = []
    for i in np.flatnonzero(handling.main):  # of a controllable propeller what it would turn at full pitch
        keys = (names[i], f"{names[i].removesuffix('_rpm')}_at_full_pitch_rpm")
        recorded = [run.settings[key] for key in keys if key in run.settings]
        if not recorded:
            raise DataShortageError(f"{names[i]} was not recorded")
        rpm.append(recorded[0] / handling.ahead[i])
    return vessel_check.without_shaft_limit(replace(ship, rpm=float(np.mean(rpm))))


@dataclass(frozen=True, slots=True)
class SimulatedIndex:
    """A simulated value of an index, beside the measured one; ``about_zero`` are those that vanish by design."""

    value: float
    measured: Index
    about_zero: bool = False

    @property
    def difference(self) -> float:
        """Simulated less measured, in the index's unit."""
        return self.value - self.measured.value

    @property
    def percent(self) -> float | None:
        """The difference in percent of the measured value; None of one that cannot be distinguished from zero."""
        value, within = self.measured.value, 0.5 * (self.measured.high - self.measured.low)
        return None if self.about_zero or abs(value) <= within else 100.0 * self.difference / abs(value)

    @property
    def within(self) -> bool | None:
        """Whether the value lies in the measured 95 % interval; None where that is not known."""
        if not isfinite(self.measured.low + self.measured.high):
            return None
        return bool(self.measured.low <= self.value <= self.measured.high)

    def as_json(self) -> dict[str, Any]:
        """With the keys of the contract; a simulated value has no interval."""
        return {"value": self.value, "low": None, "high": None, "difference": self.difference,
                "percent": self.percent, "within": self.within}  # fmt: skip


@dataclass(frozen=True, slots=True)
class IndexComparison:
    """An index of a recorded manoeuvre beside the same of the model ``method``, in either form that could be made.

    ``current_removed`` says that the current is removed from the measured value and from the replayed one.
    """

    test: str
    side: str
    start: pd.Timestamp
    name: str
    method: str
    measured: Index
    predicted: SimulatedIndex | None = None
    replayed: SimulatedIndex | None = None
    current_removed: bool = False

    def as_json(self) -> dict[str, Any]:
        """With the keys of the contract; null for a form that could not be made."""
        measured = {name: value if isfinite(value := getattr(self.measured, name)) else None
                    for name in ("value", "low", "high")}  # fmt: skip
        return {
            "test": self.test, "side": self.side, "start": self.start.isoformat(), "name": self.name,
            "unit": self.measured.unit, "method": self.method, "current_removed": self.current_removed,
            "measured": measured, PREDICTED: self.predicted.as_json() if self.predicted else None,
            REPLAYED: self.replayed.as_json() if self.replayed else None,
        }  # fmt: skip


@dataclass(frozen=True, slots=True)
class NotSimulated:
    """A recorded manoeuvre that a model did not make in one of the forms, and why."""

    test: str
    side: str
    start: pd.Timestamp
    method: str
    form: str
    why: str


@dataclass(frozen=True, slots=True)
class IndexComparisons:
    """All indices compared, what could not be, and what of ship and water the model does not know."""

    rows: tuple[IndexComparison, ...] = ()
    left_out: tuple[NotSimulated, ...] = ()
    remarks: tuple[str, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """``indices``, a row each, ``indices_left_out`` and ``indices_remarks``."""
        return {
            "indices": [row.as_json() for row in self.rows],
            "indices_left_out": [asdict(entry) | {"start": entry.start.isoformat()} for entry in self.left_out],
            "indices_remarks": list(self.remarks),
        }


def models_of_predictor(predictor: Predictor) -> dict[str, JudgedModel]:
    """The reference model and, of a calibrator, the hybrid, by the names that a validation gives them."""
    why = "" if predictor.ship else "the vessel file of the calibrator's model is not at hand"
    if isinstance(predictor.plant, BlackBox):
        why = "a simulator is replayed only: its drives and its handling are not those of a vessel file"
    models = {"reference": JudgedModel(predictor.plant, predictor.ship, why)}
    if predictor.trained is not None:
        calibrator = predictor.trained.calibrator
        plant = calibrator.adapted_model()
        unable = f"the calibrator {calibrator.method} corrects tracks of {predictor.trained.horizon_s} s"
        models["hybrid"] = JudgedModel(plant, predictor.ship, why if plant else f"{unable} and is no model to sail")
    return models


def index_comparison(
    recordings: Iterable[tuple[pd.DataFrame, Sequence[Manoeuvre]]], predictor: Predictor
) -> IndexComparisons:
    """The measured indices of recordings beside those of a model.

    Parameters
    ----------
    recordings
        The table of samples of each recording, raw or resampled, and the manoeuvres found in it.
    predictor
        The reference model, or the calibrator on it (:func:`.choose_predictor`).

    Returns
    -------
    IndexComparisons
        A row an index and model in the order of time; which manoeuvres were not simulated, and why; and remarks.
    """
    rows, left_out, remarks = list[IndexComparison](), list[NotSimulated](), list[str]()
    for table, manoeuvres in recordings:
        runs = [keep_comparable_indices(run) for run in manoeuvres if measured_indices(run)]
        if not runs:
            continue
        remarks += _remarks_on_comparison(table, predictor)
        recorded, currents = motion_and_currents(table, runs, predictor.plant)
        for run, (method, model) in product(runs, models_of_predictor(predictor).items()):
            _, water = min(currents, key=lambda dated: abs(dated[0] - run.start), default=(run.start, None))
            values = dict[str, Mapping[str, float]]()
            for form, comparable in ((PREDICTED, PREDICTED_KINDS), (REPLAYED, REPLAYED_KINDS)):
                if run.kind not in comparable:
                    continue
                try:
                    values[form] = _simulated_indices(recorded, run, model, water, form)
                except SeatrialError as error:
                    why = f"{error.what}{': ' * bool(error.why)}{error.why}"
                    left_out.append(NotSimulated(run.name, run.side, run.start, method, form, why))
            for name, measured in measured_indices(run).items():
                removed = name + kinds.REMOVED in run.indices
                simulated = {
                    form: SimulatedIndex(float(form_values[key]), measured, name in _ABOUT_ZERO)
                    for form, form_values in values.items()
                    if not (form == REPLAYED and name in _FIXED)
                    and isfinite(form_values.get(key := name + kinds.REMOVED * (removed and form == REPLAYED), nan))
                }
                if simulated:
                    forms = simulated.get(PREDICTED), simulated.get(REPLAYED)
                    rows.append(
                        IndexComparison(run.name, run.side, run.start, name, method, measured, *forms, removed)
                    )
    return IndexComparisons(tuple(rows), tuple(left_out), tuple(dict.fromkeys(remarks)))


def motion_and_currents(
    table: pd.DataFrame, runs: Sequence[Manoeuvre], plant: MotionModel
) -> tuple[RecordedMotion | SeatrialError, list[tuple[pd.Timestamp, Water]]]:
    """The motion of a recording, or why there is none, and the current by the time of each circle that shows it.

    The current is the drift in the circle, less what the wind adds to that by the reference ``plant`` itself; none
    where the drift is not known, or the model cannot replay the circle.
    """
    try:
        recorded = recorded_motion(table, plant)
    except SeatrialError as error:
        return error, []
    currents = list[tuple[pd.Timestamp, Water]]()
    for run in runs:
        if run.current is None:
            continue
        with suppress(SeatrialError):
            motion = _replay_circle(recorded, run, add_current(plant, (0.0, 0.0)))
            leeway = kinds.current_from_turn(motion, recorded.seconds(run.start), float(motion.time_s[-1]))
            north, east = run.current.north_mps, run.current.east_mps
            current = (north, east) if leeway is None else (north - leeway.north_mps, east - leeway.east_mps)
            currents.append((run.start, current))
    return recorded, currents


def _simulated_indices(
    recorded: RecordedMotion | SeatrialError, run: Manoeuvre, model: JudgedModel, water: Water | None, form: str
) -> Mapping[str, float]:
    """The indices of a run by a model in one of the forms. Raises :class:`SeatrialError` where it cannot."""
    if isinstance(recorded, SeatrialError):
        raise recorded
    if model.plant is None:
        raise DataShortageError(model.why)
    if form == REPLAYED:
        return replayed_indices(recorded, run, model.plant if water is None else add_current(model.plant, water))
    return predicted_indices(recorded, run, model, water)


def runs_of_recordings(
    paths: Sequence[Path],
    length_m: float,
    time_range: tuple[float, float] = (0.0, 100.0),
    progress: Progress = lambda share: None,
    *,
    repair: bool = False,
    rebuild_positions: bool = False,
) -> Iterator[tuple[pd.DataFrame, Sequence[Manoeuvre]]]:
    """The table of each recording, or of a part of its time, and the manoeuvres in it.

    A recording in which none can be looked for, as it has no helm or is too long for one table, is left out with a
    warning. ``repair`` and ``rebuild_positions`` are those of :func:`.tables_of_recordings`.
    """
    recordings = named_recordings(paths)
    for number, (name, parts) in enumerate(recordings.items()):
        progress(number / len(recordings))
        try:
            recording = read_parts_of_recording(parts)
            repaired = prepare_table(recording, Preparation(None, repair), rebuild_positions=rebuild_positions)
            table = select(repaired, time_range)
            runs = find.find_manoeuvres(table, length_m, recording.events)
        except SeatrialError as error:
            LOG.warning("%s: its manoeuvres are not compared: %s", name, error)
            continue
        yield table, runs


def keep_comparable_indices(run: Manoeuvre) -> Manoeuvre:
    """A run with the indices that its model has as well: with the current removed only where the run shows it."""
    if kinds.shows_current(run):
        return run
    indices = {name: index for name, index in run.indices.items() if not name.endswith(kinds.REMOVED)}
    return replace(run, current=None, indices=indices)


def measured_indices(run: Manoeuvre) -> dict[str, Index]:
    """The indices of a run that a model is judged by, the current removed where it is known; with them the shaft
    speed of the approach, which is what the speed takes."""
    names = [name for name in JUDGED.get(run.kind, ()) if name in run.indices]
    shafts = [value for name, value in run.settings.items() if name.endswith("_rpm") and name not in _NO_SHAFTS]
    rpm_index = {APPROACH_RPM: Index(float(np.mean(shafts)), nan, nan, "rpm")} if names and shafts else {}
    return rpm_index | {name: run.indices.get(name + kinds.REMOVED, run.indices[name]) for name in names}


def _remarks_on_comparison(table: pd.DataFrame, predictor: Predictor) -> list[str]:
    """What differs between ship and water of a recording and those of the model, which is sailed as it is."""
    trial, plant, ship = trial_of(table), predictor.plant, predictor.ship
    remarks = list[str]()
    if plant.draught_m is None:
        return remarks
    if trial.draught_m and abs(trial.draught_m / plant.draught_m - 1.0) > _DRAUGHT_SHARE:
        remarks.append(f"sailed at a draught of {trial.draught_m:g} m; the model is of {plant.draught_m:g} m")
    states_depth = ship is not None and any("depth_m" in values for values in ship.effects.values())
    if trial.water_depth_m and trial.water_depth_m < _DEEP_DRAUGHTS * plant.draught_m and not states_depth:
        remarks.append(f"sailed in {trial.water_depth_m:g} m of water; the model states no depth")
    return remarks
