"""The commands of the model, from simulate to predict. They parse, call and print; nothing else."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from acquisition.cli import DIAGNOSIS, PREDICTIONS, TRIALS, AsJson
from analysis.cli import RebuildPositions
from hybrid.cli import campaign as truth_commands
from hybrid.cli import diagnose as diagnosis
from hybrid.cli import evaluate as evaluation
from hybrid.cli import plan as planning
from hybrid.cli import report as reporting
from hybrid.cli import reproduce as reproduction
from hybrid.cli import watch as twin
from hybrid.cli.options import (
    CalibratorOption,
    EffectsOption,
    PartOption,
    Recordings,
    RepairOption,
    SeaStateOption,
    StrideOption,
    VesselOption,
)

HORIZON_S = 15
SIMULATED_ORIGIN = (63.44, 10.40)  # latitude and longitude that simulated trials start from [deg]


def mount(app: typer.Typer) -> None:
    """Add this package's commands to the command line."""
    app.command("demo", help="Run the whole chain: from simulated buses to a report.", rich_help_panel=TRIALS)(demo)
    app.command("simulate", help="Simulate a trial as its sensors would have recorded it.", rich_help_panel=TRIALS)(
        simulate
    )
    app.command("train", help="Train a calibrator on a reference model.", rich_help_panel=PREDICTIONS)(train)
    app.command(
        "validate", help="Score every method on recordings that none has seen.", rich_help_panel=PREDICTIONS
    )(validate)
    app.command("predict", help="Predict one track from one instant of a recording.", rich_help_panel=PREDICTIONS)(
        predict
    )
    app.command("effects", help="List the effects that a model may lack.", rich_help_panel=DIAGNOSIS)(effects)
    twin.mount(app)
    evaluation.mount(app)
    diagnosis.mount(app)
    planning.mount(app)
    truth_commands.mount(app)
    reproduction.mount(app)
    reporting.mount(app)


def simulate(
    output: Annotated[Path, typer.Option("-o", "--output", help="The recording to write, OUT.mcap.")],
    vessel: Annotated[str, typer.Option(help="A vessel of trials/vessels, or a vessel file.")] = "gunnerus_short",
    sea_state: SeaStateOption = "calm",
    manoeuvre: Annotated[
        str, typer.Option(help="voyage, programme, paper, zigzag_20_20, turning_circle_30, ...")
    ] = "voyage",
    duration: Annotated[float, typer.Option(min=1.0, help="Length of the trial in seconds.")] = 1200.0,
    rate: Annotated[float, typer.Option(min=0.1, max=100.0, help="Samples a second.")] = 10.0,
    seed: Annotated[int, typer.Option(min=0, help="The same seed gives the same trial.")] = 0,
    hide: Annotated[
        list[str] | None,
        typer.Option(help="EFFECT:PARAM=VALUE,... to hide in the truth; may be given several times."),
    ] = None,
    effects_file: EffectsOption = None,
) -> None:
    """Simulate a trial; what was hidden goes to OUT.truth.json and into nothing else."""
    from hybrid.effects.catalogue import catalogue_with, parse_effects
    from hybrid.scripting import simulate as run
    from hybrid.vessel.files import load_vessel

    ship = load_vessel(vessel)
    catalogue = catalogue_with(effects_file or (), actuators=ship.actuators)
    hidden = parse_effects(hide or (), catalogue)
    table = run(output, vessel, sea_state, manoeuvre, duration, rate, seed, hidden, catalogue=catalogue)
    samples, truth = int(table.notna().to_numpy().sum()), output.with_suffix(".truth.json")
    typer.echo(f"{samples:,} samples of {duration:g} s in {output}; the truth is in {truth}", err=True)


def effects(effects_file: EffectsOption = None, as_json: AsJson = False) -> None:
    """List the catalogue of effects."""
    from hybrid.effects.catalogue import VERSION, catalogue_with

    catalogue = catalogue_with(effects_file or ())
    if as_json:
        listed = [effect.as_dict() for effect in catalogue.values()]
        typer.echo(json.dumps({"version": VERSION, "effects": listed}))
        return
    from rich.console import Console

    from hybrid.report.tables import CATALOGUE_WIDTH, catalogue_tables

    console = Console()
    console.width = max(console.width, CATALOGUE_WIDTH)
    console.print(catalogue_tables(catalogue))


