"""Held windows of ships that steer with rudders, nozzles and pitch, and of a model with a fast shaft."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from seatrial.acquisition.core.ship import (
    Actuator,
    Actuators,
    actuators_as_text,
    control_names,
    trial_channel_names,
)
from seatrial.analysis.tables.resample import resample
from seatrial.analysis.windows.held import REASONS, held_windows, sort_of, steady_mask
from tests.analysis.conftest import table_at
from tests.analysis.rudder_ships import MODEL, SINGLE, TWIN, Ship, sail, turn

MANY: Actuators = (
    Actuator("main", "controllable_propeller"), Actuator("helm", "rudder"), Actuator("jet", "waterjet"),
    Actuator("bow", "tunnel"), Actuator("pod", "azimuth"),
)  # fmt: skip


def held_table(actuators: Actuators, seconds: int = 120, **moved: np.ndarray) -> pd.DataFrame:
    """Everything held, but for the columns of ``moved``."""
    columns = {name: np.full(seconds, 10.0) for name in trial_channel_names(actuators)}
    table = table_at(np.arange(seconds), columns | moved)
    table.attrs["trial"] = {"actuators": actuators_as_text(actuators)}
    return table


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("helm_angle_deg", "rudder_moved"), ("jet_angle_deg", "nozzle_moved"),
        ("main_pitch_percent", "pitch_moved"),
        ("main_rpm", "rpm_moved"), ("jet_rpm", "rpm_moved"), ("bow_rpm", "tunnel_moved"),
        ("pod_angle_deg", "azimuth_moved"),
    ],
)  # fmt: skip
def test_what_moved_is_said_in_the_words_of_its_kind(name: str, reason: str) -> None:
    assert sort_of(name, MANY) == reason.removesuffix("_moved").replace("rpm", "shaft")
    ramp = np.clip(np.arange(120.0) - 60.0, 0.0, 30.0)
    found = held_windows(held_table(MANY, **{name: 40.0 + ramp}))
    assert set(found.dropped) == {reason}
    assert 0 < found.kept == found.candidates - found.dropped[reason]
    assert held_windows(held_table(MANY)).dropped == {}


def test_a_rudder_amidships_has_no_idle_band() -> None:
    """A shaft may flicker about zero; a rudder that goes from 10 deg to port to 10 deg to starboard steers."""
    swing = 10.0 * np.sign(np.sin(np.arange(120) / 5.0))
    assert held_windows(held_table(SINGLE, rudder_angle_deg=swing)).kept == 0
    assert held_windows(held_table(SINGLE, propeller_rpm=0.3 * swing)).kept > 0


@pytest.mark.parametrize(("rpm", "noise"), [(100.0, 1.0), (600.0, 4.0), (1200.0, 8.0)])
def test_a_held_shaft_is_held_at_any_usual_speed_and_a_ramp_is_not(rpm: float, noise: float) -> None:
    random = np.random.default_rng(3)
    values = rpm + noise * random.standard_normal(1200)
    assert steady_mask("propeller_rpm", values, 16, 5, SINGLE).mean() > 0.99
    ramp = np.linspace(0.7 * rpm, rpm, 60)
    assert not steady_mask("propeller_rpm", ramp, 16, 5, SINGLE).any()
    step = np.repeat([rpm, 0.95 * rpm], 8)
    assert not steady_mask("propeller_rpm", step, 16, 5, SINGLE).any()


@pytest.mark.parametrize("ship", [Ship(), replace(Ship(), actuators=TWIN), MODEL])
def test_windows_of_a_turn_are_those_with_the_rudder_still(ship: Ship) -> None:
    rpm = 600.0 if ship is MODEL else 120.0
    table = resample(sail(ship, turn(20.0, rpm), 200.0), 1.0)
    found = held_windows(table, trial="turn")
    seconds = found.rows["second"] == 0
    starts = (found.rows.loc[seconds, "start"] - table.index[0]).dt.total_seconds().to_numpy()
    assert set(found.dropped) == {"rudder_moved"}
    assert not np.any((starts > 45.0) & (starts < 60.0))
    assert {0.0, 40.0, 80.0, 150.0} <= set(starts)
    assert set(control_names(ship.actuators)) <= set(found.rows.columns)
    assert found.leg_count == 2


def test_the_words_of_r_v_gunnerus_are_what_they_were() -> None:
    assert REASONS[:5] == ("gap", "missing_data", "position_jump", "ship_held", "ship_towed")
    assert REASONS[5:8] == ("azimuth_moved", "rpm_moved", "tunnel_moved")
