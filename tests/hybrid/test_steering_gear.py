"""The steering gear from order and feedback: what it was made with is found, and nothing where it is not shown."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from seatrial.acquisition.core.quantities import Floats
from seatrial.hybrid.identification.steering_gear import fit_gear
from seatrial.hybrid.simulation.manoeuvres import follow_with_band
from seatrial.hybrid.vessel.files import load_vessel

STEP_S, RECORD = 0.01, 20  # the grid of the gear, and its steps from one record to the next


def recorded(rate_dps: float, lag_s: float, band_deg: float, noise_deg: float = 0.05) -> pd.DataFrame:
    """Orders of all sizes every ten seconds, and the feedback of a gear with noise."""
    generator = np.random.default_rng(3)
    orders: Floats = np.repeat(generator.uniform(-35.0, 35.0, 40), 1000)
    feedback = follow_with_band(orders, 0.0, rate_dps, lag_s, band_deg, STEP_S)[::RECORD]
    index = pd.date_range("2026-06-01", periods=len(feedback), freq="200ms", tz="UTC", name="time")
    noisy = feedback + noise_deg * generator.standard_normal(len(feedback))
    return pd.DataFrame({"rudder_order_angle_deg": orders[::RECORD], "rudder_angle_deg": noisy}, index=index)


@pytest.mark.parametrize(("rate_dps", "lag_s", "band_deg"), [(15.8, 0.4, 0.0), (5.0, 1.0, 1.5)])
def test_rate_lag_and_dead_band_are_those_of_the_gear(rate_dps: float, lag_s: float, band_deg: float) -> None:
    ship = load_vessel("kvlcc2_7m")
    vessel, (gear,) = fit_gear({"trial": recorded(rate_dps, lag_s, band_deg)}, ship)
    assert gear.rate_dps.value == pytest.approx(rate_dps, rel=0.03)
    assert gear.lag_s.value == pytest.approx(lag_s, rel=0.1, abs=0.03)
    assert gear.dead_band_deg.value == pytest.approx(band_deg, abs=0.15)
    (rudder,) = vessel.of_kind("rudder")
    assert (rudder.rate_limit_dps, rudder.lag_s) == (gear.rate_dps.value, gear.lag_s.value)


def test_a_gear_that_was_not_ordered_about_stays_as_it_is() -> None:
    ship = load_vessel("kvlcc2_7m")
    table = recorded(15.8, 0.4, 0.0)
    for still in (table.assign(rudder_order_angle_deg=0.0), table.drop(columns="rudder_order_angle_deg")):
        assert fit_gear({"trial": still}, ship) == (ship, ())
