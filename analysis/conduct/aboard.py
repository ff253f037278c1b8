"""``seatrial conduct``: the conductor beside a running recorder, at a terminal and on a page for the bridge.

The samples come from the recording while it is written, as those of the twin do, and marks go into it as those of a
person do; nothing here can hold up the recorder. The page is read only. A page from elsewhere is not answered
(:class:`seatrial.acquisition.logger.requests.WebFront`).
"""

from __future__ import annotations

import base64
import hashlib
import re
import socket
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from http import HTTPStatus
from math import inf, isfinite, nan
from pathlib import Path
from typing import Any

import numpy as np
import orjson
import pandas as pd
from rich.console import Console, ConsoleOptions, RenderableType
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from seatrial.acquisition.config.run_sheet import conditions_in_trial
from seatrial.acquisition.core import errors, ship
from seatrial.acquisition.core.files import lock_output_file
from seatrial.acquisition.core.process import keys_taken
from seatrial.acquisition.core.quantities import Series
from seatrial.acquisition.core.trial import Quality
from seatrial.acquisition.logger import health, requests
from seatrial.acquisition.recording import reader
from seatrial.analysis.conduct import outlook
from seatrial.analysis.conduct import run as runs
from seatrial.analysis.conduct.conductor import Conductor, SailedRun
from seatrial.analysis.conduct.programme import PlannedRun, TrialProgramme
from seatrial.analysis.manoeuvres import criteria
from seatrial.analysis.manoeuvres.conducted import JudgedSpan
from seatrial.analysis.tables.table import NANO

HISTORY_S = 3 * 3600.0
"""How much of the recording is read again after a restart, and kept for judging [s]."""
_POLL_S = 0.1
_INSTANT_S, _WITHOUT_HEADING_S = 0.2, 1.5  # between instants at least; after which one comes without a heading
_STALE_S = 10.0
_BACK_S, _BACK_AT_START_S = 10.0, 1.0  # by which a clock goes back; in a new recording
_SILENT_S = 3.0
_SHOWN_CALL_S = 4.0
_MARK_PERIOD_S = 2.0
_COUNTED_DOWN_S = 60.0
_SHOWN_INDICES = 4
_AGAIN_S = 10.0
_ALL_ADDRESSES = ("0.0.0.0", "::")
_UNLED = (
    "the ship is in a turn or a manoeuvre that began before it was followed: it is not judged; the next run begins "
    "from its approach"
)
_PAGE = (Path(__file__).parent / "bridge.html").read_text(encoding="utf-8")
_SCRIPT = re.search(r"<script>(.*?)</script>", _PAGE, re.DOTALL)
_DIGEST = base64.b64encode(hashlib.sha256((_SCRIPT[1] if _SCRIPT else "").encode()).digest()).decode()
_HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "default-src 'none'; style-src 'unsafe-inline'; connect-src 'self'; "
    f"script-src 'sha256-{_DIGEST}'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
}
_VALUES = {
    "heading": ("{:05.1f}\N{DEGREE SIGN}", "heading"),
    "turn \N{DEGREE SIGN}/min": ("{:+z.0f}", "yaw_rate"),
    "speed m/s": ("{:.2f}", "speed"),
    "helm": ("{:+z.0f}\N{DEGREE SIGN}", "helm"),
}
"""By what is shown of the motion its form, and its bar."""
KEYS = {"a": "abort", "s": "skip", "r": "repeat the run before", "n": "note"}
"""What the keys do."""
Notify = Callable[[str, str], None]


