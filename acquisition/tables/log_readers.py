"""A script that reads logs of several topics with the libraries made for them, in a limited process.

ROS bags and MCAP, ULog and DataFlash of autopilots, ASAM MDF, TDMS, HDF5, NumPy's archives, JSON lines, SQLite.
Every reader returns what the file holds and nothing more: for each topic the times of its samples and its numeric
fields, and what the file states of them. :mod:`seatrial.acquisition.tables.topics` decides what they mean.
"""

from __future__ import annotations

import bz2
import gzip
import json
import lzma
import math
import mmap
import os
import re
import shutil
import sys
from array import array
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, fields
from datetime import UTC, datetime, timedelta
from functools import cache
from itertools import chain
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from seatrial.acquisition.core.times import names_tai
from seatrial.acquisition.tables import foreign_reader, json_messages

NANO, MICRO = 1_000_000_000, 1_000_000
_LABVIEW_EPOCH_S = -2_082_844_800
_LATEST_LABVIEW_S = 7_000_000_000  # in 2125, and as far back from 1904: what int64 counts in ns
_DATING_OR_SCALING = ("wf_start", "wf_increment", "unit_string", "NI_Scal")  # names of properties begin with these
_MOST_ELEMENTS = 32  # of an array that becomes columns: more are spectra, scans or pictures
_MOST_NESTED = 16
_LARGE_TYPES = frozenset({
    "Image", "CompressedImage", "CompressedVideo", "RawImage", "PointCloud", "PointCloud2", "LaserScan",
    "OccupancyGrid", "MarkerArray", "Marker", "Path", "TFMessage", "RawSonarImage", "ProjectedSonarImage",
    "SceneUpdate", "Grid", "GeoJSON",
})  # fmt: skip
"""Types of messages, by their last name, that hold no channel of a ship and take most of a bag's bytes."""
_LARGE, _NO_COLUMN = "no channels of a ship", "no column of numbers or text"
_TIME_NAME = re.compile(r"(?:^|[\W_])(?:t|u?times?|timestamps?|stamp|utc|datetime|epoch|ts)(?:$|[\W_])")
_CLOCK_NAME = re.compile(r"(?:^|[\W_])(?:tai|gpst?|gpstime|local|localtime|lt)(?:$|[\W_])", re.IGNORECASE)
_CLOCK = re.compile(r"\s*\d{1,2}:\d\d")
_NUMBER = re.compile(r"\s*[+-]?(?:\d{1,18}(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d{1,3})?\s*", re.ASCII)
_EARLIEST_EPOCH_S, _LATEST_EPOCH_S = 3e8, 4e9  # 1979, 2096
_ZSTD = b"\x28\xb5\x2f\xfd"
ABOUT_TOPIC = "/seatrial"
"""The topic of a bag that this product has exported which has the text of its metadata."""
_STROKES = re.compile(r"/(?![^\[(]*[\])])")  # not those of a unit in brackets
_TOPIC_KEYS = ("topic", "name", "variable", "signal", "channel", "sensor", "tag", "key")
_VALUE_KEYS = ("value", "val", "data", "msg", "message", "payload", "fields")
_PATH_KEYS = ("tagname", "tag_name", "tagpath", "path", "entity_id", "label", "description")
_FRAME_CHANNELS = ("CAN_DataFrame", "CAN_RemoteFrame", "CAN_ErrorFrame", "LIN_Frame", "ETH_Frame")
_LATEST_US = 2**62 // 1000  # of a stamp with a broken byte, which its neighbours then show
_MOST_BROKEN = 0.02  # of the lines of a log
_MDF_HEADER_AT = 64  # ASAM MDF 4.1
_MDF_TIME = 1  # cn_sync_type of a master: others count angles, distances or rows
_FRAMES = 'frames of a bus, which `seatrial record` takes by type = "file"'
_HEAD_BYTES, _BLOCK_BYTES = 4096, 1024 * 1024
_FORMAT_LINE = re.compile(rb"^FMT, *\d+, *\d+, *\w+, *\w+", re.MULTILINE)
_OPENERS: dict[str, Callable[[str], Any]] = {".gz": gzip.open, ".bz2": bz2.open, ".xz": lzma.open}
_TIME_PARTS = (("sec", "nanosec"), ("sec", "nsec"), ("secs", "nsecs"), ("seconds", "nanos"))


class TopicBuilder:
    """The samples of one topic while messages come in: times, and a column for each numeric field [n].

    ``log_ns`` are the times at which messages were recorded, ``published_ns`` at which they were sent, ``stamp_ns``
    those that they state themselves, 0 without; ``moments`` are times of a form that is not known yet. ``stated``
    are units and meanings by their schema, by path.
    """

    def __init__(self, name: str, kind: str, stated: Mapping[str, tuple[str, str]]) -> None:
        self.name, self.kind, self.count, self.stated = name, kind, 0, stated
        self.moment_name = "time"
        self.log_ns, self.published_ns, self.stamp_ns = array("q"), array("q"), array("q")
        self.moments: list[Any] = []
        self.columns: dict[str, array[float]] = {}
        self.frames: dict[str, str] = {}

    def add(self, message: Any, log_ns: int = 0, moment: Any = None, published_ns: int = 0) -> int:
        """Add a message; returns the number of its numbers."""
        numbers: list[tuple[str, float]] = []
        _flatten(message, "", numbers)
        stamp_ns = _stamp_ns(message)
        self.log_ns.append(log_ns)
        self.published_ns.append(published_ns if published_ns < 2**63 else 0)
        self.stamp_ns.append(stamp_ns)
        self.moments.append(moment)
        for path, value in numbers:
            column = self.columns.get(path)
            if column is None:
                column = self.columns[path] = array("d", [np.nan]) * self.count
            if len(column) == self.count:
                column.append(value)
        self.count += 1
        for column in self.columns.values():
            if len(column) < self.count:
                column.append(np.nan)
        if not self.frames:
            members = dict(_members(message) or ())
            header = dict(_members(members.get("header")) or ())
            names = {"frame_id": header.get("frame_id") or members.get("frame_id"),
                     "child_frame_id": members.get("child_frame_id")}  # fmt: skip
            self.frames = {key: name for key, name in names.items() if isinstance(name, str) and name}
        return len(numbers)

    def as_topic(self) -> dict[str, Any]:
        """The topic as the parent process takes it."""
        columns = {
            path: (np.array(column), *self.stated.get(path, ("", ""))) for path, column in self.columns.items()
        }
        of_clocks = {"log": self.log_ns, "published": self.published_ns, "stamp": self.stamp_ns}
        times = {clock: np.array(ns, dtype=np.int64) for clock, ns in of_clocks.items()}
        if any(moment is not None for moment in self.moments):
            columns = {self.moment_name: (_cell_array(self.moments), "", ""), **columns}
        clocks = {clock: ns for clock, ns in times.items() if ns.any()}
        return _topic_as_dict(self.name, self.kind, columns, clocks, self.frames, self.count)


