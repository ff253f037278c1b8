"""Making other people's text safe for a terminal."""

from __future__ import annotations

import os
import re
from typing import TypeVar

Said = TypeVar("Said")

# All that a terminal may obey instead of showing it: control characters of both sets, but tab and line feed, and
# what turns the direction of writing round; and the bytes of a file name that are no UTF-8, which nothing encodes.
_OBEYED = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069\ud800-\udfff]")
_FIRST_BYTE, _LAST_BYTE, _BYTES = "\udc80", "\udcff", 0xDC00  # which Python has as these


def printable(said: Said) -> Said:
    r"""Text, or text in lists, tuples and dictionaries, with control characters escaped.

    >>> print(printable("calm\x1b[2J"))
    calm\x1b[2J
    """
    if isinstance(said, str):
        return _OBEYED.sub(lambda match: _escape(match[0]), said)  # type: ignore[return-value]
    if isinstance(said, dict):
        return {printable(key): printable(value) for key, value in said.items()}  # type: ignore[return-value]
    if isinstance(said, list | tuple):
        return type(said)(map(printable, said))
    return said


def printable_name(path: str | os.PathLike[str]) -> str:
    r"""The name of a file as one line of printable text, whatever bytes it is made of.

    >>> print(printable_name(os.fsdecode(b"bay\xff\n.mcap")))
    bay\xff\n.mcap
    """
    return printable(os.fspath(path)).replace("\t", r"\t").replace("\n", r"\n")


def _escape(character: str) -> str:
    if _FIRST_BYTE <= character <= _LAST_BYTE:
        return f"\\x{ord(character) - _BYTES:02x}"
    return repr(character)[1:-1]
