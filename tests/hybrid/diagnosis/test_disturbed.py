"""One second of the disturbed ship against matrix exponentials and stationarity."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seatrial.acquisition.core.quantities import Floats
from seatrial.analysis.estimation.kalman_kernel import WIDTH, predict_covariance, projected_variance
from seatrial.hybrid.diagnosis.disturbance_model import (
    CALM,
    FORCE_UNITS,
    FREE,
    SWING,
    DisturbanceNoise,
    fill_transition,
    initial_covariance,
    measurement_rows,
    states_of,
)
from seatrial.hybrid.diagnosis.linearise import LinearModel
from tests.hybrid.diagnosis.linear_by_hand import CALM_SEA, DISTURBANCES, DRIFT, SLOW_DRIFT, SWELL, a_ship, dense


def second(linear: LinearModel, noise: DisturbanceNoise, k: int) -> tuple[Floats, Floats]:
    """Transition and what is new."""
    F, Q = room(noise), room(noise)
    fill_transition(linear.A[k], linear.B[k] * FORCE_UNITS, noise.as_array(), linear.origin[k], F, Q)
    return F, Q


def room(noise: DisturbanceNoise) -> Floats:
    """A matrix as the filter holds it, zeros behind the states' columns."""
    return np.zeros((states_of(noise.as_array()), WIDTH))


def start(linear: LinearModel, noise: DisturbanceNoise, k: int) -> Floats:
    """Covariance of a block's first state."""
    P = room(noise)
    initial_covariance(noise.as_array(), linear.origin[k], FREE, P)
    return P


def test_a_calm_sea_needs_no_swing() -> None:
    assert states_of(CALM_SEA.as_array()) == CALM
    assert states_of(SWELL.as_array()) == CALM + SWING
    assert states_of(replace(CALM_SEA, waves=(0.0, 0.0, 0.01)).as_array()) == CALM + SWING
    assert states_of(replace(SWELL, drift=DRIFT.drift).as_array()) == CALM + SWING + 6
    assert states_of(SLOW_DRIFT.as_array()) == CALM + SWING + 1


@pytest.mark.parametrize("noise", DISTURBANCES.values(), ids=DISTURBANCES)
def test_two_seconds_are_those_of_the_exact_processes(noise: DisturbanceNoise) -> None:
    linear = a_ship(3, 21)
    n = states_of(noise.as_array())
    by_hand = dense(linear, noise, slice(0, 2))
    F, Q = second(linear, noise, 0)
    P = start(linear, noise, 0)
    np.testing.assert_allclose(P[:, :n], by_hand.covariance[:n, :n], rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose(F[:, :n], by_hand.onward[n:, :n], rtol=1e-9, atol=1e-12)
    predict_covariance(F, Q, P, room(noise))
    np.testing.assert_allclose(P[:, :n], by_hand.covariance[n:, n:], rtol=1e-9, atol=1e-12)
    assert not P[:, n:].any()


@settings(max_examples=60, deadline=None)
@given(
    st.tuples(*[st.floats(0.0, 2.0)] * 2, st.floats(1e-4, 0.05)),
    st.floats(-0.99, 0.99),
    st.floats(0.5, 2.6),
    st.floats(0.02, 0.7),
    st.floats(-4.0, 4.0),
)
def test_what_is_new_is_a_covariance_and_the_swing_is_stationary(
    waves: tuple[float, float, float], correlation: float, frequency: float, damping: float, towards: float
) -> None:
    noise = DisturbanceNoise(
        waves=waves, wave_correlation=correlation, wave_frequency_radps=frequency, wave_damping=damping,
        wave_towards_rad=towards,
    )  # fmt: skip
    linear = a_ship(1, 22)
    F, Q = second(linear, noise, 0)
    P = start(linear, noise, 0)
    swing = slice(CALM, CALM + SWING)
    new = Q[:, : len(Q)]
    np.testing.assert_allclose(new, new.T, atol=1e-14)
    assert np.linalg.eigvalsh(new).min() > -1e-12
    predict_covariance(F, Q, P, room(noise))
    begun = start(linear, noise, 0)
    for part in (slice(6, 9), swing):
        np.testing.assert_allclose(P[part, part], begun[part, part], rtol=1e-9, atol=1e-13)


def test_a_following_sea_is_met_slowly_and_a_head_sea_fast() -> None:
    """Seen from a ship at speed, waves from astern swing her more slowly than waves from ahead."""
    linear = a_ship(1, 23)

    def swing_rate(towards: float) -> float:
        P = start(linear, replace(SWELL, wave_towards_rad=towards), 0)
        return float(np.sqrt(P[10, 10] / P[9, 9]))

    psi, speed = linear.origin[0, 2], linear.origin[0, 3]
    w = SWELL.wave_frequency_radps
    along, against = swing_rate(psi), swing_rate(psi + np.pi)
    assert along < w < against
    assert against - along == pytest.approx(2.0 * w**2 / 9.80665 * speed, rel=1e-6)


@pytest.mark.parametrize("noise", DISTURBANCES.values(), ids=DISTURBANCES)
def test_each_channel_sees_the_states_as_the_sensors_move(noise: DisturbanceNoise) -> None:
    linear = a_ship(1, 24)
    n = states_of(noise.as_array())
    C = dense(linear, noise, slice(0, 1)).C
    P, rows, Ph = start(linear, noise, 0), np.ones((6, n)), np.zeros(WIDTH)
    square = P[:, :n]
    measurement_rows(linear.H[0], linear.origin[0], noise.as_array(), rows)
    for channel, h in enumerate(rows):
        np.testing.assert_allclose(h, C[channel], atol=1e-8)
        assert projected_variance(P, h, Ph) == pytest.approx(float(h @ square @ h), rel=1e-12)
        np.testing.assert_allclose(Ph[:n], square @ h, rtol=1e-12, atol=1e-15)
