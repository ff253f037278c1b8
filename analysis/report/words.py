"""What a report says in place of the names that programs use."""

from __future__ import annotations

import re

from seatrial.acquisition.core.quantities import ending_of
from seatrial.acquisition.core.ship import find_channel

_UNIT = re.compile(r"_(m[23]?|mps|deg|degc|kgpm3)$")
_NAME = re.compile(r"\b[a-z][a-z0-9]*(?:_[a-z0-9]+)+\b")
_POSITION = {"north_m": "north position", "east_m": "east position"}


def in_words(text: str) -> str:
    """A text with every channel's name in it, and every other name with underscores, as a person says it.

    >>> in_words("port_rpm was interpolated, surge_mps and north_m were not")
    'port shaft speed was interpolated, surge and north position were not'
    """
    return _NAME.sub(lambda name: _words_of(name[0]), text)


def _words_of(name: str) -> str:
    channel = find_channel(name)
    if channel is None:
        return _UNIT.sub("", name).replace("_", " ")
    if name.endswith("_rpm"):
        return f"{name.removesuffix('_rpm').replace('_', ' ')} shaft speed"
    return _POSITION.get(name) or name.removesuffix(ending_of(channel.unit)).replace("_", " ")


def reason_of(text: str) -> str:
    """What went wrong and why, in words: an error's line without the remedy that it ends with.

    >>> reason_of("the table lacks heading_deg; name it in the column map")
    'the table lacks heading'
    """
    return in_words(text.partition("; ")[0])
