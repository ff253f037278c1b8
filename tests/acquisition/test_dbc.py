"""The vessel's own frames: matched as J1939 devices send them, and only values that are values."""

from __future__ import annotations

import math
import struct
from pathlib import Path

import pytest

from acquisition.decoders import Decoder, make_decoders
from acquisition.decoders.clock import SourceClock
from acquisition.decoders.dbc import DbcDecoder
from acquisition.frames import FrameFlag
from acquisition.sections import CanSource, Signal
from tests.acquisition.can_frames import can_frame, values
from tests.acquisition.conftest import DBC


def test_dbc_signals_by_parameter_group_with_sentinels() -> None:
    signals = {
        "port_rpm": Signal(message="PortAzimuth", signal="ShaftSpeed", unit="rpm"),
        "port_angle_deg": Signal(message="PortAzimuth", signal="Angle", unit="deg"),
    }
    decoder = DbcDecoder(DBC, signals, SourceClock("receiver", ""))
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
