"""The calibrator that adapts the reference model itself: an ensemble of adapted models, weighted by hindcasts.

A Kalman filter runs over the seconds before the start and estimates the ship's motion and the force that the model
lacks; the model's parameters are adapted until predictions fit the measured tracks, no further than the data
justify; and the accuracy of each predictor over the last seconds determines its weight. What it learned applies to
the day, loading and sea of its training. Hindcasts over the last minutes show whether it still applies: the model's
errors now, compared with those in training. If they exceed nearly all of those, or outside the training range,
models that follow the measurements more closely and the baselines are averaged in, weighted by their own hindcasts;
and the regions grow accordingly.

The parameter vector has the model's coefficients, steady forces, current, drift, wind and the observer's noise
levels, each as a deviation from the reference in units of its prior standard deviation: zero is the reference, and
the prior is a standard normal distribution. It is adapted by Levenberg-Marquardt steps on the whitened differences
between predicted and measured tracks, plus the prior. Each second is scaled by its own median error, so that the
last seconds do not dominate; windows with events that no model could know get less weight (Huber). Overlapping
windows count only for the seconds that no other has. Our own steps are needed since scales and weights are updated
after each, and one costs sixty predictions of all windows. ``scipy.optimize.least_squares`` with the same Jacobians
(trf) reaches the same error, 0.081 m on unseen windows, in 1.14 times the time; its lm 0.087 m, in the same time
(tests/benchmarks/least_squares.py, mean of 3 seeds). If a parameter's standard error is nearly as wide as the
prior, the data do not determine the parameter.

Of a vessel file the vector adapts the coefficients, of a simulator of another make what acts on it from outside
(:mod:`~seatrial.hybrid.vessel.outside`): gains of its drives, and drag and steady pushes per mass. Both have
current, wind, the thrusters' lag and the observer's noise levels.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from seatrial.acquisition.core.errors import DataShortageError, Progress, subtask_progress
from seatrial.acquisition.core.quantities import Bools, Complexes, Floats, rotate_earth_to_ship
from seatrial.acquisition.core.ship import Actuators, trial_channel_names
from seatrial.analysis.estimation.process_models import UNKNOWN, correlated_pairs
from seatrial.hybrid.calibrators import Calibrator, DomainOfApplicability, Examples, require_tensor_shapes
from seatrial.hybrid.prediction import baselines, kalman_filter, window_sets
from seatrial.hybrid.prediction.kalman_filter import Observations
from seatrial.hybrid.vessel import effect, hulls, sensors
from seatrial.hybrid.vessel.actuators import KINDS, angle_columns, control_labels
from seatrial.hybrid.vessel.black_box import BlackBox, MotionModel
from seatrial.hybrid.vessel.outside import DRAG, assumed_inertia
from seatrial.hybrid.vessel.plant import Form, Plant, flat_numbers, number_places, pack

MEMBERS = 5
MOST_WINDOWS = 400
FITTED_S = 60
"""The models are fitted to at most this part of each window. A minute shows the ship's response; what follows
also depends on future wind and current. Over 300 s, models fitted to whole windows had 0.74 and 0.55 of the
best baseline's error on the last 30 % of 2019 and 2022, those of the first minute 0.61 and 0.61, in less than
half of the time."""
WEIGHT_POWERS = (np.inf, 4.0, 2.0)
"""The candidates' weights are inverse powers of their hindcast errors; infinity means only our own counts."""
DOMAIN_MARGIN = 0.5
"""The margin by which a start inside the domain may exceed the training range, as a share of it."""
_LEAST_MARGIN = (0.5, 0.2, 0.01, 2.0)
_LEAST_ANGLE_MARGIN = 0.15
"""The smallest margin, however little the training varied: surge, sway [m/s], yaw rate [rad/s], wind speed
[m/s], cosine and sine of the actuators' angles (30 degrees from dead ahead); for revolutions it depends on the
kind."""


def start_quantity_names(actuators: Actuators) -> tuple[str, ...]:
    """The quantities of a start that define the domain of applicability, of a ship with these actuators."""
    labels, angles = control_labels(actuators), angle_columns(actuators)
    shafts = (name for column, name in enumerate(labels) if column not in angles)
    turned = (f"{labels[column]}_{part}" for column in angles for part in ("cos", "sin"))
    return ("surge_mps", "sway_mps", "yaw_rate_radps", "wind_speed_mps", *shafts, *turned)


_LEAST_RATIO = 0.1  # lower bound on hindcast errors, as a share of the median
_UNKNOWN_RATIO = 2.0  # hindcast error of a window with an unknown past, in medians
_RECENT_S = 5
_CANDIDATES = 3  # the adapted model, constant velocity, the reference
_INTERVAL_S, _LONGEST_S = 15, 60
"""The interval between the hindcasts that test the model on this day, and their maximum length [s]. They are as
long as the prediction: over 120 s, on a simulated ship a tenth heavier than in training, hindcasts of 15 s left
coverage at 88 % and the error at 0.16 of the best baseline's, those of a minute at 98 % and 0.13."""
_CLOSER = (1.0, 2.0)
"""The increases, in prior standard deviations, of the bias force's process noise."""
_MINUTES_POWER = 4.0
"""Their weights are this inverse power of the error over the last minutes."""
_UNUSUAL = 0.95
"""A model whose errors exceed this share of those in training is not used alone."""
_DAY_DEVIATION = np.log(2.0)
"""The prior standard deviation of the logarithm of the ratio of errors between days: a factor of two."""
_LEAST_LOG_M = 1e-6
_AT_ONCE = 500  # windows hindcast together, to limit memory


@dataclass(frozen=True, slots=True)
class _Candidates:
    """The candidate predictions of N windows, the adapted model's first: ``tracks`` [3, N, H+1, 3] and the mean
    errors ``hindcast_m`` [3, N] of their hindcasts in metres; ``spread_m`` [N, H] is the spread of the members'
    tracks; ``minutes`` [3, N] the mean logarithms of the candidates' errors over the last minutes [log m]."""

    tracks: Floats
    hindcast_m: Floats
    spread_m: Floats
    minutes: Floats

    def subset_of_windows(self, chosen: Bools) -> _Candidates:
        """The candidates of the windows that a mask chooses."""
        return _Candidates(
            self.tracks[:, chosen], self.hindcast_m[:, chosen], self.spread_m[chosen], self.minutes[:, chosen]
        )


