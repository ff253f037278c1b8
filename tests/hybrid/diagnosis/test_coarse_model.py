"""Effects of a coarse model: found part by part, named beside what remains, and predictions come closer."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from seatrial.hybrid.diagnosis.acceptance import Acceptance, LackOfFit
from seatrial.hybrid.diagnosis.coarse_model import (
    improves_prediction,
    is_coarse,
    replications,
)
from seatrial.hybrid.diagnosis.few_causes import chance_of_closer
from seatrial.hybrid.diagnosis.regression import OPERATION, Evidence, evidence_of
from seatrial.hybrid.diagnosis.result import Replication
from seatrial.hybrid.diagnosis.verdict import diagnose
from seatrial.hybrid.simulation.trial import simulate_trial
from seatrial.hybrid.vessel.files import load_vessel
from seatrial.hybrid.vessel.hulls.polynomial import NUMBERS
from seatrial.hybrid.vessel.plant import Plant
from tests.hybrid.diagnosis.examination_by_hand import a_design

PARTS = [np.arange(8) % 4 == part for part in range(4)]


def parts_of(evidence: Evidence) -> list[Evidence]:
    """Two legs each."""
    equations = evidence.equations
    return [evidence_of(replace(equations, gram=equations.gram[legs])) for legs in PARTS]


def test_what_is_there_throughout_is_found_in_every_part_and_what_changes_sign_is_not(plant: Plant) -> None:
    design = a_design(plant, 8, 71, sigmas=60.0)
    data = design.data(np.random.default_rng(72), {"heading_bias": (1.5,)})
    turning = design.columns[:, :, design.layout.columns_of("sway_bias")[0]]
    data += 0.3 * np.where(PARTS[1] | PARTS[2], -1.0, 1.2)[:, None] * turning
    evidence = evidence_of(design.equations(data))
    found = replications(evidence, ("heading_bias", "sway_bias"), parts_of(evidence))
    assert (found["heading_bias"].parts, found["heading_bias"].found) == (4, 4)
    assert found["sway_bias"].found == 2


def test_nothing_replicates_of_nothing(plant: Plant) -> None:
    design = a_design(plant, 8, 73)
    evidence = evidence_of(design.equations(design.data(np.random.default_rng(74))))
    assert replications(evidence, (), parts_of(evidence)) == {}
    assert replications(evidence, ("yaw_inertia",), parts_of(evidence))["yaw_inertia"].found < 4


def test_parts_in_which_an_effect_would_not_show_say_nothing_of_it(plant: Plant) -> None:
    design = a_design(plant, 8, 71, sigmas=60.0)
    equations = design.equations(design.data(np.random.default_rng(72), {"heading_bias": (1.5,)}))
    gram, own = equations.gram.copy(), design.layout.columns_of("heading_bias")
    silent = np.flatnonzero(PARTS[2] | PARTS[3])
    for column in own:
        gram[silent, column, :] = gram[silent, :, column] = 0.0
    evidence = evidence_of(replace(equations, gram=gram))
    assert replications(evidence, ("heading_bias",), parts_of(evidence)) == {"heading_bias": Replication(2, 2)}


@pytest.mark.parametrize(("depends", "times", "coarse"), [
    (OPERATION, 8.0, True), (OPERATION, 2.0, False), ("heading", 8.0, False),
])  # fmt: skip
def test_only_a_model_whose_own_forces_are_far_off_is_coarse(
    plant: Plant, depends: str, times: float, coarse: bool
) -> None:
    """What depends on heading, place or time is no error of coefficients: it may be anything."""
    evidence = evidence_of(a_design(plant, 8, 75).equations(np.zeros((8, 60))))
    left = LackOfFit(depends, "force", 1e-9, 90.0, times * evidence.equations.tolerance, matters=True)
    assert is_coarse(Acceptance((), {}, evidence, lack_of_fit=(left,))) == coarse


def test_closer_on_all_legs_but_the_worst_is_closer() -> None:
    """A leg counts by its ratio, in whatever unit it is measured; but the mean distance has to be smaller, too."""
    before_m = np.array([0.055, 0.079, 0.068, 0.077, 0.076, 0.226, 0.085, 0.127])
    after_m = before_m * np.array([0.7, 0.8, 0.72, 0.7, 0.8, 1.1, 0.75, 0.7])
    assert improves_prediction(before_m, after_m)
    assert not improves_prediction(before_m, np.where(before_m > 0.2, 2.0, 0.7) * before_m)
    units = np.array([1.0, 10.0, 3.3, 0.1, 1.0, 0.01, 2.0, 5.0])
    assert chance_of_closer(units * before_m, units * after_m) == pytest.approx(chance_of_closer(before_m, after_m))


@pytest.mark.slow
def test_a_ship_with_other_coefficients_than_her_model_gets_names_that_bring_predictions_closer() -> None:
    """Every coefficient of the hull off by up to 40 % at random."""
    model = load_vessel("gunnerus_long")
    random = np.random.default_rng(76)
    hull = {name: getattr(model.hull, name) * random.uniform(0.6, 1.4) for name in NUMBERS}
    table, _ = simulate_trial(
        replace(model, hull=replace(model.hull, **hull)), "calm", "programme", 1800.0, seed=77
    )
    conclusion = diagnose([table], model)
    assert conclusion.accepted.names
    assert conclusion.verdict in ("named", "indistinguishable")
    assert conclusion.gap.gap.after_m < 0.75 * conclusion.gap.gap.before_m
