"""Every method fitted on one part of the windows and tested on the other, with intervals.

``leg`` holds out whole legs, drawn at random; ``time`` the end of every recording; ``recording`` one recording
after the other. In these no second of a test window was used for fitting: with any commands, where legs follow
each other without end, windows that share a second with the other side are left out. ``random`` draws single
windows, as is often published: windows overlap, so most test seconds were also fitted. It is included to show
by how much that flatters. Classes by what the ship did, by wind and by recording show where a method is good and
where it is not; their limits scale with the ship: lengths in ship lengths, speeds as Froude numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
import pandas as pd

from seatrial.acquisition.core.errors import ConfigurationError, DataShortageError, Progress, subtask_progress
from seatrial.acquisition.core.named_code import UserCodeError
from seatrial.acquisition.core.quantities import GRAVITY_MPS2, Bools, Floats, Strings, rotate_earth_to_ship
from seatrial.acquisition.core.result import ModelResult, to_json
from seatrial.hybrid.calibrators import HELD_OUT_SHARE, Examples, make_calibrator, predict_with_fallback
from seatrial.hybrid.evaluation.validate import ErrorsByTruth, errors_by_truth, truth_distances
from seatrial.hybrid.prediction import baselines, dataset, window_sets
from seatrial.hybrid.vessel.black_box import MotionModel

BASELINES = ("straight_line", "constant_velocity", "reference")
"""The methods without training (:func:`.untrained_tracks`), which every other has to beat."""

TEST_SHARE = 0.3
"""The share of the windows, or of a recording's time, that is held out for testing."""

SLOW_FROUDE = 0.06
"""Froude number below which a ship is docking, drifting or keeping its position."""
SIDEWAYS_DEG = 30.0
"""Drift angle beyond which the ship moves sideways or astern."""
TURNING_DEG_PER_LENGTH = 4.0
"""Change of heading over a ship length above which it is turning: a circle of less than 29 lengths."""
ACCELERATING_PER_LENGTH = 0.02
"""Relative change of speed over a ship length above which it accelerates."""

MANOEUVRES = ("straight", "turning", "accelerating", "slow", "other")
BEAUFORT_MPS = (3.4, 8.0, 13.9)
WINDS = ("0-2 Bft", "3-4 Bft", "5-6 Bft", "7 Bft and more")
_MINUTE = 61


@dataclass(frozen=True, slots=True)
class MethodErrors:
    """The errors of one method on N windows, seconds 1 to H.

    ``distance_m`` [N, H] to the measured position, ``north_m``, ``east_m`` and ``heading_deg`` [N] absolute
    means over the seconds; ``inside`` [N, H] whether the 95 % region, of semi-axes ``region_m`` [N, H, 2],
    contains the measured position; ``outside_domain`` [N] whether the start lies outside the domain of
    applicability, so that the fallback predicted; ``truth_m`` [N, K] the mean distance by each sensor
    (:func:`.truth_distances`). After pooling draws, ``inside`` and ``outside_domain`` are shares.
    """

    distance_m: Floats
    north_m: Floats
    east_m: Floats
    heading_deg: Floats
    inside: Floats
    region_m: Floats
    outside_domain: Floats
    truth_m: Floats

    def subset(self, chosen: Bools) -> MethodErrors:
        """The errors on the windows that a mask chooses."""
        return MethodErrors(*(getattr(self, field.name)[chosen] for field in fields(self)))


@dataclass(frozen=True, slots=True)
class SplitResult:
    """The results of one kind of split for all methods.

    ``held_out`` [N] marks the windows that were held out in any draw; ``errors`` by method are on these, each
    window's averaged over the draws that held it out, so every window counts once. ``fitted`` is the number of
    training windows in each draw.
    """

    kind: str
    held_out: Bools
    errors: dict[str, MethodErrors]
    fitted: tuple[int, ...]
    leaked: float


