"""Predictions without learning, the fallback made of them, and the size and errors of predictions of any method.

Every method maps the start of N windows to a track [N, H+1, 3]: north, east [m], heading [rad]. The baselines are
constant velocity (surge, sway and yaw rate kept: in a turn a circle), the straight line (the same without the
turn), and the reference model. Outside its domain of applicability a calibrator is replaced by a weighted mean of
two baselines, each weighted by the inverse fourth power of its expected error, which follows from its errors in
training and from a hindcast of the last seconds. Inside the domain a calibrator may be averaged with them
(:class:`CandidatePrediction`).

95 % regions are ellipses along and across the predicted course, given by their semi-axes in metres as the last axis
of an array. Their size follows from errors on legs not used for training (split conformal prediction, Lei et al.
2018), normalised by the relative uncertainty that a method assigns to each window. Errors of windows of one leg or
recording are correlated, so those of a new one exceed a quantile over all windows: regions are widened until each
group is covered when sized on the others.

Confidence intervals of mean errors come from the cluster bootstrap (Davison and Hinkley 1997, section 3.8): as many
legs as there are, drawn with replacement, each with all of its windows, since errors of one leg's windows are
strongly correlated. Ratios are paired: both means come from the same legs. The sequences of a campaign are legs of
their own.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from seatrial.acquisition.core.quantities import Floats, Ints, Strings, rotate_earth_to_ship
from seatrial.acquisition.core.result import Number, to_json
from seatrial.hybrid.prediction import kalman_filter, window_sets
from seatrial.hybrid.vessel import dynamics, sensors
from seatrial.hybrid.vessel.black_box import BlackBox, MotionModel, names_of_windows, simulate_black_box

HINDCAST_S = 15
FALLBACK_BASELINES = ("reference", "constant_velocity")
_LEAST_UNCERTAINTY_M = 0.5  # added to every expected error
_UNKNOWN_ERROR_M = 2.0  # error assumed where there is no hindcast
_HINDCAST_POWER = 0.5  # a hindcast error of four times that in training doubles the expected error
_LEAST_ERROR_M = 0.001  # lower bound on a mean training error
_LEAST_RATIO = 0.01  # lower bound on the ratio of hindcast to training error
_WEIGHT_POWER = 4.0  # close to the better baseline alone, unless both expect similar errors

COVERAGE = 0.95
_CLIPPING_QUANTILE = 0.9
"""Errors beyond this quantile are clipped when the shape of regions is estimated: a few bad windows determine
the size, not the shape."""
_MOST_PARTS = 20  # with more groups, several are held out at once
_CORNERS = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)

DRAWS = 2000
FEW_LEGS = 10
"""With fewer legs than this, bootstrap intervals are too narrow."""
COVERAGE_PERCENT = (2.5, 97.5)


def constant_velocity(windows: window_sets.PredictionWindows) -> Floats:
    """Constant velocity: surge, sway and yaw rate of the windows' starts kept."""
    return constant_motion_tracks(windows.start, windows.horizon_s)


def untrained_tracks(windows: window_sets.PredictionWindows, reference: Floats) -> dict[str, Floats]:
    """The tracks [N, H+1, 3] of the methods without training, by name: ``reference`` are the model's."""
    straight = windows.start.copy()
    straight[:, sensors.YAW_RATE] = 0.0
    return {
        "straight_line": constant_motion_tracks(straight, windows.horizon_s),
        "constant_velocity": constant_velocity(windows),
        "reference": reference,
    }


def constant_motion_tracks(states: Floats, horizon_s: int) -> Floats:
    """Tracks [N, H+1, 3] of constant surge, sway and yaw rate from states [N, 6]: lines or circles
    (:func:`.pose_change_along_arc`)."""
    return np.asarray(
        states[:, None, :3] + sensors.pose_change_along_arc(states[:, None], np.arange(horizon_s + 1.0))
    )


def simulate_reference(windows: window_sets.PredictionWindows, plant: MotionModel) -> Floats:
    """Tracks of the simulation model from the measured start, with the windows' commands or the controls of
    second 0 held; the wind is held.

    Windows in which the model leaves its range are NaN from there on. Raises :class:`InputError` for windows of
    a ship with other actuators.
    """
    windows = windows.in_order_of(plant)
    if isinstance(plant, BlackBox):
        return _black_box_tracks(windows, plant)
    return simulate_tracks(plant, windows.start, windows.acting_controls, windows.wind)


