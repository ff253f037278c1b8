"""The interactive page: what is in it is the table's, and in a browser the mouse and the keys do what they say."""

from __future__ import annotations

import builtins
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from seatrial.acquisition.core.errors import ConfigurationError, DataShortageError, InputError
from seatrial.acquisition.core.ship import BY_NAME, CIRCULAR, NAMES, wrap_180
from seatrial.analysis.manoeuvres.indices import Manoeuvre
from seatrial.analysis.report.interactive import (
    MOST_PREDICTED,
    MOST_ROWS,
    interactive_page,
    page_data,
    round_values,
    select_rows,
)
from seatrial.analysis.windows.held import held_windows
from tests.analysis.conftest import START_S, steady_table, table_at
from tests.browser import Browser, running_browser

EVIL = "</script><script>alert(1)</script>\"'&"
SECONDS = 900


def circling(seconds: int = SECONDS, step_s: float = 1.0) -> pd.DataFrame:
    """A ship that goes round at 1 deg/s through north, every channel with values of its own, port rpm stepped."""
    time_s = step_s * np.arange(seconds)
    table = steady_table(seconds).set_index(table_at(time_s, {}).index)
    turned = np.deg2rad(time_s)
    columns: dict[str, Any] = {name: 10.0 * number + 0.013 * time_s for number, name in enumerate(NAMES)}
    columns |= {"heading_deg": time_s % 360.0, "wind_direction_deg": (350.0 + 7.0 * np.sin(9 * turned)) % 360.0}
    columns |= {"north_m": 200.0 * np.sin(turned), "east_m": 200.0 * (1.0 - np.cos(turned))}
    columns |= {name: np.full(seconds, 120.0) for name in ("starboard_rpm", "tunnel_rpm")}
    columns |= {name: np.full(seconds, 179.0) for name in ("port_angle_deg", "starboard_angle_deg")}
    columns["port_rpm"] = np.where(time_s < 0.5 * time_s[-1], 120.0, 60.0)
    return table.assign(**columns)


def predictions(windows: pd.DataFrame) -> pd.DataFrame:
    """A prediction by window that is north of the measured track."""
    times = pd.DatetimeIndex(windows["start"]) + pd.to_timedelta(windows["second"], unit="s").to_numpy()
    names = ["window", "north_m", "east_m", "heading_deg", "surge_mps", "sway_mps", "yaw_rate_dps"]
    return windows[names].set_index(times).assign(north_m=windows["north_m"].to_numpy() + 20.0)


def manoeuvre(name: str = "zigzag 10/10", first_s: int = 100, end_s: int = 300) -> Manoeuvre:
    start, change, end = (pd.Timestamp(START_S + second, unit="s", tz="UTC") for second in (first_s, 200, end_s))
    return Manoeuvre("zigzag", name, start, end, "port", {}, {}, executes=(change,))


def data_of(html: str) -> dict[str, Any]:
    found = re.search(r'<script type="application/json" id="data">(.*?)</script>', html, re.DOTALL)
    assert found is not None
    return dict(json.loads(found[1]))


def test_the_pages_values_are_the_tables() -> None:
    table = circling()
    data = data_of(interactive_page(table).html)
    assert data["start_ms"] == START_S * 1000
    assert data["time_s"] == list(range(SECONDS))
    assert list(data["channels"]) == list(NAMES)
    for name in NAMES:
        np.testing.assert_allclose(data["channels"][name], table[name], atol=0.05 if "rpm" in name else 0.006)


def test_nothing_is_fetched_and_the_browser_is_told_so() -> None:
    html = interactive_page(circling()).html
    own = re.sub(r"<script>.*?</script>", "", html, count=1, flags=re.DOTALL)  # the library in it is plotly's
    assert "plotly.js v" in html
    assert len(own) < 400_000
    assert re.findall(r"https?:|//[a-z]+\.[a-z]+/|@import|url\(|<link|\bsrc=", own) == []
    assert "default-src 'none'" in own


def test_what_a_trial_calls_itself_is_text_and_no_markup() -> None:
    windows = held_windows(circling(), trial=EVIL).rows
    html = interactive_page(circling(), windows, {EVIL: predictions(windows)}, [manoeuvre(EVIL)], EVIL, EVIL).html
    assert "<script>alert" not in html
    assert html.count("<script") == html.count("</script>") == 3
    assert data_of(html)["manoeuvres"][0]["name"] == EVIL


