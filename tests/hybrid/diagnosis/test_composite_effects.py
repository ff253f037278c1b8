"""Two named effects that may be one which the catalogue lacks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from seatrial.hybrid.diagnosis.acceptance import Acceptance, LackOfFit, composite_effects
from seatrial.hybrid.diagnosis.linearise import ModelWithEffects
from seatrial.hybrid.diagnosis.regression import OPERATION, Evidence, evidence_of
from seatrial.hybrid.diagnosis.verdict import _composite_groups
from seatrial.hybrid.effects import CATALOGUE
from seatrial.hybrid.vessel.plant import Plant
from tests.hybrid.diagnosis.examination_by_hand import Design, a_design

BOTH = ("thrust_loss_port", "thrust_loss_starboard")


@pytest.fixture(scope="module")
def design(plant: Plant) -> Design:
    return a_design(plant, 4, 7)


def seen(design: Design, *names: str) -> Evidence:
    """A view of these effects with signatures at random, but that of a loss at both pods is the sum of two."""
    random = np.random.default_rng(8)
    columns = {name: random.standard_normal((500, len(CATALOGUE[name].free_scale))) for name in names}
    if "thrust_loss_both" in columns:
        columns["thrust_loss_both"] = sum(columns[name] for name in BOTH) + 0.1 * columns["thrust_loss_both"]
    every = np.hstack([np.zeros((500, 1)), *columns.values()])
    equations = design.equations(design.data(random))
    effect = tuple(name for name in names for _ in CATALOGUE[name].free_scale)
    catalogue = {name: CATALOGUE[name] for name in names}
    return Evidence(
        every.T @ every,
        replace(
            equations,
            model=ModelWithEffects(design.plant, catalogue),
            layout=replace(equations.layout, effect=effect, prior=np.ones(len(effect))),
        ),
    )


def test_a_loss_at_either_pod_may_be_one_where_the_catalogue_has_no_loss_at_both(design: Design) -> None:
    assert composite_effects(seen(design, *BOTH, "wake_fraction"), BOTH) == [BOTH]


def test_where_it_has_one_that_was_tried(design: Design) -> None:
    assert composite_effects(seen(design, *BOTH, "thrust_loss_both"), BOTH) == []


@pytest.mark.parametrize(
    "pair",
    [
        ("ocean_current", "wave_drift"),
        ("heading_bias", "sway_bias"),
        ("hull_lengthening", "hull_fouling"),
        ("hull_fouling", "wake_fraction"),
        ("position_delay", "thruster_lag"),
        ("ocean_current", "heading_bias"),
        ("wave_drift", "wind_side_load"),
    ],
)
def test_what_comes_together_anyway_or_has_nothing_to_do_with_each_other_stays_two(
    design: Design, pair: tuple[str, str]
) -> None:
    assert composite_effects(seen(design, *pair), pair) == []


def test_two_clocks_may_be_the_third(design: Design) -> None:
    pair = ("position_delay", "heading_delay")
    assert composite_effects(seen(design, *pair), pair) == [pair]


def test_factors_on_the_wind_may_be_the_one_on_what_is_left(design: Design) -> None:
    names = ("wind_yaw_load", "wind_drag", "wind_load")
    assert composite_effects(seen(design, *names), names) == [names]


def test_what_hangs_together_is_one_group_in_the_order_of_names(design: Design) -> None:
    names = ("sway_added_mass", "ocean_current", "loading", "surge_added_mass")
    assert composite_effects(seen(design, *names), names) == [("sway_added_mass", "loading", "surge_added_mass")]


def test_more_of_one_family_than_a_model_is_likely_to_lack_may_be_one(design: Design) -> None:
    """Though no two of them are alike; three are three."""
    names = ("hull_fouling", "cross_flow_drag", "drift_force", "turning_drag")
    evidence = seen(design, *names, "ocean_current")
    assert composite_effects(evidence, (*names[:3], "ocean_current")) == []
    assert composite_effects(evidence, (*names, "ocean_current")) == [names]


@pytest.mark.parametrize(("depends", "what", "told"), [("drift", "drift_force", True), (OPERATION, "force", False)])
def test_many_of_one_family_beside_a_remainder_may_be_one_unless_the_model_is_far_off(
    design: Design, depends: str, what: str, told: bool
) -> None:
    """Where the model's forces err by half their range many coefficients are wrong, and each name may be right."""
    names = ("hull_fouling", "cross_flow_drag", "drift_force", "turning_drag")
    remainder = LackOfFit(depends, what, 1e-6, 30.0, 0.5, True)
    first = Acceptance(names, {}, seen(design, *names), lack_of_fit=(remainder,))
    assert _composite_groups(first, first) == ([names] if told else [])


def test_a_view_of_data_has_what_it_takes(design: Design) -> None:
    evidence = evidence_of(design.equations(design.data(np.random.default_rng(9))))
    assert composite_effects(evidence, ("ocean_current", "hull_fouling")) == []
