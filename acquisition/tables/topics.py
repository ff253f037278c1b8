"""Logs of several topics, each with its own times, and the one table that is proposed from them.

Of each topic the columns that can be channels are joined on time. Every sample keeps its own stamp to the ns,
nothing is resampled, and cells at the times of other topics are empty. Which clock the times are of, and what was
not taken, is a remark.
"""

from __future__ import annotations

import heapq
import json
import re
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import islice
from lzma import LZMAError
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import orjson
import pandas as pd

from seatrial.acquisition.core import process, times
from seatrial.acquisition.core.errors import InputError
from seatrial.acquisition.core.quantities import Ints
from seatrial.acquisition.core.trial import NANO, SOFTWARE, Frame, iso_utc
from seatrial.acquisition.sources import Source
from seatrial.acquisition.tables import column_names, evidence, log_frames, table_files, time_columns, time_reading

if TYPE_CHECKING:
    from rich.table import Table

LOG_READERS = Path(__file__).with_name("log_readers.py")


@dataclass(frozen=True, slots=True)
class LogFormat:
    """How logs are read: by which reader of :mod:`seatrial.acquisition.tables.log_readers`, which module of
    which extra that needs, and by whose convention of frames and units."""

    name: str
    reader: str
    module: str = ""
    extra: str = ""
    convention: str = ""


ROS_BAG = LogFormat("ROS bag", "bags", "rosbags", "ros", "ros")
DATAFLASH = LogFormat("DataFlash", "dataflash", convention="autopilot")
_FORMATS: dict[str, LogFormat] = {
    ".bag": ROS_BAG,
    ".db3": ROS_BAG,
    ".mcap": replace(ROS_BAG, name="MCAP", module="", extra=""),  # not all of them are of ROS
    ".ulg": LogFormat("ULog", "ulog", "pyulog", "ulog", "autopilot"),
    ".bin": DATAFLASH,
    **dict.fromkeys((".mf4", ".mdf"), LogFormat("ASAM MDF", "mdf", "asammdf", "mf4")),
    ".tdms": LogFormat("TDMS", "tdms", "nptdms", "tdms"),
    **dict.fromkeys((".h5", ".hdf5", ".hdf", ".he5"), LogFormat("HDF5", "hdf5", "h5py", "hdf5")),
    ".npz": LogFormat("NumPy archive", "npz"),
    **dict.fromkeys((".jsonl", ".ndjson", ".json"), LogFormat("JSON lines", "json_lines")),
    **dict.fromkeys((".sqlite", ".sqlite3", ".db"), LogFormat("SQLite", "sqlite")),
}
"""The formats of logs by suffix."""
LOG_SUFFIXES = (*_FORMATS,)
_EXPORTED_FIELDS = {
    "/fix.latitude": ("latitude_deg", 1.0),
    "/fix.longitude": ("longitude_deg", 1.0),
    **{f"/imu.orientation.{name}": (f"{name}_deg", 1.0) for name in ("heading", "roll", "pitch")},
    "/imu/rate.angular_velocity.yaw_rate": ("yaw_rate_dps", 180.0 / np.pi),
    **{f"/velocity.twist.linear.{name}": (f"{name}_mps", 1.0) for name in ("surge", "sway")},
}
"""The fields of bags of this product that are channels under other names, and what turns them into their units."""
_PARQUET = LogFormat("Parquet files", "")
_MDF_HEAD, _MCAP_HEAD, _HEADER_BYTES = b"MDF     ", b"\x89MCAP", 200
_DATAFLASH_HEAD = re.compile(rb"\xa3\x95\x80\x80|(?:.*\n)?FMT, *\d+, *\d+, *\w+, *\w+")
_PLAUSIBLE_NS = pd.Timestamp("1990-01-01").value  # clocks that are not set are before
_MIN_STATED = 0.9  # of the messages of a topic have a stamp
_MIN_DISTINCT = 0.1  # of them differ
_MOST_AT_ONCE = 300  # messages of a log as a source
_FAR_NS = 60 * NANO  # between two times of an autopilot's topic
_LONGEST_LAG_S = 1.0  # of a message on its way into the log
_MOST_RIVALS = 3  # columns of one quantity and place that are joined, the best first
_SPEED = {"speed", "velocity", "spd", "vel"}
_MOST_NAMED = 8
_GPS_EPOCH_NS, _WEEK_NS = pd.Timestamp("1980-01-06").value, 7 * times.DAY_NS
_NO_CHANNELS = frozenset(["time", "date", "gps_week", "time_of_week", "variable", "value", "unit"])
_SIDES = column_names.PORT | column_names.STARBOARD
_PLACES = _SIDES | column_names.BOW | column_names.STERN | column_names.ORDER
_VALUE_NAMES = frozenset(["data", "value", "val", "values", ""])
_EMPTY_WORDS = re.compile(r"\b(?:joint|link|sensor|sensors|state|msg)\b")
_PUSHES_SIDEWAYS = frozenset(["thr", "thruster", "propulseur"])  # beside port or starboard it drives the ship


