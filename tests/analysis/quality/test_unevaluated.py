"""What a check could not judge is told, and never passes for sound."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import seatrial as st
from tests.conftest import Command


def recording(folder: Path, seconds: float) -> Path:
    """A ship that turns, whose speeds are in knots and called metres per second."""
    time_s = np.arange(0.0, seconds, 0.5)
    heading = 0.5 * time_s
    velocity = 6.0 * np.exp(1j * np.deg2rad(heading))
    track = np.concatenate([[0.0], np.cumsum(0.25 * (velocity[1:] + velocity[:-1]))])
    motion = {
        "north_m": track.real, "east_m": track.imag, "heading_deg": heading % 360.0,
        "surge_mps": np.full(time_s.size, 6.0 / 0.514444), "sway_mps": 0.0, "yaw_rate_dps": 0.5,
    }  # fmt: skip
    index = pd.Timestamp("2026-05-17T12:00:00Z") + pd.to_timedelta(time_s, unit="s")
    st.write(pd.DataFrame(motion, index=index.rename("time")), folder / "trial.mcap")
    return folder / "trial.mcap"


@pytest.mark.parametrize(("seconds", "is_short"), [(100.0, True), (400.0, False)])
def test_a_motion_that_is_too_short_to_be_compared_is_told(
    seconds: float, is_short: bool, tmp_path: Path, command: Command
) -> None:
    path = recording(tmp_path, seconds)
    quality = st.check(path)
    assert bool(quality.unevaluated) == is_short
    assert any(finding.code == "speed_scale" for finding in quality.findings) == (not is_short)
    assert bool(json.loads(command("check", path, "--json").out)["unevaluated"]) == is_short
    shown = " ".join(command("check", path, "-o", tmp_path / "page").out.split())
    assert ("are not compared with each other" in shown) == is_short
    page = (tmp_path / "page" / "quality.html").read_text(encoding="utf-8")
    assert ("are not compared with each other" in page, "every check passed" in page) == (is_short, False)
