"""Gateways and logs of every form: the same bus comes out of each, live and from a file; rubbish breaks none."""

from __future__ import annotations

import gzip
import os
import pty
import re
import select
import socket
import struct
import threading
import time
import tty
from contextlib import closing
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal, get_args

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from nmea2000.encoder import create_encoder
from nmea2000.input_formats import N2KFormat
from nmea2000.message import NMEA2000Field, NMEA2000Message

from seatrial.acquisition.config.sources import FileSource, Form, SerialSource
from seatrial.acquisition.config.trial_file import load_config
from seatrial.acquisition.core.errors import SourceError
from seatrial.acquisition.core.trial import Frame, FrameFlag
from seatrial.acquisition.logger.pipeline import Recorder
from seatrial.acquisition.logger.record import record, summary_text
from seatrial.acquisition.logger.survey import redecode
from seatrial.acquisition.protocols.nmea0183 import frame_sentence
from seatrial.acquisition.recording.parts import RecordingParts
from seatrial.acquisition.recording.reader import Recording, read_recording
from seatrial.acquisition.sources.lines import LineAssembler, SerialPort
from seatrial.acquisition.sources.log_file import LogFile
from seatrial.acquisition.sources.log_formats import FILE_FORMS, LINE_FORMS, LineReader, StreamCutter
from tests.acquisition import bus_logs
from tests.acquisition.bus_logs import FORMS, FRAMES, MESSAGES, SECOND, START_NS
from tests.acquisition.can_frames import fast_parts, gnss
from tests.acquisition.conftest import free_port, wait_for

CHANNELS = (
    "north_m", "east_m", "heading_deg", "yaw_rate_dps", "apparent_wind_angle_deg", "apparent_wind_speed_mps"
)  # fmt: skip


def read(path: Path, form: Form | Literal[""] = "") -> tuple[list[Frame], LogFile]:
    """Every frame of a log, which must be open to its end."""
    source = LogFile(FileSource(name="log", type="file", path=path, channels=(), form=form))
    source.open()
    frames: list[Frame] = []
    while (some := source.read(0.0)) is not None:
        frames += some
    source.close()
    return frames, source


def written(folder: Path, data: bytes) -> Path:
    path = folder / "a log"
    path.write_bytes(data)
    return path


@pytest.mark.parametrize("name", FORMS)
def test_the_same_bus_comes_out_of_every_form(tmp_path: Path, name: str) -> None:
    """Frame by frame or message by message, at its own times, as exact as they are written."""
    form = FORMS[name]
    frames, source = read(written(tmp_path, form.write()))
    assert (source.damage, bool(source.remark)) == ("", form.exact_ns is None)
    assert source.unreadable == (len(MESSAGES) if name == "Signal K" else 0)
    sent = MESSAGES if form.whole else FRAMES
    assert [frame.payload for frame in frames] == [each.payload for each in sent]
    mask = 0x03FFFFFF if name.startswith("SeaSmart") else 0x1FFFFFFF  # it has no priority
    assert [frame.identifier & mask for frame in frames] == [each.identifier & mask for each in sent]
    late_ns = np.array([frame.received_ns for frame in frames]) - [each.time_ns for each in sent]
    assert np.abs(late_ns).max() <= (SECOND if form.exact_ns is None else form.exact_ns)
    assert all(frame.stamped_ns == frame.received_ns <= frame.monotonic_ns for frame in frames)


def config_text(source: str) -> str:
    channels = ", ".join(f'"{name}"' for name in CHANNELS)
    return (
        '[trial]\nname = "gateway"\norigin = { latitude_deg = 63.4, longitude_deg = 10.4 }\n'
        f'[[source]]\nname = "gate"\nchannels = [{channels}]\n{source}'
    )


def recorded(folder: Path, source: str) -> Recording:
    (folder / "trial.toml").write_text(config_text(source))
    (path,), health = record(load_config(folder / "trial.toml"), folder / "out")
    assert health.sources["gate"].rejected == 0
    return read_recording(path)


def test_the_summary_tells_how_long_the_log_lasts(tmp_path: Path) -> None:
    """Not how long it took to read; of decoding it anew, too."""
    path = written(tmp_path, bus_logs.candump_log())
    (tmp_path / "trial.toml").write_text(config_text(f'type = "file"\npath = "{path}"\n'))
    paths, health = record(load_config(tmp_path / "trial.toml"), tmp_path / "out")
    assert ": 0:02:29, " in summary_text(health, paths)
    again = redecode(paths, tmp_path / "again.mcap")
    assert ": 0:02:29, " in summary_text(again.health, [tmp_path / "again.mcap"])


