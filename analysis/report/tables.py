"""Manoeuvres and run sheets as tables: for the terminal, for pages and as JSON.

The first half has the manoeuvres of recordings with their indices, the second the run sheet of a trial: the ship
with its loading, the conditions and the file, and what was not recorded. Its fields are those of the form of
MSC/Circ.1053, appendix 6; what people state comes from the recording's metadata, wind and times from its channels.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from rich.console import Group
from rich.text import Text

from seatrial.acquisition.config import declarations
from seatrial.acquisition.config import run_sheet as sheets
from seatrial.acquisition.core import quantities
from seatrial.acquisition.core.files import write_text, written_together
from seatrial.acquisition.core.result import terminal_table
from seatrial.acquisition.core.ship import find_channel, parse_actuators
from seatrial.acquisition.core.trial import Trial, software_version
from seatrial.acquisition.recording.reader import Files, Recording, read_as_one_recording
from seatrial.analysis.manoeuvres import criteria, find, kinds
from seatrial.analysis.manoeuvres.conducted import ConductedRun, conducted_runs
from seatrial.analysis.manoeuvres.indices import UNITS, Index, LeftOut, Manoeuvre, index_from_value, unit_in_name
from seatrial.analysis.quality.wind import beaufort_number, recorded_conditions
from seatrial.analysis.series import ASSUMED
from seatrial.analysis.tables.table import provenance_of, sha256_of, table_of, trial_of

_MOST_FIGURES = 4  # of a value, whatever its interval: no antenna knows a ship's place to millimetres
HEADER = ("index", "value", "95 % interval", "lengths", "IMO limit", "result")
CONDUCTED_HEADER = ("", "run", "order, UTC", "outcome", "why", "notes")
CONDUCTED = "programme as it was sailed"
_SECONDARY = re.compile(r"time_to_check_yaw_|overshoot_([3-9]|\d\d)|(steady|drift|speed_loss).*_removed")
_FIRST_INDICES = 3
_LATER = ("time_to_check", "initial_turning")  # left to the manoeuvre's own table
_UNIT = re.compile(r"_(m[23]?|mps|deg|degc|kgpm3)$")
_NAME = re.compile(r"\b[a-z][a-z0-9]*(?:_[a-z0-9]+)+\b")
_POSITION = {"north_m": "north position", "east_m": "east position"}
_SLOWEST_MPS = 0.1  # a ship that lies still has no L/V
UNKNOWN = "not recorded"
Rows = list[tuple[str, str]]


@dataclass(frozen=True, slots=True)
class RecordingManoeuvres:
    """The manoeuvres of one recording, with its table and the runs of a programme that was conducted in it."""

    recording: str
    table: pd.DataFrame
    manoeuvres: tuple[Manoeuvre, ...]
    left_out: tuple[LeftOut, ...] = ()
    stated: sheets.Conditions = field(default_factory=sheets.Conditions)
    programme: tuple[ConductedRun, ...] = ()


def manoeuvres_of_recording(
    files: Files,
    length_m: float | None = None,
    finders: Sequence[str] = (),
    statement: sheets.Statement | None = None,
) -> RecordingManoeuvres:
    """The manoeuvres of a recording or its parts, named by its event marks, and those of a user's ``finders``.

    ``statement`` is what a person states of the trial besides the recording. Without ``length_m`` the length is
    that of the statement, of the recording, or of the vessel file of the ship that it names. Raises
    :class:`InputError`, and :class:`DataShortageError` for a recording without channels.
    """

    recording = read_as_one_recording(files)
    if statement is not None:
        recording = replace(recording, trial=statement.apply_to_trial(recording.trial))
    table = table_of(recording)
    carried_m = length_m or sheets.conditions_in_trial(recording.trial).length_m
    known_m = carried_m or declarations.length_of_ship(recording.trial.vessel, recording.path.parent)
    stated = sheets.Conditions(length_m=known_m)
    runs, left_out = find.find_manoeuvres_and_left_out(table, None, recording.events, finders, stated)
    return RecordingManoeuvres(str(recording.path), table, runs, left_out, stated, conducted_runs(recording.events))


def share_trial_currents(results: Sequence[RecordingManoeuvres]) -> list[RecordingManoeuvres]:
    """The recordings with their manoeuvres as of one trial of each ship (:func:`.share_currents_of_trial`)."""
    by_vessel: dict[str, list[RecordingManoeuvres]] = {}
    for recording in results:
        by_vessel.setdefault(trial_of(recording.table).vessel, []).append(recording)
    runs: dict[str, tuple[Manoeuvre, ...]] = {}
    for recordings in by_vessel.values():
        judged = find.share_currents_of_trial(
            [
                find.RecordedRuns(entry.table, entry.manoeuvres, entry.stated, entry.programme)
                for entry in recordings
            ]
        )
        runs |= {recording.recording: trial for recording, trial in zip(recordings, judged, strict=True)}
    return [replace(recording, manoeuvres=runs[recording.recording]) for recording in results]


def summarise_manoeuvres(results: Sequence[RecordingManoeuvres], length_m: float | None = None) -> dict[str, Any]:
    """All recordings with the keys of the contract."""
    return {
        "criteria": criteria_by_vessel(_runs_by_vessel(results)),
        "recordings": [
            {
                "recording": result.recording,
                "manoeuvres": [run.as_json() for run in result.manoeuvres],
                "left_out": [candidate.as_json() for candidate in result.left_out],
                "programme": [run.as_json() for run in result.programme],
            }
            for result in results
        ],
        "length_m": length_m,
        "software_version": software_version(),
    }


def _runs_by_vessel(results: Sequence[RecordingManoeuvres]) -> dict[str, list[Manoeuvre]]:
    runs: dict[str, list[Manoeuvre]] = {}
    for recording in results:
        runs.setdefault(trial_of(recording.table).vessel, []).extend(recording.manoeuvres)
    return runs


def criteria_by_vessel(runs: Mapping[str, Sequence[Manoeuvre]]) -> list[dict[str, Any]]:
    """The criteria of each ship, with the keys of the contract: runs of one are no runs of another."""
    return [
        {"vessel": vessel, **result.as_json()}
        for vessel, trial in runs.items()
        for result in criteria.criterion_results(criteria.index_rows(trial))
    ]


def plain_name(name: str) -> str:
    """The name of an index or setting as text.

    >>> plain_name("tactical_diameter_m_current_removed")
    'tactical diameter, current removed'
    """
    plain, removed = name.removesuffix("_current_removed"), name.endswith("_current_removed")
    unit = next((suffix for suffix in UNITS if plain.endswith(suffix)), "")
    return plain.removesuffix(unit).replace("_", " ") + (", current removed" if removed else "")


def index_cells(index: Index) -> tuple[str, str, str, str]:
    """Value, interval, lengths and limit of an index as text, with digits that the interval bears."""
    width = 0.5 * (index.high - index.low)
    most = _significant_decimals(index.value or width, _MOST_FIGURES)
    digits = min(_significant_decimals(width, 2), most) if width > 0 else most
    interval = f"{index.low:z.{digits}f} to {index.high:z.{digits}f}" if np.isfinite(width) else ""
    lengths = f"{index.lengths:.2f}" if index.lengths is not None else ""
    limit = f"{index.limit:.1f} {index.unit}" if index.limit is not None else ""
    if index.limit_lengths is not None:
        limit += f" ({index.limit_lengths:.1f} L)"
    return f"{index.value:.{digits}f} {index.unit}".strip(), interval, lengths, limit


def _significant_decimals(value: float, significant: int) -> int:
    """The decimals that show so many digits of a value, 4 at most."""
    return int(np.clip(significant - 1 - np.floor(np.log10(abs(value))), 0, 4)) if value else 0


def index_rows_of_manoeuvre(manoeuvre: Manoeuvre, *, all_indices: bool = True) -> list[list[str]]:
    """One row an index; without ``all_indices`` the first two overshoots stand for all, and the main indices."""
    return [[plain_name(name), *index_cells(index), index.result.replace("_", " ")]
            for name, index in manoeuvre.indices.items() if all_indices or not _SECONDARY.search(name)]  # fmt: skip


def manoeuvre_headline(manoeuvre: Manoeuvre) -> str:
    """Time, name and side in one line."""
    seconds = (manoeuvre.end - manoeuvre.start).total_seconds()
    return f"{manoeuvre.start:%H:%M:%S} {manoeuvre.sided_name}, {seconds:.0f} s"


def manoeuvre_settings_line(manoeuvre: Manoeuvre) -> str:
    """Settings to three digits with their units, current and notes: "port 160 rpm, drift 0.32 m/s to 90 deg"."""
    settings = []
    for name, value in manoeuvre.settings.items():
        digits = _significant_decimals(value, 3) if value % 1.0 else 0
        shown = round(value, digits) % 360.0 if name.endswith("heading_deg") else value
        settings.append(f"{plain_name(name)} {shown:.{digits}f} {unit_in_name(name)}".strip())
    if manoeuvre.current:
        current = manoeuvre.current.as_json()
        settings.append(f"drift {current['speed_mps']:.2f} m/s to {round(current['direction_deg']) % 360} deg")
    return "; ".join(filter(None, [not_counted_text(manoeuvre), ", ".join(settings), *manoeuvre.notes]))


def not_counted_text(manoeuvre: Manoeuvre) -> str:
    """Why a manoeuvre does not count for the criteria, empty where it does."""
    return f"does not count: {manoeuvre.not_counted}" if manoeuvre.not_counted else ""


def conducted_rows(runs: Iterable[ConductedRun]) -> list[list[str]]:
    """One row a run of a programme as it was sailed, in the columns of :data:`CONDUCTED_HEADER`."""
    return [
        [f"{run.number}", run.name, f"{run.time:%Y-%m-%d %H:%M:%S}" if run.time else "",
         run.outcome or "no verdict" * bool(run.ordered), "; ".join(run.reasons), "; ".join(run.notes)]
        for run in runs
    ]  # fmt: skip


def manoeuvre_line(manoeuvre: Manoeuvre) -> list[str]:
    """A manoeuvre's row in the table of all: overshoots from the order, which have the limits, come first, and the
    current is removed where it is known, as in the figure."""
    indices = manoeuvre.indices
    main = [
        name for name in indices if not any(part in name for part in _LATER) and not name.endswith(kinds.REMOVED)
    ]
    main.sort(key=lambda name: "from_order" not in name)
    texts = ", ".join(
        f"{plain_name(name)} {index_cells(indices.get(name + kinds.REMOVED, indices[name]))[0]}"
        + " (current removed)" * (name + kinds.REMOVED in indices)
        for name in main[:_FIRST_INDICES]
    )
    seconds = (manoeuvre.end - manoeuvre.start).total_seconds()
    return [f"{manoeuvre.start:%H:%M:%S}", manoeuvre.sided_name, f"{seconds:.0f} s", texts]


def drop_empty_columns(header: Sequence[str], rows: list[list[str]]) -> tuple[list[str], list[list[str]]]:
    """A table without the columns that hold nothing.

    >>> drop_empty_columns(["index", "limit"], [["reach", ""]])
    (['index'], [['reach']])
    """
    kept = [place for place in range(len(header)) if not rows or any(row[place] for row in rows)]
    return [header[place] for place in kept], [[row[place] for place in kept] for row in rows]


def terminal_tables(result: RecordingManoeuvres, *, all_indices: bool = False) -> Group:
    """A table a manoeuvre for the terminal, of the main indices or of all."""
    blocks: list[Any] = [Text(f"{result.recording}: {manoeuvre_count_text(result.manoeuvres)}", style="bold")]
    for manoeuvre in result.manoeuvres:
        header, rows = drop_empty_columns(HEADER, index_rows_of_manoeuvre(manoeuvre, all_indices=all_indices))
        cells = (list(map(Text, row)) for row in rows)
        blocks += [
            Text(""),
            Text(manoeuvre_headline(manoeuvre), style="bold cyan"),
            Text(manoeuvre_settings_line(manoeuvre), style="dim"),
            terminal_table(None, header, cells, padding=(0, 2, 0, 0)),
        ]
    blocks += [Text(""), *(Text(left_out_line(candidate), style="dim") for candidate in result.left_out)]
    if result.programme:
        cells = (list(map(Text, row)) for row in conducted_rows(result.programme))
        blocks.append(terminal_table(CONDUCTED, CONDUCTED_HEADER, cells, left_aligned=(1, 2, 3, 4, 5)))
    return Group(*blocks)


def trial_criteria_lines(results: Sequence[RecordingManoeuvres]) -> list[str]:
    """What the recordings of each ship show together of IMO's criteria, and what is missing."""
    by_vessel = _runs_by_vessel(results)
    lines = {vessel: criteria_lines(runs) for vessel, runs in by_vessel.items()}
    several = sum(map(bool, lines.values())) > 1
    return [
        f"{vessel}: {line}" if several else line for vessel, vessel_lines in lines.items() for line in vessel_lines
    ]


