"""Ships with propeller and rudder: the published equations written out a second time, and another program's tracks.

The tracks are those of the package shipmmg 0.0.11 for KVLCC2's 7 m model; where it is installed they are simulated
anew, otherwise a few of its values stand for them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import asin, atan2, copysign, cos, exp, hypot, pi, radians, sin, sqrt

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.acquisition.core.quantities import Floats
from seatrial.hybrid.effects import catalogue_of, vessel_plant
from seatrial.hybrid.vessel.dynamics import simulate
from seatrial.hybrid.vessel.files import load_vessel, save_vessel
from seatrial.hybrid.vessel.plant import Plant, pack
from tests.force_calls import actuators_force, drag_across, hull_force, wind_force

Force = tuple[float, float, float]
ESSO, KVLCC2 = (vessel_plant(load_vessel(name)) for name in ("esso_osaka_3m", "kvlcc2_7m"))
speeds = st.floats(-0.4, 1.0)
sides = st.floats(-0.3, 0.3)
rates = st.floats(-0.2, 0.2)


def force_of_actuators(plant: Plant, control: tuple[float, float], motion: Force) -> Force:
    """What the compiled core says of propeller and rudder."""
    X, Y, N = actuators_force(pack(plant)[0], np.array(control), np.zeros((2, 4)), *motion)
    return X, Y, N


def published_hull(u: float, v: float, r: float) -> Force:
    """Esso Osaka's hull, its integrals as sums, the Coriolis terms of the added mass with it."""
    rho, L, d, U, beta = 998.0, 3.0, 0.20114, hypot(u, v), atan2(v, u)
    q, mass = 0.5 * rho * L * d, 0.5 * rho * L * L * d
    x = (np.arange(4000) + 0.5) / 4000 - 0.5
    across_Y, across_N = v + 2.217 * r * L * x, v + 0.8097 * r * L * x
    X = (-0.02139 + (-0.03189 + 0.02139) * abs(beta) / pi) * u * U - 0.0081 * v * r * L
    Y = -0.3728 * v * abs(u) + 0.116 * r * L * u - 0.9665 * float(np.mean(np.abs(across_Y) * across_Y))
    N = -0.1458 * v * u - 0.04849 * r * L * abs(u) - 0.9665 * float(np.mean(np.abs(across_N) * across_N * x))
    return q * X + 0.2579 * mass * v * r, q * Y - 0.0467 * mass * u * r, q * L * N


