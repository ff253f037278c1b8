"""The equation of motion (paper, eq. 2), its integration, and simulated runs of one vessel or a batch, compiled.

eta' = R(psi) nu and M nu_r' = tau(nu_r), with nu over ground in the state and nu_r through the water inside.
A steady current in the earth frame turns in the body frame as the ship turns, hence u' = u_r' + v_c r and
v' = v_r' - u_c r. Runge-Kutta of fourth order; whatever is constant in a step is worked out once, in
:class:`StepConstants`. The ship's actuators are rows of a table, gone through one by one, whatever their number and
kind.

An extra force, for what no slot of a plant expresses, is a function of five arguments that numba compiles and the
loop calls: ``force(time_s, state, control, environment, parameters) -> (X [N], Y [N], N [N m])`` with ``state`` =
(north [m], east [m], heading [rad], u, v [m/s], r [rad/s]) over ground, ``control`` an array of the controls in SI,
actuator by actuator in the order of the vessel file (R/V Gunnerus: port [rev/s], port angle [rad], starboard
[rev/s], starboard angle [rad], tunnel [rpm]), ``environment`` an :class:`Environment` and ``parameters`` a float
array.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import cos, exp, sin
from typing import Any, NamedTuple

import numpy as np
from numba import cfunc, float64, from_dtype, njit, prange, types
from numba.core.registry import CPUDispatcher
from numpy.typing import ArrayLike, NDArray

from seatrial.acquisition.core.errors import InputError, ModelRangeError
from seatrial.acquisition.core.quantities import Floats
from seatrial.analysis.compiling import FAST, Record, compiled, copy_row, threads_for
from seatrial.hybrid.vessel.actuators import (
    CONTROL,
    CONTROLS_OF,
    IS_ANGLE,
    KIND,
    LAG_COLUMN,
    PLAY_COLUMN,
    WORK_SIZE,
    actuator_force,
    control_units,
    fill_actuator_work,
    shaft_load,
    wrapped,
)
from seatrial.hybrid.vessel.black_box import BlackBox, simulate_black_box
from seatrial.hybrid.vessel.hulls import hull_force
from seatrial.hybrid.vessel.plant import (
    PHYSICS_STAMP,
    ForceFunction,
    Plant,
    Plants,
    angles_in,
    number_of_controls,
    pack,
    plant_dtype,
)
from seatrial.hybrid.vessel.sensors import acting_controls
from seatrial.hybrid.vessel.step_lengths import LONGEST_STEP_S
from seatrial.hybrid.vessel.wind import wind_force, wind_vector

FADING_S2PM2 = 5.0
"""Of low_speed_damping by the squared speed, as in Fossen's MSS toolbox (forceSurgeDamping.m, alpha = 5)."""
_NO_PARAMETERS = np.zeros((1, 1))

State = tuple[float, float, float, float, float, float]
"""north [m], east [m], heading [rad, unwrapped], u, v over ground [m/s], r [rad/s]."""

Control = Floats
"""The controls of all actuators in SI [controls], actuator by actuator in the order of the vessel's list."""


class Environment(NamedTuple):
    """What surrounds the ship, for extra forces: air and water velocity over ground [m/s], and the plant."""

    wind_north_mps: float
    wind_east_mps: float
    current_north_mps: float
    current_east_mps: float
    plant: Record


class StepConstants(NamedTuple):
    """What a step keeps constant: the controls, the actuators' working numbers, the air's motion."""

    control: Control
    work: Floats
    wind_north_mps: float
    wind_east_mps: float


class InverseMass(NamedTuple):
    """The inverse of M = [m - Xud, 0, 0; 0, m - Yvd, m x_G - Yrd; 0, m x_G - Yrd, I_G + m x_G^2 - Nrd]."""

    surge: float
    sway: float
    cross: float
    yaw: float


