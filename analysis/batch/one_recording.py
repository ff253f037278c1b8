"""Everything that is made of one recording: read once, and what the index needs written into one folder.

A result is written under another name and renamed when it is complete, so an interruption leaves no half of
one. Its bytes depend on the recording, the options and the versions alone: there is no time of day and no
working folder in it.
"""

from __future__ import annotations

import json
import sys
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from seatrial.acquisition.core.errors import (
    DataShortageError,
    InputError,
    SeatrialError,
    StorageError,
    printable_name,
    storage_error,
)
from seatrial.acquisition.core.files import read_json, temporary_folder, write_text
from seatrial.acquisition.core.result import to_json
from seatrial.acquisition.core.ship import known_channels
from seatrial.acquisition.core.trial import software_version
from seatrial.acquisition.recording.grouping import read_parts
from seatrial.acquisition.recording.reader import Recording, recording_size
from seatrial.analysis.conditions import recorded_conditions
from seatrial.analysis.manoeuvres.criteria import criteria_of, index_rows
from seatrial.analysis.manoeuvres.indices import Manoeuvre, as_json, from_order
from seatrial.analysis.manoeuvres.report import criteria_by_vessel
from seatrial.analysis.products import Options, Products, analyse
from seatrial.analysis.speed_power import power_columns, speed_power
from seatrial.analysis.tables.export import FLAG_MEANING, unit_of
from seatrial.analysis.tables.files import write_parquet
from seatrial.analysis.tables.table import history_of, provenance_of, required_channels, sha256_of, table_of
from seatrial.analysis.windows.recordings import write_windows

Row = dict[str, Any]
"""One recording in the index: plain values by name, see :func:`row_of`."""
SUMMARY = "summary.json"
WAITING = "waiting"
"""The status of a recording that is not analysed yet."""
GRADES = ("good", "suspect", "bad")
KEY_INDICES = frozenset({
    "overshoot_1_deg", "overshoot_2_deg", "overshoot_mean_deg", from_order(1), from_order(2), "advance_m",
    "transfer_m", "tactical_diameter_m", "steady_diameter_m", "speed_over_ground_mps", "speed_through_water_mps",
    "track_reach_m", "head_reach_m",
})  # fmt: skip
NOT_CLOSED = "was not closed and is read as far as it goes; see what is missing with `seatrial recover`"
"""The remark on a recording that was cut off: done, and explained."""
_COURSE_STEP_S = 5  # distances are summed over means of so long, or the noise of a position adds to them
_THUMBNAIL_POINTS = 60


def process_recording(
    path: Path | str, folder: Path | str, options: Options | None = None, name: str = "", later: Sequence[Path] = ()
) -> Row:
    """Read a recording and write all that is made of it into ``folder``, which it replaces as a whole.

    ``later`` are the parts after the one at ``path``, of a recording in parts.

    ``name`` is what windows and legs are called by, the file's name without it; recordings whose windows are to
    be joined need different ones. Written are ``quality.json`` and ``flags.parquet``, ``table.parquet`` (1 Hz),
    ``windows.parquet``, ``manoeuvres.json``, ``page.html`` and ``summary.json``, which is the row that is
    returned: what the recording is, counts, ``status`` and ``cause``. What can be made of an incomplete recording
    is made; its status is ``failed`` and its cause says what is missing. Raises :class:`InputError` for what is
    no recording, :class:`DataShortageError` for one without samples, :class:`StorageError` when a result cannot
    be written.
    """
    paths, folder, options = (Path(path), *later), Path(folder), options or Options()
    provenance = origin_of(paths, options, name)
    products = analyse(paths, options, name)
    row = row_of(products, provenance)
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with temporary_folder(folder) as place:
            partial = place / folder.name
            partial.mkdir()
            _write(products, row, provenance, partial)
            _put(partial, folder)
    except OSError as error:
        raise error if isinstance(error, SeatrialError) else storage_error(folder, error) from error
    return row


def origin_of(paths: Sequence[Path], options: Options, name: str = "") -> dict[str, Any]:
    """What a result rests on, before it is made: the recording's ``name``, size [bytes] and SHA-256, the options,
    the versions.

    Two results of equal origin are equal. Raises :class:`InputError` for what cannot be read.
    """
    size = sum(map(recording_size, paths))
    digest = sha256_of(*paths)
    if digest is None:
        raise InputError("cannot be read", where=str(paths[0]), fix="check its permissions")
    packages = {name: version(name) for name in ("numpy", "pandas", "scipy", "pyarrow")}
    software = {"seatrial": software_version(), "python": sys.version.split()[0], **packages}
    return {
        "recording": name or printable_name(paths[0].stem),
        "bytes": size,
        "sha256": digest,
        "options": asdict(options),
        "software": software,
    }


