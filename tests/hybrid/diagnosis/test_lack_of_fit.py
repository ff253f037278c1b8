"""What remains beyond the catalogue: chances that are what they say, and shapes that are found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binom

from seatrial.acquisition.core.quantities import Floats
from seatrial.hybrid.diagnosis.acceptance import (
    INTERACTION_CHANCE,
    Acceptance,
    LackOfFit,
    drop_doubtful,
    lack_of_fit,
    lack_of_fit_that_matters,
    nuisance_families,
)
from seatrial.hybrid.diagnosis.regression import INTERACTIONS, evidence_of
from seatrial.hybrid.vessel.plant import Plant
from tests.hybrid.diagnosis.examination_by_hand import SMALL_CATALOGUE, Design, a_design, with_columns

DRAWS = 100


@pytest.fixture(scope="module")
def design(plant: Plant) -> Design:
    """Eight legs."""
    return a_design(plant, 8, 51)


def judged(design: Design, data: Floats, names: tuple[str, ...] = ()) -> list[LackOfFit]:
    """What remains of these data beside effects of these names."""
    return lack_of_fit(evidence_of(design.equations(data)), names)


@pytest.mark.parametrize("names", [(), ("ocean_current", "sway_bias")])
def test_chances_of_families_are_what_they_say(design: Design, names: tuple[str, ...]) -> None:
    """Nothing beyond what is granted: each family's chance, times their number, is uniform below one."""
    effects = {"ocean_current": (0.2, 0.1), "sway_bias": (0.1,)} if names else {}
    random = np.random.default_rng(52)
    results = [judged(design, design.data(random, effects), names) for _ in range(DRAWS)]
    number = len(results[0])
    for family in nuisance_families(design.equations(design.data(random))):
        chances = np.array([
            each.p_value for result in results for each in result
            if (each.depends, each.what) == (family.depends, family.what)
        ])  # fmt: skip
        assert len(chances) == DRAWS
        for level in (0.3, 1.0 - 1e-9):
            low, high = binom.ppf([1e-5, 1.0 - 1e-5], DRAWS, level / number)
            assert low <= (chances < level).sum() <= high
    anything = sum(min(each.p_value for each in result) < 0.05 for result in results)
    assert anything <= binom.ppf(0.9999, DRAWS, 0.05)


def test_a_family_that_is_there_is_the_first_and_has_its_size(design: Design) -> None:
    data, random = design.data(np.random.default_rng(53)), np.random.default_rng(54)
    column = design.layout.nuisance_forces(2)[1]  # in yaw, on heading
    size = 40.0
    first = judged(design, data + size * design.columns[:, :, column])[0]
    assert (first.depends, first.what) == ("heading", "yaw")
    assert first.is_significant
    assert first.size == pytest.approx(size * 1e4, rel=0.2)  # in N m; the filter reckons in 10 kN m
    column = design.layout.nuisance_forces(0)[4]
    first = judged(design, design.data(random) - size * design.columns[:, :, column])[0]
    assert (first.depends, first.what) == ("time", "surge")


def test_a_bias_that_drifts_is_found_as_such(design: Design) -> None:
    data = design.data(np.random.default_rng(55))
    first = judged(design, data + 1.0 * design.columns[:, :, design.layout.first_varying])[0]
    assert (first.depends, first.what) == ("time", "heading_bias")
    assert first.size == pytest.approx(1.0, rel=0.3)
    assert first.is_significant


def test_a_bias_that_drifts_by_nothing_that_matters_is_not_found(plant: Plant) -> None:
    long = a_design(plant, 8, 56, sigmas=2000.0)
    data = long.data(np.random.default_rng(57)) + 0.1 * long.columns[:, :, long.layout.first_varying]
    drifts = next(each for each in judged(long, data) if each.what == "heading_bias")
    assert drifts.p_value < 1e-3
    assert not drifts.is_significant


def test_named_effects_take_their_part_away(design: Design) -> None:
    """An effect fitted beside the families leaves them as they are; not fitted, they share it."""
    data = design.data(np.random.default_rng(58))
    with_current = data + design.columns[:, :, design.layout.columns_of("ocean_current")[0]] * 0.5
    before, after = (judged(design, each, ("ocean_current",)) for each in (data, with_current))
    for one, other in zip(before, after, strict=True):
        assert (one.depends, one.what) == (other.depends, other.what)
        assert other.gain == pytest.approx(one.gain, rel=1e-4, abs=1e-6)


