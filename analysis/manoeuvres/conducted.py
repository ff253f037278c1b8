"""What became of the runs that `seatrial conduct` led, as its marks in a recording state it, and what counts.

Without it a run that was called invalid aboard would show criteria ashore. :meth:`ConductedRun.mark` writes what
:func:`conducted_runs` reads. Of the manoeuvres of a programme those count that were judged as its valid runs; what
was sailed before the first and after the last of its runs counts as in a recording without a programme.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from operator import itemgetter
from typing import Any, NamedTuple

import pandas as pd

from seatrial.analysis.manoeuvres.indices import Manoeuvre
from seatrial.analysis.tables.table import utc_index

SAME_START_S = 30.0
"""How far a manoeuvre may begin from the order of its run [s]."""
MARGIN_S = 25.0
"""How much of the recording after a run its judgement takes [s]: what its smoothing reaches."""
_LEAST_CLOCK_STEP, _SAME_CLOCK_STEP = pd.Timedelta(seconds=60.0), pd.Timedelta(seconds=10.0)
BETWEEN_RUNS = "no run of the programme"
_MARK = re.compile(r"run (\d+): (.*)", re.S)
_VERDICT = re.compile(
    r"(?P<outcome>valid|invalid|aborted|skipped)"
    r"(?:, (?P<name>(?!ordered at |over at |judged as ).*?))?"
    r"(?:, ordered at (?P<ordered>\S+))?(?:, over at (?P<over>\S+))?"
    r"(?:, judged as (?P<kind>[a-z_]+) from (?P<start>\S+) to (?P<end>\S+))?(?:: (?P<reasons>.*))?",
    re.S,
)
_ORDERED = re.compile(r"(.*) ordered, approach .*", re.S)
_NOTE = "note: "
_BETWEEN_REASONS = "; "


class JudgedSpan(NamedTuple):
    """The part of a recording, ends included, that a run of a kind was judged by aboard."""

    kind: str
    start: pd.Timestamp
    end: pd.Timestamp

    def rows_of(self, table: pd.DataFrame) -> pd.DataFrame:
        """Its rows of a table."""
        times = utc_index(table)
        return table[(times >= self.start) & (times <= self.end)]


@dataclass(frozen=True, slots=True)
class ConductedRun:
    """A run of a programme, by its number: ``outcome`` is valid, invalid, aborted, skipped, or empty where the
    recording has no verdict on it.

    ``ordered`` and ``over`` are the times of its first order and of its end, None where there was none. It was
    ``judged`` by that part of the recording in which a manoeuvre was found. ``reasons`` are why it is not valid.
    ``marked`` are the times of its first and last mark.
    """

    number: int
    name: str = ""
    outcome: str = ""
    ordered: pd.Timestamp | None = None
    over: pd.Timestamp | None = None
    judged: JudgedSpan | None = None
    reasons: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    marked: tuple[pd.Timestamp, pd.Timestamp] | None = None

    def mark(self) -> str:
        """The words of the mark that states its outcome.

        >>> ConductedRun(3, "zigzag 10/10 to port", "aborted", reasons=("traffic",)).mark()
        'run 3: aborted, zigzag 10/10 to port: traffic'
        """
        parts = [f"run {self.number}: {self.outcome}", self.name]
        if self.ordered is not None:
            parts.append(f"ordered at {self.ordered.isoformat(timespec='milliseconds')}")
        if self.judged is not None:
            start, end = self.judged.start.isoformat(), self.judged.end.isoformat()
            parts.append(f"judged as {self.judged.kind} from {start} to {end}")
        elif self.over is not None:
            parts.append(f"over at {self.over.isoformat(timespec='milliseconds')}")
        return ", ".join(filter(None, parts)) + ": " * bool(self.reasons) + _BETWEEN_REASONS.join(self.reasons)

    @property
    def span(self) -> tuple[pd.Timestamp, pd.Timestamp] | None:
        """The time in which a manoeuvre of it begins, None where none was ordered or it has no verdict."""
        end = self.judged.end - pd.Timedelta(seconds=MARGIN_S) if self.judged else self.over
        if self.ordered is None or end is None or not self.outcome:
            return None
        return self.ordered - pd.Timedelta(seconds=SAME_START_S), end

    @property
    def is_speed_run(self) -> bool:
        """Whether it is a speed run, by what was judged, else by its name."""
        return (self.judged.kind if self.judged else self.name.replace(" ", "_")) == "speed_run"

    @property
    def why_not_counted(self) -> str:
        """Its number, outcome and reasons; empty for a valid run."""
        why = ": " * bool(self.reasons) + _BETWEEN_REASONS.join(self.reasons)
        return "" if self.outcome == "valid" else f"run {self.number} was {self.outcome}{why}"

    @property
    def time(self) -> pd.Timestamp | None:
        """When it was ordered, without an order when it was first marked."""
        return self.ordered or (self.marked[0] if self.marked else None)

    def as_json(self) -> dict[str, Any]:
        """With the keys of the contract."""
        return {
            "number": self.number, "name": self.name, "outcome": self.outcome,
            "time": self.time.isoformat() if self.time is not None else None,
            "ordered": self.ordered.isoformat() if self.ordered is not None else None,
            "judged_from": self.judged.start.isoformat() if self.judged else None,
            "judged_to": self.judged.end.isoformat() if self.judged else None,
            "reasons": list(self.reasons), "notes": list(self.notes),
        }  # fmt: skip


def conducted_runs(events: Iterable[tuple[int, str]]) -> tuple[ConductedRun, ...]:
    """The runs that the marks among some events (time [ns since 1970], text) state, in order of their marks.

    >>> runs = conducted_runs([(0, "run 1: zigzag 10/10 to port ordered, approach 5 m/s"), (9, "run 1: aborted")])
    >>> [(run.number, run.name, run.outcome) for run in runs]
    [(1, 'zigzag 10/10 to port', 'aborted')]
    """
    runs = list[ConductedRun]()
    for time_ns, text in sorted(events, key=itemgetter(0)):
        mark = _MARK.fullmatch(text)
        verdict, order = (pattern.fullmatch(mark[2] if mark else "") for pattern in (_VERDICT, _ORDERED))
        is_note = mark is not None and mark[2].startswith(_NOTE)
        if mark is None or not (verdict or order or is_note or mark[2] == "over"):
            continue
        number, time = int(mark[1]), pd.Timestamp(time_ns, unit="ns", tz="UTC")
        unended = [place for place, run in enumerate(runs)
                   if run.number == number and not (run.outcome or (order and run.ordered))]  # fmt: skip
        place = unended[-1] if unended else len(runs)
        run = runs[place] if unended else ConductedRun(number)
        run = replace(run, marked=(run.marked[0] if run.marked else time, time))
        if is_note:
            run = replace(run, notes=(*run.notes, mark[2].removeprefix(_NOTE)))
        elif verdict:
            run = _with_outcome(run, verdict, run.over or time)
        elif order:
            run = replace(run, name=order[1], ordered=time)
        else:
            run = replace(run, over=time)
        runs[place : place + 1] = [run]
    return tuple(runs)


def _with_outcome(run: ConductedRun, words: re.Match[str], marked_end: pd.Timestamp) -> ConductedRun:
    """The run with what the mark of its outcome states; a time that is none is passed over.

    Where a clock was set after the run, the times of recording and marks are by the new one, those in words by the
    old one: an order marked at 10:00 and stated as 09:00, an end (``marked_end``) marked at 10:12 and stated as
    09:12. Where both differ alike, all stated times are moved to the new clock.
    """
    times = dict[str, pd.Timestamp]()
    for name in ("ordered", "over", "start", "end"):
        with suppress(ValueError, TypeError):
            if words[name]:
                times[name] = pd.Timestamp(words[name]).tz_convert("UTC")
    stated_end = times["end"] - pd.Timedelta(seconds=MARGIN_S) if "end" in times else times.get("over")
    if run.ordered is not None and "ordered" in times and stated_end is not None:
        set_by, set_by_at_order = marked_end - stated_end, run.ordered - times["ordered"]
        difference = abs(set_by - set_by_at_order)
        if abs(set_by) > _LEAST_CLOCK_STEP and difference < min(
            _SAME_CLOCK_STEP, 0.5 * (stated_end - times["ordered"])
        ):
            times = {name: time + set_by for name, time in times.items()}
    judged = JudgedSpan(words["kind"], times["start"], times["end"]) if {"start", "end"} <= set(times) else None
    return replace(
        run, outcome=words["outcome"], name=words["name"] or run.name, judged=judged,
        ordered=times.get("ordered", run.ordered), over=times.get("over"),
        reasons=tuple((words["reasons"] or "").split(_BETWEEN_REASONS)) if words["reasons"] else (),
    )  # fmt: skip


def is_mark_of_run(text: str) -> bool:
    """Whether an event is a mark of a conducted run, which says nothing to what the crew marks otherwise."""
    return bool(conducted_runs([(0, text)]))


def exclude_uncounted(
    manoeuvres: Iterable[Manoeuvre], runs: Sequence[ConductedRun], elsewhere: Sequence[ConductedRun] = ()
) -> list[Manoeuvre]:
    """The manoeuvres of a recording, those that do not count as valid runs of its programme with the reason.

    ``elsewhere`` are the runs of other recordings of the trial, in one of which a run may have ended.
    """
    found, conducted = list(manoeuvres), (*runs, *elsewhere)
    valid = [_manoeuvre_of_run(run, found) for run in conducted if run.span and run.outcome == "valid"]
    counted = [any(manoeuvre is run for run in valid) for manoeuvre in found]
    return [replace(manoeuvre, not_counted="" if is_counted else uncounted_reason(manoeuvre.start, runs, elsewhere))
            for manoeuvre, is_counted in zip(found, counted, strict=True)]  # fmt: skip


def uncounted_reason(
    start: pd.Timestamp, runs: Sequence[ConductedRun], elsewhere: Sequence[ConductedRun] = ()
) -> str:
    """Why what began at a time, and is not what a valid run was judged by, does not count; empty before and after
    the programme. ``elsewhere`` is as in :func:`exclude_uncounted`."""
    ended = [(run, *run.span) for run in (*runs, *elsewhere) if run.span]
    during = [run for run, begin, end in ended if begin <= start <= end]
    periods = [*_programme_periods(runs), *((begin, end) for _, begin, end in ended)]
    between = BETWEEN_RUNS if any(begin <= start <= end for begin, end in periods) else ""
    return (during[-1].why_not_counted if during else "") or between


def _manoeuvre_of_run(run: ConductedRun, manoeuvres: Sequence[Manoeuvre]) -> Manoeuvre | None:
    """What was judged as a run: of its kind, in its part of the recording, nearest to its order."""
    if run.judged is None:
        return None
    _, start, end = run.judged
    alike = [entry for entry in manoeuvres if entry.kind == run.judged.kind and start <= entry.start <= end]
    return min(alike, key=lambda entry: abs(entry.start - (run.ordered or start)), default=None)


def _programme_periods(runs: Sequence[ConductedRun]) -> list[tuple[pd.Timestamp, pd.Timestamp]]:
    """The time of each programme, from the first order to the last verdict on an ordered run; a number that does
    not rise begins another programme."""
    periods, last = list[tuple[pd.Timestamp, pd.Timestamp]](), 0
    for run in runs:
        if run.span is None or run.marked is None:
            continue
        if not periods or run.number <= last:
            periods.append(run.span)
        periods[-1], last = (periods[-1][0], max(periods[-1][1], run.span[1], run.marked[1])), run.number
    return periods
