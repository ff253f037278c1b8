"""Noise levels of a log, and a better trajectory to linearise along.

The noise levels maximise the likelihood of the measurements
(:mod:`seatrial.analysis.estimation.process_models`), computed from the innovations of the Kalman filter of ship
and disturbances. A draw of all effects is removed from the data first; otherwise a missing effect would be
estimated as noise and so be hidden.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from seatrial.acquisition.core.errors import Progress
from seatrial.acquisition.core.quantities import GRAVITY_MPS2, Floats, Ints
from seatrial.analysis.estimation.process_models import Prior, ScoringSettings, most_likely, robust_cost
from seatrial.hybrid.diagnosis import disturbance_model, linearise, regression
from seatrial.hybrid.diagnosis.disturbance_model import Columns, DisturbanceNoise, NoiseEstimate
from seatrial.hybrid.diagnosis.log import Log
from seatrial.hybrid.vessel.effect import froude_growth
from seatrial.hybrid.vessel.estimate.hull import SEA_WATER_KGPM3

_SCORING = ScoringSettings(limit=16.0, longest_step=1.0, damping=(1.0, 4.0), enough=1.0)
_DEVIATION = 1.5  # prior standard deviation of each log level about its start
_ROOM = 2.0
# log of the lowest sensor noise [m, rad, m/s, m/s, rad/s]: no sensor is better
_LEAST = np.log([1e-3, 5e-5, 1e-3, 1e-3, 1e-5])
_SENSORS = ("position_m", "heading_rad", "surge_mps", "sway_mps", "yaw_rate_radps")
_FORCES = ("gust", "slow", "slow_s")
_WAVES = ("waves", "wave_frequency_radps", "wave_damping", "wave_correlation", "wave_towards_rad")
_DRIFT = ("drift", "drift_s")
_WAVE_DRIFT = ("wave_drift_n", "wave_drift_s")
_BOUNDS = {
    "slow_s": (3.0, 120.0), "wave_frequency_radps": (0.5, 2.6), "wave_damping": (0.02, 0.7), "drift_s": (3.0, 60.0),
    "wave_drift_s": (2.0, 120.0),
}  # fmt: skip
_LEVEL = (np.log, np.exp)
_SEARCHED_AS: dict[str, tuple[Callable[[Any], Floats], Callable[[Floats], Floats]]] = {
    "wave_correlation": (np.arctanh, np.tanh),
    "wave_towards_rad": (np.asarray, np.asarray),
}  # fmt: skip
"""To the search parameter and back, of the parameters that are not levels, whose logarithm is searched."""
_STILL_WHITE, _TRACE = 0.7, 0.1
_STILL_SLOW = 0.3  # of the slow forces: what the start of wave drift leaves of them, and the least that it takes

_NOISE_S = 1500
_LOOSE = 3.0  # factor on the effects' priors while the noise is estimated
_ROUNDS = 2
_STEPS = (5, 12)
_SMALL_WAVES = (0.03, 0.03, 0.003)
_PRICE_OF_WAVES, _PRICE_OF_DRIFT = 12.0, 12.0  # gain in log likelihood of seven, or six, more parameters
_PRICE_OF_WAVE_DRIFT = 6.0  # of two


def estimate_noise(
    linearisation: linearise.Linearisation, progress: Progress = lambda share: None
) -> NoiseEstimate:
    """The second stage: the noise in a log, and a better trajectory to linearise along than the smoother's.

    The smoother knows nothing of ships: where a thruster moves, it lags. The model with all possible effects
    and disturbances does not. So the noise is estimated twice, and the second estimate is used.
    """
    noise: DisturbanceNoise | None = None
    for round_ in range(2):
        log, model = linearisation.log, linearisation.model
        design = regression.design_matrix(linearisation, regression.FEW)
        noise = _likeliest_noise(design, noise)
        progress(0.3 + 0.5 * round_)
        residual, sensors = _remove_effects(design, noise, seed=None)
        moved = (
            design.linear.origin
            + disturbance_model.smooth_state(design.linear, residual, noise, log.block_edges)[0][:, :6]
        )
        log = replace(log, nominal=linearise.by_stage(log, model, linearise.sensor_readings, moved) + sensors)
        # the trajectory changes so little that the signatures still hold well enough for a draw
        known_effects = None if round_ else linearisation.effects
        linearisation = linearise.linearise(log, model, linearisation.tolerance, known_effects)
        progress(0.5 + 0.5 * round_)
    assert noise is not None
    return NoiseEstimate(linearisation, noise)


def _likeliest_noise(design: regression.DesignMatrix, start: DisturbanceNoise | None = None) -> DisturbanceNoise:
    """Noise levels from blocks spread over the log, after removing a draw of everything that may be missing."""
    chosen = design.log.mask_of_spread_blocks(_NOISE_S)
    linear, part = regression.subset_of(design.linear, chosen), design.log.subset(chosen)
    selected = replace(design, log=part, linear=linear, columns=regression.subset_of(design.columns, chosen))
    noise = start or _first_guess(part, design.model)
    for round_ in range(1 if start else _ROUNDS):
        residual, _ = _remove_effects(selected, noise, seed=round_)
        starts, scale = [noise], design.model.scale
        if round_ == 0 and start is None:  # waves either way along their axis, or none and small ones
            if noise.has_waves:
                starts.append(replace(noise, wave_towards_rad=noise.wave_towards_rad + np.pi))
            else:
                north, east, yaw = _SMALL_WAVES
                waves = north * froude_growth("m", scale), east * froude_growth("m", scale), yaw
                starts.append(replace(noise, waves=waves))
        tried = [fit_noise(linear, residual, part.block_edges, guess, _STEPS[min(round_, 1)]) for guess in starts]
        noise, cost = min(tried, key=lambda fit: fit[1] + _PRICE_OF_WAVES * fit[0].has_waves)
    if start is not None:
        return noise
    sensor_drift = partial(start_of_drift, linear, residual, part.block_edges)
    for extend, price in ((start_of_wave_drift, _PRICE_OF_WAVE_DRIFT), (sensor_drift, _PRICE_OF_DRIFT)):
        begin = extend(noise)
        if begin is not noise:  # more parameters have to be worth their price
            extended, extended_cost = fit_noise(linear, residual, part.block_edges, begin, _STEPS[1])
            if extended_cost < cost - price:
                noise, cost = extended, extended_cost
    return noise


def _first_guess(log: Log, model: linearise.ModelWithEffects) -> DisturbanceNoise:
    """The start of the search: the smoother's estimates, or levels typical of a ship of this scale."""
    grown, usual = np.array([froude_growth(unit, model.scale) for unit in ("N", "N", "N m")]), DisturbanceNoise()
    gust, slow = ((grown * level).tolist() for level in (usual.gust, usual.slow))
    usual = replace(usual, gust=tuple(gust), slow=tuple(slow), length_m=model.base.length_overall_m)
    if (levels := log.levels) is None:
        return usual
    along, axis = levels.wave_speed / levels.wave_frequency_radps, levels.wave_direction_rad
    across = along * levels.wave_across
    north = np.hypot(along * np.cos(axis), across * np.sin(axis))
    east = np.hypot(along * np.sin(axis), across * np.cos(axis))
    yaw = levels.yaw_wave_speed / levels.yaw_wave_frequency_radps
    waves = (float(north), float(east), float(yaw)) if along > 0.0 or yaw > 0.0 else (0.0, 0.0, 0.0)
    return replace(
        usual,
        position_m=levels.position_m,
        heading_rad=levels.heading_rad,
        surge_mps=levels.speed_mps,
        sway_mps=levels.speed_mps,
        yaw_rate_radps=levels.yaw_rate_radps,
        waves=tuple(max(amplitude, 1e-3 * any(waves)) for amplitude in waves),  # type: ignore[arg-type]
        wave_frequency_radps=float(np.clip(levels.wave_frequency_radps, 0.6, 2.0)),
        wave_damping=float(np.clip(levels.wave_damping, 0.05, 0.5)),
        wave_towards_rad=axis,
    )