def criteria_lines(runs: Iterable[Manoeuvre]) -> list[str]:
    """What runs show of IMO's criteria, what is missing, how many do not count; nothing where none is a test."""
    runs = list(runs)
    rows, uncounted = criteria.index_rows(runs), sum(bool(run.not_counted) for run in runs)
    excluded = (
        [f"{uncounted} of {len(runs)} manoeuvres do not count: of the {CONDUCTED}, valid runs alone do."]
        if uncounted
        else []
    )
    if not any(row.criterion for row in rows):
        return excluded
    results = criteria.criterion_results(rows)
    if any(reason.startswith(criteria.NOT_FOR_SHIP) for result in results for reason in result.missing):
        return [criteria.headline_of_criteria(results), *excluded]
    missing = (f"Missing: {reason} ({names})." for reason, names in criteria.shortfalls_of_criteria(results))
    return [criteria.headline_of_criteria(results), *excluded, *missing]


def left_out_line(candidate: LeftOut) -> str:
    """What was left out and why, in one line."""
    seconds = (candidate.end - candidate.start).total_seconds()
    kind = number_text(1, candidate.kind)[2:]
    return f"{candidate.start:%H:%M:%S} left out, no {kind}: {candidate.why} ({seconds:.0f} s)"


def manoeuvre_count_text(manoeuvres: Sequence[Manoeuvre]) -> str:
    """The number of manoeuvres of each kind as text.

    >>> manoeuvre_count_text(())
    'no manoeuvre found'
    """
    counts = Counter(manoeuvre.kind for manoeuvre in manoeuvres)
    return ", ".join(number_text(number, kind) for kind, number in counts.items()) or "no manoeuvre found"


