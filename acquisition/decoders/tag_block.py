r"""TAG blocks: what a multiplexer or gateway says of a sentence, ``\s:GN01,c:1795255200*hh\$GPGGA,...``.

Also the prefix that IEC 61162-450 puts before both in a datagram.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import reduce
from operator import xor

_DATAGRAM_PREFIX = b"UdPbC\0"
_TAG_BLOCK = re.compile(rb"\\([\x20-\x7e]*?)\*([0-9A-Fa-f]{2})\\")
_SECONDS = re.compile(r"(\d{1,10})(?:\.(\d{1,9}))?")
_MILLISECONDS = re.compile(r"\d{13}")
_NOT_IN_A_LABEL = re.compile(r"[^A-Za-z0-9._-]")


@dataclass(frozen=True, slots=True)
class TaggedSentence:
    """A sentence without its envelope, and what the envelope said; ``sound`` is False where that was spoilt."""

    sentence: bytes
    time_ns: int | None = None
    source: str = ""
    sound: bool = True


def checksum(body: bytes) -> int:
    """The exclusive or of the bytes before ``*``, the same for sentences and TAG blocks.

    >>> f"{checksum(b'RCTRD,3,-17.8,R,,V,'):02X}"
    '59'
    """
    return reduce(xor, body, 0)


def split_tag(line: bytes) -> TaggedSentence:
    r"""A line as its sentence with the TAG block's time (c:, UTC, ns since 1970) and source (s:).

    A block with a wrong checksum says nothing, but the sentence behind it has a checksum of its own.

    >>> split_tag(rb"\s:GN01,c:1795255200*3E\$HEHDT,12.3,T*1F")
    Tagged(sentence=b'$HEHDT,12.3,T*1F', time_ns=1795255200000000000, source='GN01', sound=True)
    """
    line = line.removeprefix(_DATAGRAM_PREFIX)
    if not line.startswith(b"\\"):
        return TaggedSentence(line)
    found = _TAG_BLOCK.match(line)
    if found is None or int(found[2], 16) != checksum(found[1]):
        return TaggedSentence(line[line.rfind(b"\\") + 1 :], sound=False)
    items = dict(item.split(":", 1) for item in found[1].decode("ascii").split(",") if ":" in item)
    source = _NOT_IN_A_LABEL.sub("_", items.get("s", ""))
    return TaggedSentence(line[found.end() :], unix_ns(items.get("c", "")), source)


def unix_ns(text: str) -> int | None:
    """Seconds or, with 13 digits, milliseconds since 1970 as ns; None for anything else.

    >>> unix_ns("1795255200.25") == unix_ns("1795255200250")
    True
    """
    if _MILLISECONDS.fullmatch(text):
        return int(text) * 1_000_000
    found = _SECONDS.fullmatch(text)
    if found is None:
        return None
    return int(found[1]) * 1_000_000_000 + int((found[2] or "").ljust(9, "0"))
