"""The criteria of IMO's Standards for ship manoeuvrability, MSC.137(76), and the means of like runs that show them.

Every value counts from the position and the moment at which the order is given, is that of the midship point, and
belongs to one test (4.2): advance and tactical diameter to the turning circle with 35 deg or the largest helm, the
distance to 10 deg of turn to a helm of 10 deg, overshoots to the 10/10 and 20/20 zigzags, the track reach to the
full astern stop. The standards are for ships of 100 m and more and for chemical tankers and gas carriers, fully
loaded and on even keel, in deep water and calm, after a steady approach at the test speed (5.2; MSC/Circ.1053,
2.2.1.2). A criterion is *met* or *not met* only where all of that is known; it *cannot be said* where the interval
of the value contains the limit, and is *not shown* where something is missing.

Runs are alike that have one name (test and helm) and one approach speed within a fifth. The mean of three and more
has the 95 % interval of their own intervals or of the scatter between them (Student's t), whichever is wider. Two
runs hardly show the scatter (Student's factor is 12.7): their mean has the range of both.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from seatrial.acquisition.config.run_sheet import Conditions
from seatrial.analysis.manoeuvres.indices import Index, Manoeuvre, nominal_angle_deg, overshoot_from_order_name
from seatrial.analysis.manoeuvres.kinds import REMOVED, SWITCH_SHARE
from seatrial.analysis.quality.wind import beaufort_number

MET, NOT_MET, CANNOT_BE_SAID, NOT_SHOWN = "met", "not_met", "cannot_be_said", "not_shown"

RESOLUTION = "MSC.137(76)"
NO_LENGTH = "the ship's length is not known"
NOT_FOR_SHIP = "the standards are for ships of 100 m and more"

TURNING_HELM_DEG, INITIAL_TURNING_HELM_DEG = 35.0, 10.0
_LARGEST_ZIGZAG_HELM_DEG = 20.0
_NEAR_SHARE, _SAME_HELM_SHARE = 0.2, 0.1  # a run is called by an angle that it is near
_TURNING_ANGLE_SHARE = 0.05  # by which a helm of 35 deg may differ
_TEST_ANGLE_SHARE = 0.1  # by which the angles of a test may differ and still show its criterion
LEAST_LENGTH_M = 100.0
DEEP_DRAUGHTS = 4.0
"""The least depth of the water in draughts (MSC/Circ.1053, 2.2.1.2)."""
_LARGEST_BEAUFORT, _LARGEST_SEA_STATE = 5, 4
_DRAUGHT_SHARE = 0.05  # of the full load draught, by which a trial's may differ (MSC/Circ.1053, 2.2.1.2.2)
_TEST_SPEED_SHARE = 0.9
_STEADY_TURN_DEG = 2.0  # of heading in the time of one ship length: as much as noise shows of a steady approach
_STEADY_SHARE = 0.05  # of the speed in that time
FULL_ASTERN = "stopping with thrust astern"
"""The name of a full astern stop."""
_MAIN = {
    "turning_circle": ("advance_m", "transfer_m", "tactical_diameter_m", "steady_diameter_m"),
    "course_change": ("initial_turning_m", "advance_m", "transfer_m", "tactical_diameter_m"),
    "zigzag": (overshoot_from_order_name(1), overshoot_from_order_name(2), "initial_turning_m"),
    "stopping": ("track_reach_m", "head_reach_m", "lateral_deviation_m", "stopping_time_s"),
    "pull_out": ("residual_yaw_rate_dps",),
    "acceleration": ("time_to_90_percent_s", "distance_to_90_percent_m"),
    "crabbing": ("sway_mps",),
    "thruster_test": ("last_yaw_rate_dps",),
}
"""The main indices of a kind, for the page of indices; of other kinds the first three."""
_SINGLE = ("speed_run", "acceleration", "crabbing", "thruster_test")
"""Kinds whose runs differ in their settings: no means over them."""
_SPEED_SHARE = 0.2
_FEW_RUNS = 2  # of which no interval is made
_TESTS_AFTER_APPROACH = ("zigzag", "turning_circle", "stopping", "spiral")
_LEADS_INTO_S, _LEAST_TEST_DEG = 30.0, 270.0  # the end of a straight run is known to some 20 s
_ORDER_OF_RESULTS = (NOT_MET, CANNOT_BE_SAID, MET, NOT_SHOWN)


def first_overshoot_10_10_deg(length_per_speed_s: float) -> float:
    """10 below L/V = 10 s, 20 from 30 s, 5 + L/V / 2 between (5.3.3.1)."""
    return float(np.clip(5.0 + 0.5 * length_per_speed_s, 10.0, 20.0))


def second_overshoot_10_10_deg(length_per_speed_s: float) -> float:
    """25 below L/V = 10 s, 40 from 30 s, 17.5 + 0.75 L/V between (5.3.3.2)."""
    return float(np.clip(17.5 + 0.75 * length_per_speed_s, 25.0, 40.0))


@dataclass(frozen=True, slots=True)
class Criterion:
    """One criterion of section 5.3.

    ``limit`` gives it from the ship's length [m] and the test speed [m/s], None where it needs a length that is not
    known; ``matches`` whether a run is its test, with the largest helm of its trial [deg]. ``helm_deg`` is the helm
    of the test, None for the largest, and of a zigzag the switching angle as well.
    """

    name: str
    clause: str
    index: str
    limit: Callable[[float | None, float], float | None]
    matches: Callable[[Manoeuvre, float], bool]
    helm_deg: float | None = None
    sides: tuple[str, ...] = ("port", "starboard")


def is_turning_test(helm_deg: float, largest_deg: float) -> bool:
    """Whether a circle is the turning test (4.2.2): with 35 deg of helm, or the largest helm of its trial.

    The helms of the other tests, 10 and 20 deg, are no ship's largest: a trial with nothing more has no turning
    test.
    """
    at_35 = abs(abs(helm_deg) / TURNING_HELM_DEG - 1.0) <= _SAME_HELM_SHARE
    at_largest = abs(helm_deg) >= (1.0 - _SAME_HELM_SHARE) * largest_deg
    return (at_35 or at_largest) and abs(helm_deg) > (1.0 + _SAME_HELM_SHARE) * _LARGEST_ZIGZAG_HELM_DEG


def _is_turning_circle(run: Manoeuvre, largest_deg: float) -> bool:
    return run.kind == "turning_circle" and is_turning_test(run.helm_deg or 0.0, largest_deg)


def _is_zigzag(nominal_deg: float) -> Callable[[Manoeuvre, float], bool]:
    """Whether a run is the zigzag of this helm and switch, within a fifth of both."""

    def matches(run: Manoeuvre, largest_deg: float) -> bool:
        angles = abs(run.helm_deg or 0.0), run.settings.get("switch_deg", 0.0)
        return run.kind == "zigzag" and all(abs(angle / nominal_deg - 1.0) <= _NEAR_SHARE for angle in angles)

    return matches


def _is_initial_turn(run: Manoeuvre, largest_deg: float) -> bool:
    """Whether a run holds a helm of 10 deg until the heading has changed by 10 deg (5.3.2), within a fifth of both.

    Of a zigzag whose helm was reversed before, as of a 10/5, the way to 10 deg is that of the overshoot, too.
    """
    angles = [abs(run.helm_deg or 0.0), *([_held_until_deg(run)] if run.kind == "zigzag" else [])]
    return run.kind in ("zigzag", "turning_circle", "course_change") and all(
        abs(angle / INITIAL_TURNING_HELM_DEG - 1.0) <= _NEAR_SHARE for angle in angles
    )


def _held_until_deg(run: Manoeuvre) -> float:
    """The change of heading at which the helm of a zigzag was reversed, as far as an initial turn needs it held."""
    return min(run.settings["switch_deg"], INITIAL_TURNING_HELM_DEG)


def _limit_in_ship_lengths(lengths: float) -> Callable[[float | None, float], float | None]:
    return lambda length_m, speed_mps: lengths * length_m if length_m else None


def _limit_by_length_per_speed(
    limit_deg: Callable[[float], float],
) -> Callable[[float | None, float], float | None]:
    return lambda length_m, speed_mps: limit_deg(length_m / speed_mps) if length_m and speed_mps > 0.0 else None


CRITERIA = (
    Criterion("advance", "5.3.1", "advance_m", _limit_in_ship_lengths(4.5), _is_turning_circle),
    Criterion("tactical diameter", "5.3.1", "tactical_diameter_m", _limit_in_ship_lengths(5.0), _is_turning_circle),
    Criterion("initial turning", "5.3.2", "initial_turning_m", _limit_in_ship_lengths(2.5),
              _is_initial_turn, 10.0),
    Criterion("first overshoot of 10/10", "5.3.3.1", overshoot_from_order_name(1),
              _limit_by_length_per_speed(first_overshoot_10_10_deg),
              _is_zigzag(10.0), 10.0),
    Criterion("second overshoot of 10/10", "5.3.3.2", overshoot_from_order_name(2),
              _limit_by_length_per_speed(second_overshoot_10_10_deg), _is_zigzag(10.0), 10.0),
    Criterion("first overshoot of 20/20", "5.3.3.3", overshoot_from_order_name(1), lambda length_m, speed_mps: 25.0,
              _is_zigzag(20.0), 20.0),
    Criterion("track reach", "5.3.4", "track_reach_m", _limit_in_ship_lengths(15.0),
              lambda run, _: run.kind == "stopping" and run.settings.get("thrust_rpm", 0.0) < 0.0, sides=("",)),
)  # fmt: skip
"""The criteria, in the order of the resolution."""

NAMES = frozenset(criterion.name for criterion in CRITERIA)
"""The names of the criteria."""


def criterion_of_index(run: Manoeuvre, index: str, largest_deg: float) -> Criterion | None:
    """The criterion that an index of a run is judged by, None where there is none: all tests are sailed ahead."""
    if run.is_astern:
        return None
    plain = index.removesuffix("_current_removed")
    candidates = (criterion for criterion in CRITERIA if criterion.index == plain)
    return next((criterion for criterion in candidates if criterion.matches(run, largest_deg)), None)


def missing_conditions_of_run(run: Manoeuvre, conditions: Conditions) -> tuple[str, ...]:
    """What is missing for a run to show a criterion, in the order of the standard; empty where it shows it.

    For a ship that the standards are not for, it is only that. In the time of one ship length neither heading nor
    speed of the approach may change by more than what noise shows of them. Its speed through the water may have
    been that over ground less the current, which may have come from astern. Of the stated depth of the water and
    that measured in the run the lesser counts, and of the winds the stronger.
    """
    length_m, speed_mps = conditions.length_m, run.settings.get("approach_mps")
    if length_m is not None and length_m < LEAST_LENGTH_M and not conditions.chemical_or_gas_tanker:
        return (f"{NOT_FOR_SHIP}, not {length_m:g} m",)
    approach = approach_shortfall(run, length_m)
    wanted_mps, speed = conditions.speed_at_85_percent_mcr_mps, ""
    if speed_mps is None or wanted_mps is None or not np.isfinite(wanted_mps):
        speed = "the speed at 85 % of the maximum output is not known"
    elif not (fraction := (speed_mps - (conditions.current_mps or 0.0)) / wanted_mps) >= _TEST_SPEED_SHARE:
        speed = f"the approach was at {fraction:.0%} of the speed at 85 % of the maximum output, less than 90 %"
    length = NO_LENGTH if length_m is None else ""
    conditions = replace_by_worse_conditions(conditions, [run])
    shortfalls = (length, *condition_shortfalls(conditions).values(), approach, speed)
    return tuple(shortfall for shortfall in shortfalls if shortfall)


def approach_shortfall(run: Manoeuvre, length_m: float | None) -> str:
    """Why the execution or the approach of a run keeps it from showing a criterion, empty where it does not."""
    speed_mps = run.settings.get("approach_mps")
    if run.shortfalls or not (length_m and speed_mps and speed_mps > 0.0):
        return next(iter(run.shortfalls), "")
    length_s = length_m / speed_mps
    turned_deg, gained = (abs(run.settings.get(name, 0.0)) * length_s
                          for name in ("approach_yaw_rate_dps", "approach_acceleration_mps2"))  # fmt: skip
    if turned_deg > _STEADY_TURN_DEG:
        return f"the approach was not steady: the heading turned by {turned_deg:.1f} deg a ship length"
    if gained > _STEADY_SHARE * speed_mps:
        return f"the approach was not steady: the speed changed by {gained / speed_mps:.0%} a ship length"
    return ""


def condition_shortfalls(conditions: Conditions) -> dict[str, str]:
    """By each condition that the standards ask of a trial (5.2; MSC/Circ.1053) why it is not shown, empty where it
    is fulfilled."""
    draught_m, full_m, trim_m = conditions.draught_m, conditions.full_load_draught_m, conditions.trim_m
    loading = trim = depth = ""
    lacking = [name for name in ("draught_m", "full_load_draught_m") if not np.isfinite(conditions.number(name))]
    if lacking or draught_m is None or full_m is None:
        loading = f"the loading is not known: {' and '.join(lacking)}"
    elif abs(draught_m / full_m - 1.0) > _DRAUGHT_SHARE:
        loading = f"not fully loaded: {draught_m:g} m of {full_m:g} m of draught"
    if trim_m is None or not np.isfinite(trim_m):
        trim = "the trim is not known"
    elif draught_m and abs(trim_m) > _DRAUGHT_SHARE * draught_m:
        trim = f"not on even keel: {trim_m:g} m of trim"
    lacking = [name for name in ("water_depth_m", "draught_m") if not np.isfinite(conditions.number(name))]
    draughts = conditions.number("water_depth_m") / conditions.number("draught_m")
    if lacking:
        depth = f"the depth of the water in draughts is not known: {' and '.join(lacking)}"
    elif draughts < DEEP_DRAUGHTS:
        depth = f"the water was {draughts:.1f} draughts deep, less than {DEEP_DRAUGHTS:.0f}"
    share = f"{_DRAUGHT_SHARE * 100.0:.0f} %"
    return {
        f"draught within {share} of the full load draught": loading,
        "even keel": trim,
        f"at least {DEEP_DRAUGHTS:.0f} draughts of water": depth,
        f"wind of force {_LARGEST_BEAUFORT} at most":
            _weather_shortfall("the wind", "force", conditions.beaufort, _LARGEST_BEAUFORT),
        f"sea state {_LARGEST_SEA_STATE} at most":
            _weather_shortfall("the sea", "state", conditions.sea_state, _LARGEST_SEA_STATE),
        "current known": "" if np.isfinite(conditions.number("current_mps")) else "the current is not known",
    }  # fmt: skip


def replace_by_worse_conditions(conditions: Conditions, runs: Iterable[Manoeuvre]) -> Conditions:
    """Stated conditions, with the least depth and the strongest mean wind that were measured in some runs where
    these are worse."""
    measured = [run.settings for run in runs]
    depths_m = [conditions.number("water_depth_m"), *(run.get("water_depth_m", np.nan) for run in measured)]
    winds_mps = [run["wind_mps"] for run in measured if "wind_mps" in run]
    forces = [conditions.beaufort, beaufort_number(max(winds_mps)) if winds_mps else None]
    return replace(
        conditions,
        water_depth_m=min(filter(np.isfinite, depths_m), default=None),
        beaufort=max((force for force in forces if force is not None), default=None),
    )


def _test_shortfalls(run: Manoeuvre, criterion: Criterion) -> tuple[str, ...]:
    """Whether a run was sailed with other angles than the test of a criterion."""
    angles = {"helm": abs(run.helm_deg or 0.0)}
    if run.kind == "zigzag":
        is_initial_turn = criterion.index == "initial_turning_m"
        angles["switching angle"] = _held_until_deg(run) if is_initial_turn else run.settings["switch_deg"]
    if criterion.helm_deg is None and run.kind == "turning_circle":
        over = angles["helm"] / TURNING_HELM_DEG - 1.0
        if over > _TURNING_ANGLE_SHARE:
            return (f"the helm was {angles['helm']:.1f} deg, more than {TURNING_HELM_DEG:.0f} deg",)
        if over < -_TURNING_ANGLE_SHARE:
            return (f"whether {angles['helm']:.1f} deg is the largest helm at the test speed is not known",)
    return tuple(
        f"the {name} was {angle:.1f} deg, not {criterion.helm_deg:.0f} deg"
        for name, angle in angles.items()
        if criterion.helm_deg is not None and abs(angle / criterion.helm_deg - 1.0) > _TEST_ANGLE_SHARE
    )


def _weather_shortfall(what: str, scale: str, value: int | None, largest: int) -> str:
    if value is None or not np.isfinite(value):
        return f"{what} is not known"
    return f"{what} was of {scale} {value}, above {largest}" if value > largest else ""


def compare_with_limit(index: Index, limit: float, missing: Sequence[str]) -> str:
    """The result of a value with its interval against a limit."""
    if missing:
        return NOT_SHOWN
    if index.low > limit:
        return NOT_MET
    return MET if 0.0 < index.value <= index.high <= limit else CANNOT_BE_SAID


def add_limits(
    runs: Iterable[Manoeuvre], conditions: Conditions, trial: Sequence[Manoeuvre] = ()
) -> tuple[Manoeuvre, ...]:
    """Runs with limits and results on the indices that have them, and notes with the reasons.

    The largest helm is that of all zigzags and turns of the ``trial``, or of the runs where they are all of it. The
    speed through the water, by which two limits go, is that over ground to within the current.
    """
    judged = tuple(runs)
    largest_deg = largest_helm_deg(trial or judged)
    drifts = [float(np.hypot(run.current.north_mps, run.current.east_mps)) for run in judged if run.current]
    if conditions.current_mps is None and drifts:
        conditions = replace(conditions, current_mps=max(drifts))
    current_mps, result = conditions.current_mps or 0.0, list[Manoeuvre]()
    for run in judged:
        indices, missing, speed_mps = (
            dict(run.indices),
            missing_conditions_of_run(run, conditions),
            run.settings.get("approach_mps", 0.0),
        )
        not_for_ship = any(reason.startswith(NOT_FOR_SHIP) for reason in missing)
        for name, index in run.indices.items():
            if (criterion := criterion_of_index(run, name, largest_deg)) is None:
                continue
            shortfalls = missing if not_for_ship else (*missing, *_test_shortfalls(run, criterion))
            drifting = run.kind == "stopping" and not name.endswith(REMOVED)
            carried_m = current_mps * (run.end - run.start).total_seconds() if drifting else 0.0
            wider = replace(index, low=index.low - carried_m, high=index.high + carried_m)
            limit = criterion.limit(conditions.length_m, speed_mps)
            ends = [criterion.limit(conditions.length_m, speed_mps + sign * current_mps) for sign in (1.0, -1.0)]
            results = {compare_with_limit(wider, end, shortfalls) for end in ends if end is not None}
            outcome = "" if limit is None else results.pop() if len(results) == 1 else CANNOT_BE_SAID
            indices[name] = replace(wider, limit=limit, result=outcome, missing=shortfalls)

        helm_deg, notes = abs(run.helm_deg or 0.0), list(run.notes)
        is_test = is_turning_test(helm_deg, largest_deg)
        at_35 = abs(helm_deg / TURNING_HELM_DEG - 1.0) <= _SAME_HELM_SHARE
        if run.is_astern:
            notes.append("the ship went astern: no limits are for that")
        elif conditions.length_m and run.kind == "turning_circle" and not (is_test and at_35):
            shown = "limits are" if is_test else "no limits: advance and diameter have them"
            notes.append(
                f"{shown} for {TURNING_HELM_DEG:.0f} deg or the largest helm, and this was {helm_deg:.0f} deg, the "
                f"largest of this recording {largest_deg:.0f} deg"
            )
        result.append(replace(run, indices=indices, notes=tuple(dict.fromkeys(notes))))
    return tuple(result)


def largest_helm_deg(runs: Iterable[Manoeuvre]) -> float:
    """The largest helm of what counts of a trial [deg]."""
    return max((abs(run.helm_deg or 0.0) for run in runs if not run.not_counted), default=0.0)


@dataclass(frozen=True, slots=True)
class MeanIndex:
    """The mean of an index over ``runs`` runs and its 95 % interval, of two runs the range of both; NaN where the
    interval is not known. ``removed`` says that the current is removed from all of them.
    """

    index: Index
    runs: int
    removed: bool = False

    @property
    def half_width(self) -> float:
        return 0.5 * (self.index.high - self.index.low)


@dataclass(frozen=True, slots=True)
class IndexRow:
    """One index of like runs: its mean by side ("port", "starboard", "" for tests that have none).

    Of each side there is one value: with the current removed where that is known of all its runs. ``criterion`` is
    the one that the index is judged by, None where there is none; ``place`` is that of the test among all.
    """

    test: str
    name: str
    sides: Mapping[str, MeanIndex]
    criterion: Criterion | None = None
    place: int = 0

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
    mean: MeanIndex | None
    result: str
    missing: tuple[str, ...]

    def as_json(self) -> dict[str, Any]:
        """With the keys of the contract."""
        value = {"value": None, "low": None, "high": None, "unit": None, "limit": None, "counted_from": None}
        numbers = self.mean.index.as_json() if self.mean else value
        runs = self.mean.runs if self.mean else 0
        return {
            "criterion": self.criterion.name, "clause": f"{RESOLUTION}, {self.criterion.clause}", "side": self.side,
            "index": self.criterion.index, **numbers, "runs": runs, "result": self.result,
            "missing": list(self.missing),
        }  # fmt: skip


def mean_over_runs(runs: Sequence[Index]) -> MeanIndex:
    """The mean of an index over runs; its interval is the wider of that of their errors and that of the scatter, of
    two runs the range that their own intervals cover. Its limit is the strictest, and it shows what all of them
    show."""
    count, values = len(runs), np.array([run.value for run in runs])
    value = float(np.mean(values))
    if count <= _FEW_RUNS:
        bounds = [(run.low, run.high, *([run.value] if count > 1 else ())) for run in runs]
        low, high = float(np.min(bounds)), float(np.max(bounds))
    else:
        from scipy.stats import t

        within = np.array([0.5 * (run.high - run.low) for run in runs])
        scatter = t.ppf(0.975, count - 1) * values.std(ddof=1) / np.sqrt(count)
        half = float(np.max([np.sqrt(np.sum(within**2)) / count, scatter]))
        low, high = value - half, value + half
    lengths = [run.lengths for run in runs if run.lengths is not None]
    limits = [run.limit for run in runs if run.limit is not None]
    missing = tuple(dict.fromkeys(reason for run in runs for reason in run.missing))
    mean_lengths = float(np.mean(lengths)) if len(lengths) == count else None
    limit = min(limits) if len(limits) == count else None
    index = replace(runs[0], value=value, low=low, high=high, lengths=mean_lengths, limit=limit)
    result = "" if index.limit is None else compare_with_limit(index, index.limit, missing)
    if result == MET and {run.result for run in runs} & {NOT_MET, CANNOT_BE_SAID}:
        result = CANNOT_BE_SAID  # a mean does not meet what one of its runs does not
    return MeanIndex(replace(index, result=result, missing=missing), count)


def index_rows(runs: Iterable[Manoeuvre]) -> list[IndexRow]:
    """The main indices of all tests: means over like runs, tests that have limits first.

    Left out are what does not count of a conducted programme, turns to a new course that show no criterion, and
    straight runs that lead into a test; a circle of less than three quarters is no such test, as it may lead to the
    reciprocal course and the next run.
    """
    trial = tuple(run for run in runs if not run.not_counted)
    largest_deg = largest_helm_deg(trial)
    tested = []
    for run in trial:
        is_approach = run.kind == "speed_run" and any(
            0.0 <= (test.start - run.end).total_seconds() <= _LEADS_INTO_S
            and test.kind in _TESTS_AFTER_APPROACH
            and test.settings.get("turned_deg", 360.0) >= _LEAST_TEST_DEG
            for test in trial
        )
        criteria = (criterion_of_index(run, name, largest_deg) for name in run.indices)
        if not (is_approach or (run.kind == "course_change" and not any(criteria))):
            tested.append(run)
    tests = [_rows_of_test(test, largest_deg) for test in group_like_runs(tested)]
    ordered = sorted(tests, key=lambda rows: not any(row.result for row in rows))
    return [replace(row, place=place) for place, rows in enumerate(ordered) for row in rows]


def group_like_runs(manoeuvres: Iterable[Manoeuvre]) -> list[list[Manoeuvre]]:
    """The manoeuvres in groups of like runs, in the order of each group's first."""
    groups: list[tuple[tuple[str | float, ...], float, list[Manoeuvre]]] = []
    for run in manoeuvres:
        switch_deg = nominal_angle_deg(run.settings.get("switch_deg", 0.0), SWITCH_SHARE)
        # with its angles, as the crew may have given two tests one name
        label = (run.kind, run.name, nominal_angle_deg(run.helm_deg or 0.0), switch_deg)
        speed = run.settings.get("approach_mps", 0.0)
        for group_label, group_speed, group in groups:
            near = abs(group_speed - speed) <= _SPEED_SHARE * max(abs(group_speed), abs(speed))
            if near and label == group_label and run.kind not in _SINGLE:
                group.append(run)
                break
        else:
            groups.append((label, speed, [run]))
    return [group for *_, group in groups]


