"""Surveys what comes on each source, message by message, and states why a channel is missing and what to do.

A :class:`Survey` decodes as a recording would, but writes nothing. The discovery of a ship's sources, the check
before departure and the summary of a file ask it. ``seatrial record --check`` makes a short recording, exactly as a
real one, in the folder for temporary files and throws it away: what works there works at sea; where the real one
will go is only checked. ``seatrial redecode`` makes the channels of a recording again from its raw input, with a
corrected configuration; the raw input is copied as it is, and so are notes of people and of the recorder, and
predictions.
"""

from __future__ import annotations

import os
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Container, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from functools import cache
from itertools import chain, islice
from pathlib import Path
from typing import Any

from seatrial.acquisition.config.declarations import GroupField, MavlinkField, Origin, SentenceField
from seatrial.acquisition.config.sources import CarriedFiles, LineSource, MqttLinks, OwnSource, RecordingSection
from seatrial.acquisition.config.trial_file import CONFIGURATION, PACK_ENDING, TrialConfig, parse_config
from seatrial.acquisition.core import errors, ship
from seatrial.acquisition.core.files import atomic_file, require_suffix
from seatrial.acquisition.core.trial import Frame, FrameFlag, Group, Sample, Trial, split_source_label
from seatrial.acquisition.logger.health import ENOUGH_RATE, SILENT_NS, Health, check_alarms
from seatrial.acquisition.logger.pipeline import Recorder, initial_health
from seatrial.acquisition.logger.processing import DECODED, FrameProcessor
from seatrial.acquisition.logger.sinks import check_sinks
from seatrial.acquisition.protocols import Decoder, clock, mavlink, mqtt, nmea0183, nmea2000
from seatrial.acquisition.recording import messages, reader
from seatrial.acquisition.recording.parts import RecordingParts
from seatrial.acquisition.recording.writer import RecordingWriter, free_and_total_bytes, shortage_text

PRODUCT_INFORMATION = 126996
TOPIC_VALUE = "value"
"""The name of what comes under a topic of MQTT, its device, and is no sentence."""
_PRODUCT_BYTES = 134
_NUMBERED = frozenset({"TRD", "TRC"})  # sentences of several alike devices, which a number distinguishes
_MOST_KINDS, _LONGEST_NAME = 5_000, 200  # what comes off a wire is unbounded

LOOKED_AT = 10_000
"""Frames of a recording from which its summary says why something is missing: some seconds of a busy bus."""
RATED_FIX = "give rated_rpm"
VARIATION_FIX = "set magnetic_variation_deg or add a source of 127258"
_MOST_NAMED = 6
_NONE_REFUSED = Counter[str]()
_FRESH_S = 1.5  # how old a quantity that is needed to derive a channel may be

_SPEEDS, _WIND = ("surge_mps", "sway_mps"), ("wind_direction_deg", "wind_speed_mps")

_POSITION = ("GGA", "GNS", "RMC", "GLL", "129025", "129029", "GLOBAL_POSITION_INT", "GPS_RAW_INT")
_CARRIERS = {
    **dict.fromkeys(("north_m", "east_m", "latitude_deg", "longitude_deg"), _POSITION),
    "speed_through_water_mps": ("VHW", "VBW", "128259", "130578"),
    "magnetic_variation_deg": ("HDG", "RMC", "127258", "127250"),
    **dict.fromkeys(("roll_deg", "pitch_deg"), ("PSXN and PASHR by the pack survey", "127257", "ATTITUDE")),
    "heading_deg": ("HDT", "THS", "HDG", "HDM", "PASHR", "127250", "ATTITUDE"),
    **dict.fromkeys(_SPEEDS, ("VBW", "130578", "VTG", "RMC", "129026", "130577", "LOCAL_POSITION_NED")),
    "yaw_rate_dps": ("ROT", "127251", "ATTITUDE"),
    **dict.fromkeys(_WIND, ("MWD", "MDA", "MWV", "VWR", "VWT", "130306", "WIND", "WIND_COV")),
}
"""The messages that can carry each channel of the motion, or what it is derived from."""
_OF_ACTUATORS = ("TRD", "TRC", "RPM", "RSA", "127245", "127488", "128006", "RAW_RPM")
_REMEDIES = {
    "thruster in percent": f"in percent: {RATED_FIX}",
    "engine without a reduction ratio": "tells the engine's speed: give reduction_ratios",
    "engine rpm": "tells the engine's speed: give reduction_ratios",
    "thruster not understood": "of a number that no thruster has: say in `thrusters` whose it is",
    "rpm of a single or unknown shaft": "of a shaft that the ship has not: list its own as [[actuator]]",
    "another system": "of a system of another number: give its system_id",
    "another component": "of a component of another number: give its component_id",
    "another instance": "of one more than the ship has: list its own as [[actuator]]",
    "heading without a reference": "without saying which north it counts from",
    "wind without a reference": "without saying what it refers to",
    "wind reference unknown": "without saying what it refers to",
    "course without a reference": "without saying which north it counts from",
    "not marked valid": "but is marked as not valid: see to the sensor",
    "no fix": "but without a fix: see to the antenna",
    "not available": "but its values are not available: see to the sensor",
    "no value": "but its fields are empty: see to the sensor",
    "retained by the broker, of unknown age": "but only as the broker has retained it: see to who publishes it",
    nmea0183.NO_CHECKSUM: 'but without a checksum: checksum = "optional" in [[source]] reads it',
    "no sound checksum": "but with wrong checksums: see to the line and its baud rate",
}
_UNREAD = {
    "127488": "tells the engine's speed: give reduction_ratios",
    "128006": "tells a thruster's speed in percent: it has no channel",
}

