"""What effects add to forces and inertia, against the formulas written out a second time, in plain Python."""

from __future__ import annotations

from collections.abc import Callable
from math import atan2, cos, degrees, exp, pi, radians, sin

import numpy as np
import pytest
from scipy.linalg import expm

from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.acquisition.core.quantities import Floats
from seatrial.hybrid.effects import CATALOGUE
from seatrial.hybrid.effects.environment import STEADY_WIND
from seatrial.hybrid.effects.hull import aspect_growth
from seatrial.hybrid.vessel.actuators import KINDS
from seatrial.hybrid.vessel.dynamics import simulate
from seatrial.hybrid.vessel.files import load_vessel
from seatrial.hybrid.vessel.plant import Plant, bare_plant
from tests.hybrid.conftest import Held

Force = tuple[float, float, float]
ORDER = (2.2, 0.3, 1.8, -0.5, 150.0)  # rev/s, rad, rev/s, rad, rpm
MOTIONS = [(4.0, 0.6, 0.04), (5.0, -0.8, 0.07), (2.0, 0.3, -0.06)]
FROM_DEG, WIND_MPS = 65.0, 11.0


def with_effect(plant: Plant, name: str, **values: float) -> Plant:
    """The plant with one effect."""
    return CATALOGUE[name].apply(plant, values)


def mass_matrix(plant: Plant) -> Floats:
    """Rigid body and added mass."""
    p = plant
    return np.array([
        [p.mass_kg - p.Xud, 0.0, 0.0],
        [0.0, p.mass_kg - p.Yvd, -p.Yrd],
        [0.0, -p.Yrd, p.yaw_inertia_kgm2 - p.Nrd],
    ])  # fmt: skip


def acceleration(plant: Plant, motion: Force) -> Floats:
    """u', v', r' at the start of a run, heading north; from the first two tenths of a millisecond."""
    steps_s = 1e-4
    wind = np.tile([radians(FROM_DEG), WIND_MPS], (2, 1))
    states = simulate(plant, [0.0, 0.0, 0.0, *motion], np.tile(ORDER, (2, 1)), wind, steps_s)[:, 3:]
    return np.asarray((4.0 * states[1] - 3.0 * states[0] - states[2]) / (2.0 * steps_s))


def force(plant: Plant, motion: Force) -> Floats:
    """X, Y, N on the ship."""
    return np.asarray(mass_matrix(plant) @ acceleration(plant, motion))


def drift_force(p: Plant, u: float, v: float, r: float) -> Force:
    """Three tenths more."""
    return 0.0, 0.3 * (p.Yuv * u * v + p.Yuuv * u * u * v + p.Yvvv * v**3), 0.0


def drift_moment(p: Plant, u: float, v: float, r: float) -> Force:
    """Three tenths more."""
    return 0.0, 0.0, 0.3 * (p.Nuv * u * v + p.Nuuv * u * u * v + p.Nvvv * v**3)


def turning_force(p: Plant, u: float, v: float, r: float) -> Force:
    """Three tenths more."""
    return 0.0, 0.3 * (p.Yur * u * r + p.Yuur * u * u * r + p.Yrrr * r**3 + p.Y_absr_r * abs(r) * r), 0.0


def turning_drag(p: Plant, u: float, v: float, r: float) -> Force:
    """Three tenths more."""
    return 0.3 * (p.Xrr * r * r + p.Xurr * u * r * r + p.Xrv * r * v + p.Xrvu * r * v * u), 0.0, 0.0


def trim(p: Plant, u: float, v: float, r: float) -> Force:
    """The hull's side force, without its added-mass terms, on an arm of 0.7 m."""
    Y = p.Yuv * u * v + p.Yur * u * r + p.Yuur * u * u * r + p.Yuuv * u * u * v + p.Yvvv * v**3 + p.Yrrr * r**3
    Y += p.Yrrv * r * r * v + p.Yvvr * v * v * r + p.Y_absr_v * abs(r) * v + p.Y_absv_v * abs(v) * v
    Y += p.Y_absr_r * abs(r) * r + p.Y_absv_r * abs(v) * r
    return 0.0, 0.0, 0.7 * Y


def skeg(p: Plant, u: float, v: float, r: float) -> Force:
    """Lift of 3 m2 at the pods at the small angle (v + x r) / u, its slope half pi."""
    lift = -0.5 * p.water_density_kgpm3 * 3.0 * (pi / 2.0) * u**2 * ((v + p.number("port_x_m") * r) / u)
    return 0.0, lift, p.number("port_x_m") * lift


