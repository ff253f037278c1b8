"""Finding manoeuvres in a table: zigzags and circles by the helm, the others by the shafts; and their current.

No threshold depends on the size of a ship or of a command: a command is held or changed relative to its own
noise, a ship is fast or slow relative to the highest speed of the recording. Event marks of the crew ("zigzag
20/20 start") name the manoeuvre that they enclose, and admit short ones that would otherwise be rejected.

The current is removed from runs that have no circle of their own to show it. Circles of more than 510 deg give the
drift north and east, pairs of reciprocal runs that along their course, with what the wind does to the speed. All
that were sailed within two hours of a run count, weighted by their intervals. The current is taken to change at
most as fast as a semidiurnal tide (M2, 12.42 h, Pugh and Woodworth 2014) of the same speed does at its steepest,
which widens each interval with the time between.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from operator import attrgetter
from typing import NamedTuple

import numpy as np
import pandas as pd

from seatrial.acquisition.config.run_sheet import Conditions
from seatrial.acquisition.core import errors, named_code
from seatrial.acquisition.core.quantities import Bools, Floats, water_depth_m
from seatrial.acquisition.core.trial import NANO
from seatrial.analysis.manoeuvres import conducted, criteria, kinds, measures, straight_runs
from seatrial.analysis.manoeuvres import motion as motions
from seatrial.analysis.manoeuvres.indices import Current, LeftOut, Manoeuvre, index_from_value
from seatrial.analysis.manoeuvres.motion import Motion, motion_of, row_to_row_noise, runs_of_true
from seatrial.analysis.quality.controls import check_helm_sign, check_shaft_sign
from seatrial.analysis.quality.wind import recorded_conditions, replace_by_stronger_wind
from seatrial.analysis.series import is_assumed
from seatrial.analysis.tables.table import trial_of, utc_index

_LEAST_HELM_DEG, _LEAST_STEP_DEG = 2.5, 1.0
_STEADY_HELM_SHARE, _STEADY_HELM_DEG = 0.35, 2.0
_WIDEST_HELM_DEG = 75.0
_LEAST_HELD_S, _HELD_SHARE_OF_SWING = 2.0, 0.25  # of a boat whose swings last for seconds
_MEASURED_SHARE = 0.9  # of a manoeuvre in which pose and speeds have to be measured
_RUNNING_SHARE = 0.08
_SHORTEST_S = 20.0
_NO_HELM = "no helm was recorded: the angle of a rudder or a thruster, or propellers to both sides"
_START = re.compile(r"\b(start|begin|execute)\w*", re.I)
_END = re.compile(r"\b(end|stop|finish|complete)\w*$", re.I)
_MARK_WORDS = {
    "zigzag": "zig", "turning_circle": "turn circle", "course_change": "turn circle", "speed_run": "speed run",
    "acceleration": "accel", "stopping": "stop crash", "crabbing": "crab side", "pull_out": "pull",
    "spiral": "spiral dieudonne", "reverse_spiral": "spiral bech", "thruster_test": "thrust",
    "williamson_turn": "williamson man overboard",
}  # fmt: skip
"""By kind of manoeuvre the words of which a mark has to contain one to name it."""
_TIDE_RADPS = 2.0 * np.pi / (12.42 * 3600.0)
_LEAST_SPREAD = 0.13  # of directions, the smaller eigenvalue: two courses 30 deg apart
_MARGIN_S, _LONGEST_RUN_ON_S = 20.0, 300.0
_DEPTH_AVERAGED = "10s"  # as `seatrial conduct` watches the depth
_DEPTH_STEP_S = 3.0  # sounders that tell less often have no three depths in it
_KINDS = ("turning_circle", "course_change", "zigzag", "stopping")


@dataclass(frozen=True, slots=True)
class Mark:
    """A manoeuvre marked by the crew, between two times [ns since 1970]."""

    text: str
    start_ns: int
    end_ns: int

    def covers(self, time: pd.Timestamp) -> bool:
        """Whether a time lies inside, or within ten seconds of it, since marks are early or late."""
        slack_ns = 10_000_000_000
        return self.start_ns - slack_ns <= time.value <= self.end_ns + slack_ns


def pair_event_marks(events: Iterable[tuple[int, str]]) -> tuple[Mark, ...]:
    """The manoeuvres enclosed by event marks: a text with "start", up to the next with "start" or "end".

    >>> [mark.text for mark in pair_event_marks([(0, "zigzag start"), (9, "coffee"), (60, "zigzag end")])]
    ['zigzag']
    """
    ordered = sorted(events)
    boundaries = [
        (time, text.strip()) for time, text in ordered if _START.search(text) or _END.search(text.strip())
    ]
    ends = [*(time for time, _ in boundaries), np.iinfo(np.int64).max // 2][1:]
    return tuple(Mark(" ".join(_START.sub("", text).split()), time, end)
                 for (time, text), end in zip(boundaries, ends, strict=True) if _START.search(text))  # fmt: skip


def find_manoeuvres(
    table: pd.DataFrame,
    length_m: float | None = None,
    events: Iterable[tuple[int, str]] = (),
    conditions: Conditions | None = None,
) -> tuple[Manoeuvre, ...]:
    """The manoeuvres in a table of the 13 channels, in order of time, with indices and their 95 % intervals.

    ``table`` is indexed by UTC, at 1 Hz or faster, raw or resampled. ``length_m`` is the ship's length between
    perpendiculars, for indices in lengths and the IMO limits; without it both are left out. ``events`` are
    (time [ns since 1970], text) as in a recording. ``conditions`` complete what the table itself has of its
    trial, for the results against the limits. Raises :class:`InputError` where channels are missing.
    Methods: ITTC 7.5-04-02-01, IMO MSC.137(76) and MSC/Circ.1053.
    """
    return find_manoeuvres_and_left_out(table, length_m, events, conditions=conditions)[0]


def find_manoeuvres_and_left_out(
    table: pd.DataFrame,
    length_m: float | None = None,
    events: Iterable[tuple[int, str]] = (),
    finders: Sequence[str] = (),
    conditions: Conditions | None = None,
) -> tuple[tuple[Manoeuvre, ...], tuple[LeftOut, ...]]:
    """As :func:`find_manoeuvres`, with the rejected candidates and the reasons, in order of time.

    ``finders`` are a user's finders, ``FILE.py:FUNCTION`` or entry points of ``seatrial.manoeuvres``: functions
    from :class:`Motion` to :class:`Manoeuvre`s, which may overlap those found here.
    """
    conditions = conditions_of_table(table, length_m, conditions)
    motion, in_time = motion_of(table, conditions.length_m), attrgetter("start")
    bounds = motion.utc(float(motion.time_s[0])), motion.utc(float(motion.time_s[-1]))
    if motion.time_s.size * motion.step_s < _SHORTEST_S:
        why = f"the recording is shorter than {_SHORTEST_S:.0f} s"
        return (), (LeftOut("manoeuvre", *bounds, why),)
    events = list(events)
    programme = conducted.conducted_runs(events)
    events = [event for event in events if not conducted.is_mark_of_run(event[1])]
    marks = pair_event_marks(events)
    judged = _find_candidates(motion, marks, events)
    for span in (run.judged for run in sorted(programme, key=lambda run: run.outcome == "valid") if run.judged):
        judged = sorted(_replace_by_judged(judged, table, span, conditions, events), key=in_time)
    runs = remove_currents(motion, [run for run in judged if isinstance(run, Manoeuvre)])
    runs = conducted.exclude_uncounted(_add_depth_and_wind(_apply_marks(runs, marks), table), programme)
    added = conducted.exclude_uncounted([run for name in finders for run in _call_finder(name, motion)], programme)
    manoeuvres = sorted([*criteria.add_limits(runs, conditions), *added], key=in_time)
    left_out = [candidate for candidate in judged if isinstance(candidate, LeftOut)]
    faults = [("speed run or stop", fault) for fault in check_shaft_sign(table).findings]
    helms, steering = check_helm_sign(table).findings, motions.steering_actuators(motions.recorded_actuators(table))
    if 0 < len(helms) < len(steering):  # their mean is that of no rudder
        faults += [("turn or zigzag", fault) for fault in helms]
    left_out[:0] = [LeftOut(kind, *bounds, fault.text) for kind, fault in faults]
    if not motion.steering:
        left_out.insert(0, LeftOut("turn or zigzag", *bounds, _NO_HELM))
    elif not manoeuvres and not left_out:
        helm = (
            f"the direction of the thrust of {len(motion.drives)} drives" if motion.steers_by_thrust else "the helm"
        )
        why = (
            f"{helm} was never held until the ship had turned by {kinds.LEAST_TURN_OF_ONE_SIDE_DEG:.0f} deg, and "
            "did not alternate from side to side; no thrust was held on a straight course, or changed; the ship "
            f"made {measures.smooth_motion(motion, measures.WIDEST_S).fastest_mps:.2g} m/s at most"
        )
        left_out = [LeftOut("manoeuvre", *bounds, why)]
    return tuple(manoeuvres), tuple(left_out)


def _find_candidates(
    motion: Motion, marks: Sequence[Mark], events: Sequence[tuple[int, str]]
) -> list[Manoeuvre | LeftOut]:
    """The manoeuvres of a motion and the rejected candidates, in order of time."""
    smooth = measures.smooth_motion(motion, max(measures.WIDEST_S, 3 * motion.step_s))
    steered, taken = _zigzags_and_turns(motion, smooth, marks)
    tests = straight_runs.find_thruster_tests(motion, smooth, ~taken) if motion.drives else []
    for test in tests:
        taken |= _row_mask_of_candidate(motion, test) & isinstance(test, Manoeuvre)
    straight = list[Manoeuvre | LeftOut]()
    if motion.drives:
        straight += straight_runs.find_stops(motion, smooth, ~taken, straight_runs.engine_orders(motion, events))
        straight += [
            *straight_runs.find_accelerations(motion, smooth, ~taken),
            *straight_runs.find_speed_runs(motion, smooth, ~taken),
        ]
    judged = sorted([*steered, *tests, *straight], key=attrgetter("start"))
    for number, candidate in enumerate(judged):
        measured = float(motion.measured[_row_mask_of_candidate(motion, candidate)].mean())
        if isinstance(candidate, Manoeuvre) and not measured >= _MEASURED_SHARE:
            why = f"position, heading or speeds are missing in {1.0 - measured:.0%} of it"
            judged[number] = LeftOut(candidate.kind, candidate.start, candidate.end, why)
    return judged


def _replace_by_judged(
    candidates: Sequence[Manoeuvre | LeftOut],
    table: pd.DataFrame,
    span: conducted.JudgedSpan,
    conditions: Conditions,
    events: Sequence[tuple[int, str]],
) -> list[Manoeuvre | LeftOut]:
    """The candidates with those of a span's kind as the span alone shows them, which is what was shown aboard."""
    part = span.rows_of(table)
    if len(part) < 2 or (part.index.max() - part.index.min()).total_seconds() < _SHORTEST_S:
        return list(candidates)
    in_part = _find_candidates(motion_of(part, conditions.length_m), pair_event_marks(events), events)
    judged = [run for run in in_part if isinstance(run, Manoeuvre) and run.kind == span.kind]
    if not judged:
        return list(candidates)
    outside = [run for run in candidates if not (span.start <= run.start <= span.end and run.kind == span.kind)]
    return [*outside, *judged]


