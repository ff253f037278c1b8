"""``vessel export``: the translated equations are the simulator's, in every form that a model leaves in."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from functools import lru_cache
from itertools import product
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from xml.etree import ElementTree

import casadi
import numpy as np
import pandas as pd
import pytest
from fmpy import read_model_description
from fmpy.validation import validate_fmu
from numba import njit
from scipy.io import loadmat
from typer.testing import CliRunner

import seatrial as st
from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.acquisition.core.ship import POSE_AND_VELOCITY, control_names, order_channel_name, rudder_names
from seatrial.hybrid.effects import apply_effects, vessel_plant
from seatrial.hybrid.export import fmu
from seatrial.hybrid.export.deviations import StandardRun, step_by_step
from seatrial.hybrid.export.equations import Equations, equations_of, flat_parameters, nested_parameters
from seatrial.hybrid.export.matrices import Thruster, matrix_model
from seatrial.hybrid.export.symbolic import SymbolicShip, execute
from seatrial.hybrid.simulation import manoeuvres
from seatrial.hybrid.simulation.trial import sail_through
from seatrial.hybrid.simulation.vessel_check import STILL
from seatrial.hybrid.vessel import dynamics
from seatrial.hybrid.vessel.actuators import WORK_SIZE, control_labels, control_units
from seatrial.hybrid.vessel.files import Vessel, load_vessel
from seatrial.hybrid.vessel.plant import Plant, bare_plant, pack
from tests.conftest import nightly
from tests.force_calls import actuators_force

VESSELS = st.vessels()
KINDS_SHIP = """
name = "every_kind"
base = "kvlcc2_7m"
[validity]
surge_high_mps = 4.0
[effects.ocean_current]
speed_mps = 0.1
direction_deg = 40.0
[effects.low_speed_damping]
surge_ps = 0.01
sway_ps = 0.02
yaw_ps = 0.1
[effects.thruster_lag]
time_constant_s = 0.5
[effects.backlash_flap]
width_deg = 2.0
[[actuator]]
name = "jet"
kind = "waterjet"
x_m = -3.3
thrust_nn = 5.0
thrust_nu = 2.0
limit_rpm = 600.0
limit_deg = 30.0
rate_limit_dps = 20.0
shaft_lag_s = 0.4
nozzle_lag_s = 0.2
y_m = 0.2
[[actuator]]
name = "pitch"
kind = "controllable_propeller"
x_m = -3.3
y_m = -0.2
diameter_m = 0.2
k_0 = 0.3
k_1 = -0.3
k_2 = -0.1
thrust_deduction = 0.1
wake_0 = 0.2
limit_rpm = 600.0
shaft_lag_s = 0.4
pitch_lag_s = 0.5
[[actuator]]
name = "flap"
kind = "rudder"
behind = "pitch"
x_m = -3.5
area_m2 = 0.03
span_m = 0.25
t_R = 0.3
a_H = 0.2
x_H_m = -3.0
flow_straightening_minus = 0.6
flow_straightening_plus = 0.4
l_R_m = -5.0
limit_deg = 35.0
rate_limit_dps = 15.0
lag_s = 0.1
"""


@njit
def kernel(p: Any, states: Any, controls: Any, wind: Any) -> Any:
    """The compiled rate of change, row by row."""
    rates = np.empty_like(states)
    mass = dynamics.inverse_mass(p)
    for k in range(len(states)):
        work = np.zeros((len(p.actuators), WORK_SIZE))
        held = dynamics.step_constants(p, controls[k], work, wind[k, 0], wind[k, 1])
        s = states[k]
        state = (s[0], s[1], s[2], s[3], s[4], s[5])
        rate = dynamics.state_rate(p, mass, held, 0.0, state, None, np.zeros(1))
        for i in range(6):
            rates[k, i] = rate[i]
    return rates


@lru_cache(maxsize=16)
def ship(name: str) -> tuple[Vessel, Plant, Equations]:
    vessel = load_vessel(name)
    plant = vessel_plant(vessel)
    return vessel, plant, equations_of(vessel, plant)


def arrays(equations: Equations) -> SimpleNamespace:
    return execute(equations, np, nested_parameters(equations, flat_parameters(equations), np.array))


def situations(plant: Plant, equations: Equations, number: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """States over the range of a model, controls and wind: ahead, astern, reversed, and often exactly at rest."""
    random = np.random.default_rng(7)
    sizes = [100.0, 100.0, 4.0, plant.surge_high_mps, plant.sway_limit_mps, plant.yaw_rate_limit_radps]
    states = random.normal(size=(number, 6)) * sizes / 2.0
    limits = np.array(equations.parameters["drives"]["limit"])
    controls = random.uniform(-1.0, 1.0, (number, len(limits))) * np.where(np.isfinite(limits), limits, 3.2)
    wind = np.column_stack([random.uniform(-7.0, 7.0, number), random.exponential(6.0, number)])
    states[random.random(states.shape) < 0.15] = 0.0
    states[random.random(number) < 0.05, 3:] = 0.0
    controls[random.random(controls.shape) < 0.15] = 0.0
    wind[random.random(number) < 0.1, 1] = 0.0
    return states, controls, wind


def assert_alike(rates: np.ndarray, expected: np.ndarray) -> None:
    """Within 1e-10 of each rate, or of what rounding makes of the forces that cancel in it."""
    cancelled = 1e-12 * np.abs(expected).max(axis=0)
    assert (np.abs(rates - expected) <= 1e-10 * np.abs(expected) + cancelled).all()


@pytest.fixture(scope="module")
def every_kind(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("ship") / "every_kind.toml"
    path.write_text(KINDS_SHIP, encoding="utf-8")
    return str(path)


@pytest.fixture(params=[*VESSELS, "every_kind"])
def name(request: pytest.FixtureRequest) -> str:
    return str(request.getfixturevalue("every_kind") if request.param == "every_kind" else request.param)


def test_translated_equations_are_the_compiled_ones(name: str) -> None:
    _, plant, equations = ship(name)
    states, controls, wind = situations(plant, equations, 4000)
    expected = kernel(pack(plant)[0], states, controls, wind)
    with np.errstate(all="raise", under="ignore"):  # no side of a branch divides by zero
        rates = arrays(equations).derivative(states, controls, wind)
    assert_alike(rates, expected)


def test_casadi_function_is_the_compiled_one(name: str) -> None:
    _, plant, equations = ship(name)
    states, controls, wind = situations(plant, equations, 500)
    function = SymbolicShip(equations).derivative()
    rates = np.array(function.map(500)(states.T, controls.T, wind.T, *(
        np.full((1, 500), value) for value in flat_parameters(equations).values()
    ))[0]).T  # fmt: skip
    assert_alike(rates, kernel(pack(plant)[0], states, controls, wind))


def test_gradient_is_that_of_differences_and_finite_at_rest(name: str) -> None:
    _, plant, equations = ship(name)
    function, numpy_ship = SymbolicShip(equations).derivative(), arrays(equations)
    size = len(equations.controls)
    x = casadi.MX.sym("x", 8 + size)
    rate = function(state=x[:6], controls=x[6 : 6 + size], wind=x[6 + size :])["derivative"]
    jacobian = casadi.Function("jacobian", [x], [casadi.jacobian(rate, x)])
    assert np.isfinite(np.array(jacobian(np.zeros(8 + size)))).all()
    u = plant.surge_high_mps
    point = np.array([1.0, 2.0, 0.3, 0.6 * u, 0.1 * u, 0.3 * plant.yaw_rate_limit_radps, *[0.3] * size, 0.5, 7.0])
    differences = np.empty((6, 8 + size))
    for k in range(8 + size):
        step = np.zeros(8 + size)
        step[k] = 1e-6 * max(1.0, abs(point[k]))
        ahead, behind = (
            numpy_ship.derivative(at[:6], at[6 : 6 + size], at[6 + size :]) for at in (point + step, point - step)
        )
        differences[:, k] = (ahead - behind) / (2.0 * step[k])
    gradient = np.array(jacobian(point))
    np.testing.assert_allclose(gradient, differences, rtol=1e-6, atol=1e-7 * np.abs(gradient).max())


LAGGING = {
    "gunnerus_short": {"thruster_lag": {"time_constant_s": 1.5}, "backlash_port": {"width_deg": 4.0}},
    "esso_osaka_3m": {"lag_rudder": {"time_constant_s": 0.4}, "backlash_rudder": {"width_deg": 2.0}},
    "kvlcc2_7m": {"thruster_lag": {"time_constant_s": 2.0}},
}


@pytest.mark.parametrize("vessel_name", ["gunnerus_short", "esso_osaka_3m", *nightly("kvlcc2_7m")])
def test_lags_and_play_are_states_of_a_step(vessel_name: str) -> None:
    vessel = load_vessel(vessel_name)
    plant = apply_effects(vessel_plant(vessel), LAGGING[vessel_name])
    equations = equations_of(vessel, plant)
    run = zigzag(vessel, plant, seconds=60.0)
    exported = arrays(equations)
    states = step_by_step(
        run, len(equations.extra_states), lambda x, orders: exported.step(x, orders, np.zeros(2), run.dt_s)
    )
    np.testing.assert_allclose(states, run.states, rtol=1e-9, atol=1e-9)
    assert np.abs(run.states - zigzag(vessel, vessel_plant(vessel), seconds=60.0).states).max() > 1e-3


def zigzag(vessel: Vessel, plant: Plant, seconds: float = 120.0) -> StandardRun:
    """Orders to either side by the clock, and where the simulator goes with the drives that follow them."""
    handling, pace = manoeuvres.handling_of(vessel), manoeuvres.pace_of(vessel)
    units, dt_s = control_units(vessel.actuators), 0.1 * pace.time
    rpm = manoeuvres.usual_rpm(vessel)
    sides = np.sign(np.sin(2.0 * np.pi * (np.arange(round(seconds / 0.1)) + 1) / 400.0))
    orders = np.array([handling.orders(rpm, 15.0 * side) * units for side in sides])
    start = [1.0, 2.0, 0.1, 0.9 * manoeuvres.steady_speed_mps(plant, handling.orders(rpm, 0.0) * units), 0.0, 0.0]
    feedback = manoeuvres.response_of(manoeuvres.drives_of(vessel), orders, dt_s)
    states = dynamics.simulate(plant, start, feedback, np.zeros((len(orders), 2)), dt_s, substeps=1)
    return StandardRun("zigzag", dt_s, orders, states, plant.length_between_perpendiculars_m)


@lru_cache(maxsize=16)
def exported_fmu(folder: Path, name: str, fmi: int) -> Path:
    path = folder / f"{Path(name).stem}_{fmi}.fmu"
    st.export_vessel(name, path, fmi=fmi)
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("fmu")


BY_DAY = [("every_kind", 2), ("kvlcc2_7m", 3)]
"""The ships whose FMUs of version 2 are made, too, whenever tests run; those of the others have the same C code."""


@pytest.mark.parametrize(
    ("built_in", "fmi"),
    [
        *BY_DAY,
        *nightly(*(pair for pair in product([*VESSELS, "every_kind"], (2, 3)) if pair not in BY_DAY)),
    ],
)
def test_fmu_is_valid_and_sails_as_the_simulator(
    folder: Path, built_in: str, fmi: int, request: pytest.FixtureRequest
) -> None:
    name = str(request.getfixturevalue("every_kind")) if built_in == "every_kind" else built_in
    path = exported_fmu(folder, name, fmi)
    assert validate_fmu(str(path)) == []
    vessel, plant, _ = ship(name)
    run = zigzag(vessel, plant)
    states = fmu.track_of_fmu(path, vessel.actuators, run)
    np.testing.assert_allclose(states, run.states, rtol=1e-6, atol=1e-9)


def test_fmu_without_drives_sails_a_steered_zigzag_as_simulate(folder: Path) -> None:
    vessel, plant, _ = ship("gunnerus_short")
    random = [np.random.default_rng(seed) for seed in (1, 2)]
    voyage = sail_through(vessel, plant, STILL, manoeuvres.zigzag(), 1200, 0.1, 20.0, *random)
    with fmu.fmu_instance(exported_fmu(folder, "gunnerus_short", 3)) as (instance, references):
        sailing = fmu.FmuShip(instance, references, vessel.actuators)
        sailing.begin(voyage.states[0], voyage.controls[0], with_drives=False)
        states = [sailing.state()]
        for controls in voyage.controls[:-1]:
            sailing.order(controls)
            states.append(sailing.step(0.1))
    np.testing.assert_allclose(states, voyage.states, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("name", [*VESSELS, "every_kind"])
def test_units_of_numbers_are_those_by_which_the_equations_hold(name: str, request: pytest.FixtureRequest) -> None:
    """In a system of units of its own (3 kg, 2 m and 5 s to one) the ship moves alike: so each number has the
    dimension that its unit says, those without a unit none."""
    vessel, plant, equations = ship(str(request.getfixturevalue(name)) if name == "every_kind" else name)
    size = {"kg": 1.0 / 3.0, "m": 1.0 / 2.0, "s": 1.0 / 5.0}

    def scale(unit: str) -> float:
        powers = fmu.base_units(unit) if unit else {}
        return float(np.prod([size[base] ** power for base, power in powers.items() if base in size]))

    numbers = flat_parameters(equations)
    numbers |= {key: 0.0 for key in numbers if key.endswith("_damping_ps")}  # fades by a constant, in s2/m2
    converted = {key: value * scale(fmu.unit_of_number(key, vessel.actuators)) for key, value in numbers.items()}
    module, other = (
        execute(equations, np, nested_parameters(equations, values, np.array)) for values in (numbers, converted)
    )
    states, controls, wind = situations(plant, equations, 20)
    states[:, 3:] *= 0.2
    labels = equations.controls
    of_controls = [scale("1/s") if label.endswith(("rps", "rpm")) else 1.0 for label in labels]
    speeds = [scale("m/s"), scale("m/s"), scale("1/s")]
    rates = module.derivative(states, controls, wind)
    moved = other.derivative(
        states * [scale("m"), scale("m"), 1.0, *speeds], controls * of_controls, wind * [1.0, scale("m/s")]
    )
    expected = rates * [*speeds, *(speed * scale("1/s") for speed in speeds)]
    size_of_rates = np.abs(expected).max(axis=0)
    np.testing.assert_allclose(moved / size_of_rates, expected / size_of_rates, atol=1e-9)


_SHAFT = {"rps": 2.0 * np.pi, "rpm": np.pi / 30.0, "angle": 1.0}
"""Controls in SI by the end of their labels: rad/s of shafts, rad of angles."""


@pytest.mark.parametrize(("vessel_name", "fmi"), [("gunnerus_short", 3), ("esso_osaka_3m", 2)])
def test_fmu_sails_as_the_simulator_for_one_who_knows_its_description_alone(
    folder: Path, vessel_name: str, fmi: int
) -> None:
    """Each number in the unit that its variable states, by the factor to SI that the FMU gives of that unit: from
    another start than zero, in wind, in steps of 0.3 and 0.7 s, with a push beside it."""
    vessel, plant, _ = ship(vessel_name)
    path = exported_fmu(folder, vessel_name, fmi)
    description = read_model_description(str(path))
    factor = {unit.name: float(unit.baseUnit.factor or 1.0) for unit in description.unitDefinitions}
    in_si = {variable.name: factor.get(variable.unit, 1.0) for variable in description.modelVariables}
    start = np.array([30.0, -20.0, 0.7, 0.4 * plant.surge_high_mps, 0.05, -0.01])
    labels = control_labels(vessel.actuators)
    control = np.array([0.2 if label.endswith("angle") else 3.0 for label in labels])
    turning = control * [_SHAFT[label.rpartition("_")[2]] for label in labels]
    wind, push = np.array([3.8, 9.0]), np.array([0.01, -0.004, 1e-4])
    values = {
        **{f"start_{name}": value for name, value in zip(POSE_AND_VELOCITY, start, strict=True)},
        **dict(zip(map(order_channel_name, control_names(vessel.actuators)), turning, strict=True)),
        **dict(zip(["wind_direction_deg", "wind_speed_mps"], wind, strict=True)),
        **dict(zip([name for name in in_si if name.startswith("extra_acceleration")], push, strict=True)),
    }
    with fmu.fmu_instance(path) as (instance, references):
        sailing = fmu.FmuShip(instance, references, vessel.actuators)
        if fmi == 2:
            instance.setupExperiment(startTime=0.0)
        instance.setBoolean([references["with_drives"]], [False])
        sailing.set([references[name] for name in values], [value / in_si[name] for name, value in values.items()])
        instance.enterInitializationMode()
        instance.exitInitializationMode()
        states = []
        for dt_s in (0.3,) * 10 + (0.7,) * 10:
            sailing.step(dt_s)
            stated = sailing.get([references[name] for name in POSE_AND_VELOCITY])
            states.append(np.array(stated) * [in_si[name] for name in POSE_AND_VELOCITY])
    (X, Y, N), p = push, plant
    pushed = plant.shifted(
        constant_X_n=(p.mass_kg - p.Xud) * X, constant_Y_n=(p.mass_kg - p.Yvd) * Y - p.Yrd * N,
        constant_N_nm=(p.yaw_inertia_kgm2 - p.Nrd) * N - p.Yrd * Y,
    )  # fmt: skip
    sailed = dynamics.simulate_batch(pushed, start, np.tile(control, (100, 1)), np.tile(wind, (100, 1)), 0.1, 1)
    expected = sailed.states[0, [*range(3, 31, 3), *range(37, 101, 7)]]
    np.testing.assert_allclose(states, expected, rtol=1e-6, atol=1e-9)


@pytest.fixture(params=[2, 3])
def two_ships(folder: Path, request: pytest.FixtureRequest) -> Iterator[tuple[fmu.FmuShip, fmu.FmuShip]]:
    path, actuators = exported_fmu(folder, "esso_osaka_3m", request.param), ship("esso_osaka_3m")[0].actuators
    with fmu.fmu_instance(path, "first") as (first, references), fmu.fmu_instance(path, "second") as (second, _):
        yield fmu.FmuShip(first, references, actuators), fmu.FmuShip(second, references, actuators)


START, AHEAD, ASTERN = np.array([0.0, 0.0, 0.5, 0.3, 0.0, 0.0]), np.array([8.0, 0.3]), np.array([-9.0, -0.5])


def sail(sailing: fmu.FmuShip, orders: np.ndarray, steps: int = 50, dt_s: float = 0.1) -> np.ndarray:
    sailing.order(orders)
    return np.array([sailing.step(dt_s) for _ in range(steps)])


def test_instances_do_not_disturb_each_other(two_ships: tuple[fmu.FmuShip, fmu.FmuShip]) -> None:
    first, second = two_ships
    first.begin(START, AHEAD)
    alone = sail(first, AHEAD)
    first.instance.reset()
    first.begin(START, AHEAD)
    second.begin(START, ASTERN)
    both = [(sail(first, AHEAD, 1)[0], sail(second, ASTERN, 1)[0]) for _ in range(50)]
    np.testing.assert_array_equal([pair[0] for pair in both], alone)
    assert np.abs(both[-1][1] - both[-1][0]).max() > 0.01


def test_saved_state_continues_as_before(two_ships: tuple[fmu.FmuShip, fmu.FmuShip]) -> None:
    sailing, other = two_ships
    sailing.begin(START, AHEAD)
    other.begin(START, ASTERN)
    sail(sailing, AHEAD)
    instance, version = sailing.instance, 3 if hasattr(sailing.instance, "setFloat64") else 2
    saved, time_s = (instance.getFMUState if version == 3 else instance.getFMUstate)(), sailing.time_s
    expected = sail(sailing, ASTERN)
    (instance.setFMUState if version == 3 else instance.setFMUstate)(saved)
    sailing.time_s = time_s
    np.testing.assert_array_equal(sail(sailing, ASTERN), expected)
    serialise, restore = (
        (instance.serializeFMUState, other.instance.deserializeFMUState) if version == 3
        else (instance.serializeFMUstate, other.instance.deSerializeFMUstate)
    )  # fmt: skip
    there = restore(serialise(saved))
    (other.instance.setFMUState if version == 3 else other.instance.setFMUstate)(there)
    other.time_s = time_s
    np.testing.assert_array_equal(sail(other, ASTERN), expected)


def test_long_step_is_divided_into_internal_ones(two_ships: tuple[fmu.FmuShip, fmu.FmuShip]) -> None:
    short, long = two_ships
    for sailing in two_ships:
        sailing.begin(START, AHEAD)
    long.instance.reset()
    real = long.set
    long.set = lambda places, values: real(places, [0.1 if value == 1e6 else value for value in values])
    long.begin(START, AHEAD)
    np.testing.assert_allclose(sail(long, AHEAD, 1, 5.0)[-1], sail(short, AHEAD, 50, 0.1)[-1], rtol=1e-12)


def test_fixed_parameter_cannot_be_set_under_way(two_ships: tuple[fmu.FmuShip, fmu.FmuShip]) -> None:
    sailing, _ = two_ships
    sailing.begin(START, AHEAD)
    sail(sailing, AHEAD, 1)
    with pytest.raises(Exception, match=r"(?i)setFloat64|setReal"):
        sailing.set([sailing.references["mass_kg"]], [1.0])


ALONE = """
import sys
sys.path.insert(0, {folder!r})
import numpy as np
import exported as ship
assert not any(name.startswith(("seatrial", "numba", "casadi")) for name in sys.modules)
state = np.tile([0.0, 0.0, 0.1, 3.0, 0.0, 0.0, *np.tile([2.0, 0.1], 2), 0.0], (7, 1))
state[:, 3] = np.linspace(0.0, 5.0, 7)
orders = np.array([2.5, 0.2, 2.5, 0.2, 100.0])
for _ in range(50):
    state = ship.step(state, orders, np.array([0.3, 5.0]), 0.1)
