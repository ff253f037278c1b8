"""Effects of one's own, from a Python file: the worked example of the documentation, and files that are none."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import seatrial
from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.analysis.tables.table import read_table
from seatrial.hybrid.effects import CATALOGUE, apply_effects, catalogue_with
from seatrial.hybrid.simulation.trial import simulate_trial
from seatrial.hybrid.vessel.dynamics import Environment
from seatrial.hybrid.vessel.plant import Plant

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "trials" / "effects" / "drogue.py"
DRAG_NPS2 = 400.0


@pytest.fixture(scope="module")
def with_drogue(plant: Plant) -> Plant:
    """The ship with the documented example's effect."""
    return apply_effects(plant, {"drogue": {"drag_nps2": DRAG_NPS2}}, catalogue_with([EXAMPLE]))


def test_the_documentation_shows_the_very_file() -> None:
    """What the page prints is what these tests run."""
    assert EXAMPLE.read_text() in (ROOT / "docs" / "effects.md").read_text()


def pull(
    plant: Plant, u: float, v: float, r: float, heading: float = 0.0, current: tuple[float, float] = (0, 0)
) -> Any:
    """Force and moment of the plant's drogue, in plain Python."""
    (force,) = plant.forces
    water = Environment(0.0, 0.0, *current, plant)
    return force.function(0.0, (0.0, 0.0, heading, u, v, r), (0.0,) * 5, water, force.parameters)


def test_the_drogue_pulls_against_the_sterns_motion(plant: Plant, with_drogue: Plant) -> None:
    """Ahead, drag u^2 aft; turning on the spot, across the stern with its lever arm; and power is always lost."""
    assert pull(with_drogue, 4.0, 0.0, 0.0) == pytest.approx((-16.0 * DRAG_NPS2, 0.0, 0.0))
    stern_m = plant.number("port_x_m")
    across = DRAG_NPS2 * (0.05 * stern_m) ** 2
    assert pull(with_drogue, 0.0, 0.0, 0.05) == pytest.approx((0.0, across, across * stern_m))
    for u, v, r in ((3.0, 1.0, -0.05), (-1.0, -2.0, 0.1), (0.5, -0.1, 0.02)):
        assert np.dot(pull(with_drogue, u, v, r), (u, v, r)) < 0.0


def test_the_drogue_feels_the_water_and_not_the_ground(with_drogue: Plant) -> None:
    """A ship that a current carries along has no pull on her line, on any heading."""
    north, east = 0.4, -0.3
    for heading in (0.0, 0.7, 3.0):
        u = north * np.cos(heading) + east * np.sin(heading)
        v = east * np.cos(heading) - north * np.sin(heading)
        assert pull(with_drogue, u, v, 0.0, heading, (north, east)) == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)


def test_neutral_it_is_not_there(plant: Plant) -> None:
    """At its neutral value the plant is the same, without the force."""
    assert apply_effects(plant, {"drogue": {"drag_nps2": 0.0}}, catalogue_with([EXAMPLE])) is plant


def test_the_file_is_listed_with_confusion_on_both_sides() -> None:
    listed = CliRunner().invoke(seatrial.app, ["effects", "--effects", str(EXAMPLE), "--json"])
    effects = {effect["name"]: effect for effect in json.loads(listed.stdout)["effects"]}
    assert set(effects) == {*CATALOGUE, "drogue"}
    assert "drogue" in effects["towed_load"]["confused_with"]


def test_simulate_reads_the_file_and_knows_its_parameters(tmp_path: Path) -> None:
    options = ["-o", str(tmp_path / "trial.mcap"), "--effects", str(EXAMPLE), "--hide", "drogue:drag=1"]
    result = CliRunner().invoke(seatrial.app, ["simulate", *options])
    assert isinstance(result.exception, ConfigurationError)
    assert "drogue has no parameter drag" in str(result.exception)


@pytest.mark.slow  # which compiles a simulator for this test alone
def test_a_simulated_trial_with_it_hidden_is_slowed_and_keeps_quiet(tmp_path: Path, plant: Plant) -> None:
    out, seconds = tmp_path / "trial.mcap", 2.0
    options = ["-o", str(out), "--duration", str(seconds), "--hide", f"drogue:drag_nps2={DRAG_NPS2}"]
    assert CliRunner().invoke(seatrial.app, ["simulate", *options, "--effects", str(EXAMPLE)]).exit_code == 0
    assert json.loads((tmp_path / "trial.truth.json").read_text())["hidden"] == {"drogue": {"drag_nps2": DRAG_NPS2}}
    assert b"drogue" not in out.read_bytes()
    plain, truth = simulate_trial(duration_s=seconds)
    mean_s = seconds - 0.55
    slower = float((read_table(out)["surge_mps"] - plain["surge_mps"].to_numpy()).tail(10).mean())
    brake = DRAG_NPS2 * truth["states"][0, 3] ** 2 / (plant.mass_kg - plant.Xud)
    assert slower == pytest.approx(-brake * mean_s, rel=0.1)  # less as she slows down


def test_the_list_in_the_terminal_is_whole() -> None:
    """Every effect with its kind, parameters and rivals stands under its family."""
    app = seatrial.app
    result = CliRunner().invoke(app, ["effects"], env={"COLUMNS": "112"})
    assert result.exit_code == 0
    words = set(result.stdout.replace(",", " ").split())
    assert {effect.name for effect in CATALOGUE.values()} <= words
    assert {each.name for effect in CATALOGUE.values() for each in effect.parameters} <= words
    assert max(map(len, result.stdout.splitlines())) <= 112


def test_effects_may_be_left_out() -> None:
    """A catalogue without some effects is the rest, and a name that is none is said."""
    assert set(CATALOGUE) - set(catalogue_with(without=["towed_load"])) == {"towed_load"}
    with pytest.raises(ConfigurationError, match="towed_load"):
        catalogue_with(without=["towed_loat"])


@pytest.mark.parametrize("text", ["EFFECTS = 3", "x = 1", "raise OSError('no')", "def"])
def test_a_user_file_that_is_none_is_refused(text: str, tmp_path: Path) -> None:
    """What is wrong with the file is said, with its name."""
    file = tmp_path / "broken.py"
    file.write_text(text)
    with pytest.raises(ConfigurationError, match=r"broken\.py"):
        catalogue_with([file])


def test_an_unknown_rival_is_told_with_the_effect_that_names_it(tmp_path: Path) -> None:
    text = EXAMPLE.read_text(encoding="utf-8").replace('"towed_load"', '"towed_lode"')
    file = tmp_path / "mine.py"
    file.write_text(text)
    with pytest.raises(
        ConfigurationError, match=r"effect drogue, confused_with: .*towed_lode.*did you mean towed_load"
    ):
        catalogue_with([file])
