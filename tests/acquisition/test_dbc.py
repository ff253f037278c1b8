"""The vessel's own frames: matched as J1939 devices send them, and only values that are values."""

from __future__ import annotations

import math
import struct
from pathlib import Path

import pytest
from cantools.database.can import Signal as DbcSignal
from cantools.database.conversion import BaseConversion
from hypothesis import given
from hypothesis import strategies as st

from seatrial.acquisition.config.sources import CanSource, Device, Signal
from seatrial.acquisition.core.trial import FrameFlag
from seatrial.acquisition.protocols import Decoder, make_decoders
from seatrial.acquisition.protocols.can_frames import DbcDecoder, reserved_value_meaning
from seatrial.acquisition.protocols.nmea2000 import ERROR_VALUE, NOT_AVAILABLE, Nmea2000Decoder
from tests.acquisition.can_frames import can_frame, values
from tests.acquisition.conftest import DBC


def test_dbc_signals_by_parameter_group_with_sentinels() -> None:
    signals = {
        "port_rpm": Signal(message="PortAzimuth", signal="ShaftSpeed", unit="rpm"),
        "port_angle_deg": Signal(message="PortAzimuth", signal="Angle", unit="deg"),
    }
    decoder = DbcDecoder(DBC, signals, Nmea2000Decoder())
    rpm, angle = round((165.0 + 4000) / 0.125), ((-30 + 250) * 128)
    data = rpm.to_bytes(2, "little") + angle.to_bytes(2, "little") + b"\xff" * 4
    other_address = 0x18FF1099
    assert values(decoder.decode(can_frame(other_address, data.hex()))) == {
        "port_rpm": 165.0,
        "port_angle_deg": -30.0,
    }
    missing = b"\xff\xff" + angle.to_bytes(2, "little") + b"\xff" * 4
    assert values(decoder.decode(can_frame(other_address, missing.hex()))) == {"port_angle_deg": -30.0}
    assert decoder.decode(can_frame(other_address, data[:3].hex())) == []
    assert decoder.decode(can_frame(0x18FF2099, data.hex())) == []


OTHER_DBC = """VERSION "1"
BU_: Bridge
BO_ 256 Plain: 8 Bridge
 SG_ Speed : 0|16@1- (0.1,0) [0|0] "rpm" Bridge
BO_ 2566852641 Many: 8 Bridge
 SG_ Which M : 0|8@1+ (1,0) [0|0] "" Bridge
 SG_ Port m1 : 8|16@1- (0.1,0) [0|0] "rpm" Bridge
 SG_ Starboard m2 : 8|16@1- (0.1,0) [0|0] "rpm" Bridge
BO_ 2566852897 Real: 8 Bridge
 SG_ Angle : 0|32@1- (1,0) [0|0] "deg" Bridge
SIG_VALTYPE_ 2566852897 Angle : 1;
"""


def other_dbc(tmp_path: Path) -> list[Decoder]:
    (tmp_path / "other.dbc").write_text(OTHER_DBC)
    signals = {
        "tunnel_rpm": Signal(message="Plain", signal="Speed", unit="rpm"),
        "port_rpm": Signal(message="Many", signal="Port", unit="rpm"),
        "starboard_rpm": Signal(message="Many", signal="Starboard", unit="rpm"),
        "port_angle_deg": Signal(message="Real", signal="Angle", unit="deg"),
    }
    return make_decoders(
        CanSource(
            name="bus",
            type="can",
            interface="virtual",
            channel="x",
            channels=tuple(signals),
            dbc=tmp_path / "other.dbc",
            signals=signals,
        )
    )


