"""A ship in matrix form: M nu' + C(nu) nu + D(nu) nu = B f, as Fossen's MSS toolbox and Gazebo's plugins have it.

The forces of a ship are not of this form in general. A thruster's is here its pull at rest and what the speed ahead
takes from it. All else that the ship feels is fitted by least squares: terms of u, v, r up to third order, or
second for Gazebo, and for what steers ones of its angle with the squared speeds of ship and shaft. The fit is over
turns with several helms and speeds, straight runs, and situations around them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numba import njit

from seatrial.acquisition.core import ship
from seatrial.acquisition.core.quantities import Floats
from seatrial.hybrid.export.deviations import StandardRun
from seatrial.hybrid.simulation import manoeuvres
from seatrial.hybrid.vessel import dynamics
from seatrial.hybrid.vessel.actuators import CONTROL, KINDS, RPM_PER_RPS, WORK_SIZE, control_units
from seatrial.hybrid.vessel.files import Vessel
from seatrial.hybrid.vessel.plant import Plant, actuator_rows, pack

_ACROSS = ("v", "r", "uv", "ur", "v|v|", "v|r|", "r|v|", "r|r|")
_CUBIC = ("uuv", "uur", "vvv", "vvr", "vrr", "rrr")
SECOND_ORDER = {"X": ("u", "u|u|", "vv", "rr", "vr", "u|v|"), "Y": _ACROSS, "N": _ACROSS}
THIRD_ORDER = {
    "X": (*SECOND_ORDER["X"], "uvv", "uvr", "urr"), "Y": (*_ACROSS, *_CUBIC), "N": (*_ACROSS, *_CUBIC),
}  # fmt: skip
"""The terms of the force beside the thrusters', those of the added mass's Coriolis force among them."""

STEERING = ("uu", "nn", "nu")
"""The terms of an actuator's steering force: squared speed ahead, squared shaft speed, their product."""

_HELMS_DEG = (3.0, 6.0, 10.0, 15.0, 20.0, 30.0)
_TURN_STEPS, _TURN_STEP_S = 300, 0.4  # at R/V Gunnerus' pace
_STRAIGHT, _CLOUD, _SEED, _CLOUD_WEIGHT = 200, 3000, 5, 0.15


@dataclass(frozen=True, slots=True)
class Thruster:
    """An actuator in matrix form: where it is, and its force by its controls and the speed ahead.

    ``nn`` [N s^2] is the pull ahead at rest over the squared shaft speed [rev/s], ``nn_astern`` that astern, ``nu``
    [N s^2/m] what the speed ahead takes, ``nu_astern`` from a shaft astern, along ``direction`` (ahead, abeam or as
    its angle says; none of a rudder), times its pitch where it has one. ``control``, ``angle`` and ``pitch`` are
    the places of its first control, angle and pitch, -1 for none. ``steering`` are for X, Y, N the coefficients of
    :data:`STEERING`, of the sine of its angle, the speed ahead and the speed of the shaft ``shaft``.
    """

    name: str
    kind: str
    x_m: float
    y_m: float
    direction: str
    control: int
    shaft_per_unit: float
    nn: float = 0.0
    nn_astern: float = 0.0
    nu: float = 0.0
    nu_astern: float = 0.0
    shaft: int = -1
    angle: int = -1
    pitch: int = -1
    steering: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    def pull(self, controls: Floats, u: Any) -> tuple[Any, Any]:
        """The force ahead and to starboard [N] but for that of steering; ``controls`` [..., controls]."""
        if not self.direction:
            return 0.0, 0.0
        n = controls[..., self.control] * self.shaft_per_unit
        nn, nu = np.where(n >= 0.0, self.nn, self.nn_astern), np.where(n >= 0.0, self.nu, self.nu_astern)
        force = nn * n * abs(n) + nu * abs(n) * u
        if self.direction == "abeam":
            return 0.0 * force, force
        if self.pitch >= 0:
            force = force * controls[..., self.pitch]
        angle = controls[..., self.angle] if self.angle >= 0 else 0.0
        return force * np.cos(angle), force * np.sin(angle)

    def steering_terms(self, controls: Floats, u: Any, axis: str) -> dict[str, Any]:
        """The terms of its steering force: of the sine of its angle, squared for the force ahead."""
        sine = np.sin(controls[..., self.angle])
        n = abs(controls[..., self.shaft]) if self.shaft >= 0 else 0.0 * sine
        if self.kind == "rudder":  # no race astern
            n = np.maximum(controls[..., self.shaft], 0.0) if self.shaft >= 0 else n
        power = sine * sine if axis == "X" else sine
        return {"uu": u * abs(u) * power, "nn": n * n * power, "nu": n * u * power}


