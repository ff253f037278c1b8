"""``seatrial report``: it parses, calls and prints."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from acquisition.cli import RECORDINGS, AsJson
from hybrid.cli.options import PartOption, VesselOption


def mount(app: typer.Typer) -> None:
    """Add this package's command to the command line."""
    app.command(
        "report", help="Write one HTML page of a trial, a diagnosis or a batch.", rich_help_panel=RECORDINGS
    )(report)


def report(
    folder: Annotated[
        Path,
        typer.Argument(help="A recording, or a folder of them, or one that diagnose, reproduce or batch wrote."),
    ],
    calibrator: Annotated[
        Path | None, typer.Option(help="The folder that `seatrial train` wrote; without it the one in the folder.")
    ] = None,
    vessel: VesselOption = None,
    horizon: Annotated[
        int | None, typer.Option(min=2, help="How far is predicted in seconds; 15, or what the calibrator does.")
    ] = None,
    part: PartOption = "0..100",
    no_repair: Annotated[bool, typer.Option("--no-repair", help="Leave what is certainly wrong as it is.")] = False,
    allow_seen: Annotated[bool, typer.Option(help="Also recordings that the calibrator was trained on.")] = False,
    recordings: Annotated[
        Path | None, typer.Option(help="For the results of a batch: the folder that it went through.")
    ] = None,
    interactive: Annotated[
        bool, typer.Option("--interactive/--no-interactive", help="Also a page of the track to zoom into.")
    ] = True,
    as_json: AsJson = False,
) -> None:
    """Write the report that a folder asks for."""
    from acquisition.core.progress import bar
    from hybrid.report.folder import Choices
    from hybrid.report.folder import report as run
    from hybrid.report.notebook import FAILED

    choices = Choices(calibrator, vessel, horizon, part, not no_repair, allow_seen, interactive)
    with bar("report") as progress:
        pages = run(folder, choices, recordings, progress)
    if as_json:
        typer.echo(json.dumps({"report": str(pages[0]), "pages": [str(page) for page in pages]}))
        return
    for page in pages:
        typer.echo(page)
        if FAILED in page.read_text(encoding="utf-8"):
            typer.echo(f"warning: a section of {page} failed; its place in the page says why", err=True)
