"""The evidence for effects: linear regression on whitened data, from Gram matrices.

Data z, signatures S and nuisances N (the tolerances of the model and of each sensor), all whitened, give

    z = S a + N b + e,  e ~ N(0, I),  b ~ N(0, I),  so that  z - S a ~ N(0, V),  V = I + N N'

All later steps need only inner products under the inverse of V (Woodbury), and these follow from the Gram
matrix of all columns, summed over legs. To leave legs out, theirs are subtracted.

Three kinds of nuisances accompany the effects in the design matrix, each with a standard deviation:

- The model's tolerance. No reference model is exact: against the sensors' noise alone, every trial would show a
  missing effect. So the model is allowed an error of a given share of the force range and of unknown shape: a
  Gaussian process over speeds and thruster settings, by random Fourier features (Rahimi and Recht 2007).
- Errors that every sensor and drive has: the catalogue's own ``tolerance``, the wind that an anemometer reports
  in still air, and settings that are recorded only now and then.
- Families of smooth forces over heading, position, time and azimuth, and of varying effects. They name nothing:
  they show whether anything remains beside the named effects, along which axis, and what it depends on.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, lru_cache
from math import expm1, isfinite, log, log1p
from typing import TypeVar

import numpy as np
from numba import njit
from numpy.linalg import LinAlgError
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve, solve_triangular
from scipy.stats import chi2

from seatrial.acquisition.core.errors import ConfigurationError, Progress
from seatrial.acquisition.core.quantities import Floats, Ints
from seatrial.acquisition.core.ship import KINDS as CHANNEL_KINDS
from seatrial.analysis.compiling import FAST, Record
from seatrial.hybrid.diagnosis import disturbance_model, linearise
from seatrial.hybrid.diagnosis.log import Log
from seatrial.hybrid.effects import Catalogue
from seatrial.hybrid.vessel.actuators import KINDS, angle_columns
from seatrial.hybrid.vessel.black_box import BlackBox, MotionModel
from seatrial.hybrid.vessel.dynamics import actuators_force, scratch_for, step_constants
from seatrial.hybrid.vessel.effect import froude_growth
from seatrial.hybrid.vessel.plant import PHYSICS_STAMP, pack
from seatrial.hybrid.vessel.sensors import SURGE, SWAY, YAW_RATE

AXES = ("surge", "sway", "yaw")

TOLERATED_SHARE = {"heading": 0.1, "place": 0.1, "time": 0.1, "azimuth": 1.0}
"""The error allowed in each family, as a share of the tolerance. The model's own error depends on speeds and
thrusters; the others are small, but no sea is uniform."""

OPERATION = "operating point"
"""The dependence of the tolerance's forces: speeds and thruster settings."""

INTERACTIONS = ("speed", "drift", "turning", "thrust", "side thrust")
"""The quantities that a named effect may vary with if the truth is a related effect."""

_HARMONICS, _TIMES = 4, 6

_PLACES = {1.5: 8, 5.0: 16}
"""Number of waves over the position, and by how many radians they turn over the size of the area: banks are
narrow."""

_EDGES = (0.25, 0.5, 0.75)  # of the largest azimuth that is used
_FAINT = 0.1  # of the largest singular value: fainter shapes are differences of nearly equal ones
_STAYS = 0.01  # of its usual range: with less variation nothing can be learned
_SEED = 20260902
_BEFORE_S = 3

_DRIFTS = ("ocean_current", "wave_drift")
"""Effects that come and go and so move the ship: they may vary with the motion of some seconds ago, as a smoothed
one knows the forces of the next seconds. Of seven trials with slow drift of the waves, the mean drift seemed to
vary with the speed sideways in four, and with that of 3 s ago in none."""

_VARYING = {"ocean_current": ("place", "time"), "heading_bias": ("heading", "time"), "yaw_rate_bias": ("time",)}
"""Effects that, when they vary, are no longer in the catalogue: a sheared current, a thrust that fades."""

FEATURES = 200
"""Features for each force: with 40 the tolerance is too poor a family, and every second trial shows a false
effect."""

FEW = 50
"""Enough for estimating the noise, and for models whose error is far beyond the tolerance."""