class Scratch(NamedTuple):
    """Room for a run's steps, so that none of them allocates: controls that act, and the working numbers.

    ``behind`` are the controls behind the play of their gears, which stay from step to step; ``loose`` tells
    whether there is any play.
    """

    control: Control
    work: Floats
    behind: Control
    loose: bool


class Lag(NamedTuple):
    """The share of the way to the order that each actuator's controls come in a step, on average and at its end."""

    present: bool
    mean: Floats
    end: Floats


@compiled
def inverse_mass(p: Record) -> InverseMass:
    """The inverse mass matrix of a plant, with added mass."""
    x_G = p.centre_of_gravity_m
    M22, M23 = p.mass_kg - p.Yvd, p.mass_kg * x_G - p.Yrd
    M33 = p.yaw_inertia_kgm2 + p.mass_kg * x_G * x_G - p.Nrd
    determinant = M22 * M33 - M23 * M23
    return InverseMass(1.0 / (p.mass_kg - p.Xud), M33 / determinant, -M23 / determinant, M22 / determinant)


@compiled
def scratch_for(p: Record, control: Control) -> Scratch:
    """Room for the steps of a run that begins with these controls acting."""
    loose = False
    for i in range(int(p.actuator_count)):
        loose = loose or play_of_control(p, i) > 0.0
    return Scratch(control.copy(), np.zeros((len(p.actuators), WORK_SIZE)), control.copy(), loose)


@compiled
def step_constants(
    p: Record, control: Control, work: Floats, wind_direction_rad: float, wind_speed_mps: float
) -> StepConstants:
    """What stays constant while ``control`` and the reported wind do; fills ``work``."""
    for i in range(int(p.actuator_count)):
        row = p.actuators[i]
        fill_actuator_work(p, row, control, int(row[CONTROL]), work[i])
    wind_north, wind_east = wind_vector(p, wind_direction_rad, wind_speed_mps)
    return StepConstants(control, work, wind_north, wind_east)


@compiled
def actuators_force(p: Record, work: Floats, u_r: float, v_r: float, r: float) -> tuple[float, float, float]:
    """Force and moment X [N], Y [N], N [N m] of all actuators as they are held, at speeds through the water."""
    X, Y, N = 0.0, 0.0, 0.0
    for i in range(int(p.actuator_count)):
        actuator_X, actuator_Y, actuator_N = actuator_force(p, i, work, u_r, v_r, r)
        X, Y, N = X + actuator_X, Y + actuator_Y, N + actuator_N
    return X, Y, N


@compiled
def water_force(p: Record, work: Floats, u_r: float, v_r: float, r: float) -> tuple[float, float, float]:
    """The calm water's force X [N], Y [N], N [N m] on hull and actuators, at speeds through the water."""
    X, Y, N = hull_force(p, u_r, v_r, r)
    slow_X, slow_Y, slow_N = low_speed_damping(p, u_r, v_r, r)
    actuators_X, actuators_Y, actuators_N = actuators_force(p, work, u_r, v_r, r)
    return X + (slow_X + actuators_X), Y + (slow_Y + actuators_Y), N + (slow_N + actuators_N)


@compiled
def total_force(
    p: Record, held: StepConstants, cosine: float, sine: float, u: float, v: float, r: float, u_c: float, v_c: float
) -> tuple[float, float, float]:
    """All forces on the ship X [N], Y [N], N [N m], given u, v, r over ground and the current u_c, v_c.

    All in body axes. The rigid body's Coriolis terms are among them.
    """
    u_r, v_r = u - u_c, v - v_c
    X, Y, N = water_force(p, held.work, u_r, v_r, r)
    u_air = held.wind_north_mps * cosine + held.wind_east_mps * sine
    v_air = held.wind_east_mps * cosine - held.wind_north_mps * sine
    wind_X, wind_Y, wind_N = wind_force(p, u - u_air, v - v_air)
    drift_X, drift_Y, drift_N = wave_drift_force(p, cosine, sine)
    arm = p.mass_kg * p.centre_of_gravity_m
    X += wind_X + drift_X + p.constant_X_n + p.mass_kg * v_r * r + arm * r * r
    Y += wind_Y + drift_Y + p.constant_Y_n - p.mass_kg * u_r * r
    N += wind_N + drift_N + p.constant_N_nm - arm * u_r * r
    return X, Y, N


