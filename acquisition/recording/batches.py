"""The messages of a chunk all at once: a recording of a day has more than twenty million of them.

Where each record begins has to be found one after the other, for only its head says how long it is. All else is
read from the heads together, and the JSON of all samples of a topic is parsed in one call.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import repeat

import numpy as np
import orjson
from mcap import records as mcap
from mcap.opcode import Opcode
from numpy.typing import NDArray

from acquisition.core.arrays import Series
from acquisition.recording.records import HEAD, RecordError, parse

_HEAD = np.dtype(
    [
        ("opcode", "u1"),
        ("length", "<u8"),
        ("channel", "<u2"),
        ("sequence", "<u4"),
        ("log", "<u8"),
        ("publish", "<u8"),
    ]
)
_WHOLE_HEAD = np.arange(_HEAD.itemsize)
_FIXED_BYTES = _HEAD.itemsize - HEAD.size
_MESSAGE_CODE = int(Opcode.MESSAGE)
_LATEST_NS = 2**63 - 1


@dataclass(frozen=True, slots=True)
class Batch:
    """Messages that follow each other, in file order: numbers of channel and sequence, times [ns], all [n].

    Their data are ``plain[start:end]``.
    """

    channel: NDArray[np.uint16]
    sequence: NDArray[np.uint32]
    log_ns: NDArray[np.uint64]
    publish_ns: NDArray[np.uint64]
    plain: bytes
    start: NDArray[np.int64]
    end: NDArray[np.int64]

    @classmethod
    def of_message(cls, message: mcap.Message) -> Batch:
        """A message that stands outside of all chunks."""
        return cls(
            np.array([message.channel_id], np.uint16),
            np.array([message.sequence], np.uint32),
            np.array([message.log_time], np.uint64),
            np.array([message.publish_time], np.uint64),
            message.data,
            np.array([0]),
            np.array([len(message.data)]),
        )

    def __len__(self) -> int:
        return int(self.channel.size)

    def data(self) -> list[bytes]:
        """The undecoded data of each message."""
        return [self.plain[start:end] for start, end in zip(self.start.tolist(), self.end.tolist(), strict=True)]

    def messages(self) -> Iterator[mcap.Message]:
        """Each message by itself, as the library has them."""
        columns = (self.channel, self.log_ns, self.publish_ns, self.sequence)
        rows = zip(*(column.tolist() for column in columns), self.data(), strict=True)
        for channel, log_ns, publish_ns, sequence, data in rows:
            yield mcap.Message(channel, log_ns, data, publish_ns, sequence)

    def of_channels(self, numbers: Iterable[int]) -> Batch:
        """Only the messages of some channels."""
        chosen = np.flatnonzero(np.isin(self.channel, list(numbers)))
        columns = (self.channel[chosen], self.sequence[chosen], self.log_ns[chosen], self.publish_ns[chosen])
        return Batch(*columns, self.plain, self.start[chosen], self.end[chosen])


def batches(chunk: mcap.Chunk) -> Iterator[Batch | mcap.McapRecord]:
    """The messages in a chunk, those that follow each other together, and its schemas and channels.

    Raises :class:`RecordError` where a record is not what it should be, after all that stands before it.
    """
    plain, position = chunk.data, 0
    while position < len(plain):
        places, position, wrong = _messages_from(plain, position)
        if places:
            yield _messages_at(plain, places)
        if wrong:
            raise RecordError(wrong)
        if position < len(plain):
            opcode, length = HEAD.unpack_from(plain, position)
            position += HEAD.size + length
            if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                record = parse(opcode, plain[position - length : position])
                if record is not None:
                    yield record


def _messages_from(plain: bytes, position: int) -> tuple[list[int], int, str]:
    """Where the messages from ``position`` on begin, where they end, and what is wrong with what follows."""
    size, head_bytes, unpack = len(plain), HEAD.size, HEAD.unpack_from
    places: list[int] = []
    while position + head_bytes <= size:
        opcode, length = unpack(plain, position)
        after = position + head_bytes + length
        if after > size:
            break
        if opcode != _MESSAGE_CODE:
            return places, position, ""
        if length < _FIXED_BYTES:
            return places, position, "a message too short"
        places.append(position)
        position = after
    return places, position, "a chunk with a cut record" if position < size else ""


def _messages_at(plain: bytes, places: list[int]) -> Batch:
    """The messages whose records begin at ``places``."""
    begin = np.array(places)
    heads = np.frombuffer(plain, np.uint8)[begin[:, None] + _WHOLE_HEAD].view(_HEAD)[:, 0]
    end = begin + (HEAD.size + heads["length"].astype(np.int64))
    return Batch(
        heads["channel"], heads["sequence"], heads["log"], heads["publish"], plain, begin + _HEAD.itemsize, end
    )


@dataclass(frozen=True, slots=True)
class SeriesBuilder:
    """A :class:`Series` that grows: times [ns], values, flags, and the index of each one's source in ``sources``.

    29 bytes a sample: a day of 13 channels at 20 Hz has more than twenty million.
    """

    measured_ns: array[int] = field(default_factory=lambda: array("q"))
    received_ns: array[int] = field(default_factory=lambda: array("q"))
    value: array[float] = field(default_factory=lambda: array("d"))
    quality: array[int] = field(default_factory=lambda: array("B"))
    source: array[int] = field(default_factory=lambda: array("i"))
    sources: dict[str, int] = field(default_factory=dict)

    def series(self) -> Series:
        """The samples so far, without a copy; nothing can be added to them any more."""
        return Series(
            np.frombuffer(self.measured_ns, np.int64),
            np.frombuffer(self.received_ns, np.int64),
            np.frombuffer(self.value, np.float64),
            np.frombuffer(self.quality, np.uint8),
            tuple(self.sources),
            np.frombuffer(self.source, np.int32),
        )


def add_samples(by_topic: dict[str, SeriesBuilder], batch: Batch, topics: Mapping[int, str]) -> None:
    """Put a batch of samples where they belong, all of them or none; ``topics`` are those of the channel numbers.

    Raises KeyError, TypeError, ValueError or OverflowError if one of them is no sample of ours.
    """
    values, flags, names = _decoded(batch.data())
    value, quality = np.frombuffer(values, np.float64), np.frombuffer(flags, np.uint8)
    if max(batch.log_ns.max(), batch.publish_ns.max()) > _LATEST_NS:
        raise OverflowError("a time beyond the year 2262")
    measured_ns, received_ns = batch.publish_ns.astype(np.int64), batch.log_ns.astype(np.int64)
    first = names[0] if names.count(names[0]) == len(names) else None
    for topic, places in _places(batch.channel, topics).items():
        samples = by_topic.get(topic) or by_topic.setdefault(topic, SeriesBuilder())
        samples.measured_ns.frombytes(measured_ns[places].tobytes())
        samples.received_ns.frombytes(received_ns[places].tobytes())
        samples.value.frombytes(value[places].tobytes())
        samples.quality.frombytes(quality[places].tobytes())
        known = samples.sources
        if first is not None:
            samples.source.extend(repeat(known.setdefault(first, len(known)), places.size))
        else:
            samples.source.extend(known.setdefault(names[place], len(known)) for place in places.tolist())


def _decoded(data: list[bytes]) -> tuple[array[float], array[int], list[str]]:
    """Values, flags and sources of samples."""
    bodies = orjson.loads(b"[" + b",\n".join(data) + b"]")
    if len(bodies) != len(data):
        raise ValueError("a message that is not one JSON value")
    value, quality = [body["value"] for body in bodies], [body["quality"] for body in bodies]
    names = [body["source"] for body in bodies]
    dict.fromkeys(names)  # refuses what cannot be a name
    try:
        return array("d", value), array("B", quality), names
    except TypeError:  # numbers in other clothes
        return array("d", map(float, value)), array("B", map(int, quality)), names


def _places(channel: NDArray[np.uint16], topics: Mapping[int, str]) -> dict[str, NDArray[np.intp]]:
    """Where in a batch the messages of each topic are, topics in the order in which they come first."""
    numbers = dict.fromkeys(channel.tolist())
    order: dict[str, int] = {}
    rank = np.zeros(max(numbers) + 1, dtype=np.intp)
    for number in numbers:
        rank[number] = order.setdefault(topics[number], len(order))  # two channels may have one topic
    ranks = rank[channel]
    sorted_places = np.argsort(ranks, kind="stable")
    ends = np.cumsum(np.bincount(ranks))
    return dict(zip(order, np.split(sorted_places, ends[:-1]), strict=True))
