"""CAN frames of the vessel's DBC file, mostly of thrusters, which no standard message carries; the CAN encoder.

Frames with 29-bit identifiers are matched by parameter group, as J1939 devices choose their address, and obey its
rule that the highest raw values mean "not available" or "error"; 11-bit frames match exactly. Names such as
"Invalid" in the file's tables of values hold for both. The encoder writes NMEA 2000 by the ``nmea2000`` library.
"""

from __future__ import annotations

import datetime as dt
import re
from collections.abc import Mapping
from math import isfinite, nan, pi, radians
from pathlib import Path
from typing import Any

import cantools
from cantools.database.can import Message as DbcMessage
from cantools.database.can import Signal as DbcSignal
from nmea2000.encoder import create_encoder
from nmea2000.input_formats import N2KFormat
from nmea2000.message import NMEA2000Field, NMEA2000Message

from seatrial.acquisition.config.sources import CanSource, Signal
from seatrial.acquisition.core import files, process, quantities, ship, times, trial
from seatrial.acquisition.core.errors import ConfigurationError, system_reason
from seatrial.acquisition.protocols import Decoder, Moment, Packet, nmea2000

_NO_VALUE = re.compile(
    r"(?i)\b(sna|n/?a|not available|unavailable|invalid|error|fault|unknown|undefined|reserved)\b"
)
_SIZES = re.compile(rb"\|\s*(\d+)\s*@|^\s*BO_\s+\d+\s+\w+\s*:\s*(\d+)", re.MULTILINE)
_LINE_AND_COLUMN = re.compile(r"line (\d+), column (\d+)")
_ERROR = re.compile(r"(?i)error|fault")
_ADDRESS = 35


def load_dbc(path: Path) -> cantools.db.Database:
    """Read a DBC file. Raises :class:`ConfigurationError`."""
    try:
        content = files.read_regular_file(path, process.DBC_BYTES, ConfigurationError)
        longest = max(map(len, content.replace(b'\\"', b"__").split(b'"')))
        process.DBC_TEXT_BYTES.require_within_budget(longest, path, len(content), ConfigurationError)
        widest = max((int(bits or length) for bits, length in _SIZES.findall(content)), default=0)
        process.DBC_BITS.require_within_budget(widest, path, len(content), ConfigurationError)
        try:
            text = content.decode("utf-8-sig")
        except UnicodeDecodeError:  # as editors of DBC files write it
            text = content.decode("cp1252", "replace")
        return cantools.database.load_string(text, database_format="dbc")
    except ConfigurationError:
        raise
    except Exception as error:  # the parser fails in every possible way
        text = str(error)
        place, fault = _LINE_AND_COLUMN.search(text), re.search(r"(The (?:signals?|message) .+?)\.?\"?$", text)
        if isinstance(error, OSError):
            why = system_reason(error)
        elif place:
            why = f"line {place[1]}, column {place[2]} is not of a DBC file"
        else:  # without the words of the library that reads it
            why = fault[1] if fault else "its messages and signals contradict each other"
        fix = "give a DBC file, or correct it"
        raise ConfigurationError("is not a readable DBC file", where=str(path), why=why, fix=fix) from error


def find_signal(database: cantools.db.Database, entry: Signal, path: Path) -> tuple[DbcMessage, DbcSignal]:
    """The message and signal that a configuration names. Raises :class:`ConfigurationError`."""
    try:
        message = database.get_message_by_name(entry.message)
        return message, message.get_signal_by_name(entry.signal)
    except KeyError as error:
        names = (f"{frame.name}.{signal.name}" for frame in database.messages for signal in frame.signals)
        what, fix = f"has no signal {entry.message}.{entry.signal}", f"it has {', '.join(names)}"
        raise ConfigurationError(what, where=str(path), fix=fix) from error


def message_key(message: DbcMessage) -> tuple[bool, int]:
    """How frames find their message: the parameter group for 29-bit, the identifier for 11-bit frames."""
    if message.is_extended_frame:
        return True, nmea2000.split_can_identifier(message.frame_id)[0]
    return False, message.frame_id


def reserved_value_meaning(raw: float, signal: DbcSignal) -> str | None:
    """Why a raw value is no value by the rule of J1939-71 and NMEA 2000; None if it is one.

    From 16 bits on, the highest byte decides; below, the highest raw value is "not available" and, from 4 bits on,
    the next lower one "error". Signed signals keep their three highest values. A single bit has none to spare.
    """
    if signal.is_float:
        return None if isfinite(raw) else nmea2000.NOT_AVAILABLE
    bits, number = signal.length, int(raw)
    highest = int(2 ** (bits - (1 if signal.is_signed else 0)) - 1)
    if signal.is_signed:
        errors = 2 if bits >= 4 else 0
    elif bits >= 16:
        highest, errors, number = 0xFF, 1, number >> (bits - 8)
    else:
        errors = 1 if bits >= 4 else 0
    if bits == 1 or not highest - errors <= number:
        return None
    return nmea2000.NOT_AVAILABLE if number == highest else nmea2000.ERROR_VALUE


