"""From a folder to its report: what is in it says which notebook tells it.

A diagnosis is told by ``missing_effect``, a reproduction by ``paper_reproduction``, recordings by
``trial_validation``, and the results of a batch by a ``trial_validation`` for each recording, to which the index
then leads.
"""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

from acquisition.core.errors import ConfigurationError, InputError, SeatrialError, StorageError
from acquisition.core.progress import Progress, part_of
from analysis.tables.files import make_folder
from analysis.tables.table import sha256_of
from hybrid.diagnosis.serialisation import read_json
from hybrid.report.case import load_case
from hybrid.report.notebook import run_notebook
from hybrid.reproduction.page import is_reproduced

Kind = Literal["missing_effect", "paper_reproduction", "trial_validation", "batch"]

PAGES = {"missing_effect": "missing_effect.html", "paper_reproduction": "paper_reproduction.html",
         "trial_validation": "report.html"}  # fmt: skip

_NOWHERE: dict[str, str] = {}


@dataclass(frozen=True, slots=True)
class Choices:
    """What a trial's report is made with; without a calibrator that of the folder, if there is one in it."""

    calibrator: Path | None = None
    vessel: str | None = None
    horizon_s: int | None = None
    part: str = "0..100"
    repair: bool = True
    allow_seen: bool = False
    interactive: bool = True


def kind_of(folder: Path) -> Kind:
    """What a folder holds. Raises :class:`InputError` where no notebook tells of it."""
    if (folder / "diagnosis.json").is_file():
        return "missing_effect"
    if is_reproduced(folder):
        return "paper_reproduction"
    if (folder / "index.parquet").is_file():
        return "batch"
    if recordings_in(folder):
        return "trial_validation"
    raise InputError(
        "holds nothing to report on", where=str(folder),
        why="there is no recording, diagnosis.json, table3.json or index.parquet in it",
        fix="give a recording, or a folder that `record`, `diagnose`, `reproduce` or `batch` wrote",
    )  # fmt: skip


def recordings_in(folder: Path) -> list[Path]:
    """The recordings of a trial: those in ``recordings`` where there is such a folder, else those in it."""
    for place in (folder / "recordings", folder):
        if found := sorted(path for path in place.glob("*.mcap") if not path.name.startswith(".")):
            return found
    return []


def report(
    where: Path, choices: Choices, recordings: Path | None = None, progress: Progress = lambda share: None
) -> list[Path]:
    """Write the report of a folder, or of one recording beside it, and return the paths of its pages.

    ``recordings`` is the folder that a batch went through. Raises :class:`InputError` for what cannot be told,
    :class:`SeatrialError` where a notebook fails.
    """
    if not where.exists():
        raise InputError("does not exist", where=str(where), fix="give a recording or a folder")
    if where.is_file():
        return [trial_report([where], _folder_of(where), choices, progress)]
    kind = kind_of(where)
    if kind == "batch":
        return batch_reports(where, recordings, choices, progress)
    if kind == "trial_validation":
        return folder_report(where, choices, progress)
    return [_told(kind, where, progress)]


def _folder_of(recording: Path) -> Path:
    """Where the report of one recording goes: a folder of its name beside it."""
    if recording.suffix != ".mcap":
        raise InputError("is not a recording", where=str(recording), why="a report is of .mcap files",
                         fix="turn a table into one with `seatrial import`")  # fmt: skip
    folder = recording.with_suffix("")
    if folder.exists() and not folder.is_dir():
        raise StorageError("is a file, where the report's folder is to be", where=str(folder), fix="move it away")
    return folder


def _told(kind: Kind, folder: Path, progress: Progress, back: dict[str, str] = _NOWHERE) -> Path:
    """The report of a diagnosis or of the paper's results; ``back`` are links to where it is told from."""
    parameters: dict[str, Any] = {"folder": str(folder.resolve()), "figures_folder": str(_figures(folder))}
    if kind == "missing_effect":
        parameters["beside"] = {"in short: the page of the diagnosis": "report.html"} | back
    return run_notebook(kind, parameters, folder / PAGES[kind], _about(kind, folder), progress)


def _about(kind: Kind, folder: Path) -> str:
    """What a report is about, in a line below its title."""
    if kind != "missing_effect":
        return "Wang, Li et al. 2021, Table III and figures"
    known = read_json(folder / "diagnosis.json").get("provenance", {})
    return f"{known.get('recordings', folder.resolve().name)}, against {known.get('vessel', 'the model')}"


def _figures(folder: Path) -> Path:
    return folder.resolve() / "figures"


