"""The standard manoeuvres of a vessel file on the simulator, in still water and air, beside IMO's limits.

Turning circles to both sides, zigzags 10/10 and 20/20, pull-outs and a crash stop, each after a steady approach,
and the steady speed over the shaft speed (IMO MSC.137(76) and MSC/Circ.1053; ITTC 7.5-04-02-01). Measures and
criteria are those of the manoeuvres found in recordings (:mod:`seatrial.analysis.manoeuvres`), on the simulated
track. An autopilot holds the approach, also against a moment that turns the ship by itself: what counts is the
heading that it holds. The test speed is the one at 85 % of the propellers' highest power, taken as the cube of the
shaft speed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from math import inf, nan
from typing import Any, ClassVar

import numpy as np

from seatrial.acquisition.config.run_sheet import Conditions
from seatrial.acquisition.core.errors import DataShortageError, ModelRangeError
from seatrial.acquisition.core.quantities import Floats
from seatrial.acquisition.core.result import Result
from seatrial.acquisition.core.ship import control_names
from seatrial.analysis.manoeuvres import criteria, kinds, measures
from seatrial.analysis.manoeuvres.indices import (
    Index,
    Manoeuvre,
    index_from_value,
    overshoot_from_order_name,
    side_of_sign,
)
from seatrial.analysis.manoeuvres.motion import Motion
from seatrial.analysis.manoeuvres.straight_runs import stopping_indices
from seatrial.hybrid.effects import vessel_plant, without_effects_of_day
from seatrial.hybrid.simulation import manoeuvres
from seatrial.hybrid.simulation.index_table import IndexTable
from seatrial.hybrid.simulation.trial import SeaState, sail_through
from seatrial.hybrid.vessel.actuators import control_units
from seatrial.hybrid.vessel.files import Vessel
from seatrial.hybrid.vessel.plant import Plant

TEST_SHARE = 0.85 ** (1.0 / 3.0)
"""The shaft speed of the tests, of its limit."""

COURSE_STABLE_SHARE = 0.02
"""A residual rate of turn with the helm amidships, of that of the turn before: less is none."""

STILL = SeaState(0.0, 0.0, 5.0, 0.0)
"""No wind, no waves, no current."""
SWINGS = 4
TEST_INDICES = {
    "turning_circle": ("advance_m", "transfer_m", "tactical_diameter_m", "steady_diameter_m", "steady_yaw_rate_dps",
                       "drift_angle_deg", "speed_loss"),
    "zigzag": ("initial_turning_m", overshoot_from_order_name(1), overshoot_from_order_name(2), "period_s"),
    "pull_out": ("turning_yaw_rate_dps", "residual_yaw_rate_dps"),
    "stopping": ("track_reach_m", "head_reach_m", "lateral_deviation_m", "heading_change_deg", "stopping_time_s"),
}  # fmt: skip
"""The indices that each kind of test gives, and with which measured ones are compared."""

STEADY_SHARE = 0.02
"""The rate of turn in a steady approach, at most, of that of a circle as wide as the ship is long."""

_SIDES = (("starboard", 1.0), ("port", -1.0))
_STEP_S = 0.05  # at R/V Gunnerus' pace
_APPROACH_LENGTHS, _LEAST_APPROACH_S = 20.0, 15.0
_CIRCLE_LENGTHS, _SWING_LENGTHS, _TURN_LENGTHS, _PULL_LENGTHS, _STOP_LENGTHS = 80.0, 30.0, 15.0, 180.0, 120.0
_CIRCLE_DEG = 720.0
_WIDEST_SWING_DEG = 150.0
_SAME_SPEED, _MOST_APPROACHES = 0.002, 10
_MOST_RPM = 2.0  # of the shafts' limit: what a model may turn that needs more for a speed than its ship
_INITIAL_HELM_DEG = 10.0
_PULL_OUT_DEG, _HELM_STEP_DEG, _LEAST_HELM_DEG = 20.0, 5.0, 5.0
_SPEEDS = 10
_DEEP_DRAUGHTS = 100.0


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class VesselCheck(Result):
    """How a ship behaves by its vessel file.

    ``rpm`` and ``speed_mps`` are those of the tests, ``speeds`` [S, 2] steady speeds [m/s] over shaft speeds [rpm].
    ``left_out`` says of tests that could not be made why; ``indices`` have the intervals by the file's errors;
    ``of_day`` are the file's effects of the day of a trial, such as a current, without which it was tested.
    """

    vessel: str
    length_m: float
    rpm: float
    speed_mps: float
    speeds: Floats
    tests: tuple[StandardTest, ...]
    left_out: Mapping[str, str] = field(default_factory=dict)
    indices: IndexTable = field(default_factory=IndexTable)
    of_day: tuple[str, ...] = ()
    view: ClassVar[str] = "seatrial.hybrid.report.pages:vessel_check_view"
    frame: ClassVar[str] = "criteria"
    drawing: ClassVar[str] = "seatrial.hybrid.report.pages:draw_vessel_check"
    size_inch: ClassVar[tuple[float, float]] = (13.0, 8.6)

    def of_kind(self, kind: str) -> tuple[StandardTest, ...]:
        """The tests of a kind: ``turning_circle``, ``zigzag``, ``pull_out``, ``stopping``."""
        return tuple(test for test in self.tests if test.kind == kind)

    @property
    def criteria(self) -> list[criteria.CriterionResult]:
        """What the ship shows of each criterion of IMO's standards by its model, to each side."""
        return criteria.criterion_results(criteria.index_rows(test.run for test in self.tests))

    @property
    def course_stable(self) -> bool | None:
        """Whether it comes to the same rate of turn from either side when the helm is amidships; None where it is
        not known. Of a ship that something turns, as unequal thrust does, that is a rate to one side."""
        if len(self.of_kind("pull_out")) < len(_SIDES):
            return None
        apart_dps, turning_dps = (
            sum(test.indices[name].value for test in self.of_kind("pull_out"))
            for name in ("residual_yaw_rate_dps", "turning_yaw_rate_dps")
        )
        return bool(apart_dps < COURSE_STABLE_SHARE * turning_dps)

    @property
    def amidships_dps(self) -> float:
        """The mean rate of turn that is left with the helm amidships, positive to starboard; less than can be seen
        is none."""
        tests = self.of_kind("pull_out")
        to_starboard = [dict(_SIDES)[test.run.side] * test.indices["residual_yaw_rate_dps"].value for test in tests]
        least = max(
            (COURSE_STABLE_SHARE * test.indices["turning_yaw_rate_dps"].value for test in tests), default=0.0
        )
        mean = float(np.mean(to_starboard)) if tests else 0.0
        return mean if abs(mean) >= least else 0.0

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "vessel": self.vessel, "length_m": self.length_m, "rpm": self.rpm, "speed_mps": self.speed_mps,
            "speeds": [{"rpm": rpm, "speed_mps": speed} for rpm, speed in self.speeds.tolist()],
            "tests": [test.as_dict() for test in self.tests], "course_stable": self.course_stable,
            "criteria": [result.as_json() for result in self.criteria], "left_out": dict(self.left_out),
            "indices": self.indices.as_json(),
        }  # fmt: skip


