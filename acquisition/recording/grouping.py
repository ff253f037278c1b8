"""Groups files into recordings, moves the times of their parts onto one clock, and lists their events.

A recorder whose computer's clock is set continues in a new part, by the new time. Its parts state how far UTC is
from the monotonic clock, which nobody sets. Where they were recorded in one boot, and also state how long the
computer has slept, during which the monotonic clock stands still, the times on both sides of the step are those of
one recording, moved onto one clock. Where they do not state it, each side of a step is a recording of its own.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from mcap import records as mcap

from seatrial.acquisition.core.errors import InputError, printable
from seatrial.acquisition.core.quantities import Series
from seatrial.acquisition.core.trial import iso
from seatrial.acquisition.recording.reader import Recording, open_recording, read_recording, recording_size
from seatrial.acquisition.recording.scan import Damage, scan

NEW_PART_NS = 1_000_000_000
"""A clock that is set by so much is another clock; what is less is followed slowly."""
_TIME = r"\d{8}T\d{6}Z"
_RECORDER_NAME = re.compile(rf".*_{_TIME}.*\.mcap")
_LATER_PART = re.compile(rf"(.*_{_TIME})_part\d+(?:_\d+)?")
_MOST_RECORDS = 100  # before the first message: header, run sheet, configuration with its DBC files, part, clock
_MOST_NS = 2**61  # 73 years: two such numbers and a time still fit into 64 bits
Metadata = Mapping[str, Mapping[str, str]]
Files = Path | str | Sequence[Path | str]
"""A recording: its file, or those of its parts."""
KINDS = ("mark", "alarm", "source", "recorder")
_ALARM = re.compile(r"ALARM |alarm over: |alarm ")
_WORD = re.compile(r"[^\s':,;]+")


@dataclass(frozen=True, slots=True)
class PartClock:
    """The clock of a part: UTC less the monotonic clock [ns], the boot, how long the computer had slept [ns].

    ``is_synchronised`` says that NTP or PTP kept it when the part began; None and "" stand for what is not stated.
    """

    offset_ns: int | None = None
    boot: str = ""
    slept_ns: int | None = None
    is_synchronised: bool = False

    @classmethod
    def of(cls, metadata: Metadata) -> PartClock:
        """The clock that a part states."""
        texts = metadata.get("clock", {})
        numbers: dict[str, int] = {}
        for key in ("utc_minus_monotonic_ns", "slept_ns"):
            with suppress(ValueError):
                number = int(texts.get(key, ""))
                if abs(number) < _MOST_NS:
                    numbers[key] = number
        is_synchronised = texts.get("host_clock", "").startswith("kept")
        boot = texts.get("boot", "")
        return cls(numbers.get("utc_minus_monotonic_ns"), boot, numbers.get("slept_ns"), is_synchronised)

    def was_set_since(self, before: PartClock) -> bool:
        """Whether it differs from an earlier part's clock by a step, as far as both state it."""
        if self.offset_ns is None or before.offset_ns is None:
            return False
        return abs(self.offset_ns - before.offset_ns) >= NEW_PART_NS

    def ahead_of(self, before: PartClock) -> int | None:
        """By how much it is ahead of an earlier one, the time slept left out [ns]; None where that is not sure."""
        numbers = self.offset_ns, before.offset_ns, self.slept_ns, before.slept_ns
        if None in numbers or not self.boot or self.boot != before.boot:
            return None
        offset_ns, earlier_offset_ns, slept_ns, earlier_slept_ns = (number or 0 for number in numbers)
        return offset_ns - slept_ns - earlier_offset_ns + earlier_slept_ns


