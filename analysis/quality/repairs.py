"""From a recording to the table that is asked for: repaired, delays removed, resampled, smoothed, with flags.

The recording is checked once, impossible values left out, and everything follows from the findings: repairs, flags
and delays. The steps come in the order in which each needs the one before; a smoother needs the correct times.

The repairs that are certain each have their number in the table's history. None leans on what a later one corrects:
impossible, stray and repeated values become gaps first; then headings on the circle, then the scales of yaw rate
and speeds, then the heading, which is rebuilt from the yaw rate, then the positions, which are rebuilt from heading
and speeds, then the wind, which needs both too. Orders are independent of these. At last the stamps of delayed
channels are moved, which makes new rows.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import pandas as pd

from seatrial.acquisition.core import errors, files, ship, trial
from seatrial.acquisition.core.quantities import Bools, Floats, integrate
from seatrial.acquisition.recording import reader, writer
from seatrial.analysis.quality import channel_checks, check, wind
from seatrial.analysis.quality.controls import ORDER_INTERPOLATED, hold_orders
from seatrial.analysis.quality.findings import ALL, OTHER_TURN, Finding, Flags
from seatrial.analysis.quality.motion.findings import delays_in_findings
from seatrial.analysis.quality.motion.positions import reconstruct_heading, reconstruct_positions
from seatrial.analysis.series import finite_samples, rows_of_samples, without_repeats
from seatrial.analysis.tables import export, resample
from seatrial.analysis.tables import table as tables

if TYPE_CHECKING:
    from seatrial.analysis.estimation.smoother import SmoothedMotion

FlagsByChannel = Mapping[str, Flags] | pd.DataFrame
Columns = dict[str, Floats]

_LONGEST_HOLE_S = 10.0
_LONGEST_HOLE_WITH_RATE_S = 60.0
_SCALED = {"yaw_rate_scale": ("yaw rate", ("yaw_rate_dps",)),
           "speed_scale": ("surge and sway", ("surge_mps", "sway_mps"))}  # fmt: skip
_HEADING_STAYS = "heading left as it is: the yaw rate is lacking, or scatters too much to mend it"
_EMPTIED = {"out_of_range": "impossible values became gaps", "spike": "stray values became gaps",
            "stuck": "values of a sensor that stood still became gaps"}  # fmt: skip
SMOOTHED_RATE_HZ = 1.0
"""The rate of a smoothed table for which none is given."""


@dataclass(frozen=True, slots=True)
class Repair:
    """One repair that was done: of which finding, in words, and how many values it changed."""

    code: str
    channel: str
    text: str
    changed: int


@dataclass(frozen=True, slots=True)
class RepairResult:
    """A table after its repairs, with a step in its history for each, and the flags of its rows if known."""

    table: pd.DataFrame
    repairs: tuple[Repair, ...]
    flags: pd.DataFrame | None = None


def repair_table(
    table: pd.DataFrame,
    findings: Iterable[Finding],
    flags: FlagsByChannel | None = None,
    recording: reader.Recording | None = None,
    *,
    rebuild_positions: bool | None = False,
) -> RepairResult:
    """Correct what is certain of ``findings``; the given table stays as it is.

    ``flags`` by channel, in the rows of ``table``, say which values of a spike or a stuck stretch become gaps;
    without them these two are left alone. ``recording`` is what the table was read from: angles of the other
    convention, which the table lacks, are brought back from it. ``rebuild_positions`` takes the path that speeds
    and heading give for the positions, None where their time stamps jitter: what jitters in time is found, but
    whether the motion that speeds and yaw rate give is the better truth is for the analyst to say. It is where
    windows of predicted position are to be judged, whose errors would else be the stamps' own.
    Codes that have no repair here are passed over, and so is a repair whose channels are lacking. A channel that is
    certain to be delayed is moved by its delay, and the rows are joined again.
    """
    raw, findings, repairs = table, tuple(findings), list[Repair]()
    impossible = {finding.channel for finding in findings if finding.code == "out_of_range"}
    if rebuild_positions is None:
        rebuild_positions = any(finding.code == "position_time_jitter" for finding in findings)
    sure = [finding for finding in findings if finding.certain]
    if rebuild_positions:  # and the heading that the path leans on, where that jitters
        sure = [
            finding for finding in findings
            if finding.code != "position_time_jitter" and (finding.certain or finding.code == "heading_time_jitter")
        ]  # fmt: skip
        times = tables.utc_index(table)
        sure.append(Finding("position_time_jitter", "north_m", times[0], times[-1], "asked for", certain=True))
    for code, single_repair in REPAIRS.items():
        for finding in [finding for finding in sure if finding.code == code]:
            in_other_unit = code == "yaw_rate_scale" and finding.channel not in impossible
            if recording is not None and (OTHER_TURN in finding.estimate or in_other_unit):
                name, series = finding.channel, recording.series[finding.channel]
                value = table[name].to_numpy(dtype=float, copy=True)
                outside = np.isfinite(series.value) & ~ship.possible_mask(
                    ship.channels_by_name_of(table.attrs)[name], series.value
                )
                value[rows_of_samples(tables.times_ns(table), series.measured_ns)[outside]] = series.value[outside]
                table = table.assign(**{name: value})
            single = single_repair(table, finding, flags if flags is not None else {})
            changed = sum(
                int(_difference_mask(table[name].to_numpy(), new).sum()) for name, new in single.columns.items()
            )
            if code == "out_of_range" and finding.channel in table:  # the reader has made them gaps already
                changed = max(changed, int(finding.estimate.get("count", 0)))
            if changed or single.always_reported:
                repairs.append(Repair(code, finding.channel, single.text, changed))
                table = tables.add_step(
                    table.assign(**single.columns), "repair", code=code, channel=finding.channel, text=single.text,
                    changed=changed, estimate=dict(finding.estimate),
                )  # fmt: skip
            if code == "speed_scale":
                break  # both speeds have one factor, and a finding for each is the same finding
    judged = flags_after_repairs(raw, table, flags) if flags is not None else None
    return _remove_certain_delays(RepairResult(table, tuple(repairs), judged), sure)


def _remove_certain_delays(repaired: RepairResult, certain: Iterable[Finding]) -> RepairResult:
    """The repaired table with the certain delays subtracted from its stamps, and from those of the flags."""
    table = repaired.table
    delay_findings = [
        finding for finding in certain if finding.code == "channel_delay" and finding.channel in table
    ]
    delays = {name: seconds for name, seconds in delays_in_findings(delay_findings, table).items() if name in table}
    if not delays:
        return repaired
    moved, flags = tables.remove_delays(table, delays), repaired.flags
    if flags is not None:
        by_ns = {name: -delay_ns for name, delay_ns in tables.delays_in_ns(delays).items()}
        columns = {f"{name} flag": flags[name].where(flags[name] != trial.Quality.MISSING) for name in flags}
        moved_flags = tables.move_stamps(
            table.assign(**columns), by_ns | {f"{name} flag": delay_ns for name, delay_ns in by_ns.items()}
        )
        flags = moved_flags[[*columns]].fillna(trial.Quality.MISSING).astype(np.uint8).set_axis([*flags], axis=1)
    moves = tuple(
        Repair(
            finding.code,
            finding.channel,
            f"stamps moved by {-finding.estimate['seconds']:+.2f} s",
            int(table[finding.channel].count()),
        )
        for finding in delay_findings
    )
    return RepairResult(moved, (*repaired.repairs, *moves), flags)


def write_repaired(
    recording: reader.Recording,
    table: pd.DataFrame,
    findings: Iterable[Finding],
    path: Path | str,
    flags: FlagsByChannel | None = None,
    *,
    rebuild_positions: bool = False,
) -> RepairResult:
    """Repair ``table``, which is ``recording`` as read, and write it as a new recording at ``path``.

    The trial's metadata are kept; sources of channels that were changed state it; ``flags`` become the samples'
    qualities, suspect where a bad value was replaced. The history stands in the metadata ``history`` and comes
    back with the table. Raw input, events and attachments stay in the original, which is never touched: raises
    :class:`InputError` if ``path`` is the original or no .mcap, :class:`StorageError` if it cannot be written.
    """
    target = Path(path)
    files.require_suffix(target, ".mcap")
    if target.resolve() == recording.path.resolve() or (target.exists() and target.samefile(recording.path)):
        raise errors.InputError(
            "is the recording itself", where=str(target), why="the original is never changed",
            fix="name another file for the repaired recording",
        )  # fmt: skip
    repaired = repair_table(table, findings, flags, recording, rebuild_positions=rebuild_positions)
    changed = {name: not repaired.table[name].dropna().equals(table[name].dropna()) for name in table.columns}
    sources = {
        name: ", ".join(recording.series[name].sources) + (" repaired" if changed[name] else "")
        for name in map(str, table.columns)
    }
    judged = repaired.flags if repaired.flags is not None else pd.DataFrame()
    qualities = {str(name): judged[name].to_numpy(np.uint8) for name in judged}
    writer.write_table(
        repaired.table, target, recording.trial, sources, qualities,
        {tables.HISTORY_KEY: {tables.HISTORY_KEY: json.dumps(tables.history_of(repaired.table))}},
    )  # fmt: skip
    return repaired


def flags_after_repairs(before: pd.DataFrame, after: pd.DataFrame, flags: FlagsByChannel) -> pd.DataFrame:
    """The flags [rows, channels] after repairs: a value in the place of a bad or missing one is suspect, and a
    gap is missing, whatever was there before."""
    qualities = {}
    for name in [name for name in before.columns if name in flags]:
        flag, present = np.array(flags[name], dtype=np.uint8), after[name].notna().to_numpy()
        new = _difference_mask(before[name].to_numpy(), after[name].to_numpy()) & present
        flag[new & (flag >= trial.Quality.BAD)] = trial.Quality.SUSPECT
        flag[~present] = trial.Quality.MISSING
        qualities[str(name)] = flag
    return pd.DataFrame(qualities, index=before.index)


def _difference_mask(first: Floats, second: Floats) -> Bools:
    """Where two columns differ; NaN equals NaN."""
    return np.asarray(~((first == second) | (np.isnan(first) & np.isnan(second))))


class SingleRepair(NamedTuple):
    """What a repair did, in words, and the columns it gives; ``always_reported`` even where no value
    changed."""

    text: str
    columns: Columns
    always_reported: bool = False


_NOTHING = SingleRepair("", {})


def remove_flagged(table: pd.DataFrame, finding: Finding, flags: FlagsByChannel) -> SingleRepair:
    """Replace values within the finding that are flagged bad by gaps; impossible ones need no flag to be known.

    Angles on a line through their seam are bad too, but they can be repaired and are left for that.
    """
    times = tables.utc_index(table)
    within = np.asarray((times >= finding.start) & (times <= finding.end))
    columns = {}
    for name in _channels_of_finding(table, finding):
        value = table[name].to_numpy(dtype=float, copy=True)
        if name in flags:
            bad = within & (np.asarray(flags[name]) == trial.Quality.BAD)
            if channel_checks.is_checked_angle(table, name):
                bad &= ~channel_checks.wrap_interpolation_mask(table, name)
            value[bad] = np.nan
        channel = ship.find_channel(name, ship.channels_by_name_of(table.attrs))
        if finding.code == "out_of_range" and channel is not None:
            value[~ship.possible_mask(channel, value)] = np.nan
        columns[name] = value
    return SingleRepair(_EMPTIED.get(finding.code, "flagged values became gaps"), columns)


def repair_impossible_values(table: pd.DataFrame, finding: Finding, flags: FlagsByChannel) -> SingleRepair:
    """Impossible values turned into the channel's convention where they are angles of the other, else gaps."""
    if OTHER_TURN not in finding.estimate or finding.channel not in table:
        return remove_flagged(table, finding, flags)
    name = finding.channel
    value = table[name].to_numpy(dtype=float, copy=True)
    channel = ship.channels_by_name_of(table.attrs)[name]
    outside = np.isfinite(value) & ~ship.possible_mask(channel, value)
    value[outside] = ship.wrap_to_range(channel, value[outside])
    low = channel.low
    return SingleRepair(f"angles turned into {low:g}..{low + 360.0:g}", {name: value})