@compiled
def state_rate(
    p: Record, mass: InverseMass, held: StepConstants, time_s: float, state: State, extra: ForceFunction | None,
    parameters: Floats,
) -> State:  # fmt: skip
    """The time derivative of the state. ``extra`` is called, or None and then not there at all."""
    _, _, psi, u, v, r = state
    cosine, sine = cos(psi), sin(psi)
    u_c = p.current_north_mps * cosine + p.current_east_mps * sine
    v_c = p.current_east_mps * cosine - p.current_north_mps * sine
    X, Y, N = total_force(p, held, cosine, sine, u, v, r, u_c, v_c)
    if extra is not None:
        surroundings = Environment(
            held.wind_north_mps, held.wind_east_mps, p.current_north_mps, p.current_east_mps, p
        )
        extra_X, extra_Y, extra_N = extra(time_s, state, held.control, surroundings, parameters)
        X, Y, N = X + extra_X, Y + extra_Y, N + extra_N
    return (
        u * cosine - v * sine,
        u * sine + v * cosine,
        r,
        mass.surge * X + v_c * r,
        mass.sway * Y + mass.cross * N - u_c * r,
        mass.cross * Y + mass.yaw * N,
    )


@compiled
def add_scaled(state: State, slope: State, dt_s: float) -> State:
    """``state + dt slope``."""
    n, e, p, u, v, r = state
    dn, de, dp, du, dv, dr = slope
    return n + dt_s * dn, e + dt_s * de, p + dt_s * dp, u + dt_s * du, v + dt_s * dv, r + dt_s * dr


@compiled
def runge_kutta(
    p: Record, mass: InverseMass, held: StepConstants, time_s: float, dt_s: float, state: State,
    extra: ForceFunction | None, parameters: Floats,
) -> State:  # fmt: skip
    """The state one classical Runge-Kutta step of fourth order later."""
    half = 0.5 * dt_s
    k1 = state_rate(p, mass, held, time_s, state, extra, parameters)
    k2 = state_rate(p, mass, held, time_s + half, add_scaled(state, k1, half), extra, parameters)
    k3 = state_rate(p, mass, held, time_s + half, add_scaled(state, k2, half), extra, parameters)
    k4 = state_rate(p, mass, held, time_s + dt_s, add_scaled(state, k3, dt_s), extra, parameters)
    state = add_scaled(state, k1, dt_s / 6.0)
    state = add_scaled(state, k2, dt_s / 3.0)
    state = add_scaled(state, k3, dt_s / 3.0)
    end: State = add_scaled(state, k4, dt_s / 6.0)
    return end


@compiled
def in_range(p: Record, state: State) -> bool:
    """Whether the speeds through the water are where the coefficients hold; NaN is not."""
    _, _, psi, u, v, r = state
    u_r = u - p.current_north_mps * cos(psi) - p.current_east_mps * sin(psi)
    v_r = v - p.current_east_mps * cos(psi) + p.current_north_mps * sin(psi)
    return bool(
        p.surge_low_mps <= u_r <= p.surge_high_mps
        and abs(v_r) <= p.sway_limit_mps
        and abs(r) <= p.yaw_rate_limit_radps
    )


@compiled
def move_towards_orders(p: Record, result: Control, acting: Control, order: Control, shares: Floats) -> None:
    """Fill ``result``: ``acting`` moved towards ``order`` by each actuator's share of the way; angles the shorter
    one.
    """
    for i in range(int(p.actuator_count)):
        kind, first = int(p.actuators[i, KIND]), int(p.actuators[i, CONTROL])
        for j in range(CONTROLS_OF[kind]):
            difference = order[first + j] - acting[first + j]
            if IS_ANGLE[kind, j]:
                difference = wrapped(difference)
            result[first + j] = acting[first + j] + shares[i] * difference


