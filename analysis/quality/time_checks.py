"""Checks of the stamps: jitter of a source's clock, and clocks that jump.

A jump of a clock and a gap look alike in the stamps. The ship distinguishes them: over a true gap it has sailed on
and turned on as its speeds say, over a jump of the clock it has not. How far that can be trusted over a given time
is taken from the same recording, from places without either. Where the times of reception were recorded, they show
the jump by themselves.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from seatrial.acquisition.core import ship
from seatrial.acquisition.core.quantities import Floats, Ints, Series, to_earth
from seatrial.analysis import series
from seatrial.analysis.quality.findings import ALL, Finding, utc_timestamp
from seatrial.analysis.tables.table import NANO, index_of, times_ns, valid_values

_IRREGULAR, _MOST_PLACES = 0.3, 200
_SURE, _FEWEST, _RARELY = 5.0, 20, 300


def jitter_s(times_ns: Ints) -> float:
    """Standard deviation [s] of stamps about a regular clock, 0 where the channel has no regular clock.

    A delayed stamp makes one interval longer and the next shorter by the same: intervals of a jittering
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


def find_clock_jumps(table: pd.DataFrame) -> list[ClockJump]:
    """Where the stamps jump and the ship does not, for a table in the order of receipt.

    Needs position, heading, surge, sway and yaw rate in common rows; rows that lack one are passed over. Returns
    none where they are missing, where the stamps are irregular throughout, or where the ship lies still.
    """
    if not set(ship.POSE_AND_VELOCITY) <= set(table.columns):
        return []
    moving = table.loc[:, list(ship.POSE_AND_VELOCITY)].dropna()
    if len(moving) < 2 * _FEWEST:
        return []
    stamps = times_ns(moving)
    north, east, heading, surge, sway, turning = (
        moving[name].to_numpy(dtype=float) for name in ship.POSE_AND_VELOCITY
    )
    pose = np.column_stack([north, east, ship.unwrap(heading)])
    rates = np.column_stack([*to_earth(surge, sway, np.deg2rad(heading)), turning])
    noise = np.array([max(series.white_noise_standard_deviation(column), 1e-3) for column in pose.T])
    noise[:2] = noise[:2].max()
    track = _Track((stamps - stamps[0]) / NANO, pose / noise, rates / noise)
    steps = np.diff(track.time_s)
    interval = float(np.median(np.abs(steps)))
    spread = float(np.median(np.abs(steps - interval)))
    places = np.flatnonzero(np.abs(steps - interval) > max(_IRREGULAR * interval, 10.0 * spread))
    places = places[(places > 1) & (places < len(moving) - 3)]
    if not interval or places.size > _MOST_PLACES:
        return []
    jumps = (_jump_at(track, int(place), places, interval, stamps) for place in places)
    return [jump for jump in jumps if jump is not None]


def _jump_at(track: _Track, place: int, odd_steps: Ints, interval: float, stamps: Ints) -> ClockJump | None:
    """The jump between a row and the next, or nothing if the residual is no more than a gap explains."""
    step = float(track.time_s[place + 1] - track.time_s[place])
    row = np.array([place])
    elapsed, precision = (float(values[0]) for values in track.elapsed(row, row + 1))
    rows = round(abs(step) / interval)
    usual_errors = _elapsed_errors(track, max(round(abs(elapsed) / interval), 1), odd_steps)
    gap_errors = _elapsed_errors(track, max(rows, 1), odd_steps)
    if usual_errors is None or gap_errors is None:
        return None
    jump = step - elapsed + float(np.median(usual_errors)) / precision
    half_width = float(np.quantile(np.abs(usual_errors - np.median(usual_errors)), 0.95)) / precision
    if abs(jump) < max(4.0 * half_width, 0.5 * interval):
        return None
    deviation = np.abs(gap_errors - np.median(gap_errors))
    by_chance = max(_SURE * float(np.median(deviation)) / 0.6745, 1.5 * float(np.quantile(deviation, 0.99)))
    no_gap = abs((step - elapsed) * precision + float(np.median(gap_errors))) > by_chance
    if not no_gap:
        # A gap may explain it, unless the next row is where the ship is one interval later, as it hardly ever is
        # after so long a time.
        next_row, after_gap = _undisturbed_rows(track, 1, odd_steps), _undisturbed_rows(track, rows, odd_steps)
        if after_gap.size < _RARELY:
            return None
        limit = 1.5 * float(np.quantile(_distance_off_course(track, next_row, 1, interval), 0.99))
        near = np.mean(_distance_off_course(track, after_gap, rows, interval) < 2.0 * limit)
        if not (_distance_off_course(track, row, 1, interval)[0] < limit and near < 1.0 / _RARELY):
            return None
    first, last = sorted((int(stamps[place]), int(stamps[place + 1])))
    return ClockJump(first, last, jump, jump - half_width, jump + half_width)


