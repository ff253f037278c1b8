"""The pages of recordings: one page for each, the index of a batch, and the quality report.

A recording's page has its run sheet, quality, track, manoeuvres and provenance. The index has a row for each
recording, to sort, filter and open, in one file that needs no network. The quality of a recording is shown at a
terminal and on a page, and written for programs as JSON and Parquet.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

import numpy as np
import pandas as pd
from markupsafe import Markup, escape
from matplotlib.dates import ConciseDateFormatter, date2num
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray
from rich.console import Group, RenderableType
from rich.text import Text

from seatrial.acquisition.core.files import write_text, written_together
from seatrial.acquisition.core.quantities import KNOT_MPS, NAUTICAL_MILE_M, Floats, Ints
from seatrial.acquisition.core.result import terminal_table
from seatrial.acquisition.core.ship import channel_unit, find_channel
from seatrial.acquisition.core.trial import Quality
from seatrial.acquisition.recording.grouping import counts_text
from seatrial.analysis.quality.findings import ALL
from seatrial.analysis.report.plots import draw_marks
from seatrial.analysis.report.rendering import Page, render
from seatrial.analysis.report.tables import run_sheet
from seatrial.analysis.series import runs
from seatrial.analysis.tables.export import SIGMA_SUFFIX, write_parquet
from seatrial.analysis.tables.table import main_stretch, times_ns

if TYPE_CHECKING:
    from seatrial.acquisition.recording.reader import Recording
    from seatrial.analysis.products import Products
    from seatrial.analysis.quality.channel_checks import ChannelQuality
    from seatrial.analysis.quality.check import Cause, DataQuality
    from seatrial.analysis.quality.findings import Finding


_FILES = ("table.parquet", "flags.parquet", "quality.json", "windows.parquet", "manoeuvres.json", "summary.json")
_SHORT_WAY_M = 200.0  # of which two decimals of a nautical mile say little
_NUMBERS = re.compile(r"[+-]?\d[\d.,]*")
Row = Mapping[str, Any]
_COLUMNS = {
    "name": "recording", "status": "status", "start": "start, UTC", "duration_s": "duration",
    "distance_m": "sailed [nmi]", "samples": "samples", "grade": "data", "findings": "findings",
    "repairs": "repairs", "windows_kept": "held windows", "manoeuvres": "manoeuvres",
    "verdict": "diagnosis",
}  # fmt: skip
_OPTIONAL = ("track", "trial", "vessel", "place", "cause", "report", "missing")
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
PALETTE = ("#0072B2", "#CC79A7", "#56B4E9", "#000000", "#8C564B", "#7F7F7F", "#9467BD")
COLOURS = {Quality.GOOD: "#9CC9B5", Quality.NOT_EVALUATED: "#D9DEE2", Quality.SUSPECT: "#E69F00",
           Quality.BAD: "#D55E00"}  # fmt: skip
"""Flags, the more severe the later."""
_BINS = 1200
HEADER = ["channel", "grade", "samples", "rate [Hz]", "gaps", "stuck", "spikes", "out of range", "times twice",
          "steps back"]  # fmt: skip
MOST_CAUSES = 10
"""What a terminal shows: more would push the most severe out of sight."""
_STYLES = {"good": "green", "suspect": "yellow", "bad": "bold red"}
_CHANNEL_COLUMNS = ("channel", "grade", "count", "rate Hz", "gaps", "stuck", "spikes", "range", "twice", "back")


def recording_page(products: Products, row: dict[str, Any]) -> Page:
    """The page of what was made of a recording; ``row`` is its summary."""
    provenance, one_hz = row["provenance"], products.one_hz
    repairs = {
        (repair.code, repair.channel): f"Repaired: {repair.text}, {repair.changed:,} values."
        for repair in products.repairs
    }
    findings = []  # the cells of each with what was repaired of it; the repairs that belong to none remain
    for finding in products.quality.findings:
        what, about, text = finding_cells(finding)
        text = text if find_channel(text.split(" ", 1)[0]) else text[:1].upper() + text[1:]
        findings.append([what, about, text, repairs.pop((finding.code, finding.channel), "")])
    names = [name for name in map(str, one_hz) if f"{name}{SIGMA_SUFFIX}" in one_hz and channel_unit(name)]
    uncertainty = []  # how well the smoother knows each channel of the motion
    for name in names:
        half, unit = 1.96 * one_hz[f"{name}{SIGMA_SUFFIX}"].dropna(), channel_unit(name)
        if len(half):
            sizes = [f"\u00b1 {size:.3g} {unit}" for size in (half.median(), half.max())]
            uncertainty.append([name, *sizes, f"{len(one_hz) - len(half):,}"])
    dropped = sorted(row["windows_dropped"].items(), key=lambda entry: -entry[1])
    software = (
        value if value.startswith(key) else f"{key} {value}" for key, value in provenance["software"].items()
    )
    origin = [
        ("beside this page", ", ".join(_FILES)),
        ("recording", f"{provenance['recording']}, {provenance['bytes']:,} bytes"),
        ("SHA-256", provenance["sha256"]),
        ("options", ", ".join(f"{key} {value}" for key, value in provenance["options"].items())),
        ("software", ", ".join(software)),
    ]
    return render(
        "recording.html",
        title=products.recording.trial.name or provenance["recording"],
        subtitle=f"{provenance['recording']}, {row['start'][:10]} {row['start'][11:19]} UTC",
        headline=headline_of(row), row=row, products=products,
        run_sheet=run_sheet(products.recording, one_hz, products.manoeuvres),
        findings=findings, other_repairs=list(repairs.values()),
        channel_header=HEADER, channels=channel_rows(products.quality),
        executes=[manoeuvre.start for manoeuvre in products.manoeuvres],
        dropped=", ".join(f"{count:,} {reason.replace('_', ' ')}" for reason, count in dropped),
        uncertainty=uncertainty if names else None, origin=origin,
    )  # fmt: skip


def headline_of(row: dict[str, Any]) -> dict[str, str]:
    """The numbers at the top of a recording's page."""
    figures = {"duration": f"{row['duration_s'] / 60:.1f} min", "samples": f"{row['samples']:,}"}
    if row["distance_m"] is not None:
        metres = row["distance_m"]
        figures["sailed"] = f"{metres / NAUTICAL_MILE_M:.2f} nmi" if metres > _SHORT_WAY_M else f"{metres:.0f} m"
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


