"""What each sentence of NMEA 0183 says: one reader a sentence, from fields to values.

Rudders are told apart by their place in RSA and ROR (HTD knows one only), shafts by their number in RPM and PRC,
azimuth and tunnel thrusters by theirs in TRD and TRC (IEC 61162-1). Of two rudders or shafts the port one is listed
first.

Everything is read here and not by a library: those at hand refuse a whole sentence for one field that they cannot
read, do not know VWR and VWT, and take the real numbers of TRD for integers. A field that holds no number is
missing; only what is marked valid counts; what is left out has a reason.
"""

from __future__ import annotations

import datetime as dt
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Literal

from seatrial.acquisition.config.sections import Thrusters
from seatrial.acquisition.core.actuators import (
    Actuator,
    Actuators,
    name_of_order,
    numbered_shafts,
    rudder_channels,
    rudders,
    shaft_of_number,
)
from seatrial.acquisition.core.frames import Quality
from seatrial.acquisition.core.units import KNOT_MPS

_ROUNDED_KMH = 0.15  # knots and km/h, each to a tenth
_NUMBER = re.compile(r"[+-]?(\d{1,9}(\.\d*)?|\.\d+)")
_DEGREES_AND_MINUTES = re.compile(r"(\d{1,3})([0-5]\d(?:\.\d*)?)")
_TIME_OF_DAY = re.compile(r"([01]\d|2[0-3])([0-5]\d)([0-5]\d(?:\.\d*)?|60(?:\.\d*)?)")
_SIGNS = {"N": 1.0, "S": -1.0, "E": 1.0, "W": -1.0}
MPS_OF_UNIT = {"N": KNOT_MPS, "K": 1.0 / 3.6, "M": 1.0, "S": 0.44704}  # S: statute miles per hour
Values = list[tuple[str, float]]
NOT_VALID = "not marked valid"
# Dead reckoning, typed in by hand, a simulator: true enough to be recorded, and to be looked at.
_SUSPECT_MODES = frozenset("EMS")
_SUSPECT_FIXES = frozenset("678")
_BEST_MODES = "RFPDAEMSN"
_FIX_OF_MODE = {"N": 0, "A": 1, "D": 2, "P": 3, "R": 4, "F": 5, "E": 6, "M": 7, "S": 8}


class Fields:
    """The fields of one sentence, some of them empty, some perhaps not there at all."""

    def __init__(self, texts: list[str]) -> None:
        self._texts = texts

    def __len__(self) -> int:
        return len(self._texts)

    def text(self, index: int, absent: str = "") -> str:
        return self._texts[index].strip() if index < len(self._texts) else absent

    def number(self, index: int) -> float | None:
        text = self.text(index)
        return float(text) if _NUMBER.fullmatch(text) else None

    def measured(self, index: int, letter: str) -> float | None:
        """A number followed by the letter of its unit or reference, which some leave empty."""
        return self.number(index) if self.text(index + 1) in (letter, "") else None

    def eastward(self, index: int) -> float | None:
        """An angle [deg] followed by E or W, east positive."""
        angle_deg, letter = self.number(index), self.text(index + 1)
        return None if angle_deg is None or letter not in ("E", "W") else _SIGNS[letter] * angle_deg

    def degrees(self, index: int, letters: str) -> float | None:
        """``ddmm.mmmm`` followed by one of two letters, as degrees, north and east positive."""
        match, letter = _DEGREES_AND_MINUTES.fullmatch(self.text(index)), self.text(index + 1)
        if match is None or letter not in tuple(letters):
            return None
        return _SIGNS[letter] * (int(match[1]) + float(match[2]) / 60.0)

    def speed_mps(self, *places: tuple[int, str]) -> float | None:
        """The first speed that is given, of those at an index in a unit; so the finest unit comes first.

        The letter behind a number names its unit, the place only where that is empty: some devices leave the
        first of two speeds out, and not its place.
        """
        for index, unit in places:
            speed, factor = self.number(index), MPS_OF_UNIT.get(self.text(index + 1) or unit)
            if speed is not None and factor is not None:
                return speed * factor
        return None

    def seconds_of_day(self, index: int) -> float | None:
        """``hhmmss.sss`` as seconds since midnight; the leap second is the next day's first."""
        match = _TIME_OF_DAY.fullmatch(self.text(index))
        return int(match[1]) * 3600 + int(match[2]) * 60 + float(match[3]) if match else None


