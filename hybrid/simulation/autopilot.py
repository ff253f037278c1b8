"""The ship under way, compiled: an autopilot that follows legs, drives with limits, the simulated ship."""

from __future__ import annotations

from collections.abc import Callable
from math import exp, isnan, pi
from pathlib import Path
from typing import NamedTuple

from numba import njit

from acquisition.core.arrays import Floats
from hybrid.vessel.compiling import FAST, Record, compiled, source_stamp
from hybrid.vessel.dynamics import Control, State, advance, in_range, inverse_mass, lag_over
from hybrid.vessel.parameters import Vessel

STAMP = source_stamp(Path(__file__).parent, Path(__file__).parents[1] / "vessel")
STEER_GAIN, STEER_DAMPING_S, STEER_LIMIT_RAD = 0.8, 3.0, 25.0 * pi / 180.0
SETTLED_RAD, SETTLED_RADPS = 2.0 * pi / 180.0, 0.2 * pi / 180.0


class Drives(NamedTuple):
    """What the drives can do: limits [rev/s, rad/s, rpm] and time constants [s]."""

    shaft_limit_rps: float
    shaft_lag_s: float
    azimuth_rate_radps: float
    azimuth_lag_s: float
    tunnel_limit_rpm: float
    tunnel_lag_s: float


def drives_of(vessel: Vessel) -> Drives:
    """The drives of a vessel file."""
    pods, tunnel = vessel.pods, vessel.tunnel
    rate = pods.azimuth_rate_limit_dps * pi / 180.0
    shaft = pods.limit_rpm / 60.0, pods.shaft_lag_s
    return Drives(*shaft, rate, pods.azimuth_lag_s, tunnel.limit_rpm, tunnel.shaft_lag_s)


@compiled
def clipped(value: float, limit: float) -> float:
    """``value`` within ``limit`` either way."""
    return float(min(max(value, -limit), limit))


@compiled
def wrapped(angle_rad: float) -> float:
    """The same direction within half a turn of zero."""
    return float(angle_rad - 2.0 * pi * round(angle_rad / (2.0 * pi)))


@compiled
def followed(drives: Drives, now: Control, order: Control, dt_s: float) -> Control:
    """The drives a step later: first-order lags, azimuths no faster than they can, shafts within limits."""
    shaft = 1.0 - exp(-dt_s / drives.shaft_lag_s)
    azimuth = 1.0 - exp(-dt_s / drives.azimuth_lag_s)
    tunnel = 1.0 - exp(-dt_s / drives.tunnel_lag_s)
    fastest = drives.azimuth_rate_radps * dt_s
    port, port_rad, starboard, starboard_rad, tunnel_rpm = now
    return (
        port + shaft * (clipped(order[0], drives.shaft_limit_rps) - port),
        port_rad + clipped(azimuth * (order[1] - port_rad), fastest),
        starboard + shaft * (clipped(order[2], drives.shaft_limit_rps) - starboard),
        starboard_rad + clipped(azimuth * (order[3] - starboard_rad), fastest),
        tunnel_rpm + tunnel * (clipped(order[4], drives.tunnel_limit_rpm) - tunnel_rpm),
    )


@compiled
def ordered(leg: Floats, base_rad: float, heading_rad: float, yaw_rate_radps: float) -> Control:
    """The orders of a leg; where it steers, both azimuths answer course error and rate of turn."""
    port_rad, starboard_rad = leg[2], leg[3]
    if not isnan(leg[5]):
        error = wrapped(base_rad + leg[5] - heading_rad)
        # A positive azimuth turns the ship to port, so that the helm is opposite to the error.
        steered = clipped(STEER_DAMPING_S * yaw_rate_radps - STEER_GAIN * error, STEER_LIMIT_RAD)
        port_rad = starboard_rad = steered
    return leg[0], port_rad, leg[1], starboard_rad, leg[4]


@compiled
def ended(leg: Floats, state: State, base_rad: float, reference_rad: float, began: State, since_s: float) -> bool:
    """Whether a leg is over; see :class:`~hybrid.simulation.manoeuvres.Leg`."""
    _, _, heading, u, _, r = state
    course, settled, deviation, turn, slower, at_least, at_most = leg[5:12]
    if since_s >= at_most:
        return True
    if since_s < at_least:
        return False
    off = heading - reference_rad
    over = (deviation > 0.0 and off >= deviation) or (deviation < 0.0 and off <= deviation)
    if settled > 0.0 and abs(wrapped(base_rad + course - heading)) < SETTLED_RAD and abs(r) < SETTLED_RADPS:
        over = True
    return bool(over or abs(heading - began[2]) >= turn or u <= slower)  # comparisons with NaN are false


def _make_sail(stamp: int) -> Callable[..., int]:
    @njit(cache=True, nogil=True, fastmath=FAST, error_model="numpy")
    def sail(
        p: Record,
        start: Floats,
        legs: Floats,
        drives: Drives,
        wind: Floats,
        drift_n: Floats,
        dt_s: float,
        substeps: int,
        extra: Callable[..., tuple[float, float, float]] | None,
        parameters: Floats,
        states: Floats,
        controls: Floats,
    ) -> int:
        """Fill ``states`` [K+1, 6] and the drives' feedback ``controls`` [K+1, 5].

        Returns the first step that ends out of the model's range, or -1. Changes the drift force in ``p``.
        """
        if stamp == 0:
            return -1
        mass, lag = inverse_mass(p), lag_over(p, dt_s / substeps)
        state = (start[0], start[1], start[2], start[3], start[4], start[5])
        base = reference = start[2]
        number, leg, began, since_s = 0, legs[0], state, 0.0
        drive = ordered(leg, base, start[2], start[5])
        acting = drive
        states[0] = start
        for k in range(wind.shape[0]):
            if ended(leg, state, base, reference, began, since_s):
                number = (number + 1) % legs.shape[0]
                leg, began, since_s = legs[number], state, 0.0
            if not isnan(leg[5]):
                reference = state[2] + wrapped(base + leg[5] - state[2])
            for i in range(5):
                controls[k, i] = drive[i]
            p.drift_force_n = drift_n[k]
            air = (wind[k, 0], wind[k, 1])
            state, acting = advance(
                p, mass, lag, drive, acting, air, k * dt_s, dt_s, substeps, state, extra, parameters
            )
            drive = followed(drives, drive, ordered(leg, base, state[2], state[5]), dt_s)
            since_s += dt_s
            for i in range(6):
                states[k + 1, i] = state[i]
            if not in_range(p, state):
                return k
        for i in range(5):
            controls[wind.shape[0], i] = drive[i]
        return -1

    return sail  # type: ignore[no-any-return]


sail = _make_sail(STAMP)
