"""The live view: what a viewer sees over the WebSocket, and that it can do the recorder no harm."""

from __future__ import annotations

import base64
import json
import socket
import struct
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from acquisition.config.sections import LiveSection
from acquisition.core.errors import ConfigurationError, SourceError
from acquisition.core.trial import Trial
from acquisition.logger.live_view import LiveView
from acquisition.logger.requests import running_recorders, send_prediction
from acquisition.recording.messages import Topic, decode
from acquisition.recording.reader import read_recording
from acquisition.recording.schemas import kind_of
from tests.acquisition.conftest import PATIENCE_S, free_port, recorded_count, wait_for
from tests.acquisition.test_predictions import BODY, GEOJSON, RECORDED, Recording

websockets = pytest.importorskip("websockets.sync.client")
LAYOUT = Path(__file__).parents[2] / "trials" / "foxglove_layout.json"
MESSAGE_DATA = 1  # the protocol's operation code for a message


def wanted(channel: dict[str, Any]) -> dict[str, int]:
    return {"id": channel["id"], "channelId": channel["id"]}


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


@pytest.fixture
def recording(tmp_path: Path) -> Iterator[Watched]:
    running = Watched(tmp_path)
    running.thread.start()
    yield running
    running.stop.set()
    running.thread.join()


def test_a_viewer_sees_channels_with_schemas_and_values(recording: Watched) -> None:
    with recording.viewer() as viewer:
        topics: dict[int, str] = {}
        values: list[float] = []
        until_s = time.monotonic() + PATIENCE_S
        while len(values) < 5 and time.monotonic() < until_s:
            recording.say(1)
            said = viewer.recv(timeout=PATIENCE_S)
            if isinstance(said, str):
                for channel in json.loads(said).get("channels", []):
                    topics[channel["id"]] = channel["topic"]
                    assert base64.b64decode(channel["schema"]) == kind_of(channel["topic"]).descriptors
                    viewer.send(
                        json.dumps(
                            {
                                "op": "subscribe",
                                "subscriptions": [{"id": channel["id"], "channelId": channel["id"]}],
                            }
                        )
                    )
            elif said[0] == MESSAGE_DATA:
                number, time_ns = struct.unpack("<IQ", said[1:13])
                assert abs(time_ns - time.time_ns()) < 60e9
                if topics[number] == "/channel/heading_deg":
                    values.append(decode(Topic("/channel/heading_deg"), said[13:])["value"])
    assert set(values) == {0.0}
    assert not any(topic.startswith("/raw") for topic in topics.values())


def test_a_viewer_sees_predictions_and_their_track_on_the_map(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SEATRIAL_RUNTIME", str(tmp_path / "run"))
    running = Watched(tmp_path)
    running.thread.start()
    try:
        with running.viewer() as viewer:
            wait_for(lambda: bool(running_recorders()))
            assert send_prediction(running_recorders()[0][0], BODY, GEOJSON) == ""  # it makes the topics known
            channels = {}
            while len(channels) < 2:
                said = viewer.recv(timeout=PATIENCE_S)
                for each in json.loads(said).get("channels", []) if isinstance(said, str) else []:
                    if each["topic"].startswith("/prediction"):
                        channels[each["topic"]] = each
            assert channels["/prediction/track"]["schemaName"] == "foxglove.GeoJSON"
            viewer.send(
                json.dumps({"op": "subscribe", "subscriptions": [wanted(each) for each in channels.values()]})
            )
            found: dict[int, Any] = {}
            until_s = time.monotonic() + PATIENCE_S
            while len(found) < 2 and time.monotonic() < until_s:
                send_prediction(running_recorders()[0][0], BODY, GEOJSON)  # may be refused: two a second are taken
                with suppress(TimeoutError):
                    said = viewer.recv(timeout=0.7)
                    if not isinstance(said, str) and said[0] == MESSAGE_DATA:
                        found[struct.unpack("<I", said[1:5])[0]] = said[13:]
            told = {topic: decode(Topic(topic), found[each["id"]]) for topic, each in channels.items()}
            assert told == {"/prediction": RECORDED, "/prediction/track": {"geojson": GEOJSON}}
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
        message, field = kind_of(topic).message.DESCRIPTOR, None
        for name in fields:
            field = message.fields_by_name[name]
            message = field.message_type
        assert path.endswith("[:]") == (field is not None and field.is_repeated), path
    shown = {path.partition(".")[0] for path in paths}
    from acquisition.core.channels import CHANNELS

    assert {each.topic for each in CHANNELS} - shown == {"/channel/north_m", "/channel/east_m"}  # on the map
    assert {"/position", "/event", "/health", "/prediction"} <= shown
