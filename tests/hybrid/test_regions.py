"""Conformal regions, and the fallback outside a calibrator's domain of applicability."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, ClassVar, Self

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import binom

from seatrial.acquisition.core.quantities import Bools, Floats
from seatrial.acquisition.core.ship import Actuators
from seatrial.hybrid.calibrators import (
    Calibrator,
    DomainOfApplicability,
    Examples,
    Progress,
    predict_with_fallback,
)
from seatrial.hybrid.calibrators.networks import PaperCalibrator
from seatrial.hybrid.prediction.baselines import (
    FALLBACK_BASELINES,
    HINDCAST_S,
    CandidatePrediction,
    Fallback,
    conformal_region,
    constant_velocity,
    equal_area_radius,
    mean_track_distances,
    region_outlines,
    relative_distances,
    simulate_reference,
)
from seatrial.hybrid.prediction.kalman_filter import filtered_starts
from seatrial.hybrid.prediction.window_sets import (
    PAST_S,
    PredictionWindows,
    concatenate_windows,
    hindcast_windows,
)
from seatrial.hybrid.vessel.dynamics import simulate_batch
from seatrial.hybrid.vessel.plant import Plant
from tests.hybrid.windows_by_hand import random_windows, voyages

SECONDS = 12


class Boastful(Calibrator):
    """Right to the centimetre up to three metres a second; beyond it is a kilometre off and knows it, or says what
    is no number and does not.
    """

    method: ClassVar[str] = "boastful"
    beyond: float = 1000.0

    def input_names_for(self, actuators: Actuators) -> tuple[str, ...]:
        return ()

    def fit(self, training: Examples, stopping: Examples, progress: Progress = lambda share: None) -> Self:
        return self

    def predict(self, windows: PredictionWindows, reference: Floats) -> Floats:
        off = np.where(self._fast(windows), self.beyond, 0.01)
        return windows.track + off[:, None, None]

    def domain(self, windows: PredictionWindows, reference: Floats) -> DomainOfApplicability:
        raise NotImplementedError

    def outside_domain(self, windows: PredictionWindows, reference: Floats) -> Bools:
        return self._fast(windows) if np.isfinite(self.beyond) else np.zeros(len(windows), dtype=bool)

    def _fast(self, windows: PredictionWindows) -> Bools:
        return np.asarray(windows.start[:, 3] > 3.0)

    def state_dict(self) -> dict[str, Any]:
        return {}

    def load_state_dict(self, tensors: dict[str, Any]) -> Self:
        return self


def two_ships(plant: Plant, thrust_share: float) -> PredictionWindows:
    """Ships on new courses that the reference knows to the letter, and others, with that share of her thrust, that
    it does not. Starts are smoothed, so they are a bit off what was measured.
    """
    weak = plant.replaced(thrust_nn=thrust_share * plant.number("thrust_nn"))
    windows = concatenate_windows([voyages(plant, 40, SECONDS), voyages(weak, 40, SECONDS, seed=1)])
    return replace(windows, start=windows.start + np.array([0.1, -0.1, 0.0, 0.02, 0.0, 0.0]))


@pytest.fixture(scope="module")
def turning(plant: Plant) -> PredictionWindows:
    """Of the known ships the reference is the better guess, of most of the others constant velocity."""
    return two_ships(plant, 0.6)


def without_past(windows: PredictionWindows, which: Bools) -> PredictionWindows:
    """The windows, of which some know nothing of what came before."""
    return replace(windows, past=np.where(which[:, None, None], np.nan, windows.past))


def hindcasts(windows: PredictionWindows, plant: Plant) -> Floats:
    """How far off reference and constant velocity were over the last seconds [2, N], one window at a time."""
    errors = np.empty((2, len(windows)))
    starts = filtered_starts(hindcast_windows(windows, HINDCAST_S), plant).start
    for number, past in enumerate(windows.past):
        rows = past[HINDCAST_S::-1]
        control = 0.5 * (rows[1:, 8:] + rows[:-1, 8:])  # the angles of these ships do not go round
        wind = np.tile(rows[0, 6:8], (HINDCAST_S, 1))
        model = simulate_batch(plant, starts[number], control[None], wind[None], 1.0).states[0]
        started = replace(windows.subset(np.array([number])), start=starts[number][None], track=rows[None, :, :3])
        for way, track in enumerate((model, constant_velocity(started)[0])):
            errors[way, number] = np.hypot(*(track[1:, :2] - rows[1:, :2]).T).mean()
    return errors


def test_hindcast_windows_are_what_was_recorded(plant: Plant) -> None:
    """So many seconds before, on the model that is the ship: its run from there ends where the ship is now."""
    windows = voyages(plant, 10, SECONDS)
    before = hindcast_windows(windows, HINDCAST_S)
    wind = np.repeat(before.wind[:, None], HINDCAST_S, axis=1)
    states = simulate_batch(plant, before.start, before.acting_controls, wind, 1.0).states
    assert states[..., :3] == pytest.approx(before.track, abs=1e-6)
    assert states[:, -1] == pytest.approx(windows.past[:, 0, :6], abs=1e-6)
    assert np.array_equal(before.past[:, 0, :6], before.start)
    assert np.array_equal(before.past[:, PAST_S - HINDCAST_S], windows.past[:, PAST_S])
    assert np.isnan(before.past[:, PAST_S - HINDCAST_S + 1 :]).all()


def test_a_pod_goes_the_short_way_round(plant: Plant) -> None:
    """From 179 to -179 degrees a pod turns by two degrees aft, and did not point ahead between."""
    windows = voyages(plant, 2, SECONDS)
    past = windows.past.copy()
    past[:, ::2, 9], past[:, 1::2, 9] = np.deg2rad(179.0), np.deg2rad(-179.0)
    acted = hindcast_windows(replace(windows, past=past), HINDCAST_S).acting_controls
    assert np.cos(acted[..., 1]) == pytest.approx(-1.0, abs=1e-9)


@pytest.fixture(scope="module")
def fallback(plant: Plant, turning: PredictionWindows) -> Fallback:
    return Fallback.fit(turning, simulate_reference(turning, plant), plant)


def test_errors_are_those_of_the_training(plant: Plant, turning: PredictionWindows, fallback: Fallback) -> None:
    both = simulate_reference(turning, plant), constant_velocity(turning)
    assert fallback.training_error_m == pytest.approx(
        [mean_track_distances(each, turning.track).mean() for each in both]
    )
    assert fallback.hindcast_error_m == pytest.approx(hindcasts(turning, plant).mean(axis=1))


def test_the_better_hindcast_weighs_more(plant: Plant) -> None:
    """Window by window the baseline of which the smaller error is expected, and each has its turn; what is said
    lies between the two, near the better one where it is much better.
    """
    turning = two_ships(plant, 0.8)
    alone = simulate_reference(turning, plant)
    fallback = Fallback.fit(turning, alone, plant)
    # nothing is believed to be perfect: a hundredth of the usual error is always reckoned with
    expected = fallback.training_error_m[:, None] * np.sqrt(
        hindcasts(turning, plant) / fallback.hindcast_error_m[:, None] + 0.01
    )
    found = fallback.predict(turning, alone, plant)
    best = np.argmin(expected, axis=0)
    clear = expected.max(axis=0) > 1.5 * expected.min(axis=0)
    assert 0 < best[clear].sum() < clear.sum()
    assert found.source[clear].tolist() == np.array(["reference", "constant_velocity"])[best[clear]].tolist()
    both = np.stack([alone, constant_velocity(turning)])
    assert ((found.tracks >= both.min(axis=0) - 1e-9) & (found.tracks <= both.max(axis=0) + 1e-9)).all()
    apart = np.abs(both[0] - both[1])[clear]
    share = np.abs(found.tracks - both[best, np.arange(len(best))])[clear] / np.maximum(apart, 1e-9)
    assert share.max() < 0.25


def test_hindcasts_help(plant: Plant, turning: PredictionWindows, fallback: Fallback) -> None:
    """On a ship of which either baseline may be the better one what is said beats both, on the whole."""
    alone = simulate_reference(turning, plant)
    said = mean_track_distances(fallback.predict(turning, alone, plant).tracks, turning.track).mean()
    assert said < min(
        mean_track_distances(each, turning.track).mean() for each in (alone, constant_velocity(turning))
    )


def test_a_perfect_baseline_or_one_out_of_range_does_no_harm(plant: Plant) -> None:
    """On the model's own voyages the reference never errs, and speaks; where it leaves its range the other does."""
    windows = voyages(plant, 30, SECONDS)
    alone = simulate_reference(windows, plant)
    fallback = Fallback.fit(windows, alone, plant)
    assert (fallback.training_error_m > 0.0).all()
    assert mean_track_distances(fallback.predict(windows, alone, plant).tracks, windows.track).max() < 0.01
    lost = fallback.predict(windows, np.full_like(alone, np.nan), plant)
    assert (lost.source == "constant_velocity").all()
    assert np.array_equal(lost.tracks, constant_velocity(windows))


