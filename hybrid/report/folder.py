"""The report of a folder, whose content decides which one.

The page of a diagnosis or a reproduction is written again, recordings get the report of their trial, and the
results of a batch a report for each recording, to which the index then leads.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from markupsafe import Markup

from seatrial.acquisition.config.run_sheet import find_statement_file, read_statement_text
from seatrial.acquisition.core import errors, files, named_code
from seatrial.analysis.batch import SUMMARY, read_index, run_batch, write_index
from seatrial.analysis.products import Options
from seatrial.analysis.report.interactive import interactive_page
from seatrial.analysis.report.pages import render
from seatrial.analysis.tables.table import sha256_of
from seatrial.hybrid.diagnosis.result import read_diagnosis, read_json
from seatrial.hybrid.report import text, trial
from seatrial.hybrid.report.diagnosis import PAGE_FILE, write_report

_REPRODUCTION = "seatrial.notebooks.wang2021.page"

Kind = Literal["diagnosis", "reproduction", "trial", "batch"]

BLOCKS = (
    "cover",
    "criteria",
    "indices",
    "speed_power",
    "figures",
    "model",
    "model_indices",
    "diagnosis",
    "data",
    "methods",
    "files",
)
"""The sections of a trial's report, in their order."""


@dataclass(frozen=True, slots=True)
class Choices:
    """What a trial's report is made with; without a calibrator that of the folder, if there is one in it.

    ``length_m`` is the ship's length between perpendiculars, where no vessel file says it; ``method`` is the code
    of a calibrator of your own, ``FILE.py:CLASS``; ``conditions`` is a file that states what the recordings do not,
    without it ``conditions.toml`` beside them, if there is one.
    """

    calibrator: Path | None = None
    vessel: str | None = None
    horizon_s: int | None = None
    time_range: tuple[float, float] = (0.0, 100.0)
    repair: bool = True
    allow_seen: bool = False
    interactive: bool = True
    length_m: float | None = None
    method: str | None = None
    conditions: Path | None = None


def kind_of_folder(folder: Path) -> Kind:
    """What a folder holds. Raises :class:`InputError` where there is nothing to report on."""
    if (folder / "diagnosis.json").is_file():
        return "diagnosis"
    if named_code.import_object(f"{_REPRODUCTION}:is_reproduced")(folder):
        return "reproduction"
    if (folder / "index.parquet").is_file():
        return "batch"
    if recordings_in_folder(folder):
        return "trial"
    raise errors.InputError(
        "contains nothing to report on",
        where=str(folder),
        why="there is no recording, diagnosis.json, table3.json or index.parquet in it",
        fix="give a recording, or an output folder of `record`, `diagnose`, `reproduce` or `batch`",
    )


def recordings_in_folder(folder: Path) -> list[Path]:
    """The recordings of a trial: those in ``recordings`` where there is such a folder, else those in it."""
    for place in (folder / "recordings", folder):
        if recordings := sorted(path for path in place.glob("*.mcap") if not path.name.startswith(".")):
            return recordings
    return []


def write_reports(
    where: Path, choices: Choices, recordings: Path | None = None, progress: errors.Progress = lambda share: None
) -> list[Path]:
    """Write the report of a folder, or of one recording beside it, and return the paths of its pages.

    ``recordings`` is the folder of a batch. Raises :class:`InputError` where there is nothing to report on.
    """
    folder = folder_for_report(where)
    if where.is_file():
        return [write_trial_report([where], folder, choices, progress)]
    kind = kind_of_folder(where)
    if kind == "batch":
        return write_batch_reports(where, recordings, choices, progress)
    if kind == "trial":
        return write_folder_report(where, choices, progress)
    if kind == "reproduction":
        return [named_code.import_object(f"{_REPRODUCTION}:write_page")(where)]
    diagnosis, extras = read_diagnosis(where)
    try:
        return [write_report(diagnosis, extras, where)]
    except errors.SeatrialError:
        raise
    except Exception as error:  # values that no version writes fail wherever the page first needs them
        raise errors.InputError(
            "was not written by this version",
            where=str(where),
            why=f"{type(error).__name__} {error}",
            fix="run `seatrial diagnose` again",
        ) from error


def folder_for_report(where: Path) -> Path:
    """Where a report goes: a folder itself, for one recording a folder of its name beside it.

    Raises :class:`InputError` for what is neither, :class:`StorageError` where a file is in the way.
    """
    if not where.exists():
        raise errors.InputError("does not exist", where=str(where), fix="give a recording or a folder")
    if not where.is_file():
        return where
    if where.suffix != ".mcap":
        raise errors.InputError(
            "is not a recording",
            where=str(where),
            why="reports are made from .mcap files",
            fix="convert a table with `seatrial import`",
        )
    folder = where.with_suffix("")
    if folder.exists() and not folder.is_dir():
        raise errors.StorageError(
            "is a file, but the report needs a folder with this name", where=str(folder), fix="move it away"
        )
    return folder


