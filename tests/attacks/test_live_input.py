"""Attacks on lines, buses, links and brokers: what is intact is decoded, nothing that comes harms the recorder."""

from __future__ import annotations

import gc
import random
import re
import shutil
import socket
import ssl
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import can
import msgpack
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from seatrial.acquisition.config.trial_file import TrialConfig, load_config
from seatrial.acquisition.core.ship import NAMES
from seatrial.acquisition.core.trial import Frame, Sample
from seatrial.acquisition.logger.health import ChannelHealth, Events, Health, SourceHealth
from seatrial.acquisition.logger.maintenance import Maintenance, Timescale
from seatrial.acquisition.logger.pipeline import Inbox, initial_health
from seatrial.acquisition.logger.processing import FrameProcessor
from seatrial.acquisition.protocols.nmea0183 import frame_sentence, xor_checksum
from seatrial.acquisition.recording.parts import RecordingParts
from seatrial.acquisition.recording.reader import Recording, read_recording
from seatrial.acquisition.recording.writer import RecordingWriter
from seatrial.acquisition.sources.lines import LineAssembler
from tests.acquisition.can_frames import identifier_of
from tests.acquisition.conftest import free_port, wait_for
from tests.acquisition.test_faults import Cable, Running, cable, recording, slcan_headings, source, udp
from tests.acquisition.test_running import say
from tests.attacks import hostile_broker, live_floods, mutations
from tests.attacks.commands import PATIENCE_S, run
from tests.benchmarks import wide_load

__all__ = ["cable"]  # the fixture
NOON_NS = 1_798_718_400_000_000_000
COUNT = 400


def heading(number: int) -> bytes:
    """An intact sentence whose value tells which one it is."""
    return frame_sentence(f"HEHDT,{number % 360}.5,T").strip()


HEADINGS = [number % 360 + 0.5 for number in range(COUNT)]


def summed(body: str, start: str = "$") -> bytes:
    return f"{start}{body}*{xor_checksum(body.encode()):02X}".encode()


def noise(chance: random.Random, most: int = 60) -> bytes:
    """Bytes of any value but line ends, one at least that no text has: letters behind # are a comment of a log."""
    return bytes(byte for byte in chance.randbytes(chance.randrange(1, most)) if byte not in b"\r\n") + b"\x07"


AIS = summed("AIVDM,1,1,,A,13HOI:0P0000VOHLCnHQKwvL05Ip,0", "!")
Disturbance = Callable[[random.Random], bytes]
DISTURBANCES: dict[str, Disturbance] = {
    "a cut sentence": lambda chance: heading(7)[: chance.randrange(2, 15)],
    "two cut sentences": lambda chance: heading(7)[: chance.randrange(1, 15)] + summed("GPXTE,1,2")[:8],
    "the end of a sentence": lambda chance: heading(7)[chance.randrange(1, 15) :],
    "another intact sentence": lambda chance: summed("GPXTE,A,A,0.67,L,N"),
    "a sentence with a wrong sum": lambda chance: heading(7)[:-2] + b"00",
    "an AIS sentence": lambda chance: AIS,
    "a cut AIS sentence": lambda chance: AIS[: chance.randrange(2, len(AIS))],
    "a TAG block without its sentence": lambda chance: b"\\" + summed("s:GN01,c:1795255200", "")[:-1] + b"\\",
    "noise": noise,
    "noise with dollar signs": lambda chance: noise(chance) + b"$" + noise(chance) + b"!" + noise(chance),
    "the mark of a binary message": lambda chance: (
        b"\x10\x02" + bytes([chance.randrange(0x90, 0xE0)]) + noise(chance)
    ),
    "text with dollar signs": lambda chance: b"it costs $5, or $HEHDT,12; $$ 100! ",
    "two hundred letters and more": lambda chance: b"abcdefg " * 40 + b"$",
    "zero bytes": lambda chance: bytes(chance.randrange(1, 40)) + b"$",
    "a gateway's sentence": lambda chance: b"$PCDIN,01F119,00000000,0F,2AAF00D1067414FF*59",
    "a cut one of a gateway": lambda chance: b"$MXPGN,01F801,2801,C1308AC4"[: chance.randrange(1, 27)],
    "a gateway's without a sum": lambda chance: b"!PDGY,127257,3,17,255,0.563,AP9/UgAh/v8=",
}


def mostly_long(names: Iterable[str], *quick: str) -> list[Any]:
    """The cases of which only the ``quick`` ones run with every test."""
    return [name if name in quick else pytest.param(name, marks=pytest.mark.attack) for name in names]


@pytest.fixture
def config(tmp_path: Path) -> TrialConfig:
    return configured(tmp_path, source("line", 'type = "udp"\nport = 1', ("heading_deg",)))


def configured(folder: Path, sources: str) -> TrialConfig:
    (folder / "trial.toml").write_text('[trial]\nname = "attack"\n' + sources)
    return load_config(folder / "trial.toml")


def recorded(folder: Path, config: TrialConfig, frames: list[Frame]) -> tuple[Recording, dict[str, int]]:
    """The recording of these frames, and what was refused by reason."""
    health, path = initial_health(config), folder / "attack.mcap"
    with RecordingWriter(path, config.trial, config.attachments) as writer:
        processing = FrameProcessor(config, writer, health)
        for frame in frames:
            processing.process(frame)
    reasons: Counter[str] = Counter()
    for seen in health.sources.values():
        reasons.update(seen.rejection_counts)
    return read_recording(path), reasons


def disturbed(name: str, seed: int = 1) -> list[bytes]:
    """Intact sentences, each behind a disturbance on the same line."""
    chance = random.Random(seed)
    return [DISTURBANCES[name](chance) + heading(number) for number in range(COUNT)]


