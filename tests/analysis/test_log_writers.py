"""A recording as a bag of ROS 2 and as a measurement by ASAM MDF: read by their own libraries, and imported."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from seatrial.acquisition.core.errors import DataShortageError
from seatrial.acquisition.tables.import_table import import_table
from seatrial.acquisition.tables.topics import read_table_or_log
from seatrial.analysis.tables.export import export_table
from seatrial.analysis.tables.table import read_table

START_NS = 1_790_000_000_123_456_789
ORIGIN = 63.4, 10.4
TRIAL = {
    "name": 'a <trial> & "more"', "vessel": "gunnerus_short", "origin_latitude_deg": ORIGIN[0],
    "origin_longitude_deg": ORIGIN[1],
}  # fmt: skip


@pytest.fixture(scope="module")
def table() -> pd.DataFrame:
    """Three days of sensors with rates and times of their own, to odd nanoseconds; every channel of the ship."""
    random = np.random.default_rng(5)
    periods_s = {
        "north_m": 1.0, "east_m": 1.0, "heading_deg": 0.1, "surge_mps": 0.5, "sway_mps": 0.5, "yaw_rate_dps": 0.2,
        "wind_direction_deg": 2.0, "wind_speed_mps": 2.0, "port_rpm": 0.7, "port_angle_deg": 0.7,
        "starboard_rpm": 0.7, "starboard_angle_deg": 0.7, "tunnel_rpm": 5.0,
    }  # fmt: skip
    columns = {}
    for number, (name, period_s) in enumerate(periods_s.items()):
        count = int(100.0 / period_s)
        first = 3600 * 72 * 10**9 * np.arange(count) // count if name == "tunnel_rpm" else np.arange(count) * 0
        offset_ns = (number - (name in ("sway_mps", "east_m", "port_angle_deg"))) * 1_000_003
        ns = START_NS + first + (np.arange(count) * period_s * 1e9).astype(np.int64) + offset_ns
        values = random.normal(0.0, 20.0, count) % 360.0 if name.startswith(("heading", "wind_d")) else np.abs(
            random.normal(1.0, 3.0, count)
        )  # fmt: skip
        columns[name] = pd.Series(values, pd.DatetimeIndex(ns.astype("datetime64[ns]"), tz="UTC"))
    frame = pd.DataFrame(columns).rename_axis("time")
    frame.attrs["trial"] = TRIAL
    return frame


@pytest.mark.parametrize("suffix", [".db3", ".mf4"])
def test_export_is_imported_without_a_question_as_it_was(table: pd.DataFrame, suffix: str, tmp_path: Path) -> None:
    """Every value at its nanosecond; in a bag, what is turned into the axes of ROS to a rounding."""
    path = tmp_path / f"trial{suffix}"
    export_table(table, path)
    import_table(path, tmp_path / "back.mcap")
    back = read_table(tmp_path / "back.mcap")
    assert sorted(back.columns) == sorted(table.columns)
    for name in table.columns:
        before, after = table[name].dropna(), back[name].dropna()
        pd.testing.assert_index_equal(before.index, after.index, check_names=False)
        tolerance = 1e-12 if suffix == ".db3" and name in ("heading_deg", "yaw_rate_dps") else 0.0
        np.testing.assert_allclose(after.to_numpy(), before.to_numpy(), rtol=0.0, atol=tolerance, err_msg=name)
    trial = back.attrs["trial"]
    assert {key: trial[key] for key in TRIAL} == TRIAL


def test_measurement_has_units_start_and_a_group_for_each_set_of_times(table: pd.DataFrame, tmp_path: Path) -> None:
    mdf = pytest.importorskip("asammdf")
    export_table(table, tmp_path / "trial.mf4")
    with mdf.MDF(tmp_path / "trial.mf4") as file:
        assert file.version == "4.10"
        assert pd.Timestamp(file.start_time).value == START_NS // 1000 * 1000
        groups = [[channel.name for channel in group.channels[1:]] for group in file.groups]
        assert ["port_rpm", "port_angle_deg"] in groups
        assert len(groups) == 10
        assert sorted(name for names in groups for name in names) == sorted(table.columns)
        assert {name: file.get(name).unit for name in ("north_m", "yaw_rate_dps", "port_rpm")} == {
            "north_m": "m", "yaw_rate_dps": "deg/s", "port_rpm": "rpm"
        }  # fmt: skip


def test_bag_has_the_messages_and_axes_of_ros(table: pd.DataFrame, tmp_path: Path) -> None:
    """By rosbags and by formulas of another kind: rotation matrices, and the lengths of degrees at the place."""
    highlevel = pytest.importorskip("rosbags.highlevel")
    tilted = table.assign(roll_deg=table["heading_deg"] * 0.0 + 4.0, pitch_deg=table["heading_deg"] * 0.0 - 3.0)
    tilted.attrs = table.attrs
    export_table(tilted, tmp_path / "trial.db3")
    messages: dict[str, list[tuple[int, Any]]] = {}
    kinds = {}
    with highlevel.AnyReader([tmp_path / "trial.db3"]) as reader:
        for connection, log_ns, data in reader.messages():
            kinds[connection.topic] = connection.msgtype.rpartition("/")[2]
            messages.setdefault(connection.topic, []).append((log_ns, reader.deserialize(data, connection.msgtype)))
    assert {kinds[name] for name in ("/fix", "/imu", "/imu/rate", "/velocity", "/tunnel_rpm", "/seatrial")} == {
        "NavSatFix", "Imu", "TwistStamped", "Float64", "String"
    }  # fmt: skip
    for topic, entries in messages.items():
        for log_ns, message in entries if hasattr(entries[0][1], "header") else ():
            assert message.header.stamp.sec * 10**9 + message.header.stamp.nanosec == log_ns, topic
    _, fix = messages["/fix"][7]
    row = table.dropna(subset=["north_m"]).iloc[7]
    north_per_deg, east_per_deg = 111_476.0, 111_320.0 * np.cos(np.deg2rad(ORIGIN[0])) * 1.0027
    assert (fix.latitude - ORIGIN[0]) * north_per_deg == pytest.approx(row["north_m"], rel=2e-3)
    assert (fix.longitude - ORIGIN[1]) * east_per_deg == pytest.approx(row["east_m"], rel=2e-3)
    for (_, message), heading in zip(messages["/imu"], table["heading_deg"].dropna(), strict=True):
        q = message.orientation
        ahead = np.array([1 - 2 * (q.y**2 + q.z**2), 2 * (q.x * q.y + q.w * q.z), 2 * (q.x * q.z - q.w * q.y)])
        port = np.array([2 * (q.x * q.y - q.w * q.z), 1 - 2 * (q.x**2 + q.z**2), 2 * (q.y * q.z + q.w * q.x)])
        assert np.rad2deg(np.arctan2(ahead[0], ahead[1])) % 360.0 == pytest.approx(heading, abs=1e-9)  # east, north
        assert np.rad2deg(np.arcsin(ahead[2])) == pytest.approx(-3.0)  # bow down
        assert port[2] == pytest.approx(np.sin(np.deg2rad(4.0)) * np.cos(np.deg2rad(-3.0)))  # starboard down
        assert message.linear_acceleration_covariance[0] == -1.0
    for (_, message), rate in zip(messages["/imu/rate"], table["yaw_rate_dps"].dropna(), strict=True):
        assert message.angular_velocity.z == pytest.approx(-np.deg2rad(rate))
        assert message.orientation_covariance[0] == -1.0
    for (_, message), sway in zip(messages["/velocity"], table["sway_mps"].dropna(), strict=True):
        assert message.twist.linear.y == -sway
        assert np.isnan(message.twist.angular.z)


def test_heading_without_roll_and_pitch_is_no_level_ship(table: pd.DataFrame, tmp_path: Path) -> None:
    """Nobody measured them: the message says so by a variance, and no reader of ours makes channels of them."""
    export_table(table, tmp_path / "trial.db3")
    names = read_table_or_log(tmp_path / "trial.db3").names
    assert "heading_deg" in names
    assert not {"roll_deg", "pitch_deg"} & set(names)


@pytest.mark.parametrize("suffix", [".db3", ".mf4"])
def test_columns_that_are_no_channels_come_back_as_they_were(
    table: pd.DataFrame, suffix: str, tmp_path: Path
) -> None:
    named = table[["surge_mps", "sway_mps"]].set_axis(["Fart", "data"], axis=1)
    export_table(named, tmp_path / f"own{suffix}")
    raw = read_table_or_log(tmp_path / f"own{suffix}")
    assert raw.names == ["time", "Fart", "data"]
    np.testing.assert_array_equal(raw.columns["Fart"].dropna(), named["Fart"].dropna())


@pytest.mark.parametrize("suffix", [".db3", ".mf4"])
def test_table_without_a_value_is_refused(table: pd.DataFrame, suffix: str, tmp_path: Path) -> None:
    with pytest.raises(DataShortageError, match="holds no value"):
        export_table(table * np.nan, tmp_path / f"trial{suffix}")
    assert not list(tmp_path.iterdir())
