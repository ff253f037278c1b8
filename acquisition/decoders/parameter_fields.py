"""Where the fields of the parameter groups are that we listen to.

Fields are named as in canboat's database and are in SI units and radians, positions in degrees. A field of a
number keeps its three highest raw values to say "not available", "error" and nothing at all (reserved); lookups
are given as they are.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from acquisition.core.units import DEG_PER_RAD

ADDRESS_CLAIM = 60928
SYSTEM_TIME, TIME_AND_DATE, GNSS_POSITION = 126992, 129033, 129029
NOT_AVAILABLE, ERROR_VALUE = "not available", "error value"

Value = float | str
"""A number, or the reason why there is none."""


@dataclass(frozen=True, slots=True)
class Field:
    """One field: its first bit, its length in bits, and its step, which a lookup has not."""

    start: int
    bits: int
    step: float | None = None
    signed: bool = False
    _ones: int = field(init=False, repr=False)
    _highest: int = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_ones", (1 << self.bits) - 1)
        object.__setattr__(self, "_highest", self._ones >> self.signed)

    def read(self, raw: int) -> Value:
        """The field's value in a message that was read as one little-endian number."""
        value, highest = (raw >> self.start) & self._ones, self._highest
        if self.step is None:
            return value
        if highest - 2 <= value <= highest:
            return NOT_AVAILABLE if value == highest else ERROR_VALUE
        return (value if value <= highest else value - self._ones - 1) * self.step


class Message:
    """One whole message, ``raw`` as one little-endian number; a field is read when it is asked for."""

    __slots__ = ("_bits", "_fields", "raw")

    def __init__(self, fields: dict[str, Field], payload: bytes) -> None:
        self._fields = fields
        self.raw = int.from_bytes(payload, "little")
        self._bits = 8 * len(payload)

    def __getitem__(self, name: str) -> Value:
        known = self._fields[name]
        return known.read(self.raw) if known.start + known.bits <= self._bits else NOT_AVAILABLE

    def degrees(self, name: str) -> Value:
        """A field of radians in degrees."""
        value = self[name]
        return value if isinstance(value, str) else value * DEG_PER_RAD


_ANGLE_RAD, _SPEED_MPS, _FINE_SPEED_MPS, _TIME_S = 1e-4, 0.01, 0.001, 1e-4
_SID = {"sid": Field(0, 8, 1)}
_SPEED_NAMES = (
    "longitudinalSpeedWaterReferenced",
    "transverseSpeedWaterReferenced",
    "longitudinalSpeedGroundReferenced",
    "transverseSpeedGroundReferenced",
    "sternSpeedWaterReferenced",
    "sternSpeedGroundReferenced",
)

FIELDS: dict[int, dict[str, Field]] = {
    SYSTEM_TIME: {**_SID, "source": Field(8, 4), "date": Field(16, 16, 1), "time": Field(32, 32, _TIME_S)},
    127245: {
        "instance": Field(0, 8, 1),
        "directionOrder": Field(8, 3),
        "angleOrder": Field(16, 16, _ANGLE_RAD, signed=True),
        "position": Field(32, 16, _ANGLE_RAD, signed=True),
    },
    127250: {
        **_SID,
        "heading": Field(8, 16, _ANGLE_RAD),
        "deviation": Field(24, 16, _ANGLE_RAD, signed=True),
        "variation": Field(40, 16, _ANGLE_RAD, signed=True),
        "reference": Field(56, 2),
    },
    127251: {**_SID, "rate": Field(8, 32, 3.125e-8, signed=True)},
    127257: {
        **_SID,
        "yaw": Field(8, 16, _ANGLE_RAD, signed=True),
        "pitch": Field(24, 16, _ANGLE_RAD, signed=True),
        "roll": Field(40, 16, _ANGLE_RAD, signed=True),
    },
    127258: {
        **_SID,
        "source": Field(8, 4),
        "ageOfService": Field(16, 16, 1),
        "variation": Field(32, 16, _ANGLE_RAD, signed=True),
    },
    128259: {
        **_SID,
        "speedWaterReferenced": Field(8, 16, _SPEED_MPS),
        "speedGroundReferenced": Field(24, 16, _SPEED_MPS),
        "speedWaterReferencedType": Field(40, 8),
        "speedDirection": Field(48, 4),
    },
    129025: {"latitude": Field(0, 32, 1e-7, signed=True), "longitude": Field(32, 32, 1e-7, signed=True)},
    129026: {
        **_SID,
        "cogReference": Field(8, 2),
        "cog": Field(16, 16, _ANGLE_RAD),
        "sog": Field(32, 16, _SPEED_MPS),
    },
    GNSS_POSITION: {
        **_SID,
        "date": Field(8, 16, 1),
        "time": Field(24, 32, _TIME_S),
        "latitude": Field(56, 64, 1e-16, signed=True),
        "longitude": Field(120, 64, 1e-16, signed=True),
        "altitude": Field(184, 64, 1e-6, signed=True),
        "gnssType": Field(248, 4),
        "method": Field(252, 4),
        "integrity": Field(256, 2),
        "numberOfSvs": Field(264, 8, 1),
        "hdop": Field(272, 16, 0.01, signed=True),
        "pdop": Field(288, 16, 0.01, signed=True),
        "geoidalSeparation": Field(304, 32, 0.01, signed=True),
        "referenceStations": Field(336, 8, 1),
    },
    TIME_AND_DATE: {
        "date": Field(0, 16, 1),
        "time": Field(16, 32, _TIME_S),
        "localOffset": Field(48, 16, 60, signed=True),
    },
    130306: {
        **_SID,
        "windSpeed": Field(8, 16, _SPEED_MPS),
        "windAngle": Field(24, 16, _ANGLE_RAD),
        "reference": Field(40, 3),
    },
    130577: {
        "dataMode": Field(0, 4),
        "cogReference": Field(4, 2),
        "sid": Field(8, 8, 1),
        "cog": Field(16, 16, _ANGLE_RAD),
        "sog": Field(32, 16, _SPEED_MPS),
        "heading": Field(48, 16, _ANGLE_RAD),
        "speedThroughWater": Field(64, 16, _SPEED_MPS),
        "set": Field(80, 16, _ANGLE_RAD),
        "drift": Field(96, 16, _SPEED_MPS),
    },
    130578: {name: Field(16 * place, 16, _FINE_SPEED_MPS, signed=True) for place, name in enumerate(_SPEED_NAMES)},
}
"""The fields of each group by their names."""

SHORTEST_BYTES = {GNSS_POSITION: 43, 130577: 14, 130578: 8}
"""The groups that come in several frames, and the least length that each can have."""
