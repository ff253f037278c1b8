"""Table III in a terminal, as CSV and JSON, and as ``table3.html``, with its figures and with what falls short; and
how the reproduction gets on while it runs.
"""

from __future__ import annotations

import csv
import json
import math
import os
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from math import ceil
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure
from rich.console import Group

from seatrial.acquisition.core.errors import InputError
from seatrial.acquisition.core.files import atomic_file, read_json, write_text, written_together
from seatrial.acquisition.core.result import terminal_table
from seatrial.analysis.report.pages import Page, render
from seatrial.analysis.report.plots import FAINT
from seatrial.hybrid.prediction.baselines import Interval
from seatrial.hybrid.report.plots import COLOUR, draw_interval_bar, set_logarithmic_axis
from seatrial.hybrid.report.text import estimate_text, plain, prevent_line_breaks, sections, templates
from seatrial.notebooks.wang2021.campaign import SEA_STATES, SeaResults
from seatrial.notebooks.wang2021.figures import FIGURES, FigureSpec
from seatrial.notebooks.wang2021.table3 import PUBLISHED, Reduction, Row, Table3, read_table3, table3

HEADER = ["method", "north [m]", "east [m]", "distance [m]", "less than reference", "removable gap closed",
          "in the 95 % region", "random split [m]", "less than reference"]  # fmt: skip
CELLS_HEADER = ["", "published", "hybrid", "95 % interval", "floor", "perfect start", "waves only", "above"]

_NARROW = ["", "north\nm", "east\nm", "distance m", "less\nerror", "gap\nclosed", "in\n95 %", "random\nm",
           "less\nerror"]  # fmt: skip
"""The columns of :data:`HEADER` where a line has 80 characters."""

_TIGHT: dict[str, Any] = {"padding": (0, 1, 0, 0)}
TABLE = "table3.json"
QUANTITY = {"reduction_x": "north", "reduction_y": "east", "reduction": "distance"}
GAP_WANTED = 0.95

CAMPAIGN_S = 60.0
"""What a campaign takes on one core [s], four methods trained under either split; measured on a server of 2026."""


def table3_view(table: Table3) -> Group:
    """A table of methods for each sea state, then the published reductions beside ours."""
    shown = []
    for rows in by_sea_state(table):
        lines, best = method_rows(rows)
        shown.append(terminal_table(f"{rows[0].sea_state}: {counts_of(rows[0])}", _NARROW, lines, best, **_TIGHT))
    above = sum(cell.above for cell in table.cells)
    title = f"reductions on sequences never seen: {above} of {len(table.cells)} above the published"
    narrow = [title.replace("perfect ", "perfect\n").replace("waves ", "waves\n") for title in CELLS_HEADER]
    return Group(*shown, terminal_table(title, narrow, cell_rows(table), **_TIGHT))


def draw_table3(figure: Figure, table: Table3) -> None:
    """The mean distance of every method on sequences never seen, with its interval, a panel a sea state."""
    states = by_sea_state(table)
    for axes, rows in zip(figure.subplots(1, len(states), sharey=True, squeeze=False)[0], states, strict=True):
        unseen = [row for row in rows if row.split == "sequence"]
        for place, row in enumerate(unseen):
            draw_interval_bar(axes, row.mean_distance_m, place, COLOUR.get(row.method, FAINT))
        axes.set_yticks(range(len(unseen)), [plain(row.method) for row in unseen])
        axes.set_title(rows[0].sea_state, loc="left")
        axes.set_xlabel("mean distance [m]")
        set_logarithmic_axis(axes, "x", [row.mean_distance_m for row in unseen])
    figure.axes[0].invert_yaxis()


def counts_of(row: Row) -> str:
    """How many sequences of how many seeds a row is of, for people."""
    return f"{row.sequences} sequences never seen, {row.seeds} seed{'' if row.seeds == 1 else 's'}"


def share(interval: Interval) -> str:
    """A share in whole percent; nothing where it is not known."""
    return "" if math.isnan(interval.value) else f"{interval.value:.0%}"


def write_table3(table: Table3, folder: Path) -> tuple[Path, Path]:
    """Write ``table3.json`` and ``table3.csv``, which has the rows. Raises :class:`StorageError`."""
    plain = table.as_dict()
    as_json, as_csv = folder / TABLE, folder / "table3.csv"
    with written_together(as_json):
        write_text(as_json, json.dumps(plain, indent=2) + "\n")
        with atomic_file(as_csv) as partial, partial.open("w", encoding="utf-8", newline="") as stream:
            writer = csv.DictWriter(stream, fieldnames=list(plain["rows"][0]))
            writer.writeheader()
            writer.writerows(plain["rows"])
    return as_json, as_csv


