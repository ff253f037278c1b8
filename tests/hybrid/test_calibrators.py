"""Calibrators: scaling, learning, stopping, seeds and circles."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.acquisition.core.quantities import Floats
from seatrial.acquisition.core.ship import DEFAULT
from seatrial.hybrid.calibrators import METHODS, make_calibrator
from seatrial.hybrid.calibrators.network_training import StoppingRule, fit_network
from seatrial.hybrid.calibrators.networks import (
    REFERENCE_INPUTS,
    AdditiveCalibrator,
    DataDrivenCalibrator,
    NetworkCalibrator,
    PaperCalibrator,
    PublishedPaperCalibrator,
    Standardisation,
    start_inputs,
    start_labels,
)
from seatrial.hybrid.prediction.baselines import score
from seatrial.hybrid.prediction.window_sets import PredictionWindows
from tests.conftest import nightly
from tests.hybrid.windows_by_hand import moved, random_windows, windows_at

SECONDS = 8
Data = tuple[PredictionWindows, Floats]
NETWORKS = [method for method in METHODS if isinstance(make_calibrator(method), NetworkCalibrator)]


def drifting(count: int, seed: int = 0) -> Data:
    """Windows whose ships are set north-west and slowed down, and a reference that knows nothing of it.

    The truth is linear in what the calibrator sees: the reference's displacement and the second.
    """
    windows = random_windows(count, SECONDS, seed)
    reference = windows.track.copy()
    set_m = np.arange(SECONDS + 1.0)[:, None] * [0.4, -0.3]
    track = reference.copy()
    track[..., :2] = windows.start[:, None, :2] + 0.9 * (reference - windows.start[:, None, :3])[..., :2] + set_m
    return replace(windows, track=track), reference


def network(method: str, seed: int, epochs: int, batch: int) -> NetworkCalibrator:
    """An untrained network, soon trained."""
    calibrator = make_calibrator(method, seed)
    assert isinstance(calibrator, NetworkCalibrator)
    calibrator.epochs, calibrator.batch = epochs, batch
    return calibrator


def states(calibrator: NetworkCalibrator) -> dict[str, list[float]]:
    return {name: tensor.flatten().tolist() for name, tensor in calibrator.state_dict().items()}


@given(
    mean=st.floats(-1e3, 1e3),
    deviation=st.floats(1e-3, 1e3),
    rows=st.integers(2, 40),
    seed=st.integers(0, 100),
)
def test_scaling_comes_back(mean: float, deviation: float, rows: int, seed: int) -> None:
    """Columns go to mean zero and deviation one, and back; a constant column becomes zero and comes back."""
    random = np.random.default_rng(seed)
    columns = mean + deviation * random.normal(size=(rows, 3))
    columns[:, 1] = mean
    scaling = Standardisation.of(columns)
    scaled = scaling.standardise(columns)
    assert np.isfinite(scaled).all()
    assert np.abs(scaled.mean(axis=0)).max() < 1e-6
    assert scaled[:, [0, 2]].std(axis=0) == pytest.approx(1.0, rel=1e-6)
    assert (scaled[:, 1] == 0.0).all()
    assert scaling.restore_scale(scaled) == pytest.approx(columns, rel=1e-9, abs=1e-9)


def test_what_was_constant_in_training_cannot_blow_up_later() -> None:
    """The tunnel thruster never ran in training; when it does run, the prediction stays where it was."""
    data = drifting(40)
    calibrator = PaperCalibrator(epochs=3, batch=64).fit(data, drifting(10, seed=1))
    windows, reference = drifting(5, seed=2)
    control = windows.control.copy()
    control[:, 4] = 300.0
    running = calibrator.predict(replace(windows, control=control), reference)
    assert np.array_equal(running, calibrator.predict(windows, reference))


@pytest.mark.parametrize("kind", [PaperCalibrator, *nightly(PublishedPaperCalibrator)])
def test_a_linear_truth_is_learned(kind: type[PaperCalibrator]) -> None:
    """The set and the loss of speed are found on windows that were not seen: four fifths of the error go."""
    calibrator = kind(epochs=150, batch=64).fit(drifting(200), drifting(40, seed=1))
    windows, reference = drifting(80, seed=2)
    before = score(reference, windows.track).mean_distance_m
    after = score(calibrator.predict(windows, reference), windows.track).mean_distance_m
    assert after < 0.2 * before


@pytest.mark.parametrize("method", NETWORKS)
def test_a_seed_is_one_calibrator(method: str) -> None:
    """The same seed gives the same numbers to the last bit whatever was drawn before; another others."""

    def fitted(seed: int) -> NetworkCalibrator:
        return network(method, seed, 4, 32).fit(drifting(30), drifting(8, seed=1))

    first = states(fitted(7))
    torch.rand(5)
    assert states(fitted(7)) == first
    assert states(fitted(8)) != first


def test_the_additive_one_learns_the_error_of_the_reference() -> None:
    """Where the reference errs by one constant, what is left to learn is constant: even an untrained network
    predicts it to the bit, and the paper's, which has to learn the motion, does not."""
    windows, reference = drifting(40)
    offset_m = np.array([3.0, -2.0, 0.0])
    wrong = reference.copy()
    wrong[:, 1:] = windows.track[:, 1:] + offset_m
    found = {
        kind: kind(epochs=1, batch=64).fit((windows, wrong), (windows, wrong))
        for kind in (AdditiveCalibrator, PaperCalibrator)
    }
    unseen, _ = drifting(10, seed=2)
    wrong = unseen.track + offset_m
    after = {
        kind: np.abs(each.predict(unseen, wrong) - unseen.track)[..., :2].max() for kind, each in found.items()
    }
    assert after[AdditiveCalibrator] < 1e-9 < 1.0 < after[PaperCalibrator]
    further = found[AdditiveCalibrator].predict(unseen, wrong + np.linspace(0.0, 1e4, SECONDS + 1)[:, None])
    assert np.diff(further - unseen.track, axis=1)[:, 1:, :2] == pytest.approx(1e4 / SECONDS)


