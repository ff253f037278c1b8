"""Figures: what is drawn where, and that angles leave no line across the turn."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Text

from seatrial.analysis.report.pages import fill_figure, numbers_in_figure
from seatrial.analysis.report.plots import (
    STYLE,
    axis_label,
    channels_figure,
    draw_series,
    draw_track,
    label_points,
    outline_rows,
    shade_held_windows,
)
from seatrial.analysis.windows.held import held_windows
from tests.analysis.conftest import steady_table


@pytest.fixture
def axes() -> Iterator[Axes]:
    with mpl.rc_context(STYLE):
        yield Figure().add_subplot()


def test_a_track_is_to_scale_with_held_stretches_times_and_manoeuvres(axes: Axes) -> None:
    table = steady_table(601).assign(north_m=np.arange(601.0), east_m=0.5 * np.arange(601.0))
    table.loc[table.index[300:330], "port_rpm"] += np.arange(30) * 5
    windows = held_windows(table)
    artists = draw_track(axes, table, windows.rows, tick_every_s=300.0, executes=[table.index[100]])
    assert axes.get_aspect() == 1.0
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("east [m]", "north [m]")
    held = artists[0]
    assert held.get_label() == "thrusters held"
    assert isinstance(held, Line2D)
    assert np.nanmax(np.diff(held.get_ydata())) == 1.0  # the pen is lifted between windows
    texts = [text.get_text() for text in axes.texts]
    assert texts[:4] == ["1", "08:20", "08:25", "08:30"]
    assert texts[-1].startswith("mean wind ")
    assert "manoeuvre begins" in axes.get_legend_handles_labels()[1]


def test_a_legend_has_only_what_is_drawn(axes: Axes) -> None:
    draw_track(axes, steady_table(60).assign(north_m=np.arange(60.0), east_m=0.0))
    assert axes.get_legend_handles_labels()[1] == ["track"]


@pytest.mark.parametrize("seed", range(4))
def test_labels_of_a_crowded_track_lie_on_none_other(seed: int) -> None:
    """A ship that goes up and down a short stretch, so that all of her marks are close together."""
    random = np.random.default_rng(seed)
    path = np.cumsum(random.normal(size=(1500, 2)), axis=0)
    figure = Figure(figsize=(8.0, 6.0))
    axes = figure.add_subplot()
    axes.plot(*path.T)
    labels = label_points(axes, list(map(tuple, path[::100])), [f"08:{n:02d}" for n in range(15)], path)
    figure.draw_without_rendering()
    boxes = [Text.get_window_extent(each) for each in labels]
    assert not any(one.overlaps(other) for one, other in combinations(boxes, 2))
    assert all(axes.bbox.x0 <= each.x0 and each.x1 <= axes.bbox.x1 for each in boxes)


@pytest.mark.parametrize("turns", [0.0, 0.3, 3.0])
def test_outlines_stand_clear_of_each_other(turns: float) -> None:
    """On a straight run, in a turn and where a ship turns over her own track."""
    angle = np.linspace(0.0, 2.0 * np.pi * turns, 2000)
    north, east = (np.cumsum(part) for part in (np.cos(angle), np.sin(angle)))
    length_m = 60.0
    rows = outline_rows(east, north, length_m)
    assert 2 <= len(rows) <= 12
    assert min(np.hypot(east[a] - east[b], north[a] - north[b]) for a, b in combinations(rows, 2)) > length_m


def test_a_heading_that_goes_all_around_is_not_drawn_across_the_turn(axes: Axes) -> None:
    table = steady_table(8).assign(heading_deg=[200.0, 290.0, 350.0, 10.0, 90.0, 170.0, 190.0, 230.0])
    (line,) = draw_series(axes, table, ["heading_deg"])
    assert np.flatnonzero(np.isnan(line.get_ydata())).tolist() == [3]
    assert axes.get_ylabel() == "heading\n[deg]"


def test_a_heading_about_north_is_one_line(axes: Axes) -> None:
    table = steady_table(6).assign(heading_deg=[350.0, 355.0, 1.0, 5.0, 358.0, 350.0])
    (line,) = draw_series(axes, table, ["heading_deg"])
    assert line.get_ydata().tolist() == [-10.0, -5.0, 1.0, 5.0, -2.0, -10.0]


def test_an_order_is_dashed_in_the_colour_of_what_followed(axes: Axes) -> None:
    table = steady_table(60).assign(rudder_angle_deg=np.arange(60.0) / 6.0, rudder_order_angle_deg=10.0)
    feedback, order = draw_series(axes, table, ["rudder_angle_deg"])
    assert feedback.get_color() == order.get_color()
    assert (feedback.get_linestyle(), order.get_linestyle()) == ("-", "--")
    assert axes.get_legend() is not None


def test_what_never_changes_is_in_the_caption() -> None:
    table = steady_table(60).assign(tunnel_rpm=0.0, wind_speed_mps=4.5)
    drawing = channels_figure(table)
    assert drawing is not None
    assert "wind speed [m/s] 4.5" in drawing[2]
    titles = [each["y"] for each in numbers_in_figure(fill_figure(*drawing[:2]))["axes"]]
    assert "wind speed [m/s]" not in titles


def test_every_shaft_of_a_ship_with_many_is_drawn(axes: Axes) -> None:
    names = [f"thruster_{letter}_rpm" for letter in "abcdefghij"]
    table = steady_table(60)[[]].assign(**dict.fromkeys(names, 100.0))
    assert [line.get_label() for line in draw_series(axes, table, names)] == [axis_label(name) for name in names]


def test_held_windows_are_shaded_over_the_full_height(axes: Axes) -> None:
    windows = held_windows(steady_table(60))
    draw_series(axes, steady_table(60), ["port_rpm", "starboard_rpm"], windows.rows)
    paths = shade_held_windows(axes, windows.rows).get_paths()
    assert len(paths) == 1  # nine windows that overlap are one stretch, so that no shade lies on another
    assert np.ptp(paths[0].vertices[:, 0]) * 86400 == pytest.approx(8 * 5 + 15, abs=1e-3)
    axes.figure.canvas.draw()
