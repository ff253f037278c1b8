"""A table to a recording: what an import and a simulated trial have in common."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from seatrial.acquisition.core.channels import channels_of_trial
from seatrial.acquisition.core.errors import InputError
from seatrial.acquisition.core.files import atomic_file, expect_suffix
from seatrial.acquisition.core.frames import Quality, Sample
from seatrial.acquisition.core.trial import Trial
from seatrial.acquisition.recording.writer import RecordingWriter

_ROWS_TO_FLUSH = 50_000


def write_table(
    table: pd.DataFrame,
    path: Path | str,
    trial: Trial,
    source: str | Mapping[str, str] = "table",
    qualities: Mapping[str, NDArray[np.uint8]] | None = None,
    metadata: Mapping[str, Mapping[str, str]] | None = None,
) -> int:
    """Write a table's channels as a recording, in the order of its rows, and return the number of samples.

    ``table`` has a UTC index named ``time`` and columns named as the channels, in their units; NaN cells are
    not written. ``source`` says where the values come from, for all or by column; ``qualities`` gives flags
    by column, :attr:`Quality.NOT_EVALUATED` where it is silent; ``metadata`` is said beside the trial's, by
    name. The file appears under its name only when it is complete. Raises :class:`InputError` for a column that
    is no channel, :class:`StorageError` when the file cannot be written.
    """
    expect_suffix(path, ".mcap")
    channels = channels_of_trial(trial)
    unknown = [name for name in table.columns if name not in channels]
    if unknown:
        raise InputError(f"columns {', '.join(map(str, unknown))} are no channels", where=str(path))
    with atomic_file(path) as partial, RecordingWriter(partial, trial) as writer:
        for name, entries in (metadata or {}).items():
            writer.write_metadata(name, entries)
        _write_rows(writer, table, source, qualities or {})
    return int(table.notna().to_numpy().sum())


def _write_rows(
    writer: RecordingWriter,
    table: pd.DataFrame,
    source: str | Mapping[str, str],
    qualities: Mapping[str, NDArray[np.uint8]],
) -> None:
    index = pd.DatetimeIndex(table.index)
    times_ns = index.as_unit("ns").asi8.tolist()  # pandas 3 counts in microseconds unless told
    names = [str(name) for name in table.columns]
    sources = [source if isinstance(source, str) else source.get(name, "table") for name in names]
    flags = [qualities.get(name) for name in names]
    values = table.to_numpy(dtype=float)
    present = np.isfinite(values)
    for row, time_ns in enumerate(times_ns):
        for column in np.flatnonzero(present[row]):
            flag = flags[column]
            quality = Quality.NOT_EVALUATED if flag is None else Quality(int(flag[row]))
            value = float(values[row, column])
            name, origin = names[column], sources[column]
            writer.write_sample(Sample(name, value, origin, time_ns, 0, time_ns, time_ns, "table", quality))
        if row % _ROWS_TO_FLUSH == _ROWS_TO_FLUSH - 1:
            writer.flush()  # or a day of samples would be gathered in memory
