"""The evidence for effects: linear regression on whitened data, from Gram matrices.

Data z, signatures S and nuisances N (the tolerances of the model and of each sensor), all whitened, give

    z = S a + N b + e,  e ~ N(0, I),  b ~ N(0, I),  so that  z - S a ~ N(0, V),  V = I + N N'

All later steps need only inner products under the inverse of V (Woodbury), and these follow from the Gram
matrix of all columns, summed over legs. To leave legs out, theirs are subtracted.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, lru_cache
from math import expm1, isfinite, log, log1p
from typing import TypeVar

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve, solve_triangular
from scipy.stats import chi2

from seatrial.acquisition.core.errors import ConfigurationError, Progress
from seatrial.acquisition.core.quantities import Floats, Ints
from seatrial.hybrid.diagnosis.disturbance_model import (
    FORCE_UNITS,
    Columns,
    DisturbanceNoise,
    NoiseEstimate,
    columns_of,
    whiten,
)
from seatrial.hybrid.diagnosis.linearise import Linearisation, LinearModel
from seatrial.hybrid.diagnosis.log import Log
from seatrial.hybrid.diagnosis.nuisance_basis import (
    FEATURES,
    INTERACTIONS,
    TOLERATED_SHARE,
    features,
    force_range,
    nuisance_basis,
    tolerances,
    wind_error_mps,
    wind_errors,
)
from seatrial.hybrid.effects import Effect


def marginalise(gram: Floats, kept: Ints, nuisance: Ints, scale: Floats) -> tuple[Floats, float]:
    """Inner products under the inverse of V of the columns ``kept`` [K, K], and the log determinant of V.

    ``scale`` [n] is the standard deviation of each column in ``nuisance``.
    """
    if not nuisance.size:
        return gram[np.ix_(kept, kept)], 0.0
    inner = gram[np.ix_(nuisance, nuisance)] * np.outer(scale, scale)
    inner[np.diag_indices_from(inner)] += 1.0
    factor = cho_factor(inner, lower=True, check_finite=False)
    cross = gram[np.ix_(nuisance, kept)] * scale[:, None]
    half = solve_triangular(factor[0], cross, lower=True, check_finite=False)
    determinant = 2.0 * float(np.log(np.diag(factor[0])).sum())
    return gram[np.ix_(kept, kept)] - half.T @ half, determinant


def explained_by(inner: Floats, columns: Ints, explaining: Ints) -> Floats:
    """The part of the inner products of ``columns`` [d, d] that the ``explaining`` ones explain at best."""
    scale = np.sqrt(np.maximum(np.diag(inner)[explaining], 1e-300))
    cross = inner[np.ix_(explaining, columns)] / scale[:, None]
    among = inner[np.ix_(explaining, explaining)] / np.outer(scale, scale)
    return np.asarray(cross.T @ np.linalg.solve(among + 1e-9 * np.eye(len(explaining)), cross))


@dataclass(frozen=True, slots=True)
class JointFit:
    """A joint fit of some columns: values, covariance, and the part of z' V^-1 z that they explain."""

    columns: tuple[int, ...]
    values: Floats
    covariance: Floats
    gain: float


def fit_columns(inner: Floats, columns: Sequence[int], prior: Floats | None = None) -> JointFit:
    """Fit ``columns`` to column 0 of the reduced inner products; ``prior`` are standard deviations about zero."""
    index = np.array(columns, dtype=int)
    if not index.size:
        return JointFit((), np.zeros(0), np.zeros((0, 0)), 0.0)
    information, right = inner[np.ix_(index, index)].copy(), inner[index, 0]
    if prior is not None:
        information[np.diag_indices_from(information)] += prior**-2.0
    factor = cho_factor(information + 1e-12 * np.diag(np.diag(information)), check_finite=False)
    values = cho_solve(factor, right)
    return JointFit(tuple(columns), values, cho_solve(factor, np.eye(len(index))), float(right @ values))


