"""The event log of a recording as a table, for scripts and for files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from seatrial.acquisition.core.files import atomic_file, expect_suffix
from seatrial.acquisition.recording.grouping import events_of
from seatrial.acquisition.recording.reader import Recording
from seatrial.analysis.tables.export import write_sheets
from seatrial.analysis.tables.files import write_parquet
from seatrial.analysis.tables.table import index_of

COLUMNS = ("kind", "level", "source", "text")
EVENT_KINDS = (".csv", ".parquet", ".xlsx")
"""The suffixes of what a table of texts can be written as."""


def event_table(recording: Recording) -> pd.DataFrame:
    """The events of a recording in the order of time: :data:`COLUMNS` with a UTC index named ``time``."""
    events = events_of(recording)
    rows = [[getattr(event, column) for column in COLUMNS] for event in events]
    index = index_of(np.array([event.time_ns for event in events], dtype=np.int64))
    return pd.DataFrame(rows, index=index, columns=list(COLUMNS), dtype=str)


def export_events(events: pd.DataFrame, path: Path) -> list[Path]:
    """Write a table of events as the suffix of ``path`` says, .csv, .parquet or .xlsx; the files that were written.

    Raises :class:`InputError` for another suffix and :class:`StorageError` when it cannot be written.
    """
    kind = expect_suffix(path, *EVENT_KINDS)
    if kind == ".parquet":
        write_parquet(events, path, {}, {})
    elif kind == ".xlsx":
        times = pd.DatetimeIndex(events.index).as_unit("us").tz_localize(None).rename("time_utc")
        return write_sheets({"events": events.set_axis(times, axis=0).reset_index()}, path)
    else:
        texts = pd.DatetimeIndex(events.index).strftime("%Y-%m-%dT%H:%M:%S.%fZ")
        with atomic_file(path) as partial:
            events.set_axis(texts, axis=0).to_csv(partial, index_label="time")
    return [path]