@compiled
def play_of_control(p: Record, i: int) -> float:
    """The play [rad] of one actuator's angle."""
    column = PLAY_COLUMN[int(p.actuators[i, KIND])]
    return float(p.actuators[i, column]) if column >= 0 else 0.0


@compiled
def take_up_play(p: Record, behind: Control, order: Control) -> None:
    """Move ``behind`` with ``order``: an angle with play no further than half of it away, all else to the order."""
    for i in range(int(p.actuator_count)):
        kind, first, half = int(p.actuators[i, KIND]), int(p.actuators[i, CONTROL]), 0.5 * play_of_control(p, i)
        for j in range(CONTROLS_OF[kind]):
            offset = 0.0
            if IS_ANGLE[kind, j]:
                offset = min(max(wrapped(behind[first + j] - order[first + j]), -half), half)
            behind[first + j] = order[first + j] + offset


@compiled
def lag_shares_over_step(p: Record, dt_s: float) -> Lag:
    """How far lagging actuators come in a step of ``dt_s``: all the way where the plant has no lag.

    The time constant of an actuator is that of all, and its own.
    """
    mean, end = np.ones(len(p.actuators)), np.ones(len(p.actuators))
    present = False
    for i in range(int(p.actuator_count)):
        column = LAG_COLUMN[int(p.actuators[i, KIND])]
        constant = p.thruster_lag_s + (p.actuators[i, column] if column >= 0 else 0.0)
        if constant > 0.0:
            present = True
            decay = exp(-dt_s / constant)
            mean[i], end[i] = 1.0 - constant / dt_s * (1.0 - decay), 1.0 - decay
    return Lag(present, mean, end)


@compiled
def advance(
    p: Record, mass: InverseMass, lag: Lag, order: Control, acting: Control, scratch: Scratch,
    air: tuple[float, float], time_s: float, dt_s: float, substeps: int, state: State,
    extra: ForceFunction | None, parameters: Floats,
) -> State:  # fmt: skip
    """The state one step of ``dt_s`` later; ``order`` and the reported wind hold meanwhile.

    Where a gear has play the order acts behind it. Lagging thrusters act with their exact average over each
    substep, and ``acting`` moves on; without a lag the order acts.
    """
    if scratch.loose:
        take_up_play(p, scratch.behind, order)
        order = scratch.behind
    direction_rad, speed_mps = air
    h = dt_s / substeps
    for j in range(substeps):
        if lag.present:
            move_towards_orders(p, scratch.control, acting, order, lag.mean)
            move_towards_orders(p, acting, acting, order, lag.end)
        if lag.present or j == 0:
            held = step_constants(
                p, scratch.control if lag.present else order, scratch.work, direction_rad, speed_mps
            )
        state = runge_kutta(p, mass, held, time_s + j * h, h, state, extra, parameters)
    return state


@compiled
def wave_drift_force(p: Record, cosine: float, sine: float) -> tuple[float, float, float]:
    """Mean second-order wave force X [N], Y [N], N [N m] at the heading with this cosine and sine.

    With b the angle from the bow to where the waves go, the force is 0.35 F cos b ahead and F sin b to
    starboard, its moment 0.06 Loa F sin 2b; F is the force in beam sea.
    """
    cos_b = p.drift_north * cosine + p.drift_east * sine
    sin_b = p.drift_east * cosine - p.drift_north * sine
    force: tuple[float, float, float] = wave_drift_at(p.drift_force_n, p.length_overall_m, cos_b, sin_b)
    return force


@compiled
def wave_drift_at(F: float, length: float, cos_b: float, sin_b: float) -> tuple[float, float, float]:
    """The same at the angle from the bow to where the waves go, by its cosine and sine."""
    return 0.35 * F * cos_b, F * sin_b, 0.12 * length * F * sin_b * cos_b