def events_of(recording: Recording) -> list[list[str]]:
    """Marks, warnings and changes of configuration in order of time: when each was received, UTC, and its text.

    Events that differ only in their numbers are listed once, with their count.
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


def index_page(
    rows: Sequence[Row],
    failures: Sequence[tuple[str, list[str]]],
    title: str,
    live: Mapping[str, Any] | None = None,
) -> Page:
    """The page of rows as of :func:`seatrial.analysis.batch.row_of` and failures by their cause.

    ``live`` is of a page that is served: its scripts' ``nonce``, how many are ``waiting``, and, where files may be
    sent, up to how many MB (``upload_mb``) and with which ``token``.
    """
    filled = [
        {**dict.fromkeys([*_COLUMNS, *_OPTIONAL]), **row, **{name: row.get(name) or {} for name in _COUNTS}}
        for row in rows
    ]
    present = [row for row in filled if row["status"] != "gone"]
    keys = ("duration_s", "distance_m", "samples", "windows_kept", "findings")
    total = {key: float(sum(row[key] or 0 for row in present)) for key in keys}
    figures = {
        "recordings": f"{len(present):,}",
        "hours": f"{total['duration_s'] / 3600:,.1f}",
        "nautical miles": f"{total['distance_m'] / NAUTICAL_MILE_M:,.1f}",
        "samples": f"{total['samples']:,.0f}",
        "held windows": f"{total['windows_kept']:,.0f}",
        "manoeuvres": f"{sum(sum(row['manoeuvres'].values()) for row in present):,}",
        "findings": f"{total['findings']:,.0f}",
        "failed": str(sum(row["status"] == "failed" for row in present)),
    }
    heads = {"vessel": "any ship", "grade": "any data", "verdict": "any diagnosis"}
    values = {key: sorted({row[key] for row in filled if row[key]}) for key in heads}
    choices = {key.replace("vessel", "ship"): (head, values[key]) for key, head in heads.items()}
    choices["kind"] = ("any manoeuvre", sorted({kind for row in filled for kind in row["manoeuvres"]}))
    verdicts = any(row["verdict"] for row in filled)
    return render(
        "index.html", title=title, rows=filled, failures=failures, figures=figures, live=live,
        columns={key: head for key, head in _COLUMNS.items() if key != "verdict" or verdicts},
        choices={name: choice for name, choice in choices.items() if choice[1]},
        numeric=_NUMERIC, ordered=_NUMERIC | {"status", "grade", "findings"}, quote=quote,
        broken=lambda name: Markup(_BREAKS.sub(r"\1<wbr>", str(escape(name)))),
        speed_in_knots=speed_in_knots, status_of=lambda row: _STATUSES[_status(row)],
        status_class=lambda row: _status(row).replace(" ", "-"), duration=duration_text,
        # the worst grade first, and within a grade the row that lacks most channels
        grade_order=lambda row: _GRADES.get(row["grade"] or "", 0) - len(row["missing"]) / 100 if row["missing"]
        else _GRADES.get(row["grade"] or "", ""),
    )  # fmt: skip


def _status(row: Row) -> str:
    """The status of a row, where a recording that was cut off is not simply done."""
    return "cut off" if row["status"] == "done" and row.get("closed") is False else str(row["status"])


def duration_text(seconds: float | None) -> str:
    """A duration as text.

    >>> duration_text(65.0), duration_text(3720.0)
    ('1 min 05 s', '1 h 02 min')
    """
    if seconds is None:
        return ""
    hours, remainder = divmod(round(seconds), 3600)
    return f"{hours} h {remainder // 60:02d} min" if hours else f"{remainder // 60} min {remainder % 60:02d} s"


def write_quality(
    quality: DataQuality, folder: Path, trial: Mapping[str, str], provenance: Mapping[str, Any]
) -> list[Path]:
    """Write ``quality.json``, ``flags.parquet`` and ``quality.html`` into a folder; it is made if need be.

    The page says how much is good, what was found, and has the flags over time and the counts by channel.
    ``provenance`` (:func:`seatrial.analysis.tables.table.provenance_of`) goes into both of the files for programs.

    Raises :class:`StorageError` when they cannot be written.
    """
    document, recording = quality.as_dict(), str(provenance["recording"])
    report, flags = folder / "quality.json", folder / "flags.parquet"
    origin = {"recording": recording, "findings": document["findings"], "provenance": provenance}
    metadata = {key: json.dumps(value) for key, value in origin.items()}
    grades = [channel.grade for channel in quality.channels.values()]
    counts = {f"channels {grade}": grades.count(grade) for grade in ("good", "suspect", "bad")}
    page = render(
        "quality.html", title="Data quality", subtitle=recording, quality=quality,
        headline={**counts, "findings": len(quality.findings)},
        trial=[(key.replace("_", " "), value) for key, value in trial.items() if value and key != "channels"],
    )  # fmt: skip
    with written_together(report):
        write_text(report, json.dumps({**document, "provenance": provenance}, indent=1) + "\n")
        write_parquet(quality.flags, flags, dict.fromkeys(map(str, quality.flags.columns), "QARTOD flag"), metadata)
        return [report, flags, page.write(folder / "quality.html")]


def channel_rows(quality: DataQuality, *, shares: bool = False) -> list[list[str]]:
    """A row a channel, as :data:`HEADER` says; with ``shares`` also the share of its expected samples that is
    flagged good."""
    rows = [[name, channel.grade, *counts_of(channel)] for name, channel in quality.channels.items()]
    for row in rows if shares else ():
        flags = quality.flags[row[0]].to_numpy()
        expected = int((flags != Quality.MISSING).sum()) + quality.channels[row[0]].missing
        row.append(f"{(flags == Quality.GOOD).sum() / expected:.1%}" if expected else "")
    return rows


def finding_cells(finding: Finding) -> list[str]:
    """The code of a finding, its channel and times, and a sentence on it."""
    where = "all channels" if finding.channel == ALL else finding.channel
    about = f"{where} \u00b7 {finding.start:%H:%M:%S} to {finding.end:%H:%M:%S} UTC"
    return [finding.code.replace("_", " "), about, finding_text(finding)]


def draw_flags(figure: Figure, quality: DataQuality) -> None:
    """Flags by channel over time, and the findings as lines below the channel's, or across all of them."""
    axes = figure.subplots()
    stamps = times_ns(quality.flags)
    first, last = main_stretch(stamps)
    edges = np.linspace(first, last + 1, _BINS + 1)
    days = date2num(edges.astype("datetime64[ns]"))  # type: ignore[no-untyped-call]
    names = list(quality.channels)
    for line, name in enumerate(names):
        flags = binned_flags(stamps, quality.flags[name].to_numpy(), edges)
        for flag, colour in COLOURS.items():
            bars = [(days[a], days[b] - days[a]) for a, b in zip(*runs(flags == flag), strict=True)]
            axes.broken_barh(bars, (line - 0.32, 0.5), facecolors=colour, linewidth=0)

    codes = list(dict.fromkeys(finding.code for finding in quality.findings))
    colours = {code: PALETTE[number % len(PALETTE)] for number, code in enumerate(codes)}
    low, high = axes.get_xlim()
    for finding in quality.findings:
        start, end = date2num([finding.start, finding.end])  # type: ignore[no-untyped-call]
        # its ends are widened so that it shows
        start, end = min(start, end - 0.002 * (high - low)), max(end, start + 0.002 * (high - low))
        colour, depth = colours[finding.code], codes.index(finding.code) % 3
        if finding.channel == ALL:
            axes.axvspan(start, end, color=colour, alpha=0.25, linewidth=0, zorder=0)
        for line, name in enumerate(names):
            if finding.channel == ALL or name in finding.channel:
                bar = (line + 0.22 + 0.08 * depth, 0.08)
                axes.broken_barh([(start, end - start)], bar, facecolors=colour, linewidth=0)

    axes.set_yticks(range(len(names)), names, fontsize=8)
    axes.set_ylim(len(names) - 0.4, -0.6)
    axes.set_xlim(days[0], days[-1])
    axes.xaxis_date()
    axes.xaxis.set_major_formatter(ConciseDateFormatter(axes.xaxis.get_major_locator()))  # type: ignore[no-untyped-call]
    draw_marks(axes, quality.marks)
    axes.tick_params(axis="y", length=0)
    axes.grid(False)
    axes.spines[["top", "right", "left"]].set_visible(False)
    legend = [Patch(color=COLOURS[flag], label=flag.name.lower())
              for flag in (Quality.GOOD, Quality.SUSPECT, Quality.BAD)]  # fmt: skip
    legend += [Patch(color=colour, label=code.replace("_", " ")) for code, colour in colours.items()]
    axes.legend(handles=legend, loc="lower left", bbox_to_anchor=(0, 1.0), ncols=5, fontsize=7, frameon=False)


