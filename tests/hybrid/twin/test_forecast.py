"""A prediction from the newest second: that of the finished recording, as long as nothing lies ahead."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import seatrial as st
from seatrial.acquisition.core.errors import DataShortageError
from seatrial.acquisition.core.quantities import Series, rotate_earth_to_ship
from seatrial.acquisition.core.ship import NAMES
from seatrial.acquisition.logger.health import describe_schema_violation
from seatrial.acquisition.recording.messages import PREDICTION
from seatrial.acquisition.recording.reader import Recording, Tail, read_recording
from seatrial.analysis.tables.resample import resample
from seatrial.analysis.tables.table import read_table, table_of
from seatrial.analysis.windows.held import OneHertzTables
from seatrial.hybrid.calibrators import TrainedCalibrator
from seatrial.hybrid.calibrators.predict import predict
from seatrial.hybrid.effects import vessel_plant
from seatrial.hybrid.prediction.baselines import course_over_ground
from seatrial.hybrid.twin import (
    MeanErrors,
    RecentSamples,
    geographic_positions,
    newest_second_ns,
    predict_now,
    prediction_message_body,
    recording_at_rest,
    track_geojson,
)
from seatrial.hybrid.vessel.files import load_vessel
from seatrial.hybrid.vessel.plant import Plant
from tests.conftest import SMALL_HORIZON_S, Simulated
from tests.hybrid.twin.steady_ship import ORIGIN, write_steady

NANO = 1_000_000_000


def until(recording: Recording, end_ns: int, names: tuple[str, ...] = NAMES) -> Recording:
    """The recording as it stood at a moment; of ``names``, the other channels are whole."""
    series = {}
    for name, each in recording.series.items():
        there = each.measured_ns <= end_ns if name in names else np.ones(each.value.size, bool)
        columns = each.measured_ns[there], each.received_ns[there], each.value[there], each.quality[there]
        series[name] = Series(*columns, each.sources, each.source_index[there])
    return replace(recording, series=series)


@pytest.fixture(scope="module")
def voyage(simulated: Simulated) -> Recording:
    return read_recording(simulated("gentle", 101, 240.0, 10.0))


@pytest.mark.parametrize("with_calibrator", [False, True])
def test_it_is_the_prediction_of_the_recording_that_ends_there(
    voyage: Recording, small: TrainedCalibrator, with_calibrator: bool
) -> None:
    """From the last 75 s as read in pieces, against ``seatrial predict`` of all that came before."""
    trained = small if with_calibrator else None
    for second in (90, 151, 230):
        end_ns = int(voyage.series["heading_deg"].measured_ns[0]) + second * NANO + 430_000_000
        before = until(voyage, end_ns)
        recent = RecentSamples(75.0)
        recent.add(before.series)
        forecast = predict_now(recent.recording(voyage.trial, Path()), SMALL_HORIZON_S, small.plant, trained)
        table = resample(table_of(before))
        at = pd.Timestamp(end_ns // NANO * NANO, tz="UTC")
        expected = predict(OneHertzTables(table), at, SMALL_HORIZON_S, small.plant, trained)
        assert forecast.prediction.at == at
        assert forecast.held == ()
        assert forecast.prediction.method == expected.method
        np.testing.assert_allclose(forecast.prediction.track, expected.track, atol=1e-6)
        if with_calibrator:
            assert forecast.prediction.band_m is not None
            np.testing.assert_allclose(forecast.prediction.band_m, expected.band_m, atol=1e-6)


def test_what_is_read_from_the_file_is_what_predict_reads(tmp_path: Path, plant: Plant) -> None:
    write_steady(tmp_path / "steady.mcap", 90.0)
    recent = RecentSamples(75.0)
    with Tail(tmp_path / "steady.mcap", 75.0) as tail:
        recent.add(tail.read_new_samples())
        forecast = predict_now(recent.recording(tail.trial, tail.path), 15, plant)
    table = resample(read_table(tmp_path / "steady.mcap"))
    expected = predict(OneHertzTables(table), pd.Timestamp(table.index[-1]), 15, plant)
    assert forecast.prediction.at == expected.at
    np.testing.assert_allclose(forecast.prediction.track, expected.track, atol=1e-6)


def test_wind_and_thrusters_that_come_seldom_are_held_to_the_start_and_motion_is_not(
    voyage: Recording, plant: Plant
) -> None:
    end_ns = int(voyage.series["heading_deg"].measured_ns[0]) + 100 * NANO + 400_000_000
    before = until(voyage, end_ns)
    slow = until(before, end_ns - 2 * NANO, ("wind_speed_mps", "port_rpm"))
    forecast = predict_now(slow, 15, plant)
    assert forecast.prediction.at.value == end_ns // NANO * NANO
    assert forecast.held == ("wind_speed_mps", "port_rpm")
    series = slow.series["port_rpm"]
    assert forecast.table["port_rpm"].loc[forecast.prediction.at] == pytest.approx(series.value[-1], abs=1e-9)
    late = until(before, end_ns - 2 * NANO, ("north_m",))
    assert newest_second_ns(late) == end_ns // NANO * NANO - 2 * NANO
    assert predict_now(late, 15, plant).held == ()


@pytest.mark.parametrize("name", ["tunnel_rpm", "north_m"])
def test_a_channel_that_never_came_or_fell_silent_is_named(voyage: Recording, plant: Plant, name: str) -> None:
    without = replace(voyage, series={key: each for key, each in voyage.series.items() if key != name})
    with pytest.raises(DataShortageError, match=f"^{name} missing"):
        predict_now(without, 15, plant)
    if name == "tunnel_rpm":
        silent = until(voyage, int(voyage.series[name].measured_ns[-1]) - 20 * NANO, (name,))
        with pytest.raises(DataShortageError, match=f"^{name} missing"):
            predict_now(silent, 15, plant)


def test_less_than_a_whole_second_is_nothing_to_start_from(voyage: Recording, plant: Plant) -> None:
    """A recording that has just begun: its samples lie between two whole seconds."""
    begin = int(voyage.series["heading_deg"].measured_ns[0]) // NANO * NANO
    series = {}
    for name, each in voyage.series.items():
        there = (each.measured_ns > begin + 250_000_000) & (each.measured_ns < begin + 950_000_000)
        columns = each.measured_ns[there], each.received_ns[there], each.value[there], each.quality[there]
        series[name] = Series(*columns, each.sources, each.source_index[there])
    short = replace(voyage, series=series)
    assert newest_second_ns(short) is None
    with pytest.raises(DataShortageError, match="no whole second"):
        predict_now(short, 15, plant)
    assert newest_second_ns(until(voyage, begin + 1_050_000_000)) == begin + NANO


def test_only_the_last_seconds_are_kept(voyage: Recording) -> None:
    recent = RecentSamples(75.0)
    recent.add(voyage.series)
    for name, each in recent.recording(voyage.trial, Path()).series.items():
        newest = int(voyage.series[name].received_ns.max())
        assert recent.newest_received_ns - each.received_ns.min() == pytest.approx(75e9, abs=0.2e9), name
        assert each.received_ns.max() == newest
    recent.clear()
    assert recent.recording(voyage.trial, Path()).series == {}


def test_the_message_fits_the_schema_and_lies_where_the_ship_will_be(small: TrainedCalibrator) -> None:
    forecast = predict_now(recording_at_rest(75.0), SMALL_HORIZON_S, small.plant, small)
    prediction = forecast.prediction
    mean = 300.0, MeanErrors(0, 0)
    body = prediction_message_body(prediction, forecast.held, ORIGIN, ("x" * 300, "y"), 80 * NANO, 0.25, None, mean)
    assert describe_schema_violation(body, PREDICTION) == ""
    assert (body["start"], body["made_at"], body["horizon_s"]) == (75.0, 80.0, SMALL_HORIZON_S)
    track = body["track"]
    assert {len(each) for each in track.values()} == {SMALL_HORIZON_S + 1}
    assert track["band_m"][0] == 0.0
    assert track["latitude_deg"][0] == pytest.approx(ORIGIN[0], abs=1e-4)
    nowhere = prediction_message_body(prediction, (), None, ("x", "y"), 0, 0.0, None, mean)
    assert describe_schema_violation(nowhere, PREDICTION) == ""
    assert nowhere["track"]["latitude_deg"] == []
    assert track_geojson(prediction, None) == ""


def test_a_map_gets_the_track_longitude_first_and_a_ring_of_the_band(small: TrainedCalibrator) -> None:
    import json

    from seatrial.acquisition.core.quantities import TangentPlane

    prediction = predict_now(recording_at_rest(75.0), SMALL_HORIZON_S, small.plant, small).prediction
    line, region = json.loads(track_geojson(prediction, ORIGIN))["features"]
    plane = TangentPlane(*ORIGIN)
    for (longitude, latitude), (north_m, east_m, _) in zip(
        line["geometry"]["coordinates"], prediction.track, strict=True
    ):
        assert plane.north_east_m(latitude, longitude) == pytest.approx((north_m, east_m), abs=2e-3)
    (ring,) = region["geometry"]["coordinates"]
    assert ring[0] == ring[-1]
    assert prediction.region_m is not None
    north, east, course = *prediction.track[-1, :2], course_over_ground(prediction.track)[-1]
    for longitude, latitude in ring:
        north_m, east_m = plane.north_east_m(latitude, longitude)
        along, across = rotate_earth_to_ship(north_m - north, east_m - east, course) / prediction.region_m[-1]
        assert np.hypot(along, across) == pytest.approx(1.0, abs=2e-3)
    latitude, longitude = geographic_positions(np.array([0.0]), np.array([0.0]), ORIGIN)
    assert (latitude[0], longitude[0]) == pytest.approx(ORIGIN)


@pytest.mark.parametrize("vessel", ["kvlcc2_7m", "otter_2m"])
def test_a_ship_of_other_actuators_is_foretold_alike(vessel: str, tmp_path: Path) -> None:
    """Rudder and propellers; also of a ship at rest, for which all is compiled before."""
    st.simulate(tmp_path / "trial.mcap", vessel=vessel, manoeuvre="zigzag", duration_s=90.0, rate_hz=5.0)
    recording, plant = read_recording(tmp_path / "trial.mcap"), vessel_plant(load_vessel(vessel))
    forecast = predict_now(recording, SMALL_HORIZON_S, plant, None)
    table = resample(table_of(recording))
    expected = predict(OneHertzTables(table), forecast.prediction.at, SMALL_HORIZON_S, plant, None)
    np.testing.assert_allclose(forecast.prediction.track, expected.track, atol=1e-6)
    still = predict_now(recording_at_rest(30.0, plant.layout), SMALL_HORIZON_S, plant, None)
    assert not np.any(still.prediction.track)
