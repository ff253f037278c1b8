"""Zigzag tests: helm to one side until the heading is off by the switching angle, then to the other, and on.

Definitions after IMO MSC.137(76) and ITTC 7.5-04-02-01: an overshoot is the change of heading that follows an
execute in the old direction. It is read off a fit of the heading, as the largest of noisy samples is too large.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from analysis.manoeuvres.indices import Index, Manoeuvre, index_of, with_limits
from analysis.manoeuvres.limits import INITIAL_TURNING_LENGTHS, overshoot_limit_deg
from analysis.manoeuvres.motion import Floats, Motion
from analysis.manoeuvres.noise import half_width_s, measured_with_intervals
from analysis.manoeuvres.segments import Plateau, execute_s
from analysis.manoeuvres.tracks import approach_of, approach_settings, crossing_s, distance_m, level_before, peak

FEWEST_SWINGS = 3
_LEVEL_SHARE, _LEVEL_DEG = 0.15, 1.0
_LONGEST_PAUSE_S = 8.0
_WIDEST_SWING_DEG = 150.0
_MARGIN_S = 30.0
_INITIAL_TURN_DEG = 10.0
_RATES_ALIKE = 3.0


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
    return [chain for chain in chains if len(chain) >= fewest and _answered(motion, chain)]


def _continues(motion: Motion, last: Plateau, each: Plateau) -> bool:
    """Whether ``each`` is the next swing: other side, the same angle, at once."""
    pause_s = (each.first - last.end) * motion.step_s
    shortest_s = min(last.end - last.first, each.end - each.first) * motion.step_s
    larger = max(abs(last.level), abs(each.level))
    alike = abs(last.level + each.level) <= _LEVEL_SHARE * larger + _LEVEL_DEG
    return last.level * each.level < 0 and alike and pause_s <= max(_LONGEST_PAUSE_S, 0.5 * shortest_s)


def _answered(motion: Motion, chain: list[Plateau]) -> bool:
    """Whether the ship turns to the other side in each swing but the last, and none of them is a circle."""
    ends = np.array([each.end - 1 for each in chain])
    at_ends = motion.heading_deg[ends]
    before = motion.heading_deg[max(chain[0].first - 1, 0)]
    turned = np.diff(np.append(before, at_ends))
    sides = np.sign([each.level for each in chain])
    alternates = bool(np.all(turned[:-1] * sides[:-1] * (turned[0] * sides[0]) > 0))
    return alternates and bool(np.all(np.abs(turned) < _WIDEST_SWING_DEG))


def executes_of(motion: Motion, helm: Floats, chain: list[Plateau]) -> Floats:
    """When each swing's helm was put over, and when the last was taken off [s]."""
    times = [execute_s(motion.time_s, helm, chain[0], level_before(motion, helm, chain[0]),
                       max(0, chain[0].first - round(15.0 / motion.step_s)))]  # fmt: skip
    for last, each in zip(chain[:-1], chain[1:], strict=True):
        times.append(execute_s(motion.time_s, helm, each, last.level, (last.first + last.end) // 2))
    return np.array([*times, motion.time_s[chain[-1].end - 1]])


def zigzag(motion: Motion, helm: Floats, chain: list[Plateau], length_m: float | None) -> Manoeuvre:
    """The zigzag that a chain of swings is, with its indices."""
    executes = executes_of(motion, helm, chain)
    part = motion.between(executes[0] - _MARGIN_S, executes[-1] + _MARGIN_S)
    swing_s = float(np.median(np.diff(executes[:-1])))
    found = measured_with_intervals(part, executes, half_width_s(part, swing_s), zigzag_indices)
    settings = _settings(part, chain, executes)
    indices = {name: index_of(name, *pair, length_m) for name, pair in found.items() if np.isfinite(pair[0])}
    angle, switch = settings["azimuth_deg"], settings["switch_deg"]
    limits = {
        f"overshoot_{number}_deg": overshoot_limit_deg(number, angle, switch, length_m, settings["approach_mps"])
        for number in (1, 2)
    }
    limits["initial_turning_m"] = INITIAL_TURNING_LENGTHS * length_m if length_m else None
    return Manoeuvre(
        kind="zigzag",
        name=f"zigzag {angle:.0f}/{switch:.0f}",
        start=motion.utc(executes[0]),
        end=motion.utc(executes[-1]),
        side="starboard" if _first_side(part, executes) > 0 else "port",
        settings=settings,
        indices=with_limits(indices, limits),
        executes=tuple(motion.utc(each) for each in executes[1:-1]),
    )


def _settings(part: Motion, chain: list[Plateau], executes: Floats) -> dict[str, float]:
    heading = np.interp(executes[:-1], part.time_s, part.heading_deg)
    return {
        "azimuth_deg": float(np.median([abs(each.level) for each in chain])),
        "switch_deg": float(np.median(np.abs(np.diff(heading[1:])))) / 2.0,
        "swings": float(len(chain)),
        **approach_settings(part, executes[0]),
    }


def _first_side(motion: Motion, executes: Floats) -> float:
    """1 where the first swing turns the ship to starboard, -1 to port."""
    return 1.0 if motion.at("heading_deg", executes[1]) > motion.at("heading_deg", executes[0]) else -1.0


def zigzag_indices(motion: Motion, executes: Floats) -> dict[str, float]:
    """The indices of a smooth motion; ``executes`` [swings + 1] with the end of the last swing.

    Overshoots, times from the execute they belong to, and the speed lost. What was not reached is missing.
    """
    side = _first_side(motion, executes)
    approach = approach_of(motion, executes[0])
    heading = side * (motion.heading_deg - approach["approach_unwrapped_deg"])
    swings = executes.size - 2
    values: dict[str, float] = {}
    for number in range(1, swings + 1):
        towards = 1.0 if number % 2 else -1.0
        last = executes[number + 1] if number < swings else motion.time_s[-1]
        time_s, top = peak(motion.time_s, towards * heading, executes[number], min(last, motion.time_s[-1]))
        if number < swings or time_s < motion.time_s[-1]:
            values[f"overshoot_{number}_deg"] = top - towards * float(
                np.interp(executes[number], motion.time_s, heading)
            )
            values[f"time_to_check_yaw_{number}_s"] = time_s - executes[number]
    overshoots = [value for name, value in values.items() if name.startswith("overshoot")]
    if len(overshoots) > 2:
        values["overshoot_mean_deg"] = float(np.mean(overshoots))
    inside = motion.between(executes[0], executes[-1])
    values["initial_turning_time_s"] = executes[1] - executes[0]
    tenth_s = crossing_s(motion.time_s, heading, _INITIAL_TURN_DEG, executes[0], executes[2])
    values["initial_turning_m"] = distance_m(motion, executes[0], tenth_s)
    values["reach_s"] = crossing_s(motion.time_s, -heading, 0.0, executes[1], executes[-1]) - executes[0]
    if executes.size >= 5:
        values["period_s"] = float(np.mean(executes[3:-1] - executes[1:-3])) if executes.size > 4 else np.nan
    values["largest_yaw_rate_dps"] = float(np.abs(inside.yaw_rate_dps).max())
    values["speed_loss"] = 1.0 - float(inside.speed_mps.min()) / approach["approach_mps"]
    return values


def repeats_of(indices: dict[str, Index]) -> Floats:
    """All overshoots of one zigzag [deg]: their spread says how well it can be repeated."""
    return np.array([each.value for name, each in indices.items()
                     if name.startswith("overshoot_") and name.removesuffix("_deg")[-1].isdigit()])  # fmt: skip
