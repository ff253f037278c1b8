"""Stretches of a command that is held, and the moments at which it is changed."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from acquisition.core.arrays import Floats
from analysis.manoeuvres.motion import Motion, noise_of, running_median, stretches

_STEP_S = 1.0
_STEP_SIGMAS = 6.0
_BRIDGE_S = 4.0
_BLINK_SHARE = 0.5
_ALIKE_SHARE, _ALIKE_DEG = 0.15, 1.0


@dataclass(frozen=True, slots=True)
class Plateau:
    """A held command: rows ``first`` up to ``end``, its ``level`` and the middle 80 % of its values' ``spread``."""

    first: int
    end: int
    level: float
    spread: float


def tolerance_of(values: Floats, least: float) -> float:
    """How far a command may wander within two seconds and still be held: six standard deviations of its noise."""
    return max(least, _STEP_SIGMAS * noise_of(values))


def plateaus(values: Floats, step_s: float, tolerance: float, least_s: float = 2.0) -> list[Plateau]:
    """Where ``values`` [rows] change by no more than ``tolerance`` within two seconds, in order of time.

    A slow ramp is a plateau with a spread. Neighbours of one level that only a blink parts are one plateau.
    """
    reach = max(1, round(_STEP_S / step_s))
    calm = running_median(values, max(3, round(1.5 / step_s)))
    change = np.zeros(values.size)
    if values.size > 2 * reach:
        change[reach:-reach] = calm[2 * reach :] - calm[: -2 * reach]
    found = [
        _plateau(calm, first, end) for first, end in stretches(np.abs(change) <= tolerance, round(least_s / step_s))
    ]
    return _merge_plateaus(calm, found, tolerance, round(_BRIDGE_S / step_s))


def _plateau(values: Floats, first: int, end: int) -> Plateau:
    low, middle, high = np.percentile(values[first:end], [10, 50, 90])
    return Plateau(first, end, float(middle), float(high - low))


def _merge_plateaus(values: Floats, found: list[Plateau], tolerance: float, bridge: int) -> list[Plateau]:
    joined: list[Plateau] = []
    for each in found:
        last = joined[-1] if joined else None
        if last and each.first - last.end <= bridge and abs(each.level - last.level) <= tolerance:
            joined[-1] = _plateau(values, last.first, each.end)
        else:
            joined.append(each)
    return joined


def is_same_order(one_deg: float, other_deg: float) -> bool:
    """Whether two helm angles are the same order within what a hand can set."""
    return abs(one_deg - other_deg) <= _ALIKE_SHARE * max(abs(one_deg), abs(other_deg)) + _ALIKE_DEG


def merge_corrections(found: list[Plateau], step_s: float) -> list[Plateau]:
    """Plateaus of helm with those joined that are one order: a short one just before or after a long one at nearly
    the same angle, where the hand went too far and came back."""
    joined: list[Plateau] = []
    for each in found:
        last = joined[-1] if joined else None
        if last and _is_correction(last, each, round(_BRIDGE_S / step_s)):
            longer = max(last, each, key=lambda plateau: plateau.end - plateau.first)
            joined[-1] = replace(longer, first=last.first, end=each.end)
        else:
            joined.append(each)
    return joined


def _is_correction(last: Plateau, each: Plateau, bridge: int) -> bool:
    short, long = sorted((last.end - last.first, each.end - each.first))
    near = each.first - last.end <= bridge and short <= _BLINK_SHARE * long
    return near and last.level * each.level > 0 and is_same_order(last.level, each.level)


def execute_s(
    time_s: Floats, values: Floats, plateau: Plateau, before: float, earliest: int = 0
) -> tuple[float, float]:
    """When a command began to go from the level ``before`` to that of ``plateau``, and was half way there [s].

    The line through the moments at which a tenth and a half of the way were done, back to where it began: noise
    about the old level does not shift it, and a drive that lags or turns at a limited rate has the same line.
    """
    held_at_once = plateau.first - earliest < 2  # where a recording begins or goes on after a break
    if held_at_once or abs(plateau.level - before) <= plateau.spread:
        return float(time_s[plateau.first]), float(time_s[plateau.first])
    share = (values[earliest : plateau.end] - before) / (plateau.level - before)
    inside = plateau.first - earliest + max(1, (plateau.end - plateau.first) // 4)
    half = _last_crossing(share[: inside + 1], 0.5)
    tenth = _last_crossing(share[: int(half) + 2], 0.1)
    rows = earliest + np.array([max(0.0, tenth - 0.25 * (half - tenth)), half])
    start, middle = np.interp(rows, np.arange(time_s.size), time_s)
    return float(start), float(middle)


def _last_crossing(share: Floats, level: float) -> float:
    """The row, with fraction, at which ``share`` last rose through ``level``; 0 where it never was below."""
    below = np.flatnonzero(share < level)
    if not below.size:
        return 0.0
    row = int(below[-1])
    if row + 1 >= share.size:
        return float(row)
    return row + float((level - share[row]) / (share[row + 1] - share[row]))


def counting_times(motion: Motion, both: Floats) -> Floats:
    """The times that indices are counted from, of those of first change and of half way [2, ...].

    The first change of a command is its execute. Between two events nobody knows when a lever began to move, and
    a line drawn between them begins with the older one: then half way is the better guess.
    """
    return np.asarray(both[1 if motion.orders_are_events else 0])


def alternative_times(motion: Motion, both: Floats) -> tuple[Floats, str]:
    """The times that indices are not counted from, and the suffix of the indices that are given for them too."""
    return (both[0], "first_change") if motion.orders_are_events else (both[1], "half_command")


def event_notes(motion: Motion) -> tuple[str, ...]:
    """What to know of the executes of a recording whose orders are events."""
    text = (
        "orders were recorded as events: indices count from half of each change, whose true moment is not known "
        "and not in the intervals"
    )
    return (text,) if motion.orders_are_events else ()
