"""Small questions to a smooth motion: when a level is crossed, where a curve peaks, how far the ship went."""

from __future__ import annotations

import numpy as np

from acquisition.core.angles import wrap_360
from acquisition.core.arrays import Floats
from analysis.manoeuvres.motion import Motion
from analysis.manoeuvres.segments import Plateau

APPROACH_S = 10.0


def level_before(motion: Motion, command: Floats, plateau: Plateau, seconds: float = 4.0) -> float:
    """The level a command had shortly before it went to a plateau: the median of ``seconds`` before the change.

    The change itself is where the command is nearer to the plateau than to where it was before.
    """
    rows = round(seconds / motion.step_s)
    first = motion.row_before(plateau.first, 4.0 * seconds)
    ahead = command[first : plateau.first + 1]
    start = float(np.median(ahead[: max(rows, 1)]))
    share = (ahead - start) / (plateau.level - start) if plateau.level != start else np.zeros(ahead.size)
    under = np.flatnonzero(share < 0.2)
    end = int(under[-1]) + 1 if under.size else 1
    return float(np.median(ahead[max(0, end - max(rows, 1)) : end]))


def approach_of(motion: Motion, execute: float) -> dict[str, float]:
    """The mean state in the last seconds before an execute.

    Speed, heading (also as it runs on without jumps), the turn of heading
    and the change of speed in a second (how steady the approach was).
    """
    execute = float(np.clip(execute, motion.time_s[0], motion.time_s[-1]))
    before = motion.between(execute - APPROACH_S, execute)
    if before.time_s.size < 2:
        before = motion.between(execute - 1.5 * motion.step_s, execute + 1.5 * motion.step_s)
    heading = float(before.heading_deg.mean())
    span = before.time_s - before.time_s.mean()
    scale = float(np.sum(span**2)) or 1.0
    return {
        "approach_mps": float(before.speed_mps.mean()),
        "approach_heading_deg": float(wrap_360(heading)),
        "approach_unwrapped_deg": heading,
        "approach_yaw_rate_dps": float(span @ before.heading_deg / scale),
        "approach_acceleration_mps2": float(span @ before.speed_mps / scale),
        "port_rpm": float(before.port_rpm.mean()),
        "starboard_rpm": float(before.starboard_rpm.mean()),
    }


def approach_settings(motion: Motion, execute: float) -> dict[str, float]:
    """The state before an execute as settings of a manoeuvre."""
    state = approach_of(motion, execute)
    return {name: value for name, value in state.items() if name != "approach_unwrapped_deg"}


def crossing_s(time_s: Floats, values: Floats, level: float, start: float, end: float) -> float:
    """When ``values`` first rise through ``level`` between two times, NaN where they do not."""
    first, last = np.searchsorted(time_s, [start, end])
    above = np.flatnonzero(values[first:last] >= level)
    if not above.size:
        return float("nan")
    row = int(first + above[0])
    if row == 0 or values[row - 1] >= level:
        return float(time_s[row])
    share = (level - values[row - 1]) / (values[row] - values[row - 1])
    return float(time_s[row - 1] + share * (time_s[row] - time_s[row - 1]))


def peak(time_s: Floats, values: Floats, start: float, end: float) -> tuple[float, float]:
    """Time and height of the highest point between two times, by the parabola through it and its neighbours."""
    first, last = np.searchsorted(time_s, [start, end])
    if last - first < 1:
        return float(start), float(np.interp(start, time_s, values))
    row = int(first + np.argmax(values[first:last]))
    if row == 0 or row + 1 >= values.size:
        return float(time_s[row]), float(values[row])
    left, top, right = values[row - 1 : row + 2]
    bend = left - 2.0 * top + right
    if bend >= 0.0:
        return float(time_s[row]), float(top)
    shift = float(np.clip(0.5 * (left - right) / bend, -1.0, 1.0))
    return float(time_s[row] + shift * (time_s[1] - time_s[0])), float(top - 0.25 * (left - right) * shift)


def distance_m(motion: Motion, start: float, end: float) -> float:
    """The way along the track between two times [m], NaN where one of them is."""
    if not np.isfinite(start + end):
        return float("nan")
    steps = np.hypot(np.diff(motion.north_m), np.diff(motion.east_m))
    way = np.append(0.0, np.cumsum(steps))
    return float(np.interp(end, motion.time_s, way) - np.interp(start, motion.time_s, way))


def along_and_across(motion: Motion, start: float, time_s: float, heading_deg: float) -> tuple[float, float]:
    """Way ahead and to starboard of a heading, from where the ship was at ``start`` [m]."""
    north = motion.at("north_m", time_s) - motion.at("north_m", start)
    east = motion.at("east_m", time_s) - motion.at("east_m", start)
    heading = np.deg2rad(heading_deg)
    return (float(north * np.cos(heading) + east * np.sin(heading)),
            float(east * np.cos(heading) - north * np.sin(heading)))  # fmt: skip
