"""Helm tests other than zigzags and circles: pull-outs, direct and reverse spirals, Williamson turns.

Definitions after ITTC 7.5-04-02-01 and ISO 13643-2 and -3. They are recognised by the orders and the ship's
response: rates of turn count once settled, and a Williamson turn ends on the reciprocal course.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from seatrial.acquisition.core.quantities import Bools, Floats
from seatrial.analysis.manoeuvres import measures
from seatrial.analysis.manoeuvres.indices import Index, Manoeuvre, nominal_deg, side_of
from seatrial.analysis.manoeuvres.measures import Execute, Measure, Plateau
from seatrial.analysis.manoeuvres.motion import Motion, noise_of, stretches
from seatrial.analysis.series import local_quadratic

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


def find_pull_outs(motion: Motion, held: Sequence[Plateau], rate: Floats, fastest_mps: float) -> list[Manoeuvre]:
    """Helms put amidships from a turn and held until the rate of turn has settled; ``rate`` is smoothed."""
    manoeuvres, noise = [], noise_of(motion.helm_deg)
    for last, following in pairwise(held):
        turned = motion.heading_deg[last.first : last.end]
        way = motion.speed_mps[following.first] > _LEAST_WAY * fastest_mps
        middle = abs(following.level) <= max(_AMIDSHIPS_DEG, _AMIDSHIPS_SHARE * abs(last.level)) < abs(last.level)
        if not (
            way and np.ptp(turned) >= _LEAST_TURN_DEG and middle and _follows_directly(motion, last, following)
        ):
            continue
        # The helm went directly to amidships, not beyond, and stayed there without course-keeping.
        between = motion.helm_deg[last.end : following.first + 1]
        beyond = float(np.max(-np.sign(last.level) * (between - following.level), initial=0.0))
        steady = following.spread <= _STILL_DEG + _SPREAD_OF_NOISE * noise
        if not (steady and beyond <= _AMIDSHIPS_DEG + 3.0 * noise):
            continue
        execute = measures.next_execute(motion, last, following)
        settled_s = _settled_s(motion, rate, execute.half_s, float(motion.time_s[following.end - 1]))
        times = np.array([execute.order_s, settled_s])
        values = pull_out_indices(motion, times)
        if values and settled_s - execute.half_s >= _LEAST_HELD_S:
            name, side = f"pull-out from {nominal_deg(last.level):.0f} deg", float(turned[-1] - turned[0])
            scale_s = 4.0 * max(values["time_to_half_rate_s"], motion.step_s)
            manoeuvres.append(
                _measure_test(
                    motion, "pull_out", name, side, last.level, times, [execute], pull_out_indices, scale_s
                )
            )
    return manoeuvres


def _settled_s(motion: Motion, rate: Floats, half: float, end: float) -> float:
    """The time [s], at most ``end``, three times as long after ``half`` as the smoothed rate takes to reach its
    final value."""
    first, last = np.searchsorted(motion.time_s, [half, end])
    after = rate[first : last + 1]
    if after.size < 2:
        return end
    deviation = np.abs(after - np.median(after[-max(after.size // 4, 1) :]))
    unsettled = np.flatnonzero(deviation > _SETTLED_SHARE * deviation[0])
    return min(end, half + max(3.0 * unsettled.size * motion.step_s, 2.0 * _LEAST_HELD_S))


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
    fallen_s = measures.crossing_s(falling.time_s, fallen, 0.5 * decay, order, end)
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

    return _chain_steps(held, is_next_helm, has_settled)


def _chain_steps(
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


def spiral(motion: Motion, steps: list[Plateau]) -> Manoeuvre:
    """The direct spiral of its steps, with its indices."""
    times = motion.time_s[[row for step in steps for row in (step.first, step.end - 1)]]
    sign = motion.turns_to_starboard
    levels = sign * np.array([motion.helm_deg[(step.first + step.end) // 2 : step.end].mean() for step in steps])

    settled = np.array([_has_settled(motion, steps, step) for step in steps])

    def measure(part: Motion, spans: Floats) -> dict[str, float]:
        return spiral_indices(part, levels, spans.reshape(-1, 2), settled)

    largest = max(steps, key=lambda step: abs(step.level)).level
    name = f"direct spiral {nominal_deg(largest):.0f} deg"
    manoeuvre = _measure_test(motion, "spiral", name, float(levels[0]), largest, times, [], measure)
    helm_error = noise_of(motion.helm_deg) / np.sqrt(0.5 * min(step.end - step.first for step in steps))
    left_out = [f"step {number} at {levels[number - 1]:.1f} deg" for number in np.flatnonzero(~settled) + 1]
    notes = (f"the rate of turn had not settled, left out: {', '.join(left_out)}",) if left_out else ()
    return replace(manoeuvre, indices=_add_helm_error(manoeuvre.indices, 1.96 * float(helm_error)), notes=notes)


def _add_helm_error(indices: Mapping[str, Index], within_deg: float) -> dict[str, Index]:
    """The indices of a spiral with the uncertainty of the mean helm of a step added where it matters."""
    slope = abs(indices["yaw_rate_per_helm_dps"].value) if "yaw_rate_per_helm_dps" in indices else 0.0
    margins = {"neutral_helm_deg": within_deg, "yaw_rate_at_no_helm_dps": slope * within_deg}
    wider = {}
    for name, index in indices.items():
        within = float(np.hypot(0.5 * (index.high - index.low), margins.get(name, 0.0)))
        wider[name] = replace(index, low=index.value - within, high=index.value + within)
    return wider


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
    legs = [slice(0, turn + 1), *([slice(turn, None)] if turn + 1 < levels.size else [])]
    values["neutral_helm_deg"] = float(np.mean([_interpolate_at_zero(rates[leg], levels[leg]) for leg in legs]))
    near, heights = np.argsort(np.abs(levels))[:3], [_interpolate_at_zero(levels[leg], rates[leg]) for leg in legs]
    values["yaw_rate_at_no_helm_dps"] = float(np.mean(heights))
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
    tried = [rate, *(local_quadratic(rate, width / motion.step_s) for width in _WIDER_S)]
    return max((_rate_steps(motion, candidate, free) for candidate in tried), key=lambda runs: sum(map(len, runs)))


def _rate_steps(motion: Motion, rate: Floats, free: Bools) -> list[list[Plateau]]:
    usable = free & ~motion.broken
    largest = float(np.percentile(np.abs(rate[usable]), 99)) if usable.any() else 0.0
    band = max(_BAND_SHARE * largest, _BAND_OF_NOISE * noise_of(rate))
    steps = [plateau for span in stretches(usable, round(_LEAST_HELD_S / motion.step_s))
             for plateau in _held_rates(rate, *span, band)]  # fmt: skip
    held = [plateau for plateau in steps if (plateau.end - plateau.first) * motion.step_s >= _LEAST_HELD_S]

    def is_next_rate(last: Plateau, following: Plateau) -> bool:
        pause, shorter = following.first - last.end, min(following.end - following.first, last.end - last.first)
        return pause <= shorter and abs(following.level - last.level) > 2.0 * band

    still = _STILL_DEG + _SPREAD_OF_NOISE * noise_of(motion.helm_deg)

    def is_steered(run: list[Plateau]) -> bool:
        """Whether the rates were held most of the time, by a helm that was not."""
        second_halves = (motion.helm_deg[(plateau.first + plateau.end) // 2 : plateau.end] for plateau in run)
        spreads = [np.ptp(np.percentile(helm, [10, 90])) for helm in second_halves]
        held_rows = sum(plateau.end - plateau.first for plateau in run)
        return held_rows > _HELD_SHARE * (run[-1].end - run[0].first) and float(np.median(spreads)) > still

    return _chain_steps(held, is_next_rate, is_steered)


def _held_rates(rate: Floats, first: int, end: int, band: float) -> list[Plateau]:
    """The stretches of rows in which a rate stays within ``band``, in order."""
    pieces, start, low, high = list[Plateau](), first, rate[first], rate[first]
    for row in range(first, end):
        low, high = min(low, rate[row]), max(high, rate[row])
        if high - low > band or row == end - 1:
            pieces.append(Plateau(start, row, float(np.median(rate[start : row + 1])), float(high - low)))
            start, low, high = row, rate[row], rate[row]

    def join(last: Plateau, following: Plateau) -> Plateau | None:
        """One rate interrupted by a gust; the pieces of a ramp are a whole band apart."""
        near = abs(following.level - last.level) < 0.5 * band
        return Plateau(last.first, following.end, 0.5 * (last.level + following.level), band) if near else None

    return measures.merge_neighbours(pieces, join)


def reverse_spiral(motion: Motion, steps: list[Plateau]) -> Manoeuvre:
    """The reverse spiral (Bech) of its steps: the mean helm for each rate, over its second half."""
    sign, random = motion.turns_to_starboard, np.random.default_rng(_SEED)
    parts = [slice((step.first + step.end) // 2, step.end) for step in steps]
    helms, rates = (np.array([measures.mean_of_blocks(values[part]) for part in parts])
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
    name, side = f"reverse spiral {largest:.2g} deg/s", side_of(float(rates[0, 0]))
    return measures.manoeuvre_of(motion, "reverse_spiral", name, np.array([start, end]), side, settings, estimates)


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


def _interpolate_at_zero(values: Floats, ordinates: Floats) -> float:
    """``ordinates`` at zero ``values``, by linear interpolation between the steps."""
    order = np.argsort(values)
    return float(np.interp(0.0, values[order], ordinates[order]))


def find_williamson_turns(motion: Motion, held: Sequence[Plateau]) -> list[Manoeuvre]:
    """Williamson turns: helm to one side until the heading is some 60 deg off, then to the other until the
    reciprocal course."""
    manoeuvres = []
    for last, following in pairwise(held):
        if not (
            _follows_directly(motion, last, following) and measures.is_same_order(last.level, -following.level)
        ):
            continue
        executes = [measures.helm_execute(motion, last), measures.next_execute(motion, last, following)]
        first, second = (execute.order_s for execute in executes)
        course = measures.approach_of(motion, first)["approach_unwrapped_deg"]
        end = float(motion.time_s[min(2 * following.end - following.first, motion.time_s.size) - 1])
        side = float(np.sign(motion.at("heading_deg", second) - course))
        out, back = (side * (motion.at("heading_deg", at) - course) for at in (second, end))
        if _OUT_DEG[0] < out < _OUT_DEG[1] and _BACK_DEG[0] < -back < _BACK_DEG[1]:
            times = np.array([first, second, end])
            name = f"Williamson turn {nominal_deg(last.level):.0f} deg"
            manoeuvres.append(
                _measure_test(
                    motion, "williamson_turn", name, side, last.level, times, executes, williamson_indices
                )
            )
    return manoeuvres


def williamson_indices(motion: Motion, times: Floats) -> dict[str, float]:
    """Where and when the ship is on the reciprocal course, within 5 deg.

    How far ahead of the first execute, how far to starboard of the first track, after how long; and how far off the
    course at the second execute. ``times`` are both orders and the end [s].
    """
    first, second, end = map(float, times)
    course = measures.approach_of(motion, first)["approach_unwrapped_deg"]
    side = np.sign(motion.at("heading_deg", second) - course)
    back = -side * (motion.heading_deg - course)
    reached = measures.crossing_s(motion.time_s, back, 175.0, second, end)
    ahead, across = (
        measures.along_and_across(motion, first, reached, course) if np.isfinite(reached) else (np.nan, np.nan)
    )
    return {
        "heading_at_second_execute_deg": abs(motion.at("heading_deg", second) - course),
        "time_to_reciprocal_s": reached - first, "way_ahead_m": ahead, "track_offset_m": across,
    }  # fmt: skip


def _follows_directly(motion: Motion, last: Plateau, following: Plateau) -> bool:
    """Whether the helm goes from one level to the next without stopping in between."""
    pause_s = (following.first - last.end) * motion.step_s
    return (
        pause_s <= 4.0 + measures.helm_change_s(motion, following.level - last.level)
        and not motion.broken[last.first : following.end].any()
    )


def _measure_test(
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
    width = measures.half_width_s(part, min(scale_s, float(times[-1] - times[0]) / times.size))
    within_s = np.full(times.size, 0.5 * motion.step_s)
    within_s[: len(executes)] = [execute.order_within_s for execute in executes]
    estimates = measures.bootstrap_indices(part, times, width, measure, within_s)
    settings = {motion.helm_setting: helm_deg, **measures.approach_settings(part, float(times[0]))}
    if executes:
        settings["half_command_s"] = executes[0].half_command_s
    return measures.manoeuvre_of(motion, kind, name, times[[0, -1]], side_of(side), settings, estimates)
