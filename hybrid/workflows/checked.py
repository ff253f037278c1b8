"""What a check of a recording does for a diagnosis: parts between jumps of the positions, without what is frozen.

A position that jumps is a force beyond any ship to a filter, and a value that stands still while the sensor is gone
is one as well. Each part has a start of its own that nobody knows, so that a jump between them costs nothing.
In the place of feedback that is dead comes the order where it was recorded; else it is said.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd

from seatrial.acquisition.core.errors import printable_name
from seatrial.acquisition.core.quantities import Floats
from seatrial.acquisition.core.ship import ENVIRONMENT, VELOCITY, Actuators, name_of_order, unwrap, wrap_180
from seatrial.acquisition.core.trial import Quality
from seatrial.acquisition.recording.grouping import Files, read_recordings, read_together
from seatrial.acquisition.recording.reader import Recording
from seatrial.analysis.quality.check import check_recording
from seatrial.analysis.quality.findings import Finding
from seatrial.analysis.quality.motion.model import GROUPS
from seatrial.analysis.quality.repairs import Repair, repair
from seatrial.analysis.tables.table import (
    NANO,
    select,
    table_actuators,
    table_controls,
    table_of,
    times_ns,
    utc_index,
)
from seatrial.hybrid.diagnosis.log import BLOCK_S, joined
from seatrial.hybrid.effects import Catalogue
from seatrial.hybrid.effects.environment import STEADY_WIND
from seatrial.hybrid.simulation.autopilot import Drives, follow, shares
from seatrial.hybrid.vessel.actuators import KINDS
from seatrial.hybrid.vessel.actuators.kind import Drive
from seatrial.hybrid.vessel.parameters import Vessel

_STEP_S = 0.1
_TURNS_DEG = 30.0  # by drift and wind alone, or at an even surge, sway or yaw rate, a ship hardly turns so far
_AHEAD_DEG = 1.0  # an angle held further from ahead turns the ship by right


def driven_by_orders(
    tables: Sequence[pd.DataFrame], vessel: Vessel
) -> tuple[tuple[pd.DataFrame, ...], tuple[str, ...]]:
    """Raw tables with orders, through the drives of ``vessel``, in the place of dead feedback, and what was done.

    Feedback is dead where it has no values, or one value throughout although the order moves.
    """
    done = [_of_one(table, vessel) for table in tables]
    return tuple(table for table, _ in done), tuple(dict.fromkeys(text for _, said in done for text in said))


def _of_one(table: pd.DataFrame, vessel: Vessel) -> tuple[pd.DataFrame, list[str]]:
    filled, said = dict[str, Floats](), list[str]()
    for each, entry in zip(vessel.actuators, vessel.actuator, strict=True):
        kind = KINDS[each.kind]
        parts = zip(each.channels, kind.drives(entry), kind.units, kind.still, strict=True)
        for channel, drive, unit, still in parts:
            order, how = name_of_order(channel.name), how_it_is_dead(table, channel.name)
            moves = _is_there(table, order) and _reach(table[order]) * unit > still
            if how and (moves or (_is_there(table, order) and not _is_there(table, channel.name))):
                own = Drive(drive.lag_s, drive.limit / unit, drive.rate / unit)
                filled[channel.name] = followed(table, order, own, circular=channel.circular)
                said.append(f"{channel.name} {how}: its order drives the model, with a lag of {drive.lag_s:g} s")
    return (table.assign(**filled) if filled else table), said


def how_it_is_dead(table: pd.DataFrame, name: str) -> str:
    """In words what is wrong with a channel that has no values, or one throughout; empty for any other."""
    if not _is_there(table, name):
        return "has no values"
    return f"stands at {table[name].min():g} throughout" if table[name].min() == table[name].max() else ""


def idle_angles(table: pd.DataFrame, actuators: Actuators) -> tuple[str, ...]:
    """In words the angles that stand still although the ship turns or others like them move: unused, or dead.

    Where their orders were recorded these say it, and :func:`driven_by_orders` takes them.
    """
    angles = {each.angle.name: each.kind for each in actuators if each.angle and each.angle.name in table}
    still = {name for name in angles if _is_there(table, name) and how_it_is_dead(table, name)}
    unknown = {name for name in still if not _is_there(table, name_of_order(name))}
    moving = {kind for name, kind in angles.items() if name not in still}
    turned_deg, found = _turned_deg(table), []
    for name in sorted(unknown):
        ahead = abs(float(table[name].median())) < _AHEAD_DEG
        if angles[name] in moving or (ahead and turned_deg > _TURNS_DEG):
            other = "others like it move" if angles[name] in moving else f"the ship turns by {turned_deg:.0f} deg"
            found.append(
                f"{name} {how_it_is_dead(table, name)} although {other}: taken as recorded; if it was used, what "
                "is named may stand for that"
            )
    return tuple(found)


def _is_there(table: pd.DataFrame, name: str) -> bool:
    return name in table and bool(table[name].notna().any())


def _turned_deg(table: pd.DataFrame) -> float:
    return _reach(table["heading_deg"], circular=True) if "heading_deg" in table else 0.0


def _reach(values: pd.Series, *, circular: bool = False) -> float:
    """From the least of the values to the most, 0 of none."""
    known = values.dropna().to_numpy(dtype=float)
    return float(np.ptp(unwrap(known) if circular else known)) if known.size else 0.0


def followed(table: pd.DataFrame, order: str, drive: Drive, *, circular: bool) -> Floats:
    """What a drive makes of its orders, each held until the next, at the times of a table; NaN before the first.

    ``drive`` has its limits in the channel's unit.
    """
    known, every = table[order].notna().to_numpy(), times_ns(table) / NANO
    times, values = every[known], table[order].to_numpy(dtype=float)[known]
    values = unwrap(values) if circular else values
    grid = np.arange(times[0], every[-1] + _STEP_S, _STEP_S)
    held = values[np.searchsorted(times, grid, side="right") - 1]
    acting = np.interp(every, grid, _driven(held, drive))
    return np.where(every >= times[0], wrap_180(acting) if circular else acting, np.nan)


def _driven(orders: Floats, drive: Drive) -> Floats:
    """What a drive makes of orders, one a step, that begins at the first (:func:`.follow`)."""
    lag_s, limit, rate, helm = (np.array([each]) for each in (drive.lag_s, drive.limit, drive.rate, 0.0))
    drives = Drives(lag_s, limit, rate, helm, damping_s=0.0, settled_radps=0.0)
    share, result = shares(drives, _STEP_S), np.empty_like(orders)
    now = np.clip(orders[:1], -drive.limit, drive.limit)
    for k in range(len(orders)):
        result[k] = now[0]
        follow(drives, share, now, orders[k : k + 1], _STEP_S)
    return result


_AROUND = pd.Timedelta(seconds=2.5)
"""Filters and interpolation make a ramp of a jump, and its stamps may be late: so much on either side goes."""
_FROZEN = ("stuck", "feedback_frozen", "position_jump")
_MOST_FROZEN = 0.5
_FOR_A_NAME = ("speed_scale", "yaw_rate_scale", "channel_delay")
"""Errors of sensors that the catalogue has: a diagnosis names them."""


@dataclass(frozen=True, slots=True)
class Checked:
    """The tables that a diagnosis takes in, and in a sentence each what was left out of the recording and what was
    repaired in it; ``repaired`` says whether scales and delays of sensors were."""

    tables: tuple[pd.DataFrame, ...]
    remarks: tuple[str, ...] = ()
    repairs: tuple[str, ...] = ()
    repaired: bool = False


def checked_tables(
    recording: Recording,
    part_percent: tuple[float, float] = (0.0, 100.0),
    *,
    repaired: bool = False,
    rebuild_positions: bool | None = None,
) -> Checked:
    """The raw tables of a recording, or of a part of its time in percent, as its check says that they can be used.

    Faults of the record that no effect could be (a heading interpolated through north, orders interpolated from
    event to event, spikes) are put right. ``repaired`` has the errors put right as well that a diagnosis would
    name: factors of speeds and yaw rate, delays. ``rebuild_positions`` takes the path that speeds and heading give
    for the positions; ``None`` does so where the check finds that their stamps jitter.
    """
    raw = table_of(recording)
    quality = check_recording(recording, raw)
    findings = quality.findings
    faults = [each for each in findings if repaired or each.code not in _FOR_A_NAME]
    done = repair(raw, faults, quality.flags, recording, rebuild_positions=rebuild_positions)
    flags = quality.flags if done.flags is None else done.flags
    table, remarks = without_frozen(select(done.table, part_percent), select(flags, part_percent), findings)
    dead = dead_sensors(table)
    parts, more = between_jumps(table.assign(**dict.fromkeys(dead, np.nan)), findings)
    gone = (f"{name} has one value throughout although the ship turns: it is left out" for name in dead)
    remarks = (*remarks, *gone, *idle_angles(table, table_actuators(table)), *more)
    return Checked(parts, remarks, tuple(dict.fromkeys(map(_in_words, done.repairs))), repaired)


def checked_files(
    files: Sequence[Path],
    part_percent: tuple[float, float] = (0.0, 100.0),
    *,
    repaired: bool = False,
    rebuild_positions: bool | None = None,
) -> Checked:
    """The tables of all recordings by :func:`checked_tables`; each sentence begins with the name of its file."""
    tables, remarks, repairs = list[pd.DataFrame](), list[str](), list[str]()
    for recording in read_recordings(map(Path, files)):
        found = checked_tables(recording, part_percent, repaired=repaired, rebuild_positions=rebuild_positions)
        tables, name = [*tables, *found.tables], printable_name(recording.path.name)
        remarks += [f"{name}: {remark}" for remark in found.remarks]
        repairs += [f"{name}: {repair}" for repair in found.repairs]
    return Checked(tuple(tables), tuple(remarks), tuple(repairs), repaired)


def _in_words(done: Repair) -> str:
    return done.text if done.channel in done.text else f"{done.channel}: {done.text}"


def usable_tables(
    recordings: Mapping[str, Files],
    part_percent: tuple[float, float] = (0.0, 100.0),
    *,
    repaired: bool = False,
    rebuild_positions: bool | None = None,
) -> tuple[dict[str, pd.DataFrame], tuple[str, ...]]:
    """One raw table for each recording by name, with a gap where :func:`checked_tables` parts it, and remarks."""
    tables, remarks = dict[str, pd.DataFrame](), list[str]()
    for name, files in recordings.items():
        checked = checked_tables(
            read_together(files), part_percent, repaired=repaired, rebuild_positions=rebuild_positions
        )
        tables[name] = joined(checked.tables)
        remarks += [f"{name}: {remark}" for remark in checked.remarks]
    return tables, tuple(remarks)


def dead_sensors(table: pd.DataFrame) -> tuple[str, ...]:
    """Speeds and yaw rate that have one value throughout although the heading turns: nobody measured them."""
    dead = tuple(each for each in VELOCITY if _is_there(table, each) and how_it_is_dead(table, each))
    return dead if _turned_deg(table) > _TURNS_DEG else ()


def without_frozen(
    table: pd.DataFrame, flags: pd.DataFrame, findings: Iterable[Finding]
) -> tuple[pd.DataFrame, tuple[str, ...]]:
    """The table with gaps where a channel stood still or positions were displaced, and what was made so.

    A control that is frozen for most of the time stays: without it nothing is known of what drives the ship.
    """
    kept, remarks = table.copy(), list[str]()
    for finding in (each for each in findings if each.code in _FROZEN):
        for name in filter(flags.__contains__, GROUPS.get(finding.channel, (finding.channel,))):
            bad = (flags[name] == Quality.BAD).to_numpy() & kept[name].notna().to_numpy()
            if name in table_controls(table) and bad.sum() > _MOST_FROZEN * table[name].count():
                remarks.append(f"{name} stands still for most of the time and was taken as recorded")
            elif bad.any():
                kept[name] = kept[name].mask(bad)
                remarks.append(f"{int(bad.sum()):,} values of {name} left out: {finding.text}")
    return kept, tuple(remarks)


def between_jumps(
    table: pd.DataFrame, findings: Iterable[Finding]
) -> tuple[tuple[pd.DataFrame, ...], tuple[str, ...]]:
    """The parts of a table between jumps of the positions that do not return, those of a minute and more; and what
    was parted where."""
    jumps = [each for each in findings if each.code == "position_jump" and each.start == each.end]
    times = utc_index(table)
    inside = [each for each in jumps if times.min() < each.start < times.max()]
    edges = [times.min() - _AROUND, *sorted(each.start for each in inside), times.max() + _AROUND]
    parts = [table[(times >= first + _AROUND) & (times <= last - _AROUND)] for first, last in pairwise(edges)]
    long = tuple(part for part in parts if len(part) and np.ptp(utc_index(part).asi8) >= BLOCK_S * 1e9)
    return long or (table,), tuple(f"parted: {each.text}" for each in inside)


def without_wind(catalogue: Catalogue, tables: Sequence[pd.DataFrame]) -> Catalogue:
    """The catalogue; where a table has no wind, a steady one in the place of the effects of a recorded one."""
    if all(set(ENVIRONMENT) <= set(each) and each[list(ENVIRONMENT)].notna().any().all() for each in tables):
        return catalogue
    kept = {name: effect for name, effect in catalogue.items() if not name.startswith("wind_")}
    return {**kept, STEADY_WIND.name: STEADY_WIND}