@pytest.mark.parametrize("better", [0, 1])
def test_without_a_past_the_training_decides(
    plant: Plant, turning: PredictionWindows, fallback: Fallback, better: int
) -> None:
    """Of windows that know nothing of the seconds before, whether all are such or some: and less surely."""
    alone = simulate_reference(turning, plant)
    number = np.arange(len(turning))
    usual_m = np.where(np.arange(2) == better, 0.1, 10.0)
    trained = replace(fallback, training_error_m=usual_m)
    for lost in (number < 7, number >= 0):
        found = trained.predict(without_past(turning, lost), alone, plant)
        assert (found.source[lost] == FALLBACK_BASELINES[better]).all()
        assert found.tracks[lost] == pytest.approx((alone, constant_velocity(turning))[better][lost], abs=1e-4)
        assert np.isfinite(found.expected_error_m).all()
        assert (
            found.expected_error_m[lost] >= fallback.predict(turning, alone, plant).expected_error_m.min()
        ).all()


@pytest.mark.parametrize("lost", [0, 5])
def test_a_window_is_predicted_by_itself(
    plant: Plant, turning: PredictionWindows, fallback: Fallback, lost: int
) -> None:
    """What is said of a window does not depend on which others are asked about with it."""
    windows = without_past(turning, np.arange(len(turning)) < lost)
    alone = simulate_reference(windows, plant)
    whole = fallback.predict(windows, alone, plant)
    for row in (0, 4, 20):
        single = fallback.predict(windows.subset(np.array([row])), alone[[row]], plant)
        assert single.tracks[0] == pytest.approx(whole.tracks[row], abs=1e-9)
        assert single.source[0] == whole.source[row]
        assert single.expected_error_m[0] == pytest.approx(whole.expected_error_m[row])


