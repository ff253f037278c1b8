"""``seatrial validate``: every method on unseen windows, in one table, and how reliable the measured track is.

Besides the track used for prediction there are three: the measured positions, never rebuilt by a repair; dead
reckoning, the speed over ground along the heading integrated from second 0; and all sensors combined by the
Kalman smoother. Each starts at the smoother's position at second 0. The noise floor of each is the error that a
perfect prediction would show. It comes from a parametric bootstrap (Efron and Tibshirani 1993, section 6.5): the
smoothed motion, measured again with white noise at the recording's levels, goes through the same steps, and the
resulting tracks are compared with that motion. A further difference between the first two may be due to either
(wandering positions, a wrong speed scale), so it is included in every floor.

Errors are also stated after 1, 2 and 5 times L/V, the time in which a ship sails its own length. The time in which
a ship answers its helm goes with L/V (Nomoto et al. 1957), so that an error after so many seconds says something
else of a tanker than of a boat; after so many L/V it says the same of both. The windows have any commands, under
which the model predicts as they were recorded, as none are held for five lengths in a zigzag.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from math import ceil
from typing import Annotated, Any

import numpy as np
import pandas as pd
from pydantic import Field

from seatrial.acquisition.core import result, ship
from seatrial.acquisition.core.errors import DataShortageError, InputError, Progress, SeatrialError
from seatrial.acquisition.core.quantities import Bools, Floats, Strings, integrate, to_earth
from seatrial.analysis.estimation.smoother import smooth
from seatrial.analysis.quality import situations
from seatrial.analysis.quality.motion.findings import LIMITS
from seatrial.analysis.windows.held import OneHertzTables
from seatrial.hybrid.calibrators import PredictedTracks, TrainedCalibrator
from seatrial.hybrid.evaluation.manoeuvre_indices import IndexComparisons
from seatrial.hybrid.prediction import baselines, kalman_filter, window_sets
from seatrial.hybrid.prediction.dataset import Dataset, WindowSource, dataset_of, windows_within_model_range
from seatrial.hybrid.vessel.black_box import MotionModel
from seatrial.hybrid.vessel.sensors import STATE_UNITS, SURGE, SWAY

TRUTHS = ("position", "dead_reckoning", "joined")
UNSEEN_SHARE = float(np.hypot(LIMITS["speed_factor"].least, LIMITS["heading_offset_rad"].least))
"""Errors of speed and heading, as a share of the distance sailed, that ``seatrial check`` would not find."""
LENGTHS = (1, 2, 5)
_MOST_WINDOWS = 2000  # of all recordings: more take memory, and change no mean


@dataclass(frozen=True, slots=True, repr=False)
class Validation(result.ModelResult):
    """Scores and tracks by method, on the same windows for all, from starts as they were known at second 0.

    ``two_sided`` has the scores from the starts as they are known afterwards, by the seconds to either side.

    ``outside`` counts the windows left out because the reference model left its range in them, ``jumps`` those in
    which the positions jump, ``not_free`` by situation those in which the ship is held or towed. With a calibrator,
    ``outside_domain`` [N] marks the windows outside its domain of applicability, where the fallback predicts unless
    it extrapolates; ``source`` [N] names who predicted; ``region_m`` [N, H, 2] are the semi-axes of its 95 %
    regions.
    ``truths`` judges the methods by each sensor, where the windows have their tracks. ``by_length`` are the errors
    after so many L/V, ``indices`` the measured indices of the manoeuvres beside the model's; None where not asked.
    """

    windows: window_sets.PredictionWindows
    tracks: dict[str, Floats]
    scores: dict[str, baselines.Score]
    two_sided: dict[str, baselines.Score]
    outside: int
    coverage_95: float | None
    outside_domain: Bools | None = None
    region_m: Floats | None = None
    source: Strings | None = None
    truths: ErrorsByTruth | None = None
    jumps: int = 0
    not_free: dict[str, int] = field(default_factory=dict)
    by_length: LengthErrors | None = None
    indices: IndexComparisons | None = None
    view = "seatrial.hybrid.report.text:validation_view"
    frame = "methods"
    drawing = "seatrial.hybrid.report.plots:draw_validation"

    @property
    def measurements(self) -> str:
        """A remark if positions and speeds disagree."""
        return self.truths.remark if self.truths else ""

    @property
    def reduction(self) -> float | None:
        """1 - hybrid / reference of the mean distance; None without a calibrator."""
        if "hybrid" not in self.scores:
            return None
        return 1.0 - self.scores["hybrid"].mean_distance_m / self.scores["reference"].mean_distance_m

    @property
    def fallback(self) -> dict[str, int] | None:
        """The number of windows predicted by the fallback, by its main baseline; None without a calibrator."""
        if self.source is None:
            return None
        names, times = np.unique(self.source[self.source != "hybrid"], return_counts=True)
        return dict(zip(map(str, names), map(int, times), strict=True))

    def as_dict(self) -> dict[str, Any]:
        """The JSON object of ``seatrial validate --json``."""
        middle_m = None if self.region_m is None else np.median(self.region_m, axis=0)
        return {
            **self.remarks,
            "horizon_s": self.windows.horizon_s,
            "windows": len(self.windows),
            "outside_model_range": self.outside,
            "position_jump": self.jumps,
            **{kind: self.not_free.get(kind, 0) for kind in situations.KINDS},
            "outside_training_range": None if self.outside_domain is None else int(self.outside_domain.sum()),
            "methods": baselines.scores_json(self.scores | self.two_sided),
            "reduction": self.reduction,
            "coverage_95": self.coverage_95,
            **{
                name: None if axis_m is None else axis_m.tolist()
                for name, axis_m in baselines.region_bands(middle_m).items()
            },
            "fallback": self.fallback,
            "truths": result.to_json(self.truths),
            "by_length": None if self.by_length is None else self.by_length.as_json(self.windows.horizon_s),
            **(self.indices or IndexComparisons()).as_json(),
        }


def refuse_training_data(sources: tuple[WindowSource, ...], trained: TrainedCalibrator) -> None:
    """Raise :class:`InputError` if a recording was used for training."""
    trained_on = [source for source in sources if any(map(source.overlaps, trained.sources))]
    if trained_on:
        raise InputError(
            "took part in the training of this calibrator",
            where=", ".join(str(source.path) for source in trained_on),
            fix="validate on other recordings or another --part, or use --allow-seen",
        )


def validate_predictions(
    dataset: Dataset, plant: MotionModel, trained: TrainedCalibrator | None = None
) -> Validation:
    """Score every baseline, and the calibrator if there is one, on the windows of ``dataset``.

    Raises :class:`InputError` if the calibrator was trained for a shorter horizon, or on held controls while
    the windows have any commands.
    """
    if trained is not None:
        trained.refuse_horizon(dataset.windows.horizon_s)
        if dataset.windows.commands is not None:
            trained.refuse_commands()
    windows, reference_tracks = windows_within_model_range(dataset.windows, plant)
    tracks, hybrid = _tracks_by_method(windows, reference_tracks, trained)
    two_sided = window_sets.replace_by_two_sided_starts(windows)
    two_sided_tracks, _ = _tracks_by_method(two_sided, baselines.simulate_reference(two_sided, plant), trained)
    coverage = None
    if hybrid is not None:
        coverage = float(
            (baselines.relative_distances(hybrid.tracks, windows.track, hybrid.region_m) <= 1.0).mean()
        )
    return Validation(
        windows=windows,
        tracks=tracks,
        scores={name: baselines.score(track, windows.track) for name, track in tracks.items()},
        two_sided={
            f"{name}{baselines.TWO_SIDED}": baselines.score(track, windows.track)
            for name, track in two_sided_tracks.items()
        },
        outside=len(dataset.windows) - len(windows),
        coverage_95=coverage,
        outside_domain=None if hybrid is None else hybrid.outside_domain,
        region_m=None if hybrid is None else hybrid.region_m,
        source=None if hybrid is None else hybrid.source,
        jumps=dataset.dropped.get("position_jump", 0),
        not_free={kind: dataset.dropped.get(kind, 0) for kind in situations.KINDS},
        truths=errors_by_truth(windows, {name: truth_distances(track, windows) for name, track in tracks.items()}),
    )


def _tracks_by_method(
    windows: window_sets.PredictionWindows, reference_tracks: Floats, trained: TrainedCalibrator | None
) -> tuple[dict[str, Floats], PredictedTracks | None]:
    """The tracks by method, and the calibrator's with their regions if there is one."""
    tracks = baselines.untrained_tracks(windows, reference_tracks)
    if trained is None:
        return tracks, None
    hybrid = trained.predict_tracks(windows, reference_tracks)
    if trained.data_driven is not None:
        tracks["data_driven"] = trained.data_driven.predict(windows, reference_tracks)
    return {**tracks, "hybrid": hybrid.tracks}, hybrid


