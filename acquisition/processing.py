"""What happens to a frame between its reception and the recording: kept raw, decoded, derived, selected."""

from __future__ import annotations

import logging
from dataclasses import replace

from acquisition.config import TrialConfig
from acquisition.decoders import Decoder, make_decoders
from acquisition.derive import Derivation
from acquisition.frames import Frame, Group, Sample
from acquisition.health import Health
from acquisition.recording.messages import MessageSink
from acquisition.select import Selector

DECODED = "decoding"
"""The name of events that decoding brings forth, and would bring forth again."""
LOG = logging.getLogger("seatrial")
_LOG_LEVELS = {"info": logging.INFO, "warning": logging.WARNING, "error": logging.ERROR}
_POSITION = frozenset({"north_m", "east_m", "latitude_deg", "longitude_deg"})


class Processing:
    """Frames into a recording; for one thread only."""

    def __init__(self, config: TrialConfig, writer: MessageSink, health: Health) -> None:
        self._trial = config.trial
        self._writer = writer
        self._health = health
        self._decoders: dict[str, list[Decoder]] = {each.name: make_decoders(each) for each in config.sources}
        self._derivation = Derivation(
            config.trial,
            frozenset(each.name for each in config.sources if _POSITION & set(each.channels)),
            {each.name: each.mounting for each in config.sources},
            config.magnetic_variation_deg,
        )
        self._selector = Selector(config.sources)

    def process(self, frame: Frame) -> None:
        """Record the frame raw and every channel sample that is in it."""
        self._writer.write_raw(frame)
        decoders, health = self._decoders[frame.origin], self._health.sources[frame.origin]
        for decoder in decoders:
            for group in self._decoded(decoder, frame):
                samples, impossible = self._derivation.channels(group)
                health.impossible += impossible
                self._record(samples, frame.received_ns)
            while decoder.notices:
                level, text = decoder.notices.popleft()
                self.note(f"{frame.origin}: {text}", frame.received_ns, level, DECODED)
        health.refused = sum(each.refused.total() for each in decoders)

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

    def _record(self, samples: list[Sample], received_ns: int) -> None:
        admitted = []
        for sample in samples:
            accepted, change = self._selector.admit(sample)
            if change:
                self.note(change, received_ns, "warning", DECODED)
            if accepted:
                self._writer.write_sample(sample)
                self._health.saw(sample)
                self._derivation.admitted(sample)
                admitted.append(sample.quantity)
        if not _POSITION.isdisjoint(admitted):
            self._record_position({each.quantity: each for each in samples})
        if self._derivation.origin != self._trial.origin:
            self._keep_origin(received_ns)

    def _record_position(self, samples: dict[str, Sample]) -> None:
        """The fix for the map, from the source that the position channels come from."""
        latitude, longitude = samples.get("latitude_deg"), samples.get("longitude_deg")
        if latitude is not None and longitude is not None:
            self._writer.write_position(latitude.value, longitude.value, latitude.received_ns, latitude.measured_ns)

    def _keep_origin(self, received_ns: int) -> None:
        """The first fix became the origin: the recording must say so."""
        if self._derivation.origin is None:
            return
        latitude_deg, longitude_deg = self._derivation.origin
        self._trial = replace(self._trial, origin_latitude_deg=latitude_deg, origin_longitude_deg=longitude_deg)
        self._writer.write_trial(self._trial)
        text = f"the first fix is the origin: {latitude_deg:.7f}, {longitude_deg:.7f}"
        self.note(text, received_ns, "info", DECODED)

    def note(self, text: str, received_ns: int, level: str = "info", name: str = "seatrial") -> None:
        """Put a line into the recording's event log and the display."""
        self._writer.write_event(text, received_ns, level, name)
        self._health.events.append((received_ns, level, text))
        LOG.log(_LOG_LEVELS[level], text, extra={"more": {"recording_time": received_ns / 1e9, "name": name}})
