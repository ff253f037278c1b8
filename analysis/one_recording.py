"""What is made of one recording: read once, and everything a season's index needs written into one folder.

A result is written under another name and renamed when it is complete, so an interruption leaves no half of
one. Its bytes depend on the recording, the options and the versions alone: there is no time of day and no
place of the working folder in it.
"""

from __future__ import annotations

import json
import math
import shutil
import sys
import tempfile
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from acquisition.channels import NAMES
from acquisition.errors import InputError, SeatrialError, StorageError, storage_error
from acquisition.recording.reader import Recording, read_recording
from acquisition.trial import software_version
from analysis.export import FLAG_MEANING, SIGMA_SUFFIX, unit_of
from analysis.history import history_of, with_step
from analysis.manoeuvres import Manoeuvre, as_json, find_manoeuvres
from analysis.parquet import write_parquet
from analysis.provenance import provenance_of, sha256_of
from analysis.quality.check import DataQuality, check_recording
from analysis.quality.repairs import Repair, Repaired, rebuilding_positions, repair
from analysis.resample import resample
from analysis.smooth import Smoothed, smooth
from analysis.table import require, table_of
from analysis.window_starts import with_starts
from analysis.windows import HeldWindows, held_windows, write_windows

Row = dict[str, Any]
"""One recording in the index: plain values by name, see :func:`process`."""

SUMMARY = "summary.json"
GRADES = ("good", "suspect", "bad")
KEY_INDICES = frozenset({
    "first_overshoot_deg", "second_overshoot_deg", "overshoot_mean_deg", "advance_m", "transfer_m",
    "tactical_diameter_m", "steady_diameter_m", "speed_mps", "track_reach_m", "head_reach_m",
})  # fmt: skip
NOT_CLOSED = "was not closed and is read as far as it goes; see what is missing with `seatrial recover`"
"""The remark on a recording that was cut off: done, and explained."""

_COURSE_STEP_S = 5  # distances are summed over means of so long, or the noise of a position adds to them
_THUMBNAIL_POINTS = 60


@dataclass(frozen=True, slots=True)
class Options:
    """What a result depends on besides its recording.

    ``repair`` applies the repairs that are certain, ``smooth`` gives the motion its standard deviations,
    ``pictures`` go on the page (the two that take time); windows cover ``horizon_s`` [s] and are tried every
    ``stride_s`` [s]; ``length_m`` [m] is the ship's, for distances in ship lengths; ``rebuild_positions``, with the
    repairs, takes the path that speeds and heading give for the positions.
    """

    repair: bool = True
    smooth: bool = True
    pictures: bool = True
    horizon_s: int = 15
    stride_s: int = 5
    length_m: float | None = None
    rebuild_positions: bool = False


@dataclass(slots=True)
class Products:
    """All that came of one recording.

    ``table`` has the raw samples, after repairs if there were any; ``one_hz`` is it once a second, motion from
    the smoother with a column ``<name>_sigma`` beside each where that was made. ``shortfalls`` says in one line
    each what could not be made, and why.
    """

    recording: Recording
    quality: DataQuality
    table: pd.DataFrame
    one_hz: pd.DataFrame
    repairs: tuple[Repair, ...] = ()
    windows: HeldWindows | None = None
    manoeuvres: tuple[Manoeuvre, ...] = ()
    shortfalls: list[str] = field(default_factory=list)

    @contextmanager
    def step(self) -> Iterator[None]:
        """A step that may turn out to be impossible: that is a shortfall, said once, and not the end."""
        try:
            yield
        except SeatrialError as error:
            if (cause := cause_of(error)) not in self.shortfalls:
                self.shortfalls.append(cause)


def origin_of(path: Path, options: Options, name: str = "") -> dict[str, Any]:
    """What a result rests on, before it is made: the recording's ``name``, size [bytes] and SHA-256, the options,
    the versions.

    Two results of equal origin are equal. Raises :class:`InputError` for what cannot be read.
    """
    if path.is_dir():
        raise InputError("is a folder, not a recording", where=str(path), fix="rename the folder")
    try:
        size = path.stat().st_size
    except OSError as error:
        raise InputError("cannot be read", where=str(path), why=error.strerror or str(error)) from error
    digest = sha256_of(path)
    if digest is None:
        raise InputError("cannot be read", where=str(path), fix="check its permissions")
    packages = {name: version(name) for name in ("numpy", "pandas", "scipy", "pyarrow")}
    software = {"seatrial": software_version(), "python": sys.version.split()[0], **packages}
    return {
        "recording": name or path.stem,
        "bytes": size,
        "sha256": digest,
        "options": asdict(options),
        "software": software,
    }


