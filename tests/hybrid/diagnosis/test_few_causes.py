"""Few causes: those of a ship far from her model are found with their sizes, and only what replicates is named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from seatrial.hybrid.diagnosis.acceptance import fitted_coordinates
from seatrial.hybrid.diagnosis.few_causes import (
    FewCauses,
    find_few_causes,
    halves_of,
    replicating_causes,
    search_of,
)
from seatrial.hybrid.diagnosis.gap import UnseenWindows, unseen_windows
from seatrial.hybrid.diagnosis.linearise import ModelWithEffects
from seatrial.hybrid.diagnosis.regression import evidence_of
from seatrial.hybrid.effects import CATALOGUE, apply_effects
from seatrial.hybrid.prediction.baselines import distances
from seatrial.hybrid.vessel.plant import Plant
from tests.hybrid.diagnosis.examination_by_hand import a_design
from tests.hybrid.diagnosis.noisy_log import noisy_log

HIDDEN = {
    "hull_fouling": {"resistance_factor": 2.2},
    "yaw_inertia": {"factor": 1.8},
    "thrust_loss_both": {"fraction": 0.3},
}
NAMES = (*HIDDEN, "ocean_current", "heading_bias", "cross_flow_drag", "yaw_damping", "loading")
LEGS = 16


def windows_of(ship: Plant, model: Plant, seed: int, names: tuple[str, ...] = NAMES) -> UnseenWindows:
    """Windows of a trial of a ship, seen with a model that may lack ``names``."""
    log = noisy_log(ship, seed, LEGS)
    return unseen_windows(log, ModelWithEffects(model, {name: CATALOGUE[name] for name in names}))


@pytest.fixture(scope="module")
def windows(plant: Plant) -> UnseenWindows:
    """A ship with several large effects, seen with a model that has none of them."""
    return windows_of(apply_effects(plant, HIDDEN, CATALOGUE), plant, 81)


@pytest.fixture(scope="module")
def causes(windows: UnseenWindows) -> FewCauses:
    """What is found there."""
    return find_few_causes(windows, lambda names: True)


def test_what_is_missing_is_named_with_its_size_and_nothing_else(windows: UnseenWindows, causes: FewCauses) -> None:
    assert set(causes.fit.names) == set(HIDDEN)
    for name, values in HIDDEN.items():
        ((parameter, true),) = values.items()
        departed = true - CATALOGUE[name].neutral_values[parameter]
        size = windows.model.values_by_piece(name, causes.fit.at[name])[-1][parameter]
        assert size == pytest.approx(true, abs=0.25 * abs(departed))
        assert causes.p_values[name] < 0.01
        assert len(causes.found_in[name]) >= len(causes.halves)


def test_held_out_legs_are_predicted_with_sizes_of_the_others(windows: UnseenWindows, causes: FewCauses) -> None:
    """The folds of the sizes are those of the windows that they are tried on."""
    held_out = replace(windows, fold=causes.fit.fold)
    off_m = distances(held_out.tracks_by_other_folds(causes.fit.without), windows.measured).mean(axis=1)
    unit = search_of(windows, lambda names: True).unit
    by_unit = np.bincount(unit, off_m) / np.bincount(unit)
    assert by_unit == pytest.approx(causes.fit.off_m)
    assert causes.fit.mean_m() < 0.3 * distances(windows.before, windows.measured).mean()


def test_halves_come_in_complementary_pairs(windows: UnseenWindows) -> None:
    halves = list(halves_of(windows).values())
    assert len(halves) == 6
    for one, other in zip(halves[::2], halves[1::2], strict=True):
        assert (one ^ other).all()


def test_a_trial_too_short_to_be_parted_names_nothing(windows: UnseenWindows) -> None:
    short = windows.subset(windows.log.block[windows.starts] < 4)
    assert halves_of(short) == {}
    assert find_few_causes(short, lambda names: True).fit.names == ()


def test_what_is_there_in_one_quarter_is_a_suspect_and_no_name(plant: Plant) -> None:
    """A half with the quarter chooses it, its complement does not."""
    fouled = apply_effects(plant, {"hull_fouling": {"resistance_factor": 1.6}}, CATALOGUE)
    always = {"thrust_loss_both": {"fraction": 0.3}}
    whole, part = (noisy_log(apply_effects(ship, always, CATALOGUE), 84, LEGS) for ship in (plant, fouled))
    is_fouled = whole.leg >= LEGS - LEGS // 4
    arrays = {
        name: np.where(is_fouled[:, None], getattr(part, name), getattr(whole, name))
        for name in ("measured", "nominal")
    }
    log = replace(whole, **arrays)
    model = ModelWithEffects(plant, {name: CATALOGUE[name] for name in NAMES})
    causes = find_few_causes(unseen_windows(log, model), lambda names: True)
    assert "thrust_loss_both" in causes.fit.names
    assert "hull_fouling" not in causes.fit.names
    assert 0 < len(causes.found_in["hull_fouling"]) < len(causes.halves)


def test_windows_without_positions_change_no_size(windows: UnseenWindows, causes: FewCauses) -> None:
    """A window with a gap has no distance: the sizes are fitted to the others, the same ones from any start."""
    lost = windows.measured.copy()
    lost[::9, 5:8] = np.nan
    for start in ({}, causes.fit.at):
        fit = search_of(replace(windows, measured=lost), lambda names: True).fit_of(causes.fit.names, start)
        for name, (size,) in fit.at.items():
            assert size == pytest.approx(causes.fit.at[name][0], rel=0.02)


def test_a_cause_of_another_size_in_each_half_does_not_replicate(plant: Plant) -> None:
    """What one half has and the other has in the opposite sense predicts neither from the other."""
    more, less = (
        noisy_log(apply_effects(plant, {"hull_fouling": {"resistance_factor": factor}}, CATALOGUE), 85, LEGS)
        for factor in (1.5, 0.5)
    )
    second = (more.leg >= LEGS // 2)[:, None]
    arrays = {name: np.where(second, getattr(less, name), getattr(more, name)) for name in ("measured", "nominal")}
    model = ModelWithEffects(plant, {name: CATALOGUE[name] for name in NAMES})
    windows = unseen_windows(replace(more, **arrays), model)
    halves = [(search_of(windows.subset(mine), lambda names: True), mine) for mine in halves_of(windows).values()]
    search = search_of(windows, lambda names: True)
    assert replicating_causes(search, halves, ("hull_fouling",), {"hull_fouling": (0.0,)}) == ()


def test_one_wild_leg_moves_no_size_far(windows: UnseenWindows, causes: FewCauses) -> None:
    """The loss of a window grows with its distance, not with the square of it."""
    wild = windows.log.leg[windows.starts] == 0
    measured = windows.measured + np.where(wild, 30.0, 0.0)[:, None, None] * np.linspace(0.0, 1.0, 16)[:, None]
    search = search_of(replace(windows, measured=measured), lambda names: True)
    fit = search.fit_of(causes.fit.names, causes.fit.at)
    for name, (size,) in fit.at.items():
        assert size == pytest.approx(causes.fit.at[name][0], rel=0.3)


def test_a_size_at_its_bound_is_no_cause(windows: UnseenWindows) -> None:
    """What would have to be larger than it can be stands for something else."""
    effect = CATALOGUE["thrust_loss_both"]
    narrow = replace(effect, parameters=(replace(effect.parameters[0], low=-0.1, high=0.1),))
    catalogue = {**windows.model.catalogue, effect.name: narrow}
    chosen = search_of(
        replace(windows, model=replace(windows.model, catalogue=catalogue)), lambda names: True
    ).search()
    assert chosen.names
    assert effect.name not in chosen.names


def test_no_size_is_out_of_bounds_and_the_others_make_up_for_it(plant: Plant) -> None:
    """Of two effects alike of which one may not be as large as the data ask for, the other takes over."""
    design = a_design(plant, 6, 82, sigmas=200.0)
    columns, own = design.columns, design.layout.columns_of("yaw_inertia")[0]
    columns[:, :, own] = columns[:, :, design.layout.columns_of("yaw_rate_bias")[0]]
    twin = replace(design, gram=np.einsum("lrc,lrd->lcd", columns, columns))
    bound = -CATALOGUE["yaw_inertia"].parameters[0].neutral + CATALOGUE["yaw_inertia"].parameters[0].low
    z = 3.0 * bound * columns[:, :, own]
    at = fitted_coordinates(evidence_of(twin.equations(z)), ("yaw_inertia", "yaw_rate_bias"))
    assert at["yaw_inertia"][0] >= bound - 1e-12
    assert at["yaw_inertia"][0] + at["yaw_rate_bias"][0] == pytest.approx(3.0 * bound, rel=0.05)


def test_a_vane_that_is_off_by_a_right_angle_is_found(plant: Plant) -> None:
    """What the wind does there is nothing like its slope at no error."""
    load = {"wind_load": {"factor": 3.0}}
    windy = apply_effects(plant, {"wind_direction_bias": {"angle_deg": 90.0}, **load})
    names = ("wind_direction_bias", "wind_load", "wave_drift", "hull_fouling", "sway_asymmetry")
    windows = windows_of(windy, apply_effects(plant, load), 83, names)
    chosen = search_of(windows, lambda names: True).search()
    assert chosen.names[0] == "wind_direction_bias"
    assert chosen.at["wind_direction_bias"][0] == pytest.approx(90.0, abs=15.0)
