"""Whether anything remains that no effect of the catalogue explains, and what it looks like.

Each family of :mod:`.nuisance_basis` is tested against what the named effects, the tolerance and the noise leave: a
chi-square test of all its columns together. The tolerance itself is tested too: whether the forces that speeds and
thruster settings bring are off by more than it grants. A family that stands out has a size: the root mean square of
the force, or of the effect's parameter, that it stands for.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from acquisition.core.arrays import Floats, Ints
from hybrid.diagnosis.acceptance import spreads
from hybrid.diagnosis.evidence import reduced
from hybrid.diagnosis.examine import Examination
from hybrid.diagnosis.noise import FORCE_UNITS
from hybrid.diagnosis.nuisance_basis import AXES, FORMS, OPERATION
from hybrid.diagnosis.view import View, put_back, whole_data

CHANCE = 0.0001
"""The chance that a trial with nothing beyond its named effects and the tolerance shows any family."""

ANOTHER_FORM = 0.01
"""The chance that effects that are named rightly seem to have another form."""

_RANK = 1e-5
_NOTHING = 1e-6  # of a column's squares


@dataclass(frozen=True, slots=True)
class Family:
    """One family: what its forces depend on, the axis or the effect that varies, its columns."""

    depends: str
    what: str
    columns: Ints


@dataclass(frozen=True, slots=True)
class Remainder:
    """How one family stands: ``p_value`` corrected for all of its kind, ``size`` in the unit of ``what``.

    ``gain`` is how much of the squares it explains; ``size`` is that of what it adds to what is tolerated.
    """

    depends: str
    what: str
    p_value: float
    gain: float
    size: float
    matters: bool

    @property
    def found(self) -> bool:
        """Whether it stands out and is large enough to matter."""
        return self.p_value < (ANOTHER_FORM if self.depends in FORMS else CHANCE) and self.matters


def families(examination: Examination) -> list[Family]:
    """All families of an examination."""
    layout = examination.layout
    result = []
    for axis, name in enumerate(AXES):
        columns = layout.beyond(axis)
        for depends in dict.fromkeys(layout.depends):
            some = np.array([each == depends for each in layout.depends])
            result.append(Family(depends, name, columns[some]))
    for label in dict.fromkeys(layout.varied):
        some = np.flatnonzero([each == label for each in layout.varied])
        what, depends = label.split("*")
        result.append(Family(depends, what, some + layout.first_varied))
    return result


def remainders(view: View, names: Sequence[str]) -> list[Remainder]:
    """Every family, the one that stands out most first; the effects ``names`` are fitted freely beside it."""
    examination = view.examination
    every = families(examination)
    columns = np.concatenate([each.columns for each in every])
    free = np.array(view.columns(names), dtype=int)
    inner = _inner(examination, np.concatenate([[0], free, columns]))
    number = 1 + len(free)
    if len(free):
        inner = _beside(inner, number)
    place = {int(column): number + i for i, column in enumerate(columns)}
    forms = sum(each.depends in FORMS for each in every)
    tests = len(every) - forms + 1
    result = [_of_tolerance(examination, view, names, tests)]
    for each in every:
        chances = forms if each.depends in FORMS else tests
        places = [place[int(column)] for column in each.columns]
        judged = _judged(examination, inner, places, each, chances, 1.0)
        if judged.found:  # what scatters from leg to leg more than the model of the noise says counts for less
            spread = float(np.median(spreads(examination, each.columns, free, free)))
            judged = _judged(examination, inner, places, each, chances, max(spread, 1.0))
        result.append(judged)
    return sorted(result, key=lambda each: each.p_value)


def _inner(examination: Examination, kept: Ints) -> Floats:
    """Reduced products of columns, the model's own effects put back into the data."""
    total, back = examination.products.total, put_back(examination)
    data = total @ back
    total[:, 0] = total[0] = data
    total[0, 0] = back @ data
    return reduced(total, kept, examination.nuisance, examination.nuisance_scale)[0]


def _beside(inner: Floats, number: int) -> Floats:
    """Products of what columns 1 to ``number`` leave of the others, zero where that is nothing."""
    left = inner - inner[:, 1:number] @ np.linalg.solve(inner[1:number, 1:number], inner[1:number])
    gone = np.diag(left) < _NOTHING * np.diag(inner)
    left[gone] = left[:, gone] = 0.0
    return np.asarray(left)


def _judged(
    examination: Examination, inner: Floats, places: list[int], family: Family, tests: int, spread: float
) -> Remainder:
    information, right = inner[np.ix_(places, places)], inner[places, 0]
    scale = np.sqrt(np.maximum(np.diag(information), 1e-30))
    values, vectors = np.linalg.eigh(information / np.outer(scale, scale))
    kept = values > _RANK * max(float(values[-1]), _RANK)
    along = vectors[:, kept].T @ (right / scale)
    gain = float((along**2 / values[kept]).sum()) / spread
    p_value = min(1.0, tests * float(chi2.sf(gain, int(kept.sum())))) if kept.any() else 1.0
    back = vectors[:, kept] / scale[:, None]
    fitted, chance = back @ (along / values[kept]), float((back**2 / values[kept]).sum())
    size = float(np.sqrt(max(float((fitted**2).sum()) - chance, 0.0)))  # noise alone would have some size, too
    if family.what in AXES:
        return Remainder(
            family.depends, family.what, p_value, gain, size * float(FORCE_UNITS[AXES.index(family.what)]), True
        )
    least = max(examination.model.catalogue[family.what].smallest_free)
    matters = family.depends in FORMS or size > least  # another form says that the name is wrong, however small
    return Remainder(family.depends, family.what, p_value, gain, size, matters)


def _of_tolerance(examination: Examination, view: View, names: Sequence[str], tests: int) -> Remainder:
    """Whether the forces of speeds and thrusters are off by more than is granted: at twice and four times that."""
    nuisance, scale = examination.nuisance, examination.nuisance_scale
    wider, best, gains = np.isin(nuisance, _operating(examination)), 1.0, [0.0]
    granted = _log_density(view, names, scale)
    for factor in (2.0, 4.0, 8.0):
        gains.append(_log_density(view, names, scale * np.where(wider, factor, 1.0)) - granted)
        if gains[-1] == max(gains):
            best = factor
    gain = 2.0 * max(gains)
    return Remainder(
        OPERATION, "force", min(1.0, tests * float(chi2.sf(gain, 1))) if gain > 0.0 else 1.0, gain,
        best * examination.tolerance, best > 1.0,
    )  # fmt: skip


def _operating(examination: Examination) -> Ints:
    """The columns of the tolerance's force features."""
    return np.concatenate([examination.layout.axis(axis) for axis in range(3)])


def _log_density(view: View, names: Sequence[str], scale: Floats) -> float:
    """Of the data under these nuisances, the effects ``names`` fitted freely; up to a constant."""
    inner, determinant = whole_data(view.examination, view.examination.products.total, scale)
    columns = np.array(view.columns(names), dtype=int)
    left = inner[0, 0]
    if columns.size:
        information = inner[np.ix_(columns, columns)]
        left -= inner[0, columns] @ np.linalg.solve(information, inner[columns, 0])
        determinant += float(np.linalg.slogdet(information)[1])
    return float(-0.5 * (left + determinant))
