"""What the emulator plays is what the recorder holds, on every transport."""

from __future__ import annotations

import socket
import threading
from collections import Counter
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from seatrial.acquisition.config.trial_file import TrialConfig, load_config
from seatrial.acquisition.core.quantities import Series
from seatrial.acquisition.core.ship import BY_NAME, CIRCULAR, MOTION, NAMES, Actuators, angle_difference
from seatrial.acquisition.emulator import NullModem, Playback, emulate
from seatrial.acquisition.logger.record import record
from seatrial.acquisition.recording.reader import Recording, read_recording
from tests.acquisition.conftest import (
    DBC,
    PATIENCE_S,
    SIGNALS,
    SINGLE_SCREW,
    TWIN_SCREW,
    Sleeper,
    actuator_text,
    config_text,
    free_port,
    open_sources,
    recorded_counts,
    wait_for,
    write_ship_voyage,
    write_voyage,
)
from tests.conftest import nightly

# Half a step of each wire format, in the channel's unit, and a little for floating point.
_METRE_PER_1E7_DEG = 0.0112
CAN_STEP = {
    "north_m": _METRE_PER_1E7_DEG,
    "east_m": _METRE_PER_1E7_DEG,
    "heading_deg": np.rad2deg(1e-4),
    "surge_mps": 1e-3,
    "sway_mps": 1e-3,
    "yaw_rate_dps": np.rad2deg(3.125e-8),
    "wind_direction_deg": np.rad2deg(1e-4),
    "wind_speed_mps": 1e-2,
    "port_rpm": 0.125,
    "port_angle_deg": 1 / 128,
    "starboard_rpm": 0.125,
    "starboard_angle_deg": 1 / 128,
    "tunnel_rpm": 0.125,
}
NMEA0183_STEP = {
    "north_m": 1.9e-3,
    "east_m": 1.9e-3,
    "heading_deg": 1e-4,
    "surge_mps": 1e-4,
    "sway_mps": 1e-4,
    "yaw_rate_dps": 1e-3 / 60,
    "wind_direction_deg": 1e-3,
    "wind_speed_mps": 1e-3,
    "port_rpm": 1e-3,
    "port_angle_deg": 1e-3,
    "starboard_rpm": 1e-3,
    "starboard_angle_deg": 1e-3,
    "tunnel_rpm": 1e-3,
}
SINGLE_FRAMES_STEP = {name: step for name, step in CAN_STEP.items() if name not in ("surge_mps", "sway_mps")}
"""A busy machine may let datagrams of a group overtake each other; a message of two frames is refused then."""
_SINGLE = 2.0**-23
MAVLINK_STEP = {
    "north_m": _METRE_PER_1E7_DEG, "east_m": _METRE_PER_1E7_DEG, "heading_deg": 360 * _SINGLE,
    "surge_mps": 20 * _SINGLE, "sway_mps": 20 * _SINGLE, "yaw_rate_dps": 10 * _SINGLE,
    "wind_direction_deg": 360 * _SINGLE, "wind_speed_mps": 20 * _SINGLE, "port_rpm": 400 * _SINGLE,
    "port_angle_deg": 360 * _SINGLE, "starboard_rpm": 400 * _SINGLE, "starboard_angle_deg": 360 * _SINGLE,
    "tunnel_rpm": 600 * _SINGLE,
}  # fmt: skip


def play_and_record(
    voyage: Path, sending: TrialConfig, receiving: TrialConfig, folder: Path, speed: float
) -> tuple[Playback, Recording]:
    """Record in this process while the emulator plays beside it; stop when the last frame has arrived."""
    stop, out = threading.Event(), folder / "recorded"
    played: list[Playback] = []

    def play() -> None:
        try:
            wait_for(lambda: open_sources(out) == {"line"})
            played.append(emulate(voyage, sending, speed))
            wait_for(lambda: recorded_counts(out) >= Counter(played[0].counts), every_s=0.1)
        finally:
            stop.set()

    thread = threading.Thread(target=play)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("seatrial.acquisition.logger.maintenance._HEALTH_EVERY_S", 0.1)
        thread.start()
        (path,), _ = record(receiving, out, duration_s=PATIENCE_S, stop=stop)
        thread.join()
    return played[0], read_recording(path)


def load(tmp_path: Path, name: str, text: str) -> TrialConfig:
    path = tmp_path / name
    path.write_text(text)
    return load_config(path)