@pytest.fixture(scope="module")
def by_candump(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    folder = tmp_path_factory.mktemp("candump")
    (folder / "bus.log").write_bytes(bus_logs.candump_log())
    return recorded(folder, 'type = "can_file"\npath = "bus.log"\n')


@pytest.mark.parametrize(
    ("name", "section"),
    [
        ("Yacht Devices RAW", 'type = "file"\n'),
        ("N2K ASCII", 'type = "can_file"\n'),
        ("Actisense 93", 'type = "file"\nform = "actisense"\n'),
        ("EBL", 'type = "file"\n'),
        ("YDVR", 'type = "file"\nform = "ydvr"\n'),
        ("MXPGN", 'type = "file"\n'),
        ("Signal K", 'type = "can_file"\n'),
        ("pcapng", 'type = "file"\n'),
    ],
)
def test_a_recording_has_the_values_of_that_by_candump(
    tmp_path: Path, name: str, section: str, by_candump: Recording
) -> None:
    written(tmp_path, FORMS[name].write())
    recording = recorded(tmp_path, f'{section}path = "a log"\n')
    for channel in CHANNELS:
        ours, theirs = recording.series[channel], by_candump.series[channel]
        assert ours.value.size == theirs.value.size > 100
        assert np.array_equal(ours.value, theirs.value), channel


def test_a_source_that_falls_silent_gives_way_in_the_logs_time(tmp_path: Path) -> None:
    """A minute that is read in a moment: 35 says nothing for 10 s of it, and has the heading again after."""
    lines = [
        f"12:00:{second:02d}.000 R 09F112{source:02X} 00 00 10 FF 7F FF 7F FC"
        for second in range(60)
        for source in (35, 40)
        if source == 40 or not 20 <= second < 30
    ]
    written(tmp_path, "\n".join(lines).encode())
    devices = 'devices = [{ name = "gyro", address = 35 }, { name = "spare", address = 40 }]\n'
    recording = recorded(tmp_path, f'type = "file"\npath = "a log"\n{devices}')
    changes = [text for _, text in recording.events if text.startswith("heading_deg: from")]
    assert [change.split(" to ")[1].split(":")[0] for change in changes] == ["gate/spare", "gate/gyro"]
    came = recording.series["heading_deg"].received_ns
    assert (came[-1] - came[0]) / SECOND == 59.0


ENCODED = [
    NMEA2000Message(
        PGN=127250, id="vesselHeading", priority=2, source=35, destination=255,
        fields=[
            NMEA2000Field(id="sid", raw_value=0), NMEA2000Field(id="heading", value=1.0),
            NMEA2000Field(id="deviation", value=0.1), NMEA2000Field(id="variation", value=0.02),
            NMEA2000Field(id="reference", raw_value=0), NMEA2000Field(id="reserved_58", raw_value=0),
        ],
    )
]  # fmt: skip


@pytest.mark.parametrize(
    "kind",
    [
        N2KFormat.N2K_ASCII, N2KFormat.N2K_ASCII_RAW, N2KFormat.BASIC_STRING, N2KFormat.CAN_FRAME_ASCII_RAW,
        N2KFormat.CAN_FRAME_ASCII_RAW_OUT, N2KFormat.PCDIN, N2KFormat.MXPGN, N2KFormat.PDGY, N2KFormat.CANDUMP1,
        N2KFormat.CANDUMP2, N2KFormat.CANDUMP3, N2KFormat.BST_D0, N2KFormat.BST_95,
    ],
)  # fmt: skip
def test_what_the_librarys_encoders_write_is_read(kind: N2KFormat) -> None:
    """Another's idea of the same forms."""
    encoded = create_encoder(kind).encode(ENCODED[0])
    piece = encoded[0] if isinstance(encoded, list) else encoded
    data = bus_logs.framed(piece[:-1]) if isinstance(piece, bytes) else piece.encode() + b"\n"
    (frame,) = LineAssembler("line").push(data)
    assert (frame.protocol, frame.payload) == ("can", bytes.fromhex("001027e803c80000"))
    assert frame.identifier & 0x03FFFFFF == 0x09F11223 & 0x03FFFFFF
    assert frame.stamped_ns is None


@pytest.mark.parametrize(
    ("line", "identifier", "payload", "flags"),
    [
        ("17:33:21.107 R 19F51323 01 2F 30 70 00 2F 30 70", 0x19F51323, "012f3070002f3070", FrameFlag.NONE),
        ("17:33:21 T 09F1122A 00 01", 0x09F1122A, "0001", FrameFlag.NONE),
        ("19F51323 01 02", 0x19F51323, "0102", FrameFlag.NONE),
        ("A173321.107 23FF7 1F513 012F3070002F30709F", 0x1DF51323, "012f3070002f30709f", FrameFlag.WHOLE),
        ("A173321 23FFF 1F513 012F more", 0x1DF51323, "012f", FrameFlag.WHOLE),
        ("A164027.880 05FF7 0EF00 E598", 0x1CEFFF05, "e598", FrameFlag.WHOLE),
        ("!PDGY,127257,3,17,255,0.563,AP9/UgAh/v8=", 0x0DF11911, "00ff7f520021feff", FrameFlag.WHOLE),
        ("!PDGY,127257,255,AP9/UgAh/v8=", 0x01F11900, "00ff7f520021feff", FrameFlag.WHOLE),
        ("$PCDIN,01F119,00000000,0F,2AAF00D1067414FF*59", 0x01F1190F, "2aaf00d1067414ff", FrameFlag.WHOLE),
        ("$MXPGN,01F801,2801,C1308AC40C5DE343*19", 0x09F80101, "43e35d0cc48a30c1", FrameFlag.NONE),
        ("2018-10-16T22:25:25,166Z,2,128267,35,255,8,ff,ff,ff,ff,ff,00,00,ff", 0x09F50B23, "ffffffffff0000ff", 0),
        ("0,486942,127508,Battery Status,Garmin,6,255,2,1,8,0x017505FF7FFFFFFF", 0x09F21406, "017505ff7fffffff", 8),
    ],
)
def test_lines_from_the_makers_descriptions(line: str, identifier: int, payload: str, flags: int) -> None:
    (frame,) = LineAssembler("line").push(line.encode() + b"\r\n")
    assert (frame.identifier, frame.payload.hex(), frame.flags) == (identifier, payload, flags)


def test_mxpgn_is_where_its_makers_example_lies() -> None:
    """20.748 N, 105.37 W: the most significant byte comes first."""
    (frame,) = LineAssembler("line").push(b"$MXPGN,01F801,2801,C1308AC40C5DE343*19\n")
    assert int.from_bytes(frame.payload[:4], "little", signed=True) / 1e7 == pytest.approx(20.748, abs=1e-3)
    assert int.from_bytes(frame.payload[4:], "little", signed=True) / 1e7 == pytest.approx(-105.37, abs=1e-2)


HEADING = "$HEHDT,12.3,T*1F"


@pytest.mark.parametrize(
    "before",
    [
        "2026-08-07T10:00:00.25Z ", "2026-08-07T10:00:00.250000000Z,", "2026-08-07T12:00:00.25+02:00\t",
        "2026-08-07 06:30:00.25-0330 ", "2026-08-07 10:00:00,250 ", "[2026-08-07 10:00:00.250] ",
        "INNAV\t2026-08-07T10:00:00.250Z\tSEAPATH330\t", "NAV 2026/08/07 10:00:00.250 GPS ",
        "08/07/2026,10:00:00.250,", "cnav\t2026:219:10:00:00.2500\t", "20260807T100000.250Z ",
        "1786096800.25 ", "1786096800250;", "1786096800250000 ", "1786096800250000000,", "1786096800250;N;",
        "gyro 1786096800.250000 | ", "UTC 2026-08-07 10:00:00.25: ", "2026-08-07T10:00:00.250Z,NMEA0183,,\"",
        '2026-08-07T10:00:00.250Z,NMEA0183,HEHDT,"COM3/NMEA0183/HE",',
    ],
)  # fmt: skip
def test_a_sentence_behind_any_time(tmp_path: Path, before: str) -> None:
    """Of loggers ashore and afloat; a date without a zone is UTC."""
    after = '"' if before.endswith('"') else ""
    first, second = read(written(tmp_path, f"{before}{HEADING}{after}\n{before}{HEADING}{after}\r\n".encode()))[0]
    assert first.payload == second.payload == HEADING.encode()
    assert first.stamped_ns == second.stamped_ns == 1_786_096_800_250_000_000


def test_a_sentence_before_its_time(tmp_path: Path) -> None:
    frames, _ = read(written(tmp_path, f"{HEADING},1786096800\n{HEADING} 2026-08-07T10:00:01Z\n".encode()))
    assert [(frame.payload, frame.stamped_ns) for frame in frames] == [
        (HEADING.encode(), 1_786_096_800_000_000_000), (HEADING.encode(), 1_786_096_801_000_000_000)
    ]  # fmt: skip


def test_times_of_day_take_the_date_from_a_sentence_and_run_through_midnight(tmp_path: Path) -> None:
    told = bus_logs.summed("$GPZDA,235958.00,31,12,2025,00,00")
    lines = [f"23:59:58.5 {told}", f"23:59:59.5 {HEADING}", f"00:00:00.5 {HEADING}"]
    frames, source = read(written(tmp_path, "\n".join(lines).encode()))
    midnight = 1_767_225_600 * SECOND
    assert [frame.received_ns - midnight for frame in frames] == [-1.5 * SECOND, -0.5 * SECOND, 0.5 * SECOND]
    assert source.remark == ""


def test_a_clock_that_stands_still_is_none(tmp_path: Path) -> None:
    """As of encoders that fill in nothing; the bus tells the time."""
    lines = [re.sub("^A[0-9.]+", "A000000.000", line) for line in bus_logs.n2k_ascii().decode().splitlines()]
    frames, source = read(written(tmp_path, "\n".join(lines).encode()))
    assert "it has no times of its own" in source.remark
    late_ns = np.array([frame.received_ns for frame in frames]) - [each.time_ns for each in MESSAGES]
    assert np.abs(late_ns).max() <= SECOND


def test_times_of_day_without_a_date_take_the_files_and_say_so(tmp_path: Path) -> None:
    path = written(tmp_path, f"23:59:59.5 {HEADING}\n00:00:00.5 {HEADING}\n".encode())
    frames, source = read(path)
    assert "no date; that of the file's last change is taken" in source.remark
    assert frames[1].received_ns - frames[0].received_ns == SECOND
    assert -86_400 * SECOND < frames[0].received_ns - path.stat().st_mtime_ns <= 0


def test_a_gateway_whose_clock_was_never_set_takes_the_buss(tmp_path: Path) -> None:
    """Its times of day count from when it was switched on."""
    moved = [frame._replace(time_ns=frame.time_ns + 5 * 3600 * SECOND) for frame in FRAMES]
    lines = [f"{bus_logs.when(f.time_ns)[1]} R {f.identifier:08X} {bus_logs.spaced(f.payload)}" for f in moved]
    frames, source = read(written(tmp_path, "\n".join(lines).encode()))
    assert "its clock is +18000.0 s from that of the bus" in source.remark
    assert [frame.received_ns for frame in frames] == [f.time_ns for f in FRAMES]


def test_weeks_of_a_bus_that_have_rolled_over_date_a_log_and_are_said(tmp_path: Path) -> None:
    """Of a log whose own times count from its beginning; it was dated by the moment of reading."""
    lines = []
    for frame in FRAMES:
        payload = frame.payload
        if frame.identifier >> 8 & 0x1FFFF == 126992:
            payload = (
                payload[:2] + struct.pack("<H", int.from_bytes(payload[2:4], "little") - 7 * 1024) + payload[4:]
            )
        if frame.identifier >> 8 & 0x1FFFF != 129029:
            since = f"({(frame.time_ns - START_NS) / 1e9:.6f})"
            lines.append(f"{since} can0 {frame.identifier:08X}#{payload.hex().upper()}")
    frames, source = read(written(tmp_path, "\n".join(lines).encode()))
    assert "weeks have rolled over" in source.remark
    assert abs(frames[0].received_ns - START_NS) < SECOND


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"time,heading_deg\n0.0,12.3\n", r"a table with the columns time, heading_deg: `seatrial import`"),
        (b'{"timestamp":"2018-10-16","pgn":128267}\n', "JSON, already decoded by another program"),
        (b"\x89PNG\r\n" + bytes(50), "a picture"),
        (bytes.fromhex("00064f7c0d1a2b3cfd") + bytes(50), 'a telemetry log of MAVLink: `type = "mavlink_file"`'),
        (b"PK\x03\x04" + bytes(50), "a ZIP archive: unpack it"),
        ("$HEHDT,12.3,T*1F\n".encode("utf-16"), "text in UTF-16: save it as UTF-8"),
        (b"$HEHDT,12.3,T\n" * 9, r"sentences without a sound checksum \(\$HEHDT,12.3,T\)"),
        (b"Dear diary,\n\ntoday we sailed.\n", r"text \(Dear diary,\)"),
        (bytes(range(256)) * 9, "binary, and begins with 00 01 02 03"),
        (bus_logs.pcap().replace(b"\xe3\0\0\0", b"\xc3\0\0\0", 1), "capture of link type 195, which has no CAN"),
        (bus_logs.pcap().replace(b"\xe3\0\0\0", b"\x01\0\0\0", 1), "no packet of the capture has a CAN frame"),
    ],
)
def test_what_holds_nothing_says_what_it_looks_like(tmp_path: Path, data: bytes, message: str) -> None:
    """And leaves no recording behind."""
    written(tmp_path, data)
    with pytest.raises(SourceError, match=rf"nothing in it can be recorded: .*{message}.*; supported are candump"):
        recorded(tmp_path, 'type = "file"\npath = "a log"\n')
    assert list((tmp_path / "out").iterdir()) == []