_FEATURES_SEED = 20260901
_LEAST_SHARE = 0.3
_WIND_MPS = 0.3
Arrays = TypeVar("Arrays", linearise.LinearModel, disturbance_model.Columns)
_LEGS_AT_ONCE = 4
_UNEVEN = 0.2  # of the smallest size of interest: no current or gyro is perfectly steady
# Clocks that may be wrong at once: where all records are late by the same none is, and three are as the fourth.
_CLOCKS = 2


@dataclass(frozen=True, slots=True)
class NuisanceBasis:
    """Force features [T, M], the quantity that each depends on, and the signatures of varying effects."""

    features: Floats
    depends: tuple[str, ...]
    varying: tuple[linearise.Signature, ...]


def nuisance_basis(
    log: Log, origin: Floats, effects: Sequence[linearise.Signature], interactions: Sequence[str] = ()
) -> NuisanceBasis:
    """The families for a log. They contain no constants, which are effects of the catalogue.

    Effects in ``interactions`` may also vary with each of :data:`INTERACTIONS`, as a related effect outside the
    catalogue would: a resistance, say, for one that is proportional to the thrust.
    """
    elapsed = (log.time_s - log.time_s[0]) / max(float(log.time_s[-1] - log.time_s[0]), 1.0)
    half_waves = np.sqrt(2.0) * np.cos(np.pi * elapsed[:, None] * np.arange(1, _TIMES + 1))
    bases = {
        "heading": _orthogonal_basis(_harmonics(origin[:, 2], _HARMONICS)),
        "place": _orthogonal_basis(_position_basis(origin[:, :2])),
        "time": _orthogonal_basis(half_waves),
        "azimuth": _orthogonal_basis(_steering_hinges(log)),
    }
    forces = np.hstack(list(bases.values()))
    depends = tuple(name for name, basis in bases.items() for _ in range(basis.shape[1]))
    before = np.maximum(np.arange(len(log)) - _BEFORE_S, log.block_edges[log.block])
    now, earlier = (
        ({}, {}) if not interactions else (_interactions(log, states) for states in (origin, origin[before]))
    )
    shapes = {**bases, "heading": _orthogonal_basis(_harmonics(origin[:, 2], 2))}
    varying = []
    for signature in effects:
        effect = signature.effect
        of_one = effect.startswith("thrust_loss_") and not effect.endswith(("_both", "_all"))
        varies_with = ("time",) if of_one else _VARYING.get(effect, ())  # thrusts may fade one by one
        families = {name: shapes[name] for name in varies_with}
        if effect in interactions:
            families |= earlier if effect.split(",")[0] in _DRIFTS else now
        varying += [
            linearise.Signature(
                f"{effect}*{name}", number, signature.D * shape[:, None], signature.E * shape[:, None]
            )
            for name, family in families.items()
            for number, shape in enumerate(family.T)
        ]
    return NuisanceBasis(forces, depends, tuple(varying))


def _orthogonal_basis(shapes: Floats) -> Floats:
    """An orthogonal basis of the same span, of unit mean square over the log [T, at most M].

    So the sum of squared coefficients is the mean square of their combination.
    """
    if not shapes.shape[1]:
        return shapes
    vectors, size, _ = np.linalg.svd(shapes, full_matrices=False)
    distinct = size > _FAINT * max(float(size[0]), 1e-9)
    return np.asarray(vectors[:, distinct] * np.sqrt(len(shapes)))


def _harmonics(angle_rad: Floats, number: int) -> Floats:
    """Cosines and sines of multiples of an angle [T, 2 number], of unit mean square."""
    order = np.arange(1, number + 1)
    phase = angle_rad[:, None] * order
    return np.asarray(np.sqrt(2.0) * np.hstack([np.cos(phase), np.sin(phase)]))


def _position_basis(position_m: Floats) -> Floats:
    """Smooth functions of position [T, 24]: long and short waves over the area."""
    offset = position_m - position_m.mean(axis=0)
    extent = max(float(np.sqrt((offset**2).sum(axis=1).mean())), 1.0)
    generator = np.random.default_rng(_SEED)
    shapes = []
    for pace, number in _PLACES.items():
        wave = generator.standard_normal((2, number)) * pace
        phase = generator.uniform(0.0, 2.0 * np.pi, number)
        shapes.append(np.sqrt(2.0) * np.cos(offset / extent @ wave + phase))
    together = np.hstack(shapes)
    return np.asarray(together - together.mean(axis=0))


