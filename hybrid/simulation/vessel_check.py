"""The standard manoeuvres of a vessel file on the simulator, in still water and air, beside IMO's limits.

Turning circles to both sides, zigzags 10/10 and 20/20, pull-outs, a crash stop, and the steady speed over the shaft
speed (IMO MSC.137(76) and MSC/Circ.1053; ITTC 7.5-04-02-01). The measures are those of the manoeuvres found in
recordings (:mod:`analysis.manoeuvres`), on the simulated track instead of a measured one, and the criteria are
judged by the same functions. An autopilot holds the approach, also against a moment that turns the ship by itself:
what counts is the heading that it holds.

The test speed is the one at 85 % of the propellers' highest power, taken as the cube of the shaft speed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from math import inf, nan
from typing import Any, ClassVar

import numpy as np

from acquisition.config.conditions import Conditions
from acquisition.core.actuators import control_names
from acquisition.core.arrays import Floats
from acquisition.core.errors import DataShortageError, ModelRangeError
from acquisition.core.result import Result
from analysis.manoeuvres.criteria import CriterionResult, criteria_of, index_rows
from analysis.manoeuvres.indices import Index, Manoeuvre, from_order, index_of, side_of
from analysis.manoeuvres.measures import approach_of
from analysis.manoeuvres.motion import Motion
from analysis.manoeuvres.runs import stopping_indices
from analysis.manoeuvres.standards import FULL_ASTERN, TURNING_HELM_DEG, add_limits
from analysis.manoeuvres.turning_circle import circle_indices
from analysis.manoeuvres.zigzag import zigzag_indices
from hybrid.effects import vessel_plant
from hybrid.simulation.autopilot import drives_of
from hybrid.simulation.handling import handling_of, pace_of, shaft_limit_rpm, steady_speed_mps
from hybrid.simulation.manoeuvres import Leg, helm, steer, zigzag
from hybrid.simulation.sea_state import SeaState
from hybrid.simulation.trial import sail_through
from hybrid.vessel.actuators import control_units
from hybrid.vessel.parameters import Vessel

TEST_SHARE = 0.85 ** (1.0 / 3.0)
"""The shaft speed of the tests, of its limit."""

COURSE_STABLE_SHARE = 0.02
"""A rate of turn that is left with the helm amidships, of that of the turn before: less is none."""

_STILL = SeaState(0.0, 0.0, 5.0, 0.0)
_STEP_S = 0.05  # at R/V Gunnerus' pace
_APPROACH_LENGTHS, _LEAST_APPROACH_S = 20.0, 15.0
_CIRCLE_LENGTHS, _ZIGZAG_LENGTHS, _TURN_LENGTHS, _PULL_LENGTHS, _STOP_LENGTHS = 80.0, 120.0, 15.0, 60.0, 120.0
_CIRCLE_DEG, _PULL_OUT_DEG, _HELM_STEP_DEG, _LEAST_HELM_DEG = 720.0, 20.0, 5.0, 5.0
_SWINGS = 4
_SPEEDS = 10
_STEADY_SHARE = 0.02  # of the rate of turn of a circle as wide as the ship is long, which a steady approach keeps
_WIDEST_SWING_DEG = 150.0
_DEEP_DRAUGHTS = 100.0
_SHOWN = {
    "turning_circle": ("advance_m", "transfer_m", "tactical_diameter_m", "steady_diameter_m", "steady_yaw_rate_dps",
                       "drift_angle_deg", "speed_loss"),
    "zigzag": ("initial_turning_m", from_order(1), from_order(2), "period_s"),
    "pull_out": ("turning_yaw_rate_dps", "residual_yaw_rate_dps"),
    "stopping": ("track_reach_m", "head_reach_m", "lateral_deviation_m", "heading_change_deg", "stopping_time_s"),
}  # fmt: skip
"""What is shown of each kind of test."""


@dataclass(frozen=True, slots=True, eq=False)
class StandardTest:
    """One simulated test: the run with its indices, its motion, and the times of its orders and of its end [s]."""

    run: Manoeuvre
    motion: Motion
    executes_s: Floats

    @property
    def kind(self) -> str:
        """The kind of manoeuvre."""
        return self.run.kind

    @property
    def name(self) -> str:
        """The test and its side."""
        return self.run.sided_name

    @property
    def helm_deg(self) -> float:
        """The helm, positive to starboard [deg]; 0 of a stop."""
        return self.run.sign * abs(self.run.helm_deg or 0.0)

    @property
    def indices(self) -> Mapping[str, Index]:
        """The indices by name; simulated without noise, they have no interval."""
        return self.run.indices

    def as_dict(self) -> dict[str, Any]:
        """For JSON, without the track."""
        return {
            "kind": self.kind, "name": self.name, "helm_deg": self.helm_deg, "executes_s": self.executes_s.tolist(),
            "indices": {name: index.as_json() for name, index in self.indices.items()},
        }  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class VesselCheck(Result):
    """How a ship behaves by her vessel file.

    ``rpm`` and ``speed_mps`` are those of the tests, ``speeds`` [S, 2] steady speeds [m/s] over shaft speeds [rpm].
    ``left_out`` says of tests that could not be made why.
    """

    vessel: str
    length_m: float
    rpm: float
    speed_mps: float
    speeds: Floats
    tests: tuple[StandardTest, ...]
    left_out: Mapping[str, str] = field(default_factory=dict)
    view: ClassVar[str] = "hybrid.report.vessel_check:vessel_check_view"
    drawing: ClassVar[str] = "hybrid.report.vessel_check:draw_vessel_check"
    size_inch: ClassVar[tuple[float, float]] = (13.0, 8.6)

    def of_kind(self, kind: str) -> tuple[StandardTest, ...]:
        """The tests of a kind: ``turning_circle``, ``zigzag``, ``pull_out``, ``stopping``."""
        return tuple(each for each in self.tests if each.kind == kind)

    @property
    def criteria(self) -> list[CriterionResult]:
        """What the ship shows of each criterion of IMO's standards by its model, to each side."""
        return criteria_of(index_rows(test.run for test in self.tests))

    @property
    def course_stable(self) -> bool | None:
        """Whether she comes out of a turn to either side when the helm is amidships; None where it is not known."""
        rates = [[abs(index.value) for index in each.indices.values()] for each in self.of_kind("pull_out")]
        return all(left < COURSE_STABLE_SHARE * turning for turning, left in rates) if rates else None

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "vessel": self.vessel, "length_m": self.length_m, "rpm": self.rpm, "speed_mps": self.speed_mps,
            "speeds": [{"rpm": rpm, "speed_mps": speed} for rpm, speed in self.speeds.tolist()],
            "tests": [each.as_dict() for each in self.tests], "course_stable": self.course_stable,
            "criteria": [result.as_json() for result in self.criteria], "left_out": dict(self.left_out),
        }  # fmt: skip