def write_folder_report(
    folder: Path,
    choices: Choices,
    progress: errors.Progress = lambda share: None,
    recordings: Sequence[Path] | None = None,
) -> list[Path]:
    """The report of all or some recordings of a trial's folder, and the page of their diagnosis in it."""
    paths = list(recordings or recordings_in_folder(folder))
    calibrator, within = folder / "calibrator", folder / "diagnosis"
    default = calibrator if (calibrator / "calibrator.json").is_file() else None
    completed = replace(choices, calibrator=choices.calibrator or default)
    if not (within / "shown.json").is_file():
        return [write_trial_report(paths, folder, completed, progress)]
    hashes = str(read_json(within / "diagnosis.json").get("provenance", {}).get("recordings_sha256", ""))
    if not set(hashes.split(", ")) <= {sha256_of(path) for path in paths}:
        remark = "The diagnosis in this folder is for other recordings and is left out."
        return [write_trial_report(paths, folder, completed, progress, remark=remark)]
    return [write_trial_report(paths, folder, completed, progress, within), within / PAGE_FILE]


def write_trial_report(
    recordings: Sequence[Path],
    folder: Path,
    choices: Choices,
    progress: errors.Progress = lambda share: None,
    diagnosis: Path | None = None,
    remark: str = "",
) -> Path:
    """``report.html`` in ``folder`` about recordings that belong together, with ``indices.json`` and
    ``criteria.json`` beside it.

    ``diagnosis`` is the folder of their diagnosis, ``remark`` something to say at the top.
    """
    case = trial.load_case(
        recordings,
        choices.calibrator,
        choices.vessel,
        choices.horizon_s,
        time_range=choices.time_range,
        repair=choices.repair,
        allow_seen=choices.allow_seen,
        length_m=choices.length_m,
        method=choices.method,
        statement=read_statement_text(choices.conditions, recordings[0], folder),
    )
    products = case.products  # what is wrong is said before anything is written
    files.make_folder(folder)
    with files.written_together(folder / PAGE_FILE):
        links = dict[str, str]()  # to zoom into, a recording each: what they are called, and their names
        several = len(case.paths) > 1
        for name, recorded in products.items() if choices.interactive else ():
            windows = recorded.window_rows
            predicted = {} if windows is None or case.obstacle else case.predicted(name)
            zoomed = folder / (f"interactive_{name}.html" if several else "interactive.html")
            with suppress(errors.ConfigurationError, errors.DataShortageError):  # without plotly, or without a row
                interactive_page(
                    recorded.one_hz, windows, predicted, recorded.manoeuvres, name, recorded.recording.path.name
                ).write(zoomed)
                links[f"interactive track and channels{f', {name}' if several else ''}"] = zoomed.name
        show = text.sections(
            "trial.html", folder / "figures", case=case, remark=remark, folder=diagnosis, links=links
        )
        parts = []
        for number, block in enumerate(BLOCKS):
            parts.append(show(block).html)
            progress((number + 1) / len(BLOCKS))
        criteria = [{"vessel": vessel, **result.as_json()}
                    for vessel, results in case.criteria.items() for result in results]  # fmt: skip
        files.write_text(folder / "criteria.json", json.dumps(criteria, indent=1) + "\n")
        indices = {name: [run.as_json() for run in recording.manoeuvres] for name, recording in products.items()}
        files.write_text(folder / "indices.json", json.dumps(indices, indent=1) + "\n")
        page = render(
            "base.html", title=f"Sea trial report: {trial.ship_name(case)}", subtitle=trial.report_subtitle(case),
            body=Markup("".join(parts)),  # markup of templates, in which what a recording says is escaped
        )  # fmt: skip
        return page.write(folder / PAGE_FILE)


def write_batch_reports(
    out: Path, recordings: Path | None, choices: Choices, progress: errors.Progress = lambda share: None
) -> list[Path]:
    """A report for each recording of a batch that is done, and the index that leads to them, which comes first.

    Raises :class:`InputError` without the folder of the recordings, whose place no result knows.
    """
    if recordings is None:
        raise errors.InputError(
            "contains the results of a batch without the path of the recordings",
            where=str(out),
            fix="give it with --recordings FOLDER",
        )
    paths = [str(path) for path in read_index(out / "index.parquet")["path"] if path]
    if paths and not any((recordings / path).is_file() for path in paths):
        raise errors.InputError(
            "contains none of the batch's recordings",
            where=str(recordings),
            why=f"these were {', '.join(paths[:3])}{' and more' if len(paths) > 3 else ''}",
            fix="name the folder that `seatrial batch` was given",
        )
    options = batch_options(out)
    summary = run_batch(recordings, out, options=options)
    stated = find_statement_file(choices.conditions, recordings)
    completed = replace(choices, repair=choices.repair and options.repair, conditions=stated)
    pages, failed = list[Path](), dict[str, str]()
    reported = [row for row in summary.rows if row["status"] == "done"]
    for number, row in enumerate(reported):
        share = errors.subtask_progress(progress, number, len(reported))
        try:
            pages.append(write_trial_report(summary.files[row["name"]], out / row["name"], completed, share))
        except errors.SeatrialError as error:
            failed[row["name"]] = str(error)
    index = write_index([*summary.rows, *summary.gone_rows], out, recordings.resolve().name)
    if failed:
        raise errors.SeatrialError(
            f"{len(failed)} of {len(reported)} reports failed: {', '.join(failed)}",
            where=str(index),
            why=next(iter(failed.values())),
        )
    return [index, *pages]


def batch_options(folder: Path) -> Options:
    """The options of a batch, from the first result that says them."""
    for path in sorted(folder.rglob(SUMMARY)):
        try:
            return Options(**read_json(path)["provenance"]["options"])
        except (OSError, ValueError, KeyError, TypeError):  # an InputError is a ValueError
            continue
    raise errors.ConfigurationError(
        "contains no result with known options", where=str(folder), fix="run `seatrial batch` again"
    )
