"""The gap on a diagnosis's page: before, after, at its floor, and with a calibrator on top."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from typing import TYPE_CHECKING

from analysis.report.page import Page
from hybrid.diagnosis.result import Diagnosis, Ladder, NamedEffect
from hybrid.diagnosis.words import number, percent
from hybrid.prediction.scores import FEW_LEGS, Interval

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_TITLES = {
    "constant_velocity": "present motion held",
    "reference": "reference",
    "named": "named",
    "reference_calibrated": "reference, calibrated",
    "named_calibrated": "named, calibrated",
}


_FLOOR = (
    " From before down to the floor is what could be closed, from before down to after is what is. The floor is "
    "the model with the sizes that all legs together give."
)


def add_gap(page: Page, diagnosis: Diagnosis) -> None:
    """The gap, the error by second and some windows."""
    from hybrid.report import diagnosis_plots as plots

    known = diagnosis.unknown is None
    floor = (
        "the error of the model with all that was named at its best: noise, gusts and waves that nobody can predict"
        if known
        else "what the levels of noise, gusts and waves alone would leave"
    )
    page.heading("The gap, before and after")
    page.figure(
        lambda figure: plots.gap(figure.subplots(), diagnosis),
        (8, 1.0 + 0.34 * (3 + len(diagnosis.effects))),
        f"What each named effect takes off the error on held-out windows. The floor is {floor}.",
        "gap",
    )
    tracks = None if diagnosis.tracks is None else plots.whole_windows(diagnosis.tracks)
    if tracks is None or not len(tracks.measured):
        return
    page.figure(
        lambda figure: plots.error_by_second(figure.subplots(), tracks, known),
        (8, 3.4),
        f"How the error grows with the time predicted, mean over all held-out windows.{_FLOOR if known else ''}",
        "errors_by_second",
    )
    page.figure(
        lambda figure: plots.window_tracks(figure, tracks),
        (9.5, 3.6),
        "Some held-out windows, bow up at their start and to scale; each with its mean distance before and after.",
        "windows",
    )


def add_ladder(page: Page, ladder: Ladder, effects: Sequence[NamedEffect]) -> None:
    """What a calibrator adds to the reference and to the named model; one line where that cannot be said."""
    page.heading("With a calibrator on top")
    if not ladder.rungs:
        page.text(ladder_sentence(ladder))
        return
    page.note(ladder_sentence(ladder))

    def draw(figure: Figure) -> None:
        from hybrid.report import diagnosis_plots as plots

        plots.ladder(figure.subplots(), {_TITLES[name]: each for name, each in ladder.rungs.items()})

    page.figure(
        draw,
        (8, 0.9 + 0.34 * len(ladder.rungs)),
        f"Mean distance over {ladder.horizon_s} s on {ladder.windows} windows of {ladder.legs} legs with held "
        "thrusters that took no part, neither in naming nor in training; bars are 95 % intervals, from drawing "
        "legs anew.",
    )
    rows = [[_TITLES[name], number(each.value), _ends(each), _by_calibrator(ladder, name)]
            for name, each in ladder.rungs.items()]  # fmt: skip
    best = min(range(len(rows)), key=lambda row: list(ladder.rungs.values())[row].value)
    page.table(["", "mean distance [m]", "95 % interval [m]", "by the calibrator"], rows, best=best)
    page.text(
        "Here the thrusters stay as they are at a window's start; in the gap above they move as measured. What is "
        "not calibrated starts from a state smoothed with some seconds after the start as well, which flatters it "
        "a little; a calibrator knows only what was measured before."
    )
    if any(each.kind == "sensor" for each in effects):
        page.text(
            "Tracks start from and are compared with what the sensors report: what was named of them stays in the "
            "errors of every rung."
        )
    if ladder.legs < FEW_LEGS:
        page.text("So few legs make the intervals too narrow.")


def ladder_sentence(ladder: Ladder) -> str:
    """What a calibrator adds, and whether it gains from what was named, in one sentence; or why nobody can say."""
    rungs, ratios = ladder.rungs, ladder.ratios
    if not rungs:
        return f"No calibrator was trained: {ladder.why_not}."
    errors = {name: f"{number(each.value)} m" for name, each in rungs.items()}
    reference = f"On legs that took no part the reference errs by {errors['reference']}"
    if "named" not in rungs:
        change = change_of(ratios["reference_calibrated", "reference"])
        return f"{reference}, with a calibrator on top by {errors['reference_calibrated']}: {change}."
    ratio = ratios["named_calibrated", "reference_calibrated"]
    helps = "what was named helps the calibrator"
    if ratio.low > 1.0:
        helps = "what was named does not help the calibrator"
    elif not ratio.high < 1.0:
        helps = "these legs do not show that what was named helps the calibrator"
    return (
        f"{reference}, with what was named by {errors['named']}, with a calibrator by "
        f"{errors['reference_calibrated']}, with both by {errors['named_calibrated']}: {helps}, {change_of(ratio)}."
    )


def change_of(ratio: Interval) -> str:
    """A ratio of errors in words, with its 95 % interval.

    >>> change_of(Interval(0.8, 0.7, 0.9)), change_of(Interval(0.98, 0.95, 1.02))
    ('20 % less error (10 to 30 %)', '2 % less error (5 % less to 2 % more)')
    """
    value, low, high = (each - 1.0 for each in (ratio.value, ratio.low, ratio.high))
    said = f"{percent(abs(value))} {_more(value)} error"
    if not (isfinite(low) and isfinite(high)):
        return said
    if low * high > 0.0:
        near, far = sorted((abs(low), abs(high)))
        return f"{said} ({percent(near).removesuffix(' %')} to {percent(far)})"
    return f"{said} ({percent(-low)} less to {percent(high)} more)"


def _more(change: float) -> str:
    return "more" if change > 0.0 else "less"


def _by_calibrator(ladder: Ladder, name: str) -> str:
    base = name.removesuffix("_calibrated")
    return change_of(ladder.ratios[name, base]) if name != base else ""


def _ends(interval: Interval) -> str:
    return f"{number(interval.low)} to {number(interval.high)}" if isfinite(interval.low) else ""