@compiled
def low_speed_damping(p: Record, u: float, v: float, r: float) -> tuple[float, float, float]:
    """Linear damping near rest X [N], Y [N], N [N m] at ``u, v`` [m/s] through the water and ``r`` [rad/s].

    Potential damping and laminar skin friction, which no hull model has, by the time constants at which surge, sway
    and yaw die out: Fossen, Handbook of Marine Craft Hydrodynamics and Motion Control, 2nd ed. (2021), ch. 6. The
    terms by squares of the speed have it in them already under way, so it fades as exp(-5 U^2).
    """
    if p.surge_damping_ps == 0.0 and p.sway_damping_ps == 0.0 and p.yaw_damping_ps == 0.0:
        return 0.0, 0.0, 0.0
    fading = exp(-FADING_S2PM2 * (u * u + v * v))
    x_G = p.centre_of_gravity_m
    yaw_inertia = p.yaw_inertia_kgm2 + p.mass_kg * x_G * x_G - p.Nrd
    return (
        -fading * p.surge_damping_ps * (p.mass_kg - p.Xud) * u,
        -fading * p.sway_damping_ps * (p.mass_kg - p.Yvd) * v,
        -fading * p.yaw_damping_ps * yaw_inertia * r,
    )


def _make_run(stamp: int) -> Callable[..., int]:
    @njit(cache=True, nogil=True, fastmath=FAST, error_model="numpy")
    def run(
        p: Record, start: Floats, controls: Floats, wind: Floats, dt_s: float, substeps: int, acting_start: Floats,
        extra: ForceFunction | None, parameters: Floats, states: Floats,
    ) -> int:  # fmt: skip
        """Fill ``states`` [K+1, 6] and return the first step that ends out of range, or -1."""
        if stamp == 0:
            return -1
        mass, lag = inverse_mass(p), lag_shares_over_step(p, dt_s / substeps)
        state = (start[0], start[1], start[2], start[3], start[4], start[5])
        acting, scratch = acting_start.copy(), scratch_for(p, acting_start)
        copy_row(states[0], start)
        for k in range(controls.shape[0]):
            air = (wind[k, 0], wind[k, 1])
            state = advance(
                p, mass, lag, controls[k], acting, scratch, air, k * dt_s, dt_s, substeps, state, extra, parameters
            )
            for i in range(6):
                states[k + 1, i] = state[i]
            if not in_range(p, state):
                states[k + 1 :] = np.nan
                return k
        return -1

    return run  # type: ignore[no-any-return]


def _make_run_all(stamp: int) -> Callable[..., None]:
    @njit(cache=True, parallel=True, fastmath=FAST, error_model="numpy")
    def run_all(
        plants: NDArray[np.void], start: Floats, controls: Floats, wind: Floats, dt_s: float, substeps: int,
        acting: Floats, extra: ForceFunction | None, parameters: Floats, states: Floats, left_at: NDArray[np.int64],
    ) -> None:  # fmt: skip
        """Every run of a batch; inputs with a first dimension of one serve all runs."""
        for i in prange(states.shape[0]):
            left_at[i] = run(
                plants[i % plants.shape[0]], start[i % start.shape[0]], controls[i % controls.shape[0]],
                wind[i % wind.shape[0]], dt_s, substeps, acting[i % acting.shape[0]], extra,
                parameters[i % parameters.shape[0]], states[i],
            )  # fmt: skip
        if stamp == 0:
            left_at[:] = -1

    return run_all  # type: ignore[no-any-return]


def _make_loads(stamp: int) -> Callable[..., None]:
    @njit(cache=True, nogil=True, fastmath=FAST, error_model="numpy")
    def loads(p: Record, speeds: Floats, controls: Floats, result: Floats) -> None:
        """Fill ``result`` [T, actuators, 2], row by row."""
        work = np.zeros((len(p.actuators), WORK_SIZE))
        for k in range(len(speeds)):
            u, v, r = speeds[k, 0], speeds[k, 1], speeds[k, 2]
            for i in range(int(p.actuator_count)):
                row = p.actuators[i]
                fill_actuator_work(p, row, controls[k], int(row[CONTROL]), work[i])
                result[k, i, 0], result[k, i, 1] = shaft_load(p, i, work, u, v, r)
        if stamp == 0:
            result[:] = np.nan

    return loads  # type: ignore[no-any-return]


