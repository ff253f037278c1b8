"""Checks of one channel: from its samples in the order of receipt to masks of the same length, or stretches.

Thresholds come from the channel's own noise, rate and habits, so that no ship and no sensor is the standard.
All checks together give the channel its flags, its counts and its grade.

Angles that were resampled as plain numbers lie on straight lines between 360 and 0, or between 180 and -180: a ship
that passes north turns by a degree or two while its heading as a number falls by almost a whole turn, and
interpolation of the numbers draws a line across the circle. Such lines are found from the rate of turn: their ends
agree with it on the circle, and the samples between them do not.

Values that alternate between two levels are those of two sources under one name, read in turn, as of two compasses.
The steps from sample to sample are then of two kinds, far apart in size: those of the one quantity that both
measure, and those from one level to the other, which alternate in sign and hardly differ from each other. Noise,
waves and manoeuvres fill the sizes between; a rudder that is put over and back stays over for some samples; values
that flicker between two neighbouring codes differ by no more than the channel's own step.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal, NamedTuple

import numpy as np
import pandas as pd
from scipy import special

from seatrial.acquisition.core import ship
from seatrial.acquisition.core.quantities import Bools, Floats, Ints, Series
from seatrial.acquisition.core.trial import Quality, iso_utc
from seatrial.analysis import series
from seatrial.analysis.quality import findings, time_checks
from seatrial.analysis.tables import table as tables

WIDEST_SPIKE = 3
_SPIKE_SIZE = 5.0
_SPARSE_S = 0.4  # waves of 3 s have hardly eight samples then
_BLOCK = 64
"""Steps that are judged together: sources that alternate do so within seconds."""
_POSSIBLE_RATE = {("command", "rpm"): 150.0, ("command", "deg"): 30.0, ("command", "%"): 30.0,
                  ("environment", "m/s"): 2.0, ("environment", "deg"): 10.0, ("velocity", "m/s"): 0.3,
                  ("velocity", "deg/s"): 1.0}  # fmt: skip
_POSSIBLE_ACCELERATION = {("pose", "m"): 0.5, ("pose", "deg"): 2.0}
Grade = Literal["good", "suspect", "bad"]
BAD_SHARE, SUSPECT_SHARE, JITTER_SHARE = 0.2, 0.01, 0.15

WRAP_INTERPOLATED = "heading_wrap_interpolated"
_ALWAYS_CHECKED = ("heading_deg", "wind_direction_deg")
_SMALLEST_DEG = 1.0
"""Samples nearer than this to where they belong are left: they do no harm and noise looks like them."""
_LARGEST_DEG = 45.0
"""An angle whose steps scatter so widely (wind in a calm) that the limit would be larger is not judged."""
_LONGEST_STEP = 5.0
"""Steps longer than so many usual ones are holes: what happened there is unknown."""
_FEWEST_AFFECTED = 0.1
_CHANCE = 1e-4
_CONTROL_TURNS_DEG = (73.0, 131.0, 229.0, 287.0)
"""Not halves, thirds or quarters of a turn: samples on the lines crowd there."""

REPEATED = "repeated"
ALTERNATING = "alternating_levels"
_FEWEST_TURNS = 8
_FEWEST_STEPS = 16
_BETWEEN = (0.25, 0.75)
"""Steps of these shares of the distance belong to neither kind."""
_MOST_BETWEEN = 0.02
_EVEN = 0.12
"""The spread of the steps between the levels, as a share of the distance; of waves near half the rate it is 0.3."""
_RETURNS = 0.5
"""The share of turns with an adjacent one: three in four where two sources come at random, none of a
rudder that stays over for three samples."""
_TO_AND_FRO = 0.85
"""The share of steps against the one before: two thirds of white noise."""
_RATES = ("deg/s", "m/s")
_SYMMETRIC = 0.1
"""Levels of a rate or speed that lie about zero, within this share of their distance, are waves at half the rate of
recording: two sources that measure the same rate differ by a constant from something that changes."""
_COARSEST = 20.0
"""Everyday resolutions that the levels are apart at least."""
_HALF_TURN_DEG = 150.0
"""Levels as far apart turn either way, by their noise."""


def find_gaps(samples: Series, start_ns: int | None = None, end_ns: int | None = None) -> list[series.Stretch]:
    """Where the channel is silent for much longer than its own interval; two missing samples are the least.

    Silent is longer than 2.5 intervals, and than 2.5 times what 95 % of the intervals keep, for channels that
    report when something happens. With ``start_ns`` and ``end_ns``, the recording's, also a delayed first sample
    and an early last one, beyond 10 s.
    """
    times = np.sort(samples.measured_ns)
    steps = np.diff(times)
    if not np.any(steps > 0):
        return []
    limit = 2.5 * float(np.quantile(steps[steps > 0], [0.5, 0.95]).max())
    places = np.flatnonzero(steps > limit)
    gaps = [series.Stretch(int(times[at]), int(times[at + 1]), float(steps[at]) / tables.NANO) for at in places]
    for first, last in ((start_ns, int(times[0])), (int(times[-1]), end_ns)):
        if first is not None and last is not None and last - first > max(limit, 10 * tables.NANO):
            gaps.append(series.Stretch(first, last, (last - first) / tables.NANO))
    return sorted(gaps)


def find_spikes(samples: Series, channel: ship.Channel) -> Bools:
    """Where one to three samples leave their neighbours and return.

    What they leave is the line between the samples before and after. Leaving is more than 5 times what 80 % of
    the neighbourhood does (7.8 standard deviations of white noise; waves and manoeuvres raise it themselves; where
    samples are so far apart that a wave is a sample, also 2.5 times what 97 % of the whole record does, since a
    turn into beam seas raises it at once),
    more than the ship or the thruster could do in the time, more than 3 of the channel's own steps, and more
    than twice the steps nearby: around the crest of a wave and a thruster that is moved the steps are large too.
    Returning is that before and after agree, but for the local trend: a step of an order does not return.
    """
    places, times, values = series.sort_by_time(samples, channel)
    bad = np.zeros(samples.value.size, dtype=bool)
    seconds = (times - times[:1]) / tables.NANO
    distinct = np.diff(seconds, prepend=-1.0) > 0
    places, seconds, values = places[distinct], seconds[distinct], values[distinct]
    if values.size < 16:
        return bad
    from scipy.ndimage import median_filter

    steps, step_s = np.diff(values), np.diff(seconds)
    sizes = np.abs(steps)
    smooth: Floats = median_filter(steps / step_s, size=9, mode="nearest")
    slope = np.concatenate([smooth[:1], smooth])
    smallest = float(np.quantile(sizes[sizes > 0], 0.05)) if sizes.any() else 0.0
    # Changes that go on for two steps, but for the thousandth part: no spike does.
    lasting = np.where(steps[1:] * steps[:-1] > 0.0, np.minimum(sizes[1:], sizes[:-1]), 0.0)
    sustained = 2.0 * float(np.quantile(lasting, 0.999))
    group, noise = series.check_group(channel), np.zeros(values.size)
    rate, acceleration = (limits.get(group, 0.0) for limits in (_POSSIBLE_RATE, _POSSIBLE_ACCELERATION))
    for width in range(1, WIDEST_SPIKE + 1):
        usual, leaving, span = _departures_from_chord(seconds, values, slope, width)
        noise = np.maximum(noise, usual)
        possible = rate * span / 2.0 + acceleration * span**2 / 8.0
        limit = np.maximum(_SPIKE_SIZE * noise, np.minimum(sustained, possible))
        starts = np.flatnonzero(leaving > np.maximum(limit, 3.0 * smallest))
        # The scatter nearby: the third largest of four steps before and four after, without the trend.
        nearby = starts[:, None] + np.array([-5, -4, -3, -2, width, width + 1, width + 2, width + 3])
        nearby = np.clip(nearby, 0, values.size - 2)
        scatter = np.sort(np.abs(steps[nearby] - slope[starts, None] * step_s[nearby]), axis=1)[:, -3]
        starts = starts[leaving[starts] > 2.0 * scatter]
        for offset in range(width):
            bad[places[starts + offset]] = True
    return bad


def _departures_from_chord(
    seconds: Floats, values: Floats, slope: Floats, width: int
) -> tuple[Floats, Floats, Floats]:
    """By the first of ``width`` samples: how far such samples usually are to one side of the line from the sample
    before to that after; how far these are where they return, else 0; and the time between these two [s].

    Usual is the quantile of the largest of three blocks of 64 samples. They return where before and after agree
    within half of it, but for the local trend. Where samples are far apart, up to twice the size of a spike is a
    wave if half of it to the other side stands beside it.
    """
    size, step_s = values.size - width - 1, np.median(np.diff(seconds))
    before, after = slice(0, size), slice(width + 1, width + 1 + size)
    span = seconds[after] - seconds[before]
    deviation = np.empty((width, size))
    for offset in range(width):
        inside = slice(1 + offset, 1 + offset + size)
        fraction = (seconds[inside] - seconds[before]) / span
        deviation[offset] = values[inside] - values[before] - fraction * (values[after] - values[before])
    one_side = np.abs(np.sign(deviation).sum(axis=0)) == width
    gapless = span <= 2.0 * (width + 1) * step_s  # across a gap anything may have happened
    least = np.where(one_side & gapless, np.abs(deviation).min(axis=0), 0.0)
    mismatch = np.abs(values[after] - values[before] - slope[1 : 1 + size] * span)
    returning = np.where(mismatch < 0.5 * least, least, 0.0)
    least, leaving, span = (np.pad(part, (1, width)) for part in (least, returning, span))
    blocks, length = max(least.size // _BLOCK, 1), min(_BLOCK, least.size)
    scale = np.quantile(least[: blocks * length].reshape(blocks, length), 0.8 if width == 1 else 0.9, axis=1)
    wide = np.maximum(scale, np.maximum(np.append(scale[1:], scale[-1]), np.insert(scale[:-1], 0, scale[0])))
    usual = np.pad(np.repeat(wide, length), (0, least.size - blocks * length), mode="edge")
    if step_s >= _SPARSE_S:  # a wave is a few samples long, and its crest has a trough beside it
        usual = np.maximum(usual, 0.5 * np.quantile(least, 0.97))
        signed = np.pad(np.sign(deviation[0]), (1, width)) * least
        beside = np.pad(signed, width + 1)
        trough = np.maximum(-np.sign(signed) * beside[: signed.size], -np.sign(signed) * beside[-signed.size :])
        leaving = np.where((trough > 0.5 * least) & (least < 2.0 * _SPIKE_SIZE * usual), 0.0, leaving)
    return usual, leaving, span


@dataclass(frozen=True, slots=True)
class ChannelQuality:
    """One channel in figures. ``gaps`` and ``stuck`` are stretches, the other faults are counted; ``missing`` is
    about how many samples the gaps lack."""

    count: int
    rate_hz: float
    gaps: tuple[series.Stretch, ...]
    stuck: tuple[series.Stretch, ...]
    spikes: int
    out_of_range: int
    duplicates: int
    time_backwards: int
    grade: Grade
    missing: int = 0

    def as_json(self) -> dict[str, Any]:
        """The contract's keys."""
        stretches = {
            name: [
                {"start": iso_utc(stretch.start_ns), "seconds": stretch.seconds} for stretch in getattr(self, name)
            ]
            for name in ("gaps", "stuck")
        }
        return {name: value for name, value in (asdict(self) | stretches).items() if name != "missing"}


