"""Messages that come in several frames ("fast packets"), put together again or not at all.

A frame's first byte holds the number of its message (3 bits) and its place in it (5 bits); the first frame also
says how long the message is. Numbers come round after eight messages, so a part that was lost must never be
replaced by the same part of a later message: that would make a believable message that nobody sent. Parts may
come in any order, but not late, not twice unless one upon the other, and the first never completes a message:
where it comes last, the others belong to a message whose own first part was lost.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

_LONGEST_GAP_NS = 750_000_000  # parts further apart than this belong to two messages
_MOST_BEGUN_SINCE = 4  # a message of which parts are missing after so many others will never be whole
_FIRST_PART_BYTES, _PART_BYTES = 6, 7
LONGEST_BYTES = _FIRST_PART_BYTES + 31 * _PART_BYTES
INCOMPLETE = "incomplete fast packet"


@dataclass(slots=True)
class _Partial:
    """The parts of one message by their places; ``length`` [bytes] is known from the first part on."""

    begun: int
    last_ns: int
    last_place: int = -1
    length: int = LONGEST_BYTES
    parts: dict[int, bytes] = field(default_factory=dict)

    @property
    def places(self) -> int:
        """How many parts the message has, at most."""
        return 1 + -(-max(0, self.length - _FIRST_PART_BYTES) // _PART_BYTES)


@dataclass(slots=True)
class _Stream:
    """The messages of one group from one address. ``closed`` is the last number whose fate is known."""

    begun: int = 0
    closed: int | None = None
    partials: dict[int, _Partial] = field(default_factory=dict)


class FastPackets:
    """Parts of messages by address and group; what is dropped is counted in ``refused``."""

    def __init__(self, refused: Counter[str]) -> None:
        self._refused = refused
        self._streams: dict[tuple[int, int], _Stream] = {}

    def push(self, address: int, group: int, part: bytes, monotonic_ns: int, shortest: int) -> bytes | None:
        """The whole message if this part of 8 bytes was the last one missing.

        ``shortest`` is the least length [bytes] that is possible for the group.
        """
        stream = self._streams.setdefault((address, group), _Stream())
        number, place = part[0] >> 5, part[0] & 0x1F
        data = part[1:] if place else part[2:]
        partial = stream.partials.get(number)
        if partial is not None and _is_repeated(partial, place, data):
            return None
        if partial is not None and not _continues(partial, place, part[1], monotonic_ns):
            self._drop(stream, number)
            partial = None
        if partial is None:
            if place and number == stream.closed:  # a part of a message that is whole already
                return None
            partial = self._begin(stream, number, monotonic_ns)
        if place == 0:
            if not max(1, shortest) <= part[1] <= LONGEST_BYTES:
                self._refused["impossible length"] += 1
                _close(stream, number)
                return None
            partial.length = part[1]
        partial.parts[place], partial.last_place, partial.last_ns = data, place, monotonic_ns
        if len(partial.parts) < partial.places:
            return None
        _close(stream, number)
        return b"".join(partial.parts[index] for index in range(partial.places))[: partial.length]

    def forget(self, address: int) -> None:
        """Another device has this address now: what the former one began will not be continued."""
        for key in [key for key in self._streams if key[0] == address]:
            self._refused[INCOMPLETE] += len(self._streams.pop(key).partials)

    def _begin(self, stream: _Stream, number: int, monotonic_ns: int) -> _Partial:
        stream.begun += 1
        for earlier, partial in list(stream.partials.items()):
            if stream.begun - partial.begun >= _MOST_BEGUN_SINCE:
                self._drop(stream, earlier)
        stream.closed = None if stream.closed == number else stream.closed
        stream.partials[number] = partial = _Partial(stream.begun, monotonic_ns)
        return partial

    def _drop(self, stream: _Stream, number: int) -> None:
        self._refused[INCOMPLETE] += 1
        del stream.partials[number]


def _is_repeated(partial: _Partial, place: int, data: bytes) -> bool:
    """Whether the same part comes twice in a row, as it does when its acknowledgement was disturbed."""
    return place == partial.last_place and partial.parts[place] == data


def _continues(partial: _Partial, place: int, length: int, monotonic_ns: int) -> bool:
    """Whether a part can belong to a message of which others have come; ``length`` is what a first part says."""
    if monotonic_ns - partial.last_ns > _LONGEST_GAP_NS or place in partial.parts:
        return False
    if place:
        return place < partial.places
    message = _Partial(0, 0, length=length)
    return max(partial.parts) < message.places and len(partial.parts) < message.places - 1


def _close(stream: _Stream, number: int) -> None:
    stream.partials.pop(number, None)
    stream.closed = number