def write_page(folder: Path) -> Path:
    """Write ``table3.html`` of what ``seatrial reproduce`` left in a folder: its table, its figures, or both.

    Raises :class:`InputError` as :func:`results_of`, :class:`StorageError`.
    """
    page = render(
        "table3.html", templates=templates(), title="The paper's results, reproduced",
        subtitle="Wang, Li et al. 2021: mean errors of predictions on sequences never seen", **results_of(folder),
    )  # fmt: skip
    return page.write(folder / "table3.html")


def shortfalls(table: Table3) -> list[str]:
    """A sentence for each published reduction not reached and each removable gap not closed."""
    return [_cell_short(cell) for cell in table.cells if not cell.above] + [
        f"{row.sea_state}: the hybrid closes {row.removable_gap_closed.value:.0%} of the removable gap "
        f"({row.removable_gap_closed.low:.0%} to {row.removable_gap_closed.high:.0%}), less than {GAP_WANTED:.0%}."
        for row in table.rows
        if (row.method, row.split) == ("hybrid", "sequence") and row.removable_gap_closed.value < GAP_WANTED
    ]


def _cell_short(cell: Reduction) -> str:
    text = (
        f"{cell.sea_state}, {QUANTITY[cell.quantity]}: {cell.hybrid.value:.1%} ({cell.hybrid.low:.1%} to "
        f"{cell.hybrid.high:.1%}) less error than the reference, where the paper states {cell.published:.1%}"
    )
    if max(cell.floor, cell.perfect_start) > cell.published:
        return f"{text}."
    return (
        f"{text}; the true model reaches {cell.floor:.1%} only from the same measurements, and "
        f"{cell.perfect_start:.1%} from the ship's true state: the rest is gusts and waves ahead."
    )


def by_sea_state(table: Table3) -> list[list[Row]]:
    """The rows of each sea state."""
    states = dict.fromkeys(row.sea_state for row in table.rows)
    return [[row for row in table.rows if row.sea_state == state] for state in states]


def method_rows(rows: list[Row]) -> tuple[list[list[str]], int | None]:
    """The methods of one sea state, never seen beside the random split, the paper's own below, and the hybrid's
    place."""
    unseen = [row for row in rows if row.split == "sequence"]
    mixed = {row.method: row for row in rows if row.split == "random"}
    lines = []
    for row in unseen:
        leaky = mixed.get(row.method)
        leak = ["", ""] if leaky is None else [f"{leaky.mean_distance_m.value:.2f}", f"{leaky.reduction.value:.1%}"]
        lines.append([
            row.method, f"{row.mae_x_m.value:.2f}", f"{row.mae_y_m.value:.2f}", estimate_text(row.mean_distance_m),
            f"{row.reduction.value:.1%}", f"{row.removable_gap_closed.value:.0%}", share(row.coverage_95), *leak,
        ])  # fmt: skip
    for published in PUBLISHED:
        if published.sea_state == unseen[0].sea_state:
            errors = [f"{value:.2f}" for value in (published.mae_x_m, published.mae_y_m, published.mean_distance_m)]
            reduction = f"{published.reduction:.1%}" if published.reduction else ""
            lines.append([f"published {published.method}", *errors, "", "", "", errors[-1], reduction])
    return lines, next((place for place, row in enumerate(unseen) if row.method == "hybrid"), None)


def for_page(lines: list[list[str]]) -> list[list[str]]:
    """The same lines in a page's words, their cells in one line each."""
    return [[prevent_line_breaks(plain(cell)) for cell in line] for line in lines]


def cell_rows(table: Table3) -> list[list[str]]:
    """The published reductions, ours with intervals, and what the true model reaches."""
    return [
        [f"{cell.sea_state}, {QUANTITY[cell.quantity]}", f"{cell.published:.1%}", f"{cell.hybrid.value:.1%}",
         f"{cell.hybrid.low:.1%} to {cell.hybrid.high:.1%}", f"{cell.floor:.1%}", f"{cell.perfect_start:.1%}",
         f"{cell.waves_only:.1%}", "yes" if cell.above else "no"]
        for cell in table.cells
    ]  # fmt: skip


