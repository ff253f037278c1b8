"""Methods whose worth is known come out with it: in the figures, the JSON, the tables and on the page."""

from __future__ import annotations

import json
from dataclasses import replace
from io import StringIO
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from rich.console import Console
from typer.testing import CliRunner

from seatrial import app
from seatrial.hybrid.calibrators import Calibrator
from seatrial.hybrid.evaluation.study import Evaluation, Study, evaluate_methods, summarise_study
from seatrial.hybrid.prediction.baselines import constant_velocity, distances, score, simulate_reference
from seatrial.hybrid.prediction.window_sets import PredictionWindows
from seatrial.hybrid.report.pages import draw_errors_by_class
from seatrial.hybrid.vessel.plant import Plant
from tests.hybrid.evaluation.windows_in_legs import FAKES, SECONDS, Memory, windows_of_legs

SPLITS = ("leg", "time", "recording", "random")


def make_fake(method: str, seed: int = 0, plant: Plant | None = None) -> Calibrator:
    return FAKES[method](seed, plant)


@pytest.fixture(scope="module")
def windows() -> PredictionWindows:
    """Twelve legs in each of two recordings; every leg drifts in its own way."""
    return windows_of_legs([3, 9, 5, 8, 4, 6, 7, 3, 9, 5, 8, 6], ("a", "b"))


@pytest.fixture(scope="module")
def studied(windows: PredictionWindows, plant: Plant) -> Study:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("seatrial.hybrid.evaluation.study.make_calibrator", make_fake)
        return evaluate_methods(windows, plant, list(FAKES), SPLITS, draws=3, seed=1)


@pytest.fixture(scope="module")
def evaluation(studied: Study, plant: Plant) -> Evaluation:
    return summarise_study(studied, plant.length_overall_m, 0)


@pytest.mark.parametrize("kind", SPLITS)
def test_a_perfect_method_is_known_as_such(evaluation: Evaluation, kind: str) -> None:
    """No error, ratio 0, every position inside its region, and it is the best."""
    causal = evaluation.splits[kind].causal
    oracle = causal.methods["oracle"]
    assert causal.best == "oracle"
    for figure in (oracle.mean_distance_m, oracle.end_distance_m, oracle.heading_error_deg, oracle.ratio):
        assert [figure.value, figure.low, figure.high] == pytest.approx([0.0] * 3, abs=1e-9)
    assert oracle.coverage_95.value == 1.0


@pytest.mark.parametrize("kind", SPLITS)
def test_a_method_that_is_the_baseline_ties_with_it(evaluation: Evaluation, kind: str) -> None:
    causal = evaluation.splits[kind].causal
    assert causal.best_baseline == "constant_velocity"
    ratio = causal.methods["holding"].ratio
    assert ratio.value == pytest.approx(1.0)
    assert ratio.low <= 1.0 + 1e-12
    assert ratio.high >= 1.0 - 1e-12
    assert causal.methods["reference"].ratio.value > 1.0


def test_what_was_learned_by_heart_is_exposed(evaluation: Evaluation) -> None:
    """A method that knows the legs it has seen wins where windows are drawn at random, and gains nothing else."""
    ratio = {kind: evaluation.splits[kind].causal.methods["memory"].ratio for kind in SPLITS}
    assert ratio["random"].high < 0.5
    for kind in ("leg", "recording"):
        assert ratio[kind].value == pytest.approx(1.0)
    assert evaluation.leak["memory"].low > 1.5
    assert evaluation.leak["holding"].value == pytest.approx(1.0)


def test_each_window_counts_once(studied: Study, plant: Plant) -> None:
    """However many draws hold a window out: what needs no training has its plain error on the windows judged."""
    for result in studied.results:
        judged = studied.windows.subset(result.held_out)
        for name, tracks in (
            ("constant_velocity", constant_velocity(judged)),
            ("reference", simulate_reference(judged, plant)),
        ):
            assert result.errors[name].distance_m == pytest.approx(distances(tracks, judged.track))
            plain = score(tracks, judged.track)
            assert result.errors[name].north_m.mean() == pytest.approx(plain.mae_north_m)
            assert result.errors[name].heading_deg.mean() == pytest.approx(plain.heading_error_deg)
    assert {each.kind: len(each.fitted) for each in studied.results} == {
        "leg": 3,
        "time": 1,
        "recording": 2,
        "random": 3,
    }


