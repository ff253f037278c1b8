"""Which signals of a DBC file carry a ship's actuators, by their names and units; whether a file is a bus's own."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

import cantools
from cantools.database.can import Signal as DbcSignal

from acquisition.core.actuators import VESSELS, Actuators
from acquisition.core.channel import Channel
from acquisition.core.errors import ConfigurationError
from acquisition.core.frames import Frame, FrameFlag
from acquisition.core.units import scale_to
from acquisition.decoders.dbc import frame_key, load_dbc
from acquisition.decoders.nmea2000 import parameter_group

_NO_FEEDBACK = re.compile(r"(?i)order|command|cmd|demand|setpoint|request|reference|limit|max|min")
_ALSO_CALLED = {"starboard": ("stbd", "stb"), "tunnel": ("bow",), "propeller": ("prop",)}
_ENOUGH_MESSAGES = 2

SignalNames = dict[str, dict[str, str]]
"""By channel the message, signal and unit, as ``[source.signals]`` has them."""


def own_dbc(frames: Iterable[Frame]) -> Path | None:
    """The DBC file beside the vessel files that is the bus's own, if there is one.

    At least two of its messages come with their very identifiers, and none of its groups with others: proprietary
    groups mean something else on the next ship.
    """
    heard = {frame.identifier for frame in frames if frame.protocol == "can" and not frame.flags & ~FrameFlag.LATE}
    for path in sorted(VESSELS.glob("*.dbc")):
        messages = load_dbc(path).messages
        known, groups = {each.frame_id for each in messages}, {frame_key(each)[1] for each in messages}
        others = {each for each in heard - known if parameter_group(each)[0] in groups}
        if len(known & heard) >= _ENOUGH_MESSAGES and not others:
            return path
    return None


def match_signals(path: Path, actuators: Actuators) -> SignalNames:
    """The signals that carry the control channels, as far as names and units tell. Raises ConfigurationError."""
    database = load_dbc(path)
    found = (
        (channel.name, _signal_of(channel, each.name, database)) for each in actuators for channel in each.channels
    )
    return {name: entry for name, entry in found if entry is not None}


def _signal_of(channel: Channel, actuator: str, database: cantools.db.Database) -> dict[str, str] | None:
    """The one signal whose name tells of the actuator and whose unit is the channel's; None where several do."""
    candidates = [
        {"message": message.name, "signal": signal.name, "unit": str(signal.unit)}
        for message in database.messages
        for signal in message.signals
        if _measures(signal, channel.unit) and _tells_of(actuator, f"{message.name} {signal.name}")
    ]
    return candidates[0] if len(candidates) == 1 else None


def _measures(signal: DbcSignal, unit: str) -> bool:
    try:
        scale_to(unit, str(signal.unit))
    except ConfigurationError:
        return False
    return True


def _tells_of(actuator: str, text: str) -> bool:
    if _NO_FEEDBACK.search(text):
        return False
    plain = re.sub(r"[^a-z]", "", text.lower())
    words = ((word, *_ALSO_CALLED.get(word, ())) for word in actuator.split("_"))
    return all(any(name in plain for name in names) for names in words)
