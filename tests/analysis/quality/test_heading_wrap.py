"""Angles drawn straight across their seam are found, wherever the ship points and whatever the rates."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from seatrial.acquisition.core.ship import angle_difference, unwrap, wrap_180, wrap_360
from seatrial.acquisition.core.trial import Quality
from seatrial.acquisition.tables.import_table import import_table
from seatrial.analysis.quality.channel_checks import WRAP_INTERPOLATED, check_heading_wrap, wrap_interpolation_mask
from seatrial.analysis.tables.table import NANO, read_table, times_ns
from seatrial.hybrid.simulation.trial import SimulationNoise, simulate_trial
from tests.analysis.conftest import table_at
from tests.analysis.quality import faults
from tests.analysis.test_real_recordings import MAPS, TRIALS


@pytest.fixture(scope="module", params=["calm", "moderate"])
def about_north(request: pytest.FixtureRequest) -> pd.DataFrame:
    """Zigzags about north, in waves too, at 5 Hz."""
    return simulate_trial("gunnerus_long", request.param, "zigzag_20_20", 500.0, 5.0, 4)[0]


def resampled(table: pd.DataFrame, rate_hz: float, on_circle: bool) -> pd.DataFrame:
    """All channels on straight lines at another rate; the heading as a plain number, or on the circle."""
    since_s = (times_ns(table) - times_ns(table)[0]) / NANO
    at_s = np.arange(0.0, since_s[-1], 1.0 / rate_hz)
    columns = {str(name): np.interp(at_s, since_s, table[name]) for name in table}
    if on_circle:
        for name in ("heading_deg", "wind_direction_deg"):
            columns[name] = wrap_360(np.interp(at_s, since_s, unwrap(table[name])))
    return table_at(at_s, columns)


def flagged(table: pd.DataFrame, name: str = "heading_deg") -> NDArray[np.bool_]:
    checked = check_heading_wrap(table)
    assert checked.flags.index.equals(table.index)
    return np.asarray(checked.flags[name] == Quality.BAD)


@pytest.mark.parametrize("rate_hz", [2.0, 3.7, 10.0, 25.0])
def test_every_sample_on_a_line_through_north_is_found_and_no_other(
    about_north: pd.DataFrame, rate_hz: float
) -> None:
    spoilt, sound = (resampled(about_north, rate_hz, on_circle) for on_circle in (False, True))
    off_deg = np.abs(angle_difference(spoilt["heading_deg"], sound["heading_deg"]))
    bad = flagged(spoilt)
    assert (off_deg > 5.0).sum() > 3
    assert bad[off_deg > 5.0].mean() >= 0.95
    assert not bad[off_deg < 0.5].any()
    (finding,) = check_heading_wrap(spoilt).findings
    assert (finding.code, finding.channel, finding.certain) == (WRAP_INTERPOLATED, "heading_deg", True)
    assert finding.estimate["samples"] == bad.sum()
    assert spoilt.index[bad][[0, -1]].tolist() == [finding.start, finding.end]
    assert (wrap_interpolation_mask(spoilt, "heading_deg") == bad).all()
    assert check_heading_wrap(sound).findings == ()


@pytest.mark.parametrize("noise", [0.3, 3.0])
@pytest.mark.parametrize("heading_deg", [0.0, 359.9, 180.0])
def test_a_ship_that_swings_about_north_is_sound(heading_deg: float, noise: float) -> None:
    sensors = SimulationNoise().scaled(noise)
    table, _ = simulate_trial(
        "gunnerus_short", "moderate", "speed_runs", 300.0, 2.0, 9, noise=sensors, heading_deg=heading_deg
    )
    assert check_heading_wrap(table).findings == ()


@given(
    start_deg=st.floats(0.0, 359.9), rate_dps=st.floats(1.5, 8.0), to_port=st.booleans(),
    coarse_s=st.floats(1.1, 3.0),
)  # fmt: skip
@settings(max_examples=15, deadline=None)
def test_a_steady_turn_from_any_heading(start_deg: float, rate_dps: float, to_port: bool, coarse_s: float) -> None:
    """The truth is known in closed form: what the plain interpolation does to a straight line on the circle."""
    rate = -rate_dps if to_port else rate_dps
    at_s = np.arange(0.0, 400.0, 0.5)
    true_deg = wrap_360(start_deg + rate * at_s)
    knots_s = np.arange(0.0, 400.0 + coarse_s, coarse_s)
    plain_deg = np.interp(at_s, knots_s, wrap_360(start_deg + rate * knots_s))
    yaw = np.full(at_s.size, rate)
    assert not flagged(table_at(at_s, {"heading_deg": true_deg, "yaw_rate_dps": yaw})).any()
    bad = flagged(table_at(at_s, {"heading_deg": plain_deg, "yaw_rate_dps": yaw}))
    off_deg = np.abs(angle_difference(plain_deg, true_deg))
    inside = at_s < 400.0 - 2.0 * coarse_s  # a line that the recording ends on has no other side
    assert (bad[inside & (off_deg > 10.0)]).all()
    assert not bad[off_deg < 0.5].any()


def test_spikes_near_north_are_no_lines(about_north: pd.DataFrame) -> None:
    for size in (15.0, 150.0):
        spoilt = faults.spikes("heading_deg", size, 10)(about_north, np.random.default_rng(1)).table
        assert check_heading_wrap(spoilt).findings == ()


def test_sentinels_gaps_and_missing_channels(about_north: pd.DataFrame) -> None:
    table = about_north.copy()
    table.loc[table.index[100:103], "heading_deg"] = 655.35
    table.loc[table.index[200:300], "heading_deg"] = np.nan
    checked = check_heading_wrap(table)
    assert checked.findings == ()
    assert (checked.flags["heading_deg"].iloc[200:300] == Quality.MISSING).all()
    assert check_heading_wrap(table[["surge_mps"]]).flags.empty
    assert check_heading_wrap(table.iloc[:0]).findings == ()


def test_an_azimuth_drawn_through_180() -> None:
    """Astern, held near 180 deg: three places at least, as no rate is measured; a fast slew is sound."""
    random = np.random.default_rng(0)
    knots_s = np.arange(0.0, 300.0, 1.0)
    angle = wrap_180(179.2 + random.normal(0.0, 0.5, knots_s.size))
    at_s = np.arange(0.0, 299.0, 0.2)
    found = check_heading_wrap(table_at(at_s, {"port_angle_deg": np.interp(at_s, knots_s, angle)})).findings
    assert [each.channel for each in found] == ["port_angle_deg"]
    slew = wrap_180(np.interp(at_s, [0, 50, 59, 100, 109], [0.0, 0.0, 180.0, 180.0, 360.0]) + 90.0)
    noisy = wrap_180(slew + random.normal(0.0, 0.2, at_s.size))
    assert check_heading_wrap(table_at(at_s, {"port_angle_deg": noisy})).findings == ()


@pytest.mark.shared
def test_the_real_recordings(shared_data: Path, tmp_path: Path) -> None:
    """2022: what the integrated yaw rate says of each sample from those within 10 s of it; 2019 has no lines."""
    tables = {}
    for name, file in TRIALS.items():
        import_table(shared_data / name / file, tmp_path / f"{name}.mcap", MAPS / f"{name}.toml")
        tables[name] = read_table(tmp_path / f"{name}.mcap")
    assert check_heading_wrap(tables["gunnerus_2019_docking"]).findings == ()
    table = tables["gunnerus_2022_trials"]
    yaw_rate = table["yaw_rate_dps"].to_numpy()
    turned_deg = np.concatenate([[0.0], np.cumsum(0.25 * (yaw_rate[1:] + yaw_rate[:-1]))])
    left = pd.Series(np.deg2rad(table["heading_deg"].to_numpy() - turned_deg))
    around = (
        pd.DataFrame({"east": np.sin(left), "north": np.cos(left)}).rolling(41, center=True, min_periods=1).median()
    )
    typical_deg = np.rad2deg(np.arctan2(around["east"].to_numpy(), around["north"].to_numpy()))
    off_deg = np.abs(angle_difference(np.rad2deg(left), typical_deg))
    near_north = np.abs(angle_difference(turned_deg + typical_deg, 0.0)) < 20.0
    wrong, bad = (off_deg > 20.0) & near_north, flagged(table)
    assert wrong.sum() >= 15
    assert bad[wrong].mean() >= 0.9
    assert not bad[off_deg < 1.0].any()