@dataclass(frozen=True, slots=True)
class Study:
    """The results by split, on ``windows`` without the ``outside`` windows in which the reference leaves its
    range.

    ``failed`` are user-defined methods that failed, and why; they have no results.
    """

    windows: window_sets.PredictionWindows
    outside: int
    results: tuple[SplitResult, ...]
    failed: dict[str, str] = field(default_factory=dict)


def evaluate_methods(
    windows: window_sets.PredictionWindows,
    plant: MotionModel,
    methods: Sequence[str],
    splits: Sequence[str] = ("leg", "time"),
    draws: int = 5,
    seed: int = 0,
    progress: Progress = lambda share: None,
) -> Study:
    """Fit and test ``methods``, and the baselines, on every split.

    A user-defined method that fails is left out, and the others go on. Raises :class:`DataShortageError` if
    there are too few legs, recordings or windows for a split, :class:`UserCodeError` if all methods failed.
    """

    def without_failed(errors: Mapping[str, MethodErrors]) -> dict[str, MethodErrors]:
        return {
            name: values for name, values in errors.items() if name.removesuffix(baselines.TWO_SIDED) not in failed
        }

    inside, tracks = dataset.windows_within_model_range(windows, plant)
    failed: dict[str, str] = {}
    planned = {kind: SPLITS[kind](inside, draws, seed) for kind in splits}
    total = sum(map(len, planned.values())) * max(len(methods), 1)
    results: list[SplitResult] = []
    done = 0
    for kind, kind_draws in planned.items():
        parts = []
        for number, draw in enumerate(kind_draws):
            share = subtask_progress(progress, done, total)
            parts.append(evaluate_draw(draw, (inside, tracks), methods, plant, seed + number, share, failed))
            done += len(methods)
        results.append(pool_draws(kind, inside, kind_draws, list(map(without_failed, parts))))
    results = [replace(result, errors=without_failed(result.errors)) for result in results]
    return Study(inside, len(windows) - len(inside), tuple(results), failed)


def evaluate_draw(
    draw: Draw,
    examples: Examples,
    methods: Sequence[str],
    plant: MotionModel,
    seed: int,
    progress: Progress,
    failed: dict[str, str] | None = None,
) -> dict[str, MethodErrors]:
    """Every method's errors on the windows that ``draw`` holds out; failures are added to ``failed``.

    Predictions start from the causal state at second 0, and, for methods whose names end in :data:`TWO_SIDED`,
    from the two-sided one. Regions are sized on the windows for stopping.
    """
    fitting, stopping, held_out = (
        (examples[0].subset(mask), examples[1][mask]) for mask in (draw.fitting, draw.stopping, draw.held_out)
    )
    two_sided = window_sets.replace_by_two_sided_starts(held_out[0])
    judged = {"": held_out, baselines.TWO_SIDED: (two_sided, baselines.simulate_reference(two_sided, plant))}
    regions = {
        name: baselines.conformal_region(track, stopping[0])
        for name, track in baselines.untrained_tracks(*stopping).items()
    }
    errors = {
        f"{name}{ending}": errors_of(track, windows, regions[name], np.zeros(len(windows), dtype=bool))
        for ending, (windows, reference) in judged.items()
        for name, track in baselines.untrained_tracks(windows, reference).items()
    }
    fallback = baselines.Fallback.fit(*fitting, plant)
    failed = {} if failed is None else failed
    for number, method in enumerate(methods):
        if method in failed:
            continue
        try:
            calibrator = make_calibrator(method, seed, plant).fit(
                fitting, stopping, subtask_progress(progress, number, 1)
            )
            region_m = calibrator.conformal_region(stopping)
            for ending, (windows, reference) in judged.items():
                predicted = predict_with_fallback(calibrator, plant, region_m, fallback, windows, reference)
                errors[f"{method}{ending}"] = errors_of(
                    predicted.tracks, windows, predicted.region_m, predicted.outside_domain
                )
        except UserCodeError as error:
            failed[method] = str(error)
            if len(failed) == len(methods):
                raise
        progress(number + 1.0)
    return errors


