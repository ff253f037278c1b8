"""Logs of other programs: every format by its own library, with a truth that the recording has to hold."""

from __future__ import annotations

import bz2
import datetime as dt
import gzip
import json
import lzma
import shutil
import sqlite3
import struct
import tempfile
import zipfile
from collections.abc import Callable
from contextlib import closing
from decimal import Decimal
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pymap3d
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.io import netcdf_file
from scipy.spatial.transform import Rotation

import seatrial
from seatrial.acquisition.core.errors import ConfigurationError, InputError, SourceError
from seatrial.acquisition.core.trial import NANO
from seatrial.acquisition.recording.reader import read_recording
from seatrial.acquisition.tables.import_table import import_proposed, propose_column_map
from seatrial.acquisition.tables.log_frames import LogField, attitude_of_quaternion
from seatrial.acquisition.tables.table_files import times_since
from seatrial.acquisition.tables.topics import (
    LogTopic,
    TopicLog,
    log_format,
    read_log,
    read_table_or_log,
    rows_by_time,
)
from tests.acquisition import log_trip
from tests.acquisition.log_trip import Trip, trip
from tests.conftest import nightly

Writer = Callable[[Path, Trip], None]

FORMATS: dict[str, tuple[str, Writer]] = {
    "rosbag2 mcap": ("bag", partial(log_trip.write_bag, storage="mcap")),
    "rosbag2 mcap in NED": ("bag", partial(log_trip.write_bag, storage="mcap", ned=True)),
    "rosbag2 db3": ("bag", partial(log_trip.write_bag, storage="db3")),
    "rosbag1": ("trip.bag", partial(log_trip.write_bag, storage="bag")),
    "MCAP of JSON": ("trip.mcap", log_trip.write_json_mcap),
    "MCAP of protobuf": ("trip.mcap", log_trip.write_protobuf_mcap),
    "ULog": ("trip.ulg", log_trip.write_ulog),
    "DataFlash": ("trip.bin", log_trip.write_dataflash),
    "DataFlash as text": ("trip.log", log_trip.write_dataflash_text),
    "MDF": ("trip.mf4", log_trip.write_mdf),
    "MDF as .dat": ("trip.dat", log_trip.write_mdf),
    "TDMS": ("trip.tdms", log_trip.write_tdms),
    "HDF5": ("trip.h5", log_trip.write_hdf5),
    "NumPy": ("trip.npz", log_trip.write_npz),
    "JSON lines": ("trip.jsonl", log_trip.write_json_lines),
    "long JSON lines": ("trip.ndjson", log_trip.write_long_json_lines),
    "SQLite": ("trip.sqlite", log_trip.write_sqlite),
    "long SQLite": ("trip.db", log_trip.write_long_sqlite),
    "historian in SQLite": ("trip.db", log_trip.write_historian),
    "JSON array": ("trip.json", log_trip.write_json_array),
    "JSON columns": ("trip.json", log_trip.write_json_columns),
    "MQTT in JSON lines": ("trip.jsonl", log_trip.write_mqtt_json_lines),
    "Parquet folder": ("parts", log_trip.write_parquet_folder),
    "Parquet dataset": ("parts", log_trip.write_parquet_dataset),
}
IN_PROCESS = pytest.mark.usefixtures("read_in_process")
"""What is tested is not the process that reads a log: that is :func:`test_damaged_log_is_one_line`, and by night
:func:`test_trip_in_any_format_is_imported_as_it_was`."""
LEFT_OPEN = ("DataFlash", "DataFlash as text")
"""Formats whose library never closes a file: in a process of its own that is no harm."""
IN_MICROSECONDS = ("ULog", "DataFlash", "DataFlash as text")


ENDS_WHERE_POWER_DID = ("ULog", "DataFlash", "DataFlash as text", "TDMS", "JSON lines", "long JSON lines",
                        "MQTT in JSON lines", "MCAP of protobuf")  # fmt: skip
"""Formats that are written until the power goes: what is before is read, with a remark."""


def import_log(source: Path, folder: Path, answers: dict[str, str] | None = None) -> tuple[Any, Any]:
    """The recording and the proposal of a log, by what is proposed."""
    raw = read_table_or_log(source, answers=answers)
    proposal = propose_column_map(raw, answers)
    target = folder / "imported.mcap"
    import_proposed(raw, proposal, target, folder / "imported.columns.toml", force=True)
    return read_recording(target), proposal


def assert_holds(recording: Any, truth: Trip, tolerance: float = 1e-9, names: tuple[str, ...] = ()) -> None:
    """Every channel of the truth, with its own stamps to the nanosecond."""
    for name in names or truth.channels:
        ns, values = truth.of(name)
        series = recording.series[name]
        np.testing.assert_array_equal(series.measured_ns, ns, err_msg=name)
        turn = 360.0 if name == "heading_deg" else np.inf
        error = np.abs(series.value - values)
        error = np.minimum(error, np.abs(turn - error)) if np.isfinite(turn) else error
        assert error.max() < max(tolerance * np.abs(values).max(), 1e-12), (name, error.max())