def binned_flags(stamps: Ints, flags: NDArray[np.uint8], edges: Floats) -> Ints:
    """The most severe flag in each bin of time, 0 where the channel has no sample: [bins].

    A bin without a sample between two that follow each other at the channel's own rate takes the one before.
    """
    present = flags != Quality.MISSING
    bins = np.clip(np.searchsorted(edges, stamps[present], side="right") - 1, 0, edges.size - 2)
    worst = np.zeros(edges.size - 1, dtype=np.int64)
    for flag in COLOURS:
        worst[bins[flags[present] == flag]] = flag
    longest = 2.5 * float(np.median(np.diff(bins))) if bins.size > 1 else 0.0
    sampled = pd.Series(np.where(worst, worst, np.nan))
    return np.asarray(sampled.ffill(limit=max(int(longest), 1)).fillna(0), dtype=np.int64)


def quality_view(quality: DataQuality) -> RenderableType:
    """The table of channels and each finding with its remedy, for a terminal."""
    channels: list[list[str | Text]] = [
        [name, Text(channel.grade, _STYLES[channel.grade]), *counts_of(channel)]
        for name, channel in quality.channels.items()
    ]
    parts: list[RenderableType] = [
        terminal_table(None, _CHANNEL_COLUMNS, channels, words=(0, 1), padding=(0, 1, 0, 0))
    ]
    if missing := missing_channels_text(quality):
        parts.append(Text(missing, style="yellow"))
    parts.append("")
    if not quality.findings:
        parts.append(Text("Nothing found.", style="green"))
    causes = quality.causes
    for cause in causes[:MOST_CAUSES]:
        start, end = cause.span
        parts += [
            Text(f"{cause.code}  {_channels_text(cause)}", style="bold"),
            Text(f"  {start:%Y-%m-%d %H:%M:%S} to {end:%H:%M:%S}", style="dim"),
            Text(f"  {cause_text(cause)}"),
        ]
    if hidden := causes[MOST_CAUSES:]:
        counts = Counter(cause.code for cause in hidden)
        kinds = ", ".join(f"{code} {count}" if count > 1 else code for code, count in counts.items())
        full_list = "`seatrial check FILE -o FOLDER` writes a page with all of them"
        parts += ["", Text(f"{len(hidden)} more, less severe ({kinds}): {full_list}", style="yellow")]
    if events := counts_text(list(quality.events)):
        parts.append(Text(f"in the log: {events}; `seatrial info` lists marks and alarms", style="dim"))
    return Group(*parts)