@dataclass(frozen=True, slots=True)
class _TrainingStatistics:
    """The usual values in training, on held-out legs: the median hindcast error ``hindcast_m``, a metre if nothing
    was recorded; the median spread of the members ``spread_m`` [H]; and of the log errors over the last minutes the
    ``mean``, standard ``deviation`` and upper ``limit``."""

    hindcast_m: float
    spread_m: Floats
    mean: float
    deviation: float
    limit: float

    def error_factor_of_day(self, minutes: Floats) -> Floats:
        """The factor [N], at least 1, on the training errors to expect after such last minutes.

        A few minutes are uncertain by ``deviation``, so the logarithm is shrunk (normal prior of standard
        deviation :data:`_DAY_DEVIATION`, normal likelihood); unknown minutes count as usual.
        """
        worse = np.maximum(np.nan_to_num(minutes, nan=self.mean) - self.mean, 0.0)
        return np.asarray(np.exp(worse * _DAY_DEVIATION**2 / (_DAY_DEVIATION**2 + self.deviation**2)))


class AdaptiveCalibrator(Calibrator):
    """An ensemble of adapted models, averaged with constant velocity and the reference by hindcast errors.

    Each of :data:`MEMBERS` models is fitted without a share of the legs (cross-validation). The held-out legs
    determine the power of the hindcast weights and the 95 % regions. All members predict together.
    """

    method = "adaptive"
    extrapolates: ClassVar[bool] = True
    gust_s_: float | None
    usual_: _TrainingStatistics

    def input_names_for(self, actuators: Actuators) -> tuple[str, ...]:
        return trial_channel_names(actuators)

    def fit(self, training: Examples, stopping: Examples, progress: Progress = lambda share: None) -> Self:
        """Fit to the windows of both parts; no legs are needed for stopping. Raises :class:`DataShortageError`."""
        windows = window_sets.concatenate_windows([training[0], stopping[0]])
        self.any_commands = windows.commands is not None
        self.gust_s_ = gust_decay_s(windows) if self.any_commands else None
        self.hindcast_s_ = _hindcast_length_s(windows.horizon_s)
        fold = _assign_folds(window_sets.held_out_group_names(windows), self.seed)
        members = int(fold.max()) + 1
        if members < 2:
            raise DataShortageError("only one leg, which cannot be split", fix="give more or longer recordings")
        vectors = []
        for member in range(members):
            drawn = self._training_data_of_member(
                windows, window_sets.drop_overlapping_windows(windows, fold != member, fold == member), member
            )
            vectors.append(fit_parameter_vector(self._model, *drawn, subtask_progress(progress, member, members)))
        self.vectors_ = np.stack(vectors)
        # The covariance at the minimum, by a quadratic approximation of the cost; in directions without data it is
        # the prior's, one. Differences at the edge of the model's range say nothing of the parameters.
        observed, track, overlap = self._training_data_of_member(
            windows, np.ones(len(windows), dtype=bool), members
        )
        mean = self.vectors_.mean(axis=0)
        differences_at, complete = _make_difference_function(self._model, observed, track)
        residual = differences_at(mean)
        slope = _weighted_jacobian(
            self._model,
            differences_at,
            mean,
            residual,
            _whitening_factors(residual, complete, overlap, self._model),
        )
        slope = slope[(np.abs(slope) < _STEEPEST).all(axis=1)]
        self.covariance_ = np.asarray(np.linalg.inv(slope.T @ slope + np.eye(len(mean))))
        self.range_ = start_range(windows)
        self.out_of_sample_ = self._cross_validate(windows, fold)[len(training[0]) :]
        return self

    def adapted_model(self) -> MotionModel:
        """The reference model with the mean of its members' parameters."""
        vector, model = self.vectors_.mean(axis=0), self._model
        if isinstance(model, BlackBox):
            return adapt_simulator(vector, model)
        return replace(model, values=tuple(flat_numbers(adapt_plant(vector, model))[0].tolist()))

    def out_of_sample_tracks(self, stopping: Examples) -> Floats:
        return self.out_of_sample_

    def _observations(self, windows: window_sets.PredictionWindows) -> Observations:
        """The observer's observations; the decay of gusts is learned with any commands only."""
        return observations_of_windows(windows, self.gust_s_)

    def _training_data_of_member(
        self, windows: window_sets.PredictionWindows, chosen: Bools, number: int
    ) -> tuple[Observations, Floats, float]:
        """Observations, tracks and overlap, for :func:`fit_parameter_vector`, of the first seconds of the chosen
        windows, of no more than :data:`MOST_WINDOWS`; the draw's ``number`` is part of its seed. The overlap is the
        median time between starts of a leg over the horizon."""
        rows = np.flatnonzero(chosen)
        if len(rows) > MOST_WINDOWS:
            random = np.random.default_rng([self.seed, number])
            rows = np.sort(random.choice(rows, MOST_WINDOWS, replace=False))
        drawn = windows.subset(rows)
        commands = None if drawn.commands is None else drawn.commands[:, :FITTED_S]
        first_s = drawn.track[:, : FITTED_S + 1]
        drawn = replace(drawn, track=first_s, commands=commands, truths=None, truth_errors=None)
        starts_s = drawn.start_ns / 1e9
        order = np.lexsort((starts_s, drawn.leg))
        same_leg = drawn.leg[order][1:] == drawn.leg[order][:-1]
        intervals_s = np.diff(starts_s[order])[same_leg]
        intervals_s = intervals_s[intervals_s > 0.0]  # seconds of one window may come in two parts
        overlap = float(min(1.0, np.median(intervals_s) / drawn.horizon_s)) if len(intervals_s) else 1.0
        return self._observations(drawn), drawn.track, overlap

    @property
    def _model(self) -> MotionModel:
        if self.plant is None:
            raise ValueError("the adaptive calibrator needs the reference model")
        return self.plant

    def _cross_validate(self, windows: window_sets.PredictionWindows, fold: NDArray[np.int64]) -> Floats:
        """Fit weights and regions; return the tracks [N, H+1, 3] of each window by the member not fitted to it."""
        candidates = _Candidates(
            np.empty((_CANDIDATES, *windows.track.shape)),
            np.empty((_CANDIDATES, len(windows))),
            self._member_states(self.vectors_, self._observations(windows))[2],
            np.empty((_CANDIDATES, len(windows))),
        )
        for member, vector in enumerate(self.vectors_):
            in_fold = fold == member
            part = self._candidates(windows.subset(in_fold), vector[None])
            candidates.tracks[:, in_fold], candidates.hindcast_m[:, in_fold] = part.tracks, part.hindcast_m
            candidates.minutes[:, in_fold] = part.minutes
        hindcast_m, minutes = candidates.hindcast_m[0], candidates.minutes[0]
        minutes = minutes[np.isfinite(minutes)] if np.isfinite(minutes).any() else np.zeros(1)
        self.usual_ = _TrainingStatistics(
            hindcast_m=float(np.nanmedian(hindcast_m)) if np.isfinite(hindcast_m).any() else 1.0,
            spread_m=np.nanmedian(candidates.spread_m, axis=0),
            mean=float(minutes.mean()),
            deviation=float(minutes.std()),
            limit=float(np.quantile(minutes, _UNUSUAL)),
        )
        errors = [
            np.nanmean(baselines.distances(self._average_candidates(candidates, power)[0], windows.track))
            for power in WEIGHT_POWERS
        ]
        self.weight_power_ = WEIGHT_POWERS[int(np.argmin(errors))]
        tracks, uncertainty = np.empty(windows.track.shape), np.empty(candidates.spread_m.shape)
        for member, vector in enumerate(self.vectors_):
            in_fold = fold == member
            tracks[in_fold], uncertainty[in_fold] = self._predict_with_uncertainty(
                windows.subset(in_fold), candidates.subset_of_windows(in_fold), vector
            )
        self.region_ = baselines.conformal_region(tracks, windows, uncertainty)
        return tracks

    def _candidates(self, windows: window_sets.PredictionWindows, vectors: Floats) -> _Candidates:
        """The candidates' tracks over the windows, and their errors over the seconds and minutes before."""
        hindcast_inputs = window_sets.hindcast_windows(windows, baselines.HINDCAST_S)
        tracks, spread_m = self._candidate_tracks(vectors, self._observations(windows))
        hindcasts, _ = self._candidate_tracks(vectors, self._observations(hindcast_inputs))
        hindcast_m = np.stack(
            [baselines.mean_track_distances(hindcast, hindcast_inputs.track) for hindcast in hindcasts]
        )
        mean = vectors.mean(axis=0)[None]
        minutes = self._hindcast_log_errors(windows, lambda observed: self._candidate_tracks(mean, observed)[0])
        return _Candidates(tracks, hindcast_m, spread_m, minutes)

    def _hindcast_log_errors(
        self, windows: window_sets.PredictionWindows, predict: Callable[[Observations], Iterable[Floats]]
    ) -> Floats:
        """The mean logarithms [K, N] of the errors of K predictors in hindcasts over the last minutes; NaN if
        none of them was recorded. ``predict`` gives their tracks [.., H+1, 3]."""
        if len(windows) > _AT_ONCE:
            halves = np.array_split(np.arange(len(windows)), 2)
            return np.concatenate(
                [self._hindcast_log_errors(windows.subset(half), predict) for half in halves], axis=1
            )
        begins = range(self.hindcast_s_, window_sets.PAST_S - _INTERVAL_S, _INTERVAL_S)
        hindcast_inputs = window_sets.hindcast_windows(windows, *begins, horizon_s=self.hindcast_s_)
        error_m = np.stack(
            [
                baselines.mean_track_distances(hindcast, hindcast_inputs.track)
                for hindcast in predict(self._observations(hindcast_inputs))
            ]
        )
        error_m = error_m.reshape(-1, len(begins), len(windows))
        finite = np.isfinite(error_m)
        total = np.log(np.where(finite, error_m, 1.0) + _LEAST_LOG_M).sum(axis=1)
        return np.where(finite.any(axis=1), total / finite.sum(axis=1).clip(min=1), np.nan)

    def _predict_with_uncertainty(
        self, windows: window_sets.PredictionWindows, candidates: _Candidates, vector: Floats
    ) -> tuple[Floats, Floats]:
        """The tracks [N, H+1, 3] and their relative uncertainty [N, H], from models whose vectors have the mean
        ``vector``.

        A third of the uncertainty is proportional to the hindcast's error, another to the spread of the members'
        tracks, and all of it to the errors to expect after such last minutes.
        """
        tracks, hindcast_m = self._average_candidates(candidates, self.weight_power_)
        minutes = candidates.minutes[0].copy()
        begins = self.domain(windows, tracks)
        outside = replace(begins, values=begins.values[:, :1]).outside.any(axis=1)
        unusual = (minutes > self.usual_.limit) | outside
        if unusual.any():
            tracks[unusual], minutes[unusual] = self._average_with_followers(
                windows.subset(unusual), tracks[unusual], candidates.subset_of_windows(unusual), vector
            )
            hindcast_m = hindcast_m * np.exp(np.nan_to_num(minutes - candidates.minutes[0]))
        usual = self.usual_
        by_spread = candidates.spread_m / usual.spread_m[: candidates.spread_m.shape[1]].clip(min=1e-6)
        by_hindcast = hindcast_m[:, None] / max(usual.hindcast_m, 1e-6)
        return tracks, np.asarray(
            (1.0 + by_hindcast + by_spread) / 3.0 * usual.error_factor_of_day(minutes)[:, None]
        )

    def _average_with_followers(
        self, windows: window_sets.PredictionWindows, tracks: Floats, candidates: _Candidates, vector: Floats
    ) -> tuple[Floats, Floats]:
        """The mean of ``tracks`` [N, H+1, 3] with those of models that follow the measurements more closely, of
        constant velocity and of the reference, weighted by their hindcasts over the last minutes; and their
        mean log errors over these [N]. A predictor without hindcasts gets no weight beside one with them."""
        closer = [vector.copy() for _ in _CLOSER]
        for variant, increase in zip(closer, _CLOSER, strict=True):
            variant[[PLACES[f"force_walk_{axis}"] for axis in kalman_filter.AXES]] += increase

        def follow(observed: Observations) -> list[Floats]:
            runs = (run_observer(variant, self._model, observed) for variant in closer)
            return [states[..., :3] + waves for states, waves in runs]

        all_tracks = np.stack([tracks, *candidates.tracks[1:], *follow(self._observations(windows))])
        logs = np.concatenate([candidates.minutes, self._hindcast_log_errors(windows, follow)])
        finite = np.isfinite(logs)
        logs = np.where(finite, logs, self.usual_.mean)
        usable = np.asarray(np.isfinite(all_tracks).all(axis=(2, 3)) & (finite | ~finite.any(axis=0)))
        usable[0] |= ~usable.any(axis=0)
        weight = np.where(usable, np.exp(-_MINUTES_POWER * (logs - logs.min(axis=0))), 0.0)
        weight /= weight.sum(axis=0)
        return baselines.average_tracks(weight, all_tracks), (weight * logs).sum(axis=0)

    def _member_states(self, vectors: Floats, observations: Observations) -> tuple[Floats, Floats, Floats]:
        """The members' mean states [N, H+1, 6] and wave motion [N, H+1, 3], and the standard deviation of their
        tracks [N, H] in m."""
        parts = [run_observer(vector, self._model, observations) for vector in vectors]
        states, waves = (np.stack(part) for part in zip(*parts, strict=True))
        spread_m = np.linalg.norm(np.std(states[:, :, 1:, :2], axis=0), axis=-1)
        return states.mean(axis=0), waves.mean(axis=0), spread_m

    def _candidate_tracks(self, vectors: Floats, observations: Observations) -> tuple[Floats, Floats]:
        """The candidates' tracks [3, N, H+1, 3] from the members' mean observed state, with the same wave
        motion, and the members' spread [N, H]."""
        states, waves, spread_m = self._member_states(vectors, observations)
        held = baselines.constant_motion_tracks(states[:, 0], observations.control.shape[1])
        model = baselines.simulate_tracks(self._model, states[:, 0], observations.control, observations.wind)
        return np.asarray(np.stack([states[..., :3], held, model]) + waves), spread_m

    def _average_candidates(self, candidates: _Candidates, power: float) -> tuple[Floats, Floats]:
        """The candidates' weighted mean [N, H+1, 3] and its hindcast error [N] in metres.

        Windows in which the adapted model leaves its range are NaN.
        """
        finite = np.isfinite(candidates.hindcast_m)
        weight = np.zeros_like(candidates.hindcast_m)
        weight[0] = 1.0
        if np.isfinite(power):
            error_m = np.nan_to_num(candidates.hindcast_m, nan=np.inf) + _LEAST_RATIO * self.usual_.hindcast_m
            weight = np.where(finite[0], error_m**-power, weight)
        usable = np.isfinite(candidates.tracks).all(axis=(2, 3)) | (np.arange(_CANDIDATES) == 0)[:, None]
        weight = np.where(usable, weight, 0.0)
        weight = weight / weight.sum(axis=0)
        hindcast_m = np.where(finite, candidates.hindcast_m, _UNKNOWN_RATIO * self.usual_.hindcast_m)
        return baselines.average_tracks(weight, candidates.tracks), np.einsum("wn,wn->n", weight, hindcast_m)

    def predict(self, windows: window_sets.PredictionWindows, reference: Floats) -> Floats:
        return self.predict_with_uncertainty(windows, reference)[0]

    def predict_with_uncertainty(
        self, windows: window_sets.PredictionWindows, reference: Floats
    ) -> tuple[Floats, Floats]:
        candidates = self._candidates(windows, self.vectors_)
        return self._predict_with_uncertainty(windows, candidates, self.vectors_.mean(axis=0))

    def conformal_region(self, stopping: Examples) -> Floats:
        return self.region_

    def domain(self, windows: window_sets.PredictionWindows, reference: Floats) -> DomainOfApplicability:
        return domain_of_starts(windows, self.range_, DOMAIN_MARGIN)

    def state_dict(self) -> dict[str, Floats]:
        power = 0.0 if np.isinf(self.weight_power_) else self.weight_power_  # files cannot hold infinity
        usual = self.usual_
        fitted = {
            "vectors": self.vectors_, "covariance": self.covariance_, "range": self.range_, "region": self.region_,
            "trust": np.array([power, usual.hindcast_m, usual.mean, usual.deviation, usual.limit]),
            "spread": usual.spread_m,
        }  # fmt: skip
        if self.gust_s_ is not None:
            fitted["gust"] = np.array([self.gust_s_])
        return fitted

    def load_state_dict(self, fitted: dict[str, Floats]) -> Self:
        numbers = len(parameter_names(form_of(self._model))) if self.plant else 0
        members, seconds = max(len(fitted["vectors"]), 1), len(fitted["region"])
        require_tensor_shapes(fitted, {
            "vectors": (members, numbers), "covariance": (numbers, numbers), "trust": (5,),
            "range": (2, len(start_quantity_names(self.actuators))), "region": (seconds, 2), "spread": (seconds,),
            **({"gust": (1,)} if "gust" in fitted else {}),
        })  # fmt: skip
        self.vectors_, self.covariance_, self.range_ = (fitted[name] for name in ("vectors", "covariance", "range"))
        self.region_ = fitted["region"]
        self.hindcast_s_ = _hindcast_length_s(len(self.region_))
        power, hindcast_m, *minutes = map(float, fitted["trust"])
        self.usual_ = _TrainingStatistics(hindcast_m, fitted["spread"], *minutes)
        self.weight_power_ = power or np.inf
        self.gust_s_ = float(fitted["gust"][0]) if "gust" in fitted else None
        return self


