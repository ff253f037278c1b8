"""The adaptive calibrator: an ensemble of adapted models, cross-validated by legs and weighted by hindcasts.

What it learned applies to the day, loading and sea of its training. Hindcasts over the last minutes show
whether it still applies: the model's errors now, compared with those in training. If they exceed nearly all of
those, or outside the training range, models that follow the measurements more closely and the baselines are
averaged in, weighted by their own hindcasts; and the regions grow accordingly.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from seatrial.acquisition.core.errors import DataShortageError, Progress, part_of
from seatrial.acquisition.core.quantities import Bools, Floats
from seatrial.acquisition.core.ship import Actuators, trial_names
from seatrial.hybrid.calibrators.adaptive.adaptation import (
    adapt_plant,
    follow_closer,
    gust_decay_s,
    observations_of,
    parameter_names,
    run_observer,
)
from seatrial.hybrid.calibrators.adaptive.fit import adapt, covariance_at
from seatrial.hybrid.calibrators.calibrator import Calibrator, DomainOfApplicability, Examples, require_shapes
from seatrial.hybrid.prediction.baselines import (
    HINDCAST_S,
    average_tracks,
    present_motion_held,
    simulate_tracks,
)
from seatrial.hybrid.prediction.kalman_filter import Observations
from seatrial.hybrid.prediction.prediction_windows import (
    PAST_S,
    PredictionWindows,
    clear_of,
    concatenate_windows,
    first_seconds,
    hindcast_windows,
    unlike_groups,
)
from seatrial.hybrid.prediction.regions import conformal_region
from seatrial.hybrid.prediction.scores import distances, mean_distances
from seatrial.hybrid.vessel.actuators import KINDS, angle_columns, control_labels
from seatrial.hybrid.vessel.plant import Plant, flat
from seatrial.hybrid.vessel.sensors import SURGE, YAW_RATE

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


def start_names(actuators: Actuators) -> tuple[str, ...]:
    """The quantities of a start that define the domain of applicability, of a ship with these actuators."""
    labels, angles = control_labels(actuators), angle_columns(actuators)
    shafts = (name for column, name in enumerate(labels) if column not in angles)
    turned = (f"{labels[column]}_{part}" for column in angles for part in ("cos", "sin"))
    return ("surge_mps", "sway_mps", "yaw_rate_radps", "wind_speed_mps", *shafts, *turned)


_LEAST_RATIO = 0.1  # lower bound on hindcast errors, as a share of the median
_UNKNOWN_RATIO = 2.0  # hindcast error of a window with an unknown past, in medians
_RECENT_S = 5
_CANDIDATES = 3  # the adapted model, constant velocity, the reference
_EVERY_S, _LONGEST_S = 15, 60
"""The interval between the hindcasts that test the model on this day, and their maximum length [s]. They are as
long as the prediction: over 120 s, on a simulated ship a tenth heavier than in training, hindcasts of 15 s left
coverage at 88 % and the error at 0.16 of the best baseline's, those of a minute at 98 % and 0.13."""
_CLOSER = (1.0, 2.0)
"""The increases, in prior standard deviations, of the bias force's process noise."""
_MINUTES_POWER = 4.0
"""Their weights are this inverse power of the error over the last minutes."""
_UNUSUAL = 0.95
"""A model whose errors exceed this share of those in training is not used alone."""
_DAYS_APART = np.log(2.0)
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

    def subset(self, chosen: Bools) -> _Candidates:
        """The candidates of the windows that a mask chooses."""
        return _Candidates(
            self.tracks[:, chosen], self.hindcast_m[:, chosen], self.spread_m[chosen], self.minutes[:, chosen]
        )


