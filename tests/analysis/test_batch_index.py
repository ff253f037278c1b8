"""The index: the same columns whatever failed, failures by cause, a page that sorts and filters in a browser."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit
from urllib.request import url2pathname

import pytest

from seatrial.acquisition.core.errors import StorageError
from seatrial.acquisition.core.ship import NAMES as CHANNELS
from seatrial.analysis.batch import (
    failures_by_cause,
    read_index,
    rows_without_recording,
    table_of_recordings,
    write_index,
)
from seatrial.analysis.report.pages import index_page
from tests.browser import Browser, running_browser


def row(number: int, **changed: Any) -> dict[str, Any]:
    """The row of a recording that was done."""
    return {
        "name": f"day_1/trial_{number}", "path": f"day_1/trial_{number}.mcap", "status": "done", "cause": "",
        "vessel": "gunnerus_short", "trial": f"trial {number}", "place": "Trondheim", "grade": "good",
        "start": f"2022-10-27T{8 + number % 12:02d}:00:00+00:00", "duration_s": 60.0 * (number * 7 % 10) + 5.0,
        "distance_m": 1852.0 * number, "samples": 1000 + number, "channels": 13, "missing": [],
        "closed": True, "findings": number % 3,
        "findings_by_code": {"spike": number % 3} if number % 3 else {}, "repairs": 0, "windows_kept": number,
        "windows_candidates": 100, "windows_dropped": {}, "legs": 1, "manoeuvres": {"zigzag": 2}, "indices": {},
        "track": "4,4 50,60 96,30", "provenance": {"bytes": 9, "sha256": "ab", "options": {}, "software": {}},
        **changed,
    }  # fmt: skip


def failed(name: str, cause: str) -> dict[str, Any]:
    return {"name": name, "path": f"{name}.mcap", "status": "failed", "cause": cause}


ROWS = [
    *(row(number, grade="bad" if number == 5 else "good") for number in range(1, 10)),
    failed("x", "is empty"),
    failed("y", "is empty"),
]


def test_failures_stand_together_by_cause_the_most_frequent_first() -> None:
    found = failures_by_cause([*ROWS, failed("z", "is damaged near byte 77"), failed("w", "no <b>channel</b>")])
    assert found[0] == ("is empty", ["x", "y"])
    assert ("is damaged near byte 77", ["z"]) in found


def test_columns_have_their_kinds_whatever_failed() -> None:
    mixed, none, only = (table_of_recordings(rows) for rows in (ROWS, ROWS[-2:], ROWS[:1]))
    common = list(none.columns)
    for table in (mixed, only):
        assert [str(table[name].dtype) for name in common] == [str(none[name].dtype) for name in common]
    assert mixed["windows_kept"].isna().sum() == 2
    assert mixed["findings_by_code.spike"].iloc[8] == 0
    assert str(mixed["start"].dtype) == "datetime64[ns, UTC]"


def test_the_index_is_written_the_same_each_time_and_read_back(tmp_path: Path) -> None:
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
    first, second = (write_index(ROWS, tmp_path / name, "batch") for name in ("a", "b"))
    assert first.read_bytes() == second.read_bytes()
    assert (tmp_path / "a/index.parquet").read_bytes() == (tmp_path / "b/index.parquet").read_bytes()
    assert list(read_index(tmp_path / "a" / "index.parquet")["name"]) == [each["name"] for each in ROWS]
    with pytest.raises(StorageError):
        write_index(ROWS, first, "batch")


def test_what_recordings_call_themselves_is_text_and_no_markup() -> None:
    evil = "<script>alert(1)</script>\"'&"
    page = index_page([row(1, name=evil, vessel=evil), failed(evil, evil)], [(evil, [evil])], evil).html
    assert "<script>alert" not in page
    assert 'href="%3Cscript%3Ealert%281%29%3C/script%3E%22%27%26/page.html"' in page


def test_a_recording_leads_to_its_report_where_there_is_one_and_tells_its_speed_at_power() -> None:
    """One way to a recording: the report; its page stays within reach as its data."""
    speed = {"speed_power_kw": 8931.0, "speed_power_mps": 8.43}
    with_report, without = (
        index_page([each], [], "batch").html for each in (row(1, report=True, indices=speed), row(1))
    )
    assert re.findall(r'href="(day_1/trial_1/[a-z.]+)"', with_report) == [
        "day_1/trial_1/report.html", "day_1/trial_1/page.html",
    ]  # fmt: skip
    assert re.findall(r'href="(day_1/trial_1/[a-z.]+)"', without) == ["day_1/trial_1/page.html"]
    assert "16.39 kn at 8,931 kW" in with_report
    assert " kn at " not in without


def test_the_page_has_its_look() -> None:
    """The colours are the first rule of the style; a stray character before it would lose them all."""
    assert re.search(r"<style>\s*:root\{--ink:", index_page(ROWS, [], "season").html)


def test_what_was_cut_off_lacks_channels_or_is_gone_is_seen_in_its_row() -> None:
    rows = [
        row(1, closed=False, cause="was not closed"),
        row(2, missing=["heading_deg"]),
        row(3, missing=list(CHANNELS[:9]), channels=4),
        row(4, status="gone", cause="its recording is not there any more"),
    ]
    page = index_page(rows, failures_by_cause(rows), "batch").html
    seen = dict(zip((1, 2, 3, 4), page.split("<tbody>")[1].split("</tr>"), strict=False))
    assert "done, cut off" in seen[1]
    assert "without heading_deg" in seen[2]
    assert "without 9 of 13 channels" in seen[3]
    assert "recording gone" in seen[4]
    assert "<b>3</b>recordings" in page  # what is gone counts nowhere
    assert failures_by_cause(rows) == []
    table = table_of_recordings(rows)
    assert list(table["closed"]) == [False, True, True, True]
    assert list(table["missing"])[:2] == ["", "heading_deg"]


def test_results_without_a_recording_are_told_from_other_peoples_files(tmp_path: Path) -> None:
    recorded = {"a/b": "a/b", "kept": "kept", "moved": "b"}
    summaries: dict[str, Any] = {name: {"provenance": {"recording": called}} for name, called in recorded.items()}
    for name, content in {**summaries, "theirs": [1], "other": {"x": 1}}.items():
        (tmp_path / name).mkdir(parents=True)
        (tmp_path / name / "summary.json").write_text(json.dumps(content))
    (tmp_path / "summary.json").write_text("{")
    assert [(each["name"], each["status"]) for each in rows_without_recording({"kept"}, tmp_path)] == [
        ("a/b", "gone")
    ]


def test_a_page_of_200_rows_is_small_and_needs_no_network() -> None:
    page = index_page([row(number) for number in range(200)], [], "batch").html
    assert len(page) < 600_000
    assert "http:" not in page
    assert "https:" not in page


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    """A browser that has loaded the index's page; recordings that were done have a page to go to."""
    folder = tmp_path_factory.mktemp("batch")
    for each in ROWS[:9]:
        page = folder / each["name"] / "page.html"
        page.parent.mkdir(parents=True)
        page.write_text(f"<title>{each['name']}</title>")
    with running_browser() as opened:
        opened.open(write_index(ROWS, folder, "batch"), LOADED)
        yield opened


