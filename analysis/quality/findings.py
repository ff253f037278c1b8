"""The results of a check: flags of the samples, findings in words with their size, and the checks of the stamps.

Flags are those of QARTOD (:class:`seatrial.acquisition.core.trial.Quality`): 1 good, 2 not evaluated, 3 suspect, 4
bad, 9 missing. A check never drops a row; it returns flags of the same index as the data it was given. The results
of the checks of single channels are one finding per channel and code, or one for all channels together.

A jump of a clock and a gap look alike in the stamps. The ship distinguishes them: over a true gap it has sailed on
and turned on as its speeds say, over a jump of the clock it has not. How far that can be trusted over a given time
is taken from the same recording, from places without either.

Command channels are checked for interpolated orders, frozen feedback, per cent recorded as rpm, and the sign of a
helm. Some orders are recorded when they change. A lever that stands still sends nothing; the value it was left at
holds until the next event. Interpolated linearly, the order creeps towards its next value for minutes, which no
drive and no hand does. A measured value never keeps to a straight line to the last digit, so the lines give
themselves away.

Numbers of thrusters and shafts are easily exchanged, in a configuration or a column map, so that feedback is under
the name of the sister. Where both are ordered alike nothing shows; where they are not, each feedback is near the
other's orders all the time.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from itertools import chain, combinations
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from seatrial.acquisition.core import ship
from seatrial.acquisition.core.quantities import Bytes, Floats, Ints, Series, to_earth
from seatrial.acquisition.core.trial import Quality
from seatrial.analysis import series
from seatrial.analysis.tables.table import NANO, table_actuators, table_controls, times_ns, utc_index

Flags = Bytes
ALL = "all"
REPEATED = "repeated"
SHIP = "ship"
"""What a finding is about that is no fault of a channel."""
OTHER_TURN = "other_turn"
"""In the estimate of impossible angles that are possible in the other convention."""
StretchesByChannel = Mapping[str, list[series.Stretch]]
"""Where each channel has one kind of fault."""
CERTAIN = frozenset({"out_of_range", "spike", "stuck", "duplicate"})
"""Codes whose flagged samples `--repair` may turn into gaps without asking."""
_IRREGULAR, _MOST_PLACES = 0.3, 200
_SURE, _FEWEST, _RARELY = 5.0, 20, 300
_STEP_S, _FEWEST_COMPARED, _PARTS = 1.0, 60, 2
_NEARER = 3.0
"""By so many times exchanged feedback is nearer to the other's orders, as a root mean square, in every part."""
_LEAST = {"deg": 2.0, "rpm": 5.0, "%": 2.0}
"""What the orders have to differ by, as a root mean square: less is within what a drive is off anyway."""


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
    ``unevaluated`` is what could not be judged, and why.
    """

    flags: pd.DataFrame
    findings: tuple[Finding, ...] = ()
    unevaluated: str = ""


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
    """The text for one kind of fault: a sentence filled in by :func:`_finding_of_stretches`, and what to do.

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
    "marked_suspect": Wording(
        "{who} has {samples} that came marked as suspect, the first at {first}: their source calls them estimated,"
        " entered by hand or simulated, or their stamps may be late",
        "Do not take them for measured; the recorder's events name the source",
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


def utc_timestamp(time_ns: int) -> pd.Timestamp:
    """A time [ns since 1970] as UTC."""
    return pd.Timestamp(time_ns, unit="ns", tz="UTC")


def findings_of_code(
    code: str, by_channel: StretchesByChannel, channels: Mapping[str, ship.Channel]
) -> list[Finding]:
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
        findings.append(_finding_of_stretches(code, ALL, "", together))
    for name, stretches in by_channel.items():
        separate = [stretch for stretch in stretches if (stretch.start_ns, stretch.end_ns) not in common]
        if separate:
            findings.append(_finding_of_stretches(code, name, channels[name].unit, separate))
    return findings


def _finding_of_stretches(code: str, channel: str, unit: str, stretches: list[series.Stretch]) -> Finding:
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
        "at": f"{utc_timestamp(largest.start_ns):%H:%M:%S}",
        "first": f"{utc_timestamp(start_ns):%H:%M:%S}",
    }
    estimate = {key: facts[fact] for key, fact in wording.estimate.items()}
    text = wording.sentence.format_map(facts)
    return Finding(
        code,
        channel,
        utc_timestamp(start_ns),
        utc_timestamp(end_ns),
        text,
        wording.remedy,
        estimate,
        code in CERTAIN,
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


ORDER_INTERPOLATED = "order_interpolated"
_FEWEST_STEPS = 3
_LONG_S = 5.0
_VERY_LONG_S = 30.0
_SLOWEST_DRIVE_PER_S = {"rudder": 1.0, "pitch": 2.0}
_SLOWEST_OTHER_PER_S = 5.0
"""Drives turn an azimuth by 5-20 deg/s and a shaft by 5 rpm/s and more, steering gear a rudder by over 2 deg/s, and
pitch goes from nothing to full in 10 to 30 s: slower lines are none of theirs."""
_ROUNDING = 1e-9
_REPEATS = 0.3
"""A feedback that repeats its value more often than this is too coarse, or an order: it may well stand still."""
_SHORTEST_S = 5.0
_SHORTEST_SAMPLES = 10
_IDLE = 0.05
_CHANCE = 1e-6
_PER_CENT = 100.0
_PIECES = 10
_LEAST_DEG, _HELD_SHARE = 3.0, 0.3
_LEAST_S, _LEAST_TURN_DEG = 5.0, 10.0
_UNDER_WAY = 0.3
_FEWEST_DEG = 60.0
_CLEARLY = -0.8
_NEEDED = ("heading_deg", "surge_mps")
_MEAN_OVER, _FEWEST_MEANS, _KEPT_SHARE = "20s", 3, 0.98


class Ramps(NamedTuple):
    """Exactly straight, sloping stretches of a series: samples ``first`` to ``last``, both on the line."""

    first: Ints
    last: Ints
    seconds: Floats


_NO_RAMPS = Ramps(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0))


