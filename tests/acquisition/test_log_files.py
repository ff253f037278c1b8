"""Log files to a recording: merged by their own times, which they keep, and counted in them."""

from __future__ import annotations

import re
import threading
import time
from dataclasses import replace
from math import radians
from pathlib import Path

import can
import numpy as np
import pytest
from typer.testing import CliRunner

from seatrial import app
from seatrial.acquisition.config.trial_file import TrialConfig, load_config
from seatrial.acquisition.core.errors import ConfigurationError, SourceError
from seatrial.acquisition.core.trial import Frame
from seatrial.acquisition.logger.record import record
from seatrial.acquisition.protocols.nmea0183 import frame_sentence
from seatrial.acquisition.recording.messages import HEALTH_TOPIC, RAW_PREFIX
from seatrial.acquisition.recording.reader import MessageStream, read_recording
from seatrial.acquisition.sources import log_file
from seatrial.acquisition.sources.log_file import LogFile
from tests.acquisition.can_frames import identifier_of
from tests.acquisition.conftest import DBC, free_port
from tests.acquisition.test_mavlink_packets import stream

SECOND = 1_000_000_000
START_NS = 1_779_019_200 * SECOND
TAGGED = 'type = "file"\npath = "bridge.log"\n'
CANDUMP = 'type = "can_file"\npath = "bus.log"\n'


def tagged(time_ns: int, body: str) -> bytes:
    """A sentence with the time at which a gateway received it, in ms."""
    tag = frame_sentence(f"c:{time_ns // 1_000_000}").strip()[1:]
    return b"\\" + tag + b"\\" + frame_sentence(body)


def candump(time_ns: int, rate_dps: float, address: int = 35) -> str:
    rate = round(radians(rate_dps) * 32e6).to_bytes(4, "little", signed=True)
    frame = f"{identifier_of(127251, address):08X}#00{rate.hex().upper()}FFFFFF"
    return f"({time_ns / SECOND:.6f}) can0 {frame}\n"


def write_logs(folder: Path, seconds: float = 4.0) -> tuple[list[int], list[int]]:
    """The heading in a sentence every 200 ms, the rate of turn in a frame every 70 ms; returns their times [ns]."""
    said = [START_NS + number * 200_000_000 for number in range(round(seconds / 0.2))]
    sent = [START_NS + 10_000_000 + number * 70_000_000 for number in range(round(seconds / 0.07))]
    sentences = [tagged(time_ns, f"HEHDT,{number}.0,T") for number, time_ns in enumerate(said)]
    (folder / "bridge.log").write_bytes(b"".join(sentences))
    (folder / "bus.log").write_text("".join(candump(time_ns, number / 10) for number, time_ns in enumerate(sent)))
    return said, sent


def config_of(folder: Path, *sections: str, more: str = "") -> TrialConfig:
    channels = '["heading_deg", "yaw_rate_dps"]'
    sources = "".join(
        f'[[source]]\nname = "source{number}"\nchannels = {channels}\n{section}'
        for number, section in enumerate(sections)
    )
    (folder / "trial.toml").write_text(f'[trial]\nname = "logs"\n{sources}{more}')
    return load_config(folder / "trial.toml")


def test_two_logs_are_merged_and_keep_their_own_times(tmp_path: Path) -> None:
    said, sent = write_logs(tmp_path)
    (path,), health = record(config_of(tmp_path, TAGGED, CANDUMP), tmp_path / "out")
    recording = read_recording(path)
    assert recording.closed
    heading, rate = recording.series["heading_deg"], recording.series["yaw_rate_dps"]
    assert heading.received_ns.tolist() == heading.measured_ns.tolist() == said
    assert rate.received_ns.tolist() == rate.measured_ns.tolist() == sent
    assert heading.value.tolist() == list(range(len(said)))
    assert rate.value == pytest.approx(np.arange(len(sent)) / 10, abs=1e-5)
    assert (heading.sources, rate.sources) == (("source0/HE:HDT",), ("source1/35:127251",))
    assert recording.raw == {"/raw/nmea0183/source0": len(said), "/raw/can/source1": len(sent)}
    assert [each.frames for each in health.sources.values()] == [len(said), len(sent)]
    assert {each.state for each in health.sources.values()} == {"ended"}


