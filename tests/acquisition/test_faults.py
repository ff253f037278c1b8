"""Faults of lines and buses while a recorder runs: told, repaired by themselves, and no other source suffers."""

from __future__ import annotations

import os
import random
import re
import socket
import struct
import termios
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import groupby
from math import radians
from operator import attrgetter
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import can
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from seatrial.acquisition.config.trial_file import load_config
from seatrial.acquisition.core.ship import NAMES
from seatrial.acquisition.core.trial import Frame, wall_and_monotonic_ns
from seatrial.acquisition.emulator import NullModem
from seatrial.acquisition.logger import health
from seatrial.acquisition.logger import maintenance as housekeeping
from seatrial.acquisition.logger.pipeline import Inbox, Recorder
from seatrial.acquisition.protocols.nmea0183 import frame_sentence
from seatrial.acquisition.protocols.nmea2000 import READERS, split_can_identifier
from seatrial.acquisition.recording.messages import EVENT_TOPIC, HEALTH_TOPIC, RAW_PREFIX
from seatrial.acquisition.recording.parts import RecordingParts
from seatrial.acquisition.recording.reader import MessageStream, Recording, read_recording
from seatrial.acquisition.sources import lines
from tests.acquisition.can_frames import identifier_of
from tests.acquisition.conftest import free_port, wait_for
from tests.acquisition.test_running import say

ADDRESS_CLAIM = 60928


def source(name: str, section: str, channels: tuple[str, ...] = ()) -> str:
    return f'[[source]]\nname = "{name}"\nchannels = {list(channels)}\n{section}\n'


def udp(name: str, port: int, *channels: str) -> str:
    return source(name, f'type = "udp"\nport = {port}', channels)


class Running:
    """A recorder at work, and after the block what it has recorded."""

    def __init__(self, folder: Path, sources: str) -> None:
        (folder / "trial.toml").write_text('[trial]\nname = "faults"\n' + sources)
        config = load_config(folder / "trial.toml")
        self.parts = RecordingParts(folder, config.trial, {}, config.recording)
        self.recorder = Recorder(config, self.parts)
        self.sources = self.recorder.health.sources

    def wait_for_frames(self, name: str, count: int) -> None:
        wait_for(lambda: self.sources[name].frames >= count)

    def wait_for_state(self, name: str, state: str) -> None:
        wait_for(lambda: self.sources[name].state == state)

    @property
    def recording(self) -> Recording:
        return read_recording(self.parts.path)

    def messages(self, topic: str) -> list[dict[str, Any]]:
        return [entry.decode_body() for entry in MessageStream(self.parts.path) if entry.topic == topic]

    @property
    def events(self) -> list[str]:
        return [each["message"] for each in self.messages(EVENT_TOPIC)]

    def told(self, pattern: str) -> int:
        """How many events say this."""
        return sum(bool(re.search(pattern, text)) for text in self.events)

    def raw(self, name: str) -> list[Frame]:
        return [
            entry.decode_frame()
            for entry in MessageStream(self.parts.path)
            if entry.topic.startswith(RAW_PREFIX) and entry.topic.endswith(f"/{name}")
        ]


@contextmanager
def recording(folder: Path, sources: str) -> Iterator[Running]:
    running = Running(folder, sources)
    running.recorder.start()
    try:  # a line that is still being opened throws away what comes before
        wait_for(lambda: all(each.state != "opening" for each in running.sources.values()))
        yield running
    finally:
        running.recorder.stop()
        running.parts.close()