def draw_columns(inner: Floats, columns: Sequence[int], prior: Floats, seed: int) -> Floats:
    """A posterior draw of the coefficients of ``columns``.

    With a draw removed, the data have the size of the noise; with the mode removed they would be too small by
    the noise that it has fitted.
    """
    index = np.array(columns, dtype=int)
    information = inner[np.ix_(index, index)].copy()
    information[np.diag_indices_from(information)] += prior**-2.0
    lower = np.linalg.cholesky(information)
    half = solve_triangular(lower, inner[index, 0], lower=True, check_finite=False)
    chance = np.random.default_rng(seed).standard_normal(len(index))
    return np.asarray(solve_triangular(lower, half + chance, lower=True, trans="T", check_finite=False))


def log_evidence(inner: Floats, columns: Sequence[int], prior: Floats) -> float:
    """Log odds that ``columns``, with normal priors, are present: half the gain less the Occam factor.

    Raises :class:`numpy.linalg.LinAlgError` where the inner products of the columns are not positive.
    """
    if not len(columns):
        return 0.0
    odds = float(_log_evidence(np.ascontiguousarray(inner), np.array(columns, dtype=np.int64), prior))
    if not isfinite(odds):
        raise np.linalg.LinAlgError("inner products of effects are not positive definite")
    return odds


@njit(cache=True, error_model="numpy")
def _log_evidence(inner, index, prior):  # type: ignore[no-untyped-def]
    """The same by a Cholesky factor [K, K] of the columns' scaled information, or NaN where there is none.

    Compiled, since a search asks for ten thousand of these small ones: 3 to 5 us each instead of 110 to 140.
    """
    count = index.size
    factor, half, odds = np.empty((count, count)), np.empty(count), 0.0
    for row in range(count):
        remainder = inner[index[row], 0] * prior[row]
        for column in range(row + 1):
            value = inner[index[row], index[column]] * prior[row] * prior[column]
            for k in range(column):
                value -= factor[row, k] * factor[column, k]
            if column < row:
                factor[row, column] = value / factor[column, column]
                remainder -= factor[row, column] * half[column]
        factor[row, row] = np.sqrt(1.0 + value)
        half[row] = remainder / factor[row, row]
        odds += 0.5 * half[row] ** 2 - np.log(factor[row, row])
    return odds


Arrays = TypeVar("Arrays", LinearModel, Columns)

_LEGS_AT_ONCE = 4
_UNEVEN = 0.2  # of the smallest size of interest: no current or gyro is perfectly steady


@lru_cache(maxsize=64)
def _columns_by_effect(effect: tuple[str, ...]) -> dict[str, tuple[int, ...]]:
    """The columns of each effect; cached, as a search asks for them a million times."""
    result = dict[str, tuple[int, ...]]()
    for column, name in enumerate(effect, 1):
        result[name] = (*result.get(name, ()), column)
    return result


@dataclass(frozen=True, slots=True)
class ColumnLayout:
    """The meaning of the columns: data (0), effects, tolerated wind errors, varying effects, force features.

    ``effect`` [P] is the effect of each effect column; ``varied`` the varying effect of each such column and
    what it varies with; ``features`` the number of tolerance features for each force axis, followed in each
    axis by the features of causes outside the catalogue, of which ``depends`` gives the dependence.
    """

    effect: tuple[str, ...]
    prior: Floats
    tolerated: Floats
    wind: int
    features: int = 0
    varying: tuple[str, ...] = ()
    varying_prior: Floats = field(default_factory=lambda: np.zeros(0))
    varying_tolerated: Floats = field(default_factory=lambda: np.zeros(0))
    depends: tuple[str, ...] = ()

    def of(self, name: str) -> tuple[int, ...]:
        """The columns of an effect."""
        return _columns_by_effect(self.effect).get(name, ())

    @property
    def first_wind(self) -> int:
        """The first column of the wind errors."""
        return 1 + len(self.effect)

    @property
    def first_feature(self) -> int:
        """The first column of the force features."""
        return self.first_varying + len(self.varying)

    @property
    def first_varying(self) -> int:
        """The first column of the varying effects."""
        return self.first_wind + self.wind

    def axis(self, axis: int) -> Ints:
        """The columns of the tolerance's features in a body axis."""
        return np.arange(self.features) + self.first_feature + axis * (self.features + len(self.depends))

    def nuisance_forces(self, axis: int) -> Ints:
        """The columns of the features of causes outside the catalogue in a body axis."""
        return np.arange(len(self.depends)) + int(self.axis(axis)[-1]) + 1

    def family(self, axis: int, depends: str) -> Ints:
        """Those of :meth:`nuisance_forces` with one dependence."""
        return self.nuisance_forces(axis)[[dependence == depends for dependence in self.depends]]