def _hindcast_length_s(horizon_s: int) -> int:
    """The length of the hindcasts over the last minutes, for predictions trained over this horizon."""
    return min(max(horizon_s, _INTERVAL_S), _LONGEST_S)


def start_quantities(windows: window_sets.PredictionWindows) -> Floats:
    """The quantities :func:`start_quantity_names` of the windows' starts [N, 1, names], or second by second [N, H,
    names] with any commands.

    Motions are means over the last seconds, so that single waves do not matter.
    """
    observations = observations_of_windows(windows)
    recent = observations.past[:, :_RECENT_S]
    finite = np.isfinite(recent).all(axis=2, keepdims=True)
    mean = np.where(finite, recent, 0.0).sum(axis=1) / finite.sum(axis=1)
    control, angles = observations.control, angle_columns(windows.actuators)
    control = control if windows.commands is not None else control[:, :1]
    shafts = [column for column in range(control.shape[2]) if column not in angles]
    turned = [f(control[..., [column]]) for column in angles for f in (np.cos, np.sin)]
    motion = np.column_stack([mean[:, sensors.SURGE : sensors.YAW_RATE + 1], observations.wind[:, 0, 1]])
    repeated = np.repeat(motion[:, None], control.shape[1], axis=1)
    return np.concatenate([repeated, control[..., shafts], *turned], axis=-1)


