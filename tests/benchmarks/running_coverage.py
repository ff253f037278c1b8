"""What the corrected regions of ``seatrial watch`` hold on a recording, predicted from every second of it.

Run it as ``python -m tests.benchmarks.running_coverage RECORDING CALIBRATOR [HORIZON [PART]]`` with a calibrator
that was trained on another recording or part. The regions are taken as they are, and deliberately half and twice as
wide; each prediction is judged when its horizon has been measured, as aboard. With a calibrator of any commands all
seconds count, under the recorded ones. It prints and asserts nothing.
"""

from __future__ import annotations

import sys
from collections import deque
from pathlib import Path

import numpy as np

from seatrial.acquisition.core.quantities import Floats
from seatrial.analysis.tables.table import NANO, percent_of
from seatrial.hybrid.calibrators import PredictedTracks
from seatrial.hybrid.calibrators.own import load
from seatrial.hybrid.calibrators.predict import Prediction
from seatrial.hybrid.prediction.baselines import simulate_reference
from seatrial.hybrid.prediction.dataset import load_dataset
from seatrial.hybrid.prediction.window_sets import PredictionWindows
from seatrial.hybrid.twin import FILTER_REACH_S, RegionFactor, TrackError, track_error


def replay(
    windows: PredictionWindows, predicted: PredictedTracks, wrong_by: float, *, corrected: bool
) -> tuple[Floats, Floats]:
    """The share of seconds inside the region of each prediction [N], and the factors [N]."""
    region, waiting = RegionFactor(), deque[TrackError]()
    inside, factors = np.empty(len(windows)), np.empty(len(windows))
    delay_ns = (windows.horizon_s + FILTER_REACH_S) * NANO
    for row, at in enumerate(windows.start_time):
        while waiting and corrected and waiting[0].start_ns + delay_ns <= at.as_unit("ns").value:
            region = region.updated_by_error(waiting.popleft(), windows.horizon_s)
        region_m = wrong_by * np.vstack([np.zeros(2), predicted.region_m[row]])
        prediction = region.widen_prediction(Prediction(at, "hybrid", predicted.tracks[row], region_m, None))
        waiting.append(track_error(prediction, windows.track[row], thrusters_moved=False))
        inside[row], factors[row] = waiting[-1].inside_band or 0.0, region.factor
    return inside, factors


def main(recording: str, calibrator: str, horizon: str = "30", part: str = "0..100") -> None:
    """Predict all, and replay it with and without the correction."""
    trained = load(Path(calibrator))
    dataset = load_dataset(
        [Path(recording)], int(horizon), 1, percent_of(part), any_commands=trained.calibrator.any_commands,
        length_m=trained.plant.length_overall_m,
    )  # fmt: skip
    windows = dataset.windows.subset(dataset.windows.is_complete)
    tracks = simulate_reference(windows, trained.plant)
    inside_range = np.isfinite(tracks).all(axis=(1, 2))
    windows, tracks = windows.subset(inside_range), tracks[inside_range]
    predicted = trained.predict_tracks(windows, tracks)
    print(f"{recording}, {len(windows)} predictions of {horizon} s by {calibrator}: share of seconds inside [%]")
    print("regions      as they are   corrected   first half   second half   factor at the end (least to most)")
    for name, wrong_by in (("half as wide", 0.5), ("as trained", 1.0), ("twice as wide", 2.0)):
        plain, _ = replay(windows, predicted, wrong_by, corrected=False)
        inside, factors = replay(windows, predicted, wrong_by, corrected=True)
        first, second = np.array_split(inside, 2)
        shares = "".join(f"{100.0 * each.mean():13.1f}" for each in (plain, inside, first, second))
        print(f"{name:14}{shares}   {factors[-1]:.2f} ({factors.min():.2f} to {factors.max():.2f})")


if __name__ == "__main__":
    main(*sys.argv[1:])
