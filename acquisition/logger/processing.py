"""Turns received frames into a recording: kept raw, decoded, derived, and one source selected for each channel.

A channel has one source at a time, by the order of the configuration, its devices, fixes and messages. Derived are
the 13 channels from the quantities on the wires: the trial's plane, the ship's axes, true north, wind over ground.
What is derived says so in its source. Values that a channel cannot hold are left out and counted.
"""

from __future__ import annotations

import logging
from collections import ChainMap, Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import chain
from math import inf, radians

from seatrial.acquisition.config.sources import AnySource, CanFrames, MavlinkLinks, Mounting, MqttLinks
from seatrial.acquisition.config.trial_file import TrialConfig
from seatrial.acquisition.core import quantities
from seatrial.acquisition.core import trial as trials
from seatrial.acquisition.core.ship import BY_NAME, Channel, channels_of_trial
from seatrial.acquisition.logger.health import LOG, SILENT_NS, Handover, Handovers, Health
from seatrial.acquisition.protocols import NO_SATELLITES, Decoder, decoders_by_protocol, mqtt
from seatrial.acquisition.recording.messages import MessageSink

_VARIATION_ERROR_DEG = 1.0  # twice what the World Magnetic Model's declination errs by, as its makers say (0.4 deg)
_EVENTS_A_MINUTE = 30
_MOST_CONTRADICTIONS = 100  # sources are named by what comes off the wire
DECODED = "decoding"
"""The name of events that decoding emits, and would emit again."""
_LOG_LEVELS = {"info": logging.INFO, "warning": logging.WARNING, "error": logging.ERROR}

POSITION = frozenset({"north_m", "east_m", "latitude_deg", "longitude_deg"})
VARIATION = "magnetic_variation_deg"
VARIATION_KEEPS_NS = 600 * 10**9
"""The variation changes by tenths of a degree in an hour's way: the last value holds while its source is silent."""
_MOST_RANKS = 10_000

# What a device sends in two messages, and which of them is the slower or coarser one: 129025 comes ten times as
# often as 129029, LOCAL_POSITION_NED has the finer speeds, GGA states whether there is a fix at all.
_CHOICE = {
    **dict.fromkeys(
        ("129029", "130577", "GLOBAL_POSITION_INT", "RMC", "GLL", "HDM", "PASHR", "MDA", "VWR", "VWT", "HTD"), 1
    ),
    **dict.fromkeys(("GPS_RAW_INT", "GPS_GLOBAL_ORIGIN"), 2),
}
_MEANING = {"": 0, "engine": 1, "magnetic": 2, "theoretical": 2, "water": 4, "apparent": 4}
"""How far from the channel itself a message's reference is: what needs less derivation is preferred."""
_OF_A_FIX = frozenset({"GGA", "GNS", "RMC", "GLL", "VTG", "129025", "129026", "129029"})
"""Messages that repeat one fix of one receiver: which of them a position is read from is no news."""

# By the numbers of GGA: fixed and floating ambiguities, then precise, differential, corrected by satellite; plain.
_GRADE = {4: 0, 5: 1, 3: 2, 2: 2, 9: 2}
_PLAIN_GRADE = 3
_UNKNOWN_FIX = trials.Fix()
_TURN_FRACTION = 0.75  # of the time from one message to the next: what comes earlier is concurrent

Rank = tuple[bool, bool, int, int, int, int]
"""No satellites, a stand-in's, grade of the fix; line, device on it, message: what is smaller is preferred."""

_HEADING_KEEPS_NS = 1_500_000_000  # carried on by the rate of turn for as long
_MOTION_KEEPS_NS = 1_500_000_000
_FULL_TURN_DEG = 360.01  # a turn rounded up to a wire's step: NMEA 2000 can send 360.0008 degrees
_UNCORRECTED = Mounting()

