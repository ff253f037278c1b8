"""What a simulator of another make lacks, asked from outside: trials of our own vessel, with something hidden."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import seatrial as st
from seatrial.acquisition.core import ship
from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.hybrid.effects import apply_effects, catalogue_of, inside_effects
from seatrial.hybrid.effects.simulators import save_simulator
from seatrial.hybrid.simulation.trial import record_trial, simulate_trial
from seatrial.hybrid.vessel.black_box import model_digest
from seatrial.hybrid.vessel.dynamics import simulate_batch
from seatrial.hybrid.vessel.outside import controls_inside
from tests.conftest import nightly
from tests.hybrid.own_simulator.test_predictions import GUNNERUS

HIDDEN: dict[str, dict[str, dict[str, float]]] = {
    "nothing": {},
    "current": {"ocean_current": {"speed_mps": 0.3, "direction_deg": 60.0}},
    "compass": {"heading_bias": {"angle_deg": 2.0}},
    "shafts": {},
    "fouling": {"hull_fouling": {"resistance_factor": 1.3}},
    "yaw damping": {"yaw_damping": {"factor": 1.3}},
}
BODY = {"surge_push", "sway_push", "yaw_push", "added_resistance", "added_sway_drag", "added_yaw_drag"}


@pytest.fixture(scope="module")
def gunnerus(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The black box: the class of R/V Gunnerus' own model."""
    folder = tmp_path_factory.mktemp("box")
    patient = "vectorised = True\n    patience_s = 600.0"  # its first step compiles
    (folder / "own.py").write_text(GUNNERUS.replace("vectorised = True", patient))
    return f"{folder}/own.py:Gunnerus"


@pytest.fixture(scope="module")
def sail(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Path]:
    """Recordings in which something is hidden; the shafts turn 5 % faster than recorded."""
    folder = tmp_path_factory.mktemp("trials")

    def recording(case: str, duration_s: float = 600.0) -> Path:
        path = folder / f"{case.replace(' ', '_')}_{duration_s:g}.mcap"
        if not path.exists():
            table, truth = simulate_trial(
                "gunnerus_short", "calm", "voyage", duration_s, 1.0, 3, hidden=HIDDEN[case]
            )
            if case == "shafts":
                shafts = ["port_rpm", "starboard_rpm"]
                table[shafts] = table[shafts] / 1.05
            record_trial(table, truth, path)
        return path

    return recording


def diagnosed(recording: Path, simulator: str, **options: Any) -> st.Diagnosis:
    """The diagnosis, without the time that other refinements take."""
    return st.diagnose(recording, vessel=simulator, **options).diagnosis


@pytest.mark.slow
@pytest.mark.parametrize(("duration_s", "windows"), [(300.0, 10), *nightly((1200.0, 50))])
def test_named_current_is_a_file_that_predicts(
    duration_s: float, windows: int, sail: Callable[..., Path], gunnerus: str, tmp_path: Path
) -> None:
    """It is named with its size, what was not asked is said, and the file written halves the error, and more."""
    recording = sail("current", duration_s)
    diagnosis = diagnosed(recording, gunnerus, output=tmp_path)
    (current,) = diagnosis.effects
    size = current.parameters["speed_mps"]
    assert current.name == "ocean_current"
    assert size.low < 0.3 < size.high
    assert abs(current.parameters["direction_deg"].value - 60.0) < 3.0
    assert diagnosis.gap.closed > 0.95
    assert diagnosis.gap.held_out_windows > windows
    stored = json.loads((tmp_path / "diagnosis.json").read_text())
    assert "yaw damping" in stored["provenance"]["not_asked"]
    assert "a loss of thrust as a shaft gain" in stored["provenance"]["not_asked"]
    assert "Not asked: the model is a simulator" in (tmp_path / "report.html").read_text()

    added = st.load_simulator(tmp_path / "vessel.toml")
    assert added.effects["ocean_current"]["speed_mps"] == pytest.approx(size.value)
    assert model_digest(added) != model_digest(st.load_simulator(gunnerus))
    before, after = (
        st.validate(recording, vessel=vessel, stride_s=20) for vessel in (gunnerus, tmp_path / "vessel.toml")
    )
    errors = [run.scores["reference"].mean_distance_m for run in (before, after)]
    assert errors[1] < 0.4 * errors[0]
    Path(gunnerus.split(":")[0]).with_suffix(".toml").write_text("[solver]\nstep_s = 0.5\n")
    try:
        with pytest.raises(ConfigurationError, match="another version of its simulator"):
            st.load_simulator(tmp_path / "vessel.toml")
    finally:
        Path(gunnerus.split(":")[0]).with_suffix(".toml").unlink()


@pytest.mark.slow
def test_nothing_is_named_of_a_simulator_that_is_the_ship(sail: Callable[..., Path], gunnerus: str) -> None:
    """With nothing hidden."""
    diagnosis = diagnosed(sail("nothing"), gunnerus)
    assert diagnosis.verdict == "nothing_missing"
    assert not diagnosis.effects