class InstantMaker:
    """Instants from samples as they come: one at each heading, at most five a second, with the newest values of the
    other channels; without headings one after a second and a half."""

    def __init__(self, actuators: ship.Actuators) -> None:
        self._actuators = actuators
        self._newest: dict[str, tuple[int, float]] = {}
        self._last_ns = 0

    def take(self, samples: Mapping[str, Series]) -> list[runs.Instant]:
        """The instants that some samples complete."""
        times, names, values = list[int](), list[str](), list[float]()
        for name, series in samples.items():
            valid = series.quality < Quality.BAD
            times += series.measured_ns[valid].tolist()
            values += series.value[valid].tolist()
            names += [name] * int(valid.sum())
        instants = []
        last = np.array([name == "heading_deg" for name in names], dtype=bool)  # with all else of its time
        for place in np.lexsort((last, np.array(times, dtype=np.int64))):
            time_ns, name = times[place], names[place]
            if time_ns >= self._newest.get(name, (0, 0.0))[0]:
                self._newest[name] = (time_ns, values[place])
            self._last_ns = self._last_ns or time_ns - round(_INSTANT_S * NANO)
            since_s = (time_ns - self._last_ns) / NANO
            if since_s >= (_INSTANT_S if name == "heading_deg" else _WITHOUT_HEADING_S):
                self._last_ns = time_ns
                instants.append(self._instant(time_ns))
        return instants

    def has(self, name: str) -> bool:
        """Whether there were values of a channel."""
        return name in self._newest

    def _instant(self, time_ns: int) -> runs.Instant:
        fresh = {name: value for name, (at_ns, value) in self._newest.items() if time_ns - at_ns <= _STALE_S * NANO}
        heading_ns, _ = self._newest.get("heading_deg", (0, nan))
        if time_ns - heading_ns > _INSTANT_S * NANO:
            fresh.pop("heading_deg", None)
        return runs.instant_of(time_ns, fresh, self._actuators)


