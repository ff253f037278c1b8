"""MQTT as a source: sentences and values by topic, through a real broker, out of a log, and decoded anew."""

from __future__ import annotations

import socket
import sqlite3
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from paho.mqtt.client import Client
from paho.mqtt.enums import CallbackAPIVersion
from typer.testing import CliRunner

from seatrial import app
from seatrial.acquisition.config.sources import MqttSource
from seatrial.acquisition.config.trial_file import TrialConfig, load_config
from seatrial.acquisition.core.errors import ConfigurationError, SourceError
from seatrial.acquisition.core.ship import CIRCULAR, NAMES, angle_difference
from seatrial.acquisition.core.trial import Frame, FrameFlag
from seatrial.acquisition.logger.pipeline import Recorder, initial_health
from seatrial.acquisition.logger.processing import FrameProcessor
from seatrial.acquisition.logger.record import record
from seatrial.acquisition.logger.survey import redecode, survey_frames, why_channel_is_missing
from seatrial.acquisition.protocols.mqtt import format_time
from seatrial.acquisition.protocols.nmea0183 import frame_sentence
from seatrial.acquisition.recording.messages import RAW_PREFIX
from seatrial.acquisition.recording.parts import RecordingParts
from seatrial.acquisition.recording.reader import MessageStream, Recording, read_recording
from seatrial.acquisition.recording.writer import RecordingWriter
from seatrial.acquisition.sources import lines, make_source
from tests.acquisition.conftest import Broker, config_text, wait_for, write_voyage
from tests.acquisition.test_round_trip import NMEA0183_STEP, load, play_and_record

SECOND = 1_000_000_000
START_NS = 1_779_019_200 * SECOND
DELAY_NS = 70_000_000  # from measuring to reception
SHIP = """
heading_deg = { topic = "ship/mru/Heading", unit = "deg" }
yaw_rate_dps = { topic = "ship/mru/YawRate", unit = "rad/s" }
surge_mps = { topic = "ship/vbw/Ahead", unit = "knots" }
port_rpm = { topic = "ship/port/Speed", unit = "percent", full_scale = 203 }
port_angle_deg = { topic = "ship/port/Angle", unit = "deg", scale = -1 }
latitude_deg = { topic = "ship/gga/Latitude", unit = "ddmm" }
longitude_deg = { topic = "ship/gga/Longitude", unit = "ddmm" }
apparent_wind_angle_deg = { topic = "ship/wind/Angle", unit = "deg" }
apparent_wind_speed_mps = { topic = "ship/wind/Speed", unit = "knots" }
tunnel_rpm = { topic = "ship/state", unit = "rpm", field = "bow.rpm", time_field = "at" }
"""
CHANNELS = (*NAMES, "latitude_deg", "longitude_deg", "apparent_wind_angle_deg", "apparent_wind_speed_mps")


def section(values: str = SHIP, topics: str = '"ship/NMEA/#"', port: int = 1, more: str = "") -> str:
    return f'type = "mqtt"\nport = {port}\ntopics = [{topics}]\n{more}[source.values]\n{values}'


def configured(folder: Path, text: str, channels: tuple[str, ...] = CHANNELS, clock: str = "source") -> TrialConfig:
    (folder / "mqtt.toml").write_text(config_text(text, channels, clock))
    return load_config(folder / "mqtt.toml")


def message(topic: str, text: str, number: int = 0, flags: FrameFlag = FrameFlag.NONE) -> Frame:
    at_ns = START_NS + number * SECOND + DELAY_NS
    return Frame("line", "mqtt", topic.encode() + b"\0" + text.encode("latin-1"), at_ns, at_ns, flags=flags)


def at(number: float) -> str:
    return format_time(START_NS + round(number * 1e9))


def recorded(folder: Path, config: TrialConfig, frames: list[Frame]) -> tuple[Recording, dict[str, int]]:
    """What a recorder makes of frames, and what it refused by reason."""
    health, path = initial_health(config), folder / f"{len(list(folder.iterdir()))}.mcap"
    with RecordingWriter(path, config.trial, config.attachments) as writer:
        processing = FrameProcessor(config, writer, health)
        for frame in frames:
            processing.process(frame)
    return read_recording(path), health.sources["line"].rejection_counts


