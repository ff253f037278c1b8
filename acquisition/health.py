"""How the sources and channels are doing: counts, rates, ages. The pipeline writes, the display reads."""

from __future__ import annotations

import time
from collections import deque
from dataclasses import dataclass, field
from typing import Any

from acquisition.channels import NAMES
from acquisition.frames import Sample

_RATE_OVER_NS = 5_000_000_000
_SILENT_NS = 2_500_000_000
_QUIET_NS = 1_500_000_000


@dataclass(slots=True)
class SourceHealth:
    """One source since the start of the recording."""

    name: str
    state: str = "open"
    frames: int = 0
    dropped: int = 0
    refused: int = 0  # by the decoders, which keep the sum
    impossible: int = 0  # decoded, but no value that its channel can hold
    last_ns: int | None = None

    @property
    def rejected(self) -> int:
        """Frames and values that came and were not believed."""
        return self.refused + self.impossible

    def saw(self, frames: int, monotonic_ns: int) -> None:
        """That many frames came."""
        self.frames += frames
        self.last_ns = monotonic_ns

    def as_message(self, now_ns: int) -> dict[str, Any]:
        """The body of a ``/health`` message."""
        age_s = None if self.last_ns is None else (now_ns - self.last_ns) / 1e9
        silent = self.last_ns is None or now_ns - self.last_ns > _SILENT_NS
        return {
            "source": self.name,
            "state": "silent" if self.state == "open" and silent else self.state,
            "frames": self.frames,
            "rejected": self.rejected,
            "dropped": self.dropped,
            "age_s": age_s,
        }


@dataclass(slots=True)
class ChannelHealth:
    """One channel: its last value, how many there were, and when the last few came."""

    count: int = 0
    value: float = float("nan")
    source: str = ""
    times_ns: deque[int] = field(default_factory=lambda: deque(maxlen=2000))

    def saw(self, sample: Sample) -> None:
        """A sample of this channel was recorded."""
        self.count += 1
        self.value, self.source = sample.value, sample.source
        self.times_ns.append(sample.monotonic_ns)

    def age_s(self, now_ns: int) -> float:
        """Since the last sample [s]; infinite if there was none."""
        return (now_ns - self.times_ns[-1]) / 1e9 if self.times_ns else float("inf")

    def rate_hz(self, now_ns: int) -> float:
        """Samples a second over the last seconds; it falls when the channel falls silent."""
        recent = [each for each in tuple(self.times_ns) if now_ns - each < _RATE_OVER_NS]
        if len(recent) < 2:
            return 0.0
        until_ns = recent[-1] if now_ns - recent[-1] < _QUIET_NS else now_ns
        return (len(recent) - 1) / max((until_ns - recent[0]) / 1e9, 1e-9)


@dataclass(slots=True)
class Health:
    """The state of a recording in progress."""

    sources: dict[str, SourceHealth]
    channels: dict[str, ChannelHealth] = field(default_factory=lambda: {name: ChannelHealth() for name in NAMES})
    events: deque[tuple[int, str]] = field(default_factory=lambda: deque(maxlen=5))
    started_ns: int = field(default_factory=time.monotonic_ns)
    samples: int = 0

    def saw(self, sample: Sample) -> None:
        """A sample was recorded."""
        self.samples += 1
        self.channels.setdefault(sample.quantity, ChannelHealth()).saw(sample)
