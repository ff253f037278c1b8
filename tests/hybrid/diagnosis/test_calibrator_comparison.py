"""The ladder: nothing is judged that was learned from, every rung stands on its own model, and the words fit."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import ClassVar

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seatrial.acquisition.core.errors import DataShortageError
from seatrial.acquisition.core.quantities import Floats
from seatrial.acquisition.core.ship import DEFAULT
from seatrial.hybrid.calibrators import Calibrator
from seatrial.hybrid.diagnosis.acceptance import Coordinates
from seatrial.hybrid.diagnosis.calibrator_comparison import compare_on_windows, draws_of_folds, seconds_in_folds
from seatrial.hybrid.diagnosis.gap import FOLDS, fold_of
from seatrial.hybrid.diagnosis.linearise import ModelWithEffects
from seatrial.hybrid.diagnosis.log import Log
from seatrial.hybrid.diagnosis.result import CalibratorComparison
from seatrial.hybrid.effects import CATALOGUE
from seatrial.hybrid.evaluation.study import shared_seconds
from seatrial.hybrid.prediction.baselines import distances, score, simulate_reference
from seatrial.hybrid.prediction.window_sets import PredictionWindows
from seatrial.hybrid.report.diagnosis import comparison_sentence
from seatrial.hybrid.vessel.plant import Plant
from tests.hybrid.diagnosis.made_up import a_ladder
from tests.hybrid.evaluation.windows_in_legs import FAKES, Oracle, windows_of_legs

Climbed = Callable[[str, Mapping[int, Coordinates] | None], tuple[CalibratorComparison, PredictionWindows]]
CURRENT = {"ocean_current": (0.2, -0.1)}
SIZES = [3, 9, 5, 8, 4, 6, 7, 3, 9, 5]


class Standing(Oracle):
    """Says what the model under it says."""

    method: ClassVar[str] = "standing"

    def predict(self, horizons: PredictionWindows, reference: Floats) -> Floats:
        return reference


KNOWN: dict[str, type[Calibrator]] = {**FAKES, "standing": Standing}


def log_about(horizons: PredictionWindows, leg_s: int, trials: tuple[str, ...] = ("first",)) -> Log:
    """A log that holds all seconds of the windows, in legs of so many seconds; nothing else in it is used."""
    first, last = horizons.measured_seconds()
    length = int(last.max() - first.min()) + 1
    legs_each = -(-length // leg_s)
    seconds = np.concatenate([first.min() + np.arange(length)] * len(trials))
    leg = np.concatenate([np.arange(length) // leg_s + number * legs_each for number in range(len(trials))])
    none = np.zeros((len(seconds), 6))
    return Log(
        none, np.zeros((*none.shape, 5)), none, np.zeros((len(seconds), 4, 5)), none[:, :2], seconds, leg, leg,
        np.repeat(np.arange(len(trials)), length), DEFAULT,
    )  # fmt: skip


@given(leg_s=st.integers(30, 200), seed=st.integers(0, 5))
@settings(max_examples=25, deadline=None)
def test_what_is_judged_shares_no_second_with_what_was_learned_from(leg_s: int, seed: int) -> None:
    """Two recordings of one time of day; windows over a border are judged in no fold, and none is judged twice."""
    windows = windows_of_legs(SIZES, ("b", "a"))
    log = log_about(windows, leg_s, ("b", "a"))
    first, last = windows.measured_seconds()
    draws = draws_of_folds(windows, seconds_in_folds(windows, log, ("b", "a")), seed)
    assert np.sum([draw.held_out for draw in draws.values()], axis=0).max() == 1
    for fold, draw in draws.items():
        assert shared_seconds(windows, draw.fitting | draw.stopping, draw.held_out) == 0
        assert not (draw.fitting & draw.stopping).any()
        for window in np.flatnonzero(draw.held_out | draw.fitting | draw.stopping):
            mine = log.recording == ("b", "a").index(str(windows.trial[window]))
            inside = mine & (log.time_s >= first[window]) & (log.time_s <= last[window])
            folds = set(fold_of(log)[inside].tolist())
            assert folds == {fold} if draw.held_out[window] else fold not in folds


def test_every_window_is_judged_where_no_leg_cuts_one() -> None:
    """With a border in each pause between held legs nothing is lost."""
    windows = windows_of_legs([7] * 8, gap_s=20)  # a leg each minute: 30 s between starts, 10 s long, 20 s of pause
    log = log_about(windows, 60)
    draws = draws_of_folds(windows, seconds_in_folds(windows, log, ("first",)), 0)
    assert np.all(np.sum([draw.held_out for draw in draws.values()], axis=0) == 1)


def test_too_few_legs_are_said_to_be_too_few() -> None:
    """Three legs, or windows that no leg of the log holds."""
    few = windows_of_legs([5, 5, 5])
    with pytest.raises(DataShortageError, match="3 legs"):
        draws_of_folds(few, seconds_in_folds(few, log_about(few, 60), ("first",)), 0)
    many = windows_of_legs(SIZES)
    with pytest.raises(DataShortageError, match="0 legs"):
        draws_of_folds(many, seconds_in_folds(many, log_about(many, 60), ("another",)), 0)


@pytest.fixture
def climbed(plant: Plant, monkeypatch: pytest.MonkeyPatch) -> Climbed:
    """The ladder by a kind of calibrator whose worth is known, in windows of a ship that drifts with a current."""
    model = ModelWithEffects(plant, CATALOGUE)

    def make(method: str, seed: int = 0, plant: Plant | None = None) -> Calibrator:
        return KNOWN[method](seed, plant)

    monkeypatch.setattr("seatrial.hybrid.evaluation.study.make_calibrator", make)

    def run(method: str, named: Mapping[int, Coordinates] | None) -> tuple[CalibratorComparison, PredictionWindows]:
        windows = windows_of_legs([7] * 12, gap_s=20)
        windows = replace(windows, track=simulate_reference(windows, replace(model, at=CURRENT).plant()))
        seconds = seconds_in_folds(windows, log_about(windows, 60), ("first",))
        return compare_on_windows(windows, seconds, model, named, method=method, seed=1), windows

    return run


def test_each_rung_stands_on_its_own_model(climbed: Climbed, plant: Plant) -> None:
    """The named model is the truth, so it errs by nothing; one that adds nothing errs as what is below it."""
    found, windows = climbed("standing", dict.fromkeys(range(FOLDS), CURRENT))
    rungs = {name: each.value for name, each in found.mean_distance_m.items()}
    alone = score(simulate_reference(windows, plant), windows.track).mean_distance_m
    assert list(rungs) == ["constant_velocity", "reference", "named", "reference_calibrated", "named_calibrated"]
    assert alone > 0.1
    assert [rungs["reference"], rungs["reference_calibrated"]] == pytest.approx([alone, alone])
    assert [rungs["named"], rungs["named_calibrated"]] == pytest.approx([0.0, 0.0], abs=1e-9)
    assert found.ratio("named", "reference").high < 1e-6
    assert (found.windows, found.legs) == (84, 12)
    assert found.mean_distance_m["reference"].low < alone < found.mean_distance_m["reference"].high


def test_what_a_fold_does_not_know_is_not_lent_to_it(climbed: Climbed, plant: Plant) -> None:
    """Where the other legs name nothing the named model is the reference, there and only there."""
    found, windows = climbed("standing", {0: CURRENT, 1: CURRENT, 2: {}, 3: {}})
    off_m = distances(simulate_reference(windows, plant), windows.track).mean(axis=1)
    left = np.arange(len(windows)) >= len(windows) // 2  # the third and the fourth quarter
    assert found.mean_distance_m["named"].value == pytest.approx((off_m * left).mean())


def test_without_a_name_there_are_three_rungs(climbed: Climbed) -> None:
    """And a calibrator that holds the present motion is that baseline, one that knows all errs by nothing."""
    holding, oracle = (climbed(method, None)[0] for method in ("holding", "oracle"))
    assert list(holding.mean_distance_m) == ["constant_velocity", "reference", "reference_calibrated"]
    assert holding.mean_distance_m["reference_calibrated"] == holding.mean_distance_m["constant_velocity"]
    assert oracle.mean_distance_m["reference_calibrated"].value == 0.0
    assert [(each.of, each.to) for each in oracle.ratios] == [("reference_calibrated", "reference")]


@pytest.mark.parametrize(
    ("both", "words"),
    [
        ((0.7, 0.6, 0.8), ": the named effects help the calibrator, 30 % less error (20 to 40 %)."),
        ((1.4, 1.2, 1.5), ": the named effects do not help the calibrator, 40 % more error (20 to 50 %)."),
        (
            (0.9, 0.8, 1.2),
            "do not show that the named effects help the calibrator, 10 % less error (20 % less to 20",
        ),
    ],
)
def test_the_sentence_says_whether_the_name_helps(both: tuple[float, float, float], words: str) -> None:
    """Helped, harmed, or not to be seen."""
    said = comparison_sentence(a_ladder(both))
    assert words in said
    assert "the error of the reference is 1.2 m, with the named effects 0.3 m, with a calibrator 0.4 m" in said


def test_the_sentence_without_rungs_or_names() -> None:
    """What the calibrator does to the reference; or why there is none."""
    whole = a_ladder()
    kept = [name for name in whole.mean_distance_m if "named" not in name]
    bare = replace(whole, mean_distance_m={name: whole.mean_distance_m[name] for name in kept})
    assert comparison_sentence(bare).endswith("with a calibrator 0.4 m: 67 % less error (60 to 70 %).")
    assert (
        comparison_sentence(CalibratorComparison(15, "adaptive", why_not="no leg"))
        == "No calibrator was trained: no leg."
    )
