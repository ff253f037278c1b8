"""Checks of the stamps themselves: a clock that jitters, and a clock that jumps.

A jump and a gap look alike in the stamps. The ship tells them apart: over a true gap she has sailed on and turned
on as her speeds say, over a jump of the clock she has not. How far that can be trusted over a given time is taken
from the same recording, from places without either.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from seatrial.acquisition.core.quantities import Floats, Ints, Series, to_earth
from seatrial.acquisition.core.ship import POSE_AND_VELOCITY, unwrap
from seatrial.analysis.quality.samples import interval_ns, white_noise
from seatrial.analysis.tables.table import NANO, times_ns

_IRREGULAR, _MOST_PLACES = 0.3, 200
_SURE, _FEWEST, _RARELY = 5.0, 20, 300


def jitter_s(times_ns: Ints) -> float:
    """Standard deviation [s] of stamps about a regular clock, 0 where the channel has no regular clock.

    A stamp that is late makes one interval longer and the next shorter by the same: intervals of a jittering
    clock are correlated by -0.5, those of a channel that reports on events are not.
    """
    steps = np.diff(np.sort(times_ns)).astype(float)
    steps = steps[steps > 0]
    if steps.size < 50:
        return 0.0
    middle = float(np.median(steps))
    spread = float(np.median(np.abs(steps - middle))) / 0.6745
    if spread < 1e-6 * middle:
        return 0.0
    bounded = np.clip(steps - middle, -6 * spread, 6 * spread)
    bounded -= bounded.mean()
    correlation = float(np.mean(bounded[1:] * bounded[:-1]) / np.mean(bounded**2))
    return spread / np.sqrt(2.0) / NANO if correlation < -0.25 else 0.0


@dataclass(frozen=True, slots=True)
class ClockJump:
    """A clock that was put forward (positive) or back by ``seconds``, with the ends of the 95 % interval.

    ``start_ns`` and ``end_ns`` are the stamps before and after, the smaller first.
    """

    start_ns: int
    end_ns: int
    seconds: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class _Track:
    """The motion by rows in the order of receipt: place [rows, 3] in units of its noise, and its rate per s."""

    time_s: Floats
    place: Floats
    rate: Floats

    def elapsed(self, first: Ints, last: Ints) -> tuple[Floats, Floats]:
        """The time [s] between two rows by the ship's motion, and its precision [1/s]."""
        rate = 0.25 * (self.rate[first - 1] + self.rate[first] + self.rate[last] + self.rate[last + 1])
        moved = self.place[last] - self.place[first]
        precision = np.sum(rate**2, axis=1)
        precision = np.maximum(precision, 1e-12)
        return np.sum(moved * rate, axis=1) / precision, np.sqrt(precision)


def clock_jumps(table: pd.DataFrame) -> list[ClockJump]:
    """Where the stamps jump and the ship does not, for a table in the order of receipt.

    Needs position, heading, surge, sway and yaw rate in common rows; rows that lack one are passed over. Returns
    none where they are missing, where the stamps are irregular throughout, or where the ship lies still.
    """
    if not set(POSE_AND_VELOCITY) <= set(table.columns):
        return []
    moving = table.loc[:, list(POSE_AND_VELOCITY)].dropna()
    if len(moving) < 2 * _FEWEST:
        return []
    stamps = times_ns(moving)
    track = _track_of(moving, stamps)
    steps = np.diff(track.time_s)
    interval = float(np.median(np.abs(steps)))
    spread = float(np.median(np.abs(steps - interval)))
    places = np.flatnonzero(np.abs(steps - interval) > max(_IRREGULAR * interval, 10.0 * spread))
    places = places[(places > 1) & (places < len(moving) - 3)]
    if not interval or places.size > _MOST_PLACES:
        return []
    jumps = (_jump_at(track, int(place), places, interval, stamps) for place in places)
    return [jump for jump in jumps if jump is not None]


def _track_of(moving: pd.DataFrame, stamps: Ints) -> _Track:
    north, east, heading, surge, sway, turning = (moving[name].to_numpy(dtype=float) for name in POSE_AND_VELOCITY)
    psi = np.deg2rad(heading)
    values = np.column_stack([north, east, unwrap(heading)])
    rates = np.column_stack([*to_earth(surge, sway, psi), turning])
    noise = np.array([max(white_noise(column), 1e-3) for column in values.T])
    noise[:2] = noise[:2].max()
    return _Track((stamps - stamps[0]) / NANO, values / noise, rates / noise)


