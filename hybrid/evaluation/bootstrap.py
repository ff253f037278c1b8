"""Intervals of means and ratios by drawing legs, not windows: windows of one leg say nearly the same.

The cluster bootstrap (Davison and Hinkley 1997, section 3.8): as many legs as there are, drawn with replacement,
each with all of its windows. Ratios are paired: both means come from the same legs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

DRAWS = 2000
COVERAGE_PERCENT = (2.5, 97.5)


@dataclass(frozen=True, slots=True)
class Interval:
    """A figure and the 95 % interval about it; NaN bounds where one leg alone cannot say."""

    value: float
    low: float
    high: float

    def as_dict(self) -> dict[str, float | None]:
        """For JSON, which knows no NaN."""
        bounds = {"low": self.low, "high": self.high}
        return {"value": self.value} | {key: each if np.isfinite(each) else None for key, each in bounds.items()}


@dataclass(frozen=True, slots=True)
class LegBootstrap:
    """Draws of legs with replacement, the same for all that is asked of them.

    ``leg`` [N] is the number of each window's leg, ``times`` [draws, legs] how often each leg was drawn.
    """

    leg: NDArray[np.int64]
    times: Floats

    @classmethod
    def of(cls, legs: NDArray[np.str_], seed: int) -> LegBootstrap:
        """For windows of the named legs [N]."""
        names, number = np.unique(legs, return_inverse=True)
        share = np.full(len(names), 1.0 / len(names))
        times = np.random.default_rng(seed).multinomial(len(names), share, size=DRAWS)
        return cls(number.astype(np.int64), times.astype(float))

    @property
    def legs(self) -> int:
        """The number of legs."""
        return int(self.times.shape[1])

    def means(self, values: Floats) -> Floats:
        """The means over windows of ``values`` [N] in each draw [draws]."""
        sums, counts = np.bincount(self.leg, values, self.legs), np.bincount(self.leg, minlength=self.legs)
        return np.asarray((self.times @ sums) / (self.times @ counts))

    def mean(self, values: Floats) -> Interval:
        """The mean of ``values`` [N] over windows."""
        return self._interval(float(values.mean()), self.means(values))

    def ratio(self, values: Floats, others: Floats) -> Interval:
        """The mean of ``values`` [N] over that of ``others`` [N], paired; 1 where both are nothing."""
        with np.errstate(divide="ignore", invalid="ignore"):
            drawn = self.means(values) / self.means(others)
            value = np.divide(values.mean(), others.mean())
        drawn, whole = np.where(np.isnan(drawn), 1.0, drawn), 1.0 if np.isnan(value) else float(value)
        return self._interval(whole, drawn)

    def _interval(self, value: float, drawn: Floats) -> Interval:
        if self.legs < 2:
            return Interval(value, np.nan, np.nan)
        low, high = np.percentile(drawn, COVERAGE_PERCENT)
        return Interval(value, float(low), float(high))
