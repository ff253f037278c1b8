"""NMEA 2000: the traps of its framing, what its groups mean, who has which address, whose clock it is."""

from __future__ import annotations

import math
import struct
from math import degrees

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seatrial.acquisition.core.trial import Frame, FrameFlag, Quality
from seatrial.acquisition.protocols.nmea2000 import (
    ERROR_VALUE,
    NOT_AVAILABLE,
    SHORTEST_BYTES,
    Nmea2000Decoder,
    split_can_identifier,
)
from tests.acquisition.can_frames import FIELDS, SECOND, can_frame, fast_parts, gnss, identifier_of, values

HEADING = 0x09F11223  # 127250 from address 35
TRUE_HEADING = "ff10270000ff7ffc"  # 1 rad
SYSTEM_TIME = 0x0DF01023


def decoded(group: int, data: str | bytes) -> dict[str, float]:
    """What one message says, whether it fits into one frame or not."""
    payload = bytes.fromhex(data) if isinstance(data, str) else data
    parts = fast_parts(payload) if group in SHORTEST_BYTES else [payload]
    decoder = Nmea2000Decoder()
    return values([each for part in parts for each in decoder.decode(can_frame(identifier_of(group), part))])


def wind(reference: int) -> bytes:
    """130306: 5.12 m/s from 3.1 rad."""
    return struct.pack("<BHHBH", 255, 512, 31_000, 0xF8 | reference, 0xFFFF)


@pytest.mark.parametrize(
    ("group", "data", "expected"),
    [
        (127245, struct.pack("<BBhhH", 0, 0xF8, 0x7FFF, -1000, 0xFFFF), {"rudder_angle_deg": degrees(-0.1)}),
        (127245, struct.pack("<BBhhH", 0, 0xF8, 0x7FFF, -1, 0xFFFF), {"rudder_angle_deg": degrees(-0.0001)}),
        (127250, TRUE_HEADING, {"heading_deg": degrees(1.0)}),
        (127250, "ff1027ff7fd007fc", {"heading_deg": degrees(1.0), "magnetic_variation_deg": degrees(0.2)}),
        (
            127250,
            "ff1027e803d007fd",
            {"heading_magnetic_deg": degrees(1.1), "magnetic_variation_deg": degrees(0.2)},
        ),
        (127250, "ff102718fcff7ffd", {"heading_magnetic_deg": degrees(0.9)}),
        (127250, "ff10270081ff7ffd", {}),
        # deviation and variation are left out, and filled with ones; of a rudder this is minus one step
        (127250, "ff1027fffffffffd", {"heading_magnetic_deg": degrees(1.0)}),
        (127250, "ff102718fcff7ffe", {}),
        (127250, "ff102718fcff7fff", {}),
        (127251, struct.pack("<Bi", 0, -3_200_000) + b"\xff" * 3, {"yaw_rate_dps": degrees(-0.1)}),
        (
            127257,
            struct.pack("<BhhhB", 0, 500, 1000, -2000, 255),
            {"roll_deg": degrees(-0.2), "pitch_deg": degrees(0.1)},
        ),
        (127258, struct.pack("<BBHhH", 0, 0xF7, 18_000, -3000, 0xFFFF), {"magnetic_variation_deg": degrees(-0.3)}),
        (128259, struct.pack("<BHHBBB", 0, 512, 700, 0, 255, 255), {"speed_through_water_mps": 5.12}),
        (129025, struct.pack("<ii", 634_000_000, -104_000_000), {"latitude_deg": 63.4, "longitude_deg": -10.4}),
        (129025, struct.pack("<ii", 634_000_000, 0x7FFFFFFF), {}),
        (
            129026,
            struct.pack("<BBHHH", 0, 0xFC, 31_000, 512, 0xFFFF),
            {"course_over_ground_deg": degrees(3.1), "speed_over_ground_mps": 5.12},
        ),
        (
            129026,
            struct.pack("<BBHHH", 0, 0xFD, 31_000, 512, 0xFFFF),
            {"course_magnetic_deg": degrees(3.1), "speed_over_ground_mps": 5.12},
        ),
        (129026, struct.pack("<BBHHH", 0, 0xFE, 31_000, 512, 0xFFFF), {"speed_over_ground_mps": 5.12}),
        (129026, struct.pack("<BBHHH", 0, 0xFF, 31_000, 512, 0xFFFF), {"speed_over_ground_mps": 5.12}),
        (130306, wind(0), {"wind_direction_deg": degrees(3.1), "wind_speed_mps": 5.12}),
        (130306, wind(1), {"wind_direction_magnetic_deg": degrees(3.1), "wind_speed_mps": 5.12}),
        (130306, wind(2), {"wind_angle_apparent_deg": degrees(3.1), "wind_speed_apparent_mps": 5.12}),
        (130306, wind(3), {"wind_angle_theoretical_deg": degrees(3.1), "wind_speed_theoretical_mps": 5.12}),
        (130306, wind(4), {"wind_angle_water_deg": degrees(3.1), "wind_speed_water_mps": 5.12}),
        (130306, wind(5), {}),
        (130306, wind(6), {}),
        (130306, wind(7), {}),
        (
            130577,
            struct.pack("<BBHHHHHH", 0xC0, 1, 31_000, 512, 1, 2, 3, 4),
            {"course_over_ground_deg": degrees(3.1), "speed_over_ground_mps": 5.12},
        ),
        (
            130578,
            struct.pack("<hhhhhh", 1500, 0x7FFF, -1234, 500, 0x7FFF, 0x7FFF),
            {"surge_mps": -1.234, "sway_mps": 0.5, "speed_through_water_mps": 1.5},
        ),
        (130578, struct.pack("<hhhh", 0x7FFF, 0x7FFF, -1234, 500), {"surge_mps": -1.234, "sway_mps": 0.5}),
    ],
)
def test_what_a_group_means(group: int, data: str | bytes, expected: dict[str, float]) -> None:
    assert decoded(group, data) == pytest.approx(expected)


