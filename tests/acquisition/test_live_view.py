"""The live view: what a viewer sees over the WebSocket, and that it can do the recorder no harm."""

from __future__ import annotations

import base64
import json
import socket
import struct
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from seatrial.acquisition.config.sources import LiveSection
from seatrial.acquisition.config.trial_file import load_config
from seatrial.acquisition.core.errors import ConfigurationError, SourceError
from seatrial.acquisition.core.trial import Trial
from seatrial.acquisition.logger.health import Health, check_alarms
from seatrial.acquisition.logger.pipeline import initial_health
from seatrial.acquisition.logger.record import LiveView, record
from seatrial.acquisition.logger.requests import running_recorders, send_prediction
from seatrial.acquisition.logger.survey import check_before_departure
from seatrial.acquisition.recording.messages import Topic, decode, message_kind_of_topic
from seatrial.acquisition.recording.reader import read_recording
from tests.acquisition.conftest import PATIENCE_S, free_port, recorded_count, wait_for
from tests.acquisition.test_predictions import BODY, GEOJSON, RECORDED, Recording

websockets = pytest.importorskip("websockets.sync.client")
from websockets.exceptions import ConnectionClosed  # noqa: E402  (after the skip)

LAYOUT = Path(__file__).parents[2] / "trials" / "foxglove_layout.json"
ALARMED = """
[trial]
name = "alarmed"

[[source]]
name = "line"
type = "udp"
port = 10110
channels = ["heading_deg"]

[live]

[[alarm]]
name = "view"
figure = "sink.live view.dropped"
above = 100

[[alarm]]
name = "heading"
figure = "heading_deg.age_s"
above = 10
"""
MESSAGE_DATA = 1  # the protocol's operation code for a message


class Watched(Recording):
    """A recorder in a thread with a live view, fed by datagrams."""

    def __init__(self, folder: Path) -> None:
        self.live_port = free_port(socket.SOCK_STREAM)
        super().__init__(folder, f"[live]\nport = {self.live_port}\n")

    def viewer(self) -> Any:
        until_s = time.monotonic() + PATIENCE_S
        while True:
            try:
                return websockets.connect(f"ws://127.0.0.1:{self.live_port}", subprotocols=["foxglove.sdk.v1"])
            except OSError:
                assert time.monotonic() < until_s
                time.sleep(0.05)

    def seen(self, wanted: str, act: Callable[[], object]) -> Iterator[tuple[dict[str, Any], int, bytes]]:
        """Every message under a topic that begins with ``wanted``, as (channel, time [ns], data).

        ``act`` is called over and over, so that there is something to see. On a busy machine the server ignores a
        subscription that comes before it has finished making the channel known, and it may close a connection: a
        viewer connects again after a while, as a person would, also while it sees other channels.
        """
        until_s = time.monotonic() + PATIENCE_S
        while time.monotonic() < until_s:
            channels: dict[int, dict[str, Any]] = {}
            connected_s = time.monotonic()
            with suppress(ConnectionClosed), self.viewer() as viewer:
                while time.monotonic() < connected_s + 10:
                    act()
                    with suppress(TimeoutError):
                        said = viewer.recv(timeout=0.5)
                        if isinstance(said, str):
                            new = json.loads(said).get("channels", [])
                            channels |= {each["id"]: each for each in new if each["topic"].startswith(wanted)}
                            subscriptions = [{"id": each["id"], "channelId": each["id"]} for each in new]
                            viewer.send(json.dumps({"op": "subscribe", "subscriptions": subscriptions}))
                        elif said[0] == MESSAGE_DATA and (channel := channels.get(*struct.unpack("<I", said[1:5]))):
                            yield channel, *struct.unpack("<Q", said[5:13]), said[13:]


@pytest.fixture
def recording(tmp_path: Path) -> Iterator[Watched]:
    running = Watched(tmp_path)
    running.thread.start()
    yield running
    running.stop.set()
    running.thread.join()


def test_a_viewer_sees_channels_with_schemas_and_values(recording: Watched) -> None:
    seen = []
    for channel, time_ns, data in recording.seen("/", lambda: recording.say(1)):
        assert base64.b64decode(channel["schema"]) == message_kind_of_topic(channel["topic"]).descriptors
        assert not channel["topic"].startswith("/raw")
        assert abs(time_ns - time.time_ns()) < 60e9
        if channel["topic"] == "/channel/heading_deg":
            seen.append(decode(Topic("/channel/heading_deg"), data)["value"])
        if len(seen) == 5:
            break
    assert seen == [0.0] * 5