def test_the_recording_is_in_the_order_of_the_logs_times(tmp_path: Path) -> None:
    """Its raw messages, its monotonic times, and the events that begin and end it."""
    said, sent = write_logs(tmp_path)
    (path,), _ = record(config_of(tmp_path, CANDUMP, TAGGED), tmp_path / "out")
    entries = [entry for entry in MessageStream(path) if entry.topic.startswith(RAW_PREFIX)]
    frames = [entry.decode_frame() for entry in entries]
    assert [frame.received_ns for frame in frames] == sorted(said + sent)
    assert [frame.monotonic_ns for frame in frames] == sorted(said + sent)
    events = read_recording(path).events
    assert events[0] == (said[0], "recording started, from log files")
    assert events[-1] == (max(said + sent), "recording stopped")


def test_duration_counts_in_the_logs_time(tmp_path: Path) -> None:
    """The last moment belongs to it, and it takes much less time than it counts."""
    said, sent = write_logs(tmp_path, seconds=4.0)
    (path,), _ = record(config_of(tmp_path, TAGGED, CANDUMP), tmp_path / "out", duration_s=2.0)
    recording = read_recording(path)
    until_ns = START_NS + 2 * SECOND
    assert recording.series["heading_deg"].received_ns.tolist() == [each for each in said if each <= until_ns]
    assert recording.series["yaw_rate_dps"].received_ns.tolist() == [each for each in sent if each <= until_ns]
    assert recording.closed


def test_a_stop_keeps_what_was_read(tmp_path: Path) -> None:
    write_logs(tmp_path)
    stop = threading.Event()
    stop.set()
    (path,), _ = record(config_of(tmp_path, TAGGED, CANDUMP), tmp_path / "out", stop=stop)
    recording = read_recording(path)
    assert recording.closed
    assert recording.raw == {}


def test_live_and_file_sources_do_not_mix(tmp_path: Path) -> None:
    live = f'type = "udp"\nport = {free_port()}\n'
    with pytest.raises(ConfigurationError, match="source0 are log files, but other sources are live"):
        config_of(tmp_path, TAGGED, live)
    assert (tmp_path / "trial.toml").exists()
    result = CliRunner().invoke(app, ["record", str(tmp_path / "trial.toml"), "-o", str(tmp_path / "out")])
    assert isinstance(result.exception, ConfigurationError)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("missing", ["bridge.log", "bus.log"])
def test_a_missing_file_leaves_nothing_behind(tmp_path: Path, missing: str) -> None:
    """Whether it is the first or the last of the files."""
    write_logs(tmp_path)
    (tmp_path / missing).unlink()
    with pytest.raises(SourceError, match=rf"{missing} cannot be opened: No such file.*correct `path`"):
        record(config_of(tmp_path, TAGGED, CANDUMP), tmp_path / "out")
    assert list((tmp_path / "out").iterdir()) == []


@pytest.mark.parametrize("section", [CANDUMP, 'type = "can"\ninterface = "virtual"\nchannel = "x"\n'])
def test_a_signal_that_the_dbc_file_does_not_have_leaves_nothing_behind(tmp_path: Path, section: str) -> None:
    """Only the decoder finds out, when the recording is about to begin; of log files and of a live bus."""
    write_logs(tmp_path)
    signal = 'heading_deg = { message = "PortAzimuth", signal = "Direction", unit = "deg" }\n'
    config = config_of(tmp_path, f'{section}dbc = "{DBC}"\n[source.signals]\n{signal}')
    with pytest.raises(ConfigurationError, match=r"has no signal PortAzimuth\.Direction; it has PortAzimuth"):
        record(config, tmp_path / "out", duration_s=0.1)
    assert list((tmp_path / "out").iterdir()) == []


def test_a_file_that_fails_on_the_way_keeps_what_was_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A disk's bad sector, say: an error, and a recording that is closed well and holds all that came before."""
    monkeypatch.setattr(log_file, "_MOST_FRAMES_AT_ONCE", 3)
    blocks, read = iter(range(3)), LogFile.read

    def failing(self: LogFile, timeout_s: float) -> list[Frame] | None:
        if next(blocks, None) is None:
            raise SourceError("file failed")
        return read(self, timeout_s)

    monkeypatch.setattr(LogFile, "read", failing)
    said, _ = write_logs(tmp_path)
    with pytest.raises(SourceError, match="file failed"):
        record(config_of(tmp_path, TAGGED), tmp_path / "out")
    (path,) = (tmp_path / "out").iterdir()
    recording = read_recording(path)
    assert recording.closed
    assert 0 < recording.series["heading_deg"].value.size < len(said)
    assert (
        recording.series["heading_deg"].received_ns.tolist() == said[: recording.series["heading_deg"].value.size]
    )


