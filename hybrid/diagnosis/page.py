"""A diagnosis on a page, for a naval architect: what the model lacks, how sure that is, and what it changes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from analysis.page import Page
from hybrid.diagnosis.result import Diagnosis, Estimate, NamedEffect, Place, Suspect
from hybrid.diagnosis.words import listed, number, parameter_title, percent, plain

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from hybrid.diagnosis.kinematics import Consistency
    from hybrid.diagnosis.where import Map

PAGE_FILE = "report.html"

_SMALL = 0.001


@dataclass(frozen=True, slots=True)
class Extras:
    """What the page shows beside the diagnosis: the map of the reference model and of the repaired one, and the
    sensors' contradictions (None where nobody looked)."""

    map: Map | None = None
    map_after: Map | None = None
    consistency: Sequence[Consistency] | None = None


def write_report(diagnosis: Diagnosis, extras: Extras, folder: Path) -> Path:
    """Write the page into ``folder`` and return its path. Raises :class:`StorageError`."""
    return page_of(diagnosis, extras).write(folder / PAGE_FILE)


def page_of(diagnosis: Diagnosis, extras: Extras) -> Page:
    """The page, not yet written."""
    page = Page(verdict_sentence(diagnosis), _about(diagnosis))
    page.headline(_headline(diagnosis))
    page.text(_meaning(diagnosis))
    _add_effects(page, diagnosis)
    _add_unknown(page, diagnosis)
    _add_rivals(page, diagnosis)
    _add_gap(page, diagnosis)
    _add_map(page, diagnosis, extras)
    _add_suspects(page, diagnosis)
    _add_consistency(page, extras)
    _add_granted(page, diagnosis)
    return page


def verdict_sentence(diagnosis: Diagnosis) -> str:
    """The verdict in one plain sentence."""
    named = _named(diagnosis.effects)
    if diagnosis.verdict == "nothing_missing":
        return "Nothing is missing that this trial could show"
    if diagnosis.verdict == "unknown":
        return f"{named + ', and s' if named else 'S'}omething is missing that no effect of the catalogue explains"
    if diagnosis.verdict == "indistinguishable":
        groups = [listed([plain(name) for name in group], "or") for group in diagnosis.indistinguishable]
        return f"This trial cannot say which is missing: {'; '.join(groups)}"
    return named


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
    files = [Path(str(each)).name for each in known.get("files", ())]
    parts = [", ".join(files), f"vessel {known['vessel']}" if "vessel" in known else ""]
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
    figures["of the force range granted to the model"] = f"{percent(diagnosis.tolerance)}"
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
        "indistinguishable": "What is listed together explains the trial equally well. The manoeuvre that would "
        "separate them stands below.",
    }
    return f"{says[diagnosis.verdict]} {judged}"


def _add_effects(page: Page, diagnosis: Diagnosis) -> None:
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
            unit_of(estimate),
        ]
        for each in effects
        for name, estimate in each.parameters.items()
    ]
    page.table(["effect", "parameter", "value", "95 % interval", "unit"], rows)

    def draw(figure: Figure) -> None:
        from hybrid.diagnosis import plots

        plots.parameters(figure, effects)

    caption = "Every parameter with its 95 % interval; the line is where the effect would be absent."
    page.figure(draw, (8, 0.35 + 0.75 * len(rows)), caption)


def _certainty(effect: NamedEffect) -> str:
    family = effect.family if effect.family == effect.kind else f"{effect.family}, {effect.kind}"
    return (
        f"{family}; {percent(effect.share_of_gap)} of the gap; by chance {_chance(effect.p_value)}; "
        f"log evidence {number(effect.evidence)}"
    )


def _chance(p_value: float) -> str:
    return f"p < {_SMALL:g}" if p_value < _SMALL else f"p = {p_value:.2g}"


