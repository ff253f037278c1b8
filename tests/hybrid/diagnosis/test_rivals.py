"""Rivals of a named effect: each seen at its own size, and told as far as legs agree."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from seatrial.hybrid.diagnosis.acceptance import (
    CLOSE,
    Selection,
    accept,
    fitted_coordinates,
    linear_about,
    linearised_swaps,
    penalise_by_leg_scatter,
    rivals_of,
)
from seatrial.hybrid.diagnosis.linearise import ModelWithEffects, linearise
from seatrial.hybrid.diagnosis.regression import Evidence, evidence_of, normal_equations
from seatrial.hybrid.diagnosis.verdict import close_rivals
from seatrial.hybrid.effects import CATALOGUE
from seatrial.hybrid.vessel.plant import Plant
from tests.hybrid.diagnosis.log_by_hand import a_log, orders
from tests.hybrid.diagnosis.noisy_log import LEG_S, QUIET

PLAYS = ("backlash_port", "backlash_starboard", "backlash_both")
WIDTH_DEG = 5.0
SECONDS = 8 * LEG_S


@pytest.fixture(scope="module")
def mistaken(plant: Plant) -> Evidence:
    """A play in the starboard gear, both angles swinging almost alike; seen about the same play at port."""
    controls = orders(SECONDS)
    t = np.arange(len(controls)) / 4.0
    controls[:, 1] = 0.25 * np.sin(t / 7.0)
    controls[:, 3] = 0.25 * np.sin((t - 1.5) / 7.0)
    own = CATALOGUE["backlash_starboard"].apply(plant, {"width_deg": WIDTH_DEG})
    log = a_log(own, SECONDS, tuple(range(LEG_S, SECONDS, LEG_S)), controls=controls)
    error = np.random.default_rng(4).standard_normal(log.measured.shape) * QUIET.as_array()[:6]
    catalogue = {name: CATALOGUE[name] for name in (*PLAYS, "heading_bias", "hull_fouling")}
    bare = linearise(replace(log, measured=log.measured + error), ModelWithEffects(plant, catalogue), 0.01)
    evidence = linear_about(evidence_of(normal_equations(bare, QUIET)), {"backlash_port": (WIDTH_DEG,)})
    return linear_about(evidence, fitted_coordinates(evidence, ("backlash_port",)))


def test_a_rival_is_seen_at_its_own_size(mistaken: Evidence) -> None:
    """Linear about nothing, which is where it is about another, a play of some degrees is not what it is."""
    (swap,) = [each for each in linearised_swaps(mistaken, PLAYS[:1]) if each.rival == "backlash_starboard"]
    (width,) = fitted_coordinates(swap.evidence, swap.names)["backlash_starboard"]
    assert width == pytest.approx(WIDTH_DEG, abs=0.5)


@pytest.mark.slow
def test_the_likelier_of_two_plays_is_named(mistaken: Evidence) -> None:
    """Although the search, about the other one, prefers the other one."""
    assert rivals_of(mistaken, PLAYS[:1], "backlash_port").get("backlash_starboard", np.inf) > CLOSE
    at = fitted_coordinates(mistaken, PLAYS[:1])
    accepted = accept(Selection(PLAYS[:1], mistaken, at))
    assert accepted.names == ("backlash_starboard",)
    told = {each.name: each.evidence for each in close_rivals(accepted)}
    assert all(less > 0.0 for less in told.values())


def test_log_odds_count_as_they_are_where_legs_scatter_as_noise_does() -> None:
    said = np.array([4.0, 1.0, 3.0, 2.0, 6.0])
    assert penalise_by_leg_scatter(16.0, said, said) == 16.0
    assert penalise_by_leg_scatter(-3.0, -said, said) == -3.0
    assert penalise_by_leg_scatter(10.0, np.array([30.0, -20.0]), np.ones(2)) == 10.0  # too few legs to tell


@pytest.mark.parametrize("scatter", [1.0, 6.0])
def test_the_truth_is_seldom_thrown_out_where_legs_scatter(scatter: float) -> None:
    """The rival is right, and legs scatter by more than the noise that was estimated has it."""
    random, legs, each = np.random.default_rng(2), 14, 0.5
    draws = random.normal(-each, np.sqrt(2.0 * each * scatter), (2000, legs))
    thrown_out = np.mean(
        [penalise_by_leg_scatter(float(gains.sum()), gains, np.ones(legs)) > CLOSE for gains in draws]
    )
    plainly = np.mean(draws.sum(axis=1) > CLOSE)
    assert thrown_out <= 0.02
    assert thrown_out <= plainly
