"""The compiled walk over messages: where each record begins, its head, and samples put in order by channel.

Only the record before states where a record begins, so this is a loop and no array expression. It walks over the 22
million messages of a day in less than a second. Everything else about a recording is in Python: nothing else needs
to be fast, and nothing here decides what a file may hold but the lengths of its records.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from mcap.opcode import Opcode
from numba import njit

from seatrial.acquisition.recording.messages import QUALITY_AT, SAMPLE_TAGS, SOURCE_AT, VALUE_AT
from seatrial.acquisition.recording.scan import CUT, HEAD, MESSAGE, TOO_SHORT

_MESSAGE = int(Opcode.MESSAGE)
_HEAD_BYTES, _FIXED_BYTES = HEAD.size, MESSAGE.size
_LATEST = np.uint64(2**63 - 1)
_TAGS = np.frombuffer(bytes(tag for _, tag in SAMPLE_TAGS), np.uint8)
_TAGS_AT = np.array([place for place, _ in SAMPLE_TAGS])


@njit(inline="always")
def _read_unsigned(data: Any, place: int, size: int) -> Any:
    """An unsigned little-endian number of ``size`` bytes."""
    number = np.uint64(0)
    for index in range(size):
        number |= np.uint64(data[place + index]) << np.uint64(8 * index)
    return number


@njit(cache=True, nogil=True)
def count_records(data: Any, ends: Any) -> tuple[int, int, Any, int]:
    """How many messages and other records there are in chunks one after the other, which end at ``ends``.

    Then where the last good record ends, and what is wrong with the next: 0, :data:`TOO_SHORT` or :data:`CUT`.
    """
    messages = non_messages = 0
    place = np.int64(0)
    for end in ends:
        while place < end:
            remaining = end - place - _HEAD_BYTES
            if remaining < 0:
                return messages, non_messages, place, CUT
            length = _read_unsigned(data, place + 1, 8)
            if length > np.uint64(remaining):
                return messages, non_messages, place, CUT
            if data[place] != _MESSAGE:
                non_messages += 1
            elif length < np.uint64(_FIXED_BYTES):
                return messages, non_messages, place, TOO_SHORT
            else:
                messages += 1
            place += _HEAD_BYTES + np.int64(length)
    return messages, non_messages, place, 0


@njit(cache=True, nogil=True)
def read_heads(data: Any, heads: Any, places: Any) -> None:
    """Fill in the head of all messages, and where other records begin."""
    index = filled = 0
    place = np.int64(0)
    while place < data.size:
        after = place + _HEAD_BYTES + np.int64(_read_unsigned(data, place + 1, 8))
        if data[place] == _MESSAGE:
            fields = place + _HEAD_BYTES
            head = heads[index]
            head.channel, head.sequence = _read_unsigned(data, fields, 2), _read_unsigned(data, fields + 2, 4)
            head.log_ns, head.publish_ns = _read_unsigned(data, fields + 6, 8), _read_unsigned(data, fields + 14, 8)
            head.start, head.end = fields + _FIXED_BYTES, after
            index += 1
        else:
            places[filled] = place
            filled += 1
        place = after


@njit(inline="always")
def _has_sample_layout(data: Any, start: Any, end: Any) -> Any:
    """Whether a message has the numbers of a sample in their places."""
    if end - start < SOURCE_AT:
        return False
    for index in range(_TAGS.size):
        if data[start + _TAGS_AT[index]] != _TAGS[index]:
            return False
    return _read_unsigned(data, start + QUALITY_AT, 4) < np.uint64(256)


@njit(inline="always")
def _equal_bytes(data: Any, start_a: Any, start_b: Any, size: Any) -> Any:
    """Whether the same bytes stand in two places."""
    index = 0
    while index + 8 <= size:
        if _read_unsigned(data, start_a + index, 8) != _read_unsigned(data, start_b + index, 8):
            return False
        index += 8
    while index < size:
        if data[start_a + index] != data[start_b + index]:
            return False
        index += 1
    return True


@njit(cache=True, nogil=True)
def sort_samples(
    data: Any, heads: Any, rank: Any, place: Any, measured_ns: Any, received_ns: Any, value: Any, quality: Any,
    changes: Any,
) -> int:  # fmt: skip
    """Samples into columns, those of a topic together; the number of places at which the source changes.

    ``rank`` is the topic's of each channel number, or -1 for what is no channel; ``place`` where in the columns the
    topic's first sample goes, and is counted up. ``changes`` takes pairs: a place in the columns, and the number of
    the message there, whose source is another than that of the topic's sample before. Returns -1 if a message is no
    sample whose numbers are where they should be.
    """
    last_start, last_size = np.zeros(place.size, np.int64), np.full(place.size, -1)
    change_count = 0
    for index in range(heads.size):
        head = heads[index]
        topic = rank[head.channel]
        if topic < 0:
            continue
        if not _has_sample_layout(data, head.start, head.end) or head.log_ns > _LATEST or head.publish_ns > _LATEST:
            return -1
        row = place[topic]
        place[topic] += 1
        measured_ns[row], received_ns[row] = head.publish_ns, head.log_ns
        value[row], quality[row] = _read_unsigned(data, head.start + VALUE_AT, 8), data[head.start + QUALITY_AT]
        start, size = head.start + SOURCE_AT, head.end - head.start - SOURCE_AT
        if size != last_size[topic] or not _equal_bytes(data, last_start[topic], start, size):
            changes[change_count, 0], changes[change_count, 1] = row, index
            change_count += 1
        last_start[topic], last_size[topic] = start, size
    return change_count
