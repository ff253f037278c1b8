"""``seatrial init``: what it writes is imported, played and recorded at once, and nothing is written over."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from acquisition.config.configuration import load_config
from acquisition.core.channels import trial_names
from acquisition.recording.reader import read_recording
from analysis.kinematics import integrate
from analysis.manoeuvres import find_manoeuvres
from analysis.tables.table import read_table
from hybrid.vessel.files import load_vessel
from hybrid.vessel.plant import bare_plant
from hybrid.workflows.start import start_folder
from tests.acquisition.conftest import free_port
from tests.conftest import Command

ROOT = Path(__file__).parents[2]


def test_the_example_is_imported_and_is_one_ships_motion(tmp_path: Path, command: Command) -> None:
    folder = tmp_path / "mv test"
    written = command("init", folder)
    assert sorted(map(Path, written.out.splitlines())) == sorted(folder.iterdir())
    done = command(
        "import", folder / "example.csv", "-o", folder / "first.mcap", "--columns", folder / "columns.toml"
    )
    assert done.code == 0, done.err
    table = read_table(folder / "first.mcap")
    ship = bare_plant(load_vessel(folder / "vessel.toml")).layout
    assert set(trial_names(ship)) <= set(table.columns)
    assert table.attrs["trial"]["vessel"] == load_config(folder / "trial.toml").trial.vessel == "mv_test"
    heading = np.deg2rad(table["heading_deg"].to_numpy())
    surge, sway = table["surge_mps"].to_numpy(), table["sway_mps"].to_numpy()
    north, east = surge * np.cos(heading) - sway * np.sin(heading), surge * np.sin(heading) + sway * np.cos(heading)
    for name, rate in (("north_m", north), ("east_m", east)):
        assert table[name].to_numpy() - table[name].iloc[0] == pytest.approx(integrate(rate, 1.0), abs=3.0)
    turned = np.rad2deg(np.unwrap(heading))
    assert turned - turned[0] == pytest.approx(integrate(table["yaw_rate_dps"].to_numpy(), 1.0), abs=0.5)
    (zigzag,) = find_manoeuvres(table)
    assert zigzag.kind == "zigzag"
    assert 1.0 < zigzag.indices["overshoot_1_deg"].value < 20.0


def test_it_is_played_and_recorded(tmp_path: Path, command: Command) -> None:
    start_folder(tmp_path, "trial")
    trial = tmp_path / "trial.toml"
    trial.write_text(trial.read_text().replace("port = 10110", f"port = {free_port()}"))
    command(
        "import", tmp_path / "example.csv", "-o", tmp_path / "first.mcap", "--columns", tmp_path / "columns.toml"
    )
    recorder = subprocess.Popen(
        [sys.executable, str(ROOT / "seatrial.py"), "record", str(trial), "-o", str(tmp_path / "recordings")],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert recorder.stderr is not None
    while not recorder.stderr.readline().startswith("recording to"):
        assert recorder.poll() is None
    played = command("emulate", tmp_path / "first.mcap", trial, "--speed", "60")
    assert played.code == 0, played.err
    recorder.send_signal(signal.SIGINT)
    recorder.communicate(timeout=60)
    series = read_recording(next((tmp_path / "recordings").glob("*.mcap"))).series
    assert set(load_config(trial).sources[0].channels) <= set(series)


def test_nothing_is_written_over_unless_told(tmp_path: Path, command: Command) -> None:
    (tmp_path / "columns.toml").write_text("mine")
    refused = command("init", tmp_path)
    assert (refused.code, "already exists" in refused.err) == (1, True)
    assert [path.name for path in tmp_path.iterdir()] == ["columns.toml"]
    assert command("init", tmp_path, "--force").code == 0
    assert (tmp_path / "columns.toml").read_text() != "mine"
    ours = command("init", tmp_path / "new", "--name", "gunnerus_long")
    assert (ours.code, "another --name" in ours.err) == (1, True)
    assert not (tmp_path / "new").exists()