def errors_of(
    predicted: Floats, windows: window_sets.PredictionWindows, region_m: Floats, outside_domain: Bools
) -> MethodErrors:
    """Errors of tracks [N, H+1, 3] whose 95 % regions have semi-axes ``region_m`` [H, 2] or [N, H, 2]."""
    gap = predicted[:, 1:] - windows.track[:, 1:]
    distance = baselines.distances(predicted, windows.track)
    return MethodErrors(
        distance_m=distance,
        north_m=np.abs(gap[..., 0]).mean(axis=1),
        east_m=np.abs(gap[..., 1]).mean(axis=1),
        heading_deg=baselines.heading_errors_deg(predicted, windows.track).mean(axis=1),
        inside=(baselines.relative_distances(predicted, windows.track, region_m) <= 1.0).astype(float),
        region_m=np.broadcast_to(region_m, (*distance.shape, 2)),
        outside_domain=outside_domain.astype(float),
        truth_m=truth_distances(predicted, windows),
    )


def pool_draws(
    kind: str,
    windows: window_sets.PredictionWindows,
    draws: Sequence[Draw],
    parts: Sequence[Mapping[str, MethodErrors]],
) -> SplitResult:
    """One result from all draws, each window's errors averaged over the draws that held it out."""
    times = np.sum([draw.held_out for draw in draws], axis=0)
    held_out = times > 0

    def mean(values: Sequence[Floats]) -> Floats:
        total = np.zeros((len(times), *values[0].shape[1:]))
        for draw, draw_values in zip(draws, values, strict=True):
            total[draw.held_out] += draw_values
        return np.asarray(total[held_out] / times[held_out].reshape(-1, *[1] * (total.ndim - 1)))

    errors = {
        method: MethodErrors(
            *(mean([getattr(part[method], field.name) for part in parts]) for field in fields(MethodErrors))
        )
        for method in parts[0]
    }
    fitted = tuple(int(draw.fitting.sum()) for draw in draws)
    leaked = [
        shared_seconds(windows, draw.fitting | draw.stopping, draw.held_out)
        / shared_seconds(windows, draw.held_out, draw.held_out)
        for draw in draws
    ]
    return SplitResult(kind, held_out, errors, fitted, float(np.mean(leaked)))


@dataclass(frozen=True, slots=True)
class MethodFigures:
    """One method on one set of windows.

    ``ratio`` is its mean distance over that of the best baseline, ``coverage`` the share of positions inside
    the 95 % region, ``outside_domain`` the share of windows that start outside its domain. At seconds 1 to H:
    ``by_second`` the mean distance [m], ``coverage_by_second``, and the mean semi-axes of the region [H, 2].
    """

    mean_distance_m: baselines.Interval
    end_distance_m: baselines.Interval
    mae_north_m: baselines.Interval
    mae_east_m: baselines.Interval
    heading_error_deg: baselines.Interval
    ratio: baselines.Interval
    coverage_95: baselines.Interval
    by_second: tuple[baselines.Interval, ...]
    coverage_by_second: tuple[baselines.Interval, ...]
    region_by_second_m: Floats
    outside_domain: float

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        plain = to_json(self)
        means, coverages, regions = (
            plain.pop(name) for name in ("by_second", "coverage_by_second", "region_by_second_m")
        )
        radii_m = baselines.equal_area_radius(self.region_by_second_m).tolist()
        by_second = [
            {"second": second, **mean, "coverage_95": coverage["value"], "radius_m": radius_m, "along_m": along_m,
             "across_m": across_m}
            for second, (mean, coverage, radius_m, (along_m, across_m))
            in enumerate(zip(means, coverages, radii_m, regions, strict=True), 1)
        ]  # fmt: skip
        ratio, outside = plain.pop("ratio"), plain.pop("outside_domain")
        return {**plain, "ratio_to_best_baseline": ratio, "outside_training_range": outside, "by_second": by_second}


