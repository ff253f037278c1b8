"""Predictions by a simulator of another make: the same numbers as the simulator itself gives."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import seatrial as st
from seatrial.acquisition.core.errors import InputError
from seatrial.acquisition.core.quantities import Floats
from seatrial.hybrid.evaluation.validate import Validation
from seatrial.hybrid.prediction.baselines import distances
from seatrial.hybrid.simulation.trial import simulate_trial
from seatrial.hybrid.vessel import signals
from seatrial.hybrid.vessel.dynamics import simulate_batch
from tests.conftest import Simulated, nightly
from tests.hybrid.own_simulator import fmus
from tests.hybrid.own_simulator.conftest import Sailed

KNOT = 1852.0 / 3600.0
GUNNERUS = """
import numpy as np
from seatrial.hybrid.effects import vessel_plant
from seatrial.hybrid.vessel.dynamics import simulate_batch
from seatrial.hybrid.vessel.files import load_vessel
from seatrial.hybrid.vessel.plant import pack

PLANT = vessel_plant(load_vessel("gunnerus_short"))


class Gunnerus:
    length_m = PLANT.length_between_perpendiculars_m
    length_overall_m = PLANT.length_overall_m
    actuators = {actuator.name: actuator.kind for actuator in PLANT.layout}
    vectorised = True

    def step(self, state, controls, wind, dt_s, acceleration=None):
        plants, substeps = pack(PLANT), None
        if acceleration is not None:  # as the filter of the starts integrates
            p, substeps, (X, Y, N) = PLANT, 1, acceleration.T
            plants = np.repeat(plants, len(state))
            plants["constant_X_n"] += (p.mass_kg - p.Xud) * X
            plants["constant_Y_n"] += (p.mass_kg - p.Yvd) * Y - p.Yrd * N
            plants["constant_N_nm"] += (p.yaw_inertia_kgm2 - p.Nrd) * N - p.Yrd * Y
        return simulate_batch(plants, state, controls[:, None], wind[:, None], dt_s, substeps).states[:, 1]
