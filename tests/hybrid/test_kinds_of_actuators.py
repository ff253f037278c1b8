"""Every kind of actuator is known to all that lists kinds or controls: none is registered by half."""

from __future__ import annotations

import pytest

from seatrial.acquisition.core.ship import ANGLES, CONTROLS, Actuator, control_names
from seatrial.acquisition.core.ship import KINDS as RECORDED_KINDS
from seatrial.analysis.report.plots import control_groups
from seatrial.analysis.windows.held import REASONS, TOLERANCES, sort_of, tolerance_of
from seatrial.hybrid.effects import steering_angles, weights_of
from seatrial.hybrid.report.plots import RESIDUAL_QUANTITIES
from seatrial.hybrid.vessel.actuators import KINDS


@pytest.mark.parametrize("name", RECORDED_KINDS)
def test_force_and_channels_of_a_kind_agree(name: str) -> None:
    kind, controls = KINDS[name], RECORDED_KINDS[name].controls
    assert kind.entry.__annotations__["kind"] == f"Literal['{name}']"
    assert kind.angles == tuple(each in ANGLES for each in controls)
    assert {len(kind.labels), len(kind.units), len(kind.still), len(kind.alike)} == {len(controls)}
    assert set(kind.slots) <= set(kind.numbers)


@pytest.mark.parametrize("name", RECORDED_KINDS)
def test_a_ship_of_each_kind_is_resampled_held_drawn_and_mapped(name: str) -> None:
    ship = (Actuator("port", name), Actuator("starboard", name))
    assert {each for names in control_groups(ship).values() for each in names} == set(control_names(ship))
    assert all(tolerance_of(each, ship).span > 0.0 for each in control_names(ship))
    for quantity, names in steering_angles(ship).items():
        assert names == ("port", "starboard")
        assert quantity in weights_of(ship)
        assert quantity in RESIDUAL_QUANTITIES


def test_every_control_has_a_tolerance_and_a_reason() -> None:
    sorts = {
        sort_of(each, (Actuator("x", kind),)) for kind in KINDS for each in control_names((Actuator("x", kind),))
    }
    assert sorts == set(TOLERANCES) == {each.removesuffix(" thruster") for each in CONTROLS}
    assert len(REASONS) == 5 + len(TOLERANCES)