@dataclass(frozen=True, slots=True, eq=False)
class LogTopic:
    """A topic of a log: its fields [n], the times of its samples [n, ns UTC], and which clock these are of.

    ``count`` is the number of its messages; ``remarks`` are on its frames and times, ``questions`` those that its
    times leave open, and ``answered`` the keys of those that an answer has settled.
    """

    name: str
    kind: str
    count: int
    time_ns: Ints
    clock: str
    fields: log_frames.Fields = field(default_factory=dict)
    remarks: tuple[str, ...] = ()
    questions: tuple[evidence.Question, ...] = ()
    answered: frozenset[str] = frozenset()

    def column(self, path: str) -> str:
        """The name of a field's column in the joined table."""
        return f"{self.name}.{path}" if self.name and path else self.name or path

    @property
    def span_s(self) -> float:
        """Seconds from the first to the last sample."""
        return float(np.ptp(self.time_ns)) / NANO if self.time_ns.size else 0.0

    def as_dict(self) -> dict[str, Any]:
        """The topic in JSON."""
        ends = (
            [iso_utc(int(ns)) for ns in (self.time_ns.min(), self.time_ns.max())]
            if self.time_ns.size
            else [None] * 2
        )
        return {
            "type": self.kind,
            "count": self.count,
            "rate_hz": round((self.time_ns.size - 1) / self.span_s, 3) if self.span_s > 0.0 else 0.0,
            "first": ends[0],
            "last": ends[1],
            "clock": self.clock,
            "fields": {path: entry.unit for path, entry in self.fields.items()},
            "remarks": list(self.remarks),
        }


@dataclass(frozen=True)
class TopicLog:
    """What is in a log: its topics, those that are left out with type, count and reason, and remarks.

    A terminal shows the topics with types, counts, rates, spans and fields.
    """

    path: Path
    format: LogFormat
    topics: tuple[LogTopic, ...]
    left_out: Mapping[str, tuple[str, int, str]]
    remarks: tuple[str, ...]
    exported: Mapping[str, Any] = field(default_factory=dict)
    """What an export of this product states of itself: ``trial``, ``columns`` and more; empty for any other log."""

    def as_dict(self) -> dict[str, Any]:
        """The entries of ``seatrial info --json``."""
        spans = [topic.time_ns for topic in self.topics if topic.time_ns.size]
        start, end = (min(map(np.min, spans)), max(map(np.max, spans))) if spans else (0, 0)
        remarks = [f"{topic.name}: {text}" for topic in self.topics for text in topic.remarks]
        questions = {
            entry.key: str(entry) for topic in self.topics for entry in topic.questions if not entry.default
        }
        return {
            "format": self.format.name,
            "messages": sum(topic.count for topic in self.topics),
            "start": iso_utc(int(start)) if spans else None,
            "end": iso_utc(int(end)) if spans else None,
            "duration_s": float(end - start) / NANO,
            "topics": {topic.name: topic.as_dict() for topic in self.topics},
            "left_out": {
                name: {"type": kind, "count": count, "reason": reason}
                for name, (kind, count, reason) in self.left_out.items()
            },
            "remarks": [*self.remarks, *remarks, *(f"the import asks: {text}" for text in questions.values())],
        }

    def __rich__(self) -> Table:
        from rich.table import Table

        table = Table(box=None, header_style="dim", padding=(0, 1, 0, 0))
        for title, justify in (("topic", "left"), ("type", "left"), ("count", "right"), ("rate Hz", "right"),
                               ("clock", "left"), ("fields", "left")):  # fmt: skip
            table.add_column(title, justify=justify, overflow="fold")  # type: ignore[arg-type]
        for topic in self.topics:
            about = topic.as_dict()
            names = [f"{name} [{unit}]" if unit else name for name, unit in about["fields"].items()]
            shown = ", ".join(names[:_MOST_NAMED]) + (
                f" and {len(names) - _MOST_NAMED} more" * (len(names) > _MOST_NAMED)
            )
            table.add_row(
                topic.name or "-", topic.kind, f"{topic.count:,}", f"{about['rate_hz']:.2f}", topic.clock, shown
            )
        for name, (kind, count, reason) in self.left_out.items():
            table.add_row(name, kind, f"{count:,}", "", "", f"not taken: {reason}", style="dim")
        return table

    @cached_property
    def candidates(self) -> list[evidence.ColumnCandidate]:
        """The columns that may be channels, of each quantity and place the best few.

        One that never changes is none of them where another does: nobody measured it.
        """
        columns = {topic.column(path): entry for topic in self.topics for path, entry in topic.fields.items()
                   if entry.meaning is not None and entry.samples.dtype.kind in "biuf"}  # fmt: skip
        heads = pd.DataFrame(columns=[*columns])
        raw = table_files.RawTable(
            self.path, heads, units=_unit_by_column(columns), meanings=_meaning_by_column(columns)
        )

        def rank(candidate: evidence.ColumnCandidate) -> tuple[float, int]:
            return -candidate.cover, -int(np.count_nonzero(~np.isnan(columns[candidate.column].samples)))

        def kind(candidate: evidence.ColumnCandidate) -> tuple[str, frozenset[str]]:
            place = frozenset(word for word in candidate.words if word in _PLACES or word.isdigit())
            return candidate.quantity.name, place

        ranked = sorted(evidence.column_candidates(raw), key=rank)
        changing = {kind(candidate) for candidate in ranked if columns[candidate.column].changes}
        counts, best = Counter[tuple[str, frozenset[str]]](), list[evidence.ColumnCandidate]()
        for candidate in ranked:
            if kind(candidate) in changing and not columns[candidate.column].changes:
                continue
            counts[kind(candidate)] += 1
            if candidate.quantity.name not in _NO_CHANNELS and counts[kind(candidate)] <= _MOST_RIVALS:
                best.append(candidate)
        return best


