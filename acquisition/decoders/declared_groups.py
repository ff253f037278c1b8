"""What parameter groups of NMEA 2000 and J1939 say of declared channels: any field of any group.

Where a field is, a declaration says itself or canboat's database does, as the ``nmea2000`` library carries it. How
it is read, and what is no value, is decided here.
"""

from __future__ import annotations

import re
import threading
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any, NamedTuple

from seatrial.acquisition.config.declarations import GroupField, complaints_about
from seatrial.acquisition.core.channel import Channel
from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.acquisition.core.units import Linear
from seatrial.acquisition.decoders import DeclaredReaders
from seatrial.acquisition.decoders.parameter_groups import SHORTEST_BYTES, Field, Message, Value

_PLACE = re.compile(r"(\d{1,4}):(\d{1,2})")
_MOST_BITS = 8 * 223
_NMEA2000_FROM = 0x1F000
_PROPRIETARY = (0xEF00, range(0xFF00, 0x10000))
_FAST = (0x1EF00, range(0x1FF00, 0x20000))
_NUMBERS = frozenset({"NUMBER", "DURATION", "TIME", "DATE"})
_CODES = frozenset({"LOOKUP", "INDIRECT_LOOKUP", "BITLOOKUP", "BINARY", "RESERVED"})


class KnownField(NamedTuple):
    """A field of canboat's database: where it is, and its unit where it has one."""

    field: Field
    unit: str | None


class _GroupChannel(NamedTuple):
    """A channel that a group carries."""

    channel: Channel
    field: Field
    step: Linear
    where: tuple[tuple[Field, int], ...]
    address: int | None

    def read(self, address: int, message: Message) -> Value | None:
        """The value, or the reason why there is none; None where the message is about something else."""
        if self.address not in (None, address) or any(message.read(field) != code for field, code in self.where):
            return None
        value = message.read(self.field)
        return value if isinstance(value, str) else self.step.apply(value)


class DeclaredGroups(DeclaredReaders[int, _GroupChannel]):
    """What groups say of declared channels, by their numbers.

    ``shortest`` are the groups among them that come in several frames, with the least length [bytes] that holds
    what is asked for. Raises :class:`ConfigurationError` for a field that is not known, and units that do not fit.
    """

    def __init__(self, wanted: Sequence[tuple[Channel, GroupField]]) -> None:
        super().__init__()
        self.shortest: dict[int, int] = {}
        for channel, origin in wanted:
            with complaints_about(channel):
                group_channel = _group_channel(channel, origin)
            self.setdefault(origin.group, []).append(group_channel)
            if _is_fast(origin.group) and origin.group not in SHORTEST_BYTES:
                last_bit = max(
                    field.start + field.bits
                    for field in (group_channel.field, *(condition for condition, _ in group_channel.where))
                )
                self.shortest[origin.group] = max(self.shortest.get(origin.group, 1), -(-last_bit // 8))

    def read(self, group: int, address: int, message: Message) -> list[tuple[str, Value]]:
        """The channels in a message, each with its value or the reason why there is none."""
        values: dict[str, Value] = {}
        for group_channel in self.get(group, ()):
            value = group_channel.read(address, message)
            if value is not None and isinstance(values.get(group_channel.channel.name, ""), str):
                values[group_channel.channel.name] = value
        return list(values.items())


def _group_channel(channel: Channel, origin: GroupField) -> _GroupChannel:
    field, unit = _field(origin.field, origin)
    where = tuple((_code(_field(name, origin)[0]), code) for name, code in origin.where.items())
    return _GroupChannel(channel, field, origin.step_to(channel, unit), where, origin.address)


def _code(field: Field) -> Field:
    """The field as a code, which has no values that mean "not available"."""
    return Field(field.start, field.bits)


def _field(name: str, origin: GroupField) -> KnownField:
    """A field by its place or by its name. Raises :class:`ConfigurationError` for neither."""
    if place := _PLACE.fullmatch(name):
        start, bits = int(place[1]), int(place[2])
        if not 1 <= bits <= 64 or start + bits > _MOST_BITS:
            raise ConfigurationError(
                f"group {origin.group} has no bits {name}", fix="write first bit:number of bits"
            )
        return KnownField(Field(start, bits, origin.step, origin.signed, _follows_j1939(origin.group)), None)
    fields = canboat_fields(origin.group)
    if name not in fields:
        why = f"it has {', '.join(fields)}" if fields else "canboat's database does not tell of it, or of several"
        fix = 'name one of them, or write its place: field = "first bit:number of bits", with `step`'
        raise ConfigurationError(f"group {origin.group} has no field {name!r}", why=why, fix=fix)
    return fields[name]


LIBRARY = threading.Lock()
"""Held while the library's codec is used, of which a process has one: it raises when two threads meet in it."""


def variants_of(group: int) -> Sequence[Any]:
    """What canboat's database knows of a group: each of its variants; nothing of a group that it lacks."""
    from nmea2000 import backend

    with LIBRARY:
        return list(backend.DATABASE.pgn_variants(group))


def decoded(group: int, payload: bytes) -> Any:
    """A message as the library reads it, None of a group that canboat's database lacks."""
    from nmea2000 import backend

    with LIBRARY:
        return backend.decode(group, payload)


@cache
def canboat_fields(group: int) -> Mapping[str, KnownField]:
    """The numbers and codes of a group by their names in canboat's database; none where it tells of several."""
    variants = variants_of(group)
    if len(variants) != 1:
        return {}
    return {
        field.id: KnownField(_as_field(group, field), field.unit)
        for field in variants[0].fields
        if field.bit_offset is not None
        and field.bit_length is not None
        and not field.offset
        and field.field_type in _NUMBERS | _CODES
    }


def _as_field(group: int, info: Any) -> Field:
    step = info.resolution if info.field_type in _NUMBERS else None
    return Field(info.bit_offset, info.bit_length, step, step is not None and _is_signed(group, info))


def _is_signed(group: int, info: Any) -> bool:
    """Whether all ones are a value, one step below zero, and not the code for none: the library does not say."""
    ones = ((1 << info.bit_length) - 1) << info.bit_offset
    message = decoded(group, ones.to_bytes(max(-(-ones.bit_length() // 8), 8), "little"))
    raw = {field.id: field.raw_value for field in message.fields}[info.id] if message else None
    return isinstance(raw, int | float) and raw < 0


@cache
def _is_fast(group: int) -> bool:
    """Whether a group comes in several frames: by its number where that tells, else by canboat's database."""
    single, several = _PROPRIETARY, _FAST
    if group == several[0] or group in several[1]:
        return True
    if group < _NMEA2000_FROM or group == single[0]:
        return False
    return any(variant.packet_type == "Fast" for variant in variants_of(group))


def _follows_j1939(group: int) -> bool:
    """Whether what is no value is J1939's: of all groups that are neither NMEA 2000's nor a maker's own."""
    return group < _NMEA2000_FROM and group != _PROPRIETARY[0] and group not in _PROPRIETARY[1]
