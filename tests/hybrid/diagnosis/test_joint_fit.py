"""Many effects at once: their likeliest sizes, and sets of them judged by tracks that are linear in these."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from seatrial.hybrid.diagnosis.acceptance import fitted_coordinates
from seatrial.hybrid.diagnosis.coarse_model import compatible_effects, relinearise_at_mode
from seatrial.hybrid.diagnosis.gap import (
    LinearTracks,
    UnseenWindows,
    closest_single_effect,
    fit_within_bounds,
    linear_tracks,
    unseen_windows,
)
from seatrial.hybrid.diagnosis.linearise import ModelWithEffects, linearise
from seatrial.hybrid.diagnosis.regression import FEW, Evidence, evidence_of, normal_equations
from seatrial.hybrid.effects import CATALOGUE, apply_effects
from seatrial.hybrid.vessel.plant import Plant
from tests.hybrid.diagnosis.examination_by_hand import a_design
from tests.hybrid.diagnosis.noisy_log import QUIET, noisy_log

HIDDEN = {
    "hull_fouling": {"resistance_factor": 2.2},
    "yaw_inertia": {"factor": 1.8},
    "thrust_loss_both": {"fraction": 0.3},
}
NAMES = (*HIDDEN, "ocean_current", "heading_bias", "cross_flow_drag", "yaw_damping", "loading")


@pytest.fixture(scope="module")
def far_off(plant: Plant) -> Evidence:
    """A ship with several large effects, seen with a model that has none of them."""
    log = noisy_log(apply_effects(plant, HIDDEN, CATALOGUE), 81)
    model = ModelWithEffects(plant, {name: CATALOGUE[name] for name in NAMES})
    return evidence_of(normal_equations(linearise(log, model, 0.01), QUIET, number=FEW))


@pytest.fixture(scope="module")
def found(far_off: Evidence) -> Evidence:
    """The same about the likeliest sizes of all."""
    return relinearise_at_mode(far_off, compatible_effects(far_off))


@pytest.fixture(scope="module")
def windows(found: Evidence) -> UnseenWindows:
    """Windows of the same trial."""
    return unseen_windows(found.equations.log, found.equations.model)


@pytest.fixture(scope="module")
def tracks(found: Evidence, windows: UnseenWindows) -> LinearTracks:
    """Their tracks."""
    return linear_tracks(windows, found)


def test_about_all_effects_together_those_that_are_there_come_to_their_sizes(found: Evidence) -> None:
    model = found.equations.model
    for name, values in HIDDEN.items():
        ((parameter, true),) = values.items()
        departed = true - CATALOGUE[name].neutral[parameter]
        assert model.piecewise(name, model.at[name])[-1][parameter] == pytest.approx(true, abs=0.25 * abs(departed))


def test_no_size_is_out_of_bounds_and_the_others_make_up_for_it(plant: Plant) -> None:
    """Of two effects alike of which one may not be as large as the data ask for, the other takes over."""
    design = a_design(plant, 6, 82, sigmas=200.0)
    columns, own = design.columns, design.layout.of("yaw_inertia")[0]
    columns[:, :, own] = columns[:, :, design.layout.of("yaw_rate_bias")[0]]
    twin = replace(design, gram=np.einsum("lrc,lrd->lcd", columns, columns))
    bound = -CATALOGUE["yaw_inertia"].parameters[0].neutral + CATALOGUE["yaw_inertia"].parameters[0].low
    z = 3.0 * bound * columns[:, :, own]
    at = fitted_coordinates(evidence_of(twin.equations(z)), ("yaw_inertia", "yaw_rate_bias"))
    assert at["yaw_inertia"][0] >= bound - 1e-12
    assert at["yaw_inertia"][0] + at["yaw_rate_bias"][0] == pytest.approx(3.0 * bound, rel=0.05)


def test_linear_tracks_are_those_of_the_simulation(
    found: Evidence, windows: UnseenWindows, tracks: LinearTracks
) -> None:
    """Where all effects are, and where some are not."""
    at = fitted_coordinates(found, NAMES)
    whole = windows.by_leg_m(windows.predicted(at)).mean()
    assert tracks.by_leg_m(NAMES).mean() == pytest.approx(whole, abs=0.3 * whole + 0.01)
    assert tracks.by_leg_m(()).mean() == pytest.approx(windows.by_leg_m(windows.before).mean(), rel=0.3)


def test_the_best_set_on_unseen_legs_has_what_is_there_and_little_else(tracks: LinearTracks) -> None:
    best = tracks.best_set(NAMES, 0.01, len(NAMES), ())
    assert set(HIDDEN) <= set(best)
    assert tracks.by_leg_m(best).mean() <= 1.05 * tracks.by_leg_m(NAMES).mean()
    assert "yaw_inertia" not in tracks.best_set((), 0.01, len(NAMES), {"yaw_inertia"})
    assert len(tracks.best_set(NAMES, 0.0, 2, ())) == 2


def test_a_vane_that_is_off_by_a_right_angle_is_found_by_simulated_tracks(plant: Plant) -> None:
    """What the wind does there is nothing like its slope at no error."""
    windy = apply_effects(plant, {"wind_direction_bias": {"angle_deg": 90.0}, "wind_load": {"factor": 3.0}})
    log = noisy_log(windy, 83)
    base = apply_effects(plant, {"wind_load": {"factor": 3.0}})
    names = ("wind_direction_bias", "wind_load", "wave_drift", "hull_fouling", "sway_asymmetry")
    model = ModelWithEffects(base, {name: CATALOGUE[name] for name in names})
    evidence = evidence_of(normal_equations(linearise(log, model, 0.01), QUIET, number=FEW))
    assert closest_single_effect(unseen_windows(log, model), evidence) == {"wind_direction_bias": (80.0,)}


@pytest.mark.parametrize("seed", range(5))
def test_sizes_at_their_bounds_stay_there_and_the_others_are_the_best_beside_them(seed: int) -> None:
    random = np.random.default_rng(seed)
    data = random.standard_normal((40, 8))
    inner, columns, precision = data.T @ data, np.array([5, 2, 7, 3]), np.full(4, 0.5)
    information = inner[np.ix_(columns, columns)] + np.diag(precision)
    free = np.linalg.solve(information, inner[columns, 0])
    assert fit_within_bounds(inner, columns, precision, np.full(4, -9.0), np.full(4, 9.0)) == pytest.approx(free)
    high = 0.5 * np.abs(free) * [1.0, 9.0, 9.0, 9.0]
    sizes = fit_within_bounds(inner, columns, precision, -high, high)
    assert (np.abs(sizes) <= high).all()
    assert abs(sizes[0]) == high[0]
    inside = np.abs(sizes) < high
    assert (inner[columns, 0] - information @ sizes)[inside] == pytest.approx(0.0, abs=1e-9)
