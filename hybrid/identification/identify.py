"""``seatrial identify``: coefficients from recordings, their validation, and the vessel file with them.

They are tested on held-out recordings: with three or more, each in turn, or each of some groups, is predicted
by the model fitted to the others; with fewer, the last third of each by the model fitted to what comes before.
The same folds choose how long a segment of the fit is: that with the least error of the held-out tracks over about
the time of a turning circle. On the towing-tank zigzags of a tanker, segments of 2.5 ship lengths give a circle
that is 4 % too long and 7 % too wide, those of 5 lengths one within 2 and 4 %.
Candidates for the next manoeuvre are simulated with the identified ship: their expected information is added to
the present one, and the best reduces the covariance most (D-optimality, Atkinson and Donev 1992).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from functools import partial
from typing import Any

import numpy as np
import pandas as pd
from threadpoolctl import threadpool_limits

from seatrial.acquisition.core import errors, result, trial
from seatrial.acquisition.core.quantities import Floats
from seatrial.acquisition.core.ship import names_of_kind, shafts
from seatrial.analysis.estimation.process_models import UNKNOWN, correlated_pairs
from seatrial.analysis.tables.resample import resample
from seatrial.analysis.tables.table import select
from seatrial.analysis.windows.held import second_by_second
from seatrial.hybrid.effects import vessel_plant
from seatrial.hybrid.effects.context import DeclaredContext
from seatrial.hybrid.evaluation.predicted_indices import HeldOut, UncertainVessel, index_table
from seatrial.hybrid.identification import fit
from seatrial.hybrid.identification.steering_gear import GearFit, fit_gear
from seatrial.hybrid.prediction import baselines, dataset, kalman_filter
from seatrial.hybrid.prediction.window_sets import PredictionWindows
from seatrial.hybrid.simulation.index_table import IndexTable
from seatrial.hybrid.simulation.manoeuvres import Manoeuvre
from seatrial.hybrid.simulation.trial import SimulationNoise, sea_state_named, simulate_trial
from seatrial.hybrid.vessel.files import Vessel
from seatrial.hybrid.vessel.plant import Plant

REPERTOIRE = ("zigzag_10_10", "zigzag_20_20", "turning_circle_15", "turning_circle_35", "speed_runs", "stopping",
              "reciprocal", "one_thruster", "tunnel_test")  # fmt: skip

SEGMENTS = 20
"""The length of each simulated candidate, in segments."""

_NORMAL_95 = 1.959964
BY_RECORDING, MOST_FOLDS = 3, 4
LAST_THIRD = (200.0 / 3.0, 100.0)
_ROUNDS = 6
_STRIDE_S = 5
CIRCLE_LENGTHS, _SHORTEST_HORIZON_S = 20.0, 2.0
"""The time of a turning circle, in ship lengths at the approach speed: some 10 lengths of way at half of it."""

Tables = Mapping[str, pd.DataFrame]
Divisions = Sequence[tuple[Tables, Tables]]


@dataclass(frozen=True, slots=True)
class ManoeuvreInformation:
    """A manoeuvre of ``minutes``: its expected information in nats, the mean share of the variances that it
    would leave, and the coefficients that it would newly determine."""

    manoeuvre: str
    minutes: float
    gain: float
    left: float
    newly_known: tuple[str, ...]


def possible_manoeuvres(vessel: Vessel) -> tuple[str, ...]:
    """The manoeuvres that a ship can make."""
    able = {
        "one_thruster": len(shafts(vessel.actuators)) > 1,
        "tunnel_test": bool(names_of_kind(vessel.actuators, "tunnel")),
    }
    return tuple(name for name in REPERTOIRE if able.get(name, True))


def rank_trials(
    model: fit.ResponseModel, fitted: fit.CoefficientFit, names: Sequence[str]
) -> list[ManoeuvreInformation]:
    """The expected information of each manoeuvre beside the present one, the best first, without those that the
    ship cannot make."""
    ranked, duration_s = [], SEGMENTS * model.segments.duration_s
    for name in names:
        with suppress(errors.SeatrialError):
            ranked.append(expected_information(model, fitted, name, name, duration_s))
    return sorted(ranked, key=lambda candidate: -candidate.gain)


def expected_information(
    model: fit.ResponseModel, fitted: fit.CoefficientFit, name: str, manoeuvre: Manoeuvre | str, duration_s: float
) -> ManoeuvreInformation:
    """What a simulated manoeuvre of ``duration_s`` would tell beside the present fit.

    Raises :class:`SeatrialError` where the ship cannot make it, or leaves the range of its model.
    """
    count = len(model.coefficients)
    prior = fitted.covariance[:count, :count]
    posterior = np.linalg.inv(np.linalg.inv(prior) + information_of(model, fitted, manoeuvre, duration_s))
    prior_error, posterior_error = np.sqrt(np.diag(prior)), np.sqrt(np.diag(posterior))
    standard_errors = zip(model.coefficients, prior_error, posterior_error, strict=True)
    return ManoeuvreInformation(
        name, duration_s / 60.0,
        gain=0.5 * float(np.linalg.slogdet(prior)[1] - np.linalg.slogdet(posterior)[1]),
        left=float(np.mean((posterior_error / prior_error) ** 2)),
        newly_known=tuple(coefficient.name for coefficient, a, b in standard_errors if a >= UNKNOWN > b),
    )  # fmt: skip


def information_of(
    model: fit.ResponseModel, fitted: fit.CoefficientFit, manoeuvre: Manoeuvre | str, duration_s: float
) -> Floats:
    """The information of a simulated manoeuvre on the coefficients [P, P], its own surroundings unknown.

    Raises :class:`SeatrialError` where the ship cannot make it, or leaves the range of its model.
    """
    ship, lasting = model.vessel_at(fitted.z), model.segments.duration_s
    silent, rate_hz = SimulationNoise().scaled(0.0), 1.0 / model.segments.dt_s
    table, _ = simulate_trial(
        ship, sea_state_named("calm"), manoeuvre, duration_s + 0.5 * lasting, rate_hz, noise=silent
    )
    rehearsed = fit.segments_of({"rehearsed": table}, vessel_plant(ship), lasting)
    model_there, z = model.on_segments(rehearsed, fitted.z)
    count, place = len(model.coefficients), model_there.search_point(z, rehearsed.start, fitted.levels)
    inside = np.isfinite(place.cost)
    information = fit.normal_equations(model_there, place)[0].sum(axis=0) if inside else np.full(1, np.nan)
    if not np.isfinite(information).all():
        raise errors.ModelRangeError("the simulated manoeuvre leaves the model's range")
    around = information[count:, count:] + np.eye(model_there.size - count)
    return np.asarray(
        information[:count, :count]
        - information[:count, count:] @ np.linalg.solve(around, information[count:, :count])
    )


@dataclass(frozen=True, slots=True)
class CoefficientEstimate(baselines.Interval):
    """A coefficient: its value with the 95 % interval, its initial value with the prior interval, and whether
    the data determine it.

    ``share`` is the standard error in units of the prior's; ``tied`` are names of the same coefficient
    elsewhere.
    """

    name: str
    start: float
    start_low: float
    start_high: float
    share: float
    tied: tuple[str, ...] = ()

    @property
    def known(self) -> bool:
        """Whether the data determine it beyond the prior."""
        return self.share < UNKNOWN


@dataclass(frozen=True, slots=True)
class SegmentError:
    """The mean distance of held-out tracks by the fit with segments of ``segment_s``."""

    segment_s: float
    distance_m: float


@dataclass(frozen=True, slots=True)
class Judgement:
    """Errors of predictions on held-out data: scores by method on a number of windows."""

    horizon_s: int
    windows: int
    scores: Mapping[str, baselines.Score]
    held_out: str

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        counted = {"horizon_s": self.horizon_s, "windows": self.windows, "held_out": self.held_out}
        return {**counted, "methods": baselines.scores_json(self.scores)}


@dataclass(frozen=True, slots=True, repr=False)
class Identification(result.ModelResult):
    """A vessel with coefficients from trials.

    ``correlation`` [P, P] is that of the ``coefficients`` in their order; ``surroundings`` are current and
    sensor errors by recording, in SI; ``segments_tried`` are the lengths of segments from which that with the least
    error on held-out tables was chosen; ``indices`` are those of manoeuvres, measured and predicted; ``gear`` is
    how the angles follow their orders; ``candidates`` are further trials, the most informative first;
    ``set_aside`` lists parts of the recordings not used; ``context`` is what was known beforehand; ``tracks`` are
    measured and simulated, for a figure of the fit.
    """

    vessel: Vessel
    coefficients: tuple[CoefficientEstimate, ...]
    correlation: Floats
    surroundings: Mapping[str, Mapping[str, float]]
    segments: int
    duration_s: float
    left_out: int
    validation: Judgement | None = None
    segments_tried: tuple[SegmentError, ...] = ()
    indices: IndexTable = field(default_factory=IndexTable)
    gear: tuple[GearFit, ...] = ()
    candidates: tuple[ManoeuvreInformation, ...] = ()
    file: str = ""
    set_aside: tuple[str, ...] = ()
    context: DeclaredContext = field(default_factory=DeclaredContext)
    tracks: tuple[Floats, Floats] = field(default=(np.zeros((0, 0, 2)), np.zeros((0, 0, 2))), repr=False)
    view = "seatrial.hybrid.report.plots:identification_view"
    frame = "coefficients"
    drawing = "seatrial.hybrid.report.plots:draw_identification"
    size_inch = (11.0, 8.0)

    @property
    def currents(self) -> dict[str, tuple[float, float]]:
        """The current of each recording, north and east [m/s]."""
        return {
            name: (around["current_north_mps"], around["current_east_mps"])
            for name, around in self.surroundings.items()
        }

    @property
    def inseparable_pairs(self) -> list[tuple[str, str, float]]:
        """Pairs of known coefficients that the data cannot separate, with their correlation."""
        indices = [number for number, coefficient in enumerate(self.coefficients) if coefficient.known]
        names = [self.coefficients[number].name for number in indices]
        return correlated_pairs(names, self.correlation[np.ix_(indices, indices)])

    def as_dict(self) -> dict[str, Any]:
        """The JSON object of ``seatrial identify --json``."""
        names = ("value", "low", "high", "start", "known")
        judged = self.validation
        return {
            **self.remarks,
            "vessel": self.file,
            "set_aside": list(self.set_aside),
            "context": result.to_json(self.context),
            "segments": self.segments,
            "segment_s": self.duration_s,
            "segments_tried": result.to_json(self.segments_tried),
            "coefficients": {
                name_or_tied: {name: getattr(estimate, name) for name in names}
                for estimate in self.coefficients
                for name_or_tied in (estimate.name, *estimate.tied)
            },
            "correlated": [list(pair) for pair in self.inseparable_pairs],
            "surroundings": {name: dict(values) for name, values in self.surroundings.items()},
            "validation": None if judged is None else judged.as_dict(),
            "steering_gear": result.to_json(self.gear),
            "indices": self.indices.as_json(),
            "next_manoeuvres": result.to_json(self.candidates),
        }


def identify_tables(
    tables: Mapping[str, pd.DataFrame],
    vessel: Vessel,
    *,
    only: Sequence[str] = (),
    candidates: Sequence[str] = (),
    segment_s: float | None = None,
    fixed: Collection[str] = (),
    progress: errors.Progress = lambda share: None,
) -> tuple[Identification, fit.CoefficientFit, fit.ResponseModel]:
    """The coefficients of ``vessel`` from tables of samples by recording, without validation.

    ``only`` names the unknown ones, by default all of :func:`.coefficients_of`; ``candidates`` are manoeuvres to
    rank; ``segment_s`` is the length of a segment, by default the shortest of :func:`.segment_durations_s`;
    ``fixed`` are surroundings that are not fitted. Raises :class:`DataShortageError`,
    :class:`InputError` for recordings of another ship, :class:`ModelRangeError` if the model cannot follow them.
    """
    with threadpool_limits(1, user_api="blas"):  # small matrices, for which threads do not pay
        vessel, gear = fit_gear(tables, vessel)
        model = _model_on(tables, vessel, segment_s, only, fixed)
        fitted = fit.fit(model, progress=progress)
    return replace(identification_of(model, fitted, candidates), gear=gear), fitted, model


def _model_on(
    tables: Tables, vessel: Vessel, segment_s: float | None, only: Sequence[str], fixed: Collection[str]
) -> fit.ResponseModel:
    """The model of a vessel on segments of tables. Raises as :func:`.segments_of`."""
    wanted = set(only)
    coefficients = [
        coefficient
        for coefficient in fit.coefficients_of(vessel)
        if not only or wanted & {coefficient.name, *coefficient.tied}
    ]
    return fit.model_of(vessel, coefficients, fit.segments_of(tables, vessel_plant(vessel), segment_s), fixed)


def identification_of(
    model: fit.ResponseModel, fitted: fit.CoefficientFit, candidates: Sequence[str] = ()
) -> Identification:
    """The result of a fit; ``candidates`` are manoeuvres to rank."""
    with threadpool_limits(1, user_api="blas"):
        ranked = rank_trials(model, fitted, candidates)
    count = len(model.coefficients)
    deviation = np.sqrt(np.diag(fitted.covariance))[:count]
    share = np.minimum(deviation, 1.0)
    estimates = []
    for coefficient, z, error in zip(model.coefficients, fitted.z[:count], share, strict=True):
        low, high = sorted(coefficient.value_at(z + side * _NORMAL_95 * error) for side in (-1.0, 1.0))
        start_low, start_high = sorted(coefficient.value_at(side * _NORMAL_95) for side in (-1.0, 1.0))
        estimates.append(CoefficientEstimate(
            coefficient.value_at(z), low, high, coefficient.name, coefficient.start, start_low, start_high,
            float(error), coefficient.tied,
        ))  # fmt: skip
    around, segments = model.surroundings_at(fitted.z), model.segments
    return Identification(
        vessel=identified_vessel(model, fitted.z, estimates),
        coefficients=tuple(estimates),
        correlation=fitted.covariance[:count, :count] / np.outer(deviation, deviation),
        surroundings={
            name: {
                surrounding.name: float(value)
                for surrounding, value in zip(model.surroundings, values, strict=True)
            }
            for name, values in zip(segments.names, around, strict=True)
        },
        segments=len(segments),
        duration_s=segments.duration_s,
        left_out=segments.left_out,
        candidates=tuple(ranked),
        tracks=(segments.measured[..., :2], model.readings_at(fitted.z, fitted.starts)[..., :2]),
    )


def identified_vessel(model: fit.ResponseModel, z: Floats, estimates: Sequence[CoefficientEstimate]) -> Vessel:
    """The vessel with the coefficients at ``z`` and their errors in ``estimated``."""
    vessel, standard_errors = model.vessel_at(z), dict(model.vessel.estimated)
    for coefficient, estimate in zip(model.coefficients, estimates, strict=True):
        if not coefficient.name.startswith("effects.") and estimate.value != 0.0:
            ratio = abs(coefficient.start / estimate.value) if not coefficient.keeps_sign else 1.0
            error = float(coefficient.width * estimate.share * ratio)
            standard_errors |= dict.fromkeys((coefficient.name, *coefficient.tied), error)
    origin = {
        "identified_from": ", ".join(model.segments.names),
        "identified_at": datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
        "identified_by": trial.software_version(),
        "identified_start": model.vessel.name,
    }
    return replace(vessel, estimated=standard_errors, provenance={**model.vessel.provenance, **origin})


@dataclass(frozen=True, slots=True)
class Fold:
    """Tables that are held out, by recording, and the ``model`` with the fit to the others."""

    tables: Tables
    model: fit.ResponseModel
    fitted: fit.CoefficientFit

    @property
    def vessel(self) -> Vessel:
        """The vessel fitted to the other tables."""
        return self.model.vessel_at(self.fitted.z)


@dataclass(frozen=True, slots=True)
class SegmentTrial:
    """A fit with segments of one length, its folds, and the held-out windows' mean distances [windows] in m."""

    model: fit.ResponseModel
    fitted: fit.CoefficientFit
    folds: tuple[Fold, ...]
    distance_m: Floats

    @property
    def duration_s(self) -> float:
        """The length of a segment [s]."""
        return self.model.segments.duration_s

    @property
    def held_out_vessels(self) -> tuple[HeldOut, ...]:
        """The held-out tables with the vessels that are fitted without them."""
        return tuple(HeldOut(fold.tables, uncertain_vessel(fold.model, fold.fitted)) for fold in self.folds)


