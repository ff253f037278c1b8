"""A diagnosis on a page, for a naval architect: what the model lacks, how sure that is, and what it changes."""

from __future__ import annotations

from pathlib import Path

from analysis.report.rendering import Page, render
from hybrid.diagnosis.result import Diagnosis, Extras
from hybrid.report.diagnosis_words import verdict_sentence
from hybrid.report.notebook import templates

PAGE_FILE = "report.html"


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
