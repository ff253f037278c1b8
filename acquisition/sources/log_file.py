"""Reads log files of CAN frames, messages, sentences and MAVLink, by their content, as fast as they are taken.

A log's time is UTC where it gives one; dates without a zone are this machine's local time in ASC and candump's text
(as their writers mean them) and UTC elsewhere. Times of day, and times since the log or a gateway began, become UTC
if the bus or a sentence states it near the log's beginning; a time of day otherwise takes its date from the file's
last change. Other times keep their distances, counted from the moment of opening, but bear no stamp. What has no
time has that of what came before it. A log without any goes by what the bus or a sentence states; if neither does,
it is received as fast as it is read.

A telemetry log (.tlog) has 8 bytes of time before each MAVLink packet. Damage costs no more than itself: what is no
entry becomes a frame of its own, for the decoder to count, and the log goes on at the next possible time with a
packet after it. A ground station or companion computer whose clock was not set writes times from 1970 or 2000 on.
Their distances are right; the date is taken from where the log itself states it, or from the file, with a remark.
"""

from __future__ import annotations

import datetime as dt
import logging
import os
import re
import struct
import zlib
from collections import Counter
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import suppress
from functools import partial
from io import BytesIO
from itertools import chain, islice, pairwise
from pathlib import Path
from statistics import median_low
from typing import Any, BinaryIO

import can
from can.io import blf

from seatrial.acquisition import sources
from seatrial.acquisition.config.sources import FileSource
from seatrial.acquisition.core import process, trial
from seatrial.acquisition.core.times import DAY_NS, YEAR_LAST, Order, Stamp, infer_date_order
from seatrial.acquisition.protocols import clock, mavlink, nmea0183, nmea2000
from seatrial.acquisition.sources.lines import frame_flags
from seatrial.acquisition.sources.log_formats import FILE_FORMS, LINE_FORMS, LineReader, LogEntry, read_lines

_LARGEST_CONTAINER_BYTES = 64 * 1024 * 1024  # those of Vector's tools hold 128 KiB, of others up to some MiB
_MOST_FRAMES_AT_ONCE = 300
_HEAD_BYTES = 65_536
_STEP_BACK_NS = 2 * 10**9  # lines of several gateways, and times in whole seconds, may come a second late
_QUARTER_NS = 900 * trial.NANO
_HEAD_ENTRIES = 3_000  # which show what the log's times are: some seconds of a busy bus
_START_TIME = re.compile(rb"^;\s*Start time:\s*([^\r\n]{8,80})", re.MULTILINE)
_WITHOUT_ZONE = (
    "its start names no zone and is taken for UTC; where it was written in local time, as some programs do, the"
    " recording is off by that zone"
)
_OF_THIS_ZONE = "its dates name no zone and are taken for this machine's local time, as their writers mean them"
_CANDUMP_DATE = re.compile(rb"^\s*\(\d{4}-\d\d-\d\d \d\d:\d\d:\d\d(?:\.\d+)?\)", re.MULTILINE)
_MDF_FRAMES, _MDF_TIMES = 0x2, (2, 3)  # ASAM MDF 4.1: cg_flags, frames of a bus; cn_type, (virtual) masters
_MOST_SIGNALS = 10
_GZIP, _MDF = b"\x1f\x8b", (b"MDF ", b"UnFinMF ")
UNDERSTOOD = (
    "candump, SavvyCAN, python-can, canboat, Yacht Devices, Actisense, iKonvert, SeaSmart, MXPGN, Garmin, Signal K,"
    " OpenCPN, pcap, BLF, ASC, TRC, MF4 and sentences of NMEA 0183 with any time before them"
)
_BLF_LOGGER = logging.getLogger("can.io.blf")
_TRC_EVENT = re.compile(r"\d+\)?\s+\S+\s+(?:(?:ST|EC|EV)\b|(?:\d+\s+)?(?:Warng\b|FFFFFFFF\b))")
_TRC_VERSION = re.compile(rb"^;\$FILEVERSION=\s*(\S+)", re.MULTILINE)
_TRC_VERSIONS = b"1.0", b"1.1", b"1.3", b"2.0", b"2.1"  # that python-can reads
_TRC_ERROR = re.compile(r"\d+\)?\s+\S+\s+(?:ER\b|(?:\d+\s+)?Error\b)")
"""What a bus did and what a user marked, and frames that were broken on it, in TRC of any version."""
_LONGEST_OBJECT_BYTES = 1024 * 1024  # of BLF; a frame has some 100, a typed text 64 kB

EARLIEST_UTC_NS = 1_000_000_000 * trial.NANO
"""Times before are since the log began."""
_LATEST_NS = 4_102_444_800 * trial.NANO  # 2100; what is later is broken
_SLACK_NS = trial.NANO  # by so much a clock may go back without having wrapped around
_STUCK_ENTRIES = 100  # entries at one and the same time: the gateway's clock stands still
_LONGEST_BURST_NS = 10 * trial.NANO  # between the sentences that state a date
_AGREED_NS = 2 * trial.NANO  # the bus tells whole seconds, late
_TIME_READERS, _DAY_TIME_READERS = (
    {kind: read for kind, read in nmea0183.motion_readers("ground").items() if kind in kinds}
    for kinds in (("ZDA", "RMC"), ("GGA", "GNS", "GLL"))
)