def conditions_of_table(
    table: pd.DataFrame, length_m: float | None = None, stated: Conditions | None = None
) -> Conditions:
    """The conditions of a recording: what is stated, completed by what the recording itself shows.

    Raises :class:`InputError` for a length that is not positive.
    """
    recorded = recorded_conditions(trial_of(table), table)
    conditions = replace_by_stronger_wind((stated or Conditions()).completed_from(recorded), recorded)
    conditions = conditions if length_m is None else replace(conditions, length_m=length_m)
    if conditions.length_m is not None and not conditions.length_m > 0.0:
        raise errors.InputError("the ship's length is not positive", why=f"it is {conditions.length_m} m")
    return conditions


def _add_depth_and_wind(runs: Iterable[Manoeuvre], table: pd.DataFrame) -> list[Manoeuvre]:
    """Runs with the least depth of the water in each, the median of ten seconds, and its mean wind, where these
    were recorded.

    They are those of the run's own samples, whatever else was recorded: `seatrial conduct` judges the run by them
    aboard.
    """
    times, depths_m, result = utc_index(table), water_depth_m(table), list[Manoeuvre]()
    recorded = pd.Series(np.broadcast_to(depths_m, len(times)), times).dropna().sort_index()
    wind = table.reindex(columns=["wind_speed_mps"]).iloc[: 0 if is_assumed(table, "wind_direction_deg") else None]
    wind_mps = wind["wind_speed_mps"].dropna().sort_index()
    for run in runs:
        depths, winds_mps = recorded[run.start : run.end], wind_mps[run.start : run.end]
        steps_s = np.diff(pd.DatetimeIndex(depths.index).as_unit("ns").asi8) / NANO
        is_slow = steps_s.size > 0 and np.median(steps_s) > _DEPTH_STEP_S
        medians = depths.rolling(_DEPTH_AVERAGED, min_periods=1 if is_slow else 3).median()
        measured = {} if medians.isna().all() else {"water_depth_m": float(medians.min())}
        measured |= {} if winds_mps.empty else {"wind_mps": float(winds_mps.mean())}
        result.append(replace(run, settings={**run.settings, **measured}))
    return result