def is_reproduced(folder: Path) -> bool:
    """Whether a folder holds any results of the reproduction."""
    return (folder / TABLE).is_file() or bool(drawn_in(folder))


def drawn_in(folder: Path, names: Sequence[str] = ()) -> dict[Path, FigureSpec]:
    """The pictures of the reproduction that a folder holds, all or those named, and what is said of each."""
    paths = {folder / f"{name}.png": figure for name, figure in FIGURES.items() if not names or name in names}
    return {path: figure for path, figure in paths.items() if path.is_file()}


def results_of(folder: Path) -> dict[str, Any]:
    """What the page shows of a folder that ``seatrial reproduce`` wrote.

    Raises :class:`InputError` where it holds nothing of the reproduction, or a table that cannot be read.
    """
    if not is_reproduced(folder):
        raise InputError("contains neither Table III nor its figures", where=str(folder),
                         fix="run `seatrial reproduce table3 -o` that folder")  # fmt: skip
    path = folder / TABLE
    try:
        table = read_table3(read_json(path)) if path.is_file() else None
    except Exception as error:  # what others wrote into it may fail in every possible way
        raise InputError("was not written by this version", where=str(path), why=f"{type(error).__name__} {error}",
                         fix="run `seatrial reproduce table3` again") from error  # fmt: skip
    return {"table3": sys.modules[__name__], "table": table, "folder": folder}


def results_sections(folder: Path | str) -> Callable[..., Page]:
    """The function that shows sections of the page of a reproduction.

    Parameters
    ----------
    folder
        The ``output`` of :func:`seatrial.table3` or :func:`seatrial.figures`.

    Returns
    -------
    callable
        ``show(*blocks)``, as of :func:`seatrial.sections`.

    Raises
    ------
    InputError
        Where the folder holds nothing of the reproduction, or a table that cannot be read.

    Examples
    --------
    The reproduction takes minutes:

    >>> import seatrial as st
    >>> show = st.reproduction_sections("reproduction")  # doctest: +SKIP
    >>> show("table")  # doctest: +SKIP
    """
    return sections("table3.html", **results_of(Path(folder)))


@dataclass(slots=True)
class RunningTable:
    """The campaigns finished so far, of ``total``; after each their table goes to ``folder``, if there is one.

    ``say`` takes a line for the user, ``clock`` returns the time [s].
    """

    total: int
    workers: int | None
    folder: Path | None
    say: Callable[[str], None]
    clock: Callable[[], float] = time.monotonic
    seas: list[SeaResults] = field(default_factory=list)
    began_s: float = 0.0

    def announce(self) -> None:
        """Say before the first campaign how many there are and about how long they take."""
        self.began_s = self.clock()
        workers = min(self.workers or os.cpu_count() or 1, self.total)
        about_s = CAMPAIGN_S * ceil(self.total / workers)
        note = f"; what is finished is in {self.folder} after each" if self.folder else ""
        self.say(
            f"{counted(self.total)} of some {duration_text(CAMPAIGN_S)} each on one core, {workers} at a time: "
            f"about {duration_text(about_s)}{note}"
        )

    def add(self, sea: SeaResults) -> None:
        """Keep a campaign that is finished, write the table of all that are, and say how long the rest may take."""
        self.seas.append(sea)
        finished, passed_s = len(self.seas), self.clock() - self.began_s
        if self.folder is not None and finished < self.total:
            write_table3(
                table3(
                    sorted(self.seas, key=lambda result: (SEA_STATES.index(result.job.sea_state), result.job.seed))
                ),
                self.folder,
            )
        remaining = "done"
        if finished < self.total:
            remaining = f"about {duration_text(passed_s / finished * (self.total - finished))} left"
        self.say(
            f"{finished} of {counted(self.total)} after {duration_text(passed_s)}: {sea.job.sea_state} sea, seed "
            f"{sea.job.seed}; {remaining}"
        )


def counted(campaigns: int) -> str:
    """A number of campaigns.

    >>> counted(1), counted(15)
    ('1 campaign', '15 campaigns')
    """
    return f"{campaigns} campaign{'s' * (campaigns != 1)}"


def duration_text(seconds: float) -> str:
    """A time for people, in seconds or minutes.

    >>> duration_text(42.3), duration_text(100.0), duration_text(5400.0)
    ('42 s', '2 min', '90 min')
    """
    return f"{seconds:.0f} s" if seconds < 90.0 else f"{seconds / 60.0:.0f} min"
