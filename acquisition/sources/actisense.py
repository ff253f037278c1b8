"""Actisense's binary messages (BST), of NGT-1, NGX, W2K, WGX and others, and the marks that they come between.

Source: the descriptions in the maker's public SDK. A message begins with its kind and length; all its bytes add
up to zero. Kinds that say nothing of the bus, the gateway's own, are sound and empty.
"""

from __future__ import annotations

import re
from typing import NamedTuple

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
_MILLI_NS = 1_000_000
_UPTIME_TURN_NS = 2**32 * _MILLI_NS
_STEPS_NS = (1_000_000, 100_000, 10_000, 1_000)  # of the 16-bit clock of single frames, by two bits


class Stored(NamedTuple):
    """What a message holds: a group's bytes with their priority, group, source and destination, or a sentence.

    ``time_ns`` counts from when the gateway started and comes round after ``turn_ns``. ``assembled`` tells messages
    that the gateway has put together from single frames.
    """

    header: tuple[int, int, int, int] = (0, 0, 0, 0)
    payload: bytes = b""
    time_ns: int = 0
    turn_ns: int = _UPTIME_TURN_NS
    assembled: bool = True
    sentence: bytes = b""


def stored_message(stored: bytes) -> Stored | None:
    """What a message with its checksum holds; None for one that is not sound."""
    if len(stored) < 3:
        return None
    body, kind = stored[:-1], stored[0]
    length = int.from_bytes(body[1:3], "little") if kind == 0xD0 else body[1] + 2
    if length != len(body) or sum(stored) & 0xFF:
        return None
    if kind == 0x93:
        return message_entry(body)
    if kind == 0x95:
        return _single_frame(body)
    if kind == 0xD0:
        return _newest(body)
    return Stored(sentence=body[2:].strip(b"\0\r\n \t")) if kind == _TEXT_KIND[0] else Stored()


def is_message(piece: bytes) -> bool:
    """Whether a piece that :class:`Cutter` cut is a message, not text."""
    return piece.startswith(MARK) and stored_message(piece[len(MARK) :]) is not None


def message_entry(body: bytes) -> Stored | None:
    """A message of kind 93, without its checksum; None where its lengths contradict each other."""
    if len(body) < 13 or body[0] != 0x93 or len(body) < 13 + body[12]:
        return None
    group, destination = _group(body[5], body[4], body[3], body[6])
    header = body[2] & 7, group, body[7], destination
    return Stored(header, body[13 : 13 + body[12]], int.from_bytes(body[8:12], "little") * _MILLI_NS)


def _newest(body: bytes) -> Stored | None:
    if len(body) < 13:
        return None
    group, destination = _group(body[7], body[6], body[5], body[3])
    time_ns = int.from_bytes(body[9:13], "little") * _MILLI_NS
    return Stored((body[7] >> 2 & 7, group, body[4], destination), body[13:], time_ns)


def _single_frame(body: bytes) -> Stored | None:
    if not 8 <= len(body) <= 16:
        return None
    group, destination = _group(body[7], body[6], body[5], body[5] if body[6] < 240 else 255)
    step_ns = _STEPS_NS[body[7] >> 5 & 3]
    header = body[7] >> 2 & 7, group, body[4], destination
    return Stored(header, body[8:], int.from_bytes(body[2:4], "little") * step_ns, 2**16 * step_ns, assembled=False)


def _group(page: int, pdu_format: int, pdu_specific: int, destination: int) -> tuple[int, int]:
    """The parameter group and who it is for, from the fields of an identifier."""
    addressed = pdu_format < 240
    return (page & 3) << 16 | pdu_format << 8 | (0 if addressed else pdu_specific), destination


class Cutter:
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
            if (message := _message(data, body, end)) is not None:
                pieces += [*_lines(data[start:at]), MARK + message]
                start = at = end
            elif end > len(data) and _may_go_on(data, body):
                break
            else:
                at += 1
        until = len(data) if at < 0 else at
        last = max(data.rfind(b"\n", start, until), data.rfind(b"\r", start, until))
        if last >= 0:
            pieces += _lines(data[start : last + 1])
            start = last + 1
        *full, self._pending = _in_pieces(data[start:])
        return pieces + full

    def cut(self) -> None:
        """The stream was cut and begins anew: what was under way stays as far as it came, by itself."""
        if self._pending:
            self._pending = self._pending.replace(MARK, MARK[:1] + b"\n" + MARK[1:]) + b"\n"

    def end(self) -> list[bytes]:
        """The last line, or what there is of a message, where the stream ended (a datagram, a file)."""
        pieces, self._pending = _lines(self._pending), b""
        return pieces


def _lines(text: bytes) -> list[bytes]:
    lines = [stripped for line in _LINE_END.split(text) if (stripped := line.strip(b"\0 \t"))]
    if max(map(len, lines), default=0) <= _LONGEST_LINE_BYTES:
        return lines
    return [piece for line in lines for piece in _in_pieces(line)]


def _in_pieces(line: bytes) -> list[bytes]:
    """A line in pieces that are not too long; no sentence is cut in two that is not too long itself."""
    pieces = []
    while len(line) > _LONGEST_LINE_BYTES:
        beginnings = _BEGINNING.finditer(line, _SHORTEST_CUT_BYTES, _LONGEST_LINE_BYTES)
        cut = max((beginning.start() for beginning in beginnings), default=_LONGEST_LINE_BYTES)
        pieces.append(line[:cut])
        line = line[cut:]
    return [*pieces, line]


def _message(data: bytes, at: int, end: int) -> bytes | None:
    """The sound message with these bounds, unescaped; None where there is none."""
    if end > len(data) or data[end - len(END) : end] != END or end - at > 2 * _LONGEST_BYTES:
        return None
    message = data[at : end - len(END)].replace(_DLE * 2, _DLE)
    return None if stored_message(message) is None else message


def _may_go_on(data: bytes, at: int) -> bool:
    """Whether a message may begin here of which more is to come: by its kind, and its length with all escaped.

    What a line with a sentence follows upon is noise that looks so, and must not hold the sentence back.
    """
    kind, length = data[at : at + 1], data[at + 1 : at + 3]
    if kind and kind[0] not in _KINDS:
        return False
    most = 2 * _LONGEST_BYTES if kind == b"\xd0" else 2 * (258 if len(length) < 2 else length[0] + 4)
    return len(data) - at < most and (kind == _TEXT_KIND or not _SENTENCE_LINE.search(data, at))