def _interactions(log: Log, origin: Floats) -> dict[str, Floats]:
    """Each of :data:`INTERACTIONS` [T, 1], centred, of unit mean square; those that hardly vary are left out."""
    surge, sway, yaw_rate, *pushes = operating_point(log, origin).T
    ahead, starboard = np.zeros(len(log)), np.zeros(len(log))
    for turns in thrusts(log).values():
        parts = [pushes.pop(0) for _ in turns]
        if len(parts) == 2:  # turnable actuators push in surge and sway; the others are left out
            ahead, starboard = ahead + parts[0], starboard + parts[1]
    quantities = (surge, np.abs(sway), np.abs(yaw_rate), ahead, np.abs(starboard))
    return {
        name: ((values - values.mean()) / values.std())[:, None]
        for name, values in zip(INTERACTIONS, quantities, strict=True)
        if values.std() > _STAYS
    }


def _steering_hinges(log: Log) -> Floats:
    """Hinge functions of the steering angles beyond certain angles to either side [T, 6]; [T, 0] without any.

    Angles are signed as for a stern azimuth thruster, positive to port; a rudder's sign is reversed.
    """
    angles = angle_columns(log.actuators)
    if not angles:
        return np.zeros((len(log), 0))
    to_port = [
        -CHANNEL_KINDS[actuator.kind].turns for actuator in log.actuators if any(KINDS[actuator.kind].angles)
    ]
    angle = (log.controls[:, :, angles] * to_port).mean(axis=(1, 2))
    angle = (angle + np.pi) % (2.0 * np.pi) - np.pi
    largest = float(np.quantile(np.abs(angle), 0.99))
    corners = [(side, share * largest) for side in (1.0, -1.0) for share in _EDGES]
    return np.column_stack([np.maximum(side * angle - corner, 0.0) for side, corner in corners])


def force_range(log: Log, plant: MotionModel, origin: Floats) -> Floats:
    """The actuators' force range in a trial [3] (N, N, N m): the 99th percentile.

    For sway and yaw at least a share of what the surge thrust would make there: a trial of straight runs does
    not prove a model exact in sway.
    """
    if isinstance(plant, BlackBox):
        forces = linearise.actuator_forces_of_simulator(log, plant, origin)
        lever = 0.5 * plant.length_between_perpendiculars_m
    else:
        forces = _actuator_forces(pack(plant)[0], origin, log.controls.mean(axis=1))
        lever = max(abs(plant.number(f"{actuator.name}_x_m")) for actuator in plant.layout)
    surge, sway, yaw = np.quantile(np.abs(forces), 0.99, axis=0)
    sway = max(sway, _LEAST_SHARE * surge)
    return np.array([surge, sway, max(yaw, _LEAST_SHARE * surge * lever)])


def thrusts(log: Log) -> dict[str, tuple[Floats, ...]]:
    """Each actuator's thrust [T] by name, as square-law magnitude: surge, and sway if it can be turned."""
    by_name, first, mean = dict[str, tuple[Floats, ...]](), 0, log.controls.mean(axis=1).T
    for actuator in log.actuators:
        angles = KINDS[actuator.kind].angles
        push = mean[first] * np.abs(mean[first])
        angle = mean[first + angles.index(True)] if any(angles) else None
        by_name[actuator.name] = (push,) if angle is None else (push * np.cos(angle), push * np.sin(angle))
        first += len(angles)
    return by_name


def operating_point(log: Log, origin: Floats) -> Floats:
    """The quantities that a model error may depend on, each over its usual range: [T, quantities].

    Surge, sway, yaw rate; for each actuator its square-law thrust, in surge and sway if it can be turned.
    """
    pushes = [part for parts in thrusts(log).values() for part in parts]
    columns = np.column_stack([origin[:, SURGE : YAW_RATE + 1], *pushes])
    scale = np.maximum(np.quantile(np.abs(columns), 0.95, axis=0), 1e-9)
    return np.asarray(columns / scale)


