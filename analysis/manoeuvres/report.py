"""Manoeuvres for people and programs: a table on the screen, JSON, and a page with a picture of each."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from seatrial.acquisition.config.conditions import Conditions
from seatrial.acquisition.config.declarations import length_of_ship
from seatrial.acquisition.config.run_sheet import Statement, conditions_of
from seatrial.acquisition.core.files import write_text, written_together
from seatrial.acquisition.core.trial import software_version
from seatrial.analysis.manoeuvres.criteria import criteria_of, headline_of_criteria, index_rows, shortfalls_of
from seatrial.analysis.manoeuvres.find import RecordedRuns, manoeuvres_and_left_out, runs_of_trial
from seatrial.analysis.manoeuvres.indices import UNITS, Index, LeftOut, Manoeuvre, as_json, unit_of
from seatrial.analysis.manoeuvres.standards import NOT_FOR_SHIP
from seatrial.analysis.manoeuvres.turning_circle import REMOVED
from seatrial.analysis.tables.table import provenance_of, trial_of

if TYPE_CHECKING:
    from rich.console import Group

    from seatrial.acquisition.recording.grouping import Files


@dataclass(frozen=True, slots=True)
class RecordingManoeuvres:
    """The manoeuvres of one recording, with its table."""

    recording: str
    table: pd.DataFrame
    manoeuvres: tuple[Manoeuvre, ...]
    left_out: tuple[LeftOut, ...] = ()
    stated: Conditions = field(default_factory=Conditions)


def manoeuvres_of(
    files: Files, length_m: float | None = None, own: Sequence[str] = (), statement: Statement | None = None
) -> RecordingManoeuvres:
    """The manoeuvres of a recording or its parts, named by its event marks, and those of a user's ``own`` kinds.

    ``statement`` is what a person states of the trial besides the recording. Without ``length_m`` the length is
    that of the statement, of the recording, or of the vessel file of the ship that it names. Raises
    :class:`InputError`, and :class:`DataShortageError` for a recording without channels.
    """
    from seatrial.acquisition.recording.grouping import read_together
    from seatrial.analysis.tables.table import table_of

    recording = read_together(files)
    if statement is not None:
        recording = replace(recording, trial=statement.added_to(recording.trial))
    table = table_of(recording)
    carried_m = length_m or conditions_of(recording.trial).length_m
    known_m = carried_m or length_of_ship(recording.trial.vessel, recording.path.parent)
    stated = Conditions(length_m=known_m)
    runs, left_out = manoeuvres_and_left_out(table, None, recording.events, own, stated)
    return RecordingManoeuvres(str(recording.path), table, runs, left_out, stated)


def with_trial_currents(found: Sequence[RecordingManoeuvres]) -> list[RecordingManoeuvres]:
    """The recordings with their manoeuvres as those of one trial of each ship (:func:`.runs_of_trial`)."""
    by_vessel: dict[str, list[RecordingManoeuvres]] = {}
    for recording in found:
        by_vessel.setdefault(trial_of(recording.table).vessel, []).append(recording)
    runs: dict[str, tuple[Manoeuvre, ...]] = {}
    for recordings in by_vessel.values():
        judged = runs_of_trial([RecordedRuns(entry.table, entry.manoeuvres, entry.stated) for entry in recordings])
        runs |= {recording.recording: trial for recording, trial in zip(recordings, judged, strict=True)}
    return [replace(recording, manoeuvres=runs[recording.recording]) for recording in found]


def summary(found: Sequence[RecordingManoeuvres], length_m: float | None = None) -> dict[str, Any]:
    """All recordings with the keys of the contract."""
    return {
        "criteria": criteria_by_vessel(_runs_by_vessel(found)),
        "recordings": [
            {
                "recording": each.recording,
                "manoeuvres": as_json(each.manoeuvres),
                "left_out": [left.as_json() for left in each.left_out],
            }
            for each in found
        ],
        "length_m": length_m,
        "software_version": software_version(),
    }


def _runs_by_vessel(found: Sequence[RecordingManoeuvres]) -> dict[str, list[Manoeuvre]]:
    runs: dict[str, list[Manoeuvre]] = {}
    for recording in found:
        runs.setdefault(trial_of(recording.table).vessel, []).extend(recording.manoeuvres)
    return runs


def criteria_by_vessel(runs: Mapping[str, Sequence[Manoeuvre]]) -> list[dict[str, Any]]:
    """The criteria of each ship, with the keys of the contract: runs of one are no runs of another."""
    return [
        {"vessel": vessel, **result.as_json()}
        for vessel, trial in runs.items()
        for result in criteria_of(index_rows(trial))
    ]


def plain_name(name: str) -> str:
    """The name of an index or setting for people.

    >>> plain_name("tactical_diameter_m_current_removed")
    'tactical diameter, current removed'
    """
    plain, removed = name.removesuffix("_current_removed"), name.endswith("_current_removed")
    unit = next((suffix for suffix in UNITS if plain.endswith(suffix)), "")
    return plain.removesuffix(unit).replace("_", " ") + (", current removed" if removed else "")


_MOST_FIGURES = 4  # of a value, whatever its interval: no antenna knows a ship's place to millimetres


def index_cells(index: Index) -> tuple[str, str, str, str]:
    """Value, interval, lengths and limit of an index as text, with digits that the interval bears."""
    width = 0.5 * (index.high - index.low)
    most = _digits(index.value or width, _MOST_FIGURES)
    digits = min(_digits(width, 2), most) if width > 0 else most
    interval = f"{index.low:.{digits}f} to {index.high:.{digits}f}" if np.isfinite(width) else ""
    lengths = f"{index.lengths:.2f}" if index.lengths is not None else ""
    limit = f"{index.limit:.1f} {index.unit}" if index.limit is not None else ""
    if index.limit_lengths is not None:
        limit += f" ({index.limit_lengths:.1f} L)"
    return f"{index.value:.{digits}f} {index.unit}".strip(), interval, lengths, limit


def _digits(value: float, significant: int) -> int:
    """The decimals that show so many digits of a value, 4 at most."""
    return int(np.clip(significant - 1 - np.floor(np.log10(abs(value))), 0, 4)) if value else 0


HEADER = ("index", "value", "95 % interval", "lengths", "IMO limit", "result")
_SECONDARY = re.compile(r"time_to_check_yaw_|overshoot_([3-9]|\d\d)|(steady|drift|speed_loss).*_removed")


def rows_of(manoeuvre: Manoeuvre, *, every: bool = True) -> list[list[str]]:
    """One row an index; without ``every`` the first two overshoots stand for all, and the main indices."""
    return [[plain_name(name), *index_cells(index), index.result.replace("_", " ")]
            for name, index in manoeuvre.indices.items() if every or not _SECONDARY.search(name)]  # fmt: skip


def headline(manoeuvre: Manoeuvre) -> str:
    """Time, name and side in one line."""
    seconds = (manoeuvre.end - manoeuvre.start).total_seconds()
    return f"{manoeuvre.start:%H:%M:%S} {manoeuvre.sided_name}, {seconds:.0f} s"


def setting_text(name: str, value: float) -> str:
    """A setting with its unit, to three digits.

    >>> setting_text("port_rpm", 160.04), setting_text("half_command_s", 0.8581), setting_text("swings", 4.0)
    ('port 160 rpm', 'half command 0.858 s', 'swings 4')
    """
    digits = _digits(value, 3) if value % 1.0 else 0
    return f"{plain_name(name)} {value:.{digits}f} {unit_of(name)}".strip()


def subline(manoeuvre: Manoeuvre) -> str:
    """Settings, current and notes."""
    parts = [setting_text(name, value) for name, value in manoeuvre.settings.items()]
    if manoeuvre.current:
        each = manoeuvre.current.as_json()
        parts.append(f"drift {each['speed_mps']:.2f} m/s to {each['direction_deg']:.0f} deg")
    return "; ".join([", ".join(parts), *manoeuvre.notes])


_FIRST_INDICES = 3
_LATER = ("time_to_check", "initial_turning")  # left to the manoeuvre's own table


def manoeuvre_line(manoeuvre: Manoeuvre) -> list[str]:
    """A manoeuvre's row in the table of all: overshoots from the order, which have the limits, stand first, and the
    current is removed where it is known, as in the figure."""
    found = manoeuvre.indices
    main = [each for each in found if not any(part in each for part in _LATER) and not each.endswith(REMOVED)]
    main.sort(key=lambda each: "from_order" not in each)
    indices = ", ".join(
        f"{plain_name(name)} {index_cells(found.get(name + REMOVED, found[name]))[0]}"
        + " (current removed)" * (name + REMOVED in found)
        for name in main[:_FIRST_INDICES]
    )
    seconds = (manoeuvre.end - manoeuvre.start).total_seconds()
    return [f"{manoeuvre.start:%H:%M:%S}", manoeuvre.sided_name, f"{seconds:.0f} s", indices]


def without_empty(header: Sequence[str], rows: list[list[str]]) -> tuple[list[str], list[list[str]]]:
    """A table without the columns that hold nothing.

    >>> without_empty(["index", "limit"], [["reach", ""]])
    (['index'], [['reach']])
    """
    kept = [place for place in range(len(header)) if not rows or any(row[place] for row in rows)]
    return [header[place] for place in kept], [[row[place] for place in kept] for row in rows]


def terminal_tables(found: RecordingManoeuvres, *, every: bool = False) -> Group:
    """A table a manoeuvre for the terminal, of the main indices or of ``every`` one."""
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    blocks: list[Any] = [Text(f"{found.recording}: {count_text(found.manoeuvres)}", style="bold")]
    for each in found.manoeuvres:
        table = Table(box=None, header_style="dim", padding=(0, 2, 0, 0))
        header, rows = without_empty(HEADER, rows_of(each, every=every))
        for title in header:
            table.add_column(title, justify="left" if title == "index" else "right", no_wrap=True)
        for row in rows:
            table.add_row(*map(Text, row))
        blocks += [Text(""), Text(headline(each), style="bold cyan"), Text(subline(each), style="dim"), table]
    blocks += [Text(""), *(Text(left_out_line(each), style="dim") for each in found.left_out)]
    return Group(*blocks)


def trial_criteria_lines(found: Sequence[RecordingManoeuvres]) -> list[str]:
    """What the recordings of each ship show together of IMO's criteria, and what is missing."""
    by_vessel = _runs_by_vessel(found)
    lines = {vessel: criteria_lines(runs) for vessel, runs in by_vessel.items()}
    several = sum(map(bool, lines.values())) > 1
    return [f"{vessel}: {line}" if several else line for vessel, every in lines.items() for line in every]