def start_range(windows: window_sets.PredictionWindows) -> Floats:
    """The least and the most of each of :func:`start_quantity_names` at the windows' starts [2, names]."""
    starts = start_quantities(windows)
    return np.stack([starts.min(axis=(0, 1)), starts.max(axis=(0, 1))])


def domain_of_starts(
    windows: window_sets.PredictionWindows, trained: Floats, share: float
) -> DomainOfApplicability:
    """The windows' starts compared with the :func:`start_range` in training, which they may exceed by a ``share``
    of it, or by the smallest margin."""
    kinds = [KINDS[actuator.kind] for actuator in windows.actuators]
    shafts = [
        least_margin
        for kind in kinds
        for least_margin, angle in zip(kind.alike, kind.angles, strict=True)
        if not angle
    ]
    angles = [_LEAST_ANGLE_MARGIN] * (2 * len(angle_columns(windows.actuators)))
    low, high = trained
    margin = np.maximum(share * (high - low), np.array([*_LEAST_MARGIN, *shafts, *angles]))
    return DomainOfApplicability(
        start_quantity_names(windows.actuators), start_quantities(windows), low, high, margin
    )


def _assign_folds(leg: NDArray[np.str_], seed: int) -> NDArray[np.int64]:
    """The fold [N] of each window: whole groups, the longest first, each to the fold of the fewest windows."""
    names, group_number, counts = np.unique(leg, return_inverse=True, return_counts=True)
    members = min(MEMBERS, len(names))
    order = np.random.default_rng(seed).permutation(len(names))
    size, fold = np.zeros(members), np.empty(len(names), dtype=np.int64)
    for name in order[np.argsort(-counts[order], kind="stable")]:
        fold[name] = np.argmin(size)
        size[fold[name]] += counts[name]
    return fold[group_number]


