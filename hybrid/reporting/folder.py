"""From a folder to its report: what is in it says which notebook tells it.

A diagnosis is told by ``missing_effect``, a reproduction by ``paper_reproduction``, recordings by
``trial_validation``, and the results of a batch by a ``trial_validation`` for each recording, to which the index
then leads.
"""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from acquisition.errors import ConfigurationError, InputError
from acquisition.progress import Progress, part_of
from hybrid.reporting.notebook import run_notebook
from hybrid.reproduction.figures import FIGURES

Kind = Literal["missing_effect", "paper_reproduction", "trial_validation", "batch"]

PAGES = {"missing_effect": "missing_effect.html", "paper_reproduction": "paper_reproduction.html",
         "trial_validation": "report.html"}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Choices:
    """What a trial's report is made with; without a calibrator that of the folder, if there is one in it."""

    calibrator: Path | None = None
    vessel: str | None = None
    horizon_s: int | None = None
    part: str = "0..100"
    repair: bool = False
    allow_seen: bool = False
    interactive: bool = True


def kind_of(folder: Path) -> Kind:
    """What a folder holds. Raises :class:`InputError` where no notebook tells of it."""
    if (folder / "diagnosis.json").is_file():
        return "missing_effect"
    if (folder / "table3.json").is_file() or any((folder / f"{name}.png").is_file() for name in FIGURES):
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
        return [trial_report([where], where.with_suffix(""), choices, progress)]
    kind = kind_of(where)
    if kind == "batch":
        return batch_reports(where, recordings, choices, progress)
    if kind == "trial_validation":
        return folder_report(where, choices, progress)
    return [_told(kind, where, progress)]


def _told(kind: Kind, folder: Path, progress: Progress) -> Path:
    """The report of a diagnosis or of the paper's results."""
    parameters = {"folder": str(folder.resolve()), "figures_folder": str(_figures(folder))}
    return run_notebook(kind, parameters, folder / PAGES[kind], _about(kind, folder), progress)


def _about(kind: Kind, folder: Path) -> str:
    """What a report is about, in a line below its title."""
    if kind != "missing_effect":
        return "Wang, Li et al. 2021, Table III and figures"
    known = json.loads((folder / "diagnosis.json").read_text(encoding="utf-8")).get("provenance", {})
    return f"{known.get('recordings', folder.resolve().name)}, against {known.get('vessel', 'the model')}"


def _figures(folder: Path) -> Path:
    return folder.resolve() / "figures"


def folder_report(folder: Path, choices: Choices, progress: Progress = lambda share: None) -> list[Path]:
    """The report of a trial's folder, and of the diagnosis in it where there is one."""
    within = folder / "diagnosis"
    pages = []
    if (within / "shown.json").is_file():
        pages = [_told("missing_effect", within, part_of(progress, 0, 2))]
        progress = part_of(progress, 1, 2)
    calibrator = choices.calibrator or (folder / "calibrator" if _is_calibrator(folder / "calibrator") else None)
    own = Choices(**{**asdict(choices), "calibrator": calibrator})
    return [trial_report(recordings_in(folder), folder, own, progress, pages[0] if pages else None), *pages]


def _is_calibrator(folder: Path) -> bool:
    return (folder / "calibrator.json").is_file()


def trial_report(
    recordings: Sequence[Path],
    folder: Path,
    choices: Choices,
    progress: Progress = lambda share: None,
    diagnosis: Path | None = None,
) -> Path:
    """``report.html`` in ``folder`` about recordings that belong together; ``diagnosis`` is a page to link to."""
    folder.mkdir(parents=True, exist_ok=True)
    parameters: dict[str, Any] = {
        "recordings": [str(path.resolve()) for path in recordings],
        "calibrator": None if choices.calibrator is None else str(choices.calibrator.resolve()),
        "vessel": choices.vessel,
        "horizon_s": choices.horizon_s,
        "part": choices.part,
        "repair": choices.repair,
        "allow_seen": choices.allow_seen,
        "figures_folder": str(_figures(folder)),
        "diagnosis": None if diagnosis is None else str(diagnosis.parent.resolve()),
        "story": None if diagnosis is None else os.path.relpath(diagnosis, folder),
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
    from analysis.season.batch import run_batch
    from analysis.season.index import write_index

    if recordings is None:
        raise InputError("holds the results of a batch, which do not know where the recordings are", where=str(out),
                         fix="say it with --recordings FOLDER")  # fmt: skip
    summary = run_batch(recordings, out, options=batch_options(out))
    done = [row for row in summary.rows if row["status"] == "done" and row["windows_kept"]]
    pages = []
    for number, row in enumerate(done):
        share = part_of(progress, number, len(done))
        pages.append(trial_report([recordings / row["path"]], out / row["name"], choices, share))
    return [write_index([*summary.rows, *summary.gone_rows], out, recordings.resolve().name), *pages]


def batch_options(out: Path) -> Any:
    """The options of a batch, from the first result that says them."""
    from analysis.season.one_recording import SUMMARY
    from analysis.season.products import Options

    for path in sorted(out.rglob(SUMMARY)):
        try:
            return Options(**json.loads(path.read_text(encoding="utf-8"))["provenance"]["options"])
        except (OSError, ValueError, KeyError, TypeError):
            continue
    raise ConfigurationError(
        "holds no result whose options are known", where=str(out), fix="run `seatrial batch` again"
    )