def check_vessel(vessel: Vessel, rpm: float | None = None) -> VesselCheck:
    """The standard manoeuvres of a ship at a shaft speed, by default at :data:`TEST_SHARE` of its limit.

    Raises :class:`ConfigurationError` for a ship that nothing drives or steers, :class:`ModelRangeError` where she
    leaves the range of her model straight ahead.
    """
    limit = shaft_limit_rpm(vessel)
    test_rpm = limit * TEST_SHARE if rpm is None else rpm
    sides = (("starboard", 1.0), ("port", -1.0))
    trials: dict[str, Callable[[], StandardTest]] = {
        **{f"turning circle to {name}": partial(_turning_circle, vessel, test_rpm, side) for name, side in sides},
        **{
            f"zigzag {angle:.0f}/{angle:.0f} to {name}": partial(_zigzag, vessel, test_rpm, angle, side)
            for angle in (10.0, 20.0)
            for name, side in sides
        },
        **{f"pull-out from {name}": partial(_pull_out, vessel, test_rpm, side) for name, side in sides},
        "crash stop": partial(_crash_stop, vessel, test_rpm),
    }
    speed_mps = _test_speed_mps(vessel, test_rpm)
    made, left_out = _made(trials)
    length_m = length_of(vessel)
    draught_m = vessel.dimensions.draught_m
    depth_m = vessel.effects.get("shallow_water", {}).get("depth_m", _DEEP_DRAUGHTS * draught_m)
    current_mps = vessel.effects.get("ocean_current", {}).get("speed_mps", 0.0)
    conditions = Conditions(
        length_m=length_m, draught_m=draught_m, full_load_draught_m=draught_m, trim_m=0.0, beaufort=0, sea_state=0,
        water_depth_m=depth_m, current_mps=current_mps,
        speed_at_85_percent_mcr_mps=_test_speed_mps(vessel, limit * TEST_SHARE),
    )  # fmt: skip
    judged = add_limits((test.run for test in made), conditions)
    tests = tuple(replace(test, run=run) for test, run in zip(made, judged, strict=True))
    return VesselCheck(vessel.name, length_m, test_rpm, speed_mps, _speeds(vessel, limit), tests, left_out)


