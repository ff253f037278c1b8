"""Making other people's text safe for a terminal."""

from __future__ import annotations

import re
from typing import TypeVar

Said = TypeVar("Said")

# All that a terminal may obey instead of showing it: control characters of both sets, but tab and line feed, and
# what turns the direction of writing round; and the bytes of a file name that are no UTF-8, which nothing encodes.
_OBEYED = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069\ud800-\udfff]")


def printable(said: Said) -> Said:
    r"""Text, or text in lists, tuples and dictionaries, with control characters escaped.

    >>> print(printable("calm\x1b[2J"))
    calm\x1b[2J
    """
    if isinstance(said, str):
        return _OBEYED.sub(lambda found: repr(found[0])[1:-1], said)  # type: ignore[return-value]
    if isinstance(said, dict):
        return {printable(key): printable(each) for key, each in said.items()}  # type: ignore[return-value]
    if isinstance(said, list | tuple):
        return type(said)(map(printable, said))
    return said
