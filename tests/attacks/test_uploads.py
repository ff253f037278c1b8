"""What is sent to a season, and what its pages trip over: one line on the page, and the server goes on."""

from __future__ import annotations

import gzip
import io
import json
import os
import signal
import struct
import time
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from threading import Event, Thread

import numpy as np
import pytest
from flask.testing import FlaskClient
from werkzeug.test import TestResponse

from seatrial.acquisition.core.errors import SeatrialError
from seatrial.acquisition.core.trial import Trial
from seatrial.acquisition.recording.writer import write_table
from seatrial.analysis import serve
from seatrial.analysis.serve import Season, call_in_limited_process, make_app
from tests.acquisition.conftest import PATIENCE_S
from tests.analysis.small_batch import QUICK, sailed
from tests.analysis.test_serve import HERE, table_text

ORIGIN = "http://127.0.0.1:8765"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    made = tmp_path / "season"
    made.mkdir()
    return made


@pytest.fixture
def client(folder: Path, tmp_path: Path) -> Iterator[FlaskClient]:
    with Season(folder, tmp_path / "results", QUICK, eager=False) as season:
        yield make_app(season, upload_mb=3.0).test_client()


def token(client: FlaskClient) -> str:
    return client.get("/", headers=HERE).text.partition('name="token" value="')[2].partition('"')[0]


def send(client: FlaskClient, name: str, content: bytes, **headers: str) -> TestResponse:
    """Send a file as a browser does."""
    shown = name.replace('"', "%22").replace("\n", "%0A").encode()
    body = (
        b'--cut\r\nContent-Disposition: form-data; name="token"\r\n\r\n' + token(client).encode()
        + b'\r\n--cut\r\nContent-Disposition: form-data; name="file"; filename="' + shown
        + b'"\r\nContent-Type: application/octet-stream\r\n\r\n' + content + b"\r\n--cut--\r\n"
    )  # fmt: skip
    kind = {"Content-Type": "multipart/form-data; boundary=cut"}
    return client.post("/upload", data=body, headers=HERE | kind | headers)


def lines_of(answer: TestResponse) -> str:
    """The text of a page that says what happened, which is short and shows nothing of the inside."""
    assert "Traceback" not in answer.text
    assert "/tmp" not in answer.text
    assert answer.text.count("<p>") <= 5
    return answer.text


def sheet(cells: str, entities: str = "") -> bytes:
    """An Excel file of one sheet."""
    head = f'<?xml version="1.0"?>{entities}'
    parts = {
        "[Content_Types].xml": '<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">'
        '<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>'
        '<Default Extension="xml" ContentType="application/xml"/></Types>',
        "_rels/.rels": '<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">'
        '<Relationship Id="r" Type="http://schemas.openxmlformats.org/officeDocument/2006/relationships/'
        'officeDocument" Target="xl/workbook.xml"/></Relationships>',
        "xl/workbook.xml": '<workbook xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main" xmlns:r='
        '"http://schemas.openxmlformats.org/officeDocument/2006/relationships"><sheets><sheet name="a" sheetId="1" '
        'r:id="r"/></sheets></workbook>',
        "xl/_rels/workbook.xml.rels": '<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/'
        'relationships"><Relationship Id="r" Type="http://schemas.openxmlformats.org/officeDocument/2006/'
        'relationships/worksheet" Target="worksheets/sheet1.xml"/></Relationships>',
        "xl/worksheets/sheet1.xml": f'{head}<worksheet xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/'
        f'main"><sheetData>{cells}</sheetData></worksheet>',
    }
    return archive({name: text.encode() for name, text in parts.items()})


def archive(parts: dict[str, bytes]) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as made:
        for name, content in parts.items():
            made.writestr(name, content)
    return stream.getvalue()


def npy(header: str, content: bytes = b"") -> bytes:
    """An array of NumPy with a header of one's own."""
    text = header.encode() + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text + content


def recording_with(tmp_path: Path, **metadata: str) -> bytes:
    path = tmp_path / "made.mcap"
    write_table(sailed(10), path, Trial(name="a"), metadata={"history": {"history": metadata["history"]}})
    return path.read_bytes()