@pytest.mark.slow
@pytest.mark.parametrize(
    ("case", "name", "parameter", "size"),
    [
        ("compass", "heading_bias", "angle_deg", 2.0),
        ("shafts", "shaft_gain_both", "factor", 1.05),
        ("fouling", "added_resistance", "drag_pm", 1.25e-3),
    ],
)
def test_what_is_hidden_outside_is_named(
    case: str, name: str, parameter: str, size: float, sail: Callable[..., Path], gunnerus: str
) -> None:
    """By its name, with the truth in its interval; fouling as the resistance that it adds per mass."""
    diagnosis = diagnosed(sail(case, 1200.0), gunnerus)
    assert [effect.name for effect in diagnosis.effects] == [name]
    estimate = diagnosis.effects[0].parameters[parameter]
    assert estimate.low <= size <= estimate.high
    assert diagnosis.gap.closed > 0.9


@pytest.mark.slow
def test_what_is_hidden_inside_is_no_sensor(sail: Callable[..., Path], gunnerus: str) -> None:
    """More damping of the hull in yaw is unknown, or drag; never a fault of a sensor or of the sea."""
    diagnosis = diagnosed(sail("yaw damping", 1200.0), gunnerus)
    assert diagnosis.verdict != "nothing_missing"
    assert {effect.name for effect in diagnosis.effects} <= BODY


def test_saved_simulator_keeps_its_effects(gunnerus: str, tmp_path: Path) -> None:
    model = replace(st.load_simulator(gunnerus), effects=HIDDEN["current"])
    save_simulator(model, tmp_path / "vessel.toml", {})
    assert st.load_simulator(tmp_path / "vessel.toml").effects == HIDDEN["current"]


def test_catalogue_of_a_simulator_changes_nothing_inside(gunnerus: str) -> None:
    """Every effect acts; those of coefficients are left out and named."""
    model = st.load_simulator(gunnerus)
    catalogue, inside = catalogue_of(model), inside_effects(model)
    assert {"ocean_current", "heading_bias", "shaft_gain_both", "azimuth_offset_port"} <= set(catalogue)
    assert {"yaw_damping", "loading", "towed_load", "thrust_loss_both", "wave_drift"} <= set(inside)
    for name, effect in catalogue.items():
        changed = apply_effects(model, {name: effect.typical_values})
        assert changed != model
        assert apply_effects(model, {name: effect.neutral_values}) == model


def test_pushes_are_accelerations_of_the_ship(gunnerus: str) -> None:
    """A steady push and drag change the speeds of a ship at rest and under way as Newton's law has it."""
    model = st.load_simulator(gunnerus)
    start, wind = np.array([[0.0, 0.0, 1.0, 4.0, 0.0, 0.0]]), np.zeros((1, 8, 2))
    controls = np.tile([2.0, 0.0, 2.0, 0.0, 0.0], (1, 8, 1))

    def speeds(effects: dict[str, dict[str, float]], step: int) -> Any:
        return simulate_batch(apply_effects(model, effects), start, controls, wind, 0.25).states[0, step, 3:]

    def gain(effect: str, parameter: str, value: float, axis: int, step: int) -> float:
        return float(speeds({effect: {parameter: value}}, step)[axis] - speeds({}, step)[axis])

    assert gain("surge_push", "acceleration_mps2", 0.05, 0, 8) == pytest.approx(0.1, rel=0.1)
    assert gain("added_resistance", "drag_pm", 0.003, 0, 8) == pytest.approx(-0.096, rel=0.1)
    assert gain("yaw_push", "acceleration_dps2", 0.5, 2, 1) == pytest.approx(np.deg2rad(0.125), rel=0.1)


def test_controls_inside_are_those_that_act() -> None:
    """Gain and offset of an angle go from ahead; a lag gives the mean over each step of what follows."""
    actuators = (ship.Actuator("propeller", "propeller"), ship.Actuator("rudder", "rudder"))
    numbers = {"rudder_angle_scale": 1.1, "rudder_angle_offset_rad": 0.02, "propeller_rps_scale": 1.05,
               "propeller_lag_s": 2.0}  # fmt: skip

    def value(name: str) -> float:
        return numbers.get(name, 1.0 if name.endswith("_scale") else 0.0)

    step = np.where(np.arange(80) < 1, 1.0, 3.0)
    controls = np.stack([step, np.full(80, 2.0 * np.pi + 0.1)], axis=-1)[None]
    acting = controls_inside(controls, value, actuators, 0.25)
    np.testing.assert_allclose(acting[0, :, 1], 1.1 * 0.1 + 0.02)
    times = 0.25 * np.arange(79)
    expected = 3.0 - 2.0 * np.exp(-(times + 0.125) / 2.0)
    np.testing.assert_allclose(acting[0, 1:, 0] / 1.05, expected, atol=2e-3)
    np.testing.assert_array_equal(controls[0, :, 0], step)


def test_ship_that_cannot_be_set_is_refused(gunnerus: str, sail: Callable[..., Path]) -> None:
    """One that is run in, and the identification of what is inside."""
    with pytest.raises(ConfigurationError, match="coefficients cannot be identified"):
        st.diagnose(sail("nothing"), vessel=gunnerus, identify=True)
    run_in = replace(st.load_simulator(gunnerus), run_in_s=60.0)
    with pytest.raises(ConfigurationError, match="sets its state each second"):
        st.diagnose(sail("nothing"), vessel=run_in)
