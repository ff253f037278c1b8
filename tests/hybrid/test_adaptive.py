"""The adaptive calibrator: what the observer sees, what is learned from tracks, and what it may not look at."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seatrial.acquisition.core.errors import DataShortageError
from seatrial.acquisition.core.quantities import Floats
from seatrial.acquisition.core.ship import DEFAULT
from seatrial.analysis.tables.table import NANO
from seatrial.hybrid.calibrators import TrainedCalibrator, make_calibrator, predict_with_fallback
from seatrial.hybrid.calibrators.adaptive import (
    AdaptiveCalibrator,
    _assign_folds,
    _make_difference_function,
    _TrainingStatistics,
    _weighted_jacobian,
    adapt_plant,
    fit_parameter_vector,
    observations_of_windows,
    observer_gains,
    parameter_names,
    positive_coefficient_names,
    run_observer,
    signed_coefficient_names,
    start_quantities,
    start_quantity_names,
)
from seatrial.hybrid.calibrators.own import load, save
from seatrial.hybrid.effects import vessel_plant
from seatrial.hybrid.prediction.baselines import Fallback, distances, simulate_reference
from seatrial.hybrid.prediction.kalman_filter import FORCE_DECAY, NOISE_LEVELS
from seatrial.hybrid.prediction.window_sets import PAST_S, PredictionWindows, hindcast_windows
from seatrial.hybrid.vessel.actuators import control_labels
from seatrial.hybrid.vessel.files import load_vessel
from seatrial.hybrid.vessel.plant import Form, Plant, flat_numbers, number_places, pack
from tests.hybrid.windows_by_hand import answers, moved, turned, voyages, windows_at

SECONDS = 10
FORM = Form("polynomial", DEFAULT)
NAMES, POSITIVE, SIGNED = (
    make(FORM) for make in (parameter_names, positive_coefficient_names, signed_coefficient_names)
)
UNADAPTED = np.zeros(len(NAMES))
NUMBERS = ("start", "track", "wind", "control", "past")


def off_m(predicted: Floats, windows: PredictionWindows) -> float:
    """The mean distance [m]."""
    return float(distances(predicted, windows.track).mean())


def tracks(vector: Floats, plant: Plant, windows: PredictionWindows) -> Floats:
    """What the adapted model says of windows [N, H+1, 3]."""
    states, waves = run_observer(vector, plant, observations_of_windows(windows))
    return states[..., :3] + waves


def noisy(windows: PredictionWindows, seed: int = 0) -> PredictionWindows:
    """The windows as real sensors see them: a few centimetres, tenths of a degree, centimetres a second."""
    random = np.random.default_rng(seed)
    deviation = np.array([0.05, 0.05, 0.003, 0.02, 0.02, 0.001])
    past = windows.past.copy()
    past[..., :6] += deviation * random.normal(size=past[..., :6].shape)
    return replace(windows, past=past, start=past[:, 0, :6].copy())


@pytest.fixture(scope="module")
def truth(plant: Plant) -> Plant:
    """A ship unlike the reference: a fifth less thrust, and something that turns her."""
    return plant.replaced(thrust_nn=0.8 * plant.number("thrust_nn"), constant_N_nm=20e3)


@pytest.fixture(scope="module")
def training(truth: Plant) -> PredictionWindows:
    """Her windows, of two legs: so two members are adapted, which is soon done."""
    return noisy(voyages(truth, 24, SECONDS, legs=2))


def fit(plant: Plant, windows: PredictionWindows, seed: int = 0) -> AdaptiveCalibrator:
    """A calibrator on the windows, the last six of them to stop by, adapted in a few steps."""
    alone, last = simulate_reference(windows, plant), np.arange(len(windows)) >= len(windows) - 6
    training, stopping = ((windows.subset(mask), alone[mask]) for mask in (~last, last))
    calibrator = make_calibrator("adaptive", seed, plant)
    assert isinstance(calibrator, AdaptiveCalibrator)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            "seatrial.hybrid.calibrators.adaptive.fit_parameter_vector", partial(fit_parameter_vector, steps=2)
        )
        return calibrator.fit(training, stopping)


@pytest.fixture(scope="module")
def learned(plant: Plant, training: PredictionWindows) -> AdaptiveCalibrator:
    return fit(plant, training)


@given(
    st.lists(
        st.floats(-4.0, 4.0),
        min_size=len(NOISE_LEVELS) + len(FORCE_DECAY),
        max_size=len(NOISE_LEVELS) + len(FORCE_DECAY),
    )
)
@settings(max_examples=30, deadline=None)
def test_gains_stay_finite_and_stable(numbers: list[float]) -> None:
    """Whatever the vector says, errors of position and speed are corrected and never overcorrected twofold."""
    vector = UNADAPTED.copy()
    vector[[NAMES.index(name) for name in (*NOISE_LEVELS, *FORCE_DECAY)]] = numbers
    gains, kept, _ = observer_gains(vector, vessel_plant(load_vessel("gunnerus_short")))
    assert np.isfinite(gains).all()
    assert ((kept > 0.0) & (kept < 1.0)).all()
    own = np.linalg.eigvals(np.eye(2) - gains[..., :2, :] - gains[..., 3:, :]).real
    assert ((own > -1e-6) & (own < 1.0 + 1e-6)).all()


def test_headings_are_believed_less_in_a_turn(plant: Plant) -> None:
    """Stamps that jitter spoil a heading by as much as the ship turns, and neither positions nor the yaw rate."""
    gains = observer_gains(UNADAPTED, plant)[0][:, -1]
    assert (np.diff(gains[:, 2, 0, 0]) < 0.0).all()
    assert (np.diff(gains[:, 2, 1, 1]) >= 0.0).all()
    assert np.array_equal(gains[:, :2], np.repeat(gains[:1, :2], len(gains), axis=0))


def test_derivatives_of_a_batch_are_those_of_single_parameters(plant: Plant, training: PredictionWindows) -> None:
    """Also in a wind that the vector adds, and of a coefficient that is zero and so changes nothing."""
    without_damping = plant.replaced(Nrrr=0.0)
    differences_at, _ = _make_difference_function(
        without_damping, observations_of_windows(training), training.track
    )
    for vector in (UNADAPTED, 0.1 * np.random.default_rng(3).normal(size=len(NAMES))):
        residual = differences_at(vector)
        slopes = _weighted_jacobian(without_damping, differences_at, vector, residual, np.ones_like(residual))
        moved = vector + 1e-3 * np.eye(len(NAMES))
        expected = [(differences_at(single) - residual).ravel() / 1e-3 for single in moved]
        np.testing.assert_allclose(slopes.T, expected, atol=1e-9)
        assert not slopes[:, NAMES.index("Nrrr")].any()
        assert slopes[:, NAMES.index("wind_north")].any()


def test_no_departure_is_the_reference(plant: Plant) -> None:
    """A vector of nothing leaves every number of the plant as it was, to the bit."""
    assert adapt_plant(UNADAPTED, plant).tobytes() == pack(plant).tobytes()


@given(st.lists(st.floats(-9.0, 9.0), min_size=len(NAMES), max_size=len(NAMES)))
@settings(max_examples=30, deadline=None)
def test_numbers_change_by_factors_or_shares(plant: Plant, numbers: list[float]) -> None:
    """Masses, damping and thrust keep their sign whatever the vector says; all others change by shares; and what
    is not in the vector is the reference's still.
    """
    then, now = flat_numbers(pack(plant))[0], flat_numbers(adapt_plant(np.array(numbers), plant))[0]
    for name, number in zip(NAMES, numbers, strict=True):
        place = list(number_places(plant.form, name)) if name in POSITIVE or name in SIGNED else []
        if name in POSITIVE:
            assert now[place] == pytest.approx(then[place] * np.exp(np.clip(0.5 * number, -2.0, 2.0)), rel=1e-12)
        elif name in SIGNED:
            assert now[place] == pytest.approx(then[place] * (1.0 + 0.5 * number), rel=1e-12)
    for name in ("length_overall_m", "propeller_diameter_m", "CX", "lateral_area_m2", "wind_load_factor"):
        place = list(number_places(plant.form, name))
        assert np.array_equal(now[place], then[place])


def test_the_true_model_predicts_the_true_track(plant: Plant) -> None:
    """Without noise the observer has nothing to correct: a few tenths of a millimetre of the longer step remain."""
    windows = voyages(plant, 20, 30)
    assert np.ptp(windows.track[..., 0], axis=1).mean() > 20.0
    assert distances(tracks(UNADAPTED, plant, windows), windows.track).max() < 2e-3


@pytest.mark.parametrize(
    ("name", "size", "most"),
    [("constant_X_n", 5e3, 0.2), ("constant_Y_n", -5e3, 0.2), ("constant_N_nm", 5e4, 0.5)],
)
def test_a_force_that_the_model_lacks_is_found(plant: Plant, name: str, size: float, most: float) -> None:
    """What pushes or turns the ship shows in the half minute before; the reference alone errs much more.

    If the force is believed to last, less is left than if it is believed to fade.
    """
    numbers: dict[str, Any] = {name: size}
    windows = voyages(plant.replaced(**numbers), 20, 15)
    alone = off_m(simulate_reference(windows, plant), windows)
    found = off_m(tracks(UNADAPTED, plant, windows), windows)
    lasting = UNADAPTED.copy()
    lasting[[NAMES.index(each) for each in FORCE_DECAY]] = 4.0
    assert alone > 0.1
    assert found < most * alone
    assert off_m(tracks(lasting, plant, windows), windows) < 0.8 * found


def test_longer_seen_is_better_known(truth: Plant, plant: Plant) -> None:
    """The less of the past is known the more of the lacking force stays hidden, down to the reference itself."""
    windows = voyages(truth, 30, 15)
    errors = []
    for complete_s in (PAST_S, 10, 5, 0):
        past = windows.past.copy()
        past[:, complete_s + 1 :] = np.nan
        errors.append(off_m(tracks(UNADAPTED, plant, replace(windows, past=past)), windows))
    assert errors == sorted(errors)
    assert errors[-1] == pytest.approx(off_m(simulate_reference(windows, plant), windows), rel=1e-3)


@pytest.mark.parametrize(("north_m", "surge_mps", "turn_rad"), [(80.0, 0.0, 0.0), (0.0, 3.0, 0.0), (0.0, 0.0, 1.0)])
def test_a_splice_begins_anew(plant: Plant, north_m: float, surge_mps: float, turn_rad: float) -> None:
    """What lies before a leap that no ship makes, whatever it is, does not spoil the prediction."""
    windows = voyages(plant, 12, SECONDS)
    past = windows.past.copy()
    past[:, 12:, 0] += north_m
    past[:, 12:, 2] += turn_rad
    past[:, 12:, 3] += surge_mps
    assert distances(tracks(UNADAPTED, plant, replace(windows, past=past)), windows.track).max() < 2e-3


def test_hidden_numbers_are_recovered(plant: Plant) -> None:
    """A fifth less thrust and half as much drag again: found from a few windows, so that others of the ship are
    predicted to the centimetre, where the reference errs by half a metre and more.
    """
    ship = plant.replaced(thrust_nn=0.8 * plant.number("thrust_nn"), Xuu=1.5 * plant.Xuu)
    windows, unseen = (voyages(ship, 16, SECONDS, seed) for seed in (0, 1))
    vector = fit_parameter_vector(plant, observations_of_windows(windows), windows.track, 1.0, steps=3)
    assert off_m(simulate_reference(unseen, plant), unseen) > 0.5
    assert off_m(tracks(vector, plant, unseen), unseen) < 0.01


def test_no_departure_is_invented(plant: Plant) -> None:
    """Where the reference is the ship and nothing is off, the numbers stay where they are; what noise makes of
    them does other windows little harm.
    """
    windows = voyages(plant, 16, SECONDS)
    vector = fit_parameter_vector(plant, observations_of_windows(windows), windows.track, 1.0, steps=2)
    assert np.abs(vector).max() < 0.05
    misled = fit_parameter_vector(plant, observations_of_windows(noisy(windows)), windows.track, 1.0, steps=2)
    unseen = noisy(voyages(plant, 40, SECONDS, seed=1), seed=1)
    assert off_m(tracks(misled, plant, unseen), unseen) < 1.1 * off_m(tracks(UNADAPTED, plant, unseen), unseen)


def test_what_cannot_be_run_teaches_nothing(plant: Plant) -> None:
    """Windows whose start is no number count for nothing; the vector stays what the others say."""
    windows = voyages(plant, 8, 5)
    lost = np.arange(8) < 2
    past = windows.past.copy()
    past[lost, :, 3] = np.nan
    holed = replace(windows, past=past, start=np.where(lost[:, None], np.nan, windows.start))
    assert np.isfinite(fit_parameter_vector(plant, observations_of_windows(holed), holed.track, 1.0, steps=1)).all()


def test_it_learns_a_ship_from_her_legs(plant: Plant, truth: Plant, learned: AdaptiveCalibrator) -> None:
    """On windows of the same ship that were not seen a fifth of the reference's error is left, noise and all."""
    unseen = noisy(voyages(truth, 40, SECONDS, seed=1), seed=1)
    alone = simulate_reference(unseen, plant)
    assert off_m(learned.predict(unseen, alone), unseen) < 0.25 * off_m(alone, unseen)


