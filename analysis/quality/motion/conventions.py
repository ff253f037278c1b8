"""A recording's heading and speeds held against its track, in every convention that an import compares too.

Speeds that were derived from the heading agree with the positions whatever the heading is, so that comparing them
shows nothing: the drift angle does.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd
import pymap3d

from seatrial.acquisition.core.conventions import (
    ANGLE_UNITS,
    AXES,
    CLOCKWISE,
    HeadingVerdict,
    judge_axes,
    judge_heading,
)
from seatrial.acquisition.core.quantities import Complexes, Floats, scale_to, to_earth
from seatrial.acquisition.tables.evidence import (
    ScaleFit,
    fit,
    grid_of,
    increments,
    integrals,
    is_place,
    means,
    over_gaps,
)
from seatrial.analysis.quality.findings import Finding
from seatrial.analysis.quality.motion.series import GROUPS, Group, group_samples
from seatrial.analysis.tables.table import require, span_of

_REMEDY = "Correct it where it is recorded or imported; nothing else can be told of the motion until then."


def is_derived_from(table: pd.DataFrame, name: str, channels: tuple[str, ...]) -> bool:
    """Whether an import derived a channel from one of others, so that it says nothing of them."""
    return any(
        channel in source.partition(" derived from ")[2]
        for source in table.attrs.get("sources", {}).get(name, ())
        for channel in channels
    )


def heading_finding(table: pd.DataFrame) -> Finding | None:
    """The unit or convention in which the heading agrees with the positions, where that is not ours.

    Raises :class:`InputError` where positions or heading are missing and :class:`DataShortageError` for less than 8
    samples of them.
    """
    table = _with_plane(table)
    require(table, ("north_m", "east_m", "heading_deg"))
    position, heading = (group_samples(table, GROUPS[name]) for name in ("north_m", "heading_deg"))
    grid = grid_of(np.concatenate([position.time_s, heading.time_s]))
    if grid.size < 3:
        return None
    moves = _moves(position, grid)
    moves[over_gaps(heading.time_s, grid)] = np.nan
    recorded = np.rad2deg(heading.levels[:, 0])
    readings = {
        unit: means(heading.time_s, np.unwrap(recorded * _turned(unit), period=360.0) * _after(unit), grid)
        for unit in ANGLE_UNITS
    }
    verdict = judge_heading(moves, readings)
    if not verdict.unit or (verdict.unit == "deg" and verdict.convention in (CLOCKWISE, None)):
        return None
    words = _in_words(verdict, _turns_with(table, moves, grid, readings["deg"]))
    text = f"The track and the heading agree if {words}: {verdict.evidence}"
    estimate = {"drift_spread_deg": verdict.best.spread_deg, "recorded_spread_deg": verdict.recorded.spread_deg}
    return Finding("motion_contradiction", "heading_deg", *span_of(table), text, _REMEDY, estimate)


def _with_plane(table: pd.DataFrame) -> pd.DataFrame:
    """The table with positions in metres where it has geographic ones alone."""
    if "north_m" in table or not {"latitude_deg", "longitude_deg"} <= set(table.columns):
        return table
    latitude, longitude = (table[name].to_numpy(dtype=float) for name in ("latitude_deg", "longitude_deg"))
    located = np.flatnonzero(is_place(latitude, longitude))
    north, east = np.full((2, latitude.size), np.nan)
    if located.size:
        origin = latitude[located[0]], longitude[located[0]], 0.0
        north[located], east[located], _ = pymap3d.geodetic2ned(latitude[located], longitude[located], 0.0, *origin)
    return table.assign(north_m=north, east_m=east)


def _turned(unit: str) -> float:
    """What a unit multiplies an angle by before it is unwrapped: parts of a degree may have been wrapped at 360."""
    return max(scale_to("deg", unit), 1.0)


def _after(unit: str) -> float:
    return min(scale_to("deg", unit), 1.0)


def _moves(position: Group, grid: Floats) -> Complexes:
    """The moves between instants, NaN where the positions have a gap."""
    north, east = (increments(position.time_s, column, grid) for column in position.levels.T)
    return np.where(over_gaps(position.time_s, grid), np.nan, north + 1j * east)


def _turns_with(table: pd.DataFrame, moves: Complexes, grid: Floats, heading_deg: Floats) -> ScaleFit | None:
    """The turns of the heading by the yaw rate, None where that was derived from it or is lacking."""
    if "yaw_rate_dps" not in table or is_derived_from(table, "yaw_rate_dps", ("heading_deg",)):
        return None
    rate = group_samples(table, GROUPS["yaw_rate_dps"])
    turned = integrals(rate.time_s, np.rad2deg(rate.levels[:, 0]), grid)
    return fit(np.diff(heading_deg), 0.5 * (turned[1:] + turned[:-1]))


def _in_words(verdict: HeadingVerdict, turning: ScaleFit | None) -> str:
    """What makes track and heading agree; mirrored positions do too, unless the yaw rate turns with the track."""
    convention = verdict.convention or CLOCKWISE
    sense = "" if convention is CLOCKWISE else f" counts {convention.words}"
    if verdict.unit != "deg":
        return f"the heading is in {ANGLE_UNITS[verdict.unit]}{' and' * bool(sense)}{sense}"
    if turning is not None and turning.is_clear and turning.factor < 0.0:
        return f"the heading{sense}, which the yaw rate confirms"
    return f"the heading{sense}, or as well if the positions are wrong: {convention.mirrored}"


def axes_finding(table: pd.DataFrame) -> Finding | None:
    """Surge and sway that are speeds along north and east; raises as :func:`heading_finding`."""
    require(table, tuple(name for group in ("north_m", "heading_deg", "surge_mps") for name in GROUPS[group]))
    position, heading, speed = (
        group_samples(table, GROUPS[name]) for name in ("north_m", "heading_deg", "surge_mps")
    )
    grid = grid_of(position.time_s)
    if grid.size < 3:
        return None
    ahead, aside = speed.levels.T
    angle = np.interp(speed.time_s, heading.time_s, np.unwrap(heading.levels[:, 0]))
    velocities = {"ship": to_earth(ahead, aside, angle), "north_east": (ahead, aside), "east_north": (aside, ahead)}
    axes, fits = judge_axes(_moves(position, grid), _travelled(speed.time_s, velocities, grid))
    if axes in ("", "ship"):
        return None
    unexplained, as_ship = (float(np.sqrt(fits[name].left)) for name in (axes, "ship"))
    text = (
        f"Surge and sway are speeds {AXES[axes]}: {unexplained:.1%} of the way by the positions is left over by"
        f" them, and {as_ship:.1%} along the ship"
    )
    estimate = {"left": as_ship}
    return Finding("motion_contradiction", "surge_mps", *span_of(table), text, _REMEDY, estimate)


def _travelled(
    time_s: Floats, velocities: Mapping[str, tuple[Floats, Floats]], grid: Floats
) -> dict[str, Complexes]:
    """The moves that velocities to north and east make between instants."""
    return {
        axes: np.asarray(integrals(time_s, north, grid) + 1j * integrals(time_s, east, grid))
        for axes, (north, east) in velocities.items()
    }
