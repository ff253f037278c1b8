"""The acceleration that a model lacks: none on itself, and what was taken away from it where it was."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seatrial.analysis.estimation.smoother import smooth
from seatrial.analysis.tables.resample import resample
from seatrial.hybrid.effects import vessel_plant
from seatrial.hybrid.report.prediction_errors import (
    LEAST_S,
    PLANES,
    Residuals,
    acceleration_residuals,
    average_in_cells,
    largest_residuals,
    modelled_acceleration,
    round_cell_edges,
)
from seatrial.hybrid.report.trial import residual_sentences
from seatrial.hybrid.simulation.trial import simulate_trial
from seatrial.hybrid.vessel.dynamics import simulate_batch
from seatrial.hybrid.vessel.files import load_vessel
from seatrial.hybrid.vessel.plant import Plant
from seatrial.hybrid.vessel.sensors import controls_of, states_of, wind_of


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
    pushed = plant.replaced(constant_X_n=plant.constant_X_n + 10_000.0)
    gap = modelled_acceleration(pushed, states, controls, wind) - modelled_acceleration(
        plant, states, controls, wind
    )
    np.testing.assert_allclose(gap[:, 0], 10_000.0 / (plant.mass_kg - plant.Xud), rtol=1e-3)
    np.testing.assert_allclose(gap[:, 1:], 0.0, atol=1e-4)


def test_cells_average_what_lies_in_them_and_say_how_much_that_is() -> None:
    surge = np.repeat([0.5, 1.5, 2.5], [40, 30, LEAST_S - 1])
    rate = np.repeat([0.1, 0.9, 0.1], [40, 30, LEAST_S - 1])
    missing = np.stack([surge, -surge, np.zeros_like(surge)], axis=1)
    cells = average_in_cells(Residuals(missing, {"surge_mps": surge, "yaw_rate_dps": rate}), *PLANES[0])
    assert cells.seconds.sum() == len(surge)
    known = np.isfinite(cells.mean[0])
    assert sorted(cells.mean[0][known]) == pytest.approx([0.5, 1.5])
    np.testing.assert_allclose(cells.mean[1][known], -cells.mean[0][known])
    assert cells.seconds[~known].max() < LEAST_S


@given(st.lists(st.floats(-1e4, 1e4), min_size=1, max_size=30))
def test_edges_hold_all_values_and_are_not_many(values: list[float]) -> None:
    edges = round_cell_edges(np.array(values))
    step = edges[1] - edges[0]
    assert edges[0] <= min(values) + 1e-9 * max(1.0, abs(min(values)))
    assert edges[-1] >= max(values) - 1e-9 * max(1.0, abs(max(values)))
    assert 2 <= len(edges) <= 13
    np.testing.assert_allclose(np.diff(edges), step)


def test_the_right_model_lacks_nothing_and_a_wrong_one_does() -> None:
    """In a calm, from noisy measurements: mean residuals of the true ship are a tenth of those of the shorter
    one."""
    table = simulate_trial("gunnerus_long", "calm", "paper", 400.0, 5.0, 8)[0]
    one_hz, motion = resample(table), smooth(table)
    true, wrong = (
        acceleration_residuals(one_hz, motion, vessel_plant(load_vessel(name)))
        for name in ("gunnerus_long", "gunnerus_short")
    )
    assert len(true.missing) > 300
    turning = np.abs(true.quantities["yaw_rate_dps"]) > 1.0
    side = np.sign(true.quantities["yaw_rate_dps"])[turning]
    lacks = [float(np.mean(side * each.missing[turning, 2])) for each in (true, wrong)]
    assert abs(lacks[0]) < 0.1 * abs(lacks[1])
    assert abs(lacks[1]) > 0.05


def test_azimuths_about_astern_have_their_mean_astern() -> None:
    """179 and -179 deg are both astern; their mean is not ahead."""
    table = simulate_trial("gunnerus_short", "calm", "paper", 120.0, 5.0, 8)[0]
    motion = smooth(table)
    turned = resample(table).assign(port_angle_deg=179.0, starboard_angle_deg=-179.0)
    found = acceleration_residuals(turned, motion, vessel_plant(load_vessel("gunnerus_short")))
    np.testing.assert_allclose(np.abs(found.quantities["azimuth_deg"]), 180.0, atol=1e-9)


def test_the_sentence_names_where_a_model_lacks_most_and_how_much() -> None:
    """Of a model that has too much thrust astern it is the surge that is missing where the shafts turn astern."""
    random = np.random.default_rng(3)
    rpm = np.repeat(random.uniform(-120.0, 120.0, 60), 30)
    noise = 0.004 * random.standard_normal((1800, 3))
    noise[:, 0] += np.where(rpm < 0.0, -0.03, 0.0)
    quantities = {"rpm": rpm, "yaw_rate_dps": random.uniform(-1.0, 1.0, rpm.size)}
    found = largest_residuals(Residuals(noise, quantities))
    assert [(each.acceleration, each.quantity) for each in found] == [("surge_mps2", "rpm")]
    (most,) = found
    assert most.high <= 0.0
    assert abs(most.mean + 0.03) < 1.5 * most.half_width < 0.01
    (sentence,) = residual_sentences(Residuals(noise, quantities))
    assert sentence.startswith(f"By mean shaft speed, the missing surge acceleration from \u2212{-most.low:g}")
    none = residual_sentences(Residuals(noise * 0.0 + random.standard_normal(noise.shape), quantities))
    assert none == ["The missing acceleration is not significant in any class of any quantity."]
