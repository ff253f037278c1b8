"""Parquet with units on the columns and the trial in the file's metadata."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from acquisition.core.errors import InputError
from acquisition.recording.trial import software_version
from analysis.tables.files import expect_suffix, in_place_of

PREFIX = "seatrial."


def write_parquet(
    table: pd.DataFrame, path: Path | str, units: Mapping[str, str], metadata: Mapping[str, str]
) -> None:
    """Write ``table`` with a unit on each column named in ``units`` and ``metadata`` under our prefix.

    The index is written if it has a name. The file appears under its name only when it is complete. Raises
    :class:`InputError` for another suffix than .parquet, :class:`StorageError` when it cannot be written.
    """
    expect_suffix(path, ".parquet")
    plain = table.copy(deep=False)
    plain.attrs = {}  # the metadata says it; pandas would write it a second time, and only as JSON
    arrow = pa.Table.from_pandas(plain, preserve_index=table.index.name is not None)
    fields = [
        field.with_metadata({"unit": units[field.name]}) if field.name in units else field for field in arrow.schema
    ]
    own = {PREFIX + key: text for key, text in metadata.items()}
    own[PREFIX + "software_version"] = software_version()
    schema = pa.schema(fields, metadata={**(arrow.schema.metadata or {}), **own})
    with in_place_of(path) as partial:
        pq.write_table(arrow.cast(schema), partial)


def read_parquet(path: Path | str) -> tuple[pd.DataFrame, dict[str, str]]:
    """A Parquet file and the metadata under our prefix. Raises :class:`InputError` if it is none."""
    if not Path(path).is_file():
        raise InputError("does not exist", where=str(path), fix="check the path")
    try:
        arrow = pq.read_table(path)
        frame = arrow.to_pandas()
    except (pa.ArrowException, OSError) as error:
        raise InputError("is not a readable Parquet file", where=str(path), why=_first_line(error)) from error
    texts = {key.decode(): text.decode() for key, text in (arrow.schema.metadata or {}).items()}
    own = {key.removeprefix(PREFIX): text for key, text in texts.items() if key.startswith(PREFIX)}
    return frame, own


def _first_line(error: BaseException) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]