@dataclass(frozen=True, slots=True)
class SentenceReading:
    """What one sentence says. ``meaning`` tells apart the different things that one kind of sentence can say;
    ``refused`` is why something in it was left out, empty if nothing was. ``fix``, ``height_m`` and ``sigma_m`` are
    what the receiver says of its fix, as in :class:`Fix`.
    """

    values: Values = field(default_factory=list)
    meaning: str = ""
    quality: Quality = Quality.NOT_EVALUATED
    refused: str = ""
    date: dt.date | None = None
    seconds_of_day: float | None = None
    fix: int | None = None
    height_m: float | None = None
    sigma_m: tuple[float, float, float] | None = None


Reader = Callable[[Fields], SentenceReading]


def present(*pairs: tuple[str, float | None]) -> Values:
    """Those of the pairs that have a value."""
    return [(name, value) for name, value in pairs if value is not None]


def _knots(fields: Fields, index: int) -> float | None:
    knots = fields.number(index)
    return None if knots is None else knots * KNOT_MPS


def _position(fields: Fields, index: int) -> Values:
    """Both or none: half a position is none."""
    pair = (("latitude_deg", fields.degrees(index, "NS")), ("longitude_deg", fields.degrees(index + 2, "EW")))
    both = present(*pair)
    return both if len(both) == 2 else []


def _quality(mode: str) -> Quality:
    return Quality.SUSPECT if mode in _SUSPECT_MODES else Quality.NOT_EVALUATED


def _gga(fields: Fields) -> SentenceReading:
    fix = fields.text(5)
    if fix in ("0", ""):
        return SentenceReading(refused=NOT_VALID, fix=0)
    quality = Quality.SUSPECT if fix in _SUSPECT_FIXES else Quality.NOT_EVALUATED
    number = int(fix) if fix in tuple("123456789") else None
    height_m, geoid_m = fields.measured(8, "M"), fields.measured(10, "M")
    return SentenceReading(
        _position(fields, 1),
        quality=quality,
        seconds_of_day=fields.seconds_of_day(0),
        fix=number,
        height_m=None if height_m is None else height_m + (geoid_m or 0.0),
    )


def _gns(fields: Fields) -> SentenceReading:
    """The fix of a receiver of several constellations: of their modes, one letter each, the best holds."""
    modes = [mode for mode in _BEST_MODES if mode in fields.text(5)]
    if not modes or modes[0] == "N":
        return SentenceReading(refused=NOT_VALID, fix=0)
    height_m, geoid_m = fields.number(8), fields.number(9)
    return SentenceReading(
        _position(fields, 1),
        quality=_quality(modes[0]),
        seconds_of_day=fields.seconds_of_day(0),
        fix=_FIX_OF_MODE[modes[0]],
        height_m=None if height_m is None else height_m + (geoid_m or 0.0),
    )


def _gst(fields: Fields) -> SentenceReading:
    """The errors of the fix: standard deviations of latitude, longitude and height [m]."""
    north_m, east_m, up_m = (fields.number(index) for index in (5, 6, 7))
    if north_m is None or east_m is None or up_m is None:
        return SentenceReading()
    return SentenceReading(sigma_m=(east_m, north_m, up_m))


def _gll(fields: Fields) -> SentenceReading:
    mode = fields.text(6)
    if fields.text(5, absent="A") != "A" or mode == "N":
        return SentenceReading(refused=NOT_VALID, fix=0)
    seconds = fields.seconds_of_day(4)
    return SentenceReading(
        _position(fields, 0), quality=_quality(mode), seconds_of_day=seconds, fix=_FIX_OF_MODE.get(mode)
    )


def _rmc(fields: Fields) -> SentenceReading:
    mode = fields.text(11)
    if fields.text(1) != "A" or mode == "N":
        return SentenceReading(refused=NOT_VALID, fix=0)
    movement = present(
        ("course_over_ground_deg", fields.number(7)),
        ("speed_over_ground_mps", _knots(fields, 6)),
        ("magnetic_variation_deg", fields.eastward(9)),
    )
    return SentenceReading(
        _position(fields, 2) + movement,
        quality=_quality(mode),
        date=_six_digit_date(fields.text(8)),
        seconds_of_day=fields.seconds_of_day(0),
        fix=_FIX_OF_MODE.get(mode),
    )


def _six_digit_date(text: str) -> dt.date | None:
    """``ddmmyy``; 80 to 99 are of the last century, as receivers say that do not know the date yet."""
    if not re.fullmatch(r"\d{6}", text):
        return None
    year = int(text[4:])
    return _date(year + (1900 if year >= 80 else 2000), int(text[2:4]), int(text[:2]))


