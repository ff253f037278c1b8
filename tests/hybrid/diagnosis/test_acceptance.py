"""Naming on columns whose truth is known: the right set, bounds, units, and chances that are what they say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binom, chi2, kstest

from seatrial.acquisition.core.quantities import Floats
from seatrial.hybrid.diagnosis.acceptance import (
    FALSE_ALARM,
    Coordinates,
    fitted_coordinates,
    linear_about_itself,
    log_density,
    rivals_of,
    search_effects,
    unseen_gains,
    with_likely_model_error,
)
from seatrial.hybrid.diagnosis.acceptance import acceptance_tests as stands
from seatrial.hybrid.diagnosis.linearise import ModelWithEffects
from seatrial.hybrid.diagnosis.regression import Evidence, evidence_of
from seatrial.hybrid.diagnosis.verdict import rank_effects
from seatrial.hybrid.vessel.plant import Plant
from tests.hybrid.diagnosis.examination_by_hand import (
    SMALL_CATALOGUE,
    Design,
    a_design,
    in_other_units,
    with_columns,
)

Effects = dict[str, tuple[float, ...]]
CURRENT, BIAS, LOSS = (0.2, -0.1), (1.2,), (-0.12,)
SETS: tuple[Effects, ...] = (
    {},
    {"heading_bias": BIAS},
    {"ocean_current": CURRENT, "thrust_loss_port": LOSS},
    {"ocean_current": CURRENT, "heading_bias": BIAS, "sway_bias": (0.15,)},
)


@pytest.fixture(scope="module")
def design(plant: Plant) -> Design:
    """Eight legs."""
    return a_design(plant, 8, 41)


def seen(design: Design, seed: int, effects: dict[str, tuple[float, ...]] | None = None) -> Evidence:
    """A view of data drawn with these effects."""
    return evidence_of(design.equations(design.data(np.random.default_rng(seed), effects)))


@pytest.mark.parametrize("effects", SETS)
def test_the_set_that_is_there_is_found_and_stands_its_tests(
    design: Design, effects: dict[str, tuple[float, ...]]
) -> None:
    for seed in range(3):
        evidence = seen(design, seed, effects)
        names = search_effects(evidence)
        assert set(names) == set(effects)
        for name in names:
            assert stands(evidence, names, name).is_accepted


def test_parameters_are_within_their_intervals(design: Design) -> None:
    """Squared errors under the covariance of the fit are chi-square."""
    effects, names = SETS[3], tuple(SETS[3])
    truth = np.array([number for free in effects.values() for number in free])
    distances = []
    for seed in range(100):
        fit = seen(design, seed, effects).fit(names)
        off = fit.values - truth
        distances.append(float(off @ np.linalg.solve(fit.covariance, off)))
    assert kstest(distances, chi2(len(truth)).cdf).pvalue > 1e-3


def deviations(design: Design, share: float) -> tuple[Floats, Floats]:
    """Errors and standard errors [2, 60] of a size, by the likeliest error of the model and by the whole tolerance.

    The model's forces are off by a ``share`` of the tolerance, and the hidden effect acts half as they do.
    """
    name, (column,) = "hull_fouling", design.layout.columns_of("hull_fouling")
    columns, forces = design.columns.copy(), design.nuisance[design.nuisance >= design.layout.first_feature]
    like_forces = columns[:, :, forces] @ np.random.default_rng(17).standard_normal(len(forces))
    columns[:, :, column] += like_forces * np.linalg.norm(columns[:, :, column]) / np.linalg.norm(like_forces)
    of_forces = np.isin(design.nuisance, forces)
    granted = with_columns(design, columns)
    truth = replace(granted, scale=np.where(of_forces, share, 1.0) * design.scale)
    found = []
    for seed in range(60):
        evidence = evidence_of(granted.equations(truth.data(np.random.default_rng(seed), {name: (0.3,)})))
        fits = [each.fit([name]) for each in (with_likely_model_error(evidence, [name]), evidence)]
        found.append([[fit.values[0] - 0.3, np.sqrt(fit.covariance[0, 0])] for fit in fits])
    likeliest, whole = np.array(found).transpose(1, 2, 0)
    return likeliest, whole


def test_sizes_beside_an_exact_model_are_better_known_than_the_tolerance_would_have_it(design: Design) -> None:
    likeliest, whole = deviations(design, 0.0)
    assert np.median(likeliest[1] / whole[1]) < 0.9
    assert (likeliest[0] ** 2).mean() < (whole[0] ** 2).mean()
    assert binom.sf((np.abs(likeliest[0]) > 1.96 * likeliest[1]).sum() - 1, 60, 0.05) > 1e-3


def test_sizes_beside_a_model_that_is_off_by_the_tolerance_are_as_uncertain_as_stated(design: Design) -> None:
    likeliest, whole = deviations(design, 1.0)
    assert np.median(likeliest[1] / whole[1]) > 0.9
    assert binom.sf((np.abs(likeliest[0]) > 1.96 * likeliest[1]).sum() - 1, 60, 0.05) > 1e-3


@pytest.mark.parametrize(("legs", "name"), [(3, "ocean_current"), (3, "sway_bias")])
def test_chances_are_uniform_where_nothing_is_hidden(plant: Plant, legs: int, name: str) -> None:
    few = a_design(plant, legs, 42)
    chances = np.array([stands(seen(few, seed), (name,), name).p_value for seed in range(100)])
    alone = 1.0 - (1.0 - chances) ** (1.0 / len(SMALL_CATALOGUE))  # of one effect, not of any of them
    assert kstest(alone, "uniform").pvalue > 1e-3


def test_legs_that_scatter_never_make_a_chance_smaller(design: Design) -> None:
    """With many legs their scatter is looked at too: fewer small chances than there could be, never more."""
    chances = np.array([stands(seen(design, s), ("sway_bias",), "sway_bias").p_value for s in range(100)])
    alone = 1.0 - (1.0 - chances) ** (1.0 / len(SMALL_CATALOGUE))
    for level in (0.01, 0.05, 0.2, 0.5):
        assert (alone < level).sum() <= binom.ppf(0.9999, len(alone), level)


def test_the_likeliest_of_all_effects_is_a_false_alarm_as_seldom_as_stated(design: Design) -> None:
    """Over draws of nothing: any effect by itself below the level at which it would be named."""
    alarms, draws = 0, 300
    for seed in range(draws):
        evidence = seen(design, seed)
        alarms += any(
            evidence.chance_of_gain(evidence.fit([each]).gain, len(evidence.columns_of([each]))) < 0.05
            for each in evidence.effect_names
        )
    low, high = binom.ppf([1e-4, 1.0 - 1e-4], draws, 0.05)
    assert low <= alarms <= high
    assert FALSE_ALARM < 0.05


def test_nothing_is_found_where_nothing_is(design: Design) -> None:
    """Searched and tested: a share of false alarms that the level allows."""
    named = 0
    for seed in range(30):
        evidence = seen(design, seed)
        names = search_effects(evidence)
        named += any(stands(evidence, names, name).is_accepted for name in names)
    assert named <= binom.ppf(0.9999, 30, FALSE_ALARM)


def test_an_effect_that_only_one_leg_shows_is_not_accepted(design: Design) -> None:
    data = design.data(np.random.default_rng(3))
    column = design.layout.columns_of("sway_bias")[0]
    data[4] += 0.5 * design.columns[4, :, column]
    evidence = evidence_of(design.equations(data))
    assert search_effects(evidence) != ()
    assert not stands(evidence, ("sway_bias",), "sway_bias").is_accepted


def test_an_effect_that_few_legs_show_well_and_others_little_is_accepted(design: Design) -> None:
    """What a leg gains scatters with what it says: taken as it is, the best legs would be scatter to the rest."""
    columns = design.columns.copy()
    column = design.layout.columns_of("sway_bias")[0]
    columns[:, :, column] *= np.geomspace(0.25, 4.0, len(columns))[:, None]
    uneven, accepted = with_columns(design, columns), 0
    for seed in range(10):
        evidence = seen(uneven, seed, {"sway_bias": (0.15,)})
        accepted += stands(evidence, ("sway_bias",), "sway_bias").is_accepted
    assert accepted >= 9


def test_an_effect_smaller_than_anyone_cares_about_is_not_accepted(plant: Plant) -> None:
    """Far above the noise in a very long trial, and still nothing to name."""
    long = a_design(plant, 8, 43, sigmas=2000.0)
    evidence = seen(long, 1, {"heading_bias": (0.1,)})
    result = stands(evidence, ("heading_bias",), "heading_bias")
    assert result.p_value < 1e-9
    assert not result.large_enough
    assert not result.is_accepted


def test_the_density_of_data_does_not_hang_on_what_the_equations_are_linear_about(design: Design) -> None:
    """Of a linear problem: with effects taken off and put back, the density of each set is the same."""
    equations = design.equations(design.data(np.random.default_rng(6), SETS[2]))
    evidence, names = evidence_of(equations), ("ocean_current", "thrust_loss_port")
    at = fitted_coordinates(evidence, names)
    z = design.data(np.random.default_rng(6), SETS[2])
    for name, free in at.items():
        z = z - design.columns[:, :, design.layout.columns_of(name)] @ np.array(free)
    model = replace(equations.model, at=at)
    moved = evidence_of(replace(design.equations(z), model=model))
    for some in ((), names, ("heading_bias",)):
        assert log_density(moved, some) == pytest.approx(log_density(evidence, some), abs=1e-6)


def test_nobody_steps_out_of_bounds_to_see_what_is_there(design: Design, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is possible about nothing may, linear about itself, ask for more than there can be."""
    evidence, names = seen(design, 2, {"thrust_loss_port": (-0.12,)}), ("thrust_loss_port",)
    beyond = seen(design, 2, {"thrust_loss_port": (-3.0,)})
    asked: list[Coordinates] = []

    def look(_: Evidence, at: Coordinates) -> Evidence:
        asked.append(at)
        return beyond

    monkeypatch.setattr("seatrial.hybrid.diagnosis.acceptance.linear_about", look)
    at, last = linear_about_itself(evidence, names)
    assert asked == [at] == [fitted_coordinates(evidence, names)]
    assert last is beyond


