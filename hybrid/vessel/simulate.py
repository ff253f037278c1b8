"""Simulated runs: the compiled loop over steps, one vessel or a batch over all cores.

An extra force, for what no slot of a plant expresses, is a function of five arguments that numba compiles
and the loop calls: ``force(time_s, state, control, environment, parameters) -> (X [N], Y [N], N [N m])`` with
``state`` = (north [m], east [m], heading [rad], u, v [m/s], r [rad/s]) over ground, ``control`` an array of the
controls in SI, actuator by actuator in the order of the vessel file (R/V Gunnerus: port [rev/s], port angle [rad],
starboard [rev/s], starboard angle [rad], tunnel [rpm]), ``environment`` an
:class:`~seatrial.hybrid.vessel.dynamics.Environment` and ``parameters`` a float array.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numba import cfunc, float64, from_dtype, njit, prange, types
from numba.core.registry import CPUDispatcher
from numpy.typing import ArrayLike, NDArray

from seatrial.acquisition.core.errors import InputError, ModelRangeError
from seatrial.acquisition.core.quantities import Floats
from seatrial.analysis.compiling import FAST, Record, threads_for
from seatrial.hybrid.vessel.dynamics import Environment, advance, in_range, inverse_mass, lag_over, scratch_for
from seatrial.hybrid.vessel.plant import (
    PHYSICS_STAMP,
    ForceFunction,
    Plant,
    Plants,
    angles_in,
    controls_in,
    dtype_of,
    pack,
)
from seatrial.hybrid.vessel.sensors import acting_controls

LONGEST_STEP_S = 0.25
"""With this step a run of 30 s is within a tenth of a millimetre of the exact solution."""


def _make_run(stamp: int) -> Callable[..., int]:
    @njit(cache=True, nogil=True, fastmath=FAST, error_model="numpy")
    def run(
        p: Record, start: Floats, controls: Floats, wind: Floats, dt_s: float, substeps: int, acting_start: Floats,
        extra: ForceFunction | None, parameters: Floats, states: Floats,
    ) -> int:  # fmt: skip
        """Fill ``states`` [K+1, 6] and return the first step that ends out of range, or -1."""
        if stamp == 0:
            return -1
        mass, lag = inverse_mass(p), lag_over(p, dt_s / substeps)
        state = (start[0], start[1], start[2], start[3], start[4], start[5])
        acting, scratch = acting_start.copy(), scratch_for(p, acting_start)
        states[0] = start
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


run = _make_run(PHYSICS_STAMP)
run_all = _make_run_all(PHYSICS_STAMP)


@dataclass(frozen=True, slots=True)
class Runs:
    """A batch of simulated runs.

    ``states`` [N, K+1, 6] is NaN after the step in which a run left the range of the model;
    ``left_at`` [N] is the number of that step, -1 where the run stayed inside.
    """

    states: Floats
    left_at: NDArray[np.int64]

    @property
    def inside(self) -> NDArray[np.bool_]:
        """Which runs stayed in the range of the model [N]."""
        return np.asarray(self.left_at < 0)


def simulate_batch(
    plants: Plants,
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
    :data:`LONGEST_STEP_S`. ``acting_start`` [N, controls] are
    the controls that act at the start where the thrusters lag or have play; by default the first ones. Controls
    that a plant's ``command_delay_s`` says to be recorded late act earlier (:func:`acting_controls`).
    """
    packed = pack(plants)
    extra, parameters = combine_forces(plants)
    arrays = _inputs(controls_in(packed), start, _prompt(packed, controls, dt_s), wind, acting_start)
    number = max(len(packed), *(len(array) for array in arrays))
    _check_sizes(number, {"plants": len(packed)} | dict(zip(_NAMES, map(len, arrays), strict=True)))
    begin, control, air, acting = arrays
    states = np.empty((number, control.shape[1] + 1, 6))
    left_at = np.empty(number, dtype=np.int64)
    steps = substeps or steps_for(dt_s)
    kernel = run_all if number > 1 else _run_one
    with threads_for(number * control.shape[1] * steps):
        kernel(packed, begin, control, air, dt_s, steps, acting, extra, parameters, states, left_at)
    return Runs(states, left_at)


