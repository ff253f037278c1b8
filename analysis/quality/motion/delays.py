"""Which channel is late: the odd one out among the three delays between the four groups of motion channels.

The delays of positions and headings after the speeds, and of headings after the yaw rate, and the lever arm
forward, which at steady speed looks just like a delay, are explained by as few causes as their covariance allows
(generalised least squares; an added cause must pay for itself).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from acquisition.core.arrays import Floats
from analysis.quality.motion.kinematics import NAMES, Kinematics, quantile

OBSERVED = ("position_delay_s", "heading_delay_s", "heading_after_yaw_rate_s", "forward_m", "starboard_m")
CAUSES: dict[str, tuple[float, ...]] = {
    "north_m": (1.0, 0.0, 0.0, 0.0, 0.0),
    "heading_deg": (0.0, 1.0, 1.0, 0.0, 0.0),
    "surge_mps": (-1.0, -1.0, 0.0, 0.0, 0.0),
    "yaw_rate_dps": (0.0, 0.0, -1.0, 0.0, 0.0),
    "forward": (0.0, 0.0, 0.0, 1.0, 0.0),
    "starboard": (0.0, 0.0, 0.0, 0.0, 1.0),
}
"""What one unit of each cause does to the observed figures: seconds late, or metres of lever arm."""

_ADEQUATE = 25.0  # misfit that is still no reason for one more cause: five standard deviations
_AS_WELL = 9.0
_SMALLEST = np.array([0.1, 0.1, 0.05, 0.25, 0.25])
"""Unmodelled differences (smoothing inside sensors) of this size are left alone, as standard deviations / 2."""


@dataclass(frozen=True, slots=True)
class Explanation:
    """Sizes of the ``causes`` with standard errors, the misfit they leave (chi squared), rival causes."""

    causes: tuple[str, ...]
    sizes: Floats
    standard_errors: Floats
    misfit: float
    rivals: tuple[tuple[str, float], ...] = ()

    def size(self, cause: str) -> tuple[float, float]:
        place = self.causes.index(cause)
        return float(self.sizes[place]), float(self.standard_errors[place])


def explain(fit: Kinematics, jitter_s2: float = 0.0) -> Explanation:
    """The simplest adequate explanation of the delays and the lever arm; no cause where all is well.

    ``jitter_s2`` is the variance of the positions' stamps: by chance they are late on the whole.
    """
    best = Explanation((), np.empty(0), np.empty(0), 0.0)
    for count in range(4):
        tried = sorted((_explained(fit, causes, jitter_s2) for causes in combinations(CAUSES, count)), key=_order)
        best = tried[0]
        if best.misfit <= _ADEQUATE:
            rivals = [each for each in tried[1:] if each.misfit <= best.misfit + _AS_WELL and count == 1]
            named = tuple((each.causes[0], float(each.sizes[0])) for each in rivals)
            return Explanation(best.causes, best.sizes, best.standard_errors, best.misfit, named)
    return best


def _order(tried: Explanation) -> float:
    return tried.misfit


def _explained(fit: Kinematics, causes: tuple[str, ...], jitter_s2: float) -> Explanation:
    places = [NAMES.index(name) for name in OBSERVED]
    observed = fit.parameters[places]
    # The spread of few blocks is less known than a normal deviate's: widened as Student's t is at 95 %.
    wider = np.array([quantile(0.975, fit.informative[place]) / 1.96 for place in places])
    covariance = fit.covariance[np.ix_(places, places)] * np.outer(wider, wider) + np.diag(
        (0.5 * _SMALLEST) ** 2 / 9.0
    )
    covariance[0, 0] += jitter_s2 / max(fit.informative[places[0]], 1.0)
    inverse = np.linalg.inv(covariance)
    design = np.array([CAUSES[cause] for cause in causes]).reshape(-1, len(OBSERVED)).T
    normal = design.T @ inverse @ design
    sizes = np.linalg.solve(normal, design.T @ inverse @ observed) if causes else np.empty(0)
    left = observed - design @ sizes if causes else observed
    errors = np.sqrt(np.diag(np.linalg.inv(normal))) if causes else np.empty(0)
    return Explanation(causes, sizes, errors, float(left @ inverse @ left))
