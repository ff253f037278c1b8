"""Imports tables as recordings: CSV, Parquet, .mat and others, with the contract's columns or by a column map.

Rows stay as they are and in their order, values that a channel cannot hold are kept and flagged bad, and everything
noteworthy is counted.

Proposes a column map for a table without a description: what each column is taken for, in which unit, and why.

Names and headers state quantities and units (:mod:`seatrial.acquisition.tables.evidence`), the numbers decide what
they leave open (:mod:`seatrial.acquisition.tables.channel_columns`), and what is not clear is asked; answers,
``--answer KEY=VALUE``, override a map as well. Columns under standard names are checked against their track, too.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from copy import copy
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from seatrial.acquisition.config.declarations import actuators_of_ship, load_actuators, name_of_vessel
from seatrial.acquisition.core import files, quantities, stores, times
from seatrial.acquisition.core import ship as ships
from seatrial.acquisition.core.errors import ConfigurationError, InputError, Progress, join_words
from seatrial.acquisition.core.trial import Quality, Trial
from seatrial.acquisition.recording.writer import write_table
from seatrial.acquisition.tables import (
    channel_columns,
    column_map,
    column_names,
    evidence,
    time_columns,
    time_reading,
    topics,
)
from seatrial.acquisition.tables.table_files import RawTable, TableFile, non_numeric_cells, parse_numbers

if TYPE_CHECKING:
    from rich.table import Table


LABELS = frozenset({"window", "second", "trial", "leg", "start", "surge_mps2", "sway_mps2", "yaw_dps2"})
"""Columns of our exports that are no channels; they are ignored."""

COMPANION_SUFFIXES = ("_flag", "_sigma")
"""How columns of our exports end that qualify a channel; they are ignored, too."""


@dataclass(frozen=True, slots=True)
class ImportSummary:
    """What an import did."""

    rows: int
    samples: int
    channels: tuple[str, ...]
    out_of_range: dict[str, int] = field(default_factory=dict)
    infinite: dict[str, int] = field(default_factory=dict)
    times_backwards: int = 0
    times_twice: int = 0
    assumed: dict[str, float] = field(default_factory=dict)
    missing: tuple[str, ...] = ()
    derived: dict[str, str] = field(default_factory=dict)
    passed_over: tuple[str, ...] = ()
    dropped: dict[str, int] = field(default_factory=dict)
    empty: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()

    def __str__(self) -> str:
        parts = [f"{self.rows:,} rows, {self.samples:,} samples of {len(self.channels)} channels"]
        parts += [f"{count:,} row{'s' * (count != 1)} {reason} dropped" for reason, count in self.dropped.items()]
        parts += [
            f"{count} values of {name} out of range, flagged bad" for name, count in self.out_of_range.items()
        ]
        parts += [f"{count} values of {name} infinite, not recorded" for name, count in self.infinite.items()]
        if self.times_backwards:
            parts.append(f"{self.times_backwards} times go backwards")
        if self.times_twice:
            parts.append(f"{self.times_twice} times come twice")
        if self.assumed:
            parts.append("assumed: " + ", ".join(f"{name} = {value:g}" for name, value in self.assumed.items()))
        if self.empty:
            parts.append(f"without a single value: {', '.join(self.empty)}")
        if self.missing:
            parts.append(f"missing: {', '.join(self.missing)}")
        if self.derived:
            parts.append("derived: " + ", ".join(f"{name} from {source}" for name, source in self.derived.items()))
        if self.passed_over:
            parts.append(f"ignored: {', '.join(self.passed_over)}")
        parts += self.remarks
        return "; ".join(parts)


def import_table(
    path: Path | str,
    output: Path | str,
    map_path: Path | str | None = None,
    allow_missing: bool = False,
    ignore_unknown: bool = False,
    vessel: Path | str | None = None,
    force: bool = False,
    answers: Mapping[str, str] | None = None,
    progress: Progress = lambda share: None,
) -> ImportSummary:
    """Write a table file as a recording; arguments as those of :func:`read_table_file`.

    Without ``force`` an existing file is not replaced. Raises as :func:`read_table_file`, and
    :class:`StorageError` when the recording cannot be written.
    """
    refuse_overwriting(output, force)
    file = read_table_file(path, map_path, allow_missing, ignore_unknown, vessel, answers)
    return _write_recording(file, output, progress)


def import_proposed(
    raw: RawTable,
    proposal: Proposal,
    output: Path | str,
    map_path: Path | str,
    vessel: Path | str | None = None,
    force: bool = False,
    progress: Progress = lambda share: None,
) -> ImportSummary:
    """Write a table as a recording by a proposed map, and the map to ``map_path`` for later imports.

    Raises :class:`InputError` if a question without a default is not answered, and as :func:`import_table`.
    """
    if proposal.unanswered:
        raise InputError(f"{proposal.unanswered[0]}", where=str(raw.path))
    refuse_overwriting(output, force)
    map_file = Path(map_path)
    if not (map_file.is_file() and map_file.read_bytes() == proposal.text.encode()):
        refuse_overwriting(map_path, force, "import with it by --columns, name another file by --write-map")
    columns, declared = column_map.parse_column_map(proposal.text, map_path)
    with files.written_together(Path(output)):
        files.write_text(map_path, proposal.text)
        summary = _write_recording(_apply_map_to_table(raw, columns, declared, map_path, vessel), output, progress)
    return replace(summary, remarks=())  # the proposal has them among its warnings


def propose_column_map(
    raw: RawTable, answers: Mapping[str, str] | None = None, vessel: Path | str | None = None
) -> Proposal:
    """A map for a table as it is in its file, by the ``answers`` to the questions of an earlier proposal.

    ``vessel`` is the name or the file of the ship, if it is known. Raises :class:`InputError` for a table without
    times, or without any known column.
    """
    ship, ship_name = _actuators_of_vessel(vessel), "" if vessel is None else name_of_vessel(vessel)
    if raw.is_nameless:
        names = raw.names
        fix = f"name its columns, {names[0]!r} to {names[-1]!r}, in a column map (--columns)"
        raise InputError("has no row of names", where=str(raw.path), why="it begins with data", fix=fix)
    answers = answers or {}
    draft = evidence.MappingDraft(raw, _answers_of_table(raw, answers))
    draft.questions += [question for question in raw.questions if question.key not in answers]
    _widen_if_long_table(draft)
    evidence.check_keys(draft.answers, draft.raw.names)
    draft.candidates = evidence.candidates_with_answers(draft)
    if ship_name:
        draft.tree["trial"] = {"vessel": ship_name}
    _keep_rows_of_one_ship(draft)
    time_reading.find_time_columns(draft)
    draft.tree["time"] |= {  # of a log whose times have been settled, all but its day
        _TIME_FIELDS[key]: int(value) if key == "year" else value
        for key, value in (raw.time_answers or {}).items()
        if key != "day"
    }
    used = {draft.tree["time"]["column"], draft.tree["time"].get("date")}
    draft.candidates = [candidate for candidate in draft.candidates if candidate.column not in used]
    seconds = _row_seconds(draft)
    context = evidence.TableContext(draft, seconds, evidence.comparison_grid(seconds))
    assigned = channel_columns.assign_channels(context, ship)
    _add_derived_channels(context, assigned, ship_is_known=bool(ship))
    _declare_channels(context, assigned)
    _doubt_orders(context)
    _check_times(context)
    _drop_rows_with_text(context)
    _drop_stalled_rows(context)
    is_open = any(question.default is None for question in draft.questions)
    if not is_open and not draft.tree.get("channels") and "position" not in draft.tree:
        raise InputError("has no column that is a channel", where=str(raw.path), fix="give a map with --columns")
    for key in [key for key in answers if key not in draft.used_answers | {*(raw.time_answers or ())}]:
        draft.warnings.append(f"the answer {key}={answers[key]} is not used: the table leaves no such question")
    used |= {reading.column for reading in draft.readings}
    comments = {reading.taken_for: "; ".join(reading.reasons) for reading in draft.readings}
    text = evidence.map_as_toml(
        {key: draft.tree[key] for key in (*_KEYS, *draft.tree) if key in draft.tree}, comments
    )
    unused = tuple(name for name in draft.raw.names if name not in used)
    return Proposal(text, tuple(draft.readings), tuple(draft.questions), tuple(draft.warnings), unused)


def is_standard_table(raw: RawTable) -> bool:
    """Whether most of a table's columns, ``time`` among them, are named as the channels.

    Not if further columns are of known quantities, or the times are neither numbers nor ISO 8601.
    """
    names, channels = raw.names, ships.channels_of_trial(raw.trial)
    if (long := column_map.map_of_long_table(raw, channels)) is not None:
        return bool(long.channels)
    standard_names = [
        name for name in names if name == "time" or _is_export_column(name, channels) or ships.find_channel(name)
    ]
    if raw.trial.actuators:
        return True
    recognised = {candidate.column for candidate in evidence.column_candidates(raw)} - set(standard_names)
    if "time" not in names or 2 * len(standard_names) <= len(names) or recognised:
        return False
    times = raw.columns["time"].dropna()
    if times.empty or pd.api.types.is_numeric_dtype(times) or pd.api.types.is_datetime64_any_dtype(times):
        return True
    return bool(pd.to_datetime(times.astype("str"), format="ISO8601", errors="coerce", utc=True).notna().any())


def refuse_overwriting(path: Path | str, force: bool, fix: str = "name another file") -> None:
    """Raise :class:`InputError` for an existing file, unless ``force``."""
    if not force and (stores.exists(path) if stores.is_remote(path) else Path(path).exists()):
        raise InputError(
            "already exists", where=stores.place_name(path), fix=f"{fix}, or use --force to replace it"
        )


def _write_recording(file: TableFile, output: Path | str, progress: Progress) -> ImportSummary:
    """Write a table as a recording."""
    flags = quality_flags(file.table, file.trial)
    samples = write_table(file.table, output, file.trial, file.sources, flags, progress=progress)
    step_ns = np.diff(pd.DatetimeIndex(file.table.index).as_unit("ns").asi8)
    infinite = {str(name): int(np.isinf(column).sum()) for name, column in file.table.items()}
    outside = {name: int((flag == Quality.BAD).sum()) for name, flag in flags.items()}
    return ImportSummary(
        rows=len(file.table),
        samples=samples - sum(infinite.values()),  # JSON has no infinity, so these are not in the recording
        channels=tuple(map(str, file.table.columns)),
        out_of_range={name: count for name, count in outside.items() if count},
        infinite={name: count for name, count in infinite.items() if count},
        times_backwards=int((step_ns < 0).sum()),
        times_twice=int((step_ns == 0).sum()),
        assumed=file.assumed,
        missing=_missing_required_channels(file),
        derived={
            name: source.removeprefix(column_map.DERIVED_FROM)
            for name, source in file.sources.items()
            if source.startswith(column_map.DERIVED_FROM)
        },
        passed_over=file.passed_over,
        dropped=file.dropped,
        empty=tuple(str(name) for name, column in file.table.items() if column.isna().all()),
        remarks=file.remarks,
    )


def read_table_file(
    path: Path | str,
    map_path: Path | str | None = None,
    allow_missing: bool = False,
    ignore_unknown: bool = False,
    vessel: Path | str | None = None,
    answers: Mapping[str, str] | None = None,
) -> TableFile:
    """A CSV, Parquet or .mat file in the contract's columns and units.

    Without a map the columns are named as the channels and ``time``. The ship is that of the file ``vessel``, whose
    name the recording then carries; without it the actuators are those of the map or the table, or of the columns'
    names (:func:`actuators_in_columns`). ``answers`` are those of ``--answer``: they override the map. Raises
    :class:`InputError` for what cannot be read, for columns that are no channels unless ``ignore_unknown``, and for
    a table that lacks one of the ship's channels unless ``allow_missing``; :class:`ConfigurationError` for an
    invalid map or vessel file.
    """
    if map_path is not None:
        columns, declared = column_map.parse_column_map(files.read_text(map_path), map_path)
        stated = {key: str(value) for key, name in _TIME_FIELDS.items() if (value := getattr(columns.time, name))}
        raw = topics.read_table_or_log(path, columns.numeric_columns, stated | {**(answers or {})})
        _require_answers(raw)
        columns = apply_map_answers(columns, _answers_of_table(raw, answers or {}))
        return _apply_map_to_table(raw, columns, declared, map_path, vessel, allow_missing)
    raw = topics.read_table_or_log(path, answers=answers)
    _require_answers(raw)
    answers = _answers_of_table(raw, answers or {})
    ship, fix = _actuators_of_vessel(vessel), "give it a constant in a map (--columns), or use --allow-missing"
    long = column_map.map_of_long_table(raw, ships.channel_names(ship or ships.DEFAULT))
    if long is None:
        file, fix = _read_standard(raw, ignore_unknown, ship, answers, vessel), f"add the column, {fix}"
    else:
        file = column_map.apply_column_map(raw, long, path)
        file = _assign_ship(
            file, ship or actuators_in_columns(map(str, file.table), file.trial), raw, vessel, is_known=bool(ship)
        )
    return _require_channels(file, raw, allow_missing, fix)


def _answers_of_table(raw: RawTable, answers: Mapping[str, str]) -> dict[str, str]:
    """The answers that concern a table: without those to the times of a log, which are read already."""
    settled = () if raw.time_answers is None else topics.TIME_ANSWERS
    return {key: value for key, value in answers.items() if key not in settled}


def _require_answers(raw: RawTable) -> None:
    """Raise :class:`InputError` for a log whose times leave a question without a default."""
    if (question := next((entry for entry in raw.questions if entry.default is None), None)) is not None:
        raise InputError(str(question), where=str(raw.path))


def _actuators_of_vessel(vessel: Path | str | None) -> ships.Actuators:
    return () if vessel is None else load_actuators(vessel)


def _apply_map_to_table(
    raw: RawTable,
    columns: column_map.ColumnMap,
    declared: ships.Declared,
    map_path: Path | str,
    vessel: Path | str | None,
    allow_missing: bool = False,
) -> TableFile:
    """A table by its map, of the given ship, else the map's, else that of its columns."""
    ship = _actuators_of_vessel(vessel)
    file = column_map.apply_column_map(raw, columns, map_path, declared)
    stated_ship = ship or columns.actuators or actuators_of_ship(columns.trial.vessel, Path(map_path).parent)
    ship = stated_ship or actuators_in_columns([*file.table, *columns.absent], file.trial)
    channels = ships.channel_names(ship, declared)
    if unknown := next((name for name in columns.channels if name not in channels), ""):
        actuator_names = ", ".join(actuator.name for actuator in ship)
        name = _name_with_similar_channel(unknown, channels)
        what = f"{name} is not a channel of a ship with actuators {actuator_names}"
        where = column_map.key_location_in_map(map_path, ["channels", unknown])
        raise ConfigurationError(what, where=where, fix="correct the name, or give the ship with --vessel FILE")
    file = _assign_ship(file, ship, raw, vessel, is_known=bool(stated_ship))
    allow_missing = allow_missing or set(_missing_required_channels(file)) <= set(columns.absent)
    fix = f"give it a column or a constant in {map_path}, or list it under `absent` there"
    return _require_channels(file, raw, allow_missing, fix)