def folder_report(
    folder: Path,
    choices: Choices,
    progress: Progress = lambda share: None,
    recordings: Sequence[Path] | None = None,
) -> list[Path]:
    """The report of a trial's folder, of all or some of its recordings, and of the diagnosis of them in it."""
    paths = list(recordings or recordings_in(folder))
    calibrator = choices.calibrator or (folder / "calibrator" if _is_calibrator(folder / "calibrator") else None)
    own, within = replace(choices, calibrator=calibrator), folder / "diagnosis"
    if not (within / "shown.json").is_file():
        return [trial_report(paths, folder, own, progress)]
    if not _is_of(within, paths):
        remark = "The diagnosis in this folder is of other recordings and is left out."
        return [trial_report(paths, folder, own, progress, remark=remark)]
    back = {"the report of the trial": f"../{PAGES['trial_validation']}"}
    story = _told("missing_effect", within, part_of(progress, 0, 2), back)
    return [trial_report(paths, folder, own, part_of(progress, 1, 2), story), story]


def _is_of(diagnosis: Path, recordings: Sequence[Path]) -> bool:
    """Whether a diagnosis is of these recordings, or of some of them, by their hashes."""
    hashes = str(read_json(diagnosis / "diagnosis.json").get("provenance", {}).get("recordings_sha256", ""))
    return set(hashes.split(", ")) <= {sha256_of(path) for path in recordings}


def _is_calibrator(folder: Path) -> bool:
    return (folder / "calibrator.json").is_file()


def trial_report(
    recordings: Sequence[Path],
    folder: Path,
    choices: Choices,
    progress: Progress = lambda share: None,
    story: Path | None = None,
    remark: str = "",
) -> Path:
    """``report.html`` in ``folder`` about recordings that belong together; ``story`` is the page of their
    diagnosis, ``remark`` something to say at the top."""
    load_case(recordings, choices.calibrator, choices.vessel, choices.horizon_s)  # what is wrong is said at once
    make_folder(folder)
    parameters: dict[str, Any] = {
        "recordings": [str(path.resolve()) for path in recordings],
        "calibrator": None if choices.calibrator is None else str(choices.calibrator.resolve()),
        "vessel": choices.vessel,
        "horizon_s": choices.horizon_s,
        "part": choices.part,
        "repair": choices.repair,
        "allow_seen": choices.allow_seen,
        "figures_folder": str(_figures(folder)),
        "diagnosis": None if story is None else str(story.parent.resolve()),
        "story": None if story is None else os.path.relpath(story, folder),
        "remark": remark,
        "interactive": str(folder.resolve()) if choices.interactive else None,
    }
    subtitle = ", ".join(path.name for path in recordings)
    return run_notebook("trial_validation", parameters, folder / PAGES["trial_validation"], subtitle, progress)


def batch_reports(
    out: Path, recordings: Path | None, choices: Choices, progress: Progress = lambda share: None
) -> list[Path]:
    """A report for each recording of a batch that is done, and the index that leads to them, which comes first.

    Raises :class:`InputError` without the folder of the recordings, whose place no result knows.
    """
    from analysis.batch.batch import run_batch, write_index

    if recordings is None:
        raise InputError("holds the results of a batch, which do not know where the recordings are", where=str(out),
                         fix="say it with --recordings FOLDER")  # fmt: skip
    _refuse_elsewhere(out, recordings)
    options = batch_options(out)
    summary = run_batch(recordings, out, options=options)
    own, pages, failed = replace(choices, repair=choices.repair and options.repair), list[Path](), dict[str, str]()
    done = [row for row in summary.rows if row["status"] == "done"]
    for number, row in enumerate(done):
        share = part_of(progress, number, len(done))
        try:
            pages.append(trial_report([recordings / row["path"]], out / row["name"], own, share))
        except SeatrialError as error:
            failed[row["name"]] = str(error)
    index = write_index([*summary.rows, *summary.gone_rows], out, recordings.resolve().name)
    if failed:
        raise SeatrialError(f"{len(failed)} of {len(done)} reports failed: {', '.join(failed)}", where=str(index),
                            why=next(iter(failed.values())))  # fmt: skip
    return [index, *pages]


def _refuse_elsewhere(out: Path, recordings: Path) -> None:
    """Raise :class:`InputError` where none of a batch's recordings lies in the folder that is given for them."""
    from analysis.batch.batch import read_index

    paths = [str(path) for path in read_index(out / "index.parquet")["path"] if path]
    if paths and not any((recordings / path).is_file() for path in paths):
        raise InputError("holds none of the recordings of the batch", where=str(recordings),
                         why=f"it went through {', '.join(paths[:3])}{' and more' if len(paths) > 3 else ''}",
                         fix="name the folder that `seatrial batch` was given")  # fmt: skip


def batch_options(out: Path) -> Any:
    """The options of a batch, from the first result that says them."""
    from analysis.batch.one_recording import SUMMARY
    from analysis.products import Options

    for path in sorted(out.rglob(SUMMARY)):
        try:
            return Options(**json.loads(path.read_text(encoding="utf-8"))["provenance"]["options"])
        except (OSError, ValueError, KeyError, TypeError):
            continue
    raise ConfigurationError(
        "holds no result whose options are known", where=str(out), fix="run `seatrial batch` again"
    )
