"""Log files of CAN frames, messages and sentences, told apart by what is in them, as fast as they are taken.

A log's time is UTC where it gives one; dates without a zone are this machine's local time in ASC and candump's
text (as their writers mean them) and UTC elsewhere. Times of day, and times since the log or a gateway began,
become UTC if the bus or a sentence tells it near the log's beginning; a time of day takes its date from the file's
last change if nobody does. Other times keep their distances, counted from the moment of opening, but bear no stamp.
What has no time has that of what came before it. A log without any goes by what the bus or a sentence tells; if
nobody does, it is received as fast as it is read.
"""

from __future__ import annotations

import datetime as dt
import logging
import os
import re
import struct
import zlib
from collections.abc import Callable, Generator, Iterable, Iterator
from functools import partial
from io import BytesIO
from itertools import chain, islice
from pathlib import Path
from typing import Any, BinaryIO

import can
from can.io import blf

from seatrial.acquisition.config.sections import FileSource
from seatrial.acquisition.core.budget import LOG_BYTES
from seatrial.acquisition.core.frames import HIGHEST_IDENTIFIER, Frame, iso, now_ns
from seatrial.acquisition.core.times import YEAR_LAST, Order, Stamp, date_order
from seatrial.acquisition.decoders.nmea0183 import has_sentence
from seatrial.acquisition.decoders.told_time import StatedTimes
from seatrial.acquisition.sources import SQLITE, LogReader, looks_like
from seatrial.acquisition.sources.bounded import BoundedLog, Lines
from seatrial.acquisition.sources.can_bus import flags_of
from seatrial.acquisition.sources.file_forms import FILE_FORMS, read_lines
from seatrial.acquisition.sources.line_forms import LINE_FORMS, LineReader, LogEntry
from seatrial.acquisition.sources.log_clock import EARLIEST_UTC_NS, LogClock, told_utc_ns

_LARGEST_CONTAINER_BYTES = 64 * 1024 * 1024  # those of Vector's tools hold 128 KiB, of others up to some MiB
_MOST_FRAMES_AT_ONCE = 300
_HEAD_BYTES = 65_536
_STEP_BACK_NS = 2 * 10**9  # lines of several gateways, and times in whole seconds, may come a second late
_HEAD_ENTRIES = 3_000  # which show what the log's times are: some seconds of a busy bus
_START_TIME = re.compile(rb"^;\s*Start time:\s*([^\r\n]{8,80})", re.MULTILINE)
_GZIP = b"\x1f\x8b"
UNDERSTOOD = (
    "candump, canboat, Yacht Devices, Actisense, iKonvert, SeaSmart, MXPGN, Garmin, Signal K, OpenCPN, pcap, BLF,"
    " ASC, TRC and sentences of NMEA 0183 with any time before them"
)
_LIBRARY_LOGGERS = tuple(logging.getLogger(f"can.io.{kind}") for kind in ("blf", "trc"))
Make = Callable[[Any], Iterable[can.Message]]
_LONGEST_OBJECT_BYTES = 1024 * 1024  # of BLF; a frame has some 100, a text that somebody typed 64 kB


class _Blf(can.BLFReader):  # type: ignore[misc]  # the library has no types
    """Python-can's, but that a container unpacks to no more than a multiple of what containers hold."""

    def __init__(self, file: BoundedLog) -> None:
        super().__init__(file)
        self._meter = file.meter

    def __iter__(self) -> Generator[can.Message, None, None]:
        head = blf.OBJ_HEADER_BASE_STRUCT
        while data := self.file.read(head.size):
            signature, _, _, size, kind = head.unpack(data)
            if signature != b"LOBJ" or size < head.size:
                raise blf.BLFParseError
            body = self.file.read(size - head.size)
            self.file.read(size % 4)
            if kind == blf.LOG_CONTAINER:
                plain = _container(body)
                self._meter.add(LOG_BYTES, len(plain))
                yield from self._parse_container(plain)
                if len(self._tail) > _LONGEST_OBJECT_BYTES:
                    raise ValueError("an object in it is longer than any")
        self.stop()


def _container(body: bytes) -> bytes:
    """What is in a container; empty for a compression that nobody uses."""
    (method, _), packed = blf.LOG_CONTAINER_STRUCT.unpack_from(body), body[blf.LOG_CONTAINER_STRUCT.size :]
    if method == blf.NO_COMPRESSION:
        return packed
    if method != blf.ZLIB_DEFLATE:
        blf.LOG.warning("Unknown compression method (%d)", method)
        return b""
    unpacking = zlib.decompressobj()
    plain = unpacking.decompress(packed, _LARGEST_CONTAINER_BYTES)
    if unpacking.unconsumed_tail:
        raise ValueError(f"a container in it unpacks to more than {_LARGEST_CONTAINER_BYTES:,} bytes")
    return plain