def check_orders(table: pd.DataFrame) -> CheckResult:
    """Find orders that were interpolated linearly between events (``order_interpolated``).

    One finding a command channel. ``estimate``: the ``share`` of time in ramps, ``longest_s``, and how many
    ``ramps``. The values within a ramp, its first excepted, are flagged suspect.
    """
    names = tuple(name for name in table_controls(table) if name in table)
    flags, index, findings = uniform_flags(table, names), utc_index(table), []
    for name in names:
        samples = series.finite_samples(table, name)
        ramps = order_ramps(table, name, samples)
        inside = series.mask_of_runs(ramps.first + 1, ramps.last, samples.rows.size)
        set_flags(flags, name, samples.rows[inside], Quality.SUSPECT)
        if not ramps.first.size:
            continue
        share = float(ramps.seconds.sum() / (samples.time_s[-1] - samples.time_s[0]))
        longest_s = float(ramps.seconds.max())
        text = (
            f"{name} runs on exactly straight lines for {100 * share:.0f} % of the time, up to {longest_s:.0f} s "
            "long: an order that was recorded when it changed and then interpolated"
        )
        start, end = index[samples.rows[[ramps.first[0], ramps.last[-1]]]]
        estimate = {"share": share, "longest_s": longest_s, "ramps": float(ramps.first.size)}
        remedy = "Each order holds until the next event, and --repair makes it so"
        findings.append(Finding(ORDER_INTERPOLATED, name, start, end, text, remedy, estimate, certain=True))
    return CheckResult(flags, tuple(findings))