@dataclass(frozen=True, slots=True)
class DesignMatrix(Linearisation):
    """The columns of the regression before whitening, and their layout.

    ``columns`` drive the states [T, 6, C] and the readings [T, 6, C]; ``force_range`` [3] is that of the trial
    (N, N, N m), of which ``tolerance`` is a share.
    """

    columns: Columns
    layout: ColumnLayout
    force_range: Floats


@dataclass(frozen=True, slots=True)
class NormalEquations(Linearisation):
    """The regression z = S a + N b + e of a log's whitened data, as Gram matrices of its C columns.

    ``layout`` is the meaning of the columns; ``force_range`` [3] (N, N, N m); ``noise`` (SI) whitened the data;
    ``gram`` has the inner products by leg [L, C, C]; ``nuisance`` [n] are the columns of N and
    ``nuisance_scale`` [n] the standard deviations of b.
    """

    layout: ColumnLayout
    force_range: Floats
    noise: DisturbanceNoise
    gram: Floats
    nuisance: Ints
    nuisance_scale: Floats


def weigh_evidence(estimate: NoiseEstimate) -> Evidence:
    """The third stage: the evidence for every effect of the catalogue at once."""
    return evidence_of(normal_equations(estimate.linearisation, estimate.noise))


def normal_equations(
    linearisation: Linearisation,
    noise: DisturbanceNoise,
    interactions: Sequence[str] = (),
    progress: Progress = lambda share: None,
    number: int = FEATURES,
) -> NormalEquations:
    """The regression of a log's whitened data on effects and nuisances, as Gram matrices of its columns.

    ``interactions`` are effects that may vary with the operating point (:mod:`.nuisance_basis`); the tolerance
    has ``number`` features for each force axis.
    """
    design = design_matrix(linearisation, number, interactions)
    gram = gram_matrices(design.log, design.linear, design.columns, noise, progress)
    return NormalEquations(
        design.log, design.model, design.tolerance, design.linear, design.effects, design.layout,
        design.force_range, noise, gram, *_nuisances(design),
    )  # fmt: skip


def design_matrix(
    linearisation: Linearisation, number: int = FEATURES, interactions: Sequence[str] = ()
) -> DesignMatrix:
    """All columns of the regression before whitening, with ``number`` tolerance features for each force axis."""
    log, model, linear = linearisation.log, linearisation.model, linearisation.linear
    effects = linearisation.effects
    wind = wind_errors(log, model, linear.origin)
    extent = force_range(log, model.base, linear.origin)
    force_features = features(log, linear.origin, number)
    basis = nuisance_basis(log, linear.origin, effects, interactions)
    varying = tuple(signature.effect for signature in basis.varying)
    of = [model.catalogue[label.split("*")[0]] for label in varying]
    layout = ColumnLayout(
        effect=tuple(signature.effect for signature in effects),
        prior=np.array(
            [model.catalogue[signature.effect].free_scale[signature.coordinate] for signature in effects]
        ),
        tolerated=tolerances(log, model.catalogue, effects),
        wind=len(wind),
        features=force_features.shape[1],
        varying=varying,
        varying_prior=np.array([effect.free_scale[0] for effect in of]),
        varying_tolerated=np.array([_tolerated_size(*pair) for pair in zip(varying, of, strict=True)]),
        depends=basis.depends,
    )
    columns = columns_of(linear, [*effects, *wind, *basis.varying], np.hstack([force_features, basis.features]))
    return DesignMatrix(log, model, linearisation.tolerance, linear, effects, columns, layout, extent)


