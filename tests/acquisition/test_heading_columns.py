"""Tables whose heading, rate of turn or speeds are in another convention than ours: corrected where track, course
and rate of turn decide, else asked, and never in silence."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pymap3d
import pytest

from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.acquisition.core.quantities import Floats
from seatrial.acquisition.core.ship import angle_difference
from seatrial.acquisition.tables.evidence import column_candidates
from seatrial.acquisition.tables.import_table import Proposal, import_table, propose_column_map
from seatrial.acquisition.tables.table_files import RawTable, read_raw_table
from seatrial.analysis.tables.table import read_table
from seatrial.hybrid.simulation.trial import simulate_trial
from tests.acquisition.test_import_proposals import PLACE, Truth, imported
from tests.conftest import nightly

MOTION = ("heading_deg", "surge_mps", "sway_mps", "yaw_rate_dps")
KNOT = 1852.0 / 3600.0


def table_of(truth: Truth, **columns: Floats) -> pd.DataFrame:
    """A table with times, positions and further columns."""
    frame = {
        "time": truth.local().strftime("%Y-%m-%dT%H:%M:%SZ"),
        "lat": truth.latitude_deg,
        "lon": truth.longitude_deg,
    }
    return pd.DataFrame(frame | columns)


def written(path: Path, frame: pd.DataFrame) -> Path:
    frame.to_csv(path / "table.csv", index=False)
    return path / "table.csv"


def proposed(path: Path, frame: pd.DataFrame, **answers: str) -> Proposal:
    return propose_column_map(read_raw_table(written(path, frame)), answers)


def assert_motion(found: pd.DataFrame, truth: Truth, tolerance: float = 0.2) -> None:
    """Heading and what was derived from it are the ship's; the ends, where slopes are one-sided, apart."""
    for name in MOTION:
        off = found[name].to_numpy() - truth.table[name].to_numpy()
        off = angle_difference(off, 0.0) if name == "heading_deg" else off
        assert np.nanmax(np.abs(off[3:-3])) < tolerance, name


CONVENTIONS = {
    "anticlockwise": lambda heading: (-heading) % 360.0,
    "from_east": lambda heading: (90.0 - heading + 180.0) % 360.0 - 180.0,
    "from_south": lambda heading: (180.0 - heading) % 360.0,
}


@pytest.mark.parametrize("place", [PLACE, (-33.9, 18.4), *nightly([40.0, 10.0], [1.0, 104.0])])
@pytest.mark.parametrize("name", CONVENTIONS)
def test_a_course_over_ground_decides_that_the_heading_is_wrong(
    name: str, place: tuple[float, float], tmp_path: Path
) -> None:
    truth = Truth(place=place)
    frame = table_of(truth, heading=CONVENTIONS[name](truth.heading_deg), cog=truth.course_over_ground_deg)
    proposal, found = imported(written(tmp_path, frame))
    assert not proposal.questions
    assert any("anticlockwise" in warning for warning in proposal.warnings)
    assert_motion(found, truth)


@pytest.mark.parametrize("answers", [{"variation": "-3"}, {}])
@pytest.mark.parametrize("name", ["HDG (°M)", "Heading [deg_mag]", *nightly("HDG (mag)", "HdgM", "Kompasskurs")])
def test_a_magnetic_heading_is_true_only_by_the_variation(
    name: str, answers: dict[str, str], tmp_path: Path
) -> None:
    """3 deg west of north, as answered or in a column; without it the column is no heading, and that is said."""
    truth, variation_deg = Truth(), -3.0
    frame = table_of(truth, **{name: (truth.heading_deg - variation_deg) % 360.0})
    assert any("magnetic north" in warning for warning in proposed(tmp_path, frame).warnings)
    assert "heading_deg = {" not in proposed(tmp_path, frame).text
    frame = frame if answers else frame.assign(**{"Magnetic Variation": variation_deg})
    proposal, found = imported(written(tmp_path, frame), **answers)
    assert not proposal.questions
    assert_motion(found, truth)