def number_text(number: int, kind: str) -> str:
    """A number of manoeuvres of a kind as text.

    >>> number_text(1, "zigzag"), number_text(2, "course_change"), number_text(3, "crabbing")
    ('1 zigzag', '2 course changes', '3 crabbing runs')
    """
    nouns = {
        "crabbing": "crabbing run", "stopping": "stopping test", "pull_out": "pull-out", "spiral": "direct spiral",
        "williamson_turn": "Williamson turn",
    }  # fmt: skip
    noun = nouns.get(kind, kind.replace("_", " "))
    return f"{number} {noun}{'s' * (number != 1)}"


def write_report(
    results: Sequence[RecordingManoeuvres], folder: Path, length_m: float | None = None
) -> tuple[Path, Path]:
    """Write ``manoeuvres.json`` and ``manoeuvres.html``, a picture of each manoeuvre in it.

    Raises :class:`StorageError`.
    """
    from seatrial.analysis.report.pages import render

    content = summarise_manoeuvres(results, length_m)
    for result, entry in zip(results, content["recordings"], strict=True):
        provenance = provenance_of(result.table, {"length_m": length_m}, Path(result.recording))
        entry |= {"recording": provenance["recording"], "provenance": provenance}
    page = render(
        "manoeuvres.html", title="Manoeuvres", results=results, length_m=length_m,
        criteria=trial_criteria_lines(results),
        subtitle="Indices after ITTC 7.5-04-02-01; criteria of IMO MSC.137(76)",
    )  # fmt: skip
    plain = folder / "manoeuvres.json"
    with written_together(plain):
        write_text(plain, json.dumps(content, indent=2) + "\n")
        return plain, page.write(folder / "manoeuvres.html")