def published_actuators(n: float, delta: float, u: float, v: float, r: float) -> Force:
    """Esso Osaka's propeller and rudder, quadrant by quadrant."""
    rho, L, d, D, P = 998.0, 3.0, 0.20114, 0.084, 0.0600684
    q, U = 0.5 * rho * L * d, hypot(u, v)
    b = (v - 1.551 * r) / U
    left = 1.0 - (0.614 - 0.871 * abs(b) + 0.359 * b * b) if u > 0.0 else 1.0
    left = min(max(left, 0.0), 1.0)
    J_s = u / (n * D)
    J = J_s * left
    K_T = 0.3278 - 0.3323 * J - 0.156 * J * J
    side, turn = 0.0, 0.0
    if n > 0.0:
        X = rho * D**4 * n * n * 0.78 * K_T
        if u < 0.0:
            side = q * (n * P) ** 2 * (5.08e-3 * J_s**2 + 1.70e-3 * J_s + 9.16e-4)
            turn = q * L * (n * P) ** 2 * (-2.16e-3 * J_s**2 + 6.27e-5 * J_s + 6.25e-5)
    else:
        C = -0.251 - 0.175 * J_s if J_s >= 0.33 else -0.233
        X, K_T = rho * D**4 * n * n * C, C
        a, m = -5.58e-4, 2.25e-4
        if J_s < -0.35:
            a, m = -4.93e-3 - 5.87e-3 * J_s, 1.96e-3 + 2.33e-3 * J_s
        elif J_s <= -0.06:
            a, m = -7.9e-5 + 7.99e-3 * J_s, 3.5e-5 - 3.17e-3 * J_s
        side, turn = q * (n * D) ** 2 * a, q * L * (n * D) ** 2 * m
    eps, eta, u_P = 1.42, D / 0.127905, u * left
    if n > 0.0 and K_T >= 0.0:
        inside = u_P + 0.202817 * (sqrt(u_P**2 + 8.0 * K_T * (n * D) ** 2 / pi) - u_P)
        u_R = eps * sqrt(eta * inside**2 + (1.0 - eta) * u_P**2)
    elif u < 0.0:
        u_R = u
    else:
        race = eps * u_P + 0.144 * n * D * sqrt(8.0 * abs(K_T) / pi)
        square = eta * race * abs(race) + (1.0 - eta) * (eps * u_P) ** 2 - 0.176 * u * u
        u_R = copysign(sqrt(abs(square)), square)
    gamma = 0.3506 if v - 1.5 * r >= 0.0 else 0.4406
    v_R = -gamma * (v - 3.24 * r)
    aspect = 0.127905**2 / 0.01063
    F = 0.5 * rho * 0.01063 * (u_R**2 + v_R**2) * 6.13 * aspect / (2.25 + aspect) * sin(delta - atan2(v_R, u_R))
    rudder = -0.81 * F * sin(delta), -1.393 * F * cos(delta), (1.5 + 0.393 * 1.35) * F * cos(delta)
    return X + rudder[0], side + rudder[1], turn + rudder[2]


@settings(deadline=None, max_examples=60)
@given(u=speeds, v=sides, r=rates)
def test_hull_of_cross_flow_is_the_published_one(u: float, v: float, r: float) -> None:
    ours = hull_force(pack(ESSO)[0], u, v, r)
    assert ours == pytest.approx(published_hull(u, v, r), rel=1e-5, abs=1e-4)


@settings(deadline=None, max_examples=100)
@given(
    n=st.floats(-15.0, 15.0).filter(lambda n: abs(n) > 0.5), delta=st.floats(-0.6, 0.6), u=speeds, v=sides, r=rates
)
def test_propeller_and_rudder_are_the_published_ones(n: float, delta: float, u: float, v: float, r: float) -> None:
    if hypot(u, v) < 0.01:
        return
    ours = force_of_actuators(ESSO, (n, delta), (u, v, r))
    assert ours == pytest.approx(published_actuators(n, delta, u, v, r), rel=1e-4, abs=1e-4)


@given(v=st.floats(-1.0, 1.0), w=st.floats(-1.0, 1.0))
def test_drag_across_is_the_integral(v: float, w: float) -> None:
    s = (np.arange(20000) + 0.5) / 20000 - 0.5
    flow = v + w * s
    whole = np.mean(np.abs(flow) * flow), np.mean(np.abs(flow) * flow * s)
    assert drag_across(v, w) == pytest.approx(whole, abs=1e-7)


@given(angle=st.floats(-3.1, 3.1))
def test_wind_of_the_regression_pushes_away_from_where_it_comes(angle: float) -> None:
    """From ahead aft, from starboard to port; mirrored where the wind is."""
    packed = pack(ESSO)[0]
    X, Y, N = wind_force(packed, 5.0 * cos(angle), 5.0 * sin(angle))
    assert Y * sin(angle) <= 0.0
    mirrored = wind_force(packed, 5.0 * cos(angle), -5.0 * sin(angle))
    assert mirrored == pytest.approx((X, -Y, -N), abs=1e-12)
    assert wind_force(packed, 5.0, 0.0)[0] < 0.0 < wind_force(packed, -5.0, 0.0)[0]