def test_nothing_after_the_start_is_used(plant: Plant, turning: PredictionWindows, fallback: Fallback) -> None:
    track = turning.track.copy()
    track[:, 1:] += 500.0
    alone = simulate_reference(turning, plant)
    then, now = (fallback.predict(each, alone, plant) for each in (turning, replace(turning, track=track)))
    assert np.array_equal(then.tracks, now.tracks)
    assert np.array_equal(then.expected_error_m, now.expected_error_m)


@pytest.mark.parametrize("beyond", [1000.0, np.nan, np.inf])
def test_outside_its_domain_a_calibrator_does_no_harm(
    plant: Plant, turning: PredictionWindows, fallback: Fallback, beyond: float
) -> None:
    """Where it says so itself, or predicts what is no number, the fallback predicts; elsewhere it is left alone."""
    calibrator = Boastful()
    calibrator.beyond = beyond
    alone = simulate_reference(turning, plant)
    region_m = np.linspace((0.1, 0.2), (1.0, 2.0), SECONDS)
    found = predict_with_fallback(calibrator, plant, region_m, fallback, turning, alone)
    fast = turning.start[:, 3] > 3.0
    assert 0 < fast.sum() < len(fast)
    assert np.array_equal(found.outside_domain, fast)
    assert np.array_equal(found.source == "hybrid", ~fast)
    assert np.array_equal(found.tracks[~fast], calibrator.predict(turning, alone)[~fast])
    assert np.array_equal(found.region_m[~fast], np.tile(region_m, ((~fast).sum(), 1, 1)))
    instead = fallback.predict(turning, alone, plant)
    assert found.tracks[fast] == pytest.approx(instead.tracks[fast], abs=1e-9)
    assert np.array_equal(found.source[fast], instead.source[fast])
    baselines = [mean_track_distances(each, turning.track)[fast] for each in (alone, constant_velocity(turning))]
    assert (mean_track_distances(found.tracks, turning.track)[fast] <= np.maximum(*baselines)).all()
    assert mean_track_distances(found.tracks, turning.track)[fast].mean() < min(each.mean() for each in baselines)


