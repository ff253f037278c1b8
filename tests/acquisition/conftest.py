"""What the acquisition tests share: a recording with a known motion, and ways to play it."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from random import SystemRandom
from typing import Any

import numpy as np
import pandas as pd
import pytest

from seatrial.acquisition.core.errors import InputError
from seatrial.acquisition.core.ship import (
    MOTION,
    NAMES,
    Actuator,
    Actuators,
    actuators_as_text,
    control_channels,
    order_channels,
)
from seatrial.acquisition.core.trial import Trial
from seatrial.acquisition.emulator import NullModem
from seatrial.acquisition.recording.messages import HEALTH_TOPIC
from seatrial.acquisition.recording.reader import MessageStream, read_recording
from seatrial.acquisition.recording.writer import write_table
from seatrial.acquisition.tables.foreign_reader import CellBudget

DBC = Path(__file__).parents[2] / "trials" / "vessels" / "thrusters.dbc"
ORIGIN = (63.44, 10.4)
SIGNALS = """
[source.signals]
port_rpm = { message = "PortAzimuth", signal = "ShaftSpeed", unit = "rpm" }
port_angle_deg = { message = "PortAzimuth", signal = "Angle", unit = "deg" }
starboard_rpm = { message = "StarboardAzimuth", signal = "ShaftSpeed", unit = "rpm" }
starboard_angle_deg = { message = "StarboardAzimuth", signal = "Angle", unit = "deg" }
tunnel_rpm = { message = "TunnelThruster", signal = "ShaftSpeed", unit = "rpm" }
"""


def voyage_table(duration_s: float, rate_hz: float = 10.0, seed: int = 1) -> pd.DataFrame:
    """All 13 channels in motion, through north and through 180 degrees again and again."""
    count = int(duration_s * rate_hz)
    seconds = np.arange(count) / rate_hz
    random = np.random.default_rng(seed)
    phase = random.uniform(0, 2 * np.pi, len(NAMES))
    wave = {name: np.sin(0.05 * seconds + angle) for name, angle in zip(NAMES, phase, strict=True)}
    turn = np.cumsum(random.normal(2.0, 20.0, count))
    table = {
        "north_m": 800 * wave["north_m"],
        "east_m": 900 * wave["east_m"],
        "heading_deg": turn % 360,
        "surge_mps": 5 * wave["surge_mps"],
        "sway_mps": wave["sway_mps"],
        "yaw_rate_dps": 3 * wave["yaw_rate_dps"],
        "wind_direction_deg": (turn + 90) % 360,
        "wind_speed_mps": 8 + 5 * wave["wind_speed_mps"],
        "port_rpm": 200 * wave["port_rpm"],
        "port_angle_deg": 180 - (turn % 360),
        "starboard_rpm": 200 * wave["starboard_rpm"],
        "starboard_angle_deg": 180 - ((turn + 77) % 360),
        "tunnel_rpm": 300 * wave["tunnel_rpm"],
    }
    start = pd.Timestamp("2026-05-17T23:58:00Z").as_unit("ns")  # midnight passes during a longer voyage
    index = start + pd.to_timedelta((seconds * 1e9).astype("int64"), unit="ns")
    return pd.DataFrame(table, index=pd.DatetimeIndex(index, name="time"))


def write_voyage(path: Path, duration_s: float, rate_hz: float = 10.0) -> pd.DataFrame:
    """Write :func:`voyage_table` as a recording and return it."""
    table = voyage_table(duration_s, rate_hz)
    trial = Trial(name="voyage", origin_latitude_deg=ORIGIN[0], origin_longitude_deg=ORIGIN[1])
    write_table(table, path, trial)
    return table


TWIN_SCREW: Actuators = (
    Actuator("port", "propeller"), Actuator("starboard", "propeller"),
    Actuator("port_rudder", "rudder"), Actuator("starboard_rudder", "rudder"),
)  # fmt: skip
SINGLE_SCREW: Actuators = (
    Actuator("main", "controllable_propeller"), Actuator("rudder", "rudder"), Actuator("bow", "tunnel")
)  # fmt: skip


def actuator_text(actuators: Actuators) -> str:
    """A ship's list of actuators as a configuration says it."""
    return "".join(f'[[actuator]]\nname = "{each.name}"\nkind = "{each.kind}"\n' for each in actuators)


def write_ship_voyage(path: Path, actuators: Actuators, duration_s: float = 20.0) -> pd.DataFrame:
    """A voyage of another ship: every control and every order moves, each in its own way."""
    table = voyage_table(duration_s)[list(MOTION)]
    seconds = np.arange(len(table)) / 10.0
    sizes = {"rpm": 120.0, "deg": 35.0, "%": 90.0}
    for number, each in enumerate((*control_channels(actuators), *order_channels(actuators))):
        table[each.name] = sizes[each.unit] * np.sin(0.3 * seconds + number)
    trial = Trial(
        name="voyage",
        origin_latitude_deg=ORIGIN[0],
        origin_longitude_deg=ORIGIN[1],
        actuators=actuators_as_text(actuators),
    )
    write_table(table, path, trial)
    return table


