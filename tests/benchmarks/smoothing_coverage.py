"""How often the smoother's 95 % bands hold the truth, over vessels, seas, manoeuvres, rates, noise and seeds.

Run as ``python tests/benchmarks/smoothing_coverage.py [SEEDS [CASE ...]]``. For each case one line: the share in
each state's band, the mean NEES of pose and velocity (6 for a smoother that is as sure as it says) and the mean
NIS by channel, each a mean over independent seeds with the half-width of its 95 % interval from their scatter.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.smooth import smooth
from analysis.smoothing_consistency import coverage, nees, with_accelerations
from hybrid.truth.sensors import Noise
from hybrid.truth.trial import simulate_trial

DURATION_S, MARGIN_S = 600.0, 5.0


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


def figures(case: Case, seed: int) -> NDArray[np.float64]:
    """Nine shares, the mean NEES and the mean NIS of the six channels of one trial."""
    noisy, perfect = (
        simulate_trial(
            case.vessel, case.sea, case.manoeuvre, DURATION_S, case.rate_hz, seed, noise=Noise().scaled(factor)
        )[0]
        for factor in (case.noise, 0.0)
    )
    found, truth = smooth(noisy), with_accelerations(perfect)
    shares = coverage(found, truth, MARGIN_S)
    nis = [channel.nis for channel in found.consistency.channels.values()]
    return np.array([*shares.values(), np.nanmean(nees(found, truth)), *nis])


def main(seeds: int = 5, numbers: tuple[int, ...] = ()) -> None:
    """Print a line a case: means over the seeds, and the half-width of the interval below."""
    columns = "north east head surge sway yaw surge' sway' yaw' | NEES | NIS: head yaw north east surge sway"
    print(columns, flush=True)
    for number in numbers or range(len(CASES)):
        case = CASES[number]
        table = np.stack([figures(case, 100 + seed) for seed in range(seeds)])
        half = 1.96 * table.std(axis=0, ddof=1) / np.sqrt(seeds) if seeds > 1 else np.full(table.shape[1], np.nan)
        print(f"{number}: {case.vessel} {case.sea} {case.manoeuvre} {case.rate_hz} Hz, noise x{case.noise}")
        for row, sign in ((table.mean(axis=0), " "), (half, "±")):
            shares, rest = " ".join(f"{each:.3f}" for each in row[:9]), " ".join(f"{each:.2f}" for each in row[10:])
            print(f"  {sign} {shares} | {row[9]:.2f} | {rest}", flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 5, tuple(int(each) for each in sys.argv[2:]))
