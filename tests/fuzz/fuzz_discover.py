"""Coverage-guided fuzzing of discovery: whatever comes off a line, the configuration that is written is sound.

The first byte chooses the kind of place, the rest is what came there. Nothing may raise, no terminal is told to do
anything, and every channel that is promised is one that the written configuration lists.
"""

from __future__ import annotations

from io import StringIO

import atheris

with atheris.instrument_imports(include=["acquisition"]):
    from rich.console import Console

    from seatrial.acquisition.config.trial_file import parse_config
    from seatrial.acquisition.core.trial import Frame, FrameFlag
    from seatrial.acquisition.discovery.discover import describe_silence, discovery_tables, interpret_captures
    from seatrial.acquisition.discovery.listen import ListeningPlace, interpret_frames
    from tests.acquisition.bus_logs import FORMS
    from tests.acquisition.can_frames import identifier_of
    from tests.fuzz.running import fuzz

PLACES = (
    ListeningPlace("line", "serial", {"device": "/dev/ttyUSB0", "baud_rate": 4800}, "/dev/ttyUSB0"),
    ListeningPlace("port", "udp", {"address": "127.0.0.1", "port": 10110}, "udp:10110"),
    ListeningPlace("gateway", "tcp", {"address": "127.0.0.1", "port": 2000}, "tcp:127.0.0.1:2000"),
    ListeningPlace("bus", "can", {"interface": "socketcan", "channel": "can0"}, "can0"),
    ListeningPlace("broker", "mqtt", {"address": "127.0.0.1", "topics": ["#"]}, "mqtt:127.0.0.1"),
)
SEEDS = (
    *(bytes([place]) + form.write()[:300] for form in FORMS.values() for place in range(3)),
    b"\x00$GPGGA,085118.40,5327.60,N,01002.89,E,1,07,1.1,7.2,M,4.6,M,,*54\n$HEHDT,12.5,T*2B\n",
    b"\x03\x00\x01" + bytes(8) + b"\x05\x02" + bytes.fromhex("05a0be1c00a0a0c0"),
    b"\x04ship/NMEA\x002023-11-03T09:41:02Z $HEHDT,12.5,T*2B\x00\x00ship/x\x001.5,2023-11-03T09:41:02Z",
)  # fmt: skip
GROUPS = (60928, 126996, 127250, 127245, 127488, 128006, 129029, 130306, 65280)


def frames_of(place: ListeningPlace, data: bytes) -> list[Frame]:
    """What came, as the kind of place delivers it, 0.1 s after each other."""
    times = [(1_780_000_000_000_000_000 + n * 10**8, n * 10**8) for n in range(len(data) + 1)]
    if place.type == "can":
        parts = [data[at : at + 10] for at in range(0, len(data), 10)]
        return [
            Frame("bus", "can", each[2:], *at, identifier_of(GROUPS[each[0] % len(GROUPS)], each[-1] & 3),
                  FrameFlag(each[1] >> 5 & 7))
            for each, at in zip(parts, times, strict=False) if len(each) > 1
        ]  # fmt: skip
    parts = data.split(b"\0\0") if place.type == "mqtt" else [data[:40], data[40:]]
    protocol = "mqtt" if place.type == "mqtt" else "mavlink"
    return [Frame(place.name, protocol, each, *at) for each, at in zip(parts, times, strict=False) if each]  # type: ignore[arg-type]


def one_input(data: bytes) -> None:
    place = PLACES[data[0] % len(PLACES)] if data else PLACES[0]
    found = interpret_captures([interpret_frames(place, frames_of(place, data[1:]))])
    if found.survey is None:
        assert describe_silence(found).isprintable()
        return
    shown = StringIO()
    for table in discovery_tables(found):
        Console(file=shown, width=200).print(table)
    assert "\x1b" not in shown.getvalue()
    config = parse_config(found.configuration, "written.toml")
    assert set(found.channels) <= config.expected_channels


if __name__ == "__main__":
    fuzz(one_input, SEEDS, 600)