@pytest.mark.parametrize(
    ("topic", "text", "channel", "value"),
    [
        ("ship/NMEA/HDT", f"{at(0)} {frame_sentence('HEHDT,12.5,T').decode()}", "heading_deg", 12.5),
        ("ship/mru/Heading", f"12.5,{at(0)},deg", "heading_deg", 12.5),
        ("ship/mru/Heading", f"{at(0)} 12.5", "heading_deg", 12.5),
        ("ship/mru/Heading", f" 1.25e1 , {START_NS // SECOND} ", "heading_deg", 12.5),
        ("ship/mru/YawRate", f"-0.01,{at(0)}", "yaw_rate_dps", np.rad2deg(-0.01)),
        ("ship/vbw/Ahead", f"10,{at(0)},knots,more", "surge_mps", 10 * 1852 / 3600),
        ("ship/port/Speed", f"-50,{at(0)}", "port_rpm", -101.5),
        ("ship/port/Angle", f"20,{at(0)}", "port_angle_deg", -20.0),
        ("ship/state", f'{{"bow": {{"rpm": -120}}, "at": "{at(0)}"}}', "tunnel_rpm", -120.0),
        ("ship/state", f'{{"bow.rpm": "-120", "at": {START_NS // 10**6}}}', "tunnel_rpm", -120.0),
    ],
)
def test_a_value_in_every_form_has_its_unit_and_its_time(
    topic: str, text: str, channel: str, value: float, tmp_path: Path
) -> None:
    """Stamped with the time that it tells; the time of reception is kept."""
    recording, reasons = recorded(tmp_path, configured(tmp_path, section()), [message(topic, text)])
    series = recording.series[channel]
    assert series.value.tolist() == pytest.approx([value])
    assert series.measured_ns.tolist() == [START_NS]
    assert series.received_ns.tolist() == [START_NS + DELAY_NS]
    assert reasons == {}


@pytest.mark.parametrize(
    ("text", "clock"), [("12.5", "source"), (f"12.5,{at(0)}", "receiver"), ("12.5,yesterday", "source")]
)
def test_without_a_time_of_its_own_a_value_has_that_of_its_reception(text: str, clock: str, tmp_path: Path) -> None:
    """Even if other messages have told a time just before."""
    config = configured(tmp_path, section(), clock=clock)
    frames = [message("ship/mru/YawRate", f"0.01,{at(0)}"), message("ship/mru/Heading", text)]
    recording, _ = recorded(tmp_path, config, frames)
    assert recording.series["heading_deg"].measured_ns.tolist() == [START_NS + DELAY_NS]


def test_a_sentence_without_a_date_takes_it_from_the_time_before_it(tmp_path: Path) -> None:
    """A GGA of just before midnight that came just after it."""
    fix = frame_sentence("GPGGA,235959.90,6326.4,N,01024.0,E,4,12,0.6,0.0,M,0.0,M,,").decode().strip()
    config = configured(tmp_path, section("", '"ship/#"'))
    recording, _ = recorded(tmp_path, config, [message("ship/x", f"2026-05-18T00:00:00.05Z {fix}")])
    wanted = pd.Timestamp("2026-05-17T23:59:59.9Z")
    assert recording.series["north_m"].measured_ns.tolist() == [wanted.as_unit("ns").value]


