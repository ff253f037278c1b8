"""The repairs that are certain, each with its number in the table's history, and a recording of the repaired table.

They are done in an order that lets none lean on what a later one mends: impossible, stray and repeated values
become gaps first; then headings on the circle, then the scales of yaw rate and speeds, then the heading, which is
rebuilt from the yaw rate, then the positions, which are rebuilt from heading and speeds, then the wind, which needs
both too. Orders stand alone and come last.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from acquisition.angles import unwrap
from acquisition.channels import BY_NAME
from acquisition.errors import InputError
from acquisition.frames import Quality
from acquisition.recording.reader import Recording
from acquisition.recording.tables import write_table
from analysis.files import expect_suffix
from analysis.frames import NANO, times_ns, utc_index
from analysis.history import KEY, history_of, with_step
from analysis.quality import heading_wrap as wrapped
from analysis.quality import orders, rebuilt_path, wind
from analysis.quality.findings import Finding, Flags
from analysis.quality.rebuilt_heading import rebuilt_heading
from analysis.quality.runs import Bools, Floats, integral, samples_of
from analysis.quality.samples import in_turn, possible, rows_of
from analysis.quality.summary import ALL, OTHER_TURN
from analysis.time_span import main_stretch

FlagsByChannel = Mapping[str, Flags] | pd.DataFrame
Columns = dict[str, Floats]

_LONGEST_HOLE_S = 10.0
_LONGEST_HOLE_WITH_RATE_S = 60.0
_SPEED = ("surge_mps", "sway_mps")
_HEADING_STAYS = "heading left as it is: the yaw rate is lacking, or scatters too much to mend it"


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


def repair(
    table: pd.DataFrame,
    findings: Iterable[Finding],
    flags: FlagsByChannel | None = None,
    recording: Recording | None = None,
) -> Repaired:
    """Put right what is certain of ``findings``; the given table stays as it is.

    ``flags`` by channel, in the rows of ``table``, say which values of a spike or a stuck stretch become gaps;
    without them these two are left alone. ``recording`` is what the table was read from: angles of the other
    convention, which the table lacks, are brought back from it. Codes that have no repair here (a delay is taken
    out by resampling, on request) are passed over, and so is a repair whose channels are lacking.
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
        if recording is not None and OTHER_TURN in finding.estimate:
            table = _with_impossible(table, recording, finding.channel)
        text, columns = _REPAIRS[finding.code](table, finding, flags if flags is not None else {})
        changed = _changed(table, columns)
        if finding.code == "out_of_range" and finding.channel in table:
            changed = max(changed, int(finding.estimate.get("count", 0)))  # the reader has made them gaps already
        if not changed and text != _HEADING_STAYS:
            continue
        repairs.append(Repair(finding.code, finding.channel, text, changed))
        table = with_step(
            table.assign(**columns), "repair", code=finding.code, channel=finding.channel, text=text,
            changed=changed, estimate=dict(finding.estimate),
        )  # fmt: skip
    return Repaired(table, tuple(repairs))


def rebuilding_positions(findings: Iterable[Finding], table: pd.DataFrame) -> tuple[Finding, ...]:
    """The findings with the order to rebuild the positions and, where it was found to jitter, the heading that
    their path leans on, for :func:`repair`.

    It is never certain by itself: what jitters in time is found, but whether the motion that speeds and yaw rate
    give is the better truth is for the analyst to say. It is where windows of predicted position are to
    be judged, whose errors would else be the stamps' own.
    """
    others = [
        replace(finding, certain=True) if finding.code == "heading_time_jitter" else finding
        for finding in findings
        if finding.code != "position_time_jitter"
    ]
    times = utc_index(table)
    order = Finding("position_time_jitter", "north_m", times[0], times[-1], "asked for", certain=True)
    return (*others, order)


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
    :class:`InputError` if ``path`` is the original or no .mcap, :class:`StorageError` if it cannot be written.
    """
    target = Path(path)
    expect_suffix(target, ".mcap")
    if target.resolve() == recording.path.resolve() or (target.exists() and target.samefile(recording.path)):
        raise InputError(
            "is the recording itself", where=str(target), why="the original stays as it is",
            fix="name another file for the repaired recording",
        )  # fmt: skip
    repaired = repair(table, findings, flags, recording)
    touched = {
        name: not np.array_equal(repaired.table[name], table[name], equal_nan=True) for name in table.columns
    }
    sources = {
        name: ", ".join(recording.series[name].sources) + (" repaired" if touched[name] else "")
        for name in map(str, table.columns)
    }
    judged = flags_after(table, repaired.table, flags) if flags is not None else pd.DataFrame()
    qualities = {str(name): judged[name].to_numpy(np.uint8) for name in judged}
    write_table(
        repaired.table, target, recording.trial, sources, qualities,
        {KEY: {KEY: json.dumps(history_of(repaired.table))}},
    )  # fmt: skip
    return repaired


def flags_after(before: pd.DataFrame, after: pd.DataFrame, flags: FlagsByChannel) -> pd.DataFrame:
    """The flags [rows, channels] after repairs: a value in the place of a bad or missing one is suspect, and a
    gap is missing, whatever was there before."""
    qualities = {}
    for name in [name for name in before.columns if name in flags]:
        flag, there = np.array(flags[name], dtype=np.uint8), after[name].notna().to_numpy()
        new = ~_same(before[name].to_numpy(), after[name].to_numpy()) & there
        flag[new & (flag >= Quality.BAD)] = Quality.SUSPECT
        flag[~there] = Quality.MISSING
        qualities[str(name)] = flag
    return pd.DataFrame(qualities, index=before.index)


def _changed(table: pd.DataFrame, columns: Columns) -> int:
    return int(sum(np.sum(~_same(table[name].to_numpy(), values)) for name, values in columns.items()))


def _same(first: Floats, second: Floats) -> Bools:
    same: Bools = (first == second) | (np.isnan(first) & np.isnan(second))
    return same


def _channels(table: pd.DataFrame, finding: Finding) -> list[str]:
    """The columns a finding is about: its channel's, or all."""
    every = [str(name) for name in table.columns]
    return every if finding.channel in ("", ALL) else [name for name in every if name == finding.channel]