@dataclass(frozen=True, slots=True)
class ByTruth:
    """Mean distances [m] to one truth over the ``windows`` in which it is known: of a perfect prediction, and
    of each method."""

    windows: int
    floor_m: baselines.Interval
    methods: dict[str, baselines.Interval]


@dataclass(frozen=True, slots=True)
class ErrorsByTruth:
    """The errors of methods by each of :data:`TRUTHS`, over ``horizon_s``.

    ``apart_m`` is the mean distance between positions and dead reckoning, ``explained_m`` the part of it that
    noise and undetectable errors explain.
    """

    horizon_s: Annotated[int, Field(exclude=True)]
    apart_m: baselines.Interval
    explained_m: float
    by: dict[str, ByTruth]

    @property
    def remark(self) -> str:
        """A remark if positions and speeds disagree, else empty."""
        if not _clearly_exceeds(self.apart_m, self.explained_m):
            return ""
        floor_m = min(reference.floor_m.value for reference in self.by.values())
        return (
            f"positions and speeds disagree by {self.apart_m.value:.2f} m over {self.horizon_s} s, and their noise "
            f"leaves {self.explained_m:.2f} m: an error below {floor_m:.2f} m may be the sensors'"
        )


def _clearly_exceeds(apart_m: baselines.Interval, explained_m: float) -> bool:
    """Whether a mean distance exceeds what explains it; significantly, unless there is only one leg."""
    return bool((apart_m.low if np.isfinite(apart_m.low) else apart_m.value) > explained_m)


