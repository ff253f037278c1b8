"""The simulator against oracles, symmetries and the limits of its model."""

from __future__ import annotations

from math import sin

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from seatrial.acquisition.core.errors import ConfigurationError, InputError, ModelRangeError
from seatrial.hybrid.effects import CATALOGUE
from seatrial.hybrid.vessel.dynamics import run_all, simulate, simulate_batch
from seatrial.hybrid.vessel.plant import Plant, pack
from tests.hybrid import gunnerus_by_hand as by_hand
from tests.hybrid.conftest import Held

MIRROR = np.array([1.0, -1.0, -1.0, 1.0, -1.0, -1.0])
WILD = np.random.default_rng(5)


def _wild(runs: int, steps: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Starts, controls and winds all over the range of the model."""
    start = WILD.normal(0, 1, (runs, 6)) * [50, 50, 2, 0.7, 0.2, 0.01] + [0, 0, 0, 4, 0, 0]
    controls = np.empty((runs, steps, 5))
    controls[..., (0, 2)] = WILD.uniform(1.0, 3.0, (runs, steps, 2))
    controls[..., (1, 3)] = WILD.uniform(-0.35, 0.35, (runs, steps, 2))
    controls[..., 4] = WILD.uniform(-150, 150, (runs, steps))
    wind = np.stack([WILD.uniform(-7, 7, (runs, steps)), WILD.uniform(0, 15, (runs, steps))], axis=-1)
    return start, controls, wind


def test_plain_numpy_equations_give_the_same_runs(plant: Plant) -> None:
    """An independent implementation of the published equations agrees to 1e-9, with and without current."""
    start, controls, wind = _wild(4, 60)
    current = (0.4, -0.7)
    for flow in ((0.0, 0.0), current):
        flowing = plant.replaced(current_north_mps=flow[0], current_east_mps=flow[1])
        ours = simulate(flowing, start, controls, wind, 0.5, substeps=1)
        for run in range(4):
            oracle = by_hand.simulate(start[run], controls[run], wind[run], 0.5, flow)
            assert ours[run] == pytest.approx(oracle, rel=1e-9, abs=1e-9)


def test_an_adaptive_integrator_gives_the_same_run(plant: Plant) -> None:
    """DOP853 at 1e-11 over 30 s of held thrusters: within 0.1 mm at the default step."""
    control, air = np.array([2.8, 0.25, 2.6, 0.2, 60.0]), np.array([1.0, 9.0])
    start = np.array([0.0, 0.0, 0.2, 4.5, 0.1, -0.01])
    exact = solve_ivp(
        lambda _, x: by_hand.derivative(x, control, air), (0.0, 30.0), start, "DOP853", rtol=1e-11, atol=1e-11
    ).y[:, -1]
    ours = simulate(plant, start, np.tile(control, (30, 1)), np.tile(air, (30, 1)), 1.0)
    assert np.abs(ours[-1] - exact).max() < 1e-4


def test_halving_the_step_changes_less_than_a_millimetre(plant: Plant) -> None:
    """Positions after 30 s all over the range, at the default step and at half of it."""
    start, controls, wind = _wild(20, 30)
    coarse = simulate(plant, start, controls, wind, 1.0)
    fine = simulate(plant, start, controls, wind, 1.0, substeps=8)
    assert np.abs(coarse - fine)[..., :2].max() < 1e-3


def test_port_and_starboard_mirror_each_other(plant: Plant) -> None:
    """Everything to the other side: the track is the mirror image."""
    start, controls, wind = _wild(5, 30)
    mirrored = controls[..., [2, 3, 0, 1, 4]] * [1, -1, 1, -1, -1]
    other = simulate(plant, start * MIRROR, mirrored, wind * [-1, 1], 1.0)
    assert other * MIRROR == pytest.approx(simulate(plant, start, controls, wind, 1.0), abs=1e-9)


def test_moving_water_and_air_carry_everything_along(plant: Plant) -> None:
    """Galilei: in a current, with the wind moved by as much, the ship does the same over the moving water."""
    start, controls, _ = _wild(1, 40)
    c = np.array([0.5, -0.8])
    air = np.array([3.0, 5.0])
    turn = np.array([[np.cos(start[0, 2]), np.sin(start[0, 2])], [-np.sin(start[0, 2]), np.cos(start[0, 2])]])
    boosted = start.copy()
    boosted[0, 3:5] += turn @ c

    def reported(velocity: np.ndarray) -> np.ndarray:
        return np.tile([np.arctan2(-velocity[1], -velocity[0]), np.hypot(*velocity)], (1, 40, 1))

    still = simulate(plant, start, controls, reported(air), 1.0)
    flowing = plant.replaced(current_north_mps=c[0], current_east_mps=c[1])
    carried = simulate(flowing, boosted, controls, reported(air + c), 1.0)
    carried[..., :2] -= np.arange(41)[:, np.newaxis] * c
    assert carried[..., :3] == pytest.approx(still[..., :3], abs=1e-5)


def test_without_environment_no_heading_is_special(plant: Plant) -> None:
    """Turning start and wind by an angle turns the whole track by it."""
    start, controls, wind = _wild(1, 40)
    angle = 2.1
    c, s = np.cos(angle), np.sin(angle)
    turned = start.copy()
    turned[0, :2] = [c * start[0, 0] - s * start[0, 1], s * start[0, 0] + c * start[0, 1]]
    turned[0, 2] += angle
    base = simulate(plant, start, controls, wind, 1.0)[0]
    rotated = simulate(plant, turned, controls, wind + np.array([angle, 0.0]), 1.0)[0]
    assert rotated[:, 0] == pytest.approx(c * base[:, 0] - s * base[:, 1], abs=1e-8)
    assert rotated[:, 2:] == pytest.approx(base[:, 2:] + [angle, 0, 0, 0], abs=1e-10)


def test_without_thrust_the_ship_loses_energy(plant: Plant, held: Held) -> None:
    """Kinetic energy, added mass included, never grows when coasting straight or turning, in a vacuum of air."""
    windless = CATALOGUE["wind_load"].apply(plant, {"factor": 0.0})
    for start in ((0, 0, 0, 5, 0, 0), (0, 0, 0, 4, 0.5, 0.03), (0, 0, 0, -2, 0.2, -0.03)):
        states = held(windless, rpm=(0.0, 0.0), start=start, seconds=120)
        nu = states[:, 3:]
        energy = np.einsum("ki,ij,kj->k", nu, by_hand.M, nu)
        assert (np.diff(energy) < 1e-9 * energy[0]).all()


def test_signs_of_the_thrusters(plant: Plant, held: Held) -> None:
    """Stern azimuths at a positive angle turn to port; the tunnel's positive rpm turns to starboard."""
    assert held(plant, angle_deg=(10.0, 10.0))[-1, 5] < -0.01
    assert held(plant, tunnel_rpm=200.0, rpm=(40.0, 40.0), start=(0, 0, 0, 1, 0, 0))[-1, 5] > 0.001
    assert held(plant, rpm=(150.0, 0.0))[-1, 5] > 0.001
    assert held(plant, wind=(90.0, 15.0), rpm=(0.0, 0.0), start=(0.0,) * 6)[-1, 4] < -0.05


@pytest.mark.parametrize(("rpm", "knots"), [(165.0, 9.5), (180.0, 10.3), (200.0, 11.5)])
def test_steady_speeds(rpm: float, knots: float, plant: Plant, held: Held) -> None:
    """Published steady speeds of the ship."""
    surge_mps = held(plant, rpm=(rpm, rpm), seconds=400)[-1, 3]
    assert surge_mps * 3600.0 / 1852.0 == pytest.approx(knots, rel=0.01)


def test_a_batch_is_its_runs_one_by_one(plant: Plant) -> None:
    """Over all cores or alone, with a plant for each or one for all: the same numbers to the bit."""
    start, controls, wind = _wild(7, 20)
    plants = [plant.scaled(1.0 + 0.01 * number, "mass_kg") for number in range(7)]
    together = simulate(plants, start, controls, wind, 1.0)
    for number in range(7):
        alone = simulate(plants[number], start[number], controls[number], wind[number], 1.0)
        assert np.array_equal(together[number], alone)
    shared = simulate(plant, start, controls[:1], wind[:1], 1.0)
    assert np.array_equal(shared[3], simulate(plant, start[3], controls[0], wind[0], 1.0))


def test_leaving_the_range_is_said_and_marked(plant: Plant) -> None:
    """A run that spins out raises with run, time and value; in a batch it alone is marked and NaN."""
    start = np.array([[0, 0, 0, 4, 0, 0], [0, 0, 0, 4, 0, 0.14], [0, 0, 0, np.nan, 0, 0]], dtype=float)
    controls, wind = np.tile([2.5, 0.0, 2.5, 0.0, 0.0], (3, 30, 1)), np.zeros((3, 30, 2))
    controls[1, 5:, (1, 3)] = -1.5
    narrow = plant.replaced(yaw_rate_limit_radps=0.1)
    runs = simulate_batch(narrow, start, controls, wind, 1.0)
    assert runs.in_range.tolist() == [True, False, False]
    assert np.isfinite(runs.states[0]).all()
    assert np.isnan(runs.states[1, runs.left_at[1] + 1 :]).all()
    with pytest.raises(ModelRangeError, match=r"run 1 of 3.*between.*yaw rate"):
        simulate(narrow, start, controls, wind, 1.0)


def test_shapes_that_do_not_fit_are_refused(plant: Plant) -> None:
    """Wrong widths, lengths and numbers of runs are input errors that say so."""
    start, controls, wind = _wild(3, 10)
    with pytest.raises(InputError, match="last dimension"):
        simulate(plant, start[:, :5], controls, wind, 1.0)
    with pytest.raises(InputError, match="10 steps"):
        simulate(plant, start, controls, wind[:, :9], 1.0)
    with pytest.raises(InputError, match="for 3 runs"):
        simulate([plant, plant], start, controls, wind, 1.0)


def test_extra_forces_enter_and_can_be_shared_in_a_batch(plant: Plant) -> None:
    """A force of one's own changes the runs of its plant and no other's."""

    def fourfold(time_s, state, control, environment, parameters):  # type: ignore[no-untyped-def]
        return 0.0, 0.0, parameters[0] * sin(4.0 * state[2])

    start, controls, wind = _wild(2, 20)
    start[:, 2] = 0.3
    forced = plant.with_force(fourfold, 3e4)
    both = simulate([forced, plant], start, controls, wind, 1.0)
    assert both[1] == pytest.approx(simulate(plant, start[1], controls[1], wind[1], 1.0), abs=1e-9)
    assert np.abs(both[0] - simulate(plant, start[0], controls[0], wind[0], 1.0)).max() > 0.01


def test_kernels_do_not_depend_on_the_forces_handed_over(plant: Plant) -> None:
    """A kernel compiled for one function would be compiled anew in every session, and spoil the cache."""
    start, controls, wind = _wild(2, 3)

    def push(time_s, state, control, environment, parameters):  # type: ignore[no-untyped-def]
        return parameters[0], 0.0, 0.0

    def drag(time_s, state, control, environment, parameters):  # type: ignore[no-untyped-def]
        return -parameters[0], 0.0, 0.0

    simulate(plant.with_force(push, 1.0), start, controls, wind, 1.0)
    before = len(run_all.signatures)
    both = simulate(plant.with_force(push, 5e3).with_force(drag, 5e3), start, controls, wind, 1.0)
    assert len(run_all.signatures) == before
    assert both == pytest.approx(simulate(plant, start, controls, wind, 1.0), abs=1e-9)


def test_packed_plants_are_plants(plant: Plant) -> None:
    """The same runs to the bit whether plants come as objects or packed, and the same error out of range."""
    start, controls, wind = _wild(6, 20)
    plants = [plant.scaled(1.0 + 0.02 * number, "mass_kg", "Xuu") for number in range(6)]
    packed = pack(plants)
    assert np.array_equal(
        simulate(packed, start, controls, wind, 1.0), simulate(plants, start, controls, wind, 1.0)
    )
    packed["surge_high_mps"][4] = 0.5
    assert simulate_batch(packed, start, controls, wind, 1.0).left_at[4] == 0
    with pytest.raises(ModelRangeError, match=r"run 4 of 6.* to 0\.5 m/s"):
        simulate(packed, start, controls, wind, 1.0)


def test_packed_plants_need_every_number(plant: Plant) -> None:
    """An array that is no packed plant, or an empty one, is refused before the compiled loop reads it."""
    start, controls, wind = _wild(1, 3)
    for wrong in (np.zeros((1, 100)), pack(plant)[["mass_kg", "Xud"]], pack([plant]).reshape(1, 1)):
        with pytest.raises(ConfigurationError, match="packed plants"):
            simulate(wrong, start, controls, wind, 1.0)
    with pytest.raises(ConfigurationError, match="no plant"):
        simulate(pack(plant)[:0], start, controls, wind, 1.0)
    for field, value in (("actuator_count", 2.0), ("actuators", 0.0)):
        several = pack([plant, plant])
        several[field][1] = value
        with pytest.raises(ConfigurationError, match="different actuators"):
            simulate(several, start, controls, wind, 1.0)
