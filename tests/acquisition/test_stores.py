"""Recordings in object stores: read by ranges where the index tells, whole elsewhere, with errors of one line."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib import import_module
from pathlib import Path
from threading import Thread

import numpy as np
import pytest

import seatrial
from seatrial.acquisition.core import stores
from seatrial.acquisition.core.errors import SeatrialError
from seatrial.acquisition.core.trial import NANO, Frame, Sample, Trial
from seatrial.acquisition.recording.writer import RecordingWriter
from tests.stores import BUCKET, clear_connections, every_tenth_fails, needs_store, object_store, put

pytestmark = needs_store

_START_NS = 1_700_000_000 * NANO
_MARKS_S = (0, 600, 900)


def write_voyage(path: Path, seconds: int = 1200, frame_bytes: int = 1000) -> Path:
    """A recording as the recorder writes it: a chunk every 0.2 s with raw input, a channel and marks."""
    random = np.random.default_rng(0)
    with RecordingWriter(path, Trial(name="voyage", vessel="gunnerus_short")) as writer:
        writer.write_metadata("clock", {"host_clock": "kept by NTP"})
        for number in range(5 * seconds):
            now_ns = _START_NS + number * NANO // 5
            writer.write_raw(Frame("bridge", "mavlink", random.bytes(frame_bytes), now_ns, 0))
            writer.write_sample(Sample("heading_deg", number % 360.0, "gps/1", now_ns, 0, now_ns - 5_000_000))
            if number / 5 in _MARKS_S:
                writer.write_event(f"mark at {number / 5:g} s", now_ns, name="mark")
            writer.flush()
    return path


@pytest.fixture(autouse=True)
def own_connections() -> Iterator[None]:
    """A connection keeps what a test has put in the place of its requests."""
    yield
    clear_connections()


@pytest.fixture(scope="module")
def store() -> Iterator[str]:
    with object_store() as address:
        yield address


@pytest.fixture(scope="module")
def voyage(store: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of 6 MB, also in the store."""
    path = write_voyage(tmp_path_factory.mktemp("voyage") / "voyage.mcap")
    put(path, "season/voyage.mcap")
    return path


