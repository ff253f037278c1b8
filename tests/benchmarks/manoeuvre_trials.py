"""Are the manoeuvres of simulated trials found, and do their indices' intervals hold the truth?

    python -m tests.benchmarks.manoeuvre_trials [--trials 60] [--first 0] [--pose-only]

Each trial is a zigzag and a turning circle of a ship with a rudder or with azimuth thrusters, whose helm goes over
at 0.5 to 20 deg/s, in current, recorded at 1 to 10 Hz with noise. The truth is read off the track without noise,
from the moments of the orders. A minute on one core.
"""

from __future__ import annotations

import argparse
import re
import tempfile
from collections import defaultdict
from dataclasses import dataclass, field, fields, replace
from math import inf
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from seatrial.acquisition.core.quantities import Floats
from seatrial.analysis.manoeuvres.find import find_manoeuvres
from seatrial.analysis.manoeuvres.kinds import circle_indices, zigzag_indices
from seatrial.analysis.manoeuvres.motion import motion_of
from seatrial.hybrid.simulation.manoeuvres import helm_leg, pace_of, steer, usual_rpm, zigzag
from seatrial.hybrid.simulation.trial import simulate_trial, usual_noise
from seatrial.hybrid.vessel.files import Vessel, load_vessel
from seatrial.hybrid.vessel.sensors import states_as_table

VESSELS = Path(__file__).parents[2] / "trials" / "vessels"
SHIPS = {"kvlcc2_180m": ("kvlcc2_7m", 180.0 / 7.0), "kvlcc2_7m": ("kvlcc2_7m", 1.0),
         "esso_osaka_3m": ("esso_osaka_3m", 1.0), "gunnerus_short": ("gunnerus_short", 1.0),
         "gunnerus_long": ("gunnerus_long", 1.0)}  # fmt: skip
RATES_DPS, RATES_HZ = (0.5, 1.0, 2.5, 5.0, 10.0, 20.0), (1, 2, 5, 10)
SWINGS = 5
_POWERS = {
    "_m2": 2.0, "_kgm2": 5.0, "_kg": 3.0, "_radps": -0.5, "_mps": 0.5, "_rpm": -0.5, "_m": 1.0, "_s": 0.5,
    "Xud": 3.0, "Yvd": 3.0, "Yrd": 4.0, "Nvd": 4.0, "Nrd": 5.0,
}  # fmt: skip
"""How the numbers of a vessel file whose coefficients have no dimensions grow with her length (Froude)."""


@dataclass(frozen=True)
class Case:
    """One trial; ``current`` is a share of the ship's speed, ``side`` 1 for a first turn to starboard."""

    ship: str
    rate_dps: float
    zigzag_deg: tuple[float, float]
    circle_deg: float
    turn_deg: float
    rate_hz: int
    noise: float
    current: float
    side: float
    seed: int

    def __str__(self) -> str:
        """In one line."""
        angle, switch = self.zigzag_deg
        return (
            f"{self.seed}: {self.ship}, {self.rate_dps:g} deg/s, {angle:g}/{switch:g}, turn {self.circle_deg:g}, "
            f"{self.rate_hz} Hz, noise {self.noise:g}, current {self.current:.2f}"
        )


@dataclass
class Score:
    """What became of the manoeuvres of trials; ``inside`` by index."""

    true: int = 0
    found: int = 0
    executes: int = 0
    found_executes: int = 0
    invented: list[str] = field(default_factory=list)
    inside: dict[str, list[bool]] = field(default_factory=lambda: defaultdict(list))

    @property
    def coverage(self) -> float:
        """The share of intervals that hold the truth."""
        return float(np.mean([each for some in self.inside.values() for each in some]))