def _unit_by_column(columns: Mapping[str, log_frames.LogField]) -> dict[str, str]:
    return {name: entry.unit for name, entry in columns.items() if entry.unit}


def _meaning_by_column(columns: Mapping[str, log_frames.LogField]) -> dict[str, str]:
    return {name: entry.meaning for name, entry in columns.items() if entry.meaning}


def log_format(path: Path) -> LogFormat | None:
    """The format of a log of several topics, by its name and first bytes; None for a plain table.

    ArduPilot's ``.log`` is told from logs of sentences by its formats of messages.
    """
    if path.is_dir():
        is_bag = any(any(path.glob(name)) for name in ("metadata.yaml", "*/metadata.yaml", "*.db3", "*.bag"))
        if is_bag or "other" in map(_mcap_writer, path.glob("*.mcap")):
            return ROS_BAG
        return _PARQUET if any(path.rglob("*.parquet")) else None
    suffix, compression = (part.lower() for part in table_files.kind_and_compression_suffix(path))
    if suffix in (".dat", ".log") and path.is_file():
        with suppress(OSError, EOFError, LZMAError), table_files.OPENERS[compression](path) as stream:
            head = stream.read(_HEADER_BYTES)
            if suffix == ".log":
                return DATAFLASH if _DATAFLASH_HEAD.match(head) else None
            return _FORMATS[".mf4"] if head.startswith(_MDF_HEAD) else None
    return _FORMATS.get(suffix)


def _mcap_writer(path: Path) -> str:
    """Whether the header of an MCAP file names "seatrial" or an "other" writer; empty for no MCAP file."""
    with path.open("rb") as stream:
        head = stream.read(_HEADER_BYTES)
    return "" if not head.startswith(_MCAP_HEAD) else SOFTWARE if SOFTWARE.encode() in head else "other"


def read_log(path: Path, kind: LogFormat, answers: Mapping[str, str] | None = None) -> TopicLog:
    """The topics of a log in the product's frames, their times by the ``answers``, of :data:`TIME_ANSWERS`.

    Raises :class:`InputError` for what cannot be read.
    """
    if kind is _PARQUET:
        content = _parquet_content(path)
    else:
        if kind.module:
            table_files.require_package(kind.module, kind.extra, path)
        if process.bytes_of_files(path) == 0:
            raise InputError("is empty", where=str(path), fix="give a log with data")
        content = process.read_in_child(LOG_READERS, kind.reader, path, "log")
    count = sum(len(entry["fields"]) for entry in content["topics"])
    process.LOG_FIELDS.require_within_budget(count, path, process.bytes_of_files(path))
    remarks, topics = list(content["remarks"]), list[LogTopic]()
    offset_ns, offset_remark = _boot_offset_ns(content["topics"])
    lag_ns = _lag_ns(content["topics"])
    if any("boot" in entry["times"] for entry in content["topics"]):
        remarks.append(offset_remark)
    left_out, kinds = dict(content["left_out"]), {entry["kind"] for entry in content["topics"]}
    outputs = log_frames.servo_outputs(
        content.get("parameters", {}), has_shaft_speed=bool(kinds & log_frames.SHAFT_SPEEDS)
    )
    for entry in content["topics"]:
        try:
            topic = _topic_of(path, entry, kind, offset_ns, lag_ns, outputs, answers or {})
        except InputError as error:
            left_out[entry["name"]] = entry["kind"], entry["count"], f"{error.what}"
            continue
        alike = sum(earlier.name.partition(" (")[0] == topic.name for earlier in topics)
        topics.append(replace(topic, name=f"{topic.name} ({alike + 1})") if alike else topic)
    if not topics:
        why = "; ".join(f"{name}: {reason}" for name, (_, _, reason) in [*left_out.items()][:_MOST_NAMED])
        fix = "`seatrial info` shows its topics" if left_out else "give a log with messages"
        raise InputError("holds no topic with times and numbers", where=str(path), why=why, fix=fix)
    exported = _parse_export(content.get("about", ""))
    return TopicLog(path, kind, tuple(topics), left_out, tuple(filter(None, remarks)), exported)


def _parse_export(text: str) -> dict[str, Any]:
    """What an export of this product states of itself; empty for what any other text is."""
    try:
        stated = json.loads(text) if text.startswith("{") else {}
    except ValueError:
        return {}
    is_ours = isinstance(stated.get("columns"), list) and isinstance(stated.get("trial"), dict)
    return stated if is_ours else {}