@pytest.mark.parametrize("name", ["HDG (°T)", "psi_m", "Heading MRU", "HDG_T", "compass_hdg"])
def test_a_heading_that_is_not_called_magnetic_is_true(name: str, tmp_path: Path) -> None:
    truth = Truth()
    proposal, found = imported(written(tmp_path, table_of(truth, **{name: truth.heading_deg})))
    assert not proposal.questions
    assert_motion(found, truth)


@pytest.mark.parametrize(
    ("name", "channel"), [("COG (°M)", "course_over_ground_deg"), ("TWD (mag)", "wind_direction_deg")]
)
@pytest.mark.parametrize("is_answered", [True, False])
def test_other_directions_from_magnetic_north_need_the_variation_too(
    name: str, channel: str, is_answered: bool, tmp_path: Path
) -> None:
    truth = Truth()
    frame = table_of(
        truth, **{"HDG": truth.heading_deg, "TWS [m/s]": truth.wind_speed_mps, name: truth.table[channel] + 7.0}
    )
    assert any("magnetic north" in warning for warning in proposed(tmp_path, frame).warnings)
    frame, answers = (
        (frame, {"variation": "-7"}) if is_answered else (frame.assign(**{"Variation [deg]": -7.0}), {})
    )
    _, found = imported(written(tmp_path, frame), **answers)
    assert np.abs(angle_difference(found[channel], truth.table[channel])).max() < 1e-6


@pytest.mark.parametrize(
    ("name", "place"),
    [("anticlockwise", (40.0, -74.0)), ("from_south", (-33.9, 18.4)), ("from_east", (57.6, 11.2)),
     ("from_east", (70.0, -150.0))],
)  # fmt: skip
def test_signs_of_the_hemisphere_and_short_degrees_of_longitude_decide_too(
    name: str, place: tuple[float, float], tmp_path: Path
) -> None:
    truth = Truth(place=place)
    proposal, found = imported(written(tmp_path, table_of(truth, yaw=CONVENTIONS[name](truth.heading_deg))))
    assert not proposal.questions
    assert_motion(found, truth)


@pytest.mark.parametrize("name", ["anticlockwise", "from_south"])
def test_where_positions_may_be_mirrored_instead_it_is_asked(name: str, tmp_path: Path) -> None:
    truth = Truth()
    frame = table_of(truth, heading=CONVENTIONS[name](truth.heading_deg))
    question = proposed(tmp_path, frame).unanswered[0]
    assert question.key == "heading"
    assert question.options == (name, "clockwise")
    assert "without their sign" in question.text
    proposal, found = imported(written(tmp_path, frame), heading=name)
    assert not proposal.questions
    assert_motion(found, truth)


@pytest.mark.parametrize("degrees", [0.0, 100.0])
def test_positions_that_do_not_move_along_the_course_are_said(degrees: float, tmp_path: Path) -> None:
    """Nearly straight on, or in a turn of 100 deg, at latitudes that lost their sign."""
    truth = Truth(place=(-33.9, 18.4))
    rows = slice(300, 390) if degrees else slice(0, 60)
    frame = table_of(
        truth, HDG=truth.heading_deg, cog=truth.course_over_ground_deg, sog=truth.speed_over_ground_mps
    )
    warning = "do not move along 'cog'"
    assert not any(warning in each for each in proposed(tmp_path, frame.iloc[rows]).warnings)
    mirrored = frame.assign(lat=-truth.latitude_deg).iloc[rows]
    assert any(warning in each for each in proposed(tmp_path, mirrored).warnings)


