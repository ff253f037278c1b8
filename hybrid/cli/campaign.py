"""``seatrial campaign``: it parses, calls and prints."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from acquisition.cli import TRIALS, AsJson
from hybrid.cli.options import WorkersOption


def mount(app: typer.Typer) -> None:
    """Add this package's command to the command line."""
    app.command("campaign", help="Simulate many trials: vessels, seas, manoeuvres, seeds.", rich_help_panel=TRIALS)(
        campaign
    )


def campaign(
    file: Annotated[Path, typer.Argument(help="The campaign, a TOML file like trials/campaign.toml.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="The folder that everything goes into.")],
    workers: WorkersOption = None,
    scheduler: Annotated[str | None, typer.Option(help="A scheduler that runs, like tcp://host:8786.")] = None,
    as_json: AsJson = False,
) -> None:
    """Simulate the trials of a campaign that are not there yet."""
    if workers is not None and scheduler is not None:
        raise typer.BadParameter("give --workers or --scheduler, not both")
    from acquisition.core.progress import bar
    from hybrid.simulation.campaigns import load_campaign, run_campaign

    planned = load_campaign(file)
    with bar("campaign") as progress:
        made = run_campaign(planned, output, workers, scheduler, progress)
    for row in made.failed:
        typer.echo(f"{row['name']} failed: {row['cause']}", err=True)
    done = len(made.rows) - len(made.failed)
    if as_json:
        counts = {"trials": len(made.rows), "done": done, "reused": made.reused, "failed": len(made.failed)}
        typer.echo(json.dumps({**counts, "index": str(made.index)}))
    else:
        typer.echo(f"{done} done, {made.reused} of them before, {len(made.failed)} failed", err=True)
        typer.echo(made.index)
    if made.failed:
        raise typer.Exit(1)
