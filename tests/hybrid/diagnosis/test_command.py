"""``seatrial diagnose`` as a user calls it: the contract's JSON, the repaired model, the page, plain errors."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

import seatrial
from seatrial.acquisition.core.trial import Trial
from seatrial.acquisition.recording.writer import write_table
from seatrial.analysis.tables.table import select
from seatrial.hybrid.effects import vessel_plant
from seatrial.hybrid.simulation.trial import simulate_trial
from seatrial.hybrid.vessel.files import load_vessel
from seatrial.hybrid.workflows import DiagnosisRun, diagnose_files
from tests.hybrid.evaluation.windows_in_legs import Oracle

HIDDEN = {"ocean_current": {"speed_mps": 0.3, "direction_deg": 205.0}}
KEYS = {
    "verdict", "tolerance", "effects", "rivals", "indistinguishable", "unknown", "where", "gap", "next_manoeuvre",
}  # fmt: skip


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Ten minutes of turns with a current that nobody told the model of."""
    path = tmp_path_factory.mktemp("hidden") / "trial.mcap"
    table, _ = simulate_trial("gunnerus_short", "calm", "turning_circle_20", 600.0, 4.0, 3, HIDDEN)
    write_table(table, path, Trial("trial", "gunnerus_short"), source="simulated")
    return path


@pytest.fixture(scope="module")
def found() -> list[DiagnosisRun]:
    """What the diagnosis below came to."""
    return []


@pytest.fixture(scope="module")
def done(recording: Path, found: list[DiagnosisRun]) -> tuple[dict[str, Any], Path]:
    """What the command printed, and its folder; the calibrator is one that knows the measured tracks."""
    folder = recording.parent / "diagnosis"
    command = ["diagnose", str(recording), "-o", str(folder), "--calibrate", "--json"]

    def diagnosed(*given: Any, **options: Any) -> DiagnosisRun:
        found.append(diagnose_files(*given, **options))
        return found[0]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("seatrial.hybrid.workflows.diagnose_files", diagnosed)
        patch.setattr(
            "seatrial.hybrid.evaluation.study.make_calibrator", lambda method, seed, plant: Oracle(seed, plant)
        )
        result = CliRunner().invoke(seatrial.app, command)
    assert result.exit_code == 0, result.output

    def refuse(constant: str) -> None:
        raise ValueError(f"{constant} is no JSON")

    return json.loads(result.stdout, parse_constant=refuse), folder


def test_what_was_hidden_is_named(done: tuple[dict[str, Any], Path]) -> None:
    """Its size and direction are inside their intervals, and the gap closes on legs that took no part."""
    said, _ = done
    assert said["verdict"] == "named"
    (effect,) = said["effects"]
    assert effect["name"] == "ocean_current"
    for name, true in HIDDEN["ocean_current"].items():
        stated = effect["parameters"][name]
        assert stated["low"] <= stated["value"] <= stated["high"]
        assert stated["value"] == pytest.approx(true, rel=0.03)
    assert said["gap"]["closed"] > 0.9
    assert said["gap"]["after_m"] < 0.5 * said["gap"]["before_m"]
    assert said["gap"]["held_out_windows"] > 20


def test_the_json_has_the_keys_of_the_contract(done: tuple[dict[str, Any], Path]) -> None:
    """Printed and written alike."""
    said, folder = done
    assert set(said) >= KEYS
    assert json.loads((folder / "diagnosis.json").read_text()) == said
    effect = said["effects"][0]
    assert set(effect) == {
        "name",
        "family",
        "kind",
        "parameters",
        "share_of_gap",
        "p_value",
        "sentence",
        "replicated",
        "scope",
        "when",
        "drift",
        "in_vessel",
    }
    assert all(set(each) == {"value", "low", "high", "unit"} for each in effect["parameters"].values())
    assert all(set(each) == {"channel", "cell", "windows", "error", "z"} for each in said["where"])
    assert set(said["gap"]) == {
        "before_m", "after_m", "floor_m", "constant_velocity_m", "closed", "held_out_windows",
    }  # fmt: skip


def test_the_ladder_has_a_file_of_its_own(done: tuple[dict[str, Any], Path]) -> None:
    """Five rungs; the named model errs less than the reference, and the calibrator as what it is."""
    said, folder = done
    found = json.loads((folder / "ladder.json").read_text())
    rungs = {name: each["value"] for name, each in found["mean_distance_m"].items()}
    assert list(rungs) == ["constant_velocity", "reference", "named", "reference_calibrated", "named_calibrated"]
    assert rungs["named"] < 0.5 * rungs["reference"]
    assert rungs["reference_calibrated"] == rungs["named_calibrated"] == 0.0
    assert found["horizon_s"] == 15
    assert found["windows"] > 20
    assert not set(found) & set(said)


@pytest.mark.usefixtures("done")
def test_too_few_held_legs_for_a_calibrator_are_one_line(
    recording: Path, found: list[DiagnosisRun], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The diagnosis stands, and the page and the terminal say why there is no ladder."""
    short = replace(found[0], tables=[select(each, (0.0, 30.0)) for each in found[0].tables])
    monkeypatch.setattr("seatrial.hybrid.workflows.diagnose_files", lambda *given, **options: short)
    command = ["diagnose", str(recording), "-o", str(tmp_path), "--calibrate"]
    result = CliRunner().invoke(seatrial.app, command)
    assert result.exit_code == 0, result.output
    assert "No calibrator was trained" in result.stdout
    assert "No calibrator was trained" in (tmp_path / "report.html").read_text()
    assert json.loads((tmp_path / "ladder.json").read_text())["why_not"]


def test_the_model_with_the_effect_runs(done: tuple[dict[str, Any], Path]) -> None:
    """The vessel file has the effect at the value that was stated, and any command takes it."""
    said, folder = done
    vessel = load_vessel(folder / "vessel.toml")
    stated = {name: each["value"] for name, each in said["effects"][0]["parameters"].items()}
    assert vessel.effects["ocean_current"] == pytest.approx(stated)
    plant = vessel_plant(vessel)
    assert (plant.current_north_mps**2 + plant.current_east_mps**2) ** 0.5 == pytest.approx(stated["speed_mps"])
    assert "diagnosis_recordings_sha256" in vessel.provenance
    assert vessel.provenance["diagnosis_part_percent"] == "0..100"


def test_the_page_says_it_in_words(done: tuple[dict[str, Any], Path]) -> None:
    """One file, with the sentence and without anything from elsewhere."""
    said, folder = done
    page = (folder / "report.html").read_text()
    assert said["effects"][0]["sentence"].split("(")[0].strip() in page
    assert "http://" not in page.replace("http://www.w3.org", "")


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--tolerance", "0"], "tolerance"),
        (["--without", "ocean_curent"], "did you mean ocean_current"),
        (["--vessel", "nobody"], "no vessel"),
        (["--effects", "nowhere.py"], "nowhere.py"),
    ],
)
def test_what_cannot_be_done_is_said_in_one_line(
    recording: Path,
    tmp_path: Path,
    options: list[str],
    says: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Exit code 1, no traceback."""
    monkeypatch.setattr(sys, "argv", ["seatrial", "diagnose", str(recording), "-o", str(tmp_path), *options])
    with pytest.raises(SystemExit) as left:
        seatrial.main()
    assert left.value.code == 1
    error = capsys.readouterr().err.strip()
    assert says in error
    assert len(error.splitlines()) == 1
