"""The sections of a trial's report on what predictions rest on: the model, the training, the parameters."""

from __future__ import annotations

from typing import TYPE_CHECKING

from analysis.report.page import Page
from hybrid.report.case import Case
from hybrid.report.residuals import ENOUGH_S
from hybrid.report.words import listed, plain, quantity_title

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from hybrid.calibrators.adaptive.parameters import Parameter, Parameters


def add_residual_maps(page: Page, case: Case) -> None:
    """Where the model's acceleration is off, and on how many seconds that rests."""
    for name, residuals in case.residuals.items():
        if len(residuals.missing) < ENOUGH_S:
            page.text(f"{name}: {len(residuals.missing)} seconds with all channels are too few for a map.")
            continue

        def draw(figure: Figure, residuals=residuals) -> None:  # type: ignore[no-untyped-def]
            from hybrid.report.map_plots import residual_maps

            residual_maps(figure, residuals)

        page.figure(
            draw,
            (10, 9.5),
            f"Measured less modelled acceleration in cells of two quantities, {len(residuals.missing):,} seconds; "
            "the last row says how many seconds each cell rests on. Grey: too few. Measured ones come from the "
            "smoother, without waves.",
            "residual_maps" if len(case.paths) == 1 else f"residual_maps_{name}",
        )
    if not case.residuals:
        page.text("No trial has all the channels that this takes.")


def add_coverage(page: Page, case: Case) -> None:
    """Whether the trial lies in the range of the training, and what spoke where it did not."""
    judged, ground = case.validation, case.ground
    if ground is None or judged.untrained is None:
        page.text("No calibrator was given, so there is no training that the trial could lie beyond.")
        return
    beyond = int(judged.untrained.sum())
    names = [name for name, column in zip(ground.names, ground.beyond.T, strict=True) if column.any()]
    if beyond:
        spoke = ", ".join(f"{plain(name)} in {count}" for name, count in (judged.fallback or {}).items())
        where = f", in {listed([quantity_title(name) for name in names])}" if names else ""
        page.note(
            f"{beyond} of {len(judged.horizons)} windows start too far beyond what the calibrator was trained "
            f"on{where}; there a baseline speaks: {spoke}."
        )
    past = [name for name, column in zip(ground.names, ground.past.T, strict=True) if column.any()]
    count = int(ground.past.any(axis=1).sum())
    page.text(
        f"{count} of {len(judged.horizons)} windows lie outside the range of the training itself"
        + (f", in {listed([quantity_title(name) for name in past])}" if past else "")
        + "; up to the dashes that is allowed, for a model goes on where a table ends."
    )

    def draw(figure: Figure) -> None:
        from hybrid.report.map_plots import training_range

        training_range(figure.subplots(), ground)

    page.figure(
        draw,
        (8.5, 0.9 + 0.3 * len(ground.names)),
        "The trial's starts against the training: the bar is the range of the training, the line all of the trial, "
        "its thick part the middle 90 %, orange where some start lies beyond the dashes.",
        "training_range",
    )


def add_parameters(page: Page, case: Case) -> None:
    """What the calibrator has learned, how well the data know it, and what cannot be told apart."""
    learned = case.parameters
    if learned is None:
        words = (
            "there is none" if case.trained is None else f"{case.trained.calibrator.method} is a network of weights"
        )
        page.text(f"Parameters that mean something are those of the adaptive calibrator; {words}.")
        return
    known = learned.identified
    if not known:
        page.note("The data know none of the parameters better than was known before.")
        return
    _warn(page, learned)

    def draw(figure: Figure) -> None:
        from hybrid.report.map_plots import correlations, parameter_bars

        left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.25))
        parameter_bars(left, learned)
        shown = min(len(known), 20)
        correlations(right, [each.name for each in known[:shown]], learned.correlation[:shown, :shown])

    page.figure(
        draw,
        (10.5, 5.6),
        "The best known parameters as factors of the model's numbers with 95 % intervals, orange where one lies at "
        "the bound of what is allowed; and how their estimates are correlated.",
        "parameters",
    )
    header = ["parameter", "value", "standard error", "95 % interval", "unit", "remark"]
    page.table(header, [_row(each) for each in known])
    others = [each for each in learned.every if not each.identified]
    with page.details(f"{len(others)} parameters that these data do not know"):
        page.table(header, [_row(each) for each in others])


def _warn(page: Page, learned: Parameters) -> None:
    known, every = len(learned.identified), len(learned.every)
    page.text(
        f"The data know {known} of {every} parameters better than was known before; the others stay near the "
        "model. Several values may do the same together: a prediction is worth more than any of them alone."
    )
    at_bound = [each.name for each in learned.every if each.at_bound]
    if at_bound:
        page.note(f"At the bound of what is allowed: {', '.join(at_bound)}.")
    pairs = learned.entangled()
    if pairs:
        words = ", ".join(f"{one} with {other} ({value:+.2f})" for one, other, value in pairs[:6])
        page.note(f"Cannot be told apart: {words}{', and more' if len(pairs) > 6 else ''}.")


def _row(each: Parameter) -> list[str]:
    remark = "at its bound" if each.at_bound else "" if each.identified else "not known by the data"
    interval = f"{each.low:.4g} to {each.high:.4g}"
    return [each.name, f"{each.value:.4g}", f"\u00b1 {each.error:.2g}", interval, each.unit, remark]