def _tolerated_size(label: str, effect: Effect) -> float:
    """The allowed variation of an effect in the way that its label states; none for its form."""
    return 0.0 if label.split("*")[1] in INTERACTIONS else _UNEVEN * effect.smallest_free[0]


def tolerated_forces(design: DesignMatrix) -> Floats:
    """The model's tolerance in each body axis [3], in the filter's units."""
    return np.asarray(design.tolerance * design.force_range / FORCE_UNITS)


def _nuisances(design: DesignMatrix) -> tuple[Ints, Floats]:
    """The nuisance columns and the standard deviation of each."""
    layout = design.layout
    tolerated = np.flatnonzero(layout.tolerated > 0.0)
    wind = np.arange(layout.wind) + layout.first_wind
    columns = [1 + tolerated, wind]
    scale = [layout.tolerated[tolerated], np.full(layout.wind, wind_error_mps(design.model))]
    for axis, force in enumerate(tolerated_forces(design)):
        columns.append(layout.axis(axis))
        scale.append(np.full(layout.features, force / np.sqrt(layout.features)))
        for depends in dict.fromkeys(layout.depends):
            family = layout.family(axis, depends)
            columns.append(family)
            scale.append(np.full(len(family), TOLERATED_SHARE[depends] * force / np.sqrt(len(family))))
    uneven = np.flatnonzero(layout.varying_tolerated > 0.0)
    columns.append(uneven + layout.first_varying)
    scale.append(layout.varying_tolerated[uneven])
    return np.concatenate(columns), np.concatenate(scale)


def gram_matrices(
    log: Log,
    linear: LinearModel,
    columns: Columns,
    noise: DisturbanceNoise,
    progress: Progress = lambda share: None,
) -> Floats:
    """Gram matrices of all whitened columns by leg [L, C, C]; only a few legs are in memory at a time."""
    result = np.empty((log.legs, columns.count, columns.count))
    for first in range(0, log.legs, _LEGS_AT_ONCE):
        chosen = (log.leg >= first) & (log.leg < first + _LEGS_AT_ONCE)
        part = log.subset(chosen)
        z, _ = whiten(subset_of(linear, chosen), subset_of(columns, chosen), noise, part.edges)
        for leg in range(part.legs):
            block = z[part.leg == leg].reshape(-1, columns.count)
            result[first + leg] = block.T @ block
        progress(min(1.0, (first + _LEGS_AT_ONCE) / log.legs))
    return result


def subset_of(arrays: Arrays, rows: NDArray[np.bool_]) -> Arrays:
    """Some seconds of a linear model, or of columns."""
    return type(arrays)(*(getattr(arrays, attribute.name)[rows] for attribute in fields(arrays)))


# Clocks that may be wrong at once: where all records are late by the same none is, and three are as the fourth.
_CLOCKS = 2


