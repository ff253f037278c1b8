"""Each protocol: published examples, the traps of its framing, and only values that a channel can hold."""

from __future__ import annotations

import gzip
import json
import math
import struct
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from acquisition.decoders import Decoder, make_decoders
from acquisition.decoders.clock import SourceClock
from acquisition.decoders.dbc import DbcDecoder
from acquisition.decoders.mavlink import MavlinkDecoder
from acquisition.decoders.nmea0183 import Nmea0183Decoder, split_sentence
from acquisition.decoders.nmea2000 import Nmea2000Decoder, parameter_group
from acquisition.encoders.nmea0183 import sentence
from acquisition.frames import Frame, FrameFlag, Sample
from acquisition.sections import CanSource, MavlinkSource, Signal
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


def test_one_device_is_the_clock_of_a_bus() -> None:
    """A second device's time, 13 h later, is taken only when the first has been silent."""
    decoder = Nmea2000Decoder("source")
    decoder.decode(can_frame(0x0DF01023, "01f02a51d22e7515", 100.0))
    decoder.decode(can_frame(0x0DF01024, "01f02a51d2000000", 100.1))
    (sample,) = decoder.decode(can_frame(HEADING, "ff10270000ff7ffc", 100.25))[0]
    assert sample.measured_ns == 1_795_255_200_123_400_000 + SECOND // 4
    decoder.decode(can_frame(0x0DF01024, "01f02a51d2000000", 110.0))
    (sample,) = decoder.decode(can_frame(HEADING, "ff10270000ff7ffc", 110.0))[0]
    assert sample.clock == "nmea2000 126992"
    assert sample.measured_ns < 1_795_255_200_000_000_000


def test_system_time_beyond_a_day_is_not_believed() -> None:
    decoder = Nmea2000Decoder("source")
    decoder.decode(can_frame(0x0DF01023, "01f02a51fcffffff"[:8] + "00f0ff7f", 100.0))
    (sample,) = decoder.decode(can_frame(HEADING, "ff10270000ff7ffc", 100.25))[0]
    assert sample.clock == "receiver"


def test_a_gnss_position_without_a_fix_is_no_position() -> None:
    """129029 in seven frames; the same message with method 1 (GNSS fix) is a position."""
    for method, expected in ((0, set()), (1, {"latitude_deg", "longitude_deg"})):
        body = struct.pack(
            "<BHIqqqBBBhhiB", 1, 20000, 360_000_000, int(63.4e16), int(10.4e16), 0, method << 4, 0xFC, 0, 9, 9, 0, 0
        )
        parts = [bytes([0, len(body)]) + body[:6]]
        parts += [
            bytes([number]) + body[start : start + 7].ljust(7, b"\xff")
            for number, start in enumerate(range(6, len(body), 7), start=1)
        ]
        decoder, found = Nmea2000Decoder(), {}
        for part in parts:
            found |= values(decoder.decode(can_frame(0x0DF80523, part.hex())))
        assert set(found) == expected


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


def zda(text: str) -> bytes:
    return sentence(f"GPZDA,{text},00,00").strip()


def gga(clock: str) -> bytes:
    return sentence(f"GPGGA,{clock},6326.4,N,01024.0,E,4,12,0.6,0.0,M,0.0,M,,").strip()


@pytest.mark.parametrize(
    ("clock", "at_s", "expected"),
    [
        ("235959.900", 10.7, 1_798_761_599_900_000_000),  # 0.2 s under way, across midnight
        ("000000.000", 10.4, 1_798_761_600_000_000_000),  # the next day's first fix, a little early
    ],
)
def test_a_fix_at_midnight_belongs_to_the_day_that_is_nearer(clock: str, at_s: float, expected: int) -> None:
    decoder = Nmea0183Decoder(stamps="source")
    decoder.decode(line(zda("235959.500,31,12,2026"), 10.0))
    (latitude, *_), *_ = decoder.decode(line(gga(clock), at_s))
    assert latitude.measured_ns == expected


