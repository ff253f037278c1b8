"""Which convention of headings and speeds a track agrees with: the one it was recorded in, or none."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seatrial.acquisition.core.conventions import (
    ANGLE_UNITS,
    CLOCKWISE,
    HEADINGS,
    HeadingConvention,
    drift_angle_statistics,
    find_heading_convention,
    find_velocity_axes,
    heading_conventions_along_course,
    keeps_its_course,
    total_turn_deg,
)
from seatrial.acquisition.core.quantities import Complexes, Floats, unit_scale

STEP_S = 5.0


def motion(seed: int, speed_mps: float = 5.0, count: int = 200) -> tuple[Complexes, Floats]:
    """Moves and headings of a ship that zigzags and turns, with a drift angle against her turns."""
    generator = np.random.default_rng(seed)
    t = STEP_S * np.arange(count)
    rate = 0.6 * np.sin(2.0 * np.pi * t / generator.uniform(180.0, 400.0)) + generator.uniform(-0.3, 0.3)
    heading = generator.uniform(0.0, 360.0) + np.cumsum(rate) * STEP_S
    course = np.deg2rad(heading - 8.0 * rate + generator.normal(0.0, 2.0, count))
    return speed_mps * STEP_S * np.exp(1j * course), heading


def recorded_as(heading_deg: Floats, convention: HeadingConvention, unit: str) -> dict[str, Floats]:
    """The readings of a heading that was written in a convention and unit, by the unit it is read in."""
    numbers = (heading_deg - convention.offset_deg) / convention.scale / unit_scale("deg", unit)
    return {name: numbers * unit_scale("deg", name) for name in ANGLE_UNITS}


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10_000), st.sampled_from(HEADINGS), st.sampled_from(list(ANGLE_UNITS)), st.floats(0.3, 20.0))
def test_a_heading_is_judged_to_be_as_it_was_written(
    seed: int, convention: HeadingConvention, unit: str, speed_mps: float
) -> None:
    moves, heading = motion(seed, speed_mps)
    verdict = find_heading_convention(moves, recorded_as(heading, convention, unit))
    assert (verdict.unit, verdict.convention) == (unit, convention)
    assert verdict.best.spread_deg < 15.0


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10_000), st.floats(0.0, 360.0))
def test_a_turned_chart_turns_no_verdict_but_a_mirrored_one_does(seed: int, angle_deg: float) -> None:
    moves, heading = motion(seed)
    turned = find_heading_convention(moves * np.exp(1j * np.deg2rad(angle_deg)), {"deg": heading + angle_deg})
    assert turned.convention is CLOCKWISE
    assert find_heading_convention(moves.conj(), {"deg": heading}).convention is HEADINGS[1]


@settings(max_examples=80, deadline=None)
@given(st.integers(0, 10_000))
def test_a_ship_that_drifts_as_it_likes_has_no_other_convention(seed: int) -> None:
    """Adrift, turning on the spot, going astern or sideways in a current that turns as tides do, in hours."""
    generator = np.random.default_rng(seed)
    t = STEP_S * np.arange(generator.integers(5, 400))
    heading = generator.uniform(0.0, 360.0) + generator.normal(0.0, 0.5) * t
    heading += generator.normal(0.0, 30.0) * np.sin(2.0 * np.pi * t / generator.uniform(50.0, 900.0))
    current = np.exp(1j * (generator.uniform(0.0, 6.3) + t / generator.uniform(3000.0, 10_000.0)))
    own = generator.normal(0.0, 1.0) * np.exp(1j * np.deg2rad(heading))
    noise = generator.normal(0.0, generator.uniform(0.0, 3.0), (2, t.size))
    verdict = find_heading_convention(
        STEP_S * (current + own) + noise[0] + 1j * noise[1], recorded_as(heading, CLOCKWISE, "deg")
    )
    assert verdict.convention in (CLOCKWISE, None)
    assert verdict.unit in ("deg", "")


@pytest.mark.parametrize("count", [0, 1, 4, 11])
def test_few_moves_tell_nothing(count: int) -> None:
    moves, heading = motion(1)
    assert not find_heading_convention(moves[:count].conj(), {"deg": heading[:count]}).unit


def test_moves_that_are_missing_do_not_count() -> None:
    moves, heading = motion(2)
    moves[::3] = np.nan
    heading[1::7] = np.nan
    assert find_heading_convention(moves, {"deg": heading}).convention is CLOCKWISE
    assert drift_angle_statistics(np.full(5, np.nan + 0j), np.zeros(5)).variance == 1.0


def test_a_position_that_jumps_by_a_hundred_miles_changes_nothing() -> None:
    moves, heading = motion(3)
    moves[40], moves[41] = 2e5 + 0j, -2e5 + 0j
    assert find_heading_convention(moves, {"deg": -heading}).convention is HEADINGS[1]


def test_a_straight_course_tells_no_sense_but_its_candidates() -> None:
    heading = np.full(60, 240.0)
    moves = 25.0 * np.exp(1j * np.deg2rad(np.full(60, 120.0)))
    assert not find_heading_convention(moves, {"deg": heading}).unit
    assert [each.name for each in heading_conventions_along_course(moves, heading)] == ["anticlockwise"]
    assert heading_conventions_along_course(moves, np.full(60, 110.0)) == ()


@pytest.mark.parametrize("ratio", [-1.0, -0.7, 0.1])
def test_a_ship_adrift_and_a_stream_that_veer_alike_tell_nothing(ratio: float) -> None:
    heading = np.linspace(0.0, 120.0, 300)
    moves = np.exp(1j * np.deg2rad(ratio * heading))
    assert not find_heading_convention(moves, recorded_as(heading, CLOCKWISE, "deg")).unit


def test_turns_are_swings_and_no_noise() -> None:
    noise = np.random.default_rng(0).normal(0.0, 1.0, 500)
    assert total_turn_deg(noise) == 0.0
    assert total_turn_deg(np.array([0.0, 20.0, 0.0, 20.0])) == 60.0
    assert total_turn_deg(np.array([])) == 0.0


def speeds_in_each(moves: Complexes, heading: Floats, recorded: Complexes) -> dict[str, Complexes]:
    ahead = np.exp(1j * np.deg2rad(heading))
    return {"ship": recorded * ahead, "north_east": recorded, "east_north": 1j * recorded.conj(),
            "east_south": 1j * recorded}  # fmt: skip


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("axes", ["ship", "north_east", "east_north", "east_south"])
def test_speeds_are_judged_to_be_in_the_axes_they_were_written_in(axes: str, seed: int) -> None:
    moves, heading = motion(seed)
    written = {
        "ship": moves * np.exp(-1j * np.deg2rad(heading)), "north_east": moves, "east_north": 1j * moves.conj(),
        "east_south": -1j * moves,
    }[axes]  # fmt: skip
    told, fits = find_velocity_axes(moves, speeds_in_each(moves, heading, written / 0.5144))
    assert told == axes
    assert fits[axes].factor == pytest.approx(0.5144)


def test_a_ship_that_heads_north_has_no_axes_to_tell() -> None:
    moves = np.full(50, 10.0 + 0.1j)
    assert find_velocity_axes(moves, speeds_in_each(moves, np.zeros(50), moves))[0] == ""
    assert keeps_its_course(moves)
    assert not keeps_its_course(motion(1)[0])
