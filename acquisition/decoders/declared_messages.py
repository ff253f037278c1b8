"""What MAVLink messages say of declared channels: any field of any message of the dialect."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from math import nan
from typing import Any, NamedTuple

from acquisition.config.declarations import MavlinkField, complaints_about
from acquisition.core.channel import Channel
from acquisition.core.errors import ConfigurationError
from acquisition.core.units import Linear

os.environ.setdefault("MAVLINK20", "1")  # pymavlink reads this when it is imported
from pymavlink.dialects.v20 import ardupilotmega as dialect

_WHOLE = re.compile(r"(u?)int(\d+)_t")


class _MessageChannel(NamedTuple):
    """A channel that a message carries."""

    channel: Channel
    origin: MavlinkField
    step: Linear
    unknown: int | None

    def read(self, message: Any) -> list[tuple[str, float]]:
        if any(getattr(message, name) != code for name, code in self.origin.where.items()):
            return []
        value = getattr(message, self.origin.field)
        if self.origin.index is not None:
            value = value[self.origin.index]
        return [(self.channel.name, nan if value == self.unknown else self.step.apply(float(value)))]


class DeclaredMessages:
    """The declared channels on one link; ``names`` are their messages by number.

    Raises :class:`ConfigurationError` for a message or field that the dialect has not, and units that do not fit.
    """

    def __init__(self, wanted: Sequence[tuple[Channel, MavlinkField]]) -> None:
        self.names: dict[int, str] = {}
        self._channels: dict[str, list[_MessageChannel]] = {}
        kinds = {each.msgname: each for each in dialect.mavlink_map.values()}
        for channel, origin in wanted:
            with complaints_about(channel):
                kind = _kind_of(origin, kinds)
                step = origin.step_to(channel, kind.fieldunits_by_name.get(origin.field))
            self.names[kind.id] = origin.message
            found = _MessageChannel(channel, origin, step, _unknown(kind, origin.field))
            self._channels.setdefault(origin.message, []).append(found)

    def channels_in(self, name: str) -> frozenset[str]:
        """The channels that these messages carry: what they would say of them otherwise counts no more."""
        return frozenset(each.channel.name for each in self._channels.get(name, ()))

    def read(self, name: str, message: Any) -> list[tuple[str, float]]:
        """The channels in a message with their values, NaN for one that is not known."""
        return [value for each in self._channels.get(name, ()) for value in each.read(message)]


def _kind_of(origin: MavlinkField, kinds: Mapping[str, Any]) -> Any:
    """The dialect's message that a declaration names, if it has its fields and they are numbers."""
    kind = kinds.get(origin.message)
    if kind is None:
        near = ", ".join(get_close_matches(origin.message, kinds, n=3)) or "ATTITUDE"
        raise ConfigurationError(f"MAVLink has no message {origin.message}", fix=f"write one such as {near}")
    for name in (origin.field, *origin.where):
        if name not in kind.fieldnames:
            fields = ", ".join(kind.fieldnames)
            raise ConfigurationError(f"{origin.message} has no field {name!r}", fix=f"write one of {fields}")
    length = kind.array_lengths[kind.ordered_fieldnames.index(origin.field)]
    fits = origin.index is None if length == 0 else origin.index is not None and origin.index < length
    if kind.fieldtypes[kind.fieldnames.index(origin.field)] == "char" or not fits:
        what = f"has {length} elements: give the `index` of one" if length else "is one value: leave out `index`"
        raise ConfigurationError(f"field {origin.field} of {origin.message} {what}")
    return kind


def _unknown(kind: Any, field: str) -> int | None:
    """What a field of whole numbers holds where the value is not known: by MAVLink's custom the highest."""
    found = _WHOLE.fullmatch(kind.fieldtypes[kind.fieldnames.index(field)])
    return None if found is None else 2 ** (int(found[2]) - (found[1] == "")) - 1
