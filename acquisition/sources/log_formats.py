"""Turns lines and files of logs and gateways into CAN frames, whole messages and sentences: a form, a function.

A form of a line is a pattern and a small function from what it matched to an entry (:data:`LINE_FORMS`); a form of
a file is what its first bytes look like and a function that reads it (:data:`FILE_FORMS`). Such a function takes
the open file and a :class:`LineReader`, which also counts what could not be read; it raises :class:`ValueError`
with what is broken where a file ends before its time. Times are as the line states them: UTC, since the log began
(before 2001), or a clock that wraps around (``turn_ns``).

Actisense's binary messages (BST), of NGT-1, NGX, W2K, WGX and others, by the descriptions in the maker's public
SDK, begin with their kind and length; all their bytes add up to zero. Kinds that concern only the gateway are valid
and empty. Stamps of Vector's ASC count from the header's date, unless the header says that each counts from the
line before; or from midnight, by programs that write times of day below a date of their own. Dates are this
machine's local time, as their writers mean them.
"""

from __future__ import annotations

import base64
import binascii
import datetime as dt
import re
import struct
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import chain
from typing import BinaryIO, NamedTuple

from seatrial.acquisition.core.times import DAY_NS, Stamp, time_of_day_ns
from seatrial.acquisition.core.trial import HIGHEST_IDENTIFIER, NANO, FrameFlag, Protocol, can_flags
from seatrial.acquisition.protocols import clock, nmea0183, nmea2000
from seatrial.acquisition.sources.network_packets import IpPacket, StreamOrder, parse_packet

MILLI_NS = 1_000_000
_MOST_BYTES = 64  # of a frame of CAN FD
_LONGEST_MESSAGE = 1785  # bytes, of ISO 11783's transport protocol
_ERROR_BIT = 0x20000000  # candump marks error frames by a bit above the 29 of the identifier
_pattern = partial(re.compile, flags=re.ASCII)  # outside ASCII nothing is a space or a digit


class LogEntry(NamedTuple):
    """One frame, whole message or sentence, with the time that its line states, if any.

    A clock that restarts every ``turn_ns`` (at midnight, after 2^32 ms) states how much of the turn is over.
    ``bus`` is the interface or channel of a log that has several.
    """

    time_ns: int | None
    payload: bytes
    identifier: int = 0
    flags: FrameFlag = FrameFlag.NONE
    protocol: Protocol = "can"
    turn_ns: int = 0
    bus: str = ""


def parameter_group_entry(
    header: tuple[int, int, int, int],
    payload: bytes,
    time_ns: int | None,
    turn_ns: int = 0,
    *,
    assembled: bool = True,
) -> LogEntry | None:
    """A message of a parameter group; ``header`` is its priority, group, source and destination.

    ``assembled`` says that it was put together where it took several frames. None for what can have been on no bus:
    groups beyond 18 bits are a gateway's own.
    """
    priority, group, source, destination = header
    addressed = (group >> 8) & 0xFF < 240
    if group > 0x3FFFF or max(source, destination) > 255 or len(payload) > _LONGEST_MESSAGE:
        return None
    if addressed and group & 0xFF:
        return None
    identifier = (priority & 7) << 26 | group << 8 | source | (destination << 8 if addressed else 0)
    flags = FrameFlag.WHOLE if assembled else FrameFlag.NONE
    return LogEntry(time_ns, payload, identifier, flags, turn_ns=turn_ns)


def _parameter_group_header(match: re.Match[str], base: int = 10) -> tuple[int, int, int, int]:
    """Priority, group, source and destination of a message, 0 for what its line does not state."""
    priority, group, source, destination = match.group("priority", "group", "source", "destination")
    return int(priority or "0", base), int(group, base), int(source or "0", base), int(destination, base)


_CANDUMP_LOG = _pattern(
    r"\((?P<time>[\d.TZ: +-]{1,40})\)\s+(?P<bus>\S+)\s+"
    r"(?P<id>[0-9A-Fa-f]{3}|[0-9A-Fa-f]{8})#(?:#(?P<fd>[0-9A-Fa-f]))?"
    r"(?P<data>(?:[0-9A-Fa-f]{2}\.?)*|R[0-9A-Fa-f]?)(?:_[0-9A-Fa-f])?(?:\s+[RT])?\s*"
)
_CANDUMP_CONSOLE = _pattern(
    r"(?:\((?P<time>[\d.TZ: +-]{1,40})\)\s+)?(?P<bus>\S+)\s+(?:[RT]X [B-] [E-]\s+)?"
    r"(?P<id>[0-9A-Fa-f]{3}|[0-9A-Fa-f]{8})\s+\[(?P<length>\d{1,2})\]"
    r"(?:\s+(?P<remote>remote request)|(?P<data>(?:[\s`]+(?:[01]{8}|[0-9A-Fa-f]{2}))*))"
    r"(?:\s+ERRORFRAME|\s+'.*')?\s*"
)
_CANDUMP_OLD = _pattern(
    r"<0x(?P<id>[0-9A-Fa-f]{3}|[0-9A-Fa-f]{8})>\s+\[(?P<length>\d{1,2})\](?P<data>(?:\s+[0-9A-Fa-f]{2})*)\s*"
)


def _read_candump_log(match: re.Match[str]) -> LogEntry | None:
    remote = match["data"].startswith("R")
    data = b"" if remote else bytes.fromhex(match["data"].replace(".", ""))
    return _candump_entry(match["time"], match["id"], data, remote, match["bus"])


def _read_candump_console(match: re.Match[str]) -> LogEntry | None:
    fields = match.groupdict()
    remote = fields.get("remote") is not None
    text = fields["data"] or ""
    parts = text.replace("`", " ").split()
    base = 2 if parts and len(parts[0]) == 8 else 16  # binary: -i
    data = bytes(int(part, base) for part in parts)
    if "`" in text:  # the last byte comes first: -S
        data = data[::-1]
    if not remote and len(data) != int(fields["length"]):
        return None
    return _candump_entry(fields.get("time"), fields["id"], data, remote, fields.get("bus") or "")


_DATE_TIME = _pattern(r"(\d{4}-\d\d-\d\d)[ T](\d\d:\d\d:\d\d)(?:\.(\d{1,9}))?(Z|[+-]\d\d(?::?\d\d)?)?")


def _candump_entry(time: str | None, identifier: str, data: bytes, remote: bool, bus: str) -> LogEntry | None:
    """A frame with its time: seconds, or a date and time, in this machine's zone (as of candump) if it has none."""
    time_ns: int | None = None
    if time is not None and "-" in time:
        match = _DATE_TIME.fullmatch(time)
        time_ns = None if match is None else clock.zoned_time_ns(match[1], match[2], match[3], match[4], None)
    elif time is not None:
        seconds, _, fraction = time.partition(".")
        if seconds.isdigit() and (not fraction or fraction.isdigit()) and len(seconds) <= 10:
            time_ns = int(seconds) * NANO + int(fraction[:9].ljust(9, "0"))
    if len(data) > _MOST_BYTES or (time is not None and time_ns is None):
        return None
    number = int(identifier, 16)
    flags = can_flags(len(identifier) == 3, remote, bool(number & _ERROR_BIT))
    return LogEntry(time_ns, data, number & HIGHEST_IDENTIFIER, flags, bus=bus)


