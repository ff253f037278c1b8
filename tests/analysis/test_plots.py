"""Figures: what is drawn where, and that angles leave no line across the turn."""

from __future__ import annotations

from collections.abc import Iterator

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from analysis.report.plots import STYLE, held_shade, label, series, track
from analysis.windows.held import held_windows
from tests.analysis.conftest import steady_table


@pytest.fixture
def axes() -> Iterator[Axes]:
    with mpl.rc_context(STYLE):
        yield Figure().add_subplot()


def test_a_track_is_to_scale_with_one_colour_a_leg(axes: Axes) -> None:
    table = steady_table(601).assign(north_m=np.arange(601.0), east_m=0.5 * np.arange(601.0))
    table.loc[table.index[300:330], "port_rpm"] += np.arange(30) * 5
    windows = held_windows(table)
    artists = track(axes, table, windows.rows, tick_every_s=300.0)
    assert axes.get_aspect() == 1.0
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("east [m]", "north [m]")
    assert len({line.get_color() for line in artists[1 : 1 + windows.legs]}) == windows.legs == 2
    texts = [text.get_text() for text in axes.texts]
    assert texts[:3] == ["08:20", "08:25", "08:30"]
    assert texts[-1].startswith("wind ")


def test_a_heading_is_not_drawn_across_the_turn(axes: Axes) -> None:
    table = steady_table(6).assign(heading_deg=[350.0, 355.0, 1.0, 5.0, 358.0, 350.0])
    (line,) = series(axes, table, ["heading_deg"])
    assert np.flatnonzero(np.isnan(line.get_ydata())).tolist() == [2, 4]
    assert axes.get_ylabel() == "heading [deg]"


def test_every_shaft_of_a_ship_with_many_is_drawn(axes: Axes) -> None:
    names = [f"thruster_{letter}_rpm" for letter in "abcdefghij"]
    table = steady_table(60)[[]].assign(**dict.fromkeys(names, 100.0))
    assert [line.get_label() for line in series(axes, table, names)] == [label(name) for name in names]


def test_held_windows_are_shaded_over_the_full_height(axes: Axes) -> None:
    windows = held_windows(steady_table(60))
    series(axes, steady_table(60), ["port_rpm", "starboard_rpm"], windows.rows)
    paths = held_shade(axes, windows.rows).get_paths()
    assert len(paths) == 1  # nine windows that overlap are one stretch, so that no shade lies on another
    assert np.ptp(paths[0].vertices[:, 0]) * 86400 == pytest.approx(8 * 5 + 15, abs=1e-3)
    axes.figure.canvas.draw()