_TIME_BYTES = 8
_MICRO_NS = 1000
_BLOCK_BYTES = 4096  # some 100 entries, at most 256
_LONGEST_DAMAGE_BYTES = 65_536  # in one frame; within it no packet is cut in two
_LOOK_AHEAD_BYTES = 2 * (_TIME_BYTES + mavlink.LONGEST_BYTES) + 1  # an entry, and one that may begin inside it
# A clock may be set during a log, but then all that follows is on the new time; one time far from both its
# neighbours is damaged.
_JUMP_NS = 60 * trial.NANO
_MOST_STEPS = 10_000
# Microseconds of a time before 2100, then a packet's first byte.
_MAY_BE_ENTRY = re.compile(rb"(?=\x00[\x00-\x0e].{6}[\xfd\xfe])", re.DOTALL)
_SYSTEM_TIME = 2  # the message whose first eight bytes are the microseconds since 1970


class _Blf(can.BLFReader):  # type: ignore[misc]  # the library has no types
    """Python-can's, but that a container unpacks to no more than a multiple of what containers hold."""

    def __init__(self, file: Any) -> None:  # a BoundedLog
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
            if kind != blf.LOG_CONTAINER:
                continue
            (method, _), plain = blf.LOG_CONTAINER_STRUCT.unpack_from(body), body[blf.LOG_CONTAINER_STRUCT.size :]
            if method == blf.ZLIB_DEFLATE:
                unpacking = zlib.decompressobj()
                plain = unpacking.decompress(plain, _LARGEST_CONTAINER_BYTES)
                if unpacking.unconsumed_tail:
                    raise ValueError(f"a container in it unpacks to more than {_LARGEST_CONTAINER_BYTES:,} bytes")
            elif method != blf.NO_COMPRESSION:
                blf.LOG.warning("Unknown compression method (%d)", method)
                plain = b""
            self._meter.add(process.LOG_BYTES, len(plain))
            yield from self._parse_container(plain)
            if len(self._tail) > _LONGEST_OBJECT_BYTES:
                raise ValueError("an object in it is longer than any")
        self.stop()


class _Trc(can.TRCReader):  # type: ignore[misc]
    """Python-can's, but that it counts the lines that it cannot read and goes on, and has the error frames, too."""

    def __init__(self, file: Any, reader: LineReader) -> None:
        super().__init__(file)
        self._reader, self.is_cut, self._count = reader, False, 0

    def _parse_line(self, line: str) -> can.Message | None:
        columns, message = tuple(line.split(maxsplit=self._num_columns)), None
        with suppress(ValueError, IndexError):
            if _TRC_ERROR.match(line):
                time_s = float(columns[self.columns.get("O", 1)]) / 1000.0 + (self._start_time or 0.0)
                return can.Message(time_s, is_error_frame=True, is_extended_id=False)
            message = self._parse_cols(columns)
        is_skipped = message is None and _TRC_EVENT.match(line) is None
        self._reader.unreadable += is_skipped
        self._count += message is not None
        self.is_cut = is_skipped and self._count > 0
        return message


