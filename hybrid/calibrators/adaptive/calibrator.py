"""The adaptive calibrator: an ensemble of adapted models, cross-validated by legs and weighted by hindcasts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from acquisition.core.actuators import Actuators
from acquisition.core.arrays import Bools, Floats
from acquisition.core.channels import trial_names
from acquisition.core.errors import DataShortageError
from acquisition.core.progress import Progress, part_of
from hybrid.calibrators.adaptive.adaptation import (
    gust_decay_s,
    observations_of,
    parameter_names,
    run_observer,
)
from hybrid.calibrators.adaptive.fit import adapt, covariance_at
from hybrid.calibrators.calibrator import Calibrator, DomainOfApplicability, Examples
from hybrid.prediction.baselines import (
    HINDCAST_S,
    average_tracks,
    conformal_radius,
    present_motion_held,
    simulate_tracks,
)
from hybrid.prediction.kalman_filter import Observations
from hybrid.prediction.prediction_windows import (
    PredictionWindows,
    clear_of,
    concatenate_windows,
    hindcast_windows,
    unlike_groups,
)
from hybrid.prediction.scores import distances, mean_distances
from hybrid.vessel.actuators import KINDS, angle_columns, control_labels
from hybrid.vessel.plant import Plant
from hybrid.vessel.sensors import SURGE, YAW_RATE

if TYPE_CHECKING:
    from torch import Tensor

MEMBERS = 5
MOST_WINDOWS = 400
WEIGHT_POWERS = (np.inf, 4.0, 2.0)
"""The weight of a candidate falls with such a power of its hindcast's error; with infinity only our own counts."""
DOMAIN_MARGIN = 0.5
"""How far past the range of the training a start may lie inside the domain, as a share of that range."""
_LEAST_MARGIN = (0.5, 0.2, 0.01, 2.0)
_LEAST_ANGLE_MARGIN = 0.15
"""The least such margin, however little the training varied: surge, sway [m/s], yaw rate [rad/s], wind speed [m/s],
cosine and sine of the actuators' angles (30 degrees from dead ahead); of revolutions, their kind says it.
"""


def start_names(actuators: Actuators) -> tuple[str, ...]:
    """The quantities of a start that span the domain of applicability, of a ship with these actuators."""
    labels, angles = control_labels(actuators), angle_columns(actuators)
    shafts = (name for column, name in enumerate(labels) if column not in angles)
    turned = (f"{labels[column]}_{part}" for column in angles for part in ("cos", "sin"))
    return ("surge_mps", "sway_mps", "yaw_rate_radps", "wind_speed_mps", *shafts, *turned)


def _least_margin(actuators: Actuators) -> Floats:
    """The least margin of each of :func:`start_names`."""
    kinds = [KINDS[each.kind] for each in actuators]
    shafts = [most for kind in kinds for most, angle in zip(kind.alike, kind.angles, strict=True) if not angle]
    return np.array([*_LEAST_MARGIN, *shafts, *[_LEAST_ANGLE_MARGIN] * (2 * len(angle_columns(actuators)))])


_LEAST_RATIO = 0.1  # hindcast errors below this share of the median one say nothing more
_UNKNOWN_RATIO = 2.0  # the hindcast error of a window whose past is not known, in median ones
_RECENT_S = 5
_CANDIDATES = 3  # the adapted model, constant velocity, the reference


@dataclass(frozen=True, slots=True)
class _Candidates:
    """The candidate predictions of N windows, the adapted model's first: ``tracks`` [3, N, H+1, 3] and the mean
    errors ``hindcast_m`` [3, N] of their hindcasts in metres; ``spread_m`` [N, H] is how far the members' tracks
    lie apart.
    """

    tracks: Floats
    hindcast_m: Floats
    spread_m: Floats


