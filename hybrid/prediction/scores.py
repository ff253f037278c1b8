"""Errors of predicted tracks, and confidence intervals of their means.

Intervals come from the cluster bootstrap (Davison and Hinkley 1997, section 3.8): as many legs as there are,
drawn with replacement, each with all of its windows, since errors of one leg's windows are strongly correlated.
Ratios are paired: both means come from the same legs. The sequences of a campaign are legs of their own.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seatrial.acquisition.core.quantities import Floats
from seatrial.acquisition.core.result import Number, to_json
from seatrial.hybrid.prediction.prediction_windows import difference_rad

DRAWS = 2000
FEW_LEGS = 10
"""With fewer legs than this, bootstrap intervals are too narrow."""

COVERAGE_PERCENT = (2.5, 97.5)


@dataclass(frozen=True, slots=True)
class Score:
    """Errors of one method over N windows of H seconds; means run over windows and seconds 1 to H."""

    mean_distance_m: float
    end_distance_m: float
    mae_north_m: float
    mae_east_m: float
    heading_error_deg: float
    by_second: tuple[float, ...]


def distances(predicted: Floats, measured: Floats) -> Floats:
    """The distance between two tracks [N, H+1, 2 or 3] at seconds 1 to H [N, H], in metres."""
    gap = predicted[:, 1:, :2] - measured[:, 1:, :2]
    return np.asarray(np.hypot(gap[..., 0], gap[..., 1]))


def mean_distances(predicted: Floats, measured: Floats) -> Floats:
    """The mean distance of two tracks [N, H+1, 2 or 3] over seconds 1 to H [N] in metres; NaN where any is."""
    return np.asarray(distances(predicted, measured).mean(axis=1))


def score(predicted: Floats, measured: Floats) -> Score:
    """Compare tracks [N, H+1, 3] of north, east [m] and heading [rad]."""
    gap = predicted[:, 1:] - measured[:, 1:]
    distance = distances(predicted, measured)
    turn = difference_rad(predicted[:, 1:, 2], measured[:, 1:, 2])
    return Score(
        mean_distance_m=float(distance.mean()),
        end_distance_m=float(distance[:, -1].mean()),
        mae_north_m=float(np.abs(gap[..., 0]).mean()),
        mae_east_m=float(np.abs(gap[..., 1]).mean()),
        heading_error_deg=float(np.rad2deg(np.abs(turn)).mean()),
        by_second=tuple(float(each) for each in distance.mean(axis=0)),
    )


TWO_SIDED = "_two_sided"
"""The ending of the name of a method that starts from the two-sided state."""


def start_of(method: str) -> str:
    """The start state of a method's predictions: causal, or two-sided."""
    return "two_sided" if method.endswith(TWO_SIDED) else "causal"


def scores_json(scores: Mapping[str, Score]) -> dict[str, Any]:
    """Scores by method for JSON, each with its start state."""
    return {name: {"start": start_of(name), **to_json(each)} for name, each in scores.items()}


@dataclass(frozen=True, slots=True)
class Interval:
    """A value with its 95 % interval; NaN bounds if there is only one leg."""

    value: Number
    low: Number
    high: Number


@dataclass(frozen=True, slots=True)
class LegBootstrap:
    """Bootstrap draws of legs, the same for all statistics.

    ``leg`` [N] is the number of each window's leg, ``times`` [draws, legs] how often each leg was drawn.
    """

    leg: NDArray[np.int64]
    times: Floats

    @classmethod
    def of(cls, legs: NDArray[np.str_] | NDArray[np.int64], seed: int, draws: int = DRAWS) -> LegBootstrap:
        """Draws for windows of the named or numbered legs [N]; equal numbers of legs and seeds give equal
        draws."""
        names, number = np.unique(legs, return_inverse=True)
        share = np.full(len(names), 1.0 / len(names))
        times = np.random.default_rng(seed).multinomial(len(names), share, size=draws)
        return cls(number.astype(np.int64), times.astype(float))

    @property
    def legs(self) -> int:
        """The number of legs."""
        return int(self.times.shape[1])

    def means(self, values: Floats) -> Floats:
        """The means over windows of ``values`` [N, K] in each draw [draws, K]."""
        sums = np.zeros((self.legs, values.shape[1]))
        np.add.at(sums, self.leg, values)
        counts = np.bincount(self.leg, minlength=self.legs)
        return np.asarray((self.times @ sums) / (self.times @ counts)[:, None])

    def mean(self, values: Floats) -> Interval:
        """The mean of ``values`` [N] over windows."""
        return self.mean_of_each(values[:, None])[0]

    def mean_of_each(self, values: Floats) -> tuple[Interval, ...]:
        """The means of the columns of ``values`` [N, K] over windows."""
        return self._intervals(values.mean(axis=0), self.means(values))

    def ratio(self, values: Floats, others: Floats) -> Interval:
        """The mean of ``values`` [N] over that of ``others`` [N], paired; 1 where both are zero."""
        means = np.vstack([self.means(np.column_stack([values, others])), [values.mean(), others.mean()]])
        with np.errstate(divide="ignore", invalid="ignore"):
            quotients = means[:, 0] / means[:, 1]
        quotients[np.isnan(quotients)] = 1.0
        return self._intervals(quotients[-1:], quotients[:-1, None])[0]

    def _intervals(self, values: Floats, drawn: Floats) -> tuple[Interval, ...]:
        """Intervals about ``values`` [K] from draws [draws, K]."""
        if self.legs < 2:
            return tuple(Interval(float(each), np.nan, np.nan) for each in values)
        return tuple(interval_about(float(value), draws) for value, draws in zip(values, drawn.T, strict=True))


def interval_about(value: float, drawn: Floats) -> Interval:
    """``value`` with the central 95 % of ``drawn`` [draws]."""
    # without interpolation, which is undefined between infinite draws
    low, high = np.percentile(drawn, COVERAGE_PERCENT, method="nearest")
    return Interval(value, float(low), float(high))
