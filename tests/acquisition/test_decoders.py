"""Each protocol: published examples, the traps of its framing, and only values that a channel can hold."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from acquisition.decoders.nmea0183 import Nmea0183Decoder, split_sentence
from acquisition.encoders.nmea0183 import sentence
from acquisition.frames import Frame, Sample

SECOND = 1_000_000_000


def line(text: bytes, at_s: float = 0.0) -> Frame:
    time_ns = round(at_s * SECOND)
    return Frame("line", "nmea0183", text, time_ns, time_ns)


def values(groups: list[list[Sample]]) -> dict[str, float]:
    return {sample.quantity: sample.value for group in groups for sample in group}


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
