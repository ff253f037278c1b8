"""Does the diagnosis put back what is taken out of a good model, on measured data?

    python -m tests.benchmarks.hidden_in_measured FOLDER -o results.jsonl [--only KIND] [--parts N]

FOLDER has the trials of the 3 m model of Esso Osaka (data set FRT-DS-ESSO), by manoeuvre. They are dealt into
parts; each part is diagnosed with a term taken out of the vessel file, or with an error put into the record, and
judged on the recordings of the others. What stands in the file of results is not done again; ``--done`` only prints
the tables of what has been done.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from seatrial.acquisition.core.errors import progress_bar
from tests.benchmarks.diagnosis.store import carried_out, stored
from tests.benchmarks.measured.judge import cases_of, recordings_in
from tests.benchmarks.measured.kinds import KINDS
from tests.benchmarks.measured.page import page


def main() -> None:
    """Run what is missing, and print or write the tables."""
    parser = argparse.ArgumentParser(prog="hidden_in_measured", description=__doc__)
    parser.add_argument("folder", type=Path, help="the recordings, in folders by manoeuvre")
    parser.add_argument("-o", "--output", type=Path, required=True, help="file of results, one JSON line a case")
    parser.add_argument("--only", action="append", choices=list(KINDS), help="a kind; may be repeated")
    parser.add_argument("--parts", type=int, default=3, help="into so many the recordings are dealt")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--done", action="store_true", help="only print the tables of what has been done")
    given = parser.parse_args()
    if not given.done and not recordings_in(given.folder):
        print(f"skipped: no recordings (*/*.csv.gz) below {given.folder}")
        return
    results = stored(given.output) if given.done else run(given)
    print(page([each for each in results.values() if "said" in each]))


def run(given: argparse.Namespace) -> dict[str, dict[str, Any]]:
    """Do the cases asked for."""
    cases = cases_of(given.folder, given.only or list(KINDS), given.parts)
    with progress_bar(f"{len(cases)} cases") as progress:
        return carried_out(cases, given.output, given.workers, tell, progress)


def tell(result: dict[str, Any]) -> None:
    """One line a case, so that a long run can be followed."""
    said = [each["name"] for each in result["said"]["effects"]] if "said" in result else result
    print(f"{result['key']}: {said}", flush=True)


if __name__ == "__main__":
    main()