class LogFile(sources.LogReader):
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
        return 0 if self._log is None else self._log.reader.unreadable

    @property
    def damage(self) -> str:
        """What is broken in the log and where its reading ended; empty for a log that was read to its end."""
        if self._log is None or not self._log.damage:
            return ""
        end, newest_ns = f"reading ended after {self._count:,} frames", self._newest_ns
        if newest_ns is not None:
            after_start = f"{newest_ns / 1e9:.3f} s after its beginning"
            end += f", the last of {trial.iso_utc(newest_ns) if newest_ns >= EARLIEST_UTC_NS else after_start}"
        return f"the log is damaged ({self._log.damage}); {end}"

    @property
    def remark(self) -> str:
        remarks = [self._date_remark or self._clock.remark, self._log.reader.remark if self._log else ""]
        if self._back_at_ns is not None:
            at = (
                trial.iso_utc(self._back_at_ns)
                if self._back_at_ns >= EARLIEST_UTC_NS
                else f"{self._back_at_ns / 1e9:.3f} s"
            )
            remarks.append(f"its times go back by {self._back_ns / 1e9:,.3f} s at {at}: its clock was set")
        return "; ".join(filter(None, remarks))

    def _read_beginning(self, file: BinaryIO) -> None:
        head = file.read(_HEAD_BYTES)
        if is_packed := head.startswith(_GZIP):
            try:
                head = zlib.decompressobj(wbits=31).decompress(head, _HEAD_BYTES)
            except zlib.error as error:
                raise ValueError(f"it cannot be unpacked: {error}") from error
        name = sources.name_of_imported_log(head)
        if name and not head.startswith(_MDF):  # sentences in it would be found, without their topics and times
            raise self._import_error(name)
        if head.startswith(sources.SQLITE):  # as well
            raise ValueError(f"it looks like {sources.describe_file_start(head)}")
        path: Path = self._config.path
        open_log = _choose_reader(head, self._config.form, partial(sources.BoundedLog, path, packed=is_packed))
        log = self._log = open_log(clock.StatedTimes(self._config.date_order))
        entries = iter(log)
        beginning, stated = _read_head(entries, log.times)
        is_sound = partial(_is_recordable, unchecked=self._config.checksum == "optional")
        if head and not any(map(is_sound, chain(beginning, entries))):
            if name and not log.damage:  # a measurement without frames
                raise self._import_error(name)
            reason = log.damage or f"it looks like {sources.describe_file_start(head)}"
            raise ValueError(f"nothing in it can be recorded: {reason}; supported are {UNDERSTOOD}")
        log.close()
        tail = b""
        if log.times.stamps and not is_packed:
            file.seek(max(file.seek(0, os.SEEK_END) - _HEAD_BYTES, 0))
            tail = file.read(_HEAD_BYTES)
        changed_ns = path.stat().st_mtime_ns
        has_local_lines = _CANDUMP_DATE.search(head) is not None
        log.times.is_of_this_zone |= has_local_lines
        is_local = log.times.is_of_this_zone
        times, self._date_remark = _infer_date_order(log.times, stated, tail, self._config.date_order, changed_ns)
        if times.order != log.times.order or times.year is not None:
            log = open_log(times)
            beginning, _ = _read_head(iter(log), times)
            log.close()
        self._clock = LogClock(beginning, changed_ns)
        if is_local:  # of every line, or of the beginning alone
            local = _LocalTimes()
            whole = open_log(times)
            open_hour = local.settle_first_hour(whole if has_local_lines else beginning[:1])
            whole.close()
            self._clock.local = local if has_local_lines else None
            self._date_remark = "; ".join(filter(None, (self._date_remark, open_hour)))
        buses = {entry.bus for entry in beginning if entry.bus}
        self._only_bus = buses.pop() if len(buses) == 1 else ""
        self._log = open_log(times)
        self._entries = iter(self._log)
        self._opened_ns, self._last_ns, self._count, self._newest_ns = trial.wall_and_monotonic_ns()[0], 0, 0, None

    def _next_frames(self, file: BinaryIO) -> list[trial.Frame] | None:
        return [self._frame(entry) for entry in islice(self._entries, _MOST_FRAMES_AT_ONCE)] or None

    def close(self) -> None:
        self._entries = iter(())
        if self._log is not None:
            self._log.close()
        super().close()

    def _frame(self, entry: LogEntry) -> trial.Frame:
        time_ns = self._clock.time_ns(entry)
        if time_ns is not None:
            # the first step back is noted; one forward may be a gap
            if self._clock_ns - time_ns >= _STEP_BACK_NS and self._back_at_ns is None:
                self._back_at_ns, self._back_ns = time_ns, self._clock_ns - time_ns
            self._clock_ns = time_ns
        if time_ns is not None and self._newest_ns is not None and entry.protocol == "nmea0183":
            time_ns = max(time_ns, self._newest_ns)  # sentences are delayed, never advanced
        self._count, self._newest_ns, self.timed = self._count + 1, time_ns, time_ns is not None
        bus = "" if entry.bus == self._only_bus else entry.bus
        stamped_ns = None
        if time_ns is None:
            received_ns, monotonic_ns = trial.wall_and_monotonic_ns()
        elif time_ns >= EARLIEST_UTC_NS:
            stamped_ns = received_ns = monotonic_ns = time_ns
        else:
            received_ns = monotonic_ns = self._opened_ns + time_ns
        self._last_ns = max(self._last_ns, monotonic_ns)
        details = received_ns, self._last_ns, entry.identifier, entry.flags, stamped_ns, bus
        return trial.Frame(self.name, entry.protocol, entry.payload, *details)


class _Log:
    """A log by a function that reads it; what is broken where it ends before its time is its ``damage``."""

    def __init__(
        self,
        read: Callable[[BinaryIO, LineReader], Iterator[LogEntry]],
        file: BinaryIO,
        form: str,
        times: clock.StatedTimes,
    ) -> None:
        self.times = times
        self.reader = LineReader(form, times)
        self._entries = read(file, self.reader)
        self.damage = ""
        self.close = file.close

    def __iter__(self) -> Iterator[LogEntry]:
        try:
            yield from self._entries
        except (ValueError, EOFError, zlib.error, struct.error) as error:
            self.damage = str(error)


def _read_head(
    entries: Iterator[LogEntry], times: clock.StatedTimes
) -> tuple[list[LogEntry], list[tuple[Stamp, int]]]:
    """A log's first entries, and the dates of those that state the UTC themselves."""
    beginning, stated = list[LogEntry](), list[tuple[Stamp, int]]()
    for entry in islice(entries, _HEAD_ENTRIES):
        beginning.append(entry)
        if times.last is not None and (utc_ns := utc_ns_stated_by_entry(entry)) is not None:
            stated.append((times.last, utc_ns))
    return beginning, stated


def _infer_date_order(
    times: clock.StatedTimes,
    stated: list[tuple[Stamp, int]],
    tail: bytes,
    configured: Order | None,
    changed_ns: int,
) -> tuple[clock.StatedTimes, str]:
    """How the dates of a log are read, by those in its beginning and end, and a remark on what they leave open."""
    ending = clock.StatedTimes()
    for _ in read_lines(BytesIO(tail), LineReader(times=ending)):
        pass
    stamps = [*times.stamps, *ending.stamps]
    order, basis = (configured, "as configured") if configured else infer_date_order(stamps, stated)
    year, remark = None, ""
    stamp = next(iter(times.stamps), None)
    if stamp is not None and not stamp.has_year:
        year = (dt.datetime.fromtimestamp(changed_ns / 1e9, dt.UTC)).year
        remark = f"its dates, like {stamp.text!r}, have no year; that of the file's last change, {year}, is taken"
        if stated:
            year = dt.datetime.fromtimestamp(stated[0][1] / 1e9, dt.UTC).year
            remark = f"its dates, like {stamp.text!r}, have no year; {year} is that of a sentence in it"
    elif stamp is not None and basis == YEAR_LAST:
        remark = (
            f"its dates, like {stamp.text!r}, are read {order}, as {basis};"
            ' say date_order = "year-first" in [[source]] if they are not'
        )
    elif stamp is not None and not basis:
        remark = (
            f"its dates, like {stamp.text!r}, may have the day or the month first: {order} is taken;"
            f' say date_order = "day-first" or "month-first" in [[source]]'
        )
    elif times.unread_date:
        remark = f"the date in {times.unread_date!r} could not be read; that of the file's last change is taken"
    elif times.unknown_zone:
        remark = f"the zone {times.unknown_zone} stands for several: its times are taken for UTC"
    elif times.is_of_this_zone and (stamp is None or stamp.offset_s is None):
        remark = _OF_THIS_ZONE
    elif stamp is not None and stamp.offset_s is None and not stated:
        remark = f"its times, like {stamp.text!r}, name no zone and are taken for UTC; local ones are off by theirs"
    return clock.StatedTimes(order, year), "; ".join(filter(None, (times.remark, remark)))