_HEADINGS = ("heading_deg", "heading_magnetic_deg")
_BOW_WINDS = ("apparent", "theoretical", "water")
# What decoders deliver that is no channel is held to the limits of the channel of its kind.
_KINDS = {
    "velocity_north_mps": "surge_mps",
    "velocity_east_mps": "surge_mps",
    "course_magnetic_deg": "course_over_ground_deg",
    "wind_direction_magnetic_deg": "wind_direction_deg",
    **{f"wind_angle_{kind}_deg": "apparent_wind_angle_deg" for kind in _BOW_WINDS},
    **{f"wind_speed_{kind}_mps": "wind_speed_mps" for kind in _BOW_WINDS},
}
_PAIRS = (
    ("latitude_deg", "longitude_deg"),
    ("north_m", "east_m"),
    ("surge_mps", "sway_mps"),
    ("velocity_north_mps", "velocity_east_mps"),
    ("course_over_ground_deg", "speed_over_ground_mps"),
    ("course_magnetic_deg", "speed_over_ground_mps"),
    ("wind_direction_deg", "wind_speed_mps"),
    ("wind_direction_magnetic_deg", "wind_speed_mps"),
    ("apparent_wind_angle_deg", "apparent_wind_speed_mps"),
    *((f"wind_angle_{kind}_deg", f"wind_speed_{kind}_mps") for kind in _BOW_WINDS),
)
_PARTNERS = {
    quantity: {partner for pair in _PAIRS if quantity in pair for partner in pair if partner != quantity}
    for quantity in {name for pair in _PAIRS for name in pair}
}
_REMEMBERED = frozenset({"heading_deg", "yaw_rate_dps", "surge_mps", "sway_mps", "speed_through_water_mps"})
_BOW_WIND_NAMES = tuple((kind, f"wind_angle_{kind}_deg", f"wind_speed_{kind}_mps") for kind in _BOW_WINDS)
_COMPASS = frozenset({*_HEADINGS, "magnetic_variation_deg"})
_VELOCITY = frozenset({"velocity_north_mps", "speed_over_ground_mps", "surge_mps", "sway_mps"})
_WIND = frozenset({"wind_direction_magnetic_deg", *(angle for _, angle, _ in _BOW_WIND_NAMES)})
_DERIVED_FROM = _COMPASS | _VELOCITY | _WIND | {"latitude_deg"}

Quantities = dict[str, trials.Sample]


@dataclass(slots=True)
class _EventBudget:
    """How many events a source may still emit in this minute."""

    until_ns: int = 0
    remaining: int = _EVENTS_A_MINUTE
    omitted: int = 0


