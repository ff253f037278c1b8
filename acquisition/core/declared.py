"""Channels that a user declares in addition to those of every trial: their checks, their text in a recording.

A declared channel is recorded, checked, resampled, exported and plotted like the others; its definition is
stored in the recording, since nothing else knows it.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable
from functools import lru_cache
from math import isfinite

from seatrial.acquisition.core.channel import Channel
from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.acquisition.core.files import parse_json
from seatrial.acquisition.core.units import canonical, ending_of

_NAME = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*")
_UNIT = re.compile(r"[A-Za-z0-9%/^.*-]{1,20}")
_MOST_LETTERS = 60
_TURN_DEG = 360.0

Declared = tuple[Channel, ...]
"""The channels that a trial declares."""


def declare(name: str, unit: str, low: float, high: float, meaning: str = "", state: bool = False) -> Channel:
    """A channel from a user's declaration; an angle whose range is one turn, from 0 or from -180, is circular.

    Raises :class:`ConfigurationError` for a name that cannot be part of a topic or does not end in its unit, an
    unreadable unit, and an empty range.
    """
    unit = canonical(unit)
    ending = ending_of(unit)
    if not _UNIT.fullmatch(unit):
        what = f"unit {unit!r} of channel {name} is not known"
        raise ConfigurationError(what, fix="write it like kW, m3/h or kg/m3")
    if not _NAME.fullmatch(name) or len(name) > _MOST_LETTERS:
        what = f"channel name {name!r} is not valid in a topic"
        why = f"it has other than small letters, digits and single _, or more than {_MOST_LETTERS} letters"
        raise ConfigurationError(what, why=why, fix="write it like fuel_rate_lph")
    if not name.endswith(ending):
        raise ConfigurationError(f"channel {name} is in {unit}", fix=f"let its name end in {ending}")
    if not (isfinite(low) and isfinite(high) and low < high):
        raise ConfigurationError(f"range {low:g} to {high:g} of channel {name} holds nothing", fix="correct it")
    circular = unit == "deg" and high - low == _TURN_DEG and low in (0.0, -180.0) and not state
    return Channel(name, unit, low, high, "declared", meaning or name.replace("_", " "), circular, state)


def declared_text(channels: Iterable[Channel]) -> str:
    """Declared channels as JSON for a recording's metadata; empty for none."""
    keys = "name", "unit", "low", "high", "meaning", "state"
    entries = [{key: getattr(channel, key) for key in keys} for channel in channels]
    return json.dumps(entries) if entries else ""


@lru_cache(maxsize=64)
def declared_from_text(text: str) -> Declared:
    """The inverse of :func:`declared_text`; text that is no list of channels (another program's) declares none."""
    try:
        return tuple(declare(**entry) for entry in parse_json(text)) if text else ()
    except (ValueError, TypeError):
        return ()
