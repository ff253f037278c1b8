"""The vessel's own CAN frames by a DBC file: thrusters, mostly, that no standard message carries.

Frames with 29-bit identifiers are matched by parameter group, as J1939 devices choose their own address, and
obey its rule that the highest raw values mean "not available" or "error"; 11-bit frames match exactly.
"""

from __future__ import annotations

from collections import Counter, deque
from math import isfinite
from pathlib import Path

import cantools
from cantools.database.can import Message as DbcMessage
from cantools.database.can import Signal as DbcSignal

from acquisition.channels import BY_NAME
from acquisition.decoders import Notices
from acquisition.decoders.clock import SourceClock
from acquisition.decoders.nmea2000 import parameter_group
from acquisition.errors import ConfigurationError
from acquisition.frames import Frame, FrameFlag, Group
from acquisition.sections import Signal
from acquisition.units import scale_to


def load_dbc(path: Path) -> cantools.db.Database:
    """Read a DBC file. Raises :class:`ConfigurationError`."""
    try:
        return cantools.database.load_file(str(path), database_format="dbc")
    except (OSError, ValueError, cantools.Error) as error:
        raise ConfigurationError("is no readable DBC file", where=str(path), why=str(error)) from error


def find_signal(database: cantools.db.Database, entry: Signal, path: Path) -> tuple[DbcMessage, DbcSignal]:
    """The message and signal that a configuration names. Raises :class:`ConfigurationError`."""
    try:
        message = database.get_message_by_name(entry.message)
        return message, message.get_signal_by_name(entry.signal)
    except KeyError as error:
        known = ", ".join(f"{each.name}.{signal.name}" for each in database.messages for signal in each.signals)
        raise ConfigurationError(
            f"has no signal {entry.message}.{entry.signal}", where=str(path), fix=f"it has {known}"
        ) from error


def frame_key(message: DbcMessage) -> tuple[bool, int]:
    """How frames find their message: the parameter group for 29-bit, the identifier for 11-bit frames."""
    if message.is_extended_frame:
        return True, parameter_group(message.frame_id)[0]
    return False, message.frame_id


def is_sentinel(raw: float, signal: DbcSignal) -> bool:
    """Whether a raw value means "not available" or "error" by the rule of J1939-71 and NMEA 2000."""
    if signal.is_float:
        return not isfinite(raw)
    return _is_integer_sentinel(int(raw), signal)


def _is_integer_sentinel(raw: int, signal: DbcSignal) -> bool:
    bits: int = signal.length
    if signal.is_signed:
        return bool(raw >= 2 ** (bits - 1) - 2)
    if bits >= 16:
        return raw >> (bits - 8) >= 0xFE
    return bool(raw >= 2**bits - (2 if bits >= 4 else 1))


class DbcDecoder:
    """The configured signals of one DBC file on one bus."""

    def __init__(self, path: Path, signals: dict[str, Signal], clock: SourceClock) -> None:
        self.refused: Counter[str] = Counter()
        self.notices: Notices = deque()
        self._clock = clock
        self._wanted: dict[tuple[bool, int], tuple[DbcMessage, list[tuple[str, DbcSignal, float]]]] = {}
        database = load_dbc(path)
        for channel, entry in signals.items():
            message, signal = find_signal(database, entry, path)
            wanted = self._wanted.setdefault(frame_key(message), (message, []))
            wanted[1].append((channel, signal, scale_to(BY_NAME[channel].unit, entry.unit)))

    def decode(self, frame: Frame) -> list[Group]:
        if frame.flags & (FrameFlag.REMOTE | FrameFlag.ERROR):
            return []
        extended = not frame.flags & FrameFlag.STANDARD_ID
        key = (True, parameter_group(frame.identifier)[0]) if extended else (False, frame.identifier)
        if key not in self._wanted:
            return []
        message, wanted = self._wanted[key]
        if len(frame.payload) < message.length:
            self.refused["short frame"] += 1
            return []
        raw = message.decode(frame.payload, decode_choices=False, scaling=False)
        values = []
        for channel, signal, scale in wanted:
            if signal.name not in raw:  # multiplexed, and this frame carries another signal
                continue
            if (extended or signal.is_float) and is_sentinel(raw[signal.name], signal):
                self.refused["not available"] += 1
            else:
                values.append((channel, float(signal.raw_to_scaled(raw[signal.name], False)) * scale))
        device = f"{frame.identifier & 0xFF}" if extended else f"{frame.identifier:03X}"
        return self._clock.group(frame, f"{frame.origin}/{device}:{message.name}", values)
