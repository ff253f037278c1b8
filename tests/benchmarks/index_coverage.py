"""Do the intervals of predicted indices hold the truth, for ships that only sailed zigzags?

    python -m tests.benchmarks.index_coverage SIZE

SIZE ships, up to 40, are drawn from the prior of Esso Osaka's file, sail three zigzags in still water with noisy
sensors and are identified from the file. Circles and crash stop, which they never sailed, are predicted; their true
values come from the ship that was drawn. Some two minutes a ship.
"""

from __future__ import annotations

import argparse
import sys
from math import isfinite, log

import numpy as np

from seatrial.hybrid.evaluation.predicted_indices import standard_indices
from seatrial.hybrid.identification.fit import SURROUNDINGS, coefficients_of, values_at, with_values
from seatrial.hybrid.identification.identify import identify_with_folds
from seatrial.hybrid.simulation.manoeuvres import steer, usual_rpm, zigzag
from seatrial.hybrid.simulation.trial import SimulationNoise, simulate_trial
from seatrial.hybrid.simulation.vessel_check import STILL
from seatrial.hybrid.vessel.files import Vessel, load_vessel

ZIGZAGS = ((10.0, 10.0), (20.0, 20.0), (30.0, 20.0))
APPROACH_S = 30.0
DECLARED = set(SURROUNDINGS) - {"command_delay_s"}
"""Still water, and sensors without errors but for the time of the records."""

LONGEST_S, RATE_HZ, MOST = 200.0, 5.0, 40


def drawn_ship(start: Vessel, seed: int) -> Vessel:
    """A ship from the prior of a vessel file, whose zigzags and circles stay in the range of the model."""
    generator, coefficients = np.random.default_rng(seed), coefficients_of(start)
    tests = standard_indices(start).keys()
    while True:
        ship = with_values(start, values_at(coefficients, generator.standard_normal(len(coefficients))))
        if standard_indices(ship).keys() == tests:
            return ship


def errors_of(start: Vessel, seed: int) -> dict[str, float]:
    """By test, side and index that were not sailed the error, where 1 is an end of the 95 % interval."""
    ship, quiet = drawn_ship(start, seed), SimulationNoise().scaled(0.2)
    rpm, tables = usual_rpm(ship), {}
    for number, angles in enumerate(ZIGZAGS):
        legs = (steer(0.0, APPROACH_S, rpm), *zigzag(*angles, rpm, swings=20))
        trial, _ = simulate_trial(ship, STILL, legs, LONGEST_S, RATE_HZ, 10 * seed + number, noise=quiet)
        tables[f"zigzag {angles}"] = trial
    identified, _ = identify_with_folds(tables, start, horizon_s=15, fixed=DECLARED)
    table = identified.indices
    truth = standard_indices(ship, table.speed_mps)
    result = {}
    for row in table.rows:
        key = (row.test, row.side, row.name)
        if row.measured is None and row.predicted is not None and key in truth and isfinite(row.predicted.low):
            result[" ".join(key)] = log(truth[key] / row.predicted.value) / log(
                row.predicted.high / row.predicted.value
            )
    print(f"  form errors {dict(table.form_errors)}", flush=True)
    return result


def main() -> None:
    """Print the share of true indices inside their intervals, and the root mean of errors: 0.51 of normal ones."""
    parser = argparse.ArgumentParser(prog="index_coverage", description=__doc__)
    parser.add_argument("size", type=int, help="the number of ships, up to 40")
    start, errors = load_vessel("esso_osaka_3m"), list[float]()
    for seed in range(min(parser.parse_args().size, MOST)):
        result = errors_of(start, seed)
        errors += result.values()
        held, spread = np.mean(np.abs(errors) <= 1.0), np.sqrt(np.mean(np.square(errors)))
        wide = {name: round(error, 2) for name, error in result.items() if abs(error) > 1.0}
        print(
            f"ship {seed}: {held:.1%} of {len(errors)} inside, root mean {spread:.2f}; outside {wide}", flush=True
        )


if __name__ == "__main__":
    sys.exit(main())
