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

from acquisition.core.angles import in_turn, unwrap
from acquisition.core.arrays import Floats
from acquisition.core.channels import BY_NAME
from acquisition.core.frames import Quality
from analysis.kinematics import integrate
from analysis.quality.commands import ORDER_INTERPOLATED as ORDER_INTERPOLATED
from analysis.quality.commands import hold_orders
from analysis.quality.findings import Finding, Flags
from analysis.quality.heading_wrap import WRAP_INTERPOLATED, is_judged, seam_line_mask
from analysis.quality.motion.reconstruction import reconstruct_heading, reconstruct_positions
from analysis.quality.samples import is_possible, samples_of
from analysis.quality.summary import ALL, OTHER_TURN
from analysis.quality.wind import true_wind
from analysis.tables.time_index import main_stretch, seconds_of, times_ns, utc_index

FlagsByChannel = Mapping[str, Flags] | pd.DataFrame
Columns = dict[str, Floats]

_LONGEST_HOLE_S = 10.0
_LONGEST_HOLE_WITH_RATE_S = 60.0
_SPEED = ("surge_mps", "sway_mps")
_HEADING_STAYS = "heading left as it is: the yaw rate is lacking, or scatters too much to mend it"
_EMPTIED = {"out_of_range": "impossible values became gaps", "spike": "stray values became gaps",
            "stuck": "values of a sensor that stood still became gaps"}  # fmt: skip


class SingleRepair(NamedTuple):
    """What a repair did, in words, and the columns it gives; ``told`` if it is reported even where no value
    changed."""

    text: str
    columns: Columns
    told: bool = False


_NOTHING = SingleRepair("", {})


def remove_flagged(table: pd.DataFrame, finding: Finding, flags: FlagsByChannel) -> SingleRepair:
    """Replace values within the finding that are flagged bad by gaps; impossible ones need no flag to be known.

    Angles on a line through their seam are bad too, but they can be mended and are left for that.
    """
    times = utc_index(table)
    within = np.asarray((times >= finding.start) & (times <= finding.end))
    columns = {}
    for name in _channels(table, finding):
        value = table[name].to_numpy(dtype=float, copy=True)
        if name in flags:
            bad = within & (np.asarray(flags[name]) == Quality.BAD)
            value[bad & ~seam_line_mask(table, name) if is_judged(table, name) else bad] = np.nan
        if finding.code == "out_of_range" and name in BY_NAME:
            value[~is_possible(name, value)] = np.nan
        columns[name] = value
    return SingleRepair(_EMPTIED[finding.code], columns)


def repair_impossible(table: pd.DataFrame, finding: Finding, flags: FlagsByChannel) -> SingleRepair:
    """Impossible values turned into the channel's convention where they are angles of the other, else gaps."""
    if OTHER_TURN not in finding.estimate or finding.channel not in table:
        return remove_flagged(table, finding, flags)
    name = finding.channel
    value = table[name].to_numpy(dtype=float, copy=True)
    outside = np.isfinite(value) & ~is_possible(name, value)
    value[outside] = in_turn(name, value[outside])
    low = BY_NAME[name].low
    return SingleRepair(f"angles turned into {low:g}..{low + 360.0:g}", {name: value})


def remove_time_outliers(table: pd.DataFrame, finding: Finding, _: FlagsByChannel) -> SingleRepair:
    """Replace values that are stamped years away from the recording proper by gaps."""
    times = times_ns(table)
    first, last = main_stretch(times)
    stray = (times < first) | (times > last)
    columns = {name: table[name].mask(stray).to_numpy(dtype=float) for name in _channels(table, finding)}
    return SingleRepair("samples stamped years away became gaps", columns)


def remove_duplicates(table: pd.DataFrame, finding: Finding, _: FlagsByChannel) -> SingleRepair:
    """Gaps where a measured time comes again with the value it had; the row stays, and other values stay."""
    columns = {}
    for name in _channels(table, finding):
        value = table[name].to_numpy(dtype=float, copy=True)
        rows = np.flatnonzero(np.isfinite(value))
        known = pd.DataFrame({"time": times_ns(table)[rows], "value": value[rows]})
        value[rows[known.duplicated().to_numpy()]] = np.nan
        columns[name] = value
    return SingleRepair("samples that stand twice stand once", columns)


