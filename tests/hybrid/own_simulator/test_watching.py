"""Live predictions with a simulator of another make, as `seatrial watch` makes them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import seatrial as st
from seatrial.hybrid.twin import predict_now, recording_at_rest


def test_prediction_beside_the_recorder_is_the_simulators(shipyard: Path) -> None:
    """Of a ship at rest with standing propeller: it stays where it is."""
    model = st.load_simulator(f"{shipyard}/sailer.py:Sailer")
    forecast = predict_now(recording_at_rest(200.0, model.layout), 30, model)
    assert forecast.prediction.method == "reference"
    np.testing.assert_allclose(forecast.prediction.track[:, :2], 0.0, atol=1e-6)