SENTENCE = b"$HEHDT,12.3,T*1F\r\n"


def captured_datagram(payload: bytes, *, fragment: int = 0, link: int = 1, captured_bytes: int = 9999) -> bytes:
    """A packet of UDP as a capture of a link has it."""
    udp = struct.pack(">HHHH", 5000, 60001, 8 + len(payload), 0) + payload
    head = struct.pack(
        ">BBHHHBBH4s4s", 0x45, 0, 20 + len(udp), 7, fragment, 64, 17, 0, b"\x0a\0\0\x08", b"\xef\xc0\0\1"
    )
    before = {1: bytes(12) + b"\x81\0\0\5\x08\0", 113: bytes(14) + b"\x08\0", 101: b""}[link]
    return (before + head + udp)[:captured_bytes] + bytes(4 if captured_bytes == 9999 else 0)


def capture(*packets: bytes, order: str = "<", is_in_ns: bool = False, link: int = 1) -> bytes:
    log = struct.pack(f"{order}IHHiIII", 0xA1B23C4D if is_in_ns else 0xA1B2C3D4, 2, 4, 0, 0, 65_535, link)
    for second, packet in enumerate(packets, START_NS // SECOND):
        fraction = 250_000_000 if is_in_ns else 250_000
        log += struct.pack(f"{order}IIII", second, fraction, len(packet), len(packet) + 1) + packet
    return log


def captured_ip(protocol: int, payload: bytes, *, version: int, extension: bytes = b"") -> bytes:
    """A packet of IPv4 or IPv6 on Ethernet, which fills short ones up."""
    if version == 4:
        head = struct.pack(">BBHHHBB", 0x45, 0, 20 + len(payload), 7, 0, 64, protocol)
        ip = b"\x08\0" + head + bytes(2) + b"\x0a\0\0\x08\x0a\0\0\1"
    else:
        first, rest = (protocol, b"") if not extension else (extension[0], bytes([protocol]) + extension[1:])
        head = struct.pack(">IHBB", 6 << 28, len(rest + payload), first, 64)
        ip = b"\x86\xdd" + head + bytes.fromhex("fd00" + 13 * "00" + "08" + "fd00" + 13 * "00" + "01") + rest
    return (bytes(12) + ip + payload).ljust(60, b"\0")


def captured_segment(sequence: int, payload: bytes, *, version: int = 4, flags: int = 0x10) -> bytes:
    tcp = struct.pack(">HHIIBBHHH", 10110, 50_000, sequence % 2**32, 0, 5 << 4, flags, 9999, 0, 0)
    return captured_ip(6, tcp + payload, version=version)


@pytest.mark.parametrize("extension", [b"", bytes([0, 0, 1, 4]) + bytes(4)])
def test_sentences_in_datagrams_of_ipv6_are_read(extension: bytes, tmp_path: Path) -> None:
    """Also behind a head for each hop."""
    udp = struct.pack(">HHHH", 5000, 60001, 8 + len(SENTENCE), 0) + SENTENCE
    packets = [captured_ip(17, udp, version=6, extension=extension)]
    frames, source = read(written(tmp_path, capture(*packets)))
    assert [frame.payload for frame in frames] == [SENTENCE.strip()]
    assert source.unreadable == 0


@pytest.mark.parametrize("version", [4, 6])
@pytest.mark.parametrize("starts", [True, False])
@given(data=st.data())
@settings(max_examples=30, deadline=None)
def test_sentences_of_a_captured_stream_come_back_in_order_and_once(
    version: int, starts: bool, data: st.DataObject
) -> None:
    """In segments that end anywhere, come twice, and change places; the count of bytes passes 2^32. Beside them a
    stream of another protocol and acknowledgements."""
    sentences = [frame_sentence(f"HEHDT,{number}.0,T") for number in range(40)]
    stream, first = b"".join(sentences), 2**32 - 200
    cuts = sorted({0, len(stream), *data.draw(st.lists(st.integers(1, len(stream) - 1), max_size=30))})
    segments = [
        captured_segment(first + start, stream[start:end], version=version) for start, end in pairwise(cuts)
    ]
    places = [number + data.draw(st.integers(0, 3)) for number in range(len(segments))]
    packets = [segments[number] for number in sorted(range(len(segments)), key=places.__getitem__)]
    repeated = data.draw(st.lists(st.integers(0, len(packets) - 1), max_size=5))
    for number in sorted(repeated, reverse=True):
        packets.insert(number + 1, packets[number])
    if starts:
        packets.insert(0, captured_segment(first - 1, b"", version=version, flags=0x12))
    else:
        packets.insert(0, segments[0])
    foreign = struct.pack(">HHIIBBHHH", 80, 50_001, 7, 0, 5 << 4, 0x10, 9, 0, 0) + b"HTTP/1.1 200 OK\r\n\r\n"
    packets.insert(2, captured_ip(6, foreign, version=version))
    packets.append(captured_segment(first + len(stream), b"", version=version, flags=0x11))
    with TemporaryDirectory() as folder:
        frames, source = read(written(Path(folder), capture(*packets)))
    assert [frame.payload for frame in frames] == [sentence.strip() for sentence in sentences]
    assert source.unreadable == 0


def test_a_segment_that_was_not_captured_costs_the_sentences_in_it(tmp_path: Path) -> None:
    sentences = [frame_sentence(f"HEHDT,{number}.0,T") for number in range(50)]
    stream = b"".join(sentences)
    packets = [captured_segment(at, stream[at : at + 50]) for at in range(0, len(stream), 50) if at != 200]
    frames, _ = read(written(tmp_path, capture(*packets)))
    lost = [
        sentence.strip() for number, sentence in enumerate(sentences)
        if sum(map(len, sentences[:number])) < 250 and sum(map(len, sentences[: number + 1])) > 200
    ]  # fmt: skip
    expected = [sentence.strip() for sentence in sentences if sentence.strip() not in lost]
    whole = [frame.payload for frame in frames if frame.payload in {sentence.strip() for sentence in sentences}]
    assert whole == expected


@pytest.mark.parametrize("link", [1, 113, 101])
@pytest.mark.parametrize("order", ["<", ">"])
def test_sentences_in_captured_datagrams_are_read(order: str, link: int, tmp_path: Path) -> None:
    packets = [captured_datagram(b"UdPbC\0" + 2 * SENTENCE, link=link), captured_datagram(SENTENCE[:-2], link=link)]
    frames, source = read(written(tmp_path, capture(*packets, order=order, is_in_ns=order == ">", link=link)))
    assert [frame.payload.removeprefix(b"UdPbC\0") for frame in frames] == 3 * [SENTENCE.strip()]
    first_ns = START_NS // SECOND * SECOND + SECOND // 4
    assert [frame.received_ns - first_ns for frame in frames] == [0, 0, SECOND]
    assert source.unreadable == 0


def test_senders_of_captured_datagrams_are_kept_apart(tmp_path: Path) -> None:
    packet = captured_datagram(SENTENCE)
    frames, _ = read(written(tmp_path, capture(packet, packet.replace(b"\x0a\0\0\x08", b"\x0a\0\0\x09"))))
    assert [frame.sender for frame in frames] == ["10.0.0.8:5000", "10.0.0.9:5000"]


def test_datagrams_that_are_cut_give_their_whole_lines_and_are_counted(tmp_path: Path) -> None:
    short = captured_datagram(2 * SENTENCE, captured_bytes=18 + 28 + len(SENTENCE) + 5)
    parts = captured_datagram(SENTENCE, fragment=0x2000), captured_datagram(b"HDT,99.9,T\r\n", fragment=185)
    other = captured_datagram(SENTENCE).replace(b"\x40\x11\0\0", b"\x40\x06\0\0")  # TCP
    frames, source = read(written(tmp_path, capture(short, *parts, other, bytes(20))))
    assert [frame.payload for frame in frames] == 2 * [SENTENCE.strip()]
    assert source.unreadable == 2


def test_a_recording_is_no_log_of_a_bus(tmp_path: Path) -> None:
    written(tmp_path, b"\x89MCAP0\r\n" + bytes(50))
    with pytest.raises(SourceError, match="holds no frames of a bus or line; `seatrial import"):
        recorded(tmp_path, 'type = "file"\npath = "a log"\n')
    assert list((tmp_path / "out").iterdir()) == []


def test_a_log_that_is_packed_is_read_as_it_is(tmp_path: Path) -> None:
    frames, _ = read(written(tmp_path, gzip.compress(bus_logs.pcap())))
    assert [frame.payload for frame in frames] == [frame.payload for frame in FRAMES]
    frames, source = read(written(tmp_path, gzip.compress(bus_logs.candump_log())[:-4000]))
    assert 0 < len(frames) < len(FRAMES)
    assert "the log is damaged (" in source.damage


@pytest.mark.parametrize("name", ["EBL", "YDVR", "YD CAN", "pcap", "pcapng"])
def test_a_file_that_was_cut_off_gives_what_is_whole_and_says_so(tmp_path: Path, name: str) -> None:
    form = FORMS[name]
    frames, source = read(written(tmp_path, form.write()[:-7]))
    sent = MESSAGES if form.whole else FRAMES
    assert [frame.payload for frame in frames] == [each.payload for each in sent][: len(frames)]
    assert len(frames) >= len(sent) - 1
    assert source.damage.startswith("the log is damaged (its last record is cut off)")


def test_damage_in_a_recorders_file_costs_little(tmp_path: Path) -> None:
    """40 bytes cut out of the middle: some ten messages are gone, and the rest is right."""
    data = bus_logs.ydvr()
    middle = len(data) // 2
    frames, source = read(written(tmp_path, data[:middle] + data[middle + 40 :]))
    sent = [message.payload for message in MESSAGES]
    assert len(sent) - 10 <= len(frames) < len(sent)
    assert sum(frame.payload not in sent for frame in frames) <= 1
    assert source.unreadable >= 1


def test_the_named_form_is_the_only_one(tmp_path: Path) -> None:
    data = bus_logs.yacht_devices().splitlines()[:3] + bus_logs.candump_log().splitlines()[:5]
    frames, source = read(written(tmp_path, b"\n".join(data)), "yacht_devices")
    assert (len(frames), source.unreadable) == (3, 5)


def test_every_form_can_be_named() -> None:
    assert {*get_args(Form)} == {*LINE_FORMS, *FILE_FORMS, "nmea0183", "actisense"}


@pytest.mark.parametrize("name", ["Yacht Devices RAW", "N2K ASCII", "Actisense D0", "SeaSmart uptime", "MXPGN"])
def test_a_gateway_records_live_beside_sentences(tmp_path: Path, name: str) -> None:
    """By TCP, in pieces that end anywhere; what comes is stamped when it comes."""
    port, sent = free_port(), FORMS[name].write()
    server = socket.create_server(("127.0.0.1", port))
    (tmp_path / "trial.toml").write_text(config_text(f'type = "tcp"\nport = {port}\n'))

    def serve() -> None:
        line, _ = server.accept()
        with line:
            for at in range(0, len(sent), 777):
                line.sendall(sent[at : at + 777])
                time.sleep(0.001)
            line.sendall(f"\r\n{HEADING}\r\n".encode())
            done.wait(5.0)

    done = threading.Event()
    thread = threading.Thread(target=serve)
    thread.start()
    stop, before_ns = threading.Event(), time.time_ns()
    timer = threading.Timer(2.5, stop.set)
    timer.start()
    (path,), health = record(load_config(tmp_path / "trial.toml"), tmp_path / "out", stop=stop)
    done.set()
    thread.join()
    server.close()
    recording = read_recording(path)
    expected = len(MESSAGES) if FORMS[name].whole else len(FRAMES)
    assert recording.raw == {"/raw/can/gate": expected, "/raw/nmea0183/gate": 1}
    assert recording.series["north_m"].value.size == pytest.approx(bus_logs.DURATION_S, abs=1)
    assert recording.start_ns > before_ns - SECOND
    assert "heading_deg: from gate/35:127250 to gate/HE:HDT" not in [text for _, text in recording.events]
    assert health.sources["gate"].refused == 0


PIECES = [
    bus_logs.framed(bus_logs.stored(MESSAGES[1])),
    bus_logs.framed(bus_logs.stored(MESSAGES[4])),
    bus_logs.yacht_devices().splitlines()[0] + b"\r\n",
    HEADING.encode() + b"\r\n",
]


@given(st.lists(st.sampled_from(PIECES), max_size=12), st.data())
def test_messages_and_lines_stay_whole_however_they_arrive(pieces: list[bytes], data: st.DataObject) -> None:
    stream = b"".join(pieces)
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=6)))
    assembler = LineAssembler("line")
    parts = [stream[start:stop] for start, stop in zip([0, *cuts], [*cuts, len(stream)], strict=True)]
    frames = [frame for part in parts for frame in assembler.push(part)] + assembler.end()
    alone = [LineAssembler("line").push(piece)[0].payload for piece in pieces]
    assert [frame.payload for frame in frames] == alone


