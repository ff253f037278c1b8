"""Channels anew from the raw input: as if the recording had been made with the right configuration at once."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

import seatrial
from seatrial.acquisition.config.trial_file import TrialConfig, load_config
from seatrial.acquisition.core.errors import InputError, SeatrialError, StorageError
from seatrial.acquisition.core.trial import Frame, FrameFlag
from seatrial.acquisition.emulator import iterate_moments
from seatrial.acquisition.logger import survey as redecode_module
from seatrial.acquisition.logger.pipeline import initial_health
from seatrial.acquisition.logger.processing import FrameProcessor
from seatrial.acquisition.logger.survey import redecode
from seatrial.acquisition.protocols import make_encoder
from seatrial.acquisition.protocols.nmea0183 import frame_sentence
from seatrial.acquisition.recording.messages import (
    CHANNEL_PREFIX,
    EVENT_TOPIC,
    HEALTH_TOPIC,
    RAW_PREFIX,
    MessageSink,
)
from seatrial.acquisition.recording.parts import RecordingParts
from seatrial.acquisition.recording.reader import MessageEntry, MessageStream, read_recording
from seatrial.acquisition.recording.writer import RecordingWriter
from tests.acquisition.conftest import DBC, ORIGIN, SIGNALS, write_voyage

SECOND = 1_000_000_000
BOOT_NS = 1_000_000 * SECOND
DELAY_NS = 3_000_000  # from measuring to reception
BUS = """[[source]]
name = "bus"
type = "can"
interface = "virtual"
channel = "x"
clock = "source"
dbc = "thrusters.dbc"
channels = ["north_m", "east_m", "latitude_deg", "longitude_deg", "port_rpm", "port_angle_deg"]
"""
LINE = """[[source]]
name = "line"
type = "udp"
port = 1
clock = "source"
channels = ["heading_deg", "yaw_rate_dps", "surge_mps", "sway_mps",
            "starboard_rpm", "starboard_angle_deg", "tunnel_rpm"]
thrusters = { port = 2, starboard = 4, tunnel = 1 }
mounting = { heading_deg = 12.5 }
"""
LINK = """[[source]]
name = "link"
type = "mavlink"
port = 2
channels = ["wind_direction_deg", "wind_speed_mps", "heading_deg"]
"""
RIGHT = f'[trial]\nname = "redecode"\n{BUS}{SIGNALS}{LINE}{LINK}'
WRONG = {
    "thruster numbers": RIGHT.replace("port = 2, starboard = 4", "port = 4, starboard = 2"),
    "unit": RIGHT.replace('"ShaftSpeed", unit = "rpm"', '"ShaftSpeed", unit = "rps"', 1),
    "mounting": RIGHT.replace("heading_deg = 12.5", "heading_deg = -12.5"),
    "clock": RIGHT.replace('clock = "source"', 'clock = "receiver"'),
    "order of sources": f'[trial]\nname = "redecode"\n{LINK}{LINE}{BUS}{SIGNALS}',
    "another source of the origin": RIGHT.replace('"wind_speed_mps",', '"north_m", "east_m",', 1),
}


def configured(folder: Path, text: str) -> TrialConfig:
    folder.mkdir(exist_ok=True)
    shutil.copy(DBC, folder / "thrusters.dbc")
    (folder / "trial.toml").write_text(text)
    return load_config(folder / "trial.toml")


@pytest.fixture(scope="module")
def frames(tmp_path_factory: pytest.TempPathFactory) -> list[Frame]:
    """A voyage of four seconds on a bus, a line and a link, as it was received, with some rubbish in between."""
    folder = tmp_path_factory.mktemp("voyage")
    write_voyage(folder / "voyage.mcap", 4.0)
    voyage = read_recording(folder / "voyage.mcap")
    received = []
    for source in configured(folder, RIGHT).sources:
        protocol = {"can": "can", "udp": "nmea0183", "mavlink": "mavlink"}[source.type]
        encoder = make_encoder(source)
        for moment in iterate_moments(voyage, source.channels, ORIGIN):
            for packet in encoder.encode(moment):
                payload = packet.payload.strip() if protocol == "nmea0183" else packet.payload
                flags = FrameFlag.NONE if packet.extended else FrameFlag.STANDARD_ID
                times = moment.time_ns + DELAY_NS, moment.time_ns % BOOT_NS
                for data in (payload, payload[:-1])[: 2 if len(received) % 37 == 0 else 1]:
                    received.append(Frame(source.name, protocol, data, *times, packet.identifier, flags))  # type: ignore[arg-type]
    return sorted(received, key=lambda frame: frame.received_ns)


def pass_through(frames: list[Frame], config: TrialConfig, sink: MessageSink, half: object = None) -> None:
    """The recorder's thread without the thread; ``half`` is called when half of it is done."""
    processing = FrameProcessor(config, sink, initial_health(config))
    processing.note("recording started", frames[0].received_ns)
    for number, frame in enumerate(frames):
        processing.process(frame)
        if number == len(frames) // 2:
            processing.note("start 20/20", frame.received_ns, "info", "mark")
            if callable(half):
                half()
    processing.report_handovers()
    processing.note("recording stopped", frames[-1].received_ns)