def identify_with_folds(
    tables: Tables,
    vessel: Vessel,
    *,
    horizon_s: int,
    segment_s: float | None = None,
    fixed: Collection[str] = (),
    candidates: Sequence[str] = (),
    progress: errors.Progress = lambda share: None,
) -> tuple[Identification, SegmentTrial]:
    """The coefficients of ``vessel`` from the length of segments that predicts held-out tables best, validated.

    Parameters
    ----------
    tables
        Tables of samples by recording.
    vessel
        The initial model.
    horizon_s
        The horizon of the predictions for validation [s].
    segment_s
        The length of a segment [s], if it is not to be chosen from :func:`.segment_durations_s`.
    fixed
        Surroundings that are not fitted.
    candidates
        Manoeuvres to rank.

    Returns
    -------
    tuple of Identification and SegmentTrial
        The result, and the fit that it comes from with its folds.

    Raises
    ------
    DataShortageError
        For recordings that are too short, and :class:`InputError` for those of another ship.
    """
    before = vessel
    vessel, gear = fit_gear(tables, vessel)
    best, tried, held_out = fit_with_folds(tables, vessel, segment_s=segment_s, fixed=fixed, progress=progress)
    validation = judge(best.folds, horizon_s, held_out)
    identification = identification_of(best.model, best.fitted, candidates)
    indices = index_table(
        tables,
        before,
        uncertain_vessel(best.model, best.fitted),
        best.held_out_vessels,
        currents=identification.currents,
    )
    return replace(identification, validation=validation, segments_tried=tried, indices=indices, gear=gear), best