def test_positions_that_lost_their_sign_are_the_other_answer(tmp_path: Path) -> None:
    truth = Truth(place=(40.0, -74.0))
    frame = table_of(truth, heading=truth.heading_deg).assign(lon=-truth.longitude_deg)
    assert [each.key for each in proposed(tmp_path, frame).unanswered] == ["heading"]
    proposal, found = imported(written(tmp_path, frame), heading="clockwise")
    assert not proposal.questions
    assert np.abs(angle_difference(found["heading_deg"], truth.heading_deg)).max() < 1e-6


def test_near_the_equator_exchanged_positions_cannot_be_excluded(tmp_path: Path) -> None:
    truth = Truth(place=(1.3, 1.2))
    frame = table_of(truth, yaw=CONVENTIONS["from_east"](truth.heading_deg))
    question = proposed(tmp_path, frame).unanswered[0]
    assert question.options == ("from_east", "clockwise")
    assert "exchanged" in question.text


def test_exchanged_positions_are_no_heading_from_east(tmp_path: Path) -> None:
    truth = Truth()
    frame = table_of(truth, heading=truth.heading_deg).rename(columns={"lat": "lon", "lon": "lat"})
    assert any("axes exchanged" in each for each in proposed(tmp_path, frame).warnings)


def test_an_answer_is_honoured_without_a_question_and_a_wrong_one_refused(tmp_path: Path) -> None:
    truth = Truth()
    frame = table_of(truth, yaw=CONVENTIONS["from_east"](truth.heading_deg)).drop(columns=["lat", "lon"])
    _, found = imported(written(tmp_path, frame), heading="from_east")
    assert np.abs(angle_difference(found["heading_deg"], truth.heading_deg)).max() < 1e-6
    with pytest.raises(ConfigurationError, match="none of clockwise, anticlockwise"):
        proposed(tmp_path, frame, heading="upwards")


@pytest.mark.parametrize(("unit", "scale"), [("ddeg", 10.0), ("cdeg", 100.0)])
@pytest.mark.parametrize("column", ["Kurs rw", *nightly("heading", "hdg", "psi", "cap")])
def test_parts_of_a_degree_are_known_by_the_track(unit: str, scale: float, column: str, tmp_path: Path) -> None:
    truth = Truth()
    proposal, found = imported(written(tmp_path, table_of(truth, **{column: np.round(scale * truth.heading_deg)})))
    assert not proposal.questions
    assert any("of a degree" in warning for warning in proposal.warnings)
    assert np.abs(angle_difference(found["heading_deg"], truth.heading_deg)).max() <= 0.51 / scale
    assert next(each for each in proposal.readings if each.column == column).unit == unit


@pytest.mark.parametrize(
    ("head", "scale"), [("heading [0.1 deg]", 10.0), ("heading [cdeg]", 100.0), ("heading (deg/10)", 10.0)]
)
def test_parts_of_a_degree_are_known_by_the_head(head: str, scale: float, tmp_path: Path) -> None:
    truth = Truth()
    proposal, found = imported(written(tmp_path, table_of(truth, **{head: np.round(scale * truth.heading_deg)})))
    assert not proposal.questions
    assert np.abs(angle_difference(found["heading_deg"], truth.heading_deg)).max() <= 0.51 / scale


def test_a_head_that_the_track_contradicts_is_asked_about(tmp_path: Path) -> None:
    truth = Truth()
    frame = table_of(truth, **{"heading [deg]": np.round(10.0 * truth.heading_deg)})
    question = proposed(tmp_path, frame).unanswered[0]
    assert (question.key, question.options) == ("unit.heading [deg]", ("ddeg", "deg"))
    assert "tenths of a degree" in question.text
    proposal = propose_column_map(read_raw_table(written(tmp_path, frame)), {"unit.heading [deg]": "ddeg"})
    assert not proposal.unanswered


def test_a_course_of_an_ais_receiver_is_in_tenths(tmp_path: Path) -> None:
    truth = Truth()
    frame = table_of(truth, heading=truth.heading_deg, cog=np.round(10.0 * truth.course_over_ground_deg))
    proposal, found = imported(written(tmp_path, frame))
    assert not proposal.questions
    off = angle_difference(found["course_over_ground_deg"], truth.course_over_ground_deg)
    assert np.abs(off).max() < 0.06