class TopicFile(Source):
    """A log of several topics as a source: a message of numbers for each row of a topic, in order of time.

    ``remark`` is what should be known of its times and frames.
    """

    remark = ""
    _messages: Iterator[tuple[int, bytes]] = iter(())

    def _connect(self) -> TopicFile:
        path: Path = self._config.path
        kind = log_format(path) if path.exists() else None
        if kind is None:
            raise self.failure(f"file {path} is no log of several topics", fix='correct `path`, or `type = "file"`')
        try:
            log = read_log(path, kind)
        except InputError as error:
            raise self.failure(f"file {path} {error.what}", error.why, error.fix) from error
        fields = {(_message_topic(topic), name) for topic in log.topics for name in topic.fields}
        wanted: list[tuple[str, str]] = self._config.wanted_fields
        if missing := [f"{topic} {name}" for topic, name in wanted if (topic, name) not in fields]:
            fix = f"`seatrial info {path}` shows topics and fields"
            raise self.failure(f"file {path} has no {', '.join(missing)}", fix=fix)
        taken = {topic for topic, _ in wanted}
        topics = [topic for topic in log.topics if _message_topic(topic) in taken]
        chosen = [topic.column(name) for topic in topics for name in topic.fields]
        if question := next((entry for topic in topics for entry in topic.questions if not entry.default), None):
            raise self.failure(f"file {path}: {question.text}", fix="`seatrial import` takes the answer")
        self.remark = "; ".join(_table_remarks(replace(log, topics=tuple(topics)), chosen))
        self._messages = heapq.merge(*map(_messages_of_topic, topics))
        return self

    def _receive(self, timeout_s: float) -> list[Frame] | None:
        return [
            Frame(self.name, "mqtt", payload, time_ns, time_ns, stamped_ns=time_ns)
            for time_ns, payload in islice(self._messages, _MOST_AT_ONCE)
        ] or None

    def close(self) -> None:
        self._messages = iter(())
        self._link = None


def _message_topic(topic: LogTopic) -> str:
    return topic.name or "-"


def _messages_of_topic(topic: LogTopic) -> Iterator[tuple[int, bytes]]:
    """The times and messages of a topic, in order of time: a JSON object each, of the fields that have a number."""
    columns = {name: entry.samples.astype(float).tolist() for name, entry in topic.fields.items()}
    head = _message_topic(topic).encode() + b"\0"
    for row in np.argsort(topic.time_ns, kind="stable").tolist():
        body = {name: values[row] for name, values in columns.items() if isfinite(values[row])}
        if body:
            yield int(topic.time_ns[row]), head + orjson.dumps(body)


def read_table_or_log(
    path: Path | str, columns: Collection[str] = (), answers: Mapping[str, str] | None = None
) -> table_files.RawTable:
    """The table in a file, or that of a log of several topics with the ``columns`` of a map.

    The times of a log are read by those of the ``answers`` that concern them, those of a table with its map. Raises
    :class:`InputError` for anything that is neither.
    """
    path = Path(path)
    kind = log_format(path) if path.exists() else None
    return table_files.read_raw_table(path) if kind is None else read_log_table(path, kind, columns, answers)


TIME_ANSWERS = ("zone", "date_order", "year", "day", "time_unit", "since")
"""The answers that settle the times of a log's topics, before these become one table; a start is the table's."""


def read_log_table(
    path: Path, kind: LogFormat, columns: Collection[str] = (), answers: Mapping[str, str] | None = None
) -> table_files.RawTable:
    """The table of a log: the columns that can be channels, or those that a map names.

    Raises :class:`InputError` as :func:`read_log`, for a recording of this product, and beyond the budget of cells.
    """
    is_ours = path.is_file() and _mcap_writer(path) == SOFTWARE
    answers = {key: value for key, value in (answers or {}).items() if key in TIME_ANSWERS}
    log = None if is_ours else read_log(path, kind, answers)
    if log is None or (kind.name == "MCAP" and any(topic.name.startswith("/channel/") for topic in log.topics)):
        fix = "use it as it is, or `seatrial export` it"
        raise InputError("is a recording already", where=str(path), fix=fix)
    if log.exported and not columns:
        return _exported_table(log)
    chosen = dict.fromkeys(columns) if columns else {candidate.column: None for candidate in log.candidates}
    remarks = _table_remarks(log, chosen)
    parts = [(topic, {path: entry for path, entry in topic.fields.items() if topic.column(path) in chosen})
             for topic in log.topics]  # fmt: skip
    parts = [(topic, fields) for topic, fields in parts if fields]
    if not parts:
        examples = ", ".join(topic.column(name) for topic in log.topics for name in [*topic.fields][:3])
        raise InputError(
            "has no column that is a channel", where=str(path), why=f"it has {examples[:200]}",
            fix="give a map with --columns",
        )  # fmt: skip
    frame = _join_topics(path, parts)
    fields = {topic.column(name): entry for topic, fields in parts for name, entry in fields.items()}
    questions = {question.key: question for topic, _ in parts for question in reversed(topic.questions)}
    answered = {key: answers[key] for topic, _ in parts for key in topic.answered}
    return table_files.RawTable(
        path, frame, units=_unit_by_column(fields), meanings=_meaning_by_column(fields), remarks=tuple(remarks),
        questions=(*questions.values(),), time_answers=answered,
    )  # fmt: skip


