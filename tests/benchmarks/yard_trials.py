"""Do the indices of sea trials of large ships hold the truth by the letter of the standard, in their intervals?

    python -m tests.benchmarks.yard_trials [--ships 60] [--first 0] [--near-limits]

Each ship (60 to 350 m, :mod:`tests.benchmarks.yard_ship`, none of Seatrial's own simulator) sails a turning circle,
both zigzags and a full astern stop in current and wind, by a helm of 0.7 to 5 deg/s, recorded at 0.5 to 5 Hz with
noise, an antenna off midship, the order recorded beside the helm or not. The truth is read off the track without
noise, of the midship point, from the moment of the order (IMO MSC.137(76), 4.2). Two minutes on one core.

``--near-limits`` takes one test of each ship, gives her the length by which its true value lies within 5 % of the
limit (the first overshoot of 20/20, whose limit is 25 deg for every ship, within 15 %), and counts how often a
criterion is said to be met that is not, and the other way round.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from dataclasses import dataclass, field, replace

import numpy as np
import pandas as pd

from seatrial.acquisition.config.run_sheet import Conditions
from seatrial.acquisition.core.quantities import Floats
from seatrial.acquisition.core.ship import Actuator, actuators_as_text
from seatrial.analysis.manoeuvres.find import find_manoeuvres
from seatrial.analysis.manoeuvres.indices import Manoeuvre
from tests.benchmarks.yard_ship import Order, Sailed, YardShip, drawn_hull, held_course

TESTS = ("turning_circle", "zigzag_20_20", "zigzag_10_10", "stopping")
START = pd.Timestamp("2026-06-01", tz="UTC")
NEAR_LIMITS = (
    ("turning_circle", "advance_m", 4.5), ("turning_circle", "tactical_diameter_m", 5.0),
    ("zigzag_10_10", "initial_turning_m", 2.5), ("stopping", "track_reach_m", 15.0),
    ("zigzag_10_10", "overshoot_1_from_order_deg", (5.0, 0.5, 10.0, 30.0)),
    ("zigzag_10_10", "overshoot_2_from_order_deg", (17.5, 0.75, 10.0, 30.0)),
    ("zigzag_20_20", "overshoot_1_from_order_deg", (25.0, 0.0, 0.0, 0.0)),
)  # fmt: skip
"""Test, index, and its limit: in ship lengths, or of an angle what it is at L/V = 0, what a second of L/V adds, and
between which L/V [s] (MSC.137(76), 5.3)."""
_SWINGS = 4


@dataclass(frozen=True, slots=True)
class Recorder:
    """How a trial is recorded: samples a second, noise as standard deviations, the antenna's place from midship
    [m], and whether the orders are recorded."""

    rate_hz: float
    position_m: float
    heading_deg: float
    speed_mps: float
    yaw_rate_dps: float
    helm_deg: float
    antenna_m: tuple[float, float]
    orders: bool


@dataclass(frozen=True, slots=True)
class Truth:
    """The orders' times [s] and the indices by the standard."""

    orders_s: list[float]
    indices: dict[str, float]


@dataclass
class Score:
    """What became of the tests: found ones, and by index whether its interval held."""

    tests: int = 0
    found: int = 0
    inside: dict[str, list[bool]] = field(default_factory=lambda: defaultdict(list))
    width: dict[str, list[float]] = field(default_factory=lambda: defaultdict(list))

    @property
    def coverage(self) -> float:
        """The fraction of intervals that hold the truth."""
        return float(np.mean([holds for index in self.inside.values() for holds in index]))


def ship_of(number: int) -> tuple[YardShip, Recorder, float]:
    """The ship of a number, how she is recorded, and the side of her first turn, 1 to starboard."""
    random = np.random.default_rng(number)
    length_m = float(np.exp(random.uniform(np.log(60.0), np.log(350.0))))
    ship = YardShip(
        length_m, float(random.uniform(0.12, 0.2)), float(random.uniform(0.8, 1.4)),
        float(np.exp(random.uniform(np.log(0.7), np.log(5.0)))), float(random.uniform(0.1, 0.5)),
        float(random.uniform(3.0, 12.0)), float(random.choice([0.0, 0.3, 0.6])), float(random.uniform(0.0, 360.0)),
        float(random.choice([0.0, 4.0, 8.0])), float(random.uniform(0.0, 360.0)), drawn_hull(random),
    )  # fmt: skip
    antenna_m = float(random.uniform(-0.4, 0.4) * length_m), float(random.uniform(-0.05, 0.05) * length_m)
    recorder = Recorder(
        float(random.choice([0.5, 1.0, 2.0, 5.0])), float(random.choice([0.05, 0.3, 1.0])),
        float(random.choice([0.05, 0.2])), 0.05, 0.03, float(random.choice([0.05, 0.2])), antenna_m,
        bool(random.integers(2)),
    )  # fmt: skip
    side = float(random.choice([-1.0, 1.0]))
    lag_s = float(random.uniform(3.0, 20.0))
    return replace(ship, shaft_lag_s=lag_s, engine_dead_s=float(random.uniform(0.0, 0.5)) * lag_s), recorder, side


