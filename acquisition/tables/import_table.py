"""Imports tables as recordings: CSV, Parquet, .mat and others, with the contract's columns or by a column map.

Rows stay as they are and in their order, values that a channel cannot hold are kept and flagged bad, and everything
noteworthy is counted.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from seatrial.acquisition.config.declarations import actuators_of_ship, load_actuators, name_of_ship
from seatrial.acquisition.core.errors import ConfigurationError, InputError
from seatrial.acquisition.core.files import write_text, written_together
from seatrial.acquisition.core.ship import (
    DEFAULT,
    Actuators,
    Declared,
    actuators_of,
    as_text,
    channel_by_rule,
    channel_names,
    channels_known_to,
    channels_of_trial,
    declared_from_text,
    find_channel,
    from_text,
    in_turn,
    is_other_convention,
    is_possible,
    is_ship_known,
    required_names,
    stated_text,
)
from seatrial.acquisition.core.trial import Quality, Trial
from seatrial.acquisition.recording.writer import write_table
from seatrial.acquisition.tables.column_map import (
    ColumnMap,
    apply_column_map,
    line_in_map,
    load_column_map,
    map_of_long_table,
    parse_column_map,
)
from seatrial.acquisition.tables.evidence import SKIP, column_candidates
from seatrial.acquisition.tables.propose import (
    TIME_KEYS,
    Proposal,
    apply_map_answers,
    apply_time_answers,
    convert_by_track,
    propose,
)
from seatrial.acquisition.tables.table_files import RawTable, TableFile, parse_numbers, read_raw
from seatrial.acquisition.tables.time_columns import has_standard_times, resolve_times, standard_time_column

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
) -> ImportSummary:
    """Write a table file as a recording; arguments as those of :func:`read_table_file`.

    Without ``force`` an existing file is not replaced. Raises as :func:`read_table_file`, and
    :class:`StorageError` when the recording cannot be written.
    """
    refuse_overwriting(output, force)
    return _write_recording(read_table_file(path, map_path, allow_missing, ignore_unknown, vessel, answers), output)


def import_proposed(
    raw: RawTable,
    proposal: Proposal,
    output: Path | str,
    map_path: Path | str,
    vessel: Path | str | None = None,
    force: bool = False,
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
    columns, declared = parse_column_map(proposal.text, map_path)
    with written_together(Path(output)):
        write_text(map_path, proposal.text)
        summary = _write_recording(_through_map(raw, columns, declared, map_path, vessel), output)
    return replace(summary, remarks=())  # the proposal has them among its warnings


def propose_for(
    raw: RawTable, answers: Mapping[str, str] | None = None, vessel: Path | str | None = None
) -> Proposal:
    """As :func:`propose`, for the ship of a vessel's name or file."""
    return propose(raw, answers, _actuators_of(vessel), "" if vessel is None else name_of_ship(vessel))


def is_standard(raw: RawTable) -> bool:
    """Whether most of a table's columns, ``time`` among them, are named as the channels.

    Not if further columns are of known quantities, or the times in another form.
    """
    names = list(map(str, raw.columns.columns))
    channels = channels_of_trial(raw.trial)
    if (long := map_of_long_table(raw, channels)) is not None:
        return bool(long.channels)
    standard_names = [
        name for name in names if name == "time" or _is_export_column(name, channels) or find_channel(name)
    ]
    if raw.trial.actuators:
        return True
    recognised = {candidate.column for candidate in column_candidates(raw)} - set(standard_names)
    return "time" in names and 2 * len(standard_names) > len(names) and not recognised and has_standard_times(raw)


def refuse_overwriting(path: Path | str, force: bool, fix: str = "name another file") -> None:
    """Raise :class:`InputError` for an existing file, unless ``force``."""
    if not force and Path(path).exists():
        raise InputError("already exists", where=str(path), fix=f"{fix}, or use --force to replace it")


