"""Ships that are nobody's, from their main dimensions to the report: by the command line, as their owner would."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from seatrial.acquisition.core.ship import Actuators, trial_channel_names
from seatrial.acquisition.recording.reader import read_recording
from seatrial.hybrid.vessel.files import load_vessel
from tests.acquisition.conftest import actuator_text, config_text
from tests.conftest import Command, nightly

RATE_HZ = 4
STEP = 0.01
"""The coarsest step of what the sentences carry, in the channels' units."""


@dataclass(frozen=True, slots=True)
class Ship:
    """What an owner says of a ship, what is hidden in her, and words that are none of hers."""

    new: str
    hidden: str
    manoeuvre: str = "voyage"
    strange: str = "nothing of that kind"


SHIPS = {
    "four_azimuths": Ship(
        "--length 78 --beam 18 --draught 5.2 --block 0.68 --service-speed 6.0 " + 4 * "--azimuth diameter=2.4 ",
        "thrust_loss_azimuth_3:fraction=0.25",
        strange="rudder",
    ),
    "twin_screw": Ship(
        "--length 62 --beam 11.5 --draught 3.4 --block 0.58 --service-speed 7.5 "
        + 2 * "--propeller diameter=2.2 --rudder area=3.2 ",
        "rudder_offset_starboard_rudder:angle_deg=6",
        strange="azimuth|thruster",
    ),
    "coaster": Ship(
        "--length 88 --beam 13.5 --draught 5.4 --block 0.72 --service-speed 6.4 --propeller main,diameter=3.2 "
        "--rudder area=10.5,span=4.2 --tunnel bow,diameter=1.3,power=300 "
        "--tunnel stern,diameter=1.1,power=200,x=-36",
        "rudder_loss_rudder:fraction=0.2",
        manoeuvre="programme",
        strange="azimuth",
    ),
}


BY_SHIP = ["coaster", *nightly("four_azimuths", "twin_screw")]
"""What takes long is left to ``make nightly`` for the others."""