def group_parts(paths: Iterable[Path]) -> list[tuple[Path, ...]]:
    """Recordings as their files, in the order of ``paths``: the parts of one recording together, in their order.

    A part belongs to the one that it states it follows, else to the one that its name states; not where the clock
    was set between them by an unknown time.
    """
    paths = list(paths)
    by_place = {(path.parent, path.name): path for path in paths}
    recordings: dict[Path, list[Path]] = {}
    beginnings: dict[Path, Path] = {}  # the part that a part's recording begins with
    by_stem: dict[Path, Path] = {}
    for path in _in_chain_order(paths, by_place):
        match = _LATER_PART.fullmatch(path.stem)
        stem = path.parent / (match[1] if match else path.stem)
        previous = by_place.get((path.parent, _follows(path)), by_stem.get(stem) if match else None)
        beginning = path
        candidate = beginnings.get(previous) if previous is not None else None
        if previous and candidate and recordings[candidate][-1] == previous:  # no other part follows it already
            before, clock = PartClock.of(_head(previous)), PartClock.of(_head(path))
            if not clock.was_set_since(before) or clock.ahead_of(before) is not None:  # alignable
                beginning = candidate
        recordings.setdefault(beginning, []).append(path)
        beginnings[path], by_stem[stem] = beginning, path
    order = {path: number for number, path in enumerate(paths)}
    return [tuple(recordings[beginning]) for beginning in sorted(recordings, key=order.__getitem__)]


def _in_chain_order(paths: Sequence[Path], by_place: Mapping[tuple[Path, str], Path]) -> Iterator[Path]:
    """The paths in their order, but each after the one that it follows; in a circle each once."""
    visited: set[Path] = set()
    for path in paths:
        chain = []
        while path is not None and path not in visited:
            visited.add(path)
            chain.append(path)
            path = by_place.get((path.parent, _follows(path)))  # type: ignore[assignment]
        yield from reversed(chain)


def _follows(path: Path) -> str:
    return _head(path).get("part", {}).get("follows", "")


def _head(path: Path) -> Metadata:
    """What a file states of its part and clock; empty for a name that no recorder gives, and for no recording."""
    if not _RECORDER_NAME.fullmatch(path.name):
        return {}
    try:
        state = path.stat()
        return _read_head(path, (state.st_ino, state.st_mtime_ns))
    except OSError:
        return {}


@lru_cache(maxsize=100_000)
def _read_head(path: Path, _: tuple[int, int]) -> Metadata:
    """The metadata before the first message of a file in a state, of which only the beginning is read."""
    metadata: dict[str, dict[str, str]] = {}
    with suppress(InputError), open_recording(path) as stream:
        for number, entry in enumerate(scan(stream)):
            if isinstance(entry, Damage) or isinstance(entry.record, mcap.Chunk | mcap.Message):
                break
            if isinstance(entry.record, mcap.Metadata):
                metadata[entry.record.name] = printable(entry.record.metadata)
            if number > _MOST_RECORDS or {"part", "clock"} <= metadata.keys():
                break
    return metadata


def read_recordings(paths: Iterable[Path]) -> Iterator[Recording]:
    """The recordings in some files, one after the other, each with its parts. Raises as :func:`read_parts`."""
    return map(read_parts, group_parts(paths))


def read_together(files: Files) -> Recording:
    """The recording in a file, or in parts in any order.

    Raises :class:`InputError` for files that are not of one recording, and as :func:`read_parts`.
    """
    paths = [Path(files)] if isinstance(files, Path | str) else sorted(map(Path, files))
    recordings = group_parts(paths)
    if len(recordings) != 1:
        for path in paths:
            recording_size(path)  # one that is not there is the reason
        raise InputError(
            "are not the parts of one recording", where=", ".join(path.name for path in paths),
            why="they do not follow each other, or the clock was set between them by an unknown time",
            fix="give one recording at a time",
        )  # fmt: skip
    return read_parts(recordings[0])


def read_parts(paths: Sequence[Path]) -> Recording:
    """One recording in parts, the files in their order: samples one after the other, run sheet of the last.

    Where the clock was set between parts, their times are moved onto one clock: of those that were kept by NTP or
    PTP the last, else the last. Raises as :func:`read_recording`.
    """
    parts, remark = _align_clocks([read_recording(path) for path in paths])
    samples: dict[str, list[Series]] = {}
    for part in parts:
        for name, series in part.series.items():
            samples.setdefault(name, []).append(series)
    beginning = parts[0]
    spans = [part for part in parts if part.messages] or parts
    return replace(
        parts[-1], path=beginning.path, later_parts=tuple(paths[1:]), metadata=beginning.metadata,
        series={name: Series.joined(pieces) for name, pieces in samples.items()},
        raw=dict(sum((Counter(part.raw) for part in parts), Counter())),
        events=[event for part in parts for event in part.events],
        event_labels=[label for part in parts for label in part.event_labels],
        messages=sum(part.messages for part in parts), predictions=sum(part.predictions for part in parts),
        closed=all(part.closed for part in parts),
        start_ns=min(part.start_ns for part in spans), end_ns=max(part.end_ns for part in spans),
        clock=remark,
    )  # fmt: skip


