"""Forces that no slot of a plant expresses, put together into one function for the compiled loop.

Each distinct set of force functions is compiled once a session, in half a second; a plant that lacks one of
the set's forces has it switched off in its parameters, so that plants with and without can share a batch. The
loop calls it through a pointer: compiled in, the loop would be a sixth faster and every session would first take
10 to 20 s over it, since numba's cache knows a function only as the object that it was then. After some fifty
of them that cache fails altogether (numba issue 9348).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from numba import cfunc, float64, from_dtype, njit, types
from numba.core.registry import CPUDispatcher

from acquisition.core.arrays import Floats
from analysis.compiling import FAST
from hybrid.vessel.dynamics import Environment
from hybrid.vessel.plant import ForceFunction, Plant, Plants, dtype_of

_NONE = np.zeros((1, 1))


def combine_forces(plants: Plants) -> tuple[ForceFunction | None, Floats]:
    """One compiled force for all of ``plants`` and its parameters [P, Q], or ``None`` where none has any.

    A plant's parameters are, force by force, a switch (1 on, 0 off) and then the force's own. Packed plants
    have none.
    """
    if isinstance(plants, np.ndarray):
        return None, _NONE
    each: Sequence[Plant] = (plants,) if isinstance(plants, Plant) else plants
    sizes: dict[ForceFunction, int] = {}
    for plant in each:
        for force in plant.forces:
            sizes.setdefault(force.function, len(force.parameters))
    if not sizes:
        return None, _NONE
    parameters = np.array([_row(plant, sizes) for plant in each])
    return _chain(tuple(sizes.items()), len(each[0].actuators)), parameters


def _row(plant: Plant, sizes: dict[ForceFunction, int]) -> list[float]:
    own = {force.function: force.parameters for force in plant.forces}
    row: list[float] = []
    for function, size in sizes.items():
        row += [1.0, *own[function]] if function in own else [0.0] * (1 + size)
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
