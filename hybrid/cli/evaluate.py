"""``seatrial evaluate``: it parses, calls and prints."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from acquisition.cli import PREDICTIONS, AsJson
from analysis.cli import RebuildPositions
from hybrid.cli.options import Recordings, RepairOption, StrideOption, VesselOption


def mount(app: typer.Typer) -> None:
    """Add this package's command to the command line."""
    app.command(
        "evaluate", help="Judge each method on recordings like these, with intervals.", rich_help_panel=PREDICTIONS
    )(evaluate)


def evaluate(
    files: Recordings,
    horizon: Annotated[int, typer.Option(min=2, help="How far is predicted, in seconds.")] = 15,
    vessel: VesselOption = None,
    split: Annotated[
        list[str] | None,
        typer.Option(
            help="leg, time, recording or random; several may be given. Without it leg and time, and "
            "recording where there are several files."
        ),
    ] = None,
    method: Annotated[
        list[str] | None, typer.Option(help="A kind of calibrator; several may be given. Without it all.")
    ] = None,
    draws: Annotated[int, typer.Option(min=1, help="How often legs, or windows, are drawn at random.")] = 5,
    stride: StrideOption = 5,
    repair: RepairOption = False,
    rebuild_positions: RebuildPositions = False,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="A folder for evaluation.json and evaluation.html.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="The same seed gives the same figures.")] = 0,
    as_json: AsJson = False,
) -> None:
    """Fit every method on one part of recordings and judge it on the other."""
    from rich.console import Console

    from analysis.tables.files import make_folder
    from hybrid.report.evaluation_page import write_evaluation
    from hybrid.report.tables import evaluation_tables
    from hybrid.scripting import evaluate as run
    from hybrid.vessel.files import DEFAULT

    if output is not None:
        make_folder(output)
    evaluation = run(
        files, vessel, horizon, splits=split or (), methods=method or (), draws=draws, stride_s=stride,
        repair=repair, rebuild_positions=rebuild_positions, seed=seed,
    )  # fmt: skip
    about = {
        "files": [str(each) for each in files],
        "vessel": vessel or DEFAULT,
        "stride_s": stride,
        "repair": repair or rebuild_positions,
        "rebuild_positions": rebuild_positions,
        "seed": seed,
    }
    text = json.dumps({**about, **evaluation.as_dict()})
    if output is not None:
        for path in write_evaluation(evaluation, text, about, output):
            typer.echo(path, err=True)
    if as_json:
        typer.echo(text)
        return
    for table in evaluation_tables(evaluation):
        Console().print(table)