def _require_channels(file: TableFile, raw: RawTable, allow_missing: bool, fix: str) -> TableFile:
    """The table; raises :class:`InputError` if it lacks a required channel."""
    missing = _missing_required_channels(file)
    if missing and not allow_missing:
        raise InputError(f"has no {', '.join(missing)}", where=str(raw.path), fix=fix)
    if file.table.columns.empty:
        raise InputError("has no column that is a channel", where=str(raw.path), fix="give a map with --columns")
    return file


def _missing_required_channels(file: TableFile) -> tuple[str, ...]:
    """The channels that a table lacks; an unknown ship has no further controls than the table."""
    trial, columns = file.trial, file.table.columns
    is_known = ships.is_ship_known(trial.vessel, trial.actuators)
    return tuple(
        name
        for name in ships.required_channel_names(
            ships.parse_actuators(trial.actuators), columns, ship_is_known=is_known
        )
        if name not in columns
    )


def actuators_in_columns(names: Iterable[str], trial: Trial) -> ships.Actuators:
    """The actuators of a table whose ship lists none: by its columns, without channels that the trial declares.

    R/V Gunnerus' if some of them are hers and others are not, so that a misspelt one is detected.
    """
    actuators = ships.actuators_of_table(names, {"trial": {"channels": trial.channels, "vessel": trial.vessel}})
    is_default = {actuator.name in {default.name for default in ships.DEFAULT} for actuator in actuators}
    return ships.DEFAULT if is_default == {True, False} else actuators


