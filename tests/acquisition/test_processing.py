"""From frames to the recording: one source a channel, one map, the trial's origin, JSON that fits its schema."""

from __future__ import annotations

import io
import json
import math
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from google.protobuf.unknown_fields import UnknownFieldSet
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from rich.console import Console

from seatrial.acquisition.config.trial_file import TrialConfig, load_config
from seatrial.acquisition.core.trial import Frame
from seatrial.acquisition.logger.health import ChannelHealth, Health, SourceHealth
from seatrial.acquisition.logger.processing import FrameProcessor
from seatrial.acquisition.logger.record import Picture
from seatrial.acquisition.protocols import Moment, make_encoder
from seatrial.acquisition.protocols.nmea0183 import frame_sentence
from seatrial.acquisition.protocols.nmea2000 import split_can_identifier
from seatrial.acquisition.recording.reader import Recording, read_recording
from seatrial.acquisition.recording.writer import RecordingWriter
from tests.acquisition.can_frames import can_frame, identifier_of
from tests.acquisition.conftest import DBC, ORIGIN, SIGNALS

SECOND = 1_000_000_000
START_NS = 1_779_019_200 * SECOND
TWO_LINES = """
[[source]]
name = "first"
type = "udp"
port = 1
channels = ["north_m", "east_m", "heading_deg"]
[[source]]
name = "second"
type = "udp"
port = 2
channels = ["heading_deg", "latitude_deg"]
"""
Process = Callable[[str, list[tuple[str, float, str]]], tuple[Recording, Health]]


def configured(folder: Path, text: str, trial: str = '[trial]\nname = "x"\n') -> TrialConfig:
    (folder / "trial.toml").write_text(trial + text)
    return load_config(folder / "trial.toml")


@pytest.fixture
def process(tmp_path: Path) -> Process:
    """Record sentences, given as (line, second, body), without threads."""

    def recorded(text: str, said: list[tuple[str, float, str]]) -> tuple[Recording, Health]:
        config = configured(tmp_path, text)
        health = Health({each.name: SourceHealth(each.name) for each in config.sources})
        with RecordingWriter(tmp_path / "x.mcap", config.trial) as writer:
            processing = FrameProcessor(config, writer, health)
            for line, at_s, body in said:
                at_ns = round(at_s * SECOND)
                processing.process(Frame(line, "nmea0183", frame_sentence(body).strip(), START_NS + at_ns, at_ns))
            processing.report_handovers()
        return read_recording(tmp_path / "x.mcap"), health

    return recorded


def fix(minutes: float, second: int = 0) -> str:
    return f"GPGGA,12{second:04d}.00,63{minutes:09.6f},N,01024.000000,E,4,12,0.6,0.0,M,0.0,M,,"


