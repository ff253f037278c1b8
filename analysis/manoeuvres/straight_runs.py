"""Runs without helm: speed runs and reciprocal pairs, accelerations, stops, tests of single drives, crabbing."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from datetime import datetime
from itertools import combinations, pairwise
from typing import NamedTuple

import numpy as np

from seatrial.acquisition.core.quantities import Bools, Floats
from seatrial.acquisition.core.ship import angle_difference, circular_mean, wrap_360
from seatrial.analysis.manoeuvres import criteria, measures
from seatrial.analysis.manoeuvres.indices import LeftOut, Manoeuvre, index_from_value, side_of_sign
from seatrial.analysis.manoeuvres.motion import Motion, row_to_row_noise, runs_of_true
from seatrial.analysis.tables.table import NANO

_LOOK_S = 10.0
_STRAIGHT_DEG, _SWINGING_DEG = 3.0, 5.0
_STEADY_SHARE = 0.04
LEAST_RUN_S, _LEAST_HELD_S = 30.0, 5.0
_IDLE_SHARE, _UNDER_WAY_SHARE = 0.08, 0.25
_STOPPED_SHARE, _AT_REST_SHARE = 0.6, 0.1
_STEP_SHARE = 0.1
_GAIN_SHARE = 0.15
RECIPROCAL_DEG, _SAME_SHARE, LONGEST_BETWEEN_S = 12.0, 0.03, 2 * 3600.0
REACHED_SHARE = 0.9
_LONGEST_STEP_S = 16.0  # what a shaft may creep before and after a change from one held speed to the next
_TRIED_STARTS = 9
_UNSURE_SHARE = 0.2  # of the time that half of a change of thrust takes: engines do not begin like a straight line
_BY_SHAFT = "the order was not recorded: it is taken from the beginning of the shaft's change"
_SHAFT_CONTRADICTS = "the recorded orders do not precede the shaft"
_LONGEST_ENGINE_LAG_S = 60.0  # from an order to the first change of the shaft
_LONGEST_PAUSE_S = 180.0  # until an engine turns astern: large ones wait for the shaft to slow down
_UNSETTLED_SHARE = 0.25  # of the loss of speed is still to come: a pause in thrust that has no speed of its own
_HAND_S = 2.0  # by which a mark set by hand is early or late
_ENGINE_ORDER = re.compile(
    r"\bfull astern\b|\b(crash|emergency|inertia) stop\b(?!\W*(end|finish|complete))|\bstop(ped)? engines?\b"
    r"|\bengines? stop(ped)?\b|^\W*stop\W*$", re.I,
)  # fmt: skip
_RUNNING_SHARE = 0.2
_NOISE_SIGMAS = 10.0
_LEAST_RUNNING = 5.0
_LEAST_S, _BRIDGE_S = 15.0, 5.0
_CRAB_SHARE, _CRAB_LEAST_MPS, _CRAB_LEAST_S = 1.5, 0.15, 20.0
_CRAB_TURN_DEG = 15.0
_UNSURE_ROWS = 1.5  # the start of a drive is found by a threshold, not by a fit


def equivalent_shaft_speed_rpm(motion: Motion) -> Floats:
    """The shaft speed of equal drives facing forward with the same surge thrust [rpm]."""
    return np.asarray(np.sign(motion.thrust) * np.sqrt(np.abs(motion.thrust) / len(motion.drives)))


def shaft_plateaus(motion: Motion) -> list[measures.Plateau]:
    """The plateaus of the surge thrust."""
    along = equivalent_shaft_speed_rpm(motion)
    largest = float(np.percentile(np.abs(along), 99))
    # The square root magnifies an idle shaft's noise: it is limited to a running one's.
    return measures.find_plateaus(
        along, motion.step_s, max(0.03 * largest, 6.0 * motion.drive_noise_rpm, 1.0), _LEAST_HELD_S
    )


def _changes_within_look(values: Floats, step_s: float) -> Floats:
    """How much ``values`` change over twice the looking distance, one-sided at the ends."""
    rows, places = max(1, round(_LOOK_S / step_s)), np.arange(values.size)
    return np.asarray(values[np.minimum(places + rows, values.size - 1)] - values[np.maximum(places - rows, 0)])


def straight_row_mask(smooth: Motion) -> Bools:
    """Mask of rows in which the smoothed heading changes by less than 3 deg in 20 s."""
    return np.abs(_changes_within_look(smooth.heading_deg, smooth.step_s)) < _STRAIGHT_DEG


def steady_row_mask(smooth: Motion) -> Bools:
    """Mask of rows in which the smoothed surge speed changes by less than 4 % in 20 s."""
    change = np.abs(_changes_within_look(smooth.surge_mps, smooth.step_s))
    return change < _STEADY_SHARE * np.maximum(np.abs(smooth.surge_mps), 0.25 * smooth.fastest_mps)


def straight_stretches(motion: Motion, smooth: Motion, free: Bools, bridge_s: float = 0.0) -> list[tuple[int, int]]:
    """First row and end of the steady straight stretches at one ahead shaft speed of at least half a minute.

    Breaks shorter than ``bridge_s``, such as gusts, are bridged.
    """
    good = free & straight_row_mask(smooth) & steady_row_mask(smooth) & motion.measured
    good &= smooth.surge_mps > _UNDER_WAY_SHARE * smooth.fastest_mps
    spans = list[tuple[int, int]]()
    for held in shaft_plateaus(motion):
        if held.level <= 0.0:
            continue
        inside = np.zeros(good.size, dtype=bool)
        inside[held.first : held.end] = good[held.first : held.end]
        inside = close_gaps_in_mask(inside, round(bridge_s / motion.step_s))
        spans += runs_of_true(inside, round(LEAST_RUN_S / motion.step_s))
    return sorted(spans)


def find_speed_runs(motion: Motion, smooth: Motion, free: Bools) -> list[Manoeuvre | LeftOut]:
    """The steady straight stretches at one shaft speed of at least half a minute, with reciprocal pairs marked.

    Rejected are those with a slow turn, or a trend of the speed.
    """
    candidates = dict[tuple[int, int], str]()
    for first, end in straight_stretches(motion, smooth, free):
        # without its beginning, where the ship regains speed after a turn; all of it if less than half is level
        starts = np.linspace(first, 0.5 * (first + end), _TRIED_STARTS).astype(int)
        long = [start for start in starts if (end - start) * smooth.step_s >= LEAST_RUN_S]
        start = next((start for start in long if not why_no_speed_run(motion, smooth, start, end)), first)
        candidates[start, end] = why_no_speed_run(motion, smooth, start, end)
    runs, left_out = list[Manoeuvre](), list[LeftOut]()
    for (first, end), why in candidates.items():
        part = motion.rows(first, end)
        span = part.time_s[[0, -1]]
        if why:
            left_out.append(LeftOut("speed_run", motion.utc(span[0]), motion.utc(span[1]), why))
            continue
        heading = float(wrap_360(circular_mean(part.heading_deg)))
        columns = {"speed_over_ground_mps": "speed_mps", "surge_mps": "surge_mps", "sway_mps": "sway_mps"}
        estimates = {
            name: measures.mean_and_half_interval(getattr(part, column)) for name, column in columns.items()
        }
        estimates["distance_m"] = (measures.distance_m(part, *span), float("nan"))
        name = f"speed run {part.main_rpm.mean():.0f} rpm on {round(heading) % 360} deg"
        duration_s = float(span[1] - span[0])
        settings = {**measures.means_by_column(part.drives), "heading_deg": heading, "duration_s": duration_s}
        runs.append(measures.make_manoeuvre(motion, "speed_run", name, span, "", settings, estimates))
    return [*_pair_reciprocal(runs), *left_out]


def why_no_speed_run(motion: Motion, smooth: Motion, first: int, end: int) -> str:
    """The reason why a stretch is no speed run, "" if it is: its heading and speed must have no trend, and the
    heading, which is smoothed for that, must not swing as in a zigzag of brief swings."""
    rows = np.linspace(-0.5, 0.5, end - first)
    turned, gained = (float(rows @ values[first:end] / (rows @ rows))
                      for values in (smooth.heading_deg, smooth.surge_mps))  # fmt: skip
    if abs(turned) > _STRAIGHT_DEG:
        return f"the ship turned by {abs(turned):.0f} deg"
    if (swing := float(np.std(motion.heading_deg[first:end] - turned * rows))) > _SWINGING_DEG:
        return f"the heading swung by {np.sqrt(2.0) * swing:.0f} deg to either side"
    if abs(gained) > _STEADY_SHARE * float(smooth.surge_mps[first:end].mean()):
        return f"the speed changed by {abs(gained):.2f} m/s"
    return ""


class Course(NamedTuple):
    """The quantities that pair runs; the ``setting`` is the shaft speed, or another measure of the power."""

    start: datetime
    end: datetime
    heading_deg: float
    setting: float


def reciprocal_pairs(runs: Sequence[Course]) -> list[tuple[int, int]]:
    """The indices of runs, in order of time, on reciprocal courses at one setting within two hours.

    Of several partners the nearest in time is taken; each run has at most one.
    """
    pairs, taken = list[tuple[int, int]](), set[int]()
    for pair in combinations(range(len(runs)), 2):
        first, second = (runs[place] for place in pair)
        soon = (second.start - first.end).total_seconds() < LONGEST_BETWEEN_S
        if soon and is_same_setting(first.setting, second.setting) and not taken & {*pair}:
            turn_deg = abs(float(angle_difference(second.heading_deg, first.heading_deg)))
            if abs(turn_deg - 180.0) < RECIPROCAL_DEG:
                pairs.append(pair)
                taken |= {*pair}
    return pairs


def is_same_setting(first: float, second: float) -> bool:
    """Whether two runs at these shaft speeds have the same power setting."""
    return abs(second - first) < _SAME_SHARE * abs(first)


def _pair_reciprocal(runs: Sequence[Manoeuvre]) -> list[Manoeuvre]:
    """Reciprocal runs with the speed through the water from the pair."""
    result = list(runs)
    shafts_rpm = [sum(value for name, value in run.settings.items() if name.endswith("_rpm")) for run in runs]
    courses = [Course(run.start, run.end, run.settings["heading_deg"], rpm)
               for run, rpm in zip(runs, shafts_rpm, strict=True)]  # fmt: skip
    for number, pair in enumerate(reciprocal_pairs(courses), start=1):
        first, second = (runs[place].indices["surge_mps"] for place in pair)
        within = float(np.hypot(first.high - first.low, second.high - second.low)) / 4.0
        mean = index_from_value("speed_through_water_mps", (first.value + second.value) / 2.0, within)
        along_mps = (first.value - second.value) / 2.0
        for place, sign in zip(pair, (1.0, -1.0), strict=True):
            current = index_from_value("current_along_mps", sign * along_mps, within)
            result[place] = replace(
                runs[place],
                settings={**runs[place].settings, "reciprocal_pair": float(number)},
                indices={**runs[place].indices, "speed_through_water_mps": mean, "current_along_mps": current},
            )
    return result


class ShaftStep(NamedTuple):
    """A change from one held thrust to the next, with the moment of the order and half of what it is known within
    [s].

    ``source`` says where the order is known from. ``lag_s`` is how much earlier it may have been, where only the
    shaft tells. ``contradicts`` says that orders were recorded, but none that the shaft could have followed.
    """

    last: measures.Plateau
    held: measures.Plateau
    order_s: float
    within_s: float
    source: str = ""
    lag_s: float = 0.0
    contradicts: bool = False


def engine_orders(motion: Motion, events: Iterable[tuple[int, str]]) -> list[tuple[float, str]]:
    """The orders to stop or reverse the engines among the marks of the crew (time [ns since 1970], text): when [s],
    and their words."""
    return [
        ((time_ns - motion.origin_ns) / NANO, text.strip())
        for time_ns, text in events
        if _ENGINE_ORDER.search(text)
    ]


def shaft_steps(motion: Motion, free: Bools, marks: Sequence[tuple[float, str]] = ()) -> list[ShaftStep]:
    """Every change from one held thrust to the next, where no other manoeuvre is.

    It counts from the recorded order that it follows, else from the mark of one, else from the shaft.
    """
    along = equivalent_shaft_speed_rpm(motion)
    least, steps = measures.command_noise_tolerance(along, 1.0), list[ShaftStep]()
    for last, held in pairwise(shaft_plateaus(motion)):
        if not free[max(held.first - 1, 0)] or abs(held.level - last.level) <= least:
            continue
        change_s = (held.first - last.end) * motion.step_s  # a large shaft takes a minute and more to reverse
        before = measures.level_before_plateau(motion, along, held, _LONGEST_STEP_S + change_s)
        start, half = measures.execute_times_s(motion.time_s, along, held, before, last.first)
        within_s = float(np.hypot(motion.step_s, _UNSURE_SHARE * (half - start)))
        step = ShaftStep(last, held, start, within_s, _BY_SHAFT, max(half - start, motion.step_s))
        latest_s = start + max(motion.step_s, within_s)
        earliest_s = max(start - _LONGEST_ENGINE_LAG_S, float(motion.time_s[last.first]))
        if motion.thrust_order is not None:
            near = motion.between(earliest_s, latest_s + motion.step_s)
            ordered = np.asarray(near.thrust_order)
            change = np.sign(held.level - last.level) * (ordered - ordered[0])
            if change[-1] > _STEP_SHARE * float(np.percentile(np.abs(motion.thrust_order), 99)):
                end_s = latest_s + 2.0 * motion.step_s
                ordered_s = measures.first_crossing_s(near.time_s, change, 0.5 * change[-1], earliest_s, end_s)
                steps.append(ShaftStep(last, held, ordered_s, 0.5 * motion.step_s))
                continue
            step = step._replace(contradicts=True)
        hand = [mark for mark in marks if earliest_s <= mark[0] <= latest_s + _HAND_S]
        if hand and held.level <= last.level:
            time_s, text = hand[-1]
            source = f"the order is taken from the mark '{text}'"
            step = step._replace(order_s=time_s, within_s=_HAND_S, source=source, lag_s=0.0)
        steps.append(step)
    return steps


def _join_reductions(smooth: Motion, steps: Iterable[ShaftStep]) -> list[ShaftStep]:
    """The steps, with reductions of thrust that follow soon upon each other as one from the first order: an engine
    stops, or is turned by the water, before it reverses."""
    joined = list[ShaftStep]()
    for step in steps:
        first = joined[-1] if joined else step
        between = step.last
        is_reduction = first.held is between and step.held.level < between.level < first.last.level
        if is_reduction and step.held.first * smooth.step_s - first.order_s <= _LONGEST_PAUSE_S:
            before_mps, then_mps = (smooth.at("surge_mps", at.order_s) for at in (first, step))
            settled_mps = before_mps * max(between.level, 0.0) / first.last.level  # the speed of the thrust between
            if then_mps - settled_mps > _UNSETTLED_SHARE * (before_mps - settled_mps):
                pause_s = (between.end - between.first) * smooth.step_s
                paused = (
                    f"the thrust was taken off in steps, with a pause of {pause_s:.0f} s: the way is from the first"
                )
                source = "; ".join(filter(None, (first.source, paused)))
                joined[-1] = first._replace(held=step.held, source=source)
                continue
        joined.append(step)
    return joined


def find_accelerations(motion: Motion, smooth: Motion, free: Bools) -> list[Manoeuvre | LeftOut]:
    """Increases of thrust on a straight course, until the speed is steady; rejected if the ship turns."""
    largest = float(np.percentile(np.abs(equivalent_shaft_speed_rpm(motion)), 99))
    straight, steady = straight_row_mask(smooth), steady_row_mask(smooth)
    candidates = list[Manoeuvre | LeftOut]()
    for step in shaft_steps(motion, free):
        last, held, start = step[:3]
        rows = slice(held.first, held.end)
        long = (held.end - held.first) * motion.step_s >= LEAST_RUN_S
        if not long or held.level < _IDLE_SHARE * largest or held.level - last.level < _STEP_SHARE * largest:
            continue
        settled = np.flatnonzero(steady[rows])
        if not settled.size:
            continue
        end = float(motion.time_s[held.end - 1])
        gain = smooth.surge_mps[held.end - 1] - smooth.at("surge_mps", start)
        if gain <= _GAIN_SHARE * smooth.surge_mps[held.end - 1] or free[rows].mean() <= 0.9:
            continue
        if straight[rows].mean() >= 0.9:
            candidates.append(_measure_speed_change(motion, "acceleration", step, end))
        else:
            turned = float(np.ptp(smooth.heading_deg[rows]))
            why = f"the ship turned by {turned:.0f} deg"
            candidates.append(LeftOut("acceleration", motion.utc(start), motion.utc(end), why))
    return candidates


def find_stops(
    motion: Motion, smooth: Motion, free: Bools, marks: Sequence[tuple[float, str]] = ()
) -> list[Manoeuvre | LeftOut]:
    """Thrust stopped or reversed under way, until the ship has stopped; ``marks`` are the crew's orders.

    Rejected if the ship still has more than a tenth of its speed at the end; a loss of less than two fifths is no
    candidate.
    """
    largest = float(np.percentile(np.abs(equivalent_shaft_speed_rpm(motion)), 99))
    candidates = list[Manoeuvre | LeftOut]()
    for step in _join_reductions(smooth, shaft_steps(motion, free, marks)):
        last, held, start = step[:3]
        before = smooth.at("surge_mps", start)
        is_stop = held.level < _IDLE_SHARE * largest < _UNDER_WAY_SHARE * largest < last.level
        after = smooth.surge_mps[held.first : held.end]
        if not is_stop or before < _UNDER_WAY_SHARE * smooth.fastest_mps or after.min() > _STOPPED_SHARE * before:
            continue
        stopped = np.flatnonzero(after <= 0.0)
        row = held.first + int(stopped[0]) if stopped.size else held.end - 1
        end, residual_mps = float(motion.time_s[row]), float(smooth.surge_mps[row])
        if residual_mps > _AT_REST_SHARE * before:
            ended = held.end >= motion.time_s.size or bool(motion.broken[held.end])
            when = "the recording ended" if ended else "the thrust changed again"
            why = f"the ship still made {residual_mps:.2f} m/s when {when}"
            candidates.append(LeftOut("stopping", motion.utc(start), motion.utc(end), why))
        else:
            candidates.append(_measure_speed_change(motion, "stopping", step, end))
    return candidates


def _measure_speed_change(motion: Motion, kind: str, step: ShaftStep, end: float) -> Manoeuvre:
    last, held, start, within_s = step[:4]
    part = motion.around(start, end, 20.0)
    measure = acceleration_indices if kind == "acceleration" else stopping_indices
    span, width = np.array([start, end]), measures.smoothing_half_width_s(part, (end - start) / 2.0)
    estimates = measures.bootstrap_index_intervals(part, span, width, measure, within_s)
    reverse = held.level < -_IDLE_SHARE * abs(last.level)
    names = {"acceleration": f"acceleration to {held.level:.0f} rpm",
             "stopping": criteria.FULL_ASTERN if reverse else "stopping without thrust"}  # fmt: skip
    settings = {
        "thrust_before_rpm": last.level,
        "thrust_rpm": held.level,
        **measures.approach_settings(part, start),
    }
    if step.lag_s:
        settings["order_lag_s"] = step.lag_s
    shortfalls = (_SHAFT_CONTRADICTS,) if step.contradicts else ()
    notes = tuple(note for note in (*shortfalls, step.source) if note)
    run = measures.make_manoeuvre(
        motion, kind, names[kind], span, "", settings, estimates, notes=notes, shortfalls=shortfalls
    )
    # The order may have been given earlier than the shaft began to change: what counts from it may be longer.
    margins = {"_s": step.lag_s, "_m": step.lag_s * abs(settings["approach_mps"])}
    indices = {
        name: replace(index, high=index.high + margins.get(name[name.rfind("_"):], 0.0))
        for name, index in run.indices.items() if name != "lateral_deviation_m"
    }  # fmt: skip
    return replace(run, indices={**run.indices, **indices})


def acceleration_indices(motion: Motion, executes: Floats) -> dict[str, float]:
    """Time and distance to 90 % of the change of speed; ``executes`` holds the start and the end of the thrust
    [s]."""
    from scipy.optimize import isotonic_regression

    start, end = float(executes[0]), float(executes[1])
    final = float(motion.between(end - max(_LOOK_S, 0.2 * (end - start)), end).surge_mps.mean())
    first = float(motion.between(start - _LOOK_S, start).surge_mps.mean())
    goal = first + REACHED_SHARE * (final - first)
    # Noise makes the first crossing early and the last one late; a monotonic curve has only one.
    rising = motion.between(start, end)
    speed = np.asarray(isotonic_regression(rising.surge_mps).x, dtype=float)
    reached = measures.first_crossing_s(rising.time_s, speed, goal, start, end)
    return {
        "initial_speed_mps": first,
        "final_speed_mps": final,
        "time_to_90_percent_s": reached - start,
        "distance_to_90_percent_m": measures.distance_m(motion, start, reached),
    }


def stopping_indices(motion: Motion, executes: Floats) -> dict[str, float]:
    """Head reach, track reach, deviation and time from the order to the end; ``executes`` holds both [s]."""
    start, end = float(executes[0]), float(executes[1])
    heading = float(motion.between(start - _LOOK_S, start).heading_deg.mean())
    ahead, sideways = measures.distance_ahead_and_to_starboard(motion, start, end, heading)
    return {
        "head_reach_m": ahead,
        "track_reach_m": measures.distance_m(motion, start, end),
        "lateral_deviation_m": sideways,
        "stopping_time_s": end - start,
        "initial_speed_mps": measures.mean_between(motion, "surge_mps", start - _LOOK_S, start),
        "final_speed_mps": motion.at("surge_mps", end),
        "heading_change_deg": motion.at("heading_deg", end) - heading,
    }


def _running_and_idle(values: Floats, largest: float) -> tuple[Bools, Bools]:
    """Masks of where a drive runs and where it is stopped, relative to the largest of its kind. A drive that is
    put to and fro every few rows looks noisy, and yet does not idle."""
    floor, running = max(_NOISE_SIGMAS * row_to_row_noise(values), _LEAST_RUNNING), _RUNNING_SHARE * largest
    idle = max(_IDLE_SHARE * largest, min(floor, running))
    return np.abs(values) > max(running, floor), np.abs(values) < idle


def close_gaps_in_mask(mask: Bools, rows: int) -> Bools:
    """``mask`` with gaps of at most ``rows`` closed."""
    result = mask.copy()
    for first, end in runs_of_true(~mask):
        if first > 0 and end < mask.size and end - first <= rows:
            result[first:end] = True
    return result


def find_thruster_tests(motion: Motion, smooth: Motion, free: Bools) -> list[Manoeuvre | LeftOut]:
    """Tests of single drives: one of several main shafts alone for at least a quarter of a minute, and every
    run of a tunnel thruster."""
    largest = max(float(np.percentile(np.abs(shaft_rpm), 99)) for shaft_rpm in motion.drives.values())
    state = {name: _running_and_idle(rpm, largest) for name, rpm in motion.drives.items()}
    alike = _logical_and_of_masks(runs for runs, _ in state.values()) | _logical_and_of_masks(
        idle for _, idle in state.values()
    )
    for name, rpm in motion.tunnels.items():
        state[name] = _running_and_idle(rpm, float(np.percentile(np.abs(rpm), 99.5)))
    cases = {}
    for name in motion.drives if len(motion.drives) > 1 else ():
        others_idle = _logical_and_of_masks(idle for drive, (_, idle) in state.items() if drive != name)
        cases[f"{motion.words[name]} alone"] = state[name][0] & others_idle
    for name, rpm in motion.tunnels.items():
        for sign in (1.0, -1.0):
            cases[f"{motion.words[name]} to {side_of_sign(sign)}"] = state[name][0] & (sign * rpm > 0) & alike
    pushed = bool(motion.tunnels) or motion.steers_by_thrust  # others are moved sideways by wind and momentum only
    driven, sideways = pushed & ~_logical_and_of_masks(~runs for runs, _ in state.values()), np.abs(smooth.sway_mps)
    crab = driven & (sideways > _CRAB_SHARE * np.abs(smooth.surge_mps)) & (sideways > _CRAB_LEAST_MPS)
    crab_rows = close_gaps_in_mask(crab & free, round(_BRIDGE_S / motion.step_s))
    candidates = list[Manoeuvre | LeftOut]()
    for test in _find_drive_tests(motion, "crabbing", "crabbing", crab_rows, _CRAB_LEAST_S):
        turned = abs(test.indices["heading_change_deg"].value)
        rejected = LeftOut(test.kind, test.start, test.end, f"the ship turned by {turned:.0f} deg")
        candidates.append(test if turned < _CRAB_TURN_DEG else rejected)
    for name, mask in cases.items():
        rows = close_gaps_in_mask(mask & free & ~crab, round(_BRIDGE_S / motion.step_s))
        candidates += _find_drive_tests(motion, "thruster_test", name, rows, _LEAST_S)
    return candidates


def _logical_and_of_masks(masks: Iterable[Bools]) -> Bools:
    return np.asarray(np.logical_and.reduce(list(masks)))


def _find_drive_tests(motion: Motion, kind: str, name: str, rows: Bools, least_s: float) -> list[Manoeuvre]:
    tests = []
    for first, end in runs_of_true(rows, max(2, round(least_s / motion.step_s))):
        span, inside = np.array([motion.time_s[first], motion.time_s[end - 1]]), motion.rows(first, end)
        part = motion.around(span[0], span[1], 10.0)
        width = measures.smoothing_half_width_s(part, (span[1] - span[0]) / 2.0)
        estimates = measures.bootstrap_index_intervals(
            part, span, width, drift_indices, _UNSURE_ROWS * motion.step_s
        )
        side = side_of_sign(estimates["sway_mps" if kind == "crabbing" else "heading_change_deg"][0])
        full_name = f"{name} to {side}" if kind == "crabbing" else name
        settings = measures.means_by_column(inside.drives) | measures.means_by_column(inside.tunnels)
        settings["duration_s"] = float(span[1] - span[0])
        tests.append(measures.make_manoeuvre(motion, kind, full_name, span, side, settings, estimates))
    return tests


def drift_indices(motion: Motion, executes: Floats) -> dict[str, float]:
    """Mean motion between two times [s], the rate of turn in the last third, and the distance made good."""
    start, end = float(executes[0]), float(executes[1])
    inside = motion.between(start, end)
    ahead, sideways = measures.distance_ahead_and_to_starboard(motion, start, end, motion.at("heading_deg", start))
    rates = inside.yaw_rate_dps
    return {
        "surge_mps": float(inside.surge_mps.mean()),
        "sway_mps": float(inside.sway_mps.mean()),
        "heading_change_deg": float(inside.heading_deg[-1] - inside.heading_deg[0]),
        "last_yaw_rate_dps": float(rates[-max(1, rates.size // 3) :].mean()),
        "way_ahead_m": ahead,
        "way_to_starboard_m": sideways,
    }
