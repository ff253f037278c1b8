"""Channels that change from one source to another, gathered by their cause: one event for one outage or return."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

from seatrial.acquisition.core.frames import Frame, label_parts, sensor_of
from seatrial.acquisition.logger.health import SILENT_NS

_GATHERED_NS = SILENT_NS  # channels of one line fall silent, and come back, as far apart as their messages do


class Handover(NamedTuple):
    """A channel that goes from one source to another, which has ``returned`` or replaces one that is silent."""

    channel: str
    before: str
    after: str
    returned: bool

    @property
    def parties(self) -> tuple[str, str]:
        """From where to where: lines or, on one line, devices."""
        lines = label_parts(self.before)[0], label_parts(self.after)[0]
        return lines if lines[0] != lines[1] else (sensor_of(self.before), sensor_of(self.after))

    @property
    def text(self) -> str:
        return f"{self.channel}: from {self.before} to {self.after}"


@dataclass(slots=True)
class _Cause:
    """What one line or device did, with the frame of the first channel that changed by it."""

    first: Frame
    handovers: dict[str, Handover] = field(default_factory=dict)  # by channel, the last of each

    @property
    def text(self) -> str:
        handovers = list(self.handovers.values())
        if len(handovers) == 1:
            return handovers[0].text
        before, after = (sorted({handover.parties[end] for handover in handovers}) for end in (0, 1))
        channels = f"{len(handovers)} channels: from {', '.join(before)} to {', '.join(after)}"
        return f"{channels} ({', '.join(self.handovers)})"


class Handovers:
    """The changes not reported yet: their ``causes``, by the line or device that fell silent or returned."""

    def __init__(self) -> None:
        self.causes: dict[tuple[str, bool], _Cause] = {}

    def add(self, handover: Handover, frame: Frame) -> None:
        """Note a change that came with a frame."""
        cause = handover.parties[handover.returned], handover.returned
        self.causes.setdefault(cause, _Cause(frame)).handovers[handover.channel] = handover

    def due(self, now_ns: float) -> list[tuple[Frame, str]]:
        """What is to be reported by now [monotonic, ns]: the frame that each began with, and its text."""
        due = [key for key, cause in self.causes.items() if now_ns - cause.first.monotonic_ns >= _GATHERED_NS]
        causes = [self.causes.pop(key) for key in due]
        return [(cause.first, cause.text) for cause in causes]
