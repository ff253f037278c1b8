"""A programme as it is sailed: which run is next, what became of those before, and the state on disk.

The state is written whole after every change of it, so that a restart goes on in the middle of a run: the file has
all runs with their verdicts, and of the one that is being sailed the orders and calls up to then.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import inf, isfinite, nan
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pandas as pd

from seatrial.acquisition.config.run_sheet import Conditions
from seatrial.acquisition.core.errors import InputError, StorageError
from seatrial.acquisition.core.files import read_json, write_text
from seatrial.acquisition.core.ship import wrap_360
from seatrial.analysis.conduct import run as runs
from seatrial.analysis.conduct.outlook import Outlook, RunOutlook, predicted_words
from seatrial.analysis.conduct.programme import PlannedRun, TrialProgramme, proposed_heading
from seatrial.analysis.manoeuvres import conducted, criteria, indices
from seatrial.analysis.tables.table import NANO

Outcome = Literal["valid", "invalid", "aborted", "skipped"]
ENDING = ".sailed.json"
"""The ending of the file that a programme's state is in, beside it."""
_VERSION = 3
_READ_VERSIONS = (2, 3)  # the second had no names of recordings, without which the outlook leaves its runs out
_ANEW = "move it away to begin the programme anew"
_REORDERED = f"add runs at the end only, and skip with the key s what is not wanted; or {_ANEW}"
_WIND_MEMORY = 0.002  # of a new value of the wind, in the running mean by which headings are proposed


