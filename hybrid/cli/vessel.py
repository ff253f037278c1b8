"""``seatrial vessel new`` and ``check``: they parse, ask for what is missing, call and print."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from seatrial.acquisition.cli import AsJson, writes
from seatrial.acquisition.core.errors import printable_name
from seatrial.acquisition.core.process import echo
from seatrial.hybrid.cli import print_result

_ASKED = {
    "length": "Length between perpendiculars [m]",
    "beam": "Beam [m]",
    "draught": "Mean draught [m]",
    "block": "Block coefficient",
    "service_speed": "Service speed [m/s]",
}
"""What every ship needs, and how it is asked for."""

_KEYWORDS = {
    "length": "length_m", "beam": "beam_m", "draught": "draught_m", "block": "block",
    "service_speed": "service_speed_mps", "propeller": "propellers", "azimuth": "azimuths", "rudder": "rudders",
    "tunnel": "tunnels",
}  # fmt: skip
"""What an option is called in :func:`seatrial.hybrid.vessel.estimate.new_vessel.new_vessel`."""

_DEVICES = {
    "propeller": "A propeller, diameter=M[,pitch_ratio=..][,blades=..][,area_ratio=..][,rpm=..]",
    "azimuth": "An azimuth thruster, diameter=M[,pitch_ratio=..][,x=M][,y=M]",
    "rudder": "A rudder, area=M2[,span=M][,behind=NAME]",
    "tunnel": "A tunnel thruster, bow or stern,diameter=M,power=KW",
}
_DEVICE_HELP = "{0}, NAME,KEY=NUMBER,...; may be repeated."

LengthOption = Annotated[float | None, typer.Option(help="Length between perpendiculars in m.")]
BeamOption = Annotated[float | None, typer.Option(help="Beam in m.")]
DraughtOption = Annotated[float | None, typer.Option(help="Mean draught in m.")]
BlockOption = Annotated[float | None, typer.Option(help="Block coefficient.")]
SpeedOption = Annotated[float | None, typer.Option(help="Service speed in calm water in m/s.")]
PropellerOption = Annotated[list[str] | None, typer.Option(help=_DEVICE_HELP.format("A propeller"))]
AzimuthOption = Annotated[list[str] | None, typer.Option(help=_DEVICE_HELP.format("An azimuth thruster"))]
RudderOption = Annotated[list[str] | None, typer.Option(help=_DEVICE_HELP.format("A rudder"))]
TunnelOption = Annotated[list[str] | None, typer.Option(help=_DEVICE_HELP.format("A tunnel thruster"))]


@writes("output")
def new(
    output: Annotated[Path, typer.Option("-o", "--output", help="The vessel file to write.")],
    name: Annotated[str | None, typer.Option(help="The ship's name; by default that of the file.")] = None,
    length: LengthOption = None,
    beam: BeamOption = None,
    draught: DraughtOption = None,
    block: BlockOption = None,
    service_speed: SpeedOption = None,
    propeller: PropellerOption = None,
    azimuth: AzimuthOption = None,
    rudder: RudderOption = None,
    tunnel: TunnelOption = None,
    hull: Annotated[str, typer.Option(help="mmg, or cross_flow for low speed.")] = "mmg",
    length_overall: Annotated[float | None, typer.Option(help="Length overall in m.")] = None,
    centre_of_gravity: Annotated[
        float | None, typer.Option(help="Position forward of midship in m; default: estimated.")
    ] = None,
    frontal_area: Annotated[float | None, typer.Option(help="Frontal area above water in m2.")] = None,
    lateral_area: Annotated[float | None, typer.Option(help="Lateral area above water in m2.")] = None,
    water_density: Annotated[float, typer.Option(help="Water density in kg/m3: fresh 1000, salt 1025.")] = 1025.0,
) -> None:
    """Write a vessel file from main dimensions, by published regressions."""
    needed = {"length": length, "beam": beam, "draught": draught, "block": block, "service_speed": service_speed}
    devices = {"propeller": propeller, "azimuth": azimuth, "rudder": rudder, "tunnel": tunnel}
    particulars = complete(needed, devices)
    if hull not in ("mmg", "cross_flow"):
        raise typer.BadParameter(f"no hull model {hull!r}; give mmg or cross_flow")
    from seatrial.hybrid.vessel.estimate.new_vessel import new_vessel

    made = new_vessel(
        output,
        name=name or printable_name(output.stem),
        **particulars,
        hull=hull,  # type: ignore[arg-type]
        length_overall_m=length_overall, centre_of_gravity_m=centre_of_gravity,
        frontal_area_m2=frontal_area, lateral_area_m2=lateral_area, water_density_kgpm3=water_density,
    )  # fmt: skip
    for warning in made.warnings:
        echo(f"note: {warning}", err=True)
    rpm = ", ".join(f"{shaft} {value:.4g} rpm" for shaft, value in made.service_rpm.items())
    echo(f"{particulars['service_speed_mps']:g} m/s takes {rpm}", err=True)
    echo(output)


@writes("output")
def check(
    vessel: Annotated[str, typer.Argument(help="A vessel of trials/vessels, or a vessel file.")],
    rpm: Annotated[
        float | None, typer.Option(min=0.0, help="Shaft speed of the tests; default: 95 % of the shafts' limit.")
    ] = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="A picture (.png, .svg, .pdf) or a page (.html).")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Simulate the standard manoeuvres of a vessel file, and compare them with the IMO limits."""
    from seatrial.hybrid.scripting import vessel_check

    checked = vessel_check(vessel, rpm)
    if output is not None:
        from seatrial.hybrid.report.vessel_check import write_vessel_check

        echo(write_vessel_check(checked, output), err=True)
    print_result(checked.as_dict(), checked, as_json=as_json)


def complete(
    needed: dict[str, float | None], devices: dict[str, list[str] | None], instead: str = ""
) -> dict[str, Any]:
    """What :func:`new_vessel` takes: what was given, and what a person at the terminal adds.

    Without a person what is missing is wrong usage; ``instead`` is the option that makes all of it unnecessary.
    """
    missing = [key for key, value in needed.items() if value is None]
    driven = bool(devices["propeller"] or devices["azimuth"])
    if (missing or not driven) and not at_terminal():
        names = [f"--{key.replace('_', '-')}" for key in missing]
        names += [] if driven else ["--propeller or --azimuth"]
        raise typer.BadParameter(f"missing: {', '.join(names)}{f'; or give {instead}' if instead else ''}")
    needed = needed | {key: float(typer.prompt(_ASKED[key], type=float, err=True)) for key in missing}
    listed = {key: value or ([] if driven else _list(key)) for key, value in devices.items()}
    return {_KEYWORDS[key]: value for key, value in (needed | listed).items()}


def at_terminal() -> bool:
    """Whether a person can be asked."""
    return sys.stdin.isatty()


def _list(key: str) -> list[str]:
    """Devices of a kind, one an answer, until an empty answer."""
    found: list[str] = []
    while answer := str(
        typer.prompt(f"{_DEVICES[key]} (empty: no more)", default="", show_default=False, err=True)
    ):
        found.append(answer)
    return found