def _choose_reader(
    head: bytes, form: str, open_file: Callable[[], BinaryIO]
) -> Callable[[clock.StatedTimes], _Log]:
    """What opens a log to be read: by its form or, where none is named, by its first bytes."""
    read = FILE_FORMS[form].read if form in FILE_FORMS else None
    if not form:
        read = next((file_form.read for file_form in FILE_FORMS.values() if file_form.begins(head)), None)
    kind = "blf" if head.startswith(b"LOGG") else "mf4" if head.startswith(_MDF) else ""
    lines = head.decode("latin-1").splitlines()
    if not kind and next((line for line in lines if line.strip()), "").lstrip().startswith(";"):
        kind = "trc"
    is_text = form in LINE_FORMS or any(map(_is_recordable, read_lines(BytesIO(head), LineReader())))
    if read is None and kind and not is_text:
        read = partial(_read_with_python_can, kind)
    return lambda times: _Log(read or read_lines, open_file(), form, times)


def _is_recordable(entry: LogEntry, *, unchecked: bool = False) -> bool:
    """Whether it is a frame, a message, or a line with an intact sentence."""
    return entry.protocol == "can" or nmea0183.has_sentence(entry.payload, unchecked=unchecked)


def _read_with_python_can(kind: str, file: BinaryIO, reader: LineReader) -> Iterator[LogEntry]:
    """The entries of a log, BLF, TRC or MF4, by python-can. Raises :class:`ValueError` for a broken beginning."""
    size_bytes = 0 if kind == "trc" else file.seek(0, os.SEEK_END)  # 0 for text
    file.seek(0)
    head = b"" if size_bytes else file.read(_HEAD_BYTES)
    file.seek(0)
    if (version := _TRC_VERSION.search(head)) and version[1] not in _TRC_VERSIONS:
        file.close()
        raise ValueError(f"TRC of version {version[1].decode('latin-1')} is not read; save it as 2.1")
    try:
        if kind == "mf4":
            measurement = process.import_mf4_with_asammdf().MF4Reader(file)
            reader.remark = _signals_remark(measurement._mdf.groups)
            reader.times.remark = "" if measurement._mdf.start_time.tzinfo else _OF_THIS_ZONE
            return _python_can_entries(measurement, file, size_bytes, reader, 0)
        began_ns, has_start = 0, kind == "blf"
        if not size_bytes:  # of a TRC log without a line for its start the comments state it
            match = None if b"$STARTTIME" in head else _START_TIME.search(head)
            stated = None if match is None else reader.times.read_time_prefix(match[1].decode("latin-1"))
            began_ns = 0 if stated is None or stated[1] else stated[0] or 0
            has_start = b"$STARTTIME" in head or began_ns > 0
        messages = (
            _Blf(file) if kind == "blf" else _Trc(sources.Lines(file, encoding="utf-8", errors="replace"), reader)
        )
        reader.times.remark = _WITHOUT_ZONE if has_start else ""
        return _python_can_entries(messages, file, size_bytes, reader, began_ns)
    except NotImplementedError as error:
        file.close()
        raise ValueError("frames of a bus in an MDF measurement need pip install 'seatrial[mf4]'") from error
    except Exception as error:  # the library promises no set of errors for a broken log
        file.close()
        raise ValueError(f"its beginning is broken: {error}") from error


def _signals_remark(groups: Sequence[Any]) -> str:
    """What is said of the signals of a measurement, by the groups of its library: only its frames are read."""
    names = [
        channel.name
        for group in groups
        if group.channel_group.cycles_nr and not group.channel_group.flags & _MDF_FRAMES
        for channel in group.channels
        if channel.channel_type not in _MDF_TIMES
    ]
    if not names:
        return ""
    further = f" and {len(names) - _MOST_SIGNALS:,} more" if len(names) > _MOST_SIGNALS else ""
    signals = "signal beside its frames is" if len(names) == 1 else "signals beside its frames are"
    return (
        f"{len(names):,} {signals} not read: {', '.join(names[:_MOST_SIGNALS])}{further}; bring them into a"
        " recording of their own by `seatrial import`, or as a topic_file"
    )


