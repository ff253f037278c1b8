"""A season as pages: what is listed and shown, who is refused, what a file that is sent comes to."""

from __future__ import annotations

import io
import json
import shutil
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from queue import Queue
from threading import Lock, Thread
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from flask.testing import FlaskClient
from openpyxl import load_workbook
from werkzeug.test import TestResponse

from seatrial.acquisition.core.errors import InputError, SeatrialError, SourceError, StorageError, unexpected_error
from seatrial.acquisition.core.trial import Trial
from seatrial.acquisition.recording.reader import read_recording
from seatrial.acquisition.recording.writer import write_table
from seatrial.analysis.batch import SUMMARY, WAITING, BatchJob, Row
from seatrial.analysis.serve import MOST_RUNS, Season, _Worker, make_app, serve
from tests.acquisition.conftest import PATIENCE_S
from tests.analysis.small_batch import QUICK, sailed
from tests.browser import running_browser

EVIL = "<script>alert('evil')</script>"
HERE = {"Host": "127.0.0.1:8765"}
PARTS = ["parts_20260517T120000Z.mcap", "parts_20260517T120000Z_part00002.mcap"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two zigzags of two ships, a recording in two parts, one with an evil name, and a broken one."""
    from seatrial.hybrid.simulation.trial import simulate_trial

    made = tmp_path_factory.mktemp("season")
    for vessel in ("gunnerus_short", "gunnerus_long"):
        table, _ = simulate_trial(vessel, "calm", "zigzag_20_20", 150.0, 2.0, 1)
        trial = Trial(name="zigzag", vessel=vessel, origin_latitude_deg=63.4, origin_longitude_deg=10.4)
        write_table(table, made / "day" / f"{vessel}.mcap", trial)
    for name, rows in zip(PARTS, (slice(0, 100), slice(100, 240)), strict=True):
        write_table(sailed().iloc[rows], made / name, Trial(name="parts", vessel="gunnerus_short"))
    write_table(sailed(60), made / "evil.mcap", Trial(name=EVIL, vessel=EVIL, place=EVIL, crew_notes=EVIL))
    (made / "broken.mcap").write_bytes(b"no recording")
    return made


class OneWorker(_Worker):
    """A worker that outlives the seasons it works for: what it imports takes longer than all that it does here."""

    def __init__(self) -> None:
        super().__init__()
        self._turn = Lock()

    def row_of(self, work: Callable[[BatchJob], Row], job: BatchJob) -> Row | None:
        with self._turn:
            return super().row_of(work, job)

    def stop(self) -> None:
        """Not yet."""


@pytest.fixture(scope="module", autouse=True)
def one_worker() -> Iterator[None]:
    """One process for all seasons here, and another after the test in which it dies."""
    shared = OneWorker()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("seatrial.analysis.serve._Worker", lambda: shared)
        yield
    _Worker.stop(shared)


@pytest.fixture(scope="module")
def season(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Season]:
    """All of it analysed."""
    with Season(folder, tmp_path_factory.mktemp("results"), QUICK, settled_s=0.0) as made:
        wait_for(lambda: not any(row["status"] == WAITING for row in made.rows()))
        yield made


def wait_for(condition: Callable[[], bool]) -> None:
    until_s = time.monotonic() + 4 * PATIENCE_S
    while not condition():
        assert time.monotonic() < until_s
        time.sleep(0.2)  # what is asked reads a folder


@pytest.fixture
def client(season: Season) -> FlaskClient:
    return make_app(season).test_client()


def get(client: FlaskClient, address: str, **headers: str) -> TestResponse:
    return client.get(address, headers=HERE | headers)


def by_name(season: Season) -> dict[str, dict[str, Any]]:
    return {row["name"]: row for row in season.rows()}


def test_every_recording_is_a_row_and_a_broken_one_says_why(season: Season) -> None:
    rows = by_name(season)
    assert set(rows) == {"broken", "day/gunnerus_long", "day/gunnerus_short", "evil", "parts_20260517T120000Z"}
    assert rows["broken"]["status"] == "failed"
    assert "not an MCAP" in rows["broken"]["cause"]
    assert rows["day/gunnerus_long"]["manoeuvres"] == {"zigzag": 1}
    assert (rows["parts_20260517T120000Z"]["parts"], rows["parts_20260517T120000Z"]["samples"]) == (2, 13 * 240)
    assert all(row["track"].count(",") > 10 for name, row in rows.items() if name != "broken")


def test_a_row_is_that_of_a_batch(season: Season, folder: Path) -> None:
    summary = json.loads((season.out / "day" / "gunnerus_long" / SUMMARY).read_text())
    row = by_name(season)["day/gunnerus_long"]
    assert {name: row[name] for name in summary} == summary


def test_what_files_say_is_text(client: FlaskClient) -> None:
    for address in ("/", "/evil/page.html"):
        page = get(client, address)
        assert "&lt;script&gt;alert" in page.text
        assert EVIL not in page.text
        policy = page.headers["Content-Security-Policy"]
        assert "default-src 'none'" in policy
        assert "unsafe-inline' 'nonce" not in policy.replace("style-src", "")
    scripts = get(client, "/").text.count("<script")
    assert scripts == get(client, "/").text.count('<script nonce="') == 1


@pytest.mark.parametrize("host", ["evil.example", "evil.example:8765", "127.0.0.1.evil.example", ""])
def test_another_name_of_this_computer_is_refused(client: FlaskClient, host: str) -> None:
    assert get(client, "/", Host=host).status_code == 400


@pytest.mark.parametrize(
    "address",
    [
        "/nobody/page.html", "/../../etc/passwd", "/%2e%2e/%2e%2e/etc/passwd", "/../season/broken/page.html/",
        "/day/page.html", "/evil/export.py", "/evil/diagnosis.html", "/evil/report.html", "/.season.sqlite",
        "/day%2Fgunnerus_long/../../../../etc/passwd/page.html", "/upload",
    ],
)  # fmt: skip
def test_what_is_no_recording_is_not_there(client: FlaskClient, address: str) -> None:
    assert get(client, address).status_code in (404, 405)


def test_it_is_read_only_unless_told(client: FlaskClient) -> None:
    assert client.post("/upload", headers=HERE).status_code == 404
    assert 'type="file"' not in get(client, "/").text


def test_a_trial_is_its_page_with_ways_on(client: FlaskClient) -> None:
    page = get(client, "/day/gunnerus_long/page.html").text
    for said in ("Data quality", "20/20", "overshoot 1", 'href="export.kml"', "kind=zigzag", 'href="/"'):
        assert said.lower() in page.lower(), said
    assert "not an MCAP" in get(client, "/broken/page.html").text


@pytest.fixture
def in_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Files are read here: imports are paid once. A file that ends its process has tests of its own."""

    def called(function: Callable[..., list[str]], *arguments: object) -> list[str]:
        try:
            return list(function(*arguments))
        except Exception as error:
            raise SeatrialError(str(unexpected_error(error))) from error

    monkeypatch.setattr("seatrial.analysis.serve.call_in_limited_process", called)


def test_exports_are_those_of_the_command(client: FlaskClient, request: pytest.FixtureRequest) -> None:
    kml = get(client, "/day/gunnerus_long/export.kml")  # from a process of its own, as aboard
    request.getfixturevalue("in_this_process")
    assert kml.headers["Content-Disposition"].endswith("gunnerus_long.kml")
    drawn = ElementTree.fromstring(kml.data).find(".//{http://www.opengis.net/kml/2.2}coordinates")
    assert drawn is not None
    first = (drawn.text or "").split()[0].split(",")
    assert np.hypot(float(first[0]) - 10.4, float(first[1]) - 63.4) < 0.05
    book = load_workbook(io.BytesIO(get(client, "/day/gunnerus_long/export.xlsx").data))
    assert book["data"].max_row == 151
    refused = get(client, "/evil/export.gpx")  # of no origin
    assert refused.status_code == 422
    assert "no origin" in refused.text


def test_runs_of_a_kind_lie_over_each_other(client: FlaskClient) -> None:
    page = get(client, "/runs.html?kind=zigzag").text
    assert page.count("<img") == 1
    assert page.count("zigzag 20/20") >= 2
    one = get(client, "/runs.html?kind=zigzag&name=day/gunnerus_long&name=nobody").text
    assert "gunnerus_short" not in one
    assert "None of these" in get(client, "/runs.html?kind=pull_out").text
    rows = list(load_workbook(io.BytesIO(get(client, "/runs.xlsx?kind=zigzag").data))["indices"].values)
    assert {row[0] for row in rows[1:]} == {"day/gunnerus_long", "day/gunnerus_short"}
    assert MOST_RUNS >= 40


def test_what_was_made_is_there_at_once_and_what_has_changed_is_made_again(
    season: Season, folder: Path, tmp_path: Path
) -> None:
    shutil.copytree(folder, tmp_path / "season")
    shutil.copytree(season.out, tmp_path / "results")
    for name in ("first", "second"):
        with Season(tmp_path / "season", tmp_path / "results", QUICK, eager=False) as again:
            if name == "first":  # copies have other times: the same results by their hashes
                for each in by_name(again):
                    again.ask(each)
                wait_for(lambda: not any(row["status"] == WAITING for row in again.rows()))
            rows = by_name(again)
        assert rows == by_name(season)
    made = (tmp_path / "results" / "evil" / "page.html").stat().st_mtime_ns
    assert made == (season.out / "evil" / "page.html").stat().st_mtime_ns
    write_table(sailed(90), tmp_path / "season" / "evil.mcap", Trial(name="another"))
    with Season(tmp_path / "season", tmp_path / "results", QUICK, eager=False) as changed:
        assert by_name(changed)["evil"]["status"] == WAITING
        wait_for(lambda: by_name(changed)["evil"].get("trial") == "another")
        assert by_name(changed)["parts_20260517T120000Z"]["status"] == "done"


def test_a_diagnosis_stands_with_the_recordings_it_is_of(season: Season, folder: Path, client: FlaskClient) -> None:
    said = {
        "verdict": "named",
        "provenance": {"recordings_sha256": by_name(season)["evil"]["provenance"]["sha256"]},
    }
    (folder / "diagnosed").mkdir()
    (folder / "diagnosed" / "diagnosis.json").write_text(json.dumps(said))
    (folder / "diagnosed" / "report.html").write_text("What the model lacks")
    (folder / "day" / "diagnosis.json").write_text("[]")  # somebody else's file of that name
    assert {name for name, row in by_name(season).items() if row["verdict"]} == {"evil"}
    assert get(client, "/evil/diagnosis.html").text == "What the model lacks"
    assert "diagnosis.html" in get(client, "/evil/page.html").text
    assert 'data-verdict="named"' in get(client, "/").text


def test_a_worker_that_dies_is_one_failed_row(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with Season(folder, tmp_path, QUICK, eager=False) as mortal:
        wait_for(lambda: by_name(mortal)["evil"].get("samples") is not None)
        monkeypatch.setattr("seatrial.analysis.batch.reuse_or_process", dies)
        mortal.ask("evil")
        wait_for(lambda: by_name(mortal)["evil"]["status"] == "failed")
        assert "its worker died" in by_name(mortal)["evil"]["cause"]
        monkeypatch.undo()
        mortal.ask("day/gunnerus_long")
        wait_for(lambda: by_name(mortal)["day/gunnerus_long"]["status"] == "done")


def dies(job: Any) -> Any:
    import os

    os._exit(1)


def test_wrong_folders_and_a_port_in_use_are_one_error(folder: Path, tmp_path: Path, season: Season) -> None:
    with pytest.raises(InputError, match="does not exist"), Season(tmp_path / "nowhere", tmp_path / "out"):
        pass
    with pytest.raises(InputError, match="are in the folder of the results"):
        Season(folder, folder)
    (tmp_path / ".season.sqlite").write_text("no database")
    with pytest.raises(StorageError, match=r"cannot be used.*remove it"), Season(folder, tmp_path):
        pass
    app, found = make_app(season), Queue[str]()
    Thread(target=serve, args=(app, 0, found.put), daemon=True).start()
    port = int(found.get(timeout=PATIENCE_S).rstrip("/").rpartition(":")[2])
    with pytest.raises(SourceError, match=r"Address already in use.*--port"):
        serve(app, port, found.put)


class Sender:
    """A browser that may send files, with the token of the page."""

    def __init__(self, season: Season) -> None:
        self.client = make_app(season, upload_mb=0.3).test_client()
        page = get(self.client, "/").text
        self.token = page.partition('name="token" value="')[2].partition('"')[0]

    def send(self, name: str, content: bytes, token: str | None = None, **headers: str) -> TestResponse:
        form = {"token": self.token if token is None else token, "file": (io.BytesIO(content), name)}
        return self.client.post("/upload", data=form, headers=HERE | headers)


@pytest.fixture
def sender(tmp_path: Path) -> Iterator[tuple[Sender, Path]]:
    (tmp_path / "season").mkdir()
    with Season(tmp_path / "season", tmp_path / "results", QUICK, eager=False) as empty:
        yield Sender(empty), tmp_path / "season"


def table_text(seconds: int = 60) -> bytes:
    table = sailed(seconds, 1.0)
    return table.set_axis(table.index.strftime("%Y-%m-%dT%H:%M:%SZ"), axis=0).to_csv(index_label="time").encode()


def test_a_table_that_is_sent_becomes_a_recording(sender: tuple[Sender, Path]) -> None:
    sending, folder = sender
    sent = sending.send("../../a trial <b>.csv", table_text(), Origin="http://127.0.0.1:8765")
    assert sent.status_code == 200, sent.text
    assert [path.name for path in folder.iterdir()] == ["a_trial_b.mcap"]
    assert len(read_recording(folder / "a_trial_b.mcap").series) == 13
    again = sending.send("a trial b.csv", table_text(30))
    assert again.status_code == 422
    assert "already exists" in again.text
    assert read_recording(folder / "a_trial_b.mcap").series["north_m"].value.size == 60
    copied = sending.send("copy.mcap", (folder / "a_trial_b.mcap").read_bytes())
    assert copied.status_code == 200
    assert (folder / "copy.mcap").read_bytes() == (folder / "a_trial_b.mcap").read_bytes()


@pytest.mark.usefixtures("in_this_process")
def test_what_is_refused_leaves_nothing_and_says_why(sender: tuple[Sender, Path]) -> None:
    sending, folder = sender
    refused = {
        "junk.mcap": (b"junk", "not an MCAP"), "junk.csv": (b"\0\1", "junk.csv"),
        "program.py": (b"print()", "unknown file type"), "...": (b"x", "invalid file name"),
    }  # fmt: skip
    for name, (content, why) in refused.items():
        answer = sending.send(name, content)
        assert (answer.status_code, why in answer.text) == (422, True), answer.text
        assert "/tmp" not in answer.text
    assert sending.send("large.csv", b"x" * 400_000).status_code == 413
    for wrong in ("", "wrong", "\u00e9"):
        assert sending.send("a.csv", table_text(), token=wrong).status_code == 403
    assert sending.send("a.csv", table_text(), Origin="http://evil.example").status_code == 403
    assert sending.send("a.csv", table_text(), Host="evil.example").status_code == 400
    assert list(folder.iterdir()) == []


@pytest.mark.pages
def test_in_a_browser(folder: Path, season: Season, tmp_path: Path) -> None:
    """List, filter, a trial and back, runs over each other, a file sent: by mouse, without a word of complaint."""
    shutil.copytree(folder, tmp_path / "season")
    shutil.copytree(season.out, tmp_path / "results")
    (tmp_path / "sent.csv").write_bytes(table_text())
    with (
        Season(tmp_path / "season", tmp_path / "results", QUICK, settled_s=0.0) as shown,
        running_browser() as browser,
    ):
        found = Queue[str]()
        Thread(target=serve, args=(make_app(shown, 1.0), 0, found.put), daemon=True).start()
        address = found.get(timeout=PATIENCE_S)
        wait_for(lambda: not any(row["status"] == WAITING for row in shown.rows()))
        visible = "[...document.querySelectorAll('tbody tr')].filter(r=>!r.hidden).map(r=>r.dataset.name).join()"
        browser.open(address, f"{visible}.split(',').length === 5")
        assert browser.evaluate("document.querySelectorAll('tbody polyline').length") == 4
        browser.choose("select[name=ship]", "gunnerus_short")
        assert browser.evaluate(visible) == "day/gunnerus_short,parts_20260517T120000Z"
        browser.choose("select[name=kind]", "zigzag")
        assert browser.evaluate(visible) == "day/gunnerus_short"
        browser.choose("select[name=ship]", "")
        browser.click_on("#together")
        browser.wait_for("document.title.includes('zigzag') && document.images[0].naturalWidth > 300")
        assert browser.evaluate("document.querySelectorAll('table tr').length") == 3
        browser.click_on("a[href='/']")
        browser.wait_for("document.getElementById('shown')")
        browser.click_on("tbody a[href='day/gunnerus_long/page.html']")
        browser.wait_for("document.body.textContent.includes('Data quality')")
        browser.click_on("a[href='/']")
        browser.wait_for("document.querySelector('input[type=file]')")
        browser.give_file("input[type=file]", tmp_path / "sent.csv")
        browser.click_on("form button")
        browser.wait_for("document.title.includes('sent.mcap is in the season')")
        browser.click_on("a[href='/']")
        browser.wait_for(f"{visible}.includes('sent')")
        assert browser.errors == []
        assert all(each.startswith((address, "data:")) for each in browser.requests)
