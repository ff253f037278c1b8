"""A simulator that integrates roughly is late by its own account: measured, so that no sensor is blamed for it."""

from __future__ import annotations

from pathlib import Path

import pytest

import seatrial as st
from seatrial.hybrid.diagnosis.linearise import integration_delays_s
from seatrial.hybrid.diagnosis.log import Log, log_of
from seatrial.hybrid.effects import vessel_plant
from seatrial.hybrid.report.diagnosis import integration_remarks
from seatrial.hybrid.vessel.files import load_vessel
from tests.conftest import Simulated
from tests.hybrid.own_simulator.conftest import Sailed


@pytest.fixture(scope="module")
def log(sailed: Sailed) -> Log:
    return log_of([st.read(sailed("Sailer", 0, 120.0))], 30.0)


def test_eulers_method_is_half_a_step_late(shipyard: Path, log: Log) -> None:
    """The class moves by the speeds before each step: in four a second 0.125 s late, and it is said."""
    delays = integration_delays_s(log, st.load_simulator(f"{shipyard}/sailer.py:Sailer"))
    assert delays == pytest.approx((0.125, 0.125), abs=1e-6)
    (remark,) = integration_remarks(*delays)
    assert "moves 0.125 s and turns 0.125 s later than its own speeds" in remark


def test_shorter_steps_are_late_by_less(shipyard: Path, log: Log, tmp_path: Path) -> None:
    """As the map of the class states them: half of a fortieth of a second, of which nothing is said."""
    (tmp_path / "sailer.py").write_text((shipyard / "sailer.py").read_text())
    text = (shipyard / "sailer.toml").read_text()
    (tmp_path / "sailer.toml").write_text(f"{text}\n[solver]\nstep_s = 0.025\n")
    delays = integration_delays_s(log, st.load_simulator(f"{tmp_path}/sailer.py:Sailer"))
    assert delays == pytest.approx((0.0125, 0.0125), abs=2e-3)
    assert not integration_remarks(*delays)


def test_vessel_files_are_not_late(simulated: Simulated) -> None:
    """The product's own kernel, in steps of a quarter of a second."""
    plant = vessel_plant(load_vessel("gunnerus_short"))
    log = log_of([st.read(simulated("gentle", 100, 600.0))], plant.length_overall_m)
    assert integration_delays_s(log, plant) == pytest.approx((0.0, 0.0), abs=0.01)
