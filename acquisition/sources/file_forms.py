"""Log files to entries: one function a form, each with what the file's first bytes look like, in one table.

A function takes the open file and a :class:`LineReader`, which also counts what could not be read; it raises
:class:`ValueError` with what is broken where a file ends before its time.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Iterator
from typing import BinaryIO, NamedTuple

from seatrial.acquisition.core.frames import HIGHEST_IDENTIFIER, NANO, FrameFlag, can_flags
from seatrial.acquisition.decoders.clock import is_possible
from seatrial.acquisition.decoders.nmea2000 import parameter_group
from seatrial.acquisition.sources.actisense import MARK, Cutter
from seatrial.acquisition.sources.asc import begins_asc, read_asc
from seatrial.acquisition.sources.line_forms import MILLI_NS, LineReader, LogEntry

_BLOCK_BYTES = 8192
_LONGEST_PACKET = 65_536
_LONGEST_RECORD = 4096
_CUT_OFF = "its last record is cut off"
_SERVICE = 0xFFFFFFFF  # in the place of an identifier, in Yacht Devices' files


def read_lines(file: BinaryIO, reader: LineReader) -> Iterator[LogEntry]:
    """Lines of text, and Actisense's messages as a program wrote them to a file."""
    cutter = Cutter()
    while block := file.read(_BLOCK_BYTES):
        yield from reader.entries(cutter.push(block))
    yield from reader.entries(cutter.end())


_EBL_PART = re.compile(
    rb"\x1b\x01(?P<tag>(?:[^\x1b]|\x1b\x1b)*+)\x1b\n|(?P<data>(?:[^\x1b]|\x1b\x1b)++)|\x1b[^\x01\x1b]", re.DOTALL
)
_FILETIME_1970 = 116_444_736_000_000_000  # 100 ns since 1601


def read_ebl(file: BinaryIO, reader: LineReader) -> Iterator[LogEntry]:
    """Actisense's log: the bytes of a gateway between tags, of which one tells the time of what follows."""
    cutter, time_ns, data = Cutter(), None, b""
    while block := file.read(_BLOCK_BYTES):
        data, at = data + block, 0
        while match := _EBL_PART.match(data, at):
            at = match.end()
            tag, raw = ((match[name] or b"").replace(b"\x1b\x1b", b"\x1b") for name in ("tag", "data"))
            if tag[:1] == b"\x03" and len(tag) == 9:
                told_ns = (int.from_bytes(tag[1:], "little") - _FILETIME_1970) * 100
                time_ns = told_ns if is_possible(told_ns) else time_ns
            pieces = [_checked(tag[1:])] if tag[:1] == b"\x07" else cutter.push(raw)
            for entry in reader.entries(pieces):
                yield entry if time_ns is None else entry._replace(time_ns=time_ns, turn_ns=0)
            reader.unreadable += not tag and not raw
        if len(data) - at > _LONGEST_RECORD:  # a tag without an end
            reader.unreadable, at = reader.unreadable + 1, at + 2
        data = data[at:]
    pieces = cutter.end()
    yield from reader.entries(pieces)
    if data or any(piece.startswith(MARK) for piece in pieces):
        raise ValueError(_CUT_OFF)


def _checked(stored: bytes) -> bytes:
    """A message from a tag of its own, which some write without the checksum."""
    return MARK + (stored if not sum(stored) & 0xFF else stored + bytes([-sum(stored) & 0xFF]))