def _add_unknown(page: Page, diagnosis: Diagnosis) -> None:
    unknown = diagnosis.unknown
    page.heading("What remains")
    if unknown is None:
        page.text("Nothing that stands out of the noise and of what the model is granted.")
        return
    page.note(f"It looks like {unknown.looks_like}; it keeps {percent(unknown.share_of_gap)} of the gap open.")
    if unknown.where:
        page.text(f"It goes with {listed([plain(each) for each in unknown.where])}.")


def _add_rivals(page: Page, diagnosis: Diagnosis) -> None:
    if not diagnosis.rivals and not diagnosis.indistinguishable and diagnosis.next_manoeuvre is None:
        return
    page.heading("What could stand in its place")
    for group in diagnosis.indistinguishable:
        page.note(f"This trial cannot tell {listed([plain(each) for each in group], 'from')}.")
    if diagnosis.rivals:
        count = min(len(diagnosis.rivals), 15)

        def draw(figure: Figure) -> None:
            from hybrid.diagnosis import plots

            plots.confusion(figure.subplots(), diagnosis.rivals)

        page.figure(
            draw,
            (8, 0.9 + 0.36 * count),
            "How much log evidence each rival lacks against what was named in its place. Left of the line the "
            "trial cannot tell the two apart.",
        )
    after = diagnosis.next_manoeuvre
    if after is not None:
        one, other = (plain(each) for each in after.separates)
        page.text(f"To tell {one} from {other}: {after.what}; expected log evidence {after.expected_evidence:.0f}.")


def _add_gap(page: Page, diagnosis: Diagnosis) -> None:
    from hybrid.diagnosis import plots

    page.heading("The gap, before and after")
    page.figure(
        lambda figure: _drawn(plots.gap(figure.subplots(), diagnosis)),
        (8, 1.0 + 0.34 * (3 + len(diagnosis.effects))),
        "What each named effect takes off the error on held-out windows. The floor is the error of the model with "
        "all that was named at its best: noise, gusts and waves that nobody can predict.",
    )
    tracks = None if diagnosis.tracks is None else plots.whole_windows(diagnosis.tracks)
    if tracks is None or not len(tracks.measured):
        return
    page.figure(
        lambda figure: _drawn(plots.error_by_second(figure.subplots(), tracks)),
        (8, 3.4),
        "How the error grows with the time predicted, mean over all held-out windows. From before down to the "
        "floor is what could be closed, from before down to after is what is. The floor is the model with the "
        "sizes that all legs together give: what is left there is noise, gusts and waves.",
    )
    page.figure(
        lambda figure: _drawn(plots.window_tracks(figure, tracks)),
        (9.5, 3.6),
        "Some held-out windows, bow up at their start and to scale; each with its mean distance before and after.",
    )


def _add_map(page: Page, diagnosis: Diagnosis, extras: Extras) -> None:
    if extras.map is None and not diagnosis.where:
        return
    page.heading("Where the gap was")
    if extras.map is not None:
        _draw_map(
            page,
            extras.map,
            "The steady force that the model lacks in each cell of the trial. The colour says how sure it is, in "
            "standard errors that hold what model and sensors are granted: red to starboard, ahead or clockwise, "
            "blue the other way; grey numbers do not stand out.",
        )
        _draw_residual(page, extras.map)
    if diagnosis.where:
        with page.details("The cells that stand out most, forces and errors of one second"):
            page.table(["channel", "cell", "seconds", "error", "z"], [_cell_row(each) for each in diagnosis.where])
    if extras.map_after is not None and extras.map_after.places:
        with page.details("The same map with the named effects in the model"):
            _draw_map(page, extras.map_after, "What the model still lacks when the named effects are in it.")


def _draw_map(page: Page, made: Map, caption: str) -> None:
    from hybrid.diagnosis import map_plots

    if made.places:
        page.figure(
            lambda figure: _drawn(map_plots.force_map(figure, made.places)),
            (9.5, map_plots.map_height_inch(made.places)),
            caption,
        )


