"""Checks of the controls: interpolated orders, frozen, exchanged or per cent feedback, signs of helm and shaft.

Some orders are recorded when they change. A lever that stands still sends nothing; the value it was left at
holds until the next event. Interpolated linearly, the order creeps towards its next value for minutes, which no
drive and no hand does. A measured value never keeps to a straight line to the last digit, so the lines give
themselves away.

Numbers of thrusters and shafts are easily exchanged, in a configuration or a column map, so that feedback is under
the name of the sister. Where both are ordered alike nothing shows; where they are not, each feedback is near the
other's orders all the time.
"""

from __future__ import annotations

from itertools import chain, combinations
from typing import NamedTuple

import numpy as np
import pandas as pd

from seatrial.acquisition.core import ship
from seatrial.acquisition.core.quantities import Floats, Ints
from seatrial.acquisition.core.trial import Quality
from seatrial.analysis import series
from seatrial.analysis.quality.findings import CheckResult, Finding, set_flags, uniform_flags
from seatrial.analysis.tables.table import table_actuators, table_controls, utc_index

ORDER_INTERPOLATED = "order_interpolated"
_STEP_S, _FEWEST_COMPARED, _PARTS = 1.0, 60, 2
_NEARER = 3.0
"""By so many times exchanged feedback is nearer to the other's orders, as a root mean square, in every part."""
_LEAST = {"deg": 2.0, "rpm": 5.0, "%": 2.0}
"""What the orders have to differ by, as a root mean square: less is within what a drive is off anyway."""
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
    interpolated = (value[:-2] * after_s + value[2:] * before_s) / (before_s + after_s)
    scale, span = float(np.abs(value).max()) or 1.0, np.ptp(value)
    exact = (
        decimals for decimals in range(3, 7)
        if 10.0**-decimals < 1e-4 * span and np.all(np.abs(value - np.round(value, decimals)) < 1e-9 * scale)
    )  # fmt: skip
    # How far a value on a line may be off it: twice the file's last decimal, if that is fine, else 1e-9.
    rounding = next((10.0**-decimals for decimals in exact), _ROUNDING * scale)
    slopes = np.abs(value[2:] - value[:-2]) > 8.0 * rounding
    first, stop = series.edges_of_runs((np.abs(value[1:-1] - interpolated) <= rounding) & slopes)
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
        own, other, apart = _rms_differences(values, circular=first.circular)
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


def _rms_differences(values: Floats, *, circular: bool) -> tuple[Floats, Floats, Floats]:
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