# The groups that Yacht Devices' recorder keeps as whole messages of any length; the others have 8 bytes.
_WHOLE_GROUPS = frozenset(
    group
    for first, last in (
        (65240, 65240), (126208, 126208), (126464, 126464), (126720, 126720), (126983, 126988), (126996, 126998),
        (127233, 127233), (127237, 127237), (127489, 127489), (127496, 127498), (127503, 127504), (127506, 127507),
        (127509, 127514), (128275, 128275), (128520, 128520), (129029, 129029), (129038, 129041), (129044, 129045),
        (129284, 129285), (129301, 129302), (129538, 129538), (129540, 129542), (129545, 129545), (129547, 129547),
        (129549, 129549), (129551, 129551), (129556, 129556), (129792, 129810), (130052, 130054), (130060, 130061),
        (130064, 130074), (130320, 130324), (130567, 130567), (130577, 130578), (130816, 131071),
    )
    for group in range(first, last + 1)
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
        record = _ydvr_record(data, at)
        if record is None:
            if len(data) - at < 6 + 2 + 255:
                raise ValueError(_CUT_OFF)
            reader.unreadable, at = reader.unreadable + 1, _next_record(data, at + 1)
            continue
        entry, at = record
        if entry is not None:
            yield entry


def _ydvr_record(data: bytes, at: int) -> tuple[LogEntry | None, int] | None:
    """The record at a place, and where the next one begins; None where there is none."""
    if len(data) < at + 6:
        return None
    milliseconds, identifier = struct.unpack_from("<HI", data, at)
    if milliseconds >= 60_000 or not (identifier == _SERVICE or identifier <= HIGHEST_IDENTIFIER):
        return None
    group, body = parameter_group(identifier)[0], at + 6
    length = _REQUEST_BYTES if group == _REQUEST and identifier != _SERVICE else 8
    if assembled := identifier != _SERVICE and group in _WHOLE_GROUPS:
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


def _next_record(data: bytes, at: int) -> int:
    """Where, after damage, three records follow each other again; the end where they never do."""
    for start in range(at, len(data)):
        place = start
        for _ in range(3):
            record = _ydvr_record(data, place)
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
            raise ValueError(_CUT_OFF)
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
_IF_NAME, _IF_TSRESOL = 2, 9  # options of an interface


def read_pcap(file: BinaryIO, reader: LineReader) -> Iterator[LogEntry]:
    """What tcpdump and Wireshark capture of SocketCAN, in the older of their two forms."""
    head = file.read(24)
    order = "<" if head[:4] in (b"\xd4\xc3\xb2\xa1", b"\x4d\x3c\xb2\xa1") else ">"
    finest_ns = 1 if head[:4] in (b"\x4d\x3c\xb2\xa1", b"\xa1\xb2\x3c\x4d") else 1000
    link = struct.unpack(f"{order}I", head[20:24].ljust(4, b"\0"))[0] & 0xFFFF
    _check_link(link)
    while record := file.read(16):
        seconds, fraction, length, _ = struct.unpack(f"{order}IIII", record) if len(record) == 16 else (0, 0, -1, 0)
        packet = file.read(length) if 0 <= length <= _LONGEST_PACKET else b""
        if len(packet) != length:
            raise ValueError(_CUT_OFF)
        yield from _packet(packet, link, seconds * NANO + fraction * finest_ns, reader)


def read_pcapng(file: BinaryIO, reader: LineReader) -> Iterator[LogEntry]:
    """The newer form: blocks, of which some describe an interface and others hold a packet of one."""
    order, links = "<", list[tuple[int, int, str]]()
    while start := file.read(8):
        if start[:4] == b"\n\r\r\n":
            magic = file.read(4)
            order, links = ("<" if magic == b"\x4d\x3c\x2b\x1a" else ">"), []
        else:
            magic = b""
        kind, length = struct.unpack(f"{order}II", start) if len(start) == 8 else (0, 0)
        body = file.read(length - 8 - len(magic)) if 12 <= length <= 2**24 else b""
        if len(body) != length - 8 - len(magic) or length < 12:
            raise ValueError(_CUT_OFF)
        if kind == 1:
            options = _options(body[8:-4], order)
            name = options.get(_IF_NAME, b"").rstrip(b"\0").decode("utf-8", "replace") or f"interface{len(links)}"
            links.append((struct.unpack_from(f"{order}H", body)[0], _ticks_per_s(options), name))
        elif kind == 6 and len(body) >= 24:
            interface, high, low, captured = struct.unpack_from(f"{order}IIII", body)
            if interface < len(links):
                link, ticks, name = links[interface]
                time_ns = (high << 32 | low) * NANO // ticks
                yield from _packet(body[20 : 20 + captured], link, time_ns, reader, name)
    if not any(link in _CAN_LINKS for link, _, _ in links):
        _check_link(links[0][0] if links else 0)


def _options(data: bytes, order: str) -> dict[int, bytes]:
    """The options of an interface by their codes, the first of each."""
    options, at = dict[int, bytes](), 0
    while at + 4 <= len(data):
        code, length = struct.unpack_from(f"{order}HH", data, at)
        options.setdefault(code, data[at + 4 : at + 4 + length])
        at += 4 + length + -length % 4
    return options


def _ticks_per_s(options: dict[int, bytes]) -> int:
    """An interface's clock: a million ticks unless an option says otherwise, as a power of 10 or of 2."""
    resolution = options.get(_IF_TSRESOL, b"")
    if len(resolution) != 1:
        return 1_000_000
    power = resolution[0]
    return int(2 ** (power & 0x7F)) if power & 0x80 else int(10 ** min(power, 18))


def _check_link(link: int) -> None:
    if link not in _CAN_LINKS:
        raise ValueError(f"it is a capture of link type {link}, which has no CAN frames ({_SOCKETCAN} does)")


def _packet(packet: bytes, link: int, time_ns: int, reader: LineReader, bus: str = "") -> Iterator[LogEntry]:
    """The CAN frame in a captured packet; those of other protocols are passed over.

    Of what was captured on all interfaces at once the packet itself says which it came by.
    """
    if link in (_COOKED, _COOKED_2):
        skip, place = (16, 14) if link == _COOKED else (20, 0)
        if int.from_bytes(packet[place : place + 2], "big") not in _CAN_PROTOCOLS:
            return
        bus = f"interface{int.from_bytes(packet[4:8], 'big')}" if link == _COOKED_2 else bus
        packet = packet[skip:]
    elif link != _SOCKETCAN:
        return
    if len(packet) < 8 or len(packet) < 8 + packet[4] or packet[4] > 64:
        reader.unreadable += 1
        return
    identifier = int.from_bytes(packet[:4], "big")
    extended, remote, error = (bool(identifier & bit) for bit in (0x80000000, 0x40000000, 0x20000000))
    data = b"" if remote else packet[8 : 8 + packet[4]]
    flags = can_flags(not extended, remote, error)
    yield LogEntry(time_ns, data, identifier & HIGHEST_IDENTIFIER, flags, bus=bus)


class FileForm(NamedTuple):
    """What the first bytes of a file look like, and how it is read."""

    begins: Callable[[bytes], bool]
    read: Callable[[BinaryIO, LineReader], Iterator[LogEntry]]


_PCAP = (b"\xd4\xc3\xb2\xa1", b"\xa1\xb2\xc3\xd4", b"\x4d\x3c\xb2\xa1", b"\xa1\xb2\x3c\x4d")
FILE_FORMS: dict[str, FileForm] = {
    "ebl": FileForm(lambda head: head.startswith(b"\x1b\x01"), read_ebl),
    "ydvr": FileForm(lambda head: head[6:10] == b"YDVR", read_ydvr),
    "yd_can": FileForm(lambda head: head[8:12] == b"YDVR", read_yd_can),
    "pcap": FileForm(lambda head: head.startswith(_PCAP), read_pcap),
    "pcapng": FileForm(lambda head: head.startswith(b"\n\r\r\n"), read_pcapng),
    "asc": FileForm(begins_asc, read_asc),
}
"""Files that are read as a whole by their names; those of python-can are in ``logfile.py``."""
