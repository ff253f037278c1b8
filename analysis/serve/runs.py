"""Manoeuvres of many recordings side by side: the runs of one kind, their picture's data and their indices."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from acquisition.core.errors import InputError
from analysis.manoeuvres.indices import Manoeuvre
from analysis.manoeuvres.motion import Motion, motion_of
from analysis.manoeuvres.report import rows_of
from analysis.tables.files import read_parquet

_COLUMNS = [
    "recording", "started [UTC]", "kind", "manoeuvre", "index", "value", "low", "high", "unit", "lengths", "limit",
]  # fmt: skip


@dataclass(frozen=True, slots=True)
class Run:
    """One manoeuvre in a recording's result."""

    recording: str
    manoeuvre: Manoeuvre

    @property
    def label(self) -> str:
        """What it is called beside others."""
        return f"{self.recording}, {self.manoeuvre.start:%H:%M:%S} {self.manoeuvre.sided_name}"


def runs_in(results: Path, names: Iterable[str], kind: str = "") -> list[Run]:
    """The manoeuvres of a kind, or of all, in the results of recordings. Raises :class:`InputError`."""
    runs = []
    for name in names:
        path = results / name / "manoeuvres.json"
        try:
            said = json.loads(path.read_text(encoding="utf-8"))["manoeuvres"]
            found = [Manoeuvre.from_json(each) for each in said if kind in ("", each["kind"])]
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise InputError("are not the manoeuvres of a batch", where=str(path), why=str(error)) from error
        runs += [Run(name, each) for each in found]
    return runs


def with_motions(results: Path, runs: Iterable[Run]) -> list[tuple[Run, Motion]]:
    """The runs, each with the motion of its recording once a second, as its result has it."""
    motions: dict[str, Motion] = {}
    for run in runs:
        if run.recording not in motions:
            table, said = read_parquet(results / run.recording / "table.parquet")
            table.attrs["trial"] = json.loads(said["trial"])
            motions[run.recording] = motion_of(table)
    return [(run, motions[run.recording]) for run in runs]


def compared(runs: Sequence[Run]) -> tuple[list[str], list[list[str]]]:
    """A table for people: a row a run, a column each of the main indices that any has."""
    names = list(dict.fromkeys(row[0] for run in runs for row in rows_of(run.manoeuvre, every=False)))
    cells = [(run.label, {row[0]: row[1] for row in rows_of(run.manoeuvre)}) for run in runs]
    return ["run", *names], [[label, *(each.get(name, "") for name in names)] for label, each in cells]


def index_table(runs: Iterable[Run]) -> pd.DataFrame:
    """A row each index of each run, for a workbook: value, 95 % interval, unit, IMO's limit."""
    rows = [
        {"recording": run.recording, "started [UTC]": run.manoeuvre.start.tz_localize(None),
         "kind": run.manoeuvre.kind, "manoeuvre": run.manoeuvre.sided_name, "index": name, **index.as_json()}
        for run in runs for name, index in run.manoeuvre.indices.items()
    ]  # fmt: skip
    return pd.DataFrame(rows, columns=_COLUMNS)
