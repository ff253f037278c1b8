"""Indices of like runs, port beside starboard, and whether they meet the criteria of IMO MSC.137(76).

Runs are alike that have one name (test and helm) and one approach speed within a fifth. The mean of three and more
has the 95 % interval of their own intervals or of the scatter between them (Student's t), whichever is wider. Two
say next to nothing of the scatter (Student's factor is 12.7): their mean stands with the range of both.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from analysis.manoeuvres.indices import Index, Manoeuvre, from_order
from analysis.manoeuvres.turning_circle import REMOVED

LEAST_LENGTH_M = 100.0
"""The standards are for ships of this length and more, and for tankers of chemicals and gas of any."""
DEEP_DRAUGHTS = 4.0
"""Deep water begins at so many mean draughts (explanatory notes, MSC/Circ.1053)."""
CALM_BEAUFORT = 5
"""The strongest wind of a test (MSC/Circ.1053)."""

CRITERIA = {
    "advance_m": "advance", "tactical_diameter_m": "tactical diameter",
    "initial_turning_m": "initial turning", "overshoot_1_deg": "first overshoot",
    from_order(1): "first overshoot", "overshoot_2_deg": "second overshoot", from_order(2): "second overshoot",
    "track_reach_m": "track reach",
}  # fmt: skip
"""What the standards limit (MSC.137(76), 5.3), by the name of the index."""

_MAIN = {
    "turning_circle": ("advance_m", "transfer_m", "tactical_diameter_m", "steady_diameter_m"),
    "course_change": ("initial_turning_m", "advance_m", "transfer_m", "tactical_diameter_m"),
    "zigzag": ("overshoot_1_deg", "overshoot_2_deg", "initial_turning_m"),
    "stopping": ("track_reach_m", "head_reach_m", "lateral_deviation_m", "stopping_time_s"),
    "pull_out": ("residual_yaw_rate_dps",),
    "acceleration": ("time_to_90_percent_s", "distance_to_90_percent_m"),
    "crabbing": ("sway_mps",),
    "thruster_test": ("last_yaw_rate_dps",),
}
"""The indices of a kind that stand on the page of indices; of kinds that are not here the first three."""
_FROM_ORDER = {f"overshoot_{number}_deg": from_order(number) for number in (1, 2)}
"""The overshoots that IMO limits, and what they are called where the way of the helm makes a difference."""
_SINGLE = ("speed_run", "acceleration", "crabbing", "thruster_test")
"""Kinds whose runs differ in their settings: no means over them."""
_IN_LENGTHS = ("advance_m", "tactical_diameter_m", "track_reach_m")
_HOLDS_LIMIT = "the interval of the value holds the limit"
_NO_LENGTH = "the ship's length is not known"
_SPEED_SHARE = 0.2
_FEW_RUNS = 2  # of which no interval is made
_UNSTEADY = re.compile(r"not steady|gathering way")


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
    """One index of like runs: its mean by side ("port", "starboard", "" for tests that have none) and its limit.

    Of each side there is one value: with the current removed where that is known of all its runs. The worse side is
    judged. ``result`` is "pass", "fail" or "not judged" where there is a limit, else empty;
    ``why`` says why not judged; ``place`` is that of the test among all.
    """

    test: str
    name: str
    sides: Mapping[str, Mean]
    result: str = ""
    why: str = ""
    place: int = 0

    @property
    def limit(self) -> Index | None:
        """The index whose limit is the strictest; None where there is none."""
        limited = [each.index for each in self.sides.values() if each.index.limit is not None]
        return min(limited, key=lambda each: each.limit or 0.0) if limited else None

    @property
    def judged_side(self) -> str:
        """The side whose value decides: of two that have limits the worse one; empty where there is no choice."""
        limited = {side: each.index for side, each in self.sides.items() if each.index.limit}
        if len(limited) < 2:
            return ""
        return max(limited, key=lambda side: limited[side].value / (limited[side].limit or 1.0))


@dataclass(frozen=True, slots=True)
class Conditions:
    """What the standards ask of a ship and of the conditions of her trial; None where it is not known."""

    length_m: float | None = None
    draught_m: float | None = None
    water_depth_m: float | None = None
    beaufort: int | None = None

    @property
    def against(self) -> str:
        """Why these conditions do not allow a judgement; empty where they do."""
        if self.length_m is None:
            return _NO_LENGTH
        if self.length_m < LEAST_LENGTH_M:
            return (
                f"the standards are for ships of {LEAST_LENGTH_M:.0f} m and more (tankers of chemicals and gas: of "
                f"any length), and this one has {self.length_m:g} m between perpendiculars"
            )
        if self.beaufort is not None and self.beaufort > CALM_BEAUFORT:
            return f"the wind was of force {self.beaufort}, above {CALM_BEAUFORT}"
        if self.water_depth_m and self.draught_m and self.water_depth_m < DEEP_DRAUGHTS * self.draught_m:
            draughts = self.water_depth_m / self.draught_m
            return f"the water was {draughts:.1f} draughts deep, less than {DEEP_DRAUGHTS:.0f}"
        return ""


def mean_of(runs: Sequence[Index]) -> Mean:
    """The mean of an index over runs; its interval is the wider of that of their errors and that of the scatter, of
    two runs the range that their own intervals cover."""
    count = len(runs)
    low, high = _range(runs) if count <= _FEW_RUNS else _interval(runs)
    value = float(np.mean([each.value for each in runs]))
    lengths = [each.lengths for each in runs if each.lengths is not None]
    limits = [each.limit for each in runs if each.limit is not None]
    mean_lengths = float(np.mean(lengths)) if len(lengths) == count else None
    limit = min(limits) if limits else None
    return Mean(Index(value, low, high, runs[0].unit, mean_lengths, limit), count)


def _range(runs: Sequence[Index]) -> tuple[float, float]:
    """From the least to the greatest of one or two runs, with what each is known within."""
    if len(runs) == 1:
        return runs[0].low, runs[0].high
    ends = np.array([(each.value, each.low, each.high) for each in runs])
    return float(np.nanmin(ends)), float(np.nanmax(ends))


def _interval(runs: Sequence[Index]) -> tuple[float, float]:
    """The 95 % interval of the mean of runs, from their own or from their scatter, whichever is wider."""
    from scipy.stats import t

    count, values = len(runs), np.array([each.value for each in runs])
    within = np.array([0.5 * (each.high - each.low) for each in runs])
    scatter = t.ppf(0.975, count - 1) * values.std(ddof=1) / np.sqrt(count)
    half = float(np.nanmax([np.sqrt(np.sum(within**2)) / count, scatter]))
    return float(values.mean()) - half, float(values.mean()) + half


def index_rows(manoeuvres: Iterable[Manoeuvre], conditions: Conditions) -> list[IndexRow]:
    """The main indices of all manoeuvres: means over like runs, tests that have limits first."""
    tests = [_rows_of_test(test, conditions) for test in like_runs(manoeuvres)]
    ordered = sorted(tests, key=lambda rows: not any(row.result for row in rows))
    return [replace(row, place=place) for place, rows in enumerate(ordered) for row in rows]


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
    speeds = [each.settings.get("approach_mps", 0.0) for each in (one, other)]
    return abs(speeds[0] - speeds[1]) <= _SPEED_SHARE * max(map(abs, speeds))


def test_name(test: Sequence[Manoeuvre]) -> str:
    """What like runs are: the name of the test and the mean speed of the approach, of a single run the time."""
    if test[0].kind in _SINGLE:
        return f"{test[0].name[:1].upper()}{test[0].name[1:]}, {test[0].start:%H:%M:%S}"
    speeds = [each.settings["approach_mps"] for each in test if "approach_mps" in each.settings]
    at = f" at {np.mean(speeds):.2f} m/s" if speeds else ""
    return f"{test[0].name[:1].upper()}{test[0].name[1:]}{at}"


def _rows_of_test(test: Sequence[Manoeuvre], conditions: Conditions) -> list[IndexRow]:
    names = dict.fromkeys(name for each in test for name in _main_indices(each))
    against = conditions.against or _unsteady(test)
    rows = []
    for name in names:
        sides = {
            side: _side_of(runs, name)
            for side in ("port", "starboard", "")
            if (runs := [each for each in test if each.side == side and name in each.indices])
        }
        ordered = any(_shown_of(each, name) != name for each in test)
        shown = _FROM_ORDER[name] if ordered else name
        rows.append(_judged(IndexRow(test_name(test), shown, sides), against))
    return rows


def _side_of(runs: Sequence[Manoeuvre], name: str) -> Mean:
    """The mean of an index over the runs to one side, with the current removed where all of them have that."""
    removed = all(name + REMOVED in each.indices for each in runs)
    return replace(
        mean_of([each.indices[_shown_of(each, name) + REMOVED * removed] for each in runs]), removed=removed
    )


def _shown_of(manoeuvre: Manoeuvre, name: str) -> str:
    """The index that stands for another: an overshoot from the order, as IMO counts it, where there is one."""
    ordered = _FROM_ORDER.get(name, name)
    return ordered if ordered in manoeuvre.indices else name


def _main_indices(manoeuvre: Manoeuvre) -> list[str]:
    found = manoeuvre.indices
    main: Iterable[str] = _MAIN.get(manoeuvre.kind, tuple(found)[:3])
    if manoeuvre.kind == "speed_run":
        main = ["speed_through_water_mps" if "speed_through_water_mps" in found else "speed_over_ground_mps"]
    return [name for name in main if name in found]


def _unsteady(test: Sequence[Manoeuvre]) -> str:
    notes = [note for each in test for note in each.notes if _UNSTEADY.search(note)]
    return notes[0] if notes else ""


def _judged(row: IndexRow, against: str) -> IndexRow:
    """The row with its result: each side's whole interval has to lie below the limit, or above it."""
    by_length = row.name in _IN_LENGTHS and against == _NO_LENGTH
    if row.limit is None and not by_length:
        return row
    if against:
        return replace(row, result="not judged", why=against)
    sides = [each.index for each in row.sides.values() if each.index.limit is not None]
    if any(_above(each, each.low) for each in sides):
        return replace(row, result="fail")
    if any(_above(each, each.high) for each in sides):
        return replace(row, result="not judged", why=_HOLDS_LIMIT)
    return replace(row, result="pass")