def check_vessel(vessel: Vessel, rpm: float | None = None) -> VesselCheck:
    """The standard manoeuvres in still water at a shaft speed, by default :data:`TEST_SHARE` of its limit.

    Raises :class:`ConfigurationError` for a ship that nothing drives or steers, :class:`ModelRangeError` where it
    leaves the range of its model straight ahead.
    """
    in_file, vessel = vessel, without_effects_of_day(vessel)
    limit = manoeuvres.shaft_limit_rpm(vessel)
    test_rpm = limit * TEST_SHARE if rpm is None else rpm
    ship, left_out = trial_ship_at_rpm(vessel, test_rpm), dict[str, str]()
    pull_outs = {
        f"pull-out from {name}": partial(
            _reduce_helm_until_in_range,
            min(_PULL_OUT_DEG, largest_helm_deg(ship)),
            partial(pull_out_test, ship, side),
        )
        for name, side in _SIDES
    }
    speed_mps = test_speed_mps(vessel, test_rpm)
    tests = make_trials({**standard_trials(ship), **pull_outs}, left_out)
    tests.sort(key=lambda test: list(TEST_INDICES).index(test.kind))
    conditions = conditions_of(ship, test_speed_mps(vessel, limit * TEST_SHARE))
    runs = criteria.add_limits((test.run for test in tests), conditions)
    tests = [replace(test, run=run) for test, run in zip(tests, runs, strict=True)]
    return VesselCheck(
        vessel.name,
        ship.length_m,
        test_rpm,
        speed_mps,
        _speeds_by_rpm(vessel, limit),
        tuple(tests),
        left_out,
        of_day=tuple(sorted(in_file.effects.keys() - vessel.effects)),
    )


