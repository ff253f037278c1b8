"""MAVLink: what each message means, whom we listen to, and that damage costs no more than itself."""

from __future__ import annotations

import random
import socket
import threading
from collections.abc import Iterable
from math import cos, inf, nan, radians, sin
from pathlib import Path
from typing import Any

import pymap3d
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v10 import ardupilotmega as dialect_1
from pymavlink.dialects.v20 import ardupilotmega as dialect

from acquisition.decoders.mavlink import MavlinkDecoder
from acquisition.decoders.mavlink_packets import LONGEST_BYTES, Fault, PacketCutter, checksum, is_sound
from acquisition.errors import ConfigurationError, SourceError
from acquisition.frames import Frame, Sample
from acquisition.null_modem import NullModem
from acquisition.sections import MavlinkSerialSource, MavlinkSource, MavlinkTcpSource
from acquisition.sources import Source, make_source
from acquisition.units import DEG_PER_RAD
from tests.acquisition.conftest import free_port

SECOND = 1_000_000_000
UTC_US = 1_795_255_200_000_000
M = dialect.MAVLink(None)  # only encodes


def decoder(**section: Any) -> MavlinkDecoder:
    return MavlinkDecoder(MavlinkSource(name="link", type="mavlink", port=1, channels=(), **section))


def packed(message: Any, system: int = 1, component: int = 1) -> bytes:
    return bytes(message.pack(dialect.MAVLink(None, srcSystem=system, srcComponent=component)))


def frame(payload: bytes, at_s: float = 1.0) -> Frame:
    return Frame("link", "mavlink", payload, round(at_s * SECOND), round(at_s * SECOND))


def sent(to: MavlinkDecoder, message: Any, at_s: float = 1.0, system: int = 1, component: int = 1) -> list[Sample]:
    """The samples of one message in a datagram of its own."""
    groups = to.decode(frame(packed(message, system, component), at_s))
    return [sample for group in groups for sample in group]


def values(samples: Iterable[Sample]) -> dict[str, float]:
    return {sample.quantity: sample.value for sample in samples}


def attitude(yaw_rad: float = 1.0, boot_ms: int = 0) -> Any:
    return M.attitude_encode(boot_ms, 0.1, -0.2, yaw_rad, 0.0, 0.0, 0.01)


def satellites(fix_type: int, latitude: int, longitude: int, speed: int, course: int) -> Any:
    return M.gps_raw_int_encode(0, fix_type, latitude, longitude, 0, 0, 0, speed, course, 9)


