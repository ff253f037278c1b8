"""The results of a check: flags of the samples, findings in words with their size, and the checks of the stamps.

Flags are those of QARTOD (:class:`seatrial.acquisition.core.trial.Quality`): 1 good, 2 not evaluated, 3 suspect, 4
bad, 9 missing. A check never drops a row; it returns flags of the same index as the data it was given. The results
of the checks of single channels are one finding per channel and code, or one for all channels together.

A jump of a clock and a gap look alike in the stamps. The ship distinguishes them: over a true gap it has sailed on
and turned on as its speeds say, over a jump of the clock it has not. How far that can be trusted over a given time
is taken from the same recording, from places without either.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from seatrial.acquisition.core.quantities import Floats, Ints, Series, to_earth
from seatrial.acquisition.core.ship import POSE_AND_VELOCITY, Channel, unwrap
from seatrial.acquisition.core.trial import Quality
from seatrial.analysis.series import Stretch, interval_ns, white_noise
from seatrial.analysis.tables.table import NANO, times_ns

Flags = NDArray[np.uint8]
ALL = "all"
OTHER_TURN = "other_turn"
"""In the estimate of impossible angles that are possible in the other convention."""
StretchesByChannel = Mapping[str, list[Stretch]]
"""Where each channel has one kind of fault."""
CERTAIN = frozenset({"out_of_range", "spike", "stuck", "duplicate"})
"""Codes whose flagged samples `--repair` may turn into gaps without asking."""
_IRREGULAR, _MOST_PLACES = 0.3, 200
_SURE, _FEWEST, _RARELY = 5.0, 20, 300


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that is wrong: where, how large, how sure, and what to do.

    ``start`` and ``end`` bound it in UTC; ``text`` is one sentence for a reader, ``remedy`` one more that
    states what to do. ``estimate`` holds its size in the names of the contract, with ``low`` and ``high`` of
    the main figure's 95 % interval. ``certain`` marks what `--repair` may correct by itself.
    ``band_hz`` are the frequencies of the motion in which it shows, where it is a matter of these.
    """

    code: str
    channel: str
    start: pd.Timestamp
    end: pd.Timestamp
    text: str
    remedy: str = ""
    estimate: Mapping[str, float] = field(default_factory=dict)
    certain: bool = False
    band_hz: tuple[float, float] | None = None

    def as_json(self) -> dict[str, Any]:
        """The finding with the contract's keys, and ``band_hz`` where there is one; the remedy ends the text."""
        band = {} if self.band_hz is None else {"band_hz": list(self.band_hz)}
        return {
            "code": self.code,
            "channel": self.channel,
            "start": self.start.isoformat(),
            "end": self.end.isoformat(),
            "text": f"{self.text.rstrip('.')}. {self.remedy}".strip(),
            "estimate": dict(self.estimate),
            **band,
        }


@dataclass(frozen=True, slots=True)
class CheckResult:
    """The result of a check across channels.

    ``flags`` has the table's index and a column for each channel that the check evaluated, as uint8.
    """

    flags: pd.DataFrame
    findings: tuple[Finding, ...] = ()


Check = Callable[[pd.DataFrame], CheckResult]
"""A check across channels: from the joined table of raw samples, in the order of measured time."""


def uniform_flags(table: pd.DataFrame, names: Iterable[str] = (), flag: Quality = Quality.GOOD) -> pd.DataFrame:
    """Flags of some channels: missing where ``table`` has no value, else all the same."""
    columns = {name: np.where(table[name].isna(), Quality.MISSING, flag).astype(np.uint8) for name in names}
    return pd.DataFrame(columns, index=table.index)


def set_flags(flags: pd.DataFrame, name: str, rows: Ints, flag: Quality) -> None:
    """Give some rows of a channel a flag, in place."""
    column = flags[name].to_numpy(copy=True)
    column[rows] = flag
    flags[name] = column


@dataclass(frozen=True, slots=True)
class Wording:
    """The text for one kind of fault: a sentence filled in by :func:`_finding`, and what to do.

    ``estimate`` says which of its facts the figures of the finding are.
    """

    sentence: str
    remedy: str
    estimate: Mapping[str, str] = field(default_factory=lambda: {"count": "count", "largest": "size"})


WORDING: dict[str, Wording] = {
    "gap": Wording(
        "{who} is silent {times}, {total:.1f} s in all, the longest {size:.1f} s from {at}",
        "Nothing is put across a gap; keep it out of windows",
        {"seconds": "size", "count": "count"},
    ),
    "stuck": Wording(
        "{who} stands exactly still {times} although it should move, the longest for {seconds:.1f} s from {at}",
        "Do not use it there; look for a sensor or a converter that stopped",
        {"seconds": "seconds", "count": "count"},
    ),
    "spike": Wording(
        "{who} leaves its neighbours and returns {times}, the furthest by {size:.3g} {unit} at {at}",
        "The samples are flagged bad and stay out of resampling",
    ),
    "out_of_range": Wording(
        "{who} has {samples} with impossible values, the first at {first}",
        "The samples are flagged bad; look at the unit and at the source's code for no value",
        {"count": "total"},
    ),
    "duplicate": Wording(
        "{who} has {samples} at a measured time that was there before, the first at {first}",
        "Keep one of the samples of one time",
        {"count": "total"},
    ),
    "time_backwards": Wording(
        "The measured time of {who} runs back {times}, the furthest by {size:.3g} s at {at}",
        "Tables are sorted by measured time; look at how the source stamps",
        {"seconds": "size", "count": "count"},
    ),
    "time_jitter": Wording(
        "The stamps of {who} scatter about a regular clock by {size:.3g} s",
        "Take the source's own time if it has one, or put the samples back on a regular clock",
        {"seconds": "size"},
    ),
    "quantised": Wording(
        "{who} moves in steps of {size:.3g} {unit}, coarser than its noise",
        "What lies between the steps is lost; take it from a finer source if there is one",
        {"step": "size"},
    ),
}


