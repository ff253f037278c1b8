"""The noise in a log, and a motion to be linear about: what has to be settled before anything is named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from acquisition.core.arrays import Floats
from acquisition.core.progress import Progress
from hybrid.diagnosis.evidence import (
    DesignMatrix,
    design_matrix,
    draw_columns,
    fit_columns,
    gram_matrices,
    subset_of,
    tolerated_forces,
)
from hybrid.diagnosis.innovations import Columns, smoothed_state
from hybrid.diagnosis.linearise import Linearisation, linearise, sensor_readings
from hybrid.diagnosis.log import Log
from hybrid.diagnosis.noise import FORCE_UNITS, Noise, NoiseEstimate
from hybrid.diagnosis.noise_fit import fitted_noise, with_drift
from hybrid.diagnosis.nuisance_basis import WIND_MPS

_NOISE_S = 1500
_LOOSE = 3.0  # so much wider than their prior effects may be while noise is estimated
_ROUNDS = 2
_STEPS = (5, 12)
_SMALL_WAVES = (0.03, 0.03, 0.003)
_PRICE_OF_WAVES, _PRICE_OF_DRIFT = 12.0, 12.0  # log likelihood that seven, or six, more levels have to bring
_FEW = 50  # features are enough where nothing is decided


def estimate_noise(linearisation: Linearisation, progress: Progress = lambda share: None) -> NoiseEstimate:
    """The second stage: the noise in a log, and a motion to be linear about that is better than the smoother's.

    The smoother knows nothing of ships: where a thruster moves, it is late. The model with all that may be missing
    in it, and all that disturbs it, is not. So the noise is estimated twice; the second estimate counts.
    """
    noise: Noise | None = None
    for round_ in range(2):
        log, model = linearisation.log, linearisation.model
        look = design_matrix(linearisation, _FEW)
        noise = estimated_noise(log, look, noise)
        progress(0.3 + 0.5 * round_)
        rest, sensors = _rest(log, look, noise, seed=None)
        moved = look.linear.origin + smoothed_state(look.linear, rest, noise, log.edges)[0][:, :6]
        log = replace(log, nominal=sensor_readings(log, model.plant(), moved) + sensors)
        # the motion moves so little that effects stay what they are, for a draw of them
        known = None if round_ else linearisation.effects
        linearisation = linearise(log, model, linearisation.tolerance, known)
        progress(0.5 + 0.5 * round_)
    assert noise is not None
    return NoiseEstimate(linearisation, noise)


def estimated_noise(log: Log, look: DesignMatrix, start: Noise | None = None) -> Noise:
    """Noise levels from blocks spread over the log, a likely part of all that may be missing taken off first."""
    chosen = spread_out(log)
    part, linear = log.subset(chosen), subset_of(look.linear, chosen)
    some = replace(look, linear=linear, columns=subset_of(look.columns, chosen))
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


def spread_out(log: Log, seconds: float = _NOISE_S) -> NDArray[np.bool_]:
    """Whole blocks spread evenly over the log, of some 25 minutes in all, or as long as asked for."""
    blocks = int(log.block.max()) + 1
    wanted = min(blocks, max(1, round(seconds * blocks / len(log))))
    chosen = np.unique(np.linspace(0, blocks - 1, wanted).round().astype(int))
    return np.asarray(np.isin(log.block, chosen))


def _rest(log: Log, look: DesignMatrix, noise: Noise, seed: int | None) -> tuple[Columns, Floats]:
    """The data with all effects and force features taken off, one column, and what of it is in the sensors [T, 6].

    With a ``seed`` a likely draw of them, without one the likeliest values.
    """
    layout, columns = look.layout, look.columns
    gram = gram_matrices(log, look.linear, columns, noise).total
    P, features = len(layout.effect), columns.features.shape[1]
    prior = np.full(columns.count, np.nan)
    prior[1 : 1 + P] = _LOOSE * layout.prior
    prior[layout.first_wind : layout.first_varying] = _LOOSE * WIND_MPS
    prior[layout.first_varying : layout.first_feature] = layout.varying_prior
    for axis, force in enumerate(tolerated_forces(look)):
        prior[layout.axis(axis)] = force / np.sqrt(layout.features)
        prior[layout.nuisance_forces(axis)] = _LOOSE * force
    every = range(1, columns.count)
    fit = fit_columns(gram, every, prior[1:]).values if seed is None else draw_columns(gram, every, prior[1:], seed)
    few = layout.first_feature - 1
    plain, forces = fit[:few], fit[few:].reshape(3, features)
    drive = columns.drive[:, :, 0] - columns.drive[:, :, 1:] @ plain
    drive += np.einsum("tid,dm,tm->ti", look.linear.B * FORCE_UNITS, forces, columns.features)
    sensors = columns.seen[:, :, 1:] @ plain
    seen = columns.seen[:, :, 0] - sensors
    return Columns(drive[:, :, None].copy(), seen[:, :, None].copy(), np.zeros((len(log), 0))), sensors