def test_a_seed_is_one_calibrator(plant: Plant) -> None:
    """The same seed gives the same numbers to the last bit, whatever else is drawn between."""
    windows = noisy(voyages(plant, 10, 3, legs=2))
    first = fit(plant, windows, 3).state_dict()
    np.random.default_rng().normal(size=9)
    again = fit(plant, windows, 3).state_dict()
    assert all(np.array_equal(first[name], again[name]) for name in first)


def test_recordings_of_the_same_hours_are_no_overlap(plant: Plant, truth: Plant) -> None:
    """Two ships' recordings teach the same whether they were made at the same time or a day apart."""
    windows = voyages(truth, 12, 3, legs=2)
    trial, alone = windows.leg, simulate_reference(windows, plant)
    there = windows.start_ns[np.arange(12) // 2]
    apart = there + np.arange(12) % 2 * 86_400 * NANO
    first, second = (fit(plant, replace(windows, trial=trial, start_ns=each)) for each in (there, apart))
    assert np.array_equal(first.vectors_, second.vectors_)
    assert off_m(first.predict(windows, alone), windows) < 0.5 * off_m(alone, windows)


def test_seconds_of_one_window_in_two_parts_are_learned_from(plant: Plant, truth: Plant) -> None:
    """Even seconds to learn from, odd ones to stop by, of the same windows: as when rows are drawn at random."""
    windows = voyages(truth, 16, SECONDS, legs=4)
    even = np.arange(SECONDS + 1) % 2 == 0
    alone = simulate_reference(windows, plant)
    parts = []
    for kept in (even, ~even):
        rows = kept.copy()
        rows[0] = True
        parts.append((replace(windows, track=np.where(rows[None, :, None], windows.track, np.nan)), alone))
    calibrator = make_calibrator("adaptive", 0, plant).fit(parts[0], parts[1])
    assert off_m(calibrator.predict(windows, alone), windows) < 0.3 * off_m(alone, windows)


def test_one_leg_is_too_few(plant: Plant) -> None:
    with pytest.raises(DataShortageError, match="only one leg"):
        fit(plant, voyages(plant, 10, 3, legs=1))


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 1000))
def test_nothing_after_the_start_is_looked_at(
    plant: Plant, truth: Plant, learned: AdaptiveCalibrator, seed: int
) -> None:
    """Whatever the ship did after second 0, the prediction and its region are the same to the bit."""
    windows = noisy(voyages(truth, 6, SECONDS, seed))
    random = np.random.default_rng(seed)
    track = windows.track.copy()
    track[:, 1:] = random.normal(0.0, 1e3, track[:, 1:].shape)
    alone = simulate_reference(windows, plant)
    after = replace(windows, track=track)
    for one, other in zip(answers(learned, windows, alone), answers(learned, after, alone), strict=True):
        assert np.array_equal(one, other)


