"""What a check says: flags beside the data, and findings in words with their size.

Flags are those of QARTOD (:class:`seatrial.acquisition.core.trial.Quality`): 1 good, 2 not evaluated, 3 suspect, 4
bad, 9 missing. A check never drops a row; it returns flags of the same index as the data it was given. What checks
of single channels found stands in one finding a channel and code, or in one for all channels together.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from seatrial.acquisition.core.quantities import Ints, Series
from seatrial.acquisition.core.ship import Channel
from seatrial.acquisition.core.trial import Quality
from seatrial.analysis.quality.samples import Stretch
from seatrial.analysis.quality.time_checks import ClockJump
from seatrial.analysis.tables.table import NANO, time_span_text

Flags = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that is wrong: where, how large, how sure, and what to do.

    ``start`` and ``end`` bound it in UTC; ``text`` is one sentence a person reads, ``remedy`` one more that
    says what to do. ``estimate`` holds its size in the names of the contract, with ``low`` and ``high`` of
    the main figure's 95 % interval beside it. ``certain`` marks what `--repair` may put right by itself.
    ``band_hz`` are the frequencies of the motion in which it shows, where it is a matter of these.
    """

    code: str
    channel: str
    start: pd.Timestamp
    end: pd.Timestamp
    text: str
    remedy: str = ""
    estimate: Mapping[str, float] = field(default_factory=dict)
    certain: bool = False
    band_hz: tuple[float, float] | None = None

    def as_json(self) -> dict[str, Any]:
        """The finding with the contract's keys, and ``band_hz`` where there is one; the remedy ends the text."""
        band = {} if self.band_hz is None else {"band_hz": list(self.band_hz)}
        return {
            "code": self.code,
            "channel": self.channel,
            "start": self.start.isoformat(),
            "end": self.end.isoformat(),
            "text": f"{self.text.rstrip('.')}. {self.remedy}".strip(),
            "estimate": dict(self.estimate),
            **band,
        }


@dataclass(frozen=True, slots=True)
class CheckResult:
    """The result of a check across channels.

    ``flags`` has the table's index and a column for each channel that the check evaluated, as uint8.
    """

    flags: pd.DataFrame
    findings: tuple[Finding, ...] = ()


Check = Callable[[pd.DataFrame], CheckResult]
"""A check across channels: from the joined table of raw samples, in the order of measured time."""


def uniform_flags(table: pd.DataFrame, names: Iterable[str] = (), flag: Quality = Quality.GOOD) -> pd.DataFrame:
    """Flags of some channels: missing where ``table`` has no value, else all the same."""
    columns = {name: np.where(table[name].isna(), Quality.MISSING, flag).astype(np.uint8) for name in names}
    return pd.DataFrame(columns, index=table.index)


def mark(flags: pd.DataFrame, name: str, rows: Ints, flag: Quality) -> None:
    """Give some rows of a channel a flag, in place."""
    column = flags[name].to_numpy(copy=True)
    column[rows] = flag
    flags[name] = column


_PRECEDENCE = (Quality.NOT_EVALUATED, Quality.GOOD, Quality.SUSPECT, Quality.BAD, Quality.MISSING)
_RANK = np.zeros(max(_PRECEDENCE) + 1, dtype=np.uint8)
_RANK[[*_PRECEDENCE]] = np.arange(len(_PRECEDENCE))


def merge_flags(first: Flags, second: Flags) -> Flags:
    """The graver of two flags, value by value; what was judged counts more than what was not.

    >>> merge_flags(np.array([1, 2, 3, 9], np.uint8), np.array([2, 1, 4, 4], np.uint8)).tolist()
    [1, 1, 4, 9]
    """
    return np.where(_RANK[first] >= _RANK[second], first, second).astype(np.uint8)


ALL = "all"
OTHER_TURN = "other_turn"
"""In the estimate of impossible angles that are possible in the other convention."""
_FEW = 0.05
"""The share of samples that may be stamped outside a recording for certain to be the wrong ones."""
Troubles = Mapping[str, list[Stretch]]
"""By channel: where it has one kind of fault."""


