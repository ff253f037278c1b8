"""The manoeuvres of a recording as a model makes them: measured beside simulated indices, with their difference.

A model is judged in two forms. *Predicted*: the same test in still air, at the approach speed, helm, helm
rate, side and switching angle of the recorded one (:mod:`seatrial.hybrid.evaluation.predicted_tests`): what a yard
asks of a model. *Replayed*: the recorded controls and wind from the state at the order
(:mod:`seatrial.hybrid.evaluation.recorded_runs`). Both are measured by the functions that measure the recording.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import product
from math import isfinite, nan
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from seatrial.acquisition.core.errors import DataShortageError, SeatrialError
from seatrial.acquisition.recording.grouping import read_parts
from seatrial.analysis.manoeuvres.find import find_manoeuvres
from seatrial.analysis.manoeuvres.indices import Index, Manoeuvre
from seatrial.analysis.manoeuvres.kinds import REMOVED, shows_current
from seatrial.analysis.quality.repairs import Preparation, prepare
from seatrial.analysis.tables.table import select, trial_of
from seatrial.analysis.windows.held import named_recordings
from seatrial.hybrid.calibrators.predict import Predictor
from seatrial.hybrid.evaluation.predicted_tests import APPROACH_RPM, PREDICTED_KINDS, JudgedModel, predicted_indices
from seatrial.hybrid.evaluation.recorded_runs import (
    REPLAYED_KINDS,
    RecordedMotion,
    Water,
    recorded_motion,
    replayed_indices,
    water_in,
    with_water,
)
from seatrial.hybrid.simulation.standard_tests import SHOWN
from seatrial.hybrid.vessel.plant import Plant

LOG = logging.getLogger("seatrial")
JUDGED = {
    **SHOWN,
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
PREDICTED, REPLAYED = "predicted", "replayed"
_KINDS = {PREDICTED: PREDICTED_KINDS, REPLAYED: REPLAYED_KINDS}
_GIVEN = {"period_s", "turning_yaw_rate_dps"}  # of a replay, by the recorded orders and by the state at the order
_NO_SHAFTS = ("thrust_rpm", "thrust_before_rpm", "turning_rpm")
_DRAUGHT_SHARE, _DEEP_DRAUGHTS = 0.05, 4.0  # as MSC/Circ.1053 and MSC.137(76) bound full load and deep water


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
        """The difference in percent of the measured value; None of one that cannot be told from zero."""
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

    def as_json(self) -> dict[str, Any]:
        """With the time as text."""
        return {"test": self.test, "side": self.side, "start": self.start.isoformat(), "method": self.method,
                "form": self.form, "why": self.why}  # fmt: skip


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
            "indices_left_out": [each.as_json() for each in self.left_out],
            "indices_remarks": list(self.remarks),
        }


def models_of(predictor: Predictor) -> dict[str, JudgedModel]:
    """The reference model and, of a calibrator, the hybrid, by the names that a validation gives them."""
    why = "" if predictor.ship else "the vessel file of the calibrator's model is not at hand"
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
        The reference model, or the calibrator on it (:func:`.predictor_of`).

    Returns
    -------
    IndexComparisons
        A row an index and model in the order of time; which manoeuvres were not simulated, and why; and remarks.
    """
    rows, left_out, remarks = list[IndexComparison](), list[NotSimulated](), list[str]()
    for table, found in recordings:
        runs = [_over_ground(run) for run in found if _measured(run)]
        if not runs:
            continue
        remarks += _remarks(table, predictor)
        trial = _Trial.of(table, runs, predictor.plant)
        for run, (method, model) in product(runs, models_of(predictor).items()):
            values = dict[str, Mapping[str, float]]()
            for form in (each for each, kinds in _KINDS.items() if run.kind in kinds):
                try:
                    values[form] = trial.simulated(run, model, form)
                except SeatrialError as error:
                    why = f"{error.what}{': ' * bool(error.why)}{error.why}"
                    left_out.append(NotSimulated(run.name, run.side, run.start, method, form, why))
            rows += _rows(run, method, values)
    return IndexComparisons(tuple(rows), tuple(left_out), tuple(dict.fromkeys(remarks)))