def remove_time_outliers(table: pd.DataFrame, finding: Finding, _: FlagsByChannel) -> SingleRepair:
    """Replace values that are stamped years away from the recording proper by gaps."""
    times = tables.times_ns(table)
    first, last = tables.main_stretch(times)
    stray = (times < first) | (times > last)
    columns = {name: table[name].mask(stray).to_numpy(dtype=float) for name in _channels_of_finding(table, finding)}
    return SingleRepair("samples stamped years away became gaps", columns)


def remove_duplicates(table: pd.DataFrame, finding: Finding, _: FlagsByChannel) -> SingleRepair:
    """Gaps where a measured time comes again with the value it had; the row stays, and other values stay."""
    columns = {}
    for name in _channels_of_finding(table, finding):
        value = table[name].to_numpy(dtype=float, copy=True)
        rows = np.flatnonzero(np.isfinite(value))
        samples = pd.DataFrame({"time": tables.times_ns(table)[rows], "value": value[rows]})
        value[rows[samples.duplicated().to_numpy()]] = np.nan
        columns[name] = value
    return SingleRepair("samples that stand twice stand once", columns)


def remove_repeats(table: pd.DataFrame, finding: Finding, _: FlagsByChannel) -> SingleRepair:
    """Gaps where a channel repeats the value of a slower source."""
    name = finding.channel
    if name not in table:
        return _NOTHING
    return SingleRepair(
        "repeats of a slower source became gaps", {name: without_repeats(table, [name])[name].to_numpy()}
    )


