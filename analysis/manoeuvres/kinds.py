"""The tests by helm, with their indices (IMO MSC.137(76), 4.2; ITTC 7.5-04-02-01; ISO 13643-2 and -3).

They are zigzags, turning circles, pull-outs, direct and reverse spirals, and Williamson turns, recognised by the
orders and the response of the ship: rates of turn count once settled, and a Williamson turn ends on the reciprocal
course.

An overshoot is the change of heading in the old direction after an execute: from the order, and also from the
moment at which the helm was half over. It is measured on a fit of the heading, as the largest of noisy samples is
too large.

Advance and transfer are measured along and across the heading of the approach, from the position at which the
rudder order is given to where the heading has changed by 90 deg; the tactical diameter is the way across when it
has changed by 180 deg.

In steady turning a ship comes back to the same point of the water after each turn, so that the way between two
points of the track one turn apart, over the time between them, is the velocity of the water, with what the wind
adds to it (correction for drift). All pairs of the steady part count.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pandas as pd

from seatrial.acquisition.core.quantities import Bools, Floats, rotate_earth_to_ship
from seatrial.analysis.manoeuvres import measures
from seatrial.analysis.manoeuvres.indices import (
    Current,
    LeftOut,
    Manoeuvre,
    nominal_angle_deg,
    overshoot_from_order_name,
    side_of_sign,
)
from seatrial.analysis.manoeuvres.measures import Execute, Measure, Plateau
from seatrial.analysis.manoeuvres.motion import BY_DIFFERENCE, Motion, row_to_row_noise, runs_of_true
from seatrial.analysis.series import local_quadratic

FEWEST_SWINGS = 3
_SHORTEST_SWING_S, _SHORTEST_SHARE = 1.0, 0.25  # of the usual swing of the run
_LONGEST_PAUSE_S = 8.0
_WIDEST_SWING_DEG = 150.0
_ZIGZAG_MARGIN_S = 30.0
_STEADY_SHARE = 0.2
_CUT_SHORT_S, _CUT_SHORT_DEG = 4.0, 2.0  # a helm reversed on its way stops for and moves by no more
_FIRST_TURN_SHARE = 0.5  # of the switching angle
_BRIEF_SWING_S, _LEAST_SWITCH_SHARE = 5.0, 0.2  # of the helm
_SAME_LEVEL_DEG, _LEVEL_RANGES = 1.0, 3.0  # deviation of a helm from the others, and in their ranges
SWITCH_SHARE = 0.16  # helms are switched early or late
_INITIAL_TURN_DEG = 10.0
_GATHERED_WAY = 0.2  # of the approach speed: no ship gains speed in a zigzag
LEAST_CIRCLE_DEG, LEAST_TURN_OF_ONE_SIDE_DEG = 180.0, 90.0
_CIRCLE_MARGIN_S = 20.0
_SLOWEST_APPROACH = 0.3
_STEADIEST_APPROACH = 0.25
REMOVED = "_current_removed"
_STEADY = ("steady_yaw_rate_dps", "steady_diameter_m", "steady_speed_mps", "drift_angle_deg")
_COUNTED_FOR = {
    "advance_m": "time_to_90_deg_s", "transfer_m": "time_to_90_deg_s",
    "tactical_diameter_m": "time_to_180_deg_s",
}  # fmt: skip
"""Ways, and how long the drift has gone into them."""
GATHERING_WAY = "the ship was still gathering way at the execute"
"""The note on a zigzag whose approach speed is no steady one."""
LEAST_TURN_DEG = 510.0
LEAST_STEADY_DEG = 270.0
"""The turn from which a part of it is steady: the first half of a circle is not, nor a quarter of what follows."""
_STEADY_AFTER_DEG = 120.0
_FEWEST_PAIRS = 10
_MARGIN_S = 20.0
_AMIDSHIPS_DEG, _AMIDSHIPS_SHARE = 1.0, 0.1
_LEAST_TURN_DEG, _LEAST_WAY = 30.0, 0.2  # before a pull-out; way of the fastest of the recording
_STILL_DEG, _SPREAD_OF_NOISE = 0.3, 3.0  # the middle 80 % of white noise are 2.6 standard deviations wide
_LEAST_SHARE_OF_STEP = 0.25  # of the longest step: they are held alike
_SETTLED_SHARE = 0.05  # of the rate of the turn, from the third quarter to the last
_LEAST_HELD_S = 10.0
_FEWEST_STEPS, _SETTLED_STEPS = 5, 0.75
_LEAST_HELM_STEP_DEG = 1.0
_BAND_SHARE, _BAND_OF_NOISE, _HELD_SHARE = 0.1, 6.0, 0.6  # of the largest rate; of a run's time
_SEED, _DRAWS = 137, 200
_WIDER_S = (20.0, 40.0)  # a step of a full-scale ship takes minutes
_OUT_DEG, _BACK_DEG = (35.0, 90.0), (150.0, 210.0)  # 60 deg off and the reciprocal course, as steered by hand


def zigzag_chains(motion: Motion, held: Sequence[Plateau], extremes: Sequence[Plateau]) -> list[list[Plateau]]:
    """Chains of at least two held helms that alternate from side to side at one angle, with the ship responding.

    ``held`` are the plateaus of the helm off amidships, in order of time, and ``extremes`` its reversals
    without a plateau: such may be a first swing with a slow helm.
    """
    chains: list[list[Plateau]] = []
    for plateau in held:
        if chains and _is_next_swing(motion, chains[-1][-1], plateau):
            chains[-1].append(plateau)
        else:
            chains.append([plateau])
    complete = []
    for swings in chains:
        levels = np.abs([swing.level for swing in swings])
        if levels.size > FEWEST_SWINGS:  # a last one that differs or was not held returns the ship to its course
            tolerance_deg = max(_SAME_LEVEL_DEG, _LEVEL_RANGES * float(np.ptp(levels[1:-1])))
            differs = abs(levels[-1] - np.median(levels[1:-1])) > tolerance_deg
            usual_s = motion.step_s * float(np.median([swing.end - swing.first for swing in swings[1:-1]]))
            swings = swings[:-1] if differs or _is_cut_short(motion, swings[-1], 0.5 * usual_s) else swings
        # a helm that is there in the first row was ordered before the recording began
        before = [plateau for plateau in extremes if plateau.first > 0 and plateau.end <= swings[0].first]
        if before and measures.is_same_order(before[-1].level, swings[0].level):  # its own begin
            before = before[:-1]
        nearest = before[-1:]
        if nearest and len(swings) >= FEWEST_SWINGS - 1 and _is_next_swing(motion, nearest[0], swings[0]):
            # one before the first that was cut short, if the ship responded to it
            extended = [*nearest, *swings]
            turned = np.abs(_turned_deg_by_swing(motion, extended))
            if not measures.is_same_order(extended[0].level, -extended[1].level):
                # reversed on its way: the ship turns on in the next
                turned[0] = abs(
                    np.ptp(motion.heading_deg[[_row_before_first_swing(motion, extended), extended[0].end - 1]])
                )
            if turned[0] > _FIRST_TURN_SHARE * 0.5 * np.median(turned[1:-1]):
                swings = extended
        ordered_deg = float(np.median([abs(swing.level) for swing in swings]))  # also where a swing was cut short
        swings = [replace(swing, level=float(np.copysign(ordered_deg, swing.level)))
                  if _is_cut_short(motion, swing) else swing for swing in swings]  # fmt: skip
        if len(swings) > 1:
            turned, sides = _turned_deg_by_swing(motion, swings), np.sign([swing.level for swing in swings])
            responds = bool(np.all(turned[:-1] * sides[:-1] * (turned[0] * sides[0]) > 0))
            if responds and np.all(np.abs(turned) < _WIDEST_SWING_DEG):  # none of them is a circle
                complete.append(swings)
    return complete


def _row_before_first_swing(motion: Motion, chain: list[Plateau]) -> int:
    """The row before the first swing, and before the ship turned if the helm moved slowly."""
    return motion.row_before(chain[0].first, measures.longest_helm_change_s(motion, chain[0].level) + motion.step_s)


def _is_cut_short(motion: Motion, plateau: Plateau, most_s: float = np.inf) -> bool:
    longest_s = min(_CUT_SHORT_S + _CUT_SHORT_DEG / motion.helm_rate_dps, most_s)
    return (plateau.end - plateau.first) * motion.step_s <= longest_s


def _is_next_swing(motion: Motion, last: Plateau, following: Plateau) -> bool:
    """Whether ``following`` is the next swing: other side, the same angle, at once."""
    between = motion.helm_deg[last.end : following.first]
    bands = ((plateau.level, measures.HELD_SHARE * abs(plateau.level)) for plateau in (last, following))
    near = [np.abs(between - level) <= band for level, band in bands]
    pause_s = float(np.sum(~(near[0] | near[1]))) * motion.step_s
    held_s = sorted((plateau.end - plateau.first) * motion.step_s for plateau in (last, following))
    longest_s = max(min(_LONGEST_PAUSE_S, 0.5 * held_s[1]), 0.5 * held_s[0])
    if motion.broken[last.first : following.end].any():
        return False
    cut_short = abs(last.level) < abs(following.level) and _is_cut_short(motion, last)
    return (
        last.level * following.level < 0
        and (cut_short or measures.is_same_order(last.level, -following.level, min(last.spread, following.spread)))
        and pause_s <= max(longest_s, measures.longest_helm_change_s(motion, last.level - following.level))
    )


def _turned_deg_by_swing(motion: Motion, chain: list[Plateau]) -> Floats:
    """How far the ship turns in each swing [deg], to starboard, until the helm passes amidships on its way to the
    other side: a helm that wanders is held longer than it is steady."""
    rows = [_row_before_first_swing(motion, chain)]
    for last, following in pairwise(chain):
        between = motion.helm_deg[last.end : following.first] * np.sign(last.level)
        rows.append(last.end - 1 + int(np.argmax(np.append(between, -1.0) <= 0.0)))
    return np.diff(motion.heading_deg[[*rows, chain[-1].end - 1]])


def make_zigzag(motion: Motion, chain: list[Plateau]) -> Manoeuvre:
    """The zigzag of a chain of swings, with its indices."""
    executes = [measures.helm_execute(motion, chain[0])]
    executes += [measures.helm_execute(motion, following, last) for last, following in pairwise(chain)]
    end = float(motion.time_s[chain[-1].end - 1])
    usual_s = float(np.median(np.diff([execute.order_s for execute in executes])))
    shortest_s = min(_SHORTEST_SWING_S, _SHORTEST_SHARE * usual_s)
    while len(executes) > 2 and executes[1].order_s < executes[0].order_s + shortest_s:
        chain, executes = chain[1:], executes[1:]  # the helm only passed there on its way to the other side
    times = np.array([[*moments, end] for moments in zip(*(execute[:2] for execute in executes), strict=True)])
    within_s = np.array([[*widths, 0.0] for widths in zip(*(execute[2:4] for execute in executes), strict=True)])
    orders = times[0]
    part = motion.around(orders[0], end, _ZIGZAG_MARGIN_S)
    swing_s = float(np.median(np.diff(orders[:-1])))
    estimates = measures.bootstrap_index_intervals(
        part, times, measures.smoothing_half_width_s(part, 0.5 * swing_s), zigzag_indices, within_s
    )

    angle = float(np.median([abs(plateau.level) for plateau in chain]))
    changes = np.abs(np.diff(np.interp(orders[:-1], part.time_s, part.heading_deg)))
    # half of the change between executes; with two executes the change from the approach
    switch = float(np.median(changes[1:])) / 2.0 if changes.size > 1 else float(changes[0])
    settings = {
        **measures.helm_settings(part, angle, orders[0], end),
        "switch_deg": switch,
        "swings": float(len(chain)),
        "half_command_s": float(np.median(times[1, :-1] - orders[:-1])),
        **measures.approach_settings(part, orders[0]),
    }
    unsteady = () if "reach_s" in estimates else ("the approach was not steady",)
    if gathers_way(estimates):
        unsteady = (GATHERING_WAY,)
    how = _how_sailed(motion, settings)
    name = f"zigzag {nominal_angle_deg(angle):.0f}/{nominal_angle_deg(switch, SWITCH_SHARE):.0f}{how}"
    notes, shortfalls = measures.execution_notes(motion, executes, end)
    return measures.make_manoeuvre(
        motion, "zigzag", name, orders[[0, -1]], side_of_sign(_sign_of_first_swing(part, orders)), settings,
        estimates,
        executes=tuple(motion.utc(order) for order in orders[1:-1]),
        notes=(*unsteady, *notes), shortfalls=(*unsteady, *shortfalls),
    )  # fmt: skip


def gathers_way(indices: Collection[str]) -> bool:
    """Whether the ship of a zigzag with these indices was steady but for its speed when the first order came."""
    return "reach_s" in indices and "speed_loss" not in indices


def keeps_course(zigzag: Manoeuvre) -> bool:
    """Whether the helm of a zigzag goes to and fro within seconds, before the ship has followed it: one that keeps
    the course in waves."""
    swings = np.diff(pd.DatetimeIndex(zigzag.executes)) / np.timedelta64(1, "s")
    switch_deg, helm_deg = zigzag.settings["switch_deg"], abs(zigzag.helm_deg or 0.0)
    return bool(swings.size and np.median(swings) < _BRIEF_SWING_S and switch_deg < _LEAST_SWITCH_SHARE * helm_deg)


def _sign_of_first_swing(motion: Motion, orders: Floats) -> float:
    """1 where the first swing turns the ship to starboard, -1 to port, by all swings that end in an order."""
    turned = np.diff(np.interp(orders[:-1], motion.time_s, motion.heading_deg))
    return 1.0 if float(turned @ (-1.0) ** np.arange(turned.size)) > 0.0 else -1.0


def zigzag_indices(motion: Motion, times: Floats) -> dict[str, float]:
    """The indices of a smooth motion; ``times`` [2, swings + 1] are the orders, below them the moments at which the
    helm was half over, and in the last column the end [s].

    All counts from the orders, but ``overshoot_N_deg``, from half of the command. What was not reached is missing;
    after an approach that was not steady, all that depends on the approach; of one in which the ship still gathered
    way, the loss of speed.
    """
    orders = times[0]
    approach = measures.approach_state(motion, orders[0])
    largest_dps = float(np.abs(motion.between(orders[0], orders[-1]).yaw_rate_dps).max())
    steady = abs(approach["approach_yaw_rate_dps"]) < _STEADY_SHARE * largest_dps
    course = approach["approach_unwrapped_deg"]
    if not steady:  # the middle of the headings at which the helm was reversed
        reversals = np.interp(orders[1:-1], motion.time_s, motion.heading_deg)
        middles = 0.5 * (reversals[1:] + reversals[:-1])
        course = float(np.mean(middles)) if middles.size else reversals[0]
    heading = _sign_of_first_swing(motion, orders) * (
        motion.heading_deg - course
    )  # positive to the side of the first swing
    values, check_times = _overshoots_and_times(motion, heading, times)
    if orders.size >= 5:
        values["period_s"] = float(np.mean(orders[3:-1] - orders[1:-3]))
    if steady:
        tenth_s = measures.first_crossing_s(motion.time_s, heading, _INITIAL_TURN_DEG, orders[0], orders[2])
        back_s = measures.first_crossing_s(motion.time_s, -heading, 0.0, orders[1], orders[-1])
        values |= {
            "initial_turning_time_s": orders[1] - orders[0],
            "initial_turning_m": measures.distance_m(motion, orders[0], tenth_s),
            "reach_s": back_s - orders[0],
        }
        last = orders[-2 if orders.size > 3 else -1]
        loss = 1.0 - measures.mean_between(motion, "speed_mps", orders[1], last) / approach["approach_mps"]
        if loss > -_GATHERED_WAY:
            values["speed_loss"] = loss
    return values | check_times


def _overshoots_and_times(
    motion: Motion, heading: Floats, times: Floats
) -> tuple[dict[str, float], dict[str, float]]:
    """Every overshoot from the order and from half of the command, the mean of three or more from the order, and
    the times to check the yaw."""
    orders, halves = times
    swings = orders.size - 2
    from_orders, from_halves = dict[str, float](), dict[str, float]()
    check_times: dict[str, float] = {}
    for number in range(1, swings + 1):
        towards = heading if number % 2 else -heading
        time_s, top = measures.peak_time_and_height(
            motion.time_s, towards, halves[number], float(halves[number + 1])
        )
        if number == swings and time_s >= orders[-1] - 2.0 * motion.step_s:
            continue  # the helm was taken off before the ship had answered
        at_order, at_half = np.interp((orders[number], halves[number]), motion.time_s, towards)
        from_orders[overshoot_from_order_name(number)] = top - float(at_order)
        from_halves[f"overshoot_{number}_deg"] = top - float(at_half)
        check_times[f"time_to_check_yaw_{number}_s"] = time_s - orders[number]
    values = {**from_orders, **from_halves}
    if len(from_orders) > 2:
        values["overshoot_mean_deg"] = float(np.mean(list(from_orders.values())))
    return values, check_times


def make_turn_or_reject(motion: Motion, plateau: Plateau, fastest_mps: float) -> Manoeuvre | LeftOut | None:
    """The turn of a held helm, or the reason for its rejection; None if the ship turns by less than 90 deg.

    After a straight approach under way it is a turning circle from 180 deg of turn on. Without one, only what is
    steady counts, which takes a turn of :data:`LEAST_STEADY_DEG`.
    """
    heading = motion.heading_deg[plateau.first : plateau.end]
    turned = abs(float(heading[-1] - heading[0]))
    if turned < LEAST_TURN_OF_ONE_SIDE_DEG:
        return None
    kind = "turning_circle" if turned >= LEAST_CIRCLE_DEG else "course_change"
    start, end = (motion.utc(float(motion.time_s[row])) for row in (plateau.first, plateau.end - 1))
    if motion.broken[plateau.first : plateau.end].any():
        return LeftOut(kind, start, end, "position or heading jump in it")

    order_s = measures.helm_execute(motion, plateau).order_s
    before = measures.approach_state(motion, order_s - 1.0)
    rate_dps, speed_mps = abs(before["approach_yaw_rate_dps"]), before["approach_mps"]
    lead_s, shortfall = order_s - float(motion.time_s[0]), ""
    if lead_s < 2.0 * motion.step_s:
        shortfall = "no approach: the recording begins with the helm over"
    elif rate_dps >= _STEADIEST_APPROACH * (turned / ((plateau.end - plateau.first) * motion.step_s)):
        in_turn, turning = "the recording begins in the turn", "the ship was turning before the order"
        begun = in_turn if lead_s < measures.APPROACH_S else turning
        shortfall = f"no straight approach: {begun}, by {rate_dps:.2g} deg/s"
    elif speed_mps <= _SLOWEST_APPROACH * fastest_mps:
        speeds = f"{speed_mps:.2g} m/s of {fastest_mps:.2g} m/s"
        shortfall = f"no approach under way: the ship made {speeds} before the order"
    if shortfall and turned < LEAST_STEADY_DEG:
        return LeftOut(kind, start, end, shortfall)
    return make_turning_circle(motion, plateau, shortfall)


def make_turning_circle(motion: Motion, plateau: Plateau, shortfall: str) -> Manoeuvre:
    """The turning circle, or the turn of less than half a circle, of a held helm, with its indices.

    After an approach with a ``shortfall`` those are left out that depend on it.
    """
    execute = measures.helm_execute(motion, plateau)
    start, end = execute.order_s, float(motion.time_s[plateau.end - 1])
    part = motion.around(start, end, _CIRCLE_MARGIN_S)
    turned = motion.at("heading_deg", end) - motion.at("heading_deg", start)
    quarter_s = (end - start) * min(1.0, 90.0 / abs(turned))
    width = measures.smoothing_half_width_s(part, quarter_s)
    times, within_s = np.array([start, end]), np.array([execute.order_within_s, 0.5 * motion.step_s])
    measure = steady_turn_indices if shortfall else circle_indices
    estimates = measures.bootstrap_index_intervals(part, times, width, measure, within_s)
    current = current_from_turn(measures.smooth_motion(part, width), start, end)
    for way, time in _COUNTED_FOR.items():
        if current is not None and way + REMOVED in estimates:  # no better known than the drift over its time
            value, within = estimates[way + REMOVED]
            drift_m = np.hypot(current.north_within_mps, current.east_within_mps) * estimates[time][0]
            estimates[way + REMOVED] = value, float(np.hypot(within, drift_m))

    settings = {
        **measures.helm_settings(part, plateau.level, start, end),
        "turned_deg": abs(turned),
        "turning_rpm": float(part.between(start, end).main_rpm.mean()),
    }
    if shortfall:
        notes: tuple[str, ...] = (
            f"{shortfall}; advance, transfer, tactical diameter and times count from the order after one",
        )
        shortfalls: tuple[str, ...] = (shortfall,)
    else:
        notes, shortfalls = measures.execution_notes(motion, [execute], end)
        settings["half_command_s"] = execute.half_s - execute.order_s
        settings |= measures.approach_settings(part, start)
    is_circle = abs(turned) >= LEAST_CIRCLE_DEG
    kind, word = ("turning_circle", "turning circle") if is_circle else ("course_change", "turn")
    name = f"{word} {nominal_angle_deg(plateau.level):.0f} deg{_how_sailed(motion, settings)}"
    return measures.make_manoeuvre(
        motion, kind, name, times, side_of_sign(turned), settings, estimates, current=current, notes=notes,
        shortfalls=shortfalls,
    )  # fmt: skip


def _how_sailed(motion: Motion, settings: Mapping[str, float]) -> str:
    """The end of a test's name: of a ship that is steered by its propellers, and of one that went astern."""
    return " by thrust" * (motion.steering == BY_DIFFERENCE) + " astern" * ("approach_surge_mps" in settings)


