"""The event log of a recording: marks, alarms, what happened to its sources, and what the recorder itself said."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass
from typing import Any

from seatrial.acquisition.core.frames import iso
from seatrial.acquisition.recording.reader import Recording

KINDS = ("mark", "alarm", "source", "recorder")
_ALARM = re.compile(r"ALARM |alarm over: |alarm ")
_WORD = re.compile(r"[^\s':,;]+")


@dataclass(frozen=True, slots=True)
class Event:
    """One event: its time [ns since 1970, UTC] by the computer's clock, its kind, one of :data:`KINDS`, its text.

    ``level`` is "info", "warning" or "error", empty where the file does not say; ``source`` is what it is about.
    """

    time_ns: int
    kind: str
    level: str
    source: str
    text: str

    def as_json(self) -> dict[str, Any]:
        """The event as an object, its time as ISO 8601."""
        return {"time": iso(self.time_ns), "kind": self.kind, "level": self.level, "source": self.source,
                "text": self.text}  # fmt: skip


def events_of(recording: Recording) -> list[Event]:
    """The events of a recording in the order of time; what names one of its sources is about that source."""
    lines = {*recording.health, *(source.partition("/")[0] for series in recording.series.values()
                                  for source in series.sources)}  # fmt: skip
    labels = recording.event_labels or [("", "")] * len(recording.events)
    events = [
        _event(time_ns, text, name, level, lines)
        for (time_ns, text), (name, level) in zip(recording.events, labels, strict=True)
    ]
    return sorted(events, key=lambda event: event.time_ns)


def _event(time_ns: int, text: str, name: str, level: str, lines: set[str]) -> Event:
    """An event from what the file says of it: files of long ago name no marks and alarms."""
    if name == "mark":
        return Event(time_ns, "mark", level, "", text)
    if name == "alarm" or _ALARM.match(text):
        return Event(time_ns, "alarm", level, "", text)
    source = next((word for word in _WORD.findall(text) if word.partition("/")[0] in lines), "").partition("/")[0]
    return Event(time_ns, "source" if source else "recorder", level, source, text)


def counts_text(events: list[Event]) -> str:
    """How many events there are of each kind, in words; empty for none."""
    counts = Counter(event.kind for event in events)
    words = {"mark": "mark", "alarm": "alarm", "source": "event of a source", "recorder": "event of the recorder"}
    plurals = {"source": "events of sources", "recorder": "events of the recorder"}
    return ", ".join(
        f"{counts[kind]:,} {words[kind] if counts[kind] == 1 else plurals.get(kind, words[kind] + 's')}"
        for kind in KINDS if counts[kind]
    )  # fmt: skip
