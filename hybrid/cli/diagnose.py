"""``seatrial diagnose``: it parses, calls and prints."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from acquisition.cli import DIAGNOSIS, AsJson
from analysis.cli import RebuildPositions
from hybrid.cli.options import EffectsOption, PartOption, Recordings, RepairOption, VesselOption


def mount(app: typer.Typer) -> None:
    """Add this package's commands to the command line."""
    app.command(
        "diagnose", help="Name what the model lacks, add it, and show the gap shrink.", rich_help_panel=DIAGNOSIS
    )(diagnose)


def diagnose(
    files: Recordings,
    output: Annotated[Path, typer.Option("-o", "--output", help="The folder that everything goes into.")],
    vessel: VesselOption = None,
    tolerance: Annotated[
        float, typer.Option(help="How far off the model may be anyway, in percent of the force range.")
    ] = 1.0,
    effects: EffectsOption = None,
    without: Annotated[
        list[str] | None, typer.Option(help="An effect to leave out of the catalogue; may be given several times.")
    ] = None,
    repair: RepairOption = False,
    rebuild_positions: RebuildPositions = False,
    part: PartOption = "0..100",
    calibrate: Annotated[
        bool, typer.Option("--calibrate", help="Also train a calibrator on the model before and after.")
    ] = False,
    seed: Annotated[int, typer.Option(min=0, help="The same seed gives the same calibrators.")] = 0,
    as_json: AsJson = False,
) -> None:
    """Diagnose recordings against a model."""
    from acquisition.core.progress import bar
    from analysis.tables.files import make_folder
    from analysis.tables.table import percent_of
    from hybrid.effects.catalogue import catalogue_with
    from hybrid.vessel.files import DEFAULT, load_vessel
    from hybrid.workflows.diagnose import diagnose_files, write_diagnosis

    ship = load_vessel(vessel or DEFAULT)
    catalogue = catalogue_with(effects or (), without or (), ship.actuators)
    make_folder(output)  # before minutes of work
    with bar("diagnosing") as progress:
        diagnosed = diagnose_files(
            files, ship, tolerance / 100.0, catalogue, percent_of(part),
            repair=repair, rebuild_positions=rebuild_positions, progress=progress,
        )  # fmt: skip
    if calibrate:
        from dataclasses import replace

        from hybrid.diagnosis.calibrator_comparison import compare_calibrators

        with bar("training") as progress:
            ladder = compare_calibrators(
                diagnosed.conclusion, files, percent_of(part),
                repair=repair, rebuild_positions=rebuild_positions, seed=seed, progress=progress,
            )  # fmt: skip
        diagnosed = replace(diagnosed, extras=replace(diagnosed.extras, ladder=ladder))
    page = write_diagnosis(diagnosed, ship, output)
    diagnosis = diagnosed.diagnosis
    if as_json:
        typer.echo(json.dumps(diagnosis.as_dict()))
        return
    from rich.console import Console

    from hybrid.report.diagnosis_words import summary

    Console().print(summary(diagnosis, diagnosed.extras.ladder))
    typer.echo(str(page))