def _write_recording(file: TableFile, output: Path | str) -> ImportSummary:
    """Write a table as a recording."""
    flags = quality_flags(file.table, file.trial)
    samples = write_table(file.table, output, file.trial, file.sources, flags)
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
        missing=_missing(file),
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
    raw = read_raw(path)
    if map_path is not None:
        columns, declared = load_column_map(map_path)
        return _through_map(
            raw, apply_map_answers(columns, answers or {}), declared, map_path, vessel, allow_missing
        )
    ship, fix = _actuators_of(vessel), "give it a constant in a map (--columns), or use --allow-missing"
    long = map_of_long_table(raw, channel_names(ship or DEFAULT))
    if long is None:
        file, fix = _read_standard(raw, ignore_unknown, ship, answers or {}, vessel), f"add the column, {fix}"
    else:
        file = apply_column_map(raw, long, path)
        file = _assign_ship(
            file, ship or actuators_in_columns(map(str, file.table), file.trial), raw, vessel, is_known=bool(ship)
        )
    return _require_channels(file, raw, allow_missing, fix)


def _actuators_of(vessel: Path | str | None) -> Actuators:
    return () if vessel is None else load_actuators(vessel)


def _through_map(
    raw: RawTable,
    columns: ColumnMap,
    declared: Declared,
    map_path: Path | str,
    vessel: Path | str | None,
    allow_missing: bool = False,
) -> TableFile:
    """A table by its map, of the given ship, else the map's, else that of its columns."""
    ship = _actuators_of(vessel)
    file = apply_column_map(raw, columns, map_path, declared)
    stated_ship = ship or columns.actuators or actuators_of_ship(columns.trial.vessel, Path(map_path).parent)
    ship = stated_ship or actuators_in_columns([*file.table, *columns.absent], file.trial)
    _check_mapped(columns.channels, ship, file.trial, map_path)
    file = _assign_ship(file, ship, raw, vessel, is_known=bool(stated_ship))
    allow_missing = allow_missing or set(_missing(file)) <= set(columns.absent)
    fix = f"give it a column or a constant in {map_path}, or list it under `absent` there"
    return _require_channels(file, raw, allow_missing, fix)


def _require_channels(file: TableFile, raw: RawTable, allow_missing: bool, fix: str) -> TableFile:
    """The table; raises :class:`InputError` if it lacks a required channel."""
    missing = _missing(file)
    if missing and not allow_missing:
        raise InputError(f"has no {', '.join(missing)}", where=str(raw.path), fix=fix)
    if file.table.columns.empty:
        raise InputError("has no column that is a channel", where=str(raw.path), fix="give a map with --columns")
    return file


def _missing(file: TableFile) -> tuple[str, ...]:
    """The channels that a table lacks; an unknown ship has no further controls than the table."""
    trial, columns = file.trial, file.table.columns
    is_known = is_ship_known(trial.vessel, trial.actuators)
    return tuple(
        name
        for name in required_names(from_text(trial.actuators), columns, ship_is_known=is_known)
        if name not in columns
    )


def actuators_in_columns(names: Iterable[str], trial: Trial) -> Actuators:
    """The actuators of the columns of an unknown ship, without channels that the trial declares.

    The default ship's, R/V Gunnerus', if one of these is among them, so that a misspelt one is detected.
    """
    actuators = actuators_of(names, {"trial": {"channels": trial.channels}})
    default_names = {actuator.name for actuator in DEFAULT}
    return DEFAULT if any(actuator.name in default_names for actuator in actuators) else actuators


def _check_mapped(names: Iterable[str], ship: Actuators, trial: Trial, map_path: Path | str) -> None:
    channels = channel_names(ship, declared_from_text(trial.channels))
    for name in names:
        if name not in channels:
            actuator_names = ", ".join(actuator.name for actuator in ship)
            what = f"{_name_with_hint(name, channels)} is not a channel of a ship with actuators {actuator_names}"
            where = line_in_map(map_path, ["channels", name])
            raise ConfigurationError(what, where=where, fix="correct the name, or give the ship with --vessel FILE")


