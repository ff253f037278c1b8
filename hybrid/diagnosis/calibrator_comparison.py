"""The comparison of reference model, named model, and a calibrator on top of either, on held-out windows.

Windows are divided by the folds of the gap. A fold's windows are predicted by the model with the effects named
on the other folds, and by calibrators trained on windows without a second in that fold. Calibrators are trained
and scored by :mod:`seatrial.hybrid.evaluation.study`, as for ``seatrial evaluate``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from functools import partial

import numpy as np
import pandas as pd

from seatrial.acquisition.core.errors import DataShortageError, Progress, subtask_progress
from seatrial.acquisition.core.quantities import Ints
from seatrial.analysis.tables.resample import resample
from seatrial.analysis.windows.held import second_by_second
from seatrial.hybrid.calibrators import METHOD
from seatrial.hybrid.diagnosis import acceptance, gap, linearise, regression, verdict
from seatrial.hybrid.diagnosis.log import Log, join_tables, recording_names
from seatrial.hybrid.diagnosis.result import CalibratorComparison, Diagnosis, Ratio, UnknownCause
from seatrial.hybrid.evaluation.study import Draw, MethodErrors, evaluate_draw, pool_draws, with_stopping
from seatrial.hybrid.prediction import baselines, dataset, window_sets

_TELLING = 0.9  # of the error: a tenth is worth explaining

STRIDE_S = 5
_LEAST_LEGS = 4  # with fewer the interval of a mean is meaningless


def compare_calibrators(
    conclusion: verdict.Conclusion,
    tables: Sequence[pd.DataFrame],
    *,
    seed: int = 0,
    progress: Progress = lambda share: None,
) -> CalibratorComparison:
    """The comparison for a diagnosis, on the ``tables`` that it was made from.

    With too few held windows, or named effects that vary over the trial, the comparison is empty and gives the
    reason.
    """
    equations = conclusion.accepted.evidence.equations
    if any(linearise.time_varying_among(at, equations.model.catalogue) for at in conclusion.gap.without.values()):
        return CalibratorComparison(
            gap.HORIZON_S, METHOD, why_not="what was named is not the same in all of the trial"
        )
    try:
        pieces = dict[str, list[pd.DataFrame]]()  # some tables may be parts of one recording
        for name, table in zip(recording_names(tables), tables, strict=True):
            pieces.setdefault(name, []).append(table)
        by_recording = {
            name: second_by_second(partial(resample, join_tables(parts))) for name, parts in pieces.items()
        }
        length_m = equations.model.base.length_overall_m
        windows = dataset.dataset_of(by_recording, gap.HORIZON_S, STRIDE_S, shorter=True, length_m=length_m).windows
        seconds = seconds_in_folds(windows, equations.log, equations.log.names)
        named = conclusion.gap.without if conclusion.accepted.names else None
        return compare_on_windows(windows, seconds, equations.model, named, seed=seed, progress=progress)
    except DataShortageError as error:
        return CalibratorComparison(gap.HORIZON_S, METHOD, why_not=error.what)


def seconds_in_folds(windows: window_sets.PredictionWindows, log: Log, trials: Sequence[str]) -> Ints:
    """The seconds of each window in the legs of each fold [N, FOLDS]; ``trials`` names the recordings."""
    first, last = windows.measured_seconds()
    fold, counts = gap.fold_of(log), np.zeros((len(windows), gap.FOLDS), dtype=np.int64)
    for number, trial in enumerate(trials):
        mine = np.flatnonzero(windows.trial == trial)
        for test_fold in range(gap.FOLDS):
            seconds = np.sort(log.time_s[(log.recording == number) & (fold == test_fold)])
            counts[mine, test_fold] = np.searchsorted(seconds, last[mine], "right") - np.searchsorted(
                seconds, first[mine]
            )
    return counts


def draws_of_folds(windows: window_sets.PredictionWindows, seconds: Ints, seed: int) -> dict[int, Draw]:
    """For each fold the test windows, entirely in its legs, and the training windows, which share no second
    with them.

    Raises :class:`DataShortageError` if there are too few legs to test on or train on.
    """
    first, last = windows.measured_seconds()
    inside = (seconds == (last - first + 1)[:, None]) & windows.is_complete[:, None]
    legs = np.unique(windows.leg[inside.any(axis=1)]).size
    if legs < _LEAST_LEGS:
        raise DataShortageError(
            f"{legs} legs have held windows within the models' range; {_LEAST_LEGS} are needed",
            fix="record longer periods with steady controls",
        )
    folds = np.flatnonzero(inside.any(axis=0)).tolist()
    return {fold: with_stopping(windows, seconds[:, fold] == 0, inside[:, fold], seed + fold) for fold in folds}


def compare_on_windows(
    windows: window_sets.PredictionWindows,
    seconds: Ints,
    model: linearise.ModelWithEffects,
    named: Mapping[int, acceptance.Coordinates] | None,
    *,
    method: str = METHOD,
    seed: int = 0,
    progress: Progress = lambda share: None,
) -> CalibratorComparison:
    """The comparison on windows with ``seconds`` [N, FOLDS] in each fold.

    ``named`` are the effects named without the legs of each fold, None if nothing was named. Raises
    :class:`DataShortageError` if there are too few legs or windows.
    """
    base = replace(model, at={}).plant()
    folds = range(gap.FOLDS) if named is None else named
    bases = {fold: {"reference": base} for fold in folds}
    for fold, at in (named or {}).items():
        bases[fold]["named"] = replace(model, at=at).plant()
    plants = [plant for fold_plants in bases.values() for plant in fold_plants.values()]
    finite = np.all(
        [np.isfinite(baselines.simulate_reference(windows, plant)).all(axis=(1, 2)) for plant in plants], axis=0
    )
    windows, seconds = windows.subset(finite), seconds[finite]
    draws = {fold: draw for fold, draw in draws_of_folds(windows, seconds, seed).items() if fold in bases}
    errors_of_folds = list[dict[str, MethodErrors]]()
    for number, (fold, draw) in enumerate(draws.items()):
        fold_progress = subtask_progress(progress, number, len(draws))
        models, calibrated = dict[str, MethodErrors](), dict[str, MethodErrors]()
        for place, (name, plant) in enumerate(bases[fold].items()):
            examples, share = (
                (windows, baselines.simulate_reference(windows, plant)),
                subtask_progress(fold_progress, place, len(bases[fold])),
            )
            errors = evaluate_draw(draw, examples, [method], plant, seed + fold, share)
            models |= {"constant_velocity": errors["constant_velocity"], name: errors["reference"]}
            calibrated[f"{name}_calibrated"] = errors[method]
        errors_of_folds.append(models | calibrated)
    result = pool_draws("leg", windows, list(draws.values()), errors_of_folds)
    legs = baselines.LegBootstrap.of(windows.leg[result.held_out], seed)
    mean_m = {name: errors.distance_m.mean(axis=1) for name, errors in result.errors.items()}
    pairs = [("named", "reference"), ("reference_calibrated", "reference"), ("named_calibrated", "named"),
             ("named_calibrated", "reference_calibrated")]  # fmt: skip
    return CalibratorComparison(
        windows.horizon_s,
        method,
        int(result.held_out.sum()),
        legs.leg_count,
        {name: legs.mean(distance_m) for name, distance_m in mean_m.items()},
        tuple(
            Ratio(numerator, denominator, **asdict(legs.ratio(mean_m[numerator], mean_m[denominator])))
            for numerator, denominator in pairs
            if numerator in mean_m
        ),
    )


def doubted_by_calibrator(diagnosis: Diagnosis, comparison: CalibratorComparison) -> Diagnosis:
    """The diagnosis, not saying that nothing is missing if a calibrator improves predictions all the same."""
    if diagnosis.verdict != "nothing_missing" or not comparison.mean_distance_m:
        return diagnosis
    ratio = comparison.ratio("reference_calibrated", "reference")
    if ratio.value > _TELLING or not ratio.high < 1.0:
        return diagnosis
    words = f"what a calibrator learns of these data, which takes {100.0 * (1.0 - ratio.value):.0f} % off the error"
    unknown = UnknownCause(1.0 - ratio.value, (regression.OPERATION,), words)
    return replace(diagnosis, verdict="unknown", unknown=unknown)