def _make_actuator_forces(stamp: int) -> Callable[[Record, Floats, Floats], Floats]:
    @njit(cache=True, fastmath=FAST, error_model="numpy")
    def actuator_forces(p: Record, states: Floats, controls: Floats) -> Floats:
        """X [N], Y [N], N [N m] of all actuators in still water at each state and control: [T, 3]."""
        forces = np.full((len(states), 3), 0.0 * stamp)
        work = scratch_for(p, controls[0]).work
        for k in range(len(states)):
            step_constants(p, controls[k], work, 0.0, 0.0)
            u, v, r = states[k, SURGE], states[k, SWAY], states[k, YAW_RATE]
            forces[k, 0], forces[k, 1], forces[k, 2] = actuators_force(p, work, u, v, r)
        return forces

    return actuator_forces  # type: ignore[no-any-return]


_actuator_forces = _make_actuator_forces(PHYSICS_STAMP)


def tolerances(log: Log, catalogue: Catalogue, signatures: Sequence[linearise.Signature]) -> Floats:
    """The tolerated standard deviation of each signature's free coordinate [P], 0 for none.

    The usual error of a sensor or a drive stays as it is for a trial: a change within one is not tolerated.
    """
    result = []
    for signature in signatures:
        effect = catalogue[signature.effect]
        if isinstance(effect, linearise.TimeVaryingEffect) and effect.profile.shape != "recordings":
            result.append(0.0)
            continue
        size = effect.parameters[signature.coordinate % len(effect.parameters)].tolerance
        of_setting = effect.family == "clock" and effect.kind == "actuator"
        if of_setting and log.input_hold == "line":  # it may have changed at any time between two records
            size = max(size, 0.5 * log.setting_step_s)
        result.append(size if effect.chart == "linear" else 0.0)
    return np.array(result)


def wind_error_mps(model: linearise.ModelWithEffects) -> float:
    """The error [m/s] of an anemometer in each direction: its noise has a mean, and the ship disturbs the air."""
    return _WIND_MPS * froude_growth("m/s", model.scale)


def wind_errors(log: Log, model: linearise.ModelWithEffects, origin: Floats) -> list[linearise.Signature]:
    """Signatures of 1 m/s more wind from the north, the east, ahead and starboard, by recording."""
    if isinstance(model.base, BlackBox) and not model.base.takes_wind:
        return []
    zeros, step_mps = np.zeros_like(origin), wind_error_mps(model)
    north, east = log.wind[:, 1] * np.cos(log.wind[:, 0]), log.wind[:, 1] * np.sin(log.wind[:, 0])
    cosine, sine = np.cos(origin[:, 2]), np.sin(origin[:, 2])
    unit, nil = np.ones(len(log)), np.zeros(len(log))
    ways = ((unit, nil), (nil, unit), (cosine, sine), (-sine, cosine))
    result = []
    for number, (to_north, to_east) in enumerate(ways):
        ends = []
        for side in (step_mps, -step_mps):
            n, e = north + side * to_north, east + side * to_east
            air = np.column_stack([np.arctan2(e, n), np.hypot(n, e)])
            ends.append(linearise.by_stage(replace(log, wind=air), model, linearise.next_states, origin))
        result.append(linearise.Signature("wind_error", number, (ends[0] - ends[1]) / (2.0 * step_mps), zeros))
    recordings = np.unique(log.recording).tolist()
    if len(recordings) == 1:
        return result
    return [
        replace(signature, D=signature.D * (log.recording == recording)[:, None])
        for recording in recordings
        for signature in result
    ]


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
    information = inner[np.ix_(explaining, explaining)] / np.outer(scale, scale)
    return np.asarray(cross.T @ np.linalg.solve(information + 1e-9 * np.eye(len(explaining)), cross))


@dataclass(frozen=True, slots=True)
class JointFit:
    """A joint fit of some columns: values, covariance, and the part of z' V^-1 z that they explain."""

    columns: tuple[int, ...]
    values: Floats
    covariance: Floats
    gain: float


