"""The sections of the story of a diagnosis that its own page has not: what the model was, and what was added to
it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from analysis.report.page import Page
from hybrid.diagnosis.result import Diagnosis
from hybrid.diagnosis.shown import read_shown
from hybrid.diagnosis.words import number
from hybrid.report import diagnosis_gap as gap_page
from hybrid.report import diagnosis_grounds as grounds_page
from hybrid.report import diagnosis_page as verdict_page
from hybrid.report.diagnosis_page import Extras
from hybrid.report.words import listed, plain

VESSEL = "vessel.toml"


@dataclass(frozen=True, slots=True)
class Story:
    """A diagnosis with all that its page shows, and the vessel file that it wrote."""

    diagnosis: Diagnosis
    extras: Extras
    vessel_file: Path


def load_story(folder: Path | str) -> Story:
    """What ``seatrial diagnose`` wrote into a folder. Raises :class:`InputError` where that is not there."""
    return Story(*read_shown(folder), Path(folder) / VESSEL)


def add_question(page: Page, story: Story) -> None:
    """The verdict in a sentence, large numbers, and what was held against what."""
    known = story.diagnosis.provenance
    page.heading(verdict_page.verdict_sentence(story.diagnosis))
    verdict_page.add_verdict(page, story.diagnosis)
    rows = [["recordings", str(known.get("recordings", ""))], ["model", str(known.get("vessel", ""))],
            ["effects tried", str(known.get("effects_in_catalogue", ""))]]  # fmt: skip
    page.table(["", ""], rows, words=True)


def add_in_short(page: Page, folder: Path | str | None) -> None:
    """The verdict, each effect's sentence and the gap in a few lines; nothing without a diagnosis."""
    if folder is None:
        return
    diagnosis = load_story(folder).diagnosis
    gap = diagnosis.gap
    page.note(
        f"Diagnosis: {verdict_page.verdict_sentence(diagnosis)}. Mean distance over {gap.horizon_s} s on windows "
        f"that took no part: {gap.before_m:.2f} m before, {gap.after_m:.2f} m after."
    )
    for effect in diagnosis.effects:
        page.text(effect.sentence)


def add_found(page: Page, story: Story) -> None:
    """Where model and trial disagree, cell by cell, and whether the sensors agree among themselves."""
    grounds_page.add_map(page, story.diagnosis.where, story.extras.map, story.extras.map_after)
    if story.extras.consistency is not None:
        grounds_page.add_consistency(page, story.extras.consistency)


def add_named(page: Page, story: Story) -> None:
    """What explains it, with its size, what does not fit any name, and what could stand in its place."""
    verdict_page.add_effects(page, story.diagnosis, story.extras.correlation)
    verdict_page.add_unknown(page, story.diagnosis)
    verdict_page.add_rivals(page, story.diagnosis)
    grounds_page.add_suspects(page, story.diagnosis)


def add_added(page: Page, story: Story) -> None:
    """What the vessel file now says, and how to use it."""
    effects = story.diagnosis.effects
    if not effects:
        page.text("Nothing was added: the vessel file says what the model said before.")
        return
    base = str(story.diagnosis.provenance.get("vessel", "the model"))
    page.text(
        f"{listed([plain(each.name) for each in effects]).capitalize()} stand in {story.vessel_file.name}, on top "
        f"of {base}. Every command takes that file: seatrial validate RECORDING --vessel {story.vessel_file.name}."
    )
    lines = [[f"[effects.{each.name}]", f"{name} = {number(estimate.value)}", estimate.unit]
             for each in effects for name, estimate in each.parameters.items()]  # fmt: skip
    page.table(["table", "value", "unit"], lines, words=True)
    sensors = [each.name for each in effects if each.kind == "sensor"]
    if sensors:
        page.text(
            f"{listed([plain(each) for each in sensors]).capitalize()}: that is no fault of the model but of what "
            "was measured. In the file it tells what the sensors would report."
        )


def add_shown(page: Page, story: Story) -> None:
    """The gap before and after on legs that took no part, and what a calibrator adds."""
    gap_page.add_gap(page, story.diagnosis)
    if story.extras.ladder is not None:
        gap_page.add_ladder(page, story.extras.ladder, story.diagnosis.effects)


def add_granted(page: Page, story: Story) -> None:
    """What the verdict rests on."""
    grounds_page.add_granted(page, story.diagnosis)