class ConductedTrial:
    """A programme conducted beside the recorder of trial ``name``; to be closed. Call :meth:`poll` some ten times a
    second. ``maker`` makes the outlook of the runs so far, after each."""

    def __init__(
        self,
        name: str,
        configuration: Path,
        conductor: Conductor,
        notify: Notify,
        folder: Path | None = None,
        maker: outlook.OutlookMaker | None = None,
    ) -> None:
        self.conductor, self.last_call = conductor, runs.Call("", "", 0)
        self._notify, self._folder = notify, folder
        self.follower = requests.Follower(name, configuration, HISTORY_S, notify, folder)
        self._resumed = conductor.state.newest is not None or bool(conductor.sailed)
        self._maker: InstantMaker | None = None
        self._pieces: dict[str, list[Series]] = {}
        self._tables: dict[int, pd.DataFrame] = {}
        self._outlook_process = None if maker is None else outlook.OutlookProcess(maker)
        self._outlook_is_due, self._outlook_runs = bool(conductor.sailed), 0
        self.newest_ns, self._heard_s, self._marked_s = 0, time.monotonic(), -inf
        self._begun = requests.NewSamples()
        self._asked, self._unsaved, self._unled = ("", 0, -inf), "", False
        self._lines_of: tuple[int, int | None, int, outlook.Outlook | None] = (-1, None, 0, None)
        self._lines = list[tuple[str, str]]()

    def close(self) -> None:
        """Close the recording, and end the outlook that is being made."""
        self.follower.close()
        if self._outlook_process is not None:
            self._outlook_process.close()

    @property
    def unmeasured(self) -> list[str]:
        """What the run is followed and judged by and nothing comes of."""
        run, newest = self.conductor.run, self.conductor.state.newest
        if run is None or newest is None or self._maker is None:
            return []
        judged_by: dict[str, tuple[str, ...]] = {"the position": ("north_m",)}
        if conditions_in_trial(self.follower.trial).beaufort is None:
            judged_by["the wind"] = ("wind_speed_mps",)
        if self.conductor.programme.programme.least_depth_m:
            judged_by["the depth of the water"] = ("depth_below_transducer_m", "water_depth_m")
        missing = [name for name, channels in judged_by.items() if not any(map(self._maker.has, channels))]
        return [*runs.unmeasured_of_run(newest, run), *missing]

    @property
    def silent_s(self) -> float:
        """How long nothing has come [s]."""
        return time.monotonic() - self._heard_s

    def poll(self) -> list[runs.Call]:
        """Take in what was recorded since, judge a run that is over, send marks; what is called."""
        news, calls = self.follower.news(), list[runs.Call]()
        if news.restarted:
            self._read_recordings_before()
            self._begun, self._maker = news, None
        is_first = not self.newest_ns and not self._resumed  # whatever is in earlier parts is not of the programme
        for samples in news.samples[-1:] if is_first else news.samples:
            if by_ns := self._clock_step_ns(samples):
                self._set_clock(by_ns)
            self._store_samples(samples)
            calls += self._advance(samples)
        if self.follower.part_path is not None:
            self.conductor.follow(self.follower.part_path.absolute())
        for call in calls:
            self.last_call = call
            self._notify("info", f"run {self.conductor.number}: {call.kind}: {call.text}")
        if self.conductor.verdict_is_due(self.newest_ns):
            self._judge()
        if self._outlook_process is not None:
            self._follow_outlook(self._outlook_process)
        if self.conductor.unsaved != self._unsaved:
            self._unsaved = self.conductor.unsaved
            self._notify("warning", self._unsaved or "the state is saved again")
        if self.conductor.marks and time.monotonic() - self._marked_s >= _MARK_PERIOD_S:
            self._send_marks()
        return calls

    def _read_recordings_before(self) -> None:
        """After a restart, take in what the recordings before this one have of the run, and of its approach."""
        path, vessel = (self.follower.part_path or Path()).absolute(), self.follower.trial.vessel
        with suppress(errors.InputError, IndexError):
            vessel_before = reader.read_trial(Path(self.conductor.recordings[-1])).vessel
            if vessel_before != vessel:
                words = f"this recording is of the vessel {vessel!r}, the one before of {vessel_before!r}"
                self._notify("warning", f"{words}: name the configuration with --config, or a file for --state")
        before = [] if self.newest_ns else [part for part in map(Path, self.conductor.recordings)
                                            if part not in (path, *reader.parts_before(path))]  # fmt: skip
        for part in before:
            with suppress(errors.InputError), reader.Tail(part, HISTORY_S) as tail:  # one may be gone
                samples = tail.read_new_samples()
                self._store_samples(samples)
                self._advance(samples)

    def _clock_step_ns(self, samples: Mapping[str, Series]) -> int:
        """By how much the times of the recording went ahead, as its clock was set, or back; 0 for not at all."""
        newest, heading = self.conductor.state.newest, samples.get("heading_deg")
        if heading is None or not heading.measured_ns.size:
            return 0
        news, self._begun = self._begun, requests.NewSamples()
        if news.restarted and self.conductor.recordings:
            first_ns, before = int(heading.measured_ns.min()), Path(self.conductor.recordings[-1])
            return news.set_by_ns or self._clock_step_between_ns(before, first_ns)
        ahead_ns = int(heading.measured_ns[-1]) - newest.time_ns if newest else 0
        return ahead_ns if ahead_ns < -_BACK_S * NANO else 0

    def _clock_step_between_ns(self, before: Path, first_ns: int) -> int:
        """By how much the times of this recording, which begin at ``first_ns``, are ahead of those of the one
        before, as far as both state it, or back; 0 for the same recording.

        The clock may have been set while the computer was restarted: a recording that begins earlier than the one
        before ended shows it. One that begins much later may be by the same clock, or not: no run lasts over it.
        """
        path = (self.follower.part_path or Path()).absolute()
        if before in (path, *reader.parts_before(path)):
            return 0
        clock, clock_before = (
            reader.PartClock.from_metadata(reader.head_metadata(part)) for part in (path, before)
        )
        stated_ns, later_ns = clock.ahead_of_ns(clock_before) or 0, first_ns - (self.newest_ns or first_ns)
        if abs(stated_ns) >= reader.NEW_PART_NS:
            return stated_ns
        if (later_s := later_ns / NANO) < -_BACK_AT_START_S:
            return later_ns
        if later_s > runs.LONGEST_GAP_S:
            later = f"{later_s / 3600.0:.1f} h" if later_s >= 3600.0 else f"{later_s / 60.0:.0f} min"
            words = f"the recording begins {later} after the end of the one before"
            self._notify("warning", f"{words}: nothing was recorded, or the computer's clock was set")
            self.conductor.break_off(f"nothing was received, or the clock was set: {words}")
        return 0

    def _set_clock(self, by_ns: int) -> None:
        """Judge a run that is being sailed by what there is, and begin anew by another clock: by the old one the
        same time may come again."""
        conductor = self.conductor
        way = f"{'back' if by_ns < 0 else 'ahead'} by {abs(by_ns) / NANO:,.0f} s"
        self._notify("warning", f"the times of the recording went {way}: the approach is followed anew")
        conductor.break_off(f"the clock was set {way.partition(' ')[0]}: the run is broken")
        if conductor.is_waiting_for_verdict:
            self._judge()
        conductor.set_clock(by_ns)
        self._pieces.clear()
        self._maker, self.newest_ns, self._resumed = None, 0, True

    def _advance(self, samples: Mapping[str, Series]) -> list[runs.Call]:
        """What is called at the instants that some samples complete."""
        if self._maker is None:
            trial = self.follower.trial
            attributes = {"trial": {"vessel": trial.vessel, "actuators": trial.actuators}}
            self._maker = InstantMaker(ship.actuators_of_table(samples, attributes))
        conductor, instants, calls = self.conductor, self._maker.take(samples), list[runs.Call]()
        begins = bool(instants) and not self.newest_ns and not self._resumed
        if begins:  # what was before is not of the programme
            first_ns = instants[-1].time_ns - round(2.0 * conductor.programme.steady_s * NANO)
            instants = [instant for instant in instants if instant.time_ns >= first_ns]
        for instant in instants:
            self.newest_ns, self._heard_s = max(self.newest_ns, instant.time_ns), time.monotonic()
            calls += conductor.advance(instant)
        if begins and conductor.state.phase != "approach" and conductor.run and conductor.run.kind != "speed_run":
            conductor.wait_for_approach()
            calls.clear()
        if conductor.state.is_unled != self._unled:
            self._unled = conductor.state.is_unled
            if self._unled:
                self._notify("warning", _UNLED)
        return calls

    def _store_samples(self, samples: Mapping[str, Series]) -> None:
        """Keep samples for judging, those before the oldest that may be needed dropped."""
        for name, series in samples.items():
            pieces = self._pieces.setdefault(name, [])
            pieces.append(series)
            while pieces[0].measured_ns.size and pieces[0].measured_ns.max() < self.newest_ns - HISTORY_S * NANO:
                del pieces[0]

    def table_of(self, span: JudgedSpan) -> pd.DataFrame:
        """The samples of a part of the time. Raises :class:`DataShortageError` where nothing was recorded."""
        recording = reader.Recording(
            self.follower.part_path or Path(), self.follower.trial, {}, {}, [], 0, False, 0, self.newest_ns
        )
        return outlook.table_of_span(recording, self._pieces, span)

    def _judge(self) -> None:
        conductor = self.conductor
        assert conductor.run is not None
        try:
            table = self.table_of(runs.judged_span(conductor.state, conductor.run, conductor.programme))
        except errors.DataShortageError:  # nothing was recorded of it
            table = pd.DataFrame(index=pd.DatetimeIndex([], tz="UTC"))
        try:
            entry = conductor.judge(table, conditions_in_trial(self.follower.trial))
        except Exception as error:  # whatever it is, the programme goes on
            fault = errors.unexpected_error(error)
            entry = conductor.leave_unjudged(": ".join(filter(None, (fault.what, fault.why))))
        if len(table) and entry.executed_ns:
            self._tables[entry.number] = table
        self._notify("info" if entry.outcome == "valid" else "warning", outcome_line(entry))
        self._outlook_is_due = True

    def _follow_outlook(self, process: outlook.OutlookProcess) -> None:
        """Take an outlook that has been made, and begin the next where a run was judged since the last began."""
        made = process.result()
        if isinstance(made, outlook.Outlook):
            before = self.conductor.run
            self.conductor.take_outlook(made)
            if made.sailed < self._outlook_runs:
                words = "the recordings of the others cannot be read"
                self._notify("warning", f"the outlook is by {made.sailed} of {self._outlook_runs} runs: {words}")
            if self.conductor.run != before and before and self.conductor.run:
                instead = f"{self.conductor.run.sided_name} is next, {before.sided_name} comes last"
                self._notify("info", f"{instead}: it is predicted to meet its criteria")
        elif made is not None:
            self._notify("warning", f"no outlook on the runs that remain: {made}")
        if not self._outlook_is_due or process.is_working or not self.newest_ns:
            return
        self._outlook_is_due = False
        programme, sailed = self.conductor.programme, list[outlook.RecordedRun | outlook.StoredRun]()
        for entry in self.conductor.sailed:
            planned, valid = programme.run[entry.place], entry.outcome == "valid"
            if entry.number in self._tables:
                sailed.append(outlook.RecordedRun(planned, self._tables[entry.number], valid))
            elif entry.executed_ns and entry.recordings:
                paths = [Path(path) for path in entry.recordings]
                sailed.append(outlook.StoredRun(planned, paths, self.conductor.judged_span_of(entry), valid))
        if sailed and self.conductor.remaining:
            self._outlook_runs = len(sailed)
            process.begin(sailed, {place: programme.run[place] for place in self.conductor.remaining})

    def _send_marks(self) -> None:
        """Give the marks to the recorder; what it does not take waits for the next."""
        self._marked_s = time.monotonic()
        while self.conductor.marks:
            try:
                requests.send_mark(self.conductor.marks[0], self._folder)
            except errors.SourceError:
                return
            self.conductor.marks.pop(0)
            self.conductor.save()  # or a restart would send it again

    def last_lines(self) -> list[tuple[str, str]]:
        """What :func:`last_lines` gives, made anew where it changes: the picture is drawn ten times a second."""
        conductor = self.conductor
        minute = self.newest_ns // (60 * NANO)
        lines_of = len(conductor.sailed), conductor.place, minute, conductor.outlook
        if self._lines_of[:3] != lines_of[:3] or self._lines_of[3] is not lines_of[3]:
            self._lines_of, self._lines = lines_of, last_lines(conductor, self.newest_ns)
        return self._lines

    def key(self, key: str, note: str = "") -> None:
        """Do what a key says."""
        conductor = self.conductor
        if key in "as" and conductor.state.phase != "approach" and not self._is_asked_again(key):
            self._notify("warning", f"run {conductor.number} is being sailed: press {key} again to {KEYS[key]} it")
        elif key == "a":
            conductor.abort()
        elif key == "s":
            conductor.skip()
        elif key == "r" and not conductor.repeat():
            self._notify("warning", "no run to repeat: none was before, or this one has been ordered")
        elif key == "n" and note:
            conductor.note(note)

    def _is_asked_again(self, key: str) -> bool:
        """Whether a key is pressed for the second time in a run, shortly after the first."""
        before, self._asked = self._asked, (key, self.conductor.number, time.monotonic())
        return before[:2] == self._asked[:2] and self._asked[2] - before[2] < _AGAIN_S


