"""What a check says of a recording drives how it is diagnosed: parts between jumps, nothing frozen."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from acquisition.core.trial import Trial
from acquisition.recording.reader import read_recording
from acquisition.recording.tables import write_table
from analysis.quality.motion.checks import check_motion
from hybrid.diagnosis.log import log_of
from hybrid.effects import CATALOGUE
from hybrid.simulation.trial import simulate_trial
from hybrid.workflows.checked import Checked, checked_tables, without_wind


@pytest.fixture(scope="module")
def sound() -> pd.DataFrame:
    return simulate_trial("gunnerus_short", "gentle", "voyage", 900.0, 2.0, 4)[0]


def checked(table: pd.DataFrame, folder: Path, *, repaired: bool = False) -> Checked:
    path = folder / "trial.mcap"
    write_table(table, path, Trial("trial", "gunnerus_short"), source="simulated")
    return checked_tables(read_recording(path), repaired=repaired)


def test_a_sound_recording_is_taken_as_it_is(sound: pd.DataFrame, tmp_path: Path) -> None:
    found = checked(sound, tmp_path)
    assert found.remarks == ()
    (table,) = found.tables
    assert len(log_of([table])) > 850


def test_positions_that_jump_part_a_recording(sound: pd.DataFrame, tmp_path: Path) -> None:
    row = len(sound) // 2
    jumping = sound.copy()
    jumping.iloc[row:, jumping.columns.get_loc("north_m")] += 200.0
    found = checked(jumping, tmp_path)
    before, after = found.tables
    assert before.index[-1] < sound.index[row] < after.index[0]
    assert "positions jump by" in found.remarks[0]
    log = log_of(found.tables)
    assert set(log.recording) == {0}
    crosses = np.diff(log.nominal[:, 0])[np.diff(log.block) == 0]
    assert np.abs(crosses).max() < 10.0


def test_a_frozen_sensor_is_left_out_where_it_was(sound: pd.DataFrame, tmp_path: Path) -> None:
    stuck = sound.copy()
    rows = slice(600, 1000)
    column = stuck.columns.get_loc("sway_mps")
    stuck.iloc[rows, column] = stuck.iloc[600, column]
    found = checked(stuck, tmp_path)
    (table,) = found.tables
    assert table["sway_mps"].iloc[601:1000].isna().mean() > 0.99
    assert table["sway_mps"].notna().sum() > 1300
    assert any("sway_mps" in each for each in found.remarks)


@pytest.mark.parametrize("name", ["yaw_rate_dps", "sway_mps", "surge_mps"])
def test_a_sensor_that_is_not_there_is_none(sound: pd.DataFrame, tmp_path: Path, name: str) -> None:
    """The log goes without it: what it would have read is free."""
    found = checked(sound.assign(**{name: 0.1}), tmp_path)
    (table,) = found.tables
    assert table[name].isna().all()
    assert any(name in each for each in found.remarks)
    log = log_of([table])
    column = ("north_m", "east_m", "heading_deg", "surge_mps", "sway_mps", "yaw_rate_dps").index(name)
    assert len(log) > 850
    assert (np.isfinite(log.measured).any(axis=0) == (np.arange(6) != column)).all()


def test_delays_that_are_certain_are_taken_off_before(sound: pd.DataFrame, tmp_path: Path) -> None:
    late = sound.assign(**{name: np.interp(np.arange(len(sound)) - 2.0, np.arange(len(sound)), sound[name])
                           for name in ("north_m", "east_m")})  # fmt: skip
    (table,) = checked(late, tmp_path, repaired=True).tables
    assert "channel_delay" not in {each.code for each in check_motion(table).findings}


def test_without_wind_its_effects_are_not_looked_for(sound: pd.DataFrame) -> None:
    wind = ["wind_direction_deg", "wind_speed_mps"]
    assert without_wind(CATALOGUE, [sound]) == CATALOGUE
    for calm in (sound.drop(columns=wind), sound.assign(**dict.fromkeys(wind, np.nan))):
        known = without_wind(CATALOGUE, [sound, calm])
        assert set(CATALOGUE) - set(known) >= {"wind_load", "wind_direction_bias"}
        assert {"ocean_current", "wave_drift", "steady_wind"} <= set(known)