_BLF: Make = _Blf


class LogFile(LogReader):
    """One log; ``unreadable`` counts its lines and records that held nothing."""

    def __init__(self, config: FileSource) -> None:
        super().__init__(config)
        self._log: _Log | None = None
        self._entries: Iterator[LogEntry] = iter(())
        self._clock = LogClock((), 0)
        self._opened_ns = self._last_ns = self._count = 0
        self._newest_ns: int | None = None  # as the log tells it
        self._only_bus = ""  # the bus of all frames in the log's beginning, which needs no name
        self._date_remark = ""
        self._clock_ns = 0  # of the entry before, as the log tells it
        self._back_at_ns: int | None = None  # where its times go back first, and by how much
        self._back_ns = 0
        self.timed = True  # whether the last frame had a time, of whatever kind

    @property
    def unreadable(self) -> int:
        return 0 if self._log is None else self._log.unreadable

    @property
    def damage(self) -> str:
        """What is broken in the log and where its reading ended; empty for a log that was read to its end."""
        if self._log is None or not self._log.damage:
            return ""
        where, newest_ns = f"reading ended after {self._count:,} frames", self._newest_ns
        if newest_ns is not None:
            utc = newest_ns >= EARLIEST_UTC_NS
            where += f", the last of {iso(newest_ns) if utc else f'{newest_ns / 1e9:.3f} s after its beginning'}"
        return f"the log is damaged ({self._log.damage}); {where}"

    @property
    def remark(self) -> str:
        remarks = [self._date_remark or self._clock.remark]
        if self._back_at_ns is not None:
            at = iso(self._back_at_ns) if self._back_at_ns >= EARLIEST_UTC_NS else f"{self._back_at_ns / 1e9:.3f} s"
            remarks.append(f"its times go back by {self._back_ns / 1e9:,.3f} s at {at}: its clock was set")
        return "; ".join(filter(None, remarks))

    def _begin(self, file: BinaryIO) -> None:
        head = file.read(_HEAD_BYTES)
        if packed := head.startswith(_GZIP):
            head = _inflated(head)
        if head.startswith(SQLITE):  # sentences in it would be found, without their topics and times
            raise ValueError(f"it looks like {looks_like(head)}")
        path: Path = self._config.path
        make = _maker(head, self._config.form, partial(BoundedLog, path, packed=packed))
        log = self._log = make(StatedTimes(self._config.date_order))
        entries = iter(log)
        beginning, stated = _beginning(entries, log.times)
        is_sound = partial(_is_sound, unchecked=self._config.checksum == "optional")
        if head and not any(map(is_sound, chain(beginning, entries))):
            why = log.damage or f"it looks like {looks_like(head)}"
            raise ValueError(f"nothing in it can be recorded: {why}; supported are {UNDERSTOOD}")
        log.close()
        tail = _last_bytes(file) if log.times.stamps and not packed else b""
        changed_ns = path.stat().st_mtime_ns
        times, self._date_remark = _settled(log.times, stated, tail, self._config.date_order, changed_ns)
        if times.order != log.times.order or times.year is not None:
            log = make(times)
            beginning, _ = _beginning(iter(log), times)
            log.close()
        self._clock = LogClock(beginning, changed_ns)
        buses = {entry.bus for entry in beginning if entry.bus}
        self._only_bus = buses.pop() if len(buses) == 1 else ""
        self._log = make(times)
        self._entries = iter(self._log)
        self._opened_ns, self._last_ns, self._count, self._newest_ns = now_ns()[0], 0, 0, None

    def _next(self, file: BinaryIO) -> list[Frame] | None:
        return [self._frame(entry) for entry in islice(self._entries, _MOST_FRAMES_AT_ONCE)] or None

    def close(self) -> None:
        self._entries = iter(())
        if self._log is not None:
            self._log.close()
        super().close()

    def _frame(self, entry: LogEntry) -> Frame:
        time_ns = self._clock.time_ns(entry)
        if time_ns is not None:
            if self._clock_ns - time_ns >= _STEP_BACK_NS:
                self._note_step_back(time_ns)
            self._clock_ns = time_ns
        if time_ns is not None and self._newest_ns is not None and entry.protocol == "nmea0183":
            time_ns = max(time_ns, self._newest_ns)  # sentences come late, not early
        self._count, self._newest_ns, self.timed = self._count + 1, time_ns, time_ns is not None
        bus = "" if entry.bus == self._only_bus else entry.bus
        stamped_ns = None
        if time_ns is None:
            received_ns, monotonic_ns = now_ns()
        elif time_ns >= EARLIEST_UTC_NS:
            stamped_ns = received_ns = monotonic_ns = time_ns
        else:
            received_ns = monotonic_ns = self._opened_ns + time_ns
        self._last_ns = max(self._last_ns, monotonic_ns)
        details = received_ns, self._last_ns, entry.identifier, entry.flags, stamped_ns, bus
        return Frame(self.name, entry.protocol, entry.payload, *details)

    def _note_step_back(self, time_ns: int) -> None:
        """Note the first step back of the log's clock; whether one forward is a gap nobody can tell."""
        if self._back_at_ns is None:
            self._back_at_ns, self._back_ns = time_ns, self._clock_ns - time_ns