def outcome_line(entry: SailedRun) -> str:
    """A run and what became of it."""
    reasons = "; ".join(reason for reason in entry.reasons if reason != entry.outcome)
    why = f": {reasons}" if reasons else ""
    return f"run {entry.number}, {entry.name}: {entry.outcome}{why}"


def index_lines(entry: SailedRun) -> list[str]:
    """The main indices of a run with their intervals and results."""
    run = entry.manoeuvre
    if run is None:
        return []
    lines, said = [], set[str]()
    for row in criteria.index_rows([run])[:_SHOWN_INDICES]:
        index = next(iter(row.sides.values())).index
        lengths = f" ({index.lengths:.2f} L)" if index.lengths else ""
        missing = index.missing[0] if index.result == criteria.NOT_SHOWN and index.missing else ""
        why = f", {missing}" if missing and missing not in said else ""  # once: it is the same for most
        said.add(missing)
        limit = f", limit {index.limit:.3g}: {index.result.replace('_', ' ')}{why}" if index.limit else ""
        half = 0.5 * (index.high - index.low)
        name = row.name.rpartition("_")[0].replace("_", " ")
        lines.append(f"{name} {index.value:.3g} ± {half:.2g} {index.unit}{lengths}{limit}")
    return lines


def picture_of(trial: ConductedTrial) -> dict[str, Any]:
    """What is shown at the terminal and on the page, as plain values."""
    conductor, state = trial.conductor, trial.conductor.state
    run = conductor.run
    silent, due_s = trial.silent_s > _SILENT_S, state.due_s
    now_s = due_s if not silent and isfinite(due_s) and 0.0 <= due_s <= _COUNTED_DOWN_S else None
    called_s = (trial.newest_ns - trial.last_call.due_ns) / NANO
    calling = state.phase != "approach" and -0.5 <= called_s < _SHOWN_CALL_S and trial.last_call.kind != "ready"
    if run is None:
        title, say = "no run is left", "PROGRAMME COMPLETE"
    else:
        heading = "" if run.heading_deg is None else f" on {run.heading_deg:03.0f}°"
        title = f"run {conductor.number}: {run.sided_name}{heading}"
        if silent:
            say = f"NO DATA for {trial.silent_s:.0f} s"
        elif calling:
            say = trial.last_call.text.upper()
        elif state.phase == "ended":
            say = "OVER · steer on"
        elif state.phase == "sailing":
            say = f"next: {runs.next_words(state, run)}"
        elif state.is_unled:
            say = "in a manoeuvre begun before · not judged"
        elif state.steadiness.is_steady:
            say = f"STEADY · order {runs.execute_words(run).upper()}"
        else:
            say = f"approach{heading}, {conductor.programme.speed_mps(run):.1f} m/s"
    unmeasured = [] if silent else trial.unmeasured
    missing = [f"nothing comes of {', '.join(unmeasured)}"] if unmeasured else []
    return {
        "title": title, "say": say, "now": calling, "due_s": now_s, "values": _shown_values(state, run),
        "faults": [*missing, *state.faults[-2:]], "last": trial.last_lines(),
        "time": "" if not trial.newest_ns else f"{pd.Timestamp(trial.newest_ns):%H:%M:%S} UTC",
    }  # fmt: skip


