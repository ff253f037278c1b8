"""Each protocol: published examples, the traps of its framing, and only values that a channel can hold."""

from __future__ import annotations

import gzip
import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from acquisition.config import MavlinkSource, Signal
from acquisition.decoders.clock import SourceClock
from acquisition.decoders.dbc import DbcDecoder
from acquisition.decoders.mavlink import MavlinkDecoder
from acquisition.decoders.nmea0183 import Nmea0183Decoder, split_sentence
from acquisition.decoders.nmea2000 import Nmea2000Decoder, parameter_group
from acquisition.encoders.nmea0183 import sentence
from acquisition.frames import Frame, FrameFlag, Sample
from acquisition.units import DEG_PER_RAD
from tests.acquisition.conftest import DBC

SECOND = 1_000_000_000


def can_frame(identifier: int, data: str, at_s: float = 0.0, flags: FrameFlag = FrameFlag.NONE) -> Frame:
    time_ns = round(at_s * SECOND)
    return Frame("bus", "can", bytes.fromhex(data), time_ns, time_ns, identifier, flags)


def line(text: bytes, at_s: float = 0.0) -> Frame:
    time_ns = round(at_s * SECOND)
    return Frame("line", "nmea0183", text, time_ns, time_ns)


def values(groups: list[list[Sample]]) -> dict[str, float]:
    return {sample.quantity: sample.value for group in groups for sample in group}


HEADING = 0x09F11223  # PGN 127250 from address 35


def test_heading_true_and_magnetic() -> None:
    decoder = Nmea2000Decoder()
    assert values(decoder.decode(can_frame(HEADING, "ff102700 00ff7ffc"))) == {
        "heading_deg": pytest.approx(1.0 * DEG_PER_RAD)
    }
    magnetic = can_frame(HEADING, "ff1027e803d007fd")  # deviation 0.1, variation 0.2 rad
    assert values(decoder.decode(magnetic))["heading_deg"] == pytest.approx(1.3 * DEG_PER_RAD)
    assert decoder.decode(can_frame(HEADING, "ff10270000ff7ffd")) == []  # magnetic, no variation


@pytest.mark.parametrize(
    ("data", "flags"),
    [
        ("ff10270000ff7ffc", FrameFlag.REMOTE),
        ("ff10270000ff7ffc", FrameFlag.ERROR),
        ("ff10270000ff7ffc", FrameFlag.STANDARD_ID),
        ("ff1027", FrameFlag.NONE),
        ("", FrameFlag.NONE),
    ],
)
def test_guards_refuse_and_count(data: str, flags: FrameFlag) -> None:
    decoder = Nmea2000Decoder()
    assert decoder.decode(can_frame(HEADING, data, flags=flags)) == []
    assert decoder.refused.total() == 1


@pytest.mark.parametrize("data", ["ffffffffffffffff", "fffeff0000ff7ffc"])
def test_not_available_and_error_are_missing(data: str) -> None:
    assert Nmea2000Decoder().decode(can_frame(HEADING, data)) == []


def test_stale_parts_of_a_fast_packet_are_never_mixed() -> None:
    """Frame 0 of one speed message and frame 1 of another with the same number, 8 s later: no value."""
    speeds = 0x09FE1223  # PGN 130578
    decoder = Nmea2000Decoder()
    first, second = "000cff7fff7f2efb", "01f401ff7fff7fff"
    assert decoder.decode(can_frame(speeds, first, 0.0)) == []
    assert decoder.decode(can_frame(speeds, second, 8.0)) == []
    decoder.decode(can_frame(speeds, first, 9.0))
    assert values(decoder.decode(can_frame(speeds, second, 9.01))) == {
        "surge_mps": pytest.approx(-1.234),
        "sway_mps": pytest.approx(0.5),
    }


def test_only_wind_over_ground_from_north_is_true_wind() -> None:
    wind = 0x09FD0223
    decoder = Nmea2000Decoder()
    assert values(decoder.decode(can_frame(wind, "ff00021879f8ffff"))) == {
        "wind_speed_mps": pytest.approx(5.12),
        "wind_direction_deg": pytest.approx(3.1 * DEG_PER_RAD, abs=1e-6),
    }
    for reference in (1, 2, 3, 4, 6, 7):
        data = f"ff00021879{0xF8 | reference:02x}ffff"
        assert decoder.decode(can_frame(wind, data)) == []


def test_system_time_stamps_what_follows() -> None:
    decoder = Nmea2000Decoder("source")
    decoder.decode(can_frame(0x0DF01023, "01f02a51d22e7515", 100.0))  # 2026-11-21 10:00:00.1234
    (sample,) = decoder.decode(can_frame(HEADING, "ff10270000ff7ffc", 100.25))[0]
    assert sample.measured_ns == 1_795_255_200_123_400_000 + SECOND // 4
    assert sample.received_ns == 100.25 * SECOND
    (late,) = decoder.decode(can_frame(HEADING, "ff10270000ff7ffc", 200.0))[0]
    assert late.clock == "receiver"


def test_parameter_group_of_addressed_and_broadcast_identifiers() -> None:
    assert parameter_group(0x18EEFF05) == (60928, 5)
    assert parameter_group(0x09F80123) == (129025, 35)


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


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (b"$RCTRD,3,-17.8,R,,V,*59", {}),
        (b"$RCTRD,2,400.5,R,,V,90.8*55", {"port_rpm": 400.5, "port_angle_deg": 90.8}),
        (sentence("RCTRD,1,-17.8,R,,V,").strip(), {"tunnel_rpm": -17.8}),
        (sentence("HEHDT,359.99,T").strip(), {"heading_deg": 359.99}),
        (sentence("HEHDT,,T").strip(), {}),
        (sentence("TIROT,-30.0,A").strip(), {"yaw_rate_dps": -0.5}),
        (sentence("TIROT,-30.0,V").strip(), {}),
        (sentence("GPGGA,101112,6326.1,N,01023.6,E,0,08,1.0,5.0,M,40.0,M,,").strip(), {}),
        (sentence("HEHDT,12.3,T").strip()[:-2] + b"00", {}),
        (b"$HEHDT,12.3,T", {}),
        (b"\xff\xfe rubbish", {}),
    ],
)
def test_sentences(text: bytes, expected: dict[str, float]) -> None:
    assert values(Nmea0183Decoder().decode(line(text))) == pytest.approx(expected)


