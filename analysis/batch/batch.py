"""A batch of recordings: each processed on a worker process, and one index over all of them.

The index has one row a recording, as Parquet for programs and as a page for people. Results whose recording is no
longer there have rows too, with the status ``gone``: nothing is removed.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import unicodedata
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd

from seatrial.acquisition.core.errors import DataShortageError, InputError, Progress, printable_name
from seatrial.acquisition.core.files import LOCK, read_json, written_together
from seatrial.acquisition.recording.grouping import whole_recordings
from seatrial.analysis.batch.one_recording import SUMMARY, Row, process_recording, reusable_row, write_json
from seatrial.analysis.batch.workers import MARKS, BatchJob, Task, attempt, batch_folder, check_address, run_jobs
from seatrial.analysis.manoeuvres.indices import Manoeuvre
from seatrial.analysis.manoeuvres.report import criteria_by_vessel
from seatrial.analysis.products import Options
from seatrial.analysis.report.pages import index_page
from seatrial.analysis.tables.files import read_parquet, write_parquet

Failures = list[tuple[str, list[str]]]
"""Causes and the names of the recordings that failed of each, the most frequent first."""
REPORT = "report.html"
"""A notebook report beside a result, which the page leads to where there is one."""
GONE = "gone"
"""The status of a result whose recording is not in the folder any more."""
TEXTS = ("name", "path", "status", "cause", "vessel", "trial", "place", "grade")
MEASURES = {"duration_s": "s", "distance_m": "m"}
COUNTS = ("samples", "channels", "findings", "repairs", "windows_kept", "windows_candidates", "legs")
NESTED_COUNTS = ("findings_by_code", "windows_dropped", "manoeuvres", "left_out", "criteria")
_LONGEST_NAME_BYTES, _DIGEST_LETTERS = 245, 12  # file systems take 255; ten are for underscores
_NUMBER = re.compile(r"\d[\d,.]*\d|\d")
CRITERIA = "criteria.json"
"""What the recordings of each ship together show of the standards' criteria."""
_RESERVED = {"index.html", "index.parquet", CRITERIA, MARKS, LOCK}


@dataclass(frozen=True, slots=True)
class BatchSummary:
    """What a batch came to. ``done`` counts those with a complete result, ``reused`` those of them not new.

    ``gone_rows`` are of results whose recording is not in the folder any more; they are in the index only.
    ``files`` are those of each recording, by the name of its row.
    """

    rows: list[Row]
    done: int
    reused: int
    index: Path
    gone_rows: tuple[Row, ...] = ()
    files: Mapping[str, tuple[Path, ...]] = field(default_factory=dict)

    @property
    def gone(self) -> tuple[str, ...]:
        return tuple(row["name"] for row in self.gone_rows)

    @property
    def failed(self) -> int:
        """The number of recordings without a complete result."""
        return len(self.rows) - self.done

    @property
    def failures(self) -> Failures:
        """The failed recordings by cause, the most frequent first."""
        return failures_of(self.rows)

    def as_json(self) -> dict[str, Any]:
        """The summary as `--json` prints it."""
        grouped = [{"cause": cause, "recordings": names} for cause, names in self.failures]
        return {
            "recordings": len(self.rows), "done": self.done, "reused": self.reused, "failed": self.failed,
            "failures": grouped, "gone": list(self.gone), "index": str(self.index),
        }  # fmt: skip


def run_batch(
    folder: Path | str,
    out: Path | str,
    workers: int | None = None,
    scheduler: str | None = None,
    options: Options | None = None,
    progress: Progress = lambda share: None,
    *,
    again: bool = False,
    timeout_s: float | None = None,
    task: Task | None = None,
) -> BatchSummary:
    """Process every ``*.mcap`` below ``folder`` into ``out``, parts of one recording as one, and write the index.

    ``workers`` is the number of processes, that of the cores without it; ``scheduler`` an address like
    ``tcp://host:8786`` instead. Results of equal provenance are used as they are unless ``again``. A
    recording that takes longer than ``timeout_s`` [s] fails. ``task`` stands in for the work of one recording.
    Raises :class:`InputError` for a folder or an address that is none, :class:`DataShortageError` for one without
    recordings, :class:`SourceError` for a scheduler that cannot be reached, :class:`StorageError` when
    ``out`` cannot be written or another batch is writing there.
    """
    folder, out = Path(folder), Path(out).resolve()
    if folder.resolve().is_relative_to(out):
        raise InputError("the recordings are in the output folder", where=str(out), fix="name another with -o")
    check_address(scheduler)
    recordings = recordings_below(folder, out)
    if not recordings:
        raise DataShortageError("contains no recording", where=str(folder), fix="name a folder with .mcap files")
    names, chosen = names_of(folder, recordings), options or Options()
    jobs = [
        BatchJob(
            name,
            str(paths[0].absolute()),
            str(out),
            chosen,
            again,
            timeout_s,
            tuple(str(path.absolute()) for path in paths[1:]),
        )
        for name, paths in zip(names, recordings, strict=True)
    ]
    with batch_folder(out):
        rows = run_jobs(jobs, task or process_job, workers, scheduler, progress)
        for row, paths in zip(rows, recordings, strict=True):
            row["path"] = printable_name(paths[0].relative_to(folder))
        reused = sum(row.pop("reused", False) and row["status"] == "done" for row in rows)
        gone = gone_rows(set(names), out)
        index = write_index([*rows, *gone], out, printable_name(folder.resolve().name))
        write_json(out / CRITERIA, {"criteria": criteria_of_ships(rows, out)})
    done = sum(row["status"] == "done" for row in rows)
    return BatchSummary(rows, done, reused, index, tuple(gone), dict(zip(names, recordings, strict=True)))


