"""Attacks on the recorder by the peers of its sinks: whatever they do, the recording lacks nothing."""

from __future__ import annotations

import re
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from pathlib import Path
from types import TracebackType
from typing import Any

import pytest

from seatrial.acquisition.recording.messages import HEALTH_TOPIC
from seatrial.acquisition.recording.reader import MessageStream
from tests.attacks.commands import PATIENCE_S
from tests.attacks.hostile_broker import packet
from tests.attacks.recorder import attacked

TOKEN = "t0ken-that-nobody-may-read"
CONNECTED = packet(0x20, bytes([0, 0]))


class Peer:
    """A server on a port of its own that does one and the same to everybody who connects."""

    def __init__(self, behave: Callable[[socket.socket], object]) -> None:
        self._server = socket.create_server(("127.0.0.1", 0))
        self._server.settimeout(0.1)
        self.port = self._server.getsockname()[1]
        self._behave, self._ending = behave, threading.Event()
        self._thread = threading.Thread(target=self._serve, daemon=True)

    def __enter__(self) -> Peer:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None
    ) -> None:
        self._ending.set()
        self._thread.join()
        self._server.close()

    def _serve(self) -> None:
        while not self._ending.is_set():
            with suppress(OSError):
                client, _ = self._server.accept()
                threading.Thread(target=self._attend, args=(client,), daemon=True).start()

    def _attend(self, client: socket.socket) -> None:
        with client, suppress(OSError):
            client.settimeout(PATIENCE_S)
            self._behave(client)


def silent(client: socket.socket) -> None:
    """Takes whatever comes, and answers nothing."""
    while client.recv(65_536):
        pass


def never_reads(client: socket.socket) -> None:
    time.sleep(PATIENCE_S)


def hangs_up(client: socket.socket) -> None:
    client.recv(10)


def talks_nonsense(client: socket.socket) -> None:
    client.recv(65_536)
    client.sendall(bytes(range(256)) * 400)


def echoes(client: socket.socket) -> None:
    """Gives back what it gets, with the token in it, as an error."""
    text = client.recv(65_536)
    client.sendall(b"HTTP/1.1 500 no\r\nContent-Length: %d\r\n\r\n%s" % (len(text), text))


def trickles(client: socket.socket) -> None:
    """Answers a letter every now and then, without end."""
    client.recv(65_536)
    client.sendall(b"HTTP/1.1 200 OK\r\n")
    while True:
        client.sendall(b"X-Next: x\r\n")
        time.sleep(0.2)


def answers_without_end(client: socket.socket) -> None:
    client.recv(65_536)
    client.sendall(b"HTTP/1.1 200 OK\r\nContent-Length: 1000000000000\r\n\r\n")
    while True:
        client.sendall(bytes(65_536))


def accepts(client: socket.socket) -> None:
    """A server of InfluxDB that works."""
    while head := client.recv(65_536):
        before, _, body = head.partition(b"\r\n\r\n")
        size = int(before.lower().partition(b"content-length: ")[2].partition(b"\r")[0])
        while len(body) < size:
            body += client.recv(65_536)
        client.sendall(b"HTTP/1.1 204 No Content\r\n\r\n")


def connects_and_reads_no_more(client: socket.socket) -> None:
    """A broker that lets in, and then takes nothing."""
    client.recv(4096)
    client.sendall(CONNECTED)
    time.sleep(PATIENCE_S)


HTTP = {kind.__name__: kind for kind in (
    silent, never_reads, hangs_up, talks_nonsense, echoes, trickles, answers_without_end,
)}  # fmt: skip
BROKERS = {kind.__name__: kind for kind in (silent, hangs_up, talks_nonsense, connects_and_reads_no_more)}


def section(name: str, kind: str, port: int, token: Path, more: str = "") -> str:
    common = f'[[sink]]\nname = "{name}"\nrate_hz = 1e10\nqueue_values = 100\n{more}'
    if kind == "mqtt":
        return f'{common}type = "mqtt"\nport = {port}\nuser = "me"\npassword_file = "{token}"\n'
    if kind == "http":
        return f'{common}type = "influx"\nurl = "http://127.0.0.1:{port}"\nbucket = "b"\ntoken_file = "{token}"\n'
    return f'{common}type = "influx"\nurl = "{kind}://127.0.0.1:{port}"\n'


def last_states(paths: list[Path]) -> dict[str, dict[str, Any]]:
    """The last word of the recordings on each sink."""
    bodies = (entry.decode_body() for path in paths for entry in MessageStream(path) if entry.topic == HEALTH_TOPIC)
    return {body["source"].removeprefix("sink "): body for body in bodies if body["source"].startswith("sink ")}


SECONDS = pytest.mark.parametrize(
    ("seconds", "rate_hz"),
    [pytest.param(6.0, 200.0, id="quick"), pytest.param(40.0, 1000.0, id="long", marks=pytest.mark.attack)],
)