def test_what_is_out_of_bounds_is_not_named(design: Design) -> None:
    """Ten times the typical loss would push astern: whatever is named instead, it is within its bounds."""
    effect = SMALL_CATALOGUE["thrust_loss_port"].parameters[0]
    beyond = (effect.low - effect.neutral - 0.5,)
    evidence = seen(design, 2, {"thrust_loss_port": beyond})
    assert evidence.fitted_values(["thrust_loss_port"])["thrust_loss_port"] is None
    names = search_effects(evidence)
    assert "thrust_loss_port" not in names
    assert evidence.are_possible(names)


def test_a_barred_effect_is_not_named(design: Design) -> None:
    evidence = seen(design, 4, SETS[3])
    assert "heading_bias" not in search_effects(evidence, frozenset({"heading_bias"}))


@pytest.mark.parametrize("factor", [1e-3, 57.3, 1e4])
def test_nothing_depends_on_the_unit_of_a_parameter(design: Design, factor: float) -> None:
    other = in_other_units(design, "ocean_current", factor)
    data = design.data(np.random.default_rng(5), SETS[2])
    before, after = (evidence_of(each.equations(data)) for each in (design, other))
    for names in (["ocean_current"], ["ocean_current", "sway_bias"], ["heading_bias"]):
        assert after.log_odds(names) == pytest.approx(before.log_odds(names), rel=1e-7)
        assert after.fit(names).gain == pytest.approx(before.fit(names).gain, rel=1e-7)
    np.testing.assert_allclose(
        after.fit(["ocean_current"]).values * factor, before.fit(["ocean_current"]).values, rtol=1e-6
    )


