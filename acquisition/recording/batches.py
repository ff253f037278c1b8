"""Decodes the messages of whole chunks at once: a recording of a day has more than twenty million of them.

A compiled loop (:mod:`seatrial.acquisition.recording.walk`) finds the records and sorts samples of fixed layout
into columns. What another serialiser wrote, JSON of earlier recordings, and files so small that loading the
compiler takes longer than reading them, are decoded message by message.
"""

from __future__ import annotations

import sys
from array import array
from bisect import bisect_right
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from itertools import accumulate
from typing import Any, TypeAlias

import numpy as np
from google.protobuf.message import DecodeError
from mcap import records as mcap
from mcap.opcode import Opcode
from numpy.typing import NDArray

from seatrial.acquisition.core.errors import escape_control_characters
from seatrial.acquisition.core.quantities import Floats, Ints, Series
from seatrial.acquisition.recording import scan
from seatrial.acquisition.recording.messages import SAMPLE, SOURCE_AT, Topic, decode

_FAULTS = {scan.TOO_SHORT: "a message too short", scan.CUT: "a chunk with a cut record"}
_LARGEST_BATCH = 100_000  # in one batch, whatever a chunk holds: twice what a few chunks of the recorder hold
_COMPILED_FROM_BYTES = 2_000_000  # some 25,000 samples: they take as long as loading numba, a third of a second


@dataclass(frozen=True, slots=True)
class Batch:
    """Messages that follow each other, in file order: their heads [n], and the bytes in which their data are.

    What a head says is in :data:`MESSAGE_HEAD`.
    """

    heads: NDArray[np.void]
    plain: bytes

    @classmethod
    def of_message(cls, message: mcap.Message) -> Batch:
        """A message that stands outside of all chunks."""
        times = message.log_time, message.publish_time
        head = (message.channel_id, message.sequence, *times, 0, len(message.data))
        return cls(np.array([head], scan.MESSAGE_HEAD), message.data)

    def __len__(self) -> int:
        return int(self.heads.size)

    @property
    def data_sizes(self) -> NDArray[np.int64]:
        """How many bytes of data each message has."""
        return np.asarray(self.heads["end"] - self.heads["start"])

    def message_payloads(self) -> list[bytes]:
        """The undecoded data of each message."""
        places = zip(self.heads["start"].tolist(), self.heads["end"].tolist(), strict=True)
        return [self.plain[start:end] for start, end in places]

    def counts_by_channel(self) -> dict[int, int]:
        """How many messages there are of each channel number."""
        counts = np.bincount(self.heads["channel"])
        return {number: int(counts[number]) for number in np.flatnonzero(counts).tolist()}

    def iterate_messages(self) -> Iterator[mcap.Message]:
        """Each message by itself, as the library has them."""
        for (channel, sequence, log_ns, publish_ns, *_), data in zip(
            self.heads.tolist(), self.message_payloads(), strict=True
        ):
            yield mcap.Message(channel, log_ns, data, publish_ns, sequence)

    def split(self, start: int, stop: int) -> Iterator[Batch]:
        """The messages from ``start`` to ``stop``, not too many at once; none if there are none."""
        for place in range(start, stop, _LARGEST_BATCH):
            yield Batch(self.heads[place : min(place + _LARGEST_BATCH, stop)], self.plain)

    def select_channels(self, numbers: Iterable[int]) -> Batch:
        """Only the messages of some channels."""
        return Batch(self.heads[np.isin(self.heads["channel"], list(numbers))], self.plain)


def batch_chunks(*chunks: mcap.Chunk) -> Iterator[Batch | mcap.McapRecord]:
    """The messages in chunks, those that follow each other together, and their schemas and channels.

    Raises :class:`RecordError` where a record is not what it should be, after all that stands before it.
    """
    ends = list(accumulate(len(chunk.data) for chunk in chunks))
    plain = chunks[0].data if len(chunks) == 1 else b"".join(chunk.data for chunk in chunks)
    find_records = _find_records if _is_worth_loading(plain) else _find_records_uncompiled
    heads, record_places, size, fault = find_records(plain, ends)
    batch = Batch(heads, plain)
    opcodes = np.frombuffer(plain, np.uint8)[record_places]
    definitions = record_places[np.isin(opcodes, (Opcode.SCHEMA, Opcode.CHANNEL))]
    start = 0  # a number may mean something else from the place of a definition on
    for place, stop in zip(definitions, np.searchsorted(heads["start"], definitions), strict=True):
        yield from batch.split(start, stop)
        start = stop
        opcode, length = scan.HEAD.unpack_from(plain, place)
        begin = place + scan.HEAD.size
        record = scan.parse_record(opcode, plain[begin : begin + length])
        if record is not None:
            yield record
    yield from batch.split(start, len(batch))
    if fault:
        raise scan.RecordError(_FAULTS[fault], bisect_right(ends, size))