@dataclass(frozen=True, slots=True)
class ChannelFaults:
    """What the checks of one channel found, by the code of the finding: ``masks`` over its samples, and ``listed``
    stretches, sized in the unit of the finding.

    ``other_convention`` says that what is out of range is an angle in the other convention.
    """

    channel: ship.Channel
    samples: Series
    masks: dict[str, Bools]
    listed: dict[str, list[series.Stretch]]
    other_convention: bool = False

    def flags(self) -> findings.Flags:
        """The most severe flag of all checks, sample by sample; a value that its decoder flagged bad is bad."""
        flags = np.full(self.samples.value.size, Quality.GOOD, dtype=np.uint8)
        suspect = self.masks["duplicate"] | self.masks["time_backwards"] | self.masks["marked_suspect"]
        flags[suspect] = Quality.SUSPECT
        unknown = np.isnan(tables.valid_values(self.samples))
        flags[self.masks["stuck"] | self.masks["spike"] | self.masks["out_of_range"] | unknown] = Quality.BAD
        return flags

    def stretches(self, code: str) -> list[series.Stretch]:
        """Where the channel has this kind of fault, sized in the unit of the finding: a spike by its distance from
        its neighbours."""
        if code in self.listed:
            return self.listed[code]
        stretches = series.flagged_stretches(self.samples.measured_ns, self.masks[code])
        if code != "spike":
            return stretches
        values, spikes = tables.valid_values(self.samples), []
        for stretch in stretches:
            at = int(np.flatnonzero(self.samples.measured_ns == stretch.start_ns)[0])
            neighbours = values[max(at - 4, 0) : at + 7]
            turns = np.array(
                [self.channel.wrap_angle(deviation) for deviation in neighbours - neighbours[min(at, 4)]]
            )
            turns = np.where(turns > 180.0, turns - 360.0, turns) if self.channel.circular else turns
            spikes.append(replace(stretch, size=abs(float(np.nanmedian(turns)))))
        return spikes

    def quality(self, has_finding: bool, jumps: list[time_checks.ClockJump]) -> ChannelQuality:
        """The channel in figures; ``has_finding`` is whether a finding is about it."""
        times, gaps, flags = self.samples.measured_ns, self.listed["gap"], self.flags()
        span_s = float(times.max() - times.min()) / tables.NANO if times.size else 0.0
        interval = series.median_interval_ns(times) / tables.NANO
        jumped = {(jump.start_ns, jump.end_ns) for jump in jumps}
        silent_s = sum(gap.size for gap in gaps if (gap.start_ns, gap.end_ns) not in jumped)
        missing = round(silent_s / interval) if interval else 0
        kinds, counts = np.unique(flags[flags != Quality.MISSING], return_counts=True)
        return ChannelQuality(
            count=times.size,
            rate_hz=(times.size - 1) / span_s if span_s > 0 else 0.0,
            gaps=tuple(gaps),
            stuck=tuple(self.stretches("stuck")),
            spikes=series.edges_of_runs(self.masks["spike"])[0].size,
            out_of_range=int(self.masks["out_of_range"].sum()),
            duplicates=int(self.masks["duplicate"].sum()),
            time_backwards=len(self.listed["time_backwards"]),
            grade=grade_of(dict(zip(kinds.tolist(), counts.tolist(), strict=True)), missing, has_finding),
            missing=missing,
        )