def steady_turn_indices(motion: Motion, times: Floats) -> dict[str, float]:
    """Those of :func:`circle_indices` that need no approach: what is steady, also with the current removed."""
    values = circle_indices(motion, times)
    return {name: value for name, value in values.items() if name.removesuffix(REMOVED) in _STEADY}


def circle_indices(motion: Motion, times: Floats) -> dict[str, float]:
    """The indices of a smooth motion from the order to the end, ``times`` [s]; also with the current removed where
    it is known."""
    order, end = map(float, times)
    values = _indices_over_ground(motion, order, end)
    turned = abs(motion.at("heading_deg", end) - motion.at("heading_deg", order))
    if turned >= LEAST_TURN_DEG:
        north, east = drift_one_turn_apart(motion, order, end)
        if north.size:
            water = remove_current(motion, _mean_of_later_half(north), _mean_of_later_half(east), order)
            values |= {name + REMOVED: value for name, value in _indices_over_ground(water, order, end).items()
                       if not name.endswith(("_s", "_dps"))}  # fmt: skip
    return values


def _indices_over_ground(motion: Motion, start: float, end: float) -> dict[str, float]:
    """Indices from the order at ``start`` [s]: first those of the turn, then those of its settled part."""
    approach = measures.approach_state(motion, start)
    approach_mps, astern = approach["approach_mps"], "approach_surge_mps" in approach
    side = 1.0 if motion.at("heading_deg", end) > motion.at("heading_deg", start) else -1.0
    turned = side * (motion.heading_deg - approach["approach_unwrapped_deg"])
    ahead = approach["approach_unwrapped_deg"] + 180.0 * astern  # the course of the approach
    times = {
        angle: measures.first_crossing_s(motion.time_s, turned, angle, start, end)
        for angle in (10.0, 90.0, 180.0, 360.0)
    }
    values: dict[str, float] = {"initial_turning_m": measures.distance_m(motion, start, times[10.0])}
    if np.isfinite(times[90.0]):
        advance, transfer = measures.distance_ahead_and_to_starboard(motion, start, times[90.0], ahead)
        values |= {"advance_m": advance, "transfer_m": side * transfer}
    if np.isfinite(times[180.0]):
        values["tactical_diameter_m"] = (
            side * measures.distance_ahead_and_to_starboard(motion, start, times[180.0], ahead)[1]
        )
    values |= {f"time_to_{angle:.0f}_deg_s": time - start for angle, time in times.items() if angle >= 90.0}

    # The settled part takes whole turns where there are any: wind and current come from all sides in one and do not
    # change the means. It ends with the last quarter of a turn that was done, as the second at which a helm was
    # taken off is not known.
    total = 90.0 * np.floor(float(np.interp(end, motion.time_s, turned)) / 90.0)
    whole_turns_deg = 360.0 * np.floor((total - 180.0) / 360.0)
    if not np.isfinite(times[180.0]) or total <= 180.0:
        return values
    first_s, last_s = (
        measures.first_crossing_s(motion.time_s, turned, angle, times[180.0], end + motion.step_s)
        for angle in (total - whole_turns_deg if whole_turns_deg > 0 else 180.0, total)
    )
    steady = motion.between(first_s, last_s)
    if steady.time_s.size < 5:
        return values
    span = steady.time_s - steady.time_s.mean()
    rate_dps = float(abs(span @ steady.heading_deg) / (span @ span))
    speed, surge, sway = (
        measures.mean_between(motion, name, first_s, last_s) for name in ("speed_mps", "surge_mps", "sway_mps")
    )
    side = np.sign(steady.heading_deg[-1] - steady.heading_deg[0])
    return values | {
        "steady_yaw_rate_dps": rate_dps,
        "steady_diameter_m": 2.0 * speed / np.deg2rad(rate_dps),
        "steady_speed_mps": speed,
        "drift_angle_deg": float(side * np.rad2deg(np.arctan2(-sway, -surge if astern else surge))),
        "speed_loss": 1.0 - speed / approach_mps,
    }