def _python_can_entries(
    messages: Iterable[can.Message], file: BinaryIO, size_bytes: int, reader: LineReader, began_ns: int
) -> Iterator[LogEntry]:
    """What python-can fails at ends the log; what it skips it reports to its logger only, where it is counted."""

    def count(record: logging.LogRecord) -> bool:
        reader.unreadable += 1
        return False

    is_cut = False
    first_channel = 1 if isinstance(messages, can.BLFReader) else 0  # python-can counts its channels from 0
    _BLF_LOGGER.addFilter(count)
    try:
        for message in messages:
            length = 0 if size_bytes or message.is_remote_frame or message.is_error_frame else message.dlc
            is_cut = len(message.data) < min(length, 64 if message.is_fd else 8)  # the library fills up no line
            if message.arbitration_id <= trial.HIGHEST_IDENTIFIER and not is_cut:
                time_ns = began_ns + round(message.timestamp * 1e6) * 1000  # no finer than a float of today holds
                bus = "" if message.channel is None else f"channel{int(message.channel) + first_channel}"
                yield LogEntry(time_ns, bytes(message.data), message.arbitration_id, frame_flags(message), bus=bus)
            else:
                reader.unreadable += 1
    except OSError:
        raise
    except Exception as error:
        reason = f"{type(error).__name__}: {error}".rstrip(": ")
        raise ValueError(_missing_end_text(messages, size_bytes) or reason) from error
    finally:
        file.close()
        _BLF_LOGGER.removeFilter(count)
    is_cut |= isinstance(messages, _Trc) and messages.is_cut
    if damage := _missing_end_text(messages, size_bytes) or ("its last line is cut off" if is_cut else ""):
        raise ValueError(damage)


def _missing_end_text(blf: Any, size_bytes: int) -> str:
    """What is missing at the end of a BLF log, as far as it can tell."""
    once_bytes = getattr(blf, "file_size", 0)
    if once_bytes > size_bytes:
        return f"it was {once_bytes:,} bytes long, {size_bytes:,} are left"
    return "its last object is cut off" if bytes(getattr(blf, "_tail", b"")).strip(b"\0") else ""


class _LocalTimes:
    """Local times as UTC: those of the hour that comes twice, at the end of summer time, by the order of lines.

    Times come as if they were of the first of the two hours.
    """

    def __init__(self) -> None:
        self._last_ns = 0
        self._repeats_ns: dict[int, int] = {}  # by the quarter of an hour: nothing else begins or ends summer time

    def _repeats_after_ns(self, time_ns: int) -> int:
        """After how long clocks show the same time again [ns]; 0 for all times but those of that hour."""
        quarter = time_ns // _QUARTER_NS
        if quarter not in self._repeats_ns:
            seconds = quarter * _QUARTER_NS // trial.NANO
            local = dt.datetime.fromtimestamp(seconds, dt.UTC).astimezone().replace(tzinfo=None, fold=1)
            self._repeats_ns[quarter] = round(local.astimezone().timestamp() - seconds) * trial.NANO
        return self._repeats_ns[quarter]

    def utc_ns(self, time_ns: int) -> int:
        if time_ns < self._last_ns - _STEP_BACK_NS and (later_ns := self._repeats_after_ns(time_ns)):
            time_ns += later_ns
        self._last_ns = time_ns
        return time_ns

    def settle_first_hour(self, entries: Iterable[LogEntry]) -> str:
        """Which of the two hours a log begins in, if in one, by how its times go on; and a remark.

        They go back where the first ends. A log that leaves that hour otherwise began in the second: of the first,
        an hour would be missing.
        """
        stated_ns = (entry.time_ns for entry in entries)
        times_ns = (time_ns for time_ns in stated_ns if time_ns is not None and time_ns >= EARLIEST_UTC_NS)
        first_ns = last_ns = next(times_ns, 0)
        if not (later_ns := self._repeats_after_ns(first_ns)):
            return ""
        for time_ns in times_ns:
            if last_ns - time_ns >= _STEP_BACK_NS:
                return ""
            if not self._repeats_after_ns(time_ns):
                self._last_ns = first_ns + later_ns
                return ""
            last_ns = time_ns
        return (
            "it begins in the hour that comes twice at the end of summer time, and nothing in it states which: the"
            " first is taken; set TZ for the second, such as TZ=UTC-1 for a time that is one hour ahead of UTC"
        )