def find_channel_faults(
    channel: ship.Channel,
    samples: Series,
    rate: tables.TimedValues | None = None,
    bounds_ns: tuple[int, int] | None = None,
    assumed: bool = False,
) -> ChannelFaults:
    """Every check of one channel. Values that the decoder flagged bad may be out of range, and are no others.

    ``rate`` is how fast related channels say that it changes, ``bounds_ns`` the recording's start and end.
    An assumed constant, a state and an order are neither stuck nor quantised, and have no spikes.
    """
    times, steady = samples.measured_ns, assumed or channel.state or ship.is_order_channel(channel.name)
    outside = ~ship.possible_mask(channel, samples.value) & ~np.isnan(samples.value)
    sound = replace(samples, value=np.where(outside, np.nan, tables.valid_values(samples)))
    behind = np.zeros(times.size, dtype=bool)
    behind[1:] = times[1:] < np.maximum.accumulate(times)[:-1]
    steps_back = [
        series.Stretch(int(times[at + 1]), int(times[at]), float(times[at] - times[at + 1]) / tables.NANO)
        for at in np.flatnonzero(np.diff(times) < 0)
    ]
    jitter = time_checks.jitter_s(times)
    jitters = jitter * np.sqrt(2.0) * tables.NANO > JITTER_SHARE * series.median_interval_ns(times)
    masks = {
        "stuck": np.zeros(times.size, dtype=bool) if steady else series.find_stuck(sound, channel, rate),
        "spike": np.zeros(times.size, dtype=bool) if steady else find_spikes(sound, channel),
        "out_of_range": outside,
        "marked_suspect": samples.quality == Quality.SUSPECT,
        "duplicate": pd.Index(times).duplicated(),
        "time_backwards": behind,
    }
    whole_record = {
        "quantised": 0.0 if steady else series.quantisation_step(sound, channel),
        "time_jitter": jitter if jitters else 0.0,
    }
    listed = {"gap": find_gaps(samples, *(bounds_ns or (None, None))), "time_backwards": steps_back}
    for code, size in whole_record.items():
        listed[code] = [series.Stretch(int(times.min()), int(times.max()), size)] if size else []
    return ChannelFaults(channel, samples, masks, listed, ship.is_off_by_whole_turns(channel, samples.value))