def fit_with_folds(
    tables: Tables,
    vessel: Vessel,
    *,
    segment_s: float | None = None,
    fixed: Collection[str] = (),
    progress: errors.Progress = lambda share: None,
) -> tuple[SegmentTrial, tuple[SegmentError, ...], str]:
    """The fit with the length of segments that predicts held-out tables best, the errors of all lengths that were
    tried, and what is held out. Parameters and errors are those of :func:`identify_with_folds`."""
    plant = vessel_plant(vessel)
    durations_s = [segment_s] if segment_s else fit.segment_durations_s(tables, plant)
    divisions, held_out = _fit_and_test_divisions(tables)
    starts = _long_windows(divisions, plant, fit.usual_speed_mps(tables)) if len(durations_s) > 1 else ()
    trials = list[SegmentTrial]()
    for number, duration_s in enumerate(durations_s):
        part = errors.subtask_progress(progress, number, len(durations_s))
        try:
            trials.append(_segment_trial(tables, vessel, duration_s, fixed, divisions, starts, trials[-1:], part))
        except (errors.DataShortageError, errors.ModelRangeError):
            if not trials and duration_s == durations_s[-1]:
                raise
    return (*_best_trial(trials), held_out)


def uncertain_vessel(model: fit.ResponseModel, fitted: fit.CoefficientFit) -> UncertainVessel:
    """The vessel of a fit with the covariance of its coefficients."""
    count = len(model.coefficients)
    return UncertainVessel(model.vessel_at, fitted.z[:count], fitted.covariance[:count, :count])


