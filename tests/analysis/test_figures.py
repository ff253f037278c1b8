"""Figures as files: their numbers are what was drawn, formats are what they say, bytes are the same each time."""

from __future__ import annotations

import json
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.figure import Figure
from matplotlib.text import Annotation

from seatrial.acquisition.core.errors import StorageError
from seatrial.analysis.report.pages import (
    figure_file_name,
    fill_figure,
    numbers_in_figure,
    render,
    template_environment,
    write_figure,
)
from seatrial.analysis.report.plots import draw_series, draw_track, shade_held_windows
from seatrial.analysis.windows.held import held_windows
from tests.analysis.conftest import steady_table

SIZE = (4.0, 3.0)


def drawn_in(figure: Figure, kind: str) -> list[dict[str, object]]:
    return [each for axes in numbers_in_figure(figure)["axes"] for each in axes["drawn"] if each["kind"] == kind]


@given(st.lists(st.floats(-1e6, 1e6) | st.just(float("nan")), min_size=1, max_size=20))
def test_a_lines_numbers_come_back_and_gaps_are_null(values: list[float]) -> None:
    figure = Figure()
    figure.subplots().plot(values, label="what")
    (line,) = drawn_in(figure, "line")
    assert line["label"] == "what"
    back = np.array([np.nan if each is None else each for each in line["y"]])  # type: ignore[attr-defined]
    np.testing.assert_allclose(back, values, rtol=1e-6, atol=1e-12)
    json.dumps(numbers_in_figure(figure), allow_nan=False)


def test_bars_meshes_points_and_areas_are_numbers() -> None:
    figure = Figure()
    axes = figure.subplots()
    axes.bar([1.0, 2.0], [3.0, 5.0])
    axes.pcolormesh([0.0, 1.0, 2.0], [0.0, 1.0], np.array([[7.0, np.nan]]))
    axes.scatter([0.5], [0.25])
    axes.fill_between([0.0, 1.0], [0.0, 0.0], [1.0, 2.0])
    assert [each["y"] for each in drawn_in(figure, "bar")] == [[0.0, 3.0], [0.0, 5.0]]
    (mesh,) = drawn_in(figure, "mesh")
    assert mesh["values"] == [[7.0, None]]
    assert mesh["x_edges"] == [0.0, 1.0, 2.0]
    (points,) = drawn_in(figure, "points")
    assert (points["x"], points["y"]) == ([0.5], [0.25])
    (area,) = drawn_in(figure, "areas")
    assert max(area["areas"][0]["y"]) == 2.0  # type: ignore[index]


def test_times_are_iso_8601_in_utc() -> None:
    table = steady_table(60)
    figure = fill_figure(lambda figure: draw_series(figure.subplots(), table, ["surge_mps"]), SIZE)
    (line,) = drawn_in(figure, "line")
    times = pd.to_datetime(pd.Series(line["x"]), utc=True)
    assert list(times) == list(table.index)
    axes = numbers_in_figure(figure)["axes"][0]
    assert (axes["x"], axes["y"]) == ("time, UTC", "surge [m/s]")


def test_shades_are_given_as_times_too() -> None:
    windows = held_windows(steady_table(60)).rows
    figure = Figure()
    axes = figure.subplots()
    draw_series(axes, steady_table(60), ["surge_mps"])
    shade_held_windows(axes, windows)
    (shade,) = [each for each in drawn_in(figure, "areas") if each.get("label") == "held"]
    both = pd.to_datetime([shade["areas"][0]["x"][0], windows["start"].min().isoformat()], utc=True)  # type: ignore[index]
    assert abs((both[0] - both[1]).total_seconds()) < 1e-3


def test_files_are_what_they_are_called_and_the_same_each_time(tmp_path: Path) -> None:
    def draw(figure: Figure) -> object:
        return draw_track(figure.subplots(), steady_table(120), tick_every_s=60.0, length_m=30.0)

    for name in ("a", "b"):
        write_figure(fill_figure(draw, SIZE), tmp_path / name, "track")
    svg, pdf, numbers = (tmp_path / "a" / f"track.{ending}" for ending in ("svg", "pdf", "json"))
    assert svg.read_text().lstrip().startswith("<?xml")
    assert pdf.read_bytes().startswith(b"%PDF")
    assert b"/FontFile2" in pdf.read_bytes()  # fonts are embedded, as journals want them
    assert json.loads(numbers.read_text())["axes"][0]["x"] == "east [m]"
    for ending in ("svg", "pdf", "json"):
        assert (tmp_path / f"a/track.{ending}").read_bytes() == (tmp_path / f"b/track.{ending}").read_bytes()


def test_a_folder_that_cannot_be_is_one_clear_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(StorageError, match="file"):
        write_figure(Figure(), tmp_path / "file", "x")


def test_drawing_leaves_the_users_settings_alone(tmp_path: Path) -> None:
    before = dict(mpl.rcParams)
    (tmp_path / "line.html").write_text('{{ chart(draw, (3, 2), "A line, and no more.", "") }}')
    page = render("line.html", templates=template_environment(tmp_path), draw=lambda axes: axes.plot([0, 1]))
    assert dict(mpl.rcParams) == before
    assert list(page.figures) == ["a_line_and_no_more"]


def test_names_are_safe_for_files() -> None:
    assert figure_file_name("../x: [m/s] \u00b0") == "x_m_s"
    assert figure_file_name("\u00b0") == "figure"


def test_the_ship_is_drawn_to_scale_or_says_by_how_much_not() -> None:
    near = steady_table(60)
    far = near.assign(north_m=np.linspace(0.0, 20_000.0, len(near)))
    for table, words in ((near, "to scale"), (far, "times its size")):
        figure = Figure()
        axes = figure.subplots()
        draw_track(axes, table, tick_every_s=30.0, length_m=30.0)
        (label,) = [text for text in axes.get_legend_handles_labels()[1] if "ship" in text]
        assert words in label
        hull = next(patch for patch in axes.patches if "ship" in str(patch.get_label()))
        length = float(np.hypot(*np.ptp(hull.get_xy(), axis=0)))  # type: ignore[attr-defined]
        times = 1.0 if words == "to scale" else float(label.split(", ")[1].split()[0])
        assert length == pytest.approx(30.0 * times, rel=0.05)


def test_the_wind_arrow_points_where_the_wind_blows_to() -> None:
    """From the north it points down, from the west to the right, and the text says where it comes from."""
    for from_deg, direction in ((0.0, (0.0, -1.0)), (270.0, (1.0, 0.0))):
        table = steady_table(60).assign(wind_direction_deg=from_deg, wind_speed_mps=5.0)
        figure = Figure()
        axes = figure.subplots()
        draw_track(axes, table, tick_every_s=60.0)
        (arrow,) = [text for text in axes.texts if isinstance(text, Annotation) and not text.get_text()]
        way = np.array(arrow.xy) - np.array(arrow.get_position())  # type: ignore[attr-defined]
        assert way / np.hypot(*way) == pytest.approx(direction, abs=1e-9)
        assert any(f"from {from_deg:.0f}\u00b0" in text.get_text() for text in axes.texts)