LOADED = "document.querySelector('th[data-key]') !== null"

NAMES = "[...document.querySelectorAll('tbody tr:not([hidden]) td.name')].map(cell=>cell.dataset.v)"


def _pressed(browser: Browser, key: str) -> list[str]:
    """The names in the order that a real click on a header gives."""
    browser.click_on(f"th[data-key={key}] button")
    return list(browser.evaluate(NAMES))


def test_a_click_on_a_header_sorts_and_another_turns_it_round(browser: Browser) -> None:
    by_duration = [each["name"] for each in sorted(ROWS[:9], key=lambda each: each["duration_s"])]
    assert _pressed(browser, "duration_s") == [*by_duration, "x", "y"]
    assert _pressed(browser, "duration_s") == [*reversed(by_duration), "x", "y"]
    assert browser.evaluate("location.hash") == "#sort=duration_s&order=desc"
    assert _pressed(browser, "name")[:2] == ["day_1/trial_1", "day_1/trial_2"]


def test_failed_ones_come_first_by_status_and_bad_before_good(browser: Browser) -> None:
    assert set(_pressed(browser, "status")[:2]) == {"x", "y"}
    assert _pressed(browser, "grade")[0] == "day_1/trial_5"


def test_the_filter_shows_the_rows_that_have_all_its_words(browser: Browser) -> None:
    write = "const f=document.getElementById('filter');f.value=%s;f.dispatchEvent(new Event('input'));"
    shown = browser.evaluate(f"(()=>{{{write % json.dumps('EMPTY is')}return {NAMES}}})()")
    assert set(shown) == {"x", "y"}
    assert browser.evaluate("document.getElementById('shown').textContent") == "2 of 11 recordings"
    browser.evaluate(f"(()=>{{{write % json.dumps('')}}})()")
    assert len(browser.evaluate(NAMES)) == len(ROWS)


def test_links_lead_to_pages_that_are_there_and_thumbnails_are_drawn(browser: Browser) -> None:
    links = browser.evaluate("[...document.querySelectorAll('td.name a')].map(link=>link.href)")
    assert len(links) == 9
    assert all(Path(url2pathname(urlsplit(link).path)).is_file() for link in links)
    assert browser.evaluate("document.querySelectorAll('tbody svg polyline').length") == 9


def test_a_click_on_a_name_opens_its_page_without_any_network(browser: Browser) -> None:
    index = browser.evaluate("location.href")
    name = browser.evaluate(NAMES)[0]
    browser.click_on("td.name a")
    browser.wait_for(f"document.title === {json.dumps(name)}")
    assert all(each.startswith("file:") for each in browser.requests)
    assert browser.errors == []
    browser.open(index, LOADED)