class FrameProcessor:
    """Frames into a recording; for one thread only."""

    def __init__(self, config: TrialConfig, writer: MessageSink, health: Health) -> None:
        self._trial = config.trial
        self._writer = writer
        self._health = health
        ship = config.actuators, config.declared
        self._decoders = {source.name: decoders_by_protocol(source, *ship) for source in config.sources}
        for name, decoders in self._decoders.items():
            health.sources[name].refusals = [decoder.refused for decoder in chain(*decoders.values())]
            health.sources[name].unknown_messages = [decoder.unknown for decoder in chain(*decoders.values())]
        self._addresses = {source.name: source.addresses for source in config.sources
                           if isinstance(source, CanFrames) and source.addresses}  # fmt: skip
        self._failed: dict[str, Counter[str]] = {source.name: Counter() for source in config.sources}
        self._address_refusals: dict[str, Counter[str]] = {name: Counter() for name in self._addresses}
        for name, refused in chain(self._failed.items(), self._address_refusals.items()):
            health.sources[name].refusals.append(refused)
        self._derivation = Derivation(
            config.trial,
            frozenset(source.name for source in config.sources if POSITION & set(source.channels)),
            {source.name: source.mounting for source in config.sources},
            config.magnetic_variation_deg,
        )
        self._fixes = ChainMap(
            *(decoder.fixes for decoders in self._decoders.values() for decoder in chain(*decoders.values()))
        )
        self._selector = Selector(config.sources, self._fixes)
        self._variations = Selector(config.sources, {}, VARIATION_KEEPS_NS, anywhere=VARIATION)
        self._variation: trials.Sample | None = None
        self._contradict: set[str] = set()
        self._event_budgets = {source.name: _EventBudget() for source in config.sources}
        self._handovers = Handovers()

    def mute_clock_reports(self, origin: str) -> None:
        """Report nothing of this source's clocks: its frames have no times that they could be compared with."""
        for decoder in chain(*self._decoders[origin].values()):
            if (clock := getattr(decoder, "clock", None)) is not None:
                clock.muted = True

    def process(self, frame: trials.Frame) -> None:
        """Record the frame raw and every channel sample that is in it."""
        self._writer.write_raw(frame)
        try:
            self._decode_and_record(frame)
        except Exception as error:  # the frame is kept raw, and must not end the recording
            if not self._failed[frame.origin]["processing failed"]:
                text = f"{frame.origin}: a frame could not be interpreted: {type(error).__name__} {error}"
                self.note(text, frame.received_ns, "error", DECODED)
            self._failed[frame.origin]["processing failed"] += 1

    def report_handovers(self, now_ns: float = inf) -> None:
        """Report which channels have other sources, of causes that are over by now [monotonic, ns] or of all."""
        for frame, text in self._handovers.take_due(now_ns):
            self._note_event_within_budget(frame, text, "warning")

    def _decode_and_record(self, frame: trials.Frame) -> None:
        if self._handovers.causes:
            self.report_handovers(frame.monotonic_ns)
        budget = self._event_budgets[frame.origin]
        if budget.omitted and frame.monotonic_ns >= budget.until_ns:
            text = f"{frame.origin}: {budget.omitted:,} more events were left out"
            self.note(text, frame.received_ns, "warning", DECODED)
            budget.omitted = 0
        if frame.origin in self._addresses:
            has_address = frame.protocol == "can" and not frame.flags & trials.FrameFlag.STANDARD_ID
            if has_address and frame.identifier & 0xFF not in self._addresses[frame.origin]:
                self._address_refusals[frame.origin]["address that is not allowed"] += 1
                return
        health = self._health.sources[frame.origin]
        for decoder in self._decoders[frame.origin].get(frame.protocol, ()):
            for group in self._decode_groups(decoder, frame):
                samples, impossible = self._derivation.derive_channels(
                    self._drop_unselected_variation(group, frame)
                )
                health.impossible += impossible
                self._record_samples(samples, frame)
            while decoder.notices:
                level, text = decoder.notices.popleft()
                self._note_event_within_budget(frame, f"{frame.origin}: {text}", level)

    def _decode_groups(self, decoder: Decoder, frame: trials.Frame) -> list[trials.Group]:
        """The frame's groups. A frame that a decoder fails at is kept raw and must not end the recording."""
        try:
            return decoder.decode(frame)
        except Exception as error:
            if not decoder.refused["decoder failed"]:
                text = f"{frame.origin}: a frame broke the decoder: {type(error).__name__} {error}"
                self.note(text, frame.received_ns, "error", DECODED)
            decoder.refused["decoder failed"] += 1
            return []

    def _drop_unselected_variation(self, group: trials.Group, frame: trials.Frame) -> trials.Group:
        """The group, without a magnetic variation of another source than the one that all headings go by."""
        sample = next((member for member in group if member.quantity == VARIATION), None)
        if sample is None or not BY_NAME[VARIATION].is_possible_value(sample.value):
            return group
        chosen, change = self._variations.select_and_report_handover(sample)
        if change is not None:
            self._handovers.add(change, frame)
        if chosen:
            self._variation = sample
            return group
        is_news = sample.source not in self._contradict and len(self._contradict) < _MOST_CONTRADICTIONS
        if is_news and self._variation is not None:
            difference_deg = sample.value - self._variation.value
            if abs(difference_deg) > _VARIATION_ERROR_DEG:
                self._contradict.add(sample.source)
                text = (
                    f"{sample.source} tells a magnetic variation of {sample.value:.2f} deg,"
                    f" {difference_deg:+.2f} deg from that of {self._variation.source}, which is taken;"
                    " who is listed first is believed"
                )
                self._note_event_within_budget(frame, text, "warning")
        return [member for member in group if member is not sample]

    def _record_samples(self, samples: list[trials.Sample], frame: trials.Frame) -> None:
        has_position = False
        for sample in samples:
            accepted, change = self._selector.select_and_report_handover(sample)
            if change is not None:
                self._handovers.add(change, frame)
            if accepted:
                self._writer.write_sample(sample)
                self._health.add_sample(sample)
                self._derivation.remember_channel_sample(sample)
                has_position = has_position or sample.quantity in POSITION
        if has_position:  # the fix for the map, from the source that the position channels come from
            quantities = {sample.quantity: sample for sample in samples}
            latitude, longitude = quantities.get("latitude_deg"), quantities.get("longitude_deg")
            if latitude is not None and longitude is not None:
                fix = self._fixes.get(trials.line_and_device(latitude.source), _UNKNOWN_FIX)
                times = latitude.received_ns, latitude.measured_ns
                self._writer.write_position(latitude.value, longitude.value, *times, fix)
        if self._trial.origin is None and self._derivation.origin is not None:
            latitude_deg, longitude_deg = self._derivation.origin  # the recording must state it
            self._trial = replace(self._trial, origin_latitude_deg=latitude_deg, origin_longitude_deg=longitude_deg)
            self._writer.write_trial(self._trial)
            text = f"the first fix is the origin: {latitude_deg:.7f}, {longitude_deg:.7f}"
            self.note(text, frame.received_ns, "info", DECODED)

    def _note_event_within_budget(self, frame: trials.Frame, text: str, level: str) -> None:
        """Note an event of decoding, within the source's budget: malformed input can cause events without end."""
        budget, now_ns = self._event_budgets[frame.origin], frame.monotonic_ns
        if now_ns >= budget.until_ns:
            budget.until_ns, budget.remaining = now_ns + 60_000_000_000, _EVENTS_A_MINUTE
        budget.remaining -= 1
        if budget.remaining >= 0:
            self.note(text, frame.received_ns, level, DECODED)
        else:
            budget.omitted += 1

    def note(self, text: str, received_ns: int, level: str = "info", name: str = "seatrial") -> None:
        """Put a line into the recording's event log and the display."""
        self._writer.write_event(text, received_ns, level, name)
        self._health.events.append((received_ns, level, text), name)
        LOG.log(_LOG_LEVELS[level], text, extra={"more": {"recording_time": received_ns / 1e9, "name": name}})