def _rows_of_test(test: Sequence[Manoeuvre], largest_deg: float) -> list[IndexRow]:
    """The main indices of like runs, by side with the current removed where all runs to it have that. They are
    called by the test and the mean speed of the approach, those of a single run by its time."""
    first, names, rows = test[0], dict[str, None](), []
    for run in test:
        main = _MAIN.get(run.kind, tuple(run.indices)[:3])
        if run.kind == "speed_run":
            speeds = ("speed_through_water_mps", "speed_over_ground_mps")
            main = speeds[:1] if speeds[0] in run.indices else speeds[1:]
        names |= dict.fromkeys(name for name in main if name in run.indices)
    title = f"{first.name[:1].upper()}{first.name[1:]}"
    approaches = [run.settings["approach_mps"] for run in test if "approach_mps" in run.settings]
    if first.kind in _SINGLE:
        title += f", {first.start:%H:%M:%S}"
    elif approaches:
        title += f" at {np.mean(approaches):.2f} m/s"
    for name in names:
        sides = {}
        for side in ("port", "starboard", ""):
            if runs := [run for run in test if run.side == side and name in run.indices]:
                removed = all(name + REMOVED in run.indices for run in runs)
                mean = mean_over_runs([run.indices[name + REMOVED * removed] for run in runs])
                sides[side] = replace(mean, removed=removed)
        rows.append(IndexRow(title, name, sides, criterion_of_index(first, name, largest_deg)))
    return rows


