"""FMUs of other exporters: starts in other units, no reset, tunable controls, a fixed step; all the same ship."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import seatrial as st
from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.acquisition.core.quantities import Floats
from seatrial.hybrid.calibrators.adaptive import adapt_simulator, run_observer
from seatrial.hybrid.diagnosis.linearise import Linearisation, linearise, model_of
from seatrial.hybrid.diagnosis.log import log_of
from seatrial.hybrid.effects import catalogue_of
from seatrial.hybrid.prediction.kalman_filter import Observations
from seatrial.hybrid.vessel.black_box import BlackBox
from seatrial.hybrid.vessel.dynamics import simulate_batch
from tests.conftest import nightly
from tests.hybrid.own_simulator import fmus
from tests.hybrid.own_simulator.conftest import Sailed
from tests.hybrid.own_simulator.test_adapted_simulators import vector_of

SOLVER = '[solver]\nstart = "set"\n\n[control]'
FORMS = [
    (2, ""),
    (3, ""),
    (2, "no reset"),
    (3, "no reset"),
    (3, "start in SI"),
    (2, "settable"),
    (3, "tunable controls"),
]


@pytest.fixture(scope="module")
def sailer(shipyard: Path) -> BlackBox:
    return st.load_simulator(f"{shipyard}/sailer.py:Sailer")


def fmu_of(folder: Path, version: int, form: str) -> Path:
    """The FMU with its map: what it starts with in its own units, or settable."""
    file = fmus.build_fmu(folder, version, name=f"{form.replace(' ', '_')}_{version}", form=form)
    text = fmus.SHIP + fmus.MAP
    if form == "settable":
        text = text.replace("[control]", SOLVER)
    if form == "start in SI":
        for name, unit in fmus.IN_SI.items():
            text = text.replace(f'start = "{name}"', f'start = "{name}", start_unit = "{unit}"')
    file.with_suffix(".toml").write_text(text)
    return file


@pytest.fixture(scope="module")
def observed() -> Observations:
    """Half a minute of a ship that turns, before some seconds to predict; one begins late."""
    random = np.random.default_rng(5)
    past = np.zeros((4, 31, 10))
    past[..., 0], past[..., 2], past[..., 3] = -5.0 * np.arange(31.0), 3.1, 5.0
    past[..., :6] += 0.01 * random.normal(size=(4, 31, 6))
    past[..., 7:] = [4.0, 3.0, 0.1]
    return Observations(
        past, np.array([30, 30, 12, 3]), np.tile([3.0, 0.1], (4, 8, 1)), np.tile([1.0, 4.0], (4, 8, 1))
    )


@pytest.mark.parametrize(("version", "form"), [*FORMS[-3:], *nightly(*FORMS[:-3])])
def test_adapted_fmu_is_the_adapted_class(
    version: int, form: str, shipyard: Path, sailer: BlackBox, observed: Observations
) -> None:
    """Filtered and predicted with a gain, drag, a push and a current: to a micrometre and below."""
    model = st.load_simulator(fmu_of(shipyard, version, form))
    adapted = {"propeller_rps_scale": -0.4, "surge_drag_pm": 0.7, "constant_N_nm": 0.5, "current_east": 1.0}
    expected = run_observer(vector_of(sailer, **adapted), sailer, observed)
    for ours, theirs in zip(expected, run_observer(vector_of(model, **adapted), model, observed), strict=True):
        np.testing.assert_allclose(theirs, ours, atol=1e-6)


def test_one_instance_serves_all_runs(shipyard: Path, sailer: BlackBox, observed: Observations) -> None:
    """Filtered, predicted, and pushed on its way: runs that share an instance know nothing of each other."""
    file = fmus.build_fmu(shipyard, 2, name="single")
    file.with_suffix(".toml").write_text(fmus.SHIP + fmus.MAP + "\n[solver]\ninstances = 1\n")
    model, adapted = st.load_simulator(file), {"surge_drag_pm": 0.7, "constant_N_nm": 0.5}
    start, control, wind = observed.past[:, 0, :6], observed.control, observed.wind
    for vector in (vector_of(sailer), vector_of(sailer, **adapted)):
        expected = run_observer(vector, sailer, observed)
        for ours, theirs in zip(expected, run_observer(vector, model, observed), strict=True):
            np.testing.assert_allclose(theirs, ours, atol=1e-6)
        pair = (simulate_batch(adapt_simulator(vector, one), start, control, wind, 1.0) for one in (sailer, model))
        ours, theirs = (simulated.states for simulated in pair)
        np.testing.assert_allclose(theirs, ours, atol=1e-9)


def linearised(recording: Path, model: BlackBox) -> Linearisation:
    log = log_of([st.read(recording)], model.length_overall_m, model.fixed_step_s)
    return linearise(log, model_of(model, catalogue_of(model)), 0.03)


def test_fmu_is_diagnosed_as_the_class_is(shipyard: Path, sailer: BlackBox, sailed: Sailed) -> None:
    """The linear model along a log and the signature of every effect that is searched are the same."""
    recording = sailed("Draggy", 0, 120.0)
    model = st.load_simulator(fmu_of(shipyard, 3, ""))
    ours, theirs = (linearised(recording, one) for one in (sailer, model))
    for part in ("A", "B", "H", "defect", "observed"):
        expected = getattr(ours.linear, part)
        scale = np.nanmax(np.abs(expected))
        np.testing.assert_allclose(getattr(theirs.linear, part) / scale, expected / scale, atol=1e-7)
    assert len(ours.effects) == len(theirs.effects) > 20
    for expected, actual in zip(ours.effects, theirs.effects, strict=True):
        assert (actual.effect, actual.coordinate) == (expected.effect, expected.coordinate)
        for matrix, other in ((expected.D, actual.D), (expected.E, actual.E)):
            np.testing.assert_allclose(other, matrix, atol=1e-6 * max(1.0, np.abs(matrix).max()))


@pytest.fixture(scope="module")
def runs() -> tuple[Floats, Floats, Floats]:
    """Starts, controls and wind of a turn at 6 m/s."""
    return np.array([[0, 0, 1, 6, 0, 0]]), np.tile([3.0, 0.3], (1, 6, 1)), np.tile([0.5, 5.0], (1, 6, 1))


@pytest.mark.parametrize("version", [2, *nightly(3)])
def test_fixed_step_is_never_broken(
    version: int, shipyard: Path, runs: tuple[Floats, Floats, Floats], sailed: Sailed
) -> None:
    """An FMU that integrates in steps of 0.1 s would be behind by half of one after 0.25 s: it is stepped by whole
    ones, in a diagnosis too, or refused."""
    file = fmu_of(shipyard, version, "fixed step")
    stated = "\n[solver]\nfixed_step_s = 0.1\n" if version == 2 else ""  # FMI 3.0 has an attribute for it
    file.with_suffix(".toml").write_text(fmus.SHIP + fmus.MAP + stated)
    model = st.load_simulator(file)
    stepped = fmus.build_fmu(shipyard, version, name=f"stepped{version}")
    stepped.with_suffix(".toml").write_text(fmus.SHIP + fmus.MAP + "\n[solver]\nstep_s = 0.1\n")
    expected = simulate_batch(st.load_simulator(stepped), *runs, 1.0).states
    np.testing.assert_allclose(simulate_batch(model, *runs, 1.0).states, expected, atol=1e-9)
    with pytest.raises(ConfigurationError, match=r"cannot step by 0.25 s: it integrates in steps of 0.1 s"):
        simulate_batch(model, *runs, 0.25)
    table = st.read(sailed("Sailer", 0, 120.0))
    assert log_of([table], 30.0, model.fixed_step_s).steps_per_second == 10
    assert log_of([table], 30.0).steps_per_second == 4
    with pytest.raises(ConfigurationError, match=r"integrates in steps of 0.3 s.*such as 0.05 s"):
        log_of([table], 30.0, 0.3)


@pytest.mark.parametrize(
    ("version", "form", "lines"),
    [
        (3, "start in SI", ['surge = { variable = "u", unit = "knots", start = "u0", start_unit = "m/s" }']),
        (2, "fixed step", ["fixed_step_s = 0.1"]),
        (3, "fixed step", ["fixed_step_s = 0.1"]),
    ],
)
def test_proposed_map_has_what_the_fmu_says(version: int, form: str, lines: list[str], shipyard: Path) -> None:
    file = fmus.build_fmu(shipyard, version, name=f"proposed_{form.replace(' ', '_')}_{version}", form=form)
    answers = {
        "axes": "enu",
        "ship.length_m": "30",
        "state.north": "y",
        "state.east": "x",
        "control.rudder_angle_deg.positive": "port",
        "wind.direction.convention": "from",
        "wind.direction.zero": "east",
        "wind.direction.positive": "port",
        "wind.direction.frame": "true",
    }
    text = str(st.vessel_map(file, answer=answers))
    for line in lines:
        assert re.search(re.escape(line), text), text


def test_start_in_a_unit_that_is_not_stated_is_refused(shipyard: Path, runs: tuple[Floats, Floats, Floats]) -> None:
    """With the unit to write; one that measures something else, too."""
    file = fmu_of(shipyard, 3, "start in SI")
    text = file.with_suffix(".toml").read_text()
    for unit, words in (
        ("kn", "start_unit is 'kn': the FMU states m/s for u0; write m/s"),
        ("deg", "start_unit is"),
    ):
        file.with_suffix(".toml").write_text(text.replace('start_unit = "m/s"', f'start_unit = "{unit}"', 1))
        with pytest.raises(ConfigurationError, match=words):
            st.load_simulator(file)
