"""Running a recorder: marks, the check before departure, log lines, a supervisor, keys on a terminal."""

from __future__ import annotations

import io
import json
import logging
import os
import pty
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path

import pytest
from typer.testing import CliRunner

from seatrial import app
from seatrial.acquisition.config.sources import UdpSource
from seatrial.acquisition.config.trial_file import load_config
from seatrial.acquisition.core.errors import SourceError
from seatrial.acquisition.core.ship import MOTION, NAMES
from seatrial.acquisition.emulator import NullModem
from seatrial.acquisition.logger import health
from seatrial.acquisition.logger.health import Health, Predictions
from seatrial.acquisition.logger.requests import Mark, RecorderState, RequestServer, send_mark
from seatrial.acquisition.logger.survey import check_before_departure
from seatrial.acquisition.protocols.nmea0183 import frame_sentence
from seatrial.acquisition.recording.reader import read_recording
from seatrial.acquisition.sources.lines import TcpConnection, UdpPort
from tests.acquisition.conftest import PATIENCE_S, config_text, free_port, recorded_count, wait_for
from tests.conftest import nightly

ROOT = Path(__file__).parents[2]


def say(port: int, text: str = "HEHDT,12.5,T") -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.sendto(frame_sentence(text), ("127.0.0.1", port))


class Process:
    """``seatrial record`` as a process of its own, with its log."""

    def __init__(self, folder: Path, *options: str, more: str = "", **environment: str) -> None:
        self.port = free_port()
        text = config_text(f'type = "udp"\nport = {self.port}\n', ("heading_deg",), clock="receiver")
        (folder / "trial.toml").write_text(text + more)
        self.folder = folder
        self.errors = (folder / "stderr").open("w+")
        self.process = subprocess.Popen(
            [sys.executable, str(ROOT / "seatrial.py"), "record", str(folder / "trial.toml"),
             "-o", str(folder / "out"), *options],
            stdout=subprocess.PIPE, stderr=self.errors, text=True, cwd=ROOT,
            env={**os.environ, "SEATRIAL_RUNTIME": str(folder / "run"), **environment},
        )  # fmt: skip

    def log(self) -> str:
        return (self.folder / "stderr").read_text()

    def end(self, number: signal.Signals = signal.SIGTERM) -> tuple[int, list[str]]:
        self.process.send_signal(number)
        stdout, _ = self.process.communicate(timeout=PATIENCE_S)
        self.errors.close()
        return self.process.returncode, stdout.splitlines()


def hearing(mark: Mark, folder: Path) -> RequestServer:
    """A recorder's ear for marks."""
    return RequestServer(mark, lambda: RecorderState("", "", "", False, 0, 0, 0), Predictions(Health({})), folder)


def test_recorder_starts_without_the_libraries_of_tables(tmp_path: Path) -> None:
    """pandas, and asammdf with sympy and more, took more than half of the time of a start; a
    program of a user still has python-can with all that it reads."""
    read = "can.io.mf4.asammdf is not None, {'pandas', 'asammdf', 'sympy', 'openpyxl', 'numba'} & set(sys.modules)"
    recording = (
        "import sys, seatrial\n"
        f"sys.argv = ['seatrial', 'record', {str(tmp_path / 'none.toml')!r}]\n"
        "try: seatrial.main()\n"
        "except SystemExit: pass\n"
        "from seatrial.acquisition.logger import record\n"
        "from seatrial.acquisition.sources import lines, log_file\n"
        "from seatrial.acquisition.protocols import can_frames\n"
    )
    own = "import sys\nfrom seatrial.acquisition.sources import lines, log_file\n"
    said = [
        subprocess.run(
            [sys.executable, "-c", f"{script}import can.io.mf4; print({read})"],
            capture_output=True, text=True, cwd=ROOT, check=True,
        ).stdout
        for script in (recording, own)
    ]  # fmt: skip
    assert said[0] == "False set()\n"
    assert said[1].startswith("True") or find_spec("asammdf") is None


