"""Which DBC file describes a bus, and which of its signals are the controls of a ship."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import cantools
from cantools.database.can import Message as DbcMessage
from cantools.database.can import Signal as DbcSignal

from seatrial.acquisition.core.actuators import RUDDER, VESSELS, Actuators, rudders
from seatrial.acquisition.core.channel import Channel
from seatrial.acquisition.core.channels import BY_NAME
from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.acquisition.core.frames import Frame, FrameFlag
from seatrial.acquisition.core.units import canonical, scale_to
from seatrial.acquisition.decoders.dbc import frame_key, load_dbc
from seatrial.acquisition.decoders.nmea2000 import parameter_group

_NO_FEEDBACK = re.compile(r"(?i)order|command|cmd|demand|setpoint|request|reference|limit|max|min")
_ALSO_CALLED = {"starboard": ("stbd", "stb"), "tunnel": ("bow",), "propeller": ("prop",)}
_ENOUGH_MESSAGES = 2

SignalNames = dict[str, dict[str, str]]
"""By channel the message, signal and unit, as ``[source.signals]`` has them."""


class DbcMessages:
    """The messages of a DBC file by their frames: by identifier, else a 29-bit one by its parameter group."""

    def __init__(self, database: cantools.db.Database) -> None:
        self.count = len(database.messages)
        self._by_identifier = {
            (message.is_extended_frame, message.frame_id): message for message in database.messages
        }
        self._by_group = {frame_key(message): message for message in database.messages if message.is_extended_frame}

    def of(self, frame: Frame) -> DbcMessage | None:
        """The message that a frame is, if it has all of its bytes."""
        if frame.protocol != "can" or frame.flags & (FrameFlag.REMOTE | FrameFlag.ERROR):
            return None
        is_extended = not frame.flags & FrameFlag.STANDARD_ID
        message = self._by_identifier.get((is_extended, frame.identifier))
        if message is None and is_extended:
            message = self._by_group.get((True, parameter_group(frame.identifier)[0]))
        return message if message is not None and len(frame.payload) >= message.length else None

    def count_in(self, frames: Iterable[Frame]) -> int:
        """How many of the messages are among some frames."""
        return len({message.name for frame in frames if (message := self.of(frame)) is not None})


class DbcChoice(NamedTuple):
    """The DBC file that describes a bus, if one does, and what a user has to know of the choice."""

    path: Path | None
    remark: str = ""


def choose_dbc(named: Path | None, folders: Iterable[Path | None], frames: Sequence[Frame]) -> DbcChoice:
    """The DBC file of the bus that frames came on: the one ``named``, one in a folder, or one of Seatrial's.

    Raises :class:`ConfigurationError` for a named file that is none.
    """
    if named is not None:
        messages = DbcMessages(load_dbc(named))
        count = messages.count_in(frames)
        return DbcChoice(named if count else None, _coverage(named, count, messages))
    remarks: list[str] = []
    for folder in dict.fromkeys(directory.absolute() for directory in folders if directory is not None):
        if (path := _fitting(folder, frames, remarks)) is not None:
            return DbcChoice(path, "; ".join(remarks))
    path = None if remarks else own_dbc(frames)
    remarks += [] if path is None else [f"{path.name} of Seatrial fits"]
    return DbcChoice(path, "; ".join(remarks))


def _fitting(folder: Path, frames: Sequence[Frame], remarks: list[str]) -> Path | None:
    """The DBC file in a folder that fits frames: two of its messages come, or all of fewer; of several the one most
    of whose messages come. ``remarks`` take what is to be said of it, or of those that are not taken."""
    counts: dict[Path, int] = {}
    for path in sorted(folder.glob("*.dbc")):
        try:
            messages = DbcMessages(load_dbc(path))
        except ConfigurationError as error:
            remarks.append(f"{path.name} {error.what}: {error.why}")
            continue
        count = messages.count_in(frames)
        if count >= min(_ENOUGH_MESSAGES, messages.count) > 0:
            counts[path] = count
        if count:
            remarks.append(_coverage(path, count, messages))
    best = [path for path, count in counts.items() if count == max(counts.values())]
    if len(best) > 1:
        remarks.append("they fit alike: name one with --dbc")
    elif remarks and not best:
        remarks.append("if one is of this bus, name it with --dbc")
    return best[0] if len(best) == 1 else None


def _coverage(path: Path, count: int, messages: DbcMessages) -> str:
    return f"{path.name}: {count or 'none'} of its {messages.count} messages come{'s' * (count < 2)}"


def own_dbc(frames: Iterable[Frame]) -> Path | None:
    """The DBC file beside the vessel files that is the bus's own, if there is one.

    At least two of its messages come with their very identifiers, and none of its groups with others: proprietary
    groups mean something else on the next ship.
    """
    received = {
        frame.identifier for frame in frames if frame.protocol == "can" and not frame.flags & ~FrameFlag.LATE
    }
    for path in sorted(VESSELS.glob("*.dbc")):
        messages = load_dbc(path).messages
        identifiers = {message.frame_id for message in messages}
        groups = {frame_key(message)[1] for message in messages}
        foreign = {identifier for identifier in received - identifiers if parameter_group(identifier)[0] in groups}
        if len(identifiers & received) >= _ENOUGH_MESSAGES and not foreign:
            return path
    return None


def match_signals(path: Path, actuators: Actuators) -> SignalNames:
    """The signals that carry the control channels, as far as names and units tell. Raises ConfigurationError."""
    database = load_dbc(path)
    wanted = [(channel, actuator.name) for actuator in actuators for channel in actuator.channels]
    wanted += [] if rudders(actuators) else [(BY_NAME[RUDDER], "rudder")]
    matches = ((channel.name, _signal_of(channel, actuator, database)) for channel, actuator in wanted)
    return {name: entry for name, entry in matches if entry is not None}


def _signal_of(channel: Channel, actuator: str, database: cantools.db.Database) -> dict[str, str] | None:
    """The one signal whose name tells of the actuator and whose unit is the channel's; None where several do."""
    candidates = [
        {"message": message.name, "signal": signal.name, "unit": canonical(str(signal.unit))}
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
