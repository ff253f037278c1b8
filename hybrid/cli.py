"""The commands of the model: simulate, effects. They parse, call and print; nothing else."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object to stdout.")]


def mount(app: typer.Typer) -> None:
    """Add this package's commands to the command line."""
    app.command("simulate", help="Simulate a trial as its sensors would have recorded it.")(simulate)
    app.command("effects", help="List the effects that a model may lack.")(effects)


def simulate(
    output: Annotated[Path, typer.Option("-o", "--output", help="The recording to write, OUT.mcap.")],
    vessel: Annotated[str, typer.Option(help="A vessel of trials/vessels, or a vessel file.")] = "gunnerus_short",
    sea_state: Annotated[str, typer.Option(help="A sea state of trials/sea_states.toml.")] = "calm",
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
    effects_file: Annotated[
        list[Path] | None, typer.Option("--effects", help="A Python file with effects of your own.")
    ] = None,
) -> None:
    """Simulate a trial; what was hidden goes to OUT.truth.json and into nothing else."""
    from acquisition.recording.tables import write_table
    from acquisition.trial import Trial
    from hybrid.effects import catalogue_with, parse_effect
    from hybrid.truth.trial import simulate_trial, write_truth

    catalogue = catalogue_with(effects_file or ())
    hidden = dict(parse_effect(each, catalogue) for each in hide or ())
    table, truth = simulate_trial(vessel, sea_state, manoeuvre, duration, rate, seed, hidden, catalogue=catalogue)
    trial = Trial(name=output.stem, vessel=vessel, place="simulated", crew_notes=f"{manoeuvre}, {sea_state} sea")
    count = write_table(table, output, trial, source="simulated")
    truth_path = output.with_suffix(".truth.json")
    write_truth(truth, truth_path)
    typer.echo(f"{count:,} samples of {duration:g} s in {output}; the truth is in {truth_path}", err=True)


def effects(as_json: AsJson = False) -> None:
    """List the catalogue of effects."""
    from hybrid.effects import CATALOGUE
    from hybrid.effects.catalogue import VERSION

    if as_json:
        listed = [effect.as_dict() for effect in CATALOGUE.values()]
        typer.echo(json.dumps({"version": VERSION, "effects": listed}))
        return
    for effect in CATALOGUE.values():
        typer.echo(f"{effect.name}  ({effect.family}, {effect.kind})\n    {effect.what}")
        for each in effect.parameters:
            typer.echo(f"    {each.name} [{each.unit}]  neutral {each.neutral:g}, {each.low:g} to {each.high:g}")
