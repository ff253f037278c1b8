"""One look at a log through one model: noise, whitened columns, and what they say of every effect at once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from hybrid.diagnosis.beyond import AXES, GRANTED, beyond
from hybrid.diagnosis.evidence import Ints, Products, drawn, fitted
from hybrid.diagnosis.linearise import Linear, Model, Signature, linear_model, reported, signatures
from hybrid.diagnosis.log import Log
from hybrid.diagnosis.noise import FORCE_UNITS, Noise
from hybrid.diagnosis.noise_fit import fitted_noise, with_drift
from hybrid.diagnosis.reconstruct import reconstructed
from hybrid.diagnosis.tolerance import FEATURES, ForceRange, features, force_range
from hybrid.diagnosis.tolerated import WIND_MPS, tolerances, wind_errors
from hybrid.diagnosis.whiten import Columns, columns_of, whitened
from hybrid.vessel.compiling import Floats

Progress = Callable[[float], None]
Loose = frozenset[tuple[str, str]]
Arrays = TypeVar("Arrays", Linear, Columns)

_NOISE_S = 1500
_LOOSE = 3.0  # so much wider than their prior effects may be while noise is estimated
_LEGS_AT_ONCE = 4
_ROUNDS = 2
_UNEVEN = 0.2  # of the smallest size of interest: no current or gyro is quite steady
_AT_LARGE = 10.0  # times the tolerance, for what is known to be there
_STEPS = (5, 12)
_SMALL_WAVES = (0.03, 0.03, 0.003)
_PRICE_OF_WAVES, _PRICE_OF_DRIFT = 12.0, 12.0  # log likelihood that seven, or six, more levels have to bring
_FEW = 50  # features are enough where nothing is decided


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
class _View:
    """A log seen through a model, before any noise is known."""

    linear: Linear
    effects: tuple[Signature, ...]
    columns: Columns
    layout: Layout
    range: ForceRange
    tolerance: float


def settled(log: Log, model: Model, tolerance: float, progress: Progress = lambda share: None) -> tuple[Log, Noise]:
    """The log with a motion to be linear about that is better than the smoother's, and the noise in it.

    The smoother knows nothing of ships: where a thruster moves, it is late. The model with all that may be missing
    in it, and all that disturbs it, is not. The second look at the noise is the one that counts.
    """
    noise: Noise | None = None
    effects: Sequence[Signature] | None = None
    for round_ in range(2):
        view = _view(log, model, tolerance, _FEW, effects)
        effects = view.effects  # the motion moves so little that they stay what they are, for a draw of them
        noise = estimated_noise(log, view, noise)
        progress(0.3 + 0.5 * round_)
        rest, sensors = _rest(log, view, noise, seed=None)
        moved = view.linear.origin + reconstructed(view.linear, rest, noise, log.edges)[0][:, :6]
        log = replace(log, nominal=reported(log, model.plant(), moved) + sensors)
        progress(0.5 + 0.5 * round_)
    assert noise is not None
    return log, noise


def examined(
    log: Log,
    model: Model,
    tolerance: float,
    noise: Noise,
    loose: Loose = frozenset(),
    progress: Progress = lambda share: None,
    forms: Sequence[str] = (),
) -> Examination:
    """Examine ``log`` through ``model``, which may have effects in it already.

    ``tolerance`` is the share of the force range that the model may be off by; ``loose`` are families of
    :mod:`.beyond`, by what they depend on and what they are of, that may be as large as an effect; ``forms`` are
    effects whose form is in question.
    """
    view = _view(log, model, tolerance, forms=forms)
    nuisance, scale = _nuisances(view, loose)
    products = products_of(log, view.linear, view.columns, noise, progress)
    return Examination(
        log, model, view.linear, view.effects, view.range, tolerance, noise, view.layout, products, nuisance, scale
    )


def _view(
    log: Log,
    model: Model,
    tolerance: float,
    number: int = FEATURES,
    known_effects: Sequence[Signature] | None = None,
    forms: Sequence[str] = (),
) -> _View:
    linear = linear_model(log, model.plant())
    effects = known_effects or signatures(log, model, linear.origin, list(model.catalogue))
    wind = wind_errors(log, model, linear.origin)
    extent = force_range(log, model.base, linear.origin)
    known = features(log, linear.origin, number)
    more = beyond(log, linear.origin, effects, forms)
    columns = columns_of(linear, [*effects, *wind, *more.varied], np.hstack([known, more.features]))
    of = [model.catalogue[each.effect.split("*")[0]] for each in more.varied]
    layout = Layout(
        effect=tuple(each.effect for each in effects),
        prior=np.array([model.catalogue[each.effect].free_scale[each.coordinate] for each in effects]),
        tolerated=tolerances(log, model.catalogue, effects),
        wind=len(wind),
        features=known.shape[1],
        varied=tuple(each.effect for each in more.varied),
        varied_prior=np.array([each.free_scale[0] for each in of]),
        varied_granted=np.array([_UNEVEN * each.smallest_free[0] for each in of]),
        depends=more.depends,
    )
    return _View(linear, tuple(effects), columns, layout, extent, tolerance)


def _tolerated_forces(view: _View) -> Floats:
    """The model's tolerance in each body axis [3], in the filter's units."""
    return np.asarray(view.tolerance * view.range.as_array() / FORCE_UNITS)


def _nuisances(view: _View, loose: Loose) -> tuple[Ints, Floats]:
    """The columns that stand for what is tolerated, and the standard deviation of each."""
    layout = view.layout
    some = np.flatnonzero(layout.tolerated > 0.0)
    wind = np.arange(layout.wind) + layout.first_wind
    columns, scale = [1 + some, wind], [layout.tolerated[some], np.full(layout.wind, WIND_MPS)]
    for axis, force in enumerate(_tolerated_forces(view)):
        columns.append(layout.axis(axis))
        scale.append(np.full(layout.features, force / np.sqrt(layout.features)))
        for depends in dict.fromkeys(layout.depends):
            own = layout.beyond(axis)[[each == depends for each in layout.depends]]
            granted = _AT_LARGE if (depends, AXES[axis]) in loose else GRANTED[depends]
            columns.append(own)
            scale.append(np.full(len(own), granted * force / np.sqrt(len(own))))
    for number, label in enumerate(layout.varied):
        what, depends = label.split("*")
        size = layout.varied_prior[number] if (depends, what) in loose else layout.varied_granted[number]
        columns.append(np.array([layout.first_varied + number]))
        scale.append(np.array([size]))
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
        z, _ = whitened(_some(linear, chosen), _some(columns, chosen), noise, part.edges)
        for leg in range(part.legs):
            block = z[part.leg == leg].reshape(-1, columns.count)
            result[first + leg] = block.T @ block
            rows[first + leg] = np.isfinite(part.measured[part.leg == leg]).sum()
        progress(min(1.0, (first + _LEGS_AT_ONCE) / log.legs))
    return Products(result, rows)


def _some(arrays: Arrays, rows: NDArray[np.bool_]) -> Arrays:
    """Some seconds of a linear model, or of columns."""
    return type(arrays)(*(getattr(arrays, each.name)[rows] for each in fields(arrays)))


def estimated_noise(log: Log, view: _View, start: Noise | None = None) -> Noise:
    """Noise levels from blocks spread over the log, a likely part of all that may be missing taken off first."""
    chosen = _spread_out(log)
    part, linear = log.subset(chosen), _some(view.linear, chosen)
    some = replace(view, linear=linear, columns=_some(view.columns, chosen))
    noise = start or first_guess(log)
    for round_ in range(1 if start else _ROUNDS):
        rest, _ = _rest(part, some, noise, seed=round_)
        starts = _both_ways(noise) if round_ == 0 and start is None else [noise]
        tried = [fitted_noise(linear, rest, part.edges, each, _STEPS[min(round_, 1)]) for each in starts]
        noise, cost = min(tried, key=lambda each: each[1] + _PRICE_OF_WAVES * each[0].has_waves)
    drifting = with_drift(linear, rest, part.edges, noise) if start is None else noise
    if drifting is not noise:
        drifting, less = fitted_noise(linear, rest, part.edges, drifting, _STEPS[1])
        noise = drifting if less < cost - _PRICE_OF_DRIFT else noise
    return noise


def first_guess(log: Log) -> Noise:
    """Where the search for the noise begins: what the smoother found, or usual levels."""
    if not log.levels:
        return Noise()
    levels = log.levels[0]
    along, axis = levels.wave_speed / levels.wave_frequency_radps, levels.wave_direction_rad
    across = along * levels.wave_across
    north, east = (
        np.hypot(along * np.cos(axis), across * np.sin(axis)),
        np.hypot(along * np.sin(axis), across * np.cos(axis)),
    )
    yaw = levels.yaw_wave_speed / levels.yaw_wave_frequency_radps
    waves = (float(north), float(east), float(yaw)) if along > 0.0 or yaw > 0.0 else (0.0, 0.0, 0.0)
    return Noise(
        position_m=levels.position_m,
        heading_rad=levels.heading_rad,
        surge_mps=levels.speed_mps,
        sway_mps=levels.speed_mps,
        yaw_rate_radps=levels.yaw_rate_radps,
        waves=tuple(max(each, 1e-3 * any(waves)) for each in waves),  # type: ignore[arg-type]
        wave_frequency_radps=float(np.clip(levels.wave_frequency_radps, 0.6, 2.0)),
        wave_damping=float(np.clip(levels.wave_damping, 0.05, 0.5)),
        wave_towards_rad=axis,
    )


def _both_ways(noise: Noise) -> list[Noise]:
    """Waves along an axis may go either way; where the smoother saw none there may be small ones all the same."""
    if not noise.has_waves:
        return [noise, replace(noise, waves=_SMALL_WAVES)]
    return [noise, replace(noise, wave_towards_rad=noise.wave_towards_rad + np.pi)]


def _spread_out(log: Log) -> NDArray[np.bool_]:
    """Whole blocks spread evenly over the log, of some 25 minutes in all."""
    blocks = int(log.block.max()) + 1
    wanted = min(blocks, max(1, round(_NOISE_S * blocks / len(log))))
    chosen = np.unique(np.linspace(0, blocks - 1, wanted).round().astype(int))
    return np.asarray(np.isin(log.block, chosen))


def _rest(log: Log, view: _View, noise: Noise, seed: int | None) -> tuple[Columns, Floats]:
    """The data with all effects and force features taken off, one column, and what of it is in the sensors [T, 6].

    With a ``seed`` a likely draw of them, without one the likeliest values.
    """
    layout, columns = view.layout, view.columns
    products = products_of(log, view.linear, columns, noise).total
    P, features = len(layout.effect), columns.features.shape[1]
    prior = np.full(columns.count, np.nan)
    prior[1 : 1 + P] = _LOOSE * layout.prior
    prior[layout.first_wind : layout.first_varied] = _LOOSE * WIND_MPS
    prior[layout.first_varied : layout.first_feature] = layout.varied_prior
    for axis, force in enumerate(_tolerated_forces(view)):
        prior[layout.axis(axis)] = force / np.sqrt(layout.features)
        prior[layout.beyond(axis)] = _LOOSE * force
    every = range(1, columns.count)
    fit = fitted(products, every, prior[1:]).values if seed is None else drawn(products, every, prior[1:], seed)
    few = layout.first_feature - 1
    plain, forces = fit[:few], fit[few:].reshape(3, features)
    drive = columns.drive[:, :, 0] - columns.drive[:, :, 1:] @ plain
    drive += np.einsum("tid,dm,tm->ti", view.linear.B * FORCE_UNITS, forces, columns.features)
    sensors = columns.seen[:, :, 1:] @ plain
    seen = columns.seen[:, :, 0] - sensors
    return Columns(drive[:, :, None].copy(), seen[:, :, None].copy(), np.zeros((len(log), 0))), sensors