def hold_orders(table: pd.DataFrame, name: str) -> Floats:
    """A command channel whose interpolated ramps hold their first value until the last sample: [rows].

    An event means that the order has changed, no event that it stayed. So the value at the beginning of a ramp is
    the order until its end, and the line between was never ordered.
    """
    value = table[name].to_numpy(dtype=float, copy=True)
    samples = series.finite_samples(table, name)
    ramps = order_ramps(table, name, samples)
    inside = np.flatnonzero(series.mask_of_runs(ramps.first + 1, ramps.last, samples.rows.size))
    begun = ramps.first[np.searchsorted(ramps.first, inside, side="left") - 1]
    value[samples.rows[inside]] = samples.value[begun]
    return value


def order_ramps(table: pd.DataFrame, name: str, samples: series.Samples) -> Ramps:
    """The ramps of a channel that was interpolated; none of any other.

    A ramp is where the values lie on a sloping line to rounding, over three equal steps or more. Rounding is that
    of floating point, or that of the decimals a file was written with where those are fine compared with the
    values' range; on a coarse grid equal steps prove nothing. A channel was interpolated where three slow lines
    last 5 s, or one 30 s, that are not all equally steep, as those of a drive at its limit are. Then all its
    straight lines count, the short ones too.
    """
    time_s, value = samples.time_s, ship.unwrap(samples.value) if ship.BY_NAME[name].circular else samples.value
    if value.size <= _FEWEST_STEPS:
        return _NO_RAMPS
    before_s, after_s = np.diff(time_s)[:-1], np.diff(time_s)[1:]
    line = (value[:-2] * after_s + value[2:] * before_s) / (before_s + after_s)
    scale, span = float(np.abs(value).max()) or 1.0, np.ptp(value)
    exact = (
        decimals for decimals in range(3, 7)
        if 10.0**-decimals < 1e-4 * span and np.all(np.abs(value - np.round(value, decimals)) < 1e-9 * scale)
    )  # fmt: skip
    # How far a value on a line may be off it: twice the file's last decimal, if that is fine, else 1e-9.
    rounding = next((10.0**-decimals for decimals in exact), _ROUNDING * scale)
    slopes = np.abs(value[2:] - value[:-2]) > 8.0 * rounding
    first, stop = series.edges_of_runs((np.abs(value[1:-1] - line) <= rounding) & slopes)
    last = stop + 1  # of a run of middles i..j in the inner samples, the line begins at i and ends at j + 2
    enough = last - first >= _FEWEST_STEPS
    first, last = first[enough], last[enough]
    seconds = time_s[last] - time_s[first]
    slope_per_s = (value[last] - value[first]) / seconds

    slowest = _SLOWEST_DRIVE_PER_S.get(
        ship.control_kind_of_channel(name, table_actuators(table)), _SLOWEST_OTHER_PER_S
    )
    steepness = np.round(np.log(np.abs(slope_per_s)), 3)
    _, group, count = np.unique(steepness, return_inverse=True, return_counts=True)
    is_drive_limit = count[group] >= max(3, steepness.size / 2)  # which at least half of all share
    long_s = seconds[(np.abs(slope_per_s) < slowest) & ~is_drive_limit & (seconds >= _LONG_S)]
    is_interpolated = long_s.size >= 3 or bool((long_s >= _VERY_LONG_S).any())
    return Ramps(first, last, seconds) if is_interpolated else _NO_RAMPS


def check_thruster_feedback(table: pd.DataFrame) -> CheckResult:
    """Find feedback that has frozen (``feedback_frozen``) and shafts in per cent (``percent_scaled``).

    Frozen samples are flagged bad, ``estimate`` holds the ``seconds`` of all stretches together; a channel in
    per cent is suspect, ``estimate`` holds ``factor`` with ``low`` and ``high`` where the sister shaft gives it.
    """
    names = tuple(name for name in table_controls(table) if name in table)
    flags, index, findings = uniform_flags(table, names), utc_index(table), []
    scaled = {finding.channel: finding for finding in _percent_scaled_shafts(table)}
    for name in names:
        samples = series.finite_samples(table, name)
        first, stop = frozen_stretches(table, name, samples)
        if name in scaled:
            set_flags(flags, name, samples.rows, Quality.SUSPECT)
        # the first of a stretch was still measured
        repeats = series.mask_of_runs(first + 1, stop, samples.rows.size)
        set_flags(flags, name, samples.rows[repeats], Quality.BAD)
        if first.size:
            seconds = float((samples.time_s[stop - 1] - samples.time_s[first]).sum())
            times = "once" if first.size == 1 else f"{first.size} times"
            text = f"{name} stood exactly still {times}, {seconds:.0f} s in all, and has noise at other times"
            remedy = "Do not use the channel there; look for a line or a converter that stopped"
            start, end = index[samples.rows[[first[0], stop[-1] - 1]]]
            findings.append(Finding("feedback_frozen", name, start, end, text, remedy, {"seconds": seconds}))
    return CheckResult(flags, (*findings, *scaled.values()))