_AVERAGED_S = 5
_MEAN_WIND_S = 60
_GUSTING_S, _GUST_LAG_S, _GUST_BOUNDS_S = 3, 10, (2.0, 300.0)


def observations_of_windows(windows: window_sets.PredictionWindows, gust_s: float | None = None) -> Observations:
    """The observations of windows, with their commands from second 0 and the expected wind.

    Without commands the mean control over the last steady seconds is held. Without ``gust_s`` the mean wind of
    the last seconds is held; with it gusts decay with that time constant (:func:`expected_wind`).
    """
    measured, complete_s = kalman_filter.measured_past_of_windows(windows, _MEAN_WIND_S)
    past = measured[:, : kalman_filter.OBSERVED_S + 1]
    control = windows.commands
    if control is None:
        recent, angles = past[:, :_AVERAGED_S, window_sets.CONTROLS], angle_columns(windows.actuators)
        thresholds = [threshold for actuator in windows.actuators for threshold in KINDS[actuator.kind].still]
        deviation = recent - recent[:, :1]
        deviation[..., angles] = window_sets.angle_difference_rad(recent[..., angles], recent[:, :1, angles])
        steady = np.cumprod((np.abs(deviation) < np.array(thresholds)).all(axis=2), axis=1)[..., None]
        mean_control = recent[:, 0] + (np.nan_to_num(deviation) * steady).sum(axis=1) / steady.sum(axis=1)
        control = np.repeat(mean_control[:, None], windows.horizon_s, axis=1)
    if gust_s is None:
        mean = _mean_vector(_wind_vectors(past)[:, :_AVERAGED_S])
        wind = np.repeat(np.column_stack([np.angle(mean), np.abs(mean)])[:, None], windows.horizon_s, axis=1)
    else:
        wind = expected_wind(measured, gust_s, windows.horizon_s)
    past, control = np.ascontiguousarray(past), np.ascontiguousarray(control)
    return Observations(past, complete_s.clip(max=kalman_filter.OBSERVED_S), control, wind)


def expected_wind(past: Floats, gust_s: float, horizon_s: int) -> Floats:
    """The expected wind [N, H, 2]: the mean of the ``past``, plus the deviation of the last seconds decaying as
    exp(-t / ``gust_s``), the optimal forecast of gusts as a first-order process."""
    vectors = _wind_vectors(past)
    mean, latest = _mean_vector(vectors), _mean_vector(vectors[:, :_GUSTING_S])
    decay = np.exp(-(np.arange(horizon_s) + 0.5) / gust_s)
    expected = mean[:, None] + (latest - mean)[:, None] * decay
    return np.ascontiguousarray(np.stack([np.angle(expected), np.abs(expected)], axis=-1))


def gust_decay_s(windows: window_sets.PredictionWindows) -> float:
    """The decay time of gusts [s], from the correlation of winds :data:`_GUST_LAG_S` apart.

    Winds are relative to the mean of their recording; the longest such time if there was no wind.
    """
    vectors = _wind_vectors(windows.past)
    for trial in np.unique(windows.trial):
        in_trial = windows.trial == trial
        vectors[in_trial] -= np.nan_to_num(np.nanmean(vectors[in_trial, 0]))
    latest, earlier = vectors[:, 0], vectors[:, _GUST_LAG_S]
    measured = np.isfinite(latest) & np.isfinite(earlier)
    power = 0.5 * (np.abs(latest[measured]) ** 2 + np.abs(earlier[measured]) ** 2).sum()
    correlation = float((latest[measured] * earlier[measured].conj()).real.sum() / power) if power > 0.0 else 1.0
    bounds = np.exp(-_GUST_LAG_S / np.array(_GUST_BOUNDS_S))
    return float(-_GUST_LAG_S / np.log(np.clip(correlation, *bounds)))


def _wind_vectors(past: Floats) -> Complexes:
    """The winds of the past as complex numbers, north and east [N, P+1]; NaN where unknown."""
    direction, speed = np.moveaxis(past[..., window_sets.WIND], -1, 0)
    return np.asarray(speed * np.exp(1j * direction))


def _mean_vector(vectors: Complexes) -> Complexes:
    """The mean of the finite vectors [N], zero if there are none."""
    finite = np.isfinite(vectors)
    return np.asarray(np.where(finite, vectors, 0.0).sum(axis=1) / finite.sum(axis=1).clip(min=1))


_POSITIVE = ("mass_kg", "yaw_inertia_kgm2", "Xud", "Yvd", "Nrd")
_WIND_AREAS = ("frontal_area_m2", "lateral_area_m2")
"""Wind force coefficients in surge and sway. R/V Gunnerus, whose hull model is the polynomial, has its own from a
wind tunnel."""


def positive_coefficient_names(form: Form) -> tuple[str, ...]:
    """Coefficients that keep their sign, as masses and damping must: adapted by factors, the others by shares."""
    kinds = dict.fromkeys(actuator.kind for actuator in form.actuators)
    damping = hulls.HULLS[form.hull].keeps_sign
    areas = () if form.hull == "polynomial" else _WIND_AREAS
    return (*_POSITIVE, *damping, *areas, *(name for kind in kinds for name in KINDS[kind].keeps_sign))


def signed_coefficient_names(form: Form) -> tuple[str, ...]:
    """Coefficients that may change sign, including each actuator's own."""
    hull = hulls.HULLS[form.hull]
    adapted = (f"{actuator.name}_{name}" for actuator in form.actuators for name in KINDS[actuator.kind].adapted)
    return (*(name for name in hull.numbers if name not in hull.keeps_sign), "Yrd", *adapted)


def parameter_names(form: Form | BlackBox) -> tuple[str, ...]:
    """The names of the vector's parameters: of the model of a ship of this form or of a simulator, and of its
    environment."""
    if isinstance(form, BlackBox):
        return (*drive_gains(form), *DRAG, *SURROUNDED)
    return (*positive_coefficient_names(form), *signed_coefficient_names(form), *SURROUNDED)


