"""One prediction: from where, with which method, inside which band, in the contract's units."""

from __future__ import annotations

import json
from dataclasses import replace
from io import StringIO
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from rich.console import Console

from seatrial.acquisition.core.errors import InputError, ModelRangeError
from seatrial.acquisition.core.ship import NAMES, angle_difference
from seatrial.analysis.tables.resample import resample
from seatrial.analysis.tables.table import read_table
from seatrial.analysis.windows.held import OneHertzTables
from seatrial.hybrid.calibrators import TrainedCalibrator
from seatrial.hybrid.calibrators.predict import (
    Prediction,
    choose_predictor,
    mean_planned_controls,
    parse_start_time,
    predict,
    read_commands,
    window_starting_at,
)
from seatrial.hybrid.prediction.baselines import simulate_reference
from seatrial.hybrid.prediction.kalman_filter import filtered_starts
from seatrial.hybrid.report.text import prediction_table
from seatrial.hybrid.vessel.files import load_vessel
from seatrial.hybrid.vessel.plant import Plant
from tests.conftest import SMALL_HORIZON_S


@pytest.fixture(scope="module")
def table(unseen: Path) -> pd.DataFrame:
    return resample(read_table(unseen))


def at(table: pd.DataFrame, seconds: float) -> pd.Timestamp:
    return pd.Timestamp(table.index[0]) + pd.Timedelta(seconds=seconds)


def test_a_time_may_be_written_in_three_ways(table: pd.DataFrame) -> None:
    """ISO 8601 with any zone, seconds since 1970, seconds from the start: one instant."""
    wanted = at(table, 90.0)
    oslo = wanted.tz_convert("Europe/Oslo").isoformat()
    for text in (wanted.isoformat(), wanted.isoformat().replace("+00:00", "Z"), oslo, "+90",
                 str(int(wanted.timestamp()))):  # fmt: skip
        assert parse_start_time(text, table) == wanted, text
    assert parse_start_time("+90.5", table) == at(table, 90.5)


@pytest.mark.parametrize(
    "text", ["", "noon", "+", "+x", "+nan", "+inf", "+1e300", "9" * 30, "2026-13-01T00:00:00Z"]
)
def test_what_is_no_time_is_said_with_an_example(text: str, table: pd.DataFrame) -> None:
    with pytest.raises(InputError, match="write it like 2026-06-01T08:00:00"):
        parse_start_time(text, table)


@pytest.mark.parametrize("text", ["2026-06-01T08:01:00", "2026-06-01", "NaT"])
def test_a_time_without_a_zone_is_none(text: str, table: pd.DataFrame) -> None:
    with pytest.raises(InputError, match=r"zone|is not a time"):
        parse_start_time(text, table)


@pytest.mark.parametrize("seconds", [-1.0, -1e6, 1200.0, 1e6])
def test_outside_the_recording_says_what_is_inside(seconds: float, table: pd.DataFrame, plant: Plant) -> None:
    with pytest.raises(InputError, match="is outside the recording; choose from 2026-06-01T08:00:00"):
        predict(OneHertzTables(table), at(table, seconds), 15, plant)


def test_without_a_calibrator_it_is_the_reference(table: pd.DataFrame, plant: Plant) -> None:
    found = predict(OneHertzTables(table), at(table, 300.0), 20, plant)
    windows, covered = window_starting_at(OneHertzTables(table), at(table, 300.0), 20)
    windows = filtered_starts(windows, plant)
    assert covered
    assert found.method == "reference"
    assert found.band_m is None
    assert np.array_equal(found.track, simulate_reference(windows, plant)[0])


def test_with_a_calibrator_it_is_the_hybrid_in_its_band(
    table: pd.DataFrame, plant: Plant, small: TrainedCalibrator
) -> None:
    """Track and band are those of the calibrator beside the baselines; the band is nothing at the start."""
    found = predict(OneHertzTables(table), at(table, 300.0), SMALL_HORIZON_S, plant, small)
    windows, _ = window_starting_at(OneHertzTables(table), at(table, 300.0), SMALL_HORIZON_S)
    windows = filtered_starts(windows, plant)
    assert found.method == "hybrid"
    expected = small.predict_tracks(windows, simulate_reference(windows, plant))
    assert np.array_equal(found.track, expected.tracks[0])
    assert found.band_m is not None
    assert found.band_m[0] == 0.0
    assert (np.diff(found.band_m) >= 0.0).all()
    assert found.region_m is not None
    assert np.array_equal(found.region_m[1:], expected.region_m[0])
    assert np.array_equal(found.band_m[1:], expected.region_m[0].max(axis=-1))


def test_a_calibrator_predicts_its_own_horizon_at_the_most(
    table: pd.DataFrame, plant: Plant, small: TrainedCalibrator
) -> None:
    whole, part = (
        predict(OneHertzTables(table), at(table, 300.0), horizon_s, plant, small)
        for horizon_s in (SMALL_HORIZON_S, SMALL_HORIZON_S - 10)
    )
    assert part.track == pytest.approx(whole.track[: SMALL_HORIZON_S - 9], abs=1e-6)
    horizon_s = SMALL_HORIZON_S + 10
    with pytest.raises(InputError, match=f"predicts at most {SMALL_HORIZON_S} s, not {horizon_s} s"):
        predict(OneHertzTables(table), at(table, 300.0), horizon_s, plant, small)