_SAVVYCAN = _pattern(
    r"(?P<time>\d{1,19}),(?P<id>[0-9A-Fa-f]{1,8}),(?P<extended>true|false),(?:(?P<direction>[RT]x),)?(?P<bus>\d+),"
    r"(?P<length>\d{1,2}),(?P<data>(?:[0-9A-Fa-f]{2},?){0,64}),*"
)


def _read_savvycan(match: re.Match[str]) -> LogEntry | None:
    """A row of SavvyCAN's table: microseconds since 1970 or since the log began, the frame's bytes in columns."""
    data, identifier = bytes.fromhex(match["data"].replace(",", "")), int(match["id"], 16)
    if len(data) != int(match["length"]):
        return None
    flags = can_flags(match["extended"] == "false")
    bus = f"channel{match['bus']}"
    return LogEntry(1000 * int(match["time"]), data, identifier & HIGHEST_IDENTIFIER, flags, bus=bus)


_PYTHON_CAN = _pattern(
    r"(?P<seconds>\d{1,10})(?:\.(?P<fraction>\d{1,9}))?,0x(?P<id>[0-9A-Fa-f]{1,8}),(?P<extended>[01]),(?P<remote>[01]),"
    r"(?P<error>[01]),(?P<length>\d{1,2}),(?P<data>[A-Za-z0-9+/]*={0,2})\s*"
)


def _read_python_can(match: re.Match[str]) -> LogEntry | None:
    """A row of python-can's table: seconds since 1970 or since the log began, its bytes to the base of 64."""
    try:
        data = base64.b64decode(match["data"], validate=True)
    except binascii.Error:
        return None
    remote, identifier = match["remote"] == "1", int(match["id"], 16)
    if identifier > HIGHEST_IDENTIFIER or (not remote and len(data) != int(match["length"])):
        return None
    time_ns = int(match["seconds"]) * NANO + int((match["fraction"] or "").ljust(9, "0"))
    flags = can_flags(match["extended"] == "0", remote, match["error"] == "1")
    return LogEntry(time_ns, data, identifier, flags)


_CANBOAT = _pattern(
    r"(?P<date>\d{4}-\d\d-\d\d)[-T ](?P<clock>\d\d:\d\d:\d\d)(?:[.,](?P<fraction>\d{1,9}))?"
    rf"{clock.ZONE},(?P<priority>[0-7]),(?P<group>\d{{1,6}}),"
    r"(?P<source>\d{1,3}),(?P<destination>\d{1,3}),(?P<length>\d{1,4})(?P<data>(?:,[0-9A-Fa-f]{2})*),?\s*"
)


def _read_canboat(match: re.Match[str]) -> LogEntry | None:
    """Where it has more than 8 bytes canboat has put it together; one of 8 may be part of a longer message."""
    data = bytes.fromhex(match["data"].replace(",", ""))
    time_ns = clock.zoned_time_ns(match["date"], match["clock"], match["fraction"], match["zone"], dt.UTC)
    if time_ns is None or len(data) != int(match["length"]):
        return None
    return parameter_group_entry(_parameter_group_header(match), data, time_ns, assembled=len(data) > 8)


_YACHT_DEVICES = _pattern(
    r"(?:(?P<clock>\d\d:\d\d:\d\d)(?:\.(?P<fraction>\d{1,9}))?\s+[RT]\s+)?"
    r"(?P<id>[0-9A-Fa-f]{8})(?P<data>(?:\s+[0-9A-Fa-f]{2}){1,8})\s*"
)


def _read_yacht_devices(match: re.Match[str]) -> LogEntry | None:
    """``17:33:21.107 R 19F51323 01 2F 30 70 00 2F 30 70``, and of some devices without time and direction."""
    time_ns = time_of_day_ns(match["clock"], match["fraction"]) if match["clock"] else None
    number = int(match["id"], 16)
    if number > HIGHEST_IDENTIFIER or (match["clock"] and time_ns is None):
        return None
    return LogEntry(time_ns, bytes.fromhex(match["data"]), number, turn_ns=DAY_NS)


_N2K_ASCII = _pattern(
    r"(?:A(?P<clock>\d{6})(?:\.(?P<fraction>\d{1,9}))?\s+)?"
    r"(?P<source>[0-9A-Fa-f]{2})(?P<destination>[0-9A-Fa-f]{2})(?P<priority>[0-9A-Fa-f])\s+"
    r"(?P<group>[0-9A-Fa-f]{5,6})\s+(?P<data>(?:[0-9A-Fa-f]{2})+)(?:\s.*)?"
)


def _read_n2k_ascii(match: re.Match[str]) -> LogEntry | None:
    """``A173321.107 23FF7 1F513 012F3070002F30709F``: whole messages of an Actisense gateway."""
    time_ns = time_of_day_ns(match["clock"], match["fraction"]) if match["clock"] else None
    if match["clock"] and time_ns is None:
        return None
    return parameter_group_entry(_parameter_group_header(match, 16), bytes.fromhex(match["data"]), time_ns, DAY_NS)


_IKONVERT = _pattern(
    r"!PDGY,(?P<group>\d{1,6}),(?:(?P<priority>[0-7]),(?P<source>\d{1,3}),)?(?P<destination>\d{1,3}),"
    r"(?:(?P<seconds>\d{0,9})(?:\.(?P<fraction>\d{1,9}))?,)?(?P<data>[A-Za-z0-9+/]+={0,2})\s*"
)


def _read_ikonvert(match: re.Match[str]) -> LogEntry | None:
    """Digital Yacht's, with the seconds since the gateway started, except for what is sent to it."""
    try:
        data = base64.b64decode(match["data"], validate=True)
    except binascii.Error:
        return None
    fraction_ns = int((match["fraction"] or "").ljust(9, "0"))
    time_ns = int(match["seconds"]) * NANO + fraction_ns if match["seconds"] else None
    return parameter_group_entry(_parameter_group_header(match), data, time_ns)


_SEASMART = _pattern(
    r"\$PCDIN,(?P<group>[0-9A-Fa-f]{6}),(?P<time>[0-9A-Va-v]{1,8})!?,(?P<source>[0-9A-Fa-f]{2}),"
    r"(?P<data>(?:[0-9A-Fa-f]{2})+)\*(?P<sum>[0-9A-Fa-f]{2})\s*"
)
_SEASMART_EPOCH_NS = 1_262_304_000 * NANO  # 2010
_LONGEST_UPTIME_MS = 0x80000000


def _read_seasmart(match: re.Match[str]) -> LogEntry | None:
    """SeaSmart's and what followed it. Its time is of one of two kinds, which the protocol does not distinguish.

    Devices write milliseconds since they started, hexadecimal; the original 1/1024 s since 2010 to the base of 32,
    which begin with 8 or more since 2018: a device that has been on for 25 days is taken for one.
    """
    if not _has_valid_checksum(match):
        return None
    header = 0, int(match["group"], 16), int(match["source"], 16), 255
    digits, turn_ns = match["time"], 2**32 * MILLI_NS
    if max(digits.upper()) <= "F" and int(digits, 16) < _LONGEST_UPTIME_MS:
        time_ns = int(digits, 16) * MILLI_NS
    else:
        time_ns, turn_ns = _SEASMART_EPOCH_NS + int(digits, 32) * NANO // 1024, 0
    return parameter_group_entry(header, bytes.fromhex(match["data"]), time_ns, turn_ns)


_MXPGN = _pattern(
    r"\$[A-Z]{2}PGN,(?P<group>[0-9A-Fa-f]{6}),(?P<attribute>[0-9A-Fa-f]{4}),"
    r"(?P<data>(?:[0-9A-Fa-f]{2})+)\*(?P<sum>[0-9A-Fa-f]{2})\s*"
)