def frozen_stretches(table: pd.DataFrame, name: str, samples: series.Samples) -> tuple[Ints, Ints]:
    """First and one past the last sample of the stretches in which a noisy feedback repeats one value exactly.

    A stretch counts if it is longer than chance makes by the share of repeats elsewhere, and three times
    longer than the usual repeats; not where the thruster stands still, which needs no noise, nor at the end of
    the values' range, where a reading that is limited stays.
    """
    empty, value = np.zeros(0, np.int64), samples.value
    if value.size < 3 * _SHORTEST_SAMPLES or order_ramps(table, name, samples).first.size:
        return empty, empty  # too short, or an order, which has no noise and rightly stands still
    starts, lengths = series.runs_of_equal(np.diff(value) != 0.0)
    usual = lengths < max(_SHORTEST_SAMPLES, 3.0 * np.quantile(lengths, 0.999))
    repeats = float((lengths[usual] - 1).sum() / max(lengths[usual].sum(), 1))
    if repeats > _REPEATS or lengths[usual].sum() < 3 * _SHORTEST_SAMPLES:
        return empty, empty
    by_chance = np.log(_CHANCE / value.size) / np.log(max(repeats, 1e-3))
    stops = starts + lengths
    seconds = samples.time_s[stops - 1] - samples.time_s[starts]
    long = ~usual & (lengths > by_chance) & (seconds >= _SHORTEST_S)
    long &= (value[starts] != value.max()) & (value[starts] != value.min())
    # A drive stands still while its shaft turns at less than 5 % of its fastest.
    channels = [[channel.name for channel in actuator.channels] for actuator in table_actuators(table)]
    shaft = next((names[0] for names in channels if name in names), name)
    turning = series.finite_samples(table, shaft)
    if turning.rows.size and shaft.endswith("_rpm"):
        rpm = np.abs(np.interp(samples.time_s[starts], turning.time_s, turning.value))
        long &= rpm > _IDLE * np.abs(turning.value).max()
    return starts[long], stops[long]


def _percent_scaled_shafts(table: pd.DataFrame) -> list[Finding]:
    """Shafts whose values are limited to 100 while the sister's are a constant multiple, or that stop at 100."""
    findings, actuators, index = [], table_actuators(table), utc_index(table)
    for name in (control for control in table_controls(table) if control.endswith("_rpm")):
        samples = series.finite_samples(table, name)
        if samples.rows.size < 3 * _PIECES or np.abs(samples.value).max() > 1.02 * _PER_CENT:
            continue
        kind = ship.actuator_kind_of_channel(name, actuators)
        shafts = [actuator.channels[0].name for actuator in actuators if actuator.drives and actuator.kind == kind]
        estimates = (_factor_to_sister_shaft(table, shaft, samples) for shaft in shafts if shaft != name)
        estimate = next(filter(None, estimates), {})
        # The largest amount is 100 exactly and stands there for 1 % of the time on two occasions. Elsewhere it has
        # to be noisy, as a reading that is limited is: an order of 100 rpm stands at 100 rpm.
        at_limit = np.abs(samples.value) == _PER_CENT
        changes = np.diff(samples.value[~at_limit])
        stops = not (np.abs(samples.value) > _PER_CENT).any() and at_limit.mean() > 0.01
        stops = stops and series.edges_of_runs(at_limit)[0].size >= 2
        if estimate or (stops and changes.size and np.mean(changes == 0.0) < _REPEATS):
            reason = "it stops at 100 exactly"
            if estimate:
                reason = f"the sister shaft turns {estimate['factor']:.3f} times as fast all the time"
            text = f"{name} looks like per cent, not rpm: {reason}"
            remedy = "Give the shaft's rpm at 100 % in the map of columns and import again"
            start, end = index[samples.rows[[0, -1]]]
            findings.append(Finding("percent_scaled", name, start, end, text, remedy, estimate))
    return findings


