"""Seasons: whatever lies in a folder of recordings, all of it has a row, and none of it ends the rest."""

from __future__ import annotations

import json
import os
import re
import shutil
import socket
import time
import unicodedata
from collections.abc import Callable, Iterator, Sequence
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import quote

import numpy as np
import pandas as pd
import pytest
from flask.testing import FlaskClient

from seatrial.acquisition.core.ship import NAMES as CHANNELS
from seatrial.acquisition.core.trial import Trial
from seatrial.acquisition.recording.writer import write_table
from seatrial.analysis import serve
from seatrial.analysis.batch import (
    MARKS,
    WAITING,
    BatchJob,
    BatchSummary,
    Row,
    process_job,
    read_index,
    recordings_below,
    result_names,
    row_before_analysis,
    run_batch,
    run_job_or_fail,
)
from seatrial.analysis.products import Options
from seatrial.analysis.serve import Season, make_app
from tests.acquisition.conftest import PATIENCE_S
from tests.analysis.small_batch import QUICK, sailed
from tests.analysis.test_serve import HERE, wait_for
from tests.attacks.commands import run_seatrial
from tests.attacks.other_user import as_nobody, open_folder

NAMES = {
    "not UTF-8": b"\xff\xfe\xf0",
    "not UTF-8, as written with escapes": rb"\xff\xfe\xf0",
    "folder not UTF-8": b"day\xe9/one",
    "line feed": b"a\nb",
    "tab": b"a\tb",
    "escape sequence": b"a\x1b[2J\x1b]0;owned\x07b",
    "percent": b"a%2e%2e%2fb%",
    "hash": b"a#b",
    "question": b"a?b=1",
    "quotes": b"a\"'b",
    "script": b"<script>alert(1)<",
    "attribute": b'" onmouseover="alert(1)',
    "template": b"{{ 7*7 }}{% raw %}",
    "dash": b"--help",
    "inner dots": b"a..b...",
    "backslash": b"a\\b",
    "space": b" a  b ",
    "semicolon": b"a; rm -rf b & $(c) `d`",
    "right to left": "a\u202egnp.b".encode(),
    "composed": unicodedata.normalize("NFC", "Tromsø é").encode(),
    "decomposed": unicodedata.normalize("NFD", "Tromsø é").encode(),
    "upper case": b"TWIN",
    "lower case": b"twin",
    "longest": b"l" * 250,
    "longest, not UTF-8": b"\xfe" * 250,
    "longest folder": b"f" * 255 + b"/" + b"g" * 250,
    "reserved": b"index.html",
    "reserved file of a result": b"a/page.html",
    "result of another in it": b"a",
    "suffix twice": b"a.mcap",
    "nothing but combining marks": "\u0301\u0302".encode(),
    "zero width": "a\u200b\ufeffb".encode(),
    "hidden folder": b".part-x/a",
}

POSE_AND_THRUSTER = ("north_m", "east_m", "heading_deg", "port_rpm", "port_angle_deg")


def _unopened(path: Path) -> None:
    os.mkfifo(path)


def _socket(path: Path) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as server:
        server.bind(str(path))


STRANGE = {
    "fifo": (_unopened, "is not a file"),
    "socket": (_socket, "is not a file"),
    "device": (lambda path: path.symlink_to("/dev/zero"), "is not a file"),
    "folder": (lambda path: path.mkdir(), "is a folder"),
    "link to itself": (lambda path: path.symlink_to(path), "cannot be opened"),
    "link to nothing": (lambda path: path.symlink_to("nothing"), "a link to nothing"),
    "link to the folder above": (lambda path: path.symlink_to(".."), "is a folder"),
    "link to a secret": (lambda path: path.symlink_to("/etc/passwd"), "not an MCAP"),
    "empty": (lambda path: path.write_bytes(b""), "is empty"),
    "zeros": (lambda path: path.write_bytes(bytes(100_000)), "not an MCAP"),
}
"""What may be called like a recording and is none: how it is made, and why it fails."""


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("sound") / "sound.mcap"
    write_table(sailed(10), path, Trial(name="trial", vessel="gunnerus_short"))
    return path