def repair_heading_wrap(table: pd.DataFrame, finding: Finding, _: FlagsByChannel) -> SingleRepair:
    """Samples on straight lines through the seam, put between their sound neighbours on the circle.

    A heading takes the shape of its way from the yaw rate: what the integrated rate leaves over between the
    neighbours is shared out linearly. In holes beyond 10 s (60 s with a yaw rate) they become gaps.
    """
    name = finding.channel
    wrong = seam_line_mask(table, name) if name in table else np.zeros(len(table), np.bool_)
    if not wrong.any():
        return _NOTHING
    value = table[name].to_numpy(dtype=float, copy=True)
    rate = samples_of(table, "yaw_rate_dps")
    rated = name == "heading_deg" and rate.rows.size > 1
    since_s = seconds_of(table)
    path_deg = (
        np.interp(since_s, rate.time_s, integrate(rate.value, rate.time_s)) if rated else np.zeros(len(table))
    )
    sound = np.flatnonzero(np.isfinite(value) & ~wrong)
    left_deg = unwrap(value[sound] - path_deg[sound])
    filled = path_deg + np.interp(since_s, since_s[sound], left_deg)
    after = np.clip(np.searchsorted(sound, np.flatnonzero(wrong)), 1, sound.size - 1)
    hole_s = since_s[sound[after]] - since_s[sound[after - 1]]
    short = hole_s <= (_LONGEST_HOLE_WITH_RATE_S if rated else _LONGEST_HOLE_S)
    value[wrong] = np.where(short, in_turn(name, filled[wrong]), np.nan)
    return SingleRepair(f"{int(wrong.sum())} samples of {name} put back on the circle", {name: value})


def scale_yaw_rate(table: pd.DataFrame, finding: Finding, _: FlagsByChannel) -> SingleRepair:
    """Multiply the yaw rate by the factor that was found."""
    factor = float(finding.estimate["factor"])
    columns = {name: table[name].to_numpy(dtype=float) * factor for name in ("yaw_rate_dps",) if name in table}
    return SingleRepair(f"yaw rate multiplied by {factor:.4f}", columns)


def scale_speeds(table: pd.DataFrame, finding: Finding, _: FlagsByChannel) -> SingleRepair:
    """Multiply surge and sway by the factor that was found."""
    factor = float(finding.estimate["factor"])
    columns = {name: table[name].to_numpy(dtype=float) * factor for name in _SPEED if name in table}
    return SingleRepair(f"surge and sway multiplied by {factor:.4f}", columns)


def repair_heading(table: pd.DataFrame, finding: Finding, _: FlagsByChannel) -> SingleRepair:
    """Take the shape of the turns from the yaw rate (:mod:`analysis.quality.motion.reconstruction`)."""
    rebuilt = reconstruct_heading(table)
    if rebuilt is None:
        return SingleRepair(_HEADING_STAYS, {}, told=True)
    text = f"heading rebuilt from the integrated yaw rate, tied to the recorded one over {rebuilt.tie_s:.0f} s"
    return SingleRepair(text, {"heading_deg": rebuilt.heading_deg})


def repair_positions(table: pd.DataFrame, finding: Finding, _: FlagsByChannel) -> SingleRepair:
    """Take positions from the path that speeds and heading give (:mod:`analysis.quality.motion.reconstruction`)."""
    rebuilt = reconstruct_positions(table)
    if rebuilt is None:
        return _NOTHING
    tie = f"tied to the recorded ones over {rebuilt.tie_s:.0f} s"
    if not np.isfinite(rebuilt.tie_s):
        tie = "which leave it by whole jumps that do not even out, and tie it by their median alone"
    return SingleRepair(f"positions rebuilt from speeds and heading, {tie}", rebuilt.columns)


def repair_apparent_wind(table: pd.DataFrame, finding: Finding, _: FlagsByChannel) -> SingleRepair:
    """Compute the true wind from a recorded one that is apparent."""
    from_bow = bool(finding.estimate.get("relative_to_bow", 1.0))
    direction, speed = true_wind(table, from_bow)
    reading = "the bow" if from_bow else "north"
    columns = {"wind_direction_deg": direction, "wind_speed_mps": speed}
    return SingleRepair(f"true wind worked out of the apparent one, which counted from {reading}", columns)


def repair_orders(table: pd.DataFrame, finding: Finding, _: FlagsByChannel) -> SingleRepair:
    """Hold each order from one event to the next."""
    name = finding.channel
    if name not in table:
        return _NOTHING
    return SingleRepair(f"each order of {name} holds until the next", {name: hold_orders(table, name)})


def _channels(table: pd.DataFrame, finding: Finding) -> list[str]:
    """The columns a finding is about: its channel's, or all."""
    every = [str(name) for name in table.columns]
    return every if finding.channel in ("", ALL) else [name for name in every if name == finding.channel]


REPAIRS: dict[str, Callable[[pd.DataFrame, Finding, FlagsByChannel], SingleRepair]] = {
    "time_outlier": remove_time_outliers,
    "out_of_range": repair_impossible,
    "spike": remove_flagged,
    "stuck": remove_flagged,
    "duplicate": remove_duplicates,
    WRAP_INTERPOLATED: repair_heading_wrap,
    "yaw_rate_scale": scale_yaw_rate,
    "speed_scale": scale_speeds,
    "heading_time_jitter": repair_heading,
    "position_time_jitter": repair_positions,
    "wind_apparent": repair_apparent_wind,
    ORDER_INTERPOLATED: repair_orders,
}
"""The single repairs by the code of their finding, in the order in which they are done."""
