"""Other people's text: made safe for a terminal, read as JSON."""

from __future__ import annotations

import json
import re
from typing import Any, TypeVar

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


def parse_json(text: str | bytes) -> Any:
    """What a JSON text says. Raises ValueError for any other text, and for one that is nested too deeply."""
    try:
        return json.loads(text)
    except RecursionError as error:
        raise ValueError("it is nested too deeply") from error