def _made(trials: Mapping[str, Callable[[], StandardTest]]) -> tuple[tuple[StandardTest, ...], dict[str, str]]:
    """The tests that can be made, and why the others cannot."""
    made, left_out = [], {}
    for name, make in trials.items():
        try:
            made.append(make())
        except (ModelRangeError, DataShortageError) as error:
            left_out[name] = f"{error.what}{': ' * bool(error.why)}{error.why}"
    return tuple(made), left_out


def length_of(vessel: Vessel) -> float:
    """The length between perpendiculars [m], with what the file's effects make of it."""
    return vessel_plant(vessel).length_between_perpendiculars_m


def _steady_mps(vessel: Vessel, rpm: float) -> float:
    """The steady speed at a shaft speed. Raises :class:`ModelRangeError`."""
    order = handling_of(vessel).orders(rpm, 0.0) * control_units(vessel.actuators)
    return steady_speed_mps(vessel_plant(vessel), order)


def _test_speed_mps(vessel: Vessel, rpm: float) -> float:
    try:
        return _steady_mps(vessel, rpm)
    except ModelRangeError as error:
        raise ModelRangeError(
            f"{vessel.name} leaves the range of its model straight ahead at {rpm:.0f} rpm", why=error.why,
            fix="give a lower --rpm, or the shafts another limit_rpm",
        ) from error  # fmt: skip


def _speeds(vessel: Vessel, highest_rpm: float) -> Floats:
    """Steady speeds [m/s] over shaft speeds [rpm], [S, 2], as far as the range of the model goes."""
    found = []
    for rpm in highest_rpm * np.arange(1, _SPEEDS + 1) / _SPEEDS:
        try:
            found.append((float(rpm), _steady_mps(vessel, rpm)))
        except ModelRangeError:
            break
    return np.array(found).reshape(-1, 2)


def _sailed(vessel: Vessel, legs: Sequence[Leg], lengths: float) -> tuple[Motion, float]:
    """The motion of legs after an approach on a straight course, for so many ship lengths at the usual speed, and
    the time of the execute [s]."""
    pace = pace_of(vessel)
    approach_s = max(_LEAST_APPROACH_S, _APPROACH_LENGTHS * pace.length_s)
    dt_s = _STEP_S * pace.time
    steps = round((approach_s + lengths * pace.length_s) / dt_s)
    approach = steer(0.0, approach_s, abs(legs[0].rpm))
    still = np.random.default_rng(0)
    voyage = sail_through(vessel, vessel_plant(vessel), _STILL, (approach, *legs), steps, dt_s, 0.0, still, still)
    motion = _motion(vessel, voyage.states, voyage.controls / control_units(vessel.actuators), dt_s)
    return motion, float(np.ceil(approach_s / dt_s - 1e-9)) * dt_s