def _distance_off_course(track: _Track, first: Ints, rows: int, interval: float) -> Floats:
    """How far a later row is from where the ship is one interval after the first, in units of noise."""
    rate = 0.5 * (track.rate[first] + track.rate[first + rows])
    deviation: Floats = np.abs(track.place[first + rows] - track.place[first] - interval * rate).max(axis=1)
    return deviation


def _undisturbed_rows(track: _Track, rows: int, odd_steps: Ints) -> Ints:
    """Up to some 2000 rows from which so many rows on there is no odd step."""
    size = track.time_s.size
    first = np.arange(2, max(size - rows - 3, 2), max((size - rows) // 2000, 1))
    undisturbed: Ints = first[np.searchsorted(odd_steps, first - 2) == np.searchsorted(odd_steps, first + rows + 2)]
    return undisturbed


def _elapsed_errors(track: _Track, rows: int, odd_steps: Ints) -> Floats | None:
    """Errors of the time that the motion gives over so many rows, times its precision; None for too few rows."""
    first = _undisturbed_rows(track, rows, odd_steps)
    if first.size < _FEWEST:
        return None
    elapsed, precision = track.elapsed(first, first + rows)
    errors: Floats = (elapsed - (track.time_s[first + rows] - track.time_s[first])) * precision
    return errors


def find_reception_jumps(recorded: Mapping[str, Series]) -> list[tuple[str, ClockJump]]:
    """Where measured times step against those of reception for good: by source, and the jump of its clock.

    The reader's clock is the standard. A step counts if the median of 20 samples before and after differ by ten
    times their spread and by three intervals; a source's channels are taken together.
    """
    sources: dict[str, list[Series]] = {}
    for samples in recorded.values():
        if np.any(samples.measured_ns != samples.received_ns):
            for number, name in enumerate(samples.sources):
                sources.setdefault(name, []).append(samples.subset(samples.source_index == number))
    jumps, half = [], 20
    for name, parts in sources.items():
        received = np.concatenate([part.received_ns for part in parts])
        order = np.argsort(received, kind="stable")
        measured, received = np.concatenate([part.measured_ns for part in parts])[order], received[order]
        offset = (measured - received) / NANO
        if offset.size < 4 * half:
            continue
        windows = np.lib.stride_tricks.sliding_window_view(offset, half)
        low, middle, high = (np.quantile(windows, fraction, axis=1) for fraction in (0.1, 0.5, 0.9))
        step = middle[half:] - middle[:-half]
        spread = (high - low)[half:] + (high - low)[:-half]
        least = np.maximum(10.0 * spread, max(0.05, 3.0 * series.median_interval_ns(received) / NANO))
        strong = np.where(np.abs(step) > least, np.abs(step), 0.0)
        while strong.max(initial=0.0) > 0.0:
            place = int(np.argmax(strong))
            size, half_width = float(step[place]), float(spread[place])
            first, last = sorted((int(measured[place + half - 1]), int(measured[place + half])))
            jumps.append((name, ClockJump(first, last, size, size - half_width, size + half_width)))
            strong[max(place - 2 * half, 0) : place + 2 * half] = 0.0
    return jumps


def check_clocks(recorded: Mapping[str, Series], joined: pd.DataFrame) -> tuple[list[ClockJump], list[Finding]]:
    """Jumps of clocks against reception where that was recorded, else against the ship's motion."""
    clocks = [(f"The clock of {source}", jump) for source, jump in find_reception_jumps(recorded)]
    if not clocks:
        # The rows in the order of receipt where the channels share their stamps; else in the order of measurement,
        # each row of a position with the last values of the other channels.
        position = recorded["north_m"].measured_ns if "north_m" in recorded else np.zeros(0, np.int64)
        moving = joined
        if all(np.array_equal(position, samples.measured_ns) for samples in recorded.values()):
            values = {name: valid_values(samples) for name, samples in recorded.items()}
            moving = pd.DataFrame(values, index=index_of(position))
        elif "north_m" in joined:
            moving = joined.ffill()[joined["north_m"].notna().to_numpy()]
        clocks = [("The clock, but not the ship,", jump) for jump in find_clock_jumps(moving)]
    findings = []
    for clock, jump in clocks:
        text = (
            f"{clock} jumps {'forward' if jump.seconds > 0 else 'back'} by {abs(jump.seconds):.2f} s "
            f"({abs(jump.low):.2f} to {abs(jump.high):.2f}) at {utc_timestamp(jump.start_ns):%H:%M:%S}"
        )
        remedy = "Take the jump off every later stamp before anything crosses it"
        estimate = {"seconds": jump.seconds, "low": jump.low, "high": jump.high}
        ends = utc_timestamp(jump.start_ns), utc_timestamp(jump.end_ns)
        findings.append(Finding("clock_jump", ALL, *ends, text, remedy, estimate))
    return [jump for _, jump in clocks], findings