def _zda(fields: Fields) -> SentenceReading:
    parts = [fields.text(index) for index in (3, 2, 1)]
    date = _date(*map(int, parts)) if all(re.fullmatch(r"\d{1,4}", part) for part in parts) else None
    seconds = fields.seconds_of_day(0)
    refused = "no time" if date is None or seconds is None else ""
    return SentenceReading(date=date, seconds_of_day=seconds, refused=refused)


def _date(year: int, month: int, day: int) -> dt.date | None:
    try:
        return dt.date(year, month, day)
    except ValueError:
        return None


def _vtg(fields: Fields) -> SentenceReading:
    mode = fields.text(8)
    if mode == "N":
        return SentenceReading(refused=NOT_VALID)
    if len(fields) == 4 and not any(fields.text(index).isalpha() for index in range(4)):
        return _vtg_without_letters(fields)
    course, speed = fields.measured(0, "T"), fields.speed_mps((4, "N"), (6, "K"))
    values = present(("course_over_ground_deg", course), ("speed_over_ground_mps", speed))
    return SentenceReading(values, quality=_quality(mode))


def _vtg_without_letters(fields: Fields) -> SentenceReading:
    """Before NMEA 2.3: course true and magnetic, speed in knots and km/h; a cut one has none that agree."""
    course, knots, kmh = (fields.number(index) for index in (0, 2, 3))
    if knots is None or kmh is None or abs(knots * 1.852 - kmh) > _ROUNDED_KMH:
        return SentenceReading(refused="a form that is not known")
    values = present(("course_over_ground_deg", course), ("speed_over_ground_mps", knots * KNOT_MPS))
    return SentenceReading(values)


def _ths(fields: Fields) -> SentenceReading:
    mode = fields.text(1)
    if mode not in ("A", *_SUSPECT_MODES):
        return SentenceReading(refused=NOT_VALID)
    return SentenceReading(present(("heading_deg", fields.number(0))), quality=_quality(mode))


def _hdg(fields: Fields) -> SentenceReading:
    sensor, deviation = fields.number(0), fields.eastward(1)
    # A sum may pass north; a sensor that says more than a turn itself is left for the range check to find.
    if sensor is not None and deviation is not None and 0.0 <= sensor <= 360.0:
        sensor = (sensor + deviation) % 360.0
    pair = ("heading_magnetic_deg", sensor), ("magnetic_variation_deg", fields.eastward(3))
    return SentenceReading(present(*pair))


def _rot(fields: Fields) -> SentenceReading:
    rate_deg_per_min = fields.number(0)
    if fields.text(1) != "A":
        return SentenceReading(refused=NOT_VALID)
    return SentenceReading([] if rate_deg_per_min is None else [("yaw_rate_dps", rate_deg_per_min / 60.0)])


def _vbw(fields: Fields) -> SentenceReading:
    ground = present(("surge_mps", _knots(fields, 3)), ("sway_mps", _knots(fields, 4)))
    water = present(("speed_through_water_mps", _knots(fields, 0)))
    ground_valid, water_valid = fields.text(5) == "A", fields.text(2) == "A"
    left_out = (ground and not ground_valid) or (water and not water_valid)
    values = (ground if ground_valid else []) + (water if water_valid else [])
    return SentenceReading(values, refused=NOT_VALID if left_out else "")


def _mwv(fields: Fields, theoretical: str) -> SentenceReading:
    reference = {"R": "apparent", "T": theoretical}.get(fields.text(1))
    if reference is None:
        return SentenceReading(refused="wind reference unknown")
    if fields.text(4) != "A":
        return SentenceReading(refused=NOT_VALID)
    speed, unit = fields.number(2), MPS_OF_UNIT.get(fields.text(3))
    if speed is None or unit is None:
        reading = _bow_wind(fields.number(0), None, reference)
        return reading if speed is None else replace(reading, refused="unit unknown")
    return _bow_wind(fields.number(0), speed * unit, reference)


def _obsolete_wind(fields: Fields, reference: str) -> SentenceReading:
    """VWR and VWT: up to 180 degrees to the left or right of the bow."""
    angle, sign = fields.number(0), {"R": 1.0, "L": -1.0}.get(fields.text(1))
    signed = None if angle is None or sign is None or not 0.0 <= angle <= 180.0 else sign * angle
    return _bow_wind(signed, fields.speed_mps((2, "N"), (4, "M"), (6, "K")), reference)


