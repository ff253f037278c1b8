"""Regions that correct themselves: wider after the ship has left them too often, narrower after too seldom.

The factor on their size follows the quantile that it stands for (adaptive conformal inference: Gibbs and Candes
2021; as a quantile tracker Angelopoulos, Candes and Tibshirani 2023, "Conformal PID control for time series
prediction", equation 3), on a logarithmic scale:

    log factor  <-  log factor + step (share of seconds outside - 0.05)

for each independent prediction, the step larger at first. Predictions that start a second apart have nearly the
same error, so each counts as the seconds since the one before it over the horizon. Whatever the errors do, the mean
share outside comes to 5 % as 1 / (number of independent predictions) while the factor is inside its bounds.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import exp, log

from analysis.tables.table import NANO
from hybrid.calibrators.predict import Prediction
from hybrid.prediction.regions import COVERAGE
from hybrid.twin.running_error import TrackError

STEP = 0.3
"""The step after the first predictions. Where errors are a Gaussian process, regions half as wide as they should be
hold 94 % over the first hour of 30 s predictions, twice as wide ones 97 %, and right ones become 9 % larger in area
by chance; a step half as large takes twice as long to get there, one twice as large costs twice the area."""
LARGEST_FACTOR = 4.0
"""And 1 over it the smallest. From there, as after a failed sensor, it is back in an hour of 30 s predictions."""


def step(learned: float) -> float:
    """The step after so many independent predictions: large at first, as t^-0.6 (Angelopoulos, Barber and Bates
    2024, "Online conformal prediction with decaying step sizes"), then :data:`STEP`, as ships and days change.
    """
    return max(STEP, exp(-0.6 * log(max(learned, 1.0))))


@dataclass(frozen=True, slots=True)
class RegionFactor:
    """What the size of the 95 % regions is multiplied by, from how many independent predictions it was learned,
    and the start of the last of them [ns UTC].
    """

    factor: float = 1.0
    learned: float = 0.0
    start_ns: int | None = None

    def after(self, error: TrackError, horizon_s: int) -> RegionFactor:
        """The factor after one judged prediction more; as it is where that had no region or a thruster moved."""
        if error.inside_band is None or error.thrusters_moved:
            return self
        apart_s = 0.0 if self.start_ns is None else (error.start_ns - self.start_ns) / NANO
        independent = min(max(apart_s, 0.0) / horizon_s, 1.0)
        learned, bound = self.learned + independent, log(LARGEST_FACTOR)
        raised = log(self.factor) + step(learned) * independent * (COVERAGE - error.inside_band)
        return RegionFactor(exp(min(max(raised, -bound), bound)), learned, error.start_ns)

    def widened(self, prediction: Prediction) -> Prediction:
        """A prediction with its region, if it has one, multiplied by the factor."""
        if prediction.region_m is None:
            return prediction
        return replace(prediction, region_m=self.factor * prediction.region_m)

    @property
    def is_at_bound(self) -> bool:
        """Whether it would go further: the regions are no measure of the errors any more."""
        return abs(log(self.factor)) > 0.999 * log(LARGEST_FACTOR)

    def __str__(self) -> str:
        """What it says of the regions in plain words.

        >>> print(RegionFactor(1.5))
        band 1.5 times as wide as the calibrator's, which held the ship too seldom
        """
        if abs(self.factor - 1.0) < 0.05:
            return "band as wide as the calibrator's"
        held = "held the ship too seldom" if self.factor > 1.0 else "was wider than needed"
        beyond = ": as far as it goes, train anew" if self.is_at_bound else ""
        return f"band {self.factor:.2g} times as wide as the calibrator's, which {held}{beyond}"