@dataclass(frozen=True, slots=True)
class _Usual:
    """The usual values in training, on held-out legs: the median hindcast error ``hindcast_m``, the median
    spread of the members ``spread_m`` [H], and of the log errors over the last minutes the ``mean``, standard
    ``deviation`` and upper limit ``most``."""

    hindcast_m: float
    spread_m: Floats
    mean: float
    deviation: float
    most: float

    @classmethod
    def of(cls, candidates: _Candidates) -> _Usual:
        """The usual values of the candidates of all windows; a metre where nothing was recorded."""
        own_m, minutes = candidates.hindcast_m[0], candidates.minutes[0]
        minutes = minutes[np.isfinite(minutes)] if np.isfinite(minutes).any() else np.zeros(1)
        return cls(
            hindcast_m=float(np.nanmedian(own_m)) if np.isfinite(own_m).any() else 1.0,
            spread_m=np.nanmedian(candidates.spread_m, axis=0),
            mean=float(minutes.mean()),
            deviation=float(minutes.std()),
            most=float(np.quantile(minutes, _UNUSUAL)),
        )

    def day(self, minutes: Floats) -> Floats:
        """The factor [N], at least 1, on the training errors to expect after such last minutes.

        A few minutes are uncertain by ``deviation``, so the logarithm is shrunk (normal prior of standard
        deviation :data:`_DAYS_APART`, normal likelihood); unknown minutes count as usual.
        """
        worse = np.maximum(np.nan_to_num(minutes, nan=self.mean) - self.mean, 0.0)
        return np.asarray(np.exp(worse * _DAYS_APART**2 / (_DAYS_APART**2 + self.deviation**2)))