@pytest.mark.parametrize(
    ("topic", "text", "reason"),
    [
        ("ship/mru/Heading", "", "not available"),
        ("ship/mru/Heading", f"None,{at(0)}", "not available"),
        ("ship/mru/Heading", "NaN", "not available"),
        ("ship/mru/Heading", "north", "no number"),
        ("ship/mru/Heading", "1_2", "no number"),
        ("ship/mru/Heading", "1e999", "no number"),
        ("ship/mru/Heading", "\xff\0\xfe", "no number"),
        ("ship/mru/Heading", "inf", "no number"),
        ("ship/mru/Heading", "-100000", "outside its channel's range"),
        ("ship/mru/Heading", '{"value": true}', "no number"),
        ("ship/mru/Heading", '{"value": [1]}', "no number"),
        ("ship/mru/Heading", '{"other": 1}', "not available"),
        ("ship/mru/Heading", '{"value": 1', "no JSON object"),
        ("ship/state", "12.5", "no JSON object"),
        ("ship/state", '{"bow": 3}', "not available"),
        ("ship/NMEA/HDT", f"{at(0)} $HEHDT,12.5,T*00", "no sound checksum"),
        ("ship/NMEA/HDT", f"{at(0)} $HEHDT,12.5", "comes without a checksum"),
    ],
)
def test_what_is_no_value_is_counted_and_kept_raw(topic: str, text: str, reason: str, tmp_path: Path) -> None:
    recording, reasons = recorded(tmp_path, configured(tmp_path, section()), [message(topic, text)])
    assert reasons == {reason: 1}
    assert not recording.series
    (raw,) = (each for each in MessageStream(recording.path) if each.topic.startswith(RAW_PREFIX))
    assert raw.decode_frame() == message(topic, text)


def test_what_nobody_asked_for_is_raw_and_no_refusal_but_on_topics_of_sentences(tmp_path: Path) -> None:
    heading = frame_sentence("HEHDT,12.5,T").decode()
    ais = "!AIVDM,1,1,,A,13HOI:0P0000VOHLCnHQKwvL05Ip,0*23"
    frames = [
        message("ship/NMEA/x", f"{at(0)} {ais}"),
        message("ship/crane", "17"),
        message("ship/log", "12:00 hove to"),
    ]
    frames += [message("ship/NMEA/y", heading), message("ship/NMEA/y", "$HEH"), message("ship/NMEA/y", "\0\0")]
    recording, reasons = recorded(tmp_path, configured(tmp_path, section()), frames)
    assert reasons == {"no sentence": 2}
    assert recording.raw == {"/raw/mqtt/line": 6}


def test_nothing_comes_twice_and_nothing_of_unknown_age(tmp_path: Path) -> None:
    """Redelivered with its time: once. The same number again without a time: it may well be measured again."""
    hdt = f"{at(1)} {frame_sentence('HEHDT,77.0,T').decode()}"
    frames = [message("ship/mru/Heading", "11.0", 0, FrameFlag.RETAINED)]
    frames += [message("ship/mru/Heading", f"12.5,{at(0)}")] * 2 + [message("ship/NMEA/HDT", hdt)] * 3
    frames += [message("ship/mru/YawRate", "0.0")] * 2
    config = configured(tmp_path, section(SHIP, '"ship/NMEA/#"'))
    recording, reasons = recorded(tmp_path, config, frames)
    assert reasons == {"came twice": 3, "retained by the broker, of unknown age": 1}
    assert recording.series["heading_deg"].value.tolist() == [12.5]  # the sentence's device waits for this one
    assert recording.series["yaw_rate_dps"].value.size == 2


def test_position_and_wind_follow_from_values_that_come_apart(tmp_path: Path) -> None:
    """North and east from a latitude and a longitude of the same time; true wind from angle and speed aboard."""
    frames = []
    for number in range(3):
        said = {
            "mru/Heading": 90.0, "vbw/Ahead": 0.0, "vbw/Aside": 0.0, "gga/Longitude": 1024.0, "wind/Speed": 10.0,
            "gga/Latitude": 6326.4 + number, "wind/Angle": 45.0,
        }  # fmt: skip
        frames += [message(f"ship/{name}", f"{value},{at(number)}", number) for name, value in said.items()]
    values = f'{SHIP}sway_mps = {{ topic = "ship/vbw/Aside", unit = "knots" }}\n'
    recording, reasons = recorded(tmp_path, configured(tmp_path, section(values)), frames)
    assert reasons == {}
    series = recording.series
    assert np.diff(series["north_m"].value).tolist() == pytest.approx(
        [1857.0, 1857.0], abs=2.0
    )  # a minute at 63 deg N
    assert series["latitude_deg"].value.tolist() == pytest.approx([63.44, 63.44 + 1 / 60, 63.44 + 2 / 60])
    assert series["wind_direction_deg"].value.tolist() == pytest.approx([135.0] * 3)
    assert series["wind_speed_mps"].value.tolist() == pytest.approx([18520 / 3600] * 3)
    assert [each.value.size for each in series.values()] == [3] * len(series)


