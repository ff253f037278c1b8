"""The standard indices beside a fit: measured, simulated before and after, replayed, predicted with intervals.

What a ship is asked for is where it turns and stops, and no error over some seconds says that. So the manoeuvres
found in recordings are made by the model as it was and by the fitted one: the same test on the same approach speed,
rudder rate and side, and the recorded helm replayed, which tells the steering gear from the hull
(:mod:`.manoeuvre_indices`). The standard manoeuvres that were not sailed are predicted.

The 95 % interval of a prediction has two parts. The covariance of the coefficients goes through the manoeuvre along
its principal axes, one standard deviation to either side of each. What the form of the model lacks shows in
manoeuvres that took no part in a fit, or where few numbers were fitted to all of them in these: the relative errors
of their indices beyond what coefficients and measurement explain, by family of index. Of a family of which none was
sailed, such as stopping, the coefficients that the vessel file calls estimated are as uncertain as it says.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import exp, hypot, inf, isfinite, log, nan, sqrt
from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import t as student_t

from seatrial.acquisition.core.errors import Progress, SeatrialError
from seatrial.acquisition.core.quantities import Floats
from seatrial.analysis.manoeuvres.find import find_manoeuvres
from seatrial.analysis.manoeuvres.indices import Index, Manoeuvre, unit_in_name
from seatrial.analysis.manoeuvres.kinds import REMOVED
from seatrial.hybrid.effects import vessel_plant, without_effects_of_day
from seatrial.hybrid.evaluation import manoeuvre_indices as comparisons
from seatrial.hybrid.prediction.baselines import Interval
from seatrial.hybrid.simulation import vessel_check
from seatrial.hybrid.simulation.index_table import NAMES, FormErrors, IndexTable, PredictedIndex, family_of
from seatrial.hybrid.vessel.files import Vessel

NORMAL_95 = 1.959964
_INITIAL_TURN_HELD_DEG = 9.0
"""The turn until which the helm has to be held for the way to the first 10 deg: ships turn the last degree while
the helm still swings to amidships, and sparse records tell the moment of a reversal no better."""

_FEWEST_ERRORS = 2  # of a family, from which a form error can be estimated: else those of all families are taken

_STEP_ERROR = 0.0015
"""The relative standard error of a simulated overshoot, since the helm is put over at a step of the simulation:
0.02 to 0.25 % by ship and helm about a smooth curve over a coefficient; that of other indices is below 0.03 %."""

Values = Mapping[Any, float]
"""Indices by name or by :data:`Key`."""

Key = tuple[str, str, str]
"""The test, the side, and the name of an index."""

Test = Callable[[Vessel], Values]


@dataclass(frozen=True, slots=True)
class UncertainVessel:
    """A vessel by unknowns z [P] with a covariance [P, P]: ``vessel_at`` makes the vessel of any z."""

    vessel_at: Callable[[Floats], Vessel]
    z: Floats
    covariance: Floats

    @property
    def vessel(self) -> Vessel:
        """The vessel at the estimate."""
        return self.vessel_at(self.z)

    def pairs(self) -> Iterator[tuple[Vessel, Vessel]]:
        """The vessels one standard deviation to either side, along each principal axis."""
        variances, axes = np.linalg.eigh(self.covariance)
        for step in (axes * np.sqrt(np.maximum(variances, 0.0))).T:
            yield self.vessel_at(self.z - step), self.vessel_at(self.z + step)


def certain_vessel(vessel: Vessel) -> UncertainVessel:
    """A vessel whose coefficients are taken as exact."""
    return UncertainVessel(lambda _: vessel, np.zeros(0), np.zeros((0, 0)))


def uncertain_effects(vessel: Vessel, sizes: Mapping[str, Mapping[str, Interval]]) -> UncertainVessel:
    """A vessel with effects of given sizes and 95 % intervals, by effect and parameter, taken as independent."""
    entries = [(effect, name, size) for effect, values in sizes.items() for name, size in values.items()]

    def vessel_at(z: Floats) -> Vessel:
        effects = {name: dict(values) for name, values in vessel.effects.items()}
        for (effect, name, size), deviation in zip(entries, z, strict=True):
            error = (size.high - size.low) / (2.0 * NORMAL_95)
            change = float(deviation) * error if isfinite(error) else 0.0
            effects.setdefault(effect, {})[name] = size.value + change
        return replace(vessel, effects=effects)

    return UncertainVessel(vessel_at, np.zeros(len(entries)), np.eye(len(entries)))


@dataclass(frozen=True, slots=True)
class HeldOut:
    """Tables of samples by recording, and the vessel fitted without them."""

    tables: Mapping[str, pd.DataFrame]
    vessel: UncertainVessel


def index_table(
    tables: Mapping[str, pd.DataFrame],
    before: Vessel,
    after: UncertainVessel,
    folds: Sequence[HeldOut] = (),
    rpm: float | None = None,
    currents: Mapping[str, comparisons.Water] | None = None,
    estimates: UncertainVessel | None = None,
    progress: Progress = lambda share: None,
) -> IndexTable:
    """The standard indices of two models beside those measured in recordings.

    Parameters
    ----------
    tables
        Tables of samples by recording, in which manoeuvres are looked for; none for a model alone.
    before, after
        The model as it was, and the fitted one with its covariance.
    rpm
        The shaft speed of the standard manoeuvres, if they are not made at the approach speed of recordings.
    folds
        Recordings with the model fitted without them, from which the error of the form is estimated; without
        them it is estimated from the ``tables``.
    currents
        By recording the current that was fitted to it, for the runs of one in which no circle shows it; by default
        that of the models themselves. A current taken for drift through the water turns a replayed ship.
    estimates
        The fitted model with the errors that its file states of coefficients that were not fitted; they count where
        no index of the family was measured.

    Returns
    -------
    IndexTable
        A row an index of :data:`.FAMILIES`: those of the manoeuvres found, in the order of recordings, then those
        of the standard manoeuvres that were not sailed.
    """
    currents = currents or {}
    unseen = unseen_rows(folds or [HeldOut(tables, after)], currents)
    runs = [pair for name, table in tables.items() for pair in _runs_of(table, after.vessel, currents.get(name))]
    form = form_errors(unseen, at_least_shown=not folds)
    held_out = {(row.start, row.name): row.held_out for row, _ in unseen if folds}
    pairs = list(after.pairs())
    rows = list[PredictedIndex]()
    for number, (run, tests) in enumerate(runs):
        progress(number / (len(runs) + 1))
        for row in _sailed_rows(run, tests, before, after.vessel, pairs, form):
            rows.append(replace(row, held_out=held_out.get((row.start, row.name))))
    speeds = [run.settings["approach_mps"] for run, _ in runs if "approach_mps" in run.settings]
    speed_mps = float(np.median(speeds)) if speeds else None
    sailed = {(row.test, row.side) for row in rows if row.predicted is not None}
    standard = partial(standard_indices, speed_mps=speed_mps, rpm=rpm)
    start, values = _indices_reached(standard, before), _indices_reached(standard, after.vessel)
    errors = relative_errors(standard, values, pairs)
    if estimates is not None and any(family_of(name) not in form for _, _, name in values):
        stated = relative_errors(standard, values, estimates.pairs())
        errors = {
            key: error if family_of(key[2]) in form else hypot(error, stated[key]) for key, error in errors.items()
        }
    for key, value in values.items():
        test, side, index = key
        if (test, side) not in sailed:
            predicted = index_with_interval(index, value, errors[key], form) if key in errors else None
            rows.append(PredictedIndex(test, side, index, before=start.get(key), after=value, predicted=predicted))
    return IndexTable(tuple(rows), form, speed_mps)


@dataclass(frozen=True, slots=True)
class RunTests:
    """What a model does to be compared with a recorded run: the same ``test`` again, and its helm replayed."""

    test: Test
    replay: Test


def _runs_of(
    table: pd.DataFrame, vessel: Vessel, current: comparisons.Water | None
) -> Iterator[tuple[Manoeuvre, RunTests]]:
    """The manoeuvres of a table of samples, with how a model makes each in the ``current``, or in what a circle
    shows of it; none where none can be looked for."""
    plant = vessel_plant(vessel)
    length_m = plant.length_between_perpendiculars_m
    try:
        runs = [comparisons.keep_comparable_indices(run) for run in find_manoeuvres(table, length_m)]
    except SeatrialError:
        return
    recorded, currents = comparisons.motion_and_currents(table, runs, plant)
    if isinstance(recorded, SeatrialError):
        return
    for run in runs:
        if run.kind not in comparisons.REPLAYED_KINDS or not _indices_of(run):
            continue
        _, water = min(currents, key=lambda dated: abs(dated[0] - run.start), default=(run.start, current))

        def test(vessel: Vessel, run: Manoeuvre = run, water: comparisons.Water | None = water) -> Values:
            model = comparisons.JudgedModel(vessel_plant(vessel), vessel)
            return comparisons.predicted_indices(recorded, run, model, water)

        def replayed(vessel: Vessel, run: Manoeuvre = run, water: comparisons.Water | None = water) -> Values:
            plant = vessel_plant(vessel)
            model = plant if water is None else comparisons.add_current(plant, water)
            values = comparisons.replayed_indices(recorded, run, model)
            return {name: values.get(name + REMOVED * (name + REMOVED in run.indices), nan) for name in values}

        # a run that did not begin as a test does has no indices of one
        yield run, RunTests(test if _is_steady(run, length_m) else lambda vessel: {}, replayed)


def _is_steady(run: Manoeuvre, length_m: float) -> bool:
    """Whether the ship went straight before the order, as in a standard test."""
    if run.kind not in comparisons.PREDICTED_KINDS or "approach_mps" not in run.settings:
        return False
    circling_dps = float(np.rad2deg(run.settings["approach_mps"] / length_m))
    return abs(run.settings.get("approach_yaw_rate_dps", 0.0)) <= vessel_check.STEADY_SHARE * circling_dps


def _indices_of(run: Manoeuvre) -> dict[str, Index]:
    """The measured indices of the table, the current removed where it is known; the way to the first 10 deg of turn
    only where the helm was held as long."""
    reversed_early = run.settings.get("switch_deg", inf) < _INITIAL_TURN_HELD_DEG
    return {
        name: index for name, index in comparisons.measured_indices(run).items()
        if name in NAMES and not (reversed_early and name == "initial_turning_m")
    }  # fmt: skip


def _indices_reached(test: Test, vessel: Vessel) -> Values:
    """The indices of a test that were reached; none where the vessel cannot make it."""
    try:
        return {name: value for name, value in test(vessel).items() if isfinite(value)}
    except SeatrialError:
        return {}


def predicted_by_test(test: Test, vessel: UncertainVessel, form: FormErrors) -> dict[str, Index]:
    """The positive indices of a test with their 95 % intervals; none where the vessel cannot make it."""
    values = _indices_reached(test, vessel.vessel)
    errors = relative_errors(test, values, vessel.pairs())
    return {
        name: index_with_interval(name, values[name], error, form)
        for name, error in errors.items()
        if name in NAMES
    }


def relative_errors(test: Test, values: Values, pairs: Iterable[tuple[Vessel, Vessel]]) -> Values:
    """The standard error of each positive index of a test, as a share of it, by the ``pairs`` of vessels at either
    side of the estimate. Where one of a pair cannot make the test the other counts."""
    variance = {name: 0.0 for name, value in values.items() if value > 0.0}
    for pair in pairs:
        sides = [_indices_reached(test, vessel) for vessel in pair]
        for name in variance:
            ends = [log(side[name] / values[name]) for side in sides if side.get(name, 0.0) > 0.0]
            change = 0.5 * (ends[1] - ends[0]) if len(ends) == 2 else (ends[0] if ends else 0.0)
            variance[name] += change**2
    return {name: sqrt(squares) for name, squares in variance.items()}


def form_errors(unseen: Sequence[tuple[PredictedIndex, float]], *, at_least_shown: bool = False) -> FormErrors:
    """The relative error that the form of a model makes, by family and of all (``""``).

    ``unseen`` are indices of held-out runs, each with the relative standard error that coefficients and measurement
    explain. ``at_least_shown``: no smaller than what these runs could have shown, the standard error of the mean of
    their indices; a few coarse measurements that agree show no exact form.
    """
    squares: dict[str, list[tuple[float, float]]] = {}
    for row, explained in unseen:
        if row.measured is None or not row.held_out or row.held_out <= 0.0 or row.measured.value <= 0.0:
            continue
        for family in (family_of(row.name), ""):
            squares.setdefault(family, []).append((log(row.held_out / row.measured.value) ** 2, explained**2))
    errors = {}
    for family, values in squares.items():
        total, explained = np.mean(values, axis=0).tolist()
        least = explained / len(values) if at_least_shown else 0.0
        errors[family] = sqrt(max(total - explained, least)), len(values)
    return errors


def index_with_interval(name: str, value: float, relative_error: float, form: FormErrors) -> Index:
    """The 95 % interval of a predicted index, a factor to either side; NaN where no error is known."""
    form_error, count = form.get(family_of(name), (0.0, 0))
    if count < _FEWEST_ERRORS:
        form_error, count = form.get("", (0.0, 0))
    if not relative_error and not count:
        return Index(value, nan, nan, unit_in_name(name))
    estimation = NORMAL_95 * hypot(relative_error, _STEP_ERROR * (family_of(name) == "overshoot"))
    reach = exp(hypot(estimation, float(student_t.ppf(0.975, max(count, 1))) * form_error))
    return Index(value, value / reach, value * reach, unit_in_name(name))


def unseen_rows(
    folds: Iterable[HeldOut], currents: Mapping[str, comparisons.Water]
) -> list[tuple[PredictedIndex, float]]:
    """The measured indices of held-out tables beside those of the models fitted without them, and the relative
    standard error that coefficients and measurement explain."""
    return [row for fold in folds for row in _fold_rows(fold, currents)]


def _fold_rows(fold: HeldOut, currents: Mapping[str, comparisons.Water]) -> Iterator[tuple[PredictedIndex, float]]:
    pairs, vessel = list(fold.vessel.pairs()), fold.vessel.vessel
    for name, table in fold.tables.items():
        for run, tests in _runs_of(table, vessel, currents.get(name)):
            replayed, tested = _indices_reached(tests.replay, vessel), _indices_reached(tests.test, vessel)
            test, values = (tests.replay, replayed) if replayed else (tests.test, tested)
            explained = relative_errors(test, {name: values[name] for name in _indices_of(run) if name in values},
                                        pairs)  # fmt: skip
            for index, measured in _indices_of(run).items():
                if index in explained:
                    row = PredictedIndex(
                        run.name, run.side, index, measured, held_out=values[index], start=run.start
                    )
                    width = 2.0 * NORMAL_95 * abs(measured.value)
                    error = (measured.high - measured.low) / width if width else 0.0  # relative
                    yield row, float(np.hypot(explained[index], error if isfinite(error) else 0.0))


def _sailed_rows(
    run: Manoeuvre, tests: RunTests, before: Vessel, after: Vessel, pairs: Sequence[tuple[Vessel, Vessel]],
    form: FormErrors,
) -> Iterator[PredictedIndex]:  # fmt: skip
    """The rows of a recorded run."""
    tested_before, tested = _indices_reached(tests.test, before), _indices_reached(tests.test, after)
    replayed_before, replayed = _indices_reached(tests.replay, before), _indices_reached(tests.replay, after)
    errors = relative_errors(tests.test, tested, pairs)
    for name, measured in _indices_of(run).items():
        predicted = index_with_interval(name, tested[name], errors[name], form) if name in errors else None
        yield PredictedIndex(
            run.name, run.side, name, measured, tested_before.get(name), tested.get(name), predicted,
            replayed_before.get(name), replayed.get(name), start=run.start,
        )  # fmt: skip


def standard_indices(
    vessel: Vessel, speed_mps: float | None = None, rpm: float | None = None
) -> Mapping[Key, float]:
    """The indices of the standard manoeuvres that a vessel can make in still water, whatever the water, the waves
    and the wind of a trial that its effects are of; speeds as in :func:`.ship_for_trials`."""
    ship = vessel_check.ship_for_trials(without_effects_of_day(vessel), speed_mps, rpm)
    return {
        (test.run.name, test.run.side, name): index.value
        for test in vessel_check.make_trials(vessel_check.standard_trials(ship), {})
        for name, index in test.indices.items() if name in NAMES
    }  # fmt: skip