def repair_heading_wrap(table: pd.DataFrame, finding: Finding, _: FlagsByChannel) -> SingleRepair:
    """Samples on straight lines through the seam, put between their sound neighbours on the circle.

    A heading takes the shape of its way from the yaw rate: what the integrated rate leaves over between the
    neighbours is shared out linearly. In holes beyond 10 s (60 s with a yaw rate) they become gaps.
    """
    name = finding.channel
    invalid = channel_checks.wrap_interpolation_mask(table, name) if name in table else None
    if invalid is None or not invalid.any():
        return _NOTHING
    value = table[name].to_numpy(dtype=float, copy=True)
    rate = finite_samples(table, "yaw_rate_dps")
    has_rate = name == "heading_deg" and rate.rows.size > 1
    since_s = tables.seconds_of(table)
    path_deg = (
        np.interp(since_s, rate.time_s, integrate(rate.value, rate.time_s)) if has_rate else np.zeros(len(table))
    )
    valid = np.flatnonzero(np.isfinite(value) & ~invalid)
    residual_deg = ship.unwrap(value[valid] - path_deg[valid])
    filled = path_deg + np.interp(since_s, since_s[valid], residual_deg)
    after = np.clip(np.searchsorted(valid, np.flatnonzero(invalid)), 1, valid.size - 1)
    hole_s = since_s[valid[after]] - since_s[valid[after - 1]]
    short = hole_s <= (_LONGEST_HOLE_WITH_RATE_S if has_rate else _LONGEST_HOLE_S)
    value[invalid] = np.where(short, ship.wrap_to_range(ship.BY_NAME[name], filled[invalid]), np.nan)
    return SingleRepair(f"{int(invalid.sum())} samples of {name} put back on the circle", {name: value})


