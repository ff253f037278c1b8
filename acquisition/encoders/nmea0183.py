"""Channels to NMEA 0183 sentences, with more decimals than the minimum where the format allows them."""

from __future__ import annotations

import datetime as dt
from collections.abc import Callable, Mapping
from functools import partial
from math import floor

from seatrial.acquisition.config.sections import LineSource, MqttLinks
from seatrial.acquisition.core.actuators import (
    Actuators,
    name_of_order,
    numbered_shafts,
    rudder_channels,
    shaft_numbers,
)
from seatrial.acquisition.core.channel import Channel
from seatrial.acquisition.core.frames import EPOCH
from seatrial.acquisition.core.units import KNOT_MPS
from seatrial.acquisition.decoders.nmea0183 import checksum
from seatrial.acquisition.encoders import Moment, Packet


def sentence(body: str) -> bytes:
    """A body between ``$`` and ``*`` made a sentence.

    >>> sentence("RCTRD,2,400.5,R,,V,90.8")
    b'$RCTRD,2,400.5,R,,V,90.8*55\\r\\n'
    """
    return f"${body}*{checksum(body.encode('ascii')):02X}\r\n".encode("ascii")


def degrees_and_minutes(angle_deg: float, digits: int) -> str:
    """An angle without its sign as ``ddmm.mmmmmm``; ``digits`` for the degrees.

    >>> degrees_and_minutes(-10.5, 3)
    '01030.000000'
    """
    micro_minutes = round(abs(angle_deg) * 60e6)
    degrees, remainder = divmod(micro_minutes, 60_000_000)
    return f"{degrees:0{digits}d}{remainder // 1_000_000:02d}.{remainder % 1_000_000:06d}"


class Nmea0183Encoder:
    """GGA, HDT, ROT, VBW, MWD; the ship's actuators; ZDA first where the line announces the time.

    Of actuators RSA and ROR, RPM and PRC, TRD and TRC; TRC for TRD where the line takes orders for responses.
    """

    def __init__(
        self, config: LineSource | MqttLinks, actuators: Actuators, channels: Mapping[str, Channel]
    ) -> None:
        self._announces = isinstance(config, LineSource) and config.clock == "source"
        self._thrusters = config.thrusters.numbers
        self._responses = "TRC" if config.thrusters.channels_from == "demand" else "TRD"
        angles = rudder_channels(actuators)
        self._rudders = tuple(reversed(angles)) if len(angles) <= 2 else ()
        shafts = shaft_numbers(numbered_shafts(actuators))
        self._shafts = {name: number for name, number in shafts.items() if name not in self._thrusters}

    def encode(self, moment: Moment) -> list[Packet]:
        packets = [Packet(sentence(_zda(moment.time_ns)))] if self._announces else []
        if moment.latitude_deg is not None and moment.longitude_deg is not None:
            fix = _gga(moment.time_ns, moment.latitude_deg, moment.longitude_deg)
            packets.append(Packet(sentence(fix), carries=moment.fix_of))
        for channels, body in _NAVIGATION.items():
            packets += _packet_of(moment, channels, body)
        return packets + self._machinery(moment)

    def _machinery(self, moment: Moment) -> list[Packet]:
        packets = _packet_of(moment, self._rudders, partial(_rudders, "RSA"))
        packets += _packet_of(moment, tuple(map(name_of_order, self._rudders)), partial(_rudders, "ROR"))
        for name, number in self._thrusters.items():
            pair = (f"{name}_rpm", f"{name}_angle_deg")
            packets += _packet_of(moment, pair, partial(_thruster, self._responses, number))
            packets += _packet_of(moment, tuple(map(name_of_order, pair)), partial(_thruster, "TRC", number))
        for name, number in self._shafts.items():
            pair = (f"{name}_rpm", f"{name}_pitch_percent")
            packets += _packet_of(moment, pair, partial(_shaft, number))
            packets += _packet_of(moment, tuple(map(name_of_order, pair)), partial(_shaft_order, number))
        return packets


Body = Callable[..., str]
"""A sentence's body from the values of channels, None for one that is not known."""