@pytest.fixture(scope="module")
def short(store: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One so small that it is read as a whole."""
    path = write_voyage(tmp_path_factory.mktemp("short") / "short.mcap", 60)
    put(path, "season/short.mcap")
    return path


@pytest.fixture
def count_bytes(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many bytes each request for content brings."""
    sizes: list[int] = []
    system = import_module("s3fs").S3FileSystem
    fetch = system._cat_file

    async def counted(*arguments: object, **options: object) -> bytes:
        data: bytes = await fetch(*arguments, **options)
        sizes.append(len(data))
        return data

    monkeypatch.setattr(system, "_cat_file", counted)
    clear_connections()
    return sizes


def test_info_of_a_large_recording_reads_ranges_and_agrees_with_the_file(
    voyage: Path, count_bytes: list[int]
) -> None:
    contents, local = seatrial.info(f"s3://{BUCKET}/season/voyage.mcap"), seatrial.info(voyage)
    assert sum(count_bytes) == contents["index"]["read_bytes"] < 0.35 * voyage.stat().st_size
    assert len(count_bytes) <= 15
    assert contents["index"]["unread_events"] == 0
    heading, expected = contents["channels"].pop("heading_deg"), local["channels"].pop("heading_deg")
    assert heading == {**expected, "longest_gap_s": None}
    assert {key: contents[key] for key in local} == dict(local)
    assert [event["text"] for event in contents["events"]] == [f"mark at {second} s" for second in _MARKS_S]


def test_of_an_index_too_large_only_its_ends_are_read(
    voyage: Path, count_bytes: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("seatrial.acquisition.recording.index._INDEX_BYTES", 200_000)
    contents, local = seatrial.info(f"s3://{BUCKET}/season/voyage.mcap"), seatrial.info(voyage)
    assert contents["index"]["unread_events"] == 2
    assert [event["text"] for event in contents["events"]] == ["mark at 0 s"]
    heading = {**local["channels"]["heading_deg"], "longest_gap_s": None}
    assert contents["channels"] == {"heading_deg": heading}
    assert contents["messages"] == local["messages"]


def test_a_small_recording_says_the_same_as_on_the_disk(short: Path) -> None:
    assert seatrial.info(f"s3://{BUCKET}/season/short.mcap") == seatrial.info(short)


def test_reading_equals_that_of_the_file_and_fetches_it_once(voyage: Path, count_bytes: list[int]) -> None:
    place = f"s3://{BUCKET}/season/voyage.mcap"
    table = seatrial.read(place)
    assert table.equals(seatrial.read(voyage))
    assert seatrial.prepare(place).equals(seatrial.prepare(voyage))
    assert seatrial.check(place).as_dict() == seatrial.check(voyage).as_dict()
    assert sum(count_bytes) == voyage.stat().st_size


def test_a_store_that_fails_every_tenth_request_changes_nothing(
    voyage: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stores, "_FIRST_PAUSE_S", 0.0)
    monkeypatch.setattr(stores, "BLOCK_BYTES", 200_000)
    failures = every_tenth_fails(monkeypatch)
    with stores.local_copies([Path(f"s3://{BUCKET}/season/voyage.mcap")]) as (copy,):
        assert copy.read_bytes() == voyage.read_bytes()
    assert len(failures) >= 3
    assert not copy.exists()


def _without_credentials(patch: pytest.MonkeyPatch) -> None:
    for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"):
        patch.delenv(name)
    patch.setenv("AWS_EC2_METADATA_DISABLED", "true")
    patch.setenv("AWS_SHARED_CREDENTIALS_FILE", "/nowhere")


def _without_package(patch: pytest.MonkeyPatch) -> None:
    patch.setitem(sys.modules, "s3fs", None)


def _refused(patch: pytest.MonkeyPatch) -> None:
    async def refuse(*_: object, **__: object) -> None:
        raise PermissionError("Access Denied")

    patch.setattr(import_module("s3fs").S3FileSystem, "_call_s3", refuse)


def _unreachable(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(stores, "_FIRST_PAUSE_S", 0.0)
    patch.setattr(stores, "ATTEMPTS", 2)

    async def fail(*_: object, **__: object) -> None:
        raise ConnectionError("connection reset by peer")

    patch.setattr(import_module("s3fs").S3FileSystem, "_call_s3", fail)


@pytest.mark.parametrize(
    ("place", "prepare", "text"),
    [
        (f"s3://{BUCKET}/season/none.mcap", None, "does not exist"),
        ("s3://no-such-bucket/voyage.mcap", None, "no such bucket"),
        (f"s3://{BUCKET}/season", None, "is a folder"),
        (f"s3://{BUCKET}/season/voyage.mcap", _without_credentials, "needs credentials"),
        (f"s3://{BUCKET}/season/voyage.mcap", _without_package, r"pip install 'seatrial\[s3\]'"),
        (f"s3://{BUCKET}/season/voyage.mcap", _refused, "refused by its store: Access Denied"),
        (f"s3://{BUCKET}/season/voyage.mcap", _unreachable, "cannot be read: connection reset"),
        ("gs://bucket/voyage.mcap", None, "pip install 'gcsfs'"),
    ],
)
@pytest.mark.parametrize("function", ["info", "read"])
def test_what_a_store_does_not_give_is_one_clear_line(
    voyage: Path, monkeypatch: pytest.MonkeyPatch, place: str, prepare: object, text: str, function: str
) -> None:
    clear_connections()
    if callable(prepare):
        prepare(monkeypatch)
    with pytest.raises(SeatrialError, match=text) as raised:
        getattr(seatrial, function)(place)
    assert str(raised.value).startswith(place)
    assert "\n" not in str(raised.value)


def test_the_web_is_read_by_ranges(voyage: Path) -> None:
    content = voyage.read_bytes()

    class Server(BaseHTTPRequestHandler):
        def do_HEAD(self) -> None:
            self._answer(200, len(content))

        def do_GET(self) -> None:
            start, end = map(int, re.findall(r"\d+", self.headers["Range"]))
            self._answer(206, end + 1 - start)
            self.wfile.write(content[start : end + 1])

        def _answer(self, status: int, size: int) -> None:
            self.send_response(status)
            self.send_header("Accept-Ranges", "bytes")
            self.send_header("Content-Length", str(size))
            self.end_headers()

        def log_message(self, *_: object) -> None:
            """Nothing: a test prints no requests."""

    with ThreadingHTTPServer(("127.0.0.1", 0), Server) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        place = f"http://127.0.0.1:{server.server_port}/season/voyage.mcap?token=x"
        assert seatrial.read(place).equals(seatrial.read(voyage))
        server.shutdown()


class _UnreliableServer(BaseHTTPRequestHandler):
    """Answers every other request with ``status``, or each of them where ``always``."""

    content, status, always = b"", 503, False
    requests = 0

    def do_HEAD(self) -> None:
        self.do_GET()

    def do_GET(self) -> None:
        type(self).requests += 1
        if self.always or self.requests % 2:
            self.send_response(self.status)
            self.send_header("Location", self.path)  # of a redirection: to where it was
            self.send_header("Content-Length", "0")
            self.end_headers()
            return
        self.send_response(206 if self.headers["Range"] else 200)
        self.send_header("Content-Length", str(len(self.content)))
        self.end_headers()
        if self.command == "GET":
            self.wfile.write(self.content)

    def log_message(self, *_: object) -> None:
        """Nothing: a test prints no requests."""


@pytest.mark.parametrize(
    ("status", "always", "text"),
    [
        (503, False, ""), (500, False, ""), (503, True, "cannot be read: 503"), (404, True, "does not exist"),
        (403, True, "is refused by its store"), (302, True, "sends from one address to another without end"),
    ],
)  # fmt: skip
def test_a_server_of_the_web_that_fails_is_asked_again_and_is_no_missing_file(
    status: int, always: bool, text: str, voyage: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A 503 to the question for the file's size said that it does not exist."""
    monkeypatch.setattr(stores, "_FIRST_PAUSE_S", 0.0)
    members = {"content": voyage.read_bytes(), "status": status, "always": always}
    handler = type("Handler", (_UnreliableServer,), members)
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        place = f"http://127.0.0.1:{server.server_port}/voyage.mcap"
        if text:
            with pytest.raises(SeatrialError, match=text) as raised:
                seatrial.read(place)
            assert str(raised.value).startswith(place)
        else:
            assert seatrial.read(place).equals(seatrial.read(voyage))
        server.shutdown()


def test_local_recordings_do_not_import_the_libraries_of_stores(short: Path) -> None:
    script = (
        "import sys, json, seatrial as st; st.info(sys.argv[1]); st.read(sys.argv[1]);"
        "print(json.dumps([name for name in ('fsspec', 's3fs', 'aiohttp', 'botocore') if name in sys.modules]))"
    )
    printed = subprocess.run([sys.executable, "-c", script, str(short)], capture_output=True, check=True, text=True)
    assert json.loads(printed.stdout) == []


def test_a_folder_called_as_a_store_stays_local(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, short: Path
) -> None:
    (tmp_path / "s3:" / "bucket").mkdir(parents=True)
    (tmp_path / "s3:" / "bucket" / "a.mcap").write_bytes(short.read_bytes())
    monkeypatch.chdir(tmp_path)
    assert seatrial.info("s3:/bucket/a.mcap")["closed"]