@pytest.mark.parametrize(
    ("message", "expected", "refused"),
    [
        (
            attitude(-1.0),
            {"heading_deg": -57.29578, "yaw_rate_dps": 0.5729578, "roll_deg": 5.729578, "pitch_deg": -11.459156},
            {},
        ),
        (
            M.global_position_int_encode(0, 634_400_000, -104_000_000, 0, 0, 150, -20, 0, 35_999),
            {
                "latitude_deg": 63.44,
                "longitude_deg": -10.4,
                "velocity_north_mps": 1.5,
                "velocity_east_mps": -0.2,
                "heading_deg": 359.99,
            },
            {},
        ),
        (
            M.global_position_int_encode(0, 0, 0, 0, 0, 150, 0, 0, 65_535),
            {"velocity_north_mps": 1.5, "velocity_east_mps": 0.0},
            {"not available": 3},
        ),
        (
            satellites(3, 634_400_000, 104_000_000, 512, 27_000),
            {
                "latitude_deg": 63.44,
                "longitude_deg": 10.4,
                "speed_over_ground_mps": 5.12,
                "course_over_ground_deg": 270.0,
            },
            {},
        ),
        (
            satellites(6, 634_400_000, 104_000_000, 65_535, 65_535),
            {"latitude_deg": 63.44, "longitude_deg": 10.4},
            {"not available": 2},
        ),
        (satellites(2, 634_400_000, 104_000_000, 512, 27_000), {}, {"no fix": 1}),
        (
            M.local_position_ned_encode(0, 1.0, 2.0, 3.0, 0.5, -0.25, 0.0),
            {"velocity_north_mps": 0.5, "velocity_east_mps": -0.25},
            {},
        ),
        (M.wind_encode(-90.0, 7.5, 0.0), {"wind_direction_deg": -90.0, "wind_speed_mps": 7.5}, {}),
        (M.rpm_encode(-100.5, nan), {"port_rpm": -100.5}, {"not available": 1}),
        (M.raw_rpm_encode(0, 120.0), {"port_rpm": 120.0}, {}),
        (M.raw_rpm_encode(1, -90.0), {"starboard_rpm": -90.0}, {}),
        (M.raw_rpm_encode(2, -90.0), {}, {}),
        (M.named_value_float_encode(0, b"tunnel_rpm", 33.0), {"tunnel_rpm": 33.0}, {}),
        (M.named_value_float_encode(0, b"nobody's", 33.0), {}, {}),
        (M.wind_encode(10.0, inf, 0.0), {"wind_direction_deg": 10.0}, {"impossible value": 1}),
        (M.wind_encode(1e9, 3.0, 0.0), {"wind_speed_mps": 3.0}, {"impossible value": 1}),
        (M.wind_cov_encode(0, nan, 2.0, 0, 0, 0, 0, 0, 0), {}, {"not available": 1}),
        (M.servo_output_raw_encode(0, 0, *[1500] * 8), {}, {}),
        (M.vfr_hud_encode(5.0, 5.0, 90, 50, 0.0, 0.0), {}, {}),
        (M.esc_telemetry_1_to_4_encode(b"\0" * 4, *[[900] * 4] * 5), {}, {}),
    ],
)
def test_what_each_message_says(message: Any, expected: dict[str, float], refused: dict[str, int]) -> None:
    """Units of the message definitions; what is not known is missing and counted, an order is no measurement."""
    listener = decoder()
    samples = sent(listener, message)
    assert values(samples) == pytest.approx(expected, rel=1e-6)
    assert listener.refused == refused
    assert all(sample.source == f"link/1:{message.get_type()}" for sample in samples)


@given(st.floats(0, 359.99), st.floats(0.1, 80))
def test_a_wind_vector_points_to_where_the_wind_blows(from_deg: float, speed_mps: float) -> None:
    north, east = (-speed_mps * ratio for ratio in (cos(radians(from_deg)), sin(radians(from_deg))))
    got = values(sent(decoder(), M.wind_cov_encode(0, north, east, 0, 0, 0, 0, 0, 0)))
    assert got["wind_speed_mps"] == pytest.approx(speed_mps, rel=1e-6)
    assert (got["wind_direction_deg"] - from_deg + 180) % 360 - 180 == pytest.approx(0, abs=1e-4)


def test_a_calm_has_no_direction() -> None:
    assert values(sent(decoder(), M.wind_cov_encode(0, *[0.0] * 8))) == {"wind_speed_mps": 0.0}


@given(st.floats(-9000, 9000), st.floats(-9000, 9000), st.floats(-70, -1), st.floats(-179, 179))
@settings(max_examples=50)
def test_a_local_position_becomes_a_fix(
    north_m: float, east_m: float, latitude_deg: float, longitude_deg: float
) -> None:
    """Back on the autopilot's plane it is where it was, to the centimetre that height may cost at 10 km."""
    listener = decoder()
    origin = round(latitude_deg * 1e7), round(longitude_deg * 1e7)
    sent(listener, M.gps_global_origin_encode(*origin, 50_000))
    got = sent(listener, M.local_position_ned_encode(0, north_m, east_m, 1.0, 0.5, 0.25, 0))
    assert {each.source for each in got} == {"link/1:LOCAL_POSITION_NED", "link/1:GPS_GLOBAL_ORIGIN"}
    fix = values(got)
    back = pymap3d.geodetic2ned(
        fix["latitude_deg"], fix["longitude_deg"], 0.0, *(each / 1e7 for each in origin), 0.0
    )
    assert back[:2] == pytest.approx((north_m, east_m), abs=0.02)


