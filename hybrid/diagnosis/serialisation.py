"""What a diagnosis shows, on disk and back: the numbers behind every figure of its page and of the notebook about
it.

``diagnosis.json`` is the contract's; ``shown.json`` has what the page shows beside it, ``map.parquet`` the force
that the model lacks second by second and ``tracks.parquet`` the windows that were left out, measured and predicted.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from acquisition.core.errors import InputError, storage_error
from analysis.tables.files import read_parquet, write_parquet
from hybrid.diagnosis.map import FORCES, Map
from hybrid.diagnosis.result import (
    Consistency,
    Correlation,
    Diagnosis,
    Estimate,
    Extras,
    Gap,
    Ladder,
    Manoeuvre,
    NamedEffect,
    Place,
    Rival,
    Suspect,
    Tracks,
    UnknownCause,
)
from hybrid.prediction.scores import Interval

DIAGNOSIS, SHOWN, LADDER = "diagnosis.json", "shown.json", "ladder.json"
MAP, TRACKS = "map.parquet", "tracks.parquet"
_WAYS = ("measured", "before", "after", "floor", "constant_velocity")
_TRACK = ("north_m", "east_m", "heading_rad")
_FORCE_UNITS = dict(zip(FORCES, ("N", "N", "N m"), strict=True))


def write_shown(diagnosis: Diagnosis, extras: Extras, folder: Path) -> list[Path]:
    """Write what is shown beside ``diagnosis.json``; files of an earlier diagnosis go. Raises
    :class:`StorageError`."""
    written = [_write_json(_plain(diagnosis, extras), folder / SHOWN)]
    for name, table in ((MAP, _map_table(extras)), (TRACKS, _tracks_table(diagnosis.tracks))):
        path = folder / name
        if table is None:
            path.unlink(missing_ok=True)
        else:
            write_parquet(table, path, _units(table), {})
            written.append(path)
    return written


def read_shown(folder: Path | str) -> tuple[Diagnosis, Extras]:
    """A diagnosis and what its page shows beside it, from what :func:`write_shown` and ``diagnose`` wrote.

    Raises :class:`InputError` for a folder that holds none, or one of another version.
    """
    folder = Path(folder)
    said, shown = read_json(folder / DIAGNOSIS), read_json(folder / SHOWN)
    try:
        tracks = _tracks_of(read_parquet(folder / TRACKS)[0]) if (folder / TRACKS).is_file() else None
        return _diagnosis_of(said, shown, tracks), _extras_of(folder, shown)
    except (KeyError, TypeError, ValueError) as error:
        why = f"{type(error).__name__} {error}"
        raise InputError("is not what this version writes", where=str(folder), why=why,
                         fix="run `seatrial diagnose` again") from error  # fmt: skip


def _plain(diagnosis: Diagnosis, extras: Extras) -> dict[str, Any]:
    after, correlation = diagnosis.next_manoeuvre, extras.correlation
    return {
        "horizon_s": diagnosis.gap.horizon_s,
        "evidence": {each.name: each.evidence for each in diagnosis.effects},
        "minutes": None if after is None else after.minutes,
        "suspects": [asdict(each) for each in diagnosis.suspects],
        "cells": {
            name: None if each is None else [asdict(place) for place in each.places]
            for name, each in (("before", extras.map), ("after", extras.map_after))
        },
        "consistency": None if extras.consistency is None else [asdict(each) for each in extras.consistency],
        "correlation": None if correlation is None else
        {"names": list(correlation.names), "matrix": correlation.matrix.tolist()},
    }  # fmt: skip


def _diagnosis_of(said: Mapping[str, Any], shown: Mapping[str, Any], tracks: Tracks | None) -> Diagnosis:
    gap, unknown, after = _with_nan(said["gap"]), said["unknown"], said["next_manoeuvre"]
    return Diagnosis(
        verdict=said["verdict"],
        tolerance=said["tolerance"],
        effects=tuple(_effect_of(each, shown["evidence"]) for each in said["effects"]),
        rivals=tuple(Rival(**_with_nan(each)) for each in said["rivals"]),
        indistinguishable=tuple(map(tuple, said["indistinguishable"])),
        unknown=None if unknown is None else UnknownCause(unknown["share_of_gap"], tuple(unknown["where"]),
                                                         unknown["looks_like"]),
        where=tuple(map(_place_of, said["where"])),
        gap=Gap(gap["before_m"], gap["after_m"], gap["floor_m"], gap["held_out_windows"], shown["horizon_s"]),
        next_manoeuvre=None if after is None else Manoeuvre(after["what"], tuple(after["separates"]),
                                                            after["expected_evidence"], shown["minutes"]),
        suspects=tuple(Suspect(**_with_nan(each)) for each in shown["suspects"]),
        tracks=tracks,
        remarks=tuple(said["remarks"]),
        provenance=said["provenance"],
    )  # fmt: skip


def _effect_of(said: Mapping[str, Any], evidence: Mapping[str, float]) -> NamedEffect:
    parameters = {name: Estimate(**_with_nan(each)) for name, each in said["parameters"].items()}
    return NamedEffect(
        said["name"], said["family"], said["kind"], parameters, said["share_of_gap"], said["p_value"],
        evidence[said["name"]], said["sentence"],
    )  # fmt: skip


def _extras_of(folder: Path, shown: Mapping[str, Any]) -> Extras:
    maps = _maps_of(folder, shown["cells"])
    found, correlation = shown["consistency"], shown["correlation"]
    consistency = None if found is None else [_consistency_of(each) for each in found]
    ladder = _ladder_of(read_json(folder / LADDER)) if (folder / LADDER).is_file() else None
    hang = None if correlation is None else Correlation(
        tuple(correlation["names"]), np.array(correlation["matrix"]).reshape(2 * (len(correlation["names"]),))
    )  # fmt: skip
    return Extras(maps["before"], maps["after"], consistency, ladder, hang)


def _consistency_of(said: Mapping[str, Any]) -> Consistency:
    values: dict[str, Any] = {name: tuple(each) if isinstance(each, list) else each for name, each in said.items()}
    return Consistency(**values)


def _ladder_of(said: Mapping[str, Any]) -> Ladder:
    return Ladder(
        said["horizon_s"], said["method"], said["windows"], said["legs"],
        {name: Interval(**_with_nan(each)) for name, each in said["mean_distance_m"].items()},
        {(each["of"], each["to"]): Interval(**_with_nan({key: each[key] for key in ("value", "low", "high")}))
         for each in said["ratios"]},
        said["why_not"] or "",
    )  # fmt: skip


def _with_nan(values: Mapping[str, Any]) -> dict[str, Any]:
    """JSON has null for what is no number."""
    return {name: float("nan") if each is None else each for name, each in values.items()}


def _place_of(said: Mapping[str, Any]) -> Place:
    cell = {name: (float(span[0]), float(span[1])) for name, span in said["cell"].items()}
    values = _with_nan({name: said[name] for name in ("error", "z")})
    return Place(said["channel"], cell, said["windows"], values["error"], values["z"])


def _map_table(extras: Extras) -> pd.DataFrame | None:
    """A row a second and map: the force that lacks, and what the cells are of."""
    parts = [
        pd.DataFrame({"map": name, **dict(zip(FORCES, each.force.T, strict=True)), **each.quantities})
        for name, each in (("before", extras.map), ("after", extras.map_after)) if each is not None
    ]  # fmt: skip
    return pd.concat(parts, ignore_index=True) if parts else None


def _maps_of(folder: Path, cells: Mapping[str, Any]) -> dict[str, Map | None]:
    table = read_parquet(folder / MAP)[0] if (folder / MAP).is_file() else pd.DataFrame({"map": []})
    maps: dict[str, Map | None] = {}
    for name, places in cells.items():
        rows = table[table["map"] == name].drop(columns="map")
        quantities = {str(each): rows[each].to_numpy(dtype=float) for each in rows if each not in FORCES}
        force = rows[[each for each in FORCES if each in rows]].to_numpy(dtype=float)
        maps[name] = None if places is None else Map(tuple(map(_place_of, places)), force, quantities)
    return maps


def _tracks_table(tracks: Tracks | None) -> pd.DataFrame | None:
    """A row a window and second; columns like ``before_north_m``."""
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
    return pd.DataFrame(columns)


def _tracks_of(table: pd.DataFrame) -> Tracks:
    windows = int(table["window"].nunique())
    first = table[table["second"] == 0]
    ways = {
        way: table[[f"{way}_{name}" for name in _TRACK]].to_numpy(dtype=float).reshape(windows, -1, len(_TRACK))
        for way in _WAYS
    }
    return Tracks(
        **ways, leg=first["leg"].to_numpy(dtype=np.int64), start_s=first["start_s"].to_numpy(dtype=np.int64)
    )


def _units(table: pd.DataFrame) -> dict[str, str]:
    """Units by the names' endings, in a spelling for people."""
    endings = {"_m": "m", "_rad": "rad", "_s": "s", "_mps": "m/s", "_dps": "deg/s", "_deg": "deg", "rpm": "rpm"}
    named = {str(name): unit for name in table for ending, unit in endings.items() if str(name).endswith(ending)}
    return named | {name: unit for name, unit in _FORCE_UNITS.items() if name in table}


def _write_json(values: Mapping[str, Any], path: Path) -> Path:
    from hybrid.diagnosis.result import finite

    try:
        path.write_text(json.dumps(finite(dict(values))) + "\n", encoding="utf-8")
    except OSError as error:
        raise storage_error(path, error) from error
    return path


def read_json(path: Path) -> dict[str, Any]:
    """A JSON object. Raises :class:`InputError` for anything else."""
    try:
        return dict(json.loads(path.read_text(encoding="utf-8")))
    except FileNotFoundError as error:
        raise InputError(
            "does not exist", where=str(path), fix="give the folder that `seatrial diagnose` wrote"
        ) from error
    except (OSError, ValueError) as error:
        raise InputError("cannot be read", where=str(path), why=str(error)) from error
