"""What a trial says of effects: oracles for the algebra, physics for the limits, and limits against trials."""

from __future__ import annotations

from dataclasses import replace
from math import inf

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import norm, t

from seatrial.hybrid.diagnosis.acceptance import accept_names, select_effects
from seatrial.hybrid.diagnosis.disturbance_model import DisturbanceNoise
from seatrial.hybrid.diagnosis.estimate_noise import estimate_noise
from seatrial.hybrid.diagnosis.linearise import ModelWithEffects, linearise, model_of
from seatrial.hybrid.diagnosis.log import log_of
from seatrial.hybrid.diagnosis.planning import (
    Information,
    as_parameter,
    design_of,
    detection_limits,
    information_of,
    least_separation,
    noncentrality,
    predicted_limit,
    rehearse,
    separation,
)
from seatrial.hybrid.diagnosis.regression import NormalEquations, normal_equations, weigh_evidence
from seatrial.hybrid.effects import CATALOGUE, catalogue_of_actuators, vessel_plant
from seatrial.hybrid.simulation.manoeuvres import turning_circle, zigzag
from seatrial.hybrid.simulation.trial import SeaState, simulate_trial
from seatrial.hybrid.vessel.files import Vessel, load_vessel
from seatrial.hybrid.vessel.plant import Plant

CALM = SeaState(5.0, 0.0, 5.0, 0.0)
SOME = {
    name: CATALOGUE[name]
    for name in ("hull_fouling", "thrust_loss_both", "ocean_current", "heading_bias", "tunnel_thrust_loss")
}


def examination_at(plant: Plant, vessel: Vessel, tolerance: float) -> NormalEquations:
    log = rehearse(zigzag(swings=12), vessel, plant, CALM, 600)
    return normal_equations(linearise(log, ModelWithEffects(plant, SOME), tolerance), DisturbanceNoise())


@pytest.fixture(scope="module")
def equations(plant: Plant, vessel: Vessel) -> NormalEquations:
    return examination_at(plant, vessel, 0.01)


def by_hand(seed: int) -> Information:
    """Some information matrix of one effect with two coordinates and two with one."""
    some = np.random.default_rng(seed).standard_normal((9, 4))
    names = ("ocean_current", "heading_bias", "hull_fouling")
    columns = dict(zip(names, (np.array([0, 1]), np.array([2]), np.array([3])), strict=True))
    return Information(some.T @ some, columns, {name: CATALOGUE[name] for name in names})


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000), st.floats(0.1, 3.0), st.floats(-3.0, 3.0))
def test_separation_is_what_the_best_imitation_leaves(seed: int, north: float, east: float) -> None:
    information = by_hand(seed)
    root = np.linalg.cholesky(information.matrix).T
    signal = root[:, :2] @ [north, east]
    for others in ((2,), (2, 3)):
        rest = signal - root[:, others] @ np.linalg.lstsq(root[:, others], signal, rcond=None)[0]
        beside = ("hull_fouling",) if len(others) == 2 else ()
        found = separation(information, "ocean_current", "heading_bias", (north, east), beside)
        assert found == pytest.approx(float(rest @ rest), rel=1e-5, abs=1e-6)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000))
def test_told_apart_is_the_worst_direction(seed: int) -> None:
    information = by_hand(seed)
    scale = CATALOGUE["ocean_current"].free_scale[0]
    angles = np.linspace(0.0, np.pi, 181)
    sizes = [(scale * np.cos(a), scale * np.sin(a)) for a in angles]
    every = [separation(information, "ocean_current", "heading_bias", size) for size in sizes]
    assert least_separation(information, "ocean_current", "heading_bias") == pytest.approx(
        min(every), rel=1e-2, abs=1e-4
    )
    one = separation(information, "hull_fouling", "heading_bias", CATALOGUE["hull_fouling"].free_scale)
    assert least_separation(information, "hull_fouling", "heading_bias") == pytest.approx(one, rel=1e-5, abs=1e-6)


def test_noncentrality_of_one_coordinate_is_that_of_a_normal_variate() -> None:
    threshold = 15.1
    root = np.sqrt(noncentrality(threshold, 1))
    edge = np.sqrt(threshold)
    assert norm.sf(edge - root) + norm.cdf(-edge - root) == pytest.approx(0.9, abs=1e-4)
    assert noncentrality(threshold, 1, 0.5) == pytest.approx(threshold, rel=1e-3)


def test_legs_put_together_say_what_the_whole_says(equations: NormalEquations) -> None:
    whole, design = information_of(equations), design_of(equations)
    again = design.information(range(equations.log.leg_count))
    spoken = np.diag(whole.matrix) > 0.0
    assert np.diag(again.matrix)[spoken] == pytest.approx(np.diag(whole.matrix)[spoken], rel=0.02)


