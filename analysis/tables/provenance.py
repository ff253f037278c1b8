"""Where a product comes from: the recording with its hash, the trial, the software, the options, what was done.

There is no time of day and no folder in it, so that the same input gives the same bytes anywhere.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from acquisition.recording.trial import software_version
from analysis.tables.history import history_of


def provenance_of(
    table: pd.DataFrame, options: Mapping[str, Any] | None = None, recording: Path | None = None
) -> dict[str, Any]:
    """How a table came about: software, recording with its SHA-256, options, trial, and the history step by step.

    ``recording`` is the file it was read from, where the table's ``attrs`` do not say. One that is no longer
    there has no hash (None).
    """
    said = table.attrs.get("recording")
    path = recording or (Path(str(said)) if said else None)
    trial = {key: value for key, value in table.attrs.get("trial", {}).items() if value not in (None, "")}
    return {
        "software_version": software_version(),
        "recording": path.name if path else "",
        "recording_sha256": sha256_of(path) if path else None,
        "options": dict(options or {}),
        "history": history_of(table),
        "trial": trial,
    }


def sha256_of(path: Path) -> str | None:
    """The SHA-256 of a file in hexadecimal; None where it cannot be read."""
    try:
        with path.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    except OSError:
        return None
