"""NMEA 0183: every sentence by hand, its flags and its holes, its envelope, and real logs against gpsd."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pynmeagps import NMEAReader

from seatrial.acquisition.config.sources import FileSource, Thrusters
from seatrial.acquisition.core.ship import BY_NAME, Actuator
from seatrial.acquisition.core.trial import Frame, Group, Quality, Sample, Trial
from seatrial.acquisition.logger.processing import Derivation
from seatrial.acquisition.logger.survey import _CARRIERS
from seatrial.acquisition.protocols import make_decoders
from seatrial.acquisition.protocols.nmea0183 import Nmea0183Decoder, frame_sentence, split_sentence, xor_checksum

SECOND = 1_000_000_000
KNOT = 1852.0 / 3600.0
MPH = 1609.344 / 3600.0
NOON = datetime(2026, 12, 31, 12, 0, 0, tzinfo=UTC)
NOON_NS = int(NOON.timestamp()) * SECOND


def line(text: bytes, at_s: float = 0.0) -> Frame:
    time_ns = round(at_s * SECOND)
    return Frame("line", "nmea0183", text, time_ns, time_ns)


def sound(body: str) -> bytes:
    return frame_sentence(body).strip()


def tagged(items: str, body: str) -> bytes:
    return f"\\{items}*{xor_checksum(items.encode()):02X}\\".encode() + sound(body)


def values(groups: list[Group]) -> dict[str, float]:
    return {sample.quantity: sample.value for group in groups for sample in group}


def decoded(body: str, decoder: Nmea0183Decoder | None = None) -> dict[str, float]:
    return values((decoder or Nmea0183Decoder()).decode(line(sound(body))))


READ = set(Nmea0183Decoder()._readers)
"""The sentences that are read, by their letters."""
SILENT = {"ZDA", "GST"}
"""Of these, time and the errors of the fix, which are no values of a channel."""


def refusal(body: str) -> str:
    """The one reason for which something in a sentence was refused, empty if nothing was."""
    decoder = Nmea0183Decoder()
    decoder.decode(line(sound(body)))
    assert decoder.refused.total() <= 1
    return next(iter(decoder.refused), "")


FIX = {"latitude_deg": 63.44, "longitude_deg": -10.4}  # 63 deg 26.4 min, 10 deg 24.0 min
FIX_TEXT = "6326.4,N,01024.0,W"
MOVING = {"course_over_ground_deg": 230.5, "speed_over_ground_mps": 5.6 * KNOT}


SAID: list[tuple[str, dict[str, float]]] = [
    (f"GPGGA,101112.50,{FIX_TEXT},4,12,0.6,0.0,M,0.0,M,,", FIX),
    ("GPGGA,101112,3354.6,S,15112.0,E,1,08,1.0,5.0,M", {"latitude_deg": -33.91, "longitude_deg": 151.2}),
    ("GPGGA,101112,3354.6,S,,,1,08,1.0,5.0,M,40.0,M,,", {}),
    (f"GNGGA,,{FIX_TEXT},1", FIX),
    (f"GPGGA,101112,{FIX_TEXT},1,twelve,x,y", FIX),
    (f"GPGLL,{FIX_TEXT},101112,A,A", FIX),
    (f"GPGLL,{FIX_TEXT},101112,A", FIX),
    (f"LCGLL,{FIX_TEXT}", FIX),
    (f"GPRMC,101112,A,{FIX_TEXT},5.6,230.5,200818,1.4,E,A,V", FIX | MOVING | {"magnetic_variation_deg": 1.4}),
    (f"GPRMC,101112,A,{FIX_TEXT},5.6,230.5,200818,1.4,W", FIX | MOVING | {"magnetic_variation_deg": -1.4}),
    (f"GPRMC,101112,A,{FIX_TEXT},5.6,230.5,200818,1.4,N", FIX | MOVING),
    ("GPRMC,101112,A,,,,,0.0,,200818,,,A", {"speed_over_ground_mps": 0.0}),
    ("GPVTG,230.5,T,229.1,M,5.6,N,10.4,K,A", MOVING),
    ("GPVTG,230.5,T,229.1,M,5.6,N,10.4,K", MOVING),
    ("GPVTG,,T,,M,,N,18.0,K,D", {"speed_over_ground_mps": 5.0}),
    ("GPVTG,230.5,229.1,5.6,10.4", MOVING),  # before NMEA 2.3: knots and km/h agree
    ("GPVTG,230.5,229.1,5.6,11.4", {}),
    ("GPVTG,230.5,T,229.1,M", {"course_over_ground_deg": 230.5}),
    ("GNGNS,101112,6326.4,N,01024.0,E,AA,18,0.7,23.4,40.1,,", {"latitude_deg": 63.44, "longitude_deg": 10.4}),
    ("GNGNS,101112,6326.4,N,01024.0,E,NR,18,0.7,23.4,40.1,,,V", {"latitude_deg": 63.44, "longitude_deg": 10.4}),
    ("GNGNS,101112,6326.4,N,01024.0,E,NN,00,99.9,,,,", {}),
    ("GNGNS,101112,,,,,A,08,0.7,,,,", {}),
    ("IIMWD,322.8,T,333.9,M,4.5,M", {"wind_direction_deg": 322.8, "wind_speed_mps": 4.5}),
    ("IIMWD,322.8,T,333.9,M,9.0,K", {"wind_direction_deg": 322.8, "wind_speed_mps": 2.5}),
    ("HEHDT,359.99,T", {"heading_deg": 359.99}),
    ("02HDT,12.5", {"heading_deg": 12.5}),
    ("HDT,12.5,T", {"heading_deg": 12.5}),
    ("HCHDT,12.5,M", {}),
    ("HETHS,12.5,A", {"heading_deg": 12.5}),
    ("HCHDG,101.1,2.0,E,7.1,W", {"heading_magnetic_deg": 103.1, "magnetic_variation_deg": -7.1}),
    ("HCHDG,1.0,2.0,W,7.1,E", {"heading_magnetic_deg": 359.0, "magnetic_variation_deg": 7.1}),
    ("HCHDG,359.0,2.0,E,,", {"heading_magnetic_deg": 1.0}),
    ("HCHDG,720.0,2.0,E,,", {"heading_magnetic_deg": 720.0}),  # for the range check to find
    (f"HEHDT,{'9' * 400},T", {}),
    ("SDHDG,229.8,,,1.3,E", {"heading_magnetic_deg": 229.8, "magnetic_variation_deg": 1.3}),
    ("SDHDG,,,,1.3,E", {"magnetic_variation_deg": 1.3}),
    ("SDHDG,229.8", {"heading_magnetic_deg": 229.8}),
    ("APHDM,12.5,M", {"heading_magnetic_deg": 12.5}),
    ("TIROT,-30.0,A", {"yaw_rate_dps": -0.5}),
    ("VDVBW,9.0,1.0,A,10.0,-2.0,A", {
        "speed_through_water_mps": 9.0 * KNOT, "surge_mps": 10.0 * KNOT, "sway_mps": -2.0 * KNOT,
    }),
    ("VDVBW,9.0,1.0,A,,,V,,V,,V", {"speed_through_water_mps": 9.0 * KNOT}),
    ("VDVBW,9.0,1.0,V,10.0,,A,,V,,V", {"surge_mps": 10.0 * KNOT}),
    ("SDVHW,231.3,T,229.9,M,6.6,N,12.3,K", {"speed_through_water_mps": 6.6 * KNOT}),
    ("SDVHW,,,,,,,18.0,K", {"speed_through_water_mps": 5.0}),
    ("WIMWD,328.2,T,326.8,M,10.0,N,5.1,M", {"wind_direction_deg": 328.2, "wind_speed_mps": 10.0 * KNOT}),
    ("WIMWD,328.2,T,,M,,N,5.1,M", {"wind_direction_deg": 328.2, "wind_speed_mps": 5.1}),
    ("WIMWD,,T,326.8,M,,N,5.1,M", {"wind_direction_magnetic_deg": 326.8, "wind_speed_mps": 5.1}),
    ("WIMWD,,,,,,,5.1,M", {"wind_speed_mps": 5.1}),
    ("WIMDA,29.75,I,1.0076,B,35.5,C,,,42.1,,20.6,C,116.4,T,107.7,M,10.0,N,5.1,M", {
        "wind_direction_deg": 116.4, "wind_speed_mps": 10.0 * KNOT,
    }),
    ("WIMDA,29.75,I,1.0076,B,35.5,C,,,42.1,,20.6,C,,T,,M,,N,,M", {}),
    ("PASHR,101112.500,312.66,T,-0.76,0.11,-0.36,0.083,0.083,0.092,1,1", {"heading_deg": 312.66}),
    ("PASHR,ATT,101112.5,312.66,0.11,-0.76,0.0012,0.0010,0", {}),  # of Ashtech's receivers
    ("WIMWV,57.5,R,13.0,N,A", {"wind_angle_apparent_deg": 57.5, "wind_speed_apparent_mps": 13.0 * KNOT}),
    ("WIMWV,57.5,R,18.0,K,A", {"wind_angle_apparent_deg": 57.5, "wind_speed_apparent_mps": 5.0}),
    ("WIMWV,57.5,R,13.0,M,A", {"wind_angle_apparent_deg": 57.5, "wind_speed_apparent_mps": 13.0}),
    ("WIMWV,57.5,R,10.0,S,A", {"wind_angle_apparent_deg": 57.5, "wind_speed_apparent_mps": 10.0 * MPH}),
    ("WIMWV,57.5,R,,,A", {"wind_angle_apparent_deg": 57.5}),
    ("WIMWV,302.5,T,13.0,M,A", {"wind_angle_theoretical_deg": 302.5, "wind_speed_theoretical_mps": 13.0}),
    ("IIVWR,45.0,L,10.0,N,5.1,M,18.5,K", {
        "wind_angle_apparent_deg": -45.0, "wind_speed_apparent_mps": 10.0 * KNOT,
    }),
    ("IIVWR,45.0,R,,,5.1,M,,", {"wind_angle_apparent_deg": 45.0, "wind_speed_apparent_mps": 5.1}),
    ("IIVWR,45.0,R,,,,,18.0,K", {"wind_angle_apparent_deg": 45.0, "wind_speed_apparent_mps": 5.0}),
    ("IIVWR,181.0,L,,N,,M,,K", {}),
    ("IIVWT,45.0,L,10.0,N,,,,", {
        "wind_angle_theoretical_deg": -45.0, "wind_speed_theoretical_mps": 10.0 * KNOT,
    }),
    ("ERRSA,-5.0,A,7.0,A", {"rudder_angle_deg": -5.0}),
    ("ERRSA,,V,7.0,A", {"rudder_angle_deg": 7.0}),
    ("ERRPM,S,1,-120.0,90.0,A", {"starboard_rpm": -120.0}),
    ("ERRPM,S,2,120.0,90.0,A", {"port_rpm": 120.0}),
    ("RCTRD,2,400.5,R,,V,90.8", {"port_rpm": 400.5, "port_angle_deg": 90.8}),
    ("RCTRD,4,,V,,V,90.8", {"starboard_angle_deg": 90.8}),
    ("RCTRD,1,-17.8,R,,V,12.0", {"tunnel_rpm": -17.8}),
    ("RCTRC,2,402.6,R,,V,88.3,B,C", {"port_order_rpm": 402.6, "port_order_angle_deg": 88.3}),
    ("RCTRC,4,-40.0,R,,V,,B,R", {"starboard_order_rpm": -40.0}),
    ("RCTRC,1,-17.8,R,,V,,B,C", {"tunnel_order_rpm": -17.8}),
]  # fmt: skip
"""Sentences and what each says."""


@pytest.mark.parametrize(("body", "expected"), SAID)
def test_what_each_sentence_says(body: str, expected: dict[str, float]) -> None:
    assert decoded(body) == pytest.approx(expected, rel=1e-12)


def test_a_missing_channel_is_told_every_sentence_that_would_carry_it() -> None:
    """What a sentence says stands with it in the survey's table, from which `record --check` explains."""
    for body, expected in SAID:
        tag = body.partition(",")[0]
        kind = tag if tag.startswith("P") else tag[-3:]
        for name in set(expected) & set(_CARRIERS):
            assert kind in _CARRIERS[name], (kind, name)