def test_a_shaft_that_comes_to_rest_leaves_numbers() -> None:
    """A lagging shaft that is stopped goes through ever smaller speeds."""
    plant = ESSO.replaced(propeller_lag_s=1.0)
    order = np.tile([-5.0, 0.1], (2000, 1))
    order[20:] = 0.0
    assert np.isfinite(simulate(plant, [0.0, 0.0, 0.0, 0.8, 0.0, 0.0], order, np.zeros((2000, 2)), 1.0)).all()


def test_starboard_rudder_turns_her_to_starboard() -> None:
    for plant in (ESSO, KVLCC2):
        order = np.tile([10.0, radians(20.0)], (40, 1))
        end = simulate(plant, [0.0, 0.0, 0.0, 0.8, 0.0, 0.0], order, np.zeros((40, 2)), 1.0)[-1]
        assert end[5] > 0.01
        assert end[1] > 0.0


def oracle(rudder_rad: Floats, x_G: float) -> Floats | None:
    """The states of the package shipmmg at every 0.1 s, [steps + 1, 6]; None where it is not installed."""
    try:
        from shipmmg import mmg_3dof  # type: ignore[import-not-found, unused-ignore]
    except ImportError:
        return None
    rho, L, d = 1000.0, 7.0, 0.46
    mass, added = 3.27 * rho, 0.5 * rho * L**2 * d
    basic = mmg_3dof.Mmg3DofBasicParams(
        L_pp=L, B=1.27, d=d, x_G=x_G, D_p=0.216, m=mass, I_zG=mass * (0.25 * L) ** 2, A_R=0.0539, η=0.216 / 0.345,
        m_x=0.022 * added, m_y=0.223 * added, J_z=0.011 * added * L**2, f_α=2.747, ϵ=1.09, t_R=0.387, x_R=-0.5 * L,
        a_H=0.312, x_H=-0.464 * L, γ_R_minus=0.395, γ_R_plus=0.640, l_R=-0.710, κ=0.5, t_P=0.220, w_P0=0.40,
        x_P=-0.690,
    )  # fmt: skip
    dashed = {f"{name}_dash": KVLCC2.number(name) for name in KVLCC2.hull_model.numbers}
    coefficients = mmg_3dof.Mmg3DofManeuveringParams(k_0=0.2931, k_1=-0.2753, k_2=-0.1385, **dashed)
    time = np.arange(len(rudder_rad)) * 0.1
    run = mmg_3dof.simulate_mmg_3dof(
        basic, coefficients, time, rudder_rad, np.full(len(time), 10.05), u0=1.179, ρ=rho, rtol=1e-8, atol=1e-8
    )
    return np.asarray(run.sol(time)[[3, 4, 5, 0, 1, 2]].T)


def sailed(plant: Plant, rudder_rad: Floats) -> Floats:
    """Our states under the same rudder, 0.1 s a step."""
    mean = 0.5 * (rudder_rad[1:] + rudder_rad[:-1])
    order = np.column_stack([np.full(len(mean), 10.05), mean])
    return simulate(plant, [0.0, 0.0, 0.0, 1.179, 0.0, 0.0], order, np.zeros((len(mean), 2)), 0.1)


def circle(side: float) -> Floats:
    """The rudder put over to 35 degrees in 3 s, 200 s in all."""
    return side * radians(35.0) * np.clip(np.arange(0.0, 200.0, 0.1) / 3.0, 0.0, 1.0)


def zigzag(angle_deg: float) -> Floats:
    """The rudder of a zigzag that our model steers: put over where the heading has come to as many degrees."""
    rudder, side, state = [0.0], 1.0, np.array([0.0, 0.0, 0.0, 1.179, 0.0, 0.0])
    rate = radians(11.73) * 0.1
    for _ in range(1200):
        if side * state[2] >= radians(angle_deg):
            side = -side
        over = side * radians(angle_deg) - rudder[-1]
        rudder.append(rudder[-1] + min(max(over, -rate), rate))
        state = simulate(KVLCC2, state, [[10.05, 0.5 * sum(rudder[-2:])]], np.zeros((1, 2)), 0.1)[-1]
    return np.array(rudder)