@pytest.mark.parametrize(
    ("identifier", "data", "flags", "expected", "refused"),
    [
        (0x100, "feff" + "00" * 6, FrameFlag.STANDARD_ID, {"tunnel_rpm": -0.2}, 0),
        (0x100, "ff7f" + "00" * 6, FrameFlag.STANDARD_ID, {"tunnel_rpm": 3276.7}, 0),
        (0x100, "ff7f" + "00" * 6, FrameFlag.NONE, {}, 0),
        (0x18FF1021, "01e803" + "ff" * 5, FrameFlag.NONE, {"port_rpm": 100.0}, 0),
        (0x18FF1021, "02e803" + "ff" * 5, FrameFlag.NONE, {"starboard_rpm": 100.0}, 0),
        (0x18FF1121, struct.pack("<f", -12.5).hex() + "ff" * 4, FrameFlag.NONE, {"port_angle_deg": -12.5}, 0),
        (0x18FF1121, struct.pack("<f", math.nan).hex() + "ff" * 4, FrameFlag.NONE, {}, 1),
        (0x18FF1121, struct.pack("<f", math.inf).hex() + "ff" * 4, FrameFlag.NONE, {}, 1),
    ],
)
def test_11_bit_multiplexed_and_real_signals(
    tmp_path: Path, identifier: int, data: str, flags: FrameFlag, expected: dict[str, float], refused: int
) -> None:
    decoders = other_dbc(tmp_path)
    found = {}
    for decoder in decoders:
        found |= values(decoder.decode(can_frame(identifier, data, flags=flags)))
    assert found == pytest.approx(expected)
    assert sum(decoder.refused.total() for decoder in decoders) == refused


def signal_of(bits: int, *, signed: bool = False, real: bool = False) -> DbcSignal:
    return DbcSignal("S", 0, bits, is_signed=signed, conversion=BaseConversion.factory(is_float=real))


@pytest.mark.parametrize(
    ("bits", "signed", "not_available", "error", "valid"),
    [
        (1, False, [], [], [0, 1]),
        (2, False, [3], [], [0, 1, 2]),
        (4, False, [15], [14], [0, 13]),
        (8, False, [255], [254], [0, 253]),
        (10, False, [1023], [1022], [0, 1021]),
        (16, False, [0xFFFF, 0xFF00], [0xFEFF, 0xFE00], [0, 0xFDFF]),
        (32, False, [0xFFFFFFFF, 0xFF000000], [0xFEFFFFFF, 0xFE000000], [0, 0xFDFFFFFF]),
        (8, True, [127], [126, 125], [-128, -1, 124]),
        (16, True, [0x7FFF], [0x7FFE, 0x7FFD], [-0x8000, 0x7FFC]),
        (32, True, [2**31 - 1], [2**31 - 2, 2**31 - 3], [-(2**31), 2**31 - 4]),
    ],
)
def test_the_highest_raw_values_are_no_values(
    bits: int, signed: bool, not_available: list[int], error: list[int], valid: list[int]
) -> None:
    """J1939-71 and NMEA 2000: the highest values, or the highest byte, tell that there is none."""
    signal = signal_of(bits, signed=signed)
    assert {reserved_value_meaning(raw, signal) for raw in not_available} <= {NOT_AVAILABLE}
    assert {reserved_value_meaning(raw, signal) for raw in error} <= {ERROR_VALUE}
    assert {reserved_value_meaning(raw, signal) for raw in valid} == {None}


MANY_DBC = """VERSION "1"
BU_: Bridge
BO_ 2565865470 Addressed: 8 Bridge
 SG_ Speed : 0|16@1+ (0.5,-1000) [0|0] "rpm" Bridge
 SG_ Order : 23|16@0+ (0.5,-1000) [0|0] "rpm" Bridge
BO_ 256 Named: 2 Bridge
 SG_ Angle : 0|8@1- (1,0) [0|0] "deg" Bridge
 SG_ Other : 8|8@1- (1,0) [0|0] "deg" Bridge
BO_ 2566852641 Many: 8 Bridge
 SG_ Which M : 0|8@1+ (1,0) [0|0] "" Bridge
 SG_ Port m1 : 8|16@1- (0.1,0) [0|0] "rpm" Bridge
BO_ 2566852897 Long: 16 Bridge
 SG_ Real : 64|64@1- (1,0) [0|0] "deg" Bridge
VAL_ 256 Angle 0 "Ahead" 1 "Invalid" 2 "Sensor_Fault" 3 "Final" ;
SIG_VALTYPE_ 2566852897 Real : 2;
"""
MANY_SIGNALS = {
    "port_rpm": Signal(message="Addressed", signal="Speed", unit="rpm"),
    "starboard_rpm": Signal(message="Addressed", signal="Order", unit="rpm"),
    "port_angle_deg": Signal(message="Named", signal="Angle", unit="deg"),
    "tunnel_rpm": Signal(message="Many", signal="Port", unit="rpm"),
    "starboard_angle_deg": Signal(message="Long", signal="Real", unit="rad"),
}