def _exported_table(log: TopicLog) -> table_files.RawTable:
    """The table of an export of this product, under the names and in the units that it had."""
    names, parts = set(map(str, log.exported["columns"])), list[tuple[LogTopic, log_frames.Fields]]()
    for topic in log.topics:
        fields = log_frames.Fields()
        for path, entry in topic.fields.items():
            is_number = log.format.convention == "ros" and path == "data"
            plain = topic.name.removeprefix("/") if is_number else path
            name, factor = _EXPORTED_FIELDS.get(topic.column(path), (plain, 1.0))
            if name in names:
                fields[name] = log_frames.LogField(factor * entry.samples)
        if fields:
            parts.append((replace(topic, name="", fields=fields), fields))
    if not parts:
        raise InputError("has no column that its own description names", where=str(log.path), fix="export it again")
    frame = _join_topics(log.path, parts)
    return table_files.RawTable(
        log.path, frame, table_files.parse_trial(log.exported["trial"]), remarks=log.remarks
    )


def _join_topics(path: Path, parts: list[tuple[LogTopic, log_frames.Fields]]) -> pd.DataFrame:
    """The columns of topics on all their times; a single topic stays in the order of its file."""
    stamps = [topic.time_ns for topic, _ in parts]
    rows, count = rows_by_time(stamps) if len(parts) > 1 else ([np.arange(stamps[0].size)], stamps[0].size)
    width = 1 + sum(len(fields) for _, fields in parts)
    process.TABLE_CELLS.require_within_budget(count * width, path, process.bytes_of_files(path))
    time_ns, columns = np.empty(count, dtype=np.int64), dict[str, Any]()
    for (topic, fields), places in zip(parts, rows, strict=True):
        time_ns[places] = topic.time_ns
        for name, entry in fields.items():
            column = columns[topic.column(name)] = np.full(count, np.nan)
            column[places] = entry.samples
    return pd.DataFrame({"time": pd.DatetimeIndex(time_ns.view("datetime64[ns]"), tz="UTC"), **columns})


def rows_by_time(stamps: list[Ints]) -> tuple[list[Ints], int]:
    """The row of each topic's samples in a table in order of time, and its length.

    Topics share the row of a time; samples of one topic with the same time have rows of their own.
    """
    distinct = np.unique(np.concatenate(stamps))
    repeats, numbers = np.ones(distinct.size, dtype=np.int64), list[Ints]()
    for stamp in stamps:
        order = np.argsort(stamp, kind="stable")
        unique, first, counts = np.unique(stamp[order], return_index=True, return_counts=True)
        at = np.searchsorted(distinct, unique)
        repeats[at] = np.maximum(repeats[at], counts)
        number = np.empty(stamp.size, dtype=np.int64)
        number[order] = np.arange(stamp.size) - np.repeat(first, counts)
        numbers.append(number)
    starts = np.cumsum(repeats) - repeats
    rows = [
        starts[np.searchsorted(distinct, stamp)] + number for stamp, number in zip(stamps, numbers, strict=True)
    ]
    return rows, int(repeats.sum())


def _table_remarks(log: TopicLog, chosen: Collection[str]) -> list[str]:
    """Which clock the times are of, how frames were read, and what was not taken."""
    remarks, taken = list(log.remarks), list[LogTopic]()
    for topic in log.topics:
        if any(topic.column(path) in chosen for path in topic.fields):
            taken.append(topic)
    clocks: dict[str, list[str]] = {}
    for topic in taken:
        clocks.setdefault(topic.clock, []).append(topic.name or log.path.name)
        backwards = int(np.count_nonzero(np.diff(topic.time_ns) < 0))
        if backwards and len(taken) > 1:
            remarks.append(
                f"{backwards:,} times of {topic.name} go backwards; its samples are put in order of time"
            )
    remarks += [f"times of {_listed(names)}: {clock}" for clock, names in clocks.items()]
    frames: dict[str, list[str]] = {}
    for topic in taken:
        for text in topic.remarks:
            frames.setdefault(text, []).append(topic.name or log.path.name)
    remarks += [f"{_listed(names)}: {text}" for text, names in frames.items()]
    unused = [topic.name for topic in log.topics if topic not in taken] + [
        f"{name} ({reason})" for name, (_, _, reason) in log.left_out.items()
    ]
    if unused:
        remarks.append(f"not taken, as no channels: {_listed(unused)}")
    unused_columns = [
        topic.column(path) for topic in taken for path, entry in topic.fields.items()
        if topic.column(path) not in chosen and entry.samples.dtype.kind in "iuf" and "[" not in path
    ]  # fmt: skip
    if unused_columns:
        remarks.append(f"not taken of these: {_listed(unused_columns)}")
    return remarks


