"""Channels to NMEA 0183 sentences, with more decimals than the minimum where the format allows them."""

from __future__ import annotations

import datetime as dt
from math import floor

from acquisition.config.sections import Thrusters
from acquisition.core.actuators import (
    Actuators,
    name_of_order,
    numbered_shafts,
    rudder_channels,
    shaft_numbers,
)
from acquisition.core.frames import EPOCH
from acquisition.core.units import KNOT_MPS
from acquisition.decoders.nmea0183 import checksum
from acquisition.encoders import Moment, Packet


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
    """GGA, HDT, ROT, VBW, MWD; the ship's actuators; ZDA first where the line announces the time."""

    def __init__(self, thrusters: Thrusters, actuators: Actuators, announces: bool) -> None:
        self._announces = announces
        self._machinery = MachineryEncoder(thrusters, actuators)

    def encode(self, moment: Moment) -> list[Packet]:
        packets = self._navigation(moment) + self._wind(moment) + self._machinery.encode(moment)
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


class MachineryEncoder:
    """RSA and ROR, RPM and PRC, TRD and TRC; TRC in place of TRD where the line takes orders for responses."""

    def __init__(self, thrusters: Thrusters, actuators: Actuators) -> None:
        self._thrusters = thrusters.numbers
        self._responses = "TRC" if thrusters.channels_from == "demand" else "TRD"
        self._rudders = rudder_channels(actuators)
        shafts = shaft_numbers(numbered_shafts(actuators))
        self._shafts = {name: number for name, number in shafts.items() if name not in self._thrusters}

    def encode(self, moment: Moment) -> list[Packet]:
        orders = tuple(map(name_of_order, self._rudders))
        packets = _rudders("RSA", moment, self._rudders) + _rudders("ROR", moment, orders)
        for name, number in self._thrusters.items():
            rpm, angle = f"{name}_rpm", f"{name}_angle_deg"
            packets += _thruster(self._responses, number, moment, rpm, angle)
            packets += _thruster("TRC", number, moment, name_of_order(rpm), name_of_order(angle))
        for name, number in self._shafts.items():
            packets += _shaft(number, moment, f"{name}_rpm", f"{name}_pitch_percent")
            packets += _shaft_order(number, moment, f"{name}_order_rpm", f"{name}_order_pitch_percent")
        return packets


def _rudders(kind: str, moment: Moment, channels: tuple[str, ...]) -> list[Packet]:
    """The starboard or single rudder, then the port one."""
    carries = moment.present(*channels)
    if not carries or len(channels) > 2:
        return []
    both = (channels[-1], channels[0] if len(channels) == 2 else "")
    fields = [f"{_decimals(moment.values.get(name), 1.0, 4)},{'A' if name in carries else 'V'}" for name in both]
    return [_packet(f"ER{kind},{','.join(fields)}{',B' if kind == 'ROR' else ''}", *carries)]


def _thruster(kind: str, number: int, moment: Moment, rpm: str, angle: str) -> list[Packet]:
    pair = moment.both(rpm, angle)
    if pair is None:
        return []
    ending = ",B,R" if kind == "TRC" else ""
    body = f"RC{kind},{number},{_decimals(pair[0], 1.0, 3)},{_mode(pair[0], 'R')},,V,{_turn(pair[1], 3)}{ending}"
    return [_packet(body, *moment.present(rpm, angle))]


def _shaft(number: int, moment: Moment, rpm: str, pitch: str) -> list[Packet]:
    pair = moment.both(rpm, pitch)
    if pair is None:
        return []
    speed, percent = (_decimals(each, 1.0, 3) for each in pair)
    return [_packet(f"ERRPM,S,{number},{speed},{percent},A", *moment.present(rpm, pitch))]


def _shaft_order(number: int, moment: Moment, rpm: str, pitch: str) -> list[Packet]:
    pair = moment.both(rpm, pitch)
    if pair is None:
        return []
    speed, percent = (
        f"{_decimals(each, 1.0, 3)},{_mode(each, unit)}" for each, unit in zip(pair, "RP", strict=True)
    )
    return [_packet(f"ERPRC,,V,{speed},{percent},B,{number}", *moment.present(rpm, pitch))]


def _mode(value: float | None, unit: str) -> str:
    """The letter of a value's unit, V for invalid where it is not there."""
    return "V" if value is None else unit


def _packet(body: str, *carries: str) -> Packet:
    return Packet(sentence(body), carries=carries)


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
