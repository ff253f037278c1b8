"""Does the diagnosis name what is hidden in trials of ships with a propeller and a rudder?

    python -m tests.benchmarks.rudder_ship_trials -o results.jsonl [--workers N]

Forty trials with one effect each and twenty with none; what stands in the file of results is not done again. Some
fifteen minutes on two cores.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from seatrial.acquisition.core.errors import progress_bar
from tests.benchmarks.diagnosis.rudder_ships import singles, sound
from tests.benchmarks.diagnosis.scoring import covered, exact, in_set, names_something, share, silently_wrong
from tests.benchmarks.diagnosis.store import carried_out


def main() -> None:
    """Run what is missing, and print the scores."""
    parser = argparse.ArgumentParser(prog="rudder_ship_trials", description=__doc__)
    parser.add_argument("-o", "--output", type=Path, required=True, help="file of results, one JSON line a case")
    parser.add_argument("--workers", type=int, default=2)
    given = parser.parse_args()
    hidden, none = singles(), sound()
    with progress_bar(f"{len(hidden) + len(none)} trials") as progress:
        results = carried_out([*hidden, *none], given.output, given.workers, tell, progress)
    every = [[results[case.key] for case in cases] for cases in (hidden, none)]
    one, nothing = ([result for result in part if "said" in result] for part in every)
    print(f"refused: {sum(map(len, every)) - len(one) - len(nothing)}")
    for title, value in (
        ("named, and nothing else", share(one, exact)),
        ("in the reported set", share(one, in_set)),
        ("silently wrong", share(one, silently_wrong)),
        ("95 % intervals that hold the truth", covered(one)),
        ("false names in sound trials", share(nothing, names_something)),
    ):
        print(f"{title}: {value}")


def tell(result: dict[str, Any]) -> None:
    """One line a trial."""
    if "said" not in result:
        print(f"{result['key']}: {result}", flush=True)
        return
    said = result["said"]
    names = ", ".join(each["name"] for each in said["effects"]) or "-"
    print(f"{result['key']}: {said['verdict']}: {names} {said['indistinguishable'] or ''}", flush=True)


if __name__ == "__main__":
    main()
