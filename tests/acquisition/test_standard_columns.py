"""Columns under standard names are held against their track when they are imported: what counts otherwise is
converted where that is clear, else asked, and sound ones stay as they are to the last digit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from seatrial.acquisition.core.errors import ConfigurationError, InputError
from seatrial.acquisition.core.quantities import Floats
from seatrial.acquisition.core.ship import angle_difference
from seatrial.acquisition.tables.import_table import ImportSummary, import_table, is_standard_table
from seatrial.acquisition.tables.table_files import read_raw_table
from seatrial.analysis.tables.table import read_table
from seatrial.hybrid.simulation.trial import simulate_trial
from tests.acquisition.test_heading_columns import CONVENTIONS, KNOT, MOTION
from tests.acquisition.test_import_proposals import Truth
from tests.conftest import nightly


def standard_table(truth: Truth, *absent: str, **columns: Floats) -> pd.DataFrame:
    """The motion of a ship under standard names; ``columns`` instead of hers or besides."""
    motion = {name: getattr(truth, name) for name in ("north_m", "east_m", *MOTION) if name not in absent}
    return pd.DataFrame({"time": truth.local().strftime("%Y-%m-%dT%H:%M:%SZ")} | motion | columns)


def imported(path: Path, frame: pd.DataFrame, **answers: str) -> tuple[ImportSummary, pd.DataFrame]:
    frame.to_csv(path / "table.csv", index=False)
    assert is_standard_table(read_raw_table(path / "table.csv"))
    summary = import_table(path / "table.csv", path / "out.mcap", allow_missing=True, answers=answers, force=True)
    return summary, read_table(path / "out.mcap")


def assert_motion(found: pd.DataFrame, truth: Truth, tolerance: float = 1e-6) -> None:
    for name in set(MOTION) & set(found):
        off = found[name].to_numpy() - getattr(truth, name)
        assert np.abs(angle_difference(off, 0.0) if name == "heading_deg" else off).max() < tolerance, name


def test_sound_columns_stay_as_they_are(tmp_path: Path) -> None:
    truth = Truth()
    summary, found = imported(tmp_path, standard_table(truth))
    assert not summary.remarks
    for name in ("north_m", "east_m", *MOTION):
        np.testing.assert_array_equal(found[name], getattr(truth, name), err_msg=name)


def test_latitudes_and_longitudes_alone_are_projected(tmp_path: Path) -> None:
    truth = Truth()
    places = {name: truth.table[name].to_numpy() for name in ("latitude_deg", "longitude_deg")}
    frame = standard_table(truth, "north_m", "east_m", **places)
    frame.to_csv(tmp_path / "table.csv", index=False)
    import_table(tmp_path / "table.csv", tmp_path / "out.mcap", allow_missing=True)
    found = read_table(tmp_path / "out.mcap")
    for name in ("north_m", "east_m"):  # from the first position on
        way = found[name].to_numpy() - found[name].iloc[0]
        np.testing.assert_allclose(way, truth.table[name] - truth.table[name].iloc[0], atol=0.1)


def test_a_code_that_a_speed_could_be_is_no_value(tmp_path: Path) -> None:
    truth = Truth()
    surge = np.array(truth.surge_mps)
    assert surge.min() > 1.0
    surge[50:60] = -1.0
    summary, found = imported(tmp_path, standard_table(truth, surge_mps=surge))
    assert any("taken for no value" in remark for remark in summary.remarks)
    assert found["surge_mps"].isna().tolist() == (surge == -1.0).tolist()


@pytest.mark.parametrize("vessel", ["gunnerus_long", *nightly("esso_osaka_3m")])
@pytest.mark.parametrize("manoeuvre", ["zigzag_20_20", "stopping", "tunnel_test"])
@pytest.mark.parametrize("seed", [2, *nightly(5)])
def test_nothing_is_turned_or_accused_of_simulated_ships(
    vessel: str, manoeuvre: str, seed: int, tmp_path: Path
) -> None:
    trial, _ = simulate_trial(vessel, "moderate", manoeuvre, 240.0, 1.0, seed)
    frame = trial[["north_m", "east_m", *MOTION]].copy()
    frame.insert(0, "time", trial.index.strftime("%Y-%m-%dT%H:%M:%S.%fZ"))
    assert not imported(tmp_path, frame)[0].remarks


@pytest.mark.parametrize("name", CONVENTIONS)
@pytest.mark.parametrize("witness", ["yaw_rate_dps", "course_over_ground_deg", "latitude"])
def test_a_heading_of_another_sense_is_turned_where_a_witness_confirms_the_positions(
    name: str, witness: str, tmp_path: Path
) -> None:
    truth = Truth(place=(-40.0, -74.0))
    absent = {"yaw_rate_dps", "surge_mps", "sway_mps"} - {witness}
    frame = standard_table(truth, *absent, heading_deg=CONVENTIONS[name](truth.heading_deg))
    if witness == "latitude":
        places = {"latitude_deg": truth.latitude_deg, "longitude_deg": truth.longitude_deg}
        frame = frame.drop(columns=["north_m", "east_m"]).assign(**places)
    elif witness not in frame:
        frame[witness] = truth.course_over_ground_deg
    summary, found = imported(tmp_path, frame)
    assert any("anticlockwise" in remark for remark in summary.remarks)
    assert_motion(found, truth)


@pytest.mark.parametrize("name", CONVENTIONS)
def test_without_a_witness_it_is_asked_and_the_answer_honoured(name: str, tmp_path: Path) -> None:
    truth = Truth()
    frame = standard_table(truth, "surge_mps", "sway_mps", "yaw_rate_dps")
    frame["heading_deg"] = CONVENTIONS[name](truth.heading_deg)
    with pytest.raises(InputError, match=rf"--answer heading={name}\|clockwise"):
        imported(tmp_path, frame)
    assert_motion(imported(tmp_path, frame, heading=name)[1], truth)
    _, found = imported(tmp_path, frame, heading="clockwise")
    assert np.abs(angle_difference(found["heading_deg"], frame["heading_deg"])).max() < 1e-9


def test_a_course_that_sides_with_the_heading_is_stated_in_the_question(tmp_path: Path) -> None:
    truth = Truth()
    frame = standard_table(truth, "yaw_rate_dps", course_over_ground_deg=truth.course_over_ground_deg)
    frame["east_m"] *= -1.0
    with pytest.raises(InputError, match="against which the course over ground turns as well"):
        imported(tmp_path, frame)


@pytest.mark.parametrize(("unit", "scale"), [("rad", np.pi / 180.0), ("cdeg", 100.0), *nightly(("ddeg", 10.0))])
@pytest.mark.parametrize("name", ["heading_deg", "course_over_ground_deg"])
def test_an_angle_in_another_unit_than_its_name_states_is_asked_about(
    name: str, unit: str, scale: float, tmp_path: Path
) -> None:
    truth = Truth()
    frame = standard_table(truth).assign(**{name: scale * getattr(truth, name)})
    with pytest.raises(InputError, match=rf"--answer unit.{name}={unit}\|deg"):
        imported(tmp_path, frame)
    _, found = imported(tmp_path, frame, **{f"unit.{name}": unit})
    assert np.abs(angle_difference(found[name], getattr(truth, name))).max() < 1e-6


@pytest.mark.parametrize("crab_deg", [-35.0, 30.0])
def test_the_surge_of_a_ship_that_crabs_is_not_too_small(crab_deg: float, tmp_path: Path) -> None:
    truth = Truth()
    turned = (truth.surge_mps + 1j * truth.sway_mps) * np.exp(1j * np.deg2rad(crab_deg))
    frame = standard_table(truth, surge_mps=turned.real, sway_mps=turned.imag)
    frame["heading_deg"] = (truth.heading_deg - crab_deg) % 360.0
    assert not imported(tmp_path, frame)[0].remarks


@pytest.mark.parametrize("offset_deg", [-120.0, -70.0, 60.0, 90.0])
def test_a_heading_of_another_zero_is_reported_and_stays(offset_deg: float, tmp_path: Path) -> None:
    truth = Truth()
    summary, found = imported(tmp_path, standard_table(truth, heading_deg=(truth.heading_deg + offset_deg) % 360.0))
    side = "port" if offset_deg > 0 else "starboard"
    assert any(f"deg to {side} of it throughout" in remark for remark in summary.remarks)
    assert np.abs(angle_difference(found["heading_deg"], truth.heading_deg + offset_deg)).max() < 1e-9


@pytest.mark.parametrize("first", [-180.0, 0.0])
def test_both_turns_of_a_heading_are_the_same(first: float, tmp_path: Path) -> None:
    truth = Truth()
    frame = standard_table(truth, heading_deg=(truth.heading_deg - first) % 360.0 + first)
    assert_motion(imported(tmp_path, frame)[1], truth)


@pytest.mark.parametrize("name", ["yaw_rate_dps", "sway_mps"])
def test_a_sign_is_turned_by_heading_and_track(name: str, tmp_path: Path) -> None:
    truth = Truth()
    summary, found = imported(tmp_path, standard_table(truth, **{name: -getattr(truth, name)}))
    assert any(f"the sign of '{name}' is turned round" in remark for remark in summary.remarks)
    assert_motion(found, truth)


@pytest.mark.parametrize("exchanged", [False, True])
def test_speeds_along_north_and_east_become_surge_and_sway(exchanged: bool, tmp_path: Path) -> None:
    truth = Truth()
    velocity = (truth.surge_mps + 1j * truth.sway_mps) * np.exp(1j * np.deg2rad(truth.heading_deg))
    north, east = velocity.real, velocity.imag
    surge, sway = (east, north) if exchanged else (north, east)
    summary, found = imported(tmp_path, standard_table(truth, surge_mps=surge, sway_mps=sway))
    assert any("are speeds to" in remark for remark in summary.remarks)
    assert_motion(found, truth)


@pytest.mark.parametrize("name", ["speed_over_ground_mps", "surge_mps"])
def test_a_speed_in_knots_is_reported_with_its_likely_unit(name: str, tmp_path: Path) -> None:
    truth = Truth()
    frame = standard_table(truth, **{name: getattr(truth, name) / KNOT})
    summary, _ = imported(tmp_path, frame)
    assert any(name in remark and "knots" in remark for remark in summary.remarks)
    _, found = imported(tmp_path, frame, **{f"unit.{name}": "knots"})
    assert np.abs(found[name] - getattr(truth, name)).max() < 1e-6


def test_newest_rows_first_are_judged_in_their_order(tmp_path: Path) -> None:
    truth = Truth()
    frame = standard_table(truth, heading_deg=CONVENTIONS["from_east"](truth.heading_deg))
    _, found = imported(tmp_path, frame.iloc[::-1])
    assert_motion(found, truth)


def test_an_answer_to_no_question_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="rate_of_turn is to no question of this table"):
        imported(tmp_path, standard_table(Truth()), rate_of_turn="port")
    with pytest.raises(ConfigurationError, match=r"no question 'unit\.rudder'"):
        imported(tmp_path, standard_table(Truth()), **{"unit.rudder": "rad"})


@pytest.mark.parametrize("yaw_unit", ["deg", "rad"])
@pytest.mark.parametrize("axes", ["enu", "ned"])
def test_x_y_and_yaw_alone_are_mirror_images_and_asked_about(axes: str, yaw_unit: str, tmp_path: Path) -> None:
    from tests.acquisition.test_heading_columns import proposed
    from tests.acquisition.test_import_proposals import imported as imported_foreign

    truth = Truth()
    x, y, yaw = (truth.north_m, truth.east_m, truth.heading_deg)
    if axes == "enu":
        x, y, yaw = y, x, CONVENTIONS["from_east"](truth.heading_deg)
    scale = 1.0 if yaw_unit == "deg" else np.pi / 180.0
    frame = pd.DataFrame({"time": standard_table(truth)["time"], "x": x, "y": y, "yaw": scale * yaw})
    question = proposed(tmp_path, frame).unanswered[0]
    assert (question.key, question.options) == ("x_axis", ("north", "east"))
    assert "ENU" in question.text
    assert "NED" in question.text
    proposal, found = imported_foreign(tmp_path / "table.csv", x_axis={"enu": "east", "ned": "north"}[axes])
    assert not proposal.questions
    assert_motion(found[["heading_deg"]], truth)
    assert np.abs(found["north_m"] - truth.north_m).max() < 1e-6


def test_names_of_ros_state_their_axes_and_those_of_ships_theirs(tmp_path: Path) -> None:
    from tests.acquisition.test_heading_columns import proposed

    truth = Truth()
    time, yaw = standard_table(truth)["time"], CONVENTIONS["from_east"](truth.heading_deg)
    of_ros = {"pose.position.x": truth.east_m, "pose.position.y": truth.north_m, "yaw": yaw}
    proposal = proposed(tmp_path, pd.DataFrame({"time": time} | of_ros))
    assert not proposal.questions
    assert any("the names of ROS" in warning for warning in proposal.warnings)
    of_ships = {"x": truth.north_m, "y": truth.east_m, "psi": truth.heading_deg}
    assert not proposed(tmp_path, pd.DataFrame({"time": time} | of_ships)).questions