def criteria_lines(runs: Iterable[Manoeuvre]) -> list[str]:
    """What runs show of IMO's criteria, and what is missing; nothing where none is a test of one."""
    rows = index_rows(runs)
    if not any(row.criterion for row in rows):
        return []
    results = criteria_of(rows)
    if any(reason.startswith(NOT_FOR_SHIP) for result in results for reason in result.missing):
        return [headline_of_criteria(results)]
    missing = (f"Missing: {reason} ({names})." for reason, names in shortfalls_of(results))
    return [headline_of_criteria(results), *missing]


def left_out_line(each: LeftOut) -> str:
    """What was left out and why, in one line."""
    seconds = (each.end - each.start).total_seconds()
    return f"{each.start:%H:%M:%S} left out, no {number_text(1, each.kind)[2:]}: {each.why} ({seconds:.0f} s)"


def count_text(manoeuvres: Sequence[Manoeuvre]) -> str:
    """The number of manoeuvres of each kind as text.

    >>> count_text(())
    'no manoeuvre found'
    """
    counts = Counter(each.kind for each in manoeuvres)
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
    found: Sequence[RecordingManoeuvres], folder: Path, length_m: float | None = None
) -> tuple[Path, Path]:
    """Write ``manoeuvres.json`` and ``manoeuvres.html``, a picture of each manoeuvre in it.

    Raises :class:`StorageError`.
    """
    from seatrial.analysis.report.rendering import render

    content = summary(found, length_m)
    for each, entry in zip(found, content["recordings"], strict=True):
        provenance = provenance_of(each.table, {"length_m": length_m}, Path(each.recording))
        entry |= {"recording": provenance["recording"], "provenance": provenance}
    page = render(
        "manoeuvres.html", title="Manoeuvres", found=found, length_m=length_m,
        criteria=trial_criteria_lines(found),
        subtitle="Indices after ITTC 7.5-04-02-01; criteria of IMO MSC.137(76)",
    )  # fmt: skip
    plain = folder / "manoeuvres.json"
    with written_together(plain):
        write_text(plain, json.dumps(content, indent=2) + "\n")
        return plain, page.write(folder / "manoeuvres.html")