def test_the_json_says_everything_and_can_be_read_by_anyone(evaluation: Evaluation) -> None:
    """No NaN in it; every figure has its bounds; classes of a kind add up to all windows that were judged."""
    said: dict[str, Any] = json.loads(json.dumps(evaluation.as_dict(), allow_nan=False))
    assert set(said) == {"horizon_s", "windows", "legs", "outside_model_range", "splits", "leak"}
    for kind, split in said["splits"].items():
        assert (split["shared_seconds"] == 0.0) == (kind != "random")
        assert set(split) == {
            "draws", "fitted_windows", "shared_seconds", "windows", "legs", "best_baseline", "methods", "breakdown",
            "truths",
        }  # fmt: skip
        assert split["truths"] is None  # no sensor's tracks are known of windows by hand
        causal = {"straight_line", "constant_velocity", "reference", *FAKES}
        assert set(split["methods"]) == causal | {f"{name}_two_sided" for name in causal}
        assert {name for name, each in split["methods"].items() if each["start"] == "causal"} == causal
        for figures in split["methods"].values():
            assert set(figures) == {
                "start", "mean_distance_m", "end_distance_m", "mae_north_m", "mae_east_m", "heading_error_deg",
                "ratio_to_best_baseline", "coverage_95", "outside_training_range", "by_second",
            }  # fmt: skip
            assert [each["second"] for each in figures["by_second"]] == list(range(1, SECONDS + 1))
            means = [each["value"] for each in figures["by_second"]]
            assert figures["mean_distance_m"]["value"] == pytest.approx(float(np.mean(means)))
            assert figures["end_distance_m"]["value"] == pytest.approx(means[-1])
        for classes in split["breakdown"].values():
            assert sum(each["windows"] for each in classes.values()) == split["windows"], kind


def test_tables_name_every_method_and_split(evaluation: Evaluation) -> None:
    console = Console(width=200, record=True, file=StringIO())
    console.print(evaluation)
    shown = console.export_text()
    assert all(name in shown for name in (*FAKES, *SPLITS))
    assert str(evaluation).splitlines()[0] == shown.splitlines()[0].rstrip()
    assert evaluation.plot().axes[0].get_xlabel() == "mean distance divided by that of the best baseline [1]"


@pytest.fixture
def long_names(evaluation: Evaluation) -> Evaluation:
    """Recordings with names as a batch gives them."""
    split = evaluation.splits["recording"]
    named = {f"research_vessel-2026-06-01-{name}": each for name, each in split.breakdown["recording"].items()}
    return replace(evaluation, splits={"recording": replace(split, breakdown={"recording": named})})


def test_tables_fit_a_terminal_of_80_columns(evaluation: Evaluation, long_names: Evaluation) -> None:
    """Nothing is cut off, however long the names of recordings are: they go on in the next line."""
    for each in (evaluation, long_names):
        console = Console(width=80, record=True, file=StringIO())
        console.print(each)
        shown = console.export_text()
        assert "\u2026" not in shown
        for split in each.splits.values():
            for classes in split.dividing_classes.values():
                assert all(f"{summary.windows}/{summary.legs}" in shown for summary in classes.values())


def test_long_names_do_not_run_into_each_other_below_a_figure(long_names: Evaluation) -> None:
    axes = Figure(figsize=(8.5, 3.2)).subplots()
    classes = long_names.splits["recording"].breakdown["recording"]
    draw_errors_by_class(axes, {f"{number}-{name}": each for number in range(3) for name, each in classes.items()})
    figure = axes.get_figure()
    assert figure is not None
    figure.canvas.draw()
    boxes = [label.get_window_extent() for label in axes.get_xticklabels()]
    assert len(boxes) == 3 * len(classes)
    assert all(left.x1 < right.x0 for left, right in pairwise(boxes))


def test_evaluate_from_recording_to_page(
    earlier: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The command on a simulated voyage: one JSON on stdout and in the folder, pictures on the page."""
    monkeypatch.setattr(
        "seatrial.hybrid.evaluation.study.make_calibrator", lambda method, seed, plant: Memory(seed)
    )
    asked = [
        "evaluate",
        str(earlier[0]),
        "--method",
        "paper",
        "--split",
        "leg",
        "--split",
        "random",
        "--draws",
        "2",
    ]
    done = CliRunner().invoke(app, [*asked, "--json", "-o", str(tmp_path)])
    assert done.exit_code == 0, done.output
    said = json.loads(done.stdout)
    assert said == json.loads((tmp_path / "evaluation.json").read_text())
    assert said["files"] == [str(earlier[0])]
    assert {"vessel", "stride_s", "seed", "horizon_s"} <= set(said)
    html = (tmp_path / "evaluation.html").read_text()
    assert html.count("<img") >= 4
    assert "unseen legs" in html


def test_a_wrong_split_is_refused_before_anything_is_read(tmp_path: Path) -> None:
    done = CliRunner().invoke(app, ["evaluate", str(tmp_path / "none.mcap"), "--split", "month"])
    assert done.exit_code != 0
    assert "month" in str(done.exception)


@pytest.mark.parametrize("kind", ["leg", "recording"])
def test_regions_are_sized_on_other_legs(studied: Study, evaluation: Evaluation, kind: str) -> None:
    """They grow with the time predicted and are the same for a method that is the baseline."""
    holding, baseline = (evaluation.splits[kind].causal.methods[name] for name in ("holding", "constant_velocity"))
    assert holding.region_by_second_m == pytest.approx(baseline.region_by_second_m)
    assert np.all(np.diff(holding.region_by_second_m, axis=0) >= 0.0)
    shares = [each.value for each in holding.coverage_by_second]
    assert holding.coverage_95.value == pytest.approx(float(np.mean(shares)))
    errors = next(each for each in studied.results if each.kind == kind).errors["holding"]
    assert 0.0 < errors.inside.mean() <= 1.0