def _factor_to_sister_shaft(table: pd.DataFrame, sister: str, samples: series.Samples) -> dict[str, float]:
    """The constant ratio of a sister shaft to this one with its 95 % interval; empty if there is none.

    The two keep one ratio within 5 % all through the recording, too large a ratio for two shafts that differ
    in trim: no crew runs them so, but for a single setting, from one end of a trial to the other.
    """
    sister_series = series.finite_samples(table, sister)
    if sister_series.rows.size < 3 * _PIECES or np.abs(sister_series.value).max() <= 1.02 * _PER_CENT:
        return {}
    sister_rpm = np.interp(samples.time_s, sister_series.time_s, sister_series.value)
    pieces = [piece for piece in np.array_split(np.arange(samples.value.size), _PIECES) if piece.size]
    cross = np.array([samples.value[piece] @ sister_rpm[piece] for piece in pieces])
    squares = np.array([samples.value[piece] @ samples.value[piece] for piece in pieces])
    factor = float(cross.sum() / max(squares.sum(), 1e-12))
    rms_error = float(np.sqrt(np.mean((sister_rpm - factor * samples.value) ** 2)))
    if not 1.25 < factor < 20.0 or rms_error > 0.05 * float(np.sqrt(np.mean(sister_rpm**2))):
        return {}
    half = 2.26 * float(
        series.jackknife_error(series.leave_one_out_ratios(cross, squares))
    )  # Student's t, nine degrees of freedom
    return {"factor": factor, "low": factor - half, "high": factor + half}


def check_helm_sign(table: pd.DataFrame) -> CheckResult:
    """Find rudders and nozzles that count to the other side (``helm_sign``).

    ``estimate``: the ``agreement`` of turns with the helm, the sum of those to its side less those to the other,
    over all, from -1 to 1; below -0.8 of 60 deg and more it is found. A rudder that is held over turns a ship that
    goes ahead, once it has answered: in the second half of every stretch of one side its heading goes that way. To
    keep a course the rudder is put against the turn, and so the first half, and what turns the ship by less than
    10 deg, are no evidence. Azimuth thrusters are not checked: they may pull, or look aft. Without heading or surge
    there is no finding.
    """
    findings, index = [], utc_index(table)
    complete = all(name in table and table[name].notna().any() for name in _NEEDED)
    for actuator in table_actuators(table) if complete else ():
        channel = actuator.angle if actuator.steers_by in ("rudder", "nozzle") else None
        if channel is None or channel.name not in table:
            continue
        angle, heading, surge = (series.finite_samples(table, name) for name in (channel.name, *_NEEDED))
        if angle.value.size < 2:
            continue
        at = angle.time_s
        course = np.interp(at, heading.time_s, ship.unwrap(heading.value))
        ahead = np.interp(at, surge.time_s, surge.value) > _UNDER_WAY * np.quantile(np.abs(surge.value), 0.98)
        least_deg = max(_LEAST_DEG, _HELD_SHARE * float(np.quantile(np.abs(angle.value), 0.98)))
        turns = [  # to the side of the angle's sign in the second half of each stretch of one side [deg]
            side * (course[stop - 1] - course[np.searchsorted(at, 0.5 * (at[first] + at[stop - 1]))])
            for side in (1.0, -1.0)
            for first, stop in zip(*series.edges_of_runs((side * angle.value > least_deg) & ahead), strict=True)
            if at[stop - 1] - at[first] >= _LEAST_S
        ]
        turned = ship.KINDS[actuator.kind].turns * np.array(
            [turn for turn in turns if abs(turn) >= _LEAST_TURN_DEG]
        )
        total = float(np.abs(turned).sum())
        agreement = float(turned.sum()) / total if total else 0.0
        if total < _FEWEST_DEG or agreement > _CLEARLY:
            continue
        text = (
            f"{channel.name} counts to the wrong side: while it was held over, the ship turned by "
            f"{total:.0f} deg in all, {(1.0 - agreement) / 2.0:.0%} of it to the other side"
        )
        remedy = "Turn its sign, with scale = -1.0 in the column map, unless it is the heading's that is wrong"
        start, end = index[angle.rows[[0, -1]]]
        findings.append(Finding("helm_sign", channel.name, start, end, text, remedy, {"agreement": agreement}))
    return CheckResult(uniform_flags(table), tuple(findings))