class RecordedRuns(NamedTuple):
    """The manoeuvres of one recording, with its table, what is stated of its conditions, and the programme that was
    conducted in it."""

    table: pd.DataFrame
    runs: Sequence[Manoeuvre]
    stated: Conditions
    programme: tuple[conducted.ConductedRun, ...] = ()


def share_currents_of_trial(recordings: Sequence[RecordedRuns]) -> list[tuple[Manoeuvre, ...]]:
    """The manoeuvres of the recordings of one trial: what one shows of the current counts for the others, and what
    one states of a run that another began.

    A recording that has a current itself, stated or from a circle, keeps its own.
    """
    observations = [seen for recording in recordings for seen in current_observations(recording.runs)]
    programme = [run for recording in recordings for run in recording.programme]
    recordings = [
        recording._replace(runs=conducted.exclude_uncounted(recording.runs, recording.programme, programme))
        for recording in recordings
    ]
    trial = [run for recording in recordings for run in recording.runs]
    results = []
    for table, runs, stated, _ in recordings:
        conditions, result = conditions_of_table(table, stated=stated), tuple(runs)
        if runs and conditions.current_mps is None and not any(run.current for run in runs):
            with_current = remove_currents(motion_of(table, conditions.length_m), runs, observations)
            currents = [run.current for run in with_current if run.current is not None]
            if currents:
                speed_mps = max(float(np.hypot(current.north_mps, current.east_mps)) for current in currents)
                result = criteria.add_limits(with_current, replace(conditions, current_mps=speed_mps), trial)
        results.append(result)
    return results


