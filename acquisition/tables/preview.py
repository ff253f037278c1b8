"""What a proposal took the columns for, as a table for the terminal and as a picture before an import."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from seatrial.acquisition.core.angles import unwrap, wraps_of
from seatrial.acquisition.core.arrays import Floats
from seatrial.acquisition.core.channels import channel_unit, is_circular, known_channels
from seatrial.acquisition.core.files import atomic_file
from seatrial.acquisition.tables.column_map import apply_column_map, column_map_of
from seatrial.acquisition.tables.propose import Proposal
from seatrial.acquisition.tables.table_files import RawTable

if TYPE_CHECKING:
    from rich.table import Table

_MOST_POINTS = 4000  # more cannot be told apart on a page
_TRACK = ("north_m", "east_m", "latitude_deg", "longitude_deg")


def proposal_table(proposal: Proposal) -> Table:
    """The columns, what each was taken for, its unit and the reasons."""
    from rich.table import Table

    table = Table(box=None, header_style="dim", padding=(0, 1, 0, 0))
    for title in ("column", "taken for", "unit", "because"):
        table.add_column(title, overflow="fold")
    for reading in proposal.readings:
        cells = (reading.column, reading.taken_for, reading.unit, "; ".join(reading.reasons))
        table.add_row(*cells, style="dim" if reading.taken_for == "-" else "")
    for name in proposal.passed_over:
        table.add_row(name, "-", "", "not known, ignored", style="dim")
    return table


def draw_preview(raw: RawTable, proposal: Proposal, path: Path) -> None:
    """The track and every channel over time, as the import would have them, into a PNG file.

    Raises :class:`StorageError` where the file cannot be written.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    columns, declared = column_map_of(proposal.text, path)
    file = apply_column_map(raw, columns, path, declared)
    table = file.table.iloc[:: max(1, len(file.table) // _MOST_POINTS)]
    names = [name for name in map(str, table.columns) if name not in _TRACK]
    why = {entry.taken_for: entry for entry in proposal.readings}
    rows = max(4, -(-len(names) // 2))
    figure = Figure(figsize=(14.0, 1.5 * rows + 1.0), layout="constrained")
    grid = figure.add_gridspec(rows, 3, width_ratios=(1.3, 1.0, 1.0))
    track = figure.add_subplot(grid[: -(-rows // 2), 0])
    if {"north_m", "east_m"} <= set(table.columns):
        track.plot(table["east_m"], table["north_m"], color="#1f4e79", linewidth=1.0)
        track.set(xlabel="east [m]", ylabel="north [m]", title=raw.path.name, aspect="equal", adjustable="datalim")
    else:
        track.set_axis_off()
    channels = known_channels({"trial": {"channels": file.trial.channels}})
    for number, name in enumerate(names):
        axes = figure.add_subplot(grid[number % rows, 1 + number // rows])
        axes.plot(*_line(table[name], is_circular(name), table.index[0]), color="#1f4e79", linewidth=0.8)
        reading = why.get(name)
        source = "derived"
        if reading:
            source = reading.column + (f" ({reading.unit})" if reading.unit not in reading.column else "")
        axes.set_title(f"{name}  ←  {source}", fontsize=8, loc="left")
        axes.set_ylabel(channel_unit(name, channels), fontsize=8)
        axes.tick_params(labelsize=7)
    figure.supxlabel(f"minutes since {table.index[0]:%Y-%m-%d %H:%M:%S} UTC", fontsize=8)
    FigureCanvasAgg(figure)
    with atomic_file(path) as partial:
        figure.savefig(partial, format="png")


def _line(column: pd.Series[float], circular: bool, start: pd.Timestamp) -> tuple[Floats, Floats]:
    """Minutes since the start and values of a line; an angle's is broken where it crosses the whole turn."""
    present = column.dropna()
    times = np.asarray((pd.DatetimeIndex(present.index) - start) / pd.Timedelta(minutes=1), dtype=np.float64)
    values: Floats = present.to_numpy().astype(np.float64)
    if not circular or values.size == 0 or np.ptp(unwrap(values)) == 0.0:
        return times, values
    breaks = wraps_of(values)
    return np.insert(times, breaks, times[breaks]), np.insert(values, breaks, np.nan)