"""


def class_of(file: Path, name: str) -> Any:
    """A class of a Python file, in this process."""
    spec = importlib.util.spec_from_file_location(file.stem, file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return getattr(module, name)


def called_directly(ship: Any, start: Floats, controls: Floats, wind: Floats) -> Floats:
    """The states [K+1, 6] of one run, units and conventions translated by hand."""
    north, east, heading, surge, sway, yaw_rate = start
    turn = 180.0 / np.pi
    state = [north, east, 90.0 - heading * turn, surge / KNOT, -sway / KNOT, -yaw_rate * turn]
    rows = [start]
    for (rps, rudder), (direction, speed) in zip(controls, wind, strict=True):
        state = ship.step(state, [rps, -rudder * turn], [90.0 - direction * turn, speed / KNOT], 1.0)
        y, x, yaw, u, v, r = state
        rows.append(np.array([y, x, (90.0 - yaw) / turn, u * KNOT, -v * KNOT, -r / turn]))
    return np.array(rows)


@pytest.fixture(scope="session")
def runs() -> tuple[Floats, Floats, Floats]:
    """Starts [N, 6], controls and wind [N, K, 2] of runs that have little in common."""
    random, count, seconds = np.random.default_rng(0), 20, 40
    start = random.uniform([-500, -500, -4, 1, -0.5, -0.05], [500, 500, 4, 8, 0.5, 0.05], (count, 6))
    controls = random.uniform([0.5, -0.6], [4.5, 0.6], (count, seconds, 2))
    return start, controls, random.uniform([-7.0, 0.0], [7.0, 15.0], (count, seconds, 2))


@pytest.mark.parametrize("form", ["class", "FMI 2.0", "FMI 3.0"])
def test_every_form_gives_what_the_model_itself_does(
    form: str, shipyard: Path, runs: tuple[Floats, Floats, Floats]
) -> None:
    """In knots, revolutions, angles from east and to port; on one and on several processes."""
    version = int(form[4]) if form != "class" else 0
    file = fmus.build_fmu(shipyard, version, name=f"form{version}") if version else f"{shipyard}/sailer.py:Sailer"
    simulated = simulate_batch(st.load_simulator(file), *runs, 1.0)
    ship = class_of(shipyard / "sailer.py", "Sailer")()
    expected = np.array([called_directly(ship, *run) for run in zip(*runs, strict=True)])
    np.testing.assert_allclose(simulated.states, expected, atol=1e-9)
    assert simulated.in_range.all()


@pytest.fixture(scope="module")
def by_class(shipyard: Path, sailed: Sailed) -> Validation:
    """The class, which is set at any time, on a voyage of a ship that it is not quite the model of."""
    return st.validate(sailed("Draggy"), vessel=f"{shipyard}/sailer.py:Sailer", stride_s=20)


@pytest.mark.parametrize("version", [2, *nightly(3)])
def test_filter_restarts_an_fmu_as_it_sets_a_class(
    version: int, by_class: Validation, shipyard: Path, sailed: Sailed
) -> None:
    """An FMU that only starts from a state predicts the same windows alike."""
    file = fmus.build_fmu(shipyard, version, name=f"filter{version}")
    by_fmu = st.validate(sailed("Draggy"), vessel=file, stride_s=20)
    np.testing.assert_allclose(by_fmu.tracks["reference"], by_class.tracks["reference"], atol=1e-6)
    assert len(by_fmu.windows) == len(by_class.windows) > 3


def test_validated_figures_are_those_of_the_model_called_directly(shipyard: Path, sailed: Sailed) -> None:
    """From the starts of the windows, under their controls and wind held."""
    validation = st.validate(sailed("Sailer", duration_s=600.0), vessel=f"{shipyard}/sailer.py:Sailer")
    ship, windows = class_of(shipyard / "sailer.py", "Sailer")(), validation.windows
    seconds = windows.horizon_s
    expected = np.array([
        called_directly(ship, start, np.tile(control, (seconds, 1)), np.tile(wind, (seconds, 1)))[:, :3]
        for start, control, wind in zip(windows.start, windows.control, windows.wind, strict=True)
    ])  # fmt: skip
    np.testing.assert_allclose(validation.tracks["reference"], expected, atol=1e-6)
    mean_m = distances(expected, windows.track).mean()
    assert validation.scores["reference"].mean_distance_m == pytest.approx(mean_m, abs=1e-6)
    assert mean_m < 0.2 * validation.scores["constant_velocity"].mean_distance_m


@pytest.mark.slow
def test_own_kernel_as_a_class_gives_the_figures_of_its_vessel_file(simulated: Simulated, tmp_path: Path) -> None:
    """R/V Gunnerus through the door for simulators: every figure within 1e-6."""
    recording = simulated("gentle", 100, 300.0)
    (tmp_path / "mine.py").write_text(GUNNERUS)
    ours = st.validate(recording, vessel="gunnerus_short", stride_s=10)
    as_class = st.validate(recording, vessel=f"{tmp_path}/mine.py:Gunnerus", stride_s=10)
    for scores, class_scores in ((ours.scores, as_class.scores), (ours.two_sided, as_class.two_sided)):
        assert list(scores) == list(class_scores)
        for name, score in scores.items():
            assert class_scores[name].mean_distance_m == pytest.approx(score.mean_distance_m, abs=1e-6)
            assert class_scores[name].by_second == pytest.approx(score.by_second, abs=1e-6)
    assert ours.by_length is not None
    assert as_class.by_length is not None
    errors = (result.by_length.methods["reference"] for result in (ours, as_class) if result.by_length)
    for one, another in zip(*errors, strict=True):
        assert one.distance_m == pytest.approx(another.distance_m, abs=1e-6)


def test_ship_in_a_current_is_carried_along(shipyard: Path, runs: tuple[Floats, Floats, Floats]) -> None:
    """In still air over the water the track is that in still water plus the way of the water."""
    model = st.load_simulator(f"{shipyard}/sailer.py:Sailer")
    north, east = 0.8, -0.5
    start, controls, _ = runs
    start = start.copy()
    calm = np.zeros((*controls.shape[:2], 2))
    blowing = np.broadcast_to([np.arctan2(-east, -north), np.hypot(north, east)], calm.shape)  # goes with the water
    still = simulate_batch(model, start, controls, calm, 1.0).states
    carried = signals.states_over_water(start, (-north, -east), 0.0)
    moved = simulate_batch(
        model.replaced(current_north_mps=north, current_east_mps=east), carried, controls, blowing, 1.0
    ).states
    seconds = np.arange(still.shape[1])
    np.testing.assert_allclose(moved[..., 0], still[..., 0] + north * seconds, atol=1e-9)
    np.testing.assert_allclose(moved[..., 1], still[..., 1] + east * seconds, atol=1e-9)
    np.testing.assert_allclose(moved[..., 2], still[..., 2], atol=1e-9)


def test_simulated_trial_of_a_simulator_follows_its_own_equations(shipyard: Path) -> None:
    """The truth of a trial, replayed by the model under the recorded controls: autopilot, drives and current."""
    name = f"{shipyard}/sailer.py:Sailer"
    current = {"ocean_current": {"speed_mps": 0.5, "direction_deg": 40.0}}
    _, truth = simulate_trial(name, "calm", "zigzag_20_20", 120.0, 10.0, seed=1, hidden=current)
    turn = np.deg2rad(40.0)
    model = st.load_simulator(name).replaced(
        current_north_mps=0.5 * np.cos(turn), current_east_mps=0.5 * np.sin(turn)
    )
    states = truth["states"]
    replayed = simulate_batch(model, states[0], truth["controls"][:-1], truth["wind"][:-1], 0.1).states[0]
    np.testing.assert_allclose(replayed, states, atol=1e-6)
    assert np.ptp(np.rad2deg(states[:, 2])) > 40.0  # it zigzags


def test_run_in_simulator_predicts_from_the_measured_pose(shipyard: Path, sailed: Sailed) -> None:
    """An FMU that starts nowhere else than at rest is run in through what was recorded, and its track then turned
    onto the measured pose. That is known less well without the model, but for hindsight the predictions are as good
    as those of one that is set."""
    file = fmus.build_fmu(shipyard, 2, name="run_in")
    text = fmus.SHIP + fmus.MAP.replace("[control]", '[solver]\nstart = "run_in"\n\n[control]')
    file.with_suffix(".toml").write_text(text)
    recording = sailed("Sailer")
    run_in = st.validate(recording, vessel=file)
    started = st.validate(recording, vessel=f"{shipyard}/sailer.py:Sailer")
    np.testing.assert_allclose(run_in.tracks["reference"][:, 0], run_in.windows.start[:, :3], atol=1e-9)
    causal = run_in.scores["reference"].mean_distance_m
    assert causal < 0.3 * started.scores["constant_velocity"].mean_distance_m
    two_sided = [result.two_sided["reference_two_sided"].mean_distance_m for result in (run_in, started)]
    assert two_sided[0] < 1.2 * two_sided[1]


def test_recording_of_another_ship_is_refused(shipyard: Path, simulated: Simulated) -> None:
    """A simulator with other actuators than the recording is refused."""
    with pytest.raises(InputError, match=r"port \(azimuth\).*the model of one with propeller \(propeller\)"):
        st.validate(simulated("gentle", 100, 1200.0), vessel=f"{shipyard}/sailer.py:Sailer")


@pytest.mark.parametrize("frame", ["true", "relative", "apparent"])
@pytest.mark.parametrize("convention", ["from", "to"])
def test_wind_in_every_convention_is_the_same_wind(frame: Any, convention: str) -> None:
    """Back by hand: degrees from the bow or from north, of the wind over ground or the one that is felt."""
    random = np.random.default_rng(1)
    states = random.uniform([-9, -9, -9, 0, -1, -1], [9, 9, 9, 9, 1, 1], (50, 6))
    wind = random.uniform([-3.0, 0.1], [3.0, 20.0], (50, 2))
    offset = np.pi if convention == "to" else 0.0
    form = signals.WindSignals("direction", frame, signals.AffineSignals((np.pi / 180.0, KNOT), (offset, 0.0)))
    angle_deg, knots = form.to_theirs(wind, states).T
    angle, speed = np.deg2rad(angle_deg) + offset, knots * KNOT
    heading = 0.0 if frame == "true" else states[:, 2]
    north, east = -speed * np.cos(angle + heading), -speed * np.sin(angle + heading)  # of the air
    if frame == "apparent":
        cosine, sine = np.cos(states[:, 2]), np.sin(states[:, 2])
        north += states[:, 3] * cosine - states[:, 4] * sine
        east += states[:, 3] * sine + states[:, 4] * cosine
    np.testing.assert_allclose(north, -wind[:, 1] * np.cos(wind[:, 0]), atol=1e-9)
    np.testing.assert_allclose(east, -wind[:, 1] * np.sin(wind[:, 0]), atol=1e-9)
    assert (np.abs(angle_deg) <= 360.0).all()


def test_latitude_and_longitude_stand_for_north_and_east() -> None:
    """There and back to a millimetre, with headings that go on beyond north."""
    random = np.random.default_rng(2)
    states = random.uniform([-3000, -3000, 5, 0, -1, -1], [3000, 3000, 15, 9, 1, 1], (50, 6))
    form = signals.Signals(signals.identity(6), signals.identity(0), origin_deg=(63.44, 10.4))
    theirs = form.state_to_theirs(states)
    assert np.abs(theirs[:, 0] - 63.44).max() < 0.05
    theirs[:, 2] = np.angle(np.exp(1j * theirs[:, 2]))
    np.testing.assert_allclose(form.state_to_ours(theirs, states), states, atol=1e-3)
