"""Numbers of a ship from her main dimensions: against published models, propellers measured, and how they scale."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from seatrial.acquisition.core.errors import InputError
from seatrial.hybrid.vessel.estimate import devices, hull
from seatrial.hybrid.vessel.estimate.devices import pod_coefficients, tunnel_force
from seatrial.hybrid.vessel.estimate.hull import Estimates, MainParticulars, describe_extrapolation

KVLCC2 = MainParticulars(
    length_m=7.0, beam_m=1.27, draught_m=0.46, block=3.27 / (7.0 * 1.27 * 0.46), service_speed_mps=1.179,
    water_density_kgpm3=1000.0,
)  # fmt: skip
ESSO_OSAKA = MainParticulars(
    length_m=3.0, beam_m=0.48925, draught_m=0.20114, block=0.27078 / 2.0 * 3.0 / 0.48925, service_speed_mps=0.6,
    water_density_kgpm3=998.0,
)  # fmt: skip
HOLTROPS_EXAMPLE = MainParticulars(
    length_m=205.0, beam_m=32.0, draught_m=10.0, block=37500.0 / (205.0 * 32.0 * 10.0),
    service_speed_mps=25.0 * 0.514444, centre_of_gravity_m=-0.0075 * 205.0,
)  # fmt: skip
"""The container ship that Holtrop and Mennen (1982) work through."""

PUBLISHED_KVLCC2 = {
    "m_y": 0.223, "J_z": 0.011, "m_x": 0.022, "x_G": 0.25 / 7.0, "R_0": 0.022,
    "X_vv": -0.040, "X_vr": 0.002, "X_rr": 0.011, "X_vvvv": 0.771,
    "Y_v": -0.315, "Y_r": 0.083, "Y_vvv": -1.607, "Y_vvr": 0.379, "Y_vrr": -0.391, "Y_rrr": 0.008,
    "N_v": -0.137, "N_r": -0.049, "N_vvv": -0.030, "N_vvr": -0.294, "N_vrr": 0.055, "N_rrr": -0.013,
    "w": 0.40, "t": 0.22, "t_R": 0.387, "a_H": 0.312, "x_H": -0.464, "flow_straightening": 0.5175, "l_R": -0.710,
    "eps": 1.09, "kappa": 0.50, "k_0": 0.2931, "k_1": -0.2753, "k_2": -0.1385,
}  # fmt: skip
"""Yasukawa and Yoshimura 2015; the mean of the two flow straightening coefficients."""

PUBLISHED_ESSO_OSAKA = {
    "m_y": 0.2579, "x_G": 0.03119, "X_0F": -0.02139, "X_0A": -0.03189, "X_vr": -0.0081,
    "Y_v": -0.3728, "Y_r": 0.116, "C_D": 0.9665, "C_rY": 2.217, "N_v": -0.1458, "N_r": -0.04849, "C_rN": 0.8097,
    "w": 0.386, "t": 0.22, "t_R": 0.19, "a_H": 0.393, "x_H": -0.45, "flow_straightening": 0.3956, "l_R": -1.08,
    "eps": 1.42, "kappa": 0.288 / 1.42, "k_0": 0.3278, "k_1": -0.3323, "k_2": -0.156,
}  # fmt: skip
"""Miyauchi et al. 2022."""


def all_estimates(ship: MainParticulars, diameter_m: float, blades: tuple[float, float, int]) -> Estimates:
    """Every number that a regression gives of a single-screw ship."""
    R_0, w = hull.resistance_coefficient(ship), hull.wake_fraction(ship, diameter_m)
    return {
        **hull.estimate_inertia(ship),
        **hull.mmg_coefficients(ship, R_0),
        **hull.cross_flow_coefficients(ship, R_0),
        "w": w,
        "t": hull.thrust_deduction(ship, diameter_m),
        **devices.rudder_interaction_coefficients(ship, w.value),
        **devices.open_water_coefficients(*blades, error_factor=1.0),
    }


SHIPS = {
    "kvlcc2": (all_estimates(KVLCC2, 0.216, (0.721, 0.431, 4)), PUBLISHED_KVLCC2),
    "esso_osaka": (all_estimates(ESSO_OSAKA, 0.084, (0.7151, 0.682, 5)), PUBLISHED_ESSO_OSAKA),
}


@pytest.mark.parametrize("ship", SHIPS)
def test_published_numbers_lie_within_the_usual_errors(ship: str) -> None:
    """Within 2.5 standard deviations each, and all together neither far better nor worse than said."""
    estimates, published = SHIPS[ship]
    z = {
        name: (value - estimates[name].value) / (estimates[name].error * abs(estimates[name].value))
        for name, value in published.items()
    }
    assert max(map(abs, z.values())) < 2.5, z
    assert 0.4 < np.sqrt(np.mean(np.square(list(z.values())))) < 1.2, z


@pytest.mark.parametrize("ship", [KVLCC2, ESSO_OSAKA, HOLTROPS_EXAMPLE], ids=["kvlcc2", "esso_osaka", "container"])
def test_another_regression_says_the_same_within_both_errors(ship: MainParticulars) -> None:
    """Clarke, Gedling and Hine (1983) fitted other model tests, in another form."""
    B_T, B_L, T_L, C_b = (
        ship.beam_m / ship.draught_m,
        ship.beam_m / ship.length_m,
        ship.draught_m / ship.length_m,
        ship.block,
    )
    wing = np.pi * T_L
    clarke = {
        "Y_v": -wing * (1.0 + 0.4 * C_b * B_T),
        "Y_r": -wing * (-0.5 + 2.2 * B_L - 0.08 * B_T),
        "N_v": -wing * (0.5 + 2.4 * T_L),
        "N_r": -wing * (0.25 + 0.039 * B_T - 0.56 * B_L),
        "m_y": wing * (1.0 + 0.16 * C_b * B_T - 5.1 * B_L**2),
        "J_z": wing * (1.0 / 12.0 + 0.017 * C_b * B_T - 0.33 * B_L),
    }
    estimates = {**hull.linear_derivatives(ship), **hull.estimate_inertia(ship)}
    for name, value in clarke.items():
        scatter = estimates[name].error * abs(estimates[name].value)
        assert abs(value - estimates[name].value) < 2.0 * np.sqrt(2.0) * scatter, name


def test_a_ship_of_the_same_form_has_the_same_derivatives() -> None:
    """What is primed depends on the form alone, but for friction, which depends on the scale."""
    scale = 40.0
    full = replace(
        KVLCC2,
        length_m=scale * KVLCC2.length_m,
        beam_m=scale * KVLCC2.beam_m,
        draught_m=scale * KVLCC2.draught_m,
        service_speed_mps=scale**0.5 * KVLCC2.service_speed_mps,
    )
    model_R, full_R = hull.resistance_coefficient(KVLCC2), hull.resistance_coefficient(full)
    assert full_R.value < model_R.value
    model_hull, full_hull = hull.mmg_coefficients(KVLCC2, model_R), hull.mmg_coefficients(full, model_R)
    for name, estimate in full_hull.items():
        assert estimate.value == pytest.approx(model_hull[name].value), name
    assert hull.wave_resistance(full) == pytest.approx(hull.wave_resistance(KVLCC2))


def test_the_quantities_of_holtrops_example(monkeypatch: pytest.MonkeyPatch) -> None:
    """Her form coefficients are known there; she has a bulb of 20 m2 that the estimates leave out."""
    monkeypatch.setattr(hull, "midship_section_coefficient", lambda ship: 0.98)
    monkeypatch.setattr(hull, "waterplane_coefficient", lambda ship: 0.75)
    ship = HOLTROPS_EXAMPLE
    bulb_m2 = 2.38 * 20.0 / ship.block
    assert hull.wetted_area(ship) + bulb_m2 == pytest.approx(7381.45, rel=1e-3)
    assert hull.half_angle_of_entrance_deg(ship) == pytest.approx(12.08, abs=0.02)
    assert hull.form_factor(ship) == pytest.approx(1.156, abs=0.02)
    assert hull.correlation_allowance(ship) == pytest.approx(0.000352, abs=2e-6)
    wave_n = hull.wave_resistance(ship) * 1025.0 * 9.80665 * ship.volume_m3
    assert 0.7595 * wave_n == pytest.approx(557.11e3, rel=0.05)
    assert hull.thrust_deduction(ship, 8.0).value == pytest.approx(0.1747, abs=0.02)


@pytest.mark.parametrize("froude", [0.4, 0.55])
def test_the_wave_resistance_is_continuous_where_its_fits_meet(froude: float) -> None:
    ship = MainParticulars(
        length_m=50.0, beam_m=10.0, draught_m=3.2, block=0.5, service_speed_mps=froude * np.sqrt(9.80665 * 50.0)
    )
    below = replace(ship, service_speed_mps=0.9999 * ship.service_speed_mps)
    above = replace(ship, service_speed_mps=1.0001 * ship.service_speed_mps)
    assert hull.wave_resistance(below) == pytest.approx(hull.wave_resistance(above), rel=5e-3)


@pytest.mark.parametrize("ship", SHIPS)
def test_the_series_has_the_measured_thrust_of_published_propellers(ship: str) -> None:
    """Their open-water curves were measured; neither is a propeller of the series itself."""
    blades = {"kvlcc2": (0.721, 0.431, 4), "esso_osaka": (0.7151, 0.682, 5)}[ship]
    published = SHIPS[ship][1]
    J = np.linspace(0.0, 0.6, 7)
    measured = published["k_0"] + published["k_1"] * J + published["k_2"] * J * J
    np.testing.assert_allclose(devices.thrust_coefficient(J, *blades), measured, atol=0.022)


@pytest.mark.parametrize("pitch_ratio", [0.5, 0.8, 1.0, 1.2, 1.4])
def test_thrust_ends_where_a_turn_advances_a_little_more_than_the_pitch(pitch_ratio: float) -> None:
    """As on every diagram of the series: the blades' camber adds some to the pitch of their faces."""
    J = np.linspace(0.0, 2.0, 401)
    thrust = devices.thrust_coefficient(J, pitch_ratio, 0.55, 4)
    zero = J[np.argmax(thrust < 0.0)]
    assert 1.04 < zero / pitch_ratio < 1.16


