"""``seatrial plan``: it parses, calls and prints."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from acquisition.cli import TRIALS, AsJson
from hybrid.cli.options import EffectsOption, SeaStateOption, VesselOption

if TYPE_CHECKING:
    from hybrid.planning.plan import Plan

MANOEUVRES = (
    "MANOEUVRE or MANOEUVRE=MINUTES, one after the other: those of `seatrial simulate`, and reciprocal_headings, "
    "one_thruster_at_a_time, ...; the programme of docs/planning.md without any."
)


def mount(app: typer.Typer) -> None:
    """Add this module's command to the command line."""
    app.command("plan", help="Say what a trial would show, and propose a better one.", rich_help_panel=TRIALS)(plan)


def plan(
    manoeuvres: Annotated[list[str] | None, typer.Argument(help=MANOEUVRES)] = None,
    vessel: VesselOption = None,
    sea_state: SeaStateOption = "gentle",
    duration: Annotated[float, typer.Option(min=5.0, max=600.0, help="Length of the trial in minutes.")] = 60.0,
    tolerance: Annotated[
        float, typer.Option(min=0.0, max=20.0, help="What the model may be off by, in percent of the force range.")
    ] = 1.0,
    effects_file: EffectsOption = None,
    without: Annotated[list[str] | None, typer.Option(help="An effect that is ruled out.")] = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="A folder for plan.json and plan.html.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Say before a trial which effects it could show, from what size, and which it could not tell apart."""
    from hybrid.scripting import plan as run

    planned = run(
        vessel, manoeuvres or (), duration, sea_state, tolerance,
        effect_files=effects_file or (), without=without or (),
    )  # fmt: skip
    text = json.dumps(planned.as_dict())
    if output is not None:
        _write(planned, text, output)
    if as_json:
        typer.echo(text)
        return
    from rich.console import Console

    from hybrid.report.tables import plan_tables

    Console().print(plan_tables(planned))


def _write(planned: Plan, text: str, folder: Path) -> None:
    from acquisition.core.errors import storage_error
    from hybrid.report.plan_page import write_page

    path = folder / "plan.json"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        path.write_text(text + "\n", encoding="utf-8")
    except OSError as error:
        raise storage_error(path, error) from error
    for each in (path, write_page(planned, folder)):
        typer.echo(each, err=True)