class LogContent:
    """What a reader has found: topics, topics that it leaves out with the reason, remarks, and the parameters of an
    autopilot."""

    def __init__(self, cells: foreign_reader.CellBudget) -> None:
        self.cells = cells
        self.builders: dict[tuple[str, str], TopicBuilder] = {}
        self.topics: list[dict[str, Any]] = []
        self.left_out: dict[str, tuple[str, int, str]] = {}
        self.undecoded: dict[str, int] = {}
        self.stated: dict[tuple[str, str], dict[str, tuple[str, str]]] = {}
        self.remarks: list[str] = []
        self.about = ""
        self.parameters: dict[str, float] = {}

    def add_message(
        self,
        name: str,
        kind: str,
        message: Any,
        log_ns: int = 0,
        moment: Any = None,
        published_ns: int = 0,
        moment_key: str = "",
    ) -> None:
        """Add a message to its topic; that of :data:`ABOUT_TOPIC` says what the log is."""
        if name == ABOUT_TOPIC and isinstance(text := getattr(message, "data", None), str):
            self.about = text
            return
        builder = self.builders.get((name, kind))
        if builder is None:
            builder = self.builders[name, kind] = TopicBuilder(name, kind, self.stated.get((name, kind), {}))
        if _CLOCK_NAME.search(moment_key):
            builder.moment_name = moment_key
        self.cells.count_cells(1 + builder.add(message, log_ns, moment, published_ns))

    def add_topic(self, *parts: Any) -> None:
        """Add a topic whose columns are there already."""
        self.topics.append(_topic_as_dict(*parts))

    def leave_out(self, name: str, kind: str, count: int, reason: str) -> None:
        """Note a topic that is not taken."""
        _, before, earlier = self.left_out.get(name, ("", 0, reason))
        self.left_out[name] = kind, before + count, reason if count else earlier

    def as_dict(self) -> dict[str, Any]:
        """The content as the parent process takes it."""
        taken = {name for name, _ in self.builders}
        for name, count in self.undecoded.items():
            if name not in taken:
                self.leave_out(name, "", count, "its messages cannot be decoded")
            self.remarks.append(f"{count:,} messages of {name} cannot be decoded and are left out")
        topics = [*self.topics, *(builder.as_topic() for builder in self.builders.values())]
        return {"topics": topics, "left_out": self.left_out, "remarks": self.remarks, "about": self.about,
                "parameters": self.parameters}  # fmt: skip


def _topic_as_dict(
    name: str, kind: str, fields: Mapping[str, tuple[Any, str, str]], times: Mapping[str, Any] | None = None,
    frames: Mapping[str, str] | None = None, count: int | None = None,
) -> dict[str, Any]:  # fmt: skip
    sizes = [len(values) for values, _, _ in fields.values()]
    return {"name": name, "kind": kind, "count": max(sizes, default=0) if count is None else count,
            "fields": dict(fields), "times": dict(times or {}), "frames": dict(frames or {})}  # fmt: skip


def _members(value: Any) -> list[tuple[str, Any]] | None:
    """The members of a message by name: a JSON object's, a ROS message's, a protobuf message's; else None."""
    if isinstance(value, dict):
        return [(str(key), member) for key, member in value.items()]
    if hasattr(value, "__msgtype__"):
        return [(name, getattr(value, name)) for name in _field_names(value.__class__)]
    if (descriptor := getattr(value, "DESCRIPTOR", None)) is not None:
        return [
            (entry.name, getattr(value, entry.name))
            for entry in descriptor.fields
            if entry.message_type is None or entry.is_repeated or value.HasField(entry.name)
        ]
    return None


@cache
def _field_names(kind: Any) -> tuple[str, ...]:
    """The fields of a type of ROS messages, without its constants, whose names are in capitals."""
    return tuple(entry.name for entry in fields(kind) if entry.name != "__msgtype__" and not entry.name.isupper())


def _flatten(value: Any, path: str, numbers: list[tuple[str, float]], depth: int = 0) -> None:
    """Collect the numbers of a message with their paths, such as ``pose.position.x`` and ``output[2]``."""
    if depth > _MOST_NESTED:
        return
    if type(value) is float:
        numbers.append((path, value))
        return
    if isinstance(value, bool | int | float | np.number | np.bool_):
        numbers.append((path, float(value)))
        return
    if isinstance(value, str) and _NUMBER.fullmatch(value):  # in quotes, as some programs write it
        numbers.append((path, float(value)))
        return
    if value is None or isinstance(value, str | bytes | bytearray):
        return
    members = _members(value)
    if members is not None:
        if _time_of_parts(dict(members)) is not None:
            return
        labels = next((list(part) for name, part in members if name == "name" and _is_list_of_text(part)), [])
        for name, member in members:
            if name == "header":
                continue
            below = f"{path}.{name}" if path else name
            if "covar" in name.lower():  # the first says whether there is a measurement
                member = list(member)[:1] if hasattr(member, "__len__") else ()
            if labels and hasattr(member, "__len__") and len(member) == len(labels) and not isinstance(member, str):
                member = dict(zip(labels, member, strict=True))
            _flatten(member, below, numbers, depth + 1)
        return
    if hasattr(value, "__len__") and len(value) <= _MOST_ELEMENTS:
        has_members = len(value) > 0 and _members(value[0]) is not None
        names = [dict(_members(item) or ()).get("name") for item in value] if has_members else []
        are_names = _is_list_of_text(names) and "" not in names and len(set(names)) == len(names)
        labels = (
            [re.sub(r"[^\w-]", "_", str(name)) for name in names] if are_names else [*map(str, range(len(value)))]
        )
        for label, item in zip(labels, value, strict=True):
            _flatten(item, f"{path}[{label}]", numbers, depth + 1)


def _is_list_of_text(value: Any) -> bool:
    return not isinstance(value, str | bytes | dict) and hasattr(value, "__len__") and len(value) > 0 and all(
        isinstance(item, str) for item in value
    )  # fmt: skip


def _time_of_parts(members: Mapping[str, Any]) -> int | None:
    """The time [ns] of a message that is a time in two parts; None for any other."""
    for parts in _TIME_PARTS:
        if set(members) == set(parts):
            return int(members[parts[0]]) * NANO + int(members[parts[1]])
    return None


def _stamp_ns(message: Any) -> int:
    """The time [ns] that a message states: of its header, else of its own member; 0 for none."""
    members = dict(_members(message) or ())
    header = dict(_members(members.get("header")) or ())
    for stamp in (header.get("stamp"), members.get("stamp"), members.get("timestamp"), header.get("timestamp")):
        parts = _members(stamp)
        if parts is not None and (stated := _time_of_parts(dict(parts))) is not None:
            return stated if 0 <= stated < 2**63 else 0
        if parts is None and (moment_ns := _moment_ns(stamp)):
            return moment_ns
    key, moment = _stated_moment(members)
    return 0 if _CLOCK_NAME.search(key) else _moment_ns(moment)  # of another clock than UTC


