"""How the sources and channels are doing: counts, rates, ages, grades. The pipeline writes, the display reads."""

from __future__ import annotations

import math
import time
from collections import Counter, deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from statistics import median_low
from typing import Any, Literal

from seatrial.acquisition.core.channel import Channel
from seatrial.acquisition.core.channels import BY_NAME, NAMES
from seatrial.acquisition.core.frames import Sample, sensor_of
from seatrial.acquisition.logger.host_clock import HostClock

Grade = Literal["good", "slow", "silent", "none"]

_RATE_OVER_NS = 5_000_000_000
SILENT_NS = 2_500_000_000
_QUIET_NS = 1_500_000_000
ENOUGH_RATE = 0.8  # of what is expected
_PERIODS_TO_SILENCE = 5
_LEAST_SPANS, _MOST_SPANS = 4, 60  # of the 5 s above: what goes on for less than half of them is not the usual rate
_HIGHEST_RATE_HZ = 1000.0


@dataclass(slots=True)
class SourceHealth:
    """One source since the start of the recording."""

    name: str
    state: str = "open"
    frames: int = 0
    dropped: int = 0  # frames that are not in the recording, for want of room or of budget
    over_budget: int = 0  # of them, those that its budget had no room for
    refusals: list[Counter[str]] = field(default_factory=list)  # of the source's decoders, by reason
    not_known: list[Counter[str]] = field(default_factory=list)  # messages that carry no channel, by name
    impossible: int = 0  # decoded, but no value that its channel can hold
    last_ns: int | None = None
    failed_ns: int | None = None

    @property
    def refused(self) -> int:
        """Frames and values that the decoders refused."""
        return sum(sum(list(counts.values())) for counts in self.refusals)  # a list, as another thread counts on

    @property
    def rejected(self) -> int:
        """Frames and values that came and were not believed."""
        return self.refused + self.impossible

    @property
    def reasons(self) -> dict[str, int]:
        """Why frames and values were not believed, and how many."""
        reasons = {reason: count for counts in self.refusals for reason, count in list(counts.items()) if count}
        return {**reasons, "outside its channel's range": self.impossible} if self.impossible else reasons

    @property
    def unknown(self) -> dict[str, int]:
        """Sound messages that carry no channel, by name, and how many."""
        return {name: count for counts in self.not_known for name, count in list(counts.items())}

    def count_in(self, frames: int, monotonic_ns: int) -> None:
        self.frames += frames
        self.last_ns = monotonic_ns

    def is_silent(self, now_ns: int) -> bool:
        """Whether it is open and nothing has come of late."""
        return self.state == "open" and (self.last_ns is None or now_ns - self.last_ns > SILENT_NS)

    def as_message(self, now_ns: int) -> dict[str, Any]:
        """The body of a ``/health`` message."""
        return {
            "source": self.name,
            "state": "silent" if self.is_silent(now_ns) else self.state,
            "frames": self.frames,
            "rejected": self.rejected,
            "reasons": self.reasons,
            "dropped": self.dropped,
            "over_budget": self.over_budget,
            **({} if self.last_ns is None else {"age_s": (now_ns - self.last_ns) / 1e9}),
        }


@dataclass(slots=True)
class ChannelHealth:
    """One channel: its last value, how many there were, and when the last few came."""

    count: int = 0
    value: float = float("nan")
    source: str = ""
    expected_hz: float | None = None  # by the configuration
    usual_hz: float = 0.0  # the best rate that one sensor has kept up so far
    times_ns: deque[int] = field(default_factory=lambda: deque(maxlen=2000))
    _sensor: str = ""
    _began_ns: int = 0  # when the present span of learning began
    _samples: int = 0  # in it
    _rates_hz: deque[float] = field(default_factory=lambda: deque(maxlen=_MOST_SPANS))

    def count_in(self, sample: Sample) -> None:
        now_ns = sample.monotonic_ns
        self.count += 1
        self.times_ns.append(now_ns)
        if sample.source != self.source and sensor_of(sample.source) != self._sensor:
            self._sensor, self._began_ns, self._samples = sensor_of(sample.source), now_ns, 0
            self._rates_hz.clear()
        self.value, self.source = sample.value, sample.source
        if now_ns - self._began_ns >= _RATE_OVER_NS:
            self._learn(now_ns)
        self._samples += 1

    def _learn(self, now_ns: int) -> None:
        """The usual rate: the median of some spans, which no burst, gap or overlap of two senders reaches."""
        self._rates_hz.append(self._samples * 1e9 / (now_ns - self._began_ns))
        self._began_ns, self._samples = now_ns, 0
        if len(self._rates_hz) >= _LEAST_SPANS:
            self.usual_hz = max(self.usual_hz, min(median_low(self._rates_hz), _HIGHEST_RATE_HZ))

    def age_s(self, now_ns: int) -> float:
        """Since the last sample [s]; infinite if there was none."""
        return (now_ns - self.times_ns[-1]) / 1e9 if self.times_ns else float("inf")

    def rate_hz(self, now_ns: int) -> float:
        """Samples a second over the last seconds; it falls when the channel falls silent."""
        recent = [time_ns for time_ns in tuple(self.times_ns) if now_ns - time_ns < _RATE_OVER_NS]
        if len(recent) < 2:
            return 0.0
        until_ns = recent[-1] if now_ns - recent[-1] < _QUIET_NS else now_ns
        return (len(recent) - 1) / max((until_ns - recent[0]) / 1e9, 1e-9)

    @property
    def wanted_hz(self) -> float:
        """The rate to compare with: what the configuration expects, or else what the channel has kept up."""
        return self.usual_hz if self.expected_hz is None else self.expected_hz

    def grade(self, now_ns: int) -> Grade:
        """good; slow: less often than expected; silent: nothing of late; none: never came."""
        if not self.count:
            return "none"
        wanted_hz = self.wanted_hz
        longest_s = max(SILENT_NS / 1e9, _PERIODS_TO_SILENCE / wanted_hz if wanted_hz else 0.0)
        if self.age_s(now_ns) > longest_s:
            return "silent"
        return "slow" if self.rate_hz(now_ns) < ENOUGH_RATE * wanted_hz else "good"


