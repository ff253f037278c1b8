"""Grids: found with their step where they lost something, and not in what instruments commonly report."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seatrial.acquisition.core.quantities import Series
from seatrial.acquisition.core.ship import BY_NAME, wrap_360
from seatrial.acquisition.tables.import_table import import_table
from seatrial.analysis.quality.check import DataQuality, check_table
from seatrial.analysis.series import quantisation_step, rounding_step, series_from_values
from seatrial.analysis.tables.table import NANO, read_table
from tests.conftest import nightly

MAPS = Path(__file__).parents[3] / "trials" / "columns"
NORTH, HEADING, SURGE = (BY_NAME[name] for name in ("north_m", "heading_deg", "surge_mps"))


def track(size: int = 600, noise_m: float = 0.02, seed: int = 0) -> np.ndarray:
    """A way that speeds up, slows down and turns back [m], at 1 Hz."""
    speed = 4.0 * np.sin(np.arange(size) / 60.0) + np.sin(np.arange(size) / 23.0)
    return np.cumsum(speed) + noise_m * np.random.default_rng(seed).standard_normal(size)


def samples(values: np.ndarray) -> Series:
    return series_from_values(np.arange(values.size, dtype=np.int64) * NANO, values)


@settings(max_examples=40, deadline=None)
@given(step=st.floats(0.06, 5.0), seed=st.integers(0, 1000), offset=st.floats(-100.0, 100.0))
def test_a_coarse_grid_is_found_with_its_step(step: float, seed: int, offset: float) -> None:
    rounded = np.round(track(seed=seed) / step) * step + offset
    assert quantisation_step(samples(rounded), NORTH) == pytest.approx(step, rel=0.01)


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 1000), noise_m=st.floats(0.0, 1.0))
def test_values_of_full_resolution_have_no_grid(seed: int, noise_m: float) -> None:
    assert rounding_step(track(noise_m=noise_m, seed=seed)) == 0.0


def test_a_constant_speed_is_no_grid_of_positions() -> None:
    straight = 4.2 * np.arange(900) + 0.05 * np.random.default_rng(0).standard_normal(900)
    assert quantisation_step(samples(straight), NORTH) == 0.0


@pytest.mark.parametrize("rate_hz", [1.0, 5.0])
def test_a_grid_is_found_at_a_constant_speed_of_many_steps(rate_hz: float) -> None:
    straight = 4.2 * np.arange(900) / rate_hz + 0.05 * np.random.default_rng(0).standard_normal(900)
    assert quantisation_step(samples(np.round(straight / 0.1) * 0.1), NORTH) == pytest.approx(0.1)


def test_a_grid_that_drifts_is_found_by_its_steps() -> None:
    """A projection stretches the grid by place, so that values do not lie on exact multiples of anything."""
    values = np.round(track() / 0.09) * 0.09
    assert quantisation_step(samples(values + 2e-6 * np.arange(values.size)), NORTH) == pytest.approx(
        0.09, rel=0.01
    )


@pytest.mark.parametrize(
    ("name", "step", "noise"),
    [("surge_mps", 0.01, 0.03), ("heading_deg", np.rad2deg(1e-4), 0.1), ("port_rpm", 0.25, 0.3),
     ("port_angle_deg", 1.0, 0.0), ("wind_direction_deg", 1.0, 3.0), ("north_m", 0.0111, 0.05)],
)  # fmt: skip
def test_what_buses_carry_is_not_found(name: str, step: float, noise: float) -> None:
    random = np.random.default_rng(0)
    values = 10.0 + 8.0 * np.sin(np.arange(900) / 50.0) + noise * random.standard_normal(900)
    assert quantisation_step(samples(np.round(values / step) * step), BY_NAME[name]) == 0.0


def test_steps_across_north_are_steps_on_the_circle() -> None:
    heading = wrap_360(np.round(20.0 * np.sin(np.arange(600) / 40.0)))
    assert quantisation_step(samples(heading), HEADING) == pytest.approx(1.0)


def test_noise_wider_than_the_step_carries_what_lies_between() -> None:
    values = np.sin(np.arange(2000) / 100.0) + 0.2 * np.random.default_rng(0).standard_normal(2000)
    assert quantisation_step(samples(np.round(values / 0.05) * 0.05), SURGE) == 0.0
    assert quantisation_step(samples(np.round(values / 0.5) * 0.5), SURGE) == pytest.approx(0.5)


@pytest.fixture(scope="module")
def docking(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], DataQuality]:
    """The docking of 2019, its position from degrees and ``minutes``, or in ``metres``: columns North and East."""
    folder = tmp_path_factory.mktemp("docking")
    source = shared_data / "gunnerus_2019_docking" / "docking_2019-11-09_part1.csv"
    shipped = (MAPS / "gunnerus_2019_docking.toml").read_text(encoding="utf-8")
    before, _, rest = shipped.partition("[position]")
    after = rest[rest.index("[channels]") :].replace(
        "[channels]", '[channels]\nnorth_m = { column = "North [m]", unit = "m" }\n'
        'east_m = { column = "East [m]", unit = "m" }', 1)  # fmt: skip
    maps = {"minutes": shipped, "metres": before + after}

    @cache
    def checked(position: str) -> DataQuality:
        (folder / f"{position}.toml").write_text(maps[position], encoding="utf-8")
        import_table(source, folder / f"{position}.mcap", folder / f"{position}.toml")
        return check_table(read_table(folder / f"{position}.mcap"))

    return checked


positions = pytest.mark.parametrize("position", ["metres", *nightly("minutes")])


@pytest.mark.slow
@pytest.mark.shared
@positions
def test_the_docking_of_2019_is_quantised_where_it_is(docking: Callable[[str], DataQuality], position: str) -> None:
    """A ten-thousandth of a minute is 0.1858 m to the north and 0.0860 m to the east at 62.47 degrees."""
    findings = docking(position).findings
    steps = {finding.channel: finding.estimate["step"] for finding in findings if finding.code == "quantised"}
    expected = {"north_m": 0.1858, "east_m": 0.0860} if position == "metres" else {}
    assert steps == pytest.approx(expected | {"speed_through_water_mps": 0.1 * 1852 / 3600}, rel=0.01)


@pytest.mark.shared
@positions
def test_nothing_else_about_the_channels_of_2019_is_found(
    docking: Callable[[str], DataQuality], position: str
) -> None:
    own = {"gap", "stuck", "spike", "out_of_range", "duplicate", "time_backwards", "clock_jump", "time_jitter"}
    quality = docking(position)
    assert not own & {finding.code for finding in quality.findings}
    assert "bad" not in {channel.grade for channel in quality.channels.values()}


@pytest.mark.parametrize("name", ["rudder_angle_deg", "helm_angle_deg", "apparent_wind_angle_deg"])
def test_half_a_degree_of_rudder_and_of_wind_on_board_is_what_instruments_report(name: str) -> None:
    values = 10.0 + 5.0 * np.sin(np.arange(900) / 20.0)
    channel = BY_NAME[name]
    assert quantisation_step(samples(np.round(values / 0.5) * 0.5), channel) == 0.0
    assert quantisation_step(samples(np.round(values / 2.0) * 2.0), channel) == pytest.approx(2.0)


def test_a_shaft_that_is_stopped_once_has_no_grid() -> None:
    assert quantisation_step(samples(np.repeat([600.0, 0.0], [900, 50])), BY_NAME["propeller_rpm"]) == 0.0