def test_it_starts_at_the_nearest_second_near_the_ship(table: pd.DataFrame, plant: Plant) -> None:
    """The smoothed start lies within the waves' reach of what was measured there."""
    found = predict(OneHertzTables(table), at(table, 300.4), 10, plant)
    assert found.at == at(table, 300.0)
    measured = table.loc[found.at]
    assert np.hypot(*(found.track[0, :2] - measured[["north_m", "east_m"]].to_numpy())) < 2.0
    assert abs(float(angle_difference(np.rad2deg(found.track[0, 2]), measured["heading_deg"]))) < 5.0


def test_the_measured_track_stands_beside_it_while_there_is_one(table: pd.DataFrame, plant: Plant) -> None:
    inside, beyond = (predict(OneHertzTables(table), at(table, seconds), 15, plant) for seconds in (600.0, 1190.0))
    assert inside.measured is not None
    expected = table.loc[inside.at :, ["north_m", "east_m"]].iloc[:16].to_numpy()
    assert inside.measured[:, :2] == pytest.approx(expected)
    assert beyond.measured is None
    assert len(beyond.track) == 16


def test_json_has_one_object_a_second(table: pd.DataFrame, plant: Plant) -> None:
    """Finite numbers, headings in 0 to 360."""
    plain = json.loads(
        json.dumps(predict(OneHertzTables(table), at(table, 600.0), 15, plant).as_dict(), allow_nan=False)
    )
    assert set(plain) >= {"at", "horizon_s", "method", "track"}
    assert plain["horizon_s"] == 15
    assert [row["second"] for row in plain["track"]] == list(range(16))
    assert set(plain["track"][0]) == {
        "second", "north_m", "east_m", "heading_deg", "band_m", "band_along_m", "band_across_m",
        "measured_north_m", "measured_east_m",
    }  # fmt: skip
    assert all(0.0 <= row["heading_deg"] < 360.0 for row in plain["track"])


@pytest.mark.parametrize("name", NAMES)
def test_a_hole_at_the_start_is_named(name: str, table: pd.DataFrame, plant: Plant) -> None:
    holed = table.copy()
    holed.loc[at(table, 300.0), name] = np.nan
    with pytest.raises(InputError, match=f"{name} has no value at .*choose another time"):
        predict(OneHertzTables(holed), at(table, 300.0), 15, plant)


def test_only_the_start_is_used(table: pd.DataFrame, plant: Plant, small: TrainedCalibrator) -> None:
    """Thrusters and wind after the start change nothing: what is to come is not known."""
    later = table.copy()
    later.loc[at(table, 301.0) :, ["port_rpm", "starboard_angle_deg", "wind_speed_mps"]] += 20.0
    for trained in (None, small):
        there = predict(OneHertzTables(later), at(table, 300.0), SMALL_HORIZON_S, plant, trained)
        here = predict(OneHertzTables(table), at(table, 300.0), SMALL_HORIZON_S, plant, trained)
        assert np.array_equal(here.track, there.track)


def test_a_model_out_of_its_range_is_no_prediction(table: pd.DataFrame, plant: Plant) -> None:
    """Twenty-five metres a second is no speed of this ship: an error, not a track of NaN."""
    fast = table.assign(surge_mps=25.0)
    with pytest.raises(ModelRangeError, match="leaves its valid range"):
        predict(OneHertzTables(fast), at(table, 300.0), 15, plant)


@pytest.mark.parametrize("horizon_s", [1, 7, 10, 15, 29, 60])
def test_the_table_has_the_start_and_the_end(horizon_s: int, table: pd.DataFrame, plant: Plant) -> None:
    """A dozen rows or so at any horizon, the last second among them."""
    shown = prediction_table(predict(OneHertzTables(table), at(table, 300.0), horizon_s, plant))
    seconds = [str(each) for each in shown.columns[0].cells]
    assert (seconds[0], seconds[-1]) == ("0", str(horizon_s))
    assert len(seconds) <= 22


def plan(folder: Path, text: str) -> Path:
    """A file of planned orders."""
    path = folder / "plan.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_planned_orders_steer_and_what_is_not_planned_goes_on(
    table: pd.DataFrame, plant: Plant, tmp_path: Path
) -> None:
    """Both pods to starboard from the fifth second on: as before until then, then to port; a change of half a
    second
    later is that much later."""
    text = "second,port_angle_deg,starboard_angle_deg\n{},20,20\n"
    plans = [None, *(read_commands(plan(tmp_path, text.format(when)), plant.layout) for when in (5.0, 5.5))]
    held, turned, later = (
        predict(OneHertzTables(table), at(table, 300.0), 20, plant, commands=each).track for each in plans
    )
    assert turned[:6] == pytest.approx(held[:6], abs=1e-3)
    assert np.rad2deg(turned[-1, 2] - held[-1, 2]) < -3.0
    assert turned[-1, 2] < later[-1, 2] < held[-1, 2]