def _draw_residual(page: Page, made: Map) -> None:
    from hybrid.diagnosis import map_plots

    most = map_plots.depends_most(made)
    if most is not None:
        page.figure(
            lambda figure: _drawn(map_plots.residual_force(figure.subplots(), made, *most)),
            (8, 3.2),
            "The force that differs most between cells, against what it differs with.",
        )


def _cell_row(place: Place) -> list[str]:
    from hybrid.diagnosis.map_plots import CHANNELS, QUANTITIES, cell_name, quantity_of

    cell = f"{QUANTITIES.get(quantity_of(place), plain(quantity_of(place)))}: {cell_name(place)}"
    return [
        CHANNELS.get(place.channel, plain(place.channel)),
        cell,
        str(place.windows),
        number(place.error),
        f"{place.z:.1f}",
    ]


def _add_suspects(page: Page, diagnosis: Diagnosis) -> None:
    suspects = diagnosis.suspects
    if not suspects:
        return
    page.heading("All suspects")

    def draw(figure: Figure) -> None:
        from hybrid.diagnosis import plots

        plots.ranking(figure.subplots(), suspects, [each.name for each in diagnosis.effects])

    page.figure(
        draw,
        (8, 1.0 + 0.27 * min(len(suspects), 15)),
        "Each effect of the catalogue alone in the model; what was named has a dark edge. Effects that look alike "
        "share their evidence here: what counts is what is left when the named ones are in the model.",
    )
    with page.details(f"All {len(suspects)} effects, and how large each must be to be found in such a trial"):
        page.table(["effect", "family", "log evidence alone", "chance", "found from"], _suspect_rows(suspects))


def _suspect_rows(suspects: Sequence[Suspect]) -> list[list[str]]:
    return [
        [plain(each.name), each.family, number(each.evidence), _chance(each.p_value),
         f"{number(each.limit)} {'' if each.unit == '1' else each.unit}" if each.limit == each.limit else ""]
        for each in suspects
    ]  # fmt: skip


def _add_consistency(page: Page, extras: Extras) -> None:
    if extras.consistency is None:
        return
    page.heading("Do the sensors agree?")
    page.text(
        "Whatever moves the ship, speeds turned by the heading must add up to the track, and yaw rates to the "
        "heading. This needs no ship model."
    )
    if not extras.consistency:
        page.text("They do, within what each is granted.")
    for each in extras.consistency:
        page.statement(plain(each.effect), _chance(each.p_value), each.sentence)


def _add_granted(page: Page, diagnosis: Diagnosis) -> None:
    page.heading("What was granted, and what was said on the way")
    known = dict(diagnosis.provenance)
    extent, noise = known.pop("force_range", None), known.pop("noise", None)
    rows = [["tolerance", f"{percent(diagnosis.tolerance)} of the range of the forces in the trial"]]
    if extent:
        kilo = [number(diagnosis.tolerance * extent[name] / 1e3) for name in ("surge_n", "sway_n", "yaw_nm")]
        rows.append(["which is", f"{kilo[0]} kN ahead, {kilo[1]} kN across, {kilo[2]} kN m in yaw"])
    rows += [[plain(str(key)), _words(value)] for key, value in known.items()]
    page.table(["", ""], rows, words=True)
    for each in diagnosis.remarks:
        page.text(f"{each[:1].upper()}{each[1:]}.")
    if noise:
        with page.details("Levels of noise, as the data have them"):
            page.table(["", ""], [[plain(key), _words(value)] for key, value in noise.items()], words=True)


def _words(value: Any) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{plain(str(key))} {_words(each)}" for key, each in value.items())
    if isinstance(value, list | tuple):
        return ", ".join(_words(each) for each in value)
    return number(value) if isinstance(value, float) else str(value)


def unit_of(estimate: Estimate) -> str:
    """The unit for people: none of a factor."""
    return "" if estimate.unit == "1" else estimate.unit


def _interval(estimate: Estimate) -> str:
    return f"{number(estimate.low)} to {number(estimate.high)}"


def _drawn(artists: object) -> None:
    """A figure's drawing returns nothing."""