def _packet_of(moment: Moment, channels: tuple[str, ...], body: Body) -> list[Packet]:
    """The sentence of some channels; none where no value of them is known."""
    carries = moment.present(*channels)
    return [Packet(sentence(body(*map(moment.values.get, channels))), carries=carries)] if carries else []


def _rudders(kind: str, starboard_deg: float | None, port_deg: float | None = None) -> str:
    """The starboard or single rudder, then the port one."""
    fields = [f"{_decimals(angle_deg, 1.0, 4)},{_mode(angle_deg, 'A')}" for angle_deg in (starboard_deg, port_deg)]
    return f"ER{kind},{','.join(fields)}{',B' if kind == 'ROR' else ''}"


def _thruster(kind: str, number: int, rpm: float | None, angle_deg: float | None) -> str:
    ending = ",B,R" if kind == "TRC" else ""
    return f"RC{kind},{number},{_decimals(rpm, 1.0, 3)},{_mode(rpm, 'R')},,V,{_turn(angle_deg, 3)}{ending}"


def _shaft(number: int, rpm: float | None, pitch_percent: float | None) -> str:
    return f"ERRPM,S,{number},{_decimals(rpm, 1.0, 3)},{_decimals(pitch_percent, 1.0, 3)},A"


def _shaft_order(number: int, rpm: float | None, pitch_percent: float | None) -> str:
    speed, pitch = f"{_decimals(rpm, 1.0, 3)},{_mode(rpm, 'R')}", _decimals(pitch_percent, 1.0, 3)
    return f"ERPRC,,V,{speed},{pitch},{_mode(pitch_percent, 'P')},B,{number}"


def _mode(value: float | None, unit: str) -> str:
    """The letter of a value's unit, V for invalid where it is not there."""
    return "V" if value is None else unit


def _decimals(value: float | None, scale: float, digits: int) -> str:
    return "" if value is None else f"{value * scale:.{digits}f}"


def _turn(angle_deg: float | None, digits: int) -> str:
    """An angle from 0 to just below 360; rounding comes first, or 359.99999 would be sent as 360.0000."""
    return "" if angle_deg is None else f"{round(angle_deg % 360.0, digits) % 360.0:.{digits}f}"


def _clock(time_ns: int) -> tuple[dt.datetime, str]:
    """The UTC date and ``hhmmss.ffffff`` of a time; whole microseconds, rounded down."""
    moment = EPOCH + dt.timedelta(microseconds=floor(time_ns / 1000))
    return moment, moment.strftime("%H%M%S.%f")


def _zda(time_ns: int) -> str:
    moment, clock = _clock(time_ns)
    return f"GPZDA,{clock},{moment:%d,%m,%Y},00,00"


def _gga(time_ns: int, latitude_deg: float, longitude_deg: float) -> str:
    _, clock = _clock(time_ns)
    latitude = f"{degrees_and_minutes(latitude_deg, 2)},{'N' if latitude_deg >= 0 else 'S'}"
    longitude = f"{degrees_and_minutes(longitude_deg, 3)},{'E' if longitude_deg >= 0 else 'W'}"
    return f"GPGGA,{clock},{latitude},{longitude},4,12,0.6,0.0,M,0.0,M,,"


_NAVIGATION: dict[tuple[str, ...], Body] = {
    ("heading_deg",): lambda heading: f"HEHDT,{_turn(heading, 4)},T",
    ("yaw_rate_dps",): lambda rate: f"TIROT,{rate * 60.0:.3f},A",
    ("surge_mps", "sway_mps"): lambda ahead, aside: (
        f"VDVBW,,,V,{_decimals(ahead, 1.0 / KNOT_MPS, 4)},{_decimals(aside, 1.0 / KNOT_MPS, 4)},A,,V,,V"
    ),
    ("wind_direction_deg", "wind_speed_mps"): lambda direction, speed: (
        f"WIMWD,{_turn(direction, 3)},T,,M,{_decimals(speed, 1.0 / KNOT_MPS, 3)},N,{_decimals(speed, 1.0, 3)},M"
    ),
}
"""The sentences of motion and wind by the channels that they carry."""