def readable_names(text: str) -> str:
    """A text with every channel's name in it, and every other name with underscores, as a person says it.

    >>> readable_names("port_rpm was interpolated, surge_mps and north_m were not")
    'port shaft speed was interpolated, surge and north position were not'
    """

    def words_of(match: re.Match[str]) -> str:
        name = match[0]
        channel = find_channel(name)
        if channel is None:
            return _UNIT.sub("", name).replace("_", " ")
        if name.endswith("_rpm"):
            return f"{name.removesuffix('_rpm').replace('_', ' ')} shaft speed"
        return _POSITION.get(name) or name.removesuffix(quantities.name_ending_of_unit(channel.unit)).replace(
            "_", " "
        )

    return _NAME.sub(words_of, text)


def error_reason_in_words(text: str) -> str:
    """What went wrong and why, in words: an error's line without the remedy that it ends with.

    >>> error_reason_in_words("the table lacks heading_deg; name it in the column map")
    'the table lacks heading'
    """
    return readable_names(text.partition("; ")[0])


@dataclass(frozen=True, slots=True)
class ShipDimensions:
    """Main dimensions [m], from a vessel file or a person; a person may know the length only.

    ``title`` is the ship's usual name, empty where only the file's ``name`` is known.
    """

    name: str
    over_all_m: float
    between_perpendiculars_m: float
    beam_m: float | None = None
    draught_m: float | None = None
    title: str = ""