def test_position_signs_and_the_date_from_zda() -> None:
    decoder = Nmea0183Decoder(stamps="source")
    decoder.decode(line(sentence("GPZDA,235959.500,31,12,2026,00,00").strip(), 10.0))
    fix = sentence("GPGGA,000000.250,3354.6,S,15112.0,W,4,12,0.6,0.0,M,0.0,M,,").strip()
    (latitude, longitude), *_ = decoder.decode(line(fix, 10.75))
    assert (latitude.value, longitude.value) == pytest.approx((-33.91, -151.2))
    assert latitude.measured_ns == 1_798_761_600_250_000_000  # 2027-01-01T00:00:00.25


@given(st.binary(max_size=100))
def test_no_bytes_on_a_line_raise(noise: bytes) -> None:
    decoder = Nmea0183Decoder()
    decoder.decode(line(noise))
    decoder.decode(line(b"$" + noise + b"*00"))


BODIES = st.text(st.characters(min_codepoint=32, max_codepoint=126, exclude_characters="*$!"), max_size=60)


@given(st.sampled_from(["GPGGA", "HEHDT", "TIROT", "VDVBW", "WIMWD", "RCTRD", "GPZDA", "GPRMC", "HETHS"]), BODIES)
def test_no_sound_sentence_raises(tag: str, fields: str) -> None:
    text = sentence(f"{tag},{fields}").strip()
    assert split_sentence(text) is not None
    Nmea0183Decoder().decode(line(text))


@given(st.integers(0, 2**29 - 1), st.binary(max_size=8))
@settings(max_examples=300)
def test_no_can_frame_raises(identifier: int, data: bytes) -> None:
    decoder = Nmea2000Decoder()
    for group in (identifier, HEADING, 0x09FE1223, 0x09F80523):
        decoder.decode(Frame("bus", "can", data, 0, 0, group))


def mavlink_decoder() -> MavlinkDecoder:
    return MavlinkDecoder(MavlinkSource(name="link", type="mavlink", port=1, channels=()))


@given(st.binary(max_size=300))
def test_no_datagram_raises(noise: bytes) -> None:
    mavlink_decoder().decode(Frame("link", "mavlink", noise, 0, 0))


def test_mavlink_listens_to_its_own_system_only() -> None:
    from pymavlink.dialects.v20 import ardupilotmega as dialect

    decoder = mavlink_decoder()
    for system, expected in ((1, {"heading_deg", "yaw_rate_dps", "roll_deg", "pitch_deg"}), (2, set())):
        link = dialect.MAVLink(None, srcSystem=system)
        payload = bytes(link.attitude_encode(0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.01).pack(link))
        assert set(values(decoder.decode(Frame("link", "mavlink", payload, 0, 0)))) == expected


@pytest.mark.shared
@pytest.mark.parametrize("name", ["furuno-fap7011c-autopilot-maneuvers.raw", "scx20.raw"])
def test_headings_rates_and_winds_equal_canboats(shared_data: Path, name: str) -> None:
    """Single-frame groups of a real capture, line by line against canboat's own decode."""
    folder = shared_data / "nmea2000"
    ours, theirs = _ours(folder / name), _canboats(folder / f"{name}.si.jsonl.gz")
    assert len(theirs) > 100
    assert ours == pytest.approx(theirs, abs=1e-6)


GROUPS = {
    127250: ("Heading", DEG_PER_RAD, "heading_deg"),
    127251: ("Rate", DEG_PER_RAD, "yaw_rate_dps"),
    129025: ("Latitude", 1.0, "latitude_deg"),
    128259: ("Speed Water Referenced", 1.0, "speed_through_water_mps"),
}


def _ours(path: Path) -> list[float]:
    decoder, found = Nmea2000Decoder(), []
    for text in path.read_text().splitlines():
        parts = text.split(",")
        if text.startswith("#") or int(parts[2]) not in GROUPS:
            continue
        priority, group, source, data = int(parts[1]), int(parts[2]), int(parts[3]), parts[6:]
        frame = can_frame((priority << 26) | (group << 8) | source, "".join(data))
        got = values(decoder.decode(frame))
        quantity = GROUPS[group][2]
        found += [got[quantity]] if quantity in got else []
    return found


def _canboats(path: Path) -> list[float]:
    found = []
    with gzip.open(path, "rt") as stream:
        next(stream)
        for text in stream:
            message = json.loads(text)
            if message.get("pgn") not in GROUPS:
                continue
            field, scale, _ = GROUPS[message["pgn"]]
            fields = message.get("fields", {})
            if field not in fields or (message["pgn"] == 127250 and not _is_or_becomes_true(fields)):
                continue
            found.append(fields[field] * scale)
            if message["pgn"] == 127250 and fields["Reference"]["value"] == 1:
                to_true = fields["Variation"] + fields.get("Deviation", 0.0)
                found[-1] = (found[-1] + to_true * DEG_PER_RAD) % 360.0
    return found


def _is_or_becomes_true(fields: dict[str, Any]) -> bool:
    reference = fields["Reference"]["value"]
    return reference == 0 or (reference == 1 and "Variation" in fields)
