"""Maximum a posteriori coefficients of a vessel file, from recordings cut into segments.

A segment is simulated from its own start for the time to sail some ship lengths: long enough to show the effect of
coefficients on the turn of the ship, short enough that model errors do not carry it away, and that there are many
segments for estimating errors by leaving out each in turn. :func:`.identify_with_folds` chooses from
:data:`LENGTHS` what predicts held-out recordings best. Unknown for all segments are the coefficients; for a
recording its current and the errors of its wind and motion sensors; for a segment its start and the forces that
the model lacks, one over the whole segment and one in each part.

The residual of a segment is r = Z b + e: b are the deviation of its start and the missing forces, e the
sensors' white noise, so r has covariance V = Z D Z' + R (mixed models, Laird and Ware 1982), and b is
marginalised in closed form. Only the Q by Q matrix of Woodbury's identity is inverted, never one of V's size.
The rest is fitted by Levenberg-Marquardt steps, after each of which the levels of noise and missing forces are
estimated again. Own steps are needed, as in the adaptive calibrator, because starts and unknowns must move
together: with the starts fixed, ``scipy.optimize.least_squares`` oscillates between the two.

A coefficient is named as in ``[estimated]``: ``hull.Y_v``, ``rudder.a_H``. The prior of its deviation is
normal, with the relative width given in ``[estimated]`` or else the usual one. Coefficients that keep their
sign, such as damping, masses and all of an actuator's, vary by a factor exp(width z), the others by 1 + width
z. Dimensions, positions and limits are known, and so is everything that is zero: a term that the model does not
have.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from math import ceil, exp, inf, log
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy.optimize import minimize

from seatrial.acquisition.config.run_sheet import Context
from seatrial.acquisition.core import errors
from seatrial.acquisition.core.quantities import Bools, Floats, Ints
from seatrial.analysis.series import smooth_motion, smoothing_half_width
from seatrial.analysis.tables.resample import rate_fraction, resample
from seatrial.analysis.tables.table import seconds_of, table_actuators, with_calm
from seatrial.hybrid.effects import Catalogue, catalogue_of, vessel_plant
from seatrial.hybrid.effects.context import searched_effects
from seatrial.hybrid.prediction.window_sets import mean_controls
from seatrial.hybrid.vessel import dynamics, files, hulls
from seatrial.hybrid.vessel.actuators import KINDS
from seatrial.hybrid.vessel.plant import Plant, angles_in, pack
from seatrial.hybrid.vessel.sensors import acting_controls, check_ship, controls_of, measure, states_of, wind_of

START_VARIANCE = 1.0
"""The prior variance of a start's deviation, in units of ``start_scale`` squared: the start is free."""

_LEAST, _MOST_NOISE, _MOST_FORCE = 1e-10, 1e6, 10.0  # bounds of the variances in the search

_ROUNDING = 1e-12  # a share of the diagonal that exceeds rounding errors and keeps matrices positive definite

ROUNDS = 30

_ENOUGH = 0.1
"""The search ends when a step improves minus twice the log likelihood by less than this, or is expected to: the
optimum is then at most a third of the standard errors away."""

_TRIES = 8

PARTS = 5
"""The number of parts of a segment, each with its own missing force."""

FORCES = ("constant_X_n", "constant_Y_n", "constant_N_nm")
CURRENT_SHARE, WIND_SHARE, WIND_RAD = 0.05, 0.15, 0.15

HEADING_RAD, SPEED_SHARE, SWAY_SHARE, ANTENNA_LENGTHS, DELAY_S = 0.01, 0.01, 0.01, 0.02, 0.5
"""Prior widths: the current as a share of the ship's speed, the wind sensor's factor and direction, the heading
bias, the speed factor, the sway bias as a share of the speed, the antenna position in ship lengths, and the
delays of controls and positions, which do not scale with the ship. As in the catalogue of effects."""

Variant = tuple[Plant, Floats, Floats]
"""A plant, the surroundings of each recording, the starts."""

_DIFFERENCE = 1e-3
_WIDER = 2.0

SIMULATED = 5
"""The number of surroundings that act in the simulation; the others act on its sensor readings."""

LENGTHS = (2.5, 5.0, 10.0)
"""Durations of a segment in ship lengths at the usual speed, from which that is chosen that predicts best."""

LEAST_RECORDS, LONGEST_S = 15, 600.0
"""A segment has so many records at least, and lasts no longer."""

COMPARED = 30
"""The number of comparisons with measurements in a segment, where records are frequent enough; where they are not,
every record is compared."""

LEAST_EVERY, MOST_EVERY = 3, 8
"""The least and the most control steps in the time from one of these comparisons to the next. As far as possible a
step equals the interval of the records or a whole fraction of it, since between records a moving rudder is not on
the interpolated line. Comparisons are whole intervals apart, for interpolated readings have less noise than
records: a fifth less at four comparisons for three records."""

MOST = 400
"""The number of segments beyond which only every second, third ... one of a longer recording is used."""

_MOVING_SHARE = 0.2
_FEWEST_SEGMENTS = 4
_ROWS = ("measured", "motion", "controls", "wind", "recording")

