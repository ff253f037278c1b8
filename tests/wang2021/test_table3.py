"""Table III: what the splits share, what the bootstrap covers, and what is in the JSON."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from io import StringIO
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rich.console import Console
from typer.testing import CliRunner

import seatrial
from seatrial.hybrid.calibrators import Calibrator, make_calibrator
from seatrial.hybrid.calibrators.adaptive import fit_parameter_vector
from seatrial.hybrid.calibrators.networks import NetworkCalibrator
from seatrial.hybrid.prediction.baselines import score
from seatrial.hybrid.vessel.plant import Plant
from seatrial.notebooks.wang2021 import campaign
from seatrial.notebooks.wang2021.campaign import (
    CampaignJob,
    SeaResults,
    SequenceErrors,
    _examples,
    parts_of,
    seas_of,
)
from seatrial.notebooks.wang2021.page import RunningTable, write_page, write_table3
from seatrial.notebooks.wang2021.table3 import (
    ORDER,
    PUBLISHED,
    Row,
    Table3,
    bootstrap_means,
    cells_of,
    figures_of,
    rows_of,
    table3,
)
from tests.hybrid.windows_by_hand import random_windows

CONTRACT = {
    "sea_state", "method", "split", "mae_x_m", "mae_y_m", "mean_distance_m", "low", "high", "reduction",
    "reduction_x", "reduction_y", "coverage_95",
}  # fmt: skip
SMALL = [CampaignJob("calm", 0, sequences=12), CampaignJob("gentle", 1, sequences=10)]


def quick(method: str, seed: int, plant: Plant) -> Calibrator:
    """A calibrator that is not trained for long."""
    calibrator = make_calibrator(method, seed, plant)
    if isinstance(calibrator, NetworkCalibrator):
        calibrator.epochs = 10
    return calibrator


@pytest.fixture(scope="module")
def small() -> Callable[[list[CampaignJob]], tuple[SeaResults, ...]]:
    """Small campaigns, compared in this process with little training."""

    def compare_methods(jobs: list[CampaignJob]) -> tuple[SeaResults, ...]:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(campaign, "make_calibrator", quick)
            patch.setattr(
                "seatrial.hybrid.calibrators.adaptive.fit_parameter_vector", partial(fit_parameter_vector, steps=1)
            )
            return seas_of(jobs, workers=1)

    return compare_methods


def table_of(jobs: list[CampaignJob], workers: int) -> Table3:
    return table3(seas_of(jobs, workers))


@pytest.fixture(scope="module")
def shown(small: Callable[[list[CampaignJob]], tuple[SeaResults, ...]]) -> tuple[SeaResults, ...]:
    return small(SMALL)


@pytest.fixture(scope="module")
def table(shown: tuple[SeaResults, ...]) -> Table3:
    return table3(shown)


@given(count=st.integers(5, 60), seconds=st.integers(2, 20), seed=st.integers(0, 1000))
@settings(max_examples=30)
def test_a_split_by_sequence_shares_none_and_the_papers_does(count: int, seconds: int, seed: int) -> None:
    """Every second is in one part; whole sequences stay together, or the seconds of one are on both sides."""
    windows = random_windows(count, seconds)
    for split in ("sequence", "random"):
        parts = parts_of(windows, split, seed)
        times = parts.training.astype(int) + parts.stopping + parts.test
        assert (times == 1).all()
    whole = parts_of(windows, "sequence", seed)
    for part in (whole.training, whole.stopping, whole.test):
        assert part.any()
        assert (part == part[:, :1]).all()
    mixed = parts_of(random_windows(count, 40), "random", seed)
    assert (mixed.training.any(axis=1) & mixed.test.any(axis=1)).any()


def test_a_split_leaves_a_fifth_for_the_test() -> None:
    """Of the paper's 70 sequences 14, and of its rows about as large a share."""
    windows = random_windows(70, 30)
    assert parts_of(windows, "sequence", 0).test[:, 0].sum() == 14
    assert parts_of(windows, "random", 0).test.mean() == pytest.approx(0.2, abs=0.03)


