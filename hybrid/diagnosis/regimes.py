"""New effects from residuals: the operating regime that explains most of them, fitted and tested.

If something systematic remains beside the named effects, or nothing can be named, the force that the model
lacks second by second is searched for the regime in which it acts: astern or ahead, slow or fast, sideways,
with a tunnel thruster while under way, with the wind from one side. The regime that explains most of one axis'
force in held-out parts of the trial becomes an effect like any other (:mod:`seatrial.hybrid.effects.regime`): it is
fitted, and kept if it is found in most parts of the trial and brings predictions of held-out legs closer.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf
from typing import TypeAlias

import numpy as np

from seatrial.acquisition.core.quantities import Floats, Ints
from seatrial.hybrid.diagnosis.acceptance import score_spread
from seatrial.hybrid.diagnosis.coarse_model import MOST_PARTS, improves_prediction, replications, unseen_m
from seatrial.hybrid.diagnosis.evidence import AXES, FEW, Evidence, evidence_of, normal_equations
from seatrial.hybrid.diagnosis.gap import UnseenWindows, evidence_within, evidence_without, fold_of
from seatrial.hybrid.diagnosis.linearise import Linearisation, signatures
from seatrial.hybrid.diagnosis.map import map_of, round_edges
from seatrial.hybrid.diagnosis.result import Replication
from seatrial.hybrid.diagnosis.select_effects import relinearise_at_fit
from seatrial.hybrid.effects import Effect
from seatrial.hybrid.effects.regime import Regime, quantities_along, regime_effect

_LEAST_S = 30  # of a regime: about a time constant of the ship
_LEAST_SHARE, _FEW = 0.2, 3  # of an axis' missing force; number of regimes
_PLAIN = 0.02  # extra share required for a higher power or another edge
_SECOND = 0.05  # extra share required for a second span
_GROWING = ("speed_mps", "sway_mps", "yaw_rate_dps", "rpm", "wind_mps")
_FINEST = {
    "speed_mps": 0.25, "surge_mps": 0.25, "sway_mps": 0.25, "yaw_rate_dps": 0.25, "wind_mps": 1.0,
    "drift_angle_deg": 5.0, "azimuth_deg": 5.0, "rudder_deg": 2.0, "nozzle_deg": 2.0,
}  # fmt: skip
_FINEST_RPM = 10.0
_ONLY_RUNNING = ("azimuth_deg", "nozzle_deg")  # meaningful only while it pushes


@dataclass(frozen=True, slots=True)
class FoundRegime:
    """A regime, the effect that it is written as, and the evidence for it.

    ``value`` and ``error`` are the force (N, or N m in yaw) and its standard error; ``share`` is its share of
    the missing force of its axis, ``after_m`` the mean distance on held-out legs with it and those found before
    [m].
    """

    name: str
    regime: Regime
    value: float
    error: float
    share: float
    replicated: Replication
    after_m: float


_Priced: TypeAlias = tuple[Regime, float]


@dataclass(frozen=True, slots=True)
class TriedRegime:
    """A regime, its force, the share that it explains, and the extra share required of it for its complexity."""

    regime: Regime
    size: float
    share: float
    price: float

    @property
    def worth(self) -> float:
        return self.share - self.price


def find_regimes(quantities: Mapping[str, Floats], force: Floats, fold: Ints) -> list[TriedRegime]:
    """The regime that explains most of each axis of ``force`` [T, 3], its force and share, the largest first.

    ``quantities`` are [T] each, ``fold`` [T] the part of the trial of each second: shares are computed on parts
    that were not used for the size. No regime for an axis where none explains a fifth.
    """
    tried = list(_candidates(quantities))
    best = [
        _narrowed(candidate, tried, quantities, force, fold) for candidate in _best(tried, quantities, force, fold)
    ]
    return sorted(best, key=lambda regime: -regime.share)


def _narrowed(
    widest: TriedRegime, tried: Sequence[_Priced], quantities: Mapping[str, Floats], force: Floats, fold: Ints
) -> TriedRegime:
    """A regime restricted by a second span, where that explains enough more."""
    more = [
        (replace(widest.regime, within={**widest.regime.within, **second.within}), widest.price + _SECOND)
        for second, _ in tried
        if second.grows_with is None and widest.regime.within and not {*second.within} & {*widest.regime.within}
    ]
    same = [
        candidate
        for candidate in _best(more, quantities, force, fold)
        if candidate.regime.axis == widest.regime.axis
    ]
    return max([widest, *same], key=lambda candidate: candidate.worth)


def _candidates(quantities: Mapping[str, Floats]) -> Iterator[_Priced]:
    """Regimes of one span, or of none, and the extra share required of each for its complexity."""
    names = [name for name in quantities if name in _GROWING or name.endswith("_rpm")]
    growing = {name: _round(quantities[name]) for name in names}
    for growth, at in growing.items():
        yield Regime("", {}, growth, at), _PLAIN
    for name, values in quantities.items():
        for span, price in _spans(name, values):
            if name not in _ONLY_RUNNING:
                yield Regime("", {name: span}), price
            for growth, at in growing.items():
                side = -1.0 if growth == name and span[1] <= 0.0 else 1.0
                yield Regime("", {name: span}, growth, side * at), price + _PLAIN


def _spans(name: str, values: Floats) -> Iterator[tuple[tuple[float, float], float]]:
    """Spans on either side of zero, on either side of each round edge, and between two edges."""
    finite = values[np.isfinite(values)]
    if len(finite) < _LEAST_S:
        return
    if name == "relative_wind_deg":
        yield from ((arc, _PLAIN) for arc in itertools.combinations(np.arange(-180.0, 181.0, 45.0).tolist(), 2))
        return
    low, high = (float(quantile) for quantile in np.quantile(finite, (0.02, 0.98)))
    edges = round_edges(low, high, _FINEST.get(name, _FINEST_RPM)).tolist()
    for edge, price in [
        *([(0.0, 0.0)] if low < 0.0 < high else []),
        *((inner_edge, _PLAIN) for inner_edge in edges),
    ]:
        yield (-inf, edge), price
        yield (edge, inf), price
    for pair in itertools.pairwise(edges):
        yield pair, 2.0 * _PLAIN


def _round(values: Floats) -> float:
    """A round number near the largest magnitude of a quantity."""
    size = float(np.nanquantile(np.abs(values), 0.95))
    return float(f"{size:.1g}") if size > 0.0 else 1.0


def shape_of(regime: Regime, quantities: Mapping[str, Floats]) -> Floats:
    """The share of a regime's force that acts in each second [T]."""
    shape = np.ones(len(next(iter(quantities.values()))))
    if regime.grows_with is not None:
        growth = quantities[regime.grows_with]
        shape = growth * np.abs(growth) / (regime.at * abs(regime.at))
    for name, (low, high) in regime.within.items():
        with np.errstate(invalid="ignore"):
            shape = np.where((quantities[name] >= low) & (quantities[name] < high), shape, 0.0)
    return np.asarray(shape)