def grade_of(flagged: dict[int, int], missing: int, has_finding: bool) -> Grade:
    """Bad if more than 20 % of the samples due are bad or missing; suspect if more than 1 % are not good, or if a
    finding names the channel; else good."""
    expected = sum(flagged.values()) + missing
    lost = flagged.get(Quality.BAD, 0) + missing
    doubtful = lost + flagged.get(Quality.SUSPECT, 0)
    if not expected or lost > BAD_SHARE * expected:
        return "bad"
    return "suspect" if has_finding or doubtful > SUSPECT_SHARE * expected else "good"


def is_checked_angle(table: pd.DataFrame, name: str) -> bool:
    """Whether a channel is an angle that :func:`check_heading_wrap` judges: heading, wind, an actuator's."""
    return name in _ALWAYS_CHECKED or (name in tables.table_controls(table) and ship.is_circular(name))


def check_heading_wrap(table: pd.DataFrame) -> findings.CheckResult:
    """Find angles that were interpolated straight through their seam (``heading_wrap_interpolated``).

    Judges the heading, the wind's direction and the azimuths, one finding a channel; the samples on the
    lines are flagged bad. ``estimate`` says how many ``samples`` on how many ``places``.
    """
    judged = (name for name in (*_ALWAYS_CHECKED, *tables.table_controls(table)) if is_checked_angle(table, name))
    names = tuple(name for name in judged if name in table)
    flags, index, faults = findings.uniform_flags(table, names), tables.utc_index(table), []
    for name in names:
        rows, places = _interpolated_across_seam(table, name)
        findings.set_flags(flags, name, rows, Quality.BAD)
        if places:
            seam = "360 and 0" if ship.BY_NAME[name].low == 0.0 else "180 and -180"
            text = (
                f"{name} was interpolated as a plain number between {seam}: {rows.size} samples in {places} places"
            )
            remedy = "They are put back on the circle between their neighbours by --repair"
            (start, end), estimate = index[rows[[0, -1]]], {"samples": float(rows.size), "places": float(places)}
            faults.append(
                findings.Finding(WRAP_INTERPOLATED, name, start, end, text, remedy, estimate, certain=True)
            )
    return findings.CheckResult(flags, tuple(faults))


