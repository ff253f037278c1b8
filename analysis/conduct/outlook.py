"""What the runs sailed so far say of those that remain: predicted criteria, and what each run would still tell.

The model that predicts is not known here: a function makes the outlook of the recorded runs, in a process of its
own and after everything else, so that it holds up neither the conductor nor the recorder.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import lru_cache
from math import nan, sqrt
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd
from threadpoolctl import threadpool_limits

from seatrial.acquisition.core.errors import DataShortageError, InputError, SeatrialError, unexpected_error
from seatrial.acquisition.core.quantities import Series
from seatrial.acquisition.core.result import to_json
from seatrial.acquisition.recording.reader import Recording, Tail
from seatrial.analysis.conduct.programme import PlannedRun
from seatrial.analysis.manoeuvres import criteria
from seatrial.analysis.manoeuvres.conducted import JudgedSpan
from seatrial.analysis.manoeuvres.indices import Index
from seatrial.analysis.tables.table import table_of

_NICENESS = 15
_RECEIVED_WITHIN_NS = 60 * 10**9  # of the times that its samples are stamped with, a chunk has been received


@dataclass(frozen=True, slots=True)
class RunOutlook:
    """What is expected of a run that was not sailed.

    ``predicted`` are the indices of its criteria by name, with 95 % intervals, limits and results. ``gain`` is the
    expected information on the coefficients of the model [nats], NaN where it is not known, and ``left`` the mean
    share of their variances that the run would leave.
    """

    predicted: Mapping[str, Index] = field(default_factory=dict)
    gain: float = nan
    left: float = nan

    def is_needless(self, planned: PlannedRun) -> bool:
        """Whether all that a run is for is a criterion that is predicted to be met."""
        return bool(planned.purpose) and all(
            purpose in self.predicted and self.predicted[purpose].result == criteria.MET
            for purpose in planned.purpose
        )


@dataclass(frozen=True, slots=True)
class Outlook:
    """The outlook by the place of a run in the programme, made of ``sailed`` runs.

    Of the ``coefficients`` of the model ``known`` are determined by them.
    """

    runs: Mapping[int, RunOutlook]
    sailed: int
    known: int
    coefficients: int

    def as_json(self) -> dict[str, Any]:
        """As plain values; what is not known is null."""
        runs = [{"place": place, **to_json(run)} for place, run in self.runs.items()]
        return {**to_json(replace(self, runs={})), "runs": runs}


class RecordedRun(NamedTuple):
    """A run so far with its samples; one that was not ``valid`` may have been sailed with another helm."""

    planned: PlannedRun
    table: pd.DataFrame
    valid: bool


class StoredRun(NamedTuple):
    """A run that was sailed before a restart: its span lies in one of these recordings, or goes on in the next."""

    planned: PlannedRun
    paths: Sequence[Path]
    span: JudgedSpan
    valid: bool

    def read(self) -> RecordedRun:
        """The run with its samples, of those recordings that are there still. Raises :class:`DataShortageError`
        where they have none of it."""
        return RecordedRun(self.planned, stored_table_of_span(self.paths, self.span), self.valid)


def stored_table_of_span(paths: Sequence[Path], span: JudgedSpan) -> pd.DataFrame:
    """The samples of a part of the time, of those recordings that can be read, as :func:`table_of_span` has them.

    Of the files only the chunks of that time are read: a minute of a day needs as much as one of an hour.
    Raises :class:`DataShortageError` where they have none of it.
    """
    received_ns = span.start.value - _RECEIVED_WITHIN_NS, span.end.value + _RECEIVED_WITHIN_NS
    series: dict[str, list[Series]] = {}
    recording = None
    for path in paths:
        with suppress(InputError):
            tail = _tail_of_recording(path)
            for name, samples in tail.read_samples_of_span(*received_ns).items():
                series.setdefault(name, []).append(samples)
            recording = Recording(path, tail.trial, {}, {}, [], 0, tail.ended, *received_ns)
    if recording is None:
        raise DataShortageError("its recordings cannot be read", where=", ".join(map(str, paths)))
    return table_of_span(recording, series, span)


_tail_of_recording = lru_cache(maxsize=2)(Tail)  # neighbouring runs are in one recording


def table_of_span(recording: Recording, series: Mapping[str, Sequence[Series]], span: JudgedSpan) -> pd.DataFrame:
    """The samples of a part of the time, as a table of the ship of a recording; each channel is given in pieces.

    Raises :class:`DataShortageError` where there is none.
    """
    inside = {}
    for name, pieces in series.items():
        samples = Series.concatenate(pieces)
        rows = (samples.measured_ns >= span.start.value) & (samples.measured_ns <= span.end.value)
        if rows.any():
            inside[name] = samples.subset(rows)
    return table_of(replace(recording, series=inside))


OutlookMaker = Callable[[Sequence[RecordedRun], Mapping[int, PlannedRun]], Outlook]
"""Makes the outlook of recorded runs on those that remain, by place. It can be sent to another process."""


class OutlookProcess:
    """Makes one outlook at a time in a process of low priority; to be closed."""

    def __init__(self, maker: OutlookMaker) -> None:
        self._maker = maker
        self._receiver: Connection | None = None

    @property
    def is_working(self) -> bool:
        """Whether an outlook is being made."""
        return self._receiver is not None

    def begin(self, recorded: Sequence[RecordedRun | StoredRun], remaining: Mapping[int, PlannedRun]) -> None:
        """Begin one, where none is being made. Stored runs are read first; those that cannot be are left out."""
        context = get_context("spawn")
        self._receiver, sender = context.Pipe(duplex=False)
        self._process = context.Process(
            target=_send_outlook, args=(sender, self._maker, recorded, remaining), daemon=True
        )
        self._process.start()
        sender.close()  # or the end of the process would pass unnoticed

    def result(self) -> Outlook | str | None:
        """The outlook that has been made, or why there is none; None where none is ready."""
        if self._receiver is None or not self._receiver.poll():
            return None
        try:
            made: Outlook | str = self._receiver.recv()
        except (EOFError, OSError):
            made = "the process that made it has ended"
        self.close()
        return made

    def close(self) -> None:
        """End what is being made."""
        if self._receiver is not None:
            self._receiver.close()
            self._receiver = None
            self._process.kill()
            self._process.join()


def _send_outlook(
    pipe: Connection,
    maker: OutlookMaker,
    runs: Sequence[RecordedRun | StoredRun],
    remaining: Mapping[int, PlannedRun],
) -> None:
    """The process of an outlook."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the terminal's Ctrl-C is for the conductor
    os.nice(_NICENESS)
    try:
        with threadpool_limits(1, user_api="blas"):  # no more than one core
            recorded = list[RecordedRun]()
            for run in runs:
                with suppress(SeatrialError):
                    recorded.append(run.read() if isinstance(run, StoredRun) else run)
            made: Outlook | str = maker(recorded, remaining)
    except DataShortageError:
        made = "too little has been sailed yet"
    except Exception as error:  # whatever it is, the programme goes on without an outlook
        made = str(unexpected_error(error))
    pipe.send(made)