def test_missing_channels_are_named_and_their_panels_left_out() -> None:
    table = circling().drop(columns=["north_m", "wind_speed_mps"]).assign(sway_mps=np.nan)
    html = interactive_page(table).html
    titles = [panel["title"] for panel in data_of(html)["style"]["panels"]]
    assert "Without north_m, sway_mps, wind_speed_mps." in html
    assert "there is no track" in html
    assert not {"sway [m/s]", "wind speed [m/s]"} & set(titles)
    assert "surge [m/s]" in titles


def test_lines_are_lifted_at_the_wrap_at_holes_and_nowhere_else() -> None:
    table = circling()
    data = page_data(table.drop(table.index[500:520]))
    assert data["lifts"] == {}
    assert data["holes"] == [500]
    assert set(data["drawn"]) == CIRCULAR & set(NAMES)
    wild = page_data(table.assign(port_angle_deg=np.tile([179.0, -179.0, -10.0], SECONDS // 3)))
    assert wild["lifts"] == {"port_angle_deg": [row for row in range(1, SECONDS) if row % 3 != 2]}
    assert "port_angle_deg" not in wild["drawn"]


def test_an_angle_is_one_line_that_runs_on_beyond_the_turn_and_predictions_lie_on_it() -> None:
    """Drawn values are the channel's within the turn and never jump; predictions of the measured lie on it."""
    table = circling()
    windows = held_windows(table).rows
    data = page_data(table, windows, {"hybrid": predictions(windows)})
    for name, line in data["drawn"].items():
        assert np.max(np.abs(np.diff(line))) < 20.0
        np.testing.assert_allclose(wrap_180(np.array(line) - data["channels"][name]), 0.0, atol=0.011)
    assert max(data["drawn"]["heading_deg"]) == SECONDS - 1
    predicted = data["predicted"]["hybrid"]
    at = np.searchsorted(data["time_s"], predicted["time_s"])
    np.testing.assert_allclose(
        predicted["drawn"]["heading_deg"], np.array(data["drawn"]["heading_deg"])[at], atol=0.1
    )


def test_rounded_angles_stay_inside_their_turn() -> None:
    assert round_values(BY_NAME["heading_deg"], np.array([359.999, 0.004])).tolist() == [0.0, 0.0]
    assert round_values(BY_NAME["port_angle_deg"], np.array([-179.999, 180.0])).tolist() == [180.0, 180.0]


def test_an_order_is_in_the_panel_of_what_followed_it() -> None:
    data = data_of(interactive_page(circling().assign(port_order_rpm=130.0)).html)
    (panel,) = (each["names"] for each in data["style"]["panels"] if "port_rpm" in each["names"])
    assert "port_order_rpm" in panel
    ordered, followed = (data["style"]["controls"][name] for name in ("port_order_rpm", "port_rpm"))
    assert ordered["colour"] == followed["colour"]
    assert ordered["dash"] == "dash"
    assert "dash" not in followed


def test_missing_values_are_null() -> None:
    table = circling()
    table.iloc[5, table.columns.get_loc("surge_mps")] = np.nan
    surge = page_data(table)["channels"]["surge_mps"]
    assert surge[5] is None
    assert None not in surge[6:]


def test_thinning_keeps_every_extreme_and_the_page_says_so() -> None:
    rows = 3 * MOST_ROWS
    table = circling(rows, 0.1)
    peaks = {"surge_mps": (31_007, 29.5), "yaw_rate_dps": (47_011, -55.0), "tunnel_rpm": (11_003, 2900.0)}
    for name, (row, value) in peaks.items():
        table.iloc[row, table.columns.get_loc(name)] = value
    table.iloc[52_003:52_006, table.columns.get_loc("sway_mps")] = np.nan
    html = interactive_page(table).html
    data = data_of(html)
    shown = len(data["time_s"])
    assert 0.3 * MOST_ROWS < shown <= MOST_ROWS
    assert f"Of {rows:,} rows {shown:,} are shown" in html
    for name, (row, value) in peaks.items():
        assert data["time_s"][data["channels"][name].index(value)] == pytest.approx(row / 10.0)
    assert None in data["channels"]["sway_mps"]
    assert data["holes"] == []  # thinned rows are no holes in time


@pytest.mark.parametrize("rows", [29, 99, 1000, 1001])
def test_thinning_keeps_the_ends_what_is_missing_and_the_rows_beside_holes(rows: int) -> None:
    values = {"north_m": np.random.default_rng(rows).standard_normal(rows)}
    values["north_m"][13] = np.nan
    kept = select_rows(values, np.array([7]), rows, 30)
    assert {0, 6, 7, 13, rows - 1} <= set(kept.tolist())
    assert {int(np.nanargmin(values["north_m"])), int(np.nanargmax(values["north_m"]))} <= set(kept.tolist())
    assert kept.size <= 30


def test_held_stretches_and_legs_are_those_of_the_windows() -> None:
    windows = held_windows(circling().assign(surge_mps=1.0))
    data = page_data(circling(), windows.rows)
    assert data["legs"] == windows.leg_count == 2
    assert data["held"][0][0] == 0.0
    for begin, end in data["held"]:
        assert np.ptp(circling()["port_rpm"].iloc[int(begin) : int(end) + 1]) == 0.0
    moving = windows.rows.assign(held=windows.rows["window"] < 3)
    assert page_data(circling(), moving)["held"] == [[0.0, 25.0]]


def test_predictions_are_lifted_between_windows_and_thinned_by_whole_ones() -> None:
    windows = held_windows(circling()).rows
    few = page_data(circling(), windows, {"hybrid": predictions(windows)})["predicted"]["hybrid"]
    assert few["every"] == 1
    assert few["holes"] == list(range(16, len(windows), 16))
    assert few["drawn"]["heading_deg"]
    times = 1 + MOST_PREDICTED // len(windows)
    many = pd.concat([windows.assign(window=windows["window"] + 1000 * turn) for turn in range(times)])
    html = interactive_page(circling(), windows, {"hybrid": predictions(many)}).html
    assert "Of the predictions (hybrid) one window in 2 is shown." in html
    assert len(data_of(html)["predicted"]["hybrid"]["time_s"]) % 16 == 0
    plain = predictions(windows[windows["window"] % 4 == 0]).drop(columns="window")
    lifted = page_data(circling(), None, {"hybrid": plain})["predicted"]["hybrid"]["holes"]
    assert lifted == list(range(16, len(plain), 16))


def test_the_file_is_written_whole(tmp_path: Path) -> None:
    path = interactive_page(circling(60), title="Trial 7").write(tmp_path / "deep" / "page.html")
    assert "<title>Trial 7</title>" in path.read_text(encoding="utf-8")
    assert [each.name for each in path.parent.iterdir()] == ["page.html"]


def test_tables_that_cannot_be_shown_are_refused() -> None:
    with pytest.raises(DataShortageError, match="no row"):
        interactive_page(circling().iloc[:0])
    with pytest.raises(DataShortageError, match="none of the 8 channels"):
        interactive_page(circling()[["north_m"]].assign(north_m=np.nan, roll_deg=1.0))
    with pytest.raises(InputError, match="do not increase"):
        interactive_page(circling().iloc[::-1])
    with pytest.raises(InputError, match="no zone"):
        interactive_page(circling().tz_localize(None))


def test_without_plotly_the_error_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    known = builtins.__import__

    def refuse(name: str, *rest: Any, **more: Any) -> Any:
        if name.startswith("plotly"):
            raise ImportError(name)
        return known(name, *rest, **more)

    monkeypatch.setattr(builtins, "__import__", refuse)
    with pytest.raises(ConfigurationError, match=r"pip install 'seatrial\[interactive\]'"):
        interactive_page(circling(60))


@pytest.fixture(scope="module")
def opened(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    """A browser with the page of a circling ship: windows, two methods, a manoeuvre."""
    folder = tmp_path_factory.mktemp("interactive")
    table = circling()
    windows = held_windows(table).rows
    predicted = {name: predictions(windows) for name in ("reference", "hybrid")}
    page = interactive_page(table, windows, predicted, [manoeuvre()], "Circling", "for tests")
    path = page.write(folder / "page.html")
    with running_browser() as browser:
        browser.open(path, READY)
        yield browser


@pytest.fixture
def page(opened: Browser) -> Browser:
    """The page with all of the trial in sight, the cursor at its first second, the mouse away."""
    opened.evaluate("window.scrollTo(0,0)")
    opened.move(2, 2)
    opened.click_on("#whole")
    opened.wait_for("state.from === 0 && state.to === END_S")
    opened.evaluate("moveTo(0)")
    return opened


READY = "document.body.dataset.ready"
IN_SERIES = """(second=>{const a=series._fullLayout.xaxis,r=series.getBoundingClientRect();
return [r.x+a._offset+a.l2p(page.start_ms+1000*second), r.y+0.45*r.height]})"""
SHIP_AT = """(()=>{const r=document.getElementById('ship').getBoundingClientRect(),t=track.getBoundingClientRect();
return [r.x+r.width/2-t.x, r.y+r.height/2-t.y]})()"""
SURGE_RANGE = "series._fullLayout.yaxis2.range"
ON_TRACK = "(row=>{const r=track.getBoundingClientRect(),p=pixelOf(row);return [r.x+p[0],r.y+p[1]]})"


def values_read(browser: Browser) -> dict[str, str]:
    cells = "[...document.querySelectorAll('#readout [data-channel]')].map(c=>[c.dataset.channel,c.textContent])"
    return dict(browser.evaluate(cells))


def second_of(browser: Browser) -> float:
    """The second of the trial that the readout is of."""
    time = pd.Timestamp(browser.evaluate("readout.dataset.time"))
    return float(time.timestamp() - START_S)


def assert_reads(browser: Browser, table: pd.DataFrame, row: int) -> None:
    """The readout's text is the table's value, to the last decimal that is shown."""
    for name, text in values_read(browser).items():
        decimals = len(text.partition(".")[2])
        off = abs(float(text) - float(table[name].iloc[row]))
        assert min(off, 360.0 - off if name in CIRCULAR else off) <= 0.5001 * 10.0**-decimals, (name, text)


def test_the_page_opens_without_network_and_without_a_word_in_the_console(opened: Browser) -> None:
    assert opened.requests == [opened.evaluate("location.href")]
    assert opened.errors == []


def test_a_click_in_a_time_series_moves_the_cursor_and_reads_that_second(page: Browser) -> None:
    for second in (333, 612):
        x, y = page.evaluate(f"{IN_SERIES}({second})")
        page.click(x, y)
        page.move(2, 2)  # what is read is the cursor's second, and not the mouse's
        assert second_of(page) == pytest.approx(second, abs=1.0)
        assert_reads(page, circling(), int(second_of(page)))
        assert len(values_read(page)) == len(NAMES)
        left = page.evaluate("document.getElementById('cursor').getBoundingClientRect().x")
        assert left == pytest.approx(x, abs=1.5)
        assert page.evaluate("document.getElementById('time').textContent").endswith(
            f"{pd.Timestamp(START_S + int(second_of(page)), unit='s'):%H:%M:%S} UTC"
        )


def test_hovering_shows_a_second_and_the_cursor_stays(page: Browser) -> None:
    page.move(*page.evaluate(f"{IN_SERIES}(500)"))
    assert second_of(page) == pytest.approx(500, abs=1.0)
    assert_reads(page, circling(), int(second_of(page)))
    page.move(2, 2)
    assert second_of(page) == 0.0


def test_the_ship_lies_where_she_was_and_points_where_she_headed(page: Browser) -> None:
    page.click(*page.evaluate(f"{IN_SERIES}(150)"))
    row = int(second_of(page))
    east, north = page.evaluate(f"pixelOf({row})")
    turned = re.findall(r"-?[\d.]+", page.evaluate("document.getElementById('ship').getAttribute('transform')"))
    assert [float(each) for each in turned] == pytest.approx([east, north, circling()["heading_deg"].iloc[row]])
    hull = page.evaluate(SHIP_AT)
    assert hull == pytest.approx([east, north], abs=6.0)


def test_a_metre_north_is_as_long_as_a_metre_east(page: Browser) -> None:
    scales = page.evaluate("axes(track).map(axis=>Math.abs(axis.l2p(100)-axis.l2p(0)))")
    assert scales[0] == pytest.approx(scales[1], rel=1e-3)
    assert scales[0] > 50.0
    assert page.evaluate("axes(track)[1].l2p(100)<axes(track)[1].l2p(0)")  # north is up


def test_a_click_on_the_track_moves_the_cursor_to_the_nearest_second(page: Browser) -> None:
    x, y = page.evaluate(f"{ON_TRACK}(90)")
    page.click(x + 5, y)
    told = page.evaluate("document.getElementById('tip').textContent")
    page.move(2, 2)
    assert second_of(page) % 360 == pytest.approx(90, abs=3.0)  # she comes by every 360 s
    assert_reads(page, circling(), int(second_of(page)))
    assert re.fullmatch(r"08:\d\d:\d\d UTC\nspeed [\d.]+ m/s\nheading [\d.]+°\nwind [\d.]+ m/s from [\d.]+°", told)
    middle = page.evaluate("(()=>{const r=track.getBoundingClientRect(),[x,y]=axes(track);"
                           "return [r.x+x._offset+x.l2p(200),r.y+y._offset+y.l2p(0)]})()")  # fmt: skip
    before = second_of(page)
    page.click(*middle)
    assert second_of(page) == before  # nothing is near the middle of the circle


def test_a_drag_zooms_in_time_and_the_track_shows_that_stretch(page: Browser) -> None:
    page.drag(page.evaluate(f"{IN_SERIES}(200)"), page.evaluate(f"{IN_SERIES}(380)"))
    page.wait_for("state.from > 0")
    begin, end = page.evaluate("[state.from, state.to]")
    assert [begin, end] == pytest.approx([200, 380], abs=2.0)
    assert page.evaluate("document.getElementById('shown').textContent").startswith("08:23:")
    stretch = page.evaluate("track.data.find(trace=>trace.meta&&trace.meta.stretch).x.filter(x=>x!=null)")
    rows = circling()["east_m"].iloc[int(np.ceil(begin)) : int(end) + 1]
    np.testing.assert_allclose(stretch, rows, atol=0.006)
    assert second_of(page) == 0.0  # a drag is no click
    page.click_on("#fit")
    page.wait_for(f"{SURGE_RANGE}[1] < 36")
    low, high = page.evaluate(SURGE_RANGE)
    surge = circling()["surge_mps"].iloc[int(begin) : int(end) + 1]
    assert surge.min() - 0.5 < low < surge.min() < surge.max() < high < surge.max() + 0.5
    page.click_on("#whole")
    page.wait_for("state.from === 0 && state.to === END_S")
    assert page.evaluate("track.data.every(trace=>!(trace.meta&&trace.meta.stretch))")
    page.wait_for(f"{SURGE_RANGE}[1] > 41")


def test_a_manoeuvres_button_zooms_to_it_and_marks_it(page: Browser) -> None:
    page.click_on("#manoeuvres button")
    page.wait_for("state.from > 0")
    begin, end = page.evaluate("[state.from, state.to]")
    assert 50 < begin < 100
    assert 300 < end < 350
    assert second_of(page) == 100.0
    assert page.evaluate("document.querySelector('#manoeuvres tr').classList.contains('at')")
    executes = page.evaluate("track.data.find(trace=>trace.meta&&trace.meta.executes).x")
    np.testing.assert_allclose(executes, circling()["east_m"].iloc[[100, 200]], atol=0.006)


BAND = """(second=>{const r=series.getBoundingClientRect(),{t,h}=series._fullLayout._size,a=axes(series)[0];
return [r.x+a._offset+a.l2p(page.start_ms+1000*second), r.y+t-((BAND[0]+BAND[1])/2-1)*h]})"""


@pytest.mark.parametrize(
    "place", [f"{BAND}(200)", f"{ON_TRACK}(rowAt(100))"], ids=["above the panels", "on the track"]
)
def test_a_click_on_a_manoeuvre_shows_it_alone(page: Browser, place: str) -> None:
    """Panels and track hold it and little more, and whole trial brings all back."""
    page.click(*page.evaluate(place))
    page.wait_for(f"state.from > 0 && {SURGE_RANGE}[1] < 36")
    begin, end = page.evaluate("[state.from, state.to]")
    assert 50 < begin < 100 < 300 < end < 350
    assert second_of(page) == pytest.approx(100.0, abs=1.0)
    rows = circling().iloc[int(np.ceil(begin)) : int(end) + 1]
    for axis, name in zip(("xaxis", "yaxis"), ("east_m", "north_m"), strict=True):
        low, high = sorted(page.evaluate(f"track._fullLayout.{axis}.range"))
        assert low <= rows[name].min() <= rows[name].max() <= high
    page.click_on("#whole")
    page.wait_for("state.from === 0 && state.to === END_S")
    assert page.errors == []


def test_times_before_the_first_row_may_be_shown(page: Browser) -> None:
    """As around a manoeuvre that begins with the recording."""
    page.evaluate("showTimes(-50, 200)")
    page.wait_for("state.to < 201")
    assert page.evaluate("state.from") == 0.0


def test_a_row_of_the_list_zooms_as_its_number_does(page: Browser) -> None:
    page.click_on("#manoeuvres td:last-child")
    page.wait_for("state.from > 0")
    assert 50 < page.evaluate("state.from") < 100


def test_predictions_are_hidden_and_shown_by_their_button(page: Browser) -> None:
    seen = "[series,track].map(plot=>plot.data.filter(t=>t.meta&&t.meta.method==='%s'&&t.visible!==false).length)"
    assert page.evaluate(seen % "hybrid") == [4, 1]
    page.click_on("button[data-method=hybrid]")
    page.wait_for("state.hidden.has('hybrid')")
    assert page.evaluate(seen % "hybrid") == [0, 0]
    assert page.evaluate(seen % "reference") == [4, 1]
    assert page.evaluate("document.querySelector('button[data-method=hybrid]').ariaPressed") == "false"
    page.click_on("button[data-method=hybrid]")
    assert page.evaluate(seen % "hybrid") == [4, 1]


def test_keys_move_the_cursor_by_a_second_or_ten_and_not_beyond_the_ends(page: Browser) -> None:
    page.press("ArrowRight", shift=True)
    page.press("ArrowRight")
    page.press("ArrowRight")
    assert second_of(page) == 12.0
    assert_reads(page, circling(), 12)
    page.press("ArrowLeft")
    assert second_of(page) == 11.0
    for _ in range(3):
        page.press("ArrowLeft", shift=True)
    assert second_of(page) == 0.0
    assert page.errors == []


def test_on_paper_the_plots_are_as_wide_as_a_sheet_and_as_high_and_then_as_before(page: Browser) -> None:
    size = "[series._fullLayout.width, series._fullLayout.height, series.clientHeight]"
    before = page.evaluate(size)
    page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
    assert page.evaluate(size) == [690, 960, 960]
    page.evaluate("window.dispatchEvent(new Event('afterprint'))")
    assert page.evaluate(size) == before
    assert before[0] > 690


def test_no_line_is_drawn_across_the_turn(page: Browser) -> None:
    drawn = page.evaluate("series.data.filter(t=>t.meta.channel.endsWith('_deg')).map(t=>t.y)")
    assert len(drawn) == 6  # four measured angles, the heading of two methods
    for line in drawn:
        values = np.array([np.nan if each is None else each for each in line], dtype=float)
        assert np.nanmax(np.abs(np.diff(values))) < 180.0


def test_pages_without_positions_with_holes_and_with_positions_only_still_read(
    opened: Browser, tmp_path: Path
) -> None:
    table = circling().drop(columns=["north_m", "east_m", "wind_speed_mps"])
    table.iloc[50, table.columns.get_loc("heading_deg")] = np.nan
    back = opened.evaluate("location.href")
    opened.open(interactive_page(table.drop(table.index[51:60])).write(tmp_path / "page.html"), READY)
    opened.evaluate("moveTo(50)")
    assert values_read(opened)["heading_deg"] == "–"
    assert values_read(opened)["surge_mps"] == f"{table['surge_mps'].iloc[50]:.3f}"
    opened.press("ArrowRight")
    assert second_of(opened) == 60.0  # over the hole, and not stuck before it
    assert opened.errors == []
    opened.open(interactive_page(circling()[["north_m", "east_m"]]).write(tmp_path / "track.html"), READY)
    opened.click(*opened.evaluate(f"{ON_TRACK}(90)"))
    assert values_read(opened)["north_m"] == "200.00"
    assert opened.errors == []
    opened.open(back, READY)