class Cable:
    """A device that can be pulled out and put back, always under the same path."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.plug_in()

    def plug_in(self) -> None:
        self._modem = NullModem().__enter__()
        self.path.symlink_to(self._modem.logger_device)
        self._end = os.open(self._modem.emulator_device, os.O_RDWR | os.O_NOCTTY)

    def send(self, data: bytes) -> None:
        os.write(self._end, data)

    def pull(self) -> None:
        self.path.unlink(missing_ok=True)
        os.close(self._end)
        self._modem.__exit__(None, None, None)


@pytest.fixture
def cable(tmp_path: Path) -> Iterator[Cable]:
    made = Cable(tmp_path / "ttyUSB0")
    yield made
    made.pull()


def headings(values: range) -> bytes:
    return b"".join(frame_sentence(f"HEHDT,{value}.0,T") for value in values)


def slcan_headings(values: range) -> bytes:
    """As a USB-CAN adapter sends them, in true degrees."""
    data = [(bytes([value]) + round(radians(value) * 1e4).to_bytes(2, "little")).hex() for value in values]
    return b"".join(f"T{identifier_of(127250):08X}8{each}FF7FFF7FFC\r".upper().encode() for each in data)


def pull_and_put_back(
    running: Running, cable: Cable, say_values: Callable[[range], bytes], port: int, cut: bytes = b""
) -> None:
    """Three values before, three after; the line beside it says ten in all, before, between and after."""
    cable.send(say_values(range(3)) + cut)
    running.wait_for_frames("pulled", 3)
    say(port, "TIROT,0,A")
    cable.pull()
    running.wait_for_state("pulled", "failed")
    for number in range(1, 9):
        say(port, f"TIROT,{60 * number},A")
    running.wait_for_frames("beside", 9)
    cable.plug_in()
    running.wait_for_state("pulled", "open")
    cable.send(say_values(range(3, 6)))
    running.wait_for_frames("pulled", 7 if cut else 6)
    say(port, "TIROT,540,A")
    running.wait_for_frames("beside", 10)


def assert_it_came_back(running: Running, failure: str) -> None:
    series = running.recording.series
    assert series["heading_deg"].value == pytest.approx(range(6), abs=0.01)
    assert series["yaw_rate_dps"].value.tolist() == list(range(10))
    assert running.told(failure) == 1
    assert running.told(r"source 'pulled' is back after \d\.\d s") == 1
    assert running.told("beside") == 0


def test_a_serial_line_that_is_pulled_and_put_back(tmp_path: Path, cable: Cable) -> None:
    port = free_port()
    line = source("pulled", f'type = "serial"\ndevice = "{cable.path}"', ("heading_deg",))
    with recording(tmp_path, line + udp("beside", port, "yaw_rate_dps")) as running:
        pull_and_put_back(running, cable, headings, port, cut=b"$HEHDT,7")
    assert_it_came_back(running, "source 'pulled': serial line failed")
    assert running.raw("pulled")[3].payload == b"$HEHDT,7"  # kept as it is, and not glued to the next
    assert running.sources["pulled"].refused == 1


def test_a_can_bus_that_is_pulled_and_put_back(tmp_path: Path, cable: Cable) -> None:
    port = free_port()
    bus = f'type = "can"\ninterface = "slcan"\nchannel = "{cable.path}"\noptions = {{ sleep_after_open = 0.0 }}'
    sources = source("pulled", bus, ("heading_deg",)) + udp("beside", port, "yaw_rate_dps")
    with recording(tmp_path, sources) as running:
        pull_and_put_back(running, cable, slcan_headings, port)
    assert_it_came_back(running, "source 'pulled': CAN bus failed")


def test_a_gateway_that_closes_and_opens_again(tmp_path: Path) -> None:
    """The sentence that was cut by the end of one connection does not go on in the next."""
    port = free_port(socket.SOCK_STREAM)
    gateway = source("gateway", f'type = "tcp"\nport = {port}', ("heading_deg",))

    def serve(values: range, last: bytes, count: int) -> None:
        client, _ = server.accept()
        with client:
            client.sendall(headings(values) + last)
            running.wait_for_frames("gateway", count)
        server.close()

    server = socket.create_server(("127.0.0.1", port))
    with recording(tmp_path, gateway) as running:
        serve(range(3), b"$HEHDT,9", 3)
        running.wait_for_state("gateway", "failed")
        server = socket.create_server(("127.0.0.1", port))
        serve(range(3, 6), b"", 7)
    assert running.recording.series["heading_deg"].value.tolist() == list(range(6))
    assert running.told("source 'gateway': the other end closed the connection") >= 1
    assert running.told(r"source 'gateway' is back after \d\.\d s") == 1
    assert running.raw("gateway")[3].payload == b"$HEHDT,9"
    assert running.sources["gateway"].refused == 1


class Fake:
    """A source whose reads are a function."""

    lost = 0

    def __init__(self, name: str, read: Callable[[], list[Frame]]) -> None:
        self.name, self._read, self.waits = name, read, False

    def open(self) -> None:
        pass

    def read(self, timeout_s: float) -> list[Frame] | None:
        return self._read()

    def close(self) -> None:
        pass


def frame(name: str, body: str) -> Frame:
    return Frame(name, "nmea0183", frame_sentence(body).strip(), *wall_and_monotonic_ns())


def test_a_source_that_floods_costs_only_itself(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A thousand frames at every read, and a line of two hundred a second beside them."""
    share, most, spoken = 2_000, [0], [0]

    def flood() -> list[Frame]:
        if spoken[0] < 60:
            return [frame("flood", "HEHDT,1.0,T")] * 1_000
        time.sleep(0.01)
        return [] if len(running.recorder._inbox) else [frame("flood", "HEHDT,1.0,T")]

    def calm() -> list[Frame]:
        time.sleep(0.005)
        spoken[0] += 1
        return [frame("calm", f"TIROT,{spoken[0] % 600},A")]

    class Watched(Inbox):
        def put(self, name: str, frames: list[Frame]) -> int:
            accepted = super().put(name, frames)
            most[0] = max(most[0], len(self))
            return accepted

    fakes = {"flood": Fake("flood", flood), "calm": Fake("calm", calm)}
    monkeypatch.setattr("seatrial.acquisition.logger.pipeline.make_source", lambda section: fakes[section.name])
    monkeypatch.setattr("seatrial.acquisition.logger.pipeline.Inbox", Watched)
    monkeypatch.setattr(housekeeping, "_HEALTH_EVERY_S", 0.1)
    sources = udp("flood", 1, "heading_deg") + udp("calm", 2, "yaw_rate_dps")
    sources += f"[recording]\nqueue_frames = {share}\n"
    with recording(tmp_path, sources) as running:
        wait_for(lambda: any("none any more" in text for _, _, text in running.recorder.health.events))
    seen, found = running.sources, running.recording
    assert seen["flood"].dropped > 0
    assert found.raw["/raw/nmea0183/flood"] == seen["flood"].frames - seen["flood"].dropped
    assert found.raw["/raw/nmea0183/calm"] == seen["calm"].frames == spoken[0]
    expected = [number % 600 / 60 for number in range(1, spoken[0] + 1)]
    assert found.series["yaw_rate_dps"].value == pytest.approx(expected)
    assert most[0] <= 2 * share
    told = [each["dropped"] for each in running.messages(HEALTH_TOPIC) if each["source"] == "flood"]
    assert told == sorted(told)
    assert told[-1] > 0
    assert not any(each["dropped"] for each in running.messages(HEALTH_TOPIC) if each["source"] == "calm")
    assert running.told("flood: the queue is full") >= 1
    assert running.told("flood: [0-9,]+ frames were dropped; none any more") >= 1
    assert running.told("calm: .*(queue|budget|dropped)") == 0  # a busy machine may make it late, not lossy