def _read_mxpgn(match: re.Match[str]) -> LogEntry | None:
    """ShipModul's: a CAN frame, its data as one number, so that the last byte comes first; some put them together.

    What a program sends to the bus bears a bit, and an address that is the receiver's; the sender's is not stated.
    """
    attribute, group = int(match["attribute"], 16), int(match["group"], 16)
    data, address = bytes.fromhex(match["data"])[::-1], attribute & 0xFF
    if not _has_valid_checksum(match) or (len(data) <= 8 and len(data) != min(attribute >> 8 & 0xF, 8)):
        return None
    source, destination = (0, address) if attribute & 0x8000 else (address, 255)
    if (group >> 8) & 0xFF < 240:
        group, destination = group & 0x3FF00, group & 0xFF or destination
    return parameter_group_entry(
        (attribute >> 12 & 7, group, source, destination), data, None, assembled=len(data) > 8
    )


def _has_valid_checksum(match: re.Match[str]) -> bool:
    body = match.string[1 : match.string.rindex("*")]
    return nmea0183.xor_checksum(body.encode("latin-1")) == int(match["sum"], 16)


_GARMIN = _pattern(
    r"\d+,(?P<time>\d+|(?:\d+_){6}\d+),(?P<group>\d{1,6}),.*,(?P<source>\d{1,3}),(?P<destination>\d{1,3}),"
    r"(?P<priority>[0-7]),[01],(?P<length>\d{1,3}),0x(?P<data>(?:[0-9A-Fa-f]{2})+)\s*"
)


def _read_garmin(match: re.Match[str]) -> LogEntry | None:
    """A chart plotter's log: milliseconds since it started, or ``month_day_year_hour_minute_second_ms``."""
    data, numbers = bytes.fromhex(match["data"]), match["time"].split("_")
    if len(data) != int(match["length"]):
        return None
    time_ns: int | None = int(numbers[0]) * MILLI_NS
    if len(numbers) > 1:
        month, day, year, hour, minute, second, milli = map(int, numbers)
        date, time = f"{year:04d}-{month:02d}-{day:02d}", f"{hour:02d}:{minute:02d}:{second:02d}"
        time_ns = clock.zoned_time_ns(date, time, f"{milli % 1000:03d}", None, dt.UTC)
    return None if time_ns is None else parameter_group_entry(_parameter_group_header(match), data, time_ns)


_OPENCPN_MESSAGE = _pattern(r"(?:\$PCDIN,\d+,)?(?P<data>93(?:[0-9A-Fa-f]{2}){12,})\s*")


def _read_opencpn(match: re.Match[str]) -> LogEntry | None:
    """A message as OpenCPN keeps it: as Actisense's gateway gives it, whose time it fills in as it likes."""
    stored = parse_kind_93(bytes.fromhex(match["data"]))
    return None if stored is None else parameter_group_entry(stored.header, stored.payload, None)


ReadMatch = Callable[[re.Match[str]], LogEntry | None]
LINE_FORMS: dict[str, tuple[tuple[re.Pattern[str], ReadMatch], ...]] = {
    "candump": (
        (_CANDUMP_LOG, _read_candump_log),
        (_CANDUMP_CONSOLE, _read_candump_console),
        (_CANDUMP_OLD, _read_candump_console),
    ),
    "savvycan": ((_SAVVYCAN, _read_savvycan),),
    "python_can": ((_PYTHON_CAN, _read_python_can),),
    "canboat": ((_CANBOAT, _read_canboat),),
    "yacht_devices": ((_YACHT_DEVICES, _read_yacht_devices),),
    "n2k_ascii": ((_N2K_ASCII, _read_n2k_ascii),),
    "ikonvert": ((_IKONVERT, _read_ikonvert),),
    "seasmart": ((_SEASMART, _read_seasmart),),
    "mxpgn": ((_MXPGN, _read_mxpgn),),
    "garmin": ((_GARMIN, _read_garmin),),
    "opencpn": ((_OPENCPN_MESSAGE, _read_opencpn),),
}
"""Each form of a line by its name, with what it looks like and how it is read."""
_WITHOUT_LENGTH = (LINE_FORMS["candump"][0], *LINE_FORMS["yacht_devices"])

_NO_ENTRY = _pattern(
    r"(?:[#;][^\x00-\x08\x0e-\x1f\x7f]*|//.*|interface = .*|\$PDGY,.*|Sequence #,.*"
    r"|(?:timestamp|received_at|Time Stamp),.*|)"
)
_COMMENTS = frozenset("#;")
_COLOUR = _pattern(r"\x1b\[[0-9;]*m")
_BEGINNINGS = ("$", "!", "\\", "UdPbC")  # of a sentence, a TAG block, a datagram's prefix
_ENDING = _pattern(r"(?P<inner>.*\*[0-9A-Fa-f]{2})[\s,;]++(?P<after>[^*$!]*)")
_PACKED = re.compile(rb"[$!](?:PCDIN|PDGY|[A-Z]{2}PGN),")  # a gateway's message
_ENVELOPES = (
    _pattern(r"(?P<before>\d{13};)[A-Za-z0-9]{0,12};(?P<inner>.*)"),  # Signal K's log of all its inputs
    # OpenCPN's voyage data recorder: the time, the protocol, one or two columns of its own, what came.
    _pattern(r"(?P<before>[^,]*),NMEA2000,(?:[^,]*,){1,2}\"?(?P<inner>A?[0-9A-Fa-f][0-9A-Fa-f:.RT ]{11,})\"?"),
)


def split_into_entries(piece: bytes) -> list[bytes]:
    """A line or message in parts of one entry each: cut where a gateway's message stands among sentences."""
    if piece.startswith(MARK) or not _PACKED.search(piece):
        return [piece]
    return nmea0183.split_at_sentences(piece) if len(nmea0183.split_into_sentences_and_rest(piece)) > 1 else [piece]