def _shown_values(state: runs.RunState, run: PlannedRun | None) -> list[list[Any]]:
    """The motion as text, with how full the bars of an approach are, None where none is shown."""
    numbers, newest = dict.fromkeys(_VALUES, nan), state.newest
    if newest is not None:
        values = newest.heading_deg % 360.0, newest.yaw_rate_dps * 60.0, newest.speed_mps, newest.helm_deg
        numbers = dict(zip(_VALUES, values, strict=True))
    bars = state.steadiness if state.phase == "approach" and run is not None else None
    return [[name, form.format(numbers[name]) if isfinite(numbers[name]) else "\N{EN DASH}",
             None if bars is None else getattr(bars, bar)] for name, (form, bar) in _VALUES.items()]  # fmt: skip


def last_lines(conductor: Conductor, now_ns: int) -> list[tuple[str, str]]:
    """What became of the run before, what the trial shows, and what is left; each with how it is coloured."""
    lines = list[tuple[str, str]]()
    if (entry := conductor.last) is not None:
        lines.append((outcome_line(entry), "good" if entry.outcome == "valid" else "bad"))
        lines += [(line, "") for line in index_lines(entry)]
        lines.append((conductor.repeat_advice(entry), "dim"))
    programme, length_m = conductor.programme.run, conductor.programme.programme.length_m
    lines += [
        (line, "") for line in outlook.outlook_lines(conductor.wanted_outlook, conductor.place, programme, length_m)
    ]
    results, minutes = conductor.criteria, conductor.minutes_left(now_ns)
    shown = sum(result.mean is not None for result in results)
    of = f" of {max(minutes, 0.0):.0f}" if isfinite(minutes) else ""
    measured = f"{shown} of {len(results)} criteria measured · " if shown else ""
    needed, fitting = conductor.minutes_needed, ""
    if minutes < needed:
        fitting = f" · time for {', '.join(run.sided_name for run in conductor.runs_within(minutes)) or 'none'}"
    left = f"{sum(conductor.remaining.values())} runs left, {needed:.0f} min{of}{fitting}"
    lines.append((f"{measured}{left}", "dim"))
    return lines