class AdaptiveCalibrator(Calibrator):
    """An ensemble of adapted models, averaged with constant velocity and the reference by hindcast errors.

    Each of :data:`MEMBERS` models is fitted without a share of the legs (cross-validation). The held-out legs
    determine the power of the hindcast weights and the 95 % regions. All members predict together.
    """

    method = "adaptive"
    extrapolates: ClassVar[bool] = True
    gust_s_: float | None
    usual_: _Usual

    def labels(self, actuators: Actuators) -> tuple[str, ...]:
        return trial_names(actuators)

    def fit(self, training: Examples, stopping: Examples, progress: Progress = lambda share: None) -> Self:
        """Fit to the windows of both parts; no legs are needed for stopping. Raises :class:`DataShortageError`."""
        windows = concatenate_windows([training[0], stopping[0]])
        self.any_commands = windows.commands is not None
        self.gust_s_ = gust_decay_s(windows) if self.any_commands else None
        self.hindcast_s_ = _hindcast_s(windows.horizon_s)
        fold = _folds(unlike_groups(windows), self.seed)
        members = int(fold.max()) + 1
        if members < 2:
            raise DataShortageError("only one leg, which cannot be split", fix="give more or longer recordings")
        vectors = []
        for member in range(members):
            drawn = self._drawn(windows, clear_of(windows, fold != member, fold == member), member)
            vectors.append(adapt(self._model, *drawn, part_of(progress, member, members)))
        self.vectors_ = np.stack(vectors)
        all_drawn = self._drawn(windows, np.ones(len(windows), dtype=bool), members)
        self.covariance_ = covariance_at(self.vectors_.mean(axis=0), self._model, *all_drawn)
        self.range_ = start_range(windows)
        self.out_of_sample_ = self._cross_validate(windows, fold)[len(training[0]) :]
        return self

    def adapted_model(self) -> Plant:
        """The reference model with the mean of its members' parameters."""
        packed = adapt_plant(self.vectors_.mean(axis=0), self._model)
        return replace(self._model, values=tuple(flat(packed)[0].tolist()))

    def out_of_sample_tracks(self, stopping: Examples) -> Floats:
        return self.out_of_sample_

    def _observed(self, windows: PredictionWindows) -> Observations:
        """The observer's observations; the decay of gusts is learned with any commands only."""
        return observations_of(windows, self.gust_s_)

    def _drawn(self, windows: PredictionWindows, chosen: Bools, number: int) -> tuple[Observations, Floats, float]:
        """Observations, tracks and overlap, as :func:`adapt` takes them, of the first seconds of the chosen
        windows, of no more than :data:`MOST_WINDOWS`; the draw's ``number`` is part of its seed."""
        rows = np.flatnonzero(chosen)
        if len(rows) > MOST_WINDOWS:
            random = np.random.default_rng([self.seed, number])
            rows = np.sort(random.choice(rows, MOST_WINDOWS, replace=False))
        drawn = first_seconds(windows.subset(rows), FITTED_S)
        return self._observed(drawn), drawn.track, _own_share(drawn)

    @property
    def _model(self) -> Plant:
        if self.plant is None:
            raise ValueError("the adaptive calibrator needs the reference model")
        return self.plant

    def _cross_validate(self, windows: PredictionWindows, fold: NDArray[np.int64]) -> Floats:
        """Fit weights and regions; return the tracks [N, H+1, 3] of each window by the member not fitted to it."""
        candidates = _Candidates(
            np.empty((_CANDIDATES, *windows.track.shape)),
            np.empty((_CANDIDATES, len(windows))),
            self._member_states(self.vectors_, self._observed(windows))[2],
            np.empty((_CANDIDATES, len(windows))),
        )
        for member, vector in enumerate(self.vectors_):
            mine = fold == member
            part = self._candidates(windows.subset(mine), vector[None])
            candidates.tracks[:, mine], candidates.hindcast_m[:, mine] = part.tracks, part.hindcast_m
            candidates.minutes[:, mine] = part.minutes
        self.usual_ = _Usual.of(candidates)
        errors = [
            np.nanmean(distances(self._average(candidates, power)[0], windows.track)) for power in WEIGHT_POWERS
        ]
        self.weight_power_ = WEIGHT_POWERS[int(np.argmin(errors))]
        tracks, uncertainty = np.empty(windows.track.shape), np.empty(candidates.spread_m.shape)
        for member, vector in enumerate(self.vectors_):
            mine = fold == member
            tracks[mine], uncertainty[mine] = self._predicted(windows.subset(mine), candidates.subset(mine), vector)
        self.region_ = conformal_region(tracks, windows, uncertainty)
        return tracks

    def _candidates(self, windows: PredictionWindows, vectors: Floats) -> _Candidates:
        """The candidates' tracks over the windows, and their errors over the seconds and minutes before."""
        before = hindcast_windows(windows, HINDCAST_S)
        tracks, spread_m = self._candidate_tracks(vectors, self._observed(windows))
        hindcasts, _ = self._candidate_tracks(vectors, self._observed(before))
        hindcast_m = np.stack([mean_distances(hindcast, before.track) for hindcast in hindcasts])
        mean = vectors.mean(axis=0)[None]
        minutes = self._last_minutes(windows, lambda observed: self._candidate_tracks(mean, observed)[0])
        return _Candidates(tracks, hindcast_m, spread_m, minutes)

    def _last_minutes(
        self, windows: PredictionWindows, predict: Callable[[Observations], Iterable[Floats]]
    ) -> Floats:
        """The mean logarithms [K, N] of the errors of K predictors in hindcasts over the last minutes; NaN if
        none of them was recorded. ``predict`` gives their tracks [.., H+1, 3]."""
        if len(windows) > _AT_ONCE:
            halves = np.array_split(np.arange(len(windows)), 2)
            return np.concatenate([self._last_minutes(windows.subset(half), predict) for half in halves], axis=1)
        begins = range(self.hindcast_s_, PAST_S - _EVERY_S, _EVERY_S)
        before = hindcast_windows(windows, *begins, horizon_s=self.hindcast_s_)
        error_m = np.stack([mean_distances(hindcast, before.track) for hindcast in predict(self._observed(before))])
        error_m = error_m.reshape(-1, len(begins), len(windows))
        finite = np.isfinite(error_m)
        total = np.log(np.where(finite, error_m, 1.0) + _LEAST_LOG_M).sum(axis=1)
        return np.where(finite.any(axis=1), total / finite.sum(axis=1).clip(min=1), np.nan)

    def _predicted(
        self, windows: PredictionWindows, candidates: _Candidates, vector: Floats
    ) -> tuple[Floats, Floats]:
        """The tracks [N, H+1, 3] and their relative uncertainty [N, H], from models whose vectors have the mean
        ``vector``."""
        tracks, hindcast_m = self._average(candidates, self.weight_power_)
        minutes = candidates.minutes[0].copy()
        begins = self.domain(windows, tracks)
        outside = replace(begins, values=begins.values[:, :1]).outside.any(axis=1)
        unusual = (minutes > self.usual_.most) | outside
        if unusual.any():
            tracks[unusual], minutes[unusual] = self._averaged_by_minutes(
                windows.subset(unusual), tracks[unusual], candidates.subset(unusual), vector
            )
            hindcast_m = hindcast_m * np.exp(np.nan_to_num(minutes - candidates.minutes[0]))
        return tracks, self._uncertainty(hindcast_m, candidates.spread_m, minutes)

    def _averaged_by_minutes(
        self, windows: PredictionWindows, tracks: Floats, candidates: _Candidates, vector: Floats
    ) -> tuple[Floats, Floats]:
        """The mean of ``tracks`` [N, H+1, 3] with those of models that follow the measurements more closely, of
        constant velocity and of the reference, weighted by their hindcasts over the last minutes; and their
        mean log errors over these [N]. A predictor without hindcasts gets no weight beside one with them."""
        closer = [follow_closer(vector, more) for more in _CLOSER]

        def follow(observed: Observations) -> list[Floats]:
            runs = (run_observer(variant, self._model, observed) for variant in closer)
            return [states[..., :3] + waves for states, waves in runs]

        all_tracks = np.stack([tracks, *candidates.tracks[1:], *follow(self._observed(windows))])
        logs = np.concatenate([candidates.minutes, self._last_minutes(windows, follow)])
        finite = np.isfinite(logs)
        logs = np.where(finite, logs, self.usual_.mean)
        usable = np.asarray(np.isfinite(all_tracks).all(axis=(2, 3)) & (finite | ~finite.any(axis=0)))
        usable[0] |= ~usable.any(axis=0)
        weight = np.where(usable, np.exp(-_MINUTES_POWER * (logs - logs.min(axis=0))), 0.0)
        weight /= weight.sum(axis=0)
        return average_tracks(weight, all_tracks), (weight * logs).sum(axis=0)

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
        held = present_motion_held(states[:, 0], observations.control.shape[1])
        model = simulate_tracks(self._model, states[:, 0], observations.control, observations.wind)
        return np.asarray(np.stack([states[..., :3], held, model]) + waves), spread_m

    def _average(self, candidates: _Candidates, power: float) -> tuple[Floats, Floats]:
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
        return average_tracks(weight, candidates.tracks), np.einsum("wn,wn->n", weight, hindcast_m)

    def _uncertainty(self, hindcast_m: Floats, spread_m: Floats, minutes: Floats) -> Floats:
        """The relative uncertainty [N, H]: a third is proportional to the hindcast's error [N], another to the
        spread of the members' tracks [N, H], and all of it to the errors over the last minutes [N]."""
        usual_m = self.usual_.spread_m[: spread_m.shape[1]].clip(min=1e-6)
        by_hindcast = hindcast_m[:, None] / max(self.usual_.hindcast_m, 1e-6)
        return np.asarray((1.0 + by_hindcast + spread_m / usual_m) / 3.0 * self.usual_.day(minutes)[:, None])

    def predict(self, windows: PredictionWindows, reference: Floats) -> Floats:
        return self.predict_with_uncertainty(windows, reference)[0]

    def predict_with_uncertainty(self, windows: PredictionWindows, reference: Floats) -> tuple[Floats, Floats]:
        candidates = self._candidates(windows, self.vectors_)
        return self._predicted(windows, candidates, self.vectors_.mean(axis=0))

    def conformal_region(self, stopping: Examples) -> Floats:
        return self.region_

    def domain(self, windows: PredictionWindows, reference: Floats) -> DomainOfApplicability:
        return start_domain(windows, self.range_, DOMAIN_MARGIN)

    def state_dict(self) -> dict[str, Floats]:
        power = 0.0 if np.isinf(self.weight_power_) else self.weight_power_  # files cannot hold infinity
        usual = self.usual_
        fitted = {
            "vectors": self.vectors_, "covariance": self.covariance_, "range": self.range_, "region": self.region_,
            "trust": np.array([power, usual.hindcast_m, usual.mean, usual.deviation, usual.most]),
            "spread": usual.spread_m,
        }  # fmt: skip
        if self.gust_s_ is not None:
            fitted["gust"] = np.array([self.gust_s_])
        return fitted

    def load_state_dict(self, fitted: dict[str, Floats]) -> Self:
        numbers = len(parameter_names(self.plant.form)) if self.plant else 0
        members, seconds = max(len(fitted["vectors"]), 1), len(fitted["region"])
        require_shapes(fitted, {
            "vectors": (members, numbers), "covariance": (numbers, numbers), "trust": (5,),
            "range": (2, len(start_names(self.actuators))), "region": (seconds, 2), "spread": (seconds,),
            **({"gust": (1,)} if "gust" in fitted else {}),
        })  # fmt: skip
        self.vectors_, self.covariance_, self.range_ = (fitted[name] for name in ("vectors", "covariance", "range"))
        self.region_ = fitted["region"]
        self.hindcast_s_ = _hindcast_s(len(self.region_))
        power, hindcast_m, *minutes = map(float, fitted["trust"])
        self.usual_ = _Usual(hindcast_m, fitted["spread"], *minutes)
        self.weight_power_ = power or np.inf
        self.gust_s_ = float(fitted["gust"][0]) if "gust" in fitted else None
        return self