def test_seconds_kept_from_a_calibrator_do_not_reach_it() -> None:
    """What is not among the rows is not there; windows without any row are left out."""
    windows = random_windows(6, 30)
    rows = np.random.default_rng(5).random((6, 30)) < 0.7
    rows[2] = False
    given, tracks = _examples(windows, windows.track, rows)
    assert len(given) == len(tracks) == 5
    known = np.isfinite(given.track[:, 1:]).all(axis=2)
    assert (known == np.delete(rows, 2, axis=0)).all()
    assert given.track[:, 1:][known] == pytest.approx(np.delete(windows.track, 2, axis=0)[:, 1:][known])


def test_the_bootstraps_first_row_is_the_score() -> None:
    windows = random_windows(9, 12)
    predicted = windows.track + np.random.default_rng(0).normal(0.0, 2.0, windows.track.shape)
    gap_m = (predicted - windows.track)[:, 1:, :2]
    mine, means = score(predicted, windows.track), bootstrap_means([_figures(gap_m)], draws=3)
    assert means[0, :3] == pytest.approx([mine.mae_north_m, mine.mae_east_m, mine.mean_distance_m])


def test_seconds_that_are_not_judged_do_not_count() -> None:
    """Whatever stands beside the test rows, the means are those of the test rows."""
    gap_m = np.random.default_rng(1).normal(0.0, 1.0, (20, 30, 2))
    rows = np.random.default_rng(2).random((20, 30)) < 0.3
    means = bootstrap_means([_figures(np.where(rows[..., None], gap_m, np.nan))], draws=2)
    assert means[0, 0] == pytest.approx(np.abs(gap_m[rows][:, 0]).mean())


def test_intervals_hold_the_truth() -> None:
    """Sequences whose errors hang together: the 95 % interval holds the expected error about 95 % of the time.

    Each sequence has one error north for all its seconds, |N(0, 1)|, so that its mean is sqrt(2 / pi).
    """
    random, held = np.random.default_rng(3), 0
    for _ in range(200):
        by_seed = [np.repeat(random.normal(size=(15, 1, 1)), 30, axis=1) * [1.0, 0.0] for _ in range(5)]
        low, high = np.quantile(bootstrap_means(list(map(_figures, by_seed)), draws=300)[1:, 0], [0.025, 0.975])
        held += low <= np.sqrt(2.0 / np.pi) <= high
    assert 0.88 <= held / 200 <= 0.99


def test_each_seed_keeps_its_weight() -> None:
    """Draws are within each seed: where all sequences of a seed are alike, nothing is uncertain."""
    by_seed = [np.full((count, 30, 2), float(count)) for count in (3, 20)]
    means = bootstrap_means(by_seed, draws=50)
    assert means == pytest.approx(np.full((51, 2), 11.5))


def test_coverage_is_the_share_of_seconds_inside_their_regions() -> None:
    """Only seconds that are judged count; a method without regions has no coverage, and JSON says null."""
    gap_m = np.full((4, 10, 2), [3.0, 4.0])  # 5 m
    gap_m[:, 5:] = np.nan
    inside = np.where(np.arange(10) < 5, np.ones((4, 10)), np.nan)
    inside[0] *= 0.0
    errors = {method: SequenceErrors(gap_m * (method != "floor"), inside * size, gap_m)
              for method, size in (dict.fromkeys(ORDER, 1.0) | {"floor": np.nan}).items()}  # fmt: skip
    by_method = {each.method: each for each in rows_of("calm", "sequence", [errors])}
    assert by_method["hybrid"].coverage_95.value == pytest.approx(0.75)
    (floor,) = Table3((by_method["floor"],), ()).as_dict()["rows"]
    assert floor["coverage_95"] is None


def _figures(gap_m: np.ndarray) -> np.ndarray:
    return figures_of(SequenceErrors(gap_m, np.ones(gap_m.shape[:2]), gap_m))


def test_reductions_are_paired() -> None:
    """A method with half the reference's error everywhere has a reduction of one half without any doubt."""
    gap_m = np.random.default_rng(4).normal(0.0, 3.0, (14, 30, 2))
    factor = dict.fromkeys(ORDER, 1.0) | {"hybrid": 0.5, "floor": 0.25}
    errors = {method: SequenceErrors(gap_m * factor[method], np.ones((14, 30)), gap_m) for method in ORDER}
    row = next(each for each in rows_of("calm", "sequence", [errors]) if each.method == "hybrid")
    for reduction in (row.reduction, row.reduction_x, row.reduction_y):
        assert (reduction.low, reduction.value, reduction.high) == pytest.approx((0.5, 0.5, 0.5))
    assert row.removable_gap_closed.value == pytest.approx(2.0 / 3.0)
    assert row.mean_distance_m.low < row.mean_distance_m.value < row.mean_distance_m.high