def _bow_wind(angle_deg: float | None, speed_mps: float | None, reference: str) -> SentenceReading:
    pair = (f"wind_angle_{reference}_deg", angle_deg), (f"wind_speed_{reference}_mps", speed_mps)
    return SentenceReading(present(*pair), reference)


def _mwd(fields: Fields) -> SentenceReading:
    speed = present(("wind_speed_mps", fields.speed_mps((4, "N"), (6, "M"))))
    true = present(("wind_direction_deg", fields.measured(0, "T")))
    magnetic = present(("wind_direction_magnetic_deg", fields.measured(2, "M")))
    return SentenceReading(true + speed) if true or not magnetic else SentenceReading(magnetic + speed, "magnetic")


_READERS: dict[str, Reader] = {
    "GGA": _gga,
    "GNS": _gns,
    "GST": _gst,
    "GLL": _gll,
    "RMC": _rmc,
    "ZDA": _zda,
    "VTG": _vtg,
    "HDT": lambda fields: SentenceReading(present(("heading_deg", fields.measured(0, "T")))),
    "THS": _ths,
    "HDG": _hdg,
    "HDM": lambda fields: SentenceReading(present(("heading_magnetic_deg", fields.measured(0, "M")))),
    "ROT": _rot,
    "VBW": _vbw,
    # the headings in it repeat those of another device
    "VHW": lambda fields: SentenceReading(
        present(("speed_through_water_mps", fields.speed_mps((4, "N"), (6, "K"))))
    ),
    "MWD": _mwd,
}


def readers(theoretical_wind: Literal["ground", "water"]) -> dict[str, Reader]:
    """The reader of each sentence of motion, wind and time, by its last three letters."""
    theoretical = "theoretical" if theoretical_wind == "ground" else "water"
    return {
        **_READERS,
        "MWV": partial(_mwv, theoretical=theoretical),
        "VWR": partial(_obsolete_wind, reference="apparent"),
        "VWT": partial(_obsolete_wind, reference=theoretical),
    }


_Controls = dict[float, tuple[str, str]]
"""The channels of each thruster's shaft speed and angle, empty if it has none, by its number in TRD and TRC."""


def _rudders(fields: Fields, channels: tuple[str, ...]) -> SentenceReading:
    """RSA and ROR: starboard or single rudder first, then port. Of a single one any sensor will do."""
    if len(channels) > 2:
        return SentenceReading(refused="more than two rudders")
    valid = [fields.number(index) if fields.text(index + 1) == "A" else None for index in (0, 2)]
    if fields.text(1) != "A" and fields.text(3) != "A":
        return SentenceReading(refused=NOT_VALID)
    if len(channels) == 1:
        return SentenceReading(present((channels[0], valid[0] if fields.text(1) == "A" else valid[1])))
    port, starboard = channels
    return SentenceReading(present((port, valid[1]), (starboard, valid[0])))


def _heading_control(fields: Fields, channels: tuple[str, ...]) -> SentenceReading:
    """HTD: the rudder angle that a heading or track control system orders, and its side."""
    if len(channels) > 1:
        return SentenceReading(refused="one order to several rudders")
    angle, sign = fields.number(1), {"R": 1.0, "L": -1.0}.get(fields.text(2))
    ordered = None if angle is None or sign is None or angle < 0.0 else sign * angle
    return _as_orders(SentenceReading(present((channels[0], ordered))))


def _rpm(fields: Fields, shafts: Actuators, reduction_ratios: Mapping[str, float]) -> SentenceReading:
    """A shaft's speed and pitch; an engine's speed stands for its shaft's where its reduction ratio is known."""
    source, number = fields.text(0), fields.number(1)
    if source not in ("S", "E"):
        return SentenceReading(refused="rpm of no shaft")
    shaft = shaft_of_number(number, shafts)
    if shaft is None:
        return SentenceReading(refused="rpm of a single or unknown shaft")
    ratio = reduction_ratios.get(shaft.name) if source == "E" else 1.0
    if ratio is None:
        return SentenceReading(refused="engine rpm")
    if fields.text(4) != "A":
        return SentenceReading(refused=NOT_VALID)
    rpm = fields.number(2)
    values = _of_shaft(shaft, None if rpm is None else rpm / ratio, fields.number(3))
    return SentenceReading(values, f"{'shaft' if source == 'S' else 'engine'} {number:.0f}")