def _read_standard(
    raw: RawTable, ignore_unknown: bool, ship: Actuators, answers: Mapping[str, str], vessel: Path | str | None
) -> TableFile:
    """A table whose columns are named as the channels."""
    present = list(map(str, raw.columns.columns))
    if "time" not in present:
        similar = get_close_matches("time", present, n=1) or present[:6]
        where, fix = str(raw.path), "rename the column, or name it in a column map (--columns)"
        raise InputError("has no column `time`", where=where, why=f"it has {', '.join(similar)}", fix=fix)
    stated_ship = ship or (from_text(raw.trial.actuators) if raw.trial.actuators else ())
    ship = stated_ship or actuators_in_columns(present, raw.trial)
    channels = channels_of_trial(replace(raw.trial, actuators=as_text(ship)))
    unknown = tuple(
        name
        for name in present
        if name not in channels and name != "time" and not _is_export_column(name, channels)
    )
    if unknown and not ignore_unknown:
        ships = "; give the ship with --vessel FILE" if any(map(channel_by_rule, unknown)) else ""
        what = f"has unknown columns {', '.join(_name_with_hint(name, channels) for name in unknown)}"
        fix = f"rename them, map them with --columns MAP.toml, or use --ignore-unknown{ships}"
        raise InputError(what, where=str(raw.path), fix=fix)
    time_answers = {key: value for key, value in answers.items() if key in TIME_KEYS}
    column_answers = {key: value for key, value in answers.items() if key not in TIME_KEYS}
    time = apply_time_answers(standard_time_column(raw), time_answers)
    timed = resolve_times(raw, time, strict=True)
    names = [name for name in channels if name in present and answers.get(f"unit.{name}") != SKIP]
    table = pd.DataFrame({name: parse_numbers(timed.raw, name) for name in names}, index=timed.index)
    for name in names:
        values = table[name].to_numpy()
        if is_other_convention(channels[name], values):  # all else stays, to be flagged
            table[name] = in_turn(channels[name], values)
    file = TableFile(table, raw.trial, dict.fromkeys(names, "table"), unknown, remarks=timed.remarks)
    convert_by_track(file, timed.raw, time, column_answers)
    return _assign_ship(file, ship, raw, vessel, is_known=bool(stated_ship))


def _assign_ship(
    file: TableFile, ship: Actuators, raw: RawTable, vessel: Path | str | None, *, is_known: bool
) -> TableFile:
    """The table in the order of the ship's channels; its trial gets the names and the ship's actuators."""
    name = file.trial.vessel if vessel is None else name_of_ship(vessel)
    text = stated_text(ship, name) if is_known else as_text(ship)
    file.trial = replace(file.trial, name=file.trial.name or raw.name, vessel=name, actuators=text)
    file.table = file.table[[name for name in channels_of_trial(file.trial) if name in file.table]]
    return file


def _is_export_column(name: str, channels: Collection[str]) -> bool:
    """Whether a column of our exports is no channel."""
    stems = {name, *(name.removesuffix(ending) for ending in COMPANION_SUFFIXES)}
    return not stems.isdisjoint(LABELS) or (name not in channels and not stems.isdisjoint(channels))


def _name_with_hint(name: str, channels: Collection[str]) -> str:
    similar = get_close_matches(name.lower(), channels, n=1, cutoff=0.5)
    return f"{name} (did you mean {similar[0]}?)" if similar else name


def quality_flags(table: pd.DataFrame, trial: Trial | None = None) -> dict[str, NDArray[np.uint8]]:
    """Flags by channel [rows]: bad for a number that the channel cannot hold, not evaluated for all others.

    ``trial`` states the declared channels.
    """
    flags, channels = {}, channels_known_to(trial or Trial())
    for name, column in table.items():
        values = column.to_numpy(dtype=float)
        outside = np.isfinite(values) & ~is_possible(channels[str(name)], values)
        flags[str(name)] = np.where(outside, Quality.BAD, Quality.NOT_EVALUATED).astype(np.uint8)
    return flags
