"""One look at a log through one model: whitened columns, and what they say of every effect at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from acquisition.core.arrays import Floats, Ints
from acquisition.core.progress import Progress
from hybrid.diagnosis.evidence import Products
from hybrid.diagnosis.innovations import Columns, columns_of, whitened
from hybrid.diagnosis.linearise import Linear, Model, Signature, linear_model, signatures
from hybrid.diagnosis.log import Log
from hybrid.diagnosis.noise import FORCE_UNITS, Noise
from hybrid.diagnosis.nuisance_basis import FORMS, GRANTED, beyond
from hybrid.diagnosis.tolerance import FEATURES, ForceRange, features, force_range
from hybrid.diagnosis.tolerated import WIND_MPS, tolerances, wind_errors
from hybrid.effects import Effect

Arrays = TypeVar("Arrays", Linear, Columns)

_LEGS_AT_ONCE = 4
_UNEVEN = 0.2  # of the smallest size of interest: no current or gyro is quite steady


@dataclass(frozen=True, slots=True)
class Layout:
    """Which column of the products is what: data 0, then effects, tolerated wind errors, varied effects, features.

    ``effect`` [P] names each effect column's effect, ``varied`` that of each varied one with what it varies with;
    ``features`` counts the tolerance's features a force axis; those of what is in no catalogue stand behind them in
    each axis, and ``depends`` says on what each depends.
    """

    effect: tuple[str, ...]
    prior: Floats
    tolerated: Floats
    wind: int
    features: int
    varied: tuple[str, ...]
    varied_prior: Floats
    varied_granted: Floats
    depends: tuple[str, ...]

    def of(self, name: str) -> tuple[int, ...]:
        """The columns of an effect."""
        return tuple(1 + number for number, each in enumerate(self.effect) if each == name)

    @property
    def first_wind(self) -> int:
        """The first of the wind errors' columns."""
        return 1 + len(self.effect)

    @property
    def first_feature(self) -> int:
        """The first of the force features' columns."""
        return self.first_varied + len(self.varied)

    @property
    def first_varied(self) -> int:
        """The first of the varied effects' columns."""
        return self.first_wind + self.wind

    def axis(self, axis: int) -> Ints:
        """The columns of the tolerance's features in a body axis."""
        return np.arange(self.features) + self.first_feature + axis * (self.features + len(self.depends))

    def beyond(self, axis: int) -> Ints:
        """The columns of the features of what is in no catalogue, in a body axis."""
        return np.arange(len(self.depends)) + int(self.axis(axis)[-1]) + 1


@dataclass(frozen=True, slots=True)
class Examination:
    """What one pass over a log gives: see the modules that it calls."""

    log: Log
    model: Model
    linear: Linear
    effects: tuple[Signature, ...]
    range: ForceRange
    tolerance: float
    noise: Noise
    layout: Layout
    products: Products
    nuisance: Ints
    nuisance_scale: Floats


@dataclass(frozen=True, slots=True)
class Look:
    """A log seen through a model, before any noise is known."""

    linear: Linear
    effects: tuple[Signature, ...]
    columns: Columns
    layout: Layout
    range: ForceRange
    tolerance: float


def examined(
    log: Log,
    model: Model,
    tolerance: float,
    noise: Noise,
    progress: Progress = lambda share: None,
    forms: Sequence[str] = (),
    known_effects: Sequence[Signature] | None = None,
) -> Examination:
    """Examine ``log`` through ``model``, which may have effects in it already.

    ``tolerance`` is the share of the force range that the model may be off by; ``forms`` are effects whose form is
    in question (:mod:`.beyond`); ``known_effects`` are signatures that are at hand.
    """
    look = looked_at(log, model, tolerance, known_effects=known_effects, forms=forms)
    nuisance, scale = _nuisances(look)
    products = products_of(log, look.linear, look.columns, noise, progress)
    return Examination(
        log, model, look.linear, look.effects, look.range, tolerance, noise, look.layout, products, nuisance, scale
    )