USUAL_WIDTHS = {"hull": 0.3, "inertia": 0.15, "actuator": 0.2}
"""The relative prior widths of coefficients without a stated error: about those of ``vessel new``."""

WIND_LOAD_WIDTH, ASTERN_WIDTH = 0.2, 0.3
"""The relative prior width of the wind coefficients as a whole, whose regressions have errors of a fifth
(Fujiwara, Ueno and Nimura 1998), and of a shaft's astern thrust if the file does not give it."""

_FAR = 100.0  # a bound on logarithms; the model leaves its range where a search reaches it

_ADDED_MASSES = ("Xud", "Yvd", "Yrd", "Nrd", "m_x", "m_y", "J_z", "I_zG", "yaw_inertia_kgm2")
_POSITIVE = ("mass_kg", "yaw_inertia_kgm2", "Xud", "Yvd", "Nrd", "m", "m_x", "m_y", "I_zG", "J_z", "draught_m",
             "superstructure_area_m2", "frontal_area_m2", "lateral_area_m2", "lateral_centre_height_m",
             "bridge_height_m")  # fmt: skip
_OWN = {"name": "", "y_m": 0.0, "behind": ""}


@dataclass(frozen=True, slots=True)
class Variances:
    """Variances: ``noise`` [6] of the sensors in SI, and ``forces`` [2, 3] of the missing force over a whole
    segment and in each part of it, in surge, sway and yaw, in the squared units of the slopes."""

    noise: Floats
    forces: Floats

    @property
    def prior_variances(self) -> Floats:
        """The variances of all unknowns of a segment [6 + 3 + 3 PARTS]."""
        return np.concatenate([np.full(6, START_VARIANCE), self.forces[0], np.repeat(self.forces[1], PARTS)])


@dataclass(frozen=True, slots=True)
class Moments:
    """Moments of each segment and channel: Z'Z [S, 6, Q, Q], Z'r [S, 6, Q], r'r [S, 6] and their number [S, 6]."""

    squares: Floats
    products: Floats
    total: Floats
    count: Floats

    def estimate_unknowns(self, levels: Variances) -> tuple[Floats, Floats, Floats]:
        """The estimated unknowns [S, Q], their covariance [S, Q, Q], and minus twice the log likelihood of each
        segment [S]."""
        weight, scale = 1.0 / levels.noise, np.sqrt(levels.prior_variances)
        information = np.einsum("scqp,c->sqp", self.squares, weight) * np.outer(scale, scale) + np.eye(len(scale))
        information[:, range(len(scale)), range(len(scale))] *= 1.0 + _ROUNDING
        factor = np.linalg.inv(np.linalg.cholesky(information)) * scale
        covariance = factor.transpose(0, 2, 1) @ factor
        spoken = np.einsum("scq,c->sq", self.products, weight)
        unknowns = (covariance @ spoken[..., None])[..., 0]
        determinant = 2.0 * np.log(scale / np.diagonal(factor, axis1=1, axis2=2)).sum(axis=1)
        cost = (
            self.residual_squares(unknowns) @ weight
            + (unknowns**2 / levels.prior_variances).sum(axis=1)
            + determinant
        )
        return unknowns, covariance, cost + self.count @ np.log(levels.noise)

    def residual_squares(self, unknowns: Floats) -> Floats:
        """The sums of squares [S, 6] left by the unknowns [S, Q]; unlike r'r less what is explained, never
        negative by rounding."""
        bent = np.einsum("scqp,sp->scq", self.squares, unknowns) - 2.0 * self.products
        return np.asarray(np.maximum(self.total + np.einsum("scq,sq->sc", bent, unknowns), 0.0))


def moments_of(residual: Floats, slopes: Floats) -> Moments:
    """Moments of the ``residual`` [S, T, 6], NaN without measurement, and ``slopes`` [S, T, 6, Q]."""
    finite = np.isfinite(residual)
    Z = np.ascontiguousarray(np.where(finite[..., None], slopes, 0.0).transpose(0, 2, 1, 3))
    r = np.where(finite, residual, 0.0).transpose(0, 2, 1)
    turned = Z.transpose(0, 1, 3, 2)
    return Moments(turned @ Z, (turned @ r[..., None])[..., 0], (r**2).sum(axis=2), finite.sum(axis=1))


def estimate_levels(moments: Moments, first: Variances) -> Variances:
    """The maximum-likelihood levels of all segments' residuals.

    By L-BFGS on the logarithms of the variances; expectation maximisation has the same gradient but is slow
    where a level tends to zero.
    """

    def levels_at(logs: Floats) -> Variances:
        return Variances(np.exp(logs[:6]), np.exp(logs[6:]).reshape(2, 3))

    def cost(logs: Floats) -> tuple[float, Floats]:
        """Minus twice the log likelihood, and its gradient (Fisher's identity)."""
        levels = levels_at(logs)
        unknowns, covariance, costs = moments.estimate_unknowns(levels)
        squares = moments.residual_squares(unknowns) + np.einsum("scqp,spq->sc", moments.squares, covariance)
        share = 1.0 - (unknowns**2 + np.einsum("sqq->sq", covariance)) / levels.prior_variances
        by_noise = moments.count - squares / levels.noise
        parts = share[:, 9:].reshape(len(share), 3, PARTS).sum(axis=2)
        return float(costs.sum()), np.concatenate([by_noise, share[:, 6:9], parts], axis=1).sum(axis=0)

    limits = [_MOST_NOISE] * first.noise.size + [_MOST_FORCE] * first.forces.size
    bounds = [(log(_LEAST), log(limit)) for limit in limits]
    begin = np.log(np.append(first.noise, first.forces))
    return levels_at(minimize(cost, begin, jac=True, method="L-BFGS-B", bounds=bounds).x)


