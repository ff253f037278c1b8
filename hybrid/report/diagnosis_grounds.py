"""What a diagnosis rests on, on its page: where the gap was, all suspects, the sensors, what was granted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from analysis.report.page import Page
from hybrid.diagnosis.result import Diagnosis, Place, Suspect
from hybrid.diagnosis.words import chance, number, percent
from hybrid.report.words import plain

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from hybrid.diagnosis.map import Map
    from hybrid.diagnosis.sensor_consistency import Consistency


def add_map(page: Page, places: Sequence[Place], before: Map | None, after: Map | None) -> None:
    """The map of the reference model, the cells that stand out, and the map of the repaired model."""
    if before is None and not places:
        return
    page.heading("Where the gap was")
    if before is not None:
        _draw_map(
            page,
            before,
            "The steady force that the model lacks in each cell of the trial. The colour says how sure it is, in "
            "standard errors that hold what model and sensors are granted: orange to starboard, ahead or "
            "clockwise, blue the other way; grey numbers do not stand out.",
            "force_map",
        )
        _draw_residual(page, before)
    if places:
        with page.details("The cells that stand out most, forces and errors of one second"):
            page.table(["channel", "cell", "seconds", "error", "z"], [_cell_row(each) for each in places])
    if after is not None and after.places:
        with page.details("The same map with the named effects in the model"):
            _draw_map(
                page, after, "What the model still lacks when the named effects are in it.", "force_map_after"
            )


def _draw_map(page: Page, made: Map, caption: str, name: str) -> None:
    from hybrid.report import diagnosis_map_plots as map_plots

    if made.places:
        page.figure(
            lambda figure: map_plots.force_map(figure, made.places),
            (9.5, map_plots.map_height_inch(made.places)),
            caption,
            name,
        )


def _draw_residual(page: Page, made: Map) -> None:
    from hybrid.report import diagnosis_map_plots as map_plots

    most = map_plots.depends_most(made)
    if most is not None:
        page.figure(
            lambda figure: map_plots.residual_force(figure.subplots(), made, *most),
            (8, 3.2),
            "The force that differs most between cells, against what it differs with.",
            "force_that_differs_most",
        )


def _cell_row(place: Place) -> list[str]:
    from hybrid.report.diagnosis_map_plots import CHANNELS, QUANTITIES, cell_name, quantity_of

    cell = f"{QUANTITIES.get(quantity_of(place), plain(quantity_of(place)))}: {cell_name(place)}"
    return [
        CHANNELS.get(place.channel, plain(place.channel)),
        cell,
        str(place.windows),
        number(place.error),
        f"{place.z:.1f}",
    ]


def add_suspects(page: Page, diagnosis: Diagnosis) -> None:
    """The catalogue ranked, each effect alone in the model."""
    suspects = diagnosis.suspects
    if not suspects:
        return
    page.heading("All suspects")

    def draw(figure: Figure) -> None:
        from hybrid.report import diagnosis_plots as plots

        plots.ranking(figure.subplots(), suspects, [each.name for each in diagnosis.effects])

    page.figure(
        draw,
        (8, 1.0 + 0.27 * min(len(suspects), 15)),
        "Each effect of the catalogue alone in the model; what was named has a dark edge. Effects that look alike "
        "share their evidence here: what counts is what is left when the named ones are in the model.",
        "suspects",
    )
    with page.details(f"All {len(suspects)} effects, and how large each must be to be found in such a trial"):
        page.table(["effect", "family", "log evidence alone", "chance", "found from"], _suspect_rows(suspects))


def _suspect_rows(suspects: Sequence[Suspect]) -> list[list[str]]:
    return [
        [plain(each.name), each.family, number(each.evidence), chance(each.p_value),
         f"{number(each.limit)} {'' if each.unit == '1' else each.unit}" if each.limit == each.limit else ""]
        for each in suspects
    ]  # fmt: skip


def add_consistency(page: Page, found: Sequence[Consistency]) -> None:
    """Whether the sensors contradict each other, which needs no model."""
    page.heading("Do the sensors agree?")
    page.text(
        "Whatever moves the ship, speeds turned by the heading must add up to the track, and yaw rates to the "
        "heading. This needs no ship model."
    )
    if not found:
        page.text("They do, within what each is granted.")
    for each in found:
        page.statement(plain(each.effect), chance(each.p_value), each.sentence)


def add_granted(page: Page, diagnosis: Diagnosis) -> None:
    """What the verdict rests on: tolerance, noise, provenance, remarks."""
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
