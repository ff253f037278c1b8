"""What happens to a frame between its reception and the recording: kept raw, decoded, derived, selected."""

from __future__ import annotations

import logging
from collections import ChainMap, Counter
from dataclasses import dataclass, field, replace
from itertools import chain
from math import inf

from seatrial.acquisition.config.configuration import TrialConfig
from seatrial.acquisition.config.sections import CanFrames
from seatrial.acquisition.core.channels import BY_NAME
from seatrial.acquisition.core.frames import Fix, Frame, FrameFlag, Group, Sample, sensor_of
from seatrial.acquisition.decoders import Decoder, decoders_by_protocol
from seatrial.acquisition.logger.derive import Derivation
from seatrial.acquisition.logger.handovers import Handovers
from seatrial.acquisition.logger.health import Health
from seatrial.acquisition.logger.selection import POSITION, VARIATION, VARIATION_KEEPS_NS, Selector
from seatrial.acquisition.logger.supervision import LOG
from seatrial.acquisition.recording.messages import MessageSink

_VARIATION_ERROR_DEG = 1.0  # twice what the World Magnetic Model's declination errs by, as its makers say (0.4 deg)
_EVENTS_A_MINUTE = 30
_MOST_CONTRADICTIONS = 100  # sources are named by what comes off the wire
DECODED = "decoding"
"""The name of events that decoding brings forth, and would bring forth again."""
_LOG_LEVELS = {"info": logging.INFO, "warning": logging.WARNING, "error": logging.ERROR}


@dataclass(slots=True)
class _Allowance:
    """How many events a source may still bring forth in this minute."""

    until_ns: int = 0
    remaining: int = _EVENTS_A_MINUTE
    left_out: int = 0

    def allows(self, now_ns: int) -> bool:
        """Take one event from what is left of this minute; count it if nothing is."""
        if now_ns >= self.until_ns:
            self.until_ns, self.remaining = now_ns + 60_000_000_000, _EVENTS_A_MINUTE
        self.remaining -= 1
        self.left_out += self.remaining < 0
        return self.remaining >= 0