def test_every_sentence_that_is_read_is_in_the_guide() -> None:
    page = (Path(__file__).parents[2] / "docs" / "howto" / "add_a_sensor.md").read_text(encoding="utf-8")
    rudder = (Actuator("rudder", "rudder"),)
    assert {kind for kind in READ | set(Nmea0183Decoder(actuators=rudder)._readers) if kind not in page} == set()


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (b"$RCTRD,3,-17.8,R,,V,*59", {}),  # published examples, as printed; our tunnel has number 1
        (b"$RCTRD,2,400.5,R,,V,90.8*55", {"port_rpm": 400.5, "port_angle_deg": 90.8}),
        (b"$RCTRC,2,402.6,R,,V,88.3,B,C*50", {"port_order_rpm": 402.6, "port_order_angle_deg": 88.3}),
        (sound("HEHDT,12.3,T").lower(), {}),
        (b"$HEHDT,12.3,T*1f", {"heading_deg": 12.3}),
        (b"$$HEHDT,12.3,T*1F", {"heading_deg": 12.3}),
        (sound("HEHDT,12.3,T")[:-2] + b"00", {}),
        (b"$HEHDT,12.3,T", {}),
        (b"$HEHDT,12.3,T*+F", {}),
        (b"\xff\xfe rubbish", {}),
        (sound("PMHDT,12.3,T"), {}),
        (sound("GP/a:HDT,12.3,T"), {}),
        (sound("HEXDR,A,0.135,D,PTCH"), {}),
    ],
)
def test_lines_as_they_come(text: bytes, expected: dict[str, float]) -> None:
    assert values(Nmea0183Decoder().decode(line(text))) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        (f"GPGGA,101112,{FIX_TEXT},0,08,1.0,5.0,M,40.0,M,,", "not marked valid"),
        (f"GPGGA,101112,{FIX_TEXT},,", "not marked valid"),
        (f"GPGLL,{FIX_TEXT},101112,V,A", "not marked valid"),
        (f"GPGLL,{FIX_TEXT},101112,A,N", "not marked valid"),
        (f"GPRMC,101112,V,{FIX_TEXT},5.6,230.5,200818,,,A", "not marked valid"),
        (f"GPRMC,101112,A,{FIX_TEXT},5.6,230.5,200818,,,N", "not marked valid"),
        ("GPVTG,230.5,T,229.1,M,5.6,N,10.4,K,N", "not marked valid"),
        ("GPVTG,230.5,229.1,5.6,11.4", "a form that is not known"),
        ("GNGNS,101112,6326.4,N,01024.0,E,NN,00,99.9,,,,", "not marked valid"),
        ("HETHS,12.5,V", "not marked valid"),
        ("HETHS,12.5", "not marked valid"),
        ("TIROT,-30.0,V", "not marked valid"),
        ("TIROT,-30.0", "not marked valid"),
        ("VDVBW,9.0,1.0,V,10.0,-2.0,A", "not marked valid"),
        ("VDVBW,9.0,1.0,A,10.0,-2.0,V", "not marked valid"),
        ("VDVBW,,,V,10.0,-2.0,A,,V,,V", ""),
        ("WIMWV,57.5,R,13.0,N,V", "not marked valid"),
        ("WIMWV,57.5,R,13.0,N", "not marked valid"),
        ("WIMWV,57.5,X,13.0,N,A", "wind reference unknown"),
        ("WIMWV,57.5,R,13.0,F,A", "unit unknown"),
        ("ERRSA,-5.0,V,7.0,V", "not marked valid"),
        ("ERRPM,S,1,120.0,90.0,V", "not marked valid"),
        ("ERRPM,E,1,1800.0,90.0,A", "engine rpm"),
        ("ERRPM,S,0,120.0,90.0,A", "rpm of a single or unknown shaft"),
        ("ERRPM,S,1.5,120.0,90.0,A", "rpm of a single or unknown shaft"),
        ("RCTRD,2,40.0,P,,V,90.8", "thruster in percent"),
        ("RCTRC,2,40.0,P,,V,90.8,B,C", "thruster in percent"),
        ("RCTRD,2,40.0,V,,V,90.8", "not marked valid"),
        ("RCTRD,7,40.0,R,,V,90.8", "thruster not understood"),
        ("RCTRD,,40.0,R,,V,90.8", "thruster not understood"),
        ("HEHDT,,T", "no value"),
        ("HEHDT,abc,T", "no value"),
        ("GPZDA,,,,,,", "no time"),
        ("GPZDA,120000,31,02,2026,00,00", "no time"),
        ("GPZDA,250000,01,02,2026,00,00", "no time"),
        ("GPZDA,120000,31,12,2026,00,00", ""),
        ("GPGSV,1,1,00", ""),
    ],
)
def test_what_is_left_out_is_counted_by_reason(body: str, reason: str) -> None:
    assert refusal(body) == reason