FAR = '<row r="1"><c r="A1"><v>1</v></c></row><row r="1048576"><c r="XFD1048576"><v>1</v></c></row>'
LAUGHS = "<!DOCTYPE a [<!ENTITY a0 'ha'>" + "".join(
    f"<!ENTITY a{n} '{f'&a{n - 1};' * 10}'>" for n in range(1, 12)
) + "]>"  # fmt: skip
MEGA = bytes(1_000_000)
PICKLE = b"cos\nsystem\n(S'false'\ntR."
MAT_HEAD = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM"
HARMFUL: dict[str, Callable[[Path], bytes]] = {
    "far.xlsx": lambda path: sheet(FAR),
    "laughs.xlsx": lambda path: sheet('<row r="1"><c r="A1" t="str"><v>&a11;</v></c></row>', LAUGHS),
    "no_zip.xlsx": lambda path: b"PK\x03\x04" + bytes(1000),
    "traversal.xlsx": lambda path: archive({"../../../../tmp/owned": b"x", "/etc/owned": b"x"}),
    "nested.xlsx": lambda path: archive({"a.zip": archive({"b.zip": archive({"c": MEGA})})}),
    "bomb.csv.gz": lambda path: gzip.compress(b"time,a\n" + MEGA * 300),
    "line.csv": lambda path: b"9" * 2_900_000,
    "columns.csv": lambda path: b"a," * 1_400_000 + b"\n" + b"1," * 2,
    "nulls.csv": lambda path: MEGA,
    "deep.json": lambda path: b"[" * 1_000_000,
    "deep.mcap": lambda path: recording_with(path, history="[" * 100_000 + "]" * 100_000),
    "object.npy": lambda path: npy("{'descr': '|O', 'fortran_order': False, 'shape': (1,), }", PICKLE),
    "huge.npy": lambda path: npy("{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000,), }"),
    "code.npy": lambda path: npy("__import__('os').abort()"),
    "deep.npy": lambda path: npy("(" * 20_000 + ")" * 20_000),
    "junk.parquet": lambda path: b"PAR1" + bytes(100) + b"\xff\xff\xff\x7fPAR1",
    "junk.mat": lambda path: MAT_HEAD + struct.pack("<II", 15, 0x7FFFFFF0) + bytes(99),
    "junk.mcap": lambda path: b"\x89MCAP0\r\n" + b"\x06" + struct.pack("<Q", 2**63) + bytes(100),
    "junk.nc": lambda path: b"\x89HDF\r\n\x1a\n" + bytes(1000),
}  # fmt: skip
"""Files by name; small ones that unpack to much, lead astray, or end who reads them."""


@pytest.mark.attack
@pytest.mark.parametrize("name", HARMFUL)
def test_harmful_file_is_refused_and_the_server_goes_on(
    name: str, client: FlaskClient, folder: Path, tmp_path: Path
) -> None:
    answer = send(client, name, HARMFUL[name](tmp_path))
    lines_of(answer)
    if answer.status_code != 200:
        assert answer.status_code == 422
        assert list(folder.iterdir()) == []
    assert client.get("/", headers=HERE).status_code == 200
    assert send(client, "sound.csv", table_text()).status_code == 200


def abort() -> list[str]:
    os.abort()


def exit_silently() -> list[str]:
    os._exit(3)


def be_killed() -> list[str]:
    os.kill(os.getpid(), signal.SIGKILL)
    return []


def hang() -> list[str]:
    time.sleep(100 * PATIENCE_S)
    return []


def take_all_memory() -> list[str]:
    return [str(np.ones(10**11).sum())]


def recurse() -> list[str]:
    return recurse()


def say_too_much() -> list[str]:
    return ["x" * 10_000_000]


def raise_strangely() -> list[str]:
    raise KeyError("\x1b[2J\udcff")


ENDS = {
    abort: "signal SIGABRT", exit_silently: "exit code 3", be_killed: "signal SIGKILL", hang: "took longer than",
    take_all_memory: "not enough memory", recurse: "RecursionError", raise_strangely: "KeyError",
}  # fmt: skip


