"""Smoothing of a manoeuvre, and what noise and waves do to an index: a bootstrap with the noise's own spectrum.

The measured motion is a smooth one and a remainder, noise and waves. Many times over a remainder of the same
spectrum with other phases (Theiler et al. 1992, Physica D 58) is laid on the smooth motion, the smoothing is
done again and the index read off again. The spread of the results is the index's uncertainty, their mean less
the value it started from is the error that the smoothing itself makes, and is taken off.

The smoother has swallowed the slow part of the noise, so that the remainder lacks it; there its spectrum is
taken to go on at the level it has just above.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache

import numpy as np

from acquisition.core.arrays import Floats
from analysis.estimation.local_polynomial import local_quadratic
from analysis.manoeuvres.indices import unit_of
from analysis.manoeuvres.motion import MEASURED, Motion

REPLICATES = 48
WIDEST_S = 8.0
_FEWEST_ROWS = 3
_TWO_SIDED_95 = 1.96
_SEED = 137

Measure = Callable[[Motion, Floats], dict[str, float]]
"""Indices of a smooth motion, and of the times at which commands were changed [s]."""


def half_width_s(motion: Motion, time_scale_s: float) -> float:
    """A quarter of the time in which the manoeuvre does something, 8 s at most: slow enough for waves."""
    return float(np.clip(time_scale_s / 4.0, _FEWEST_ROWS * motion.step_s, max(WIDEST_S, 3 * motion.step_s)))


def smoothed(motion: Motion, half_width: float) -> Motion:
    """Pose and speeds replaced by local second-degree fits over ``half_width`` [s] to either side."""
    rows = half_width / motion.step_s
    return motion.measuring({name: _quadratic(getattr(motion, name), rows) for name in MEASURED})


def _quadratic(values: Floats, half_width: float) -> Floats:
    """:func:`analysis.estimation.local_polynomial.local_quadratic` of values without holes: a convolution, and
    at the ends the sums that the one-sided fits are. A manoeuvre is smoothed some fifty times over."""
    reach = int(np.ceil(half_width))
    if reach < 6 or values.size < 4 * reach:
        return local_quadratic(values, half_width)
    start, kernel = _weights(half_width)
    smooth = np.empty_like(values)
    smooth[reach:-reach] = np.convolve(values, kernel, mode="valid")
    smooth[:reach] = start @ values[: 2 * reach]
    smooth[-reach:] = (start @ values[: -2 * reach - 1 : -1])[::-1]
    return smooth


@lru_cache(maxsize=64)
def _weights(half_width: float) -> tuple[Floats, Floats]:
    """The fit at each of the first rows as a sum over the first values [reach, 2 reach], and at any row further
    in as a sum over those around it [2 reach + 1]."""
    reach = int(np.ceil(half_width))
    offset = (np.arange(2 * reach + 1) - np.arange(reach + 1)[:, np.newaxis]) / half_width
    weight = np.where(np.abs(offset) < 1.0, 0.5 + 0.5 * np.cos(np.pi * offset), 0.0)
    powers = offset[..., np.newaxis] ** np.arange(3)
    normal = np.einsum("rk,rki,rkj->rij", weight, powers, powers)
    first = np.linalg.inv(normal)[:, 0, :]
    sums = weight * np.einsum("ri,rki->rk", first, powers)
    return sums[:-1, :-1], sums[-1]


def measured_with_intervals(
    motion: Motion,
    executes_s: Floats,
    half_width: float,
    measure: Measure,
    unsure_rows: float = 0.5,
    seed: int = _SEED,
) -> dict[str, tuple[float, float]]:
    """Value and half of the 95 % interval of every index that ``measure`` reads off a motion.

    The moments of the commands are only known to a row: each is moved about by ``unsure_rows``, and all together
    by as much, since what the shape of a command between rows does to one it does to all.
    """
    random = np.random.default_rng(seed)
    smooth = smoothed(motion, half_width)
    values = measure(smooth, executes_s)
    spectra = {name: _spectrum(getattr(motion, name) - getattr(smooth, name), half_width / motion.step_s)
               for name in MEASURED}  # fmt: skip
    repeats = []
    for _ in range(REPLICATES):
        again = smoothed(_with_noise(smooth, spectra, random), half_width)
        shifts = random.uniform(-1.0, 1.0, executes_s.shape) + random.uniform(-1.0, 1.0)
        moved = executes_s + motion.step_s * unsure_rows * shifts
        repeats.append(measure(again, moved))
    path_within = _TWO_SIDED_95 * np.sqrt(2.0) * motion.path_sd_m  # both ends of a way are off
    found = {}
    for name, value in values.items():
        believed, within = _believed(value, np.array([each.get(name, np.nan) for each in repeats]))
        found[name] = believed, float(np.hypot(within, path_within)) if unit_of(name) == "m" else within
    return found


def _believed(value: float, repeats: Floats) -> tuple[float, float]:
    """The value without the error of smoothing, and half of its interval.

    The error is itself only an estimate: a half of it counts as one standard deviation.
    """
    repeats = repeats[np.isfinite(repeats)]
    if not np.isfinite(value) or repeats.size < REPLICATES // 2:
        return value, float("nan")
    bias = float(np.median(repeats)) - value
    return value - bias, _TWO_SIDED_95 * float(np.hypot(repeats.std(ddof=1), 0.5 * bias))


def _with_noise(smooth: Motion, spectra: Mapping[str, Floats], random: np.random.Generator) -> Motion:
    rows = smooth.time_s.size
    return smooth.measuring(
        {name: getattr(smooth, name) + _drawn(spectra[name], rows, random) for name in MEASURED}
    )


def _drawn(amplitude: Floats, size: int, random: np.random.Generator) -> Floats:
    """A series of a given spectrum of amplitudes with random phases."""
    parts = random.standard_normal((2, amplitude.size)) / np.sqrt(2.0)
    return np.fft.irfft(amplitude * (parts[0] + 1j * parts[1]), size)


def _spectrum(remainder: Floats, half_rows: float) -> Floats:
    """The amplitudes of the noise from those of the remainder, its slow part filled in.

    Below one cycle per half width the local fit follows; the octave above it gives the level there.
    """
    amplitude = np.abs(np.fft.rfft(remainder - remainder.mean()))
    frequency = np.fft.rfftfreq(remainder.size)
    edge = min(1.0 / max(half_rows, 1.0), 0.25)
    above = (frequency >= edge) & (frequency < 2.0 * edge)
    if above.any():
        amplitude[frequency < edge] = np.sqrt(np.mean(amplitude[above] ** 2))
    amplitude[0] = 0.0
    return amplitude