def _listed(names: list[str]) -> str:
    return ", ".join(names[:_MOST_NAMED]) + (
        f" and {len(names) - _MOST_NAMED} more" if len(names) > _MOST_NAMED else ""
    )


def _topic_of(
    path: Path,
    entry: Mapping[str, Any],
    kind: LogFormat,
    offset_ns: int,
    lag_ns: int,
    outputs: log_frames.ServoOutputs,
    answers: Mapping[str, str],
) -> LogTopic:
    """A topic as a reader found it, with its clock settled and its fields in the product's frames."""
    name = entry["name"]
    fields = {
        key: _unit_of_meaning(name, key, log_frames.LogField(*parts)) for key, parts in entry["fields"].items()
    }
    stated, draft = entry["times"], evidence.MappingDraft(table_files.RawTable(path, pd.DataFrame()), answers)
    if "boot" in stated:
        clock = "the autopilot's clock, set by GPS" if offset_ns else "counted from the start of the log"
        time_ns, fields, remarks = _without_broken_stamps(stated["boot"], fields)
        time_ns = time_ns + offset_ns
    elif "local" in stated:
        clock = "as the file states them"
        time_ns, remarks = _times_of_local_clock(stated["local"], draft)
    elif stated:
        time_ns, clock, remarks = _settle_clock(stated, lag_ns)
    else:
        time_ns, clock, fields, remarks, draft = _times_in_fields(path, name, fields, answers)
    fields = {key: value for key, value in fields.items() if value.samples.dtype.kind in "biuf"}
    if not fields:
        raise InputError("has no numbers")
    if kind.convention == "ros":
        result = log_frames.interpret_ros(name, entry["kind"], fields, entry["frames"])
        fields, remarks = result.fields, [*result.remarks, *remarks]
    elif kind.convention == "autopilot":
        autopilot = log_frames.interpret_autopilot(name, entry["kind"], fields, outputs)
        fields, remarks = autopilot.fields, [*autopilot.remarks, *remarks]
    named = {
        key: value if value.meaning != "" else plain_meaning(name, key, value, is_only=len(fields) == 1)
        for key, value in fields.items()
    }
    questions = tuple(replace(question, text=f"{name}: {question.text}") for question in draft.questions)
    return LogTopic(name, entry["kind"], entry["count"], time_ns, clock, named, tuple(remarks), questions,
                    frozenset(draft.used_answers))  # fmt: skip


def _without_broken_stamps(boot_ns: Ints, fields: log_frames.Fields) -> tuple[Ints, log_frames.Fields, list[str]]:
    """The times of an autopilot [n] and its fields without rows whose time is far from both its neighbours', which
    agree: a broken byte; and a remark."""
    steps = np.diff(boot_ns, prepend=boot_ns[:1], append=boot_ns[-1:])
    across = np.zeros(boot_ns.size, dtype=np.int64)
    across[1:-1] = boot_ns[2:] - boot_ns[:-2]
    across[:1], across[-1:] = np.diff(boot_ns[1:3]).sum(), np.diff(boot_ns[-3:-1]).sum()
    far = np.abs(steps) > _FAR_NS
    is_end = np.isin(np.arange(boot_ns.size), (0, boot_ns.size - 1))
    broken = np.where(is_end, far[:-1] | far[1:], far[:-1] & far[1:]) & (np.abs(across) <= _FAR_NS)
    if not broken.any():
        return boot_ns, fields, []
    kept = {
        name: log_frames.LogField(entry.samples[~broken], entry.unit, entry.meaning)
        for name, entry in fields.items()
    }
    return boot_ns[~broken], kept, [f"{np.count_nonzero(broken):,} rows have a broken time: left out"]


def _times_of_local_clock(local_ns: Ints, draft: evidence.MappingDraft) -> tuple[Ints, list[str]]:
    """The times of a file whose start names no zone, UTC unless it is answered; and remarks."""
    zone = draft.ask(
        "zone", "the file's start names no zone; which is it (UTC, +02:00, Europe/Oslo ...)?", (), "UTC"
    )
    time_ns, remark = time_columns.local_times_to_utc(local_ns, zone or "UTC")
    is_assumed = "zone" not in draft.used_answers
    assumed = "the file's start names no zone: UTC is assumed; --answer zone=Europe/Oslo names another"
    return time_ns, [*filter(None, (assumed if is_assumed else "", remark))]