@settings(max_examples=10, deadline=None)
@given(
    north=st.floats(-1e4, 1e4),
    east=st.floats(-1e4, 1e4),
    turn=st.floats(-2.0 * np.pi, 2.0 * np.pi),
    hull=st.floats(-1.0, 1.0),
)
def test_it_is_the_same_ship_anywhere_and_on_any_heading(
    plant: Plant, truth: Plant, north: float, east: float, turn: float, hull: float
) -> None:
    """Moved and turned with her wind she goes the same way, as long as nothing is fixed to the earth."""
    vector = UNADAPTED.copy()
    vector[[NAMES.index(name) for name in ("Xuu", "Nur", "thrust_nn", "constant_Y_n")]] = hull
    windows = noisy(voyages(truth, 5, SECONDS))
    here = tracks(vector, plant, windows)
    there = tracks(vector, plant, moved(windows, north, east, turn))
    assert there[..., :2] == pytest.approx(turned(here[..., :2], turn) + np.array([north, east]), abs=1e-6)
    assert there[..., 2] == pytest.approx(here[..., 2] + turn, abs=1e-9)


@pytest.mark.parametrize("name", ["current_north", "drift_east", "wind_north"])
def test_what_is_fixed_to_the_earth_does_not_turn_with_the_ship(plant: Plant, name: str) -> None:
    """A current, a drift and a wind of the place act on a ship turned about from the other side."""
    vector = UNADAPTED.copy()
    vector[NAMES.index(name)] = 2.0
    windows = voyages(plant, 5, SECONDS)
    there = tracks(vector, plant, moved(windows, 0.0, 0.0, np.pi))
    gap = there[..., :2] - turned(tracks(vector, plant, windows)[..., :2], np.pi)
    assert np.hypot(gap[:, -1, 0], gap[:, -1, 1]).min() > 0.01