def pods(p: Plant, u: float, v: float, r: float, wake: float, side: float) -> Floats:
    """Both pods' force, axial inflow times (1 - wake), side force times ``side``."""
    total = np.zeros(3)
    places = (
        (p.number("port_x_m"), p.number("port_y_m"), *ORDER[:2]),
        (p.number("starboard_x_m"), p.number("starboard_y_m"), *ORDER[2:4]),
    )
    for x, y, n, angle in places:
        at_u, at_v = u - y * r, v + x * r
        axial = (1.0 - wake) * (at_u * cos(angle) + at_v * sin(angle))
        across = at_v * cos(angle) - at_u * sin(angle)
        D, rho = p.number("propeller_diameter_m"), p.water_density_kgpm3
        thrust = rho * D**4 * p.number("thrust_nn") * n * n + rho * D**3 * p.number("thrust_nu") * n * axial
        thrust += rho * D**2 * p.number("thrust_uu") * axial * abs(axial)
        lateral = p.number("side_nv") * D * n + p.number("side_uv") * abs(axial) + p.number("side_vv") * abs(across)
        lateral *= side * rho * D**2 * across
        X, Y = thrust * cos(angle) - lateral * sin(angle), thrust * sin(angle) + lateral * cos(angle)
        total += (X, Y, x * Y - y * X)
    return total


def low_speed_damping(p: Plant, u: float, v: float, r: float) -> Force:
    """A fiftieth of surge and sway and a tenth of the yaw rate a second, while the square of the speed is small."""
    left = exp(-5.0 * (u * u + v * v))
    masses = np.diag(mass_matrix(p))
    return -left * 0.02 * masses[0] * u, -left * 0.02 * masses[1] * v, -left * 0.1 * masses[2] * r


def wake_fraction(p: Plant, u: float, v: float, r: float) -> Floats:
    """A fifth slower."""
    return pods(p, u, v, r, 0.2, 1.0) - pods(p, u, v, r, 0.0, 1.0)


def pod_side_force(p: Plant, u: float, v: float, r: float) -> Floats:
    """Three tenths more."""
    return pods(p, u, v, r, 0.0, 1.3) - pods(p, u, v, r, 0.0, 1.0)


def tunnel_thrust_loss(p: Plant, u: float, v: float, r: float) -> Force:
    """A quarter of the side force is missing."""
    n = ORDER[4]
    lost = -0.25 * (
        p.number("tunnel_cubic_n") * n**3 + p.number("tunnel_quadratic_n") * n * n + p.number("tunnel_linear_n") * n
    )
    return 0.0, lost, p.number("tunnel_x_m") * lost


def sway_asymmetry(p: Plant, u: float, v: float, r: float) -> Force:
    """2 kN to starboard."""
    return 0.0, 2e3, 0.0


def wind(p: Plant, u: float, v: float, speed_mps: float = WIND_MPS) -> Floats:
    """All of the wind's force at heading north."""
    along = u + speed_mps * cos(radians(FROM_DEG))
    across = v + speed_mps * sin(radians(FROM_DEG))
    off_bow_deg, side = degrees(atan2(abs(across), along)), -1.0 if across > 0.0 else 1.0
    points = np.arange(0.0, 181.0, 10.0)
    pressure = 0.5 * p.air_density_kgpm3 * (along**2 + across**2)
    coefficients = [float(np.interp(off_bow_deg, points, table)) for table in (p.CX, p.CY, p.CN)]
    areas = np.array([p.frontal_area_m2, side * p.lateral_area_m2, side * p.lateral_area_m2 * p.length_overall_m])
    return np.asarray(pressure * areas * coefficients)


def wind_drag(p: Plant, u: float, v: float, r: float) -> Floats:
    """Three tenths more along the ship."""
    return wind(p, u, v) * [0.3, 0.0, 0.0]


def wind_side_load(p: Plant, u: float, v: float, r: float) -> Floats:
    """Three tenths more across the ship."""
    return wind(p, u, v) * [0.0, 0.3, 0.0]


def wind_yaw_load(p: Plant, u: float, v: float, r: float) -> Floats:
    """Three tenths more in yaw."""
    return wind(p, u, v) * [0.0, 0.0, 0.3]