def drift_one_turn_apart(motion: Motion, start: float, end: float) -> tuple[Floats, Floats]:
    """Drift north and east [m/s] from every pair of rows one turn apart, once the turn has settled."""
    inside = motion.between(start, end)
    turned = np.maximum.accumulate(np.abs(inside.heading_deg - inside.heading_deg[0]))
    rising = turned + 1e-9 * np.arange(turned.size)
    later = np.flatnonzero(turned >= _STEADY_AFTER_DEG + 360.0 - 1e-9)  # a row at the limit, however rounded
    then_s = np.interp(turned[later] - 360.0, rising, inside.time_s)
    span = inside.time_s[later] - then_s
    north = inside.north_m[later] - np.interp(then_s, inside.time_s, inside.north_m)
    east = inside.east_m[later] - np.interp(then_s, inside.time_s, inside.east_m)
    return north / span, east / span


def current_from_turn(motion: Motion, start: float, end: float) -> Current | None:
    """The drift with its interval, None if the ship turned less than 510 deg.

    Pairs of one circle share points, so that their spread is not divided by their number.
    """
    turned = abs(motion.at("heading_deg", end) - motion.at("heading_deg", start))
    if turned < LEAST_TURN_DEG:
        return None
    north, east = drift_one_turn_apart(motion, start, end)
    if north.size < _FEWEST_PAIRS:
        return None
    north_within, east_within = (float(1.96 * np.std(values)) for values in (north, east))
    return Current(_mean_of_later_half(north), _mean_of_later_half(east), north_within, east_within)