def _read_standard(
    raw: RawTable,
    ignore_unknown: bool,
    ship: ships.Actuators,
    answers: Mapping[str, str],
    vessel: Path | str | None,
) -> TableFile:
    """A table whose columns are named as the channels."""
    present = raw.names
    if "time" not in present:
        similar = get_close_matches("time", present, n=1) or present[:6]
        where, fix = str(raw.path), "rename the column, or name it in a column map (--columns)"
        raise InputError("has no column `time`", where=where, why=f"it has {', '.join(similar)}", fix=fix)
    stated_ship = ship or (ships.parse_actuators(raw.trial.actuators) if raw.trial.actuators else ())
    ship = stated_ship or actuators_in_columns(present, raw.trial)
    channels = ships.channels_of_trial(replace(raw.trial, actuators=ships.actuators_as_text(ship)))
    unknown = tuple(
        name
        for name in present
        if name not in channels and name != "time" and not _is_export_column(name, channels)
    )
    if unknown and not ignore_unknown:
        ship_hint = "; give the ship with --vessel FILE" if any(map(ships.channel_from_name, unknown)) else ""
        what = f"has unknown columns {', '.join(_name_with_similar_channel(name, channels) for name in unknown)}"
        fix = f"rename them, map them with --columns MAP.toml, or use --ignore-unknown{ship_hint}"
        raise InputError(what, where=str(raw.path), fix=fix)
    time_answers = {key: value for key, value in answers.items() if key in _TIME_FIELDS}
    column_answers = {key: value for key, value in answers.items() if key not in _TIME_FIELDS}
    time = apply_time_answers(time_columns.standard_time_column(raw), time_answers)
    timed = time_columns.resolve_times(raw, time, strict=True)
    names = [name for name in channels if name in present and answers.get(f"unit.{name}") != evidence.SKIP]
    table = pd.DataFrame({name: parse_numbers(timed.raw, name) for name in names}, index=timed.index)
    for name in names:
        values = table[name].to_numpy()
        if ships.is_off_by_whole_turns(channels[name], values):  # all else stays, to be flagged
            table[name] = ships.wrap_to_range(channels[name], values)
    file = TableFile(table, raw.trial, dict.fromkeys(names, "table"), unknown, remarks=timed.remarks)
    _correct_conventions_by_track(file, timed.raw, time, column_answers)
    plane, globe = _TRACK_CHANNELS[:2], _TRACK_CHANNELS[2:]
    if set(globe) <= set(names) and set(plane).isdisjoint(names):
        latitude, longitude = (file.table[name].to_numpy() for name in globe)
        column_map.add_projected_position(file, latitude, longitude, globe, raw.path)
    return _assign_ship(file, ship, raw, vessel, is_known=bool(stated_ship))


