"""The end of a prediction, large: both ends and the whole region are in sight, to scale."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.figure import Figure

from seatrial.hybrid.prediction.baselines import region_outlines
from seatrial.hybrid.report.plots import draw_prediction_end


@pytest.mark.parametrize("off_m", [0.0, 0.3, 40.0])
def test_ends_and_region_are_in_sight(off_m: float) -> None:
    seconds = np.arange(16.0)
    track = np.stack([5.0 * seconds, 2.0 * seconds, 0.0 * seconds], axis=1)
    region_m = np.linspace([0.1, 0.05], [1.5, 0.5], 15)
    axes = Figure().subplots()
    draw_prediction_end(axes, track + np.array([off_m, 0.0, 0.0]), {"hybrid": track}, region_m)
    every = np.concatenate(
        [region_outlines(track, region_m)[-1], track[-1:, :2], track[-1:, :2] + np.array([off_m, 0.0])]
    )
    for (low, high), values in zip((axes.get_ylim(), axes.get_xlim()), every.T, strict=True):
        assert low < values.min() < values.max() < high
    assert axes.get_aspect() == 1.0
    assert {"measured", "hybrid", "95 % region", "50 % region"} == set(axes.get_legend_handles_labels()[1])


def test_a_prediction_of_what_was_not_measured_has_its_region() -> None:
    track = np.stack([np.arange(11.0), np.zeros(11), np.zeros(11)], axis=1)
    axes = Figure().subplots()
    draw_prediction_end(axes, None, {"hybrid": track}, np.full((10, 2), 0.2))
    assert "measured" not in axes.get_legend_handles_labels()[1]
    assert np.ptp(axes.get_xlim()) == pytest.approx(np.ptp(axes.get_ylim()))