@dataclass(frozen=True, slots=True)
class CoefficientFit:
    """The unknowns ``z`` [model.size] and their covariance, with the ``starts`` [S, 6] and levels."""

    z: Floats
    covariance: Floats
    starts: Floats
    levels: Variances


@dataclass(frozen=True, slots=True)
class SearchPoint:
    """A point of the search, the residuals there [S, T, 6] and their derivatives with respect to each segment's
    own unknowns [S, T, 6, Q].

    ``costs`` [S] are minus twice the log likelihood of each segment, infinite where the model leaves its range.
    """

    z: Floats
    starts: Floats
    levels: Variances
    residual: Floats
    slopes: Floats
    moments: Moments
    costs: Floats

    @property
    def cost(self) -> float:
        """Minus twice the log of the posterior."""
        return float(self.costs.sum() + self.z @ self.z)


def fit(
    model: ResponseModel,
    z: Floats | None = None,
    levels: Variances | None = None,
    rounds: int = ROUNDS,
    progress: errors.Progress = lambda share: None,
) -> CoefficientFit:
    """The most likely unknowns of a model on its segments, starting from ``z`` or from the prior mean.

    From the prior mean the search first uses segments cut into parts: the shorter they are, the less a wrong
    model drifts from the measurements, and the closer to linear is the fit. Raises :class:`ModelRangeError` if
    the model cannot be simulated on them.

    If the model were exact, the covariance would be the inverse curvature of the likelihood. What a model lacks
    is not white, so its effect is estimated by leaving out each segment in turn (jackknife, Efron and Stein 1981;
    cluster sandwich, Liang and Zeger 1986). The prior's share is added.
    """
    if levels is None:  # shares of the usual motion and forces
        usual_noise = (0.01 * model.start_scale * [0.1, 0.1, 1.0, 1.0, 1.0, 1.0]) ** 2
        levels = Variances(usual_noise, np.full((2, 3), 1e-3))
    if z is None:
        short = replace(model, segments=model.segments.split(PARTS))
        z = _search(
            short, np.zeros(model.size), levels, rounds, errors.subtask_progress(progress, 0, 2), near=model.size
        ).z
        z = _within_range(model, z, levels)
    place = _search(model, z, levels, rounds, errors.subtask_progress(progress, 1, 2))
    information, scores, _ = normal_equations(model, place)
    total = information.sum(axis=0) + np.eye(model.size)
    departures = np.linalg.solve(total - information, scores[..., None])[..., 0]
    inverse = np.linalg.inv(total)
    covariance = np.asarray(departures.T @ departures + inverse @ inverse)
    return CoefficientFit(place.z, covariance, place.starts, place.levels)


def _within_range(model: ResponseModel, z: Floats, levels: Variances) -> Floats:
    """``z``, or as much of it as keeps the model in its valid range on segments longer than those of its fit."""
    for share in (1.0, 0.5, 0.25, 0.125):
        if np.isfinite(model.search_point(share * z, model.segments.start, levels).cost):
            return share * z
    return np.zeros_like(z)


def _search(
    model: ResponseModel,
    z: Floats,
    levels: Variances,
    rounds: int,
    progress: errors.Progress,
    near: float = _ENOUGH,
) -> SearchPoint:
    """The optimum by Levenberg-Marquardt steps, or a point whose next step should gain less than ``near``."""
    now, damping = model.search_point(z, model.segments.start, levels), 1e-3
    if not np.isfinite(now.cost):
        raise errors.ModelRangeError(
            "the model does not follow the recordings",
            why="it leaves its valid range",
            fix="check --vessel and units",
        )
    for _ in range(2):  # fit levels and starts
        now = _with_levels(now)
        now = _point_after_step(model, now, np.zeros(model.size), np.zeros_like(now.residual))
    now = _with_levels(now)
    for number in range(rounds):
        progress(number / rounds)
        before = now.cost
        information, scores, columns = normal_equations(model, now)
        total, pull = information.sum(axis=0) + np.eye(model.size), scores.sum(axis=0) - now.z
        promise = float(pull @ np.linalg.solve(total, pull))  # the improvement if the problem were linear
        for _ in range(_TRIES):
            step = np.linalg.solve(total + damping * np.diag(np.diag(total)), pull)
            expected = columns @ step[model.own_unknowns][..., None]
            moved = _point_after_step(model, now, step, expected.reshape(now.residual.shape))
            if moved.cost < before:
                now, damping = moved, max(damping / 5.0, 1e-6)
                break
            damping *= 8.0
        if min(promise, before - now.cost) < near:
            break
        now = _with_levels(now)
    return now


