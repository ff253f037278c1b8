"""Does the diagnosis of a trial in a sea name current and wave drift, and nothing else? Ships of several sizes.

    python -m tests.benchmarks.sea_trials [TRIALS] [--workers N]

TRIALS of each of five ships in each of two sea states: voyages of 20 minutes of R/V Gunnerus as ``seatrial
simulate`` makes them, at 4 Hz, in which the waves' drift is slow and uneven. Ten, a hundred diagnoses, take some
twenty minutes on two cores.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from itertools import product

from seatrial.acquisition.core.errors import progress_bar
from seatrial.hybrid.simulation.manoeuvres import pace_of
from seatrial.hybrid.simulation.trial import simulate_trial
from seatrial.hybrid.vessel.files import load_vessel
from seatrial.hybrid.workflows import diagnose_tables
from tests.benchmarks.diagnosis.rudder_ships import SHIPS, ship_named

OF_THE_SEA = {"ocean_current", "wave_drift"}
SEAS = ("gentle", "moderate")
_VOYAGE_S = 1200.0  # of R/V Gunnerus; another ship's goes with the time for her own length

Trial = tuple[str, str, int]


def trials(number: int) -> list[Trial]:
    """Ship, sea state and seed of each."""
    return list(product(("gunnerus_long", *SHIPS), SEAS, range(1, number + 1)))


def outcome(trial: Trial) -> str:
    """What the diagnosis says of it: right, incomplete, a wrong name, or the verdict that names nothing."""
    ship, sea, seed = trial
    vessel = ship_named(ship) if ship in SHIPS else load_vessel(ship)
    table, _ = simulate_trial(vessel, sea, "voyage", _VOYAGE_S * pace_of(vessel).time, 4.0, seed)
    found = diagnose_tables([table], vessel).diagnosis
    return judged(found.verdict, {each.name for each in found.effects})


def judged(verdict: str, names: set[str]) -> str:
    """Drift too small to be named, below the tolerance, is no fault; a current always shows."""
    if names - OF_THE_SEA:
        return "a wrong name"
    if verdict == "unknown":
        return "unknown"
    return "right" if "ocean_current" in names else "the current is not named"


def main(arguments: Sequence[str] | None = None) -> None:
    """Run and count."""
    parser = argparse.ArgumentParser(prog="sea_trials", description=__doc__)
    parser.add_argument("trials", type=int, nargs="?", default=10)
    parser.add_argument("--workers", type=int, default=2)
    given = parser.parse_args(arguments)
    every, found = trials(given.trials), Counter[tuple[str, str, str]]()
    with ProcessPoolExecutor(given.workers) as pool, progress_bar(f"{len(every)} trials") as progress:
        for number, (trial, said) in enumerate(zip(every, pool.map(outcome, every), strict=True), 1):
            found[*trial[:2], said] += 1
            progress(number / len(every))
            if said != "right":
                print(*trial, said, flush=True)
    for (ship, sea, said), count in sorted(found.items()):
        print(f"{ship:16s} {sea:9s} {said}: {count} of {given.trials}")


if __name__ == "__main__":
    main()