def test_a_model_that_is_off_by_more_than_granted_is_told_so(design: Design) -> None:
    """Forces of speeds and thrusters fifteen times what is granted, each feature's drawn anew."""
    random = np.random.default_rng(59)
    features = np.concatenate([design.layout.feature_columns(axis) for axis in range(3)])
    data = design.data(random) + design.columns[:, :, features] @ (30.0 * random.standard_normal(len(features)))
    off = next(each for each in judged(design, data) if each.depends == "operating point")
    assert off.is_significant
    assert off.size == pytest.approx(0.15, rel=0.5)  # of twelve features: known to some 20 %


@pytest.fixture(scope="module")
def doubted(plant: Plant) -> Design:
    """A bias whose form is in question: of that it is granted nothing."""
    design = a_design(plant, 8, 60)
    layout = design.layout
    varied = tuple(f"sway_bias*{name}" for name in INTERACTIONS[:2])
    rest = ~np.isin(design.nuisance, np.arange(2) + layout.first_varying)
    return replace(
        design, layout=replace(layout, varying=varied, varying_tolerated=np.zeros(2)),
        nuisance=design.nuisance[rest],
        scale=design.scale[rest],
    )  # fmt: skip


def forms(design: Design, data: Floats) -> list[LackOfFit]:
    return [each for each in judged(design, data, ("sway_bias",)) if each.depends in INTERACTIONS]


def test_an_effect_that_is_named_rightly_seldom_seems_to_have_another_form(doubted: Design) -> None:
    random, draws = np.random.default_rng(61), 300
    wrong = 0
    for _ in range(draws):
        found = forms(doubted, doubted.data(random, {"sway_bias": (0.5,)}))
        assert len(found) == 2
        wrong += any(each.is_significant for each in found)
    assert wrong <= binom.ppf(0.9999, draws, INTERACTION_CHANCE)


def test_another_form_is_found_however_small_it_is(doubted: Design) -> None:
    """Half of the smallest bias that matters."""
    size = 0.5 * SMALL_CATALOGUE["sway_bias"].smallest_free[0]
    column = doubted.layout.first_varying + 1
    clear = 6.0 / np.linalg.norm(doubted.columns[:, :, column])
    columns = doubted.columns.copy()
    columns[:, :, column] *= clear / size  # it stands out by six standard deviations
    known = with_columns(doubted, columns)
    data = known.data(np.random.default_rng(62), {"sway_bias": (0.5,)}) + size * columns[:, :, column]
    first = forms(known, data)[0]
    assert (first.what, first.depends) == ("sway_bias", INTERACTIONS[1])
    assert first.size == pytest.approx(size, rel=0.5)
    assert first.is_significant


@pytest.mark.parametrize(("current_mps", "is_clear"), [(2.5, True), (0.1, False)])
def test_a_name_of_another_form_takes_those_with_it_beside_which_it_matters_and_no_others(
    doubted: Design, current_mps: float, is_clear: bool
) -> None:
    """A bias that varies, beside a current that explains hundreds of times as much, or about as much."""
    column = doubted.layout.first_varying + 1
    drifting = 0.2 * doubted.columns[:, :, column]
    data = doubted.data(np.random.default_rng(63), {"ocean_current": (current_mps, 0.0), "sway_bias": (0.05,)})
    found = Acceptance(("ocean_current", "sway_bias"), {}, evidence_of(doubted.equations(data + drifting)))
    found = replace(found, lack_of_fit=lack_of_fit_that_matters(found))
    assert [lack.what for lack in found.lack_of_fit] == ["sway_bias"]
    rest = drop_doubtful(found)
    if is_clear:
        assert (rest.names, rest.doubtful, rest.lack_of_fit) == (("ocean_current",), ("sway_bias",), ())
        assert rest.coordinates["ocean_current"][0] == pytest.approx(current_mps, rel=0.05)
    else:
        assert rest == found
