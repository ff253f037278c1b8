"""``seatrial init``: what it writes is imported, played and recorded at once, and nothing is written over."""

from __future__ import annotations

import os
import pty
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from seatrial.acquisition.config.trial_file import load_config
from seatrial.acquisition.core.quantities import integrate
from seatrial.acquisition.core.ship import control_names, trial_channel_names
from seatrial.acquisition.recording.reader import read_recording
from seatrial.analysis.manoeuvres.find import find_manoeuvres
from seatrial.analysis.tables.table import read_table
from seatrial.hybrid.vessel.files import load_vessel
from seatrial.hybrid.vessel.plant import bare_plant
from seatrial.hybrid.workflows import start_folder
from tests.acquisition.conftest import free_port
from tests.conftest import Command

ROOT = Path(__file__).parents[2]
COASTER = [
    "--length", "82", "--beam", "12.5", "--draught", "5.2", "--block", "0.74", "--service-speed", "6.2",
    "--propeller", "propeller, diameter=3.1", "--rudder", "rudder, area=9.5",
]  # fmt: skip
TWIN = [
    "--length", "60", "--beam", "11", "--draught", "3.5", "--block", "0.6", "--service-speed", "7",
    "--propeller", "port_propeller,diameter=2.2,y=-2.5", "--propeller", "starboard_propeller,diameter=2.2,y=2.5",
    "--rudder", "port_rudder,area=4,behind=port_propeller",
    "--rudder", "starboard_rudder,area=4,behind=starboard_propeller", "--tunnel", "bow,diameter=1.2,power=200",
]  # fmt: skip
PODS = [
    "--length", "32", "--beam", "8", "--draught", "2.7", "--block", "0.56", "--service-speed", "5.5",
    "--azimuth", "port,diameter=1.9,y=-2.7", "--azimuth", "starboard,diameter=1.9,y=2.7",
]  # fmt: skip
TANKER = [
    "--length", "320", "--beam", "58", "--draught", "20.8", "--block", "0.81", "--service-speed", "8",
    "--propeller", "propeller,diameter=9.86", "--rudder", "rudder,area=112",
]  # fmt: skip


def test_the_example_is_imported_and_is_one_ships_motion(tmp_path: Path, command: Command) -> None:
    folder = tmp_path / "mv test"
    written = command("init", folder, *COASTER)
    assert sorted(map(Path, written.out.splitlines())) == sorted(folder.iterdir())
    done = command(
        "import", folder / "example.csv", "-o", folder / "first.mcap", "--columns", folder / "columns.toml"
    )
    assert done.code == 0, done.err
    table = read_table(folder / "first.mcap")
    ship = bare_plant(load_vessel(folder / "vessel.toml")).layout
    assert set(trial_channel_names(ship)) <= set(table.columns)
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
    start_folder(tmp_path, "kvlcc2_7m", "trial")
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
    played = command("emulate", tmp_path / "first.mcap", trial, "--speed", "600")
    assert played.code == 0, played.err
    recorder.send_signal(signal.SIGINT)
    recorder.communicate(timeout=60)
    series = read_recording(next((tmp_path / "recordings").glob("*.mcap"))).series
    assert set(load_config(trial).sources[0].channels) <= set(series)


def test_nothing_is_written_over_unless_told(tmp_path: Path, command: Command) -> None:
    (tmp_path / "columns.toml").write_text("mine")
    refused = command("init", tmp_path, *COASTER)
    assert (refused.code, "already exists" in refused.err) == (1, True)
    assert [path.name for path in tmp_path.iterdir()] == ["columns.toml"]
    assert command("init", tmp_path, *COASTER, "--force").code == 0
    assert (tmp_path / "columns.toml").read_text() != "mine"
    ours = command("init", tmp_path / "new", *COASTER, "--name", "gunnerus_long")
    assert (ours.code, "another one with --name" in ours.err) == (1, True)
    assert not (tmp_path / "new").exists()


def imported(folder: Path, command: Command) -> set[str]:
    """The channels of a folder's example, by its map."""
    out = folder / "first.mcap"
    done = command("import", folder / "example.csv", "-o", out, "--columns", folder / "columns.toml")
    assert done.code == 0, done.err
    assert "missing" not in done.err
    return set(read_recording(out).series)


@pytest.mark.parametrize("options", [TWIN, PODS, TANKER], ids=["twin", "pods", "tanker"])
def test_the_folder_is_of_the_users_own_ship(tmp_path: Path, command: Command, options: list[str]) -> None:
    folder = tmp_path / "own"
    assert command("init", folder, *options, "--name", "my_ship").code == 0
    ship = load_vessel(folder / "vessel.toml")
    numbers = dict(zip(options[::2], options[1::2], strict=True))
    assert ship.name == load_config(folder / "trial.toml").trial.vessel == "my_ship"
    assert ship.dimensions.length_between_perpendiculars_m == float(numbers["--length"])
    assert (ship.dimensions.beam_m, ship.dimensions.draught_m) == (
        float(numbers["--beam"]), float(numbers["--draught"]),
    )  # fmt: skip
    controls = set(control_names(ship.actuators))
    assert controls <= imported(folder, command)
    assert set(load_config(folder / "trial.toml").sources[0].channels) >= controls


