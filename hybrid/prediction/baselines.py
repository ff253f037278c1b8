"""Predictions without learning, and the fallback made of them.

Every method maps the start of N windows to a track [N, H+1, 3]: north, east [m], heading [rad]. The baselines
are constant velocity (surge, sway and yaw rate kept: in a turn a circle), the straight line (the same without
the turn), and the reference model.

Outside its domain of applicability a calibrator is replaced by a weighted mean of the two baselines, each
weighted by the inverse fourth power of its expected error, which follows from its errors in training and from a
hindcast of the last seconds. Inside the domain a calibrator may be averaged with them
(:class:`CandidatePrediction`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from seatrial.acquisition.core.quantities import Floats
from seatrial.hybrid.prediction.kalman_filter import filtered_starts
from seatrial.hybrid.prediction.prediction_windows import PredictionWindows, hindcast_windows
from seatrial.hybrid.prediction.regions import conformal_region
from seatrial.hybrid.prediction.scores import mean_distances
from seatrial.hybrid.vessel.channels import check_ship
from seatrial.hybrid.vessel.plant import Plant
from seatrial.hybrid.vessel.sensors import YAW_RATE, arc
from seatrial.hybrid.vessel.simulate import simulate_batch


def constant_velocity(windows: PredictionWindows) -> Floats:
    """Constant velocity: surge, sway and yaw rate of the windows' starts kept."""
    return present_motion_held(windows.start, windows.horizon_s)


def untrained_tracks(windows: PredictionWindows, reference: Floats) -> dict[str, Floats]:
    """The tracks [N, H+1, 3] of the methods without training, by name: ``reference`` are the model's."""
    straight = windows.start.copy()
    straight[:, YAW_RATE] = 0.0
    return {
        "straight_line": present_motion_held(straight, windows.horizon_s),
        "constant_velocity": constant_velocity(windows),
        "reference": reference,
    }


def present_motion_held(states: Floats, horizon_s: int) -> Floats:
    """Tracks [N, H+1, 3] of constant surge, sway and yaw rate from states [N, 6]: lines or circles
    (:func:`.arc`)."""
    return np.asarray(states[:, None, :3] + arc(states[:, None], np.arange(horizon_s + 1.0)))


def reference(windows: PredictionWindows, plant: Plant) -> Floats:
    """Tracks of the simulation model from the measured start, with the windows' commands or the controls of
    second 0 held; the wind is held.

    Windows in which the model leaves its range are NaN from there on. Raises :class:`InputError` for windows of
    a ship with other actuators.
    """
    check_ship(windows.actuators, plant)
    return simulate_tracks(plant, windows.start, windows.acting, windows.wind)


def simulate_tracks(plant: Plant, states: Floats, control: Floats, wind: Floats) -> Floats:
    """Tracks [N, H+1, 3] of the simulation model from states [N, 6] under controls [N, H, controls], in a
    constant wind [N, 2] or one for each second [N, H, 2]."""
    blowing = wind if wind.ndim == 3 else np.repeat(wind[:, None, :], control.shape[1], axis=1)
    return simulate_batch(plant, states, control, blowing, dt_s=1.0).states[:, :, :3]


HINDCAST_S = 15
BASELINES = ("reference", "constant_velocity")
_LEAST_UNCERTAINTY_M = 0.5  # added to every expected error
_UNKNOWN_ERROR_M = 2.0  # error assumed where there is no hindcast
_HINDCAST_POWER = 0.5  # a hindcast error of four times that in training doubles the expected error
_LEAST_ERROR_M = 0.001  # lower bound on a mean training error
_LEAST_RATIO = 0.01  # lower bound on the ratio of hindcast to training error
_WEIGHT_POWER = 4.0  # close to the better baseline alone, unless both expect similar errors


@dataclass(frozen=True, slots=True)
class CandidatePrediction:
    """A prediction to be averaged with the baselines: its ``tracks`` [N, H+1, 3], NaN where it has none, and
    the errors ``hindcast_m`` [N] of its hindcasts; ``usual_error_m`` [2] are its mean errors on windows not
    used for fitting, over the horizon and over the hindcast."""

    tracks: Floats
    hindcast_m: Floats
    usual_error_m: Floats


@dataclass(frozen=True, slots=True)
class FallbackPrediction:
    """The weighted mean for N windows.

    ``tracks`` [N, H+1, 3]; ``weight`` [K, N] of the :data:`BASELINES` and of what is averaged with them;
    regions are proportional to ``expected_error_m`` [N].
    """

    tracks: Floats
    weight: Floats
    expected_error_m: Floats

    @property
    def source(self) -> NDArray[np.str_]:
        """The source [N] with the largest weight: one of :data:`BASELINES`, or ``hybrid``."""
        return np.asarray(np.array([*BASELINES, "hybrid"])[self.weight.argmax(axis=0)])


