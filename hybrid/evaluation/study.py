"""Every method fitted on one part of the windows and judged on the other, split by split, draw by draw."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace

import numpy as np
from numpy.typing import NDArray

from acquisition.core.arrays import Bools, Floats
from acquisition.core.named_code import OwnCodeError
from acquisition.core.progress import Progress, part_of
from hybrid.calibrators import make_calibrator
from hybrid.calibrators.calibrator import Examples, predict_with_fallback
from hybrid.evaluation.splits import Draw, draws_of, leaked_share
from hybrid.evaluation.truth import truth_distances
from hybrid.prediction.baselines import Fallback, constant_velocity, straight_line
from hybrid.prediction.baselines import reference as model_tracks
from hybrid.prediction.dataset import within_model_range
from hybrid.prediction.prediction_windows import PredictionWindows, difference_rad, starting_two_sided
from hybrid.prediction.regions import conformal_region, relative_distances
from hybrid.prediction.scores import TWO_SIDED, distances
from hybrid.vessel.plant import Plant

Predict = Callable[[PredictionWindows, Floats], Floats]

BASELINES: dict[str, Predict] = {
    "straight_line": lambda windows, reference: straight_line(windows),
    "constant_velocity": lambda windows, reference: constant_velocity(windows),
    "reference": lambda windows, reference: reference,
}
"""What needs no training: the methods that every other has to beat."""


@dataclass(frozen=True, slots=True)
class Errors:
    """The errors of one method on N windows, seconds 1 to H.

    ``distance_m`` [N, H] to the measured position, ``north_m``, ``east_m`` and ``heading_deg`` [N] absolute means
    over the seconds; ``inside`` [N, H] whether the 95 % region, of semi-axes ``region_m`` [N, H, 2], holds the
    measured position; ``outside_domain`` [N] whether the start lies outside the domain of applicability, so that
    the fallback predicted; ``truth_m`` [N, K] the mean distance by each sensor (:mod:`.truth`). After pooling
    draws, ``inside`` and ``outside_domain`` are shares.
    """

    distance_m: Floats
    north_m: Floats
    east_m: Floats
    heading_deg: Floats
    inside: Floats
    region_m: Floats
    outside_domain: Floats
    truth_m: Floats

    def subset(self, chosen: Bools) -> Errors:
        """The errors on the windows that a mask chooses."""
        return Errors(*(getattr(self, field.name)[chosen] for field in fields(self)))


@dataclass(frozen=True, slots=True)
class SplitResult:
    """What one kind of split says of all methods.

    ``held_out`` [N] marks the windows that were held out in any draw; ``errors`` by method are on these, each
    window's averaged over the draws that held it out: so every window counts once. ``fitted`` is the number of
    windows learned from in each draw.
    """

    kind: str
    held_out: Bools
    errors: dict[str, Errors]
    fitted: tuple[int, ...]
    leaked: float


@dataclass(frozen=True, slots=True)
class Study:
    """The results by split, on ``windows``, less ``outside`` windows in which the reference leaves its range.

    ``failed`` are the methods of a user's own that failed, and why; they have no results.
    """

    windows: PredictionWindows
    outside: int
    results: tuple[SplitResult, ...]
    failed: dict[str, str] = field(default_factory=dict)


def study(
    windows: PredictionWindows,
    plant: Plant,
    methods: Sequence[str],
    splits: Sequence[str] = ("leg", "time"),
    draws: int = 5,
    seed: int = 0,
    progress: Progress = lambda share: None,
) -> Study:
    """Fit and judge ``methods``, and the baselines beside them, on every split.

    A method of a user's own that fails is left out, and the others go on. Raises :class:`DataShortageError` where
    there are too few legs, recordings or windows for a split, :class:`OwnCodeError` where all methods failed.
    """
    inside, tracks = within_model_range(windows, plant)
    failed: dict[str, str] = {}
    planned = {kind: draws_of(kind, inside, draws, seed) for kind in splits}
    total = sum(map(len, planned.values())) * max(len(methods), 1)
    results: list[SplitResult] = []
    done = 0
    for kind, kind_draws in planned.items():
        parts = []
        for number, draw in enumerate(kind_draws):
            share = part_of(progress, done, total)
            parts.append(evaluate_draw(draw, (inside, tracks), methods, plant, seed + number, share, failed))
            done += len(methods)
        results.append(pool_draws(kind, inside, kind_draws, [_without(each, failed) for each in parts]))
    results = [replace(each, errors=_without(each.errors, failed)) for each in results]
    return Study(inside, len(windows) - len(inside), tuple(results), failed)


def _without(errors: Mapping[str, Errors], failed: Mapping[str, str]) -> dict[str, Errors]:
    return {name: each for name, each in errors.items() if name.removesuffix(TWO_SIDED) not in failed}


def evaluate_draw(
    draw: Draw,
    examples: Examples,
    methods: Sequence[str],
    plant: Plant,
    seed: int,
    progress: Progress,
    failed: dict[str, str] | None = None,
) -> dict[str, Errors]:
    """Every method's errors on the windows that ``draw`` holds out; one that fails goes into ``failed``.

    They start from what was known at second 0, and beside it, as methods whose names end in :data:`TWO_SIDED`, from
    what is known afterwards.
    """
    fitting, stopping, held_out = (
        (examples[0].subset(mask), examples[1][mask]) for mask in (draw.fitting, draw.stopping, draw.held_out)
    )
    afterwards = starting_two_sided(held_out[0])
    judged = {"": held_out, TWO_SIDED: (afterwards, model_tracks(afterwards, plant))}
    errors = {
        f"{name}{ending}": _errors(predict, stopping, examples)
        for name, predict in BASELINES.items()
        for ending, examples in judged.items()
    }
    fallback = Fallback.fit(*fitting, plant)
    failed = {} if failed is None else failed
    for number, method in enumerate(methods):
        if method in failed:
            continue
        try:
            calibrator = make_calibrator(method, seed, plant).fit(fitting, stopping, part_of(progress, number, 1))
            region_m = calibrator.conformal_region(stopping)
            for ending, (windows, reference) in judged.items():
                found = predict_with_fallback(calibrator, plant, region_m, fallback, windows, reference)
                errors[f"{method}{ending}"] = errors_of(found.tracks, windows, found.region_m, found.outside_domain)
        except OwnCodeError as error:
            failed[method] = str(error)
            if len(failed) == len(methods):
                raise
        progress(number + 1.0)
    return errors


def _errors(predict: Predict, stopping: Examples, held_out: Examples) -> Errors:
    """The errors of what a baseline says of the windows held out, its regions sized on those stopped by."""
    region_m = conformal_region(predict(*stopping), stopping[0])
    return errors_of(predict(*held_out), held_out[0], region_m, np.zeros(len(held_out[0]), dtype=bool))


def errors_of(predicted: Floats, windows: PredictionWindows, region_m: Floats, outside_domain: Bools) -> Errors:
    """Errors of tracks [N, H+1, 3] whose 95 % regions have semi-axes ``region_m`` [H, 2] or [N, H, 2]."""
    gap = predicted[:, 1:] - windows.track[:, 1:]
    distance = distances(predicted, windows.track)
    turn = difference_rad(predicted[:, 1:, 2], windows.track[:, 1:, 2])
    return Errors(
        distance_m=distance,
        north_m=np.abs(gap[..., 0]).mean(axis=1),
        east_m=np.abs(gap[..., 1]).mean(axis=1),
        heading_deg=np.rad2deg(np.abs(turn)).mean(axis=1),
        inside=(relative_distances(predicted, windows.track, region_m) <= 1.0).astype(float),
        region_m=np.broadcast_to(region_m, (*distance.shape, 2)),
        outside_domain=outside_domain.astype(float),
        truth_m=truth_distances(predicted, windows),
    )


def pool_draws(
    kind: str, windows: PredictionWindows, draws: Sequence[Draw], parts: Sequence[Mapping[str, Errors]]
) -> SplitResult:
    """One result from all draws, each window's errors averaged over the draws that held it out."""
    times = np.sum([draw.held_out for draw in draws], axis=0)
    errors = {
        method: Errors(
            *(
                _mean_over_draws(draws, [getattr(part[method], field.name) for part in parts], times)
                for field in fields(Errors)
            )
        )
        for method in parts[0]
    }
    fitted = tuple(int(draw.fitting.sum()) for draw in draws)
    leaked = float(np.mean([leaked_share(windows, draw) for draw in draws]))
    return SplitResult(kind, times > 0, errors, fitted, leaked)


def _mean_over_draws(draws: Sequence[Draw], values: Sequence[Floats], times: NDArray[np.int64]) -> Floats:
    """The mean of ``values`` of each draw's held-out windows over the draws, for windows held out at all."""
    total = np.zeros((len(times), *values[0].shape[1:]))
    for draw, each in zip(draws, values, strict=True):
        total[draw.held_out] += each
    held_out = times > 0
    return np.asarray(total[held_out] / times[held_out].reshape(-1, *[1] * (total.ndim - 1)))