@dataclass(frozen=True, slots=True)
class MethodSummary:
    """All methods on one set of windows of some legs, and the best baseline there."""

    windows: int
    legs: int
    best_baseline: str
    methods: dict[str, MethodFigures]

    @property
    def best(self) -> str:
        """The method with the smallest mean distance."""
        return min(self.methods, key=lambda name: self.methods[name].mean_distance_m.value)


@dataclass(frozen=True, slots=True)
class SplitSummary:
    """The figures of one split, overall, by kind of class and class (``breakdown``), and by sensor
    (``truths``).

    ``leaked`` is the share of the test seconds also used for training. Methods start from the causal state at
    second 0; in ``two_sided`` from the two-sided state, as does the baseline they are compared with.
    """

    kind: str
    fitted: tuple[int, ...]
    leaked: float
    causal: MethodSummary
    two_sided: MethodSummary
    breakdown: dict[str, dict[str, MethodSummary]]
    truths: ErrorsByTruth | None = None

    @property
    def by_start(self) -> dict[str, MethodSummary]:
        """The summaries of all windows, by start state."""
        return {"causal": self.causal, "two-sided": self.two_sided}

    @property
    def dividing_classes(self) -> dict[str, dict[str, MethodSummary]]:
        """The kinds of class that divide the windows; a single class would repeat the overall figures."""
        return {kind: classes for kind, classes in self.breakdown.items() if len(classes) > 1}


@dataclass(frozen=True, slots=True, repr=False)
class Evaluation(ModelResult):
    """The figures of a study by split; ``failed`` are user-defined methods that failed, and why.

    ``leak`` is by method the ratio of the error on unseen legs to that in the random split, on the windows held out
    in both; empty unless both splits were made.
    """

    horizon_s: int
    windows: int
    legs: int
    outside: int
    splits: dict[str, SplitSummary]
    leak: dict[str, baselines.Interval]
    failed: dict[str, str] = field(default_factory=dict)
    view = "seatrial.hybrid.report.text:evaluation_view"
    drawing = "seatrial.hybrid.report.pages:draw_evaluation"

    @property
    def measurements(self) -> str:
        """A remark if positions and speeds disagree in the windows of any split."""
        return next(
            (split.truths.remark for split in self.splits.values() if split.truths and split.truths.remark), ""
        )

    @property
    def first_lines(self) -> list[str]:
        return [*super(Evaluation, self).first_lines, *(f"left out: {reason}" for reason in self.failed.values())]

    def to_frame(self) -> pd.DataFrame:
        """One row a split and method."""
        splits = self.as_dict()["splits"]
        tables = {kind: pd.DataFrame.from_dict(split["methods"], orient="index") for kind, split in splits.items()}
        table: pd.DataFrame = pd.concat(tables, names=["split", "method"])
        return table

    def as_dict(self) -> dict[str, Any]:
        """The JSON object."""
        return {
            **self.remarks,
            **({"failed": self.failed} if self.failed else {}),
            "horizon_s": self.horizon_s,
            "windows": self.windows,
            "legs": self.legs,
            "outside_model_range": self.outside,
            "splits": {kind: _split_as_dict(split) for kind, split in self.splits.items()},
            "leak": to_json(self.leak),
        }