def _segment_trial(
    tables: Tables, vessel: Vessel, duration_s: float, fixed: Collection[str], divisions: Divisions,
    windows: Sequence[PredictionWindows | None], previous: Sequence[SegmentTrial], progress: errors.Progress,
) -> SegmentTrial:  # fmt: skip
    """The fit with segments of a length and its folds; it starts from the ``previous`` one, if any."""
    z, levels = (previous[0].fitted.z, previous[0].fitted.levels) if previous else (None, None)
    with threadpool_limits(1, user_api="blas"):
        model = _model_on(tables, vessel, duration_s, (), fixed)
        fitted = fit.fit(model, z, levels, progress=errors.subtask_progress(progress, 0, 2))
        folds = list[Fold]()
        for training, test in divisions:  # each fit starts from that to all tables
            segments = fit.segments_of(training, vessel_plant(model.vessel), model.segments.duration_s)
            refitted, z = model.on_segments(segments, fitted.z)
            folds.append(Fold(test, refitted, fit.fit(refitted, z, levels=fitted.levels, rounds=_ROUNDS)))
    distances = [
        baselines.distances(_predicted_tracks(fold.vessel, held), held.track).mean(axis=1)
        for fold, held in zip(folds, windows, strict=False)
        if held is not None
    ]
    progress(1.0)
    return SegmentTrial(model, fitted, tuple(folds), np.concatenate(distances) if distances else np.zeros(0))


