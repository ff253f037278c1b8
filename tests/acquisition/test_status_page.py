"""The status page: what the terminal shows, escaped, read-only, for this computer alone."""

from __future__ import annotations

import http.client
import json
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from seatrial.acquisition.config.sources import StatusSection
from seatrial.acquisition.config.trial_file import parse_config
from seatrial.acquisition.core.errors import SourceError
from seatrial.acquisition.core.ship import NAMES
from seatrial.acquisition.core.trial import Sample
from seatrial.acquisition.logger.health import Health, HostClock, SourceHealth
from seatrial.acquisition.logger.record import Picture, StatusPage, record
from seatrial.acquisition.recording.reader import read_recording
from tests.acquisition.conftest import config_text, free_port


@pytest.fixture
def health() -> Health:
    seen = Health({"gps": SourceHealth("gps", frames=7, dropped=2)}, part="bay.mcap", free_bytes=5_000_000_000)
    seen.clock = HostClock("kept by NTP", "chronyd", 0.0004)
    seen.events.append((1_790_000_000 * 10**9, "error", "<script>alert(1)</script> & {more}"))
    seen.alarms["wind"] = "wind: wind_speed_mps is 25, above 20"
    seen.add_sample(Sample("heading_deg", 123.5, "gps/HE:HDT", 0, seen.started_ns, 0))
    return seen


@pytest.fixture
def served(health: Health) -> Iterator[int]:
    port = free_port(socket.SOCK_STREAM)
    with StatusPage(StatusSection(port), Picture(health, frozenset(NAMES), None), "<bay>"):
        yield port


def ask(port: int, path: str, method: str = "GET", host: str = "localhost") -> tuple[int, dict[str, str], str]:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=30)
    connection.request(method, path, headers={"Host": f"{host}:{port}"})
    answer = connection.getresponse()
    return answer.status, dict(answer.getheaders()), answer.read().decode()


def test_it_shows_what_the_terminal_shows_and_no_tag_of_a_stranger(served: int) -> None:
    status, headers, text = ask(served, "/")
    assert status == 200
    for shown in (
        *NAMES,
        "123.500",
        "gps",
        "bay.mcap",
        "5.0 GB",
        "kept by NTP (chronyd), within 0.4 ms",
        "ALARM wind",
    ):
        assert shown in text
    assert "&lt;script&gt;alert(1)&lt;/script&gt; &amp; {more}" in text
    assert "<script" not in text
    assert "Ctrl-C" not in text
    assert "<title>&lt;bay&gt;</title>" in text
    assert headers["Content-Security-Policy"].startswith("default-src 'none'")


def test_the_same_for_programs(served: int) -> None:
    status, _, text = ask(served, "/status.json")
    said = json.loads(text)
    assert status == 200
    assert said["figures"]["heading_deg"] == 123.5
    assert said["figures"]["north_m"] is None
    assert said["figures"]["source.gps.dropped"] == 2
    assert said["alarms"] == {"wind": "wind: wind_speed_mps is 25, above 20"}
    assert said["events"][0]["text"].startswith("<script>")
    assert said["sources"][0]["frames"] == 7


@pytest.mark.parametrize(("path", "method", "host", "status"), [
    ("/", "POST", "localhost", 501), ("/", "PUT", "127.0.0.1", 501), ("/", "DELETE", "localhost", 501),
    ("/../etc/passwd", "GET", "localhost", 404), ("/status.json?x", "GET", "localhost", 404),
    ("/", "GET", "evil.example", 403), ("/status.json", "GET", "localhost.evil.example", 403),
])  # fmt: skip
def test_it_answers_nothing_else_and_nobody_else(
    served: int, path: str, method: str, host: str, status: int
) -> None:
    found, _, text = ask(served, path, method, host)
    assert found == status
    assert "gps" not in text


def test_nobody_reaches_it_by_another_address(served: int) -> None:
    """127.0.0.2 is this computer too, and stands for its other interfaces."""
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.2", served), timeout=30)


def test_a_client_that_says_nothing_keeps_nobody_out_for_long(served: int) -> None:
    with socket.create_connection(("127.0.0.1", served)):
        assert ask(served, "/status.json")[0] == 200


def test_a_port_in_use_is_told_and_the_recording_goes_on(tmp_path: Path, served: int, health: Health) -> None:
    with (
        pytest.raises(SourceError, match="in use"),
        StatusPage(StatusSection(served), Picture(health, frozenset(), {}), ""),
    ):
        pass
    text = config_text(f'type = "udp"\nport = {free_port()}\n') + f"\n[status]\nport = {served}\n"
    paths, _ = record(parse_config(text, tmp_path / "trial.toml"), tmp_path / "out", duration_s=0.3)
    assert any("status page cannot be served" in text for _, text in read_recording(paths[0]).events)