def run_sheet_rows(
    recording: Recording,
    one_hz: pd.DataFrame,
    manoeuvres: Iterable[Manoeuvre] = (),
    ship: ShipDimensions | None = None,
) -> Rows:
    """What and its value as text, in the order of a run sheet; what is not known says so.

    ``one_hz`` is the recording once a second. ``manoeuvres`` whose turns show a current give it.
    """
    runs = tuple(manoeuvres)
    conditions = condition_rows(recording, one_hz, runs, ship)
    return [*ship_rows(recording.trial, one_hz, runs, ship), *conditions, *file_rows(recording)]


def ship_rows(
    trial: Trial, one_hz: pd.DataFrame, manoeuvres: Iterable[Manoeuvre], ship: ShipDimensions | None
) -> Rows:
    """The ship's particulars and its loading."""
    stated, particulars = recorded_conditions(trial, pd.DataFrame()), sheets.particulars_in_trial(trial)
    volume_m3, mcr_speed_mps = stated.displacement_m3, stated.speed_at_85_percent_mcr_mps
    displacement = UNKNOWN if volume_m3 is None else f"{volume_m3:{',.5g' if volume_m3 < 1e4 else ',.0f'}} m\u00b3"
    mcr_speed = (
        UNKNOWN
        if mcr_speed_mps is None
        else f"{mcr_speed_mps:.2f} m/s ({mcr_speed_mps / quantities.KNOT_MPS:.1f} kn)"
    )
    mcr_rpm = f" at {particulars.mcr_rpm:g} rpm" if particulars.mcr_rpm else ""
    rating = f"MCR {particulars.mcr_kw:,.0f} kW{mcr_rpm}" if particulars.mcr_kw else ""
    draughts = UNKNOWN if stated.draught_m is None else f"mean {stated.draught_m:g} m"
    if stated.draught_m is not None and stated.trim_m is not None:
        fore_m, aft_m = stated.draught_m - 0.5 * stated.trim_m, stated.draught_m + 0.5 * stated.trim_m
        draughts = f"{fore_m:g} m, {aft_m:g} m, from the mean of {stated.draught_m:g} m and the trim"
    sizes = (ship.between_perpendiculars_m, ship.beam_m, stated.draught_m) if ship else (None,)
    block_coefficient = UNKNOWN
    if particulars.block_coefficient is not None:
        block_coefficient = f"{particulars.block_coefficient:g}"
    elif volume_m3 is not None and None not in sizes:
        block_coefficient = f"{volume_m3 / np.prod(np.array(sizes, dtype=float)):.3f}, from the displacement"
    names = [(actuator.name.replace("_", " "), actuator.kind.replace("_", " "))
             for actuator in (parse_actuators(trial.actuators) if trial.actuators else ())]  # fmt: skip
    actuators = ", ".join(name if kind in name else f"{name} ({kind})" for name, kind in names)
    return [
        ("ship", (ship.title if ship else "") or trial.vessel or UNKNOWN),
        ("ship type", particulars.ship_type or UNKNOWN),
        ("IMO number", particulars.imo_number or UNKNOWN),
        ("hull number, builder", _join_parts(particulars.hull_number, particulars.builder)),
        ("owner", particulars.owner or UNKNOWN),
        ("classification", particulars.classification or UNKNOWN),
        *_dimension_rows(ship, stated, one_hz, manoeuvres),
        ("loading", trial.loading or UNKNOWN),
        ("draughts fore, aft", draughts),
        ("full load draught", _metres_text(stated.full_load_draught_m)),
        ("trim by the stern", _metres_text(stated.trim_m)),
        ("displacement", displacement),
        ("block coefficient", block_coefficient),
        ("metacentric height GM", _metres_text(stated.gm_m)),
        ("rudders", _rudder_text(particulars, stated, ship)),
        ("propellers", _join_parts(
            _count_and_type(particulars.propellers, particulars.propeller_type),
            f"diameter {particulars.propeller_diameter_m:g} m" if particulars.propeller_diameter_m else "")),
        ("engines", _join_parts(_count_and_type(particulars.engines, particulars.engine_type), rating)),
        ("speed at 85 % of the maximum output", mcr_speed),
        *([("actuators", actuators)] if actuators else []),
    ]  # fmt: skip