_FLUSH_EVERY = 10_000  # messages, some megabytes; what is not flushed is in memory


@dataclass(frozen=True, slots=True)
class TrafficKind:
    """One kind of message of one device: a parameter group, a sentence, a message of MAVLink."""

    source: str
    device: str
    name: str


@dataclass(slots=True)
class Tally:
    """How often something came, when [ns, monotonic], and its last values."""

    count: int = 0
    first_ns: int = 0
    last_ns: int = 0
    values: dict[str, float] = field(default_factory=dict)
    refused: Counter[str] = field(default_factory=Counter)

    def add_message(self, at_ns: int) -> None:
        self.first_ns = self.first_ns if self.count else at_ns
        self.last_ns = max(self.last_ns, at_ns)
        self.count += 1

    @property
    def rate_hz(self) -> float:
        """Times a second; 0 for what came once."""
        span_ns = self.last_ns - self.first_ns
        return 1e9 * (self.count - 1) / span_ns if span_ns > 0 else 0.0


class _NullSink(messages.MessageSink):
    """A recording that is not kept."""

    def write(self, topic: str, data: bytes, log_ns: int, publish_ns: int) -> None: ...
    def write_trial(self, trial: Trial) -> None: ...
    def write_sample(self, sample: Sample) -> None: ...
    def write_raw(self, frame: Frame) -> None: ...
    def write_event(self, text: str, received_ns: int, level: str = "info", name: str = "seatrial") -> None: ...


