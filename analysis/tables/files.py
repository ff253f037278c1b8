"""Files of results: named by their format; Parquet with units on its columns."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from seatrial.acquisition.core.errors import InputError
from seatrial.acquisition.core.files import atomic_file, expect_suffix
from seatrial.acquisition.core.trial import software_version

if TYPE_CHECKING:
    import pandas as pd


METADATA_PREFIX = "seatrial."


def write_parquet(
    table: pd.DataFrame, path: Path | str, units: Mapping[str, str], metadata: Mapping[str, str]
) -> None:
    """Write ``table`` with a unit on each column named in ``units`` and ``metadata`` under our prefix.

    The index is written if it has a name. The file appears under its name only when it is complete. Raises
    :class:`InputError` for another suffix than .parquet, :class:`StorageError` when it cannot be written.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    expect_suffix(path, ".parquet")
    plain = table.copy(deep=False)
    plain.attrs = {}  # the metadata says it; pandas would write it a second time, and only as JSON
    arrow = pa.Table.from_pandas(plain, preserve_index=table.index.name is not None)
    fields = [
        field.with_metadata({"unit": units[field.name]}) if field.name in units else field for field in arrow.schema
    ]
    file_metadata = {METADATA_PREFIX + key: text for key, text in metadata.items()}
    file_metadata[METADATA_PREFIX + "software_version"] = software_version()
    schema = pa.schema(fields, metadata={**(arrow.schema.metadata or {}), **file_metadata})
    with atomic_file(path) as partial, partial.open("wb") as stream:  # Arrow opens no name that is not UTF-8
        pq.write_table(arrow.cast(schema), stream)


def read_parquet(path: Path | str) -> tuple[pd.DataFrame, dict[str, str]]:
    """A Parquet file and the metadata under our prefix. Raises :class:`InputError` if it is none."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    if not Path(path).is_file():
        raise InputError("does not exist", where=str(path), fix="check the path")
    try:
        with Path(path).open("rb") as stream:
            arrow = pq.read_table(stream)
        frame = arrow.to_pandas()
    except (pa.ArrowException, OSError) as error:
        why = (str(error).splitlines() or [type(error).__name__])[0]
        raise InputError("is not a readable Parquet file", where=str(path), why=why) from error
    texts = {key.decode(): text.decode() for key, text in (arrow.schema.metadata or {}).items()}
    file_metadata = {
        key.removeprefix(METADATA_PREFIX): text for key, text in texts.items() if key.startswith(METADATA_PREFIX)
    }
    return frame, file_metadata