def _of_shaft(shaft: Actuator, rpm: float | None, pitch_percent: float | None) -> list[tuple[str, float]]:
    """Those of the two values that a shaft has a channel for: pitch, with a controllable one only."""
    channels = {channel.name for channel in shaft.channels}
    both = present((f"{shaft.name}_rpm", rpm), (f"{shaft.name}_pitch_percent", pitch_percent))
    return [(name, value) for name, value in both if name in channels]


def _in_rpm(value: float | None, mode: str, rated_rpm: float | None) -> float | None:
    """A shaft's speed by its mode: R rpm, P percent of the rated one; None where it is neither, or not known."""
    if value is None or mode == "R":
        return value
    return None if mode != "P" or rated_rpm is None else value * rated_rpm / 100.0


def _propulsion_order(fields: Fields, shafts: Actuators, rated_rpm: Mapping[str, float]) -> SentenceReading:
    """PRC: lever, its status, rpm, its mode, pitch, its mode, location, shaft."""
    shaft = shaft_of_number(fields.number(7), shafts)
    if shaft is None:
        return SentenceReading(refused="order to an unknown shaft")
    rpm = _in_rpm(fields.number(2), fields.text(3), rated_rpm.get(shaft.name))
    pitch_percent = fields.number(4) if fields.text(5) == "P" else None
    return _as_orders(SentenceReading(_of_shaft(shaft, rpm, pitch_percent), f"shaft {fields.number(7):.0f}"))


def _thruster(fields: Fields, controls: _Controls, rated_rpm: Mapping[str, float]) -> SentenceReading:
    """TRD and TRC: number, rpm, its mode, pitch, its mode, azimuth, which is the direction of the thrust.

    ``rated_rpm`` is by channel.
    """
    number = fields.number(0)
    shaft, azimuth = ("", "") if number is None else controls.get(number, ("", ""))
    if not shaft:
        return SentenceReading(refused="thruster not understood")
    speed, mode = fields.number(1), fields.text(2)
    rpm = present((shaft, _in_rpm(speed, mode, rated_rpm.get(shaft))))
    angle = present((azimuth, fields.number(5))) if azimuth else []
    if rpm or speed is None:
        return SentenceReading(rpm + angle)
    return SentenceReading(angle, refused="thruster in percent" if mode == "P" else NOT_VALID)


def _thruster_order(
    fields: Fields, controls: _Controls, rated_rpm: Mapping[str, float], fills_channels: bool
) -> SentenceReading:
    reading = _thruster(fields, controls, rated_rpm)
    orders = _as_orders(reading)
    return replace(orders, values=orders.values + reading.values) if fills_channels else orders


def _as_orders(reading: SentenceReading) -> SentenceReading:
    return replace(reading, values=[(name_of_order(name), value) for name, value in reading.values])


def machinery_readers(
    thrusters: Thrusters,
    actuators: Actuators,
    reduction_ratios: Mapping[str, float],
    rated_rpm: Mapping[str, float],
) -> dict[str, Reader]:
    """The reader of each of these sentences, by its last three letters, on a ship with these actuators."""
    controls: _Controls = {}
    for actuator in actuators:
        if actuator.name in thrusters.numbers:
            shaft, azimuth, *_ = (*(channel.name for channel in actuator.channels), "")
            controls[thrusters.numbers[actuator.name]] = shaft, azimuth
    rated = {f"{name}_rpm": rpm for name, rpm in rated_rpm.items()}
    demand = thrusters.channels_from == "demand"
    unwanted = SentenceReading(refused="thruster response where demands are wanted")
    angles, shafts = rudder_channels(actuators), numbered_shafts(actuators)
    readers: dict[str, Reader] = {
        "RSA": partial(_rudders, channels=angles),
        "RPM": partial(_rpm, shafts=shafts, reduction_ratios=reduction_ratios),
        "TRD": (lambda fields: unwanted) if demand else partial(_thruster, controls=controls, rated_rpm=rated),
        "TRC": partial(_thruster_order, controls=controls, rated_rpm=rated, fills_channels=demand),
    }
    if rudders(actuators):
        readers["ROR"] = lambda fields: _as_orders(_rudders(fields, angles))
        readers["HTD"] = partial(_heading_control, channels=angles)
    if not {propulsor.name for propulsor in shafts} & thrusters.numbers.keys():  # else TRC tells the orders to them
        readers["PRC"] = partial(_propulsion_order, shafts=shafts, rated_rpm=rated_rpm)
    return readers
