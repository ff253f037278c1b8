"""Devices on a bus: who has which address, what a device is called, and what it may provide."""

from __future__ import annotations

import struct
from collections import deque

from hypothesis import given
from hypothesis import strategies as st

from seatrial.acquisition.config.sources import Device
from seatrial.acquisition.protocols.nmea2000 import INCOMPLETE, BusDevices, Nmea2000Decoder
from tests.acquisition.can_frames import can_frame, fast_parts, gnss, identifier_of, values

HEADING = identifier_of(127250)
TRUE_HEADING = "ff10270000ff7ffc"  # 1 rad
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


CLAIM = st.tuples(st.sampled_from([12, 35, 36, 254]), st.sampled_from([None, GYRO, GPS, bytes(8)]))


@given(st.lists(CLAIM, max_size=20))
def test_no_two_devices_are_ever_called_the_same(claims: list[tuple[int, bytes | None]]) -> None:
    """Whoever claims whatever, heard before or not; and a device that is heard keeps its label while it claims."""
    configured = (Device(name="gyro", iso_name=GYRO_NAME), Device(name="gps", address=12))
    devices, label_of = BusDevices(configured, deque()), dict[bytes, str]()
    for address, name in claims:
        if name is None:
            devices.label_of_address(address)
            continue
        devices.claim_address(address, name)
        if address == 254:
            label_of.pop(name, None)
        else:
            assert devices.label_of_address(address) == label_of.setdefault(name, devices.label_of_address(address))
        labels = [devices.label_of_address(each) for each in (12, 35, 36)]
        assert len(set(labels)) == len(labels)