def test_a_window_without_a_past_is_predicted(plant: Plant, truth: Plant, learned: AdaptiveCalibrator) -> None:
    """All of them, or some among others: finite tracks and regions, the others' untouched, these less sure."""
    windows = noisy(voyages(truth, 8, SECONDS, seed=2))
    alone = simulate_reference(windows, plant)
    for without in (np.arange(8) < 3, np.ones(8, dtype=bool)):
        past = np.where(without[:, None, None], np.nan, windows.past)
        blind = replace(windows, past=past)
        found, uncertainty = learned.predict_with_uncertainty(blind, alone)
        assert np.isfinite(found).all()
        assert np.array_equal(found[~without], learned.predict(windows, alone)[~without])
        assert found[without, 0, :2] == pytest.approx(windows.start[without, :2])
        assert (uncertainty[without] > np.median(learned.predict_with_uncertainty(windows, alone)[1])).all()


def test_a_window_is_predicted_alone_as_among_others(
    plant: Plant, truth: Plant, learned: AdaptiveCalibrator
) -> None:
    windows = noisy(voyages(truth, 6, SECONDS, seed=3))
    alone = simulate_reference(windows, plant)
    single = [answers(learned, windows.subset(np.array([row])), alone[[row]]) for row in range(6)]
    for each, together in zip(zip(*single, strict=True), answers(learned, windows, alone), strict=True):
        assert np.concatenate(each) == pytest.approx(together, rel=1e-9)