def _cholesky_factor(information: Floats) -> tuple[Floats, bool]:
    """The Cholesky factor of an information matrix [n, n].

    Columns that are alike to the last digits share what they explain, and one that explains nothing gets none:
    where rounding leaves no positive matrix, the nearest one is taken whose eigenvalues are a billionth at least.
    """
    factor: tuple[Floats, bool] | None = None
    diagonal = np.diag(information)
    with suppress(LinAlgError):
        factor = cho_factor(information + 1e-12 * np.diag(diagonal), check_finite=False)
    if factor is None:
        scale = np.sqrt(np.maximum(diagonal, 1e-15 * diagonal.max()))
        eigenvalues, directions = np.linalg.eigh(information / np.outer(scale, scale))
        nearest = (directions * np.maximum(eigenvalues, 1e-9)) @ directions.T
        factor = cho_factor(nearest * np.outer(scale, scale), check_finite=False)
    return factor


def fit_columns(inner: Floats, columns: Sequence[int], prior: Floats | None = None) -> JointFit:
    """Fit ``columns`` to column 0 of the reduced inner products; ``prior`` are standard deviations about zero."""
    index = np.array(columns, dtype=int)
    if not index.size:
        return JointFit((), np.zeros(0), np.zeros((0, 0)), 0.0)
    information, right = inner[np.ix_(index, index)].copy(), inner[index, 0]
    if prior is not None:
        information[np.diag_indices_from(information)] += prior**-2.0
    factor = _cholesky_factor(information)
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

    def columns_of(self, name: str) -> tuple[int, ...]:
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

    def feature_columns(self, axis: int) -> Ints:
        """The columns of the tolerance's features in a body axis."""
        return np.arange(self.features) + self.first_feature + axis * (self.features + len(self.depends))

    def nuisance_forces(self, axis: int) -> Ints:
        """The columns of the features of causes outside the catalogue in a body axis."""
        return np.arange(len(self.depends)) + int(self.feature_columns(axis)[-1]) + 1

    def nuisance_columns(self, axis: int, depends: str) -> Ints:
        """Those of :meth:`nuisance_forces` with one dependence."""
        return self.nuisance_forces(axis)[[dependence == depends for dependence in self.depends]]


@dataclass(frozen=True, slots=True)
class DesignMatrix(linearise.Linearisation):
    """The columns of the regression before whitening, and their layout.

    ``columns`` drive the states [T, 6, C] and the readings [T, 6, C]; ``force_range`` [3] is that of the trial
    (N, N, N m), of which ``tolerance`` is a share.
    """

    columns: disturbance_model.Columns
    layout: ColumnLayout
    force_range: Floats


@dataclass(frozen=True, slots=True)
class NormalEquations(linearise.Linearisation):
    """The regression z = S a + N b + e of a log's whitened data, as Gram matrices of its C columns.

    ``layout`` is the meaning of the columns; ``force_range`` [3] (N, N, N m); ``noise`` (SI) whitened the data;
    ``gram`` has the inner products by leg [L, C, C]; ``nuisance`` [n] are the columns of N and
    ``nuisance_scale`` [n] the standard deviations of b.
    """

    layout: ColumnLayout
    force_range: Floats
    noise: disturbance_model.DisturbanceNoise
    gram: Floats
    nuisance: Ints
    nuisance_scale: Floats


def weigh_evidence(estimate: disturbance_model.NoiseEstimate) -> Evidence:
    """The third stage: the evidence for every effect of the catalogue at once."""
    return evidence_of(normal_equations(estimate.linearisation, estimate.noise))


