"""What comes on each source, message by message, and which channels it makes: decoded as a recording would be.

Nothing is written. The discovery of a ship's sources, the check before departure and the summary of a file ask the
same survey, and :mod:`seatrial.acquisition.logger.missing` says from it why a channel is missing.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from itertools import chain, islice
from pathlib import Path
from typing import Any

from seatrial.acquisition.config.configuration import TrialConfig
from seatrial.acquisition.core.channels import channel_names
from seatrial.acquisition.core.frames import Frame, FrameFlag, Group, Sample, label_parts
from seatrial.acquisition.core.trial import Trial
from seatrial.acquisition.decoders import Decoder
from seatrial.acquisition.decoders.declared_groups import decoded, variants_of
from seatrial.acquisition.decoders.fast_packets import FastPackets
from seatrial.acquisition.decoders.mavlink_packets import Fault, PacketCutter, header_of, message_name
from seatrial.acquisition.decoders.mqtt import topic_and_message
from seatrial.acquisition.decoders.nmea0183 import sentences_in, split_sentence, split_tag
from seatrial.acquisition.decoders.nmea2000 import parameter_group
from seatrial.acquisition.decoders.parameter_groups import ADDRESS_CLAIM
from seatrial.acquisition.decoders.told_time import SENTENCE_BEHIND
from seatrial.acquisition.logger.pipeline import health_of
from seatrial.acquisition.logger.processing import FrameProcessor
from seatrial.acquisition.recording.messages import MessageSink
from seatrial.acquisition.recording.reader import MessageStream
from seatrial.acquisition.recording.schemas import RAW_PREFIX

PRODUCT_INFORMATION = 126996
TOPIC_VALUE = "value"
"""The name of what comes under a topic of MQTT, its device, and is no sentence."""
_PRODUCT_BYTES = 134
_NUMBERED = frozenset({"TRD", "TRC"})  # sentences of several like things, which a number tells apart
_MOST_KINDS, _LONGEST_NAME = 5_000, 200  # what comes off a wire has no end


@dataclass(frozen=True, slots=True)
class TrafficKind:
    """One kind of message of one device: a parameter group, a sentence, a message of MAVLink."""

    source: str
    device: str
    name: str


@dataclass(slots=True)
class Tally:
    """How often something came, when [ns, monotonic], and what it said last."""

    count: int = 0
    first_ns: int = 0
    last_ns: int = 0
    values: dict[str, float] = field(default_factory=dict)
    refused: Counter[str] = field(default_factory=Counter)

    def count_in(self, at_ns: int) -> None:
        self.first_ns = self.first_ns if self.count else at_ns
        self.last_ns = max(self.last_ns, at_ns)
        self.count += 1

    @property
    def rate_hz(self) -> float:
        """Times a second; 0 for what came once."""
        span_ns = self.last_ns - self.first_ns
        return 1e9 * (self.count - 1) / span_ns if span_ns > 0 else 0.0


class _Nowhere(MessageSink):
    """A recording that is not kept."""

    def write(self, topic: str, data: bytes, log_ns: int, publish_ns: int) -> None: ...
    def write_trial(self, trial: Trial) -> None: ...
    def write_sample(self, sample: Sample) -> None: ...
    def write_raw(self, frame: Frame) -> None: ...
    def write_event(self, text: str, received_ns: int, level: str = "info", name: str = "seatrial") -> None: ...


class Survey(FrameProcessor):
    """What has come of a configuration's sources; ``events`` are what a recording would have told.

    ``kinds`` are the messages, ``quantities`` what was decoded and derived of them, by quantity and by the label of
    its source, chosen for its channel or not; ``devices`` who is on a bus, by source and address.
    """

    def __init__(self, config: TrialConfig) -> None:
        self.health = health_of(config)
        super().__init__(config, _Nowhere(), self.health)
        self.config = config
        self.kinds: dict[TrafficKind, Tally] = {}
        self.quantities: dict[str, dict[str, Tally]] = {}
        self.devices: dict[tuple[str, str], dict[str, Any]] = {}
        self.events: list[str] = []
        self.first_ns = self.last_ns = 0
        self._cutters = {
            source.name: PacketCutter(whole=source.type == "mavlink_file") for source in config.sources
        }
        self._products = {source.name: FastPackets(Counter()) for source in config.sources}
        self._refused_before: dict[int, Counter[str]] = {}
        self._kind = TrafficKind("", "", "")

    @property
    def channels(self) -> dict[str, list[str]]:
        """The channels that a recording would have, in their usual order, with the sources that each comes from."""
        order = channel_names(
            self.config.actuators, tuple(declaration.channel for declaration in self.config.declared)
        )
        received = {name for name, channel in self.health.channels.items() if channel.count}
        return {name: sorted(self.quantities.get(name, ())) for name in dict.fromkeys(order) if name in received}

    def provided(self, source: str) -> list[str]:
        """The channels that a source could provide, chosen or not, as far as the configuration lists them."""
        listed = next(section.channels for section in self.config.sources if section.name == source)
        lines = {name: {label_parts(label)[0] for label in labels} for name, labels in self.quantities.items()}
        return [name for name in listed if source in lines.get(name, ())]

    def process(self, frame: Frame) -> None:
        self.first_ns = self.first_ns or frame.received_ns
        self.last_ns = max(self.last_ns, frame.received_ns)
        self.health.sources[frame.origin].count_in(1, frame.monotonic_ns)
        for kind in self._kinds_of(frame):
            self._kind, tally = kind, self._tally_of(kind)
            if not _is_later_part(frame):
                tally.count_in(frame.monotonic_ns)
        super().process(frame)
        for reason, count in self._newly_refused(frame.origin).items():
            self._tally_of(self._kind).refused[reason] += count

    def note(self, text: str, received_ns: int, level: str = "info", name: str = "seatrial") -> None:
        self.events.append(text)

    def _tally_of(self, kind: TrafficKind) -> Tally:
        kind = TrafficKind(kind.source, kind.device[:_LONGEST_NAME], kind.name[:_LONGEST_NAME])
        if kind not in self.kinds and len(self.kinds) >= _MOST_KINDS:
            kind = TrafficKind(kind.source, "", "more")
        return self.kinds.setdefault(kind, Tally())

    def _decoded(self, decoder: Decoder, frame: Frame) -> list[Group]:
        groups = super()._decoded(decoder, frame)
        for sample in chain.from_iterable(groups):
            line, device, words = label_parts(sample.source)
            kind = TrafficKind(line, device, words[0]) if frame.protocol == "mavlink" else self._kind
            self._tally_of(kind).values[sample.quantity] = sample.value
            self._note_quantity(sample)
        return groups

    def _record(self, samples: list[Sample], frame: Frame) -> None:
        for sample in samples:
            self._note_quantity(sample)
        super()._record(samples, frame)

    def _note_quantity(self, sample: Sample) -> None:
        """Of what is decoded and a channel, too, the second word counts no more than the first."""
        labels = self.quantities.setdefault(sample.quantity, {})
        if sample.source in labels or len(labels) < _MOST_KINDS:
            tally = labels.setdefault(sample.source, Tally())
            if sample.monotonic_ns != tally.last_ns or not tally.count:
                tally.count_in(sample.monotonic_ns)
            tally.values[sample.quantity] = sample.value

    def _newly_refused(self, origin: str) -> Counter[str]:
        fresh: Counter[str] = Counter()
        for counter in self.health.sources[origin].refusals:
            before = self._refused_before.get(id(counter))
            if before != counter:
                fresh += counter if before is None else counter - before
                self._refused_before[id(counter)] = Counter(counter)
        return fresh

    def _kinds_of(self, frame: Frame) -> Iterator[TrafficKind]:
        if frame.protocol == "can":
            yield self._can_kind(frame)
        elif frame.protocol == "mavlink":
            for piece in self._cutters[frame.origin].push(frame.payload):
                if not isinstance(piece, Fault):
                    header = header_of(piece)
                    yield TrafficKind(frame.origin, str(header.system_id), message_name(header.message_id))
        elif frame.protocol == "nmea0183":
            for part in sentences_in(frame.payload):
                yield _sentence_kind(frame.origin, part)
        else:
            topic, message = topic_and_message(frame.payload)
            line = SENTENCE_BEHIND.fullmatch(message.strip())
            name = TOPIC_VALUE if line is None else _sentence_kind("", line["inner"].encode("latin-1")).name
            yield TrafficKind(frame.origin, topic, name)

    def _can_kind(self, frame: Frame) -> TrafficKind:
        kind = frame.flags & ~(FrameFlag.LATE | FrameFlag.WHOLE)
        if kind == FrameFlag.STANDARD_ID:
            return TrafficKind(frame.origin, "", f"0x{frame.identifier:03X}")
        if kind:
            return TrafficKind(frame.origin, "", "remote or error frame")
        group, address = parameter_group(frame.identifier)
        self._note_device(frame, group, str(address))
        return TrafficKind(frame.origin, str(address), str(group))

    def _note_device(self, frame: Frame, group: int, address: str) -> None:
        """Who claims an address, and what the maker says that it is."""
        payload: bytes | None = frame.payload
        if group == PRODUCT_INFORMATION and not frame.flags & FrameFlag.WHOLE and len(frame.payload) == 8:
            products = self._products[frame.origin]
            payload = products.push(int(address), group, frame.payload, frame.monotonic_ns, _PRODUCT_BYTES)
        if group in (ADDRESS_CLAIM, PRODUCT_INFORMATION) and payload is not None:
            self.devices.setdefault((frame.origin, address), {}).update(_identity(group, payload))


def _sentence_kind(line: str, payload: bytes) -> TrafficKind:
    """The kind of a sentence; a maker's own has no talker."""
    tagged = split_tag(payload)
    tag, fields = split_sentence(tagged.sentence, unchecked=True) or ("", [])
    talker, name = ("", tag) if tag.startswith("P") else (tag[:-3], tag[-3:])
    number = f" {fields[0]}" if name in _NUMBERED and fields else ""
    device = f"{talker}@{tagged.source}" if tagged.source else talker
    return TrafficKind(line, device, f"{name}{number}" if tag else "no sentence")