@pytest.mark.parametrize(("pitch_ratio", "area_ratio", "blades"), [(0.6, 0.4, 3), (0.8, 0.55, 4), (1.2, 0.9, 6)])
def test_the_quadratic_follows_the_series(pitch_ratio: float, area_ratio: float, blades: int) -> None:
    J = np.linspace(0.0, 0.8 * pitch_ratio, 50)
    k_0, k_1, k_2 = devices.fit_thrust_quadratic(pitch_ratio, area_ratio, blades)
    series = devices.thrust_coefficient(J, pitch_ratio, area_ratio, blades)
    np.testing.assert_allclose(k_0 + k_1 * J + k_2 * J * J, series, atol=0.012)


def test_more_pitch_gives_more_thrust() -> None:
    thrusts = [
        devices.thrust_coefficient(np.array([0.5]), ratio, 0.55, 4)[0] for ratio in np.linspace(0.5, 1.4, 10)
    ]
    assert np.all(np.diff(thrusts) > 0.0)


def test_the_service_shaft_speed_gives_the_thrust_asked_for() -> None:
    k = devices.fit_thrust_quadratic(0.8, 0.55, 4)
    thrust_n, V, D, rho = 5e5, 6.0, 5.0, 1025.0
    n = devices.service_rps(thrust_n, V, D, k, rho)
    J = V / (n * D)
    assert rho * n**2 * D**4 * (k[0] + k[1] * J + k[2] * J * J) == pytest.approx(thrust_n)