run = _make_run(PHYSICS_STAMP)
run_all = _make_run_all(PHYSICS_STAMP)
_fill_loads = _make_loads(PHYSICS_STAMP)


def shaft_loads(plant: Plant, speeds: ArrayLike, controls: ArrayLike) -> Floats:
    """The thrust [N] and power [W] of each actuator's shaft [T, actuators, 2]; NaN of what no meter reads.

    ``speeds`` [T, 3] are surge, sway [m/s] through the water and yaw rate [rad/s], ``controls`` [T, controls] act.
    """
    velocity, control = (np.ascontiguousarray(values, dtype=np.float64) for values in (speeds, controls))
    result = np.empty((len(velocity), len(plant.layout), 2))
    _fill_loads(pack(plant)[0], velocity, control, result)
    return result


@dataclass(frozen=True, slots=True)
class Runs:
    """A batch of simulated runs.

    ``states`` [N, K+1, 6] is NaN after the step in which a run left the range of the model;
    ``left_at`` [N] is the number of that step, -1 where the run stayed inside.
    """

    states: Floats
    left_at: NDArray[np.int64]

    @property
    def in_range(self) -> NDArray[np.bool_]:
        """Which runs stayed in the range of the model [N]."""
        return np.asarray(self.left_at < 0)


def simulate_batch(
    plants: Plants | BlackBox,
    start: ArrayLike,
    controls: ArrayLike,
    wind: ArrayLike,
    dt_s: float,
    substeps: int | None = None,
    acting_start: ArrayLike | None = None,
) -> Runs:
    """Simulate N runs on all cores; runs that leave the range of the model are marked, not raised.

    ``plants`` is one plant, one a run, or an array of packed ones (:func:`~seatrial.hybrid.vessel.plant.pack`);
    ``start`` [N, 6] states; ``controls`` [N, K, controls] and ``wind`` [N, K, 2] (direction FROM [rad], speed
    [m/s]), as reported, held over each step of ``dt_s``. Every first dimension may be 1 or missing, then it
    serves all runs. Each step is integrated in ``substeps``, by default as many as keep them below
    :data:`.LONGEST_STEP_S`. ``acting_start`` [N, controls] are
    the controls that act at the start where the thrusters lag or have play; by default the first ones. Controls
    that a plant's ``command_delay_s`` says to be recorded late act earlier (:func:`acting_controls`).

    A simulator of another make steps as it does; ``substeps`` and ``acting_start`` are not for it.
    """
    if isinstance(plants, BlackBox):
        return _simulate_runs_of(plants, start, controls, wind, dt_s)
    packed = pack(plants)
    extra, parameters = combine_forces(plants)
    width = number_of_controls(packed)
    reported, delay_s = _broadcast_rows(controls, 3, width, "controls"), packed["command_delay_s"]
    if (delay_s == delay_s[0]).all():  # one series for all runs
        delay_s = delay_s[0]
    else:
        _check_sizes(max(len(packed), len(reported)), {"plants": len(packed), "controls": len(reported)})
    control = _broadcast_rows(acting_controls(reported, delay_s, dt_s, angles_in(packed)), 3, width, "controls")
    air = _broadcast_rows(wind, 3, 2, "wind")
    if control.shape[1] != air.shape[1]:
        raise InputError(f"controls have {control.shape[1]} steps and wind has {air.shape[1]}")
    if control.shape[1] == 0:
        raise InputError("there is no step to simulate", fix="give controls for one step or more")
    begin = _broadcast_rows(start, 2, 6, "start")
    acting = _broadcast_rows(control[:, 0] if acting_start is None else acting_start, 2, width, "acting_start")
    inputs = {"plants": packed, "start": begin, "controls": control, "wind": air, "acting_start": acting}
    sizes = {name: len(array) for name, array in inputs.items()}
    number = max(sizes.values())
    _check_sizes(number, sizes)
    states = np.empty((number, control.shape[1] + 1, 6))
    left_at = np.empty(number, dtype=np.int64)
    steps = substeps or max(1, int(np.ceil(dt_s / LONGEST_STEP_S - 1e-9)))
    with threads_for(number * control.shape[1] * steps):
        if number > 1:
            run_all(packed, begin, control, air, dt_s, steps, acting, extra, parameters, states, left_at)
        else:  # without the cost of starting threads
            left_at[0] = run(
                packed[0], begin[0], control[0], air[0], dt_s, steps, acting[0], extra, parameters[0], states[0]
            )
    return Runs(states, left_at)


