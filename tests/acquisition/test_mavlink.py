"""MAVLink: what each message means, whom we listen to, what its times are, and the links it comes by."""

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
from pymavlink.dialects.v20 import ardupilotmega as dialect

from seatrial.acquisition.config.sources import MavlinkSerialSource, MavlinkSource, MavlinkTcpSource
from seatrial.acquisition.core.errors import ConfigurationError, SourceError
from seatrial.acquisition.core.trial import Fix, Frame, Sample
from seatrial.acquisition.emulator import NullModem
from seatrial.acquisition.protocols.mavlink import MavlinkDecoder
from seatrial.acquisition.sources import Source, make_source
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
        (M.rpm_encode(-100.0, -1.0), {"port_rpm": -100.0}, {"not available": 1}),
        (M.rpm_encode(-1.0, -1.0), {}, {"not available": 2}),
        (M.rpm_encode(-1.5, -0.5), {"port_rpm": -1.5, "starboard_rpm": -0.5}, {}),
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


def test_companion_moves_neither_the_origin_nor_the_clock_of_its_autopilot() -> None:
    """Its origin had moved the autopilot's local positions; its clock, which may be unset, had been announced."""
    listener, utc_us = decoder(), 1_779_019_200_000_000
    sent(listener, M.system_time_encode(utc_us, 1000))
    sent(listener, M.gps_global_origin_encode(634_400_000, 104_000_000, 0))
    sent(listener, M.gps_global_origin_encode(600_000_000, 50_000_000, 0), component=191)
    sent(listener, M.system_time_encode(utc_us + 3_600_000_000, 1000), component=191)
    local = M.local_position_ned_encode(1000, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0)
    samples = sent(listener, local), sent(listener, local, component=191)
    assert [values(each)["latitude_deg"] for each in samples] == pytest.approx([63.44, 60.0])
    assert not [text for _, text in listener.notices if "was set" in text]


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
    assert listener.refused == {"impossible value": 1}


def test_a_local_position_that_cannot_be_is_counted() -> None:
    listener = decoder()
    sent(listener, M.gps_global_origin_encode(634_400_000, 104_000_000, 0))
    got = sent(listener, M.local_position_ned_encode(0, nan, 2.0, 0, 0.5, 0.25, 0))
    assert set(values(got)) == {"velocity_north_mps", "velocity_east_mps"}
    assert listener.refused == {"impossible value": 1}


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


# ---- time


def test_a_restarted_autopilot_is_not_stamped_with_its_former_life() -> None:
    """time_boot_ms falls back to zero; until SYSTEM_TIME comes again nobody knows what its clock says."""
    listener = decoder(clock="source")
    sent(listener, M.system_time_encode(UTC_US, 3_600_000), 100.0)
    before, *_ = sent(listener, attitude(boot_ms=3_600_100), 100.1)
    listener.notices.clear()  # how far its clock is from ours
    after, *_ = sent(listener, attitude(boot_ms=2_000), 102.0)
    assert [*listener.notices] == [("warning", "the autopilot has restarted after 3600 s")]
    sent(listener, M.system_time_encode(UTC_US + 3_000_000, 3_000), 103.0)
    again, *_ = sent(listener, attitude(boot_ms=3_100), 103.1)
    assert before.measured_ns == UTC_US * 1000 + SECOND // 10
    assert (after.source_ns, after.clock, after.measured_ns) == (None, "receiver", 102 * SECOND)
    assert again.measured_ns == UTC_US * 1000 + 3 * SECOND + SECOND // 10
    assert len(listener.notices) == 1


def test_two_autopilots_of_one_number_are_not_told_of_without_end() -> None:
    listener = decoder()
    for number in range(100):
        sent(listener, attitude(boot_ms=3_600_000 * (number % 2)), at_s=number / 10)
    assert len(listener.notices) == 1