def test_a_viewer_sees_predictions_and_their_track_on_the_map(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SEATRIAL_RUNTIME", str(tmp_path / "run"))
    running = Watched(tmp_path)
    running.thread.start()
    try:
        wait_for(lambda: bool(running_recorders()))
        recorder = running_recorders()[0][0]  # it may refuse a prediction: two a second are taken
        seen: dict[str, Any] = {}
        for channel, _, data in running.seen("/prediction", lambda: send_prediction(recorder, BODY, GEOJSON)):
            seen[channel["topic"]] = (channel["schemaName"], decode(Topic(channel["topic"]), data))
            if len(seen) == 2:
                break
        assert seen["/prediction"][1] == RECORDED
        assert seen["/prediction/track"] == ("foxglove.GeoJSON", {"geojson": GEOJSON})
    finally:
        running.stop.set()
        running.thread.join()


def test_a_viewer_that_reads_nothing_costs_the_recording_nothing(recording: Watched) -> None:
    with recording.viewer():
        for _ in range(50):
            recording.say(100)
            time.sleep(0.01)
        wait_for(lambda: recorded_count(recording.folder / "out") == 5000)
        recording.stop.set()
        recording.thread.join()
    found = read_recording(recording.paths[0])
    assert found.raw["/raw/nmea0183/line"] == 5000
    assert found.series["heading_deg"].value.size == 5000


def test_a_port_that_is_taken_is_a_clear_error() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        settings = LiveSection(port=server.getsockname()[1])
        with (
            pytest.raises(SourceError, match=r"cannot be served on 127\.0\.0\.1"),
            LiveView(settings, Trial(name="x")),
        ):
            pass


def test_without_the_package_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "foxglove", None)
    view = LiveView(LiveSection(), Trial(name="x"))
    with pytest.raises(ConfigurationError, match=r"pip install 'seatrial\[live\]'"), view:
        pass


def test_alarms_know_the_counts_of_the_live_view_before_it_begins(tmp_path: Path) -> None:
    """A recording starts with an alarm on them, and one on a misspelt figure is refused with the near ones."""
    path = tmp_path / "trial.toml"
    path.write_text(ALARMED)
    config = load_config(path)
    figures = initial_health(config).figures(0)
    assert {f"sink.live view.{count}" for count in ("sent", "dropped", "failed")} <= figures.keys()
    check_alarms(config.alarms, initial_health(config))
    path.write_text(ALARMED.replace("heading_deg.age_s", "heading_dge.age_s"))
    misspelt = load_config(path)
    for start in (lambda: check_before_departure(misspelt, 0.1), lambda: record(misspelt, tmp_path / "out", 0.1)):
        with pytest.raises(ConfigurationError, match=r"alarm 'heading'.*'heading_dge.age_s'.*heading_deg.age_s"):
            start()


def test_view_that_cannot_be_served_fails_in_its_figures() -> None:
    """So that an alarm on it is raised."""
    health = Health({}, {})
    with socket.create_server(("127.0.0.1", 0)) as server:
        view = LiveView(LiveSection(port=server.getsockname()[1]), Trial(name="x"))
        health.sinks = {view.health.name: view.health}
        assert health.figures(0)["sink.live view.failed"] == 0.0
        with pytest.raises(SourceError), view:
            pass
    assert health.figures(0)["sink.live view.failed"] == 1.0


def _strings(node: Any) -> Iterator[str]:
    if isinstance(node, str):
        yield node
    elif isinstance(node, dict | list):
        for each in node.values() if isinstance(node, dict) else node:
            yield from _strings(each)


def test_the_layout_shows_what_a_recording_holds() -> None:
    """Every path in it is a field of a topic of ours, every panel in the picture is described, the map is there."""
    layout = json.loads(LAYOUT.read_text())
    panels = set(layout["configById"])
    assert {text for text in _strings(layout["layout"]) if "!" in text} == panels
    assert {panel.partition("!")[0] for panel in panels} >= {"map", "Plot", "RosOut"}
    paths = [text for text in _strings(layout["configById"]) if text.startswith("/")]
    for path in paths:
        topic, *fields = path.removesuffix("[:]").split(".")
        message, field = message_kind_of_topic(topic).message.DESCRIPTOR, None
        for name in fields:
            field = message.fields_by_name[name]
            message = field.message_type
        assert path.endswith("[:]") == (field is not None and field.is_repeated), path
    shown = {path.partition(".")[0] for path in paths}
    from seatrial.acquisition.core.ship import CHANNELS

    assert {each.topic for each in CHANNELS} - shown == {"/channel/north_m", "/channel/east_m"}  # on the map
    assert {"/position", "/event", "/health", "/prediction"} <= shown