class LineReader:
    """Lines, and Actisense's messages, to entries: of one form, or of any, as each line shows.

    ``unreadable`` counts those that are neither an entry nor a comment; ``remark`` is what is left out.
    """

    def __init__(self, form: str = "", times: clock.StatedTimes | None = None) -> None:
        self.unreadable, self.remark = 0, ""
        self.times = times or clock.StatedTimes()
        self._forms = [line_form for name, forms in LINE_FORMS.items() if form in ("", name) for line_form in forms]

    def entries(self, pieces: Sequence[bytes]) -> Iterator[LogEntry]:
        """The entries in lines and messages, each read when it is asked for."""
        has_packed = _PACKED.search(b"\n".join(pieces)) is not None  # asked once: lines are many
        parts = chain.from_iterable(map(split_into_entries, pieces)) if has_packed else pieces
        return filter(None, map(self.entry, parts))

    def may_be_cut(self, entry: LogEntry) -> bool:
        """Whether a frame, by a line without an end, may lack bytes: short, and of a form that states no length."""
        is_short = len(entry.payload) < 8 and not entry.flags & (FrameFlag.REMOTE | FrameFlag.WHOLE)
        return entry.protocol == "can" and is_short and self._forms[0] in _WITHOUT_LENGTH

    def entry(self, piece: bytes) -> LogEntry | None:
        """The entry in a line or a message, if any; of a line that :func:`split_into_entries` leaves as it is."""
        if piece.startswith(MARK) and (stored := parse_stored_message(piece[len(MARK) :])) is not None:
            if stored.sentence:
                return LogEntry(None, stored.sentence, protocol="nmea0183")
            if not stored.payload:
                return None
            return parameter_group_entry(
                stored.header, stored.payload, stored.time_ns, stored.turn_ns, assembled=stored.assembled
            )
        text = piece.decode("latin-1")
        return self._read_sentence(text) if text.startswith(_BEGINNINGS) else self._read_line(text)

    def _read_sentence(self, text: str) -> LogEntry | None:
        """A line that begins as a sentence does; some have a message of NMEA 2000 inside, or a time behind."""
        if text[-3:-2] != "*" and (match := _ENDING.fullmatch(text)):
            return _with_stated_time(
                self._read_sentence(match["inner"]), self.times.read_time_prefix(match["after"])
            )
        line = text.encode("latin-1")
        tagged = nmea0183.split_tag_block(line)
        if tagged.sentence[3:7] == b"PGN," or tagged.sentence.startswith((b"$PCDIN,", b"!PDGY,")):
            entry = self._match_form(tagged.sentence.decode("latin-1"))
            if entry is None:
                return self._embedded_sentence(line)
            return _with_stated_time(
                entry, None if tagged.time_ns is None else (clock.possible_time_or_none(tagged.time_ns), 0)
            )
        if _NO_ENTRY.fullmatch(text):
            return None
        return LogEntry(clock.possible_time_or_none(tagged.time_ns), line, protocol="nmea0183")

    def _read_line(self, text: str) -> LogEntry | None:
        """A line of a form, or what stands behind a time or a name that a logger wrote before it."""
        if "\x1b" in text:
            text = _COLOUR.sub("", text).strip()
        entry = self._match_form(text)
        if entry is None and text[:1] not in _COMMENTS:
            if match := clock.SENTENCE_WITH_PREFIX.fullmatch(text):
                inner = match["inner"].removesuffix('"') if match["before"].endswith('"') else match["inner"]
                entry = _with_stated_time(self._read_sentence(inner), self.times.read_time_prefix(match["before"]))
            elif match := next(filter(None, (pattern.fullmatch(text) for pattern in _ENVELOPES)), None):
                entry = _with_stated_time(
                    self._match_form(match["inner"]), self.times.read_time_prefix(match["before"])
                )
        if entry is not None or _NO_ENTRY.fullmatch(text):
            return entry
        return self._embedded_sentence(text.encode("latin-1"))

    def _embedded_sentence(self, line: bytes) -> LogEntry | None:
        """A line of no form, for the sentences that are in it all the same."""
        if nmea0183.has_sentence(line):
            return LogEntry(None, line, protocol="nmea0183")
        self.unreadable += 1
        return None

    def _match_form(self, text: str) -> LogEntry | None:
        for form in self._forms:
            if match := form[0].fullmatch(text):
                if form is not self._forms[0]:  # the next line is most likely of the same form
                    self._forms.remove(form)
                    self._forms.insert(0, form)
                return form[1](match)
        return None


def _with_stated_time(entry: LogEntry | None, time: tuple[int | None, int] | None) -> LogEntry | None:
    """The entry at the time stated next to it, if any."""
    return entry if entry is None or time is None else entry._replace(time_ns=time[0], turn_ns=time[1])


MARK, END = b"\x10\x02", b"\x10\x03"
_DLE = b"\x10"
_LONGEST_BYTES = 1_800  # 1,785 bytes is the longest message
_BODY = re.compile(rb"(?:[^\x10]++|\x10\x10)*+\x10[^\x10]", re.DOTALL)
_KINDS = frozenset(range(0x90, 0xB0)) | frozenset(range(0xD0, 0xE0))
_TEXT_KIND = b"\x9d"
_LINE_END = re.compile(rb"[\r\n]")  # some devices send only one of the two
_LONGEST_LINE_BYTES = 8192  # of a message of 1,785 bytes in hexadecimal; a line without an end must not eat memory
_SHORTEST_CUT_BYTES = 4096  # more than the longest sentence, which the same message has in it
_BEGINNING = re.compile(rb"\\[^\\]{1,200}(?:\\[$!]?|\Z)|[$!]{1,2}")
"""Of a sentence, or of its TAG block."""
_SENTENCE_LINE = re.compile(rb"[$!][A-Za-z0-9]{3,16},[\x20-\x7e]{0,200}\*[0-9A-Fa-f]{2}[\r\n]")
_UPTIME_TURN_NS = 2**32 * MILLI_NS
_STEPS_NS = (1_000_000, 100_000, 10_000, 1_000)  # of the 16-bit clock of single frames, by two bits


class Stored(NamedTuple):
    """What a message holds: a group's bytes with their priority, group, source and destination, or a sentence.

    ``time_ns`` counts from when the gateway started and wraps around after ``turn_ns``. ``assembled`` marks
    messages that the gateway has put together from single frames.
    """

    header: tuple[int, int, int, int] = (0, 0, 0, 0)
    payload: bytes = b""
    time_ns: int = 0
    turn_ns: int = _UPTIME_TURN_NS
    assembled: bool = True
    sentence: bytes = b""


def parse_stored_message(stored: bytes) -> Stored | None:
    """What a message with its checksum holds; None for one that is not sound."""
    if len(stored) < 3:
        return None
    body, kind = stored[:-1], stored[0]
    length = int.from_bytes(body[1:3], "little") if kind == 0xD0 else body[1] + 2
    if length != len(body) or sum(stored) & 0xFF:
        return None
    if kind == 0x93:
        return parse_kind_93(body)
    if kind == _TEXT_KIND[0]:
        return Stored(sentence=body[2:].strip(b"\0\r\n \t"))
    if kind not in (0x95, 0xD0):
        return Stored()
    if not (8 <= len(body) <= 16 if kind == 0x95 else len(body) >= 13):
        return None
    priority, group, source = body[7] >> 2 & 7, _group_of_identifier_fields(body[7], body[6], body[5]), body[4]
    if kind == 0xD0:  # a message with an identifier's fields
        header = priority, group, source, body[3]
        return Stored(header, body[13:], int.from_bytes(body[9:13], "little") * MILLI_NS)
    header = priority, group, source, body[5] if body[6] < 240 else 255  # a single frame
    step_ns = _STEPS_NS[body[7] >> 5 & 3]
    return Stored(header, body[8:], int.from_bytes(body[2:4], "little") * step_ns, 2**16 * step_ns, assembled=False)


def is_message(piece: bytes) -> bool:
    """Whether a piece that :class:`StreamCutter` cut is a message, not text."""
    return piece.startswith(MARK) and parse_stored_message(piece[len(MARK) :]) is not None


def parse_kind_93(body: bytes) -> Stored | None:
    """A message of kind 93, without its checksum; None where its lengths contradict each other."""
    if len(body) < 13 or body[0] != 0x93 or len(body) < 13 + body[12]:
        return None
    header = body[2] & 7, _group_of_identifier_fields(body[5], body[4], body[3]), body[7], body[6]
    return Stored(header, body[13 : 13 + body[12]], int.from_bytes(body[8:12], "little") * MILLI_NS)


def _group_of_identifier_fields(page: int, pdu_format: int, pdu_specific: int) -> int:
    """The parameter group from the fields of an identifier."""
    return (page & 3) << 16 | pdu_format << 8 | (0 if pdu_format < 240 else pdu_specific)


