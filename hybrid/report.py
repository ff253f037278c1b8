"""A validation and a diagnosis on a page: the table of methods, the pictures of their errors, what is missing."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from analysis.page import Page
from hybrid import plots
from hybrid.diagnosis.page import verdict_sentence
from hybrid.diagnosis.result import Diagnosis
from hybrid.scores import distances
from hybrid.validate import Validation


def add_validation(page: Page, validation: Validation) -> None:
    """The table of methods and the pictures of their errors."""
    page.heading(f"Predictions over {validation.horizons.horizon_s} s on {len(validation.horizons)} unseen windows")
    header = ["method", "mean distance [m]", "at the end [m]", "north [m]", "east [m]", "heading [deg]"]
    rows, means = [], []
    for method, score in validation.scores.items():
        numbers = (score.mean_distance_m, score.end_distance_m, score.mae_north_m, score.mae_east_m)
        rows.append(
            [plots.title_of(method), *(f"{each:.2f}" for each in numbers), f"{score.heading_error_deg:.1f}"]
        )
        means.append(score.mean_distance_m)
    page.table(header, rows, best=int(np.argmin(means)))

    def draw_errors(figure: Figure) -> None:
        plots.error_by_second(figure.subplots(), validation)

    page.figure(draw_errors, (7.5, 4), "How the error grows with the time predicted.")
    page.figure(
        lambda figure: _draw_fans(figure, validation),
        (9, 8.5),
        "Four windows, from a usual one to the worst 2 % by the reference's error: measured and predicted tracks, "
        "start at (0, 0) with the bow up.",
    )


def add_diagnosis(page: Page, diagnosis: Diagnosis) -> None:
    """What a diagnosis says, in short; its own report says the rest."""
    page.heading("What the model lacks")
    page.text(f"{verdict_sentence(diagnosis)}.")
    for effect in diagnosis.effects:
        page.text(effect.sentence)
    gap = diagnosis.gap
    page.note(
        f"Mean distance over {gap.horizon_s} s on {gap.held_out_windows} windows that took no part: "
        f"{gap.before_m:.2f} m before, {gap.after_m:.2f} m with what was named, {gap.floor_m:.2f} m at best. "
        "The whole of it: diagnosis/report.html."
    )


def _draw_fans(figure: Figure, validation: Validation) -> None:
    order = np.argsort(distances(validation.tracks["reference"], validation.horizons.track).mean(axis=1))
    chosen = [order[int(share * (len(order) - 1))] for share in (0.5, 0.75, 0.9, 0.98)]
    grid = figure.subplots(2, 2).ravel()
    for axes, window in zip(grid, chosen, strict=True):
        plots.fan(axes, validation, int(window))
        axes.set_title(f"{validation.horizons.start_time[int(window)]:%H:%M:%S} UTC", fontsize=9, loc="left")
    grid[0].legend(loc="best", fontsize=7)


def headline_of(validation: Validation) -> dict[str, str]:
    """The numbers that matter, for people."""
    figures = {f"{plots.title_of(name)}, mean distance": f"{score.mean_distance_m:.2f} m"
               for name, score in validation.scores.items() if name in ("reference", "hybrid")}  # fmt: skip
    if validation.reduction is not None and validation.coverage_95 is not None:
        figures["less error than the reference"] = f"{validation.reduction:.0%}"
        figures["of positions inside the 95 % band"] = f"{validation.coverage_95:.0%}"
    return figures