heavier = {{**ship.PARAMETERS, "mass_kg": 2.0 * ship.PARAMETERS["mass_kg"]}}
rates = [ship.derivative(state[3, :6], orders, np.zeros(2), p)[3] for p in (ship.PARAMETERS, heavier)]
print(state.shape, np.isfinite(state).all(), rates[0] != rates[1])
"""


def test_module_runs_by_itself_on_a_batch(tmp_path: Path) -> None:
    st.export_vessel("gunnerus_short", tmp_path / "exported.py")
    done = subprocess.run(
        [sys.executable, "-I", "-c", ALONE.format(folder=str(tmp_path))],
        cwd=tmp_path, capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert done.stdout.split("\n")[0] == "(7, 11) True True"


@pytest.mark.parametrize("vessel_name", ["gunnerus_short", "otter_2m"])
def test_module_is_the_same_by_jax(vessel_name: str, tmp_path: Path) -> None:
    """As the page says, with jax.numpy in numpy's place: compiled, and with gradients that are finite at rest."""
    jax = pytest.importorskip("jax", reason="JAX is not installed")
    jax.config.update("jax_enable_x64", True)
    st.export_vessel(vessel_name, tmp_path / "ship.py")
    text, by_numpy, by_jax = (tmp_path / "ship.py").read_text(), dict[str, Any](), dict[str, Any]()
    exec(text, by_numpy)
    exec(text.replace("import numpy as xp", "import jax.numpy as xp"), by_jax)
    random, count = np.random.default_rng(0), len(by_numpy["CONTROLS"])
    state, orders, wind = random.normal(size=(20, 6 + count)), random.normal(size=(20, count)), np.array([0.5, 4.0])
    compiled = jax.jit(by_jax["step"])(state, orders, wind, 0.1)
    np.testing.assert_allclose(compiled, by_numpy["step"](state, orders, wind, 0.1), rtol=1e-12, atol=1e-12)
    slope = jax.grad(lambda motion: by_jax["derivative"](motion, 0.0 * orders[0], 0.0 * wind).sum())
    assert np.isfinite(slope(np.zeros(6))).all()


