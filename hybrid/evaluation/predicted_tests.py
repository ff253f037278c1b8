"""A recorded test sailed anew by a model, as before a trial: the same approach speed, helm, helm rate, side and
switching angle, in still air.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from math import inf, isfinite

import numpy as np

from seatrial.acquisition.core.errors import DataShortageError
from seatrial.acquisition.core.quantities import to_ship
from seatrial.acquisition.core.ship import control_names
from seatrial.analysis.manoeuvres.indices import Manoeuvre
from seatrial.analysis.manoeuvres.kinds import REMOVED
from seatrial.analysis.manoeuvres.measures import approach_of, helm_rate_dps
from seatrial.hybrid.evaluation.recorded_runs import RecordedMotion, Water, at_order, final_speed_mps, with_water
from seatrial.hybrid.simulation.autopilot import drives_of
from seatrial.hybrid.simulation.handling import handling_of
from seatrial.hybrid.simulation.manoeuvres import steer
from seatrial.hybrid.simulation.standard_tests import (
    StandardTest,
    TrialShip,
    approach_at,
    as_fast_as_ordered,
    largest_helm_deg,
    pull_out,
    sailed,
    stop,
    turning_circle,
    with_helm_rate,
    zigzag_test,
)
from seatrial.hybrid.vessel.parameters import Vessel
from seatrial.hybrid.vessel.plant import Plant

APPROACH_RPM = "approach_rpm"
"""The mean shaft speed in the approach, as an index."""
_IDLE_SHARE = 0.08  # of the shaft speed before a stop: below it the shafts stand, as in finding one


@dataclass(frozen=True, slots=True)
class JudgedModel:
    """A model to be judged: its plant, and the vessel file with its autopilot and drives.

    Without a plant it makes no manoeuvre, without a vessel file it is replayed only; ``why`` says so.
    """

    plant: Plant | None
    vessel: Vessel | None
    why: str = ""


def predicted_indices(
    recorded: RecordedMotion, run: Manoeuvre, model: JudgedModel, water: Water | None
) -> Mapping[str, float]:
    """The indices of the test that a run was, made by a model in still air, and in the ``water`` of the run or
    its own.

    Where the current is removed from the indices of the run, in still water at its speed through the water. Raises
    :class:`DataShortageError` for a test that the model cannot make, :class:`ModelRangeError` where it leaves its
    range.
    """
    if model.plant is None or model.vessel is None:
        raise DataShortageError(model.why)
    if run.kind == "speed_run":
        return _speed_run(_ship_in(model.vessel, model.plant, (0.0, 0.0)), run)
    if recorded.motion.at("surge_mps", recorded.seconds(run.start)) <= 0.0:
        raise DataShortageError("the approach was not ahead")
    if any(name.endswith(REMOVED) for name in run.indices):
        speed_mps, current = at_order(run, water), (0.0, 0.0)
    else:
        own = model.plant.current_north_mps, model.plant.current_east_mps
        speed_mps, current = run.settings["approach_mps"], _off_the_approach(run, own if water is None else water)
    ship, rate_dps = _ship_in(model.vessel, model.plant, current), _helm_rate_dps(recorded, run)
    ship = with_helm_rate(ship, rate_dps) if isfinite(rate_dps) else ship
    if run.kind == "pull_out":  # its speed is that in the turn before, which is no approach
        return _values(_pull_out(_at_recorded_rpm(ship, run), run))
    ship, handling = approach_at(ship, speed_mps), handling_of(model.vessel)
    takes = {APPROACH_RPM: ship.rpm * float(handling.ahead[handling.main].mean())}
    return takes | _values(_TESTS[run.kind](ship, run))


def _values(test: StandardTest) -> dict[str, float]:
    return {name: index.value for name, index in test.indices.items()}


def _ship_in(vessel: Vessel, plant: Plant, water: Water) -> TrialShip:
    """A ship in water that moves so, without waves."""
    return TrialShip(vessel, with_water(plant, water).replaced(drift_force_n=0.0), drives_of(vessel), 0.0)


def _off_the_approach(run: Manoeuvre, water: Water) -> Water:
    """The water's velocity ahead and to starboard of the approach, which is to the north in a simulated test."""
    ahead, aside = to_ship(*water, np.deg2rad(run.settings["approach_heading_deg"]))
    return float(ahead), float(aside)