def rubbish(count: int, seed: int = 1) -> list[bytes]:
    chance = random.Random(seed)
    return [chance.randbytes(chance.randint(1, 120)) for _ in range(count)]


def spoilt(sound: bytes, first: int, last: int) -> list[bytes]:
    """A message with one bit wrong, in each of these bytes in turn."""
    return [sound[:at] + bytes([sound[at] ^ 1]) + sound[at + 1 :] for at in range(first, last)]


def lines_in(data: bytes) -> list[bytes]:
    """What a line assembler is bound to keep: everything between line ends but white space around it."""
    return [line for line in (each.strip(b"\0 \t") for each in re.split(rb"[\r\n]", data)) if line]


def assert_nothing_believed(running: Running, refused: int) -> None:
    """No value, no clock, no position of the rubbish; the line beside it is complete."""
    recording = running.recording
    assert set(recording.series) == {"yaw_rate_dps"}
    assert sorted(recording.series["yaw_rate_dps"].value) == list(range(10))  # datagrams may overtake each other
    assert running.sources["rubbish"].refused >= refused
    assert running.sources["beside"].refused == 0
    assert recording.trial.origin is None
    assert running.told("broke the decoder") == 0


@contextmanager
def beside_rubbish(folder: Path, section: str, channels: tuple[str, ...]) -> Iterator[Running]:
    port = free_port()
    with recording(folder, source("rubbish", section, channels) + udp("beside", port, "yaw_rate_dps")) as running:
        for number in range(10):
            say(port, f"TIROT,{60 * number},A")
        yield running
        running.wait_for_frames("beside", 10)


