"""What is made of one recording: read once, and everything a season's index needs written into one folder.

A result is written under another name and renamed when it is complete, so an interruption leaves no half of
one. Its bytes depend on the recording, the options and the versions alone: there is no time of day and no
place of the working folder in it.
"""

from __future__ import annotations

import json
import shutil
import sys
import tempfile
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

from acquisition.core.errors import InputError, SeatrialError, StorageError, storage_error
from acquisition.recording.trial import software_version
from analysis.batch.products import Options, Products, analysed
from analysis.batch.row import Row, plain, row_of
from analysis.manoeuvres import as_json
from analysis.tables.export import FLAG_MEANING, unit_of
from analysis.tables.files import write_parquet
from analysis.tables.provenance import history_of, provenance_of, sha256_of
from analysis.windows.recordings import write_windows

SUMMARY = "summary.json"


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
    row = row_of(products, provenance)
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


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write values as JSON for people and programs."""
    path.write_text(json.dumps(plain(content), indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def _write(products: Products, row: Row, provenance: Mapping[str, Any], folder: Path) -> None:
    """All files of a result, each with its origin and history in it."""
    from analysis.report.recording_page import recording_page

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