def test_what_the_training_hardly_varied_is_not_outside_at_once(
    learned: AdaptiveCalibrator, training: PredictionWindows
) -> None:
    """A ship that never turned her pods knows of 5 degrees, and not of 80; in a calm she knows of a breeze."""
    straight = AdaptiveCalibrator(learned.seed, learned.plant).load_state_dict(learned.state_dict())
    straight.range_ = learned.range_.copy()
    straight.range_[:, 7:] = np.array([1.0, 0.0, 1.0, 0.0])
    straight.range_[:, 3] = 0.0
    for pod_deg, wind_mps, beyond in ((5.0, 1.5, False), (80.0, 1.5, True), (5.0, 9.0, True)):
        past = training.past.copy()
        past[..., [9, 11]], past[..., 7] = np.deg2rad(pod_deg), wind_mps
        windows = replace(training, past=past)
        assert (straight.outside_domain(windows, windows.track) == beyond).all()


@pytest.mark.parametrize(("column", "times"), [(3, 3.0), (5, 20.0)])
def test_speeds_far_from_the_training_are_outside(
    plant: Plant, truth: Plant, learned: AdaptiveCalibrator, column: int, times: float
) -> None:
    """What was trained on is inside; three times the speed, twenty times the rate of turn is not."""
    windows = voyages(truth, 20, SECONDS)
    start, past = windows.start.copy(), windows.past.copy()
    fast = times * np.abs(windows.start[:, column]).max()
    start[:, column], past[..., column] = fast, fast
    assert not learned.outside_domain(windows, windows.track).any()
    assert learned.outside_domain(replace(windows, start=start, past=past), windows.track).all()