def test_a_long_file_is_one_part_and_complete(tmp_path: Path) -> None:
    """Ten thousand lines at 10 Hz are a quarter of an hour, read in a second or two."""
    count = 10_000
    lines = (tagged(START_NS + number * 100_000_000, f"HEHDT,{number % 360}.0,T") for number in range(count))
    (tmp_path / "bridge.log").write_bytes(b"".join(lines))
    paths, health = record(
        config_of(tmp_path, TAGGED, more="[recording]\nsplit_minutes = 10.0\n"), tmp_path / "out"
    )
    assert len(paths) == 1
    recording = read_recording(paths[0])
    assert recording.closed
    assert recording.series["heading_deg"].value.tolist() == [number % 360 for number in range(count)]
    assert recording.end_ns - recording.start_ns == (count - 1) * 100_000_000
    assert health.sources["source0"].rejected == health.sources["source0"].dropped == 0


def test_the_recording_says_whose_times_it_has(tmp_path: Path) -> None:
    write_logs(tmp_path)
    (path,), _ = record(config_of(tmp_path, TAGGED, CANDUMP), tmp_path / "out")
    assert read_recording(path).metadata["clock"] == {"times": "of the log files"}


@pytest.mark.parametrize("clock", ["receiver", "source"])
def test_a_log_without_times_goes_by_what_is_told_in_it_and_says_so(tmp_path: Path, clock: str) -> None:
    """20 hours are read in a second, and stay 20 hours; where nobody tells the time, that of reading is taken."""
    bodies = ("GPZDA,{hour:02d}{minute:02d}00.00,17,05,2026,00,00", "HEHDT,{minute}.0,T")
    lines = (
        frame_sentence(body.format(hour=hour, minute=minute))
        for hour in range(20)
        for minute in range(60)
        for body in bodies
    )
    (tmp_path / "bridge.log").write_bytes(b"".join(lines))
    (tmp_path / "bus.log").write_text("".join(["  can0  123   [1]  05\n"] * 5))
    write_logs_of_a_third(tmp_path / "timed.log")
    timed = 'type = "file"\npath = "timed.log"\n'
    config = config_of(tmp_path, f'{TAGGED}clock = "{clock}"\n', CANDUMP, timed)
    (path,), _ = record(config, tmp_path / "out")
    recording = read_recording(path)
    texts = [text for _, text in recording.events]
    without = "the log has no times of its own; its samples are stamped with the time of reading, unless it tells "
    without += 'the time and clock = "source"'
    told = "it has no times of its own; what the bus or a sentence tells is taken, mostly whole seconds"
    assert [text for text in texts if "no times" in text] == [f"source1: {without}", f"source0: {told}"]
    assert texts.index("recording started, from log files") < texts.index(f"source1: {without}")
    assert not any("was set by" in text for text in texts)
    heading = recording.series["heading_deg"]
    from_first = heading.received_ns[heading.value != 5.0]
    assert (from_first - START_NS).tolist() == [
        minute * 60 * SECOND - 12 * 3600 * SECOND for minute in range(20 * 60) if minute % 60 != 5
    ]


