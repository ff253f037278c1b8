"""Sinks: what a recorder passes on arrives as it was recorded, and nothing that a configuration keeps secret."""

from __future__ import annotations

import io
import json
import re
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from paho.mqtt.client import Client
from paho.mqtt.enums import CallbackAPIVersion
from rich.console import Console

from seatrial.acquisition.config.sources import TopicValue
from seatrial.acquisition.config.trial_file import InfluxSink, TrialConfig, parse_config
from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.acquisition.core.trial import Sample
from seatrial.acquisition.logger import pipeline
from seatrial.acquisition.logger import sinks as at_work
from seatrial.acquisition.logger.health import SinkHealth
from seatrial.acquisition.logger.pipeline import initial_health
from seatrial.acquisition.logger.record import Picture, health_as_json, record, summary_text
from seatrial.acquisition.logger.sinks import LiveSink, Sinks, check_sinks, make_link
from seatrial.acquisition.logger.survey import redecode
from seatrial.acquisition.protocols.mqtt import read_topic_value
from seatrial.acquisition.protocols.nmea0183 import frame_sentence
from seatrial.acquisition.recording.reader import read_recording
from tests.acquisition.conftest import Broker, config_text, free_port, wait_for

START_NS, SECOND = 1_790_000_000_000_000_001, 1_000_000_000
TOKEN = "s3cret-t0ken"
CHANNELS = ("heading_deg", "surge_mps")


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """What waits is sent at once."""
    monkeypatch.setattr(at_work.SinkLink, "period_s", 0.02)


def configured(sink: str, source: str = 'type = "udp"\nport = 20001\n') -> TrialConfig:
    text = config_text(source, CHANNELS).replace('"round trip"', '"sea trial, a=1"')
    return parse_config(f'{text}\n[[sink]]\nname = "out"\n{sink}', "trial.toml")