class LogClock:
    """The clock of one log, learned from its first entries; ``changed_ns`` is when the file was last changed.

    ``remark`` is what should be known of its times.
    """

    def __init__(self, head: Sequence[LogEntry], changed_ns: int) -> None:
        self.remark = ""
        self._now_ns: int | None = None
        self._day_time_sources: _TimeSources = frozenset()  # of a log without any date
        stamps_ns = [entry.time_ns for entry in head if not entry.turn_ns and entry.time_ns is not None]
        # times since the log began would not fall; those since the frame before (candump -td) do, or are all alike
        is_regular = len(stamps_ns) > 2 and stamps_ns[0] == 0 < stamps_ns[1] and len({*stamps_ns[1:]}) == 1
        falls = any(later < earlier < EARLIEST_UTC_NS for earlier, later in pairwise(stamps_ns))
        self._differences = falls or is_regular
        self._epoch_ns = 0  # UTC when the log's running time was zero; 0 as long as it is not stated
        self.local: _LocalTimes | None = None  # of a log whose lines state local times
        self._restart()
        is_stamped = bool(head) and head[0].time_ns is not None
        self._stands_still = (
            is_stamped and len(head) > _STUCK_ENTRIES and len({entry.time_ns for entry in head}) == 1
        )
        running = [(self._running_ns(entry), entry) for entry in head]
        timed = [(time_ns, entry) for time_ns, entry in running if time_ns is not None]
        self._time_sources = frozenset() if timed else _usual_time_sources(head, utc_ns_stated_by_entry)
        if not timed and not self._time_sources:
            self._day_time_sources = _usual_time_sources(head, _day_time_ns_stated_by_entry)
            head = [self._with_day_time(entry) for entry in head]
            timed = [(entry.time_ns, entry) for entry in head if entry.time_ns is not None]
        if self._time_sources:
            self.remark = (
                "it has no times of its own; what the bus or a sentence tells is taken, mostly whole seconds"
            )
        self._learn_start_time(timed, changed_ns)
        for entry in head:
            if any(_correct_rollover_or_none(time_ns) not in (None, time_ns) for time_ns in _written_utc_ns(entry)):
                date = trial.iso_utc(utc_ns_stated_by_entry(entry) or 0)[:10]
                self.remark = f"a receiver's weeks have rolled over: its date is 1,024 weeks back, {date} is taken"
                break
        self._restart()
        next((entry for entry in head if self.time_ns(entry) is not None), None)  # what comes before has it, too
        self._restart()

    def _restart(self) -> None:
        self._turns: dict[int, tuple[int, int]] = {}
        self._since_start_ns = 0

    def time_ns(self, entry: LogEntry) -> int | None:
        """The entry's time, or that of the entry before: UTC, or since the log began; None where there is none."""
        if self._time_sources:
            stated_ns = (
                utc_ns_stated_by_entry(entry) if _time_source_of_entry(entry) in self._time_sources else None
            )
            if stated_ns is None and self._now_ns is not None:
                stated_ns = self._time_ns_of_position(entry, self._now_ns)
            self._now_ns = self._now_ns if stated_ns is None else stated_ns
            return self._now_ns
        running_ns = self._running_ns(self._with_day_time(entry))
        if running_ns is not None:
            self._now_ns = running_ns + (self._epoch_ns if running_ns < EARLIEST_UTC_NS else 0)
        return self._now_ns

    def _time_ns_of_position(self, entry: LogEntry, now_ns: int) -> int | None:
        """The time of a position that is a little later than the last date: those of a second begin a receiver's
        sentences, and a date may end them."""
        day_time_ns = _day_time_ns_stated_by_entry(entry)
        if day_time_ns is None:
            return None
        time_ns = clock.nearest_utc_ns_of_day_time(day_time_ns / trial.NANO, now_ns)
        return time_ns if 0 < time_ns - now_ns <= _LONGEST_BURST_NS else None

    def _with_day_time(self, entry: LogEntry) -> LogEntry:
        """The entry with the time of day that it states, where nothing else in the log tells the time."""
        if _time_source_of_entry(entry) not in self._day_time_sources:
            return entry
        day_time_ns = _day_time_ns_stated_by_entry(entry)
        return entry if day_time_ns is None else entry._replace(time_ns=day_time_ns, turn_ns=DAY_NS)

    def _running_ns(self, entry: LogEntry) -> int | None:
        """As the entry states it, but that a clock that wraps around runs on, and differences are added up."""
        time_ns, turn_ns = entry.time_ns, entry.turn_ns
        if time_ns is None or self._stands_still or not 0 <= time_ns < _LATEST_NS:
            return None
        if turn_ns:
            before_ns, running_ns = self._turns.get(turn_ns, (time_ns, self._since_start_ns or time_ns))
            running_ns += (time_ns - before_ns + _SLACK_NS) % turn_ns - _SLACK_NS
            self._turns[turn_ns] = time_ns, running_ns
            time_ns = max(running_ns, 0)
        elif time_ns >= EARLIEST_UTC_NS:
            return time_ns if self.local is None else self.local.utc_ns(time_ns)
        elif self._differences:
            time_ns += self._since_start_ns
        time_ns = min(time_ns, EARLIEST_UTC_NS - 1)
        self._since_start_ns = max(time_ns, self._since_start_ns)
        return time_ns

    def _learn_start_time(self, running: list[tuple[int, LogEntry]], changed_ns: int) -> None:
        """When the log began, by the UTC stated in its beginning or, of times of day, by the file's last change."""
        since = [(time_ns, entry) for time_ns, entry in running if time_ns < EARLIEST_UTC_NS]
        if not since:
            return
        time_sources = _usual_time_sources([entry for _, entry in since], utc_ns_stated_by_entry)
        starts_ns = [
            utc - time_ns
            for time_ns, entry in since
            if _time_source_of_entry(entry) in time_sources and (utc := utc_ns_stated_by_entry(entry)) is not None
        ]
        # a receiver that has just been switched on may state any time
        began_ns = median_low(starts_ns) if starts_ns else 0
        set_at = next((pair for pair in pairwise(running) if pair[0][0] < EARLIEST_UTC_NS <= pair[1][0]), None)
        if not began_ns and set_at is not None:
            self._epoch_ns = set_at[1][0] - set_at[0][0]
            self.remark = "its clock was not set at first: what is before is dated by the moment at which it was"
            return
        has_clock = any(entry.turn_ns == DAY_NS for _, entry in since)
        if began_ns and has_clock and abs(began_ns - (midnight := _round_to_midnight_ns(began_ns))) <= _AGREED_NS:
            began_ns = midnight
        elif began_ns and has_clock:
            offset_s = (_round_to_midnight_ns(began_ns) - began_ns) / 1e9
            self.remark = f"its clock is {offset_s:+.1f} s from that of the bus or a sentence, which is taken"
        elif has_clock:
            last_ns = max(time_ns for time_ns, _ in since)
            began_ns = (changed_ns - last_ns) // DAY_NS * DAY_NS
            self.remark = "it tells times of day but no date; that of the file's last change is taken"
        elif not began_ns:
            self.remark = "its times count from its beginning, and it has no date: the moment of reading is taken"
        self._epoch_ns = began_ns


_TimeSources = frozenset[tuple[int, bytes]]


def _time_source_of_entry(entry: LogEntry) -> tuple[int, bytes]:
    """What an entry comes from: the identifier of a frame, the beginning of a sentence."""
    is_frame = entry.protocol == "can"
    return entry.identifier, b"" if is_frame else nmea0183.split_tag_block(entry.payload).sentence[:6]