class StreamCutter:
    """Cuts a stream of bytes into lines of text and binary messages, which begin with :data:`MARK`.

    Both may come on one stream. A message that is not sound is text.
    """

    def __init__(self) -> None:
        self._pending = b""

    def push(self, received: bytes) -> list[bytes]:
        """The lines and messages that ``received`` completes; empty lines are passed over."""
        data, pieces, start, at, end = self._pending + received, list[bytes](), 0, 0, 0
        while (at := data.find(MARK, at)) >= 0:
            body = at + len(MARK)
            if body >= end:  # what seems a mark inside, behind an escaped byte, would end at the same place
                frame = _BODY.match(data, body)
                end = len(data) + 1 if frame is None else frame.end()
            message = b""
            if end <= len(data) and data[end - len(END) : end] == END and end - body <= 2 * _LONGEST_BYTES:
                message = data[body : end - len(END)].replace(_DLE * 2, _DLE)
            if parse_stored_message(message) is not None:
                pieces += [*_split_lines(data[start:at]), MARK + message]
                start = at = end
            elif end > len(data) and _may_be_incomplete_message(data, body):
                break
            else:
                at += 1
        stop = len(data) if at < 0 else at
        line_end = max(data.rfind(b"\n", start, stop), data.rfind(b"\r", start, stop))
        if line_end >= 0:
            pieces += _split_lines(data[start : line_end + 1])
            start = line_end + 1
        *full, self._pending = _split_long(data[start:])
        return pieces + full

    def cut(self) -> None:
        """The stream was cut and restarts: an unfinished piece stays as far as it came, by itself."""
        if self._pending:
            self._pending = self._pending.replace(MARK, MARK[:1] + b"\n" + MARK[1:]) + b"\n"

    def end(self) -> list[bytes]:
        """The last line, or what there is of a message, where the stream ended (a datagram, a file)."""
        pieces, self._pending = _split_lines(self._pending), b""
        return pieces


def _split_lines(text: bytes) -> list[bytes]:
    lines = [stripped for line in _LINE_END.split(text) if (stripped := line.strip(b"\0 \t"))]
    if max(map(len, lines), default=0) <= _LONGEST_LINE_BYTES:
        return lines
    return [piece for line in lines for piece in _split_long(line)]


def _split_long(line: bytes) -> list[bytes]:
    """A line in pieces that are not too long; no sentence is cut in two that is not too long itself."""
    pieces = []
    while len(line) > _LONGEST_LINE_BYTES:
        beginnings = _BEGINNING.finditer(line, _SHORTEST_CUT_BYTES, _LONGEST_LINE_BYTES)
        cut = max((beginning.start() for beginning in beginnings), default=_LONGEST_LINE_BYTES)
        pieces.append(line[:cut])
        line = line[cut:]
    return [*pieces, line]


def _may_be_incomplete_message(data: bytes, at: int) -> bool:
    """Whether a message may begin here of which more is to come: by its kind, and its length with all escaped.

    What a line with a sentence follows upon is noise that looks so, and must not hold the sentence back.
    """
    kind, length = data[at : at + 1], data[at + 1 : at + 3]
    if kind and kind[0] not in _KINDS:
        return False
    longest = 2 * _LONGEST_BYTES if kind == b"\xd0" else 2 * (258 if len(length) < 2 else length[0] + 4)
    return len(data) - at < longest and (kind == _TEXT_KIND or not _SENTENCE_LINE.search(data, at))


_LONGEST_LINE = 65_536
_STAMPED = re.compile(r"(?P<seconds>-?\d{1,10})(?:\.(?P<fraction>\d{1,9}))?\s+(?P<event>.*)")
_FRAME = re.compile(
    r"(?P<channel>\d{1,3})\s+(?P<id>[0-9A-Fa-f]{1,10})(?P<extended>x?)\s+(?:Rx|Tx|TxRq)\s+(?P<kind>[dr])"
    r"(?:\s+(?P<length>[0-9A-Fa-f]{1,2}))?(?P<data>(?:\s+[0-9A-Fa-f]{1,3})*)(?:\s+Length\s*=.*)?\s*",
    re.IGNORECASE,
)
_FD_FRAME = re.compile(
    r"CANFD\s+(?P<channel>\d{1,3})\s+(?:Rx|Tx|TxRq)\s+(?P<id>[0-9A-Fa-f]{1,10})(?P<extended>x?)(?:\s+[A-Za-z_]\w*)?"
    r"\s+[01]\s+[01]\s+[0-9A-Fa-f]{1,2}\s+(?P<length>\d{1,2})(?P<data>(?:\s+[0-9A-Fa-f]{1,3})*).*",
    re.IGNORECASE,
)
_ERROR = re.compile(r"(?:CANFD\s+)?(?P<channel>\d{1,3})\s+(?:(?:Rx|Tx)\s+)?ErrorFrame\b.*", re.IGNORECASE)
_EVENT = re.compile(
    r"(?:CAN\s+)?\d{1,3}\s+(?:Statistic|Status)\b.*|CAN\s+\d{1,3}\s+Status\b.*|Start of measurement.*"
    r"|log (?:trigger|direct) .*|(?:SV|SysVar|EnvVar|Comment|TriggerEvent|GPS-Event|GlobalMarker)\b.*",
    re.IGNORECASE,
)
_SECTION = re.compile(r"(?:end|begin)\s+trigger\s*block\b.*|(?:no )?internal events logged.*|//.*|", re.IGNORECASE)
_BEGINS_ASC = re.compile(rb"\s*(?:date\s+\S|base\s+(?:hex|dec)\b|//\s*version\b)", re.IGNORECASE)
_DAY_BEGAN_WITHIN_NS = 600 * NANO
"""A stamp that is the header's time of day, or up to ten minutes later, counts from midnight: as a time since the
header it would mean a pause of just so long."""
_EARLIEST_TIME_OF_DAY_NS = 3600 * NANO  # what is less is a time since the header, whatever that says
_LATER_BLOCK_NS, _ROUNDED_NS = 2 * NANO, NANO  # of a trigger block's date, which may be in whole seconds


def read_asc(file: BinaryIO, reader: LineReader) -> Iterator[LogEntry]:
    """The frames of a log. Raises :class:`ValueError` where its last line is cut off."""
    header, is_cut = _AscHeader(reader.times), False
    while line := file.readline(_LONGEST_LINE):
        text = line.decode("utf-8", "replace").strip("\ufeff \t\r\n")
        stamped, is_cut = _STAMPED.fullmatch(text), False
        if stamped is None:
            reader.unreadable += not header.read(text)
            continue
        time_ns = header.time_ns(stamped)
        entry = _parse_event(stamped["event"], header.base)
        if entry is not None:
            yield entry._replace(time_ns=time_ns)
        else:
            is_cut = _FRAME.match(stamped["event"]) is not None  # it begins as a frame does, but has too few bytes
            reader.unreadable += _EVENT.fullmatch(stamped["event"]) is None
    if is_cut:
        raise ValueError("its last line is cut off")