@pytest.mark.parametrize("name", DISTURBANCES)
def test_an_intact_sentence_behind_a_disturbance_is_decoded(name: str, config: TrialConfig, tmp_path: Path) -> None:
    """On a stream in pieces of any length, and the raw input holds every byte that is no line end or padding."""
    lines, assembler = disturbed(name), LineAssembler("line")
    stream, frames = b"\r\n".join(lines) + b"\r\n", []
    for start in range(0, len(stream), 97):
        at_ns = NOON_NS + start * 1000
        frames += assembler.push(stream[start : start + 97], (at_ns, at_ns))
    frames += assembler.end((at_ns, at_ns))
    result, reasons = recorded(tmp_path, config, frames)
    assert result.series["heading_deg"].value.tolist() == HEADINGS
    if "gateway's" not in name:  # whose frames are recorded as such
        raw = b"".join(frame.payload for frame in frames)
        assert raw == b"".join(line.strip(b"\0 \t") for line in lines)
    if name in ("a cut sentence", "a cut AIS sentence", "a sentence with a wrong sum"):
        assert reasons["no sound checksum"] >= COUNT


@pytest.mark.parametrize("name", DISTURBANCES)
def test_an_intact_sentence_behind_a_disturbance_in_a_log_is_decoded(name: str, tmp_path: Path) -> None:
    from seatrial.acquisition.logger.record import record

    (tmp_path / "a log").write_bytes(b"\r\n".join(disturbed(name)))
    config = configured(tmp_path, source("line", 'type = "file"\npath = "a log"', ("heading_deg",)))
    (path,), _ = record(config, tmp_path / "out")
    assert read_recording(path).series["heading_deg"].value.tolist() == HEADINGS


@pytest.mark.parametrize("name", DISTURBANCES)
def test_an_intact_sentence_behind_a_disturbance_in_an_mqtt_message_is_decoded(name: str, tmp_path: Path) -> None:
    section = 'type = "mqtt"\nport = 1\ntopics = ["#"]'
    config = configured(tmp_path, source("line", section, ("heading_deg",)))
    times = [NOON_NS + number * 10**8 for number in range(COUNT)]
    frames = [
        Frame("line", "mqtt", b"ship/nmea\0" + line, time_ns, time_ns)
        for time_ns, line in zip(times, disturbed(name), strict=True)
    ]
    assert recorded(tmp_path, config, frames)[0].series["heading_deg"].value.tolist() == HEADINGS


@pytest.mark.parametrize("kind", [0x90, 0x93, 0xA0, 0xD0])
def test_noise_like_a_binary_message_holds_no_sentence_back(kind: int) -> None:
    """What seems to begin a message of 1,800 bytes would delay, and stamp too late, what comes within a second."""
    for _ in range(3):
        frames = LineAssembler("line").push(b"\x10\x02" + bytes([kind, 255, 255]) + b"\r\n" + heading(1) + b"\r\n")
        assert frames[-1].payload == heading(1)


def test_sentences_that_follow_each_other_without_a_line_end_are_all_decoded(
    config: TrialConfig, tmp_path: Path
) -> None:
    """Four hundred in one datagram, with TAG blocks and an AIS sentence between them."""
    tag = b"\\" + summed("n:5", "") + b"\\"
    datagram = b"".join((b"", tag, AIS, b"UdPbC\0" + tag)[number % 4] + heading(number) for number in range(COUNT))
    assembler = LineAssembler("line")
    frames = assembler.push(datagram, (NOON_NS, NOON_NS)) + assembler.end((NOON_NS, NOON_NS))
    result, _ = recorded(tmp_path, config, frames)
    assert result.series["heading_deg"].value.tolist() == HEADINGS
    assert b"".join(frame.payload for frame in frames) == datagram


def test_sentences_of_gateways_that_follow_each_other_without_a_line_end_are_all_decoded() -> None:
    seasmart, mxpgn = b"$PCDIN,01F119,00000000,0F,2AAF00D1067414FF*59", b"$MXPGN,01F801,2801,C1308AC40C5DE343*19"
    line = seasmart + b"$HEHD" + mxpgn + heading(1) + b"$MXPGN,01F8" + seasmart + b"\r\n"
    (message, sentence_behind) = LineAssembler("line").push(seasmart + heading(1) + b"\r\n")
    assert (message.payload.hex(), sentence_behind.payload) == ("2aaf00d1067414ff", heading(1))
    frames = LineAssembler("line").push(line)
    messages = [frame.payload.hex() for frame in frames if frame.protocol == "can"]
    assert messages == ["2aaf00d1067414ff", "43e35d0cc48a30c1", "2aaf00d1067414ff"]
    assert b"".join(frame.payload for frame in frames if frame.protocol == "nmea0183") == (
        b"$HEHD" + heading(1) + b"$MXPGN,01F8"
    )


def test_sentences_in_endless_noise_are_decoded(config: TrialConfig, tmp_path: Path) -> None:
    """A line without a line end, ten times longer than any line: what is cut off for want of room cuts none."""
    chance = random.Random(5)
    stream = b"".join(noise(chance, 400) + heading(number) for number in range(COUNT))
    assembler, frames = LineAssembler("line"), []
    for start in range(0, len(stream), 1000):
        frames += assembler.push(stream[start : start + 1000], (NOON_NS + start, NOON_NS + start))
    frames += assembler.end((NOON_NS + len(stream), NOON_NS + len(stream)))
    result, _ = recorded(tmp_path, config, frames)
    assert result.series["heading_deg"].value.tolist() == HEADINGS
    assert b"".join(frame.payload for frame in frames).strip(b"\0") == stream.strip(b"\0")