@pytest.mark.parametrize("talker", ["GP", "GN", "II", "AP", "02", "YD"])
def test_a_percentage_takes_no_angle_with_it_and_any_talker_will_do(talker: str) -> None:
    assert decoded(f"{talker}TRD,2,40.0,P,,V,90.8") == {"port_angle_deg": 90.8}


@pytest.mark.parametrize("body", [
    "GPGGA,101112,{fix},{digit},08,1.0,5.0,M,40.0,M,,", "GPGLL,{fix},101112,A,{letter}",
    "GPRMC,101112,A,{fix},5.6,230.5,200818,,,{letter}", "GPVTG,230.5,T,,M,5.6,N,,K,{letter}", "HETHS,12.5,{letter}",
])  # fmt: skip
@pytest.mark.parametrize(
    ("digit", "letter", "quality"),
    [
        ("1", "A", Quality.NOT_EVALUATED),
        ("6", "E", Quality.SUSPECT),  # dead reckoning
        ("7", "M", Quality.SUSPECT),  # typed in by hand
        ("8", "S", Quality.SUSPECT),  # a simulator
    ],
)
def test_what_is_no_measurement_is_suspect(body: str, digit: str, letter: str, quality: Quality) -> None:
    """It is reported once, not with every sentence."""
    decoder = Nmea0183Decoder()
    for at_s in range(3):
        groups = decoder.decode(line(sound(body.format(fix=FIX_TEXT, digit=digit, letter=letter)), at_s))
        assert {sample.quality for group in groups for sample in group} == {quality}
    assert sum("estimated" in text for _, text in decoder.notices) == (quality is Quality.SUSPECT)


