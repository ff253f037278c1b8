"""How sure a prediction is, and what to say where it has no ground.

A 95 % region is a circle about each predicted position. Its radius is a quantile of errors on legs that took no
part in the training (split conformal prediction, Lei et al. 2018), relative to how uncertain the method says that
each window is. Where a method has no ground, the better of the reference and of constant velocity speaks instead:
the one that would have predicted the last seconds better, which needs nothing but what was measured by then.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hybrid.baselines import constant_velocity, modelled
from hybrid.horizon import Horizons, difference_rad
from hybrid.scores import distances
from hybrid.vessel.plant import Plant

if TYPE_CHECKING:
    from hybrid.calibrators.calibrator import Calibrator

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

COVERAGE = 0.95
HINDCAST_S = 15
_UNSURE_M = 0.5  # no hindcast is believed to better than this
_UNKNOWN_M = 2.0  # where there is none; the same whatever other windows are asked about
FALLBACKS = ("reference", "constant_velocity")


@dataclass(frozen=True, slots=True)
class Fallback:
    """What speaks where a calibrator has no ground: ``tracks`` [N, H+1, 3], ``chosen`` [N] of :data:`FALLBACKS`,
    and ``spread_m`` [N], the error over the last seconds that its region grows with.
    """

    tracks: Floats
    chosen: NDArray[np.str_]
    spread_m: Floats


def band_radius(predicted: Floats, measured: Floats, spread: Floats | None = None) -> Floats:
    """The radius, in units of ``spread`` [N, H], that holds 95 % of the measured positions, by second [H].

    The quantile is that of split conformal prediction, ceil((n + 1) 0.95) of n, so it does not shrink with few
    windows; it never falls from one second to the next. Seconds that were not measured or not predicted (NaN) do
    not count.
    """
    distance = distances(predicted, measured)
    relative = distance if spread is None else distance / spread
    count = np.isfinite(relative).sum(axis=0)
    rank = np.minimum(np.ceil((count + 1) * COVERAGE), count).astype(np.int64) - 1
    return np.maximum.accumulate(np.take_along_axis(np.sort(relative, axis=0), rank[None], axis=0)[0])


@dataclass(frozen=True, slots=True)
class Predicted:
    """What a trained calibrator says of N windows: ``tracks`` [N, H+1, 3] and the radius of their 95 % regions
    ``radius_m`` [N, H]; ``untrained`` [N] where it has no ground, and who speaks there instead: ``method`` [N].
    """

    tracks: Floats
    radius_m: Floats
    untrained: Flags
    method: NDArray[np.str_]


def guarded(
    calibrator: Calibrator,
    plant: Plant,
    band_m: Floats,
    fallback_band: Floats,
    horizons: Horizons,
    reference: Floats,
) -> Predicted:
    """The calibrator where it has ground, the better of reference and constant velocity where not.

    ``band_m`` [H] is :meth:`Calibrator.region`, ``fallback_band`` [H] is :func:`fallback_region`.
    """
    untrained = calibrator.outside(horizons, reference)
    tracks, spread = calibrator.predict_with_spread(horizons, reference)
    radius_m = spread * band_m
    lost = untrained | ~np.isfinite(tracks).all(axis=(1, 2))
    method = np.where(lost, "", "hybrid").astype("<U20")
    if lost.any():
        instead = fallback(horizons.subset(lost), reference[lost], plant)
        tracks[lost], method[lost] = instead.tracks, instead.chosen
        radius_m[lost] = instead.spread_m[:, None] * fallback_band
    return Predicted(tracks, radius_m, lost, method)


def fallback_region(horizons: Horizons, reference: Floats, plant: Plant) -> Floats:
    """The radius that holds 95 % of positions about :func:`fallback`, per metre of its spread, by second [H]."""
    instead = fallback(horizons, reference, plant)
    return band_radius(instead.tracks, horizons.track, instead.spread_m[:, None])


def earlier(horizons: Horizons, seconds: int) -> tuple[Horizons, Floats]:
    """The windows as they stood so many seconds before: ``seconds`` long, up to second 0, and what acted in them.

    Returns the windows [N] and the recorded controls [N, seconds, 5]; NaN where the past is not known.
    """
    past = np.full_like(horizons.past, np.nan)
    past[:, : past.shape[1] - seconds] = horizons.past[:, seconds:]
    recorded = horizons.past[:, seconds::-1]
    turn = np.diff(recorded[..., 8:], axis=1)
    turn[..., [1, 3]] = difference_rad(recorded[:, 1:, [9, 11]], recorded[:, :-1, [9, 11]])
    moved = replace(
        horizons,
        start=recorded[:, 0, :6],
        track=recorded[..., :3],
        wind=recorded[:, 0, 6:8],
        control=recorded[:, 0, 8:],
        past=past,
    )
    return moved, recorded[:, :-1, 8:] + 0.5 * turn


def off_m(predicted: Floats, measured: Floats) -> Floats:
    """The mean distance of each window [N]; NaN where either is not known."""
    return np.asarray(distances(predicted, measured).mean(axis=1))


def fallback(horizons: Horizons, reference: Floats, plant: Plant) -> Fallback:
    """The better of the reference's tracks and of constant velocity by the last :data:`HINDCAST_S` seconds.

    Where these are not known it is the reference.
    """
    before, acted = earlier(horizons, HINDCAST_S)
    model = modelled(plant, before.start, acted, before.wind)
    errors = np.stack([off_m(model, before.track), off_m(constant_velocity(before), before.track)])
    errors = np.where(np.isfinite(errors), errors, np.inf)
    best, least_m = np.argmin(errors, axis=0), errors.min(axis=0)
    both = np.stack([reference, constant_velocity(horizons)])
    return Fallback(
        tracks=both[best, np.arange(len(horizons))],
        chosen=np.array(FALLBACKS)[best],
        spread_m=_UNSURE_M + np.where(np.isfinite(least_m), least_m, _UNKNOWN_M),
    )