def _inflated(beginning: bytes) -> bytes:
    try:
        return zlib.decompressobj(wbits=31).decompress(beginning, _HEAD_BYTES)
    except zlib.error as error:
        raise ValueError(f"it cannot be unpacked: {error}") from error


class _Log:
    """A log by a function that reads it; what is broken where it ends before its time is its ``damage``."""

    def __init__(
        self,
        read: Callable[[BinaryIO, LineReader], Iterator[LogEntry]],
        file: BinaryIO,
        form: str,
        times: StatedTimes,
    ) -> None:
        self.times = times
        self._reader = LineReader(form, times)
        self._entries = read(file, self._reader)
        self.damage = ""
        self.close = file.close

    @property
    def unreadable(self) -> int:
        return self._reader.unreadable

    def __iter__(self) -> Iterator[LogEntry]:
        try:
            yield from self._entries
        except (ValueError, EOFError, zlib.error, struct.error) as error:
            self.damage = str(error)


def _beginning(entries: Iterator[LogEntry], times: StatedTimes) -> tuple[list[LogEntry], list[tuple[Stamp, int]]]:
    """A log's first entries, and the dates beside those that state the UTC themselves."""
    beginning, stated = list[LogEntry](), list[tuple[Stamp, int]]()
    for entry in islice(entries, _HEAD_ENTRIES):
        beginning.append(entry)
        if times.last is not None and (utc_ns := told_utc_ns(entry)) is not None:
            stated.append((times.last, utc_ns))
    return beginning, stated


def _last_bytes(file: BinaryIO) -> bytes:
    size = file.seek(0, os.SEEK_END)
    file.seek(max(size - _HEAD_BYTES, 0))
    return file.read(_HEAD_BYTES)


def _settled(
    times: StatedTimes, stated: list[tuple[Stamp, int]], tail: bytes, configured: Order | None, changed_ns: int
) -> tuple[StatedTimes, str]:
    """The reader of the dates of a log whose beginning and end were read, and a remark on what is not stated."""
    ending = StatedTimes()
    for _ in read_lines(BytesIO(tail), LineReader(times=ending)):
        pass
    stamps = [*times.stamps, *ending.stamps]
    order, why = (configured, "as configured") if configured else date_order(stamps, stated)
    year, remark = None, times.remark
    first = next(iter(times.stamps), None)
    if first is not None and not first.has_year:
        year = (dt.datetime.fromtimestamp(changed_ns / 1e9, dt.UTC)).year
        remark = f"its dates, like {first.text!r}, have no year; that of the file's last change, {year}, is taken"
        if stated:
            year = dt.datetime.fromtimestamp(stated[0][1] / 1e9, dt.UTC).year
            remark = f"its dates, like {first.text!r}, have no year; {year} is that of a sentence in it"
    elif first is not None and why == YEAR_LAST:
        remark = (
            f"its dates, like {first.text!r}, are read {order}, as {why};"
            ' say date_order = "year-first" in [[source]] if they are not'
        )
    elif first is not None and not why:
        remark = (
            f"its dates, like {first.text!r}, may have the day or the month first: {order} is taken;"
            f' say date_order = "day-first" or "month-first" in [[source]]'
        )
    elif times.unread_date:
        remark = f"the date in {times.unread_date!r} could not be read; that of the file's last change is taken"
    elif times.unknown_zone:
        remark = f"the zone {times.unknown_zone} stands for several: its times are taken for UTC"
    return StatedTimes(order, year), remark


