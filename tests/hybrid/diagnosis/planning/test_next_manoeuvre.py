"""Which manoeuvre separates what: what seamen and the literature know must come out by itself."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from seatrial.hybrid.diagnosis.disturbance_model import DisturbanceNoise
from seatrial.hybrid.diagnosis.linearise import ModelWithEffects, acting_settings, linearise
from seatrial.hybrid.diagnosis.log import Log
from seatrial.hybrid.diagnosis.planning import (
    Pair,
    RankedCandidate,
    Rehearsal,
    append_rehearsals,
    best_request,
    candidates_of_ship,
    rank_candidates,
    rehearsal_of,
    rehearse,
    shafts_of,
    usual_rpm,
    wind_in,
)
from seatrial.hybrid.diagnosis.regression import NormalEquations, normal_equations
from seatrial.hybrid.effects import CATALOGUE
from seatrial.hybrid.simulation.manoeuvres import Manoeuvre, steer, zigzag
from seatrial.hybrid.simulation.trial import SeaState
from seatrial.hybrid.vessel.effect import Values
from seatrial.hybrid.vessel.files import Vessel
from seatrial.hybrid.vessel.plant import Plant

BREEZE = SeaState(5.0, 0.0, 5.0, 0.0, direction_from_deg=70.0)
SOME = {
    name: CATALOGUE[name]
    for name in (
        "surge_added_mass", "drift_force", "hull_fouling", "thrust_loss_port", "thrust_loss_starboard",
        "thrust_loss_both", "azimuth_offset_port", "azimuth_offset_starboard", "yaw_asymmetry", "ocean_current",
        "heading_bias",
    )
}  # fmt: skip
SOME["compass_bias"] = replace(CATALOGUE["heading_bias"], name="compass_bias")
Rank = Callable[[str, str, Values], list[RankedCandidate]]


def recorded(plant: Plant, vessel: Vessel, legs: Manoeuvre) -> NormalEquations:
    log = rehearse(legs, vessel, plant, BREEZE, 600)
    return normal_equations(linearise(log, ModelWithEffects(plant, SOME), 0.01), DisturbanceNoise())


def ranking(rehearsal: Rehearsal) -> Rank:
    return lambda name, rival, values: rank_candidates(rehearsal, [Pair(name, rival, values)])


@pytest.fixture(scope="module")
def zigzags(plant: Plant, vessel: Vessel) -> Rehearsal:
    return rehearsal_of(recorded(plant, vessel, zigzag(swings=12)), vessel, {})


@pytest.fixture(scope="module")
def one_heading(plant: Plant, vessel: Vessel) -> Rehearsal:
    legs = tuple(steer(0.0, 150.0, rpm) for rpm in (170.0, 120.0, 190.0, 150.0))
    return rehearsal_of(recorded(plant, vessel, legs), vessel, {})


@pytest.fixture(scope="module")
def after_zigzags(zigzags: Rehearsal) -> Rank:
    return ranking(zigzags)


@pytest.fixture(scope="module")
def after_one_heading(one_heading: Rehearsal) -> Rank:
    return ranking(one_heading)


def names_of(ranks: list[RankedCandidate]) -> list[str]:
    return [each.candidate.name for each in ranks]


ONE_SIDE_AT_A_TIME = {"one_thruster_at_a_time", "uneven_thrusters", "azimuths_opposed"}


@pytest.mark.parametrize(
    ("name", "rival", "values"),
    [
        ("azimuth_offset_port", "azimuth_offset_starboard", {"angle_deg": 2.0}),
        ("thrust_loss_port", "thrust_loss_starboard", {"fraction": 0.1}),
    ],
)
def test_port_is_told_from_starboard_by_using_them_unlike(
    after_zigzags: Rank, name: str, rival: str, values: Values
) -> None:
    ranks = after_zigzags(name, rival, values)
    assert set(names_of(ranks)[:3]) == ONE_SIDE_AT_A_TIME
    gained = {each.candidate.name: each.gains_per_minute[0] for each in ranks}
    assert gained["zigzags_20_20"] < 0.1 * gained["one_thruster_at_a_time"]


def test_an_offset_is_told_from_a_steady_moment_by_one_thruster(after_zigzags: Rank) -> None:
    ranks = after_zigzags("azimuth_offset_port", "yaw_asymmetry", {"angle_deg": 2.0})
    assert "one_thruster_at_a_time" in names_of(ranks)[:3]
    gained = {each.candidate.name: each.gains_per_minute[0] for each in ranks}
    assert gained["zigzags_20_20"] < 0.7 * gained["one_thruster_at_a_time"]


def test_inertia_ahead_is_seen_in_changes_of_speed(after_zigzags: Rank) -> None:
    assert names_of(after_zigzags("surge_added_mass", "drift_force", {"factor": 1.5}))[0] == "speed_changes"


def test_a_current_along_the_one_heading_is_told_from_fouling_by_another_heading(after_one_heading: Rank) -> None:
    ranks = after_one_heading("ocean_current", "hull_fouling", {"speed_mps": 0.2, "direction_deg": 180.0})
    gained = {each.candidate.name: each.gains_per_minute[0] for each in ranks}
    assert gained["reciprocal_headings"] > 1.5 * gained["azimuths_opposed"] > 0.0


def test_resistance_is_told_from_thrust_by_changing_the_thrust(after_one_heading: Rank) -> None:
    ranks = after_one_heading("hull_fouling", "thrust_loss_both", {"resistance_factor": 1.2})
    assert {"speed_changes", "coasting"} <= set(names_of(ranks)[:3])


def test_a_compass_bias_is_told_from_a_current_by_turning(after_one_heading: Rank) -> None:
    names = names_of(after_one_heading("heading_bias", "ocean_current", {"angle_deg": 1.5}))
    straight = ("azimuths_opposed", "drifting")
    assert min(names.index(each) for each in straight) > max(names.index(each) for each in ("turns_15", "turns_30"))


def test_more_data_never_tell_less(after_zigzags: Rank) -> None:
    ranks = after_zigzags("ocean_current", "heading_bias", {"speed_mps": 0.2, "direction_deg": 60.0})
    assert all(each.with_it[0] >= each.without[0] * (1.0 - 1e-6) for each in ranks)


def test_nothing_separates_an_effect_from_its_double(after_zigzags: Rank) -> None:
    ranks = after_zigzags("heading_bias", "compass_bias", {"angle_deg": 2.0})
    assert best_request(ranks, [Pair("heading_bias", "compass_bias", {"angle_deg": 2.0})]) is None


def test_a_rival_that_nothing_separates_is_no_reason_not_to_separate_the_others(one_heading: Rehearsal) -> None:
    values = {"angle_deg": 1.5}
    double = Pair("heading_bias", "compass_bias", values)
    other = Pair("heading_bias", "ocean_current", values)
    asked = best_request(rank_candidates(one_heading, [double, other]), [double, other])
    assert asked is not None
    assert asked.separates == ("heading_bias", "ocean_current")
    assert asked == best_request(rank_candidates(one_heading, [other]), [other])


def test_what_is_likelier_to_be_true_weighs_more(zigzags: Rehearsal) -> None:
    inertia = Pair("surge_added_mass", "drift_force", {"factor": 1.15})
    offset = Pair("azimuth_offset_port", "azimuth_offset_starboard", {"angle_deg": 0.5})

    def first(*pairs: Pair) -> str:
        return rank_candidates(zigzags, pairs)[0].candidate.name

    assert first(replace(inertia, weight=1e-6), offset) == first(offset)
    assert first(inertia, replace(offset, weight=1e-6)) == first(inertia)
    assert first(inertia) != first(offset)


def test_what_is_asked_for_can_be_read_out_on_the_bridge(after_zigzags: Rank) -> None:
    pair = ("azimuth_offset_port", "azimuth_offset_starboard")
    asked = best_request(after_zigzags(*pair, {"angle_deg": 2.0}), [Pair(*pair, {"angle_deg": 2.0})])
    assert asked is not None
    assert asked.separates == pair
    assert asked.expected_evidence > 4.5
    assert "170 rpm" in asked.what
    assert asked.what.endswith("10 minutes in all")


def test_manoeuvres_are_made_at_the_speed_and_in_the_wind_of_the_recording(plant: Plant, vessel: Vessel) -> None:
    log = rehearse((steer(40.0, 300.0, 120.0),), vessel, plant, BREEZE, 200)
    assert usual_rpm(log) == pytest.approx(120.0, abs=1.0)
    wind = wind_in(log)
    assert wind.wind_mps == pytest.approx(5.0, rel=0.15)
    assert wind.direction_from_deg == pytest.approx(70.0, abs=10.0)


@pytest.mark.parametrize("usual", [40.0, 100.0, 171.0, 400.0])
def test_no_candidate_asks_for_more_than_the_drives_can_do(vessel: Vessel, usual: float) -> None:
    candidates = candidates_of_ship(shafts_of(vessel, usual))
    assert len({each.name for each in candidates}) == len({each.what for each in candidates}) == len(candidates)
    for candidate in candidates:
        for leg in candidate.legs:
            limits = {
                f"{each.name}_rpm": each.limit_rpm
                for kind in ("azimuth", "tunnel")
                for each in vessel.of_kind(kind)
            }
            assert leg.rpm <= min(each.limit_rpm for each in vessel.of_kind("azimuth"))
            assert all(abs(value) <= limits.get(name, 180.0) for name, value in leg.orders.items())


def joined_log(plant: Plant, vessel: Vessel) -> tuple[Log, Log, Log]:
    first = rehearse(zigzag(), vessel, plant, BREEZE, 200)
    measured = first.measured.copy()
    measured[:, 5] = np.nan
    first = replace(first, measured=measured)
    second = rehearse((steer(0.0, 300.0),), vessel, plant, BREEZE, 130)
    return first, second, append_rehearsals(first, [second, second])


def test_a_rehearsal_behind_a_part_of_a_log_has_its_own_settings(plant: Plant, vessel: Vessel) -> None:
    """What the drives did before that part is forgotten: a lag has settings for each second of the two."""
    log = rehearse(zigzag(), vessel, plant, BREEZE, 200)
    part = log.subset(np.arange(len(log)) >= 60)
    joined = append_rehearsals(part, [log])
    controls, acting = acting_settings(joined, plant.shifted(thruster_lag_s=1.0))
    assert len(controls) == len(acting) == len(joined) == len(part) + len(log)


def test_one_log_behind_another_keeps_blocks_legs_and_times_apart(plant: Plant, vessel: Vessel) -> None:
    first, second, joined = joined_log(plant, vessel)
    assert len(joined) == len(first) + 2 * len(second)
    assert joined.leg_count == first.leg_count + 2 * second.leg_count
    assert len(joined.block_edges) - 1 == (len(first.block_edges) - 1) + 2 * (len(second.block_edges) - 1)
    steps = np.diff(joined.time_s)
    assert np.flatnonzero(steps != 1).tolist() == [len(first) - 1, len(first) + len(second) - 1]
    assert np.abs(np.diff(joined.nominal[:, :2], axis=0)).max() < 10.0
    assert np.isnan(joined.measured[:, 5]).all()
    assert np.isfinite(joined.measured[:, :5]).all()