def test_winds_are_told_apart_in_their_source() -> None:
    sources = []
    for reference in range(5):
        (group,) = Nmea2000Decoder().decode(can_frame(identifier_of(130306), wind(reference)))
        sources.append(group[0].source)
    meanings = ["", " magnetic", " apparent", " theoretical", " water"]
    assert sources == [f"bus/35:130306{meaning}" for meaning in meanings]


@pytest.mark.parametrize(
    ("method", "quality"),
    [
        *((method, None) for method in (0, 14)),
        *((method, Quality.NOT_EVALUATED) for method in range(1, 6)),
        *((method, Quality.SUSPECT) for method in (6, 7, 8, 9, 15)),
    ],
)
def test_a_position_is_as_good_as_its_method(method: int, quality: Quality | None) -> None:
    decoder, found = Nmea2000Decoder(), []
    for part in fast_parts(gnss(method)):
        found += [sample for group in decoder.decode(can_frame(identifier_of(129029), part)) for sample in group]
    assert [sample.quality for sample in found] == ([] if quality is None else [quality] * 2)
    assert decoder.refused["no fix"] == (quality is None)


def test_the_rudder_with_the_lowest_number_is_the_rudder() -> None:
    decoder, sources = Nmea2000Decoder(), []
    for instance in (1, 2, 1, 0, 1, 0):
        data = struct.pack("<BBhhH", instance, 0xF8, 0x7FFF, 100 * instance, 0xFFFF)
        sources += [group[0].source for group in decoder.decode(can_frame(identifier_of(127245), data))]
    assert sources == ["bus/35:127245 rudder 1"] * 2 + ["bus/35:127245"] * 2
    assert decoder.refused["another instance"] == 2


@pytest.mark.parametrize(
    ("data", "flags"),
    [
        (TRUE_HEADING, FrameFlag.REMOTE),
        (TRUE_HEADING, FrameFlag.ERROR),
        (TRUE_HEADING, FrameFlag.STANDARD_ID),
        (TRUE_HEADING + "00", FrameFlag.NONE),
        ("ff1027", FrameFlag.NONE),
        ("", FrameFlag.NONE),
    ],
)
def test_guards_refuse_and_count(data: str, flags: FrameFlag) -> None:
    decoder = Nmea2000Decoder()
    assert decoder.decode(can_frame(HEADING, data, flags=flags)) == []
    assert decoder.refused.total() == 1


@pytest.mark.parametrize(
    ("raw", "reason"), [(0xFFFF, NOT_AVAILABLE), (0xFFFE, ERROR_VALUE), (0xFFFD, ERROR_VALUE), (0xFFFC, None)]
)
def test_the_three_highest_raw_values_are_no_values(raw: int, reason: str | None) -> None:
    decoder = Nmea2000Decoder()
    decoder.decode(can_frame(HEADING, struct.pack("<BHhhB", 255, raw, 0, 0x7FFF, 0xFC)))
    assert decoder.refused == ({reason: 1} if reason else {})