@pytest.mark.parametrize("text", ["no value in $5 or $HEHDT,12.3,T or !", "$HEHDT,12.3,T*", "a$HEHDT,12.3,T*1E"])
def test_noise_becomes_no_value(text: str, config: TrialConfig, tmp_path: Path) -> None:
    """A dollar sign, a sentence without a sum or with a wrong one: nothing is decoded, and all of it is counted."""
    frames = [Frame("line", "nmea0183", text.encode(), NOON_NS, NOON_NS)] * 3
    result, reasons = recorded(tmp_path, config, frames)
    assert not result.series
    assert reasons == {"no sound checksum": 3}


def test_a_million_random_bytes_become_no_value(config: TrialConfig, tmp_path: Path) -> None:
    """Of the letters of sentences, so that much looks like one; a sum matches by chance once in 256 times."""
    chance = random.Random(3)
    letters = b"$!,*\\0123456789ABCDEF.HDTGPNE"
    assembler = LineAssembler("line")
    frames = [
        frame for _ in range(300)
        for frame in assembler.push(bytes(chance.choices(letters, k=3400)) + b"\n", (NOON_NS, NOON_NS))
    ]  # fmt: skip
    result, reasons = recorded(tmp_path, config, frames)
    assert not result.series
    assert sum(reasons.values()) >= 300


@pytest.mark.parametrize("transport", ["serial", "udp", "tcp"])
@pytest.mark.attack
def test_a_recorder_decodes_what_is_intact_on_a_disturbed_line(
    transport: str, tmp_path: Path, cable: Cable
) -> None:
    """Cut sentences, noise and intact ones, 400 of each, live."""
    lines = [line for name in ("a cut sentence", "noise with dollar signs") for line in disturbed(name)]
    port = free_port(socket.SOCK_STREAM if transport == "tcp" else socket.SOCK_DGRAM)
    server = socket.create_server(("127.0.0.1", port)) if transport == "tcp" else None
    section = f'type = "serial"\ndevice = "{cable.path}"' if transport == "serial" else f"port = {port}\ntype = "
    section += f'"{transport}"' if transport != "serial" else ""
    with recording(tmp_path, source("line", section, ("heading_deg",))) as running:
        for send in senders(transport, server, port, cable):
            for number, line in enumerate(lines):
                send(line + b"\r\n")
                if number % 20 == 0:
                    time.sleep(0.01)
        running.wait_for_frames("line", len(lines))
    values = running.recording.series["heading_deg"].value.tolist()
    assert Counter(values) == Counter(HEADINGS * 2)
    raw = Counter(frame.payload for frame in running.raw("line"))
    assert raw == Counter(line.strip(b"\0 \t") for line in lines)


def senders(
    transport: str, server: socket.socket | None, port: int, cable: Cable
) -> Iterator[Callable[[bytes], object]]:
    if transport == "serial":
        yield cable.send
    elif server is not None:
        client, _ = server.accept()
        with client, server:
            yield client.sendall
            time.sleep(1.0)
    else:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line:
            yield lambda data: line.sendto(data, ("127.0.0.1", port))


ENDLESS = {
    "blanks behind a sum": b"$A,*1F" + b" " * 60_000 + b"*",
    "commas behind a sum": b"$A,*1F" + b"," * 60_000 + b"*",
    "beginnings of sentences": b"$HEHDT," * 9_000,
    "dollar signs": b"$" * 64_000,
    "openings of TAG blocks": b"\\s:" * 20_000 + b"$",
    "sums": b"*1F" * 20_000,
    "escaped marks of binary messages": b"\x10\x10\x02" * 21_000,
    "escaped beginnings of binary messages": b"\x10\x10\x02\xd0" * 16_000,
    "zero bytes": bytes(64_000),
    "letters": b"A" * 64_000,
    "digits": b"1" * 64_000,
    "colours": b"\x1b[0;" * 16_000,
}


@pytest.mark.attack
@pytest.mark.parametrize("name", ENDLESS)
def test_a_line_of_64_kb_costs_no_more_than_its_length(name: str) -> None:
    """A hundred of each: what grows with the square of the length takes ten minutes, and holds up all sources."""
    run([sys.executable, "-c", READ_ENDLESS, name], patience_s=PATIENCE_S).done()


READ_ENDLESS = """
import sys
from seatrial.acquisition.sources.log_formats import LineReader
from tests.attacks.test_live_input import ENDLESS, NOON_NS, LineAssembler
line, reader, assembler = ENDLESS[sys.argv[1]], LineReader(), LineAssembler("line")
for _ in range(100):
    assert all(len(frame.payload) <= 8192 for frame in assembler.push(line + b"\\r\\n", (NOON_NS, NOON_NS)))
    list(reader.entries([line]))
"""


BODIES = (
    "HEHDT,{0}.5,T", "TIROT,{0}.0,A", "VDVBW,,,V,5.{1},0.{1},A", "WIMWD,{0}.0,T,,M,,N,5.{1},M",
    "GPGGA,{2},6326.4{1},N,01024.0{1},E,4,12,0.6,0.0,M,0.0,M,,", "RCTRD,1,{0}.0,R,,V,", "RCTRD,2,{0}.0,R,,V,10.0",
    "RCTRD,4,{0}.0,R,,V,10.0", "GPZDA,{2},31,12,2026,00,00",
)  # fmt: skip
GATEWAYS = "".join(udp(name, number, *NAMES) for number, name in enumerate(("gateway", "spare"), 1))