@dataclass(frozen=True, slots=True)
class TerminalView:
    """The picture for a terminal of 80 columns and 24 rows, for every redrawing."""

    picture: Callable[[], Mapping[str, Any]]
    messages: deque[tuple[str, str]]
    typed: list[str]

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[RenderableType]:
        yield from wrapped_lines(list(self._rows(self.picture())), console, options)

    def _rows(self, picture: Mapping[str, Any]) -> Iterator[Text | Table]:
        yield _line((f"{picture['title']}", "bold cyan"), f"   {picture['time']}")
        style = "bold reverse" if picture["now"] else "bold"
        due = "" if picture["due_s"] is None else f"   in {picture['due_s']:.0f} s"
        yield Text("")
        yield _line((f"  {picture['say']}{due}  ", style))
        yield Text("")
        table = Table(box=None, padding=(0, 2, 0, 0), show_header=False)
        for name, value, share in picture["values"]:
            bar = Text("") if share is None else ProgressBar(total=1.0, completed=share, width=30)
            table.add_row(name, value, bar)
        yield table
        for fault in picture["faults"]:
            yield _line((fault, "bold red"))
        yield Text("")
        for text, kind in picture["last"]:
            yield _line((text, {"good": "green", "bad": "red", "dim": "dim"}.get(kind, "")))
        for level, text in list(self.messages)[-2:]:
            yield _line((text, "yellow" if level != "info" else "dim"))
        note = "".join(self.typed)
        keys = (
            f"note, Enter ends it: {note}_"
            if self.typed
            else " · ".join(f"{key} {text}" for key, text in KEYS.items())
        )
        yield _line((keys, "dim"))


