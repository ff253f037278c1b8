"""How long a day of trials takes with the conductor's advice, and without.

    python -m tests.benchmarks.advised_days [--days 20] [--first 0] [--ships tanker gunnerus twin_screw]

The ships, faults, wind and tide of :mod:`tests.benchmarks.conducted_days`, but the ship that sails is drawn from
the prior of the file that the conductor has: its coefficients are off by their usual errors. *Without*, all runs of
IMO's tests are sailed to their end, and those that were invalid once more until none is; that this is found ashore,
on another day, costs nothing here. *With* advice a run is given up at its first fault, and one is skipped whose
criteria are predicted to be met. Time counts until all criteria to both sides are shown, measured or predicted.
Printed are both times, and whether the predictions for which runs were skipped hold the truth in calm.
"""

from __future__ import annotations

import argparse
import time
from math import log

import numpy as np
from scipy.stats import t as student_t

from seatrial.acquisition.core.errors import SeatrialError
from seatrial.acquisition.core.quantities import Floats
from seatrial.analysis.conduct.outlook import RecordedRun
from seatrial.analysis.manoeuvres import criteria
from seatrial.hybrid.evaluation.predicted_indices import standard_indices
from seatrial.hybrid.identification.fit import coefficients_of, values_at, with_values
from seatrial.hybrid.identification.outlook import indices_of_run, outlook_of_runs
from seatrial.hybrid.vessel.files import Vessel
from tests.benchmarks.conducted_days import STEP_S, Day, vessel_of

SPREAD = 0.7
"""Of the prior's width: what the coefficients of the ship that sails are off by."""


def drawn_ship(file: Vessel, seed: int) -> Vessel:
    """A ship from the prior of a vessel file that makes the standard manoeuvres in the range of its model."""
    generator, coefficients = np.random.default_rng(seed), coefficients_of(file)
    tests = standard_indices(file).keys()
    while True:
        ship = with_values(file, values_at(coefficients, SPREAD * generator.standard_normal(len(coefficients))))
        try:
            if standard_indices(ship).keys() == tests:
                return ship
        except SeatrialError:
            continue


class AdvisedDay(Day):
    """A day on which what the conductor says of faults and of runs that remain is followed."""

    def __init__(self, name: str, seed: int, ship: Vessel) -> None:
        self.file, self.errors, self.outlook_s = vessel_of(name), list[float](), list[float]()
        super().__init__(name, seed, ship=ship)

    def _conduct(self, now_s: float, state: Floats) -> bool:
        conductor, sailing = self.conductor, self.sailing
        if sailing is not None and conductor.state.phase == "sailing" and conductor.state.faults:
            conductor.abort()
            sailing.aborted = True
            self._stand_down(now_s)
        return super()._conduct(now_s, state)

    def _consider(self) -> None:
        conductor, table = self.conductor, self.table()
        recorded = [
            RecordedRun(
                self.programme.run[entry.place],
                conductor.judged_span_of(entry).rows_of(table),
                entry.outcome == "valid",
            )
            for entry in conductor.sailed if entry.manoeuvre
        ]  # fmt: skip
        if len(recorded) < 3 or not conductor.remaining:
            return
        began_s = time.process_time()
        try:
            remaining = {place: self.programme.run[place] for place in conductor.remaining}
            outlook = outlook_of_runs(self.file, self.programme, recorded, remaining)
        except SeatrialError:
            return
        self.outlook_s.append(time.process_time() - began_s)
        conductor.take_outlook(outlook)
        while (place := conductor.place) is not None and outlook.runs[place].is_needless(self.programme.run[place]):
            truth = indices_of_run(self.programme.run[place], self.programme, self.vessel)
            for criterion in criteria.CRITERIA:
                index = outlook.runs[place].predicted.get(criterion.name)
                if index is not None:  # 1 is an end of the interval
                    self.errors.append(log(truth[criterion.index] / index.value) / log(index.high / index.value))
                    assert index.limit is not None
                    if truth[criterion.index] > index.limit:
                        self.errors[-1] = np.inf
            conductor.skip()


def hours_of(day: Day) -> float:
    """How long a day took [h]."""
    return day.states.shape[0] * STEP_S / 3600.0


def interval_of_mean(values: list[float]) -> str:
    """The mean with its 95 % interval."""
    mean = float(np.mean(values))
    if len(values) < 2:
        return f"{mean:.1%}"
    half = float(student_t.ppf(0.975, len(values) - 1) * np.std(values, ddof=1) / np.sqrt(len(values)))
    return f"{mean:.1%} ({mean - half:.1%} to {mean + half:.1%})"


def main() -> None:
    """Sail the days twice and print what the advice spared."""
    parser = argparse.ArgumentParser(prog="advised_days", description=__doc__)
    parser.add_argument("--days", type=int, default=20)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--ships", nargs="*", default=["tanker", "gunnerus", "twin_screw"])
    options = parser.parse_args()
    spared, errors = list[float](), list[float]()
    for name in options.ships:
        for seed in range(options.first, options.first + options.days):
            ship = drawn_ship(vessel_of(name), seed)
            without, advised = Day(name, seed, ship=ship), AdvisedDay(name, seed, ship)
            hours = hours_of(without), hours_of(advised)
            outcomes = [entry.outcome for entry in advised.conductor.sailed]
            spared.append(1.0 - hours[1] / hours[0])
            errors += advised.errors
            skipped, given_up = (outcomes.count(outcome) for outcome in ("skipped", "aborted"))
            inside = np.mean(np.abs(errors) <= 1.0) if errors else 1.0
            print(
                f"{name} {seed}: {hours[0]:.1f} h without, {hours[1]:.1f} h with; skipped {skipped}, given up "
                f"{given_up}; predictions {np.round(advised.errors, 2).tolist()}, processor time of an outlook "
                f"{np.mean(advised.outlook_s or [0.0]):.0f} s; so far spared {interval_of_mean(spared)}, "
                f"{inside:.1%} of {len(errors)} predictions inside",
                flush=True,
            )


if __name__ == "__main__":
    main()