def transport(
    kind: str, tmp_path: Path, cable: NullModem, clock: str, names: tuple[str, ...] = NAMES
) -> tuple[TrialConfig, TrialConfig]:
    """The configurations of the emulator and of the recorder for one transport."""
    sections = {
        "can": f'type = "can"\ninterface = "virtual"\nchannel = "{tmp_path}"\ndbc = "{DBC}"\n{SIGNALS}',
        "multicast": 'type = "can"\ninterface = "udp_multicast"\nchannel = "239.74.163.2"\n'
        f'options = {{ port = {free_port()}, hop_limit = 0 }}\ndbc = "{DBC}"\n{SIGNALS}',
        "udp": f'type = "udp"\nport = {free_port()}\n',
        "tcp": f'type = "tcp"\nport = {free_port(socket.SOCK_STREAM)}\n',
        "mavlink": f'type = "mavlink"\nport = {free_port()}\n',
    }
    if kind == "serial":
        texts = [f'type = "serial"\ndevice = "{each}"\n' for each in (cable.emulator_device, cable.logger_device)]
    else:
        texts = [sections[kind]] * 2
    sending, receiving = (
        load(tmp_path, f"{role}.toml", config_text(text, names, clock))
        for role, text in zip(("sending", "receiving"), texts, strict=True)
    )
    return sending, receiving


def assert_same_values(table: pd.DataFrame, series: dict[str, Series], steps: dict[str, float]) -> None:
    for name in steps:
        sent, got = table[name].to_numpy(), series[name].value
        assert got.size == sent.size, f"{name}: {sent.size} played, {got.size} recorded"
        error = np.abs(angle_difference(got, sent)) if name in CIRCULAR else np.abs(got - sent)
        assert error.max() <= 0.5001 * steps[name] + 1e-7, f"{name}: {error.max()}"
        assert all(BY_NAME[name].is_possible_value(value) for value in got)


@pytest.mark.parametrize(
    ("kind", "steps", "speed"),
    [
        ("can", CAN_STEP, 60.0),
        ("multicast", SINGLE_FRAMES_STEP, 20.0),
        ("serial", NMEA0183_STEP, 50.0),
        ("udp", NMEA0183_STEP, 60.0),
        ("mavlink", MAVLINK_STEP, 60.0),
    ],
)
def test_every_sample_of_every_channel_arrives(
    kind: str, steps: dict[str, float], speed: float, tmp_path: Path, null_modem: NullModem
) -> None:
    """All 13 channels at 10 Hz, values within the wire format's resolution, nothing lost, nothing added."""
    table = write_voyage(tmp_path / "voyage.mcap", duration_s=40.0)
    sending, receiving = transport(kind, tmp_path, null_modem, "source", tuple(steps))
    played, recording = play_and_record(tmp_path / "voyage.mcap", sending, receiving, tmp_path, speed)
    assert played.counts == {name: len(table) for name in steps}
    assert_same_values(table, recording.series, steps)


RATIO = 4.5
"""The turns of an engine for one of its shaft."""

SHIP_STEPS = {
    "can": {"rpm": 0.25 / RATIO, "deg": np.rad2deg(1e-4)},
    "udp": {"rpm": 1e-3, "deg": 1e-3, "%": 1e-3},
    "mavlink": {"rpm": 200 * _SINGLE, "deg": 50 * _SINGLE, "%": 200 * _SINGLE},
}


@pytest.mark.parametrize(
    ("kind", "actuators", "channels"),
    [
        ("udp", SINGLE_SCREW, None),
        *nightly(("udp", TWIN_SCREW, None)),
        ("mavlink", TWIN_SCREW, (
            "port_rpm", "starboard_rpm", "port_rudder_angle_deg", "starboard_rudder_angle_deg",
        )),
        ("mavlink", SINGLE_SCREW, ("main_rpm", "main_pitch_percent", "rudder_angle_deg", "bow_rpm")),
        ("can", TWIN_SCREW, (
            "port_rpm", "starboard_rpm", "port_rudder_angle_deg", "starboard_rudder_angle_deg",
            "port_rudder_order_angle_deg", "starboard_rudder_order_angle_deg",
        )),
        ("can", SINGLE_SCREW, ("main_rpm", "rudder_angle_deg", "rudder_order_angle_deg")),
    ],
)  # fmt: skip
def test_ships_with_rudders_come_back_channel_by_channel(
    kind: str, actuators: Actuators, channels: tuple[str, ...] | None, tmp_path: Path
) -> None:
    """All that NMEA 0183 carries, which is everything; what MAVLink and NMEA 2000 have messages for."""
    table = write_ship_voyage(tmp_path / "voyage.mcap", actuators)
    names = tuple(table.columns) if channels is None else (*MOTION, *channels)
    ratios = ", ".join(f"{each.name} = {RATIO}" for each in actuators if each.drives)
    section = {
        "can": f'type = "can"\ninterface = "virtual"\nchannel = "{tmp_path}"\nreduction_ratios = {{ {ratios} }}\n',
        "udp": f'type = "udp"\nport = {free_port()}\n',
        "mavlink": f'type = "mavlink"\nport = {free_port()}\n',
    }[kind]
    config = load(tmp_path, "ship.toml", actuator_text(actuators) + config_text(section, names))
    played, recording = play_and_record(tmp_path / "voyage.mcap", config, config, tmp_path, 40.0)
    assert played.counts == {name: len(table) for name in names}
    assert played.unsent == {}
    for name in set(names) - set(MOTION):
        error = np.abs(recording.series[name].value - table[name].to_numpy())
        assert error.max() <= 0.5001 * SHIP_STEPS[kind][BY_NAME[name].unit] + 1e-7, f"{name}: {error.max()}"


