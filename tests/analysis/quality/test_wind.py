"""Apparent wind taken for true and a turned vane are found while the ship turns; what cannot be told is not."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seatrial.acquisition.core.quantities import wind_over_ground
from seatrial.acquisition.core.ship import angle_difference, wrap_360
from seatrial.acquisition.core.trial import Quality
from seatrial.analysis.quality.wind import check_wind, true_wind
from seatrial.hybrid.simulation.trial import simulate_trial
from tests.analysis.conftest import table_at
from tests.analysis.quality import faults

DICE = np.random.default_rng(0)


@pytest.fixture(scope="module", params=["calm", "gentle", "moderate"])
def voyage(request: pytest.FixtureRequest) -> pd.DataFrame:
    return simulate_trial("gunnerus_long", request.param, "voyage", 1200.0, 2.0, 7, heading_deg=350.0)[0]


def test_true_wind_is_sound(voyage: pd.DataFrame) -> None:
    checked = check_wind(voyage)
    assert checked.findings == ()
    assert (checked.flags == Quality.GOOD).all().all()


def test_apparent_wind_from_the_bow(voyage: pd.DataFrame) -> None:
    spoilt = faults.wind_apparent(voyage, DICE).table
    checked = check_wind(spoilt)
    (finding,) = checked.findings
    assert (finding.code, finding.certain) == ("wind_apparent", True)
    assert finding.estimate["relative_to_bow"] == 1.0
    assert finding.estimate["variance_ratio"] > 2.0
    assert (checked.flags["wind_direction_deg"] == Quality.SUSPECT).all()
    direction_deg, speed_mps = true_wind(spoilt, relative_to_bow=True)
    assert speed_mps == pytest.approx(voyage["wind_speed_mps"].to_numpy(), abs=1e-9)
    felt = speed_mps > 0.01
    assert np.abs(angle_difference(direction_deg, voyage["wind_direction_deg"])[felt]).max() < 1e-6


def test_apparent_wind_from_north(voyage: pd.DataFrame) -> None:
    from_bow = faults.wind_apparent(voyage, DICE).table
    from_north = from_bow.assign(
        wind_direction_deg=wrap_360(from_bow["wind_direction_deg"] + voyage["heading_deg"])
    )
    (finding,) = check_wind(from_north).findings
    assert finding.code == "wind_apparent"
    assert finding.estimate["relative_to_bow"] == 0.0


@pytest.mark.parametrize("angle_deg", [-30.0, 25.0])
def test_a_turned_vane(voyage: pd.DataFrame, angle_deg: float) -> None:
    (finding,) = check_wind(faults.wind_direction_offset(angle_deg)(voyage, DICE).table).findings
    assert finding.code == "wind_direction_offset"
    assert not finding.certain
    low, high = finding.estimate["low"], finding.estimate["high"]
    assert low < finding.estimate["angle_deg"] < high
    assert low - 0.5 * (high - low) < angle_deg < high + 0.5 * (high - low)  # nineteen in twenty lie inside


@pytest.mark.parametrize("bias_deg", [20.0, -90.0])
def test_a_bias_fixed_to_the_earth_is_not_claimed(bias_deg: float) -> None:
    hidden = {"wind_direction_bias": {"angle_deg": bias_deg}}
    table, _ = simulate_trial("gunnerus_long", "moderate", "voyage", 900.0, 2.0, 3, hidden=hidden)
    assert check_wind(table).findings == ()


def test_a_straight_run_tells_nothing() -> None:
    at_s = np.arange(0.0, 600.0)
    dice = np.random.default_rng(2)
    columns = {
        "heading_deg": 90.0,
        "surge_mps": 5.0,
        "sway_mps": 0.0,
        "wind_direction_deg": 60.0,
        "wind_speed_mps": 8.0,
    }
    noisy = {name: value + dice.normal(0.0, 0.05, at_s.size) for name, value in columns.items()}
    straight = table_at(at_s, noisy)
    assert check_wind(straight).findings == ()


def test_assumed_constant_and_missing_wind(voyage: pd.DataFrame) -> None:
    spoilt = faults.wind_apparent(voyage, DICE).table
    spoilt.attrs["sources"] = {"wind_direction_deg": ["assumed"], "wind_speed_mps": ["assumed"]}
    assert check_wind(spoilt).findings == ()
    assert check_wind(voyage.assign(wind_direction_deg=0.0, wind_speed_mps=0.0)).findings == ()
    assert check_wind(voyage.drop(columns=["wind_speed_mps"])).findings == ()
    assert check_wind(voyage.iloc[:0]).findings == ()
    assert check_wind(voyage.iloc[:40]).findings == ()


def test_channels_that_come_at_their_own_times(voyage: pd.DataFrame) -> None:
    """A table joined on measured times has its channels in different rows."""
    spoilt = faults.wind_apparent(voyage, DICE).table
    late = spoilt[["wind_direction_deg", "wind_speed_mps"]]
    late.index = late.index + pd.Timedelta(milliseconds=130)
    apart = pd.concat([spoilt.drop(columns=late.columns), late]).sort_index()
    (finding,) = check_wind(apart).findings
    assert (finding.code, finding.certain) == ("wind_apparent", True)


@given(
    angle_deg=st.floats(0.0, 359.9), speed_mps=st.floats(0.1, 40.0), surge_mps=st.floats(-5.0, 10.0),
    sway_mps=st.floats(-3.0, 3.0), heading_deg=st.floats(0.0, 359.9),
)  # fmt: skip
def test_true_wind_is_that_of_the_recorder(
    angle_deg: float, speed_mps: float, surge_mps: float, sway_mps: float, heading_deg: float
) -> None:
    table = table_at([0.0], {"heading_deg": [heading_deg], "surge_mps": [surge_mps], "sway_mps": [sway_mps],
                             "wind_direction_deg": [angle_deg], "wind_speed_mps": [speed_mps]})  # fmt: skip
    direction, speed = wind_over_ground(angle_deg, speed_mps, surge_mps, sway_mps, heading_deg)
    found_direction, found_speed = true_wind(table, relative_to_bow=True)
    assert found_speed[0] == pytest.approx(speed, abs=1e-9)
    assert speed < 1e-6 or abs(angle_difference(found_direction[0], direction)) < 1e-4
