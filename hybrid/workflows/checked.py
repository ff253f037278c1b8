"""What a check of a recording does for a diagnosis: parts between jumps of the positions, without what is frozen.

A position that jumps is a force beyond any ship to a filter, and a value that stands still while the sensor is gone
is one as well. Each part has a start of its own that nobody knows, so that a jump between them costs nothing.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd

from acquisition.core.angles import unwrap
from acquisition.core.channels import ENVIRONMENT, VELOCITY
from acquisition.core.frames import Quality
from acquisition.recording.reader import Recording, read_recording
from analysis.prepare import checked_table
from analysis.quality.findings import Finding
from analysis.quality.motion.series import GROUPS
from analysis.tables.table import select, table_actuators, table_controls, table_of, utc_index
from hybrid.diagnosis.log import BLOCK_S
from hybrid.effects import Catalogue
from hybrid.effects.environment import STEADY_WIND
from hybrid.workflows.orders import idle_angles

_AROUND = pd.Timedelta(seconds=2.5)
"""Filters and interpolation make a ramp of a jump, and its stamps may be late: so much on either side goes."""
_FROZEN = ("stuck", "feedback_frozen", "position_jump")
_MOST_FROZEN = 0.5
_TURNS_DEG = 30.0  # no ship turns so far at an even surge, sway or yaw rate from the first sample to the last


@dataclass(frozen=True, slots=True)
class Checked:
    """The tables that a diagnosis takes in, and in a sentence each what was left out of the recording."""

    tables: tuple[pd.DataFrame, ...]
    remarks: tuple[str, ...] = ()


def checked_tables(
    recording: Recording,
    part_percent: tuple[float, float] = (0.0, 100.0),
    *,
    repaired: bool = False,
    rebuild_positions: bool = False,
) -> Checked:
    """The raw tables of a recording, or of a part of its time in percent, as its check says that they can be used.

    ``repaired`` puts right before what is certainly wrong, delays too, ``rebuild_positions`` the positions with it.
    """
    table, flags, findings = checked_table(
        recording, table_of(recording), repaired=repaired, rebuild_positions=rebuild_positions
    )
    table, remarks = without_frozen(select(table, part_percent), select(flags, part_percent), findings)
    dead = dead_sensors(table)
    parts, more = between_jumps(table.assign(**dict.fromkeys(dead, np.nan)), findings)
    gone = (f"{name} has one value throughout although the ship turns: it is left out" for name in dead)
    return Checked(parts, (*remarks, *gone, *idle_angles(table, table_actuators(table)), *more))


def usable_tables(
    recordings: Mapping[str, Path],
    part_percent: tuple[float, float] = (0.0, 100.0),
    *,
    repaired: bool = False,
    rebuild_positions: bool = False,
) -> tuple[dict[str, pd.DataFrame], tuple[str, ...]]:
    """One raw table for each recording by name, with a gap where :func:`checked_tables` parts it, and remarks."""
    checked = {
        name: checked_tables(
            read_recording(path), part_percent, repaired=repaired, rebuild_positions=rebuild_positions
        )
        for name, path in recordings.items()
    }
    tables = {name: _joined(each.tables) for name, each in checked.items()}
    return tables, tuple(f"{name}: {remark}" for name, each in checked.items() for remark in each.remarks)


def _joined(parts: Sequence[pd.DataFrame]) -> pd.DataFrame:
    whole = pd.concat(parts)
    whole.attrs = parts[0].attrs
    return whole


def dead_sensors(table: pd.DataFrame) -> tuple[str, ...]:
    """Speeds and yaw rate that have one value throughout although the heading turns: nobody measured them."""
    if "heading_deg" not in table or not table["heading_deg"].notna().any():
        return ()
    turned_deg = float(np.ptp(unwrap(table["heading_deg"].dropna())))
    one_value = (each for each in VELOCITY if each in table and table[each].min() == table[each].max())
    return tuple(one_value) if turned_deg > _TURNS_DEG else ()


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
