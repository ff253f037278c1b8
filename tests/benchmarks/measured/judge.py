"""Some recordings diagnosed with something hidden in them, and what that is worth on all the others."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pandas as pd

from seatrial.acquisition.recording.reader import read_recording
from seatrial.acquisition.tables.import_table import import_table
from seatrial.hybrid.diagnosis.acceptance import Coordinates, fitted_coordinates
from seatrial.hybrid.diagnosis.gap import UnseenWindows, unseen_windows
from seatrial.hybrid.diagnosis.linearise import model_of
from seatrial.hybrid.diagnosis.log import Log, log_of
from seatrial.hybrid.effects import catalogue_of
from seatrial.hybrid.prediction.baselines import distances
from seatrial.hybrid.vessel.files import Vessel, load_vessel
from seatrial.hybrid.workflows import checked_tables, diagnose_tables
from tests.benchmarks.measured.kinds import KINDS, Kind

VESSEL = "esso_osaka_3m"
COLUMNS = Path(__file__).parents[3] / "trials" / "columns" / "esso_osaka.toml"


@dataclass(frozen=True, slots=True)
class MeasuredCase:
    """Some of the recordings (CSV files below ``folder``) with a kind of :data:`KINDS` hidden in them."""

    kind: str
    part: str
    recordings: tuple[str, ...]
    folder: Path

    @property
    def key(self) -> str:
        """The case in one word."""
        return f"{self.kind}/{self.part}"


def recordings_in(folder: Path) -> list[str]:
    """The files of the recordings below a folder, by manoeuvre."""
    return sorted(str(path.relative_to(folder)) for path in folder.glob("*/*.csv.gz"))


def cases_of(folder: Path, kinds: Sequence[str] = tuple(KINDS), parts: int = 3) -> list[MeasuredCase]:
    """Each kind in each of so many parts of the recordings, which are dealt out so that each has all manoeuvres."""
    every = recordings_in(folder)
    dealt = [tuple(every[number::parts]) for number in range(parts)]
    return [
        MeasuredCase(kind, f"{number + 1} of {parts}", some, folder)
        for number, some in enumerate(dealt)
        for kind in kinds
    ]


@lru_cache(maxsize=64)
def tables_of(folder: Path, recording: str) -> list[pd.DataFrame]:
    """A recording's tables, checked as before every diagnosis."""
    with TemporaryDirectory() as place:
        target = Path(place) / "recording.mcap"
        import_table(folder / recording, target, COLUMNS)
        return checked_tables(read_recording(target)).tables


@lru_cache(maxsize=64)
def _log(folder: Path, recording: str, kind: str) -> Log:
    changed = kind if KINDS[kind].in_record else "nothing"
    if changed != kind:
        return _log(folder, recording, changed)
    return log_of([KINDS[kind].record(each) for each in tables_of(folder, recording)])


def judged(case: MeasuredCase) -> dict[str, Any]:
    """What was said, and how far predictions are off: on this recording and on the others."""
    kind, good = KINDS[case.kind], load_vessel(VESSEL)
    vessel = kind.model(good)
    tables = [kind.record(each) for name in case.recordings for each in tables_of(case.folder, name)]
    for each in tables:
        each.attrs["recording"] = case.part  # one pond, one set of sensors: parts of one trial
    run = diagnose_tables(tables, vessel)
    plain, accepted = run.diagnosis.as_dict(), run.conclusion.accepted
    found = fitted_coordinates(accepted.evidence, accepted.names)
    others = [each for each in recordings_in(case.folder) if each not in case.recordings]
    return {
        "kind": case.kind,
        "part": case.part,
        "said": {name: plain[name] for name in ("verdict", "effects", "indistinguishable")},
        "here": _sum([_off(case, kind, vessel, good, each, found) for each in case.recordings]),
        "others": _sum([_off(case, kind, vessel, good, each, found) for each in others]),
    }


def _off(
    case: MeasuredCase, kind: Kind, vessel: Vessel, good: Vessel, recording: str, found: Coordinates
) -> dict[str, Any]:
    """Sums of distances [m] over a recording's windows: before, with the term's own return, with what was found."""
    log, catalogue = _log(case.folder, recording, case.kind), catalogue_of(vessel)
    windows = unseen_windows(log, model_of(vessel, catalogue))
    if kind.in_record:
        own = windows.predict_tracks({kind.effect: catalogue[kind.effect].free_coordinates(kind.values)})
    else:
        own = windows.before if vessel is good else unseen_windows(log, model_of(good, catalogue)).before
    return summed(windows, {"before": windows.before, "own": own, "found": windows.predict_tracks(found)})


def summed(windows: UnseenWindows, tracks: Mapping[str, Any]) -> dict[str, Any]:
    """The number of windows that every track is known on, and each one's sum of mean distances [m]."""
    off_m = {name: distances(track, windows.measured).mean(axis=1) for name, track in tracks.items()}
    known = np.isfinite(np.array(list(off_m.values()))).all(axis=0)
    return {"windows": int(known.sum()), **{name: float(each[known].sum()) for name, each in off_m.items()}}


def _sum(parts: list[dict[str, Any]]) -> dict[str, float]:
    windows = sum(each["windows"] for each in parts)
    return {"windows": windows} | {
        name: sum(each[name] for each in parts) / max(windows, 1) for name in ("before", "own", "found")
    }
