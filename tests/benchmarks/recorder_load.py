"""A saturated bus, a busy line and an autopilot, recorded for minutes: what is lost, and what it costs.

1,900 CAN frames, 200 sentences and 50 MAVLink messages a second go to ``seatrial record`` as a process of its own.
Prints what was sent and recorded, the recorder's share of one core, its memory and open files at the beginning
and the end. Run with the number of seconds: ``python tests/benchmarks/recorder_load.py 600``; with ``junk`` behind
it a process sends junk to a fourth source as fast as it can.
"""

from __future__ import annotations

import os
import random
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path

import can

from seatrial.acquisition.config.sources import MavlinkSource
from seatrial.acquisition.protocols import Moment, make_encoder
from seatrial.acquisition.protocols.nmea0183 import frame_sentence
from seatrial.acquisition.recording.reader import read_recording

ROOT = Path(__file__).resolve().parents[2]
FRAMES_HZ, SENTENCES_HZ, MAVLINK_HZ = 1900, 200, 50
BURST_S = 0.01  # frames come in bursts, as a bus's driver hands them over
MULTICAST = "239.74.163.2"

CONFIGURATION = """
[trial]
name = "load"
origin = {{ latitude_deg = 63.44, longitude_deg = 10.40 }}
[[source]]
name = "bus"
type = "can"
interface = "udp_multicast"
channel = "{multicast}"
options = {{ hop_limit = 0, port = {can} }}
channels = ["north_m", "east_m", "heading_deg", "yaw_rate_dps", "surge_mps", "sway_mps", "wind_direction_deg",
            "wind_speed_mps", "roll_deg", "pitch_deg", "latitude_deg", "longitude_deg"]
[[source]]
name = "line"
type = "udp"
port = {line}
channels = ["port_rpm", "port_angle_deg", "starboard_rpm", "starboard_angle_deg", "tunnel_rpm", "heading_deg"]
[[source]]
name = "autopilot"
type = "mavlink"
port = {mavlink}
channels = ["heading_deg", "yaw_rate_dps"]
"""

JUNK = b"\xff" * 1000
JUNK_SOURCE = """
[[source]]
name = "junk"
type = "udp"
port = {junk}
channels = []
"""
FLOOD = """
import socket, sys
line = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
sent = 0
try:
    while True:
        line.sendto(b"\\xff" * 1000, ("127.0.0.1", int(sys.argv[1])))
        sent += 1
except KeyboardInterrupt:
    print(sent)
"""

# Priority, group and data of the messages of a busy bus, most of them ours: the share of a full instrument set.
MESSAGES = [
    (0x09F11223, "ff7b2cff7fff7ffc"),  # 127250 heading, true
    (0x09F11323, "ff10270000ffffff"),  # 127251 rate of turn
    (0x0DF11923, "ffff7f64009cffff"),  # 127257 attitude
    (0x09F80123, "80c3ce25803d3306"),  # 129025 position
    (0x09F80223, "fffc7b2c0402ffff"),  # 129026 course and speed
    (0x0DFD0223, "ff2003e803f8ffff"),  # 130306 wind, true
    (0x0DF50323, "ff0402ffffffffff"),  # 128259 speed through water
    (0x1DFF1123, "aabbccddeeff0011"),  # proprietary: kept raw
]


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def paced(rate_hz: float, until_s: float, send: Callable[[int], None]) -> int:
    """Call ``send`` so many times a second, in bursts, until the end; how often that was."""
    started_s, sent = time.monotonic(), 0
    while (now_s := time.monotonic()) < until_s:
        due = int((now_s - started_s) * rate_hz)
        while sent < due:
            send(sent)
            sent += 1
        time.sleep(BURST_S)
    return sent


def can_sender(port: int) -> Callable[[int], None]:
    bus = can.Bus(interface="udp_multicast", channel=MULTICAST, hop_limit=0, port=port)
    messages = [
        can.Message(arbitration_id=identifier, data=bytes.fromhex(data), is_extended_id=True)
        for identifier, data in MESSAGES
    ]
    return lambda number: bus.send(messages[number % len(messages)])


def line_sender(port: int) -> Callable[[int], None]:
    outgoing = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    thrusters = [
        f"RCTRD,{number},{random.uniform(-200, 200):.1f},R,,V,{random.uniform(0, 359):.1f}" for number in (2, 4)
    ]
    texts = [
        frame_sentence(text)
        for text in ("HEHDT,123.45,T", "TIROT,-12.5,A", "GPVTG,84.4,T,,M,5.1,N,,K,A", *thrusters)
    ]
    return lambda number: outgoing.sendto(texts[number % len(texts)], ("127.0.0.1", port)) and None


