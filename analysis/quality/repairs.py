"""The repairs that are certain, each with its number in the table's history, and a recording of the repaired table.

What each of them does is in :mod:`analysis.quality.single_repairs`, in the order in which they are done.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from acquisition.core.arrays import Bools, Floats
from acquisition.core.errors import InputError
from acquisition.core.frames import Quality
from acquisition.recording.reader import Recording
from acquisition.recording.tables import write_table
from analysis.quality.findings import Finding
from analysis.quality.samples import is_possible, rows_of
from analysis.quality.single_repairs import REPAIRS, Columns, FlagsByChannel
from analysis.quality.summary import OTHER_TURN
from analysis.tables.files import expect_suffix
from analysis.tables.provenance import HISTORY_KEY, add_step, history_of
from analysis.tables.time_index import times_ns, utc_index


@dataclass(frozen=True, slots=True)
class Repair:
    """One repair that was done: of which finding, in words, and how many values it changed."""

    code: str
    channel: str
    text: str
    changed: int


@dataclass(frozen=True, slots=True)
class RepairResult:
    """A table after its repairs, with a step in its history for each."""

    table: pd.DataFrame
    repairs: tuple[Repair, ...]


def repair(
    table: pd.DataFrame,
    findings: Iterable[Finding],
    flags: FlagsByChannel | None = None,
    recording: Recording | None = None,
    *,
    rebuild_positions: bool = False,
) -> RepairResult:
    """Put right what is certain of ``findings``; the given table stays as it is.

    ``flags`` by channel, in the rows of ``table``, say which values of a spike or a stuck stretch become gaps;
    without them these two are left alone. ``recording`` is what the table was read from: angles of the other
    convention, which the table lacks, are brought back from it. ``rebuild_positions`` takes the path that speeds
    and heading give for the positions (:func:`rebuilding_positions`). Codes that have no repair here (a delay is
    taken out by resampling, on request) are passed over, and so is a repair whose channels are lacking.
    """
    if rebuild_positions:
        findings = request_position_repair(findings, table)
    order = tuple(REPAIRS)
    certain = sorted(
        (finding for finding in findings if finding.certain and finding.code in REPAIRS),
        key=lambda finding: order.index(finding.code),
    )
    repairs: list[Repair] = []
    scaled = False
    for finding in certain:
        if finding.code == "speed_scale" and scaled:
            continue  # both speeds have one factor, and a finding for each is the same finding
        scaled = scaled or finding.code == "speed_scale"
        if recording is not None and OTHER_TURN in finding.estimate:
            table = _with_impossible(table, recording, finding.channel)
        done = REPAIRS[finding.code](table, finding, flags if flags is not None else {})
        changed = _changed(table, done.columns)
        if finding.code == "out_of_range" and finding.channel in table:
            changed = max(changed, int(finding.estimate.get("count", 0)))  # the reader has made them gaps already
        if not changed and not done.told:
            continue
        repairs.append(Repair(finding.code, finding.channel, done.text, changed))
        table = add_step(
            table.assign(**done.columns), "repair", code=finding.code, channel=finding.channel, text=done.text,
            changed=changed, estimate=dict(finding.estimate),
        )  # fmt: skip
    return RepairResult(table, tuple(repairs))


def request_position_repair(findings: Iterable[Finding], table: pd.DataFrame) -> tuple[Finding, ...]:
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
    *,
    rebuild_positions: bool = False,
) -> RepairResult:
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
    repaired = repair(table, findings, flags, recording, rebuild_positions=rebuild_positions)
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
        {HISTORY_KEY: {HISTORY_KEY: json.dumps(history_of(repaired.table))}},
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


def _with_impossible(table: pd.DataFrame, recording: Recording, name: str) -> pd.DataFrame:
    """The table with the impossible values of a channel that reading a recording leaves out."""
    series, value = recording.series[name], table[name].to_numpy(dtype=float, copy=True)
    rows = rows_of(times_ns(table), series.measured_ns)
    outside = np.isfinite(series.value) & ~is_possible(name, series.value)
    value[rows[outside]] = series.value[outside]
    return table.assign(**{name: value})
