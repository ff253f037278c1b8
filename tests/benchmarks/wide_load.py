"""Many channels and many sources, recorded for a minute: what is lost, what it costs, what it costs to start.

``python -m tests.benchmarks.wide_load SECONDS CHANNELS RATE SOURCES``: so many declared channels, each so many
times a second, spread over so many UDP ports; a sentence has up to 50 of them. Prints what was sent and recorded,
the recorder's share of one core, its memory, and how long it took to start and to end.
"""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from seatrial.acquisition.protocols.nmea0183 import frame_sentence
from seatrial.acquisition.recording.messages import RAW_PREFIX
from seatrial.acquisition.recording.reader import MessageStream
from tests.acquisition.conftest import free_port
from tests.benchmarks.recorder_load import ROOT, cpu_s, paced, state

MOST_FIELDS = 50


def configuration(ports: list[int], channels: int) -> tuple[str, list[tuple[int, bytes]]]:
    """The configuration, and the sentences that carry all channels once, each with its port."""
    text, sentences = '[trial]\nname = "wide"\n', []
    names = [f"quantity{number}_v" for number in range(channels)]
    shares = [names[start :: len(ports)] for start in range(len(ports))]
    for number, (port, share) in enumerate(zip(ports, shares, strict=True)):
        for part, start in enumerate(range(0, len(share), MOST_FIELDS)):
            tag, carried = f"PX{number}X{part}", share[start : start + MOST_FIELDS]
            for field, name in enumerate(carried, 1):
                origin = f'{{ sentence = "{tag}", field = {field} }}'
                text += f'[[channel]]\nname = "{name}"\nunit = "V"\nrange = [0, 100]\nmeaning = "{tag}"\n'
                text += f"from = [{origin}]\n"
            sentences.append((port, frame_sentence(",".join([tag, *("12.5" for _ in carried)]))))
        text += f'[[source]]\nname = "port{number}"\ntype = "udp"\nport = {port}\nchannels = {share}\n'
    return text, sentences


def main(duration_s: float, channels: int, rate_hz: float, sources: int) -> None:
    ports: dict[int, None] = {}
    while len(ports) < sources:
        ports[free_port()] = None
    text, sentences = configuration(list(ports), channels)
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        (folder / "wide.toml").write_text(text)
        began_s = time.monotonic()
        recorder = subprocess.Popen(
            [sys.executable, ROOT / "seatrial.py", "record", folder / "wide.toml", "-o", folder / "out"],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        assert recorder.stderr is not None
        answer = next((line for line in recorder.stderr if "recording to" in line or "seatrial:" in line), "")
        assert "recording to" in answer, answer
        print(f"started after {time.monotonic() - began_s:.1f} s")
        time.sleep(2.0)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line:

            def send(number: int) -> None:
                port, data = sentences[number % len(sentences)]
                line.sendto(data, ("127.0.0.1", port))

            before_s, began_s = cpu_s(recorder.pid), time.monotonic()
            sent = paced(rate_hz * len(sentences), began_s + duration_s, send)
        print(state(recorder.pid))
        share = (cpu_s(recorder.pid) - before_s) / (time.monotonic() - began_s)
        began_s = time.monotonic()
        recorder.send_signal(signal.SIGTERM)
        stdout, _ = recorder.communicate()
        print(f"ended after {time.monotonic() - began_s:.1f} s, exit code {recorder.returncode}")
        report([Path(path) for path in stdout.split()], sent, share, duration_s)


def report(paths: list[Path], sent: int, share: float, duration_s: float) -> None:
    raw = samples = 0
    for path in paths:
        for entry in MessageStream(path):
            raw += entry.topic.startswith(RAW_PREFIX)
            samples += entry.topic.startswith("/channel/")
    print(f"sent {sent:,} sentences ({sent / duration_s:,.0f}/s), recorded {raw:,}, lost {sent - raw:,}")
    print(f"{samples:,} values ({samples / duration_s:,.0f}/s); {100 * share:.0f} % of one core")


if __name__ == "__main__":
    numbers = [float(argument) for argument in sys.argv[1:]]
    defaults = [60.0, 500, 100.0, 10]
    seconds, channel_count, hertz, source_count = [*numbers, *defaults[len(numbers) :]]
    main(seconds, int(channel_count), hertz, int(source_count))