def summarise_study(study: Study, length_m: float, seed: int) -> Evaluation:
    """The figures of a study on a ship of ``length_m``; ``seed`` draws the legs for the intervals."""
    splits = {}
    for result in study.results:
        windows = study.windows.subset(result.held_out)
        causal, two_sided = _group_by_start_state(result.errors)
        breakdown: dict[str, dict[str, MethodSummary]] = {}
        for kind, classes in window_classes(windows, length_m).items():
            breakdown[kind] = {}
            for name, mask in classes.items():
                errors = {method: method_errors.subset(mask) for method, method_errors in causal.items()}
                breakdown[kind][name] = summarise_errors(errors, windows.subset(mask), seed)
        truth_m = {name: method_errors.truth_m for name, method_errors in causal.items()}
        splits[result.kind] = SplitSummary(
            result.kind, result.fitted, result.leaked, summarise_errors(causal, windows, seed),
            summarise_errors(two_sided, windows, seed), breakdown, errors_by_truth(windows, truth_m, seed),
        )  # fmt: skip

    leak: dict[str, baselines.Interval] = {}
    by_kind = {result.kind: result for result in study.results}
    if {"leg", "random"} <= set(by_kind):
        unseen, drawn = by_kind["leg"], by_kind["random"]
        shared = unseen.held_out & drawn.held_out
        if shared.any():
            legs = baselines.LegBootstrap.of(study.windows.leg[shared], seed)
            for name in _group_by_start_state(unseen.errors)[0]:
                unseen_m = unseen.errors[name].distance_m[shared[unseen.held_out]].mean(axis=1)
                drawn_m = drawn.errors[name].distance_m[shared[drawn.held_out]].mean(axis=1)
                leak[name] = legs.ratio(unseen_m, drawn_m)

    complete = study.windows.is_complete
    return Evaluation(
        study.windows.horizon_s, int(complete.sum()), len(set(study.windows.leg[complete])), study.outside, splits,
        leak, study.failed,
    )  # fmt: skip


def summarise_errors(
    errors: Mapping[str, MethodErrors], windows: window_sets.PredictionWindows, seed: int
) -> MethodSummary:
    """The figures of every method on the same windows; the baselines are among ``errors``."""
    legs = baselines.LegBootstrap.of(windows.leg, seed)
    best = min(BASELINES, key=lambda name: float(errors[name].distance_m.mean()))
    baseline_m = errors[best].distance_m.mean(axis=1)
    methods = {}
    for name, method in errors.items():
        mean_m = method.distance_m.mean(axis=1)
        inside = method.inside.mean(axis=1)
        single = np.column_stack([mean_m, method.north_m, method.east_m, method.heading_deg, inside])
        by_second = legs.column_means(method.distance_m)
        distance, north, east, heading, coverage = legs.column_means(single)
        methods[name] = MethodFigures(
            mean_distance_m=distance,
            end_distance_m=by_second[-1],
            mae_north_m=north,
            mae_east_m=east,
            heading_error_deg=heading,
            ratio=legs.ratio(mean_m, baseline_m),
            coverage_95=coverage,
            by_second=by_second,
            coverage_by_second=legs.column_means(method.inside),
            region_by_second_m=method.region_m.mean(axis=0),
            outside_domain=float(method.outside_domain.mean()),
        )
    return MethodSummary(len(windows), legs.leg_count, best, methods)


def _group_by_start_state(
    errors: Mapping[str, MethodErrors],
) -> tuple[dict[str, MethodErrors], dict[str, MethodErrors]]:
    """The errors from causal and from two-sided starts, each by the method's plain name."""
    causal = {
        name: method_errors
        for name, method_errors in errors.items()
        if baselines.start_state_of_method(name) == "causal"
    }
    return causal, {name: errors[f"{name}{baselines.TWO_SIDED}"] for name in causal}


def _split_as_dict(split: SplitSummary) -> dict[str, Any]:
    def counts(summary: MethodSummary) -> dict[str, Any]:
        return {"windows": summary.windows, "legs": summary.legs, "best_baseline": summary.best_baseline}

    breakdown: dict[str, dict[str, Any]] = {}
    for kind, classes in split.breakdown.items():
        breakdown[kind] = {}
        for name, summary in classes.items():
            main = {
                method: {
                    "start": baselines.start_state_of_method(method), "mean_distance_m": figures.mean_distance_m,
                    "ratio_to_best_baseline": figures.ratio, "coverage_95": figures.coverage_95,
                }
                for method, figures in summary.methods.items()
            }  # fmt: skip
            breakdown[kind][name] = {**counts(summary), "methods": to_json(main)}
    return {
        "draws": len(split.fitted),
        "fitted_windows": list(split.fitted),
        "shared_seconds": split.leaked,
        **counts(split.causal),
        "methods": {
            f"{method}{ending}": {
                "start": baselines.start_state_of_method(f"{method}{ending}"),
                **figures.as_dict(),
            }
            for summary, ending in ((split.causal, ""), (split.two_sided, baselines.TWO_SIDED))
            for method, figures in summary.methods.items()
        },
        "breakdown": breakdown,
        "truths": to_json(split.truths),
    }


