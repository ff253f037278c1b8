"""Does the diagnosis name what is hidden, and nothing else? Trials simulated with hidden effects, scored blind.

    python -m tests.benchmarks.diagnosis_trials -o results.jsonl [--size SIZE] [--only GROUP] [--every N]

The analyst sees the 13 channels only; the truth is compared afterwards. What stands in the file of results is not
done again, so that a run may be broken off and taken up. ``small`` takes some ten minutes on two cores,
``designed``, 300 cases of all groups, two hours, ``full`` a night. ``--page`` writes the results as a page, its
pictures beside it; ``--done`` does nothing new and writes it of what stands in the file.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any, get_args

from seatrial.acquisition.core.errors import progress_bar
from tests.benchmarks.diagnosis.cases import GROUPS, Size, cases_of
from tests.benchmarks.diagnosis.page import write_page
from tests.benchmarks.diagnosis.plan import planned, preparations
from tests.benchmarks.diagnosis.store import carried_out, stored


def main() -> None:
    """Prepare, run, score, write."""
    parser = argparse.ArgumentParser(prog="diagnosis_trials", description=__doc__)
    parser.add_argument("-o", "--output", type=Path, required=True, help="file of results, one JSON line a case")
    parser.add_argument("--size", choices=get_args(Size), default="small")
    parser.add_argument("--only", action="append", choices=GROUPS, help="a group; may be repeated")
    parser.add_argument("--every", type=int, default=1, help="take every so many cases of each group only")
    parser.add_argument("--done", action="store_true", help="only write the page of what has been done")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--page", type=Path, help="where to write the page of results")
    given = parser.parse_args()
    if given.done:
        mine, none = [each for each in stored(given.output).values() if "group" in each], {}
    else:
        mine, none = run(given)
    text = write_page(mine, none, given.size, given.page)
    if given.page is None:
        print(text)


def run(given: argparse.Namespace) -> tuple[list[dict[str, Any]], dict[str, str]]:
    """Prepare and do the cases asked for; their results, and why others are none."""
    groups = [[case for case in cases_of(given.size) if case.group == group] for group in given.only or GROUPS]
    cases = [case for group in groups for case in group[:: given.every]]
    with progress_bar("predicting limits") as progress:
        before = carried_out(preparations(cases), given.output, given.workers, progress=progress)
    plan = planned(cases, before)
    with progress_bar(f"{len(plan.cases)} cases") as progress:
        results = carried_out(plan.cases, given.output, given.workers, tell, progress)
    return [results[each.case.key] for each in plan.cases], plan.none


def tell(result: dict[str, Any]) -> None:
    """One line a case, so that a long run can be followed."""
    if "said" not in result:
        print(f"{'refused' if 'refused' in result else 'CRASHED':17s}{result['key']}: {result}", flush=True)
        return
    said = result["said"]
    names = ", ".join(each["name"] for each in said["effects"]) or "-"
    unknown = f" ({said['unknown']['looks_like']})" if said["unknown"] else ""
    truth = ", ".join([*result["hidden"], *result["outside"]]) or "nothing"
    print(f"{said['verdict']:17s}{result['key']}: {truth} -> {names}{unknown}", flush=True)


if __name__ == "__main__":
    main()
