"""Arguments and options that several commands of the model share, each with one wording."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

Recordings = Annotated[list[Path], typer.Argument(help="Recordings.")]
VesselOption = Annotated[str | None, typer.Option(help="A vessel of trials/vessels, or a vessel file.")]
SeaStateOption = Annotated[str, typer.Option(help="A sea state of trials/sea_states.toml.")]
CalibratorOption = Annotated[Path | None, typer.Option(help="The folder that `seatrial train` wrote.")]
PartOption = Annotated[str, typer.Option(help="A part of each recording's time in percent, e.g. 0..70.")]
StrideOption = Annotated[int, typer.Option(min=1, help="A window is tried every so many seconds.")]
RepairOption = Annotated[bool, typer.Option("--repair", help="Put right before what is certainly wrong.")]
EffectsOption = Annotated[
    list[Path] | None, typer.Option("--effects", help="A Python file with effects of your own.")
]
WorkersOption = Annotated[int | None, typer.Option(min=1, help="Worker processes; one a core without it.")]
