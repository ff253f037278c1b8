"""The results of a check: flags of the samples, and findings in words with their size.

Flags are those of QARTOD (:class:`seatrial.acquisition.core.trial.Quality`): 1 good, 2 not evaluated, 3 suspect, 4
bad, 9 missing. A check never drops a row; it returns flags of the same index as the data it was given. The results
of the checks of single channels are one finding per channel and code, or one for all channels together.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd

from seatrial.acquisition.core import ship
from seatrial.acquisition.core.quantities import Bytes, Ints
from seatrial.acquisition.core.trial import Quality
from seatrial.analysis import series

Flags = Bytes
ALL = "all"
SHIP = "ship"
"""What a finding is about that is no fault of a channel."""
OTHER_TURN = "other_turn"
"""In the estimate of impossible angles that are possible in the other convention."""
StretchesByChannel = Mapping[str, list[series.Stretch]]
"""Where each channel has one kind of fault."""
CERTAIN = frozenset({"out_of_range", "spike", "stuck", "duplicate"})
"""Codes whose flagged samples `--repair` may turn into gaps without asking."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that is wrong: where, how large, how sure, and what to do.

    ``start`` and ``end`` bound it in UTC; ``text`` is one sentence for a reader, ``remedy`` one more that
    states what to do. ``estimate`` holds its size in the names of the contract, with ``low`` and ``high`` of
    the main figure's 95 % interval. ``certain`` marks what `--repair` may correct by itself.
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
    ``unevaluated`` is what could not be judged, and why.
    """

    flags: pd.DataFrame
    findings: tuple[Finding, ...] = ()
    unevaluated: str = ""


Check = Callable[[pd.DataFrame], CheckResult]
"""A check across channels: from the joined table of raw samples, in the order of measured time."""


def uniform_flags(table: pd.DataFrame, names: Iterable[str] = (), flag: Quality = Quality.GOOD) -> pd.DataFrame:
    """Flags of some channels: missing where ``table`` has no value, else all the same."""
    columns = {name: np.where(table[name].isna(), Quality.MISSING, flag).astype(np.uint8) for name in names}
    return pd.DataFrame(columns, index=table.index)


def set_flags(flags: pd.DataFrame, name: str, rows: Ints, flag: Quality) -> None:
    """Give some rows of a channel a flag, in place."""
    column = flags[name].to_numpy(copy=True)
    column[rows] = flag
    flags[name] = column


@dataclass(frozen=True, slots=True)
class Wording:
    """The text for one kind of fault: a sentence filled in by :func:`_finding_of_stretches`, and what to do.

    ``estimate`` says which of its facts the figures of the finding are.
    """

    sentence: str
    remedy: str
    estimate: Mapping[str, str] = field(default_factory=lambda: {"count": "count", "largest": "size"})


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
    "marked_suspect": Wording(
        "{who} has {samples} that came marked as suspect, the first at {first}: their source calls them estimated,"
        " entered by hand or simulated, or their stamps may be late",
        "Do not take them for measured; the recorder's events name the source",
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


def utc_timestamp(time_ns: int) -> pd.Timestamp:
    """A time [ns since 1970] as UTC."""
    return pd.Timestamp(time_ns, unit="ns", tz="UTC")


def findings_of_code(
    code: str, stretches_by_channel: StretchesByChannel, channels: Mapping[str, ship.Channel]
) -> list[Finding]:
    """Findings of one code: what all ``channels`` have in common once, the rest by channel."""
    common: set[tuple[int, int]] = set()
    if len(stretches_by_channel) == len(channels) > 1:
        common = set.intersection(
            *(
                {(stretch.start_ns, stretch.end_ns) for stretch in stretches}
                for stretches in stretches_by_channel.values()
            )
        )
    findings = []
    if common:
        first = next(iter(stretches_by_channel.values()))
        together = [stretch for stretch in first if (stretch.start_ns, stretch.end_ns) in common]
        findings.append(_finding_of_stretches(code, ALL, "", together))
    for name, stretches in stretches_by_channel.items():
        separate = [stretch for stretch in stretches if (stretch.start_ns, stretch.end_ns) not in common]
        if separate:
            findings.append(_finding_of_stretches(code, name, channels[name].unit, separate))
    return findings


def _finding_of_stretches(code: str, channel: str, unit: str, stretches: list[series.Stretch]) -> Finding:
    wording, largest = WORDING[code], max(stretches, key=lambda stretch: (abs(stretch.size), -stretch.start_ns))
    start_ns, end_ns = min(stretches).start_ns, max(stretch.end_ns for stretch in stretches)
    count, samples = len(stretches), sum(stretch.size for stretch in stretches)
    facts: dict[str, Any] = {
        "who": "every channel" if channel == ALL else channel,
        "unit": unit,
        "times": "once" if count == 1 else "twice" if count == 2 else f"{count} times",
        "samples": "1 sample" if samples == 1 else f"{samples:,.0f} samples",
        "count": float(count),
        "total": samples,
        "size": abs(largest.size),
        "seconds": largest.seconds,
        "at": f"{utc_timestamp(largest.start_ns):%H:%M:%S}",
        "first": f"{utc_timestamp(start_ns):%H:%M:%S}",
    }
    estimate = {key: facts[fact] for key, fact in wording.estimate.items()}
    text = wording.sentence.format_map(facts)
    return Finding(
        code,
        channel,
        utc_timestamp(start_ns),
        utc_timestamp(end_ns),
        text,
        wording.remedy,
        estimate,
        code in CERTAIN,
    )
