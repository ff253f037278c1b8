"""A tanker in a towing tank: zigzags of one basin predict the circle of another, with the tank declared."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import seatrial as st
from seatrial.analysis.windows.held import named_recordings
from seatrial.hybrid.identification.fit import SURROUNDINGS
from seatrial.hybrid.identification.identify import identify_with_folds
from seatrial.hybrid.simulation.vessel_check import approach_at_speed, trial_ship_at_rpm, turning_circle_test
from seatrial.hybrid.vessel.files import Vessel, load_vessel
from seatrial.hybrid.workflows import usable_tables

pytestmark = [pytest.mark.slow, pytest.mark.shared]

MEASURED = {-1.0: (3.02, 3.07), 1.0: (3.09, 3.33)}
"""Advance from the order and tactical diameter of MARIN's circle of 35 deg to port and starboard, in lengths."""


def tank_model() -> Vessel:
    """The published model with the propeller of this tank."""
    vessel = load_vessel("kvlcc2_7m")
    propeller, rudder = vessel.actuator
    return replace(vessel, actuator=(replace(propeller, **{"diameter_m": 0.204}), rudder))


def test_zigzags_predict_a_circle_that_was_not_recorded(shared_data: Path, tmp_path: Path) -> None:
    files = []
    for table in sorted((shared_data / "kvlcc2_hsva").glob("*.csv.gz")):
        files.append(tmp_path / f"{table.name.removesuffix('.csv.gz')}.mcap")
        st.import_table(table, files[-1], vessel="kvlcc2_7m", yes=True)
    tables, _ = usable_tables(named_recordings(files), (0.0, 100.0), repaired=False, rebuild_positions=None)
    identified, _ = identify_with_folds(tables, tank_model(), horizon_s=30, fixed=SURROUNDINGS)
    ship = approach_at_speed(trial_ship_at_rpm(identified.vessel, 620.0), 1.179)
    for side, (advance, diameter) in MEASURED.items():
        indices = turning_circle_test(ship, side, 35.0).indices
        lengths = indices["advance_m"].value / 7.0, indices["tactical_diameter_m"].value / 7.0
        print(side, lengths)  # noqa: T201
        assert abs(lengths[0] / advance - 1.0) <= 0.03
        assert abs(lengths[1] / diameter - 1.0) <= 0.06
    measured = [row for row in identified.indices.rows if row.measured is not None and row.predicted is not None]
    inside = [row.predicted.low <= row.measured.value <= row.predicted.high for row in measured
            if row.predicted is not None and row.measured is not None]  # fmt: skip
    assert len(inside) >= 8
    assert np.mean(inside) >= 0.9