def criterion_results(rows: Sequence[IndexRow]) -> list[CriterionResult]:
    """What a trial shows of each criterion, to each side that the standards ask for.

    Of several tests of one criterion the one counts that shows most: with a result before one without, and of those
    the worst.
    """
    results = []
    for criterion in CRITERIA:
        tests = [row for row in rows if row.criterion is criterion]
        for side in criterion.sides:
            means = [row.sides[side] for row in tests if side in row.sides]
            shown = [mean for mean in means if mean.index.limit is not None]
            mean, result = None, NOT_SHOWN
            missing: tuple[str, ...] = (f"no run to {side}" if tests else "no such test",)
            if shown:
                mean = min(
                    shown, key=lambda mean: (_ORDER_OF_RESULTS.index(mean.index.result), len(mean.index.missing))
                )
                result, missing = mean.index.result, mean.index.missing
            elif means:
                mean, missing = means[0], means[0].index.missing or (NO_LENGTH,)
            results.append(CriterionResult(criterion, side, mean, result, missing))
    return results


def headline_of_criteria(results: Sequence[CriterionResult], subject: str = "The trial") -> str:
    """What a trial shows of the standards in one sentence; it meets them only where all is shown and met."""
    by_result = {name: [entry for entry in results if entry.result == name] for name in _ORDER_OF_RESULTS}
    total = len(results)
    if len(by_result[MET]) == total:
        return f"{subject} meets IMO {RESOLUTION}: all {total} criteria are shown and met."
    not_for_ship = next((why for entry in results for why in entry.missing if why.startswith(NOT_FOR_SHIP)), "")
    parts = [f"{len(by_result[MET])} of {total} criteria of IMO {RESOLUTION} are shown and met"]
    if not_for_ship:
        parts = [f"IMO {RESOLUTION}: {not_for_ship}; its limits are for information only"]
    for name, words in (
        (NOT_MET, "not met"),
        (CANNOT_BE_SAID, "cannot be said, as the interval contains the limit"),
    ):
        if by_result[name]:
            parts.append(f"{words}: {_sided_names(by_result[name])}")
    parts += [] if not_for_ship else [f"{len(by_result[NOT_SHOWN])} are not shown"]
    above = [
        entry for entry in by_result[NOT_SHOWN]
        if entry.mean and entry.mean.index.limit is not None and entry.mean.index.value > entry.mean.index.limit
    ]  # fmt: skip
    if above:
        parts.append(f"above the limit lie: {_sided_names(above)}")
    return "; ".join(parts) + "."


def _sided_names(results: Sequence[CriterionResult]) -> str:
    """The criteria with their sides: "advance to port and starboard, track reach"."""
    sides: dict[str, list[str]] = {}
    for entry in results:
        sides.setdefault(entry.criterion.name, []).append(entry.side)
    return ", ".join(
        f"{name} to {' and '.join(criterion_sides)}" if any(criterion_sides) else name
        for name, criterion_sides in sides.items()
    )


def shortfalls_of_criteria(results: Sequence[CriterionResult]) -> list[tuple[str, str]]:
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