def samples(count: int) -> list[Sample]:
    """Values of both channels at 10 Hz, with times to the ns."""
    return [
        Sample(name, number / 7.0, "bus/3:127250", at_ns, at_ns, at_ns)
        for number in range(count)
        for at_ns in [START_NS + number * SECOND // 10]
        for name in CHANNELS
    ]


@contextmanager
def passing_on(config: TrialConfig) -> Iterator[tuple[Sinks, SinkHealth, list[str], Any]]:
    """The sinks of a configuration at work: their state, what they say, and what takes samples."""
    health, texts = initial_health(config), list[str]()
    sinks = Sinks(config)
    offers = sinks.start(health.sinks, lambda level, text: texts.append(text))
    try:
        yield sinks, health.sinks["out"], texts, offers[0]
    finally:
        sinks.stop()


class InfluxServer(ThreadingHTTPServer):
    """What was posted, and the answers to give, each as status and body; the last one for ever."""

    def __init__(self, *answers: tuple[int, bytes]) -> None:
        self.posts: list[tuple[str, str, bytes]] = []
        self.answers = list(answers) or [(204, b"")]
        self.closes = False
        super().__init__(("127.0.0.1", 0), InfluxRequest)
        threading.Thread(target=self.serve_forever, daemon=True).start()

    def __exit__(self, *_: object) -> None:
        self.shutdown()
        self.server_close()


class InfluxRequest(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    server: InfluxServer

    def do_POST(self) -> None:
        body = self.rfile.read(int(self.headers["Content-Length"]))
        self.server.posts.append((self.path, self.headers.get("Authorization", ""), body))
        status, text = self.server.answers.pop(0) if len(self.server.answers) > 1 else self.server.answers[0]
        self.send_response(status)
        self.send_header("Content-Length", str(len(text)))
        self.end_headers()
        self.wfile.write(text)
        self.close_connection = self.server.closes

    def log_message(self, *_: object) -> None:
        return


def influx(server: InfluxServer, more: str = 'bucket = "ship"\norg = "my org"\n') -> str:
    return f'type = "influx"\nurl = "http://127.0.0.1:{server.server_port}/api/"\n{more}'


def values_of_lines(body: bytes) -> list[tuple[str, float, int]]:
    """Channel, value and time of each line, by the rules of the line protocol for what has no blanks in it."""
    values = []
    for line in body.decode().splitlines():
        head, field, time_ns = line.replace(r"\ ", "_").split(" ")
        assert head == r"ship_log,trial=sea_trial\,_a\=1"
        name, value = field.split("=")
        values.append((name, float(value), int(time_ns)))
    return values


def expected(offered: list[Sample]) -> list[tuple[str, float, int]]:
    return [(sample.quantity, sample.value, sample.measured_ns) for sample in offered]


MORE = 'measurement = "ship log"\nrate_hz = 10\n'


@pytest.mark.parametrize(
    ("more", "path"),
    [('bucket = "ship"\norg = "my org"\n', "/api/api/v2/write?bucket=ship&org=my%20org&precision=ns"),
     ('database = "ship&1"\n', "/api/write?db=ship%261&precision=ns")],
    ids=["InfluxDB 2", "InfluxDB 1"],
)  # fmt: skip
def test_values_arrive_in_influxdb_as_recorded(more: str, path: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """To the last digit and the ns, in their order, with the token that the environment holds."""
    monkeypatch.setenv("SHIP_TOKEN", TOKEN)
    with InfluxServer() as server:
        config = configured(influx(server, f'{more}{MORE}token_variable = "SHIP_TOKEN"\n'))
        assert TOKEN not in config.text
        assert check_sinks(config) == {"out": ""}
        server.posts.clear()
        with passing_on(config) as (_, state, texts, offer):
            offered = samples(1200)
            for sample in offered:
                offer(sample)
            wait_for(lambda: state.sent == len(offered))
    assert {(place, token) for place, token, _ in server.posts} == {(path, f"Token {TOKEN}")}
    assert [value for *_, body in server.posts for value in values_of_lines(body)] == expected(offered)
    assert (state.dropped, state.error, texts, state.state) == (0, "", [], "open")


@pytest.mark.parametrize("scheme", ["tcp", "udp"])
def test_lines_arrive_at_a_port_as_recorded(scheme: str) -> None:
    kind = socket.SOCK_STREAM if scheme == "tcp" else socket.SOCK_DGRAM
    with socket.socket(socket.AF_INET, kind) as receiver:
        receiver.bind(("127.0.0.1", 0))
        receiver.settimeout(30.0)
        config = configured(f'type = "influx"\nurl = "{scheme}://127.0.0.1:{receiver.getsockname()[1]}"\n{MORE}')
        if scheme == "tcp":
            receiver.listen()
        offered, received = samples(150), list[bytes]()
        with passing_on(config) as (_, state, _texts, offer):
            for sample in offered:
                offer(sample)
            stream = receiver.accept()[0] if scheme == "tcp" else receiver
            while sum(map(len, received)) == 0 or b"".join(received).count(b"\n") < len(offered):
                received.append(stream.recv(65_536))
            stream.close()
    assert values_of_lines(b"".join(received)) == expected(offered)
    if scheme == "udp":
        assert max(map(len, received)) <= 1400
        assert all(datagram.endswith(b"\n") for datagram in received)
    assert (state.sent, state.dropped) == (len(offered), 0)


@pytest.mark.parametrize("form", ["json", "value"])
def test_values_arrive_at_a_broker_under_a_topic_each(broker: Broker, form: str) -> None:
    """A source of MQTT, which reads both forms, reads the value, the time and the unit that were recorded."""
    received = list[tuple[str, bytes]]()
    subscriber = Client(CallbackAPIVersion.VERSION2)
    subscriber.on_message = lambda *arguments: received.append((arguments[2].topic, arguments[2].payload))
    answers: list[Any] = []
    subscriber.on_subscribe = lambda *arguments: answers.append(arguments)
    subscriber.connect("127.0.0.1", broker.port)
    subscriber.loop_start()
    subscriber.subscribe("my ship/now/#")
    wait_for(lambda: bool(answers))
    config = configured(
        f'type = "mqtt"\nport = {broker.port}\ntopic = "my ship/now"\nform = "{form}"\nrate_hz = 10\n'
        'channels = ["surge_mps"]\n'
    )
    assert check_sinks(config) == {"out": ""}
    offered = samples(50)
    with passing_on(config) as (_, state, texts, offer):
        for sample in offered:
            offer(sample)
        wait_for(lambda: len(received) >= 50)
    subscriber.disconnect()
    subscriber.loop_stop()
    field = "value" if form == "json" else None
    entry = TopicValue(topic="my ship/now/surge_mps", unit="m/s", field=field)
    readings = [read_topic_value(payload.decode(), entry) for _, payload in received]
    wanted = [sample for sample in offered if sample.quantity == "surge_mps"]
    assert {topic for topic, _ in received} == {"my ship/now/surge_mps"}
    assert [(float(reading.text), reading.time_ns) for reading in readings] == [
        (sample.value, sample.measured_ns) for sample in wanted
    ]
    assert {reading.unit for reading in readings} == {"" if form == "json" else "m/s"}
    assert (state.sent, state.dropped, texts) == (50, 0, [])


def _head_of_line(line: str) -> list[str]:
    """Measurement, tag's key and tag's value, up to the first blank, as InfluxDB's parser finds them.

    To it a comma, an equals sign or a blank is part of a name if the one letter before is a backslash, also where
    that has been doubled (``scanTagsValue`` in its ``models/points.go``).
    """
    head = re.split(r"(?<!\\) ", line)[0]
    return [re.sub(r"\\([,= ])", r"\1", part) for part in re.split(r"(?<!\\)[,=]", head)]


@given(st.text(min_size=1, max_size=30))
@example("C:\\logs\\")
@example("a\\, b=\\")
def test_a_name_is_one_tag_whatever_is_in_it(name: str) -> None:
    section = configured('type = "influx"\nurl = "http://127.0.0.1:1/"\nbucket = "b"\n').sinks[0]
    assert isinstance(section, InfluxSink)
    line = at_work.InfluxLines(section, name).line(samples(1)[0]).decode()
    assert line.count("\n") == 1
    plain = "".join("_" if letter == "\\" or not letter.isprintable() else letter for letter in name)
    assert _head_of_line(line) == ["seatrial", "trial", plain]


def test_a_measurement_that_would_be_a_comment_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="measurement"):
        configured('type = "influx"\nurl = "http://127.0.0.1:1/"\nbucket = "b"\nmeasurement = "#1"\n')


def test_a_server_without_tls_is_said_as_such() -> None:
    """The numbers of OpenSSL's errors are not the system's: it was "Operation not permitted"."""
    with InfluxServer() as server:
        config = configured(influx(server).replace("http:", "https:"))
        assert "no TLS" in check_sinks(config)["out"]


def test_a_channel_is_thinned_to_its_rate() -> None:
    """Steady and jittering input: never more than the rate and one more, and not a half of what is allowed."""
    config = configured('type = "influx"\nurl = "udp://127.0.0.1:9"\nrate_hz = 5\nqueue_values = 100000\n')
    (section,) = config.sinks
    for period_ns, jitter_ns in ((SECOND // 10, 0), (SECOND // 5, 15_000_000), (SECOND // 100, 3_000_000)):
        state = SinkHealth("out")
        sink = LiveSink(section, make_link(section, "x", {}), state, lambda level, text: None)
        count = 20 * SECOND // period_ns
        for number in range(count):
            at_ns = START_NS + number * period_ns + (-1) ** number * jitter_ns
            sink.offer(Sample("heading_deg", 1.0, "x", at_ns, at_ns, at_ns))
        assert 95 <= state.offered <= 101, (period_ns, state.offered)


@pytest.mark.parametrize(
    ("status", "kept"), [(503, True), (401, True), (404, True), (400, False), (422, False), (302, True)]
)
def test_what_a_server_does_not_take_now_is_sent_again_and_what_it_never_takes_is_counted(
    status: int, kept: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The failure is said once with the server's reason, without the token that it repeats, and the return once."""
    monkeypatch.setenv("SHIP_TOKEN", TOKEN)
    refusal = (status, f'{{"code": "x", "message": "not for {TOKEN}"}}'.encode())
    with InfluxServer(refusal, refusal, (204, b"")) as server:
        config = configured(influx(server, f'bucket = "b"\ntoken_variable = "SHIP_TOKEN"\n{MORE}'))
        with passing_on(config) as (_, state, texts, offer):
            offered = samples(20)
            for sample in offered[:20]:
                offer(sample)
            wait_for(lambda: len(server.posts) >= 1)
            for sample in offered[20:]:
                offer(sample)
            wait_for(lambda: state.sent + state.dropped == 40 or len(server.posts) >= 3)
            wait_for(lambda: state.in_hand == 0 and not state.queue)
            if state.state == "failed":
                offer(samples(99)[-1])
                wait_for(lambda: state.state == "open")
    assert f"answers {status}" in state.error
    assert "not for ***" in state.error
    assert TOKEN not in state.error + "".join(texts)
    assert [text.split()[2] for text in texts] == ["fails:", "works"], texts
    assert state.dropped == (0 if kept else state.offered - state.sent)
    assert (state.dropped > 0) == (not kept)


def test_a_connection_that_a_server_has_closed_is_opened_again_unnoticed() -> None:
    """As servers do with one that was idle, without a word in the answer before."""
    with InfluxServer() as server, passing_on(configured(influx(server))) as (_, state, texts, offer):
        server.closes = True
        for number in range(3):
            offer(samples(100)[number * 40])
            wait_for(lambda number=number: state.sent == number + 1)
            assert len(server.posts) == number + 1
    assert (texts, state.error) == ([], "")


def test_a_recording_says_what_its_sinks_got(tmp_path: Path) -> None:
    """On the display, in /status.json, in /health, in the figures of alarms and in its last line."""
    port = free_port()
    with InfluxServer() as server:
        alarm = '[[alarm]]\nname = "ashore"\nfigure = "sink.out.dropped"\nabove = 1\n'
        config = configured(influx(server) + alarm, f'type = "udp"\nport = {port}\n')
        stop, result = threading.Event(), list[Any]()
        thread = threading.Thread(target=lambda: result.append(record(config, tmp_path, None, stop)))
        thread.start()
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            while len(server.posts) < 3:
                sender.sendto(frame_sentence("HEHDT,12.5,T"), ("127.0.0.1", port))
                time.sleep(0.05)
        wait_for(
            lambda: read_recording(next(tmp_path.glob("*.mcap"))).health.get("sink out", {}).get("sent", 0) > 1
        )
        stop.set()
        thread.join()
    ((paths, health),) = result
    state = health.sinks["out"]
    assert state.sent == health.figures(0)["sink.out.sent"] == len(server.posts) == state.offered
    assert summary_text(health, paths).endswith(f"; out: {state.sent} sent, 0 dropped")
    assert json.loads(health_as_json(health))["sinks"] == [state.as_message(0)]
    again = redecode(paths, tmp_path / "again.mcap")
    assert "sent" not in summary_text(again.health, paths)
    console = Console(width=120, record=True, file=io.StringIO())
    console.print(Picture(health, frozenset(), None))
    row = next(line for line in console.export_text().splitlines() if line.startswith("to out"))
    assert row.split() == ["to", "out", "open", str(state.sent), "0"]


@pytest.mark.parametrize("name", ["nowhere.invalid", "hangs"])
def test_a_name_that_is_not_found_or_hangs_costs_values_alone(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Putting values in goes on at once, the oldest are dropped and counted, and the end comes in time."""
    released, lookup = threading.Event(), socket.getaddrinfo

    def hang(host: Any, *arguments: Any, **options: Any) -> Any:
        if host == "hangs":
            released.wait(60.0)
        return lookup("127.0.0.1" if host == "hangs" else host, *arguments, **options)

    monkeypatch.setattr(socket, "getaddrinfo", hang)
    more = 'bucket = "b"\nrate_hz = 10\nqueue_values = 30\n'
    config = configured(f'type = "influx"\nurl = "http://{name}:8086"\n{more}')
    with passing_on(config) as (sinks, state, texts, offer):
        offered = samples(500)
        for sample in offered:
            offer(sample)
        assert [sample.value for sample in state.queue][-1] == offered[-1].value
        assert len(state.queue) == 30
        sinks.stop()
        if name == "hangs":
            state.busy_s -= 60.0
            assert state.as_message(0)["state"] == "opening"
            assert state.state_at(2**62) == "hanging"
        else:
            assert "no computer of this name is known" in texts[0]
        assert state.sent == 0
        assert state.dropped + state.in_hand + len(state.queue) == state.offered == len(offered)
        released.set()


@pytest.mark.parametrize(
    ("sink", "said"),
    [
        ('type = "influx"\nurl = "http://me:pass@host:8086"\nbucket = "b"\n', "has no user, password or query"),
        ('type = "influx"\nurl = "http://host:8086?u=me&p=pass"\nbucket = "b"\n', "has no user, password or query"),
        ('type = "influx"\nurl = "ftp://host/pass"\nbucket = "b"\n', "begins with http, https, tcp, udp"),
        ('type = "influx"\nurl = "http://host:8086"\n', "needs a bucket"),
        ('type = "influx"\nurl = "udp://host"\n', "needs a port"),
        ('type = "influx"\nurl = "http://host:pass"\nbucket = "b"\n', "begins with"),
        ('type = "influx"\nurl = "http://host"\nbucket = "b"\ntoken = "pass"\n', "token: is not a known key"),
        ('type = "mqtt"\ntopic = "ship/#"\n', "topic"),
        ('type = "mqtt"\nchannels = ["heading"]\n', "is no channel; did you mean heading_deg"),
        ('type = "mqtt"\n[[sink]]\nname = "out"\ntype = "mqtt"\n', "two sinks are called 'out'"),
    ],
)
def test_a_sink_that_cannot_be_meant_is_refused_without_its_secrets(sink: str, said: str) -> None:
    with pytest.raises(ConfigurationError, match=said) as caught:
        configured(sink)
    assert "pass@" not in str(caught.value)
    assert "p=pass" not in str(caught.value)


def test_a_topic_that_would_come_back_as_input_is_refused() -> None:
    source = 'type = "mqtt"\naddress = "localhost"\ntopics = ["ship/#"]\n'
    with pytest.raises(ConfigurationError, match="would come back as input"):
        configured('type = "mqtt"\ntopic = "ship/now"\n', source)
    configured('type = "mqtt"\ntopic = "ship/now"\naddress = "ashore"\n', source)


def test_check_names_each_sink_that_does_not_take_values(tmp_path: Path) -> None:
    """A closed port, a token that is not there, one that is refused; a UDP port's receiver is not known."""
    closed = free_port(socket.SOCK_STREAM)
    (tmp_path / "token").write_text(f"{TOKEN}\n")
    with InfluxServer((401, b'{"message": "unauthorized"}')) as server:
        url = f"http://127.0.0.1:{server.server_port}"
        sinks = {
            "closed": f'url = "tcp://127.0.0.1:{closed}"',
            "unset": f'url = "{url}"\nbucket = "b"\ntoken_variable = "NOT_SET_ANYWHERE"',
            "refused": f'url = "{url}"\nbucket = "b"\ntoken_file = "{tmp_path / "token"}"',
            "udp": 'url = "udp://127.0.0.1:9"',
        }
        text = "".join(f'[[sink]]\nname = "{name}"\ntype = "influx"\n{entry}\n' for name, entry in sinks.items())
        config = parse_config(config_text('type = "udp"\nport = 20001\n', CHANNELS) + text, tmp_path / "trial.toml")
        answers = check_sinks(config)
    assert answers["closed"] == "Connection refused"
    assert "the environment has no NOT_SET_ANYWHERE" in answers["unset"]
    assert answers["refused"] == "the server answers 401 Unauthorized: unauthorized"
    assert answers["udp"].startswith("(sent by UDP")
    with suppress(KeyError):
        assert TOKEN not in server.posts[0][2].decode()


def test_sinks_listen_before_the_sources_are_opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A value that comes at once is passed on as all others are."""
    start, listening = pipeline.Recorder.start, list[int]()

    def start_late(recorder: pipeline.Recorder) -> None:
        listening.append(len(recorder._parts.sample_listeners))
        start(recorder)

    monkeypatch.setattr(pipeline.Recorder, "start", start_late)
    with InfluxServer() as server:
        config, stop = configured(influx(server), f'type = "udp"\nport = {free_port()}\n'), threading.Event()
        stop.set()
        record(config, tmp_path, None, stop)
    assert listening == [1]


def test_value_that_comes_as_the_recording_ends_is_sent(monkeypatch: pytest.MonkeyPatch) -> None:
    """Offered, and the end asked for, between the look into the queue and the look whether this is the end."""
    take, last = LiveSink._take, samples(1)

    def take_as_it_ends(sink: LiveSink) -> list[Sample]:
        batch = take(sink)
        if not sink._ending.is_set():
            for sample in last:
                sink.offer(sample)
            sink.end()
        return batch

    monkeypatch.setattr(LiveSink, "_take", take_as_it_ends)
    with InfluxServer() as server, passing_on(configured(influx(server))) as (sinks, state, _, _):
        sinks.stop()
        assert (state.sent, state.dropped) == (len(last), 0)
        assert len(server.posts) == 1
