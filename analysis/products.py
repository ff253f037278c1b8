"""The analysis of one recording, step by step: check, repair, 1 Hz table, windows, manoeuvres, smoothing."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

import pandas as pd

from seatrial.acquisition.config.run_sheet import statement_from_text
from seatrial.acquisition.core.errors import SeatrialError, printable_path, unexpected_error
from seatrial.acquisition.recording.reader import Recording, read_parts_of_recording
from seatrial.analysis.estimation.smoother import smooth
from seatrial.analysis.manoeuvres import conducted, find, indices
from seatrial.analysis.quality.check import DataQuality, check_recording
from seatrial.analysis.quality.repairs import Repair, RepairResult, repair_table, replace_motion_by_smoothed
from seatrial.analysis.tables.resample import resample
from seatrial.analysis.tables.table import require, table_of, with_calm
from seatrial.analysis.windows.held import HeldWindows, add_start_states, held_windows


@dataclass(frozen=True, slots=True)
class Options:
    """What a result depends on besides its recording.

    ``repair`` applies the repairs that are certain, ``smooth`` gives the motion its standard deviations,
    ``pictures`` go on the page (the two that take time); windows cover ``horizon_s`` [s] and are tried every
    ``stride_s`` [s]; ``length_m`` [m] is the ship's, for distances in ship lengths; ``rebuild_positions``, with the
    repairs, takes the path that speeds and heading give for the positions. ``statement`` is what a person states of
    the trials besides their recordings (:func:`seatrial.acquisition.config.run_sheet.statement_from_text`).
    """

    repair: bool = True
    smooth: bool = True
    pictures: bool = True
    horizon_s: int = 15
    stride_s: int = 5
    length_m: float | None = None
    rebuild_positions: bool | None = False
    statement: str = ""


@dataclass(slots=True)
class Products:
    """The results of the analysis of one recording.

    ``table`` has the raw samples, after repairs if there were any; ``one_hz`` is it once a second, motion from
    the smoother with a column ``<name>_sigma`` for each where that was made. ``left_out`` only began like
    manoeuvres. ``shortfalls`` says in one line each what could not be made, and why; ``remarks`` which of the
    smoother's bands are in doubt.
    """

    recording: Recording
    quality: DataQuality
    table: pd.DataFrame
    one_hz: pd.DataFrame
    repairs: tuple[Repair, ...] = ()
    windows: HeldWindows | None = None
    manoeuvres: tuple[indices.Manoeuvre, ...] = ()
    left_out: tuple[indices.LeftOut, ...] = ()
    shortfalls: list[str] = field(default_factory=list)
    remarks: tuple[str, ...] = ()

    @property
    def programme(self) -> tuple[conducted.ConductedRun, ...]:
        """The runs of a programme that was conducted in it."""
        return conducted.conducted_runs(self.recording.events)

    @property
    def window_rows(self) -> pd.DataFrame | None:
        """The long table of the held windows."""
        return None if self.windows is None else self.windows.rows

    @contextmanager
    def noting_shortfalls(self) -> Iterator[None]:
        """A step that may be impossible: its error becomes a shortfall, stated once, and the analysis goes on."""
        try:
            yield
        except SeatrialError as error:
            if (cause := error_cause_text(error)) not in self.shortfalls:
                self.shortfalls.append(cause)


def analyse_recording(paths: Sequence[Path], options: Options, name: str = "") -> Products:
    """The analysis of one recording, the file or its parts; what its channels do not allow is a shortfall."""
    recording, name = read_parts_of_recording(paths), name or printable_path(paths[0].stem)
    recording = replace(recording, trial=statement_from_text(options.statement).apply_to_trial(recording.trial))
    raw = table_of(recording)
    raw.attrs["recording"] = name  # not its path, which differs from place to place
    quality = check_recording(recording, raw)
    repaired = RepairResult(raw, ())
    if options.repair:
        repaired = repair_table(
            raw, quality.findings, quality.flags, recording, rebuild_positions=options.rebuild_positions
        )
    one_hz = resample(repaired.table, 1.0)
    products = Products(recording, quality, repaired.table, one_hz, repaired.repairs)
    with products.noting_shortfalls():
        require(with_calm(one_hz))
        products.windows = held_windows(one_hz, options.horizon_s, options.stride_s, trial=name)
    with products.noting_shortfalls():
        products.manoeuvres, products.left_out = find.find_manoeuvres_and_left_out(
            repaired.table, options.length_m, recording.events
        )
    if options.smooth:
        with products.noting_shortfalls():
            motion = smooth(repaired.table, 1.0)
            products.one_hz, products.remarks = replace_motion_by_smoothed(one_hz, motion), motion.remarks
            if products.windows is not None:
                products.windows = add_start_states(products.windows, {name: motion})
    return products


def error_cause_text(error: BaseException) -> str:
    """An error in one line that is the same for all recordings of one fault: without the file's path.

    For an unexpected error it includes where in Seatrial it was raised.
    """
    fault = unexpected_error(error)
    return str(fault.at("" if isinstance(error, SeatrialError | OSError) else fault.where))