def process(path: Path | str, folder: Path | str, options: Options | None = None, name: str = "") -> Row:
    """Read a recording and write all that is made of it into ``folder``, which it replaces as a whole.

    ``name`` is what windows and legs are called by, the file's name without it; recordings whose windows are to
    be joined need different ones. Written are ``quality.json`` and ``flags.parquet``, ``table.parquet`` (1 Hz),
    ``windows.parquet``, ``manoeuvres.json``, ``page.html`` and ``summary.json``, which is the row that is
    returned: what the recording is, counts, ``status`` and ``cause``. What can be made of an incomplete recording
    is made; its status is ``failed`` and its cause says what is missing. Raises :class:`InputError` for what is
    no recording, :class:`DataShortageError` for one without samples, :class:`StorageError` when a result cannot
    be written.
    """
    path, folder, options = Path(path), Path(folder), options or Options()
    provenance = origin_of(path, options, name)
    products = analysed(path, options, name)
    row = summary_of(products, provenance)
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".part-", dir=folder.parent) as place:
            partial = Path(place) / folder.name
            partial.mkdir()
            _write(products, row, provenance, partial)
            _put(partial, folder)
    except OSError as error:
        raise error if isinstance(error, SeatrialError) else storage_error(folder, error) from error
    return row


def _put(partial: Path, folder: Path) -> None:
    """Give a complete result its name; the older one goes, and one that came in between is as good as ours."""
    if folder.exists() and not (folder / SUMMARY).is_file():
        raise StorageError("is there and is no result of an earlier batch", where=str(folder),
                           fix="name another output folder")  # fmt: skip
    with suppress(FileNotFoundError):
        folder.rename(partial.with_name("older"))
    try:
        partial.rename(folder)
    except OSError:
        if not (folder / SUMMARY).is_file():
            raise


