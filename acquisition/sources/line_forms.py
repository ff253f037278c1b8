"""Lines of text as gateways send them and logs keep them, to CAN frames, whole messages and sentences.

A form is a pattern and a small function from what it matched to an entry, listed in :data:`LINE_FORMS`. Times are
as the line tells them: UTC, since the log began (before 2001), or a clock that comes round (``turn_ns``).
"""

from __future__ import annotations

import base64
import binascii
import datetime as dt
import re
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import chain
from typing import NamedTuple

from seatrial.acquisition.core.frames import HIGHEST_IDENTIFIER, NANO, FrameFlag, Protocol, can_flags
from seatrial.acquisition.decoders.clock import DAY_NS
from seatrial.acquisition.decoders.nmea0183 import checksum, cut_at_sentences, has_sentence, sentences_in, split_tag
from seatrial.acquisition.decoders.told_time import (
    SENTENCE_BEHIND,
    ZONE,
    StatedTimes,
    day_ns,
    possible_ns,
    zoned_ns,
)
from seatrial.acquisition.sources.actisense import MARK, Stored, message_entry, stored_message

MILLI_NS = 1_000_000
_MOST_BYTES = 64  # of a frame of CAN FD
_LONGEST_MESSAGE = 1785  # bytes, of ISO 11783's transport protocol
_ERROR_BIT = 0x20000000  # candump marks error frames by a bit above the 29 of the identifier


_pattern = partial(re.compile, flags=re.ASCII)  # what is no ASCII is no space and no digit


class LogEntry(NamedTuple):
    """One frame, whole message or sentence, with the time that its line tells, if any.

    A clock that starts anew every ``turn_ns`` (at midnight, after 2^32 ms) tells how much of the turn is over.
    ``bus`` is the interface or channel of a log that has several.
    """

    time_ns: int | None
    payload: bytes
    identifier: int = 0
    flags: FrameFlag = FrameFlag.NONE
    protocol: Protocol = "can"
    turn_ns: int = 0
    bus: str = ""


