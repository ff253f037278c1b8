"""Verdicts: one word for what is named, tied and left over."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seatrial.hybrid.diagnosis.acceptance import LackOfFit, acceptance_tests
from seatrial.hybrid.diagnosis.gap import unseen_windows
from seatrial.hybrid.diagnosis.linearise import ModelWithEffects
from seatrial.hybrid.diagnosis.regression import OPERATION
from seatrial.hybrid.diagnosis.verdict import (
    drop_non_predictive,
    estimates_from_coordinates,
    find_contradictions,
    makes_worse,
    verdict_of,
)
from seatrial.hybrid.effects import CATALOGUE, FAMILIES
from seatrial.hybrid.report.diagnosis import unknown_cause
from seatrial.hybrid.vessel.plant import Plant
from tests.hybrid.diagnosis.noisy_log import QUIET, noisy_log

SHEAR = LackOfFit("place", "ocean_current", 1e-9, 80.0, 0.2, matters=True)
FADING = LackOfFit("time", "surge", 1e-7, 60.0, 1800.0, matters=True)


def test_one_word_for_it() -> None:
    unknown = unknown_cause([SHEAR], [], 0.4)
    assert verdict_of((), [], unknown=False) == "nothing_missing"
    assert verdict_of(("skeg",), [], unknown=False) == "named"
    assert verdict_of(("skeg",), [("skeg", "trim")], unknown=False) == "indistinguishable"
    assert verdict_of(("skeg",), [("skeg", "trim")], unknown=unknown is not None) == "unknown"
    assert verdict_of((), [], unknown=unknown is not None) == "unknown"


def test_what_remains_is_said_with_its_size_and_what_it_hangs_on() -> None:
    unknown = unknown_cause([SHEAR, FADING], [CATALOGUE["skeg"]], 0.4)
    assert unknown is not None
    assert unknown.where == ("place", "time")
    assert "ocean current that varies with the place" in unknown.looks_like
    assert "surge force of some 1,800 N that varies with time" in unknown.looks_like


def test_of_several_signs_of_another_form_the_strongest_is_told() -> None:
    thrust, drift = (
        LackOfFit(depends, "hull_fouling", chance, 50.0, 0.03, matters=True)
        for depends, chance in (("thrust", 1e-9), ("drift", 1e-3))
    )
    unknown = unknown_cause([thrust, drift, FADING], [CATALOGUE["hull_fouling"]], 0.4)
    assert unknown is not None
    assert unknown.where == ("thrust", "time")
    assert "hull fouling that varies with the thrust ahead: more likely a similar effect" in unknown.looks_like


@given(st.permutations(sorted(CATALOGUE)), st.integers(0, 6))
def test_many_effects_at_once_are_rather_one_unknown(names: list[str], count: int) -> None:
    """Three together are believed; more are what imitates one that the catalogue lacks."""
    effects = [CATALOGUE[name] for name in names[:count]]
    unknown = unknown_cause([], effects, 0.1)
    assert (unknown is not None) == (count > 3)
    if unknown is not None:
        assert unknown.where == (OPERATION,)
        said = {family for family in FAMILIES if family in unknown.looks_like}
        assert said == {each.family for each in effects}


@pytest.mark.parametrize("name", CATALOGUE)
def test_intervals_hold_the_value_and_stay_within_bounds(name: str) -> None:
    effect = CATALOGUE[name]
    free, size = np.array(effect.free_coordinates(effect.typical_values)), np.array(effect.free_scale)
    found = estimates_from_coordinates(effect, free, np.diag((0.3 * size) ** 2))
    for each in effect.parameters:
        estimate = found[each.name]
        assert estimate.low <= estimate.value <= estimate.high
        assert estimate.value == pytest.approx(effect.typical_values[each.name], rel=1e-6)


def test_an_error_of_a_sensor_is_named_where_it_predicts_legs_left_out(plant: Plant) -> None:
    """A compass that is off shows in every leg; a bias beside it that is not there is left out."""
    log = noisy_log(CATALOGUE["heading_bias"].apply(plant, {"angle_deg": 3.0}), 3)
    model = ModelWithEffects(plant, CATALOGUE)
    sensors = find_contradictions(log, model, QUIET)
    assert sensors is not None
    assert sensors.names == ("heading_bias",)
    both = (*sensors.names, "sway_bias")
    tests = {name: acceptance_tests(sensors.evidence, both, name) for name in both}
    named = drop_non_predictive(replace(sensors, names=both, tests=tests), unseen_windows(log, model))
    assert named is not None
    assert (named.names, list(named.tests)) == (("heading_bias",), ["heading_bias"])


def test_a_name_with_which_legs_left_out_are_predicted_worse_is_withdrawn(plant: Plant) -> None:
    log = noisy_log(CATALOGUE["heading_bias"].apply(plant, {"angle_deg": 3.0}), 3)
    windows = unseen_windows(log, ModelWithEffects(plant, CATALOGUE))
    folds = set(windows.fold.tolist())
    for degrees, worse in ((3.0, False), (0.0, False), (-3.0, True)):
        assert makes_worse(windows, {fold: {"heading_bias": (degrees,)} for fold in folds}) == worse