class Survey(FrameProcessor):
    """What has come of a configuration's sources; ``events`` are those of a recording.

    ``kinds`` are the messages, ``quantities`` what was decoded and derived of them, by quantity and by the label of
    its source, chosen for its channel or not; ``devices`` who is on a bus, by source and address.
    """

    def __init__(self, config: TrialConfig) -> None:
        self.health = initial_health(config)
        super().__init__(config, _NullSink(), self.health)
        self.config = config
        self.kinds: dict[TrafficKind, Tally] = {}
        self.quantities: dict[str, dict[str, Tally]] = {}
        self.devices: dict[tuple[str, str], dict[str, Any]] = {}
        self.events: list[str] = []
        self.first_ns = self.last_ns = 0
        self._cutters = {
            source.name: mavlink.PacketCutter(complete=source.type == "mavlink_file") for source in config.sources
        }
        self._products = {source.name: nmea2000.FastPackets(Counter()) for source in config.sources}
        self._refused_before: dict[int, Counter[str]] = {}
        self._kind = TrafficKind("", "", "")

    @property
    def channels(self) -> dict[str, list[str]]:
        """The channels that a recording would have, in their usual order, with the sources that each comes from."""
        order = ship.channel_names(
            self.config.actuators, tuple(declaration.channel for declaration in self.config.declared)
        )
        received = {name for name, channel in self.health.channels.items() if channel.count}
        return {name: sorted(self.quantities.get(name, ())) for name in dict.fromkeys(order) if name in received}

    def channels_provided_by(self, source: str) -> list[str]:
        """The channels that a source could provide, chosen or not, as far as the configuration lists them."""
        listed = next(section.channels for section in self.config.sources if section.name == source)
        lines = {
            name: {split_source_label(label)[0] for label in labels} for name, labels in self.quantities.items()
        }
        return [name for name in listed if source in lines.get(name, ())]

    def is_available(self, quantity: str) -> bool:
        """Whether a quantity to derive channels with is known: from a line, the ship's, or the configuration."""
        if quantity == "magnetic_variation_deg" and self.config.magnetic_variation_deg is not None:
            return True
        if quantity in ship.POSE_AND_VELOCITY and quantity != "heading_deg":
            return bool(self.health.channels[quantity].count)
        return quantity in self.quantities

    def process(self, frame: Frame) -> None:
        self.first_ns = self.first_ns or frame.received_ns
        self.last_ns = max(self.last_ns, frame.received_ns)
        self.health.sources[frame.origin].add_frames(1, frame.monotonic_ns)
        # the later parts of a message in several frames of CAN are not counted
        is_part = frame.protocol == "can" and not frame.flags & ~FrameFlag.LATE
        is_part = is_part and bool(frame.payload) and bool(frame.payload[0] & 0x1F)
        is_part = is_part and nmea2000.is_fast_packet_group(nmea2000.split_can_identifier(frame.identifier)[0])
        for kind in self._traffic_kinds(frame):
            self._kind, tally = kind, self._tally_of(kind)
            if not is_part:
                tally.add_message(frame.monotonic_ns)
        super().process(frame)
        for counter in self.health.sources[frame.origin].refusals:
            before = self._refused_before.get(id(counter), _NONE_REFUSED)
            if before != counter:
                self._tally_of(self._kind).refused += counter - before
                self._refused_before[id(counter)] = Counter(counter)

    def note(self, text: str, received_ns: int, level: str = "info", name: str = "seatrial") -> None:
        self.events.append(text)

    def _tally_of(self, kind: TrafficKind) -> Tally:
        kind = TrafficKind(kind.source, kind.device[:_LONGEST_NAME], kind.name[:_LONGEST_NAME])
        if kind not in self.kinds and len(self.kinds) >= _MOST_KINDS:
            kind = TrafficKind(kind.source, "", "more")
        return self.kinds.setdefault(kind, Tally())

    def _decode_groups(self, decoder: Decoder, frame: Frame) -> list[Group]:
        groups = super()._decode_groups(decoder, frame)
        for sample in chain.from_iterable(groups):
            source_name, device, words = split_source_label(sample.source)
            kind = TrafficKind(source_name, device, words[0]) if frame.protocol == "mavlink" else self._kind
            self._tally_of(kind).values[sample.quantity] = sample.value
            self._count_quantity(sample)
        return groups

    def _record_samples(self, samples: list[Sample], frame: Frame) -> None:
        for sample in samples:
            self._count_quantity(sample)
        super()._record_samples(samples, frame)

    def _count_quantity(self, sample: Sample) -> None:
        """Count a sample; the second of what is decoded and a channel, too, counts no more."""
        labels = self.quantities.setdefault(sample.quantity, {})
        if sample.source in labels or len(labels) < _MOST_KINDS:
            tally = labels.setdefault(sample.source, Tally())
            if sample.monotonic_ns != tally.last_ns or not tally.count:
                tally.add_message(sample.monotonic_ns)
            tally.values[sample.quantity] = sample.value

    def _traffic_kinds(self, frame: Frame) -> Iterator[TrafficKind]:
        if frame.protocol == "can":
            yield self._can_traffic_kind(frame)
        elif frame.protocol == "mavlink":
            for piece in self._cutters[frame.origin].push(frame.payload):
                if not isinstance(piece, mavlink.Fault):
                    header = mavlink.parse_header(piece)
                    yield TrafficKind(frame.origin, str(header.system_id), mavlink.message_name(header.message_id))
        elif frame.protocol == "nmea0183":
            for part in nmea0183.split_into_sentences_and_rest(frame.payload):
                yield _sentence_traffic_kind(frame.origin, part)
        else:
            topic, message = mqtt.split_topic_and_message(frame.payload)
            sentence = clock.SENTENCE_WITH_PREFIX.fullmatch(message.strip())
            name = TOPIC_VALUE
            if sentence is not None:
                name = _sentence_traffic_kind("", sentence["inner"].encode("latin-1")).name
            yield TrafficKind(frame.origin, topic, name)

    def _can_traffic_kind(self, frame: Frame) -> TrafficKind:
        """The kind of a frame; who claims an address, and what the maker says that it is, is noted."""
        kind = frame.flags & ~(FrameFlag.LATE | FrameFlag.WHOLE)
        if kind == FrameFlag.STANDARD_ID:
            return TrafficKind(frame.origin, "", f"0x{frame.identifier:03X}")
        if kind:
            return TrafficKind(frame.origin, "", "remote or error frame")
        group, address = nmea2000.split_can_identifier(frame.identifier)
        payload: bytes | None = frame.payload
        if group == PRODUCT_INFORMATION and not frame.flags & FrameFlag.WHOLE and len(frame.payload) == 8:
            products = self._products[frame.origin]
            payload = products.push(address, group, frame.payload, frame.monotonic_ns, _PRODUCT_BYTES)
        if group in (nmea2000.ADDRESS_CLAIM, PRODUCT_INFORMATION) and payload is not None:
            self.devices.setdefault((frame.origin, str(address)), {}).update(
                _device_identity_fields(group, payload)
            )
        return TrafficKind(frame.origin, str(address), str(group))


