"""Straight ramps between recorded events are found and held; what drives and noise do is left alone."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seatrial.acquisition.core.ship import COMMAND
from seatrial.acquisition.core.trial import Quality
from seatrial.analysis.quality.controls import ORDER_INTERPOLATED, check_orders, hold_orders
from seatrial.analysis.series import finite_samples
from seatrial.hybrid.simulation.trial import SimulationNoise, simulate_trial
from tests.analysis.conftest import table_at
from tests.analysis.quality import faults

AT_S = np.arange(0.0, 900.0, 0.5)


@pytest.fixture(scope="module")
def trial() -> pd.DataFrame:
    return simulate_trial("gunnerus_long", "gentle", "voyage", 900.0, 2.0, 5)[0]


def events(seed: int, spacing_s: float, largest: float) -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(seed)
    times = np.cumsum(random.exponential(spacing_s, 500))
    times = np.rint(times[times < 890.0] * 2.0) / 2.0
    times = np.unique(np.concatenate([[0.0], times, [AT_S[-1]]]))
    return times, random.uniform(-largest, largest, times.size)  # not whole: three on one line cannot be told


@given(seed=st.integers(0, 10_000), spacing_s=st.floats(15.0, 120.0))
@settings(max_examples=15, deadline=None)
def test_ramps_are_found_and_the_held_order_is_what_was_ordered(seed: int, spacing_s: float) -> None:
    times, values = events(seed, spacing_s, 60.0)
    truth = values[np.searchsorted(times, AT_S, side="right") - 1]
    table = table_at(AT_S, {"port_rpm": np.interp(AT_S, times, values)})
    checked = check_orders(table)
    (finding,) = checked.findings
    assert (finding.code, finding.channel, finding.certain) == (ORDER_INTERPOLATED, "port_rpm", True)
    assert 0.5 < finding.estimate["share"] <= 1.0
    assert 10.0 < finding.estimate["longest_s"] <= np.diff(times).max() + 1e-6
    held = hold_orders(table, "port_rpm")
    suspect = np.asarray(checked.flags["port_rpm"] == Quality.SUSPECT)
    assert held[suspect] == pytest.approx(truth[suspect], abs=1e-6)
    assert (held[~suspect] == table["port_rpm"].to_numpy()[~suspect]).all()
    assert check_orders(table.assign(port_rpm=held)).findings == ()


@pytest.mark.parametrize("decimals", [3, 6])
def test_a_file_with_few_decimals_still_shows_its_lines(decimals: int) -> None:
    times, values = events(1, 40.0, 150.0)
    table = table_at(AT_S, {"port_rpm": np.round(np.interp(AT_S, times, values), decimals)})
    assert [finding.channel for finding in check_orders(table).findings] == ["port_rpm"]


def test_an_azimuth_ramp_through_180() -> None:
    angle = np.interp(AT_S, [0.0, 200.0, 450.0, 899.5], [150.0, 190.0, 175.0, 200.0])
    table = table_at(AT_S, {"port_angle_deg": 180.0 - np.mod(180.0 - angle, 360.0)})
    (finding,) = check_orders(table).findings
    assert finding.estimate["ramps"] == 3
    assert finding.estimate["longest_s"] == pytest.approx(449.5, abs=1.0)


def test_orders_in_a_trial(trial: pd.DataFrame) -> None:
    spoilt = faults.order_interpolated(trial, np.random.default_rng(0))
    assert {finding.channel for finding in check_orders(spoilt.table).findings} == set(spoilt.channels)


@pytest.mark.parametrize("manoeuvre", ["voyage", "stopping", "tunnel_test"])
@pytest.mark.parametrize("noise", [0.0, 1.0])
def test_feedback_is_sound_even_without_noise(manoeuvre: str, noise: float) -> None:
    """Without noise the azimuths' slews at their limit are straight, and all equally steep."""
    table, _ = simulate_trial(
        "gunnerus_long", "calm", manoeuvre, 400.0, 10.0, 2, noise=SimulationNoise().scaled(noise)
    )  # fmt: skip
    assert check_orders(table).findings == ()


def test_held_stepped_and_slewed_orders_are_sound() -> None:
    at_s = np.arange(0.0, 600.0, 0.1)
    steps = np.repeat(np.random.default_rng(3).integers(-100, 100, 60), 100).astype(float)
    slews = np.interp(at_s % 60.0, [0.0, 20.0, 21.5, 40.0, 41.5, 60.0], [0.0, 0.0, 30.0, 30.0, 0.0, 0.0])
    table = table_at(at_s, {"port_rpm": np.full(at_s.size, 120.0), "starboard_rpm": steps, "port_angle_deg": slews})
    assert check_orders(table).findings == ()


def test_coarse_feedback_that_creeps_is_sound() -> None:
    creeping = np.round(np.cumsum(np.full(AT_S.size, 0.05)) * 10.0) / 10.0
    assert check_orders(table_at(AT_S, {"port_angle_deg": creeping % 100.0})).findings == ()


def test_nothing_to_judge() -> None:
    assert check_orders(table_at(AT_S, {"surge_mps": AT_S})).flags.empty
    empty = table_at([], {name: [] for name in COMMAND})
    assert check_orders(empty).findings == ()
    assert finite_samples(empty, "port_rpm").rows.size == 0


def test_steering_gear_with_one_pump_and_two_is_no_interpolation() -> None:
    """A rudder goes over at 2.4 or 4.8 deg/s and stays, straight as a line where a simulator has no noise."""
    at_s = np.arange(0.0, 600.0, 0.2)
    half = np.interp(at_s % 100.0, [0.0, 14.6, 50.0, 64.6, 100.0], [-17.5, 17.5, 17.5, -17.5, -17.5])
    whole = np.interp(at_s % 100.0, [0.0, 7.3, 50.0, 57.3, 100.0], [-17.5, 17.5, 17.5, -17.5, -17.5])
    rudder = np.where(at_s < 150.0, half, np.where(at_s < 360.0, whole, 0.9 * half))
    table = table_at(at_s, {"propeller_rpm": np.full(at_s.size, 90.0), "rudder_angle_deg": rudder})
    assert check_orders(table).findings == ()
    times, values = events(2, 60.0, 30.0)
    drawn = table_at(AT_S, {"propeller_rpm": 90.0 + 0.0 * AT_S, "rudder_angle_deg": np.interp(AT_S, times, values)})
    (finding,) = check_orders(drawn).findings
    assert (finding.code, finding.channel) == (ORDER_INTERPOLATED, "rudder_angle_deg")
