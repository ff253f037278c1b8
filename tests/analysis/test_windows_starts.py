"""Starts of windows from the smoother, written beside them; moving windows kept and marked; the command."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from seatrial import app
from seatrial.acquisition.core.ship import DEFAULT, POSE_AND_VELOCITY
from seatrial.acquisition.core.trial import Trial
from seatrial.acquisition.recording.writer import write_table
from seatrial.analysis.estimation.smoother import COVARIANCE_NAMES, smooth
from seatrial.analysis.tables.resample import resample
from seatrial.analysis.windows.held import (
    REASONS,
    START_COLUMNS,
    WindowOptions,
    add_start_states,
    feedback_of,
    held_windows,
    join_windows,
    read_windows,
    starts_path,
    window_columns,
    windows_of_recordings,
    write_windows,
)
from seatrial.hybrid.simulation.trial import simulate_trial
from tests.analysis.conftest import steady_table
from tests.analysis.test_windows import wandering
from tests.conftest import nightly


@pytest.fixture(scope="module")
def voyage() -> pd.DataFrame:
    return simulate_trial("gunnerus_short", "calm", "programme", 300.0, 2.0, 5)[0]


@pytest.fixture(scope="module")
def recording(voyage: pd.DataFrame, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("starts") / "voyage.mcap"
    write_table(voyage, path, Trial(name="voyage", vessel="gunnerus_short"), source="simulated")
    return path


def test_starts_are_the_smoothed_motion_at_second_0(voyage: pd.DataFrame, tmp_path: Path) -> None:
    motion = smooth(voyage)
    windows = add_start_states(held_windows(resample(voyage), 15, 5, trial="voyage"), {"voyage": motion})
    starts = windows.starts
    assert starts is not None
    assert tuple(starts.columns) == START_COLUMNS
    assert len(COVARIANCE_NAMES) == 21
    assert starts["window"].tolist() == list(range(windows.kept))
    expected = motion.states.loc[pd.DatetimeIndex(starts["start"]), list(POSE_AND_VELOCITY)]
    assert np.array_equal(starts[list(POSE_AND_VELOCITY)].to_numpy(), expected.to_numpy())
    row = motion.states.index.get_loc(starts["start"].iloc[3])
    assert starts["cov_north_m_surge_mps"].iloc[3] == motion.covariance[row, 0, 3]
    assert (starts["cov_heading_deg_heading_deg"] > 0).all()
    first = windows.rows[windows.rows["second"] == 0].reset_index(drop=True)
    assert np.abs(first["north_m"] - starts["north_m"]).max() < 0.5
    write_windows(windows, tmp_path / "a.parquet")
    again = read_windows(tmp_path / "a.parquet")
    pd.testing.assert_frame_equal(again.starts, starts)
    assert tuple(again.rows.columns) == window_columns(DEFAULT)


def test_starts_of_other_windows_are_not_taken_for_ours(voyage: pd.DataFrame, tmp_path: Path) -> None:
    seconds = resample(voyage)
    whole = held_windows(seconds, 15, 5, trial="voyage")
    write_windows(add_start_states(whole, {"voyage": smooth(voyage)}), tmp_path / "a.parquet")
    write_windows(held_windows(seconds, 30, 7, trial="voyage"), tmp_path / "a.parquet")
    assert starts_path(tmp_path / "a.parquet").is_file()
    assert read_windows(tmp_path / "a.parquet").starts is None


@given(seed=st.integers(0, 10**6), stride_s=st.integers(1, 30), horizon_s=st.integers(2, 30))
@settings(max_examples=40, deadline=None)
def test_moving_windows_are_added_to_the_held_ones_and_marked(seed: int, stride_s: int, horizon_s: int) -> None:
    table = wandering(seed).drop(index=wandering(seed).index[200:203])
    held, every = (held_windows(table, horizon_s, stride_s, keep_moving=keep) for keep in (False, True))
    assert every.candidates == held.candidates == every.kept + sum(every.dropped.values())
    assert set(every.dropped) <= {"gap", "missing_data"}
    assert every.moving_count == sum(held.dropped.get(reason, 0) for reason in REASONS[3:])
    assert tuple(every.rows.columns) == (*window_columns(DEFAULT), "held")
    assert every.rows[list(window_columns(DEFAULT))].notna().to_numpy().all()
    first = every.rows[every.rows["second"] == 0]
    assert set(first.loc[first["held"], "start"]) == set(held.rows["start"])
    seconds = every.rows.assign(time=every.rows["start"] + pd.to_timedelta(every.rows["second"], unit="s"))
    legs = seconds.groupby("time")["leg"]
    assert (legs.min() == legs.max()).all()


def test_moving_windows_are_joined_written_and_read(tmp_path: Path) -> None:
    parts = [held_windows(wandering(seed), trial=name, keep_moving=True) for seed, name in ((1, "a"), (2, "b"))]
    both = join_windows([*parts, held_windows(steady_table(5), trial="c", keep_moving=True)])
    assert both.moving_count == parts[0].moving_count + parts[1].moving_count > 0
    write_windows(both, tmp_path / "a.parquet")
    pd.testing.assert_frame_equal(read_windows(tmp_path / "a.parquet").rows, both.rows)


def feedback(rate_hz: float, noise_rpm: float, noise_deg: float, seed: int = 7) -> pd.DataFrame:
    """400 s of settings that are left alone, with noise on a shaft's and an azimuth's feedback."""
    random = np.random.default_rng(seed)
    count = int(400 * rate_hz) + 1
    table = steady_table(count)
    table.index = table.index[0] + pd.to_timedelta(np.arange(count) / rate_hz, unit="s")
    table["port_rpm"] = 120.0 + noise_rpm * random.standard_normal(count)
    table["port_angle_deg"] = noise_deg * random.standard_normal(count)
    return table


@pytest.mark.parametrize("rate_hz", [1.0, 1.5, 5.0, *nightly(2.0, 20.0)])
def test_noise_of_feedback_at_any_rate_drops_no_held_window(rate_hz: float) -> None:
    """Of many recordings together: in a single short one the noise itself is known to some 10 % only."""
    random = np.random.default_rng(round(10 * rate_hz))
    kept = candidates = 0
    for seed, horizon_s in enumerate([15, 30, 60] * 4):
        table = feedback(rate_hz, random.uniform(0.1, 5.0), random.uniform(0.05, 1.0), seed)
        windows = held_windows(resample(table), horizon_s)
        kept, candidates = kept + windows.kept, candidates + windows.candidates
    assert kept >= 0.99 * candidates


@pytest.mark.parametrize("rate_hz", [2.0, 10.0])
@pytest.mark.parametrize(("noise_rpm", "noise_deg"), [(0.1, 0.05), (2.0, 1.0)])
def test_a_thruster_that_moves_is_seen_under_noise_at_any_rate(
    rate_hz: float, noise_rpm: float, noise_deg: float
) -> None:
    """0.5 deg/s, or a step of 30 rpm every 40 s: no window that holds a move is kept."""
    table = feedback(rate_hz, noise_rpm, noise_deg)
    seconds = np.arange(len(table)) / rate_hz
    ramped, stepped = table.copy(), table.copy()
    ramped["port_angle_deg"] = (ramped["port_angle_deg"] + 0.5 * seconds + 180.0) % 360.0 - 180.0
    stepped["port_rpm"] += 30.0 * (seconds // 40 % 2)
    assert held_windows(resample(ramped)).kept == 0
    windows = held_windows(resample(stepped))
    starts = (windows.rows.loc[windows.rows["second"] == 0, "start"] - table.index[0]).dt.total_seconds()
    assert (starts % 40 <= 40 - 15 + 1).all()
    assert windows.kept > 0.5 * windows.candidates


@pytest.mark.parametrize("rate_hz", [1.0, 2.0, 5.0, 20.0])
def test_the_noise_of_filtered_feedback_is_what_is_left_of_it(rate_hz: float) -> None:
    seconds = pd.concat([resample(feedback(rate_hz, 2.0, 0.3, seed)) for seed in range(5)])
    found = feedback_of(seconds["port_rpm"].to_numpy())
    assert found.filtered == (rate_hz > 1.0)
    assert found.noise == pytest.approx(seconds["port_rpm"].std(), rel=0.15)


def test_the_command_writes_windows_and_starts(recording: Path, tmp_path: Path) -> None:
    output = tmp_path / "w.parquet"
    run = CliRunner().invoke(app, ["windows", str(recording), "-o", str(output), "--keep-moving", "--json"])
    assert run.exit_code == 0, run.output
    summary = json.loads(run.stdout)
    windows = read_windows(output)
    assert summary["kept"] == windows.kept == summary["candidates"] - sum(summary["dropped"].values())
    assert summary["moving"] == windows.moving_count > 0
    assert windows.starts is not None
    assert windows.starts[list(START_COLUMNS)].notna().to_numpy().all()
    plain = windows_of_recordings([recording], WindowOptions(starts=False))
    assert plain.starts is None
    assert plain.kept == windows.kept - windows.moving_count


def test_the_command_smooths(recording: Path, tmp_path: Path) -> None:
    output = tmp_path / "s.parquet"
    run = CliRunner().invoke(app, ["smooth", str(recording), "-o", str(output), "--rate", "2", "--json"])
    assert run.exit_code == 0, run.output
    summary, rows = json.loads(run.stdout), pd.read_parquet(output)
    assert summary["rows"] == len(rows) > 590
    assert set(summary["noise"]) >= {"position_m", "heading_rad", "speed_mps", "yaw_rate_radps"}
    assert {"surge_mps2", "cov_north_m_north_m", "slow_surge_mps"} <= set(rows.columns)
    assert str(rows.index.tz) == "UTC"
