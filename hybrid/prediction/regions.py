"""How sure a prediction is, and what to say where it has no ground.

A 95 % region is a circle about each predicted position. Its radius is a quantile of errors on legs that took no
part in the training (split conformal prediction, Lei et al. 2018), relative to how uncertain the method says that
each window is. Where a method has no ground, reference and constant velocity speak instead, the better of them the
louder: by how far off each was in the training, and by how much better or worse than that it would have predicted
the last seconds, which needs nothing but what was measured by then.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from acquisition.core.arrays import Bools, Floats
from hybrid.prediction.baselines import constant_velocity, modelled
from hybrid.prediction.prediction_windows import Horizons, difference_rad
from hybrid.prediction.scores import distances
from hybrid.vessel.plant import Plant

if TYPE_CHECKING:
    from hybrid.calibrators.calibrator import Calibrator


COVERAGE = 0.95
HINDCAST_S = 15
_UNSURE_M = 0.5  # no hindcast is believed to better than this
_UNKNOWN_M = 2.0  # where there is none; the same whatever other windows are asked about
_BELIEVED = 0.5  # an error over the last seconds four times the usual one announces one of twice the usual size
_LEAST_M = 0.001  # no method is better than that, not even the truth on itself
_PERFECT = 0.01  # of the usual error: nothing is believed to be perfect
_LOUDNESS = 4.0  # nearly the better one alone, unless they are as good as each other
FALLBACKS = ("reference", "constant_velocity")


@dataclass(frozen=True, slots=True)
class Reserve:
    """What the training says of those who speak where a calibrator has no ground.

    By :data:`FALLBACKS`: mean errors over the horizon ``usual_m`` [2] and over the seconds before ``before_m`` [2].
    ``band`` [H] is the radius that holds 95 % of the positions about what they say together, per metre of spread.
    """

    usual_m: Floats
    before_m: Floats
    band: Floats


@dataclass(frozen=True, slots=True)
class Fallback:
    """What speaks where a calibrator has no ground: ``tracks`` [N, H+1, 3], ``chosen`` [N] of :data:`FALLBACKS`,
    the louder one, and ``spread_m`` [N], which its region grows with: the error over the last seconds, and no less
    than the usual one.
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
    untrained: Bools
    method: NDArray[np.str_]


def guarded(
    calibrator: Calibrator,
    plant: Plant,
    band_m: Floats,
    reserve: Reserve,
    horizons: Horizons,
    reference: Floats,
) -> Predicted:
    """The calibrator where it has ground, reference and constant velocity where not.

    ``band_m`` [H] is :meth:`Calibrator.region`, ``reserve`` is :func:`reserve_of` the training.
    """
    untrained = calibrator.outside(horizons, reference)
    tracks, spread = calibrator.predict_with_spread(horizons, reference)
    radius_m = spread * band_m
    lost = untrained | ~np.isfinite(tracks).all(axis=(1, 2))
    method = np.where(lost, "", "hybrid").astype("<U20")
    if lost.any():
        instead = fallback(horizons.subset(lost), reference[lost], plant, reserve)
        tracks[lost], method[lost] = instead.tracks, instead.chosen
        radius_m[lost] = instead.spread_m[:, None] * reserve.band
    return Predicted(tracks, radius_m, lost, method)


def reserve_of(horizons: Horizons, reference: Floats, plant: Plant) -> Reserve:
    """What windows of the training, of which ``reference`` are the model's tracks, say of reference and constant
    velocity.
    """
    both, before_m = _baselines(horizons, reference, plant)
    usual_m = [_mean_known(off_m(track, horizons.track)) for track in both]
    usual_before_m = [_mean_known(each) for each in before_m]
    alone = Reserve(np.array(usual_m), np.array(usual_before_m), np.ones(horizons.horizon_s))
    said = _together(both, before_m, alone)
    return replace(alone, band=band_radius(said.tracks, horizons.track, said.spread_m[:, None]))


def _mean_known(errors_m: Floats) -> float:
    """The mean of those that are known; :data:`_UNKNOWN_M` where none is, as where nothing was recorded before."""
    known = errors_m[np.isfinite(errors_m)]
    return max(float(known.mean()), _LEAST_M) if known.size else _UNKNOWN_M


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


def fallback(horizons: Horizons, reference: Floats, plant: Plant, reserve: Reserve) -> Fallback:
    """What reference and constant velocity say together of windows, each with the fourth power of how small an
    error is expected of it: that of the training, and more or less as it was off over the last
    :data:`HINDCAST_S` seconds, where these are known.
    """
    return _together(*_baselines(horizons, reference, plant), reserve)


def _together(both: Floats, before_m: Floats, reserve: Reserve) -> Fallback:
    """What the tracks of :data:`FALLBACKS` [2, N, H+1, 3] say together, by their errors of before [2, N]."""
    known = np.isfinite(before_m)
    with np.errstate(invalid="ignore"):
        surprise = (before_m / reserve.before_m[:, None] + _PERFECT) ** _BELIEVED
    expected_m = reserve.usual_m[:, None] * np.where(known, surprise, np.where(known.any(axis=0), np.inf, 1.0))
    expected_m[~np.isfinite(both).all(axis=(2, 3))] = np.inf
    weight = expected_m**-_LOUDNESS / (expected_m**-_LOUDNESS).sum(axis=0)
    seen_m = np.where(known, before_m, _UNKNOWN_M)
    return Fallback(
        tracks=blended(weight, both),
        chosen=np.array(FALLBACKS)[weight.argmax(axis=0)],
        spread_m=_UNSURE_M + (weight * np.maximum(seen_m, reserve.before_m[:, None])).sum(axis=0),
    )


def blended(weight: Floats, tracks: Floats) -> Floats:
    """Tracks [ways, N, H+1, 3] averaged by weights [ways, N]; one of no weight may be no number [N, H+1, 3]."""
    heard = np.where(weight[..., None, None] > 0.0, tracks, 0.0)
    return np.asarray(np.einsum("wn,wnhc->nhc", weight, heard))


def _baselines(horizons: Horizons, reference: Floats, plant: Plant) -> tuple[Floats, Floats]:
    """The tracks [2, N, H+1, 3] of :data:`FALLBACKS`, and how far off they were over the seconds before [2, N]."""
    before, acted = earlier(horizons, HINDCAST_S)
    model = modelled(plant, before.start, acted, before.wind)
    errors_m = np.stack([off_m(model, before.track), off_m(constant_velocity(before), before.track)])
    return np.stack([reference, constant_velocity(horizons)]), errors_m
