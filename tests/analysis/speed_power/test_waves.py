"""STAWAVE-1 and -2 against their equations written another way; when each is used, and when refused."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.special import iv, kv

from seatrial.acquisition.config.run_sheet import Conditions
from seatrial.acquisition.core.quantities import GRAVITY_MPS2, Floats
from seatrial.analysis.speed_power.formulas import (
    WAVE_METHODS,
    Correction,
    RunSeas,
    corrections_of,
    from_ahead,
    regular_waves_n,
    stawave1_n,
    stawave2_n,
    wave_resistance_n,
)
from seatrial.analysis.speed_power.runs import PowerRun

SHIP = Conditions(
    length_m=180.0, beam_m=32.0, draught_m=11.0, displacement_m3=48_000.0, bow_length_m=40.0,
    propulsive_efficiency=0.7, wave_height_m=1.5, wave_from_deg=350.0,
)  # fmt: skip


def by_the_book(omega: float, speed: float) -> float:
    """R_AW / zeta_A^2 of STAWAVE-2, number by number as the standard writes it."""
    block, froude = 48_000.0 / (180.0 * 32.0 * 11.0), speed / (9.80665 * 180.0) ** 0.5
    bar = (180.0 / 9.80665) ** 0.5 * 0.25 ** (1.0 / 3.0) / (1.17 * froude**-0.143) * omega
    b, d = (11.0, 14.0) if bar < 1.0 else (-8.5, -566.0 * (180.0 / 32.0) ** -2.66)
    raw = bar**b * np.exp(b / d * (1.0 - bar**d)) * 60.3 * block**1.34 * froude**1.5 * np.exp(-3.5 * froude)
    x = 1.5 * omega**2 / 9.80665 * 11.0
    f = 0.692 * (speed / (11.0 * 9.80665) ** 0.5) ** 0.769 + 1.81 * block**6.95
    alpha = np.pi**2 * iv(1, x) ** 2 / (np.pi**2 * iv(1, x) ** 2 + kv(1, x) ** 2) * f
    rho_g = 1026.0 * 9.80665
    return float(4.0 * rho_g * 32.0**2 / 180.0 * raw + 0.5 * rho_g * 32.0 * alpha)


def test_stawave_1_of_a_wave_by_hand() -> None:
    """(1/16) rho g H^2 B sqrt(B / L_BWL): 1.5 m on 32 m of beam, 40 m of bow: 40.50 kN."""
    assert stawave1_n(SHIP, np.array([1.5]))[0] == pytest.approx(40_498.0, rel=1e-4)


@pytest.mark.parametrize("omega", [0.3, 0.5, 0.62, 0.8, 1.2, 2.0])
def test_stawave_2_in_regular_waves_is_that_of_the_standard(omega: float) -> None:
    found = regular_waves_n(SHIP, np.array([[omega]]), np.array([[7.5]]))[0, 0]
    assert found == pytest.approx(by_the_book(omega, 7.5), rel=1e-9)


@pytest.mark.parametrize(("height", "period", "speed"), [(1.5, 5.0, 7.5), (2.5, 8.0, 6.5), (0.6, 3.5, 9.0)])
def test_stawave_2_in_irregular_waves_is_the_integral_over_the_spectrum(
    height: float, period: float, speed: float
) -> None:
    def density(omega: float) -> float:
        fourth = period**4
        return 173.0 * height**2 / fourth / omega**5 * float(np.exp(-691.0 / fourth / omega**4))

    whole = 2.0 * quad(lambda omega: by_the_book(omega, speed) * density(omega), 0.15, 6.0, limit=400)[0]
    found = stawave2_n(SHIP, *(np.array([value]) for value in (height, period, speed)))[0]
    assert found == pytest.approx(whole, rel=0.02)


def test_short_waves_are_all_reflected() -> None:
    """rho g B f_1 / 2 a square metre of amplitude: nothing passes under the ship, and it does not move."""
    f = 0.692 * (7.5 / np.sqrt(11.0 * GRAVITY_MPS2)) ** 0.769 + 1.81 * (48_000.0 / (180.0 * 32.0 * 11.0)) ** 6.95
    found = regular_waves_n(SHIP, np.array([[8.0]]), np.array([[7.5]]))[0, 0]
    assert found == pytest.approx(0.5 * 1026.0 * GRAVITY_MPS2 * 32.0 * f, rel=1e-6)


@given(st.floats(0.1, 3.0), st.floats(3.0, 9.0), st.floats(4.5, 12.0))
def test_added_resistance_grows_with_the_square_of_the_height(height: float, period: float, speed: float) -> None:
    one, two = (stawave2_n(SHIP, *map(np.atleast_1d, (factor * height, period, speed)))[0] for factor in (1.0, 2.0))
    assert 0.0 < one < np.inf
    assert two == pytest.approx(4.0 * one)


def sea(*wave_from_deg: float, height: float = 1.5, period: float = 5.0) -> RunSeas:
    count = len(wave_from_deg)
    return RunSeas(np.full(count, height), np.full(count, period), np.array(wave_from_deg), np.full(count, 500.0))


@pytest.mark.parametrize("method", WAVE_METHODS)
def test_waves_count_within_45_deg_of_the_bow_only(method: str) -> None:
    heading = np.array([0.0, 34.0, 36.0, 180.0])
    found = wave_resistance_n(SHIP, heading, np.full(4, 7.5), sea(350.0, 350.0, 350.0, 350.0), method)
    assert found[0] == found[1] > 0.0
    assert list(found[2:]) == [0.0, 0.0]


@given(st.floats(-720.0, 720.0), st.floats(0.0, 360.0))
def test_the_sector_of_the_bow_turns_with_the_ship(turn: float, heading: float) -> None:
    headings, waves = np.array([heading, heading]), np.array([heading + 40.0, heading - 50.0])
    assert list(from_ahead(headings + turn, waves + turn)) == [True, False]


def run(heading: float, speed: float = 7.5, **values: float) -> PowerRun:
    start = datetime(2026, 5, 1, 6, tzinfo=UTC)
    return PowerRun(
        start, start + timedelta(minutes=10), heading, speed, 0.0, 6000.0, 0.0, 90.0, 0.0, 5.0, **values  # type: ignore[arg-type]
    )  # fmt: skip


def waves_of(given_conditions: Conditions, *runs: PowerRun) -> Correction:
    return next(each for each in corrections_of(given_conditions, runs) if each.name == "waves")


def test_stawave_2_is_used_where_the_period_is_known_and_the_ship_is_in_its_range() -> None:
    runs = run(0.0), run(180.0)
    assert waves_of(replace(SHIP, wave_period_s=5.0), *runs).method.startswith("STAWAVE-2")
    assert waves_of(SHIP, *runs).method.startswith("STAWAVE-1")
    slow = waves_of(replace(SHIP, wave_period_s=5.0), run(0.0, 3.0), run(180.0, 3.0)).method
    assert slow.startswith("STAWAVE-1")
    assert "Fr of 0.0714 is not 0.1 to 0.3" in slow


@pytest.mark.parametrize(
    ("conditions", "why"),
    [
        ({"wave_height_m": None}, "not known: wave_height_m"),
        ({"wave_from_deg": 90.0}, "refused: no run had waves within 45 deg of the bow"),
        ({"wave_height_m": 3.5}, "refused: waves of 3.5 m, STAWAVE-1 is for 3.0 m at most"),
        ({"bow_length_m": None}, "not known: bow_length_m for STAWAVE-1"),
        ({"propulsive_efficiency": None}, "not known: propulsive_efficiency"),
        ({"wave_height_m": 0.0}, "not needed: no waves"),
    ],
)
def test_a_sea_that_the_formulas_are_not_for_is_refused(conditions: dict[str, float | None], why: str) -> None:
    correction = waves_of(replace(SHIP, **conditions), run(0.0), run(180.0))  # type: ignore[arg-type]
    assert not correction.applied
    assert why in correction.method


def test_waves_of_a_run_stand_above_those_of_the_day() -> None:
    quiet = waves_of(SHIP, run(0.0, wave_height_m=0.0), run(180.0, wave_height_m=0.0))
    assert quiet.method == "not needed: no waves"


def test_froude_numbers_of_any_shape_broadcast() -> None:
    omega: Floats = np.linspace(0.3, 2.0, 6).reshape(2, 3)
    assert regular_waves_n(SHIP, omega, np.array([[6.0], [8.0]])).shape == (2, 3)