@dataclass(frozen=True, slots=True)
class Fallback:
    """A weighted mean of the :data:`BASELINES`, fitted to training windows.

    ``training_error_m`` [2] and ``hindcast_error_m`` [2] are each baseline's mean error over the horizon and
    over the :data:`HINDCAST_S` seconds before the start; ``region`` [H, 2] are the semi-axes of the 95 % region
    per metre of expected error.
    """

    training_error_m: Floats
    hindcast_error_m: Floats
    region: Floats

    @classmethod
    def fit(cls, windows: PredictionWindows, reference: Floats, plant: Plant) -> Fallback:
        """Fit to windows and the ``reference`` model's tracks [N, H+1, 3] on them."""
        tracks, hindcast_m = _baselines(windows, reference, plant)
        training_m = [mean_known(mean_distances(track, windows.track)) for track in tracks]
        unscaled = cls(
            np.array(training_m),
            np.array([mean_known(each) for each in hindcast_m]),
            np.ones((windows.horizon_s, 2)),
        )
        found = unscaled._average(tracks, hindcast_m)
        return replace(unscaled, region=conformal_region(found.tracks, windows, found.expected_error_m[:, None]))

    def predict(
        self, windows: PredictionWindows, reference: Floats, plant: Plant, beside: CandidatePrediction | None = None
    ) -> FallbackPrediction:
        """The weighted mean of the baselines, and of a candidate ``beside`` them, for windows on which
        ``reference`` [N, H+1, 3] are the model's tracks."""
        tracks, hindcast_m = _baselines(windows, reference, plant)
        if beside is None:
            return self._average(tracks, hindcast_m)
        usual_m = np.column_stack([[self.training_error_m, self.hindcast_error_m], beside.usual_error_m])
        return replace(self, training_error_m=usual_m[0], hindcast_error_m=usual_m[1])._average(
            np.concatenate([tracks, beside.tracks[None]]), np.concatenate([hindcast_m, beside.hindcast_m[None]])
        )

    def _average(self, tracks: Floats, hindcast_m: Floats) -> FallbackPrediction:
        """Average ``tracks`` [K, N, H+1, 3] with weights from the errors [K, N] of their hindcasts.

        A baseline without a hindcast gets no weight beside one with a hindcast, nor does one that left its
        range.
        """
        known = np.isfinite(hindcast_m)
        with np.errstate(invalid="ignore"):
            ratio = (hindcast_m / self.hindcast_error_m[:, None] + _LEAST_RATIO) ** _HINDCAST_POWER
        ratio = np.where(known, ratio, np.where(known.any(axis=0), np.inf, 1.0))
        expected_m = self.training_error_m[:, None] * ratio
        expected_m[~np.isfinite(tracks).all(axis=(2, 3))] = np.inf
        weight = expected_m**-_WEIGHT_POWER / (expected_m**-_WEIGHT_POWER).sum(axis=0)
        hindcast_m = np.maximum(np.where(known, hindcast_m, _UNKNOWN_ERROR_M), self.hindcast_error_m[:, None])
        return FallbackPrediction(
            tracks=average_tracks(weight, tracks),
            weight=weight,
            expected_error_m=_LEAST_UNCERTAINTY_M + (weight * hindcast_m).sum(axis=0),
        )


def average_tracks(weight: Floats, tracks: Floats) -> Floats:
    """The mean [N, H+1, 3] of tracks [K, N, H+1, 3] with weights [K, N]; those of weight 0 may be NaN."""
    counted = np.where(weight[..., None, None] > 0.0, tracks, 0.0)
    return np.asarray(np.einsum("wn,wnhc->nhc", weight, counted))


def _baselines(windows: PredictionWindows, reference: Floats, plant: Plant) -> tuple[Floats, Floats]:
    """The tracks [2, N, H+1, 3] of the :data:`BASELINES`, and the errors [2, N] of their hindcasts in metres."""
    before = filtered_starts(hindcast_windows(windows, HINDCAST_S), plant)
    hindcasts = simulate_tracks(plant, before.start, before.acting, before.wind), constant_velocity(before)
    hindcast_m = np.stack([mean_distances(each, before.track) for each in hindcasts])
    return np.stack([reference, constant_velocity(windows)]), hindcast_m


def mean_known(errors_m: Floats) -> float:
    """The mean of the finite errors; :data:`_UNKNOWN_ERROR_M` if there are none."""
    known = errors_m[np.isfinite(errors_m)]
    return max(float(known.mean()), _LEAST_ERROR_M) if known.size else _UNKNOWN_ERROR_M