def _moment_ns(moment: Any) -> int:
    """A text with its zone, or a number of s, ms, us or ns, as ns since 1970; 0 for any other."""
    if isinstance(moment, str):
        try:
            stated = datetime.fromisoformat(moment.strip())
        except ValueError:
            return 0
        since = stated - datetime.fromtimestamp(0, UTC) if stated.tzinfo else timedelta(0)
        return max(since // timedelta(microseconds=1), 0) * 1000
    if type(moment) in (int, float):
        for unit_ns in (NANO, MICRO, 1000, 1):
            if _EARLIEST_EPOCH_S < moment * unit_ns / NANO < _LATEST_EPOCH_S:
                time_ns: int = round(moment * 1e6) * 1000 if unit_ns == NANO else round(moment * unit_ns)
                return time_ns
    return 0


def _cell_array(values: Iterable[Any]) -> Any:
    """Cells as an array: whole numbers, numbers with NaN for none, or text."""
    cells = list(values)
    present = [cell for cell in cells if cell is not None]
    if present and all(isinstance(cell, int) and abs(cell) < 2**63 for cell in present):
        if len(present) == len(cells):
            return np.array(cells, dtype=np.int64)
        return np.array([np.nan if cell is None else cell for cell in cells], dtype=float)
    if all(isinstance(cell, int | float) for cell in present):
        return np.array([np.nan if cell is None else cell for cell in cells], dtype=float)
    return np.array([None if cell is None else str(cell) for cell in cells], dtype=object)


def read_bags(path: str, cells: foreign_reader.CellBudget) -> dict[str, Any]:
    """ROS bags of either version, and MCAP files: a file, or a folder of those of one trip."""
    log = LogContent(cells)
    for bag in _bag_paths(Path(path)):
        if bag.suffix == ".mcap":
            _read_mcap(bag, log)
        else:
            with _closed_database(bag, log) as database:
                _read_rosbag(database, log)
    return log.as_dict()


@contextmanager
def _closed_database(path: Path, log: LogContent) -> Iterator[Path]:
    """A database with what a program that was not ended properly has left in a journal beside it.

    It is put into a copy, as others may use the file.
    """
    journals = [path.with_name(path.name + ending) for ending in ("-wal", "-journal")]
    journals = [journal for journal in journals if journal.is_file() and journal.stat().st_size]
    if not journals or not path.is_file():
        yield path
        return
    import sqlite3

    log.remarks.append(f"{path.name} was not closed: it is read with {journals[0].name} beside it")
    with TemporaryDirectory() as folder:
        for file in (path, *journals):
            shutil.copyfile(file, Path(folder) / file.name)
        with closing(sqlite3.connect(Path(folder) / path.name)) as database:
            database.execute("PRAGMA journal_mode = DELETE").fetchone()
        yield Path(folder) / path.name


def _bag_paths(path: Path) -> list[Path]:
    """The files of a bag; a folder whose files are compressed is left to the library as a whole."""
    if path.is_file():
        return [path]
    metadata = path / "metadata.yaml"
    if metadata.is_file() and re.search(r"compression_mode\W+(?:file|message)", metadata.read_text(), re.I):
        return [path]
    patterns = [f"{depth}*.{suffix}" for depth in ("", "*/") for suffix in ("mcap", "db3", "bag")]
    bags = sorted(bag for pattern in patterns for bag in path.glob(pattern))
    if not bags:
        raise foreign_reader.RefusedError("the folder holds no .mcap, .db3 or .bag file")
    return bags


class RosTypes:
    """The types of ROS messages by their definitions, those of a bag before the usual ones."""

    def __init__(self, *, is_first: bool) -> None:
        from rosbags.typesys import Stores, get_typestore

        self._is_first, self._store = is_first, get_typestore(Stores.EMPTY)
        self._definitions = dict(get_typestore(Stores.ROS1_NOETIC if is_first else Stores.LATEST).fielddefs)

    def define(self, kind: str, text: str, *, is_idl: bool) -> None:
        """Take the definition of a type, with those that it holds."""
        from rosbags.typesys import TypesysError, get_types_from_idl, get_types_from_msg

        try:
            if is_idl:
                parts = text.split("=" * 80 + "\n") if "IDL: " in text else [text]
                for part in filter(None, parts):
                    self._definitions |= get_types_from_idl(part.partition("\n")[2] if part[:4] == "IDL:" else part)
            else:
                self._definitions |= get_types_from_msg(text, kind)
        except TypesysError:
            return

    def decode(self, kind: str, data: bytes) -> Any:
        """A message. Raises KeyError for a type that is not known."""
        kind = kind if "/msg/" in kind else kind.replace("/", "/msg/", 1)
        if kind not in self._store.fielddefs:
            self._register(kind)
        decode = self._store.deserialize_ros1 if self._is_first else self._store.deserialize_cdr
        return decode(data, kind)

    def _register(self, kind: str) -> None:
        """Register a type and those that it holds."""
        waiting, needed = [kind], dict[str, Any]()
        while waiting:
            name = waiting.pop()
            if name in needed or name in self._store.fielddefs:
                continue
            needed[name] = self._definitions[name]
            waiting += re.findall(r"'([\w/]+/msg/\w+)'", repr(needed[name][1]))
        self._store.register(needed)


def _read_rosbag(path: Path, log: LogContent) -> None:
    from rosbags.interfaces import MessageDefinitionFormat
    from rosbags.rosbag1 import Reader as FirstReader
    from rosbags.rosbag1 import ReaderError
    from rosbags.rosbag2 import Reader as SecondReader

    is_first = path.suffix == ".bag"
    reader: Any = FirstReader(path) if is_first else SecondReader(path)
    try:
        reader.open()
    except ReaderError as error:
        if "index" in str(error).lower():
            raise foreign_reader.RefusedError("it was not closed; `rosbag reindex` makes it readable") from error
        raise
    with closing(reader):
        types, wanted = RosTypes(is_first=is_first), []
        for connection in reader.connections:
            kind, definition = connection.msgtype, connection.msgdef
            if definition.format != MessageDefinitionFormat.NONE:
                types.define(kind, definition.data, is_idl=definition.format == MessageDefinitionFormat.IDL)
            reason = "empty" if connection.msgcount == 0 else _LARGE if _is_large(kind) else ""
            if reason:
                log.leave_out(connection.topic, kind, connection.msgcount, reason)
            else:
                wanted.append(connection)
        for connection, log_ns, data in reader.messages(wanted) if wanted else ():
            _add_decoded(log, connection.topic, connection.msgtype, log_ns, data, types.decode)


def _is_large(kind: str) -> bool:
    return re.split(r"[/.]", kind)[-1] in _LARGE_TYPES


def _add_decoded(
    log: LogContent,
    topic: str,
    kind: str,
    log_ns: int,
    data: Any,
    decode: Callable[[str, Any], Any],
    published_ns: int = 0,
) -> None:
    """Decode a message and add it; a topic whose type is not known is left out."""
    if topic in log.left_out and log.left_out[topic][2].startswith("its type"):
        return log.leave_out(topic, kind, 1, log.left_out[topic][2])
    try:
        message = decode(kind, data)
    except (KeyError, TypeError) as error:
        return log.leave_out(topic, kind, 1, f"its type is not known ({error})"[:120])
    except MemoryError:
        raise
    except Exception:  # of one message: the others may be right
        if bytes(data[:4]) == _ZSTD:
            return log.leave_out(
                topic, kind, 1, "its messages are packed, as metadata.yaml says: give the bag's folder"
            )
        log.undecoded[topic] = log.undecoded.get(topic, 0) + 1
        return None
    return log.add_message(topic, kind, message, log_ns, published_ns=published_ns)


@dataclass(slots=True)
class McapChannel:
    """A channel of an MCAP file: what decodes its messages, or why they are not read."""

    topic: str
    kind: str
    decode: Callable[[str, Any], Any] | None
    reason: str = ""
    count: int = 0


def _read_mcap(path: Path, log: LogContent) -> None:
    """The messages of an MCAP file whose schemas are of ROS 1 or 2, protobuf or JSON; of one that is damaged or cut
    short those before."""
    from mcap.records import Channel, Message, Schema
    from mcap.stream_reader import StreamReader

    schemas, channels, stores = dict[int, Any](), dict[int, McapChannel](), dict[str, RosTypes]()
    with path.open("rb") as stream:
        try:
            for record in StreamReader(stream, validate_crcs=True, record_size_limit=path.stat().st_size).records:
                if isinstance(record, Schema):
                    schemas[record.id] = record
                elif isinstance(record, Channel) and record.id not in channels:
                    schema = schemas.get(record.schema_id)
                    channel = channels[record.id] = _mcap_channel(record, schema, stores)
                    log.stated[channel.topic, channel.kind] = _stated_in_json_schema(schema)
                elif isinstance(record, Message):
                    channel = channels[record.channel_id]
                    channel.count += 1
                    if channel.decode is not None:
                        about = channel.topic, channel.kind, record.log_time, record.data, channel.decode
                        _add_decoded(log, *about, record.publish_time)
        except (MemoryError, foreign_reader.RefusedError):
            raise
        except Exception as error:  # the library promises no set of errors for a broken file
            count, place = sum(channel.count for channel in channels.values()), stream.tell()
            where = f"{path.name} was not closed, or is damaged or cut short at byte {place:,}"
            if count == 0:
                raise foreign_reader.RefusedError(f"{where}, before any message") from error
            log.remarks.append(
                f"{where}: the {count:,} messages before are read, and `mcap recover` may save some behind"
            )
    for channel in channels.values():
        if channel.decode is None or channel.count == 0:
            log.leave_out(channel.topic, channel.kind, channel.count, channel.reason or "empty")


def _mcap_channel(record: Any, schema: Any, stores: dict[str, RosTypes]) -> McapChannel:
    """A channel with what decodes its messages; without it for large types and encodings that are not known."""
    kind, encoding = schema.name if schema else "", record.message_encoding
    if _is_large(kind):
        return McapChannel(record.topic, kind, None, _LARGE)
    try:
        decode = _mcap_decoder(encoding, schema, stores)
    except MemoryError:
        raise
    except Exception as error:  # of the libraries: the other channels are right
        return McapChannel(
            record.topic, kind, None, f"its schema is broken, or lacks what it imports ({error})"[:160]
        )
    reason = "" if decode else f"its encoding, {encoding or 'unnamed'}, is not read"
    return McapChannel(record.topic, kind, decode, reason)


def _stated_in_json_schema(schema: Any) -> dict[str, tuple[str, str]]:
    """The units and descriptions of a JSON schema by the path of its numbers; empty for another schema."""
    stated = dict[str, tuple[str, str]]()

    def visit(node: Any, path: str, depth: int) -> None:
        if not isinstance(node, dict) or depth > _MOST_NESTED:
            return
        texts = [str(node[key]) for key in ("unit", "units", "description") if isinstance(node.get(key), str)]
        if path and texts:
            stated[path] = texts[0] if "unit" in node or "units" in node else "", str(node.get("description", ""))
        properties = node.get("properties")
        for name, member in properties.items() if isinstance(properties, dict) else ():
            visit(member, f"{path}.{name}" if path else str(name), depth + 1)

    if schema is not None and schema.encoding == "jsonschema":
        with suppress(ValueError):
            visit(json.loads(schema.data), "", 0)
    return stated


def _mcap_decoder(encoding: str, schema: Any, stores: dict[str, RosTypes]) -> Callable[[str, Any], Any] | None:
    """What decodes messages of an encoding and a schema; None for an encoding that is not known."""
    if encoding in ("ros1", "cdr") and schema is not None:
        if encoding not in stores:
            stores[encoding] = RosTypes(is_first=encoding == "ros1")
        stores[encoding].define(schema.name, schema.data.decode(errors="replace"), is_idl="idl" in schema.encoding)
        return stores[encoding].decode
    if encoding == "json":
        return lambda _, data: json.loads(data)
    if encoding == "protobuf" and schema is not None:
        from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

        pool, files = descriptor_pool.DescriptorPool(), descriptor_pb2.FileDescriptorSet.FromString(schema.data)
        waiting = {file.name: file for file in files.file}

        def add(name: str) -> None:
            if (file := waiting.pop(name, None)) is not None:
                for dependency in file.dependency:
                    add(dependency)
                pool.Add(file)

        for name in list(waiting):
            add(name)
        message_type = message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name))
        return lambda _, data: message_type.FromString(data)
    return None