def standard_trials(ship: TrialShip) -> dict[str, Callable[[], StandardTest]]:
    """By name the standard manoeuvres of a ship: turning circles and zigzags to either side, and a crash stop."""
    helm_deg = min(criteria.TURNING_HELM_DEG, largest_helm_deg(ship))
    circles = {
        f"turning circle to {name}": partial(
            _reduce_helm_until_in_range, helm_deg, partial(turning_circle_test, ship, side)
        )
        for name, side in _SIDES
    }
    zigzags = {
        f"zigzag {angle:.0f}/{angle:.0f} to {name}": partial(_zigzag_within_range, ship, angle, side)
        for angle in (_INITIAL_HELM_DEG, 20.0)
        for name, side in _SIDES
    }
    return {**circles, **zigzags, "crash stop": partial(stopping_test, ship, -ship.rpm)}


def make_trials(trials: Mapping[str, Callable[[], StandardTest]], left_out: dict[str, str]) -> list[StandardTest]:
    """The tests that a ship can make; ``left_out`` takes the reasons of the others."""
    tests = []
    for trial, make in trials.items():
        try:
            tests.append(make())
        except (ModelRangeError, DataShortageError) as error:
            left_out[trial] = f"{error.what}{': ' * bool(error.why)}{error.why}"
    return tests


def conditions_of(ship: TrialShip, full_speed_mps: float) -> Conditions:
    """The conditions of the tests: calm air, the draught of the file on even keel, and the water that the plant and
    its effects, whichever they are, say."""
    draught_m = ship.plant.draught_m
    depths_m = (values["depth_m"] for values in ship.vessel.effects.values() if "depth_m" in values)
    return Conditions(
        length_m=ship.length_m, draught_m=draught_m, full_load_draught_m=draught_m, trim_m=0.0, beaufort=0,
        sea_state=0, water_depth_m=min(depths_m, default=_DEEP_DRAUGHTS * draught_m),
        current_mps=float(np.hypot(ship.plant.current_north_mps, ship.plant.current_east_mps)),
        speed_at_85_percent_mcr_mps=full_speed_mps,
    )  # fmt: skip


def _steady_mps(vessel: Vessel, rpm: float) -> float:
    """The steady speed at a shaft speed. Raises :class:`ModelRangeError`."""
    order = manoeuvres.handling_of(vessel).orders(rpm, 0.0) * control_units(vessel.actuators)
    return manoeuvres.steady_speed_mps(vessel_plant(vessel), order)


def test_speed_mps(vessel: Vessel, rpm: float) -> float:
    """The speed of the tests. Raises :class:`ModelRangeError` where the model does not go as far."""
    try:
        return _steady_mps(vessel, rpm)
    except ModelRangeError as error:
        raise ModelRangeError(
            f"{vessel.name} leaves the range of its model straight ahead at {rpm:.0f} rpm", why=error.why,
            fix="give a lower --rpm, or the shafts another limit_rpm",
        ) from error  # fmt: skip


def _speeds_by_rpm(vessel: Vessel, highest_rpm: float) -> Floats:
    """Steady speeds [m/s] over shaft speeds [rpm], [S, 2], as far as the range of the model goes."""
    speeds = []
    for rpm in highest_rpm * np.arange(1, _SPEEDS + 1) / _SPEEDS:
        try:
            speeds.append((float(rpm), _steady_mps(vessel, rpm)))
        except ModelRangeError:
            break
    return np.array(speeds).reshape(-1, 2)


def _reduce_helm_until_in_range(helm_deg: float, sail_test: Callable[[float], StandardTest]) -> StandardTest:
    """A test with the largest helm up to ``helm_deg`` at which the ship stays in the range of its model."""
    while True:
        try:
            return sail_test(helm_deg)
        except ModelRangeError:
            if helm_deg - _HELM_STEP_DEG < _LEAST_HELM_DEG:
                raise
            helm_deg -= _HELM_STEP_DEG