def test_another_leg_never_takes_information_away(equations: NormalEquations) -> None:
    design = design_of(equations)
    for leg in range(1, equations.log.leg_count):
        more = design.information(range(leg + 1)).matrix - design.information(range(leg)).matrix
        scale = np.sqrt(np.maximum(np.diag(design.information(range(equations.log.leg_count)).matrix), 1e-12))
        assert np.linalg.eigvalsh(more / np.outer(scale, scale)).min() > -1e-6


def test_what_was_not_used_is_not_seen(equations: NormalEquations) -> None:
    found = detection_limits(equations)
    assert found["tunnel_thrust_loss"] == inf
    assert 0.0 < found["hull_fouling"] < 1.0


def test_a_compass_is_off_by_something_anyway(equations: NormalEquations) -> None:
    granted = CATALOGUE["heading_bias"].parameters[0].tolerance
    assert detection_limits(equations)["heading_bias"] > 4.0 * granted


def test_who_grants_the_model_more_sees_less(plant: Plant, vessel: Vessel, equations: NormalEquations) -> None:
    strict, loose = detection_limits(equations), detection_limits(examination_at(plant, vessel, 0.03))
    assert all(loose[name] >= 0.97 * strict[name] for name in SOME)
    assert loose["hull_fouling"] > 1.5 * strict["hull_fouling"]


def test_a_limit_is_within_the_bounds_of_its_parameter() -> None:
    assert as_parameter(CATALOGUE["thrust_loss_both"], 2.0) == inf
    assert as_parameter(CATALOGUE["shallow_water"], 10.0) == 0.0
    assert as_parameter(CATALOGUE["shallow_water"], 0.01) == pytest.approx(10.0)


def test_what_one_leg_alone_shows_is_not_predicted_by_the_others() -> None:
    information = by_hand(1)
    even, one = np.full((12, 1, 1), 3.0), np.zeros((12, 1, 1))
    one[4] = 36.0
    assert predicted_limit(information, "hull_fouling", one) == inf
    assert predicted_limit(information, "hull_fouling", even) < inf


def test_gains_on_unseen_legs_pass_their_test_in_nine_of_ten_at_the_limit() -> None:
    legs = np.geomspace(0.2, 5.0, 20)[:, None, None]
    size = predicted_limit(by_hand(1), "hull_fouling", legs)
    each = legs[:, 0, 0]
    scores = size * each + np.sqrt(each) * np.random.default_rng(3).standard_normal((5000, 20))
    gains = size * scores - 0.5 * size**2 * each
    scaled = gains / (size * np.sqrt(each))
    chance = t.sf(scaled.mean(axis=1) / (scaled.std(axis=1, ddof=1) / np.sqrt(20)), 19)
    assert np.mean(chance < 0.05) == pytest.approx(0.9, abs=0.04)


@pytest.mark.slow
def test_an_effect_a_little_over_its_limit_is_found(plant: Plant) -> None:
    """At 1.2 times the limit in nine of ten; 20 trials may show 16 by chance."""
    model, sea = ModelWithEffects(plant, CATALOGUE), SeaState(4.0, 0.5, 5.0, 0.0, drift_n_per_m2=0.0)
    table, _ = simulate_trial("gunnerus_short", sea, "programme", 1500.0, 1.0, 0)
    estimate = estimate_noise(linearise(log_of([table]), model, 0.01))
    limit = detection_limits(normal_equations(estimate.linearisation, estimate.noise))
    names = [name for name in CATALOGUE if limit[name] < 3.0 * CATALOGUE[name].free_scale[0]]
    names = [name for name in names if CATALOGUE[name].chart == "linear"][::2][:20]
    missed = []
    for number, name in enumerate(names, start=1):
        effect = CATALOGUE[name]
        size = effect.values_at([1.2 * limit[name], *(0.0,) * (len(effect.free_scale) - 1)])
        table, _ = simulate_trial("gunnerus_short", sea, "programme", 1500.0, 1.0, number, {name: size})
        estimate = estimate_noise(linearise(log_of([table]), model, 0.01))
        if not accept_names(select_effects(weigh_evidence(estimate))).names:
            missed.append(name)
    assert len(missed) <= 0.2 * len(names), missed


def test_rehearsal_is_of_the_ship_that_is_rehearsed() -> None:
    """With the controls of her own actuators, whatever their number; her own effects are linear about it."""
    hull = load_vessel("gunnerus_short")
    port, starboard, _ = hull.actuator
    fore = replace(port, name="fore", x_m=10.0, y_m=0.0)
    ship = replace(hull, base="", actuator=(fore, replace(port, name="left"), replace(starboard, name="right")))
    log = rehearse(turning_circle(20.0), ship, vessel_plant(ship), CALM, 60)
    assert log.actuators == ship.actuators
    assert log.controls.shape[-1] == 6
    found = linearise(log, model_of(ship, catalogue_of_actuators(ship.actuators)), 0.01)
    assert "thrust_loss_fore" in {each.effect for each in found.effects}