def condition_rows(
    recording: Recording, one_hz: pd.DataFrame, manoeuvres: Iterable[Manoeuvre], ship: ShipDimensions | None
) -> Rows:
    """Time, place, water and weather of a trial, and where its antenna is."""
    trial = recording.trial
    stated = recorded_conditions(trial, pd.DataFrame())
    state_of_sea = UNKNOWN if stated.sea_state is None else f"state {stated.sea_state}"
    draught_m, depth_m = stated.draught_m or (ship.draught_m if ship else None), stated.water_depth_m
    draughts = f", {depth_m / draught_m:.1f} draughts" if depth_m is not None and draught_m else ""
    soundings = np.atleast_1d(quantities.water_depth_m(one_hz))
    depth = f"{_metres_text(depth_m)}{draughts}"
    if depth_m is None and np.isfinite(soundings).any():
        depth = f"{np.nanmin(soundings):.3g} to {np.nanmax(soundings):.3g} m, measured"
    density = stated.water_density_kgpm3
    wave_direction = "" if stated.wave_from_deg is None else f" from {stated.wave_from_deg:.0f}\u00b0"
    wave_height = UNKNOWN if stated.wave_height_m is None else f"{stated.wave_height_m:g} m{wave_direction}"
    series = recording.series.get("wind_speed_mps")
    if series is None and stated.beaufort is not None:
        wind = f"Beaufort {stated.beaufort}, as stated"
    elif series and series.sources == (ASSUMED,):
        wind = f"{UNKNOWN}, calm assumed"
    else:
        wind = wind_in_words(one_hz)
    ahead_m, starboard_m = trial.antenna_forward_m, trial.antenna_starboard_m or 0.0
    antenna = UNKNOWN if ahead_m is None else f"{ahead_m:g} m forward, {starboard_m:g} m to starboard"
    origin, (first, last) = UNKNOWN, one_hz.index[[0, -1]]
    if trial.origin is not None:
        latitude, longitude = trial.origin
        north, east = "N" if latitude >= 0 else "S", "E" if longitude >= 0 else "W"
        origin = f"{abs(latitude):.5f}\u00b0 {north}, {abs(longitude):.5f}\u00b0 {east}"
    minutes, until = (last - first).total_seconds() / 60.0, f"{last:%Y-%m-%d %H:%M:%S}"
    dates = [("date", UNKNOWN), ("duration", f"{minutes:.1f} min")]
    if has_date(first):
        until = until[11:] if last.date() == first.date() else until
        times = f"{first:%H:%M:%S} to {until}, {minutes:.1f} min"
        dates = [("date", f"{first:%Y-%m-%d}"), ("time, UTC", times)]
    return [
        ("trial", trial.name or UNKNOWN),
        *dates,
        ("place", trial.place or UNKNOWN),
        ("origin of north and east", origin),
        ("water depth", depth),
        ("water temperature, density", _join_parts(
            "" if stated.water_temperature_degc is None else f"{stated.water_temperature_degc:g} \u00b0C",
            f"{density:g} kg/m\u00b3" if density != sheets.REFERENCE_DENSITY_KGPM3 else "")),
        ("wind", wind),
        ("sea state", trial.sea_state or state_of_sea),
        ("significant wave height", wave_height),
        ("current", _current_text(manoeuvres, stated.current_mps)),
        ("antenna from midship", antenna),
        ("crew notes", trial.crew_notes or UNKNOWN),
    ]  # fmt: skip