def _zigzag_within_range(ship: TrialShip, angle_deg: float, side: float) -> StandardTest:
    """A zigzag; the way to the first 10 deg of turn is an index of 10 deg of helm alone."""
    test = zigzag_test(ship, side, angle_deg, angle_deg)
    if angle_deg == _INITIAL_HELM_DEG:
        return test
    shown = {name: index for name, index in test.indices.items() if name != "initial_turning_m"}
    return replace(test, run=replace(test.run, indices=shown))


@dataclass(frozen=True, slots=True)
class TrialShip:
    """A ship as it sails tests: ``plant`` is what moves, ``vessel`` has the autopilot, which goes by ``pace``,
    ``drives`` are what the controls can do; the approach is at ``rpm``."""

    vessel: Vessel
    plant: Plant
    pace: manoeuvres.Pace
    drives: manoeuvres.Drives
    rpm: float

    @property
    def length_m(self) -> float:
        """The length between perpendiculars, with what effects make of it."""
        return self.plant.length_between_perpendiculars_m


def trial_ship_at_rpm(vessel: Vessel, rpm: float) -> TrialShip:
    """The ship of a vessel file, with its effects, at a shaft speed."""
    pace = manoeuvres.pace_of(vessel)
    return TrialShip(vessel, vessel_plant(vessel), pace, manoeuvres.drives_of(vessel, pace), rpm)


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


def ship_for_trials(vessel: Vessel, speed_mps: float | None = None, rpm: float | None = None) -> TrialShip:
    """The ship of a vessel file as it sails the standard manoeuvres.

    Its approach is at a speed through the water, else at a shaft speed, by default :data:`TEST_SHARE` of its
    shafts' limit. Raises as :func:`approach_at_speed`.
    """
    ship = trial_ship_at_rpm(vessel, manoeuvres.shaft_limit_rpm(vessel) * TEST_SHARE if rpm is None else rpm)
    return ship if speed_mps is None else approach_at_speed(ship, speed_mps)


def approach_at_speed(ship: TrialShip, speed_mps: float) -> TrialShip:
    """The ship with the shaft speed at which its approach has this speed through the water.

    Raises :class:`DataShortageError` where no shaft speed up to twice the shafts' limit gives it within 0.2 %, and
    :class:`ModelRangeError` where it is out of the range of its model.
    """
    if not speed_mps > 0.0:
        raise DataShortageError(f"no approach can be made at {speed_mps:.2f} m/s")
    mains = manoeuvres.handling_of(ship.vessel).main
    rps_per_rpm = float(control_units(ship.vessel.actuators)[mains][0])
    highest = _MOST_RPM * float(np.max(ship.drives.limit[mains])) / rps_per_rpm
    rpm = min(manoeuvres.usual_rpm(ship.vessel), highest)
    for _ in range(_MOST_APPROACHES):
        trial = without_shaft_limit(replace(ship, rpm=rpm))
        motion, start = sail_legs(trial, (manoeuvres.steer(0.0, inf, rpm),), 0.0)
        reached_mps = measures.approach_state(motion, start)["approach_mps"]
        if abs(reached_mps - speed_mps) <= _SAME_SPEED * speed_mps:
            return trial
        rpm = min(rpm * speed_mps / max(reached_mps, 1e-3 * speed_mps), highest)
    raise DataShortageError(
        f"the model makes no {speed_mps:.2f} m/s straight ahead",
        why=f"it makes {reached_mps:.2f} m/s at {trial.rpm:.4g} rpm",
    )


def without_shaft_limit(ship: TrialShip) -> TrialShip:
    """The ship with drives that turn as fast as is ordered."""
    handling = manoeuvres.handling_of(ship.vessel)
    ordered = np.abs(handling.orders(ship.rpm, 0.0)) * control_units(ship.vessel.actuators)
    limit = np.where(handling.main, np.maximum(ship.drives.limit, ordered), ship.drives.limit)
    return replace(ship, drives=ship.drives._replace(limit=limit))


def largest_helm_deg(ship: TrialShip) -> float:
    """The largest angle to which all that steers the ship goes [deg]; infinite where nothing limits it."""
    limits = (ship.drives.limit / control_units(ship.vessel.actuators))[
        manoeuvres.handling_of(ship.vessel).steering_angles
    ]
    return float(min(limits, default=inf))


