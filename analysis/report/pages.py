"""Pages of a batch: one recording, with the run sheet of its trial, and the index of all.

A recording's page says what it is, what it is worth, where the ship went, what she did, where it comes from. The
index has a row a recording, to sort, to filter and to click through, in one file without network.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

import pandas as pd
from markupsafe import Markup, escape

from seatrial.acquisition.core.quantities import KNOT_MPS
from seatrial.acquisition.core.ship import channel_unit, find_channel
from seatrial.analysis.report.quality_page import HEADER, channel_rows, finding_cells
from seatrial.analysis.report.rendering import Page, render
from seatrial.analysis.report.run_sheet import run_sheet
from seatrial.analysis.tables.export import SIGMA_SUFFIX

if TYPE_CHECKING:
    from seatrial.acquisition.recording.reader import Recording
    from seatrial.analysis.products import Products


_FILES = ("table.parquet", "flags.parquet", "quality.json", "windows.parquet", "manoeuvres.json", "summary.json")


def recording_page(products: Products, row: dict[str, Any]) -> Page:
    """The page of what was made of a recording; ``row`` is its summary."""
    provenance = row["provenance"]
    findings, others = _findings(products)
    dropped = sorted(row["windows_dropped"].items(), key=lambda each: -each[1])
    return render(
        "recording.html",
        title=products.recording.trial.name or provenance["recording"],
        subtitle=f"{provenance['recording']}, {row['start'][:10]} {row['start'][11:19]} UTC",
        headline=headline_of(row), row=row, products=products,
        run_sheet=run_sheet(products.recording, products.one_hz, products.manoeuvres),
        findings=findings, other_repairs=others,
        channel_header=HEADER, channels=channel_rows(products.quality),
        executes=[each.start for each in products.manoeuvres],
        dropped=", ".join(f"{count:,} {reason.replace('_', ' ')}" for reason, count in dropped),
        uncertainty=_uncertainty(products.one_hz), origin=_origin(provenance),
    )  # fmt: skip


def headline_of(row: dict[str, Any]) -> dict[str, str]:
    """The numbers that matter, for people."""
    figures = {"duration": f"{row['duration_s'] / 60:.1f} min", "samples": f"{row['samples']:,}"}
    if row["distance_m"] is not None:
        metres = row["distance_m"]
        figures["sailed"] = f"{metres / 1852:.2f} nmi" if metres > _SHORT_WAY_M else f"{metres:.0f} m"
    if row["grade"]:
        figures["worst channel"] = row["grade"]
    if row["missing"]:
        figures["channels missing"] = f"{len(row['missing'])}"
    figures |= {"findings": str(row["findings"]), "repairs": str(row["repairs"])}
    if row["windows_kept"] is not None:
        figures["held windows"] = f"{row['windows_kept']} of {row['windows_candidates']}"
    if "speed_power_kw" in row["indices"]:
        figures[f"at {row['indices']['speed_power_kw']:,.0f} kW"] = speed_in_knots(row)
    return figures | {"manoeuvres": str(sum(row["manoeuvres"].values()))}


def speed_in_knots(row: Mapping[str, Any]) -> str:
    """The speed of a recording's speed trial."""
    return f"{row['indices']['speed_power_mps'] / KNOT_MPS:.2f} kn"


def _findings(products: Products) -> tuple[list[list[str]], list[str]]:
    """The cells of each finding with what was repaired of it, and the repairs that belong to none."""
    repaired = {
        (each.code, each.channel): f"Repaired: {each.text}, {each.changed:,} values." for each in products.repairs
    }
    cells = []
    for finding in products.quality.findings:
        what, about, text = finding_cells(finding)
        text = text if find_channel(text.split(" ", 1)[0]) else text[:1].upper() + text[1:]
        cells.append([what, about, text, repaired.pop((finding.code, finding.channel), "")])
    return cells, list(repaired.values())


def _uncertainty(one_hz: pd.DataFrame) -> list[list[str]] | None:
    """How well the smoother knows each channel of the motion; None without it."""
    names = [name for name in map(str, one_hz) if f"{name}{SIGMA_SUFFIX}" in one_hz and channel_unit(name)]
    halves = {name: 1.96 * one_hz[f"{name}{SIGMA_SUFFIX}"].dropna() for name in names}
    rows = [
        [name, f"\u00b1 {half.median():.3g} {channel_unit(name)}", f"\u00b1 {half.max():.3g} {channel_unit(name)}",
         f"{len(one_hz) - len(half):,}"]
        for name, half in halves.items() if len(half)
    ]  # fmt: skip
    return rows if names else None