def test_marks_are_set_from_another_process(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With the time at which the command was given, not when it arrived."""
    monkeypatch.setenv("SEATRIAL_RUNTIME", str(tmp_path / "run"))
    running = Process(tmp_path)
    wait_for(lambda: "recording to" in running.log())
    before_ns = time.time_ns()
    result = CliRunner().invoke(app, ["mark", "start 20/20"])
    after_ns = time.time_ns()
    assert result.exit_code == 0, result.output
    wait_for(lambda: "start 20/20" in running.log())
    code, (path,) = running.end()
    assert code == 0
    ((time_ns, _),) = [event for event in read_recording(path).events if event[1] == "start 20/20"]
    assert before_ns - 5e6 <= time_ns <= after_ns + 5e6
    assert list((tmp_path / "run").iterdir()) == []


def test_a_mark_that_nobody_hears_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SEATRIAL_RUNTIME", str(tmp_path))
    result = CliRunner().invoke(app, ["mark", "start"])
    assert result.exit_code != 0
    with pytest.raises(SourceError, match="no recorder is running"):
        send_mark("start")


def test_a_socket_that_a_killed_recorder_left_is_no_recorder(tmp_path: Path) -> None:
    stale = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    stale.bind(str(tmp_path / "1-a.sock"))
    stale.close()
    heard: list[str] = []
    with hearing(lambda text, at_ns: heard.append(text), tmp_path):
        assert send_mark("x" * 1000, tmp_path) == 1
    assert heard == ["x" * 500]
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "rubbish",
    [
        b"",
        b"{",
        b"[]",
        b'{"text": "x"}',
        b'{"text": "x", "monotonic_ns": "a"}',
        b"\xff" * 9000,
        b"[" * 60_000,
        b'{"text": "x", "monotonic_ns": Infinity}',
        b'{"text": 5, "monotonic_ns": 5}',
        b" " * 200_000,
    ],
)
def test_rubbish_sent_as_a_mark_does_no_harm(tmp_path: Path, rubbish: bytes) -> None:
    heard: list[str] = []
    with hearing(lambda text, at_ns: heard.append(text), tmp_path) as server:
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as client:
            client.connect(str(server.path))
            with suppress(OSError):  # what is too long is not read to its end
                client.sendall(rubbish)
        assert send_mark("after", tmp_path) == 1
    assert heard == ["after"]


@pytest.mark.parametrize(("text", "heard"), [("🚢" * 600, "🚢" * 500), ("a\udcff", "a?")])
def test_a_mark_of_any_letters_is_heard(tmp_path: Path, text: str, heard: str) -> None:
    marks: list[str] = []
    with hearing(lambda text, at_ns: marks.append(text), tmp_path):
        assert send_mark(text, tmp_path) == 1
    assert marks == [heard]


@pytest.mark.parametrize("apart_s", [-3600, 3600, 10**30])
def test_a_mark_that_cannot_be_of_that_moment_is_of_now(tmp_path: Path, apart_s: int) -> None:
    moments: list[int] = []
    began_ns = time.monotonic_ns()
    with hearing(lambda text, at_ns: moments.append(at_ns), tmp_path) as server:
        message = {"text": "\ud800", "monotonic_ns": time.monotonic_ns() + apart_s * 10**9}
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as client:
            client.connect(str(server.path))
            client.sendall(json.dumps(message).encode())
            client.shutdown(socket.SHUT_WR)
            assert client.recv(16) == b"ok"
    (moment,) = moments
    assert began_ns <= moment <= time.monotonic_ns()


def test_the_end_and_the_log_of_a_recording_as_json(tmp_path: Path) -> None:
    running = Process(tmp_path, "--json", "--log", "json")
    wait_for(lambda: "recording to" in running.log())
    for _ in range(3):
        say(running.port)
    wait_for(lambda: recorded_count(tmp_path / "out") == 3)
    code, (line,) = running.end()
    found = json.loads(line)
    assert code == 0
    assert [Path(part) for part in found.pop("parts")] == list((tmp_path / "out").iterdir())
    assert found == {"frames": 3, "samples": 3, "dropped": 0, "channels": ["heading_deg"]}
    lines = [json.loads(line) for line in running.log().splitlines()]  # from the first to the last
    assert {"time", "level", "text"} <= set.intersection(*(set(line) for line in lines))
    assert [line["text"] for line in lines][-1] == "recording stopped"
    assert any(line["level"] == "warning" and "no source provides north_m" in line["text"] for line in lines)


def catches(process: int, number: signal.Signals) -> bool:
    """Whether a process has a handler of its own for a signal."""
    status = Path(f"/proc/{process}/status").read_text()
    caught = next(line for line in status.splitlines() if line.startswith("SigCgt"))
    return bool(int(caught.split()[1], 16) >> (number - 1) & 1)


@pytest.mark.parametrize(
    ("number", "after_s"),
    [
        (signal.SIGINT, 0.0),
        *nightly(
            (signal.SIGTERM, 0.2), (signal.SIGINT, 0.8), (signal.SIGTERM, 0.0), (signal.SIGINT, 0.2),
            (signal.SIGTERM, 0.8),
        ),
    ],
)  # fmt: skip
def test_a_signal_while_the_program_is_loaded_ends_it_cleanly(
    tmp_path: Path, number: signal.Signals, after_s: float
) -> None:
    """From the moment at which the interpreter itself is ready, long before the recorder is."""
    running = Process(tmp_path)
    wait_for(lambda: catches(running.process.pid, signal.SIGTERM))
    time.sleep(after_s)
    code, paths = running.end(number)
    assert code == 0, running.log()
    assert "Traceback" not in running.log()
    assert all(read_recording(path).closed for path in paths)


@pytest.mark.parametrize(
    "redirection", ["2>&1 | head -1", ">&-", *nightly(">/dev/full", "2>&-", ">&- 2>&-", "2>/dev/full")]
)
def test_a_broken_output_does_no_harm_to_a_recording(tmp_path: Path, redirection: str) -> None:
    text = config_text(f'type = "udp"\nport = {free_port()}\n', ("heading_deg",), clock="receiver")
    (tmp_path / "trial.toml").write_text(text)
    line = f'set -o pipefail; "$0" seatrial.py record {tmp_path}/trial.toml -o {tmp_path}/out --duration 0.6'
    done = subprocess.run(
        ["bash", "-c", f"{line} {redirection}", sys.executable],
        capture_output=True, text=True, cwd=ROOT, timeout=PATIENCE_S, check=False,
        env={**os.environ, "SEATRIAL_RUNTIME": str(tmp_path / "run")},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    assert "Exception" not in done.stderr
    (path,) = (tmp_path / "out").iterdir()
    assert read_recording(path).closed


@pytest.mark.parametrize("section", ['type = "udp"', 'type = "tcp"'])
def test_an_address_that_does_not_resolve_is_what_to_correct(tmp_path: Path, section: str) -> None:
    text = config_text(f'{section}\nport = 9\naddress = "no.such.host.invalid"\n', ("heading_deg",))
    (tmp_path / "trial.toml").write_text(text)
    (config,) = load_config(tmp_path / "trial.toml").sources
    source = UdpPort(config) if isinstance(config, UdpSource) else TcpConnection(config)  # type: ignore[arg-type]
    with pytest.raises(SourceError, match=r"; correct `address`$"):
        source.open()


def test_a_log_that_nobody_reads_does_not_hold_up_the_recording() -> None:
    class Stuck(io.StringIO):
        """A pipe whose reader sleeps."""

        def write(self, text: str) -> int:
            reader_wakes.wait(PATIENCE_S)
            return super().write(text)

    reader_wakes, stream = threading.Event(), Stuck()
    log = logging.getLogger("seatrial")
    with health.log_to(stream, "text"):
        for number in range(20_000):
            log.info("line %d", number)
        logged = True  # with the reader still asleep
        reader_wakes.set()
    assert logged
    assert stream.getvalue().startswith("line 0\nline 1\n")


def test_a_supervisor_is_told(tmp_path: Path) -> None:
    """READY when the sources are open, then the watchdog's sign of life with a status, then STOPPING."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as supervisor:
        supervisor.bind(str(tmp_path / "notify"))
        supervisor.settimeout(PATIENCE_S)
        running = Process(tmp_path, NOTIFY_SOCKET=str(tmp_path / "notify"))
        assert supervisor.recv(1000) == b"READY=1"
        sign = supervisor.recv(1000).decode()
        assert sign.startswith("WATCHDOG=1\nSTATUS=recording")
        code, _ = running.end()
        said = [supervisor.recv(1000)]
        while said[-1] != b"STOPPING=1":
            said.append(supervisor.recv(1000))
    assert code == 0


def test_without_a_supervisor_nobody_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("NOTIFY_SOCKET", raising=False)
    assert not health.notify_systemd("READY=1")
    monkeypatch.setenv("NOTIFY_SOCKET", "/nowhere/at/all")
    assert not health.notify_systemd("READY=1")


def two_lines(folder: Path, port: int, silent_device: str) -> Path:
    text = config_text(f'type = "udp"\nport = {port}\nrates_hz = {{ heading_deg = 50.0 }}\n', ("heading_deg",))
    serial = '[[source]]\nname = "{}"\ntype = "serial"\ndevice = "{}"\nchannels = ["{}"]\n'
    text += serial.format("quiet", silent_device, "yaw_rate_dps")
    text += serial.format("gone", "/dev/nowhere", "tunnel_rpm")
    (folder / "trial.toml").write_text(text)
    return folder / "trial.toml"


def test_a_check_says_what_is_missing_and_why(tmp_path: Path) -> None:
    port = free_port()
    stop = threading.Event()

    def talk() -> None:
        while not stop.wait(0.05):
            say(port)

    with NullModem() as cable:
        config = load_config(two_lines(tmp_path, port, cable.logger_device))
        talker = threading.Thread(target=talk)
        talker.start()
        found = check_before_departure(config, 1.2, tmp_path)
        stop.set()
        talker.join()
    problems = {each.name: each.problem for each in found.channels}
    assert list(problems) == [*MOTION, "tunnel_rpm"]
    assert re.fullmatch(r"comes 1?\d\.\d times a second instead of 50", problems["heading_deg"])
    assert problems["yaw_rate_dps"] == "nothing at all comes from 'quiet'"
    assert problems["tunnel_rpm"] == "source 'gone' cannot be opened"
    assert problems["north_m"] == "no source provides it"
    assert found.free_bytes is not None
    assert any("/dev/nowhere" in event for event in found.events)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["trial.toml"]


def test_a_check_on_the_command_line_leaves_by_its_exit_code(tmp_path: Path) -> None:
    port = free_port()
    text = config_text(f'type = "udp"\nport = {port}\n', NAMES, clock="receiver")
    (tmp_path / "trial.toml").write_text(text)
    arguments = ["record", "--check", str(tmp_path / "trial.toml"), "--duration", "0.3"]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 1
    assert "nothing at all comes from 'line'" in " ".join(result.output.split())
    result = CliRunner().invoke(app, [*arguments, "--json"])
    found = json.loads(next(line for line in result.output.splitlines() if line.startswith("{")))
    assert found["ready"] is False
    assert found["missing"] == list(NAMES)


@pytest.mark.parametrize("arguments", [["record", "x.toml"], ["record", "x.toml", "-o", "y", "--log", "xml"]])
def test_wrong_usage_is_exit_code_2(arguments: list[str]) -> None:
    assert CliRunner().invoke(app, arguments).exit_code == 2


def test_keys_set_marks(tmp_path: Path) -> None:
    """The configured ones by their text, m by a number; the terminal is as it was afterwards."""
    near, far = pty.openpty()
    before = __import__("termios").tcgetattr(far)
    port = free_port()
    text = config_text(f'type = "udp"\nport = {port}\n', ("heading_deg",), clock="receiver")
    (tmp_path / "trial.toml").write_text(text + '[marks]\n"z" = "start zigzag"\n')
    process = subprocess.Popen(
        [sys.executable, str(ROOT / "seatrial.py"), "record", str(tmp_path / "trial.toml"),
         "-o", str(tmp_path / "out")],
        stdin=far, stdout=subprocess.PIPE, stderr=far, text=True, cwd=ROOT,
        env={**os.environ, "TERM": "xterm", "SEATRIAL_RUNTIME": str(tmp_path / "run")},
    )  # fmt: skip
    shown = io.BytesIO()

    def watch() -> None:
        try:
            while data := os.read(near, 65_536):
                shown.write(data)
        except OSError:
            pass

    threading.Thread(target=watch, daemon=True).start()
    wait_for(lambda: b"waiting" in shown.getvalue())
    os.write(near, b"zmqm")
    wait_for(lambda: b"mark 2" in shown.getvalue())
    process.send_signal(signal.SIGINT)
    stdout, _ = process.communicate(timeout=PATIENCE_S)
    assert __import__("termios").tcgetattr(far) == before
    os.close(far)
    texts = [text for _, text in read_recording(stdout.strip()).events]
    assert [text for text in texts if text in ("start zigzag", "mark 1", "mark 2")] == [
        "start zigzag",
        "mark 1",
        "mark 2",
    ]
    assert b"z start zigzag" in shown.getvalue()
