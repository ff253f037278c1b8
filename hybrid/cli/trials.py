"""``seatrial simulate``, ``campaign``, ``effects``, ``plan`` and ``demo``: they parse, call and print."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from seatrial.acquisition.cli import AsJson, writes
from seatrial.acquisition.core.errors import bar
from seatrial.acquisition.core.process import echo
from seatrial.hybrid.cli import (
    EffectsOption,
    SeaStateOption,
    VesselOption,
    WorkersOption,
    print_result,
)
from seatrial.hybrid.cli.vessel import (
    AzimuthOption,
    BeamOption,
    BlockOption,
    DraughtOption,
    LengthOption,
    PropellerOption,
    RudderOption,
    SpeedOption,
    TunnelOption,
    complete,
)

MANOEUVRES = (
    "MANOEUVRE or MANOEUVRE=MINUTES, one after the other: those of `seatrial simulate`, and reciprocal_headings, "
    "one_thruster_at_a_time, ...; default: the programme of docs/planning.md."
)


@writes(folder="folder")
def init(
    folder: Annotated[Path, typer.Argument(help="The folder to make.")],
    name: Annotated[str | None, typer.Option(help="Name of ship and trial; default: the folder's.")] = None,
    vessel: Annotated[
        str | None, typer.Option(help="Your ship, if it has a vessel file: a name or a file.")
    ] = None,
    length: LengthOption = None,
    beam: BeamOption = None,
    draught: DraughtOption = None,
    block: BlockOption = None,
    service_speed: SpeedOption = None,
    propeller: PropellerOption = None,
    azimuth: AzimuthOption = None,
    rudder: RudderOption = None,
    tunnel: TunnelOption = None,
    force: Annotated[bool, typer.Option("--force", help="Replace existing files.")] = False,
) -> None:
    """Set up a folder for your ship's trials, from its main dimensions or vessel file."""
    needed = {"length": length, "beam": beam, "draught": draught, "block": block, "service_speed": service_speed}
    devices = {"propeller": propeller, "azimuth": azimuth, "rudder": rudder, "tunnel": tunnel}
    given = [key for key, value in (needed | devices).items() if value not in (None, [])]
    if vessel is not None and given:
        raise typer.BadParameter("is given with --vessel, whose file says it", param_hint=f"--{given[0]}")
    particulars = {} if vessel is not None else complete(needed, devices, "--vessel FILE")
    from seatrial.acquisition.recording.parts import safe_name
    from seatrial.hybrid.vessel.estimate.new_vessel import new_vessel
    from seatrial.hybrid.workflows import start_folder

    name = safe_name(name or folder.resolve().name)
    ship = new_vessel(name=name, **particulars) if vessel is None else vessel
    for warning in () if isinstance(ship, str) else ship.warnings:
        echo(f"note: {warning}", err=True)
    echo("simulating an example, the first time with half a minute of compilation", err=True)
    for path in start_folder(folder, ship, name, force=force):
        echo(path)


@writes(folder="output")
def demo(
    output: Annotated[Path, typer.Option("-o", "--output", help="The folder for all output.")] = Path("demo"),
    seed: Annotated[int, typer.Option(min=0, help="The same seed gives the same voyage.")] = 1,
) -> None:
    """Run the whole chain: from simulated buses to a report."""
    from seatrial.hybrid.demo import demonstrate

    done = demonstrate(output, seed, say=lambda line: echo(line, err=True))
    from seatrial.acquisition.core.errors import Terminal

    echo(done.validation.model, err=True)
    Terminal(stderr=True).print(done.validation)
    reduction = done.validation.reduction or 0.0
    echo(f"{done.report}: {sum(done.lost.values())} samples lost, {reduction:.0%} less error than the reference")


