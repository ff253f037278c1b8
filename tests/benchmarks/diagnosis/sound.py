"""What a trial with nothing hidden says of every effect: limits, separations, and the hidden sizes that follow."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import cos, inf, pi, sin, sqrt
from typing import Any

import numpy as np

from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.hybrid.diagnosis.estimate_noise import estimate_noise
from seatrial.hybrid.diagnosis.linearise import linearise, model_of
from seatrial.hybrid.diagnosis.log import log_of
from seatrial.hybrid.diagnosis.planning import DISTINGUISHED, Information, free_limits, information_of, separation
from seatrial.hybrid.diagnosis.regression import NormalEquations, normal_equations
from seatrial.hybrid.diagnosis.verdict import TOLERANCE
from seatrial.hybrid.effects import CATALOGUE, Effect
from seatrial.hybrid.vessel.files import load_vessel
from tests.benchmarks.diagnosis.design import VESSEL, Design, Hidden, simulated

Values = dict[str, dict[str, float]]

ORDINARY = 5.0
"""An effect whose limit is above so many times its ordinary size cannot be identified by a trial."""

ALIKE = 4.0
"""Twice the log likelihood that is as good as no difference."""

_KEPT = 0.25  # of an effect's information has to be left when those hidden beside it are unknown, too


def examination_of(design: Design, outside: Mapping[str, float] | None = None) -> NormalEquations:
    """One look at a trial with nothing of the catalogue hidden in it."""
    table, _ = simulated(design, {}, outside)
    model = model_of(load_vessel(VESSEL), CATALOGUE)
    estimate = estimate_noise(linearise(log_of([table]), model, TOLERANCE))
    return normal_equations(estimate.linearisation, estimate.noise)


def sound(design: Design) -> dict[str, Any]:
    """The information of all effects in a sound trial, as plain values."""
    information = information_of(examination_of(design))
    columns = {name: [int(each) for each in places] for name, places in information.columns.items()}
    return {"matrix": information.matrix.tolist(), "columns": columns}


def information_from(plain: Mapping[str, Any]) -> Information:
    """The inverse."""
    columns = {name: np.array(places, dtype=np.int64) for name, places in plain["columns"].items()}
    return Information(np.array(plain["matrix"]), columns, CATALOGUE)


class Sound:
    """A sound trial's information with the limits that follow, worked out once."""

    def __init__(self, plain: Mapping[str, Any]) -> None:
        self.information = information_from(plain)
        self.limits = free_limits(self.information)

    def identifiable(self, name: str) -> bool:
        """Whether the trial can identify an effect at a size that anyone would hide."""
        return self.limits[name] <= ORDINARY * max(CATALOGUE[name].free_scale)

    def rivals(self, hidden: Hidden, below: float = DISTINGUISHED) -> list[str]:
        """Effects that could stand for one of the hidden, possible in size, as good as that one in such a trial."""
        return [
            other
            for name in hidden
            for other in CATALOGUE
            if other not in hidden and self._imitates(other, name, hidden, below)
        ]

    def _imitates(self, other: str, name: str, hidden: Hidden, below: float) -> bool:
        given = [each for each in hidden if each != name]
        free = CATALOGUE[name].free_coordinates(hidden[name])
        if separation(self.information, name, other, free, given) >= below:
            return False
        own, its = self.information.columns[name], self.information.columns[other]
        matrix = self.information.matrix
        size = np.linalg.lstsq(matrix[np.ix_(its, its)], matrix[np.ix_(its, own)] @ np.array(free), rcond=None)[0]
        return _possible(CATALOGUE[other], size.tolist()) is not None

    def apart(self, random: np.random.Generator, number: int, multiple: float) -> Values | None:
        """So many effects of different families that nothing imitates, at ``multiple`` times their limits."""
        for _ in range(50):
            hidden = self.hidden(self.drawn(random, number), multiple, random)
            if hidden and not self.rivals(hidden):
                return hidden
        return None

    def drawn(self, random: np.random.Generator, number: int) -> tuple[str, ...]:
        """Effects of different families that the trial can tell apart; empty where chance finds none."""
        possible = [name for name in CATALOGUE if self.identifiable(name)]
        for _ in range(200):
            names = tuple(str(each) for each in random.permutation(possible)[:number])
            families = {CATALOGUE[name].family for name in names}
            if len(families) == number and all(self.kept(name, names) > _KEPT for name in names):
                return names
        return ()

    def kept(self, name: str, names: Sequence[str]) -> float:
        """The share of an effect's information that is left when the others may be anything, at worst."""
        others = [other for other in names if other != name]
        alone, given = self.information.about(name), self.information.about(name, others)
        return float(np.linalg.eigvals(np.linalg.solve(alone, given)).real.min())

    def hidden(self, names: Sequence[str], multiple: float, random: np.random.Generator) -> Values | None:
        """Effects at ``multiple`` times their limits, given the others; None if a size is out of bounds."""
        result: Values = {}
        if not all(self.identifiable(name) for name in names):
            return None
        for name in names:
            size = multiple * self.limits[name] / sqrt(max(self.kept(name, names), 1e-9))
            values = placed(CATALOGUE[name], size, random)
            if values is None:
                return None
            result[name] = values
        return result


def placed(effect: Effect, size_free: float, random: np.random.Generator) -> dict[str, float] | None:
    """Parameters of an effect of this size in free coordinates: the direction or sign drawn, as bounds allow."""
    if len(effect.free_scale) == 2:
        angle = random.uniform(0.0, 2.0 * pi)
        tried: list[tuple[float, ...]] = [(size_free * cos(angle), size_free * sin(angle))]
    else:
        sign = 1.0 if effect.chart == "inverse_square" else float(random.choice([-1.0, 1.0]))
        tried = [(sign * size_free,), (-sign * size_free,)]
    return next((values for free in tried if (values := _possible(effect, free)) is not None), None)


def _possible(effect: Effect, free: Sequence[float]) -> dict[str, float] | None:
    """The parameters of free coordinates, None beyond a bound."""
    values = effect.values_at(free)
    if inf in values.values():
        return None
    try:
        return effect.complete_values(values)
    except ConfigurationError:
        return None
