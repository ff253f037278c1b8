"""Where model and trial disagree: the missing force cell by cell, and the regimes that explain most of it.

A cell holds the seconds of a log that are similar in speed, turning, drift, heading, wind, thrusters, time or
position; its edges are round numbers that a person can quote. Each cell has a steady force on each body axis,
estimated through the filter with all disturbances and sensor tolerances, and the mean errors of one-second
predictions, with standard errors from their scatter between legs. The map is for people: the selection of
effects does not use it.

If something systematic remains beside the named effects, or nothing can be named, the missing force is searched
for the regime in which it acts: astern or ahead, slow or fast, sideways, with a tunnel thruster while under
way, with the wind from one side. The regime that explains most of one axis' force in held-out parts of the
trial becomes an effect like any other (:mod:`seatrial.hybrid.effects`): it is fitted, and kept if it is
found in most parts of the trial and brings predictions of held-out legs closer.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf
from typing import TypeAlias

import numpy as np
from scipy.stats import norm, t

from seatrial.acquisition.core import ship
from seatrial.acquisition.core.quantities import Bools, Floats, Ints
from seatrial.hybrid.diagnosis import acceptance, coarse_model, disturbance_model, gap, linearise, regression
from seatrial.hybrid.diagnosis.log import Log
from seatrial.hybrid.diagnosis.result import FORCES, GapCell, Map, Replication
from seatrial.hybrid.effects import Regime, quantities_along, regime_effect, steering_angles
from seatrial.hybrid.vessel.actuators import control_units

LEAST_S = 20
"""A cell of fewer seconds is none."""

_WANTED = 5  # cells a quantity, about
_ROUND = (1.0, 2.0, 2.5, 5.0, 10.0)
_RUNNING_RPM = 5.0
_QUARTERS, _GRID = 4, 3
_FINEST = {
    "speed_mps": 0.25, "yaw_rate_dps": 0.25, "drift_angle_deg": 1.0, "azimuth_deg": 2.0, "rudder_deg": 1.0,
    "nozzle_deg": 1.0, "pitch_percent": 5.0,
}  # fmt: skip

_FINEST_SHAFT_RPM, _FINEST_TUNNEL_RPM = 5.0, 10.0
"""The finest cell width of each quantity; finer cells would separate what no sensor or drive resolves."""

SIGNIFICANT = 0.05
"""The probability that the map of an exact model shows anything."""

_MOST, _LEAST = 40, 10
_ENOUGH_LEGS = 10
_SLOW_S = 60.0
_DEGREES = np.array([1.0, 1.0, np.degrees(1.0), 1.0, 1.0, np.degrees(1.0)])
_WIDE = 10.0  # prior standard deviation of a cell's force, in force ranges
_LEAST_S = 30  # of a regime: about a time constant of the ship
_LEAST_SHARE, _FEW = 0.2, 3  # of an axis' missing force; number of regimes
_PLAIN = 0.02  # extra share required for a higher power or another edge
_SECOND = 0.05  # extra share required for a second span
_GROWING = ("speed_mps", "sway_mps", "yaw_rate_dps", "rpm", "wind_mps")
_FINEST_STEP = {
    "speed_mps": 0.25, "surge_mps": 0.25, "sway_mps": 0.25, "yaw_rate_dps": 0.25, "wind_mps": 1.0,
    "drift_angle_deg": 5.0, "azimuth_deg": 5.0, "rudder_deg": 2.0, "nozzle_deg": 2.0,
}  # fmt: skip
_FINEST_STEP_RPM = 10.0
_ONLY_RUNNING = ("azimuth_deg", "nozzle_deg")  # meaningful only while it pushes


@dataclass(frozen=True, slots=True)
class MapCell:
    """Some seconds of a log, ``rows`` [T], and the spans that define them: from, to (less than)."""

    quantity: str
    span: dict[str, tuple[float, float]]
    rows: Bools


def cell_quantities(log: Log, origin: Floats) -> dict[str, Floats]:
    """The quantities of the cells, each [T], NaN where undefined: without speed there is no drift angle.

    Of the actuators' settings: mean shaft speed of the propulsors, differences between them, their mean pitch, the
    mean angle of each kind that has one (of propulsors while they run), each tunnel thruster's shaft speed.
    """
    controls = log.controls.mean(axis=1)
    along = quantities_along(log.actuators, origin, controls, log.wind)
    by_control = (controls / control_units(log.actuators)).T
    mean, drives = dict(zip(ship.control_names(log.actuators), by_control, strict=True)), ship.shafts(log.actuators)
    settings = {"rpm": along["rpm"]} if drives else {}  # signed: thrust astern differs from thrust ahead
    for first, second in itertools.pairwise(drives):
        settings[f"{first}_less_{second}_rpm"] = mean[f"{first}_rpm"] - mean[f"{second}_rpm"]
    pitches = [np.abs(values) for name, values in mean.items() if name.endswith("_pitch_percent")]
    settings |= {"pitch_percent": np.mean(pitches, axis=0)} if pitches else {}
    for quantity, names in steering_angles(log.actuators).items():
        shafts = [np.abs(mean[f"{name}_rpm"]) for name in names if name in drives]
        running = np.max(shafts, axis=0) > _RUNNING_RPM if len(shafts) == len(names) else True
        settings[quantity] = np.where(running, along[quantity], np.nan)
    settings |= {f"{name}_rpm": along[f"{name}_rpm"] for name in ship.names_of_kind(log.actuators, "tunnel")}
    return {
        **{name: along[name] for name in ("speed_mps", "yaw_rate_dps", "drift_angle_deg")},
        "heading_deg": np.degrees(origin[:, 2]) % 360.0,
        "relative_wind_deg": along["relative_wind_deg"] % 360.0,
        **settings,
        "time_s": recorded_s(log),
    }


def recorded_s(log: Log) -> Floats:
    """The time since the start of the log [T] in s, without the breaks between recordings."""
    breaks = np.where(np.diff(log.recording) != 0, np.diff(log.time_s) - 1, 0)
    return np.asarray(log.time_s - log.time_s[0] - np.append(0, np.cumsum(breaks)), dtype=np.float64)


def cells_of(log: Log, origin: Floats) -> list[MapCell]:
    """All cells with enough seconds, by quantity, and a grid over the trial's area.

    A quantity with a single cell is left out.
    """
    cells = [
        MapCell(name, {name: span}, _in_span(values, span))
        for name, values in cell_quantities(log, origin).items()
        for span in _spans_of_quantity(name, values)
    ]
    edges = [
        np.linspace(coordinate.min(), np.nextafter(coordinate.max(), inf), _GRID + 1).tolist()
        for coordinate in origin[:, :2].T
    ]
    for north, east in itertools.product(*map(itertools.pairwise, edges)):
        rows = _in_span(origin[:, 0], north) & _in_span(origin[:, 1], east)
        cells.append(MapCell("place", {"north_m": north, "east_m": east}, rows))
    large = [cell for cell in cells if cell.rows.sum() >= LEAST_S]
    several = {
        cell.quantity for cell in large if sum(candidate.quantity == cell.quantity for candidate in large) > 1
    }
    return [cell for cell in large if cell.quantity in several]


def _spans_of_quantity(name: str, values: Floats) -> Iterable[tuple[float, float]]:
    if name in ("heading_deg", "relative_wind_deg"):  # north, or ahead, in the middle of the first
        return [(45.0 * sector - 22.5, 45.0 * sector + 22.5) for sector in range(8)]
    finite = values[np.isfinite(values)]
    if not finite.size:
        return []
    if name == "time_s":
        return itertools.pairwise(np.linspace(0.0, finite.max() + 1.0, _QUARTERS + 1).tolist())
    low, high = (float(quantile) for quantile in np.quantile(finite, (0.01, 0.99)))
    finest = _FINEST_SHAFT_RPM if name == "rpm" or "_less_" in name else _FINEST_TUNNEL_RPM
    inner = round_edges(low, high, _FINEST.get(name, finest)).tolist()
    return itertools.pairwise([float(finite.min()), *inner, float(np.nextafter(finite.max(), inf))])


def round_edges(low: float, high: float, finest: float) -> Floats:
    """Round edges of about five cells over ``low`` to ``high``, none narrower than ``finest`` or half a step.

    If the values lie on both sides of zero, a cell is centred on zero.
    """
    raw = max((high - low) / _WANTED, finest)
    power = 10.0 ** np.floor(np.log10(raw))
    step = power * next(multiple for multiple in _ROUND if multiple >= raw / power - 1e-9)
    shift = 0.5 if low < 0.0 < high else 0.0
    edges = (np.arange(np.floor(low / step), np.ceil(high / step) + 1) + shift) * step
    return np.asarray(edges[(edges > low + 0.5 * step) & (edges < high - 0.5 * step)])


def _in_span(values: Floats, span: tuple[float, float]) -> Bools:
    low, high = span
    with np.errstate(invalid="ignore"):
        inside = (values >= low) & (values < high)
        return inside | (values >= low + 360.0) if low < 0.0 and high - low == 45.0 else inside


def notable_places(places: Sequence[GapCell]) -> tuple[GapCell, ...]:
    """The significant places, corrected for the number of cells, forty at most; at least the ten largest."""
    ranked = sorted(places, key=lambda place: -abs(place.z))
    limit = float(norm.isf(0.5 * SIGNIFICANT / max(len(ranked), 1)))
    sure = sum(abs(place.z) > limit for place in ranked)
    return tuple(ranked[: min(max(sure, _LEAST), _MOST)])


def map_of(equations: regression.NormalEquations, with_effects: bool = False) -> Map:
    """The whole map of the reference model, or of the model ``with_effects`` that were added."""
    linear, log = equations.linear, equations.log
    data = disturbance_model.columns_of(linear, [])
    if not with_effects:
        added = [
            (value, signature)
            for name, free in equations.model.at.items()
            for value, signature in zip(
                free, (candidate for candidate in equations.effects if candidate.effect == name), strict=True
            )
        ]
        drive = data.drive - sum(value * signature.D[:, :, None] for value, signature in added)
        readings = data.readings + sum(value * signature.E[:, :, None] for value, signature in added)
        data = disturbance_model.Columns(np.ascontiguousarray(drive), np.ascontiguousarray(readings), data.features)
    cells = cells_of(log, linear.origin)
    layout = equations.layout
    indices = [int(number) for number in np.flatnonzero(layout.tolerated > 0.0)]
    winds = regression.wind_errors(log, equations.model, linear.origin)
    tolerated = [*(equations.effects[number] for number in indices), *winds]
    scale = np.append(layout.tolerated[indices], np.full(len(winds), regression.wind_error_mps(equations.model)))
    places = _force_of_cells(equations, data, cells, tolerated, scale) + _error_of_cells(
        equations, data, cells, tolerated, scale
    )
    surge, sway, yaw = equations.force_range.tolist()  # a prior wide enough not to shrink the slow force
    any_force = replace(equations.noise, slow=(surge, sway, yaw), slow_s=_SLOW_S)
    force = disturbance_model.smooth_state(linear, data, any_force, log.block_edges)[0][:, 6:]
    return Map(tuple(places), force, cell_quantities(log, linear.origin))


def _force_of_cells(
    equations: regression.NormalEquations,
    data: disturbance_model.Columns,
    cells: Sequence[MapCell],
    tolerated: list[linearise.Signature],
    scale: Floats,
) -> list[GapCell]:
    """The steady force of each cell by generalised least squares, a quantity's cells and axes jointly."""
    extra = disturbance_model.columns_of(equations.linear, tolerated)
    columns = disturbance_model.Columns(
        np.concatenate([data.drive, extra.drive[:, :, 1:]], axis=2),
        np.concatenate([data.readings, extra.readings[:, :, 1:]], axis=2),
        np.column_stack([cell.rows.astype(float) for cell in cells]),
    )
    gram = regression.gram_matrices(equations.log, equations.linear, columns, equations.noise).sum(axis=0)
    nuisance, first = 1 + np.arange(len(tolerated)), 1 + len(tolerated)
    result: list[GapCell] = []
    for quantity in dict.fromkeys(cell.quantity for cell in cells):
        mine = [number for number, cell in enumerate(cells) if cell.quantity == quantity]
        indices = np.concatenate([first + axis * len(cells) + np.array(mine) for axis in range(3)])
        inner, _ = regression.marginalise(gram, np.append(0, indices), nuisance, scale)
        count, extent, unit = len(mine), equations.force_range, disturbance_model.FORCE_UNITS[:, None]
        fit = regression.fit_columns(
            inner, range(1, 1 + 3 * count), np.repeat(_WIDE * extent / disturbance_model.FORCE_UNITS, count)
        )
        force = fit.values.reshape(3, count) * unit
        error = np.sqrt(np.diag(fit.covariance)).reshape(3, count) * unit
        error = np.hypot(error, equations.tolerance * extent[:, None])  # with the tolerances
        for place, number in enumerate(mine):
            for axis, channel in enumerate(FORCES):
                size, z = float(force[axis, place]), float(force[axis, place] / error[axis, place])
                result.append(GapCell(channel, cells[number].span, int(cells[number].rows.sum()), size, z))
    return result