@dataclass(frozen=True, slots=True, eq=False)
class MatrixModel:
    """A ship in matrix form, SI and radians; forces and moment about the origin of the body axes.

    ``rigid`` and ``added`` are the mass matrices [3, 3], ``hull`` the coefficients of :data:`THIRD_ORDER`, ``fit``
    the root mean square of what the fit leaves, as a share of that of the force fitted, for X, Y, N.
    """

    rigid: Floats
    added: Floats
    centre_of_gravity_m: float
    mass_kg: float
    hull: Mapping[str, Mapping[str, float]]
    fit: tuple[float, float, float]
    thrusters: tuple[Thruster, ...]
    service_mps: float

    @property
    def mass(self) -> Floats:
        """The mass matrix M, the water's with it."""
        return np.asarray(self.rigid + self.added)

    def hull_force(self, u: float, v: float, r: float) -> Floats:
        """The hull's force X [N], Y [N], N [N m] at speeds through the water."""
        terms = hull_terms(u, v, r)
        return np.array([sum(value * terms[name] for name, value in self.hull[axis].items()) for axis in "XYN"])

    def linear_damping(self) -> Floats:
        """D at the service speed: minus the gradient of the hull's force there."""
        step, at = 1e-6, np.array([self.service_mps, 0.0, 0.0])
        columns = [
            (self.hull_force(*(at + step * axis)) - self.hull_force(*(at - step * axis))) / (2.0 * step)
            for axis in np.eye(3)
        ]
        return np.asarray(-np.array(columns).T)

    def linear_coriolis(self) -> Floats:
        """The rigid body's part that stands beside it, [0, 0, 0; 0, 0, m U; 0, 0, m x_G U]."""
        U, m = self.service_mps, self.mass_kg
        return np.array([[0.0, 0.0, 0.0], [0.0, 0.0, m * U], [0.0, 0.0, m * self.centre_of_gravity_m * U]])

    def rigid_coriolis(self, u: float, v: float, r: float) -> Floats:
        """C_RB(nu) [3, 3]."""
        arm = self.mass_kg * self.centre_of_gravity_m
        across, along = self.mass_kg * v + arm * r, self.mass_kg * u
        return np.array([[0.0, 0.0, -across], [0.0, 0.0, along], [across, -along, 0.0]])

    def thrust(self, controls: Floats, u: Any) -> Floats:
        """The force of all actuators X [N], Y [N], N [N m] at their controls in SI and a speed ahead: [..., 3]."""
        total = np.zeros((*np.shape(u), 3))
        for thruster in self.thrusters:
            X, Y = thruster.pull(controls, u)
            total += np.stack(np.broadcast_arrays(X, Y, thruster.x_m * Y - thruster.y_m * X), axis=-1)
            for place, axis in enumerate("XYN" if thruster.steering else ""):
                terms = thruster.steering_terms(controls, u, axis)
                total[..., place] += sum(value * terms[name] for name, value in thruster.steering[axis].items())
        return total

    def rate(self, state: Floats, controls: Floats) -> Floats:
        """The rate of change of the state [6] in still water and air."""
        _, _, psi, u, v, r = state
        nu = np.array([u, v, r])
        force = self.hull_force(u, v, r) + self.thrust(controls, u) - self.rigid_coriolis(u, v, r) @ nu
        cosine, sine = np.cos(psi), np.sin(psi)
        return np.array([u * cosine - v * sine, u * sine + v * cosine, r, *np.linalg.solve(self.mass, force)])


def hull_terms(u: Any, v: Any, r: Any) -> dict[str, Any]:
    """The terms of the hull's force by name."""
    return {
        "u": u, "v": v, "r": r, "u|u|": u * abs(u), "vv": v * v, "rr": r * r, "vr": v * r, "uv": u * v, "ur": u * r,
        "v|v|": v * abs(v), "v|r|": v * abs(r), "r|v|": r * abs(v), "r|r|": r * abs(r),
        "u|v|": u * abs(v), "uvv": u * v * v, "uvr": u * v * r, "urr": u * r * r, "uuv": u * u * v,
        "uur": u * u * r,
        "vvv": v * v * v, "vvr": v * v * r, "vrr": v * r * r, "rrr": r * r * r,
    }  # fmt: skip


@njit(error_model="numpy")
def _water_forces(p, controls, speeds):  # type: ignore[no-untyped-def]
    """The water's force [K, 3] on hull and actuators at controls [K, controls] and speeds through it [K, 3]."""
    forces = np.empty_like(speeds)
    work = np.zeros((len(p.actuators), WORK_SIZE))
    for k in range(len(speeds)):
        u, v, r = speeds[k]
        held = dynamics.step_constants(p, controls[k], work, 0.0, 0.0)
        forces[k, 0], forces[k, 1], forces[k, 2] = dynamics.water_force(p, held.work, u, v, r)
    return forces


