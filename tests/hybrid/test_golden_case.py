"""The reference model against recordings that others made of the same ship."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from seatrial.hybrid.vessel.dynamics import simulate
from seatrial.hybrid.vessel.plant import Plant, pack
from tests.force_calls import azimuth_force

pytestmark = pytest.mark.shared


@pytest.mark.parametrize(("horizon_s", "limit_m"), [(15, 0.06), (30, 0.15)])
def test_the_simulated_turn_is_followed(horizon_s: int, limit_m: float, plant: Plant, shared_data: Path) -> None:
    """Started from every fifth second of the log and run with the model's own thrust."""
    log = pd.read_csv(shared_data / "gunnerus_vico_short_turn" / "turn_angle20_revs100.csv")
    heading = np.unwrap(np.deg2rad(log["heading"]))
    speeds = [log["surge_vel"], log["sway_vel"], np.deg2rad(log["yaw_vel"])]
    states = np.column_stack([log["N"], log["E"], heading, *speeds])
    firsts = np.arange(0, len(log) - horizon_s, 5)
    order = np.tile([100 / 60, np.deg2rad(20), 100 / 60, np.deg2rad(20), 0.0], (horizon_s, 1))
    runs = simulate(plant, states[firsts], order, np.zeros((horizon_s, 2)), 1.0)
    error = (runs - states[firsts[:, np.newaxis] + np.arange(horizon_s + 1)])[:, 1:, :2]
    assert np.hypot(error[..., 0], error[..., 1]).mean() <= limit_m


def test_the_thruster_fits_the_makers_table(plant: Plant, shared_data: Path) -> None:
    """Root mean square errors of the fit along and across the pod."""
    table = pd.read_csv(shared_data / "gunnerus_thruster_table" / "thruster_table.csv")
    u, v, _, angle_deg, rpm, fx, fy = table.to_numpy().T
    packed = pack(plant.replaced(port_x_m=0.0, port_y_m=0.0))[0]
    cosine, sine = np.cos(np.deg2rad(angle_deg)), np.sin(np.deg2rad(angle_deg))
    rows = zip(cosine, sine, rpm / 60.0, u, v, strict=True)
    first = 0
    ours = np.array([azimuth_force(packed, first, np.array([[c, s, n, 1.0]]), a, b, 0.0) for c, s, n, a, b in rows])
    x, y = ours[:, 0] - fx, ours[:, 1] - fy
    along, across = x * cosine + y * sine, y * cosine - x * sine
    assert np.sqrt(np.mean(along**2)) == pytest.approx(2.6e3, abs=50)
    assert np.sqrt(np.mean(across**2)) == pytest.approx(2.8e3, abs=50)
