"""The noise levels under which what was measured is the most likely, once all effects have had their say.

Maximum likelihood (:mod:`analysis.estimation.likelihood`) on the innovations of the disturbed ship's filter. The
data come with every effect's part taken off first; else a missing effect passes for noise and hides itself.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from acquisition.core.arrays import Floats
from analysis.estimation.likelihood import Prior, Scoring, most_likely, robust_cost
from hybrid.diagnosis.innovations import Columns, whitened
from hybrid.diagnosis.linearise import Linear
from hybrid.diagnosis.noise import Noise

_SCORING = Scoring(limit=16.0, longest_step=1.0, damping=(1.0, 4.0), enough=1.0)
_DEVIATION = 1.5  # of the logarithm of each level about where the search begins
_ROOM = 2.0
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
    low, high = _bounds(start, _most(linear, data))
    begin, there = np.clip(_parameters(start), low, high), np.isfinite(data.seen[:, :, 0])

    def innovations(at: Floats) -> tuple[Floats, Floats]:
        return _innovations(linear, data, edges, _noise(start, at), there)

    how = replace(_SCORING, most_steps=steps)
    found, cost = most_likely(innovations, begin, low, high, how, Prior(begin, _DEVIATION))
    return _noise(start, found), 0.5 * cost


def _innovations(
    linear: Linear, data: Columns, edges: NDArray[np.int64], noise: Noise, there: NDArray[np.bool_]
) -> tuple[Floats, Floats]:
    """All innovations and their variances."""
    z, variance = whitened(linear, data, noise, edges)
    return (z[:, :, 0] * np.sqrt(variance))[there], variance[there]


def _most(linear: Linear, data: Columns) -> Floats:
    """The logarithm of the largest level that each sensor can have: noise would show in its third differences.

    Half of them lie below what is given here whatever the ship does; so jumps and jitter do not pass for noise.
    """
    value = data.seen[:, :, 0] + linear.origin
    third = np.abs(np.diff(value, 3, axis=0)) / np.sqrt(20.0)
    level = 1.4826 * np.array([np.median(each[np.isfinite(each)]) for each in third.T])
    level[0] = max(level[:2])
    return np.asarray(np.log(_ROOM * np.maximum(level[[0, 2, 3, 4, 5]], np.exp(_LEAST))))


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


def _bounds(kind: Noise, most: Floats) -> tuple[Floats, Floats]:
    """The least and the largest that each parameter may be."""
    size = len(_parameters(kind))
    low, high = np.full(size, -np.inf), np.full(size, np.inf)
    low[: len(_LEAST)], high[: len(_LEAST)] = _LEAST, most
    places = {"slow_s": _ALWAYS - 1}
    if kind.has_waves:
        places |= {"wave_frequency_radps": _ALWAYS + 3, "wave_damping": _ALWAYS + 4}
    if kind.has_drift:
        places["drift_s"] = size - 1
    for name, place in places.items():
        low[place], high[place] = np.log(_BOUNDS[name])
    return low, high


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
    there = np.isfinite(data.seen[:, :, 0])
    return 0.5 * robust_cost(*_innovations(linear, data, edges, noise, there), _SCORING.limit)
