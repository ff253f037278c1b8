"""Messages in several frames: lost, doubled, woven and late parts never make one that was not sent."""

from __future__ import annotations

from collections import Counter

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seatrial.acquisition.protocols.nmea2000 import INCOMPLETE, Nmea2000Decoder
from tests.acquisition.can_frames import can_frame, fast_parts, gnss, identifier_of


def received(frames: list[tuple[int, bytes, float]]) -> tuple[list[float], Nmea2000Decoder]:
    """The latitudes that 129029 gives from parts (address, part, time)."""
    decoder, found = Nmea2000Decoder(), []
    for address, part, at_s in frames:
        found += decoder.decode(can_frame(identifier_of(129029, address), part, at_s))
    return [sample.value for group in found for sample in group if sample.quantity == "latitude_deg"], decoder


def test_stale_parts_of_a_fast_packet_are_never_mixed() -> None:
    """Frames of one message and of another with the same number, 8 s later: no value."""
    former, later = fast_parts(gnss(latitude_deg=10.0)), fast_parts(gnss(latitude_deg=20.0))
    frames = [(35, part, 0.0) for part in former[:2]] + [(35, part, 8.0) for part in later[2:]]
    latitudes, decoder = received(frames)
    assert (latitudes, decoder.refused) == ([], {INCOMPLETE: 1})
    assert received(frames + [(35, part, 9.0) for part in later])[0] == [20.0]


def test_parts_that_come_twice_or_out_of_order_make_one_message() -> None:
    parts = fast_parts(gnss())
    twice = [part for part in parts for _ in range(2)]
    for order in (twice, [parts[0], *parts[:0:-1]], [*parts[3:], *parts[:3]]):
        latitudes, decoder = received([(35, part, 0.0) for part in order])
        assert (latitudes, decoder.refused.total()) == ([63.4], 0)


@pytest.mark.parametrize("lost", range(7))
def test_a_message_with_a_lost_part_is_dropped_and_counted(lost: int) -> None:
    first, second = fast_parts(gnss(latitude_deg=10.0)), fast_parts(gnss(latitude_deg=20.0))
    del first[lost]
    latitudes, decoder = received([(35, part, 0.0) for part in first + second])
    assert (latitudes, decoder.refused) == ([20.0], {INCOMPLETE: 1})


@pytest.mark.parametrize("length", [0, 1, 42, 224, 255])
def test_an_impossible_length_is_refused(length: int) -> None:
    first, *others = fast_parts(gnss())
    frames = [(35, part, 0.0) for part in (bytes([0, length]) + first[2:], *others)]
    latitudes, decoder = received(frames)
    assert (latitudes, decoder.refused) == ([], {"impossible length": 1})


FATES = st.lists(st.sampled_from(["sent", "sent", "sent", "lost", "twice", "late"]), min_size=7, max_size=7)


def sent_parts(messages: list[tuple[int, list[str]]], at_once: int) -> list[tuple[int, bytes, float]]:
    """Ten messages a second from two devices in turn, ``at_once`` of them woven into each other."""
    frames = []
    for place, (latitude_deg, fates) in enumerate(messages):
        address, count = place % 2, place // 2
        for number, part in enumerate(fast_parts(gnss(1, latitude_deg), count % 8)):
            late_s = 0.03 if fates[number] == "late" else 0.0
            at_s = 0.1 * at_once * (count // at_once) + 0.001 * number + late_s
            frames += {"lost": 0, "twice": 2}.get(fates[number], 1) * [(address, part, at_s)]
    return sorted(frames, key=lambda frame: frame[2])


@given(st.lists(st.tuples(st.integers(-9, 9), FATES), min_size=1, max_size=40), st.integers(1, 2))
@settings(max_examples=300)
def test_only_positions_that_were_sent_come_out(messages: list[tuple[int, list[str]]], at_once: int) -> None:
    """Parts are lost, doubled, overtaken by others: what comes out was sent, and what was sent whole comes out."""
    frames = sent_parts(messages, at_once)
    of_each: Counter[float] = Counter()
    for address in (0, 1):
        found = Counter(received([frame for frame in frames if frame[0] == address])[0])
        own = messages[address::2]
        assert found <= Counter(latitude_deg for latitude_deg, _ in own)
        assert found >= Counter(latitude_deg for latitude_deg, fates in own if {"sent", "twice"}.issuperset(fates))
        of_each += found
    assert Counter(received(frames)[0]) == of_each
