"""How exact the reference model is granted to be: a small random body force, smooth in speeds and settings.

No reference model is exact. With the sensors' noise alone as the yardstick every trial would show a missing
effect. So the verdict grants the model an error of a stated share of the force range, of unknown shape: a Gaussian
process over speeds and thruster settings, by random Fourier features (Rahimi and Recht 2007). An effect counts
only for what such an error could not be.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numba import njit

from acquisition.core.arrays import Floats
from hybrid.diagnosis.log import Log
from hybrid.vessel.compiling import FAST, PHYSICS_STAMP, Record
from hybrid.vessel.plant import Plant, pack
from hybrid.vessel.thrusters import pod_force, port_pod, starboard_pod, tunnel_force

FEATURES = 200
"""So many a force: with 40 the tolerance is too poor a family, and every second trial shows a false effect."""

_SEED = 20260901
_LEAST_SHARE = 0.3


@dataclass(frozen=True, slots=True)
class ForceRange:
    """The range of the forces in a trial: along, across [N] and in yaw [N m]."""

    surge_n: float
    sway_n: float
    yaw_nm: float

    def as_array(self) -> Floats:
        """As [3]."""
        return np.array([self.surge_n, self.sway_n, self.yaw_nm])


def force_range(log: Log, plant: Plant, origin: Floats) -> ForceRange:
    """The largest forces (99 of 100 seconds are below) that pods and tunnel thruster exert in a trial.

    Sideways and in yaw at least a share of what the pods push ahead would make there: a trial of straight runs is
    no proof of a model that is exact across.
    """
    forces = _thruster_forces(pack(plant)[0], origin, log.controls.mean(axis=1))
    surge, sway, yaw = np.quantile(np.abs(forces), 0.99, axis=0)
    lever = max(abs(plant.port_x_m), abs(plant.starboard_x_m))
    sway = max(sway, _LEAST_SHARE * surge)
    return ForceRange(float(surge), float(sway), float(max(yaw, _LEAST_SHARE * surge * lever)))


def features(log: Log, origin: Floats, number: int = FEATURES) -> Floats:
    """Random Fourier features [T, number] of unit mean square, of speeds and thruster settings."""
    inputs = operating_point(log, origin)
    generator = np.random.default_rng(_SEED)
    frequency = generator.standard_normal((inputs.shape[1], number))
    phase = generator.uniform(0.0, 2.0 * np.pi, number)
    return np.asarray(np.sqrt(2.0) * np.cos(inputs @ frequency + phase))


def operating_point(log: Log, origin: Floats) -> Floats:
    """What a model error may depend on, each over its usual range: [T, 8].

    Surge, sway, yaw rate; the pods' thrust vectors, each by its square-law size along and across; the tunnel.
    """
    port, port_rad, starboard, starboard_rad, tunnel = log.controls.mean(axis=1).T
    push = [n * abs_n for n, abs_n in ((port, np.abs(port)), (starboard, np.abs(starboard)))]
    vectors = [push[0] * np.cos(port_rad), push[0] * np.sin(port_rad), push[1] * np.cos(starboard_rad)]
    vectors.append(push[1] * np.sin(starboard_rad))
    columns = np.column_stack([origin[:, 3:6], *vectors, tunnel * np.abs(tunnel)])
    scale = np.maximum(np.quantile(np.abs(columns), 0.95, axis=0), 1e-9)
    return np.asarray(columns / scale)


def _make(stamp: int) -> Callable[[Record, Floats, Floats], Floats]:
    @njit(cache=True, fastmath=FAST, error_model="numpy")
    def thruster_forces(p: Record, states: Floats, controls: Floats) -> Floats:
        """X [N], Y [N], N [N m] of pods and tunnel thruster in still water at each state and control: [T, 3]."""
        forces = np.full((len(states), 3), 0.0 * stamp)
        for k in range(len(states)):
            u, v, r = states[k, 3], states[k, 4], states[k, 5]
            X1, Y1, N1 = pod_force(p, port_pod(p, controls[k, 0], controls[k, 1]), u, v, r)
            X2, Y2, N2 = pod_force(p, starboard_pod(p, controls[k, 2], controls[k, 3]), u, v, r)
            side = tunnel_force(p, controls[k, 4])
            forces[k, 0], forces[k, 1], forces[k, 2] = X1 + X2, Y1 + Y2 + side, N1 + N2 + p.tunnel_x_m * side
        return forces

    return thruster_forces  # type: ignore[no-any-return]


_thruster_forces = _make(PHYSICS_STAMP)