def normal_equations(
    linearisation: linearise.Linearisation,
    noise: disturbance_model.DisturbanceNoise,
    interactions: Sequence[str] = (),
    progress: Progress = lambda share: None,
    number: int = FEATURES,
) -> NormalEquations:
    """The regression of a log's whitened data on effects and nuisances, as Gram matrices of its columns.

    ``interactions`` are effects that may vary with the operating point (:func:`.nuisance_basis`); the tolerance
    has ``number`` features for each force axis.
    """
    design = design_matrix(linearisation, number, interactions)
    gram = gram_matrices(design.log, design.linear, design.columns, noise, progress)
    layout = design.layout
    tolerated = np.flatnonzero(layout.tolerated > 0.0)
    columns = [1 + tolerated, np.arange(layout.wind) + layout.first_wind]
    scale = [layout.tolerated[tolerated], np.full(layout.wind, wind_error_mps(design.model))]
    for axis, force in enumerate(design.tolerance * design.force_range / disturbance_model.FORCE_UNITS):
        columns.append(layout.feature_columns(axis))
        scale.append(np.full(layout.features, force / np.sqrt(layout.features)))
        for depends in dict.fromkeys(layout.depends):
            family = layout.nuisance_columns(axis, depends)
            columns.append(family)
            scale.append(np.full(len(family), TOLERATED_SHARE[depends] * force / np.sqrt(len(family))))
    uneven = np.flatnonzero(layout.varying_tolerated > 0.0)
    columns.append(uneven + layout.first_varying)
    scale.append(layout.varying_tolerated[uneven])
    return NormalEquations(
        design.log, design.model, design.tolerance, design.linear, design.effects, layout, design.force_range,
        noise, gram, np.concatenate(columns), np.concatenate(scale),
    )  # fmt: skip


def design_matrix(
    linearisation: linearise.Linearisation, number: int = FEATURES, interactions: Sequence[str] = ()
) -> DesignMatrix:
    """All columns of the regression before whitening, with ``number`` tolerance features for each force axis."""
    log, model, linear = linearisation.log, linearisation.model, linearisation.linear
    effects = linearisation.effects
    wind = wind_errors(log, model, linear.origin)
    extent = force_range(log, model.base, linear.origin)
    inputs, generator = operating_point(log, linear.origin), np.random.default_rng(_FEATURES_SEED)
    frequency = generator.standard_normal((inputs.shape[1], number))
    phase = generator.uniform(0.0, 2.0 * np.pi, number)
    features = np.sqrt(2.0) * np.cos(inputs @ frequency + phase)  # random Fourier features of unit mean square
    basis = nuisance_basis(log, linear.origin, effects, interactions)
    varying = tuple(signature.effect for signature in basis.varying)
    bases = [model.catalogue[label.split("*")[0]] for label in varying]
    tolerated = [  # of its form nothing
        0.0 if label.split("*")[1] in INTERACTIONS else _UNEVEN * effect.smallest_free[0]
        for label, effect in zip(varying, bases, strict=True)
    ]
    layout = ColumnLayout(
        effect=tuple(signature.effect for signature in effects),
        prior=np.array(
            [model.catalogue[signature.effect].free_scale[signature.coordinate] for signature in effects]
        ),
        tolerated=tolerances(log, model.catalogue, effects),
        wind=len(wind),
        features=number,
        varying=varying,
        varying_prior=np.array([effect.free_scale[0] for effect in bases]),
        varying_tolerated=np.array(tolerated),
        depends=basis.depends,
    )
    columns = disturbance_model.columns_of(
        linear, [*effects, *wind, *basis.varying], np.hstack([features, basis.features])
    )
    return DesignMatrix(log, model, linearisation.tolerance, linear, effects, columns, layout, extent)


def gram_matrices(
    log: Log,
    linear: linearise.LinearModel,
    columns: disturbance_model.Columns,
    noise: disturbance_model.DisturbanceNoise,
    progress: Progress = lambda share: None,
) -> Floats:
    """Gram matrices of all whitened columns by leg [L, C, C]; only a few legs are in memory at a time."""
    result = np.empty((log.leg_count, columns.count, columns.count))
    for first in range(0, log.leg_count, _LEGS_AT_ONCE):
        chosen = (log.leg >= first) & (log.leg < first + _LEGS_AT_ONCE)
        part = log.subset(chosen)
        z, _ = disturbance_model.whiten(
            subset_of(linear, chosen), subset_of(columns, chosen), noise, part.block_edges
        )
        for leg in range(part.leg_count):
            block = z[part.leg == leg].reshape(-1, columns.count)
            result[first + leg] = block.T @ block
        progress(min(1.0, (first + _LEGS_AT_ONCE) / log.leg_count))
    return result


