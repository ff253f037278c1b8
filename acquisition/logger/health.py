"""Keeps the state of a recording in progress (counts, rates, ages, grades) and raises alarms by it.

The pipeline writes it, the display, the alarms and the status page read it. The computer's clock is judged without
privileges: the kernel states whether it is kept (adjtimex), the list of processes by which program, chrony and
systemd-timesyncd the bound of its error, a pulse a second (PPS) its offset. Alarms compare figures with their
limits once a second in a thread of its own: an event of the recording, a line of the log, red on the terminal with
its bell, and a command of the user's.

Also here: log lines that a program can read and the supervisor's notices; predictions of other programs on their
way into the recording, checked, few and bounded, so that it comes first; and channels that change from one source
to another, gathered by their cause: one event for one outage or return.
"""

from __future__ import annotations

import ctypes
import json
import logging
import math
import os
import queue
import re
import socket
import subprocess
import sys
import threading
import time
from collections import Counter, deque
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from difflib import get_close_matches
from pathlib import Path
from statistics import median_low
from typing import Any, Literal, NamedTuple, TextIO

from seatrial.acquisition.config.sources import AlarmSection
from seatrial.acquisition.core.errors import ConfigurationError, InputError, escape_control_characters
from seatrial.acquisition.core.process import start_thread_if_possible
from seatrial.acquisition.core.ship import BY_NAME, NAMES, Channel
from seatrial.acquisition.core.trial import Frame, Sample, line_and_device, split_source_label
from seatrial.acquisition.recording import messages, parts