def survey_of(config: TrialConfig, frames: Iterable[Frame]) -> Survey:
    """The survey of frames that came in this order; those of sources that are not configured are passed over."""
    survey = Survey(config)
    for frame in frames:
        if frame.origin in survey.health.sources:
            survey.process(frame)
    survey.report_handovers()
    return survey


def survey_of_recording(config: TrialConfig, paths: Iterable[Path], most_frames: int | None = None) -> Survey:
    """The survey of the raw input in a recording's parts, or of its first ``most_frames``.

    Raises :class:`InputError` for files that are no recordings.
    """
    return survey_of(config, islice(_raw_frames(paths), most_frames))


def _raw_frames(paths: Iterable[Path]) -> Iterator[Frame]:
    """The raw input, without what another program has put under such a topic."""
    for entry in chain.from_iterable(map(MessageStream, paths)):
        if entry.topic.startswith(RAW_PREFIX):
            with suppress(ValueError, KeyError, TypeError):
                yield entry.frame()


def _is_later_part(frame: Frame) -> bool:
    """Whether a frame of CAN is part of a message whose first part was counted."""
    if frame.protocol != "can" or frame.flags & ~FrameFlag.LATE or not frame.payload:
        return False
    return _is_fast(parameter_group(frame.identifier)[0]) and bool(frame.payload[0] & 0x1F)