def _error_of_cells(
    equations: regression.NormalEquations,
    data: disturbance_model.Columns,
    cells: Sequence[MapCell],
    tolerated: list[linearise.Signature],
    scale: Floats,
) -> list[GapCell]:
    """The mean error of one-second predictions in each cell and motion channel: measured less predicted.

    With its standard error from the scatter of legs or blocks (White 1980). With few of them the scatter is
    uncertain: the error is widened so that its 95 % interval is that of a normal one.
    """
    log, linear = equations.log, equations.linear
    error = -data.drive[:, :, 0]
    within = np.append(np.diff(log.block) == 0, False)  # nothing predicts across the end of a block
    cluster = log.leg if log.leg_count >= _ENOUGH_LEGS else log.block
    # the change of the errors [T, 6, n] with each tolerated error at its standard deviation: that of a sensor
    # shifts both the start and the end of the second
    parts = [linear.B * (equations.tolerance * equations.force_range)]
    for signature, size in zip(tolerated, scale, strict=True):
        later = np.vstack([signature.E[1:], signature.E[-1:]])
        parts.append((size * (signature.D + later - np.einsum("tij,tj->ti", linear.A, signature.E)))[:, :, None])
    allowance = np.concatenate(parts, axis=2)
    result: list[GapCell] = []
    for cell in cells:
        rows = cell.rows & within
        index = np.unique(cluster[rows], return_inverse=True)[1]
        if rows.sum() < LEAST_S or index.max() < 2:
            continue
        values, count = error[rows], int(index.max()) + 1
        mean, sums = values.mean(axis=0), np.zeros((count, values.shape[1]))
        np.add.at(sums, index, values - mean)
        deviation = np.sqrt((sums**2).sum(axis=0) * count / (count - 1)) / len(values)
        deviation = deviation * t.isf(0.025, count - 1) / norm.isf(0.025)
        deviation = np.hypot(deviation, np.sqrt((allowance[rows].mean(axis=0) ** 2).sum(axis=1)))
        for name, size, z in zip(ship.POSE_AND_VELOCITY, mean * _DEGREES, mean / deviation, strict=True):
            result.append(GapCell(name, cell.span, int(cell.rows.sum()), float(size), float(z)))
    return result


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