@pytest.mark.parametrize("name", [*(name for name in FORMATS if name != "MDF as .dat"), *nightly("MDF as .dat")])
@pytest.mark.parametrize("own_process", [False, *nightly(True)])
def test_trip_in_any_format_is_imported_as_it_was(
    name: str, own_process: bool, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    if not own_process and name not in LEFT_OPEN:
        request.getfixturevalue("read_in_process")
    unit_ns = 1000 if name in IN_MICROSECONDS else 1  # GPS time in a DataFlash log is of milliseconds
    truth = trip(resolution_ns=unit_ns, start_ns=log_trip.START_NS // 1_000_000 * 1_000_000)
    file, write = FORMATS[name]
    write(tmp_path / file, truth)
    recording, proposal = import_log(tmp_path / file, tmp_path)
    assert not proposal.unanswered
    if name in IN_MICROSECONDS:  # their velocities are north and east, turned by a heading between its samples
        names = ("latitude_deg", "longitude_deg", "heading_deg", "yaw_rate_dps")
        assert_holds(recording, truth, 1e-5, names)
        for channel in ("surge_mps", "sway_mps"):
            series, (ns, values) = recording.series[channel], truth.of(channel)
            truth_at = np.interp(series.measured_ns - ns[0], ns - ns[0], values)
            np.testing.assert_allclose(series.value, truth_at, atol=2e-3)
        return
    assert_holds(recording, truth)


@IN_PROCESS
def test_signal_k_is_in_its_units_and_of_its_own_vessel(tmp_path: Path) -> None:
    truth = trip()
    log_trip.write_signal_k(tmp_path / "trip.jsonl", truth)
    recording, proposal = import_log(tmp_path / "trip.jsonl", tmp_path)
    assert not proposal.unanswered
    assert_holds(recording, truth, names=(*log_trip.SIGNAL_K, "latitude_deg", "longitude_deg"))
    left_out = read_log(tmp_path / "trip.jsonl", log_format(tmp_path / "trip.jsonl")).left_out
    other, own = (f"vessels.urn:mrn:imo:mmsi:25700000{number}" for number in (2, 1))
    assert left_out == {other: ("", 3 * truth.ns["gps"].size, f"another vessel than {own}")}
    assert "propeller_rpm" not in recording.series


@IN_PROCESS
def test_hdf5_by_the_conventions_of_netcdf_is_unpacked_and_dated(tmp_path: Path) -> None:
    """A scale that is left out would be wrong without a word, a moment that is left out be 1970."""
    truth = trip()
    log_trip.write_cf_hdf5(tmp_path / "trip.h5", truth)
    recording, _ = import_log(tmp_path / "trip.h5", tmp_path)
    for name in truth.channels:
        ns, values = truth.of(name)
        series = recording.series[name]
        assert np.abs(series.measured_ns - ns[:-1]).max() < 1000, name  # hours as a float
        np.testing.assert_allclose(series.value, values[:-1], rtol=1e-9, err_msg=name)


@IN_PROCESS
@pytest.mark.parametrize(("unit", "calendar", "says"), [
    ("days since 0001-01-01", "standard", "calendars differ before 1582"),
    ("days since 2000-01-01", "noleap", "the calendar 'noleap'"),
    ("days since the departure", "standard", "count from 'the departure'"),
])  # fmt: skip
def test_times_of_other_calendars_are_no_dates(unit: str, calendar: str, says: str, tmp_path: Path) -> None:
    with netcdf_file(tmp_path / "x.nc", "w") as file:
        file.createDimension("time", 3)
        time = file.createVariable("time", "f8", ("time",))
        time[:], time.units, time.calendar = [1.0, 2.0, 3.0], unit, calendar
    with pytest.raises(InputError, match=says):
        read_table_or_log(tmp_path / "x.nc")


@given(st.integers(-(10**17), 4 * 10**18), st.sampled_from(["s", "ms", "us", "days", "Hours"]), st.booleans())
def test_times_since_a_moment_are_those_of_the_count(ns: int, unit: str, is_early: bool) -> None:
    """However far back the moment is; whole counts keep the nanosecond."""
    step_ns = {"s": NANO, "ms": 10**6, "us": 1000, "days": 86_400 * NANO, "Hours": 3600 * NANO}[unit]
    moment = pd.Timestamp("1601-01-01 00:00:30") if is_early else pd.Timestamp("2026-05-17T12:00:00.25+02:00")
    epoch_s = (
        (moment.tz_convert(None) if moment.tz else moment).to_datetime64().astype("datetime64[ms]").astype(int)
    )
    count = (ns - int(epoch_s) * 10**6) // step_ns
    times = times_since(np.array([count]), f"{unit} since {moment}", Path("x"))
    assert times is not None
    assert times.asi8[0] == int(epoch_s) * 10**6 + count * step_ns


@IN_PROCESS
@pytest.mark.parametrize(("ned", "faster_turns", "answer"), [
    (False, 1.0, ""), (True, 1.0, "north"), (False, -1.0, "east"),
])  # fmt: skip
def test_mirror_image_is_asked_where_the_propellers_show_it(
    ned: bool, faster_turns: float, answer: str, tmp_path: Path
) -> None:
    """Odometry to the north, the east and down in frames that do not say so contradicts but the propellers."""
    truth = log_trip.write_odometry(tmp_path / "bag", ned=ned, faster_turns=faster_turns)
    raw = read_table_or_log(tmp_path / "bag")
    assert [question.key for question in propose_column_map(raw).unanswered] == (["x_axis"] if answer else [])
    recording, _ = import_log(tmp_path / "bag", tmp_path, {"x_axis": answer} if answer else None)
    for name, values in truth.items():
        np.testing.assert_allclose(recording.series[name].value, values, atol=1e-9, err_msg=name)


def test_outputs_of_an_autopilot_are_read_by_its_parameters(tmp_path: Path) -> None:
    """Asked are the angle and the speed at full output; a reversed output counts the other way."""
    truth = trip(400)
    parameters = {f"SERVO{number}_FUNCTION": function for number, function in ((1, 26.0), (2, 33.0), (3, 70.0))}
    parameters |= {"SERVO3_REVERSED": 1.0}
    log_trip.write_dataflash(tmp_path / "trip.bin", truth, parameters)
    answers = {"full_scale.rudder": "30", "full_scale.propeller": "1000"}
    recording, _ = import_log(tmp_path / "trip.bin", tmp_path, answers)
    for name, sign, step in (("rudder_angle_deg", 1.0, 0.075), ("propeller_rpm", -1.0, 2.5)):
        expected = sign * truth.channels[name][1]
        np.testing.assert_allclose(recording.series[name].value, expected, atol=0.51 * step, err_msg=name)
    questions = propose_column_map(read_table_or_log(tmp_path / "trip.bin")).questions
    assert {question.key for question in questions} == set(answers)


@IN_PROCESS
def test_columns_of_a_map_are_read_from_a_log(tmp_path: Path) -> None:
    """A map may name fields that are no channels by their names."""
    truth = trip(60)
    log_trip.write_bag(tmp_path / "trip.bag", truth, storage="bag")
    map_file = tmp_path / "map.toml"
    map_file.write_text(
        '[[actuator]]\nname = "rudder"\nkind = "rudder"\n[time]\ncolumn = "time"\nformat = "iso"\n[channels]\n'
        'rudder_angle_deg = { column = "/rudder/angle_deg.data", unit = "deg", scale = -1.0 }\n'
        'roll_deg = { column = "/imu/data.linear_acceleration.z", unit = "deg" }\n'
    )
    seatrial.import_table(tmp_path / "trip.bag", tmp_path / "o.mcap", columns=map_file, allow_missing=True)
    series = read_recording(tmp_path / "o.mcap").series
    np.testing.assert_allclose(series["rudder_angle_deg"].value, -truth.of("rudder_angle_deg")[1])
    np.testing.assert_allclose(series["roll_deg"].value, 9.8)


def test_info_shows_topics_before_anything_is_asked(tmp_path: Path, command: Any) -> None:
    truth = trip(60)
    log_trip.write_bag(tmp_path / "trip.bag", truth, storage="bag")
    log_trip.write_json_mcap(tmp_path / "trip.mcap", truth)
    contents = json.loads(command("info", tmp_path / "trip.bag", "--json").out)
    assert contents["topics"]["/gnss/fix"]["count"] == 60
    assert contents["topics"]["/gnss/fix"]["rate_hz"] == pytest.approx(5.0)
    assert contents["topics"]["/gnss/fix"]["fields"]["latitude"] == "deg"
    assert contents["left_out"]["/empty"]["reason"] == "empty"
    assert "/gyro" in command("info", tmp_path / "trip.mcap").out
    assert "import it first" in command("check", tmp_path / "trip.mcap").err


@IN_PROCESS
def test_recording_is_not_imported_again(tmp_path: Path) -> None:
    log_trip.write_hdf5(tmp_path / "trip.h5", trip(60))
    import_log(tmp_path / "trip.h5", tmp_path)
    with pytest.raises(InputError, match="is a recording already"):
        read_table_or_log(tmp_path / "imported.mcap")


ALIKE_IF_DAMAGED = ("rosbag2 mcap in NED", "MDF as .dat", "long JSON lines", "MQTT in JSON lines", "JSON columns",
                    "long SQLite", "historian in SQLite")  # fmt: skip
"""Formats whose file is of the same kind as that of another."""


@pytest.mark.parametrize("damage", ["cut", *nightly("head", "noise")])
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[pytest.mark.slow] if name in ALIKE_IF_DAMAGED else [])
        for name in FORMATS
        if not name.startswith("Parquet")
    ],
)
def test_damaged_log_is_one_line(name: str, damage: str, tmp_path: Path) -> None:
    """Cut short, full of noise, or empty: an error that names the file, or what is intact with a remark."""
    file, write = FORMATS[name]
    source = tmp_path / file
    write(source, trip(80))
    target = (
        next(path for path in source.rglob("*") if path.suffix in (".mcap", ".db3")) if source.is_dir() else source
    )
    whole = target.read_bytes()
    noise = np.random.default_rng(1).integers(0, 256, 4000, dtype=np.uint8).tobytes()
    target.write_bytes({"cut": whole[: len(whole) // 2], "noise": noise, "head": whole[:40] + noise}[damage])
    if damage == "cut" and name in ENDS_WHERE_POWER_DID:
        assert read_table_or_log(source).remarks
        return
    with pytest.raises(InputError) as refused:
        read_table_or_log(source)
    assert str(source) in str(refused.value)
    assert "\n" not in str(refused.value)


AS_SOURCES = ("rosbag2 mcap", "rosbag2 db3", "rosbag1", "MCAP of JSON", "MCAP of protobuf", "ULog", "DataFlash",
              "DataFlash as text", "MDF", "TDMS", "HDF5")  # fmt: skip


@pytest.mark.parametrize("name", AS_SOURCES)
def test_log_of_topics_as_a_source_names_the_command_that_reads_it(name: str, tmp_path: Path) -> None:
    """It holds no frames that could be replayed; no empty recording is left behind."""
    file, write = FORMATS[name]
    write(tmp_path / file, trip(120))
    paths = [tmp_path / file, *(tmp_path / file).glob("*.db3"), *(tmp_path / file).glob("*.mcap")]
    for path in paths:
        (tmp_path / "trial.toml").write_text(
            '[trial]\nname = "x"\n[[source]]\nname = "log"\ntype = "file"\n'
            f'path = "{path}"\nchannels = ["heading_deg"]\n'
        )
        with pytest.raises(SourceError, match=f"`seatrial import {path} -o {path.stem}") as refused:
            seatrial.record(tmp_path / "trial.toml", tmp_path / "out")
        assert "\n" not in str(refused.value)
        assert not list((tmp_path / "out").glob("*"))
        if path != tmp_path / file:  # one of a folder
            assert len(read_table_or_log(path).names) > 4


MDF_VALUES = """
latitude_deg = { topic = "gps", field = "Latitude", unit = "deg" }
longitude_deg = { topic = "gps", field = "Longitude", unit = "deg" }
heading_deg = { topic = "gyro", field = "Heading", unit = "deg" }
yaw_rate_dps = { topic = "gyro", field = "Rate of turn", unit = "deg/s" }
surge_mps = { topic = "log", field = "Surge", unit = "m/s" }
sway_mps = { topic = "log", field = "Sway", unit = "m/s" }
"""


def topic_file(path: Path, values: str) -> Path:
    """A configuration with a log of topics as its source."""
    names = [line.partition(" ")[0] for line in values.split("\n") if line]
    names += ["north_m", "east_m"] if "latitude_deg" in names else []
    config = path.with_name("trial.toml")
    config.write_text(
        f'[trial]\nname = "x"\n[[source]]\nname = "log"\ntype = "topic_file"\npath = "{path}"\n'
        f"channels = {json.dumps(names)}\n[source.values]\n{values}"
    )
    return config


@IN_PROCESS
def test_log_of_topics_is_recorded_by_a_map_of_its_fields(tmp_path: Path) -> None:
    """With its own stamps and positions in the plane; decoded again from what was kept raw it is the same."""
    truth = trip(300)
    log_trip.write_mdf(tmp_path / "trip.mf4", truth)
    (path,) = seatrial.record(topic_file(tmp_path / "trip.mf4", MDF_VALUES), tmp_path / "out")
    recording = read_recording(path)
    assert_holds(recording, truth, 1e-12, ("latitude_deg", "longitude_deg", "heading_deg", "surge_mps", "sway_mps"))
    assert recording.series["north_m"].value.size == truth.ns["gps"].size
    assert sum(recording.raw.values()) == 900
    seatrial.redecode(path, tmp_path / "again.mcap")
    again = read_recording(tmp_path / "again.mcap")
    for name, series in recording.series.items():
        np.testing.assert_array_equal(again.series[name].value, series.value)
        np.testing.assert_array_equal(again.series[name].measured_ns, series.measured_ns)


@IN_PROCESS
@pytest.mark.parametrize(
    ("values", "said"),
    [
        (
            'heading_deg = { topic = "gyro", field = "Heding", unit = "deg" }\n',
            "has no gyro Heding; `seatrial info",
        ),
        ('heading_deg = { topic = "gyro", field = "Heading", unit = "m" }\n', "heading_deg"),
        ("", "needs values"),
    ],
)
def test_map_of_fields_that_a_log_has_not_is_one_line(values: str, said: str, tmp_path: Path) -> None:
    log_trip.write_mdf(tmp_path / "trip.mf4", trip(60))
    with pytest.raises((SourceError, ConfigurationError), match=said) as refused:
        seatrial.record(topic_file(tmp_path / "trip.mf4", values), tmp_path / "out")
    assert "\n" not in str(refused.value)


PACKED = ("ULog", "DataFlash as text", "DataFlash", "MDF as .dat", "rosbag1", "SQLite")
PACKERS = (gzip, lzma, bz2)


@pytest.mark.parametrize(
    ("name", "module"),
    [  # by day each way of packing once, with formats that are known by their suffix, a text or a head
        pytest.param(name, packer, marks=[] if number == place else [pytest.mark.slow])
        for number, name in enumerate(PACKED)
        for place, packer in enumerate(PACKERS)
    ],
    ids=lambda value: getattr(value, "__name__", value),
)
def test_packed_log_is_the_log(name: str, module: Any, tmp_path: Path) -> None:
    """And a cut one is refused in a line; nothing is left where it was unpacked."""
    file, write = FORMATS[name]
    write(tmp_path / file, trip(200))
    packed = tmp_path / f"{file}.{ {gzip: 'gz', bz2: 'bz2', lzma: 'xz'}[module] }"
    packed.write_bytes(module.compress((tmp_path / file).read_bytes()))
    plain, unpacked = read_table_or_log(tmp_path / file), read_table_or_log(packed)
    pd.testing.assert_frame_equal(plain.columns, unpacked.columns)
    assert (plain.name, plain.units, plain.meanings) == (unpacked.name, unpacked.units, unpacked.meanings)
    packed.write_bytes(packed.read_bytes()[:-200])
    with pytest.raises(InputError, match=r"damaged, cut short|unknown file type"):
        read_table_or_log(packed)


def test_packed_log_that_unpacks_to_far_more_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where the reading is killed, nothing of it stays on the disk."""
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(scratch))
    monkeypatch.setenv("SEATRIAL_BUDGET", "0.4")
    path = tmp_path / "bomb.ulg.xz"
    path.write_bytes(20 * lzma.compress(bytes(20_000_000), preset=0))  # streams in a row are one
    with pytest.raises(InputError, match="budget"):
        read_table_or_log(path)
    assert not list(scratch.iterdir())


def test_other_logs_of_the_same_suffix_are_no_dataflash(tmp_path: Path) -> None:
    """Sentences, candump and a text that speaks of formats; a note before the first format is no hindrance."""
    for text in ("$HEHDT,12.5,T*2A\n", "(1779019200.0) can0 09F11203#00\n", "FMT, what we ate\nGPS, 1, 2\n", ""):
        (tmp_path / "a.log").write_text(text)
        assert log_format(tmp_path / "a.log") is None, text
    log_trip.write_dataflash_text(tmp_path / "b.log", trip(60))
    plain = read_table_or_log(tmp_path / "b.log")
    text = (tmp_path / "b.log").read_text()
    damaged = "ArduRover V4.5\n" + text.replace("\nGPS, ", "\nGPS, x", 1).replace("\nATT, ", "\nATT, \xff\xfe, ", 1)
    (tmp_path / "b.log").write_bytes(damaged.encode("latin-1"))
    raw = read_table_or_log(tmp_path / "b.log")
    assert any("2 lines are damaged" in remark for remark in raw.remarks)
    for column in ("GPS.Lat", "ATT.Yaw", "IMU.GyrZ"):
        lost = plain.columns[column].count() - raw.columns[column].count()
        assert lost == (column != "IMU.GyrZ"), column


def test_measurement_under_another_suffix_is_known_by_its_head(tmp_path: Path) -> None:
    path = tmp_path / "trip.dat.bz2"
    for head, is_measurement in ((b"MDF     4.10    ", True), (b"time;heading\n", False)):
        path.write_bytes(bz2.compress(head))
        form = log_format(path)
        assert (form is not None and form.name == "ASAM MDF") == is_measurement


def test_archive_that_unpacks_to_far_more_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "bomb.npz"
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("time.npy", "w", force_zip64=True) as stream,
    ):
        head = (
            b"\x93NUMPY\x01\x00v\x00"
            + str({"descr": "<f8", "fortran_order": False, "shape": (25_000_000,)}).encode()
        )
        stream.write(head.ljust(127) + b"\n")
        for _ in range(25):
            stream.write(bytes(8_000_000))
    with pytest.raises(InputError, match="budget"):
        read_table_or_log(path)


def test_bag_that_unpacks_beside_itself_is_refused(tmp_path: Path) -> None:
    """A file of a compressed bag is unpacked to the disk before it is read: that has its limit, too."""
    import zstandard

    (tmp_path / "bag").mkdir()
    about = {"version": 5, "storage_identifier": "mcap", "relative_file_paths": ["a.mcap.zstd"], "message_count": 0}
    about |= {"compression_format": "zstd", "compression_mode": "FILE", "topics_with_message_count": []}
    about |= {"duration": {"nanoseconds": 0}, "starting_time": {"nanoseconds_since_epoch": 0}}
    (tmp_path / "bag" / "metadata.yaml").write_text(
        json.dumps({"rosbag2_bagfile_information": about})
    )  # is YAML, too
    with (
        (tmp_path / "bag" / "a.mcap.zstd").open("wb") as file,
        zstandard.ZstdCompressor().stream_writer(file) as packed,
    ):
        for _ in range(60):
            packed.write(bytes(10_000_000))
    with pytest.raises(InputError, match="too much memory or time"):
        read_table_or_log(tmp_path / "bag")


def test_hdf5_that_declares_a_huge_array_is_refused(tmp_path: Path) -> None:
    import h5py

    with h5py.File(tmp_path / "bomb.h5", "w") as file:
        file.create_dataset("time", shape=(10**12,), dtype="f8", chunks=(10**6,), compression="gzip")
    with pytest.raises(InputError, match="budget"):
        read_table_or_log(tmp_path / "bomb.h5")


def ros_bag(
    path: Path, messages: list[tuple[str, str, int, Any]], definitions: dict[str, str] | None = None
) -> Any:
    """A bag of ROS 2 with messages made by ``messages``, a function of the store's types."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    for kind, text in (definitions or {}).items():
        store.register(get_types_from_msg(text, kind))
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connections: dict[str, Any] = {}
        for topic, kind, ns, build in messages:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=store)
            writer.write(connections[topic], ns, store.serialize_cdr(build(store.types), kind))


def write_mcap_of_zeros(path: Path) -> None:
    """A chunk, packed by zstd, that unpacks to a gigabyte."""
    zstandard = pytest.importorskip("zstandard")
    packing, zeros = zstandard.ZstdCompressor().compressobj(), bytes(10**7)
    packed = b"".join([*(packing.compress(zeros) for _ in range(100)), packing.flush()])
    head = struct.pack("<QQQI", 0, 1, 10**9, 0) + struct.pack("<I", 4) + b"zstd" + struct.pack("<Q", len(packed))
    records = (1, bytes(8)), (6, head + packed), (15, bytes(4)), (2, bytes(20))
    magic = b"\x89MCAP0\r\n"
    content = b"".join(struct.pack("<BQ", kind, len(body)) + body for kind, body in records)
    path.write_bytes(magic + content + magic)


def write_tdms_of_a_long_name(path: Path) -> None:
    """The name of an object that claims four gigabytes."""
    lead_in = b"TDSm" + struct.pack("<lLQQ", 0xE, 4713, 100, 96)
    path.write_bytes(lead_in + struct.pack("<LL", 1, 2**32 - 1) + bytes(92))


@pytest.mark.parametrize(
    ("name", "write"), [("trip.mcap", write_mcap_of_zeros), ("trip.tdms", write_tdms_of_a_long_name)]
)
def test_log_that_claims_or_unpacks_to_far_more_is_refused(
    name: str, write: Callable[[Path], None], tmp_path: Path
) -> None:
    write(tmp_path / name)
    with pytest.raises(InputError, match="takes too much memory or time"):
        read_table_or_log(tmp_path / name)


@IN_PROCESS
def test_own_types_are_taken_from_the_bag(tmp_path: Path) -> None:
    """Every numeric field of an own type is a column; sides in the topic's name tell shafts apart."""
    truth = trip(100)
    ns, rpm = truth.of("propeller_rpm")
    definition = "float64 rpm\nfloat32[2] current\nstring state\nyard_msgs/Motor motor\n"
    definitions = {"yard_msgs/msg/Motor": "float32 temperature\n", "yard_msgs/msg/Thruster": definition}

    def build(value: float) -> Any:
        return lambda types: types["yard_msgs/msg/Thruster"](
            value, np.array([1.0, 2.0], np.float32), "on", types["yard_msgs/msg/Motor"](40.0)
        )

    messages = [
        (f"/{side}_thruster/state", "yard_msgs/msg/Thruster", int(stamp), build(sign * float(value)))
        for side, sign in (("port", 1.0), ("starboard", -1.0)) for stamp, value in zip(ns, rpm, strict=True)
    ]  # fmt: skip
    ros_bag(tmp_path / "bag", sorted(messages, key=lambda entry: entry[2]), definitions)
    log = read_log(tmp_path / "bag", log_format(tmp_path / "bag"))  # type: ignore[arg-type]
    fields = {name for topic in log.topics for name in topic.fields}
    assert {"rpm", "current[0]", "current[1]", "motor.temperature"} <= fields
    recording, _ = import_log(tmp_path / "bag", tmp_path)
    np.testing.assert_array_equal(recording.series["port_propeller_rpm"].value, rpm)
    np.testing.assert_array_equal(recording.series["starboard_propeller_rpm"].value, -rpm)


@IN_PROCESS
@pytest.mark.parametrize(
    ("stamp_ns", "clock"),
    [
        (lambda ns: ns - 5_000_000, "header stamp"),
        (lambda ns: 0, "log time"),
        (lambda ns: ns - log_trip.START_NS + 20 * 10**9, "log time"),
        (lambda ns: log_trip.START_NS, "log time"),
    ],
    ids=["as they should be", "missing", "since the start of the computer", "standing still"],
)
def test_stamps_that_cannot_be_times_give_way_to_those_of_the_log(
    stamp_ns: Callable[[int], int], clock: str, tmp_path: Path
) -> None:
    ns = log_trip.START_NS + 10**8 * np.arange(200)

    def build(index: int) -> Any:
        stated = stamp_ns(int(ns[index]))

        def message(types: dict[str, Any]) -> Any:
            stamp = types["builtin_interfaces/msg/Time"](stated // 10**9, stated % 10**9)
            header = types["std_msgs/msg/Header"](stamp=stamp, frame_id="gps")
            status = types["sensor_msgs/msg/NavSatStatus"](status=0, service=1)
            return types["sensor_msgs/msg/NavSatFix"](
                header, status, 63.0 + 1e-6 * index, 10.0, 0.0, np.zeros(9), 0
            )

        return message

    ros_bag(tmp_path / "bag", [("/fix", "sensor_msgs/msg/NavSatFix", int(ns[i]), build(i)) for i in range(200)])
    (topic,) = read_log(tmp_path / "bag", log_format(tmp_path / "bag")).topics  # type: ignore[arg-type]
    assert topic.clock == clock
    np.testing.assert_array_equal(topic.time_ns, ns - 5_000_000 if clock == "header stamp" else ns)


def json_mcap(path: Path, properties: dict[str, Any], message: Callable[[int], dict[str, Any]], lag_ns: int) -> Any:
    """The log of an MCAP file of JSON messages that were published ``lag_ns`` before they were logged."""
    from mcap.writer import Writer

    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema("Nav", "jsonschema", json.dumps({"properties": properties}).encode())
        channel = writer.register_channel("/nav", "json", schema)
        for index in range(60):
            ns = (log_trip.START_NS // NANO + index) * NANO
            writer.add_message(channel, ns, json.dumps(message(ns)).encode(), publish_time=ns - lag_ns)
        writer.finish()
    form = log_format(path)
    assert form is not None
    (topic,) = read_log(path, form).topics
    return topic


@IN_PROCESS
@pytest.mark.parametrize(
    "stated",
    [
        lambda ns: {"timestamp": ns / 1e9}, lambda ns: {"timestamp": ns // 10**6}, lambda ns: {"timestamp_ns": ns},
        lambda ns: {"utc_time": dt.datetime.fromtimestamp(ns // NANO, dt.UTC).isoformat()}, None,
    ],
    ids=["s", "ms", "ns", "text", "published"],
)  # fmt: skip
def test_messages_of_json_are_dated_by_their_own_stamps(stated: Any, tmp_path: Path) -> None:
    """Or by when they were published: they had the times of the log, into which they came 3 s later."""
    lag_ns = 3 * NANO
    message = (lambda ns: {"heading": 1.0} | stated(ns - lag_ns)) if stated else lambda ns: {"heading": 1.0}
    topic = json_mcap(tmp_path / "trip.mcap", {}, message, 0 if stated else lag_ns)
    assert topic.time_ns.tolist() == [log_trip.START_NS // NANO * NANO + k * NANO - lag_ns for k in range(60)]
    assert topic.clock == ("header stamp" if stated else "publish time")
    assert "3.000 s behind the log's times" in " ".join(topic.remarks)


@IN_PROCESS
@pytest.mark.parametrize(
    ("about", "unit", "meaning"),
    [
        ({"description": "Speed through water [kn]"}, "kn", "Speed through water"),
        ({"description": "kn"}, "knots", "speed"),
        ({"unit": "kn"}, "kn", "speed"),
        ({"unit": "kn", "description": "Speed over ground"}, "kn", "Speed over ground"),
        ({}, "", "speed"),
    ],
)
def test_units_and_meanings_of_a_json_schema_are_read(
    about: dict[str, str], unit: str, meaning: str, tmp_path: Path
) -> None:
    """Speed through water had become speed over ground."""
    properties = {"log": {"type": "object", "properties": {"speed": about}}}
    topic = json_mcap(tmp_path / "trip.mcap", properties, lambda ns: {"log": {"speed": 4.0}}, 0)
    assert (topic.fields["log.speed"].unit, topic.fields["log.speed"].meaning) == (unit, meaning)


@IN_PROCESS
@pytest.mark.parametrize(("key", "ahead_s"), [("time_tai", 37), ("gps_time", 18), ("time", 0)])
@pytest.mark.parametrize("in_mcap", [True, False])
def test_clock_of_a_json_time_is_known_by_its_name(in_mcap: bool, key: str, ahead_s: int, tmp_path: Path) -> None:
    """The column of times was called time, whatever the name was: 37 s and 18 s off."""
    truth = log_trip.START_NS // NANO * NANO + np.arange(60) * NANO
    if in_mcap:  # where the log's times are UTC
        topic = json_mcap(tmp_path / "a.mcap", {}, lambda ns: {"heading": 1.0, key: ns / 1e9 + ahead_s}, 0)
    else:
        moments = [dt.datetime.fromtimestamp(int(ns) // NANO + ahead_s, dt.UTC) for ns in truth]
        lines = [json.dumps({key: f"{moment:%Y-%m-%dT%H:%M:%S}", "heading": 1.0}) for moment in moments]
        (tmp_path / "a.jsonl").write_text("\n".join(lines))
        form = log_format(tmp_path / "a.jsonl")
        assert form is not None
        (topic,) = read_log(tmp_path / "a.jsonl", form).topics
    np.testing.assert_array_equal(topic.time_ns, truth)


@IN_PROCESS
def test_entries_of_a_list_go_by_their_names(tmp_path: Path) -> None:
    """By their places port and starboard were mixed where their order changes."""
    engines = [{"name": "port", "rpm": 600.0}, {"name": "starboard", "rpm": -500.0}]
    topic = json_mcap(
        tmp_path / "trip.mcap", {}, lambda ns: {"engines": engines[:: -1 if ns // NANO % 2 else 1]}, 0
    )
    assert {path: set(field.samples) for path, field in topic.fields.items()} == {
        "engines[port].rpm": {600.0}, "engines[starboard].rpm": {-500.0},
    }  # fmt: skip


@IN_PROCESS
def test_broken_schema_costs_its_own_channel_alone(tmp_path: Path) -> None:
    from mcap.writer import Writer

    with (tmp_path / "trip.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        channels = [
            writer.register_channel(topic, encoding, writer.register_schema(topic, form, data))
            for topic, encoding, form, data in (
                ("/bad", "protobuf", "protobuf", b"\xff\xff\x01"), ("/good", "json", "jsonschema", b"{}"),
            )
        ]  # fmt: skip
        for index in range(20):
            for channel in channels:
                writer.add_message(
                    channel, log_trip.START_NS + index, b'{"heading": 1.0}', log_trip.START_NS + index
                )
        writer.finish()
    form = log_format(tmp_path / "trip.mcap")
    assert form is not None
    log = read_log(tmp_path / "trip.mcap", form)
    assert [topic.name for topic in log.topics] == ["/good"]
    assert log.left_out["/bad"][1] == 20
    assert "schema is broken" in log.left_out["/bad"][2]


@IN_PROCESS
def test_several_bags_of_one_trip_are_one_log(tmp_path: Path) -> None:
    truth = trip(300)
    halves = [
        Trip({topic: ns[part] for topic, ns in truth.ns.items()},
             {name: (topic, values[part]) for name, (topic, values) in truth.channels.items()})
        for part in (slice(0, 150), slice(150, 300))
    ]  # fmt: skip
    (tmp_path / "trip").mkdir()
    for number, half in enumerate(halves):
        log_trip.write_bag(tmp_path / "trip" / f"part_{number}.bag", half, storage="bag")
    recording, _ = import_log(tmp_path / "trip", tmp_path)
    assert_holds(recording, truth)


def _header(types: dict[str, Any], ns: int, frame: str) -> Any:
    return types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](ns // 10**9, ns % 10**9), frame)


def _vector(types: dict[str, Any], *parts: float) -> Any:
    return types["geometry_msgs/msg/Vector3"](*map(float, parts))


@IN_PROCESS
@pytest.mark.parametrize(
    ("world", "body"), [("odom", "base_link"), ("odom_ned", "base_link_frd"), ("odom", "odom")]
)
def test_odometry_is_read_in_the_axes_that_its_frames_name(world: str, body: str, tmp_path: Path) -> None:
    """Position, attitude and twist of one message, with a steady heel to starboard and the bow up.

    A twist of the body in a frame that is called the world's is not taken: speeds follow from the positions.
    """
    truth, is_ned = trip(400), world == "odom_ned"
    ns, heading = truth.of("heading_deg")
    surge, sway, rate = (truth.channels[name][1] for name in ("surge_mps", "sway_mps", "yaw_rate_dps"))
    psi, roll, pitch = np.deg2rad(heading), np.deg2rad(4.0), np.deg2rad(3.0)
    north = np.cumsum(surge * np.cos(psi) - sway * np.sin(psi)) * log_trip.STEP_NS / 1e9
    east = np.cumsum(surge * np.sin(psi) + sway * np.cos(psi)) * log_trip.STEP_NS / 1e9
    turn = 1.0 if is_ned else -1.0
    angles = np.column_stack([psi, np.full(psi.size, pitch), np.full(psi.size, roll)])
    if not is_ned:
        angles = np.column_stack([0.5 * np.pi - psi, np.full(psi.size, -pitch), np.full(psi.size, roll)])
    turned = Rotation.from_euler("ZYX", angles).as_quat()

    def build(row: int) -> Any:
        def message(types: dict[str, Any]) -> Any:
            places = (north[row], east[row]) if is_ned else (east[row], north[row])
            point = types["geometry_msgs/msg/Point"](*map(float, places), 0.0)
            pose = types["geometry_msgs/msg/Pose"](
                point, types["geometry_msgs/msg/Quaternion"](*map(float, turned[row]))
            )
            twist = types["geometry_msgs/msg/Twist"](
                _vector(types, surge[row], turn * sway[row], 0.0),
                _vector(types, 0.0, 0.0, turn * np.deg2rad(rate[row])),
            )
            return types["nav_msgs/msg/Odometry"](
                _header(types, int(ns[row]), world), body,
                types["geometry_msgs/msg/PoseWithCovariance"](pose, np.zeros(36)),
                types["geometry_msgs/msg/TwistWithCovariance"](twist, np.zeros(36)),
            )  # fmt: skip

        return message

    messages = [("/odometry/filtered", "nav_msgs/msg/Odometry", int(ns[row]), build(row)) for row in range(ns.size)]
    ros_bag(tmp_path / "bag", messages)
    series = import_log(tmp_path / "bag", tmp_path)[0].series
    heel, trim = np.full(ns.size, 4.0), np.full(ns.size, 3.0)
    expected = {
        **{"heading_deg": heading, "surge_mps": surge, "sway_mps": sway, "yaw_rate_dps": rate},
        **{"north_m": north, "east_m": east, "roll_deg": heel, "pitch_deg": trim},
    }
    for name, values in expected.items():
        np.testing.assert_array_equal(series[name].measured_ns, ns)
        tolerance = 0.05 if body == world and name in ("surge_mps", "sway_mps") else 1e-9
        np.testing.assert_allclose(series[name].value[5:-5], values[5:-5], atol=tolerance, err_msg=name)


@IN_PROCESS
def test_topics_of_mavros_joints_and_two_receivers(tmp_path: Path) -> None:
    """A velocity of the world, wind that goes to 70 deg, joints of shafts and rudder, one of two receivers."""
    truth = trip(500)
    ns, heading = truth.of("heading_deg")
    surge, sway, psi = truth.channels["surge_mps"][1], truth.channels["sway_mps"][1], np.deg2rad(heading)
    north, east = surge * np.cos(psi) - sway * np.sin(psi), surge * np.sin(psi) + sway * np.cos(psi)

    def fix(row: int, off: float) -> Any:
        latitude, longitude = (truth.channels[name][1][row] for name in ("latitude_deg", "longitude_deg"))
        return lambda types: types["sensor_msgs/msg/NavSatFix"](
            _header(types, int(truth.ns["gps"][row]), "gps"), types["sensor_msgs/msg/NavSatStatus"](0, 1),
            float(latitude + off), float(longitude), 0.0, np.zeros(9), 0,
        )  # fmt: skip

    def velocity(row: int) -> Any:
        return lambda types: types["geometry_msgs/msg/TwistStamped"](
            _header(types, int(ns[row]), "map"),
            types["geometry_msgs/msg/Twist"](
                _vector(types, east[row], north[row], 0.0), _vector(types, 0.0, 0.0, 0.0)
            ),
        )

    def wind(row: int) -> Any:
        goes_to = np.deg2rad(70.0)
        return lambda types: types["geometry_msgs/msg/Vector3Stamped"](
            _header(types, int(ns[row]), "map"), _vector(types, 8.0 * np.sin(goes_to), 8.0 * np.cos(goes_to), 0.0)
        )

    def joints(row: int) -> Any:
        names = ["port_propeller_joint", "starboard_propeller_joint", "rudder_joint"]
        return lambda types: types["sensor_msgs/msg/JointState"](
            _header(types, int(ns[row]), ""),
            names,
            np.array([0.0, 0.0, 0.1]),
            np.array([10.0, 20.0, 0.0]),
            np.array([]),
        )

    def compass(row: int) -> Any:
        return lambda types: types["std_msgs/msg/Float64"](float(heading[row]))

    messages: list[tuple[str, str, int, Any]] = []
    for row, stamp in enumerate(ns.tolist()):
        messages += [
            ("/gps_bow/fix", "sensor_msgs/msg/NavSatFix", stamp, fix(row, 0.0)),
            ("/mavros/global_position/compass_hdg", "std_msgs/msg/Float64", stamp, compass(row)),
            ("/mavros/local_position/velocity_local", "geometry_msgs/msg/TwistStamped", stamp, velocity(row)),
            ("/weather/wind", "geometry_msgs/msg/Vector3Stamped", stamp, wind(row)),
            ("/joint_states", "sensor_msgs/msg/JointState", stamp, joints(row)),
        ]
        if row % 2:
            messages.append(("/gps_stern/fix", "sensor_msgs/msg/NavSatFix", stamp, fix(row, 1e-3)))
    ros_bag(tmp_path / "bag", messages)
    recording, proposal = import_log(tmp_path / "bag", tmp_path)
    series = recording.series
    np.testing.assert_array_equal(series["latitude_deg"].value, truth.channels["latitude_deg"][1])
    np.testing.assert_allclose(series["surge_mps"].value, surge, atol=2e-3)  # the heading is of other times
    np.testing.assert_allclose(series["wind_direction_deg"].value, 250.0)
    np.testing.assert_allclose(series["wind_speed_mps"].value, 8.0)
    np.testing.assert_allclose(series["port_propeller_rpm"].value, 10.0 * 30.0 / np.pi)
    np.testing.assert_allclose(series["starboard_propeller_rpm"].value, 20.0 * 30.0 / np.pi)
    np.testing.assert_allclose(series["rudder_angle_deg"].value, np.rad2deg(0.1))
    assert any(
        reading.column == "/gps_stern/fix.latitude" and reading.taken_for == "-" for reading in proposal.readings
    )


@IN_PROCESS
@pytest.mark.parametrize(("scale", "exact_ns"), [(1e-6, 0), (1e-9, 1000)], ids=["ms", "s"])
def test_times_of_json_lines_may_be_numbers(scale: float, exact_ns: int, tmp_path: Path) -> None:
    """Milliseconds as whole numbers, seconds as floats: both since 1970."""
    truth = trip(100, resolution_ns=1_000_000)
    ns, heading = truth.of("heading_deg")
    stamps = [int(stamp) // 1_000_000 if scale == 1e-6 else int(stamp) / 1e9 for stamp in ns]
    rows = [
        {"t": stamp, "nav": {"heading_deg": float(value)}} for stamp, value in zip(stamps, heading, strict=True)
    ]
    (tmp_path / "a.jsonl").write_text("\n".join(map(json.dumps, rows)))
    series = import_log(tmp_path / "a.jsonl", tmp_path)[0].series["heading_deg"]
    assert np.max(np.abs(series.measured_ns - ns)) <= exact_ns
    np.testing.assert_array_equal(series.value, heading)


def written_as_json(path: Path, messages: list[dict[str, Any]]) -> Path:
    path.write_text("\n".join(map(json.dumps, messages)))
    return path


def canboat(second: int, group: int, sender: int, **fields: Any) -> dict[str, Any]:
    fields = {name.replace("_", " "): value for name, value in fields.items()}
    return {"timestamp": f"2026-05-17-12:00:{second:02d}.000", "src": sender, "pgn": group, "fields": fields}


@IN_PROCESS
@pytest.mark.parametrize("is_magnetic", [True, False])
def test_canboats_objects_are_of_a_sender_and_a_reference(is_magnetic: bool, tmp_path: Path) -> None:
    """Two compasses 5 deg apart are two columns; a magnetic one, with its deviation, needs the variation."""
    compass = {"Heading": 90.0, "Reference": "True"}
    if is_magnetic:
        compass = {
            "Heading": 85.0,
            "Deviation": 2.0,
            "Variation": 3.0,
            "Reference": {"value": 1, "name": "Magnetic"},
        }
    wind = {"Wind_Speed": 10.0, "Wind_Angle": 30.0, "Reference": "Apparent"}
    of_water = {"Wind_Speed": 7.0, "Wind_Angle": 50.0, "Reference": "True (boat referenced)"}
    messages = [
        message
        for second in range(20)
        for message in (
            canboat(second, 127250, 4, **compass),
            canboat(second, 127250, 35, Heading=95.0, Reference="True" if not is_magnetic else "Error"),
            canboat(second, 129026, 3, COG_Reference="True", COG=90.0, SOG=5.0),
            canboat(second, 127245, 6, Instance=0, Position=-4.0),
            canboat(second, 127245, 6, Instance=1, Position=7.0),
            canboat(second, 130306, 5, **wind),
            canboat(second, 130306, 5, **of_water),
        )
    ]
    recording, _ = import_log(written_as_json(tmp_path / "a.json", messages), tmp_path)
    values = {name: set(series.value.round(6)) for name, series in recording.series.items()}
    assert values["heading_deg"] == {90.0}
    assert values["speed_over_ground_mps"] == {5.0}
    assert values["rudder_angle_deg"] == {-4.0}
    assert values["apparent_wind_angle_deg"] == {30.0}
    assert values["apparent_wind_speed_mps"] == {10.0}


@IN_PROCESS
def test_signal_k_has_si_units_and_other_vessels(tmp_path: Path) -> None:
    values: dict[str, Any] = {
        "navigation.headingTrue": np.pi / 2, "navigation.speedOverGround": 5.0, "navigation.rateOfTurn": 0.01,
        "navigation.courseOverGroundTrue": np.pi / 2, "navigation.position": {"latitude": 63.4, "longitude": 10.4},
        "environment.wind.speedApparent": 10.0, "environment.wind.angleApparent": -0.5, "steering.rudderAngle": 0.1,
        "propulsion.main.revolutions": 20.0,
    }  # fmt: skip
    target = {"navigation.position": {"latitude": 10.0, "longitude": 20.0}}
    messages = [
        {
            "context": context,
            "updates": [
                {
                    "$source": "n2k.4",
                    "timestamp": f"2026-05-17T12:00:{second:02d}Z",
                    "values": [{"path": path, "value": value} for path, value in content.items()],
                }
            ],
        }
        for second in range(20)
        for context, content in (("vessels.self", values), ("vessels.urn:mrn:imo:mmsi:257000001", target))
    ]
    recording, _ = import_log(written_as_json(tmp_path / "a.jsonl", messages), tmp_path)
    expected = {
        "heading_deg": 90.0, "speed_over_ground_mps": 5.0, "yaw_rate_dps": np.rad2deg(0.01), "latitude_deg": 63.4,
        "course_over_ground_deg": 90.0, "apparent_wind_speed_mps": 10.0, "rudder_angle_deg": np.rad2deg(0.1),
    }  # fmt: skip
    for name, value in expected.items():
        np.testing.assert_allclose(recording.series[name].value, value, err_msg=name)
    assert "propeller_rpm" not in recording.series  # an engine's


@IN_PROCESS
def test_log_without_utc_starts_when_it_is_told(tmp_path: Path) -> None:
    """An autopilot without a fix: times count from 1970, unless the start is answered."""
    truth = trip(100, start_ns=log_trip.START_NS // 1000 * 1000, resolution_ns=1000)
    log_trip.write_ulog(tmp_path / "a.ulg", truth)
    content = (tmp_path / "a.ulg").read_bytes().replace(b"time_utc_usec", b"time_of_noone")
    (tmp_path / "a.ulg").write_bytes(content)
    recording, proposal = import_log(tmp_path / "a.ulg", tmp_path)
    assert any("nothing in the log tells UTC" in warning for warning in proposal.warnings)
    assert recording.start_ns == 20 * 10**9
    start = {"start": "2026-05-17T12:00:00Z"}
    recording, _ = import_log(tmp_path / "a.ulg", tmp_path, start)
    assert recording.start_ns == pd.Timestamp(start["start"]).value


@given(
    st.lists(
        st.lists(st.integers(0, 30), min_size=1, max_size=12).map(lambda ns: np.array(ns, dtype=np.int64)),
        min_size=2, max_size=4,
    )
)  # fmt: skip
def test_no_sample_of_any_topic_is_lost_or_moved(stamps: list[np.ndarray]) -> None:
    """Topics with any stamps, twice and backwards too: each sample has a row of its time, and none shares it."""
    rows, count = rows_by_time(stamps)
    times = np.full(count, -1)
    for places, stamp in zip(rows, stamps, strict=True):
        assert np.unique(places).size == stamp.size
        assert np.all((times[places] == -1) | (times[places] == stamp))
        times[places] = stamp
    assert np.all(times >= 0)
    assert np.all(np.diff(times) >= 0)


@given(st.floats(-179.0, 179.0), st.floats(-80.0, 80.0), st.floats(-179.0, 179.0))
def test_attitude_of_quaternion_is_that_of_its_rotation(yaw: float, pitch: float, roll: float) -> None:
    """In north, east, down the angles themselves; in ROS' axes the same attitude of the same ship."""
    to_ned = Rotation.from_euler("ZYX", [yaw, pitch, roll], degrees=True)
    enu, flu = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]), np.diag([1.0, -1.0, -1.0])
    to_enu = Rotation.from_matrix(enu @ to_ned.as_matrix() @ flu)
    for rotation, is_ned in ((to_ned, True), (to_enu, False)):
        attitude = attitude_of_quaternion(*rotation.as_quat()[:, np.newaxis], is_ned=is_ned)
        for name, angle in (("heading", yaw), ("pitch", pitch), ("roll", roll)):
            error = (attitude[name][0] - angle + 180.0) % 360.0 - 180.0
            assert abs(error) < 1e-6, (name, is_ned)


def test_bag_without_any_message_is_one_line(tmp_path: Path) -> None:
    ros_bag(tmp_path / "bag", [])
    with pytest.raises(InputError, match="holds no topic"):
        read_table_or_log(tmp_path / "bag")


@IN_PROCESS
def test_px4_log_is_utc_by_its_gps(shared_data: Path, tmp_path: Path) -> None:
    """The flight of PX4's own tests: heading by the quaternion is that of the local position, times are of 2021."""
    with (
        gzip.open(shared_data / "ulog" / "sample_log_small.ulg.gz") as packed,
        (tmp_path / "a.ulg").open("wb") as file,
    ):
        shutil.copyfileobj(packed, file)
    log = read_log(tmp_path / "a.ulg", log_format(tmp_path / "a.ulg"))  # type: ignore[arg-type]
    topics = {topic.name: topic for topic in log.topics}
    attitude, local = topics["vehicle_attitude"], topics["vehicle_local_position"]
    assert pd.Timestamp(int(attitude.time_ns[0])).date().isoformat() == "2021-04-21"
    heading = np.interp(
        local.time_ns, attitude.time_ns, np.unwrap(attitude.fields["heading"].samples, period=360.0)
    )
    stated = np.rad2deg(local.fields["heading"].samples)
    assert np.max(np.abs((heading - stated + 180.0) % 360.0 - 180.0)) < 1.0
    recording, _ = import_log(tmp_path / "a.ulg", tmp_path)
    gps = topics["vehicle_gps_position"]
    utc_ns = gps.fields["time_utc_usec"].samples.astype(np.int64) * 1000
    assert np.max(np.abs(recording.series["latitude_deg"].measured_ns - utc_ns)) < 0.2e9


@IN_PROCESS
@pytest.mark.parametrize("ship", ["otter", "milliampere"])
def test_measured_trip_as_a_bag_is_the_table(ship: str, shared_data: Path, tmp_path: Path) -> None:
    """A recorded trip put into a bag in ROS' frames comes back as its table."""
    table = _measured(shared_data, ship)
    ns = table.index.as_unit("ns").asi8

    def fix(row: Any) -> Any:
        def message(types: dict[str, Any]) -> Any:
            stamp = types["builtin_interfaces/msg/Time"](0, 0)
            header = types["std_msgs/msg/Header"](stamp=stamp, frame_id="gps")
            status = types["sensor_msgs/msg/NavSatStatus"](status=0, service=1)
            return types["sensor_msgs/msg/NavSatFix"](header, status, row.lat, row.lon, 0.0, np.zeros(9), 0)

        return message

    def imu(row: Any) -> Any:
        def message(types: dict[str, Any]) -> Any:
            yaw = np.deg2rad(90.0 - row.heading)
            vector = types["geometry_msgs/msg/Vector3"]
            stamp = types["builtin_interfaces/msg/Time"](0, 0)
            turned = types["geometry_msgs/msg/Quaternion"](0.0, 0.0, float(np.sin(yaw / 2)), float(np.cos(yaw / 2)))
            return types["sensor_msgs/msg/Imu"](
                types["std_msgs/msg/Header"](stamp=stamp, frame_id="imu"), turned, np.zeros(9),
                vector(0.0, 0.0, -float(np.deg2rad(row.rate))), np.zeros(9), vector(0.0, 0.0, 9.8), np.zeros(9),
            )  # fmt: skip

        return message

    messages = []
    for stamp, row in zip(ns.tolist(), table.itertuples(), strict=True):
        messages += [
            ("/fix", "sensor_msgs/msg/NavSatFix", stamp, fix(row)),
            ("/imu", "sensor_msgs/msg/Imu", stamp, imu(row)),
        ]
    ros_bag(tmp_path / "bag", messages)
    recording, _ = import_log(tmp_path / "bag", tmp_path)
    for name, column in (("heading_deg", "heading"), ("yaw_rate_dps", "rate"), ("latitude_deg", "lat")):
        series = recording.series[name]
        kept = np.isin(ns, series.measured_ns)  # the Otter's connection stalled four times
        assert kept.sum() == series.measured_ns.size
        assert kept.mean() > {"otter": 0.9, "milliampere": 0.9999}[ship]
        expected = table.loc[kept, column] % 360.0 if name == "heading_deg" else table.loc[kept, column]
        assert np.max(np.abs((series.value - expected.to_numpy() + 180.0) % 360.0 - 180.0)) < 1e-6


def _measured(folder: Path, ship: str) -> pd.DataFrame:
    """Latitude, longitude, heading and rate of turn of a recorded trip, in increasing time."""
    if ship == "otter":
        raw = pd.read_csv(folder / "otter" / "2024-04-23_12-22-102.csv.gz", sep=";").iloc[1:]
        times = pd.to_datetime((raw["current_time"] * 1e9).astype("int64"), utc=True)
        names = {
            "lat": "lat",
            "lon": "lon",
            "current_orientation_3": "heading",
            "current_rotational_velocities_3": "rate",
        }
    else:
        raw = pd.read_csv(folder / "milliampere" / "ma_qp1.csv.gz")
        times = pd.to_datetime(raw["time"], format="ISO8601", utc=True)
        names = {"latitude": "lat", "longitude": "lon", "heading [deg]": "heading", "r [deg/s]": "rate"}
    table = (
        raw[[*names]].rename(columns=names).apply(pd.to_numeric, errors="coerce").set_axis(pd.DatetimeIndex(times))
    )
    table = table.dropna().iloc[:1200]
    return table[~table.index.duplicated()].sort_index()


def test_a_field_that_never_changes_gives_way_to_one_that_does(tmp_path: Path) -> None:
    """A log of two instruments, one of which leaves a field at zero; alone it would be taken."""
    times = 1_800_000_000 * NANO + np.arange(20) * NANO
    dead, alive = (LogField(values, "deg/s") for values in (np.zeros(20), np.linspace(-2.0, 2.0, 20)))
    topics = [
        LogTopic(name, "t", 20, times, "its own", {"yaw_rate": entry})
        for name, entry in (("a", dead), ("b", alive))
    ]
    path = tmp_path / "x.jsonl"
    form = log_format(path)
    assert form is not None
    both, one = (TopicLog(path, form, tuple(kept), {}, ()) for kept in (topics, topics[:1]))
    assert [candidate.column for candidate in both.candidates] == ["b.yaw_rate"]
    assert [candidate.column for candidate in one.candidates] == ["a.yaw_rate"]


@IN_PROCESS
@pytest.mark.parametrize("counter", ["id", "t_boot_s", "x"])
def test_counter_beside_channels_is_not_what_its_topic_is_called(counter: str, tmp_path: Path) -> None:
    truth = trip()
    with sqlite3.connect(tmp_path / "trip.sqlite") as connection:
        for topic, ns in truth.ns.items():
            columns = {counter: 0.2 * np.arange(ns.size), "utc": ns, **log_trip.with_units(truth, topic)}
            pd.DataFrame(columns).to_sql(topic, connection, index=False)
    connection.close()
    recording, proposal = import_log(tmp_path / "trip.sqlite", tmp_path)
    assert not proposal.unanswered
    assert_holds(recording, truth)
    assert set(recording.series) == {*truth.channels, "north_m", "east_m"}


def write_timed_json(path: Path, truth: Trip, form: str, zone: str) -> None:
    """An object a message, whose time is text of a form of strftime on the clock of a zone."""
    rows = []
    for topic, stamps in truth.ns.items():
        table = log_trip.table_of(truth, topic)
        for index, ns in enumerate(stamps.tolist()):
            text = pd.Timestamp(ns, tz="UTC").tz_convert(zone).strftime(form)
            data = {name: float(values[index]) for name, values in table.items()}
            rows.append((ns, json.dumps({"topic": topic, "time": text, "data": data})))
    path.write_text("\n".join(text for _, text in sorted(rows)) + "\n")


@IN_PROCESS
@pytest.mark.parametrize(
    ("form", "question", "answers"),
    [
        ("%Y-%m-%dT%H:%M:%S.%f", "", {"zone": "Asia/Tokyo"}),
        ("%d/%m/%Y %H:%M:%S.%f", "date_order", {"zone": "Asia/Tokyo", "date_order": "day-first"}),
        *nightly(("%m/%d/%Y %H:%M:%S.%f", "date_order", {"zone": "Asia/Tokyo", "date_order": "month-first"})),
        ("%d %b %H:%M:%S.%f", "year", {"zone": "Asia/Tokyo", "year": "2026"}),
        ("%H:%M:%S.%f", "day", {"zone": "Asia/Tokyo", "day": "2026-05-04"}),
    ],
)
def test_questions_that_the_times_of_topics_leave_are_asked_and_answered(
    form: str, question: str, answers: dict[str, str], tmp_path: Path
) -> None:
    """4 May 2026: day and month may be exchanged, and a clock of Tokyo is nine hours ahead."""
    truth = trip(start_ns=log_trip.START_NS // 1000 * 1000 - 13 * log_trip.DAY_NS, resolution_ns=1000)
    source, target = tmp_path / "trip.jsonl", tmp_path / "trial.mcap"
    write_timed_json(source, truth, form, "Asia/Tokyo")
    open_keys = [entry.key for entry in propose_column_map(read_table_or_log(source)).unanswered]
    assert open_keys == [question] * bool(question)
    log_kind = log_format(source)
    assert log_kind is not None
    assert ("the import asks" in " ".join(read_log(source, log_kind).as_dict()["remarks"])) == bool(question)
    if question:
        values = 'heading_deg = { topic = "gyro", field = "heading_deg", unit = "deg" }\n'
        with pytest.raises(SourceError, match="`seatrial import` takes the answer"):
            seatrial.record(topic_file(source, values), tmp_path / "out")
    given_answers = [f"{key}={value}" for key, value in answers.items()]
    seatrial.import_table(source, target, yes=True, answer=given_answers)
    assert_holds(read_recording(target), truth)

    if question != "day":  # which no map can tell of the next log
        seatrial.import_table(source, tmp_path / "again.mcap", columns=tmp_path / "trial.columns.toml")
        assert_holds(read_recording(tmp_path / "again.mcap"), truth)


@IN_PROCESS
def test_zone_of_a_clock_that_states_another_is_as_answered(tmp_path: Path) -> None:
    """A program that takes the clock of the ship for UTC."""
    truth = trip()
    stamps, table = (
        truth.ns["gps"],
        {f"{name} [{unit}]": truth.of(key)[1] for key, (name, unit) in log_trip.NAMES.items()},
    )
    local = pd.DatetimeIndex(stamps.view("datetime64[ns]"), tz="UTC").tz_convert("Europe/Oslo").tz_localize(None)
    pd.DataFrame({"time": local.tz_localize("UTC"), **table}).to_parquet(tmp_path / "trip.parquet")
    recording, proposal = import_log(tmp_path / "trip.parquet", tmp_path, {"zone": "Europe/Oslo"})
    assert not proposal.unanswered
    np.testing.assert_array_equal(recording.series["heading_deg"].measured_ns, stamps)


@IN_PROCESS
@pytest.mark.parametrize("version", ["4.10", "3.00"])
def test_start_of_a_measurement_without_a_zone_is_of_the_zone_that_is_answered(
    version: str, tmp_path: Path
) -> None:
    """A logger on the clock of Tokyo; the header of MDF 3.0 has no more than a date and a time of day."""
    truth, file = trip(), tmp_path / ("trip.mf4" if version > "4" else "trip.mdf")
    log_trip.write_mdf(file, truth, version, dt.timedelta(hours=9))
    recording, proposal = import_log(file, tmp_path)
    assert "names no zone: UTC is assumed" in " ".join(proposal.warnings)
    ahead_ns = recording.series["heading_deg"].measured_ns - truth.ns["gyro"]
    np.testing.assert_array_equal(ahead_ns, 9 * 3600 * NANO)

    answered, proposal = import_log(file, tmp_path, {"zone": "Asia/Tokyo"})
    assert "no zone" not in " ".join(proposal.warnings)
    assert_holds(answered, truth, 1e-9)


@IN_PROCESS
def test_group_whose_master_counts_no_time_is_left_out(tmp_path: Path) -> None:
    """Samples of an engine by the angle of its crank [rad]."""
    from asammdf import MDF, Signal

    truth = trip()
    log_trip.write_mdf(tmp_path / "trip.mf4", truth)
    angles = np.linspace(0.0, 700.0, 500)
    with MDF(tmp_path / "trip.mf4") as file:
        file.append([Signal(angles, angles, name="Propeller pressure")], comment="by angle")
        master = file.groups[-1].channels[file.masters_db[len(file.groups) - 1]]
        master.sync_type = 2
        file.save(tmp_path / "both.mf4")
    form = log_format(tmp_path / "both.mf4")
    assert form is not None
    log = read_log(tmp_path / "both.mf4", form)
    assert log.left_out == {"by angle": ("", 500, "without times")}
    assert [topic.name for topic in log.topics] == [*truth.ns]


@IN_PROCESS
@pytest.mark.parametrize("has_heading", [True, False])
def test_velocity_to_east_and_north_in_the_frame_of_an_antenna_is_none_of_the_body(
    has_heading: bool, tmp_path: Path
) -> None:
    """As nmea_navsat_driver publishes it, with a turning that is never filled in."""
    truth = trip(700, resolution_ns=log_trip.STEP_NS)  # all topics at the same instants
    ns, heading = truth.of("heading_deg")
    velocity = (truth.channels["surge_mps"][1] + 1j * truth.channels["sway_mps"][1]) * np.exp(
        1j * np.deg2rad(heading)
    )

    def build(row: int, kind: str) -> Any:
        def message(types: dict[str, Any]) -> Any:
            header = _header(types, int(ns[row]), "gps")
            if kind == "TwistStamped":
                linear = _vector(types, velocity[row].imag, velocity[row].real, 0.0)
                twist = types["geometry_msgs/msg/Twist"](linear, _vector(types, 0.0, 0.0, 0.0))
                return types["geometry_msgs/msg/TwistStamped"](header, twist)
            place = (float(truth.channels[name][1][row]) for name in ("latitude_deg", "longitude_deg"))
            status = types["sensor_msgs/msg/NavSatStatus"](status=0, service=1)
            return types["sensor_msgs/msg/NavSatFix"](header, status, *place, 0.0, np.zeros(9), 0)

        return message

    kinds = {"/fix": "sensor_msgs/msg/NavSatFix", "/vel": "geometry_msgs/msg/TwistStamped"}
    messages = [(topic, kind, int(ns[row]), build(row, kind.rpartition("/")[2]))
                for topic, kind in kinds.items() for row in range(ns.size)]  # fmt: skip
    if has_heading:
        angles = 0.5 * np.pi - np.deg2rad(heading)

        def compass(row: int) -> Any:
            turned = 0.0, 0.0, float(np.sin(angles[row] / 2)), float(np.cos(angles[row] / 2))
            return lambda types: types["geometry_msgs/msg/QuaternionStamped"](
                _header(types, int(ns[row]), "map"), types["geometry_msgs/msg/Quaternion"](*turned)
            )

        messages += [("/compass", "geometry_msgs/msg/QuaternionStamped", int(ns[row]), compass(row))
                     for row in range(ns.size)]  # fmt: skip
    ros_bag(tmp_path / "bag", messages)
    recording, proposal = import_log(tmp_path / "bag", tmp_path)
    assert "to east and, by the other sign, to north" in " ".join(proposal.warnings)
    assert "angular is not filled in" in " ".join(proposal.warnings)
    assert ("surge_mps" in recording.series) == has_heading
    if has_heading:
        assert_holds(
            recording, truth, names=("latitude_deg", "longitude_deg", "heading_deg", "surge_mps", "sway_mps")
        )
    else:
        assert not {"sway_mps", "yaw_rate_dps"} & set(recording.series)


@IN_PROCESS
@pytest.mark.parametrize("form", ["SQLite", "rosbag2 db3"])
def test_database_that_was_not_closed_is_read_with_its_journal(form: str, tmp_path: Path) -> None:
    """Half of the rows are in the log of writes that a program leaves which was killed."""
    truth, (name, write) = trip(200), FORMATS[form]
    write(tmp_path / name, truth)
    database = next((tmp_path / name).glob("*.db3")) if form == "rosbag2 db3" else tmp_path / name
    (tmp_path / "killed").mkdir()
    with sqlite3.connect(database) as connection:
        tables = [name for (name,) in connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'")]
        large = [
            table for table in tables if connection.execute(f"SELECT count(*) FROM {table}").fetchone()[0] > 100
        ]
        rows = {table: connection.execute(f"SELECT * FROM {table} WHERE rowid > 100").fetchall() for table in large}
        for table in large:
            connection.execute(f"DELETE FROM {table} WHERE rowid > 100")
    connection.execute("PRAGMA journal_mode = WAL")
    connection.execute("PRAGMA wal_autocheckpoint = 0")
    with connection:
        for table in large:
            connection.executemany(
                f"INSERT INTO {table} VALUES ({', '.join('?' * len(rows[table][0]))})", rows[table]
            )
    for file in (database, database.with_name(f"{database.name}-wal")):
        shutil.copy(file, tmp_path / "killed" / file.name)
    connection.close()
    recording, proposal = import_log(tmp_path / "killed" / database.name, tmp_path)
    assert "was not closed" in " ".join(proposal.warnings)
    assert_holds(recording, truth)


@IN_PROCESS
@pytest.mark.parametrize("fraction", [0.3, 0.5, 0.9])
def test_mcap_that_was_not_closed_is_read_as_far_as_it_goes(fraction: float, tmp_path: Path) -> None:
    """Messages are in chunks of some kilobytes: all of those before the cut are there, as they were."""
    truth, source = trip(300), tmp_path / "trip.mcap"
    log_trip.write_json_mcap(source, truth, chunk_bytes=4000)
    form, whole = log_format(source), source.read_bytes()
    assert form is not None
    topics = {topic.name: topic for topic in read_log(source, form).topics}
    source.write_bytes(whole[: int(fraction * len(whole))])
    log = read_log(source, form)
    assert "cut short" in log.remarks[0]
    assert sum(topic.count for topic in log.topics) > (fraction - 0.1) * sum(map(len, truth.ns.values()))
    for topic in log.topics:
        np.testing.assert_array_equal(topic.time_ns, topics[topic.name].time_ns[: topic.count])
        for name, entry in topic.fields.items():
            np.testing.assert_array_equal(entry.samples, topics[topic.name].fields[name].samples[: topic.count])


def test_broken_lines_of_json_are_left_out_if_they_are_few(tmp_path: Path) -> None:
    truth, source = trip(100), tmp_path / "trip.jsonl"
    log_trip.write_json_lines(source, truth)
    lines = source.read_text().splitlines()
    lines[100] = lines[100][:30] + lines[101]
    source.write_text("\n".join(lines) + "\n")
    assert "1 lines, the first line 101, are no JSON: left out" in read_table_or_log(source).remarks
    source.write_text("\n".join(line[: 30 if number % 10 == 3 else None] for number, line in enumerate(lines)))
    with pytest.raises(InputError, match="line 4 is no JSON"):
        read_table_or_log(source)


@pytest.mark.parametrize("name", ["ULog", "DataFlash"])
@pytest.mark.parametrize("byte", [3, 7, *nightly(5)])
def test_broken_byte_of_a_time_costs_its_row_alone(name: str, byte: int, tmp_path: Path) -> None:
    """Of a time since the autopilot's start [us, 8 bytes]: it was hours, years or an age later."""
    truth = trip(start_ns=log_trip.START_NS // 10**6 * 10**6, resolution_ns=1000)
    file, write = FORMATS[name]
    write(tmp_path / file, truth)
    whole, row = bytearray((tmp_path / file).read_bytes()), 150
    time_us = (int(truth.ns["gyro"][row]) - int(truth.ns["gps"][0])) // 1000 + 20_000_000
    place = whole.index(time_us.to_bytes(8, "little"))  # of the first message of that time
    whole[place + byte] ^= 0x40
    (tmp_path / file).write_bytes(whole)
    recording, proposal = import_log(tmp_path / file, tmp_path)
    assert "1 rows have a broken time: left out" in " ".join(proposal.warnings)
    for channel in ("latitude_deg", "heading_deg", "yaw_rate_dps"):
        assert set(recording.series[channel].measured_ns) <= set(truth.of(channel)[0])
    counts = [recording.series[channel].value.size for channel in ("heading_deg", "yaw_rate_dps")]
    assert sum(counts) >= 2 * truth.ns["gyro"].size - 2


@IN_PROCESS
@pytest.mark.parametrize("kind", ["a cut", "another kind"])
def test_ulog_says_where_it_is_damaged(kind: str, tmp_path: Path) -> None:
    source, truth = tmp_path / "trip.ulg", trip(200)
    log_trip.write_ulog(source, truth)
    whole = bytearray(source.read_bytes())
    at, count = 16, 0
    while count < 300:  # messages
        at, count = at + 3 + int.from_bytes(whole[at : at + 2], "little"), count + 1
    whole[at + 2] ^= 0x80
    source.write_bytes(whole[: at + 20] if kind == "a cut" else whole)
    form = log_format(source)
    assert form is not None
    assert f"damaged, or cut short, at byte {at:,} of" in " ".join(read_log(source, form).remarks)


@IN_PROCESS
@pytest.mark.parametrize(
    ("types", "reason"),
    [
        (["a:uint64_t timestamp;a[2] x;"], "in itself"),
        ([f"{name}:uint64_t timestamp;{nested}[1000] x;" for name, nested in ("ab", "bc", "cd")] + ["d:float y;"],
         "longer than the 65,535 bytes"),
        (["a:uint64_t timestamp;nowhere x;"], "not defined"),
        (["a:uint64_t time;float x;"], "without times"),
    ],
)  # fmt: skip
def test_ulog_leaves_out_types_that_no_message_can_have(types: list[str], reason: str, tmp_path: Path) -> None:
    """pyulog listed every element of nested arrays, 10^9 of them, and lost the other topics of a type in itself."""
    source = tmp_path / "trip.ulg"
    log_trip.write_ulog(source, trip(20))
    whole = source.read_bytes()
    first = 16 + 3 + 40  # after the header and the flags
    formats = b"".join(struct.pack("<HB", len(text), ord("F")) + text.encode() for text in types)
    topic = struct.pack("<HBBH", 4, ord("A"), 0, 9) + b"a" + struct.pack("<HBHQf", 14, ord("D"), 9, 1, 1.0)
    source.write_bytes(whole[:first] + formats + whole[first:] + topic)
    form = log_format(source)
    assert form is not None
    log = read_log(source, form)
    assert len(log.topics) == 4
    assert reason in log.left_out["a"][2]


@IN_PROCESS
def test_dataflash_message_that_states_no_length_has_an_end(tmp_path: Path) -> None:
    """Pymavlink read it again and again, as its place is that of the next."""
    source = tmp_path / "trip.bin"
    log_trip.write_dataflash(source, trip(20))
    form, whole = log_format(source), source.read_bytes()
    assert form is not None
    definition = b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", 1, 0, b"", b"", b"")
    first = 89  # the definition of definitions
    source.write_bytes(whole[:first] + definition + b"\xa3\x95\x01" + whole[first:])
    with pytest.raises(ValueError, match="no message of motion"):
        read_log(source, form)


@IN_PROCESS
def test_mdf_whose_groups_follow_upon_themselves_is_refused(tmp_path: Path) -> None:
    """asammdf counted them until its time was over."""
    pytest.importorskip("asammdf")
    source = tmp_path / "trip.mf4"
    log_trip.write_mdf(source, trip(20))
    whole, header = bytearray(source.read_bytes()), 64
    (group,) = struct.unpack_from("<Q", whole, header + 24)
    struct.pack_into("<Q", whole, group + 24, group)
    source.write_bytes(whole)
    with pytest.raises(ValueError, match="follow upon themselves"):
        read_log(source, log_format(source))  # type: ignore[arg-type]


@IN_PROCESS
def test_ulog_that_ends_within_a_broken_definition_is_refused(tmp_path: Path) -> None:
    """pyulog went back by more than it had read, and never came to the end."""
    source = tmp_path / "trip.ulg"
    log_trip.write_ulog(source, trip(20))
    source.write_bytes(source.read_bytes()[: 16 + 3 + 40] + struct.pack("<HB", 20_000, 0) + bytes(300))
    with pytest.raises(ValueError, match="holds no topic"):
        read_log(source, log_format(source))  # type: ignore[arg-type]


@IN_PROCESS
def test_ulog_says_that_messages_of_unknown_topics_are_left_out(tmp_path: Path) -> None:
    source = tmp_path / "trip.ulg"
    log_trip.write_ulog(source, trip(20))
    form = log_format(source)
    assert form is not None
    assert not any("left out" in remark for remark in read_log(source, form).remarks)
    with source.open("ab") as file:
        file.write(struct.pack("<HBHQf", 14, ord("D"), 9, 21_000_000, 1.0))
    assert any("does not define" in remark for remark in read_log(source, form).remarks)


@IN_PROCESS
def test_tdms_of_many_channels_is_read_in_one_pass(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of one channel the library passes over all before it: 20,000 took more than a minute."""
    from nptdms import ChannelObject, TdmsWriter
    from nptdms.reader import TdmsReader

    passes, read = [], TdmsReader.read_raw_data
    monkeypatch.setattr(TdmsReader, "read_raw_data", lambda reader: passes.append(1) or read(reader))
    monkeypatch.delattr(TdmsReader, "read_raw_data_for_channel")
    about = {
        "wf_start_time": np.datetime64("2026-05-17T12:00:00", "us"),
        "wf_increment": 0.1,
        "wf_start_offset": 0.0,
    }
    with TdmsWriter(tmp_path / "trip.tdms") as writer:
        writer.write_segment(
            [ChannelObject("ship", f"c{number}", number + np.arange(3.0), about) for number in range(50)]
        )
    form = log_format(tmp_path / "trip.tdms")
    assert form is not None
    log = read_log(tmp_path / "trip.tdms", form)
    assert passes == [1]
    assert [field.samples[0] for field in log.topics[0].fields.values()] == list(range(50))


@IN_PROCESS
@pytest.mark.parametrize("has_zero_start", [True, False])
def test_waveform_without_a_start_gives_way_to_a_channel_of_times(has_zero_start: bool, tmp_path: Path) -> None:
    """LabVIEW writes an increment of 1 s, and a start of zero in 1904, for an array that has neither."""
    from nptdms import ChannelObject, TdmsWriter

    truth, source = trip(200, resolution_ns=1000, start_ns=log_trip.START_NS // 1000 * 1000), tmp_path / "trip.tdms"
    about: dict[str, Any] = {"wf_increment": 1.0, "wf_start_offset": 0.0}
    if has_zero_start:
        about["wf_start_time"] = np.datetime64("1904-01-01", "us")
    with TdmsWriter(source) as writer:
        for topic, ns in truth.ns.items():
            times = ChannelObject(topic, "Time", ns.view("datetime64[ns]").astype("datetime64[us]"), about)
            channels = [
                ChannelObject(topic, head, values, about)
                for head, values in log_trip.with_units(truth, topic).items()
            ]
            writer.write_segment([times, *channels])
    recording, proposal = import_log(source, tmp_path)
    assert not proposal.unanswered
    assert_holds(recording, truth)


TDMS_START_NS = log_trip.START_NS // 1000 * 1000


def write_segment(
    path: Path, first: int, count: int, start_s: float | None, *, mode: str = "a", index: bool = False, **about: Any
) -> None:
    """Headings that count in tenths, with their start and a step of 0.1 s if there is a start."""
    from nptdms import ChannelObject, TdmsWriter

    if start_s is not None:
        start = np.datetime64(TDMS_START_NS // 1000 + round(start_s * 1e6), "us")
        about = {"wf_start_time": start, "wf_increment": 0.1, **about}
    with TdmsWriter(str(path), mode=mode, index_file=index) as writer:
        writer.write_segment([ChannelObject("nav", "Heading", (first + np.arange(count)) / 10.0, about)])


@pytest.mark.parametrize(
    "starts_s", [(0.0, 600.0), (0.0, None, 600.0), (0.0, 5.0), (0.0, 0.0), (0.0, 600.0, 60.0), (None, 0.0)]
)
def test_segments_of_a_waveform_are_of_the_starts_that_they_state(
    starts_s: tuple[float | None, ...], tmp_path: Path
) -> None:
    """One without a start, or with the same, goes on from the one before; no start is that of a part alone."""
    expected, source = list[float](), tmp_path / "trip.tdms"
    for number, start_s in enumerate(starts_s):
        write_segment(source, 50 * number, 50, start_s, mode="a" if number else "w")
        goes_on = number > 0 and (start_s is None or start_s == starts_s[number - 1])
        begin = expected[-1] + 0.1 if goes_on else start_s or 0.0
        expected += (begin + np.arange(50) / 10.0).tolist()
    if starts_s[0] is None:
        with pytest.raises(InputError, match="a start for a part of its samples"):
            import_log(source, tmp_path)
        return
    recording, proposal = import_log(source, tmp_path)
    series = recording.series["heading_deg"]
    np.testing.assert_array_equal(series.measured_ns, TDMS_START_NS + np.rint(np.array(expected) * 1e9).astype(int))
    np.testing.assert_allclose(series.value, np.arange(series.value.size) / 10.0)
    distinct = len({start_s for start_s in starts_s if start_s is not None})
    assert (f"states {distinct} starts" in str(proposal.warnings)) == (distinct > 1)


@pytest.mark.parametrize(
    ("about", "says"),
    [
        ({"unit_string": "rad"}, "its unit or scale changes on the way, from 'deg' to 'rad'"),
        ({"wf_start_time": np.datetime64("1600-05-17", "us")}, "its start is no date"),
        ({"wf_increment": float("nan")}, "are no times"),
        ({"wf_increment": 1e300}, "are no times"),
    ],
)
def test_waveform_that_cannot_be_dated_or_scaled_is_one_line(
    about: dict[str, Any], says: str, tmp_path: Path
) -> None:
    write_segment(tmp_path / "trip.tdms", 0, 50, 0.0, mode="w", unit_string="deg")
    write_segment(tmp_path / "trip.tdms", 50, 50, None, **about)
    with pytest.raises(InputError, match=says):
        import_log(tmp_path / "trip.tdms", tmp_path)


def test_index_beside_a_measurement_decides_nothing(tmp_path: Path) -> None:
    """It may end before the measurement, which went on without it."""
    write_segment(tmp_path / "trip.tdms", 0, 50, 0.0, mode="w", index=True)
    write_segment(tmp_path / "trip.tdms", 50, 50, None)
    assert (tmp_path / "trip.tdms_index").is_file()
    recording, _ = import_log(tmp_path / "trip.tdms", tmp_path)
    assert recording.series["heading_deg"].value.size == 100


@IN_PROCESS
def test_measurement_that_is_cut_says_so_unless_between_segments(tmp_path: Path) -> None:
    """Also where the cut is in what a segment states of its samples."""
    source, ends = tmp_path / "trip.tdms", list[int]()
    for number in range(3):
        write_segment(source, 20 * number, 20, 600.0 * number, mode="a" if number else "w")
        ends.append(source.stat().st_size)
    whole = source.read_bytes()
    for size in range(ends[0], len(whole), 37):
        source.write_bytes(whole[:size])
        form = log_format(source)
        assert form is not None
        assert ("ends in the middle" in str(read_log(source, form).remarks)) == (size not in ends), size


@IN_PROCESS
@pytest.mark.parametrize("form", ["date and time", "uptime before the time", "numbers in quotes"])
def test_members_of_json_messages_are_what_they_say(form: str, tmp_path: Path) -> None:
    truth, rows = trip(200, resolution_ns=1000, start_ns=log_trip.START_NS // 1000 * 1000), list[tuple[int, str]]()
    for topic, stamps in truth.ns.items():
        for index, ns in enumerate(stamps.tolist()):
            moment = pd.Timestamp(ns)
            table = log_trip.table_of(truth, topic)
            data: dict[str, Any] = {name: float(values[index]) for name, values in table.items()}
            times: dict[str, Any] = {"timestamp": f"{moment}Z"}
            if form == "date and time":
                times = {"date": f"{moment:%d.%m.%Y}", "time": f"{moment:%H:%M:%S.%f}"}
            elif form == "uptime before the time":
                times = {"boot_time": (ns - log_trip.START_NS) / 1e9 + 20.0, "timestamp": ns}
            else:
                data = {name: repr(value) for name, value in data.items()}
            rows.append((ns, json.dumps({"topic": topic, **times, "data": data})))
    (tmp_path / "trip.jsonl").write_text("\n".join(text for _, text in sorted(rows)))
    recording, proposal = import_log(tmp_path / "trip.jsonl", tmp_path)
    assert not proposal.unanswered
    assert_holds(recording, truth)


def arrays_of_a_trip(count: int = 60) -> dict[str, np.ndarray]:
    """Times of a clock that began at noon, headings and what is no column."""
    return {
        "time": log_trip.START_NS // NANO + np.arange(float(count)), "heading": 40.0 + np.arange(count) / 2.0,
        "cube": np.zeros((count, 3, 3)), "spectra": np.zeros((count, 40)), "impedance": np.full(count, 1.0 + 1.0j),
    }  # fmt: skip


@pytest.mark.parametrize("suffix", [".npz", ".h5"])
def test_arrays_that_are_no_columns_are_named(suffix: str, tmp_path: Path) -> None:
    """An array of Python's objects, which is not unpickled, takes none of the others with it."""
    arrays, path = arrays_of_a_trip(), tmp_path / f"trip{suffix}"
    if suffix == ".npz":
        arrays["notes"] = np.array([{"crew": 3}] * 60, dtype=object)
        np.savez(path, **arrays)
    else:
        h5py = pytest.importorskip("h5py")
        with h5py.File(path, "w") as file:
            for name, values in arrays.items():
                file[name] = values
    recording, proposal = import_log(path, tmp_path)
    np.testing.assert_array_equal(recording.series["heading_deg"].value, arrays["heading"])
    assert all(name in str(proposal.warnings) for name in arrays if name not in ("time", "heading"))


def test_durations_of_an_archive_count_from_a_start_that_is_answered(tmp_path: Path) -> None:
    elapsed = (np.arange(60) * 200_000_000).astype("timedelta64[ns]")
    np.savez(tmp_path / "trip.npz", time=elapsed, heading=40.0 + np.arange(60) / 2.0)
    recording, proposal = import_log(tmp_path / "trip.npz", tmp_path, {"start": "2026-05-17T12:00:00Z"})
    assert not proposal.unanswered
    expected = pd.Timestamp("2026-05-17T12:00:00").value + np.arange(60) * 200_000_000
    np.testing.assert_array_equal(recording.series["heading_deg"].measured_ns, expected)


@pytest.mark.parametrize(
    ("unit", "about"),
    [("s", {"timescale": "TAI"}), ("s TAI", {}), ("seconds since 1970-01-01", {"calendar": "tai"}),
     ("seconds since 1970-01-01", {"description": "TAI"})],
)  # fmt: skip
def test_times_of_tai_in_hdf5_become_utc(unit: str, about: dict[str, str], tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    arrays = arrays_of_a_trip()
    with h5py.File(tmp_path / "trip.h5", "w") as file:
        file["time"], file["heading"] = arrays["time"], arrays["heading"]
        file["time"].attrs.update({"units": unit, **about})
    recording, proposal = import_log(tmp_path / "trip.h5", tmp_path)
    assert recording.series["heading_deg"].measured_ns[0] == log_trip.START_NS // NANO * NANO - 37 * NANO
    assert "37 s ahead of UTC" in str(proposal.warnings)


@pytest.mark.parametrize("calendar", ["noleap", "standard"])
def test_times_of_hdf5_are_of_the_calendar_that_it_states(calendar: str, tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    arrays = arrays_of_a_trip()
    with h5py.File(tmp_path / "trip.h5", "w") as file:
        file["time"] = arrays["time"] / 86_400.0
        file["time"].attrs.update({"units": "days since 1970-01-01", "calendar": calendar})
        file["heading"] = arrays["heading"]
    if calendar == "noleap":
        with pytest.raises(InputError, match="its times are of the calendar 'noleap'"):
            import_log(tmp_path / "trip.h5", tmp_path)
        return
    recording, _ = import_log(tmp_path / "trip.h5", tmp_path)
    assert np.abs(recording.series["heading_deg"].measured_ns - arrays["time"] * 1e9).max() < 1_000


@IN_PROCESS
def test_decimals_of_a_database_are_numbers(tmp_path: Path) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    truth = trip(200)
    (tmp_path / "parts").mkdir()
    for topic, ns in truth.ns.items():
        columns = {head: pa.array([Decimal(f"{value:.9f}") for value in values])
                   for head, values in log_trip.with_units(truth, topic).items()}  # fmt: skip
        table = pa.table({"time": pa.array(ns, pa.timestamp("ns", tz="UTC")), **columns})
        pq.write_table(table, tmp_path / "parts" / f"{topic}.parquet")
    recording, _ = import_log(tmp_path / "parts", tmp_path)
    assert_holds(recording, truth, tolerance=1e-8)


def test_file_of_a_bag_of_packed_messages_names_its_folder(tmp_path: Path) -> None:
    """That messages are packed one by one stands in the metadata beside the file alone."""
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
    from rosbags.rosbag2 import Writer as BagWriter
    from rosbags.typesys import Stores, get_typestore

    truth, store = trip(120), get_typestore(Stores.ROS2_HUMBLE)
    writer = BagWriter(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP)
    writer.set_compression(CompressionMode.MESSAGE, CompressionFormat.ZSTD)
    with writer:
        connections: dict[str, Any] = {}
        messages = log_trip.ros_messages(truth, store.types, is_first=False)
        for topic, kind, log_ns, message in sorted(messages, key=lambda entry: entry[2]):
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=store)
            writer.write(connections[topic], log_ns, store.serialize_cdr(message, kind))
    assert_holds(import_log(tmp_path / "bag", tmp_path)[0], truth)
    with pytest.raises(InputError, match="give the bag's folder"):
        read_table_or_log(tmp_path / "bag" / "bag.mcap")


UNUSUAL_NAMES = {
    "rot_deg_min": ("gyro", "yaw_rate_dps", 60.0), "rot_rads": ("gyro", "yaw_rate_dps", np.pi / 180.0),
    "shaft_rps": ("engine", "propeller_rpm", 1.0 / 60.0), "pos_n_m": ("gps", "north_m", 1.0),
    "true_speed_kn": ("wind", "wind_speed_mps", 3600.0 / 1852.0),
    "Wind_spd_true_kn": ("wind", "wind_speed_mps", 3600.0 / 1852.0),
    "hdg_rad": ("gyro", "heading_deg", np.pi / 180.0), "pos_e_m": ("gps", "east_m", 1.0),
}  # fmt: skip
"""Fields by the topic that they are in: the channel, and how much of the field's unit is one of the channel's."""
BESIDE = {"dir_deg": ("wind", "wind_direction_deg", 1.0), "u_mps": ("log", "surge_mps", 1.0),
          "hdg_deg": ("gyro", "heading_deg", 1.0), "pos_n_m": ("gps", "north_m", 1.0),
          "pos_e_m": ("gps", "east_m", 1.0), "rudder_deg": ("steering", "rudder_angle_deg", 1.0)}  # fmt: skip


@IN_PROCESS
@pytest.mark.parametrize("name", UNUSUAL_NAMES)
def test_field_is_known_by_unit_and_topic_where_its_name_is_short(name: str, tmp_path: Path) -> None:
    """A rate in "deg_min", a "true_speed" of the wind, metres "n" that are no newtons: taken for what they are, and
    what is not taken of a topic is said."""
    truth = trip()
    latitude, longitude = (truth.of(key)[1] for key in ("latitude_deg", "longitude_deg"))
    north, east, _ = pymap3d.geodetic2ned(latitude, longitude, 0.0, 63.43, 10.39, 0.0)
    ns, seconds = truth.ns | {"wind": truth.ns["gps"] + 11}, np.arange(300.0)
    values = {key: part for key, (_, part) in truth.channels.items()} | {
        "north_m": north, "east_m": east, "wind_direction_deg": 40.0 + 5.0 * np.sin(seconds / 20.0),
        "wind_speed_mps": 7.0 + np.sin(seconds / 15.0),
    }  # fmt: skip
    topic, channel, size = UNUSUAL_NAMES[name]
    fields = {key: entry for key, entry in BESIDE.items() if entry[1] != channel} | {name: (topic, channel, size)}
    with closing(sqlite3.connect(tmp_path / "log.sqlite")) as store:
        for of in {entry[0] for entry in fields.values()}:
            table = {
                key: size * values[of_channel] for key, (place, of_channel, size) in fields.items() if place == of
            }
            frame = pd.DataFrame({"time_ns": ns[of], **table, "gain_bits": seconds})
            frame.to_sql(of, store, index=False)
    recording, proposal = import_log(tmp_path / "log.sqlite", tmp_path)
    series = recording.series[channel]
    np.testing.assert_array_equal(series.measured_ns, ns[topic])
    np.testing.assert_allclose(series.value, values[channel], rtol=1e-9)
    assert "speed_over_ground_mps" not in recording.series
    assert any("not taken of these" in text and f"{topic}.gain_bits" in text for text in proposal.warnings)


@IN_PROCESS
def test_time_that_a_message_states_goes_before_that_of_the_log(tmp_path: Path) -> None:
    """Messages of protobuf that are logged 5 ms after they were measured, with a number of us in each."""
    truth = trip(resolution_ns=1000, start_ns=log_trip.START_NS // 1_000_000 * 1_000_000)
    log_trip.write_protobuf_mcap(tmp_path / "log.mcap", truth, late_ns=5_000_000)
    recording, _ = import_log(tmp_path / "log.mcap", tmp_path)
    assert_holds(recording, truth)
