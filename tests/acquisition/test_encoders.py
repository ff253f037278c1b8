"""What the emulator says: values at the ends of their ranges, nothing made up, and only what was sent counts."""

from __future__ import annotations

import math
import socket
import threading
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from seatrial.acquisition.config.sources import AnySource
from seatrial.acquisition.config.trial_file import load_config
from seatrial.acquisition.core.errors import SourceError
from seatrial.acquisition.core.ship import BY_NAME, CIRCULAR, NAMES, angle_difference
from seatrial.acquisition.core.trial import Frame, FrameFlag, Trial
from seatrial.acquisition.emulator import emulate, iterate_moments
from seatrial.acquisition.logger.processing import Derivation
from seatrial.acquisition.protocols import Moment, Packet, make_decoders, make_encoder
from seatrial.acquisition.protocols.nmea0183 import format_degrees_and_minutes
from seatrial.acquisition.recording.reader import read_recording
from seatrial.acquisition.recording.writer import write_table
from tests.acquisition.conftest import (
    DBC,
    ORIGIN,
    SIGNALS,
    SimulatedClock,
    config_text,
    free_port,
    voyage_table,
    wait_for,
    write_voyage,
)

SECTIONS = {
    "can": f'type = "can"\ninterface = "virtual"\nchannel = "x"\ndbc = "{DBC}"\n{SIGNALS}',
    "udp": 'type = "udp"\nport = 1\n',
    "mavlink": 'type = "mavlink"\nport = 1\n',
    "mqtt": 'type = "mqtt"\ntopics = ["ship/#"]\n[source.values]\n'
    'heading_deg = { topic = "ship/Heading", unit = "rad" }\n'
    'surge_mps = { topic = "ship/Ahead", unit = "knots" }\n'
    'port_rpm = { topic = "ship/Speed", unit = "percent", full_scale = 203, scale = -1 }\n'
    'port_angle_deg = { topic = "ship/Angle", unit = "deg", offset = 10, field = "thrust.angle" }\n',
}
PROTOCOLS = {"can": "can", "udp": "nmea0183", "mavlink": "mavlink", "mqtt": "mqtt"}
START_NS = 1_779_062_280_000_000_000
# The coarsest step of any wire, in the channel's unit.
STEP = {"m": 0.02, "deg": 0.0079, "m/s": 0.011, "deg/s": 0.001, "rpm": 0.13}


@pytest.fixture(scope="module")
def sources(tmp_path_factory: pytest.TempPathFactory) -> dict[str, AnySource]:
    found = {}
    for kind, section in SECTIONS.items():
        path = tmp_path_factory.mktemp(kind) / "trial.toml"
        path.write_text(config_text(section))
        (found[kind],) = load_config(path).sources
    return found


def heard(source: AnySource, *moments: Moment) -> tuple[list[dict[str, float]], list[Packet]]:
    """What a recorder makes of each moment, and the packets that carried them."""
    encoder, decoders = make_encoder(source), make_decoders(source)
    derivation = Derivation(
        Trial(origin_latitude_deg=ORIGIN[0], origin_longitude_deg=ORIGIN[1]), frozenset({"line"})
    )
    heard, sent = [], []
    for number, moment in enumerate(moments):
        values: dict[str, float] = {}
        for packet in encoder.encode(moment):
            sent.append(packet)
            time_ns = START_NS + number * 1_000_000
            protocol = PROTOCOLS[source.type]
            flags = FrameFlag.NONE if packet.extended else FrameFlag.STANDARD_ID
            payload = packet.payload.strip() if protocol == "nmea0183" else packet.payload
            frame = Frame("line", protocol, payload, time_ns, time_ns, packet.identifier, flags)  # type: ignore[arg-type]
            for decoder in decoders:
                for group in decoder.decode(frame):
                    for sample in derivation.derive_channels(group)[0]:
                        values.setdefault(sample.quantity, sample.value)
        heard.append({name: value for name, value in values.items() if name in NAMES})
    return heard, sent


def assert_close(got: dict[str, float], expected: dict[str, float]) -> None:
    assert got.keys() == expected.keys()
    for name, value in expected.items():
        error = angle_difference(got[name], value) if name in CIRCULAR else got[name] - value
        assert abs(float(error)) <= STEP[BY_NAME[name].unit], f"{name}: {value} came back as {got[name]}"
        assert BY_NAME[name].is_possible_value(got[name])


@pytest.mark.parametrize("kind", SECTIONS)
@pytest.mark.parametrize("angle_deg", [0.0, 359.9983, 359.99999, 180.0, 180.001, 90.0])
def test_angles_at_the_ends_of_their_turn(kind: str, angle_deg: float, sources: dict[str, AnySource]) -> None:
    """359.99999 rounds to a whole turn on most wires, which is north and no value beyond the range."""
    azimuth_deg = BY_NAME["port_angle_deg"].wrap_angle(angle_deg)
    values = {
        "heading_deg": angle_deg, "wind_direction_deg": angle_deg, "wind_speed_mps": 3.0,
        "port_angle_deg": azimuth_deg, "starboard_angle_deg": azimuth_deg,
    }  # fmt: skip
    (got,), packets = heard(sources[kind], Moment(START_NS, values))
    assert_close(got, values)
    assert not any(b"360.0" in packet.payload for packet in packets)