def every_channel(line: str, at_s: float, measured_s: float | None = None) -> list[Frame]:
    """Every channel in one moment, as a line says it; received ``at_s``, measured then or at another time."""
    measured_s = at_s if measured_s is None else measured_s
    clock = f"{time.strftime('%H%M%S', time.gmtime(43_200 + measured_s))}.{round(measured_s % 1 * 100):02d}"
    at_ns, tenths = NOON_NS + round(at_s * 1e9), round(measured_s * 10)
    return [
        Frame(line, "nmea0183", frame_sentence(body.format(tenths % 300, tenths % 10, clock)).strip(), at_ns, at_ns)
        for body in BODIES
    ]


def outage(replays: bool) -> list[Frame]:
    """A minute of both lines, ten times a second; the first is silent for 20 s, and may send then what it kept."""
    frames = []
    for tenth in range(600):
        silent = 200 <= tenth < 400
        frames += every_channel("spare", tenth / 10 + 0.05)
        if not silent:
            frames += every_channel("gateway", tenth / 10)
        if tenth == 400 and replays:
            frames += [
                frame
                for late in range(200)
                for frame in every_channel("gateway", 40.0 + late * 1e-4, 20.0 + late / 10)
            ]
    return sorted(frames, key=lambda frame: frame.monotonic_ns)


@pytest.mark.parametrize(
    "replays", [False, True], ids=["silent and back", "silent, back, and replays what it kept"]
)
def test_an_outage_and_a_return_are_one_event_each(replays: bool, tmp_path: Path) -> None:
    """Which names the channels; a mark and an alarm from before stay in sight."""
    config, path = configured(tmp_path, GATEWAYS), tmp_path / "attack.mcap"
    health = initial_health(config)
    with RecordingWriter(path, config.trial, config.attachments) as writer:
        processing = FrameProcessor(config, writer, health)
        processing.note("start zigzag", NOON_NS, "info", "mark")
        processing.note("ALARM no heading", NOON_NS, "error", "alarm")
        for frame in outage(replays):
            processing.process(frame)
        processing.report_handovers()
    events = [text for _, text in read_recording(path).events]
    changes = [text for text in events if "from" in text and "clock" not in text]
    assert len(changes) == 2
    for text, (before, after) in zip(changes, (("gateway", "spare"), ("spare", "gateway")), strict=True):
        assert f"13 channels: from {before} to {after}" in text
        assert all(name in text for name in NAMES)
    assert len([text for text in events if "was set" in text]) <= 2
    assert len(events) <= 12
    shown = [text for _, _, text in health.events]
    assert {"start zigzag", "ALARM no heading"} <= set(shown)


def fed(channel: ChannelHealth, source_name: str, *stretches: tuple[float, float, float]) -> None:
    """Samples of one source: from, to [s] and how many a second, of each stretch; looked at ten times a second."""
    times = sorted(
        start_s + number / rate_hz
        for start_s, end_s, rate_hz in stretches
        for number in range(round((end_s - start_s) * rate_hz))
    )
    looked = 0
    for at_s in times:
        channel.add_sample(Sample("heading_deg", 1.0, source_name, 0, round(at_s * 1e9), 0))
        if round(at_s * 10) != looked:
            looked = round(at_s * 10)
            channel.grade(round(at_s * 1e9))


@pytest.mark.parametrize("burst_s", [0.5, 2.0, 8.0])
@pytest.mark.parametrize("at_s", [0.0, 30.0, 111.0])
def test_a_burst_is_not_taken_for_the_usual_rate(burst_s: float, at_s: float) -> None:
    """A gateway sends what it kept for a minute: ten values a second are no less than usual afterwards."""
    channel = ChannelHealth()
    fed(channel, "gateway/HE:HDT", (0.0, 240.0, 10.0), (at_s, at_s + burst_s, 600.0 / burst_s))
    assert channel.reference_hz == pytest.approx(10.0, rel=0.05)
    assert channel.grade(240_000_000_000) == "good"


@pytest.mark.parametrize("overlap_s", [1.0, 10.0, 50.0])
def test_two_senders_at_once_are_not_taken_for_the_usual_rate(overlap_s: float) -> None:
    channel = ChannelHealth()
    fed(channel, "gateway/HE:HDT", (0.0, 300.0, 10.0), (120.0, 120.0 + overlap_s, 10.0))
    assert channel.reference_hz == pytest.approx(10.0, rel=0.05)
    assert channel.grade(300_000_000_000) == "good"


def test_a_channel_that_has_become_slow_is_slow_for_as_long_as_it_is() -> None:
    for at_s in (70, 300, 1000):
        channel = ChannelHealth()
        fed(channel, "gateway/HE:HDT", (0.0, 60.0, 10.0), (60.0, float(at_s), 4.0))
        assert channel.grade(at_s * 1_000_000_000) == "slow"


@pytest.mark.parametrize("rows", [3, 5, 8, 40])
def test_marks_and_alarms_are_not_pushed_out_of_the_display(rows: int) -> None:
    """By a hundred warnings and errors, on a terminal with room for three events or for all."""
    events = Events()
    events.append((NOON_NS, "info", "start zigzag"), "mark")
    events.append((NOON_NS, "error", "ALARM no heading"), "alarm")
    for number in range(100):
        events.append((NOON_NS + number, "warning" if number % 2 else "error", f"event {number}"))
    shown = [text for _, _, text in events.newest(rows)]
    assert {"start zigzag", "ALARM no heading"} <= set(shown)
    assert "event 99" in shown or rows < 4
    assert len(shown) <= rows
    assert shown[:2] == ["start zigzag", "ALARM no heading"]
    assert len(list(events)) < 40


