"""How predictions are off, second by second: along and across the heading, in heading, in speed; and whether the
regions that come with them hold what they say.

Windows are [N], seconds 1 to H. Errors are predicted less measured.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from acquisition.core.arrays import Floats
from hybrid.prediction.prediction_windows import PredictionWindows, difference_rad, in_ship_axes
from hybrid.prediction.scores import LegBootstrap, distances
from hybrid.report.motion import speeds_of
from hybrid.report.words import plain

QUANTITIES = {
    "distance": "distance [m]",
    "along": "along the heading [m]",
    "across": "across the heading [m]",
    "heading": "heading [deg]",
    "speed": "speed over ground [m/s]",
}
"""What a prediction may be off in, for people; the names are the attributes of :class:`Errors`."""

_LEAST_WAY_M = 0.1
_LOG_OUTSIDE = -np.log(0.05)  # a Rayleigh law leaves this outside of its 95 % radius


@dataclass(frozen=True, slots=True)
class Errors:
    """Errors of one method [N, H]: ``distance``, ``along`` and ``across`` the measured heading [m] (ahead and to
    starboard positive), ``heading`` [deg], ``speed`` over ground [m/s], which is a difference of the track over two
    seconds; that of the last second is that of the one before.
    """

    distance: Floats
    along: Floats
    across: Floats
    heading: Floats
    speed: Floats

    def by_second(self, quantity: str, share: float) -> Floats:
        """The size that ``share`` of the windows stay below, at each second [H]."""
        return np.asarray(np.nanquantile(np.abs(getattr(self, quantity)), share, axis=0))

    def by_trial(self, trial: NDArray[np.str_]) -> dict[str, Floats]:
        """The mean distance of each window [m], by the name of its trial."""
        mean = self.distance.mean(axis=1)
        return {str(name): mean[trial == name] for name in dict.fromkeys(trial.tolist())}


def errors_of(predicted: Floats, horizons: PredictionWindows) -> Errors:
    """The errors of tracks [N, H+1, 3] of north, east [m], heading [rad]."""
    measured = horizons.track
    gap = (predicted - measured)[:, 1:, :2]
    along, across = in_ship_axes(gap[..., 0], gap[..., 1], measured[:, 1:, 2])
    turned = np.rad2deg(difference_rad(predicted[:, 1:, 2], measured[:, 1:, 2]))
    speed = (speeds_of(predicted)[..., 3] - speeds_of(measured)[..., 3])[:, 1:]
    if speed.shape[1] > 1:
        speed[:, -1] = speed[:, -2]  # a difference over one second has twice the noise of one over two
    return Errors(distances(predicted, measured), along, across, turned, speed)


@dataclass(frozen=True, slots=True)
class Calibration:
    """Whether 95 % regions hold what they say, by second [H].

    ``picp`` is the share of positions inside (prediction interval coverage probability), ``pinaw`` the mean width
    of the regions over the mean way covered by then (prediction interval normalised average width), NaN while the
    ship lies still. ``low`` and ``high`` are the 95 % interval of ``picp`` from drawing legs, and not windows,
    anew; NaN with one leg.
    ``pit`` [N H] is the probability integral transform of the distances: even from 0 to 1 where errors are normal
    and of the size that the regions say.
    """

    picp: Floats
    pinaw: Floats
    low: Floats
    high: Floats
    pit: Floats
    legs: int


def calibration_of(distance: Floats, radius_m: Floats, horizons: PredictionWindows) -> Calibration:
    """How regions of ``radius_m`` [N, H] about predicted positions that are off by ``distance`` [N, H] stand up."""
    inside = (distance <= radius_m).astype(float)
    way = np.hypot(*(horizons.track[:, 1:, :2] - horizons.track[:, :1, :2]).transpose(2, 0, 1)).mean(axis=0)
    legs = LegBootstrap.of(horizons.leg, seed=0)
    shares = legs.mean_of_each(inside)
    with np.errstate(divide="ignore", invalid="ignore"):
        pit = 1.0 - np.exp(-_LOG_OUTSIDE * (distance / radius_m) ** 2)
        pinaw = np.where(way > _LEAST_WAY_M, 2.0 * radius_m.mean(axis=0) / way, np.nan)
    low, high = (np.array([getattr(each, name) for each in shares]) for name in ("low", "high"))
    return Calibration(inside.mean(axis=0), pinaw, low, high, pit.ravel(), legs.legs)


def error_rows(errors: Mapping[str, Errors], quantity: str, seconds: Sequence[int]) -> list[list[str]]:
    """A row a method: its name, then median and 90 % of a quantity at each of ``seconds``, as text."""
    rows = []
    for method, each in errors.items():
        half, most = each.by_second(quantity, 0.5), each.by_second(quantity, 0.9)
        rows.append([plain(method), *(f"{half[second - 1]:.2f}, {most[second - 1]:.2f}" for second in seconds)])
    return rows