def check_repeats(table: pd.DataFrame) -> CheckResult:
    """Find channels of the motion and angles that repeat the values of a slower source (``repeated``).

    ``estimate``: the time between the source's own values, ``period_s``. Repeats are as late as they are old, and
    flagged suspect.
    """
    angles = [actuator.angle.name for actuator in table_actuators(table) if actuator.angle is not None]
    names = [name for name in (*ship.POSE_AND_VELOCITY, *angles) if name in table]
    flags, findings, index = uniform_flags(table, names), list[Finding](), utc_index(table)
    for name in names:
        samples = series.finite_samples(table, name)
        rows, period_s = series.find_repeats(samples, is_command=name in angles)
        if not rows.size:
            continue
        set_flags(flags, name, rows, Quality.SUSPECT)
        late_s = 0.5 * (period_s - float(np.median(np.diff(samples.time_s))))
        text = (
            f"{name} has a new value every {period_s:.3g} s and repeats it in between, so that it is late by "
            f"{late_s:.2g} s on average"
        )
        remedy = "Record each value once, when it is new; --repair leaves the repeats out"
        start, end = index[samples.rows[[0, -1]]]
        findings.append(Finding(REPEATED, name, start, end, text, remedy, {"period_s": period_s}, certain=True))
    return CheckResult(flags, tuple(findings))


def check_shaft_sign(table: pd.DataFrame) -> CheckResult:
    """Find shafts that count as negative while they drive the ship ahead (``shaft_sign``).

    ``estimate``: the ``agreement`` of the signs of thrust and speed, from -1 to 1: the mean over all means of 20 s
    in which the shaft turns and the ship goes ahead without losing speed, as it does where it stops with thrust
    astern; below -0.8 of a minute and more it is found. A controllable propeller counts by speed and pitch. Azimuth
    thrusters are not checked: they may look aft. Without surge there is no finding.
    """
    findings, index = [], utc_index(table)
    surge = "surge_mps"
    for actuator in table_actuators(table) if surge in table else ():
        names = [
            channel.name for channel in actuator.channels if channel.unit in ("rpm", "%") and channel.name in table
        ]
        if not actuator.drives or actuator.steers_by == "azimuth" or not names:
            continue
        means = table[[*names, surge]].groupby(index.floor(_MEAN_OVER)).mean().dropna()
        means = pd.DataFrame({"thrust": means[names].prod(axis=1), "surge": means[surge]})
        runs_fast = (means.abs() > _UNDER_WAY * means.abs().quantile(0.98)).all(axis=1)
        goes_on = means.index.to_series().diff().shift(-1) == pd.Timedelta(_MEAN_OVER)
        keeps_speed = means["surge"].shift(-1) >= _KEPT_SHARE * means["surge"]
        signs = np.sign(means["thrust"])[runs_fast & (means["surge"] > 0.0) & goes_on & keeps_speed]
        if signs.size < _FEWEST_MEANS or (agreement := float(signs.mean())) > _CLEARLY:
            continue
        text = (
            f"{names[0]} counts astern in {(1.0 - agreement) / 2.0:.0%} of the time in which the ship goes ahead "
            "and keeps its speed: no speed run, acceleration or stop is found by it"
        )
        remedy = "Turn its sign, with scale = -1.0 in the column map, unless it is the surge's that is wrong"
        start, end = index[np.flatnonzero(table[names[0]].notna())[[0, -1]]]
        findings.append(Finding("shaft_sign", names[0], start, end, text, remedy, {"agreement": agreement}))
    return CheckResult(uniform_flags(table), tuple(findings))