@pytest.mark.parametrize("form", [".py", *nightly(".casadi", ".fmu")])
def test_exact_forms_are_not_off(form: str, tmp_path: Path) -> None:
    exported = st.export_vessel("esso_osaka_3m", tmp_path / f"ship{form}")
    assert len(exported.deviations) == 2
    assert max(off.distance_m for off in exported.deviations) < 1e-9
    assert all(path.stat().st_size for path in exported.files)
    assert exported.plot().axes


def test_saved_casadi_functions_know_the_numbers(tmp_path: Path) -> None:
    st.export_vessel("otter_2m", tmp_path / "otter.casadi")
    derivative = casadi.Function.load(str(tmp_path / "otter.casadi"))
    step = casadi.Function.load(str(tmp_path / "otter_step.casadi"))
    assert derivative.name_in()[:3] == ["state", "controls", "wind"]
    state = np.array([0.0, 0.0, 0.0, 1.0, 0.1, 0.2])
    rates = derivative(state=state, controls=[5.0, 6.0], wind=[0.0, 0.0])["derivative"]
    heavier = derivative(state=state, controls=[5.0, 6.0], wind=[0.0, 0.0], mass_kg=110.0)["derivative"]
    assert float(rates[3]) != float(heavier[3])
    after = step(state=[*state, 5.0, 6.0], orders=[5.0, 6.0], wind=[0.0, 0.0], dt=0.01)["next_state"]
    np.testing.assert_allclose(np.array(after[:6]).ravel(), state + 0.01 * np.array(rates).ravel(), atol=1e-3)