def wrapped_lines(rows: list[Text | Table], console: Console, options: ConsoleOptions) -> Iterator[Text | Table]:
    """Rows, of which a text that is too long is wrapped where the screen has room, from the top, else cut off."""
    tall = sum(len(row.rows) if isinstance(row, Table) else 1 for row in rows)
    room = (options.height or console.height) - tall
    for row in rows:
        if isinstance(row, Table):
            yield row
            continue
        parts = row.copy()
        parts.no_wrap, parts.overflow = False, "fold"
        pieces = parts.wrap(console, options.max_width)
        if 0 < len(pieces) - 1 <= room:
            room -= len(pieces) - 1
            yield from pieces
        else:
            yield row


def _line(*parts: str | tuple[str, str]) -> Text:
    return Text.assemble(*parts, no_wrap=True, overflow="ellipsis")


@contextmanager
def served_page(address: str, port: int, picture: Callable[[], Mapping[str, Any]]) -> Iterator[str]:
    """Serve the page for the bridge; its address. Raises :class:`SourceError` where the port cannot be had."""

    def answer(client: socket.socket, request: requests.Request) -> None:
        if request.method != "GET":
            raise requests.RefusalError(HTTPStatus.NOT_IMPLEMENTED)
        bodies = {
            "/": ("text/html; charset=utf-8", _PAGE.encode()),
            "/state.json": ("application/json", orjson.dumps(picture(), option=orjson.OPT_SERIALIZE_NUMPY)),
        }
        if request.path not in bodies:
            raise requests.RefusalError(HTTPStatus.NOT_FOUND)
        kind, body = bodies[request.path]
        client.sendall(requests.http_response(HTTPStatus.OK, body, kind, **_HEADERS))

    front = requests.WebFront("bridge page", address, port, answer)
    try:
        front.__enter__()
    except OSError as error:
        raise errors.SourceError(
            f"the page for the bridge cannot be served on {address}:{port}", why=str(error.strerror or error),
            fix="stop the program that uses the port, or give another --port or --address",
        ) from error  # fmt: skip
    name = socket.gethostname() if address in _ALL_ADDRESSES else f"[{address}]" if ":" in address else address
    try:
        yield f"http://{name}:{port}/"
    finally:
        front.__exit__()


@contextmanager
def only_conductor(trial: str, folder: Path | None = None) -> Iterator[None]:
    """Be the only conductor beside the recorder of a trial. Raises :class:`InputError` where there is another: the
    marks of both would be in one recording, and neither programme could be read from it."""
    with ExitStack() as stack:
        try:
            stack.enter_context(lock_output_file((folder or requests.runtime_folder()) / f"{trial}.conducted"))
        except errors.StorageError as error:
            raise errors.InputError(
                f"the trial {trial!r} is conducted already, or its lock cannot be had",
                why=f"{error.what}: {error.why}",
                fix="end the other `seatrial conduct` first: the marks of both would be in one recording",
            ) from error  # fmt: skip
        yield


