"""The page of a batch: a row a recording, to sort, to filter and to click through, in one file without network."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any
from urllib.parse import quote

from markupsafe import Markup, escape

from acquisition.core.channels import NAMES
from analysis.report.rendering import render

Row = Mapping[str, Any]

_COLUMNS = {
    "name": "recording", "status": "status", "start": "start, UTC", "duration_s": "duration",
    "distance_m": "sailed [nmi]", "samples": "samples", "grade": "data", "findings": "findings",
    "repairs": "repairs", "windows_kept": "held windows", "manoeuvres": "manoeuvres",
}  # fmt: skip
_OTHERS = ("track", "trial", "vessel", "place", "cause", "report", "missing")
_COUNTS = ("findings_by_code", "manoeuvres")
_BREAKS = re.compile(r"([/_])(?=\w)")  # where a long name may go on in the next line
_GRADES = {"bad": 0, "suspect": 1, "good": 2}  # the worst first
_STATUSES = {
    "failed": (0, "failed"),
    "cut off": (1, "done, cut off"),
    "gone": (2, "recording gone"),
    "done": (3, "done"),
}
_NUMERIC = {"duration_s", "distance_m", "samples", "repairs", "windows_kept"}


def index_page(rows: Sequence[Row], failures: Sequence[tuple[str, list[str]]], title: str) -> str:
    """The page as text, of rows as of :func:`analysis.batch.one_recording.row_of` and failures by their cause."""
    filled = [
        {**dict.fromkeys([*_COLUMNS, *_OTHERS]), **row, **{name: row.get(name) or {} for name in _COUNTS}}
        for row in rows
    ]
    return render(
        "index.html", title=title, rows=filled, failures=failures, figures=_figures(rows), columns=_COLUMNS,
        numeric=_NUMERIC, ordered=_NUMERIC | {"status", "grade", "findings"}, channels=len(NAMES), quote=quote,
        broken=_broken, status_of=lambda row: _STATUSES[_status(row)],
        status_class=lambda row: _status(row).replace(" ", "-"), duration=duration_text, grade_order=_grade_order,
    ).html  # fmt: skip


def _figures(rows: Sequence[Row]) -> dict[str, str]:
    """What stands large above the table: sums over what is still there."""
    rows = [row for row in rows if row["status"] != "gone"]
    return {
        "recordings": f"{len(rows):,}",
        "hours": f"{_total(rows, 'duration_s') / 3600:,.1f}",
        "nautical miles": f"{_total(rows, 'distance_m') / 1852:,.1f}",
        "samples": f"{_total(rows, 'samples'):,.0f}",
        "held windows": f"{_total(rows, 'windows_kept'):,.0f}",
        "manoeuvres": f"{sum(sum((row.get('manoeuvres') or {}).values()) for row in rows):,}",
        "findings": f"{_total(rows, 'findings'):,.0f}",
        "failed": str(sum(row["status"] == "failed" for row in rows)),
    }


def _total(rows: Iterable[Row], name: str) -> float:
    return float(sum(row.get(name) or 0 for row in rows))


def _broken(name: str) -> Markup:
    """A name that may go on in the next line."""
    return Markup(_BREAKS.sub(r"\1<wbr>", str(escape(name))))


def _status(row: Row) -> str:
    """What became of it: a recording that was cut off is done as far as it goes, and that is said here."""
    return "cut off" if row["status"] == "done" and row.get("closed") is False else str(row["status"])


def duration_text(seconds: float | None) -> str:
    """A duration for people.

    >>> duration_text(65.0), duration_text(3720.0)
    ('1 min 05 s', '1 h 02 min')
    """
    if seconds is None:
        return ""
    hours, rest = divmod(round(seconds), 3600)
    return f"{hours} h {rest // 60:02d} min" if hours else f"{rest // 60} min {rest % 60:02d} s"


def _grade_order(row: Row) -> float | str:
    """The worst first, and of one grade the one that lacks most channels."""
    missing, grade = row.get("missing") or [], row.get("grade") or ""
    return _GRADES.get(grade, "") if not missing else _GRADES.get(grade, 0) - len(missing) / 100
