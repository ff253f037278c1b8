"""A rudder or a nozzle of the wrong sign is found, and nothing is said of one that is right, or too little used."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from seatrial.acquisition.core.ship import Actuator, actuators_as_text
from seatrial.analysis.quality.findings import check_helm_sign
from seatrial.hybrid.simulation.trial import simulate_trial
from tests.analysis.rudder_ships import MODEL, TWIN, Orders, Ship, sail, turn, zigzag

SHIPS = {"single": (Ship(), 120.0), "twin": (replace(Ship(), actuators=TWIN), 120.0), "model": (MODEL, 600.0)}


@pytest.mark.parametrize("name", SHIPS)
@pytest.mark.parametrize("orders", [turn(-20.0, 120.0), zigzag(20.0, 20.0, 120.0)])
def test_every_rudder_of_the_wrong_sign_is_found(name: str, orders: Orders) -> None:
    ship, _ = SHIPS[name]
    table = sail(ship, orders, 400.0)
    assert check_helm_sign(table).findings == ()
    rudders = [each for each in table if "rudder" in each]
    turned = table.assign(**{each: -table[each] for each in rudders})
    findings = check_helm_sign(turned).findings
    assert [(each.code, each.channel) for each in findings] == [("helm_sign", each) for each in rudders]
    assert all(each.estimate["agreement"] < -0.95 and not each.certain for each in findings)


def test_a_course_kept_in_wind_says_nothing() -> None:
    """The helmsman holds 8 deg of rudder against the wind and meets every yaw: the ship goes straight."""
    random = np.random.default_rng(0)
    table = sail(Ship(), lambda *_: (0.0, 120.0), 600.0)
    yaw = np.convolve(random.standard_normal(len(table)), np.hanning(100) / 50.0, "same") * 3.0
    table = table.assign(heading_deg=(yaw + 90.0) % 360.0, rudder_angle_deg=8.0 - 2.0 * yaw)
    assert check_helm_sign(table).findings == ()


def test_a_nozzle_turns_the_ship_the_other_way() -> None:
    table = sail(Ship(), turn(20.0, 120.0), 200.0)
    jet = table.assign(jet_angle_deg=-table["rudder_angle_deg"], jet_rpm=table["propeller_rpm"])
    jet = jet.drop(columns=["rudder_angle_deg", "propeller_rpm"])
    jet.attrs["trial"] = {"actuators": actuators_as_text((Actuator("jet", "waterjet"),))}
    assert check_helm_sign(jet).findings == ()
    assert len(check_helm_sign(jet.assign(jet_angle_deg=-jet["jet_angle_deg"])).findings) == 1


def test_azimuth_thrusters_and_tables_without_a_heading_are_not_judged() -> None:
    gunnerus = simulate_trial("gunnerus_long", "calm", "zigzag_20_20", 200.0, 2.0, 1)[0]
    assert check_helm_sign(gunnerus.assign(port_angle_deg=-gunnerus["port_angle_deg"])).findings == ()
    table = sail(Ship(), turn(20.0, 120.0), 200.0)
    assert check_helm_sign(table.drop(columns="heading_deg")).findings == ()