def form_of(model: MotionModel) -> Form | BlackBox:
    """What the names of a model's parameters depend on."""
    return model if isinstance(model, BlackBox) else model.form


def sign_keeping_shares(form: Form | BlackBox) -> dict[str, float]:
    """The parameters that are factors, with the prior standard deviation of their logarithm."""
    if isinstance(form, BlackBox):
        return drive_gains(form)
    return dict.fromkeys(positive_coefficient_names(form), USUAL_SHARE)


def drive_gains(model: BlackBox) -> dict[str, float]:
    """The gains of a simulator's drives, with the prior standard deviation of their logarithm.

    The share of a coefficient, as for rudders; half of it for shafts and pitch, the square of which gives thrust.
    The angle of an azimuth thruster is where its force points and has none.
    """
    return {
        f"{actuator.name}_{label}_scale": USUAL_SHARE if is_angle else 0.5 * USUAL_SHARE
        for actuator in model.layout
        for label, is_angle in zip(KINDS[actuator.kind].labels, KINDS[actuator.kind].angles, strict=True)
        if (actuator.kind, label) != ("azimuth", "angle")
    }


USUAL_SHARE = 0.5
"""The prior relative standard deviation of a coefficient, as between ships of a kind."""
_USUAL_DRAG_PM = (2e-3, 5e-2, 5e-2)
"""The prior standard deviation of a simulator's drag in surge, sway and yaw [1/m] at the usual length: half of R/V
Gunnerus' resistance and yaw damping (docs/own_simulator.md), and of a cross flow with a drag coefficient of one."""
STEADY = {"constant_X_n": 3000.0, "constant_Y_n": 3000.0, "constant_N_nm": 30000.0}
STEADY_MASS_KG = 4.0e5
"""The mass for which the steady forces above hold; they scale with mass."""
CURRENT_MPS, WIND_MPS, DRIFT_N = 0.2, 3.0, 3000.0
SURROUNDINGS = ("current_north", "current_east", "drift_north", "drift_east", "wind_north", "wind_east")
LAG, LAG_S = "thruster_lag", 1.0
"""The prior of the thrusters' lag when commands are recorded; negative values mean none."""
SURROUNDED = (*STEADY, *SURROUNDINGS, LAG, *kalman_filter.FILTER_NUMBERS)
"""The names of the vector's last parameters: the environment of any ship, and the observer's noise levels."""
PLACES = {name: number - len(SURROUNDED) for number, name in enumerate(SURROUNDED)}
"""Their positions, from the vector's end."""
LARGEST_FACTOR = 2.0


def parameter_value(vector: Floats, name: str) -> float:
    """One parameter of the vector, by one of :data:`SURROUNDED`."""
    return float(vector[PLACES[name]])


@lru_cache(maxsize=32)
def _positions_of_adapted_numbers(form: Form) -> tuple[list[int], list[int], int]:
    """The positions of the vector's parameters in a flat plant, their indices, and the number that keep their
    sign."""
    positive = positive_coefficient_names(form)
    pairs = [
        (place, number)
        for number, name in enumerate((*positive, *signed_coefficient_names(form)))
        for place in number_places(form, name)
    ]
    return [place for place, _ in pairs], [number for _, number in pairs], len(positive)


def adapt_plant(vector: Floats, plant: Plant) -> NDArray[np.void]:
    """The plant, packed [1], with coefficients, steady forces, current, drift and lag changed by the vector.

    Recent results are cached, since one prediction needs each member's several times.
    """
    return _adapt_plant_cached(vector.tobytes(), plant)


@lru_cache(maxsize=32)
def _adapt_plant_cached(stored: bytes, plant: Plant) -> NDArray[np.void]:
    vector = np.frombuffer(stored)
    packed = pack(plant)
    places, numbers, kept = _positions_of_adapted_numbers(plant.form)
    departed = USUAL_SHARE * vector[: -len(SURROUNDED)]
    factor = np.exp(departed[:kept].clip(-LARGEST_FACTOR, LARGEST_FACTOR))
    flat_numbers(packed)[0, places] *= np.concatenate([factor, 1.0 + departed[kept:]])[numbers]
    heavier = plant.mass_kg / STEADY_MASS_KG
    for name, usual in STEADY.items():
        packed[name] += heavier * usual * parameter_value(vector, name)
    packed["current_north_mps"] += CURRENT_MPS * parameter_value(vector, "current_north")
    packed["current_east_mps"] += CURRENT_MPS * parameter_value(vector, "current_east")
    packed["thruster_lag_s"] = max(0.0, plant.thruster_lag_s + LAG_S * parameter_value(vector, LAG))
    drift_n = plant.drift_force_n
    north = drift_n * plant.drift_north + heavier * DRIFT_N * parameter_value(vector, "drift_north")
    east = drift_n * plant.drift_east + heavier * DRIFT_N * parameter_value(vector, "drift_east")
    size = np.hypot(north, east)
    packed["drift_force_n"] = size
    packed["drift_north"], packed["drift_east"] = (north / size, east / size) if size > 0.0 else (1.0, 0.0)
    packed.setflags(write=False)
    return packed


def adapt_simulator(vector: Floats, model: BlackBox) -> BlackBox:
    """The simulator with gains, drag, steady pushes, current and lag changed by the vector."""
    units = parameter_units_and_conversions(model)
    value = {
        name: units[name][2](deviation)
        for name, deviation in zip(parameter_names(model), vector, strict=True)
        if name in units
    }
    gains = {name: model.number(name) * value[name] for name in drive_gains(model)}
    return model.replaced(
        **gains, **{name: value[name] for name in (*DRAG, *STEADY)}, current_north_mps=value["current_north"],
        current_east_mps=value["current_east"], thruster_lag_s=value[LAG],
    )  # fmt: skip


def add_steady_wind(vector: Floats, direction_rad: Floats, speed_mps: Floats) -> tuple[Floats, Floats]:
    """A measured wind plus the vector's steady one: direction it comes from [rad] and speed [m/s]."""
    north, east = WIND_MPS * parameter_value(vector, "wind_north"), WIND_MPS * parameter_value(vector, "wind_east")
    if north == 0.0 == east:
        return direction_rad, speed_mps
    vector_mps = speed_mps * np.exp(1j * direction_rad) + (north + 1j * east)
    return np.angle(vector_mps), np.abs(vector_mps)


def observer_gains(vector: Floats, model: MotionModel) -> kalman_filter.Gains:
    """The observer's gains for a vector, as :func:`.filter_gains`."""
    numbers = (parameter_value(vector, name) for name in kalman_filter.FILTER_NUMBERS)
    return kalman_filter.filter_gains(model.length_overall_m, *numbers)