def test_linear_about_what_is_found_says_the_same(design: Design) -> None:
    """Data with an effect taken off by the model, put back: the same fit and evidence."""
    data = design.data(np.random.default_rng(6), SETS[1])
    column = design.layout.columns_of("heading_bias")[0]
    equations = design.equations(data - 0.9 * design.columns[:, :, column])
    moved = replace(equations, model=ModelWithEffects(design.plant, SMALL_CATALOGUE, {"heading_bias": (0.9,)}))
    before, after = evidence_of(design.equations(data)), evidence_of(moved)
    np.testing.assert_allclose(after.inner, before.inner, rtol=1e-7, atol=1e-7 * np.abs(before.inner).max())
    mine, other = (stands(each, ("heading_bias",), "heading_bias") for each in (before, after))
    assert other.gain == pytest.approx(mine.gain, rel=1e-6)
    assert other.spread == pytest.approx(mine.spread, rel=1e-6)


def test_gains_on_unseen_legs_are_those_of_a_fit_to_the_others(design: Design) -> None:
    """Leg by leg, with nuisances of their own: the log density of each, written out."""
    data = design.data(np.random.default_rng(7), SETS[1])
    evidence = evidence_of(design.equations(data))
    column, prior = design.layout.columns_of("heading_bias")[0], evidence.prior_deviations(["heading_bias"])[0]
    gains = unseen_gains(evidence, (), ("heading_bias",))

    def weighed(columns: Floats, z: Floats) -> tuple[float, float]:
        N = columns[:, design.nuisance] * design.scale
        solved = np.linalg.solve(np.eye(len(z)) + N @ N.T, np.column_stack([columns[:, column], z]))
        return float(columns[:, column] @ solved[:, 0]), float(columns[:, column] @ solved[:, 1])

    for leg in range(3):
        others = [each for each in range(8) if each != leg]
        information, say = weighed(
            design.columns[others].reshape(-1, design.columns.shape[2]), data[others].ravel()
        )
        value = say / (information + prior**-2)
        own_information, own_say = weighed(design.columns[leg], data[leg])
        assert gains[leg] == pytest.approx(value * own_say - 0.5 * value**2 * own_information, rel=1e-5, abs=1e-8)


