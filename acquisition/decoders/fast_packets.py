"""Messages that come in several frames ("fast packets"), put together again or not at all.

A frame's first byte holds the number of its message (3 bits) and its place in it (5 bits); the first frame also
says how long the message is. Numbers come round after eight messages, so a part that was lost must never be
replaced by the same part of a later message: that would make a believable message that nobody sent. The first
part always begins a message anew, and has to come before the others, which may come in any order.
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
    length: int
    begun: int
    last_ns: int
    parts: dict[int, bytes]

    @property
    def places(self) -> int:
        """How many parts the message has."""
        return 1 + -(-max(0, self.length - _FIRST_PART_BYTES) // _PART_BYTES)

    def is_stale(self, monotonic_ns: int) -> bool:
        """Whether what comes now is too late to belong to this message."""
        return monotonic_ns - self.last_ns > _LONGEST_GAP_NS


@dataclass(slots=True)
class _Stream:
    """The messages of one group from one address. ``closed`` is the number whose fate is already known."""

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
        if place == 0:
            self._begin(stream, number, part, monotonic_ns, shortest)
        else:
            self._continue(stream, number, place, part[1:], monotonic_ns)
        partial = stream.partials.get(number)
        if partial is None or len(partial.parts) < partial.places:
            return None
        self._close(stream, number)
        return b"".join(partial.parts[each] for each in range(partial.places))[: partial.length]

    def forget(self, address: int) -> None:
        """Another device has this address now: what the former one began will not be continued."""
        for key in [key for key in self._streams if key[0] == address]:
            self._refused[INCOMPLETE] += len(self._streams.pop(key).partials)

    def _begin(self, stream: _Stream, number: int, part: bytes, monotonic_ns: int, shortest: int) -> None:
        former = stream.partials.get(number)
        if former is not None and (former.parts != {0: part[2:]} or former.is_stale(monotonic_ns)):
            self._drop(stream, number)  # unless it is the same part twice in a row
        if not max(1, shortest) <= part[1] <= LONGEST_BYTES:
            self._refused["impossible length"] += 1
            self._close(stream, number)
            return
        self._count_message(stream)
        stream.partials[number] = _Partial(part[1], stream.begun, monotonic_ns, {0: part[2:]})

    def _continue(self, stream: _Stream, number: int, place: int, data: bytes, monotonic_ns: int) -> None:
        partial = stream.partials.get(number)
        if partial is None:
            if number != stream.closed:  # its beginning was lost
                self._count_message(stream)
                self._drop(stream, number)
            return
        if partial.is_stale(monotonic_ns) or place >= partial.places or partial.parts.get(place, data) != data:
            self._drop(stream, number)
            return
        partial.parts[place] = data
        partial.last_ns = monotonic_ns

    def _count_message(self, stream: _Stream) -> None:
        stream.begun += 1
        for number, partial in list(stream.partials.items()):
            if stream.begun - partial.begun >= _MOST_BEGUN_SINCE:
                self._drop(stream, number)

    def _drop(self, stream: _Stream, number: int) -> None:
        self._refused[INCOMPLETE] += 1
        self._close(stream, number)

    def _close(self, stream: _Stream, number: int) -> None:
        stream.partials.pop(number, None)
        stream.closed = number