def _above(index: Index, bound: float) -> bool:
    """Whether a bound of an index, or its value where that is not known, lies above the limit."""
    return bool((index.value if np.isnan(bound) else bound) > (index.limit or np.inf))


def untested(rows: Iterable[IndexRow]) -> list[str]:
    """The criteria of the standards that no run of these is for."""
    shown = {CRITERIA.get(row.name) for row in rows if row.result}
    return [each for each in dict.fromkeys(CRITERIA.values()) if each not in shown]


def verdict(rows: Sequence[IndexRow]) -> str:
    """The result of a trial in one sentence."""
    passed, failed, left = ([row for row in rows if row.result == name] for name in ("pass", "fail", "not judged"))
    others = f"; {len(left)} not judged" if left else ""
    if failed:
        which = ", ".join(f"{CRITERIA.get(row.name, '')} ({row.test})" for row in failed)
        return f"The trial does not meet IMO MSC.137(76) in {which}{others}."
    if passed:
        every = {1: "the one value", 2: "both values"}.get(len(passed), f"all {len(passed)} values")
        return f"The trial meets IMO MSC.137(76) in {every} judged{others}."
    if left:
        return _without_judgement(left)
    if rows:
        tests = len({row.place for row in rows})
        made = f"{tests} other tests were" if tests > 1 else "one other was"
        return f"No test of IMO MSC.137(76) was made; {made} measured."
    return "No standard manoeuvre was found in this trial, so there are no indices of manoeuvrability."


def _without_judgement(left: Sequence[IndexRow]) -> str:
    """What was measured of limited values, none of which is judged, and why not."""
    values = [each.index for row in left for each in row.sides.values()]
    below = all(row.limit for row in left) and not any(_above(each, each.value) for each in values)
    many = "Both" if len(left) == 2 else f"All {len(left)}"
    every = "The one value measured lies below its limit" if len(left) == 1 else (
        f"{many} values measured lie below their limits"
    )  # fmt: skip
    return f"Not judged by IMO MSC.137(76): {left[0].why}." + (f" {every}." if below else "")
