"""What a person sees of a twin: where the ship will be from where she is, and what the errors were."""

from __future__ import annotations

from collections import deque
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
from rich.console import Console

from seatrial.hybrid.calibrators.predict import Prediction
from seatrial.hybrid.twin import Display, RegionFactor, RunningError, Statistics, TrackError


def picture(prediction: Prediction | None, error: TrackError | None, width: int = 100) -> str:
    errors = RunningError()
    if error is not None:
        errors._last.append(error)
    twin: Any = SimpleNamespace(
        statistics=Statistics(made=12),
        follower=SimpleNamespace(part_path=Path("/out/bay_part00002.mcap")),
        last=None if prediction is None else SimpleNamespace(prediction=prediction),
        last_error=error,
        errors=errors,
        region=RegionFactor(0.7),
    )
    twin.statistics.latency_s.append(0.25)
    console = Console(width=width, height=30)
    with console.capture() as shown:
        console.print(Display(twin, deque([("warning", "no prediction: tunnel_rpm missing")])))
    return shown.get()


def eastward(band: bool) -> Prediction:
    """Heading east at 2 m/s, setting 0.5 m/s to starboard, which is south."""
    seconds = np.arange(31.0)
    track = np.column_stack([100.0 - 0.5 * seconds, 2.0 * seconds, np.full(31, np.pi / 2)])
    at = pd.Timestamp("2026-06-01T08:00:05Z")
    region_m = np.column_stack([0.1 * seconds, 0.05 * seconds]) if band else None
    return Prediction(at, "hybrid", track, region_m, None, outside_domain=not band)


def test_the_track_is_told_ahead_and_to_starboard() -> None:
    shown = picture(eastward(band=True), None)
    assert "12 predictions  bay_part00002.mcap" in shown
    assert "hybrid from 08:00:05Z" in shown
    assert [line.split() for line in shown.splitlines() if line.strip().startswith("30 ")] == [
        ["30", "60.0", "15.0", "90.0", "3.0"]
    ]
    assert "band 0.7 times as wide as the calibrator's, which was wider than needed" in shown
    assert "latency 0.25 s" in shown
    assert "tunnel_rpm missing" in shown
    assert "none judged" in shown


def test_errors_say_whether_a_thruster_moved_and_fit_a_narrow_window() -> None:
    still = TrackError(0, "hybrid", False, 1.5, 3.25, 2.0, -2.5, 4.0, 0.9)
    shown = picture(eastward(band=False), still, width=80)
    assert "outside the calibrator's training range" in shown
    assert "then: 3.2 m off at the end, 1.5 m on the way" in shown
    assert "1 judged, 0 left out" in shown
    assert "…" not in "".join(line for line in shown.splitlines() if "left out" in line)
    moved = TrackError(0, "hybrid", True, 1.5, 3.25, 2.0, -2.5, 4.0, 0.9)
    assert "a thruster moved: not in the means" in picture(None, moved)
    assert "none judged, 1 left out" in picture(None, moved)