def scale_channels(table: pd.DataFrame, finding: Finding, _: FlagsByChannel) -> SingleRepair:
    """Multiply the yaw rate, or surge and sway, by the factor that was found."""
    factor, (words, names) = float(finding.estimate["factor"]), _SCALED[finding.code]
    columns = {name: table[name].to_numpy(dtype=float) * factor for name in names if name in table}
    return SingleRepair(f"{words} multiplied by {factor:.4f}", columns)


def repair_heading(table: pd.DataFrame, finding: Finding, _: FlagsByChannel) -> SingleRepair:
    """Take the shape of the turns from the yaw rate (:mod:`seatrial.analysis.quality.motion.positions`)."""
    rebuilt = reconstruct_heading(table)
    if rebuilt is None:
        return SingleRepair(_HEADING_STAYS, {}, always_reported=True)
    text = f"heading rebuilt from the integrated yaw rate, tied to the recorded one over {rebuilt.tie_s:.0f} s"
    return SingleRepair(text, rebuilt.columns)


def repair_positions(table: pd.DataFrame, finding: Finding, _: FlagsByChannel) -> SingleRepair:
    """Take positions from the path of speeds and heading (:func:`reconstruct_positions`)."""
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
    direction, speed = wind.true_wind(table, from_bow)
    reading = "the bow" if from_bow else "north"
    columns = {"wind_direction_deg": direction, "wind_speed_mps": speed}
    return SingleRepair(f"true wind worked out of the apparent one, which counted from {reading}", columns)


