"""Files that are sent to a season: a recording, or a table that becomes one, put among the others."""

from __future__ import annotations

import os
import shutil
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import IO

from werkzeug.utils import secure_filename

from seatrial.acquisition.core.errors import InputError, SeatrialError
from seatrial.acquisition.core.files import atomic_file, locked_briefly
from seatrial.acquisition.recording.reader import read_recording
from seatrial.acquisition.tables.import_table import import_proposed, import_table, is_standard, propose_for
from seatrial.acquisition.tables.table_files import read_raw
from seatrial.analysis.serve.limited import call_limited
from seatrial.analysis.tables.table import channels_of

_LONGEST_NAME_BYTES = 200  # of 255, for what is added while it is written


def receive(stream: IO[bytes], filename: str, folder: Path) -> tuple[Path, list[str]]:
    """Put a recording, or a table as a recording, into a folder; its path, and what was found in it.

    Raises :class:`InputError` for what cannot be read, also where it ends the process that reads it, for a table
    that leaves a question open, and where a recording of that name is there; :class:`StorageError` for what the
    folder does not take.
    """
    name = secure_filename(filename).lstrip("-")  # or a shell would take it for an option
    if not name or len(name.encode()) > _LONGEST_NAME_BYTES:
        raise InputError("has an invalid file name", where=repr(filename[:_LONGEST_NAME_BYTES]), fix="rename it")
    with TemporaryDirectory(prefix="seatrial-") as place:
        source = Path(place) / name
        with source.open("wb") as copy:
            shutil.copyfileobj(stream, copy)
        try:
            lines = call_limited(make_recording, str(source))
        except SeatrialError as error:  # whoever sent it knows nothing of our folders
            raise InputError(str(error).replace(f"{place}/", ""), where=name) from error
        return _put(_recording_path(source), folder), lines


def make_recording(source: str) -> list[str]:
    """Make a recording of a file, beside it, unless it is one, and say what is in it."""
    path = Path(source)
    recording = _recording_path(path)
    if recording == path:
        return [f"{len(channels_of(read_recording(path)))} channels"]
    raw = read_raw(path)
    if is_standard(raw):
        return [str(import_table(path, recording))]
    proposal = propose_for(raw)
    if proposal.unanswered:
        raise InputError(
            f"leaves an open question: {proposal.unanswered[0]}",
            fix="import it with `seatrial import`, which accepts the answer",
        )
    summary = import_proposed(raw, proposal, recording, recording.with_suffix(".columns.toml"))
    return [str(summary), *proposal.warnings]


def _recording_path(source: Path) -> Path:
    return source if source.suffix.lower() == ".mcap" else source.with_suffix(".mcap")


def _put(recording: Path, folder: Path) -> Path:
    """Copy a file into a folder, complete or not at all; one of that name stays as it is."""
    target = folder / f"{recording.stem}.mcap"
    with locked_briefly(target):
        if os.path.lexists(target):
            raise InputError("already exists", where=target.name, fix="rename the file and upload it again")
        with atomic_file(target) as partial:
            shutil.copyfile(recording, partial)
    return target
