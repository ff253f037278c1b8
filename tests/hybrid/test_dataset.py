"""Windows of recordings: repaired on request, and with shorter ones to learn from."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from seatrial import app
from seatrial.acquisition.core.trial import Trial
from seatrial.acquisition.recording.writer import write_table
from seatrial.analysis.windows.held import tables_of_recordings
from seatrial.hybrid.calibrators.predict import window_starting_at
from seatrial.hybrid.evaluation.study import SPLITS, shared_seconds
from seatrial.hybrid.prediction.dataset import load_dataset
from seatrial.hybrid.prediction.kalman_filter import filtered_starts
from seatrial.hybrid.prediction.window_sets import PredictionWindows
from seatrial.hybrid.simulation.trial import simulate_trial
from seatrial.hybrid.vessel.plant import Plant
from tests.conftest import few_epochs, nightly

RUN = CliRunner()

KNOT_MPS = 1852.0 / 3600.0


@pytest.fixture(scope="module")
def in_knots(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A simulated trial as it was, and with surge and sway written in knots."""
    table, _ = simulate_trial("gunnerus_short", "calm", "voyage", 400.0, 2.0, 1)
    wrong = table.assign(**{name: table[name] / KNOT_MPS for name in ("surge_mps", "sway_mps")})
    folder = tmp_path_factory.mktemp("knots")
    paths = folder / "right.mcap", folder / "wrong.mcap"
    for path, each in zip(paths, (table, wrong), strict=True):
        write_table(each, path, Trial(name=path.stem), source="simulated")
    return paths


def test_speeds_in_knots_are_put_right_on_request(in_knots: tuple[Path, Path]) -> None:
    """Repaired, windows start at the speeds of the ship."""
    right, as_it_is = (load_dataset([path], 15, 5).windows for path in in_knots)
    repaired = load_dataset(in_knots[1:], 15, 5, repair=True).windows
    assert len(right) == len(as_it_is) == len(repaired) > 10
    surge = [np.median(each.start[:, 3]) for each in (as_it_is, right, repaired)]
    assert surge[0] == pytest.approx(surge[1] / KNOT_MPS, rel=0.01)
    assert surge[2] == pytest.approx(surge[1], rel=0.01)


def result_of(*words: str | Path) -> dict[str, Any]:
    """The JSON of a command about the short ship."""
    done = RUN.invoke(app, [*map(str, words), "--vessel", "gunnerus_short", "--json"])
    assert done.exit_code == 0, done.output
    return dict(json.loads(done.stdout))


@pytest.mark.parametrize("repair", ["--repair", *nightly("--rebuild-positions")])
def test_train_repairs_on_request(
    in_knots: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, repair: str
) -> None:
    """The reference is then as good on speeds in knots as on those that are right."""
    monkeypatch.setattr(
        "seatrial.hybrid.calibrators.make_calibrator",
        lambda method, seed, plant: few_epochs(method, seed, plant, 1),
    )
    right, wrong = in_knots
    right_m, wrong_m, repaired_m = (
        result_of("train", *words, "--method", "paper", "-o", tmp_path / "calibrator")["held_out_reference_m"]
        for words in ((right,), (wrong,), (wrong, repair))
    )
    assert wrong_m > 2.0 * right_m
    assert repaired_m == pytest.approx(right_m, rel=0.2)


@pytest.mark.parametrize("repair", ["--rebuild-positions", *nightly("--repair")])
def test_validate_repairs_on_request(in_knots: tuple[Path, Path], repair: str) -> None:
    right, wrong = in_knots
    right_m, wrong_m, repaired_m = (
        result_of("validate", *words)["methods"]["reference"]["mean_distance_m"]
        for words in ((right,), (wrong,), (wrong, repair))
    )
    assert wrong_m > 2.0 * right_m
    assert repaired_m == pytest.approx(right_m, rel=0.2)


@pytest.fixture(scope="module")
def both(tmp_path_factory: pytest.TempPathFactory) -> tuple[PredictionWindows, PredictionWindows]:
    """The whole windows of 30 s of a simulated voyage, and the same with shorter ones behind."""
    table, _ = simulate_trial("gunnerus_short", "gentle", "voyage", 900.0, 2.0, 3)
    path = tmp_path_factory.mktemp("voyage") / "voyage.mcap"
    write_table(table, path, Trial(name="voyage"), source="simulated")
    alone, longer = (load_dataset([path], 30, 5, shorter=shorter).windows for shorter in (False, True))
    return alone, longer


def test_shorter_windows_come_behind_the_whole_ones(both: tuple[PredictionWindows, PredictionWindows]) -> None:
    """They know half of the horizon and nothing after it, and none of them is the beginning of a whole one."""
    alone, longer = both
    added = np.arange(len(longer)) >= len(alone)
    assert added.sum() > 5
    assert np.array_equal(longer.is_complete, ~added)
    for name in ("start", "track", "wind", "control", "past"):
        assert np.array_equal(getattr(longer, name)[~added], getattr(alone, name), equal_nan=True)
    assert np.isfinite(longer.track[added, :16]).all()
    assert np.isnan(longer.track[added, 16:]).all()
    assert not longer.start_time[added].isin(alone.start_time).any()


def test_legs_reach_over_whole_and_shorter_windows(both: tuple[PredictionWindows, PredictionWindows]) -> None:
    """Windows of one leg stay together, and no second is in two legs."""
    alone, longer = both
    for leg in np.unique(alone.leg):
        assert len(np.unique(longer.leg[: len(alone)][alone.leg == leg])) == 1
    for leg in np.unique(longer.leg):
        mine = longer.leg == leg
        assert shared_seconds(longer, mine, ~mine) == 0


@pytest.mark.parametrize("kind", ["leg", "time"])
def test_only_whole_windows_are_judged(both: tuple[PredictionWindows, PredictionWindows], kind: str) -> None:
    """And nothing that is learned from shares a second with them; shorter ones are learned from."""
    _, longer = both
    for draw in SPLITS[kind](longer, 3, 0):
        assert longer.is_complete[draw.held_out].all()
        assert (~longer.is_complete)[draw.fitting].any()
        assert shared_seconds(longer, draw.fitting | draw.stopping, draw.held_out) == 0


def test_nothing_that_was_measured_later_enters_a_start(tmp_path: Path, plant: Plant) -> None:
    """What is known at second 0 of a window, at ten samples a second: the same with all that follows cut off."""
    table, _ = simulate_trial("gunnerus_short", "moderate", "voyage", 300.0, 10.0, 4)
    last = table.index[1800]
    paths = tmp_path / "whole.mcap", tmp_path / "cut.mcap"
    for path, each in zip(paths, (table, table[table.index <= last]), strict=True):
        write_table(each, path, Trial(name="voyage"), source="simulated")
    whole = filtered_starts(load_dataset([paths[0]], 15, 1, any_commands=True).windows, plant)
    (cut,) = tables_of_recordings(paths[1:]).values()
    known = filtered_starts(window_starting_at(cut, last, 15)[0], plant)
    (one,) = np.flatnonzero(whole.start_time == last)
    for name in ("start", "wind", "control", "past"):
        assert getattr(whole, name)[one] == pytest.approx(getattr(known, name)[0], abs=1e-9), name
    assert whole.two_sided is not None
    assert np.abs(whole.two_sided[one] - whole.start[one]).max() > 1e-3