def test_a_value_whose_partner_never_comes_is_not_kept_back_for_good(tmp_path: Path) -> None:
    frames = [message("ship/gga/Latitude", f"6326.4,{at(number)}", number) for number in range(4)]
    recording, _ = recorded(tmp_path, configured(tmp_path, section()), frames)
    assert recording.series["latitude_deg"].value.size == 3
    assert "north_m" not in recording.series


def test_a_unit_that_differs_from_the_configuration_is_told_once(tmp_path: Path) -> None:
    frames = [message("ship/vbw/Ahead", f"{number},{at(number)},m/s", number) for number in range(3)]
    frames += [message("ship/mru/Heading", f"1,{at(0)},deg"), message("ship/port/Speed", f"1,{at(0)},%")]
    frames += [message("ship/port/Angle", f"1,{at(0)},grader")]
    recording, _ = recorded(tmp_path, configured(tmp_path, section()), frames)
    told_of = [text for _, text in recording.events if "the configuration says" in text]
    assert told_of == ["line: ship/vbw/Ahead tells m/s, the configuration says knots of surge_mps"]


def test_publishers_whose_clocks_differ_are_told_once_each(tmp_path: Path) -> None:
    """One is an hour ahead: an event of each, and not a step of the clock with every message."""
    frames = []
    for number in range(20):
        frames += [message("ship/mru/Heading", f"1,{at(number)}", number)]
        frames += [message("ship/vbw/Ahead", f"1,{at(number + 3600)}", number)]
    recording, _ = recorded(tmp_path, configured(tmp_path, section()), frames)
    texts = [text for _, text in recording.events if "clock" in text]
    assert [text.partition(" s ")[0] for text in texts] == [
        "line: clock mqtt ship/mru is -0.070", "line: clock mqtt ship/vbw is +3599.930",
    ]  # fmt: skip


def test_a_channel_that_has_a_topic_of_its_own_is_taken_from_no_sentence(tmp_path: Path) -> None:
    """Unless its topic falls silent."""
    hdt = frame_sentence("HEHDT,77.0,T").decode()
    frames = []
    for number in range(8):
        frames += [message("ship/NMEA/HDT", f"{at(number)} {hdt}", number)]
        frames += [message("ship/mru/Heading", f"12,{at(number)}", number)] if 0 < number < 4 else []
    recording, _ = recorded(tmp_path, configured(tmp_path, section()), frames)
    assert recording.series["heading_deg"].value.tolist() == [77, 77, 12, 12, 12, 77, 77]


def test_decoding_anew_puts_a_wrong_map_right(tmp_path: Path) -> None:
    frames = [message("ship/port/Angle", f"{number},{at(number)}", number) for number in range(5)]
    frames += [message("ship/mru/Heading", "12", 5, FrameFlag.RETAINED)]
    right = configured(tmp_path, section())
    wanted, _ = recorded(tmp_path, right, frames)
    wrong, _ = recorded(tmp_path, configured(tmp_path, section(SHIP.replace(", scale = -1", ""))), frames)
    redecode([wrong.path], tmp_path / "anew.mcap", right)
    anew = read_recording(tmp_path / "anew.mcap")
    assert anew.series["port_angle_deg"].value.tolist() == wanted.series["port_angle_deg"].value.tolist()
    assert anew.series["port_angle_deg"].value.tolist() == [0, -1, -2, -3, -4]
    assert "heading_deg" not in anew.series


# --- configurations ---