def sail(ship: YardShip, test: str, side: float) -> tuple[Sailed, Truth]:
    """A test after a steady approach, with its truth."""
    pace_s = ship.length_m / ship.speed_mps
    start_s, orders_s = round(40.0 * pace_s) + 0.5 * (TESTS.index(test) % 2), list[float]()
    angle = {"turning_circle": 35.0, "zigzag_20_20": 20.0, "zigzag_10_10": 10.0}.get(test, 0.0)
    state = {"side": side, "base": 0.0}

    def order(helm_deg: float, now: float) -> Order:
        orders_s.append(now)
        state["helm"] = helm_deg
        return Order(helm_deg)

    def pilot(now: float, heading: float, rate: float, ahead: float) -> Order:
        if now < start_s:
            return Order(held_course(0.0, heading, rate, pace_s))
        if test == "stopping":
            orders_s.extend([] if orders_s else [now])
            return Order(0.0, -0.7)
        if not orders_s:
            state["base"] = heading
            return order(side * angle, now)
        turned = state["side"] * (heading - state["base"])
        if "zigzag" in test and turned >= angle and len(orders_s) < _SWINGS + 1:
            state["side"] = -state["side"]
            return order(state["side"] * angle, now)
        return Order(state["helm"])

    def until(now: float, heading: float, ahead: float) -> bool:
        if test == "stopping":
            return bool(orders_s) and ahead < -0.05
        if test == "turning_circle":
            return abs(heading) > 560.0
        return len(orders_s) > _SWINGS and now > orders_s[-1] + 6.0 * pace_s

    sailed = ship.sail(pilot, until)
    return sailed, Truth(orders_s, _true_indices(sailed, test, orders_s))


def _true_indices(sailed: Sailed, test: str, orders_s: list[float]) -> dict[str, float]:
    """By MSC.137(76), 4.2, off the track over ground without noise."""
    time_s, heading, order_s = sailed.time_s, sailed.heading_deg, orders_s[0]
    at = int(np.searchsorted(time_s, order_s - 1e-6))
    course = float(heading[at - 100 : at].mean())
    way = np.append(0.0, np.cumsum(np.hypot(np.diff(sailed.north_m), np.diff(sailed.east_m))))

    def way_m(until_s: float) -> float:
        return float(np.interp(until_s, time_s, way) - way[at])

    if test == "stopping":
        return {"track_reach_m": way_m(_reached_s(time_s, -sailed.surge_mps, 0.0, at))}
    side = float(np.sign(sailed.helm_order_deg[at]))
    off = side * (heading - course)
    found = {"initial_turning_m": way_m(_reached_s(time_s, off, 10.0, at))}
    if test == "turning_circle":
        quarter_s, half_s = (_reached_s(time_s, off, angle, at) for angle in (90.0, 180.0))
        c, s = np.cos(np.deg2rad(course)), np.sin(np.deg2rad(course))
        north, east = sailed.north_m - sailed.north_m[at], sailed.east_m - sailed.east_m[at]
        ahead, across = north * c + east * s, side * (east * c - north * s)
        return found | {
            "advance_m": float(np.interp(quarter_s, time_s, ahead)),
            "transfer_m": float(np.interp(quarter_s, time_s, across)),
            "tactical_diameter_m": float(np.interp(half_s, time_s, across)),
            "time_to_90_deg_s": quarter_s - order_s,
        }  # fmt: skip
    for number, moment in enumerate(orders_s[1:], start=1):
        after = orders_s[number + 1] if number + 1 < len(orders_s) else time_s[-1] + 1.0
        towards = side * (-1.0) ** (number - 1) * heading
        top = towards[(time_s >= moment) & (time_s < after)].max()
        found[f"overshoot_{number}_from_order_deg"] = float(top - np.interp(moment, time_s, towards))
    return found | {"initial_turning_time_s": orders_s[1] - order_s}


