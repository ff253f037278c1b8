"""What a check says of a recording drives how it is diagnosed: parts between jumps, nothing frozen."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from seatrial.acquisition.core.errors import DataShortageError
from seatrial.acquisition.core.ship import wrap_180
from seatrial.acquisition.core.trial import Trial
from seatrial.acquisition.recording.reader import read_recording
from seatrial.acquisition.recording.writer import write_table
from seatrial.analysis.quality.motion.findings import check_motion
from seatrial.hybrid.diagnosis.log import log_of
from seatrial.hybrid.effects import CATALOGUE
from seatrial.hybrid.simulation.trial import simulate_trial
from seatrial.hybrid.workflows import Checked, checked_tables, replace_wind_effects


@pytest.fixture(scope="module")
def sound() -> pd.DataFrame:
    return simulate_trial("gunnerus_short", "gentle", "voyage", 900.0, 2.0, 4)[0]


def checked(table: pd.DataFrame, folder: Path, *, repaired: bool = False, rebuild: bool | None = None) -> Checked:
    path = folder / "trial.mcap"
    write_table(table, path, Trial("trial", "gunnerus_short"), source="simulated")
    return checked_tables(read_recording(path), repaired=repaired, rebuild_positions=rebuild)


def test_a_sound_recording_is_taken_as_it_is(sound: pd.DataFrame, tmp_path: Path) -> None:
    found = checked(sound, tmp_path)
    assert found.remarks == found.repairs == ()
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
    assert any("sway_mps" in each for each in (*found.remarks, *found.repairs))


@pytest.mark.parametrize(
    "name",
    ["yaw_rate_dps", *(pytest.param(each, marks=pytest.mark.slow) for each in ("sway_mps", "surge_mps"))],
)
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
    late = sound.assign(**{name: np.interp(np.arange(len(sound)) - 3.0, np.arange(len(sound)), sound[name])
                           for name in ("north_m", "east_m")})  # fmt: skip
    (table,) = checked(late, tmp_path, repaired=True).tables
    assert "channel_delay" not in {each.code for each in check_motion(table).findings}


def test_errors_that_a_diagnosis_would_name_stay_and_faults_of_the_record_go(
    sound: pd.DataFrame, tmp_path: Path
) -> None:
    """A scale of speeds is for the diagnosis to name; a heading interpolated through north is no motion."""
    heading = sound["heading_deg"]
    wraps = heading.diff().abs() > 300.0
    spoilt = sound.assign(heading_deg=heading.where(~wraps, 0.5 * (heading + heading.shift())))
    spoilt[["surge_mps", "sway_mps"]] *= 0.95
    for repaired, factor in ((False, 0.95), (True, 1.0)):
        found = checked(spoilt, tmp_path, repaired=repaired)
        (table,) = found.tables
        assert wraps.any()
        assert np.abs(wrap_180(table["heading_deg"] - heading)).max() < 3.0
        assert any("on the circle" in each for each in found.repairs)
        ratio = float((table["surge_mps"] * sound["surge_mps"]).sum() / (sound["surge_mps"] ** 2).sum())
        assert ratio == pytest.approx(factor, abs=0.005)


@pytest.fixture(scope="module")
def jittering(sound: pd.DataFrame) -> pd.DataFrame:
    """Positions of up to a second earlier or later than their stamps say."""
    seconds = np.arange(len(sound)) * 0.5
    off = np.random.default_rng(4).uniform(-1.0, 1.0, len(sound))
    return sound.assign(**{name: np.interp(seconds + off, seconds, sound[name]) for name in ("north_m", "east_m")})


def test_positions_whose_stamps_jitter_are_rebuilt(
    sound: pd.DataFrame, jittering: pd.DataFrame, tmp_path: Path
) -> None:
    """Tracks over a quarter of a minute are judged by them: their error would be that of the stamps."""
    found = checked(jittering, tmp_path)
    (table,) = found.tables
    assert any("positions rebuilt" in each for each in found.repairs)
    off_m = {name: _second_differences(each - sound) for name, each in (("as it is", jittering), ("mended", table))}
    assert off_m["mended"] < 0.1 * off_m["as it is"]


def test_positions_are_kept_on_request(jittering: pd.DataFrame, tmp_path: Path) -> None:
    (table,) = checked(jittering, tmp_path, rebuild=False).tables
    assert np.allclose(table["north_m"], jittering["north_m"], atol=1e-6)


def _second_differences(table: pd.DataFrame) -> float:
    """Root mean square of the second differences of the positions [m]."""
    return float(np.sqrt((table[["north_m", "east_m"]].diff().diff() ** 2).mean().mean()))


def test_without_wind_its_effects_are_not_looked_for(sound: pd.DataFrame) -> None:
    wind = ["wind_direction_deg", "wind_speed_mps"]
    assert replace_wind_effects(CATALOGUE, [sound]) == CATALOGUE
    for calm in (sound.drop(columns=wind), sound.assign(**dict.fromkeys(wind, np.nan))):
        known = replace_wind_effects(CATALOGUE, [sound, calm])
        assert set(CATALOGUE) - set(known) >= {"wind_load", "wind_direction_bias"}
        assert {"ocean_current", "wave_drift", "steady_wind"} <= set(known)


def moored_after(table: pd.DataFrame, seconds: float) -> pd.DataFrame:
    """A recording that goes on with a ship at the quay, her thrusters working."""
    rows, random = round(2.0 * seconds), np.random.default_rng(0)
    stay = table.iloc[np.full(rows, -1)].set_axis(
        table.index[-1] + pd.to_timedelta(0.5 * np.arange(1, rows + 1), "s")
    )
    noise = {"north_m": 0.05, "east_m": 0.05, "heading_deg": 0.1, "surge_mps": 0.03, "sway_mps": 0.03,
             "yaw_rate_dps": 0.05, "wind_speed_mps": 0.2, "wind_direction_deg": 3.0}  # fmt: skip
    still = dict.fromkeys(("surge_mps", "sway_mps", "yaw_rate_dps"), 0.0) | {"port_rpm": 60.0}
    stay = stay.assign(**still)
    for name, sigma in noise.items():
        stay[name] = stay[name] + sigma * random.standard_normal(rows)
    joined = pd.concat([table, stay.assign(heading_deg=stay["heading_deg"] % 360.0)])
    joined.attrs = table.attrs
    return joined


def test_time_at_the_quay_is_left_out_of_a_diagnosis_and_reported(sound: pd.DataFrame, tmp_path: Path) -> None:
    found = checked(moored_after(sound, 400.0), tmp_path)
    (remark,) = (remark for remark in found.remarks if "moored, anchored or aground" in remark)
    assert "s left out" in remark
    times = found.tables[0].index
    assert abs((times[-1] - sound.index[-1]).total_seconds()) < 20.0
    assert len(log_of(found.tables)) == pytest.approx(len(log_of([sound])), abs=30)


def test_recording_of_a_moored_ship_alone_cannot_be_diagnosed(sound: pd.DataFrame, tmp_path: Path) -> None:
    table = moored_after(sound, 600.0).iloc[len(sound) + 10 :]
    with pytest.raises(DataShortageError, match="not free to move"):
        checked(table, tmp_path)
