"""Coefficients from simulated trials: those the data tell of are found, the others stay and are said to."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

import seatrial as st
from seatrial.acquisition.core.errors import InputError
from seatrial.acquisition.core.ship import actuators_as_text
from seatrial.hybrid.effects import vessel_plant
from seatrial.hybrid.identification.fit import PARTS, coefficients_of, model_of, segments_of, values_at, with_values
from seatrial.hybrid.identification.identify import Identification, identify_tables, judge
from seatrial.hybrid.simulation.trial import SeaState, SimulationNoise, simulate_trial
from seatrial.hybrid.vessel.files import Vessel, load_vessel, save_vessel
from seatrial.hybrid.vessel.sensors import states_as_table

ONLY = ("hull.Y_v", "hull.N_r", "hull.C_D", "rudder.lift_slope", "propeller.astern_0")
TRUE = {"hull.Y_v": -0.45, "hull.N_r": -0.041, "hull.C_D": 0.8, "rudder.lift_slope": 2.9}
WIND = SeaState(1.0, 0.0, 5.0, 0.0, direction_from_deg=70.0)


@pytest.fixture(scope="module")
def start() -> Vessel:
    vessel = load_vessel("esso_osaka_3m")
    # the slope that follows from the aspect ratio, as a number of its own
    vessel = with_values(vessel, {"rudder.lift_slope": 2.4898})
    save = {"propeller.astern_0": 0.2, **dict.fromkeys(TRUE, 0.2)}
    object.__setattr__(vessel, "estimated", save)
    return vessel


@pytest.fixture(scope="module")
def found(start: Vessel) -> Identification:
    true = with_values(start, TRUE)
    quiet = SimulationNoise().scaled(0.2)
    tables = {
        name: simulate_trial(true, WIND, name, 240.0, 5.0, seed=seed, noise=quiet)[0]
        for seed, name in enumerate(("zigzag_20_20", "turning_circle_35"))
    }
    return identify_tables(tables, start, only=ONLY, candidates=("zigzag_10_10", "stopping"))[0]


def test_what_the_data_tell_is_inside_its_interval_and_better_known(found: Identification) -> None:
    by_name = {each.name: each for each in found.coefficients}
    for name, value in TRUE.items():
        each = by_name[name]
        assert each.known, name
        slack = 0.5 * (each.high - each.low)
        assert each.low - slack <= value <= each.high + slack, name
        assert abs(each.value - value) < abs(each.start - value), name


def test_what_the_data_do_not_tell_stays_at_the_start(found: Identification) -> None:
    astern = next(each for each in found.coefficients if each.name == "propeller.astern_0")
    assert not astern.known
    assert astern.value == pytest.approx(astern.start, rel=0.02)
    assert (astern.low, astern.high) == pytest.approx((astern.start_low, astern.start_high), rel=0.05)
    assert "unknown" in str(found)


def test_a_trial_that_uses_the_propeller_astern_is_worth_more_than_none(found: Identification) -> None:
    assert {each.manoeuvre for each in found.candidates} == {"zigzag_10_10", "stopping"}
    assert all(each.gain > 0.0 and 0.0 < each.left < 1.0 for each in found.candidates)


def test_the_vessel_file_is_whole_and_says_where_it_is_from(found: Identification, tmp_path: Path) -> None:
    save_vessel(found.vessel, tmp_path / "ship.toml")
    again = load_vessel(tmp_path / "ship.toml")
    assert again.hull == found.vessel.hull
    assert "zigzag_20_20" in str(again.provenance["identified_from"])
    assert again.estimated["hull.Y_v"] < 0.2
    json.dumps(found.as_dict())
    assert found.plot().axes


def test_fixed_surroundings_stay_fixed_on_other_segments(start: Vessel) -> None:
    table = simulate_trial(start, WIND, "zigzag_20_20", 200.0, 5.0)[0]
    segments = segments_of({"trial": table}, vessel_plant(start))
    fixed = {"current_north_mps", "current_east_mps"}
    model = model_of(start, coefficients_of(start), segments, fixed)
    assert {surrounding.name for surrounding in model.surroundings if not surrounding.width} == fixed
    assert model.on_segments(segments, np.zeros(model.size))[0].surroundings == model.surroundings


def test_values_go_into_the_tables_they_are_named_after(start: Vessel) -> None:
    every = coefficients_of(start)
    neutral = with_values(start, values_at(every, [0.0] * len(every)))  # type: ignore[arg-type]
    assert neutral == start
    changed = with_values(start, {"rudder.a_H": 0.5, "hull.C_D": 1.0, "effects.wind_load.factor": 1.2})
    assert changed.of_kind("rudder")[0].a_H == 0.5
    assert changed.hull.C_D == 1.0  # type: ignore[attr-defined]
    assert changed.effects["wind_load"] == {"factor": 1.2}


def test_a_recording_of_another_ship_is_refused(start: Vessel) -> None:
    index = pd.date_range("2026-06-01", periods=600, freq="200ms", tz="UTC", name="time")
    states = np.tile([0.0, 0.0, 0.0, 4.0, 0.0, 0.0], (600, 1))
    table = states_as_table(states, np.zeros((600, 5)), np.zeros((600, 2)), index)
    with pytest.raises(InputError, match="a ship with"):
        identify_tables({"other": table}, start)


def test_judgement_is_of_the_fitted_vessel_beside_the_start(start: Vessel) -> None:
    true = with_values(start, TRUE)
    table = simulate_trial(true, WIND, "zigzag_20_20", 120.0, 5.0, noise=SimulationNoise().scaled(0.2))[0]
    fold = SimpleNamespace(tables={"zigzag": table}, model=SimpleNamespace(vessel=start), vessel=true)
    judgement = judge([fold], 10, "the zigzag")
    assert judgement is not None
    error_m = {name: score.mean_distance_m for name, score in judgement.scores.items()}
    assert error_m["identified"] < error_m["reference"] < error_m["constant_velocity"]


@pytest.mark.slow
def test_the_script_and_the_file_agree(start: Vessel, tmp_path: Path) -> None:
    table = simulate_trial(start, WIND, "zigzag_20_20", 200.0, 5.0, noise=SimulationNoise().scaled(0.2))[0]
    st.write(table, tmp_path / "trial.mcap", actuators=actuators_as_text(start.actuators))
    save_vessel(start, tmp_path / "start.toml")
    result = st.identify(
        tmp_path / "trial.mcap", tmp_path / "start.toml", tmp_path / "new.toml", 10, segment_s=20.0
    )
    assert result.validation is not None
    assert set(result.as_dict()["validation"]["methods"]) == {"constant_velocity", "reference", "identified"}
    scores = result.validation.scores
    assert scores["identified"].mean_distance_m < scores["constant_velocity"].mean_distance_m
    assert st.load_vessel(tmp_path / "new.toml").hull == result.vessel.hull


@pytest.fixture(scope="module")
def record(start: Vessel) -> pd.DataFrame:
    return simulate_trial(start, WIND, "zigzag_20_20", 200.0, 5.0, noise=SimulationNoise().scaled(0.0))[0]


@pytest.mark.parametrize(("nth", "duration_s"), [(1, 20.0), (1, 47.0), (2, 33.0), (3, 20.0), (5, 20.0)])
def test_segments_are_compared_where_the_record_has_rows(
    record: pd.DataFrame, start: Vessel, nth: int, duration_s: float
) -> None:
    sparse = record.iloc[::nth]
    segments = segments_of({"zigzag": sparse}, vessel_plant(start), duration_s)
    assert segments.duration_s == pytest.approx(duration_s, rel=0.1)
    every = segments.steps_per_comparison * segments.dt_s / (0.2 * nth)  # in rows of the record
    assert every == pytest.approx(round(every))
    compared = sparse["surge_mps"].to_numpy()[:: round(every)][: segments.measured[..., 0].size]
    assert segments.measured[..., 3].ravel() == pytest.approx(compared, abs=1e-12)
    parts = segments.split(PARTS)
    assert len(parts) == PARTS * len(segments)
    assert parts.duration_s == pytest.approx(segments.duration_s / PARTS)
    assert np.array_equal(parts.start[0::PARTS], segments.start)
    assert np.array_equal(parts.controls.reshape(segments.controls.shape), segments.controls)


def test_the_true_ship_leaves_nothing_of_a_record_without_noise(record: pd.DataFrame, start: Vessel) -> None:
    model = model_of(start, coefficients_of(start), segments_of({"zigzag": record}, vessel_plant(start)))
    z = np.zeros(model.size)
    # the record shows the drives half a step of the simulation, 0.05 s, before they act
    late = [each.name for each in model.surroundings].index("command_delay_s")
    z[len(model.coefficients) + late] = -0.05 / model.surroundings[late].width
    left = model.segments.measured - model.readings_at(z, model.segments.measured[:, 0])
    assert np.abs(left).max() < 0.005


def test_actuators_that_are_alike_share_their_numbers() -> None:
    ship = load_vessel("gunnerus_long")
    coefficients = coefficients_of(ship)
    names = [each.name for each in coefficients]
    assert "port.thrust_nn" in names
    assert "starboard.thrust_nn" not in names
    z = np.where([each.name == "port.thrust_nn" for each in coefficients], 1.0, 0.0)
    before, after = ship.of_kind("azimuth"), with_values(ship, values_at(coefficients, z)).of_kind("azimuth")
    assert after[0].thrust_nn == after[1].thrust_nn != before[0].thrust_nn
    assert [each.y_m for each in after] == [each.y_m for each in before]
    uneven = with_values(ship, {"starboard.thrust_nn": 0.7})
    assert "starboard.thrust_nn" in [each.name for each in coefficients_of(uneven)]


def test_a_recording_without_speeds_is_refused_with_how_to_derive_them(start: Vessel) -> None:
    table, _ = simulate_trial(start, WIND, "zigzag_20_20", 60.0, 5.0, seed=1)
    with pytest.raises(InputError, match=r"no surge_mps.*derive"):
        identify_tables({"zigzag": table.drop(columns=["surge_mps", "sway_mps"])}, start)