@pytest.fixture(scope="module")
def many_dbc(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("dbc") / "many.dbc"
    path.write_text(MANY_DBC)
    return path


def many(path: Path, *devices: Device) -> DbcDecoder:
    return DbcDecoder(path, MANY_SIGNALS, Nmea2000Decoder(devices=devices))


def test_addressed_frames_match_whoever_they_are_addressed_to(many_dbc: Path) -> None:
    """PDU1: the destination is no part of the group; big-endian and little-endian in one message."""
    data = (2200).to_bytes(2, "little") + (2400).to_bytes(2, "big") + b"\xff" * 4
    for identifier in (0x18EF0023, 0x18EFFF23, 0x0CEF4299):
        found = values(many(many_dbc).decode(can_frame(identifier, data)))
        assert found == {"port_rpm": 100.0, "starboard_rpm": 200.0}
    assert many(many_dbc).decode(can_frame(0x18F00023, data)) == []


@pytest.mark.parametrize(
    ("identifier", "data", "expected", "refused"),
    [
        (0x100, "0000", {"port_angle_deg": 0.0}, {}),
        (0x100, "0100", {}, {NOT_AVAILABLE: 1}),
        (0x100, "0200", {}, {ERROR_VALUE: 1}),
        (0x100, "0300", {"port_angle_deg": 3.0}, {}),
        (0x100, "0300ffffffff", {"port_angle_deg": 3.0}, {}),
        (0x100, "03", {}, {"short frame": 1}),
        (0x18FF1021, "01e803ffffffffff", {"tunnel_rpm": 100.0}, {}),
        (0x18FF1021, "07e803ffffffffff", {}, {"undecodable": 1}),
        (0x18FF1121, bytes(8) + struct.pack("<d", 1.0) + bytes(48), {"starboard_angle_deg": math.degrees(1.0)}, {}),
        (0x18FF1121, bytes(8) + struct.pack("<d", 1.7e308), {}, {"impossible value": 1}),
        (0x18FF1121, bytes(8) + struct.pack("<d", math.inf), {}, {NOT_AVAILABLE: 1}),
    ],
)
def test_names_lengths_and_multiplexers(
    many_dbc: Path, identifier: int, data: str | bytes, expected: dict[str, float], refused: dict[str, int]
) -> None:
    decoder = many(many_dbc)
    flags = FrameFlag.STANDARD_ID if identifier < 0x800 else FrameFlag.NONE
    assert values(decoder.decode(can_frame(identifier, data, flags=flags))) == pytest.approx(expected)
    assert decoder.refused == refused


def test_devices_are_called_and_limited_as_on_the_rest_of_the_bus(many_dbc: Path) -> None:
    decoder = many(many_dbc, Device(name="azimuth", address=0x23, channels=("port_rpm",)))
    (group,) = decoder.decode(can_frame(0x18EFFF23, b"\x00\x10\x10\x00" + b"\xff" * 4))
    assert [(sample.quantity, sample.source) for sample in group] == [("port_rpm", "bus/azimuth:Addressed")]


@given(
    st.sampled_from([0x18EFFF23, 0x100, 0x18FF1021, 0x18FF1121]) | st.integers(0, 2**29 - 1),
    st.binary(max_size=64),
    st.integers(0, 7),
)
def test_no_frame_raises_and_every_value_is_finite(
    many_dbc: Path, identifier: int, data: bytes, flags: int
) -> None:
    found = values(many(many_dbc).decode(can_frame(identifier, data, flags=FrameFlag(flags))))
    assert all(math.isfinite(value) for value in found.values())