_LONGEST_ULOG_MESSAGE = 0xFFFF


def _bytes_of_ulog_types(formats: Mapping[str, Any], basic: Mapping[str, int]) -> dict[str, int]:
    """The bytes of a message of each type that a ULog defines, without those that are nested too deep or in
    themselves."""
    sizes = dict[str, int]()
    for _ in range(_MOST_NESTED):
        known = {**sizes, **basic}
        for name in formats.keys() - sizes.keys():
            if all(kind in known for kind, _, _ in formats[name].fields):
                sizes[name] = sum(max(length, 1) * max(known[kind], 1) for kind, length, _ in formats[name].fields)
    return sizes


def read_ulog(path: str, cells: foreign_reader.CellBudget) -> dict[str, Any]:
    """The topics of PX4's log, with times since the autopilot's start."""
    from pyulog import ULog

    log, sizes, size = LogContent(cells), dict[str, int](), Path(path).stat().st_size
    basic = {kind: ULog.get_field_size(kind) for kind in ULog._UNPACK_TYPES}

    class Subscription(ULog._MessageAddLogged):  # type: ignore[misc]
        """The library's, which lists every element of nested arrays, whether or not a message can hold them."""

        def _parse_format(self, message_formats: Mapping[str, Any]) -> None:
            if not sizes:
                sizes.update(_bytes_of_ulog_types(message_formats, basic))
            length = sizes.get(self.message_name)
            if length is None or length > _LONGEST_ULOG_MESSAGE:
                kind = f"its type is longer than the {_LONGEST_ULOG_MESSAGE:,} bytes of a message"
                reason = kind if length else "its type is not defined, nested too deep, or in itself"
                log.leave_out(self.message_name, self.message_name, 0, reason)
                raise ValueError(reason)  # the library goes on with the next
            cells.remaining -= length
            if cells.remaining > 0:
                super()._parse_format(message_formats)

    class BoundedULog(ULog):  # type: ignore[misc]
        _MessageAddLogged = Subscription

        def _check_packet_corruption(self, header: Any) -> bool:
            if self._file_handle.tell() >= size:  # it would go back by more than it has read, without end
                raise ValueError("a message is cut off")
            return bool(super()._check_packet_corruption(header))

    file = BoundedULog(path)
    cells.count_cells(0)
    several = {topic.name for topic in file.data_list if topic.multi_id > 0}
    for topic in file.data_list:
        columns = dict(topic.data)
        cells.count_cells(sum(map(len, columns.values())))
        if "timestamp" not in columns:
            log.leave_out(topic.name, topic.name, max(map(len, columns.values()), default=0), "without times")
            continue
        boot_ns = np.minimum(columns.pop("timestamp"), _LATEST_US).astype(np.int64) * 1000
        name = f"{topic.name}[{topic.multi_id}]" if topic.name in several else topic.name
        fields = {field: (values, "", "") for field, values in columns.items() if "_padding" not in field}
        log.add_topic(name, topic.name, fields, {"boot": boot_ns})
    sound_bytes = _sound_bytes_of_ulog(path)
    if sound_bytes < size:
        where = f"damaged, or cut short, at byte {sound_bytes:,} of {size:,}"
        log.remarks.append(f"the log is {where}: what the library finds intact is read")
    elif file.file_corruption:
        log.remarks.append("messages of topics, or of lengths, that the log does not define are left out")
    if file.dropouts:
        lost_s = sum(dropout.duration for dropout in file.dropouts) / 1000.0
        log.remarks.append(f"the autopilot could not write {len(file.dropouts):,} times, {lost_s:.1f} s together")
    if not log.topics:
        raise foreign_reader.RefusedError("it holds no topic: it is damaged, or cut short")
    return log.as_dict()


_ULOG_HEAD_BYTES, _ULOG_KINDS = 16, frozenset(b"BFIMPQARDLCSO")


def _sound_bytes_of_ulog(path: str) -> int:
    """How far the messages of a ULog follow each other without a break; the library passes over some in silence."""
    with Path(path).open("rb") as stream, mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as data:
        at, size = _ULOG_HEAD_BYTES, len(data)
        while at + 3 <= size and data[at + 2] in _ULOG_KINDS:
            end = at + 3 + data[at] + 256 * data[at + 1]
            if end > size:
                break
            at = end
        return at


_DATAFLASH = (
    "GPS", "GPS2", "GPA", "POS", "ATT", "AHR2", "IMU", "XKF1", "XKF2", "NKF1", "NKF2", "RCOU", "RCIN", "ESC", "RPM",
    "SIM", "STER", "THR", "BARD", "ARSP", "WENC", "DPTH", "WIND",
)  # fmt: skip
"""The messages of ArduPilot's log that are read: those of motion, outputs and surroundings."""


