"""The command of the twin: it parses, calls and prints; nothing else."""

from __future__ import annotations

import json
import os
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from acquisition.cli import ABOARD, AsJson
from acquisition.core.process import stop_on_signals

if TYPE_CHECKING:
    from hybrid.twin.twin import Predictor

HORIZON_S = 30
_NICENESS = 5  # the logger goes first


def mount(app: typer.Typer) -> None:
    """Add this package's command to the command line."""
    app.command(
        "watch", help="Predict beside the running recorder, and judge what it said.", rich_help_panel=ABOARD
    )(watch)


def watch(
    config: Annotated[Path, typer.Argument(help="The configuration that `seatrial record` runs with.")],
    calibrator: Annotated[Path | None, typer.Option(help="The folder that `seatrial train` wrote.")] = None,
    vessel: Annotated[str | None, typer.Option(help="A vessel of trials/vessels, or a vessel file.")] = None,
    horizon: Annotated[
        int | None,
        typer.Option(min=2, max=300, help="How far is predicted in seconds; 30, or what the calibrator does."),
    ] = None,
    duration: Annotated[float | None, typer.Option(min=0.0, help="End after so many seconds.")] = None,
    log: Annotated[str, typer.Option(help="What is written without a terminal: text, or json lines.")] = "text",
    as_json: AsJson = False,
) -> None:
    """Predict beside the running recorder."""
    if log not in ("text", "json"):
        raise typer.BadParameter("is neither text nor json", param_hint="--log")
    with stop_on_signals() as stop:  # before the heavy imports: they take a while, and Ctrl-C may come
        with suppress(OSError):
            os.nice(_NICENESS)
        from acquisition.config.configuration import load_config
        from hybrid.twin.watch import as_json as described
        from hybrid.twin.watch import watch as run

        trial, predictor = load_config(config), _predictor(calibrator, vessel, horizon)
        summary = run(trial, predictor, stop, duration, log_format=log)  # type: ignore[arg-type]
    typer.echo(str(summary), err=True)
    if as_json:
        typer.echo(json.dumps(described(summary, predictor)))


def _predictor(calibrator: Path | None, vessel: str | None, horizon: int | None) -> Predictor:
    from hybrid.effects.catalogue import vessel_plant
    from hybrid.twin.twin import Predictor
    from hybrid.vessel.files import DEFAULT, load_vessel

    if calibrator is None:
        name = vessel or DEFAULT
        return Predictor(name, vessel_plant(load_vessel(name)), horizon or HORIZON_S)
    from hybrid.calibrators.artefact import load, plant_for, refuse_horizon  # and torch with it

    trained = load(calibrator)
    if horizon is not None:
        refuse_horizon(horizon, trained)
    return Predictor(trained.vessel, plant_for(trained, vessel), trained.horizon_s, trained, str(calibrator))
