"""Coverage-guided fuzzing of NMEA 2000, from frames to channel samples.

The bytes are taken for single frames of the groups that we listen to, address claims among them, and for whole
messages that are cut into parts, which chance would seldom put together. Nothing may raise, every value must be
finite, and every channel sample must be one that its channel can hold.
"""

from __future__ import annotations

from collections.abc import Iterator

import atheris

with atheris.instrument_imports(include=["acquisition"]):
    from seatrial.acquisition.config.sources import Device
    from seatrial.acquisition.core.ship import Actuator, actuators_as_text
    from seatrial.acquisition.core.trial import Frame, FrameFlag, Trial
    from seatrial.acquisition.logger.processing import Derivation
    from seatrial.acquisition.protocols.nmea2000 import ADDRESS_CLAIM, SHORTEST_BYTES, Nmea2000Decoder
    from tests.acquisition.can_frames import FIELDS, fast_parts, identifier_of
    from tests.fuzz.decoding import check_frame
    from tests.fuzz.running import fuzz

MILLISECOND = 1_000_000
NUMBERS = [*sorted(FIELDS), ADDRESS_CLAIM]
DEVICES = (
    Device(name="gyro", iso_name="c0a0a0001cbea005"),
    Device(name="wind", address=3, channels=("wind_speed_mps", "wind_direction_deg")),
)
SHIP = (Actuator("port", "propeller"), Actuator("starboard", "propeller"), Actuator("rudder", "rudder"))
TRIAL = Trial(name="fuzz", origin_latitude_deg=63.44, origin_longitude_deg=10.4, actuators=actuators_as_text(SHIP))
WHOLE, LONG_GAP, ODD_LENGTH = 0x20, 0x40, 0x80
FLAGGED = 0x80  # of the second byte, where the first one has ODD_LENGTH


def records(data: bytes) -> Iterator[tuple[int, bytes, int, FrameFlag]]:
    """Identifiers, payloads, the time since the one before [ns], and flags: two bytes choose, others are sent."""
    while len(data) >= 3:
        choice, where, data = data[0], data[1], data[2:]
        group, gap_ns = NUMBERS[choice % 32 % len(NUMBERS)], (800 if choice & LONG_GAP else 5) * MILLISECOND
        flags = FrameFlag(where >> 4 & 7) if choice & ODD_LENGTH and where & FLAGGED else FrameFlag.NONE
        address = 254 if where & 0xF == 0xF else where & 0x3
        if choice & WHOLE and group in SHORTEST_BYTES:
            length = data[0] % 64
            parts, data = fast_parts(data[1 : 1 + length], where >> 5), data[1 + length :]
        else:
            length = where & 0xF if choice & ODD_LENGTH else 8
            parts, data = [data[:length]], data[length:]
        for part in parts:
            yield identifier_of(group, address), part, gap_ns, flags


def one_input(data: bytes) -> None:
    decoder = Nmea2000Decoder("source", DEVICES, SHIP, {"port": 2.0, "starboard": 0.5})
    derivation = Derivation(TRIAL, frozenset({"bus"}))
    at_ns = 0
    for identifier, payload, gap_ns, flags in records(data):
        at_ns += gap_ns
        check_frame(decoder, derivation, Frame("bus", "can", payload, at_ns, at_ns, identifier, flags))


def seeds() -> list[bytes]:
    """A frame, or a whole message, of every group, and two of the same device after it has moved."""
    body = bytes.fromhex("00102700001027000051d22e75150000e803d007fc10f80300000000000000000000000000000000000000")
    each = [bytes([place | WHOLE, 1, 43]) + body for place in range(len(NUMBERS))]
    claims = [bytes([len(NUMBERS) - 1, address]) + bytes.fromhex("05a0be1c00a0a0c0") for address in (1, 2)]
    return [*each, b"".join(claims), b"".join(each)]


if __name__ == "__main__":
    fuzz(one_input, seeds(), 800)
