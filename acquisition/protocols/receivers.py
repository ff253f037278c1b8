"""Receivers that report positions under one talker on one line, told apart by two positions of one moment.

Sources that report one quantity under one talker on one line, told apart by values that take turns.

Sentences such as HDT have neither time nor position. Two compasses of one talker are seen only in values that go to
and fro between two levels (:mod:`seatrial.analysis.quality.channel_checks` finds the same in recordings). Until
that is certain the values pass as of one source; two that agree, as rates of turn about zero do, are never told
apart. Where two have met and part again, the times at which they are due say which is which.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from math import cos, hypot, radians

from seatrial.acquisition.core.trial import NANO
from seatrial.acquisition.protocols import Notices

_DEGREE_M = 111_195.0  # of a meridian
_APART_M, _APART_AT_FIRST_M = 10.0, 25.0
"""Two positions of one moment further apart than this are of two receivers: one repeats itself, or states whole
seconds only, in which a ship whose speed is not known yet may go the longer way."""
_SECONDS_OF_WAY = 1.5  # in a stated second, with an error of the speed
_ONE_MOMENT_NS = 900_000_000
"""What comes later than this after a position of the same stated time is of another moment: that clock stands,
as fixes come once a second and more often."""
_MOST_RECEIVERS, _MOST_TALKERS = 4, 100  # noise must not name receivers without end


@dataclass(slots=True)
class _Receiver:
    """One receiver's last position [deg] and moment, as stated [s of the day] and when it came [ns, monotonic], and
    the kinds of sentences that reported it."""

    position: tuple[float, float]
    moment_s: float
    came_ns: int
    kinds: set[str] = field(default_factory=set)
    speed_mps: float | None = None

    def distance_m(self, position: tuple[float, float]) -> float:
        (latitude, longitude), (north, east) = self.position, position
        shift_deg = (east - longitude + 180.0) % 360.0 - 180.0
        return _DEGREE_M * hypot(north - latitude, shift_deg * cos(radians(latitude)))

    @property
    def reach_m(self) -> float:
        """How far from its last position it may report another one of the same moment."""
        if self.speed_mps is None:
            return _APART_AT_FIRST_M
        return max(_APART_M, _SECONDS_OF_WAY * self.speed_mps)

    def has_reported(self, kind: str, moment_s: float, came_ns: int) -> bool:
        """Whether it has reported this moment in a sentence of this kind."""
        return self.moment_s == moment_s and kind in self.kinds and came_ns - self.came_ns <= _ONE_MOMENT_NS

    def update(self, kind: str, moment_s: float, came_ns: int, position: tuple[float, float]) -> None:
        since_s = moment_s - self.moment_s
        if since_s or came_ns - self.came_ns > _ONE_MOMENT_NS:
            self.kinds.clear()
            self.speed_mps = self.distance_m(position) / since_s if since_s > 0 else None
            self.came_ns = came_ns
        self.kinds.add(kind)
        self.position, self.moment_s = position, moment_s


class Receivers:
    """The receivers of one line, by sensor as :func:`~seatrial.acquisition.core.trial.sensor_of` names it."""

    def __init__(self, notices: Notices) -> None:
        self._notices = notices
        self._receivers: dict[str, list[_Receiver]] = {}
        self._last: dict[str, int] = {}

    def number(self, sensor: str, kind: str, moment_s: float, came_ns: int, position: tuple[float, float]) -> int:
        """Which receiver reports a position [deg] of a moment [s of the day]: 1 for the first of a sensor.

        ``came_ns`` is when the sentence came, on the monotonic clock.
        One sentence of a kind is expected of each receiver at each moment; a further one, if it is too far from all
        known positions, is another receiver's.
        """
        if sensor not in self._receivers:
            if len(self._receivers) >= _MOST_TALKERS:
                return 1
            self._receivers[sensor] = [_Receiver(position, moment_s, came_ns)]
        receivers = self._receivers[sensor]
        reported = [receiver.has_reported(kind, moment_s, came_ns) for receiver in receivers]
        waiting = [receiver for receiver, has in zip(receivers, reported, strict=True) if not has]
        receiver = _nearest(waiting or receivers, position)
        if any(reported) and receiver.distance_m(position) > receiver.reach_m:
            receiver = _nearest(receivers, position)
            distance_m = receiver.distance_m(position)
            if distance_m > receiver.reach_m and len(receivers) < _MOST_RECEIVERS:
                receiver = _Receiver(position, moment_s, came_ns)
                receivers.append(receiver)
                self._notices.append(("warning", _distance_notice(sensor, len(receivers), distance_m)))
        receiver.update(kind, moment_s, came_ns, position)
        self._last[sensor] = receivers.index(receiver) + 1
        return self._last[sensor]

    def last(self, sensor: str) -> int:
        """The receiver whose position was the last one: what belongs to a fix and bears none follows it."""
        return self._last.get(sensor, 1)


def _nearest(receivers: list[_Receiver], position: tuple[float, float]) -> _Receiver:
    return min(receivers, key=lambda receiver: receiver.distance_m(position))


def _distance_notice(sensor: str, number: int, distance_m: float) -> str:
    talker = sensor.partition("/")[2]
    return (
        f"two receivers with the talker {talker} on one line: a second position of the same moment is"
        f" {distance_m:,.0f} m from the first; its values are kept apart, as receiver{number}"
    )


_LEAST_APART = {"deg": 5.0, "dps": 1.0, "mps": 1.0, "rpm": 20.0, "percent": 20.0, "m": 1.0}
"""Levels are further apart, by the unit at the end of a quantity's name: ten steps of a coarse instrument."""
_FEWEST, _MOST, _STRIDE = 17, 65, 8  # values that are judged, and how many come from one judgement to the next
_FEWEST_TURNS = 8
_BETWEEN = (0.25, 0.75)  # of the distance: steps of such a size belong to neither kind
_EVEN = 0.12  # how much turns may differ from their median, as a fraction of it; of waves it is 0.3
_RETURNS = 0.5  # of the turns have another beside them; none of a rudder that stays over for three samples
_HALF_TURN_DEG = 150.0  # levels as far apart turn either way, by their noise
_SILENT_NS = 3 * NANO  # a source that is silent for longer has no last value
_MOST_SERIES = 200  # noise must not name series without end