def _assign_ship(
    file: TableFile, ship: ships.Actuators, raw: RawTable, vessel: Path | str | None, *, is_known: bool
) -> TableFile:
    """The table in the order of the ship's channels; its trial gets the names and the ship's actuators."""
    name = file.trial.vessel if vessel is None else name_of_vessel(vessel)
    text = ships.actuators_as_text(ship, omit_default=not is_known or name in ships.SHIPPED)
    file.trial = replace(file.trial, name=file.trial.name or raw.name, vessel=name, actuators=text)
    file.table = file.table[[name for name in ships.channels_of_trial(file.trial) if name in file.table]]
    return file


def _is_export_column(name: str, channels: Collection[str]) -> bool:
    """Whether a column of our exports is no channel."""
    stems = {name, *(name.removesuffix(ending) for ending in COMPANION_SUFFIXES)}
    return not stems.isdisjoint(LABELS) or (name not in channels and not stems.isdisjoint(channels))


def _name_with_similar_channel(name: str, channels: Collection[str]) -> str:
    similar = get_close_matches(name.lower(), channels, n=1, cutoff=0.5)
    return f"{name} (did you mean {similar[0]}?)" if similar else name


def quality_flags(table: pd.DataFrame, trial: Trial | None = None) -> dict[str, quantities.Bytes]:
    """Flags by channel [rows]: bad for a number that the channel cannot hold, not evaluated for all others.

    ``trial`` states the declared channels.
    """
    flags, channels = {}, ships.channels_by_name_of(trial or Trial())
    for name, column in table.items():
        values = column.to_numpy(dtype=float)
        outside = np.isfinite(values) & ~ships.possible_mask(channels[str(name)], values)
        flags[str(name)] = np.where(outside, Quality.BAD, Quality.NOT_EVALUATED).astype(np.uint8)
    return flags


_MOST_VARIABLES = 500
_MOST_WORDS = 0.2  # of the cells of a column of numbers
_MOST_OPTIONS = 8
_SHIP_NAMES = frozenset({"mmsi", "imo", "imo number", "callsign", "call sign", "vessel name", "ship name", "boat"})
_SENDER_NAMES = frozenset(
    {"src", "source", "device", "sensor", "source id", "device id", "sensor id", "source address"}
)
_HALF, _IN_TURN = 0.5, 0.2  # of a sender's rows are filled; of the rows are another sender's than the row before
_MOST_TWICE = 0.01  # of the rows
_LONGEST_S, _SHORTEST_STEP_S = 400 * 86_400.0, 1e-3
_KEYS = ("absent", "derive", "unreadable_rows", "stalled_rows", "trial", "actuator", "only", "long", "time",
         "position", "orientation", "velocity", "channels")  # fmt: skip