def test_sources_that_fall_silent_together_are_one_event(config: TrialConfig, tmp_path: Path) -> None:
    """A switch that loses power and gets it back: thirty ports, of which half are heard 0.4 s later."""
    health, events = Health({f"port {number}": SourceHealth(f"port {number}") for number in range(30)}), []
    parts = RecordingParts(tmp_path, config.trial, {}, config.recording)
    watch = Maintenance(config.recording, parts, health, Timescale(0, 0), lambda level, text: events.append(text))
    for at_s in range(60):
        now_ns = health.started_ns + at_s * 1_000_000_000
        for number, seen in enumerate(health.sources.values()):
            if at_s < 20 or at_s >= 40:
                seen.add_frames(1, now_ns - number % 2 * 400_000_000)
        watch._report_silence(now_ns)
    parts.close()
    silent, again = events
    for text in events:
        assert text.startswith("30 sources")
        assert all(name in text for name in health.sources)
    assert "silent" in silent
    assert re.search(r"after up to 2[01]\.\d s", again)


def test_a_source_that_failed_is_not_reported_as_silent_as_well(config: TrialConfig, tmp_path: Path) -> None:
    """It is open again and has events nothing yet: one outage, which the receiver reports."""
    health, events = Health({"gateway": SourceHealth("gateway")}), []
    parts = RecordingParts(tmp_path, config.trial, {}, config.recording)
    watch = Maintenance(config.recording, parts, health, Timescale(0, 0), lambda level, text: events.append(text))
    seen = health.sources["gateway"]
    seen.add_frames(1, health.started_ns)
    seen.failed_ns = health.started_ns + 1_000_000_000
    for at_s in range(2, 30):
        seen.state = "failed" if at_s < 10 else "open"
        watch._report_silence(health.started_ns + at_s * 1_000_000_000)
    parts.close()
    assert events == []


REASONS = {
    "no sound checksum", "TAG block with a wrong checksum", "no time", "no value", "not marked valid",
    "rpm of no shaft", "rpm of a single or unknown shaft", "wind reference unknown", "unit unknown",
    "more than two rudders", "one order to several rudders", "order to an unknown shaft", "thruster not understood",
    "remote, error or 11-bit frame", "frame of other than 8 bytes", "impossible length", "incomplete fast packet",
    "wind without a reference", "heading without a reference", "course without a reference", "no fix",
    "impossible deviation", "impossible value", "not available", "error value", "another instance",
    "another system", "bad data", "unknown message", "no number", "no JSON object", "no sentence", "came twice",
    "outside its channel's range", "longer than 64 kB", "frame that cannot be read",
    "no talker and kind",
}  # fmt: skip


@pytest.mark.parametrize("name", live_floods.FLOODS)
def test_a_flood_of_strangers_hides_no_device(name: str) -> None:
    """The intact device among them is decoded each time; why others are not has names of ours, not of theirs."""
    count, sent, reasons = live_floods.decoded(name, 2_200)
    assert count == sent > 0
    assert set(reasons) <= REASONS


@pytest.mark.attack
@pytest.mark.parametrize("name", live_floods.FLOODS)
def test_a_long_flood_of_strangers_takes_no_memory(name: str) -> None:
    """Some ten thousand names: with all that is kept of each the process had 900 MB."""
    outcome = run([sys.executable, "-m", "tests.attacks.live_floods", name]).done()
    count, sent = map(int, re.findall(r"\d+", outcome.out))
    assert count == sent > 0
    assert outcome.peak_mb < 300.0  # 225 are the libraries, asammdf among them


def test_large_frames_fill_neither_memory_nor_a_turn_of_the_recorder() -> None:
    """Datagrams of 64 kB without end while nothing can be written, and what the recorder takes of them at once."""
    inbox = Inbox(["flood", "calm"], 50_000)
    datagram = Frame("flood", "mavlink", b"\xfe" * 64_000, NOON_NS, NOON_NS)
    admitted = sum(inbox.put("flood", [datagram] * 100) for _ in range(500))
    assert admitted * len(datagram.payload) <= 256_000_000
    assert inbox.put("calm", [datagram._replace(origin="calm")]) == 1
    for _ in range(10):
        taken = inbox.take()
        assert 0 < sum(len(frame.payload) for frame in taken) < 1_000_000
    assert inbox.put("flood", [datagram] * 5) == 5  # there is room again
    waiting = len(inbox)
    while taken := inbox.take():
        waiting -= len(taken)
    assert waiting == len(inbox) == 0


def test_small_frames_are_admitted_up_to_their_number() -> None:
    inbox = Inbox(["line"], 1_000)
    frame = Frame("line", "nmea0183", heading(1), NOON_NS, NOON_NS)
    assert inbox.put("line", [frame] * 700) == 700
    assert inbox.put("line", [frame] * 700) == 300


MULTICAST = "239.74.163.2"
FRAME_FIELDS = {
    "timestamp": 0.0, "arbitration_id": identifier_of(127250), "is_extended_id": True, "is_remote_frame": False,
    "is_error_frame": False, "channel": None, "dlc": 8, "data": bytes(8), "is_fd": False, "bitrate_switch": False,
    "error_state_indicator": False,
}  # fmt: skip
MALFORMED = {
    "noise": lambda chance: chance.randbytes(chance.randrange(1, 300)),
    "nothing": lambda chance: b"",
    "a number": lambda chance: msgpack.packb(5),
    "another field": lambda chance: msgpack.packb({**FRAME_FIELDS, "os": 1}),
    "text for data": lambda chance: msgpack.packb({**FRAME_FIELDS, "data": "heading!"}),
    "a length for data": lambda chance: msgpack.packb({**FRAME_FIELDS, "data": 2**45}),
    "a length that lies": lambda chance: msgpack.packb({**FRAME_FIELDS, "dlc": 7}),
    "a thousand bytes": lambda chance: msgpack.packb({**FRAME_FIELDS, "data": bytes(1000), "dlc": 1000}),
    "a fraction for an identifier": lambda chance: msgpack.packb({**FRAME_FIELDS, "arbitration_id": 1234.5}),
    "an identifier of 40 bits": lambda chance: msgpack.packb({**FRAME_FIELDS, "arbitration_id": 2**40}),
    "a negative identifier": lambda chance: msgpack.packb({**FRAME_FIELDS, "arbitration_id": -1}),
    "text for an identifier": lambda chance: msgpack.packb({**FRAME_FIELDS, "arbitration_id": "123"}),
    "depth": lambda chance: b"\x91" * 900 + b"\xc0",
    "4 kB": lambda chance: b"\xc4" * 4096,
}


