"""``table3.html``: the reproduction on one page, with its figures and with what falls short."""

from __future__ import annotations

from pathlib import Path

from analysis.report.rendering import render
from hybrid.report.evaluation_tables import spread
from hybrid.report.show import templates
from hybrid.report.words import plain, unbroken
from hybrid.reproduction.figures import FIGURES, Shown
from hybrid.reproduction.table3 import PUBLISHED, Cell, Row, Table3
from hybrid.reproduction.tables import QUANTITY, counts_of, share

__all__ = ["FIGURES", "counts_of"]  # for the template

GAP_WANTED = 0.95
HEADER = ["method", "north [m]", "east [m]", "distance [m]", "less than reference", "removable gap closed",
          "in the 95 % region", "random split [m]", "less than reference"]  # fmt: skip


def write_page(table: Table3, folder: Path, shown: Shown | None = None) -> Path:
    """Write ``table3.html``, with figures if there is something to be ``shown``. Raises :class:`StorageError`."""
    page = render(
        "table3.html", templates=templates(), title="The paper's Table III, reproduced", table=table, shown=shown,
        subtitle="Mean errors of predictions on sequences never seen",
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


def _cell_short(cell: Cell) -> str:
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
    lines = [_line(row, mixed.get(row.method)) for row in unseen]
    for each in PUBLISHED:
        if each.sea_state == unseen[0].sea_state:
            errors = [f"{value:.2f}" for value in (each.mae_x_m, each.mae_y_m, each.mean_distance_m)]
            less = f"{each.reduction:.1%}" if each.reduction else ""
            lines.append([unbroken(f"published {each.method}"), *errors, "", "", "", errors[-1], less])
    return lines, next((place for place, row in enumerate(unseen) if row.method == "hybrid"), None)


def _line(row: Row, mixed: Row | None) -> list[str]:
    leak = ["", ""] if mixed is None else [f"{mixed.mean_distance_m.value:.2f}", f"{mixed.reduction.value:.1%}"]
    return [
        unbroken(plain(row.method)), f"{row.mae_x_m.value:.2f}", f"{row.mae_y_m.value:.2f}",
        unbroken(spread(row.mean_distance_m)), f"{row.reduction.value:.1%}",
        f"{row.removable_gap_closed.value:.0%}", share(row.coverage_95), *leak,
    ]  # fmt: skip


def cell_rows(table: Table3) -> list[list[str]]:
    """The published reductions, ours with intervals, and what the true model reaches."""
    return [
        [f"{cell.sea_state}, {QUANTITY[cell.quantity]}", f"{cell.published:.1%}", f"{cell.hybrid.value:.1%}",
         f"{cell.hybrid.low:.1%} to {cell.hybrid.high:.1%}", f"{cell.floor:.1%}", f"{cell.perfect_start:.1%}",
         f"{cell.waves_only:.1%}", "yes" if cell.above else "no"]
        for cell in table.cells
    ]  # fmt: skip
