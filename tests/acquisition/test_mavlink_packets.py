"""MAVLink packets in a stream: both versions, signed or not, and damage that costs no more than itself."""

from __future__ import annotations

import random
from collections.abc import Collection, Iterable
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v10 import ardupilotmega as dialect_1
from pymavlink.dialects.v20 import ardupilotmega as dialect

from seatrial.acquisition.core.quantities import DEG_PER_RAD
from seatrial.acquisition.protocols.mavlink import (
    LONGEST_BYTES,
    Fault,
    PacketCutter,
    has_valid_checksum,
    mavlink_crc,
)
from tests.acquisition.test_mavlink import SECOND, M, attitude, decoder, frame, packed


def unknown(length: int = 20) -> bytes:
    """A packet of a message that no dialect of ours has; its checksum cannot be checked."""
    return bytes([0xFD, length, 0, 0, 7, 1, 1]) + (0xABCDEF).to_bytes(3, "little") + bytes(length + 2)


def test_unknown_messages_are_counted_and_never_used() -> None:
    listener = decoder()
    groups = listener.decode(frame(packed(attitude(1.0)) + unknown() + packed(attitude(2.0))))
    assert len(groups) == 2
    assert listener.refused == {"unknown message": 1}


def signed(message: Any) -> bytes:
    link = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    link.signing.secret_key, link.signing.sign_outgoing = b"k" * 32, True
    return bytes(message.pack(link))


def test_both_versions_and_signed_packets() -> None:
    link_1 = dialect_1.MAVLink(None, srcSystem=1, srcComponent=1)
    version_1 = bytes(link_1.attitude_encode(0, 0, 0, 1.0, 0, 0, 0).pack(link_1))
    assert version_1[0] == 0xFE
    assert len(signed(attitude())) == len(packed(attitude())) + 13
    listener = decoder()
    groups = listener.decode(frame(version_1 + packed(attitude()) + signed(attitude()) + version_1))
    assert [group[0].value for group in groups] == pytest.approx([DEG_PER_RAD] * 4)
    assert not listener.refused


def test_a_flag_that_we_do_not_know_makes_a_packet_unreadable() -> None:
    packet = bytearray(packed(attitude()))
    packet[2] = 2
    packet[-2:] = mavlink_crc(bytes(packet[1:-2]) + b"\x27").to_bytes(2, "little")  # 39 belongs to ATTITUDE
    listener = decoder()
    assert listener.decode(frame(bytes(packet))) == []
    assert listener.refused["bad data"] == 1


def stream(count: int, seed: int) -> list[bytes]:
    """Packets of several messages, lengths and versions; every value is one that can be recognised."""
    generator = random.Random(seed)
    makers = [
        lambda each: packed(attitude(each / 1000)),
        lambda each: signed(attitude(each / 1000)),
        lambda each: packed(M.rpm_encode(each, -each)),
        lambda each: packed(M.statustext_encode(6, bytes(generator.choices(b"\xfd\xfe\x00\x1e", k=50)))),
        lambda each: unknown(generator.randrange(60)),
    ]
    return [generator.choice(makers)(each) for each in range(1, count + 1)]


def broken(pieces: list[bytes], damaged: Collection[int], generator: random.Random, most: int) -> list[bytes]:
    """The pieces; of each that is to be damaged a bit is flipped, or ``most`` bytes or fewer are lost or added."""
    result = list(pieces)
    for number in damaged:
        piece = bytearray(pieces[number])
        at = generator.randrange(len(piece))
        match generator.randrange(3):
            case 0:
                piece[at] ^= 1 << generator.randrange(8)
            case 1:
                del piece[at : at + generator.randint(1, min(most, len(piece)))]
            case _:
                piece[at:at] = generator.randbytes(generator.randint(1, most))
        result[number] = bytes(piece)
    return result


def good(data: Iterable[bytes]) -> list[bytes]:
    """What a cutter makes of pieces of a stream, without the faults."""
    cutter = PacketCutter(complete=False)
    return [piece for received in data for piece in cutter.push(received) if not isinstance(piece, Fault)]


@pytest.mark.parametrize("seed", range(5))
def test_damage_costs_no_more_than_itself(seed: int) -> None:
    """100 flipped bits, bytes lost and bytes added: what was left alone all comes, and nothing else."""
    generator, packets = random.Random(seed), stream(500, seed)
    damaged = {generator.randrange(len(packets)) for _ in range(100)}
    pieces = broken(packets, damaged, generator, 8)
    untouched = [each for number, each in enumerate(packets) if number not in damaged and has_valid_checksum(each)]
    known = {
        _signed_part(each) for each in packets if has_valid_checksum(each)
    }  # a signature's damage is not to be seen
    got = good([b"".join(pieces) + bytes(2 * LONGEST_BYTES)])
    assert [each for each in got if each in set(untouched)] == untouched
    assert all(_signed_part(each) in known for each in got)


def _signed_part(packet: bytes) -> bytes:
    """A packet without its signature, if it has one."""
    return packet[:-13] if packet[0] == 0xFD and packet[2] else packet


@given(st.lists(st.integers(0, 60), min_size=1, max_size=200), st.integers(0, 20))
@settings(max_examples=60)
def test_it_does_not_matter_how_a_stream_is_cut(lengths: list[int], seed: int) -> None:
    data = b"".join(stream(30, seed))
    data = b"\xfd\xff\x00" + data[:15] + data[18:] + bytes(2 * LONGEST_BYTES)
    cuts = [sum(lengths[:count]) for count in range(len(lengths) + 1)]
    pieces = [data[a:b] for a, b in zip(cuts, [*cuts[1:], len(data)], strict=True)]
    assert good(pieces) == good([data])


def test_a_cut_off_datagram_does_not_hold_back_the_next() -> None:
    listener = decoder()
    assert listener.decode(frame(packed(attitude())[:20], 1.0)) == []
    (sample, *_), *_ = listener.decode(frame(packed(attitude()), 2.0))
    assert sample.received_ns == 2 * SECOND
    assert listener.refused == {"bad data": 1}


@pytest.mark.parametrize("rubbish", [b"\xfd", b"\xfe", b"\xfd\xff\x01", b"\xfe\xff", b"\x00", b"\xfe\x09\x1e"])
def test_endless_rubbish_needs_no_memory(rubbish: bytes) -> None:
    cutter = PacketCutter(complete=False)
    for _ in range(100):
        cutter.push(rubbish * 100)
        assert len(cutter._pending) <= 2 * LONGEST_BYTES


@given(st.lists(st.binary(max_size=300), max_size=4))
def test_no_bytes_raise_or_wait_for_ever(pieces: list[bytes]) -> None:
    listener = decoder()
    for piece in pieces:
        listener.decode(frame(piece))
    groups = listener.decode(frame(packed(attitude()) + bytes(2 * LONGEST_BYTES)))
    assert len(groups) == 1


@given(st.binary(max_size=100))
def test_the_checksum_is_pymavlinks(data: bytes) -> None:
    assert mavlink_crc(data) == dialect.x25crc(data).crc
