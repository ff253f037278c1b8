"""The acceleration that a model lacks: none on itself, and what was taken away from it where it was."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hybrid.effects.catalogue import vessel_plant
from hybrid.reporting.residuals import LEAST_S, PLANES, Residuals, cells_of, edges_of, modelled_acceleration
from hybrid.truth.trial import simulate_trial
from hybrid.vessel.channels import controls_of, states_of, wind_of
from hybrid.vessel.files import load_vessel
from hybrid.vessel.plant import Plant
from hybrid.vessel.simulate import simulate_batch


@pytest.fixture(scope="module")
def voyage() -> pd.DataFrame:
    return simulate_trial("gunnerus_short", "calm", "paper", 120.0, 1.0, 5)[0]


def test_the_models_acceleration_is_the_slope_of_what_it_simulates(voyage: pd.DataFrame) -> None:
    """A tenth of a second by its own integrator, halved: the slope at the start, to first order."""
    plant = vessel_plant(load_vessel("gunnerus_short"))
    states, controls, wind = states_of(voyage), controls_of(voyage), wind_of(voyage)
    found = modelled_acceleration(plant, states, controls, wind)
    later = [
        simulate_batch(plant, states, controls[:, None], wind[:, None], dt, 1).states[:, 1, 3:] for dt in (0.1, 0.2)
    ]
    slope = 2.0 * (later[0] - states[:, 3:]) / 0.1 - (later[1] - states[:, 3:]) / 0.2
    np.testing.assert_allclose(found, slope, atol=2e-4)


def test_a_steady_force_that_is_missing_is_the_force_over_the_mass(voyage: pd.DataFrame) -> None:
    plant: Plant = vessel_plant(load_vessel("gunnerus_short"))
    states, controls, wind = states_of(voyage), controls_of(voyage), wind_of(voyage)
    pushed = replace(plant, constant_X_n=plant.constant_X_n + 10_000.0)
    gap = modelled_acceleration(pushed, states, controls, wind) - modelled_acceleration(
        plant, states, controls, wind
    )
    np.testing.assert_allclose(gap[:, 0], 10_000.0 / (plant.mass_kg - plant.Xud), rtol=1e-3)
    np.testing.assert_allclose(gap[:, 1:], 0.0, atol=1e-4)


def test_cells_average_what_lies_in_them_and_say_how_much_that_is() -> None:
    surge = np.repeat([0.5, 1.5, 2.5], [40, 30, LEAST_S - 1])
    rate = np.repeat([0.1, 0.9, 0.1], [40, 30, LEAST_S - 1])
    missing = np.stack([surge, -surge, np.zeros_like(surge)], axis=1)
    cells = cells_of(Residuals(missing, {"surge_mps": surge, "yaw_rate_dps": rate}), *PLANES[0])
    assert cells.seconds.sum() == len(surge)
    known = np.isfinite(cells.mean[0])
    assert sorted(cells.mean[0][known]) == pytest.approx([0.5, 1.5])
    np.testing.assert_allclose(cells.mean[1][known], -cells.mean[0][known])
    assert cells.seconds[~known].max() < LEAST_S


@given(st.lists(st.floats(-1e4, 1e4), min_size=1, max_size=30))
def test_edges_hold_all_values_and_are_not_many(values: list[float]) -> None:
    edges = edges_of(np.array(values))
    step = edges[1] - edges[0]
    assert edges[0] <= min(values) + 1e-9 * max(1.0, abs(min(values)))
    assert edges[-1] >= max(values) - 1e-9 * max(1.0, abs(max(values)))
    assert 2 <= len(edges) <= 13
    np.testing.assert_allclose(np.diff(edges), step)