def _is_worth_loading(plain: bytes) -> bool:
    """Whether the compiled loop is there already, or so much is to be read that it pays to load it."""
    return len(plain) >= _COMPILED_FROM_BYTES or "seatrial.acquisition.recording.walk" in sys.modules


_FoundRecords: TypeAlias = tuple[NDArray[np.void], Ints, int, int]
"""The heads of messages, where other records begin, where the last intact record ends, the fault behind it."""


def _find_records(plain: bytes, ends: list[int]) -> _FoundRecords:
    """The records of chunks one after the other, which end at ``ends``."""
    from seatrial.acquisition.recording.walk import count_records, read_heads

    messages, non_messages, size, fault = count_records(np.frombuffer(plain, np.uint8), np.array(ends))
    heads, places = np.empty(messages, scan.MESSAGE_HEAD), np.empty(non_messages, np.int64)
    read_heads(np.frombuffer(plain, np.uint8, size), heads, places)
    return heads, places, size, fault


def _find_records_uncompiled(plain: bytes, ends: list[int]) -> _FoundRecords:
    """As :func:`_find_records`, without the compiler."""
    heads: list[tuple[int, ...]] = []
    record_places: list[int] = []
    place = fault = 0
    for end in ends:
        while place < end and not fault:
            opcode, length = scan.HEAD.unpack_from(plain, place) if end - place >= scan.HEAD.size else (0, end)
            start, after = place + scan.HEAD.size, place + scan.HEAD.size + length
            if after > end:
                fault = scan.CUT
            elif opcode != Opcode.MESSAGE:
                record_places.append(place)
            elif length < scan.MESSAGE.size:
                fault = scan.TOO_SHORT
            else:
                heads.append((*scan.MESSAGE.unpack_from(plain, start), start + scan.MESSAGE.size, after))
            place = place if fault else after
    return np.array(heads, scan.MESSAGE_HEAD), np.array(record_places, np.int64), place, fault


class SeriesBuilder:
    """A :class:`Series` that grows, at 29 bytes a sample: a day of 13 channels at 20 Hz has twenty million."""

    def __init__(self) -> None:
        self._columns: list[array[Any]] = [array("q"), array("q"), array("d"), array("B"), array("i")]
        self._sources: dict[str, int] = {}

    def append_samples(self, samples: Series) -> None:
        """Add samples."""
        sources = [self._sources.setdefault(source, len(self._sources)) for source in samples.sources]
        index = np.array(sources, np.int32)[samples.source_index]
        measured_ns, received_ns = samples.measured_ns, samples.received_ns
        added: tuple[NDArray[Any], ...] = (measured_ns, received_ns, samples.value, samples.quality, index)
        for column, values in zip(self._columns, added, strict=True):
            column.frombytes(values.tobytes())

    def build(self) -> Series:
        """The samples so far, without a copy; nothing can be added to them any more."""
        measured_ns, received_ns, value, quality, index = (
            np.frombuffer(column, column.typecode) for column in self._columns
        )
        return Series(
            measured_ns, received_ns, value, quality, escape_control_characters(tuple(self._sources)), index
        )


def add_samples(by_topic: dict[str, SeriesBuilder], batch: Batch, topics: Mapping[int, Topic]) -> None:
    """Put the samples of a batch where they belong, all of them or none; ``topics`` are those of channel numbers.

    Raises KeyError, TypeError, ValueError or OverflowError if one of them is no sample of ours.
    """
    counts = {number: count for number, count in batch.counts_by_channel().items() if topics[number].is_channel}
    if not counts:
        return
    fixed = _is_worth_loading(batch.plain) and all(topics[number].has_fixed_field_offsets for number in counts)
    series_by_topic = (_sort_samples_by_topic(batch, topics, counts) if fixed else None) or _decode_samples(
        batch, topics
    )
    for topic, series in series_by_topic.items():
        (by_topic.get(topic) or by_topic.setdefault(topic, SeriesBuilder())).append_samples(series)


