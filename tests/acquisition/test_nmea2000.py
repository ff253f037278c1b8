"""NMEA 2000: the traps of its framing, what its groups mean, who has which address, whose clock it is."""

from __future__ import annotations

import math
import struct
from collections import Counter
from math import degrees

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from acquisition.decoders.fast_packets import INCOMPLETE
from acquisition.decoders.nmea2000 import Nmea2000Decoder, parameter_group
from acquisition.decoders.parameter_groups import ERROR_VALUE, GROUPS, NOT_AVAILABLE
from acquisition.frames import Frame, FrameFlag, Quality
from acquisition.sections import Device
from tests.acquisition.can_frames import SECOND, can_frame, fast_parts, identifier_of, values

HEADING = 0x09F11223  # 127250 from address 35
TRUE_HEADING = "ff10270000ff7ffc"  # 1 rad
SYSTEM_TIME = 0x0DF01023


def decoded(group: int, data: str | bytes) -> dict[str, float]:
    """What one message says, whether it fits into one frame or not."""
    payload = bytes.fromhex(data) if isinstance(data, str) else data
    parts = fast_parts(payload) if GROUPS[group].shortest else [payload]
    decoder = Nmea2000Decoder()
    return values([each for part in parts for each in decoder.decode(can_frame(identifier_of(group), part))])


def wind(reference: int) -> bytes:
    """130306: 5.12 m/s from 3.1 rad."""
    return struct.pack("<BHHBH", 255, 512, 31_000, 0xF8 | reference, 0xFFFF)


def gnss(method: int = 1, latitude_deg: float = 63.4) -> bytes:
    position = int(latitude_deg * 1e16), int(10.4e16)
    return struct.pack("<BHIqqqBBBhhiB", 1, 20_000, 360_000_000, *position, 0, method << 4, 0xFC, 9, 9, 9, 0, 0)