@pytest.mark.parametrize(
    "name", mostly_long([*MALFORMED, "noise on a serial adapter"], "noise", "a length that lies")
)
def test_malformed_frames_close_no_bus(name: str, tmp_path: Path, cable: Cable) -> None:
    """One datagram of a stranger closed it, and what had been read with it was lost."""
    chance, port = random.Random(1), free_port()
    if on_line := name not in MALFORMED:
        options = f'interface = "slcan"\nchannel = "{cable.path}"\noptions = {{ sleep_after_open = 0.0 }}'
    else:
        options = (
            f'interface = "udp_multicast"\nchannel = "{MULTICAST}"\noptions = {{ hop_limit = 0, port = {port} }}'
        )
    with (
        recording(tmp_path, source("bus", f'type = "can"\n{options}', ("heading_deg",))) as running,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger,
        can.Bus(interface="udp_multicast", channel=MULTICAST, hop_limit=0, port=port) as bus,
    ):
        for number in range(50):
            if on_line:
                noise_line = chance.choice([b"T-1234567", b"t12", b"Tzzzzzzzz8", b"r1", b"d1zz", b"\xff\xfe\0t"])
                cable.send(noise_line + b"\r" + slcan_headings(range(number, number + 1)))
            else:
                stranger.sendto(MALFORMED[name](chance), (MULTICAST, port))
                bus.send(can.Message(
                    arbitration_id=identifier_of(127250), data=bytes([number]) + bytes.fromhex("7b2cff7fff7ffc"),
                ))  # fmt: skip
            running.wait_for_frames("bus", number + 1)
    assert running.told("failed") == running.told("is back") == 0
    assert running.recording.series["heading_deg"].value.size == 50
    assert running.sources["bus"].rejection_counts["frame that cannot be read"] >= 30


def frames_of_a_flood(chance: random.Random, count: int) -> Iterator[can.Message]:
    """Every priority, 11 and 29 bits, remote, error and FD frames, claims, parts of messages of every number."""
    for number in range(count):
        kind, address = number % 6, chance.randrange(36, 254)
        identifier, data = chance.getrandbits(29), chance.randbytes(chance.choice((0, 3, 8)))
        if kind == 1:
            identifier, data = 0x18EEFF00 | address, chance.randbytes(8)
        elif kind == 2:
            identifier = identifier_of(129029, address, priority=number % 8)
            data = bytes([chance.randrange(256)]) + chance.randbytes(7)
        is_extended, is_fd, is_remote = kind != 3, kind == 4, kind == 5 and number % 2 == 0
        yield can.Message(
            arbitration_id=identifier if is_extended else identifier & 0x7FF, is_extended_id=is_extended,
            is_fd=is_fd, data=b"" if is_remote else chance.randbytes(64) if is_fd else data,
            is_remote_frame=is_remote, is_error_frame=kind == 5 and not is_remote,
        )  # fmt: skip


@pytest.mark.attack
@pytest.mark.parametrize("interface", ["virtual", "udp_multicast"])
def test_a_flooded_bus_costs_no_other_source_a_value(interface: str, tmp_path: Path) -> None:
    """Thirty thousand frames as fast as they go: each is recorded or counted as lost."""
    port, bus_port, count = free_port(), free_port(), 30_000
    options = {"hop_limit": 0, "port": bus_port} if interface == "udp_multicast" else {}
    channel = MULTICAST if interface == "udp_multicast" else f"flood-{bus_port}"
    listed = ", ".join(f"{name} = {value}" for name, value in options.items())
    section = f'type = "can"\ninterface = "{interface}"\nchannel = "{channel}"\noptions = {{ {listed} }}'
    sources = source("bus", section, ("heading_deg", "north_m", "east_m")) + udp("beside", port, "yaw_rate_dps")
    with (
        can.Bus(interface=interface, channel=channel, **options) as bus,
        recording(tmp_path, sources) as running,
    ):
        for number, message in enumerate(frames_of_a_flood(random.Random(1), count)):
            bus.send(message)
            if number % 300 == 0:
                say(port, f"TIROT,{6 * (number // 300)},A")
        bus.send(can.Message(arbitration_id=identifier_of(127250), data=bytes.fromhex("007b2cff7fff7ffc")))
        seen = running.sources["bus"]
        wait_for(lambda: seen.frames + seen.dropped + seen.over_budget >= count + 1)
        running.wait_for_frames("beside", 100)
    recorded_frames = running.recording.raw["/raw/can/bus"]
    assert recorded_frames + seen.dropped >= count + 1
    assert running.recording.series["yaw_rate_dps"].value == pytest.approx([number / 10 for number in range(100)])
    assert running.told("decoder|unexpected|could not be interpreted") == 0
    assert running.recording.series["heading_deg"].value.size >= (seen.dropped == 0)
    assert set(seen.rejection_counts) <= REASONS


def mqtt(port: int, more: str = "") -> str:
    section = f'type = "mqtt"\nport = {port}\ntopics = ["ship/#"]\n{more}'
    return source("broker", section, ("heading_deg",))


def spoken(number: int) -> bytes:
    return hostile_broker.message(b"ship/nmea", heading(number))