def message(
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


def _header(match: re.Match[str], base: int = 10) -> tuple[int, int, int, int]:
    """Priority, group, source and destination of a message, 0 for what its line does not tell."""
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


def _candump_log(match: re.Match[str]) -> LogEntry | None:
    remote = match["data"].startswith("R")
    data = b"" if remote else bytes.fromhex(match["data"].replace(".", ""))
    return _frame(match["time"], match["id"], data, remote, match["bus"])


def _candump_console(match: re.Match[str]) -> LogEntry | None:
    fields = match.groupdict()
    remote = fields.get("remote") is not None
    data = _console_bytes(fields["data"] or "")
    if not remote and len(data) != int(fields["length"]):
        return None
    return _frame(fields.get("time"), fields["id"], data, remote, fields.get("bus") or "")


def _console_bytes(text: str) -> bytes:
    """Bytes as candump prints them: hexadecimal, binary (``-i``), or the last one first (``-S``)."""
    swapped = "`" in text
    parts = text.replace("`", " ").split()
    base = 2 if parts and len(parts[0]) == 8 else 16
    data = bytes(int(part, base) for part in parts)
    return data[::-1] if swapped else data


def _frame(time: str | None, identifier: str, data: bytes, remote: bool, bus: str) -> LogEntry | None:
    time_ns = None if time is None else _candump_time_ns(time)
    if len(data) > _MOST_BYTES or (time is not None and time_ns is None):
        return None
    number = int(identifier, 16)
    flags = can_flags(len(identifier) == 3, remote, bool(number & _ERROR_BIT))
    return LogEntry(time_ns, data, number & HIGHEST_IDENTIFIER, flags, bus=bus)


_SAVVYCAN = _pattern(
    r"(?P<time>\d{1,19}),(?P<id>[0-9A-Fa-f]{1,8}),(?P<extended>true|false),(?:(?P<direction>[RT]x),)?(?P<bus>\d+),"
    r"(?P<length>\d{1,2}),(?P<data>(?:[0-9A-Fa-f]{2},?){0,64}),*"
)


def _savvycan(match: re.Match[str]) -> LogEntry | None:
    """A row of SavvyCAN's table: microseconds since 1970 or since the log began, the frame's bytes in columns."""
    data, identifier = bytes.fromhex(match["data"].replace(",", "")), int(match["id"], 16)
    if len(data) != int(match["length"]):
        return None
    flags = can_flags(match["extended"] == "false")
    bus = f"channel{match['bus']}"
    return LogEntry(1000 * int(match["time"]), data, identifier & HIGHEST_IDENTIFIER, flags, bus=bus)


_DATE_TIME = _pattern(r"(\d{4}-\d\d-\d\d)[ T](\d\d:\d\d:\d\d)(?:\.(\d{1,9}))?(Z|[+-]\d\d(?::?\d\d)?)?")


def _candump_time_ns(text: str) -> int | None:
    """Seconds, or a date and time, in this machine's zone (as of candump) if it has none; None for others."""
    if "-" in text:
        match = _DATE_TIME.fullmatch(text)
        return None if match is None else zoned_ns(match[1], match[2], match[3], match[4], None)
    seconds, _, fraction = text.partition(".")
    if not seconds.isdigit() or (fraction and not fraction.isdigit()) or len(seconds) > 10:
        return None
    return int(seconds) * NANO + int(fraction[:9].ljust(9, "0"))


_CANBOAT = _pattern(
    r"(?P<date>\d{4}-\d\d-\d\d)[-T ](?P<clock>\d\d:\d\d:\d\d)(?:[.,](?P<fraction>\d{1,9}))?"
    rf"{ZONE},(?P<priority>[0-7]),(?P<group>\d{{1,6}}),"
    r"(?P<source>\d{1,3}),(?P<destination>\d{1,3}),(?P<length>\d{1,4})(?P<data>(?:,[0-9A-Fa-f]{2})*),?\s*"
)


def _canboat(match: re.Match[str]) -> LogEntry | None:
    """Where it has more than 8 bytes canboat has put it together; one of 8 may be part of a longer message."""
    data = bytes.fromhex(match["data"].replace(",", ""))
    time_ns = zoned_ns(match["date"], match["clock"], match["fraction"], match["zone"], dt.UTC)
    if time_ns is None or len(data) != int(match["length"]):
        return None
    return message(_header(match), data, time_ns, assembled=len(data) > 8)


_YACHT_DEVICES = _pattern(
    r"(?:(?P<clock>\d\d:\d\d:\d\d)(?:\.(?P<fraction>\d{1,9}))?\s+[RT]\s+)?"
    r"(?P<id>[0-9A-Fa-f]{8})(?P<data>(?:\s+[0-9A-Fa-f]{2}){1,8})\s*"
)


def _yacht_devices(match: re.Match[str]) -> LogEntry | None:
    """``17:33:21.107 R 19F51323 01 2F 30 70 00 2F 30 70``, and of some devices without time and direction."""
    time_ns = day_ns(match["clock"], match["fraction"]) if match["clock"] else None
    number = int(match["id"], 16)
    if number > HIGHEST_IDENTIFIER or (match["clock"] and time_ns is None):
        return None
    return LogEntry(time_ns, bytes.fromhex(match["data"]), number, turn_ns=DAY_NS)


_N2K_ASCII = _pattern(
    r"(?:A(?P<clock>\d{6})(?:\.(?P<fraction>\d{1,9}))?\s+)?"
    r"(?P<source>[0-9A-Fa-f]{2})(?P<destination>[0-9A-Fa-f]{2})(?P<priority>[0-9A-Fa-f])\s+"
    r"(?P<group>[0-9A-Fa-f]{5,6})\s+(?P<data>(?:[0-9A-Fa-f]{2})+)(?:\s.*)?"
)


def _n2k_ascii(match: re.Match[str]) -> LogEntry | None:
    """``A173321.107 23FF7 1F513 012F3070002F30709F``: whole messages of an Actisense gateway."""
    time_ns = day_ns(match["clock"], match["fraction"]) if match["clock"] else None
    if match["clock"] and time_ns is None:
        return None
    return message(_header(match, 16), bytes.fromhex(match["data"]), time_ns, DAY_NS)


_IKONVERT = _pattern(
    r"!PDGY,(?P<group>\d{1,6}),(?:(?P<priority>[0-7]),(?P<source>\d{1,3}),)?(?P<destination>\d{1,3}),"
    r"(?:(?P<seconds>\d{0,9})(?:\.(?P<fraction>\d{1,9}))?,)?(?P<data>[A-Za-z0-9+/]+={0,2})\s*"
)


def _ikonvert(match: re.Match[str]) -> LogEntry | None:
    """Digital Yacht's, with the seconds since the gateway started; of what is sent to it they are not told."""
    try:
        data = base64.b64decode(match["data"], validate=True)
    except binascii.Error:
        return None
    fraction_ns = int((match["fraction"] or "").ljust(9, "0"))
    time_ns = int(match["seconds"]) * NANO + fraction_ns if match["seconds"] else None
    return message(_header(match), data, time_ns)


_SEASMART = _pattern(
    r"\$PCDIN,(?P<group>[0-9A-Fa-f]{6}),(?P<time>[0-9A-Va-v]{1,8})!?,(?P<source>[0-9A-Fa-f]{2}),"
    r"(?P<data>(?:[0-9A-Fa-f]{2})+)\*(?P<sum>[0-9A-Fa-f]{2})\s*"
)
_SEASMART_EPOCH_NS = 1_262_304_000 * NANO  # 2010
_LONGEST_UPTIME_MS = 0x80000000


def _seasmart(match: re.Match[str]) -> LogEntry | None:
    """SeaSmart's and what followed it. Its time is of one of two kinds, which the protocol does not tell apart.

    Devices write milliseconds since they started, hexadecimal; the original 1/1024 s since 2010 to the base of 32,
    which begin with 8 or more since 2018: a device that has been on for 25 days is taken for one.
    """
    if not _is_sound(match):
        return None
    header = 0, int(match["group"], 16), int(match["source"], 16), 255
    digits, turn_ns = match["time"], 2**32 * MILLI_NS
    if max(digits.upper()) <= "F" and int(digits, 16) < _LONGEST_UPTIME_MS:
        time_ns = int(digits, 16) * MILLI_NS
    else:
        time_ns, turn_ns = _SEASMART_EPOCH_NS + int(digits, 32) * NANO // 1024, 0
    return message(header, bytes.fromhex(match["data"]), time_ns, turn_ns)


_MXPGN = _pattern(
    r"\$[A-Z]{2}PGN,(?P<group>[0-9A-Fa-f]{6}),(?P<attribute>[0-9A-Fa-f]{4}),"
    r"(?P<data>(?:[0-9A-Fa-f]{2})+)\*(?P<sum>[0-9A-Fa-f]{2})\s*"
)


def _mxpgn(match: re.Match[str]) -> LogEntry | None:
    """ShipModul's: a CAN frame, its data as one number, so that the last byte comes first; some put them together.

    What a program sends to the bus bears a bit, and an address that is the receiver's; the sender's is not told.
    """
    attribute, group = int(match["attribute"], 16), int(match["group"], 16)
    data, address = bytes.fromhex(match["data"])[::-1], attribute & 0xFF
    if not _is_sound(match) or (len(data) <= 8 and len(data) != min(attribute >> 8 & 0xF, 8)):
        return None
    source, destination = (0, address) if attribute & 0x8000 else (address, 255)
    if (group >> 8) & 0xFF < 240:
        group, destination = group & 0x3FF00, group & 0xFF or destination
    return message((attribute >> 12 & 7, group, source, destination), data, None, assembled=len(data) > 8)


def _is_sound(match: re.Match[str]) -> bool:
    body = match.string[1 : match.string.rindex("*")]
    return checksum(body.encode("latin-1")) == int(match["sum"], 16)


_GARMIN = _pattern(
    r"\d+,(?P<time>\d+|(?:\d+_){6}\d+),(?P<group>\d{1,6}),.*,(?P<source>\d{1,3}),(?P<destination>\d{1,3}),"
    r"(?P<priority>[0-7]),[01],(?P<length>\d{1,3}),0x(?P<data>(?:[0-9A-Fa-f]{2})+)\s*"
)


def _garmin(match: re.Match[str]) -> LogEntry | None:
    """A chart plotter's log: milliseconds since it started, or ``month_day_year_hour_minute_second_ms``."""
    data, numbers = bytes.fromhex(match["data"]), match["time"].split("_")
    if len(data) != int(match["length"]):
        return None
    time_ns: int | None = int(numbers[0]) * MILLI_NS
    if len(numbers) > 1:
        month, day, year, hour, minute, second, milli = map(int, numbers)
        clock = f"{hour:02d}:{minute:02d}:{second:02d}"
        time_ns = zoned_ns(f"{year:04d}-{month:02d}-{day:02d}", clock, f"{milli % 1000:03d}", None, dt.UTC)
    return None if time_ns is None else message(_header(match), data, time_ns)


_OPENCPN_MESSAGE = _pattern(r"(?:\$PCDIN,\d+,)?(?P<data>93(?:[0-9A-Fa-f]{2}){12,})\s*")


def _opencpn(match: re.Match[str]) -> LogEntry | None:
    """A message as OpenCPN keeps it: as Actisense's gateway gives it, whose time it fills in as it likes."""
    stored = message_entry(bytes.fromhex(match["data"]))
    return None if stored is None else message(stored.header, stored.payload, None)


Read = Callable[[re.Match[str]], LogEntry | None]
LINE_FORMS: dict[str, tuple[tuple[re.Pattern[str], Read], ...]] = {
    "candump": (
        (_CANDUMP_LOG, _candump_log),
        (_CANDUMP_CONSOLE, _candump_console),
        (_CANDUMP_OLD, _candump_console),
    ),
    "savvycan": ((_SAVVYCAN, _savvycan),),
    "canboat": ((_CANBOAT, _canboat),),
    "yacht_devices": ((_YACHT_DEVICES, _yacht_devices),),
    "n2k_ascii": ((_N2K_ASCII, _n2k_ascii),),
    "ikonvert": ((_IKONVERT, _ikonvert),),
    "seasmart": ((_SEASMART, _seasmart),),
    "mxpgn": ((_MXPGN, _mxpgn),),
    "garmin": ((_GARMIN, _garmin),),
    "opencpn": ((_OPENCPN_MESSAGE, _opencpn),),
}
"""Each form of a line by its name, with what it looks like and how it is read."""

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


def parts_of(piece: bytes) -> list[bytes]:
    """A line or message in parts of one entry each: cut where a gateway's message stands among sentences."""
    if piece.startswith(MARK) or not _PACKED.search(piece):
        return [piece]
    return cut_at_sentences(piece) if len(sentences_in(piece)) > 1 else [piece]


class LineReader:
    """Lines, and Actisense's messages, to entries: of one form, or of any, as each line shows.

    ``unreadable`` counts those that are neither an entry nor a comment.
    """

    def __init__(self, form: str = "", times: StatedTimes | None = None) -> None:
        self.unreadable = 0
        self.times = times or StatedTimes()
        self._forms = [line_form for name, forms in LINE_FORMS.items() if form in ("", name) for line_form in forms]

    def entries(self, pieces: Sequence[bytes]) -> Iterator[LogEntry]:
        """The entries in lines and messages, each read when it is asked for."""
        has_packed = _PACKED.search(b"\n".join(pieces)) is not None  # asked once: lines are many
        parts = chain.from_iterable(map(parts_of, pieces)) if has_packed else pieces
        return filter(None, map(self.entry, parts))

    def entry(self, piece: bytes) -> LogEntry | None:
        """The entry in a line or a message, if there is one; of a line that :func:`parts_of` leaves as it is."""
        if piece.startswith(MARK) and (stored := stored_message(piece[len(MARK) :])) is not None:
            return _of_stored(stored)
        text = piece.decode("latin-1")
        return self._sentence(text) if text.startswith(_BEGINNINGS) else self._line(text)

    def _sentence(self, text: str) -> LogEntry | None:
        """A line that begins as a sentence does; some have a message of NMEA 2000 inside, or a time behind."""
        if text[-3:-2] != "*" and (match := _ENDING.fullmatch(text)):
            return _at(self._sentence(match["inner"]), self.times.read(match["after"]))
        line = text.encode("latin-1")
        tagged = split_tag(line)
        if tagged.sentence[3:7] == b"PGN," or tagged.sentence.startswith((b"$PCDIN,", b"!PDGY,")):
            entry = self._bare(tagged.sentence.decode("latin-1"))
            if entry is None:
                return self._disturbed(line)
            return _at(entry, None if tagged.time_ns is None else (possible_ns(tagged.time_ns), 0))
        return (
            None if _NO_ENTRY.fullmatch(text) else LogEntry(possible_ns(tagged.time_ns), line, protocol="nmea0183")
        )

    def _line(self, text: str) -> LogEntry | None:
        if "\x1b" in text:
            text = _COLOUR.sub("", text).strip()
        entry = self._bare(text) or self._enveloped(text)
        return entry if entry is not None or _NO_ENTRY.fullmatch(text) else self._disturbed(text.encode("latin-1"))

    def _disturbed(self, line: bytes) -> LogEntry | None:
        """A line of no form, for the sentences that are in it all the same."""
        if has_sentence(line):
            return LogEntry(None, line, protocol="nmea0183")
        self.unreadable += 1
        return None

    def _bare(self, text: str) -> LogEntry | None:
        for form in self._forms:
            if match := form[0].fullmatch(text):
                if form is not self._forms[0]:  # the next line is most likely of the same form
                    self._forms.remove(form)
                    self._forms.insert(0, form)
                return form[1](match)
        return None

    def _enveloped(self, text: str) -> LogEntry | None:
        """What stands behind a time or a name that a logger wrote before it."""
        if text[:1] in _COMMENTS:
            return None
        if match := SENTENCE_BEHIND.fullmatch(text):
            inner = match["inner"].removesuffix('"') if match["before"].endswith('"') else match["inner"]
            return _at(self._sentence(inner), self.times.read(match["before"]))
        match = next(filter(None, (pattern.fullmatch(text) for pattern in _ENVELOPES)), None)
        return None if match is None else _at(self._bare(match["inner"]), self.times.read(match["before"]))


def _of_stored(stored: Stored) -> LogEntry | None:
    """What an Actisense message says of the bus, if anything."""
    if stored.sentence:
        return LogEntry(None, stored.sentence, protocol="nmea0183")
    if not stored.payload:
        return None
    return message(stored.header, stored.payload, stored.time_ns, stored.turn_ns, assembled=stored.assembled)


def _at(entry: LogEntry | None, time: tuple[int | None, int] | None) -> LogEntry | None:
    """The entry at the time that was told beside it, if any was."""
    return entry if entry is None or time is None else entry._replace(time_ns=time[0], turn_ns=time[1])
