"""How long one prediction takes: reference, calibrator, range and band, from one window; and with all before it,
from the 1 Hz table and a plan of orders on, as ``predict --commands`` and ``watch`` make it. Beside the time by the
clock, which other work on the machine lengthens, the time of the processor.

Run it as ``python tests/benchmarks/prediction_speed.py [CALIBRATOR]``, the folder of a trained one; without it
each method is trained on a few made-up windows, which takes nothing from the work of a prediction. It prints and
asserts nothing.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

sys.path.insert(0, str(Path(__file__).parents[2]))

from seatrial.acquisition.core.quantities import Floats
from seatrial.analysis.windows.held import OneHertzTables
from seatrial.hybrid.calibrators import METHODS, Calibrator, TrainedCalibrator, make_calibrator, train_calibrator
from seatrial.hybrid.calibrators.own import load
from seatrial.hybrid.calibrators.predict import predict
from seatrial.hybrid.effects import vessel_plant
from seatrial.hybrid.prediction.baselines import simulate_reference
from seatrial.hybrid.prediction.dataset import Dataset
from seatrial.hybrid.prediction.window_sets import PAST_S, PredictionWindows
from seatrial.hybrid.vessel.files import load_vessel
from seatrial.hybrid.vessel.plant import Plant
from tests.hybrid.twin.steady_ship import steady_table
from tests.hybrid.windows_by_hand import voyages

TIMES, SECONDS, LONGEST_S = 1000, 30, 300


def measured_ms(action: Callable[[], object]) -> Floats:
    """Median and 99th percentile of the time that it takes, by the clock and of the processor [2, 2] [ms]."""
    for _ in range(20):
        action()
    taken = []
    for _ in range(TIMES):
        began = time.perf_counter_ns(), time.process_time_ns()
        action()
        taken.append((time.perf_counter_ns() - began[0], time.process_time_ns() - began[1]))
    return np.quantile(np.array(taken) / 1e6, (0.5, 0.99), axis=0).T


def prediction(window: PredictionWindows, plant: Plant, calibrator: Calibrator) -> tuple[object, ...]:
    """Track, whether it is a guess, and the spread that the band is scaled by."""
    track = simulate_reference(window, plant)
    return calibrator.predict_with_uncertainty(window, track), calibrator.outside_domain(window, track)


def report(name: str, action: Callable[[], object]) -> None:
    """Measure and print one of them."""
    (median, late), (busy, most) = measured_ms(action)
    print(
        f"{name:26s} median {median:5.2f} ms, 99 % within {late:5.2f} ms; processor {busy:5.2f} ms, {most:5.2f} ms"
    )


def report_planned(trained: TrainedCalibrator) -> None:
    """From the table of a ship under way, with a helm order half-way, over 30 s and as far as it predicts."""
    table = steady_table(PAST_S + 60.0, 1.0)
    orders = pd.DataFrame({"port_angle_deg": [5.0]}, index=pd.Index([15.0], name="second"))
    for horizon_s in sorted({min(SECONDS, trained.horizon_s), trained.horizon_s}):
        report(
            f"{trained.calibrator.method}, planned, {horizon_s} s",
            partial(predict, OneHertzTables(table), table.index[-1], horizon_s, trained.plant, trained, orders),
        )


def any_commands(plant: Plant) -> TrainedCalibrator:
    """A calibrator of any commands over :data:`LONGEST_S`, of a few voyages."""
    windows = voyages(plant, 60, LONGEST_S)
    windows = replace(windows, commands=windows.acting_controls, two_sided=windows.start)
    return train_calibrator(Dataset(windows, (), len(windows)), "gunnerus_short", plant)


def main() -> None:
    """Measure and print."""
    if len(sys.argv) > 1:
        trained = load(Path(sys.argv[1]))
        window, calibrator = voyages(trained.plant, 1, trained.horizon_s), trained.calibrator
        report(calibrator.method, partial(prediction, window, trained.plant, calibrator))
        if calibrator.any_commands:
            report_planned(trained)
        return
    plant = vessel_plant(load_vessel())
    window = voyages(plant, 1, SECONDS, 5)
    report("reference alone", partial(simulate_reference, window, plant))
    training, stopping = (voyages(plant, count, SECONDS, seed) for count, seed in ((200, 1), (50, 2)))
    examples = [(each, simulate_reference(each, plant)) for each in (training, stopping)]
    for method in METHODS:
        calibrator = make_calibrator(method, 0, plant).fit(*examples)
        report(f"{method}, {SECONDS} s", partial(prediction, window, plant, calibrator))
    report_planned(any_commands(plant))


if __name__ == "__main__":
    main()
