"""The parameters learned by the adaptive calibrator, in physical units, and how well the data determine them.

A parameter's standard error is that of the quadratic approximation of the cost with a prior of unit width
(:func:`.fit.covariance_at`); if it is nearly as wide as the prior, the data do not determine the parameter.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from seatrial.acquisition.core.quantities import Floats
from seatrial.analysis.estimation.likelihood import UNKNOWN, correlated_pairs
from seatrial.hybrid.calibrators.adaptive.adaptation import (
    CURRENT_MPS,
    DRIFT_N,
    LAG,
    LAG_S,
    LARGEST_FACTOR,
    STEADY,
    STEADY_MASS_KG,
    SURROUNDED,
    USUAL_SHARE,
    WIND_MPS,
    parameter_names,
    positive_names,
    signed_names,
)
from seatrial.hybrid.calibrators.adaptive.calibrator import AdaptiveCalibrator
from seatrial.hybrid.vessel.plant import Plant

_NEARLY = 0.95  # of a bound, which the mean of differing members does not quite reach
_TITLES = {
    "constant_X_n": "steady force ahead", "constant_Y_n": "steady force aside", "constant_N_nm": "steady moment",
    "wind_north": "wind added, north", "wind_east": "wind added, east",
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class AdaptedParameter:
    """A parameter: ``value`` in ``unit`` with its 95 % interval and standard error, its ``neutral`` value,
    whether it is at a bound, and whether the data determine it."""

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
    """All parameters of the model, the best determined first, and their correlations [P, P]."""

    every: tuple[AdaptedParameter, ...]
    correlation: Floats

    @property
    def identified(self) -> tuple[AdaptedParameter, ...]:
        """Those that the data determine."""
        return tuple(parameter for parameter in self.every if parameter.identified)

    def entangled(self) -> list[tuple[str, str, float]]:
        """Pairs of identified parameters that the data cannot separate, with their correlation."""
        return correlated_pairs([parameter.name for parameter in self.identified], self.correlation)


def parameters_of(calibrator: AdaptiveCalibrator) -> Parameters:
    """The parameters of the ship and of her environment, without the observer's noise levels."""
    if calibrator.plant is None:
        raise ValueError("the adaptive calibrator needs the reference model")
    units = units_of(calibrator.plant)
    form = calibrator.plant.form
    places = np.array([parameter_names(form).index(name) for name in units])
    vector, covariance = calibrator.vectors_.mean(axis=0)[places], calibrator.covariance_[np.ix_(places, places)]
    deviation = np.sqrt(np.diag(covariance))
    order = np.argsort(deviation, kind="stable")
    correlation = (covariance / np.outer(deviation, deviation))[np.ix_(order, order)]
    names = list(units)
    signs = positive_names(form)
    parameters = [
        _parameter(names[place], vector[place], deviation[place], names[place] in signs, *units[names[place]])
        for place in order
    ]
    return Parameters(tuple(parameters), correlation)


Natural = Callable[[float], float]


def units_of(plant: Plant) -> dict[str, tuple[str, float, Natural]]:
    """Unit, the reference model's value and the conversion from deviation to value, for each parameter of ship
    and environment. Wind is relative to the measured one."""

    def added(model_value: float, usual: float) -> Natural:
        return lambda z: model_value + usual * z

    heavier = plant.mass_kg / STEADY_MASS_KG
    units: dict[str, tuple[str, float, Natural]] = {}
    factors = dict.fromkeys(positive_names(plant.form), lambda z: float(np.exp(USUAL_SHARE * z)))
    factors |= dict.fromkeys(signed_names(plant.form), lambda z: 1.0 + USUAL_SHARE * z)
    units |= {name: ("times the model's", 1.0, natural) for name, natural in factors.items()}
    for name, usual in STEADY.items():
        steady = float(getattr(plant, name))
        units[name] = ("N m" if name.endswith("_nm") else "N", steady, added(steady, heavier * usual))
    for axis in ("north", "east"):
        current_mps = float(getattr(plant, f"current_{axis}_mps"))
        drift_n = plant.drift_force_n * float(getattr(plant, f"drift_{axis}"))
        units[f"current_{axis}"] = ("m/s", current_mps, added(current_mps, CURRENT_MPS))
        units[f"drift_{axis}"] = ("N", drift_n, added(drift_n, heavier * DRIFT_N))
        units[f"wind_{axis}"] = ("m/s", 0.0, added(0.0, WIND_MPS))
    lag_s = plant.thruster_lag_s
    return units | {LAG: ("s", lag_s, lambda z: max(0.0, lag_s + LAG_S * z))}


def _parameter(
    name: str, z: float, deviation: float, keeps_sign: bool, unit: str, neutral: float, natural: Natural
) -> AdaptedParameter:
    low, high = sorted((natural(z - 1.96 * deviation), natural(z + 1.96 * deviation)))
    clipped = keeps_sign and abs(USUAL_SHARE * z) > _NEARLY * LARGEST_FACTOR
    at_bound = clipped or (name == LAG and z < 0.0 and natural(z) == 0.0)
    title = _TITLES.get(name, name.replace("_", " ") if name in SURROUNDED else name)
    return AdaptedParameter(
        title, natural(z), low, high, (high - low) / 3.92, unit, neutral, bool(at_bound), deviation < UNKNOWN
    )