def wrap_interpolation_mask(table: pd.DataFrame, name: str) -> Bools:
    """Whether each value of an angle lies on a straight line through its seam: [rows]."""
    wrong = np.zeros(len(table), np.bool_)
    wrong[_interpolated_across_seam(table, name)[0]] = True
    return wrong


def _interpolated_across_seam(table: pd.DataFrame, name: str) -> tuple[Ints, int]:
    """The rows of samples on lines through the seam and the number of places; none where chance explains them.

    A spike that happens to stand where the ship passes north looks the same. It would stand as often where it
    passes east, so the circle is turned, and what is found then is what chance brings; and spikes stand in few
    of the passages, and at other places too. Angles without a measured rate must show three places.
    """
    recorded, channel = series.finite_samples(table, name), ship.BY_NAME[name]
    held = (recorded.value >= channel.low) & (recorded.value <= channel.high)  # a sentinel is no place on a line
    rows, time_s, value = recorded.rows[held], recorded.time_s[held], recorded.value[held]
    nothing = np.zeros(0, np.int64), 0
    if rows.size < 4:
        return nothing
    rate, expected_deg = series.finite_samples(table, "yaw_rate_dps"), np.zeros(rows.size - 1)
    if name == "heading_deg" and rate.rows.size >= 2:
        rate_dps = np.interp(time_s, rate.time_s, rate.value)
        expected_deg = 0.5 * (rate_dps[1:] + rate_dps[:-1]) * np.diff(time_s)
    scatter_deg = series.robust_spread(ship.angle_difference(np.diff(value), expected_deg))
    if 10.0 * scatter_deg > _LARGEST_DEG:
        return nothing
    limit_deg = max(10.0 * scatter_deg, _SMALLEST_DEG)
    from_seam = ship.wrap_360(value - channel.low)
    excursions = _excursions_across_seam(time_s, from_seam, expected_deg, limit_deg)
    # Spikes affect few of the passages, or no more than the excursions elsewhere make likely.
    passages = excursions.affected_passages + excursions.clean_passages
    share = _CHANCE + 3.0 * excursions.elsewhere / excursions.wrong.size
    by_chance = float(special.bdtrc(excursions.affected_passages - 1, passages, min(share, 1.0)))
    could_be_spikes = excursions.affected_passages < _FEWEST_AFFECTED * passages or by_chance > 0.01
    if excursions.places < (1 if name == "heading_deg" else 3) or could_be_spikes:
        return nothing
    control_places = [
        _excursions_across_seam(time_s, ship.wrap_360(from_seam + turn), expected_deg, limit_deg).places
        for turn in _CONTROL_TURNS_DEG
    ]
    return (rows[excursions.wrong], excursions.places) if excursions.places > 3 * max(control_places) else nothing