class _AscHeader:
    """What the header says of numbers and times, and the time of the line before."""

    def __init__(self, times: clock.StatedTimes) -> None:
        self._times, times.is_of_this_zone = times, True
        self.base = 16
        self._relative = self._counts_from_midnight = False
        self._began: Stamp | None = None
        self._first: Stamp | None = None  # the header's date, from which the stamps of later blocks may count on
        self._last_ns: int | None = None
        self._days = 0  # midnights that times of day have passed

    def read(self, text: str) -> bool:
        """Take up a line of the header, or of a trigger block; whether it is one."""
        words = text.lower().split()
        if words[:1] == ["base"]:
            self.base = 10 if words[1:2] == ["dec"] else 16
            self._relative = words[2:4] == ["timestamps", "relative"]
            return True
        if words[:1] == ["date"] or words[:2] in (["begin", "triggerblock"], ["begin", "trigger"]):
            self._times.read_time_prefix(text)
            self._began = self._times.last or self._began
            self._first = self._first or self._began
            self._last_ns, self._days = None, 0
            return True
        return _SECTION.fullmatch(text) is not None

    def time_ns(self, stamped: re.Match[str]) -> int:
        """The line's time: UTC where the log has a date, else since its beginning."""
        fraction_ns = int((stamped["fraction"] or "").ljust(9, "0"))
        stated_ns = int(stamped["seconds"]) * NANO + (-fraction_ns if stamped["seconds"][0] == "-" else fraction_ns)
        is_first, before_ns = self._last_ns is None, self._last_ns or 0
        self._last_ns = stated_ns + before_ns if self._relative else stated_ns
        if self._began is None:
            return self._last_ns
        if is_first and not self._relative:
            assert self._first is not None
            later_ns = self._local_ns(self._began) - self._local_ns(self._first)
            if later_ns >= _LATER_BLOCK_NS and -_ROUNDED_NS <= stated_ns - later_ns <= _DAY_BEGAN_WITHIN_NS:
                self._began = self._first
            since_ns = (stated_ns - self._began.clock_ns) % DAY_NS
            is_past_first_hour = stated_ns >= _EARLIEST_TIME_OF_DAY_NS
            self._counts_from_midnight = is_past_first_hour and since_ns <= _DAY_BEGAN_WITHIN_NS
            if self._counts_from_midnight:
                self._times.remark = "its stamps are times of day: they count from midnight of its date"
        if self._counts_from_midnight and before_ns - stated_ns > DAY_NS // 2:
            self._days += 1
        began_ns = self._local_ns(self._began) + self._days * DAY_NS
        if self._began.offset_s is not None:
            began_ns -= self._began.offset_s * NANO
        else:  # this machine's zone
            seconds, fraction_ns = divmod(began_ns, NANO)
            local = dt.datetime.fromtimestamp(seconds, dt.UTC).replace(tzinfo=None).astimezone()
            began_ns = round(local.timestamp()) * NANO + fraction_ns
        return self._last_ns + (began_ns - self._began.clock_ns if self._counts_from_midnight else began_ns)

    def _local_ns(self, stamp: Stamp) -> int:
        return stamp.local_ns(self._times.date_order_of(stamp))


def _parse_event(text: str, base: int) -> LogEntry | None:
    """The frame in what follows a stamp, as yet without its time."""
    if match := _ERROR.fullmatch(text):
        return LogEntry(None, b"", 0, can_flags(is_standard=True, error=True), bus=f"channel{match['channel']}")
    match = _FRAME.fullmatch(text) or _FD_FRAME.fullmatch(text)
    if match is None:
        return None
    parts = match.groupdict()
    remote = (parts.get("kind") or "d").lower() == "r"
    # codes beyond 8 mean 8 on classical CAN
    length = min(int(parts["length"] or "0", 16), 8) if "kind" in parts else int(parts["length"])
    numbers = [] if remote else parts["data"].split()[:length]
    try:
        identifier, data = int(parts["id"], base), bytes(int(number, base) for number in numbers)
    except ValueError:  # digits of another base, or bytes beyond 255
        return None
    extended, is_complete = bool(parts["extended"]), remote or len(numbers) == length <= _MOST_BYTES
    if not is_complete or identifier > (HIGHEST_IDENTIFIER if extended else 0x7FF):
        return None
    flags: FrameFlag = can_flags(not extended, remote)
    return LogEntry(None, data, identifier, flags, bus=f"channel{parts['channel']}")


_BLOCK_BYTES = 8192
_LONGEST_PACKET = 65_536
_LONGEST_RECORD = 4096
_CUT_RECORD = "its last record is cut off"
_SERVICE = 0xFFFFFFFF  # in the place of an identifier, in Yacht Devices' files


def read_lines(file: BinaryIO, reader: LineReader) -> Iterator[LogEntry]:
    """Lines of text, and Actisense's messages as a program wrote them to a file."""
    cutter = StreamCutter()
    while block := file.read(_BLOCK_BYTES):
        yield from reader.entries(cutter.push(block))
    for entry in reader.entries(cutter.end()):
        if reader.may_be_cut(entry):
            raise ValueError("its last line is cut off")
        yield entry


_EBL_PART = re.compile(
    rb"\x1b\x01(?P<tag>(?:[^\x1b]|\x1b\x1b)*+)\x1b\n|(?P<data>(?:[^\x1b]|\x1b\x1b)++)|\x1b[^\x01\x1b]", re.DOTALL
)
_FILETIME_1970 = 116_444_736_000_000_000  # 100 ns since 1601


def read_ebl(file: BinaryIO, reader: LineReader) -> Iterator[LogEntry]:
    """Actisense's log: the bytes of a gateway between tags, one of which states the time of what follows."""
    cutter, time_ns, data = StreamCutter(), None, b""
    while block := file.read(_BLOCK_BYTES):
        data, at = data + block, 0
        while match := _EBL_PART.match(data, at):
            at = match.end()
            tag, raw = ((match[name] or b"").replace(b"\x1b\x1b", b"\x1b") for name in ("tag", "data"))
            if tag[:1] == b"\x03" and len(tag) == 9:
                stated_ns = (int.from_bytes(tag[1:], "little") - _FILETIME_1970) * 100
                time_ns = stated_ns if clock.is_possible_time(stated_ns) else time_ns
            if tag[:1] == b"\x07":  # a message, which some programs write without the checksum
                missing = -sum(tag[1:]) & 0xFF
                pieces = [MARK + tag[1:] + (bytes([missing]) if missing else b"")]
            else:
                pieces = cutter.push(raw)
            for entry in reader.entries(pieces):
                yield entry if time_ns is None else entry._replace(time_ns=time_ns, turn_ns=0)
            reader.unreadable += not tag and not raw
        if len(data) - at > _LONGEST_RECORD:  # a tag without an end
            reader.unreadable, at = reader.unreadable + 1, at + 2
        data = data[at:]
    pieces = cutter.end()
    yield from reader.entries(pieces)
    if data or any(piece.startswith(MARK) for piece in pieces):
        raise ValueError(_CUT_RECORD)


# The groups that Yacht Devices' recorder keeps as whole messages of any length; the others have 8 bytes.
_ASSEMBLED_GROUPS = frozenset(
    group
    for begin, end in (
        (65240, 65240), (126208, 126208), (126464, 126464), (126720, 126720), (126983, 126988), (126996, 126998),
        (127233, 127233), (127237, 127237), (127489, 127489), (127496, 127498), (127503, 127504), (127506, 127507),
        (127509, 127514), (128275, 128275), (128520, 128520), (129029, 129029), (129038, 129041), (129044, 129045),
        (129284, 129285), (129301, 129302), (129538, 129538), (129540, 129542), (129545, 129545), (129547, 129547),
        (129549, 129549), (129551, 129551), (129556, 129556), (129792, 129810), (130052, 130054), (130060, 130061),
        (130064, 130074), (130320, 130324), (130567, 130567), (130577, 130578), (130816, 131071),
    )
    for group in range(begin, end + 1)
)  # fmt: skip
_REQUEST, _REQUEST_BYTES = 59904, 3
_MINUTE_NS = 60 * NANO


