"""The standard manoeuvres of a vessel file on the simulator, in still water and air, beside IMO's limits.

Turning circles to both sides, zigzags 10/10 and 20/20, pull-outs, a crash stop
(:mod:`seatrial.hybrid.simulation.standard_tests`), and the steady speed over the shaft speed. The criteria are
judged by the functions that judge those of recordings.

The test speed is the one at 85 % of the propellers' highest power, taken as the cube of the shaft speed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, ClassVar

import numpy as np

from seatrial.acquisition.config.conditions import Conditions
from seatrial.acquisition.core.errors import DataShortageError, ModelRangeError
from seatrial.acquisition.core.quantities import Floats
from seatrial.acquisition.core.result import Result
from seatrial.analysis.manoeuvres.criteria import (
    TURNING_HELM_DEG,
    CriterionResult,
    add_limits,
    criteria_of,
    index_rows,
)
from seatrial.hybrid.effects import vessel_plant
from seatrial.hybrid.simulation.handling import handling_of, shaft_limit_rpm, steady_speed_mps
from seatrial.hybrid.simulation.standard_tests import (
    StandardTest,
    TrialShip,
    largest_helm_deg,
    pull_out,
    ship_at,
    stop,
    turning_circle,
    zigzag_test,
)
from seatrial.hybrid.vessel.actuators import control_units
from seatrial.hybrid.vessel.parameters import Vessel

TEST_SHARE = 0.85 ** (1.0 / 3.0)
"""The shaft speed of the tests, of its limit."""

COURSE_STABLE_SHARE = 0.02
"""A rate of turn that is left with the helm amidships, of that of the turn before: less is none."""

_INITIAL_HELM_DEG = 10.0
_PULL_OUT_DEG, _HELM_STEP_DEG, _LEAST_HELM_DEG = 20.0, 5.0, 5.0
_SPEEDS = 10
_DEEP_DRAUGHTS = 100.0


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
    view: ClassVar[str] = "seatrial.hybrid.report.vessel_check:vessel_check_view"
    drawing: ClassVar[str] = "seatrial.hybrid.report.vessel_check:draw_vessel_check"
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
    ship = ship_at(vessel, test_rpm)
    trials: dict[str, Callable[[], StandardTest]] = {
        **{f"turning circle to {name}": partial(_turning_circle, ship, side) for name, side in sides},
        **{
            f"zigzag {angle:.0f}/{angle:.0f} to {name}": partial(_zigzag, ship, angle, side)
            for angle in (_INITIAL_HELM_DEG, 20.0)
            for name, side in sides
        },
        **{f"pull-out from {name}": partial(_pull_out, ship, side) for name, side in sides},
        "crash stop": partial(stop, ship, -test_rpm),
    }
    speed_mps = _test_speed_mps(vessel, test_rpm)
    made, left_out = _made(trials)
    judged = add_limits(
        (test.run for test in made), conditions_of(ship, _test_speed_mps(vessel, limit * TEST_SHARE))
    )
    tests = tuple(replace(test, run=run) for test, run in zip(made, judged, strict=True))
    return VesselCheck(vessel.name, ship.length_m, test_rpm, speed_mps, _speeds(vessel, limit), tests, left_out)


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


def _made(trials: Mapping[str, Callable[[], StandardTest]]) -> tuple[tuple[StandardTest, ...], dict[str, str]]:
    """The tests that can be made, and why the others cannot."""
    made, left_out = [], {}
    for name, make in trials.items():
        try:
            made.append(make())
        except (ModelRangeError, DataShortageError) as error:
            left_out[name] = f"{error.what}{': ' * bool(error.why)}{error.why}"
    return tuple(made), left_out


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


def _within_range(helm_deg: float, sailed: Callable[[float], StandardTest]) -> StandardTest:
    """A test with the largest helm up to ``helm_deg`` at which the ship stays in the range of her model."""
    while True:
        try:
            return sailed(helm_deg)
        except ModelRangeError:
            if helm_deg - _HELM_STEP_DEG < _LEAST_HELM_DEG:
                raise
            helm_deg -= _HELM_STEP_DEG


def _turning_circle(ship: TrialShip, side: float) -> StandardTest:
    return _within_range(min(TURNING_HELM_DEG, largest_helm_deg(ship)), partial(turning_circle, ship, side))


def _zigzag(ship: TrialShip, angle_deg: float, side: float) -> StandardTest:
    """A zigzag; the way to the first 10 deg of turn is an index of 10 deg of helm alone."""
    test = zigzag_test(ship, side, angle_deg, angle_deg)
    if angle_deg == _INITIAL_HELM_DEG:
        return test
    shown = {name: index for name, index in test.indices.items() if name != "initial_turning_m"}
    return replace(test, run=replace(test.run, indices=shown))


def _pull_out(ship: TrialShip, side: float) -> StandardTest:
    return _within_range(min(_PULL_OUT_DEG, largest_helm_deg(ship)), partial(pull_out, ship, side))