def _motion(vessel: Vessel, states: Floats, controls: Floats, dt_s: float) -> Motion:
    """States [rows, 6] and controls [rows, controls], in their channels' units, as the motion of a recording."""
    handling, rows = handling_of(vessel), len(states)
    names = control_names(vessel.actuators)
    helm_deg = controls @ handling.helm / (handling.helm @ handling.helm)
    return Motion(
        origin_ns=0, time_s=np.arange(rows) * np.float64(dt_s), north_m=states[:, 0], east_m=states[:, 1],
        heading_deg=np.rad2deg(states[:, 2]), surge_mps=states[:, 3], sway_mps=states[:, 4],
        yaw_rate_dps=np.rad2deg(states[:, 5]), helm_deg=helm_deg, thrust=np.zeros(rows),
        drives={names[i]: controls[:, i] for i in np.flatnonzero(handling.main)}, tunnels={},
        known=np.ones(rows, dtype=bool), broken=np.zeros(rows, dtype=bool),
    )  # fmt: skip


def _test(
    kind: str, name: str, side: float, motion: Motion, executes_s: Sequence[float], values: Mapping[str, float],
    length_m: float, helm_deg: float = 0.0, **settings: float,
) -> StandardTest:  # fmt: skip
    """A test with the indices that are shown of its kind; what was not reached is left out.

    Raises :class:`DataShortageError` where the approach was not steady.
    """
    approach = approach_of(motion, executes_s[0])
    circling_dps = float(np.rad2deg(approach["approach_mps"] / max(length_m, 1e-3)))
    if abs(approach["approach_yaw_rate_dps"]) > _STEADY_SHARE * circling_dps:
        raise DataShortageError("the approach is not steady", why="the autopilot cannot keep the ship straight")
    indices = {
        name: index_of(name, float(values[name]), 0.0, length_m, kind)
        for name in _SHOWN[kind] if np.isfinite(values.get(name, nan))
    }  # fmt: skip
    helm = {"rudder_deg": helm_deg} if helm_deg else {}
    run = Manoeuvre(
        kind, name, motion.utc(executes_s[0]), motion.utc(executes_s[-1]), side_of(side) if side else "",
        {**helm, "approach_mps": approach["approach_mps"], **settings}, indices,
    )  # fmt: skip
    return StandardTest(run, motion, np.array(executes_s))


def largest_helm_deg(vessel: Vessel) -> float:
    """35 degrees, or the largest angle of what steers the ship where it is smaller."""
    handling = handling_of(vessel)
    limits = (drives_of(vessel).limit / control_units(vessel.actuators))[handling.steering_angles]
    return float(min([TURNING_HELM_DEG, *limits]))


def _within_range(helm_deg: float, sailed: Callable[[float], StandardTest]) -> StandardTest:
    """A test with the largest helm up to ``helm_deg`` at which the ship stays in the range of her model."""
    while True:
        try:
            return sailed(helm_deg)
        except ModelRangeError:
            if helm_deg - _HELM_STEP_DEG < _LEAST_HELM_DEG:
                raise
            helm_deg -= _HELM_STEP_DEG


def _turning_circle(vessel: Vessel, rpm: float, side: float) -> StandardTest:
    length_m = length_of(vessel)

    def sailed(helm_deg: float) -> StandardTest:
        motion, start = _sailed(vessel, (helm(-side * helm_deg, rpm),), _CIRCLE_LENGTHS)
        turned = np.flatnonzero(side * (motion.heading_deg - motion.at("heading_deg", start)) >= _CIRCLE_DEG)
        motion = motion.rows(0, int(turned[0]) + 1 if turned.size else motion.time_s.size)
        end = float(motion.time_s[-1])
        values = circle_indices(motion, np.array([start, end]))
        if "tactical_diameter_m" not in values or values["tactical_diameter_m"] <= 0.0:
            raise DataShortageError(f"the ship does not turn to {side_of(side)} by half a circle")
        name = f"turning circle {helm_deg:.0f} deg"
        return _test("turning_circle", name, side, motion, (start, end), values, length_m, helm_deg)

    return _within_range(largest_helm_deg(vessel), sailed)