def test_theoretical_wind_is_what_the_vessel_says_it_is() -> None:
    for reference, name in (("ground", "theoretical"), ("water", "water")):
        decoder = Nmea0183Decoder(theoretical_wind=reference)  # type: ignore[arg-type]
        for body in ("WIMWV,30.0,T,13.0,M,A", "WIVWT,30.0,R,,,13.0,M,,"):
            found = decoded(body, decoder)
            assert found == pytest.approx({f"wind_angle_{name}_deg": 30.0, f"wind_speed_{name}_mps": 13.0})


def test_the_settings_of_a_line_reach_its_decoder() -> None:
    section = FileSource(
        name="line", type="file", path=Path("x"), channels=(), theoretical_wind="water",
        thrusters=Thrusters(port=6, channels_from="demand"),
    )  # fmt: skip
    (decoder,) = make_decoders(section)
    assert isinstance(decoder, Nmea0183Decoder)
    assert "wind_angle_water_deg" in decoded("WIMWV,30.0,T,13.0,M,A", decoder)
    assert decoded("RCTRC,6,50.0,R,,V,30.0,B,C", decoder) == {
        "port_order_rpm": 50.0, "port_order_angle_deg": 30.0, "port_rpm": 50.0, "port_angle_deg": 30.0,
    }  # fmt: skip
    assert decoded("RCTRD,6,49.0,R,,V,30.0", decoder) == {}
    assert decoder.refused == {"thruster response where demands are wanted": 1}


