"""Coverage-guided fuzzing of NMEA 0183, from the bytes of a line to channel samples.

Every line is tried as it is, and once more with sound checksums, which chance would never find. Nothing may
raise, every value must be finite, and every channel sample must be one that its channel can hold.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Literal

import atheris

with atheris.instrument_imports(include=["acquisition"]):
    from seatrial.acquisition.config.sources import Thrusters
    from seatrial.acquisition.core.ship import DEFAULT, Actuator, actuators_as_text
    from seatrial.acquisition.core.trial import Frame, Trial
    from seatrial.acquisition.logger.processing import Derivation
    from seatrial.acquisition.protocols.nmea0183 import Nmea0183Decoder, xor_checksum
    from seatrial.acquisition.sources.lines import LineAssembler
    from tests.fuzz.decoding import check_frame
    from tests.fuzz.running import fuzz

SECOND = 1_000_000_000
TRIAL = Trial(name="fuzz", origin_latitude_deg=63.44, origin_longitude_deg=10.4)
SHIP = (Actuator("main", "controllable_propeller"), Actuator("rudder", "rudder"), Actuator("bow", "tunnel"))
SEEDS = (
    b"\0$GPZDA,120000.00,31,12,2026,00,00\n$GPRMC,120000,A,6326.4,N,01024.0,E,5.6,230.5,311226,1.4,E,A",
    b"\1$GPGGA,120000,6326.4,N,01024.0,E,4,12,0.6,0.0,M,0.0,M,,\n$GPGLL,6326.4,N,01024.0,E,120000,A,A",
    b"\2$HEHDT,12.5,T\n$HETHS,12.5,A\n$HCHDG,101.1,2.0,E,7.1,W\n$APHDM,12.5,M\n$TIROT,-30.0,A",
    b"\3$VDVBW,9.0,1.0,A,10.0,-2.0,A\n$GPVTG,230.5,T,,M,5.6,N,10.4,K,A\n$SDVHW,,T,,M,6.6,N,12.3,K",
    b"\4$WIMWV,57.5,R,13.0,N,A\n$WIMWD,328.2,T,326.8,M,10.0,N,5.1,M\n$IIVWR,45.0,L,10.0,N,,,,\n$IIVWT,45.0,R,,,5.1,M",
    b"\5$RCTRD,2,400.5,R,,V,90.8\n$RCTRC,2,402.6,R,,V,88.3,B,C\n$ERRSA,-5.0,A,7.0,A\n$ERRPM,S,1,-120.0,90.0,A",
    b"\x0b$ERRSA,-5.0,A,,V\n$AGROR,10.0,A,,V,B\n$AGHTD,V,12.5,L,S,N\n$ERRPM,E,0,480.0,90.0,A\n$RCPRC,,V,9.0,R,7.0,P,B,0",
    b"\6\\s:GN01,c:1798761600\\$HEHDT,12.5,T\nUdPbC\0\\g:1-2-3,c:1798761600250\\$WIMWV,57.5,T,13.0,K,A",
)


def with_checksum(text: bytes) -> bytes:
    """The line with the checksum that it should have, in the TAG block too."""
    head, _, rest = text.partition(b"\\")
    items, closed, body = rest.partition(b"\\")
    if not closed:
        return sound(text)
    return head + b"\\" + items + b"*%02X" % xor_checksum(items) + b"\\" + sound(body)


def sound(text: bytes) -> bytes:
    return text + b"*%02X" % xor_checksum(text[1:])


def one_input(data: bytes) -> None:
    """The first byte chooses the settings; the rest are lines."""
    settings, stream = data[0] if data else 0, data[1:]
    ship = SHIP if settings & 8 else DEFAULT
    demand = {"channels_from": "demand" if settings & 1 else "response"}
    thrusters = Thrusters.model_validate(demand, context={"actuators": ship})
    wind: Literal["water", "ground"] = "water" if settings & 2 else "ground"
    decoder = Nmea0183Decoder(thrusters, "source", wind, ship, {"main": 4.0} if ship is SHIP else {})
    derivation = Derivation(replace(TRIAL, actuators=actuators_as_text(ship)), frozenset({"line"}))
    assembler = LineAssembler("line")
    frames = assembler.push(stream) + assembler.end()
    assert all(before.monotonic_ns <= after.monotonic_ns for before, after in pairwise(frames))
    for number, frame in enumerate(frames):
        for payload in (frame.payload, with_checksum(frame.payload)):
            at_ns = number * SECOND // 10
            check_frame(decoder, derivation, Frame("line", "nmea0183", payload, at_ns, at_ns))


if __name__ == "__main__":
    fuzz(one_input, SEEDS, 600)