def reusable(path: Path, folder: Path, options: Options, name: str = "") -> Row | None:
    """The row of an earlier result that is as good as a new one, ``None`` where there is none."""
    try:
        row: Row = json.loads((folder / SUMMARY).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return row if row.get("provenance") == json.loads(json.dumps(origin_of(path, options, name))) else None


def analysed(path: Path, options: Options, name: str = "") -> Products:
    """The analysis of one recording, step by step; what its channels do not allow is left out and said."""
    recording = read_recording(path)
    raw = table_of(recording)
    raw.attrs["recording"] = name or path.stem  # not its path, which differs from place to place
    quality = check_recording(recording, raw)
    findings = rebuilding_positions(quality.findings, raw) if options.rebuild_positions else quality.findings
    mended = repair(raw, findings, quality.flags, recording) if options.repair else Repaired(raw, ())
    one_hz = resample(mended.table, 1.0)
    products = Products(recording, quality, mended.table, one_hz, mended.repairs)
    with products.step():
        require(one_hz)
        products.windows = held_windows(one_hz, options.horizon_s, options.stride_s, trial=name or path.stem)
    with products.step():
        products.manoeuvres = find_manoeuvres(mended.table, options.length_m, recording.events)
    if options.smooth:
        with products.step():
            motion = smooth(mended.table, 1.0)
            products.one_hz = _with_motion(one_hz, motion)
            if products.windows is not None:
                products.windows = with_starts(products.windows, {name or path.stem: motion})
    return products


def _with_motion(one_hz: pd.DataFrame, motion: Smoothed) -> pd.DataFrame:
    """The motion and its rates of change from the smoother, the standard deviation of each beside it."""
    states, sigmas = (each.reindex(one_hz.index) for each in (motion.states, motion.standard_deviations()))
    both = {str(name): states[name] for name in states}
    both |= {f"{name}{SIGMA_SUFFIX}": sigmas[name] for name in sigmas}
    return with_step(one_hz, "smooth", rate_hz=1.0).assign(**both)


def cause_of(error: BaseException) -> str:
    """What failed in one line that is the same for all recordings of one fault: without the file's path."""
    if isinstance(error, SeatrialError):
        return str(type(error)(error.what, why=error.why, fix=error.fix))
    trace, where = error.__traceback__, ""
    while trace is not None:
        where = f"{Path(trace.tb_frame.f_code.co_filename).name}:{trace.tb_lineno}"
        trace = trace.tb_next
    return " ".join(f"{type(error).__name__}: {error} ({where})".split())


def summary_of(products: Products, provenance: Mapping[str, Any]) -> Row:
    """The row of a recording: plain values only, NaN as ``None``."""
    recording, one_hz, windows = products.recording, products.one_hz, products.windows
    trial, missing = recording.trial, missing_channels(products.table)
    row: Row = {
        "status": "failed" if products.shortfalls else "done",
        "cause": "; ".join(products.shortfalls) or ("" if recording.closed else NOT_CLOSED),
        "vessel": trial.vessel,
        "trial": trial.name,
        "place": trial.place,
        "start": one_hz.index[0].isoformat(),
        "duration_s": float(len(one_hz) - 1),
        "distance_m": distance_m(one_hz),
        "samples": sum(int(series.value.size) for series in recording.series.values()),
        "channels": len(NAMES) - len(missing),
        "missing": missing,
        "closed": recording.closed,
        "grade": max((each.grade for each in products.quality.channels.values()), key=GRADES.index, default=""),
        "findings": len(products.quality.findings),
        "findings_by_code": dict(Counter(each.code for each in products.quality.findings)),
        "repairs": len(products.repairs),
        "manoeuvres": dict(Counter(each.kind for each in products.manoeuvres)),
        "indices": key_indices(products.manoeuvres),
        "windows_kept": windows.kept if windows else None,
        "windows_candidates": windows.candidates if windows else None,
        "windows_dropped": windows.dropped if windows else {},
        "legs": windows.legs if windows else None,
        "track": thumbnail(one_hz),
        "provenance": dict(provenance),
    }
    return dict(plain(row))


def missing_channels(table: pd.DataFrame) -> list[str]:
    """Those of the 13 channels that have no value at all; no check can judge them."""
    return [name for name in NAMES if name not in table or not table[name].notna().any()]


def key_indices(manoeuvres: Iterable[Manoeuvre]) -> dict[str, float]:
    """The indices that a season is compared by: the median of each over a recording's manoeuvres of a kind."""
    values: dict[str, list[float]] = {}
    for each in manoeuvres:
        for name in KEY_INDICES & set(each.indices):
            values.setdefault(f"{each.kind}_{name}", []).append(each.indices[name].value)
    return {name: float(np.median(values[name])) for name in sorted(values)}


def distance_m(one_hz: pd.DataFrame) -> float | None:
    """The distance sailed over ground [m]: between means of its position over 5 s, straight across holes.

    ``None`` where there are not two of them.
    """
    if not {"north_m", "east_m"} <= set(one_hz.columns):
        return None
    position = one_hz[["north_m", "east_m"]].to_numpy()
    steps = position[: len(position) // _COURSE_STEP_S * _COURSE_STEP_S].reshape(-1, _COURSE_STEP_S, 2)
    means = steps.mean(axis=1)
    means = means[np.isfinite(means).all(axis=1)]
    if len(means) < 2:
        return None
    return float(np.hypot(*np.diff(means, axis=0).T).sum())


def thumbnail(one_hz: pd.DataFrame) -> str:
    """The track as points of a polyline in a square of 100 by 100, north up and to scale; empty without one."""
    if not {"north_m", "east_m"} <= set(one_hz.columns):
        return ""
    track = one_hz[["east_m", "north_m"]].dropna().to_numpy() * [1.0, -1.0]
    if len(track) < 2:
        return ""
    chosen = track[np.unique(np.linspace(0, len(track) - 1, _THUMBNAIL_POINTS).astype(int))]
    middle, size = (chosen.max(axis=0) + chosen.min(axis=0)) / 2.0, max(np.ptp(chosen, axis=0).max(), 1.0)
    return " ".join(f"{x:.0f},{y:.0f}" for x, y in 50.0 + 92.0 * (chosen - middle) / size)


def plain(value: Any) -> Any:
    """A value as JSON has it: numbers of Python, no NaN, times as ISO 8601."""
    if isinstance(value, Mapping):
        return {str(key): plain(each) for key, each in value.items()}
    if isinstance(value, np.ndarray | list | tuple):
        return [plain(each) for each in value]
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, pd.Timestamp):
        return value.isoformat()
    return None if isinstance(value, float) and not math.isfinite(value) else value


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write values as JSON for people and programs."""
    path.write_text(json.dumps(plain(content), indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def _write(products: Products, row: Row, provenance: Mapping[str, Any], folder: Path) -> None:
    """All files of a result, each with its origin and history in it."""
    from analysis.recording_page import recording_page

    origin = {"provenance": plain(provenance), "history": plain(history_of(products.one_hz))}
    about = {key: json.dumps(value) for key, value in origin.items()}
    trial = {"trial": json.dumps(plain(products.recording.trial.as_metadata())), "rate_hz": "1.0"}
    units = {str(name): unit for name in products.one_hz.columns if (unit := unit_of(str(name)))}
    write_parquet(products.one_hz, folder / "table.parquet", units, {**about, **trial})
    write_parquet(products.quality.flags, folder / "flags.parquet", {}, {**about, "meaning": FLAG_MEANING})
    repairs = [asdict(each) for each in products.repairs]
    write_json(folder / "quality.json", {**products.quality.as_json(), "repairs": repairs, **origin})
    write_json(folder / "manoeuvres.json", {"manoeuvres": as_json(products.manoeuvres), **origin})
    if products.windows is not None:
        whence = provenance_of(products.one_hz, provenance["options"], products.recording.path)
        named = {provenance["recording"]: plain(whence)}
        write_windows(replace(products.windows, provenance=named), folder / "windows.parquet")
    recording_page(products, row).write(folder / "page.html")
    write_json(folder / SUMMARY, row)


def clear_partials(out: Path) -> None:
    """Remove what interrupted runs left below ``out``; nobody else may be writing there."""
    for partial in out.rglob(".part-*"):
        shutil.rmtree(partial, ignore_errors=True)