@pytest.mark.parametrize(
    ("text", "label"),
    [
        (sound("WIMWV,57.5,R,13.0,N,A"), "line/WI:MWV apparent"),
        (sound("WIMWV,57.5,T,13.0,N,A"), "line/WI:MWV theoretical"),
        (sound("IIVWR,45.0,L,10.0,N,,,,"), "line/II:VWR apparent"),
        (sound("WIMWD,,T,326.8,M,,N,5.1,M"), "line/WI:MWD magnetic"),
        (sound("WIMWD,1.0,T,326.8,M,,N,5.1,M"), "line/WI:MWD"),
        (sound("VDVBW,9.0,1.0,A,10.0,-2.0,A"), "line/VD:VBW"),
        (sound("ERRPM,S,3,120.0,90.0,A"), "line/ER:RPM shaft 3"),
        (sound("HDT,12.5,T"), "line/:HDT"),
        (tagged("s:GN01", "HEHDT,12.5,T"), "line/HE@GN01:HDT"),
        (tagged("s:a/b:c d", "HEHDT,12.5,T"), "line/HE@a_b_c_d:HDT"),
    ],
)
def test_a_label_tells_who_said_what(text: bytes, label: str) -> None:
    (group,) = Nmea0183Decoder().decode(line(text))
    assert {sample.source for sample in group} == {label}