def test_the_pitch_that_fits_a_shaft_speed_is_found_again() -> None:
    J, pitch_ratio = 0.55, 0.93
    thrust = float(devices.thrust_coefficient(np.array([J]), pitch_ratio, 0.6, 4)[0])
    assert devices.pitch_ratio_of_thrust(thrust, J, 0.6, 4) == pytest.approx(pitch_ratio, abs=0.006)


def test_rudders_have_the_size_of_published_ones() -> None:
    for ship, area_m2, span_m in ((KVLCC2, 0.0539, 0.345), (ESSO_OSAKA, 0.01063, 0.1279)):
        usual = devices.usual_rudder_area(ship)
        assert usual.value == pytest.approx(area_m2, rel=2.0 * usual.error)
        assert devices.normal_force_slope(span_m**2 / area_m2) == pytest.approx(2.747, rel=0.12)


def test_a_pod_thrusts_what_a_propeller_behind_the_same_hull_does() -> None:
    ship = replace(HOLTROPS_EXAMPLE, screws=2)
    w, t = hull.wake_fraction(ship, 5.0), hull.thrust_deduction(ship, 5.0)
    n, u, D = 2.0, 9.0, 5.0
    k_0, k_1, k_2 = devices.fit_thrust_quadratic(1.0, 0.55, 4)
    J = (1.0 - w.value) * u / (n * D)
    thrust = (1.0 - t.value) * n**2 * D**4 * (k_0 + k_1 * J + k_2 * J * J)
    c = {name: each.value for name, each in pod_coefficients(1.0, 0.55, 4, 1.0, w, t).items()}
    along = D**2 * (c["thrust_nn"] * D**2 * n * n + c["thrust_nu"] * D * n * u + c["thrust_uu"] * u * u)
    assert along == pytest.approx(thrust)


def test_a_tunnel_thruster_of_2_m_and_900_kw_pushes_some_130_kn() -> None:
    """As makers' lists have it: 0.14 to 0.16 kN for each kW."""
    assert 115e3 < tunnel_force(2.0, 900.0).value < 145e3


def test_a_ship_of_the_database_is_inside_and_others_are_named() -> None:
    assert describe_extrapolation(KVLCC2) == []
    ferry = MainParticulars(length_m=20.0, beam_m=8.0, draught_m=1.2, block=0.45, service_speed_mps=6.0)
    notes = describe_extrapolation(ferry)
    assert len(notes) == 6
    assert "block coefficient 0.45 is outside 0.5 to 0.86" in notes[0]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"block": 1.2}, "block coefficient is 1.2"),
        ({"length_m": 7000.0}, "length is 7000 m"),
        ({"beam_m": 15.0}, "length by beam"),
        ({"draught_m": 2.0}, "beam by draught"),
        ({"service_speed_mps": 15.0}, "Froude number"),
        ({"block": float("nan")}, "block coefficient is nan"),
    ],
)
def test_what_no_ship_has_is_refused(change: dict[str, float], words: str) -> None:
    with pytest.raises(InputError, match=words):
        replace(KVLCC2, **change)


def test_a_propeller_outside_the_series_is_refused() -> None:
    with pytest.raises(InputError, match=r"pitch ratio is 2.*0\.5 to 1\.4"):
        devices.fit_thrust_quadratic(2.0, 0.55, 4)