def utc_time(time_ns: int) -> pd.Timestamp:
    """A time [ns since 1970] as UTC."""
    return pd.Timestamp(time_ns, unit="ns", tz="UTC")


def findings_of(code: str, by_channel: StretchesByChannel, channels: Mapping[str, Channel]) -> list[Finding]:
    """Findings of one code: what all ``channels`` have in common once, the rest by channel."""
    common: set[tuple[int, int]] = set()
    if len(by_channel) == len(channels) > 1:
        common = set.intersection(
            *({(stretch.start_ns, stretch.end_ns) for stretch in stretches} for stretches in by_channel.values())
        )
    findings = []
    if common:
        first = next(iter(by_channel.values()))
        together = [stretch for stretch in first if (stretch.start_ns, stretch.end_ns) in common]
        findings.append(_finding(code, ALL, "", together))
    for name, stretches in by_channel.items():
        separate = [stretch for stretch in stretches if (stretch.start_ns, stretch.end_ns) not in common]
        if separate:
            findings.append(_finding(code, name, channels[name].unit, separate))
    return findings


def _finding(code: str, channel: str, unit: str, stretches: list[Stretch]) -> Finding:
    wording, largest = WORDING[code], max(stretches, key=lambda stretch: (abs(stretch.size), -stretch.start_ns))
    start_ns, end_ns = min(stretches).start_ns, max(stretch.end_ns for stretch in stretches)
    count, samples = len(stretches), sum(stretch.size for stretch in stretches)
    facts: dict[str, Any] = {
        "who": "every channel" if channel == ALL else channel,
        "unit": unit,
        "times": "once" if count == 1 else "twice" if count == 2 else f"{count} times",
        "samples": "1 sample" if samples == 1 else f"{samples:,.0f} samples",
        "count": float(count),
        "total": samples,
        "size": abs(largest.size),
        "seconds": largest.seconds,
        "at": f"{utc_time(largest.start_ns):%H:%M:%S}",
        "first": f"{utc_time(start_ns):%H:%M:%S}",
    }
    estimate = {key: facts[fact] for key, fact in wording.estimate.items()}
    text = wording.sentence.format_map(facts)
    return Finding(
        code, channel, utc_time(start_ns), utc_time(end_ns), text, wording.remedy, estimate, code in CERTAIN
    )


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
    north, east, heading, surge, sway, turning = (moving[name].to_numpy(dtype=float) for name in POSE_AND_VELOCITY)
    pose = np.column_stack([north, east, unwrap(heading)])
    rates = np.column_stack([*to_earth(surge, sway, np.deg2rad(heading)), turning])
    noise = np.array([max(white_noise(column), 1e-3) for column in pose.T])
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
        next_row, after_gap = _undisturbed(track, 1, odd_steps), _undisturbed(track, rows, odd_steps)
        if after_gap.size < _RARELY:
            return None
        limit = 1.5 * float(np.quantile(_off_course(track, next_row, 1, interval), 0.99))
        near = np.mean(_off_course(track, after_gap, rows, interval) < 2.0 * limit)
        if not (_off_course(track, row, 1, interval)[0] < limit and near < 1.0 / _RARELY):
            return None
    first, last = sorted((int(stamps[place]), int(stamps[place + 1])))
    return ClockJump(first, last, jump, jump - half_width, jump + half_width)


def _off_course(track: _Track, first: Ints, rows: int, interval: float) -> Floats:
    """How far a later row is from where the ship is one interval after the first, in units of noise."""
    rate = 0.5 * (track.rate[first] + track.rate[first + rows])
    deviation: Floats = np.abs(track.place[first + rows] - track.place[first] - interval * rate).max(axis=1)
    return deviation


def _undisturbed(track: _Track, rows: int, odd_steps: Ints) -> Ints:
    """Up to some 2000 rows from which so many rows on there is no odd step."""
    size = track.time_s.size
    first = np.arange(2, max(size - rows - 3, 2), max((size - rows) // 2000, 1))
    undisturbed: Ints = first[np.searchsorted(odd_steps, first - 2) == np.searchsorted(odd_steps, first + rows + 2)]
    return undisturbed


def _elapsed_errors(track: _Track, rows: int, odd_steps: Ints) -> Floats | None:
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
        least = np.maximum(10.0 * spread, max(0.05, 3.0 * interval_ns(received) / NANO))
        strong = np.where(np.abs(step) > least, np.abs(step), 0.0)
        while strong.max(initial=0.0) > 0.0:
            place = int(np.argmax(strong))
            size, half_width = float(step[place]), float(spread[place])
            first, last = sorted((int(measured[place + half - 1]), int(measured[place + half])))
            jumps.append((name, ClockJump(first, last, size, size - half_width, size + half_width)))
            strong[max(place - 2 * half, 0) : place + 2 * half] = 0.0
    return jumps
