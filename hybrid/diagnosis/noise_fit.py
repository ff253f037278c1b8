"""The noise levels under which what was measured is the most likely, once all effects have had their say.

The likelihood of the filter's innovations (Schweppe 1965), climbed by scoring (Fisher): slopes by differences of
the filter itself. The data come with every effect's part taken off first; else a missing effect passes for
noise and hides itself. Innovations count up to a limit only, so that outliers do not pass for noise either.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from acquisition.core.arrays import Floats
from hybrid.diagnosis.innovations import Columns, whitened
from hybrid.diagnosis.linearise import Linear
from hybrid.diagnosis.noise import Noise

_LIMIT = 4.0
_DIFFERENCE = 0.02
_SPREAD = 1.5  # of the logarithm of each level about where the search begins
_ROOM = 2.0
_ENOUGH = 0.5  # of the logarithm of the likelihood
_LEAST = np.log(
    [1e-3, 5e-5, 1e-3, 1e-3, 1e-5]
)  # of the sensors: better ones there are none, or they are no sensors
_BOUNDS = {
    "slow_s": (3.0, 120.0), "wave_frequency_radps": (0.5, 2.6), "wave_damping": (0.02, 0.7), "drift_s": (3.0, 60.0)
}  # fmt: skip
_STILL_WHITE, _TRACE = 0.7, 0.1


def fitted_noise(
    linear: Linear, data: Columns, edges: NDArray[np.int64], start: Noise, steps: int
) -> tuple[Noise, float]:
    """The likeliest levels for one column of data, searched from ``start``, and minus the log likelihood.

    At most ``steps`` steps are made."""
    most = _most(linear, data)
    begin = _bounded(_parameters(start), start, most)
    now, damping = begin.copy(), 1.0
    value, z, log_spread = _judged(linear, data, edges, start, now, begin)
    for _ in range(steps):
        slope, information = _slopes(linear, data, edges, start, now, z, log_spread)
        slope += (now - begin) / _SPREAD**2
        information += np.eye(len(now)) / _SPREAD**2
        for _ in range(5):
            step = -np.linalg.solve(information + damping * np.diag(np.diag(information)), slope)
            trial = _bounded(now + np.clip(step, -1.0, 1.0), start, most)
            new = _judged(linear, data, edges, start, trial, begin)
            if new[0] < value:
                break
            damping *= 4.0
        else:
            break
        gained, now, damping = value - new[0], trial, damping / 5.0
        value, z, log_spread = new
        if gained < _ENOUGH:
            break
    return _noise(start, now), value


def _most(linear: Linear, data: Columns) -> Floats:
    """The logarithm of the largest level that each sensor can have: noise would show in its third differences.

    Half of them lie below what is given here whatever the ship does; so jumps and jitter do not pass for noise.
    """
    value = data.seen[:, :, 0] + linear.origin
    third = np.abs(np.diff(value, 3, axis=0)) / np.sqrt(20.0)
    level = 1.4826 * np.array([np.median(each[np.isfinite(each)]) for each in third.T])
    level[0] = max(level[:2])
    return np.asarray(np.log(_ROOM * np.maximum(level[[0, 2, 3, 4, 5]], np.exp(_LEAST))))


def _judged(
    linear: Linear, data: Columns, edges: NDArray[np.int64], start: Noise, at: Floats, begin: Floats
) -> tuple[float, Floats, Floats]:
    """Minus the log likelihood at these parameters, the whitened data and the log of their variance."""
    z, spread = whitened(linear, data, _noise(start, at), edges)
    flat, logs = z[:, :, 0].ravel(), np.log(spread).ravel()
    away = 0.5 * float((((at - begin) / _SPREAD) ** 2).sum())
    return _cost(flat, logs) + away, flat, logs


def _slopes(
    linear: Linear, data: Columns, edges: NDArray[np.int64], start: Noise, at: Floats, z: Floats, logs: Floats,
) -> tuple[Floats, Floats]:  # fmt: skip
    """Slope [p] and Fisher's information [p, p] of minus the log likelihood."""
    by_z, by_log = np.empty((len(at), z.size)), np.empty((len(at), z.size))
    for number in range(len(at)):
        moved = at.copy()
        moved[number] += _DIFFERENCE
        new, spread = whitened(linear, data, _noise(start, moved), edges)
        by_z[number] = (new[:, :, 0].ravel() - z) / _DIFFERENCE
        by_log[number] = (np.log(spread).ravel() - logs) / _DIFFERENCE
    inside = np.abs(z) < _LIMIT
    slope = 0.5 * by_log.sum(axis=1) + (by_z * (z * inside)).sum(axis=1)
    errors = (by_z + 0.5 * z * by_log) * inside
    return slope, 0.5 * by_log @ by_log.T + errors @ errors.T