def simulate(
    plants: Plants,
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
    if not runs.inside.all():
        raise range_error(runs, plants, dt_s)
    single = np.ndim(controls) == 2 and len(runs.states) == 1
    return runs.states[0] if single else runs.states


def steps_for(dt_s: float) -> int:
    """How many substeps keep the integration step at or below :data:`LONGEST_STEP_S`."""
    return max(1, int(np.ceil(dt_s / LONGEST_STEP_S - 1e-9)))


def range_error(runs: Runs, plants: Plants, dt_s: float) -> ModelRangeError:
    """The error that tells which run left the model's range first, when, and at what speeds."""
    run_number = int(np.flatnonzero(~runs.inside)[0])
    step = int(runs.left_at[run_number])
    packed = pack(plants)
    p = packed[run_number % len(packed)]
    u, v, r = runs.states[run_number, step, 3:]
    return ModelRangeError(
        f"left the range of the model between {step * dt_s:g} and {(step + 1) * dt_s:g} s",
        where=f"run {run_number} of {len(runs.states)}",
        why=f"last inside at surge {u:.2f} m/s, sway {v:.2f} m/s, yaw rate {r:.3f} rad/s, and the "
        f"coefficients hold for surge {p['surge_low_mps']:g} to {p['surge_high_mps']:g} m/s, "
        f"sway within {p['sway_limit_mps']:g} m/s and yaw rate within {p['yaw_rate_limit_radps']:g} rad/s",
        fix="check the start and the controls, or widen [validity] in the vessel file if its data allow",
    )


_NAMES = ("start", "controls", "wind", "acting_start")


def _run_one(plants: Any, *arguments: Any) -> None:
    """One run without the cost of starting threads; arguments as those of the parallel kernel."""
    start, controls, wind, dt_s, substeps, acting, extra, parameters, states, left_at = arguments
    left_at[0] = run(
        plants[0], start[0], controls[0], wind[0], dt_s, substeps, acting[0], extra, parameters[0], states[0]
    )


def _prompt(plants: NDArray[np.void], controls: ArrayLike, dt_s: float) -> Floats:
    """Controls as they act, one series for all runs or, where plants differ in their delay, one a run."""
    control = _shaped(controls, 3, controls_in(plants), "controls")
    delay_s = plants["command_delay_s"]
    if (delay_s == delay_s[0]).all():
        return acting_controls(control, delay_s[0], dt_s, angles_in(plants))
    _check_sizes(max(len(plants), len(control)), {"plants": len(plants), "controls": len(control)})
    return acting_controls(control, delay_s, dt_s, angles_in(plants))


def _inputs(
    width: int, start: ArrayLike, controls: ArrayLike, wind: ArrayLike, acting_start: ArrayLike | None
) -> tuple[Floats, Floats, Floats, Floats]:
    control = _shaped(controls, 3, width, "controls")
    air = _shaped(wind, 3, 2, "wind")
    if control.shape[1] != air.shape[1]:
        raise InputError(f"controls have {control.shape[1]} steps and wind has {air.shape[1]}")
    if control.shape[1] == 0:
        raise InputError("there is no step to simulate", fix="give controls for one step or more")
    acting = control[:, 0] if acting_start is None else acting_start
    return _shaped(start, 2, 6, "start"), control, air, _shaped(acting, 2, width, "acting_start")


def _shaped(values: ArrayLike, dimensions: int, width: int, name: str) -> Floats:
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


_NONE = np.zeros((1, 1))


def combine_forces(plants: Plants) -> tuple[ForceFunction | None, Floats]:
    """One compiled force for all of ``plants`` and its parameters [P, Q], or ``None`` where none has any.

    A plant's parameters are, force by force, a switch (1 on, 0 off) and then the force's own, so that plants with
    and without can share a batch. Packed plants have none. Each distinct set of functions is compiled once a
    session, in half a second, and called through a pointer: compiled in, the loop would be a sixth faster and every
    session would first take 10 to 20 s over it, since numba's cache knows a function only as the object that it was
    then. After some fifty of them that cache fails altogether (numba issue 9348).
    """
    if isinstance(plants, np.ndarray):
        return None, _NONE
    batch: Sequence[Plant] = (plants,) if isinstance(plants, Plant) else plants
    sizes: dict[ForceFunction, int] = {}
    for plant in batch:
        for force in plant.forces:
            sizes.setdefault(force.function, len(force.parameters))
    if not sizes:
        return None, _NONE
    parameters = np.array([_row(plant, sizes) for plant in batch])
    return _chain(tuple(sizes.items()), len(batch[0].layout)), parameters


def _row(plant: Plant, sizes: dict[ForceFunction, int]) -> list[float]:
    by_function = {force.function: force.parameters for force in plant.forces}
    row: list[float] = []
    for function, size in sizes.items():
        row += [1.0, *by_function[function]] if function in by_function else [0.0] * (1 + size)
    return row


@lru_cache(maxsize=64)
def _chain(sizes: tuple[tuple[ForceFunction, int], ...], actuators: int) -> ForceFunction:
    """The sum of several forces, each with its slice of the parameters, for a ship with so many actuators."""
    total: Any = None
    first = 0
    for function, size in sizes:
        total = _added(total, _jitted(function), first, first + 1 + size)
        first += 1 + size
    surroundings = types.NamedTuple([float64] * 4 + [from_dtype(dtype_of(actuators))], Environment)
    numbers, state = float64[::1], types.UniTuple(float64, 6)
    signature = types.UniTuple(float64, 3)(float64, state, numbers, surroundings, numbers)
    return cfunc(signature, fastmath=FAST, error_model="numpy")(total)  # type: ignore[no-any-return]


def _jitted(function: ForceFunction) -> Any:
    if isinstance(function, CPUDispatcher):
        return function
    return njit(fastmath=FAST, error_model="numpy")(function)


def _added(before: Any, force: Any, switch: int, end: int) -> Any:
    def one(time_s, state, control, environment, parameters):  # type: ignore[no-untyped-def]
        if parameters[switch] == 0.0:
            return 0.0, 0.0, 0.0
        return force(time_s, state, control, environment, parameters[switch + 1 : end])

    if before is None:
        return one
    first, second = _jitted(before), _jitted(one)

    def both(time_s, state, control, environment, parameters):  # type: ignore[no-untyped-def]
        X, Y, N = first(time_s, state, control, environment, parameters)
        more_X, more_Y, more_N = second(time_s, state, control, environment, parameters)
        return X + more_X, Y + more_Y, N + more_N

    return both