def test_a_step_of_adam_is_its_equation() -> None:
    """The first step of Kingma and Ba (2015, algorithm 1) is the rate, against the sign of each derivative."""
    network, rows = torch.nn.Sequential(torch.nn.Linear(2, 1)).double(), torch.eye(2, dtype=torch.float64)
    with torch.no_grad():
        network[0].weight.copy_(torch.tensor([[3.0, -2.0]]))
        network[0].bias.zero_()
    data = rows, torch.zeros(2, 1, dtype=torch.float64)
    fit_network(network, data, data, StoppingRule(steps=1, rows=2, patience=1), None)
    weights = torch.nn.utils.parameters_to_vector(network.parameters()).tolist()
    assert weights == pytest.approx([3.0 - 1e-3, -2.0 + 1e-3, -1e-3], abs=1e-9)


def test_progress_goes_from_nothing_to_all() -> None:
    shares: list[float] = []
    PaperCalibrator(epochs=5, batch=64).fit(drifting(20), drifting(5, seed=1), shares.append)
    assert shares == pytest.approx([0.2, 0.4, 0.6, 0.8, 1.0])


def test_data_driven_knows_no_reference() -> None:
    """Neither in training nor in prediction does it look at the reference's track, its heading included."""
    data, stopping, unseen = drifting(30), drifting(8, seed=1), drifting(10, seed=2)
    blind = [(windows, np.full_like(track, np.nan)) for windows, track in (data, stopping, unseen)]
    seeing = DataDrivenCalibrator(epochs=4, batch=32).fit(data, stopping)
    without = DataDrivenCalibrator(epochs=4, batch=32).fit(blind[0], blind[1])
    assert states(seeing) == states(without)
    assert np.array_equal(seeing.predict(*unseen), without.predict(*blind[2]))


def test_the_hybrid_does_look_at_the_reference() -> None:
    calibrator = PaperCalibrator(epochs=4, batch=32).fit(drifting(30), drifting(8, seed=1))
    windows, reference = drifting(10, seed=2)
    other = reference + np.linspace(0.0, 5.0, SECONDS + 1)[:, None]
    assert not np.allclose(calibrator.predict(windows, reference), calibrator.predict(windows, other))


@pytest.mark.parametrize("method", NETWORKS)
@settings(max_examples=15, deadline=None)
@given(north=st.floats(-1e4, 1e4), east=st.floats(-1e4, 1e4))
def test_predictions_go_with_the_ship(fitted: dict[str, NetworkCalibrator], method: str, north: float,
                                      east: float) -> None:  # fmt: skip
    """Where the ship is makes no difference to how she moves; the track starts at her."""
    windows, reference = drifting(6, seed=4)
    there, by = moved(windows, north, east), np.array([north, east, 0.0])
    here = fitted[method].predict(windows, reference)
    shifted = fitted[method].predict(there, reference + by)
    assert shifted == pytest.approx(here + by, abs=1e-6)
    assert np.array_equal(here[:, 0, :2], windows.start[:, :2])


@pytest.fixture(scope="module")
def fitted() -> dict[str, NetworkCalibrator]:
    """One calibrator a method, hardly trained."""
    data = drifting(30), drifting(8, seed=1)
    return {method: network(method, 0, 3, 64).fit(*data) for method in NETWORKS}


@pytest.mark.parametrize("method", NETWORKS)
def test_north_is_no_edge(fitted: dict[str, NetworkCalibrator], method: str) -> None:
    """359.9 and 0.1 degrees, and 360 more, are neighbours for heading, wind and azimuths alike."""

    def predicted(angle_deg: float) -> tuple[Floats, Floats]:
        angle = np.deg2rad(angle_deg)
        windows = windows_at([0.0, 0.0, angle, 4.0, 0.1, 0.0], SECONDS, wind=(angle, 5.0))
        control = windows.control.copy()
        control[:, [1, 3]] = angle
        windows = replace(windows, control=control)
        return start_inputs(windows), fitted[method].predict(windows, windows.track)[..., :2]

    for before, after, most in ((359.9, 0.1, 0.01), (180.1, -179.9, 1e-9), (10.0, 370.0, 1e-9)):
        (features_a, track_a), (features_b, track_b) = predicted(before), predicted(after)
        assert np.abs(features_a - features_b).max() < most
        assert np.abs(track_a - track_b).max() < max(20 * most, 1e-8)  # the ship goes 32 m


@pytest.mark.parametrize("method", NETWORKS)
def test_inputs_have_names(fitted: dict[str, NetworkCalibrator], method: str) -> None:
    """As many columns as names, and the reference's displacement stands where its names do."""
    windows, reference = drifting(6, seed=4)
    features = fitted[method].features(windows, reference)
    inputs = fitted[method].input_names
    assert features.shape == (6, SECONDS, len(inputs))
    assert features[0, :, inputs.index("second")].tolist() == list(range(1, SECONDS + 1))
    assert inputs[: len(start_labels(DEFAULT))] == start_labels(DEFAULT)
    if fitted[method].needs_reference:
        north = features[..., inputs.index(REFERENCE_INPUTS[0])]
        assert np.array_equal(north, reference[:, 1:, 0] - windows.start[:, None, 0])


def test_an_unknown_method_lists_the_known() -> None:
    with pytest.raises(ConfigurationError, match="paper, data_driven"):
        make_calibrator("oracle")