@pytest.mark.attack
@pytest.mark.parametrize("function", ENDS, ids=lambda function: function.__name__)
def test_whatever_a_file_does_to_its_reader_is_one_line(
    function: Callable[[], list[str]], capfd: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SeatrialError) as caught:
        call_in_limited_process(function, longest_s=2.0 if function is hang else PATIENCE_S)
    assert ENDS[function] in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1
    assert "\x1b" not in str(caught.value)
    assert capfd.readouterr() == ("", "")


@pytest.mark.attack
def test_answer_of_any_size_comes_through() -> None:
    assert len(call_in_limited_process(say_too_much)[0]) == 10_000_000


def test_file_that_takes_memory_in_native_code_is_refused(client: FlaskClient, folder: Path) -> None:
    answer = send(client, "far.xlsx", sheet(FAR))
    assert answer.status_code == 422
    assert "far.xlsx" in lines_of(answer)
    assert list(folder.iterdir()) == []
    assert client.get("/", headers=HERE).status_code == 200


@pytest.mark.parametrize("name", [
    "../a.csv", "/etc/cron.d/a.csv", "..\\..\\a.csv", "C:\\a.csv", "....//a.csv", "a\x00.csv", "a\n.csv", ".a.csv",
    "-rf.csv", "a" * 5_000 + ".csv", "%2e%2e%2fa.csv", "<script>.csv", "con.csv", "", ".", "..", "/",
    "\u202eabc.csv",
], ids=repr)  # fmt: skip
def test_name_of_a_file_leads_nowhere_else(
    name: str, client: FlaskClient, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def make(function: object, given: str) -> list[str]:
        Path(given).with_suffix(".mcap").write_bytes(b"made")
        return []

    monkeypatch.setattr("seatrial.analysis.serve.call_in_limited_process", make)
    before = {path for path in folder.parent.rglob("*") if path.is_dir()}
    answer = send(client, name, b"x")
    assert answer.status_code in (200, 400, 422)
    assert "<script>" not in lines_of(answer)
    made = list(folder.iterdir())
    assert len(made) == (answer.status_code == 200)
    assert all(path.suffix == ".mcap" and not path.name.startswith(("-", ".")) for path in made)
    assert {path for path in folder.parent.rglob("*") if path.is_dir()} == before


@pytest.mark.parametrize("origin", [
    "http://evil.example", "null", "https://127.0.0.1.evil.example:8765", "http://127.0.0.1:80", "http://localhost:8765",
    "http://127.0.0.1:8765@evil.example", "file://", "", "http://[::1]:8765", "127.0.0.1:8765",
])  # fmt: skip
def test_page_elsewhere_can_send_nothing(origin: str, client: FlaskClient, folder: Path) -> None:
    answer = send(client, "a.csv", table_text(), Origin=origin)
    assert answer.status_code == 403
    assert list(folder.iterdir()) == []


@pytest.mark.parametrize(("body", "kind"), [
    (b"token=x&file=y", "application/x-www-form-urlencoded"), (b'{"token": 1}', "application/json"),
    (b"x", "text/plain"), (b"--a\r\n" * 10_000, "multipart/form-data; boundary=a"),
    (b"--a\r\nContent-Disposition: form-data; name=token\r\n\r\nx", "multipart/form-data; boundary=a"),
    (b"x" * 100_000, "multipart/form-data"), (b"", "multipart/form-data; boundary=" + "b" * 10_000), (b"", ""),
], ids=lambda value: repr(value)[:30])  # fmt: skip
def test_form_of_another_kind_is_refused(body: bytes, kind: str, client: FlaskClient, folder: Path) -> None:
    answer = client.post("/upload", data=body, headers=HERE | {"Content-Type": kind})
    assert 400 <= answer.status_code < 500
    lines_of(answer)
    assert list(folder.iterdir()) == []


def test_more_than_is_allowed_is_refused_before_it_is_stored(client: FlaskClient) -> None:
    kind = {"Content-Type": "multipart/form-data; boundary=a"}
    assert client.post("/upload", data=bytes(4_000_000), headers=HERE | kind).status_code == 413


def test_one_file_is_received_at_a_time(client: FlaskClient, monkeypatch: pytest.MonkeyPatch) -> None:
    begun, goes_on = Event(), Event()

    def receive(*_: object) -> tuple[Path, list[str]]:
        begun.set()
        goes_on.wait(PATIENCE_S)
        return Path("a.mcap"), []

    monkeypatch.setattr(serve, "receive_upload", receive)
    answers: list[TestResponse] = []
    first = Thread(target=lambda: answers.append(send(client.application.test_client(), "a.csv", b"x")))
    first.start()
    assert begun.wait(PATIENCE_S)
    assert send(client, "b.csv", b"x").status_code == 503
    goes_on.set()
    first.join()
    assert answers[0].status_code == 200
    assert send(client, "b.csv", b"x").status_code == 200


def test_full_disk_leaves_no_half_of_a_recording(
    client: FlaskClient, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def copy(source: Path, target: Path) -> None:
        Path(target).write_bytes(b"half")
        raise OSError(28, "No space left on device")

    write_table(sailed(10), tmp_path / "a.mcap", Trial(name="a"))
    monkeypatch.setattr("shutil.copyfile", copy)
    answer = send(client, "a.mcap", (tmp_path / "a.mcap").read_bytes())
    assert answer.status_code == 422
    assert "No space left" in answer.text
    assert list(folder.iterdir()) == []


@pytest.mark.parametrize("error", [
    RuntimeError("a"), RecursionError("maximum recursion depth"), MemoryError(), KeyError("<script>"),
    OSError(5, "I/O"),
    UnicodeEncodeError("utf-8", "\udcff", 0, 1, "surrogates"), AssertionError("\x1b[2J"), StopIteration(),
], ids=lambda error: type(error).__name__)  # fmt: skip
@pytest.mark.parametrize("address", ["/", "/a/page.html", "/a/export.csv", "/runs.html"])
def test_error_that_nobody_foresaw_is_a_page_of_one_line(
    error: Exception, address: str, client: FlaskClient, monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    def fail(*_: object) -> None:
        raise error

    with monkeypatch.context() as patch:
        patch.setattr(Season, "rows", fail)
        patch.setattr(Season, "row", fail)
        answer = client.get(address, headers=HERE)
    assert answer.status_code == 500
    assert "This page failed" in lines_of(answer)
    assert "<script>" not in answer.text
    assert "\x1b" not in answer.text
    assert "Traceback" not in capfd.readouterr().err
    assert client.get("/", headers=HERE).status_code == 200


@pytest.mark.parametrize("address", [
    "/%00/page.html", "/%ff%fe/page.html", "/" + "a" * 50_000 + "/page.html", "/../../etc/passwd/page.html",
    "/%2e%2e/%2e%2e/etc/passwd/page.html", "/a/export.%00", "/a/export.py", "/runs.html?kind=" + "x" * 50_000,
    "/runs.html?name=%ff&kind=%00", "/runs.xlsx?name=../../etc", "//evil.example/page.html", "/.season.sqlite",
    "/index.parquet", "/.season.sqlite/page.html",
], ids=lambda address: address[:40])  # fmt: skip
def test_strange_address_is_a_page_that_says_so(address: str, client: FlaskClient) -> None:
    answer = client.get(address, headers=HERE)
    assert answer.status_code in (200, 308, 404, 422)
    assert b"root:" not in answer.data
    assert b"Traceback" not in answer.data


def test_exports_at_once_are_bounded() -> None:
    turns = [serve._turns.acquire(blocking=False) for _ in range(serve.MOST_AT_ONCE + 1)]
    try:
        assert turns == [True] * serve.MOST_AT_ONCE + [False]
        with pytest.raises(SeatrialError, match="try again"):
            call_in_limited_process(hang, longest_s=0.1)
    finally:
        for _ in range(serve.MOST_AT_ONCE):
            serve._turns.release()


@pytest.mark.attack
def test_no_line_of_an_answer_is_code() -> None:
    """What comes back is JSON: whoever sends it has read a stranger's file."""
    assert call_in_limited_process(json_text) == ['{"a": 1}']


def json_text() -> list[str]:
    return [json.dumps({"a": 1})]
