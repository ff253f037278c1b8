"""What was done to a table, step by step: carried in its ``attrs`` and written into every product."""

from __future__ import annotations

from typing import Any

import pandas as pd

from acquisition.recording.trial import software_version

KEY = "history"


def with_step(table: pd.DataFrame, step: str, **options: Any) -> pd.DataFrame:
    """``table`` with one more step in its history: its name, the version of Seatrial and the options.

    The data are shared with ``table``; only the history is new.
    """
    result = table.copy(deep=False)
    entry = {"step": step, "version": software_version(), "options": options}
    result.attrs = {**table.attrs, KEY: [*history_of(table), entry]}
    return result


def history_of(table: pd.DataFrame) -> list[dict[str, Any]]:
    """The steps so far, the oldest first."""
    return list(table.attrs.get(KEY, []))