def matrix_model(
    vessel: Vessel,
    plant: Plant,
    terms: Mapping[str, Sequence[str]] = THIRD_ORDER,
    steering_by_kind: Mapping[str, Sequence[str]] | None = None,
) -> MatrixModel:
    """The ship in matrix form, with the terms that the target has; those of steering by the kind of actuator.

    With ``steering_by_kind`` a thruster's force is the squared shaft speed alone, as it is at the service speed.

    Raises :class:`ConfigurationError` for a ship that nothing drives, :class:`ModelRangeError` for one that leaves
    the range of its model straight ahead.
    """
    x_G, m = plant.centre_of_gravity_m, plant.mass_kg
    rigid = np.array([[m, 0.0, 0.0], [0.0, m, m * x_G], [0.0, m * x_G, plant.yaw_inertia_kgm2 + m * x_G**2]])
    added = -np.array([[plant.Xud, 0.0, 0.0], [0.0, plant.Yvd, plant.Yrd], [0.0, plant.Yrd, plant.Nrd]])
    ahead = manoeuvres.handling_of(vessel).orders(manoeuvres.usual_rpm(vessel), 0.0) * control_units(
        vessel.actuators
    )
    service = manoeuvres.steady_speed_mps(plant, ahead)
    thrusters = tuple(_thrusters(vessel, plant, ahead, service))
    if steering_by_kind is not None:
        shafts = [
            abs(ahead[thruster.control]) * thruster.shaft_per_unit * bool(thruster.direction)
            for thruster in thrusters
        ]
        thrusters = tuple(
            replace(
                thruster, nn=float(thruster.nn + (thruster.nu * service / n if n else 0.0)), nu=0.0, nu_astern=0.0
            )
            for thruster, n in zip(thrusters, shafts, strict=True)
        )
    model = MatrixModel(rigid, added, x_G, m, {}, (0.0, 0.0, 0.0), thrusters, service)
    speeds, controls, weights = _situations(vessel, plant, service)
    forces = _water_forces(pack(plant)[0], controls, speeds) - model.thrust(controls, speeds[:, 0])
    values, fitted, left = hull_terms(*speeds.T), dict[str, dict[str, float]](), []
    steering = [dict[str, dict[str, float]]() for _ in thrusters]
    for axis, force in zip("XYN", forces.T, strict=True):
        steered = [
            {
                name: value
                for name, value in thruster.steering_terms(controls, speeds[:, 0], axis).items()
                if steering_by_kind is None or name in steering_by_kind.get(thruster.kind, ())
            }
            if thruster.angle >= 0
            else {}
            for thruster in thrusters
        ]
        basis = np.column_stack(
            [*(values[name] for name in terms[axis]), *(c for s in steered for c in s.values())]
        )
        scale = np.maximum(np.abs(basis).max(axis=0), 1e-300)
        solved = np.linalg.lstsq(basis / scale * weights[:, None], force * weights, rcond=1e-9)[0] / scale
        numbers = iter(solved.tolist())
        fitted[axis] = {name: next(numbers) for name in terms[axis]}
        for coefficients, names in zip(steering, steered, strict=True):
            coefficients |= {axis: {name: next(numbers) for name in names}} if names else {}
        size = float(np.sqrt(np.mean((force * weights) ** 2)))
        residual = float(np.sqrt(np.mean(((force - basis @ solved) * weights) ** 2)))
        left.append(residual / size if size > 0.0 else 0.0)
    steered_ship = tuple(
        replace(thruster, steering=coefficients) for thruster, coefficients in zip(thrusters, steering, strict=True)
    )
    return replace(model, hull=fitted, fit=(left[0], left[1], left[2]), thrusters=steered_ship)


def _situations(vessel: Vessel, plant: Plant, service: float) -> tuple[Floats, Floats, Floats]:
    """Speeds [K, 3] and controls [K, controls]: turns to both sides, straight runs, others around; weights."""
    handling, units = manoeuvres.handling_of(vessel), control_units(vessel.actuators)
    rpm, dt_s = manoeuvres.usual_rpm(vessel), _TURN_STEP_S * manoeuvres.pace_of(vessel).time
    drives = manoeuvres.drives_of(vessel)
    orders = np.array([handling.orders(share * rpm, side * helm) * units
                       for share in (1.0, 0.6) for helm in _HELMS_DEG for side in (1.0, -1.0)])  # fmt: skip
    orders = np.clip(orders, -drives.limit, drives.limit)
    controls = np.repeat(orders[:, None], _TURN_STEPS, axis=1)
    start = [0.0, 0.0, 0.0, service, 0.0, 0.0]
    runs = dynamics.simulate_batch(plant, start, controls, np.zeros((1, _TURN_STEPS, 2)), dt_s)
    turning, turned = runs.states[:, :-1:4, 3:].reshape(-1, 3), controls[:, ::4].reshape(-1, orders.shape[1])
    inside = np.isfinite(turning).all(axis=1)
    turning, turned = turning[inside], turned[inside]
    straight = np.zeros((_STRAIGHT, 3))
    straight[:, 0] = np.linspace(
        max(-0.3 * service, plant.surge_low_mps), min(1.2 * service, plant.surge_high_mps), _STRAIGHT
    )
    random = np.random.default_rng(_SEED)
    cloud = random.uniform(-1.0, 1.0, (_CLOUD, 3)) * np.abs(turning).max(axis=0)
    cloud[:, 0] = random.uniform(0.1, 1.1, _CLOUD) * service
    cloud[:, 1:] *= cloud[:, :1] / service
    amidships = np.tile(handling.orders(rpm, 0.0) * units, (_STRAIGHT, 1))
    weights = np.concatenate([np.ones(len(turning)), np.full(_STRAIGHT, 2.0), np.full(_CLOUD, _CLOUD_WEIGHT)])
    helms = orders[random.integers(0, len(orders), _CLOUD)]
    return np.vstack([turning, straight, cloud]), np.vstack([turned, amidships, helms]), weights