ValueOfDeviation = Callable[[float], float]


def parameter_units_and_conversions(model: MotionModel) -> dict[str, tuple[str, float, ValueOfDeviation]]:
    """Unit, the reference model's value and the conversion from deviation to value, for each parameter of ship
    and environment. Wind is relative to the measured one; forces on a simulator are those on an assumed mass."""

    def additive_conversion(model_value: float, usual_deviation: float) -> ValueOfDeviation:
        return lambda z: model_value + usual_deviation * z

    def factor_conversion(share: float) -> ValueOfDeviation:
        return lambda z: float(np.exp(np.clip(share * z, -LARGEST_FACTOR, LARGEST_FACTOR)))

    is_ship = isinstance(model, Plant)
    mass_kg = model.mass_kg if is_ship else float(assumed_inertia(model.length_between_perpendiculars_m)[0])
    heavier = mass_kg / STEADY_MASS_KG
    factors = {name: factor_conversion(share) for name, share in sign_keeping_shares(form_of(model)).items()}
    if isinstance(model, Plant):
        factors |= dict.fromkeys(signed_coefficient_names(model.form), lambda z: 1.0 + USUAL_SHARE * z)
    units: dict[str, tuple[str, float, ValueOfDeviation]] = {
        name: ("times the model's", 1.0, conversion) for name, conversion in factors.items()
    }
    if isinstance(model, BlackBox):
        shorter = effect.USUAL_LENGTH_M / model.length_between_perpendiculars_m
        for name, usual in zip(DRAG, _USUAL_DRAG_PM, strict=True):
            units[name] = ("1/m", model.number(name), additive_conversion(model.number(name), shorter * usual))
    for name, usual in STEADY.items():
        steady = float(getattr(model, name))
        units[name] = ("N m" if name.endswith("_nm") else "N", steady, additive_conversion(steady, heavier * usual))
    for axis in ("north", "east"):
        current_mps = float(getattr(model, f"current_{axis}_mps"))
        units[f"current_{axis}"] = ("m/s", current_mps, additive_conversion(current_mps, CURRENT_MPS))
        if isinstance(model, Plant):
            drift_n = model.drift_force_n * float(getattr(model, f"drift_{axis}"))
            units[f"drift_{axis}"] = ("N", drift_n, additive_conversion(drift_n, heavier * DRIFT_N))
        units[f"wind_{axis}"] = ("m/s", 0.0, additive_conversion(0.0, WIND_MPS))
    lag_s = model.thruster_lag_s
    return units | {LAG: ("s", lag_s, lambda z: max(0.0, lag_s + LAG_S * z))}


def parameters_with_effect(model: MotionModel) -> Bools:
    """Which parameters change the model or the observer [parameters]: coefficients that are zero stay so, a
    simulator has no drift force, and may take no wind."""
    names = parameter_names(form_of(model))
    if isinstance(model, BlackBox):
        absent = ("drift_north", "drift_east", *(("wind_north", "wind_east") if not model.takes_wind else ()))
        return ~np.isin(names, absent)
    places, numbers, _ = _positions_of_adapted_numbers(model.form)
    effective = np.ones(len(names), dtype=bool)
    effective[: -len(SURROUNDED)] = np.bincount(numbers, flat_numbers(pack(model))[0, places] != 0.0) > 0.0
    return effective


def run_observer(vector: Floats, model: MotionModel, observations: Observations) -> tuple[Floats, Floats]:
    """Run the adapted model as a filter along the observations of N windows, and freely from second 0.

    Returns the states [N, H+1, 6] and the wave motion [N, H+1, 3], as :func:`.run_filter`.
    """
    states, waves = run_observers(vector[None], model, observations)
    return states[0], waves[0]


def run_observers(vectors: Floats, model: MotionModel, observations: Observations) -> tuple[Floats, Floats]:
    """As :func:`run_observer`, of M vectors with one steady wind: [M, N, H+1, 6] and [M, N, H+1, 3]."""
    vector = vectors[0]
    if parameter_value(vector, "wind_north") or parameter_value(vector, "wind_east"):
        past, wind = observations.past.copy(), observations.wind
        past[..., window_sets.WIND] = np.stack(
            add_steady_wind(vector, *np.moveaxis(past[..., window_sets.WIND], -1, 0)), axis=-1
        )
        wind = np.stack(add_steady_wind(vector, wind[..., 0], wind[..., 1]), axis=-1)
        observations = replace(observations, past=past, wind=wind)
    gains = [observer_gains(vector, model) for vector in vectors]
    if isinstance(model, BlackBox):
        adapted = [adapt_simulator(vector, model) for vector in vectors]
        return kalman_filter.run_simulator_filter(adapted, gains, observations)
    packed = np.concatenate([adapt_plant(vector, model) for vector in vectors])
    return kalman_filter.run_filter(packed, model, gains, observations)


STEPS = 8
_OUTLYING = 1.5
_NUMBERS_A_WINDOW = 6.0  # independent numbers in a track: two in each of three coordinates
_LEAST = np.array([0.01, 0.01, 0.0005])  # lower bound on prediction errors [m, m, rad] at the usual length
_DIFFERENCE = 1e-3
_ENOUGH = 2e-3
_GIVE_UP = 1e6
_STEEPEST = 1e6
_MOVED_AT_ONCE = 16  # parameters: more take memory, 4 kB a window and parameter, and no less time


def fit_parameter_vector(
    model: MotionModel,
    windows: Observations,
    track: Floats,
    overlap: float,
    progress: Progress = lambda share: None,
    steps: int = STEPS,
) -> Floats:
    """The vector [parameters] for which predictions fit the measured tracks [N, H+1, 3].

    ``overlap`` is the share of a window that is its own, at most one. Seconds without a measured position are
    NaN and ignored.
    """

    def cost(vector: Floats, differences: Floats, weight: Floats) -> float:
        inside = (differences * weight)[weight[:, 0, 0] > 0.0]
        return float(np.sum(inside**2) + vector @ vector) if np.isfinite(inside).all() else np.inf

    differences_at, complete = _make_difference_function(model, windows, track)
    vector, damping = np.zeros(len(parameter_names(form_of(model)))), 1e-3
    residual = differences_at(vector)
    for step in range(steps):
        progress(step / steps)
        weight = _whitening_factors(residual, complete, overlap, model)
        slope = _weighted_jacobian(model, differences_at, vector, residual, weight)
        normal = slope.T @ slope
        pull = slope.T @ np.nan_to_num(residual * weight).ravel() + vector
        initial_cost = cost(vector, residual, weight)
        while damping < _GIVE_UP:
            damped = normal + np.eye(len(vector)) + damping * np.diag(1.0 + np.diag(normal))
            tried = vector - np.linalg.solve(damped, pull)
            tried_residual = differences_at(tried)
            tried_cost = cost(tried, tried_residual, weight)
            if tried_cost < initial_cost:
                break
            damping *= 6.0
        else:
            break
        vector, residual, damping = tried, tried_residual, max(damping / 5.0, 1e-6)
        if initial_cost - tried_cost < _ENOUGH * initial_cost:
            break
    return vector