@given(
    sizes=st.lists(st.integers(1, 30), min_size=1, max_size=25),
    seed=st.integers(0, 50),
)
def test_legs_go_whole_and_every_member_lacks_some(sizes: list[int], seed: int) -> None:
    """A leg is in one fold only, no fold is empty, and none is larger than its share and the longest leg."""
    leg = np.repeat([f"leg {number}" for number in range(len(sizes))], sizes)
    fold = _assign_folds(leg, seed)
    members = min(5, len(sizes))
    assert all(len(np.unique(fold[leg == name])) == 1 for name in np.unique(leg))
    counts = np.bincount(fold, minlength=members)
    assert len(counts) == members
    assert (counts > 0).all()
    assert counts.max() <= sum(sizes) / members + max(sizes)


def test_it_comes_back_to_the_bit(
    plant: Plant, truth: Plant, training: PredictionWindows, learned: AdaptiveCalibrator, tmp_path: Path
) -> None:
    """Through its state, and through the files of an artefact: the same tracks, uncertainty and flags."""
    windows = noisy(voyages(truth, 12, SECONDS, seed=4))
    alone = simulate_reference(windows, plant)
    examples = training, simulate_reference(training, plant)
    twin = make_calibrator("data_driven", 0, plant)
    vars(twin).update(epochs=2, batch=32)
    twin.fit(examples, examples)
    bands = learned.conformal_region(examples), Fallback.fit(*examples, plant)
    trained = TrainedCalibrator(learned, twin, SECONDS, "gunnerus_short", plant, *bands, (), {})
    loaded = load(save(trained, tmp_path).parent)
    assert np.array_equal(loaded.region_m, trained.region_m)
    for name in ("training_error_m", "hindcast_error_m", "region"):
        assert np.array_equal(getattr(loaded.fallback, name), getattr(trained.fallback, name))
    restored = AdaptiveCalibrator(learned.seed, plant).load_state_dict(learned.state_dict())
    for other in (restored, loaded.calibrator):
        for then, now in zip(answers(learned, windows, alone), answers(other, windows, alone), strict=True):
            assert np.array_equal(then, now)


@pytest.mark.parametrize("vessel", ["otter_2m", "esso_osaka_3m", "gunnerus_long"])
def test_starts_have_a_value_for_each_name_on_any_ship(vessel: str) -> None:
    """Also of a ship with two shafts and nothing that turns."""
    actuators = load_vessel(vessel).actuators
    controls = len(control_labels(actuators))
    windows = replace(
        windows_at(np.zeros((3, 6)), 4), actuators=actuators, control=np.full((3, controls), 0.5),
        past=np.full((3, PAST_S + 1, 8 + controls), np.nan), commands=np.zeros((3, 4, controls)),
    )  # fmt: skip
    assert start_quantities(windows).shape == (3, 4, len(start_quantity_names(actuators)))


@pytest.fixture(scope="module")
def another_day(truth: Plant) -> PredictionWindows:
    """The ship of the training, pushed by a wind that nobody measured and that the training did not have."""
    return noisy(voyages(truth.replaced(constant_X_n=-30e3, constant_Y_n=20e3), 24, SECONDS, seed=7))


