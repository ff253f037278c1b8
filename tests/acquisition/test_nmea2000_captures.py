"""NMEA 2000 field by field against two other decoders: canboat, on real captures, and the ``nmea2000`` library."""

from __future__ import annotations

import gzip
import json
import re
from collections import Counter
from collections.abc import Iterator
from itertools import zip_longest
from math import pi
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from nmea2000 import pgns

from seatrial.acquisition.config.sources import FileSource
from seatrial.acquisition.protocols.nmea2000 import SHORTEST_BYTES, Field, Message, Nmea2000Decoder
from seatrial.acquisition.sources.log_file import LogFile
from tests.acquisition.can_frames import FIELDS, can_frame, fast_parts, identifier_of, values
from tests.conftest import nightly

CAPTURES = {
    "candumpSample1.txt": 1641,
    "furuno-130842-figure8-fast.raw": 26_962,
    "furuno-fap7011c-autopilot-maneuvers.raw": 12_795,
    "scx20.raw": 1320,
    "sleipner-slink-thruster.raw": 0,
}
"""The captures, and how many messages of our groups canboat finds in them."""
LARGE = ("furuno-130842-figure8-fast.raw", "furuno-fap7011c-autopilot-maneuvers.raw")
PRINTED_DEG = 1e-7  # canboat prints no more digits of a position, although 129029 has finer ones


UNREAD = {
    "sid", "source", "directionOrder", "yaw", "ageOfService", "speedGroundReferenced",
    "speedWaterReferencedType", "speedDirection", "gnssType", "integrity", "numberOfSvs", "hdop", "pdop",
    "geoidalSeparation", "referenceStations", "localOffset", "heading", "speedThroughWater", "set", "drift",
    "transverseSpeedWaterReferenced", "sternSpeedWaterReferenced", "sternSpeedGroundReferenced",
}  # fmt: skip
"""Fields of our groups that no channel is read from."""


def heard(path: Path) -> tuple[list[tuple[int, int, Message]], Nmea2000Decoder]:
    """Every message of our groups in a log, as (group, address, message), by the way that a recording takes."""
    source = LogFile(FileSource(name="log", type="can_file", path=path, channels=()))
    decoder, found = Nmea2000Decoder(), []
    source.open()
    while (frames := source.read(0.0)) is not None:
        for frame in frames:
            message = decoder.complete_message(frame, decoder.bus_of_frame(frame))
            found += [] if message is None else [message]
    source.close()
    return found, decoder


def canboats(path: Path) -> Iterator[dict[str, Any]]:
    with gzip.open(path.with_name(f"{path.name}.si.jsonl.gz"), "rt") as stream:
        next(stream)
        yield from (message for message in map(json.loads, stream) if message["pgn"] in FIELDS)


def field_name(printed: str) -> str:
    """canboat's printed name of a field as the name in its database."""
    first, *others = re.findall(r"\w+", printed)
    return first.lower() + "".join(word.capitalize() for word in others)


def agrees(field: Field, ours: float | str, theirs: Any) -> bool:
    """Whether a field is what canboat says; it says nothing where there is no value."""
    if isinstance(theirs, dict):  # a lookup, a date or a time, with what it means
        theirs = theirs["value"] * (field.step or 1)
    if theirs is None:
        return isinstance(ours, str) or ours == (1 << field.bits) - 1
    if isinstance(ours, str):
        return False
    if field.step is None:
        return bool(ours == theirs)
    precision = PRINTED_DEG if field.step == 1e-16 else field.step
    return bool(abs(ours - theirs) <= 0.5000001 * precision)


@pytest.mark.shared
@pytest.mark.parametrize("name", [name for name in CAPTURES if name not in LARGE] + nightly(*LARGE))
def test_every_field_that_is_read_equals_canboats(shared_data: Path, name: str) -> None:
    """In order, no message too few or too many, within half a step."""
    ours, _ = heard(shared_data / "nmea2000" / name)
    different: Counter[tuple[int, str]] = Counter()
    for mine, other in zip_longest(ours, canboats(shared_data / "nmea2000" / name)):
        group, address, message = mine
        assert (group, address) == (other["pgn"], other["src"])
        theirs = {field_name(printed): value for printed, value in other.get("fields", {}).items()}
        assert set(theirs) <= {*FIELDS[group], *UNREAD, "reserved", "list"}
        for each, field in FIELDS[group].items():
            different[group, each] += not agrees(field, message[each], theirs.get(each))
    assert not +different
    assert len(ours) == CAPTURES[name]


TEXT = re.compile(r"\S+ \d\s+(\d+)\s+\d+\s+(\d+) [^:]*:  ?(.*)")
TEXT_FIELD = re.compile(r"([A-Z][^=;]*?) = [^;]*?\(bytes = \"([0-9A-F ]+)\"[^;]*")


