"""The ship under way, compiled: an autopilot that follows legs, drives with limits, the simulated ship.

Orders and controls are those of the vessel's list of actuators, in SI.
"""

from __future__ import annotations

from collections.abc import Callable
from math import exp, isnan, pi, radians
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numba import njit

from seatrial.acquisition.core.quantities import Floats
from seatrial.analysis.compiling import FAST, Record, compiled, source_stamp
from seatrial.hybrid.simulation.manoeuvres import ENDS, handling_of, pace_of
from seatrial.hybrid.vessel.actuators import KINDS, control_units, wrapped
from seatrial.hybrid.vessel.dynamics import Control, State, advance, in_range, inverse_mass, lag_over, scratch_for
from seatrial.hybrid.vessel.parameters import Vessel
from seatrial.hybrid.vessel.sensors import HEADING, YAW_RATE

STAMP = source_stamp(Path(__file__).parent, Path(__file__).parents[1] / "vessel")
STEER_GAIN, STEER_DAMPING_S, STEER_LIMIT_RAD = 0.8, 3.0, 25.0 * pi / 180.0
COURSE = ENDS.index("course")
SETTLED_RAD, SETTLED_RADPS = 2.0 * pi / 180.0, 0.2 * pi / 180.0


class Drives(NamedTuple):
    """What the drive of each control can do [controls]: time constant [s], limit of the order, limit of the rate.

    ``helm`` is how each control answers a radian of the autopilot's helm, positive turning the ship to port: 1 for
    the angle of a stern azimuth, -1 for one ahead and for a rudder, 0 for what does not steer, shaft speed [rev/s]
    for a ship that is steered by its difference. ``damping_s`` is the helm for a rate of turn, and
    ``settled_radps`` the rate of turn of a settled course.
    """

    lag_s: Floats
    limit: Floats
    rate: Floats
    helm: Floats
    damping_s: float
    settled_radps: float


def drives_of(vessel: Vessel) -> Drives:
    """The drives of a vessel file, and how the autopilot uses them: its times go with the ship's own."""
    pace = pace_of(vessel)
    helm = handling_of(vessel).helm * (control_units(vessel.actuators) / radians(1.0))
    drives = [drive for entry in vessel.actuator for drive in KINDS[entry.kind].drives(entry)]
    return Drives(
        np.array([drive.lag_s for drive in drives]),
        np.array([drive.limit for drive in drives]),
        np.array([drive.rate for drive in drives]),
        helm,
        STEER_DAMPING_S * pace.time,
        SETTLED_RADPS / pace.time,
    )


@compiled
def clip(value: float, limit: float) -> float:
    """``value`` within ``limit`` either way."""
    return float(min(max(value, -limit), limit))


@compiled
def shares(drives: Drives, dt_s: float) -> Control:
    """How much of the way to its order each control goes in a step, but for the limit of its rate."""
    fractions = np.ones(len(drives.lag_s))
    for i in range(len(fractions)):
        if drives.lag_s[i] > 0.0:
            fractions[i] = 1.0 - exp(-dt_s / drives.lag_s[i])
    return fractions


@compiled
def follow(drives: Drives, share: Control, feedback: Control, order: Control, dt_s: float) -> None:
    """Move the drives a step on: first-order lags, none faster than it can, orders within limits."""
    for i in range(len(feedback)):
        step = share[i] * (clip(order[i], drives.limit[i]) - feedback[i])
        feedback[i] += clip(step, drives.rate[i] * dt_s)


@compiled
def give_order(
    drives: Drives, leg: Floats, ends: Floats, base_rad: float, heading_rad: float, radps: float, order: Control
) -> None:
    """Fill ``order`` with a leg's; where it steers, helm that answers course error and rate of turn is added."""
    order[:] = leg
    if isnan(ends[COURSE]):
        return
    error = wrapped(base_rad + ends[COURSE] - heading_rad)
    # A positive helm turns the ship to port, so that it is opposite to the error.
    helm_rad = clip(drives.damping_s * radps - STEER_GAIN * error, STEER_LIMIT_RAD)
    for i in range(len(order)):
        order[i] += drives.helm[i] * helm_rad


@compiled
def leg_has_ended(
    settled_radps: float,
    ends: Floats,
    state: State,
    base_rad: float,
    reference_rad: float,
    initial: State,
    elapsed_s: float,
) -> bool:
    """Whether a leg is over; see :class:`~seatrial.hybrid.simulation.manoeuvres.Leg`."""
    _, _, heading, u, _, r = state
    course, settled, deviation, turn, slower, at_least_s, at_most_s = ends[:7]
    if elapsed_s >= at_most_s:
        return True
    if elapsed_s < at_least_s:
        return False
    deviation_rad = heading - reference_rad
    ended = (deviation > 0.0 and deviation_rad >= deviation) or (deviation < 0.0 and deviation_rad <= deviation)
    if settled > 0.0 and abs(wrapped(base_rad + course - heading)) < SETTLED_RAD and abs(r) < settled_radps:
        ended = True
    return bool(ended or abs(heading - initial[2]) >= turn or u <= slower)  # comparisons with NaN are false


def _make_sail(stamp: int) -> Callable[..., int]:
    @njit(cache=True, nogil=True, fastmath=FAST, error_model="numpy")
    def sail(
        p: Record, start: Floats, legs: Floats, ends: Floats, drives: Drives, wind: Floats, drift_n: Floats,
        dt_s: float, substeps: int, extra: Callable[..., tuple[float, float, float]] | None, parameters: Floats,
        states: Floats, controls: Floats,
    ) -> int:  # fmt: skip
        """Fill ``states`` [K+1, 6] and the drives' feedback ``controls`` [K+1, controls].

        ``legs`` [legs, controls] and ``ends`` [legs, 7] are the manoeuvre's. Returns the first step that ends out
        of the model's range, or -1. Changes the drift force in ``p``.
        """
        if stamp == 0:
            return -1
        mass, lag = inverse_mass(p), lag_over(p, dt_s / substeps)
        state = (start[0], start[1], start[2], start[3], start[4], start[5])
        base = reference = start[HEADING]
        number, initial, elapsed_s = 0, state, 0.0
        drive, share = np.empty(legs.shape[1]), shares(drives, dt_s)
        give_order(drives, legs[0], ends[0], base, start[HEADING], start[YAW_RATE], drive)
        acting, order, scratch = drive.copy(), drive.copy(), scratch_for(p, drive)
        states[0] = start
        for k in range(wind.shape[0]):
            if leg_has_ended(drives.settled_radps, ends[number], state, base, reference, initial, elapsed_s):
                number = (number + 1) % legs.shape[0]
                initial, elapsed_s = state, 0.0
            if not isnan(ends[number, COURSE]):
                reference = state[HEADING] + wrapped(base + ends[number, COURSE] - state[HEADING])
            controls[k] = drive
            p.drift_force_n = drift_n[k]
            air = (wind[k, 0], wind[k, 1])
            state = advance(
                p, mass, lag, drive, acting, scratch, air, k * dt_s, dt_s, substeps, state, extra, parameters
            )
            give_order(drives, legs[number], ends[number], base, state[HEADING], state[YAW_RATE], order)
            follow(drives, share, drive, order, dt_s)
            elapsed_s += dt_s
            for i in range(6):
                states[k + 1, i] = state[i]
            if not in_range(p, state):
                return k
        controls[wind.shape[0]] = drive
        return -1

    return sail  # type: ignore[no-any-return]


sail = _make_sail(STAMP)
