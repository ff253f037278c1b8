"""``seatrial identify``: coefficients from recordings, their validation, and the vessel file with them.

They are tested on held-out recordings: with three or more, each in turn, or each of some groups, is predicted
by the model fitted to the others; with fewer, the last third of each by the model fitted to what comes before.
Candidates for the next manoeuvre are simulated with the identified ship: their expected information is added to
the present one, and the best reduces the covariance most (D-optimality, Atkinson and Donev 1992).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
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
from seatrial.hybrid.identification import fit
from seatrial.hybrid.prediction import baselines, dataset, kalman_filter
from seatrial.hybrid.simulation.trial import SimulationNoise, sea_state_named, simulate_trial
from seatrial.hybrid.vessel.files import Vessel

REPERTOIRE = ("zigzag_10_10", "zigzag_20_20", "turning_circle_15", "turning_circle_35", "speed_runs", "stopping",
              "reciprocal", "one_thruster", "tunnel_test")  # fmt: skip

SEGMENTS = 20
"""The length of each simulated candidate, in segments."""

_NORMAL_95 = 1.959964
BY_RECORDING, MOST_FOLDS = 3, 4
LAST_THIRD = (200.0 / 3.0, 100.0)
_ROUNDS = 6
_STRIDE_S = 5
Tables = Mapping[str, pd.DataFrame]


@dataclass(frozen=True, slots=True)
class ManoeuvreInformation:
    """A manoeuvre of ``minutes``: its expected information in nats, the mean share of the variances that it
    would leave, and the coefficients that it would newly determine."""

    manoeuvre: str
    minutes: float
    gain: float
    left: float
    newly_known: tuple[str, ...]


def repertoire_of(vessel: Vessel) -> tuple[str, ...]:
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
    count = len(model.coefficients)
    prior = fitted.covariance[:count, :count]
    prior_error, minutes = np.sqrt(np.diag(prior)), SEGMENTS * model.segments.duration_s / 60.0
    ranked = []
    for name in names:
        try:
            information = _information(model, fitted, name)
        except errors.SeatrialError:
            continue
        posterior = np.linalg.inv(np.linalg.inv(prior) + information)
        posterior_error = np.sqrt(np.diag(posterior))
        gain = 0.5 * float(np.linalg.slogdet(prior)[1] - np.linalg.slogdet(posterior)[1])
        standard_errors = zip(model.coefficients, prior_error, posterior_error, strict=True)
        newly = tuple(coefficient.name for coefficient, a, b in standard_errors if a >= UNKNOWN > b)
        left = float(np.mean((posterior_error / prior_error) ** 2))
        ranked.append(ManoeuvreInformation(name, minutes, gain, left, newly))
    return sorted(ranked, key=lambda candidate: -candidate.gain)


def _information(model: fit.ResponseModel, fitted: fit.CoefficientFit, name: str) -> Floats:
    """The information of a simulated manoeuvre on the coefficients [P, P], its own surroundings unknown."""
    ship = model.vessel_at(fitted.z)
    lasting = model.segments.duration_s
    silent = SimulationNoise().scaled(0.0)
    table, _ = simulate_trial(
        ship, sea_state_named("calm"), name, (SEGMENTS + 0.5) * lasting, 1.0 / model.segments.dt_s, noise=silent
    )
    rehearsed = fit.segments_of({name: table}, vessel_plant(ship), lasting)
    model_there, z = model.on_segments(rehearsed, fitted.z)
    count, place = len(model.coefficients), model_there.place(z, rehearsed.start, fitted.levels)
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
    sensor errors by recording, in SI; ``candidates`` are further trials, the most informative first;
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
    def entangled(self) -> list[tuple[str, str, float]]:
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
            "coefficients": {
                name_or_tied: {name: getattr(estimate, name) for name in names}
                for estimate in self.coefficients
                for name_or_tied in (estimate.name, *estimate.tied)
            },
            "correlated": [list(pair) for pair in self.entangled],
            "surroundings": {name: dict(values) for name, values in self.surroundings.items()},
            "validation": None if judged is None else judged.as_dict(),
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

    ``only`` names the unknown ones, by default all of :func:`coefficient_names`; ``candidates`` are manoeuvres to
    rank; ``segment_s`` is the length of a segment; ``fixed`` are surroundings that are not fitted. Raises
    :class:`DataShortageError`, :class:`InputError` for recordings of another ship, :class:`ModelRangeError` if the
    model cannot follow them.
    """
    with threadpool_limits(1, user_api="blas"):  # small matrices, for which threads do not pay
        wanted = set(only)
        coefficients = [
            coefficient
            for coefficient in fit.coefficients_of(vessel)
            if not only or wanted & {coefficient.name, *coefficient.tied}
        ]
        segments = fit.segments_of(tables, vessel_plant(vessel), segment_s)
        model = fit.model_of(vessel, coefficients, segments, fixed)
        fitted = fit.fit(model, progress=progress)
        ranked = rank_trials(model, fitted, candidates)
    count = len(model.coefficients)
    deviation = np.sqrt(np.diag(fitted.covariance))[:count]
    share = np.minimum(deviation, 1.0)
    estimates = []
    for coefficient, z, error in zip(model.coefficients, fitted.z[:count], share, strict=True):
        low, high = sorted(coefficient.value(z + side * _NORMAL_95 * error) for side in (-1.0, 1.0))
        start_low, start_high = sorted(coefficient.value(side * _NORMAL_95) for side in (-1.0, 1.0))
        estimates.append(CoefficientEstimate(
            coefficient.value(z), low, high, coefficient.name, coefficient.start, start_low, start_high,
            float(error), coefficient.tied,
        ))  # fmt: skip
    around, segments = model.around(fitted.z), model.segments
    identification = Identification(
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
        tracks=(segments.measured[..., :2], model.reported(fitted.z, fitted.starts)[..., :2]),
    )
    return identification, fitted, model


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