def _simulate_runs_of(model: BlackBox, start: ArrayLike, controls: ArrayLike, wind: ArrayLike, dt_s: float) -> Runs:
    """Runs of a simulator of another make, inputs as in :func:`simulate_batch`."""
    control = _broadcast_rows(controls, 3, len(control_units(model.layout)), "controls")
    air, begin = _broadcast_rows(wind, 3, 2, "wind"), _broadcast_rows(start, 2, 6, "start")
    sizes = {"start": len(begin), "controls": len(control), "wind": len(air)}
    number = max(sizes.values())
    _check_sizes(number, sizes)
    begin, control, air = (
        np.ascontiguousarray(np.broadcast_to(values, (number, *values.shape[1:])))
        for values in (begin, control, air)
    )
    states = simulate_black_box(model, begin, control, air, dt_s)
    valid = np.asarray(np.isfinite(states[:, 1:]).all(axis=2))
    return Runs(states, np.where(valid.all(axis=1), -1, np.argmin(valid, axis=1)).astype(np.int64))


def simulate(
    plants: Plants | BlackBox,
    start: ArrayLike,
    controls: ArrayLike,
    wind: ArrayLike,
    dt_s: float,
    substeps: int | None = None,
    acting_start: ArrayLike | None = None,
) -> Floats:
    """The states [N, K+1, 6] of :func:`simulate_batch`, or [K+1, 6] where ``controls`` is [K, controls].

    Raises :class:`ModelRangeError` naming the first run, time and value out of range.
    """
    runs = simulate_batch(plants, start, controls, wind, dt_s, substeps, acting_start)
    if not runs.in_range.all():
        raise range_error(runs, plants, dt_s)
    single = np.ndim(controls) == 2 and len(runs.states) == 1
    return runs.states[0] if single else runs.states


def range_error(runs: Runs, plants: Plants | BlackBox, dt_s: float) -> ModelRangeError:
    """The error that tells which run left the model's range first, when, and at what speeds."""
    run_number = int(np.flatnonzero(~runs.in_range)[0])
    step = int(runs.left_at[run_number])
    if isinstance(plants, BlackBox):
        return ModelRangeError(
            f"returned no number between {step * dt_s:g} and {(step + 1) * dt_s:g} s",
            where=f"{plants.file}, run {run_number} of {len(runs.states)}",
            fix="check the start and the controls, and the simulator for such",
        )
    packed = pack(plants)
    plant = packed[run_number % len(packed)]
    u, v, r = runs.states[run_number, step, 3:]
    return ModelRangeError(
        f"left the range of the model between {step * dt_s:g} and {(step + 1) * dt_s:g} s",
        where=f"run {run_number} of {len(runs.states)}",
        why=f"last inside at surge {u:.2f} m/s, sway {v:.2f} m/s, yaw rate {r:.3f} rad/s, and the "
        f"coefficients hold for surge {plant['surge_low_mps']:g} to {plant['surge_high_mps']:g} m/s, "
        f"sway within {plant['sway_limit_mps']:g} m/s and yaw rate within {plant['yaw_rate_limit_radps']:g} rad/s",
        fix="check the start and the controls, or widen [validity] in the vessel file if its data allow",
    )