@pytest.mark.parametrize("heading", ["right", "anticlockwise"])
@pytest.mark.parametrize("sense", [1.0, -1.0])
@pytest.mark.parametrize("column", ["rot [deg/s]", *nightly("yaw rate [deg/s]", "Drehrate [°/s]")])
def test_the_rate_of_turn_is_judged_by_a_heading_that_was_judged_first(
    heading: str, sense: float, column: str, tmp_path: Path
) -> None:
    truth = Truth(place=(40.0, -74.0))
    recorded = truth.heading_deg if heading == "right" else CONVENTIONS[heading](truth.heading_deg)
    proposal, found = imported(
        written(tmp_path, table_of(truth, heading=recorded, **{column: sense * truth.yaw_rate_dps}))
    )
    assert not proposal.questions
    assert_motion(found, truth)
    assert any(f"the sign of {column!r} is turned" in each for each in proposal.warnings) == (sense < 0.0)


def test_a_right_rate_of_turn_decides_between_heading_and_positions(tmp_path: Path) -> None:
    truth = Truth()
    frame = table_of(truth, heading=CONVENTIONS["anticlockwise"](truth.heading_deg), rot=truth.yaw_rate_dps)
    proposal, found = imported(written(tmp_path, frame.rename(columns={"rot": "rot [deg/s]"})))
    assert not proposal.questions
    assert_motion(found, truth)


def test_without_a_track_the_sign_of_a_rate_of_turn_can_be_answered(tmp_path: Path) -> None:
    truth = Truth()
    frame = table_of(truth, heading=truth.heading_deg, **{"rot [deg/s]": -truth.yaw_rate_dps}).drop(
        columns=["lat", "lon"]
    )
    proposal, found = imported(written(tmp_path, frame))
    assert [(each.key, each.default) for each in proposal.questions] == [("rate_of_turn", "port")]
    assert any("no track confirms" in each for each in proposal.warnings)
    assert np.abs(found["yaw_rate_dps"] - truth.yaw_rate_dps).max() < 1e-6
    kept = propose_column_map(read_raw_table(tmp_path / "table.csv"), {"rate_of_turn": "starboard"})
    assert not any("sign of" in each for each in kept.warnings)


RUDDERS_BY_SIGN = {
    1.0: (
        "Rudder angle [deg, + stbd]",
        "Rudder (STBD +ve) [deg]",
        "Ruderlage [°] (+ Stb)",
        "Rudder (-port/+stbd) [deg]",
    ),
    -1.0: ("rudder_deg_port_positive", "Rudder, positive to port [deg]", "Rudder (stbd negative) [deg]"),
}


@pytest.mark.parametrize(
    ("sign", "head"), [(sign, head) for sign, heads in RUDDERS_BY_SIGN.items() for head in heads]
)
@pytest.mark.parametrize("turns", [True, False])
def test_the_side_that_counts_positive_is_no_place_on_the_ship(
    head: str, sign: float, turns: bool, tmp_path: Path
) -> None:
    """The ship has one rudder; where no turning shows how it counts, its head does."""
    truth = Truth()
    frame = table_of(truth, heading=truth.heading_deg, **{"rpm": truth.rpm, head: sign * truth.rudder})
    if not turns:
        frame = frame.assign(heading=40.0, lat=PLACE[0] + 5e-5 * np.arange(len(frame)), lon=PLACE[1])
    proposal, found = imported(written(tmp_path, frame))
    assert not proposal.unanswered
    assert np.abs(found["rudder_angle_deg"] - truth.rudder).max() < 1e-6
    assert any("sign of" in each for each in proposal.warnings) == (sign < 0.0)


