"""``seatrial record --check``: before departure, which channels will be missing, and why.

The check is a short recording, made exactly as a real one and thrown away: what works here works at sea. It lies
in the folder for temporary files; where the real one will go is looked at, and nothing is written there.
"""

from __future__ import annotations

import os
import tempfile
import threading
import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from seatrial.acquisition.config.configuration import TrialConfig
from seatrial.acquisition.config.sections import RecordingSection
from seatrial.acquisition.logger.alarms import check_alarms
from seatrial.acquisition.logger.health import ENOUGH_RATE, SILENT_NS, Health
from seatrial.acquisition.logger.missing import what_comes, why_missing
from seatrial.acquisition.logger.pipeline import Recorder, health_of
from seatrial.acquisition.logger.survey import Survey, survey_of_recording
from seatrial.acquisition.recording.parts import RecordingParts
from seatrial.acquisition.recording.storage import free_bytes, shortage


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
    """What a check found: every channel, every source, what was told on the way, and where a recording would go.

    ``disk_problem`` says why nothing could be recorded there; it is empty where all is well.
    """

    channels: list[ChannelReport]
    sources: list[dict[str, Any]]
    events: list[str]
    free_bytes: int | None
    disk_problem: str = ""

    @property
    def missing(self) -> list[str]:
        """The channels that would be missing."""
        return [channel.name for channel in self.channels if channel.problem]

    @property
    def obstacles(self) -> list[str]:
        """Why the trial is not ready; nothing if it is."""
        missing = [f"{', '.join(self.missing)} would be missing"] if self.missing else []
        return missing + ([self.disk_problem] if self.disk_problem else [])

    def as_json(self) -> dict[str, Any]:
        return {"ready": not self.obstacles, "missing": self.missing, **asdict(self)}


def check_before_departure(
    config: TrialConfig, duration_s: float, folder: Path | None = None, stop: threading.Event | None = None
) -> PreflightReport:
    """Listen to every source for ``duration_s`` [s]; ``folder`` is where the recording would go, if it is known.

    Raises :class:`SourceError` when no source can be opened, :class:`StorageError` when nothing can be written,
    :class:`ConfigurationError` for an alarm of something that there is not.
    """
    check_alarms(config.alarms, health_of(config))
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
            survey = survey_of_recording(config, parts.paths)
            channels = [_report(name, survey, recorder.health, now_ns) for name in recorder.health.names]
        finally:
            parts.discard()
    events = [text for _, level, text in recorder.health.events if level != "info"]
    free, problem = (None, "") if folder is None else check_folder(folder, config.recording)
    if config.copies is not None and not config.copies.folder.is_dir():
        problem = "; ".join(filter(None, (problem, f"{config.copies.folder} is not there to copy to")))
    return PreflightReport(channels, sources, events, free, problem)


def check_folder(folder: Path, settings: RecordingSection) -> tuple[int | None, str]:
    """What is free where a recording would go [bytes], and why it could not; nothing is written there."""
    existing = next(directory for directory in (folder, *folder.absolute().parents) if os.path.lexists(directory))
    if not existing.is_dir():
        return None, f"{folder}: {existing} is no folder"
    if not os.access(existing, os.W_OK | os.X_OK):
        what = "written to" if existing == folder else f"made: {existing} cannot be written to"
        return None, f"{folder} cannot be {what}"
    try:
        free, size = free_bytes(existing)
    except OSError as error:
        return None, f"{folder}: its disk cannot be asked for room: {error.strerror}"
    why = shortage(settings, free, size)
    return free, f"{folder}: {why}" if why else ""


def _report(name: str, survey: Survey, health: Health, now_ns: int) -> ChannelReport:
    channel = health.channels[name]
    value = channel.value if channel.count else None
    problem = _problem(name, survey, health, now_ns)
    return ChannelReport(
        name, channel.rate_hz(now_ns), value, channel.source, problem, health.known_channels[name].unit
    )


def _problem(name: str, survey: Survey, health: Health, now_ns: int) -> str:
    channel = health.channels[name]
    providers = [source.name for source in survey.config.sources if name in source.channels]
    if channel.count == 0:
        failed = [provider for provider in providers if health.sources[provider].state in ("opening", "failed")]
        if failed:
            return "; ".join(f"source {provider!r} cannot be opened" for provider in failed)
        if providers:
            return why_missing(name, survey)
        return "; ".join(filter(None, ("no source provides it", what_comes(name, survey))))
    if channel.age_s(now_ns) * 1e9 > SILENT_NS:
        return f"fell silent {channel.age_s(now_ns):.0f} s ago"
    if channel.expected_hz is not None and channel.rate_hz(now_ns) < ENOUGH_RATE * channel.expected_hz:
        return f"comes {channel.rate_hz(now_ns):.1f} times a second instead of {channel.expected_hz:g}"
    return ""