MOTION = tuple(name for name in NAMES[:8] if name != "yaw_rate_dps")


def test_rubbish_on_a_serial_line(tmp_path: Path, cable: Cable) -> None:
    section = f'type = "serial"\ndevice = "{cable.path}"\nbaud_rate = 115200'
    data = b"".join(rubbish(200) + spoilt(frame_sentence("HEHDT,123.4,T"), 1, 16)) + b"\r\n"
    expected = lines_in(data)
    with beside_rubbish(tmp_path, section, MOTION) as running:
        for start in range(0, len(data), 512):
            cable.send(data[start : start + 512])
        running.wait_for_frames("rubbish", len(expected))
    assert [each.payload for each in running.raw("rubbish")] == expected
    assert_nothing_believed(running, len(expected))


def test_rubbish_in_datagrams(tmp_path: Path) -> None:
    port, sent = free_port(), rubbish(300) + spoilt(frame_sentence("HEHDT,123.4,T"), 1, 16)
    expected = [lines for data in sent if (lines := lines_in(data))]
    count = sum(map(len, expected))
    with beside_rubbish(tmp_path, f'type = "udp"\nport = {port}', MOTION) as running:
        send_datagrams(port, sent)
        running.wait_for_frames("rubbish", count)
    assert by_datagram(running.raw("rubbish"), expected) == sorted(expected)
    assert_nothing_believed(running, count)


def test_rubbish_on_a_mavlink_link(tmp_path: Path) -> None:
    port = free_port()
    sent = [b"\xfd" + data if number % 3 else data for number, data in enumerate(rubbish(300))]
    attitude = dialect.MAVLink(None, srcSystem=1).attitude_encode(0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.1)
    sound = attitude.pack(dialect.MAVLink(None, srcSystem=1))
    sent += spoilt(bytes(sound), 1, len(sound))
    with beside_rubbish(tmp_path, f'type = "mavlink"\nport = {port}', MOTION) as running:
        send_datagrams(port, sent)
        running.wait_for_frames("rubbish", len(sent))
    assert by_datagram(running.raw("rubbish"), [[data] for data in sent]) == sorted([data] for data in sent)
    assert_nothing_believed(running, 100)


def send_datagrams(port: int, sent: list[bytes]) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line:
        for data in sent:
            line.sendto(data, ("127.0.0.1", port))


def by_datagram(frames: list[Frame], sent: list[list[bytes]]) -> list[list[bytes]]:
    """The lines of each datagram, datagrams sorted: UDP keeps no order, nor do stamps if a sender changes cores.

    A datagram's lines have one stamp. Two that the kernel stamps alike are parted where one that was sent ends.
    """
    found = list[list[bytes]]()
    for _, own in groupby(frames, attrgetter("received_ns")):
        lines = [each.payload for each in own]
        while lines:
            fits = [each for each in sent if lines[: len(each)] == each]
            first = max(fits, key=len, default=lines)
            found.append(first)
            lines = lines[len(first) :]
    return sorted(found)