def _reached_s(time_s: Floats, values: Floats, level: float, begin: int) -> float:
    """When values first reach a level from a row on [s]."""
    row = begin + int(np.argmax(values[begin:] >= level))
    return float(np.interp(level, values[row - 1 : row + 1], time_s[row - 1 : row + 1]))


def record(ship: YardShip, sailed: Sailed, how: Recorder, seed: int) -> pd.DataFrame:
    """The table of a recording of what was sailed."""
    random = np.random.default_rng(seed)
    time_s = np.arange(random.uniform(0.0, 1.0 / how.rate_hz), sailed.time_s[-1], 1.0 / how.rate_hz)

    def at(values: Floats, noise: float) -> Floats:
        return np.interp(time_s, sailed.time_s, values) + noise * random.standard_normal(time_s.size)

    psi = np.deg2rad(np.interp(time_s, sailed.time_s, sailed.heading_deg))
    forward, aside = how.antenna_m
    columns = {
        "north_m": at(sailed.north_m, how.position_m) + forward * np.cos(psi) - aside * np.sin(psi),
        "east_m": at(sailed.east_m, how.position_m) + forward * np.sin(psi) + aside * np.cos(psi),
        "heading_deg": at(sailed.heading_deg, how.heading_deg) % 360.0,
        "yaw_rate_dps": at(sailed.yaw_rate_dps, how.yaw_rate_dps),
        "rudder_angle_deg": at(sailed.helm_deg, how.helm_deg), "propeller_rpm": at(sailed.rpm, 0.1),
    }  # fmt: skip
    rate = np.deg2rad(np.interp(time_s, sailed.time_s, sailed.yaw_rate_dps))
    columns["surge_mps"] = at(sailed.surge_mps, how.speed_mps) - rate * aside
    columns["sway_mps"] = at(sailed.sway_mps, how.speed_mps) + rate * forward
    if how.orders:
        row = np.searchsorted(sailed.time_s, time_s, side="right") - 1
        columns["rudder_order_angle_deg"] = sailed.helm_order_deg[row]
        columns["propeller_order_rpm"] = sailed.rpm_order[row]
    times = START + pd.to_timedelta(time_s, unit="s")
    table = pd.DataFrame(columns, index=times.rename("time"))
    actuators = (Actuator("propeller", "propeller"), Actuator("rudder", "rudder"))
    table.attrs["trial"] = {
        "actuators": actuators_as_text(actuators), "antenna_forward_m": forward, "antenna_starboard_m": aside,
    }  # fmt: skip
    return table


def judge(number: int, score: Score) -> list[str]:
    """Sail all tests of a ship and add what their indices are worth to a score; what is wrong, in words."""
    ship, how, side = ship_of(number)
    wrong = []
    for test in TESTS:
        # What the current does to a stop nobody sees over ground: it is made in still water.
        sailed, truth = sail(replace(ship, current_mps=0.0) if test == "stopping" else ship, test, side)
        table = record(ship, sailed, how, number)
        score.tests += 1
        kind = test.partition("_1")[0].partition("_2")[0]
        runs = [run for run in find_manoeuvres(table, ship.length_m) if run.kind == kind]
        if len(runs) != 1:
            wrong.append(f"{test}: {len(runs)} found")
            continue
        score.found += 1
        wrong += _judge_run(test, runs[0], truth, table, score)
    return wrong


def _judge_run(test: str, run: Manoeuvre, truth: Truth, table: pd.DataFrame, score: Score) -> list[str]:
    wrong = []
    for name, value in truth.indices.items():
        index = run.indices.get(name)
        if index is None or not np.isfinite(index.low):
            wrong.append(f"{test}: no {name}")
            continue
        holds = bool(index.low <= value <= index.high)
        score.inside[f"{test} {name}"].append(holds)
        score.width[f"{test} {name}"].append((index.value - value) / max(0.5 * (index.high - index.low), 1e-9))
        if not holds:
            late_s = (run.start - START).total_seconds() - truth.orders_s[0]
            wrong.append(
                f"{test}: {name} {index.value:.2f} ({index.low:.2f} to {index.high:.2f}), true {value:.2f}; start "
                f"{late_s:+.2f} s"
            )
    return wrong