def _with_levels(place: SearchPoint) -> SearchPoint:
    """The point with maximum-likelihood levels."""
    levels = estimate_levels(place.moments, place.levels)
    return replace(place, levels=levels, costs=place.moments.estimate_unknowns(levels)[2])


def _point_after_step(model: ResponseModel, place: SearchPoint, step: Floats, expected: Floats) -> SearchPoint:
    """The point after a step in the unknowns that is expected to change the reported motion by ``expected`` [S,
    T, 6], with the starts adjusted.

    Far from the optimum the derivatives of a segment may throw its start far off: then it is kept.
    """
    unknowns, _, _ = moments_of(place.residual - expected, place.slopes).estimate_unknowns(place.levels)
    z = place.z + step
    moved = model.search_point(z, place.starts + unknowns[:, :6] * model.start_scale, place.levels)
    if moved.cost < place.cost:
        return moved
    stay = model.search_point(z, place.starts, place.levels)
    starts = np.where((stay.costs < moved.costs)[:, None], stay.starts, moved.starts)
    return model.search_point(z, starts, place.levels)


def normal_equations(model: ResponseModel, place: SearchPoint) -> tuple[Floats, Floats, Floats]:
    """Each segment's information on the unknowns [S, P, P], its score [S, P], and the derivatives [S, 6 T, p]
    with respect to the p of them that it depends on, :attr:`ResponseModel.own_unknowns`."""
    columns = model.reading_slopes(place.z, place.starts)
    weight = np.isfinite(place.residual) / np.sqrt(place.levels.noise)
    C, Z, r = (  # one matrix for each segment [S, 6 T, n]
        np.asarray(array.reshape(len(array), weight[0].size, -1) * weight.reshape(len(array), -1, 1))
        for array in (columns, place.slopes, np.nan_to_num(place.residual))
    )
    turned, segments, unknown = C.transpose(0, 2, 1), len(C), model.own_unknowns
    shared = turned @ Z
    explained = shared @ place.moments.estimate_unknowns(place.levels)[1]
    row, size = np.arange(segments)[:, None], model.size
    information, scores = np.zeros((segments, size, size)), np.zeros((segments, size))
    information_left = turned @ C - explained @ shared.transpose(0, 2, 1)
    information[row[..., None], unknown[:, :, None], unknown[:, None, :]] = information_left
    scores[row, unknown] = (turned @ r - explained @ (Z.transpose(0, 2, 1) @ r))[..., 0]
    return information, scores, columns.reshape(C.shape)


@dataclass(frozen=True, slots=True)
class Surrounding:
    """An unknown of a recording: the plant's parameter, its value at zero and its width."""

    name: str
    neutral: float
    width: float