class AdaptiveCalibrator(Calibrator):
    """An ensemble of adapted models, averaged with constant velocity and the reference by hindcast errors.

    Each of :data:`MEMBERS` models is fitted without a share of the legs (cross-validation). On these follow the
    power by which hindcast errors weigh the candidates and the radius of the 95 % regions. All members predict
    together.
    """

    method: ClassVar[str] = "adaptive"
    gust_s_: float | None
    median_spread_m_: Floats | None

    def labels(self, actuators: Actuators) -> tuple[str, ...]:
        return trial_names(actuators)

    def fit(self, training: Examples, stopping: Examples, progress: Progress = lambda share: None) -> Self:
        """Fit to the windows of both parts; no legs are needed for stopping. Raises :class:`DataShortageError`."""
        windows = concatenate_windows([training[0], stopping[0]])
        self.any_commands = windows.commands is not None
        self.gust_s_ = gust_decay_s(windows) if self.any_commands else None
        self.median_spread_m_ = None
        fold = _folds(unlike_groups(windows), self.seed)
        members = int(fold.max()) + 1
        if members < 2:
            raise DataShortageError("only one leg, which cannot be split", fix="give more or longer recordings")
        self.vectors_ = np.stack(
            [
                self._fit_member(
                    windows, clear_of(windows, fold != member, fold == member), member,
                    part_of(progress, member, members),
                )
                for member in range(members)
            ]
        )  # fmt: skip
        self.covariance_ = self._covariance(windows)
        starts = _starts(windows)
        self.range_ = np.stack([starts.min(axis=(0, 1)), starts.max(axis=(0, 1))])
        self.out_of_sample_ = self._cross_validate(windows, fold)[len(training[0]) :]
        return self

    def out_of_sample_tracks(self, stopping: Examples) -> Floats:
        return self.out_of_sample_

    def _fit_member(self, windows: PredictionWindows, chosen: Bools, member: int, progress: Progress) -> Floats:
        """The parameter vector of one member."""
        drawn = self._draw(windows, np.flatnonzero(chosen), member)
        return adapt(self._model, self._observed(drawn), drawn.track, _own_share(drawn), progress)

    def _observed(self, windows: PredictionWindows) -> Observations:
        """What the observer is given; how gusts go on was learned with any commands only."""
        return observations_of(windows, self.gust_s_)

    def _draw(self, windows: PredictionWindows, rows: NDArray[np.int64], member: int) -> PredictionWindows:
        """The windows of some rows, no more than :data:`MOST_WINDOWS`."""
        if len(rows) > MOST_WINDOWS:
            drawn = np.random.default_rng([self.seed, member]).choice(rows, MOST_WINDOWS, replace=False)
            rows = np.sort(drawn)
        return windows.subset(rows)

    def _covariance(self, windows: PredictionWindows) -> Floats:
        """The covariance of the members' mean vector, [parameters, parameters]."""
        drawn = self._draw(windows, np.arange(len(windows)), len(self.vectors_))
        vector = self.vectors_.mean(axis=0)
        return covariance_at(vector, self._model, self._observed(drawn), drawn.track, _own_share(drawn))

    @property
    def _model(self) -> Plant:
        if self.plant is None:
            raise ValueError("the adaptive calibrator needs the reference model")
        return self.plant

    def _cross_validate(self, windows: PredictionWindows, fold: NDArray[np.int64]) -> Floats:
        """Fit weights and regions; the tracks [N, H+1, 3] of each window by the member not fitted to it."""
        spread_m = self._member_states(self.vectors_, self._observed(windows))[2]
        if self.any_commands:
            self.median_spread_m_ = np.nanmedian(spread_m, axis=0)
        candidates = _Candidates(
            np.empty((_CANDIDATES, *windows.track.shape)), np.empty((_CANDIDATES, len(windows))), spread_m
        )
        for member, vector in enumerate(self.vectors_):
            mine = fold == member
            part = self._candidates(windows.subset(mine), vector[None])
            candidates.tracks[:, mine], candidates.hindcast_m[:, mine] = part.tracks, part.hindcast_m
        own_m = candidates.hindcast_m[0]
        self.median_hindcast_m_ = float(np.nanmedian(own_m)) if np.isfinite(own_m).any() else 1.0
        errors = [
            np.nanmean(distances(self._average(candidates, power)[0], windows.track)) for power in WEIGHT_POWERS
        ]
        self.weight_power_ = WEIGHT_POWERS[int(np.argmin(errors))]
        tracks, hindcast_m = self._average(candidates, self.weight_power_)
        uncertainty = self._uncertainty(hindcast_m, spread_m)
        self.radius_ = conformal_radius(tracks, windows.track, uncertainty)
        return tracks

    def _candidates(self, windows: PredictionWindows, vectors: Floats) -> _Candidates:
        """The candidates' tracks over the windows, and their errors over the seconds before."""
        before = hindcast_windows(windows, HINDCAST_S)
        tracks, spread_m = self._candidate_tracks(vectors, self._observed(windows))
        hindcasts, _ = self._candidate_tracks(vectors, self._observed(before))
        return _Candidates(tracks, np.stack([mean_distances(each, before.track) for each in hindcasts]), spread_m)

    def _member_states(self, vectors: Floats, observations: Observations) -> tuple[Floats, Floats, Floats]:
        """The members' mean states [N, H+1, 6] and motion in waves [N, H+1, 3], and how far their tracks lie apart
        [N, H]: their standard deviation [m].
        """
        parts = [run_observer(vector, self._model, observations) for vector in vectors]
        states, waves = (np.stack(part) for part in zip(*parts, strict=True))
        spread_m = np.linalg.norm(np.std(states[:, :, 1:, :2], axis=0), axis=-1)
        return states.mean(axis=0), waves.mean(axis=0), spread_m

    def _candidate_tracks(self, vectors: Floats, observations: Observations) -> tuple[Floats, Floats]:
        """The candidates' tracks [3, N, H+1, 3] from the members' mean observed state, in one motion in waves, and
        the members' spread [N, H].
        """
        states, waves, spread_m = self._member_states(vectors, observations)
        held = present_motion_held(states[:, 0], observations.control.shape[1])
        model = simulate_tracks(self._model, states[:, 0], observations.control, observations.wind)
        return np.asarray(np.stack([states[..., :3], held, model]) + waves), spread_m

    def _average(self, candidates: _Candidates, power: float) -> tuple[Floats, Floats]:
        """The candidates' weighted mean [N, H+1, 3] and the hindcast error [N] that goes with it in metres.

        Windows in which the adapted model leaves its range are NaN.
        """
        known = np.isfinite(candidates.hindcast_m)
        weight = np.zeros_like(candidates.hindcast_m)
        weight[0] = 1.0
        if np.isfinite(power):
            error_m = np.nan_to_num(candidates.hindcast_m, nan=np.inf) + _LEAST_RATIO * self.median_hindcast_m_
            weight = np.where(known[0], error_m**-power, weight)
        usable = np.isfinite(candidates.tracks).all(axis=(2, 3)) | (np.arange(_CANDIDATES) == 0)[:, None]
        weight = np.where(usable, weight, 0.0)
        weight = weight / weight.sum(axis=0)
        hindcast_m = np.where(known, candidates.hindcast_m, _UNKNOWN_RATIO * self.median_hindcast_m_)
        return average_tracks(weight, candidates.tracks), np.einsum("wn,wn->n", weight, hindcast_m)

    def _uncertainty(self, hindcast_m: Floats, spread_m: Floats) -> Floats:
        """The relative uncertainty [N, H], one for the median hindcast error; half of it grows with that error [N].

        With any commands a third does, and another third with how far the members' tracks lie apart [N, H].
        """
        horizon_s = spread_m.shape[1]
        by_hindcast = np.repeat(hindcast_m[:, None], horizon_s, axis=1) / max(self.median_hindcast_m_, 1e-6)
        if self.median_spread_m_ is None:
            return 0.5 + 0.5 * by_hindcast
        usual_m = self.median_spread_m_[:horizon_s].clip(min=1e-6)
        return np.asarray((1.0 + by_hindcast + spread_m / usual_m) / 3.0)

    def predict(self, windows: PredictionWindows, reference: Floats) -> Floats:
        return self.predict_with_uncertainty(windows, reference)[0]

    def predict_with_uncertainty(self, windows: PredictionWindows, reference: Floats) -> tuple[Floats, Floats]:
        candidates = self._candidates(windows, self.vectors_)
        tracks, hindcast_m = self._average(candidates, self.weight_power_)
        return tracks, self._uncertainty(hindcast_m, candidates.spread_m)

    def conformal_radius(self, stopping: Examples) -> Floats:
        return self.radius_

    def domain(self, windows: PredictionWindows, reference: Floats) -> DomainOfApplicability:
        low, high = self.range_
        margin = np.maximum(DOMAIN_MARGIN * (high - low), _least_margin(windows.actuators))
        return DomainOfApplicability(start_names(windows.actuators), _starts(windows), low, high, margin)

    def state_dict(self) -> dict[str, Tensor]:
        import torch

        power = 0.0 if np.isinf(self.weight_power_) else self.weight_power_  # no infinity in a file
        fitted = {
            "vectors": self.vectors_, "covariance": self.covariance_, "range": self.range_, "region": self.radius_,
            "trust": np.array([power, self.median_hindcast_m_]),
        }  # fmt: skip
        if self.gust_s_ is not None and self.median_spread_m_ is not None:
            fitted["any_commands"] = np.array([self.gust_s_, *self.median_spread_m_])
        return {name: torch.from_numpy(np.ascontiguousarray(value)) for name, value in fitted.items()}

    def load_state_dict(self, tensors: dict[str, Tensor]) -> Self:
        fitted = {name: tensor.numpy() for name, tensor in tensors.items()}
        self.vectors_, self.covariance_, self.range_ = (fitted[name] for name in ("vectors", "covariance", "range"))
        numbers = len(parameter_names(self.plant.form)) if self.plant else 0
        if self.vectors_.ndim != 2 or self.vectors_.shape[1] != numbers:
            raise ValueError(f"vectors of {self.vectors_.shape[-1]} numbers, and this version has {numbers}")
        self.radius_ = fitted["region"]
        power, self.median_hindcast_m_ = map(float, fitted["trust"])
        self.weight_power_ = power or np.inf
        self.gust_s_ = self.median_spread_m_ = None
        if "any_commands" in fitted:
            self.gust_s_, self.median_spread_m_ = float(fitted["any_commands"][0]), fitted["any_commands"][1:]
        return self