def criteria_of_ships(rows: Sequence[Row], out: Path) -> list[dict[str, Any]]:
    """The criteria of each ship from the manoeuvres of all her recordings, with the keys of ``manoeuvres``."""
    runs: dict[str, list[Manoeuvre]] = {}
    for row in rows:
        if row["status"] == "done" and row.get("manoeuvres"):
            document = json.loads((out / row["name"] / "manoeuvres.json").read_text(encoding="utf-8"))
            runs.setdefault(row["vessel"], []).extend(map(Manoeuvre.from_json, document["manoeuvres"]))
    return criteria_by_vessel(runs)


def process_job(job: BatchJob) -> Row:
    """What a worker does for one recording: a row comes back whatever happens, short of the worker's death."""
    return attempt(job, result_of)


def result_of(job: BatchJob) -> Row:
    """The row of a recording: that of an earlier result if it is as good as a new one, else of one made now."""
    path, later = Path(job.path), tuple(map(Path, job.later))
    row = None if job.again else reusable_row(path, job.folder, job.options, job.name, later)
    if row is not None and is_row(row):
        return {**row, "reused": True}
    return process_recording(path, job.folder, job.options, job.name, later)


def recordings_below(folder: Path, out: Path) -> list[tuple[Path, ...]]:
    """What is called ``*.mcap`` below a folder, in the order of its names, the output folder left out.

    The files of a recording in parts stand together. A folder that cannot be looked into stands for what is in it.
    """
    if not folder.is_dir():
        raise InputError("is no folder" if folder.exists() else "does not exist", where=str(folder),
                         fix="give the folder of the recordings")  # fmt: skip
    paths: list[Path] = []
    unreadable: list[OSError] = []
    for root, folders, files in os.walk(folder, onerror=unreadable.append):
        folders[:] = [name for name in folders if os.path.realpath(Path(root, name)) != str(out)]
        names = (name for name in (*folders, *files) if name.endswith(".mcap") and not name.startswith("."))
        paths += (Path(root, name) for name in names)
    return whole_recordings(sorted({*paths, *(Path(error.filename) for error in unreadable)}))


def names_of(folder: Path, recordings: Sequence[Sequence[Path]]) -> list[str]:
    """A name for each recording below a folder: :func:`result_names` of their first files."""
    return result_names([paths[0].relative_to(folder).as_posix() for paths in recordings])


def result_names(paths: list[str]) -> list[str]:
    r"""A name for each recording's result: its relative path without suffix, changed where two would meet.

    It is fit for any file system, page and program: bytes that are no text and control characters are escaped, what
    is too long for a folder is shortened, nothing is hidden, and two names differ in more than case and encoding.

    >>> result_names(["a.mcap", "a/b.mcap", "index.html.mcap", ".c/B.mcap", "_c/b.mcap"])
    ['a_', 'a/b', 'index.html_', '_c/B', '_c/b_']
    """
    texts = ["/".join(map(_folder_name, path.removesuffix(".mcap").split("/"))) for path in paths]
    taken = set(
        map(_comparable, _RESERVED | {parent.as_posix() for text in texts for parent in Path(text).parents})
    )
    names = []
    for name in texts:
        while _comparable(name) in taken:
            name += "_"
        taken.add(_comparable(name))
        names.append(name)
    return names


def _folder_name(text: str) -> str:
    """A part of a path as the name of a folder for its result."""
    name = printable_name(text)
    name = f"_{name[1:]}" if name.startswith(".") else name
    if len(name.encode()) > _LONGEST_NAME_BYTES:
        digest = hashlib.sha256(os.fsencode(text)).hexdigest()[:_DIGEST_LETTERS]
        kept = name.encode()[: _LONGEST_NAME_BYTES - _DIGEST_LETTERS - 1]
        name = f"{kept.decode(errors='ignore')}~{digest}"
    return name