OWN_EFFECT = """
from math import cos
from random import random
from seatrial.hybrid.effects import Effect, Parameter

def {name}(time_s, state, control, environment, parameters):
    {body}

EFFECTS = [Effect("{name}", family="hull", kind="physics", what="Test", source="Test",
    parameters=(Parameter("force_n", "N", 0.0, -1e6, 1e6, 1e3, 1.0),),
    change=lambda plant, values: plant.with_force({name}, values["force_n"]))]
"""


def own_effect(tmp_path: Path, name: str, body: str) -> tuple[Path, Path]:
    code, ship_file = tmp_path / f"{name}.py", tmp_path / f"{name}.toml"
    code.write_text(OWN_EFFECT.format(name=name, body=body), encoding="utf-8")
    ship_file.write_text(
        f'name = "own"\nbase = "gunnerus_short"\n[effects.{name}]\nforce_n = 2e4\n', encoding="utf-8"
    )
    return code, ship_file


def test_force_of_ones_own_goes_along(tmp_path: Path) -> None:
    body = "return (-parameters[0] * cos(state[2]) if state[3] > 0.0 else 0.0), 0.0, parameters[0] * control[0]"
    code, ship_file = own_effect(tmp_path, "pull", body)
    exported = st.export_vessel(ship_file, tmp_path / "own.py", effects=[code])
    assert max(off.distance_m for off in exported.deviations) < 1e-9
    plain = st.export_vessel("gunnerus_short", tmp_path / "plain.py")
    assert np.abs(exported.tracks[0][2][-1] - plain.tracks[0][2][-1]).max() > 1.0


