"""An examination as naming sees it: what every effect has in common with the data and with every other effect."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import expm1, log, log1p

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from acquisition.core.arrays import Floats
from acquisition.core.errors import ConfigurationError
from hybrid.diagnosis.evidence import Fit, Products, fitted, log_evidence, reduced
from hybrid.diagnosis.examine import Examination

_CLOCKS = (
    2  # that may be wrong at once: where all records are late by the same none is, and three are as the fourth
)


@dataclass(frozen=True, slots=True)
class View:
    """Inner products under V of the data without any effect, column 0, and all effects' columns [1+P, 1+P].

    ``left_out`` [L, 1+P, 1+P] are the same with each leg left out, ``alone`` of each leg by itself.
    """

    inner: Floats
    examination: Examination
    left_out: Floats | None = None
    alone: Floats | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """All effects."""
        return tuple(self.examination.model.catalogue)

    def columns(self, names: Sequence[str]) -> tuple[int, ...]:
        """The columns of some effects, in their order."""
        return tuple(column for name in names for column in self.examination.layout.of(name))

    def prior(self, names: Sequence[str]) -> Floats:
        """The standard deviations of their priors."""
        return np.asarray(self.examination.layout.prior[np.array(self.columns(names), dtype=int) - 1])

    def evidence(self, names: Sequence[str]) -> float:
        """Log odds of these effects against none, less what each pays for the catalogue's size."""
        if not names:
            return 0.0
        return log_evidence(self.inner, self.columns(names), self.prior(names)) - self.price * len(names)

    @property
    def price(self) -> float:
        """What an effect has to be better than chance by: one of so many would be as good."""
        return log(len(self.names))

    def chance(self, gain: float, degrees: int) -> float:
        """The chance that any of so many effects gains as much where there is none (Sidak 1967)."""
        single = min(float(chi2.sf(max(gain, 0.0), degrees)), 1.0 - 1e-12)
        return -expm1(len(self.names) * log1p(-single))

    def fit(self, names: Sequence[str], prior: bool = False) -> Fit:
        """The joint fit."""
        return fitted(self.inner, self.columns(names), self.prior(names) if prior and names else None)

    def places(self, fit: Fit, name: str) -> list[int]:
        """Where an effect's coordinates stand in a fit."""
        return [fit.columns.index(column) for column in self.columns([name])]

    def possible(self, names: Sequence[str]) -> bool:
        """Whether these effects can be at work together: few enough clocks are wrong, all values within bounds."""
        late = [name for name in names if self.examination.model.catalogue[name].family == "clock"]
        return len(late) <= _CLOCKS and all(value is not None for value in self.values(names).values())

    def values(self, names: Sequence[str]) -> dict[str, dict[str, float] | None]:
        """The fitted parameters of each, None where they are out of bounds."""
        fit, result = self.fit(names, prior=True), dict[str, dict[str, float] | None]()
        for name in names:
            free = fit.values[self.places(fit, name)].tolist()
            try:
                result[name] = self.examination.model.values(name, free)
            except ConfigurationError:
                result[name] = None
        return result


def view_of(examination: Examination, by_leg: bool = False) -> View:
    """The reduced products of an examination, its model's own effects put back into the data."""
    total = examination.products.total

    def inner(products: Floats) -> Floats:
        return whole_data(examination, products, examination.nuisance_scale)[0]

    if not by_leg:
        return View(inner(total), examination)
    legs = examination.products.legs
    left_out, alone = (np.array([inner(each) for each in some]) for some in (total - legs, legs))
    return View(inner(total), examination, left_out, alone)


def whole_data(examination: Examination, products: Floats, scale: Floats) -> tuple[Floats, float]:
    """Reduced products of the data without any effect and of all effects, and the logarithm of V's determinant."""
    kept = np.arange(1 + len(examination.layout.effect))
    inner, determinant = reduced(products, kept, examination.nuisance, scale)
    back = np.eye(len(kept))
    back[:, 0] = put_back(examination)[kept]
    return back.T @ inner @ back, determinant


def view_without(examination: Examination, legs: NDArray[np.bool_]) -> View:
    """As :func:`view_of`, some legs left out."""
    products = examination.products
    return view_of(replace(examination, products=Products(products.legs[~legs], products.rows[~legs])))


def put_back(examination: Examination) -> Floats:
    """The data with what the model's own effects have taken off, as a combination of all columns [C]."""
    back = np.zeros(examination.products.legs.shape[1])
    back[0] = 1.0
    for name, free in examination.model.at.items():
        back[list(examination.layout.of(name))] = free
    return back