@pytest.mark.parametrize(
    ("group", "data", "expected"),
    [
        (127245, struct.pack("<BBhhH", 0, 0xF8, 0x7FFF, -1000, 0xFFFF), {"rudder_angle_deg": degrees(-0.1)}),
        (127250, TRUE_HEADING, {"heading_deg": degrees(1.0)}),
        (127250, "ff1027ff7fd007fc", {"heading_deg": degrees(1.0), "magnetic_variation_deg": degrees(0.2)}),
        (
            127250,
            "ff1027e803d007fd",
            {"heading_magnetic_deg": degrees(1.1), "magnetic_variation_deg": degrees(0.2)},
        ),
        (127250, "ff102718fcff7ffd", {"heading_magnetic_deg": degrees(0.9)}),
        (127250, "ff10270081ff7ffd", {}),
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
    assert parameter_group(0x18EEFF05) == (60928, 5)
    assert parameter_group(0x18EE2305) == (60928, 5)
    assert parameter_group(0x09F80123) == (129025, 35)
    assert parameter_group(0x0BF80123) == (129025 + 0x20000, 35)  # the extended data page is another group
    assert parameter_group(0x08F80123) == (129025 - 0x10000, 35)


# Fast packets


def received(frames: list[tuple[int, bytes, float]]) -> tuple[list[float], Nmea2000Decoder]:
    """The latitudes that 129029 gives from parts (address, part, time)."""
    decoder, found = Nmea2000Decoder(), []
    for address, part, at_s in frames:
        found += decoder.decode(can_frame(identifier_of(129029, address), part, at_s))
    return [sample.value for group in found for sample in group if sample.quantity == "latitude_deg"], decoder


def test_stale_parts_of_a_fast_packet_are_never_mixed() -> None:
    """Frames of one message and of another with the same number, 8 s later: no value."""
    former, later = fast_parts(gnss(latitude_deg=10.0)), fast_parts(gnss(latitude_deg=20.0))
    frames = [(35, part, 0.0) for part in former[:2]] + [(35, part, 8.0) for part in later[2:]]
    latitudes, decoder = received(frames)
    assert (latitudes, decoder.refused) == ([], {INCOMPLETE: 1})
    assert received(frames + [(35, part, 9.0) for part in later])[0] == [20.0]


def test_parts_that_come_twice_or_out_of_order_make_one_message() -> None:
    parts = fast_parts(gnss())
    twice = [part for part in parts for _ in range(2)]
    for order in (twice, [parts[0], *parts[:0:-1]], [*parts[3:], *parts[:3]]):
        latitudes, decoder = received([(35, part, 0.0) for part in order])
        assert (latitudes, decoder.refused.total()) == ([63.4], 0)


@pytest.mark.parametrize("lost", range(7))
def test_a_message_with_a_lost_part_is_dropped_and_counted(lost: int) -> None:
    first, second = fast_parts(gnss(latitude_deg=10.0)), fast_parts(gnss(latitude_deg=20.0))
    del first[lost]
    latitudes, decoder = received([(35, part, 0.0) for part in first + second])
    assert (latitudes, decoder.refused) == ([20.0], {INCOMPLETE: 1})


@pytest.mark.parametrize("length", [0, 1, 42, 224, 255])
def test_an_impossible_length_is_refused(length: int) -> None:
    first, *others = fast_parts(gnss())
    frames = [(35, part, 0.0) for part in (bytes([0, length]) + first[2:], *others)]
    latitudes, decoder = received(frames)
    assert (latitudes, decoder.refused) == ([], {"impossible length": 1})


FATES = st.lists(st.sampled_from(["sent", "sent", "sent", "lost", "twice", "late"]), min_size=7, max_size=7)


def sent_parts(messages: list[tuple[int, list[str]]], at_once: int) -> list[tuple[int, bytes, float]]:
    """Ten messages a second from two devices in turn, ``at_once`` of them woven into each other."""
    frames = []
    for place, (latitude_deg, fates) in enumerate(messages):
        address, count = place % 2, place // 2
        for number, part in enumerate(fast_parts(gnss(1, latitude_deg), count % 8)):
            late_s = 0.03 if fates[number] == "late" else 0.0
            at_s = 0.1 * at_once * (count // at_once) + 0.001 * number + late_s
            frames += {"lost": 0, "twice": 2}.get(fates[number], 1) * [(address, part, at_s)]
    return sorted(frames, key=lambda frame: frame[2])


@given(st.lists(st.tuples(st.integers(-9, 9), FATES), min_size=1, max_size=40), st.integers(1, 2))
@settings(max_examples=300)
def test_only_positions_that_were_sent_come_out(messages: list[tuple[int, list[str]]], at_once: int) -> None:
    """Parts are lost, doubled, overtaken by others: what comes out was sent, and what was sent whole comes out."""
    frames = sent_parts(messages, at_once)
    of_each: Counter[float] = Counter()
    for address in (0, 1):
        found = Counter(received([frame for frame in frames if frame[0] == address])[0])
        own = messages[address::2]
        assert found <= Counter(latitude_deg for latitude_deg, _ in own)
        assert found >= Counter(latitude_deg for latitude_deg, fates in own if {"sent", "twice"}.issuperset(fates))
        of_each += found
    assert Counter(received(frames)[0]) == of_each


@given(
    st.lists(st.tuples(st.sampled_from([*GROUPS, 60928, 61184]), st.binary(min_size=8, max_size=8)), max_size=30)
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


# Who has which address

GYRO, GPS = bytes.fromhex("05a0be1c00a0a0c0"), bytes.fromhex("9fb9e310008278c0")
GYRO_NAME, GPS_NAME = "c0a0a0001cbea005", "c078820010e3b99f"


class Bus:
    """A bus on which devices claim addresses and tell a heading."""

    def __init__(self, *devices: Device) -> None:
        self.decoder = Nmea2000Decoder("receiver", devices)

    def claim(self, address: int, name: bytes) -> None:
        assert self.decoder.decode(can_frame(identifier_of(60928, address), name)) == []

    def label(self, address: int) -> str:
        """What the device with this address is called in its samples."""
        (group,) = self.decoder.decode(can_frame(identifier_of(127250, address), TRUE_HEADING))
        return group[0].source.removeprefix("bus/").removesuffix(":127250")


def test_a_device_keeps_its_label_when_it_moves() -> None:
    bus = Bus()
    assert bus.label(35) == "35"
    bus.claim(35, GYRO)
    assert bus.label(35) == "35"
    assert not bus.decoder.notices
    bus.claim(40, GYRO)
    assert bus.label(40) == "35"
    assert len(bus.decoder.notices) == 1
    assert bus.label(35) == "35-unclaimed"
    bus.claim(40, GYRO)
    assert len(bus.decoder.notices) == 1


def test_another_device_at_a_taken_address_is_called_by_its_name() -> None:
    bus = Bus()
    bus.claim(35, GYRO)
    bus.claim(35, GPS)
    assert bus.label(35) == GPS_NAME
    bus.claim(36, GYRO)
    assert bus.label(36) == "35"
    assert len(bus.decoder.notices) == 1


def test_configured_devices_are_called_by_their_names() -> None:
    bus = Bus(Device(name="gyro", iso_name=GYRO_NAME), Device(name="gps", address=12))
    assert (bus.label(12), bus.label(35)) == ("gps", "35")
    bus.claim(35, GYRO)
    assert bus.label(35) == "gyro"
    bus.claim(12, GPS)
    bus.claim(13, GPS)
    assert bus.label(13) == "gps"


def test_a_device_without_an_address_has_no_label() -> None:
    bus = Bus()
    bus.claim(35, GYRO)
    bus.claim(254, GYRO)
    assert [level for level, _ in bus.decoder.notices] == ["warning"]
    bus.claim(35, GPS)
    assert bus.label(35) == "35"


def test_a_new_device_does_not_continue_what_another_began() -> None:
    decoder = Nmea2000Decoder()
    decoder.decode(can_frame(identifier_of(60928), GYRO))
    parts = fast_parts(gnss())
    for part in parts[:3]:
        decoder.decode(can_frame(identifier_of(129029), part))
    decoder.decode(can_frame(identifier_of(60928), GPS))
    for part in parts[3:]:
        assert decoder.decode(can_frame(identifier_of(129029), part)) == []
    assert decoder.refused[INCOMPLETE] >= 1


def test_a_device_provides_only_what_it_may() -> None:
    decoder = Nmea2000Decoder("receiver", (Device(name="gps", address=35, channels=("surge_mps", "north_m")),))
    speeds = struct.pack("<hhhh", 0x7FFF, 0x7FFF, -1234, 500)
    found = [decoder.decode(can_frame(identifier_of(130578), part)) for part in fast_parts(speeds)]
    assert values(found[-1]) == {"surge_mps": -1.234}
    assert decoder.decode(can_frame(HEADING, TRUE_HEADING)) == []
    position = struct.pack("<ii", 634_000_000, -104_000_000)
    assert set(values(decoder.decode(can_frame(identifier_of(129025), position)))) == {
        "latitude_deg",
        "longitude_deg",
    }
    assert not decoder.refused


# The clock


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
