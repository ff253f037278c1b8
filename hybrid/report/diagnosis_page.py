"""A diagnosis on a page, for a naval architect: what the model lacks, how sure that is, and what it changes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from analysis.report.rendering import Page, render
from hybrid.diagnosis.result import Correlation, Diagnosis, Ladder
from hybrid.report.diagnosis_words import verdict_sentence
from hybrid.report.show import templates

if TYPE_CHECKING:
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
    known = diagnosis.provenance
    parts = [
        "Diagnosis",
        str(known.get("recordings", "")),
        f"vessel {known['vessel']}" if "vessel" in known else "",
    ]
    return render(
        "diagnosis.html", templates=templates(), title=verdict_sentence(diagnosis),
        subtitle="; ".join(each for each in parts if each), diagnosis=diagnosis, extras=extras,
    )  # fmt: skip