def _sentence_traffic_kind(source_name: str, payload: bytes) -> TrafficKind:
    """The kind of a sentence; a maker's own has no talker."""
    tagged = nmea0183.split_tag_block(payload)
    tag, fields = nmea0183.split_sentence(tagged.sentence, unchecked=True) or ("", [])
    talker, name = ("", tag) if tag.startswith("P") else (tag[:-3], tag[-3:])
    number = f" {fields[0]}" if name in _NUMBERED and fields else ""
    device = f"{talker}@{tagged.source}" if tagged.source else talker
    return TrafficKind(source_name, device, f"{name}{number}" if tag else "no sentence")


def survey_frames(config: TrialConfig, frames: Iterable[Frame]) -> Survey:
    """The survey of frames that came in this order; those of sources that are not configured are skipped."""
    survey = Survey(config)
    for frame in frames:
        if frame.origin in survey.health.sources:
            survey.process(frame)
    survey.report_handovers()
    return survey


def survey_recording(config: TrialConfig, paths: Iterable[Path], most_frames: int | None = None) -> Survey:
    """The survey of the raw input in a recording's parts, or of its first ``most_frames``.

    Raises :class:`InputError` for files that are no recordings.
    """
    return survey_frames(config, islice(_read_raw_frames(paths), most_frames))


def _read_raw_frames(paths: Iterable[Path]) -> Iterator[Frame]:
    """The raw input, without what another program has put under such a topic."""
    for entry in chain.from_iterable(map(reader.MessageStream, paths)):
        if entry.topic.startswith(messages.RAW_PREFIX):
            with suppress(ValueError, KeyError, TypeError):
                yield entry.decode_frame()


def is_proprietary_group(group: int) -> bool:
    """Whether a parameter group is proprietary, which means something else with every maker."""
    return group in (61184, 126720) or 65_280 <= group < 65_536 or 130_816 <= group < 131_072


@cache
def parameter_group_name(group: int) -> str:
    """A parameter group's name in canboat's database; empty for what is proprietary or not known.

    >>> parameter_group_name(127250), parameter_group_name(65297)
    ('vesselHeading', '')
    """
    if is_proprietary_group(group):
        return ""
    names = {variant.id for variant in nmea2000.group_variants(group)}
    return names.pop() if len(names) == 1 else ""


def _device_identity_fields(group: int, payload: bytes) -> dict[str, Any]:
    """What a claim of an address, or a product's information, states of a device."""
    message = nmea2000.decode_by_library(group, payload)
    values = {} if message is None else {entry.id: entry.value for entry in message.fields}
    keys = {"model": "modelId", "version": "modelVersion", "software": "softwareVersionCode",
              "serial": "modelSerialCode"}  # fmt: skip
    iso_name = {}
    if group == nmea2000.ADDRESS_CLAIM:
        keys = {"manufacturer": "manufacturerCode", "function": "deviceFunction", "instance": "deviceInstance"}
        iso_name = {"iso_name": f"{int.from_bytes(payload[:8], 'little'):016x}"}
    return iso_name | {
        name: str(values[key]).strip() for name, key in keys.items() if values.get(key) not in (None, "")
    }


_RECIPES: tuple[tuple[tuple[str, ...], str, tuple[str, ...]], ...] = (
    (("heading_deg",), "heading_magnetic_deg", ("magnetic_variation_deg",)),
    (_SPEEDS, "velocity_north_mps", ("heading_deg",)),
    (_SPEEDS, "course_magnetic_deg", ("speed_over_ground_mps", "magnetic_variation_deg", "heading_deg")),
    (_SPEEDS, "course_over_ground_deg", ("speed_over_ground_mps", "heading_deg")),
    (_SPEEDS, "speed_over_ground_mps", ("course_over_ground_deg", "heading_deg")),
    (("wind_direction_deg",), "wind_direction_magnetic_deg", ("magnetic_variation_deg",)),
    (_WIND, "wind_angle_theoretical_deg", ("wind_speed_theoretical_mps", "heading_deg")),
    (_WIND, "wind_angle_apparent_deg", ("wind_speed_apparent_mps", "heading_deg", *_SPEEDS)),
    (_WIND, "wind_angle_water_deg", ("wind_speed_water_mps", "heading_deg", *_SPEEDS, "speed_through_water_mps")),
    (("north_m", "east_m"), "latitude_deg", ("longitude_deg",)),
)
"""Channels, what they are derived from, and what besides must be known for that."""


def missing_channels(survey: Survey) -> dict[str, str]:
    """The channels of the trial that have not come, and the reason for each."""
    received = survey.channels
    return {
        name: why_channel_is_missing(name, survey)
        for name in ship.trial_channel_names(survey.config.actuators)
        if name not in received
    }


