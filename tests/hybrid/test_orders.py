"""Feedback that is dead: what its order does through the drive, and what is said."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from seatrial.acquisition.core.trial import Trial
from seatrial.acquisition.recording.reader import read_recording
from seatrial.acquisition.recording.writer import write_table
from seatrial.hybrid.simulation.trial import SimulationNoise, simulate_trial
from seatrial.hybrid.vessel.actuators import Drive
from seatrial.hybrid.vessel.files import load_vessel
from seatrial.hybrid.workflows import checked_tables, follow_orders, idle_angles, replace_dead_feedback_by_orders

VESSEL = load_vessel("gunnerus_short")


def steps(values: list[float], seconds: float = 60.0, rate_hz: float = 5.0) -> pd.DataFrame:
    """Orders that hold for a while each, in a table."""
    order = np.repeat(values, round(seconds * rate_hz / len(values)))
    index = pd.date_range("2026-01-01", periods=len(order), freq=f"{1.0 / rate_hz}s", tz="UTC", name="time")
    return pd.DataFrame({"port_order_angle_deg": order}, index)


def test_a_drive_follows_its_order_with_its_lag_rate_and_limit() -> None:
    """A lag is its time constant behind at the end of a step; a rate takes its time; a limit is never passed."""
    table = steps([0.0, 10.0])
    lagging = follow_orders(table, "port_order_angle_deg", Drive(2.0), circular=True)
    assert lagging[150 + 10] == pytest.approx(10.0 * (1.0 - np.exp(-1.0)), abs=0.5)
    slow = follow_orders(table, "port_order_angle_deg", Drive(0.0, rate=2.0), circular=True)
    assert slow[150 + 15] == pytest.approx(6.0, abs=0.3)
    assert slow[-1] == pytest.approx(10.0)
    assert follow_orders(
        table, "port_order_angle_deg", Drive(0.5, limit=4.0), circular=True
    ).max() == pytest.approx(4.0)


def test_an_angle_is_driven_the_shorter_way_round() -> None:
    """From 170 to -170 deg through astern, not through ahead."""
    driven = follow_orders(steps([170.0, -170.0]), "port_order_angle_deg", Drive(1.0), circular=True)
    assert np.abs(driven).min() > 169.0


@pytest.fixture(scope="module")
def table() -> pd.DataFrame:
    """A trial whose orders are known: what a drive without lag would show."""
    sailed = simulate_trial(VESSEL, "calm", "zigzag", 300.0, 4.0, 1, noise=SimulationNoise().scaled(0.0))[0]
    return sailed.assign(port_order_angle_deg=sailed["port_angle_deg"])


@pytest.mark.parametrize("dead", [np.nan, 3.0])
def test_an_order_takes_the_place_of_dead_feedback(table: pd.DataFrame, dead: float) -> None:
    """It is late by the drive's lag, and said; living feedback stays, and so does a dead one without an order."""
    (found,), said = replace_dead_feedback_by_orders([table.assign(port_angle_deg=dead)], VESSEL)
    lag_s = VESSEL.actuator[0].azimuth_lag_s  # type: ignore[union-attr]
    (text,) = said
    assert text.startswith("port_angle_deg")
    assert f"a lag of {lag_s:g} s" in text
    late = table["port_angle_deg"].shift(round(4.0 * lag_s))
    assert (found["port_angle_deg"] - late).abs().median() < 0.5
    assert replace_dead_feedback_by_orders([table], VESSEL)[1] == ()
    resting = table.assign(port_angle_deg=dead, port_order_angle_deg=3.0)
    assert len(replace_dead_feedback_by_orders([resting], VESSEL)[1]) == (1 if np.isnan(dead) else 0)
    without = table.drop(columns="port_order_angle_deg").assign(port_angle_deg=dead)
    assert replace_dead_feedback_by_orders([without], VESSEL)[1] == ()


def test_an_angle_that_stands_still_while_its_like_moves_is_said(table: pd.DataFrame, tmp_path: Path) -> None:
    assert idle_angles(table, VESSEL.actuators) == ()
    table = table.drop(columns="port_order_angle_deg")
    (text,) = idle_angles(table.assign(port_angle_deg=3.0), VESSEL.actuators)
    assert text.startswith("port_angle_deg stands at 3 throughout although others like it move")
    both = idle_angles(table.assign(port_angle_deg=0.0, starboard_angle_deg=0.0), VESSEL.actuators)
    assert len(both) == 2
    held = table.assign(port_angle_deg=20.0, starboard_angle_deg=20.0)
    assert idle_angles(held, VESSEL.actuators) == ()  # a turning circle
    path = tmp_path / "trial.mcap"
    write_table(table.assign(port_angle_deg=3.0), path, Trial("trial", VESSEL.name), source="simulated")
    checked = checked_tables(read_recording(path))
    assert any(each == text for each in checked.remarks)