@given(
    st.lists(st.binary(max_size=40) | st.sampled_from([*PIECES, b"\x10\x02", b"\x10\x03", b"\x10"]), max_size=20)
)
@settings(max_examples=300)
def test_rubbish_between_messages_costs_them_nothing_but_those_it_breaks(pieces: list[bytes]) -> None:
    """No byte breaks the reading, memory is bounded, and a message behind a line end comes out."""
    assembler = LineAssembler("line")
    for piece in pieces:
        for frame in assembler.push(piece):
            assert frame.identifier < 2**29
    assembler.cut()
    assembler.push(b"")
    (frame,) = assembler.push(PIECES[0])
    assert frame.payload == MESSAGES[1].payload


def test_a_stream_without_an_end_does_not_eat_memory() -> None:
    cutter = StreamCutter()
    for _ in range(200):
        cutter.push(b"\x10\x02" + bytes(997))
        cutter.push(b"x" * 1000)
        assert len(cutter._pending) < 10_000


def changed(data: bytes, draw: st.DataObject) -> bytes:
    """Bytes of a log with some of them changed, cut out or put in."""
    for _ in range(draw.draw(st.integers(0, 4))):
        at = draw.draw(st.integers(0, len(data)))
        data = data[:at] + draw.draw(st.binary(max_size=8)) + data[at + draw.draw(st.integers(0, 12)) :]
    return data