def read_dataflash(path: str, cells: foreign_reader.CellBudget) -> dict[str, Any]:
    """The messages of ArduPilot's log, in units as the log states them, with times since the autopilot's start."""
    from pymavlink.DFReader import DFReader_binary

    with Path(path).open("rb") as stream:
        head = stream.read(_HEAD_BYTES)
    if head[:2] != b"\xa3\x95":
        if _FORMAT_LINE.search(head) is None:
            raise foreign_reader.RefusedError("it does not begin as a DataFlash log of ArduPilot")
        return _read_dataflash_text(path, cells)

    class Reader(DFReader_binary):  # type: ignore[misc]
        offset: int

        def _parse_next(self) -> Any:
            begin, message = self.offset, super()._parse_next()
            self.offset = max(self.offset, begin + 1)  # one that states no length would come again without end
            return message

    reader, log = Reader(path), LogContent(cells)
    names = {number: entry.name for number, entry in reader.formats.items()}
    counts = {names[number]: len(offsets) for number, offsets in enumerate(reader.offsets) if len(offsets)}
    for kind, count in counts.items():
        if kind not in (*_DATAFLASH, "PARM"):
            log.leave_out(kind, kind, count, _LARGE)
    lost = reader.data_len - sum(
        reader.formats[number].len * len(offsets) for number, offsets in enumerate(reader.offsets) if len(offsets)
    )
    if lost:
        where = f"{lost:,} bytes are of no message" if lost > 0 else "it ends in the middle of a message"
        log.remarks.append(f"the log is damaged in places, or cut short: {where}")
    units: dict[str, dict[str, str]] = {}
    kinds = [kind for kind in counts if kind in (*_DATAFLASH, "PARM")]
    while (message := reader.recv_match(type=kinds)) is not None:
        kind, entry = message.get_type().partition("[")[0], message.fmt
        values = {name: getattr(message, name) for name in entry.columns}
        if kind == "PARM":
            log.parameters[str(values.get("Name", ""))] = float(values.get("Value", math.nan))
            continue
        time_us = values.pop("TimeUS", None)
        if time_us is None:
            continue
        instance = f"[{values.pop(entry.instance_field)}]" if entry.instance_field in values else ""
        units.setdefault(kind + instance, {name: entry.get_unit(name) or "" for name in entry.columns})
        log.add_message(kind + instance, kind, values, min(int(time_us), _LATEST_US) * 1000)
    reader.close()
    return _since_boot(log, units)


def _since_boot(log: LogContent, units: Mapping[str, Mapping[str, str]]) -> dict[str, Any]:
    """The content of a log of ArduPilot, whose times count from the autopilot's start."""
    content = log.as_dict()
    if not content["topics"]:
        raise foreign_reader.RefusedError("it holds no message of motion: it is damaged, or cut short")
    for topic in content["topics"]:
        topic["times"] = {"boot": topic["times"].get("log", np.zeros(topic["count"], dtype=np.int64))}
        stated = units.get(topic["name"], {})
        topic["fields"] = {
            name: (values, stated.get(name, ""), "") for name, (values, _, _) in topic["fields"].items()
        }
    return content


def _read_dataflash_text(path: str, cells: foreign_reader.CellBudget) -> dict[str, Any]:
    """The same of a log as text, whose numbers ground stations have put into their units."""
    log, columns, instances = LogContent(cells), dict[str, list[str]](), dict[str, str]()
    names, damaged = dict[str, str](), 0
    with Path(path).open(encoding="utf-8", errors="replace") as stream:
        for line in stream:
            kind, *entries = (part.strip() for part in line.split(","))
            if kind == "FMT" and len(entries) >= 4:
                names[entries[0]], columns[entries[2]] = entries[2], entries[4:]
            elif kind == "FMTU" and len(entries) >= 3 and "#" in entries[2]:
                numbered, place = names.get(entries[1], ""), entries[2].index("#")
                instances[numbered] = columns.get(numbered, [""] * (place + 1))[place]
            elif kind in _DATAFLASH:
                try:
                    values = dict(zip(columns[kind], map(_number_or_text, entries), strict=True))
                    time_ns = int(values.pop("TimeUS")) * 1000
                except (KeyError, ValueError, TypeError, IndexError):
                    damaged += 1
                    continue
                number = values.pop(instances.get(kind, ""), None)
                log.add_message(kind if number is None else f"{kind}[{number:g}]", kind, values, time_ns)
            elif kind in columns:
                log.leave_out(kind, kind, 1, _LARGE)
    if damaged:
        log.remarks.append(f"{damaged:,} lines are damaged, or without TimeUS, and left out")
    return _since_boot(log, {})


def _number_or_text(cell: str) -> float | str:
    try:
        return float(cell)
    except ValueError:
        return cell


def read_mdf(path: str, cells: foreign_reader.CellBudget) -> dict[str, Any]:
    """The groups of a measurement by ASAM MDF, each with its own times."""
    from asammdf import MDF

    log = LogContent(cells)
    _refuse_circular_mdf(path)
    with MDF(path) as file:
        clock, start_ns = _start_of_measurement(file)
        log.about = str(file.header.description or "")
        groups: Any = file.groups
        for number, group in enumerate(groups):
            cycles = int(group.channel_group.cycles_nr)
            master = file.masters_db.get(number)
            indices = [index for index in range(len(group.channels)) if index != master]
            cells.count_cells(cycles * (len(indices) + 1))
            name = next(filter(None, (str(getattr(group.channel_group, key, "") or "").strip()
                                      for key in ("acq_name", "comment"))), f"group {number + 1}")  # fmt: skip
            if (
                cycles == 0
                or master is None
                or getattr(group.channels[master], "sync_type", _MDF_TIME) != _MDF_TIME
            ):
                log.leave_out(name, "", cycles, "empty" if cycles == 0 else "without times")
                continue
            if any(channel.name.startswith(_FRAME_CHANNELS) for channel in group.channels):
                log.leave_out(name, "", cycles, _FRAMES)
                continue
            fields, ns = dict[str, tuple[Any, str, str]](), None
            for signal in file.select([(None, number, index) for index in indices],
                                      ignore_value2text_conversions=True):  # fmt: skip
                if signal.samples.ndim == 1 and signal.samples.dtype.kind in "biuf":
                    ns = start_ns + np.rint(signal.timestamps * NANO).astype(np.int64)
                    invalid = getattr(signal, "invalidation_bits", None)
                    values = signal.samples
                    if invalid is not None:
                        values = np.where(np.asarray(invalid, dtype=bool), np.nan, values)
                    fields[signal.name] = values, str(signal.unit or ""), str(signal.comment or "")
            if ns is None:
                log.leave_out(name, "", cycles, "no numbers")
            else:
                log.add_topic(name, "", fields, {clock: ns})
    return log.as_dict()


def _refuse_circular_mdf(path: str) -> None:
    """Raises RefusedError for an MDF 4 whose groups or channels follow upon themselves: the library never ends."""
    with Path(path).open("rb") as stream, mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as data:

        def chain(place: int, link: int) -> Iterator[int]:
            """The blocks that follow each other from the link of a block on."""
            at, seen = int.from_bytes(data[place + 24 + 8 * link : place + 32 + 8 * link], "little"), set[int]()
            while 0 < at < len(data):
                if at in seen:
                    raise foreign_reader.RefusedError("it is damaged: its blocks follow upon themselves")
                seen.add(at)
                yield at
                at = int.from_bytes(data[at + 24 : at + 32], "little")

        if data[8:9] == b"4":  # the header's first link is the first group of data, their second what is below them
            for group in chain(_MDF_HEADER_AT, 0):
                for channels in chain(group, 1):
                    deque(chain(channels, 1), maxlen=0)


def _start_of_measurement(file: Any) -> tuple[str, int]:
    """The clock and the start [ns since 1970] of an MDF measurement: "stamp" for UTC, "local" without a zone.

    Headers of before MDF 3.2 have the date and time of the logger's clock alone, which the library would take for
    that of this machine.
    """
    if file.version < "4" and not getattr(file.header, "abs_time", 0):
        text = f"{file.header.date.decode('latin-1')} {file.header.time.decode('latin-1')}"
        start = datetime.strptime(text.replace("\0", ""), "%d:%m:%Y %H:%M:%S")
    else:
        start = file.start_time
    since_1970 = start.replace(tzinfo=start.tzinfo or UTC) - datetime.fromtimestamp(0, UTC)
    return "stamp" if start.tzinfo else "local", since_1970 // timedelta(microseconds=1) * 1000


