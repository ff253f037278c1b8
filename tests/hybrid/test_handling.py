"""Who drives and who steers, and how another ship makes R/V Gunnerus' manoeuvres."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.acquisition.core.quantities import Floats
from seatrial.hybrid.effects import vessel_plant
from seatrial.hybrid.simulation.manoeuvres import (
    MANOEUVRES,
    Leg,
    Pace,
    handling_of,
    legs_as_arrays,
    manoeuvre_named,
    pace_of,
    scale_to_ship,
    steer,
    usual_rpm,
)
from seatrial.hybrid.simulation.trial import sail_through, sea_state_named
from seatrial.hybrid.vessel.files import Vessel, load_vessel
from tests.hybrid.froude import froude_scaled

GUNNERUS = load_vessel("gunnerus_short")
POD, _, TUNNEL = GUNNERUS.actuator


def sailed(vessel: Vessel, name: str, steps: int, dt_s: float) -> Floats:
    """The states of a manoeuvre in still air, [steps + 1, 6]."""
    legs = scale_to_ship(manoeuvre_named(name, vessel.actuators), vessel)
    streams = np.random.default_rng(0), np.random.default_rng(0)
    return sail_through(
        vessel, vessel_plant(vessel), sea_state_named("calm"), legs, steps, dt_s, 0.0, *streams
    ).states


def test_gunnerus_is_her_own_measure() -> None:
    """All factors are exactly one, so that her manoeuvres are untouched; she is lengthened by an effect."""
    for name in ("gunnerus_short", "gunnerus_long"):
        vessel = load_vessel(name)
        assert pace_of(vessel) == Pace()
        assert usual_rpm(vessel) == 171.0
        for legs in (make(vessel.actuators) for make in MANOEUVRES.values()):
            assert scale_to_ship(legs, vessel) is legs


@pytest.mark.parametrize("scale", [0.1, 9.0])
@pytest.mark.parametrize("name", ["zigzag", "turning_circle", "stopping"])
def test_a_ship_and_her_model_make_the_same_manoeuvre(scale: float, name: str) -> None:
    """At the same Froude number: the same track in lengths, in times that go with the root of the length."""
    model = froude_scaled(GUNNERUS, scale)
    assert pace_of(model).time == pytest.approx(scale**0.5, rel=1e-3)
    whole, small = sailed(GUNNERUS, name, 3000, 0.1), sailed(model, name, 3000, 0.1 * scale**0.5)
    assert small[:, :2] / scale == pytest.approx(whole[:, :2], abs=0.02 * np.ptp(whole[:, :2]))
    assert small[:, 2] == pytest.approx(whole[:, 2], abs=np.deg2rad(2.0))
    assert np.ptp(whole[:, 0]) > 100.0


def test_shafts_turn_in_proportion_to_their_limits() -> None:
    """A pod ahead of midship takes the opposite angle; the tunnel thruster has no part in it."""
    small = replace(POD, name="bow_pod", x_m=11.0, limit_rpm=406.0)
    ship = replace(GUNNERUS, actuator=(POD, small, TUNNEL))
    assert handling_of(ship).orders(100.0, 10.0) == pytest.approx([100.0, 10.0, 200.0, -10.0, 0.0])


def test_a_ship_that_nothing_drives_is_refused() -> None:
    barge = replace(GUNNERUS, name="barge", actuator=(TUNNEL,))
    with pytest.raises(ConfigurationError, match=r"barge has no propulsion: it has tunnel \(tunnel\)"):
        legs_as_arrays((Leg(),), barge)


def test_an_order_to_a_steering_angle_gives_way_to_the_course() -> None:
    """As the autopilot's helm is added to what a leg orders."""
    legs = (Leg(orders={"port_angle_deg": 20.0}), replace(steer(0.0, 10.0), orders={"port_angle_deg": 20.0}))
    orders, _ = legs_as_arrays(legs, GUNNERUS)
    assert np.rad2deg(orders[:, 1]) == pytest.approx([20.0, 0.0])