def free_port(kind: socket.SocketKind = socket.SOCK_DGRAM) -> int:
    """A port on this machine that nobody uses at this moment.

    It is none of those that the system gives to outgoing connections (from 32768 on): one of another test took the
    port before the server that it was chosen for was there, and a viewer waited for five minutes.
    """
    while True:
        port = SystemRandom().randrange(20_000, 32_000)
        with socket.socket(socket.AF_INET, kind) as probe, suppress(OSError):
            probe.bind(("127.0.0.1", port))
            return port


def config_text(section: str, channels: tuple[str, ...] = NAMES, clock: str = "source") -> str:
    """A configuration of one source that provides ``channels``."""
    listed = ", ".join(f'"{name}"' for name in channels)
    latitude_deg, longitude_deg = ORIGIN
    return (
        '[trial]\nname = "round trip"\n'
        f"origin = {{ latitude_deg = {latitude_deg}, longitude_deg = {longitude_deg} }}\n"
        f'[[source]]\nname = "line"\nclock = "{clock}"\nchannels = [{listed}]\n{section}'
    )


PATIENCE_S = 300.0
"""Longer than a busy machine needs for anything that is waited for; nothing waits longer than it has to."""


def wait_for(condition: Callable[[], bool], every_s: float = 0.01) -> None:
    """Wait until something has come true."""
    until_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < until_s, "it never came true"
        time.sleep(every_s)


def recorded_counts(folder: Path) -> Counter[str]:
    """The number of each channel's values in the files of a recorder that is still at work."""
    counts = Counter[str]()
    for path in folder.glob("*.mcap"):
        with suppress(InputError):  # there is nothing in it yet
            counts.update({name: series.value.size for name, series in read_recording(path).series.items()})
    return counts


def recorded_count(folder: Path, channel: str = "heading_deg") -> int:
    """As :func:`recorded_counts`, of one channel."""
    return recorded_counts(folder)[channel]


def open_sources(folder: Path) -> set[str]:
    """The sources that a recorder at work has called open in its files, which it does once a second."""
    health = []
    for path in folder.glob("*.mcap"):
        with suppress(InputError):
            health += [each.decode_body() for each in MessageStream(path) if each.topic == HEALTH_TOPIC]
    return {each["source"] for each in health if each["state"] in ("open", "silent")}


class Sleeper(threading.Thread):
    """Measures for how long this machine holds up a program that only sleeps."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self._ending = threading.Event()
        self.worst_s = 0.0

    def run(self) -> None:
        while not self._ending.is_set():
            began_s = time.monotonic()
            time.sleep(0.005)
            self.worst_s = max(self.worst_s, time.monotonic() - began_s - 0.005)

    def __enter__(self) -> Sleeper:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ending.set()
        self.join()


class SimulatedClock:
    """Stands in for a module's ``time``: its seconds pass while somebody sleeps, and then at once."""

    def __init__(self) -> None:
        self.now_s = 1000.0

    def monotonic(self) -> float:
        return self.now_s

    def monotonic_ns(self) -> int:
        return round(self.now_s * 1e9)

    def sleep(self, duration_s: float) -> None:
        self.now_s += duration_s


@pytest.fixture
def clock() -> SimulatedClock:
    return SimulatedClock()


@pytest.fixture
def read_in_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Other programs' files are read in this process, without limits: another one takes a third of a second."""

    def read(script: Path, reader: str, path: Path, kind: str = "table") -> Any:
        module = import_module(f"seatrial.acquisition.tables.{script.stem}")
        return module.READERS[reader](str(path.absolute()), CellBudget(10**9))

    monkeypatch.setattr("seatrial.acquisition.core.process.read_in_child", read)


@pytest.fixture
def null_modem() -> Iterator[NullModem]:
    with NullModem() as cable:
        yield cable


class Broker:
    """A real MQTT broker in a process of its own, mosquitto or else amqtt, which can be restarted.

    ``is_sound`` is false of amqtt: it drops what it has acknowledged and not yet passed on when a publisher leaves.
    """

    def __init__(self, folder: Path) -> None:
        self.port = free_port(socket.SOCK_STREAM)
        self._process: subprocess.Popen[bytes] | None = None
        found = shutil.which("mosquitto", path=f"{os.environ.get('PATH', '')}:/usr/sbin")
        self.is_sound = found is not None
        if found is not None:
            self._command = [found, "-p", str(self.port)]
        else:
            (folder / "broker.yaml").write_text(
                f"listeners: {{default: {{type: tcp, bind: '127.0.0.1:{self.port}'}}}}\n"
                "plugins: {amqtt.plugins.authentication.AnonymousAuthPlugin: {allow_anonymous: true}}\n"
            )
            script = "amqtt.scripts.broker_script"
            self._command = [sys.executable, "-m", script, "-c", str(folder / "broker.yaml")]

    def start(self) -> None:
        self._process = subprocess.Popen(self._command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        wait_for(self._answers)

    def _answers(self) -> bool:
        with suppress(OSError), socket.create_connection(("127.0.0.1", self.port), timeout=1.0):
            return True
        return False

    def stop(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process = None


@pytest.fixture
def broker(tmp_path: Path) -> Iterator[Broker]:
    running = Broker(tmp_path)
    running.start()
    yield running
    running.stop()
