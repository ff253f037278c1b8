"""Channels to NMEA 0183 sentences, with more decimals than the minimum where the format allows them."""

from __future__ import annotations

import datetime as dt
from math import floor

from acquisition.config.sections import Thrusters
from acquisition.core.units import KNOT_MPS
from acquisition.decoders.nmea0183 import checksum
from acquisition.encoders import Moment, Packet

_EPOCH = dt.datetime(1970, 1, 1, tzinfo=dt.UTC)


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
    degrees, rest = divmod(micro_minutes, 60_000_000)
    return f"{degrees:0{digits}d}{rest // 1_000_000:02d}.{rest % 1_000_000:06d}"


class Nmea0183Encoder:
    """GGA, HDT, ROT, VBW, MWD and TRD; ZDA first where the line announces the time."""

    def __init__(self, thrusters: Thrusters, announces: bool) -> None:
        self._announces = announces
        self._thrusters = thrusters.numbers

    def encode(self, moment: Moment) -> list[Packet]:
        packets = self._navigation(moment) + self._wind(moment) + self._thruster_responses(moment)
        return [_packet(_zda(moment.time_ns)), *packets] if self._announces else packets

    def _navigation(self, moment: Moment) -> list[Packet]:
        values, packets = moment.values, []
        if moment.latitude_deg is not None and moment.longitude_deg is not None:
            fix = _gga(moment.time_ns, moment.latitude_deg, moment.longitude_deg)
            packets.append(_packet(fix, *moment.fix_of))
        if "heading_deg" in values:
            packets.append(_packet(f"HEHDT,{_turn(values['heading_deg'], 4)},T", "heading_deg"))
        if "yaw_rate_dps" in values:
            packets.append(_packet(f"TIROT,{values['yaw_rate_dps'] * 60.0:.3f},A", "yaw_rate_dps"))
        if speeds := moment.both("surge_mps", "sway_mps"):
            along, across = (_decimals(each, 1.0 / KNOT_MPS, 4) for each in speeds)
            carries = moment.present("surge_mps", "sway_mps")
            packets.append(_packet(f"VDVBW,,,V,{along},{across},A,,V,,V", *carries))
        return packets

    def _wind(self, moment: Moment) -> list[Packet]:
        wind = moment.both("wind_direction_deg", "wind_speed_mps")
        if wind is None:
            return []
        direction, speed = wind
        knots, metres = _decimals(speed, 1.0 / KNOT_MPS, 3), _decimals(speed, 1.0, 3)
        carries = moment.present("wind_direction_deg", "wind_speed_mps")
        return [_packet(f"WIMWD,{_turn(direction, 3)},T,,M,{knots},N,{metres},M", *carries)]

    def _thruster_responses(self, moment: Moment) -> list[Packet]:
        packets = []
        for name, number in self._thrusters.items():
            pair = moment.both(f"{name}_rpm", f"{name}_angle_deg")
            if pair is not None:
                rpm, angle_deg = pair
                mode = "V" if rpm is None else "R"
                body = f"RCTRD,{number},{_decimals(rpm, 1.0, 3)},{mode},,V,{_turn(angle_deg, 3)}"
                packets.append(_packet(body, *moment.present(f"{name}_rpm", f"{name}_angle_deg")))
        return packets


def _packet(body: str, *carries: str) -> Packet:
    return Packet(sentence(body), carries=carries)


def _decimals(value: float | None, scale: float, digits: int) -> str:
    return "" if value is None else f"{value * scale:.{digits}f}"


def _turn(angle_deg: float | None, digits: int) -> str:
    """An angle from 0 to just below 360; rounding comes first, or 359.99999 would be sent as 360.0000."""
    return "" if angle_deg is None else f"{round(angle_deg % 360.0, digits) % 360.0:.{digits}f}"


def _clock(time_ns: int) -> tuple[dt.datetime, str]:
    """The UTC date and ``hhmmss.ffffff`` of a time; whole microseconds, rounded down."""
    moment = _EPOCH + dt.timedelta(microseconds=floor(time_ns / 1000))
    return moment, moment.strftime("%H%M%S.%f")


def _zda(time_ns: int) -> str:
    moment, clock = _clock(time_ns)
    return f"GPZDA,{clock},{moment:%d,%m,%Y},00,00"


def _gga(time_ns: int, latitude_deg: float, longitude_deg: float) -> str:
    _, clock = _clock(time_ns)
    latitude = f"{degrees_and_minutes(latitude_deg, 2)},{'N' if latitude_deg >= 0 else 'S'}"
    longitude = f"{degrees_and_minutes(longitude_deg, 3)},{'E' if longitude_deg >= 0 else 'W'}"
    return f"GPGGA,{clock},{latitude},{longitude},4,12,0.6,0.0,M,0.0,M,,"