def test_tables_fit_a_terminal_of_80_columns() -> None:
    """Errors of metres, one method worse than the reference: nothing is cut off."""
    gap_m = np.random.default_rng(4).normal(0.0, 3.0, (14, 30, 2))
    factor = dict.fromkeys(ORDER, 1.0) | {"data_driven": 1.4, "hybrid": 0.5, "floor": 0.25}
    errors = {method: SequenceErrors(gap_m * factor[method], np.ones((14, 30)), gap_m) for method in ORDER}
    rows = [row for split in ("sequence", "random") for row in rows_of("calm", split, [errors])]
    console = Console(width=80, record=True, file=StringIO())
    table = Table3(tuple(rows), tuple(cells_of(rows)))
    console.print(table)
    assert len(table.plot().axes) == 1
    shown = console.export_text()
    assert "\u2026" not in shown
    assert all(method in shown for method in ORDER)


def _row(table: Table3, method: str, split: str, sea_state: str = "calm") -> Row:
    return next(r for r in table.rows if (r.method, r.split, r.sea_state) == (method, split, sea_state))


def test_the_floor_lies_below_every_other_row(table: Table3) -> None:
    """A little training does not reach what the truth itself makes of the measurements."""
    for sea_state in ("calm", "gentle"):
        floor = _row(table, "floor", "sequence", sea_state)
        assert floor.removable_gap_closed.value == pytest.approx(1.0)
        for method in ("reference", "paper", "data_driven"):
            assert floor.mean_distance_m.value < _row(table, method, "sequence", sea_state).mean_distance_m.value


def test_json_is_the_contracts_object(table: Table3) -> None:
    """Every method under both splits in each sea state, the keys to the letter, no NaN."""
    plain = json.loads(json.dumps(table.as_dict(), allow_nan=False))
    assert set(plain) >= {"rows", "published"}
    assert all(set(row) >= CONTRACT for row in plain["rows"])
    named = {(row["sea_state"], row["split"], row["method"]) for row in plain["rows"]}
    assert named == {(sea, split, method) for sea in ("calm", "gentle") for split in ("sequence", "random")
                     for method in ORDER}  # fmt: skip
    assert len(plain["published"]) == len(PUBLISHED) == 6
    assert len(plain["cells"]) == 6
    for row in plain["rows"]:
        assert row["low"] <= row["mean_distance_m"] <= row["high"]
        assert max(row["mae_x_m"], row["mae_y_m"]) <= row["mean_distance_m"] <= row["mae_x_m"] + row["mae_y_m"]


def test_a_perfect_prediction_of_the_ship_errs_by_the_waves_alone(table: Table3) -> None:
    """In a calm there are none and the sensors remain; in waves it is the least error that there can be."""
    calm = _row(table, "waves_only", "sequence", "calm").mean_distance_m.value
    gentle = _row(table, "waves_only", "sequence", "gentle").mean_distance_m.value
    assert 0.0 < calm < 0.03 < gentle < _row(table, "floor", "sequence", "gentle").mean_distance_m.value


def test_the_same_job_gives_the_same_rows(small: Callable[[list[CampaignJob]], Table3], table: Table3) -> None:
    """To the last digit, whatever else is compared beside it."""
    again = table3(small(SMALL[:1]))
    before = [row for row in table.as_dict()["rows"] if row["sea_state"] == SMALL[0].sea_state]
    assert again.as_dict()["rows"] == before


def test_a_cell_is_above_where_ours_is(table: Table3) -> None:
    """Without any error it is above the published reduction in every sea state, with the reference's in none."""
    best = [replace(r, reduction=replace(r.reduction, value=1.0)) for r in table.rows if r.split == "sequence"]
    assert all(cell.above for cell in cells_of(best) if cell.quantity == "reduction")
    worst = [replace(r, reduction=replace(r.reduction, value=0.0)) for r in table.rows if r.split == "sequence"]
    assert not any(cell.above for cell in cells_of(worst) if cell.quantity == "reduction")