def _comparable(name: str) -> str:
    """What is equal for names that some file systems take for one."""
    return unicodedata.normalize("NFC", unicodedata.normalize("NFC", name).casefold())


def failures_of(rows: Sequence[Mapping[str, Any]]) -> Failures:
    """Failed recordings by cause; causes that differ in their numbers only are one, with N for each number.

    >>> failures_of([{"name": str(n), "status": "failed", "cause": f"damaged near byte {n}"} for n in (1, 2)])
    [('damaged near byte N', ['1', '2'])]
    """
    groups: dict[str, list[Mapping[str, Any]]] = {}
    for row in rows:
        if row["status"] == "failed":
            groups.setdefault(_NUMBER.sub("N", row["cause"]), []).append(row)
    named = []
    for pattern, failed in groups.items():
        causes = {row["cause"] for row in failed}
        named.append((causes.pop() if len(causes) == 1 else pattern, sorted(row["name"] for row in failed)))
    return sorted(named, key=lambda failure: (-len(failure[1]), failure[0]))


def is_row(values: Mapping[str, Any]) -> bool:
    """Whether values from a file are a row of the index, and not what another program, or a person, wrote there."""
    try:
        index_table([values])
    except Exception:  # whatever pandas makes of them
        return False
    return True


def index_table(rows: Sequence[Mapping[str, Any]]) -> pd.DataFrame:
    """The rows as a table with the same kinds of columns whatever failed: counts are whole or missing.

    Counts by code, by reason and by kind stand in columns of their own, like ``findings_by_code.spikes``.
    """
    columns: dict[str, Any] = {name: _array([row.get(name) or "" for row in rows], "str") for name in TEXTS}
    columns["closed"] = _array([row.get("closed") for row in rows], "boolean")
    missing = [None if row.get("missing") is None else " ".join(row["missing"]) for row in rows]
    columns["missing"] = _array(missing, "str")
    starts = _array([row.get("start") for row in rows], "object")
    columns["start"] = pd.to_datetime(starts, utc=True, format="ISO8601").dt.as_unit("ns")
    for name, dtype in (dict.fromkeys(MEASURES, "Float64") | dict.fromkeys(COUNTS, "Int64")).items():
        columns[name] = _array([row.get(name) for row in rows], dtype)
    for name in NESTED_COUNTS:
        columns |= _nested(rows, name, "Int64", 0)
    columns |= _nested(rows, "indices", "Float64", None)
    for name in ("bytes", "sha256", "options", "software"):
        values = [row.get("provenance", {}).get(name) for row in rows]
        texts = [json.dumps(value) if isinstance(value, dict) else value for value in values]
        columns[name] = _array(texts, "Int64" if name == "bytes" else "str")
    return pd.DataFrame(columns)


def _nested(rows: Sequence[Mapping[str, Any]], name: str, dtype: str, absent: int | None) -> dict[str, Any]:
    """A column for each key of the mappings called ``name``; ``absent`` where a recording was judged without it."""
    keys = sorted({key for row in rows for key in row.get(name) or {}})
    return {
        f"{name}.{key}": _array(
            [None if row.get(name) is None else row[name].get(key, absent) for row in rows], dtype
        )
        for key in keys
    }


def _array(values: Sequence[Any], dtype: str) -> Any:
    return pd.Series(list(values), dtype=dtype)


def gone_rows(names: Collection[str], out: Path) -> list[dict[str, Any]]:
    """The rows of complete results below ``out`` that belong to none of ``names``, in the order of their names."""
    rows = []
    for path in sorted(out.rglob(SUMMARY)):
        name = path.parent.relative_to(out).as_posix()
        try:
            row = read_json(path)
            ours = name not in names and row["provenance"]["recording"] == name and is_row(row)
        except (OSError, ValueError, LookupError, TypeError):
            continue  # somebody else's file of that name
        if ours:
            rows.append({**row, "name": name, "status": GONE, "cause": "its recording is not there any more"})
    return rows


def write_index(rows: Sequence[Mapping[str, Any]], out: Path, title: str) -> Path:
    """Write ``index.parquet`` and ``index.html`` into ``out`` and return the path of the page.

    Raises :class:`seatrial.acquisition.core.errors.StorageError` when they cannot be written.
    """
    rows = [{**row, "report": (out / row["name"] / REPORT).is_file()} for row in rows]
    with written_together(out / "index.parquet"):
        write_parquet(index_table(rows), out / "index.parquet", MEASURES, {"batch": json.dumps({"of": title})})
        return index_page(rows, failures_of(rows), title).write(out / "index.html")


def read_index(path: Path | str) -> pd.DataFrame:
    """The index as a table. Raises :class:`InputError` for any other file."""
    return read_parquet(path)[0]