def test_a_plan_in_times_is_the_plan_in_seconds_from_the_start_until_it_is_over(
    table: pd.DataFrame, plant: Plant, tmp_path: Path
) -> None:
    """The order before the start holds, the last one for a horizon; then what is ordered now goes on."""
    recorded, start = OneHertzTables(table), at(table, 300.0)

    def track(text: str) -> np.ndarray:
        orders = read_commands(plan(tmp_path, text), plant.layout)
        return predict(recorded, start, 20, plant, commands=orders).track

    seconds = "second,port_angle_deg\n0,10\n7.5,-20"
    first, then, past = (start + pd.Timedelta(seconds=each) for each in (-9.0, 7.5, -19.0))
    assert np.array_equal(
        track(f"time,port_angle_deg\n{first.isoformat()},10\n{then.isoformat()},-20"), track(seconds)
    )
    assert np.array_equal(
        track(f"time,port_angle_deg\n{first.timestamp()},10\n{then.timestamp()},-20"), track(seconds)
    )
    held = predict(recorded, start, 20, plant)
    assert not held.planned
    for no_plan in (past - pd.Timedelta(seconds=1), start + pd.Timedelta(seconds=20)):
        assert np.array_equal(track(f"time,port_angle_deg\n{no_plan.isoformat()},10"), held.track)
    assert np.array_equal(
        track(f"time,port_angle_deg\n{past.isoformat()},10"), track("second,port_angle_deg\n0,10")
    )


def test_orders_are_averaged_the_shorter_way_round(plant: Plant, tmp_path: Path) -> None:
    """An azimuth ordered from 170 to -170 degrees half-way through a second has been at 180 on the mean."""
    now = np.array([2.0, np.deg2rad(170.0), 2.0, 0.0, 0.0])
    orders = read_commands(plan(tmp_path, "second,port_angle_deg,port_rpm\n0.5,-170,60"), plant.layout)
    mean = mean_planned_controls(orders, now, plant.layout, 2)
    assert np.rad2deg(mean[:, 1]) == pytest.approx([180.0, 190.0])
    assert mean[:, 0] == pytest.approx([1.5, 1.0])
    assert (mean[:, 2:] == now[2:]).all()


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("port_rpm\n1", "no column second or time"),
        ("second,time,port_rpm\n1,1,1", "give second or time"),
        ("time,port_rpm\n2026-06-01 10:00,1", "no zone"),
        ("time,port_rpm\nnoon,1", "not an ISO 8601"),
        ("time,port_rpm\n20,1\n10,1", "times do not increase"),
        ("second,port_rpm\ninf,1", "not numbers"),
        ("second,rudder_deg\n0,1", "port_rpm, port_angle_deg"),
        ("second\n0", "each at most once"),
        ("second,port_rpm\n0,fast", "not numbers"),
        ("second,port_rpm\n", "no row"),
        ("second,port_rpm\n5,1\n5,2", "do not increase"),
    ],
)
def test_a_plan_that_cannot_be_followed_says_why(text: str, why: str, plant: Plant, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=rf"plan\.csv.*{why}|{why}.*plan\.csv"):
        read_commands(plan(tmp_path, text), plant.layout)


def test_a_calibrator_of_held_controls_follows_no_plan(
    table: pd.DataFrame, plant: Plant, small: TrainedCalibrator, tmp_path: Path
) -> None:
    orders = read_commands(plan(tmp_path, "second,port_rpm\n0,100"), plant.layout)
    with pytest.raises(InputError, match=r"held controls.*--commands"):
        predict(OneHertzTables(table), at(table, 300.0), 15, plant, small, orders)


def test_no_number_is_cut_off_in_a_terminal_of_80_columns() -> None:
    """Heads may be broken, numbers and names not: far from the origin they are long."""
    track = np.tile([-12345.67, -23456.78, 6.0], (SMALL_HORIZON_S + 1, 1))
    region_m = np.full((SMALL_HORIZON_S + 1, 2), 1234.5)
    shown = Prediction(pd.Timestamp("2026-06-01T08:00:00Z"), "hybrid", track, region_m, track)
    console = Console(width=80, file=StringIO(), record=True)
    console.print(shown)
    text = console.export_text()
    assert text.count("-12345.67") == text.count("-23456.78") == 2 * text.count("1234.50")
    assert "\u2026" not in text


def test_model_with_an_error_of_a_sensor_says_that_predictions_do_not_correct_it() -> None:
    """A diagnosis takes the antenna's place off what it compares; a prediction starts from what was recorded."""
    ship = load_vessel("gunnerus_short")
    moved = replace(ship, effects={"position_antenna_offset": {"forward_m": -9.0, "starboard_m": 0.0}})
    assert "not corrected" not in str(choose_predictor({}, vessel=ship).choice)
    assert "position antenna offset in its file are not corrected" in str(choose_predictor({}, vessel=moved).choice)