def _settle_clock(stated: Mapping[str, Ints], lag_ns: int) -> tuple[Ints, str, list[str]]:
    """The times of messages by their own stamps, else by the log's; why not by the stamps is a remark."""
    stamp, log, clock = stated.get("stamp"), stated.get("log"), "header stamp"
    published = stated.get("published")
    if stamp is None and published is not None and log is not None and np.any(published != log):
        stamp, clock = published, "publish time"
    if stamp is None and log is not None:
        if abs(lag_ns) > _LONGEST_LAG_S * NANO:
            moved = f"log time less the {lag_ns / NANO:.3f} s by which it is ahead of the other topics' stamps"
            return log - lag_ns, moved, []
        return log, "log time", []
    assert stamp is not None
    if log is None:
        return stamp, "as the file states them", []
    reason = ""
    if np.mean(stamp > 0) < _MIN_STATED:
        reason = f"{int(np.count_nonzero(stamp <= 0)):,} of {stamp.size:,} messages have no stamp"
    elif np.unique(stamp).size < _MIN_DISTINCT * stamp.size:
        reason = "the stamps stand still"
    elif np.median(stamp) < _PLAUSIBLE_NS <= np.median(log):
        reason = f"the stamps are of a clock that was not set ({iso_utc(_median_ns(stamp))[:10]})"
    if reason:
        return log, "log time", [f"{reason}: the log's times are taken"]
    if np.any(stamp <= 0):
        stamp = np.where(stamp > 0, stamp, log - _median_ns((log - stamp)[stamp > 0]))
    lag_s = float(np.median(log - stamp)) / NANO
    late = [f"its stamps are {lag_s:.3f} s behind the log's times"] if abs(lag_s) > _LONGEST_LAG_S else []
    return stamp, clock, late


def _lag_ns(topics: list[Mapping[str, Any]]) -> int:
    """How far the log's clock is ahead of the stamps, in the median of the topics that have both."""
    lags = [
        _median_ns(stated["log"] - stated["stamp"])
        for stated in (entry["times"] for entry in topics)
        if {"log", "stamp"} <= set(stated) and _settle_clock(stated, 0)[1] == "header stamp"
    ]
    return _median_ns(np.array(lags)) if lags else 0


