"""What other programs say to a recorder: what it takes, what it refuses, and that nobody can hold it up."""

from __future__ import annotations

import copy
import json
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from typer.testing import CliRunner

from seatrial import app
from seatrial.acquisition.config.trial_file import load_config
from seatrial.acquisition.logger.health import Health, Predictions, describe_schema_violation
from seatrial.acquisition.logger.record import record
from seatrial.acquisition.logger.requests import (
    MOST_BYTES,
    RecorderState,
    RequestServer,
    ask_server,
    running_recorders,
    send_mark,
    send_prediction,
)
from seatrial.acquisition.logger.survey import redecode
from seatrial.acquisition.protocols.nmea0183 import frame_sentence
from seatrial.acquisition.recording.messages import (
    PREDICTED_TRACK_TOPIC,
    PREDICTION,
    PREDICTION_TOPIC,
    Topic,
    decode,
)
from seatrial.acquisition.recording.reader import MessageStream, describe_recording, read_recording
from seatrial.acquisition.recording.recover import recover
from tests.acquisition.conftest import PATIENCE_S, SimulatedClock, config_text, free_port, wait_for

BODY: dict[str, Any] = {
    "start": 1_790_000_000.0, "made_at": 1_790_000_000.4, "latency_s": 0.2, "horizon_s": 2, "method": "reference",
    "vessel": "gunnerus_short", "calibrator": "", "outside_training_range": False, "held_channels": [],
    "track": {
        "seconds": [0, 1, 2], "north_m": [0.0, 1.0, 2.0], "east_m": [0.0, 0.0, 0.5],
        "heading_deg": [0.0, 1.0, 359.0], "band_m": [], "band_along_m": [], "band_across_m": [],
        "latitude_deg": [63.0, 63.00001, 63.00002], "longitude_deg": [10.0, 10.0, 10.00001],
    },
    "running": {"over_s": 300.0, "predictions": 0, "left_out": 0},
}  # fmt: skip
RECORDED = {**BODY, "planned_channels": []}
"""As it is read again: a list that was left out is empty."""
WHO = RecorderState("bay", "/bay.toml", "/out/bay.mcap", False, 7, 0, 0)
GEOJSON = '{"type":"LineString","coordinates":[[10.0,63.0],[10.00001,63.00002]]}'


class Ear:
    """A recorder's ear without the recorder."""

    def __init__(self, folder: Path) -> None:
        self.marks: list[str] = []
        self.health = Health({})
        self.predictions = Predictions(self.health)
        self.hearing = RequestServer(
            lambda text, at_ns: self.marks.append(text), lambda: WHO, self.predictions, folder
        )


@pytest.fixture
def ear(tmp_path: Path) -> Iterator[Ear]:
    hearing = Ear(tmp_path)
    with hearing.hearing:
        yield hearing


def changed(path: str, value: Any) -> dict[str, Any]:
    """The body with one thing put otherwise, or taken away (value ``...``)."""
    body = copy.deepcopy(BODY)
    *outer, last = path.split(".")
    inner = body
    for key in outer:
        inner = inner[key]
    if value is ...:
        del inner[last]
    else:
        inner[last] = value
    return body


def test_a_recorder_says_who_it_is_and_still_takes_marks(ear: Ear, tmp_path: Path) -> None:
    assert running_recorders(tmp_path) == [(ear.hearing.path, WHO)]
    assert send_mark("start", tmp_path) == 1
    assert ear.marks == ["start"]


def test_who_does_not_know_the_question_is_no_recorder_to_follow(tmp_path: Path) -> None:
    """A recorder of an older version, which knows marks only, and a socket that was left behind."""

    class MarksOnly(RequestServer):
        def answer(self, said: bytes) -> bytes:
            return b"ok" if json.loads(said)["text"] else b""

    stale = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    stale.bind(str(tmp_path / "1-a.sock"))
    stale.close()
    with MarksOnly(lambda text, at_ns: None, lambda: WHO, Predictions(Health({})), tmp_path):
        assert running_recorders(tmp_path) == []