@pytest.mark.parametrize(
    ("text", "wrong"),
    [
        (section(more='password = "secret"\n'), "password: is not a known key"),
        (section(topics='"ship/#/x"'), "topics"),
        (section(topics='"ship/a+"'), "topics"),
        (section(topics='"ship/+/x", "ship/y/+"'), "overlap"),
        (section(SHIP.replace("ship/mru/Heading", "ship/+/Heading")), "topic"),
        (section(SHIP.replace('"rad/s"', '"knots"')), "'knots' does not measure"),
        (section(SHIP.replace(", full_scale = 203", "")), "full_scale"),
        ('type = "mqtt"\n', "has no input"),
        (section(SHIP.replace("heading_deg", "heding_deg")), "did you mean heading_deg"),
        (section(SHIP, topics=""), "no message on source 'line' carries sway_mps; say which topic does"),
    ],
)
def test_what_is_wrong_in_a_configuration_is_said_in_a_line(text: str, wrong: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError) as caught:
        configured(tmp_path, text)
    assert wrong in str(caught.value)
    assert "secret" not in str(caught.value)
    assert "\n" not in str(caught.value)


def test_no_topic_is_asked_for_twice(tmp_path: Path) -> None:
    config = configured(tmp_path, section(topics='"ship/NMEA/#", "ship/#", "shore/+/x"'))
    (source,) = config.sources
    assert isinstance(source, MqttSource)
    assert source.subscriptions == ["ship/#", "shore/+/x"]


@pytest.mark.parametrize(("more", "port"), [("", 1883), ("tls = true\n", 8883), ("tls = true\nport = 9\n", 9)])
def test_the_usual_port_is_that_of_the_encryption(more: str, port: int, tmp_path: Path) -> None:
    (source,) = configured(tmp_path, f'type = "mqtt"\ntopics = ["#"]\n{more}').sources
    assert isinstance(source, MqttSource)
    assert source.endpoint == ("127.0.0.1", port)


def test_a_password_comes_from_a_file_or_the_environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """And is in no error: here nobody listens, or there is none."""

    def asked(more: str) -> str | None:
        (source,) = configured(tmp_path, section(more=f'user = "me"\n{more}')).sources
        assert isinstance(source, MqttSource)
        return lines._read_password(source)

    (tmp_path / "secret").write_text("pass word\nnotes\n")
    monkeypatch.setenv("SHIP_PASSWORD", "other")
    assert asked('password_file = "secret"\n') == "pass word"
    assert asked('password_variable = "SHIP_PASSWORD"\n') == "other"
    assert asked("") is None
    for wrong in ('password_file = "nowhere"\n', 'password_variable = "NOT_SET"\n'):
        with pytest.raises(SourceError, match="has no password"):
            asked(wrong)
    (source,) = configured(tmp_path, section(more='user = "me"\npassword_file = "secret"\n')).sources
    with pytest.raises(SourceError, match="does not answer") as caught:
        make_source(source).open()
    assert "pass word" not in str(caught.value)
    assert "me" not in str(caught.value).split()


def test_a_broker_that_refuses_us_says_why_without_the_password(tmp_path: Path) -> None:
    """MQTT 3.1.1: the answer to CONNECT is 20 02, no session, reason 5; then the broker hangs up."""
    server = socket.create_server(("127.0.0.1", 0))

    def refuse() -> None:
        client, _ = server.accept()
        with client:
            client.recv(1000)
            client.sendall(b"\x20\x02\x00\x05")

    thread = threading.Thread(target=refuse)
    thread.start()
    (tmp_path / "secret").write_text("pass word")
    more = 'user = "me"\npassword_file = "secret"\n'
    (source,) = configured(tmp_path, section(port=server.getsockname()[1], more=more)).sources
    with pytest.raises(SourceError, match="refuses the connection: Not authorized; correct `user`") as caught:
        make_source(source).open()
    assert "pass word" not in str(caught.value)
    thread.join()
    server.close()


# --- through a broker ---


