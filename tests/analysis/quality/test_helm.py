"""A rudder, a nozzle or a shaft of the wrong sign is found, and nothing is said of one that is right, or too little
used."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from seatrial.acquisition.core.ship import Actuator, actuators_as_text
from seatrial.analysis.quality.controls import check_helm_sign, check_shaft_sign
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


def test_a_shaft_of_the_wrong_sign_is_found() -> None:
    """Of two shafts one, as where the one that turns to the left counts as negative; also by a negative pitch."""
    ship = replace(Ship(), actuators=TWIN)
    table = sail(ship, zigzag(20.0, 20.0, 120.0), 400.0)
    assert check_shaft_sign(table).findings == ()
    (finding,) = check_shaft_sign(table.assign(starboard_rpm=-table["starboard_rpm"])).findings
    assert (finding.code, finding.channel) == ("shaft_sign", "starboard_rpm")
    assert finding.estimate["agreement"] < -0.95

    pitched = replace(Ship(), actuators=(Actuator("main", "controllable_propeller"), Actuator("rudder", "rudder")))
    table = sail(pitched, turn(0.0, 120.0), 200.0).assign(main_pitch_percent=80.0)
    later = table.assign(main_pitch_percent=table["main_pitch_percent"].where(np.arange(len(table)) % 5 == 1),
                         main_rpm=table["main_rpm"].where(np.arange(len(table)) % 5 == 0))  # fmt: skip
    assert check_shaft_sign(later).findings == ()
    assert len(check_shaft_sign(later.assign(main_pitch_percent=-later["main_pitch_percent"])).findings) == 1
    assert check_shaft_sign(later.assign(main_pitch_percent=-80.0, main_rpm=-later["main_rpm"])).findings == ()


def test_a_ship_that_stops_or_goes_astern_says_nothing_of_its_shaft() -> None:
    for rpm in ((120.0, -60.0), (120.0, 0.0), (-60.0, -60.0)):
        slow = Ship(speed_time_s=150.0)
        table = sail(slow, lambda time_s, *_, rpm=rpm: (0.0, rpm[time_s > 40.0]), 400.0)
        assert check_shaft_sign(table).findings == ()
    assert check_shaft_sign(table.drop(columns="surge_mps")).findings == ()