def test_what_fits_is_taken_in(ear: Ear) -> None:
    assert send_prediction(ear.hearing.path, BODY, GEOJSON) == ""
    (foretold,) = ear.predictions.take()
    assert decode(Topic(PREDICTION_TOPIC), foretold.data) == RECORDED
    assert decode(Topic(PREDICTED_TRACK_TOPIC), foretold.geojson) == {"geojson": GEOJSON}
    assert foretold.start_ns == 1_790_000_000_000_000_000


@pytest.mark.parametrize(
    ("body", "why"),
    [
        ("x", "a prediction is no object"),
        (None, "a prediction is no object"),
        (changed("start", ...), "start is missing"),
        (changed("start", "now"), "start is no number"),
        (changed("start", True), "start is no number"),
        (changed("start", 1e300), "start is no number that can be meant"),
        (changed("start", float("nan")), "start is no number that can be meant"),
        (changed("start", 10**400), "start is no number that can be meant"),
        (changed("more", 1), "a prediction has an unknown 'more'"),
        (changed("method", "x" * 300), "method has more than 200 letters"),
        (changed("method", "\ud800"), "surrogates"),
        (changed("track.north_m", [0.0, None, 1.0]), "an item of north_m is no number"),
        (changed("track.north_m", [0.0, 1.0]), "north_m of the track is not as long as its seconds"),
        (changed("track.north_m", []), "north_m of the track is not as long as its seconds"),
        (changed("track.band_m", [0.0]), "band_m of the track is not as long as its seconds"),
        (changed("track.seconds", [0.0] * 700), "seconds has more than 601 items"),
        (changed("error", None), "error is no object"),
        (changed("error", {"method": "x"}), "start is missing"),
        (changed("running.over_s", None), "over_s is no number"),
    ],
)
def test_what_does_not_fit_is_refused_with_a_word_and_counted(ear: Ear, body: Any, why: str) -> None:
    answer = ask_server(ear.hearing.path, json.dumps({"prediction": body}).encode())
    assert answer is not None
    assert answer.startswith(b"refused: ")
    assert why in answer.decode()
    assert ear.predictions.take() == []
    assert ear.health.predictions_refused == 1


@pytest.mark.parametrize("geojson", [5, "x" * 40_000])
def test_a_map_that_is_no_text_of_bounded_length_is_refused(ear: Ear, geojson: Any) -> None:
    answer = ask_server(ear.hearing.path, json.dumps({"prediction": BODY, "geojson": geojson}).encode())
    assert b"geojson is no text" in (answer or b"")


def test_what_is_longer_than_the_limit_is_not_heard_to_its_end(ear: Ear) -> None:
    message = json.dumps({"prediction": BODY, "more": "x" * MOST_BYTES}).encode()
    assert ask_server(ear.hearing.path, message) is None
    assert ear.predictions.take() == []
    assert send_mark("after", ear.hearing.path.parent) == 1


def test_more_than_two_a_second_are_refused_and_never_pile_up(
    tmp_path: Path, clock: SimulatedClock, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Four are taken at once, then two a second."""
    monkeypatch.setattr("seatrial.acquisition.logger.health.time", clock)
    ear, answers = Ear(tmp_path), list[str]()
    with ear.hearing:
        for _ in range(160):
            clock.sleep(0.01)
            answers.append(send_prediction(ear.hearing.path, BODY))
            ear.predictions.take()  # the recorder has nothing else to do
    assert answers.count("") == 4 + 3
    assert ear.health.predictions_refused == 160 - 7
    assert set(answers) == {"", "more than 2 predictions a second"}


def test_a_recorder_that_does_not_come_by_holds_a_few_and_no_more(ear: Ear) -> None:
    for _ in range(8):
        send_prediction(ear.hearing.path, BODY)
        ear.predictions._allowed = 4.0  # as if time had passed
    assert len(ear.predictions.take()) == 4


def test_clients_that_stall_in_the_middle_of_a_word_hold_up_no_mark(
    ear: Ear, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As many as there may be at once, and more: a mark is heard while they are still waited for."""
    monkeypatch.setattr("seatrial.acquisition.logger.requests.PATIENCE_S", 10 * PATIENCE_S)
    with ExitStack() as stack:
        for _ in range(40):
            client = stack.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_STREAM))
            client.connect(str(ear.hearing.path))
            with suppress(OSError):  # it had to go to make room
                client.sendall(b'{"prediction": {')
        assert send_mark("start", ear.hearing.path.parent) == 1
    assert ear.marks == ["start"]


