"""How large something that is in no catalogue has to be to stand out in a trial.

A trial is simulated with it at some size and searched as in a diagnosis. The gain of the family of remainders that
stands out most, less what chance gives, grows with the square of the size (its noncentrality); so the size at
which nine of ten trials would show it follows, and is checked once more near there.
"""

from __future__ import annotations

from math import inf, sqrt

from scipy.stats import chi2

from seatrial.hybrid.diagnosis.acceptance import CHANCE, LackOfFit, lack_of_fit, nuisance_families, search_effects
from seatrial.hybrid.diagnosis.planning import noncentrality
from seatrial.hybrid.diagnosis.regression import evidence_of
from seatrial.hybrid.effects import CATALOGUE
from tests.benchmarks.diagnosis.design import Design
from tests.benchmarks.diagnosis.sound import examination_of

START = {
    "yaw_moment_4psi": 5000.0, "sheared_current": 0.02, "bank_suction": 2000.0, "fading_thrust": 0.04,
    "one_sided_stall": 0.2,
}  # fmt: skip
"""First sizes to try, in the units of the simulator: N m, m/s per 100 m, N, and shares."""
MOST = {"fading_thrust": 0.6, "one_sided_stall": 1.0, "sheared_current": 0.3}
"""Sizes beyond which they make no sense."""

_LOOKS = 3
_STEP = 4.0


def size_found(name: str, design: Design) -> float:
    """The size at which it is found in nine of ten such trials."""
    size = START[name]
    for _ in range(_LOOKS):
        size *= min(max(_ratio(name, size, design), 1.0 / _STEP), _STEP)
        size = min(size, MOST.get(name, size))
    return size


def _ratio(name: str, size: float, design: Design) -> float:
    """The size at which it is found, over this one."""
    equations = examination_of(design, {name: size})
    evidence = evidence_of(equations)
    every = nuisance_families(equations)
    degrees = {(each.depends, each.what): len(each.columns) for each in every}
    ratios = [_STEP]
    for each in lack_of_fit(evidence, search_effects(evidence)):
        number = degrees.get((each.depends, each.what))
        if number is not None and each.gain > number:
            needed = noncentrality(float(chi2.isf(CHANCE / (len(every) + 1), number)), number)
            ratios.append(max(sqrt(needed / (each.gain - number)), _over_least(each)))
    return min(ratios)


def _over_least(remainder: LackOfFit) -> float:
    """How much larger it has to be for anybody to care for it."""
    least = max(CATALOGUE[remainder.what].smallest_free) if remainder.what in CATALOGUE else 0.0
    if least == 0.0:
        return 0.0
    return least / remainder.size if remainder.size > 0.0 else inf