@dataclass(slots=True)
class _Source:
    """A source's last value, when it came, and the time between its last two [ns]; 0 where that is not known."""

    value: float
    came_ns: int
    interval_ns: int = 0

    def late(self, came_ns: int) -> float:
        """How many intervals a value would come before or after it is due."""
        return abs((came_ns - self.came_ns) / self.interval_ns - 1.0) if self.interval_ns else 0.0


@dataclass(slots=True)
class _Series:
    values: deque[float] = field(default_factory=lambda: deque(maxlen=_MOST))
    count: int = 0
    sources: list[_Source] = field(default_factory=list)


class InterleavedSources:
    """The sources of one line, by the name of what they report."""

    def __init__(self, notices: Notices) -> None:
        self._notices = notices
        self._series: dict[str, _Series] = {}

    def number(self, label: str, quantity: str, value: float, came_ns: int) -> int:
        """Which source reports a value of a quantity: 1 for the first, and as long as there is no other.

        ``label`` is that of the sentence, ``came_ns`` when it came, on the monotonic clock.
        """
        unit = quantity.rpartition("_")[2]
        series = self._series.get(key := f"{label} {quantity}")
        if series is None:
            if unit not in _LEAST_APART or len(self._series) >= _MOST_SERIES:
                return 1
            series = self._series[key] = _Series()
        if series.sources:
            return _assign(series.sources, value, came_ns, unit)
        series.values.append(value)
        series.count += 1
        if series.count >= _FEWEST and (series.count - _FEWEST) % _STRIDE == 0:
            values, least = [*series.values], _LEAST_APART[unit]
            parts = (values[-_FEWEST:], values)  # a turn between spoils the longer one
            levels = next(filter(None, (two_levels(part, least, circular=unit == "deg") for part in parts)), None)
            if levels is not None:
                series.sources = [_Source(level, came_ns) for level in levels]
                self._notices.append(("warning", _levels_notice(label, quantity, *levels)))
                return _assign(series.sources, value, came_ns, unit)
        return 1


def two_levels(values: Sequence[float], least: float, *, circular: bool) -> tuple[float, float] | None:
    """The last values of two sources that take turns, that of the first value first; None where there is one.

    ``least`` is how far they are apart at least; ``circular`` values are angles in degrees.
    """
    steps = [_difference(later, former, circular) for former, later in pairwise(values)]
    largest = sorted(map(abs, steps))[-_FEWEST_TURNS:]
    distance = largest[_FEWEST_TURNS // 2]
    places = [place for place, step in enumerate(steps) if abs(step) > _BETWEEN[1] * distance]
    turns = [steps[place] for place in places]
    between = sum(abs(step) > _BETWEEN[0] * distance for step in steps) - len(turns)
    adjacent = sum(place + 1 in places or place - 1 in places for place in places)
    in_turn = all(former * later < 0.0 for former, later in pairwise(turns))
    if (
        distance < least
        or len(turns) < _FEWEST_TURNS
        or between
        or max(abs(abs(turn) - distance) for turn in turns) > _EVEN * distance
        or adjacent < _RETURNS * len(turns)
        or not (in_turn or (circular and distance > _HALF_TURN_DEG))
    ):
        return None
    last = [0.0, 0.0]
    side = 0
    for place, value in enumerate(values):
        side = (side + (place - 1 in places)) % 2
        last[side] = value
    return last[0], last[1]


def _assign(sources: list[_Source], value: float, came_ns: int, unit: str) -> int:
    """The source with the last value nearest to a value; where the two values have met, the one that is due."""
    present = [source for source in sources if came_ns - source.came_ns <= _SILENT_NS] or sources
    circular = unit == "deg"
    have_met = abs(_difference(sources[0].value, sources[1].value, circular)) < 0.5 * _LEAST_APART[unit]
    if have_met:
        source = min(present, key=lambda candidate: candidate.late(came_ns))
    else:
        source = min(present, key=lambda candidate: abs(_difference(value, candidate.value, circular)))
    source.value, source.came_ns, source.interval_ns = value, came_ns, came_ns - source.came_ns
    return sources.index(source) + 1


def _difference(later: float, former: float, circular: bool) -> float:
    return (later - former + 180.0) % 360.0 - 180.0 if circular else later - former


def _levels_notice(label: str, quantity: str, first: float, second: float) -> str:
    levels = f"{first:.4g} and {second:.4g} in {quantity}"
    return (
        f"{label.partition('/')[2]} alternates between {levels}: two sources under one talker; the second's values"
        " are kept apart from here on, as source2"
    )
