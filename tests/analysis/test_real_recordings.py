"""The two recordings of R/V Gunnerus through their maps: the signs and frames that the maps claim, in figures."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray
from typer.testing import CliRunner

from seatrial import app
from seatrial.acquisition.core.ship import unwrap
from seatrial.acquisition.tables.import_table import import_table
from seatrial.analysis.quality.situations import find_situations
from seatrial.analysis.tables.resample import resample
from seatrial.analysis.tables.table import read_table
from seatrial.analysis.windows.held import held_windows, read_windows

pytestmark = pytest.mark.shared

TRIALS = {
    "gunnerus_2019_docking": "docking_2019-11-09_part1.csv",
    "gunnerus_2022_trials": "trials_2022-10-27_part1.csv",
}
MAPS = Path(__file__).parents[2] / "trials" / "columns"


@dataclass(frozen=True)
class Motion:
    """What is checked against each other: rates from positions and headings, and the measured ones."""

    ahead_mps: NDArray[np.float64]
    starboard_mps: NDArray[np.float64]
    turning_dps: NDArray[np.float64]
    table: pd.DataFrame


@pytest.fixture(scope="module")
def recordings(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("recordings")
    for name, file in TRIALS.items():
        import_table(shared_data / name / file, folder / f"{name}.mcap", MAPS / f"{name}.toml")
    return {name: folder / f"{name}.mcap" for name in TRIALS}


@pytest.fixture(scope="module")
def motions(recordings: dict[str, Path]) -> dict[str, Motion]:
    return {name: motion_of(resample(read_table(path))) for name, path in recordings.items()}


def motion_of(table: pd.DataFrame) -> Motion:
    heading = np.deg2rad(table["heading_deg"].to_numpy())
    north, east = np.gradient(table["north_m"]), np.gradient(table["east_m"])
    return Motion(
        north * np.cos(heading) + east * np.sin(heading),
        -north * np.sin(heading) + east * np.cos(heading),
        np.gradient(unwrap(table["heading_deg"])),
        table,
    )


def slope(measured: NDArray[np.float64], expected: NDArray[np.float64]) -> float:
    return float(np.polyfit(expected, measured, 1)[0])


def test_docking_position_rate_is_speed_over_ground_turned_by_the_heading(motions: dict[str, Motion]) -> None:
    motion = motions["gunnerus_2019_docking"]
    for rate, name in ((motion.ahead_mps, "surge_mps"), (motion.starboard_mps, "sway_mps")):
        measured = motion.table[name].to_numpy()
        assert np.sqrt(np.mean((rate - measured) ** 2)) < 0.03
        assert np.abs(rate - measured).max() < 0.2
        assert slope(measured, rate) == pytest.approx(1.0, abs=0.03)


def test_docking_yaw_rate_is_the_rate_of_the_heading(motions: dict[str, Motion]) -> None:
    motion = motions["gunnerus_2019_docking"]
    assert slope(motion.table["yaw_rate_dps"].to_numpy(), motion.turning_dps) == pytest.approx(1.0, abs=0.01)


def test_trials_speeds_are_two_percent_low_and_heading_turns_with_the_yaw_rate(motions: dict[str, Motion]) -> None:
    """Positions and headings jump where they were damaged: medians and the undamaged seconds pass over that."""
    motion = motions["gunnerus_2022_trials"]
    assert np.median(motion.ahead_mps / motion.table["surge_mps"]) == pytest.approx(1.0203, abs=0.005)
    jumps = pd.Series(np.abs(motion.turning_dps) >= 8)
    sound = (jumps.rolling(7, center=True, min_periods=1).max() == 0).to_numpy()  # resampling reaches 3 s
    yaw_rate = motion.table["yaw_rate_dps"].to_numpy()
    assert np.corrcoef(yaw_rate[sound], motion.turning_dps[sound])[0, 1] > 0.97
    assert slope(motion.turning_dps[sound], yaw_rate[sound]) == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("name", TRIALS)
def test_thrust_to_starboard_at_the_stern_turns_the_ship_to_port(motions: dict[str, Motion], name: str) -> None:
    table = motions[name].table
    side = sum(
        (table[f"{thruster}_rpm"] * table[f"{thruster}_rpm"].abs())
        * np.sin(np.deg2rad(table[f"{thruster}_angle_deg"]))
        for thruster in ("port", "starboard")
    )
    before = pd.Series(side).rolling(10).mean().fillna(0.0)
    assert np.corrcoef(before, table["yaw_rate_dps"])[0, 1] < -0.6


def test_docking_tunnel_thruster_pushes_the_bow_to_starboard(motions: dict[str, Motion]) -> None:
    """08:42:24 to 08:43:00: the tunnel thruster alone runs in reverse, and the ship turns to port ever faster."""
    part = motions["gunnerus_2019_docking"].table.loc["2019-11-09T08:42:24Z":"2019-11-09T08:43:00Z"]
    assert part[["port_rpm", "starboard_rpm"]].abs().max().max() < 15.0
    assert part["tunnel_rpm"].max() < -100.0
    assert part["yaw_rate_dps"].iloc[-1] < part["yaw_rate_dps"].iloc[0] - 0.7


def test_docking_wind_over_ground_does_not_turn_with_the_ship(motions: dict[str, Motion]) -> None:
    """Within 200 s the true wind changes far less than the heading does: the ship turns, the wind stays."""
    table = motions["gunnerus_2019_docking"].table
    wind = table["wind_speed_mps"] * np.exp(1j * np.deg2rad(table["wind_direction_deg"]))
    parts = np.asarray(wind)[: len(wind) // 200 * 200].reshape(-1, 200)
    assert np.mean(np.var(parts, axis=1)) < 0.3
    assert np.abs(np.mean(np.exp(1j * np.deg2rad(table["wind_direction_deg"])))) > 0.9


def test_the_faults_are_left_in(motions: dict[str, Motion]) -> None:
    """Import repairs nothing: headings interpolated through north and jumping positions are still there."""
    motion = motions["gunnerus_2022_trials"]
    assert (np.abs(motion.turning_dps) > 20).sum() > 10
    assert np.abs(motion.ahead_mps - motion.table["surge_mps"]).max() > 2.0


@pytest.mark.parametrize(
    ("name", "horizon_s", "at_least"),
    [("gunnerus_2019_docking", 15, 150), ("gunnerus_2019_docking", 30, 60),
     ("gunnerus_2022_trials", 15, 450), ("gunnerus_2022_trials", 30, 350)],
)  # fmt: skip
def test_real_feedback_has_held_windows(
    motions: dict[str, Motion], name: str, horizon_s: int, at_least: int, capsys: pytest.CaptureFixture[str]
) -> None:
    windows = held_windows(motions[name].table, horizon_s, trial=name)
    with capsys.disabled():
        print(f"\n{name}, {horizon_s} s: {windows.kept} of {windows.candidates}, {windows.leg_count} legs,"  # noqa: T201
              f" dropped {windows.dropped}")  # fmt: skip
    assert windows.kept >= at_least
    assert windows.candidates == windows.kept + sum(windows.dropped.values())


def test_docking_holds_about_as_long_as_was_counted_by_hand(motions: dict[str, Motion]) -> None:
    """The whole recording is said to hold azimuths and rpm for 1,790 s in 55 stretches of 15 s or more; we have
    its first 4,500 s, and tunnel thruster and holes count against a window here."""
    windows = held_windows(motions["gunnerus_2019_docking"].table, 15, 1)
    seconds = windows.rows["start"] + pd.to_timedelta(windows.rows["second"], unit="s")
    assert 1000 < seconds.nunique() < 2500
    assert 40 <= windows.leg_count <= 90


@pytest.mark.parametrize("name", TRIALS)
def test_ship_at_work_is_free_throughout(motions: dict[str, Motion], name: str) -> None:
    """The docking has the ship at the quay for two minutes at most; the trials are all under way."""
    assert find_situations(motions[name].table) == ()


@pytest.mark.slow
def test_export_and_windows_on_the_command_line(recordings: dict[str, Path], tmp_path: Path) -> None:
    files = [str(path) for path in recordings.values()]
    run = CliRunner().invoke(app, ["windows", *files, "-o", str(tmp_path / "w.parquet"), "--json"])
    assert run.exit_code == 0
    counts = json.loads(run.stdout)
    assert set(counts) == {"recordings", "candidates", "kept", "dropped"}
    assert counts["recordings"] == 2
    assert counts["candidates"] == counts["kept"] + sum(counts["dropped"].values())
    assert read_windows(tmp_path / "w.parquet").kept == counts["kept"]
    run = CliRunner().invoke(app, ["export", files[0], "-o", str(tmp_path / "t.csv"), "--rate", "0.5"])
    assert run.exit_code == 0
    assert len(pd.read_csv(tmp_path / "t.csv")) == 2250