def _join_parts(*parts: str) -> str:
    return ", ".join(filter(None, parts)) or UNKNOWN


def _count_and_type(number: int | None, what: str) -> str:
    return " ".join(filter(None, (str(number or ""), what)))


def _rudder_text(particulars: sheets.Particulars, stated: sheets.Conditions, ship: ShipDimensions | None) -> str:
    area, draught_m = particulars.rudder_area_m2, stated.full_load_draught_m or (ship.draught_m if ship else None)
    ratio = ""
    if area and ship and draught_m:
        ratio = f" (1/{ship.between_perpendiculars_m * draught_m / area:.0f} of LT)"
    return _join_parts(
        _count_and_type(particulars.rudders, particulars.rudder_type),
        f"area {area:g} m\u00b2{ratio}" if area else "",
        f"{particulars.rudder_rate_dps:g} deg/s" if particulars.rudder_rate_dps else "",
    )


def file_rows(recording: Recording) -> Rows:
    """The file behind a run sheet, and the software."""
    paths = recording.paths
    parts = f" and {len(paths) - 1} later part{'s' * (len(paths) > 2)}" if len(paths) > 1 else ""
    return [
        ("recording", f"{paths[0].name}{parts}, {sum(path.stat().st_size for path in paths):,} bytes"),
        ("SHA-256", sha256_of(*paths) or UNKNOWN),
        ("closed properly", "yes" if recording.closed else "no: read as far as it goes"),
        *([("clock", recording.clock)] if recording.clock else []),
        ("this page by", software_version()),
    ]


def has_date(time: pd.Timestamp) -> bool:
    """Whether a time has a date: those of an unknown start count from 1970."""
    return time.year > 1970


def _metres_text(value: float | None) -> str:
    return UNKNOWN if value is None else f"{value:g} m"


def wind_in_words(table: pd.DataFrame) -> str:
    """The mean wind, where it comes from, how it gusts, and its force."""
    air = table.reindex(columns=["wind_speed_mps", "wind_direction_deg"]).dropna()
    if air.empty:
        return UNKNOWN
    speed_mps, from_deg = quantities.mean_wind_speed_and_direction(air)
    gust = float(np.quantile(air["wind_speed_mps"], 0.99))
    force = beaufort_number(speed_mps)
    return f"{speed_mps:.1f} m/s from {from_deg:.0f}\u00b0, gusts {gust:.1f} m/s, Beaufort {force}"