def _helm_rate_dps(recorded: RecordedMotion, run: Manoeuvre) -> float:
    """How fast the helm went over in a run [deg/s]; infinite where only orders were recorded."""
    motion = recorded.motion
    if motion.orders_are_events or run.helm_deg is None:
        return inf
    span = recorded.seconds(run.start), recorded.seconds(run.end)
    part = motion.around(*span, 2.0 * motion.step_s)
    return helm_rate_dps(part.helm_deg, part.step_s)


def _helm_of(ship: TrialShip, run: Manoeuvre) -> float:
    """The helm of a run [deg]. Raises :class:`DataShortageError` for one that was not recorded or is too large."""
    if not handling_of(ship.vessel).steering_angles.any():
        raise DataShortageError("the model is steered by the difference of its shafts, which has no angle of helm")
    if run.helm_deg is None:
        raise DataShortageError("the recording tells no angle of the helm")
    helm_deg, limit_deg = abs(run.helm_deg), largest_helm_deg(ship)
    if helm_deg > _SAME_HELM * limit_deg:
        raise DataShortageError(
            f"the helm of {helm_deg:.0f} deg is beyond the model's limit of {limit_deg:.0f} deg"
        )
    return helm_deg


def _circle(ship: TrialShip, run: Manoeuvre) -> StandardTest:
    return turning_circle(ship, run.sign, _helm_of(ship, run), max(run.settings["turned_deg"], _LEAST_TURN_DEG))


def _zigzag(ship: TrialShip, run: Manoeuvre) -> StandardTest:
    return zigzag_test(ship, run.sign, _helm_of(ship, run), run.settings["switch_deg"], int(run.settings["swings"]))


def _pull_out(ship: TrialShip, run: Manoeuvre) -> StandardTest:
    return pull_out(ship, run.sign, _helm_of(ship, run))


def _stop(ship: TrialShip, run: Manoeuvre) -> StandardTest:
    """The shafts ordered to the share of their speed before that they had in the run, or to none."""
    share = run.settings["thrust_rpm"] / run.settings["thrust_before_rpm"]
    return stop(ship, ship.rpm * share * (abs(share) > _IDLE_SHARE), final_speed_mps(run), run.name)


def _speed_run(ship: TrialShip, run: Manoeuvre) -> Mapping[str, float]:
    """The steady speed at the shaft speeds of a run."""
    ship = _at_recorded_rpm(ship, run)
    motion, _ = sailed(ship, (steer(0.0, inf, ship.rpm),), _SETTLING_LENGTHS)
    return {"speed_through_water_mps": approach_of(motion, float(motion.time_s[-1]))["approach_mps"]}


def _at_recorded_rpm(ship: TrialShip, run: Manoeuvre) -> TrialShip:
    """The ship at the mean shaft speed of a run."""
    names, handling = control_names(ship.vessel.actuators), handling_of(ship.vessel)
    rpm = [_shaft_rpm(run, names[i]) / handling.ahead[i] for i in np.flatnonzero(handling.main)]
    return as_fast_as_ordered(replace(ship, rpm=float(np.mean(rpm))))


def _shaft_rpm(run: Manoeuvre, name: str) -> float:
    """The speed of a shaft in a run, of a controllable propeller what it would turn at full pitch [rpm]."""
    for key in (name, f"{name.removesuffix('_rpm')}_at_full_pitch_rpm"):
        if key in run.settings:
            return run.settings[key]
    raise DataShortageError(f"{name} was not recorded")


_LEAST_TURN_DEG, _SETTLING_LENGTHS, _SAME_HELM = 185.0, 20.0, 1.05
_TESTS: dict[str, Callable[[TrialShip, Manoeuvre], StandardTest]] = {
    "turning_circle": _circle, "zigzag": _zigzag, "stopping": _stop,
}  # fmt: skip
PREDICTED_KINDS = (*_TESTS, "pull_out", "speed_run")
"""The kinds of manoeuvre that can be sailed anew."""