@pytest.mark.parametrize("vessel", ["gunnerus_long", "kvlcc2_7m", "otter_2m", "esso_osaka_3m"])
def test_a_ship_of_seatrial_needs_no_vessel_file(tmp_path: Path, command: Command, vessel: str) -> None:
    assert command("init", tmp_path / "trials", "--vessel", vessel).code == 0
    assert sorted(path.name for path in (tmp_path / "trials").iterdir()) == [
        "columns.toml", "example.csv", "trial.toml",
    ]  # fmt: skip
    assert set(control_names(load_vessel(vessel).actuators)) <= imported(tmp_path / "trials", command)


FERRY = """name = "ferry"
base = "otter_2m"
[[actuator]]
name = "port"
kind = "propeller"
"""


def test_a_vessel_file_of_ones_own_is_taken(tmp_path: Path, command: Command) -> None:
    (tmp_path / "ferry.toml").write_text(FERRY)
    assert command("init", tmp_path / "trials", "--vessel", tmp_path / "ferry.toml", "--name", "spring").code == 0
    copied, given = load_vessel(tmp_path / "trials" / "vessel.toml"), load_vessel(tmp_path / "ferry.toml")
    assert (copied.name, copied.actuators, copied.dimensions) == ("ferry", given.actuators, given.dimensions)
    trial = load_config(tmp_path / "trials" / "trial.toml").trial
    assert (trial.name, trial.vessel) == ("spring", "ferry")


def test_a_vessel_file_that_is_in_the_folder_stays_as_it_is(
    tmp_path: Path, command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "vessel.toml").write_text(FERRY)
    monkeypatch.chdir(tmp_path)
    assert command("init", ".", "--vessel", "vessel.toml").code == 0
    assert (tmp_path / "vessel.toml").read_text() == FERRY
    assert load_config(tmp_path / "trial.toml").trial.vessel == "ferry"
    (tmp_path / "renamed.toml").write_text(FERRY.replace("ferry", "gunnerus_long"))
    taken = command("init", "other", "--vessel", "renamed.toml")
    assert (taken.code, "gunnerus_long is the name of a ship in Seatrial" in taken.err) == (1, True)


@pytest.mark.parametrize(
    ("options", "code", "why"),
    [
        ([], 2, "missing: --length, --beam, --draught, --block"),
        (["--length", "82"], 2, "missing: --beam"),
        (COASTER[:10], 2, "--propeller or --azimuth"),
        (["--name", "x", *COASTER[2:]], 2, "missing: --length"),
        ([*COASTER, "--vessel", "kvlcc2_7m"], 2, "is given with --vessel"),
        (["--vessel", "nosuch"], 1, "no vessel 'nosuch'"),
        (["--vessel", ""], 1, "no vessel ''"),
        (["--length", "-82", *COASTER[2:]], 1, "a displacement ship has"),
        ([*COASTER[:10], "--propeller", "propeller"], 1, "diameter"),
    ],
)
def test_without_dimensions_no_ship_is_made_up(
    tmp_path: Path, command: Command, monkeypatch: pytest.MonkeyPatch, options: list[str], code: int, why: str
) -> None:
    monkeypatch.setattr("seatrial.hybrid.commands.is_at_terminal", lambda: False)
    monkeypatch.chdir(tmp_path)
    done = command("init", "out", *options)
    assert (done.code, done.out) == (code, "")
    assert why in " ".join(done.err.replace("│", "").split())
    assert not list(tmp_path.rglob("*.toml"))


def test_at_a_terminal_the_dimensions_are_asked_for(tmp_path: Path) -> None:
    """In a process with a pseudo-terminal, as a user sits at one; what is given is not asked."""
    master, terminal = pty.openpty()
    program = [sys.executable, str(ROOT / "seatrial.py"), "init", str(tmp_path / "asked"), "--beam", "12.5"]
    asked = subprocess.Popen(program, stdin=terminal, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    os.close(terminal)
    os.write(master, b"82\n5.2\n0.74\n6.2\npropeller, diameter=3.1\n\n\nrudder, area=9.5\n\n\n")
    out, err = asked.communicate(timeout=300)
    os.close(master)
    assert asked.returncode == 0, err
    assert "Length between perpendiculars [m]" in err
    assert "Beam" not in err
    assert len(out.splitlines()) == 4
    ship = load_vessel(tmp_path / "asked" / "vessel.toml")
    assert ship.name == "asked"
    assert (ship.dimensions.length_between_perpendiculars_m, ship.dimensions.beam_m) == (82.0, 12.5)
    assert control_names(ship.actuators) == ("propeller_rpm", "rudder_angle_deg")