"""A map's first keys in their order: plain values, the ship, the time, the channels."""
_ORDER_OFF_DEG = 5.0  # beyond any trim of a steering gear
_DECLARED = {
    "power": ("shaft_power_kw", "kW"),
    "torque": ("shaft_torque_knm", "kNm"),
    "thrust": ("shaft_thrust_kn", "kN"),
    "current_speed": ("current_speed_mps", "m/s"),
    "current_direction": ("current_direction_deg", "deg"),
}
"""Quantities that are no channels of a trial unless a map declares them; those of a shaft begin with its name."""
_HULL_AXES = frozenset({"roll", "heel", "pitch", "yaw", "bending"})
"""Words of a moment that is no shaft's."""


@dataclass(frozen=True, slots=True)
class Proposal:
    """A map as TOML, what the columns were taken for, the questions, and warnings.

    A terminal shows the columns, what they were taken for, their units and the reasons.
    """

    text: str
    readings: tuple[evidence.ColumnReading, ...]
    questions: tuple[evidence.Question, ...]
    warnings: tuple[str, ...]
    passed_over: tuple[str, ...]

    @property
    def unanswered(self) -> tuple[evidence.Question, ...]:
        """The questions that have to be answered before an import."""
        return tuple(question for question in self.questions if question.default is None)

    def __rich__(self) -> Table:
        from rich.table import Table

        table = Table(box=None, header_style="dim", padding=(0, 1, 0, 0))
        for title in ("column", "taken for", "unit", "because"):
            table.add_column(title, overflow="fold")
        for reading in self.readings:
            cells = (reading.column, reading.taken_for, reading.unit, "; ".join(reading.reasons))
            table.add_row(*cells, style="dim" if reading.taken_for == "-" else "")
        for name in self.passed_over:
            table.add_row(name, "-", "", "not known, ignored", style="dim")
        return table