def mavlink_sender(port: int) -> Callable[[int], None]:
    outgoing = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    encoder = make_encoder(MavlinkSource(name="x", type="mavlink", port=port, channels=()))

    def send(number: int) -> None:
        moment = Moment(number * 20_000_000, {"heading_deg": number % 360, "yaw_rate_dps": 1.5})
        for packet in encoder.encode(moment):
            outgoing.sendto(packet.payload, ("127.0.0.1", port))

    return send


def state(process: int) -> str:
    pages = int(Path(f"/proc/{process}/statm").read_text().split()[1])
    files = len(list(Path(f"/proc/{process}/fd").iterdir()))
    return f"{pages * os.sysconf('SC_PAGE_SIZE') / 1e6:.1f} MB, {files} open files"


def cpu_s(process: int) -> float:
    """User and system time of a process so far [s]."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@contextmanager
def flood(port: int) -> Iterator[None]:
    """Junk to a port as fast as it can be sent, from a process of its own."""
    junk = subprocess.Popen([sys.executable, "-c", FLOOD, str(port)], stdout=subprocess.PIPE, text=True)
    try:
        yield
    finally:
        junk.send_signal(signal.SIGINT)
        print(f"junk: sent {int(junk.communicate()[0]):,} datagrams of {len(JUNK):,} bytes")


def main(duration_s: float, *, junk: bool) -> None:
    ports = {"can": free_port(), "line": free_port(), "mavlink": free_port(), "junk": free_port()}
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        text = CONFIGURATION + (JUNK_SOURCE if junk else "")
        (folder / "load.toml").write_text(text.format(multicast=MULTICAST, **ports))
        recorder = subprocess.Popen(
            [sys.executable, ROOT / "seatrial.py", "record", folder / "load.toml", "-o", folder / "out"],
            stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
        )  # fmt: skip
        time.sleep(3.0)
        until_s = time.monotonic() + duration_s
        before_s = cpu_s(recorder.pid)
        sent: dict[str, int] = {}
        jobs = [
            ("/raw/can/bus", FRAMES_HZ, can_sender(ports["can"])),
            ("/raw/nmea0183/line", SENTENCES_HZ, line_sender(ports["line"])),
            ("/raw/mavlink/autopilot", MAVLINK_HZ, mavlink_sender(ports["mavlink"])),
        ]

        def run(topic: str, rate_hz: float, send: Callable[[int], None]) -> None:
            sent[topic] = paced(rate_hz, until_s, send)

        threads = [threading.Thread(target=run, args=job) for job in jobs]
        started_s = time.monotonic()
        with flood(ports["junk"]) if junk else nullcontext():
            for thread in threads:
                thread.start()
            while any(thread.is_alive() for thread in threads):
                time.sleep(min(60.0, duration_s / 5))
                print(f"{time.monotonic() - started_s:6.0f} s  {state(recorder.pid)}", flush=True)
            for thread in threads:
                thread.join()
        time.sleep(1.0)
        share = (cpu_s(recorder.pid) - before_s) / (time.monotonic() - started_s)
        recorder.send_signal(signal.SIGTERM)
        stdout, _ = recorder.communicate()
        report(sent, [Path(line) for line in stdout.split()], share, duration_s)


def report(sent: dict[str, int], paths: list[Path], share: float, duration_s: float) -> None:
    recorded: dict[str, int] = {}
    samples = 0
    for path in paths:
        recording = read_recording(path)
        samples += sum(series.value.size for series in recording.series.values())
        for topic, count in recording.raw.items():
            recorded[topic] = recorded.get(topic, 0) + count
    for topic, count in sent.items():
        kept = recorded.get(topic, 0)
        print(f"{topic}: sent {count:,} ({count / duration_s:.0f}/s), recorded {kept:,}, lost {count - kept:,}")
    if kept := recorded.get("/raw/nmea0183/junk", 0):
        print(f"junk: recorded {kept:,}, {kept * len(JUNK) / duration_s / 1e3:.0f} kB/s")
    size = sum(path.stat().st_size for path in paths)
    print(f"{samples:,} samples; {size / 1e6:.1f} MB, {size / duration_s / 1e3:.0f} kB/s")
    print(f"{100 * share:.1f} % of one core")


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 60.0, junk="junk" in sys.argv)
