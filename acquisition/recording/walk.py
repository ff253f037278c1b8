"""The compiled walk over messages: where each record begins, its head, and samples put in order by channel.

Where a record begins only the one before says, so this is a loop and no array expression. 22 million messages of a
day are walked over in less than a second. Everything else about a recording is in Python: nothing but this needs
to be fast, and nothing here decides what a file may hold but the lengths of its records.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from mcap.opcode import Opcode
from numba import njit

from acquisition.recording.messages import QUALITY_AT, SAMPLE_TAGS, SOURCE_AT, VALUE_AT

_MESSAGE = int(Opcode.MESSAGE)
_HEAD_BYTES, _FIXED_BYTES = 9, 22
CHANNELS = 1 << 16
TOO_SHORT, CUT = 1, 2
_LATEST = np.uint64(2**63 - 1)
_TAGS = np.frombuffer(bytes(tag for _, tag in SAMPLE_TAGS), np.uint8)
_TAGS_AT = np.array([place for place, _ in SAMPLE_TAGS])


@njit(inline="always")
def _number(data: Any, place: int, size: int) -> Any:
    """An unsigned little-endian number of ``size`` bytes."""
    number = np.uint64(0)
    for index in range(size):
        number |= np.uint64(data[place + index]) << np.uint64(8 * index)
    return number


@njit(cache=True, nogil=True)
def count_records(data: Any, ends: Any) -> tuple[int, int, int, int]:
    """How many messages and other records there are in chunks one after the other, which end at ``ends``.

    Then where the last good record ends, and what is wrong with the next: 0, :data:`TOO_SHORT` or :data:`CUT`.
    """
    messages = others = place = 0
    for end in ends:
        while place < end:
            left = end - place - _HEAD_BYTES
            if left < 0:
                return messages, others, place, CUT
            length = _number(data, place + 1, 8)
            if length > np.uint64(left):
                return messages, others, place, CUT
            if data[place] != _MESSAGE:
                others += 1
            elif length < np.uint64(_FIXED_BYTES):
                return messages, others, place, TOO_SHORT
            else:
                messages += 1
            place += _HEAD_BYTES + np.int64(length)
    return messages, others, place, 0


@njit(cache=True, nogil=True)
def read_heads(
    data: Any, channel: Any, sequence: Any, log_ns: Any, publish_ns: Any, start: Any, end: Any, others: Any
) -> None:
    """Fill in the heads of all messages, where their data start and end, and where other records begin."""
    place = index = other = 0
    while place < data.size:
        after = place + _HEAD_BYTES + np.int64(_number(data, place + 1, 8))
        if data[place] == _MESSAGE:
            fields = place + _HEAD_BYTES
            channel[index] = _number(data, fields, 2)
            sequence[index] = _number(data, fields + 2, 4)
            log_ns[index] = _number(data, fields + 6, 8)
            publish_ns[index] = _number(data, fields + 14, 8)
            start[index], end[index] = fields + _FIXED_BYTES, after
            index += 1
        else:
            others[other] = place
            other += 1
        place = after


@njit(cache=True, nogil=True)
def first_of_each(channel: Any) -> Any:
    """The channel numbers that occur, in the order in which they come first."""
    seen = np.zeros(CHANNELS, np.bool_)
    order = np.empty(min(channel.size, CHANNELS), np.uint16)
    count = 0
    for number in channel:
        if not seen[number]:
            seen[number] = True
            order[count] = number
            count += 1
    return order[:count]


@njit(inline="always")
def _is_sample(data: Any, start: int, end: int) -> bool:
    """Whether a message has the numbers of a sample in their places."""
    if end - start < SOURCE_AT:
        return False
    for index in range(_TAGS.size):
        if data[start + _TAGS_AT[index]] != _TAGS[index]:
            return False
    return _number(data, start + QUALITY_AT, 4) < np.uint64(256)


@njit(inline="always")
def _same(data: Any, one: int, other: int, size: int) -> bool:
    """Whether the same bytes stand in two places."""
    index = 0
    while index + 8 <= size:
        if _number(data, one + index, 8) != _number(data, other + index, 8):
            return False
        index += 8
    while index < size:
        if data[one + index] != data[other + index]:
            return False
        index += 1
    return True


@njit(cache=True, nogil=True)
def sort_samples(
    data: Any, channel: Any, log_ns: Any, publish_ns: Any, start: Any, end: Any, rank: Any, place: Any,
    measured_ns: Any, received_ns: Any, value: Any, quality: Any, changes: Any,
) -> int:  # fmt: skip
    """Samples into columns, those of a topic together; the number of places at which the source changes.

    ``rank`` is the topic's of each channel number, or -1 for what is no channel; ``place`` where in the columns the
    topic's first sample goes, and is counted up. ``changes`` takes pairs: a place in the columns, and the number of
    the message there, whose source is another than that of the topic's sample before. Returns -1 if a message is no
    sample whose numbers are where they should be.
    """
    last = np.full(place.size, -1)
    found = 0
    for index in range(channel.size):
        topic = rank[channel[index]]
        if topic < 0:
            continue
        here = start[index]
        if not _is_sample(data, here, end[index]) or log_ns[index] > _LATEST or publish_ns[index] > _LATEST:
            return -1
        row = place[topic]
        place[topic] += 1
        measured_ns[row] = publish_ns[index]
        received_ns[row] = log_ns[index]
        value[row] = _number(data, here + VALUE_AT, 8)
        quality[row] = data[here + QUALITY_AT]
        before, size = last[topic], end[index] - here - SOURCE_AT
        if (
            before < 0
            or end[before] - start[before] - SOURCE_AT != size
            or not _same(data, start[before] + SOURCE_AT, here + SOURCE_AT, size)
        ):
            changes[found, 0], changes[found, 1] = row, index
            found += 1
        last[topic] = index
    return found