@SECONDS
def test_peers_of_sinks_that_refuse_hang_or_misbehave_cost_the_recording_nothing(
    seconds: float, rate_hz: float, tmp_path: Path
) -> None:
    """All at once, and a sink beside them that works loses nothing; no secret is in recording, log or state."""
    token = tmp_path / "token"
    token.write_text(f"{TOKEN}\n")
    with ExitStack() as stack:
        sections = [section("closed", "http", 1, token), section("closed_broker", "mqtt", 1, token)]
        for kind, behaviours in (("http", HTTP), ("mqtt", BROKERS), ("tcp", {"never_reads": never_reads})):
            for name, behave in behaviours.items():
                peer = stack.enter_context(Peer(behave))
                sections.append(section(f"{kind}_{name}", kind, peer.port, token))
        peer = stack.enter_context(Peer(accepts))
        sections.append(section("works", "http", peer.port, token).replace("= 100\n", "= 100000\n"))
        recorder = stack.enter_context(
            attacked(tmp_path, tmp_path / "out", rate_hz, "", sections="".join(sections))
        )
        recorder.record(seconds)
        began_s = time.monotonic()
        paths = recorder.assert_complete()
        assert time.monotonic() - began_s < 60.0
    states = last_states(paths)
    assert len(states) == len(sections)
    works = states.pop("works")
    assert (works["dropped"], works["error"], works["state"]) == (0, "", "open")
    assert works["sent"] > 0.5 * (seconds - 4.0) * rate_hz
    assert states.pop("tcp_never_reads")["state"] == "open"  # what the system took counts as sent
    assert states.pop("http_answers_without_end")["sent"] > 0  # it says that it has taken them
    states.pop("mqtt_connects_and_reads_no_more")  # the system takes a megabyte or two for it
    assert states.pop("http_trickles")["dropped"] > 0  # it hangs after 15 s, and fails after a hundred headers
    for name, state in states.items():
        assert state["state"] in ("failed", "hanging", "opening"), (name, state)
        assert state["dropped"] > 0, (name, state)
        assert state["error"], (name, state)
    everything = b"".join(path.read_bytes() for path in paths) + recorder.log.encode()
    assert TOKEN.encode() not in everything
    for name in states:
        assert recorder.log.count(f"sink '{name}' fails") <= 1, recorder.log[-3000:]


@SECONDS
def test_a_server_that_is_killed_and_comes_back_gets_what_still_waits(
    seconds: float, rate_hz: float, tmp_path: Path
) -> None:
    """Killed amid its work and started again, with a queue that is long enough: nothing is missing there either."""
    script, got = tmp_path / "server.py", tmp_path / "got"
    script.write_text(SERVER)
    token = tmp_path / "token"
    token.write_text(f"{TOKEN}\n")
    probe = socket.create_server(("127.0.0.1", 0))
    port = probe.getsockname()[1]
    probe.close()

    def start() -> subprocess.Popen[bytes]:
        return subprocess.Popen([sys.executable, script, str(port), got])

    with ExitStack() as stack:
        server = start()
        more = section("ashore", "http", port, token).replace("= 100\n", "= 100000\n")
        recorder = stack.enter_context(attacked(tmp_path, tmp_path / "out", rate_hz, "", sections=more))
        try:
            recorder.wait_for(lambda: got.exists() and got.stat().st_size > 0)
            for times in range(1, 4):
                server.kill()
                server.wait()
                recorder.record(seconds / 6.0)
                recorder.wait_for(lambda times=times: recorder.log.count("it is tried again") >= times)
                server = start()
                size = got.stat().st_size
                recorder.wait_for(lambda size=size: got.stat().st_size > size)
            paths = recorder.assert_complete()
        finally:
            server.kill()
            server.wait()
    headings = re.findall(r"heading_deg=(\S+) ", got.read_text())  # not of a line that a kill cut off
    sent = {float(f"{number % 360}.{number:08d}") for number in range(recorder.line.sent)}
    assert not sent.difference(map(float, headings))
    assert sum("works again" in line for line in recorder.log.splitlines()) == 3
    assert last_states(paths)["ashore"]["dropped"] == 0


SERVER = """
import http.server, os, sys

class Handler(http.server.BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"

    def do_POST(self):
        body = self.rfile.read(int(self.headers["Content-Length"]))
        descriptor = os.open(sys.argv[2], os.O_WRONLY | os.O_APPEND | os.O_CREAT)
        os.write(descriptor, body)
        os.close(descriptor)
        self.send_response(204)
        self.end_headers()

    def log_message(self, *_):
        pass

http.server.ThreadingHTTPServer(("127.0.0.1", int(sys.argv[1])), Handler).serve_forever()
"""


def test_a_recorder_that_gets_no_thread_for_a_sink_records_without_it(tmp_path: Path) -> None:
    from seatrial.acquisition.config.trial_file import parse_config
    from seatrial.acquisition.logger.pipeline import initial_health
    from seatrial.acquisition.logger.sinks import Sinks

    config = parse_config(
        '[trial]\nname = "x"\n[[source]]\nname = "line"\ntype = "udp"\nport = 20001\nchannels = ["heading_deg"]\n'
        + section("out", "udp", 9, tmp_path / "token"),
        tmp_path / "trial.toml",
    )
    health, texts = initial_health(config), list[str]()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(threading.Thread, "start", _no_thread)
        sinks = Sinks(config)
        assert sinks.start(health.sinks, lambda level, text: texts.append(text)) == []
        sinks.stop()
    assert texts == ["sink 'out' is left out: the system gives no thread"]
    assert health.sinks["out"].state == "failed"


def _no_thread(thread: threading.Thread) -> None:
    raise RuntimeError("can't start new thread")