@pytest.mark.parametrize("kind", SECTIONS)
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_values_at_the_ends_of_their_ranges(kind: str, sign: float, sources: dict[str, AnySource]) -> None:
    values = {
        "heading_deg": 0.0, "surge_mps": sign * 30, "sway_mps": sign * 30, "yaw_rate_dps": sign * 60,
        "wind_direction_deg": 0.0, "wind_speed_mps": 50 + 50 * sign,
        "port_rpm": sign * 3000, "starboard_rpm": sign * 3000, "tunnel_rpm": sign * 3000,
    }  # fmt: skip
    inside = {name: value * (1 - 1e-7) for name, value in values.items()}  # MAVLink's floats have 24 bits
    (got,), _ = heard(sources[kind], Moment(START_NS, inside))
    assert_close(got, inside)


@pytest.mark.parametrize("kind", SECTIONS)
@given(st.floats(-89.9, 89.9), st.floats(-179.9, 179.9))
def test_positions_all_over_the_earth(
    kind: str, sources: dict[str, AnySource], latitude_deg: float, longitude_deg: float
) -> None:
    assume(abs(latitude_deg) + abs(longitude_deg) > 1e-6)  # autopilots say 0, 0 before their first fix
    (packet, *_) = make_encoder(sources[kind]).encode(Moment(START_NS, {}, latitude_deg, longitude_deg))[-1:]
    (decoder, *_) = make_decoders(sources[kind])
    protocol = PROTOCOLS[kind]
    payload = packet.payload.strip() if kind == "udp" else packet.payload
    frame = Frame("line", protocol, payload, 0, 0, packet.identifier)  # type: ignore[arg-type]
    got = {each.quantity: each.value for each in decoder.decode(frame)[-1]}
    assert got["latitude_deg"] == pytest.approx(latitude_deg, abs=6e-8)
    assert got["longitude_deg"] == pytest.approx(longitude_deg, abs=6e-8)


@pytest.mark.parametrize(
    ("angle_deg", "text"),
    [(59.9999999999, "6000.000000"), (0.0, "0000.000000"), (-33.5, "3330.000000"), (10.99999999, "1059.999999")],
)
def test_minutes_never_reach_sixty(angle_deg: float, text: str) -> None:
    assert format_degrees_and_minutes(angle_deg, 2) == text


@pytest.mark.parametrize("kind", SECTIONS)
@pytest.mark.parametrize("name", NAMES[2:])
def test_one_channel_alone_makes_up_no_other(kind: str, name: str, sources: dict[str, AnySource]) -> None:
    """Channels come at different rates: a heading without a rate of turn must not become a rate of zero."""
    value = {name: 7.0}
    (got,), packets = heard(sources[kind], Moment(START_NS, value))
    carried = {each for packet in packets for each in packet.carries}
    assert got.keys() == carried
    assert carried in (set(value), set()), "MAVLink turns velocities by the heading, which is not known here"
    assert carried or (kind == "mavlink" and name in ("surge_mps", "sway_mps"))


def test_a_position_without_a_velocity_makes_up_no_velocity(sources: dict[str, AnySource]) -> None:
    heading = Moment(START_NS, {"heading_deg": 90.0})
    fix = Moment(START_NS, {"north_m": 0.0, "east_m": 0.0}, *ORIGIN)
    (_, got), packets = heard(sources["mavlink"], heading, fix)
    assert_close(got, {"north_m": 0.0, "east_m": 0.0})
    assert set(packets[1].carries) == {"north_m", "east_m"}


def test_velocities_between_two_headings_are_turned_by_the_last(sources: dict[str, AnySource]) -> None:
    heading = Moment(START_NS, {"heading_deg": 300.0})
    velocity = {"surge_mps": 4.0, "sway_mps": -0.5}
    (_, got), _ = heard(sources["mavlink"], heading, Moment(START_NS, velocity))
    assert_close(got, velocity)


@pytest.mark.parametrize("rpm", [5000.0, -4000.5])
def test_a_value_beyond_its_dbc_signal_goes_out_as_not_available(rpm: float, sources: dict[str, AnySource]) -> None:
    (got,), (*_, packet) = heard(sources["can"], Moment(START_NS, {"port_rpm": rpm, "port_angle_deg": 5.0}))
    assert got == {"port_angle_deg": 5.0}
    assert packet.carries == ("port_angle_deg",)