def _starts(windows: PredictionWindows) -> Floats:
    """The quantities :func:`start_names` of the windows' starts [N, 1, names], second by second [N, H, names] where
    the commands may be any.

    Motions are means over the last seconds, so that single waves do not decide.
    """
    observations = observations_of(windows)
    recent = observations.past[:, :_RECENT_S]
    known = np.isfinite(recent).all(axis=2, keepdims=True)
    mean = np.where(known, recent, 0.0).sum(axis=1) / known.sum(axis=1)
    control, angles = observations.control, angle_columns(windows.actuators)
    control = control if windows.commands is not None else control[:, :1]
    shafts = [column for column in range(control.shape[2]) if column not in angles]
    turned = [f(control[..., [column]]) for column in angles for f in (np.cos, np.sin)]
    motion = np.column_stack([mean[:, SURGE : YAW_RATE + 1], observations.wind[:, 0, 1]])
    repeated = np.repeat(motion[:, None], control.shape[1], axis=1)
    return np.concatenate([repeated, control[..., shafts], *turned], axis=-1)


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
    starts_s = windows.start_time.as_unit("ns").asi8 / 1e9
    order = np.lexsort((starts_s, windows.leg))
    same_leg = windows.leg[order][1:] == windows.leg[order][:-1]
    apart_s = np.diff(starts_s[order])[same_leg]
    apart_s = apart_s[apart_s > 0.0]  # seconds of one window may come in two parts
    return float(min(1.0, np.median(apart_s) / windows.horizon_s)) if len(apart_s) else 1.0
