"""What the adaptive calibrator has learned, in the units of the thing, and how well the data know it.

A parameter's standard error is that of the cost's parabola beside the prior of width one
(:func:`.fit.covariance_at`); where it is nearly as wide as the prior the data say nothing of it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hybrid.calibrators.adaptive.adaptation import (
    CURRENT_MPS,
    DRIFT_N,
    LAG,
    LAG_S,
    LARGEST_FACTOR,
    NAMES,
    POSITIVE,
    SIGNED,
    STEADY,
    STEADY_MASS_KG,
    USUAL_SHARE,
    WIND_MPS,
)
from hybrid.calibrators.adaptive.calibrator import Adaptive

Floats = NDArray[np.float64]

UNKNOWN = 0.8
"""A standard error of so much of the prior's, and more, is none of the data's."""
ENTANGLED = 0.95
"""Two parameters correlated by so much, either way, cannot be told apart."""
_AXES = {
    "constant_X_n": "steady force ahead",
    "constant_Y_n": "steady force aside",
    "constant_N_nm": "steady moment",
}


@dataclass(frozen=True, slots=True)
class Parameter:
    """One number: ``value`` in ``unit`` with its 95 % interval and standard error, what it is ``neutral``ly, and
    how it stands: at the bound of what is allowed, and whether the data know it.
    """

    name: str
    value: float
    low: float
    high: float
    error: float
    unit: str
    neutral: float
    at_bound: bool
    identified: bool


@dataclass(frozen=True, slots=True)
class Parameters:
    """All parameters of the model, the best known first, and how they are correlated [P, P]."""

    every: tuple[Parameter, ...]
    correlation: Floats

    @property
    def identified(self) -> tuple[Parameter, ...]:
        """Those that the data know."""
        return tuple(each for each in self.every if each.identified)

    def entangled(self) -> list[tuple[str, str, float]]:
        """Pairs of identified parameters that cannot be told apart, and their correlation."""
        known = len(self.identified)
        return [
            (self.every[i].name, self.every[j].name, float(self.correlation[i, j]))
            for i in range(known) for j in range(i) if abs(self.correlation[i, j]) > ENTANGLED
        ]  # fmt: skip


def parameters_of(calibrator: Adaptive) -> Parameters:
    """What was learned of the ship and of what acts on her; how closely she is followed is left out."""
    units = units_of(1.0 if calibrator.plant is None else calibrator.plant.mass_kg / STEADY_MASS_KG)
    places = np.array([NAMES.index(name) for name in units])
    vector, covariance = calibrator.vectors_.mean(axis=0)[places], calibrator.covariance_[np.ix_(places, places)]
    deviation = np.sqrt(np.diag(covariance))
    order = np.argsort(deviation, kind="stable")
    correlation = (covariance / np.outer(deviation, deviation))[np.ix_(order, order)]
    names = list(units)
    every = [_parameter(names[place], vector[place], deviation[place], *units[names[place]]) for place in order]
    return Parameters(tuple(every), correlation)


Natural = Callable[[float], float]


def units_of(heavier: float) -> dict[str, tuple[str, float, Natural]]:
    """Unit, neutral value and way from a departure to the value, for each parameter of the ship and her
    surroundings; ``heavier`` is her mass over that of the ship for which steady forces are usual.
    """

    def times(usual: float) -> Natural:
        return lambda z: usual * z

    units: dict[str, tuple[str, float, Natural]] = {}
    units |= {name: ("times the model's", 1.0, lambda z: float(np.exp(USUAL_SHARE * z))) for name in POSITIVE}
    units |= {name: ("times the model's", 1.0, lambda z: 1.0 + USUAL_SHARE * z) for name in SIGNED}
    units |= {
        name: ("N m" if name.endswith("_nm") else "N", 0.0, times(heavier * usual))
        for name, usual in STEADY.items()
    }
    for what, unit, usual in (("current", "m/s", CURRENT_MPS), ("drift", "N", heavier * DRIFT_N),
                              ("wind", "m/s", WIND_MPS)):  # fmt: skip
        units |= {f"{what}_{axis}": (unit, 0.0, times(usual)) for axis in ("north", "east")}
    return units | {LAG: ("s", 0.0, times(LAG_S))}


def _parameter(name: str, z: float, deviation: float, unit: str, neutral: float, natural: Natural) -> Parameter:
    low, high = sorted((natural(z - 1.96 * deviation), natural(z + 1.96 * deviation)))
    at_bound = abs(USUAL_SHARE * z) >= LARGEST_FACTOR if name in POSITIVE else name == LAG and z <= 0.0
    title = _AXES.get(name, name.replace("_", " ") if name not in POSITIVE + SIGNED else name)
    return Parameter(
        title, natural(z), low, high, (high - low) / 3.92, unit, neutral, bool(at_bound), deviation < UNKNOWN
    )
