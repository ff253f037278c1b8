"""``seatrial evaluate``: it parses, calls and prints."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from acquisition.cli import AsJson
from analysis.cli import RebuildPositions
from hybrid.options import Recordings, RepairOption, StrideOption, VesselOption


def mount(app: typer.Typer) -> None:
    """Add this package's command to the command line."""
    app.command("evaluate", help="Say what each method is worth on recordings like these, honestly.")(evaluate)


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

    from acquisition.core.progress import bar
    from analysis.tables.files import make_folder
    from hybrid.calibrators import METHODS, make_calibrator
    from hybrid.effects.catalogue import vessel_plant
    from hybrid.evaluation.splits import refuse_unknown
    from hybrid.evaluation.study import study
    from hybrid.evaluation.summary import evaluation_of
    from hybrid.prediction.dataset import load_dataset
    from hybrid.report.evaluation_page import write_evaluation
    from hybrid.report.evaluation_tables import evaluation_tables
    from hybrid.vessel.files import DEFAULT, load_vessel

    splits = list(dict.fromkeys(split or (["leg", "time"] if len(files) == 1 else ["leg", "time", "recording"])))
    methods = list(dict.fromkeys(method or METHODS))
    refuse_unknown(splits)
    for each in methods:
        make_calibrator(each)
    plant = vessel_plant(load_vessel(vessel or DEFAULT))
    if output is not None:
        make_folder(output)
    with bar("reading") as progress:
        dataset = load_dataset(
            files, horizon, stride, progress=progress, shorter=True,
            repair=repair or rebuild_positions, rebuild_positions=rebuild_positions,
        )  # fmt: skip
    with bar("fitting") as progress:
        judged = study(dataset.windows, plant, methods, splits, draws, seed, progress)
    evaluation = evaluation_of(judged, plant.length_overall_m, seed)
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