def _mean_of_later_half(values: Floats) -> float:
    """The mean of the later half of the pairs: in the first turn a large ship still loses way."""
    return float(values[values.size // 2 :].mean())


def remove_current(motion: Motion, north_mps: float, east_mps: float, start: float) -> Motion:
    """The motion through the water: path and speeds minus a steady current, the path fixed at ``start``."""
    passed = motion.time_s - start
    north, east = np.full(passed.size, north_mps), np.full(passed.size, east_mps)
    ahead, sideways = rotate_earth_to_ship(north, east, np.deg2rad(motion.heading_deg))
    return replace(
        motion,
        north_m=motion.north_m - north_mps * passed,
        east_m=motion.east_m - east_mps * passed,
        surge_mps=motion.surge_mps - ahead,
        sway_mps=motion.sway_mps - sideways,
    )


def shows_current(run: Manoeuvre) -> bool:
    """Whether a run shows the current itself, as a circle and a half does; others have it from such ones."""
    return run.current is not None and run.settings.get("turned_deg", 0.0) >= LEAST_TURN_DEG


def find_pull_outs(motion: Motion, held: Sequence[Plateau], rate: Floats, fastest_mps: float) -> list[Manoeuvre]:
    """Helms put amidships from a turn and held until the rate of turn has settled; ``rate`` is smoothed."""
    manoeuvres, noise = [], row_to_row_noise(motion.helm_deg)
    for last, following in pairwise(held):
        turned = motion.heading_deg[last.first : last.end]
        way = motion.speed_mps[following.first] > _LEAST_WAY * fastest_mps
        middle = abs(following.level) <= max(_AMIDSHIPS_DEG, _AMIDSHIPS_SHARE * abs(last.level)) < abs(last.level)
        turning = way and np.ptp(turned) >= _LEAST_TURN_DEG
        if not (turning and middle and _follows_directly(motion, last, following)):
            continue
        # The helm went directly to amidships, not beyond, and stayed there without course-keeping.
        between = motion.helm_deg[last.end : following.first + 1]
        beyond = float(np.max(-np.sign(last.level) * (between - following.level), initial=0.0))
        steady = following.spread <= _STILL_DEG + _SPREAD_OF_NOISE * noise
        if not (steady and beyond <= _AMIDSHIPS_DEG + 3.0 * noise):
            continue
        execute = measures.helm_execute(motion, following, last)
        half, settled_s = execute.half_s, float(motion.time_s[following.end - 1])
        begin, end = np.searchsorted(motion.time_s, [half, settled_s])
        after = rate[begin : end + 1]
        if after.size > 1:  # it ends after three times as long as the rate takes to reach its final value
            deviation = np.abs(after - np.median(after[-max(after.size // 4, 1) :]))
            unsettled = np.flatnonzero(deviation > _SETTLED_SHARE * deviation[0])
            settled_s = min(settled_s, half + max(3.0 * unsettled.size * motion.step_s, 2.0 * _LEAST_HELD_S))
        times = np.array([execute.order_s, settled_s])
        values = pull_out_indices(motion, times)
        if values and settled_s - half >= _LEAST_HELD_S:
            name, side = f"pull-out from {nominal_angle_deg(last.level):.0f} deg", float(turned[-1] - turned[0])
            scale_s = 4.0 * max(values["time_to_half_rate_s"], motion.step_s)
            test = "pull_out", name, side, last.level, times, [execute], pull_out_indices, scale_s
            manoeuvres.append(_measure_manoeuvre(motion, *test))
    return manoeuvres


def pull_out_indices(motion: Motion, times: Floats) -> dict[str, float]:
    """The rate of turn, and the residual rate with the helm amidships, positive to the side of the turn.

    ``times`` are the order amidships and the end [s]. Empty if the rate has not settled.
    """
    from scipy.optimize import isotonic_regression

    order, end = map(float, times)
    quarter_s = 0.25 * (end - order)
    spans = ((order - measures.APPROACH_S, order), (end - 2.0 * quarter_s, end - quarter_s), (end - quarter_s, end))
    before, third, last = (measures.mean_between(motion, "yaw_rate_dps", *span) for span in spans)
    if not abs(last - third) < _SETTLED_SHARE * abs(before):
        return {}
    side, decay = np.sign(before), abs(before - last)
    # Noise makes the first crossing of a level early; a curve that only rises has one.
    falling = motion.between(order, end)
    fallen = np.asarray(isotonic_regression(np.abs(falling.yaw_rate_dps - before)).x, dtype=float)
    fallen_s = measures.first_crossing_s(falling.time_s, fallen, 0.5 * decay, order, end)
    return {
        "turning_yaw_rate_dps": abs(before), "residual_yaw_rate_dps": float(side * last),
        "time_to_half_rate_s": fallen_s - order,
    }  # fmt: skip


def spiral_steps(motion: Motion, held: Sequence[Plateau]) -> list[list[Plateau]]:
    """Five and more helms held one after the other from one side to the other, or there and back, until the rate of
    turn has settled: three quarters of them at least, as an unstable ship passes quickly through small rates."""

    def is_next_helm(last: Plateau, following: Plateau) -> bool:
        return (
            _follows_directly(motion, last, following) and abs(following.level - last.level) > _LEAST_HELM_STEP_DEG
        )

    def has_settled(run: list[Plateau]) -> bool:
        settled = sum(_has_settled(motion, run, plateau) for plateau in run)
        return settled >= max(_FEWEST_STEPS, _SETTLED_STEPS * len(run))

    return _chain_plateaus(held, is_next_helm, has_settled)


def _chain_plateaus(
    held: Sequence[Plateau],
    is_next: Callable[[Plateau, Plateau], bool],
    is_valid: Callable[[list[Plateau]], bool],
) -> list[list[Plateau]]:
    """At least five valid steps of similar length from one side to the other, or there and back."""
    runs: list[list[Plateau]] = []
    for plateau in held:
        last = runs[-1] if runs else []
        follows = bool(last) and is_next(last[-1], plateau)
        if follows and (len(last) < 2 or (plateau.level - last[-1].level) * (last[-1].level - last[-2].level) > 0):
            last.append(plateau)
        else:
            runs.append([last[-1], plateau] if follows else [plateau])
    result: list[list[Plateau]] = []
    for run in runs:
        rows = [plateau.end - plateau.first for plateau in run]
        alike = min(rows) >= _LEAST_SHARE_OF_STEP * max(rows)
        if len(run) >= _FEWEST_STEPS and run[0].level * run[-1].level < 0 and alike and is_valid(run):
            goes_back = result and result[-1][-1] is run[0]
            result[-1:] = [[*result[-1], *run[1:]]] if goes_back else [*result[-1:], run]
    return result


def _has_settled(motion: Motion, run: Sequence[Plateau], plateau: Plateau) -> bool:
    """Whether the rate of turn changes little in the second half of a step, relative to its range in the run."""
    if plateau.end - plateau.first < 4:
        return False
    rates = np.array_split(motion.yaw_rate_dps[plateau.first : plateau.end], 4)
    largest = float(np.percentile(np.abs(motion.yaw_rate_dps[run[0].first : run[-1].end]), 95))
    return bool(abs(rates[3].mean() - rates[2].mean()) < 2.0 * _SETTLED_SHARE * largest)


def make_spiral(motion: Motion, steps: list[Plateau]) -> Manoeuvre:
    """The direct spiral of its steps, with its indices."""
    times = motion.time_s[[row for step in steps for row in (step.first, step.end - 1)]]
    sign = motion.turns_to_starboard
    levels = sign * np.array([motion.helm_deg[(step.first + step.end) // 2 : step.end].mean() for step in steps])
    settled = np.array([_has_settled(motion, steps, step) for step in steps])

    def measure(part: Motion, spans: Floats) -> dict[str, float]:
        return spiral_indices(part, levels, spans.reshape(-1, 2), settled)

    largest = max(steps, key=lambda step: abs(step.level)).level
    name = f"direct spiral {nominal_angle_deg(largest):.0f} deg"
    manoeuvre = _measure_manoeuvre(motion, "spiral", name, float(levels[0]), largest, times, [], measure)
    rows = 0.5 * min(step.end - step.first for step in steps)
    helm_within = 1.96 * float(row_to_row_noise(motion.helm_deg) / np.sqrt(rows))  # of the mean helm of a step
    slope = manoeuvre.indices.get("yaw_rate_per_helm_dps")
    margins = {
        "neutral_helm_deg": helm_within,
        "yaw_rate_at_no_helm_dps": (abs(slope.value) if slope else 0.0) * helm_within,
    }
    indices = {}
    for name, index in manoeuvre.indices.items():
        within = float(np.hypot(0.5 * (index.high - index.low), margins.get(name, 0.0)))
        indices[name] = replace(index, low=index.value - within, high=index.value + within)
    left_out = [f"step {number} at {levels[number - 1]:.1f} deg" for number in np.flatnonzero(~settled) + 1]
    notes = (f"the rate of turn had not settled, left out: {', '.join(left_out)}",) if left_out else ()
    return replace(manoeuvre, indices=indices, notes=notes)


def spiral_indices(motion: Motion, levels: Floats, spans: Floats, settled: Bools) -> dict[str, float]:
    """The settled rate of turn of each step, the helm at which the ship would go straight, how steep the curve is
    there; of a spiral there and back the height of its loop at no helm.

    ``levels`` [steps] are the helms [deg], positive to starboard, ``spans`` [steps, 2] begin and end of each [s];
    those that have not ``settled`` [steps] are left out.
    """
    levels, spans = levels[settled], spans[settled]
    rates = np.array([motion.between(0.5 * (begin + end), end).yaw_rate_dps.mean() for begin, end in spans])
    numbers = np.flatnonzero(settled) + 1
    values = {f"yaw_rate_step_{number}_dps": float(rate) for number, rate in zip(numbers, rates, strict=True)}
    turn = 1 + int(np.argmax(np.append(np.diff(np.sign(np.diff(levels))) != 0, True)))  # where it goes back
    neutral, heights = list[float](), list[float]()
    for leg in (slice(0, turn + 1), *([slice(turn, None)] if turn + 1 < levels.size else [])):
        by_rate, by_level = np.argsort(rates[leg]), np.argsort(levels[leg])
        neutral.append(float(np.interp(0.0, rates[leg][by_rate], levels[leg][by_rate])))
        heights.append(float(np.interp(0.0, levels[leg][by_level], rates[leg][by_level])))
    values["neutral_helm_deg"] = float(np.mean(neutral))
    values["yaw_rate_at_no_helm_dps"] = float(np.mean(heights))
    near = np.argsort(np.abs(levels))[:3]
    if np.ptp(levels[near]) > 0.0:
        values["yaw_rate_per_helm_dps"] = float(np.polyfit(levels[near], rates[near], 1)[0])
    if len(heights) > 1:
        values["loop_height_dps"] = abs(heights[1] - heights[0])
    return values


def reverse_spiral_steps(motion: Motion, rate: Floats, free: Bools) -> list[list[Plateau]]:
    """At least five rates of turn held one after the other from one side to the other, or there and back.

    ``rate`` is the smoothed rate of turn, ``free`` where no other manoeuvre is. The ship spends less time
    between the steps than on them, otherwise the rate only drifts; and the helm is not held on them. By hand a
    rate is held unevenly: of the rate and its running means the one with most steps is used.
    """
    candidates = [rate, *(local_quadratic(rate, width / motion.step_s) for width in _WIDER_S)]
    usable = free & ~motion.broken
    return max(
        (_rate_steps(motion, candidate, usable) for candidate in candidates), key=lambda runs: sum(map(len, runs))
    )


def _rate_steps(motion: Motion, rate: Floats, usable: Bools) -> list[list[Plateau]]:
    largest = float(np.percentile(np.abs(rate[usable]), 99)) if usable.any() else 0.0
    band = max(_BAND_SHARE * largest, _BAND_OF_NOISE * row_to_row_noise(rate))
    still = _STILL_DEG + _SPREAD_OF_NOISE * row_to_row_noise(motion.helm_deg)

    def join(last: Plateau, following: Plateau) -> Plateau | None:
        """One rate interrupted by a gust; the pieces of a ramp are a whole band apart."""
        near = abs(following.level - last.level) < 0.5 * band
        return Plateau(last.first, following.end, 0.5 * (last.level + following.level), band) if near else None

    def is_next_rate(last: Plateau, following: Plateau) -> bool:
        pause, shorter = following.first - last.end, min(following.end - following.first, last.end - last.first)
        return pause <= shorter and abs(following.level - last.level) > 2.0 * band

    def is_steered(run: list[Plateau]) -> bool:
        """Whether the rates were held most of the time, by a helm that was not."""
        second_halves = (motion.helm_deg[(plateau.first + plateau.end) // 2 : plateau.end] for plateau in run)
        spreads = [np.ptp(np.percentile(helm, [10, 90])) for helm in second_halves]
        held_rows = sum(plateau.end - plateau.first for plateau in run)
        return held_rows > _HELD_SHARE * (run[-1].end - run[0].first) and float(np.median(spreads)) > still

    steps = list[Plateau]()
    for first, end in runs_of_true(usable, round(_LEAST_HELD_S / motion.step_s)):
        pieces, start, low, high = list[Plateau](), first, rate[first], rate[first]
        for row in range(first, end):  # pieces in which the rate stays within the band
            low, high = min(low, rate[row]), max(high, rate[row])
            if high - low > band or row == end - 1:
                pieces.append(Plateau(start, row, float(np.median(rate[start : row + 1])), float(high - low)))
                start, low, high = row, rate[row], rate[row]
        steps += measures.merge_neighbours(pieces, join)
    held = [plateau for plateau in steps if (plateau.end - plateau.first) * motion.step_s >= _LEAST_HELD_S]
    return _chain_plateaus(held, is_next_rate, is_steered)


def make_reverse_spiral(motion: Motion, steps: list[Plateau]) -> Manoeuvre:
    """The reverse spiral (Bech) of its steps: the mean helm for each rate, over its second half."""
    sign, random = motion.turns_to_starboard, np.random.default_rng(_SEED)
    parts = [slice((step.first + step.end) // 2, step.end) for step in steps]
    helms, rates = (np.array([measures.mean_and_half_interval(values[part]) for part in parts])
                    for values in (sign * motion.helm_deg, motion.yaw_rate_dps))  # fmt: skip
    values = reverse_spiral_indices(helms[:, 0], rates[:, 0])
    drawn = [
        reverse_spiral_indices(*(means[:, 0] + means[:, 1] / 1.96 * random.standard_normal(len(steps))
                                 for means in (helms, rates)))
        for _ in range(_DRAWS)
    ]  # fmt: skip
    estimates = {name: (value, 1.96 * float(np.nanstd([sample[name] for sample in drawn])))
             for name, value in values.items() if np.isfinite(value)}  # fmt: skip
    start, end = float(motion.time_s[steps[0].first]), float(motion.time_s[steps[-1].end - 1])
    largest = float(np.max(np.abs(rates[:, 0])))
    settings = {"steps": float(len(steps)), **measures.approach_settings(motion, start)}
    name, side = f"reverse spiral {largest:.2g} deg/s", side_of_sign(float(rates[0, 0]))
    return measures.make_manoeuvre(
        motion, "reverse_spiral", name, np.array([start, end]), side, settings, estimates
    )


def reverse_spiral_indices(helms: Floats, rates: Floats) -> dict[str, float]:
    """The mean helm of each rate, the helm at which the ship goes straight, and how much helm a rate takes there.

    ``helms`` [steps, deg] are positive to starboard. Where the curve goes back in the middle, so that more rate
    takes less helm, the ship does not keep its course: ``unstable_helm_width_deg`` is how far back it goes.
    """
    order = np.argsort(rates)
    helms, rates = helms[order], rates[order]
    near = np.argsort(np.abs(rates))[:3]
    falls = np.maximum.accumulate(helms) - helms
    values = {f"helm_step_{number}_deg": float(helm) for number, helm in enumerate(helms, start=1)}
    return values | {
        "neutral_helm_deg": float(np.interp(0.0, rates, helms)),
        "helm_per_yaw_rate_s": float(np.polyfit(rates[near], helms[near], 1)[0]),
        "unstable_helm_width_deg": float(falls.max() or np.nan),
    }


def find_williamson_turns(motion: Motion, held: Sequence[Plateau]) -> list[Manoeuvre]:
    """Williamson turns: helm to one side until the heading is some 60 deg off, then to the other until the
    reciprocal course."""
    manoeuvres = []
    for last, following in pairwise(held):
        counter = measures.is_same_order(last.level, -following.level)
        if not (counter and _follows_directly(motion, last, following)):
            continue
        executes = [measures.helm_execute(motion, last), measures.helm_execute(motion, following, last)]
        first, second = (execute.order_s for execute in executes)
        course = measures.approach_state(motion, first)["approach_unwrapped_deg"]
        end = float(motion.time_s[min(2 * following.end - following.first, motion.time_s.size) - 1])
        side = float(np.sign(motion.at("heading_deg", second) - course))
        out, back = (side * (motion.at("heading_deg", at) - course) for at in (second, end))
        if _OUT_DEG[0] < out < _OUT_DEG[1] and _BACK_DEG[0] < -back < _BACK_DEG[1]:
            times = np.array([first, second, end])
            name = f"Williamson turn {nominal_angle_deg(last.level):.0f} deg"
            test = "williamson_turn", name, side, last.level, times, executes, williamson_indices
            manoeuvres.append(_measure_manoeuvre(motion, *test))
    return manoeuvres


def williamson_indices(motion: Motion, times: Floats) -> dict[str, float]:
    """Where and when the ship is on the reciprocal course, within 5 deg.

    How far ahead of the first execute, how far to starboard of the first track, after how long; and how far off the
    course at the second execute. ``times`` are both orders and the end [s].
    """
    first, second, end = map(float, times)
    course = measures.approach_state(motion, first)["approach_unwrapped_deg"]
    side = np.sign(motion.at("heading_deg", second) - course)
    back = -side * (motion.heading_deg - course)
    reached = measures.first_crossing_s(motion.time_s, back, 175.0, second, end)
    ahead, across = (
        measures.distance_ahead_and_to_starboard(motion, first, reached, course)
        if np.isfinite(reached)
        else (np.nan, np.nan)
    )
    return {
        "heading_at_second_execute_deg": abs(motion.at("heading_deg", second) - course),
        "time_to_reciprocal_s": reached - first, "way_ahead_m": ahead, "track_offset_m": across,
    }  # fmt: skip


def _follows_directly(motion: Motion, last: Plateau, following: Plateau) -> bool:
    """Whether the helm goes from one level to the next without stopping in between."""
    pause_s = (following.first - last.end) * motion.step_s
    return (
        pause_s <= 4.0 + measures.longest_helm_change_s(motion, following.level - last.level)
        and not motion.broken[last.first : following.end].any()
    )


def _measure_manoeuvre(
    motion: Motion,
    kind: str,
    name: str,
    side: float,
    helm_deg: float,
    times: Floats,
    executes: Sequence[Execute],
    measure: Measure,
    scale_s: float = np.inf,
) -> Manoeuvre:
    """A test with its indices; ``times`` are those of its ``executes``, others and the end [s]; what it does takes
    ``scale_s`` or less."""
    part = motion.around(float(times[0]), float(times[-1]), _MARGIN_S)
    width = measures.smoothing_half_width_s(part, min(scale_s, float(times[-1] - times[0]) / times.size))
    within_s = np.full(times.size, 0.5 * motion.step_s)
    within_s[: len(executes)] = [execute.order_within_s for execute in executes]
    estimates = measures.bootstrap_index_intervals(part, times, width, measure, within_s)
    settings = {motion.helm_setting: helm_deg, **measures.approach_settings(part, float(times[0]))}
    if executes:
        settings["half_command_s"] = executes[0].half_s - executes[0].order_s
    return measures.make_manoeuvre(motion, kind, name, times[[0, -1]], side_of_sign(side), settings, estimates)