class _SeamExcursions(NamedTuple):
    """The samples on lines across the circle [n], on how many ``places``, and the evidence for spikes instead."""

    wrong: Bools
    places: int
    affected_passages: int
    clean_passages: int
    elsewhere: int
    """Excursions of the same kind that have nothing to do with the seam."""


def _excursions_across_seam(
    time_s: Floats, from_seam_deg: Floats, expected_deg: Floats, limit_deg: float
) -> _SeamExcursions:
    """Lines across the circle of angles that are counted from the seam.

    Groups of consecutive steps that the rate of turn does not explain are lines where their ends agree with it on
    the circle, samples between them do not, and steps of one sign, two or more, make up a whole turn.
    """
    step_deg = np.diff(from_seam_deg)
    hole = np.diff(time_s) > _LONGEST_STEP * np.median(np.diff(time_s))
    wild = (np.abs(step_deg - expected_deg) > limit_deg) & ~hole
    # Two stray samples may stand level, so that the step between them looks sound.
    wild[1:-1] |= wild[:-2] & wild[2:] & ~hole[1:-1]
    path_deg = np.concatenate([[0.0], np.cumsum(expected_deg)])
    whole_deg = 360.0 - 6.0 * limit_deg
    certain: list[tuple[Ints, Floats]] = []
    swings: list[tuple[Ints, Floats]] = []
    elsewhere = 0
    for first, stop in zip(*series.edges_of_runs(wild), strict=True):
        if stop - first < 2:
            continue
        turned, expected = from_seam_deg[stop] - from_seam_deg[first], path_deg[stop] - path_deg[first]
        turns = round((turned - expected) / 360.0)
        residual_deg = turned - expected - 360.0 * turns
        inside = np.arange(first + 1, stop)
        fraction = (inside - first) / (stop - first)
        due_deg = from_seam_deg[first] + path_deg[inside] - path_deg[first] + fraction * residual_deg
        deviation_deg = np.abs(ship.angle_difference(from_seam_deg[inside], due_deg))
        # A rate of turn that is a few per cent wrong adds its share over a long group.
        closes = abs(residual_deg) < limit_deg * np.sqrt(stop - first) + 0.1 * abs(expected)
        if not (closes and (deviation_deg > 2.0 * limit_deg).any()):
            continue
        ends = from_seam_deg[[first, stop]]
        at_seam = bool((np.minimum(ends, 360.0 - ends) < 3.0 * limit_deg).all())
        starts, lengths = series.runs_of_equal(np.diff(np.sign(step_deg[first:stop])) != 0.0)
        returns = (np.abs(np.add.reduceat(step_deg[first:stop], starts)) > whole_deg) & (lengths >= 2)
        if abs(turns) == 1 or returns.any():
            certain.append((inside, deviation_deg))
        if turns == 0 and at_seam:
            swings.append((inside, deviation_deg))
        elsewhere += turns == 0 and not at_seam
    # Swinging about the seam, samples may go astray twice and come back on the side they left from: no turn
    # is left over. Alone that is a spike near north; beside places that are sure it is one of them.
    wrong = np.zeros(time_s.size, np.bool_)
    for inside, deviation_deg in (*certain, *(swings if len(certain) >= 3 else ())):
        wrong[inside] |= deviation_deg > limit_deg
    passes = (np.abs(step_deg) > whole_deg) & ~wrong[:-1] & ~wrong[1:]
    places = int(series.edges_of_runs(wrong)[0].size)
    return _SeamExcursions(wrong, places, len(certain), int(passes.sum()), elsewhere)