def test_force_that_cannot_be_translated_is_refused_by_name(tmp_path: Path) -> None:
    code, ship_file = own_effect(tmp_path, "ripple", "return parameters[0] * cos(time_s), 0.0, 0.0")
    with pytest.raises(ConfigurationError, match="ripple"):
        st.export_vessel(ship_file, tmp_path / "own.py", effects=[code])


@pytest.mark.parametrize(
    ("words", "code", "text"),
    [
        ("vessel export kvlcc2_7m -o ship.doc", 1, "name it .py"),
        ("vessel export kvlcc2_7m -o ship.fmu --fmi 1", 2, "neither 2 nor 3"),
        ("vessel export titanic -o ship.py", 1, "no vessel 'titanic'"),
    ],
)
def test_wrong_uses_are_explained(
    words: str, code: int, text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(st.app, words.split())
    assert done.exit_code == code
    assert text in str(done.exception) + done.output
    assert not list(tmp_path.iterdir())


def test_gradient_of_a_step_is_finite(name: str) -> None:
    """Also where drives have no limit, at rest, and with the feedback at its order."""
    _, plant, equations = ship(name)
    step, size = SymbolicShip(equations).step(), len(equations.controls)
    states = 6 + size * (1 + len(equations.extra_states))
    x, orders = casadi.MX.sym("x", states), casadi.MX.sym("orders", size)
    after = step(state=x, orders=orders, wind=[0.0, 0.0], dt=0.1)["next_state"]
    jacobian = casadi.Function("jacobian", [x, orders], [casadi.jacobian(after, casadi.vertcat(x, orders))])
    under_way = np.full(states, 0.2)
    under_way[3] = 0.5 * plant.surge_high_mps
    for state, order in ((np.zeros(states), 0.0), (under_way, 0.2), (under_way, 0.3)):
        assert np.isfinite(np.array(jacobian(state, np.full(size, order)))).all()


@pytest.mark.pages
@pytest.mark.parametrize("number", [0, 1, 2])
def test_examples_of_the_page_run(number: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page = (Path(__file__).parents[2] / "docs" / "export_model.md").read_text(encoding="utf-8")
    example = re.findall(r"```python\n(.*?)```", page, re.DOTALL)[number]
    done = subprocess.run(
        [sys.executable, "-c", example], cwd=tmp_path, capture_output=True, text=True, check=True,
    )  # fmt: skip
    expected = {1: "[22.55  3.   -0.  ]"}
    assert expected.get(number, "") in done.stdout
    assert done.stdout.strip()


MATRIX_OFF = {"turn": 0.6, "crash": 1.5}
"""In lengths; the side force of Esso Osaka's propeller astern, which turns it by 82 deg, is no matrix."""


@pytest.mark.parametrize("vessel_name", ["kvlcc2_7m", *nightly(*(name for name in VESSELS if name != "kvlcc2_7m"))])
def test_matrix_form_turns_and_stops_about_as_the_ship(vessel_name: str, tmp_path: Path) -> None:
    exported = st.export_vessel(vessel_name, tmp_path / "ship.mat")
    for off in exported.deviations:
        assert off.distance_lengths < MATRIX_OFF[off.run.split()[0]], off
    assert len(exported.deviations) == 2


def test_matrix_pull_at_rest_is_that_of_the_kernel_at_any_pitch_and_angle(tmp_path: Path) -> None:
    """Of a jet that turns and a propeller of controllable pitch; the rudders stay amidships."""
    (tmp_path / "kinds.toml").write_text(KINDS_SHIP)
    vessel = load_vessel(tmp_path / "kinds.toml")
    plant = bare_plant(vessel)
    thrusters = matrix_model(vessel, plant).thrusters
    rudders = {f"{name}_angle" for name in rudder_names(vessel.actuators)}
    largest = [0.0 if label in rudders else 1.0 for label in control_labels(vessel.actuators)]
    controls = largest * np.random.default_rng(0).uniform(0.1, 1.0, (20, len(largest)))
    for held in controls:
        pulls = [thruster.pull(held, 0.0) for thruster in thrusters]
        force = actuators_force(pack(plant)[0], held, np.zeros((len(vessel.actuators), WORK_SIZE)), 0.0, 0.0, 0.0)
        np.testing.assert_allclose(np.sum(pulls, axis=0), force[:2], rtol=1e-9, atol=1e-9)


def test_a_thruster_that_turns_pulls_by_its_pitch_where_its_angle_points() -> None:
    """Shaft, pitch and angle, as of a cycloidal drive."""
    thruster = Thruster("drive", "turning", 0.0, 0.0, "angle", 0, 1.0, nn=2.0, angle=2, pitch=1)
    pull = thruster.pull(np.array([3.0, -0.5, np.pi / 2.0]), 0.0)
    np.testing.assert_allclose(pull, (0.0, -9.0), atol=1e-12)


@pytest.mark.parametrize("form", [".mat", ".sdf"])
def test_second_order_ship_is_exact_in_matrices_and_plugins(form: str, tmp_path: Path) -> None:
    exported = st.export_vessel("otter_2m", tmp_path / f"otter{form}")
    assert max(off.distance_m for off in exported.deviations) < 1e-9


def test_matrices_are_those_of_the_kernel(tmp_path: Path) -> None:
    vessel, plant, _ = ship("gunnerus_short")
    st.export_vessel(vessel, tmp_path / "ship.mat")
    saved = loadmat(tmp_path / "ship.mat", simplify_cells=True)
    inertia = plant.yaw_inertia_kgm2 - plant.Nrd
    mass = [
        [plant.mass_kg - plant.Xud, 0.0, 0.0],
        [0.0, plant.mass_kg - plant.Yvd, -plant.Yrd],
        [0.0, -plant.Yrd, inertia],
    ]  # fmt: skip
    np.testing.assert_allclose(saved["M"], mass)
    np.testing.assert_allclose(saved["B"], [[1, 1, 0], [0, 0, 1], [2.7, -2.7, 13.08]])
    assert saved["D_linear"][0, 0] > 0.0
    assert saved["D_linear"][2, 2] > 0.0


@pytest.mark.parametrize("vessel_name", ["gunnerus_short", *nightly("esso_osaka_3m", "otter_2m")])
def test_matlab_function_states_the_matrix_model(vessel_name: str, tmp_path: Path) -> None:
    """Its lines, read as Python's, give the accelerations; there is no MATLAB and no Octave here."""
    vessel, plant, equations = ship(vessel_name)
    st.export_vessel(vessel, tmp_path / "model.m")
    model = matrix_model(vessel, plant)
    states, controls, _ = situations(plant, equations, 20)
    for state, control in zip(states, controls, strict=True):
        np.testing.assert_allclose(
            evaluate_m((tmp_path / "model.m").read_text(), state[3:], control), model.rate(state, control)[3:],
            rtol=1e-9, atol=1e-12,
        )  # fmt: skip


@pytest.mark.skipif(shutil.which("octave") is None, reason="Octave, which runs .m files, is not installed")
def test_octave_runs_the_matlab_function(tmp_path: Path) -> None:
    """Its accelerations are those of the matrix model."""
    vessel, plant, equations = ship("kvlcc2_7m")
    st.export_vessel(vessel, tmp_path / "model.m")
    states, controls, _ = situations(plant, equations, 20)
    call = "printf('%.17g %.17g %.17g\\n', model({}', {}'));"
    calls = [
        call.format(state[3:].tolist(), control.tolist()) for state, control in zip(states, controls, strict=True)
    ]
    done = subprocess.run(["octave", "--no-gui", "--quiet", "--eval", "\n".join(calls)],
                          cwd=tmp_path, capture_output=True, text=True, check=False)  # fmt: skip
    model = matrix_model(vessel, plant)
    expected = [model.rate(state, control)[3:] for state, control in zip(states, controls, strict=True)]
    np.testing.assert_allclose(
        np.array(done.stdout.split(), dtype=float).reshape(-1, 3), expected, rtol=1e-9, atol=1e-12
    )


def evaluate_m(text: str, nu: np.ndarray, controls: np.ndarray) -> np.ndarray:
    """What the function returns first: enough of the language for what is written in it."""
    code = text.partition("\n")[2]  # what it returns is said in the first line
    code = re.sub(r"\[([^\[\]]*)\]", r"mat('\1')", code)
    code = re.sub(r"if n >= 0, pull = (.*?); else, pull = (.*?); end", r"pull = \1 if n >= 0 else \2", code)
    code = re.sub(r"\b(nu|controls|F|tau)\((\d)\)", lambda found: f"{found[1]}[{int(found[2]) - 1}]", code)
    code = re.sub(r"\bD\((\d),(\d)\)", lambda found: f"D[{int(found[1]) - 1},{int(found[2]) - 1}]", code)
    space: dict[str, Any] = {
        "nu": nu, "controls": controls, "zeros": lambda *size: np.zeros(size), "abs": abs,
        "sin": np.sin, "cos": np.cos, "max": max,
    }  # fmt: skip

    def mat(rows: str) -> np.ndarray:
        depth = [[eval(part, space) for part in re.split(r",(?![^()]*\))", row)] for row in rows.split(";")]
        values = np.array(depth, dtype=float)
        return values[:, 0] if values.shape[1] == 1 else values

    space["mat"] = mat
    for line in code.splitlines():
        if line.startswith(("%", "end", "nu_dot")) or not line:
            continue
        exec(line, space)
    force = space["tau"] - space["C"] @ nu - space["D"] @ nu
    return np.asarray(np.linalg.solve(space["M"], force))


def test_gazebo_plugins_have_the_numbers_of_the_ship(tmp_path: Path) -> None:
    st.export_vessel("otter_2m", tmp_path / "otter.sdf")
    root = ElementTree.parse(tmp_path / "otter.sdf").getroot()
    plugins = {plugin.get("name"): plugin for plugin in root.iter("plugin")}
    water, thruster = plugins["gz::sim::systems::Hydrodynamics"], plugins["gz::sim::systems::Thruster"]
    numbers = {element.tag: element.text for element in water}
    expected = {"xDotU": -5.28, "yDotV": -82.5, "nDotR": -27.1, "xUabsU": -25.1, "yVabsV": -116.0, "nRabsR": -431.0}
    for name, value in expected.items():
        assert float(numbers[name]) == pytest.approx(value, rel=1e-6), name
    assert numbers["disable_coriolis"] == "true"
    pull = float(thruster.find("max_thrust_cmd").text)  # type: ignore[union-attr, arg-type]
    assert pull == pytest.approx(12.2 * 9.81, rel=0.01)
    assert "yaw 1.70" in (tmp_path / "otter.sdf").read_text(encoding="utf-8")


@pytest.mark.parametrize("vessel_name", ["gunnerus_short", *nightly("esso_osaka_3m", "otter_2m")])
def test_gazebo_is_told_newtons_and_angles(vessel_name: str, tmp_path: Path) -> None:
    """The limits are the thrust at the shaft's limit, by what the file says of it; blades spin at its shaft speed
    ahead; what steers has a joint that a controller turns at its rate."""
    vessel, plant, _ = ship(vessel_name)
    st.export_vessel(vessel, tmp_path / "ship.sdf")
    text = (tmp_path / "ship.sdf").read_text(encoding="utf-8")
    root = ElementTree.fromstring(text.partition("\n")[2])
    said = re.findall(r"(\w+): newtons on (\S+)/cmd_thrust, of n rev/s (\S+) n\^2 ahead and -(\S+) n", text)
    plugins = [plugin for plugin in root.iter("plugin") if "Thruster" in str(plugin.get("name"))]
    assert len(said) == len(plugins) > 0
    actuators = {actuator.name: actuator for actuator in vessel.actuator}
    for (name, topic, ahead, astern), plugin in zip(said, plugins, strict=True):
        numbers = {element.tag: element.text or "" for element in plugin}
        assert topic == f"/model/{numbers['namespace']}/joint/{numbers['joint_name']}"
        n = actuators[name].limit_rpm / 60.0
        assert float(numbers["max_thrust_cmd"]) == pytest.approx(float(ahead) * n**2, rel=1e-5)
        assert float(numbers["min_thrust_cmd"]) == pytest.approx(-float(astern) * n**2, rel=1e-5)
        force_per_square = plant.water_density_kgpm3 * float(numbers["propeller_diameter"]) ** 4
        blades_radps = (
            float(numbers["max_thrust_cmd"]) / force_per_square / float(numbers["thrust_coefficient"])
        ) ** 0.5
        assert blades_radps == pytest.approx(2.0 * np.pi * n)
    joints = {joint.get("name"): joint for joint in root.iter("joint")}
    turned = {
        plugin.findtext("joint_name"): plugin for plugin in root.iter("plugin")
        if "JointPosition" in str(plugin.get("name"))
    }  # fmt: skip
    steering = [actuator for actuator in vessel.actuator if actuator.kind in ("azimuth", "rudder")]
    assert len(turned) == len(steering)
    for actuator, (name, plugin) in zip(steering, turned.items(), strict=True):
        assert joints[name].findtext("axis/xyz") == "0 0 -1"
        rate_dps = getattr(actuator, "azimuth_rate_limit_dps", getattr(actuator, "rate_limit_dps", None))
        assert float(plugin.findtext("cmd_max") or 0.0) == pytest.approx(np.deg2rad(rate_dps))
        assert plugin.findtext("topic") in text.partition("-->")[0]


def test_table_has_sources_and_intervals(tmp_path: Path) -> None:
    st.export_vessel("gunnerus_identified", tmp_path / "ship.csv")
    table = pd.read_csv(tmp_path / "ship.csv", comment="#").set_index("name")
    assert table.loc["mass_kg", ["unit", "group"]].tolist() == ["kg", "inertia"]
    value, low, high = table.loc["Xuu", ["value", "low", "high"]]
    assert (low / value, high / value) == pytest.approx((1.588, 0.412))  # 0.3 in [estimated]
    assert "MCSim_python" in table.loc["Yuv", "source"]
    assert np.isnan(table.loc["mass_kg", "low"])
