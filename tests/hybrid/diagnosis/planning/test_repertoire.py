"""What a ship is asked for, in the words of her own actuators and at her own pace."""

from __future__ import annotations

import re

from seatrial.hybrid.diagnosis.disturbance_model import DisturbanceNoise
from seatrial.hybrid.diagnosis.linearise import ModelWithEffects, linearise
from seatrial.hybrid.diagnosis.planning import (
    CandidateManoeuvre,
    Pair,
    Shafts,
    best_request,
    candidates_of_ship,
    rank_candidates,
    rehearsal_of,
    rehearse,
)
from seatrial.hybrid.diagnosis.regression import normal_equations
from seatrial.hybrid.effects import catalogue_of, vessel_plant
from seatrial.hybrid.simulation.manoeuvres import steer, usual_rpm
from seatrial.hybrid.simulation.trial import sea_state_named
from seatrial.hybrid.vessel.files import load_vessel

TWIN_SCREW = Shafts(
    90.0, 45.0, 65.0, 105.0, 0.0, ("port_propeller", "starboard_propeller"), ("port_rudder", "starboard_rudder"),
    (), "propeller", "rudder", 7.0,
)  # fmt: skip
TWO_SHAFTS = Shafts(
    70.0, 35.0, 50.0, 80.0, 0.0, ("port", "starboard"), (), (), "propeller", "helm", 0.5, 85.0, 70.0
)


def by_name(shafts: Shafts) -> dict[str, CandidateManoeuvre]:
    return {each.name: each for each in candidates_of_ship(shafts)}


def test_a_twin_screw_ship_is_asked_in_her_own_words() -> None:
    asked = by_name(TWIN_SCREW)
    assert "both rudders at 30 degrees" in asked["turns_30"].what
    assert "both propellers at 90 rpm with rudders opposed" in asked["rudders_opposed"].what
    assert (
        "Run on the port propeller alone at 90 rpm, then on the starboard propeller"
        in asked["one_thruster_at_a_time"].what
    )
    assert "tunnel_thruster" not in asked
    assert not any("azimuth" in each.what or "pod" in each.what for each in asked.values())


def test_a_large_ship_takes_her_time_and_a_small_one_hers() -> None:
    """Said and sailed: the reciprocal runs of four minutes of a ship of 28.9 m."""
    large, small = by_name(TWIN_SCREW)["reciprocal_headings"], by_name(TWO_SHAFTS)["reciprocal_headings"]
    assert (large.minutes, small.minutes) == (70, 5)
    assert "28 minutes on a heading" in large.what
    assert "2 minutes on a heading" in small.what
    assert [leg.at_most_s for leg in large.legs] == [14.0 * leg.at_most_s for leg in small.legs]


def test_a_ship_steered_by_her_shafts_has_no_angle_to_hold() -> None:
    """Her helm is said in rpm; with one shaft alone she cannot keep a course."""
    asked = by_name(TWO_SHAFTS)
    assert "one shaft at 85 and the other at 10 rpm" in asked["turns_30"].what
    assert {"uneven_thrusters", "rudders_opposed", "azimuths_opposed"}.isdisjoint(asked)
    assert all(leg.course_deg != leg.course_deg for leg in asked["one_thruster_at_a_time"].legs)
    assert not re.search(r"degrees of helm|at -?\d+ degrees", asked["one_thruster_at_a_time"].what)


def test_the_next_manoeuvre_of_a_rudder_ship() -> None:
    """After a straight run nothing is known of the rudder: she is asked to use it, in words that fit her."""
    ship = load_vessel("kvlcc2_7m")
    plant, names = vessel_plant(ship), ("rudder_offset_rudder", "yaw_asymmetry", "thrust_loss_propeller")
    catalogue = {name: each for name, each in catalogue_of(ship).items() if name in names}
    straight = rehearse((steer(0.0, 1e4, usual_rpm(ship)),), ship, plant, sea_state_named("calm"), 600)
    calm = DisturbanceNoise(gust=(5.0, 5.0, 12.0), slow=(5.0, 5.0, 12.0))  # of a model, N and N m
    equations = normal_equations(linearise(straight, ModelWithEffects(plant, catalogue), 0.01), calm)
    pairs = [Pair("rudder_offset_rudder", "yaw_asymmetry", {"angle_deg": 2.0})]
    ranking = rank_candidates(rehearsal_of(equations, ship, {}), pairs)
    asked = best_request(ranking, pairs)
    assert asked is not None
    assert asked.minutes == 12.0
    assert "rpm" in asked.what
    assert not re.search("azimuth|thruster|pod", asked.what)
    gained = {each.candidate.name: each.gains_per_minute[0] for each in ranking}
    assert max(gained, key=gained.__getitem__) not in ("reciprocal_headings", "four_headings", "drifting")