def without_flagged(table: pd.DataFrame, finding: Finding, flags: FlagsByChannel) -> tuple[str, Columns]:
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
    return _EMPTIED[finding.code], columns


_EMPTIED = {"out_of_range": "impossible values became gaps", "spike": "stray values became gaps",
            "stuck": "values of a sensor that stood still became gaps"}  # fmt: skip


def without_impossible(table: pd.DataFrame, finding: Finding, flags: FlagsByChannel) -> tuple[str, Columns]:
    """Impossible values turned into the channel's convention where they are angles of the other, else gaps."""
    if OTHER_TURN not in finding.estimate or finding.channel not in table:
        return without_flagged(table, finding, flags)
    name = finding.channel
    value = table[name].to_numpy(dtype=float, copy=True)
    outside = np.isfinite(value) & ~possible(name, value)
    value[outside] = in_turn(name, value[outside])
    low = BY_NAME[name].low
    return f"angles turned into {low:g}..{low + 360.0:g}", {name: value}


def _with_impossible(table: pd.DataFrame, recording: Recording, name: str) -> pd.DataFrame:
    """The table with the impossible values of a channel that reading a recording leaves out."""
    series, value = recording.series[name], table[name].to_numpy(dtype=float, copy=True)
    rows = rows_of(times_ns(table), series.measured_ns)
    outside = np.isfinite(series.value) & ~possible(name, series.value)
    value[rows[outside]] = series.value[outside]
    return table.assign(**{name: value})


def without_strays(table: pd.DataFrame, finding: Finding, _: FlagsByChannel) -> tuple[str, Columns]:
    """Gaps where a row is stamped years away from the recording proper."""
    times = times_ns(table)
    first, last = main_stretch(times)
    stray = (times < first) | (times > last)
    columns = {name: table[name].mask(stray).to_numpy(dtype=float) for name in _channels(table, finding)}
    return "samples stamped years away became gaps", columns


def without_repeats(table: pd.DataFrame, finding: Finding, _: FlagsByChannel) -> tuple[str, Columns]:
    """Gaps where a measured time comes again with the value it had; the row stays, and other values stay."""
    columns = {}
    for name in _channels(table, finding):
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
    path_deg = np.interp(since_s, rate.time_s, integral(rate)) if rated else np.zeros(len(table))
    sound = np.flatnonzero(np.isfinite(value) & ~wrong)
    left_deg = unwrap(value[sound] - path_deg[sound])
    filled = path_deg + np.interp(since_s, since_s[sound], left_deg)
    after = np.clip(np.searchsorted(sound, np.flatnonzero(wrong)), 1, sound.size - 1)
    hole_s = since_s[sound[after]] - since_s[sound[after - 1]]
    short = hole_s <= (_LONGEST_HOLE_WITH_RATE_S if rated else _LONGEST_HOLE_S)
    value[wrong] = np.where(short, in_turn(name, filled[wrong]), np.nan)
    return f"{int(wrong.sum())} samples of {name} put back on the circle", {name: value}


def scaled_yaw_rate(table: pd.DataFrame, finding: Finding, _: FlagsByChannel) -> tuple[str, Columns]:
    """The yaw rate times the factor that was found."""
    factor = float(finding.estimate["factor"])
    columns = {name: table[name].to_numpy(dtype=float) * factor for name in ("yaw_rate_dps",) if name in table}
    return f"yaw rate multiplied by {factor:.4f}", columns


def scaled_speeds(table: pd.DataFrame, finding: Finding, _: FlagsByChannel) -> tuple[str, Columns]:
    """Surge and sway times the factor that was found."""
    factor = float(finding.estimate["factor"])
    columns = {name: table[name].to_numpy(dtype=float) * factor for name in _SPEED if name in table}
    return f"surge and sway multiplied by {factor:.4f}", columns


def rebuilt_headings(table: pd.DataFrame, finding: Finding, _: FlagsByChannel) -> tuple[str, Columns]:
    """The shape of the turns from the yaw rate: :func:`analysis.quality.rebuilt_heading.rebuilt_heading`."""
    rebuilt = rebuilt_heading(table)
    if rebuilt is None:
        return _HEADING_STAYS, {}
    text = f"heading rebuilt from the integrated yaw rate, tied to the recorded one over {rebuilt.tie_s:.0f} s"
    return text, {"heading_deg": rebuilt.heading_deg}


def rebuilt_positions(table: pd.DataFrame, finding: Finding, _: FlagsByChannel) -> tuple[str, Columns]:
    """Positions from the path that speeds and heading give: :func:`analysis.quality.rebuilt_path.rebuilt`."""
    rebuilt = rebuilt_path.rebuilt(table)
    if rebuilt is None:
        return "", {}
    tie = f"tied to the recorded ones over {rebuilt.tie_s:.0f} s"
    if not np.isfinite(rebuilt.tie_s):
        tie = "which leave it by whole jumps that do not even out, and tie it by their median alone"
    return f"positions rebuilt from speeds and heading, {tie}", rebuilt.columns


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


_REPAIRS: dict[str, Callable[[pd.DataFrame, Finding, FlagsByChannel], tuple[str, Columns]]] = {
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
_ORDER = tuple(_REPAIRS)