def _black_box_tracks(windows: window_sets.PredictionWindows, model: BlackBox) -> Floats:
    """The same of a simulator of another make: NaN where it fails; one that cannot start from a state is run in
    through the seconds before."""
    tracks = np.full((len(windows), windows.horizon_s + 1, 3), np.nan)
    known = np.isfinite(windows.start).all(axis=1) & np.isfinite(windows.acting_controls).all(axis=(1, 2))
    part = windows.subset(np.flatnonzero(known))
    if not len(part):
        return tracks
    history = None if model.run_in_s is None else window_sets.history_before_start(part, round(model.run_in_s))
    air = np.repeat(part.wind[:, None, :], part.horizon_s, axis=1)
    names = names_of_windows(part.trial, part.start_time)
    states = simulate_black_box(model, part.start, part.acting_controls, air, 1.0, names, history)
    tracks[known] = states[..., :3]
    return tracks


def simulate_tracks(plant: MotionModel, states: Floats, control: Floats, wind: Floats) -> Floats:
    """Tracks [N, H+1, 3] of the simulation model from states [N, 6] under controls [N, H, controls], in a
    constant wind [N, 2] or one for each second [N, H, 2]."""
    blowing = wind if wind.ndim == 3 else np.repeat(wind[:, None, :], control.shape[1], axis=1)
    return dynamics.simulate_batch(plant, states, control, blowing, dt_s=1.0).states[:, :, :3]


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

    ``tracks`` [N, H+1, 3]; ``weight`` [K, N] of the :data:`FALLBACK_BASELINES` and of what is averaged with them;
    regions are proportional to ``expected_error_m`` [N].
    """

    tracks: Floats
    weight: Floats
    expected_error_m: Floats

    @property
    def source(self) -> Strings:
        """The source [N] with the largest weight: one of :data:`FALLBACK_BASELINES`, or ``hybrid``."""
        return np.asarray(np.array([*FALLBACK_BASELINES, "hybrid"])[self.weight.argmax(axis=0)])


@dataclass(frozen=True, slots=True)
class Fallback:
    """A weighted mean of the :data:`FALLBACK_BASELINES`, fitted to training windows.

    ``training_error_m`` [2] and ``hindcast_error_m`` [2] are each baseline's mean error over the horizon and
    over the :data:`HINDCAST_S` seconds before the start; ``region`` [H, 2] are the semi-axes of the 95 % region
    per metre of expected error.
    """

    training_error_m: Floats
    hindcast_error_m: Floats
    region: Floats

    @classmethod
    def fit(cls, windows: window_sets.PredictionWindows, reference: Floats, plant: MotionModel) -> Fallback:
        """Fit to windows and the ``reference`` model's tracks [N, H+1, 3] on them."""
        tracks, hindcast_m = _baseline_tracks_and_errors(windows, reference, plant)
        training_m = [mean_finite_error(mean_track_distances(track, windows.track)) for track in tracks]
        unscaled = cls(
            np.array(training_m),
            np.array([mean_finite_error(errors_m) for errors_m in hindcast_m]),
            np.ones((windows.horizon_s, 2)),
        )
        prediction = unscaled._average(tracks, hindcast_m)
        region = conformal_region(prediction.tracks, windows, prediction.expected_error_m[:, None])
        return replace(unscaled, region=region)

    def predict(
        self,
        windows: window_sets.PredictionWindows,
        reference: Floats,
        plant: MotionModel,
        candidate: CandidatePrediction | None = None,
    ) -> FallbackPrediction:
        """The weighted mean of the baselines, and of a ``candidate`` if there is one, for windows on which
        ``reference`` [N, H+1, 3] are the model's tracks."""
        tracks, hindcast_m = _baseline_tracks_and_errors(windows, reference, plant)
        if candidate is None:
            return self._average(tracks, hindcast_m)
        usual_m = np.column_stack([[self.training_error_m, self.hindcast_error_m], candidate.usual_error_m])
        return replace(self, training_error_m=usual_m[0], hindcast_error_m=usual_m[1])._average(
            np.concatenate([tracks, candidate.tracks[None]]),
            np.concatenate([hindcast_m, candidate.hindcast_m[None]]),
        )

    def _average(self, tracks: Floats, hindcast_m: Floats) -> FallbackPrediction:
        """Average ``tracks`` [K, N, H+1, 3] with weights from the errors [K, N] of their hindcasts.

        A baseline without a hindcast gets no weight beside one with a hindcast, nor does one that left its
        range.
        """
        has_hindcast = np.isfinite(hindcast_m)
        with np.errstate(invalid="ignore"):
            ratio = (hindcast_m / self.hindcast_error_m[:, None] + _LEAST_RATIO) ** _HINDCAST_POWER
        ratio = np.where(has_hindcast, ratio, np.where(has_hindcast.any(axis=0), np.inf, 1.0))
        expected_m = self.training_error_m[:, None] * ratio
        expected_m[~np.isfinite(tracks).all(axis=(2, 3))] = np.inf
        weight = expected_m**-_WEIGHT_POWER / (expected_m**-_WEIGHT_POWER).sum(axis=0)
        hindcast_m = np.maximum(
            np.where(has_hindcast, hindcast_m, _UNKNOWN_ERROR_M), self.hindcast_error_m[:, None]
        )
        return FallbackPrediction(
            tracks=average_tracks(weight, tracks),
            weight=weight,
            expected_error_m=_LEAST_UNCERTAINTY_M + (weight * hindcast_m).sum(axis=0),
        )