# Time.


def zda(text: str) -> bytes:
    return sound(f"GPZDA,{text},00,00")


def gga(clock: str) -> bytes:
    return sound(f"GPGGA,{clock},6326.4,N,01024.0,E,4,12,0.6,0.0,M,0.0,M,,")


def heading(decoder: Nmea0183Decoder, at_s: float) -> Sample:
    ((sample,),) = decoder.decode(line(sound("HEHDT,12.3,T"), at_s))
    return sample


def test_position_signs_and_the_date_from_zda() -> None:
    decoder = Nmea0183Decoder(stamps="source")
    decoder.decode(line(zda("235959.500,31,12,2026"), 10.0))
    fix = sound("GPGGA,000000.250,3354.6,S,15112.0,W,4,12,0.6,0.0,M,0.0,M,,")
    (latitude, longitude), *_ = decoder.decode(line(fix, 10.75))
    assert (latitude.value, longitude.value) == pytest.approx((-33.91, -151.2))
    assert latitude.measured_ns == 1_798_761_600_250_000_000  # 2027-01-01T00:00:00.25


@pytest.mark.parametrize(
    ("clock", "at_s", "expected"),
    [
        ("235959.900", 10.7, 1_798_761_599_900_000_000),  # 0.2 s under way, across midnight
        ("000000.000", 10.4, 1_798_761_600_000_000_000),  # the next day's first fix, a little early
        ("235960.000", 10.6, 1_798_761_600_000_000_000),  # a leap second has no number of its own
    ],
)
def test_a_fix_at_midnight_belongs_to_the_day_that_is_nearer(clock: str, at_s: float, expected: int) -> None:
    decoder = Nmea0183Decoder(stamps="source")
    decoder.decode(line(zda("235959.500,31,12,2026"), 10.0))
    (latitude, *_), *_ = decoder.decode(line(gga(clock), at_s))
    assert latitude.measured_ns == expected


@pytest.mark.parametrize("date", ["06,01,1980", "20,04,2006", "01,01,2300", "31,12,9999", "01,01,0000", "20,08,18"])
def test_a_date_that_cannot_be_is_not_believed(date: str) -> None:
    """The year 9999 would not fit into the recording, 2300 would make it unreadable; 1980 is a GPS without fix."""
    decoder = Nmea0183Decoder(stamps="source")
    decoder.decode(line(zda(f"120000.000,{date}"), 10.0))
    sample = heading(decoder, 10.5)
    assert (sample.measured_ns, sample.source_ns, sample.clock) == (10.5 * SECOND, None, "receiver")