def _current_text(manoeuvres: Iterable[Manoeuvre], stated_mps: float | None) -> str:
    """The mean of what turns of more than one and a half circles show, with its 95 % interval along itself,
    of two turns half of their range.
    """
    drifts = [run.current for run in manoeuvres if run.current is not None and kinds.shows_current(run)]
    if not drifts and stated_mps is None:
        return "unknown: no turn of one and a half circles"
    if not drifts:
        return f"{stated_mps:g} m/s, as stated"
    north, east = (
        criteria.mean_over_runs([
            index_from_value("", getattr(drift, f"{name}_mps"), getattr(drift, f"{name}_within_mps"))
                 for drift in drifts])
        for name in ("north", "east")
    )  # fmt: skip
    speed = float(np.hypot(north.index.value, east.index.value))
    towards = np.arctan2(east.index.value, north.index.value)
    within = np.hypot(np.cos(towards) * north.half_width, np.sin(towards) * east.half_width)
    turns = f"{len(drifts)} turn{'' if len(drifts) == 1 else 's'}"
    interval = "the range of both" if len(drifts) == 2 else "95 % interval"
    decimals = max(2, _significant_decimals(within, 1))  # a pond's current is known to millimetres a second
    return (
        f"{speed:.{decimals}f} \u00b1 {within:.{decimals}f} m/s towards {np.rad2deg(towards) % 360.0:.0f}\u00b0 "
        f"({interval}), from {turns}, wind drift included"
    )


def _dimension_rows(
    ship: ShipDimensions | None, stated: sheets.Conditions, one_hz: pd.DataFrame, manoeuvres: Iterable[Manoeuvre]
) -> Rows:
    """Dimensions and the ratios that the IMO's form asks for; the speed is that of the fastest approach, or without
    manoeuvres the median of what the ship made good."""
    if ship is None:
        return [("dimensions", "unknown: no vessel file for the ship that the recording names")]
    velocities = one_hz.reindex(columns=["surge_mps", "sway_mps"]).dropna()
    speed = float(np.median(np.hypot(velocities["surge_mps"], velocities["sway_mps"]))) if len(velocities) else 0.0
    approaches = [run.settings["approach_mps"] for run in manoeuvres if "approach_mps" in run.settings]
    speed, whose = (max(approaches), "fastest approach") if approaches else (speed, "median speed")
    length_m, beam_m, draught_m = ship.between_perpendiculars_m, ship.beam_m, stated.draught_m or ship.draught_m
    ratios = [
        f"L/B {length_m / beam_m:.2f}" if beam_m else "",
        f"B/T {beam_m / draught_m:.2f}" if beam_m and draught_m else "",
        f"L/V {length_m / speed:.1f} s at the {whose}, {speed:.2f} m/s over ground" if speed > _SLOWEST_MPS else "",
    ]
    overall = f"{ship.over_all_m:g} m overall, " if ship.over_all_m != length_m else ""
    size = f"{overall}{length_m:g} m between perpendiculars (L)"
    size += f", beam {beam_m:g} m" if beam_m else ""
    size += f", draught {ship.draught_m:g} m" if ship.draught_m else ""
    return [("dimensions", size), ("ratios", _join_parts(*ratios))]


class ManoeuvreTable(pd.DataFrame):
    """One row an index of each manoeuvre; ``recorded`` are the recordings that they were found in, ``pages`` the
    files that were written of them."""

    _metadata = ["recorded", "pages"]  # noqa: RUF012 - as pandas has it
    recorded: tuple[RecordingManoeuvres, ...]
    pages: tuple[Path, ...]

    @property
    def _constructor(self) -> type[ManoeuvreTable]:
        return ManoeuvreTable


def manoeuvre_table(recorded: Sequence[RecordingManoeuvres], pages: Sequence[Path] = ()) -> ManoeuvreTable:
    """The indices of all manoeuvres of some recordings, one row each."""
    rows = [
        {"manoeuvre": run.name, "kind": run.kind, "side": run.side, "start": run.start, "index": name,
         "value": index.value, "low": index.low, "high": index.high, "unit": index.unit, "limit": index.limit,
         "counted_from": index.counted_from, "result": index.result, "missing": "; ".join(index.missing),
         "not_counted": run.not_counted}
        for recording in recorded
        for run in recording.manoeuvres
        for name, index in run.indices.items()
    ]  # fmt: skip
    columns = ["manoeuvre", "kind", "side", "start", "index", "value", "low", "high", "unit", "limit",
               "counted_from", "result", "missing", "not_counted"]  # fmt: skip
    table = ManoeuvreTable(rows, columns=columns)
    table.recorded, table.pages = tuple(recorded), tuple(pages)
    return table