CERTAIN = frozenset({"out_of_range", "spike", "stuck", "duplicate"})
"""Codes whose flagged samples `--repair` may turn into gaps without asking."""


@dataclass(frozen=True, slots=True)
class Wording:
    """The text for one kind of fault: a sentence of what :func:`_facts_of` says of the stretches, and what to do.

    ``estimate`` says which of these facts the figures of the finding are.
    """

    sentence: str
    remedy: str
    estimate: Mapping[str, str] = field(default_factory=lambda: {"count": "count", "largest": "size"})


def _facts_of(channel: str, unit: str, stretches: list[Stretch], largest: Stretch) -> dict[str, Any]:
    """What there is to say of a channel's stretches of one fault and the largest of them."""
    count, samples = len(stretches), sum(stretch.size for stretch in stretches)
    return {
        "who": "every channel" if channel == ALL else channel,
        "unit": unit,
        "times": "once" if count == 1 else "twice" if count == 2 else f"{count} times",
        "samples": "1 sample" if samples == 1 else f"{samples:,.0f} samples",
        "count": float(count),
        "total": samples,
        "size": abs(largest.size),
        "seconds": largest.seconds,
        "at": f"{utc_time(largest.start_ns):%H:%M:%S}",
        "first": f"{utc_time(min(stretches).start_ns):%H:%M:%S}",
    }


WORDING: dict[str, Wording] = {
    "gap": Wording(
        "{who} is silent {times}, {total:.1f} s in all, the longest {size:.1f} s from {at}",
        "Nothing is put across a gap; keep it out of windows",
        {"seconds": "size", "count": "count"},
    ),
    "stuck": Wording(
        "{who} stands exactly still {times} although it should move, the longest for {seconds:.1f} s from {at}",
        "Do not use it there; look for a sensor or a converter that stopped",
        {"seconds": "seconds", "count": "count"},
    ),
    "spike": Wording(
        "{who} leaves its neighbours and returns {times}, the furthest by {size:.3g} {unit} at {at}",
        "The samples are flagged bad and stay out of resampling",
    ),
    "out_of_range": Wording(
        "{who} has {samples} with impossible values, the first at {first}",
        "The samples are flagged bad; look at the unit and at the source's code for no value",
        {"count": "total"},
    ),
    "duplicate": Wording(
        "{who} has {samples} at a measured time that was there before, the first at {first}",
        "Keep one of the samples of one time",
        {"count": "total"},
    ),
    "time_backwards": Wording(
        "The measured time of {who} runs back {times}, the furthest by {size:.3g} s at {at}",
        "Tables are sorted by measured time; look at how the source stamps",
        {"seconds": "size", "count": "count"},
    ),
    "time_jitter": Wording(
        "The stamps of {who} scatter about a regular clock by {size:.3g} s",
        "Take the source's own time if it has one, or put the samples back on a regular clock",
        {"seconds": "size"},
    ),
    "quantised": Wording(
        "{who} moves in steps of {size:.3g} {unit}, coarser than its noise",
        "What lies between the steps is lost; take it from a finer source if there is one",
        {"step": "size"},
    ),
}


def utc_time(time_ns: int) -> pd.Timestamp:
    """A time [ns since 1970] as UTC."""
    return pd.Timestamp(time_ns, unit="ns", tz="UTC")


def findings_of(code: str, troubles: Troubles, channels: Mapping[str, Channel]) -> list[Finding]:
    """Findings of one code: what all ``channels`` have in common once, the rest by channel."""
    together, separate = _split_common(troubles) if len(troubles) == len(channels) > 1 else ([], dict(troubles))
    findings = [_finding(code, ALL, "", together)] if together else []
    return findings + [
        _finding(code, name, channels[name].unit, stretches) for name, stretches in separate.items() if stretches
    ]


