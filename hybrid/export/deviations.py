"""How far an exported model is off: the same turn and crash stop by the simulator and by what was exported.

A ship goes straight ahead at its usual shaft speed, then turns with 20 degrees of helm, less where it would leave
the range of its model, or reverses its shafts until it stops; in still water and air, with its drives. Times go
with those of the ship.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from seatrial.acquisition.core.errors import ConfigurationError, ModelRangeError
from seatrial.acquisition.core.quantities import Floats
from seatrial.hybrid.simulation import manoeuvres
from seatrial.hybrid.vessel import actuators, dynamics, files
from seatrial.hybrid.vessel.plant import Plant

_STEP_S, _APPROACH_S, _TURN_S, _STOP_S = 0.1, 5.0, 120.0, 240.0  # at R/V Gunnerus' pace
_HELMS_DEG = (20.0, 15.0, 10.0, 5.0)


@dataclass(frozen=True, slots=True, eq=False)
class StandardRun:
    """A run of the simulator in still air: ``orders`` [K, controls] in SI, ``states`` [K+1, 6], steps of ``dt_s``.

    The drives begin at the first orders.
    """

    name: str
    dt_s: float
    orders: Floats
    states: Floats
    length_m: float


@dataclass(frozen=True, slots=True)
class Deviation:
    """How far a run by an exported model is off: the largest distance, that in lengths, the largest angle."""

    run: str
    distance_m: float
    distance_lengths: float
    heading_deg: float

    def __str__(self) -> str:
        lengths = f"{self.distance_lengths:.2g} L" if self.distance_lengths >= 1e-4 else "below 0.0001 L"
        return f"{self.run}: at most {self.distance_m:.3g} m ({lengths}) and {self.heading_deg:.2g} deg off"


def standard_runs(vessel: files.Vessel, plant: Plant) -> list[StandardRun]:
    """The turn and the crash stop of a ship; without those that it cannot make in the range of its model."""
    try:
        handling, pace = manoeuvres.handling_of(vessel), manoeuvres.pace_of(vessel)
    except ConfigurationError:  # nothing drives it
        return []
    rpm, units = manoeuvres.usual_rpm(vessel), actuators.control_units(vessel.actuators)
    ahead = handling.orders(rpm, 0.0) * units
    start = np.array([0.0, 0.0, 0.0, manoeuvres.steady_speed_mps(plant, ahead), 0.0, 0.0])

    def sail(name: str, order: Floats, seconds: float) -> StandardRun:
        dt_s = _STEP_S * pace.time
        before, after = (round(part / _STEP_S) for part in (_APPROACH_S, seconds))
        orders = np.vstack([np.tile(ahead, (before, 1)), np.tile(order * units, (after, 1))])
        feedback = manoeuvres.response_of(manoeuvres.drives_of(vessel), orders, dt_s)
        runs = dynamics.simulate_batch(plant, start, feedback, np.zeros((len(orders), 2)), dt_s, substeps=1)
        states, left_at = runs.states[0], int(runs.left_at[0])
        stopped = np.flatnonzero(states[before:, 3] < 0.0)
        end = before + int(stopped[0]) if len(stopped) else len(orders)
        if 0 <= left_at < end:
            raise dynamics.range_error(runs, plant, dt_s)
        return StandardRun(name, dt_s, orders[:end], states[: end + 1], plant.length_between_perpendiculars_m)

    return [*_turning_runs(handling, rpm, sail), *_stopping_runs(handling, rpm, sail)]


def _turning_runs(
    handling: manoeuvres.Handling, rpm: float, sail: Callable[[str, Floats, float], StandardRun]
) -> list[StandardRun]:
    for helm_deg in _HELMS_DEG if handling.helm.any() else ():
        try:
            return [
                sail(
                    f"turn of {_TURN_S:.0f} s with {helm_deg:.0f} deg of helm",
                    handling.orders(rpm, helm_deg),
                    _TURN_S,
                )
            ]
        except ModelRangeError:
            continue
    return []


def _stopping_runs(
    handling: manoeuvres.Handling, rpm: float, sail: Callable[[str, Floats, float], StandardRun]
) -> list[StandardRun]:
    for share in (1.0, 0.5, 0.25):
        try:
            return [
                sail(f"crash stop at {share:.0%} of the shaft speed", handling.orders(-share * rpm, 0.0), _STOP_S)
            ]
        except ModelRangeError:
            continue
    return []


def deviations(runs: Sequence[StandardRun], tracks: Sequence[Floats]) -> list[Deviation]:
    """How far a model's runs, their states [K+1, 6], are from the simulator's."""
    result = []
    for run, states in zip(runs, tracks, strict=True):
        off = states - run.states
        distance = float(np.hypot(off[:, 0], off[:, 1]).max())
        heading_deg = float(np.degrees(np.abs(off[:, 2]).max()))
        result.append(Deviation(run.name, distance, distance / run.length_m, heading_deg))
    return result


def step_by_step(run: StandardRun, extra_states: int, step: Callable[[Floats, Floats], Floats]) -> Floats:
    """The states of a run by a model's ``step(state with the drives', orders)``."""
    state = np.concatenate([run.states[0], *[run.orders[0]] * (1 + extra_states)])
    states = [state[:6]]
    for orders in run.orders:
        state = np.asarray(step(state, orders)).ravel()
        states.append(state[:6])
    return np.array(states)
