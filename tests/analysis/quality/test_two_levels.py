"""Two sources under one name: values that alternate between two levels, and what looks alike and is sound."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seatrial.acquisition.core.quantities import Bools, Floats
from seatrial.acquisition.core.ship import BY_NAME
from seatrial.analysis.quality.channel_checks import ALTERNATING, alternation_findings, find_alternating_levels
from seatrial.analysis.quality.check import check_table
from seatrial.analysis.series import series_from_values

_ROWS = 600
_TIME_S = np.arange(_ROWS) * 0.5


def turning(generator: np.random.Generator) -> Floats:
    """The heading [deg] of a ship that turns and swings."""
    swing = 8.0 * np.sin(2.0 * np.pi * _TIME_S / 60.0)
    return 0.3 * _TIME_S + swing + 0.1 * generator.standard_normal(_ROWS)


def mixed(kind: str, generator: np.random.Generator) -> Bools:
    """Which samples are of the second source."""
    if kind == "in turn":
        return np.arange(_ROWS) % 2 == 1
    if kind == "one in five":
        return np.arange(_ROWS) % 5 == 4
    return generator.random(_ROWS) < 0.5


def levels_of(name: str, values: Floats) -> tuple[float, float] | None:
    """The two levels that are found in values of a channel."""
    levels = find_alternating_levels(series_from_values((_TIME_S * 1e9).astype(np.int64), values), BY_NAME[name])
    return None if levels is None else (levels.lower, levels.upper)


@pytest.mark.parametrize("kind", ["in turn", "one in five", "at random"])
@pytest.mark.parametrize("apart", [20.0, 62.7, 170.0, -62.7])
def test_two_compasses_that_turn_with_the_ship_are_found(kind: str, apart: float) -> None:
    generator = np.random.default_rng(1)
    heading = turning(generator) + np.where(mixed(kind, generator), apart, 0.0)
    found = levels_of("heading_deg", heading % 360.0)
    assert found is not None
    assert abs((found[1] - found[0] + 180.0) % 360.0 - 180.0) == pytest.approx(abs(apart), abs=2.0)


@pytest.mark.parametrize(
    ("name", "values", "apart"),
    [
        ("north_m", 4.0 * _TIME_S, 25.0), ("surge_mps", 5.0 + 0.2 * np.sin(_TIME_S / 20.0), 1.5),
        ("wind_speed_mps", 8.0 + np.sin(_TIME_S / 15.0), 6.0), ("port_rpm", 120.0 + 0.05 * _TIME_S, 40.0),
        ("yaw_rate_dps", np.sin(_TIME_S / 10.0), 3.0),
    ],
)  # fmt: skip
def test_any_channel_of_two_sources_is_found(name: str, values: Floats, apart: float) -> None:
    noise = 0.01 * apart * np.random.default_rng(2).standard_normal(_ROWS)
    found = levels_of(name, values + noise + np.where(np.arange(_ROWS) % 2 == 1, apart, 0.0))
    assert found is not None
    assert found[1] - found[0] == pytest.approx(apart, rel=0.2)


def test_compasses_of_a_ship_alongside_are_found() -> None:
    assert levels_of("heading_deg", np.where(np.arange(_ROWS) % 2, 57.3, 120.0)) == (57.3, 120.0)


def test_both_sources_are_named() -> None:
    times, second = (_TIME_S * 1e9).astype(np.int64), np.arange(_ROWS) % 2
    samples = series_from_values(times, turning(np.random.default_rng(3)) % 300.0 + 40.0 * second)
    samples = replace(samples, sources=("can0/35:127250", "can1/35:127250"), source_index=second.astype(np.int32))
    (finding,) = alternation_findings({"heading_deg": samples}, BY_NAME)
    assert finding.code == ALTERNATING
    assert "can0/35:127250" in finding.text
    assert "can1/35:127250" in finding.text


def test_the_check_of_a_table_finds_them_and_says_so_of_the_channel() -> None:
    generator = np.random.default_rng(4)
    heading = (turning(generator) + np.where(mixed("in turn", generator), 62.7, 0.0)) % 360.0
    index = pd.date_range("2026-06-01", periods=_ROWS, freq="500ms", tz="UTC")
    quality = check_table(pd.DataFrame({"heading_deg": heading}, index=index))
    assert [each.code for each in quality.findings if each.code == ALTERNATING] == [ALTERNATING]
    assert quality.channels["heading_deg"].grade != "good"


def sound(kind: str, generator: np.random.Generator) -> tuple[str, Floats]:
    """A channel and values of one source, with a size of everything by chance."""
    size = generator.uniform(1.0, 30.0)
    noise = generator.standard_normal(_ROWS)
    steps = size * np.repeat(generator.integers(0, 2, _ROWS // 20), 20)
    flicker = np.rint(0.5 + 0.2 * noise) * size
    thrown = size * np.sign(np.sin(2.0 * np.pi * _TIME_S / generator.uniform(4.0, 30.0)))
    waves = size * np.sin(2.0 * np.pi * _TIME_S / generator.uniform(0.9, 1.3) + 0.3 * np.cumsum(0.1 * noise))
    swell = size * np.sin(_TIME_S) * np.sin(0.02 * _TIME_S)
    return {
        "steps": ("port_rpm", steps), "flicker of a rate": ("yaw_rate_dps", flicker),
        "noise": ("surge_mps", 0.1 * noise), "flicker of a position": ("north_m", 7.3 + flicker),
        "thrown over": ("port_angle_deg", thrown + 0.1 * noise),
        "waves at half the rate": ("yaw_rate_dps", waves), "dithering": ("sway_mps", 0.05 * swell),
        "turns": ("heading_deg", turning(generator) % 360.0),
    }[kind]  # fmt: skip


@pytest.mark.parametrize("seed", [5164, 2791, 2817, 2989])
def test_waves_at_half_the_rate_are_no_levels_while_they_are_largest(seed: int) -> None:
    name, values = sound("waves at half the rate", np.random.default_rng(seed))
    assert levels_of(name, values) is None


@settings(max_examples=60, deadline=None)
@given(
    st.sampled_from(["steps", "flicker of a rate", "flicker of a position", "noise", "thrown over",
                     "waves at half the rate", "dithering", "turns"]),
    st.integers(0, 10_000),
)  # fmt: skip
def test_nothing_is_found_in_what_is_of_one_source(kind: str, seed: int) -> None:
    name, values = sound(kind, np.random.default_rng(seed))
    assert levels_of(name, values) is None