@pytest.mark.parametrize("kind", ["can", *nightly("serial", "mavlink")])
def test_source_clock_restores_the_played_times(kind: str, tmp_path: Path, null_modem: NullModem) -> None:
    """Played 30 times as fast, a line that announces its time is stamped with the times of the voyage."""
    table = write_voyage(tmp_path / "voyage.mcap", duration_s=60.0)
    sending, receiving = transport(kind, tmp_path, null_modem, "source")
    with Sleeper() as machine:
        _, recording = play_and_record(tmp_path / "voyage.mcap", sending, receiving, tmp_path, 30.0)
    sent_ns = pd.DatetimeIndex(table.index).as_unit("ns").asi8
    for name in NAMES:
        late_ms = np.abs(recording.series[name].measured_ns - sent_ns) / 1e6
        assert np.quantile(late_ms, 0.99) < 20.0 + 1e3 * machine.worst_s, f"{name}: {late_ms.max()} ms"


def test_times_of_reception_follow_the_played_times(tmp_path: Path, null_modem: NullModem) -> None:
    """At speed 1, without any source clock, samples are stamped within 20 ms of when they were due."""
    table = write_voyage(tmp_path / "voyage.mcap", duration_s=4.0, rate_hz=20.0)
    sending, receiving = transport("can", tmp_path, null_modem, "receiver")
    with Sleeper() as machine:
        _, recording = play_and_record(tmp_path / "voyage.mcap", sending, receiving, tmp_path, 1.0)
    sent_ns = pd.DatetimeIndex(table.index).as_unit("ns").asi8
    for name in NAMES:
        offset_ms = (recording.series[name].measured_ns - sent_ns) / 1e6
        late_ms = np.quantile(np.abs(offset_ms - np.median(offset_ms)), 0.95)
        assert late_ms < 20.0 + 1e3 * machine.worst_s, name


def test_tcp_gateway(tmp_path: Path, null_modem: NullModem) -> None:
    """A TCP multiplexer that is there before the recorder: every sentence arrives."""
    from seatrial.acquisition.emulator import iterate_moments, open_transmitter
    from seatrial.acquisition.protocols import make_encoder

    table = write_voyage(tmp_path / "voyage.mcap", duration_s=10.0)
    sending, receiving = transport("tcp", tmp_path, null_modem, "source")
    outlet, encoder = open_transmitter(sending.sources[0]), make_encoder(sending.sources[0])
    moments = list(iterate_moments(read_recording(tmp_path / "voyage.mcap"), NAMES, sending.trial.origin))
    stop = threading.Event()

    def serve() -> None:
        for moment in moments:
            outlet.send(encoder.encode(moment))
        wait_for(lambda: recorded_counts(tmp_path / "recorded") >= Counter(dict.fromkeys(NAMES, len(table))))
        stop.set()

    thread = threading.Thread(target=serve)
    thread.start()
    (path,), _ = record(receiving, tmp_path / "recorded", duration_s=PATIENCE_S, stop=stop)
    thread.join()
    outlet.close()
    assert_same_values(table, read_recording(path).series, NMEA0183_STEP)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "steps"), [("can", CAN_STEP), ("serial", NMEA0183_STEP), ("mavlink", MAVLINK_STEP)]
)
def test_ten_minutes_of_every_channel(
    kind: str, steps: dict[str, float], tmp_path: Path, null_modem: NullModem
) -> None:
    """Ten minutes of all 13 channels at 10 Hz, played 20 times as fast: nothing lost, values as played."""
    table = write_voyage(tmp_path / "voyage.mcap", duration_s=600.0)
    sending, receiving = transport(kind, tmp_path, null_modem, "source")
    _, recording = play_and_record(tmp_path / "voyage.mcap", sending, receiving, tmp_path, 20.0)
    assert_same_values(table, recording.series, steps)