@pytest.mark.parametrize(
    "kind", ["GPGGA,{time},6326.4,N,01024.0,E,1,10,0.9,5.0,M,40.0,M,,", "GPGLL,6326.4,N,01024.0,E,{time},A,A"]
)
def test_a_log_without_dates_goes_by_the_times_of_day_of_positions(kind: str, tmp_path: Path) -> None:
    """Over midnight, half a second between them, however long it is; only the date is the file's."""
    moments = [86_400.0 - 60.0 + 0.5 * number for number in range(240)]
    times = [f"{int(at // 3600) % 24:02d}{int(at // 60) % 60:02d}{at % 60:05.2f}" for at in moments]
    lines = (frame_sentence(body) for time in times for body in (kind.format(time=time), "HEHDT,5.0,T"))
    (tmp_path / "bridge.log").write_bytes(b"".join(lines))
    (path,), _ = record(config_of(tmp_path, TAGGED), tmp_path / "out")
    recording = read_recording(path)
    assert any("times of day but no date" in text for _, text in recording.events)
    assert np.diff(recording.series["heading_deg"].measured_ns).tolist() == [SECOND // 2] * 239
    assert recording.series["heading_deg"].measured_ns[120] % (86_400 * SECOND) == 0


@pytest.mark.parametrize("two", [False, True])
def test_a_receiver_that_alternates_its_talker_keeps_every_fix_and_two_receivers_do_not_mix(
    two: bool, tmp_path: Path
) -> None:
    """Of a log without times, which both talkers state; a second receiver states the same seconds."""
    lines = []
    for number in range(100):
        clock, talkers = f"12{number // 60:02d}{number % 60:02d}.00", ("GP", "GN")
        for talker in talkers if two else [talkers[number % 2]]:
            place = f"6326.{4000 + number + (talker == 'GN' and two) * 100:04d},N,01024.0,E"
            lines += map(frame_sentence, [
                f"{talker}RMC,{clock},A,{place},10.0,45.0,170526,,,A",
                f"{talker}GGA,{clock},{place},1,10,0.9,5.0,M,40.0,M,,", f"{talker}VTG,45.0,T,,M,10.0,N,18.5,K,A",
            ])  # fmt: skip
    (tmp_path / "bridge.log").write_bytes(b"".join(lines))
    config = config_of(tmp_path, TAGGED)
    sources = (replace(config.sources[0], channels=("north_m", "east_m")),)
    (path,), _ = record(replace(config, sources=sources), tmp_path / "out")
    north = read_recording(path).series["north_m"]
    assert len({*(north.measured_ns // SECOND).tolist()}) >= 99
    assert np.abs(np.diff(north.value)).max() < 10.0


@pytest.mark.parametrize("last", [True, False])
def test_a_date_at_the_end_of_a_burst_makes_no_sentence_a_second_late(last: bool, tmp_path: Path) -> None:
    """A receiver begins with the position and ends with RMC, which alone states the date, or the reverse."""
    lines = []
    for number in range(100):
        clock, place = f"12{number // 60:02d}{number % 60:02d}.00", "6326.4,N,01024.0,E"
        dated = f"GPRMC,{clock},A,{place},10.0,45.0,170526,,,A"
        position = f"GPGGA,{clock},{place},1,10,0.9,5.0,M,40.0,M,,"
        bodies = [position, f"HEHDT,{number}.0,T", dated] if last else [dated, f"HEHDT,{number}.0,T", position]
        lines += map(frame_sentence, bodies)
    (tmp_path / "bridge.log").write_bytes(b"".join(lines))
    (path,), _ = record(config_of(tmp_path, TAGGED), tmp_path / "out")
    heading = read_recording(path).series["heading_deg"]
    assert ((heading.received_ns - START_NS) / SECOND).tolist() == heading.value.tolist()


@pytest.mark.parametrize(("zone", "is_told"), [("", True), ("Z", False), (" +02:00", False)])
def test_times_of_a_log_that_name_no_zone_are_told(zone: str, is_told: bool, tmp_path: Path) -> None:
    lines = [
        f"2026-05-17 12:00:{number:02d}{zone} ".encode() + frame_sentence("HEHDT,5.0,T") for number in range(20)
    ]
    (tmp_path / "bridge.log").write_bytes(b"".join(lines))
    (path,), _ = record(config_of(tmp_path, TAGGED), tmp_path / "out")
    assert any("name no zone" in text for _, text in read_recording(path).events) == is_told


def write_logs_of_a_third(path: Path) -> None:
    path.write_bytes(b"".join(tagged(START_NS + number * SECOND, "HEHDT,5.0,T") for number in range(3)))


def test_a_log_with_times_of_its_own_is_told_nothing(tmp_path: Path) -> None:
    """Nor one whose times count from its beginning."""
    write_logs(tmp_path)
    (tmp_path / "bus.log").write_text("(0.1) can0 123#05\n(0.2) can0 123#05\n")
    (path,), _ = record(config_of(tmp_path, TAGGED, CANDUMP), tmp_path / "out")
    assert not any("no times" in text for _, text in read_recording(path).events)


def test_damage_of_a_log_is_an_error_that_says_where_reading_ended(tmp_path: Path) -> None:
    with can.BLFWriter(tmp_path / "bus.log", compression_level=0) as write:
        for number in range(500):
            write(can.Message(timestamp=START_NS / SECOND + number, arbitration_id=0x123, data=bytes(8)))
    (tmp_path / "bus.log").write_bytes((tmp_path / "bus.log").read_bytes()[:-5000])
    (path,), health = record(config_of(tmp_path, CANDUMP), tmp_path / "out")
    (level, text), *_ = [(level, text) for _, level, text in health.events if "damaged" in text]
    assert level == "error"
    count = health.sources["source0"].frames
    assert "source0: the log is damaged (it was " in text
    assert f"reading ended after {count:,} frames, the last of 2026-05-17T" in text
    assert read_recording(path).closed


def test_lines_that_hold_no_frame_are_counted(tmp_path: Path) -> None:
    (tmp_path / "bus.log").write_text(f"{candump(START_NS, 1.0)}rubbish\n" * 3)
    _, health = record(config_of(tmp_path, CANDUMP), tmp_path / "out")
    told = [(level, text) for _, level, text in health.events if "could not be read" in text]
    assert told == [("warning", "source0: 3 lines of the log could not be read")]


def test_an_empty_file_makes_a_recording_of_today(tmp_path: Path) -> None:
    (tmp_path / "bridge.log").touch()
    before_ns = time.time_ns()
    (path,), _ = record(config_of(tmp_path, TAGGED), tmp_path / "out")
    recording = read_recording(path)
    assert recording.closed
    assert [text for _, text in recording.events] == ["recording stopped"]
    assert recording.start_ns >= before_ns


@pytest.mark.shared
def test_a_real_log_keeps_every_frame(shared_data: Path, tmp_path: Path) -> None:
    """As a plain look at its lines finds them, which is not our reader."""
    log = shared_data / "nmea2000" / "candumpSample1.txt"
    lines = re.findall(r"^<0x([0-9a-f]{8})> \[\d\] ((?:[0-9a-f]{2} ?)*)", log.read_text(), re.MULTILINE)
    (path,), _ = record(config_of(tmp_path, f'type = "can_file"\npath = "{log}"\n'), tmp_path / "out")
    entries = [entry for entry in MessageStream(path) if entry.topic.startswith(RAW_PREFIX)]
    frames = [entry.decode_frame() for entry in entries]
    assert len(frames) > 1_000
    assert [(frame.identifier, frame.payload) for frame in frames] == [
        (int(identifier, 16), bytes.fromhex(data)) for identifier, data in lines
    ]


def test_recordings_of_logs_say_how_each_source_does_by_the_logs_time(tmp_path: Path) -> None:
    """Once a second as live, and at the end: frames so far, refusals with their reasons, what has ended."""
    said, sent = write_logs(tmp_path, seconds=4.0)
    with (tmp_path / "bridge.log").open("ab") as stream:
        stream.write(tagged(START_NS + 5 * SECOND, "HEHDT,5.0,T")[:-4] + b"XX\r\n")
    (path,), _ = record(config_of(tmp_path, TAGGED, CANDUMP), tmp_path / "out")
    entries = [entry for entry in MessageStream(path) if entry.topic == HEALTH_TOPIC]
    first, last = [entry.decode_body() for entry in entries[:2]], [entry.decode_body() for entry in entries[-2:]]
    assert [each["source"] for each in first] == [each["source"] for each in last] == ["source0", "source1"]
    assert 8 <= len(entries) <= 14
    assert all(entry.log_ns <= START_NS + 5 * SECOND for entry in entries)
    assert all(0 <= entry.decode_body()["age_s"] < 6 for entry in entries if "age_s" in entry.decode_body())
    assert [each["frames"] for each in last] == [len(said) + 1, len(sent)]
    assert last[0]["reasons"] == {"no sound checksum": 1}
    assert {each["state"] for each in last} == {"ended"}
    assert read_recording(path).health["source0"]["rejected"] == 1


def test_bad_packets_of_a_telemetry_log_are_told(tmp_path: Path) -> None:
    packets = [(START_NS // 1000 + n).to_bytes(8, "big") + packet for n, packet in enumerate(stream(20, 7))]
    damaged = bytearray(b"".join(packets))
    damaged[len(packets[0]) + 8 + 12] ^= 0xFF
    (tmp_path / "x.tlog").write_bytes(damaged)
    config = config_of(tmp_path, 'type = "mavlink_file"\npath = "x.tlog"\n')
    (path,), health = record(config, tmp_path / "out")
    told = [text for _, level, text in health.events if level == "warning" and "no packet" in text]
    assert told == ["source0: no packet that can be read at 1 place of the log"]
    recording = read_recording(path)
    assert told[0] in [text for _, text in recording.events]
    assert recording.health["source0"]["reasons"]["bad data"] == 1