def _maker(head: bytes, form: str, open_file: Callable[[], BinaryIO]) -> Callable[[StatedTimes], _Log]:
    """What begins to read a log: by its form or, where none is named, by its first bytes."""
    read = FILE_FORMS[form].read if form in FILE_FORMS else None
    if not form:
        read = next((file_form.read for file_form in FILE_FORMS.values() if file_form.begins(head)), None)
    library = _library_form(head)
    is_text = form in LINE_FORMS or any(map(_is_sound, read_lines(BytesIO(head), LineReader())))
    if read is None and library is not None and not is_text:
        read = partial(_library_log, library)
    return lambda times: _Log(read or read_lines, open_file(), form, times)


def _is_sound(entry: LogEntry, *, unchecked: bool = False) -> bool:
    """Whether it is a frame, a message, or a line with an intact sentence."""
    return entry.protocol == "can" or has_sentence(entry.payload, unchecked=unchecked)


def _library_log(make: Make, file: BinaryIO, reader: LineReader) -> Iterator[LogEntry]:
    """The entries of a log by one of python-can's readers. Raises :class:`ValueError` for a broken beginning."""
    size_bytes = file.seek(0, os.SEEK_END) if make is _BLF else 0  # 0 for text
    file.seek(0)
    try:
        began_ns = 0 if size_bytes else _stated_start_ns(file, reader.times)
        return _library_entries(make(file), file, size_bytes, reader, began_ns)
    except Exception as error:  # the library promises no set of errors for a broken log
        file.close()
        raise ValueError(f"its beginning is broken: {error}") from error


def _library_entries(
    messages: Iterable[can.Message], file: BinaryIO, size_bytes: int, reader: LineReader, began_ns: int
) -> Iterator[LogEntry]:
    """What python-can trips over ends the log; what it passes over it tells its logger only: that is counted."""

    def count(record: logging.LogRecord) -> bool:
        reader.unreadable += 1
        return False

    cut, first = False, 0 if isinstance(messages, can.TRCReader) else 1  # python-can counts BLF's channels from 0
    for logger in _LIBRARY_LOGGERS:
        logger.addFilter(count)
    try:
        for message in messages:
            cut = not size_bytes and _is_cut(message)
            if message.arbitration_id <= HIGHEST_IDENTIFIER and not cut:
                time_ns = began_ns + round(message.timestamp * 1e6) * 1000  # no finer than a float of today holds
                bus = "" if message.channel is None else f"channel{int(message.channel) + first}"
                yield LogEntry(time_ns, bytes(message.data), message.arbitration_id, flags_of(message), bus=bus)
            else:
                reader.unreadable += 1
    except OSError:
        raise
    except Exception as error:
        reason = f"{type(error).__name__}: {error}".rstrip(": ")
        raise ValueError(_lost_end(messages, size_bytes) or reason) from error
    finally:
        file.close()
        for logger in _LIBRARY_LOGGERS:
            logger.removeFilter(count)
    if damage := _lost_end(messages, size_bytes) or ("its last line is cut off" if cut else ""):
        raise ValueError(damage)


def _stated_start_ns(file: BinaryIO, times: StatedTimes) -> int:
    """When a TRC log began [ns since 1970], by its comments where it has no line for that; 0 where it has."""
    head = file.read(_HEAD_BYTES)
    file.seek(0)
    match = None if b"$STARTTIME" in head else _START_TIME.search(head)
    stated = None if match is None else times.read(match[1].decode("latin-1"))
    return 0 if stated is None or stated[1] else stated[0] or 0


def _lost_end(blf: Any, size_bytes: int) -> str:
    """What is missing at the end of a BLF log, as far as it can tell."""
    once_bytes = getattr(blf, "file_size", 0)
    if once_bytes > size_bytes:
        return f"it was {once_bytes:,} bytes long, {size_bytes:,} are left"
    return "its last object is cut off" if bytes(getattr(blf, "_tail", b"")).strip(b"\0") else ""


def _is_cut(message: can.Message) -> bool:
    """Whether bytes are missing: the library fills nothing up where a line of ASC ends before its data."""
    length = min(message.dlc, 64 if message.is_fd else 8)
    return not (message.is_remote_frame or message.is_error_frame) and len(message.data) < length


def _library_form(head: bytes) -> Make | None:
    """What reads a log, by its first bytes; None for what python-can does not read."""
    first = next((line for line in head.decode("latin-1").lower().splitlines() if line.strip()), "").strip()
    if head.startswith(b"LOGG"):
        return _BLF
    if first.startswith(";"):
        return lambda file: can.TRCReader(_text(file))
    return None


def _text(file: BinaryIO) -> Lines:
    return Lines(file, encoding="utf-8", errors="replace")
