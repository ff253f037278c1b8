"""What loggers of small craft write: vectors in numbered columns, shafts n1 and n2, speeds never filled in,
and a connection that stalls."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seatrial.acquisition.core.quantities import Floats
from seatrial.acquisition.tables.column_map import stalled_row_mask
from seatrial.acquisition.tables.import_table import propose_column_map
from seatrial.acquisition.tables.table_files import read_raw_table

RATE_HZ = 8.0
seconds = np.arange(0.0, 240.0, 1.0 / RATE_HZ)  # of the rows


def motion(time_s: Floats, speed_mps: float = 1.4) -> pd.DataFrame:
    """A boat that weaves at a steady speed."""
    heading = 0.9 * np.sin(0.11 * time_s) + 0.01 * time_s
    step = np.diff(time_s, prepend=time_s[0] - 1.0 / RATE_HZ)
    return pd.DataFrame({
        "north_m": np.cumsum(speed_mps * np.cos(heading) * step),
        "east_m": np.cumsum(speed_mps * np.sin(heading) * step),
        "heading_deg": np.rad2deg(heading) % 360.0,
        "yaw_rate_dps": np.rad2deg(0.099 * np.cos(0.11 * time_s) + 0.01),
    })  # fmt: skip


def received(start_s: float, lasted_s: float, pace: float) -> Floats:
    """Of which moment each row tells when the line stalls, and what waited comes ``pace`` times too fast."""
    end_s = start_s + lasted_s
    behind = np.maximum(lasted_s - (pace - 1.0) * np.maximum(seconds - end_s, 0.0), 0.0)
    return np.where(
        (seconds > start_s) & (seconds <= end_s), start_s, np.where(seconds > end_s, seconds - behind, seconds)
    )


@given(start_s=st.floats(20.0, 150.0), lasted_s=st.floats(1.5, 20.0), pace=st.floats(2.5, 6.0))
def test_a_stalled_connection_is_found_to_its_end(start_s: float, lasted_s: float, pace: float) -> None:
    told_s = received(start_s, lasted_s, pace)
    table = pd.DataFrame({name: np.interp(told_s, seconds, motion(seconds)[name]) for name in motion(seconds)})
    stalled, late_s = stalled_row_mask(seconds, table), seconds - told_s
    assert stalled[late_s > 1.0].all()
    caught_up_s = start_s + lasted_s * pace / (pace - 1.0)
    assert not stalled[(seconds < start_s) | (seconds > caught_up_s + 1.0)].any()


@pytest.mark.parametrize("every", [8, 24])
def test_a_slow_sensor_that_is_polled_often_does_not_stall(every: int) -> None:
    table = motion(seconds).iloc[np.arange(seconds.size) // every * every].reset_index(drop=True)
    assert not stalled_row_mask(seconds, table).any()


def test_a_boat_at_rest_does_not_stall() -> None:
    moving = motion(seconds)
    at_rest = pd.concat([moving.iloc[:600], pd.DataFrame([moving.iloc[600]] * 600), moving.iloc[600:]])
    slowing = at_rest.iloc[np.r_[0:560, 560:600:4, 600:1300]].reset_index(drop=True)
    slowing["yaw_rate_dps"] += np.random.default_rng(3).normal(
        0.0, 0.01, len(slowing)
    )  # a gyro is never quite still
    assert not stalled_row_mask(np.arange(len(slowing)) / RATE_HZ, slowing).any()


@pytest.mark.parametrize("port", ["n1", "n2"])
@pytest.mark.parametrize("first", [0, 1])
def test_numbered_columns_are_told_by_what_they_do(tmp_path: Path, port: str, first: int) -> None:
    track, starboard = motion(seconds), {"n1": "n2", "n2": "n1"}[port]
    table = pd.DataFrame({"time": 1.7e9 + seconds, "lat": 63.4 + track["north_m"] / 111_200.0})
    table["lon"] = 10.4 + track["east_m"] / (111_200.0 * np.cos(np.deg2rad(63.4)))
    angles = {0: 0.2 * np.sin(seconds), 1: 0.1 * np.cos(seconds), 2: (track["heading_deg"] + 180.0) % 360.0 - 180.0}
    rates = {0: 0.2 * np.cos(seconds), 1: 0.1 * np.sin(seconds), 2: np.deg2rad(track["yaw_rate_dps"])}
    for axis in range(3):
        table[f"orientation_{axis + first}"] = angles[axis]
        table[f"body_angular_velocity_{axis + first}"] = rates[axis]
    table[port], table[starboard] = 600.0 + 20.0 * track["yaw_rate_dps"], 600.0 - 20.0 * track["yaw_rate_dps"]
    table["speed_surge"] = 0.0
    table.to_csv(tmp_path / "boat.csv", index=False)
    proposal = propose_column_map(read_raw_table(tmp_path / "boat.csv"), vessel="otter_2m")
    taken = {reading.column: (reading.taken_for, reading.unit) for reading in proposal.readings}
    assert taken[f"orientation_{2 + first}"] == ("heading_deg", "deg")
    assert taken[f"body_angular_velocity_{2 + first}"] == ("yaw_rate_dps", "rad/s")
    assert (taken[port], taken[starboard]) == (("port_rpm", "rpm"), ("starboard_rpm", "rpm"))
    assert taken["speed_surge"][0] == "-"
    assert not proposal.questions


def test_shafts_that_turn_alike_are_asked(tmp_path: Path) -> None:
    table = pd.DataFrame({"time": 1.7e9 + seconds, **motion(seconds), "n1": 600.0, "n2": 600.0})
    table.to_csv(tmp_path / "boat.csv", index=False)
    (question,) = propose_column_map(read_raw_table(tmp_path / "boat.csv"), vessel="otter_2m").unanswered
    assert question.key == "first_shaft"
    answered = propose_column_map(read_raw_table(tmp_path / "boat.csv"), {"first_shaft": "starboard"}, "otter_2m")
    assert ("n1", "starboard_rpm") in [(reading.column, reading.taken_for) for reading in answered.readings]