def _remove_effects(
    design: regression.DesignMatrix, noise: DisturbanceNoise, seed: int | None
) -> tuple[Columns, Floats]:
    """The data after removing all effects and force features, one column, and their part in the sensors [T, 6].

    With a ``seed`` a posterior draw of them is removed, without one their posterior mode.
    """
    layout, columns = design.layout, design.columns
    gram = regression.gram_matrices(design.log, design.linear, columns, noise).sum(axis=0)
    P, features = len(layout.effect), columns.features.shape[1]
    prior = np.full(columns.count, np.nan)
    prior[1 : 1 + P] = _LOOSE * layout.prior
    prior[layout.first_wind : layout.first_varying] = _LOOSE * regression.wind_error_mps(design.model)
    prior[layout.first_varying : layout.first_feature] = layout.varying_prior
    for axis, force in enumerate(design.tolerance * design.force_range / disturbance_model.FORCE_UNITS):
        prior[layout.feature_columns(axis)] = force / np.sqrt(layout.features)
        prior[layout.nuisance_forces(axis)] = _LOOSE * force
    indices = range(1, columns.count)
    fit = (
        regression.fit_columns(gram, indices, prior[1:]).values
        if seed is None
        else regression.draw_columns(gram, indices, prior[1:], seed)
    )
    plain_count = layout.first_feature - 1
    plain, forces = fit[:plain_count], fit[plain_count:].reshape(3, features)
    drive = columns.drive[:, :, 0] - columns.drive[:, :, 1:] @ plain
    drive += np.einsum("tid,dm,tm->ti", design.linear.B * disturbance_model.FORCE_UNITS, forces, columns.features)
    sensors = columns.readings[:, :, 1:] @ plain
    readings = columns.readings[:, :, 0] - sensors
    return Columns(drive[:, :, None].copy(), readings[:, :, None].copy(), np.zeros((len(drive), 0))), sensors