def test_an_impossible_origin_gives_no_fix() -> None:
    listener = decoder()
    sent(listener, M.gps_global_origin_encode(2**31 - 1, 0, 0))
    got = sent(listener, M.local_position_ned_encode(0, 1.0, 2.0, 0, 0.5, 0.25, 0))
    assert set(values(got)) == {"velocity_north_mps", "velocity_east_mps"}


def test_only_the_configured_system_component_and_messages() -> None:
    listener = decoder(component_id=1, messages=("ATTITUDE",))
    assert sent(listener, attitude()) != []
    assert sent(listener, attitude(), system=2) == []
    assert sent(listener, attitude(), component=200) == []
    assert sent(listener, M.rpm_encode(1.0, 2.0)) == []
    assert sent(listener, M.heartbeat_encode(1, 3, 0, 0, 0)) == []  # nobody reads it, with or without a list
    assert listener.refused == {"another system": 1, "another component": 1, "message not wanted": 1}


def test_a_message_that_nobody_reads_cannot_be_asked_for() -> None:
    with pytest.raises(ConfigurationError, match=r"'link'.*'SERVO_OUTPUT_RAW'.*choose of ATTITUDE"):
        decoder(messages=("SERVO_OUTPUT_RAW",))


def unknown(length: int = 20) -> bytes:
    """A packet of a message that no dialect of ours has; its checksum cannot be checked."""
    return bytes([0xFD, length, 0, 0, 7, 1, 1]) + (0xABCDEF).to_bytes(3, "little") + bytes(length + 2)


def test_unknown_messages_are_counted_and_never_used() -> None:
    listener = decoder()
    groups = listener.decode(frame(packed(attitude(1.0)) + unknown() + packed(attitude(2.0))))
    assert len(groups) == 2
    assert listener.refused == {"unknown message": 1}


def signed(message: Any) -> bytes:
    link = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    link.signing.secret_key, link.signing.sign_outgoing = b"k" * 32, True
    return bytes(message.pack(link))


def test_both_versions_and_signed_packets() -> None:
    link_1 = dialect_1.MAVLink(None, srcSystem=1, srcComponent=1)
    version_1 = bytes(link_1.attitude_encode(0, 0, 0, 1.0, 0, 0, 0).pack(link_1))
    assert version_1[0] == 0xFE
    assert len(signed(attitude())) == len(packed(attitude())) + 13
    listener = decoder()
    groups = listener.decode(frame(version_1 + packed(attitude()) + signed(attitude()) + version_1))
    assert [group[0].value for group in groups] == pytest.approx([DEG_PER_RAD] * 4)
    assert not listener.refused


def test_a_flag_that_we_do_not_know_makes_a_packet_unreadable() -> None:
    packet = bytearray(packed(attitude()))
    packet[2] = 2
    packet[-2:] = checksum(bytes(packet[1:-2]) + b"\x27").to_bytes(2, "little")  # 39 belongs to ATTITUDE
    listener = decoder()
    assert listener.decode(frame(bytes(packet))) == []
    assert listener.refused["bad data"] == 1


# ---- time


def test_a_restarted_autopilot_is_not_stamped_with_its_former_life() -> None:
    """time_boot_ms falls back to zero; until SYSTEM_TIME comes again nobody knows what its clock says."""
    listener = decoder(clock="source")
    sent(listener, M.system_time_encode(UTC_US, 3_600_000), 100.0)
    before, *_ = sent(listener, attitude(boot_ms=3_600_100), 100.1)
    assert not listener.notices
    after, *_ = sent(listener, attitude(boot_ms=2_000), 102.0)
    assert [*listener.notices] == [("warning", "the autopilot has restarted after 3600 s")]
    sent(listener, M.system_time_encode(UTC_US + 3_000_000, 3_000), 103.0)
    again, *_ = sent(listener, attitude(boot_ms=3_100), 103.1)
    assert before.measured_ns == UTC_US * 1000 + SECOND // 10
    assert (after.source_ns, after.clock, after.measured_ns) == (None, "receiver", 102 * SECOND)
    assert again.measured_ns == UTC_US * 1000 + 3 * SECOND + SECOND // 10
    assert len(listener.notices) == 1