def test_the_preferred_source_has_the_channel_until_it_falls_silent(process: Process) -> None:
    said = [("second", 0.0, "HEHDT,2.0,T"), ("first", 0.1, "HEHDT,1.0,T")]
    said += [("second", 0.5 * number, "HEHDT,2.0,T") for number in range(1, 8)]
    said += [("first", 4.0, "HEHDT,1.0,T"), ("second", 4.1, "HEHDT,2.0,T")]
    recording, _ = process(TWO_LINES, said)
    assert recording.series["heading_deg"].value.tolist() == [2.0, 1.0, 2.0, 2.0, 1.0]
    changes = [text for _, text in recording.events]
    assert changes == [
        "heading_deg: from second/HE:HDT to first/HE:HDT",
        "heading_deg: from first/HE:HDT to second/HE:HDT",
        "heading_deg: from second/HE:HDT to first/HE:HDT",
    ]
    assert [time_ns - START_NS for time_ns, _ in recording.events] == [SECOND // 10, 3 * SECOND, 4 * SECOND]


def test_a_second_compass_on_the_line_waits_for_the_first_to_fall_silent(process: Process) -> None:
    said = [("first", 0.0, "HEHDT,1.0,T"), ("first", 0.1, "IIHDT,5.0,T"), ("first", 3.0, "IIHDT,5.0,T")]
    recording, _ = process(TWO_LINES, said)
    assert recording.series["heading_deg"].value.tolist() == [1.0, 5.0]
    assert recording.series["heading_deg"].sources == ("first/HE:HDT", "first/II:HDT")


def test_the_finer_of_two_messages_has_the_channel_whichever_came_first(process: Process) -> None:
    said = [("first", 0.0, "GPRMC,120000.00,A,6326.0,N,01024.0,E,0.0,0.0,170526,,,A")]
    said += [(("first", 0.1 * number, fix(26.0))) for number in range(1, 4)]
    said += [("first", 0.5, "GPRMC,120000.00,A,6326.0,N,01024.0,E,0.0,0.0,170526,,,A")]
    recording, _ = process(TWO_LINES, said)
    assert recording.series["north_m"].sources == ("first/GP:RMC derived", "first/GP:GGA derived")
    assert recording.series["north_m"].source_index.tolist() == [0, 1, 1, 1]


def test_origin_and_map_come_from_the_source_of_the_position(process: Process, tmp_path: Path) -> None:
    """A third line that has fixes but lists no position neither sets the origin nor draws on the map."""
    third = '[[source]]\nname = "third"\ntype = "udp"\nport = 3\nchannels = ["heading_deg"]\n'
    said = [
        ("third", 0.0, fix(0.0)),
        ("first", 0.1, fix(30.0)),
        ("third", 0.2, fix(0.0)),
        ("first", 0.3, fix(30.6, second=1)),
    ]
    recording, _ = process(TWO_LINES + third, said)
    assert recording.trial.origin == pytest.approx((63.5, 10.4))
    assert recording.series["north_m"].value == pytest.approx([0.0, 1114.6], abs=0.5)
    with (tmp_path / "x.mcap").open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        drawn = [message for *_, message in reader.iter_decoded_messages(["/position"])]
    assert [each.latitude for each in drawn] == pytest.approx([63.5, 63.51])


def test_the_map_has_the_height_and_the_errors_that_the_receiver_tells(process: Process, tmp_path: Path) -> None:
    """GGA's height above the sea and its geoid are the ellipsoid's; GST's deviations are those of its receiver."""
    high = "GNGGA,12000{}.00,6326.000000,N,01024.000000,E,4,12,0.6,12.5,M,40.0,M,,"
    said = [
        ("first", 0.0, fix(26.0).replace("GP", "GN")),
        ("first", 1.0, high.format(1)),
        ("first", 1.1, "GPGST,120000.00,,,,,0.2,0.3,,"),
        ("first", 1.2, "GNGST,120000.00,1.0,,,,0.2,0.3,0.5"),
        ("first", 2.0, high.format(2)),
    ]
    process(TWO_LINES, said)
    with (tmp_path / "x.mcap").open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        drawn = [message for *_, message in reader.iter_decoded_messages(["/position"])]
    assert [each.altitude for each in drawn] == [0.0, 52.5, 52.5]
    assert [each.position_covariance_type for each in drawn] == [0, 0, 2]
    assert list(drawn[-1].position_covariance) == pytest.approx([0.09, 0, 0, 0, 0.04, 0, 0, 0, 0.25])


def test_values_that_no_channel_can_hold_are_counted_for_their_source(process: Process) -> None:
    said = [("first", 0.0, "HEHDT,720.0,T"), ("first", 0.1, "HEHDT,359.9,T"), ("first", 0.2, "HEHDT,360.0,T")]
    recording, health = process(TWO_LINES, said)
    assert recording.series["heading_deg"].value.tolist() == [359.9, 0.0]
    assert health.sources["first"].rejected == 1
    assert health.sources["first"].as_message(0)["rejected"] == 1
    assert health.sources["second"].rejected == 0


def test_every_message_of_every_source_fits_its_schema_for_a_plain_reader(tmp_path: Path) -> None:
    values = {
        "north_m": 5.0, "east_m": -5.0, "heading_deg": 12.0, "surge_mps": 3.0, "sway_mps": -0.2,
        "yaw_rate_dps": 1.0, "wind_direction_deg": 300.0, "wind_speed_mps": 8.0,
        "port_rpm": -50.0, "port_angle_deg": 170.0,
        "starboard_rpm": 60.0, "starboard_angle_deg": -170.0, "tunnel_rpm": -10.0,
    }  # fmt: skip
    listed = json.dumps([*values, "latitude_deg", "longitude_deg"])
    sections = {
        "bus": f'type = "can"\ninterface = "virtual"\nchannel = "x"\ndbc = "{DBC}"\n{SIGNALS}',
        "line": 'type = "udp"\nport = 1\n',
        "link": 'type = "mavlink"\nport = 2\n',
    }
    config = configured(
        tmp_path,
        "".join(
            f'[[source]]\nname = "{name}"\nclock = "source"\nchannels = {listed}\n{text}'
            for name, text in sections.items()
        ),
    )
    health = Health({each.name: SourceHealth(each.name) for each in config.sources})
    with RecordingWriter(tmp_path / "x.mcap", config.trial, config.attachments) as writer:
        processing = FrameProcessor(config, writer, health)
        for source in config.sources[::-1]:
            protocol = {"can": "can", "udp": "nmea0183", "mavlink": "mavlink"}[source.type]
            for packet in make_encoder(source).encode(Moment(START_NS, values, *ORIGIN)):
                payload = packet.payload.strip() if protocol == "nmea0183" else packet.payload
                frame = Frame(source.name, protocol, payload, START_NS, 7, packet.identifier)  # type: ignore[arg-type]
                processing.process(frame)
        for each in health.sources.values():
            writer.write_health(each.as_message(8), START_NS)
    topics = set()
    with (tmp_path / "x.mcap").open("rb") as stream:
        for schema, channel, _, message in make_reader(
            stream, decoder_factories=[DecoderFactory()]
        ).iter_decoded_messages():
            assert schema is not None
            assert (schema.encoding, channel.message_encoding) == ("protobuf", "protobuf")
            assert message.DESCRIPTOR.full_name == schema.name
            assert not len(UnknownFieldSet(message)), channel.topic
            topics.add(channel.topic)
    assert topics == {f"/channel/{name}" for name in json.loads(listed)} | {
        "/raw/can/bus", "/raw/nmea0183/line", "/raw/mavlink/link", "/position", "/event", "/health",
    }  # fmt: skip


def test_a_rate_falls_when_a_channel_falls_silent() -> None:
    channel = ChannelHealth(count=20)
    channel.times_ns.extend(number * SECOND // 10 for number in range(20))
    assert channel.rate_hz(2 * SECOND) == pytest.approx(10.0)
    assert channel.rate_hz(4 * SECOND) == pytest.approx(19 / 4)
    assert channel.rate_hz(20 * SECOND) == 0.0


@pytest.mark.parametrize(("width", "height"), [(120, 40), (80, 24), (60, 20), (60, 18)])
def test_the_picture_fits_its_terminal(width: int, height: int, process: Process) -> None:
    """No name and no number is cut, no line is broken in two, and the newest events are those that stay."""
    _, health = process(TWO_LINES, [("first", 0.1 * number, fix(30.0)) for number in range(5)])
    for number in range(10):
        health.events.append((START_NS, "warning", f"event {number} " + "long " * 40))
    console = Console(file=io.StringIO(), width=width, height=height, force_terminal=True, color_system=None)
    health.part = "a_rather_long_name_of_a_trial_20260517T120000Z.mcap"
    health.free_bytes, health.bytes_per_s = 64_000_000_000, 120_000.0
    picture = Picture(health, frozenset({"north_m"}), {"1": "start of a manoeuvre with a long name"})
    with console.capture() as captured:
        console.print(picture)
    lines = captured.get().rstrip("\n").split("\n")
    assert len(lines) <= max(height, 19)
    assert all(len(line) <= width for line in lines)
    for name in ("starboard_angle_deg", "wind_direction_deg"):
        assert any(line.startswith(name) for line in lines)
    assert ("event 9" in captured.get()) == (height > 20)


def test_a_storm_of_claims_does_not_fill_the_event_log(tmp_path: Path) -> None:
    """What looks like a bus of a thousand devices that fight for one address: the first events, and a count."""
    text = '[trial]\nname = "storm"\n[[source]]\nname = "bus"\ntype = "can"\ninterface = "virtual"\nchannel = "x"\n'
    (tmp_path / "trial.toml").write_text(text + 'channels = ["heading_deg"]\n')
    config = load_config(tmp_path / "trial.toml")
    health = Health({"bus": SourceHealth("bus")})
    with RecordingWriter(tmp_path / "x.mcap", config.trial) as writer:
        processing = FrameProcessor(config, writer, health)
        for number in range(3000):
            at_ns = START_NS + number * 30_000_000
            payload = (0xC000_0000_0000_0000 + number).to_bytes(8, "little")
            processing.process(Frame("bus", "can", payload, at_ns, at_ns, 0x18EEFF23))
    texts = [text for _, text in read_recording(tmp_path / "x.mcap").events]
    assert 30 < len(texts) <= 61
    assert sum("events were left out" in text for text in texts) == 1


BUS = """
[[source]]
name = "bus"
type = "can"
interface = "virtual"
channel = "x"
channels = ["heading_deg", "magnetic_variation_deg", "north_m", "east_m"]
"""


def record_frames(folder: Path, text: str, frames: list[Frame]) -> tuple[Recording, Health]:
    config = configured(folder, text)
    health = Health({each.name: SourceHealth(each.name) for each in config.sources})
    with RecordingWriter(folder / "x.mcap", config.trial) as writer:
        processing = FrameProcessor(config, writer, health)
        for frame in frames:
            processing.process(frame)
    return read_recording(folder / "x.mcap"), health


def variation(address: int, value_deg: float, at_s: float) -> Frame:
    """127258 as some devices send it: 6 bytes, without what is reserved behind."""
    data = struct.pack("<BBHh", 1, 0xF7, 20_000, round(math.radians(value_deg) * 1e4))
    return can_frame(identifier_of(127258, address), data, at_s)


def magnetic(heading_deg: float, at_s: float, variation_deg: float | None = None) -> Frame:
    own = 0x7FFF if variation_deg is None else round(math.radians(variation_deg) * 1e4)
    data = struct.pack("<BHhhB", 1, round(math.radians(heading_deg) * 1e4), 0x7FFF, own, 0xFD)
    return can_frame(identifier_of(127250, 36), data, at_s)


TRUE_WITH_VARIATION = struct.pack("<BHhhB", 1, 15_000, 0x7FFF, round(math.radians(-11.0) * 1e4), 0xFC)


def test_two_variations_do_not_make_the_heading_jump(tmp_path: Path) -> None:
    """A plotter's and the compass's own differ by 4.55 deg: one of them is taken, and it is said which."""
    frames = []
    for number in range(400):
        at_s = 0.1 * number
        own = -11.0 if number % 3 == 0 else None
        frames.append(magnetic(100.0, at_s, own))
        if number % 10 == 5:
            frames.append(variation(3, -15.55, at_s + 0.01))
    recording, health = record_frames(tmp_path, BUS, frames)
    heading = recording.series["heading_deg"].value
    assert len(heading) == 400
    assert np.ptp(heading) < 0.01
    assert heading[0] == pytest.approx(89.0, abs=0.01)
    assert np.ptp(recording.series["magnetic_variation_deg"].value) < 0.01
    (told,) = [text for _, text in recording.events if "variation" in text]
    assert told.startswith("bus/3:127258")
    assert "-4.55 deg from that of bus/36:127250" in told
    assert not health.sources["bus"].rejected


def test_the_variation_that_is_listed_first_is_taken_and_outlasts_silence(tmp_path: Path) -> None:
    listed = BUS + 'devices = [{ name = "plotter", address = 3 }]\n'
    frames = [variation(3, -15.55, 0.0)]
    for number in range(1, 300):
        frames += [variation(9, -11.0, 0.1 * number), magnetic(100.0, 0.1 * number)]
    recording, _ = record_frames(tmp_path, listed, frames)
    assert recording.series["heading_deg"].value == pytest.approx(84.45, abs=0.01)


def test_the_variation_of_a_listed_device_is_waited_for(tmp_path: Path) -> None:
    """Another's, which comes first and often, would be replaced within a second: a jump at the start."""
    listed = BUS + 'devices = [{ name = "compass", address = 36 }]\n'
    frames = []
    for number in range(100):
        frames += [
            can_frame(identifier_of(127250, 7), TRUE_WITH_VARIATION, 0.1 * number),
            magnetic(100.0, 0.1 * number),
        ]
        frames += [variation(36, -15.55, 0.1 * number)] * (number % 10 == 5)
    recording, _ = record_frames(tmp_path, listed, frames)
    of_compass = [index for index, name in enumerate(recording.series["heading_deg"].sources) if "compass" in name]
    series = recording.series["heading_deg"]
    derived = series.value[np.isin(series.source_index, of_compass)]
    assert derived == pytest.approx(84.45, abs=0.01)
    assert len(derived) == 94  # as soon as the compass has told its own, after half a second
    alone = [each for each in frames if split_can_identifier(each.identifier)[0] != 127258]
    recording, _ = record_frames(tmp_path, listed, alone)
    series = recording.series["heading_deg"]
    assert series.value[-1] == pytest.approx(89.0, abs=0.01)  # nobody else came: the other's serves


def test_a_variation_serves_that_no_source_lists(tmp_path: Path) -> None:
    text = BUS.replace('"magnetic_variation_deg", ', "")
    recording, _ = record_frames(tmp_path, text, [variation(3, 2.0, 0.0), magnetic(100.0, 0.1)])
    assert recording.series["heading_deg"].value == pytest.approx(102.0, abs=0.01)
    assert "magnetic_variation_deg" not in recording.series
