"""The single repairs: what each does to a table, by the code of its finding.

They are done in an order that lets none lean on what a later one mends: impossible, stray and repeated values
become gaps first; then headings on the circle, then the scales of yaw rate and speeds, then the heading, which is
rebuilt from the yaw rate, then the positions, which are rebuilt from heading and speeds, then the wind, which needs
both too. Orders stand alone and come last.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
import pandas as pd

from acquisition.core.angles import unwrap
from acquisition.core.arrays import Floats
from acquisition.core.channels import BY_NAME
from acquisition.core.frames import Quality
from analysis.quality import heading_wrap as wrapped
from analysis.quality import orders, wind
from analysis.quality.findings import Finding, Flags
from analysis.quality.motion.reconstruction import reconstruct_heading, reconstruct_positions
from analysis.quality.runs import integral, samples_of
from analysis.quality.samples import in_turn, possible
from analysis.quality.summary import ALL, OTHER_TURN
from analysis.tables.time_index import NANO, main_stretch, times_ns, utc_index

FlagsByChannel = Mapping[str, Flags] | pd.DataFrame
Columns = dict[str, Floats]

_LONGEST_HOLE_S = 10.0
_LONGEST_HOLE_WITH_RATE_S = 60.0
_SPEED = ("surge_mps", "sway_mps")
_HEADING_STAYS = "heading left as it is: the yaw rate is lacking, or scatters too much to mend it"
_EMPTIED = {"out_of_range": "impossible values became gaps", "spike": "stray values became gaps",
            "stuck": "values of a sensor that stood still became gaps"}  # fmt: skip


class Done(NamedTuple):
    """What a repair did, in words, and the columns it gives; ``told`` if people are to read it even where no value
    changed."""

    text: str
    columns: Columns
    told: bool = False


_NOTHING = Done("", {})


def without_flagged(table: pd.DataFrame, finding: Finding, flags: FlagsByChannel) -> Done:
    """Gaps where values within the finding are flagged bad; impossible ones need no flag to be known.

    Angles on a line through their seam are bad too, but they can be mended and are left for that.
    """
    times = utc_index(table)
    within = np.asarray((times >= finding.start) & (times <= finding.end))
    columns = {}
    for name in _channels(table, finding):
        value = table[name].to_numpy(dtype=float, copy=True)
        if name in flags:
            bad = within & (np.asarray(flags[name]) == Quality.BAD)
            value[bad & ~wrapped.straight_through(table, name) if name in wrapped.JUDGED else bad] = np.nan
        if finding.code == "out_of_range" and name in BY_NAME:
            value[~possible(name, value)] = np.nan
        columns[name] = value
    return Done(_EMPTIED[finding.code], columns)


def without_impossible(table: pd.DataFrame, finding: Finding, flags: FlagsByChannel) -> Done:
    """Impossible values turned into the channel's convention where they are angles of the other, else gaps."""
    if OTHER_TURN not in finding.estimate or finding.channel not in table:
        return without_flagged(table, finding, flags)
    name = finding.channel
    value = table[name].to_numpy(dtype=float, copy=True)
    outside = np.isfinite(value) & ~possible(name, value)
    value[outside] = in_turn(name, value[outside])
    low = BY_NAME[name].low
    return Done(f"angles turned into {low:g}..{low + 360.0:g}", {name: value})


def without_strays(table: pd.DataFrame, finding: Finding, _: FlagsByChannel) -> Done:
    """Gaps where a row is stamped years away from the recording proper."""
    times = times_ns(table)
    first, last = main_stretch(times)
    stray = (times < first) | (times > last)
    columns = {name: table[name].mask(stray).to_numpy(dtype=float) for name in _channels(table, finding)}
    return Done("samples stamped years away became gaps", columns)


def without_repeats(table: pd.DataFrame, finding: Finding, _: FlagsByChannel) -> Done:
    """Gaps where a measured time comes again with the value it had; the row stays, and other values stay."""
    columns = {}
    for name in _channels(table, finding):
        value = table[name].to_numpy(dtype=float, copy=True)
        rows = np.flatnonzero(np.isfinite(value))
        known = pd.DataFrame({"time": times_ns(table)[rows], "value": value[rows]})
        value[rows[known.duplicated().to_numpy()]] = np.nan
        columns[name] = value
    return Done("samples that stand twice stand once", columns)