def _hindcast_s(horizon_s: int) -> int:
    """The length of the hindcasts over the last minutes, for predictions trained over this horizon."""
    return min(max(horizon_s, _EVERY_S), _LONGEST_S)


def starts_of(windows: PredictionWindows) -> Floats:
    """The quantities :func:`start_names` of the windows' starts [N, 1, names], or second by second [N, H,
    names] with any commands.

    Motions are means over the last seconds, so that single waves do not matter.
    """
    observations = observations_of(windows)
    recent = observations.past[:, :_RECENT_S]
    finite = np.isfinite(recent).all(axis=2, keepdims=True)
    mean = np.where(finite, recent, 0.0).sum(axis=1) / finite.sum(axis=1)
    control, angles = observations.control, angle_columns(windows.actuators)
    control = control if windows.commands is not None else control[:, :1]
    shafts = [column for column in range(control.shape[2]) if column not in angles]
    turned = [f(control[..., [column]]) for column in angles for f in (np.cos, np.sin)]
    motion = np.column_stack([mean[:, SURGE : YAW_RATE + 1], observations.wind[:, 0, 1]])
    repeated = np.repeat(motion[:, None], control.shape[1], axis=1)
    return np.concatenate([repeated, control[..., shafts], *turned], axis=-1)


def start_range(windows: PredictionWindows) -> Floats:
    """The least and the most of each of :func:`start_names` at the windows' starts [2, names]."""
    starts = starts_of(windows)
    return np.stack([starts.min(axis=(0, 1)), starts.max(axis=(0, 1))])