def made(path: Path, config: TrialConfig, frames: list[Frame]) -> Path:
    """A recording of these frames by this configuration."""
    with RecordingWriter(path, config.trial, config.attachments) as writer:
        pass_through(frames, config, writer)
        for source in config.sources:
            writer.write_health({"source": source.name}, frames[-1].received_ns)
    return path


def entries(path: Path) -> list[MessageEntry]:
    """All that decoding brings forth or begins with, in its order: samples, fixes, raw input, events.

    Left out is what redecoding says of itself, and the recorder's own health.
    """
    return [
        entry
        for entry in MessageStream(path)
        if entry.topic != HEALTH_TOPIC and not (entry.topic == EVENT_TOPIC and b"decoded again from" in entry.data)
    ]


def events(path: Path) -> list[str]:
    return [text for _, text in read_recording(path).events]


@pytest.fixture
def right(tmp_path: Path) -> TrialConfig:
    return configured(tmp_path / "right", RIGHT)


@pytest.mark.parametrize("mistake", WRONG)
def test_a_mistake_costs_nothing(tmp_path: Path, frames: list[Frame], right: TrialConfig, mistake: str) -> None:
    """Message by message what the right configuration would have recorded: values, times, sources, raw input."""
    wrong = made(tmp_path / "wrong.mcap", configured(tmp_path / "wrong", WRONG[mistake]), frames)
    expected = made(tmp_path / "right.mcap", right, frames)
    assert entries(wrong) != entries(expected)
    result = redecode([wrong], tmp_path / "new.mcap", right)
    assert entries(tmp_path / "new.mcap") == entries(expected)
    assert result.frames == len(frames)
    assert result.unknown == {}
    new = read_recording(tmp_path / "new.mcap")
    assert new.closed
    assert new.trial == read_recording(expected).trial
    assert set(new.series) == {name for source in right.sources for name in source.channels}


