"""Checks of one channel: from its samples in the order of receipt to masks of the same length, or stretches.

Thresholds come from the channel's own noise, rate and habits, so that no ship and no sensor is the standard.
All checks together give the channel its flags, its counts and its grade.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any, Literal

import numpy as np
import pandas as pd

from seatrial.acquisition.core.quantities import Bools, Floats, Ints, Series
from seatrial.acquisition.core.ship import Channel, is_order, is_other_convention, is_possible
from seatrial.acquisition.core.trial import Quality, iso
from seatrial.analysis.quality.findings import Flags
from seatrial.analysis.quality.repeated_values import find_stuck, quantisation_step
from seatrial.analysis.quality.samples import Stretch, interval_ns, judged_as, sort_by_time, stretches_of
from seatrial.analysis.quality.time_checks import ClockJump, jitter_s
from seatrial.analysis.tables.table import NANO, TimedValues, valid_values

WIDEST_SPIKE = 3
_SPIKE_SIZE = 5.0
_SPARSE_S = 0.4  # waves of 3 s have hardly eight samples then
_BLOCK = 64
_POSSIBLE_RATE = {("command", "rpm"): 150.0, ("command", "deg"): 30.0, ("command", "%"): 30.0,
                  ("environment", "m/s"): 2.0, ("environment", "deg"): 10.0, ("velocity", "m/s"): 0.3,
                  ("velocity", "deg/s"): 1.0}  # fmt: skip
_POSSIBLE_ACCELERATION = {("pose", "m"): 0.5, ("pose", "deg"): 2.0}


def find_gaps(samples: Series, start_ns: int | None = None, end_ns: int | None = None) -> list[Stretch]:
    """Where the channel is silent for much longer than its own interval; two missing samples are the least.

    Silent is longer than 2.5 intervals, and than 2.5 times what 95 % of the intervals keep, for channels that
    report when something happens. With ``start_ns`` and ``end_ns``, the recording's, also a late first sample
    and an early last one, beyond 10 s.
    """
    times = np.sort(samples.measured_ns)
    steps = np.diff(times)
    if not np.any(steps > 0):
        return []
    limit = 2.5 * float(np.quantile(steps[steps > 0], [0.5, 0.95]).max())
    places = np.flatnonzero(steps > limit)
    gaps = [Stretch(int(times[at]), int(times[at + 1]), float(steps[at]) / NANO) for at in places]
    for first, last in ((start_ns, int(times[0])), (int(times[-1]), end_ns)):
        if first is not None and last is not None and last - first > max(limit, 10 * NANO):
            gaps.append(Stretch(first, last, (last - first) / NANO))
    return sorted(gaps)


def find_out_of_range(samples: Series, channel: Channel) -> Bools:
    """Where the value is impossible by :meth:`Channel.holds`."""
    return ~is_possible(channel, samples.value) & ~np.isnan(samples.value)


def find_duplicates(samples: Series) -> Bools:
    """Where a measured time comes again."""
    return pd.Index(samples.measured_ns).duplicated()


def find_backwards(samples: Series) -> tuple[Bools, list[Stretch]]:
    """Where a sample is measured before one that came earlier; the steps back are listed."""
    times = samples.measured_ns
    behind = np.zeros(times.size, dtype=bool)
    if times.size:
        behind[1:] = times[1:] < np.maximum.accumulate(times)[:-1]
    steps = np.flatnonzero(np.diff(times) < 0)
    steps_back = [
        Stretch(int(times[at + 1]), int(times[at]), float(times[at] - times[at + 1]) / NANO) for at in steps
    ]
    return behind, steps_back


def find_spikes(samples: Series, channel: Channel) -> Bools:
    """Where one to three samples leave their neighbours and return.

    What they leave is the line between the samples before and after. Leaving is more than 5 times what 80 % of
    the neighbourhood does (7.8 standard deviations of white noise; waves and manoeuvres raise it themselves; where
    samples are so far apart that a wave is a sample, also 2.5 times what 97 % of the whole record does, since a
    turn into beam seas raises it at once),
    more than the ship or the thruster could do in the time, more than 3 of the channel's own steps, and more
    than twice the steps just beside: the crest of a wave and a thruster that is stirred are lively there too.
    Returning is that before and after agree, but for the local trend: a step of an order does not return.
    """
    places, times, values = sort_by_time(samples, channel)
    bad = np.zeros(samples.value.size, dtype=bool)
    seconds = (times - times[0]) / NANO if times.size else times.astype(float)
    once = np.concatenate([[True], np.diff(seconds) > 0]) if times.size else np.zeros(0, dtype=bool)
    places, seconds, values = places[once], seconds[once], values[once]
    if values.size >= 16:
        is_spike = np.zeros(values.size, dtype=bool)
        slope, noise, step = _local_slope(seconds, values), np.zeros(values.size), _smallest_step(values)
        sustained = 2.0 * _sustained_step(values)
        sparse = float(np.median(np.diff(seconds))) >= _SPARSE_S
        for width in range(1, WIDEST_SPIKE + 1):
            deviation, leaving, span = _deviation_and_return(seconds, values, slope, width)
            noise = np.maximum(noise, _neighbourhood(deviation, 0.8 if width == 1 else 0.9))
            if sparse:
                noise = np.maximum(noise, 0.5 * np.quantile(deviation, 0.97))
            limit = np.maximum(_SPIKE_SIZE * noise, np.minimum(sustained, _possible(channel, span)))
            starts = np.flatnonzero(leaving > np.maximum(limit, 3.0 * step))
            starts = starts[leaving[starts] > 2.0 * _neighbouring_scatter(seconds, values, slope, starts, width)]
            for offset in range(width):
                is_spike[starts + offset] = True
        bad[places[is_spike]] = True
    return bad


def _smallest_step(values: Floats) -> float:
    steps = np.abs(np.diff(values))
    steps = steps[steps > 0]
    return float(np.quantile(steps, 0.05)) if steps.size else 0.0


def _sustained_step(values: Floats) -> float:
    """The largest change from sample to sample that went on for two, but for the thousandth part: no spike does."""
    steps = np.diff(values)
    both = np.minimum(np.abs(steps[1:]), np.abs(steps[:-1]))
    return float(np.quantile(np.where(steps[1:] * steps[:-1] > 0.0, both, 0.0), 0.999))


def _local_slope(seconds: Floats, values: Floats) -> Floats:
    """The median rate [unit/s] of the nine steps about each sample."""
    from scipy.ndimage import median_filter

    rates = np.diff(values) / np.diff(seconds)
    smooth: Floats = median_filter(rates, size=9, mode="nearest")
    return np.concatenate([smooth[:1], smooth])


def _deviation_and_return(
    seconds: Floats, values: Floats, slope: Floats, width: int
) -> tuple[Floats, Floats, Floats]:
    """By the first of ``width`` samples: how far all of them are to one side of the line from the sample before
    to that after; the same where they return, else 0; and the time between these two [s].

    They return where before and after agree within half of it, but for the local trend.
    """
    size = values.size - width - 1
    before, after = slice(0, size), slice(width + 1, width + 1 + size)
    span = seconds[after] - seconds[before]
    deviation = np.empty((width, size))
    for offset in range(width):
        inside = slice(1 + offset, 1 + offset + size)
        share = (seconds[inside] - seconds[before]) / span
        deviation[offset] = values[inside] - values[before] - share * (values[after] - values[before])
    least = np.abs(deviation).min(axis=0)
    one_side = np.abs(np.sign(deviation).sum(axis=0)) == width
    mismatch = np.abs(values[after] - values[before] - slope[1 : 1 + size] * span)
    together = span <= 2.0 * (width + 1) * np.median(np.diff(seconds))  # across a gap anything may have happened
    least = np.where(one_side & together, least, 0.0)
    edges = (1, width)
    return np.pad(least, edges), np.pad(np.where(mismatch < 0.5 * least, least, 0.0), edges), np.pad(span, edges)


def _neighbouring_scatter(seconds: Floats, values: Floats, slope: Floats, starts: Ints, width: int) -> Floats:
    """The scatter just beside: the third largest of four steps before and four after, without the trend."""
    places = starts[:, None] + np.array([-5, -4, -3, -2, width, width + 1, width + 2, width + 3])
    places = np.clip(places, 0, values.size - 2)
    steps = np.diff(values)[places] - slope[starts, None] * np.diff(seconds)[places]
    return np.sort(np.abs(steps), axis=1)[:, -3]


def _neighbourhood(leaving: Floats, share: float) -> Floats:
    """The quantile at ``share`` of the samples about each one: the largest of three blocks of 64."""
    blocks = max(leaving.size // _BLOCK, 1)
    length = min(_BLOCK, leaving.size)
    scale = np.quantile(leaving[: blocks * length].reshape(blocks, length), share, axis=1)
    wide = np.maximum(scale, np.maximum(np.append(scale[1:], scale[-1]), np.insert(scale[:-1], 0, scale[0])))
    return np.pad(np.repeat(wide, length), (0, leaving.size - blocks * length), mode="edge")


def _possible(channel: Channel, span_s: Floats) -> Floats:
    """How far a ship or a thruster can leave and return within a time: at a rate, or with an acceleration."""
    kind = judged_as(channel)
    acceleration = _POSSIBLE_ACCELERATION.get(kind, 0.0)
    result: Floats = _POSSIBLE_RATE.get(kind, 0.0) * span_s / 2.0 + acceleration * span_s**2 / 8.0
    return result


Grade = Literal["good", "suspect", "bad"]
BAD_SHARE, SUSPECT_SHARE, JITTER_SHARE = 0.2, 0.01, 0.15


@dataclass(frozen=True, slots=True)
class ChannelQuality:
    """One channel in figures. ``gaps`` and ``stuck`` are stretches, the other faults are counted; ``missing`` is
    about how many samples the gaps lack."""

    count: int
    rate_hz: float
    gaps: tuple[Stretch, ...]
    stuck: tuple[Stretch, ...]
    spikes: int
    out_of_range: int
    duplicates: int
    time_backwards: int
    grade: Grade
    missing: int = 0

    def as_json(self) -> dict[str, Any]:
        """The contract's keys."""
        stretches = {
            name: [{"start": iso(stretch.start_ns), "seconds": stretch.seconds} for stretch in getattr(self, name)]
            for name in ("gaps", "stuck")
        }
        return {name: value for name, value in (asdict(self) | stretches).items() if name != "missing"}