def _median_ns(values: Ints) -> int:
    """The upper median of whole numbers, which a float would round to 256 ns."""
    return int(np.partition(values, values.size // 2)[values.size // 2])


def _boot_offset_ns(topics: list[Mapping[str, Any]]) -> tuple[int, str]:
    """What makes times since an autopilot's start UTC, by the GPS time in its log; 0 without, and a remark."""
    offsets: list[Ints] = []
    for entry in topics:
        fields, boot = entry["fields"], entry["times"].get("boot")
        if boot is None:
            continue
        if "time_utc_usec" in fields:
            utc_ns = fields["time_utc_usec"][0].astype(np.int64) * 1000
            offsets.append((utc_ns - boot)[utc_ns > _PLAUSIBLE_NS])
        elif {"GWk", "GMS"} <= set(fields):
            week, ms = (np.asarray(fields[key][0], dtype=float) for key in ("GWk", "GMS"))
            gps_ns = _GPS_EPOCH_NS + week.astype(np.int64) * _WEEK_NS + ms.astype(np.int64) * 1_000_000
            ahead_ns = np.array([times.gps_minus_utc_s(int(ns)) * NANO for ns in gps_ns], dtype=np.int64)
            offsets.append((gps_ns - ahead_ns - boot)[week > 1024])
    values = np.concatenate(offsets) if offsets else np.empty(0, dtype=np.int64)
    if not values.size:
        return 0, (
            "nothing in the log tells UTC: times count from its start, taken for 1970;"
            " --answer start=2026-05-17T12:00:00Z is the first row's time"
        )
    offset_ns = _median_ns(values)
    spread_s = float(np.median(np.abs(values - offset_ns))) / NANO
    return (
        offset_ns,
        f"times are UTC by the GPS time in the log, which varies by {spread_s:.3f} s about the autopilot's",
    )


def _times_in_fields(
    path: Path, name: str, fields: log_frames.Fields, answers: Mapping[str, str]
) -> tuple[Ints, str, log_frames.Fields, list[str], evidence.MappingDraft]:
    """The times of a topic that are one of its fields, found as in a table; its other fields, and the draft
    with the questions that the times leave open.

    A unit such as ``seconds since 2026-05-17`` states what its numbers count from.
    """
    remarks = list[str]()
    for key, entry in fields.items():
        try:
            since = table_files.times_since(entry.samples, entry.unit, path)
        except InputError as error:  # hours since an overhaul are no times
            remarks.append(f"of {key!r}, {error.what}")
            continue
        if since is not None:
            is_tai = times.names_tai(f"{key} {entry.unit} {entry.meaning}")
            stamps, zone = (since.tz_localize(None), "TAI") if is_tai else (since, "")
            fields = {**fields, key: log_frames.LogField(stamps.to_numpy(), zone, entry.meaning)}
            remarks += filter(None, [table_files.gps_remark(key, entry.unit)])
    frame = pd.DataFrame({key: pd.Series(entry.samples) for key, entry in fields.items()})
    raw = table_files.RawTable(path, frame.infer_objects(), units=_unit_by_column(fields))
    draft = evidence.MappingDraft(raw, answers)
    draft.candidates = evidence.column_candidates(raw)
    time_reading.find_time_columns(draft)
    entry = draft.tree["time"]
    time = time_columns.TimeColumn(**entry)
    timed = time_columns.resolve_times(raw, replace(time, zone=time.zone or "UTC"))
    has_time = ~np.asarray(timed.index.isna())
    if not has_time.any():
        raise InputError(f"no time of {time.column!r} can be read")
    used = {entry["column"], entry.get("date")}
    turned = timed.raw.columns
    remaining = {key: log_frames.LogField(turned[key].to_numpy()[has_time], value.unit, value.meaning)
                 for key, value in fields.items() if key not in used}  # fmt: skip
    remarks += [*draft.warnings, *timed.remarks]
    if not has_time.all():
        remarks.append(f"{int(np.count_nonzero(~has_time)):,} rows have no time that can be read; they are dropped")
    return timed.index.asi8[has_time], f"its column {time.column!r}", remaining, remarks, draft


def _unit_of_meaning(topic: str, path: str, entry: log_frames.LogField) -> log_frames.LogField:
    """A field with the unit that its description states, such as "Speed over ground [kn]" or "deg/min".

    The words of topic and path that tell actuators apart stay with it.
    """
    if not entry.meaning:
        return entry
    if units := column_names.parse_units(entry.meaning):
        return log_frames.LogField(entry.samples, entry.unit or units[0])
    head = column_names.split_header(entry.meaning)
    words = set(column_names.split_into_words(head.name))
    place = _place_words(set(column_names.split_into_words(f"{topic} {path}"))) - words
    unit = entry.unit or (head.text if head.units else "")
    return log_frames.LogField(entry.samples, unit, " ".join([*sorted(place), head.name]))


def plain_meaning(
    topic: str, path: str, entry: log_frames.LogField, *, is_only: bool = False
) -> log_frames.LogField:
    """A field with its meaning by the last names of its path and topic that are those of a quantity.

    The topic alone names a field that has no name of its own, or that ``is_only`` one: a counter beside the heading
    of a topic "gyro" is none. Words of sides, orders and numbers elsewhere in the names are kept: they tell
    actuators from each other.

    >>> plain_meaning("/thruster_port/state", "shaft.rpm", log_frames.LogField(np.zeros(1))).meaning
    'port rpm'
    >>> plain_meaning("/cmd/rudder", "data", log_frames.LogField(np.zeros(1))).meaning
    'cmd rudder'
    """
    parts = [part for part in re.split(r"[./]", re.sub(r"\[(\d+)\]", r" \1", path)) if part not in _VALUE_NAMES]
    tail = [part for part in topic.split("/") if part]
    options = [
        " ".join(parts[-1:]),
        " ".join(parts),
        *(" ".join([*tail[-size:], *parts]) for size in (1, 2)),
        " ".join(tail[-1:] if is_only or not parts else []),
    ]
    words = set(column_names.split_into_words(f"{topic} {path}"))
    if "wind" in words - {*column_names.split_into_words(options[0])} and _SPEED & {*options[0].lower().split("_")}:
        options.insert(0, f"wind {options[0]}")
    heads = [(option, head) for option in dict.fromkeys(filter(None, options))
             for head in column_names.readings_of_header(option)]  # fmt: skip
    for option, head in heads:
        unit = entry.unit or (head.text if head.units else "")
        shaft = f"{head.name} speed" if "rps" in head.units else ""
        for name in dict.fromkeys((option, head.name, shaft)):
            plain = " ".join(_EMPTY_WORDS.sub(" ", " ".join(column_names.split_into_words(name))).split())
            matches = column_names.match_quantities(plain) if plain else ()
            if any(not head.units or evidence.accepts_unit(match.quantity, stated)
                   for match in matches for stated in head.units or ("",)):  # fmt: skip
                place = _place_words(words) - set(plain.split())
                return log_frames.LogField(entry.samples, unit, " ".join([*sorted(place), plain]))
    return entry


def _place_words(words: set[str]) -> set[str]:
    """The words that tell one actuator from another, and an order from what was measured."""
    sides = words & _SIDES - {"s", "p", "l", "r"}
    positions = words & (_PLACES - _SIDES | column_names.TUNNEL)
    return (
        sides | (positions - _PUSHES_SIDEWAYS if sides else positions) | {word for word in words if word.isdigit()}
    )


def _parquet_content(path: Path) -> dict[str, Any]:
    """A folder of Parquet files: parts of one table if their columns are the same, else a topic each.

    Folders of a partition such as ``day=2026-05-17`` are parts of the folder that they are in.
    """
    parts: dict[str, list[table_files.RawTable]] = {}
    for file in sorted(path.rglob("*.parquet")):
        folders = [name for name in file.relative_to(path).parts[:-1] if "=" not in name]
        is_part = len(folders) < len(file.relative_to(path).parts) - 1
        parts.setdefault("/".join(folders if is_part else [*folders, file.stem]), []).append(
            table_files.read_raw_table(file)
        )
    heads = {tuple(raw.names) for tables in parts.values() for raw in tables}
    if len(heads) == 1:
        parts = {"": [raw for tables in parts.values() for raw in tables]}
    topics = []
    for name, tables in parts.items():
        frame = pd.concat([raw.columns for raw in tables], ignore_index=True)
        fields = {column: (values.array if values.dtype.kind == "M" else values.to_numpy(),
                           tables[0].units.get(str(column), ""), "")
                  for column, values in frame.items()}  # fmt: skip
        topics.append({"name": name, "kind": "", "count": len(frame), "times": {}, "frames": {}, "fields": fields})
    return {"topics": topics, "left_out": {}, "remarks": []}