def canboats_text(path: Path) -> list[tuple[int, int, dict[str, int]]]:
    """Our groups in canboat's text with bytes: (group, address, raw value by field)."""
    found = []
    for match in filter(None, map(TEXT.match, path.read_text().splitlines())):
        group = int(match[2])
        if group in FIELDS:
            raw = {
                field_name(n): int.from_bytes(bytes.fromhex(b), "little") for n, b in TEXT_FIELD.findall(match[3])
            }
            found.append((group, int(match[1]), raw))
    return found


@pytest.mark.shared
@pytest.mark.parametrize(
    ("name", "count", "refused"),
    [
        ("mixed-format", 2, {}),
        ("pgn-test", 3, {}),
        ("recombine-frames", 5, {"incomplete fast packet": 1}),
        ("short-frame", 0, {"frame of other than 8 bytes": 1}),
        ("switch-multi-to-one-line", 1 + 7, {}),
        ("invalid-pgn-test", 1, {}),
    ],
)
def test_faults_give_no_value_that_canboat_does_not_give(
    shared_data: Path, name: str, count: int, refused: dict[str, int]
) -> None:
    """canboat's own regression pairs that hold our groups: lost, woven, doubled and short frames."""
    folder = shared_data / "nmea2000" / "golden_pairs"
    ours, decoder = heard(folder / f"{name}.in")
    theirs = canboats_text(folder / f"{name}.out")
    assert len(ours) == count
    assert decoder.refused == refused
    for group, address, message in ours:
        raw = {n: Field(f.start, f.bits).read(message.raw) for n, f in FIELDS[group].items() if f.bits >= 8}
        assert any(
            (group, address) == (g, a) and all(raw[n] == v for n, v in r.items() if n in raw) for g, a, r in theirs
        )


@pytest.mark.shared
def test_a_position_printed_in_degrees(shared_data: Path) -> None:
    ((group, _, message),), _ = heard(shared_data / "nmea2000" / "golden_pairs" / "dms-format.in")
    position = message["latitude"], message["longitude"]
    assert (group, position) == (129025, pytest.approx((37.5166666, 37.5166664), abs=5e-8))


@pytest.mark.shared
def test_a_trace_of_pcan_view_is_what_canboat_makes_of_it(shared_data: Path) -> None:
    """The same frames, at the same time to the millisecond that canboat prints."""
    folder = shared_data / "nmea2000" / "golden_pairs"
    read = []
    for name in ("pcan-view.in", "pcan-view.out"):
        source = LogFile(FileSource(name="log", type="can_file", path=folder / name, channels=()))
        source.open()
        read.append(source.read(0.0) or [])
        source.close()
    assert [(f.identifier, f.payload) for f in read[0]] == [(f.identifier, f.payload) for f in read[1]]
    for ours, theirs in zip(*read, strict=True):
        assert abs(ours.received_ns - theirs.received_ns) <= 1_500_000


POSSIBLE = {"latitude": 90.0, "longitude": 180.0}
"""What the library gives as None beyond: for signed angles half a turn. Our values are checked as channels."""


@given(
    st.sampled_from(sorted(FIELDS)),
    st.lists(st.sampled_from([0, 0x7F, 0x80, 0xFC, 0xFE, 0xFF]) | st.integers(0, 255), min_size=43, max_size=43),
)
@settings(max_examples=400)
def test_every_field_equals_the_librarys(group: int, noise: list[int]) -> None:
    """Any bytes at all; the library gives None for what is not available, an error or reserved."""
    payload = bytes(noise[: {130577: 14, 130578: 12, 129029: 43}.get(group, 8)])
    theirs = getattr(pgns, f"decode_pgn_{group}")(int.from_bytes(payload, "little"), 8 * len(payload))
    message = Message(group, payload)
    compared = {field.id: field.raw_value for field in theirs.fields if field.id in FIELDS[group]}
    assert set(compared) == set(FIELDS[group])
    for name, expected in compared.items():
        found = message[name]
        if expected is None:
            assert isinstance(found, str | int) or abs(found) > POSSIBLE.get(name, pi)
        else:
            assert found == pytest.approx(expected, rel=1e-12, abs=1e-12)


@given(st.sampled_from([130577, 130578, 129029]), st.binary(max_size=60))
def test_a_message_of_any_length_is_whole_or_none(group: int, payload: bytes) -> None:
    decoder, found = Nmea2000Decoder(), {}
    for part in fast_parts(payload):
        found |= values(decoder.decode(can_frame(identifier_of(group), part)))
    if len(payload) < SHORTEST_BYTES[group]:
        assert found == {}
        assert decoder.refused == {"impossible length": 1}
