"""The index: the same columns whatever failed, failures by cause, a page that sorts and filters in a browser."""

from __future__ import annotations

import json
import shutil
import subprocess
import time
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from websockets.sync.client import connect

from acquisition.channels import NAMES as CHANNELS
from acquisition.errors import StorageError
from analysis.season.index import failures_of, gone_rows, index_table, read_index, write_index
from analysis.season.index_page import index_page

Evaluate = Callable[[str], Any]


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
    failed("x", "is an empty file"),
    failed("y", "is an empty file"),
]


def test_failures_stand_together_by_cause_the_most_frequent_first() -> None:
    found = failures_of([*ROWS, failed("z", "is damaged near byte 77"), failed("w", "no <b>channel</b>")])
    assert found[0] == ("is an empty file", ["x", "y"])
    assert ("is damaged near byte 77", ["z"]) in found


def test_columns_have_their_kinds_whatever_failed() -> None:
    mixed, none, only = (index_table(rows) for rows in (ROWS, ROWS[-2:], ROWS[:1]))
    common = list(none.columns)
    for table in (mixed, only):
        assert [str(table[name].dtype) for name in common] == [str(none[name].dtype) for name in common]
    assert mixed["windows_kept"].isna().sum() == 2
    assert mixed["findings_by_code.spike"].iloc[8] == 0
    assert str(mixed["start"].dtype) == "datetime64[ns, UTC]"


def test_the_index_is_written_the_same_each_time_and_read_back(tmp_path: Path) -> None:
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
    first, second = (write_index(ROWS, tmp_path / name, "season") for name in ("a", "b"))
    assert first.read_bytes() == second.read_bytes()
    assert (tmp_path / "a/index.parquet").read_bytes() == (tmp_path / "b/index.parquet").read_bytes()
    assert list(read_index(tmp_path / "a" / "index.parquet")["name"]) == [each["name"] for each in ROWS]
    with pytest.raises(StorageError):
        write_index(ROWS, first, "season")


def test_what_recordings_call_themselves_is_text_and_no_markup() -> None:
    evil = "<script>alert(1)</script>\"'&"
    page = index_page([row(1, name=evil, vessel=evil), failed(evil, evil)], [(evil, [evil])], evil)
    assert "<script>alert" not in page
    assert 'href="%3Cscript%3Ealert%281%29%3C/script%3E%22%27%26/page.html"' in page


def test_what_was_cut_off_lacks_channels_or_is_gone_is_seen_in_its_row() -> None:
    rows = [
        row(1, closed=False, cause="was not closed"),
        row(2, missing=["heading_deg"]),
        row(3, missing=list(CHANNELS[:9])),
        row(4, status="gone", cause="its recording is not there any more"),
    ]
    page = index_page(rows, failures_of(rows), "season")
    seen = dict(zip((1, 2, 3, 4), page.split("<tbody>")[1].split("</tr>"), strict=False))
    assert "done, cut off" in seen[1]
    assert "without heading_deg" in seen[2]
    assert "without 9 of 13 channels" in seen[3]
    assert "recording gone" in seen[4]
    assert "<b>3</b>recordings" in page  # what is gone counts nowhere
    assert failures_of(rows) == []
    table = index_table(rows)
    assert list(table["closed"]) == [False, True, True, True]
    assert list(table["missing"])[:2] == ["", "heading_deg"]


def test_results_without_a_recording_are_told_from_other_peoples_files(tmp_path: Path) -> None:
    recorded = {"a/b": "a/b", "kept": "kept", "moved": "b"}
    summaries: dict[str, Any] = {name: {"provenance": {"recording": called}} for name, called in recorded.items()}
    for name, content in {**summaries, "theirs": [1], "other": {"x": 1}}.items():
        (tmp_path / name).mkdir(parents=True)
        (tmp_path / name / "summary.json").write_text(json.dumps(content))
    (tmp_path / "summary.json").write_text("{")
    assert [(each["name"], each["status"]) for each in gone_rows({"kept"}, tmp_path)] == [("a/b", "gone")]


