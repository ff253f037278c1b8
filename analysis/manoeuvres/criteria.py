"""Indices of like runs, port beside starboard, and what they show of the criteria of IMO MSC.137(76).

Runs are alike that have one name (test and helm) and one approach speed within a fifth. The mean of three and more
has the 95 % interval of their own intervals or of the scatter between them (Student's t), whichever is wider. Two
say next to nothing of the scatter (Student's factor is 12.7): their mean stands with the range of both.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from operator import ne
from typing import Any

import numpy as np

from seatrial.analysis.manoeuvres.indices import Index, Manoeuvre, from_order, nominal_deg
from seatrial.analysis.manoeuvres.standards import (
    CANNOT_BE_SAID,
    CRITERIA,
    MET,
    NO_LENGTH,
    NOT_FOR_SHIP,
    NOT_MET,
    NOT_SHOWN,
    RESOLUTION,
    Criterion,
    criterion_of,
    largest_helm_deg,
    result_of,
)
from seatrial.analysis.manoeuvres.turning_circle import REMOVED
from seatrial.analysis.manoeuvres.zigzag import SWITCH_SHARE

_MAIN = {
    "turning_circle": ("advance_m", "transfer_m", "tactical_diameter_m", "steady_diameter_m"),
    "course_change": ("initial_turning_m", "advance_m", "transfer_m", "tactical_diameter_m"),
    "zigzag": (from_order(1), from_order(2), "initial_turning_m"),
    "stopping": ("track_reach_m", "head_reach_m", "lateral_deviation_m", "stopping_time_s"),
    "pull_out": ("residual_yaw_rate_dps",),
    "acceleration": ("time_to_90_percent_s", "distance_to_90_percent_m"),
    "crabbing": ("sway_mps",),
    "thruster_test": ("last_yaw_rate_dps",),
}
"""The indices of a kind that stand on the page of indices; of kinds that are not here the first three."""
_SINGLE = ("speed_run", "acceleration", "crabbing", "thruster_test")
"""Kinds whose runs differ in their settings: no means over them."""
_SPEED_SHARE = 0.2
_FEW_RUNS = 2  # of which no interval is made
_TESTS_AFTER_APPROACH = ("zigzag", "turning_circle", "stopping", "spiral")
_LEADS_INTO_S, _LEAST_TEST_DEG = 30.0, 270.0  # the end of a straight run is known to some 20 s


@dataclass(frozen=True, slots=True)
class Mean:
    """The mean of an index over ``runs`` runs and its 95 % interval, of two runs the range of both; NaN where the
    interval is not known. ``removed`` says that the current is removed from all of them.
    """

    index: Index
    runs: int
    removed: bool = False

    @property
    def half(self) -> float:
        return 0.5 * (self.index.high - self.index.low)


@dataclass(frozen=True, slots=True)
class IndexRow:
    """One index of like runs: its mean by side ("port", "starboard", "" for tests that have none).

    Of each side there is one value: with the current removed where that is known of all its runs. ``criterion`` is
    the one that the index is judged by, None where there is none; ``place`` is that of the test among all.
    """

    test: str
    name: str
    sides: Mapping[str, Mean]
    criterion: Criterion | None = None
    place: int = 0

    @property
    def limit(self) -> Index | None:
        """The index whose limit is the strictest; None where there is none."""
        limited = [mean.index for mean in self.sides.values() if mean.index.limit is not None]
        return min(limited, key=lambda index: index.limit or 0.0) if limited else None

    @property
    def judged_side(self) -> str:
        """The side whose value decides: of two that have limits the worse one; empty where there is no choice."""
        limited = {side: mean.index for side, mean in self.sides.items() if mean.index.limit}
        if len(limited) < 2:
            return ""
        return max(limited, key=lambda side: limited[side].value / (limited[side].limit or 1.0))

    @property
    def result(self) -> str:
        """The worst result of its sides, empty where there is no criterion."""
        results = {mean.index.result for mean in self.sides.values()}
        return next((result for result in (NOT_MET, CANNOT_BE_SAID, NOT_SHOWN, MET) if result in results), "")

    @property
    def missing(self) -> tuple[str, ...]:
        """What is missing to show the criterion, to either side."""
        return tuple(dict.fromkeys(reason for mean in self.sides.values() for reason in mean.index.missing))


@dataclass(frozen=True, slots=True)
class CriterionResult:
    """What a trial shows of a criterion to one side; ``mean`` is None without a run of its test."""

    criterion: Criterion
    side: str
    mean: Mean | None
    result: str
    missing: tuple[str, ...]

    def as_json(self) -> dict[str, Any]:
        """With the keys of the contract."""
        value = {"value": None, "low": None, "high": None, "unit": None, "limit": None, "counted_from": None}
        known = self.mean.index.as_json() if self.mean else value
        runs = self.mean.runs if self.mean else 0
        return {
            "criterion": self.criterion.name, "clause": f"{RESOLUTION}, {self.criterion.clause}", "side": self.side,
            "index": self.criterion.index, **known, "runs": runs, "result": self.result,
            "missing": list(self.missing),
        }  # fmt: skip


def mean_of(runs: Sequence[Index]) -> Mean:
    """The mean of an index over runs; its interval is the wider of that of their errors and that of the scatter, of
    two runs the range that their own intervals cover. Its limit is the strictest, and it shows what all of them
    show."""
    count = len(runs)
    low, high = _range(runs) if count <= _FEW_RUNS else _interval(runs)
    value = float(np.mean([run.value for run in runs]))
    lengths = [run.lengths for run in runs if run.lengths is not None]
    limits = [run.limit for run in runs if run.limit is not None]
    missing = tuple(dict.fromkeys(reason for run in runs for reason in run.missing))
    mean_lengths = float(np.mean(lengths)) if len(lengths) == count else None
    limit = min(limits) if len(limits) == count else None
    index = replace(runs[0], value=value, low=low, high=high, lengths=mean_lengths, limit=limit)
    result = "" if index.limit is None else result_of(index, index.limit, missing)
    if result == MET and {run.result for run in runs} & {NOT_MET, CANNOT_BE_SAID}:
        result = CANNOT_BE_SAID  # a mean does not meet what one of its runs does not
    return Mean(replace(index, result=result, missing=missing), count)


def _range(runs: Sequence[Index]) -> tuple[float, float]:
    """From the least to the greatest of one or two runs, with what each is known within."""
    if len(runs) == 1:
        return runs[0].low, runs[0].high
    ends = np.array([(each.value, each.low, each.high) for each in runs])
    return float(ends.min()), float(ends.max())


def _interval(runs: Sequence[Index]) -> tuple[float, float]:
    """The 95 % interval of the mean of runs, from their own or from their scatter, whichever is wider."""
    from scipy.stats import t

    count, values = len(runs), np.array([each.value for each in runs])
    within = np.array([0.5 * (each.high - each.low) for each in runs])
    scatter = t.ppf(0.975, count - 1) * values.std(ddof=1) / np.sqrt(count)
    half = float(np.max([np.sqrt(np.sum(within**2)) / count, scatter]))
    return float(values.mean()) - half, float(values.mean()) + half


def index_rows(runs: Iterable[Manoeuvre]) -> list[IndexRow]:
    """The main indices of all tests: means over like ones, tests that have limits first. Approaches and turns to
    another course are none.
    """
    trial = tuple(runs)
    largest_deg = largest_helm_deg(trial)
    tested = (run for run in trial if not (_is_approach(run, trial) or _is_change_of_course(run, largest_deg)))
    tests = [_rows_of_test(test, largest_deg) for test in like_runs(tested)]
    ordered = sorted(tests, key=lambda rows: not any(row.result for row in rows))
    return [replace(row, place=place) for place, rows in enumerate(ordered) for row in rows]


def _is_approach(run: Manoeuvre, trial: Iterable[Manoeuvre]) -> bool:
    """Whether a straight run leads into a test. A circle of less than three quarters may lead to the reciprocal
    course, and the next run."""
    return run.kind == "speed_run" and any(
        0.0 <= (test.start - run.end).total_seconds() <= _LEADS_INTO_S
        and test.kind in _TESTS_AFTER_APPROACH
        and test.settings.get("turned_deg", 360.0) >= _LEAST_TEST_DEG
        for test in trial
    )


def _is_change_of_course(run: Manoeuvre, largest_deg: float) -> bool:
    return run.kind == "course_change" and not any(criterion_of(run, name, largest_deg) for name in run.indices)


def like_runs(manoeuvres: Iterable[Manoeuvre]) -> list[list[Manoeuvre]]:
    """The manoeuvres in groups of like runs, in the order of each group's first."""
    groups: list[list[Manoeuvre]] = []
    for each in manoeuvres:
        like = next((group for group in groups if _alike(group[0], each)), None)
        if like is None:
            groups.append([each])
        else:
            like.append(each)
    return groups


