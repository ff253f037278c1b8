"""A catamaran of 2 m that sails her length in a second: nothing hidden gets no name, and what is hidden its own."""

from __future__ import annotations

from typing import Any

import pytest

from seatrial.hybrid.diagnosis.result import Diagnosis
from seatrial.hybrid.effects import catalogue_of
from seatrial.hybrid.simulation.trial import simulate_trial
from seatrial.hybrid.vessel.files import load_vessel
from seatrial.hybrid.workflows import diagnose_tables

OTTER = load_vessel("otter_2m")

pytestmark = pytest.mark.slow


def diagnosed(seed: int, sea: str = "calm", **hidden: dict[str, float]) -> Diagnosis:
    """The diagnosis of ten minutes of her voyage at 10 Hz."""
    table, _ = simulate_trial(
        OTTER, sea, "voyage", 600.0, 10.0, seed, hidden or None, catalogue=catalogue_of(OTTER)
    )
    return diagnose_tables([table], OTTER).diagnosis


@pytest.mark.parametrize("seed", [1, 2])
def test_nothing_hidden_gets_no_name(seed: int) -> None:
    """Clocks, drives and the inertia in yaw were named when turning was taken for waves."""
    found = diagnosed(seed)
    assert not found.effects
    assert found.gap.before_m < 0.02 * 15.0 * 2.3


@pytest.mark.parametrize(
    ("name", "parameter", "size"),
    [("hull_fouling", "resistance_factor", 1.3), ("thrust_loss_port", "fraction", 0.2)],
)
def test_what_is_hidden_is_named_at_its_size(name: str, parameter: str, size: float) -> None:
    found = diagnosed(7, **{name: {parameter: size}})
    named: dict[str, Any] = {effect.name: effect for effect in found.effects}
    assert name in named
    assert named[name].parameters[parameter].value == pytest.approx(size, rel=0.05)
