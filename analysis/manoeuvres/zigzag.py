"""Zigzag tests: helm to one side until the heading has changed by the switching angle, then to the other, and
so on.

Definitions after IMO MSC.137(76) and ITTC 7.5-04-02-01: an overshoot is the change of heading in the old
direction after an execute. It is measured on a fit of the heading, as the largest of noisy samples is too
large.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from acquisition.core.arrays import Floats
from analysis.manoeuvres.indices import Index, Manoeuvre, from_order, nominal_deg, side_of
from analysis.manoeuvres.measures import (
    Plateau,
    approach_of,
    approach_settings,
    bootstrap_indices,
    crossing_s,
    distance_m,
    event_notes,
    executes_unsure_s,
    half_width_s,
    helm_change_s,
    helm_execute_s,
    is_same_order,
    manoeuvre_of,
    mean_between,
    next_execute_s,
    peak,
)
from analysis.manoeuvres.motion import Motion

FEWEST_SWINGS = 3
_LONGEST_PAUSE_S = 8.0
_WIDEST_SWING_DEG = 150.0
_MARGIN_S = 30.0
_STEADY_SHARE = 0.2
_CUT_SHORT_S, _CUT_SHORT_DEG = 4.0, 2.0  # a helm reversed on its way stops for and moves by no more
_FIRST_TURN_SHARE = 0.5  # of the switching angle
_SAME_LEVEL_DEG, _LEVEL_RANGES = 1.0, 3.0  # deviation of a helm from the others, and in their ranges
_SWITCH_SHARE = 0.16  # helms are switched early or late
_INITIAL_TURN_DEG = 10.0
_GATHERED_WAY = 0.2  # of the approach speed: no ship gains speed in a zigzag


def zigzag_chains(motion: Motion, held: Sequence[Plateau], extremes: Sequence[Plateau]) -> list[list[Plateau]]:
    """Chains of at least two held helms that alternate from side to side at one angle, with the ship
    responding.

    ``held`` are the plateaus of the helm off amidships, in order of time, and ``extremes`` its reversals
    without a plateau: such may be a first swing with a slow helm.
    """
    chains: list[list[Plateau]] = []
    for each in held:
        if chains and _continues(motion, chains[-1][-1], each):
            chains[-1].append(each)
        else:
            chains.append([each])
    ordered = (
        _as_ordered(motion, _with_first(motion, _without_course_keeping(motion, chain), extremes))
        for chain in chains
    )
    return [chain for chain in ordered if len(chain) > 1 and _ship_answers(motion, chain)]


def _with_first(motion: Motion, chain: list[Plateau], extremes: Sequence[Plateau]) -> list[Plateau]:
    """The swings with a preceding one that was cut short, if the helm came from there and the ship responded."""
    nearest = [each for each in extremes if each.end <= chain[0].first][-1:]
    more = [*nearest, *chain]
    if not nearest or len(chain) < FEWEST_SWINGS - 1 or not _continues(motion, *more[:2]):
        return chain
    begun = _first_row(motion, more)
    turned = np.abs(np.diff(motion.heading_deg[[begun, *(each.end - 1 for each in more)]]))
    return more if turned[0] > _FIRST_TURN_SHARE * 0.5 * np.median(turned[1:-1]) else chain


def _first_row(motion: Motion, chain: list[Plateau]) -> int:
    """The row before the first swing, and before the ship turned if the helm moved slowly."""
    return motion.row_before(chain[0].first, helm_change_s(motion, chain[0].level) + motion.step_s)


def _as_ordered(motion: Motion, chain: list[Plateau]) -> list[Plateau]:
    """The swings with the ordered helm: that of the others, if one was reversed before or at it."""
    ordered = float(np.median([abs(each.level) for each in chain]))
    return [
        replace(each, level=float(np.copysign(ordered, each.level))) if _is_cut_short(motion, each) else each
        for each in chain
    ]


def _is_cut_short(motion: Motion, each: Plateau) -> bool:
    return (each.end - each.first) * motion.step_s <= _CUT_SHORT_S + _CUT_SHORT_DEG / motion.helm_rate_dps


def _without_course_keeping(motion: Motion, chain: list[Plateau]) -> list[Plateau]:
    """The swings without a last one whose helm differs or was not held, as when the ship returns to her course."""
    levels = np.abs([each.level for each in chain])
    if levels.size <= FEWEST_SWINGS:
        return chain
    own = max(_SAME_LEVEL_DEG, _LEVEL_RANGES * float(np.ptp(levels[1:-1])))
    other = abs(levels[-1] - np.median(levels[1:-1])) > own
    return chain[:-1] if other or _is_cut_short(motion, chain[-1]) else chain


def _continues(motion: Motion, last: Plateau, each: Plateau) -> bool:
    """Whether ``each`` is the next swing: other side, the same angle, at once."""
    pause_s = (each.first - last.end) * motion.step_s
    shortest_s = min(last.end - last.first, each.end - each.first) * motion.step_s
    if motion.broken[last.first : each.end].any():
        return False
    cut_short = abs(last.level) < abs(each.level) and _is_cut_short(motion, last)
    return (
        last.level * each.level < 0
        and (cut_short or is_same_order(last.level, -each.level))
        and pause_s <= max(_LONGEST_PAUSE_S, 0.5 * shortest_s, helm_change_s(motion, last.level - each.level))
    )


def _ship_answers(motion: Motion, chain: list[Plateau]) -> bool:
    """Whether the ship turns to the other side in each swing but the last, and none of them is a circle."""
    ends = np.array([each.end - 1 for each in chain])
    at_ends = motion.heading_deg[ends]
    before = motion.heading_deg[_first_row(motion, chain)]
    turned = np.diff(np.append(before, at_ends))
    sides = np.sign([each.level for each in chain])
    alternates = bool(np.all(turned[:-1] * sides[:-1] * (turned[0] * sides[0]) > 0))
    return alternates and bool(np.all(np.abs(turned) < _WIDEST_SWING_DEG))


def executes_of(motion: Motion, chain: list[Plateau]) -> Floats:
    """The times at which each swing's helm began to move and was half-way: [2, swings + 1] s.

    The last column is the end of the last swing.
    """
    following = (next_execute_s(motion, *pair) for pair in pairwise(chain))
    end = float(motion.time_s[chain[-1].end - 1])
    return np.array([helm_execute_s(motion, chain[0]), *following, (end, end)]).T


def zigzag(motion: Motion, chain: list[Plateau]) -> Manoeuvre:
    """The zigzag of a chain of swings, with its indices."""
    both = executes_of(motion, chain)
    executes, times = both[1], np.append(both[0, 0], both[1])
    part = motion.around(times[0], times[-1], _MARGIN_S)
    swing_s = float(np.median(np.diff(executes[:-1])))
    unsure_s = executes_unsure_s(motion, chain[0].level, times)
    found = bootstrap_indices(part, times, half_width_s(part, 0.5 * swing_s), zigzag_indices, unsure_s)
    settings = _settings(part, chain, both)
    angle, switch = settings[f"{motion.steering}_deg"], settings["switch_deg"]
    steady = () if "reach_s" in found else ("the approach was not steady",)
    if steady == () and "speed_loss" not in found:
        steady = ("the ship was still gathering way at the execute",)
    name = f"zigzag {nominal_deg(angle):.0f}/{nominal_deg(switch, _SWITCH_SHARE):.0f}"
    made = manoeuvre_of(
        motion, "zigzag", name, executes[[0, -1]], side_of(_first_side(part, executes)), settings, found,
        executes=tuple(motion.utc(each) for each in executes[1:-1]), notes=(*steady, *event_notes(motion)),
    )  # fmt: skip
    return replace(made, indices={**made.indices, **_overshoots_from_order(part, both, unsure_s[1:], made.indices)})


def _overshoots_from_order(
    part: Motion, both: Floats, unsure_s: Floats, indices: Mapping[str, Index]
) -> dict[str, Index]:
    """The overshoots as IMO counts them, from the start of the helm's movement, which is ``unsure_s`` as well, if
    that adds more than their uncertainty."""
    if part.orders_are_events:
        return {}
    found = {}
    for number in range(1, both.shape[1] - 1):
        index, (begun_s, half_s) = indices.get(f"overshoot_{number}_deg"), both[:, number]
        more = abs(float(np.diff(np.interp((begun_s, half_s), part.time_s, part.heading_deg))[0]))
        if index is not None and more > 0.5 * (index.high - index.low):
            half_deg, turned_deg = 0.5 * (index.high - index.low), unsure_s[number] * more / (half_s - begun_s)
            wider = float(np.hypot(half_deg, turned_deg)) - half_deg
            low, value, high = (each + more for each in (index.low - wider, index.value, index.high + wider))
            found[from_order(number)] = replace(index, value=value, low=low, high=high)
    return found


def _settings(part: Motion, chain: list[Plateau], both: Floats) -> dict[str, float]:
    # Of an order that is known from events only the moment lies between its first change and half of it.
    ordered = both.mean(axis=0) if part.orders_are_events else both[0]
    heading = np.interp(ordered[:-1], part.time_s, part.heading_deg)
    return {
        f"{part.steering}_deg": float(np.median([abs(each.level) for each in chain])),
        "switch_deg": _switch_deg(heading),
        "swings": float(len(chain)),
        "half_command_s": float(np.median(both[1, :-1] - both[0, :-1])),
        **approach_settings(part, both[0, 0]),
    }


def _switch_deg(heading: Floats) -> float:
    """Half of the heading change between executes; with two executes the change from the approach."""
    return (
        float(np.median(np.abs(np.diff(heading[1:])))) / 2.0
        if heading.size > 2
        else float(abs(np.diff(heading)[0]))
    )


def _first_side(motion: Motion, executes: Floats) -> float:
    """1 where the first swing turns the ship to starboard, -1 to port."""
    return 1.0 if motion.at("heading_deg", executes[1]) > motion.at("heading_deg", executes[0]) else -1.0


def zigzag_indices(motion: Motion, times: Floats) -> dict[str, float]:
    """The indices of a smooth motion; ``times`` [swings + 2] are the first change of the command,
    each execute and the end [s].

    All counts from the executes, the moments at which a change of the command was half done. What was not reached
    is missing; after an approach that was not steady, all that hangs on the approach; of one in which the ship
    still gathered way, the loss of speed.
    """
    executes = times[1:]
    approach = approach_of(motion, times[0])
    heading, steady = _deviation_deg(motion, executes, approach)
    values, beside = _overshoots(motion, heading, executes)
    if executes.size >= 5:
        values["period_s"] = float(np.mean(executes[3:-1] - executes[1:-3]))
    if steady:
        tenth_s = crossing_s(motion.time_s, heading, _INITIAL_TURN_DEG, executes[0], executes[2])
        back_s = crossing_s(motion.time_s, -heading, 0.0, executes[1], executes[-1])
        values |= {
            "initial_turning_time_s": executes[1] - executes[0],
            "initial_turning_m": distance_m(motion, executes[0], tenth_s),
            "reach_s": back_s - executes[0],
        }
        loss = (
            1.0
            - mean_between(motion, "speed_mps", executes[1], executes[-2 if executes.size > 3 else -1])
            / approach["approach_mps"]
        )
        if loss > -_GATHERED_WAY:
            values["speed_loss"] = loss
    return values | beside


def _deviation_deg(motion: Motion, executes: Floats, approach: Mapping[str, float]) -> tuple[Floats, bool]:
    """The heading off the course of the approach, positive to the side of the first swing, and whether the
    approach was steady. If not, the course is the middle of the headings at which the helm was reversed."""
    largest = float(np.abs(motion.between(executes[0], executes[-1]).yaw_rate_dps).max())
    steady = abs(approach["approach_yaw_rate_dps"]) < _STEADY_SHARE * largest
    at_executes = np.interp(executes[1:-1], motion.time_s, motion.heading_deg)
    middle = float(np.mean(0.5 * (at_executes[1:] + at_executes[:-1]))) if at_executes.size > 1 else at_executes[0]
    base = approach["approach_unwrapped_deg"] if steady else middle
    return _first_side(motion, executes) * (motion.heading_deg - base), steady


def _overshoots(motion: Motion, heading: Floats, executes: Floats) -> tuple[dict[str, float], dict[str, float]]:
    """Every overshoot, the mean of three or more, and the times to check the yaw."""
    swings = executes.size - 2
    values: dict[str, float] = {}
    beside: dict[str, float] = {}
    for number in range(1, swings + 1):
        towards = heading if number % 2 else -heading
        time_s, top = peak(motion.time_s, towards, executes[number], float(executes[number + 1]))
        if number == swings and time_s >= executes[-1] - 2.0 * motion.step_s:
            continue  # the helm was taken off before the ship had answered
        values[f"overshoot_{number}_deg"] = top - float(np.interp(executes[number], motion.time_s, towards))
        beside[f"time_to_check_yaw_{number}_s"] = time_s - executes[number]
    if len(values) > 2:
        values["overshoot_mean_deg"] = float(np.mean(list(values.values())))
    return values, beside