def _split_common(troubles: Troubles) -> tuple[list[Stretch], dict[str, list[Stretch]]]:
    """The stretches that every channel has, by their ends, and what is left of each."""
    ends = set.intersection(
        *({(stretch.start_ns, stretch.end_ns) for stretch in stretches} for stretches in troubles.values())
    )
    first = next(iter(troubles.values()))
    together = [stretch for stretch in first if (stretch.start_ns, stretch.end_ns) in ends]
    separate = {channel: [stretch for stretch in stretches if (stretch.start_ns, stretch.end_ns) not in ends]
             for channel, stretches in troubles.items()}  # fmt: skip
    return together, separate


def _finding(code: str, channel: str, unit: str, stretches: list[Stretch]) -> Finding:
    words, largest = WORDING[code], max(stretches, key=lambda stretch: (abs(stretch.size), -stretch.start_ns))
    start, end = (
        utc_time(min(stretch.start_ns for stretch in stretches)),
        utc_time(max(stretch.end_ns for stretch in stretches)),
    )
    facts = _facts_of(channel, unit, stretches, largest)
    estimate = {key: facts[fact] for key, fact in words.estimate.items()}
    return Finding(
        code, channel, start, end, words.sentence.format_map(facts), words.remedy, estimate, code in CERTAIN
    )


def other_convention_finding(finding: Finding, channel: Channel) -> Finding:
    """A finding of impossible angles that are counted in another turn; that makes their repair certain."""
    ours = "-180..180" if channel.low < 0.0 else "0..360"
    count = finding.estimate["count"]
    text = (
        f"{finding.channel} counts otherwise than {ours}, which is the convention: {count:,.0f} "
        f"{'sample lies' if count == 1 else 'samples lie'} beyond, the first at {finding.start:%H:%M:%S}"
    )
    remedy = "`--repair` turns them into it; give the convention to what imports or decodes them"
    return replace(finding, text=text, remedy=remedy, estimate={**finding.estimate, OTHER_TURN: 1.0})


def clock_jump_finding(jump: ClockJump, channel: str, what: str) -> Finding:
    """A jump of a clock; ``what`` says whose clock, and what it was seen against."""
    direction = "forward" if jump.seconds > 0 else "back"
    text = (
        f"{what} jumps {direction} by {abs(jump.seconds):.2f} s ({abs(jump.low):.2f} to {abs(jump.high):.2f}) "
        f"at {utc_time(jump.start_ns):%H:%M:%S}"
    )
    estimate = {"seconds": jump.seconds, "low": jump.low, "high": jump.high}
    remedy = "Take the jump off every later stamp before anything crosses it"
    return Finding("clock_jump", channel, utc_time(jump.start_ns), utc_time(jump.end_ns), text, remedy, estimate)


def time_outlier_finding(series: Mapping[str, Series], first_ns: int, last_ns: int) -> Finding:
    """Samples that are stamped outside the recording proper, which lasts from ``first_ns`` to ``last_ns``.

    A few are certain to be wrong; of two halves that lie years apart nobody knows which.
    """
    times = {name: samples.measured_ns for name, samples in series.items()}
    stray = {name: stamps[(stamps < first_ns) | (stamps > last_ns)] for name, stamps in times.items()}
    stray = {name: stamps for name, stamps in stray.items() if stamps.size}
    stray_ns = np.concatenate(list(stray.values()))
    away_s = max(first_ns - int(stray_ns.min()), int(stray_ns.max()) - last_ns) / NANO
    channel = next(iter(stray)) if len(stray) == 1 else ALL
    count, due = stray_ns.size, sum(map(len, times.values()))
    text = (
        f"{count:,} of {due:,} samples {'is' if count == 1 else 'are'} stamped {time_span_text(stray_ns)}, up to "
        f"{away_s / 86400:,.0f} days from the recording proper, {time_span_text(np.array([first_ns, last_ns]))}"
    )
    remedy = "Look at the clock when recording began; `--repair` makes gaps of a few such samples"
    estimate = {"count": float(count), "seconds": away_s}
    ends = utc_time(int(stray_ns.min())), utc_time(int(stray_ns.max()))
    return Finding("time_outlier", channel, *ends, text, remedy, estimate, count < _FEW * due)