def _zigzag(vessel: Vessel, rpm: float, angle_deg: float, side: float) -> StandardTest:
    """A zigzag about the heading that the autopilot holds in the approach, which need not be the one ordered."""
    length_m = length_of(vessel)
    swung = zigzag(-side * angle_deg, -side * angle_deg, rpm, swings=_SWINGS)
    ordered = [replace(leg, at_most_s=inf) for leg in swung]
    approach, start = _sailed(vessel, ordered[:1], 0.0)
    course_deg = approach.at("heading_deg", start)
    if abs(course_deg) >= angle_deg:
        raise DataShortageError(f"the autopilot holds the course only within {abs(course_deg):.0f} deg")
    legs = [replace(leg, deviation_deg=leg.deviation_deg + course_deg) for leg in ordered]
    motion, start = _sailed(vessel, legs, _ZIGZAG_LENGTHS)
    executes = _executes_s(motion, start, angle_deg, side)
    motion = motion.between(0.0, executes[-1])
    swings = np.abs(motion.heading_deg[motion.time_s >= start] - course_deg)
    if swings.max() > _WIDEST_SWING_DEG:
        raise DataShortageError(f"the heading swings by {swings.max():.0f} deg, which is no zigzag")
    values = zigzag_indices(motion, np.array([executes, executes]))
    if angle_deg != 10.0:
        values.pop("initial_turning_m", None)
    name = f"zigzag {angle_deg:.0f}/{angle_deg:.0f}"
    return _test("zigzag", name, side, motion, executes, values, length_m, angle_deg, switch_deg=angle_deg)


def _executes_s(motion: Motion, start: float, switch_deg: float, first_side: float) -> list[float]:
    """The times at which the helm of a zigzag was ordered, and of its end [s]."""
    executes, side = [start], first_side
    off = motion.heading_deg - motion.at("heading_deg", start)
    for _ in range(_SWINGS):
        over = np.flatnonzero((side * off >= switch_deg) & (motion.time_s > executes[-1]))
        if not over.size:
            raise DataShortageError(f"the heading is not off by {switch_deg:g} deg after swing {len(executes)}")
        executes.append(float(motion.time_s[over[0]]))
        side = -side
    return executes


def _pull_out(vessel: Vessel, rpm: float, side: float) -> StandardTest:
    pace = pace_of(vessel)
    turn_s = _TURN_LENGTHS * pace.length_s

    def sailed(helm_deg: float) -> StandardTest:
        legs = (helm(-side * helm_deg, rpm, turn_s), helm(0.0, rpm))
        motion, start = _sailed(vessel, legs, _TURN_LENGTHS + _PULL_LENGTHS)
        released = start + turn_s
        end = float(motion.time_s[-1])
        values = {
            "turning_yaw_rate_dps": motion.at("yaw_rate_dps", released),
            "residual_yaw_rate_dps": float(motion.between(end - 5.0 * pace.length_s, end).yaw_rate_dps.mean()),
        }
        name = f"pull-out from {helm_deg:.0f} deg"
        executes = (start, released, end)
        return _test("pull_out", name, side, motion, executes, values, length_of(vessel), helm_deg)

    return _within_range(min(_PULL_OUT_DEG, largest_helm_deg(vessel)), sailed)


def _crash_stop(vessel: Vessel, rpm: float) -> StandardTest:
    length_m = length_of(vessel)
    motion, start = _sailed(vessel, (Leg(rpm=-rpm, slower_mps=0.0), Leg(rpm=0.0)), _STOP_LENGTHS)
    stopped = np.flatnonzero((motion.surge_mps <= 0.0) & (motion.time_s > start))
    if not stopped.size:
        raise DataShortageError(f"the ship does not stop within {_STOP_LENGTHS:g} lengths' time")
    end = float(motion.time_s[stopped[0]])
    values = stopping_indices(motion, np.array([start, end]))
    stop = motion.between(0.0, end)
    return _test("stopping", FULL_ASTERN, 0.0, stop, (start, end), values, length_m, thrust_rpm=-rpm)