@dataclass(slots=True)
class _Holder:
    """Who has a channel: its last sample, its rank, and the time between its last two messages [ns].

    ``latest`` is its last message, which may be one that was not let through: of another talker, while it is open
    whether that is a name of the same receiver.
    """

    sample: trials.Sample
    rank: Rank
    latest: trials.Sample
    interval_ns: int | None = None

    def since(self, sample: trials.Sample) -> int:
        """The time since its last message: between the measurements as far as both state their times [ns]."""
        if self.latest.source_ns is not None and sample.source_ns is not None:
            return sample.source_ns - self.latest.source_ns
        return sample.monotonic_ns - self.latest.monotonic_ns

    def continue_with(self, sample: trials.Sample, rank: Rank) -> None:
        """Take note of the next message that is let through."""
        self.interval_ns = self.since(sample)
        self.sample, self.rank, self.latest = sample, rank, sample


class Selector:
    """Lets one source a channel through, so that a channel never mixes two sensors sample by sample.

    The order of the configuration's sources is the order of preference, and within a bus the order of its
    devices; of an MQTT broker's a channel's own topic goes before sentences, of a vehicle its autopilot before
    a companion. A position by satellites is preferred to any other, and among substitutes of the first the
    better fix, by ``fixes``: what each sensor's receiver says of its fix, by GGA's numbers. Of two messages the
    finer one has it, and what needs less derivation. What is equal in all this, two devices that are not
    listed, say, is decided by who came first, until that has been silent for ``patience_ns``.

    The talkers of satellite receivers are names of one receiver, which may change from one fix to the next, until
    two of them send the same thing concurrently. Every line may provide what is listed ``anywhere``, after those
    that list it, which are waited for at first: what is taken from another would change at once.
    """

    def __init__(
        self,
        sources: tuple[AnySource, ...],
        fixes: Mapping[str, trials.Fix] | None = None,
        patience_ns: int = SILENT_NS,
        anywhere: str = "",
    ) -> None:
        self._source_ranks = {
            (source.name, channel): rank for rank, source in enumerate(sources) for channel in source.channels
        }
        for rank, source in enumerate(sources, len(sources)):
            if anywhere:
                self._source_ranks.setdefault((source.name, anywhere), rank)
        self._devices = {
            (source.name, device.name): rank
            for source in sources
            if isinstance(source, CanFrames)
            for rank, device in enumerate(source.devices)
        }
        self._mapped = {
            (source.name, mqtt.split_device_and_signal(entry.topic)[0], channel)
            for source in sources
            if isinstance(source, MqttLinks)
            for channel, entry in source.values.items()
            if channel not in POSITION
        }
        self._vehicles = {source.name for source in sources if isinstance(source, MavlinkLinks)}
        self._best_source_rank: dict[str, int] = {}
        for (_, quantity), rank in self._source_ranks.items():
            self._best_source_rank[quantity] = min(rank, self._best_source_rank.get(quantity, rank))
        self._anywhere, self._listed = anywhere, len(sources)
        self._since_ns: int | None = None
        self._lists_devices = {source_name for source_name, _ in self._devices}
        self._fixes = fixes or {}
        self._patience_ns = patience_ns
        self._ranks: dict[tuple[str, str, int | None], Rank | None] = {}
        self._holders: dict[str, _Holder] = {}
        self._rivals: set[tuple[str, str]] = set()

    def select_and_report_handover(self, sample: trials.Sample) -> tuple[bool, Handover | None]:
        """Whether the sample is the channel's, and the change to be reported if it comes from another source now.

        Call once a sample, in order of reception.
        """
        rank = self._rank(sample.source, sample.quantity)
        if rank is None:
            return False, None
        holder = self._holders.get(sample.quantity)
        if holder is None:
            if sample.quantity == self._anywhere and self._may_preferred_source_still_send(sample, rank):
                return False, None
            self._holders[sample.quantity] = _Holder(sample, rank, sample)
            return True, None
        pair = holder.sample.source, sample.source
        interval_ns = holder.since(sample) if holder.latest is not holder.sample else None
        if pair[0] == pair[1] or self._is_same_receiver(holder, sample):
            holder.continue_with(sample, rank)
            return True, None
        if rank < holder.rank or sample.monotonic_ns - holder.sample.monotonic_ns > self._patience_ns:
            handover = Handover(sample.quantity, *pair, rank < holder.rank)
            self._holders[sample.quantity] = _Holder(sample, rank, sample, interval_ns)
            return True, None if _share_receiver(*pair) and pair not in self._rivals else handover
        return False, None

    def _may_preferred_source_still_send(self, sample: trials.Sample, rank: Rank) -> bool:
        """Whether a line or device that is listed before the sample's may yet send."""
        *_, source_rank, device_rank, _ = rank
        best_rank = self._best_source_rank[sample.quantity]
        is_expected = (source_rank > best_rank and best_rank < self._listed) or (
            device_rank > 0 and trials.split_source_label(sample.source)[0] in self._lists_devices
        )
        if self._since_ns is None:
            self._since_ns = sample.monotonic_ns
        return is_expected and sample.monotonic_ns - self._since_ns <= SILENT_NS

    def _is_same_receiver(self, holder: _Holder, sample: trials.Sample) -> bool:
        """Whether the holder continues under another talker: in turn, and never concurrently with the former.

        That takes the time between two messages. Until it is known the other's are not let through, but count as
        messages: of a receiver that changes its talker with every one, they halve the time.
        """
        pair = holder.sample.source, sample.source
        messages = [trials.split_source_label(source)[2] for source in pair]
        if not _share_receiver(*pair) or pair in self._rivals or messages[0] != messages[1]:
            return False
        if (holder.latest.source_ns is None) != (sample.source_ns is None):
            return False
        if holder.interval_ns is None:
            holder.latest = sample
            return False
        if holder.interval_ns > 0 and holder.since(sample) >= _TURN_FRACTION * holder.interval_ns:
            return True
        if len(self._rivals) < _MOST_RANKS:
            self._rivals |= {pair, pair[::-1]}
        return False

    def _rank(self, source: str, quantity: str) -> Rank | None:
        """How much a message is preferred; None where its line is not to provide the quantity."""
        fix = self._fixes.get(trials.line_and_device(source), _UNKNOWN_FIX).kind if quantity in POSITION else None
        key = source, quantity, fix
        if key in self._ranks:
            return self._ranks[key]
        if len(self._ranks) >= _MOST_RANKS:  # sources are named by what comes off the wire: without end
            self._ranks.clear()
        source_name, device, (message, *meaning) = trials.split_source_label(source)
        source_rank, rank = self._source_ranks.get((source_name, quantity)), None
        if source_rank is not None:
            derived = meaning[-1:] == ["derived"] and quantity not in POSITION
            kind = next((_MEANING[word] for word in meaning if word in _MEANING), 0)
            choice = 0 if quantity == VARIATION else 10 * _CHOICE.get(message, 0) + kind + derived
            device_rank = self._devices.get((source_name, device.partition("@")[0]), len(self._devices))
            if (source_name, device, quantity) in self._mapped:
                device_rank = -1
            if source_name in self._vehicles and "." in device.partition("@")[0]:
                device_rank += 1
            rank = False, False, 0, source_rank, device_rank, choice
            if quantity in POSITION:
                lists_devices = device_rank > 0 and source_name in self._lists_devices
                stands_in = source_rank > self._best_source_rank[quantity] or lists_devices
                grade = _GRADE.get(fix or 0, _PLAIN_GRADE)
                rank = fix in NO_SATELLITES, stands_in, grade, source_rank, device_rank, choice
        self._ranks[key] = rank
        return rank