_UNSYNCHRONISED = 5  # TIME_ERROR of adjtimex(2)
_PATIENCE_S = 2.0
_KEEPERS = {
    "phc2sys": "PTP", "chronyd": "NTP", "ntpd": "NTP", "ntpd-rs": "NTP", "ntp-daemon": "NTP", "openntpd": "NTP",
    "systemd-timesyn": "NTP",
}  # fmt: skip
"""Programs that keep a clock, by their names in /proc, which are cut to 15 letters."""
_SECONDS = {"": 1.0, "s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9, "min": 60.0}
_LATEST_PULSE_S = 2.5
HOST_CLOCK = "host clock"
"""The name of the computer's clock among the sources' states; no source can be called so."""

SINK_PREFIX = "sink "
"""What the names of sinks begin with among the sources' states."""
LIVE_VIEW = "live view"
"""The name of what viewers get, among those of sinks; no sink can be called so, for the space in it."""
_HANGING_S = 15.0  # a connection and an answer take less, or fail

Grade = Literal["good", "slow", "silent", "none"]

_RATE_OVER_NS = 5_000_000_000
SILENT_NS = 2_500_000_000
_QUIET_NS = 1_500_000_000
ENOUGH_RATE = 0.8  # of what is expected
_PERIODS_TO_SILENCE = 5
_LEAST_SPANS, _MOST_SPANS = 4, 60  # of the 5 s above: what goes on for less than half of them is not the usual rate
_HIGHEST_RATE_HZ = 1000.0

Event = tuple[int, str, str]
"""When [ns since 1970], level, text."""

_CHECK_PERIOD_S = 1.0
_CLOCK_PERIOD_S = 30.0
_LONGEST_COMMAND_S = 60.0
_MOST_COMMANDS = 8

LOG = logging.getLogger("seatrial")
_MOST_WAITING_LINES = 10_000
_LONGEST_JOIN_S = 2.0
LogFormat = Literal["text", "json"]

MOST_PER_S = 2.0
_MOST_AT_ONCE = 4  # after a pause; then no more than MOST_PER_S
_MOST_GEOJSON_LETTERS = 32_768
_LARGEST = 1e12
_KINDS: dict[str, tuple[type, ...]] = {
    "number": (int, float), "integer": (int,), "string": (str,), "boolean": (bool,), "object": (dict,),
    "array": (list,),
}  # fmt: skip

_GATHERED_NS = SILENT_NS  # channels of one line fall silent, and come back, as far apart as their messages do


@dataclass(frozen=True, slots=True)
class HostClock:
    """The state of the computer's clock.

    ``error_s`` is a bound of its error, as far as its keeper states one; ``pps_offset_s`` how late the last pulse
    was by it, where there is a pulse. ``keeper`` names the programs that keep it, whether they succeed or not.
    """

    state: str = "unknown"
    keeper: str = ""
    error_s: float | None = None
    pps_offset_s: float | None = None

    @property
    def is_kept(self) -> bool:
        """Whether the system says that it is synchronised."""
        return self.state.startswith("kept")

    def as_message(self) -> dict[str, Any]:
        """The body of a ``/health`` message; what is unknown is left out."""
        errors = {"error_s": self.error_s, "pps_offset_s": self.pps_offset_s}
        fields = {key: value for key, value in errors.items() if value is not None}
        return {"source": HOST_CLOCK, "state": self.state, "keeper": self.keeper, **fields}

    def __str__(self) -> str:
        by = f" ({self.keeper})" if self.keeper else ""
        within = "" if self.error_s is None else f", within {1e3 * self.error_s:.3g} ms"
        pulse = "" if self.pps_offset_s is None else f", {1e3 * self.pps_offset_s:+.3g} ms at the pulse"
        return f"{self.state}{by}{within}{pulse}"


def kernel_clock_state() -> str:
    """What the kernel alone says of the clock, at once: "kept by NTP or PTP", "free-running", "unknown"."""
    is_kept, _ = _read_kernel_clock()
    return "unknown" if is_kept is None else "kept by NTP or PTP" if is_kept else "free-running"


def read_host_clock() -> HostClock:
    """Look at the clock now; asks other programs, and may take some seconds."""
    is_kept, kernel_error_s = _read_kernel_clock()
    keepers = running_clock_programs()
    kinds = " and ".join(dict.fromkeys(_KEEPERS[keeper] for keeper in keepers))
    server_error_s = None
    if "chronyd" in keepers:
        server_error_s = chrony_error_bound_s(_command_output("chronyc", "-n", "-c", "tracking"))
    if "systemd-timesyn" in keepers:
        server_error_s = timesyncd_error_bound_s(
            _command_output("timedatectl", "show-timesync", "--property=NTPMessage")
        )
    return HostClock(
        state=f"kept by {kinds}" if is_kept and kinds else kernel_clock_state(),
        keeper=", ".join(keepers),
        error_s=(kernel_error_s if server_error_s is None else server_error_s) if is_kept else None,
        pps_offset_s=last_pulse_offset_s(time.time()),
    )


class _Timex(ctypes.Structure):
    """The beginning of struct timex, and room for the rest of it."""

    _fields_ = [
        ("modes", ctypes.c_uint), ("offset", ctypes.c_long), ("freq", ctypes.c_long), ("maxerror", ctypes.c_long),
        ("esterror", ctypes.c_long), ("status", ctypes.c_int), ("rest", ctypes.c_byte * 512),
    ]  # fmt: skip


def _read_kernel_clock() -> tuple[bool | None, float | None]:
    """Whether the clock is kept, None if unknown, and the kernel's bound of its error [s]."""
    timex: Any = _Timex()  # modes 0: read only
    try:
        state = ctypes.CDLL(None).adjtimex(ctypes.byref(timex))
    except (OSError, AttributeError):
        return None, None
    return state not in (_UNSYNCHRONISED, -1), timex.maxerror * 1e-6


def running_clock_programs(processes: Path = Path("/proc")) -> list[str]:
    """The programs that run and keep a clock."""
    running = set()
    for path in processes.glob("[0-9]*/comm"):
        with suppress(OSError):
            running.add(path.read_text().strip())
    return [name for name in _KEEPERS if name in running]


def _command_output(*command: str) -> str:
    try:
        return subprocess.run(command, capture_output=True, text=True, timeout=_PATIENCE_S, check=True).stdout
    except (OSError, subprocess.SubprocessError):
        return ""


def chrony_error_bound_s(report: str) -> float | None:
    """The bound that ``chronyc -c tracking`` gives: offset, root dispersion and half the root delay [s]."""
    fields = report.strip().split(",")
    with suppress(ValueError, IndexError):
        offset, delay, dispersion = (float(fields[number]) for number in (4, 10, 11))
        return abs(offset) + dispersion + delay / 2
    return None


def timesyncd_error_bound_s(message: str) -> float | None:
    """The bound by timesyncd's last answer: root dispersion, half the root delay, and the jitter since [s]."""
    durations_s = []
    for name in ("RootDelay", "RootDispersion", "Jitter"):
        match = re.search(rf"\b{name}=((?:[\d.]+[a-zµ]* ?)+)", message)
        if match is None:
            return None
        pieces = re.findall(r"([\d.]+)([a-zµ]*)", match[1])
        try:
            durations_s.append(sum(float(number) * _SECONDS[unit] for number, unit in pieces))
        except (KeyError, ValueError):
            return None
    delay_s, dispersion_s, jitter_s = durations_s
    return delay_s / 2 + dispersion_s + jitter_s


def last_pulse_offset_s(now_s: float, pulses: Path = Path("/sys/class/pps")) -> float | None:
    """By how much the last pulse missed a whole second of the clock [s]; None without a recent pulse."""
    for path in sorted(pulses.glob("*/assert")):
        with suppress(OSError, ValueError):
            at_s = float(path.read_text().partition("#")[0])
            if abs(now_s - at_s) < _LATEST_PULSE_S:
                return at_s - round(at_s)
    return None


@dataclass(slots=True)
class SourceHealth:
    """One source since the start of the recording."""

    name: str
    state: str = "open"
    frames: int = 0
    dropped: int = 0  # frames that are not in the recording, for want of room or of budget
    over_budget: int = 0  # of them, those that its budget had no room for
    refusals: list[Counter[str]] = field(default_factory=list)  # of the source's decoders, by reason
    unknown_messages: list[Counter[str]] = field(default_factory=list)  # messages that carry no channel, by name
    impossible: int = 0  # decoded, but no value that its channel can hold
    last_ns: int | None = None
    failed_ns: int | None = None

    @property
    def refused(self) -> int:
        """Frames and values that the decoders refused."""
        return sum(sum(list(counts.values())) for counts in self.refusals)  # a list, as another thread counts on

    @property
    def rejected(self) -> int:
        """Frames and values that came and were not accepted."""
        return self.refused + self.impossible

    @property
    def rejection_counts(self) -> dict[str, int]:
        """Why frames and values were not accepted, and how many."""
        reasons = {reason: count for counts in self.refusals for reason, count in list(counts.items()) if count}
        return {**reasons, "outside its channel's range": self.impossible} if self.impossible else reasons

    @property
    def unknown_message_counts(self) -> dict[str, int]:
        """Sound messages that carry no channel, by name, and how many."""
        return {name: count for counts in self.unknown_messages for name, count in list(counts.items())}

    def add_frames(self, frames: int, monotonic_ns: int) -> None:
        self.frames += frames
        self.last_ns = monotonic_ns

    def is_silent(self, now_ns: int) -> bool:
        """Whether it is open and nothing has come recently."""
        return self.state == "open" and (self.last_ns is None or now_ns - self.last_ns > SILENT_NS)

    def as_message(self, now_ns: int) -> dict[str, Any]:
        """The body of a ``/health`` message."""
        return {
            "source": self.name,
            "state": "silent" if self.is_silent(now_ns) else self.state,
            "frames": self.frames,
            "rejected": self.rejected,
            "reasons": self.rejection_counts,
            "dropped": self.dropped,
            "over_budget": self.over_budget,
            **({} if self.last_ns is None else {"age_s": (now_ns - self.last_ns) / 1e9}),
        }


@dataclass(slots=True)
class SinkHealth:
    """One sink since the start of the recording: its values ``sent``, those that wait and those that are dropped.

    The recorder's thread counts what is ``offered``, the sink's what it takes from the ``queue`` and sends.
    """

    name: str
    queue: deque[Sample] = field(default_factory=deque)
    state: str = "opening"
    offered: int = 0
    in_hand: int = 0  # taken from the queue, and not sent yet
    sent: int = 0
    error: str = ""  # the last, whether it works again or not
    busy_s: float = math.inf  # since when something is being sent, by the monotonic clock

    @property
    def dropped(self) -> int:
        """Values that waited for too long, or that the sink refused."""
        return max(self.offered - self.sent - self.in_hand - len(self.queue), 0)

    def state_at(self, now_ns: int) -> str:
        """Its state; hanging, if it has answered nothing for a while."""
        return "hanging" if now_ns / 1e9 - self.busy_s > _HANGING_S else self.state

    def as_message(self, now_ns: int) -> dict[str, Any]:
        """The body of a ``/health`` message."""
        return {
            "source": f"{SINK_PREFIX}{self.name}",
            "state": self.state_at(now_ns),
            "sent": self.sent,
            "dropped": self.dropped,
            "error": self.error,
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

    def add_sample(self, sample: Sample) -> None:
        now_ns = sample.monotonic_ns
        self.count += 1
        self.times_ns.append(now_ns)
        if sample.source != self.source and line_and_device(sample.source) != self._sensor:
            self._sensor, self._began_ns, self._samples = line_and_device(sample.source), now_ns, 0
            self._rates_hz.clear()
        self.value, self.source = sample.value, sample.source
        if now_ns - self._began_ns >= _RATE_OVER_NS:
            self._rates_hz.append(self._samples * 1e9 / (now_ns - self._began_ns))
            self._began_ns, self._samples = now_ns, 0
            if len(self._rates_hz) >= _LEAST_SPANS:  # no burst, gap or overlap of two senders reaches their median
                self.usual_hz = max(self.usual_hz, min(median_low(self._rates_hz), _HIGHEST_RATE_HZ))
        self._samples += 1

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
    def reference_hz(self) -> float:
        """The rate to compare with: what the configuration expects, or else what the channel has kept up."""
        return self.usual_hz if self.expected_hz is None else self.expected_hz

    def grade(self, now_ns: int) -> Grade:
        """good; slow: less often than expected; silent: nothing recently; none: never came."""
        if not self.count:
            return "none"
        wanted_hz = self.reference_hz
        longest_s = max(SILENT_NS / 1e9, _PERIODS_TO_SILENCE / wanted_hz if wanted_hz else 0.0)
        if self.age_s(now_ns) > longest_s:
            return "silent"
        return "slow" if self.rate_hz(now_ns) < ENOUGH_RATE * wanted_hz else "good"


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

    def newest(self, limit: int) -> list[Event]:
        """At most so many, in the order in which they came: of each kind the newest, then those before them."""
        ranked = [
            (rank, place, number, event)
            for place, events in enumerate(self._kinds.values())
            for rank, (number, event) in enumerate(reversed(tuple(events)))  # another thread puts more in
        ]
        chosen = sorted(ranked)[: max(limit, 0)]
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
    sinks: dict[str, SinkHealth] = field(default_factory=dict)
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

    def add_sample(self, sample: Sample) -> None:
        self.samples += 1
        channel = self.channels.get(sample.quantity)
        if channel is None:
            channel = self.channels[sample.quantity] = ChannelHealth()
        channel.add_sample(sample)

    def figures(self, now_ns: int) -> dict[str, float]:
        """Everything that can be expressed in a number, by name, for alarms and programs; not a number: not known.

        Ages count from the start of the recording until something comes.
        """
        since_ns = self.started_ns
        remaining_s, free = self.seconds_left, self.free_bytes
        figures = {
            "recorder.age_s": (now_ns - self.worked_ns) / 1e9,
            "recorder.paused": float(bool(self.trouble)),
            "recorder.bytes_per_s": self.bytes_per_s,
            "disk.free_gb": math.nan if free is None else free / 1e9,
            "disk.hours_left": math.nan if remaining_s is None else remaining_s / 3600.0,
            "copies.waiting": float(self.copies.waiting),
            "copies.failing": float(bool(self.copies.trouble)),
            "clock.kept": math.nan if self.clock.state == "unknown" else float(self.clock.is_kept),
            "clock.error_s": math.nan if self.clock.error_s is None else self.clock.error_s,
            "clock.pps_offset_s": math.nan if self.clock.pps_offset_s is None else self.clock.pps_offset_s,
        }
        for name, source in self.sources.items():
            figures[f"source.{name}.age_s"] = (now_ns - (source.last_ns or since_ns)) / 1e9
            figures[f"source.{name}.failed"] = float(source.state == "failed")
            for key in ("frames", "rejected", "dropped", "over_budget"):
                figures[f"source.{name}.{key}"] = float(getattr(source, key))
        for name, sink in self.sinks.items():
            figures[f"sink.{name}.failed"] = float(sink.state_at(now_ns) in ("failed", "hanging"))
            for key in ("sent", "dropped"):
                figures[f"sink.{name}.{key}"] = float(getattr(sink, key))
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


def check_alarms(rules: Iterable[AlarmSection], health: Health) -> None:
    """Raise :class:`ConfigurationError` for a rule of a figure that does not exist."""
    figures = list(health.figures(time.monotonic_ns()))
    for rule in rules:
        if rule.figure not in figures:
            near = get_close_matches(rule.figure, figures, n=3) or [
                figure for figure in figures if rule.figure in figure
            ]
            near = near[:3] or figures[:8]
            raise ConfigurationError(
                f"unknown figure {rule.figure!r}", where=f"alarm {rule.name!r}", fix=f"say {' or '.join(near)}"
            )


@dataclass(slots=True)
class Alarm:
    """One rule, and since when its condition has differed from the reported state [s]."""

    rule: AlarmSection
    raised: bool = False
    since_s: float | None = None

    def update(self, value: float, now_s: float) -> bool:
        """Whether the alarm is raised, or over, by this value; one that is not known changes nothing."""
        rule = self.rule
        outside = (rule.above is not None and value > rule.above) or (rule.below is not None and value < rule.below)
        if math.isnan(value) or outside == self.raised:
            self.since_s = None
            return False
        if self.since_s is None:
            self.since_s = now_s
        if now_s - self.since_s < rule.for_s:
            return False
        self.raised, self.since_s = outside, None
        return True

    def text(self, value: float) -> str:
        """The alarm as a sentence."""
        rule = self.rule
        limits = {"above": rule.above, "below": rule.below}
        bounds = " or ".join(f"{word} {limit:g}" for word, limit in limits.items() if limit is not None)
        return f"{rule.name}: {rule.figure} is {value:.4g}, {'' if self.raised else 'no more '}{bounds}"


class Alarms:
    """The alarms of one recording in progress; a context manager."""

    def __init__(self, rules: Iterable[AlarmSection], health: Health, tell: parts.Tell) -> None:
        self._alarms = [Alarm(rule) for rule in rules]
        self._health, self._tell = health, tell
        self._commands: list[tuple[str, float, subprocess.Popen[bytes]]] = []
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._check_until_stopped, name="alarms", daemon=True)

    def __enter__(self) -> Alarms:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stopping.set()
        self._thread.join()

    def _check_until_stopped(self) -> None:
        clock_s = -math.inf
        while not self._stopping.wait(_CHECK_PERIOD_S):
            now_s = time.monotonic()
            try:
                if now_s - clock_s >= _CLOCK_PERIOD_S:
                    clock_s = now_s
                    self._health.clock = read_host_clock()
                if self._alarms:
                    self.check(self._health.figures(time.monotonic_ns()), now_s)
                self._report_ended_commands(now_s)
            except (OSError, RuntimeError) as error:  # no descriptor, no thread: the next look is in a second
                LOG.warning("the alarms could not be looked at: %s", error)
        self._report_ended_commands(time.monotonic())
        for _, _, process in self._commands:  # they end by themselves; a thread each takes the exit status
            with suppress(RuntimeError):  # no thread: the system takes the status once the recorder has ended
                threading.Thread(target=process.wait, name="alarm command", daemon=True).start()
        self._commands = []

    def check(self, figures: Mapping[str, float], now_s: float) -> None:
        """Report the alarms that these figures raise or end, and run their commands."""
        for alarm in self._alarms:
            value = figures.get(alarm.rule.figure, math.nan)
            if not alarm.update(value, now_s):
                continue
            text = alarm.text(value)
            if alarm.raised:
                self._health.alarms[alarm.rule.name] = text
                self._tell("error", f"ALARM {text}")
                if sys.stderr.isatty():
                    with suppress(OSError):
                        sys.stderr.write("\a")  # the bell
                        sys.stderr.flush()
            else:
                self._health.alarms.pop(alarm.rule.name, None)
                self._tell("warning", f"alarm over: {text}")
            if alarm.rule.command:
                self._run_command(alarm, text, now_s)

    def _run_command(self, alarm: Alarm, text: str, now_s: float) -> None:
        name, state = alarm.rule.name, "raised" if alarm.raised else "over"
        if len(self._commands) >= _MOST_COMMANDS:
            self._tell("error", f"alarm {name}: its command is not run, {_MOST_COMMANDS} others have not ended")
            return
        variables = {"SEATRIAL_ALARM": name, "SEATRIAL_STATE": state, "SEATRIAL_TEXT": text}
        try:
            process = subprocess.Popen(
                alarm.rule.command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                env={**os.environ, **variables}, start_new_session=True,
            )  # fmt: skip
        except OSError as error:
            self._tell("error", f"alarm {name}: its command cannot be run: {error.strerror}")
            return
        with suppress(OSError):
            if process.stdin is not None:
                process.stdin.write(f"{text}\n".encode())  # less than a pipe holds
                process.stdin.close()
        self._commands.append((name, now_s, process))

    def _report_ended_commands(self, now_s: float) -> None:
        """Report commands that have failed, and end those that do not end."""
        running = []
        for name, began_s, process in self._commands:
            if process.poll() is None and now_s - began_s > _LONGEST_COMMAND_S:
                process.kill()
                self._tell("error", f"alarm {name}: its command has not ended in {_LONGEST_COMMAND_S:g} s")
            elif process.returncode is None:
                running.append((name, began_s, process))
            elif process.returncode:
                self._tell("error", f"alarm {name}: its command ended with {process.returncode}")
        self._commands = running


class JsonLines(logging.Formatter):
    """One JSON object a line: time (UTC, ISO 8601), level, text, and what else the record carries."""

    def format(self, record: logging.LogRecord) -> str:
        line = {
            "time": datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds"),
            "level": record.levelname.lower(),
            "text": record.getMessage(),
            **getattr(record, "more", {}),
        }
        return json.dumps(line)  # in ASCII: also of what nothing encodes, and of what a terminal obeys


class _TextLines(logging.Formatter):
    """The text, with its level where that is more than information.

    Further lines of a text are indented, so that none passes for an entry of its own.
    """

    def format(self, record: logging.LogRecord) -> str:
        text = escape_control_characters(record.getMessage()).replace("\n", "\n    ")
        return text if record.levelno <= logging.INFO else f"{record.levelname.lower()}: {text}"


class _BackgroundHandler(logging.Handler):
    """Writes in a thread of its own: a terminal or a pipe that blocks must not hold up the recording."""

    def __init__(self, stream: TextIO) -> None:
        super().__init__()
        self._stream = stream
        self._lines: queue.Queue[str | None] = queue.Queue(_MOST_WAITING_LINES)
        self._writer = threading.Thread(target=self._write_records, name="log", daemon=True)
        self._running = start_thread_if_possible(self._writer)

    def emit(self, record: logging.LogRecord) -> None:
        self._running = self._running or start_thread_if_possible(self._writer)
        with suppress(queue.Full):
            self._lines.put_nowait(self.format(record))

    def close(self) -> None:
        """Write the remaining lines, if that can be done soon."""
        with suppress(queue.Full):
            self._lines.put_nowait(None)
        if self._running:
            self._writer.join(_LONGEST_JOIN_S)
        super().close()

    def _write_records(self) -> None:
        while (line := self._lines.get()) is not None:
            with suppress(OSError, ValueError):
                self._stream.write(f"{line}\n")
                self._stream.flush()


@contextmanager
def log_to(stream: TextIO, form: LogFormat) -> Iterator[None]:
    """Send Seatrial's log to a stream, as text or as one JSON object a line."""
    handler = _BackgroundHandler(stream)
    handler.setFormatter(JsonLines() if form == "json" else _TextLines())
    LOG.addHandler(handler)
    LOG.setLevel(logging.INFO)
    LOG.propagate = False
    try:
        yield
    finally:
        LOG.removeHandler(handler)
        handler.close()


def notify_systemd(state: str) -> bool:
    """Notify systemd (sd_notify): "READY=1", "WATCHDOG=1", "STATUS=..."; False where nothing listens."""
    address = os.environ.get("NOTIFY_SOCKET", "")
    if not address:
        return False
    with suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
        sender.sendto(state.encode(), "\0" + address[1:] if address.startswith("@") else address)
        return True
    return False


class RecordedPrediction(NamedTuple):
    """A prediction that was taken in: when on the monotonic clock [ns], the instant that it starts from [ns UTC],
    and the messages that it becomes; that for a map may be empty.
    """

    monotonic_ns: int
    start_ns: int
    data: bytes
    geojson: bytes


def describe_schema_violation(value: Any, schema: Mapping[str, Any], name: str = "it") -> str:
    """In what a JSON value does not fit a schema of ours; empty if it does.

    Understands what our schemas use: types, properties, required ones, items and the longest array or text. What
    a schema does not name is refused.
    """
    kind = schema["type"]
    if not isinstance(value, _KINDS[kind]) or (isinstance(value, bool) and kind != "boolean"):
        return f"{name} is no {kind}"
    if isinstance(value, int | float) and not abs(value) <= _LARGEST:  # nor is it not a number
        return f"{name} is no number that can be meant"
    if isinstance(value, dict):
        if missing := [key for key in schema["required"] if key not in value]:
            return f"{missing[0]} is missing"
        for key, entry in value.items():
            if key not in schema["properties"]:
                return f"{name} has an unknown {key[:40]!r}"
            if text := describe_schema_violation(entry, schema["properties"][key], key):
                return text
    if isinstance(value, list):
        if len(value) > schema["maxItems"]:
            return f"{name} has more than {schema['maxItems']} items"
        texts = (describe_schema_violation(item, schema["items"], f"an item of {name}") for item in value)
        return next(filter(None, texts), "")
    if isinstance(value, str) and len(value) > schema["maxLength"]:
        return f"{name} has more than {schema['maxLength']} letters"
    return ""


def parse_prediction(message: Mapping[str, Any]) -> RecordedPrediction:
    """A client's message, as what is recorded. Raises :class:`InputError` for what does not fit the schema."""
    body, geojson = message["prediction"], message.get("geojson", "")
    text = describe_schema_violation(body, messages.PREDICTION, "a prediction")
    if not text:
        track = body["track"]
        length = len(track["seconds"])  # arrays of what is not known are empty
        wrong = [
            name
            for name, needed in messages.ARRAYS.items()
            if len(track[name]) != length and (track[name] or needed)
        ]
        text = f"{wrong[0]} of the track is not as long as its seconds" if wrong else ""
    if not isinstance(geojson, str) or len(geojson) > _MOST_GEOJSON_LETTERS:
        text = text or f"geojson is no text of at most {_MOST_GEOJSON_LETTERS} letters"
    if text:
        raise InputError("is no prediction that can be recorded", why=text)
    drawn = messages.encode(messages.PREDICTED_TRACK_TOPIC, {"geojson": geojson}) if geojson else b""
    start_ns = round(body["start"] * 1e9)
    data = messages.encode(messages.PREDICTION_TOPIC, body)
    return RecordedPrediction(time.monotonic_ns(), start_ns, data, drawn)


class Predictions:
    """Predictions on their way into a recording: one thread puts them in, the recorder's takes them out."""

    def __init__(self, health: Health) -> None:
        self._health = health
        self._waiting: deque[RecordedPrediction] = deque()
        self._allowed, self._checked_s = float(_MOST_AT_ONCE), time.monotonic()

    def offer(self, message: Mapping[str, Any]) -> str:
        """Take one in. Returns why not, or an empty text; what is refused is counted."""
        try:
            prediction = parse_prediction(message)
        except (InputError, ValueError) as error:  # the latter for halves of letters
            self._health.predictions_refused += 1
            return str(error)
        now_s = time.monotonic()
        self._allowed = min(self._allowed + (now_s - self._checked_s) * MOST_PER_S, float(_MOST_AT_ONCE))
        self._checked_s = now_s
        if self._allowed < 1.0 or len(self._waiting) >= _MOST_AT_ONCE:
            self._health.predictions_refused += 1
            return f"more than {MOST_PER_S:g} predictions a second"
        self._allowed -= 1.0
        self._waiting.append(prediction)
        return ""

    def take(self) -> list[RecordedPrediction]:
        return [self._waiting.popleft() for _ in range(len(self._waiting))]


class Handover(NamedTuple):
    """A channel that goes from one source to another, which has ``returned`` or replaces one that is silent."""

    channel: str
    before: str
    after: str
    returned: bool

    @property
    def previous_and_new_source(self) -> tuple[str, str]:
        """From where to where: lines or, on one line, devices."""
        lines = split_source_label(self.before)[0], split_source_label(self.after)[0]
        return lines if lines[0] != lines[1] else (line_and_device(self.before), line_and_device(self.after))

    @property
    def text(self) -> str:
        return f"{self.channel}: from {self.before} to {self.after}"


class Handovers:
    """The changes not reported yet: their ``causes``, by the line or device that fell silent or returned.

    Of each cause the frame of the first channel that changed by it, and the last handover of each channel.
    """

    def __init__(self) -> None:
        self.causes: dict[tuple[str, bool], tuple[Frame, dict[str, Handover]]] = {}

    def add(self, handover: Handover, frame: Frame) -> None:
        """Note a change that came with a frame."""
        cause = handover.previous_and_new_source[handover.returned], handover.returned
        _, handovers = self.causes.setdefault(cause, (frame, {}))
        handovers[handover.channel] = handover

    def take_due(self, now_ns: float) -> list[tuple[Frame, str]]:
        """What is to be reported by now [monotonic, ns]: the frame that each cause began with, and its text."""
        reports = []
        for cause, (frame, handovers) in tuple(self.causes.items()):
            if now_ns - frame.monotonic_ns < _GATHERED_NS:
                continue
            del self.causes[cause]
            if len(handovers) == 1:
                text = next(iter(handovers.values())).text
            else:
                pairs = [handover.previous_and_new_source for handover in handovers.values()]
                before, after = (", ".join(sorted({pair[end] for pair in pairs})) for end in (0, 1))
                channels = f"{len(handovers)} channels: from {before} to {after}"
                text = f"{channels} ({', '.join(handovers)})"
            reports.append((frame, text))
        return reports