def missing_reasons_by_raw_input(path: Path, present: Container[str]) -> dict[str, str]:
    """The channels of a recording's trial that are not ``present`` in it, and why, by its raw input.

    Empty where it carries none, or no configuration that can be read today.
    """
    with tempfile.TemporaryDirectory(prefix="seatrial-info-") as scratch:
        try:
            config = recorded_configuration(path, Path(scratch))
            absent = [name for name in config.watched_channels if name not in present]
            survey = survey_recording(config, [path], LOOKED_AT) if absent else None
        except errors.SeatrialError:
            return {}
    if survey is None or not survey.kinds:
        return {}
    return {name: why_channel_is_missing(name, survey) for name in absent}


def missing_reasons(config: TrialConfig, paths: Iterable[Path], names: Iterable[str]) -> dict[str, str]:
    """Why channels did not come, by the beginning of a recording; empty texts where it cannot be read."""
    try:
        survey = survey_recording(config, paths, LOOKED_AT)
    except errors.SeatrialError:
        return dict.fromkeys(names, "")
    return {name: why_channel_is_missing(name, survey) for name in names}


def reason_by_channels(missing: Mapping[str, str]) -> dict[str, str]:
    """The reasons once each, by the channels that they hold for, as one text.

    >>> reason_by_channels({"surge_mps": "no heading", "sway_mps": "no heading"})
    {'surge_mps, sway_mps': 'no heading'}
    """
    names: dict[str, list[str]] = {}
    for name, reason in missing.items():
        names.setdefault(reason, []).append(name)
    return {", ".join(channels): reason for reason, channels in names.items()}


def why_channel_is_missing(name: str, survey: Survey) -> str:
    """One reason why a channel has not come, and what to do about it."""
    if reason := why_channel_is_not_provided(name, survey):
        return reason
    for source in survey.config.sources:
        if name in source.channels and not survey.health.sources[source.name].frames:
            return f"nothing at all comes from {source.name!r}"
    if topics := _topics_of_channel(name, survey):
        return f"nothing comes under {' or '.join(dict.fromkeys(topics))}"
    carriers = [carrier for carrier in _CARRIERS.get(name, ()) if not carrier.isupper() or len(carrier) in (3, 5)]
    if carriers:
        return f"nothing that comes carries it: {', '.join(carriers[:-1])} or {carriers[-1]} would"
    if origins := _origin_messages_of_channel(name, survey):
        return f"nothing that comes carries it: {', '.join(origins)} would"
    names = {kind.name for kind in survey.kinds}
    proprietary = sorted(
        message
        for message in names
        if message.startswith("0x") or (message.isdigit() and is_proprietary_group(int(message)))
    )
    examples = f" ({', '.join(proprietary[:_MOST_NAMED])})" if proprietary else ""
    frames = f"the maker's own frames{examples}"
    return f"nothing that comes carries it: TRD, RPM, RSA or 127245 may, or {frames} by a DBC file"


def why_channel_is_not_provided(name: str, survey: Survey) -> str:
    """What comes that could make a channel, and why it does not; empty where nothing comes."""
    if labels := survey.quantities.get(name):  # on a line that is not to provide it
        source_name = split_source_label(next(iter(labels)))[0]
        return f"{_message_names(labels)} comes: add {name} to the channels of source {source_name!r}"
    if reason := _why_channel_is_not_derived(name, survey):
        return reason
    # a message that could carry it comes, but has no value for it
    carriers = {kind: tally for kind, tally in survey.kinds.items() if _can_carry_channel(kind, name, survey)}
    for kind, tally in sorted(carriers.items(), key=lambda entry: -entry[1].count):
        reason = _UNREAD.get(kind.name, "")
        for refusal, _ in tally.refused.most_common(1):
            reason = _REMEDIES.get(refusal, f"but is refused: {refusal}")
        if not reason and kind.name in _CARRIERS.get(name, ()):
            reason = "but holds no value for it"
        if reason:
            label = kind.device if kind.name == TOPIC_VALUE else kind.name
            return f"{label} comes, {reason}" if reason.startswith(("but", "without")) else f"{label} {reason}"
    return ""


