"""How fast the simulator is: steps a second, both cores, a bare compiled loop, and plain NumPy.

Run it as ``python tests/benchmarks/simulator_speed.py``; it prints and asserts nothing.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))

from seatrial.hybrid.effects import vessel_plant
from seatrial.hybrid.simulation.trial import simulate_trial
from seatrial.hybrid.vessel.dynamics import simulate, simulate_batch
from seatrial.hybrid.vessel.files import load_vessel
from tests.benchmarks import bare_loop
from tests.hybrid import gunnerus_by_hand as by_hand

STEPS, BATCH = 50_000, 16
DT_S = 0.1


def best(action: Callable[[], object], repeats: int = 5) -> float:
    """The shortest of several times [s]; the first call, which may compile, does not count."""
    action()
    times = []
    for _ in range(repeats):
        began = time.perf_counter()
        action()
        times.append(time.perf_counter() - began)
    return min(times)


def of_ship(name: str) -> float:
    """The time of :data:`STEPS` steps of a rudder ship under way [s]."""
    plant = vessel_plant(load_vessel(name))
    controls, wind = np.tile([10.0, 0.1], (STEPS, 1)), np.tile([1.0, 1.0], (STEPS, 1))
    return best(lambda: simulate(plant, [0.0, 0.0, 0.0, 0.5, 0.0, 0.0], controls, wind, DT_S, 1))


def main() -> None:
    """Measure and print."""
    plant = vessel_plant(load_vessel())
    start = np.array([0.0, 0.0, 0.0, 4.5, 0.0, 0.0])
    controls, wind = np.tile([2.8, 0.2, 2.8, 0.2, 0.0], (STEPS, 1)), np.tile([1.0, 6.0], (STEPS, 1))
    states = np.empty((STEPS + 1, 6))
    bare = best(lambda: bare_loop.simulate(start, controls, wind, DT_S, states))
    apart_m = np.abs(simulate(plant, start, controls, wind, DT_S, 1) - states)[:300, :2].max()
    single = best(lambda: simulate(plant, start, controls, wind, DT_S, 1))
    batch = best(lambda: simulate_batch([plant] * BATCH, start, controls, wind, DT_S, 1))
    few = 300
    by_numpy = best(lambda: by_hand.simulate(start, controls[:few], wind[:few], DT_S), 2) / few
    trial = best(lambda: simulate_trial("gunnerus_long", "moderate", "programme", 3600.0, 10.0), 2)
    print(
        f"bare compiled loop      {STEPS / bare / 1e6:8.2f} million steps/s on one core, {apart_m:.1e} m from ours"
    )
    print(
        f"simulate, one vessel    {STEPS / single / 1e6:8.2f} million steps/s, {single / bare:.2f} x the bare time"
    )
    for name in ("kvlcc2_7m", "esso_osaka_3m"):
        time_s = of_ship(name)
        print(f"simulate, {name:13} {STEPS / time_s / 1e6:8.2f} million steps/s, {time_s / single:.2f} x the time")
    print(f"a batch of {BATCH} vessels   {BATCH * STEPS / batch / 1e6:8.2f} million steps/s on all cores")
    print(f"    over one core       {BATCH * bare / batch:8.2f} x")
    print(
        f"the same in plain NumPy {1e-6 / by_numpy:8.4f} million steps/s, compiled {by_numpy / bare * STEPS:.0f} x"
    )
    print(f"a trial of 60 min       {trial:8.2f} s at 10 Hz with waves, gusts and sensors")


if __name__ == "__main__":
    main()