def read_ydvr(file: BinaryIO, reader: LineReader) -> Iterator[LogEntry]:
    """The .DAT files of Yacht Devices' recorder up to version 4: messages of any length, ms in the minute."""
    data, at = b"", 0
    while True:
        if len(data) - at < _LONGEST_RECORD and (block := file.read(_BLOCK_BYTES)):
            data, at = data[at:] + block, 0
        if at == len(data):
            return
        record = _parse_ydvr_record(data, at)
        if record is None:
            if len(data) - at < 6 + 2 + 255:
                raise ValueError(_CUT_RECORD)
            reader.unreadable, at = reader.unreadable + 1, _next_ydvr_record_after_damage(data, at + 1)
            continue
        entry, at = record
        if entry is not None:
            yield entry


def _parse_ydvr_record(data: bytes, at: int) -> tuple[LogEntry | None, int] | None:
    """The record at a place, and where the next one begins; None where there is none."""
    if len(data) < at + 6:
        return None
    milliseconds, identifier = struct.unpack_from("<HI", data, at)
    if milliseconds >= 60_000 or not (identifier == _SERVICE or identifier <= HIGHEST_IDENTIFIER):
        return None
    group, body = nmea2000.split_can_identifier(identifier)[0], at + 6
    length = _REQUEST_BYTES if group == _REQUEST and identifier != _SERVICE else 8
    if assembled := identifier != _SERVICE and group in _ASSEMBLED_GROUPS:
        if len(data) < body + 2:
            return None
        body, length = body + 2, data[body + 1]
    if len(data) < body + length:
        return None
    if identifier == _SERVICE:
        return None, body + length
    flags = FrameFlag.WHOLE if assembled else FrameFlag.NONE
    payload = data[body : body + length]
    return LogEntry(milliseconds * MILLI_NS, payload, identifier, flags, turn_ns=_MINUTE_NS), body + length


def _next_ydvr_record_after_damage(data: bytes, at: int) -> int:
    """Where, after damage, three records follow each other again; the end where they never do."""
    for start in range(at, len(data)):
        place = start
        for _ in range(3):
            record = _parse_ydvr_record(data, place)
            if record is None:
                break
            place = record[1]
        else:
            return start
    return len(data)


_YD_CAN_TURN_NS = 1024 * _MINUTE_NS


def read_yd_can(file: BinaryIO, reader: LineReader) -> Iterator[LogEntry]:
    """The .CAN files of Yacht Devices' recorders and gateways: frames in records of 16 bytes, minutes and ms."""
    while record := file.read(16):
        if len(record) < 16:
            raise ValueError(_CUT_RECORD)
        head, milliseconds, identifier = struct.unpack_from("<HHI", record)
        if identifier == _SERVICE:
            continue
        standard = bool(head & 0x8000)
        if milliseconds >= 60_000 or identifier > (0x7FF if standard else HIGHEST_IDENTIFIER):
            reader.unreadable += 1
            continue
        time_ns, data = ((head & 0x3FF) * 60_000 + milliseconds) * MILLI_NS, record[8 : 9 + (head >> 11 & 7)]
        yield LogEntry(time_ns, data, identifier, can_flags(standard), turn_ns=_YD_CAN_TURN_NS)


_SOCKETCAN, _COOKED, _COOKED_2 = _CAN_LINKS = 227, 113, 276  # link types
_CAN_PROTOCOLS = (0x000C, 0x000D)
_ETHERNET = 1
_IP_LINKS = _ETHERNET, 12, 14, 101, 228  # the others have IP without a head of their own
_LINKS = *_CAN_LINKS, *_IP_LINKS
_IP, _VLANS = (b"\x08\0", b"\x86\xdd"), (b"\x81\0", b"\x88\xa8")
_MOST_STREAMS = 500
_MOST_FOREIGN_BYTES = 65_536  # of a stream without a line that is known: of another protocol
_NOTHING_CAPTURED = "no packet of the capture has a CAN frame, or lines in a datagram of UDP or a stream of TCP"
_IF_NAME, _IF_TSRESOL, _IF_TSOFFSET = 2, 9, 14  # options of an interface


class _Packet(NamedTuple):
    """A captured packet, its link type, its time, and the name of its interface if it has one."""

    data: bytes
    link: int
    time_ns: int
    interface: str = ""


def read_capture(
    packets_of: Callable[[BinaryIO], Iterator[_Packet]], file: BinaryIO, reader: LineReader
) -> Iterator[LogEntry]:
    """What tcpdump and Wireshark capture of SocketCAN, or of datagrams and streams in a network."""
    is_empty, network = True, CapturedNetwork(reader)
    for packet in packets_of(file):
        for entry in _parse_captured_packet(packet, network):
            is_empty = False
            yield entry
    rest = list(network.end())
    yield from rest
    if is_empty and not rest:
        raise ValueError(_NOTHING_CAPTURED)


def _pcap_packets(file: BinaryIO) -> Iterator[_Packet]:
    """The packets of the older form."""
    head = file.read(24)
    order = "<" if head[:4] in (b"\xd4\xc3\xb2\xa1", b"\x4d\x3c\xb2\xa1") else ">"
    finest_ns = 1 if head[:4] in (b"\x4d\x3c\xb2\xa1", b"\xa1\xb2\x3c\x4d") else 1000
    link = struct.unpack(f"{order}I", head[20:24].ljust(4, b"\0"))[0] & 0xFFFF
    _check_link_type(link)
    while record := file.read(16):
        seconds, fraction, length, _ = struct.unpack(f"{order}IIII", record) if len(record) == 16 else (0, 0, -1, 0)
        packet = file.read(length) if 0 <= length <= _LONGEST_PACKET else b""
        if len(packet) != length:
            raise ValueError(_CUT_RECORD)
        yield _Packet(packet, link, seconds * NANO + fraction * finest_ns)


def _pcapng_packets(file: BinaryIO) -> Iterator[_Packet]:
    """The packets of the newer form: blocks, some that describe an interface and others with a packet of one."""
    order, links = "<", list[tuple[int, int, int, str]]()
    while start := file.read(8):
        if start[:4] == b"\n\r\r\n":
            magic = file.read(4)
            order, links = ("<" if magic == b"\x4d\x3c\x2b\x1a" else ">"), []
        else:
            magic = b""
        kind, length = struct.unpack(f"{order}II", start) if len(start) == 8 else (0, 0)
        body = file.read(length - 8 - len(magic)) if 12 <= length <= 2**24 else b""
        if len(body) != length - 8 - len(magic) or length < 12:
            raise ValueError(_CUT_RECORD)
        if kind == 1:
            links.append(_parse_interface(body, order, len(links)))
        elif kind == 6 and len(body) >= 24:
            interface, high, low, captured = struct.unpack_from(f"{order}IIII", body)
            if interface < len(links):
                link, ticks, offset_s, name = links[interface]
                time_ns = (high << 32 | low) * NANO // ticks + offset_s * NANO
                yield _Packet(body[20 : 20 + captured], link, time_ns, name)
    if not any(link in _LINKS for link, *_ in links):
        _check_link_type(links[0][0] if links else 0)


