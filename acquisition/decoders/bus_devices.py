"""Who has which address on an NMEA 2000 bus, and what a device is called in our recordings.

Addresses are claimed, and change hands; a device's 64-bit NAME stays. So a device keeps the label that it was
first heard under: what the configuration calls it, or its address at that time.
"""

from __future__ import annotations

from collections.abc import Sequence

from seatrial.acquisition.config.sections import Device
from seatrial.acquisition.core.frames import safe_label
from seatrial.acquisition.decoders import Notices

_NO_ADDRESS = 254  # claimed by a device that found none free
_MOST_NAMES = 512  # a bus has 252 addresses; more NAMEs than this are noise that looks like claims

_LEADS_TO = {
    "latitude_deg": {"north_m", "east_m", "longitude_deg"},
    "longitude_deg": {"north_m", "east_m", "latitude_deg"},
    "heading_magnetic_deg": {"heading_deg"},
    "magnetic_variation_deg": {"heading_deg", "wind_direction_deg", "surge_mps", "sway_mps"},
    "course_over_ground_deg": {"surge_mps", "sway_mps"},
    "course_magnetic_deg": {"surge_mps", "sway_mps"},
    "speed_over_ground_mps": {"surge_mps", "sway_mps"},
    "wind_direction_magnetic_deg": {"wind_direction_deg"},
    "wind_angle_apparent_deg": {"apparent_wind_angle_deg", "wind_direction_deg", "wind_speed_mps"},
    "wind_speed_apparent_mps": {"apparent_wind_speed_mps", "wind_direction_deg", "wind_speed_mps"},
    "wind_angle_theoretical_deg": {"wind_direction_deg", "wind_speed_mps"},
    "wind_speed_theoretical_mps": {"wind_direction_deg", "wind_speed_mps"},
    "wind_angle_water_deg": {"wind_direction_deg", "wind_speed_mps"},
    "wind_speed_water_mps": {"wind_direction_deg", "wind_speed_mps"},
}
"""The channels that are derived from a quantity, besides its own."""


class BusDevices:
    """The devices of one bus, as configured and as heard; ``bus`` tells it apart from others of the same log."""

    def __init__(self, configured: tuple[Device, ...], notices: Notices, bus: str = "") -> None:
        self.at_bus = f"@{safe_label(bus)}" if bus else ""
        labels = [(device.name + self.at_bus, device) for device in configured]
        self._by_iso_name = {device.iso_name: label for label, device in labels if device.iso_name is not None}
        self._by_address = {device.address: label for label, device in labels if device.address is not None}
        self._provides = {
            label: _quantities(device.channels) for label, device in labels if device.channels is not None
        }
        self._notices = notices
        self._name_at: dict[int, str] = {}
        self._label_of: dict[str, str] = {}
        self._label_at: dict[int, str] = {}

    def label(self, address: int) -> str:
        """What the device that has this address now is called."""
        label = self._label_at.get(address)
        if label is None:
            label = self._usual_label(address)
            if label in self._label_of.values():  # whose it was has moved away, and nobody has claimed it since
                label = f"{address}-unclaimed{self.at_bus}"
            self._label_at[address] = label
        return label

    def may_provide(self, label: str, quantity: str) -> bool:
        """Whether the configuration wants this quantity from this device."""
        provides = self._provides.get(label)
        return provides is None or quantity in provides

    def claim(self, address: int, payload: bytes) -> bool:
        """A device claims an address by its NAME, 8 bytes; tells whether the address changed hands."""
        name = f"{int.from_bytes(payload, 'little'):016x}"
        former_address = next(
            (held_address for held_address, holder in self._name_at.items() if holder == name), None
        )
        if former_address == address:
            return False
        if former_address is not None:
            del self._name_at[former_address]
            self._label_at.pop(former_address, None)
        if address == _NO_ADDRESS:
            if (label := self._label_of.pop(name, None)) is not None:
                text = f"device {label} (NAME {name}) found no free address and is silent"
                self._notices.append(("warning", text))
            return False
        if name not in self._label_of and name not in self._by_iso_name and len(self._label_of) >= _MOST_NAMES:
            return False
        return self._take(address, name, former_address)

    def _take(self, address: int, name: str, former_address: int | None) -> bool:
        former_name, former_label = self._name_at.get(address), self._label_at.get(address)
        label = self._label_of.get(name) or self._new_label(address, name)
        self._name_at[address], self._label_of[name], self._label_at[address] = name, label, label
        if former_address is not None:
            self._notices.append(("warning", f"device {label} moved from address {former_address} to {address}"))
        if former_name is not None:
            text = f"address {address} was taken over from device {former_label} by device {label} (NAME {name})"
            self._notices.append(("warning", text))
        return former_label not in (None, label) or former_name is not None

    def _new_label(self, address: int, name: str) -> str:
        """The label of a NAME that was never heard before."""
        label = self._by_iso_name.get(name) or self._usual_label(address)
        return name + self.at_bus if label in self._label_of.values() else label

    def _usual_label(self, address: int) -> str:
        return self._by_address.get(address, f"{address}{self.at_bus}")


def _quantities(wanted: Sequence[str]) -> frozenset[str]:
    """The quantities that can become one of these channels."""
    return frozenset(wanted) | {name for name, channels in _LEADS_TO.items() if channels.intersection(wanted)}
