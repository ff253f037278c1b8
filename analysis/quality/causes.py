"""Findings by their cause: what one outage or one source did to many channels is one thing to read, and to mend.

Findings of one code belong together where their channels share the places: silences that begin and end together,
whatever source each channel is from, as what is derived is silent with its inputs; other faults where they come of
one source in one stretch of time. The recorder's own event beside an outage is quoted.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import pandas as pd

from seatrial.acquisition.recording.grouping import Event
from seatrial.analysis.quality.findings import ALL, Finding
from seatrial.analysis.quality.samples import Stretch
from seatrial.analysis.tables.table import NANO

_OF_TIME = frozenset({"gap", "duplicate", "time_backwards", "time_jitter", "stuck", "clock_jump"})
"""Codes of what a source does to all of its channels at once; other faults are the channel's own, unless they are
of the very same samples."""
_SLACK_S = 3.0
"""Channels of one outage fall silent and come back within their intervals and what a source takes to start."""
_ALIKE = 0.7
"""The share of the time with a fault that two channels have in common, of the one with more."""
_EVENT_SLACK_S = 10.0
"""An event tells of an outage that long after it: a silent source is noticed late."""


@dataclass(frozen=True, slots=True)
class Cause:
    """Findings of one cause, the most severe first, with their channels, the lines that these come from, and what
    the recorder itself said of it."""

    findings: tuple[Finding, ...]
    channels: tuple[str, ...]
    sources: tuple[str, ...] = ()
    events: tuple[str, ...] = ()

    @property
    def code(self) -> str:
        return self.findings[0].code

    @property
    def span(self) -> tuple[pd.Timestamp, pd.Timestamp]:
        """From the first beginning to the last end."""
        return min(finding.start for finding in self.findings), max(finding.end for finding in self.findings)

    @property
    def text(self) -> str:
        """All of it as one paragraph: what the first finding says, the channels, the events, what to do."""
        first = self.findings[0]
        shared_text = ""
        if len(self.findings) > 1:
            of = f" of {', '.join(self.sources)}" if self.sources else ""
            remaining = [name for name in self.channels if name != first.channel]
            shared_text = f". The same holds for {len(remaining)} other channels{of}: {', '.join(remaining)}"
        quotation = f'. The recorder said: "{"; ".join(self.events)}"' if self.events else ""
        remedy = f" {first.remedy.rstrip('.')}." if first.remedy else ""
        return f"{first.text.rstrip('.')}{shared_text}{quotation}.{remedy}"

    def as_json(self) -> dict[str, Any]:
        """The cause as an object; its findings stand in ``findings`` of the whole."""
        start, end = self.span
        return {
            "code": self.code, "channels": list(self.channels), "sources": list(self.sources),
            "start": start.isoformat(), "end": end.isoformat(), "findings": len(self.findings),
            "events": list(self.events), "text": self.text,
        }  # fmt: skip


def causes_of(
    findings: Sequence[Finding],
    gaps: Mapping[str, Sequence[Stretch]],
    sources: Mapping[str, Sequence[str]],
    events: Iterable[Event] = (),
) -> tuple[Cause, ...]:
    """The causes of findings, in the order of their first ones.

    ``gaps`` and ``sources`` are those of each channel, ``events`` the recording's log.
    """
    groups: list[list[Finding]] = []
    for finding in findings:
        group = next(
            (candidate for candidate in groups if _has_same_cause(finding, candidate[0], gaps, sources)), None
        )
        if group is None:
            groups.append([finding])
        else:
            group.append(finding)
    log = list(events)
    return tuple(_cause(group, gaps, sources, log) for group in groups)


def _has_same_cause(
    finding: Finding,
    member: Finding,
    gaps: Mapping[str, Sequence[Stretch]],
    sources: Mapping[str, Sequence[str]],
) -> bool:
    if finding.code != member.code or ALL in (finding.channel, member.channel):
        return False
    if finding.code == "gap":
        return _share_silences(gaps.get(finding.channel, ()), gaps.get(member.channel, ()))
    lines = _lines_of(sources, finding.channel)
    if not lines or lines != _lines_of(sources, member.channel):
        return False
    return _overlap(finding, member) if finding.code in _OF_TIME else _share_samples(finding, member)


def _share_silences(first: Sequence[Stretch], second: Sequence[Stretch]) -> bool:
    """Whether two channels are silent for most of the time in silences that begin and end together."""
    slack_ns = _SLACK_S * NANO
    together_s = sum(
        gap.seconds for gap in first
        if any(abs(gap.start_ns - silence.start_ns) <= slack_ns and abs(gap.end_ns - silence.end_ns) <= slack_ns
               for silence in second)
    )  # fmt: skip
    longest_s = max(sum(gap.seconds for gap in gaps) for gaps in (first, second))
    return together_s > 0.0 and together_s >= _ALIKE * longest_s


def _share_samples(first: Finding, second: Finding) -> bool:
    """Whether two findings are of the same samples, as a position's in metres and in degrees are."""
    counted = first.estimate.get("count"), second.estimate.get("count")
    return (
        (first.start, first.end) == (second.start, second.end) and None not in counted and counted[0] == counted[1]
    )


def _overlap(first: Finding, second: Finding) -> bool:
    """Whether what two findings have in common is most of the time of both."""
    common = (min(first.end, second.end) - max(first.start, second.start)).total_seconds()
    longest = max((finding.end - finding.start).total_seconds() for finding in (first, second))
    return common >= _ALIKE * longest - _SLACK_S


def _lines_of(sources: Mapping[str, Sequence[str]], channel: str) -> frozenset[str]:
    """The lines, or tables, that a channel's samples came from: a label's beginning."""
    return frozenset(
        label.partition("/")[0].partition(":")[0].partition(" ")[0] for label in sources.get(channel, ())
    )


def _cause(
    group: list[Finding],
    gaps: Mapping[str, Sequence[Stretch]],
    sources: Mapping[str, Sequence[str]],
    log: list[Event],
) -> Cause:
    channels = tuple(dict.fromkeys(finding.channel for finding in group))
    lines = tuple(sorted({line for name in channels for line in _lines_of(sources, name)}))
    spans = [(gap.start_ns, gap.end_ns) for name in channels for gap in gaps.get(name, ())]
    if group[0].code != "gap":
        spans = []
    elif ALL in channels:
        spans = [(finding.start.value, finding.end.value) for finding in group]
    return Cause(tuple(group), channels, lines, tuple(dict.fromkeys(_events_of(spans, lines, log))))


def _events_of(spans: list[tuple[int, int]], lines: tuple[str, ...], log: list[Event]) -> list[str]:
    """What the log says of these lines, or of the recorder, in stretches of time: the first two and the last."""
    slack_ns = int(_EVENT_SLACK_S * NANO)
    texts = [
        event.text for event in log
        if event.level != "info" and event.kind in ("source", "recorder") and event.source in ("", *lines)
        and any(start <= event.time_ns <= end + slack_ns for start, end in spans)
    ]  # fmt: skip
    return texts if len(texts) <= 3 else [*texts[:2], texts[-1]]