def add_truth_tracks(
    windows: window_sets.PredictionWindows,
    tables: Mapping[str, pd.DataFrame],
    progress: Progress = lambda share: None,
    *,
    rebuilt: bool = False,
) -> window_sets.PredictionWindows:
    """The windows with their tracks by each of :data:`TRUTHS`, and with the errors of simulated ones.

    ``tables`` are the recordings at 1 Hz by trial, as measured. If the windows' positions were ``rebuilt``,
    they differ from the measured ones, and every truth is shifted to the start of the windows' tracks. NaN
    where a sensor has a gap or jumps further than the ship can move.
    """
    shape = (len(windows), len(TRUTHS), windows.horizon_s + 1, 2)
    truths, errors = np.full((2, *shape), np.nan)
    start_ns, random = windows.start_ns, np.random.default_rng(0)
    channels, gap = list(ship.POSE_AND_VELOCITY), np.full(6, np.nan)  # a row of NaN, for the row number -1
    for number, (trial, table) in enumerate(tables.items()):
        progress(number / len(tables))
        in_trial = np.flatnonzero(windows.trial == trial)
        try:
            motion = smooth(table, 1.0)
            # The simulated ship moves as smoothed, at positions integrated from that and so without receiver jumps.
            surge, sway = motion.states["surge_mps"].to_numpy(), motion.states["sway_mps"].to_numpy()
            velocity = to_earth(surge, sway, np.deg2rad(motion.states["heading_deg"].to_numpy()))
            north, east = (integrate(np.nan_to_num(component), 1.0) for component in velocity)
            true_motion = motion.states[channels].assign(north_m=north, east_m=east)
            levels = motion.noise
            heading_deg, turn_dps = np.rad2deg(levels.heading_rad), np.rad2deg(levels.yaw_rate_radps)
            sigma = np.repeat([levels.position_m, heading_deg, levels.speed_mps, turn_dps], (2, 1, 2, 1))
            remeasured = true_motion + sigma * random.standard_normal(true_motion.shape)
            joined = smooth(remeasured, 1.0, levels=levels).states
        except SeatrialError:  # too short to estimate its noise
            continue
        rows = window_sets.row_numbers_after_starts(table, start_ns[in_trial], np.arange(windows.horizon_s + 1))
        measured, smoothed, true, remeasured_si, rejoined = (
            np.vstack([series.reindex(table.index)[channels].to_numpy(dtype=float) * STATE_UNITS, gap])[rows]
            for series in (table, motion.states, true_motion, remeasured, joined)
        )
        tracks, simulated = (
            truth_tracks(measured, smoothed[..., :2]),
            truth_tracks(remeasured_si, rejoined[..., :2]),
        )
        if rebuilt:
            tracks += windows.track[in_trial][:, None, :1, :2] - smoothed[:, None, :1, :2]
            simulated += true[:, None, :1, :2] - rejoined[:, None, :1, :2]
        truths[in_trial], errors[in_trial] = tracks, simulated - true[:, None, :, :2]
    return replace(windows, truths=truths, truth_errors=errors)