def _call_finder(name: str, motion: Motion) -> list[Manoeuvre]:
    """The manoeuvres of a user's finder; a failure is logged, and the others go on."""
    function = named_code.load(name, "manoeuvres")
    named_code.require_signature(function, name, "motion")
    with (
        suppress(named_code.UserCodeError),
        named_code.report_user_code_errors(name, named_code.defining_file(function)),
    ):
        manoeuvres = list(function(motion))
        if not all(isinstance(manoeuvre, Manoeuvre) for manoeuvre in manoeuvres):
            raise TypeError("it returned something other than seatrial.analysis.manoeuvres.indices.Manoeuvre")
        return manoeuvres
    return []


def _zigzags_and_turns(
    motion: Motion, smooth: Motion, marks: Sequence[Mark]
) -> tuple[list[Manoeuvre | LeftOut], Bools]:
    """Zigzags and turns, what was rejected, and the rows that they take."""
    motion, helms, held = _helm_plateaus(motion)
    helm, fastest_mps = motion.helm_deg, smooth.fastest_mps
    calm, rows = measures.helm_turning_points(helm, motion.step_s)
    extremes = [measures.Plateau(row, row + 1, float(calm[row]), 0.0) for row in rows]  # the reversals of the helm
    alternating = kinds.zigzag_chains(
        motion, measures.join_interrupted_plateaus(helm, held, motion.step_s), extremes
    )
    zigzag_marks = [mark for mark in marks if "zig" in mark.text.lower()]
    chains, left_out = list[list[measures.Plateau]](), list[LeftOut]()
    for chain in alternating:
        start, end = (motion.utc(float(motion.time_s[row])) for row in (chain[0].first, chain[-1].end - 1))
        if len(chain) >= kinds.FEWEST_SWINGS or any(mark.covers(start) for mark in zigzag_marks):
            chains.append(chain)
        if len(chain) == kinds.FEWEST_SWINGS - 1:
            why = f"the helm alternates {len(chain)} times, less than {kinds.FEWEST_SWINGS}"
            left_out.append(LeftOut("zigzag", start, end, why))
    zigzags = [(chain, kinds.make_zigzag(motion, chain)) for chain in chains]
    zigzags = [(chain, run) for chain, run in zigzags if not kinds.keeps_course(run)]
    taken = _rows_taken_by_chains(motion, [chain for chain, _ in zigzags])
    spirals = kinds.spiral_steps(motion, _drop_taken_plateaus(helms, taken))
    taken |= _rows_taken_by_chains(motion, spirals)
    manoeuvres = [run for _, run in zigzags]
    manoeuvres += [kinds.make_spiral(motion, steps) for steps in spirals]
    if helm.any():
        rates = kinds.reverse_spiral_steps(
            motion, smooth.yaw_rate_dps, ~_rows_taken_by_manoeuvres(motion, manoeuvres)
        )
        reverse = [kinds.make_reverse_spiral(motion, steps) for steps in rates]
        manoeuvres, taken = [*manoeuvres, *reverse], taken | _rows_taken_by_manoeuvres(motion, reverse)
    free = _drop_taken_plateaus(held, taken)
    williamson = kinds.find_williamson_turns(motion, free)
    turns = measures.join_interrupted_plateaus(
        helm, _drop_taken_plateaus(free, _rows_taken_by_manoeuvres(motion, williamson)), motion.step_s
    )
    judged = [turn for plateau in turns if (turn := kinds.make_turn_or_reject(motion, plateau, fastest_mps))]
    manoeuvres += [*williamson, *(turn for turn in judged if isinstance(turn, Manoeuvre))]
    manoeuvres += kinds.find_pull_outs(motion, _drop_taken_plateaus(helms, taken), smooth.yaw_rate_dps, fastest_mps)
    left_out = [*(candidate for candidate in judged if isinstance(candidate, LeftOut)), *left_out]
    taken = _rows_taken_by_manoeuvres(motion, manoeuvres)
    left_out = [candidate for candidate in left_out if not taken[_row_mask_of_candidate(motion, candidate)].any()]
    return [*manoeuvres, *left_out], taken