def _put(partial: Path, folder: Path) -> None:
    """Give a complete result its name; the older one goes, and one that came in between is as good as ours."""
    if folder.exists() and not (folder / SUMMARY).is_file():
        raise StorageError("exists and is not a result of an earlier batch", where=str(folder),
                           fix="name another output folder")  # fmt: skip
    with suppress(FileNotFoundError):
        folder.rename(partial.with_name("older"))
    try:
        partial.rename(folder)
    except OSError:
        if not (folder / SUMMARY).is_file():
            raise


def reusable_row(
    path: Path, folder: Path, options: Options, name: str = "", later: Sequence[Path] = ()
) -> Row | None:
    """The row of an earlier result that is as good as a new one, ``None`` where there is none."""
    try:
        row: Row = dict(read_json(folder / SUMMARY))
    except (OSError, ValueError, TypeError):
        return None
    origin = json.loads(json.dumps(origin_of((path, *later), options, name)))
    return row if row.get("provenance") == origin else None


def _write(products: Products, row: Row, provenance: Mapping[str, Any], folder: Path) -> None:
    """All files of a result, each with its origin and history in it."""
    from seatrial.analysis.report.pages import recording_page

    origin = {"provenance": to_json(provenance), "history": to_json(history_of(products.one_hz))}
    about = {key: json.dumps(value) for key, value in origin.items()}
    trial = {"trial": json.dumps(to_json(products.recording.trial.as_metadata())), "rate_hz": "1.0"}
    channels = known_channels(products.one_hz.attrs)
    units = {str(name): unit for name in products.one_hz.columns if (unit := unit_of(str(name), channels))}
    write_parquet(products.one_hz, folder / "table.parquet", units, {**about, **trial})
    write_parquet(products.quality.flags, folder / "flags.parquet", {}, {**about, "meaning": FLAG_MEANING})
    repairs = [asdict(repair) for repair in products.repairs]
    write_json(folder / "quality.json", {**products.quality.as_json(), "repairs": repairs, **origin})
    left_out = [manoeuvre.as_json() for manoeuvre in products.left_out]
    criteria = criteria_by_vessel({products.recording.trial.vessel: products.manoeuvres})
    results = {"manoeuvres": as_json(products.manoeuvres), "left_out": left_out, "criteria": criteria}
    write_json(folder / "manoeuvres.json", {**results, **origin})
    if products.windows is not None:
        whence = provenance_of(products.one_hz, provenance["options"], products.recording.path)
        named = {provenance["recording"]: to_json({**whence, "recording_sha256": provenance["sha256"]})}
        write_windows(replace(products.windows, provenance=named), folder / "windows.parquet")
    recording_page(products, row).write(folder / "page.html")
    write_json(folder / SUMMARY, row)


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write values as JSON for people and programs."""
    write_text(path, json.dumps(to_json(content), indent=1, ensure_ascii=False) + "\n")


def row_of(products: Products, provenance: Mapping[str, Any]) -> Row:
    """The row of a recording: plain values only, NaN as ``None``."""
    recording, one_hz, windows = products.recording, products.one_hz, products.windows
    missing = missing_channels(products.table)
    row: Row = {
        "status": "failed" if products.shortfalls else "done",
        "cause": "; ".join(products.shortfalls) or "; ".join(remarks_on(recording)),
        **_recording_row(recording),
        "start": one_hz.index[0].isoformat(),
        "duration_s": float(len(one_hz) - 1),
        "distance_m": distance_m(one_hz),
        "channels": len(required_channels(products.table)) - len(missing),
        "missing": missing,
        "grade": max(
            (channel.grade for channel in products.quality.channels.values()), key=GRADES.index, default=""
        ),
        "findings": len(products.quality.findings),
        "findings_by_code": dict(Counter(finding.code for finding in products.quality.findings)),
        "repairs": len(products.repairs),
        "manoeuvres": dict(Counter(manoeuvre.kind for manoeuvre in products.manoeuvres)),
        "left_out": dict(Counter(manoeuvre.kind for manoeuvre in products.left_out)),
        "indices": key_indices(products.manoeuvres) | speed_at_power(products),
        "criteria": _criteria_counts(products.manoeuvres),
        "windows_kept": windows.kept if windows else None,
        "windows_candidates": windows.candidates if windows else None,
        "windows_dropped": windows.dropped if windows else {},
        "legs": windows.legs if windows else None,
        "track": thumbnail(one_hz),
        "provenance": dict(provenance),
    }
    return dict(to_json(row))


def _criteria_counts(runs: Sequence[Manoeuvre]) -> dict[str, int]:
    """How many criteria of the standards have which result; none of a recording without a test of one."""
    rows = index_rows(runs)
    has_test = any(row.criterion for row in rows)
    return dict(Counter(result.result for result in criteria_of(rows))) if has_test else {}


def remarks_on(recording: Recording) -> list[str]:
    """What a reader of the results has to know of a recording of which all could be made."""
    return [remark for remark in ("" if recording.closed else NOT_CLOSED, recording.clock) if remark]


def first_look(paths: Sequence[Path]) -> Row:
    """What a recording, a file or its parts, tells before it is analysed: whose it is, when, how much, its track.

    Raises as :func:`process_recording` does, but for writing.
    """
    recording = read_parts(paths)
    table = table_of(recording)
    row = {
        "status": WAITING, "cause": "", **_recording_row(recording), "start": table.index[0].isoformat(),
        "duration_s": (table.index[-1] - table.index[0]).total_seconds(), "track": thumbnail(table),
    }  # fmt: skip
    return dict(to_json(row))


def _recording_row(recording: Recording) -> Row:
    """What a row says of a recording itself."""
    return {
        "vessel": recording.trial.vessel,
        "trial": recording.trial.name,
        "place": recording.trial.place,
        "samples": sum(int(series.value.size) for series in recording.series.values()),
        "closed": recording.closed,
        "parts": len(recording.paths),
    }


def missing_channels(table: pd.DataFrame) -> list[str]:
    """Those channels of the ship's trials that have no value at all; no check can judge them."""
    return [name for name in required_channels(table) if name not in table or not table[name].notna().any()]