def judge(
    tables: Tables,
    model: fit.ResponseModel,
    fitted: fit.CoefficientFit,
    horizon_s: int,
    progress: errors.Progress = lambda share: None,
) -> Judgement | None:
    """Errors of predictions over ``horizon_s`` under the recorded commands; None without a window.

    ``tables`` are the fitted ones, of samples by recording.
    """
    names, folds = list(tables), list[tuple[Tables, Tables]]()  # the tables to fit and those to test on
    if len(names) < BY_RECORDING:
        first, last = (
            {name: select(table, part) for name, table in tables.items()}
            for part in ((0.0, LAST_THIRD[0]), LAST_THIRD)
        )
        folds, held_out = [(first, last)], "the last third of each recording"
    else:
        count = min(len(names), MOST_FOLDS)
        held_out = "each recording in turn" if count == len(names) else f"recordings in {count} groups"
        for fold in range(count):
            held = names[fold::count]
            training = {name: tables[name] for name in names if name not in held}
            folds.append((training, {name: tables[name] for name in held}))
    tracks: dict[str, list[np.ndarray]] = {}
    for number, fold_tables in enumerate(folds):
        with threadpool_limits(1, user_api="blas"):
            for name, track in _fold(*fold_tables, model, fitted, horizon_s).items():
                tracks.setdefault(name, []).append(track)
        errors.subtask_progress(progress, number, len(folds))(1.0)
    if not tracks:
        return None
    together = {name: np.concatenate(parts) for name, parts in tracks.items()}
    measured = together.pop("measured")
    scores = {name: baselines.score(track, measured) for name, track in together.items()}
    return Judgement(horizon_s, len(measured), scores, held_out)


def _fold(
    training: Tables, test: Tables, model: fit.ResponseModel, fitted: fit.CoefficientFit, horizon_s: int
) -> dict[str, np.ndarray]:
    """Tracks by method and as measured, in the windows in which both models stay in their range."""
    length_m = model.vessel.dimensions.length_overall_m
    try:
        even = {name: second_by_second(partial(resample, table)) for name, table in test.items()}
        windows = dataset.dataset_of(even, horizon_s, _STRIDE_S, any_commands=True, length_m=length_m).windows
    except errors.DataShortageError:
        return {}
    original = vessel_plant(model.vessel)
    segments = fit.segments_of(training, original, model.segments.duration_s)
    refitted, z = model.on_segments(segments, fitted.z)  # the fit starts from that to all tables
    z = fit.fit(refitted, z, levels=fitted.levels, rounds=_ROUNDS).z
    identified = vessel_plant(refitted.vessel_at(z))
    tracks = {
        "constant_velocity": baselines.constant_velocity(kalman_filter.filtered_starts(windows, original)),
        "reference": baselines.reference(kalman_filter.filtered_starts(windows, original), original),
        "identified": baselines.reference(kalman_filter.filtered_starts(windows, identified), identified),
        "measured": windows.track,
    }
    inside = np.isfinite(np.stack(list(tracks.values()))).all(axis=(0, 2, 3))
    return {name: track[inside] for name, track in tracks.items()} if inside.any() else {}