SHORT = {name: form.write()[:3000] for name, form in FORMS.items()}


@given(st.sampled_from(sorted(SHORT)), st.data())
@settings(max_examples=300)
def test_a_damaged_log_is_read_or_refused_but_breaks_nothing(
    tmp_path_factory: pytest.TempPathFactory, name: str, data: st.DataObject
) -> None:
    path = written(tmp_path_factory.getbasetemp(), changed(SHORT[name], data))
    source = LogFile(FileSource(name="log", type="can_file", path=path, channels=()))
    try:
        source.open()
    except SourceError:
        return
    while (frames := source.read(0.0)) is not None:
        assert all(frame.identifier < 2**29 and len(frame.payload) <= 8192 for frame in frames)
    assert source.unreadable >= 0
    source.close()


@given(st.text(max_size=80) | st.text(st.sampled_from("$!\\,*:;.- 0123456789ABCDEFRTPGNCDIMX93"), max_size=80))
@settings(max_examples=500)
def test_no_line_raises(line: str) -> None:
    reader = LineReader()
    for prefix in (
        "",
        "$PCDIN,01F119,",
        "$MXPGN,",
        "!PDGY,",
        "A1733",
        "17:33:21.107 R ",
        "1786096800250;A;",
        "0,1,2,",
    ):
        entry = reader.entry((prefix + line).encode())
        assert entry is None or entry.identifier < 2**29


