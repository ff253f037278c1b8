"""Tables as sheets of an Excel workbook."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime
from pathlib import Path
from typing import Any

import pandas as pd

from acquisition.core.errors import ConfigurationError, InputError
from acquisition.core.files import atomic_file
from analysis.tables.table import utc_index

MOST_ROWS = 1_048_575
"""Rows that a sheet holds below its header."""
_OPTIONS = {"strings_to_formulas": False, "strings_to_urls": False, "nan_inf_to_errors": True}
"""What a recording says is text and nothing else, whatever it begins with."""
_FIRST_DAY = datetime(1980, 1, 1)
"""The workbook's own date: the time of day has no place in a product."""


def write_excel(table: pd.DataFrame, path: Path, about: Mapping[str, Any]) -> list[Path]:
    """A workbook with the sheets ``data``, times in UTC, and ``about``: units, trial and provenance.

    Raises :class:`InputError` for more rows than a sheet holds, and as :func:`write_sheets`.
    """
    if len(table) > MOST_ROWS:
        raise InputError(
            f"has {len(table):,} rows, and a sheet of Excel holds {MOST_ROWS:,}", where=about["recording"],
            fix="say --rate, or write .csv or .parquet",
        )  # fmt: skip
    times = utc_index(table).as_unit("us").tz_localize(None)
    said = [
        (what, str(name), str(value))
        for what in ("units", "trial", "provenance") for name, value in about[what].items()
    ]  # fmt: skip
    return write_sheets(
        {"data": table.set_axis(times.rename("time [UTC]"), axis=0).reset_index(),
         "about": pd.DataFrame(said, columns=["what", "name", "value"])}, path
    )  # fmt: skip


def write_sheets(sheets: Mapping[str, pd.DataFrame], path: Path) -> list[Path]:
    """A workbook of tables by name, without their index. Raises :class:`ConfigurationError` without XlsxWriter."""
    try:
        import xlsxwriter  # noqa: F401 - pandas asks for it by name
    except ImportError as error:
        raise ConfigurationError(
            "a workbook needs the package xlsxwriter", fix="pip install 'seatrial[excel]'"
        ) from error
    with (
        atomic_file(path) as partial,
        partial.open("wb") as stream,
        pd.ExcelWriter(
            stream,
            engine="xlsxwriter",
            datetime_format="yyyy-mm-dd hh:mm:ss.000",
            engine_kwargs={"options": _OPTIONS},
        ) as writer,
    ):
        writer.book.set_properties({"created": _FIRST_DAY})
        for name, table in sheets.items():
            table.to_excel(writer, sheet_name=name, index=False, freeze_panes=(1, 1))
            writer.sheets[name].set_column(0, 0, 24)
    return [path]
