"""What is made of one recording: complete or not there, the same bytes each time, honest about what is missing."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seatrial.acquisition.core.errors import InputError, StorageError
from seatrial.acquisition.core.ship import NAMES
from seatrial.acquisition.core.trial import Trial
from seatrial.acquisition.recording.writer import write_table
from seatrial.analysis import batch
from seatrial.analysis.batch import (
    SUMMARY,
    distance_sailed_m,
    process_recording,
    recordings_below,
    reusable_row,
    track_polyline_points,
)
from seatrial.analysis.products import error_cause_text
from seatrial.analysis.tables.export import read_parquet
from seatrial.analysis.windows.held import read_windows
from tests.analysis.conftest import table_at
from tests.analysis.small_batch import QUICK, hashes, sailed

SMOOTHED = replace(QUICK, smooth=True)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("recordings") / "trial_1.mcap"
    write_table(sailed(), path, Trial(name="trial 1", vessel="gunnerus_short", place="Trondheim"))
    return path


@pytest.fixture(scope="module")
def result(recording: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("results") / "trial_1"
    process_recording(recording, folder, SMOOTHED)
    return folder


def test_what_only_began_like_a_manoeuvre_is_said_with_the_reason(tmp_path: Path) -> None:
    """Four minutes of a turn so slow that every stretch of it seems straight."""
    seconds = np.arange(240.0)
    turning = table_at(seconds, {name: np.zeros(240) for name in NAMES}).assign(
        heading_deg=seconds / 9.0, yaw_rate_dps=1.0 / 9.0, surge_mps=4.0, port_rpm=120.0, starboard_rpm=120.0,
        north_m=np.cumsum(4.0 * np.cos(np.deg2rad(seconds / 9.0))),
        east_m=np.cumsum(4.0 * np.sin(np.deg2rad(seconds / 9.0))),
    )  # fmt: skip
    write_table(turning, tmp_path / "turn.mcap", Trial(name="turn"))
    process_recording(tmp_path / "turn.mcap", tmp_path / "turn", QUICK)
    found = json.loads((tmp_path / "turn" / "manoeuvres.json").read_text())
    assert [(each["kind"], each["why"]) for each in found["left_out"]] == [
        ("speed_run", "the ship turned by 27 deg")
    ]
    assert json.loads((tmp_path / "turn" / SUMMARY).read_text())["left_out"] == {"speed_run": 1}
    assert "left out, no speed run: the ship turned by 27 deg" in (tmp_path / "turn" / "page.html").read_text()


def test_a_result_is_a_folder_of_products_that_say_where_they_come_from(recording: Path, result: Path) -> None:
    row = json.loads((result / SUMMARY).read_text())
    table, metadata = read_parquet(result / "table.parquet")
    assert list(table.columns[: len(NAMES)]) == list(NAMES)
    assert json.loads(metadata["provenance"]) == row["provenance"]
    assert row["provenance"]["bytes"] == recording.stat().st_size
    assert (table["north_m_sigma"] > 0).all()
    flags, _ = read_parquet(result / "flags.parquet")
    assert (len(flags), set(flags.columns)) == (240, set(NAMES))
    assert set(json.loads((result / "quality.json").read_text())) >= {"channels", "findings", "provenance"}
    assert "manoeuvres" in json.loads((result / "manoeuvres.json").read_text())
    assert read_windows(result / "windows.parquet").kept == row["windows_kept"] > 0
    assert row["provenance"]["sha256"] in (result / "page.html").read_text()
    assert (row["status"], row["cause"], row["samples"]) == ("done", "", 13 * 240)


def test_the_bytes_depend_on_recording_and_options_alone(recording: Path, result: Path, tmp_path: Path) -> None:
    elsewhere = tmp_path / "another" / "place" / recording.name
    elsewhere.parent.mkdir(parents=True)
    elsewhere.write_bytes(recording.read_bytes())
    process_recording(elsewhere, tmp_path / "out", SMOOTHED)
    assert hashes(tmp_path / "out") == hashes(result)
    assert not any(str(tmp_path).encode() in path.read_bytes() for path in (tmp_path / "out").iterdir())


def test_parts_are_one_trial(tmp_path: Path) -> None:
    """What is made of a recording in three parts is what is made of it in one file, each sample once."""
    table, trial = sailed(), Trial(name="trial", vessel="gunnerus_short")
    whole = write_table(table, tmp_path / "whole.mcap", trial)
    names = [f"trial_20260517T120000Z{part}.mcap" for part in ("", "_part00002", "_part00003")]
    assert whole == sum(
        write_table(table.iloc[first:end], tmp_path / name, trial)
        for name, first, end in zip(names, (0, 100, 170), (100, 170, 240), strict=True)
    )
    found = recordings_below(tmp_path, tmp_path / "out")
    assert [[path.name for path in each] for each in found] == [names, ["whole.mcap"]]
    rows = [
        process_recording(paths[0], tmp_path / "out" / str(number), QUICK, "trial", paths[1:])
        for number, paths in enumerate(found)
    ]
    assert [row["parts"] for row in rows] == [3, 1]
    same = rows[0].keys() - {"provenance", "parts"}
    assert {name: rows[0][name] for name in same} == {name: rows[1][name] for name in same}
    tables = [read_parquet(tmp_path / "out" / str(number) / "table.parquet")[0] for number in range(2)]
    pd.testing.assert_frame_equal(*tables)
    digests = [hashlib.sha256((tmp_path / name).read_bytes()).hexdigest() for name in names]
    assert rows[0]["provenance"]["sha256"] == ", ".join(digests)


def test_a_result_is_used_again_only_for_the_same_recording_options_and_name(
    recording: Path, result: Path, tmp_path: Path
) -> None:
    assert reusable_row(recording, result, SMOOTHED) == json.loads((result / SUMMARY).read_text())
    assert reusable_row(recording, result, replace(QUICK, stride_s=7)) is None
    assert reusable_row(recording, result, SMOOTHED, name="another") is None
    assert reusable_row(recording, tmp_path, SMOOTHED) is None
    changed = tmp_path / recording.name
    changed.write_bytes(recording.read_bytes() + b"\0")
    assert reusable_row(changed, result, SMOOTHED) is None


def test_what_fails_on_the_way_leaves_the_earlier_result_and_no_trace(
    recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    process_recording(recording, tmp_path / "out", QUICK)
    before = hashes(tmp_path)

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(batch, "write_json_file", interrupted)
    with pytest.raises(KeyboardInterrupt):
        process_recording(recording, tmp_path / "out", replace(QUICK, stride_s=7))
    assert hashes(tmp_path) == before
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_a_result_takes_an_earlier_ones_place_and_nothing_elses(recording: Path, tmp_path: Path) -> None:
    first, second = (
        process_recording(recording, tmp_path / "out", replace(QUICK, stride_s=stride)) for stride in (5, 7)
    )
    assert first["windows_candidates"] > second["windows_candidates"]
    assert json.loads((tmp_path / "out" / SUMMARY).read_text()) == second
    (tmp_path / "notes").mkdir()
    (tmp_path / "notes" / "mine.txt").write_text("mine")
    with pytest.raises(StorageError, match="not a result of an earlier batch"):
        process_recording(recording, tmp_path / "notes")
    assert (tmp_path / "notes" / "mine.txt").read_text() == "mine"


def test_of_an_incomplete_recording_what_can_be_made_is_made(tmp_path: Path) -> None:
    path = tmp_path / "no_position.mcap"
    write_table(sailed().drop(columns=["north_m", "east_m"]), path, Trial())
    row = process_recording(path, tmp_path / "out", QUICK)
    assert row["status"] == "failed"
    assert "north_m, east_m" in row["cause"]
    assert str(tmp_path) not in row["cause"]
    assert (row["distance_m"], row["track"], row["windows_kept"]) == (None, "", None)
    assert (row["channels"], row["missing"]) == (11, ["north_m", "east_m"])
    assert len(read_parquet(tmp_path / "out" / "table.parquet")[0]) == 120
    assert "north_m, east_m" in (tmp_path / "out" / "page.html").read_text()


def test_a_ship_without_a_tunnel_thruster_still_has_her_motion_with_uncertainties(tmp_path: Path) -> None:
    path = tmp_path / "plain.mcap"
    write_table(sailed().drop(columns=["tunnel_rpm", "wind_direction_deg"]), path, Trial("plain", "ship"))
    row = process_recording(path, tmp_path / "out", SMOOTHED)
    table, _ = read_parquet(tmp_path / "out" / "table.parquet")
    assert "heading_deg_sigma" in table
    assert row["windows_kept"] > 0
    assert "wind_direction_deg" in row["missing"]  # of which windows do without


def test_the_page_says_which_uncertainties_are_in_doubt(tmp_path: Path) -> None:
    """A speed that is 30 % too high cannot agree with the positions, and no band can be believed."""
    table = sailed(300)
    write_table(table.assign(surge_mps=1.3 * table["surge_mps"]), tmp_path / "fast.mcap", Trial("fast", "ship"))
    process_recording(tmp_path / "fast.mcap", tmp_path / "out", replace(SMOOTHED, repair=False))
    assert "doubtful" in (tmp_path / "out" / "page.html").read_text()


def test_a_clock_that_was_set_by_years_is_an_error_and_not_a_table_of_years(tmp_path: Path) -> None:
    table = sailed(seconds=20)
    late = pd.DatetimeIndex(table.index) + pd.Timedelta(days=3650)
    path = tmp_path / "jump.mcap"
    write_table(pd.concat([table, table.set_axis(late.rename("time"), axis=0)]), path, Trial())
    with pytest.raises(InputError, match="3,650 days"):
        process_recording(path, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_what_is_no_recording_is_one_error(tmp_path: Path) -> None:
    (tmp_path / "x.mcap").mkdir()
    for name in ("x.mcap", "not_there.mcap"):
        with pytest.raises(InputError, match=name):
            process_recording(tmp_path / name, tmp_path / "out")


@given(st.floats(0.5, 12.0), st.floats(-2.0, 2.0), st.floats(0.0, 360.0))
def test_the_distance_is_that_of_the_arc(speed_mps: float, yaw_rate_dps: float, heading_deg: float) -> None:
    time_s = np.arange(600.0)
    heading = np.radians(heading_deg + yaw_rate_dps * time_s)
    track = table_at(
        time_s,
        {"north_m": np.cumsum(speed_mps * np.cos(heading)), "east_m": np.cumsum(speed_mps * np.sin(heading))},
    )
    assert distance_sailed_m(track) == pytest.approx(599.0 * speed_mps, rel=0.02)


def test_the_noise_of_a_position_does_not_add_up_to_a_voyage() -> None:
    random = np.random.default_rng(1)
    time_s = np.arange(600.0)
    noisy = table_at(
        time_s, {name: 3.0 * time_s + 0.5 * random.standard_normal(600) for name in ("north_m", "east_m")}
    )
    assert distance_sailed_m(noisy) == pytest.approx(599.0 * 3.0 * np.sqrt(2.0), rel=0.02)
    assert distance_sailed_m(noisy.assign(north_m=np.nan)) is None


@given(st.lists(st.tuples(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6)), min_size=2, max_size=200))
def test_a_thumbnail_is_small_and_inside_its_frame(points: list[tuple[float, float]]) -> None:
    north, east = zip(*points, strict=True)
    drawn = [
        tuple(map(float, point.split(",")))
        for point in track_polyline_points(
            table_at(np.arange(len(points)), {"north_m": north, "east_m": east})
        ).split()
    ]
    assert 1 <= len(drawn) <= 60
    assert all(0.0 <= value <= 100.0 for point in drawn for value in point)


def test_a_thumbnail_has_north_up_and_east_to_the_right() -> None:
    track = table_at(np.arange(2), {"north_m": [0.0, 10.0], "east_m": [0.0, 10.0]})
    (x0, y0), (x1, y1) = (map(float, point.split(",")) for point in track_polyline_points(track).split())
    assert x1 > x0
    assert y1 < y0


def test_one_cause_reads_the_same_for_every_recording_that_has_it() -> None:
    errors = [InputError("is empty", where=f"/data/{name}", fix="give another") for name in "ab"]
    assert {error_cause_text(error) for error in errors} == {"is empty; give another"}
    with pytest.raises(ValueError, match="Expecting") as caught:
        json.loads("{")
    assert "JSONDecodeError: Expecting property name" in error_cause_text(caught.value)


def test_windows_and_their_starts_say_where_they_come_from(recording: Path, result: Path) -> None:
    digest = hashlib.sha256(recording.read_bytes()).hexdigest()
    for name in ("windows.parquet", "windows.starts.parquet"):
        (said,) = json.loads(read_parquet(result / name)[1]["provenance"]).values()
        assert (said["recording"], said["recording_sha256"]) == ("trial_1.mcap", digest)
        assert "smooth" in [step["step"] for step in said["history"]]
        assert str(recording.parent) not in json.dumps(said)


def test_one_stamp_of_1970_costs_a_row_and_not_the_recording(tmp_path: Path) -> None:
    table = sailed(seconds=120)
    times = pd.DatetimeIndex(table.index).insert(0, pd.Timestamp(0, tz="UTC")).delete(1)
    write_table(table.set_axis(times.rename("time"), axis=0), tmp_path / "first.mcap", Trial())
    row = process_recording(tmp_path / "first.mcap", tmp_path / "out", QUICK)
    assert row["findings_by_code"]["time_outlier"] == 1
    assert 100.0 < row["duration_s"] < 130.0
