"""What R/V Gunnerus publishes, 1,000 messages a second through a real broker, recorded for minutes: what is lost.

Sentences behind their times and values of every topic of ``trials/gunnerus_mqtt.toml`` go to ``seatrial record`` as
a process of its own, by mosquitto (or amqtt). Prints what was sent and recorded, how many values stand twice, the
recorder's share of one core and its memory. Run with the number of seconds:
``python -m tests.benchmarks.mqtt_load 600``; with ``restart`` behind it the broker is killed half-way and started
again.
"""

from __future__ import annotations

import signal
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import numpy as np
from paho.mqtt.client import Client
from paho.mqtt.enums import CallbackAPIVersion

from seatrial.acquisition.config.sources import MqttSource
from seatrial.acquisition.config.trial_file import load_config
from seatrial.acquisition.protocols.mqtt import format_time
from seatrial.acquisition.protocols.nmea0183 import frame_sentence
from seatrial.acquisition.recording.reader import Recording, read_recording
from tests.acquisition.conftest import Broker, open_sources, wait_for
from tests.benchmarks.recorder_load import ROOT, cpu_s, paced, state

MESSAGES_HZ = 1000
SENTENCES_SHARE = 5  # one of so many messages is a sentence
_AWAY_S = 5.0


class Publisher:
    """Sends message after message; ``sent`` counts those that a broker took."""

    def __init__(self, config: MqttSource) -> None:
        self.sent = 0
        self._topics = [each.topic for each in config.values.values()]
        self._client = Client(CallbackAPIVersion.VERSION2)
        self._client.reconnect_delay_set(1, 1)
        self._client.connect(*config.endpoint)
        self._client.loop_start()

    def send(self, number: int) -> None:
        now, place, turn = format_time(time.time_ns()), number % SENTENCES_SHARE, number // SENTENCES_SHARE
        if place == 0:
            clock = now[11:-1].replace(":", "")
            body = f"GPGGA,{clock},6326.{turn % 10_000:04d},N,01024.0,E,4,12,0.6,0.0,M,0.0,M,,"
            topic, text = "gunnerus/NMEA/GPGGA", f"{now} {frame_sentence(body).decode().strip()}"
        else:
            topic = self._topics[(number - turn - 1) % len(self._topics)]
            text = f"{number % 90 / 10},{now}"
        self.sent += not self._client.publish(topic, text).rc

    def close(self) -> None:
        self._client.disconnect()
        self._client.loop_stop()


def main(duration_s: float, restart: bool) -> None:
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        broker = Broker(folder)
        broker.start()
        text = (ROOT / "trials" / "gunnerus_mqtt.toml").read_text()
        here = f'address = "127.0.0.1"\nport = {broker.port}'
        (folder / "load.toml").write_text(text.replace('address = "mqtt.gunnerus.it.ntnu.no"', here))
        (section,) = load_config(folder / "load.toml").sources
        assert isinstance(section, MqttSource)
        recorder = subprocess.Popen(
            [sys.executable, ROOT / "seatrial.py", "record", folder / "load.toml", "-o", folder / "out"],
            stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
        )  # fmt: skip
        wait_for(lambda: open_sources(folder / "out") == {"gunnerus"})
        publisher = Publisher(section)
        if restart:
            threading.Timer(duration_s / 2, _restarted, (broker,)).start()
        before_s, began_s = cpu_s(recorder.pid), time.monotonic()
        paced(MESSAGES_HZ, began_s + duration_s, publisher.send)
        publisher.close()
        time.sleep(2.0)
        share = (cpu_s(recorder.pid) - before_s) / (time.monotonic() - began_s)
        memory = state(recorder.pid)
        recorder.send_signal(signal.SIGTERM)
        stdout, _ = recorder.communicate()
        broker.stop()
        report(publisher.sent, [read_recording(Path(line)) for line in stdout.split()], duration_s)
        print(f"{100 * share:.1f} % of one core, {memory}")


def _restarted(broker: Broker) -> None:
    broker.stop()
    time.sleep(_AWAY_S)
    broker.start()


def report(sent: int, parts: list[Recording], duration_s: float) -> None:
    recorded = sum(part.raw.get("/raw/mqtt/gunnerus", 0) for part in parts)
    series = [each for part in parts for each in part.series.values()]
    twice = sum(each.measured_ns.size - np.unique(each.measured_ns).size for each in series)
    print(f"sent {sent:,} ({sent / duration_s:.0f}/s), recorded {recorded:,}, lost {sent - recorded:,}")
    values = sum(each.value.size for each in series)
    print(f"{values:,} values of {len(parts[0].series)} channels, {twice} of them twice")
    for text in (text for part in parts for _, text in part.events):
        print(f"  {text}")


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 60.0, "restart" in sys.argv)
