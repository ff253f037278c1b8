"""Are runs, stops, pull-outs, spirals, thruster and crabbing tests of simulated ships found, and none invented?

    python -m tests.benchmarks.manoeuvre_kinds [--trials 40] [--first 0]

Ships, helm rates, noise, currents and rates of recording are those of :mod:`tests.benchmarks.manoeuvre_trials`. The
truth is read off the track without noise, from the moments at which the legs began.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import pandas as pd

from seatrial.acquisition.core.quantities import Floats
from seatrial.analysis.manoeuvres.find import find_manoeuvres_and_left_out
from seatrial.analysis.manoeuvres.indices import LeftOut, Manoeuvre
from seatrial.analysis.manoeuvres.kinds import pull_out_indices, spiral_indices
from seatrial.analysis.manoeuvres.measures import first_crossing_s
from seatrial.analysis.manoeuvres.motion import Motion, motion_of
from seatrial.analysis.manoeuvres.straight_runs import acceleration_indices, drift_indices, stopping_indices
from seatrial.hybrid.simulation.manoeuvres import Leg, pace_of, steer, usual_rpm
from seatrial.hybrid.simulation.trial import simulate_trial, usual_noise
from seatrial.hybrid.vessel.sensors import states_as_table
from tests.benchmarks.manoeuvre_trials import Case, Score, case_of, vessel_of

HELMS = (15.0, 10.0, 5.0, 0.0, -5.0, -10.0, -15.0)
_BESIDE = {"course_change", "turning_circle", "speed_run", "acceleration", "pull_out"}
"""What a trial may hold besides: turns onto the next course, out of which the autopilot takes the helm at once,
straight stretches, both thrusters after one."""


@dataclass(frozen=True)
class Part:
    """A leg of a trial with what it is: the kind of manoeuvre that begins with it, "" for none."""

    leg: Leg
    kind: str = ""


@dataclass(frozen=True)
class Sailed:
    """A trial as recorded and without noise, when its legs began [s], the length [m] and current north, east."""

    table: pd.DataFrame
    exact: pd.DataFrame
    parts: tuple[Part, ...]
    begun_s: Floats
    length_m: float
    current_mps: tuple[float, float]


def programme(case: Case) -> tuple[Part, ...]:
    """The legs of a trial: runs to and fro, slow and fast again, both stops, a pull-out, a spiral, thrusters."""
    vessel = vessel_of(case.ship, case.rate_dps)
    time, rpm, speed = pace_of(vessel).time, usual_rpm(vessel), 5.04 * pace_of(vessel).speed
    straight = round(max(60.0, 60.0 * time))

    def held(angle: float, share: float, **orders: float) -> Leg:
        seconds = round(max(share * time, 20.0))
        return Leg(rpm=rpm, helm_deg=angle, orders=orders, at_least_s=seconds, at_most_s=seconds)

    drives = [each.name for each in vessel.actuators if each.drives]
    parts = [
        Part(steer(0.0, 3 * straight, rpm), "speed_run"),
        Part(steer(180.0, 3 * straight, rpm)),
        Part(steer(180.0, 3 * straight, rpm), "speed_run"),
        Part(steer(180.0, 4 * straight, 0.6 * rpm)),
        Part(steer(180.0, 5 * straight, rpm), "acceleration"),
        Part(Leg(rpm=0.0, slower_mps=0.05 * speed, at_most_s=80.0 * straight), "stopping"),
        Part(steer(180.0, 8 * straight, rpm), "acceleration"),
        Part(Leg(rpm=-0.7 * rpm, slower_mps=0.0, at_most_s=20.0 * straight), "stopping"),
        Part(Leg(rpm=0.0, at_least_s=straight, at_most_s=straight)),
        *(crabbing(case) if case.ship == "gunnerus_short" and not case.current else ()),
        Part(steer(180.0, 8 * straight, rpm)),  # she lay across, and turns while she gathers way
        Part(held(-20.0, 80.0)),
        Part(held(0.0, 120.0), "pull_out"),
        Part(steer(180.0, 4 * straight, rpm)),
        *(Part(held(-angle, 90.0), "" if number else "spiral") for number, angle in enumerate(HELMS)),
        Part(steer(180.0, 5 * straight, rpm)),
    ]
    if len(drives) > 1:
        for name in drives:
            standing = {f"{drive}_rpm": 0.0 for drive in drives if drive != name}
            single = Leg(rpm=rpm, orders=standing, course_deg=180.0, at_least_s=60.0, at_most_s=60.0)
            parts += [Part(single, "thruster_test"), Part(steer(180.0, 3 * straight, rpm))]
    for name in (each.name for each in vessel.actuators if each.kind == "tunnel"):
        parts.append(Part(steer(180.0, 6 * straight, 0.3 * rpm)))
        for push in (300.0, -300.0):
            aside = Leg(rpm=0.3 * rpm, orders={f"{name}_rpm": push}, at_least_s=40.0, at_most_s=40.0)
            parts += [Part(aside, "thruster_test"), Part(steer(180.0, 3 * straight, 0.3 * rpm))]
    return tuple(parts)


def crabbing(case: Case) -> tuple[Part, ...]:
    """R/V Gunnerus turns her thrusters at rest, goes aside at speeds that hardly turn her, and turns them back."""
    aside, seconds = {"port_angle_deg": 90.0, "starboard_angle_deg": 90.0}, 10.0 + 90.0 / case.rate_dps
    crab = {**aside, "tunnel_rpm": 280.0}
    return (
        Part(Leg(rpm=0.0, orders=aside, at_least_s=seconds, at_most_s=seconds)),
        Part(Leg(rpm=45.0, orders=crab, at_least_s=60.0, at_most_s=60.0), "crabbing"),
        Part(Leg(rpm=0.0, at_least_s=seconds, at_most_s=seconds)),
    )


def sail(case: Case) -> Sailed:
    """A trial of :func:`programme`."""
    vessel, parts = vessel_of(case.ship, case.rate_dps), programme(case)
    pace, length_m = pace_of(vessel), vessel.dimensions.length_between_perpendiculars_m
    towards = 90.0 * case.seed % 360.0
    speed = case.current * 5.04 * pace.speed
    flow = {"ocean_current": {"speed_mps": speed, "direction_deg": towards}} if speed else None
    noise = replace(usual_noise(length_m), azimuth_deg=0.2).scaled(case.noise)
    begun, seconds = [0.0], 0.0
    for each in parts[:-1]:  # leg by leg: what a stop takes is seen only when it was sailed
        seconds = begun[-1] + each.leg.at_most_s + 0.1  # a leg ends after its last row
        if each.kind == "stopping":
            legs = tuple(part.leg for part in parts[: len(begun)])
            _, truth = simulate_trial(vessel, "calm", legs, seconds, 10.0, case.seed, flow, noise=noise)
            slow = truth["states"][round(10.0 * begun[-1]) :, 3] < each.leg.slower_mps
            seconds = begun[-1] + (float(np.argmax(slow)) / 10.0 if slow.any() else each.leg.at_most_s) + 0.1
        begun.append(seconds)
    duration_s = begun[-1] + parts[-1].leg.at_most_s
    legs = tuple(part.leg for part in parts)
    table, truth = simulate_trial(vessel, "calm", legs, duration_s, 10.0, case.seed, flow, noise=noise)
    exact = states_as_table(truth["states"], truth["controls"], truth["wind"], table.index, vessel.actuators)
    exact.attrs = dict(table.attrs)
    along = speed * np.exp(1j * np.deg2rad(towards))
    return Sailed(
        table.iloc[:: 10 // case.rate_hz], exact, parts, np.array([*begun, duration_s]), length_m,
        (float(along.real), float(along.imag)),
    )  # fmt: skip


def truths(sailed: Sailed, motion: Motion) -> Iterator[tuple[int, str, float, dict[str, float]]]:
    """Leg, kind, start [s] and indices of every manoeuvre of a trial, of the motion without noise."""
    steps = next(place for place, each in enumerate(sailed.parts) if each.kind == "spiral")
    for place, each in enumerate(sailed.parts):
        begin, end = sailed.begun_s[place], sailed.begun_s[place + 1]
        if each.kind in ("acceleration", "stopping"):
            span = np.array([_changed_s(sailed.exact, begin), end])
            measure = acceleration_indices if each.kind == "acceleration" else stopping_indices
            yield place, each.kind, float(span[0]), measure(motion, span)
        if each.kind == "pull_out":
            order_s = _back_s(motion, begin, 0.02)
            yield place, each.kind, order_s, pull_out_indices(motion, np.array([order_s, end]))
        if each.kind == "spiral":
            legs = pairwise(sailed.begun_s[steps : steps + len(HELMS) + 1])
            spans = np.array([(start + _reached_s(motion, start, stop), stop) for start, stop in legs])
            yield (
                place,
                each.kind,
                float(spans[0, 0]),
                spiral_indices(motion, np.array(HELMS), spans, np.ones(len(HELMS), bool)),
            )
        if each.kind in ("speed_run", "thruster_test", "crabbing"):
            yield place, each.kind, begin, {}


def _changed_s(exact: pd.DataFrame, near: float) -> float:
    """When the shaft began to change, about a nominal time, which is some rows off after many legs."""
    shaft = exact.filter(regex="_rpm$").to_numpy()[:, 0]
    first = round(10.0 * near) - 10
    changes = np.flatnonzero(np.abs(np.diff(shaft[first : first + 20])) > 1e-6)
    return 0.1 * (first + int(changes[0]))


def _back_s(motion: Motion, near: float, share: float) -> float:
    """When a helm has gone that share of its way back to the middle, about a nominal time."""
    about = motion.between(near - 2.0, near + 60.0)
    off = -np.abs(about.helm_deg)
    return first_crossing_s(about.time_s, off, (1.0 - share) * off[0], near - 2.0, near + 60.0)


def _reached_s(motion: Motion, start: float, stop: float) -> float:
    """How long the helm takes to where it is in the end."""
    leg = motion.between(start, stop)
    held = float(np.interp(0.2 * start + 0.8 * stop, leg.time_s, leg.helm_deg))
    return float(leg.time_s[np.argmax(np.abs(leg.helm_deg - held) < 0.2)] - start)


def judge(case: Case, score: Score) -> list[str]:
    """Add what was found of a trial to a score; what is wrong with it, in words."""
    sailed = sail(case)
    found, left_out = map(list, find_manoeuvres_and_left_out(sailed.table, sailed.length_m))
    motion, wrong = motion_of(sailed.exact, sailed.length_m), list[str]()
    for place, kind, start, values in truths(sailed, motion):
        end = sailed.begun_s[place + 1]
        if any(each.kind == kind and abs(_seconds(sailed, each) - start) < 3.0 for each in left_out):
            continue  # with a current she still makes way over ground when she has none left
        score.true += 1
        own = [each for each in found if each.kind == kind and _is_it(sailed, each, start, end, kind)]
        if not own:
            wrong.append(f"{kind} at {start:.0f} s not found")
            continue
        score.found += 1
        values = values or _of_its_own_span(sailed, motion, own[0])
        for name, value in values.items():
            index = own[0].indices.get(name)
            if index is not None and np.isfinite(index.low) and np.isfinite(value):
                score.inside[f"{kind}: {name}"].append(index.low <= value <= index.high)
        found = [each for each in found if each is not own[0]]
    invented = [each for each in found if each.kind not in _BESIDE]
    wrong += [f"invented {each.name} at {_seconds(sailed, each):.0f} s" for each in invented]
    score.invented += [each.name for each in invented]
    return wrong


def _seconds(sailed: Sailed, each: Manoeuvre | LeftOut) -> float:
    return float((each.start - sailed.table.index[0]).total_seconds())


def _is_it(sailed: Sailed, each: Manoeuvre, start: float, end: float, kind: str) -> bool:
    """Whether one found is a true one: begun within some seconds, or for runs within the leg."""
    began = _seconds(sailed, each)
    if kind == "speed_run":
        return began < end and began + (each.end - each.start).total_seconds() > start + 0.3 * (end - start)
    slack = 10.0 if kind in ("thruster_test", "crabbing") else 0.1 * (end - start)
    return abs(began - start) < max(3.0, slack)


def _of_its_own_span(sailed: Sailed, motion: Motion, each: Manoeuvre) -> dict[str, float]:
    """The true means over the span that was found, of runs whose ends are theirs to choose."""
    span = _seconds(sailed, each) + np.array([0.0, (each.end - each.start).total_seconds()])
    part = motion.between(*span)
    if each.kind != "speed_run":
        return drift_indices(motion, span)
    ahead = np.deg2rad(each.settings["heading_deg"])
    along = sailed.current_mps[0] * np.cos(ahead) + sailed.current_mps[1] * np.sin(ahead)
    return {
        "surge_mps": float(part.surge_mps.mean()), "sway_mps": float(part.sway_mps.mean()),
        "current_along_mps": along, "speed_through_water_mps": float(part.surge_mps.mean()) - along,
    }  # fmt: skip


def main() -> None:
    """Sail the trials and print the scores."""
    parser = argparse.ArgumentParser(prog="manoeuvre_kinds", description=__doc__)
    parser.add_argument("--trials", type=int, default=40)
    parser.add_argument("--first", type=int, default=0)
    given, score = parser.parse_args(), Score()
    for number in range(given.first, given.first + given.trials):
        wrong = judge(case_of(number), score)
        print(case_of(number), *wrong, sep="\n    ", flush=True)
    print(f"manoeuvres found: {score.found} of {score.true}; invented: {len(score.invented)}")
    print(f"intervals that hold the truth: {score.coverage:.1%}")
    for name, inside in sorted(score.inside.items()):
        print(f"    {name}: {np.mean(inside):.0%} of {len(inside)}")


if __name__ == "__main__":
    main()