def repair_orders(table: pd.DataFrame, finding: Finding, _: FlagsByChannel) -> SingleRepair:
    """Hold each order from one event to the next."""
    name = finding.channel
    if name not in table:
        return _NOTHING
    return SingleRepair(f"each order of {name} holds until the next", {name: hold_orders(table, name)})


def _channels_of_finding(table: pd.DataFrame, finding: Finding) -> list[str]:
    """The columns a finding is about: its channel's, or all."""
    names = [str(name) for name in table.columns]
    return names if finding.channel in ("", ALL) else [name for name in names if name == finding.channel]


REPAIRS: dict[str, Callable[[pd.DataFrame, Finding, FlagsByChannel], SingleRepair]] = {
    "time_outlier": remove_time_outliers,
    "out_of_range": repair_impossible_values,
    "spike": remove_flagged,
    "stuck": remove_flagged,
    "duplicate": remove_duplicates,
    channel_checks.REPEATED: remove_repeats,
    channel_checks.WRAP_INTERPOLATED: repair_heading_wrap,
    "yaw_rate_scale": scale_channels,
    "speed_scale": scale_channels,
    "heading_time_jitter": repair_heading,
    "position_time_jitter": repair_positions,
    "wind_apparent": repair_apparent_wind,
    ORDER_INTERPOLATED: repair_orders,
}
"""The single repairs by the code of their finding, in the order in which they are done."""


@dataclass(frozen=True, slots=True)
class Preparation:
    """What is to be done with a recording's samples before they are written as a table.

    Without ``rate_hz`` [Hz] the raw samples stay as they are, unless ``smooth`` asks for a rate.
    """

    rate_hz: float | None = None
    repair: bool = False
    remove_delays: bool = False
    smooth: bool = False
    flags: bool = False


def prepare_table(
    recording: reader.Recording, preparation: Preparation, *, rebuild_positions: bool = False
) -> pd.DataFrame:
    """The recording's table, the steps that were done in its history.

    Smoothed are the motion channels and their rates of change, with a column ``<name>_sigma`` for each
    (:func:`seatrial.analysis.estimation.smoother.smooth`); all others are resampled. ``rebuild_positions``, with
    the repairs, takes the path that speeds and heading give for the positions (:func:`repair_table`).
    Raises :class:`seatrial.acquisition.core.errors.DataShortageError` for a recording without samples,
    :class:`seatrial.acquisition.core.errors.InputError` where smoothing lacks position or heading.
    """
    rate_hz = preparation.rate_hz
    if preparation == Preparation(rate_hz=rate_hz) and rate_hz is not None:
        return resample.resample_recording(recording, rate_hz)  # needs no joined table
    table, flags, delays = tables.table_of(recording), None, dict[str, float]()
    if preparation.repair or preparation.flags or preparation.remove_delays:
        raw, quality = table, check.check_recording(recording, table)
        remaining, flags = list(quality.findings), quality.flags
        if preparation.repair:
            repaired = repair_table(raw, remaining, flags, recording, rebuild_positions=rebuild_positions)
            table, flags = repaired.table, flags if repaired.flags is None else repaired.flags
            remaining = [finding for finding in remaining if not finding.certain]
        if preparation.remove_delays:
            delays = delays_in_findings(remaining, raw)
    result = table
    if preparation.smooth:
        from seatrial.analysis.estimation.smoother import smooth

        rate_hz = rate_hz or SMOOTHED_RATE_HZ
        motion = smooth(tables.remove_delays(table, delays) if delays else table, rate_hz)
        result = replace_motion_by_smoothed(resample.resample(table, rate_hz, delays=delays), motion)
    elif rate_hz is not None:
        result = resample.resample(table, rate_hz, delays=delays)
    elif delays:
        result = tables.remove_delays(table, delays)
    return export.add_flags(result, flags, delays) if preparation.flags and flags is not None else result


def replace_motion_by_smoothed(table: pd.DataFrame, motion: SmoothedMotion) -> pd.DataFrame:
    """A table with motion and its rates of change from the smoother, with the standard deviation of each."""
    states, sigmas = (frame.reindex(table.index) for frame in (motion.states, motion.standard_deviations()))
    result = tables.add_step(table, "smooth", rate_hz=float(table.attrs["rate_hz"]))
    for name in states.columns:
        result[name], result[f"{name}{export.SIGMA_SUFFIX}"] = states[name], sigmas[name]
    return result