@dataclass(frozen=True, slots=True)
class Draw:
    """A split of N windows, as disjoint masks [N].

    ``fitting`` is for training, ``stopping`` for early stopping and for the size of regions, ``held_out`` for
    testing; the latter holds whole windows only. Windows in none of them share seconds with both sides.
    """

    fitting: Bools
    stopping: Bools
    held_out: Bools


def refuse_unknown_splits(kinds: Sequence[str]) -> None:
    """Raise :class:`ConfigurationError` if one of the names is no kind of split."""
    for kind in kinds:
        if kind not in SPLITS:
            raise ConfigurationError(f"unknown split {kind!r}", fix=f"use one of {', '.join(SPLITS)}")


def split_by_leg(windows: window_sets.PredictionWindows, draws: int, seed: int) -> list[Draw]:
    """Whole legs with about 30 % of the windows held out, drawn again each time."""
    parts = [window_sets.draw_windows(windows, windows.leg, TEST_SHARE, seed + draw) for draw in range(draws)]
    return [
        with_stopping(windows, window_sets.drop_overlapping_windows(windows, ~unseen, unseen), unseen, seed + draw)
        for draw, unseen in enumerate(parts)
    ]


def split_by_time(windows: window_sets.PredictionWindows, draws: int, seed: int) -> list[Draw]:
    """The last 30 % of each recording's time held out; windows across the border are dropped."""
    first, last = windows.measured_seconds()
    fitted, unseen = np.zeros(len(windows), dtype=bool), np.zeros(len(windows), dtype=bool)
    for trial in np.unique(windows.trial):
        in_trial = windows.trial == trial
        border = first[in_trial].min() + (1.0 - TEST_SHARE) * (last[in_trial].max() - first[in_trial].min())
        fitted |= in_trial & (last < border)
        unseen |= in_trial & (first > border)
    if not fitted.any() or not unseen.any():
        raise DataShortageError("no window on one side of 70 % of the time", fix="give longer recordings")
    return [with_stopping(windows, fitted, unseen, seed)]


def split_by_recording(windows: window_sets.PredictionWindows, draws: int, seed: int) -> list[Draw]:
    """Each recording in turn held out from all others, if it has whole windows."""
    trials = np.unique(windows.trial[windows.is_complete])
    if len(trials) < 2:
        raise DataShortageError("a split by recording needs two recordings or more", fix="give two or more")
    return [with_stopping(windows, windows.trial != trial, windows.trial == trial, seed) for trial in trials]


def split_at_random(windows: window_sets.PredictionWindows, draws: int, seed: int) -> list[Draw]:
    """Single windows held out, whatever their leg, and others for early stopping: this leaks."""
    result = []
    for draw in range(draws):
        rank = np.random.default_rng(seed + draw).permutation(len(windows)) / len(windows)
        stopping = (rank >= TEST_SHARE) & (rank < TEST_SHARE + HELD_OUT_SHARE * (1.0 - TEST_SHARE))
        held_out = rank < TEST_SHARE
        result.append(Draw(~held_out & ~stopping, stopping, held_out & windows.is_complete))
    return result


SPLITS: dict[str, Callable[[window_sets.PredictionWindows, int, int], list[Draw]]] = {
    "leg": split_by_leg,
    "time": split_by_time,
    "recording": split_by_recording,
    "random": split_at_random,
}
"""The kinds of split by name, as functions of windows, a number of draws, which counts where these are random, and
a seed. They raise :class:`DataShortageError` if windows cannot be split in that way."""