def find_regimes(quantities: Mapping[str, Floats], force: Floats, fold: Ints) -> list[TriedRegime]:
    """The regime that explains most of each axis of ``force`` [T, 3], its force and share, the largest first.

    ``quantities`` are [T] each, ``fold`` [T] the part of the trial of each second: shares are computed on parts
    that were not used for the size. No regime for an axis where none explains a fifth.
    """
    tried, best = list(_candidate_regimes(quantities)), list[TriedRegime]()
    for widest in _best_regime_by_axis(tried, quantities, force, fold):
        regime = widest.regime
        narrower = [  # by a second span, where that explains enough more
            (replace(regime, within={**regime.within, **second.within}), widest.price + _SECOND)
            for second, _ in tried
            if second.grows_with is None and regime.within and not {*second.within} & {*regime.within}
        ]
        narrowed = _best_regime_by_axis(narrower, quantities, force, fold)
        same_axis = [candidate for candidate in narrowed if candidate.regime.axis == regime.axis]
        best.append(max([widest, *same_axis], key=lambda candidate: candidate.share - candidate.price))
    return sorted(best, key=lambda candidate: -candidate.share)


def _candidate_regimes(quantities: Mapping[str, Floats]) -> Iterator[_Priced]:
    """Regimes of one span, or of none, and the extra share required of each for its complexity."""
    names = [name for name in quantities if name in _GROWING or name.endswith("_rpm")]
    growing = dict[str, float]()
    for name in names:  # a round number near the largest magnitude
        size = float(np.nanquantile(np.abs(quantities[name]), 0.95))
        growing[name] = float(f"{size:.1g}") if size > 0.0 else 1.0
    for growth, at in growing.items():
        yield Regime("", {}, growth, at), _PLAIN
    for name, values in quantities.items():
        for span, price in _priced_spans(name, values[np.isfinite(values)]):
            if name not in _ONLY_RUNNING:
                yield Regime("", {name: span}), price
            for growth, at in growing.items():
                side = -1.0 if growth == name and span[1] <= 0.0 else 1.0
                yield Regime("", {name: span}, growth, side * at), price + _PLAIN