def length_near_limit(
    limit: float | tuple[float, float, float, float], true: float, ratio: float, speed_mps: float
) -> float | None:
    """The length [m] by which a true value has this ratio to its limit, None where there is none: limits of angles
    lie between two values, or are one."""
    if not isinstance(limit, tuple):
        return true / (limit * ratio)
    base_deg, per_s, shortest_s, longest_s = limit
    if not per_s:
        return None
    pace_s = (true / ratio - base_deg) / per_s
    return pace_s * speed_mps if shortest_s < pace_s < longest_s else None


def judge_near_limit(number: int) -> tuple[str, float, str] | None:
    """The index, its true value by its limit, and the result of one test of a ship; None where it is not found, or
    cannot be near its limit."""
    ship, how, side = ship_of(number)
    test, name, limit = NEAR_LIMITS[number % len(NEAR_LIMITS)]
    sailed, truth = sail(replace(ship, current_mps=0.0) if test == "stopping" else ship, test, side)
    ratio, true = float(np.random.default_rng(number).uniform(0.95, 1.05)), truth.indices[name]
    speed_mps = float(np.interp(truth.orders_s[0], sailed.time_s, sailed.ahead_mps))
    length_m = length_near_limit(limit, true, ratio, speed_mps)
    if length_m is None:
        ratio, length_m = true / 25.0, ship.length_m
        if test != "zigzag_20_20" or abs(ratio - 1.0) > 0.15:
            return None
    known = Conditions(
        length_m=length_m, draught_m=8.0, full_load_draught_m=8.0, trim_m=0.0, water_depth_m=80.0, beaufort=3,
        sea_state=2, current_mps=0.0 if test == "stopping" else ship.current_mps,
        speed_at_85_percent_mcr_mps=0.85 * ship.speed_mps, chemical_or_gas_tanker=True,
    )  # fmt: skip
    runs = find_manoeuvres(record(ship, sailed, how, number), conditions=known)
    results = [run.indices[name].result for run in runs if name in run.indices and run.indices[name].result]
    return (name, ratio, results[0]) if results else None


def near_limits(numbers: range) -> None:
    """Judge one test of each ship near its limit and print how often the result is wrong."""
    judged = [entry for number in numbers if (entry := judge_near_limit(number)) is not None]
    above = [result for _, ratio, result in judged if ratio > 1.0]
    below = [result for _, ratio, result in judged if ratio <= 1.0]
    print(f"{len(judged)} of {len(numbers)} tests near a limit found, of angles only where the limit can be near")
    wrong = {
        "wrong met": [entry for entry in judged if entry[1] > 1.0 and entry[2] == "met"],
        "wrong not met": [entry for entry in judged if entry[1] <= 1.0 and entry[2] == "not_met"],
    }
    for words, entries in wrong.items():
        print(f"    {words}: {len(entries)}", *entries)
    for name in dict.fromkeys(entry[0] for entry in judged):
        print(f"    {name}: {sum(entry[0] == name for entry in judged)}")
    for words, results in (("above", above), ("below", below)):
        counts = {result: results.count(result) for result in ("met", "not_met", "cannot_be_said", "not_shown")}
        print(f"    {len(results)} {words} it: {counts}")


def main() -> None:
    """Sail the ships and print the scores."""
    parser = argparse.ArgumentParser(prog="yard_trials", description=__doc__)
    parser.add_argument("--ships", type=int, default=60)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--near-limits", action="store_true", help="one test of each ship, within 5 % of its limit")
    given, score = parser.parse_args(), Score()
    if given.near_limits:
        near_limits(range(given.first, given.first + given.ships))
        return
    for number in range(given.first, given.first + given.ships):
        wrong = judge(number, score)
        ship, how, _ = ship_of(number)
        print(f"{number}: {ship.length_m:.0f} m, {ship.helm_rate_dps:.1f} deg/s, {how.rate_hz:g} Hz, position "
              f"{how.position_m:g} m, orders {how.orders}, current {ship.current_mps:g}", *wrong, sep="\n    ",
              flush=True)  # fmt: skip
    print(f"tests found: {score.found} of {score.tests}; intervals that hold the truth: {score.coverage:.1%}")
    for name, inside in score.inside.items():
        ratio = np.array(score.width[name])
        print(
            f"    {name}: {np.mean(inside):.0%} of {len(inside)}, bias {np.median(ratio):+.2f} of the half interval"
        )


if __name__ == "__main__":
    main()