def average_tracks(weight: Floats, tracks: Floats) -> Floats:
    """The mean [N, H+1, 3] of tracks [K, N, H+1, 3] with weights [K, N]; those of weight 0 may be NaN."""
    weighted = np.where(weight[..., None, None] > 0.0, tracks, 0.0)
    return np.asarray(np.einsum("wn,wnhc->nhc", weight, weighted))


def _baseline_tracks_and_errors(
    windows: window_sets.PredictionWindows, reference_tracks: Floats, plant: MotionModel
) -> tuple[Floats, Floats]:
    """The tracks [2, N, H+1, 3] of the :data:`FALLBACK_BASELINES`, and the errors [2, N] of their hindcasts [m]."""
    hindcast_inputs = kalman_filter.filtered_starts(window_sets.hindcast_windows(windows, HINDCAST_S), plant)
    hindcasts = (
        simulate_reference(hindcast_inputs, plant),
        constant_velocity(hindcast_inputs),
    )
    hindcast_m = np.stack([mean_track_distances(hindcast, hindcast_inputs.track) for hindcast in hindcasts])
    return np.stack([reference_tracks, constant_velocity(windows)]), hindcast_m


def mean_finite_error(errors_m: Floats) -> float:
    """The mean of the finite errors; :data:`_UNKNOWN_ERROR_M` if there are none."""
    finite = errors_m[np.isfinite(errors_m)]
    return max(float(finite.mean()), _LEAST_ERROR_M) if finite.size else _UNKNOWN_ERROR_M


def conformal_region(
    predicted: Floats, windows: window_sets.PredictionWindows, uncertainty: Floats | None = None
) -> Floats:
    """The semi-axes [H, 2] of the region that holds 95 % of the measured positions, by second, in metres.

    ``predicted`` are tracks [N, H+1, 3] of the windows. With the relative ``uncertainty`` [N, H] of each
    prediction the region is that for an uncertainty of one. The quantile is that of split conformal prediction,
    the ceil((n + 1) 0.95)-th of n errors, so it does not shrink with few windows; no axis shrinks from one
    second to the next. Seconds not measured or not predicted (NaN) do not count.
    """
    along, across = errors_by_course(predicted, windows.track)
    if uncertainty is not None:
        along, across = along / uncertainty, across / uncertainty

    def clipped_rms(errors: Floats) -> Floats:
        size = np.abs(errors)
        squares = np.minimum(size, _conformal_quantile(size, _CLIPPING_QUANTILE)) ** 2
        return np.asarray(np.sqrt(np.nansum(squares, axis=0) / np.isfinite(size).sum(axis=0)))

    # A few recordings may not be representative, since other sensors have other errors: the logarithm of the ratio
    # of the axes is shrunk towards a circle as by one more recording, so that one recording counts half.
    recordings = len(np.unique(windows.trial))
    with np.errstate(divide="ignore", invalid="ignore"):
        log_ratio = np.log(clipped_rms(along) / clipped_rms(across))
    stretch = np.exp(0.5 * np.where(np.isfinite(log_ratio), log_ratio, 0.0) * recordings / (recordings + 1.0))
    shape = np.column_stack([stretch, 1.0 / stretch])
    relative = np.hypot(along / shape[:, 0], across / shape[:, 1])
    # Wide enough to hold 95 % of each group of windows when sized on the others.
    widening, group = 1.0, window_sets.held_out_group_names(windows)
    names = np.unique(group)
    if len(names) > 1:
        excess = []
        for held_out_names in np.array_split(names, min(len(names), _MOST_PARTS)):
            held_out = np.isin(group, held_out_names)
            with np.errstate(divide="ignore", invalid="ignore"):
                excess.append((relative[held_out] / _conformal_quantile(relative[~held_out], COVERAGE)).ravel())
        factor = float(_conformal_quantile(np.concatenate(excess)[:, None], COVERAGE)[0])
        widening = max(1.0, factor) if np.isfinite(factor) else 1.0
    return np.maximum.accumulate((widening * _conformal_quantile(relative, COVERAGE))[:, None] * shape, axis=0)