def test_raw_input_and_marks_are_kept_and_decoding_tells_its_events_once(
    tmp_path: Path, frames: list[Frame], right: TrialConfig
) -> None:
    wrong = made(tmp_path / "wrong.mcap", configured(tmp_path / "wrong", WRONG["order of sources"]), frames)
    redecode([wrong], tmp_path / "new.mcap", right)

    def raw(path: Path) -> list[MessageEntry]:
        return [entry for entry in entries(path) if entry.topic.startswith(RAW_PREFIX)]

    assert raw(tmp_path / "new.mcap") == raw(wrong)
    assert len(raw(wrong)) == len(frames)
    told = events(tmp_path / "new.mcap")
    assert [text for text in told if text in ("recording started", "start 20/20", "recording stopped")] == [
        "recording started", "start 20/20", "recording stopped",
    ]  # fmt: skip
    assert sum("the first fix is the origin" in text for text in told) == 1
    assert told[-1] == "decoded again from wrong.mcap"
    marked = [entry.log_ns for entry in entries(tmp_path / "new.mcap") if b"start 20/20" in entry.data]
    assert marked == [frames[len(frames) // 2].received_ns]


def test_its_own_configuration_gives_the_same_again_without_the_dbc_file(
    tmp_path: Path, frames: list[Frame], right: TrialConfig
) -> None:
    """And again of what came out of that: the new file carries all that it needs, too."""
    path = made(tmp_path / "original.mcap", right, frames)
    shutil.rmtree(tmp_path / "right")
    redecode([path], tmp_path / "once.mcap")
    redecode([tmp_path / "once.mcap"], tmp_path / "twice.mcap")
    assert entries(path) == entries(tmp_path / "once.mcap") == entries(tmp_path / "twice.mcap")
    streams = [MessageStream(tmp_path / name) for name in ("original.mcap", "twice.mcap")]
    for stream in streams:
        for _ in stream:
            pass
    assert streams[0].attachments == streams[1].attachments
    assert set(streams[0].attachments) == {"configuration.toml", "bus.dbc"}
    assert streams[0].trial == streams[1].trial


def recorded_in_parts(folder: Path, config: TrialConfig, frames: list[Frame]) -> list[Path]:
    parts = RecordingParts(folder, config.trial, config.attachments, config.recording)
    pass_through(frames, config, parts, lambda: parts.begin_next_part("asked for"))
    parts.close()
    return parts.paths


def test_several_parts_become_one_file(tmp_path: Path, frames: list[Frame], right: TrialConfig) -> None:
    paths = recorded_in_parts(tmp_path / "parts", configured(tmp_path / "wrong", WRONG["unit"]), frames)
    assert len(paths) == 2
    shares: list[float] = []
    redecode(paths, tmp_path / "new.mcap", right, shares.append)
    assert entries(tmp_path / "new.mcap") == entries(made(tmp_path / "right.mcap", right, frames))
    assert shares == [0.5, 1.0]
    assert events(tmp_path / "new.mcap")[-1] == f"decoded again from {paths[0].name}, {paths[1].name}"


def test_a_later_part_alone_keeps_the_origin_of_the_first(
    tmp_path: Path, frames: list[Frame], right: TrialConfig
) -> None:
    """Its first fix is not the trial's; positions stay on the tangent plane of the whole recording."""
    assert right.trial.origin is None
    _, second = recorded_in_parts(tmp_path / "parts", right, frames)
    redecode([second], tmp_path / "new.mcap")
    new, old = read_recording(tmp_path / "new.mcap"), read_recording(second)
    assert new.trial.origin == old.trial.origin is not None
    assert new.series["north_m"].value.tolist() == old.series["north_m"].value.tolist()
    assert not any("the first fix" in text for text in events(tmp_path / "new.mcap"))


def test_a_long_recording_does_not_wait_in_memory(
    tmp_path: Path, frames: list[Frame], right: TrialConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(redecode_module, "_FLUSH_EVERY", 100)
    written: list[int] = []
    paths = recorded_in_parts(tmp_path / "parts", right, frames)
    redecode(paths, tmp_path / "new.mcap", right, lambda share: written.append(size_of_all(tmp_path, ".*.part")))
    assert written[0] > 0.3 * (tmp_path / "new.mcap").stat().st_size


def size_of_all(folder: Path, pattern: str) -> int:
    return sum(path.stat().st_size for path in folder.glob(pattern))


def test_a_recording_that_was_killed_is_decoded_as_far_as_it_goes(
    tmp_path: Path, frames: list[Frame], right: TrialConfig
) -> None:
    whole = made(tmp_path / "whole.mcap", right, frames)
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole.read_bytes()[: whole.stat().st_size * 6 // 10])
    redecode([cut], tmp_path / "new.mcap")
    assert read_recording(tmp_path / "new.mcap").closed
    found = entries(tmp_path / "new.mcap")
    assert len(found) > 0.2 * len(entries(whole))
    assert found == entries(whole)[: len(found)]


@pytest.mark.parametrize("unknown", ["bus", "line", "link"])
def test_what_the_new_configuration_does_not_know_is_kept_raw_and_named(
    tmp_path: Path, frames: list[Frame], right: TrialConfig, unknown: str
) -> None:
    path = made(tmp_path / "original.mcap", right, frames)
    config = configured(tmp_path / "other", RIGHT.replace(f'name = "{unknown}"', 'name = "other"'))
    arguments = ["redecode", str(path), "-o", str(tmp_path / "new.mcap"), "--config", str(config.path)]
    result = CliRunner().invoke(seatrial.app, arguments)
    count = sum(frame.origin == unknown for frame in frames)
    assert result.exit_code == 0, result.output
    assert f"kept raw, as no source of the configuration is called so: {unknown} {count:,}" in result.stderr
    assert result.stdout.strip() == str(tmp_path / "new.mcap")
    old, new = read_recording(path), read_recording(tmp_path / "new.mcap")
    assert new.raw == old.raw
    assert not any(each.startswith(unknown) for series in new.series.values() for each in series.sources)


def refused(folder: Path, right: TrialConfig, frames: list[Frame]) -> Iterator[tuple[list[str], type, str]]:
    """Arguments that cannot be served, the error's class and its text."""
    recording = made(folder / "sound.mcap", right, frames)
    write_voyage(folder / "table.mcap", 1.0)
    with RecordingWriter(folder / "bare.mcap", right.trial) as writer:
        pass_through(frames, right, writer)
    with RecordingWriter(folder / "foreign.mcap", right.trial, right.attachments) as writer:
        writer.write(f"{RAW_PREFIX}can/bus", b'{"id": "x"}', 1, 1)
    (folder / "exists.mcap").write_text("mine")
    (folder / "text.mcap").write_text("no recording")
    new, config = str(folder / "new.mcap"), ["--config", str(right.path)]
    yield [str(folder / "table.mcap"), "-o", new, *config], InputError, "contains no raw input to decode"
    yield [str(folder / "bare.mcap"), "-o", new], InputError, "contains no configuration; give one with --config"
    yield (
        [str(folder / "foreign.mcap"), "-o", new],
        InputError,
        "contains a message that is not a raw input of Seatrial",
    )
    yield [str(folder / "text.mcap"), "-o", new, *config], InputError, "is not an MCAP recording"
    yield [str(folder / "none.mcap"), "-o", new], InputError, "does not exist"
    yield [str(recording), str(folder / "none.mcap"), "-o", new], InputError, "does not exist"
    yield [str(recording), "-o", str(folder / "exists.mcap")], StorageError, "already exists"
    yield [str(recording), "-o", str(folder / "text.mcap" / "new.mcap")], StorageError, "is a file, not a folder"


def test_what_cannot_be_decoded_is_one_clear_error_and_leaves_nothing(
    tmp_path: Path, frames: list[Frame], right: TrialConfig,
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    for arguments, kind, text in refused(tmp_path, right, frames[:50]):
        before = sorted(tmp_path.rglob("*"))
        result = CliRunner().invoke(seatrial.app, ["redecode", *arguments])
        assert isinstance(result.exception, kind), result.output
        assert issubclass(kind, SeatrialError)
        monkeypatch.setattr(sys, "argv", ["seatrial", "redecode", *arguments])
        with pytest.raises(SystemExit) as ended:
            seatrial.main()
        assert ended.value.code == 1
        (line,) = capsys.readouterr().err.strip().splitlines()[-1:]
        assert line.startswith("seatrial: ")
        assert text in line
        assert sorted(tmp_path.rglob("*")) == before
    assert (tmp_path / "exists.mcap").read_text() == "mine"


TALK = st.sampled_from([
    "HEHDT,{:.1f},T", "HEHDG,{:.1f},1.0,E,2.0,W", "TIROT,{:.1f},A", "IIMWV,{:.1f},R,5.0,M,A",
    "VDVBW,,,V,{:.1f},0.1,A,,V,,V",
    "GPRMC,120000.00,A,63{:05.2f},N,01024.0,E,1.0,2.0,170526,,,A", "RCTRD,4,{:.1f},R,,V,10.0",
])  # fmt: skip
LINES = st.one_of(
    st.builds(lambda body, x: frame_sentence(body.format(x)).strip(), TALK, st.floats(0, 59)), st.binary()
)
TRAFFIC = st.lists(st.tuples(st.sampled_from(["line", "other"]), LINES, st.integers(0, 3 * SECOND)), min_size=1)
TWO_LINES = '[trial]\nname = "x"\n' + LINE + LINE.replace('"line"', '"other"').replace("port = 1", "port = 7")


@settings(max_examples=40)
@given(traffic=TRAFFIC)
def test_whatever_came_its_own_configuration_gives_the_same_again(
    traffic: list[tuple[str, bytes, int]], tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("traffic")
    config, at_ns, frames = configured(folder, TWO_LINES), 1_779_019_200 * SECOND, []
    for name, line, pause_ns in traffic:
        at_ns += pause_ns
        stamped_ns = at_ns - 250_000_000 if pause_ns % 2 else None  # as by a gateway or a log
        frames.append(Frame(name, "nmea0183", line, at_ns, at_ns // 3, stamped_ns=stamped_ns))
    path = made(folder / "x.mcap", config, frames)
    redecode([path], folder / "y.mcap")
    # Which of two events of one moment was written first is by the clock: sources' changes are reported when over.
    assert sorted(entries(folder / "y.mcap"), key=moment) == sorted(entries(path), key=moment)


def moment(entry: MessageEntry) -> tuple[int, str, bytes]:
    return entry.log_ns, entry.topic, entry.data


def test_the_samples_keep_all_three_times(tmp_path: Path, frames: list[Frame], right: TrialConfig) -> None:
    """What the comparisons above compare: times of reception, of measuring and of the source are all there."""
    path = made(tmp_path / "x.mcap", right, frames)
    samples = [entry for entry in entries(path) if entry.topic == f"{CHANNEL_PREFIX}port_rpm"]
    assert len(samples) == 40
    for entry in samples:
        body = entry.decode_body()
        assert entry.log_ns - entry.publish_ns == pytest.approx(DELAY_NS, abs=1_000_000)
        assert body["source_time"] == pytest.approx(entry.publish_ns / SECOND)
        assert body["monotonic_ns"] == (entry.log_ns - DELAY_NS) % BOOT_NS
        assert body["source_clock"].startswith("nmea2000")
