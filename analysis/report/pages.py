"""Pages of a batch: one recording, with the run sheet of its trial, and the index of all.

A recording's page says what it is, what it is worth, where the ship went, what she did, where it comes from. The
run sheet is everything that a reader wants to know of a trial before its numbers, and what nobody wrote down:
fields as in the form of MSC/Circ.1053, appendix 6; what the crew says comes from the recording's metadata, wind
and times from its channels. The index has a row a recording, to sort, to filter and to click through, in one file
without network.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

import numpy as np
import pandas as pd
from markupsafe import Markup, escape

from acquisition.core.actuators import from_text
from acquisition.core.channels import channel_unit, find_channel
from acquisition.core.trial import Trial, software_version
from acquisition.core.units import KNOT_MPS
from analysis.conditions import beaufort, recorded_conditions
from analysis.kinematics import mean_wind
from analysis.manoeuvres.criteria import mean_of
from analysis.manoeuvres.indices import index_of
from analysis.quality.samples import ASSUMED
from analysis.report.quality_page import HEADER, channel_rows, finding_cells
from analysis.report.rendering import Page, render
from analysis.tables.export import SIGMA_SUFFIX
from analysis.tables.table import sha256_of

if TYPE_CHECKING:
    from pathlib import Path

    from acquisition.recording.reader import Recording
    from analysis.manoeuvres import Manoeuvre
    from analysis.products import Products


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
UNKNOWN = "not recorded"


@dataclass(frozen=True, slots=True)
class Ship:
    """Main dimensions [m], from a vessel file or a person; a person may know the length only.

    ``title`` is what people call her, empty where only the file's ``name`` is known.
    """

    name: str
    over_all_m: float
    between_perpendiculars_m: float
    beam_m: float | None = None
    draught_m: float | None = None
    title: str = ""


def run_sheet(
    recording: Recording, one_hz: pd.DataFrame, manoeuvres: Iterable[Manoeuvre] = (), ship: Ship | None = None
) -> list[tuple[str, str]]:
    """What and its value as text, in the order of a run sheet; what is not known says so.

    ``one_hz`` is the recording once a second. ``manoeuvres`` whose turns show a current give it.
    """
    return [*circumstances(recording, one_hz, manoeuvres, ship), *file_rows(recording)]


def circumstances(
    recording: Recording, one_hz: pd.DataFrame, manoeuvres: Iterable[Manoeuvre] = (), ship: Ship | None = None
) -> list[tuple[str, str]]:
    """The ship, her loading, time, place and weather, as :func:`run_sheet` has them."""
    trial, manoeuvres = recording.trial, tuple(manoeuvres)
    stated = recorded_conditions(trial, pd.DataFrame())
    state_of_sea = UNKNOWN if stated.sea_state is None else f"state {stated.sea_state}"
    draught_m = stated.draught_m or (ship.draught_m if ship else None)
    return [
        ("ship", (ship.title if ship else "") or trial.vessel or UNKNOWN),
        *_form(ship, one_hz, manoeuvres),
        *_actuators(trial.actuators),
        ("trial", trial.name or UNKNOWN),
        *_when(one_hz),
        ("place", trial.place or UNKNOWN),
        ("origin of north and east", _origin_text(trial.origin)),
        ("loading", trial.loading or UNKNOWN),
        ("draught", _metres(stated.draught_m)),
        ("full load draught", _metres(stated.full_load_draught_m)),
        ("trim by the stern", _metres(stated.trim_m)),
        ("water depth", _depth(stated.water_depth_m, draught_m)),
        ("wind", _wind(recording, one_hz, stated.beaufort)),
        ("sea state", trial.sea_state or state_of_sea),
        ("speed at 85 % of the maximum output", _speed_text(stated.speed_at_85_percent_mcr_mps)),
        ("antenna from midship", _place_text(trial)),
        ("current", _current(manoeuvres)),
        ("crew notes", trial.crew_notes or UNKNOWN),
    ]


def file_rows(recording: Recording) -> list[tuple[str, str]]:
    """The file behind a run sheet, and the software."""
    return [
        ("recording", _files_text(recording.paths)),
        ("SHA-256", sha256_of(*recording.paths) or UNKNOWN),
        ("closed properly", "yes" if recording.closed else "no: read as far as it goes"),
        *([("clock", recording.clock)] if recording.clock else []),
        ("this page by", software_version()),
    ]


def _files_text(paths: Sequence[Path]) -> str:
    more = f" and {len(paths) - 1} later part{'s' * (len(paths) > 2)}" if len(paths) > 1 else ""
    return f"{paths[0].name}{more}, {sum(path.stat().st_size for path in paths):,} bytes"


def known_rows(rows: Iterable[tuple[str, str]]) -> list[tuple[str, str]]:
    """The rows of a run sheet whose value is known, and the others named in one."""
    rows = list(rows)
    unknown = [what for what, value in rows if value == UNKNOWN]
    known = [(what, value) for what, value in rows if value != UNKNOWN]
    return [*known, (UNKNOWN, ", ".join(unknown))] if unknown else known


def _actuators(said: str) -> list[tuple[str, str]]:
    """What drives and steers a ship, each with its kind where the name does not say it; nothing for the list that
    recordings do not say."""
    if not said:
        return []
    named = ((each.name.replace("_", " "), each.kind.replace("_", " ")) for each in from_text(said))
    return [("actuators", ", ".join(name if kind in name else f"{name} ({kind})" for name, kind in named))]


def _when(one_hz: pd.DataFrame) -> list[tuple[str, str]]:
    first, last = one_hz.index[0], one_hz.index[-1]
    minutes = (last - first).total_seconds() / 60.0
    until = f"{last:%H:%M:%S}" if last.date() == first.date() else f"{last:%Y-%m-%d %H:%M:%S}"
    return [("date", f"{first:%Y-%m-%d}"), ("time, UTC", f"{first:%H:%M:%S} to {until}, {minutes:.1f} min")]


def _origin_text(origin: tuple[float, float] | None) -> str:
    if origin is None:
        return UNKNOWN
    latitude, longitude = origin
    return (
        f"{abs(latitude):.5f}\u00b0 {'N' if latitude >= 0 else 'S'}, "
        f"{abs(longitude):.5f}\u00b0 {'E' if longitude >= 0 else 'W'}"
    )


def _metres(value: float | None) -> str:
    return UNKNOWN if value is None else f"{value:g} m"


def _depth(depth_m: float | None, draught_m: float | None) -> str:
    if depth_m is None or not draught_m:
        return _metres(depth_m)
    return f"{depth_m:g} m, {depth_m / draught_m:.1f} draughts"


def _speed_text(speed_mps: float | None) -> str:
    return UNKNOWN if speed_mps is None else f"{speed_mps:.2f} m/s ({speed_mps / KNOT_MPS:.1f} kn)"


def _place_text(trial: Trial) -> str:
    if trial.antenna_forward_m is None:
        return UNKNOWN
    return f"{trial.antenna_forward_m:g} m forward, {trial.antenna_starboard_m or 0.0:g} m to starboard"


def _wind(recording: Recording, one_hz: pd.DataFrame, stated_beaufort: int | None) -> str:
    """The wind as it was measured; one that an import assumed is none. Else its force as it was stated."""
    series = recording.series.get("wind_speed_mps")
    if stated_beaufort is not None and series is None:
        return f"Beaufort {stated_beaufort}, as stated"
    return f"{UNKNOWN}, calm assumed" if series and series.sources == (ASSUMED,) else wind_words(one_hz)


def wind_words(table: pd.DataFrame) -> str:
    """The mean wind, where it comes from, how it gusts, and its force."""
    air = table.reindex(columns=["wind_speed_mps", "wind_direction_deg"]).dropna()
    if air.empty:
        return UNKNOWN
    speed_mps, from_deg = mean_wind(air)
    gust = float(np.quantile(air["wind_speed_mps"], 0.99))
    return f"{speed_mps:.1f} m/s from {from_deg:.0f}\u00b0, gusts {gust:.1f} m/s, Beaufort {beaufort(speed_mps)}"


def _current(manoeuvres: Iterable[Manoeuvre]) -> str:
    """The mean of what turns of more than one and a half circles show, with its 95 % interval along itself,
    of two turns half of their range.
    """
    found = [each.current for each in manoeuvres if each.current is not None]
    if not found:
        return "unknown: no turn of one and a half circles"
    north, east = (
        mean_of([index_of("", getattr(each, f"{name}_mps"), getattr(each, f"{name}_within_mps")) for each in found])
        for name in ("north", "east")
    )  # fmt: skip
    speed = float(np.hypot(north.index.value, east.index.value))
    towards = np.arctan2(east.index.value, north.index.value)
    within = np.hypot(np.cos(towards) * north.half, np.sin(towards) * east.half)
    turns = f"{len(found)} turn{'' if len(found) == 1 else 's'}"
    interval = "the range of both" if len(found) == 2 else "95 % interval"
    return (
        f"{speed:.2f} \u00b1 {within:.2f} m/s towards {np.rad2deg(towards) % 360.0:.0f}\u00b0 ({interval}), "
        f"from {turns}, wind drift included"
    )


def _form(ship: Ship | None, one_hz: pd.DataFrame, manoeuvres: Iterable[Manoeuvre]) -> list[tuple[str, str]]:
    """Dimensions and the ratios that the IMO's form asks for; the speed is that of the fastest approach, or without
    manoeuvres the median of what the ship made good."""
    if ship is None:
        return [("dimensions", "unknown: no vessel file for the ship that the recording names")]
    both = one_hz.reindex(columns=["surge_mps", "sway_mps"]).dropna()
    speed = float(np.median(np.hypot(both["surge_mps"], both["sway_mps"]))) if len(both) else 0.0
    approaches = [each.settings["approach_mps"] for each in manoeuvres if "approach_mps" in each.settings]
    speed, whose = (max(approaches), "fastest approach") if approaches else (speed, "median speed")
    length_m = ship.between_perpendiculars_m
    per_speed = [f"L/V {length_m / speed:.1f} s at the {whose}, {speed:.2f} m/s"] if speed > 0.1 else []
    words, ratios = f"{length_m:g} m between perpendiculars (L), given for this report", per_speed
    if ship.beam_m and ship.draught_m:
        words = (
            f"{ship.over_all_m:g} m overall, {length_m:g} m between perpendiculars (L), beam {ship.beam_m:g} m, "
            f"draught {ship.draught_m:g} m"
        )
        ratios = [f"L/B {length_m / ship.beam_m:.2f}", f"B/T {ship.beam_m / ship.draught_m:.2f}", *per_speed]
    return [("dimensions", words), *([("ratios", ", ".join(ratios))] if ratios else [])]


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
    """The page of rows as of :func:`analysis.batch.one_recording.row_of` and failures by their cause.

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
