"""A diagnosis on a page, for a naval architect: what the model lacks, how sure that is, and what it changes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from analysis.report.page import Page
from hybrid.diagnosis.result import Correlation, Diagnosis, Estimate, Ladder, NamedEffect
from hybrid.diagnosis.words import DEPENDS, alternatives, chance, number, parameter_title, percent
from hybrid.report.diagnosis_gap import add_gap, add_ladder
from hybrid.report.diagnosis_grounds import add_consistency, add_granted, add_map, add_suspects
from hybrid.report.words import listed, plain

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from hybrid.diagnosis.map import Map
    from hybrid.diagnosis.sensor_consistency import Consistency

PAGE_FILE = "report.html"


@dataclass(frozen=True, slots=True)
class Extras:
    """What the page shows beside the diagnosis: the map of the reference model and of the repaired one, the
    sensors' contradictions, how the estimates are correlated, and what a calibrator adds (None where nobody
    looked)."""

    map: Map | None = None
    map_after: Map | None = None
    consistency: Sequence[Consistency] | None = None
    ladder: Ladder | None = None
    correlation: Correlation | None = None


def write_report(diagnosis: Diagnosis, extras: Extras, folder: Path) -> Path:
    """Write the page into ``folder`` and return its path. Raises :class:`StorageError`."""
    return page_of(diagnosis, extras).write(folder / PAGE_FILE)


def page_of(diagnosis: Diagnosis, extras: Extras) -> Page:
    """The page, not yet written."""
    page = Page(verdict_sentence(diagnosis), _about(diagnosis))
    add_verdict(page, diagnosis)
    add_effects(page, diagnosis, extras.correlation)
    add_unknown(page, diagnosis)
    add_rivals(page, diagnosis)
    add_gap(page, diagnosis)
    if extras.ladder is not None:
        add_ladder(page, extras.ladder, diagnosis.effects)
    add_map(page, diagnosis.where, extras.map, extras.map_after)
    add_suspects(page, diagnosis)
    if extras.consistency is not None:
        add_consistency(page, extras.consistency)
    add_granted(page, diagnosis)
    return page


def add_verdict(page: Page, diagnosis: Diagnosis) -> None:
    """The numbers that matter and what the verdict means."""
    page.headline(_headline(diagnosis))
    page.text(_meaning(diagnosis))


def verdict_sentence(diagnosis: Diagnosis) -> str:
    """The verdict in one plain sentence."""
    named = _named(diagnosis.effects)
    if diagnosis.verdict == "nothing_missing":
        return "Nothing is missing that this trial could show"
    if diagnosis.verdict == "unknown":
        return f"{named + ', and s' if named else 'S'}omething is missing that no effect of the catalogue explains"
    if diagnosis.verdict == "indistinguishable":
        groups = [alternatives(group, _names(diagnosis)) for group in diagnosis.indistinguishable]
        return f"This trial cannot say which is missing: {'; '.join(groups)}"
    return named


def _names(diagnosis: Diagnosis) -> list[str]:
    return [each.name for each in diagnosis.effects]


def _named(effects: Sequence[NamedEffect]) -> str:
    """What the model lacks and what the sensors show, as a sentence; nothing without effects."""
    lacks = [plain(each.name) for each in effects if each.kind != "sensor"]
    shown = [plain(each.name) for each in effects if each.kind == "sensor"]
    parts = [f"the model lacks {listed(lacks)}"] if lacks else []
    parts += [f"the sensors show {listed(shown)}"] if shown else []
    sentence = ", and ".join(parts)
    return sentence[:1].upper() + sentence[1:]


def _about(diagnosis: Diagnosis) -> str:
    known = diagnosis.provenance
    parts = [str(known.get("recordings", "")), f"vessel {known['vessel']}" if "vessel" in known else ""]
    return "; ".join(["Diagnosis", *(each for each in parts if each)])


def _headline(diagnosis: Diagnosis) -> dict[str, str]:
    gap = diagnosis.gap
    figures = {
        f"error over {gap.horizon_s} s before": f"{gap.before_m:.2f} m",
        "after": f"{gap.after_m:.2f} m",
        "what noise alone leaves": f"{gap.floor_m:.2f} m",
    }
    if diagnosis.effects:
        figures["of what could be closed is closed"] = f"{percent(gap.closed)}"
    figures["of the force range: error granted to the model"] = f"{percent(diagnosis.tolerance)}"
    return figures


def _meaning(diagnosis: Diagnosis) -> str:
    gap = diagnosis.gap
    judged = (
        f"Errors are mean distances between predicted and measured tracks over {gap.held_out_windows} windows of "
        f"{gap.horizon_s} s that took no part in naming or fitting."
    )
    says = {
        "named": "Every effect named stands by itself: it is no chance among all that were tried, and it predicts "
        "legs that were left out.",
        "nothing_missing": "That holds within what the model and the sensors are granted; how large each effect "
        "could be and stay hidden stands in the ranking below.",
        "unknown": "Something remains above the noise that has structure; what it depends on stands below. A name "
        "is not given to it, because none fits.",
        "indistinguishable": "What is listed together explains the trial equally well.",
    }
    after = " The manoeuvre that would separate it best stands below." if diagnosis.next_manoeuvre else ""
    return f"{says[diagnosis.verdict]}{after} {judged}"


def add_effects(page: Page, diagnosis: Diagnosis, correlation: Correlation | None = None) -> None:
    """What was named: in words, in numbers, and how the estimates hang together."""
    effects = diagnosis.effects
    if not effects:
        return
    page.heading("What was named")
    for each in effects:
        page.statement(plain(each.name), _certainty(each), each.sentence)
    rows = [
        [
            plain(each.name),
            parameter_title(name, estimate.unit),
            number(estimate.value),
            _interval(estimate),
            "" if estimate.unit == "1" else estimate.unit,
        ]
        for each in effects
        for name, estimate in each.parameters.items()
    ]
    page.table(["effect", "parameter", "value", "95 % interval", "unit"], rows)

    def draw(figure: Figure) -> None:
        from hybrid.report import diagnosis_plots as plots

        plots.parameters(figure, effects)

    caption = "Every parameter with its 95 % interval; the line is where the effect would be absent."
    page.figure(draw, (8, 0.35 + 0.75 * len(rows)), caption, "parameters")
    if correlation is not None and len(correlation.names) > 1:
        _add_correlation(page, correlation)


def _add_correlation(page: Page, correlation: Correlation) -> None:
    """How the estimates hang together, and which of them cannot be told apart."""
    for one, other, value in correlation.entangled():
        page.note(
            f"The sizes of {one} and {other} cannot be told apart: their estimates are correlated by {value:+.2f}."
        )
    with page.details("How the estimates are correlated"):
        rows = [[name, *(f"{each:+.2f}".replace("-", "\u2212") for each in row)]
                for name, row in zip(correlation.names, correlation.matrix.tolist(), strict=True)]  # fmt: skip
        page.table(["", *correlation.names], rows)


def _certainty(effect: NamedEffect) -> str:
    family = effect.family if effect.family == effect.kind else f"{effect.family}, {effect.kind}"
    return (
        f"{family}; {percent(effect.share_of_gap)} of the gap; by chance {chance(effect.p_value)}; "
        f"log evidence {number(effect.evidence)}"
    )


def add_unknown(page: Page, diagnosis: Diagnosis) -> None:
    """What no effect of the catalogue explains."""
    unknown = diagnosis.unknown
    page.heading("What remains")
    if unknown is None:
        page.text("Nothing that stands out of the noise and of what the model is granted.")
        return
    page.note(f"It looks like {unknown.looks_like}; it keeps {percent(unknown.share_of_gap)} of the gap open.")
    if unknown.where:
        page.text(f"It goes with {listed([DEPENDS.get(each, plain(each)) for each in unknown.where])}.")


def add_rivals(page: Page, diagnosis: Diagnosis) -> None:
    """What could stand in the place of what was named, and which manoeuvre would tell."""
    if not diagnosis.rivals and not diagnosis.indistinguishable and diagnosis.next_manoeuvre is None:
        return
    page.heading("What could stand in its place")
    for group in diagnosis.indistinguishable:
        page.note(f"This trial cannot tell {alternatives(group, _names(diagnosis), 'from')}.")
    if diagnosis.rivals:
        count = min(len(diagnosis.rivals), 15)

        def draw(figure: Figure) -> None:
            from hybrid.report import diagnosis_plots as plots

            plots.confusion(figure.subplots(), diagnosis.rivals)

        page.figure(
            draw,
            (8, 0.9 + 0.36 * count),
            "How much log evidence each rival lacks against what was named in its place. Left of the line the "
            "trial cannot tell the two apart.",
            "rivals",
        )
    after = diagnosis.next_manoeuvre
    if after is not None:
        one, other = (plain(each) for each in after.separates)
        page.text(f"To tell {one} from {other}: {after.what}; expected log evidence {after.expected_evidence:.0f}.")


def _interval(estimate: Estimate) -> str:
    return f"{number(estimate.low)} to {number(estimate.high)}"