def _best_trial(trials: Sequence[SegmentTrial]) -> tuple[SegmentTrial, tuple[SegmentError, ...]]:
    """The trial with the least mean distance over the windows that all its models predict, and those of all."""
    distance_m = np.array([trial.distance_m for trial in trials])
    inside = np.isfinite(distance_m).all(axis=0)
    if len(trials) == 1 or not inside.any():
        return trials[0], ()
    means_m = distance_m[:, inside].mean(axis=1).tolist()
    tried = tuple(SegmentError(trial.duration_s, mean_m) for trial, mean_m in zip(trials, means_m, strict=True))
    return trials[int(np.argmin(means_m))], tried


def _fit_and_test_divisions(tables: Tables) -> tuple[Divisions, str]:
    """The tables to fit and those to test on, and what the latter are."""
    names = list(tables)
    if len(names) < BY_RECORDING:
        first, last = (
            {name: select(table, part) for name, table in tables.items()}
            for part in ((0.0, LAST_THIRD[0]), LAST_THIRD)
        )
        return [(first, last)], "the last third of each recording"
    count = min(len(names), MOST_FOLDS)
    groups = [names[fold::count] for fold in range(count)]
    divisions = [
        (
            {name: table for name, table in tables.items() if name not in held},
            {name: tables[name] for name in held},
        )
        for held in groups
    ]
    return divisions, "each recording in turn" if count == len(names) else f"recordings in {count} groups"