def test_a_page_of_200_rows_is_small_and_needs_no_network() -> None:
    page = index_page([row(number) for number in range(200)], [], "season")
    assert len(page) < 600_000
    assert "http:" not in page
    assert "https:" not in page


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Evaluate]:
    """Evaluates JavaScript in the index's page, in a browser that has loaded it."""
    chromium = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if chromium is None:
        pytest.skip("no chromium to open the page with")
    folder = tmp_path_factory.mktemp("browser")
    page = write_index(ROWS, folder, "season")
    command = [chromium, "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
               f"--user-data-dir={folder / 'profile'}", "--remote-debugging-port=0", page.as_uri()]  # fmt: skip
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        try:
            with connect(_debugger(folder / "profile" / "DevToolsActivePort"), proxy=None) as socket:
                until = time.monotonic() + 30.0
                while not _evaluated(socket, LOADED) and time.monotonic() < until:
                    time.sleep(0.05)
                yield lambda expression: _evaluated(socket, expression)
        finally:
            process.terminate()


LOADED = "document.readyState === 'complete' && document.querySelector('th[data-key]') !== null"


def _debugger(told: Path, limit_s: float = 60.0) -> str:
    """The address at which the browser's page is spoken to, once it is there."""
    until = time.monotonic() + limit_s
    while time.monotonic() < until:
        if told.exists() and told.read_text().count("\n"):
            port = told.read_text().split()[0]
            with urllib.request.urlopen(f"http://127.0.0.1:{port}/json", timeout=10) as answer:
                pages = [each for each in json.load(answer) if each["type"] == "page"]
            if pages and "index.html" in pages[0]["url"]:
                return str(pages[0]["webSocketDebuggerUrl"])
        time.sleep(0.1)
    pytest.skip("the browser did not open the page in time")


def _evaluated(socket: Any, expression: str) -> Any:
    request = {"id": 1, "method": "Runtime.evaluate", "params": {"expression": expression, "returnByValue": True}}
    socket.send(json.dumps(request))
    answer = json.loads(socket.recv(timeout=30))
    assert "exceptionDetails" not in answer["result"], answer
    return answer["result"]["result"].get("value")


NAMES = "[...document.querySelectorAll('tbody tr:not([hidden]) td.name')].map(cell=>cell.dataset.v)"


def _press(key: str) -> str:
    return f"document.querySelector('th[data-key={key}] button').click();{NAMES}"


def test_a_click_on_a_header_sorts_and_another_turns_it_round(browser: Evaluate) -> None:
    by_duration = [each["name"] for each in sorted(ROWS[:9], key=lambda each: each["duration_s"])]
    assert browser(_press("duration_s")) == [*by_duration, "x", "y"]
    assert browser(_press("duration_s")) == [*reversed(by_duration), "x", "y"]
    assert browser("location.hash") == "#sort=duration_s&order=desc"
    assert browser(_press("name"))[:2] == ["day_1/trial_1", "day_1/trial_2"]


def test_failed_ones_come_first_by_status_and_bad_before_good(browser: Evaluate) -> None:
    assert set(browser(_press("status"))[:2]) == {"x", "y"}
    assert browser(_press("grade"))[0] == "day_1/trial_5"


def test_the_filter_shows_the_rows_that_have_all_its_words(browser: Evaluate) -> None:
    write = "const f=document.getElementById('filter');f.value=%s;f.dispatchEvent(new Event('input'));"
    shown = browser(f"(()=>{{{write % json.dumps('EMPTY file')}return {NAMES}}})()")
    assert set(shown) == {"x", "y"}
    assert browser("document.getElementById('shown').textContent") == "2 of 11 recordings"
    browser(f"(()=>{{{write % json.dumps('')}}})()")
    assert len(browser(NAMES)) == len(ROWS)


def test_links_lead_to_pages_and_thumbnails_are_drawn(browser: Evaluate) -> None:
    href = "document.querySelector('td.name a').getAttribute('href')"
    assert str(browser(href)).endswith("/page.html")
    assert browser("document.querySelectorAll('tbody svg polyline').length") == 9