def _parse_interface(body: bytes, order: str, number: int) -> tuple[int, int, int, str]:
    """An interface's link type, the ticks of its clock a second, what its times count from [s], and its name."""
    data, options, at = body[8:-4], dict[int, bytes](), 0  # options by their codes, the first of each
    while at + 4 <= len(data):
        code, length = struct.unpack_from(f"{order}HH", data, at)
        options.setdefault(code, data[at + 4 : at + 4 + length])
        at += 4 + length + -length % 4
    name = options.get(_IF_NAME, b"").rstrip(b"\0").decode("utf-8", "replace") or f"interface{number}"
    resolution, ticks = options.get(_IF_TSRESOL, b""), 1_000_000
    if len(resolution) == 1:
        ticks = 2 ** (resolution[0] & 0x7F) if resolution[0] & 0x80 else 10 ** min(resolution[0], 18)
    offset = options.get(_IF_TSOFFSET, b"")
    offset_s = struct.unpack(f"{order}q", offset)[0] if len(offset) == 8 else 0
    return struct.unpack_from(f"{order}H", body)[0], ticks, offset_s, name


def _check_link_type(link: int) -> None:
    if link not in _LINKS:
        raise ValueError(
            f"it is a capture of link type {link}, which has no CAN frames ({_SOCKETCAN} does) and no datagrams"
            f" ({_ETHERNET} does)"
        )


def _parse_captured_packet(captured: _Packet, network: CapturedNetwork) -> Iterator[LogEntry]:
    """The CAN frame or the lines in a captured packet; those of other protocols are passed over.

    Of what was captured on all interfaces at once the packet itself says which it came by.
    """
    packet, link, time_ns, bus = captured
    if link in (_COOKED, _COOKED_2):
        skip, place = (16, 14) if link == _COOKED else (20, 0)
        protocol = packet[place : place + 2]
        if protocol in _IP:
            yield from network.entries(packet[skip:], time_ns)
        if int.from_bytes(protocol, "big") not in _CAN_PROTOCOLS:
            return
        bus = f"interface{int.from_bytes(packet[4:8], 'big')}" if link == _COOKED_2 else bus
        packet = packet[skip:]
    elif link in _IP_LINKS:
        at = 14 if link == _ETHERNET else 0
        while link == _ETHERNET and packet[at - 2 : at] in _VLANS:
            at += 4
        if link != _ETHERNET or packet[at - 2 : at] in _IP:
            yield from network.entries(packet[at:], time_ns)
        return
    elif link != _SOCKETCAN:
        return
    if len(packet) < 8 or len(packet) < 8 + packet[4] or packet[4] > 64:
        network.reader.unreadable += 1
        return
    identifier = int.from_bytes(packet[:4], "big")
    extended, remote, error = (bool(identifier & bit) for bit in (0x80000000, 0x40000000, 0x20000000))
    data = b"" if remote else packet[8 : 8 + packet[4]]
    flags = can_flags(not extended, remote, error)
    yield LogEntry(time_ns, data, identifier & HIGHEST_IDENTIFIER, flags, bus=bus)


class _CapturedStream:
    """One direction of a connection of TCP: its order, its lines, and whether any of them was known."""

    def __init__(self, sender: str) -> None:
        self.sender, self.order, self.cutter = sender, StreamOrder(), StreamCutter()
        self.is_known, self.count_bytes, self.time_ns = False, 0, 0


class CapturedNetwork:
    """The lines in the datagrams of UDP and the streams of TCP of a capture; a sender stands for its bus.

    A line of a stream has the time of the packet that ends it. Streams of other protocols are passed over.
    """

    def __init__(self, reader: LineReader) -> None:
        self.reader = reader
        self._streams: dict[bytes, _CapturedStream] = {}

    def entries(self, captured: bytes, time_ns: int) -> Iterator[LogEntry]:
        """What a packet of IPv4 or IPv6 completes."""
        packet = parse_packet(captured)
        if packet is None:
            return
        if packet.stream:
            yield from self._entries_of_stream(packet, time_ns)
        elif packet.is_fragment:
            self.reader.unreadable += 1
        else:
            yield from self._entries_of_datagram(packet, time_ns)

    def end(self) -> Iterator[LogEntry]:
        """What is left of the streams at the end of the capture."""
        while self._streams:
            yield from self._end_stream(next(iter(self._streams)))

    def _entries_of_datagram(self, packet: IpPacket, time_ns: int) -> Iterator[LogEntry]:
        """The lines in a datagram; of one that was cut, or sent in fragments, those that are whole."""
        cutter = StreamCutter()
        pieces = cutter.push(packet.payload)
        self.reader.unreadable += packet.is_cut
        for entry in self.reader.entries(pieces if packet.is_cut else [*pieces, *cutter.end()]):
            yield entry._replace(time_ns=time_ns, turn_ns=0, bus=packet.sender)

    def _entries_of_stream(self, packet: IpPacket, time_ns: int) -> Iterator[LogEntry]:
        if packet.is_start:
            yield from self._end_stream(packet.stream)
        stream = self._streams.get(packet.stream)
        if stream is None:
            if len(self._streams) >= _MOST_STREAMS:
                yield from self._end_stream(next(iter(self._streams)))
            stream = self._streams[packet.stream] = _CapturedStream(packet.sender)
        if stream.is_known or stream.count_bytes < _MOST_FOREIGN_BYTES:
            stream.time_ns = time_ns
            stream.count_bytes += len(packet.payload)
            data, has_gap = stream.order.push(packet)
            yield from self._lines(stream, data, has_gap)
        if packet.is_end:
            yield from self._end_stream(packet.stream)

    def _end_stream(self, key: bytes) -> Iterator[LogEntry]:
        if (stream := self._streams.pop(key, None)) is not None:
            while data := stream.order.skip_gap():
                yield from self._lines(stream, data, has_gap=True)
            yield from self._known(stream, stream.cutter.end())

    def _lines(self, stream: _CapturedStream, data: bytes, has_gap: bool) -> Iterator[LogEntry]:
        if has_gap:
            stream.cutter.cut()
            self.reader.unreadable += stream.is_known
        yield from self._known(stream, stream.cutter.push(data))

    def _known(self, stream: _CapturedStream, pieces: Sequence[bytes]) -> Iterator[LogEntry]:
        """The entries of lines; those that are not known count from the first that is."""
        unreadable = self.reader.unreadable
        for entry in self.reader.entries(pieces):
            stream.is_known = True
            yield entry._replace(time_ns=stream.time_ns, turn_ns=0, bus=stream.sender)
        if not stream.is_known:
            self.reader.unreadable = unreadable


class FileForm(NamedTuple):
    """What the first bytes of a file look like, and how it is read."""

    begins: Callable[[bytes], bool]
    read: Callable[[BinaryIO, LineReader], Iterator[LogEntry]]


_PCAP = (b"\xd4\xc3\xb2\xa1", b"\xa1\xb2\xc3\xd4", b"\x4d\x3c\xb2\xa1", b"\xa1\xb2\x3c\x4d")
FILE_FORMS: dict[str, FileForm] = {
    "ebl": FileForm(lambda head: head.startswith(b"\x1b\x01"), read_ebl),
    "ydvr": FileForm(lambda head: head[6:10] == b"YDVR", read_ydvr),
    "yd_can": FileForm(lambda head: head[8:12] == b"YDVR", read_yd_can),
    "pcap": FileForm(lambda head: head.startswith(_PCAP), partial(read_capture, _pcap_packets)),
    "pcapng": FileForm(lambda head: head.startswith(b"\n\r\r\n"), partial(read_capture, _pcapng_packets)),
    "asc": FileForm(lambda head: _BEGINS_ASC.match(head.removeprefix(b"\xef\xbb\xbf")) is not None, read_asc),
}
"""Files that are read as a whole by their names; those of python-can are in ``log_file.py``."""
