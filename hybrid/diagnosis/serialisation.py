"""Reading and writing a diagnosis: the numbers behind every figure of its page and notebook.

``diagnosis.json`` and ``ladder.json`` have a fixed form (a contract); ``shown.json`` has what else the page
shows, ``map.parquet`` the missing force second by second and ``tracks.parquet`` the held-out windows, measured
and predicted.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from seatrial.acquisition.core import files
from seatrial.acquisition.core.errors import InputError
from seatrial.acquisition.core.files import remove_file, write_text, written_together
from seatrial.acquisition.core.result import Number, from_json, to_json
from seatrial.analysis.tables.export import read_parquet, write_parquet
from seatrial.hybrid.diagnosis.result import (
    FORCES,
    Correlation,
    Diagnosis,
    Extras,
    GapCell,
    Ladder,
    Map,
    SensorContradiction,
    Suspect,
    Tracks,
)

DIAGNOSIS, SHOWN, LADDER = "diagnosis.json", "shown.json", "ladder.json"
MAP, TRACKS = "map.parquet", "tracks.parquet"
_WAYS = ("measured", "before", "after", "floor", "constant_velocity")
_CONTROL = "control_"
_TRACK = ("north_m", "east_m", "heading_rad")
_UNITS = {
    "_m": "m",
    "_rad": "rad",
    "_s": "s",
    "_mps": "m/s",
    "_dps": "deg/s",
    "_deg": "deg",
    "rpm": "rpm",
    "_percent": "%",
}
"""Units by the endings of names, in their printed form."""


@dataclass(frozen=True, slots=True)
class FigureData:
    """The content of ``shown.json``: what the page shows and ``diagnosis.json`` does not have.

    ``evidence`` is by named effect, ``minutes`` those of the next manoeuvre, ``cells`` those of the maps before
    and after; ``remainder_looks_like`` says what the forces that remain beside named effects resemble.
    """

    horizon_s: int
    evidence: Mapping[str, Number]
    minutes: float | None
    suspects: tuple[Suspect, ...]
    cells: Mapping[str, tuple[GapCell, ...] | None]
    consistency: tuple[SensorContradiction, ...] | None
    correlation: Correlation | None
    remainder_looks_like: str = ""


def write_figure_data(diagnosis: Diagnosis, extras: Extras, folder: Path) -> None:
    """Write all but page and vessel, removing files of an earlier diagnosis. Raises :class:`StorageError`."""
    after = diagnosis.next_manoeuvre
    shown = FigureData(
        horizon_s=diagnosis.gap.horizon_s,
        evidence={effect.name: effect.evidence for effect in diagnosis.effects},
        minutes=None if after is None else after.minutes,
        suspects=diagnosis.suspects,
        cells={name: None if force_map is None else force_map.places for name, force_map in extras.maps.items()},
        consistency=extras.consistency,
        correlation=extras.correlation,
        remainder_looks_like="" if diagnosis.remainder is None else diagnosis.remainder.looks_like,
    )
    results = ((DIAGNOSIS, diagnosis, 2), (SHOWN, shown, None), (LADDER, extras.ladder, 2))
    tables = ((MAP, _map_table(extras)), (TRACKS, _tracks_table(diagnosis.tracks)))
    with written_together(folder / DIAGNOSIS):
        for name, result, indent in results:
            if result is None:
                remove_file(folder / name)
            else:
                write_text(folder / name, json.dumps(to_json(result), indent=indent) + "\n")
        for name, table in tables:
            if table is None:
                remove_file(folder / name)
            else:
                write_parquet(table, folder / name, _units(table), {})


def read_diagnosis(folder: Path | str) -> tuple[Diagnosis, Extras]:
    """Read a diagnosis, and what else its page shows, from the ``folder`` of ``seatrial diagnose``.

    Raises :class:`InputError` for a folder without one, or with one of another version.
    """
    folder = Path(folder)
    stored, shown = read_json(folder / DIAGNOSIS), read_json(folder / SHOWN)
    try:
        data = from_json(FigureData, shown)
        for effect in stored["effects"]:
            effect["evidence"] = data.evidence[effect["name"]]
        stored["gap"]["horizon_s"] = data.horizon_s
        if stored["next_manoeuvre"] is not None:
            stored["next_manoeuvre"]["minutes"] = data.minutes
        if stored["remainder"] is not None:
            stored["remainder"]["looks_like"] = data.remainder_looks_like
        tracks = _tracks_of(read_parquet(folder / TRACKS)[0]) if (folder / TRACKS).is_file() else None
        diagnosis = replace(from_json(Diagnosis, stored), suspects=data.suspects, tracks=tracks)
        ladder = from_json(Ladder, read_json(folder / LADDER)) if (folder / LADDER).is_file() else None
        before, after = _maps_of(folder, data.cells)
        return diagnosis, Extras(before, after, data.consistency, ladder, data.correlation)
    except Exception as error:  # what others wrote into it may fail in every possible way
        raise InputError("was not written by this version", where=str(folder), why=str(error),
                         fix="run `seatrial diagnose` again") from error  # fmt: skip


def _map_table(extras: Extras) -> pd.DataFrame | None:
    """One row for each second and map: the missing force, and the quantities of the cells."""
    parts = [
        pd.DataFrame({"map": name, **dict(zip(FORCES, force_map.force.T, strict=True)), **force_map.quantities})
        for name, force_map in extras.maps.items() if force_map is not None
    ]  # fmt: skip
    return pd.concat(parts, ignore_index=True) if parts else None


def _maps_of(folder: Path, cells: Mapping[str, tuple[GapCell, ...] | None]) -> list[Map | None]:
    if not (folder / MAP).is_file():
        return [None, None]
    table = read_parquet(folder / MAP)[0]
    maps: list[Map | None] = []
    for name in ("before", "after"):
        rows, places = table[table["map"] == name].drop(columns="map"), cells[name]
        quantities = {str(column): rows[column].to_numpy(dtype=float) for column in rows if column not in FORCES}
        force = rows[list(FORCES)].to_numpy(dtype=float)
        maps.append(None if places is None else Map(places, force, quantities))
    return maps


def _tracks_table(tracks: Tracks | None) -> pd.DataFrame | None:
    """One row for each window and second; columns like ``before_north_m`` and ``control_port_rpm``."""
    if tracks is None:
        return None
    windows, seconds = tracks.measured.shape[:2]
    columns = {
        "window": np.repeat(np.arange(windows), seconds),
        "second": np.tile(np.arange(seconds), windows),
        "leg": np.repeat(tracks.leg, seconds),
        "start_s": np.repeat(tracks.start_s, seconds),
    }
    for way in _WAYS:
        values = getattr(tracks, way).reshape(-1, len(_TRACK))
        columns |= {f"{way}_{name}": values[:, number] for number, name in enumerate(_TRACK)}
    controls = {f"{_CONTROL}{name}": values.ravel() for name, values in tracks.controls.items()}
    return pd.DataFrame({**columns, **controls})


def _tracks_of(table: pd.DataFrame) -> Tracks:
    windows = int(table["window"].nunique())
    first = table[table["second"] == 0]
    ways = {
        way: table[[f"{way}_{name}" for name in _TRACK]].to_numpy(dtype=float).reshape(windows, -1, len(_TRACK))
        for way in _WAYS
    }
    controls = {
        str(name).removeprefix(_CONTROL): table[name].to_numpy(dtype=float).reshape(windows, -1)
        for name in table if str(name).startswith(_CONTROL)
    }  # fmt: skip
    when = {name: first[name].to_numpy(dtype=np.int64) for name in ("leg", "start_s")}
    return Tracks(**ways, **when, controls=controls)


def _units(table: pd.DataFrame) -> dict[str, str]:
    named = {str(name): unit for name in table for ending, unit in _UNITS.items() if str(name).endswith(ending)}
    return named | {name: unit for name, unit in zip(FORCES, ("N", "N", "N m"), strict=True) if name in table}


def read_json(path: Path) -> dict[str, Any]:
    """Read a JSON object. Raises :class:`InputError` for anything else."""
    try:
        return dict(files.read_json(path))
    except FileNotFoundError as error:
        raise InputError(
            "does not exist", where=str(path), fix="give the output folder of `seatrial diagnose`"
        ) from error
    except (OSError, ValueError, TypeError) as error:
        raise InputError("cannot be read", where=str(path), why=str(error)) from error