@cache
def _is_fast(group: int) -> bool:
    variants = variants_of(group)
    return bool(variants) and all(variant.packet_type == "Fast" for variant in variants)


def is_makers_own(group: int) -> bool:
    """Whether a parameter group is proprietary, which means something else with every maker."""
    return group in (61184, 126720) or 65_280 <= group < 65_536 or 130_816 <= group < 131_072


@cache
def name_of_group(group: int) -> str:
    """A parameter group's name in canboat's database; empty for what is a maker's own or not known.

    >>> name_of_group(127250), name_of_group(65297)
    ('vesselHeading', '')
    """
    if is_makers_own(group):
        return ""
    names = {variant.id for variant in variants_of(group)}
    return names.pop() if len(names) == 1 else ""


def _identity(group: int, payload: bytes) -> dict[str, Any]:
    """What a claim of an address, or a product's information, tells of a device."""
    message = decoded(group, payload)
    values = {} if message is None else {entry.id: entry.value for entry in message.fields}
    wanted = {"model": "modelId", "version": "modelVersion", "software": "softwareVersionCode",
              "serial": "modelSerialCode"}  # fmt: skip
    iso_name = {}
    if group == ADDRESS_CLAIM:
        wanted = {"manufacturer": "manufacturerCode", "function": "deviceFunction", "instance": "deviceInstance"}
        iso_name = {"iso_name": f"{int.from_bytes(payload[:8], 'little'):016x}"}
    return iso_name | {
        name: str(values[key]).strip() for name, key in wanted.items() if values.get(key) not in (None, "")
    }