@dataclass(frozen=True, slots=True)
class SailedRun:
    """A run that was sailed or skipped: its number, the place of the planned one, and what became of it. What was
    before ``earliest_ns`` belongs to another run; ``recordings`` are the files that were written meanwhile."""

    number: int
    place: int
    name: str
    outcome: Outcome
    executed_ns: int = 0
    ended_ns: int = 0
    verdict: runs.RunVerdict | None = None
    notes: tuple[str, ...] = ()
    earliest_ns: int = 0
    recordings: tuple[str, ...] = ()

    @property
    def manoeuvre(self) -> indices.Manoeuvre | None:
        """What was found of it, None where nothing was."""
        return self.verdict.manoeuvre if self.verdict else None

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why it is not valid."""
        return self.verdict.reasons if self.verdict else ()

    def as_json(self) -> dict[str, Any]:
        """As plain values."""
        return {
            "number": self.number, "place": self.place, "name": self.name, "outcome": self.outcome,
            "executed_ns": self.executed_ns, "ended_ns": self.ended_ns, "earliest_ns": self.earliest_ns,
            "recordings": list(self.recordings), "notes": list(self.notes),
            "verdict": self.verdict.as_json() if self.verdict else None,
        }  # fmt: skip

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> SailedRun:
        """The inverse of :meth:`as_json`."""
        verdict = content["verdict"]
        lists = {name: tuple(content.get(name, ())) for name in ("notes", "recordings")}
        return cls(**{**content, **lists, "verdict": runs.RunVerdict.from_json(verdict) if verdict else None})


@dataclass(slots=True)
class Conductor:
    """A programme while it is sailed.

    ``sailed`` are the runs so far, ``place`` that of the planned run that is next or being sailed, None where none
    is left, and ``state`` its state. ``path`` is the file of the state, None to keep it in memory. ``marks`` are
    texts for the recording that have not been taken yet, ``recordings`` its files since the run before. ``outlook``
    is what the runs so far say of the others, None where no model does; it is not in the file. ``unsaved`` is why
    the file could not be written, else empty.
    """

    programme: TrialProgramme
    path: Path | None = None
    sailed: list[SailedRun] = field(default_factory=list)
    place: int | None = None
    heading_deg: float | None = None
    state: runs.RunState = field(default_factory=runs.RunState)
    notes: list[str] = field(default_factory=list)
    marks: list[str] = field(default_factory=list)
    started_ns: int = 0
    wind: complex = complex(nan, nan)
    outlook: Outlook | None = None
    unsaved: str = ""
    recordings: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        if self.path is not None and self.path.exists():
            self._load(self.path)
        elif self.place is None:
            self._choose()

    @property
    def number(self) -> int:
        """The number of the run that is next or being sailed, from 1."""
        return len(self.sailed) + 1

    @property
    def run(self) -> PlannedRun | None:
        """The planned run that is next or being sailed, with its heading."""
        if self.place is None:
            return None
        planned = self.programme.run[self.place]
        return replace(planned, heading_deg=self.heading_deg) if self.heading_deg is not None else planned

    @property
    def last(self) -> SailedRun | None:
        """The run before."""
        return self.sailed[-1] if self.sailed else None

    @property
    def _planned(self) -> list[str]:
        return [run.sided_name for run in self.programme.run]

    @property
    def remaining(self) -> dict[int, int]:
        """By place how many valid runs are wanted still."""
        wanted = {}
        for place, planned in enumerate(self.programme.run):
            done = [run for run in self.sailed if run.place == place]
            count = planned.repeats - sum(run.outcome == "valid" for run in done)
            if count > 0 and not any(run.outcome == "skipped" for run in done):
                wanted[place] = count
        return wanted

    def judged_span_of(self, entry: SailedRun) -> conducted.JudgedSpan:
        """The part of the recording that a run which was ordered is judged by."""
        state = runs.RunState(
            orders_ns=(entry.executed_ns,), ended_ns=entry.ended_ns, earliest_ns=entry.earliest_ns
        )
        return runs.judged_span(state, self.programme.run[entry.place], self.programme)

    @property
    def is_waiting_for_verdict(self) -> bool:
        """Whether the run has ended and is not judged yet."""
        return self.state.phase == "ended"

    def advance(self, instant: runs.Instant) -> tuple[runs.Call, ...]:
        """Take an instant in; what is called. The state is saved when it changes by more than that."""
        self.started_ns = self.started_ns or instant.time_ns
        self._follow_wind(instant)
        if self.run is None:
            return ()
        before = self.state
        self.state, calls = runs.advance(before, instant, self.run, self.programme)
        if self.state.phase == "sailing" and before.phase == "approach":
            wind = (
                f", wind {abs(self.wind):.1f} m/s from {self._wind_from_deg:03.0f}"
                if isfinite(abs(self.wind))
                else ""
            )
            self.marks.append(
                f"run {self.number}: {self.run.sided_name} ordered, approach {instant.speed_mps:.2f} m/s{wind}"
            )
        if self.state.phase == "ended" and before.phase != "ended":
            self.marks.append(f"run {self.number}: over")
        if (before.phase, before.orders_ns, before.calls_ns, before.faults) != (
            self.state.phase, self.state.orders_ns, self.state.calls_ns, self.state.faults
        ):  # fmt: skip
            self.save()
        return calls

    @property
    def _wind_from_deg(self) -> float:
        return float(wrap_360(np.rad2deg(np.angle(self.wind))))

    def _follow_wind(self, instant: runs.Instant) -> None:
        wind = instant.wind_mps * np.exp(1j * np.deg2rad(instant.wind_from_deg))
        if isfinite(abs(wind)):
            self.wind = wind if not isfinite(abs(self.wind)) else self.wind + _WIND_MEMORY * (wind - self.wind)

    def verdict_is_due(self, now_ns: int) -> bool:
        """Whether what the judgement takes of the time after the run has been recorded."""
        return self.is_waiting_for_verdict and now_ns >= self.state.ended_ns + round(conducted.MARGIN_S * NANO)

    def judge(self, table: pd.DataFrame, stated: Conditions | None = None) -> SailedRun:
        """Judge the run that has ended, by the samples recorded of it, and choose the next."""
        run = self.run
        assert run is not None
        verdict = runs.judge_run(table, self.state, run, self.programme, stated)
        return self._finish("valid" if verdict.valid else "invalid", verdict)

    def leave_unjudged(self, why: str) -> SailedRun:
        """Call the run that has ended invalid, as it cannot be judged."""
        return self._finish("invalid", runs.RunVerdict(False, (*self.state.faults, f"it cannot be judged: {why}")))

    def abort(self, reason: str = "aborted") -> SailedRun | None:
        """Give up the run that is approached or sailed; it stays wanted. None where none is."""
        if self.run is None:
            return None
        self.state = runs.abort(self.state, reason)
        return self._finish("aborted", runs.RunVerdict(False, self.state.faults))

    def skip(self) -> SailedRun | None:
        """Leave the run out, with what was predicted of one that is not needed. None where there is no run."""
        if self.run is None or self.place is None:
            return None
        outlook, length_m = self._outlook_of(self.place), self.programme.programme.length_m
        predicted = f"predicted are {predicted_words(outlook, length_m)}" if outlook.is_needless(self.run) else ""
        if self.state.phase == "sailing":
            self.state = runs.abort(self.state, "skipped")
        return self._finish("skipped", runs.RunVerdict(False, (predicted,)) if predicted else None)

    def break_off(self, reason: str) -> None:
        """End a run that is being sailed; it is to be judged then."""
        before, self.state = self.state, runs.break_off(self.state, reason)
        if self.state is not before:
            self.marks.append(f"run {self.number}: over")

    def set_clock(self, by_ns: int) -> None:
        """Go on by another clock, which is ahead of the one before."""
        self.state = runs.RunState(swinging=self.state.swinging)
        self.started_ns = self.started_ns and self.started_ns + by_ns
        self.recordings = []  # the same time may be in those before
        self.save()

    def follow(self, recording: Path) -> None:
        """Note the file that is written now."""
        if str(recording) not in self.recordings:
            self.recordings.append(str(recording))
            self.save()

    def wait_for_approach(self) -> None:
        """Take back the order of a run that was given before anyone was led: its manoeuvre is not judged."""
        if self.state.newest is not None:
            self.state = replace(runs.state_since(self.state, self.state.newest.time_ns), is_unled=True)
            self.marks.clear()
            self.save()

    def repeat(self) -> bool:
        """Sail the run before again, next. Whether there is one."""
        if self.last is None or self.state.phase != "approach":
            return False
        self.place, self.state = self.last.place, runs.RunState(swinging=self.state.swinging)
        self.heading_deg = self._with_heading(self.place).heading_deg
        self.save()
        return True

    def note(self, text: str) -> None:
        """Keep a note with the run; it goes into the recording, too."""
        self.notes.append(text)
        self.marks.append(f"run {self.number}: note: {text}")
        self.save()

    def _finish(self, outcome: Outcome, verdict: runs.RunVerdict | None) -> SailedRun:
        assert self.place is not None
        entry = SailedRun(
            self.number, self.place, self.programme.run[self.place].sided_name, outcome, self.state.executed_ns,
            self.state.ended_ns, verdict, tuple(self.notes), self.state.earliest_ns, tuple(self.recordings),
        )  # fmt: skip
        self.marks.append(self._outcome_mark(entry))
        self.sailed.append(entry)
        self.notes, self.recordings = [], self.recordings[-1:]
        self.state = runs.state_for_next_run(self.state)
        self._choose()
        self.save()
        return entry

    def _outcome_mark(self, entry: SailedRun) -> str:
        """The mark of what became of a run."""
        ordered, over = (pd.Timestamp(at_ns, unit="ns", tz="UTC") if entry.executed_ns and at_ns else None
                         for at_ns in (entry.executed_ns, entry.ended_ns))  # fmt: skip
        reasons = tuple(reason for reason in entry.reasons if reason != entry.outcome)
        return conducted.ConductedRun(
            entry.number,
            entry.name,
            entry.outcome,
            ordered,
            over,
            self.judged_span_of(entry) if entry.manoeuvre else None,
            reasons,
        ).mark()

    def _choose(self) -> None:
        """Choose the run that is next: one that need not be sailed after all others, of the first priority the one
        with the least time before it, or of those for coefficients the one that tells most of them for its time."""
        last = self.programme.run[self.last.place] if self.last else None
        self.place = min(self.remaining, key=lambda place: self._cost(place, last), default=None)
        self.heading_deg = None if self.place is None else self._with_heading(self.place).heading_deg

    def _cost(self, place: int, last: PlannedRun | None) -> tuple[bool, int, float, int]:
        """By what a run comes later than others, after the ``last`` one."""
        planned, outlook = self._with_heading(place), self._outlook_of(place)
        minutes = self.programme.minutes_between(last, planned)
        if outlook.gain > 0.0 and not criteria.NAMES.intersection(planned.purpose):
            minutes = (minutes + self.programme.minutes_of(planned)) / outlook.gain
        return outlook.is_needless(planned), planned.priority, minutes, place

    def _outlook_of(self, place: int) -> RunOutlook:
        return (self.outlook.runs if self.outlook else {}).get(place, RunOutlook())

    def take_outlook(self, outlook: Outlook) -> None:
        """Take an outlook; another run is next where the one that is approached turns out not to be needed."""
        self.outlook = outlook
        if self.run is not None and self.place is not None and self.state.phase == "approach":
            wanted_again = self.last is not None and self.last.place == self.place  # by the key, or invalid before
            if self._outlook_of(self.place).is_needless(self.run) and not wanted_again:
                self._choose()
                self.save()

    @property
    def wanted_outlook(self) -> Outlook | None:
        """The outlook on the runs that are wanted still: one may have been skipped since it was made."""
        if self.outlook is None:
            return None
        wanted = self.remaining
        runs_wanted = {place: run for place, run in self.outlook.runs.items() if place in wanted}
        return replace(self.outlook, runs=runs_wanted)

    def _with_heading(self, place: int) -> PlannedRun:
        """A planned run with its heading: as stated, else into the wind that is expected or measured; every second
        speed run of a pair on the reciprocal course."""
        planned = self.programme.run[place]
        if planned.heading_deg is None:
            wind = self.programme.into_deg
            wind = self._wind_from_deg if wind is None and isfinite(abs(self.wind)) else wind
            heading = None if wind is None else proposed_heading(self.programme, planned, float(round(wind) % 360))
            planned = replace(planned, heading_deg=heading)
        sailed = sum(run.place == place and run.outcome == "valid" for run in self.sailed)
        if planned.kind == "speed_run" and planned.heading_deg is not None and sailed % 2:
            planned = replace(planned, heading_deg=float(wrap_360(planned.heading_deg + 180.0)))
        return planned

    def minutes_left(self, now_ns: int) -> float:
        """What is left of the time that there is [min], infinite where that is not stated."""
        total = self.programme.programme.minutes
        return inf if total is None else total - (now_ns - (self.started_ns or now_ns)) / NANO / 60.0

    @property
    def minutes_needed(self) -> float:
        """How long the runs that are wanted still take, with the ways between [min]."""
        last = self.programme.run[self.last.place] if self.last else None
        minutes = 0.0
        for place, count in self.remaining.items():
            planned = self.programme.run[place]
            for _ in range(count):
                minutes += self.programme.minutes_between(last, planned) + self.programme.minutes_of(planned)
                last = planned
        return minutes

    @property
    def criteria(self) -> list[criteria.CriterionResult]:
        """What the valid runs show of each criterion of IMO's standards."""
        valid = [run.manoeuvre for run in self.sailed if run.outcome == "valid" and run.manoeuvre]
        return criteria.criterion_results(criteria.index_rows(valid))

    def runs_within(self, minutes: float) -> list[PlannedRun]:
        """The runs that are wanted still and fit into a time, in the order in which they would be sailed."""
        fitting, last = list[PlannedRun](), self.programme.run[self.last.place] if self.last else None
        ahead = sorted(self.remaining, key=lambda place: (place != self.place, self._cost(place, last)))
        for planned in (self.programme.run[place] for place in ahead):
            minutes -= self.programme.minutes_between(last, planned) + self.programme.minutes_of(planned)
            if minutes < 0.0:
                break
            fitting.append(planned)
            last = planned
        return fitting

    def repeat_advice(self, entry: SailedRun) -> str:
        """Whether a run is worth its minutes once more."""
        planned = self.programme.run[entry.place]
        minutes = self.programme.minutes_of(planned) + self.programme.minutes_between(planned, planned)
        if entry.outcome != "valid":
            if entry.place in self.remaining and self._outlook_of(entry.place).is_needless(planned):
                return f"still wanted ({minutes:.0f} min), though it need not be sailed again"
            return f"sail it again: {minutes:.0f} min" if entry.place in self.remaining else "not wanted any more"
        open_ = [name for name, index in (entry.manoeuvre.indices if entry.manoeuvre else {}).items()
                 if index.result == criteria.CANNOT_BE_SAID]  # fmt: skip
        if open_:
            return f"a repeat ({minutes:.0f} min) would narrow {open_[0]}: its interval holds the limit"
        return "no repeat needed"

    def as_dict(self) -> dict[str, Any]:
        """What was sailed and what the trial shows, for JSON."""
        return {
            "programme": self.programme.programme.name, "sailed": [run.as_json() for run in self.sailed],
            "remaining": [self.programme.run[place].sided_name for place in self.remaining],
            "minutes_needed": round(self.minutes_needed, 1),
            "outlook": None if self.outlook is None else self.outlook.as_json(),
            "criteria": [entry.as_json() for entry in self.criteria],
        }  # fmt: skip

    def save(self) -> None:
        """Write the state to its file, whole or not at all; where it cannot be, ``unsaved`` says why, and the run
        goes on."""
        if self.path is None:
            return
        content = {
            "version": _VERSION, "programme": self.programme.programme.name, "runs": self._planned,
            "started_ns": self.started_ns, "place": self.place, "heading_deg": self.heading_deg,
            "marks": self.marks, "notes": self.notes, "recordings": self.recordings,
            "state": self.state.as_json(),
            "sailed": [run.as_json() for run in self.sailed],
        }  # fmt: skip
        try:
            write_text(self.path, json.dumps(content, indent=1))
            self.unsaved = ""
        except StorageError as error:
            self.unsaved = str(error)

    def _load(self, path: Path) -> None:
        """Go on from a file. Raises :class:`InputError` for one that is no state of this programme."""
        try:
            content = read_json(path)
            version, name, planned = content["version"], content["programme"], list(content["runs"])
            _require_version(version, path)
            sailed = [SailedRun.from_json(run) for run in content["sailed"]]
            state = runs.RunState.from_json(content["state"])
            place, heading_deg = content["place"], content["heading_deg"]
            started_ns, recordings = content["started_ns"], list(content.get("recordings", ()))
            notes, marks = list(content["notes"]), list(content["marks"])
        except InputError:  # of another version
            raise
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            raise InputError("holds no state of a programme", where=str(path), why=str(error), fix=_ANEW) from error
        if name != self.programme.programme.name:
            why = f"it is of {name!r}"
            raise InputError("holds the state of another programme", where=str(path), why=why, fix=_ANEW)
        for number, run in enumerate(planned, 1):
            if self._planned[number - 1 : number] != [run]:
                why = f"its {number}. run is {run}, which the programme does not have there"
                raise InputError("holds the state of another programme", where=str(path), why=why, fix=_REORDERED)
        self.sailed, self.state, self.notes, self.marks = sailed, state, notes, marks
        self.place, self.heading_deg, self.started_ns, self.recordings = place, heading_deg, started_ns, recordings
        if self.place is None:  # all was sailed, and runs may have been added
            self._choose()


def _require_version(version: Any, path: Path) -> None:
    if version not in _READ_VERSIONS:
        raise InputError(
            "holds a state by another Seatrial", where=str(path),
            why=f"it is of version {version}, and read are {' and '.join(map(str, _READ_VERSIONS))}",
            fix=f"end the programme with the Seatrial that began it, or {_ANEW}",
        )  # fmt: skip


def state_path(programme: Path) -> Path:
    """The file of a programme's state."""
    return programme.with_suffix(ENDING)