ODD = {
    "no UTF-8": hostile_broker.message(b"ship/\xff\xfe", heading(1)[:-2]),
    "a zero byte": hostile_broker.message(b"ship/\0/x", b"1"),
    "64 kB": hostile_broker.message(b"ship/" + b"a" * 65_000, b"1"),
    "control characters": hostile_broker.message("ship/\x1b[2J\u202e\n".encode(), b"\x1b[2J"),
    "wildcards": hostile_broker.message(b"ship/#/+", b"1"),
    "of another tree": hostile_broker.message(b"$SYS/uptime", b"1"),
    "retained": hostile_broker.message(b"ship/nmea", heading(99), retained=True),
    "empty": hostile_broker.message(b"ship/nmea", b""),
    "10 MB": hostile_broker.message(b"ship/nmea", b"\xff" * 10_000_000),
    "10 MB of lines": hostile_broker.message(b"ship/nmea", b"$HEHDT,1.0,T\n" * 700_000),
    "a picture": hostile_broker.message(b"ship/nmea", bytes(range(256)) * 100),
}


@pytest.mark.parametrize("name", [name for name in ODD if "MB" not in name])
def test_odd_messages_of_a_broker_cost_no_other(name: str, tmp_path: Path) -> None:
    odd_between_values(ODD[name], tmp_path)


@pytest.mark.attack
@pytest.mark.parametrize("name", ["10 MB", "10 MB of lines"])
def test_large_messages_of_a_broker_cost_no_other(name: str, tmp_path: Path) -> None:
    odd_between_values(ODD[name], tmp_path)


def odd_between_values(odd: bytes, folder: Path) -> None:
    port = free_port(socket.SOCK_STREAM)

    def behave(client: socket.socket) -> None:
        for number in range(20):
            client.sendall(spoken(number) + (odd if number in (3, 10) else b""))

    with (
        hostile_broker.HostileBroker(port, behave),
        recording(folder, mqtt(port) + udp("beside", free_port())) as running,
    ):
        wait_for(lambda: running.recorder.health.channels["heading_deg"].count >= 20)
    assert running.recording.series["heading_deg"].value.tolist() == HEADINGS[:20]
    assert running.told("lost|failed|unexpected|decoder") == 0


BREAKS = {
    "closes": b"",
    "sends noise": b"\xff" * 100,
    "sends a length that lies": hostile_broker.packet(0x30, b"\0\x03abc", length=2**27),
    "sends a length without end": b"\x30" + b"\xff" * 10,
    "sends a topic longer than its packet": hostile_broker.packet(0x30, b"\xff\xffabc"),
    "sends an empty topic": hostile_broker.message(b"", b"1"),
    "sends an empty packet": hostile_broker.packet(0x30, b""),
    "sends quality of service 3": hostile_broker.packet(0x36, b"\0\x01a\0\x01x"),
    "connects it again": hostile_broker.packet(0x20, b"\0\0"),
    "sends what only subscribers send": hostile_broker.packet(0x82, b"\0\x01\0\x01#\0"),
}


@pytest.mark.parametrize("name", mostly_long(BREAKS, "closes", "sends a length that lies"))
def test_a_broker_that_breaks_the_protocol_is_returned_to(name: str, tmp_path: Path) -> None:
    """What came before it is recorded; the next connection goes on."""
    port, connections = free_port(socket.SOCK_STREAM), []

    def behave(client: socket.socket) -> None:
        connections.append(client)
        if len(connections) == 1:
            client.sendall(spoken(1) + spoken(2) + BREAKS[name])
            time.sleep(0.2)
            client.shutdown(socket.SHUT_RDWR)
        else:
            client.sendall(spoken(3))

    with (
        hostile_broker.HostileBroker(port, behave),
        recording(tmp_path, mqtt(port) + udp("beside", free_port())) as running,
    ):
        wait_for(lambda: running.recorder.health.channels["heading_deg"].count >= 3)
    assert running.recording.series["heading_deg"].value.tolist() == [1.5, 2.5, 3.5]
    assert running.told("source 'broker' is back") == 1


