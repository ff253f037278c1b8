"""The adaptive calibrator: several adapted models, each without some of the legs, and how far to trust them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from acquisition.core.arrays import Bools, Floats
from acquisition.core.channels import NAMES as CHANNELS
from acquisition.core.errors import DataShortageError
from acquisition.core.progress import Progress, part_of
from hybrid.calibrators.adaptive.adaptation import NAMES, Seen, followed, seen
from hybrid.calibrators.adaptive.fit import adapt, covariance_at
from hybrid.calibrators.calibrator import Calibrator, Examples, Ground
from hybrid.prediction.baselines import modelled, present_motion_held
from hybrid.prediction.prediction_windows import Horizons, joined_horizons
from hybrid.prediction.regions import HINDCAST_S, band_radius, blended, earlier, off_m
from hybrid.prediction.scores import distances
from hybrid.vessel.plant import Plant

if TYPE_CHECKING:
    from torch import Tensor

MEMBERS = 5
MOST_WINDOWS = 400
TRUSTS = (np.inf, 4.0, 2.0)
"""By which power of its error in the last seconds a way of predicting loses weight; infinite: ours alone."""
BEYOND = 0.5
"""How far past the range of the training, as a share of it, a start may lie before it counts as outside."""
ALIKE = np.array([0.5, 0.2, 0.01, 2.0, 0.3, 0.3, 10.0, 0.15, 0.15, 0.15, 0.15])
"""How far past it a start never counts as outside, however little the training varied: surge, sway [m/s], yaw rate
[rad/s], wind speed [m/s], revolutions [rev/s], tunnel [rpm], cosine and sine of the pods' angles (30 degrees from
dead ahead).
"""
START_NAMES = (
    "surge_mps", "sway_mps", "yaw_rate_radps", "wind_speed_mps", "port_rps", "starboard_rps", "tunnel_rpm",
    "port_angle_cos", "port_angle_sin", "starboard_angle_cos", "starboard_angle_sin",
)  # fmt: skip
"""What decides whether a start was trained on."""
_PERFECT = 0.1  # errors in the last seconds below this share of the usual one say nothing more
_UNKNOWN = 2.0  # how uncertain a window is whose past is not known, in usual errors
_RECENT_S = 5
_WAYS = 3  # ours, constant velocity, the reference


@dataclass(frozen=True, slots=True)
class _Ways:
    """What each way of predicting says of N windows: ``tracks`` [ways, N, H+1, 3] and ``before_m`` [ways, N], how
    far off it was over the last seconds; ours first.
    """

    tracks: Floats
    before_m: Floats


class Adaptive(Calibrator):
    """Adapted models on what was observed before the start, weighed against constant velocity and the reference.

    Each of :data:`MEMBERS` models is adapted without a share of the legs; on these it is judged, and from that
    follow the trust in it and the size of the 95 % regions. All members predict together.
    """

    method: ClassVar[str] = "adaptive"
    inputs: ClassVar[tuple[str, ...]] = CHANNELS

    def fit(self, training: Examples, stopping: Examples, progress: Progress = lambda share: None) -> Self:
        """Adapt to the windows of both parts; no leg is needed to stop by. Raises :class:`DataShortageError`."""
        horizons = joined_horizons([training[0], stopping[0]])
        fold = _folds(horizons.leg, self.seed)
        members = int(fold.max()) + 1
        if members < 2:
            raise DataShortageError("only one leg, which cannot be split", fix="give more or longer recordings")
        self.vectors_ = np.stack(
            [self._adapted(horizons, fold != member, member, part_of(progress, member, members))
             for member in range(members)]
        )  # fmt: skip
        self.covariance_ = self._covariance(horizons)
        starts = _starts(horizons)
        self.range_ = np.stack([starts.min(axis=0), starts.max(axis=0)])
        self.unseen_ = self._judge(horizons, fold)[len(training[0]) :]
        return self

    def unseen(self, stopping: Examples) -> Floats:
        return self.unseen_

    def _adapted(self, horizons: Horizons, chosen: Bools, member: int, progress: Progress) -> Floats:
        """The vector of one member."""
        windows = self._drawn(horizons, np.flatnonzero(chosen), member)
        return adapt(self._model, seen(windows), windows.track, _own_share(windows), progress)

    def _drawn(self, horizons: Horizons, rows: NDArray[np.int64], member: int) -> Horizons:
        """The windows of some rows, no more than :data:`MOST_WINDOWS`."""
        if len(rows) > MOST_WINDOWS:
            drawn = np.random.default_rng([self.seed, member]).choice(rows, MOST_WINDOWS, replace=False)
            rows = np.sort(drawn)
        return horizons.subset(rows)

    def _covariance(self, horizons: Horizons) -> Floats:
        """How well the data know the members' mean vector, [numbers, numbers]."""
        windows = self._drawn(horizons, np.arange(len(horizons)), len(self.vectors_))
        vector = self.vectors_.mean(axis=0)
        return covariance_at(vector, self._model, seen(windows), windows.track, _own_share(windows))

    @property
    def _model(self) -> Plant:
        if self.plant is None:
            raise ValueError("the adaptive calibrator needs the reference model")
        return self.plant

    def _judge(self, horizons: Horizons, fold: NDArray[np.int64]) -> Floats:
        """Trust, usual errors and regions, from the tracks [N, H+1, 3] of each leg by who was not adapted to it."""
        ways = _Ways(np.empty((_WAYS, *horizons.track.shape)), np.empty((_WAYS, len(horizons))))
        for member, vector in enumerate(self.vectors_):
            mine = fold == member
            part = self._ways(horizons.subset(mine), vector[None])
            ways.tracks[:, mine], ways.before_m[:, mine] = part.tracks, part.before_m
        self.usual_before_m_ = float(np.nanmedian(ways.before_m[0])) if np.isfinite(ways.before_m[0]).any() else 1.0
        errors = [np.nanmean(distances(self._weighed(ways, trust)[0], horizons.track)) for trust in TRUSTS]
        self.trust_ = TRUSTS[int(np.argmin(errors))]
        tracks, before_m = self._weighed(ways, self.trust_)
        self.region_ = band_radius(tracks, horizons.track, self._spread(before_m, horizons.horizon_s))
        return tracks

    def _ways(self, horizons: Horizons, vectors: Floats) -> _Ways:
        """Ours, constant velocity and the reference, on the windows and on the seconds before them."""
        before, acted = earlier(horizons, HINDCAST_S)
        now, then = seen(horizons), seen(before, acted)
        tracks, earlier_tracks = self._all_ways(vectors, now), self._all_ways(vectors, then)
        return _Ways(tracks, np.stack([off_m(each, before.track) for each in earlier_tracks]))

    def _all_ways(self, vectors: Floats, windows: Seen) -> Floats:
        """The tracks [ways, N, H+1, 3] from one observed state, the mean of what the members see, in one sea."""
        parts = [followed(vector, self._model, windows) for vector in vectors]
        states, waves = (np.mean(part, axis=0) for part in zip(*parts, strict=True))
        held = present_motion_held(states[:, 0], windows.control.shape[1])
        model = modelled(self._model, states[:, 0], windows.control, windows.wind)
        return np.asarray(np.stack([states[..., :3], held, model]) + waves)

    def _weighed(self, ways: _Ways, trust: float) -> tuple[Floats, Floats]:
        """One track a window [N, H+1, 3] of all ways, and the error of the last seconds [N] that goes with it.

        Windows in which our own model leaves its range are NaN.
        """
        known = np.isfinite(ways.before_m)
        weight = np.zeros_like(ways.before_m)
        weight[0] = 1.0
        if np.isfinite(trust):
            error = np.nan_to_num(ways.before_m, nan=np.inf) + _PERFECT * self.usual_before_m_
            weight = np.where(known[0], error**-trust, weight)
        weight = np.where(np.isfinite(ways.tracks).all(axis=(2, 3)) | (np.arange(_WAYS) == 0)[:, None], weight, 0.0)
        weight = weight / weight.sum(axis=0)
        before = np.where(known, ways.before_m, _UNKNOWN * self.usual_before_m_)
        return blended(weight, ways.tracks), np.einsum("wn,wn->n", weight, before)

    def _spread(self, before_m: Floats, horizon_s: int) -> Floats:
        """How uncertain windows are [N, H], one for a usual one: half of it goes with the last seconds' error."""
        share = 0.5 + 0.5 * before_m / max(self.usual_before_m_, 1e-6)
        return np.repeat(share[:, None], horizon_s, axis=1)

    def predict(self, horizons: Horizons, reference: Floats) -> Floats:
        return self.predict_with_spread(horizons, reference)[0]

    def spread(self, horizons: Horizons, reference: Floats) -> Floats:
        return self.predict_with_spread(horizons, reference)[1]

    def predict_with_spread(self, horizons: Horizons, reference: Floats) -> tuple[Floats, Floats]:
        tracks, before_m = self._weighed(self._ways(horizons, self.vectors_), self.trust_)
        return tracks, self._spread(before_m, horizons.horizon_s)

    def region(self, stopping: Examples) -> Floats:
        return self.region_

    def ground(self, horizons: Horizons, reference: Floats) -> Ground:
        low, high = self.range_
        margin = np.maximum(BEYOND * (high - low), ALIKE)
        return Ground(START_NAMES, _starts(horizons)[:, None], low, high, margin)

    def state(self) -> dict[str, Tensor]:
        import torch

        learned = {
            "vectors": self.vectors_, "covariance": self.covariance_, "range": self.range_, "region": self.region_,
            "trust": np.array([0.0 if np.isinf(self.trust_) else self.trust_, self.usual_before_m_]),
        }  # fmt: skip
        return {name: torch.from_numpy(np.ascontiguousarray(value)) for name, value in learned.items()}

    def restore(self, tensors: dict[str, Tensor]) -> Self:
        learned = {name: tensor.numpy() for name, tensor in tensors.items()}
        self.vectors_, self.covariance_, self.range_ = (
            learned[name] for name in ("vectors", "covariance", "range")
        )
        if self.vectors_.ndim != 2 or self.vectors_.shape[1] != len(NAMES):
            raise ValueError(f"vectors of {self.vectors_.shape[-1]} numbers, and this version has {len(NAMES)}")
        self.region_ = learned["region"]
        trust, self.usual_before_m_ = map(float, learned["trust"])
        self.trust_ = trust or np.inf
        return self


