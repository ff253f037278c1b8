"""The commands of the model, from simulate to report, with the arguments and options that several of them share.

They parse, call and print; nothing else.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from seatrial.acquisition.cli import ABOARD, DIAGNOSIS, PREDICTIONS, RECORDINGS, TRIALS
from seatrial.acquisition.core.process import echo

if TYPE_CHECKING:
    from seatrial.acquisition.core.result import Result
    from seatrial.hybrid.calibrators import TrainedCalibrator

Recordings = Annotated[list[Path], typer.Argument(help="Recordings.")]
VesselOption = Annotated[str | None, typer.Option(help="A vessel of trials/vessels, or a vessel file.")]
SeaStateOption = Annotated[
    str, typer.Option(help="A sea state of trials/sea_states.toml; scaled down for a ship model.")
]
CalibratorOption = Annotated[
    Path | None, typer.Option(help="A calibrator: the folder written by `seatrial train`.")
]
CodeOption = Annotated[
    str | None,
    typer.Option(
        "--method", help="FILE.py:CLASS: the code of a calibrator of your own, which runs only if it is given here."
    ),
]
HorizonOption = Annotated[
    int | None,
    typer.Option(min=2, help="The horizon of the predictions in seconds; default: 15, or the calibrator's."),
]
AllowSeenOption = Annotated[bool, typer.Option(help="Also test recordings that the calibrator was trained on.")]
PartOption = Annotated[str, typer.Option(help="A part of each recording's time in percent, e.g. 0..70.")]
StrideOption = Annotated[int, typer.Option(min=1, help="Seconds between the starts of windows.")]
AnyOption = Annotated[
    bool,
    typer.Option("--any", help="All windows with data, with the recorded controls; not only held windows."),
]
RepairOption = Annotated[bool, typer.Option("--repair", help="First repair faults that are beyond doubt.")]
EffectsOption = Annotated[
    list[Path] | None, typer.Option("--effects", help="A Python file with effects of your own.")
]
WorkersOption = Annotated[
    int | None, typer.Option(min=1, help="Number of worker processes; default: one per core.")
]


def chosen_calibrator(folder: Path | None, method: str | None) -> TrainedCalibrator | Path | None:
    """The calibrator in a folder, read with its code at another place if ``method`` says so."""
    if method is None:
        return folder
    if folder is None:
        raise typer.BadParameter(
            "is the code of a trained calibrator: give its folder with --calibrator; `seatrial train` makes one, "
            "`seatrial evaluate` compares methods untrained", param_hint="--method",
        )  # fmt: skip
    from seatrial.hybrid.calibrators.own import load

    return load(folder, method)


def print_result(values: Any, result: Result, *, as_json: bool) -> None:
    """A result on standard output: its ``values`` as JSON, or as a terminal shows it."""
    if as_json:
        echo(json.dumps(values))
        return
    from seatrial.acquisition.core.errors import Terminal
    from seatrial.acquisition.core.result import ModelResult

    if isinstance(result, ModelResult):
        for line in result.first_lines:
            echo(line)
    Terminal().print(result)


def say_what_needs_networks(what: str) -> None:
    """Say on stderr that ``what`` is left out where networks cannot be trained."""
    from seatrial.hybrid.calibrators import INSTALL, can_train

    if not can_train("data_driven"):
        echo(f"left out, as PyTorch is not installed, which trains networks: {what}; {INSTALL}", err=True)


def mount(app: typer.Typer) -> None:
    """Add the commands of the model to the command line; their help is what they say of themselves."""
    from seatrial.hybrid.cli import model, results, trials, vessel

    panels: dict[str, tuple[Callable[..., None], ...]] = {
        TRIALS: (trials.demo, trials.init, trials.simulate, trials.plan, trials.campaign),
        PREDICTIONS: (model.train, model.validate, model.predict, model.evaluate),
        DIAGNOSIS: (trials.effects, results.diagnose, results.identify),
        ABOARD: (model.watch,),
        RECORDINGS: (results.speed_power, results.report),
    }
    for panel, commands in panels.items():
        for command in commands:
            app.command(rich_help_panel=panel)(command)
    ships, reproduce = typer.Typer(no_args_is_help=True), typer.Typer(no_args_is_help=True)
    for command in (vessel.new, vessel.check):
        ships.command()(command)
    app.add_typer(ships, name="vessel", help="Vessel files of your own ship.", rich_help_panel=TRIALS)
    for command in (results.table3, results.figures, results.fidelity):
        reproduce.command()(command)
    app.add_typer(
        reproduce, name="reproduce", help="Reproduce the paper's results from scratch.", rich_help_panel=PREDICTIONS
    )