def _why_channel_is_not_derived(name: str, survey: Survey) -> str:
    """Where its origin comes, but something else is missing to derive it: what; else empty."""
    for channels, origin, needs in _RECIPES:
        labels = survey.quantities.get(origin, {})
        if name not in channels or not labels:
            continue
        lacking = next((need for need in needs if not survey.is_available(need)), None)
        if lacking is not None:
            remedy = "the sensor leaves it out"
            if lacking == "magnetic_variation_deg":
                remedy = VARIATION_FIX
            elif lacking in ship.trial_channel_names(survey.config.actuators):
                remedy = why_channel_is_missing(lacking, survey)
            return f"{_message_names(labels)} comes, but no {_quantity_in_words(lacking)}: {remedy}"
        slowest = max(needs, key=lambda need: _quantity_interval_s(need, survey))
        if (interval_s := _quantity_interval_s(slowest, survey)) > _FRESH_S:
            remark = (
                f"{_quantity_in_words(slowest)} only every {interval_s:.0f} s: at most {_FRESH_S} s old it serves"
            )
            return f"{_message_names(labels)} comes, but {remark}"
    return ""


def _quantity_interval_s(quantity: str, survey: Survey) -> float:
    rates_hz = [tally.rate_hz for tally in survey.quantities.get(quantity, {}).values() if tally.rate_hz]
    return 1.0 / max(rates_hz) if rates_hz and quantity != "magnetic_variation_deg" else 0.0


def _can_carry_channel(traffic: TrafficKind, name: str, survey: Survey) -> bool:
    """Whether a message can carry a channel; one of a thruster's number only that thruster's."""
    message = traffic.name
    if message == TOPIC_VALUE:
        return traffic.device in _topics_of_channel(name, survey)
    origins = _origin_messages_of_channel(name, survey)
    if name in _CARRIERS or origins:
        return message in _CARRIERS.get(name, ()) or message in origins
    kind, _, number = message.partition(" ")
    owners = [
        thruster
        for source in survey.config.sources
        if isinstance(source, LineSource | MqttLinks)
        for thruster, thruster_number in source.thrusters.numbers.items()
        if number == str(thruster_number)
    ]
    return kind in _OF_ACTUATORS and (not owners or any(name.startswith(f"{owner}_") for owner in owners))


def sources_of_channel(name: str, survey: Survey) -> set[str]:
    """The sources on which a message comes that can carry a channel."""
    return {kind.source for kind in survey.kinds if _can_carry_channel(kind, name, survey)}


def _topics_of_channel(name: str, survey: Survey) -> list[str]:
    sources = (source for source in survey.config.sources if isinstance(source, MqttLinks))
    return [
        source.values[name].topic
        for source in sources
        if name in source.values and (name in source.channels or not isinstance(source, OwnSource))
    ]


def _origin_messages_of_channel(name: str, survey: Survey) -> list[str]:
    """The messages that a declared channel may come from."""
    origins = (
        origin
        for declaration in survey.config.declared
        if declaration.channel.name == name
        for origin in declaration.origins
    )
    return list(dict.fromkeys(map(message_name_of_origin, origins)))


def message_name_of_origin(origin: Origin) -> str:
    """The message that an origin of a declared channel is in, by the name that a survey has for it."""
    if isinstance(origin, SentenceField):
        return origin.sentence
    if isinstance(origin, GroupField):
        return str(origin.group)
    return origin.message if isinstance(origin, MavlinkField) else "XDR"


def _message_names(labels: Iterable[str]) -> str:
    """The messages in labels of sources, the most frequent first."""
    return " and ".join(list(Counter(split_source_label(label)[2][0] for label in labels))[:2])


def _quantity_in_words(quantity: str) -> str:
    """A quantity in words: ``magnetic_variation_deg`` is the variation."""
    words = {"magnetic_variation_deg": "variation", **dict.fromkeys(_SPEEDS, "speed over ground")}
    return words.get(quantity, quantity.rpartition("_")[0].replace("_", " "))


@dataclass(frozen=True, slots=True)
class ChannelReport:
    """What came of one channel during the check; ``problem`` is empty where all is well."""

    name: str
    rate_hz: float
    value: float | None
    source: str
    problem: str
    unit: str = ""


@dataclass(frozen=True, slots=True)
class PreflightReport:
    """The result of a check: every channel, every source, the events, and where a recording would go.

    ``sinks`` says what is wrong with each, or as a remark in brackets what is not known of it. ``disk_problem``
    says why nothing could be recorded there; it is empty where all is well.
    """

    channels: list[ChannelReport]
    sources: list[dict[str, Any]]
    events: list[str]
    free_bytes: int | None
    disk_problem: str = ""
    sinks: dict[str, str] = field(default_factory=dict)

    @property
    def missing_channels(self) -> list[str]:
        """The channels that would be missing."""
        return [channel.name for channel in self.channels if channel.problem]

    @property
    def obstacles(self) -> list[str]:
        """Why the trial is not ready; nothing if it is."""
        missing = [f"{', '.join(self.missing_channels)} would be missing"] if self.missing_channels else []
        sinks = [f"sink {name}: {text}" for name, text in self.sinks.items() if text and not text.startswith("(")]
        return missing + ([self.disk_problem] if self.disk_problem else []) + sinks

    def as_json(self) -> dict[str, Any]:
        return {"ready": not self.obstacles, "missing": self.missing_channels, **asdict(self)}