def shared_seconds(windows: window_sets.PredictionWindows, fitted: Bools, unseen: Bools) -> int:
    """The number of seconds of the windows ``unseen`` that are also in windows ``fitted``, trial by trial."""
    first, _ = windows.measured_seconds()
    seconds = first[:, None] + np.arange(windows.horizon_s + 1)
    measured = np.isfinite(windows.track[..., 0])
    trial_masks = [windows.trial == trial for trial in np.unique(windows.trial)]
    sides = [
        [seconds[side & in_trial][measured[side & in_trial]] for side in (fitted, unseen)]
        for in_trial in trial_masks
    ]
    return sum(np.intersect1d(*pair).size for pair in sides)


def with_stopping(windows: window_sets.PredictionWindows, fitted: Bools, unseen: Bools, seed: int) -> Draw:
    """The draw in which whole legs, or recordings, of the known windows are kept for early stopping."""
    stopping = np.zeros(len(windows), dtype=bool)
    fitted_windows = windows.subset(fitted)
    stopping[fitted] = window_sets.draw_windows(
        fitted_windows, window_sets.held_out_group_names(fitted_windows), HELD_OUT_SHARE, seed
    )
    return Draw(
        window_sets.drop_overlapping_windows(windows, fitted & ~stopping, stopping),
        stopping,
        unseen & windows.is_complete,
    )


def window_classes(windows: window_sets.PredictionWindows, length_m: float) -> dict[str, dict[str, Bools]]:
    """Masks [N] by kind of class and class, without empty ones; those of a kind cover all windows.

    The wind is that of the minute before each window, by its Beaufort number.
    """
    wind_mps = np.nanmean(
        np.column_stack([windows.wind[:, -1], windows.past[:, :_MINUTE, window_sets.WIND][..., -1]]), axis=1
    )
    winds = np.array(WINDS)[np.searchsorted(BEAUFORT_MPS, wind_mps, side="right")]
    named = {
        "manoeuvre": (motion_class_of_windows(windows, length_m), MANOEUVRES),
        "wind": (winds, WINDS),
        "recording": (windows.trial, tuple(np.unique(windows.trial))),
    }
    return {
        kind: {str(name): mask for name in names if (mask := np.asarray(classes == name)).any()}
        for kind, (classes, names) in named.items()
    }


def motion_class_of_windows(windows: window_sets.PredictionWindows, length_m: float) -> Strings:
    """The class of motion of each window's measured track [N], one of :data:`MANOEUVRES`.

    The first that applies of: slow; other, sideways or astern; turning; accelerating; straight.
    """
    seconds = windows.horizon_s
    steps = np.diff(windows.track[..., :2], axis=1)
    way_m = np.hypot(steps[..., 0], steps[..., 1]).sum(axis=1)
    lengths = np.maximum(way_m / length_m, 1e-9)
    turned_deg = np.rad2deg(np.abs(windows.track[:, -1, 2] - windows.track[:, 0, 2]))
    heading = 0.5 * (windows.track[:, 1:, 2] + windows.track[:, :-1, 2])
    ahead, starboard = rotate_earth_to_ship(steps[..., 0], steps[..., 1], heading)
    drift_deg = np.rad2deg(np.abs(np.arctan2(starboard.sum(axis=1), ahead.sum(axis=1))))
    third = max(1, seconds // 3)
    first_mps, last_mps = (np.hypot(*part.mean(axis=1).T) for part in (steps[:, :third], steps[:, -third:]))
    speed_change = np.abs(last_mps - first_mps) / np.maximum(0.5 * (first_mps + last_mps), 1e-9)
    slow = way_m / seconds < SLOW_FROUDE * np.sqrt(GRAVITY_MPS2 * length_m)
    rules = {
        "slow": slow,
        "other": drift_deg > SIDEWAYS_DEG,
        "turning": turned_deg / lengths > TURNING_DEG_PER_LENGTH,
        "accelerating": speed_change / lengths > ACCELERATING_PER_LENGTH,
    }
    return np.asarray(np.select(list(rules.values()), list(rules), "straight"))
