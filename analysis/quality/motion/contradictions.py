"""Motion channels that tell of no one motion, positions that jump, and the units that a gross factor tells of."""

from __future__ import annotations

from dataclasses import dataclass

import pandas as pd

from acquisition.core.frames import Quality
from analysis.quality.findings import Finding
from analysis.quality.motion.coarse import Coarse
from analysis.quality.motion.jumps import PositionJump
from analysis.tables.time_index import NANO, times_ns, utc_index

_MATCHES = 0.005
FACTORS = (0.3, 3.0)
"""Beyond these a factor is put right without asking only where it is a unit's."""


@dataclass(frozen=True, slots=True)
class Unit:
    """A factor that a unit or sign makes, in words; ``sure`` where no other channel could be to blame."""

    factor: float
    words: str
    sure: bool = True


SPEED_UNITS = (
    Unit(1852.0 / 3600.0, "as if knots were taken for m/s"),
    Unit(1.0 / 3.6, "as if km/h were taken for m/s"),
    Unit(3600.0 / 1852.0, "as if m/s had been converted from knots twice"),
    Unit(3.6, "as if m/s had been converted from km/h twice"),
    Unit(1.0 / 0.3048, "as if the positions were in feet", sure=False),
    Unit(0.3048, "as if ft/s were taken for m/s", sure=False),
    Unit(-1.0, "as if surge and sway counted the wrong way, unless the heading is half a turn off", sure=False),
)
YAW_RATE_UNITS = (
    Unit(57.29577951308232, "as if rad/s were taken for deg/s"),
    Unit(1.0 / 60.0, "as if deg/min were taken for deg/s"),
    Unit(60.0, "as if deg/s had been converted from deg/min twice"),
    Unit(1.0 / 57.29577951308232, "as if deg/s had been converted from rad/s twice"),
    Unit(-1.0, "as if it counted positive to port"),
    Unit(-57.29577951308232, "as if rad/s were taken for deg/s, and counted positive to port"),
    Unit(-1.0 / 60.0, "as if deg/min were taken for deg/s, and counted positive to port"),
)


def unit_of(factor: float, units: tuple[Unit, ...], low: float, high: float) -> Unit | None:
    """The unit whose factor is this one, within its interval and half a percent."""
    return next(
        (
            unit
            for unit in units
            if low - abs(_MATCHES * unit.factor) <= unit.factor <= high + abs(_MATCHES * unit.factor)
            and abs(factor / unit.factor - 1.0) < _MATCHES
        ),
        None,
    )


def believable(factor: float, unit: Unit | None) -> bool:
    """Whether a factor may be put right without asking."""
    return unit.sure if unit is not None else FACTORS[0] <= factor <= FACTORS[1]


def contradiction(table: pd.DataFrame, coarse: Coarse) -> Finding:
    """What a coarse fit says contradicts; ``estimate`` has the share of the moves that is left over."""
    index = utc_index(table)
    text = f"Positions, heading and speeds tell of no one motion: {coarse.left:.0%} of the way is left over;"
    return Finding(
        "motion_contradiction", coarse.channel, index.min(), index.max(), f"{text} {coarse.contradiction}",
        "Mend signs and units where the channels are recorded; nothing else can be told of them until then.",
        {"left": coarse.left},
    )  # fmt: skip


def unfitted(table: pd.DataFrame) -> Finding:
    """Of a fit that ran against its bounds."""
    index = utc_index(table)
    return Finding(
        "motion_contradiction", "north_m", index.min(), index.max(),
        "Positions, heading, speeds and yaw rate tell of no one motion, and nothing that was tried explains it",
        "Check signs, units and axes of the motion channels.",
    )  # fmt: skip


def jump_finding(table: pd.DataFrame, jump: PositionJump) -> Finding:
    """A jump in words; it ends where the positions return."""
    index = utc_index(table)
    start = index.min() + pd.Timedelta(round(jump.time_s * NANO), "ns")
    end = index.min() + pd.Timedelta(round(jump.until_s * NANO), "ns") if jump.returns else start
    text = (
        f"The positions jump by {jump.metres:.1f} m ({jump.north_m:+.1f} m north, {jump.east_m:+.1f} m east)"
        f" at {start:%H:%M:%S}"
    )
    after = f" and return after {jump.until_s - jump.time_s:.1f} s" if jump.returns else " and do not return"
    return Finding(
        "position_jump", "north_m", start, end, text + after,
        "Leave out what is displaced." if jump.returns else "Take what lies before and after as two recordings.",
        {"metres": jump.metres, "north_m": jump.north_m, "east_m": jump.east_m},
    )  # fmt: skip


def flag_displaced(flags: pd.DataFrame, table: pd.DataFrame, jumps: tuple[PositionJump, ...]) -> None:
    """Mark positions bad, in place, from a jump until they return."""
    time_s = (times_ns(table) - times_ns(table).min()) / NANO
    for jump in jumps:
        if jump.returns:
            away = (time_s >= jump.time_s - 1e-6) & (time_s < jump.until_s - 1e-6)
            for name in ("north_m", "east_m"):
                flags.loc[away & (flags[name] != Quality.MISSING).to_numpy(), name] = int(Quality.BAD)