def truth_tracks(measured: Floats, joined: Floats) -> Floats:
    """The tracks [N, K, H+1, 2] by each of :data:`TRUTHS`, from ``measured`` [N, H+1, 6] and the ``joined``
    positions of all sensors [N, H+1, 2]. NaN where positions jump further than the ship can move."""
    velocity = np.stack(to_earth(measured[..., 3], measured[..., 4], measured[..., 2]), axis=-1)
    steps = 0.5 * (velocity[:, 1:] + velocity[:, :-1])
    displacement = np.concatenate([np.zeros_like(steps[:, :1]), np.cumsum(steps, axis=1)], axis=1)
    tracks = np.stack([measured[..., :2], joined[:, :1] + displacement, joined], axis=1)
    leap_m = np.linalg.norm(np.diff(tracks, axis=2) - steps[:, None], axis=-1).max(axis=2)
    return np.where((leap_m < kalman_filter.LEAP_M)[..., None, None], tracks, np.nan)


def truth_distances(predicted: Floats, windows: window_sets.PredictionWindows) -> Floats:
    """The mean distance [N, K] of tracks [N, H+1, 2 or 3] to each truth; K is 0 if there are none."""
    truths = np.empty((len(windows), 0, *predicted.shape[1:2], 2)) if windows.truths is None else windows.truths
    gap = predicted[:, None, 1:, :2] - truths[:, :, 1:]
    return np.asarray(np.hypot(gap[..., 0], gap[..., 1]).mean(axis=2))


def errors_by_truth(
    windows: window_sets.PredictionWindows, distance_m: Mapping[str, Floats], seed: int = 0
) -> ErrorsByTruth | None:
    """The errors of methods by each truth, from mean distances [N, K] of :func:`truth_distances`, with
    intervals over legs. None if windows have no truths."""
    if windows.truths is None or windows.truth_errors is None:
        return None
    valid = np.asarray(np.isfinite(windows.truths + windows.truth_errors).all(axis=(2, 3)))
    both_valid = np.asarray(valid[:, :2].all(axis=1))
    if not both_valid.any():
        return None
    position, reckoned = np.moveaxis(windows.truths[both_valid][:, :2], 1, 0)
    errors_m = np.linalg.norm(windows.truth_errors[:, :, 1:], axis=-1).mean(axis=2)
    apart_m = baselines.LegBootstrap.of(windows.leg[both_valid], seed).mean(
        baselines.distances(position, reckoned).mean(axis=1)
    )
    noise_m = float(baselines.distances(*np.moveaxis(windows.truth_errors[both_valid][:, :2], 1, 0)).mean())
    way_m = float(np.linalg.norm(reckoned[:, 1:] - reckoned[:, :1], axis=-1).mean())
    explained_m = float(np.hypot(noise_m, UNSEEN_SHARE * way_m))
    sensor_error_m = (
        np.sqrt(max(apart_m.value**2 - noise_m**2, 0.0)) if _clearly_exceeds(apart_m, explained_m) else 0.0
    )
    by = {}
    for column, name in enumerate(TRUTHS):
        column_valid = valid[:, column]
        if column_valid.any():
            legs = baselines.LegBootstrap.of(windows.leg[column_valid], seed)
            methods = {method: legs.mean(means_m[column_valid, column]) for method, means_m in distance_m.items()}
            noise = legs.mean(errors_m[column_valid, column])
            floor_m = baselines.Interval(
                *(float(np.hypot(bound, sensor_error_m)) for bound in (noise.value, noise.low, noise.high))
            )
            by[name] = ByTruth(int(column_valid.sum()), floor_m, methods)
    return ErrorsByTruth(windows.horizon_s, apart_m, explained_m, by)