def why_signal_is_missing(raw: float, signal: DbcSignal, *, by_rule: bool) -> str | None:
    """Why a raw value is no value by the file's table of values, and ``by_rule`` or as a float by
    :func:`reserved_value_meaning`; None if it is one."""
    name = str((signal.choices or {}).get(int(raw), "")) if isfinite(raw) else ""
    if _NO_VALUE.search(name.replace("_", " ")):
        return nmea2000.ERROR_VALUE if _ERROR.search(name) else nmea2000.NOT_AVAILABLE
    return reserved_value_meaning(raw, signal) if by_rule or signal.is_float else None


def raw_signal_values(message: DbcMessage, payload: bytes) -> dict[str, float] | None:
    """The raw values of the signals in a frame, None if it cannot be read; what follows the message is ignored."""
    try:
        raw: dict[str, float] = message.decode(payload[: message.length], decode_choices=False, scaling=False)
    except Exception:  # an unknown multiplexer value, and whatever else the library finds
        return None
    return raw


class DbcDecoder(Decoder):
    """The configured signals of one DBC file; ``buses`` has the device of each address on the bus of a frame."""

    def __init__(
        self,
        path: Path,
        signals: dict[str, Signal],
        buses: nmea2000.Nmea2000Decoder,
        channels: Mapping[str, ship.Channel] = ship.BY_NAME,
    ) -> None:
        super().__init__()
        self._buses = buses
        self._mapped: dict[tuple[bool, int], tuple[DbcMessage, list[tuple[str, DbcSignal, quantities.Linear]]]] = {}
        database = load_dbc(path)
        for channel, entry in signals.items():
            message, signal = find_signal(database, entry, path)
            _, mapped = self._mapped.setdefault(message_key(message), (message, []))
            mapped.append((channel, signal, entry.conversion_to_channel(channels[channel])))

    def decode(self, frame: trial.Frame) -> list[trial.Group]:
        if frame.flags & (trial.FrameFlag.REMOTE | trial.FrameFlag.ERROR):
            return []
        extended = not frame.flags & trial.FrameFlag.STANDARD_ID
        group, address = nmea2000.split_can_identifier(frame.identifier)
        message, mapped = self._mapped.get((extended, group if extended else frame.identifier), (None, []))
        if message is None:
            return []
        bus = self._buses.bus_of_frame(frame)
        device = (
            bus.devices.label_of_address(address) if extended else f"{frame.identifier:03X}{bus.devices.at_bus}"
        )
        is_short = len(frame.payload) < message.length
        raw = None if is_short else raw_signal_values(message, frame.payload)
        if raw is None:
            self.refused["short frame" if is_short else "undecodable"] += 1
            return []
        values = []
        for channel, signal, step in mapped:  # a frame carries only some of the multiplexed signals
            if signal.name in raw and bus.devices.may_provide(device, channel):
                number = raw[signal.name]
                missing = why_signal_is_missing(number, signal, by_rule=extended)
                value = 0.0 if missing else step.apply(float(signal.raw_to_scaled(number, False)))
                if missing or not isfinite(value):
                    self.refused[missing or "impossible value"] += 1
                else:
                    values.append((channel, value))
        return bus.clock.group_values(frame, f"{frame.origin}/{device}:{message.name}", values)