def key_indices(manoeuvres: Iterable[Manoeuvre]) -> dict[str, float]:
    """The indices that a batch is compared by: the median of each over a recording's manoeuvres of a kind."""
    values: dict[str, list[float]] = {}
    for manoeuvre in manoeuvres:
        for name in KEY_INDICES & set(manoeuvre.indices):
            values.setdefault(f"{manoeuvre.kind}_{name}", []).append(manoeuvre.indices[name].value)
    return {name: float(np.median(values[name])) for name in sorted(values)}


def speed_at_power(products: Products) -> dict[str, float]:
    """The speed in still water at the highest power of a speed trial; empty for a recording that is none."""
    if not power_columns(products.table):
        return {}
    recording = products.recording
    try:
        result = speed_power(
            [products.table], recorded_conditions(recording.trial, products.table), recording.events
        )
    except (DataShortageError, InputError):
        return {}
    return {"speed_power_kw": result.fastest.power_kw, "speed_power_mps": result.fastest.speed_mps}


def distance_m(one_hz: pd.DataFrame) -> float | None:
    """The distance sailed over ground [m]: between means of its position over 5 s, straight across holes.

    ``None`` where there are not two of them.
    """
    position = one_hz.reindex(columns=["north_m", "east_m"]).to_numpy(dtype=float)
    steps = position[: len(position) // _COURSE_STEP_S * _COURSE_STEP_S].reshape(-1, _COURSE_STEP_S, 2)
    means = steps.mean(axis=1)
    means = means[np.isfinite(means).all(axis=1)]
    if len(means) < 2:
        return None
    return float(np.hypot(*np.diff(means, axis=0).T).sum())


def thumbnail(one_hz: pd.DataFrame) -> str:
    """The track as points of a polyline in a square of 100 by 100, north up and to scale; empty without one."""
    track = one_hz.reindex(columns=["east_m", "north_m"]).dropna().to_numpy(dtype=float) * [1.0, -1.0]
    if len(track) < 2:
        return ""
    chosen = track[np.unique(np.linspace(0, len(track) - 1, _THUMBNAIL_POINTS).astype(int))]
    middle, size = (chosen.max(axis=0) + chosen.min(axis=0)) / 2.0, max(np.ptp(chosen, axis=0).max(), 1.0)
    return " ".join(f"{x:.0f},{y:.0f}" for x, y in 50.0 + 92.0 * (chosen - middle) / size)