def test_rubbish_on_a_can_bus(tmp_path: Path) -> None:
    """Foreign groups, 11-bit and remote frames, and groups that we read in frames too short to hold them."""
    chance, messages = random.Random(1), []
    for number in range(400):
        data, identifier = chance.randbytes(chance.randint(0, 8)), chance.getrandbits(29)
        if number % 4 == 0:
            identifier, data = identifier_of(chance.choice(list(READERS)), chance.randint(0, 253)), data[:7]
        elif split_can_identifier(identifier)[0] in {*READERS, ADDRESS_CLAIM}:
            continue
        extended = number % 4 != 1
        message = can.Message(
            arbitration_id=identifier if extended else identifier & 0x7FF, is_extended_id=extended,
            is_remote_frame=number % 4 == 2, data=b"" if number % 4 == 2 else data,
        )  # fmt: skip
        messages.append(message)
    channel = f"rubbish-{os.getpid()}"
    with (
        can.Bus(interface="virtual", channel=channel) as bus,
        beside_rubbish(tmp_path, f'type = "can"\ninterface = "virtual"\nchannel = "{channel}"', MOTION) as running,
    ):
        for message in messages:
            bus.send(message)
        running.wait_for_frames("rubbish", len(messages))
    kept = [(each.identifier, each.payload) for each in running.raw("rubbish")]
    assert kept == [(each.arbitration_id, bytes(each.data)) for each in messages]
    assert_nothing_believed(running, 300)


def test_silence_is_told_and_so_is_its_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Silence of a tenth of a second here, of 2.5 s aboard."""
    monkeypatch.setattr(health, "SILENT_NS", 100_000_000)
    monkeypatch.setattr(housekeeping, "_HEALTH_EVERY_S", 0.05)
    port, mute = free_port(), free_port()
    with recording(tmp_path, udp("line", port, "heading_deg") + udp("mute", mute)) as running:
        say(port)
        wait_for(lambda: running.recorder.health.sources["line"].frames == 1)
        running.recorder.health.started_ns -= 3_000_000_000  # only now, or the line too has said nothing yet
        wait_for(lambda: any("'line' has fallen silent" in text for _, _, text in running.recorder.health.events))
        say(port)
        wait_for(lambda: any("'line' is heard again" in text for _, _, text in running.recorder.health.events))
    assert running.told("source 'mute' has said nothing yet") == 1
    assert running.told("source 'mute' is heard") == 0
    assert running.told("source 'line' has fallen silent") in (1, 2)  # perhaps once more before the end
    assert running.told(r"source 'line' is heard again after [0-9]+\.[0-9] s") == 1
    states = Counter((each["source"], each["state"]) for each in running.messages(HEALTH_TOPIC))
    assert states["line", "silent"] > 0
    assert states["line", "open"] > 0


def test_overruns_of_a_serial_line_are_counted_and_told(
    tmp_path: Path, cable: Cable, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The kernel's counts, as linux/serial.h has them; a pseudo-terminal has none, so they are put in here."""
    counts = dict.fromkeys(
        ["cts", "dsr", "rng", "dcd", "rx", "tx", "frame", "overrun", "parity", "brk", "buf_overrun"], 3
    )

    def ioctl(descriptor: int, request: int, answer: bytearray) -> None:
        assert request == termios.TIOCGICOUNT
        answer[: 4 * len(counts)] = struct.pack(f"@{len(counts)}i", *counts.values())

    monkeypatch.setattr(lines, "fcntl", SimpleNamespace(ioctl=ioctl))  # pyserial has its own
    with recording(
        tmp_path, source("line", f'type = "serial"\ndevice = "{cable.path}"', ("heading_deg",))
    ) as running:
        counts.update(overrun=5, buf_overrun=4, parity=90)  # 2 and 1 more than when the line was opened
        wait_for(lambda: running.sources["line"].dropped == 3)
        cable.send(headings(range(5)))
        running.wait_for_frames("line", 5)
    assert running.sources["line"].dropped == 3
    assert running.told("line: the serial line has overrun [1-3] times")
