"""The map: forces that were put into the truth are where the map says, as large as it says, and nowhere else."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as some

from seatrial.acquisition.core.ship import POSE_AND_VELOCITY
from seatrial.hybrid.diagnosis.linearise import ModelWithEffects, linearise
from seatrial.hybrid.diagnosis.map import (
    FORCES,
    LEAST_S,
    Map,
    cell_quantities,
    cells_of,
    map_of,
    notable_places,
    round_edges,
)
from seatrial.hybrid.diagnosis.regression import NormalEquations, normal_equations
from seatrial.hybrid.diagnosis.result import GapCell
from seatrial.hybrid.effects import CATALOGUE
from seatrial.hybrid.vessel.plant import Plant
from tests.hybrid.diagnosis.examination_by_hand import SMALL_CATALOGUE
from tests.hybrid.diagnosis.noisy_log import QUIET, noisy_log

MOMENT_NM = 2e5
YAW = {"yaw_asymmetry": CATALOGUE["yaw_asymmetry"]}


def examined(
    truth: Plant, plant: Plant, seed: int, at: Mapping[str, tuple[float, ...]] | None = None
) -> NormalEquations:
    """An examination of a trial of ``truth`` through ``plant`` with the effects ``at``."""
    return normal_equations(
        linearise(noisy_log(truth, seed), ModelWithEffects(plant, SMALL_CATALOGUE | YAW, at=at or {}), 0.005), QUIET
    )


@pytest.fixture(scope="module")
def turned(plant: Plant) -> NormalEquations:
    """A trial of a ship that a steady moment turns, seen through a model that has it."""
    at = {"yaw_asymmetry": (MOMENT_NM,)}
    return examined(plant.shifted(constant_N_nm=MOMENT_NM), plant, 1, at)


@pytest.fixture(scope="module")
def turned_map(turned: NormalEquations) -> Map:
    """Its map, of the model without what was added."""
    return map_of(turned)


def cells(made: Map, channel: str) -> list[GapCell]:
    """The map's cells of a channel."""
    return [each for each in made.places if each.channel == channel]


def test_a_steady_moment_is_in_every_cell_as_large_as_it_is(turned_map: Map) -> None:
    """Within four standard errors each, and on average within a tenth."""
    places = cells(turned_map, "yaw_moment_nm")
    assert len(places) > 20
    for each in places:
        assert abs(each.error - MOMENT_NM) < 4.0 * abs(each.error / each.z)
    assert np.mean([each.error for each in places]) == pytest.approx(MOMENT_NM, rel=0.1)


def test_a_steady_moment_is_no_force(turned_map: Map) -> None:
    """Ahead and across nothing is missing."""
    assert all(abs(each.z) < 4.0 for name in FORCES[:2] for each in cells(turned_map, name))


def test_state_space_shows_the_same(plant: Plant, turned_map: Map) -> None:
    """In a second the moment turns the ship by what her inertia lets it."""
    places = cells(turned_map, "yaw_rate_dps")
    rates = np.array([each.error for each in places])
    assert (rates > 0.0).all()
    assert max(each.z for each in places) > 4.0
    assert rates.max() / rates.min() < 3.0


def test_the_reconstructed_force_agrees_with_the_cells(turned_map: Map) -> None:
    """Two ways to the same moment."""
    assert np.median(turned_map.force[:, 2]) == pytest.approx(MOMENT_NM, rel=0.15)


def test_repaired_nothing_is_left(turned: NormalEquations) -> None:
    """With the moment in the model its map is empty."""
    assert all(abs(each.z) < 4.0 for each in map_of(turned, with_effects=True).places)


def test_where_is_the_notable_part_of_the_reference_models_map(turned: NormalEquations, turned_map: Map) -> None:
    """The surest first, all beyond chance."""
    found = notable_places(map_of(turned).places)
    assert found == notable_places(turned_map.places)
    assert [abs(each.z) for each in found] == sorted((abs(each.z) for each in found), reverse=True)
    assert {each.channel for each in found} <= {"yaw_moment_nm", "yaw_rate_dps", "heading_deg", "sway_mps"}


@pytest.mark.parametrize("seed", [11, 12])
def test_a_right_model_has_an_empty_map(plant: Plant, seed: int) -> None:
    """Noise alone puts nothing on the map."""
    assert max(abs(each.z) for each in map_of(examined(plant, plant, seed)).places) < 4.0


def test_seconds_are_counted(turned_map: Map) -> None:
    """A cell counts its seconds, and the quarters of time are all of them."""
    quarters = [each for each in cells(turned_map, "surge_force_n") if "time_s" in each.cell]
    assert sum(each.windows for each in quarters) == len(turned_map.force)
    assert {each.channel for each in turned_map.places} == {*FORCES, *POSE_AND_VELOCITY}


@given(some.lists(some.floats(-30.0, 30.0), min_size=60, max_size=60))
def test_notable_keeps_ten_and_at_most_forty(z: list[float]) -> None:
    """All that is sure up to forty, and of any map the ten largest."""
    places = [GapCell("surge_force_n", {"speed_mps": (0.0, 1.0)}, 30, 1.0, each) for each in z]
    kept = notable_places(places)
    assert 10 <= len(kept) <= 40
    assert min(abs(each.z) for each in kept) >= sorted(map(abs, z), reverse=True)[len(kept) - 1] - 1e-12


@given(some.floats(-50.0, 50.0), some.floats(0.0, 100.0), some.sampled_from([0.25, 2.0, 5.0]))
def test_edges_are_round_and_no_narrower_than_they_may_be(low: float, width: float, finest: float) -> None:
    """Equal steps inside the range, a handful."""
    edges = round_edges(low, low + width, finest)
    assert len(edges) <= 6
    assert ((edges > low) & (edges < low + width)).all()
    if len(edges) > 1:
        steps = np.diff(edges)
        assert steps == pytest.approx(np.full(len(steps), steps[0]))
        assert steps[0] >= finest - 1e-9


def test_the_cells_of_a_quantity_share_no_second(plant: Plant) -> None:
    """And together hold every second of those large enough."""
    log = noisy_log(plant, 1)
    found = cells_of(log, log.nominal)
    for quantity in {each.quantity for each in found}:
        rows = np.sum([each.rows for each in found if each.quantity == quantity], axis=0)
        assert rows.max() == 1
        if quantity not in ("place", "heading_deg", "relative_wind_deg"):
            known = np.isfinite(cell_quantities(log, log.nominal)[quantity])
            assert rows[known].sum() > known.sum() - 4 * LEAST_S


def test_a_ship_at_rest_has_no_drift_angle_and_still_air_no_direction(plant: Plant) -> None:
    """What means nothing is in no cell."""
    log = noisy_log(plant, 1, legs=1)
    rest, calm = np.zeros_like(log.nominal), replace(log, wind=np.zeros_like(log.wind))
    assert not {"drift_angle_deg", "relative_wind_deg"} & {each.quantity for each in cells_of(calm, rest)}