@pytest.mark.parametrize("name", ["yaw_rate_dps", "sway_mps"])
def test_a_head_says_that_a_motion_counts_to_port_where_no_track_does(name: str, tmp_path: Path) -> None:
    truth, head = Truth(), {"yaw_rate_dps": "ROT [deg/s, + port]", "sway_mps": "sway (port positive) [m/s]"}[name]
    frame = table_of(truth, heading=truth.heading_deg, **{head: -truth.table[name].to_numpy()})
    proposal, found = imported(written(tmp_path, frame.drop(columns=["lat", "lon"])))
    assert not [each for each in proposal.questions if each.key == "rate_of_turn"]
    assert np.abs(found[name] - truth.table[name]).max() < 1e-6


@pytest.mark.parametrize("head", ["Rudder - port [deg]", "Rudder pos port [deg]", "Port rudder [deg] (+ stbd)"])
def test_a_side_without_a_sign_is_a_place(head: str, tmp_path: Path) -> None:
    truth = Truth()
    _, found = imported(written(tmp_path, table_of(truth, heading=truth.heading_deg, **{head: truth.rudder})))
    assert "port_rudder_angle_deg" in found


@pytest.mark.parametrize(
    "heads", [("u [kn]", "v [kn]"), *nightly(["u", "v"], ["u [m/s]", "v [m/s]"], ["vx [m/s]", "vy [m/s]"])]
)
@pytest.mark.parametrize("axes", ["north_east", "east_north"])
def test_speeds_along_north_and_east_are_no_surge_and_sway(
    axes: str, heads: tuple[str, str], tmp_path: Path
) -> None:
    truth = Truth()
    heading = np.deg2rad(truth.heading_deg)
    north = truth.surge_mps * np.cos(heading) - truth.sway_mps * np.sin(heading)
    east = truth.surge_mps * np.sin(heading) + truth.sway_mps * np.cos(heading)
    pair = (north, east) if axes == "north_east" else (east, north)
    scale = KNOT if "kn" in heads[0] else 1.0
    frame = table_of(
        truth, heading=truth.heading_deg, **{head: each / scale for head, each in zip(heads, pair, strict=True)}
    )
    proposal, found = imported(written(tmp_path, frame))
    assert not proposal.unanswered
    assert any("speeds to" in each and "surge and sway are made of them" in each for each in proposal.warnings)
    for name in ("surge_mps", "sway_mps"):
        assert np.abs(found[name] - truth.table[name].to_numpy()).max() < 1e-6


def test_a_quaternion_of_north_east_down_is_known_by_the_track(tmp_path: Path) -> None:
    truth = Truth()
    half = np.deg2rad(truth.heading_deg) / 2.0
    names = ("orientation.x", "orientation.y", "orientation.z", "orientation.w")
    columns = dict(zip(names, (0.0 * half, 0.0 * half, np.sin(half), np.cos(half)), strict=True))
    proposal, found = imported(written(tmp_path, table_of(truth, **columns)))
    assert any("north, east and down" in each for each in proposal.warnings)
    assert_motion(found, truth)


def test_a_straight_course_is_asked_about_and_left_as_it_is(tmp_path: Path) -> None:
    t = np.arange(300.0)
    north, east = 5.0 * t * np.cos(np.deg2rad(120.0)), 5.0 * t * np.sin(np.deg2rad(120.0))
    latitude, longitude, _ = pymap3d.ned2geodetic(north, east, 0.0, *PLACE, 0.0)
    times = (pd.Timestamp("2026-05-03") + pd.to_timedelta(t, unit="s")).strftime("%Y-%m-%dT%H:%M:%SZ")
    frame = pd.DataFrame({"time": times, "lat": latitude, "lon": longitude, "heading": 240.0})
    proposal, found = imported(written(tmp_path, frame))
    assert [(each.key, each.default) for each in proposal.questions] == [("heading", "clockwise")]
    assert any("120 deg to port" in each and "anticlockwise from north" in each for each in proposal.warnings)
    assert (found["heading_deg"] == 240.0).all()