def sail_legs(ship: TrialShip, legs: Sequence[manoeuvres.Leg], lengths: float) -> tuple[Motion, float]:
    """The motion of legs after an approach on a straight course, and the time of the execute [s].

    It takes so many ship lengths at the usual speed, or ends two steps after the last leg: by rounding that may be
    over a step before its test is.
    """
    approach_s = max(_LEAST_APPROACH_S, _APPROACH_LENGTHS * ship.pace.length_s)
    dt_s = _STEP_S * ship.pace.time
    steps = round((approach_s + lengths * ship.pace.length_s) / dt_s)
    approach, last = manoeuvres.steer(0.0, approach_s, ship.rpm), manoeuvres.Leg(rpm=0.0, at_most_s=2.0 * dt_s)
    still = np.random.default_rng(0)
    voyage = sail_through(
        ship.vessel, ship.plant, STILL, (approach, *legs, last), steps, dt_s, 0.0, still, still, ship.drives,
        repeat=False,
    )  # fmt: skip
    handling, states, rows = manoeuvres.handling_of(ship.vessel), voyage.states, len(voyage.states)
    names, controls = control_names(ship.vessel.actuators), voyage.controls / control_units(ship.vessel.actuators)
    helm_deg = controls @ handling.helm / (handling.helm @ handling.helm) if handling.helm.any() else np.zeros(rows)
    motion = Motion(
        origin_ns=0, time_s=np.arange(rows) * np.float64(dt_s), north_m=states[:, 0], east_m=states[:, 1],
        heading_deg=np.rad2deg(states[:, 2]), surge_mps=states[:, 3], sway_mps=states[:, 4],
        yaw_rate_dps=np.rad2deg(states[:, 5]), helm_deg=helm_deg, thrust=np.zeros(rows),
        drives={names[i]: controls[:, i] for i in np.flatnonzero(handling.main)}, tunnels={},
        measured=np.ones(rows, dtype=bool), broken=np.zeros(rows, dtype=bool),
    )  # fmt: skip
    return motion, float(np.ceil(approach_s / dt_s - 1e-9)) * dt_s


def _make_standard_test(
    kind: str, name: str, side: float, motion: Motion, executes_s: Sequence[float], values: Mapping[str, float],
    length_m: float, helm_deg: float = 0.0, **settings: float,
) -> StandardTest:  # fmt: skip
    """A test with the indices that are shown of its kind; what was not reached is left out.

    Raises :class:`DataShortageError` where the approach was not steady.
    """
    approach = measures.approach_state(motion, executes_s[0])
    circling_dps = float(np.rad2deg(approach["approach_mps"] / max(length_m, 1e-3)))
    if abs(approach["approach_yaw_rate_dps"]) > STEADY_SHARE * circling_dps:
        raise DataShortageError("the approach is not steady", why="the autopilot cannot keep the ship straight")
    indices = {
        name: index_from_value(name, float(values[name]), 0.0, length_m, kind)
        for name in TEST_INDICES[kind] if np.isfinite(values.get(name, nan))
    }  # fmt: skip
    run = Manoeuvre(
        kind, name, motion.utc(executes_s[0]), motion.utc(executes_s[-1]), side_of_sign(side) if side else "",
        {**({"rudder_deg": helm_deg} if helm_deg else {}), "approach_mps": approach["approach_mps"], **settings},
        indices,
    )  # fmt: skip
    return StandardTest(run, motion, np.array(executes_s))


def turning_circle_test(
    ship: TrialShip, side: float, helm_deg: float, turn_deg: float = _CIRCLE_DEG
) -> StandardTest:
    """A turning circle to a side, 1 for starboard and -1 for port, until the ship has turned by so much."""
    leg = manoeuvres.Leg(rpm=ship.rpm, helm_deg=-side * helm_deg, turn_deg=turn_deg)
    motion, start = sail_legs(ship, (leg,), _CIRCLE_LENGTHS)
    turned_rows = np.flatnonzero(side * (motion.heading_deg - motion.at("heading_deg", start)) >= turn_deg)
    motion = motion.rows(0, int(turned_rows[0]) + 1 if turned_rows.size else motion.time_s.size)
    end = float(motion.time_s[-1])
    values = kinds.circle_indices(motion, np.array([start, end]))
    if "tactical_diameter_m" not in values or values["tactical_diameter_m"] <= 0.0:
        raise DataShortageError(f"the ship does not turn to {side_of_sign(side)} by half a circle")
    name = f"turning circle {helm_deg:.0f} deg"
    return _make_standard_test("turning_circle", name, side, motion, (start, end), values, ship.length_m, helm_deg)