class Hindcasting(Boastful):
    """Off by ``off_m`` everywhere, and over the last seconds too; it was off by two centimetres in its training."""

    off_m: float = 0.02

    def predict(self, windows: PredictionWindows, reference: Floats) -> Floats:
        return np.asarray(windows.track + self.off_m / np.sqrt(2.0))

    def outside_domain(self, windows: PredictionWindows, reference: Floats) -> Bools:
        return np.zeros(len(windows), dtype=bool)

    def fallback_candidate(self, windows: PredictionWindows, tracks: Floats) -> CandidatePrediction | None:
        return CandidatePrediction(tracks, np.full(len(windows), self.off_m), np.array([0.02, 0.02]))


def test_inside_its_domain_a_calibrator_is_believed_as_it_hindcasts(
    plant: Plant, turning: PredictionWindows, fallback: Fallback
) -> None:
    """One that is as good as ever is left as it is, but for centimetres; one that is a kilometre off is not heard.
    The regions go with that.
    """
    alone, region_m = simulate_reference(turning, plant), np.linspace((0.1, 0.2), (1.0, 2.0), SECONDS)
    calibrator = Hindcasting()
    found = predict_with_fallback(calibrator, plant, region_m, fallback, turning, alone)
    others = fallback.predict(turning, alone, plant)
    others_m = mean_track_distances(others.tracks, turning.track)
    usual_m = mean_track_distances(found.tracks, turning.track)
    assert usual_m == pytest.approx(0.02, abs=0.02)
    calibrator.off_m = 1000.0
    found = predict_with_fallback(calibrator, plant, region_m, fallback, turning, alone)
    assert mean_track_distances(found.tracks, turning.track) == pytest.approx(others_m, rel=0.05, abs=0.05)
    assert (found.source == "hybrid").all()
    assert found.region_m == pytest.approx(others.expected_error_m[:, None, None] * fallback.region, rel=0.05)


def test_a_network_does_no_harm_on_a_ship_that_it_was_not_trained_on(plant: Plant) -> None:
    """Trained on a ship with nine tenths of the thrust and tried on one with three quarters of it: what it learned
    is of no use, inside its domain too, and it shows before.
    """

    def windows_of(thrust: float, count: int, seed: int) -> PredictionWindows:
        return voyages(plant.replaced(thrust_nn=thrust * plant.number("thrust_nn")), count, SECONDS, seed)

    examples, stopping = (
        (each, simulate_reference(each, plant)) for each in (windows_of(0.9, 120, 3), windows_of(0.9, 30, 5))
    )
    network = PaperCalibrator(0, plant, epochs=40).fit(examples, stopping)
    new = windows_of(0.75, 60, 4)
    model = simulate_reference(new, plant)
    fallback, region_m = Fallback.fit(*examples, plant), network.conformal_region(stopping)
    found = predict_with_fallback(network, plant, region_m, fallback, new, model)
    best_m = min(mean_track_distances(each, new.track).mean() for each in (model, constant_velocity(new)))
    bare_m = mean_track_distances(network.predict(new, model), new.track)[~found.outside_domain].mean()
    assert found.outside_domain.mean() < 0.5
    assert mean_track_distances(found.tracks, new.track).mean() < 1.05 * best_m < 0.1 * bare_m


