"""Do the 95 % intervals of the delays between the motion channels hold, and is what is sound left alone?

R/V Gunnerus' model in calm water, scaled by Froude to ships of 2 to 300 m, recorded at 0.5 to 10 Hz with positions
that scatter by 0.01 to 2 m and one group of channels late by up to 3 s, or none. Speeds are a sensor's own, or come
of course and ground speed and the recorded heading, or of the positions; with the latter two the yaw rate comes of
the heading. Prints how often each interval held, by length and rate too, what was found that is not there, and what
a repair would have moved: ``make benchmark-quality``.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.interpolate import CubicSpline

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from seatrial.acquisition.core.quantities import Floats, rotate_earth_to_ship, to_earth
from seatrial.acquisition.tables.column_map import local_least_squares_slopes
from seatrial.analysis.quality.findings import Finding
from seatrial.analysis.quality.motion.findings import findings_of
from seatrial.analysis.quality.motion.fit import fit_kinematics
from seatrial.analysis.quality.motion.model import GROUPS, MOTION
from seatrial.hybrid.simulation.trial import simulate_trial

MANOEUVRES = ("zigzag_20_20", "zigzag_10_10", "turning_circle_20", "voyage", "programme")
SPEEDS = ("of a sensor", "of course and ground speed", "of the positions")
DELAYS = ("position_delay_s", "heading_delay_s", "heading_after_yaw_rate_s")
RATES_HZ = (0.5, 1.0, 2.0, 5.0, 10.0)
LENGTHS_M = (0.0, 5.0, 15.0, 50.0, 120.0, 300.0)
_GUNNERUS_M = 31.25
_MODEL_HZ = 10.0
_LEAD_S = 5.0


@dataclass(frozen=True, slots=True)
class Recorded:
    """How a trial is recorded: noise as standard deviations, ``late_s`` of positions, heading, speeds, yaw rate."""

    length_m: float
    rate_hz: float
    manoeuvre: str
    duration_s: float
    speeds: str
    position_m: float
    heading_deg: float
    speed_mps: float
    yaw_rate_dps: float
    late_s: Floats

    @property
    def delays_s(self) -> Floats:
        """The true delays, in the order of :data:`DELAYS`; what comes of a channel is late with it."""
        position, heading, speed, yaw_rate = self.late_s
        if self.speeds == SPEEDS[0]:
            return np.array([position - speed, heading - speed, heading - yaw_rate])
        return np.array([position - speed if self.speeds == SPEEDS[1] else 0.0, 0.0, 0.0])


def drawn(generator: np.random.Generator) -> Recorded:
    """A ship and her sensors by chance; the trial is as long as her size makes it."""

    def by_factors(low: float, high: float) -> float:
        return float(np.exp(generator.uniform(np.log(low), np.log(high))))

    length_m, late_s, late = by_factors(2.0, 300.0), np.zeros(4), int(generator.integers(5))
    late_s[late : late + 1] = generator.uniform(0.0, 3.0) if late < late_s.size else []
    usual_s = 900.0 * max(np.sqrt(length_m / _GUNNERUS_M), 1.0)
    return Recorded(
        length_m, float(generator.choice(RATES_HZ)), str(generator.choice(MANOEUVRES)),
        usual_s * generator.uniform(1.0, 4.0), str(generator.choice(SPEEDS)), by_factors(0.01, 2.0),
        by_factors(0.03, 0.5), by_factors(0.01, 0.1), by_factors(0.01, 0.1), late_s,
    )  # fmt: skip


def truth(length_m: float, manoeuvre: str, duration_s: float, seed: int) -> Callable[[Floats], Floats]:
    """The states [n, 6] of a ship of this length at any times [n]: position [m], heading [rad], velocities."""
    scale = length_m / _GUNNERUS_M
    root = np.sqrt(scale)
    _, sailed = simulate_trial("gunnerus_short", "calm", manoeuvre, duration_s / root, _MODEL_HZ, seed)
    states = np.asarray(sailed["states"]) * [scale, scale, 1.0, root, root, 1.0 / root]
    states[:, 2] = np.unwrap(states[:, 2])
    return CubicSpline(np.arange(len(states)) * root / _MODEL_HZ, states)


def recorded(how: Recorded, seed: int, generator: np.random.Generator) -> pd.DataFrame:
    """The table of the six motion channels of such a trial."""
    states_at = truth(how.length_m, how.manoeuvre, how.duration_s, seed)
    time_s = np.arange(_LEAD_S, how.duration_s - _LEAD_S, 1.0 / how.rate_hz)

    def white(size: float, *columns: int) -> Floats:
        return size * generator.standard_normal((time_s.size, *columns))

    position, heading, speed, yaw_rate = (states_at(time_s - late_s) for late_s in how.late_s)
    north_east = position[:, :2] + white(how.position_m, 2)
    heading_deg = np.rad2deg(heading[:, 2]) + white(how.heading_deg)
    if how.speeds == SPEEDS[0]:
        body = speed[:, 3:5] + white(how.speed_mps, 2)
        yaw_rate_dps = np.rad2deg(yaw_rate[:, 5]) + white(how.yaw_rate_dps)
    else:
        over_ground = np.column_stack(to_earth(*speed[:, 3:5].T, speed[:, 2])) + white(how.speed_mps, 2)
        if how.speeds == SPEEDS[2]:
            over_ground = np.column_stack([local_least_squares_slopes(time_s, column) for column in north_east.T])
        body = np.column_stack(rotate_earth_to_ship(*over_ground.T, np.deg2rad(heading_deg)))
        yaw_rate_dps = local_least_squares_slopes(time_s, heading_deg)
    values = np.column_stack([north_east, heading_deg % 360.0, body, yaw_rate_dps])
    times = pd.Timestamp("2026-06-01", tz="UTC") + pd.to_timedelta(time_s, unit="s")
    table = pd.DataFrame(values, index=times.rename("time"), columns=list(MOTION))
    table.attrs["sources"] = _sources(how.speeds)
    return table


def _sources(speeds: str) -> dict[str, list[str]]:
    """The sources as the recorder and import name them."""
    if speeds == SPEEDS[0]:
        return {}
    of = "bridge/GP:VTG derived" if speeds == SPEEDS[1] else "table derived from north_m, east_m and heading_deg"
    return {"surge_mps": [of], "sway_mps": [of], "yaw_rate_dps": ["table derived from heading_deg"]}


@dataclass(frozen=True, slots=True)
class Outcome:
    """Whether the intervals of :data:`DELAYS` held, and what was found and would be repaired that is not there."""

    recorded: Recorded
    held: tuple[bool, ...]
    wrong: tuple[str, ...]
    moved: int
    what: str


def judged(number: int) -> Outcome:
    """One trial by its number."""
    generator = np.random.default_rng((number, 77))
    how = drawn(generator)
    table = recorded(how, number, generator)
    fit = fit_kinematics(table)
    intervals = [fit.interval(name) for name in DELAYS]
    held = tuple(bool(low <= true <= high) for (low, high), true in zip(intervals, how.delays_s, strict=True))
    late = dict(zip(GROUPS, how.late_s, strict=True))
    wrong = [
        finding
        for finding in findings_of(table, fit)
        if finding.code == "channel_delay" and not _holds(finding, late[finding.channel])
    ]
    what = f"{number} {how}: {np.round(intervals, 3).tolist()}"
    return Outcome(how, held, tuple(each.text for each in wrong), sum(each.certain for each in wrong), what)


def _holds(finding: Finding, late_s: float) -> bool:
    """Whether the interval of a finding holds how late the channel is."""
    return bool(finding.estimate["low"] <= late_s <= finding.estimate["high"])


def main(trials: int, first: int) -> None:
    with ProcessPoolExecutor(2) as pool:
        outcomes = list(pool.map(judged, range(first, first + trials)))
    for outcome in outcomes:
        if outcome.moved or not all(outcome.held):
            print(outcome.what, outcome.held, *(f"    {text}" for text in outcome.wrong), sep="\n")
    for speeds in SPEEDS:
        held = np.array([each.held for each in outcomes if each.recorded.speeds == speeds])
        shares = ", ".join(f"{name} {share:.3f}" for name, share in zip(DELAYS, held.mean(axis=0), strict=True))
        print(f"speeds {speeds}: {len(held)} trials, intervals that held: {shares}")
    independent = [each for each in outcomes if each.recorded.speeds != SPEEDS[2]]
    _print_held("speeds recorded", independent)
    for shortest, longest in pairwise(LENGTHS_M):
        group = [each for each in independent if shortest < each.recorded.length_m <= longest]
        _print_held(f"{shortest:g} to {longest:g} m", group)
        for rate_hz in RATES_HZ:
            _print_held(f"    {rate_hz:g} Hz", [each for each in group if each.recorded.rate_hz == rate_hz])
    print(f"false repairs: {sum(each.moved for each in outcomes)} of {trials}")


def _print_held(name: str, outcomes: list[Outcome]) -> None:
    if outcomes:
        print(
            f"{name}: {len(outcomes)} trials, {np.mean([each.held for each in outcomes]):.3f} of the intervals held"
        )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 500, int(sys.argv[2]) if len(sys.argv) > 2 else 0)