def check_before_departure(
    config: TrialConfig, duration_s: float, folder: Path | None = None, stop: threading.Event | None = None
) -> PreflightReport:
    """Listen to every source for ``duration_s`` [s]; ``folder`` is where the recording would go, if it is known.

    Raises :class:`SourceError` when no source can be opened, :class:`StorageError` when nothing can be written,
    :class:`ConfigurationError` for an alarm of a figure that does not exist.
    """
    check_alarms(config.alarms, initial_health(config))
    scratch_settings = replace(config.recording, reserve_mb=0.0)  # the reserve is for the trial's disk
    with tempfile.TemporaryDirectory(prefix="seatrial-check-") as scratch:
        parts = RecordingParts(Path(scratch), config.trial, config.attachments, scratch_settings)
        recorder = Recorder(config, parts)
        try:
            recorder.start()
            until_s = time.monotonic() + duration_s
            while time.monotonic() < until_s and not recorder.ended:
                if (stop or threading.Event()).wait(0.05):
                    break
            now_ns = time.monotonic_ns()
            sources = [source.as_message(now_ns) for source in recorder.health.sources.values()]
            recorder.stop()
            survey = survey_recording(config, parts.paths)
            channels = []
            for name in recorder.health.names:
                channel, unit = recorder.health.channels[name], recorder.health.known_channels[name].unit
                value, rate_hz = channel.value if channel.count else None, channel.rate_hz(now_ns)
                problem = _channel_problem(name, survey, recorder.health, now_ns)
                channels.append(ChannelReport(name, rate_hz, value, channel.source, problem, unit))
        finally:
            parts.delete_everything_written()
    events = [text for _, level, text in recorder.health.events if level != "info"]
    free, disk_problem = (None, "") if folder is None else check_recording_folder(folder, config.recording)
    if config.copies is not None and not config.copies.folder.is_dir():
        disk_problem = "; ".join(filter(None, (disk_problem, f"{config.copies.folder} is not there to copy to")))
    return PreflightReport(channels, sources, events, free, disk_problem, check_sinks(config))


def check_recording_folder(folder: Path, settings: RecordingSection) -> tuple[int | None, str]:
    """What is free where a recording would go [bytes], and why it could not; nothing is written there."""
    existing = next(directory for directory in (folder, *folder.absolute().parents) if os.path.lexists(directory))
    if not existing.is_dir():
        return None, f"{folder}: {existing} is no folder"
    if not os.access(existing, os.W_OK | os.X_OK):
        problem = "written to" if existing == folder else f"made: {existing} cannot be written to"
        return None, f"{folder} cannot be {problem}"
    try:
        free, size = free_and_total_bytes(existing)
    except OSError as error:
        return None, f"{folder}: its disk cannot be asked for room: {error.strerror}"
    reason = shortage_text(settings, free, size)
    return free, f"{folder}: {reason}" if reason else ""


def _channel_problem(name: str, survey: Survey, health: Health, now_ns: int) -> str:
    channel = health.channels[name]
    providers = [source.name for source in survey.config.sources if name in source.channels]
    if channel.count == 0:
        failed = [provider for provider in providers if health.sources[provider].state in ("opening", "failed")]
        if failed:
            return "; ".join(f"source {provider!r} cannot be opened" for provider in failed)
        if providers:
            return why_channel_is_missing(name, survey)
        return "; ".join(filter(None, ("no source provides it", why_channel_is_not_provided(name, survey))))
    if channel.age_s(now_ns) * 1e9 > SILENT_NS:
        return f"fell silent {channel.age_s(now_ns):.0f} s ago"
    if channel.expected_hz is not None and channel.rate_hz(now_ns) < ENOUGH_RATE * channel.expected_hz:
        return f"comes {channel.rate_hz(now_ns):.1f} times a second instead of {channel.expected_hz:g}"
    return ""


@dataclass(slots=True)
class RedecodeSummary:
    """What was decoded again: raw frames in, samples out, and frames of sources that are not configured.

    ``omitted`` counts predictions in another version's form.
    """

    health: Health
    frames: int = 0
    omitted: int = 0
    unknown: dict[str, int] = field(default_factory=dict)