def looked_at(
    log: Log,
    model: Model,
    tolerance: float,
    number: int = FEATURES,
    known_effects: Sequence[Signature] | None = None,
    forms: Sequence[str] = (),
) -> Look:
    """A look with so many features of the tolerance a force; ``known_effects`` are signatures that are at hand."""
    linear = linear_model(log, model.plant())
    effects = known_effects or signatures(log, model, linear.origin, list(model.catalogue))
    wind = wind_errors(log, model, linear.origin)
    extent = force_range(log, model.base, linear.origin)
    known = features(log, linear.origin, number)
    more = beyond(log, linear.origin, effects, forms)
    columns = columns_of(linear, [*effects, *wind, *more.varied], np.hstack([known, more.features]))
    varied = tuple(each.effect for each in more.varied)
    of = [model.catalogue[label.split("*")[0]] for label in varied]
    layout = Layout(
        effect=tuple(each.effect for each in effects),
        prior=np.array([model.catalogue[each.effect].free_scale[each.coordinate] for each in effects]),
        tolerated=tolerances(log, model.catalogue, effects),
        wind=len(wind),
        features=known.shape[1],
        varied=varied,
        varied_prior=np.array([each.free_scale[0] for each in of]),
        varied_granted=np.array([_granted(*each) for each in zip(varied, of, strict=True)]),
        depends=more.depends,
    )
    return Look(linear, tuple(effects), columns, layout, extent, tolerance)


def _granted(label: str, effect: Effect) -> float:
    """How uneven an effect may be in the way that its label says; of its form it is granted nothing."""
    return 0.0 if label.split("*")[1] in FORMS else _UNEVEN * effect.smallest_free[0]


def tolerated_forces(look: Look) -> Floats:
    """The model's tolerance in each body axis [3], in the filter's units."""
    return np.asarray(look.tolerance * look.range.as_array() / FORCE_UNITS)


def _nuisances(look: Look) -> tuple[Ints, Floats]:
    """The columns that stand for what is tolerated, and the standard deviation of each."""
    layout = look.layout
    some = np.flatnonzero(layout.tolerated > 0.0)
    wind = np.arange(layout.wind) + layout.first_wind
    columns, scale = [1 + some, wind], [layout.tolerated[some], np.full(layout.wind, WIND_MPS)]
    for axis, force in enumerate(tolerated_forces(look)):
        columns.append(layout.axis(axis))
        scale.append(np.full(layout.features, force / np.sqrt(layout.features)))
        for depends in dict.fromkeys(layout.depends):
            own = layout.beyond(axis)[[each == depends for each in layout.depends]]
            columns.append(own)
            scale.append(np.full(len(own), GRANTED[depends] * force / np.sqrt(len(own))))
    uneven = np.flatnonzero(layout.varied_granted > 0.0)
    columns.append(uneven + layout.first_varied)
    scale.append(layout.varied_granted[uneven])
    return np.concatenate(columns), np.concatenate(scale)


def products_of(
    log: Log, linear: Linear, columns: Columns, noise: Noise, progress: Progress = lambda share: None
) -> Products:
    """The products of all whitened columns, leg by leg; a few legs are in memory at a time."""
    result = np.empty((log.legs, columns.count, columns.count))
    rows = np.empty(log.legs, dtype=np.int64)
    for first in range(0, log.legs, _LEGS_AT_ONCE):
        chosen = (log.leg >= first) & (log.leg < first + _LEGS_AT_ONCE)
        part = log.subset(chosen)
        z, _ = whitened(some_of(linear, chosen), some_of(columns, chosen), noise, part.edges)
        for leg in range(part.legs):
            block = z[part.leg == leg].reshape(-1, columns.count)
            result[first + leg] = block.T @ block
            rows[first + leg] = np.isfinite(part.measured[part.leg == leg]).sum()
        progress(min(1.0, (first + _LEGS_AT_ONCE) / log.legs))
    return Products(result, rows)


def some_of(arrays: Arrays, rows: NDArray[np.bool_]) -> Arrays:
    """Some seconds of a linear model, or of columns."""
    return type(arrays)(*(getattr(arrays, each.name)[rows] for each in fields(arrays)))