def _priced_spans(name: str, values: Floats) -> Iterator[tuple[tuple[float, float], float]]:
    """Spans on either side of zero, on either side of each round edge, and between two edges."""
    if len(values) < _LEAST_S:
        return
    if name == "relative_wind_deg":
        yield from ((arc, _PLAIN) for arc in itertools.combinations(np.arange(-180.0, 181.0, 45.0).tolist(), 2))
        return
    low, high = (float(quantile) for quantile in np.quantile(values, (0.02, 0.98)))
    edges = round_edges(low, high, _FINEST_STEP.get(name, _FINEST_STEP_RPM)).tolist()
    zero = [(0.0, 0.0)] if low < 0.0 < high else []
    for edge, price in [*zero, *((edge, _PLAIN) for edge in edges)]:
        yield (-inf, edge), price
        yield (edge, inf), price
    for pair in itertools.pairwise(edges):
        yield pair, 2.0 * _PLAIN


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


def _best_regime_by_axis(
    tried: Sequence[_Priced], quantities: Mapping[str, Floats], force: Floats, fold: Ints
) -> list[TriedRegime]:
    """For each axis the regime with the largest share less its required extra, if any explains enough."""
    if not tried:
        return []
    shapes = np.column_stack([shape_of(regime, quantities) for regime, _ in tried])
    price = np.array([cost for _, cost in tried])
    size, share, alike = explained_shares(shapes, force, fold)
    enough = alike & (np.count_nonzero(shapes, axis=0) >= _LEAST_S)[:, None] & (share > _LEAST_SHARE)
    worth = np.where(enough, share - price[:, None], -inf)
    result = []
    for axis, number in enumerate(np.argmax(worth, axis=0).tolist()):
        if enough[number, axis]:
            regime = replace(tried[number][0], axis=regression.AXES[axis])
            result.append(TriedRegime(regime, float(size[number, axis]), float(share[number, axis]), price[number]))
    return result