def _held_out_windows(tables: Tables, horizon_s: int, length_m: float) -> PredictionWindows | None:
    """The windows of held-out tables under any commands; None without one."""
    even = {name: second_by_second(partial(resample, table)) for name, table in tables.items()}
    try:
        return dataset.dataset_of(even, horizon_s, _STRIDE_S, any_commands=True, length_m=length_m).windows
    except errors.DataShortageError:
        return None


def _long_windows(divisions: Divisions, plant: Plant, speed_mps: float) -> tuple[PredictionWindows | None, ...]:
    """Held-out windows over about the time of a circle, or half, a quarter ... of it, where none are so long."""
    length_m = plant.length_overall_m
    horizon_s = CIRCLE_LENGTHS * plant.length_between_perpendiculars_m / speed_mps
    while horizon_s >= _SHORTEST_HORIZON_S:
        windows = tuple(_held_out_windows(test, round(horizon_s), length_m) for _, test in divisions)
        if any(held is not None for held in windows):
            return windows
        horizon_s *= 0.5
    return (None,) * len(divisions)


def _predicted_tracks(vessel: Vessel, windows: PredictionWindows) -> Floats:
    """The tracks that a vessel predicts, NaN where it leaves the range of its model."""
    plant = vessel_plant(vessel)
    return baselines.simulate_reference(kalman_filter.filtered_starts(windows, plant), plant)


def judge(folds: Sequence[Fold], horizon_s: int, held_out: str) -> Judgement | None:
    """Errors of predictions of held-out tables over ``horizon_s`` under the recorded commands, in the windows in
    which both models stay in their range; None without one."""
    tracks: dict[str, list[Floats]] = {}
    for fold in folds:
        start = fold.model.vessel
        windows = _held_out_windows(fold.tables, horizon_s, start.dimensions.length_overall_m)
        if windows is None:
            continue
        methods = {
            "constant_velocity": baselines.constant_velocity(
                kalman_filter.filtered_starts(windows, vessel_plant(start))
            ),
            "reference": _predicted_tracks(start, windows),
            "identified": _predicted_tracks(fold.vessel, windows),
            "measured": windows.track,
        }
        inside = np.isfinite(np.stack(list(methods.values()))).all(axis=(0, 2, 3))
        for name, track in methods.items():
            tracks.setdefault(name, []).append(track[inside])
    together = {name: np.concatenate(parts) for name, parts in tracks.items()}
    if not together or not len(together["measured"]):
        return None
    measured = together.pop("measured")
    scores = {name: baselines.score(track, measured) for name, track in together.items()}
    return Judgement(horizon_s, len(measured), scores, held_out)


def indices_of_file(vessel: Vessel, rpm: float | None = None) -> IndexTable:
    """The standard manoeuvres of a vessel file, with 95 % intervals by the errors that it states of coefficients.

    ``rpm`` is the shaft speed of the tests, by default as in :func:`.check_vessel`.
    """
    return index_table({}, vessel, uncertain_estimates(vessel), rpm=rpm)


def uncertain_estimates(vessel: Vessel) -> UncertainVessel:
    """A vessel with the errors that its file states of coefficients; those without count as exact, and those with
    one as independent."""
    coefficients = [
        coefficient for coefficient in fit.coefficients_of(vessel) if coefficient.name in vessel.estimated
    ]

    def vessel_at(z: Floats) -> Vessel:
        return fit.with_values(vessel, fit.values_at(coefficients, z))

    count = len(coefficients)
    return UncertainVessel(vessel_at, np.zeros(count), np.eye(count))
