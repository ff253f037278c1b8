"""Whether what a recording tells is the same throughout: its quarters, each fitted by itself.

Where they differ by more than they err, their spread is an error of its own (random effects: R. DerSimonian and
N. Laird, Meta-analysis in clinical trials, 1986), and the interval is Student's for as many quarters.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from acquisition.core.arrays import Floats
from acquisition.core.errors import DataShortageError
from analysis.quality.motion.kinematics import Kinematics, fit_motion, quantile, rescaled
from analysis.quality.motion.series import Group, Motion

_PARTS = 4
_FEWEST_PARTS = 3
_CHANCE = 1e-3
_SAMPLES = 8
_ALIKE = np.array([2e-4, 2e-4, 0.01, 0.01, 0.05, 0.05, 5e-4, 1e-5, 0.01])
"""Differences that sampling and interpolation may make, as standard deviations."""


def with_parts(fit: Kinematics) -> Kinematics:
    """The fit with the half widths of intervals that its quarters ask for.

    It takes as long as the fit itself. Recordings of whose quarters fewer than three can be
    fitted stay as they are.
    """
    coarse = fit.coarse
    motion = rescaled(fit.motion, coarse.speed_factor, coarse.heading_offset_rad, coarse.yaw_rate_factor)
    parts = [part for part in map(_fitted, _quarters(motion)) if part is not None and part.converged]
    if len(parts) < _FEWEST_PARTS:
        return fit
    half = _half_between(
        np.array([part.parameters for part in parts]), np.array([_variance(part) for part in parts])
    )
    half[0] *= abs(coarse.speed_factor)
    half[6] *= abs(coarse.yaw_rate_factor)
    return replace(fit, half_between=half)


def _half_between(values: Floats, variance: Floats) -> Floats:
    """Half of the 95 % interval of the mean of values [parts, p], zero where they agree within their variances."""
    from scipy.special import chdtri, stdtrit

    weights, freedom = 1.0 / variance, len(values) - 1
    total = weights.sum(axis=0)
    apart = (weights * (values - (weights * values).sum(axis=0) / total) ** 2).sum(axis=0)
    added = np.maximum(apart - freedom, 0.0) / np.maximum(total - (weights**2).sum(axis=0) / total, 1e-300)
    error = np.sqrt(1.0 / (1.0 / (variance + added)).sum(axis=0))
    limit, times = float(chdtri(freedom, _CHANCE)), float(stdtrit(freedom, 0.975))
    half: Floats = np.where(apart > limit, times * error, 0.0)
    return half


def _variance(part: Kinematics) -> Floats:
    """As large as few blocks make it, as Student's t is wider than a normal deviate at 95 %."""
    wider = np.array([quantile(0.975, each) / 1.96 for each in part.informative])
    return np.asarray((part.standard_errors * wider) ** 2 + _ALIKE**2)


def _quarters(motion: Motion) -> list[Motion]:
    edges = np.linspace(motion.position.time_s[0], motion.position.time_s[-1], _PARTS + 1)
    return [part for part in (_part(motion, *bounds) for bounds in pairwise(edges)) if part is not None]


def _part(motion: Motion, begin: float, end: float) -> Motion | None:
    position, heading, speed, yaw_rate = (_within(each, begin, end) for each in motion.groups)
    if min(each.time_s.size for each in (position, heading, speed, yaw_rate)) < _SAMPLES:
        return None
    return Motion(position, heading, speed, yaw_rate, motion.step_s)


def _within(samples: Group, begin: float, end: float) -> Group:
    return samples.without((samples.time_s < begin) | (samples.time_s > end))


def _fitted(motion: Motion) -> Kinematics | None:
    try:
        return fit_motion(motion)
    except DataShortageError:
        return None