@dataclass(frozen=True, slots=True)
class ResponseModel:
    """A vessel whose ``coefficients`` are unknown, on ``segments``.

    The unknowns are a vector z [coefficients + recordings x surroundings], each in units of its prior's width.
    """

    vessel: files.Vessel
    coefficients: tuple[Coefficient, ...]
    segments: Segments
    surroundings: tuple[Surrounding, ...]
    sensors: Plant

    @property
    def size(self) -> int:
        """The number of unknowns in z."""
        return len(self.coefficients) + len(self.segments.names) * len(self.surroundings)

    @property
    def own_unknowns(self) -> Ints:
        """The unknowns that each segment depends on [S, coefficients + surroundings]."""
        coefficients, count = len(self.coefficients), len(self.surroundings)
        around = coefficients + self.segments.recording[:, None] * count + np.arange(count)
        return np.concatenate([np.tile(np.arange(coefficients), (len(around), 1)), around], axis=1)

    def vessel_at(self, z: Floats) -> files.Vessel:
        """The vessel with the coefficients of ``z``."""
        return with_values(self.vessel, values_at(self.coefficients, z[: len(self.coefficients)]))

    def on_segments(self, segments: Segments, z: Floats) -> tuple[ResponseModel, Floats]:
        """The same coefficients on other segments, and ``z`` there, with unknown surroundings."""
        fixed = [surrounding.name for surrounding in self.surroundings if surrounding.width == 0.0]
        model, count = model_of(self.vessel, self.coefficients, segments, fixed), len(self.coefficients)
        return model, np.concatenate([z[:count], np.zeros(model.size - count)])

    def plant_at(self, z: Floats) -> Plant:
        """The plant at the coefficients of ``z``, with a wider range, as a search needs."""
        plant = vessel_plant(self.vessel_at(z))
        high = _WIDER * max(plant.surge_high_mps, -plant.surge_low_mps)
        return plant.replaced(
            surge_low_mps=-high, surge_high_mps=high, sway_limit_mps=high,
            yaw_rate_limit_radps=_WIDER * 2.0 * plant.yaw_rate_limit_radps,
        )  # fmt: skip

    def surroundings_at(self, z: Floats) -> Floats:
        """The surroundings [recordings, surroundings] of ``z``."""
        deviations = z[len(self.coefficients) :].reshape(len(self.segments.names), len(self.surroundings))
        widths = np.array([surrounding.width for surrounding in self.surroundings])
        return np.asarray([surrounding.neutral for surrounding in self.surroundings] + deviations * widths)

    def readings_at(self, z: Floats, start: Floats) -> Floats:
        """What the sensors report of the segments [S, T, 6], from ``start`` [S, 6]."""
        around = self.surroundings_at(z)
        return self._sensor_readings(self._run([(self.plant_at(z), around, start)])[0], around)

    def reading_slopes(self, z: Floats, start: Floats) -> Floats:
        """The derivative of the readings with respect to each coefficient and each surrounding of the segment's
        recording, [S, T, 6, coefficients + surroundings]."""
        plant, around = self.plant_at(z), self.surroundings_at(z)
        moved = [z + _DIFFERENCE * row for row in np.eye(len(z))[: len(self.coefficients)]]
        shifted = [
            around + _DIFFERENCE * row for row in np.diag([surrounding.width for surrounding in self.surroundings])
        ]
        variants = [(plant, around, start), *((self.plant_at(row), around, start) for row in moved)]
        unmoved, *states = self._run(
            [*variants, *((plant, surroundings, start) for surroundings in shifted[:SIMULATED])]
        )
        states += [unmoved] * (len(shifted) - SIMULATED)
        reported = self._sensor_readings(unmoved, around)
        settings = [around] * len(moved) + shifted
        columns = [
            (self._sensor_readings(state, surroundings) - reported) / _DIFFERENCE
            for state, surroundings in zip(states, settings, strict=True)
        ]
        return np.stack(columns, axis=-1)

    def search_point(self, z: Floats, start: Floats, levels: Variances) -> SearchPoint:
        """The point of a search at these unknowns.

        Its slopes are by the start in units of :attr:`start_scale`, and by the forces over the whole segment and in
        each part in units of mass times speed squared over length, moments of that times length.
        """
        plant, around = self.plant_at(z), self.surroundings_at(z)
        starts = [start + _DIFFERENCE * row for row in np.diag(self.start_scale)]
        unmoved, *moved = self._run([(plant, around, begin) for begin in (start, *starts)])
        reported = self._sensor_readings(unmoved, around)
        by_start = [(self._sensor_readings(state, around) - reported) / _DIFFERENCE for state in moved]

        # by a force that acts from the begin of a part on, and so by one in that part alone: [S, T, 6, 3, parts]
        length_m, steps = plant.length_between_perpendiculars_m, self.segments.controls.shape[1]
        sizes = np.array([1.0, 1.0, length_m]) * plant.mass_kg * self.segments.speed_mps**2 / length_m
        pushed = [
            plant.shifted(**{name: _DIFFERENCE * size}) for name, size in zip(FORCES, sizes.tolist(), strict=True)
        ]
        onset = np.zeros((*unmoved.shape, 3, PARTS + 1))
        for part in range(PARTS):
            first = part * steps // PARTS
            runs = self._run([(variant, around, unmoved[:, first]) for variant in pushed], first)
            onset[:, first:, :, :, part] = (np.moveaxis(runs, 0, -1) - unmoved[:, first:, :, None]) / _DIFFERENCE
        pulses = np.asarray((onset[..., :-1] - onset[..., 1:])[:, : -1 : self.segments.steps_per_comparison])
        parts = pulses.reshape(*pulses.shape[:3], -1)
        slopes = np.concatenate([np.stack(by_start, axis=-1), pulses.sum(axis=-1), parts], axis=-1)

        inside = np.asarray(np.isfinite(slopes).all(axis=(1, 2, 3)))
        residual = np.where(inside[:, None, None], self.segments.measured - reported, 0.0)
        slopes = np.nan_to_num(slopes)
        moments = moments_of(residual, slopes)
        costs = np.where(inside, moments.estimate_unknowns(levels)[2], np.inf)
        return SearchPoint(z, start, levels, residual, slopes, moments, costs)

    @property
    def start_scale(self) -> Floats:
        """The units of a start's deviation [6]: a length, a radian, the speed, a turn."""
        speed = self.segments.speed_mps
        length_m = self.vessel.dimensions.length_between_perpendiculars_m
        return np.array([length_m, length_m, 1.0, speed, speed, speed / length_m])

    def _run(self, variants: Sequence[Variant], first: int = 0) -> Floats:
        """True states [variants, S, K+1, 6] of all variants at once, from step ``first`` on."""
        segments = self.segments
        plants = np.concatenate([np.repeat(pack(plant), len(segments)) for plant, _, _ in variants])
        surroundings = np.concatenate([around[segments.recording] for _, around, _ in variants])
        for number, surrounding in enumerate(self.surroundings[:SIMULATED]):
            plants[surrounding.name] = surroundings[:, number]
        start = np.concatenate([begin for _, _, begin in variants])
        repeats = (len(variants), 1, 1)
        # what acts is drawn up from whole segments: a delay reaches back over the step that a run begins at
        controls = acting_controls(
            np.tile(segments.controls, repeats), plants["command_delay_s"], segments.dt_s, angles_in(plants)
        )[:, first:]
        plants["command_delay_s"] = 0.0
        wind = np.tile(segments.wind[:, first:], repeats)
        # steps are a small share of a ship length: one step of the integration each
        states = dynamics.simulate_batch(plants, start, controls, wind, segments.dt_s, substeps=1).states
        return states.reshape(len(variants), len(segments), *states.shape[1:])

    def _sensor_readings(self, states: Floats, surroundings: Floats) -> Floats:
        """The readings of states [S, K+1, 6] at the times of comparison [S, T, 6].

        ``surroundings`` [recordings, surroundings] has a row for each recording.
        """
        sparse = states[:, : -1 : self.segments.steps_per_comparison]
        readings = np.empty_like(sparse)
        names = [surrounding.name for surrounding in self.surroundings[SIMULATED:]]
        for number, values in enumerate(surroundings):
            mine = self.segments.recording == number
            sensors = self.sensors.replaced(**dict(zip(names, values[SIMULATED:].tolist(), strict=True)))
            readings[mine] = measure(sparse[mine], sensors, self.segments.steps_per_comparison * self.segments.dt_s)
        return readings