def _alike(one: Manoeuvre, other: Manoeuvre) -> bool:
    if (one.kind, one.name) != (other.kind, other.name) or one.kind in _SINGLE:
        return False
    if any(map(ne, _angles_of(one), _angles_of(other))):  # the crew may have given two tests one name
        return False
    speeds = [each.settings.get("approach_mps", 0.0) for each in (one, other)]
    return abs(speeds[0] - speeds[1]) <= _SPEED_SHARE * max(map(abs, speeds))


def _angles_of(run: Manoeuvre) -> tuple[float, float]:
    """The nominal helm and switching angle of a run [deg]."""
    return nominal_deg(run.helm_deg or 0.0), nominal_deg(run.settings.get("switch_deg", 0.0), SWITCH_SHARE)


def test_name(test: Sequence[Manoeuvre]) -> str:
    """What like runs are: the name of the test and the mean speed of the approach, of a single run the time."""
    if test[0].kind in _SINGLE:
        return f"{test[0].name[:1].upper()}{test[0].name[1:]}, {test[0].start:%H:%M:%S}"
    speeds = [each.settings["approach_mps"] for each in test if "approach_mps" in each.settings]
    at = f" at {np.mean(speeds):.2f} m/s" if speeds else ""
    return f"{test[0].name[:1].upper()}{test[0].name[1:]}{at}"