@contextmanager
def publisher(port: int) -> Iterator[Callable[[str, str], None]]:
    client = Client(CallbackAPIVersion.VERSION2)
    client.connect("127.0.0.1", port)
    client.loop_start()

    def publish(topic: str, text: str) -> None:
        client.publish(topic, text).wait_for_publish(30.0)

    yield publish
    client.disconnect()
    client.loop_stop()


@contextmanager
def recorder(config: TrialConfig, folder: Path) -> Iterator[Recorder]:
    parts = RecordingParts(folder, config.trial, config.attachments, config.recording)
    running = Recorder(config, parts)
    with closing(parts):
        running.start()
        try:
            yield running
        finally:
            running.stop()


def test_what_is_emulated_through_a_broker_is_the_same_recording(broker: Broker, tmp_path: Path) -> None:
    """Values under their topics to the last digit, sentences within their steps, all at their own times."""
    if not broker.is_sound:
        pytest.skip("needs mosquitto: amqtt loses what is under way when a publisher leaves")
    table = write_voyage(tmp_path / "voyage.mcap", duration_s=10.0)
    values = "".join(line for line in SHIP.splitlines(keepends=True) if line.partition(" ")[0] in NAMES)
    text = config_text(section(values, port=broker.port), NAMES)
    sending, receiving = load(tmp_path, "sending.toml", text), load(tmp_path, "receiving.toml", text)
    played, recording = play_and_record(tmp_path / "voyage.mcap", sending, receiving, tmp_path, 5.0)
    assert played.counts == {name: len(table) for name in NAMES}
    for name in NAMES:
        series = recording.series[name]
        order = np.argsort(series.measured_ns)
        assert np.abs(series.measured_ns[order] - table.index.asi8).max() <= 1000  # as finely as sentences tell
        error = np.abs(
            angle_difference(series.value[order], table[name])
            if name in CIRCULAR
            else series.value[order] - table[name]
        )
        assert error.max() <= (1e-9 if f"{name} =" in values else 0.5001 * NMEA0183_STEP[name])


def test_a_broker_that_is_restarted_is_told_and_nothing_is_doubled(broker: Broker, tmp_path: Path) -> None:
    """Messages before and after, each once, in their order; a retained one comes back with every connection."""
    config = configured(tmp_path, section(port=broker.port), ("heading_deg",))
    out = tmp_path / "out"
    with recorder(config, out) as running:
        wait_for(lambda: running.health.sources["line"].state == "open")
        with publisher(broker.port) as publish:
            for number in range(10):
                publish("ship/mru/Heading", f"{number},{at(number)}")
            wait_for(lambda: running.health.sources["line"].frames == 10)
        broker.stop()
        wait_for(lambda: running.health.sources["line"].state == "failed")
        broker.start()
        wait_for(lambda: running.health.sources["line"].state == "open")
        with publisher(broker.port) as publish:
            for number in range(9, 20):
                publish("ship/mru/Heading", f"{number},{at(number)}")
            wait_for(lambda: running.health.sources["line"].frames == 21)
    recording = read_recording(next(out.glob("*.mcap")))
    assert recording.series["heading_deg"].value.tolist() == list(range(20))
    texts = [text for _, text in recording.events]
    assert any("MQTT broker" in text and "is lost" in text for text in texts)
    assert any("is back after" in text for text in texts)