def runs_of_recordings(
    paths: Sequence[Path],
    length_m: float,
    part_percent: tuple[float, float] = (0.0, 100.0),
    *,
    repair: bool = False,
    rebuild_positions: bool = False,
) -> Iterator[tuple[pd.DataFrame, Sequence[Manoeuvre]]]:
    """The table of each recording, or of a part of its time, and the manoeuvres in it.

    A recording in which none can be looked for, as it has no helm or is too long for one table, is left out with a
    warning. ``repair`` and ``rebuild_positions`` are those of :func:`.tables_of_recordings`.
    """
    for name, parts in named_recordings(paths).items():
        try:
            recording = read_parts(parts)
            whole = prepare(recording, Preparation(None, repair), rebuild_positions=rebuild_positions)
            table = select(whole, part_percent)
            runs = find_manoeuvres(table, length_m, recording.events)
        except SeatrialError as error:
            LOG.warning("%s: its manoeuvres are not compared: %s", name, error)
            continue
        yield table, runs


def _over_ground(run: Manoeuvre) -> Manoeuvre:
    """A run with the indices that its model has as well: with the current removed only where the run shows it."""
    if shows_current(run):
        return run
    indices = {name: index for name, index in run.indices.items() if not name.endswith(REMOVED)}
    return replace(run, current=None, indices=indices)


def _measured(run: Manoeuvre) -> dict[str, Index]:
    """The indices of a run that a model is judged by, the current removed where it is known; with them the shaft
    speed of the approach, which is what the speed takes."""
    names = [name for name in JUDGED.get(run.kind, ()) if name in run.indices]
    shafts = [value for name, value in run.settings.items() if name.endswith("_rpm") and name not in _NO_SHAFTS]
    takes = {APPROACH_RPM: Index(float(np.mean(shafts)), nan, nan, "rpm")} if names and shafts else {}
    return takes | {name: run.indices.get(name + REMOVED, run.indices[name]) for name in names}


def _rows(run: Manoeuvre, method: str, values: Mapping[str, Mapping[str, float]]) -> list[IndexComparison]:
    """A row for each index that one of the forms has."""
    rows = []
    for name, measured in _measured(run).items():
        removed = name + REMOVED in run.indices
        simulated = {
            form: SimulatedIndex(float(found[place]), measured, name in _ABOUT_ZERO)
            for form, found in values.items()
            if not (form == REPLAYED and name in _GIVEN)
            and isfinite(found.get(place := name + REMOVED * (removed and form == REPLAYED), nan))
        }
        if simulated:
            rows.append(
                IndexComparison(run.name, run.side, run.start, name, method, measured, simulated.get(PREDICTED),
                                simulated.get(REPLAYED), removed)
            )  # fmt: skip
    return rows


@dataclass(frozen=True, slots=True)
class _Trial:
    """A recording to be simulated; ``water`` is the current by the time of each circle that shows it."""

    table: pd.DataFrame
    recorded: RecordedMotion | SeatrialError
    water: tuple[tuple[pd.Timestamp, Water], ...]

    @classmethod
    def of(cls, table: pd.DataFrame, runs: Sequence[Manoeuvre], plant: Plant) -> _Trial:
        """The recording of some runs, with the currents as the reference ``plant`` understands them."""
        try:
            recorded = recorded_motion(table, plant)
        except SeatrialError as error:
            return cls(table, error, ())
        water = list[tuple[pd.Timestamp, Water]]()
        for run in runs:
            with suppress(SeatrialError):
                if (found := water_in(recorded, run, plant)) is not None:
                    water.append((run.start, found))
        return cls(table, recorded, tuple(water))

    def simulated(self, run: Manoeuvre, model: JudgedModel, form: str) -> Mapping[str, float]:
        """The indices of a run by a model in one of the forms. Raises :class:`SeatrialError` where it cannot."""
        if isinstance(self.recorded, SeatrialError):
            raise self.recorded
        if model.plant is None:
            raise DataShortageError(model.why)
        water = min(self.water, key=lambda each: abs(each[0] - run.start), default=(run.start, None))[1]
        if form == REPLAYED:
            plant = model.plant if water is None else with_water(model.plant, water)
            return replayed_indices(self.recorded, run, plant)
        return predicted_indices(self.recorded, run, model, water)


def _remarks(table: pd.DataFrame, predictor: Predictor) -> list[str]:
    """What differs between ship and water of a recording and those of the model, which is sailed as it is."""
    trial, plant, ship = trial_of(table), predictor.plant, predictor.ship
    remarks = []
    if trial.draught_m and abs(trial.draught_m / plant.draught_m - 1.0) > _DRAUGHT_SHARE:
        remarks.append(f"sailed at a draught of {trial.draught_m:g} m; the model is of {plant.draught_m:g} m")
    states_depth = ship is not None and any("depth_m" in values for values in ship.effects.values())
    if trial.water_depth_m and trial.water_depth_m < _DEEP_DRAUGHTS * plant.draught_m and not states_depth:
        remarks.append(f"sailed in {trial.water_depth_m:g} m of water; the model states no depth")
    return remarks
