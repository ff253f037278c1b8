"""A file that somebody sends: imported as `seatrial import` does, under a safe name, over nothing that is there."""

from __future__ import annotations

import shutil
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import IO

from werkzeug.utils import secure_filename

from acquisition.core.errors import InputError, SeatrialError
from acquisition.recording.reader import read_recording
from acquisition.tables.import_table import import_proposed, import_table, is_standard, propose_for
from acquisition.tables.table_files import read_raw
from analysis.tables.table import channels_of


def receive(stream: IO[bytes], filename: str, folder: Path) -> tuple[Path, list[str]]:
    """Put a recording, or a table as a recording, into a folder; its path, and what was found in it.

    Raises :class:`InputError` for what cannot be read, for a table that leaves a question open, and where a
    recording of that name is there.
    """
    name = secure_filename(filename)
    if not name:
        raise InputError("has an invalid file name", where=repr(filename), fix="rename it")
    with TemporaryDirectory(prefix="seatrial-") as place:
        given = Path(place) / name
        with given.open("wb") as copy:
            shutil.copyfileobj(stream, copy)
        try:
            made, said = _recording_of(given)
        except SeatrialError as error:
            raise error.at(name) from error
        return _put(made, folder), said


def _recording_of(given: Path) -> tuple[Path, list[str]]:
    if given.suffix.lower() == ".mcap":
        return given, [f"{len(channels_of(read_recording(given)))} channels"]
    made, raw = given.with_suffix(".mcap"), read_raw(given)
    if is_standard(raw):
        return made, [str(import_table(given, made))]
    proposal = propose_for(raw)
    if proposal.unanswered:
        raise InputError(
            f"leaves an open question: {proposal.unanswered[0]}", where=given.name,
            fix="import it with `seatrial import`, which accepts the answer",
        )  # fmt: skip
    summary = import_proposed(raw, proposal, made, made.with_suffix(".columns.toml"))
    return made, [str(summary), *proposal.warnings]


def _put(made: Path, folder: Path) -> Path:
    """Copy a file into a folder; one of that name stays as it is."""
    target = folder / f"{made.stem}.mcap"
    try:
        with target.open("xb") as copy, made.open("rb") as stream:
            shutil.copyfileobj(stream, copy)
    except FileExistsError as error:
        raise InputError("already exists", where=target.name, fix="rename the file and upload it again") from error
    return target