@pytest.mark.parametrize("date", ["06,01,1980", "20,04,2006", "01,01,2300", "31,12,9999"])
def test_a_date_that_cannot_be_is_not_believed(date: str) -> None:
    """The year 9999 would not fit into the recording, 2300 would make it unreadable; 1980 is a GPS without fix."""
    decoder = Nmea0183Decoder(stamps="source")
    decoder.decode(line(zda(f"120000.000,{date}"), 10.0))
    (sample,) = decoder.decode(line(sentence("HEHDT,12.3,T").strip(), 10.5))[0]
    assert (sample.measured_ns, sample.source_ns, sample.clock) == (10.5 * SECOND, None, "receiver")


def test_a_source_clock_that_goes_back_is_recorded_as_it_says() -> None:
    """The time of reception goes on beside it, so that the jump can be found and undone."""
    decoder = Nmea0183Decoder(stamps="source")
    stamps = []
    for clock, at_s in (("120000.000", 10.0), ("110000.000", 11.0)):
        decoder.decode(line(zda(f"{clock},31,12,2026"), at_s))
        stamps += decoder.decode(line(sentence("HEHDT,12.3,T").strip(), at_s))[0]
    assert stamps[1].measured_ns - stamps[0].measured_ns == -3600 * SECOND
    assert stamps[1].received_ns - stamps[0].received_ns == SECOND


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


def link_frame(message: Any, at_s: float, system: int = 1) -> Frame:
    from pymavlink.dialects.v20 import ardupilotmega as dialect

    payload = bytes(message.pack(dialect.MAVLink(None, srcSystem=system, srcComponent=1)))
    return Frame("link", "mavlink", payload, round(at_s * SECOND), round(at_s * SECOND))


def test_a_restarted_autopilot_is_not_stamped_with_its_former_life() -> None:
    """time_boot_ms falls back to zero; until SYSTEM_TIME comes again nobody knows what its clock says."""
    from pymavlink.dialects.v20 import ardupilotmega as dialect

    link = dialect.MAVLink(None)
    decoder = MavlinkDecoder(MavlinkSource(name="link", type="mavlink", port=1, channels=(), clock="source"))
    utc_us = 1_795_255_200_000_000
    decoder.decode(link_frame(link.system_time_encode(utc_us, 3_600_000), 100.0))
    (before, *_), *_ = decoder.decode(link_frame(link.attitude_encode(3_600_100, 0, 0, 1, 0, 0, 0), 100.1))
    (after, *_), *_ = decoder.decode(link_frame(link.attitude_encode(2_000, 0, 0, 1, 0, 0, 0), 102.0))
    decoder.decode(link_frame(link.system_time_encode(utc_us + 3_000_000, 3_000), 103.0))
    (again, *_), *_ = decoder.decode(link_frame(link.attitude_encode(3_100, 0, 0, 1, 0, 0, 0), 103.1))
    assert before.measured_ns == utc_us * 1000 + SECOND // 10
    assert (after.source_ns, after.clock, after.measured_ns) == (None, "receiver", 102 * SECOND)
    assert again.measured_ns == utc_us * 1000 + 3 * SECOND + SECOND // 10


@pytest.mark.parametrize("utc_us", [0, 2**64 - 1, 10**15])
def test_an_autopilot_that_does_not_know_the_time(utc_us: int) -> None:
    from pymavlink.dialects.v20 import ardupilotmega as dialect

    link = dialect.MAVLink(None)
    decoder = MavlinkDecoder(MavlinkSource(name="link", type="mavlink", port=1, channels=(), clock="source"))
    decoder.decode(link_frame(link.system_time_encode(utc_us, 1000), 10.0))
    (sample, *_), *_ = decoder.decode(link_frame(link.attitude_encode(1100, 0, 0, 1, 0, 0, 0), 10.1))
    assert (sample.source_ns, sample.measured_ns) == (None, 10.1 * SECOND)


def test_an_autopilot_without_a_fix_sends_no_position() -> None:
    from pymavlink.dialects.v20 import ardupilotmega as dialect

    link = dialect.MAVLink(None)
    message = link.global_position_int_encode(0, 0, 0, 0, 0, 150, 0, 0, 0)
    assert values(mavlink_decoder().decode(link_frame(message, 1.0))) == {
        "velocity_north_mps": 1.5,
        "velocity_east_mps": 0.0,
    }


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
