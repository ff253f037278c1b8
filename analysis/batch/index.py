"""The index over a batch: one row a recording, as Parquet for programs and as a page for people.

Results whose recording is no longer there have rows too, with the status ``gone``: nothing is removed.
"""

from __future__ import annotations

import json
import re
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from acquisition.core.errors import storage_error
from analysis.batch.one_recording import SUMMARY
from analysis.report.index_page import index_page
from analysis.tables.files import read_parquet, write_parquet

Failures = list[tuple[str, list[str]]]
"""Causes and the names of the recordings that failed of each, the most frequent first."""

REPORT = "report.html"
"""A notebook report beside a result, which the page leads to where there is one."""

GONE = "gone"
"""The status of a result whose recording is not in the folder any more."""

TEXTS = ("name", "path", "status", "cause", "vessel", "trial", "place", "grade")
MEASURES = {"duration_s": "s", "distance_m": "m"}
COUNTS = ("samples", "channels", "findings", "repairs", "windows_kept", "windows_candidates", "legs")
NESTED_COUNTS = ("findings_by_code", "windows_dropped", "manoeuvres")
_NUMBER = re.compile(r"\d[\d,.]*\d|\d")


def failures_of(rows: Sequence[Mapping[str, Any]]) -> Failures:
    """Failed recordings by cause; causes that differ in their numbers only are one, with N for each number.

    >>> failures_of([{"name": str(n), "status": "failed", "cause": f"damaged near byte {n}"} for n in (1, 2)])
    [('damaged near byte N', ['1', '2'])]
    """
    groups: dict[str, list[Mapping[str, Any]]] = {}
    for row in rows:
        if row["status"] == "failed":
            groups.setdefault(_NUMBER.sub("N", row["cause"]), []).append(row)
    named = []
    for pattern, failed in groups.items():
        causes = {row["cause"] for row in failed}
        named.append((causes.pop() if len(causes) == 1 else pattern, sorted(row["name"] for row in failed)))
    return sorted(named, key=lambda each: (-len(each[1]), each[0]))


def index_table(rows: Sequence[Mapping[str, Any]]) -> pd.DataFrame:
    """The rows as a table with the same kinds of columns whatever failed: counts are whole or missing.

    Counts by code, by reason and by kind stand in columns of their own, like ``findings_by_code.spikes``.
    """
    columns: dict[str, Any] = {name: pd.array([row.get(name) or "" for row in rows], dtype="str") for name in TEXTS}
    starts = _array([row.get("start") for row in rows], "object")
    columns["closed"] = _array([row.get("closed") for row in rows], "boolean")
    missing = [None if row.get("missing") is None else " ".join(row["missing"]) for row in rows]
    columns["missing"] = _array(missing, "str")
    columns["start"] = pd.to_datetime(starts, utc=True, format="ISO8601").dt.as_unit("ns")
    for name in MEASURES:
        columns[name] = _array([row.get(name) for row in rows], "Float64")
    for name in COUNTS:
        columns[name] = _array([row.get(name) for row in rows], "Int64")
    for name in NESTED_COUNTS:
        columns |= _nested(rows, name, "Int64", 0)
    columns |= _nested(rows, "indices", "Float64", None)
    for name in ("bytes", "sha256", "options", "software"):
        values = [row.get("provenance", {}).get(name) for row in rows]
        texts = [json.dumps(value) if isinstance(value, dict) else value for value in values]
        columns[name] = _array(texts, "Int64" if name == "bytes" else "str")
    return pd.DataFrame(columns)


def _nested(rows: Sequence[Mapping[str, Any]], name: str, dtype: str, absent: int | None) -> dict[str, Any]:
    """A column for each key of the mappings called ``name``; ``absent`` where a recording was judged without it."""
    keys = sorted({key for row in rows for key in row.get(name) or {}})
    return {
        f"{name}.{key}": _array(
            [None if row.get(name) is None else row[name].get(key, absent) for row in rows], dtype
        )
        for key in keys
    }


def _array(values: Sequence[Any], dtype: str) -> Any:
    return pd.Series(list(values), dtype=dtype)


def gone_rows(names: Collection[str], out: Path) -> list[dict[str, Any]]:
    """The rows of complete results below ``out`` that belong to none of ``names``, in the order of their names."""
    rows = []
    for path in sorted(out.rglob(SUMMARY)):
        name = path.parent.relative_to(out).as_posix()
        try:
            row = json.loads(path.read_text(encoding="utf-8"))
            ours = name not in names and row["provenance"]["recording"] == name
        except (OSError, ValueError, LookupError, TypeError):
            continue  # somebody else's file of that name
        if ours:
            rows.append({**row, "name": name, "status": GONE, "cause": "its recording is not there any more"})
    return rows


def write_index(rows: Sequence[Mapping[str, Any]], out: Path, title: str) -> Path:
    """Write ``index.parquet`` and ``index.html`` into ``out`` and return the path of the page.

    Raises :class:`acquisition.core.errors.StorageError` when they cannot be written.
    """
    rows = [{**row, "report": (out / row["name"] / REPORT).is_file()} for row in rows]
    write_parquet(index_table(rows), out / "index.parquet", MEASURES, {"batch": json.dumps({"of": title})})
    page, partial = out / "index.html", out / ".index.html.part"
    try:
        partial.write_text(index_page(rows, failures_of(rows), title), encoding="utf-8")
        partial.replace(page)
    except OSError as error:
        raise storage_error(page, error) from error
    return page


def read_index(path: Path | str) -> pd.DataFrame:
    """The index as a table. Raises :class:`InputError` for any other file."""
    return read_parquet(path)[0]
