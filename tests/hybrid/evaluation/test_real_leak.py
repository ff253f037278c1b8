"""On a real recording: splits share nothing, and the random one hides most of the error on legs never seen."""

from __future__ import annotations

from pathlib import Path

import pytest

from seatrial.acquisition.tables.import_table import import_table
from seatrial.hybrid.evaluation.study import SPLITS, evaluate_methods, shared_seconds, summarise_study
from seatrial.hybrid.prediction.dataset import load_dataset
from seatrial.hybrid.prediction.window_sets import PredictionWindows
from seatrial.hybrid.vessel.plant import Plant

pytestmark = pytest.mark.shared

TABLE = Path("gunnerus_2019_docking") / "docking_2019-11-09_part1.csv"
MAP = Path(__file__).parents[3] / "trials" / "columns" / "gunnerus_2019_docking.toml"


@pytest.fixture(scope="module")
def docking(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> PredictionWindows:
    path = tmp_path_factory.mktemp("recordings") / "docking.mcap"
    import_table(shared_data / TABLE, path, MAP)
    return load_dataset([path], 15, 5).windows


@pytest.mark.parametrize("kind", ["leg", "time"])
def test_real_windows_share_no_second(docking: PredictionWindows, kind: str) -> None:
    for draw in SPLITS[kind](docking, 5, 0):
        assert shared_seconds(docking, draw.fitting | draw.stopping, draw.held_out) == 0
    (leaky,) = SPLITS["random"](docking, 1, 0)
    assert shared_seconds(docking, leaky.fitting, leaky.held_out) > 0


@pytest.mark.slow
def test_the_random_split_flatters_the_paper(docking: PredictionWindows, plant: Plant) -> None:
    """At the paper's split its calibrator seems better than it is on legs never seen, where the baselines beside it
    keep it from being worse than they are."""
    evaluation = summarise_study(
        evaluate_methods(docking, plant, ["paper"], ["leg", "random"], 3), plant.length_overall_m, 0
    )
    honest, leaky = (evaluation.splits[kind].causal.methods["paper"].ratio for kind in ("leg", "random"))
    assert leaky.value < honest.value
    assert honest.low < 1.0
    assert evaluation.leak["paper"].low > 1.0