def test_regions_grow(plant: Plant, turning: PredictionWindows, fallback: Fallback) -> None:
    """Positive, never falling, whoever speaks; and wider where the last seconds were further off."""
    alone = simulate_reference(turning, plant)
    found = predict_with_fallback(
        Boastful(), plant, np.linspace((0.1, 0.2), (1.0, 2.0), SECONDS), fallback, turning, alone
    )
    assert found.region_m.shape == (len(turning), SECONDS, 2)
    assert (found.region_m > 0.0).all()
    assert (np.diff(found.region_m, axis=1) >= 0.0).all()
    fast = turning.start[:, 3] > 3.0
    error_m = fallback.predict(turning, alone, plant).expected_error_m[fast]
    assert np.ptp(error_m) > 0.1
    assert np.diff(found.region_m[fast, -1][np.argsort(error_m)], axis=0).min() >= 0.0


def test_the_fallbacks_regions_hold_other_windows(plant: Plant) -> None:
    """Sized on one half of the windows they hold 95 % of the other half, as far as chance allows."""
    ship = plant.replaced(constant_N_nm=4e4, thrust_nn=0.9 * plant.number("thrust_nn"))
    sized, judged = (voyages(ship, 200, SECONDS, seed) for seed in (1, 2))
    fallback = Fallback.fit(sized, simulate_reference(sized, plant), plant)
    said = fallback.predict(judged, simulate_reference(judged, plant), plant)
    region_m = said.expected_error_m[:, None, None] * fallback.region
    inside = relative_distances(said.tracks, judged.track, region_m) <= 1.0
    # both halves are drawn by chance: twice the variance of one
    low = 1.0 - binom.ppf(0.999, 100, 0.05) / 100.0
    assert (inside.mean(axis=0) >= low).all()


@settings(max_examples=20, deadline=None)
@given(sized=st.integers(19, 120), seed=st.integers(0, 10_000))
def test_regions_hold_what_they_promise_however_few_sized_them(sized: int, seed: int) -> None:
    """Over many draws of exchangeable errors, each of its own spread, the share held is that of split conformal
    prediction, ceil((n + 1) 0.95) / (n + 1), within what chance does to it.
    """
    random = np.random.default_rng(seed)
    draws, judged = 40, 50
    windows = random_windows(sized + judged, 1, seed)
    spread = random.uniform(0.2, 3.0, (sized + judged, 1))
    held = 0
    for _ in range(draws):
        off = windows.track.copy()
        off[:, 1, :2] += spread * random.normal(size=(sized + judged, 2))
        first = np.arange(sized + judged) < sized
        region_m = spread[..., None] * conformal_region(off[first], windows.subset(first), spread[first])
        held += int((relative_distances(off, windows.track, region_m)[~first] <= 1.0).sum())
    expected = np.ceil((sized + 1) * 0.95) / (sized + 1)
    # a draw's coverage is a beta variable; its deviation bounds that of the mean, beside the binomial one
    beta = np.sqrt(expected * (1.0 - expected) / (sized + 2) / draws)
    chance = np.sqrt(expected * (1.0 - expected) / (draws * judged))
    assert held / (draws * judged) == pytest.approx(expected, abs=5.0 * np.hypot(beta, chance))


def test_wider_where_less_sure() -> None:
    """Errors in proportion to the spread: relative regions hold each half alike, one radius for all does not."""
    random = np.random.default_rng(0)
    windows = random_windows(800, 1)
    spread = np.where(np.arange(800) % 2, 4.0, 0.5)[:, None]
    off = windows.track.copy()
    off[:, 1, :2] += spread * random.normal(size=(800, 2))

    def held(region_m: Floats) -> list[float]:
        inside = relative_distances(off, windows.track, region_m) <= 1.0
        return [float(inside[half::2].mean()) for half in (0, 1)]

    assert held(spread[..., None] * conformal_region(off, windows, spread)) == pytest.approx(
        [0.95, 0.95], abs=0.025
    )
    one = held(conformal_region(off, windows))
    assert one[0] == 1.0
    assert one[1] < 0.93