def _helm_plateaus(motion: Motion) -> tuple[Motion, list[measures.Plateau], list[measures.Plateau]]:
    """The motion with its helm [deg], 0 where it steers by thrust and no propulsor runs, if the shafts are known;
    the plateaus of the helm, and those off amidships that are steady enough to be orders."""
    helm = motion.helm_deg
    push = np.linalg.norm([np.zeros(motion.time_s.size), *motion.drives.values()], axis=0)
    if motion.steers_by_thrust and push.any():
        running = push > max(_RUNNING_SHARE * float(np.percentile(push, 99)), 10.0 * motion.drive_noise_rpm)
        helm = np.where(running, helm, 0.0)
    # Reversed thrust turns the direction of thrust by 180 deg at once, which is not a rate of the helm.
    ahead = np.where(np.abs(helm) > _WIDEST_HELM_DEG, 0.0, helm)
    rate, tolerance = (
        measures.helm_rate_dps(ahead, motion.step_s),
        measures.command_noise_tolerance(helm, _LEAST_STEP_DEG),
    )
    helms, swings_s = list[measures.Plateau](), np.diff(measures.helm_turning_points(ahead, motion.step_s)[1])
    swing_s = float(np.median(swings_s)) * motion.step_s if swings_s.size >= kinds.FEWEST_SWINGS else np.inf
    least_s = min(_LEAST_HELD_S, _HELD_SHARE_OF_SWING * swing_s)
    for first, end in runs_of_true(~motion.broken):
        pieces = measures.find_plateaus(helm[first:end], motion.step_s, tolerance, least_s, rate)
        helms += [
            replace(plateau, first=plateau.first + first, end=plateau.end + first)
            for plateau in measures.merge_corrections(pieces, motion.step_s)
        ]
    least = max(_LEAST_HELM_DEG, 4.0 * row_to_row_noise(helm))
    held = [
        plateau for plateau in helms
        if least <= abs(plateau.level) <= _WIDEST_HELM_DEG
        and plateau.spread <= _STEADY_HELM_SHARE * abs(plateau.level) + _STEADY_HELM_DEG
    ]  # fmt: skip
    return replace(motion, helm_deg=helm, helm_rate_dps=rate), helms, held