@pytest.mark.parametrize("first", [-179.0, -150.0, -30.0, 170.0, 0.5])
def test_headings_of_minus_180_to_180_under_the_usual_names_are_turned(first: float, tmp_path: Path) -> None:
    heading = (first + np.arange(0.0, 60.0, 0.5) + 180.0) % 360.0 - 180.0
    times = pd.date_range("2026-05-03", periods=heading.size, freq="s").strftime("%Y-%m-%dT%H:%M:%SZ")
    frame = pd.DataFrame({"time": times, "north_m": 0.0, "heading_deg": heading})
    summary = import_table(written(tmp_path, frame), tmp_path / "out.mcap", allow_missing=True)
    assert not summary.out_of_range
    assert np.abs(angle_difference(read_table(tmp_path / "out.mcap")["heading_deg"], heading)).max() < 1e-9


@pytest.mark.parametrize("peak", [180.0, 180.4, 186.0])
def test_a_heading_that_hardly_crosses_the_seam_of_minus_180_is_turned(peak: float, tmp_path: Path) -> None:
    truth = peak - 60.0 * np.abs(np.linspace(-1.0, 1.0, 121))
    heading = (truth + 180.0) % 360.0 - 180.0
    times = pd.date_range("2026-05-03", periods=heading.size, freq="s").strftime("%Y-%m-%dT%H:%M:%SZ")
    frame = pd.DataFrame({"time": times, "north_m": 0.0, "heading_deg": heading})
    summary = import_table(written(tmp_path, frame), tmp_path / "out.mcap", allow_missing=True)
    assert not summary.out_of_range
    assert np.abs(angle_difference(read_table(tmp_path / "out.mcap")["heading_deg"], truth)).max() < 1e-9


@pytest.mark.parametrize("code", [-1.0, -99.0, 511.0])
def test_a_code_for_no_value_is_no_angle(code: float, tmp_path: Path) -> None:
    times = pd.date_range("2026-05-03", periods=50, freq="s").strftime("%Y-%m-%dT%H:%M:%SZ")
    heading = np.where(np.arange(50) % 7 == 3, code, np.linspace(10.0, 60.0, 50))
    frame = pd.DataFrame({"time": times, "north_m": 0.0, "heading_deg": heading})
    summary = import_table(written(tmp_path, frame), tmp_path / "out.mcap", allow_missing=True)
    assert summary.out_of_range == {"heading_deg": 7}


@pytest.mark.parametrize("vessel", ["gunnerus_long", *nightly("otter_2m", "kvlcc2_7m", "esso_osaka_3m")])
@pytest.mark.parametrize("manoeuvre", ["zigzag_20_20", "turning_circle_35", "stopping", "tunnel_test"])
def test_nothing_is_asked_or_turned_of_simulated_ships(vessel: str, manoeuvre: str, tmp_path: Path) -> None:
    trial, _ = simulate_trial(vessel, "gentle", manoeuvre, 300.0, 1.0, 5)
    names = {"north_m": "north [m]", "east_m": "east [m]", "heading_deg": "heading [deg]", "surge_mps": "u [m/s]",
             "sway_mps": "v [m/s]", "yaw_rate_dps": "r [deg/s]"}  # fmt: skip
    frame = trial[[*names]].rename(columns=names)
    frame.insert(0, "time", trial.index.strftime("%Y-%m-%dT%H:%M:%S.%fZ"))
    proposal = proposed(tmp_path, frame)
    assert not proposal.questions
    assert not [each for each in proposal.warnings if "turn" in each or "speeds to" in each]