Event = tuple[int, str, str]
"""When [ns since 1970], level, text."""


class Events:
    """The last events, so many of each kind: marks, alarms, errors and all others do not push each other out."""

    def __init__(self) -> None:
        self._count = 0
        self._kinds: dict[str, deque[tuple[int, Event]]] = {
            kind: deque(maxlen=8 if kind == "other" else 4) for kind in ("alarm", "mark", "error", "other")
        }

    def append(self, event: Event, name: str = "") -> None:
        """Take note of an event; ``name`` is what it is called in the recording: "mark", "alarm", or anything."""
        self._count += 1
        kind = name if name in ("alarm", "mark") else "error" if event[1] == "error" else "other"
        self._kinds[kind].append((self._count, event))

    def __iter__(self) -> Iterator[Event]:
        return iter(self.newest(sum(map(len, self._kinds.values()))))

    def newest(self, most: int) -> list[Event]:
        """At most so many, in the order in which they came: of each kind the newest, then those before them."""
        ranked = [
            (rank, place, number, event)
            for place, events in enumerate(self._kinds.values())
            for rank, (number, event) in enumerate(reversed(tuple(events)))  # another thread puts more in
        ]
        chosen = sorted(ranked)[: max(most, 0)]
        return [event for *_, event in sorted(chosen, key=lambda ranking: ranking[2])]


@dataclass(slots=True)
class CopyState:
    """How many finished parts wait for a copy, and why none is made at the moment."""

    waiting: int = 0
    trouble: str = ""


@dataclass(slots=True)
class Health:
    """The state of a recording in progress."""

    sources: dict[str, SourceHealth]
    names: tuple[str, ...] = NAMES  # of the channels that are watched; what else comes is counted too
    known_channels: Mapping[str, Channel] = field(default_factory=lambda: BY_NAME)
    channels: dict[str, ChannelHealth] = field(default_factory=dict)
    events: Events = field(default_factory=Events)
    started_ns: int = field(default_factory=time.monotonic_ns)
    ended_ns: int | None = None  # by the clock of the start; of logs both are by the logs' own
    samples: int = 0
    marks: int = 0
    predictions: int = 0  # recorded for another program
    predictions_refused: int = 0  # malformed, or too many
    predictions_dropped: int = 0  # taken in, but nothing was written at the moment
    trouble: str = ""  # why nothing is written at the moment
    part: str = ""  # the name of the file that is being written
    free_bytes: int | None = None
    bytes_per_s: float = 0.0  # what the recording grows by
    worked_ns: int = field(default_factory=time.monotonic_ns)  # when the recorder's thread last came round
    copies: CopyState = field(default_factory=CopyState)
    clock: HostClock = field(default_factory=HostClock)
    alarms: dict[str, str] = field(default_factory=dict)  # those that are raised: what is wrong

    def __post_init__(self) -> None:
        self.channels = {name: ChannelHealth() for name in self.names} | self.channels

    def count_in(self, sample: Sample) -> None:
        self.samples += 1
        channel = self.channels.get(sample.quantity)
        if channel is None:
            channel = self.channels[sample.quantity] = ChannelHealth()
        channel.count_in(sample)

    def figures(self, now_ns: int) -> dict[str, float]:
        """Everything that can be said in a number, by name, for alarms and programs; not a number: not known.

        Ages count from the start of the recording until something comes.
        """
        since_ns = self.started_ns
        left_s, free = self.seconds_left, self.free_bytes
        figures = {
            "recorder.age_s": (now_ns - self.worked_ns) / 1e9,
            "recorder.paused": float(bool(self.trouble)),
            "recorder.bytes_per_s": self.bytes_per_s,
            "disk.free_gb": math.nan if free is None else free / 1e9,
            "disk.hours_left": math.nan if left_s is None else left_s / 3600.0,
            "copies.waiting": float(self.copies.waiting),
            "copies.failing": float(bool(self.copies.trouble)),
            "clock.kept": math.nan if self.clock.state == "unknown" else float(self.clock.kept),
            "clock.error_s": math.nan if self.clock.error_s is None else self.clock.error_s,
            "clock.pps_offset_s": math.nan if self.clock.pps_offset_s is None else self.clock.pps_offset_s,
        }
        for name, source in self.sources.items():
            figures[f"source.{name}.age_s"] = (now_ns - (source.last_ns or since_ns)) / 1e9
            figures[f"source.{name}.failed"] = float(source.state == "failed")
            for key in ("frames", "rejected", "dropped", "over_budget"):
                figures[f"source.{name}.{key}"] = float(getattr(source, key))
        for name, channel in list(self.channels.items()):  # the recorder's thread may find another
            figures[name] = channel.value if channel.count else math.nan
            figures[f"{name}.rate_hz"] = channel.rate_hz(now_ns)
            figures[f"{name}.age_s"] = channel.age_s(now_ns) if channel.count else (now_ns - since_ns) / 1e9
        return figures

    @property
    def seconds_left(self) -> float | None:
        """How long the disk lasts at the present rate [s]; None if that is not known yet."""
        if self.free_bytes is None or self.bytes_per_s <= 0:
            return None
        return self.free_bytes / self.bytes_per_s
