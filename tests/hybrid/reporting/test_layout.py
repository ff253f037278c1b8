"""A trial of five runs on paper: nothing is cut off, no sheet is half empty, twelve sheets at most."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from seatrial.acquisition.core.trial import Trial
from seatrial.acquisition.recording.writer import write_table
from seatrial.hybrid.report.folder import Choices, write_reports
from tests.benchmarks.yard_ship import YardShip
from tests.benchmarks.yard_trials import Recorder, record, sail

try:
    from weasyprint import HTML
except OSError:  # without the library Pango no sheet can be laid out
    HTML = None
pytestmark = pytest.mark.pages
SHIP = YardShip(200.0, 0.15, 1.0, 2.34, 0.3, 8.0)
RUNS = (
    ("turning_circle", -1.0), ("turning_circle", 1.0), ("zigzag_10_10", 1.0), ("zigzag_20_20", -1.0),
    ("stopping", 1.0),
)  # fmt: skip
STATED = """
[trial]
vessel = "MV Example with a long name of her own"
place = "Norwegian Sea"
loading = "full load"
[conditions]
length_m = 200.0
beam_m = 32.2
draught_m = 12.0
full_load_draught_m = 12.1
trim_m = 0.1
displacement_m3 = 62000.0
gm_m = 2.1
water_depth_m = 300.0
sea_state = 2
speed_at_85_percent_mcr_mps = 6.9
[particulars]
ship_type = "bulk carrier"
rudder_type = "semi-balanced spade"
rudder_area_m2 = 43.0
engine_type = "two-stroke diesel"
mcr_kw = 10320
mcr_rpm = 95
[instruments]
antenna_forward_m = -70.0
[instruments.accuracy]
heading_deg = 0.1
"""


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("yard")
    for number, (test, side) in enumerate(RUNS):
        sailed, _ = sail(SHIP, test, side)
        table = record(SHIP, sailed, Recorder(1.0, 0.3, 0.1, 0.05, 0.03, 0.1, (-70.0, 0.0), True), number)
        table.index = table.index + pd.Timedelta(hours=number)
        table = table.assign(wind_speed_mps=5.0, wind_direction_deg=140.0)
        trial = Trial(f"run {number + 1}", actuators=table.attrs["trial"]["actuators"])
        write_table(table, folder / f"run_{number + 1}_of_the_trial.mcap", trial)
    (folder / "conditions.toml").write_text(STATED)
    return write_reports(folder, Choices(interactive=False))[0]


def sheets(page: Path) -> list[Any]:
    if HTML is None:
        pytest.skip("no Pango to lay the page out with")
    return list(HTML(filename=str(page)).render().pages)


def boxes(sheet: Any) -> Iterator[Any]:
    """What stands on a sheet, below its margins' boxes."""
    return (
        box
        for box in sheet._page_box.children[0].descendants()
        if type(box).__name__ in ("TextBox", "InlineReplacedBox")
    )


def test_nothing_is_cut_off(page: Path) -> None:
    for number, sheet in enumerate(sheets(page), start=1):
        right = sheet._page_box.content_box_x() + sheet._page_box.width
        beyond = [box for box in boxes(sheet) if box.position_x + box.width > right + 1.0]
        assert not beyond, (number, [getattr(box, "text", "a picture") for box in beyond])


def test_few_sheets_and_none_half_empty(page: Path) -> None:
    laid_out = sheets(page)
    assert len(laid_out) <= 12
    for number, sheet in enumerate(laid_out[:-1], start=1):
        content = sheet._page_box
        lowest = max(box.position_y + box.height for box in boxes(sheet))
        assert lowest - content.content_box_y() > 0.5 * content.height, number


def test_numbers_are_written_as_people_do(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert "10,320 kW at 95 rpm" in text
    assert "(1/56 of LT)" in text
    assert not re.search(r"\de[+-]\d\d", re.sub(r"base64,[^\"]+", "", text))


def test_what_is_stated_beside_the_recordings_is_in_the_report(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    for words in (
        "MV Example with a long name of her own",
        "bulk carrier",
        "11.95 m, 12.05 m",
        "semi-balanced spade",
    ):
        assert words in text
    assert "8 of 13 criteria of IMO MSC.137(76) are shown and met" in text
    assert (page.parent / "criteria.json").is_file()


def test_conditions_of_the_standards_stand_beside_those_of_the_trial(page: Path) -> None:
    text = re.sub(r"<[^>]+>", " ", page.read_text(encoding="utf-8"))
    assert re.search(r"draught within 5 % of the full load draught\s+fulfilled", text)
    assert re.search(r"wind of force 5 at most\s+fulfilled", text)