def case_of(number: int) -> Case:
    """The trial of a number: every ship at every rate in turn, the rest drawn."""
    random = np.random.default_rng(number)
    ship = [*SHIPS][number % len(SHIPS)]
    rates = RATES_DPS if SHIPS[ship][1] > 1.0 or "gunnerus" in ship else RATES_DPS[2:]  # a model's helm is faster
    angles = [(10.0, 10.0), (20.0, 20.0), (10.0, 20.0), (15.0, 15.0)]
    return Case(
        ship, rates[number // len(SHIPS) % len(rates)], angles[int(random.integers(4))],
        float(random.choice([20.0, 30.0, 35.0])), float(random.choice([400.0, 560.0, 740.0])),
        int(random.choice(RATES_HZ)), float(random.choice([0.5, 1.0, 2.0])), float(random.choice([0.0, 0.05, 0.1])),
        float(random.choice([-1.0, 1.0])), number,
    )  # fmt: skip


def vessel_of(ship: str, rate_dps: float) -> Vessel:
    """A ship of Seatrial's own, scaled by Froude's law, whose helm goes over at a rate."""
    name, scale = SHIPS[ship]
    text = (VESSELS / f"{name}.toml").read_text()
    if scale != 1.0:
        text = re.sub(r"(?m)^(\w+) = (-?[\d.]+)", lambda line: _scaled(line, scale), text)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{ship}.toml"
        path.write_text(text.replace(f'name = "{name}"', f'name = "{ship}"', 1))
        vessel = load_vessel(str(path))
    return replace(vessel, actuator=tuple(_with_rate(each, rate_dps) for each in vessel.actuator))


def _with_rate(actuator: Any, rate_dps: float) -> Any:
    name = next((each.name for each in fields(actuator) if each.name.endswith("rate_limit_dps")), "")
    return replace(actuator, **{name: rate_dps}) if name else actuator


def _scaled(line: re.Match[str], scale: float) -> str:
    name = line[1]
    power = next((power for suffix, power in _POWERS.items() if name.endswith(suffix)), 0.0)
    return f"{name} = {float(line[2]) * scale**power!r}" if power else line[0]


def sail(case: Case) -> tuple[pd.DataFrame, pd.DataFrame, list[tuple[str, Floats]], float]:
    """What is recorded, the truth at 10 Hz, the true manoeuvres by kind with their times [s], the length [m].

    The times are those of the orders and the end, of a zigzag with those at which the helm was half over below.
    """
    vessel = vessel_of(case.ship, case.rate_dps)
    pace, rpm = pace_of(vessel), usual_rpm(vessel)
    length_m = vessel.dimensions.length_between_perpendiculars_m
    straight_s = round(max(60.0, 60.0 * pace.time))
    angle, switch = case.zigzag_deg
    swings = [
        replace(each, at_most_s=inf) for each in zigzag(-case.side * angle, -case.side * switch, rpm, swings=SWINGS)
    ]
    turning = replace(helm_leg(case.side * case.circle_deg, rpm), turn_deg=case.turn_deg)
    legs = (steer(0.0, straight_s, rpm), *swings, steer(0.0, 2.5 * straight_s, rpm), turning,
            steer(0.0, 3.0 * straight_s, rpm))  # fmt: skip
    flow = {
        "ocean_current": {"speed_mps": case.current * 5.04 * pace.speed, "direction_deg": 90.0 * case.seed % 360.0}
    }
    noise = replace(usual_noise(length_m), azimuth_deg=0.2).scaled(case.noise)
    duration_s = 1500.0 * max(pace.time, 0.4) + 300.0 / case.rate_dps
    table, truth = simulate_trial(
        vessel, "calm", legs, duration_s, 10.0, case.seed, flow if case.current else None, noise=noise
    )
    exact = states_as_table(truth["states"], truth["controls"], truth["wind"], table.index, vessel.actuators)
    exact.attrs = dict(table.attrs)
    heading, helm_deg = np.rad2deg(truth["states"][:, 2]), _helm_to_starboard(exact, vessel)
    true, cut_s = _true_manoeuvres(case, heading, helm_deg, straight_s)
    rows = min(len(table), round(10.0 * (cut_s + 2.0 * straight_s)))
    return table.iloc[: rows : 10 // case.rate_hz], exact.iloc[:rows], true, length_m


def _helm_to_starboard(exact: pd.DataFrame, vessel: Vessel) -> Floats:
    angles = exact.filter(like="angle_deg")
    return np.asarray(angles.iloc[:, 0] * (1.0 if "rudder" in angles.columns[0] else -1.0))


def _true_manoeuvres(
    case: Case, heading: Floats, helm_deg: Floats, straight_s: float
) -> tuple[list[tuple[str, Floats]], float]:
    """The legs' own ends, found on the heading without noise, which are the next ones' orders."""
    angle, switch = case.zigzag_deg
    begun, side, orders, swings = 10 * straight_s, case.side, list[float](), list[float]()
    first = begun
    for _ in range(SWINGS):
        over = side * (heading[begun:] - heading[first]) >= switch
        goal = 0.0 if swings else 0.5 * (angle + side * helm_deg[begun])
        orders.append(0.1 * begun)
        swings.append(0.1 * (begun + _crossing(side * helm_deg[begun:], goal)))
        begun, side = begun + int(np.flatnonzero(over)[0]), -side
    zigzag_s = np.array([[*orders, 0.1 * begun], [*swings, 0.1 * begun]])
    begun += round(25.0 * straight_s)
    end = begun + int(np.flatnonzero(np.abs(heading[begun:] - heading[begun]) >= case.turn_deg)[0])
    return [("zigzag", zigzag_s), ("turning_circle", 0.1 * np.array([begun, end]))], 0.1 * end


def _crossing(values: Floats, level: float) -> float:
    """The row, with fraction, at which ``values`` first rise to a level; 0 where they are above it at once."""
    row = int(np.flatnonzero(values >= level)[0])
    return row - 1 + (level - values[row - 1]) / (values[row] - values[row - 1]) if row else 0.0


def judge(case: Case, score: Score, *, pose_only: bool = False) -> list[str]:
    """Add what was found of a trial to a score; what is wrong with it, in words."""
    table, exact, true, length_m = sail(case)
    if pose_only:
        table = table.drop(
            columns=["surge_mps", "sway_mps", "yaw_rate_dps", "wind_direction_deg", "wind_speed_mps"]
        )
    found, motion, wrong = list(find_manoeuvres(table, length_m)), motion_of(exact, length_m), list[str]()
    starts = [(each.start - table.index[0]).total_seconds() for each in found]
    within_s = 1.0 / case.rate_hz + 0.4 * max(1.0, 1.0 / case.rate_dps)
    spans = [(times.flat[0], times.flat[-1]) for _, times in true]
    for kind, times in true:
        orders = np.atleast_2d(times)[0]
        score.true, score.executes = score.true + 1, score.executes + orders.size - 1
        own = [each for each, start in zip(found, starts, strict=True) if each.kind == kind
               and abs(start - orders[0]) < within_s]  # fmt: skip
        if not own:
            wrong.append(f"{kind} at {orders[0]:.1f} s not found")
            continue
        score.found += 1
        executes = [0.0, *((each - own[0].start).total_seconds() for each in own[0].executes)]
        near = [min(abs(each - own_s) for own_s in executes) < within_s for each in orders[:-1] - orders[0]]
        score.found_executes += sum(near)
        wrong += [] if all(near) and len(near) == len(executes) else [f"{kind}: executes {executes}"]
        values = (zigzag_indices if kind == "zigzag" else circle_indices)(
            motion.between(0.0, orders[-1] + 1.0), times
        )
        for name, value in values.items():
            index = own[0].indices.get(name)
            if index is not None and np.isfinite(index.low):
                score.inside[name].append(index.low <= value <= index.high)
        found = [each for each in found if each is not own[0]]
        starts = [(each.start - table.index[0]).total_seconds() for each in found]
    for each, start in zip(found, starts, strict=True):
        end = start + (each.end - each.start).total_seconds()
        if each.kind != "speed_run" or any(begin + 1.0 < end and start < stop - 1.0 for begin, stop in spans):
            wrong.append(f"invented {each.name} at {start:.0f} to {end:.0f} s")
            score.invented.append(wrong[-1])
    return wrong


def main() -> None:
    """Sail the trials and print the scores."""
    parser = argparse.ArgumentParser(prog="manoeuvre_trials", description=__doc__)
    parser.add_argument("--trials", type=int, default=60)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--pose-only", action="store_true", help="without speeds and rate of turn")
    given, score = parser.parse_args(), Score()
    for number in range(given.first, given.first + given.trials):
        wrong = judge(case_of(number), score, pose_only=given.pose_only)
        print(case_of(number), *wrong, sep="\n    ", flush=True)
    print(f"manoeuvres found: {score.found} of {score.true}, executes: {score.found_executes} of {score.executes}")
    print(f"invented: {len(score.invented)}; intervals that hold the truth: {score.coverage:.1%}")
    for name, inside in sorted(score.inside.items()):
        print(f"    {name}: {np.mean(inside):.0%} of {len(inside)}")


if __name__ == "__main__":
    main()