def relative_distances(predicted: Floats, measured: Floats, region_m: Floats) -> Floats:
    """Errors of tracks [N, H+1, 3] at seconds 1 to H [N, H], relative to their regions [N or 1, H, 2] in that
    direction: 1 on the border, more outside, 0 without error."""
    gap_m = np.stack(errors_by_course(predicted, measured), axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.linalg.norm(np.where(gap_m == 0.0, 0.0, gap_m / region_m), axis=-1))


def errors_by_course(predicted: Floats, measured: Floats) -> tuple[Floats, Floats]:
    """Errors of tracks [N, H+1, 2 or 3] forward and to starboard [N, H] of the measured ones at seconds 1 to H,
    relative to the predicted course [m]."""
    gap = (predicted - measured)[:, 1:]
    along, across = rotate_earth_to_ship(gap[..., 0], gap[..., 1], course_over_ground(predicted))
    return np.asarray(along), np.asarray(across)


def course_over_ground(tracks: Floats) -> Floats:
    """The course over ground of tracks [.., H+1, 2 or 3] at seconds 1 to H [.., H], from the second before
    [rad].
    """
    step = np.diff(tracks[..., :2], axis=-2)
    return np.asarray(np.arctan2(step[..., 1], step[..., 0]))


def region_bands(region_m: Floats | None) -> dict[str, Floats | None]:
    """A region [.., 2] by its names in files: the enclosing circle, along and across."""
    if region_m is None:
        return dict.fromkeys(("band_m", "band_along_m", "band_across_m"))
    return {
        "band_m": region_m.max(axis=-1),
        "band_along_m": region_m[..., 0],
        "band_across_m": region_m[..., 1],
    }


def equal_area_radius(region_m: Floats) -> Floats:
    """The radius of the circles of equal area to regions [.., 2], in metres."""
    return np.asarray(np.sqrt(region_m.prod(axis=-1)))


def region_outlines(track: Floats, region_m: Floats) -> Floats:
    """Points [H, 24, 2], north and east, of the borders of the regions [H, 2] about a track [H+1, 3]."""
    course = course_over_ground(track)[:, None]
    along, across = region_m[:, :1] * np.cos(_CORNERS), region_m[:, 1:] * np.sin(_CORNERS)
    north = along * np.cos(course) - across * np.sin(course)
    east = along * np.sin(course) + across * np.cos(course)
    return np.asarray(track[1:, None, :2] + np.stack([north, east], axis=-1))


def _conformal_quantile(values: Floats, share: float) -> Floats:
    """The ceil((n + 1) share)-th of n values [N, H], or the largest, by second [H]; NaN does not count."""
    count = np.isfinite(values).sum(axis=0)
    rank = np.minimum(np.ceil((count + 1) * share), count).astype(np.int64) - 1
    return np.asarray(np.take_along_axis(np.sort(values, axis=0), rank[None], axis=0)[0])


@dataclass(frozen=True, slots=True)
class Score:
    """Errors of one method over N windows of H seconds; means run over windows and seconds 1 to H."""

    mean_distance_m: float
    end_distance_m: float
    mae_north_m: float
    mae_east_m: float
    heading_error_deg: float
    by_second: tuple[float, ...]


def distances(predicted: Floats, measured: Floats) -> Floats:
    """The distance between two tracks [N, H+1, 2 or 3] at seconds 1 to H [N, H], in metres."""
    gap = predicted[:, 1:, :2] - measured[:, 1:, :2]
    return np.asarray(np.hypot(gap[..., 0], gap[..., 1]))


def mean_track_distances(predicted: Floats, measured: Floats) -> Floats:
    """The mean distance of two tracks [N, H+1, 2 or 3] over seconds 1 to H [N] in metres; NaN where any is."""
    return np.asarray(distances(predicted, measured).mean(axis=1))