def test_north_and_east_at_different_times_are_counted_as_not_sent(tmp_path: Path) -> None:
    """Every other fix lacks its east, one channel is missing altogether, and there is a hole of a second."""
    table = voyage_table(3.0).drop(columns="sway_mps").drop(index=voyage_table(3.0).index[10:20])
    table.iloc[::2, table.columns.get_loc("east_m")] = math.nan  # type: ignore[index]
    trial = Trial(origin_latitude_deg=ORIGIN[0], origin_longitude_deg=ORIGIN[1])
    write_table(table, tmp_path / "holes.mcap", trial)
    (tmp_path / "file.toml").write_text(config_text('type = "file"\npath = "sent.log"\n'))
    played = emulate(tmp_path / "holes.mcap", load_config(tmp_path / "file.toml"), speed=100.0)
    assert played.unsent == {"north_m": 10}
    assert played.counts == {name: 10 if name in ("north_m", "east_m") else 20 for name in table.columns}


def test_a_recording_of_fixes_alone_needs_no_origin(tmp_path: Path) -> None:
    index = pd.DatetimeIndex(["2026-05-17T12:00:00Z", "2026-05-17T12:00:01Z"], name="time")
    table = pd.DataFrame({"latitude_deg": [63.0, 63.1], "longitude_deg": [10.0, 10.1]}, index=index)
    write_table(table, tmp_path / "fixes.mcap", Trial())
    moments = list(iterate_moments(read_recording(tmp_path / "fixes.mcap"), tuple(table.columns), None))
    assert [(each.latitude_deg, each.longitude_deg) for each in moments] == [(63.0, 10.0), (63.1, 10.1)]
    assert moments[0].channels_in_fix == ("latitude_deg", "longitude_deg")


def test_a_gateway_waits_for_the_logger_before_it_plays(
    tmp_path: Path, clock: SimulatedClock, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The wait does not count as delay: nothing is sent in a rush afterwards."""
    monkeypatch.setattr("seatrial.acquisition.emulator.time", clock)
    port = free_port(socket.SOCK_STREAM)
    (tmp_path / "tcp.toml").write_text(config_text(f'type = "tcp"\nport = {port}\n'))
    write_voyage(tmp_path / "voyage.mcap", duration_s=1.0)
    got: list[bytes] = []

    def listen() -> None:
        clock.sleep(30.0)
        with socket.socket() as client:
            wait_for(lambda: client.connect_ex(("127.0.0.1", port)) == 0)  # the gateway is there
            with client.makefile("rb") as lines:
                got.extend(lines)

    thread = threading.Thread(target=listen)
    thread.start()
    played = emulate(tmp_path / "voyage.mcap", load_config(tmp_path / "tcp.toml"), speed=10.0)
    thread.join()
    assert len(got) == played.packets
    assert played.latest_s == pytest.approx(0.0, abs=1e-9)


def test_nobody_comes_to_the_gateway(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("seatrial.acquisition.emulator._WAIT_S", 0.1)
    (tmp_path / "tcp.toml").write_text(config_text(f'type = "tcp"\nport = {free_port(socket.SOCK_STREAM)}\n'))
    write_voyage(tmp_path / "voyage.mcap", duration_s=1.0)
    with pytest.raises(SourceError, match="no logger connected"):
        emulate(tmp_path / "voyage.mcap", load_config(tmp_path / "tcp.toml"))


def test_played_pace_is_that_of_the_recording(
    tmp_path: Path, clock: SimulatedClock, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every moment is sent at its time, four times as fast, also after one that took long to send."""
    monkeypatch.setattr("seatrial.acquisition.emulator.time", clock)
    began_s, sent_s = clock.now_s, list[float]()

    def progress(share: float) -> None:
        sent_s.append(clock.now_s - began_s)
        clock.sleep(0.06 if len(sent_s) == 5 else 0.0)

    write_voyage(tmp_path / "voyage.mcap", duration_s=2.0)
    (tmp_path / "file.toml").write_text(config_text('type = "file"\npath = "sent.log"\n'))
    played = emulate(tmp_path / "voyage.mcap", load_config(tmp_path / "file.toml"), 4.0, progress)
    planned_s = np.arange(20) * 0.1 / 4.0
    late = [5, 6]  # those that were due while the fifth was sent
    assert np.delete(sent_s, late) == pytest.approx(np.delete(planned_s, late))
    assert np.take(sent_s, late) == pytest.approx(planned_s[4] + 0.06)
    assert played.latest_s == pytest.approx(0.06 - 0.025)
    assert played.duration_s == pytest.approx(1.9 / 4.0)


def test_encoding_and_decoding_at_the_same_time_lose_nothing(sources: dict[str, AnySource]) -> None:
    """The CAN library's codec, one a process, raises when two threads meet in it."""
    moment = Moment(START_NS, {"heading_deg": 12.0})
    (*_, packet) = make_encoder(sources["can"]).encode(moment)
    decoder, *_ = make_decoders(sources["can"])
    frame = Frame("line", "can", packet.payload, 0, 0, packet.identifier)
    encoded: list[int] = []

    def encode() -> None:
        encoder = make_encoder(sources["can"])
        encoded.extend(len(encoder.encode(moment)) for _ in range(20_000))

    thread = threading.Thread(target=encode)
    thread.start()
    decoded = sum(len(decoder.decode(frame)) for _ in range(20_000))
    thread.join()
    assert (len(encoded), decoded) == (20_000, 20_000)