def zigzag_test(
    ship: TrialShip, side: float, helm_deg: float, switch_deg: float, swings: int = SWINGS
) -> StandardTest:
    """A zigzag about the heading that the autopilot holds in the approach, which need not be the one ordered."""
    standard_legs = manoeuvres.zigzag(-side * helm_deg, -side * switch_deg, ship.rpm, swings=swings)
    open_legs = [replace(leg, at_most_s=inf) for leg in standard_legs]
    approach, start = sail_legs(ship, open_legs[:1], 0.0)
    course_deg = approach.at("heading_deg", start)
    if abs(course_deg) >= switch_deg:
        raise DataShortageError(f"the autopilot holds the course only within {abs(course_deg):.0f} deg")
    legs = [replace(leg, deviation_deg=leg.deviation_deg + course_deg) for leg in open_legs]
    motion, start = sail_legs(ship, legs, _SWING_LENGTHS * swings)
    executes, towards = [start], side
    deviation_deg = motion.heading_deg - motion.at("heading_deg", start)
    for _ in range(swings):
        crossings = np.flatnonzero((towards * deviation_deg >= switch_deg) & (motion.time_s > executes[-1]))
        if not crossings.size:
            raise DataShortageError(f"the heading is not off by {switch_deg:g} deg after swing {len(executes)}")
        executes.append(float(motion.time_s[crossings[0]]))
        towards = -towards
    motion = motion.between(0.0, executes[-1])
    widest_deg = np.abs(motion.heading_deg[motion.time_s >= start] - course_deg).max()
    if widest_deg > _WIDEST_SWING_DEG:
        raise DataShortageError(f"the heading swings by {widest_deg:.0f} deg, which is no zigzag")
    values = kinds.zigzag_indices(motion, np.array([executes, executes]))
    name = f"zigzag {helm_deg:.0f}/{switch_deg:.0f}"
    return _make_standard_test(
        "zigzag", name, side, motion, executes, values, ship.length_m, helm_deg, switch_deg=switch_deg
    )


def pull_out_test(ship: TrialShip, side: float, helm_deg: float) -> StandardTest:
    """The helm put amidships out of a steady turn to a side. Raises :class:`DataShortageError` where the rate of
    turn does not settle."""
    turn_s = _TURN_LENGTHS * ship.pace.length_s
    legs = (manoeuvres.helm_leg(-side * helm_deg, ship.rpm, turn_s), manoeuvres.helm_leg(0.0, ship.rpm))
    motion, start = sail_legs(ship, legs, _TURN_LENGTHS + _PULL_LENGTHS)
    released, end = start + turn_s, float(motion.time_s[-1])
    values = kinds.pull_out_indices(motion, np.array([released, end]))
    if not values:
        raise DataShortageError("the rate of turn has not settled with the helm amidships")
    name = f"pull-out from {helm_deg:.0f} deg"
    return _make_standard_test(
        "pull_out", name, side, motion, (start, released, end), values, ship.length_m, helm_deg
    )


def stopping_test(
    ship: TrialShip, rpm: float, slower_mps: float = 0.0, name: str = criteria.FULL_ASTERN
) -> StandardTest:
    """The shafts ordered to another speed [rpm], astern or none, until the ship is as slow as that."""
    motion, start = sail_legs(ship, (manoeuvres.Leg(rpm=rpm, slower_mps=slower_mps),), _STOP_LENGTHS)
    stopped_rows = np.flatnonzero((motion.surge_mps <= slower_mps) & (motion.time_s > start))
    if not stopped_rows.size:
        raise DataShortageError(f"the ship does not stop within {_STOP_LENGTHS:g} lengths' time")
    end = float(motion.time_s[stopped_rows[0]])
    values = stopping_indices(motion, np.array([start, end]))
    return _make_standard_test(
        "stopping", name, 0.0, motion.between(0.0, end), (start, end), values, ship.length_m, thrust_rpm=rpm
    )