def _starts(horizons: Horizons) -> Floats:
    """What decides whether a start was trained on: speeds, wind speed, thrusters [N, 11]; angles as vectors.

    Means over the last seconds, so that a wave does not decide.
    """
    windows = seen(horizons)
    recent = windows.past[:, :_RECENT_S]
    known = np.isfinite(recent).all(axis=2, keepdims=True)
    mean = np.where(known, recent, 0.0).sum(axis=1) / known.sum(axis=1)
    control = windows.control[:, 0]
    angles = [f(control[:, column]) for column in (1, 3) for f in (np.cos, np.sin)]
    return np.column_stack([mean[:, 3:6], windows.wind[:, 1], control[:, [0, 2, 4]], *angles])


def _folds(leg: NDArray[np.str_], seed: int) -> NDArray[np.int64]:
    """The member [N] that goes without each window: whole legs, the longest first, to whoever lacks least."""
    names, where, counts = np.unique(leg, return_inverse=True, return_counts=True)
    members = min(MEMBERS, len(names))
    order = np.random.default_rng(seed).permutation(len(names))
    lacking, fold = np.zeros(members), np.empty(len(names), dtype=np.int64)
    for name in order[np.argsort(-counts[order], kind="stable")]:
        fold[name] = np.argmin(lacking)
        lacking[fold[name]] += counts[name]
    return fold[where]


def _own_share(windows: Horizons) -> float:
    """The share of a window that is its own: how far apart those of a leg start, over their length, at most one."""
    starts_s = windows.start_time.as_unit("ns").asi8 / 1e9
    order = np.lexsort((starts_s, windows.leg))
    same_leg = windows.leg[order][1:] == windows.leg[order][:-1]
    apart_s = np.diff(starts_s[order])[same_leg]
    apart_s = apart_s[apart_s > 0.0]  # seconds of one window may come in two parts
    return float(min(1.0, np.median(apart_s) / windows.horizon_s)) if len(apart_s) else 1.0
