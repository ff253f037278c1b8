"""Feedback that is dead: the order in its place where it was recorded, else said."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from acquisition.core.actuators import Actuators, name_of_order
from acquisition.core.angles import unwrap, wrap_180
from acquisition.core.arrays import Floats
from analysis.tables.table import NANO, times_ns
from hybrid.simulation.autopilot import Drives, follow, shares
from hybrid.vessel.actuators import KINDS
from hybrid.vessel.actuators.kind import Drive
from hybrid.vessel.parameters import Vessel

_STEP_S = 0.1
_TURNS_DEG = 30.0  # by drift and wind alone a ship hardly turns so far
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
    turned_deg = _reach(table["heading_deg"], circular=True) if "heading_deg" in table else 0.0
    found = []
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