@pytest.mark.parametrize(
    ("status", "date", "believed"), [("A", "311226", True), ("V", "311226", False), ("A", "060180", False)]
)
def test_rmc_sets_the_clock_when_it_has_a_fix(status: str, date: str, believed: bool) -> None:
    decoder = Nmea0183Decoder(stamps="source")
    decoder.decode(line(sound(f"GPRMC,120000.00,{status},{FIX_TEXT},5.6,230.5,{date},,,A"), 10.0))
    assert heading(decoder, 10.5).source_ns == (NOON_NS + SECOND // 2 if believed else None)


def test_a_source_clock_that_goes_back_is_recorded_as_it_says() -> None:
    """The time of reception goes on beside it, so that the jump can be found and undone."""
    decoder = Nmea0183Decoder(stamps="source")
    stamps = []
    for clock, at_s in (("120000.000", 10.0), ("110000.000", 11.0)):
        decoder.decode(line(zda(f"{clock},31,12,2026"), at_s))
        stamps.append(heading(decoder, at_s))
    assert stamps[1].measured_ns - stamps[0].measured_ns == -3600 * SECOND
    assert stamps[1].received_ns - stamps[0].received_ns == SECOND


# Properties.

TAGS = [kind if len(kind) > 3 else f"II{kind}" for kind in sorted(READ)]
FIELD = st.one_of(
    st.sampled_from([*"ATRPVNEMSKLFWQ", "", "NaN", "inf", "-inf", "1e400", "1_0", "-0.0", "9" * 5000, "360", "1"]),
    st.floats(-1000, 1000).map(lambda value: f"{value:.3f}"),
    st.integers(0, 10**7).map(str),
    st.text(st.characters(min_codepoint=32, max_codepoint=126, exclude_characters="*$!,\\"), max_size=8),
)


@given(st.binary(max_size=100))
def test_no_bytes_on_a_line_raise(noise: bytes) -> None:
    decoder = Nmea0183Decoder()
    spoilt_tag = b"\\" + noise + b"*00\\$HEHDT,12.3,T*1F"
    for text in (noise, b"$" + noise + b"*00", b"\\" + noise, spoilt_tag, b"UdPbC\0" + noise):
        decoder.decode(line(text))


@given(st.sampled_from(TAGS), st.lists(FIELD, max_size=14), st.sampled_from(["ground", "water"]))
def test_any_fields_give_finite_values_that_channels_can_hold(tag: str, fields: list[str], wind: str) -> None:
    text = sound(",".join([tag, *fields]))
    assert split_sentence(text) is not None
    decoder = Nmea0183Decoder(Thrusters(channels_from="demand"), "source", wind)  # type: ignore[arg-type]
    decoder.decode(line(zda("120000,31,12,2026")))
    derivation = Derivation(Trial(name="any"), frozenset({"line"}))
    for group in decoder.decode(line(text)):
        assert all(math.isfinite(sample.value) for sample in group)
        samples, _ = derivation.derive_channels(group)
        assert all(BY_NAME[sample.quantity].is_possible_value(sample.value) for sample in samples)


@given(st.sampled_from(TAGS), st.lists(FIELD, max_size=14))
def test_nothing_is_dropped_without_a_count(tag: str, fields: list[str]) -> None:
    decoder = Nmea0183Decoder()
    groups = decoder.decode(line(sound(",".join([tag, *fields]))))
    assert groups or decoder.refused.total() or (tag[2:] in SILENT and fields)


@given(st.floats(-89.9, 89.9), st.floats(-179.9, 179.9), st.integers(0, 86_399_999))
def test_fixes_are_read_as_by_another_reader(latitude_deg: float, longitude_deg: float, of_day_ms: int) -> None:
    def text(angle: float, digits: int, letters: str) -> str:
        degrees, minutes = divmod(min(abs(angle), 179.99) * 60.0, 60.0)
        return f"{degrees:0{digits}.0f}{min(minutes, 59.99999):08.5f},{letters[angle < 0]}"

    clock = datetime.fromtimestamp(NOON_NS // SECOND - 43_200 + of_day_ms / 1000, UTC).strftime("%H%M%S.%f")[:-3]
    fix = f"{text(latitude_deg, 2, 'NS')},{text(longitude_deg, 3, 'EW')}"
    body = f"GPRMC,{clock},A,{fix},5.6,230.5,311226,,,A"
    theirs = NMEAReader.parse(frame_sentence(body))
    group = Nmea0183Decoder().decode(line(sound(body)))[0]
    ours = values([group])
    assert (ours["latitude_deg"], ours["longitude_deg"]) == pytest.approx((theirs.lat, theirs.lon), abs=1e-9)
    assert group[0].source_ns == int(datetime.combine(theirs.date, theirs.time, UTC).timestamp() * 1000) * 10**6


# Real logs.

LOGS = ["bundg_zeus_9.log", "pypilot.log", "rst39.log", "saab-r4.log"]


def log_lines(path: Path) -> list[bytes]:
    lines = (each.strip() for each in path.read_bytes().splitlines())
    return [each for each in lines if each and not each.startswith(b"#")]


@pytest.mark.shared
@pytest.mark.parametrize("name", LOGS)
def test_every_known_sentence_of_a_real_log_says_something(shared_data: Path, name: str) -> None:
    """These logs are clean: no known sentence is refused, and each gives a group that has a value."""
    decoder, known = Nmea0183Decoder(), READ - SILENT
    for text in log_lines(shared_data / "nmea0183" / name):
        groups = decoder.decode(line(text))
        tag = text[1:].split(b",")[0].decode()
        assert bool(groups) == ((tag if tag.startswith("P") else tag[-3:]) in known)
    assert not decoder.refused


@dataclass
class Heard:
    """What the sentences said since the receiver's second began: gpsd forgets, and makes up what is missing."""

    values: dict[str, float] = field(default_factory=dict)
    time_ns: int | None = None

    def hear(self, groups: list[Group]) -> None:
        for sample in (sample for group in groups for sample in group):
            if sample.quantity == "latitude_deg" and sample.source_ns != self.time_ns:
                self.values, self.time_ns = {}, sample.source_ns
            if sample.source.endswith("VTG"):  # its magnetic course takes the place of the heading in gpsd's report
                self.values.pop("heading_magnetic_deg", None)
            told_by = sample.source[-3:] if sample.quantity == "magnetic_variation_deg" else ""
            self.values[sample.quantity + told_by] = sample.value


GPSD = {  # their field, our quantity, the last digit that they or the sentence print
    "lat": ("latitude_deg", 1e-9), "lon": ("longitude_deg", 1e-9), "track": ("course_over_ground_deg", 1e-4),
    "speed": ("speed_over_ground_mps", 1e-3), "magtrack": ("heading_magnetic_deg", 1e-4),
    "magvar": ("magnetic_variation_degRMC", 0.1), "wangler": ("wind_angle_apparent_deg", 0.1),
    "wspeedr": ("wind_speed_apparent_mps", 0.1), "wanglet": ("wind_direction_deg", 0.1),
    "wspeedt": ("wind_speed_mps", 0.2),  # two roundings: theirs is of MWD's m/s, ours of its knots
}  # fmt: skip


def reports(path: Path) -> Iterator[tuple[Heard, dict[str, float | str]]]:
    """gpsd's reports of fixes with what the sentences before each said."""
    decoder, heard = Nmea0183Decoder(), Heard()
    for number, text in enumerate(path.read_bytes().splitlines()):
        if text.startswith(b"$"):
            heard.hear(decoder.decode(line(text, number / 100)))
        elif text.startswith(b"{") and (report := json.loads(text))["class"] == "TPV":
            yield heard, report


@pytest.mark.shared
def test_a_real_log_is_read_as_by_gpsd(shared_data: Path) -> None:
    compared: Counter[str] = Counter()
    for heard, report in reports(shared_data / "nmea0183" / "bundg_zeus_9.log.chk"):
        for name, (quantity, step) in GPSD.items():
            if name in report and quantity in heard.values:
                assert abs(heard.values[quantity] - float(report[name])) <= step / 2 * 1.0001, (name, report)
                compared[name] += 1
        if "time" in report and heard.time_ns is not None:
            assert datetime.fromisoformat(str(report["time"])).timestamp() * SECOND == heard.time_ns
            compared["time"] += 1
    assert set(compared) == {*GPSD, "time"}
    assert min(compared.values()) > 90
