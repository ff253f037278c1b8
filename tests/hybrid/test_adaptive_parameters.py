"""What the adaptive calibrator says of its parameters: near the truth where the data know them, honest where
not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from seatrial.acquisition.core.ship import DEFAULT
from seatrial.hybrid.calibrators.adaptive import (
    AdaptiveCalibrator,
    Parameters,
    parameter_names,
    parameters_of_calibrator,
    start_quantity_names,
)
from seatrial.hybrid.effects import vessel_plant
from seatrial.hybrid.prediction.baselines import simulate_reference
from seatrial.hybrid.prediction.dataset import load_dataset
from seatrial.hybrid.prediction.window_sets import PredictionWindows
from seatrial.hybrid.vessel.files import load_vessel
from seatrial.hybrid.vessel.plant import Form

FORM = Form("polynomial", DEFAULT)

pytestmark = pytest.mark.pages  # training takes its time


@pytest.fixture(scope="module")
def windows(earlier: list[Path]) -> PredictionWindows:
    return load_dataset(earlier[:2], 15, 15).windows


@pytest.fixture(scope="module")
def calibrator(windows: PredictionWindows) -> AdaptiveCalibrator:
    """On the model of the ship that sailed: what it lacks is current and drift, nothing of the ship."""
    plant = vessel_plant(load_vessel("gunnerus_long"))
    tracks = simulate_reference(windows, plant)
    half = np.arange(len(windows)) % 2 == 0
    return AdaptiveCalibrator(0, plant).fit(
        (windows.subset(half), tracks[half]), (windows.subset(~half), tracks[~half])
    )


@pytest.fixture(scope="module")
def learned(calibrator: AdaptiveCalibrator) -> Parameters:
    return parameters_of_calibrator(calibrator)


def test_the_covariance_is_one_and_no_wider_than_the_prior(calibrator: AdaptiveCalibrator) -> None:
    covariance = calibrator.covariance_
    assert covariance.shape == (len(parameter_names(FORM)), len(parameter_names(FORM)))
    np.testing.assert_allclose(covariance, covariance.T, rtol=1e-6, atol=1e-12)
    assert np.linalg.eigvalsh(covariance).min() > 0.0
    assert np.linalg.eigvalsh(covariance).max() <= 1.0 + 1e-9


def test_the_current_is_known_best_and_found_within_its_interval_and_drift(learned: Parameters) -> None:
    """The gentle sea's current is 0.2 m/s towards 210 deg; wave drift of the same direction goes with it in
    part."""
    best = {each.name: each for each in learned.identified}
    north, east = best["current north"], best["current east"]
    towards = np.rad2deg(np.arctan2(east.value, north.value)) % 360.0
    assert towards == pytest.approx(210.0, abs=20.0)
    assert np.hypot(north.value, east.value) == pytest.approx(0.2, abs=0.06)
    assert north.unit == "m/s"


def test_what_is_right_in_the_model_stays_near_it(learned: Parameters) -> None:
    factors = [each for each in learned.parameters if each.neutral == 1.0]
    far = [each.name for each in factors if not each.low - each.error <= 1.0 <= each.high + each.error]
    assert len(far) <= 0.1 * len(factors), far
    assert not [each.name for each in factors if each.at_bound]


def test_the_best_known_come_first_and_the_unknown_say_so(learned: Parameters) -> None:
    known = [each.identified for each in learned.parameters]
    assert known == sorted(known, reverse=True)
    assert 0 < sum(known) < len(known)
    matrix = learned.correlation
    np.testing.assert_allclose(np.diag(matrix), 1.0)
    assert np.abs(matrix).max() <= 1.0 + 1e-9
    assert all(abs(value) > 0.95 for _, _, value in learned.inseparable_pairs())


def test_the_covariance_goes_to_disk_and_back(calibrator: AdaptiveCalibrator) -> None:
    again = AdaptiveCalibrator(0, calibrator.plant).load_state_dict(calibrator.state_dict())
    np.testing.assert_array_equal(again.covariance_, calibrator.covariance_)


def test_the_domain_says_which_quantity_lies_outside(
    calibrator: AdaptiveCalibrator, windows: PredictionWindows
) -> None:
    """A start twice as fast as any of the training is beyond it in surge, and in nothing else; outside agrees."""
    fast = windows.subset(np.arange(3))
    fast.start[:, 3] *= 4.0
    fast.past[..., 3] *= 4.0
    domain = calibrator.domain(fast, simulate_reference(fast, calibrator._model))
    assert domain.names == start_quantity_names(DEFAULT)
    assert domain.outside.all(axis=0).tolist() == [name == "surge_mps" for name in start_quantity_names(DEFAULT)]
    assert calibrator.outside_domain(fast, fast.track).all()
    assert not calibrator.outside_domain(windows, windows.track).any()


def test_values_are_the_models_own_and_what_was_learned(calibrator: AdaptiveCalibrator) -> None:
    """A model that has a current of 0.3 m/s and learned nothing has it still; a lag below none is at its bound."""
    assert calibrator.plant is not None
    plant = calibrator.plant.replaced(current_north_mps=0.3, thruster_lag_s=0.5)
    told = AdaptiveCalibrator(0, plant)
    told.vectors_, told.covariance_ = (
        np.zeros((2, len(parameter_names(FORM)))),
        np.eye(len(parameter_names(FORM))),
    )
    every = {each.name: each for each in parameters_of_calibrator(told).parameters}
    assert every["current north"].value == pytest.approx(0.3)
    assert every["thruster lag"].value == pytest.approx(0.5)
    assert not any(each.at_bound for each in every.values())
    told.vectors_[:, parameter_names(FORM).index("thruster_lag")] = -0.6
    told.vectors_[:, parameter_names(FORM).index("thrust_nn")] = 3.95
    every = {each.name: each for each in parameters_of_calibrator(told).parameters}
    assert every["thruster lag"].value == 0.0
    assert {name for name, each in every.items() if each.at_bound} == {"thruster lag", "thrust_nn"}