def test_a_whole_message_takes_part_in_no_reassembly(tmp_path: Path) -> None:
    """A position that a gateway put together, between the frames of another's; too short a one is refused."""
    lines = [
        f"(1786096800.{number:06d}) can0 0DF80503#{part.hex()}"
        for number, part in enumerate(fast_parts(gnss(1, 63.4)))
    ]
    whole = gnss(1, 63.5).hex().upper()
    lines.insert(3, f"A100000.000 03FF3 1F805 {whole}")
    lines.append(f"A100000.000 03FF3 1F805 {whole[:40]}")
    (tmp_path / "trial.toml").write_text(
        config_text(f'type = "file"\npath = "{written(tmp_path, chr(10).join(lines).encode())}"\n')
    )
    (path,), health = record(load_config(tmp_path / "trial.toml"), tmp_path / "out")
    assert read_recording(path).series["north_m"].value.size == 2
    assert health.sources["gate"].rejection_counts == {"impossible length": 1}


def test_what_came_by_a_gateway_can_be_decoded_again(tmp_path: Path, by_candump: Recording) -> None:
    """Whole messages too, with the recording's own configuration."""
    written(tmp_path, FORMS["N2K ASCII"].write())
    recorded(tmp_path, 'type = "file"\npath = "a log"\n')
    (path,) = (tmp_path / "out").iterdir()
    redecode([path], tmp_path / "again.mcap")
    again = read_recording(tmp_path / "again.mcap")
    for channel in CHANNELS:
        assert np.array_equal(again.series[channel].value, by_candump.series[channel].value)