def _best(
    tried: Sequence[_Priced], quantities: Mapping[str, Floats], force: Floats, fold: Ints
) -> list[TriedRegime]:
    """For each axis the regime with the largest share less its required extra, if any explains enough."""
    if not tried:
        return []
    shapes = np.column_stack([shape_of(regime, quantities) for regime, _ in tried])
    price = np.array([cost for _, cost in tried])
    size, share, alike = explained(shapes, force, fold)
    enough = alike & (np.count_nonzero(shapes, axis=0) >= _LEAST_S)[:, None] & (share > _LEAST_SHARE)
    worth = np.where(enough, share - price[:, None], -inf)
    result = []
    for axis, number in enumerate(np.argmax(worth, axis=0).tolist()):
        if enough[number, axis]:
            regime = replace(tried[number][0], axis=AXES[axis])
            result.append(TriedRegime(regime, float(size[number, axis]), float(share[number, axis]), price[number]))
    return result


def explained(shapes: Floats, force: Floats, fold: Ints) -> tuple[Floats, Floats, Floats]:
    """The size, share of ``force`` [T, 3] and consistency over parts of each of ``shapes`` [T, M]: [M, 3] each.

    The share is that of the squares in each part with the size fitted to all others; consistent
    means that most parts agree in sign.
    """
    parts = [fold == index for index in np.unique(fold)]
    products = np.array([shapes[part].T @ force[part] for part in parts])
    squares = np.array([(shapes[part] ** 2).sum(axis=0) for part in parts])[:, :, None]
    total, norm = products.sum(axis=0), np.maximum(squares.sum(axis=0), 1e-12)
    other_sizes = (total - products) / np.maximum(norm - squares, 1e-12)
    taken = (2.0 * other_sizes * products - other_sizes**2 * squares).sum(axis=0)
    share = taken / np.maximum((force**2).sum(axis=0), 1e-12)
    agree = (np.sign(products) == np.sign(total)).mean(axis=0) >= MOST_PARTS
    return total / norm, share, agree


