"""The adaptive calibrator on a simulator of another make: it learns what acts on it from outside."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import pytest

import seatrial as st
from seatrial.acquisition.core.quantities import Floats
from seatrial.hybrid.calibrators.adaptive import (
    AdaptiveCalibrator,
    adapt_simulator,
    fit_parameter_vector,
    form_of,
    observations_of_windows,
    observer_gains,
    parameter_names,
    parameters_of_calibrator,
    parameters_with_effect,
    run_observer,
    run_observers,
)
from seatrial.hybrid.effects import vessel_plant
from seatrial.hybrid.prediction.baselines import distances
from seatrial.hybrid.prediction.dataset import load_dataset
from seatrial.hybrid.prediction.kalman_filter import Observations
from seatrial.hybrid.vessel.black_box import BlackBox, MotionModel
from seatrial.hybrid.vessel.files import load_vessel
from tests.hybrid.own_simulator.conftest import Sailed
from tests.hybrid.own_simulator.test_predictions import GUNNERUS
from tests.hybrid.windows_by_hand import voyages

DRAGGY_PM = 0.006 / 8.0 / (1852.0 / 3600.0)
"""How much more drag the ship has than its model, per metre (sailer.txt)."""


def vector_of(model: MotionModel, **deviations: float) -> Floats:
    """A vector with some parameters, in their prior standard deviations."""
    return np.array([deviations.get(name, 0.0) for name in parameter_names(form_of(model))])


@pytest.fixture
def sailer(shipyard: Path) -> BlackBox:
    return st.load_simulator(f"{shipyard}/sailer.py:Sailer")


@pytest.fixture(scope="module")
def observed() -> Observations:
    """A minute of a ship with a propeller and a rudder, at rest before nothing was recorded."""
    random = np.random.default_rng(2)
    past = np.zeros((3, 31, 10))
    past[..., 0], past[..., 3] = -5.0 * np.arange(31.0), 5.0
    past[..., :6] += 0.01 * random.normal(size=(3, 31, 6))
    past[..., 7:] = [4.0, 3.0, 0.1]
    past[:, :10, 8] = 3.5
    control, wind = np.tile([3.0, 0.1], (3, 8, 1)), np.tile([1.0, 4.0], (3, 8, 1))
    return Observations(past, np.array([30, 30, 12]), control, wind)


def test_observer_of_a_simulator_is_that_of_the_vessel_file_it_is_the_class_of(tmp_path: Path) -> None:
    """With a current, a steady wind and other noise levels, on windows with long and short pasts."""
    plant = vessel_plant(load_vessel("gunnerus_short"))
    (tmp_path / "own.py").write_text(
        GUNNERUS.replace("vectorised = True", "vectorised = True\n    patience_s = 600.0")
    )
    model = st.load_simulator(f"{tmp_path}/own.py:Gunnerus")
    windows = voyages(plant.replaced(constant_N_nm=2e4), 6, 6)
    windows.past[3:, 10:] = np.nan
    observations = observations_of_windows(windows)
    adapted = {"current_north": 1.0, "current_east": -0.5, "wind_north": 0.7, "force_walk_yaw": 0.4,
               "wave_period": 0.5, "force_decay_surge": -1.0}  # fmt: skip
    ours, as_class = (run_observer(vector_of(one, **adapted), one, observations) for one in (plant, model))
    for expected, actual in zip(ours, as_class, strict=True):
        np.testing.assert_allclose(actual, expected, atol=1e-5)
    unadapted, _ = run_observer(vector_of(plant), plant, observations)
    assert np.abs(ours[0] - unadapted).max() > 0.05


def test_models_run_together_as_each_alone(sailer: BlackBox, observed: Observations) -> None:
    vectors = 0.3 * np.random.default_rng(1).normal(size=(3, len(parameter_names(sailer))))
    vectors[:, [parameter_names(sailer).index(f"wind_{axis}") for axis in ("north", "east")]] = 0.2
    together = run_observers(vectors, sailer, observed)
    for number, vector in enumerate(vectors):
        for all_runs, alone in zip(together, run_observer(vector, sailer, observed), strict=True):
            np.testing.assert_allclose(all_runs[number], alone, atol=1e-12)


def test_no_departure_is_the_simulator_and_each_parameter_does_something(
    sailer: BlackBox, observed: Observations
) -> None:
    """But for a drift force, which cannot be given to it from outside."""
    zero = vector_of(sailer)
    assert adapt_simulator(zero, sailer) == sailer
    as_it_is, waves = run_observer(zero, sailer, observed)
    for name, effective in zip(parameter_names(sailer), parameters_with_effect(sailer), strict=True):
        vector = vector_of(sailer, **{name: 1.0})
        states, moved = run_observer(vector, sailer, observed)
        same = np.array_equal(states, as_it_is) and np.array_equal(moved, waves)
        gains = observer_gains(vector, sailer)[0], observer_gains(zero, sailer)[0]
        assert same == (not effective) or (name == "stamp_jitter" and not np.array_equal(*gains)), name


def test_drag_that_a_simulator_lacks_is_learned(sailer: BlackBox, sailed: Sailed) -> None:
    """It takes most of the error of a voyage that it was not learned from; two steps do not yet tell it from
    a shaft that gives less."""
    windows, unseen = (load_dataset([sailed("Draggy", seed)], 15, 10).windows for seed in (0, 7))
    vector = fit_parameter_vector(sailer, observations_of_windows(windows), windows.track, 1.0, steps=2)
    assert 0.0 < adapt_simulator(vector, sailer).number("surge_drag_pm") < 1.5 * DRAGGY_PM
    errors = []
    for parameters in (vector_of(sailer), vector):
        states, waves = run_observer(parameters, sailer, observations_of_windows(unseen))
        errors.append(np.nanmean(distances(states[..., :3] + waves, unseen.track)))
    assert errors[1] < 0.5 * errors[0]


@pytest.mark.slow
def test_trained_calibrator_is_saved_and_judged(shipyard: Path, sailed: Sailed, tmp_path: Path) -> None:
    """The truth lies in the interval of the drag, unseen voyages are predicted far better, and a saved one is the
    same."""
    recordings = [sailed("Draggy", seed) for seed in (0, 1)]
    name = f"{shipyard}/sailer.py:Sailer"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            "seatrial.hybrid.calibrators.adaptive.fit_parameter_vector", partial(fit_parameter_vector, steps=2)
        )
        patch.setattr("seatrial.hybrid.calibrators.can_train", lambda method: method == "adaptive")
        trained = st.train(recordings, name, "adaptive")
    assert isinstance(trained.calibrator, AdaptiveCalibrator)
    parameters = parameters_of_calibrator(trained.calibrator).identified
    drag = next(parameter for parameter in parameters if parameter.name == "surge_drag_pm")
    assert drag.low < DRAGGY_PM < drag.high
    unseen = sailed("Draggy", 7)
    validation = st.validate(unseen, trained)
    assert validation.reduction is not None
    assert validation.reduction > 0.6
    st.save_calibrator(trained, tmp_path / "calibrator")
    loaded = st.load_calibrator(tmp_path / "calibrator", vessel=name)
    before, after = (st.predict(unseen, "+200", calibrator) for calibrator in (trained, loaded))
    np.testing.assert_array_equal(before.track, after.track)