@pytest.fixture(params=SHIPS)
def ship(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Ship:
    """A ship, in whose empty folder everything happens."""
    monkeypatch.chdir(tmp_path)
    return SHIPS[request.param]


def done(command: Command, line: str) -> str:
    """What a command that has to succeed says, messages and all."""
    found = command(*line.split())
    assert found.code == 0, f"{line}: {found.err}"
    return found.out + found.err


def told(command: Command, line: str) -> Any:
    """The JSON object of a command."""
    found = command(*line.split(), "--json")
    assert found.code == 0, f"{line}: {found.err}"
    return found.json


def sail(ship: Ship, command: Command, name: str, conditions: str) -> None:
    """A simulated voyage of hers."""
    voyage = f"--vessel ship.toml --manoeuvre {ship.manoeuvre} --rate {RATE_HZ}"
    done(command, f"simulate -o {name} {voyage} {conditions}")


def recorded(ship: Ship, command: Command, conditions: str) -> Path:
    """A voyage that was simulated, put on a bridge's line as sentences, and recorded."""
    done(command, f"vessel new -o ship.toml {ship.new}")
    sail(ship, command, "sailed.mcap", conditions)
    hers = load_vessel("ship.toml").actuators
    section = 'type = "file"\npath = "bridge.log"\n'
    Path("trial.toml").write_text(actuator_text(hers) + config_text(section, trial_channel_names(hers)))
    done(command, "emulate sailed.mcap trial.toml --speed 1e5")
    found = command("record", "trial.toml", "-o", "recordings")
    assert_same(Path("sailed.mcap"), path := Path(found.out.strip()), hers)
    return path


def assert_same(sent: Path, got: Path, hers: Actuators) -> None:
    """Every sample of every channel of the ship went through the sentences and back."""
    one, other = read_recording(sent).series, read_recording(got).series
    for name in trial_channel_names(hers):
        error = other[name].value - one[name].value
        assert np.abs((error + 180.0) % 360.0 - 180.0).max() <= STEP, name


@pytest.mark.parametrize("exact", [True, *nightly(False)])
@pytest.mark.parametrize("ship", BY_SHIP, indirect=True)
def test_she_is_a_ship(ship: Ship, exact: bool, command: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    """By `vessel check` she turns and stops like a ship, at a speed above that of her service, and is drawn.

    What the errors of her coefficients do to her indices, a hundred more checks, is left to the night."""
    if exact:
        monkeypatch.setattr("seatrial.hybrid.identification.fit.coefficients_of", lambda vessel: [])
    service = float(re.findall(r"--service-speed ([\d.]+)", ship.new)[0])
    done(command, f"vessel new -o ship.toml {ship.new}")
    checked = told(command, "vessel check ship.toml -o check.png")
    circle, *_ = (each["indices"] for each in checked["tests"] if each["kind"] == "turning_circle")
    assert Path("check.png").stat().st_size > 10_000
    assert service < checked["speed_mps"] < 1.2 * service
    assert 1.5 < circle["advance_m"]["lengths"] < 4.5
    assert 1.5 < circle["tactical_diameter_m"]["lengths"] < 5.0


@pytest.mark.parametrize("ship", BY_SHIP, indirect=True)
def test_from_main_dimensions_to_a_prediction(ship: Ship, command: Command) -> None:
    """All that was sent is recorded; the check finds nothing; her model predicts."""
    path = recorded(ship, command, "--duration 300 --seed 2")
    assert told(command, f"info {path}")["closed"]
    assert told(command, f"check {path}")["findings"] == []
    assert told(command, f"windows {path} -o windows.parquet")["kept"] > 0
    scored = told(command, f"validate {path} --vessel ship.toml --any")["methods"]
    assert scored["reference"]["mean_distance_m"] < 0.5 * scored["constant_velocity"]["mean_distance_m"]
    predicted = told(command, f"predict {path} --vessel ship.toml --at +150")
    assert predicted["method"] == "reference"
    assert len(predicted["track"]) == 1 + predicted["horizon_s"]


def conditions(ship: Ship, seed: int) -> str:
    """A gentle sea, and something that the model will not know."""
    return f"--duration 1500 --sea-state gentle --hide {ship.hidden} --seed {seed}"


@pytest.mark.slow
def test_from_main_dimensions_to_a_calibrator(ship: Ship, command: Command) -> None:
    """Trained on an earlier voyage it halves the error of her model on the recorded one, and its regions hold."""
    path = recorded(ship, command, conditions(ship, seed=2))
    sail(ship, command, "earlier.mcap", conditions(ship, seed=3))
    done(command, "train earlier.mcap -o calibrator --vessel ship.toml")
    scored = told(command, f"validate {path} --calibrator calibrator")
    assert scored["reduction"] > 0.5
    assert scored["coverage_95"] > 0.9


@pytest.mark.slow
def test_from_main_dimensions_to_the_report(ship: Ship, command: Command) -> None:
    """What was hidden in her is named, beside the sea's own drift and nothing else, and the pages speak of her."""
    path = recorded(ship, command, conditions(ship, seed=2))
    said = done(command, f"diagnose {path} --vessel ship.toml -o diagnosis")
    found = json.loads(Path("diagnosis/diagnosis.json").read_text(encoding="utf-8"))
    hidden = ship.hidden.split(":")[0]
    true = {hidden, "ocean_current", "wave_drift"}
    groups = [
        next((set(group) for group in found["indistinguishable"] if each["name"] in group), {each["name"]})
        for each in found["effects"]
    ]
    assert found["verdict"] in ("named", "indistinguishable")
    assert any(hidden in group for group in groups)
    assert all(group & true for group in groups), "nothing is named that is neither hidden nor of the sea"
    assert found["gap"]["closed"] > 0.9
    done(command, "report diagnosis")
    for text in (said, words_of("diagnosis/report.html")):
        assert re.findall(ship.strange, text.replace("thruster lag", ""), flags=re.IGNORECASE) == []


def words_of(page: str) -> str:
    """What a reader reads on a page."""
    text = re.sub(r"(?s)<(script|style)\b.*?</\1>|<[^>]+>", " ", Path(page).read_text(encoding="utf-8"))
    return " ".join(text.split())