_EFFECT_OF_SURROUNDING = {
    "current_north_mps": "ocean_current", "current_east_mps": "ocean_current",
    "wind_speed_factor": "wind_speed_scale", "wind_direction_bias_rad": "wind_direction_bias",
    "command_delay_s": "command_delay", "heading_bias_rad": "heading_bias", "position_delay_s": "position_delay",
    "speed_scale": "speed_scale", "sway_bias_mps": "sway_bias", "antenna_forward_m": "position_antenna_offset",
    "antenna_starboard_m": "position_antenna_offset",
}  # fmt: skip
"""The effect of the catalogue that each surrounding is a number of."""

SURROUNDINGS = tuple(_EFFECT_OF_SURROUNDING)
"""All unknowns of a recording: its current, and the errors of its wind and of its sensors."""


def fixed_surroundings(context: Context, catalogue: Catalogue) -> tuple[str, ...]:
    """The surroundings that a context rules out or knows."""
    searched = searched_effects(catalogue, context)
    return tuple(name for name, effect in _EFFECT_OF_SURROUNDING.items() if effect not in searched)


def model_of(
    vessel: files.Vessel, coefficients: Sequence[Coefficient], segments: Segments, fixed: Collection[str] = ()
) -> ResponseModel:
    """The model of a vessel on segments, its surroundings at their usual widths; ``fixed`` ones have none."""
    plant, speed_mps = vessel_plant(vessel), segments.speed_mps
    length_m = plant.length_between_perpendiculars_m
    widths = {  # those of the sensors come last
        "current_north_mps": CURRENT_SHARE * speed_mps, "current_east_mps": CURRENT_SHARE * speed_mps,
        "wind_speed_factor": WIND_SHARE, "wind_direction_bias_rad": WIND_RAD, "command_delay_s": DELAY_S,
        "heading_bias_rad": HEADING_RAD, "position_delay_s": DELAY_S,
        "speed_scale": SPEED_SHARE, "sway_bias_mps": SWAY_SHARE * speed_mps,
        "antenna_forward_m": ANTENNA_LENGTHS * length_m, "antenna_starboard_m": ANTENNA_LENGTHS * length_m,
    }  # fmt: skip
    surroundings = (
        Surrounding(name, float(getattr(plant, name)), 0.0 if name in fixed else width)
        for name, width in widths.items()
    )
    return ResponseModel(vessel, tuple(coefficients), segments, tuple(surroundings), plant)