def _broadcast_rows(values: ArrayLike, dimensions: int, width: int, name: str) -> Floats:
    array = np.ascontiguousarray(values, dtype=np.float64)
    shape = array.shape
    if array.ndim == dimensions - 1:
        array = array[np.newaxis]
    if array.ndim != dimensions or array.shape[-1] != width:
        raise InputError(f"{name} has shape {shape}, the last dimension must be {width}")
    return array


def _check_sizes(number: int, sizes: dict[str, int]) -> None:
    wrong = [f"{name} {size}" for name, size in sizes.items() if size not in (1, number)]
    if wrong:
        raise InputError(f"{', '.join(wrong)} for {number} runs", fix="give one for all runs, or one for each")


def combine_forces(plants: Plants) -> tuple[ForceFunction | None, Floats]:
    """One compiled force for all of ``plants`` and its parameters [P, Q], or ``None`` where none has any.

    A plant's parameters are, force by force, a switch (1 on, 0 off) and then the force's own, so that plants with
    and without can share a batch. Packed plants have none. Each distinct set of functions is compiled once a
    session, in half a second, and called through a pointer: compiled in, the loop would be a sixth faster and every
    session would first take 10 to 20 s over it, since numba's cache knows a function only as the object that it was
    then. After some fifty of them that cache fails altogether (numba issue 9348).
    """
    if isinstance(plants, np.ndarray):
        return None, _NO_PARAMETERS
    batch: Sequence[Plant] = (plants,) if isinstance(plants, Plant) else plants
    sizes: dict[ForceFunction, int] = {}
    for plant in batch:
        for force in plant.forces:
            sizes.setdefault(force.function, len(force.parameters))
    if not sizes:
        return None, _NO_PARAMETERS
    rows: list[list[float]] = []
    for plant in batch:
        by_function = {force.function: force.parameters for force in plant.forces}
        rows.append([])
        for function, size in sizes.items():
            rows[-1] += [1.0, *by_function[function]] if function in by_function else [0.0] * (1 + size)
    return _chain_forces(tuple(sizes.items()), plant_dtype(len(batch[0].layout))), np.array(rows)


@lru_cache(maxsize=64)
def _chain_forces(sizes: tuple[tuple[ForceFunction, int], ...], record: np.dtype[np.void]) -> ForceFunction:
    """The sum of several forces, each with its slice of the parameters, for plants packed into such a record."""
    total: Any = None
    first = 0
    for function, size in sizes:
        total = _sum_of_forces(total, _compile_force(function), first, first + 1 + size)
        first += 1 + size
    surroundings = types.NamedTuple([float64] * 4 + [from_dtype(record)], Environment)
    numbers, state = float64[::1], types.UniTuple(float64, 6)
    signature = types.UniTuple(float64, 3)(float64, state, numbers, surroundings, numbers)
    return cfunc(signature, fastmath=FAST, error_model="numpy")(total)  # type: ignore[no-any-return]


def _compile_force(function: ForceFunction) -> Any:
    if isinstance(function, CPUDispatcher):
        return function
    return njit(fastmath=FAST, error_model="numpy")(function)


def _sum_of_forces(preceding: Any, force: Any, switch: int, end: int) -> Any:
    def switched(time_s, state, control, environment, parameters):  # type: ignore[no-untyped-def]
        if parameters[switch] == 0.0:
            return 0.0, 0.0, 0.0
        return force(time_s, state, control, environment, parameters[switch + 1 : end])

    if preceding is None:
        return switched
    first, second = _compile_force(preceding), _compile_force(switched)

    def summed(time_s, state, control, environment, parameters):  # type: ignore[no-untyped-def]
        X, Y, N = first(time_s, state, control, environment, parameters)
        second_X, second_Y, second_N = second(time_s, state, control, environment, parameters)
        return X + second_X, Y + second_Y, N + second_N

    return summed
