"""Wind, waves and their slow force: Kaimal gusts and a short-crested Bretschneider sea."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, exp, pi, sin

import numpy as np
from numba import njit
from scipy.fft import irfft, next_fast_len, rfft, rfftfreq
from scipy.ndimage import uniform_filter1d

from seatrial.acquisition.core.quantities import Floats

GRAVITY_MPS2 = 9.81
COMPONENTS = 48
GUST_LENGTH_M, GUST_ALONG, GUST_ACROSS = 120.0, 0.12, 0.09
SLOW_N_PER_M2, GROUP_S = 500.0, 12.0
ROLL_PERIOD_S, ROLL_DAMPING, ROLL_CENTRE_M = 7.0, 0.12, 0.5


@dataclass(frozen=True, slots=True)
class Sea:
    """Mean wind, significant wave height and peak period; directions are drawn by the trial."""

    wind_mps: float
    wave_height_m: float
    wave_period_s: float


SEAS = {
    "calm": Sea(0.0, 0.0, 5.0),
    "gentle": Sea(4.0, 1.0, 5.0),
    "moderate": Sea(8.0, 2.0, 6.5),
    "rough": Sea(11.0, 2.5, 7.2),
}


@dataclass(frozen=True, slots=True)
class Waves:
    """A sea's components: amplitudes [m], frequencies [rad/s], directions they go to [rad], phases."""

    amplitude_m: Floats
    frequency_radps: Floats
    to_rad: Floats
    phase_rad: Floats


def gusts(random: np.random.Generator, wind_mps: float, steps: int, dt_s: float) -> Floats:
    """Gusts along and across the mean wind [steps, 2] in m/s: white noise filtered to the Kaimal spectrum.

    S(n) ~ 1 / (1 + 6 n L / U)^(5/3), IEC 61400-1 in form; the sample mean is taken out, so that the mean wind is
    what was asked for.
    """
    if wind_mps == 0.0:
        return np.zeros((steps, 2))
    long = next_fast_len(int(1.2 * steps), real=True)
    shape = (1.0 + 6.0 * rfftfreq(long, dt_s) * GUST_LENGTH_M / wind_mps) ** (-5.0 / 6.0)
    shape[0] = 0.0
    noise = irfft(rfft(random.standard_normal((long, 2)), axis=0) * shape[:, np.newaxis], long, axis=0)
    scaled = noise / noise.std(axis=0) * wind_mps * np.array([GUST_ALONG, GUST_ACROSS])
    return np.asarray((scaled - scaled[:steps].mean(axis=0))[:steps])


def waves(random: np.random.Generator, sea: Sea, to_rad: float) -> Waves:
    """A Bretschneider sea, its components spread about a direction with cos^2."""
    peak = 2.0 * pi / sea.wave_period_s
    edges = np.linspace(0.65 * peak, 3.0 * peak, COMPONENTS + 1)
    frequency = edges[:-1] + random.uniform(0.0, 1.0, COMPONENTS) * np.diff(edges)
    density = frequency**-5.0 * np.exp(-1.25 * (peak / frequency) ** 4) * np.diff(edges)
    amplitude = np.sqrt(2.0 * density / density.sum()) * sea.wave_height_m / 4.0
    # cos^2 spread: its distribution function is inverted on a grid
    grid = np.linspace(-0.5 * pi, 0.5 * pi, 721)
    share = (grid + 0.5 * np.sin(2.0 * grid)) / pi + 0.5
    spread = np.interp(random.uniform(0.0, 1.0, COMPONENTS), share, grid)
    return Waves(amplitude, frequency, to_rad + spread, random.uniform(0.0, 2.0 * pi, COMPONENTS))


def slow_drift(sea: Sea, components: Waves, steps: int, dt_s: float) -> Floats:
    """The slowly varying part of the wave force [N, steps]: the squared envelope about its own mean.

    Its mean over the trial is zero: a mean drift is an effect of the catalogue and comes from there alone.
    """
    if sea.wave_height_m == 0.0:
        return np.zeros(steps)
    times = np.arange(0.0, steps * dt_s + 1.0, 1.0)
    turning = np.exp(1j * (np.outer(times, components.frequency_radps) + components.phase_rad))
    squared = np.abs(turning @ components.amplitude_m) ** 2 / np.sum(components.amplitude_m**2)
    series = np.interp(np.arange(steps) * dt_s, times, uniform_filter1d(squared, int(GROUP_S), mode="nearest"))
    return np.asarray(SLOW_N_PER_M2 * sea.wave_height_m**2 * (series - series.mean()))


def wave_motion(
    components: Waves, track: Floats, speed: Floats, length_m: float, draught_m: float, dt_s: float
) -> Floats:
    """First-order motion north, east [m], yaw and roll [rad] along ``track`` [rows, 3] at ``speed`` [rows, 2]."""
    out = np.zeros((len(track), 4))
    if components.amplitude_m.any():
        columns = np.column_stack(
            [components.amplitude_m, components.frequency_radps, components.to_rad, components.phase_rad]
        )
        _add_waves(columns, track, speed, length_m, draught_m, dt_s, out)
    return out


@njit(cache=True, error_model="numpy")
def _add_waves(
    waves: Floats, track: Floats, speed: Floats, length_m: float, draught_m: float, dt_s: float, out: Floats
) -> None:
    """Add each component's answer; the ship follows the water, less for waves shorter than herself.

    Roll resonates at the frequency of encounter about a centre below the reference point, which it moves sideways.
    """
    natural = 2.0 * pi / ROLL_PERIOD_S
    for j in range(waves.shape[0]):
        a, w, to, e = waves[j]
        k = w * w / GRAVITY_MPS2
        deep = a * exp(-0.5 * k * draught_m)
        ct, st = cos(to), sin(to)
        for i in range(track.shape[0]):
            north, east, psi = track[i]
            phase = k * (north * ct + east * st) - w * i * dt_s + e
            s, c = sin(phase), cos(phase)
            b = to - psi
            sb, cb = sin(b), cos(b)
            short = 1.0 / (1.0 + (k * length_m * cb / pi) ** 2)
            moved = -deep * short * s
            x = (w - k * (speed[i, 0] * ct + speed[i, 1] * st)) / natural
            bottom = (1.0 - x * x) ** 2 + (2.0 * ROLL_DAMPING * x) ** 2
            roll = deep * k * sb * ((1.0 - x * x) * s + 2.0 * ROLL_DAMPING * x * c) / bottom
            sway = ROLL_CENTRE_M * roll
            out[i, 0] += moved * ct - sway * sin(psi)
            out[i, 1] += moved * st + sway * cos(psi)
            out[i, 2] += -deep * k * short * short * sb * cb * c
            out[i, 3] += roll


def air_motion(direction_from_rad: float, wind_mps: float, gust: Floats) -> Floats:
    """The air's motion north and east [steps, 2] in m/s of a mean wind and its gusts."""
    along, across = wind_mps + gust[:, 0], gust[:, 1]
    c, s = cos(direction_from_rad), sin(direction_from_rad)
    return np.column_stack([-along * c + across * s, -along * s - across * c])
