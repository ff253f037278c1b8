"""Windows with any commands: what they count, what a prediction may know of them, and what held ones stay."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seatrial.acquisition.core.errors import InputError
from seatrial.acquisition.core.quantities import Floats
from seatrial.acquisition.core.ship import NAMES
from seatrial.analysis.tables.table import NANO
from seatrial.analysis.windows.held import tables_of_recordings
from seatrial.hybrid.calibrators import METHODS, Calibrator, TrainedCalibrator, make_calibrator
from seatrial.hybrid.calibrators.adaptive import (
    expected_wind,
    fit_parameter_vector,
    gust_decay_s,
    observations_of_windows,
)
from seatrial.hybrid.calibrators.networks import command_inputs
from seatrial.hybrid.calibrators.own import SIDECAR, load, save
from seatrial.hybrid.evaluation.study import SPLITS, shared_seconds
from seatrial.hybrid.evaluation.validate import validate_predictions
from seatrial.hybrid.prediction.baselines import Fallback, simulate_reference
from seatrial.hybrid.prediction.dataset import Dataset, load_dataset
from seatrial.hybrid.prediction.window_sets import (
    PAST_S,
    PredictionWindows,
    drop_overlapping_windows,
    held_out_group_names,
)
from seatrial.hybrid.vessel.dynamics import simulate_batch
from seatrial.hybrid.vessel.plant import Plant
from tests.conftest import Simulated, nightly
from tests.hybrid.windows_by_hand import STARTED_NS, voyages

SECONDS = 8


def steered(plant: Plant, count: int, seed: int) -> PredictionWindows:
    """Windows in which shafts and pods move second by second, as the plant itself sails them."""
    held = voyages(plant, count, SECONDS, seed)
    moves = np.random.default_rng(seed).normal(0.0, [0.1, 0.05, 0.1, 0.05, 0.0], (count, SECONDS, 5))
    commands = held.acting_controls + np.cumsum(moves, axis=1)
    wind = np.repeat(held.wind[:, None], SECONDS, axis=1)
    tracks = simulate_batch(plant, held.start, commands, wind, 1.0).states[..., :3]
    return replace(held, commands=commands, track=tracks)


@pytest.fixture(scope="module")
def fitted(plant: Plant) -> Callable[[str], Calibrator]:
    """A calibrator of a method, hardly fitted, to windows with any commands."""

    def fit(method: str) -> Calibrator:
        training, stopping = (steered(plant, count, count) for count in (24, 8))
        calibrator = make_calibrator(method, 0, plant)
        vars(calibrator).update(epochs=5, batch=64)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(
                "seatrial.hybrid.calibrators.adaptive.fit_parameter_vector", partial(fit_parameter_vector, steps=1)
            )
            return calibrator.fit(
                (training, simulate_reference(training, plant)), (stopping, simulate_reference(stopping, plant))
            )

    return fit


def test_every_window_with_data_counts_and_only_missing_data_drop_one(simulated: Simulated) -> None:
    path = simulated("gentle", 3, 900.0)
    table = next(iter(tables_of_recordings([path]).values())).table
    dataset = load_dataset([path], 15, 5, any_commands=True)
    rows = table[list(NAMES)].notna().all(axis=1).to_numpy()
    whole = [rows[begin : begin + 16].all() for begin in range(0, len(rows) - 15, 5)]
    assert (len(dataset.windows), dataset.candidates) == (sum(whole), len(whole))
    assert set(dataset.dropped) <= {"gap", "missing_data"}
    held = load_dataset([path], 15, 5)
    assert 0 < len(held.windows) < len(dataset.windows)
    assert set(held.windows.start_time) < set(dataset.windows.start_time)


def test_commands_are_what_was_recorded_over_each_second(simulated: Simulated) -> None:
    path = simulated("calm", 3, 600.0)
    table = next(iter(tables_of_recordings([path]).values())).table
    windows = load_dataset([path], 15, 5, any_commands=True).windows
    assert windows.commands is not None
    recorded = np.deg2rad(table["port_angle_deg"])
    for start, acting in zip(windows.start_time[::20], windows.commands[::20, :, 1], strict=True):
        ends = recorded.loc[start : start + pd.Timedelta(seconds=15)].to_numpy()
        assert acting == pytest.approx(0.5 * (ends[1:] + ends[:-1]), abs=1e-9)


def test_the_model_follows_the_commands(plant: Plant) -> None:
    windows = steered(plant, 20, 1)
    assert simulate_reference(windows, plant) == pytest.approx(windows.track)
    held = simulate_reference(replace(windows, commands=None), plant)
    assert np.abs(held - windows.track)[:, -1].max() > 0.5


@pytest.mark.parametrize("method", [*(name for name in METHODS if name != "paper_adam"), *nightly("paper_adam")])
def test_what_is_commanded_after_a_second_does_not_change_the_prediction_of_it(
    method: str, plant: Plant, fitted: Callable[[str], Calibrator]
) -> None:
    calibrator, windows = fitted(method), steered(plant, 12, 3)
    assert windows.commands is not None
    known, later = 4, windows.commands.copy()
    later[:, known:] += np.array([0.5, 0.3, 0.5, 0.3, 0.0])
    tracks: list[Floats] = []
    for commands in (windows.commands, later):
        each = replace(windows, commands=commands)
        tracks.append(calibrator.predict(each, simulate_reference(each, plant)))
    assert np.array_equal(tracks[0][:, : known + 1], tracks[1][:, : known + 1])
    assert (np.abs(tracks[0] - tracks[1])[:, -1, :2].max(axis=1) > 1e-6).all()


@pytest.mark.parametrize("method", METHODS)
def test_a_shorter_horizon_is_the_beginning_of_a_longer_one(
    method: str, plant: Plant, fitted: Callable[[str], Calibrator]
) -> None:
    """Tracks and uncertainties: one calibrator serves every horizon up to its own."""
    calibrator, windows, known = fitted(method), steered(plant, 12, 3), 6
    assert windows.commands is not None
    begun = replace(windows, track=windows.track[:, : known + 1], commands=windows.commands[:, :known])
    whole, part = (
        calibrator.predict_with_uncertainty(each, simulate_reference(each, plant)) for each in (windows, begun)
    )
    assert part[0] == pytest.approx(whole[0][:, : known + 1], abs=1e-9)
    assert part[1] == pytest.approx(whole[1][:, :known], rel=1e-9)


def test_held_commands_are_both_of_their_means(plant: Plant) -> None:
    windows = voyages(plant, 5, SECONDS)
    inputs = command_inputs(windows)
    assert inputs == pytest.approx(np.repeat(inputs[:, :1], SECONDS, axis=1))
    assert inputs[..., : inputs.shape[-1] // 2] == pytest.approx(inputs[..., inputs.shape[-1] // 2 :])


@pytest.fixture
def trained(plant: Plant, fitted: Callable[[str], Calibrator]) -> TrainedCalibrator:
    """A calibrator of any commands, as it is saved."""
    region_m = np.linspace((0.5, 0.4), (3.0, 2.0), SECONDS)
    fallback = Fallback(np.array([1.5, 0.5]), np.array([1.0, 0.3]), region_m)
    parts = fitted("adaptive"), fitted("data_driven")
    return TrainedCalibrator(*parts, SECONDS, "gunnerus_short", plant, region_m, fallback, (), {})


def test_one_of_held_controls_refuses_any_commands_and_says_what_to_do(
    small: TrainedCalibrator, unseen: Path, plant: Plant
) -> None:
    dataset = load_dataset([unseen], small.horizon_s, 5, any_commands=True)
    with pytest.raises(InputError, match=r"held controls.*--any"):
        validate_predictions(dataset, plant, small)


def test_one_of_any_commands_judges_both_kinds_and_comes_back_from_the_disk(
    trained: TrainedCalibrator, plant: Plant, tmp_path: Path
) -> None:
    save(trained, tmp_path)
    again = load(tmp_path)
    assert again.calibrator.any_commands
    assert again.data_driven.any_commands
    for windows in (steered(plant, 12, 5), voyages(plant, 12, SECONDS, 5)):
        dataset = Dataset(replace(windows, track=windows.track + 0.1), (), len(windows))
        first, second = (validate_predictions(dataset, plant, each) for each in (trained, again))
        assert first.as_dict() == second.as_dict()


def test_the_file_of_one_of_held_controls_does_not_know_the_word(small_folder: Path) -> None:
    assert "any_commands" not in (small_folder / SIDECAR).read_text(encoding="utf-8")


@given(seed=st.integers(0, 10**6), horizon_s=st.integers(2, 60), share=st.floats(0.05, 0.95))
@settings(max_examples=40, deadline=None)
def test_windows_clear_of_others_share_no_second_with_them(seed: int, horizon_s: int, share: float) -> None:
    windows = _one_after_the_other(60, horizon_s, seed)
    others = np.random.default_rng(seed).random(len(windows)) < share
    clear = drop_overlapping_windows(windows, ~others, others)
    assert not (clear & others).any()
    assert shared_seconds(windows, clear, others) == 0
    for each in np.flatnonzero(~others & ~clear):
        assert shared_seconds(windows, np.arange(len(windows)) == each, others) > 0


@pytest.mark.parametrize("kind", sorted(set(SPLITS) - {"random"}))
def test_no_second_that_is_judged_was_fitted(kind: str) -> None:
    windows = _one_after_the_other(400, 15, 0)
    for draw in SPLITS[kind](windows, 2, 0):
        assert draw.held_out.sum() > 20
        assert draw.stopping.sum() > 20
        assert shared_seconds(windows, draw.fitting, draw.held_out | draw.stopping) == 0


def test_recordings_are_kept_whole_where_there_are_enough() -> None:
    windows = _one_after_the_other(80, 15, 0)
    assert np.array_equal(held_out_group_names(windows), windows.trial)
    assert np.array_equal(held_out_group_names(replace(windows, commands=None)), windows.leg)
    alone = windows.subset(windows.trial == "a")
    assert np.array_equal(held_out_group_names(alone), alone.leg)


def _one_after_the_other(count: int, horizon_s: int, seed: int) -> PredictionWindows:
    """Windows every 5 s of four recordings, their legs four horizons long, without a break between."""
    random, starts = np.random.default_rng(seed), 5 * np.arange(count)
    trial = np.sort(random.choice(list("abcd"), count))
    legs = np.char.add(trial, (starts // (4 * horizon_s)).astype(str))
    return PredictionWindows(
        start=np.zeros((count, 6)),
        track=np.zeros((count, horizon_s + 1, 3)),
        wind=np.zeros((count, 2)),
        control=np.zeros((count, 5)),
        trial=trial,
        leg=legs,
        start_ns=STARTED_NS + starts * NANO,
        past=np.zeros((count, 1, 13)),
        commands=np.zeros((count, horizon_s, 5)),
    )


def gusty(gust_s: float, seed: int, *, count: int = 300, mean: complex = 3.0 + 4.0j) -> PredictionWindows:
    """Windows whose minute before them has a wind that is a mean and a first-order process of 1 m/s about it."""
    random, kept = np.random.default_rng(seed), np.exp(-1.0 / gust_s)
    pushes = random.normal(size=(count, PAST_S + 1, 2)) @ np.array([1.0, 1.0j])
    wind = np.empty((count, PAST_S + 1), dtype=complex)
    wind[:, -1] = pushes[:, -1]
    for second in range(PAST_S - 1, -1, -1):
        wind[:, second] = kept * wind[:, second + 1] + np.sqrt(1.0 - kept**2) * pushes[:, second]
    empty = _one_after_the_other(count, SECONDS, seed)
    past = np.zeros((count, PAST_S + 1, 13))
    past[..., 6], past[..., 7] = np.angle(wind + mean), np.abs(wind + mean)
    return replace(empty, past=past, track=np.zeros((count, SECONDS + 1, 3)))


@pytest.mark.parametrize("gust_s", [5.0, 15.0, 40.0])
def test_the_time_in_which_gusts_die_away_is_found(gust_s: float) -> None:
    assert gust_decay_s(gusty(gust_s, 0, count=2000)) == pytest.approx(gust_s, rel=0.15)


def test_where_no_wind_blows_gusts_stay_as_they_are() -> None:
    windows = gusty(15.0, 0)
    calm = replace(windows, past=np.zeros_like(windows.past))
    assert gust_decay_s(calm) == pytest.approx(300.0)
    assert observations_of_windows(calm, 300.0).wind == pytest.approx(0.0)


def test_the_wind_that_is_expected_goes_from_the_last_to_the_mean() -> None:
    past = np.zeros((1, PAST_S + 1, 13))
    past[..., 7] = 2.0
    past[:, :3, 6], past[:, :3, 7] = np.pi / 2.0, 6.0
    direction, speed = expected_wind(past, 10.0, 200).T
    vector = (speed * np.exp(1j * direction))[:, 0]
    mean = ((PAST_S - 2.0) * 2.0 + 3.0 * 6.0j) / (PAST_S + 1.0)
    assert vector[0] == pytest.approx(6.0j, abs=0.5)
    assert vector[-1] == pytest.approx(mean, abs=1e-6)
    assert np.abs(np.diff(vector - mean)).max() < np.abs(vector[0] - mean) / 10.0
