"""The repairs that are certain, each with its number in the table's history, and a recording of the repaired table.

They are done in an order that lets none lean on what a later one mends: impossible, stray and repeated values
become gaps first; then the heading, then the scale of the speeds, then the positions, which are rebuilt from
both, then the wind, which needs heading and speeds too. Orders stand alone and come last.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from acquisition.angles import unwrap
from acquisition.channels import BY_NAME
from acquisition.errors import InputError
from acquisition.frames import Quality
from acquisition.recording.reader import Recording
from acquisition.recording.tables import write_table
from analysis.frames import NANO, times_ns, utc_index
from analysis.history import KEY, history_of, with_step
from analysis.quality import heading_wrap as wrapped
from analysis.quality import orders, wind
from analysis.quality.findings import Finding, Flags
from analysis.quality.runs import Bools, Floats, Samples, samples_of

FlagsByChannel = Mapping[str, Flags] | pd.DataFrame
Columns = dict[str, Floats]

_LONGEST_HOLE_S = 10.0
_LONGEST_HOLE_WITH_RATE_S = 60.0
_TIED_OVER = pd.Timedelta(seconds=60)
_POSITION = ("north_m", "east_m")
_SPEED = ("surge_mps", "sway_mps")


@dataclass(frozen=True, slots=True)
class Repair:
    """One repair that was done: of which finding, in words, and how many values it changed."""

    code: str
    channel: str
    text: str
    changed: int


@dataclass(frozen=True, slots=True)
class Repaired:
    """A table after its repairs, with a step in its history for each."""

    table: pd.DataFrame
    repairs: tuple[Repair, ...]


def repair(table: pd.DataFrame, findings: Iterable[Finding], flags: FlagsByChannel | None = None) -> Repaired:
    """Put right what is certain of ``findings``; the given table stays as it is.

    ``flags`` by channel, in the rows of ``table``, say which values of a spike or a stuck stretch become gaps;
    without them these two are left alone. Codes that have no repair here (a delay is taken out by resampling,
    on request) are passed over, and so is a repair whose channels are lacking.
    """
    certain = sorted(
        (finding for finding in findings if finding.certain and finding.code in _REPAIRS),
        key=lambda finding: _ORDER.index(finding.code),
    )
    repairs: list[Repair] = []
    scaled = False
    for finding in certain:
        if finding.code == "speed_scale" and scaled:
            continue  # both speeds have one factor, and a finding for each is the same finding
        scaled = scaled or finding.code == "speed_scale"
        text, columns = _REPAIRS[finding.code](table, finding, flags if flags is not None else {})
        changed = _changed(table, columns)
        if not changed:
            continue
        repairs.append(Repair(finding.code, finding.channel, text, changed))
        table = with_step(
            table.assign(**columns), "repair", code=finding.code, channel=finding.channel, text=text,
            changed=changed, estimate=dict(finding.estimate),
        )  # fmt: skip
    return Repaired(table, tuple(repairs))


def write_repaired(
    recording: Recording,
    table: pd.DataFrame,
    findings: Iterable[Finding],
    path: Path | str,
    flags: FlagsByChannel | None = None,
) -> Repaired:
    """Repair ``table``, which is ``recording`` as read, and write it as a new recording at ``path``.

    The trial's metadata are kept; sources of channels that were changed say so; ``flags`` become the samples'
    qualities, suspect where a bad value was replaced. The history stands in the metadata ``history`` and comes
    back with the table. Raw input, events and attachments stay in the original, which is never touched: raises
    :class:`InputError` if ``path`` is the original, :class:`StorageError` if it cannot be written.
    """
    target = Path(path)
    if target.resolve() == recording.path.resolve() or (target.exists() and target.samefile(recording.path)):
        raise InputError(
            "is the recording itself", where=str(target), why="the original stays as it is",
            fix="name another file for the repaired recording",
        )  # fmt: skip
    repaired = repair(table, findings, flags)
    touched = {
        name: not np.array_equal(repaired.table[name], table[name], equal_nan=True) for name in table.columns
    }
    sources = {
        name: ", ".join(recording.series[name].sources) + (" repaired" if touched[name] else "")
        for name in map(str, table.columns)
    }
    write_table(
        repaired.table, target, recording.trial, sources, _qualities(table, repaired.table, flags),
        {KEY: {KEY: json.dumps(history_of(repaired.table))}},
    )  # fmt: skip
    return repaired


def _qualities(before: pd.DataFrame, after: pd.DataFrame, flags: FlagsByChannel | None) -> dict[str, Flags]:
    """The flags after the repairs: a value in the place of a bad or missing one is suspect."""
    qualities = {}
    for name in before.columns:
        if flags is None or name not in flags:
            continue
        flag = np.array(flags[name], dtype=np.uint8)
        new = ~_same(before[name].to_numpy(), after[name].to_numpy()) & after[name].notna().to_numpy()
        flag[new & (flag >= Quality.BAD)] = Quality.SUSPECT
        qualities[str(name)] = flag
    return qualities


def _changed(table: pd.DataFrame, columns: Columns) -> int:
    return int(sum(np.sum(~_same(table[name].to_numpy(), values)) for name, values in columns.items()))


def _same(first: Floats, second: Floats) -> Bools:
    same: Bools = (first == second) | (np.isnan(first) & np.isnan(second))
    return same


def without_flagged(table: pd.DataFrame, finding: Finding, flags: FlagsByChannel) -> tuple[str, Columns]:
    """Gaps where values within the finding are flagged bad; impossible ones need no flag to be known."""
    name = finding.channel
    if name not in table:
        return "", {}
    value = table[name].to_numpy(dtype=float, copy=True)
    times = utc_index(table)
    within = np.asarray((times >= finding.start) & (times <= finding.end))
    if name in flags:
        value[within & (np.asarray(flags[name]) == Quality.BAD)] = np.nan
    if finding.code == "out_of_range" and name in BY_NAME:
        value[~_possible(name, value)] = np.nan
    return f"{finding.code.replace('_', ' ')}: the values of {name} became gaps", {name: value}


def _possible(name: str, value: Floats) -> Bools:
    """As :meth:`acquisition.channels.Channel.holds`, of many values."""
    channel = BY_NAME[name]
    beyond_low = value > channel.low if channel.circular and channel.low < 0.0 else value >= channel.low
    below_high = value < channel.high if channel.circular and channel.low >= 0.0 else value <= channel.high
    possible: Bools = beyond_low & below_high
    return possible


def without_repeats(table: pd.DataFrame, finding: Finding, _: FlagsByChannel) -> tuple[str, Columns]:
    """Gaps where a measured time comes again with the value it had; the row stays, and other values stay."""
    names = [finding.channel] if finding.channel in table else [str(name) for name in table.columns]
    columns = {}
    for name in names:
        value = table[name].to_numpy(dtype=float, copy=True)
        rows = np.flatnonzero(np.isfinite(value))
        known = pd.DataFrame({"time": times_ns(table)[rows], "value": value[rows]})
        value[rows[known.duplicated().to_numpy()]] = np.nan
        columns[name] = value
    return "samples that stand twice stand once", columns


def on_the_circle(table: pd.DataFrame, finding: Finding, _: FlagsByChannel) -> tuple[str, Columns]:
    """Samples on straight lines through the seam, put between their sound neighbours on the circle.

    A heading takes the shape of its way from the yaw rate: what the integrated rate leaves over between the
    neighbours is shared out linearly. In holes beyond 10 s (60 s with a yaw rate) they become gaps.
    """
    name = finding.channel
    wrong = wrapped.straight_through(table, name) if name in table else np.zeros(len(table), np.bool_)
    if not wrong.any():
        return "", {}
    value = table[name].to_numpy(dtype=float, copy=True)
    rate = samples_of(table, "yaw_rate_dps")
    rated = name == "heading_deg" and rate.rows.size > 1
    since_s = _since_s(table)
    path_deg = np.interp(since_s, rate.time_s, _integral(rate)) if rated else np.zeros(len(table))
    sound = np.flatnonzero(np.isfinite(value) & ~wrong)
    left_deg = unwrap(value[sound] - path_deg[sound])
    filled = path_deg + np.interp(since_s, since_s[sound], left_deg)
    after = np.clip(np.searchsorted(sound, np.flatnonzero(wrong)), 1, sound.size - 1)
    hole_s = since_s[sound[after]] - since_s[sound[after - 1]]
    short = hole_s <= (_LONGEST_HOLE_WITH_RATE_S if rated else _LONGEST_HOLE_S)
    value[wrong] = np.where(short, _in_turn(name, filled[wrong]), np.nan)
    return f"{int(wrong.sum())} samples of {name} put back on the circle", {name: value}


def _in_turn(name: str, angle_deg: Floats) -> Floats:
    low = BY_NAME[name].low
    turned = low + np.mod(angle_deg - low, 360.0)
    return np.where((turned >= low + 360.0) | ((low < 0.0) & (turned == low)), -low, turned)


def scaled_speeds(table: pd.DataFrame, finding: Finding, _: FlagsByChannel) -> tuple[str, Columns]:
    """Surge and sway times the factor that was found."""
    factor = float(finding.estimate["factor"])
    columns = {name: table[name].to_numpy(dtype=float) * factor for name in _SPEED if name in table}
    return f"surge and sway multiplied by {factor:.4f}", columns


def rebuilt_positions(table: pd.DataFrame, finding: Finding, _: FlagsByChannel) -> tuple[str, Columns]:
    """Positions from the path that speeds and heading give, tied to the recorded ones over 60 s.

    A complementary filter: fast motion from the integrated velocity, slow from the positions. What lies between
    the two is passed through a running median, which leaps do not move, and a running mean. Where positions and
    path part for good (a clock that was set, a hole that was interpolated) the two sides are tied each by itself.
    """
    if any(not samples_of(table, name).rows.size for name in (*_POSITION, "heading_deg", *_SPEED)):
        return "", {}
    path_m = _path(table, _since_s(table))
    both = np.flatnonzero(table[list(_POSITION)].notna().all(axis=1))
    off_m = table[list(_POSITION)].to_numpy(dtype=float)[both] - path_m[both]
    side = _sides(off_m)
    tied_m = _tied(off_m, side, utc_index(table)[both])
    columns = {}
    for number, name in enumerate(_POSITION):
        value = table[name].to_numpy(dtype=float, copy=True)
        value[both] = path_m[both, number] + tied_m[:, number]
        columns[name] = value
    return "positions rebuilt from speeds and heading, tied to the recorded ones over 60 s", columns


def _sides(off_m: Floats) -> NDArray[np.intp]:
    """The number of the stretch each position belongs to, between steps far beyond what jitter makes here: [n]."""
    step_m = np.hypot(*np.diff(off_m, axis=0).T)
    leap = step_m > 6.0 * np.quantile(step_m, 0.995) if step_m.size else np.zeros(0, np.bool_)
    return np.concatenate([[0], np.cumsum(leap)])


def _tied(off_m: Floats, side: NDArray[np.intp], times: pd.DatetimeIndex) -> Floats:
    """Running median and mean of the distance between positions and path, on each side by itself: [n, 2]."""
    parts = np.split(np.arange(side.size), np.flatnonzero(np.diff(side)) + 1)
    tied = []
    for part in parts:
        off = pd.DataFrame(off_m[part], index=times[part])
        typical = off.rolling(_TIED_OVER, center=True).median()
        tied.append(typical.rolling(_TIED_OVER, center=True).mean().to_numpy())
    return np.concatenate(tied)


def _path(table: pd.DataFrame, since_s: Floats) -> Floats:
    """North and east of the way that the speeds over ground and the heading give since the start: [rows, 2]."""
    surge, sway = (samples_of(table, name) for name in _SPEED)
    heading = samples_of(table, "heading_deg")
    ahead, aside = (np.interp(since_s, each.time_s, each.value) for each in (surge, sway))
    psi = np.deg2rad(np.interp(since_s, heading.time_s, unwrap(heading.value)))
    north_mps = ahead * np.cos(psi) - aside * np.sin(psi)
    east_mps = ahead * np.sin(psi) + aside * np.cos(psi)
    rows = np.arange(since_s.size)
    return np.column_stack([_integral(Samples(rows, since_s, each)) for each in (north_mps, east_mps)])


def steadiest_wind(table: pd.DataFrame, finding: Finding, _: FlagsByChannel) -> tuple[str, Columns]:
    """The true wind, from a recorded one that is apparent."""
    from_bow = bool(finding.estimate.get("relative_to_bow", 1.0))
    direction, speed = wind.true_wind(table, from_bow)
    reading = "the bow" if from_bow else "north"
    columns = {"wind_direction_deg": direction, "wind_speed_mps": speed}
    return f"true wind worked out of the apparent one, which counted from {reading}", columns


def held(table: pd.DataFrame, finding: Finding, _: FlagsByChannel) -> tuple[str, Columns]:
    """Orders hold from one event to the next."""
    name = finding.channel
    if name not in table:
        return "", {}
    return f"each order of {name} holds until the next", {name: orders.held_orders(table, name)}


def _since_s(table: pd.DataFrame) -> Floats:
    time_ns = times_ns(table)
    return np.asarray((time_ns - time_ns[0]) / NANO)


def _integral(rate: Samples) -> Floats:
    """By the trapezoidal rule, from 0 at the first sample."""
    steps = 0.5 * (rate.value[1:] + rate.value[:-1]) * np.diff(rate.time_s)
    return np.concatenate([[0.0], np.cumsum(steps)])


_REPAIRS: dict[str, Callable[[pd.DataFrame, Finding, FlagsByChannel], tuple[str, Columns]]] = {
    "out_of_range": without_flagged,
    "spike": without_flagged,
    "stuck": without_flagged,
    "duplicate": without_repeats,
    wrapped.CODE: on_the_circle,
    "speed_scale": scaled_speeds,
    "position_time_jitter": rebuilt_positions,
    "wind_apparent": steadiest_wind,
    orders.CODE: held,
}
_ORDER = tuple(_REPAIRS)