def check_repeats(table: pd.DataFrame) -> findings.CheckResult:
    """Find channels of the motion and angles that repeat the values of a slower source (``repeated``).

    ``estimate``: the time between the source's own values, ``period_s``. Repeats are as late as they are old, and
    flagged suspect.
    """
    angles = [actuator.angle.name for actuator in tables.table_actuators(table) if actuator.angle is not None]
    names = [name for name in (*ship.POSE_AND_VELOCITY, *angles) if name in table]
    flags, faults, index = findings.uniform_flags(table, names), list[findings.Finding](), tables.utc_index(table)
    for name in names:
        samples = series.finite_samples(table, name)
        rows, period_s = series.find_repeats(samples, is_command=name in angles)
        if not rows.size:
            continue
        findings.set_flags(flags, name, rows, Quality.SUSPECT)
        late_s = 0.5 * (period_s - float(np.median(np.diff(samples.time_s))))
        text = (
            f"{name} has a new value every {period_s:.3g} s and repeats it in between, so that it is late by "
            f"{late_s:.2g} s on average"
        )
        remedy = "Record each value once, when it is new; --repair leaves the repeats out"
        start, end = index[samples.rows[[0, -1]]]
        faults.append(
            findings.Finding(REPEATED, name, start, end, text, remedy, {"period_s": period_s}, certain=True)
        )
    return findings.CheckResult(flags, tuple(faults))


@dataclass(frozen=True, slots=True)
class AlternatingLevels:
    """Two levels at the place where they first come in turn, how often they do, and the samples [n] of the channel
    that lie on the upper one (1), the lower one (-1) or in no such part (0)."""

    lower: float
    upper: float
    separation: float
    turns: int
    side: Ints


def find_alternating_levels(samples: Series, channel: ship.Channel) -> AlternatingLevels | None:
    """The two levels that the values of a channel alternate between; None where they do not."""
    places, _, values = series.sort_by_time(samples, channel)
    steps = np.diff(values)
    if steps.size < _FEWEST_STEPS:
        return None
    width = min(_BLOCK, steps.size)
    count = steps.size // width
    blocks = np.concatenate([steps[: count * width], steps[-width:]]).reshape(-1, width)  # the end is judged, too
    firsts = np.append(np.arange(count) * width, steps.size - width)
    separation = np.quantile(np.abs(blocks), 1.0 - 0.5 * _FEWEST_TURNS / _BLOCK, axis=1)
    alternate = _alternating_block_mask(blocks, separation, channel)
    distance = float(np.median(separation[alternate])) if alternate.any() else 0.0
    alternate &= np.abs(separation - distance) < _EVEN * distance
    if not alternate.any():
        return None
    # A ship that lies still shows no values but two: they are no neighbours on a grid that counts from zero unless
    # both are multiples of their distance; where a position's grid counts from is not known.
    if not (np.diff(np.unique(values)) < 0.5 * distance).any():
        from_grid = np.abs(values / distance - np.rint(values / distance))
        if channel.unit == "m" or np.quantile(from_grid, 0.9) < 0.02:
            return None
    # Waves at half the rate of recording, whose size comes and goes, look like two levels while they are largest:
    # then the steps of other blocks go up and down in turn as well, but by less.
    largest = float(np.median(separation[alternate]))
    to_and_fro = np.mean(blocks[:, 1:] * blocks[:, :-1] < 0.0, axis=1) > _TO_AND_FRO
    smaller = (separation > _BETWEEN[0] * largest) & (separation < (1.0 - _EVEN) * largest)
    if (to_and_fro & smaller & ~alternate).any():
        return None
    side = np.zeros(samples.value.size, dtype=np.int64)
    for first in firsts[alternate][::-1]:
        inside = slice(first, first + width + 1)
        part = values[inside]
        turned = np.concatenate([[0], np.cumsum(np.abs(np.diff(part)) > _BETWEEN[1] * distance)]) % 2
        offset = ship.angle_difference(part, part[0]) if channel.circular else part
        odd, even = (np.median(offset[turned == parity]) for parity in (1, 0))
        side[places[inside]] = sides = np.where(turned == (1 if odd > even else 0), 1, -1)
    lower, upper = (channel.wrap_angle(float(np.median(values[inside][sides == level]))) for level in (-1, 1))
    if channel.unit in _RATES and abs(lower + upper) < _SYMMETRIC * distance:
        return None
    turns = np.count_nonzero(np.diff(side[places]) != 0)
    return AlternatingLevels(lower, upper, distance, int(turns), side)