def _thrusters(vessel: Vessel, plant: Plant, ahead: Floats, service: float) -> list[Thruster]:
    packed, result = pack(plant), []
    starts = {actuator.name: int(row[CONTROL])
              for actuator, row in zip(vessel.actuators, actuator_rows(packed), strict=True)}  # fmt: skip

    def force(u: float, **controls: float) -> Floats:
        """The water's force at a speed ahead, the actuators at rest but for these controls, by place."""
        orders = np.zeros((1, len(ahead)))
        for place, value in controls.items():
            orders[0, int(place[1:])] = value
        return np.asarray(_water_forces(packed[0], orders, np.array([[u, 0.0, 0.0]]))[0])

    for entry in vessel.actuator:
        first, names = starts[entry.name], plant.form.places
        x_m, y_m = (float(plant.number(f"{entry.name}_{axis}")) if f"{entry.name}_{axis}" in names else 0.0
                    for axis in ("x_m", "y_m"))  # fmt: skip
        if entry.kind == "rudder":
            behind = getattr(entry, "behind", "")
            shaft = starts[behind] if behind else -1
            result.append(Thruster(entry.name, entry.kind, x_m, y_m, "", first, 1.0, shaft=shaft, angle=first))
            continue
        kind = KINDS[entry.kind]
        per_unit = 1.0 if kind.labels[0] == "rps" else 1.0 / RPM_PER_RPS
        angle = first + kind.angles.index(True) if any(kind.angles) else -1
        pitch = first + kind.labels.index("pitch") if "pitch" in kind.labels else -1
        direction = "angle" if angle >= 0 else "ahead" if ship.KINDS[entry.kind].drives else "abeam"
        axis = 1 if direction == "abeam" else 0
        n = abs(ahead[first]) * per_unit or float(getattr(entry, "limit_rpm", RPM_PER_RPS)) / RPM_PER_RPS
        full_pitch = {f"c{pitch}": 1.0} if pitch >= 0 else {}

        def pull(turns: float, u: float, place: int = first, unit: float = per_unit, axis: int = axis,
                 pitch: Mapping[str, float] = full_pitch) -> float:  # fmt: skip
            return float((force(u, **{f"c{place}": turns / unit}, **pitch) - force(u, **pitch))[axis])

        rest, astern = pull(n, 0.0), pull(-n, 0.0)
        slopes = [
            (pull(turns, u) - still) / (n * u)
            for turns, u, still in ((n, service, rest), (-n, 0.5 * service, astern))
        ]
        result.append(
            Thruster(
                entry.name, entry.kind, x_m, y_m, direction, first, per_unit, float(rest / n**2),
                float(-astern / n**2), float(slopes[0]), float(slopes[1]), first if angle >= 0 else -1,
                angle, pitch,
            )
        )  # fmt: skip
    return result


def sail(model_rate: Callable[[Floats, Floats], Floats], feedback: Floats, run: StandardRun) -> Floats:
    """The states [K+1, 6] of a run by a rate of change, with the drives' feedback [K, controls]."""
    states = [run.states[0]]
    h = run.dt_s
    for controls in feedback:
        x = states[-1]
        k1 = model_rate(x, controls)
        k2 = model_rate(x + 0.5 * h * k1, controls)
        k3 = model_rate(x + 0.5 * h * k2, controls)
        k4 = model_rate(x + h * k3, controls)
        states.append(x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4))
    return np.array(states)


def track_of_matrices(vessel: Vessel, model: MatrixModel, run: StandardRun) -> Floats:
    """The states [K+1, 6] of a run by the matrix form, with the drives of the simulator."""
    feedback = manoeuvres.response_of(manoeuvres.drives_of(vessel), run.orders, run.dt_s)
    return sail(model.rate, feedback, run)