@dataclass(frozen=True, slots=True)
class ChannelFaults:
    """What the checks of one channel found, by the code of the finding: ``masks`` over its samples, and ``listed``
    stretches, sized in the unit that the finding speaks of.

    ``other_turn`` says that what is out of range is an angle in the other convention.
    """

    channel: Channel
    samples: Series
    masks: dict[str, Bools]
    listed: dict[str, list[Stretch]]
    other_turn: bool = False

    def flags(self) -> Flags:
        """The graver flag of all checks, sample by sample; a value that its decoder called bad is bad."""
        flags = np.full(self.samples.value.size, Quality.GOOD, dtype=np.uint8)
        flags[self.masks["duplicate"] | self.masks["time_backwards"]] = Quality.SUSPECT
        unknown = np.isnan(valid_values(self.samples))
        flags[self.masks["stuck"] | self.masks["spike"] | self.masks["out_of_range"] | unknown] = Quality.BAD
        return flags

    def stretches(self, code: str) -> list[Stretch]:
        """Where the channel has this kind of trouble, sized in the unit that the finding speaks of."""
        if code in self.listed:
            return self.listed[code]
        stretches = stretches_of(self.samples.measured_ns, self.masks[code])
        return [self._sized(stretch) for stretch in stretches] if code == "spike" else stretches

    def _sized(self, stretch: Stretch) -> Stretch:
        """A spike sized by how far it leaves what is around it [the channel's unit]."""
        at = int(np.flatnonzero(self.samples.measured_ns == stretch.start_ns)[0])
        neighbours = valid_values(self.samples)[max(at - 4, 0) : at + 7]
        turns = np.array([self.channel.wrapped(deviation) for deviation in neighbours - neighbours[min(at, 4)]])
        turns = np.where(turns > 180.0, turns - 360.0, turns) if self.channel.circular else turns
        return Stretch(stretch.start_ns, stretch.end_ns, abs(float(np.nanmedian(turns))))

    def quality(self, named: bool, jumps: list[ClockJump]) -> ChannelQuality:
        """The channel in figures; ``named`` is whether a finding is about it."""
        times, gaps = self.samples.measured_ns, self.listed["gap"]
        span_s = float(times.max() - times.min()) / NANO if times.size else 0.0
        interval = interval_ns(times) / NANO
        jumped = {(jump.start_ns, jump.end_ns) for jump in jumps}
        silent_s = sum(gap.size for gap in gaps if (gap.start_ns, gap.end_ns) not in jumped)
        missing = round(silent_s / interval) if interval else 0
        return ChannelQuality(
            count=times.size,
            rate_hz=(times.size - 1) / span_s if span_s > 0 else 0.0,
            gaps=tuple(gaps),
            stuck=tuple(self.stretches("stuck")),
            spikes=len(self.stretches("spike")),
            out_of_range=int(self.masks["out_of_range"].sum()),
            duplicates=int(self.masks["duplicate"].sum()),
            time_backwards=len(self.listed["time_backwards"]),
            grade=grade_of(count_flags(self.flags()), missing, named),
            missing=missing,
        )