@pytest.mark.shared
@pytest.mark.parametrize("name", ["Z_10_01", "Z_10_10_P", "Z_20_10_S", "Z_35_05"])
def test_the_speeds_of_a_towing_tank_are_along_its_axes(name: str, shared_data: Path, tmp_path: Path) -> None:
    raw = read_raw_table(shared_data / "kvlcc2_hsva" / f"{name}.csv.gz")
    proposal = propose_column_map(raw, {})
    assert any("speeds to north and to east" in each for each in proposal.warnings)
    assert any("positive turned the ship to port" in each for each in proposal.warnings)
    assert not proposal.unanswered


MAGNETIC = ("HDG (M)", "Heading (deg M)", "HDG_M", "Kompasskurs")
MORE_MAGNETIC = ("HDG [°M]", "Heading [deg_mag]", "Heading °(mag)", "HDGM")


@pytest.mark.parametrize("head", [*MAGNETIC, *nightly(*MORE_MAGNETIC)])
def test_a_heading_marked_as_magnetic_is_no_true_one(head: str, tmp_path: Path) -> None:
    """Without the variation it stays magnetic; with it, answered or of a column, it is the heading."""
    truth, variation = Truth(), 4.2
    frame = table_of(truth, **{head: (truth.heading_deg - variation) % 360.0})
    proposal = proposed(tmp_path, frame)
    assert "heading_magnetic_deg" in {reading.taken_for for reading in proposal.readings}
    assert "heading_deg" not in {reading.taken_for for reading in proposal.readings}
    assert any("variation" in warning for warning in proposal.warnings)
    _, answered = imported(written(tmp_path, frame), variation="4.2")
    assert_motion(answered, truth)
    frame["Variation [deg]"] = variation
    (tmp_path / "beside").mkdir()
    _, measured = imported(written(tmp_path / "beside", frame))
    assert_motion(measured, truth)


@pytest.mark.parametrize("head", ["COG (M)", "COG [deg_mag]", "Wind direction (M)", "TWD [°M]", "Course [deg M]"])
def test_other_directions_from_magnetic_north_are_not_taken(head: str, tmp_path: Path) -> None:
    truth = Truth()
    proposal = proposed(
        tmp_path, table_of(truth, heading=truth.heading_deg, **{head: truth.course_over_ground_deg})
    )
    assert {reading.taken_for for reading in proposal.readings if reading.column == head} <= {"-"}


def test_a_unit_beside_the_name_may_be_the_mark(tmp_path: Path) -> None:
    """In a row of units, or in the attributes of a log."""
    raw = RawTable(tmp_path / "x", pd.DataFrame({"hdg": [1.0]}), units={"hdg": "°M"}, meanings={"hdg": "heading"})
    assert [candidate.quantity.name for candidate in column_candidates(raw)] == ["heading_magnetic_deg"]


@pytest.mark.parametrize("head", ["Wind direction 10 m [deg]", "wind_dir_10m", "Windrichtung_MW", "TWD_10m"])
def test_heights_and_means_are_no_magnetic_north(head: str, tmp_path: Path) -> None:
    truth = Truth()
    frame = table_of(truth, heading=truth.heading_deg, **{head: np.full(len(truth.heading_deg), 120.0)})
    frame["Variation [deg]"] = 3.0
    proposal = proposed(tmp_path, frame.assign(**{"Wind speed [m/s]": 5.0}))
    readings = [reading for reading in proposal.readings if reading.column == head]
    assert readings[0].taken_for != "-"
    assert not any("magnetic" in reason for reading in readings for reason in reading.reasons)


@pytest.mark.parametrize("head", ["Shaft kW", "shaft_temp", "Shaft_Trq"])
def test_other_quantities_of_a_shaft_are_not_its_speed(head: str, tmp_path: Path) -> None:
    truth = Truth()
    proposal = proposed(tmp_path, table_of(truth, heading=truth.heading_deg, **{head: truth.heading_deg}))
    assert head not in {reading.column for reading in proposal.readings if reading.taken_for.endswith("_rpm")}