def recorder_to_follow(
    stop: threading.Event, notify: Notify, folder: Path | None = None, until_s: float = inf
) -> requests.RecorderState | None:
    """The only recorder that runs here, waited for; None where ``stop`` is set, or ``until_s`` of
    :func:`time.monotonic` is over, first.

    Raises :class:`InputError` where there are several.
    """
    announced = False
    while not stop.is_set() and time.monotonic() < until_s:
        recorders = [state for _, state in requests.running_recorders(folder)]
        if len(recorders) > 1:
            names = ", ".join(sorted(state.configuration for state in recorders))
            raise errors.InputError(
                "several recorders run here", why=names, fix="name the configuration with --config"
            )
        if recorders:
            return recorders[0]
        if not announced:
            notify("info", "no recorder runs here; waiting for one")
            announced = True
        stop.wait(min(1.0, max(until_s - time.monotonic(), 0.0)))
    return None


def conduct(
    programme: TrialProgramme,
    state: Path,
    stop: threading.Event,
    trial: tuple[str, Path] | None = None,
    duration_s: float | None = None,
    address: str = requests.LOOPBACK,
    port: int | None = None,
    folder: Path | None = None,
    maker: outlook.OutlookMaker | None = None,
    remark: str = "",
) -> Conductor:
    """Conduct a programme beside a recorder until ``stop`` is set, ``duration_s`` is over or no run is left.

    ``state`` is the file that it goes on from, locked meanwhile. ``trial`` is the recorder's trial and
    configuration, by default of the only one. ``folder`` is where recorders leave their sockets. ``maker`` makes
    the outlook of the runs so far; ``remark`` is told first.
    """
    messages: deque[tuple[str, str]] = deque(maxlen=8)
    on_terminal = sys.stderr.isatty()

    def notify(level: str, text: str) -> None:
        messages.append((level, text))
        if not on_terminal:
            health.LOG.log({"info": 20, "warning": 30}.get(level, 40), text)

    with ExitStack() as stack:
        stack.enter_context(lock_output_file(state))  # for its only conductor
        conductor = Conductor(programme, state)
        if not on_terminal:
            stack.enter_context(health.log_to(sys.stderr, "text"))
        chosen: dict[str, Any] = {"picture": {
            "title": programme.programme.name, "say": "waiting for the recorder", "now": False, "due_s": None,
            "values": [], "faults": [], "time": "", "last": last_lines(conductor, 0),
        }}  # fmt: skip
        pressed, typed = deque[str](), list[str]()
        if port is not None:
            page = stack.enter_context(served_page(address, port, lambda: chosen["picture"]))
            notify("info", f"page for the bridge: {page}")
        stack.enter_context(keys_taken(pressed.append))
        if remark:
            notify("warning", remark)
        view = TerminalView(lambda: chosen["picture"], messages, typed)
        if on_terminal:
            stack.enter_context(
                Live(view, console=errors.Terminal(stderr=True), refresh_per_second=4.0, screen=True)
            )
        until_s = inf if duration_s is None else time.monotonic() + duration_s
        if trial is None:
            recorder = recorder_to_follow(stop, notify, folder, until_s)
            if recorder is None:
                return conductor
            trial = recorder.trial, Path(recorder.configuration)
        stack.enter_context(only_conductor(trial[0], folder))
        conducted = ConductedTrial(*trial, conductor, notify, folder, maker)
        stack.callback(conducted.close)
        while time.monotonic() < until_s and not stop.wait(_POLL_S):
            while pressed:
                _handle_key(pressed.popleft(), typed, conducted)
            conducted.poll()
            chosen["picture"] = picture_of(conducted)
            if conductor.run is None and not conductor.marks and not on_terminal:
                break
        return conductor


def _handle_key(key: str, typed: list[str], conducted: ConductedTrial) -> None:
    """Take a key: of a note that is being typed, or what it does."""
    if not typed:
        typed += [" "] if key == "n" else []
        if key != "n":
            conducted.key(key)
    elif key in "\r\n":
        conducted.key("n", "".join(typed).strip())
        typed.clear()
    elif key in "\x7f\b":
        typed[1:] = typed[1:-1]
    elif key.isprintable():
        typed.append(key)