def outlook_lines(
    outlook: Outlook | None, next_place: int | None, programme: Sequence[PlannedRun], length_m: float
) -> list[str]:
    """What need not be sailed, the run that is next first, and how much that would tell."""
    if outlook is None:
        return []
    needless = [place for place, run in outlook.runs.items() if run.is_needless(programme[place])]
    needless.sort(key=lambda place: place != next_place)
    lines, upcoming = list[str](), outlook.runs.get(-1 if next_place is None else next_place)
    if needless:
        predicted = predicted_words(outlook.runs[needless[0]], length_m)
        lines.append(f"{programme[needless[0]].sided_name} need not be sailed: {predicted}")
    if needless[1:]:
        lines.append(f"nor {', '.join(programme[place].sided_name for place in needless[1:])}")
    if upcoming is not None and upcoming.left < 1.0:
        determined = f"the runs so far determine {outlook.known} of {outlook.coefficients} coefficients"
        narrower = f"the next would make their intervals {1.0 - sqrt(upcoming.left):.0%} narrower"
        lines.append(f"{determined} of the ship's model; {narrower}")
    return lines


def predicted_words(outlook: RunOutlook, length_m: float) -> str:
    """The predicted criteria of a run with intervals and limits, lengths in ship lengths."""
    words, small = [], length_m < criteria.LEAST_LENGTH_M
    for name, index in outlook.predicted.items():
        unit, scale = ("L", length_m) if index.unit == "m" else (index.unit, 1.0)
        low, high, limit = (number / scale for number in (index.low, index.high, index.limit or nan))
        words.append(f"{name} {index.value / scale:.3g} {unit} ({low:.3g} to {high:.3g}), limit {limit:.3g}")
    return "; ".join(words) + f" (limits of ships from {criteria.LEAST_LENGTH_M:.0f} m)" * small