def check_exchanged_feedback(table: pd.DataFrame) -> CheckResult:
    """Find two alike actuators whose feedback is exchanged (``feedback_exchanged``).

    One finding a control, under the first one's channel; ``estimate``: the root mean squares of feedback less
    ``own`` and less ``other`` orders, in the channel's unit. Both are flagged suspect. Without orders to both, or
    where these hardly differ, nothing is found.
    """
    flags, findings, index = uniform_flags(table), list[Finding](), utc_index(table)
    alike = [pair for pair in combinations(table_actuators(table), 2) if pair[0].kind == pair[1].kind]
    controls = chain.from_iterable(zip(first.channels, second.channels, strict=True) for first, second in alike)
    for first, second in controls:
        names = first.name, second.name
        orders = tuple(map(ship.order_channel_name, names))
        if not all(name in table and table[name].notna().any() for name in (*names, *orders)):
            continue
        values = _on_common_times(table, (*names, *orders))
        own, other, apart = _differences(values, circular=first.circular)
        if own.size < _PARTS or (apart < _LEAST[first.unit]).any() or (own < _NEARER * other).any():
            continue
        whole = {name: float(np.sqrt(np.mean(part**2))) for name, part in (("own", own), ("other", other))}
        text = (
            f"{names[0]} and {names[1]} follow the orders to each other, to {whole['other']:.3g} {first.unit}; "
            f"from their own they are {whole['own']:.3g} {first.unit} away"
        )
        remedy = "Exchange the two, or the orders, in the configuration or column map; a known order tells which"
        findings.append(Finding("feedback_exchanged", names[0], index[0], index[-1], text, remedy, whole))
        for name in names:
            flags[name] = uniform_flags(table, (name,))[name]
            set_flags(flags, name, series.finite_samples(table, name).rows, Quality.SUSPECT)
    return CheckResult(flags, tuple(findings))


def _on_common_times(table: pd.DataFrame, names: tuple[str, ...]) -> Floats:
    """The two feedbacks and their orders [4, seconds] from where all have begun to the end of a feedback; an order
    holds until the next."""
    samples = [series.finite_samples(table, name) for name in names]
    start = max(each.time_s[0] for each in samples)
    end = min(each.time_s[-1] for each in samples[:2])
    times = np.arange(start, end, _STEP_S)
    return np.array([
        each.value[np.maximum(np.searchsorted(each.time_s, times, side="right") - 1, 0)] for each in samples
    ])  # fmt: skip


def _differences(values: Floats, *, circular: bool) -> tuple[Floats, Floats, Floats]:
    """Root mean squares by part of the time: feedback less own and other orders, and of the orders themselves.

    Each is empty for too short a time.
    """
    first, second, first_order, second_order = values
    if first.size < _FEWEST_COMPARED:
        return np.zeros(0), np.zeros(0), np.zeros(0)

    def rms(*pairs: tuple[Floats, Floats]) -> Floats:
        squares = sum((ship.wrap_180(a - b) if circular else a - b) ** 2 for a, b in pairs)
        return np.array([np.sqrt(part.mean() / len(pairs)) for part in np.array_split(squares, _PARTS)])

    return (
        rms((first, first_order), (second, second_order)),
        rms((first, second_order), (second, first_order)),
        rms((first_order, second_order)),
    )