@pytest.mark.parametrize("answer", [hostile_broker.WRONG_PASSWORD, hostile_broker.NOT_AUTHORISED])
def test_a_broker_that_refuses_is_asked_again_and_no_password_is_told(
    answer: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SECRET", "hunter2-hunter2")
    port = free_port(socket.SOCK_STREAM)
    broker = hostile_broker.HostileBroker(port, lambda client: client.sendall(spoken(3)))
    broker.answer = answer
    credentials = 'user = "trial"\npassword_variable = "SECRET"'
    with broker, recording(tmp_path, mqtt(port, credentials) + udp("beside", free_port())) as running:
        wait_for(lambda: len(broker.passwords) >= 2)
        broker.answer = hostile_broker.ACCEPTED
        wait_for(lambda: running.recorder.health.channels["heading_deg"].count >= 1)
    assert running.told("refuses the connection.*correct `user` and its password") == 1
    assert all(b"hunter2-hunter2" in sent for sent in broker.passwords)
    assert b"hunter2" not in running.parts.path.read_bytes()


@pytest.fixture(scope="module")
def certificate(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A certificate of this computer, signed by itself, and its key."""
    openssl = shutil.which("openssl")
    if openssl is None:
        pytest.skip("needs openssl to make a certificate")
    folder = tmp_path_factory.mktemp("certificate")
    certificate, key = folder / "certificate.pem", folder / "key.pem"
    subprocess.run(
        [openssl, "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-subj", "/CN=localhost",
         "-addext", "subjectAltName=IP:127.0.0.1", "-keyout", key, "-out", certificate],
        check=True, capture_output=True,
    )  # fmt: skip
    return certificate, key


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # paho leaves its socket to Python
@pytest.mark.parametrize("trusted", [True, False], ids=["its own authority", "an unknown authority"])
def test_a_broker_by_tls_is_believed_by_its_certificate_alone(
    trusted: bool, tmp_path: Path, certificate: tuple[Path, Path]
) -> None:
    port, context = free_port(socket.SOCK_STREAM), ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(*certificate)
    tls = f'ca_file = "{certificate[0]}"' if trusted else "tls = true"
    with (
        hostile_broker.HostileBroker(port, lambda client: client.sendall(spoken(3)), context) as broker,
        recording(tmp_path, mqtt(port, tls) + udp("beside", free_port())) as running,
    ):
        if trusted:
            wait_for(lambda: running.recorder.health.channels["heading_deg"].count >= 1)
        else:
            running.wait_for_state("broker", "failed")
    gc.collect()
    assert bool(broker.passwords) == trusted
    assert running.told("certificate cannot be trusted.*correct `port`, `tls` and `ca_file`") == (not trusted)


@pytest.mark.attack
def test_a_broker_that_never_answers_keeps_nothing_waiting(tmp_path: Path) -> None:
    port, beside = free_port(socket.SOCK_STREAM), free_port()
    with socket.create_server(("127.0.0.1", port)):
        running = Running(tmp_path, mqtt(port) + udp("beside", beside, "yaw_rate_dps"))
        running.recorder.start()  # does not wait for the broker
        running.wait_for_state("beside", "open")
        say(beside, "TIROT,6,A")
        running.wait_for_frames("beside", 1)
        running.wait_for_state("broker", "failed")
        running.recorder.stop()
        running.parts.close()
    assert running.recording.series["yaw_rate_dps"].value == pytest.approx([0.1])
    assert running.told("does not answer") == 1


@pytest.mark.attack
def test_a_broker_that_floods_costs_no_other_source_a_value(tmp_path: Path) -> None:
    port, beside, count = free_port(socket.SOCK_STREAM), free_port(), 30_000

    def behave(client: socket.socket) -> None:
        for start in range(0, count, 100):
            client.sendall(b"".join(spoken(number) for number in range(start, start + 100)))

    sources = mqtt(port) + udp("beside", beside, "yaw_rate_dps")
    with hostile_broker.HostileBroker(port, behave), recording(tmp_path, sources) as running:
        for number in range(50):
            say(beside, f"TIROT,{6 * number},A")
        seen = running.sources["broker"]
        wait_for(lambda: seen.frames >= count)
        running.wait_for_frames("beside", 50)
    assert running.recording.raw["/raw/mqtt/broker"] + seen.dropped == count
    assert running.recording.series["yaw_rate_dps"].value.size == 50


@pytest.mark.shared
@pytest.mark.parametrize("protocol", mutations.FOLDERS)
def test_mutated_captures_break_no_decoder(protocol: str, shared_data: Path) -> None:
    """Bits flipped, bytes cut out, doubled, swapped: nothing fails or is out of range, the rest is as before."""
    counts = mutations.attack(protocol, 600, seed=1)
    assert counts["values"] > 120


@pytest.mark.attack
@pytest.mark.shared
@pytest.mark.parametrize("seed", [2, 3])
@pytest.mark.parametrize("protocol", mutations.FOLDERS)
def test_captures_that_are_mutated_for_minutes_break_no_decoder(
    protocol: str, seed: int, shared_data: Path
) -> None:
    """All in all some five minutes, in a process of its own: its memory does not grow with what is refused."""
    outcome = run([sys.executable, "-m", "tests.attacks.mutations", protocol, "60000", str(seed)]).done()
    assert "values" in outcome.out
    assert outcome.peak_mb < 400.0


@pytest.mark.parametrize("forged", [False, True], ids=["signed", "with a forged signature"])
def test_a_signed_packet_is_decoded_whoever_signed_it(forged: bool, tmp_path: Path) -> None:
    """Signatures are not verified, as the documentation says; what is damaged is refused by its checksum."""
    link = dialect.MAVLink(None, srcSystem=1)
    link.signing.secret_key, link.signing.sign_outgoing = bytes(32), True
    packets = [
        bytearray(link.attitude_encode(number, 0.0, 0.0, number / 10, 0.0, 0.0, 0.1).pack(link))
        for number in range(20)
    ]
    for packet in packets if forged else ():
        packet[-6:] = b"forged"
    damaged = [packet[:12] + bytes([packet[12] ^ 1]) + packet[13:] for packet in packets]
    config = configured(tmp_path, source("link", 'type = "mavlink"\nport = 1', ("heading_deg",)))
    frames = [
        Frame("link", "mavlink", bytes(packet), NOON_NS + number * 10**8, number * 10**8)
        for number, packet in enumerate([*packets, *damaged])
    ]
    result, reasons = recorded(tmp_path, config, frames)
    assert result.series["heading_deg"].value.size == 20
    assert reasons["bad data"] >= 19  # the last may yet go on


@pytest.mark.attack
def test_five_hundred_channels_of_two_hundred_sources_are_recorded(tmp_path: Path) -> None:
    ports: dict[int, None] = {}
    while len(ports) < 200:
        ports[free_port()] = None
    text, sentences = wide_load.configuration(list(ports), 500)
    with recording(tmp_path, text[text.index("[[channel]]") :]) as running:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line:
            for _ in range(20):
                for port, data in sentences:
                    line.sendto(data, ("127.0.0.1", port))
                time.sleep(0.05)
        wait_for(lambda: sum(seen.frames for seen in running.sources.values()) >= 20 * len(sentences))
    series = running.recording.series
    assert len(series) == 500
    assert {channel.value.size for channel in series.values()} == {20}