def test_a_fix_of_a_restarted_autopilot_that_comes_first_is_not_of_its_former_life() -> None:
    """Its time in microseconds since boot comes before any in milliseconds, which show that it has restarted."""
    listener = decoder(clock="source")
    sent(listener, M.system_time_encode(UTC_US, 3_600_000), at_s=1.0)
    fix = [
        M.gps_raw_int_encode(us, 3, 634_400_000, 104_000_000, 0, 0, 0, 512, 27_000, 9) for us in (3_599_500_000, 9)
    ]
    before, after = (sent(listener, message, at_s=at_s) for message, at_s in zip(fix, (1.2, 21.0), strict=True))
    assert {sample.measured_ns for sample in before} == {UTC_US * 1000 - 500_000_000}
    assert {(sample.measured_ns, sample.source_ns) for sample in after} == {(21 * SECOND, None)}


def test_after_49_days_the_time_since_boot_begins_anew_without_a_restart() -> None:
    listener = decoder()
    for boot_ms in (2**32 - 50, 50):
        sent(listener, attitude(boot_ms=boot_ms))
    listener.notices.clear()  # how far its clock is from ours


@pytest.mark.parametrize("utc_us", [0, 2**64 - 1, 10**15])
def test_an_autopilot_that_does_not_know_the_time(utc_us: int) -> None:
    listener = decoder(clock="source")
    sent(listener, M.system_time_encode(utc_us, 1000), 10.0)
    sample, *_ = sent(listener, attitude(boot_ms=1100), 10.1)
    assert (sample.source_ns, sample.measured_ns) == (None, 10.1 * SECOND)


@pytest.mark.parametrize(
    ("time_usec", "late_s"),
    [(UTC_US + 250_000, 0.25), (5_250_000, 0.25), (0, 1.0)],
    ids=["1970", "boot", "unknown"],
)
def test_satellite_fixes_count_from_1970_or_from_the_start(time_usec: int, late_s: float) -> None:
    listener = decoder(clock="source")
    sent(listener, M.system_time_encode(UTC_US, 5_000), 10.0)
    fix = M.gps_raw_int_encode(time_usec, 3, 634_400_000, 104_000_000, 0, 0, 0, 0, 0, 9)
    sample, *_ = sent(listener, fix, 11.0)
    assert sample.measured_ns == UTC_US * 1000 + round(late_s * SECOND)


# ---- links


def collected(source: Source, size: int) -> bytes:
    """What comes from an open source until it is ``size`` bytes."""
    payload = b""
    while len(payload) < size:
        payload += b"".join(each.payload for each in source.read(5.0) or [])
    return payload


def test_tcp_bytes_arrive_and_a_closed_connection_is_opened_again() -> None:
    port = free_port(socket.SOCK_STREAM)
    parts = [random.Random(seed).randbytes(5000) for seed in (1, 2)]
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
    data = random.Random(1).randbytes(5000)
    config = MavlinkSerialSource(name="link", type="mavlink_serial", device=null_modem.logger_device, channels=())
    source = make_source(config)
    source.open()
    with Path(null_modem.emulator_device).open("wb", buffering=0) as device:
        device.write(data)
        assert collected(source, len(data)) == data
    source.close()
    with pytest.raises(SourceError, match="is not open"):
        source.read(0.1)


def test_height_and_errors_of_a_fix_are_known_as_far_as_they_are_told() -> None:
    told = M.gps_raw_int_encode(0, 3, 634_400_000, 104_000_000, 12_500, 0, 0, 0, 0, 9, 52_500, 300, 500, 0, 0)
    bare = M.gps_raw_int_encode(0, 3, 634_400_000, 104_000_000, 12_500, 0, 0, 0, 0, 9)
    for message, fix in ((told, Fix(1, 52.5, (0.3, 0.3, 0.5))), (bare, Fix(1, 12.5, None))):
        ours = decoder()
        sent(ours, message)
        assert list(ours.fixes.values()) == [fix]


@pytest.mark.parametrize("component", [1, 191, 240])
def test_each_component_of_a_system_is_a_source_of_its_own(component: int) -> None:
    link = decoder()
    autopilot = {sample.source for sample in sent(link, attitude())}
    companion = {sample.source for sample in sent(link, attitude(), component=component)}
    assert autopilot == {"link/1:ATTITUDE"}
    assert companion == ({"link/1:ATTITUDE"} if component == 1 else {f"link/1.{component}:ATTITUDE"})