def _make_difference_function(
    model: MotionModel, windows: Observations, track: Floats
) -> tuple[Callable[[Floats], Floats], Bools]:
    """A function for the differences [.., N, H, 3] between predictions with a vector, or with vectors
    [M, parameters] of one steady wind, and the tracks, in surge, sway and heading, and the known seconds [N, H]."""
    unknown = np.asarray(np.isnan(track[:, 1:]).any(axis=2))

    def differences_at(vectors: Floats) -> Floats:
        states, waves = (run_observer if vectors.ndim == 1 else run_observers)(vectors, model, windows)
        gap = np.where(unknown[..., None], 0.0, (states[..., :3] + waves - track)[..., 1:, :])
        return np.stack([*rotate_earth_to_ship(gap[..., 0], gap[..., 1], track[:, :1, 2]), gap[..., 2]], axis=-1)

    return differences_at, ~unknown


def _whitening_factors(residual: Floats, complete: Bools, overlap: float, model: MotionModel) -> Floats:
    """The factor of each difference [N, H, 3]: its second's scale, its window's weight.

    The scale is from the median over the windows in which a second is measured and the model in its range; windows
    outside the model's range have the weight zero.
    """
    squares = residual**2
    usable = complete[..., None] & np.isfinite(squares)
    ordered = np.sort(np.where(usable, squares, np.inf), axis=0)
    middle = (usable.sum(axis=0) // 2).clip(max=len(squares) - 1)
    median = np.take_along_axis(ordered, middle[None], axis=0)[0]
    least = _LEAST * min(1.0, model.length_overall_m / effect.USUAL_LENGTH_M)
    scale = 1.48 * np.sqrt(np.where(np.isfinite(median), median, 1.0)) + least
    size = np.sqrt(np.mean((residual / scale) ** 2, axis=(1, 2)))
    finite = np.isfinite(size)
    robust = np.where(finite, np.minimum(1.0, _OUTLYING / np.maximum(np.where(finite, size, 1.0), 1e-9)), 0.0)
    share = overlap * _NUMBERS_A_WINDOW / (residual.shape[1] * residual.shape[2])
    return np.asarray(np.sqrt(share * robust)[:, None, None] / scale)


def _weighted_jacobian(
    model: MotionModel, differences_at: Callable[[Floats], Floats], vector: Floats, residual: Floats, weight: Floats
) -> Floats:
    """The derivative of the weighted differences with respect to each parameter [N H 3, parameters].

    Several parameters are moved at once, so that all cores take part; those of the wind one by one, since the
    vectors of a batch have one wind.
    """
    columns = np.zeros((residual.size, len(vector)))
    moving = np.flatnonzero(parameters_with_effect(model))
    of_wind = np.isin(moving, [PLACES[name] % len(vector) for name in ("wind_north", "wind_east")])
    batches = np.array_split(moving[~of_wind], np.arange(_MOVED_AT_ONCE, (~of_wind).sum(), _MOVED_AT_ONCE))
    for batch in (*batches, *moving[of_wind][:, None]):
        moved = np.repeat(vector[None], len(batch), axis=0)
        moved[np.arange(len(batch)), batch] += _DIFFERENCE
        slopes = np.nan_to_num((differences_at(moved) - residual) / _DIFFERENCE * weight)
        columns[:, batch] = slopes.reshape(len(batch), -1).T
    return columns


_NEARLY = 0.95  # of a bound, which the mean of differing members does not quite reach
_TITLES = {
    "constant_X_n": "steady force ahead", "constant_Y_n": "steady force aside", "constant_N_nm": "steady moment",
    "wind_north": "wind added, north", "wind_east": "wind added, east",
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class AdaptedParameter:
    """A parameter: ``value`` in ``unit`` with its 95 % interval and standard error, its ``neutral`` value,
    whether it is at a bound, and whether the data determine it."""

    name: str
    value: float
    low: float
    high: float
    error: float
    unit: str
    neutral: float
    at_bound: bool
    identified: bool


@dataclass(frozen=True, slots=True)
class Parameters:
    """All parameters of the model, the best determined first, and their correlations [P, P]."""

    parameters: tuple[AdaptedParameter, ...]
    correlation: Floats

    @property
    def identified(self) -> tuple[AdaptedParameter, ...]:
        """Those that the data determine."""
        return tuple(parameter for parameter in self.parameters if parameter.identified)

    def inseparable_pairs(self) -> list[tuple[str, str, float]]:
        """Pairs of identified parameters that the data cannot separate, with their correlation."""
        return correlated_pairs([parameter.name for parameter in self.identified], self.correlation)


def parameters_of_calibrator(calibrator: AdaptiveCalibrator) -> Parameters:
    """The parameters of the ship and of its environment, without the observer's noise levels."""
    if calibrator.plant is None:
        raise ValueError("the adaptive calibrator needs the reference model")
    units = parameter_units_and_conversions(calibrator.plant)
    form = form_of(calibrator.plant)
    places = np.array([parameter_names(form).index(name) for name in units])
    vector, covariance = calibrator.vectors_.mean(axis=0)[places], calibrator.covariance_[np.ix_(places, places)]
    deviation = np.sqrt(np.diag(covariance))
    order = np.argsort(deviation, kind="stable")
    correlation = (covariance / np.outer(deviation, deviation))[np.ix_(order, order)]
    names, shares = list(units), sign_keeping_shares(form)
    parameters = []
    for place in order:
        name, z, spread = names[place], vector[place], deviation[place]
        unit, neutral, natural = units[name]
        low, high = sorted((natural(z - 1.96 * spread), natural(z + 1.96 * spread)))
        clipped = abs(shares.get(name, 0.0) * z) > _NEARLY * LARGEST_FACTOR
        at_bound = clipped or (name == LAG and z < 0.0 and natural(z) == 0.0)
        title = _TITLES.get(name, name.replace("_", " ") if name in SURROUNDED else name)
        parameters.append(
            AdaptedParameter(
                title, natural(z), low, high, (high - low) / 3.92, unit, neutral, bool(at_bound), spread < UNKNOWN
            )
        )
    return Parameters(tuple(parameters), correlation)