def _rows_taken_by_chains(motion: Motion, chains: Iterable[Sequence[measures.Plateau]]) -> Bools:
    rows = np.zeros(motion.time_s.size, dtype=bool)
    for chain in chains:
        rows[chain[0].first : chain[-1].end] = True
    return rows


def _drop_taken_plateaus(held: Sequence[measures.Plateau], taken: Bools) -> list[measures.Plateau]:
    return [plateau for plateau in held if not taken[plateau.first : plateau.end].any()]


def _rows_taken_by_manoeuvres(motion: Motion, manoeuvres: Iterable[Manoeuvre]) -> Bools:
    taken = np.zeros(motion.time_s.size, dtype=bool)
    for manoeuvre in manoeuvres:
        taken |= _row_mask_of_candidate(motion, manoeuvre)
    return taken


def _row_mask_of_candidate(motion: Motion, candidate: Manoeuvre | LeftOut) -> Bools:
    start, end = motion.seconds_of(candidate.start), motion.seconds_of(candidate.end)
    return np.asarray((motion.time_s >= start) & (motion.time_s <= end))


def _apply_marks(runs: Iterable[Manoeuvre], marks: Sequence[Mark]) -> list[Manoeuvre]:
    """Manoeuvres with the names given by the crew; a marked turn counts as a circle however short."""
    result = []
    for run in runs:
        text = next((mark.text for mark in marks if mark.covers(run.start) and mark.text), "")
        if text and any(word in text.lower() for word in _MARK_WORDS[run.kind].split()):
            kind = "turning_circle" if run.kind == "course_change" else run.kind
            run = replace(run, kind=kind, name=text)
        result.append(run)
    return result


class Observation(NamedTuple):
    """The current along a direction (north, east), with half of its 95 % interval [m/s], at a time."""

    time: pd.Timestamp
    direction: tuple[float, float]
    along_mps: float
    within_mps: float


def current_observations(runs: Sequence[Manoeuvre]) -> list[Observation]:
    """The current as circles and pairs of reciprocal runs show it."""
    seen, pairs = list[Observation](), set[float]()
    for run in runs:
        time = run.start + (run.end - run.start) / 2
        if run.current is not None and kinds.shows_current(run):
            current = run.current
            seen.append(Observation(time, (1.0, 0.0), current.north_mps, current.north_within_mps))
            seen.append(Observation(time, (0.0, 1.0), current.east_mps, current.east_within_mps))
        pair = run.settings.get("reciprocal_pair")
        if pair is not None and pair not in pairs:
            pairs.add(pair)
            course, along = np.deg2rad(run.settings["heading_deg"]), run.indices["current_along_mps"]
            direction = float(np.cos(course)), float(np.sin(course))
            seen.append(Observation(time, direction, along.value, 0.5 * (along.high - along.low)))
    return seen