def _alternating_block_mask(blocks: Floats, separation: Floats, channel: ship.Channel) -> Bools:
    """Which blocks of steps [blocks, steps] alternate between two levels that are ``separation`` [blocks] apart."""
    size = np.abs(blocks) / np.maximum(separation, 1e-300)[:, np.newaxis]
    turns = size > _BETWEEN[1]
    enough = turns.sum(axis=1) >= _FEWEST_TURNS
    between = np.mean((size > _BETWEEN[0]) & ~turns, axis=1) <= _MOST_BETWEEN
    spread = np.array([series.robust_spread(row[turn] - np.median(row[turn])) if turn.any() else np.inf
                       for row, turn in zip(size, turns, strict=True)])  # fmt: skip
    balance = np.cumsum(np.sign(blocks) * turns, axis=1)
    either_way = channel.circular & (separation > _HALF_TURN_DEG)
    in_turn = (np.ptp(np.pad(balance, ((0, 0), (1, 0))), axis=1) <= 1.0) | either_way
    neighbours = np.pad(turns, ((0, 0), (1, 1)))
    returning = (turns & (neighbours[:, :-2] | neighbours[:, 2:])).sum(axis=1) >= _RETURNS * turns.sum(axis=1)
    declared = channel.group == "declared"
    resolution = (
        series.EVERYDAY_RESOLUTIONS.get(channel.unit, 0.0) if declared else series.everyday_resolution(channel)
    )
    is_coarse = separation > _COARSEST * resolution
    return np.asarray(enough & between & (spread <= _EVEN) & in_turn & returning & is_coarse)


def alternation_findings(
    recorded: Mapping[str, Series], channels: Mapping[str, ship.Channel]
) -> list[findings.Finding]:
    """A finding for each channel that alternates between two levels, which names both and, if they are known, both
    sources."""
    faults = []
    for name, samples in recorded.items():
        channel = channels[name]
        possible = np.where(ship.possible_mask(channel, samples.value), samples.value, np.nan)
        levels = None if channel.state else find_alternating_levels(replace(samples, value=possible), channel)
        if levels is None:
            continue
        main_sources = []
        for side in (-1, 1):
            index = samples.source_index[levels.side == side]
            labelled = index.size and samples.sources
            main_sources.append(samples.sources[int(np.bincount(index).argmax())] if labelled else "")
        lower, upper = main_sources
        labels = (f" ({lower})", f" ({upper})") if lower and upper and lower != upper else ("", "")
        times = samples.measured_ns[levels.side != 0]
        text = (
            f"{name} alternates between two levels, {levels.lower:.4g}{labels[0]} and {levels.upper:.4g} "
            f"{channel.unit}{labels[1]}, {levels.separation:.3g} {channel.unit} apart, {levels.turns:,} times: "
            f"two sources under one name"
        )
        remedy = "Record or import one of the sources alone; a mean of both is what neither measured"
        estimate = {
            "level": levels.lower, "other_level": levels.upper,
            "apart": levels.separation, "count": float(levels.turns),
        }  # fmt: skip
        ends = findings.utc_timestamp(int(times.min())), findings.utc_timestamp(int(times.max()))
        faults.append(findings.Finding(ALTERNATING, name, *ends, text, remedy, estimate))
    return faults
