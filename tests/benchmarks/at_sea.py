"""Does the diagnosis name what differs from day to day, and what changes within a trial?

    python -m tests.benchmarks.at_sea -o results.jsonl [--cases N] [--workers N] [--kind KIND]

N trials each of two days with a fouling and two currents, a tide that turns, a tow that is dropped, a fouling that
grows from day to day, and two days with nothing hidden; of four to six effects at once, of a fouling and a current
without a record of the wind, and recorded every two seconds; of play in a gear, of a fouling and a current with a
dead channel of feedback and orders beside, and of one effect on a ship whose coefficients are all off by 15 %; of
feedback in steps, of a position late by up to a second, of a trim that changes during a break, of a compass that
jumps, of half an hour at the quay; all by the second simulator. What stands in the file of results is not done
again. About a minute a trial.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from seatrial.acquisition.core.errors import progress_bar
from tests.benchmarks.diagnosis.at_sea import KINDS, cases_at_sea
from tests.benchmarks.diagnosis.scoring import Share, exact, gap_closed, in_set, reported_set, share, silently_wrong
from tests.benchmarks.diagnosis.store import carried_out

_NOTHING = "nothing"


def main() -> None:
    """Run what is missing, and print the scores."""
    parser = argparse.ArgumentParser(prog="at_sea", description=__doc__)
    parser.add_argument("-o", "--output", type=Path, required=True, help="file of results, one JSON line a case")
    parser.add_argument("--cases", type=int, default=10, help="of each kind")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--kind", choices=KINDS, action="append", help="all unless given")
    given = parser.parse_args()
    kinds = given.kind or list(KINDS)
    cases = [case for case in cases_at_sea(given.cases) if case.kind in kinds]
    with progress_bar(f"{len(cases)} trials") as progress:
        results = carried_out(cases, given.output, given.workers, tell, progress)
    for kind in kinds:
        print_scores(kind, [results[case.key] for case in cases if case.kind == kind])


def print_scores(kind: str, every: list[dict[str, Any]]) -> None:
    """The scores of a kind."""
    done = [result for result in every if "said" in result]
    print(f"\n{kind}: {len(done)} trials, {len(every) - len(done)} refused")
    print(f"  named, and nothing else: {share(done, exact)}")
    print(f"  wrong name: {share(done, silently_wrong)}")
    if kind == _NOTHING:
        return
    if not done:
        return
    inside = [each for result in done for each in result["held"]]
    closed = np.array([gap_closed(result) for result in done])
    print(f"  in the reported set: {share(done, in_set)}")
    every_effect = [name in reported_set(result) for result in done for name in result["hidden"]]
    print(f"  effects in the reported set, one by one: {Share(sum(every_effect), len(every_effect))}")
    print(f"  95 % intervals that hold the truth, of all parts: {Share(sum(inside), len(inside))}")
    print(f"  gap closed on unseen legs, median and least: {np.median(closed):.2f}, {closed.min():.2f}")


def tell(result: dict[str, Any]) -> None:
    """One line a trial."""
    if "said" not in result:
        print(f"{result['key']}: {result}", flush=True)
        return
    said = result["said"]
    names = "; ".join(each["sentence"] for each in said["effects"]) or "-"
    unknown = (said["unknown"] or {}).get("looks_like", "")
    print(f"{result['key']}: {said['verdict']}: {names} {said['indistinguishable'] or ''} {unknown}", flush=True)


if __name__ == "__main__":
    main()