def _origin(provenance: dict[str, Any]) -> list[tuple[str, str]]:
    """Where it all comes from, and the files beside the page."""
    software = (
        value if value.startswith(key) else f"{key} {value}" for key, value in provenance["software"].items()
    )
    return [
        ("beside this page", ", ".join(_FILES)),
        ("recording", f"{provenance['recording']}, {provenance['bytes']:,} bytes"),
        ("SHA-256", provenance["sha256"]),
        ("options", ", ".join(f"{key} {value}" for key, value in provenance["options"].items())),
        ("software", ", ".join(software)),
    ]


_SHORT_WAY_M = 200.0  # of which two decimals of a nautical mile say little
_NUMBERS = re.compile(r"[+-]?\d[\d.,]*")


def events_of(recording: Recording) -> list[list[str]]:
    """Marks, warnings and changes of configuration in the order of time: when they were heard, UTC, and the text.

    Events that differ in their numbers only stand once, with how often they came.
    """
    rows: list[list[str]] = []
    alike: dict[str, int] = {}
    for time_ns, text in recording.events:
        pattern = _NUMBERS.sub("N", text)
        alike[pattern] = alike.get(pattern, 0) + 1
        if alike[pattern] == 1:
            rows.append([f"{pd.Timestamp(time_ns, unit='ns', tz='UTC'):%Y-%m-%d %H:%M:%S}", text])
    counts = [alike[_NUMBERS.sub("N", text)] for _, text in rows]
    return [[time, f"{text} ({count} similar events)" if count > 1 else text]
            for (time, text), count in zip(rows, counts, strict=True)]  # fmt: skip


Row = Mapping[str, Any]

_COLUMNS = {
    "name": "recording", "status": "status", "start": "start, UTC", "duration_s": "duration",
    "distance_m": "sailed [nmi]", "samples": "samples", "grade": "data", "findings": "findings",
    "repairs": "repairs", "windows_kept": "held windows", "manoeuvres": "manoeuvres",
    "verdict": "diagnosis",
}  # fmt: skip
_OTHERS = ("track", "trial", "vessel", "place", "cause", "report", "missing")
_COUNTS = ("findings_by_code", "manoeuvres", "left_out", "indices")
_BREAKS = re.compile(r"([/_])(?=\w)")  # where a long name may go on in the next line
_GRADES = {"bad": 0, "suspect": 1, "good": 2}  # the worst first
_STATUSES = {
    "failed": (0, "failed"),
    "cut off": (1, "done, cut off"),
    "gone": (2, "recording gone"),
    "waiting": (3, "not analysed yet"),
    "done": (4, "done"),
}
_NUMERIC = {"duration_s", "distance_m", "samples", "repairs", "windows_kept"}


def index_page(
    rows: Sequence[Row],
    failures: Sequence[tuple[str, list[str]]],
    title: str,
    live: Mapping[str, Any] | None = None,
) -> Page:
    """The page of rows as of :func:`seatrial.analysis.batch.one_recording.row_of` and failures by their cause.

    ``live`` is of a page that is served: its scripts' ``nonce``, how many are ``waiting``, and, where files may be
    sent, up to how many MB (``upload_mb``) and with which ``token``.
    """
    verdicts = any(row.get("verdict") for row in rows)
    filled = [
        {**dict.fromkeys([*_COLUMNS, *_OTHERS]), **row, **{name: row.get(name) or {} for name in _COUNTS}}
        for row in rows
    ]
    return render(
        "index.html", title=title, rows=filled, failures=failures, figures=_figures(rows), live=live,
        columns={key: head for key, head in _COLUMNS.items() if key != "verdict" or verdicts},
        choices=_choices(filled),
        numeric=_NUMERIC, ordered=_NUMERIC | {"status", "grade", "findings"}, quote=quote,
        broken=_broken, speed_in_knots=speed_in_knots, status_of=lambda row: _STATUSES[_status(row)],
        status_class=lambda row: _status(row).replace(" ", "-"), duration=duration_text, grade_order=_grade_order,
    )  # fmt: skip


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


def _choices(rows: Sequence[Row]) -> dict[str, tuple[str, list[str]]]:
    """What rows can be chosen by: a heading and the values, of what differs between them."""
    kinds = {kind for row in rows for kind in row["manoeuvres"]}
    found = {
        name: (head, sorted({row[key] for row in rows if row[key]}))
        for name, (key, head) in {
            "ship": ("vessel", "any ship"), "grade": ("grade", "any data"), "verdict": ("verdict", "any diagnosis"),
        }.items()
    }  # fmt: skip
    return {name: each for name, each in {**found, "kind": ("any manoeuvre", sorted(kinds))}.items() if each[1]}


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