def train(
    files: Recordings,
    output: Annotated[Path, typer.Option("-o", "--output", help="The folder that the calibrator goes into.")],
    vessel: VesselOption = None,
    horizon: Annotated[int, typer.Option(min=2, help="How far it predicts, in seconds.")] = 15,
    stride: StrideOption = 5,
    method: Annotated[str, typer.Option(help="adaptive, paper, additive or data_driven.")] = "adaptive",
    part: PartOption = "0..100",
    repair: RepairOption = False,
    rebuild_positions: RebuildPositions = False,
    seed: Annotated[int, typer.Option(min=0, help="The same seed gives the same calibrator.")] = 0,
    as_json: AsJson = False,
) -> None:
    """Train a calibrator on held windows."""
    from analysis.tables.files import make_folder
    from hybrid.calibrators import refuse_unknown
    from hybrid.calibrators.artefact import save
    from hybrid.scripting import train as run
    from hybrid.vessel.files import DEFAULT, load_vessel

    refuse_unknown(method)
    load_vessel(vessel or DEFAULT)
    make_folder(output)  # before hours of work
    trained = run(
        files, vessel, method, horizon, stride_s=stride, part=part,
        repair=repair, rebuild_positions=rebuild_positions, seed=seed,
    )  # fmt: skip
    path = save(trained, output)
    if as_json:
        typer.echo(json.dumps({"calibrator": str(path.parent), **trained.metrics}))
        return
    metrics = trained.metrics
    more = f" and {metrics['shorter_windows']} shorter ones" if metrics["shorter_windows"] else ""
    typer.echo(
        f"trained on {metrics['training_windows']} windows{more}; on {metrics['held_out_windows']} windows of legs "
        f"kept out: reference {metrics['held_out_reference_m']:.2f} m, hybrid {metrics['held_out_hybrid_m']:.2f} m",
        err=True,
    )
    if metrics["held_out_hybrid_m"] > metrics["held_out_reference_m"]:
        typer.echo("warning: on legs kept out it is WORSE than the reference; it needs more held legs", err=True)
    typer.echo(path.parent)


def validate(
    files: Recordings,
    calibrator: CalibratorOption = None,
    vessel: VesselOption = None,
    horizon: Annotated[
        int | None, typer.Option(min=2, help="How far is predicted in seconds; 15, or what the calibrator does.")
    ] = None,
    stride: StrideOption = 5,
    part: PartOption = "0..100",
    repair: RepairOption = False,
    rebuild_positions: RebuildPositions = False,
    allow_seen: Annotated[bool, typer.Option(help="Also recordings that the calibrator was trained on.")] = False,
    as_json: AsJson = False,
) -> None:
    """Score every baseline, and the calibrator if one is given."""
    from hybrid.calibrators.artefact import load
    from hybrid.scripting import validate as run
    from hybrid.vessel.files import DEFAULT

    trained = load(calibrator) if calibrator else None
    validation = run(
        files, trained, vessel, horizon, stride_s=stride, part=part,
        repair=repair, rebuild_positions=rebuild_positions, allow_seen=allow_seen,
    )  # fmt: skip
    typer.echo(f"reference: the model {trained.vessel if trained else vessel or DEFAULT}", err=True)
    if as_json:
        typer.echo(json.dumps(validation.as_dict()))
        return
    from rich.console import Console

    from hybrid.report.tables import validation_table

    Console().print(validation_table(validation))


def predict(
    file: Annotated[Path, typer.Argument(help="A recording.")],
    at: Annotated[str, typer.Option(help="ISO 8601 with zone, seconds since 1970, or +SECONDS from the start.")],
    calibrator: CalibratorOption = None,
    vessel: VesselOption = None,
    horizon: Annotated[
        int | None, typer.Option(min=1, help="How far is predicted in seconds; 15, or what the calibrator does.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Predict one track with its band."""
    from hybrid.scripting import predict as run

    prediction = run(file, at, calibrator, vessel, horizon)
    if as_json:
        typer.echo(json.dumps(prediction.as_dict()))
        return
    from rich.console import Console

    from hybrid.report.tables import prediction_table

    Console().print(prediction_table(prediction))


def demo(
    output: Annotated[Path, typer.Option("-o", "--output", help="The folder that everything goes into.")] = Path(
        "demo"
    ),
    seed: Annotated[int, typer.Option(min=0, help="The same seed gives the same voyage.")] = 1,
) -> None:
    """Show the whole of Seatrial at work, without hardware."""
    from contextlib import ExitStack

    from acquisition.core.progress import bar
    from hybrid.report.tables import validation_table
    from hybrid.workflows.demo import demonstrate

    with ExitStack() as stack:
        done = demonstrate(
            output,
            seed,
            say=lambda line: typer.echo(line, err=True),
            progress=lambda what: stack.enter_context(bar(what)),
        )
    from rich.console import Console

    Console(stderr=True).print(validation_table(done.validation))
    reduction = done.validation.reduction or 0.0
    typer.echo(
        f"{done.report}: {sum(done.lost.values())} samples lost, {reduction:.0%} less error than the reference"
    )