def _labview_ns(times: Any) -> Any:
    """LabVIEW's times, seconds since 1904 and fractions of 2^-64 s, rounded to ns since 1970; NaT for zero, which
    stands for none, and for what ns cannot count."""
    stated_s = np.asarray(times.seconds, dtype=np.int64)
    is_time = (stated_s != 0) & (np.abs(stated_s) < _LATEST_LABVIEW_S)
    fractions = (np.asarray(times.second_fractions, dtype=np.uint64) >> np.uint64(32)).astype(np.int64)
    ns = (np.where(is_time, stated_s, 0) + _LABVIEW_EPOCH_S) * NANO + ((fractions * NANO + 2**31) >> 32)
    return np.where(is_time, ns.view("datetime64[ns]"), np.datetime64("NaT"))


def read_tdms(path: str, cells: foreign_reader.CellBudget) -> dict[str, Any]:
    """The groups of a LabVIEW measurement; channels of the same starts, steps and length are a topic.

    An index beside the file is not used: it may be of another file, or end before.
    """
    from nptdms import TdmsFile

    log = LogContent(cells)
    with Path(path).open("rb") as stream:
        stated, end = _stated_in_tdms(stream)
    with Path(path).open("rb") as stream, TdmsFile.open(stream, raw_timestamps=True) as file:
        cells.count_cells(sum(len(channel) for group in file.groups() for channel in group.channels()))
        file._read_data(file._reader)  # at once: of one channel it passes over those before it, each time
        for group in file.groups():
            waveforms: dict[tuple[Any, ...], dict[str, tuple[Any, str, str]]] = {}
            has_times = any(  # a channel that states the times of the others, by its type or its name
                len(channel) > 0 and (channel.dtype.kind == "M" or _TIME_NAME.search(channel.name.lower()))
                for channel in group.channels()
            )
            for channel in group.channels():
                try:
                    clock, parts = _waveform_parts(stated.get(channel.path, []), len(channel))
                except foreign_reader.RefusedError as error:
                    log.leave_out(f"{group.name}/{channel.name}", "", len(channel), str(error))
                    continue
                texts = (str(channel.properties.get(key, "") or "") for key in ("unit_string", "description"))
                if has_times and clock != "stamp":
                    clock, parts = "", ()
                values = channel[:]
                values = _labview_ns(values) if hasattr(values, "second_fractions") else _plain_cells(values)
                waveforms.setdefault((clock, parts, len(channel)), {})[channel.name] = values, *texts
            for number, ((clock, parts, length), members) in enumerate(waveforms.items()):
                name = group.name + (f" ({number + 1})" if number else "")
                log.add_topic(name, "", members, {clock: _waveform_ns(parts, length)} if clock else {})
                if len(parts) > 1:
                    log.remarks.append(f"{name} states {len(parts):,} starts: each dates what was written with it")
        if end < Path(path).stat().st_size or file.file_status.incomplete_final_segment:
            log.remarks.append("the file ends in the middle of a segment: what is before is read")
    return log.as_dict()


Statement = tuple[int, dict[str, Any]]
"""How many samples of a channel come before a statement, and the properties that it leaves in force."""
WaveformPart = tuple[int, int, float]
"""The first sample that a start dates, the start [ns] and the step [s]."""


def _stated_in_tdms(stream: Any) -> tuple[dict[str, list[Statement]], int]:
    """What the segments of a TDMS file state of each object, as far as it dates or scales samples, and where the
    last of them ends. The library keeps the last of each property alone."""
    from nptdms.reader import TdmsReader

    stated: dict[str, list[Statement]] = {}

    class Segments(TdmsReader):  # type: ignore[misc]  # the library has no types
        def _update_object_metadata(self, segment: Any) -> None:
            self._counts = {path: entry.num_values for path, entry in self.object_metadata.items()}
            super()._update_object_metadata(segment)

        def _update_object_properties(self, properties: Any) -> None:
            for path, entries in (properties or {}).items():
                statements = stated.setdefault(path, [])
                before = statements[-1][1] if statements else {}
                after = before | {key: value for key, value in entries if key.startswith(_DATING_OR_SCALING)}
                if after != before:
                    statements.append((self._counts.get(path, 0), after))

    reader = Segments(stream)
    reader.read_metadata()
    return stated, reader._segments[-1].next_segment_pos if reader._segments else 0


def _waveform_parts(statements: list[Statement], length: int) -> tuple[str, tuple[WaveformPart, ...]]:
    """The clock of a channel's waveform, and its parts; no clock for a channel that is none.

    Raises :class:`RefusedError` for samples that cannot be dated or scaled.
    """
    if not length:
        raise foreign_reader.RefusedError("empty")
    scale, clocks = "", dict[int, tuple[str, int, float]]()
    for first, properties in statements:
        before = scale
        scale = "; ".join(str(value) for key, value in properties.items() if key[:3] != "wf_" and value)
        if first and before not in ("", scale):
            raise foreign_reader.RefusedError(
                f"its unit or scale changes on the way, from {before[:40]!r} to {scale[:40]!r}"
            )
        clock = _waveform_clock(properties)
        if clock[0] and clock != next(reversed(clocks.values()), None):
            clocks[first] = clock
    firsts, kinds = [*clocks], {clock for clock, _, _ in clocks.values()}
    if len(kinds) > 1 or (firsts not in ([], [length]) and (firsts[0] or firsts[-1] == length)):
        raise foreign_reader.RefusedError(
            "it states a start for a part of its samples, and it is not clear for which"
        )
    return kinds.pop() if kinds else "", tuple(
        (first % length, start_ns, step_s) for first, (_, start_ns, step_s) in clocks.items()
    )


def _waveform_clock(about: Mapping[str, Any]) -> tuple[str, int, float]:
    """The clock of a waveform, its start [ns] and step [s]; no clock for what is none.

    A start of zero, in 1904, is LabVIEW's for a waveform that has none. Raises
    :class:`RefusedError` for what is no date.
    """
    step_s, start = float(about.get("wf_increment", 0.0) or 0.0), about.get("wf_start_time")
    if not step_s:
        return "", 0, 0.0
    offset_s = float(about.get("wf_start_offset", 0.0) or 0.0)
    if not max(abs(step_s), abs(offset_s)) < _LATEST_LABVIEW_S:  # NaN is neither
        raise foreign_reader.RefusedError(f"its increment and offset, {step_s:g} and {offset_s:g} s, are no times")
    offset_ns = round(offset_s * NANO)
    if start is None or not (start.seconds or start.second_fractions):
        return "boot", offset_ns, step_s
    if np.isnat(start_ns := _labview_ns(start)):
        raise foreign_reader.RefusedError("its start is no date")
    return "stamp", int(start_ns.astype(np.int64)) + offset_ns, step_s


def _waveform_ns(parts: tuple[WaveformPart, ...], length: int) -> Any:
    """The times [ns] of a waveform's samples."""
    ends = [*(first for first, _, _ in parts[1:]), length]
    return np.concatenate([
        start_ns + np.rint(np.arange(end - first) * (step_s * NANO)).astype(np.int64)
        for (first, start_ns, step_s), end in zip(parts, ends, strict=True)
    ])  # fmt: skip


def read_hdf5(path: str, cells: foreign_reader.CellBudget) -> dict[str, Any]:
    """The groups and tables of an HDF5 file."""
    import h5py

    log, arrays = LogContent(cells), dict[str, tuple[Any, dict[str, Any]]]()

    def visit(group: Any, stem: str, depth: int) -> None:
        if depth > _MOST_NESTED:
            raise foreign_reader.RefusedError("its groups hold each other")
        for name, item in foreign_reader.members_of_group(group):
            below = f"{stem}/{name}" if stem else name
            if isinstance(item, h5py.Group):
                visit(item, below, depth + 1)
            elif isinstance(item, h5py.Dataset) and (item.ndim > 2 or item.dtype.kind not in "biufSOV"):
                log.leave_out(below, "", item.size, _NO_COLUMN)
            elif isinstance(item, h5py.Dataset) and item.ndim:
                cells.count_cells(item.size * max(1, len(item.dtype.names or ())))
                about = foreign_reader.readable_attributes(item.attrs)
                arrays[below] = foreign_reader.unpack_values(foreign_reader.dataset_values(item), about), about

    with h5py.File(path) as file:
        visit(file, "", 0)
    _add_arrays(log, arrays)
    return log.as_dict()


