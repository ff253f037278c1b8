"""Coverage-guided fuzzing of MAVLink, from the bytes of a link to channel samples.

The bytes are tried as they are, in two pieces, and once more as packets with right checksums, which chance would
never find. Nothing may raise, every value must be finite, every channel sample must be one that its channel can
hold, and no more than two packets may be kept waiting.
"""

from __future__ import annotations

import atheris

with atheris.instrument_imports(include=["acquisition"]):
    from seatrial.acquisition.config.sources import MavlinkSource
    from seatrial.acquisition.core.trial import Frame, Trial
    from seatrial.acquisition.logger.processing import Derivation
    from seatrial.acquisition.protocols.mavlink import LONGEST_BYTES, MavlinkDecoder, dialect, mavlink_crc
    from tests.fuzz.decoding import check_frame
    from tests.fuzz.running import fuzz

SECOND = 1_000_000_000
TRIAL = Trial(name="fuzz", origin_latitude_deg=63.44, origin_longitude_deg=10.4)
CONFIG = MavlinkSource(name="link", type="mavlink", port=1, channels=(), clock="source")
NAMES = (
    "SYSTEM_TIME", "ATTITUDE", "GLOBAL_POSITION_INT", "GPS_RAW_INT", "GPS_GLOBAL_ORIGIN", "LOCAL_POSITION_NED",
    "NAMED_VALUE_FLOAT", "RPM", "RAW_RPM", "WIND", "WIND_COV", "HEARTBEAT",
)  # fmt: skip
MESSAGES = [dialect.mavlink_map[getattr(dialect, f"MAVLINK_MSG_ID_{name}")] for name in NAMES]


def packet(choice: int, payload: bytes) -> bytes:
    """A packet with a right checksum; the choice says which message, which version, and whether it is signed."""
    message, signed = MESSAGES[choice % len(MESSAGES)], choice & 0x40
    if choice & 0x80 and message.id < 256:
        header, signed = bytes((len(payload), 0, 1, 1, message.id)), 0
        magic = b"\xfe"
    else:
        header = bytes((len(payload), 1 if signed else 0, 0, 0, 1, 1)) + message.id.to_bytes(3, "little")
        magic = b"\xfd"
    crc = mavlink_crc(header + payload + bytes((message.crc_extra,))).to_bytes(2, "little")
    return magic + header + payload + crc + (b"\xfd" * 13 if signed else b"")


def packets(data: bytes) -> list[bytes]:
    """Each packet from a byte that chooses, a byte of length, and a payload."""
    made, at = [], 0
    while at + 2 <= len(data):
        length = data[at + 1] % 64
        made.append(packet(data[at], data[at + 2 : at + 2 + length]))
        at += 2 + length
    return made


def check(decoder: MavlinkDecoder, derivation: Derivation, payload: bytes, at_ns: int) -> None:
    check_frame(decoder, derivation, Frame("link", "mavlink", payload, at_ns, at_ns))
    assert len(decoder._cutter._pending) <= 2 * LONGEST_BYTES


def one_input(data: bytes) -> None:
    decoder, derivation = MavlinkDecoder(CONFIG), Derivation(TRIAL, frozenset({"link"}))
    middle = len(data) // 2
    for number, piece in enumerate((data[:middle], data[middle:], bytes(2 * LONGEST_BYTES))):
        check(decoder, derivation, piece, number * SECOND // 10)
    decoder.refused.clear()
    for number, whole in enumerate(packets(data), start=3):
        check(decoder, derivation, whole, number * SECOND // 10)
    assert not {"bad data", "unknown message", "undecodable"} & {each for each, n in decoder.refused.items() if n}


def seeds() -> list[bytes]:
    """Every message with bodies that are easy to change, and all of them one after the other."""
    bodies = bytes(40), b"\xff" * 40, bytes(range(40))
    each = [bytes((number, 40)) + body for number in range(len(NAMES)) for body in bodies]
    return [*each, b"".join(packets(b"".join(each[2::3])))]


if __name__ == "__main__":
    fuzz(one_input, seeds(), 800)
