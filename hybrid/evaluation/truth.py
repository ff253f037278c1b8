"""The true track by each sensor alone: what predictions are compared with, and how reliable it is.

Besides the track used for prediction there are three: the measured positions, never rebuilt by a repair; dead
reckoning, the speed over ground along the heading integrated from second 0; and all sensors combined by the
Kalman smoother. Each starts at the smoother's position at second 0.

The noise floor of each is the error that a perfect prediction would show. It comes from a parametric bootstrap
(Efron and Tibshirani 1993, section 6.5): the smoothed motion, measured again with white noise at the
recording's levels, goes through the same steps, and the resulting tracks are compared with that motion. A
further difference between the first two may be due to either (wandering positions, a wrong speed scale), so it
is included in every floor.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
import pandas as pd
from pydantic import Field

from seatrial.acquisition.core.errors import Progress, SeatrialError
from seatrial.acquisition.core.quantities import Floats, Ints, integrate, to_earth
from seatrial.acquisition.core.ship import POSE_AND_VELOCITY
from seatrial.analysis.estimation.motion_model import NoiseLevels
from seatrial.analysis.estimation.smoother import smooth
from seatrial.analysis.quality.motion.findings import LIMITS
from seatrial.hybrid.prediction.kalman_filter import LEAP_M
from seatrial.hybrid.prediction.prediction_windows import PredictionWindows, row_numbers
from seatrial.hybrid.prediction.scores import Interval, LegBootstrap, distances
from seatrial.hybrid.vessel.channels import STATE_UNITS

TRUTHS = ("position", "dead_reckoning", "joined")

UNSEEN_SHARE = float(np.hypot(LIMITS["speed_factor"].least, LIMITS["heading_offset_rad"].least))
"""Errors of speed and heading, as a share of the distance sailed, that ``seatrial check`` would not find."""


@dataclass(frozen=True, slots=True)
class ByTruth:
    """Mean distances [m] to one truth over the ``windows`` in which it is known: of a perfect prediction, and
    of each method."""

    windows: int
    floor_m: Interval
    methods: dict[str, Interval]


@dataclass(frozen=True, slots=True)
class Truths:
    """The errors of methods by each of :data:`TRUTHS`, over ``horizon_s``.

    ``apart_m`` is the mean distance between positions and dead reckoning, ``explained_m`` the part of it that
    noise and undetectable errors explain.
    """

    horizon_s: Annotated[int, Field(exclude=True)]
    apart_m: Interval
    explained_m: float
    by: dict[str, ByTruth]

    @property
    def remark(self) -> str:
        """A remark if positions and speeds disagree, else empty."""
        if not _clearly(self.apart_m, self.explained_m):
            return ""
        floor_m = min(each.floor_m.value for each in self.by.values())
        return (
            f"positions and speeds disagree by {self.apart_m.value:.2f} m over {self.horizon_s} s, and their noise "
            f"leaves {self.explained_m:.2f} m: an error below {floor_m:.2f} m may be the sensors'"
        )


def _clearly(apart_m: Interval, explained_m: float) -> bool:
    """Whether a mean distance exceeds what explains it; significantly, unless there is only one leg."""
    return bool((apart_m.low if np.isfinite(apart_m.low) else apart_m.value) > explained_m)


def with_truths(
    windows: PredictionWindows,
    tables: Mapping[str, pd.DataFrame],
    progress: Progress = lambda share: None,
    *,
    rebuilt: bool = False,
) -> PredictionWindows:
    """The windows with their tracks by each of :data:`TRUTHS`, and with the errors of simulated ones.

    ``tables`` are the recordings at 1 Hz by trial, as measured. If the windows' positions were ``rebuilt``,
    they differ from the measured ones, and every truth is shifted to the start of the windows' tracks. NaN
    where a sensor has a gap or jumps further than the ship can move.
    """
    shape = (len(windows), len(TRUTHS), windows.horizon_s + 1, 2)
    truths, errors = np.full((2, *shape), np.nan)
    start_ns, random = windows.start_ns, np.random.default_rng(0)
    for number, (trial, table) in enumerate(tables.items()):
        progress(number / len(tables))
        mine = np.flatnonzero(windows.trial == trial)
        try:
            motion = smooth(table, 1.0)
            really = sailed(motion.states)
            again = measured_anew(really, motion.noise, random)
            joined = smooth(again, 1.0, levels=motion.noise).states
        except SeatrialError:  # too short to estimate its noise
            continue
        rows = row_numbers(table, start_ns[mine], np.arange(windows.horizon_s + 1))
        measured, smoothed, true, anew, rejoined = (
            _si(each.reindex(table.index), rows) for each in (table, motion.states, really, again, joined)
        )
        found, simulated = truth_tracks(measured, smoothed[..., :2]), truth_tracks(anew, rejoined[..., :2])
        if rebuilt:
            found += windows.track[mine][:, None, :1, :2] - smoothed[:, None, :1, :2]
            simulated += true[:, None, :1, :2] - rejoined[:, None, :1, :2]
        truths[mine], errors[mine] = found, simulated - true[:, None, :, :2]
    return replace(windows, truths=truths, truth_errors=errors)


def sailed(motion: pd.DataFrame) -> pd.DataFrame:
    """A smoothed motion with positions integrated from its speeds and headings, and so without receiver jumps."""
    surge, sway = motion["surge_mps"].to_numpy(), motion["sway_mps"].to_numpy()
    velocity = to_earth(surge, sway, np.deg2rad(motion["heading_deg"].to_numpy()))
    north, east = (integrate(np.nan_to_num(each), 1.0) for each in velocity)
    return motion[list(POSE_AND_VELOCITY)].assign(north_m=north, east_m=east)


def measured_anew(motion: pd.DataFrame, levels: NoiseLevels, random: np.random.Generator) -> pd.DataFrame:
    """A motion as recorded by sensors with white noise at these levels."""
    position, speed, turn = levels.position_m, levels.speed_mps, np.rad2deg(levels.yaw_rate_radps)
    sigma = np.array([position, position, np.rad2deg(levels.heading_rad), speed, speed, turn])
    return motion + sigma * random.standard_normal(motion.shape)


def truth_tracks(measured: Floats, joined: Floats) -> Floats:
    """The tracks [N, K, H+1, 2] by each of :data:`TRUTHS`, from ``measured`` [N, H+1, 6] and the ``joined``
    positions of all sensors [N, H+1, 2]. NaN where positions jump further than the ship can move."""
    velocity = np.stack(to_earth(measured[..., 3], measured[..., 4], measured[..., 2]), axis=-1)
    steps = 0.5 * (velocity[:, 1:] + velocity[:, :-1])
    way = np.concatenate([np.zeros_like(steps[:, :1]), np.cumsum(steps, axis=1)], axis=1)
    tracks = np.stack([measured[..., :2], joined[:, :1] + way, joined], axis=1)
    leap_m = np.linalg.norm(np.diff(tracks, axis=2) - steps[:, None], axis=-1).max(axis=2)
    return np.where((leap_m < LEAP_M)[..., None, None], tracks, np.nan)


def truth_distances(predicted: Floats, windows: PredictionWindows) -> Floats:
    """The mean distance [N, K] of tracks [N, H+1, 2 or 3] to each truth; K is 0 if there are none."""
    truths = np.empty((len(windows), 0, *predicted.shape[1:2], 2)) if windows.truths is None else windows.truths
    apart = predicted[:, None, 1:, :2] - truths[:, :, 1:]
    return np.asarray(np.hypot(apart[..., 0], apart[..., 1]).mean(axis=2))


def judged_by_truths(windows: PredictionWindows, distance_m: Mapping[str, Floats], seed: int = 0) -> Truths | None:
    """The errors of methods by each truth, from mean distances [N, K] of :func:`truth_distances`, with
    intervals over legs. None if windows have no truths."""
    if windows.truths is None or windows.truth_errors is None:
        return None
    known = np.asarray(np.isfinite(windows.truths + windows.truth_errors).all(axis=(2, 3)))
    both = np.asarray(known[:, :2].all(axis=1))
    if not both.any():
        return None
    position, reckoned = np.moveaxis(windows.truths[both][:, :2], 1, 0)
    errors_m = np.linalg.norm(windows.truth_errors[:, :, 1:], axis=-1).mean(axis=2)
    apart_m = LegBootstrap.of(windows.leg[both], seed).mean(distances(position, reckoned).mean(axis=1))
    noise_m = float(distances(*np.moveaxis(windows.truth_errors[both][:, :2], 1, 0)).mean())
    way_m = float(np.linalg.norm(reckoned[:, 1:] - reckoned[:, :1], axis=-1).mean())
    explained_m = float(np.hypot(noise_m, UNSEEN_SHARE * way_m))
    beyond_m = np.sqrt(max(apart_m.value**2 - noise_m**2, 0.0)) if _clearly(apart_m, explained_m) else 0.0
    by = {}
    for column, name in enumerate(TRUTHS):
        some = known[:, column]
        if some.any():
            legs = LegBootstrap.of(windows.leg[some], seed)
            methods = {method: legs.mean(each[some, column]) for method, each in distance_m.items()}
            noise = legs.mean(errors_m[some, column])
            floor_m = Interval(*(float(np.hypot(each, beyond_m)) for each in (noise.value, noise.low, noise.high)))
            by[name] = ByTruth(int(some.sum()), floor_m, methods)
    return Truths(windows.horizon_s, apart_m, explained_m, by)


def _si(table: pd.DataFrame, rows: Ints) -> Floats:
    """Pose and velocity in SI at these rows [N, H+1, 6]; NaN at -1. The heading may be unwrapped."""
    values = table[list(POSE_AND_VELOCITY)].to_numpy(dtype=float) * STATE_UNITS
    return np.asarray(np.vstack([values, np.full(6, np.nan)])[rows])