def test_published_distances_agree_with_their_parts() -> None:
    """The paper's distance lies between its larger part and their sum, and its reduction within rounding."""
    for each in PUBLISHED:
        assert max(each.mae_x_m, each.mae_y_m) <= each.mean_distance_m <= each.mae_x_m + each.mae_y_m
    for before, after in zip(PUBLISHED[::2], PUBLISHED[1::2], strict=True):
        rounding = 0.005 / before.mean_distance_m * 2.0
        assert after.reduction == pytest.approx(1.0 - after.mean_distance_m / before.mean_distance_m, abs=rounding)


def test_files_hold_the_table(table: Table3, tmp_path: Path) -> None:
    as_json, as_csv = write_table3(table, tmp_path / "new")
    assert json.loads(as_json.read_text()) == json.loads(json.dumps(table.as_dict()))
    rows = pd.read_csv(as_csv)
    assert rows["mean_distance_m"].tolist() == pytest.approx([r.mean_distance_m.value for r in table.rows])


def test_the_command_prints_and_writes(table: Table3, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """``reproduce table3``: one JSON object on stdout, or tables with the published reductions beside ours."""
    monkeypatch.setattr("seatrial.notebooks.wang2021.campaign.seas_of", lambda *_: ())
    monkeypatch.setattr("seatrial.notebooks.wang2021.table3.table3", lambda *_: table)
    monkeypatch.setattr(
        "seatrial.notebooks.wang2021.figures.write_figures", lambda *_: []
    )  # the page without figures
    plain = CliRunner().invoke(seatrial.app, ["reproduce", "table3", "--json", "-o", str(tmp_path)])
    assert json.loads(plain.stdout) == json.loads((tmp_path / "table3.json").read_text())
    assert "Shortfalls" in (tmp_path / "table3.html").read_text()
    shown = CliRunner().invoke(seatrial.app, ["reproduce", "table3"], env={"COLUMNS": "140"}).stdout
    assert "published" in shown
    assert "88.3%" in shown


def test_what_is_finished_is_written_before_the_rest(shown: tuple[SeaResults, ...], tmp_path: Path) -> None:
    """The table of the campaigns so far stands in the folder, and lines say how many are to come and how long."""
    said: list[str] = []
    seconds = iter((0.0, 60.0, 100.0))
    running = RunningTable(2, 1, tmp_path, said.append, clock=lambda: next(seconds))
    running.announce()
    assert said[0].startswith("2 campaigns of some 60 s each on one core, 1 at a time: about 2 min")
    assert not list(tmp_path.iterdir())
    running.add(shown[0])
    assert json.loads((tmp_path / "table3.json").read_text()) == table3(shown[:1]).as_dict()
    assert said[1] == "1 of 2 campaigns after 60 s: calm sea, seed 0; about 60 s left"
    running.add(shown[1])
    assert said[2] == "2 of 2 campaigns after 2 min: gentle sea, seed 1; done"


def test_an_interrupt_leaves_the_finished_campaigns(
    shown: tuple[SeaResults, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The second campaign is interrupted; the first one's table is there and has a page."""

    def interrupted(
        jobs: list[CampaignJob], workers: object, progress: object, finished: Callable[[SeaResults], None]
    ) -> None:
        finished(shown[0])
        raise KeyboardInterrupt

    monkeypatch.setattr("seatrial.notebooks.wang2021.campaign.seas_of", interrupted)
    run = CliRunner().invoke(seatrial.app, ["reproduce", "table3", "-o", str(tmp_path)])
    assert run.exit_code != 0
    assert "1 of 15 campaigns" in run.stderr
    assert json.loads((tmp_path / "table3.json").read_text()) == table3(shown[:1]).as_dict()
    assert "How these figures are made" in write_page(tmp_path).read_text(encoding="utf-8")


@pytest.mark.slow
def test_the_number_of_workers_does_not_matter() -> None:
    jobs = [replace(job, sequences=6) for job in SMALL]
    assert table_of(jobs, workers=2).as_dict() == table_of(jobs, workers=1).as_dict()