def test_after_49_days_the_time_since_boot_begins_anew_without_a_restart() -> None:
    listener = decoder()
    for boot_ms in (2**32 - 50, 50):
        sent(listener, attitude(boot_ms=boot_ms))
    assert not listener.notices


@pytest.mark.parametrize("utc_us", [0, 2**64 - 1, 10**15])
def test_an_autopilot_that_does_not_know_the_time(utc_us: int) -> None:
    listener = decoder(clock="source")
    sent(listener, M.system_time_encode(utc_us, 1000), 10.0)
    sample, *_ = sent(listener, attitude(boot_ms=1100), 10.1)
    assert (sample.source_ns, sample.measured_ns) == (None, 10.1 * SECOND)


@pytest.mark.parametrize("time_usec", [UTC_US + 250_000, 5_250_000])
def test_satellite_fixes_count_from_1970_or_from_the_start(time_usec: int) -> None:
    listener = decoder(clock="source")
    sent(listener, M.system_time_encode(UTC_US, 5_000), 10.0)
    fix = M.gps_raw_int_encode(time_usec, 3, 634_400_000, 104_000_000, 0, 0, 0, 0, 0, 9)
    sample, *_ = sent(listener, fix, 11.0)
    assert sample.measured_ns == UTC_US * 1000 + SECOND // 4


# ---- damage


def stream(count: int, seed: int) -> list[bytes]:
    """Packets of several messages, lengths and versions; every value is one that can be recognised."""
    generator = random.Random(seed)
    makers = [
        lambda each: packed(attitude(each / 1000)),
        lambda each: signed(attitude(each / 1000)),
        lambda each: packed(M.rpm_encode(each, -each)),
        lambda each: packed(M.statustext_encode(6, bytes(generator.choices(b"\xfd\xfe\x00\x1e", k=50)))),
        lambda each: unknown(generator.randrange(60)),
    ]
    return [generator.choice(makers)(each) for each in range(1, count + 1)]


def good(data: Iterable[bytes]) -> list[bytes]:
    """What a cutter makes of pieces of a stream, without the faults."""
    cutter = PacketCutter(whole=False)
    return [piece for received in data for piece in cutter.push(received) if not isinstance(piece, Fault)]


@pytest.mark.parametrize("seed", range(5))
def test_damage_costs_no_more_than_itself(seed: int) -> None:
    """100 flipped bits, bytes lost and bytes added: what was left alone all comes, and nothing else."""
    generator, packets = random.Random(seed), stream(500, seed)
    damaged = {generator.randrange(len(packets)) for _ in range(100)}
    pieces = list(packets)
    for number in damaged:
        broken = bytearray(packets[number])
        at = generator.randrange(len(broken))
        match generator.randrange(3):
            case 0:
                broken[at] ^= 1 << generator.randrange(8)
            case 1:
                del broken[at : at + generator.randrange(1, 9)]
            case _:
                broken[at:at] = generator.randbytes(generator.randrange(1, 9))
        pieces[number] = bytes(broken)
    untouched = [each for number, each in enumerate(packets) if number not in damaged and is_sound(each)]
    known = {_signed_part(each) for each in packets if is_sound(each)}  # a signature's damage is not to be seen
    got = good([b"".join(pieces) + bytes(2 * LONGEST_BYTES)])
    assert [each for each in got if each in set(untouched)] == untouched
    assert all(_signed_part(each) in known for each in got)