def subset_of(arrays: Arrays, rows: NDArray[np.bool_]) -> Arrays:
    """Some seconds of a linear model, or of columns."""
    return type(arrays)(*(getattr(arrays, attribute.name)[rows] for attribute in fields(arrays)))


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
        equations, legs = self.equations, self.equations.gram
        left_out = legs.sum(axis=0) - legs
        return np.array([restored_gram(equations, gram, equations.nuisance_scale)[0] for gram in left_out])

    @cached_property
    def inner_by_leg(self) -> Floats:
        """The inner products of each leg by itself [L, 1+P, 1+P]."""
        equations = self.equations
        return np.array([restored_gram(equations, gram, equations.nuisance_scale)[0] for gram in equations.gram])

    @property
    def effect_names(self) -> tuple[str, ...]:
        """All effects."""
        return tuple(self.equations.model.catalogue)

    def columns_of(self, names: Sequence[str]) -> tuple[int, ...]:
        """The columns of some effects, in their order."""
        by_effect = _columns_by_effect(self.equations.layout.effect)
        return tuple(column for name in names for column in by_effect.get(name, ()))

    def prior_deviations(self, names: Sequence[str]) -> Floats:
        """The standard deviations of their priors."""
        return np.asarray(self.equations.layout.prior[np.array(self.columns_of(names), dtype=int) - 1])

    def log_odds(self, names: Sequence[str]) -> float:
        """Log odds of these effects against none, less a penalty on each, since one of many gains by chance."""
        if not names:
            return 0.0
        return log_evidence(self.inner, self.columns_of(names), self.prior_deviations(names)) - len(names) * log(
            len(self.effect_names)
        )

    def chance_of_gain(self, gain: float, degrees: int) -> float:
        """The probability that, of all effects of the catalogue, any gains as much by chance (Sidak 1967)."""
        single = min(float(chi2.sf(max(gain, 0.0), degrees)), 1.0 - 1e-12)
        return -expm1(len(self.effect_names) * log1p(-single))

    def fit(self, names: Sequence[str], with_prior: bool = False) -> JointFit:
        """The joint fit of ``names`` by least squares, or with their priors its posterior mode."""
        return fit_columns(self.inner, self.columns_of(names), self.prior_deviations(names) if with_prior else None)

    def rows_in_fit(self, fit: JointFit, name: str) -> list[int]:
        """The positions of an effect's coordinates in a fit."""
        return [fit.columns.index(column) for column in self.columns_of([name])]

    def are_possible(self, names: Sequence[str]) -> bool:
        """Whether these effects can be present together, with all values within bounds."""
        return self.are_compatible(names) and all(value is not None for value in self.fitted_values(names).values())

    def are_compatible(self, names: Sequence[str]) -> bool:
        """Whether these effects can be present together: at most two clocks are wrong.

        No effect can be both constant over the trial and different in a part of it.
        """
        effects = [self.equations.model.catalogue[name] for name in names]
        clocks = sum(effect.family == "clock" for effect in effects)
        return clocks <= _CLOCKS and len({effect.base for effect in effects}) == len(effects)

    def fitted_values(self, names: Sequence[str]) -> dict[str, dict[str, float] | None]:
        """The fitted parameters of each effect, None if they are out of bounds."""
        fit, result = self.fit(names, with_prior=True), dict[str, dict[str, float] | None]()
        for name in names:
            free = fit.values[self.rows_in_fit(fit, name)].tolist()
            try:
                result[name] = self.equations.model.values_by_piece(name, free)[-1]
            except ConfigurationError:
                result[name] = None
        return result


def evidence_of(equations: NormalEquations) -> Evidence:
    """The evidence for every effect, with the model's own effects added back into the data."""
    inner, _ = restored_gram(equations, equations.gram.sum(axis=0), equations.nuisance_scale)
    return Evidence(inner, equations)


def with_model_error(evidence: Evidence, share: float) -> Evidence:
    """The evidence if the model's own error is a share of the tolerance; the instruments' errors stay."""
    equations = evidence.equations
    of_model = equations.nuisance >= equations.layout.first_feature
    scale = np.where(of_model, share, 1.0) * equations.nuisance_scale
    return evidence_of(replace(equations, nuisance_scale=scale))


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
        back[list(equations.layout.columns_of(name))] = free
    return back