def test_a_day_unlike_the_training_shows_in_the_last_minutes(
    plant: Plant, truth: Plant, learned: AdaptiveCalibrator, another_day: PredictionWindows
) -> None:
    """There the regions grow as the errors do, and the prediction follows what is measured more closely; on a day
    like the training's nothing of the kind happens.
    """
    same_day = noisy(voyages(truth, 24, SECONDS, seed=8))
    grown, off, alone_m = [], [], []
    for windows in (same_day, another_day):
        candidates = learned._candidates(windows, learned.vectors_)
        predicted, uncertainty = learned.predict_with_uncertainty(windows, simulate_reference(windows, plant))
        grown.append(float(np.median(uncertainty)))
        off.append(off_m(predicted, windows))
        alone_m.append(off_m(learned._average_candidates(candidates, learned.weight_power_)[0], windows))
    assert grown[1] > 1.3 * grown[0]
    assert off[0] == pytest.approx(alone_m[0], rel=0.1)
    assert off[1] < 0.8 * alone_m[1]


def test_the_last_minutes_are_hindcasts_one_by_one(
    plant: Plant, learned: AdaptiveCalibrator, another_day: PredictionWindows
) -> None:
    """15 s long or more, each predicted from what was known at its start, with the commands that were given."""
    windows, vector = another_day.subset(np.arange(3)), learned.vectors_.mean(axis=0)
    found = learned._candidates(windows, vector[None]).minutes[0]
    logs = []
    length_s = learned.hindcast_s_
    assert length_s == max(windows.horizon_s, 15)
    for began_s in range(length_s, PAST_S - 15, 15):
        before = hindcast_windows(windows, began_s, horizon_s=length_s)
        assert np.array_equal(before.track, windows.past[:, began_s - np.arange(length_s + 1), :3])
        logs.append(np.log(distances(tracks(vector, plant, before), before.track).mean(axis=1)))
    assert found == pytest.approx(np.mean(logs, axis=0), abs=1e-4)
    blind = replace(windows, past=np.full_like(windows.past, np.nan))
    assert np.isnan(learned._candidates(blind, vector[None]).minutes).all()


def test_a_day_is_never_better_than_the_training() -> None:
    """And a worse one counts the more the surer it is: with a wide scatter of minutes it may be chance."""
    sure, unsure = (_TrainingStatistics(1.0, np.ones(3), 0.0, deviation, 1.0) for deviation in (0.1, 2.0))
    minutes = np.array([-3.0, 0.0, 0.5, 2.0, np.nan])
    assert sure.error_factor_of_day(minutes)[[0, 1, 4]] == pytest.approx(1.0)
    assert (np.diff(sure.error_factor_of_day(minutes)[1:4]) > 0.0).all()
    assert (unsure.error_factor_of_day(minutes)[2:4] < sure.error_factor_of_day(minutes)[2:4]).all()
    assert (sure.error_factor_of_day(minutes)[2:4] < np.exp(minutes[2:4])).all()


def test_outside_its_range_it_goes_on_by_itself(plant: Plant, learned: AdaptiveCalibrator) -> None:
    """Beside the baselines, by how well each does now; the fallback has no say."""
    windows = noisy(voyages(plant, 8, SECONDS, seed=9))
    windows = replace(windows, wind=windows.wind + np.array([0.0, 30.0]))
    windows.past[..., 7] += 30.0
    alone = simulate_reference(windows, plant)
    assert learned.outside_domain(windows, alone).all()
    fallback = Fallback.fit(windows, alone, plant)
    found = predict_with_fallback(learned, plant, learned.region_, fallback, windows, alone)
    assert (found.source == "hybrid").all()
    assert np.array_equal(found.tracks, learned.predict(windows, alone))
    assert found.outside_domain.all()
    blind = replace(windows, past=np.full_like(windows.past, np.nan))
    assert np.isfinite(learned.predict(blind, alone)).all()


def test_many_windows_are_hindcast_as_few_are(
    plant: Plant, learned: AdaptiveCalibrator, another_day: PredictionWindows, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A day of them is looked back on in parts, as all at once would fill the memory."""
    alone = simulate_reference(another_day, plant)
    whole = answers(learned, another_day, alone)
    monkeypatch.setattr("seatrial.hybrid.calibrators.adaptive._AT_ONCE", 5)
    for parted, together in zip(answers(learned, another_day, alone), whole, strict=True):
        assert np.array_equal(parted, together)