def current_at_time(time: pd.Timestamp, observations: Sequence[Observation]) -> Current | None:
    """The current at a time, None where no two directions of it were observed within two hours."""
    apart_s = np.array([abs((observation.time - time).total_seconds()) for observation in observations])
    near = apart_s <= straight_runs.LONGEST_BETWEEN_S
    if not near.any():
        return None
    direction, along, within = (
        np.array([getattr(observation, name) for observation in observations])[near]
        for name in ("direction", "along_mps", "within_mps")
    )
    if np.linalg.eigvalsh(direction.T @ direction)[0] < _LEAST_SPREAD or not np.all(np.isfinite(within)):
        return None
    speed_mps = float(np.linalg.norm(_weighted_mean_current(direction, along, np.maximum(within, 1e-3))[0]))
    changed = speed_mps * np.minimum(_TIDE_RADPS * apart_s[near], 2.0)
    (north, east), halves = _weighted_mean_current(direction, along, np.hypot(np.maximum(within, 1e-3), changed))
    return Current(float(north), float(east), float(halves[0]), float(halves[1]))


def _weighted_mean_current(direction: Floats, along: Floats, within: Floats) -> tuple[Floats, Floats]:
    """The current north and east by weighted least squares, and the halves of their intervals [m/s]."""
    weights = 1.0 / within**2
    inverse = np.linalg.inv(direction.T @ (weights[:, None] * direction))
    return inverse @ (direction.T @ (weights * along)), np.sqrt(np.diag(inverse))


def remove_currents(
    motion: Motion, runs: Sequence[Manoeuvre], elsewhere: Sequence[Observation] = ()
) -> list[Manoeuvre]:
    """The runs, those without a current of their own with the ways through the water, where the trial shows it.

    ``elsewhere`` is what other recordings of the trial show of it.
    """
    observations, result = [*current_observations(runs), *elsewhere], list(runs)
    for place, run in enumerate(runs):
        if run.kind in _KINDS and run.current is None and (current := current_at_time(run.start, observations)):
            result[place] = _remove_current(motion, run, current)
    return result


def _remove_current(motion: Motion, run: Manoeuvre, current: Current) -> Manoeuvre:
    start, end = motion.seconds_of(run.start), motion.seconds_of(run.end)
    part = motion.around(start - _MARGIN_S, end + _LONGEST_RUN_ON_S * (run.kind == "stopping"), _MARGIN_S)
    smooth = measures.smooth_motion(part, measures.smoothing_half_width_s(part, 0.1 * (end - start)))

    def measure(flow: Motion) -> dict[str, float]:
        """The indices of the run, between the times of its execute and its end [s]."""
        if run.kind == "stopping":
            astern = flow.time_s[(flow.time_s > start) & (flow.surge_mps <= 0.0)]  # stopped in the water
            return straight_runs.stopping_indices(flow, np.array([start, float(astern[0]) if astern.size else end]))
        if run.kind == "zigzag":
            later = [(execute - run.start).total_seconds() for execute in run.executes]
            orders = start + np.array([0.0, *later, end - start])
            times = np.stack([orders, orders + run.settings["half_command_s"] * (orders < end)])
            return kinds.zigzag_indices(flow, times)
        return kinds.circle_indices(flow, np.array([start, end]))

    north, east = current.north_mps, current.east_mps
    flows = [(north, east), (north + current.north_within_mps, east), (north, east + current.east_within_mps)]
    ground = measure(smooth)
    water, *perturbed = (measure(kinds.remove_current(smooth, *flow, start)) for flow in flows)
    indices = {}
    for name, index in run.indices.items():
        if index.unit == "m" and name in ground and all(name in values for values in (water, *perturbed)):
            within = float(np.linalg.norm([values[name] - water[name] for values in perturbed]))
            low, high = np.hypot(index.value - index.low, within), np.hypot(index.high - index.value, within)
            value = index.value + (water[name] - ground[name])
            length_m = index.value / index.lengths if index.lengths else None
            indices[name + kinds.REMOVED] = replace(
                index_from_value(name, value, 0.0, length_m), low=value - float(low), high=value + float(high),
                counted_from=index.counted_from,
            )  # fmt: skip
    if not indices:
        return run
    note = "the current removed is that of other runs of the trial, and what it may have changed by"
    return replace(run, indices={**run.indices, **indices}, current=current, notes=(*run.notes, note))