def channel_faults(
    channel: Channel,
    samples: Series,
    rate: TimedValues | None = None,
    bounds_ns: tuple[int, int] | None = None,
    assumed: bool = False,
) -> ChannelFaults:
    """Every check of one channel. Values that the decoder flagged bad may be out of range, and are no others.

    ``rate`` is how fast related channels say that it changes, ``bounds_ns`` the recording's start and end.
    An assumed constant, a state and an order are neither stuck nor quantised, and have no spikes.
    """
    times, steady = samples.measured_ns, assumed or channel.state or is_order(channel.name)
    outside = find_out_of_range(samples, channel)
    sound = replace(samples, value=np.where(outside, np.nan, valid_values(samples)))
    behind, steps_back = find_backwards(samples)
    jitter = jitter_s(times)
    jitters = jitter * np.sqrt(2.0) * NANO > JITTER_SHARE * interval_ns(times)
    masks = {
        "stuck": np.zeros(times.size, dtype=bool) if steady else find_stuck(sound, channel, rate),
        "spike": np.zeros(times.size, dtype=bool) if steady else find_spikes(sound, channel),
        "out_of_range": outside,
        "duplicate": find_duplicates(samples),
        "time_backwards": behind,
    }
    listed = {
        "gap": find_gaps(samples, *(bounds_ns or (None, None))),
        "time_backwards": steps_back,
        "quantised": _whole_record(times, 0.0 if steady else quantisation_step(sound, channel)),
        "time_jitter": _whole_record(times, jitter if jitters else 0.0),
    }
    return ChannelFaults(channel, samples, masks, listed, is_other_convention(channel, samples.value))


def _whole_record(times: Ints, size: float) -> list[Stretch]:
    """All of a channel's time as a stretch of this size; none where there is nothing."""
    return [Stretch(int(times.min()), int(times.max()), size)] if size else []


def count_flags(flags: Flags) -> dict[int, int]:
    """How many samples have each flag; what is missing is none."""
    kinds, counts = np.unique(flags[flags != Quality.MISSING], return_counts=True)
    return {int(kind): int(count) for kind, count in zip(kinds, counts, strict=True)}


def grade_of(flagged: dict[int, int], missing: int, named: bool) -> Grade:
    """Bad if more than 20 % of the samples due are bad or missing; suspect if more than 1 % are not good, or if a
    finding names the channel; else good."""
    due = sum(flagged.values()) + missing
    lost = flagged.get(Quality.BAD, 0) + missing
    doubtful = lost + flagged.get(Quality.SUSPECT, 0)
    if not due or lost > BAD_SHARE * due:
        return "bad"
    return "suspect" if named or doubtful > SUSPECT_SHARE * due else "good"