_SENSORS = ("position_m", "heading_rad", "surge_mps", "sway_mps", "yaw_rate_radps")
_SWING = ("wave_frequency_radps", "wave_damping")
_ALWAYS, _WAVES = 12, 7  # how many parameters: sensors, forces and their time; of waves


def _parameters(noise: Noise) -> Floats:
    """Logarithms of all levels that are not zero throughout: what is searched."""
    levels = [*(getattr(noise, name) for name in _SENSORS), *noise.gust, *noise.slow, noise.slow_s]
    if noise.has_waves:
        levels += [
            *noise.waves,
            *(getattr(noise, name) for name in _SWING),
            np.exp(np.arctanh(noise.wave_correlation)),
            np.exp(noise.wave_towards_rad),
        ]
    if noise.has_drift:
        levels += [*noise.drift, noise.drift_s]
    return np.asarray(np.log(np.array(levels)))


def _noise(start: Noise, parameters: Floats) -> Noise:
    """The levels back, of the same kind as ``start``."""
    level = np.exp(parameters)
    gust, slow = (tuple(float(each) for each in level[i : i + 3]) for i in (5, 8))
    sensors = {name: float(level[number]) for number, name in enumerate(_SENSORS)}
    result = replace(start, **sensors, gust=gust, slow=slow, slow_s=float(level[11]))  # type: ignore[arg-type]
    if start.has_waves:
        swing = {name: float(level[15 + number]) for number, name in enumerate(_SWING)}
        swing |= {"wave_correlation": float(np.tanh(parameters[17])), "wave_towards_rad": float(parameters[18])}
        waves_of = tuple(float(each) for each in level[12:15])
        result = replace(result, waves=waves_of, **swing)  # type: ignore[arg-type]
    if start.has_drift:
        *drift, drift_s = (float(each) for each in level[-6:])
        result = replace(result, drift=tuple(drift), drift_s=drift_s)  # type: ignore[arg-type]
    return result


def _bounded(parameters: Floats, kind: Noise, most: Floats) -> Floats:
    """The parameters as near as they may be."""
    parameters[: len(_LEAST)] = np.clip(parameters[: len(_LEAST)], _LEAST, most)
    places = {"slow_s": _ALWAYS - 1}
    if kind.has_waves:
        places |= {"wave_frequency_radps": _ALWAYS + 3, "wave_damping": _ALWAYS + 4}
    if kind.has_drift:
        places["drift_s"] = len(parameters) - 1
    for name, place in places.items():
        parameters[place] = np.clip(parameters[place], *np.log(_BOUNDS[name]))
    return np.asarray(parameters)


def with_drift(linear: Linear, data: Columns, edges: NDArray[np.int64], noise: Noise) -> Noise:
    """Where a search for slow errors of the sensors begins: as it is, but for those that seem to err slowly.

    Each sensor is tried by itself: whether an error as large as its noise that lasts makes the data likelier.
    """
    plain, drift = _minus_log_likelihood(linear, data, edges, noise), [0.0] * len(_SENSORS)
    for number, name in enumerate(_SENSORS):
        level = getattr(noise, name)
        alone = [level if each == number else 0.0 for each in range(len(_SENSORS))]
        tried = replace(noise, drift=tuple(alone), **{name: _STILL_WHITE * level})  # type: ignore[arg-type]
        if _minus_log_likelihood(linear, data, edges, tried) < plain:
            drift[number] = level
    if not any(drift):
        return noise
    start = [max(each, _TRACE * getattr(noise, name)) for each, name in zip(drift, _SENSORS, strict=True)]
    return replace(noise, drift=tuple(start))


def _minus_log_likelihood(linear: Linear, data: Columns, edges: NDArray[np.int64], noise: Noise) -> float:
    z, spread = whitened(linear, data, noise, edges)
    return _cost(z[:, :, 0], np.log(spread))


def _cost(z: Floats, logs: Floats) -> float:
    """Minus the log likelihood of innovations, each counted up to a limit."""
    return 0.5 * float((logs + np.minimum(z**2, _LIMIT**2)).sum())