def heading_errors_deg(predicted: Floats, measured: Floats) -> Floats:
    """The difference of headings of two tracks [N, H+1, 3] at seconds 1 to H [N, H], in degrees."""
    return np.asarray(np.rad2deg(np.abs(window_sets.angle_difference_rad(predicted[:, 1:, 2], measured[:, 1:, 2]))))


def score(predicted: Floats, measured: Floats) -> Score:
    """Compare tracks [N, H+1, 3] of north, east [m] and heading [rad]."""
    gap = predicted[:, 1:] - measured[:, 1:]
    distance = distances(predicted, measured)
    return Score(
        mean_distance_m=float(distance.mean()),
        end_distance_m=float(distance[:, -1].mean()),
        mae_north_m=float(np.abs(gap[..., 0]).mean()),
        mae_east_m=float(np.abs(gap[..., 1]).mean()),
        heading_error_deg=float(heading_errors_deg(predicted, measured).mean()),
        by_second=tuple(float(distance_m) for distance_m in distance.mean(axis=0)),
    )


TWO_SIDED = "_two_sided"
"""The ending of the name of a method that starts from the two-sided state."""


def start_state_of_method(method: str) -> str:
    """The start state of a method's predictions: causal, or two-sided."""
    return "two_sided" if method.endswith(TWO_SIDED) else "causal"


def scores_json(scores: Mapping[str, Score]) -> dict[str, Any]:
    """Scores by method for JSON, each with its start state."""
    return {
        name: {"start": start_state_of_method(name), **to_json(method_score)}
        for name, method_score in scores.items()
    }


@dataclass(frozen=True, slots=True)
class Interval:
    """A value with its 95 % interval; NaN bounds if there is only one leg."""

    value: Number
    low: Number
    high: Number


@dataclass(frozen=True, slots=True)
class LegBootstrap:
    """Bootstrap draws of legs, the same for all statistics.

    ``leg`` [N] is the number of each window's leg, ``times`` [draws, legs] how often each leg was drawn.
    """

    leg: Ints
    times: Floats

    @classmethod
    def of(cls, legs: Strings | Ints, seed: int, draws: int = DRAWS) -> LegBootstrap:
        """Draws for windows of the named or numbered legs [N]; equal numbers of legs and seeds give equal
        draws."""
        names, number = np.unique(legs, return_inverse=True)
        share = np.full(len(names), 1.0 / len(names))
        times = np.random.default_rng(seed).multinomial(len(names), share, size=draws)
        return cls(number.astype(np.int64), times.astype(float))

    @property
    def leg_count(self) -> int:
        """The number of legs."""
        return int(self.times.shape[1])

    def means_by_draw(self, values: Floats) -> Floats:
        """The means over windows of ``values`` [N, K] in each draw [draws, K]."""
        sums = np.zeros((self.leg_count, values.shape[1]))
        np.add.at(sums, self.leg, values)
        counts = np.bincount(self.leg, minlength=self.leg_count)
        return np.asarray((self.times @ sums) / (self.times @ counts)[:, None])

    def mean(self, values: Floats) -> Interval:
        """The mean of ``values`` [N] over windows."""
        return self.column_means(values[:, None])[0]

    def column_means(self, values: Floats) -> tuple[Interval, ...]:
        """The means of the columns of ``values`` [N, K] over windows."""
        return self._intervals(values.mean(axis=0), self.means_by_draw(values))

    def ratio(self, values: Floats, denominators: Floats) -> Interval:
        """The mean of ``values`` [N] over that of ``denominators`` [N], paired; 1 where both are zero."""
        means = np.vstack(
            [self.means_by_draw(np.column_stack([values, denominators])), [values.mean(), denominators.mean()]]
        )
        with np.errstate(divide="ignore", invalid="ignore"):
            quotients = means[:, 0] / means[:, 1]
        quotients[np.isnan(quotients)] = 1.0
        return self._intervals(quotients[-1:], quotients[:-1, None])[0]

    def _intervals(self, values: Floats, drawn: Floats) -> tuple[Interval, ...]:
        """Intervals about ``values`` [K] from draws [draws, K]."""
        if self.leg_count < 2:
            return tuple(Interval(float(value), np.nan, np.nan) for value in values)
        return tuple(interval_from_draws(float(value), draws) for value, draws in zip(values, drawn.T, strict=True))


def interval_from_draws(value: float, drawn: Floats) -> Interval:
    """``value`` with the central 95 % of ``drawn`` [draws]."""
    # without interpolation, which is undefined between infinite draws
    low, high = np.percentile(drawn, COVERAGE_PERCENT, method="nearest")
    return Interval(value, float(low), float(high))