def largest_regimes(bare: Evidence, windows: UnseenWindows) -> tuple[FoundRegime, ...]:
    """The regimes in which the model as it is lacks most, whatever was named; ``bare`` is its evidence.

    Without the missing effect in the catalogue, a search names imitations of it. Regimes are added one after
    the other as long as each explains a fifth of an axis' remaining force and brings predictions of held-out
    legs closer.
    """
    regimes, now = list[FoundRegime](), _Fitted.of(bare, (), windows)
    while len(regimes) < _FEW:
        better = next(filter(None, (_added(now, windows, candidate) for candidate in _lacking(now.evidence))), None)
        if better is None:
            break
        regimes.append(better[0])
        now = _Fitted.of(better[1].evidence, better[1].names, windows)
    return tuple(regimes)


@dataclass(frozen=True, slots=True)
class _Fitted:
    """Effects, the evidence linearised about them, and the mean distance by leg with them [legs with windows]."""

    names: tuple[str, ...]
    evidence: Evidence
    off_m: Floats

    @classmethod
    def of(cls, evidence: Evidence, names: tuple[str, ...], windows: UnseenWindows) -> _Fitted:
        """``names`` fitted, and the evidence linearised about them."""
        linear = relinearise_at_fit(evidence, names, FEW)
        return cls(names, linear, _off_m(windows, linear, names))

    def with_effect(self, effect: Effect, windows: UnseenWindows) -> _Fitted:
        """The same with one more effect; only its signature is new."""
        equations, names = self.evidence.equations, (*self.names, effect.name)
        model = replace(equations.model, catalogue={**equations.model.catalogue, effect.name: effect})
        added = signatures(equations.log, model, equations.linear.origin, [effect.name])
        effects = (*equations.effects, *added)
        wider = Linearisation(equations.log, model, equations.tolerance, equations.linear, effects)
        evidence = evidence_of(normal_equations(wider, equations.noise, number=FEW))
        return _Fitted(names, evidence, _off_m(windows, evidence, names))


def _added(now: _Fitted, windows: UnseenWindows, tried: TriedRegime) -> tuple[FoundRegime, _Fitted] | None:
    """A regime fitted beside the existing effects; None if it gains too little or is not consistent."""
    regime = tried.regime
    effect = regime_effect(_name_of(regime), regime, tried.size)
    if effect.name in now.names:
        return None
    fitted = now.with_effect(effect, windows)
    parts = tuple(evidence_within(windows, fitted.evidence).values())
    replicated = replications(fitted.evidence, fitted.names, parts)[effect.name]
    if not improves_prediction(now.off_m, fitted.off_m) or replicated.found < MOST_PARTS * replicated.parts:
        return None
    value, error = _size(fitted, effect.name)
    after_m = float(fitted.off_m.mean())
    result = FoundRegime(effect.name, regime, value, error, tried.share, replicated, after_m)
    return result, fitted


def _size(fitted: _Fitted, name: str) -> tuple[float, float]:
    """The size of a one-parameter effect and its standard error, from the scatter between legs."""
    evidence, names = fitted.evidence, fitted.names
    fit = evidence.fit(names, prior=True)
    (place,) = evidence.places(fit, name)
    spread = score_spread(evidence, names, name)
    return float(fit.values[place]), float(np.sqrt(spread * fit.covariance[place, place]))


def _lacking(evidence: Evidence) -> list[TriedRegime]:
    """The regimes in which the model with its effects lacks most."""
    log, linear = evidence.equations.log, evidence.equations.linear
    seen = quantities_along(log.actuators, linear.origin, log.controls.mean(axis=1), log.wind)
    return find_regimes(seen, map_of(evidence.equations, with_effects=True).force, fold_of(log))


def _off_m(windows: UnseenWindows, evidence: Evidence, names: Sequence[str]) -> Floats:
    """The mean distance by leg with ``names`` at the sizes fitted to the other folds [legs with windows]."""
    catalogue = evidence.equations.model.catalogue
    extended = replace(windows, model=replace(windows.model, catalogue=catalogue))
    return unseen_m(extended, evidence_without(extended, evidence), names)


def _name_of(regime: Regime) -> str:
    """A name from the axis and the regime: ``surge_force_rpm_below_0``."""
    spans = [_span_name(quantity, *span) for quantity, span in regime.within.items()]
    growth = [] if regime.grows_with is None or spans else [f"with_{_bare(regime.grows_with)}"]
    return "_".join([regime.axis, "moment" if regime.axis == "yaw" else "force", *(spans or growth)])


def _span_name(quantity: str, low: float, high: float) -> str:
    name = _bare(quantity)
    begin, end = (f"{edge:g}".replace("-", "minus_").replace(".", "p") for edge in (low, high))
    if low == -inf:
        return f"{name}_below_{end}"
    return f"{name}_above_{begin}" if high == inf else f"{name}_{begin}_to_{end}"


def _bare(quantity: str) -> str:
    return quantity.removesuffix("_mps").removesuffix("_deg").removesuffix("_dps")
