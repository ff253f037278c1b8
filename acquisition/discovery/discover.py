"""``seatrial discover``: who speaks where, what it says, and a configuration that records it."""

from __future__ import annotations

import heapq
import threading
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from operator import attrgetter
from pathlib import Path
from typing import Any

from seatrial.acquisition.config.sections import CanFrames, MqttLinks
from seatrial.acquisition.config.vessel_file import find_vessel, vessel_of_ship
from seatrial.acquisition.core.channels import MOTION
from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.acquisition.core.frames import Frame
from seatrial.acquisition.core.progress import Progress, part_of
from seatrial.acquisition.decoders.dbc import load_dbc
from seatrial.acquisition.discovery.dbc_files import DbcMessages
from seatrial.acquisition.discovery.listen import Heard, listen
from seatrial.acquisition.discovery.places import ListeningPlace
from seatrial.acquisition.discovery.propose import Gaps, configuration_text, everything
from seatrial.acquisition.discovery.readings import LatestReading, signal_readings, topic_readings
from seatrial.acquisition.logger.missing import missing_channels, sources_of, what_comes
from seatrial.acquisition.logger.survey import Survey, TrafficKind, name_of_group, survey_of

_TELL_EVERY = 5_000  # frames


@dataclass(frozen=True)
class Discovery:
    """What was found: where was listened, what came there, and a configuration that records it.

    ``configuration`` is empty, and ``survey`` None, where nothing was found; ``missing`` says why, by channel.
    ``readings`` are the values of signals and topics that a configuration has to map.
    """

    heard: list[Heard]
    survey: Survey | None = None
    missing: dict[str, str] = field(default_factory=dict)
    configuration: str = ""
    readings: list[LatestReading] = field(default_factory=list)

    @property
    def channels(self) -> dict[str, list[str]]:
        """The channels that the configuration records, with the sources of each."""
        return {} if self.survey is None else self.survey.channels

    def as_json(self) -> dict[str, Any]:
        """What was found as an object of JSON's kinds."""
        return {
            "places": [_place_json(capture) for capture in self.heard],
            "devices": [] if self.survey is None else _devices_json(self.survey),
            "messages": [] if self.survey is None else _messages_json(self.survey),
            "values": [reading.as_json() for reading in self.readings],
            "channels": {} if self.survey is None else _channels_json(self.survey),
            "missing": self.missing,
            "events": [] if self.survey is None else self.survey.events,
            "configuration": self.configuration,
        }


def discover(
    places: Sequence[ListeningPlace],
    duration_s: float = 20.0,
    name: str = "discovered",
    vessel: str = "",
    dbc: Path | None = None,
    folder: Path | None = None,
    stop: threading.Event | None = None,
    progress: Progress = lambda share: None,
) -> Discovery:
    """Listen at all places for ``duration_s`` [s], and propose a configuration named ``name``.

    ``vessel`` is the ship's name or file, whose actuators the channels are; without it no control of a ship is
    missing. ``dbc`` describes the ship's own CAN frames, else one beside the configuration that fits them;
    ``folder`` is where the configuration will lie. Raises :class:`ConfigurationError` for a vessel or a DBC file
    at fault. What cannot be listened to is told in the result, and is no error.
    """
    if dbc is not None:
        load_dbc(dbc)
    folder = folder or Path()
    if vessel and vessel_of_ship(vessel, folder) is None:  # a configuration there would not find it
        fix = f"copy it to {folder.absolute()}"
        raise ConfigurationError("lies elsewhere", where=str(find_vessel(vessel)), fix=fix)
    captures = listen(places, duration_s, stop, part_of(progress, 0, 2))
    return discovery_of(captures, name, vessel, dbc, folder, stop, part_of(progress, 1, 2))


