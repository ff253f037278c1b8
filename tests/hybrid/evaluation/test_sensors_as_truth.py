"""Judged by each sensor: floors that are the errors of a perfect prediction, and sensors that disagree."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from seatrial.acquisition.core.quantities import Floats
from seatrial.analysis.windows.held import OneHertzTables
from seatrial.hybrid.evaluation.validate import (
    TRUTHS,
    Validation,
    add_truth_tracks,
    errors_by_truth,
    truth_distances,
    truth_tracks,
    validate_predictions,
)
from seatrial.hybrid.prediction.baselines import constant_velocity
from seatrial.hybrid.prediction.dataset import Dataset, dataset_of
from seatrial.hybrid.prediction.window_sets import PredictionWindows
from seatrial.hybrid.simulation.trial import SimulationNoise, simulate_trial
from seatrial.hybrid.vessel.plant import Plant
from tests.conftest import nightly

HORIZON_S = 15
Trial = tuple[pd.DataFrame, Floats]


def trial_with(noise: SimulationNoise, seed: int = 3) -> Trial:
    """A voyage in a calm as recorded at 1 Hz, and its true states [rows, 6]."""
    table, truth = simulate_trial("gunnerus_long", "calm", "paper", 1500.0, 1.0, seed, noise=noise)
    return table, truth["states"]


@pytest.fixture(scope="module")
def usual() -> Trial:
    return trial_with(SimulationNoise())


def dataset_from(table: pd.DataFrame) -> Dataset:
    return dataset_of({"trial": OneHertzTables(table)}, HORIZON_S, 5, any_commands=True)


def judged(table: pd.DataFrame) -> PredictionWindows:
    return add_truth_tracks(dataset_from(table).windows, {"trial": table})


def perfect(windows: PredictionWindows, trial: Trial) -> Floats:
    """Where the ship really went in each window [N, H+1, 3]."""
    table, states = trial
    first = pd.DatetimeIndex(table.index).get_indexer(windows.start_time)
    return np.asarray(states[first[:, None] + np.arange(HORIZON_S + 1)][..., :3])


@pytest.mark.parametrize(
    "noise",
    [SimulationNoise(position_m=1.0), *nightly(SimulationNoise(), SimulationNoise(speed_mps=0.3, heading_deg=0.5))],
)
def test_the_floor_is_the_error_of_a_perfect_prediction(noise: SimulationNoise) -> None:
    """By every sensor, whichever is the poor one, though no noise level is told; and none is said to disagree."""
    trial = trial_with(noise)
    windows = judged(trial[0])
    errors_m = truth_distances(perfect(windows, trial), windows)
    found = errors_by_truth(windows, {"perfect": errors_m})
    assert found is not None
    assert found.remark == ""
    for name in TRUTHS:
        floor_m, error_m = found.by[name].floor_m, found.by[name].methods["perfect"]
        assert found.by[name].windows == len(windows)
        chance_m = np.hypot(floor_m.high - floor_m.low, error_m.high - error_m.low)
        assert floor_m.value == pytest.approx(error_m.value, abs=chance_m)
    joined = found.by["joined"].floor_m.value
    assert joined < min(found.by[name].floor_m.value for name in TRUTHS[:2])


def test_a_biased_speed_is_said_first(usual: Trial, plant: Plant) -> None:
    """On the terminal and in JSON, with a size; it is in every floor, as nobody knows which of the two it is."""

    def validated(bias_mps: float) -> Validation:
        table = usual[0].assign(surge_mps=usual[0]["surge_mps"] + bias_mps)
        dataset = dataset_from(table)
        return validate_predictions(
            replace(dataset, windows=add_truth_tracks(dataset.windows, {"trial": table})), plant
        )

    sound, biased = validated(0.0), validated(0.4)
    assert sound.truths is not None
    assert biased.truths is not None
    assert "disagree" not in str(sound)
    assert str(biased).splitlines()[0].startswith("positions and speeds disagree by 3.")
    (remark,) = json.loads(json.dumps(biased.as_dict(), allow_nan=False))["remarks"]
    assert remark == str(biased).splitlines()[0]
    apart_m = 0.4 * (HORIZON_S + 1) / 2  # the mean of 0.4 m/s times 1, 2, ... s
    assert biased.truths.apart_m.value == pytest.approx(apart_m, rel=0.05)
    for name in TRUTHS:
        assert biased.truths.by[name].floor_m.value == pytest.approx(apart_m, rel=0.1)
        assert sound.truths.by[name].floor_m.value < 0.2


def test_rebuilt_positions_are_not_what_they_are_judged_by(usual: Trial) -> None:
    """Windows whose positions have run away are judged by the measured ones, moved to where the windows begin."""
    table, _ = usual
    windows = judged(table)
    away = np.array([30.0, -20.0, 0.0])
    moved = replace(windows, track=windows.track + away, start=windows.start + np.append(away, np.zeros(3)))
    rebuilt = add_truth_tracks(moved, {"trial": table}, rebuilt=True)
    found, plain = (truth_distances(constant_velocity(each), each) for each in (rebuilt, windows))
    assert np.abs(found - plain).max() < 0.5
    assert rebuilt.truths is not None
    assert windows.truths is not None
    here = np.diff(windows.truths, axis=2)
    assert np.diff(rebuilt.truths, axis=2) == pytest.approx(here, abs=1e-9)


def test_a_leap_of_the_positions_is_no_motion(usual: Trial) -> None:
    """Windows across it are judged by dead reckoning alone, and not at all where it is in their own positions."""
    table, _ = usual
    after = np.arange(len(table)) >= 700
    leaping = table.assign(north_m=table["north_m"] + 300.0 * after)
    found = add_truth_tracks(dataset_from(table).windows, {"trial": leaping})
    assert found.truths is not None
    first = pd.DatetimeIndex(table.index).get_indexer(found.start_time)
    across = (first < 700) & (first + HORIZON_S >= 700)
    assert np.array_equal(np.isnan(found.truths[:, 0]).any(axis=(1, 2)), across)
    assert np.isfinite(found.truths[:, 1]).all()
    left = dataset_from(leaping)
    assert left.dropped["position_jump"] >= across.sum()
    assert set(left.windows.start_time) <= set(found.start_time[~across])


def test_dead_reckoning_of_a_circle_comes_back() -> None:
    """Speeds of a ship that turns once, and drifts aside as she does, lead round to where she was."""
    seconds = 400
    turn = 2.0 * np.pi * np.arange(seconds + 1) / seconds
    measured = np.zeros((1, seconds + 1, 6))
    measured[0, :, 2:5] = np.column_stack([turn, np.full(seconds + 1, 5.0), np.full(seconds + 1, -1.0)])
    radius_m = np.hypot(5.0, 1.0) * seconds / (2.0 * np.pi)
    joined = np.zeros((1, seconds + 1, 2))
    _, reckoned, _ = np.nan_to_num(truth_tracks(measured, joined))[0]
    assert reckoned[-1] == pytest.approx([0.0, 0.0], abs=1e-9)
    assert np.ptp(reckoned[:, 0]) == pytest.approx(2.0 * radius_m, rel=1e-3)
