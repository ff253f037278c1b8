"""The channel table, units and angles: the contract's values, and properties on the circle."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.acquisition.core.quantities import unit_scale
from seatrial.acquisition.core.ship import (
    BY_NAME,
    CHANNELS,
    CIRCULAR,
    COMMAND,
    ENVIRONMENT,
    NAMES,
    POSE,
    VELOCITY,
    angle_difference,
    circular_mean,
    unwrap,
    wrap_180,
    wrap_360,
)

ANGLES = st.floats(-1e4, 1e4)


def test_thirteen_channels_in_the_contracts_order_and_groups() -> None:
    assert NAMES == (
        "north_m", "east_m", "heading_deg", "surge_mps", "sway_mps", "yaw_rate_dps", "wind_direction_deg",
        "wind_speed_mps", "port_rpm", "port_angle_deg", "starboard_rpm", "starboard_angle_deg", "tunnel_rpm",
    )  # fmt: skip
    assert POSE + VELOCITY + ENVIRONMENT + COMMAND == NAMES


def test_names_end_with_their_unit() -> None:
    suffix = {"m": "_m", "deg": "_deg", "m/s": "_mps", "deg/s": "_dps", "rpm": "_rpm"}
    assert all(channel.name.endswith(suffix[channel.unit]) for channel in CHANNELS)


@pytest.mark.parametrize(
    ("name", "inside", "outside"),
    [
        ("heading_deg", (0.0, 359.999), (-0.001, 360.0, math.nan)),
        ("port_angle_deg", (180.0, -179.999), (-180.0, 180.001)),
        ("wind_speed_mps", (0.0, 100.0), (-0.1, 100.1, math.inf)),
        ("tunnel_rpm", (-3000.0, 3000.0), (3000.1,)),
    ],
)
def test_range_of_a_channel(name: str, inside: tuple[float, ...], outside: tuple[float, ...]) -> None:
    assert all(BY_NAME[name].is_possible_value(value) for value in inside)
    assert not any(BY_NAME[name].is_possible_value(value) for value in outside)


@given(ANGLES, st.sampled_from(sorted(CIRCULAR)))
def test_wrapping_stays_in_range_and_on_the_same_direction(angle_deg: float, name: str) -> None:
    wrapped = BY_NAME[name].wrap_angle(angle_deg)
    assert BY_NAME[name].is_possible_value(wrapped)
    assert math.cos(math.radians(wrapped - angle_deg)) == pytest.approx(1.0, abs=1e-9)


@given(ANGLES, ANGLES)
def test_difference_is_the_shortest_turn(to_deg: float, from_deg: float) -> None:
    turn = float(angle_difference(to_deg, from_deg))
    assert -180.0 < turn <= 180.0
    assert math.cos(math.radians(from_deg + turn - to_deg)) == pytest.approx(1.0, abs=1e-9)


def test_angles_at_north_and_at_the_stern() -> None:
    assert angle_difference(1.0, 359.0) == 2.0
    assert angle_difference(-179.0, 179.0) == 2.0
    assert wrap_360(-1e-20) == 0.0
    assert wrap_180(-180.0) == 180.0
    assert abs(circular_mean([359.0, 1.0])) < 1e-12
    assert abs(circular_mean([179.0, -179.0])) == pytest.approx(180.0)


@given(st.lists(st.floats(-170, 170), min_size=2, max_size=50), ANGLES)
def test_unwrap_undoes_wrapping_of_any_slow_turn(steps_deg: list[float], start_deg: float) -> None:
    path = start_deg + np.cumsum(steps_deg)
    unwrapped = unwrap(wrap_360(path))
    assert np.allclose(np.diff(unwrapped), np.diff(path), atol=1e-6)


def test_unwrap_passes_over_missing_values() -> None:
    unwrapped = unwrap([358.0, np.nan, 2.0])
    assert np.isnan(unwrapped[1])
    assert unwrapped[2] == 362.0


def test_units_convert_and_refuse() -> None:
    assert unit_scale("m/s", "knots") == pytest.approx(1852 / 3600)
    assert unit_scale("deg", "rad") == pytest.approx(180 / math.pi)
    assert unit_scale("deg/s", "deg/min") == pytest.approx(1 / 60)
    with pytest.raises(ConfigurationError, match="'knots' does not measure a quantity in rpm; use"):
        unit_scale("rpm", "knots")
