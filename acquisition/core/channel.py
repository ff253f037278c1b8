"""A channel: a quantity with its unit, the range of its possible values, and its topic."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Group = Literal["pose", "velocity", "environment", "command", "auxiliary", "declared"]


@dataclass(frozen=True, slots=True)
class Channel:
    """A quantity with its unit and the range of its possible values.

    ``low`` and ``high`` are inclusive, except for angles: their range is one turn, which includes the end that
    ``conventions`` gives (0 <= x < 360, or -180 < x <= 180). A ``state`` is a code or a count that keeps its
    value until the next one and is never interpolated.
    """

    name: str
    unit: str
    low: float
    high: float
    group: Group
    meaning: str
    circular: bool = False
    state: bool = False

    @property
    def topic(self) -> str:
        """The MCAP topic that carries this channel."""
        return f"/channel/{self.name}"

    def holds(self, value: float) -> bool:
        """Whether ``value`` [``unit``] is possible. NaN and infinities are not."""
        if not self.circular:
            return self.low <= value <= self.high
        if self.low < 0:
            return self.low < value <= self.high
        return self.low <= value < self.high

    def wrapped(self, value: float) -> float:
        """``value`` wrapped into this channel's turn; unchanged if the channel is no angle."""
        if not self.circular:
            return value
        if self.low < 0:
            return self.high - (self.high - value) % 360.0
        turned = value % 360.0
        return 0.0 if turned == 360.0 else turned  # -1e-20 % 360.0 is 360.0 in floating point


def circle(name: str, group: Group, meaning: str) -> Channel:
    """A channel of an angle [deg] from 0 to 360."""
    return Channel(name, "deg", 0.0, 360.0, group, meaning, circular=True)