def _align_clocks(parts: Sequence[Recording]) -> tuple[list[Recording], str]:
    """The parts with their times by one clock, and a remark on a missing beginning and on moved times."""
    clocks = [PartClock.of(part.metadata) for part in parts]
    synchronised = [clock for clock in clocks if clock.is_synchronised]
    ahead_ns = [(synchronised or clocks)[-1].ahead_of(clock) or 0 for clock in clocks]
    moves_ns = [ahead if abs(ahead) >= NEW_PART_NS else 0 for ahead in ahead_ns]
    aligned = [_shift(part, by_ns) if by_ns else part for part, by_ns in zip(parts, moves_ns, strict=True)]
    remarks, part = [], parts[0].metadata.get("part", {})
    moves = Counter(by_ns for by_ns in moves_ns if by_ns)
    if part.get("follows"):
        number, reason = part.get("number"), part.get("reason")
        remarks.append(f"it begins with part {number}, which follows {part['follows']}: {reason}")
    if moves:
        texts = [f"of {count} of its {len(parts)} parts by {by_ns / 1e9:+,.3f} s" for by_ns, count in moves.items()]
        remarks.append(
            f"the computer's clock was set meanwhile: times are moved, {', '.join(texts)}, by its monotonic clock"
        )
    return aligned, "; ".join(remarks)


def _shift(part: Recording, by_ns: int) -> Recording:
    """A part whose times by the computer's clock are moved; those by another clock, as of a satellite, stay."""

    def move(series: Series) -> Series:
        measured_ns, received_ns = series.measured_ns, series.received_ns + by_ns
        # a measurement nearer to the reception by the new clock is not of the old one
        is_old = np.abs(measured_ns - series.received_ns) <= np.abs(measured_ns - received_ns)
        moved_ns = np.asarray(np.where(is_old, measured_ns + by_ns, measured_ns))
        return replace(series, received_ns=received_ns, measured_ns=moved_ns)

    return replace(
        part,
        series={name: move(series) for name, series in part.series.items()},
        events=[(time_ns + by_ns, text) for time_ns, text in part.events],
        start_ns=part.start_ns + by_ns,
        end_ns=part.end_ns + by_ns,
    )


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
    """The events of a recording in the order of time; what names one of its sources is about that source.

    Files of long ago name no marks and alarms.
    """
    lines = {*recording.health, *(source.partition("/")[0] for series in recording.series.values()
                                  for source in series.sources)}  # fmt: skip
    labels = recording.event_labels or [("", "")] * len(recording.events)
    events = []
    for (time_ns, text), (name, level) in zip(recording.events, labels, strict=True):
        kind, source = "mark" if name == "mark" else "alarm", ""
        if name not in ("mark", "alarm") and not _ALARM.match(text):
            words = (word.partition("/")[0] for word in _WORD.findall(text))
            source = next((word for word in words if word in lines), "")
            kind = "source" if source else "recorder"
        events.append(Event(time_ns, kind, level, source, text))
    return sorted(events, key=lambda event: event.time_ns)


def counts_text(events: list[Event]) -> str:
    """How many events there are of each kind, in words; empty for none."""
    counts = Counter(event.kind for event in events)
    words = {"mark": "mark", "alarm": "alarm", "source": "event of a source", "recorder": "event of the recorder"}
    plurals = {"source": "events of sources", "recorder": "events of the recorder"}
    return ", ".join(
        f"{counts[kind]:,} {words[kind] if counts[kind] == 1 else plurals.get(kind, words[kind] + 's')}"
        for kind in KINDS if counts[kind]
    )  # fmt: skip