def start_domain(windows: PredictionWindows, trained: Floats, share: float) -> DomainOfApplicability:
    """The windows' starts compared with the :func:`start_range` in training, which they may exceed by a ``share``
    of it, or by the smallest margin."""
    kinds = [KINDS[actuator.kind] for actuator in windows.actuators]
    shafts = [most for kind in kinds for most, angle in zip(kind.alike, kind.angles, strict=True) if not angle]
    angles = [_LEAST_ANGLE_MARGIN] * (2 * len(angle_columns(windows.actuators)))
    low, high = trained
    margin = np.maximum(share * (high - low), np.array([*_LEAST_MARGIN, *shafts, *angles]))
    return DomainOfApplicability(start_names(windows.actuators), starts_of(windows), low, high, margin)


def _folds(leg: NDArray[np.str_], seed: int) -> NDArray[np.int64]:
    """The fold [N] of each window: whole groups, the longest first, each to the fold of the fewest windows."""
    names, where, counts = np.unique(leg, return_inverse=True, return_counts=True)
    members = min(MEMBERS, len(names))
    order = np.random.default_rng(seed).permutation(len(names))
    size, fold = np.zeros(members), np.empty(len(names), dtype=np.int64)
    for name in order[np.argsort(-counts[order], kind="stable")]:
        fold[name] = np.argmin(size)
        size[fold[name]] += counts[name]
    return fold[where]


def _own_share(windows: PredictionWindows) -> float:
    """The share of a window that no other overlaps: the median time between starts of a leg over the horizon."""
    starts_s = windows.start_ns / 1e9
    order = np.lexsort((starts_s, windows.leg))
    same_leg = windows.leg[order][1:] == windows.leg[order][:-1]
    apart_s = np.diff(starts_s[order])[same_leg]
    apart_s = apart_s[apart_s > 0.0]  # seconds of one window may come in two parts
    return float(min(1.0, np.median(apart_s) / windows.horizon_s)) if len(apart_s) else 1.0
