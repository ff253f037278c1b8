"""A recording and a vessel file may list the same actuators in another order: what is computed is the same."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from seatrial.analysis.tables.table import table_actuators, with_order_of_actuators
from seatrial.analysis.windows.held import OneHertzTables
from seatrial.hybrid.diagnosis.log import log_of
from seatrial.hybrid.effects import vessel_plant
from seatrial.hybrid.evaluation.manoeuvre_indices import recorded_motion
from seatrial.hybrid.identification.fit import segments_of
from seatrial.hybrid.prediction.dataset import dataset_of, windows_within_model_range
from seatrial.hybrid.simulation.trial import sea_state_named, simulate_trial
from seatrial.hybrid.vessel.actuators import control_units
from seatrial.hybrid.vessel.files import load_vessel

SHIP = load_vessel("gunnerus_short")
TURNED = replace(SHIP, actuator=SHIP.actuator[::-1])
"""The same ship, whose file lists the tunnel thruster, which has one control, before the pods, which have two."""


@pytest.fixture(scope="module")
def table() -> pd.DataFrame:
    recorded, _ = simulate_trial(SHIP, sea_state_named("calm"), "zigzag", 150.0, 1.0)
    return recorded


def test_predictions_do_not_depend_on_the_order(table: pd.DataFrame) -> None:
    """From the filter's start, with the controls as they moved."""
    dataset = dataset_of({"trial": OneHertzTables(table, ())}, 15, 20, any_commands=True)
    expected, tracks = windows_within_model_range(dataset.windows, vessel_plant(SHIP))
    windows, turned_tracks = windows_within_model_range(dataset.windows, vessel_plant(TURNED))
    assert windows.actuators == TURNED.actuators
    np.testing.assert_allclose(windows.start, expected.start, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(turned_tracks, tracks, rtol=1e-9, atol=1e-9)


def test_controls_are_those_of_the_model(table: pd.DataFrame) -> None:
    """Each control of a fit, a replay and a diagnosis is the one that the model's actuator of that name has."""
    names = [f"{channel.name}" for actuator in TURNED.actuators for channel in actuator.channels]
    expected = table[names].to_numpy() * control_units(TURNED.actuators)
    plant = vessel_plant(TURNED)
    np.testing.assert_allclose(recorded_motion(table, plant).controls, expected, atol=1e-9)
    fitted, turned = (segments_of({"a": table}, vessel_plant(ship)).controls for ship in (SHIP, TURNED))
    np.testing.assert_array_equal(turned, fitted[..., [4, 2, 3, 0, 1]])
    logged, turned = (log_of([table], actuators=ship.actuators).controls for ship in (SHIP, TURNED))
    np.testing.assert_array_equal(turned, logged[..., [4, 2, 3, 0, 1]])


def test_recordings_of_one_ship_in_several_orders_are_one_log(table: pd.DataFrame) -> None:
    other = with_order_of_actuators(table, TURNED.actuators)
    assert table_actuators(other) == TURNED.actuators
    log = log_of([table, other])
    half = len(log) // 2
    np.testing.assert_array_equal(log.controls[:half], log.controls[half:])
