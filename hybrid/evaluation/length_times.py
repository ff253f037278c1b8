"""Errors of predictions after 1, 2 and 5 times L/V, the time in which a ship sails her own length.

The time in which a ship answers her helm goes with L/V (Nomoto et al. 1957), so that an error after so many seconds
says something else of a tanker than of a boat; after so many L/V it says the same of both. The windows have any
commands, under which the model predicts as they were recorded, as none are held for five lengths in a zigzag.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from math import ceil
from typing import Any

import numpy as np

from seatrial.acquisition.core.errors import DataShortageError
from seatrial.acquisition.core.quantities import Floats
from seatrial.analysis.windows.held import SecondBySecond
from seatrial.hybrid.calibrators.train import TrainedCalibrator
from seatrial.hybrid.prediction.baselines import constant_velocity
from seatrial.hybrid.prediction.dataset import dataset_of, within_model_range
from seatrial.hybrid.prediction.prediction_windows import PredictionWindows, difference_rad
from seatrial.hybrid.prediction.scores import distances
from seatrial.hybrid.vessel.plant import Plant
from seatrial.hybrid.vessel.sensors import HEADING, SURGE, SWAY

LENGTHS = (1, 2, 5)
_MOST_WINDOWS = 2000  # of all recordings: more take memory, and change no mean


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


def errors_by_length(
    tables: Mapping[str, SecondBySecond],
    judged: PredictionWindows,
    plant: Plant,
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
    rarest_s = ceil(sum(len(each.table) for each in tables.values()) / _MOST_WINDOWS)
    for most in range(len(LENGTHS), 0, -1) if speed_mps > 0.0 else ():
        lengths = LENGTHS[:most]
        seconds = tuple(max(1, round(each * length_m / speed_mps)) for each in lengths)
        try:
            dataset = dataset_of(
                tables, seconds[-1], max(seconds[0], rarest_s), any_commands=True, length_m=plant.length_overall_m
            )
            windows, reference = within_model_range(dataset.windows, plant)
        except DataShortageError:
            continue
        tracks = _tracks(windows, reference, trained)
        methods = {name: _errors(track, windows, seconds, length_m) for name, track in tracks.items()}
        return LengthErrors(length_m, speed_mps, lengths, seconds, len(windows), methods)
    return None


def _tracks(windows: PredictionWindows, reference: Floats, trained: TrainedCalibrator | None) -> dict[str, Floats]:
    tracks = {"constant_velocity": constant_velocity(windows), "reference": reference}
    if trained is None or not trained.calibrator.any_commands or windows.horizon_s > trained.horizon_s:
        return tracks
    return {**tracks, "hybrid": trained.predict_tracks(windows, reference).tracks}


def _errors(
    track: Floats, windows: PredictionWindows, seconds: tuple[int, ...], length_m: float
) -> tuple[LengthError, ...]:
    """The mean errors at each of some seconds."""
    distance_m = distances(track, windows.track).mean(axis=0)
    turned = difference_rad(track[:, 1:, HEADING], windows.track[:, 1:, HEADING])
    heading_deg = np.rad2deg(np.abs(turned)).mean(axis=0)
    return tuple(
        LengthError(
            float(distance_m[each - 1]), float(distance_m[each - 1]) / length_m, float(heading_deg[each - 1])
        )
        for each in seconds
    )
