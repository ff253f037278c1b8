"""Channels to CAN frames: NMEA 2000 by the ``nmea2000`` library, thrusters by the vessel's DBC file."""

from __future__ import annotations

import datetime as dt
from collections.abc import Callable, Mapping
from math import nan, pi, radians
from typing import Any

from cantools.database.can import Message as DbcMessage
from cantools.database.can import Signal as DbcSignal
from nmea2000.encoder import create_encoder
from nmea2000.input_formats import N2KFormat
from nmea2000.message import NMEA2000Field, NMEA2000Message

from seatrial.acquisition.config.sections import CanSource
from seatrial.acquisition.core.actuators import Actuators, name_of_order, rudder_channels, shafts
from seatrial.acquisition.core.channel import Channel
from seatrial.acquisition.core.frames import NANO
from seatrial.acquisition.core.units import DEG_PER_RAD, Linear
from seatrial.acquisition.decoders.clock import DAY_NS
from seatrial.acquisition.decoders.dbc import find_signal, load_dbc, missing_by_rule
from seatrial.acquisition.decoders.declared_groups import LIBRARY
from seatrial.acquisition.encoders import Moment, Packet

_ADDRESS = 35


class CanEncoder:
    """Everything one bus carries: standard parameter groups and the configured DBC signals."""

    def __init__(self, config: CanSource, actuators: Actuators, channels: Mapping[str, Channel]) -> None:
        self._rudders = rudder_channels(actuators)
        self._ratios = [
            (number, f"{name}_rpm", config.reduction_ratios[name])
            for number, name in enumerate(shafts(actuators))
            if name in config.reduction_ratios
        ]
        self._announces = config.clock == "source"
        self._encoder = create_encoder(N2KFormat.PYTHON_CAN)
        self._dbc: dict[str, tuple[DbcMessage, dict[str, tuple[DbcSignal, Linear]]]] = {}
        if config.dbc is not None:
            database = load_dbc(config.dbc)
            for channel, entry in config.signals.items():
                message, signal = find_signal(database, entry, config.dbc)
                step = entry.step_to(channels[channel])
                self._dbc.setdefault(message.name, (message, {}))[1][channel] = signal, step

    def encode(self, moment: Moment) -> list[Packet]:
        packets = self._system_time(moment) if self._announces else []
        if moment.latitude_deg is not None:
            fix = {"latitude": moment.latitude_deg, "longitude": moment.longitude_deg}
            packets += self._group(129025, "positionRapidUpdate", fix, moment.fix_of)
        values = dict(moment.values)
        for message, signals in self._dbc.values():
            packets += _dbc_frame(message, signals, values)
        packets += self._machinery(moment)
        for group, (name, reference, fields) in _MOTION.items():
            if carries := moment.present(*fields):
                group_fields = {fields[channel][0]: fields[channel][1](values[channel]) for channel in carries}
                packets += self._group(group, name, group_fields | reference, carries)
        return packets

    def _machinery(self, moment: Moment) -> list[Packet]:
        """Rudders with their orders, and shafts as their engines with the gear that tells the direction."""
        packets = []
        for number, angle in enumerate(self._rudders):
            if carries := moment.present(angle, name_of_order(angle)):
                position, order = (moment.values.get(name) for name in (angle, name_of_order(angle)))
                fields = {"instance": number, "position": _radians(position), "angleOrder": _radians(order)}
                packets += self._group(127245, "rudder", fields, carries)
        for number, channel, ratio in self._ratios:
            if channel in moment.values:
                speed = moment.values[channel] * ratio
                gear = {"instance": number, "transmissionGear": "Reverse" if speed < 0.0 else "Forward"}
                packets += self._group(127493, "transmissionParametersDynamic", gear, ())
                engine = {"instance": number, "speed": abs(speed)}
                packets += self._group(127488, "engineParametersRapidUpdate", engine, (channel,))
        return packets

    def _system_time(self, moment: Moment) -> list[Packet]:
        days, time_of_day_ns = divmod(moment.time_ns, DAY_NS)
        date = dt.date(1970, 1, 1) + dt.timedelta(days=days)
        fields = {"source": "GPS", "date": date, "time": time_of_day_ns / NANO}
        return self._group(126992, "systemTime", fields, (), priority=3)

    def _group(
        self, group: int, name: str, fields: dict[str, Any], carries: tuple[str, ...], priority: int = 2
    ) -> list[Packet]:
        """One parameter group as frames; fields that are None go out as not available."""
        library_fields = [
            NMEA2000Field(id=key, value=value, raw_value=value)
            for key, value in fields.items()
            if value is not None
        ]
        message = NMEA2000Message(
            PGN=group, id=name, source=_ADDRESS, destination=255, priority=priority, fields=library_fields
        )
        with LIBRARY:
            first, *further = self._encoder.encode(message)
        packets = [Packet(bytes(first.data), first.arbitration_id, carries=carries)]
        return packets + [Packet(bytes(frame.data), frame.arbitration_id) for frame in further]


def _radians(angle_deg: float | None) -> float | None:
    return None if angle_deg is None else angle_deg / DEG_PER_RAD


def _turn_rad(angle_deg: float) -> float:
    """An angle in radians that rounds to less than a whole turn on the wire."""
    angle_rad = round(angle_deg / DEG_PER_RAD, 4)
    return 0.0 if angle_rad > 2 * pi else angle_rad


_MOTION: dict[int, tuple[str, dict[str, str], dict[str, tuple[str, Callable[[float], float]]]]] = {
    127250: ("vesselHeading", {"reference": "True"}, {"heading_deg": ("heading", _turn_rad)}),
    127251: ("rateOfTurn", {}, {"yaw_rate_dps": ("rate", radians)}),
    130578: ("vesselSpeedComponents", {}, {"surge_mps": ("longitudinalSpeedGroundReferenced", float),
                                           "sway_mps": ("transverseSpeedGroundReferenced", float)}),
    130306: ("windData", {"reference": "True (ground referenced to North)"},
             {"wind_direction_deg": ("windAngle", _turn_rad), "wind_speed_mps": ("windSpeed", float)}),
}  # fmt: skip
"""The groups of motion and wind: the library's name, the reference, and the field of each channel in its unit."""


def _dbc_frame(
    message: DbcMessage, signals: dict[str, tuple[DbcSignal, Linear]], values: dict[str, float]
) -> list[Packet]:
    """One DBC message with the signals that have a value now; others, and values beyond it, as not available."""
    if not any(channel in values for channel in signals):
        return []
    raw = {signal.name: _not_available(signal) for signal in message.signals}
    carried = []
    for channel, (signal, step) in signals.items():
        if channel in values:
            value = float(signal.scaled_to_raw(step.invert(values[channel])))
            lowest = -int(2 ** (signal.length - 1)) if signal.is_signed else 0
            if signal.is_float or (lowest <= value and missing_by_rule(round(value), signal) is None):
                raw[signal.name] = value if signal.is_float else round(value)
                carried.append(channel)
    payload = message.encode(raw, scaling=False, strict=False)
    return [Packet(payload, message.frame_id, message.is_extended_frame, tuple(carried))]


def _not_available(signal: DbcSignal) -> float:
    if signal.is_float:
        return nan
    return int(2 ** (signal.length - (1 if signal.is_signed else 0)) - 1)