def explained_shares(shapes: Floats, force: Floats, fold: Ints) -> tuple[Floats, Floats, Floats]:
    """The size, share of ``force`` [T, 3] and consistency over parts of each of ``shapes`` [T, M]: [M, 3] each.

    The share is that of the squares in each part with the size fitted to all others; consistent
    means that most parts agree in sign.
    """
    parts = [fold == index for index in np.unique(fold)]
    products = np.array([shapes[part].T @ force[part] for part in parts])
    squares = np.array([(shapes[part] ** 2).sum(axis=0) for part in parts])[:, :, None]
    total, norm = products.sum(axis=0), np.maximum(squares.sum(axis=0), 1e-12)
    other_sizes = (total - products) / np.maximum(norm - squares, 1e-12)
    explained_squares = (2.0 * other_sizes * products - other_sizes**2 * squares).sum(axis=0)
    share = explained_squares / np.maximum((force**2).sum(axis=0), 1e-12)
    agree = (np.sign(products) == np.sign(total)).mean(axis=0) >= coarse_model.MOST_PARTS
    return total / norm, share, agree


def largest_regimes(bare: regression.Evidence, windows: gap.UnseenWindows) -> tuple[FoundRegime, ...]:
    """The regimes in which the model as it is lacks most, whatever was named; ``bare`` is its evidence.

    Without the missing effect in the catalogue, a search names imitations of it. Regimes are added one after
    the other as long as each explains a fifth of an axis' remaining force and brings predictions of held-out
    legs closer.
    """
    regimes, evidence, names = list[FoundRegime](), bare, tuple[str, ...]()
    while len(regimes) < _FEW:
        evidence = acceptance.relinearise_at_fit(evidence, names, regression.FEW)
        equations, off_m = evidence.equations, _off_m(windows, evidence, names)
        log, origin = equations.log, equations.linear.origin
        quantities = quantities_along(log.actuators, origin, log.controls.mean(axis=1), log.wind)
        lacking = find_regimes(quantities, map_of(equations, with_effects=True).force, gap.fold_of(log))
        tried = (_try_regime(evidence, names, off_m, windows, candidate) for candidate in lacking)
        better = next(filter(None, tried), None)
        if better is None:
            break
        regime, evidence = better
        regimes.append(regime)
        names = (*names, regime.name)
    return tuple(regimes)


