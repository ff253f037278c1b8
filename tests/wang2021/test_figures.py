"""The figures and the page: files are written, everything has a unit, and they show what the data hold."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from seatrial.hybrid.calibrators import Calibrator, make_calibrator
from seatrial.hybrid.calibrators.adaptive import fit_parameter_vector
from seatrial.hybrid.calibrators.networks import NetworkCalibrator
from seatrial.hybrid.prediction.baselines import distances
from seatrial.hybrid.report.plots import rotate_to_start_frame
from seatrial.hybrid.vessel.plant import Plant
from seatrial.notebooks.wang2021 import campaign, figures, page
from seatrial.notebooks.wang2021.campaign import CampaignJob, seas_of
from seatrial.notebooks.wang2021.figures import FIGURES, Seas, write_figures
from seatrial.notebooks.wang2021.page import shortfalls, write_page, write_table3
from seatrial.notebooks.wang2021.table3 import Table3, table3
from tests.conftest import nightly
from tests.hybrid.windows_by_hand import random_windows


def quick(method: str, seed: int, plant: Plant) -> Calibrator:
    """A calibrator that is not trained for long."""
    calibrator = make_calibrator(method, seed, plant)
    if isinstance(calibrator, NetworkCalibrator):
        calibrator.epochs = 5
    return calibrator


@pytest.fixture(scope="module")
def shown() -> Iterator[Seas]:
    """One small campaign in a gentle sea."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(campaign, "make_calibrator", quick)
        patch.setattr(
            "seatrial.hybrid.calibrators.adaptive.fit_parameter_vector", partial(fit_parameter_vector, steps=1)
        )
        yield seas_of([CampaignJob("gentle", 2, sequences=12)], workers=1)


@pytest.fixture(scope="module")
def table(shown: Seas) -> Table3:
    return table3(shown)


def test_predictions_are_the_errors_put_back_on_the_measured_tracks(shown: Seas) -> None:
    """The reference's tracks from its errors are those that it was simulated to."""
    (sea,) = shown
    assert np.allclose(sea.predicted("reference"), sea.reference[sea.unseen][..., :2])
    gap_m = np.linalg.norm(sea.errors["sequence"]["floor"].gap_m, axis=2)
    assert gap_m.mean() < distances(sea.reference[sea.unseen], sea.judged.track).mean()


def test_the_start_frame_has_the_bow_up_and_keeps_distances() -> None:
    windows = random_windows(20, 10, seed=4)
    seen = rotate_to_start_frame(windows.track, windows.start)
    assert np.allclose(seen[:, 0], 0.0)
    moved = np.linalg.norm(windows.track[:, :, :2] - windows.start[:, None, :2], axis=2)
    assert np.allclose(np.linalg.norm(seen, axis=2), moved)
    assert np.allclose(seen[:, 1].sum(axis=0) > 0.0, [seen[:, 1, 0].sum() > 0.0, True])
    ahead = replace(windows, start=windows.start * [1, 1, 1, 1, 0, 0])
    straight = (
        ahead.start[:, None, :2] + np.stack([np.cos(ahead.start[:, 2]), np.sin(ahead.start[:, 2])], -1)[:, None]
    )
    assert np.allclose(rotate_to_start_frame(straight, ahead.start), [0.0, 1.0])


@pytest.mark.parametrize("name", [*list(FIGURES)[::2], *nightly(*list(FIGURES)[1::2])])
def test_every_axis_of_every_figure_has_its_unit(shown: Seas, name: str) -> None:
    figure = Figure(figsize=FIGURES[name].size_inch)
    FIGURES[name].draw(figure, shown)
    assert figure.axes
    drawn = [axes for axes in figure.axes if axes.axison and axes.lines]
    along = {"figure_05_channels": "UTC", "figure_10_distribution": ""}.get(name, "[")
    assert any(along in axes.get_xlabel() for axes in drawn)
    assert any("[" in axes.get_ylabel() for axes in drawn)
    labels = [text for axes in drawn for text in (axes.get_xlabel(), axes.get_ylabel()) if text]
    assert all("[" in text or "UTC" in text for text in labels)
    assert figure.get_suptitle() or any(axes.get_title(loc="left") for axes in drawn)


@pytest.fixture
def few(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Two of the figures are enough to try writing."""
    names = ["figure_07_errors", "figure_10_distribution"]
    for module in (figures, page):
        monkeypatch.setattr(module, "FIGURES", {name: FIGURES[name] for name in names})
    return names


def test_figures_are_written_as_pictures_for_print_and_as_numbers(
    shown: Seas, few: list[str], tmp_path: Path
) -> None:
    paths = write_figures(shown, tmp_path)
    endings = ("png", "svg", "pdf", "json")
    assert {path.name for path in paths} == {f"{name}.{ending}" for name in few for ending in endings}
    assert all(path.read_bytes()[:4] == b"\x89PNG" for path in paths if path.suffix == ".png")


def test_boxes_lie_where_the_errors_are() -> None:
    errors_m = {("reference", split): np.full(9, 2.0) for split in figures.SPLIT_LOOK}
    axes = Figure().subplots()
    figures.error_spread(axes, errors_m, ("reference",))
    medians = [line.get_ydata() for line in axes.lines if len(np.unique(np.asarray(line.get_ydata()))) == 1]
    assert all(np.allclose(np.asarray(each), 2.0) for each in medians)


def test_the_page_says_what_falls_short_and_needs_no_network(
    shown: Seas, table: Table3, few: list[str], tmp_path: Path
) -> None:
    write_figures(shown, tmp_path)
    write_table3(table, tmp_path)
    text = write_page(tmp_path).read_text()
    assert text.count("data:image/png;base64") == len(few)
    assert "http" not in text.replace("http://www.w3.org", "")
    for sentence in shortfalls(table):
        assert sentence.split(" (")[0] in text


def test_every_published_cell_not_reached_is_a_shortfall(table: Table3) -> None:
    said = shortfalls(table)
    missed = [cell for cell in table.cells if not cell.above]
    assert len(missed) <= len(said) <= len(missed) + 1
    reached = [replace(cell, published=-1e6) for cell in table.cells]
    assert len(shortfalls(replace(table, cells=tuple(reached)))) == len(said) - len(missed)