@pytest.fixture(scope="module")
def folder(sound: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A season of hostile names and things, in a folder and of a place with names that are not UTF-8 themselves."""
    made = tmp_path_factory.mktemp("hostile") / os.fsdecode(b"season \xff")
    for name in NAMES.values():
        path = made / os.fsdecode(name + b".mcap")
        path.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(sound, path)
    for kind, (make, _) in STRANGE.items():
        make(made / f"{kind}.mcap")
    return made


def batch_here(folder: Path, out: Path) -> BatchSummary:
    """A batch without worker processes, which take longer to start than all that they do here."""

    def run_here(jobs: Sequence[BatchJob], *_: object) -> list[Row]:
        return [process_job(job) for job in jobs]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("seatrial.analysis.batch.run_jobs", run_here)
        return run_batch(folder, out, options=QUICK)


@pytest.fixture(scope="module")
def summary(folder: Path) -> BatchSummary:
    return batch_here(folder, folder.parent / os.fsdecode(b"out \xff"))


@pytest.fixture(scope="module")
def client(folder: Path, summary: BatchSummary) -> Iterator[FlaskClient]:
    """The same season as pages, with the results that the batch made."""
    with Season(folder, summary.index.parent, QUICK, settled_s=0.0) as pages:
        wait_for(lambda: not any(row["status"] == WAITING for row in pages.rows()))
        yield make_app(pages).test_client()


class _Page(HTMLParser):
    """Tags, attributes and addresses of a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.handlers: list[str] = []
        self.addresses: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.handlers += [name for name, _ in attributes if name.startswith("on")]
        self.addresses += [value or "" for name, value in attributes if name in ("href", "src", "action")]


def row_of(summary: BatchSummary, path: bytes) -> dict[str, object]:
    """The row whose recording is the file of that name, by how names are shown."""
    (name,) = result_names(Path(), [[Path(os.fsdecode(path) + ".mcap")]])
    twins = [row for row in summary.rows if row["name"].rstrip("_") == name.rstrip("_")]
    assert twins, sorted(row["name"] for row in summary.rows)
    return twins[0]


def test_every_file_has_a_row_of_its_own(summary: BatchSummary) -> None:
    names = [row["name"] for row in summary.rows]
    assert len(names) == len(NAMES) + len(STRANGE)
    assert len({unicodedata.normalize("NFC", name).casefold() for name in names}) == len(names)


@pytest.mark.parametrize("name", NAMES.values(), ids=NAMES.keys())
def test_recording_of_any_name_is_analysed(name: bytes, summary: BatchSummary) -> None:
    row = row_of(summary, name)
    assert row["status"] == "done", row["cause"]
    assert (summary.index.parent / str(row["name"]) / "page.html").is_file()


@pytest.mark.parametrize("name", STRANGE)
def test_what_is_no_recording_fails_with_its_reason(name: str, summary: BatchSummary) -> None:
    row = row_of(summary, name.encode())
    assert row["status"] == "failed"
    assert STRANGE[name][1] in str(row["cause"])


def test_index_shows_names_with_escapes_and_runs_nothing(summary: BatchSummary) -> None:
    text = summary.index.read_text(encoding="utf-8")
    page = _Page(text)
    assert page.tags.count("script") == 1
    assert not page.handlers
    assert not re.search("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e]", text)
    links = {address for address in page.addresses if address.endswith("page.html")}
    assert len(links) == len(NAMES)
    table = read_index(summary.index.with_suffix(".parquet"))
    assert isinstance(table, pd.DataFrame)
    assert len(table) == len(summary.rows)


def test_no_result_lies_outside_the_output_folder(summary: BatchSummary, folder: Path) -> None:
    assert {path.name for path in folder.parent.iterdir()} == {folder.name, summary.index.parent.name}


def test_every_link_of_the_season_leads_to_its_page(client: FlaskClient) -> None:
    index = _Page(client.get("/", headers=HERE).text)
    links = [address for address in index.addresses if address.endswith("page.html")]
    assert len(set(links)) == len(NAMES)
    for link in links:
        answer = client.get(f"/{link}", headers=HERE)
        assert answer.status_code == 200, link
        assert not _Page(answer.text).handlers


@pytest.mark.attack
@pytest.mark.parametrize("name", ["not UTF-8", "line feed", "script", "longest, not UTF-8"])
def test_recording_of_any_name_is_exported(name: str, summary: BatchSummary, client: FlaskClient) -> None:
    answer = client.get(f"/{quote(str(row_of(summary, NAMES[name])['name']))}/export.csv", headers=HERE)
    assert answer.status_code == 200
    assert b"heading_deg" in answer.data


def test_second_batch_finds_all_results_again(summary: BatchSummary, folder: Path) -> None:
    again = batch_here(folder, summary.index.parent)
    assert (again.done, again.reused, again.gone) == (len(NAMES), len(NAMES), ())


@pytest.mark.parametrize("depth", [1, 2])
def test_folder_that_cannot_be_looked_into_is_a_failure_and_no_silence(depth: int) -> None:
    with open_folder() as place:
        closed = place.joinpath(*["below"] * depth)
        closed.mkdir(parents=True)
        (closed / "a.mcap").touch()
        (place / MARKS).mkdir()
        (place / MARKS).chmod(0o777)
        closed.chmod(0)

        def look() -> None:
            (paths,) = recordings_below(place, place / "out")
            row = process_job(BatchJob("below", str(paths[0]), str(place), QUICK))
            (place / "cause").write_text(row["cause"])

        as_nobody(look)
        closed.chmod(0o700)
        assert "Permission denied" in (place / "cause").read_text()


def test_file_that_vanishes_before_its_turn_fails_alone(tmp_path: Path) -> None:
    (tmp_path / MARKS).mkdir()
    row = process_job(BatchJob("a", str(tmp_path / "a.mcap"), str(tmp_path), QUICK))
    assert (row["status"], row["cause"]) == ("failed", "does not exist; check the path")


ERRORS = [
    ValueError("Maximum allowed size exceeded"), MemoryError(), RecursionError("maximum recursion depth exceeded"),
    KeyError("heading_deg"), UnicodeEncodeError("utf-8", "\udcff", 0, 1, "surrogates not allowed"),
    OSError(5, "Input/output error", "/secret/path"), ZeroDivisionError(),
    AssertionError("a\nb\x1b[2J"), StopIteration(),
]  # fmt: skip


@pytest.mark.parametrize("error", ERRORS, ids=lambda error: type(error).__name__)
def test_error_that_nobody_foresaw_is_one_line_beside_its_recording(error: Exception, tmp_path: Path) -> None:
    def fail(job: BatchJob) -> Row:
        raise error

    (tmp_path / MARKS).mkdir()
    row = run_job_or_fail(BatchJob("a", "a.mcap", str(tmp_path), QUICK), fail)
    assert row["status"] == "failed"
    assert not re.search("[\x00-\x1f\x7f-\x9f\ud800-\udfff]", row["cause"])
    assert "Traceback" not in row["cause"]
    assert len(row["cause"]) > len("failed")


@pytest.mark.parametrize(("seconds", "rate_hz", "names"), [
    (3, 1.0, CHANNELS), (1, 1.0, CHANNELS), (1, 2.0, POSE_AND_THRUSTER), (600, 0.04, CHANNELS),
    (1, 1.0, ("wind_speed_mps",)), (3, 10.0, POSE_AND_THRUSTER),
], ids=lambda value: value if not isinstance(value, tuple) else f"{len(value)} channels")  # fmt: skip
@pytest.mark.parametrize("change", [
    "as it is", "half missing", pytest.param("constant", marks=pytest.mark.attack),
    pytest.param("zero", marks=pytest.mark.attack),
])  # fmt: skip
def test_shortest_recordings_are_analysed_or_say_what_they_lack(
    seconds: int, rate_hz: float, names: tuple[str, ...], change: str, tmp_path: Path
) -> None:
    table = sailed(seconds, rate_hz)[list(names)]
    if change == "constant":
        table = table * 0.0 + table.iloc[0]
    elif change == "zero":
        table = table * 0.0
    elif change == "half missing":
        table = table.mask(np.random.default_rng(1).random(table.shape) < 0.5)
        table.iloc[0] = 1.0
    write_table(table, tmp_path / "short.mcap", Trial(name="short"))
    (tmp_path / MARKS).mkdir()
    row = process_job(BatchJob("short", str(tmp_path / "short.mcap"), str(tmp_path), Options(pictures=False)))
    assert "unexpectedly" not in row["cause"], row["cause"]


def hang(job: BatchJob) -> Row:
    time.sleep(10 * PATIENCE_S)
    return {}


@pytest.mark.attack
def test_recording_that_hangs_holds_up_no_other_of_the_season(monkeypatch: pytest.MonkeyPatch) -> None:
    worker = serve._Worker()
    monkeypatch.setattr(serve, "_LONGEST_S", 0.5)
    assert worker.row_of(hang, BatchJob("a", "a.mcap", "out", QUICK)) is None
    monkeypatch.undo()
    row = worker.row_of(row_before_analysis, BatchJob("a", "nothing.mcap", "out", QUICK))
    worker.stop()
    assert row is not None
    assert row["status"] == "failed"


@pytest.mark.parametrize("make", [
    os.mkfifo, lambda path: path.symlink_to("/dev/zero"), lambda path: path.mkdir(),
    lambda path: path.write_text("[" * 200_000), lambda path: path.write_text('{"verdict": NaN}'),
    lambda path: path.write_bytes(b"\xff\x00"), lambda path: path.symlink_to(path),
], ids=["fifo", "device", "folder", "nested too deeply", "no numbers", "binary", "link to itself"])  # fmt: skip
def test_diagnosis_that_is_none_is_passed_over(make: Callable[[Path], object], tmp_path: Path) -> None:
    (tmp_path / "season").mkdir()
    make(tmp_path / "season" / "diagnosis.json")
    with Season(tmp_path / "season", tmp_path / "out", QUICK, eager=False) as pages:
        assert pages.rows() == []


@pytest.mark.attack
def test_batch_on_the_command_line_shows_any_name_with_escapes(sound: Path, tmp_path: Path) -> None:
    folder = tmp_path / os.fsdecode(b"season \xff\x1b[2J")
    for name in NAMES.values():
        path = folder / os.fsdecode(name + b".mcap")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    shutil.copy(sound, folder / os.fsdecode(b"sound \xff.mcap"))
    out = tmp_path / os.fsdecode(b"out\xfe")
    assert run_seatrial("batch", folder, "-o", out, "--workers", "1").survived().code == 1
    assert (out / r"sound \xff" / "page.html").is_file()
    outcome = run_seatrial("batch", folder, "-o", tmp_path / "out", "--workers", "1", "--json").survived()
    assert (json.loads(outcome.out)["done"], json.loads(outcome.out)["failed"]) == (1, len(NAMES))


@pytest.mark.attack
def test_thousands_of_files_are_a_season(sound: Path, tmp_path: Path) -> None:
    folder = tmp_path / "season"
    for number in range(3_000):
        path = folder / f"{number % 100:02d}" / f"{number:05d}.mcap"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    shutil.copy(sound, folder / "sound.mcap")
    outcome = run_seatrial("batch", folder, "-o", tmp_path / "out", "--workers", "1", "--json", patience_s=600.0)
    summary = json.loads(outcome.survived().out)
    assert (summary["done"], summary["failed"]) == (1, 3_000)
    assert outcome.peak_mb < 2000