def test_parameter_group_of_addressed_and_broadcast_identifiers() -> None:
    assert split_can_identifier(0x18EEFF05) == (60928, 5)
    assert split_can_identifier(0x18EE2305) == (60928, 5)
    assert split_can_identifier(0x09F80123) == (129025, 35)
    assert split_can_identifier(0x0BF80123) == (129025 + 0x20000, 35)  # the extended data page is another group
    assert split_can_identifier(0x08F80123) == (129025 - 0x10000, 35)


@given(
    st.lists(st.tuples(st.sampled_from([*FIELDS, 60928, 61184]), st.binary(min_size=8, max_size=8)), max_size=30)
)
@settings(max_examples=300)
def test_no_frame_raises_and_every_value_is_finite(frames: list[tuple[int, bytes]]) -> None:
    decoder = Nmea2000Decoder("source")
    for place, (group, data) in enumerate(frames):
        found = values(decoder.decode(can_frame(identifier_of(group, data[0] % 2), data, 0.1 * place)))
        assert all(math.isfinite(value) for value in found.values())


@given(st.integers(0, 2**29 - 1), st.binary(max_size=64), st.integers(0, 7))
def test_no_identifier_length_or_flag_raises(identifier: int, data: bytes, flags: int) -> None:
    Nmea2000Decoder().decode(Frame("bus", "can", data, 0, 0, identifier, FrameFlag(flags)))


def test_system_time_stamps_what_follows() -> None:
    decoder = Nmea2000Decoder("source")
    decoder.decode(can_frame(SYSTEM_TIME, "01f02a51d22e7515", 100.0))  # 2026-11-21 10:00:00.1234
    (sample,) = decoder.decode(can_frame(HEADING, TRUE_HEADING, 100.25))[0]
    assert sample.measured_ns == 1_795_255_200_123_400_000 + SECOND // 4
    assert sample.received_ns == 100.25 * SECOND
    (late,) = decoder.decode(can_frame(HEADING, TRUE_HEADING, 200.0))[0]
    assert late.clock == "receiver"


def test_time_and_date_is_a_clock_too() -> None:
    decoder = Nmea2000Decoder("source")
    decoder.decode(can_frame(identifier_of(129033), "2a51d22e75153c00", 100.0))
    (sample,) = decoder.decode(can_frame(HEADING, TRUE_HEADING, 100.25))[0]
    assert (sample.measured_ns, sample.clock) == (1_795_255_200_123_400_000 + SECOND // 4, "nmea2000 129033")


def test_one_device_is_the_clock_of_a_bus() -> None:
    """A second device's time, 13 h later, is taken only when the first has been silent."""
    decoder = Nmea2000Decoder("source")
    decoder.decode(can_frame(SYSTEM_TIME, "01f02a51d22e7515", 100.0))
    decoder.decode(can_frame(SYSTEM_TIME + 1, "01f02a51d2000000", 100.1))
    (sample,) = decoder.decode(can_frame(HEADING, TRUE_HEADING, 100.25))[0]
    assert sample.measured_ns == 1_795_255_200_123_400_000 + SECOND // 4
    decoder.decode(can_frame(SYSTEM_TIME + 1, "01f02a51d2000000", 110.0))
    (sample,) = decoder.decode(can_frame(HEADING, TRUE_HEADING, 110.0))[0]
    assert sample.clock == "nmea2000 126992"
    assert sample.measured_ns < 1_795_255_200_000_000_000


def test_system_time_beyond_a_day_is_not_believed() -> None:
    decoder = Nmea2000Decoder("source")
    decoder.decode(can_frame(SYSTEM_TIME, "01f02a5100f0ff7f", 100.0))
    (sample,) = decoder.decode(can_frame(HEADING, TRUE_HEADING, 100.25))[0]
    assert sample.clock == "receiver"


@pytest.mark.parametrize(
    ("method", "quality"), [(0, Quality.SUSPECT), (6, Quality.SUSPECT), (1, Quality.NOT_EVALUATED)]
)
def test_a_rapid_position_without_a_fix_repeats_an_old_one(method: int, quality: Quality) -> None:
    decoder = Nmea2000Decoder()
    for part in fast_parts(gnss(method)):
        decoder.decode(can_frame(identifier_of(129029), part))
    (rapid,) = decoder.decode(can_frame(identifier_of(129025), struct.pack("<ii", 634_000_000, 104_000_000)))
    assert {sample.quality for sample in rapid} == {quality}
    (other,) = decoder.decode(can_frame(identifier_of(129025, 7), struct.pack("<ii", 634_000_000, 104_000_000)))
    assert {sample.quality for sample in other} == {Quality.NOT_EVALUATED}