def _try_regime(
    evidence: regression.Evidence,
    names: tuple[str, ...],
    off_m: Floats,
    windows: gap.UnseenWindows,
    tried: TriedRegime,
) -> tuple[FoundRegime, regression.Evidence] | None:
    """A regime fitted beside the effects ``names``, and the evidence with it.

    ``off_m`` is the mean distance by leg without it. None if it gains too little or is not consistent.
    """
    equations, regime = evidence.equations, tried.regime
    words = [regime.axis, "moment" if regime.axis == "yaw" else "force"]  # as in surge_force_rpm_below_0
    for quantity, (low, high) in regime.within.items():
        begin, end = (f"{edge:g}".replace("-", "minus_").replace(".", "p") for edge in (low, high))
        span = f"below_{end}" if low == -inf else f"above_{begin}" if high == inf else f"{begin}_to_{end}"
        words.append(f"{_without_unit(quantity)}_{span}")
    if regime.grows_with is not None and not regime.within:
        words.append(f"with_{_without_unit(regime.grows_with)}")
    effect = regime_effect("_".join(words), regime, tried.size)
    if effect.name in names:
        return None
    names = (*names, effect.name)
    model = replace(equations.model, catalogue={**equations.model.catalogue, effect.name: effect})
    added = linearise.signatures(
        equations.log, model, equations.linear.origin, [effect.name]
    )  # all others are known
    effects = (*equations.effects, *added)
    wider = linearise.Linearisation(equations.log, model, equations.tolerance, equations.linear, effects)
    evidence = regression.evidence_of(regression.normal_equations(wider, equations.noise, number=regression.FEW))
    with_m = _off_m(windows, evidence, names)
    replicated = coarse_model.replications(evidence, names, gap.evidence_within(windows, evidence))[effect.name]
    if (
        not coarse_model.improves_prediction(off_m, with_m)
        or replicated.found < coarse_model.MOST_PARTS * replicated.parts
    ):
        return None
    fit = evidence.fit(names, with_prior=True)
    (place,) = evidence.rows_in_fit(fit, effect.name)
    spread = acceptance.score_spread(evidence, names, effect.name)  # from the scatter between legs
    value, error = float(fit.values[place]), float(np.sqrt(spread * fit.covariance[place, place]))
    after_m = float(with_m.mean())
    return FoundRegime(effect.name, regime, value, error, tried.share, replicated, after_m), evidence


def _off_m(windows: gap.UnseenWindows, evidence: regression.Evidence, names: Sequence[str]) -> Floats:
    """The mean distance by leg with ``names`` at the sizes fitted to the other folds [legs with windows]."""
    catalogue = evidence.equations.model.catalogue
    extended = replace(windows, model=replace(windows.model, catalogue=catalogue))
    return coarse_model.unseen_distance_m(extended, gap.evidence_without(extended, evidence), names)


def _without_unit(quantity: str) -> str:
    return quantity.removesuffix("_mps").removesuffix("_deg").removesuffix("_dps")