@pytest.mark.parametrize(("x_G", "limit"), [(0.0, 0.002), (0.25, 0.01)])
@pytest.mark.parametrize(("helm", "size"), [(circle, 1.0), (circle, -1.0), (zigzag, 10.0), (zigzag, 20.0)])
def test_kvlcc2_sails_as_in_another_program(
    helm: Callable[[float], Floats], size: float, x_G: float, limit: float
) -> None:
    """Every state within 1 % of its largest value; to 0.2 % where both count the drift angle at one point."""
    rudder = helm(size)
    theirs = oracle(rudder, x_G)
    if theirs is None:
        pytest.skip("shipmmg is not installed")
    off = KVLCC2.number("centre_of_gravity_m") - x_G
    ours = sailed(KVLCC2.replaced(centre_of_gravity_m=x_G).shifted(l_R_m=off, switch_x_m=off, wake_x_m=off), rudder)
    assert (np.abs(ours - theirs).max(axis=0) / np.abs(theirs).max(axis=0)).max() < limit


def test_kvlcc2_turns_as_another_program_says() -> None:
    """Advance and tactical diameter of shipmmg 0.0.11 in ship lengths, 35 degrees to starboard and to port."""
    for side, advance, diameter in ((1.0, 3.335, 3.158), (-1.0, 3.183, 2.891)):
        states = sailed(KVLCC2, circle(side))
        turned = np.abs(states[:, 2])
        assert states[np.argmax(turned >= pi / 2.0), 0] / 7.0 == pytest.approx(advance, rel=0.01)
        assert abs(states[np.argmax(turned >= pi), 1]) / 7.0 == pytest.approx(diameter, rel=0.01)


def test_steady_wake_and_thrust_balance_resistance() -> None:
    """Straight ahead at the published approach speed: thrust less deduction is R_0, by the formulas alone."""
    u, n, D, L, d = 1.179, 10.05, 0.216, 7.0, 0.46
    J = u * 0.6 / (n * D)
    thrust = 0.78 * 1000.0 * n**2 * D**4 * (0.2931 - 0.2753 * J - 0.1385 * J * J)
    X = hull_force(pack(KVLCC2)[0], u, 0.0, 0.0)[0]
    assert -0.5 * 1000.0 * L * d * 0.022 * u * u == pytest.approx(X)
    assert force_of_actuators(KVLCC2, (n, 0.0), (u, 0.0, 0.0))[0] == pytest.approx(thrust)
    assert exp(-4.0 * asin(0.0) ** 2) == 1.0


@pytest.mark.parametrize("name", ["esso_osaka_3m", "kvlcc2_7m"])
def test_every_effect_of_a_rudder_ship_vanishes_smoothly(name: str) -> None:
    """A hundredth of an effect changes the motion by about a hundredth of what it does."""
    plant = vessel_plant(load_vessel(name))
    order = np.column_stack([np.full(40, 9.0), np.deg2rad(np.where(np.arange(40) < 20, 15.0, -10.0))])
    wind = np.tile([1.0, 2.0], (40, 1))
    start = [0.0, 0.0, 0.2, 0.6, 0.0, 0.0]
    sound = simulate(plant, start, order, wind, 1.0)
    for effect in catalogue_of(load_vessel(name)).values():
        if effect.chart != "linear" or effect.kind == "sensor":
            continue
        small = effect.values_at([0.001 * each for each in effect.free_coordinates(effect.typical_values)])
        smaller = effect.values_at([0.0005 * each for each in effect.free_coordinates(effect.typical_values)])
        changed = [effect.apply(plant, each) for each in (small, smaller)]
        one, half = (simulate(each, start, order, wind, 1.0) - sound for each in changed)
        assert np.abs(one - 2.0 * half).max() <= 0.2 * np.abs(one).max() + 1e-9, effect.name