def test_a_twin_is_a_rival_and_a_stranger_is_not(design: Design) -> None:
    columns = design.columns.copy()
    twin, own = design.layout.columns_of("yaw_inertia")[0], design.layout.columns_of("heading_bias")[0]
    ratio = design.layout.prior[own - 1] / design.layout.prior[twin - 1]
    columns[:, :, twin] = columns[:, :, own] * ratio * 1.001
    alike = with_columns(design, columns)
    evidence = seen(alike, 8, {"heading_bias": (0.8,)})
    less = rivals_of(evidence, ("heading_bias",), "heading_bias")
    assert abs(less["yaw_inertia"]) < 0.1
    assert min(value for name, value in less.items() if name != "yaw_inertia") > 20.0


def test_an_effect_of_which_the_data_say_nothing_is_no_suspect_and_no_stumbling_block(design: Design) -> None:
    """As of the wind's effects where no wind was recorded."""
    columns = design.columns.copy()
    columns[:, :, design.layout.columns_of("wind_load")] = 0.0
    deaf = with_columns(design, columns)
    evidence = seen(deaf, 3, {"heading_bias": BIAS})
    assert search_effects(evidence) == ("heading_bias",)
    ranked = {each.name: each for each in rank_effects(evidence)}
    assert next(iter(ranked)) == "heading_bias"
    assert ranked["wind_load"].evidence < 0.0
    assert ranked["wind_load"].p_value > 0.5


def test_no_more_than_two_clocks_are_wrong_at_once(design: Design) -> None:
    """Were all records late by the same, none would be; so three that are late are one that is early."""
    evidence = seen(design, 4, {"heading_bias": BIAS, "sway_bias": (0.4,), "yaw_rate_bias": (0.2,)})
    three = ("heading_bias", "sway_bias", "yaw_rate_bias")
    assert evidence.are_possible(three)
    model = evidence.equations.model
    clocks = {name: replace(each, family="clock") for name, each in model.catalogue.items() if name in three}
    late = replace(
        evidence,
        equations=replace(evidence.equations, model=replace(model, catalogue={**model.catalogue, **clocks})),
    )
    assert not late.are_possible(three)
    assert late.are_possible(three[:2])
    assert set(search_effects(evidence)) == set(three)
    assert len(set(search_effects(late)) & set(three)) == 2
