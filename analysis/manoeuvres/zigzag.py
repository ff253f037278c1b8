"""Zigzag tests: helm to one side until the heading is off by the switching angle, then to the other, and on.

Definitions after IMO MSC.137(76) and ITTC 7.5-04-02-01: an overshoot is the change of heading that follows an
execute in the old direction. It is read off a fit of the heading, as the largest of noisy samples is too large.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np

from acquisition.core.arrays import Floats
from analysis.manoeuvres.indices import Manoeuvre, indices_of, nominal_deg, side_of
from analysis.manoeuvres.measures import (
    Plateau,
    alternative_times,
    approach_of,
    approach_settings,
    bootstrap_indices,
    counting_times,
    crossing_s,
    distance_m,
    event_notes,
    execute_s,
    half_width_s,
    helm_change_s,
    helm_execute_s,
    is_same_order,
    peak,
)
from analysis.manoeuvres.motion import Motion

FEWEST_SWINGS = 3
_LONGEST_PAUSE_S = 8.0
_WIDEST_SWING_DEG = 150.0
_MARGIN_S = 30.0
_STEADY_SHARE = 0.2
_SWITCH_SHARE = 0.16  # people switch early and late
_INITIAL_TURN_DEG = 10.0
_GATHERED_WAY = 0.2  # of the approach's speed: no ship gains it by swinging


def zigzag_chains(motion: Motion, held: Sequence[Plateau], fewest: int = FEWEST_SWINGS) -> list[list[Plateau]]:
    """The runs of held helm that alternate from side to side at one angle, each answered by the ship.

    ``held`` are the plateaus of the helm that are off the middle, in order of time.
    """
    chains: list[list[Plateau]] = []
    for each in held:
        if chains and _continues(motion, chains[-1][-1], each):
            chains[-1].append(each)
        else:
            chains.append([each])
    return [chain for chain in chains if len(chain) >= fewest and _ship_answers(motion, chain)]


def _continues(motion: Motion, last: Plateau, each: Plateau) -> bool:
    """Whether ``each`` is the next swing: other side, the same angle, at once."""
    pause_s = (each.first - last.end) * motion.step_s
    shortest_s = min(last.end - last.first, each.end - each.first) * motion.step_s
    if motion.broken[last.first : each.end].any():
        return False
    return (
        last.level * each.level < 0
        and is_same_order(last.level, -each.level)
        and pause_s <= max(_LONGEST_PAUSE_S, 0.5 * shortest_s, helm_change_s(motion, last.level - each.level))
    )


def _ship_answers(motion: Motion, chain: list[Plateau]) -> bool:
    """Whether the ship turns to the other side in each swing but the last, and none of them is a circle."""
    ends = np.array([each.end - 1 for each in chain])
    at_ends = motion.heading_deg[ends]
    before = motion.heading_deg[max(chain[0].first - 1, 0)]
    turned = np.diff(np.append(before, at_ends))
    sides = np.sign([each.level for each in chain])
    alternates = bool(np.all(turned[:-1] * sides[:-1] * (turned[0] * sides[0]) > 0))
    return alternates and bool(np.all(np.abs(turned) < _WIDEST_SWING_DEG))


def executes_of(motion: Motion, helm: Floats, chain: list[Plateau]) -> Floats:
    """When each swing's helm began to be put over and when it was half way: [2, swings + 1] s.

    The last column is the end of the last swing.
    """
    times = [helm_execute_s(motion, helm, chain[0])]
    for last, each in pairwise(chain):
        times.append(execute_s(motion.time_s, helm, each, last.level, (last.first + last.end) // 2))
    end = float(motion.time_s[chain[-1].end - 1])
    return np.array([*times, (end, end)]).T


def zigzag(motion: Motion, helm: Floats, chain: list[Plateau]) -> Manoeuvre:
    """The zigzag of a chain of swings, with its indices."""
    both = executes_of(motion, helm, chain)
    executes = counting_times(motion, both)
    part = motion.around(executes[0], executes[-1], _MARGIN_S)
    swing_s = float(np.median(np.diff(executes[:-1])))
    found = bootstrap_indices(part, both, half_width_s(part, swing_s), zigzag_indices)
    settings = _settings(part, chain, both)
    indices = indices_of(found, motion.length_m)
    angle, switch = settings[f"{motion.steering}_deg"], settings["switch_deg"]
    steady = () if "reach_s" in found else ("the approach was not steady",)
    if steady == () and "speed_loss" not in found:
        steady = ("the ship was still gathering way at the execute",)
    return Manoeuvre(
        kind="zigzag",
        name=f"zigzag {nominal_deg(angle):.0f}/{nominal_deg(switch, _SWITCH_SHARE):.0f}",
        start=motion.utc(both[0, 0]),
        end=motion.utc(executes[-1]),
        side=side_of(_first_side(part, executes)),
        settings=settings,
        indices=indices,
        executes=tuple(motion.utc(each) for each in executes[1:-1]),
        notes=(*steady, *event_notes(motion)),
    )


def _settings(part: Motion, chain: list[Plateau], both: Floats) -> dict[str, float]:
    # Of an order that is known from events only the moment lies between its first change and half of it.
    executes = both.mean(axis=0) if part.orders_are_events else both[0]
    heading = np.interp(executes[:-1], part.time_s, part.heading_deg)
    return {
        f"{part.steering}_deg": float(np.median([abs(each.level) for each in chain])),
        "switch_deg": _switch_deg(heading),
        "swings": float(len(chain)),
        "half_command_s": float(np.median(both[1, :-1] - both[0, :-1])),
        **approach_settings(part, both[0, 0]),
    }


def _switch_deg(heading: Floats) -> float:
    """Half of the turn between executes; with two executes the turn from the approach."""
    return (
        float(np.median(np.abs(np.diff(heading[1:])))) / 2.0
        if heading.size > 2
        else float(abs(np.diff(heading)[0]))
    )


def _first_side(motion: Motion, executes: Floats) -> float:
    """1 where the first swing turns the ship to starboard, -1 to port."""
    return 1.0 if motion.at("heading_deg", executes[1]) > motion.at("heading_deg", executes[0]) else -1.0


def zigzag_indices(motion: Motion, both: Floats) -> dict[str, float]:
    """The indices of a smooth motion; ``both`` [2, swings + 1] as from :func:`executes_of`.

    An overshoot counts from the first change of the command; beside it stands the one from half way of the
    change, which is what a reader of slowly moved levers finds. Where orders are known from events only all
    counts from half way, and the overshoot from the first change stands beside it. What was not reached is
    missing; after an approach that was not steady, all that hangs on the approach; of one in which the ship still
    gathered way, the loss of speed.
    """
    executes = counting_times(motion, both)
    approach = approach_of(motion, both[0, 0])
    heading, steady = _deviation_deg(motion, executes, approach)
    values, beside = _overshoots(motion, heading, both)
    if executes.size >= 5:
        values["period_s"] = float(np.mean(executes[3:-1] - executes[1:-3]))
    if steady:
        tenth_s = crossing_s(motion.time_s, heading, _INITIAL_TURN_DEG, executes[0], executes[2])
        back_s = crossing_s(motion.time_s, -heading, 0.0, executes[1], executes[-1])
        swinging = motion.between(executes[1], executes[-1])
        values |= {
            "initial_turning_time_s": executes[1] - executes[0],
            "initial_turning_m": distance_m(motion, executes[0], tenth_s),
            "reach_s": back_s - executes[0],
        }
        loss = 1.0 - float(swinging.speed_mps.mean()) / approach["approach_mps"]
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


def _overshoots(motion: Motion, heading: Floats, both: Floats) -> tuple[dict[str, float], dict[str, float]]:
    """Every overshoot and the mean of three and more; beside them those from the other moment of the command, and
    the times it took to check the yaw."""
    executes, others, name = counting_times(motion, both), *alternative_times(motion, both)
    swings = executes.size - 2
    values: dict[str, float] = {}
    beside: dict[str, float] = {}
    for number in range(1, swings + 1):
        towards = heading if number % 2 else -heading
        last = executes[number + 1] if number < swings else motion.time_s[-1]
        time_s, top = peak(motion.time_s, towards, executes[number], float(last))
        if number == swings and time_s >= executes[-1]:
            continue  # the helm was taken off before the ship had answered
        at_execute, at_other = np.interp([executes[number], others[number]], motion.time_s, towards)
        values[f"overshoot_{number}_deg"] = top - float(at_execute)
        beside[f"overshoot_{number}_{name}_deg"] = top - float(at_other)
        beside[f"time_to_check_yaw_{number}_s"] = time_s - executes[number]
    if len(values) > 2:
        values["overshoot_mean_deg"] = float(np.mean(list(values.values())))
    return values, beside
