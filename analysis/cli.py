"""The commands ashore that need no model: export, windows, batch."""

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
    app.command("batch", help="All of it for every recording below a folder, with one index; resumes.")(batch)


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


def batch(
    folder: Annotated[Path, typer.Argument(help="A folder with recordings, in folders below it too.")],
    output: Output,
    workers: Annotated[int | None, typer.Option(min=1, help="Worker processes; one a core without it.")] = None,
    scheduler: Annotated[str | None, typer.Option(help="A scheduler that runs, like tcp://host:8786.")] = None,
    horizon: Annotated[int, typer.Option(min=2, help="The length of a window [s].")] = 15,
    stride: Annotated[int, typer.Option(min=1, help="A window is tried every so many seconds.")] = 5,
    length: Annotated[float | None, typer.Option(help="The ship's length [m], for distances in lengths.")] = None,
    no_repair: Annotated[bool, typer.Option("--no-repair", help="Leave what is certainly wrong as it is.")] = False,
    again: Annotated[bool, typer.Option("--again", help="Compute what is there anew.")] = False,
    timeout: Annotated[float | None, typer.Option(min=0.1, help="Give a recording up after so many s.")] = None,
    as_json: AsJson = False,
) -> None:
    """Process a season of recordings."""
    if workers is not None and scheduler is not None:
        raise typer.BadParameter("give --workers or --scheduler, not both")
    from acquisition.progress import bar
    from analysis.batch import run_batch
    from analysis.one_recording import Options

    options = Options(not no_repair, horizon, stride, length)
    try:
        with bar("batch") as progress:
            summary = run_batch(
                folder, output, workers, scheduler, options, progress, again=again, timeout_s=timeout
            )
    except KeyboardInterrupt:
        typer.echo("seatrial: interrupted; what is done stays, the same command goes on from there", err=True)
        raise typer.Exit(130) from None
    for cause, names in summary.failures:
        typer.echo(f"{len(names)} failed: {cause}\n    {', '.join(names)}", err=True)
    if as_json:
        typer.echo(json.dumps(summary.as_json()))
    else:
        typer.echo(f"{summary.done} done, {summary.reused} of them before, {summary.failed} failed", err=True)
        typer.echo(summary.index)
    if summary.failed:
        raise typer.Exit(1)
