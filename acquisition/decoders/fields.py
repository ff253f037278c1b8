"""The fields of an NMEA 0183 sentence as numbers, angles, speeds and times; what cannot be read is missing."""

from __future__ import annotations

import re

from acquisition.core.units import KNOT_MPS

_NUMBER = re.compile(r"[+-]?(\d{1,9}(\.\d*)?|\.\d+)")
_DEGREES_AND_MINUTES = re.compile(r"(\d{1,3})([0-5]\d(?:\.\d*)?)")
_TIME_OF_DAY = re.compile(r"([01]\d|2[0-3])([0-5]\d)([0-5]\d(?:\.\d*)?|60(?:\.\d*)?)")
_SIGNS = {"N": 1.0, "S": -1.0, "E": 1.0, "W": -1.0}
MPS_OF_UNIT = {"N": KNOT_MPS, "K": 1.0 / 3.6, "M": 1.0, "S": 0.44704}  # S: statute miles per hour


class Fields:
    """The fields of one sentence, some of them empty, some perhaps not there at all."""

    def __init__(self, texts: list[str]) -> None:
        self._texts = texts

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
        found, letter = _DEGREES_AND_MINUTES.fullmatch(self.text(index)), self.text(index + 1)
        if found is None or letter not in tuple(letters):
            return None
        return _SIGNS[letter] * (int(found[1]) + float(found[2]) / 60.0)

    def speed_mps(self, *places: tuple[int, str]) -> float | None:
        """The first speed that is given, of those at an index in a unit; so the finest unit comes first."""
        for index, unit in places:
            speed = self.measured(index, unit)
            if speed is not None:
                return speed * MPS_OF_UNIT[unit]
        return None

    def seconds_of_day(self, index: int) -> float | None:
        """``hhmmss.sss`` as seconds since midnight; the leap second is the next day's first."""
        found = _TIME_OF_DAY.fullmatch(self.text(index))
        return int(found[1]) * 3600 + int(found[2]) * 60 + float(found[3]) if found else None
