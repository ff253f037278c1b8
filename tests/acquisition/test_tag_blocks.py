"""What is around a sentence: TAG blocks, datagrams, the cuts of a stream, and logs that keep their own time."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from seatrial.acquisition.config.sources import FileSource
from seatrial.acquisition.core.trial import Frame
from seatrial.acquisition.protocols.nmea0183 import Nmea0183Decoder, TaggedSentence, split_tag_block
from seatrial.acquisition.sources.lines import LineAssembler
from seatrial.acquisition.sources.log_file import LogFile
from tests.acquisition.test_nmea0183 import NOON_NS, SECOND, gga, heading, line, sound, tagged


@pytest.mark.parametrize(
    ("items", "time_ns", "source"),
    [
        (f"s:GN01,c:{NOON_NS // SECOND}", NOON_NS, "GN01"),
        (f"c:{NOON_NS // 10**6 + 250},n:5,g:1-2-34", NOON_NS + SECOND // 4, ""),
        (f"c:{NOON_NS // SECOND}.25", NOON_NS + SECOND // 4, ""),
        ("g:1-2-34,s:r003669945", None, "r003669945"),
        ("c:noon", None, ""),
        ("c:", None, ""),
        ("", None, ""),
    ],
)
def test_a_tag_block_tells_time_and_source(items: str, time_ns: int | None, source: str) -> None:
    text = tagged(items, "HEHDT,12.3,T")
    for each in (text, b"UdPbC\0" + text):
        assert split_tag_block(each) == TaggedSentence(sound("HEHDT,12.3,T"), time_ns, source)


def test_a_tag_blocks_time_is_the_sentences_and_sets_the_clock() -> None:
    decoder = Nmea0183Decoder(stamps="source")
    ((first,),) = decoder.decode(line(tagged(f"c:{NOON_NS // SECOND}", "HEHDT,12.3,T"), 10.0))
    assert (first.measured_ns, first.source_ns, first.clock) == (NOON_NS, NOON_NS, "nmea0183 ZDA, RMC or TAG")
    assert heading(decoder, 10.5).measured_ns == NOON_NS + SECOND // 2
    (fix, *_), *_ = decoder.decode(
        line(tagged(f"c:{NOON_NS // SECOND + 1}", gga("120000.900")[1:-3].decode()), 11.0)
    )
    assert fix.measured_ns == NOON_NS + SECOND * 9 // 10  # when it was measured, not when it was passed on


@pytest.mark.parametrize(
    "spoil",
    [
        lambda text: text.replace(b"c:1", b"c:2"),
        lambda text: text.replace(b"\\$", b"$"),
        lambda text: text.replace(b"*", b"", 1),
    ],
)
def test_a_spoilt_tag_block_is_ignored_and_counted(spoil: object) -> None:
    decoder = Nmea0183Decoder(stamps="source")
    text = spoil(tagged(f"c:{NOON_NS // SECOND}", "HEHDT,12.3,T"))  # type: ignore[operator]
    found = [sample for group in decoder.decode(line(text, 10.0)) for sample in group]
    assert all(sample.source_ns is None for sample in found)
    assert decoder.refused["TAG block with a wrong checksum"] == 1
    assert len(found) + decoder.refused["no sound checksum"] == 1


@given(st.lists(st.sampled_from(["GPGGA,1", "HEHDT,12.3,T"]), min_size=1), st.data())
def test_lines_stay_whole_however_they_arrive(bodies: list[str], data: st.DataObject) -> None:
    texts = [b"UdPbC\0" + tagged("s:GN01,c:1795255200", body) for body in bodies]
    end = data.draw(st.sampled_from([b"\r\n", b"\n", b"\r", b"\r\n\0"]))
    stream = end.join(texts)
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=5)))
    assembler = LineAssembler("line")
    parts = [stream[start:stop] for start, stop in zip([0, *cuts], [*cuts, len(stream)], strict=True)]
    frames = [frame for part in parts for frame in assembler.push(part)] + assembler.end()
    assert [frame.payload for frame in frames] == texts


def played(path: Path) -> list[Frame]:
    source = LogFile(FileSource(name="line", type="file", path=path, channels=()))
    source.open()
    frames = []
    while (block := source.read(0.0)) is not None:
        frames += block
    source.close()
    return frames


def test_a_log_with_tag_blocks_keeps_its_own_time(tmp_path: Path) -> None:
    path = tmp_path / "tagged.log"
    body = "HEHDT,12.3,T"
    start = NOON_NS // SECOND
    rows = [
        b"# a person's words",
        sound(body),
        *(tagged(f"c:{start + s}", body) for s in (0, 2, 1, 3)),
        sound(body),
    ]
    path.write_bytes(b"\r\n".join(rows))
    frames = played(path)
    assert [frame.received_ns for frame in frames] == [NOON_NS + s * SECOND for s in (0, 0, 2, 2, 3, 3)]
    assert all(frame.stamped_ns == frame.received_ns == frame.monotonic_ns for frame in frames)
    decoder = Nmea0183Decoder()
    stamps = [decoder.decode(frame)[0][0].measured_ns for frame in frames]
    assert stamps == [frame.received_ns for frame in frames]
    assert not decoder.refused


@pytest.mark.parametrize(
    ("stamp", "after_s"),
    [
        (b"1798718400.5 ", 0.5),
        (b"1798718400500;", 0.5),
        (b"2026-12-31T12:00:00.5Z, ", 0.5),
        (b"2026-12-31T12:00:01Z\t", 1.0),
        (b"2026-12-31T25:61:00Z ", None),  # taken off all the same, so that the sentence is sound
        (b"0000000000 ", None),
    ],
)
def test_a_log_with_a_time_before_each_line(tmp_path: Path, stamp: bytes, after_s: float | None) -> None:
    path = tmp_path / "stamped.log"
    body = tagged("c:1798718460", "HEHDT,12.3,T")  # passed on a minute later, which is not when it was received
    path.write_bytes(b"1798718400 " + sound("HEHDT,1.0,T") + b"\n" + stamp + body)
    first, second = played(path)
    assert (first.payload, first.stamped_ns) == (sound("HEHDT,1.0,T"), NOON_NS)
    assert second.payload == body
    assert second.received_ns == second.monotonic_ns == second.stamped_ns == NOON_NS + (after_s or 0) * SECOND


def test_a_log_without_times_is_stamped_now(tmp_path: Path) -> None:
    path = tmp_path / "plain.log"
    path.write_bytes(b"#one\n" + (sound("HEHDT,12.3,T") + b"\n") * 1000 + b"# two\n\n")
    frames = played(path)
    assert len(frames) == 1000
    assert all(frame.stamped_ns is None and frame.received_ns != frame.monotonic_ns for frame in frames)
