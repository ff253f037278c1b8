"""The sections of a trial's report that are about predictions: how far off they are, and how sure of themselves."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from analysis.batch.products import Products
from analysis.report.page import Page
from hybrid.prediction.bootstrap import FEW_LEGS
from hybrid.prediction.scores import distances
from hybrid.report.case import Case
from hybrid.report.errors import QUANTITIES, table_of
from hybrid.report.motion import one_after_another
from hybrid.report.words import listed, plain

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

_FANS = 40  # on one track; more would lie on each other
_SEEN = {
    "nothing": "None has seen these recordings.",
    "another part": "The calibrator was trained on another part of the same recordings.",
    "some": "The calibrator has seen some of this.",
}
_CLOSE = {"a usual window": 0.5, "a hard one": 0.9, "the hardest": 1.0}
_SECONDS = (1, 5, 10, 15, 20, 30, 45, 60)


def add_headline(page: Page, case: Case, remark: str = "") -> None:
    """What matters, large; and what a reader may not miss."""
    if remark:
        page.note(remark)
    if case.why_not:
        page.note(f"Nothing was predicted: {case.why_not}")
        return
    judged = case.validation
    figures = {
        f"{plain(name)}, mean distance over {judged.horizons.horizon_s} s": f"{score.mean_distance_m:.2f} m"
        for name, score in judged.scores.items()
        if name in ("constant_velocity", "reference", "hybrid")
    }
    if judged.reduction is not None and judged.coverage_95 is not None:
        figures["less error than the reference"] = f"{judged.reduction:.0%}"
        figures["of positions inside the 95 % regions"] = f"{judged.coverage_95:.0%}"
    page.headline(figures)
    page.text(model_words(case))
    if case.trained is None:
        page.note("No calibrator was given: constant velocity and the reference model are judged alone.")
    for name, products in case.products.items():
        if (words := doubts_of(products)) is not None:
            page.note(f"{name}: {words}")
    for name, why in case.left_out.items():
        page.note(f"Left out: {name}: {why}")
    if case.seen == "some":
        page.note("The calibrator was trained on some of what it is judged on here: its figures flatter it.")
    if case.part_percent != (0.0, 100.0):
        low, high = case.part_percent
        page.text(f"Predictions are judged from {low:g} to {high:g} % of each recording's time.")
    if judged.outside:
        page.note(f"{judged.outside} windows are left out: the reference model leaves its range in them.")


def model_words(case: Case) -> str:
    """Which model the reference is, of which ship the recordings are, and what the hybrid is."""
    model = case.model_name
    ships = listed(list(dict.fromkeys(each.recording.trial.vessel or "no ship" for each in case.products.values())))
    words = f"The reference is the model {model}; the recordings name {ships}."
    if case.trained is None:
        return words
    trained = case.trained
    recordings = listed([each.path.name for each in trained.sources])
    return (
        f"{words} The hybrid is the calibrator {trained.calibrator.method}, trained on {recordings} "
        f"({trained.metrics.get('windows', 0):,} windows of {trained.horizon_s} s, {trained.trained_at:%Y-%m-%d})."
    )


def doubts_of(products: Products) -> str | None:
    """What of the data is in doubt, in a line; None where nothing is."""
    channels = products.quality.channels
    doubtful = [name for name in channels if channels[name].grade != "good"]
    if not doubtful:
        return None
    codes = dict.fromkeys(each.code.replace("_", " ") for each in products.quality.findings)
    return (
        f"{len(doubtful)} of {len(channels)} channels are not good ({listed(list(codes))}): part of every error "
        "below may be the data's. The section on data quality says more."
    )


def add_baselines(page: Page, case: Case) -> None:
    """Every method in one table, on windows that none has seen."""
    judged = case.validation
    rows = [
        [plain(name), f"{each.mean_distance_m:.3f}", f"{each.end_distance_m:.3f}", f"{each.mae_north_m:.3f}",
         f"{each.mae_east_m:.3f}", f"{each.heading_error_deg:.2f}",
         f"{each.mean_distance_m / judged.scores['reference'].mean_distance_m - 1.0:+.1%}".replace("-", "\u2212")]
        for name, each in judged.scores.items()
    ]  # fmt: skip
    best = int(np.argmin([each.mean_distance_m for each in judged.scores.values()]))
    page.table(["method", "mean distance [m]", "at the end [m]", "north [m]", "east [m]", "heading [deg]",
                "against the reference"], rows, best=best)  # fmt: skip
    legs = len(np.unique(judged.horizons.leg))
    page.text(
        f"Means over {len(judged.horizons)} held windows of {judged.horizons.horizon_s} s in {legs} legs, one "
        f"every {case.stride_s} s; seconds 1 to {judged.horizons.horizon_s}. Constant velocity is dead reckoning, "
        "data driven the network without a model. Networks learn no heading: it is the reference's, for data "
        f"driven the present turn held. {_SEEN[case.seen]} {_dropped(case)}"
    )


def _dropped(case: Case) -> str:
    """How many windows were tried, and why the others are not judged."""
    gathered = case.gathered
    reasons = ", ".join(f"{count:,} {plain(reason)}" for reason, count in gathered.dropped.items() if count)
    return f"Of {gathered.candidates:,} windows tried others were left out: {reasons}." if reasons else ""


def add_by_second(page: Page, case: Case) -> None:
    """Errors by second of the prediction: distance, along, across, heading and speed; median and 90 %."""
    page.figure(
        lambda figure: _draw_by_second(figure, case),
        (9.5, 6),
        "The size of the error that half of the windows stay below, and dashed nine in ten, against the time "
        "predicted. Speeds are differences of positions over two seconds, and what was measured brings its noise.",
        "errors_by_second",
    )
    horizon_s = case.validation.horizons.horizon_s
    seconds = [each for each in _SECONDS if each <= horizon_s]
    for quantity, words in QUANTITIES.items():
        with page.details(f"In numbers: {words}, median and 90 %"):
            rows = [[plain(name), *cells] for name, *cells in table_of(case.errors, quantity, seconds)]
            page.table(["method", *(f"{each} s" for each in seconds)], rows)


def _draw_by_second(figure: Figure, case: Case) -> None:
    from hybrid.report import plots

    grid = figure.subplots(2, 3).ravel()
    for axes, quantity in zip(grid, QUANTITIES, strict=False):
        plots.errors_by_second(axes, case.errors, quantity)
    grid[-1].set_axis_off()
    figure.legend(*grid[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)


def add_fans(page: Page, case: Case) -> None:
    """Predictions from many starts: over the measured tracks, and laid on each other."""
    judged = case.validation
    for name in case.products:
        if not (judged.horizons.trial == name).any():
            continue
        page.figure(
            lambda figure, name=name: _draw_fans(figure, case, name),  # type: ignore[misc]
            (9.5, 8),
            f"Predictions of {judged.horizons.horizon_s} s by {plain(case.best)} over the measured track, "
            + ("with the areas that hold the position with 95 % and, if errors are normal, with 50 %."
               if judged.radius_m is not None else "without a calibrator there are no regions."),
            "prediction_fans" if len(case.paths) == 1 else f"prediction_fans_{name}",
        )  # fmt: skip
    page.figure(
        lambda figure: _draw_error_fans(figure, case),
        (9, 5.5),
        "How predictions from all starts spread about what was measured: ahead and to starboard positive.",
        "error_fans",
    )


def _draw_fans(figure: Figure, case: Case, name: str) -> None:
    """The whole track, and three stretches of it large: a usual one, a hard one and the hardest."""
    from hybrid.report import plots

    judged, table = case.validation, case.products[name].one_hz
    chosen = one_after_another(judged.horizons)
    chosen = chosen[judged.horizons.trial[chosen] == name]
    whole, *close = figure.subplot_mosaic(
        [["whole", "0"], ["whole", "1"], ["whole", "2"]], width_ratios=(1.35, 1.0)
    ).values()

    def draw(axes: Axes, some: NDArray[np.int64]) -> None:
        radius_m = None if judged.radius_m is None else judged.radius_m[some]
        tracks = judged.tracks[case.best][some]
        plots.fans_on_track(axes, table, judged.horizons.subset(some), tracks, radius_m, case.best)

    draw(whole, chosen[np.unique(np.linspace(0, len(chosen) - 1, min(_FANS, len(chosen))).astype(int))])
    error = distances(judged.tracks["reference"], judged.horizons.track).mean(axis=1)
    ranked = chosen[np.argsort(error[chosen], kind="stable")]
    for axes, (words, share) in zip(close, _CLOSE.items(), strict=True):
        number = int(ranked[int(share * (len(ranked) - 1))])
        near = chosen[np.abs(np.flatnonzero(chosen == number)[0] - np.arange(len(chosen))) <= 1]
        draw(axes, near)
        if case.best != "reference":
            plots.tracks_beside(axes, judged.tracks["reference"][near], "reference")
        plots.look_at(axes, judged.horizons.track[number], judged.tracks[case.best][number])
        axes.set_title(f"{words}, {judged.horizons.start_time[number]:%H:%M:%S} UTC", loc="left", fontsize=8.5)
    handles, labels = close[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=6)


def _draw_error_fans(figure: Figure, case: Case) -> None:
    from hybrid.report import plots

    methods = [name for name in ("reference", "hybrid") if name in case.errors]
    grid = figure.subplots(2, len(methods), sharex=True, sharey="row", squeeze=False)
    for column, method in enumerate(methods):
        for row, component in enumerate(("along", "across")):
            plots.fan_of_errors(grid[row, column], case.errors[method], component, method)
            grid[row, column].label_outer()
            grid[row, column].legend(loc="upper left", ncols=3)
        grid[0, column].set_title(plain(method), loc="left")


def add_distributions(page: Page, case: Case) -> None:
    """How errors are distributed by channel and by trial, and whether the regions hold what they say."""
    page.figure(
        lambda figure: _draw_distributions(figure, case),
        (9.5, 6.5),
        "Errors of all windows and seconds by channel, predicted less measured, the outermost 2 % of all methods "
        "beyond the axes; and by trial, boxes from quarter to quarter.",
        "error_distributions",
    )
    if case.calibration is None:
        return
    calibration = case.calibration
    page.figure(
        lambda figure: _draw_calibration(figure, case),
        (9, 3.6),
        "Whether the 95 % regions hold what they say: the share inside with its 95 % interval, from drawing "
        "legs anew; and how distances lie within the regions, which is even where errors are normal.",
        "region_calibration",
    )
    seconds = [each for each in _SECONDS if each <= len(calibration.picp)]
    page.table(
        ["", *(f"{each} s" for each in seconds)],
        [["inside, PICP [%]", *(f"{100 * calibration.picp[each - 1]:.1f}" for each in seconds)],
         ["width over mean way covered, PINAW [1]", *(_share(calibration.pinaw[each - 1]) for each in seconds)]],
    )  # fmt: skip
    if calibration.legs < FEW_LEGS:
        legs = "one leg, which has no interval" if calibration.legs < 2 else f"{calibration.legs} legs: too few"
        page.text(f"The interval of the share inside rests on {legs}, so it is too narrow at best.")


def _share(value: float) -> str:
    return f"{value:.3f}" if np.isfinite(value) else "\u2013"


def _draw_distributions(figure: Figure, case: Case) -> None:
    from hybrid.report import plots

    above, below = np.asarray(figure.subfigures(2, 1))
    for axes, quantity in zip(above.subplots(1, 4), ("along", "across", "heading", "speed"), strict=True):
        plots.error_histogram(axes, case.errors, quantity)
    above.legend(*above.axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=4)
    trial = case.validation.horizons.trial
    split = {name: each.by_trial(trial) for name, each in case.errors.items()}
    names = list(dict.fromkeys(trial.tolist()))
    plots.error_spread(
        below.subplots(), {name: {method: split[method][name] for method in split} for name in names}
    )


def _draw_calibration(figure: Figure, case: Case) -> None:
    from hybrid.report import plots

    left, right = figure.subplots(1, 2)
    if case.calibration is not None:
        plots.coverage_by_second(left, case.calibration)
        plots.transform_histogram(right, case.calibration)
