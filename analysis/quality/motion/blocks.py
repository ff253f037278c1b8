"""Robust least squares on blocks of time, frequency by frequency, with intervals that mean what they say.

Differences of a measured level (position, heading) and an integrated rate are white noise of the level plus the
random walk of the integrated noise. The cosine transform of a block makes both uncorrelated, so each frequency is
weighted by its own noise, estimated from the residuals themselves; the mean of a block is left out, hence no
level and no drift from block to block matters. Blocks that do not belong (jumps) lose weight. The covariance is
the larger of what the noise says and what leaving out one block after another says (jackknife: B. Efron, The
Jackknife, the Bootstrap and Other Resampling Plans, 1982).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from acquisition.core.arrays import Floats
from analysis.quality.samples import jackknife_error

_ROUNDS = 4
_TOLERATED = 4.0
_LEAST_RELIABILITY = 0.7
_CHI2_MEDIAN = 0.455


@dataclass(frozen=True, slots=True)
class Solution:
    """``parameters`` [p], their ``covariance`` [p, p], and the effective number of blocks for each [p]."""

    parameters: Floats
    covariance: Floats
    informative: Floats


def cosines(levels: Floats, starts: NDArray[np.int64], length: int, most: int) -> Floats:
    """Orthonormal cosine coefficients 1..``most`` of blocks of levels [points, ...]: [blocks, ..., most]."""
    from scipy.fft import dct

    blocks = levels[starts[:, np.newaxis] + np.arange(length)]
    return np.moveaxis(dct(blocks, axis=1, norm="ortho")[:, 1 : most + 1], 1, -1)


def solve(residuals: Floats, slopes: Floats, halves: tuple[Floats, Floats], prior: Floats) -> Solution:
    """Estimate parameters from residuals [blocks, c, k] and their derivatives ``slopes`` [blocks, p, c, k].

    ``halves`` are the slopes from every other sample and from the rest: what they do not have in common is noise
    and carries no information. ``prior`` [p] are standard deviations far beyond anything sensible: they bound what
    the data do not determine.
    """
    bands = _bands(residuals.shape[-1])
    weights = np.broadcast_to(1.0 / _noise(residuals, bands), residuals.shape)
    for _ in range(_ROUNDS):
        matrices, sides = _normal(residuals, slopes, weights)
        values = np.linalg.solve(matrices.sum(axis=0) + np.diag(prior**-2.0), sides.sum(axis=0))
        left = residuals - np.einsum("bpck,p->bck", slopes, values)
        noise = _noise(left, bands)
        weights = np.broadcast_to(_trust(left**2 / noise, bands) / noise, residuals.shape)
    matrices, sides = _normal(residuals, slopes, weights)
    first, second = (each.reshape(len(each), prior.size, -1) for each in halves)
    common = np.einsum("bpn,bn,bqn->pq", first, weights.reshape(len(weights), -1), second, optimize=True)
    return _solution(matrices, sides, 0.5 * (common + common.T), prior)


def _normal(residuals: Floats, slopes: Floats, weights: Floats) -> tuple[Floats, Floats]:
    """The normal equations of each block: [blocks, p, p] and [blocks, p]."""
    count, parameters = slopes.shape[:2]
    flat = slopes.reshape(count, parameters, -1)
    weighted = flat * weights.reshape(count, 1, -1)
    return weighted @ flat.transpose(0, 2, 1), (weighted @ residuals.reshape(count, -1, 1))[..., 0]


def _solution(matrices: Floats, sides: Floats, common: Floats, prior: Floats) -> Solution:
    """The solution in the directions of parameter space that the data determine. In the others the estimate is
    zero, and its standard error ten times the nominal one, or the prior.

    A direction's reliability is the part of its information that both halves of the samples share. Noise in
    slopes makes a parameter too small by just that factor (attenuation: W. A. Fuller, Measurement Error Models,
    1987), which is undone.
    """
    precision = np.diag(prior**-2.0)
    root = np.linalg.inv(np.linalg.cholesky(matrices.sum(axis=0) + precision))
    reliability, turned = np.linalg.eigh(root @ (common + precision) @ root.T)
    directions = root.T @ turned
    told = reliability > _LEAST_RELIABILITY
    basis = directions[:, told] / np.minimum(reliability[told], 1.0)
    values = basis @ directions[:, told].T @ sides.sum(axis=0)
    covariance, informative = _spread(matrices, sides, directions[:, told], basis)
    untold = directions[:, ~told]
    size = np.maximum(np.einsum("pi,pq,qi->i", untold, precision, untold), np.maximum(reliability[~told], 0.1) ** 2)
    return Solution(values, covariance + (untold / size) @ untold.T + 1e-12 * np.diag(prior**2), informative)


def _spread(matrices: Floats, sides: Floats, directions: Floats, basis: Floats) -> tuple[Floats, Floats]:
    """The covariance, from the noise and by a jackknife, and the effective number of blocks for each parameter."""
    covariance = basis @ basis.T
    shares = np.einsum("pi,bij,pj->bp", basis, directions.T @ matrices @ directions, basis, optimize=True)
    informative = shares.sum(axis=0) ** 2 / np.maximum((shares**2).sum(axis=0), 1e-300)
    reduced = np.eye(basis.shape[1]) - directions.T @ matrices @ directions
    rest = (sides.sum(axis=0) - sides) @ directions
    without = np.linalg.solve(reduced, rest[..., np.newaxis])[..., 0] @ basis.T
    spread = jackknife_error(without) ** 2
    larger = np.sqrt(np.maximum(1.0, spread / np.maximum(np.diag(covariance), 1e-300)))
    return covariance * np.outer(larger, larger), informative


def _bands(count: int) -> NDArray[np.int64]:
    """First coefficients of bands that widen with frequency by about a third."""
    edges = np.unique(np.floor(1.33 ** np.arange(0, 60)).astype(np.int64) - 1)
    return edges[edges < count]


def _noise(left: Floats, bands: NDArray[np.int64]) -> Floats:
    """Variance of each component at each frequency [c, k], robust, and at least that of all higher ones."""
    power = np.median(left**2, axis=0) / _CHI2_MEDIAN
    sizes = np.diff(np.append(bands, power.shape[-1]))
    level = np.add.reduceat(power, bands, axis=-1) / sizes
    falling = np.maximum.accumulate(level[:, ::-1], axis=-1)[:, ::-1]
    return np.repeat(np.maximum(falling, 1e-18), sizes, axis=-1)


def _trust(ratio: Floats, bands: NDArray[np.int64]) -> Floats:
    """Weights of the blocks' bands: 1 where as noisy as the others, less where noisier; shape of ``ratio``."""
    sizes = np.diff(np.append(bands, ratio.shape[-1]))
    excess = np.add.reduceat(ratio.sum(axis=1), bands, axis=-1) / (sizes * ratio.shape[1])
    trust = np.minimum(1.0, _TOLERATED / np.maximum(excess, 1e-300))
    return np.repeat(trust, sizes, axis=-1)[:, np.newaxis, :]