def read_npz(path: str, cells: foreign_reader.CellBudget) -> dict[str, Any]:
    """The arrays of a NumPy archive; names with a stroke are in groups."""
    import zipfile

    with zipfile.ZipFile(path) as archive:
        cells.count_cells(sum(entry.file_size for entry in archive.infolist()) // 8)
    log, arrays = LogContent(cells), dict[str, tuple[Any, dict[str, Any]]]()
    with np.load(path, allow_pickle=False) as content:
        for name in content.files:
            try:
                arrays[name] = content[name], {}
            except ValueError as error:
                if "allow_pickle" not in str(error):
                    raise
                log.leave_out(name, "", 0, "it holds objects of Python, which are not read")
    _add_arrays(log, arrays)
    return log.as_dict()


def _add_arrays(log: LogContent, arrays: Mapping[str, tuple[Any, Mapping[str, Any]]]) -> None:
    """Add a topic for each group of arrays of one length; its times may be in the group above."""
    groups: dict[tuple[str, int], dict[str, tuple[Any, str, str]]] = {}
    times: dict[tuple[str, int], dict[str, tuple[Any, str, str]]] = {}
    for path, (values, attributes) in arrays.items():
        if not 0 < values.ndim <= 2 or values.dtype.kind == "c":
            log.leave_out(path, "", values.size, _NO_COLUMN)
            continue
        calendar = _decoded_text(attributes.get("calendar", foreign_reader.CALENDARS[0]))
        if calendar.lower() not in (*foreign_reader.CALENDARS, "tai"):
            log.leave_out(path, "", values.size, f"its times are of the calendar {calendar!r}")
            continue
        *above, name = _STROKES.split(path)
        stem = "/".join(above)
        if values.dtype.names:
            parts, stem = {str(field): values[field] for field in values.dtype.names}, path
        elif values.ndim == 2 and min(values.shape) == 1:
            parts = {name: values.ravel()}
        elif values.ndim == 2:
            parts, stem = _split_columns(values, attributes), path
            if not parts:
                log.leave_out(path, "", values.size, _NO_COLUMN)
        else:
            parts = {name: values}
        unit, meaning = _stated_unit_and_meaning(name, attributes)
        for field, column in parts.items():
            entry = (column / np.timedelta64(1, "ns"), "ns", meaning) if column.dtype.kind == "m" else (
                _plain_cells(column), unit, meaning
            )  # fmt: skip
            key = stem, len(column)
            groups.setdefault(key, {})[field] = entry
            if _TIME_NAME.search(field.lower()):
                times.setdefault(key, {})[field] = entry
    for (stem, length), members in groups.items():
        nearest = [stem.rsplit("/", depth)[0] for depth in range(stem.count("/") + 1)] + [""]
        shared = next((times[group, length] for group in nearest if (group, length) in times), {})
        if not shared:
            for field, (values, _, _) in members.items():
                log.leave_out(f"{stem}/{field}".strip("/"), "", len(values), "without times")
        elif set(members) != set(shared):
            log.add_topic(stem, "", {**shared, **members})


def _stated_unit_and_meaning(name: str, attributes: Mapping[str, Any]) -> tuple[str, str]:
    """An array's unit and meaning by its attributes; the unit of times of TAI says so."""
    texts = {key: _decoded_text(value) for key, value in attributes.items()}
    unit = next((texts[key] for key in ("units", "unit", "Units", "Unit") if key in texts), "")
    meaning = next((texts[key] for key in ("long_name", "description") if key in texts), "")
    if _TIME_NAME.search(name.lower()) and any(map(names_tai, texts.values())) and not names_tai(unit):
        unit = f"{unit} TAI".strip()
    return unit, meaning


def _split_columns(values: Any, attributes: Mapping[str, Any]) -> dict[str, Any]:
    """The columns of a matrix, by the names that its attributes state, else by number."""
    values = values if values.shape[0] >= values.shape[1] else values.T
    if values.shape[1] > _MOST_ELEMENTS:
        return {}
    stated = next((attributes[key] for key in ("columns", "names", "labels", "fields") if key in attributes), ())
    names = (
        [_decoded_text(name) for name in np.atleast_1d(stated)]
        if len(np.atleast_1d(stated)) == values.shape[1]
        else []
    )
    return {names[index] if names else f"[{index}]": values[:, index] for index in range(values.shape[1])}


def _plain_cells(column: Any) -> Any:
    return (
        column if column.dtype.kind in "biufM" else np.array([_decoded_text(cell) for cell in column], dtype=object)
    )


def _decoded_text(value: Any) -> str:
    return value.decode(errors="replace") if isinstance(value, bytes) else str(value)


def read_json_lines(path: str, cells: foreign_reader.CellBudget) -> dict[str, Any]:
    """JSON objects, one a line or in an array, or an object of arrays: of one topic, of several by a key, names and
    values, or of canboat or Signal K.

    Of the vessels of Signal K the log's own is taken, else the one with most messages; the others are AIS targets.
    """
    log, own_vessel = LogContent(cells), "vessels.self"
    vessels, senders = dict[str, LogContent](), dict[str, json_messages.Senders]()
    for number, entry in _json_entries(Path(path), log):
        if not isinstance(entry, dict):
            raise foreign_reader.RefusedError(f"line {number} is no JSON object")
        ship = str(entry.get("context", own_vessel))
        if (messages := json_messages.messages_of_program(entry, senders.setdefault(ship, {}))) is not None:
            content = vessels.setdefault(ship, LogContent(cells))
            for message in messages:
                content.add_message(message.topic, "", message.content, 0, message.moment)
        elif str(entry.get("self", "")).startswith("vessels."):  # a server's greeting
            own_vessel = entry["self"]
        else:
            _add_object(log, entry)
    counts = {name: sum(builder.count for builder in vessel.builders.values()) for name, vessel in vessels.items()}
    if own_vessel not in vessels:
        own_vessel = max(counts, key=counts.__getitem__, default="")
    for name, vessel in vessels.items():
        if name == own_vessel:
            log.builders |= vessel.builders
        else:
            log.leave_out(name, "", counts[name], f"another vessel than {own_vessel}")
    return log.as_dict()


def _json_entries(path: Path, log: LogContent) -> Iterator[tuple[int, Any]]:
    """The objects of a file with their numbers: one a line, of an array, or the rows of an object of arrays.

    A few lines that are none are left out with a remark, as the last where the power went.
    """
    with path.open("rb") as stream:
        lines = ((number, line) for number, line in enumerate(stream, start=1) if line.strip())
        number, first = next(lines, (1, b"[]"))
        try:
            content, second = json.loads(first), next(lines, None)
        except ValueError:  # one value over several lines
            stream.seek(0)
            try:
                content, second = json.load(stream), None
            except ValueError as error:
                raise foreign_reader.RefusedError(
                    f"it is neither JSON nor lines of it: {str(error)[:100]}"
                ) from error
        if second is not None:
            yield number, content
            broken, first_broken, reason = 0, 0, ""
            for number, line in chain([second], lines):
                try:
                    entry = json.loads(line)
                except ValueError as error:
                    if not broken:
                        first_broken, reason = number, str(error)[:100]
                    broken += 1
                    continue
                yield number, entry
            if broken > max(1, _MOST_BROKEN * number):
                raise foreign_reader.RefusedError(
                    f"line {first_broken} is no JSON: {reason}, and {broken - 1:,} others are none"
                )
            if broken:
                which = f"{broken:,} lines, the first line {first_broken}, are no JSON"
                cut = f"the last line, {number}, breaks off"
                log.remarks.append(f"{cut if first_broken == number else which}: left out")
            return
    if _is_object_of_arrays(content):
        content = [dict(zip(content, row, strict=True)) for row in zip(*content.values(), strict=True)]
    yield from enumerate(content if isinstance(content, list) else [content], start=1)


def _is_object_of_arrays(content: Any) -> bool:
    return (
        isinstance(content, dict)
        and bool(content)
        and all(isinstance(column, list) for column in content.values())
        and len({len(column) for column in content.values()}) == 1
        and len(next(iter(content.values()))) > _MOST_ELEMENTS
    )


def _add_object(log: LogContent, entry: dict[str, Any]) -> None:
    """Add a message of any program: its topic, time and content by the names of its members."""
    topic = next((entry[key] for key in _TOPIC_KEYS if isinstance(entry.get(key), str)), "")
    moment_key, moment = _stated_moment(entry)
    content = {key: _parse_payload(value) if key in _VALUE_KEYS else value for key, value in entry.items()
               if key != moment_key and not (isinstance(value, str) and key in _TOPIC_KEYS)}  # fmt: skip
    inner = next((content[key] for key in _VALUE_KEYS if isinstance(content.get(key), dict)), None)
    if inner is not None and len(content) <= 2:
        inner_key, inner_moment = _stated_moment(inner) if moment is None else ("", None)
        moment_key, moment = (moment_key, moment) if inner_moment is None else (inner_key, inner_moment)
        content = {key: value for key, value in inner.items() if key != inner_key}
    log.add_message(topic, "", content, 0, moment, moment_key=moment_key)


def _stated_moment(members: Mapping[str, Any]) -> tuple[str, Any]:
    """The member of a message that states its time, and this, with the date of another member; "", None without.

    A text, or a number since 1970, goes before what counts from the start of a computer.
    """
    keys = [key for key, value in members.items() if type(value) in (int, float, str) and  # and no bool
            _TIME_NAME.search(key.lower())]  # fmt: skip
    if not keys:
        return "", None
    key = max(keys, key=lambda key: isinstance(members[key], str) or members[key] > _EARLIEST_EPOCH_S)
    date = next((value for name, value in members.items() if name.lower() == "date" and isinstance(value, str)), "")
    is_clock = isinstance(members[key], str) and _CLOCK.match(members[key])
    return key, f"{date} {members[key]}" if date and is_clock else members[key]


def _parse_payload(value: Any) -> Any:
    """A payload that is text, as MQTT's are: the number or the object that it spells, else the text."""
    if not isinstance(value, str):
        return value
    try:
        return json.loads(value)
    except ValueError:
        return value


def read_sqlite(path: str, cells: foreign_reader.CellBudget) -> dict[str, Any]:
    """The tables of an SQLite file; a table of names and values is a topic for each name."""
    import sqlite3
    from urllib.parse import quote

    log, contents = LogContent(cells), dict[str, dict[str, Any]]()
    with (
        _closed_database(Path(path), log) as database,
        closing(sqlite3.connect(f"file:{quote(str(database))}?mode=ro&immutable=1", uri=True)) as connection,
    ):
        _read_tables(connection, log, contents)
    for table, arrays in contents.items():
        _add_table(log, table, _with_names(table, arrays, contents))
    return log.as_dict()


def _read_tables(connection: Any, log: LogContent, contents: dict[str, dict[str, Any]]) -> None:
    """The columns of each table of a database."""
    for (table,) in connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'").fetchall():
        quoted = '"' + table.replace('"', '""') + '"'
        columns = [row[1] for row in connection.execute(f"PRAGMA table_info({quoted})")]
        (count,) = connection.execute(f"SELECT count(*) FROM {quoted}").fetchone()
        log.cells.count_cells(count * len(columns))
        if not count or table.startswith("sqlite_"):
            log.leave_out(table, "", count, "empty" if not count else "of SQLite itself")
            continue
        rows = connection.execute(f"SELECT * FROM {quoted}").fetchall()
        contents[table] = {name: _cell_array(None if isinstance(row[index], bytes) else row[index] for row in rows)
                           for index, name in enumerate(columns)}  # fmt: skip


def _with_names(table: str, arrays: dict[str, Any], contents: Mapping[str, dict[str, Any]]) -> dict[str, Any]:
    """A table with the names that another has for the numbers in its column, such as ``tag_id``: a historian's."""
    for column, numbers in arrays.items():
        stem = column.lower().removesuffix("id").rstrip("_")
        if not stem or stem == column.lower() or numbers.dtype.kind != "i":
            continue
        for name, members in contents.items():
            keys = [key for key in members if key.lower() in (column.lower(), "id")]
            names = [key for key in members if key.lower() in (*_TOPIC_KEYS, *_PATH_KEYS) and
                     members[key].dtype == object]  # fmt: skip
            is_list = name != table and keys and names and (keys[0].lower() != "id" or stem in name.lower())
            rows = {number: row for row, number in enumerate(members[keys[0]].tolist())} if is_list else {}
            if not set(numbers.tolist()) <= rows.keys():
                continue
            places = np.array([rows[number] for number in numbers.tolist()], dtype=int)
            units = {key: members[key][places] for key in members if key.lower() in ("unit", "units")}
            return {**arrays, **units, _TOPIC_KEYS[0]: members[names[0]][places]}
    return arrays


def _add_table(log: LogContent, table: str, arrays: dict[str, Any]) -> None:
    """Add a table as a topic, or one of names and values as a topic for each name."""
    lower = {name.lower(): name for name in arrays}
    key = next((lower[name] for name in _TOPIC_KEYS if name in lower and arrays[lower[name]].dtype == object), "")
    value = next((lower[name] for name in _VALUE_KEYS if name in lower), "")
    if not any(_TIME_NAME.search(name) for name in lower):
        log.leave_out(table, "", len(next(iter(arrays.values()))), "without times")
    elif key and value:
        for name in dict.fromkeys(arrays[key].tolist()):
            rows = arrays[key] == name
            part = {field: column[rows] for field, column in arrays.items() if field != key}
            unit = next((str(part[lower[name]][0]) for name in ("unit", "units") if name in lower), "")
            fields = {
                field: (_as_numbers_if_possible(column), unit if field == value else "", "")
                for field, column in part.items()
            }
            log.add_topic(str(name), "", fields)
    else:
        log.add_topic(table, "", {name: (column, "", "") for name, column in arrays.items()})


def _as_numbers_if_possible(column: Any) -> Any:
    """Cells of text that are all numbers, as numbers."""
    if column.dtype != object:
        return column
    try:
        return np.array([np.nan if cell is None else float(cell) for cell in column], dtype=float)
    except ValueError:
        return column


def unpacking(
    read: Callable[[str, foreign_reader.CellBudget], Any],
) -> Callable[[str, foreign_reader.CellBudget], Any]:
    """A reader that unpacks a compressed log first, within the limits of the process."""

    def read_unpacked(path: str, cells: foreign_reader.CellBudget) -> Any:
        opener = _OPENERS.get(Path(path).suffix.lower())
        if opener is None:
            return read(path, cells)
        with TemporaryDirectory() as folder:
            copy = Path(folder) / Path(path).stem
            with opener(path) as packed, copy.open("wb") as unpacked:
                shutil.copyfileobj(packed, unpacked, _BLOCK_BYTES)
            return read(str(copy), cells)

    return read_unpacked


READERS: dict[str, Callable[[str, foreign_reader.CellBudget], Any]] = {
    name: unpacking(read)
    for name, read in {
        "bags": read_bags,
        "ulog": read_ulog,
        "dataflash": read_dataflash,
        "mdf": read_mdf,
        "tdms": read_tdms,
        "hdf5": read_hdf5,
        "npz": read_npz,
        "json_lines": read_json_lines,
        "sqlite": read_sqlite,
    }.items()
}


if __name__ == "__main__":
    code = foreign_reader.main(READERS)
    sys.stderr.flush()
    os._exit(code)  # what libraries say of their half-open files at the end would be taken for the reason