def on_the_circle(table: pd.DataFrame, finding: Finding, _: FlagsByChannel) -> Done:
    """Samples on straight lines through the seam, put between their sound neighbours on the circle.

    A heading takes the shape of its way from the yaw rate: what the integrated rate leaves over between the
    neighbours is shared out linearly. In holes beyond 10 s (60 s with a yaw rate) they become gaps.
    """
    name = finding.channel
    wrong = wrapped.straight_through(table, name) if name in table else np.zeros(len(table), np.bool_)
    if not wrong.any():
        return _NOTHING
    value = table[name].to_numpy(dtype=float, copy=True)
    rate = samples_of(table, "yaw_rate_dps")
    rated = name == "heading_deg" and rate.rows.size > 1
    since_s = _since_s(table)
    path_deg = np.interp(since_s, rate.time_s, integral(rate)) if rated else np.zeros(len(table))
    sound = np.flatnonzero(np.isfinite(value) & ~wrong)
    left_deg = unwrap(value[sound] - path_deg[sound])
    filled = path_deg + np.interp(since_s, since_s[sound], left_deg)
    after = np.clip(np.searchsorted(sound, np.flatnonzero(wrong)), 1, sound.size - 1)
    hole_s = since_s[sound[after]] - since_s[sound[after - 1]]
    short = hole_s <= (_LONGEST_HOLE_WITH_RATE_S if rated else _LONGEST_HOLE_S)
    value[wrong] = np.where(short, in_turn(name, filled[wrong]), np.nan)
    return Done(f"{int(wrong.sum())} samples of {name} put back on the circle", {name: value})


def scaled_yaw_rate(table: pd.DataFrame, finding: Finding, _: FlagsByChannel) -> Done:
    """The yaw rate times the factor that was found."""
    factor = float(finding.estimate["factor"])
    columns = {name: table[name].to_numpy(dtype=float) * factor for name in ("yaw_rate_dps",) if name in table}
    return Done(f"yaw rate multiplied by {factor:.4f}", columns)


def scaled_speeds(table: pd.DataFrame, finding: Finding, _: FlagsByChannel) -> Done:
    """Surge and sway times the factor that was found."""
    factor = float(finding.estimate["factor"])
    columns = {name: table[name].to_numpy(dtype=float) * factor for name in _SPEED if name in table}
    return Done(f"surge and sway multiplied by {factor:.4f}", columns)


def rebuilt_headings(table: pd.DataFrame, finding: Finding, _: FlagsByChannel) -> Done:
    """The shape of the turns from the yaw rate (:mod:`analysis.quality.motion.reconstruction`)."""
    rebuilt = reconstruct_heading(table)
    if rebuilt is None:
        return Done(_HEADING_STAYS, {}, told=True)
    text = f"heading rebuilt from the integrated yaw rate, tied to the recorded one over {rebuilt.tie_s:.0f} s"
    return Done(text, {"heading_deg": rebuilt.heading_deg})


def rebuilt_positions(table: pd.DataFrame, finding: Finding, _: FlagsByChannel) -> Done:
    """Positions from the path that speeds and heading give (:mod:`analysis.quality.motion.reconstruction`)."""
    rebuilt = reconstruct_positions(table)
    if rebuilt is None:
        return _NOTHING
    tie = f"tied to the recorded ones over {rebuilt.tie_s:.0f} s"
    if not np.isfinite(rebuilt.tie_s):
        tie = "which leave it by whole jumps that do not even out, and tie it by their median alone"
    return Done(f"positions rebuilt from speeds and heading, {tie}", rebuilt.columns)


def steadiest_wind(table: pd.DataFrame, finding: Finding, _: FlagsByChannel) -> Done:
    """The true wind, from a recorded one that is apparent."""
    from_bow = bool(finding.estimate.get("relative_to_bow", 1.0))
    direction, speed = wind.true_wind(table, from_bow)
    reading = "the bow" if from_bow else "north"
    columns = {"wind_direction_deg": direction, "wind_speed_mps": speed}
    return Done(f"true wind worked out of the apparent one, which counted from {reading}", columns)


def held(table: pd.DataFrame, finding: Finding, _: FlagsByChannel) -> Done:
    """Orders hold from one event to the next."""
    name = finding.channel
    if name not in table:
        return _NOTHING
    return Done(f"each order of {name} holds until the next", {name: orders.held_orders(table, name)})


def _channels(table: pd.DataFrame, finding: Finding) -> list[str]:
    """The columns a finding is about: its channel's, or all."""
    every = [str(name) for name in table.columns]
    return every if finding.channel in ("", ALL) else [name for name in every if name == finding.channel]


def _since_s(table: pd.DataFrame) -> Floats:
    time_ns = times_ns(table)
    return np.asarray((time_ns - time_ns[0]) / NANO)


REPAIRS: dict[str, Callable[[pd.DataFrame, Finding, FlagsByChannel], Done]] = {
    "time_outlier": without_strays,
    "out_of_range": without_impossible,
    "spike": without_flagged,
    "stuck": without_flagged,
    "duplicate": without_repeats,
    wrapped.CODE: on_the_circle,
    "yaw_rate_scale": scaled_yaw_rate,
    "speed_scale": scaled_speeds,
    "heading_time_jitter": rebuilt_headings,
    "position_time_jitter": rebuilt_positions,
    "wind_apparent": steadiest_wind,
    orders.CODE: held,
}
"""The single repairs by the code of their finding, in the order in which they are done."""