@lru_cache(maxsize=4096)
def _share_receiver(source_a: str, source_b: str) -> bool:
    """Whether two sources are messages of a fix by one receiver, as far as their names show."""
    messages = {trials.split_source_label(source)[2][0] for source in (source_a, source_b)}
    return trials.line_and_device(source_a) == trials.line_and_device(source_b) and messages <= _OF_A_FIX


class Derivation:
    """The channels of one trial from what its decoders deliver, sample group by sample group.

    A group is what came in one message. Without an origin in ``trial`` the first fix of one of the lines
    ``positions_from`` becomes the origin; ``origin`` then tells which it is. ``mountings`` says by line how its
    sensors are mounted; ``variation_deg`` serves until a device tells the magnetic variation.
    """

    def __init__(
        self,
        trial: trials.Trial,
        positions_from: frozenset[str],
        mountings: Mapping[str, Mounting] | None = None,
        variation_deg: float | None = None,
    ) -> None:
        self._plane = None if trial.origin is None else quantities.TangentPlane(*trial.origin)
        self._positions_from = positions_from
        self._mountings = {
            name: mounting for name, mounting in (mountings or {}).items() if mounting != _UNCORRECTED
        }
        self._variation_deg = variation_deg
        self._channels = channels_of_trial(trial)
        self._limits = {**self._channels, **{quantity: BY_NAME[channel] for quantity, channel in _KINDS.items()}}
        self._headings: dict[str, trials.Sample] = {}  # by line, admitted or not, of one compass
        self._ship: Quantities = {}  # the last of each that became the ship's channel

    @property
    def origin(self) -> tuple[float, float] | None:
        """Latitude and longitude of the plane's origin [deg], once it is known."""
        return None if self._plane is None else self._plane.origin

    def remember_channel_sample(self, sample: trials.Sample) -> None:
        """Take note of what became the ship's channel: other lines' samples are derived with it."""
        if sample.quantity in _REMEMBERED:
            self._ship[sample.quantity] = sample

    def derive_channels(self, group: trials.Group) -> tuple[list[trials.Sample], int]:
        """The channel samples in a group, angles wrapped, and how many values no channel can hold."""
        valid, impossible = _drop_impossible_samples(group, self._limits)
        stated = _DERIVED_FROM.intersection([sample.quantity for sample in valid])
        if stated:
            valid, impossible_derived = _drop_impossible_samples(self._derive_samples(valid, stated), self._limits)
            impossible += impossible_derived
        return [sample for sample in valid if sample.quantity in self._channels], impossible

    def _derive_samples(self, group: trials.Group, stated: frozenset[str]) -> list[trials.Sample]:
        """The group's samples, corrected for their mounting, and what follows from what they have ``stated``."""
        mounting = self._mountings.get(_name_of_source(group[0]), _UNCORRECTED)
        corrected = group if mounting is _UNCORRECTED else self._correct_mounting_angles(group, mounting)
        quantities = {sample.quantity: sample for sample in corrected}
        if not stated.isdisjoint(_COMPASS):
            if "magnetic_variation_deg" in quantities:
                self._variation_deg = quantities["magnetic_variation_deg"].value
            heading, magnetic = quantities.get("heading_deg"), quantities.get("heading_magnetic_deg")
            if heading is None and magnetic is not None and self._variation_deg is not None:
                heading = _derived_sample(magnetic, "heading_deg", (magnetic.value + self._variation_deg) % 360.0)
            if heading is not None:
                quantities["heading_deg"] = heading
                self._remember_heading(heading)
        if not stated.isdisjoint(_VELOCITY):
            quantities.update(self._reference_point_velocity(quantities, mounting))
        derived = list(quantities.values())
        if "latitude_deg" in stated:
            derived += self._position_samples(quantities, mounting)
        if not stated.isdisjoint(_WIND):
            derived += self._wind_samples(quantities)
        return derived

    def _remember_heading(self, heading: trials.Sample) -> None:
        """Take note of a line's heading: the ship's where it comes from there, else that of the first compass.

        Another compass of the line serves when that has been silent: what is derived must go by one of them.
        """
        source_name, channel = _name_of_source(heading), self._ship.get("heading_deg")
        is_channels = channel is not None and _name_of_source(channel) == source_name
        serving = channel if is_channels else self._headings.get(source_name)
        is_other = serving is not None and serving.source != heading.source
        if serving is None or not is_other or heading.monotonic_ns - serving.monotonic_ns > SILENT_NS:
            self._headings[source_name] = heading

    def _correct_mounting_angles(self, group: trials.Group, mounting: Mounting) -> Iterator[trials.Sample]:
        """The samples, headings and bow-relative wind angles corrected for how their sensors are mounted."""
        for sample in group:
            turn_deg = 0.0
            if sample.quantity in _HEADINGS:
                turn_deg = mounting.heading_deg
            elif sample.quantity.startswith("wind_angle_"):
                turn_deg = mounting.wind_angle_deg
            turned_deg = (sample.value + turn_deg) % 360.0
            yield sample if turn_deg == 0.0 else _derived_sample(sample, sample.quantity, turned_deg)

    def _heading_deg(self, sample: trials.Sample) -> float | None:
        """The true heading when ``sample`` came: the line's own or else the ship's, carried on by the yaw rate."""
        for heading in (self._headings.get(_name_of_source(sample)), self._ship.get("heading_deg")):
            if heading is None:
                continue
            age_ns = sample.monotonic_ns - heading.monotonic_ns
            if age_ns <= _HEADING_KEEPS_NS:
                yaw_rate_dps = self._fresh_channel_value("yaw_rate_dps", sample) or 0.0
                return heading.value + yaw_rate_dps * age_ns / 1e9
        return None

    def _fresh_channel_value(self, quantity: str, sample: trials.Sample) -> float | None:
        """The ship's last value of a channel, if it is fresh when ``sample`` came."""
        latest = self._ship.get(quantity)
        fresh = latest is not None and sample.monotonic_ns - latest.monotonic_ns <= _MOTION_KEEPS_NS
        return latest.value if latest is not None and fresh else None

    def _reference_point_velocity(self, group: Quantities, mounting: Mounting) -> Quantities:
        """Surge and sway over ground at the reference point, from what the group says of velocity."""
        body_velocity: Quantities = {name: group[name] for name in ("surge_mps", "sway_mps") if name in group}
        velocity = body_velocity or self._velocity_over_ground(group)
        if not velocity or not (mounting.forward_m or mounting.starboard_m):
            return velocity
        yaw_rate_dps = self._fresh_channel_value("yaw_rate_dps", next(iter(velocity.values())))
        shift = quantities.velocity_at_reference(
            0.0, 0.0, yaw_rate_dps or 0.0, mounting.forward_m, mounting.starboard_m
        )
        moved = {
            name: _derived_sample(velocity[name], name, velocity[name].value + metres_per_second)
            for name, metres_per_second in zip(("surge_mps", "sway_mps"), shift, strict=True)
            if name in velocity
        }
        if yaw_rate_dps is None:  # whether the ship turns is not known, so neither is how its ends move
            return {name: sample._replace(quality=trials.Quality.SUSPECT) for name, sample in moved.items()}
        return moved

    def _velocity_over_ground(self, group: Quantities) -> Quantities:
        """Surge and sway where they were measured, from the heading and the velocity over ground."""
        north, east = group.get("velocity_north_mps"), group.get("velocity_east_mps")
        speed, course = group.get("speed_over_ground_mps"), group.get("course_over_ground_deg")
        magnetic = group.get("course_magnetic_deg")
        if north is not None and east is not None:
            sample, velocity = north, (north.value, east.value)
        elif speed is not None and course is not None:
            sample, velocity = speed, quantities.components_of_velocity(course.value, speed.value)
        elif speed is not None and magnetic is not None and self._variation_deg is not None:
            sample, velocity = (
                speed,
                quantities.components_of_velocity(magnetic.value + self._variation_deg, speed.value),
            )
        else:
            return {}
        heading_deg = self._heading_deg(sample)
        if heading_deg is None:
            return {}
        surge, sway = map(float, quantities.rotate_earth_to_ship(*velocity, radians(heading_deg)))
        return {
            "surge_mps": _derived_sample(sample, "surge_mps", surge),
            "sway_mps": _derived_sample(sample, "sway_mps", sway),
        }

    def _position_samples(self, group: Quantities, mounting: Mounting) -> Iterator[trials.Sample]:
        """North and east of the origin [m], of the reference point."""
        latitude, longitude = group.get("latitude_deg"), group.get("longitude_deg")
        if latitude is None or longitude is None:
            return
        if self._plane is None:
            # no origin are fixes by a simulator or dead reckoning, and 0, 0, which receivers send before a fix
            is_valid = latitude.quality in (trials.Quality.GOOD, trials.Quality.NOT_EVALUATED)
            is_valid = is_valid and (latitude.value, longitude.value) != (0.0, 0.0)
            if _name_of_source(latitude) not in self._positions_from or not is_valid:
                return
            self._plane = quantities.TangentPlane(latitude.value, longitude.value)
        north, east = self._plane.north_east_m(latitude.value, longitude.value)
        if mounting.forward_m or mounting.starboard_m:
            heading_deg = self._heading_deg(latitude)
            if heading_deg is None:  # an antenna's place says nothing of the ship's without its heading
                return
            antenna = quantities.to_earth(mounting.forward_m, mounting.starboard_m, radians(heading_deg))
            north, east = north - float(antenna[0]), east - float(antenna[1])
        yield _derived_sample(latitude, "north_m", north)
        yield _derived_sample(latitude, "east_m", east)

    def _wind_samples(self, group: Quantities) -> Iterator[trials.Sample]:
        """Wind over ground from true north, from whatever reference the instrument has."""
        magnetic = group.get("wind_direction_magnetic_deg")
        if magnetic is not None and self._variation_deg is not None:
            yield _derived_sample(magnetic, "wind_direction_deg", (magnetic.value + self._variation_deg) % 360.0)
        for kind, angle_name, speed_name in _BOW_WIND_NAMES:
            angle, speed = group.get(angle_name), group.get(speed_name)
            if angle is None or speed is None:
                continue
            if kind == "apparent":
                yield angle._replace(quantity="apparent_wind_angle_deg")
                yield speed._replace(quantity="apparent_wind_speed_mps")
            wind = self._wind_over_ground(kind, angle, speed.value)
            if wind is not None:
                yield _derived_sample(angle, "wind_direction_deg", wind[0])
                yield _derived_sample(angle, "wind_speed_mps", wind[1])

    def _wind_over_ground(self, kind: str, angle: trials.Sample, speed_mps: float) -> tuple[float, float] | None:
        heading_deg = self._heading_deg(angle)
        if heading_deg is None:
            return None
        if kind == "theoretical":
            return quantities.wind_over_ground(angle.value, speed_mps, 0.0, 0.0, heading_deg)
        surge, sway = self._fresh_channel_value("surge_mps", angle), self._fresh_channel_value("sway_mps", angle)
        felt_deg, felt_mps = angle.value, speed_mps
        if kind == "water":
            through_water_mps = self._fresh_channel_value("speed_through_water_mps", angle)
            if through_water_mps is None:
                return None
            felt_deg, felt_mps = quantities.apparent_wind_of_water_wind(angle.value, speed_mps, through_water_mps)
        if surge is None or sway is None:
            return None
        return quantities.wind_over_ground(felt_deg, felt_mps, surge, sway, heading_deg)


