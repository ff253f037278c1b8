"""How often the smoother's 95 % bands hold the truth, over vessels, seas, manoeuvres, rates, noise and seeds.

Run as ``python tests/benchmarks/smoothing_coverage.py [SEEDS [CASE ...]]``. For each case two lines: the share in
each state's band, the mean NEES of pose and velocity (6 for a smoother that is as sure as it says) and the mean
NIS by channel, means over independent seeds; and below the standard error of each mean, from their scatter.

Trials are simulated at 40 Hz and thinned: the simulator's wave speeds are central differences over its own step,
which at 10 Hz are 2 to 6 % short of the rate of change of its wave displacements, more than what is asked here.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from seatrial.analysis.estimation.smoother import smooth
from seatrial.hybrid.simulation.trial import SimulationNoise, simulate_trial
from tests.analysis.smoothing_errors import coverage, nees, with_accelerations

DURATION_S, MARGIN_S, FINE_HZ = 600.0, 5.0, 40.0


@dataclass(frozen=True, slots=True)
class Case:
    """A trial to simulate; ``noise`` multiplies the sensors' own."""

    vessel: str
    sea: str
    manoeuvre: str
    rate_hz: float
    noise: float


CASES = (
    Case("gunnerus_short", "calm", "voyage", 5.0, 1.0),
    Case("gunnerus_long", "calm", "programme", 2.0, 1.0),
    Case("gunnerus_short", "calm", "zigzag_20_20", 5.0, 3.0),
    Case("gunnerus_short", "gentle", "voyage", 5.0, 1.0),
    Case("gunnerus_long", "gentle", "turning_circle_20", 10.0, 1.0),
    Case("gunnerus_long", "gentle", "programme", 5.0, 3.0),
    Case("gunnerus_short", "moderate", "voyage", 5.0, 1.0),
    Case("gunnerus_long", "moderate", "voyage", 10.0, 0.5),
    Case("gunnerus_short", "moderate", "programme", 2.0, 1.0),
    Case("gunnerus_long", "moderate", "zigzag_20_20", 5.0, 3.0),
    Case("gunnerus_short", "moderate", "turning_circle_20", 20.0, 1.0),
)


def trial(case: Case, seed: int) -> tuple[pd.DataFrame, pd.DataFrame]:
    """What the sensors give at the case's rate, and the truth with accelerations at :data:`FINE_HZ`."""
    noisy, perfect = (
        simulate_trial(
            case.vessel, case.sea, case.manoeuvre, DURATION_S, FINE_HZ, seed, noise=SimulationNoise().scaled(factor)
        )[0]
        for factor in (case.noise, 0.0)
    )
    return noisy.iloc[:: round(FINE_HZ / case.rate_hz)], with_accelerations(perfect)


def figures(case: Case, seed: int) -> NDArray[np.float64]:
    """Nine shares, the mean NEES and the mean NIS of the six channels of one trial."""
    noisy, truth = trial(case, seed)
    found = smooth(noisy)
    shares = coverage(found, truth, MARGIN_S)
    nis = [channel.nis for channel in found.consistency.values()]
    return np.array([*shares.values(), np.nanmean(nees(found, truth)), *nis])


def line(figures: NDArray[np.float64], sign: str) -> str:
    """Shares, NEES and NIS of a case in columns."""
    shares, nis = (" ".join(f"{each:{form}}" for each in some) for some, form in
                   ((figures[:9], "6.3f"), (figures[10:], "5.2f")))  # fmt: skip
    return f"{sign} {shares} | {figures[9]:5.2f} | {nis}"


def main(seeds: int = 5, numbers: tuple[int, ...] = ()) -> None:
    """Print each case as it is done, then the table of all: means over the seeds, standard errors below."""
    table = [
        "        north   east   head  surge   sway    yaw surge'  sway'   yaw' |  NEES | "
        "NIS: head yaw north east surge sway"
    ]
    for number in numbers or range(len(CASES)):
        case = CASES[number]
        found = np.stack([figures(case, 100 + seed) for seed in range(seeds)])
        error = found.std(axis=0, ddof=1) / np.sqrt(seeds) if seeds > 1 else np.full(found.shape[1], np.nan)
        table += [
            f"{number}: {case.vessel} {case.sea} {case.manoeuvre} {case.rate_hz} Hz, noise x{case.noise}",
            line(found.mean(axis=0), "  mean"),
            line(error, "    se"),
        ]
        print("\n".join(table[-3:]), file=sys.stderr, flush=True)
    print("\n".join(table))


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 5, tuple(int(each) for each in sys.argv[2:]))