def recordings(
    count: int, windows: int, along_m: float, across_m: float, seed: int
) -> tuple[Floats, PredictionWindows]:
    """Tracks that are off by normal errors along and across their own courses, in windows of some recordings."""
    random = np.random.default_rng(seed)
    drawn = random_windows(count * windows, 1, seed)
    course = random.uniform(-np.pi, np.pi, count * windows)
    off = np.repeat(drawn.track[:, :1], 2, axis=1)
    off[:, 1, :2] += 4.0 * np.column_stack([np.cos(course), np.sin(course)])
    along, across = random.normal(size=(2, count * windows)) * [[along_m], [across_m]]
    measured = off.copy()
    measured[:, 1, 0] -= along * np.cos(course) - across * np.sin(course)
    measured[:, 1, 1] -= along * np.sin(course) + across * np.cos(course)
    names = np.repeat([f"day {each}" for each in range(count)], windows)
    return off, replace(drawn, track=measured, trial=names)


def test_regions_are_long_where_errors_are() -> None:
    """Errors three times as large along the course as across, on many days: the ellipse is nearly as long, holds as
    many of another day, and is much smaller than a circle that does.
    """
    (off, sized), (others_off, others) = (recordings(30, 80, 3.0, 1.0, seed) for seed in (1, 2))
    (region_m,) = conformal_region(off, sized)
    assert region_m[0] / region_m[1] == pytest.approx(3.0, rel=0.15)
    inside = relative_distances(others_off, others.track, region_m[None]) <= 1.0
    assert inside.mean() == pytest.approx(0.95, abs=0.015)
    circle_m = np.quantile(np.hypot(*(others.track - others_off)[:, 1, :2].T), 0.95)
    assert equal_area_radius(region_m) < 0.85 * circle_m


def test_one_day_says_half_of_how_long_regions_are() -> None:
    """What one day's sensors did, another's may not do."""
    (one_m,), (many_m,) = (conformal_region(*recordings(count, 2400 // count, 3.0, 1.0, 3)) for count in (1, 30))
    assert np.log(one_m[0] / one_m[1]) == pytest.approx(0.5 * np.log(many_m[0] / many_m[1]), rel=0.15)


def test_legs_that_differ_widen_the_regions() -> None:
    """Six legs, each with errors of its own size: a seventh is held as well as was promised on average, which the
    quantile over the windows of the six does not do.
    """
    random = np.random.default_rng(0)
    windows = random_windows(7 * 40, 1, 1)
    legs = np.repeat([f"leg {each}" for each in range(7)], 40)
    windows = replace(windows, leg=legs)
    first = legs != "leg 6"
    held = {"by legs": [], "by windows": []}
    for _ in range(200):
        off = windows.track.copy()
        size = np.exp(0.7 * random.normal(size=7)).repeat(40)
        off[:, 1, :2] += size[:, None] * random.normal(size=(280, 2))
        for name, sized in (("by legs", windows), ("by windows", replace(windows, leg=np.arange(280).astype(str)))):
            region_m = conformal_region(off[first], sized.subset(first))
            held[name].append(np.mean(relative_distances(off, windows.track, region_m)[~first] <= 1.0))
    assert np.mean(held["by windows"]) < 0.92
    assert np.mean(held["by legs"]) > np.mean(held["by windows"]) + 0.015


def test_the_border_of_a_region_is_where_it_says() -> None:
    off, _ = recordings(1, 5, 3.0, 1.0, 5)
    region_m = np.array([[7.0, 2.0]])
    for track in off:
        border = region_outlines(track, region_m)[0]
        there = np.repeat(track[None], len(border), axis=0)
        there[:, 1, :2] = border
        on = np.repeat(track[None], len(border), axis=0)
        assert relative_distances(on, there, region_m[None]) == pytest.approx(1.0)
        assert np.linalg.norm(border - track[1, :2], axis=1).max() == pytest.approx(7.0)