@dataclass(frozen=True, slots=True)
class Segments:
    """S segments of K steps of ``dt_s``, compared at T times.

    ``measured`` [S, T, 6] as reported, NaN where nothing was; ``motion`` [S, T, 6] a first guess of the states;
    ``controls`` [S, K, controls] and ``wind`` [S, K, 2] in SI; ``recording`` [S] counts the recordings, called
    ``names``; ``speed_mps`` is the ship's usual one. ``left_out`` counts candidates that lack data.
    """

    measured: Floats
    motion: Floats
    controls: Floats
    wind: Floats
    recording: Ints
    names: tuple[str, ...]
    dt_s: float
    speed_mps: float
    left_out: int = 0

    def __len__(self) -> int:
        return len(self.measured)

    @property
    def start(self) -> Floats:
        """An initial estimate of the states [S, 6] at the start."""
        return self.motion[:, 0]

    @property
    def steps_per_comparison(self) -> int:
        """The steps between comparisons."""
        return int(self.controls.shape[1] // self.measured.shape[1])

    @property
    def duration_s(self) -> float:
        """The length of a segment [s]."""
        return float(self.controls.shape[1] * self.dt_s)

    def subset(self, chosen: Bools | Ints) -> Segments:
        """The segments that a mask or index chooses."""
        return replace(self, **{name: getattr(self, name)[chosen] for name in _ROWS})

    def split(self, parts: int) -> Segments:
        """Segments divided into this number of parts."""
        arrays = {name: getattr(self, name) for name in _ROWS[:-1]}
        pieces = {
            name: rows.reshape(len(rows) * parts, rows.shape[1] // parts, *rows.shape[2:])
            for name, rows in arrays.items()
        }
        return replace(self, **pieces, recording=np.repeat(self.recording, parts))


def usual_speed_mps(tables: Mapping[str, pd.DataFrame]) -> float:
    """The median speed under way of all recordings.

    Raises :class:`DataShortageError` if the ship does not move, :class:`InputError` without a speed.
    """
    for name, table in tables.items():
        if "surge_mps" not in table:
            raise errors.InputError(
                "has no surge_mps, the speed along the ship", where=name,
                fix='import with derive = ["surge_mps", "sway_mps"] in the column map, from positions and heading',
            )  # fmt: skip
    speeds = np.abs(np.concatenate([table["surge_mps"].dropna().to_numpy() for table in tables.values()]))
    if not speeds.size or not speeds.max() > 0.0:
        raise errors.DataShortageError(
            "the ship does not move", where=", ".join(tables), fix="give recordings under way"
        )
    return float(np.median(speeds[speeds >= _MOVING_SHARE * np.percentile(speeds, 99.0)]))


def _record_interval_s(tables: Mapping[str, pd.DataFrame]) -> float:
    """The median time between records [s]."""
    records = [np.diff(seconds_of(table[["surge_mps"]].dropna())) for table in tables.values()]
    return float(np.median(np.concatenate(records)))


def segment_durations_s(tables: Mapping[str, pd.DataFrame], plant: Plant) -> list[float]:
    """The durations of a segment [s] that :data:`LENGTHS` are for a ship and its recordings, the shortest first."""
    length_s = plant.length_between_perpendiculars_m / max(usual_speed_mps(tables), 1e-3)
    shortest_s = LEAST_RECORDS * _record_interval_s(tables)
    return sorted({float(np.clip(lengths * length_s, shortest_s, LONGEST_S)) for lengths in LENGTHS})


def segments_of(tables: Mapping[str, pd.DataFrame], plant: Plant, duration_s: float | None = None) -> Segments:
    """The segments of tables of samples, at any rate, by the recording's name.

    Raises :class:`DataShortageError` if there are fewer than a handful, :class:`InputError` for recordings of
    another ship.
    """
    speed, interval_s = usual_speed_mps(tables), _record_interval_s(tables)
    lasting = duration_s or segment_durations_s(tables, plant)[0]
    aim_s = lasting / COMPARED
    apart_s = interval_s * max(1, round(aim_s / interval_s))
    count = PARTS * max(1, round(lasting / (PARTS * apart_s)))
    step_s = max(interval_s / ceil(interval_s * LEAST_EVERY / aim_s - 0.01), aim_s / MOST_EVERY)
    every, dt_s = round(apart_s / step_s), float(1 / rate_fraction(1.0 / step_s))

    parts = [_segments_of_table(resample(table, 1.0 / dt_s), plant, count, every) for table in tables.values()]
    number = [len(part.measured) for part in parts]
    measured, motion, controls, wind = (np.concatenate([part[column] for part in parts]) for column in range(4))
    segments = Segments(
        measured, motion, controls, wind,
        recording=np.repeat(np.arange(len(parts)), number),
        names=tuple(tables), dt_s=dt_s, speed_mps=speed, left_out=sum(part.left_out for part in parts),
    )  # fmt: skip
    if len(segments) < _FEWEST_SEGMENTS:
        raise errors.DataShortageError(
            f"only {len(segments)} segments of {lasting:.0f} s have motion and controls",
            where=", ".join(tables), fix="give longer recordings, or check these with `seatrial check`",
        )  # fmt: skip
    stride = -(-len(segments) // MOST)
    return segments if stride == 1 else segments.subset(np.arange(0, len(segments), stride))


class _TableSegments(NamedTuple):
    """The whole segments of one table, as in :class:`Segments`, and how many are left out, as they lack data."""

    measured: Floats
    motion: Floats
    controls: Floats
    wind: Floats
    left_out: int


def _segments_of_table(table: pd.DataFrame, plant: Plant, comparisons: int, compared_every: int) -> _TableSegments:
    """The segments of a resampled table, of which every so many rows are compared."""
    check_ship(table_actuators(table), plant)
    measured, controls = states_of(table), controls_of(table, plant.layout)
    wind = wind_of(with_calm(table))
    motion = states_of(smooth_motion(table, smoothing_half_width(plant.length_overall_m)))
    motion[:, 2] += 2.0 * np.pi * np.round((measured[:, 2] - motion[:, 2]) / (2.0 * np.pi))
    steps = comparisons * compared_every
    count = max(0, len(table) - 1) // steps
    rows = np.arange(count * steps).reshape(count, steps)
    ends = np.append(rows, rows[:, -1:] + 1, axis=1)
    complete = np.isfinite(np.column_stack([controls, wind]))[ends].all(axis=(1, 2))
    complete &= np.isfinite(motion[rows[:, ::compared_every]]).all(axis=(1, 2))
    rows, ends = rows[complete], ends[complete]
    acting, compared = mean_controls(controls[ends], plant.layout), rows[:, ::compared_every]
    return _TableSegments(measured[compared], motion[compared], acting, wind[rows], int((~complete).sum()))


@dataclass(frozen=True, slots=True)
class Coefficient:
    """A coefficient: its name, its initial value, the relative width of its prior, and its parametrisation.

    ``tied`` are the names of the same coefficient of identical actuators; ``most`` is its upper bound.
    """

    name: str
    start: float
    width: float
    keeps_sign: bool
    tied: tuple[str, ...] = ()
    most: float = inf

    def value_at(self, z: float) -> float:
        """The value at a deviation of ``z`` standard deviations."""
        departed = exp(min(self.width * z, _FAR)) if self.keeps_sign else 1.0 + self.width * z
        return min(self.start * departed, self.most)


def coefficients_of(vessel: files.Vessel) -> tuple[Coefficient, ...]:
    """The coefficients of a vessel that trials can determine."""
    hull = hulls.HULLS[vessel.hull.model]
    coefficients = [
        *_of_table(vessel, "inertia", vessel.inertia, _ADDED_MASSES, _POSITIVE),
        *_of_table(vessel, "hull", vessel.hull, hull.numbers, hull.keeps_sign),
        *_of_table(vessel, "wind", vessel.wind, (), _POSITIVE),
    ]
    if vessel.wind.model != "none":
        coefficients.append(_factor_of_effect(vessel, "wind_load", WIND_LOAD_WIDTH))
    groups: dict[Any, list[Any]] = {}  # of actuators that are identical but for name and side
    listed: tuple[Any, ...] = vessel.actuator
    for actuator in listed:
        normalised = replace(actuator, **{name: value for name, value in _OWN.items() if hasattr(actuator, name)})
        groups.setdefault(normalised, []).append(actuator)
    for first, *duplicates in groups.values():
        kind, astern = KINDS[first.kind], f"astern_thrust_{first.name}"
        usual = (*kind.keeps_sign, *kind.adapted)
        group = [*_of_table(vessel, first.name, first, usual, [field.name for field in fields(first)])]
        if astern in catalogue_of(vessel) and not hasattr(first, "astern_0"):
            group.append(_factor_of_effect(vessel, astern, ASTERN_WIDTH))
        for coefficient in group:
            table, _, number = coefficient.name.rpartition(".")
            stem = table.removesuffix(first.name)
            tied = tuple(f"{stem}{duplicate.name}.{number}" for duplicate in duplicates)
            coefficients.append(replace(coefficient, tied=tied))
    return tuple(coefficients)


def _factor_of_effect(vessel: files.Vessel, effect: str, width: float) -> Coefficient:
    """The factor of an effect, from the file or 1, within the effect's bounds."""
    start = float(vessel.effects.get(effect, {}).get("factor", 1.0))
    (factor,) = catalogue_of(vessel)[effect].parameters
    return Coefficient(f"effects.{effect}.factor", start, width, keeps_sign=True, most=factor.high)


def _of_table(
    vessel: files.Vessel, label: str, entry: Any, usual: Sequence[str], keeps_sign: Sequence[str]
) -> Iterable[Coefficient]:
    """The coefficients of one table of the file: those with a stated error, and the ``usual`` ones."""
    width = USUAL_WIDTHS.get(label, USUAL_WIDTHS["actuator"])
    for name in (field.name for field in fields(entry)):
        start, stated_error = getattr(entry, name), vessel.estimated.get(f"{label}.{name}", 0.0)
        if isinstance(start, float) and start != 0.0 and (stated_error > 0.0 or name in usual):
            yield Coefficient(f"{label}.{name}", start, float(stated_error) or width, name in keeps_sign)


def values_at(coefficients: Sequence[Coefficient], z: Floats) -> dict[str, float]:
    """The values by name at deviations ``z`` [coefficients]."""
    return {
        name: coefficient.value_at(float(deviation))
        for coefficient, deviation in zip(coefficients, z, strict=True)
        for name in (coefficient.name, *coefficient.tied)
    }


def with_values(vessel: files.Vessel, values: Mapping[str, float]) -> files.Vessel:
    """A vessel with these coefficients replaced."""
    tables: dict[str, dict[str, float]] = {}
    for name, value in values.items():
        table, _, number = name.rpartition(".")
        tables.setdefault(table, {})[number] = value
    parts = {name: replace(getattr(vessel, name), **tables[name]) for name in ("inertia", "hull", "wind")
             if name in tables}  # fmt: skip
    listed: tuple[Any, ...] = vessel.actuator
    actuators = tuple(replace(actuator, **tables.get(actuator.name, {})) for actuator in listed)
    loads = {name.partition(".")[2]: numbers for name, numbers in tables.items() if name.startswith("effects.")}
    changed = {
        name: numbers for name, numbers in loads.items() if name in vessel.effects or numbers != {"factor": 1.0}
    }
    return replace(vessel, **parts, actuator=actuators, effects={**vessel.effects, **changed})