class CanEncoder:
    """Everything one bus carries: standard parameter groups and the configured DBC signals."""

    def __init__(self, config: CanSource, actuators: ship.Actuators, channels: Mapping[str, ship.Channel]) -> None:
        self._rudders = ship.rudder_channels(actuators)
        self._ratios = [
            (number, f"{name}_rpm", config.reduction_ratios[name])
            for number, name in enumerate(ship.shafts(actuators))
            if name in config.reduction_ratios
        ]
        self._announces = config.clock == "source"
        self._encoder = create_encoder(N2KFormat.PYTHON_CAN)
        self._dbc: dict[str, tuple[DbcMessage, dict[str, tuple[DbcSignal, quantities.Linear]]]] = {}
        if config.dbc is not None:
            database = load_dbc(config.dbc)
            for channel, entry in config.signals.items():
                message, signal = find_signal(database, entry, config.dbc)
                step = entry.conversion_to_channel(channels[channel])
                self._dbc.setdefault(message.name, (message, {}))[1][channel] = signal, step

    def encode(self, moment: Moment) -> list[Packet]:
        packets: list[Packet] = []
        if self._announces:
            days, time_of_day_ns = divmod(moment.time_ns, times.DAY_NS)
            date = dt.date(1970, 1, 1) + dt.timedelta(days=days)
            time = {"source": "GPS", "date": date, "time": time_of_day_ns / trial.NANO}
            packets += self._encode_group(126992, time, (), priority=3)
        if moment.latitude_deg is not None:
            fix = {"latitude": moment.latitude_deg, "longitude": moment.longitude_deg}
            packets += self._encode_group(129025, fix, moment.channels_in_fix)
        values = moment.values
        for message, signals in self._dbc.values():
            packets += _encode_dbc_message(message, signals, values)
        packets += self._machinery(moment)
        for group, reference in _MOTION.items():
            if carries := moment.present(*nmea2000.CARRIED[group]):
                fields: dict[str, Any] = {
                    nmea2000.CARRIED[group][name]: _to_si_and_radians(name, values[name]) for name in carries
                }
                packets += self._encode_group(group, fields | reference, carries)
        return packets

    def _machinery(self, moment: Moment) -> list[Packet]:
        """Rudders with their orders, and shafts as their engines with the gear that has the direction."""
        packets = []
        for number, angle in enumerate(self._rudders):
            if carries := moment.present(angle, ship.order_channel_name(angle)):
                keys = {angle: "position", ship.order_channel_name(angle): "angleOrder"}
                fields = {keys[name]: moment.values[name] / quantities.DEG_PER_RAD for name in carries}
                packets += self._encode_group(127245, {"instance": number, **fields}, carries)
        for number, channel, ratio in self._ratios:
            if channel in moment.values:
                speed = moment.values[channel] * ratio
                gear = {"instance": number, "transmissionGear": "Reverse" if speed < 0.0 else "Forward"}
                packets += self._encode_group(127493, gear, ())
                engine = {"instance": number, "speed": abs(speed)}
                packets += self._encode_group(127488, engine, (channel,))
        return packets

    def _encode_group(
        self, group: int, fields: Mapping[str, Any], carries: tuple[str, ...], priority: int = 2
    ) -> list[Packet]:
        """One parameter group as frames; fields that are None go out as not available."""
        library_fields = [
            NMEA2000Field(id=key, value=value, raw_value=value)
            for key, value in fields.items()
            if value is not None
        ]
        name = nmea2000.group_variants(group)[0].id
        message = NMEA2000Message(
            PGN=group, id=name, source=_ADDRESS, destination=255, priority=priority, fields=library_fields
        )
        with nmea2000.LIBRARY:
            first, *further = self._encoder.encode(message)
        packets = [Packet(bytes(first.data), first.arbitration_id, carries=carries)]
        return packets + [Packet(bytes(frame.data), frame.arbitration_id) for frame in further]


def _to_si_and_radians(channel: str, value: float) -> float:
    """A channel's value in SI units and radians; an angle is one that rounds to less than a whole turn."""
    if channel.endswith("_dps"):
        return radians(value)
    if not channel.endswith("_deg"):
        return float(value)
    angle_rad = round(value / quantities.DEG_PER_RAD, 4)
    return 0.0 if angle_rad > 2 * pi else angle_rad


_MOTION = {
    127250: {"reference": "True"},
    127251: {},
    130578: {},
    130306: {"reference": "True (ground referenced to North)"},
}
"""The groups of motion and wind that are sent, with their reference."""


def _encode_dbc_message(
    message: DbcMessage, signals: dict[str, tuple[DbcSignal, quantities.Linear]], values: dict[str, float]
) -> list[Packet]:
    """One DBC message with the signals that have a value now; others, and values beyond it, as not available."""
    if not any(channel in values for channel in signals):
        return []
    raw = {
        signal.name: nan if signal.is_float else int(2 ** (signal.length - (1 if signal.is_signed else 0)) - 1)
        for signal in message.signals
    }
    carried = []
    for channel, (signal, step) in signals.items():
        if channel in values:
            value = float(signal.scaled_to_raw(step.invert(values[channel])))
            lowest = -int(2 ** (signal.length - 1)) if signal.is_signed else 0
            if signal.is_float or (lowest <= value and reserved_value_meaning(round(value), signal) is None):
                raw[signal.name] = value if signal.is_float else round(value)
                carried.append(channel)
    payload = message.encode(raw, scaling=False, strict=False)
    return [Packet(payload, message.frame_id, message.is_extended_frame, tuple(carried))]