@writes("output")
def simulate(
    output: Annotated[Path, typer.Option("-o", "--output", help="The recording to write, OUT.mcap.")],
    vessel: VesselOption = None,
    sea_state: SeaStateOption = "calm",
    manoeuvre: Annotated[
        str, typer.Option(help="voyage, programme, paper, zigzag_20_20, turning_circle_30, ...")
    ] = "voyage",
    duration: Annotated[float, typer.Option(min=1.0, help="Length of the trial in seconds.")] = 1200.0,
    rate: Annotated[float, typer.Option(min=0.1, max=100.0, help="Sampling rate in Hz.")] = 10.0,
    seed: Annotated[int, typer.Option(min=0, help="The same seed gives the same trial.")] = 0,
    hide: Annotated[
        list[str] | None,
        typer.Option(help="An effect to hide, EFFECT:PARAM=VALUE,...; may be repeated."),
    ] = None,
    effects_file: EffectsOption = None,
) -> None:
    """Simulate a trial as its sensors would have recorded it."""
    from seatrial.hybrid.effects.catalogue import catalogue_with, parse_effects
    from seatrial.hybrid.scripting import simulate as run
    from seatrial.hybrid.vessel.files import load_vessel

    ship = load_vessel(vessel)
    catalogue = catalogue_with(effects_file or (), vessel=ship)
    hidden = parse_effects(hide or (), catalogue)
    table = run(output, vessel, sea_state, manoeuvre, duration, rate, seed, hidden, catalogue=catalogue)
    samples, truth = int(table.notna().to_numpy().sum()), output.with_suffix(".truth.json")
    echo(f"{samples:,} samples of {duration:g} s in {output}; the truth is in {truth}", err=True)


@writes(folder="output")
def campaign(
    file: Annotated[Path, typer.Argument(help="The campaign, a TOML file like trials/campaign.toml.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="The folder for all output.")],
    workers: WorkersOption = None,
    scheduler: Annotated[str | None, typer.Option(help="A running dask scheduler, like tcp://host:8786.")] = None,
    as_json: AsJson = False,
) -> None:
    """Simulate many trials: vessels, seas, manoeuvres, seeds."""
    if workers is not None and scheduler is not None:
        raise typer.BadParameter("give --workers or --scheduler, not both")
    from seatrial.hybrid.simulation.trial import load_campaign, run_campaign

    planned = load_campaign(file)
    with bar("campaign") as progress:
        made = run_campaign(planned, output, workers, scheduler, progress)
    for row in made.failed:
        echo(f"{row['name']} failed: {row['cause']}", err=True)
    done = len(made.rows) - len(made.failed)
    if as_json:
        counts = {"trials": len(made.rows), "done": done, "reused": made.reused, "failed": len(made.failed)}
        echo(json.dumps({**counts, "index": str(made.index)}))
    else:
        echo(f"{done} done, {made.reused} of them before, {len(made.failed)} failed", err=True)
        echo(made.index)
    if made.failed:
        raise typer.Exit(1)


def effects(effects_file: EffectsOption = None, vessel: VesselOption = None, as_json: AsJson = False) -> None:
    """List the effects that a model may lack."""
    from seatrial.hybrid.effects.catalogue import VERSION, catalogue_with
    from seatrial.hybrid.vessel.files import load_vessel

    catalogue = catalogue_with(effects_file or (), vessel=load_vessel(vessel))
    if as_json:
        listed = [effect.as_dict() for effect in catalogue.values()]
        echo(json.dumps({"version": VERSION, "effects": listed}))
        return
    from seatrial.acquisition.core.errors import Terminal
    from seatrial.hybrid.report.text import CATALOGUE_WIDTH, catalogue_tables

    console = Terminal()
    console.width = max(console.width, CATALOGUE_WIDTH)
    console.print(catalogue_tables(catalogue))


@writes(folder="output")
def plan(
    manoeuvres: Annotated[list[str] | None, typer.Argument(help=MANOEUVRES)] = None,
    vessel: VesselOption = None,
    sea_state: Annotated[
        str | None,
        typer.Option(help="A sea state of trials/sea_states.toml; default: gentle, for a ship model calm."),
    ] = None,
    duration: Annotated[float, typer.Option(min=5.0, max=600.0, help="Length of the trial in minutes.")] = 60.0,
    tolerance: Annotated[
        float,
        typer.Option(min=0.0, max=20.0, help="The model error that is tolerated, in % of the force range."),
    ] = 1.0,
    effects_file: EffectsOption = None,
    without: Annotated[list[str] | None, typer.Option(help="An effect that is ruled out; may be repeated.")] = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="A folder for plan.json and plan.html.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Say which effects a planned trial could find, and propose a better one."""
    from seatrial.hybrid.scripting import plan as run

    planned = run(
        vessel, manoeuvres or (), duration, sea_state, tolerance,
        effect_files=effects_file or (), without=without or (),
    )  # fmt: skip
    if output is not None:
        from seatrial.hybrid.report.plan_page import write_plan

        for path in write_plan(planned, output):
            echo(path, err=True)
    print_result(planned.as_dict(), planned, as_json=as_json)
