"""The commands ashore that need no model: export, windows."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from acquisition.cli import AsJson, Output


def mount(app: typer.Typer) -> None:
    """Add this package's commands to the command line."""
    app.command("export", help="Write a recording as a table: Parquet, CSV or .mat.")(export)
    app.command("windows", help="Cut the windows in which the thrusters were held.")(windows)


def export(
    file: Annotated[Path, typer.Argument(help="A recording.")],
    output: Output,
    rate: Annotated[float | None, typer.Option(help="Resample to so many rows a second; raw without it.")] = None,
) -> None:
    """Write a recording as a table."""
    from analysis.export import export_table
    from analysis.resample import resample
    from analysis.table import read_table

    table = read_table(file)
    if rate is not None:
        table = resample(table, rate)
    export_table(table, output, rate)
    typer.echo(f"{len(table):,} rows of {len(table.columns)} channels", err=True)
    typer.echo(output)


def windows(
    files: Annotated[list[Path], typer.Argument(help="Recordings.")],
    output: Output,
    horizon: Annotated[int, typer.Option(min=1, help="The length of a window [s].")] = 15,
    stride: Annotated[int, typer.Option(min=1, help="A window is tried every so many seconds.")] = 5,
    as_json: AsJson = False,
) -> None:
    """Cut held windows out of recordings."""
    from acquisition.progress import bar
    from analysis.windows import tables_of_recordings, windows_of_tables, write_windows

    with bar("windows") as progress:
        found = windows_of_tables(tables_of_recordings(files, progress), horizon, stride)
    write_windows(found, output)
    summary = {
        "recordings": len(files),
        "candidates": found.candidates,
        "kept": found.kept,
        "dropped": found.dropped,
    }
    if as_json:
        typer.echo(json.dumps(summary))
        return
    reasons = ", ".join(f"{count} {reason}" for reason, count in found.dropped.items()) or "none"
    recordings = "1 recording" if len(files) == 1 else f"{len(files)} recordings"
    typer.echo(
        f"{found.kept} of {found.candidates} windows of {horizon} s held, in {found.legs} legs of {recordings}; "
        f"dropped: {reasons}",
        err=True,
    )
    typer.echo(output)