def discovery_of(
    heard: list[Heard],
    name: str = "discovered",
    vessel: str = "",
    dbc: Path | None = None,
    folder: Path | None = None,
    stop: threading.Event | None = None,
    progress: Progress = lambda share: None,
) -> Discovery:
    """What has been heard, understood; as :func:`discover`."""
    captures = [capture for capture in heard if capture.count and not capture.problem]
    if not captures:
        return Discovery(heard)
    config = everything(captures, vessel, dbc, (folder or Path()) / f"{name}.toml")
    until = stop if any(capture.expected for capture in captures) else None  # what has been heard live is looked at
    expected = sum(capture.expected or capture.count for capture in captures)
    in_order = heapq.merge(*(capture.frames() for capture in captures), key=attrgetter("received_ns"))
    survey = survey_of(config, _counted(in_order, expected, until, progress))
    for received in captures:
        received.count = survey.health.sources[received.place.name].frames
    reasons, readings = missing_channels(survey), list(_readings(captures, survey))
    missing = reasons
    if not survey.config.ship_is_known:  # then no control can be missing, but what comes may be of one
        missing = {name: reason for name, reason in reasons.items() if name in MOTION}
        _remark_on_controls(captures, reasons.keys() - missing.keys(), survey)
    text = configuration_text(captures, survey, Gaps(reasons, missing), readings, name, vessel)
    return Discovery(heard, survey, missing, text, readings)


def _readings(captures: Iterable[Heard], survey: Survey) -> Iterator[LatestReading]:
    """The values of the signals of each source's DBC file, and of the topics of each broker."""
    sources = {section.name: section for section in survey.config.sources}
    for capture in captures:
        source = sources[capture.place.name]
        provided = survey.provided(source.name)
        if isinstance(source, MqttLinks):
            yield from topic_readings(source.name, capture.frames())
        elif isinstance(source, CanFrames) and source.dbc is not None:
            signals = {name: signal for name, signal in source.signals.items() if name in provided}
            mapped = {(signal.message, signal.signal): name for name, signal in signals.items()}
            yield from signal_readings(source.name, capture.frames(), DbcMessages(load_dbc(source.dbc)), mapped)


def _remark_on_controls(captures: Iterable[Heard], controls: Iterable[str], survey: Survey) -> None:
    """Say of each source what it carries of actuators that is no channel yet, and why."""
    reasons = {name: reason for name in sorted(controls) if (reason := what_comes(name, survey))}
    for capture in captures:
        remarks = [reason for name, reason in reasons.items() if capture.place.name in sources_of(name, survey)]
        capture.remarks += dict.fromkeys(remarks)


def _counted(
    frames: Iterator[Frame], expected: int, stop: threading.Event | None, progress: Progress
) -> Iterator[Frame]:
    """The frames, with the progress that they make, until their end or until told to stop."""
    for number, frame in enumerate(frames):
        if number % _TELL_EVERY == 0:
            progress(min(number / max(expected, 1), 1.0))
            if number and stop is not None and stop.is_set():
                return
        yield frame


def _place_json(capture: Heard) -> dict[str, Any]:
    place = capture.place
    return {
        "place": place.text or place.name,
        "source": place.name,
        "type": place.type,
        **place.settings,
        "frames": capture.count,
        **({"problem": capture.problem} if capture.problem else {}),
        **({"remarks": capture.remarks} if capture.remarks else {}),
    }


def _devices_json(survey: Survey) -> list[dict[str, Any]]:
    order = sorted(survey.devices, key=lambda device: (device[0], int(device[1])))
    return [{"source": device[0], "address": int(device[1]), **survey.devices[device]} for device in order]


def _messages_json(survey: Survey) -> list[dict[str, Any]]:
    return [
        {
            "source": kind.source,
            "device": kind.device,
            "message": kind.name,
            "name": name_of_group(int(kind.name)) if kind.name.isdigit() else "",
            "count": tally.count,
            "rate_hz": tally.rate_hz,
            "values": tally.values,
            "refused": dict(tally.refused),
        }
        for kind, tally in sorted(survey.kinds.items(), key=lambda entry: _order(entry[0]))
    ]


def _order(kind: TrafficKind) -> tuple[Any, ...]:
    number = (0, int(kind.device)) if kind.device.isdigit() else (1, 0)
    return kind.source, number, kind.device, kind.name


def _channels_json(survey: Survey) -> dict[str, Any]:
    span_s = max((survey.last_ns - survey.first_ns) / 1e9, 1e-9)
    return {
        name: {
            "count": survey.health.channels[name].count,
            "rate_hz": survey.health.channels[name].count / span_s,
            "value": survey.health.channels[name].value,
            "sources": sources,
        }
        for name, sources in survey.channels.items()
    }
