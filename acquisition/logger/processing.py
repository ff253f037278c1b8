"""What happens to a frame between its reception and the recording: kept raw, decoded, derived, selected."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from itertools import chain

from acquisition.config.configuration import TrialConfig
from acquisition.config.sections import AnySource, CanFrames
from acquisition.core.frames import Frame, Group, Sample
from acquisition.decoders import Decoder, decoders_by_protocol
from acquisition.logger.derive import Derivation
from acquisition.logger.health import SILENT_NS, Health
from acquisition.logger.supervision import LOG
from acquisition.recording.messages import MessageSink

_MOST_RANKS = 10_000

# What a device says in two messages, and which of them is the slower or coarser one: 129025 comes ten times as
# often as 129029, LOCAL_POSITION_NED has the finer speeds, GGA tells whether there is a fix at all.
_CHOICE = {
    **dict.fromkeys(("129029", "130577", "GLOBAL_POSITION_INT", "RMC", "GLL", "HDM", "VWR", "VWT", "HTD"), 1),
    **dict.fromkeys(("GPS_RAW_INT", "GPS_GLOBAL_ORIGIN"), 2),
}
_MEANING = {"": 0, "engine": 1, "magnetic": 2, "theoretical": 2, "water": 4, "apparent": 4}
"""How far from the channel itself a message's reference is: what needs less derivation is preferred."""

Rank = tuple[int, int, int]
_EVENTS_A_MINUTE = 30
DECODED = "decoding"
"""The name of events that decoding brings forth, and would bring forth again."""
_LOG_LEVELS = {"info": logging.INFO, "warning": logging.WARNING, "error": logging.ERROR}
_POSITION = frozenset({"north_m", "east_m", "latitude_deg", "longitude_deg"})


@dataclass(slots=True)
class _Holder:
    source: str
    rank: Rank
    last_ns: int


class Selector:
    """Lets one source a channel through, so that a channel never mixes two sensors sample by sample.

    The order of the configuration's sources is the order of preference, and within a bus the order of its
    devices. Of two messages the finer one has it, and what needs less derivation. What is equal in all this, two
    devices that are not listed, say, is decided by who came first, until that has been silent for 2.5 s.
    """

    def __init__(self, sources: tuple[AnySource, ...]) -> None:
        self._lines = {
            (source.name, channel): rank for rank, source in enumerate(sources) for channel in source.channels
        }
        self._devices = {
            (source.name, device.name): rank
            for source in sources
            if isinstance(source, CanFrames)
            for rank, device in enumerate(source.devices)
        }
        self._ranks: dict[tuple[str, str], Rank | None] = {}
        self._holders: dict[str, _Holder] = {}

    def admit(self, sample: Sample) -> tuple[bool, str]:
        """Whether the sample is the channel's, and a text for the event log if the channel changed hands.

        Call once a sample, in order of reception.
        """
        rank = self._rank(sample.source, sample.quantity)
        if rank is None:
            return False, ""
        holder = self._holders.get(sample.quantity)
        if holder is None:
            self._holders[sample.quantity] = _Holder(sample.source, rank, sample.monotonic_ns)
            return True, ""
        if holder.source == sample.source:
            holder.last_ns = sample.monotonic_ns
            return True, ""
        if rank < holder.rank or sample.monotonic_ns - holder.last_ns > SILENT_NS:
            text = f"{sample.quantity}: from {holder.source} to {sample.source}"
            self._holders[sample.quantity] = _Holder(sample.source, rank, sample.monotonic_ns)
            return True, text
        return False, ""

    def _rank(self, source: str, quantity: str) -> Rank | None:
        key = source, quantity
        if key not in self._ranks:
            if (
                len(self._ranks) >= _MOST_RANKS
            ):  # sources are named by what comes off the wire: there is no end to them
                self._ranks.clear()
            self._ranks[key] = self._work_out_rank(source, quantity)
        return self._ranks[key]

    def _work_out_rank(self, source: str, quantity: str) -> Rank | None:
        """Preference of the line, of the device on it, of the message; None where the line is not to provide it."""
        line, _, rest = source.partition("/")
        line_rank = self._lines.get((line, quantity))
        if line_rank is None:
            return None
        device, _, words = rest.partition(":")
        message, *meaning = words.split(" ")
        derived = meaning[-1:] == ["derived"] and quantity not in ("north_m", "east_m")
        kind = next((_MEANING[word] for word in meaning if word in _MEANING), 0)
        device_rank = self._devices.get((line, device), len(self._devices))
        return line_rank, device_rank, 10 * _CHOICE.get(message, 0) + kind + derived


@dataclass(slots=True)
class _Allowance:
    """How many events a source may still bring forth in this minute."""

    until_ns: int = 0
    left: int = _EVENTS_A_MINUTE
    left_out: int = 0

    def allows(self, now_ns: int) -> bool:
        """Take one event from what is left of this minute; count it if nothing is."""
        if now_ns >= self.until_ns:
            self.until_ns, self.left = now_ns + 60_000_000_000, _EVENTS_A_MINUTE
        self.left -= 1
        self.left_out += self.left < 0
        return self.left >= 0