def wind_speed_scale(p: Plant, u: float, v: float, r: float) -> Floats:
    """What is reported is a quarter too much."""
    return wind(p, u, v, WIND_MPS / 1.25) - wind(p, u, v)


@pytest.mark.parametrize(("added", "values"), [
    (drift_force, {"factor": 1.3}),
    (drift_moment, {"factor": 1.3}),
    (turning_force, {"factor": 1.3}),
    (turning_drag, {"factor": 1.3}),
    (trim, {"shift_m": 0.7}),
    (skeg, {"area_m2": 3.0}),
    (wake_fraction, {"fraction": 0.2}),
    (pod_side_force, {"factor": 1.3}),
    (tunnel_thrust_loss, {"fraction": 0.25}),
    (sway_asymmetry, {"force_n": 2e3}),
    (wind_drag, {"factor": 1.3}),
    (wind_side_load, {"factor": 1.3}),
    (wind_yaw_load, {"factor": 1.3}),
    (wind_speed_scale, {"factor": 1.25}),
], ids=lambda each: getattr(each, "__name__", ""))  # fmt: skip
@pytest.mark.parametrize("motion", MOTIONS)
def test_forces_are_those_of_the_formula(
    added: Callable[..., Force], values: dict[str, float], motion: Force, plant: Plant
) -> None:
    """The force with the effect less that without is what the line of physics says."""
    difference = force(with_effect(plant, added.__name__, **values), motion) - force(plant, motion)
    assert difference == pytest.approx(np.array(added(plant, *motion)), rel=2e-4, abs=1.0)


@pytest.mark.parametrize("motion", [(0.2, 0.1, 0.004), (-0.3, 0.2, -0.01), (1.2, 0.0, 0.02)])
def test_damping_near_rest_is_in_proportion_and_fades(motion: Force, plant: Plant) -> None:
    rates = {"surge_ps": 0.02, "sway_ps": 0.02, "yaw_ps": 0.1}
    difference = force(with_effect(plant, "low_speed_damping", **rates), motion) - force(plant, motion)
    assert difference == pytest.approx(np.array(low_speed_damping(plant, *motion)), rel=1e-3, abs=1.0)


@pytest.mark.parametrize("vessel", ["gunnerus_short", "kvlcc2_7m", "esso_osaka_3m"])
@pytest.mark.parametrize(("axis", "speed"), [(0, 1e-4), (1, 1e-4), (2, 1e-6)])
def test_a_ship_that_drifts_ever_so_slowly_comes_to_rest_as_her_time_constants_say(
    vessel: str, axis: int, speed: float
) -> None:
    """The exponential of the matrix of damping over inertia; what goes with the square of the speed is nothing."""
    bare = bare_plant(load_vessel(vessel))
    rates = np.array([0.05, 0.03, 0.08])
    names = ("surge_ps", "sway_ps", "yaw_ps")
    damped = CATALOGUE["low_speed_damping"].apply(bare, dict(zip(names, rates, strict=True)))
    start = np.zeros(6)
    start[3 + axis] = speed
    controls = sum(len(KINDS[each.kind].units) for each in bare.layout)
    states = simulate(damped, start, np.zeros((60, controls)), np.zeros((60, 2)), 1.0)[:, 3:]
    M, m, x_G = mass_matrix(bare), bare.mass_kg, bare.centre_of_gravity_m
    M[2, 2] += m * x_G**2
    M[1:, 1:] += [[0.0, m * x_G], [m * x_G, 0.0]]
    times = np.arange(61.0)
    expected = [expm(-t * np.linalg.solve(M, np.diag(rates * np.diag(M)))) @ start[3:] for t in times]
    assert states == pytest.approx(np.array(expected), rel=1e-2, abs=2e-3 * speed)
    if axis == 0:
        assert states[20, 0] == pytest.approx(speed * exp(-1.0), rel=2e-3)


@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("name", ["surge_added_mass", "sway_added_mass", "yaw_inertia"])
def test_inertia_changes_the_mass_and_its_coriolis_terms(name: str, motion: Force, plant: Plant) -> None:
    """Added mass acts in the matrix and in the terms that it has in a turning frame; yaw inertia has none there."""
    u, v, r = motion
    changed = with_effect(plant, name, factor=1.4)
    X, Y, N = force(plant, motion)
    M = mass_matrix(plant)
    if name == "surge_added_mass":
        more = 0.4 * plant.Xud
        M[0, 0] -= more
        Y, N = Y + more * u * r, N - more * u * v
    elif name == "sway_added_mass":
        more = 0.4 * plant.Yvd
        M[1, 1] -= more
        X, N = X - more * v * r, N + more * u * v
    else:
        M[2, 2] *= 1.4
    assert acceleration(changed, motion) == pytest.approx(np.linalg.solve(M, [X, Y, N]), rel=1e-5, abs=1e-9)