def fit_noise(
    linear: linearise.LinearModel, data: Columns, edges: Ints, start: DisturbanceNoise, steps: int
) -> tuple[DisturbanceNoise, float]:
    """Maximum-likelihood levels for one column of data, from ``start``, and the negative log likelihood.

    Takes at most ``steps`` steps.
    """
    optional = ((_WAVES, start.has_waves), (_DRIFT, start.has_drift), (_WAVE_DRIFT, start.wave_drift_n > 0.0))
    present = (name for names, is_present in optional if is_present for name in names)
    searched = {name: getattr(start, name) for name in (*_SENSORS, *_FORCES, *present)}
    sizes = [np.size(value) for value in searched.values()]

    def noise_at(parameters: Floats) -> DisturbanceNoise:
        levels = dict[str, Any]()
        pieces = np.split(parameters, np.cumsum(sizes)[:-1])
        for (name, value), piece in zip(searched.items(), pieces, strict=True):
            values = _SEARCHED_AS.get(name, _LEVEL)[1](piece).tolist()
            levels[name] = tuple(values) if isinstance(value, tuple) else values[0]
        return replace(start, **levels)

    # no sensor is noisier than twice the level that the median third difference of consecutive readings implies,
    # whatever the ship does; otherwise jumps and jitter would be taken for noise
    columns = (column[np.isfinite(column)] for column in (data.readings[:, :, 0] + linear.origin).T)
    third = (np.abs(np.diff(column, 3)) / np.sqrt(20.0) for column in columns)
    level = np.array([1.4826 * np.median(differences) if differences.size else 0.0 for differences in third])
    level[0] = max(level[:2])
    limits = np.log(_ROOM * np.maximum(level[[0, 2, 3, 4, 5]], np.exp(_LEAST)))
    bounds = {**_BOUNDS, "wave_drift_n": (1e-3, max(_largest_wave_drift_n(start), 2e-3))}
    ends = [np.log(bounds[name]) if name in bounds else np.array([-np.inf, np.inf]) for name in searched]
    low, high = np.repeat(ends, sizes, axis=0).T.copy()
    low[: len(_LEAST)], high[: len(_LEAST)] = _LEAST, limits

    values = [_SEARCHED_AS.get(name, _LEVEL)[0](value) for name, value in searched.items()]
    begin = np.clip(np.hstack(values), low, high)
    optimum, cost = most_likely(
        lambda parameters: _innovations(linear, data, edges, noise_at(parameters)), begin, low, high,
        replace(_SCORING, most_steps=steps), Prior(begin, _DEVIATION),
    )  # fmt: skip
    return noise_at(optimum), 0.5 * cost


def _innovations(
    linear: linearise.LinearModel, data: Columns, edges: Ints, noise: DisturbanceNoise
) -> tuple[Floats, Floats]:
    """All innovations and their variances."""
    z, variance = disturbance_model.whiten(linear, data, noise, edges)
    measured = np.isfinite(data.readings[:, :, 0])
    return (z[:, :, 0] * np.sqrt(variance))[measured], variance[measured]


def start_of_wave_drift(noise: DisturbanceNoise) -> DisturbanceNoise:
    """The start of the search for slow drift of the waves, in the place of most of the slow forces.

    It is as large as the larger of those in surge and sway; waves too small to push as much give the known noise.
    """
    level = min(max(noise.slow[:2]), _largest_wave_drift_n(noise))
    if level < _STILL_SLOW * max(noise.slow[:2]):
        return noise
    surge, sway, yaw = (_STILL_SLOW * force for force in noise.slow)
    return replace(noise, slow=(surge, sway, yaw), wave_drift_n=level, wave_drift_s=noise.slow_s)


def _largest_wave_drift_n(noise: DisturbanceNoise) -> float:
    """The mean drift in waves that are all reflected (Maruo 1960), ten times for those that move a ship little."""
    variance_m2 = noise.waves[0] ** 2 + noise.waves[1] ** 2
    return 10.0 * SEA_WATER_KGPM3 * GRAVITY_MPS2 * noise.length_m * variance_m2


def start_of_drift(
    linear: linearise.LinearModel, data: Columns, edges: Ints, noise: DisturbanceNoise
) -> DisturbanceNoise:
    """The start of the search for sensor drift: the given noise, and a drift of each sensor that may have one.

    Each sensor is tried by itself: does a drift as large as its noise raise the likelihood?
    """

    def cost(noise: DisturbanceNoise) -> float:
        return robust_cost(*_innovations(linear, data, edges, noise), _SCORING.limit)

    plain, drift = cost(noise), [0.0] * len(_SENSORS)
    for number, name in enumerate(_SENSORS):
        level = getattr(noise, name)
        single = [level if sensor == number else 0.0 for sensor in range(len(_SENSORS))]
        tried = replace(noise, drift=tuple(single), **{name: _STILL_WHITE * level})  # type: ignore[arg-type]
        if cost(tried) < plain:
            drift[number] = level
    if not any(drift):
        return noise
    start = [
        max(drift_level, _TRACE * getattr(noise, name)) for drift_level, name in zip(drift, _SENSORS, strict=True)
    ]
    return replace(noise, drift=tuple(start))
