"""The current of a trial, taken off runs that have no circle of their own to show it.

Circles of more than 510 deg give the drift north and east, pairs of reciprocal runs that along their course, with
what the wind does to the speed. All that were sailed within two hours of a run count, weighted by their intervals.
What the current may have changed by in between is that of the semidiurnal tide (M2, 12.42 h, Pugh and Woodworth
2014) of the same speed, at its steepest: it widens each interval with the time between.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pandas as pd

from seatrial.acquisition.core.quantities import Floats
from seatrial.analysis.manoeuvres.indices import Current, Index, Manoeuvre, index_of
from seatrial.analysis.manoeuvres.measures import half_width_s, smooth_motion
from seatrial.analysis.manoeuvres.motion import Motion
from seatrial.analysis.manoeuvres.runs import LONGEST_BETWEEN_S, stopping_indices
from seatrial.analysis.manoeuvres.turning_circle import REMOVED, circle_indices, remove_current, shows_current
from seatrial.analysis.manoeuvres.zigzag import zigzag_indices

_TIDE_RADPS = 2.0 * np.pi / (12.42 * 3600.0)
_LEAST_SPREAD = 0.13  # of directions, the smaller eigenvalue: two courses 30 deg apart
_MARGIN_S, _LONGEST_RUN_ON_S = 20.0, 300.0
_KINDS = ("turning_circle", "course_change", "zigzag", "stopping")


class Observation(NamedTuple):
    """The current along a direction (north, east), with half of its 95 % interval [m/s], at a time."""

    time: pd.Timestamp
    direction: tuple[float, float]
    along_mps: float
    within_mps: float


def observations_of(runs: Sequence[Manoeuvre]) -> list[Observation]:
    """What circles and pairs of reciprocal runs say of the current."""
    seen, pairs = list[Observation](), set[float]()
    for run in runs:
        time = run.start + (run.end - run.start) / 2
        if run.current is not None and shows_current(run):
            current = run.current
            seen.append(Observation(time, (1.0, 0.0), current.north_mps, current.north_within_mps))
            seen.append(Observation(time, (0.0, 1.0), current.east_mps, current.east_within_mps))
        pair = run.settings.get("reciprocal_pair")
        if pair is not None and pair not in pairs:
            pairs.add(pair)
            course, along = np.deg2rad(run.settings["heading_deg"]), run.indices["current_along_mps"]
            direction = float(np.cos(course)), float(np.sin(course))
            seen.append(Observation(time, direction, along.value, 0.5 * (along.high - along.low)))
    return seen


def current_at(time: pd.Timestamp, observations: Sequence[Observation]) -> Current | None:
    """The current at a time, None where no two directions of it were observed within two hours."""
    apart_s = np.array([abs((each.time - time).total_seconds()) for each in observations])
    near = apart_s <= LONGEST_BETWEEN_S
    if not near.any():
        return None
    direction, along, within = (
        np.array([getattr(each, name) for each in observations])[near]
        for name in ("direction", "along_mps", "within_mps")
    )
    if np.linalg.eigvalsh(direction.T @ direction)[0] < _LEAST_SPREAD or not np.all(np.isfinite(within)):
        return None
    speed_mps = float(np.linalg.norm(_weighted(direction, along, np.maximum(within, 1e-3))[0]))
    changed = speed_mps * np.minimum(_TIDE_RADPS * apart_s[near], 2.0)
    (north, east), halves = _weighted(direction, along, np.hypot(np.maximum(within, 1e-3), changed))
    return Current(float(north), float(east), float(halves[0]), float(halves[1]))


def _weighted(direction: Floats, along: Floats, within: Floats) -> tuple[Floats, Floats]:
    """The current north and east by weighted least squares, and the halves of their intervals [m/s]."""
    weights = 1.0 / within**2
    inverse = np.linalg.inv(direction.T @ (weights[:, None] * direction))
    return inverse @ (direction.T @ (weights * along)), np.sqrt(np.diag(inverse))


def remove_currents(
    motion: Motion, runs: Sequence[Manoeuvre], elsewhere: Sequence[Observation] = ()
) -> list[Manoeuvre]:
    """The runs, those without a current of their own with the ways through the water, where the trial shows it.

    ``elsewhere`` is what other recordings of the trial show of it.
    """
    observations = [*observations_of(runs), *elsewhere]
    currents = {
        place: current for place, run in enumerate(runs)
        if run.kind in _KINDS and run.current is None and (current := current_at(run.start, observations))
    }  # fmt: skip
    return [_removed(motion, run, currents[place]) if place in currents else run for place, run in enumerate(runs)]


def _removed(motion: Motion, run: Manoeuvre, current: Current) -> Manoeuvre:
    start, end = ((time.value - motion.origin_ns) / 1e9 for time in (run.start, run.end))
    part = motion.around(start - _MARGIN_S, end + _LONGEST_RUN_ON_S * (run.kind == "stopping"), _MARGIN_S)
    smooth, measure = smooth_motion(part, half_width_s(part, 0.1 * (end - start))), _measure_of(run, start, end)

    def through_water(north_mps: float, east_mps: float) -> dict[str, float]:
        return measure(remove_current(smooth, north_mps, east_mps, start))

    ground, flow = measure(smooth), (current.north_mps, current.east_mps)
    water = through_water(*flow)
    more = [
        through_water(flow[0] + current.north_within_mps, flow[1]),
        through_water(flow[0], flow[1] + current.east_within_mps),
    ]
    indices = {
        name + REMOVED: _shifted(
            name, index, water[name] - ground[name], [each[name] - water[name] for each in more]
        )
        for name, index in run.indices.items()
        if index.unit == "m" and name in ground and all(name in each for each in (water, *more))
    }  # fmt: skip
    if not indices:
        return run
    note = "the current removed is that of other runs of the trial, and what it may have changed by"
    return replace(run, indices={**run.indices, **indices}, current=current, notes=(*run.notes, note))


def _measure_of(run: Manoeuvre, start: float, end: float) -> Callable[[Motion], dict[str, float]]:
    if run.kind == "stopping":
        return lambda motion: stopping_indices(motion, np.array([start, _stopped_s(motion, start, end)]))
    if run.kind == "zigzag":
        orders = start + np.array(
            [0.0, *((each - run.start).total_seconds() for each in run.executes), end - start]
        )
        times = np.stack([orders, orders + run.settings["half_command_s"] * (orders < end)])
        return lambda motion: zigzag_indices(motion, times)
    return lambda motion: circle_indices(motion, np.array([start, end]))


def _stopped_s(motion: Motion, start: float, end: float) -> float:
    """When a ship has stopped in the water [s]; the end of the run where she has not."""
    astern = motion.time_s[(motion.time_s > start) & (motion.surge_mps <= 0.0)]
    return float(astern[0]) if astern.size else end


def _shifted(name: str, index: Index, by: float, errors: Sequence[float]) -> Index:
    """An index by what the current changes, and wider by what its errors do."""
    wider = float(np.linalg.norm(errors))
    low, high = np.hypot(index.value - index.low, wider), np.hypot(index.high - index.value, wider)
    value, length_m = index.value + by, index.value / index.lengths if index.lengths else None
    shifted = index_of(name, value, 0.0, length_m)
    return replace(shifted, low=value - float(low), high=value + float(high), counted_from=index.counted_from)