GREETINGS = {
    "actisense": bus_logs.framed(b"\xa1\x03\x11\x02\x00"),
    "ikonvert": b"$PDGY,N2NET_INIT,ALL\r\n",
    "": b"",
}


@pytest.mark.parametrize("form", ["actisense", "ikonvert", ""])
def test_a_gateway_on_a_serial_line_is_told_to_speak_if_it_is_named(form: Form | Literal[""]) -> None:
    far, near = pty.openpty()
    tty.setraw(near)
    section = SerialSource(name="gate", type="serial", device=os.ttyname(near), form=form, channels=())
    with closing(SerialPort(section)) as port:
        port.open()
        os.write(far, bus_logs.framed(bus_logs.stored(MESSAGES[4])) + b"\n")
        wait_for(lambda: [frame.payload for frame in port.read(0.1) or []] == [MESSAGES[4].payload])
        heard, _, _ = select.select([far], [], [], 2.0 if form else 0.1)
        assert (os.read(far, 100) if heard else b"") == GREETINGS[form]
    os.close(far)
    os.close(near)


def test_a_receiver_that_has_just_been_switched_on_does_not_set_the_logs_time(tmp_path: Path) -> None:
    """It tells another year for some seconds; the others of the log's beginning are more."""
    lines = bus_logs.ikonvert().decode().splitlines()
    told = [n for n, line in enumerate(lines) if line.startswith("!PDGY,126992,")][:5]
    for number in told:
        head, _, _ = lines[number].rpartition(",")
        lines[number] = f"{head},AfCgP///AAA="
    frames, _ = read(written(tmp_path, "\n".join(lines).encode()))
    late_ns = np.array([frame.received_ns for frame in frames]) - [each.time_ns for each in MESSAGES]
    assert np.abs(late_ns).max() <= 1_000_000


def test_a_recorder_knows_both_protocols_of_a_line(tmp_path: Path) -> None:
    """A refusal of either counts, as one of the processing does."""
    (tmp_path / "trial.toml").write_text(config_text(f'type = "udp"\nport = {free_port()}\n'))
    config = load_config(tmp_path / "trial.toml")
    parts = RecordingParts(tmp_path, config.trial, config.attachments, config.recording, {})
    recorder = Recorder(config, parts)
    assert len(recorder.health.sources["gate"].refusals) == 3
    parts.close()


assert FRAMES[0].time_ns == START_NS