def redecode(
    paths: list[Path], target: Path, config: TrialConfig | None = None, progress: errors.Progress | None = None
) -> RedecodeSummary:
    """Decode the raw input of a recording's parts, given in order, into ``target``.

    Without ``config`` the recording's own serves: the same decoding with today's software. Raises
    :class:`InputError` for recordings without raw input or configuration, :class:`StorageError`.
    """
    require_suffix(target, ".mcap")
    if target.exists():
        raise errors.StorageError("already exists", where=str(target), fix="choose another file, or delete it")
    with tempfile.TemporaryDirectory(prefix="seatrial-redecode-") as scratch:
        config = config or recorded_configuration(paths[0], Path(scratch))
        config = replace(config, sinks=(), live=None)  # they get what is live alone
        with atomic_file(target) as partial:
            with RecordingWriter(partial, config.trial, config.attachments) as writer:
                result = _decode_parts(paths, config, writer, progress or (lambda share: None))
            if result.frames == 0:
                raise errors.InputError("contains no raw input to decode", where=str(paths[0]))
    return result


def recorded_configuration(path: Path, scratch: Path) -> TrialConfig:
    """The configuration that a recording carries, its DBC files laid out in ``scratch``."""
    stream = reader.MessageStream(path)
    next(iter(stream), None)
    text = stream.attachments.get(CONFIGURATION)
    if text is None:
        fix = "give one with --config, as `seatrial record` takes it"
        raise errors.InputError("contains no configuration", where=str(path), fix=fix)
    files: dict[str, Path] = {}
    packs: dict[str, str] = {}
    for attachment, data in stream.attachments.items():
        name, dot, ending = attachment.rpartition(".")
        if ending == "dbc":
            files[name] = scratch / f"{len(files)}.dbc"
            files[name].write_bytes(data)
        elif dot + ending == PACK_ENDING:
            packs[name] = data.decode("utf-8", "replace")
    run_sheet = reader.read_trial(path)
    is_ship_stated = ship.is_ship_known(run_sheet.vessel, run_sheet.actuators)
    carried = CarriedFiles(files, packs, ship.parse_actuators(run_sheet.actuators), ship_is_known=is_ship_stated)
    config = parse_config(text.decode("utf-8", "replace"), path, carried)
    if config.trial.origin is not None or run_sheet.origin is None:
        return config
    latitude_deg, longitude_deg = run_sheet.origin  # of a fix in an earlier part of the recording
    trial = replace(config.trial, origin_latitude_deg=latitude_deg, origin_longitude_deg=longitude_deg)
    return replace(config, trial=trial)


def _decode_parts(
    paths: list[Path], config: TrialConfig, writer: RecordingWriter, progress: errors.Progress
) -> RedecodeSummary:
    result = RedecodeSummary(initial_health(config))
    processing = FrameProcessor(config, writer, result.health)
    last_ns = 0
    for number, entry in enumerate(_read_message_entries(paths, progress), start=1):
        if number % _FLUSH_EVERY == 0:
            writer.flush()
        if number == 1:
            result.health.started_ns = entry.log_ns
        result.health.ended_ns = last_ns = max(last_ns, entry.log_ns)
        if entry.topic.startswith(messages.RAW_PREFIX):
            try:
                frame = entry.decode_frame()
            except (ValueError, KeyError, TypeError) as error:
                problem = f"topic {entry.topic} contains a message that is not a raw input of Seatrial"
                where, cause = ", ".join(map(str, paths)), f"{type(error).__name__} {error}"
                raise errors.InputError(problem, where=where, why=cause) from error
            if frame.origin in result.health.sources:
                result.health.sources[frame.origin].add_frames(1, frame.monotonic_ns)
                processing.process(frame)
                result.frames += 1
            else:
                writer.write_raw(frame)
                result.unknown[frame.origin] = result.unknown.get(frame.origin, 0) + 1
        else:
            result.omitted += not _copy_note_or_prediction(entry, writer)
    processing.report_handovers()
    names = ", ".join(path.name for path in paths)
    processing.note(f"decoded again from {names}", last_ns)
    if result.omitted:
        processing.note(f"{result.omitted:,} predictions of another version were left out", last_ns, "warning")
    return result


def _copy_note_or_prediction(entry: reader.MessageEntry, writer: RecordingWriter) -> bool:
    """Copy a note or a prediction, as it is written today; False for one of another version, which does not fit."""
    if entry.topic == messages.EVENT_TOPIC:
        is_copied = entry.decode_body().get("name") != DECODED
    else:
        is_copied = entry.topic in (messages.PREDICTION_TOPIC, messages.PREDICTED_TRACK_TOPIC)
    if is_copied:
        try:
            data = messages.encode(entry.topic, entry.decode_body())
        except (KeyError, TypeError, ValueError):
            return False
        writer.write(entry.topic, data, entry.log_ns, entry.publish_ns)
    return True


def _read_message_entries(paths: list[Path], progress: errors.Progress) -> Iterator[reader.MessageEntry]:
    for number, path in enumerate(paths):
        yield from reader.MessageStream(path)
        progress((number + 1) / len(paths))