def _usual_time_sources(head: Sequence[LogEntry], stated_ns: Callable[[LogEntry], int | None]) -> _TimeSources:
    """What states the UTC most often, or another time: two sources would make the time go to and fro.

    With it the same sentence of other satellite talkers, if no two of them state the same time: of one receiver.
    """
    stated = [
        (_time_source_of_entry(entry), time_ns) for entry in head if (time_ns := stated_ns(entry)) is not None
    ]
    if not stated:
        return frozenset()
    usual = Counter(source for source, _ in stated).most_common(1)[0][0]
    identifier, (talker, kind) = usual[0], (usual[1][1:3].decode("latin-1"), usual[1][3:])
    talkers = trial.SATELLITE_TALKERS if talker in trial.SATELLITE_TALKERS else {talker}
    receiver = frozenset(
        source
        for source, _ in stated
        if source[0] == identifier and source[1][3:] == kind and source[1][1:3].decode("latin-1") in talkers
    )
    times_ns = [time_ns for source, time_ns in stated if source in receiver]
    return receiver if all(earlier < later for earlier, later in pairwise(times_ns)) else frozenset({usual})


def _round_to_midnight_ns(time_ns: int) -> int:
    return (time_ns + DAY_NS // 2) // DAY_NS * DAY_NS


def utc_ns_stated_by_entry(entry: LogEntry) -> int | None:
    """The UTC that a message or a sentence states [ns since 1970]; None for any other."""
    stated = map(_correct_rollover_or_none, _written_utc_ns(entry))
    return next((utc for utc in stated if utc is not None), None)


def _written_utc_ns(entry: LogEntry) -> Iterable[int | None]:
    """The times that stand in an entry, also of a receiver whose weeks have rolled over."""
    if entry.protocol == "nmea0183":
        return map(_utc_ns_stated_by_sentence, nmea0183.split_into_sentences_and_rest(entry.payload))
    group = nmea2000.split_can_identifier(entry.identifier)[0]
    is_position = group == nmea2000.GNSS_POSITION and entry.flags == trial.FrameFlag.WHOLE
    is_clock = group in (nmea2000.SYSTEM_TIME, nmea2000.TIME_AND_DATE) and not entry.flags & ~trial.FrameFlag.WHOLE
    return [nmea2000.group_utc_ns(nmea2000.Message(group, entry.payload))] if is_position or is_clock else []


def _day_time_ns_stated_by_entry(entry: LogEntry) -> int | None:
    """The time of day that a position in a sentence states [ns]; None for any other entry."""
    if entry.protocol != "nmea0183":
        return None
    for line in nmea0183.split_into_sentences_and_rest(entry.payload):
        tag, fields = nmea0183.split_sentence(nmea0183.split_tag_block(line).sentence) or ("", [])
        read = _DAY_TIME_READERS.get(tag[-3:])
        seconds = None if read is None else read(nmea0183.Fields(fields)).seconds_of_day
        if seconds is not None:
            return round(seconds * trial.NANO)
    return None


def _correct_rollover_or_none(time_ns: int | None) -> int | None:
    """A time that can be true, or that a receiver means whose weeks have rolled over; None for others."""
    if time_ns is None or clock.is_possible_time(time_ns):
        return time_ns
    return clock.correct_week_rollover(time_ns, trial.wall_and_monotonic_ns()[0])


def _utc_ns_stated_by_sentence(line: bytes) -> int | None:
    """The date and time that a sentence states [ns since 1970]; None for any other."""
    tag, fields = nmea0183.split_sentence(nmea0183.split_tag_block(line).sentence) or ("", [])
    read = _TIME_READERS.get(tag[-3:])
    reading = nmea0183.SentenceReading() if read is None else read(nmea0183.Fields(fields))
    if reading.date is None or reading.seconds_of_day is None:
        return None
    return clock.utc_ns_of_date(reading.date, reading.seconds_of_day)


def telemetry_entry_time_ns(data: bytes, at: int) -> int | None:
    """The time of the entry that begins at ``at`` [ns, as it stands there]; None where none can begin there."""
    header = data[at : at + _TIME_BYTES + 1]
    if len(header) <= _TIME_BYTES or header[-1] not in (0xFD, 0xFE):
        return None
    time_ns = int.from_bytes(header[:_TIME_BYTES], "big") * _MICRO_NS
    return time_ns if time_ns < _LATEST_NS else None


def telemetry_entry_end(data: bytes, at: int) -> int | None:
    """Where the entry that begins at ``at`` ends; None where it is none, or is cut off.

    A packet whose length no checksum confirms (of an unknown message, a signed one) is accepted where another
    entry follows, or the end of ``data``, which may be within a time, and no sound entry begins inside.
    """
    if telemetry_entry_time_ns(data, at) is None:
        return None
    packet = at + _TIME_BYTES
    length = mavlink.packet_length(data, packet)
    end = packet + length
    if length == 0 or end > len(data):
        return None
    if mavlink.has_valid_checksum(data, packet) and not mavlink.is_signed_packet(data, packet):
        return end
    followed = end + _TIME_BYTES >= len(data) or telemetry_entry_time_ns(data, end) is not None
    inside = _MAY_BE_ENTRY.finditer(data, at + 1, end + _TIME_BYTES)
    return (
        end
        if followed and not any(mavlink.has_valid_checksum(data, match.end() + _TIME_BYTES) for match in inside)
        else None
    )


def next_telemetry_entry(data: bytes, at: int, settled: int) -> int | None:
    """Where the next entry begins, from ``at`` on; one beyond ``settled`` may yet turn out to be none."""
    for match in _MAY_BE_ENTRY.finditer(data, at):
        if match.start() >= settled or telemetry_entry_end(data, match.start()) is not None:
            return match.start()
    return None


class TelemetryLog(sources.LogReader):
    """One log; every frame has the log's time and no other. ``remark`` is what should be known of its times."""

    def _read_beginning(self, file: BinaryIO) -> None:
        head = file.read(_LONGEST_DAMAGE_BYTES)
        begin = next_telemetry_entry(head, 0, len(head))
        time_ns = None if begin is None else telemetry_entry_time_ns(head, begin)
        changed_ns = self._config.path.stat().st_mtime_ns
        self._behind_ns, self._steps, self._date = 0, list[tuple[int, int]](), ""
        began_ns = changed_ns if time_ns is None else time_ns
        self._restart(file, began_ns)
        if not clock.is_possible_time(began_ns):
            self._behind_ns, self._date = self._clock_error(file, changed_ns)
            self._restart(file, began_ns)

    def _restart(self, file: BinaryIO, began_ns: int) -> None:
        file.seek(0)
        self._time_ns, self._monotonic_ns, self._data = began_ns, 0, b""
        self._steps.clear()

    def _clock_error(self, file: BinaryIO, changed_ns: int) -> tuple[int, str]:
        """How far a clock that was not set is behind UTC [ns], and what states it first."""
        last_ns = self._time_ns
        while (frames := self._next_frames(file)) is not None:
            for frame in frames:
                if clock.is_possible_time(frame.received_ns):
                    return frame.received_ns - last_ns, "where that clock was set later"
                last_ns = frame.received_ns
                if (utc_ns := _utc_ns_stated_by_packet(frame.payload)) is not None:
                    return utc_ns - last_ns, "SYSTEM_TIME in it"
        return changed_ns - last_ns, "the file's last change"

    @property
    def remark(self) -> str:
        remarks = []
        if self._date:
            remarks.append(
                f"the clock of the log was not set: it is {self._behind_ns / trial.NANO:,.0f} s behind;"
                f" distances in time are its own, the date is by {self._date}"
            )
        if self._steps:
            at_ns, step_ns = self._steps[0]
            repeated = f", and {len(self._steps) - 1} times more" if len(self._steps) > 1 else ""
            remarks.append(
                f"its clock was set by {step_ns / trial.NANO:+,.0f} s at {trial.iso_utc(at_ns)}{repeated}"
            )
        return "; ".join(remarks)

    def _next_frames(self, file: BinaryIO) -> list[trial.Frame] | None:
        block = file.read(_BLOCK_BYTES)
        self._data += block
        frames = self._frames(ended=not block)
        return frames if frames or block else None

    def _frames(self, *, ended: bool) -> list[trial.Frame]:
        """The frames in the bytes at hand; what may yet turn out to be an entry waits for the next call."""
        data, frames, at = self._data, [], 0
        settled = len(data) - (0 if ended else _LOOK_AHEAD_BYTES)
        while at < settled:
            end, payload_from = telemetry_entry_end(data, at), at + _TIME_BYTES
            if end is None:
                end, payload_from = next_telemetry_entry(data, at + 1, settled), at
                if end is None and not ended and len(data) - at < _LONGEST_DAMAGE_BYTES:
                    break
                end = settled if end is None else end
            else:
                self._advance(data, at, end)
            frames.append(self._frame(data[payload_from:end]))
            at = end
        self._data = data[at:]
        return frames

    def _advance(self, data: bytes, at: int, end: int) -> None:
        """Go on to the time of an entry, unless the one before and the one after agree that it is wrong."""
        time_ns, next_ns = (
            telemetry_entry_time_ns(data, at) or self._time_ns,
            telemetry_entry_time_ns(data, end) if end < len(data) else None,
        )
        jumps = abs(time_ns - self._time_ns) > _JUMP_NS
        if jumps and next_ns is not None and abs(next_ns - self._time_ns) < abs(next_ns - time_ns):
            return
        before_ns, after_ns = self._utc_ns(self._time_ns), self._utc_ns(time_ns)
        if abs(after_ns - before_ns) > _JUMP_NS and len(self._steps) < _MOST_STEPS:
            self._steps.append((after_ns, after_ns - before_ns))
        self._time_ns = time_ns

    def _utc_ns(self, time_ns: int) -> int:
        """A time of the log as UTC: by a clock that was not set it is behind."""
        return time_ns if clock.is_possible_time(time_ns) else time_ns + self._behind_ns

    def _frame(self, payload: bytes) -> trial.Frame:
        time_ns = self._utc_ns(self._time_ns)
        self._monotonic_ns = max(self._monotonic_ns, time_ns)
        return trial.Frame(self.name, "mavlink", payload, time_ns, self._monotonic_ns, stamped_ns=time_ns)


def _utc_ns_stated_by_packet(packet: bytes) -> int | None:
    """The UTC that an intact SYSTEM_TIME states [ns since 1970]; None of all others."""
    if not packet or mavlink.packet_length(packet, 0) != len(packet) or not mavlink.has_valid_checksum(packet):
        return None
    if mavlink.parse_header(packet).message_id != _SYSTEM_TIME:
        return None
    header_bytes, length = (6 if packet[0] == 0xFE else 10), packet[1]  # trailing zeros are left out
    utc_ns = int.from_bytes(packet[header_bytes : header_bytes + min(length, 8)], "little") * _MICRO_NS
    return utc_ns if clock.is_possible_time(utc_ns) else None