def test_what_came_just_before_the_connection_was_lost_is_kept(
    broker: Broker, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (config,) = configured(tmp_path, section(port=broker.port)).sources
    source = make_source(config)
    source.open()
    came: list[Frame] = []
    taken, pumped = lines.receive_one_message, iter(range(4))

    def pump(section: MqttSource, client: Client, timeout_s: float) -> None:
        if next(pumped, None) is None:
            raise SourceError("is lost")
        taken(section, client, 30.0)

    monkeypatch.setattr(lines, "receive_one_message", pump)
    with publisher(broker.port) as publish:  # amqtt loses what is under way when a publisher leaves
        for number in range(5):
            publish("ship/mru/Heading", f"{number}")
        while len(came) < 4:
            came += source.read(0.1) or []
    with pytest.raises(SourceError, match="is lost"):
        source.read(0.1)
    assert [each.payload[-1:] for each in came] == [b"0", b"1", b"2", b"3"]
    source.close()


def test_a_thousand_messages_a_second_are_all_recorded(broker: Broker, tmp_path: Path) -> None:
    """A short version of `make load-mqtt`."""
    count, rate_hz = 2_000, 1_000
    config = configured(tmp_path, section(port=broker.port), ("heading_deg",))
    out = tmp_path / "out"
    with recorder(config, out) as running, publisher(broker.port) as publish:
        wait_for(lambda: running.health.sources["line"].state == "open")
        began_s = time.monotonic()
        for number in range(count):
            time.sleep(max(began_s + number / rate_hz - time.monotonic(), 0.0))
            publish("ship/mru/Heading", f"{number % 360},{at(number / rate_hz)}")
        wait_for(lambda: running.health.sources["line"].frames == count)
    recording = read_recording(next(out.glob("*.mcap")))
    assert recording.raw == {"/raw/mqtt/line": count}
    assert recording.series["heading_deg"].value.tolist() == [number % 360 for number in range(count)]


def test_what_was_published_before_is_known_as_retained(broker: Broker, tmp_path: Path) -> None:
    client = Client(CallbackAPIVersion.VERSION2)
    client.connect("127.0.0.1", broker.port)
    client.loop_start()
    client.publish("ship/mru/Heading", "12.5", retain=True, qos=1).wait_for_publish(30.0)
    config = configured(tmp_path, section(port=broker.port), ("heading_deg",))
    with recorder(config, tmp_path / "out") as running:
        wait_for(lambda: running.health.sources["line"].frames == 1)
        client.publish("ship/mru/Heading", "13.5", retain=True, qos=1).wait_for_publish(30.0)
        wait_for(lambda: running.health.sources["line"].frames == 2)
    client.disconnect()
    client.loop_stop()
    recording = read_recording(next((tmp_path / "out").glob("*.mcap")))
    assert recording.series["heading_deg"].value.tolist() == [13.5]


# --- logs ---


def write_log(path: Path, rows: list[tuple[float, str, bytes]]) -> None:
    """A log with the tables of mqtt-logger."""
    with closing(sqlite3.connect(path)) as log:
        log.execute(
            "CREATE TABLE LOG (ID INTEGER PRIMARY KEY, RUN_ID INTEGER NOT NULL, UNIX_TIME DECIMAL(15,6) NOT NULL,"
            " TOPIC VARCHAR NOT NULL, MESSAGE BLOB NOT NULL)"
        )
        log.execute(
            "CREATE TABLE RUN (ID INTEGER PRIMARY KEY, START_UNIX_TIME DECIMAL(15,6), END_UNIX_TIME DECIMAL(15,6))"
        )
        log.executemany("INSERT INTO LOG (RUN_ID, UNIX_TIME, TOPIC, MESSAGE) VALUES (1, ?, ?, ?)", rows)
        log.commit()


def log_rows(count: int) -> list[tuple[float, str, bytes]]:
    """A heading a second, each received 70 ms later."""
    began_s = START_NS / 1e9 + 0.07
    return [(began_s + each, "ship/mru/Heading", f"{each % 360},{at(each)}".encode()) for each in range(count)]


def log_config(folder: Path, topics: str = '"ship/#"') -> TrialConfig:
    values = section(SHIP, topics).partition("\n")[2].partition("\n")[2]
    return configured(folder, f'type = "mqtt_file"\npath = "log.db"\n{values}')


def test_a_log_is_the_recording_that_would_have_been_made(tmp_path: Path) -> None:
    rows = log_rows(700)
    turning = f"{at(700.25)} {frame_sentence('TIROT,30.0,A').decode()}"
    rows += [(START_NS / 1e9 + 700.5, "ship/NMEA/ROT", turning.encode()), (START_NS / 1e9 + 701, "shore/x", b"1")]
    write_log(tmp_path / "log.db", rows)
    (path,), health = record(log_config(tmp_path), tmp_path / "out")
    recording = read_recording(path)
    heading = recording.series["heading_deg"]
    assert heading.measured_ns.tolist() == [START_NS + number * SECOND for number in range(700)]
    assert heading.received_ns.tolist() == [START_NS + number * SECOND + 70_000_000 for number in range(700)]
    assert heading.value.tolist() == [number % 360 for number in range(700)]
    assert recording.series["yaw_rate_dps"].value.tolist() == pytest.approx([0.5])
    assert recording.series["yaw_rate_dps"].measured_ns.tolist() == [START_NS + 700 * SECOND + 250_000_000]
    assert health.sources["line"].frames == 701  # the shore was not asked for


def write_other_table(path: Path) -> None:
    with closing(sqlite3.connect(path)) as database:
        database.execute("CREATE TABLE other (a)")


@pytest.mark.parametrize(
    ("write", "wrong"),
    [
        (lambda path: path.write_text("time,heading_deg\n0,1\n"), "it is not an SQLite database"),
        (write_other_table, "no such table"),
        (lambda path: path.write_bytes(b"SQLite format 3\0" + bytes(4000)), "log.db cannot be opened"),
        (lambda path: None, "No such file"),
    ],
)
def test_what_is_no_log_is_an_error_of_a_line(write: Callable[[Path], object], wrong: str, tmp_path: Path) -> None:
    write(tmp_path / "log.db")
    config = log_config(tmp_path)
    result = CliRunner().invoke(app, ["record", str(config.path), "-o", str(tmp_path / "out")])
    assert isinstance(result.exception, SourceError)
    assert wrong in str(result.exception)
    assert not list((tmp_path / "out").glob("*.mcap"))


def test_a_log_of_messages_is_no_log_of_lines(tmp_path: Path) -> None:
    """Sentences can be seen in its bytes, but not whole ones and not their times."""
    write_log(tmp_path / "log.db", [(START_NS / 1e9, "ship/x", frame_sentence("HEHDT,12.5,T"))] * 50)
    source = 'type = "file"\npath = "log.db"\n'
    (section_of_file,) = configured(tmp_path, source, ("heading_deg",)).sources
    with pytest.raises(SourceError, match="mqtt_file"):
        make_source(section_of_file).open()


def test_a_damaged_log_gives_what_is_before_the_damage(tmp_path: Path) -> None:
    rows = log_rows(5000)
    rows[3] = (0.0, "ship/mru/Heading", b"1")
    write_log(tmp_path / "log.db", rows)
    with (tmp_path / "log.db").open("r+b") as file:
        file.seek(150_000)
        file.write(b"\xaa" * 50_000)
    (path,), _ = record(log_config(tmp_path), tmp_path / "out")
    recording = read_recording(path)
    assert 500 < recording.series["heading_deg"].value.size < 5000
    texts = [text for _, text in recording.events]
    assert any("the log is damaged" in text for text in texts)
    assert any("1 line of the log could not be read" in text for text in texts)


def test_why_a_channel_does_not_come_is_said_of_its_topic(tmp_path: Path) -> None:
    """Of what comes by MQTT the survey knows topics and sentences."""
    config = configured(tmp_path, section())
    frames = [message("ship/mru/Heading", "north"), message("ship/mru/YawRate", "0.1", flags=FrameFlag.RETAINED)]
    frames += [message("ship/NMEA/VTG", f"{at(0)} {frame_sentence('GPVTG,84.4,T,,M,5.1,N,,K,A').decode()}")]
    survey = survey_frames(config, frames)
    assert [each.device for each in survey.kinds] == ["ship/mru/Heading", "ship/mru/YawRate", "ship/NMEA/VTG"]
    assert [each.name for each in survey.kinds] == ["value", "value", "VTG"]
    assert why_channel_is_missing("heading_deg", survey) == "ship/mru/Heading comes, but is refused: no number"
    assert "only as the broker has retained it" in why_channel_is_missing("yaw_rate_dps", survey)
    assert why_channel_is_missing("port_rpm", survey) == "nothing comes under ship/port/Speed"
    assert why_channel_is_missing("sway_mps", survey).startswith("VTG comes, but no heading")