def test_a_client_that_stalls_is_parted_with(ear: Ear, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("seatrial.acquisition.logger.requests.PATIENCE_S", 0.6)
    began_s = time.monotonic()
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as client:
        client.connect(str(ear.hearing.path))
        client.sendall(b"{")
        client.settimeout(PATIENCE_S)
        assert client.recv(10) == b""
    assert time.monotonic() - began_s >= 0.6


def test_every_viewer_can_read_the_schema() -> None:
    """Each type is one word and each object names its properties: Lichtblick refuses a topic otherwise."""

    def look(schema: dict[str, Any], name: str) -> None:
        assert schema["type"] in ("object", "array", "number", "string", "boolean"), name
        if schema["type"] == "object":
            for key, each in schema["properties"].items():
                look(each, f"{name}.{key}")
        elif schema["type"] == "array":
            look(schema["items"], f"{name}[]")
        if name.count(".") and not name.endswith("[]"):
            assert schema["description"], name

    look(PREDICTION, "it")
    assert describe_schema_violation(BODY, PREDICTION) == ""


class Recording:
    """A recorder in a thread, fed by datagrams."""

    def __init__(self, folder: Path, more: str = "") -> None:
        self.port, self.folder = free_port(), folder
        text = config_text(f'type = "udp"\nport = {self.port}\n', ("heading_deg",), clock="receiver")
        (folder / "trial.toml").write_text(text + more)
        self.stop, self.paths = threading.Event(), list[Path]()
        self.thread = threading.Thread(target=self.run)

    def run(self) -> None:
        paths, _ = record(load_config(self.folder / "trial.toml"), self.folder / "out", None, self.stop)
        self.paths.extend(paths)

    def say(self, count: int) -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            for number in range(count):
                sender.sendto(frame_sentence(f"HEHDT,{number % 360},T"), ("127.0.0.1", self.port))


def test_predictions_are_in_the_recording_and_every_reader_copes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Read, described, recovered, decoded again: the samples are the same, and the predictions are kept."""
    monkeypatch.setenv("SEATRIAL_RUNTIME", str(tmp_path / "run"))
    running = Recording(tmp_path)
    running.thread.start()
    wait_for(lambda: bool(running_recorders(tmp_path / "run")))
    ((path, who),) = running_recorders(tmp_path / "run")
    assert who.trial == "round trip"
    assert who.configuration == str(tmp_path / "trial.toml")
    running.say(50)
    before_ns = time.time_ns()
    assert send_prediction(path, BODY, GEOJSON) == ""
    assert "start is missing" in send_prediction(path, changed("start", ...))
    running.say(50)
    wait_for(lambda: running_recorders(tmp_path / "run")[0][1].predictions == 1)
    after_ns = time.time_ns()
    assert running_recorders(tmp_path / "run")[0][1].predictions_refused == 1
    running.stop.set()
    running.thread.join()
    (recording,) = running.paths
    assert str(recording) == who.recording
    recover(recording, tmp_path / "recovered.mcap")
    redecode([recording], tmp_path / "redecoded.mcap")
    for each in (recording, tmp_path / "recovered.mcap", tmp_path / "redecoded.mcap"):
        assert read_recording(each).series["heading_deg"].value.size == 100, each
        assert describe_recording(read_recording(each))["channels"]["heading_deg"]["count"] == 100
        assert read_recording(each).predictions == 1
        assert "1 predictions made beside the recorder" in CliRunner().invoke(app, ["info", str(each)]).output
        (said,) = [entry for entry in MessageStream(each) if entry.topic == "/prediction"]
        assert said.decode_body() == RECORDED
        assert before_ns - 5e6 <= said.log_ns <= after_ns + 5e6
        assert said.publish_ns == 1_790_000_000_000_000_000
    with recording.open("rb") as stream:  # as other programs see it
        found = {
            schema.name: message
            for schema, _, _, message in make_reader(
                stream, decoder_factories=[DecoderFactory()]
            ).iter_decoded_messages(topics=["/prediction", "/prediction/track"])
            if schema is not None
        }
    assert found.keys() == {"seatrial.Prediction", "foxglove.GeoJSON"}
    assert json.loads(found["foxglove.GeoJSON"].geojson)["type"] == "LineString"