def _drop_impossible_samples(samples: trials.Group, limits: Mapping[str, Channel]) -> tuple[trials.Group, int]:
    """The samples that can be true, angles within their turn, and how many cannot.

    Where one of a pair is impossible the other is not accepted either: what comes of both, and the direction of
    a wind of 999 m/s, would be false.
    """
    possible = []
    for sample in samples:
        channel = limits.get(sample.quantity)
        if channel is None or channel.is_possible_value(sample.value):
            possible.append(sample)
        elif channel.circular and abs(sample.value) <= _FULL_TURN_DEG:
            possible.append(sample._replace(value=channel.wrap_angle(sample.value)))
    if len(possible) < len(samples):
        possible_quantities = {sample.quantity for sample in possible}
        lost = {sample.quantity for sample in samples} - possible_quantities
        possible = [sample for sample in possible if lost.isdisjoint(_PARTNERS.get(sample.quantity, ()))]
    return possible, len(samples) - len(possible)


def _derived_sample(sample: trials.Sample, quantity: str, value: float) -> trials.Sample:
    source = sample.source if sample.source.endswith(" derived") else f"{sample.source} derived"
    return trials.Sample(quantity, value, source, *sample[3:])  # as _replace() would, in half the time


def _name_of_source(sample: trials.Sample) -> str:
    return sample.source.partition("/")[0]
