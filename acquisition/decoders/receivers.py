"""Receivers that report positions under one talker on one line, told apart by two positions of one moment."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import cos, hypot, radians

from seatrial.acquisition.decoders import Notices

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
    """The receivers of one line, by sensor as :func:`~seatrial.acquisition.core.frames.sensor_of` names it."""

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
                self._notices.append(("warning", _notice(sensor, len(receivers), distance_m)))
        receiver.update(kind, moment_s, came_ns, position)
        self._last[sensor] = receivers.index(receiver) + 1
        return self._last[sensor]

    def last(self, sensor: str) -> int:
        """The receiver whose position was the last one: what belongs to a fix and bears none follows it."""
        return self._last.get(sensor, 1)


def _nearest(receivers: list[_Receiver], position: tuple[float, float]) -> _Receiver:
    return min(receivers, key=lambda receiver: receiver.distance_m(position))


def _notice(sensor: str, number: int, distance_m: float) -> str:
    talker = sensor.partition("/")[2]
    return (
        f"two receivers with the talker {talker} on one line: a second position of the same moment is"
        f" {distance_m:,.0f} m from the first; its values are kept apart, as receiver{number}"
    )