def _widen_if_long_table(draft: evidence.MappingDraft) -> None:
    """Widen a table that has a row for each value."""
    candidates = evidence.column_candidates(draft.raw)

    def columns_of(*names: str) -> list[str]:
        return [candidate.column for candidate in candidates if candidate.quantity.name in names]

    keys, values = columns_of("time", "date"), columns_of("value")
    for variable in columns_of("variable"):
        column = draft.raw.columns[variable]
        names = column.dropna().unique()
        is_text = not pd.api.types.is_numeric_dtype(column.dtype)
        if is_text and keys and values and 1 < len(names) <= min(_MOST_VARIABLES, column.size // 2):
            long = column_map.LongLayout(variable, values[0], next(iter(columns_of("unit")), None))
            draft.tree["long"] = {key: value for key, value in vars(long).items() if value is not None}
            draft.raw, duplicates = column_map.widen_long_table(draft.raw, long, keys, names)
            if duplicates:
                draft.warnings.append(f"{duplicates:,} values come twice of one variable and time; the last counts")
            return


def _keep_rows_of_one_ship(draft: evidence.MappingDraft) -> None:
    """Ask which rows are taken of a table of several ships, or of several senders that state the same."""
    times = {candidate.column for candidate in draft.candidates_for("time", "date")}
    columns = [candidate.column for candidate in draft.candidates if candidate.column not in times]
    for column in draft.raw.names:
        words = " ".join(column_names.split_into_words(column))
        if words not in _SHIP_NAMES | _SENDER_NAMES:
            continue
        names = column_map.cells_as_names(draft.raw.columns[column])
        counts = names[names != ""].value_counts()
        if counts.size < 2 or (words in _SENDER_NAMES and counts.size > _MOST_VARIABLES):
            continue
        if words in _SHIP_NAMES and np.any(draft.numbers_or_nan(column) % 1.0 > 0.0):
            continue  # no numbers of ships, but what a boat did
        if words in _SENDER_NAMES:
            filled = draft.raw.columns[[name for name in columns if name != column]].notna().groupby(names).mean()
            if not (filled > _HALF).sum().gt(1).any() or (names != names.shift()).mean() < _IN_TURN:
                continue
        text = (
            f"{column!r} has {counts.size:,} values, such as {counts.index[0]} in {counts.iloc[0]:,} rows: which is"
        )
        options = [*counts.index] if counts.size <= _MOST_OPTIONS else ()
        answer = draft.ask("only", f"{text} the ship's? (skip takes all rows)", options)
        if answer in (None, evidence.SKIP):
            return
        only = column_map.OnlyRows(column, answer)
        draft.raw = only.select(draft.raw)
        if not len(draft.raw.columns):
            raise ConfigurationError(f"answer only={answer} cannot be used", why=f"{column!r} has no such value")
        draft.tree["only"] = {"column": column, "value": answer}
        draft.note_interpretation(column, "-", "", f"the rows with {answer} are taken")
        return


def _row_seconds(draft: evidence.MappingDraft) -> quantities.Floats:
    """Seconds of the rows since the first, NaN without a time; rows are put in the order of their writing."""
    time = time_columns.TimeColumn(**draft.tree["time"])
    timed = time_columns.resolve_times(draft.raw, replace(time, zone=time.zone or "UTC"))
    draft.raw = timed.raw
    draft.warnings.extend(timed.remarks)
    ns = timed.index.asi8
    has_time = ~np.asarray(timed.index.isna())
    cells = draft.raw.columns[time.column]
    if not has_time.any():
        example = next(iter(cells.dropna()), "")
        what = f"no time of column {time.column!r} can be read, like {str(example)!r}"
        raise InputError(what, where=str(draft.raw.path))
    if not has_time.all():
        draft.tree["unreadable_rows"] = "drop"
        row = int(np.flatnonzero(~has_time)[0])
        draft.warnings.append(
            f"{int((~has_time).sum()):,} rows have no time that can be read, like {str(cells.iloc[row])!r} in row"
            f" {row + 1}; they are dropped"
        )
    time_reading.ask_zone_of_changed_clock(draft, ns[has_time])
    return np.where(has_time, (ns - ns[has_time][0]) / 1e9, np.nan)


def _add_derived_channels(context: evidence.TableContext, ship: ships.Actuators, *, ship_is_known: bool) -> None:
    """Put the assigned channels into the map, those that follow from them, and those that are absent."""
    draft, present = context.draft, set(context.channels) | set(context.series)
    derivable: tuple[str, ...] = ("speed_over_ground_mps", "course_over_ground_deg") if "north_m" in present else ()
    if "heading_deg" in present:
        has_velocity = bool(derivable) or {"course_over_ground_deg", "speed_over_ground_mps"} <= present
        derivable = ("yaw_rate_dps", *(("surge_mps", "sway_mps") if has_velocity else ()))
        if "heading_deg" not in context.channels and "orientation" not in draft.tree:
            present.discard("heading_deg")  # of a magnetic one and the variation
            derivable = ("heading_deg", *derivable)
    elif derivable:
        body = {"surge_mps": "surge", "sway_mps": "sway", "yaw_rate_dps": "yaw rate"}
        lacking = [word for name, word in body.items() if name not in present]
        what = f": {join_words(lacking)} are left out" if lacking else ""
        draft.warnings.append(f"no column tells the heading{what}")
    if derived := [name for name in derivable if name not in present]:
        draft.tree["derive"] = derived
    present |= set(derived)
    if {"true_wind", "wind_velocity"} & {*draft.tree}:
        present |= {"wind_direction_deg", "wind_speed_mps"}
    if "apparent_wind" in draft.tree:
        if {"surge_mps", "sway_mps"} <= present:
            present |= {"wind_direction_deg", "wind_speed_mps"}
        else:
            del draft.tree["apparent_wind"]
    draft.tree["channels"] = context.channels
    states_ship = ship_is_known or "actuator" in draft.tree
    required = ships.required_channel_names(ship, present, ship_is_known=states_ship)
    draft.tree["absent"] = [name for name in required if name not in present]


def _declare_channels(context: evidence.TableContext, ship: ships.Actuators) -> None:
    """Declare in the map what was measured beside a trial's channels: shaft power, torque, thrust and current."""
    draft = context.draft
    for name, (channel, unit) in _DECLARED.items():
        for candidate in draft.candidates_for(name):
            side = channel_columns.side_of_words(candidate.words) if channel.startswith("shaft_") else ""
            shaft = ships.drive_named(side, ship)
            declared = f"{shaft.name}_{channel}" if side and shaft else channel
            taken = context.channels.get(declared)
            why_left_out = (
                "it is no shaft's" if not candidate.words.isdisjoint(_HULL_AXES)
                else f"no shaft of the ship is called {side}" if side and not shaft
                else "its head names no unit" if not candidate.units
                else f"{taken['column']!r} is taken for it" if taken else ""
            )  # fmt: skip
            if why_left_out:
                draft.warnings.append(f"{candidate.column!r} is left out: {why_left_out}")
                draft.note_interpretation(candidate.column, "-", "", f"left out: {why_left_out}")
                continue
            draft.tree.setdefault("channel", []).append({"name": declared, "unit": unit, "range": [-1e5, 1e5]})
            context.channels[declared] = {"column": candidate.column, "unit": candidate.units[0]}
            if codes := evidence.codes_far_from_values(draft.numbers_or_nan(candidate.column)):
                context.channels[declared]["missing"] = codes
                text = ", ".join(f"{code:g}" for code in codes)
                draft.warnings.append(
                    f"{candidate.column!r} is {text} in some rows: it is taken for no value there"
                )
            draft.note_interpretation(
                candidate.column, declared, candidate.units[0], "by its name; the map declares the channel"
            )


def _doubt_orders(context: evidence.TableContext) -> None:
    """Warn of ordered angles that are not those which were reached, as raw counts with another value amidships.

    A lag and a dead band leave the means of both alike; signs are found with those of the angles.
    """
    for control in [name for name in context.channels if name.endswith("_angle_deg")]:
        name = ships.order_channel_name(control)
        if not {name, control} <= set(context.series):
            continue
        above_deg = ships.wrap_180(context.series[name] - context.series[control])
        above_deg = above_deg[np.isfinite(above_deg)]
        if above_deg.size and abs(above_deg.mean()) > _ORDER_OFF_DEG:
            column, off = context.channels[name]["column"], f"{above_deg.mean():+.0f} deg"
            context.draft.warnings.append(
                f"{column!r}, taken for {name}, is {off} off {control} on average, as raw counts are: "
                "give it its scale and offset in the map, or leave it out"
            )


def _drop_rows_with_text(context: evidence.TableContext) -> None:
    """Drop rows in which a column of numbers holds a word, if they are few, and report them."""
    draft = context.draft
    for column in dict.fromkeys(str(entry["column"]) for entry in context.channels.values()):
        cells = draft.raw.columns[column]
        words = non_numeric_cells(cells)
        if 0 < np.count_nonzero(words) <= _MOST_WORDS * cells.notna().sum():
            row = int(np.flatnonzero(words)[0])
            draft.tree["unreadable_rows"] = "drop"
            cell = f"{str(cells.iloc[row])!r} in row {row + 1}"
            draft.warnings.append(
                f"{np.count_nonzero(words):,} rows have no number in {column!r}, like {cell}; they are dropped"
            )


def _drop_stalled_rows(context: evidence.TableContext) -> None:
    """Leave the motion out where the connection stalled, and report it."""
    motion = {name: values for name, values in context.series.items() if name in column_map.MOTION_CHANNELS}
    stalled = column_map.stalled_row_mask(context.t, pd.DataFrame(motion))
    if stalled.any():
        context.draft.tree["stalled_rows"] = "drop"
        first = context.t[np.flatnonzero(stalled)[0]]
        context.draft.warnings.append(
            f"in {np.count_nonzero(stalled):,} rows, the first {first:.0f} s from the start, all of the motion"
            " repeats the row before, or then comes too fast, as when a connection stalls: it is left out there"
        )


def _check_times(context: evidence.TableContext) -> None:
    """Warn if span, step or track cannot be those of a trial."""
    has_time = np.isfinite(context.t)
    steps, warnings = np.diff(context.t[has_time]), context.draft.warnings
    if steps.size == 0:
        return
    fullest = max(
        context.series.values(), key=lambda series: np.count_nonzero(np.isfinite(series)), default=context.t
    )
    rows = has_time & np.isfinite(fullest)  # beside them a log has the times of its other topics
    span = float(np.ptp(context.t[has_time]))
    row_step = float(np.median(np.abs(np.diff(context.t[rows])))) if np.count_nonzero(rows) > 1 else 0.0
    if span > _LONGEST_S:
        days = span / 86_400
        warnings.append(f"the table lasts {days:.0f} days: day and month in the wrong order, or ms for s?")
    elif 0.0 < row_step < _SHORTEST_STEP_S:
        warnings.append(f"rows are {row_step:.2g} s apart: the times may be in a larger unit")
    if count := np.count_nonzero(steps < 0.0):
        row = int(np.flatnonzero(steps < 0.0)[0]) + 1
        warnings.append(
            f"times that go back: {count:,}, the first by {-steps[row - 1]:.6g} s at row {row + 1}: was the clock"
            " set, or are files put together that overlap?"
        )
    if (count := np.count_nonzero(steps == 0.0)) > _MOST_TWICE * steps.size:
        warnings.append(f"{count:,} rows have the time of the row before: are the times cut off?")
    forward = steps > 0.0
    if "north_m" not in context.series or not forward.any():
        return
    has_position = has_time & np.isfinite(context.series["north_m"] + context.series["east_m"])
    distance = np.hypot(*(np.diff(context.series[name][has_position]) for name in ("north_m", "east_m")))
    steps = np.diff(context.t[has_position])
    speeds = distance[steps > 0.0] / steps[steps > 0.0]
    speed = float(np.median(speeds)) if speeds.size else 0.0
    if speed > channel_columns.FASTEST_MPS:
        warnings.append(
            f"by its positions the ship makes {speed:.3g} m/s half of the time: times in ms, or positions in"
            " another unit?"
        )


_TIME_FIELDS = {
    "zone": "zone",
    "start": "start",
    "day": "day",
    "date_order": "order",
    "time_unit": "unit",
    "year": "year",
}
"""The parts of ``[time]`` by the key of the answer."""


def apply_map_answers(columns: column_map.ColumnMap, answers: Mapping[str, str]) -> column_map.ColumnMap:
    """A map with the times, units and full scales as answered.

    Raises :class:`ConfigurationError` for an invalid answer, or one to no question of the map.
    """
    channels = dict(columns.channels)
    for key, value in answers.items():
        if key in _TIME_FIELDS:
            continue
        evidence.check_answer(key, value)
        kind, _, name = key.partition(".")
        answered: list[str] = []
        if kind == "unit" and name:
            answered = [channel for channel, entry in channels.items() if entry.column == name]
        elif kind == "full_scale":
            scaled = [channel for channel, entry in channels.items() if entry.unit == "percent"]
            answered = [
                channel for channel in scaled if not name or channel in (f"{name}_rpm", f"{name}_angle_deg")
            ]
        if not answered:
            raise ConfigurationError(f"the answer {key} is to no question of this table", fix="change the map")
        for channel in answered:
            if kind == "full_scale":
                channels[channel] = replace(channels[channel], full_scale=float(value))
            else:
                channels[channel] = replace(
                    channels[channel], unit=next(iter(column_names.parse_units(value)), value)
                )
    time_answers = {key: value for key, value in answers.items() if key in _TIME_FIELDS}
    result = copy(columns)  # `replace` would check channels that the map declares without their declarations
    object.__setattr__(result, "time", apply_time_answers(columns.time, time_answers))
    object.__setattr__(result, "channels", channels)
    return result


def apply_time_answers(time: time_columns.TimeColumn, answers: Mapping[str, str]) -> time_columns.TimeColumn:
    """A time column with its zone, start, day, order and unit as answered; a zone in the text is then ignored."""
    for key, value in answers.items():
        if key not in _TIME_FIELDS:
            raise ConfigurationError(f"the answer {key} is to no question of this table", fix="name a column map")
        evidence.check_answer(key, value)
        is_counted = time.format == "seconds"
        is_useless = {
            "zone": is_counted and time.in_name is None and not (time.in_head or value in times.ATOMIC_CLOCKS),
            "date_order": time.format != time_columns.TEXT,
            "year": time.format != time_columns.TEXT,
            "time_unit": not is_counted,
            "day": time.day is None,
        }
        if is_useless.get(key, False):
            raise ConfigurationError(
                f"the answer {key}={value} has no use: column {time.column!r} is read as {time.format!r}",
                fix="leave it out, or change `format` under [time] in the map",
            )
        change: dict[str, Any] = {_TIME_FIELDS[key]: int(value) if key == "year" else value}
        if key == "start":
            change = {"start": time_columns.add_zone_to_instant(value), "in_name": None, "in_head": False}
        time = replace(time, **change)
    return replace(time, zone_in_text="ignored") if "zone" in answers else time


_MOST_POINTS = 4000  # more cannot be distinguished on a page
_TRACK_CHANNELS = ("north_m", "east_m", "latitude_deg", "longitude_deg")


def draw_preview(raw: RawTable, proposal: Proposal, path: Path) -> None:
    """Draw the track and all channels over time, as an import would have them, into a PNG file.

    The line of an angle is broken where it wraps. Raises :class:`StorageError` if the file cannot be written.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    columns, declared = column_map.parse_column_map(proposal.text, path)
    file = column_map.apply_column_map(raw, columns, path, declared)
    table = file.table.iloc[:: max(1, len(file.table) // _MOST_POINTS)]
    names = [name for name in map(str, table.columns) if name not in _TRACK_CHANNELS]
    rows = max(4, -(-len(names) // 2))
    figure = Figure(figsize=(14.0, 1.5 * rows + 1.0), layout="constrained")
    grid = figure.add_gridspec(rows, 3, width_ratios=(1.3, 1.0, 1.0))
    track = figure.add_subplot(grid[: -(-rows // 2), 0])
    if {"north_m", "east_m"} <= set(table.columns):
        track.plot(table["east_m"], table["north_m"], color="#1f4e79", linewidth=1.0)
        track.set(xlabel="east [m]", ylabel="north [m]", title=raw.path.name, aspect="equal", adjustable="datalim")
    else:
        track.set_axis_off()

    readings = {reading.taken_for: reading for reading in proposal.readings}
    channels = ships.channels_by_name_of(file.trial)
    for number, name in enumerate(names):
        present = table[name].dropna()
        times = np.asarray(
            (pd.DatetimeIndex(present.index) - table.index[0]) / pd.Timedelta(minutes=1), dtype=float
        )
        values: quantities.Floats = present.to_numpy().astype(np.float64)
        if ships.is_circular(name) and values.size and np.ptp(ships.unwrap(values)) != 0.0:
            breaks = ships.full_circle_jumps(values)
            times, values = np.insert(times, breaks, times[breaks]), np.insert(values, breaks, np.nan)
        axes = figure.add_subplot(grid[number % rows, 1 + number // rows])
        axes.plot(times, values, color="#1f4e79", linewidth=0.8)
        source = "derived"
        if reading := readings.get(name):
            source = reading.column + (f" ({reading.unit})" if reading.unit not in reading.column else "")
        axes.set_title(f"{name}  ←  {source}", fontsize=8, loc="left")
        axes.set_ylabel(ships.channel_unit(name, channels), fontsize=8)
        axes.tick_params(labelsize=7)
    figure.supxlabel(f"minutes since {table.index[0]:%Y-%m-%d %H:%M:%S} UTC", fontsize=8)
    FigureCanvasAgg(figure)
    with files.atomic_file(path) as partial:
        figure.savefig(partial, format="png")


def _correct_conventions_by_track(
    file: TableFile, raw: RawTable, time: time_columns.TimeColumn, answers: Mapping[str, str]
) -> None:
    """Convert the columns of motion whose track shows another unit, sense or axes than their names state.

    ``raw`` are the rows of ``file`` before any conversion, ``time`` their time column, ``answers`` those that are
    not about times. Raises :class:`InputError` with a question that the track leaves open, and
    :class:`ConfigurationError` for an answer to no question.
    """
    names = [name for name in map(str, file.table) if name in ships.BY_NAME and raw.columns[name].notna().any()]
    draft = evidence.MappingDraft(replace(raw, columns=raw.columns[names]), answers)
    evidence.check_keys(answers, names)
    draft.candidates = evidence.candidates_with_answers(draft)
    seconds = column_map.seconds_since_first(pd.DatetimeIndex(file.table.index))
    context = evidence.TableContext(draft, seconds, evidence.comparison_grid(seconds))
    channel_columns.assign_motion_columns(context)
    if unused := [key for key in answers if key not in draft.used_answers]:
        raise ConfigurationError(
            f"the answer {', '.join(unused)} is to no question of this table", fix="name a column map"
        )
    if (question := next((entry for entry in draft.questions if entry.default is None), None)) is not None:
        raise InputError(str(question), where=str(raw.path))
    file.remarks = (*file.remarks, *draft.warnings)
    for name, entry in context.channels.items():  # codes that the channel could hold; others stay, to be flagged
        channel = ships.BY_NAME[name]
        codes = [code for code in entry.get("missing", ()) if channel.low <= code <= channel.high]
        if codes and not channel.circular:
            file.table.loc[np.isin(draft.numbers_or_nan(entry["column"]), codes), name] = np.nan
    velocity = draft.tree.get("velocity")
    channels = {
        name: column_map.Column(**entry)
        for name, entry in context.channels.items()
        if entry["unit"] != ships.BY_NAME[name].unit or {"scale", "offset"} & set(entry)
    }
    if velocity:
        channels |= {"heading_deg": column_map.Column(**context.channels["heading_deg"])}
    if not channels:
        return
    columns = column_map.ColumnMap(
        time=time, channels=channels, velocity=column_map.Velocity(**velocity) if velocity else None
    )
    converted = column_map.apply_column_map(raw, columns, raw.path)
    for name in map(str, converted.table):
        file.table[name] = np.asarray(converted.table[name])
        file.sources[name] = converted.sources[name]