def test_added_mass_alone_does_no_work(plant: Plant) -> None:
    """Its Coriolis terms turn energy from one motion into another and make none, as before."""
    for name in ("surge_added_mass", "sway_added_mass"):
        for motion in MOTIONS:
            p = with_effect(plant, name, factor=1.4)
            u, v, r = motion
            coriolis = (-p.Yvd * v * r - p.Yrd * r * r, p.Xud * u * r, (p.Yvd - p.Xud) * u * v + p.Yrd * u * r)
            assert np.dot(coriolis, motion) == pytest.approx(0.0, abs=1e-6)


def test_azimuth_scale_points_the_pods_further_either_way(plant: Plant, held: Held) -> None:
    """True angle = factor x reported; a whole turn more in the report is the same angle."""
    more = with_effect(plant, "azimuth_scale", factor=1.2)
    for reported in (20.0, -20.0, 20.0 - 360.0, 360.0 - 20.0, 720.0 + 20.0):
        true = 24.0 if reported in (20.0, -340.0, 740.0) else -24.0
        run = held(more, angle_deg=(reported, reported))
        assert run == pytest.approx(held(plant, angle_deg=(true, true)), abs=1e-9)
    with_offset = with_effect(more, "azimuth_offset_both", angle_deg=2.0)
    pointed = held(plant, angle_deg=(14.0, 14.0))
    assert held(with_offset, angle_deg=(10.0, 10.0)) == pytest.approx(pointed, abs=1e-9)


@pytest.mark.parametrize("exponent", [2.3, 1.7, 0.7])
@pytest.mark.parametrize("slenderness", [0.08, 0.12, 0.18])
def test_a_bottom_only_adds_and_meets_the_published_form(slenderness: float, exponent: float) -> None:
    """Growth with draught over depth is monotone, flat in deep water, 2/k at the bottom, near Hirano's between."""
    ratios = np.linspace(0.0, 0.999, 400)
    growth = np.array([aspect_growth(ratio, slenderness, exponent) for ratio in ratios])
    assert growth[0] == 1.0
    assert (np.diff(growth) > 0.0).all()
    assert aspect_growth(1.0 - 1e-9, slenderness, exponent) == pytest.approx(2.0 / slenderness, rel=1e-3)
    assert (aspect_growth(0.02, slenderness, exponent) - 1.0) / (
        aspect_growth(0.01, slenderness, exponent) - 1.0
    ) == pytest.approx(4.0, rel=1e-2)
    y = 0.5 * pi * ratios[1:360]
    published = 1.0 / (0.5 * slenderness * ratios[1:360] + (y / np.tan(y)) ** exponent)
    assert growth[1:360] == pytest.approx(published, rel=0.06)


def test_a_ship_aground_is_refused(plant: Plant) -> None:
    """Water no deeper than the draught has no forces that this model knows."""
    deep = plant.replaced(draught_m=6.0)
    with pytest.raises(ConfigurationError, match="draught"):
        with_effect(deep, "shallow_water", depth_m=5.0)


@pytest.mark.parametrize("motion", MOTIONS)
def test_a_steady_wind_that_nobody_recorded_blows_like_one_that_was(plant: Plant, motion: Force) -> None:
    """Towards, where a vane says from."""
    order, steps = np.tile(ORDER, (20, 1)), 1.0
    recorded = np.tile([radians(FROM_DEG), WIND_MPS], (20, 1))
    towards = {"speed_mps": WIND_MPS, "direction_deg": FROM_DEG + 180.0}
    start = [0.0, 0.0, 0.4, *motion]
    blown = simulate(STEADY_WIND.apply(plant, towards), start, order, np.zeros((20, 2)), steps)
    assert blown == pytest.approx(simulate(plant, start, order, recorded, steps), abs=1e-9)
    assert np.abs(blown - simulate(plant, start, order, np.zeros((20, 2)), steps)).max() > 0.1