@dataclass(slots=True)
class _Addresses:
    """The source addresses on a bus that are believed."""

    believed: tuple[int, ...]
    refused: Counter[str] = field(default_factory=Counter)

    def admit(self, frame: Frame) -> bool:
        """Whether a frame is of one of them, or tells no address."""
        has_address = frame.protocol == "can" and not frame.flags & FrameFlag.STANDARD_ID
        if has_address and frame.identifier & 0xFF not in self.believed:
            self.refused["address that is not allowed"] += 1
            return False
        return True


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
            health.sources[name].not_known = [decoder.unknown for decoder in chain(*decoders.values())]
        self._addresses = {source.name: _Addresses(source.addresses) for source in config.sources
                           if isinstance(source, CanFrames) and source.addresses}  # fmt: skip
        self._failed: dict[str, Counter[str]] = {source.name: Counter() for source in config.sources}
        for name, failed in self._failed.items():
            health.sources[name].refusals.append(failed)
        for name, addresses in self._addresses.items():
            health.sources[name].refusals.append(addresses.refused)
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
        self._variation: Sample | None = None
        self._contradict: set[str] = set()
        self._allowances = {source.name: _Allowance() for source in config.sources}
        self._handovers = Handovers()

    def mute_clocks(self, origin: str) -> None:
        """Tell nothing of this source's clocks: its frames have no times that they could be compared with."""
        for decoder in chain(*self._decoders[origin].values()):
            if (clock := getattr(decoder, "clock", None)) is not None:
                clock.muted = True

    def process(self, frame: Frame) -> None:
        """Record the frame raw and every channel sample that is in it."""
        self._writer.write_raw(frame)
        try:
            self._interpret(frame)
        except Exception as error:  # the frame is kept raw, and must not end the recording
            if not self._failed[frame.origin]["processing failed"]:
                text = f"{frame.origin}: a frame could not be interpreted: {type(error).__name__} {error}"
                self.note(text, frame.received_ns, "error", DECODED)
            self._failed[frame.origin]["processing failed"] += 1

    def report_handovers(self, now_ns: float = inf) -> None:
        """Report which channels have other sources, of causes that are over by now [monotonic, ns] or of all."""
        for frame, text in self._handovers.due(now_ns):
            self._tell(frame, text, "warning")

    def _interpret(self, frame: Frame) -> None:
        if self._handovers.causes:
            self.report_handovers(frame.monotonic_ns)
        self._end_storm(frame)
        if frame.origin in self._addresses and not self._addresses[frame.origin].admit(frame):
            return
        health = self._health.sources[frame.origin]
        for decoder in self._decoders[frame.origin].get(frame.protocol, ()):
            for group in self._decoded(decoder, frame):
                samples, impossible = self._derivation.channels(self._with_chosen_variation(group, frame))
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

    def _with_chosen_variation(self, group: Group, frame: Frame) -> Group:
        """The group, without a magnetic variation of another source than the one that all headings go by."""
        sample = next((member for member in group if member.quantity == VARIATION), None)
        if sample is None or not BY_NAME[VARIATION].holds(sample.value):
            return group
        chosen, change = self._variations.admit(sample)
        if change is not None:
            self._handovers.add(change, frame)
        if chosen:
            self._variation = sample
            return group
        self._tell_contradiction(sample, frame)
        return [member for member in group if member is not sample]

    def _tell_contradiction(self, sample: Sample, frame: Frame) -> None:
        """Say once of each other source of a magnetic variation that it tells another."""
        if self._variation is None:
            return
        off_deg = sample.value - self._variation.value
        is_news = sample.source not in self._contradict and len(self._contradict) < _MOST_CONTRADICTIONS
        if is_news and abs(off_deg) > _VARIATION_ERROR_DEG:
            self._contradict.add(sample.source)
            text = (
                f"{sample.source} tells a magnetic variation of {sample.value:.2f} deg, {off_deg:+.2f} deg from"
                f" that of {self._variation.source}, which is taken; who is listed first is believed"
            )
            self._tell(frame, text, "warning")

    def _record(self, samples: list[Sample], frame: Frame) -> None:
        has_position = False
        for sample in samples:
            accepted, change = self._selector.admit(sample)
            if change is not None:
                self._handovers.add(change, frame)
            if accepted:
                self._writer.write_sample(sample)
                self._health.count_in(sample)
                self._derivation.remember(sample)
                has_position = has_position or sample.quantity in POSITION
        if has_position:
            self._record_position({entry.quantity: entry for entry in samples})
        if self._trial.origin is None and self._derivation.origin is not None:
            self._keep_origin(*self._derivation.origin, frame.received_ns)

    def _record_position(self, samples: dict[str, Sample]) -> None:
        """The fix for the map, from the source that the position channels come from."""
        latitude, longitude = samples.get("latitude_deg"), samples.get("longitude_deg")
        if latitude is not None and longitude is not None:
            fix = self._fixes.get(sensor_of(latitude.source), Fix())
            times = latitude.received_ns, latitude.measured_ns
            self._writer.write_position(latitude.value, longitude.value, *times, fix)

    def _keep_origin(self, latitude_deg: float, longitude_deg: float, received_ns: int) -> None:
        """The first fix became the origin: the recording must say so."""
        self._trial = replace(self._trial, origin_latitude_deg=latitude_deg, origin_longitude_deg=longitude_deg)
        self._writer.write_trial(self._trial)
        text = f"the first fix is the origin: {latitude_deg:.7f}, {longitude_deg:.7f}"
        self.note(text, received_ns, "info", DECODED)

    def _tell(self, frame: Frame, text: str, level: str) -> None:
        """Note what decoding told, within what a source may tell: rubbish can look like news without end."""
        if self._allowances[frame.origin].allows(frame.monotonic_ns):
            self.note(text, frame.received_ns, level, DECODED)

    def _end_storm(self, frame: Frame) -> None:
        """Once the source may tell something again: how much it could not."""
        allowance = self._allowances[frame.origin]
        if allowance.left_out and frame.monotonic_ns >= allowance.until_ns:
            text = f"{frame.origin}: {allowance.left_out:,} more events were left out"
            self.note(text, frame.received_ns, "warning", DECODED)
            allowance.left_out = 0

    def note(self, text: str, received_ns: int, level: str = "info", name: str = "seatrial") -> None:
        """Put a line into the recording's event log and the display."""
        self._writer.write_event(text, received_ns, level, name)
        self._health.events.append((received_ns, level, text), name)
        LOG.log(_LOG_LEVELS[level], text, extra={"more": {"recording_time": received_ns / 1e9, "name": name}})