@dataclass(frozen=True)
class Evidence:
    """The result of the third stage: the data's evidence on P free coordinates of effects, nuisances
    marginalised.

    ``inner`` [1+P, 1+P] are inner products under the inverse of V, of the data without any effect (column 0)
    and of the effects' signatures; ``equations`` is the regression that they come from.
    """

    inner: Floats
    equations: NormalEquations

    @cached_property
    def left_out(self) -> Floats:
        """The inner products with each leg left out [L, 1+P, 1+P]."""
        legs = self.equations.gram
        return np.array([_restored(self.equations, gram) for gram in legs.sum(axis=0) - legs])

    @cached_property
    def alone(self) -> Floats:
        """The inner products of each leg by itself [L, 1+P, 1+P]."""
        return np.array([_restored(self.equations, gram) for gram in self.equations.gram])

    @property
    def names(self) -> tuple[str, ...]:
        """All effects."""
        return tuple(self.equations.model.catalogue)

    def columns(self, names: Sequence[str]) -> tuple[int, ...]:
        """The columns of some effects, in their order."""
        by_effect = _columns_by_effect(self.equations.layout.effect)
        return tuple(column for name in names for column in by_effect.get(name, ()))

    def prior(self, names: Sequence[str]) -> Floats:
        """The standard deviations of their priors."""
        return np.asarray(self.equations.layout.prior[np.array(self.columns(names), dtype=int) - 1])

    def log_odds(self, names: Sequence[str]) -> float:
        """Log odds of these effects against none, less a penalty on each, since one of many gains by chance."""
        if not names:
            return 0.0
        return log_evidence(self.inner, self.columns(names), self.prior(names)) - len(names) * log(len(self.names))

    def chance(self, gain: float, degrees: int) -> float:
        """The probability that, of all effects of the catalogue, any gains as much by chance (Sidak 1967)."""
        single = min(float(chi2.sf(max(gain, 0.0), degrees)), 1.0 - 1e-12)
        return -expm1(len(self.names) * log1p(-single))

    def fit(self, names: Sequence[str], prior: bool = False) -> JointFit:
        """The joint fit of ``names`` by least squares, or with their priors its posterior mode."""
        return fit_columns(self.inner, self.columns(names), self.prior(names) if prior else None)

    def places(self, fit: JointFit, name: str) -> list[int]:
        """The positions of an effect's coordinates in a fit."""
        return [fit.columns.index(column) for column in self.columns([name])]

    def possible(self, names: Sequence[str]) -> bool:
        """Whether these effects can be present together, with all values within bounds."""
        return self.compatible(names) and all(value is not None for value in self.values(names).values())

    def compatible(self, names: Sequence[str]) -> bool:
        """Whether these effects can be present together: at most two clocks are wrong.

        No effect can be both constant over the trial and different in a part of it.
        """
        effects = [self.equations.model.catalogue[name] for name in names]
        late = sum(effect.family == "clock" for effect in effects)
        return late <= _CLOCKS and len({effect.base for effect in effects}) == len(effects)

    def beside(self, at: Mapping[str, tuple[float, ...]]) -> Evidence:
        """The evidence of the other effects, given the free coordinates of those in ``at``."""
        if not at:
            return self
        back = np.eye(len(self.inner))
        for name, free in at.items():
            back[list(self.columns([name])), 0] = -np.array(free)
        return replace(self, inner=back.T @ self.inner @ back)

    def values(self, names: Sequence[str]) -> dict[str, dict[str, float] | None]:
        """The fitted parameters of each effect, None if they are out of bounds."""
        fit, result = self.fit(names, prior=True), dict[str, dict[str, float] | None]()
        for name in names:
            free = fit.values[self.places(fit, name)].tolist()
            try:
                result[name] = self.equations.model.values(name, free)
            except ConfigurationError:
                result[name] = None
        return result


def evidence_of(equations: NormalEquations) -> Evidence:
    """The evidence for every effect, with the model's own effects added back into the data."""
    return Evidence(_restored(equations, equations.gram.sum(axis=0)), equations)


def _restored(equations: NormalEquations, gram: Floats) -> Floats:
    return restored_gram(equations, gram, equations.nuisance_scale)[0]


def restored_gram(equations: NormalEquations, gram: Floats, scale: Floats) -> tuple[Floats, float]:
    """Reduced inner products of the data without any effect and of all effects, and the log determinant of V."""
    kept = np.arange(1 + len(equations.layout.effect))
    inner, determinant = marginalise(gram, kept, equations.nuisance, scale)
    back = np.eye(len(kept))
    back[:, 0] = restored_data(equations)[kept]
    return back.T @ inner @ back, determinant


def restored_data(equations: NormalEquations) -> Floats:
    """The data with the model's own effects added back, as a linear combination of all columns [C]."""
    back = np.zeros(equations.gram.shape[1])
    back[0] = 1.0
    for name, free in equations.model.at.items():
        back[list(equations.layout.of(name))] = free
    return back
