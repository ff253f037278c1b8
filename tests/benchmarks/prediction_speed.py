"""How long one prediction takes: reference, calibrator, range and band, from one window.

Run it as ``python tests/benchmarks/prediction_speed.py [CALIBRATOR]``, the folder of a trained one; without it
each method is trained on a few made-up windows, which takes nothing from the work of a prediction. It prints and
asserts nothing.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))

from hybrid.calibrators import METHODS, make_calibrator
from hybrid.calibrators.artefact import load
from hybrid.calibrators.calibrator import Calibrator
from hybrid.calibrators.train import plant_for
from hybrid.effects import vessel_plant
from hybrid.prediction.baselines import reference
from hybrid.prediction.prediction_windows import PredictionWindows
from hybrid.vessel.files import load_vessel
from hybrid.vessel.plant import Plant
from tests.hybrid.windows_by_hand import random_windows

TIMES, SECONDS = 1000, 30


def measured_ms(action: Callable[[], object]) -> tuple[float, float]:
    """Median and 99th percentile of the time that it takes [ms]."""
    for _ in range(20):
        action()
    taken = []
    for _ in range(TIMES):
        began = time.perf_counter_ns()
        action()
        taken.append((time.perf_counter_ns() - began) / 1e6)
    return float(np.median(taken)), float(np.quantile(taken, 0.99))


def prediction(window: PredictionWindows, plant: Plant, calibrator: Calibrator) -> tuple[object, ...]:
    """Track, whether it is a guess, and the spread that the band is scaled by."""
    track = reference(window, plant)
    return calibrator.predict_with_uncertainty(window, track), calibrator.outside_domain(window, track)


def report(name: str, window: PredictionWindows, plant: Plant, calibrator: Calibrator) -> None:
    """Measure and print one calibrator."""
    median, late = measured_ms(lambda: prediction(window, plant, calibrator))
    print(f"{name:16s} median {median:6.2f} ms, 99 % within {late:6.2f} ms")


def main() -> None:
    """Measure and print."""
    if len(sys.argv) > 1:
        trained = load(Path(sys.argv[1]))
        window, plant = random_windows(1, trained.horizon_s, 5), plant_for(trained, None)
        report(trained.calibrator.method, window, plant, trained.calibrator)
        return
    plant, window = vessel_plant(load_vessel()), random_windows(1, SECONDS, 5)
    median, late = measured_ms(lambda: reference(window, plant))
    print(f"{'reference alone':16s} median {median:6.2f} ms, 99 % within {late:6.2f} ms")
    training, stopping = random_windows(200, SECONDS, 1), random_windows(50, SECONDS, 2)
    examples = [(each, reference(each, plant)) for each in (training, stopping)]
    for method in METHODS:
        report(method, window, plant, make_calibrator(method, 0, plant).fit(*examples))


if __name__ == "__main__":
    main()