def _jump_at(track: _Track, place: int, odd_steps: Ints, interval: float, stamps: Ints) -> ClockJump | None:
    """The jump between a row and the next, or nothing if what is left over is no more than a gap explains."""
    step = float(track.time_s[place + 1] - track.time_s[place])
    here = np.array([place])
    elapsed, precision = (float(values[0]) for values in track.elapsed(here, here + 1))
    usual = _errors(track, max(round(abs(elapsed) / interval), 1), odd_steps)
    gap = _errors(track, max(round(abs(step) / interval), 1), odd_steps)
    if usual is None or gap is None:
        return None
    jump = step - elapsed + float(np.median(usual)) / precision
    doubt = float(np.quantile(np.abs(usual - np.median(usual)), 0.95)) / precision
    deviation = np.abs(gap - np.median(gap))
    by_chance = max(_SURE * float(np.median(deviation)) / 0.6745, 1.5 * float(np.quantile(deviation, 0.99)))
    no_gap = abs((step - elapsed) * precision + float(np.median(gap))) > by_chance
    if abs(jump) < max(4.0 * doubt, 0.5 * interval) or not (
        no_gap or _continues_course(track, place, step, interval, odd_steps)
    ):
        return None
    first, last = sorted((int(stamps[place]), int(stamps[place + 1])))
    return ClockJump(first, last, jump, jump - doubt, jump + doubt)


def _continues_course(track: _Track, place: int, step: float, interval: float, odd_steps: Ints) -> bool:
    """Whether the next row is where the ship is one interval later, as it hardly ever is after so long a time."""
    next_row, after_gap = (
        _undisturbed(track, 1, odd_steps),
        _undisturbed(track, round(abs(step) / interval), odd_steps),
    )
    if after_gap.size < _RARELY:
        return False
    limit = 1.5 * float(np.quantile(_off_course(track, next_row, 1, interval), 0.99))
    here = _off_course(track, np.array([place]), 1, interval)[0]
    rows = round(abs(step) / interval)
    return bool(
        here < limit and np.mean(_off_course(track, after_gap, rows, interval) < 2.0 * limit) < 1.0 / _RARELY
    )


def _off_course(track: _Track, first: Ints, rows: int, interval: float) -> Floats:
    """How far a later row is from where the ship is one interval after the first, in units of noise."""
    rate = 0.5 * (track.rate[first] + track.rate[first + rows])
    deviation: Floats = np.abs(track.place[first + rows] - track.place[first] - interval * rate).max(axis=1)
    return deviation


def _undisturbed(track: _Track, rows: int, odd_steps: Ints) -> Ints:
    """Up to some 2000 rows from which so many rows on there is no odd step."""
    size = track.time_s.size
    first = np.arange(2, max(size - rows - 3, 2), max((size - rows) // 2000, 1))
    calm: Ints = first[np.searchsorted(odd_steps, first - 2) == np.searchsorted(odd_steps, first + rows + 2)]
    return calm


def _errors(track: _Track, rows: int, odd_steps: Ints) -> Floats | None:
    """Errors of the time that the motion gives over so many rows, times its precision; None for too few rows."""
    first = _undisturbed(track, rows, odd_steps)
    if first.size < _FEWEST:
        return None
    elapsed, precision = track.elapsed(first, first + rows)
    errors: Floats = (elapsed - (track.time_s[first + rows] - track.time_s[first])) * precision
    return errors


def reception_jumps(series: Mapping[str, Series]) -> list[tuple[str, ClockJump]]:
    """Where measured times step against those of reception for good: by source, and the jump of its clock.

    The reader's clock is the standard. A step counts if the median of 20 samples before and after differ by ten
    times their spread and by three intervals; a source's channels are taken together.
    """
    sources: dict[str, list[Series]] = {}
    for samples in series.values():
        if np.any(samples.measured_ns != samples.received_ns):
            for number, name in enumerate(samples.sources):
                sources.setdefault(name, []).append(samples.subset(samples.source_index == number))
    jumps = []
    for name, parts in sources.items():
        received = np.concatenate([part.received_ns for part in parts])
        measured = np.concatenate([part.measured_ns for part in parts])
        order = np.argsort(received, kind="stable")
        jumps += [(name, jump) for jump in _offset_steps(measured[order], received[order])]
    return jumps


def _offset_steps(measured: Ints, received: Ints) -> list[ClockJump]:
    half, offset = 20, (measured - received) / NANO
    if offset.size < 4 * half:
        return []
    interval = interval_ns(received) / NANO
    windows = np.lib.stride_tricks.sliding_window_view(offset, half)
    low, middle, high = (np.quantile(windows, share, axis=1) for share in (0.1, 0.5, 0.9))
    step = middle[half:] - middle[:-half]
    spread = (high - low)[half:] + (high - low)[:-half]
    strong = np.where(np.abs(step) > np.maximum(10.0 * spread, max(0.05, 3.0 * interval)), np.abs(step), 0.0)
    jumps = []
    while strong.max(initial=0.0) > 0.0:
        place = int(np.argmax(strong))
        at, size, doubt = place + half, float(step[place]), float(spread[place])
        first, last = sorted((int(measured[at - 1]), int(measured[at])))
        jumps.append(ClockJump(first, last, size, size - doubt, size + doubt))
        strong[max(place - 2 * half, 0) : place + 2 * half] = 0.0
    return jumps