def _channels_text(cause: Cause) -> str:
    """The channels of a cause as a heading has them: the first three."""
    names = ["all channels" if name == ALL else name for name in cause.channels]
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")


def cause_text(cause: Cause) -> str:
    """A cause as sentences: a finding alone as it stands, several of them as one paragraph."""
    return cause.text if len(cause.findings) > 1 or cause.events else finding_text(cause.findings[0])


def cause_cells(cause: Cause) -> list[str]:
    """The code of a cause, its channels and times, and its text."""
    what, about, _ = finding_cells(cause.findings[0])
    if len(cause.channels) > 1:
        start, end = cause.span
        about = f"{_channels_text(cause)} \u00b7 {start:%H:%M:%S} to {end:%H:%M:%S} UTC"
    return [what, about, cause_text(cause)]


def missing_channels_text(quality: DataQuality) -> str:
    """Which channels of a trial the recording lacks altogether; empty if it has all."""
    return f"not in the recording: {', '.join(quality.missing)}" if quality.missing else ""


def finding_text(finding: Finding) -> str:
    """A finding and its remedy as sentences with one full stop each."""
    return f"{finding.as_json()['text'].rstrip('.')}."


def counts_of(channel: ChannelQuality) -> list[str]:
    """The counts of a channel as text, empty where nothing was found."""
    faults = (len(channel.gaps), len(channel.stuck), channel.spikes, channel.out_of_range, channel.duplicates,
              channel.time_backwards)  # fmt: skip
    return [f"{channel.count:,}", f"{channel.rate_hz:.2f}", *(f"{number:,}" if number else "" for number in faults)]