def _rows_of_test(test: Sequence[Manoeuvre], largest_deg: float) -> list[IndexRow]:
    names = dict.fromkeys(name for run in test for name in _main_indices(run))
    rows = []
    for name in names:
        sides = {
            side: _side_of(runs, name)
            for side in ("port", "starboard", "")
            if (runs := [run for run in test if run.side == side and name in run.indices])
        }
        rows.append(IndexRow(test_name(test), name, sides, criterion_of(test[0], name, largest_deg)))
    return rows


def _side_of(runs: Sequence[Manoeuvre], name: str) -> Mean:
    """The mean of an index over the runs to one side, with the current removed where all of them have that."""
    removed = all(name + REMOVED in run.indices for run in runs)
    return replace(mean_of([run.indices[name + REMOVED * removed] for run in runs]), removed=removed)


def _main_indices(manoeuvre: Manoeuvre) -> list[str]:
    found = manoeuvre.indices
    main: Iterable[str] = _MAIN.get(manoeuvre.kind, tuple(found)[:3])
    if manoeuvre.kind == "speed_run":
        main = ["speed_through_water_mps" if "speed_through_water_mps" in found else "speed_over_ground_mps"]
    return [name for name in main if name in found]


def criteria_of(rows: Sequence[IndexRow]) -> list[CriterionResult]:
    """What a trial shows of each criterion, to each side that the standards ask for.

    Of several tests of one criterion the one counts that shows most: with a result before one without, and of those
    the worst.
    """
    return [_criterion_result(criterion, side, rows) for criterion in CRITERIA for side in criterion.sides]


_ORDER_OF_RESULTS = (NOT_MET, CANNOT_BE_SAID, MET, NOT_SHOWN)


def _criterion_result(criterion: Criterion, side: str, rows: Sequence[IndexRow]) -> CriterionResult:
    means = [row.sides[side] for row in rows if row.criterion is criterion and side in row.sides]
    shown = [mean for mean in means if mean.index.limit is not None]
    if shown:
        mean = min(shown, key=lambda mean: (_ORDER_OF_RESULTS.index(mean.index.result), len(mean.index.missing)))
        return CriterionResult(criterion, side, mean, mean.index.result, mean.index.missing)
    if means:
        return CriterionResult(criterion, side, means[0], NOT_SHOWN, means[0].index.missing or (NO_LENGTH,))
    other = any(row.criterion is criterion for row in rows)
    return CriterionResult(criterion, side, None, NOT_SHOWN, (f"no run to {side}" if other else "no such test",))


def headline_of_criteria(results: Sequence[CriterionResult], subject: str = "The trial") -> str:
    """What a trial shows of the standards in one sentence; it meets them only where all is shown and met."""
    by_result = {name: [entry for entry in results if entry.result == name] for name in _ORDER_OF_RESULTS}
    total = len(results)
    if len(by_result[MET]) == total:
        return f"{subject} meets IMO {RESOLUTION}: all {total} criteria are shown and met."
    not_for_her = next((why for entry in results for why in entry.missing if why.startswith(NOT_FOR_SHIP)), "")
    parts = [f"{len(by_result[MET])} of {total} criteria of IMO {RESOLUTION} are shown and met"]
    parts = [f"IMO {RESOLUTION}: {not_for_her}; its limits are for information only"] if not_for_her else parts
    for name, words in (
        (NOT_MET, "not met"),
        (CANNOT_BE_SAID, "cannot be said, as the interval contains the limit"),
    ):
        if by_result[name]:
            parts.append(f"{words}: {_sided_names(by_result[name])}")
    parts += [] if not_for_her else [f"{len(by_result[NOT_SHOWN])} are not shown"]
    above = [entry for entry in by_result[NOT_SHOWN] if entry.mean and _lies_above(entry.mean.index)]
    if above:
        parts.append(f"above the limit lie: {_sided_names(above)}")
    return "; ".join(parts) + "."


def _lies_above(index: Index) -> bool:
    return index.limit is not None and index.value > index.limit


def _sided_names(results: Sequence[CriterionResult]) -> str:
    """The criteria with their sides: "advance to port and starboard, track reach"."""
    sides: dict[str, list[str]] = {}
    for entry in results:
        sides.setdefault(entry.criterion.name, []).append(entry.side)
    return ", ".join(f"{name} to {' and '.join(both)}" if any(both) else name for name, both in sides.items())


def shortfalls_of(results: Sequence[CriterionResult]) -> list[tuple[str, str]]:
    """Why criteria are not shown, each reason once with those that it is for."""
    by_reason: dict[str, list[CriterionResult]] = {}
    for entry in results:
        for reason in entry.missing:
            by_reason.setdefault(reason, []).append(entry)
    total = sum(entry.mean is not None for entry in results)
    return [
        (reason, "all that were measured" if len(entries) == total and entries[0].mean else _sided_names(entries))
        for reason, entries in by_reason.items()
    ]
