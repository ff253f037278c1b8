"""Table III in the terminal, as CSV, and beside the paper's."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Iterator
from pathlib import Path

from rich.table import Table

from analysis.tables.files import atomic_file
from hybrid.prediction.scores import Interval
from hybrid.report.evaluation_tables import spread
from hybrid.reproduction.table3 import PUBLISHED, Row, Table3

_COLUMNS = ("north\nm", "east\nm", "distance m", "less\nerror", "gap\nclosed", "in\n95 %", "random\nm",
            "less\nerror")  # fmt: skip
QUANTITY = {"reduction_x": "north", "reduction_y": "east", "reduction": "distance"}


def terminal_tables(table: Table3) -> Iterator[Table]:
    """A table of methods for each sea state, then the published reductions beside ours."""
    for sea_state in dict.fromkeys(row.sea_state for row in table.rows):
        yield methods_table(sea_state, [row for row in table.rows if row.sea_state == sea_state])
    yield cells_table(table)


def methods_table(sea_state: str, rows: list[Row]) -> Table:
    """One row a method: sequences never seen, and in the last columns the paper's random split."""
    unseen = {row.method: row for row in rows if row.split == "sequence"}
    mixed = {row.method: row for row in rows if row.split == "random"}
    some = next(iter(unseen.values()))
    table = _table(f"{sea_state}: {counts_of(some)}", *_COLUMNS)
    for method, row in unseen.items():
        leak = mixed[method]
        table.add_row(
            method, f"{row.mae_x_m.value:.2f}", f"{row.mae_y_m.value:.2f}", spread(row.mean_distance_m),
            f"{row.reduction.value:.1%}", f"{row.removable_gap_closed.value:.0%}", share(row.coverage_95),
            f"{leak.mean_distance_m.value:.2f}", f"{leak.reduction.value:.0%}",
            style="bold" if method == "hybrid" else "",
        )  # fmt: skip
    for each in PUBLISHED:
        if each.sea_state == sea_state:
            figures = (f"{each.mae_x_m:.2f}", f"{each.mae_y_m:.2f}", f"{each.mean_distance_m:.2f}")
            table.add_row(f"published {each.method}", *figures, f"{each.reduction:.1%}", style="dim")
    return table


def cells_table(table: Table3) -> Table:
    """The published reductions, ours with their intervals, and whether ours are above."""
    above = sum(cell.above for cell in table.cells)
    title = f"reductions on sequences never seen: {above} of {len(table.cells)} above the published"
    shown = _table(title, "published", "hybrid", "95 %", "above", "floor", "perfect\nstart", "waves\nonly")
    for cell in table.cells:
        shown.add_row(
            f"{cell.sea_state} {QUANTITY[cell.quantity]}", f"{cell.published:.1%}", f"{cell.hybrid.value:.1%}",
            f"{cell.hybrid.low:.1%} to {cell.hybrid.high:.1%}", "yes" if cell.above else "no",
            f"{cell.floor:.1%}", f"{cell.perfect_start:.1%}", f"{cell.waves_only:.1%}",
        )  # fmt: skip
    return shown


def counts_of(row: Row) -> str:
    """How many sequences of how many seeds a row is of, for people."""
    return f"{row.sequences} sequences never seen, {row.seeds} seed{'' if row.seeds == 1 else 's'}"


def share(interval: Interval) -> str:
    """A share in whole percent; nothing where it is not known."""
    return "" if math.isnan(interval.value) else f"{interval.value:.0%}"


def write_table3(table: Table3, folder: Path) -> tuple[Path, Path]:
    """Write ``table3.json`` and ``table3.csv``, which has the rows. Raises :class:`StorageError`."""
    plain = table.as_dict()
    as_json, as_csv = folder / "table3.json", folder / "table3.csv"
    with atomic_file(as_json) as partial:
        partial.write_text(json.dumps(plain, indent=2) + "\n", encoding="utf-8")
    with atomic_file(as_csv) as partial, partial.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.DictWriter(stream, fieldnames=list(plain["rows"][0]))
        writer.writeheader()
        writer.writerows(plain["rows"])
    return as_json, as_csv


def _table(title: str, *columns: str) -> Table:
    table = Table(title=title, title_justify="left", box=None, header_style="dim", padding=(0, 1, 0, 0))
    table.add_column("", no_wrap=True)
    for column in columns:
        table.add_column(column, justify="right", no_wrap=True)
    return table