def _signed_part(packet: bytes) -> bytes:
    """A packet without its signature, if it has one."""
    return packet[:-13] if packet[0] == 0xFD and packet[2] else packet


@given(st.lists(st.integers(0, 60), min_size=1, max_size=200), st.integers(0, 20))
@settings(max_examples=60)
def test_it_does_not_matter_how_a_stream_is_cut(lengths: list[int], seed: int) -> None:
    data = b"".join(stream(30, seed))
    data = b"\xfd\xff\x00" + data[:15] + data[18:] + bytes(2 * LONGEST_BYTES)
    cuts = [sum(lengths[:count]) for count in range(len(lengths) + 1)]
    pieces = [data[a:b] for a, b in zip(cuts, [*cuts[1:], len(data)], strict=True)]
    assert good(pieces) == good([data])


def test_a_cut_off_datagram_does_not_hold_back_the_next() -> None:
    listener = decoder()
    assert listener.decode(frame(packed(attitude())[:20], 1.0)) == []
    (sample, *_), *_ = listener.decode(frame(packed(attitude()), 2.0))
    assert sample.received_ns == 2 * SECOND
    assert listener.refused == {"bad data": 1}


@pytest.mark.parametrize("rubbish", [b"\xfd", b"\xfe", b"\xfd\xff\x01", b"\xfe\xff", b"\x00", b"\xfe\x09\x1e"])
def test_endless_rubbish_needs_no_memory(rubbish: bytes) -> None:
    cutter = PacketCutter(whole=False)
    for _ in range(100):
        cutter.push(rubbish * 100)
        assert len(cutter._pending) <= 2 * LONGEST_BYTES


@given(st.lists(st.binary(max_size=300), max_size=4))
def test_no_bytes_raise_or_wait_for_ever(pieces: list[bytes]) -> None:
    listener = decoder()
    for piece in pieces:
        listener.decode(frame(piece))
    groups = listener.decode(frame(packed(attitude()) + bytes(2 * LONGEST_BYTES)))
    assert len(groups) == 1


@given(st.binary(max_size=100))
def test_the_checksum_is_pymavlinks(data: bytes) -> None:
    assert checksum(data) == dialect.x25crc(data).crc


# ---- links


def collected(source: Source, size: int) -> bytes:
    """What comes from an open source until it is ``size`` bytes."""
    payload = b""
    while len(payload) < size:
        payload += b"".join(each.payload for each in source.read(5.0) or [])
    return payload


def test_tcp_bytes_arrive_and_a_closed_connection_is_opened_again() -> None:
    port = free_port(socket.SOCK_STREAM)
    parts = [b"".join(stream(40, seed)) for seed in (1, 2)]
    source = make_source(MavlinkTcpSource(name="link", type="mavlink_tcp", port=port, channels=()))
    with pytest.raises(SourceError, match="does not answer"):
        source.open()
    with socket.create_server(("127.0.0.1", port)) as server:

        def serve() -> None:
            for part in parts:
                connection, _ = server.accept()
                with connection:
                    connection.sendall(part)

        thread = threading.Thread(target=serve)
        thread.start()
        for part in parts:
            source.open()
            assert collected(source, len(part)) == part
            with pytest.raises(SourceError, match="closed the connection"):
                collected(source, 1)
            source.close()
        thread.join()
    with pytest.raises(SourceError, match="is not open"):
        source.read(0.1)


def test_serial_bytes_arrive(null_modem: NullModem) -> None:
    data = b"".join(stream(100, 3))
    config = MavlinkSerialSource(name="link", type="mavlink_serial", device=null_modem.logger_device, channels=())
    source = make_source(config)
    source.open()
    with Path(null_modem.emulator_device).open("wb", buffering=0) as device:
        device.write(data)
        assert collected(source, len(data)) == data
    source.close()
    with pytest.raises(SourceError, match="is not open"):
        source.read(0.1)