@dataclass(frozen=True, slots=True)
class LengthError:
    """The mean error of a method at a time: distance [m], in ship lengths, and heading [deg]."""

    distance_m: float
    distance_lengths: float
    heading_error_deg: float


@dataclass(frozen=True, slots=True)
class LengthErrors:
    """The errors after each of ``seconds``, which are ``lengths`` times L/V, by method, over the same ``windows``.

    ``length_m`` is the length between perpendiculars and ``speed_mps`` the median speed over ground of the windows.
    """

    length_m: float
    speed_mps: float
    lengths: tuple[int, ...]
    seconds: tuple[int, ...]
    windows: int
    methods: Mapping[str, tuple[LengthError, ...]]

    @property
    def length_time_s(self) -> float:
        """L/V [s]."""
        return self.length_m / self.speed_mps

    def as_json(self, horizon_s: int) -> dict[str, Any]:
        """With the keys of the contract; ``horizon_lengths`` is the horizon of the other figures in L/V."""
        return {
            "length_m": self.length_m, "speed_mps": self.speed_mps, "length_time_s": self.length_time_s,
            "horizon_lengths": horizon_s / self.length_time_s, "windows": self.windows,
            "errors": [
                {"lengths": lengths, "seconds": seconds,
                 "methods": {name: asdict(errors[i]) for name, errors in self.methods.items()}}
                for i, (lengths, seconds) in enumerate(zip(self.lengths, self.seconds, strict=True))
            ],
        }  # fmt: skip


def errors_after_lengths(
    tables: Mapping[str, OneHertzTables],
    judged: window_sets.PredictionWindows,
    plant: MotionModel,
    trained: TrainedCalibrator | None = None,
) -> LengthErrors | None:
    """The errors after so many L/V of the reference, constant velocity, and a calibrator that predicts as far.

    Parameters
    ----------
    tables
        The recordings at 1 Hz, by trial.
    judged
        The windows whose median speed over ground is V [m/s].
    plant
        The reference model; L is its length between perpendiculars [m].
    trained
        A calibrator, judged if it takes any commands and its horizon is long enough.

    Returns
    -------
    LengthErrors or None
        At whole seconds, one at least. The longest times are left out where no recording lasts as long; None where
        none does.
    """
    length_m = plant.length_between_perpendiculars_m
    speed_mps = float(np.median(np.hypot(judged.start[:, SURGE], judged.start[:, SWAY])))
    rarest_s = ceil(sum(len(recorded.table) for recorded in tables.values()) / _MOST_WINDOWS)
    for count in range(len(LENGTHS), 0, -1) if speed_mps > 0.0 else ():
        lengths = LENGTHS[:count]
        seconds = tuple(max(1, round(multiple * length_m / speed_mps)) for multiple in lengths)
        try:
            dataset = dataset_of(
                tables, seconds[-1], max(seconds[0], rarest_s), any_commands=True, length_m=plant.length_overall_m
            )
            windows, reference = windows_within_model_range(dataset.windows, plant)
        except DataShortageError:
            continue
        tracks = {"constant_velocity": baselines.constant_velocity(windows), "reference": reference}
        if trained is not None and trained.calibrator.any_commands and windows.horizon_s <= trained.horizon_s:
            tracks["hybrid"] = trained.predict_tracks(windows, reference).tracks
        methods = {}
        for name, track in tracks.items():
            distance_m = baselines.distances(track, windows.track).mean(axis=0)
            heading_deg = baselines.heading_errors_deg(track, windows.track).mean(axis=0)
            methods[name] = tuple(
                LengthError(float(distance_m[i]), float(distance_m[i]) / length_m, float(heading_deg[i]))
                for i in np.array(seconds) - 1
            )
        return LengthErrors(length_m, speed_mps, lengths, seconds, len(windows), methods)
    return None
