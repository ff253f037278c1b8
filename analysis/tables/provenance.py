"""Where a table comes from and what was done to it: carried in its ``attrs`` and written into every product.

There is no time of day and no folder in it, so that the same input gives the same bytes anywhere.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from acquisition.core.errors import InputError
from acquisition.core.trial import software_version


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


HISTORY_KEY = "history"


def add_step(table: pd.DataFrame, step: str, **options: Any) -> pd.DataFrame:
    """``table`` with one more step in its history: its name, the version of Seatrial and the options.

    The data are shared with ``table``; only the history is new.
    """
    result = table.copy(deep=False)
    entry = {"step": step, "version": software_version(), "options": options}
    result.attrs = {**table.attrs, HISTORY_KEY: [*history_of(table), entry]}
    return result


def history_of(table: pd.DataFrame) -> list[dict[str, Any]]:
    """The steps so far, the oldest first."""
    return list(table.attrs.get(HISTORY_KEY, []))


def refuse_duplicates(paths: Sequence[Path]) -> list[str]:
    """The SHA-256 of each recording, in their order; empty where one cannot be read, which its reader will say.

    Raises :class:`InputError` where two files hold the same.
    """
    first: dict[str, Path] = {}
    hashes = []
    for path in paths:
        digest = sha256_of(path) or ""
        twin = first.setdefault(digest, path)
        if digest and twin is not path:
            raise InputError(
                "is given twice", where=str(path), why=f"it is the same recording as {twin}", fix="give it once"
            )
        hashes.append(digest)
    return hashes