def with_effect(plant: Plant, name: str, value: float) -> Plant:
    """The plant with an effect of one parameter."""
    effect = catalogue_of(load_vessel("kvlcc2_7m"))[name]
    return effect.apply(plant, {effect.parameters[0].name: value})


@pytest.mark.parametrize("plant", [ESSO, KVLCC2])
def test_the_hulls_share_of_the_rudders_force_acts_at_its_own_place(plant: Plant) -> None:
    """Side force in proportion to 1 + a_H, what is more of it at x_H, drag as it was."""
    order, motion = (9.0, 0.2), (0.6, 0.02, 0.03)
    before, after = (
        np.array(force_of_actuators(each, order, motion))
        for each in (plant, with_effect(plant, "rudder_interaction_rudder", 0.2))
    )
    a_H, x_H_m = plant.number("a_H"), plant.number("x_H_m")
    assert after[1] / before[1] == pytest.approx((1.2 + a_H) / (1.0 + a_H))
    assert after[2] - before[2] == pytest.approx(x_H_m * (after[1] - before[1]))
    assert after[0] == before[0]


@pytest.mark.parametrize("plant", [ESSO, KVLCC2])
def test_a_rudder_amidships_feels_the_drift_as_far_as_it_is_straightened(plant: Plant) -> None:
    """Nothing without drift; of a small drift twice as much, to either side."""
    twice = with_effect(plant, "flow_straightening_rudder", 2.0)
    for v in (-1e-4, 0.0, 1e-4):
        one, two = (force_of_actuators(each, (9.0, 0.0), (0.6, v, 0.0))[1] for each in (plant, twice))
        assert two == pytest.approx(2.0 * one, rel=1e-3, abs=1e-12)


@pytest.mark.parametrize("plant", [ESSO, KVLCC2])
def test_what_the_hull_takes_of_the_thrust_leaves_the_race_as_it_is(plant: Plant) -> None:
    """The rudder's forces stay, (1 - t) of the thrust is what drives her ahead, and astern nothing changes."""
    more = with_effect(plant, "thrust_deduction_propeller", 0.1)
    for rps, part in ((9.0, 1.0 - 0.1 / (1.0 - plant.number("thrust_deduction"))), (-9.0, 1.0)):
        one, two = (np.array(force_of_actuators(each, (rps, 0.0), (0.1, 0.0, 0.0))) for each in (plant, more))
        assert two[0] == pytest.approx(part * one[0])
        assert two[1:] == pytest.approx(one[1:])


def test_files_of_rudder_ships_round_trip(tmp_path) -> None:  # type: ignore[no-untyped-def]
    for name in ("esso_osaka_3m", "kvlcc2_7m"):
        vessel = load_vessel(name)
        save_vessel(replace(vessel, name="copy"), tmp_path / "copy.toml")
        assert replace(load_vessel(tmp_path / "copy.toml"), name=name) == vessel


def test_a_rudder_behind_nothing_and_an_estimate_of_nothing_are_refused(tmp_path) -> None:  # type: ignore[no-untyped-def]
    vessel = load_vessel("kvlcc2_7m")
    save_vessel(replace(vessel, name="copy"), tmp_path / "copy.toml")
    text = (tmp_path / "copy.toml").read_text()
    (tmp_path / "copy.toml").write_text(text.replace('behind = "propeller"', 'behind = "screw"'))
    with pytest.raises(ConfigurationError, match=r"behind is 'screw'.*propeller"):
        load_vessel(tmp_path / "copy.toml")
    (tmp_path / "copy.toml").write_text(text + '\n[estimated]\n"hull.Y_x" = 0.1\n')
    with pytest.raises(ConfigurationError, match=r"estimated has 'hull.Y_x'"):
        load_vessel(tmp_path / "copy.toml")