class FrameProcessor:
    """Frames into a recording; for one thread only."""

    def __init__(self, config: TrialConfig, writer: MessageSink, health: Health) -> None:
        self._trial = config.trial
        self._writer = writer
        self._health = health
        self._decoders = {each.name: decoders_by_protocol(each, config.actuators) for each in config.sources}
        for name, decoders in self._decoders.items():
            health.sources[name].refusals = [each.refused for each in chain(*decoders.values())]
        self._derivation = Derivation(
            config.trial,
            frozenset(each.name for each in config.sources if _POSITION & set(each.channels)),
            {each.name: each.mounting for each in config.sources},
            config.magnetic_variation_deg,
        )
        self._selector = Selector(config.sources)
        self._seeks_origin = config.trial.origin is None
        self._in_storm: set[str] = set()
        self._allowances = {each.name: _Allowance() for each in config.sources}

    def mute_clocks(self, origin: str) -> None:
        """Tell nothing of this source's clocks: its frames have no times that they could be compared with."""
        for decoder in chain(*self._decoders[origin].values()):
            if (clock := getattr(decoder, "clock", None)) is not None:
                clock.muted = True

    def process(self, frame: Frame) -> None:
        """Record the frame raw and every channel sample that is in it."""
        self._writer.write_raw(frame)
        if self._in_storm:
            self._end_storm(frame)
        health = self._health.sources[frame.origin]
        for decoder in self._decoders[frame.origin].get(frame.protocol, ()):
            for group in self._decoded(decoder, frame):
                samples, impossible = self._derivation.channels(group)
                health.impossible += impossible
                self._record(samples, frame)
            while decoder.notices:
                level, text = decoder.notices.popleft()
                self._tell(frame, f"{frame.origin}: {text}", level)

    def _decoded(self, decoder: Decoder, frame: Frame) -> list[Group]:
        """The frame's groups. What a decoder trips over is kept raw and must not end the recording."""
        try:
            return decoder.decode(frame)
        except Exception as error:
            if not decoder.refused["decoder failed"]:
                text = f"{frame.origin}: a frame broke the decoder: {type(error).__name__} {error}"
                self.note(text, frame.received_ns, "error", DECODED)
            decoder.refused["decoder failed"] += 1
            return []

    def _record(self, samples: list[Sample], frame: Frame) -> None:
        has_position = False
        for sample in samples:
            accepted, change = self._selector.admit(sample)
            if change:
                self._tell(frame, change, "warning")
            if accepted:
                self._writer.write_sample(sample)
                self._health.count_in(sample)
                self._derivation.remember(sample)
                has_position = has_position or sample.quantity in _POSITION
        if has_position:
            self._record_position({each.quantity: each for each in samples})
        if self._seeks_origin and self._derivation.origin is not None:
            self._keep_origin(*self._derivation.origin, frame.received_ns)

    def _record_position(self, samples: dict[str, Sample]) -> None:
        """The fix for the map, from the source that the position channels come from."""
        latitude, longitude = samples.get("latitude_deg"), samples.get("longitude_deg")
        if latitude is not None and longitude is not None:
            self._writer.write_position(latitude.value, longitude.value, latitude.received_ns, latitude.measured_ns)

    def _keep_origin(self, latitude_deg: float, longitude_deg: float, received_ns: int) -> None:
        """The first fix became the origin: the recording must say so."""
        self._seeks_origin = False
        self._trial = replace(self._trial, origin_latitude_deg=latitude_deg, origin_longitude_deg=longitude_deg)
        self._writer.write_trial(self._trial)
        text = f"the first fix is the origin: {latitude_deg:.7f}, {longitude_deg:.7f}"
        self.note(text, received_ns, "info", DECODED)

    def _tell(self, frame: Frame, text: str, level: str) -> None:
        """Note what decoding told, within what a source may tell: rubbish can look like news without end."""
        if self._allowances[frame.origin].allows(frame.monotonic_ns):
            self.note(text, frame.received_ns, level, DECODED)
        else:
            self._in_storm.add(frame.origin)

    def _end_storm(self, frame: Frame) -> None:
        """Once the source may tell something again: how much it could not."""
        allowance = self._allowances[frame.origin]
        if frame.origin in self._in_storm and frame.monotonic_ns >= allowance.until_ns:
            self._in_storm.remove(frame.origin)
            text = f"{frame.origin}: {allowance.left_out:,} more events were left out"
            self.note(text, frame.received_ns, "warning", DECODED)
            allowance.left_out = 0

    def note(self, text: str, received_ns: int, level: str = "info", name: str = "seatrial") -> None:
        """Put a line into the recording's event log and the display."""
        self._writer.write_event(text, received_ns, level, name)
        self._health.events.append((received_ns, level, text))
        LOG.log(_LOG_LEVELS[level], text, extra={"more": {"recording_time": received_ns / 1e9, "name": name}})