def _sort_samples_by_topic(
    batch: Batch, topics: Mapping[int, Topic], counts: Mapping[int, int]
) -> dict[str, Series] | None:
    """Samples with their numbers in fixed places, by topic; None if there is one of another layout."""
    from seatrial.acquisition.recording.walk import sort_samples

    ranks = {topic: rank for rank, topic in enumerate(dict.fromkeys(topics[number].name for number in counts))}
    rank, sizes = np.full(2**16, -1, np.int32), np.zeros(len(ranks), np.int64)
    for number, count in counts.items():  # two of them may have one topic
        rank[number] = ranks[topics[number].name]
        sizes[rank[number]] += count
    ends = np.cumsum(sizes)
    columns = [np.empty(ends[-1], kind) for kind in (np.int64, np.int64, np.uint64, np.uint8)]
    changes = np.empty((ends[-1], 2), np.int64)
    plain = np.frombuffer(batch.plain, np.uint8)
    change_count = sort_samples(plain, batch.heads, rank, ends - sizes, *columns, changes)
    if change_count < 0:
        return None
    rows, messages = changes[np.argsort(changes[:change_count, 0])].T
    sources = [
        _parse_source_label(data[SOURCE_AT:])
        for data in Batch(batch.heads[messages], batch.plain).message_payloads()
    ]
    if None in sources:
        return None
    borders = np.searchsorted(rows, [0, *ends])
    series_by_topic = {}
    for topic, index in ranks.items():
        begin, span = ends[index] - sizes[index], slice(borders[index], borders[index + 1])
        measured_ns, received_ns, value, quality = (column[begin : ends[index]] for column in columns)
        numbers = measured_ns, received_ns, value.view(np.float64), quality
        series_by_topic[topic] = _make_series(
            *numbers, [str(source) for source in sources[span]], rows[span] - begin
        )
    return series_by_topic


def _make_series(
    measured_ns: Ints, received_ns: Ints, value: Floats, quality: NDArray[np.uint8], sources: list[str], rows: Ints
) -> Series:
    """Samples of one topic; each of ``sources`` is theirs from the one at its place in ``rows`` on."""
    numbers: dict[str, int] = {}
    index = np.array([numbers.setdefault(source, len(numbers)) for source in sources], np.int32)
    of_samples = np.repeat(index, np.diff(rows, append=value.size))
    return Series(measured_ns, received_ns, value, quality, tuple(numbers), of_samples)


@lru_cache(maxsize=1024)
def _parse_source_label(tail: bytes) -> str | None:
    """The source in what follows a sample's numbers; None if there is more than source and clock."""
    try:
        sample = SAMPLE.message.FromString(tail)
    except DecodeError:
        return None
    return sample.source if {tag.name for tag, _ in sample.ListFields()} <= {"source", "source_clock"} else None


def _decode_samples(batch: Batch, topics: Mapping[int, Topic]) -> dict[str, Series]:
    """Samples by topic, of any layout and encoding."""
    rows_by_topic: dict[str, list[tuple[int, int, float, int, str]]] = {}
    for (number, _, log_ns, publish_ns, *_), data in zip(
        batch.heads.tolist(), batch.message_payloads(), strict=True
    ):
        if topics[number].is_channel:
            body = decode(topics[number], data)
            if not isinstance(body["source"], str):
                raise TypeError("the source is no text")
            row = publish_ns, log_ns, float(body["value"]), int(body["quality"]), body["source"]
            rows_by_topic.setdefault(topics[number].name, []).append(row)
    series_by_topic = {}
    for topic, rows in rows_by_topic.items():
        measured_ns, received_ns, value, quality, source = zip(*rows, strict=True)
        numbers = np.array(measured_ns, np.int64), np.array(received_ns, np.int64), np.array(value)
        qualities = np.frombuffer(bytes(quality), np.uint8)
        series_by_topic[topic] = _make_series(*numbers, qualities, list(source), np.arange(len(rows)))
    return series_by_topic
