"""Zigzag tests: helm to one side until the heading has changed by the switching angle, then to the other, and
so on.

An overshoot is the change of heading in the old direction after an execute (MSC.137(76), 4.2.6 and 4.2.7; ITTC
7.5-04-02-01): from the order, and beside it from the moment at which the helm was half over. It is measured on a
fit of the heading, as the largest of noisy samples is too large.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from seatrial.acquisition.core.quantities import Floats
from seatrial.analysis.manoeuvres.indices import Manoeuvre, from_order, nominal_deg, side_of
from seatrial.analysis.manoeuvres.measures import (
    Execute,
    Plateau,
    approach_of,
    approach_settings,
    bootstrap_indices,
    contradiction_of,
    count_notes,
    crossing_s,
    distance_m,
    half_width_s,
    helm_band_deg,
    helm_change_s,
    helm_execute,
    helm_settings,
    is_same_order,
    manoeuvre_of,
    mean_between,
    next_execute,
    peak,
)
from seatrial.analysis.manoeuvres.motion import BY_DIFFERENCE, Motion

FEWEST_SWINGS = 3
_SHORTEST_SWING_S = 1.0
_LONGEST_PAUSE_S = 8.0
_WIDEST_SWING_DEG = 150.0
_MARGIN_S = 30.0
_STEADY_SHARE = 0.2
_CUT_SHORT_S, _CUT_SHORT_DEG = 4.0, 2.0  # a helm reversed on its way stops for and moves by no more
_FIRST_TURN_SHARE = 0.5  # of the switching angle
_SAME_LEVEL_DEG, _LEVEL_RANGES = 1.0, 3.0  # deviation of a helm from the others, and in their ranges
SWITCH_SHARE = 0.16  # helms are switched early or late
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
    turned = np.abs(_turns(motion, more))
    if not is_same_order(more[0].level, -more[1].level):  # reversed on its way: the ship turns on in the next
        turned[0] = abs(np.ptp(motion.heading_deg[[_first_row(motion, more), more[0].end - 1]]))
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
    between = motion.helm_deg[last.end : each.first]
    near = [np.abs(between - plateau.level) <= helm_band_deg(plateau.level) for plateau in (last, each)]
    pause_s = float(np.sum(~(near[0] | near[1]))) * motion.step_s
    held_s = sorted((plateau.end - plateau.first) * motion.step_s for plateau in (last, each))
    longest_s = max(min(_LONGEST_PAUSE_S, 0.5 * held_s[1]), 0.5 * held_s[0])
    if motion.broken[last.first : each.end].any():
        return False
    cut_short = abs(last.level) < abs(each.level) and _is_cut_short(motion, last)
    return (
        last.level * each.level < 0
        and (cut_short or is_same_order(last.level, -each.level, min(last.spread, each.spread)))
        and pause_s <= max(longest_s, helm_change_s(motion, last.level - each.level))
    )


def _ship_answers(motion: Motion, chain: list[Plateau]) -> bool:
    """Whether the ship turns to the other side in each swing but the last, and none of them is a circle."""
    turned = _turns(motion, chain)
    sides = np.sign([each.level for each in chain])
    alternates = bool(np.all(turned[:-1] * sides[:-1] * (turned[0] * sides[0]) > 0))
    return alternates and bool(np.all(np.abs(turned) < _WIDEST_SWING_DEG))


def _turns(motion: Motion, chain: list[Plateau]) -> Floats:
    """How far the ship turns in each swing [deg], to starboard, until the helm passes amidships on its way to the
    other side."""
    ends = [*(_crossed_row(motion, *pair) for pair in pairwise(chain)), chain[-1].end - 1]
    return np.diff(motion.heading_deg[[_first_row(motion, chain), *ends]])


def _crossed_row(motion: Motion, last: Plateau, each: Plateau) -> int:
    """The last row of a swing at which its helm is still on its side: one that wanders is held longer than it is
    steady."""
    between = motion.helm_deg[last.end : each.first] * np.sign(last.level)
    return last.end - 1 + int(np.argmax(np.append(between, -1.0) <= 0.0))


def executes_of(motion: Motion, chain: list[Plateau]) -> list[Execute]:
    """The execute of each swing."""
    return [helm_execute(motion, chain[0]), *(next_execute(motion, *pair) for pair in pairwise(chain))]


def zigzag(motion: Motion, chain: list[Plateau]) -> Manoeuvre:
    """The zigzag of a chain of swings, with its indices."""
    executes, end = executes_of(motion, chain), float(motion.time_s[chain[-1].end - 1])
    while len(executes) > 2 and executes[1].order_s < executes[0].order_s + _SHORTEST_SWING_S:
        chain, executes = chain[1:], executes[1:]  # the helm only passed there on its way to the other side
    times = np.array([[*moments, end] for moments in zip(*(execute[:2] for execute in executes), strict=True)])
    within_s = np.array([[*widths, 0.0] for widths in zip(*(execute[2:4] for execute in executes), strict=True)])
    orders = times[0]
    part = motion.around(orders[0], end, _MARGIN_S)
    swing_s = float(np.median(np.diff(orders[:-1])))
    found = bootstrap_indices(part, times, half_width_s(part, 0.5 * swing_s), zigzag_indices, within_s)
    settings = _settings(part, chain, times)
    angle, switch = settings[motion.helm_setting], settings["switch_deg"]
    unsteady = () if "reach_s" in found else ("the approach was not steady",)
    if not unsteady and "speed_loss" not in found:
        unsteady = ("the ship was still gathering way at the execute",)
    by_thrust = " by thrust" * (motion.steering == BY_DIFFERENCE)
    name = f"zigzag {nominal_deg(angle):.0f}/{nominal_deg(switch, SWITCH_SHARE):.0f}{by_thrust}"
    return manoeuvre_of(
        motion, "zigzag", name, orders[[0, -1]], side_of(_first_side(part, orders)), settings, found,
        executes=tuple(motion.utc(order) for order in orders[1:-1]),
        notes=(*unsteady, *count_notes(motion, executes)), shortfalls=(*unsteady, *contradiction_of(executes)),
    )  # fmt: skip


def _settings(part: Motion, chain: list[Plateau], times: Floats) -> dict[str, float]:
    heading = np.interp(times[0, :-1], part.time_s, part.heading_deg)
    return {
        **helm_settings(part, float(np.median([abs(each.level) for each in chain])), times[0, 0], times[0, -1]),
        "switch_deg": _switch_deg(heading),
        "swings": float(len(chain)),
        "half_command_s": float(np.median(times[1, :-1] - times[0, :-1])),
        **approach_settings(part, times[0, 0]),
    }


def _switch_deg(heading: Floats) -> float:
    """Half of the heading change between executes; with two executes the change from the approach."""
    return (
        float(np.median(np.abs(np.diff(heading[1:])))) / 2.0
        if heading.size > 2
        else float(abs(np.diff(heading)[0]))
    )


def _first_side(motion: Motion, orders: Floats) -> float:
    """1 where the first swing turns the ship to starboard, -1 to port, by all swings that end in an order."""
    turned = np.diff(np.interp(orders[:-1], motion.time_s, motion.heading_deg))
    return 1.0 if float(turned @ (-1.0) ** np.arange(turned.size)) > 0.0 else -1.0


def zigzag_indices(motion: Motion, times: Floats) -> dict[str, float]:
    """The indices of a smooth motion; ``times`` [2, swings + 1] are the orders, below them the moments at which the
    helm was half over, and in the last column the end [s].

    All counts from the orders, but ``overshoot_N_deg``, from half of the command. What was not reached is missing;
    after an approach that was not steady, all that hangs on the approach; of one in which the ship still gathered
    way, the loss of speed.
    """
    orders = times[0]
    approach = approach_of(motion, orders[0])
    heading, steady = _deviation_deg(motion, orders, approach)
    values, beside = _overshoots(motion, heading, times)
    if orders.size >= 5:
        values["period_s"] = float(np.mean(orders[3:-1] - orders[1:-3]))
    if steady:
        tenth_s = crossing_s(motion.time_s, heading, _INITIAL_TURN_DEG, orders[0], orders[2])
        back_s = crossing_s(motion.time_s, -heading, 0.0, orders[1], orders[-1])
        values |= {
            "initial_turning_time_s": orders[1] - orders[0],
            "initial_turning_m": distance_m(motion, orders[0], tenth_s),
            "reach_s": back_s - orders[0],
        }
        loss = (
            1.0
            - mean_between(motion, "speed_mps", orders[1], orders[-2 if orders.size > 3 else -1])
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


def _overshoots(motion: Motion, heading: Floats, times: Floats) -> tuple[dict[str, float], dict[str, float]]:
    """Every overshoot from the order and from half of the command, the mean of three or more from the order, and
    the times to check the yaw."""
    orders, halves = times
    swings = orders.size - 2
    from_orders, from_halves = dict[str, float](), dict[str, float]()
    beside: dict[str, float] = {}
    for number in range(1, swings + 1):
        towards = heading if number % 2 else -heading
        time_s, top = peak(motion.time_s, towards, halves[number], float(halves[number + 1]))
        if number == swings and time_s >= orders[-1] - 2.0 * motion.step_s:
            continue  # the helm was taken off before the ship had answered
        at_order, at_half = np.interp((orders[number], halves[number]), motion.time_s, towards)
        from_orders[from_order(number)] = top - float(at_order)
        from_halves[f"overshoot_{number}_deg"] = top - float(at_half)
        beside[f"time_to_check_yaw_{number}_s"] = time_s - orders[number]
    values = {**from_orders, **from_halves}
    if len(from_orders) > 2:
        values["overshoot_mean_deg"] = float(np.mean(list(from_orders.values())))
    return values, beside
