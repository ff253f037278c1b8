"""Coverage-guided fuzzing of a vessel's own CAN frames, by a DBC file with signals of every kind.

Nothing may raise, every value must be finite, and every channel sample must be one that its channel can hold.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import atheris

with atheris.instrument_imports(include=["acquisition"]):
    from seatrial.acquisition.config.sources import Signal
    from seatrial.acquisition.core.trial import Frame, FrameFlag, Trial
    from seatrial.acquisition.logger.processing import Derivation
    from seatrial.acquisition.protocols.can_frames import DbcDecoder
    from seatrial.acquisition.protocols.clock import SourceClock
    from tests.fuzz.decoding import check_frame
    from tests.fuzz.running import fuzz

TRIAL = Trial(name="fuzz", origin_latitude_deg=63.44, origin_longitude_deg=10.4)
PLAIN, MIXED, MANY, REAL = 0x100, 0x18EFFF21, 0x18FF1021, 0x18FF1121
DBC = f"""VERSION "1"
BU_: Bridge
BO_ {PLAIN} Plain: 8 Bridge
 SG_ Whole : 0|16@1- (0.1,0) [0|0] "rpm" Bridge
 SG_ Bit : 16|1@1+ (1,0) [0|0] "deg" Bridge
 SG_ Named : 24|8@1- (1,0) [0|0] "deg" Bridge
BO_ {MIXED | 1 << 31} Mixed: 8 Bridge
 SG_ Two : 0|2@1+ (1,0) [0|0] "deg" Bridge
 SG_ Ten : 2|10@1+ (0.4,-200) [0|0] "deg" Bridge
 SG_ Big : 23|16@0+ (0.125,-4000) [0|0] "rpm" Bridge
 SG_ Long : 32|32@1- (0.001,0) [0|0] "rpm" Bridge
BO_ {MANY | 1 << 31} Many: 8 Bridge
 SG_ Which M : 0|8@1+ (1,0) [0|0] "" Bridge
 SG_ One m1 : 8|16@1- (0.1,0) [0|0] "rpm" Bridge
 SG_ Other m2 : 8|16@1- (0.1,0) [0|0] "rpm" Bridge
BO_ {REAL | 1 << 31} Real: 12 Bridge
 SG_ Single : 0|32@1- (1,0) [0|0] "rad" Bridge
 SG_ Double : 32|64@1- (10,0) [0|0] "m/s" Bridge
VAL_ {PLAIN} Named 1 "Invalid" 2 "Sensor_Fault" ;
SIG_VALTYPE_ {REAL | 1 << 31} Single : 1;
SIG_VALTYPE_ {REAL | 1 << 31} Double : 2;
"""
SIGNALS = {
    "port_rpm": ("Plain", "Whole", "rpm"),
    "roll_deg": ("Plain", "Bit", "deg"),
    "port_angle_deg": ("Plain", "Named", "deg"),
    "pitch_deg": ("Mixed", "Two", "deg"),
    "heading_deg": ("Mixed", "Ten", "deg"),
    "starboard_rpm": ("Mixed", "Big", "rpm"),
    "tunnel_rpm": ("Mixed", "Long", "rpm"),
    "port_order_rpm": ("Many", "One", "rpm"),
    "starboard_order_rpm": ("Many", "Other", "rpm"),
    "starboard_angle_deg": ("Real", "Single", "rad"),
    "surge_mps": ("Real", "Double", "m/s"),
}


def decoder_of(folder: Path) -> DbcDecoder:
    path = folder / "fuzz.dbc"
    path.write_text(DBC)
    signals = {channel: Signal(*entry) for channel, entry in SIGNALS.items()}
    return DbcDecoder(path, signals, SourceClock("source", ""))


DECODER = decoder_of(Path(tempfile.mkdtemp()))


def one_input(data: bytes) -> None:
    """A byte that chooses message and flags, one that gives the length, and the payload, again and again."""
    derivation = Derivation(TRIAL, frozenset({"bus"}))
    while len(data) >= 2:
        choice, length, data = data[0], data[1] % 65, data[2:]
        payload, data = data[:length], data[length:]
        identifier = (PLAIN, MIXED, MANY, REAL)[choice % 4]
        flags = FrameFlag(choice >> 4 & 7) if choice & 8 else FrameFlag(identifier == PLAIN)
        check_frame(DECODER, derivation, Frame("bus", "can", payload, 0, 0, identifier, flags))


if __name__ == "__main__":
    fuzz(one_input, [bytes([place, 12, 1]) + bytes(range(11)) for place in range(4)], 300)
