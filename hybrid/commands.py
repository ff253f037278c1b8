"""Functions of ``import seatrial as st`` that need a model, and are commands, too: from simulate to report."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Union

import typer

from seatrial.acquisition.commands import (
    ABOARD,
    DIAGNOSIS,
    PREDICTIONS,
    RECORDINGS,
    TRIALS,
    AsJson,
    Data,
    Parsed,
    command,
    print_result,
    recording_paths,
)
from seatrial.acquisition.core import errors
from seatrial.acquisition.core.files import lock_output_folder, require_suffix, written_together
from seatrial.acquisition.core.process import announce, print_line, stop_on_signals
from seatrial.analysis import commands as analysis

if TYPE_CHECKING:
    import pandas as pd

    from seatrial.acquisition.config.run_sheet import Conditions
    from seatrial.analysis.conduct.conductor import Conductor
    from seatrial.analysis.conduct.outlook import Outlook
    from seatrial.analysis.conduct.programme import TrialProgramme
    from seatrial.analysis.speed_power.analysis import SpeedPower
    from seatrial.hybrid.calibrators import TrainedCalibrator, VesselChoice
    from seatrial.hybrid.calibrators.predict import Prediction
    from seatrial.hybrid.evaluation.study import Evaluation
    from seatrial.hybrid.evaluation.validate import Validation
    from seatrial.hybrid.export.export import ModelExport
    from seatrial.hybrid.identification.identify import Identification
    from seatrial.hybrid.planning import Plan
    from seatrial.hybrid.prediction.dataset import Dataset
    from seatrial.hybrid.simulation.trial import CampaignResult
    from seatrial.hybrid.simulation.vessel_check import VesselCheck
    from seatrial.hybrid.twin import WatchSummary
    from seatrial.hybrid.vessel.black_box import BlackBox, MotionModel
    from seatrial.hybrid.vessel.estimate.new_vessel import NewVessel
    from seatrial.hybrid.vessel.files import Vessel
    from seatrial.hybrid.vessel.map_proposal import MapProposal
    from seatrial.hybrid.workflows import Demonstration, DiagnosisRun

WATCH_HORIZON_S = 30
_NICENESS = 5  # the recorder goes first

VesselName = Annotated[
    Union["Vessel", str, Path, None],
    Parsed(str),
    typer.Option(help="A vessel of trials/vessels, or a vessel file."),
]
ReferenceName = Annotated[
    Union["Vessel", "BlackBox", str, Path, None],
    Parsed(str),
    typer.Option(
        "--vessel", help="A vessel of trials/vessels, a vessel file, or a simulator: FILE.fmu or FILE.py:CLASS."
    ),
]
VesselFile = Annotated[
    str | Path | None, Parsed(str), typer.Option("--vessel", help="A vessel of trials/vessels, or a vessel file.")
]
WrittenVessel = Annotated[
    str | Path | None,
    Parsed(Path, required=True),
    typer.Option("-o", "--output", help="The vessel file to write."),
]
PredictingVessel = Annotated[
    Union["Vessel", str, Path, None],
    Parsed(str),
    typer.Option(
        help="The vessel, or its file, that predicts the runs which remain; default: that of the programme."
    ),
]
InitialModel = Annotated[
    Union["Vessel", str, Path, None],
    Parsed(str),
    typer.Option(help="The initial model: a vessel of trials/vessels, or a vessel file."),
]
SeaState = Annotated[str, typer.Option(help="A sea state of trials/sea_states.toml; scaled down for a ship model.")]
Calibrator = Annotated[
    Union["TrainedCalibrator", str, Path, None],
    Parsed(Path),
    typer.Option(help="A calibrator: the folder written by `seatrial train`."),
]
CalibratorCode = Annotated[
    str | None,
    typer.Option(
        "--method", help="FILE.py:CLASS: the code of a calibrator of your own, which runs only if it is given here."
    ),
]
PredictionHorizon = Annotated[
    int | None,
    typer.Option(
        "--horizon", min=2, help="The horizon of the predictions in seconds; default: 15, or the calibrator's."
    ),
]
AllowSeen = Annotated[bool, typer.Option(help="Also test recordings that the calibrator was trained on.")]
Effects = Annotated[
    Sequence[str | Path],
    Parsed(list[Path]),
    typer.Option("--effects", help="A Python file with effects of your own."),
]
Without = Annotated[
    Sequence[str],
    Parsed(list[str]),
    typer.Option(help="An effect to leave out of the catalogue; may be repeated."),
]
Tolerance = Annotated[
    float,
    typer.Option(
        "--tolerance", min=0.0, max=20.0, help="The model error that is tolerated, in % of the force range."
    ),
]
StillWater = Annotated[bool, typer.Option("--still-water", help="There was no current and no sea.")]
NoWaves = Annotated[bool, typer.Option("--no-waves", help="There were no waves.")]
NoWind = Annotated[bool, typer.Option("--no-wind", help="There was no wind.")]
Surveyed = Annotated[
    Sequence[str],
    Parsed(list[str]),
    typer.Option(
        help="Sensors that were surveyed: position, heading, speed, yaw_rate, wind, clock or all; may be repeated."
    ),
]
Known = Annotated[
    Mapping[str, Mapping[str, float]] | Sequence[str],
    Parsed(list[str]),
    typer.Option(help="An effect of known size, EFFECT:PARAM=VALUE,...; may be repeated."),
]
RepairSensors = Annotated[
    bool,
    typer.Option(
        "--repair-sensors",
        "--repair",
        help="Also repair the scales and delays of sensors, instead of naming them.",
    ),
]
RebuildIfJitter = Annotated[
    bool | None,
    typer.Option(
        "--rebuild-positions/--keep-positions",
        help="Take positions by dead reckoning from speeds and heading, or as recorded; default: the first if the "
        "time stamps jitter.",
    ),
]
Seed = Annotated[int, typer.Option(min=0, help="The same seed gives the same figures.")]
Manoeuvres = Annotated[
    Sequence[str],
    Parsed(list[str]),
    typer.Argument(
        metavar="MANOEUVRES",
        help="MANOEUVRE or MANOEUVRE=MINUTES, one after the other: those of `seatrial simulate`, and "
        "reciprocal_headings, one_thruster_at_a_time, ...; default: the programme of docs/planning.md.",
    ),
]
SpeedConditions = Annotated[
    Union["Conditions", str, Path, None],
    Parsed(Path),
    typer.Option(
        "--conditions",
        help="A TOML file with the ship's data and the conditions, which goes above those of the "
        "recordings; default: conditions.toml beside the files.",
    ),
]
PlannedOrders = Annotated[
    str | Path | None,
    Parsed(Path),
    typer.Option(
        "--commands",
        help="A table of planned orders: second or time, and channels of actuators; default: unchanged.",
    ),
]


# Trials, before they are sailed


def _print_demonstration(done: Demonstration, as_json: bool, options: Mapping[str, Any]) -> None:
    print_line(done.validation.model, err=True)
    errors.Terminal(stderr=True).print(done.validation)
    reduction = done.validation.reduction or 0.0
    text = f"{done.report}: {sum(done.lost.values())} samples lost, {reduction:.0%} less error than the reference"
    print_line(
        json.dumps({"report": str(done.report), "lost": done.lost, "reduction": reduction}) if as_json else text
    )


@command(TRIALS, folder="output", show=_print_demonstration)
def demo(
    output: Annotated[
        str | Path, Parsed(Path), typer.Option("-o", "--output", help="The folder for all output.")
    ] = Path("demo"),
    seed: Annotated[int, typer.Option(min=0, help="The same seed gives the same voyage.")] = 1,
) -> Demonstration:
    """Run the whole chain: from simulated buses to a report.

    Parameters
    ----------
    output
        The folder for all output.
    seed
        The same seed gives the same voyage.

    Returns
    -------
    Demonstration
        The ``report``, what was played and lost, the windows, the validation and the diagnosis.

    Raises
    ------
    SourceError
        Where the recorder cannot run.

    Examples
    --------
    It takes minutes:

    >>> import seatrial as st
    >>> st.demo("demo", seed=1).report  # doctest: +SKIP
    PosixPath('demo/report.html')
    """
    from seatrial.hybrid.workflows import run_demonstration

    return run_demonstration(Path(output), seed, say=announce)


Name = Annotated[str | None, typer.Option(help="Name of ship and trial; default: the folder's.")]
LengthBetweenPerpendiculars = Annotated[
    float | None, typer.Option("--length", help="Length between perpendiculars in m.")
]
Beam = Annotated[float | None, typer.Option("--beam", help="Beam in m.")]
Draught = Annotated[float | None, typer.Option("--draught", help="Mean draught in m.")]
Block = Annotated[float | None, typer.Option("--block", help="Block coefficient.")]
ServiceSpeed = Annotated[float | None, typer.Option("--service-speed", help="Service speed in calm water in m/s.")]
_DEVICE_HELP = "{0}, NAME,KEY=NUMBER,...; may be repeated."
Propellers = Annotated[
    Sequence[Any], Parsed(list[str]), typer.Option("--propeller", help=_DEVICE_HELP.format("A propeller"))
]
Azimuths = Annotated[
    Sequence[Any], Parsed(list[str]), typer.Option("--azimuth", help=_DEVICE_HELP.format("An azimuth thruster"))
]
Rudders = Annotated[
    Sequence[Any], Parsed(list[str]), typer.Option("--rudder", help=_DEVICE_HELP.format("A rudder"))
]
Tunnels = Annotated[
    Sequence[Any], Parsed(list[str]), typer.Option("--tunnel", help=_DEVICE_HELP.format("A tunnel thruster"))
]

_NEEDED = {
    "length_m": ("--length", "Length between perpendiculars [m]"),
    "beam_m": ("--beam", "Beam [m]"),
    "draught_m": ("--draught", "Mean draught [m]"),
    "block": ("--block", "Block coefficient"),
    "service_speed_mps": ("--service-speed", "Service speed [m/s]"),
}
"""What every ship needs: its option, and how it is asked for."""

_DEVICES = {
    "propellers": ("--propeller", "A propeller, diameter=M[,pitch_ratio=..][,blades=..][,area_ratio=..][,rpm=..]"),
    "azimuths": ("--azimuth", "An azimuth thruster, diameter=M[,pitch_ratio=..][,x=M][,y=M]"),
    "rudders": ("--rudder", "A rudder, area=M2[,span=M][,behind=NAME]"),
    "tunnels": ("--tunnel", "A tunnel thruster, bow or stern,diameter=M,power=KW"),
}


@command(TRIALS, folder="folder")
def init(
    folder: Annotated[str | Path, Parsed(Path), typer.Argument(help="The folder to make.")],
    name: Name = None,
    vessel: Annotated[
        str | Path | None,
        Parsed(str),
        typer.Option(help="Your ship, if it has a vessel file: a name or a file."),
    ] = None,
    *,
    length_m: LengthBetweenPerpendiculars = None,
    beam_m: Beam = None,
    draught_m: Draught = None,
    block: Block = None,
    service_speed_mps: ServiceSpeed = None,
    propellers: Propellers = (),
    azimuths: Azimuths = (),
    rudders: Rudders = (),
    tunnels: Tunnels = (),
    force: Annotated[bool, typer.Option("--force", help="Replace existing files.")] = False,
) -> list[Path]:
    """Set up a folder for your ship's trials, from its main dimensions or vessel file.

    Parameters
    ----------
    folder
        The folder to make.
    name
        Name of ship and trial; by default the folder's.
    vessel
        The ship's vessel file, instead of its dimensions.
    length_m, beam_m, draught_m
        Length between perpendiculars, beam and mean draught [m].
    block
        The block coefficient.
    service_speed_mps
        Service speed in calm water [m/s].
    propellers, azimuths, rudders, tunnels
        Propulsors, ``"NAME,KEY=NUMBER,..."``.
    force
        Replace existing files.

    Returns
    -------
    list of Path
        The files that were written.

    Raises
    ------
    ConfigurationError
        For dimensions that are missing; a command asks for them at a terminal.

    Examples
    --------
    >>> import seatrial as st
    >>> [path.name for path in st.init("ship", vessel="gunnerus_short")]
    ['trial.toml', 'columns.toml', 'example.csv']
    """
    from seatrial.acquisition.recording.parts import safe_file_name
    from seatrial.hybrid.vessel.estimate import new_vessel as estimates
    from seatrial.hybrid.workflows import start_folder

    dimensions = dict(zip(_NEEDED, (length_m, beam_m, draught_m, block, service_speed_mps), strict=True))
    devices = dict(zip(_DEVICES, (propellers, azimuths, rudders, tunnels), strict=True))
    stated = [key for key, value in (dimensions | devices).items() if value not in (None, (), [])]
    if vessel is not None and stated:
        option, _ = (_NEEDED | _DEVICES)[stated[0]]
        raise errors.UsageError("is given with --vessel, whose file says it", where=option)
    particulars = {} if vessel is not None else ask_for_missing(dimensions, devices, "--vessel FILE")
    target = Path(folder)
    name = safe_file_name(name or target.resolve().name)
    ship = estimates.new_vessel(name=name, **particulars) if vessel is None else vessel
    for warning in getattr(ship, "warnings", ()):
        announce(f"note: {warning}")
    announce("simulating an example, the first time with half a minute of compilation")
    paths = start_folder(target, ship, name, force=force)
    for path in paths:
        announce(path, err=False)
    return paths


def ask_for_missing(
    dimensions: Mapping[str, float | None], devices: Mapping[str, Sequence[Any]], alternative: str = ""
) -> dict[str, Any]:
    """Dimensions and propulsors of a ship, those that are missing as a person at the terminal gives them.

    Without a terminal they are wrong usage; ``alternative`` is the option that makes all of them unnecessary.
    """
    missing = [key for key, value in dimensions.items() if value is None]
    driven = bool(devices["propellers"] or devices["azimuths"])
    if (missing or not driven) and not is_at_terminal():
        names = [_NEEDED[key][0] for key in missing] + ([] if driven else ["--propeller or --azimuth"])
        raise errors.UsageError(f"missing: {', '.join(names)}{f'; or give {alternative}' if alternative else ''}")
    asked = {key: float(typer.prompt(_NEEDED[key][1], type=float, err=True)) for key in missing}
    listed = {key: tuple(value) for key, value in devices.items()}
    for key in () if driven else [key for key, value in listed.items() if not value]:
        question = f"{_DEVICES[key][1]} (empty: no more)"
        while answer := str(typer.prompt(question, default="", show_default=False, err=True)):
            listed[key] += (answer,)
    return {**dimensions, **asked, **listed}


def is_at_terminal() -> bool:
    """Whether a person can be asked."""
    return sys.stdin.isatty()


def _print_map(proposal: MapProposal, as_json: bool, options: Mapping[str, Any]) -> None:
    for reason in proposal.reasons:
        print_line(f"proposed: {reason}", err=True)
    for question in proposal.questions:
        print_line(f"unclear: {question}", err=True)
    if proposal.questions:
        raise errors.InputError(
            f"leaves {len(proposal.questions)} questions open, so no map is written", where=str(proposal.file),
            fix="answer each with --answer KEY=VALUE",
        )  # fmt: skip
    print_line(options["output"] or proposal.text)


@command(TRIALS, "output", name="map", group="vessel", show=_print_map)
def vessel_map(
    file: Annotated[str | Path, Parsed(Path), typer.Argument(help="The FMU.")],
    output: Annotated[
        str | Path | None,
        Parsed(Path),
        typer.Option("-o", "--output", help="The map to write, FILE.toml beside FILE.fmu."),
    ] = None,
    *,
    answer: Annotated[
        Mapping[str, str] | Sequence[str],
        Parsed(list[str]),
        typer.Option(help="KEY=VALUE: the answer to a question; may be repeated."),
    ] = (),
) -> MapProposal:
    """Propose the map of an FMU: which of its variables are state, controls and wind.

    Parameters
    ----------
    file
        The FMU.
    output
        The map to write, ``FILE.toml`` beside ``FILE.fmu``; only if no question is open.
    answer
        Answers to questions, ``{"axes": "ned"}`` or ``"axes=ned"``.

    Returns
    -------
    MapProposal
        Its ``text``, the ``reasons`` and the ``questions`` that are open.

    Raises
    ------
    InputError
        For what is no FMU for co-simulation.

    Examples
    --------
    >>> import seatrial as st
    >>> proposal = st.vessel_map("ship.fmu", answer={"axes": "ned"})  # doctest: +SKIP
    """
    from seatrial.acquisition.core.files import write_text
    from seatrial.hybrid.vessel.map_proposal import propose_map

    pairs = [f"{key}={value}" for key, value in answer.items()] if isinstance(answer, Mapping) else list(answer)
    if wrong := [pair for pair in pairs if not pair.partition("=")[2]]:
        raise errors.UsageError(f"{wrong[0]!r} is not KEY=VALUE", where="--answer")
    proposal = propose_map(Path(file), dict(pair.split("=", 1) for pair in pairs))
    if output is not None and not proposal.questions:
        write_text(Path(output), proposal.text)
    return proposal


@command(TRIALS, "output", name="new", group="vessel")
def new_vessel(
    output: WrittenVessel = None,
    *,
    name: Annotated[str | None, typer.Option(help="The ship's name; by default that of the file.")] = None,
    length_m: LengthBetweenPerpendiculars = None,
    beam_m: Beam = None,
    draught_m: Draught = None,
    block: Block = None,
    service_speed_mps: ServiceSpeed = None,
    propellers: Propellers = (),
    azimuths: Azimuths = (),
    rudders: Rudders = (),
    tunnels: Tunnels = (),
    hull: Annotated[str, typer.Option(help="mmg, or cross_flow for low speed.")] = "mmg",
    length_overall_m: Annotated[float | None, typer.Option("--length-overall", help="Length overall in m.")] = None,
    centre_of_gravity_m: Annotated[
        float | None,
        typer.Option("--centre-of-gravity", help="Position forward of midship in m; default: estimated."),
    ] = None,
    frontal_area_m2: Annotated[
        float | None, typer.Option("--frontal-area", help="Frontal area above water in m2.")
    ] = None,
    lateral_area_m2: Annotated[
        float | None, typer.Option("--lateral-area", help="Lateral area above water in m2.")
    ] = None,
    water_density_kgpm3: Annotated[
        float, typer.Option("--water-density", help="Water density in kg/m3: fresh 1000, salt 1025.")
    ] = 1025.0,
    demihull_beam_m: Annotated[
        float | None,
        typer.Option(
            "--demihull-beam",
            help="Beam of one of a catamaran's two hulls in m; draught and block coefficient are then of one hull.",
        ),
    ] = None,
) -> NewVessel:
    """Write a vessel file from main dimensions, by published regressions.

    Parameters
    ----------
    output
        The vessel file to write.
    name
        The ship's name; by default that of the file.
    length_m, beam_m, draught_m
        Length between perpendiculars, beam and mean draught [m].
    block
        The block coefficient.
    service_speed_mps
        Service speed in calm water [m/s].
    propellers, azimuths, rudders, tunnels
        Propulsors, as objects of :mod:`seatrial.hybrid.vessel.estimate.devices` or ``"NAME,KEY=NUMBER,..."``;
        places from midship, forward and to starboard [m].
    hull
        "mmg", or "cross_flow" for low speed.
    length_overall_m, centre_of_gravity_m
        Length overall, and the centre of gravity forward of midship [m].
    frontal_area_m2, lateral_area_m2
        Areas above water [m2].
    water_density_kgpm3
        Water density [kg/m3].
    demihull_beam_m
        Beam of one of a catamaran's two hulls [m], which ``draught_m`` and ``block`` are of then; ``beam_m`` is
        that over both.

    Returns
    -------
    NewVessel
        The ``text`` of the vessel file, ``warnings``, and the shaft speed at service speed.

    Raises
    ------
    InputError
        For dimensions that no displacement ship has, and for propulsors that cannot be.
    ConfigurationError
        For dimensions that are missing; a command asks for them at a terminal.

    Notes
    -----
    The regressions and their sources are in docs/theory/estimates.md.

    Examples
    --------
    >>> import seatrial as st
    >>> ship = st.new_vessel(
    ...     name="ferry", length_m=82.0, beam_m=12.5, draught_m=5.2, block=0.74, service_speed_mps=6.0,
    ...     propellers=["main,diameter=3.4"], rudders=["rudder,area=9"],
    ... )
    >>> sorted(ship.service_rpm)
    ['main']
    """
    from seatrial.hybrid.vessel.estimate import new_vessel as estimates

    dimensions = dict(zip(_NEEDED, (length_m, beam_m, draught_m, block, service_speed_mps), strict=True))
    devices = dict(zip(_DEVICES, (propellers, azimuths, rudders, tunnels), strict=True))
    particulars = ask_for_missing(dimensions, devices)
    if hull not in ("mmg", "cross_flow"):
        raise errors.UsageError(f"no hull model {hull!r}; give mmg or cross_flow")
    ship = estimates.new_vessel(
        output,
        name=name or ("ship" if output is None else errors.printable_path(Path(output).stem)),
        **particulars,
        hull=hull,  # type: ignore[arg-type]
        length_overall_m=length_overall_m, centre_of_gravity_m=centre_of_gravity_m,
        frontal_area_m2=frontal_area_m2, lateral_area_m2=lateral_area_m2, water_density_kgpm3=water_density_kgpm3,
        demihull_beam_m=demihull_beam_m,
    )  # fmt: skip
    for warning in ship.warnings:
        announce(f"note: {warning}")
    rpm = ", ".join(f"{shaft} {value:.4g} rpm" for shaft, value in ship.service_rpm.items())
    announce(f"{particulars['service_speed_mps']:g} m/s takes {rpm}")
    announce(output, err=False)
    return ship


@command(TRIALS, "output", name="check", group="vessel", show=print_result)
def vessel_check(
    vessel: Annotated[
        Any, Parsed(str, required=True), typer.Argument(help="A vessel of trials/vessels, or a vessel file.")
    ] = None,
    rpm: Annotated[
        float | None, typer.Option(min=0.0, help="Shaft speed of the tests; default: 95 % of the shafts' limit.")
    ] = None,
    output: Annotated[
        str | Path | None,
        Parsed(Path),
        typer.Option("-o", "--output", help="A picture (.png, .svg, .pdf) or a page (.html)."),
    ] = None,
) -> VesselCheck:
    """Simulate the standard manoeuvres of a vessel file, and compare them with the IMO limits.

    Parameters
    ----------
    vessel
        A vessel, its name or its file.
    rpm
        The shaft speed of the tests; by default 95 % of the shafts' limit, that of 85 % of the highest power.
    output
        A picture (.png, .svg, .pdf) or a page (.html).

    Returns
    -------
    VesselCheck
        Steady speeds, turning circles, zigzags, pull-outs and a crash stop in still water and air, with their
        indices beside IMO's limits.

    Raises
    ------
    ConfigurationError
        For an unknown vessel, and for a vessel file that cannot be used.

    Examples
    --------
    >>> import seatrial as st
    >>> checked = st.vessel_check("gunnerus_short")
    >>> checked.as_dict()["tests"][0]["kind"]
    'turning_circle'
    """
    from seatrial.hybrid.identification.identify import indices_of_file
    from seatrial.hybrid.simulation.vessel_check import check_vessel
    from seatrial.hybrid.vessel.files import load_vessel

    ship = load_vessel(vessel)
    checked = replace(check_vessel(ship, rpm), indices=indices_of_file(ship, rpm))
    if output is not None:
        from seatrial.hybrid.report.pages import write_vessel_check

        announce(write_vessel_check(checked, Path(output)))
    return checked


@command(TRIALS, "output", name="export", group="vessel", show=print_result)
def export_vessel(
    vessel: Annotated[
        Any, Parsed(str, required=True), typer.Argument(help="A vessel of trials/vessels, or a vessel file.")
    ] = None,
    output: Annotated[
        str | Path,
        Parsed(Path, required=True),
        typer.Option("-o", "--output", help="The file to write: .py, .casadi, .fmu, .m, .mat, .sdf or .csv."),
    ] = "vessel.py",
    fmi: Annotated[int, typer.Option("--fmi", help="The version of FMI of an FMU: 2 or 3.")] = 3,
    effects: Effects = (),
) -> ModelExport:
    """Export a vessel's model, with its effects, for other simulators.

    Parameters
    ----------
    vessel
        A vessel, its name or its file.
    output
        The file, whose suffix says the form: a Python module (.py), CasADi functions (.casadi), an FMU (.fmu),
        matrices (.m, .mat), plugins of Gazebo (.sdf), or a table of the numbers (.csv).
    fmi
        The version of FMI of an FMU, 2 or 3.
    effects
        Files with effects of your own that the vessel file has.

    Returns
    -------
    ModelExport
        The files, what the form cannot express, and how far a turn and a crash stop by it are from the simulator's.

    Raises
    ------
    ConfigurationError
        For an unknown vessel, for a model with a force that cannot be translated, and for a library that is not
        installed.
    InputError
        For another suffix.

    See Also
    --------
    vessel_check
        Simulate the standard manoeuvres of the same model.

    Notes
    -----
    The equations are translated from those of the simulator; docs/export_model.md says what each form is for.

    Examples
    --------
    >>> import seatrial as st
    >>> exported = st.export_vessel("kvlcc2_7m", "kvlcc2.py")
    >>> max(off.distance_m for off in exported.deviations) < 1e-9
    True
    """
    from seatrial.hybrid.effects import catalogue_with
    from seatrial.hybrid.export.export import export_model
    from seatrial.hybrid.vessel.files import load_vessel

    ship = load_vessel(vessel)
    return export_model(ship, output, fmi, catalogue_with(effects, vessel=ship))


@command(TRIALS, "output")
def simulate(
    output: Annotated[
        str | Path,
        Parsed(Path, required=True),
        typer.Option("-o", "--output", help="The recording to write, OUT.mcap."),
    ],
    vessel: ReferenceName = None,
    sea_state: SeaState = "calm",
    manoeuvre: Annotated[
        str, typer.Option(help="voyage, programme, paper, zigzag_20_20, turning_circle_30, ...")
    ] = "voyage",
    duration_s: Annotated[
        float, typer.Option("--duration", min=1.0, help="Length of the trial in seconds.")
    ] = 1200.0,
    rate_hz: Annotated[float, typer.Option("--rate", min=0.1, max=100.0, help="Sampling rate in Hz.")] = 10.0,
    seed: Annotated[int, typer.Option(min=0, help="The same seed gives the same trial.")] = 0,
    hide: Annotated[
        Mapping[str, Mapping[str, float]] | Sequence[str],
        Parsed(list[str]),
        typer.Option(help="An effect to hide, EFFECT:PARAM=VALUE,...; may be repeated."),
    ] = (),
    effects: Effects = (),
    *,
    catalogue: Mapping[str, Any] | None = None,
) -> pd.DataFrame:
    """Simulate a trial as its sensors would have recorded it.

    Parameters
    ----------
    output
        The recording to write; what was hidden goes to ``NAME.truth.json`` beside it and into nothing else.
    vessel
        A vessel, its name or its file.
    sea_state
        A sea state of trials/sea_states.toml; scaled down for a ship model.
    manoeuvre
        "voyage", "programme", "zigzag_20_20", "turning_circle_30", ...
    duration_s
        Length of the trial [s].
    rate_hz
        Sampling rate [Hz].
    seed
        The same seed gives the same trial.
    hide
        Effects to hide, ``{"ocean_current": {"speed_mps": 0.4}}`` or ``"ocean_current:speed_mps=0.4"``.
    effects
        Files with effects of your own.
    catalogue
        The catalogue that ``hide`` chooses from, instead of the ship's with ``effects``.

    Returns
    -------
    pandas.DataFrame
        What the sensors reported, as it was recorded.

    Raises
    ------
    ConfigurationError
        For an unknown vessel, sea state, manoeuvre or effect.

    See Also
    --------
    campaign
        Simulate many trials.
    plan
        Ask before what a trial could find.

    Examples
    --------
    >>> import seatrial as st
    >>> table = st.simulate("zigzag.mcap", manoeuvre="zigzag_20_20", duration_s=120.0, rate_hz=2.0, seed=1)
    >>> len(table), round(table["port_angle_deg"].max())
    (240, 20)
    """
    from seatrial.hybrid.effects import catalogue_with, parse_effects
    from seatrial.hybrid.simulation.trial import handled_ship, record_trial, simulate_trial

    require_suffix(output, ".mcap")
    target, ship = Path(output), handled_ship(vessel)
    if catalogue is None:
        catalogue = catalogue_with(effects, vessel=ship)
    hidden = hide if isinstance(hide, Mapping) else parse_effects(hide, catalogue)
    table, truth = simulate_trial(
        ship, sea_state, manoeuvre, duration_s, rate_hz, seed, hidden, catalogue=catalogue
    )
    record_trial(table, truth, target, place="Trondheimsfjord, simulated")
    samples = int(table.notna().to_numpy().sum())
    announce(
        f"{samples:,} samples of {duration_s:g} s in {target}; the truth is in {target.with_suffix('.truth.json')}"
    )
    return table


@command(TRIALS, "write", folder="output", show=print_result)
def plan(
    manoeuvres: Manoeuvres = (),
    vessel: VesselName = None,
    sea_state: Annotated[
        str | None,
        typer.Option(help="A sea state of trials/sea_states.toml; default: gentle, for a ship model calm."),
    ] = None,
    duration_min: Annotated[
        float, typer.Option("--duration", min=5.0, max=600.0, help="Length of the trial in minutes.")
    ] = 60.0,
    tolerance_percent: Tolerance = 1.0,
    *,
    effects: Effects = (),
    without: Without = (),
    output: Annotated[
        str | Path | None,
        Parsed(Path),
        typer.Option("-o", "--output", help="A folder for plan.json and plan.html."),
    ] = None,
    write: Annotated[
        str | Path | None,
        Parsed(Path),
        typer.Option(help="Instead, write a programme for `seatrial conduct` to this TOML file."),
    ] = None,
    template: Annotated[
        str, typer.Option(help="Of --write: imo, imo_speed_trials, identification or dp_acceptance.")
    ] = "imo",
    wind_from_deg: Annotated[
        float | None, typer.Option("--wind-from", min=0.0, max=360.0, help="Of --write: where the wind comes from.")
    ] = None,
    current_to_deg: Annotated[
        float | None, typer.Option("--current-to", min=0.0, max=360.0, help="Of --write: where the current goes.")
    ] = None,
) -> Plan | TrialProgramme:
    """Say which effects a planned trial could find, and propose a better one; or write a programme.

    Parameters
    ----------
    manoeuvres
        ``MANOEUVRE`` or ``MANOEUVRE=MINUTES``, one after the other; by default the programme of docs/planning.md.
    vessel
        A vessel, its name or its file.
    sea_state
        A sea state; by default a gentle sea, for a ship's model a calm basin.
    duration_min
        Length of the trial [min].
    tolerance_percent
        The model error that is tolerated, in % of the force range.
    effects, without
        Files with effects of your own, and effects that are ruled out.
    output
        A folder for ``plan.json`` and ``plan.html``.
    write
        A TOML file for a programme of a template, which ``conduct`` sails; then nothing else is computed. One that
        is there with other contents is not replaced, as it may have been edited.
    template
        The programme: "imo", "imo_speed_trials", "identification" or "dp_acceptance".
    wind_from_deg, current_to_deg
        Where the wind comes from and the current goes to [deg]: headings and order are proposed by them.

    Returns
    -------
    Plan or TrialProgramme
        The size from which each effect would show, and a better programme; with ``write`` the programme written.

    Raises
    ------
    ConfigurationError
        For an unknown vessel, sea state, manoeuvre or effect.
    StorageError
        For a programme that is there with other contents.

    Examples
    --------
    Could five minutes of zigzag tell a current from fouling of the hull?

    >>> import seatrial as st
    >>> others = set(st.effects(vessel="otter_2m")["effect"]) - {"ocean_current", "hull_fouling"}
    >>> plan = st.plan(["zigzag_20_20"], vessel="otter_2m", duration_min=5.0, without=sorted(others))
    >>> plan.asked.indistinguishable_pairs()
    []
    >>> sorted(plan.asked.limits)
    ['hull_fouling', 'ocean_current']
    """
    from seatrial.hybrid import planning

    if write is not None:
        programme = planning.write_programme(Path(write), template, vessel, wind_from_deg, current_to_deg)
        announce(write)
        return programme
    from seatrial.hybrid.effects import catalogue_with
    from seatrial.hybrid.simulation.trial import sea_state_for_ship
    from seatrial.hybrid.vessel.files import load_vessel

    ship = load_vessel(vessel)
    sea = sea_state_for_ship(sea_state or ("calm" if ship.dimensions.is_model else "gentle"), ship.dimensions)
    catalogue, tolerance = catalogue_with(effects, without, ship), tolerance_percent / 100.0
    parts = planning.parse_programme(manoeuvres, ship, duration_min)
    with errors.progress_bar("noise") as progress:
        noise = planning.expected_noise_in_sea(ship, sea, tolerance, catalogue, progress)
    with errors.progress_bar("planning") as progress:
        planned = planning.make_plan(parts, ship, sea, noise, tolerance, catalogue, progress)
    if output is not None:
        from seatrial.hybrid.report.pages import write_plan

        for path in write_plan(planned, Path(output)):
            announce(path)
    return planned


def _print_campaign(campaign: CampaignResult, as_json: bool, options: Mapping[str, Any]) -> None:
    for row in campaign.failed:
        print_line(f"{row['name']} failed: {row['cause']}", err=True)
    done = len(campaign.rows) - len(campaign.failed)
    if as_json:
        counts = {"done": done, "reused": campaign.reused, "failed": len(campaign.failed)}
        print_line(json.dumps({"trials": len(campaign.rows), **counts, "index": str(campaign.index)}))
    else:
        print_line(f"{done} done, {campaign.reused} of them before, {len(campaign.failed)} failed", err=True)
        print_line(campaign.index)
    if campaign.failed:
        raise typer.Exit(1)


@command(TRIALS, folder="output", show=_print_campaign)
def campaign(
    file: Annotated[
        str | Path, Parsed(Path), typer.Argument(help="The campaign, a TOML file like trials/campaign.toml.")
    ],
    output: Annotated[
        str | Path,
        Parsed(Path, required=True),
        typer.Option("-o", "--output", help="The folder for all output."),
    ],
    workers: analysis.Workers = None,
    scheduler: analysis.Scheduler = None,
) -> CampaignResult:
    """Simulate many trials: vessels, seas, manoeuvres, seeds.

    Parameters
    ----------
    file
        The campaign, a TOML file like trials/campaign.toml.
    output
        The folder for the recordings, their truths and the index.
    workers, scheduler
        How many processes on this computer, or the address of a running dask scheduler.

    Returns
    -------
    CampaignResult
        A row a trial, and how many were reused and failed.

    Raises
    ------
    ConfigurationError
        For a campaign that cannot be used.

    Examples
    --------
    >>> import pathlib, seatrial as st
    >>> size = pathlib.Path("campaign.toml").write_text('''
    ... vessels = ["gunnerus_short"]
    ... sea_states = ["calm", "gentle"]
    ... manoeuvres = ["zigzag_20_20"]
    ... seeds = [1, 2]
    ... duration_s = 60.0
    ... rate_hz = 1.0
    ... ''')
    >>> done = st.campaign("campaign.toml", "campaign", workers=1)
    >>> len(done.rows), len(done.failed)
    (4, 0)
    """
    from seatrial.hybrid.simulation.trial import load_campaign, run_campaign

    if workers is not None and scheduler is not None:
        raise errors.UsageError("give --workers or --scheduler, not both")
    planned = load_campaign(Path(file))
    with errors.progress_bar("campaign") as progress:
        return run_campaign(planned, Path(output), workers, scheduler, progress)


# Predictions


def _print_training(trained: TrainedCalibrator, as_json: bool, options: Mapping[str, Any]) -> None:

    folder, metrics = Path(options["output"]), trained.metrics
    if as_json:
        print_line(json.dumps({**trained.remarks, "calibrator": str(folder), **metrics}))
        return
    print_line(str(trained), err=True)
    _announce_networks("the one without a model beside it")
    if metrics["held_out_hybrid_m"] > metrics["held_out_reference_m"]:
        print_line("warning: on legs kept out it is WORSE than the reference; it needs more held legs", err=True)
    print_line(folder)


@command(PREDICTIONS, folder="output", show=_print_training)
def train(
    recordings: analysis.Recordings,
    vessel: ReferenceName = None,
    method: Annotated[
        str, typer.Option(help="adaptive, paper, paper_adam, additive, data_driven, or FILE.py:CLASS of your own.")
    ] = "adaptive",
    horizon_s: Annotated[
        int, typer.Option("--horizon", min=2, help="The horizon of its predictions, in seconds.")
    ] = analysis.HORIZON_S,
    *,
    output: Annotated[
        str | Path | None,
        Parsed(Path, required=True),
        typer.Option("-o", "--output", help="The folder for the calibrator."),
    ] = None,
    stride_s: analysis.Stride = 5,
    time_range: analysis.TimeRange = analysis.ALL_OF_IT,
    all_windows: analysis.AllWindows = False,
    repair: analysis.Repair = False,
    rebuild_positions: analysis.RebuildPositions = False,
    seed: Annotated[int, typer.Option(min=0, help="The same seed gives the same calibrator.")] = 0,
) -> TrainedCalibrator:
    """Train a calibrator on a reference model.

    Parameters
    ----------
    recordings
        A recording, several, or a table.
    vessel
        The reference model: a vessel, its name or its file; by default that of the ship that the recordings name.
    method
        "adaptive", "paper", "paper_adam", "additive", "data_driven", or ``FILE.py:CLASS`` of your own.
    horizon_s
        The horizon of its predictions [s].
    output
        The folder for the calibrator.
    stride_s
        Seconds between the starts of windows.
    time_range
        The part of each recording's time to train on [%], ``(0, 70)`` or ``"0..70"``.
    all_windows
        All windows, under the commands as they were recorded, not only held ones.
    repair, rebuild_positions
        First repair faults beyond doubt; or replace jittering positions by dead reckoning, too.
    seed
        The same seed gives the same calibrator.

    Returns
    -------
    TrainedCalibrator
        It predicts (:func:`seatrial.predict`), and knows how well it did on legs that were kept out.

    Raises
    ------
    DataShortageError
        Where there is no window.
    ConfigurationError
        For an unknown method.

    See Also
    --------
    save_calibrator
        Write it into a folder.
    validate
        Score it on recordings that it has not seen.
    evaluate
        Compare the methods by cross-validation.

    Examples
    --------
    >>> import seatrial as st
    >>> calibrator = st.train("earlier.mcap", stride_s=10)
    >>> calibrator.horizon_s, calibrator.vessel
    (15, 'gunnerus_short')
    """
    from seatrial.hybrid import calibrators
    from seatrial.hybrid.vessel.files import trials_of_recordings

    calibrators.refuse_untrainable(method)
    files = recording_paths(recordings)
    model = calibrators.choose_predicting_reference(trials_of_recordings(files), vessel)
    plant = model.model
    calibrators.refuse_untrainable(method, plant)
    dataset = _load_dataset(
        files, horizon_s, stride_s, time_range, all_windows, repair, rebuild_positions, plant, shorter=True
    )
    with errors.progress_bar("training") as progress:
        trained = replace(
            calibrators.train_calibrator(dataset, model.file, plant, method, seed, progress), model=model.choice
        )
    if output is not None:
        from seatrial.hybrid.calibrators.own import save

        save(trained, Path(output))
    return trained


def _announce_networks(what: str) -> None:
    """Say what is left out where networks cannot be trained."""
    from seatrial.hybrid.calibrators import INSTALL, can_train

    if not can_train("data_driven"):
        announce(f"left out, as PyTorch is not installed, which trains networks: {what}; {INSTALL}")


def chosen_calibrator(
    calibrator: TrainedCalibrator | str | Path | None, method: str | None, vessel: VesselChoice | None = None
) -> TrainedCalibrator | str | Path | None:
    """A calibrator, read with its code at another place if ``method`` says so."""
    if method is None:
        return calibrator
    if not isinstance(calibrator, str | Path):
        raise errors.UsageError(
            "is the code of a trained calibrator: give its folder with --calibrator; `seatrial train` makes one, "
            "`seatrial evaluate` compares methods untrained", where="--method",
        )  # fmt: skip
    from seatrial.hybrid.calibrators.own import load

    return load(Path(calibrator), method, vessel)


@command(PREDICTIONS, show=print_result)
def validate(
    recordings: analysis.Recordings,
    calibrator: Calibrator = None,
    vessel: ReferenceName = None,
    horizon_s: PredictionHorizon = None,
    *,
    method: CalibratorCode = None,
    stride_s: analysis.Stride = 5,
    time_range: analysis.TimeRange = analysis.ALL_OF_IT,
    all_windows: analysis.AllWindows = False,
    repair: analysis.Repair = False,
    rebuild_positions: analysis.RebuildPositions = False,
    allow_seen: AllowSeen = False,
) -> Validation:
    """Score every method on recordings that were not used for training, and the model by its manoeuvre indices.

    Parameters
    ----------
    recordings
        A recording, several, or a table.
    calibrator
        A calibrator, or its folder; without one the baselines and the model are judged.
    vessel
        The reference model; by default that of the calibrator, or of the ship that the recordings name.
    horizon_s
        The horizon of the predictions [s]; by default 15, or the calibrator's.
    method
        ``FILE.py:CLASS``: the code of a calibrator of your own.
    stride_s
        Seconds between the starts of windows.
    time_range
        The part of each recording's time [%], ``(70, 100)`` or ``"70..100"``.
    all_windows
        All windows, under the commands as they were recorded, not only held ones.
    repair, rebuild_positions
        First repair faults beyond doubt; or replace jittering positions by dead reckoning, too.
    allow_seen
        Also recordings that the calibrator was trained on.

    Returns
    -------
    Validation
        ``scores`` of each method with intervals by legs, errors after 1, 2 and 5 L/V, and the indices of the
        manoeuvres beside those that the model has.

    Raises
    ------
    InputError
        For recordings that the calibrator was trained on, without ``allow_seen``.
    DataShortageError
        Where there is no window.

    See Also
    --------
    evaluate
        Compare the methods by cross-validation.

    Examples
    --------
    >>> import seatrial as st
    >>> validation = st.validate("trial.mcap", "calibrator")
    >>> {"constant_velocity", "reference", "hybrid"} <= set(validation.scores)
    True
    >>> validation.scores["hybrid"].mean_distance_m > 0.0
    True
    """
    from seatrial.analysis.tables.table import percent_of
    from seatrial.hybrid.calibrators.predict import choose_predictor
    from seatrial.hybrid.evaluation import validate as validation
    from seatrial.hybrid.evaluation.manoeuvre_indices import index_comparison, runs_of_recordings
    from seatrial.hybrid.vessel.files import trials_of_recordings

    files, part = recording_paths(recordings), percent_of(time_range)
    predictor = choose_predictor(
        trials_of_recordings(files), chosen_calibrator(calibrator, method, vessel), vessel, horizon_s
    )
    plant, trained = predictor.plant, predictor.trained
    dataset = _load_dataset(
        files,
        predictor.horizon_s,
        stride_s,
        time_range,
        all_windows,
        repair,
        rebuild_positions,
        plant,
        remark=False,
    )
    if trained is not None and not allow_seen:
        validation.refuse_training_data(dataset.sources, trained)
    scored = validation.validate_predictions(
        _add_truth_tracks(dataset, files, time_range, rebuild_positions), plant, trained
    )
    with errors.progress_bar("manoeuvres") as progress:
        runs = runs_of_recordings(
            files, plant.length_between_perpendiculars_m, part, progress,
            repair=repair or rebuild_positions, rebuild_positions=rebuild_positions,
        )  # fmt: skip
        indices = index_comparison(runs, predictor)
    return replace(
        scored, model=predictor.choice, indices=indices,
        by_length=validation.errors_after_lengths(dataset.tables, scored.windows, plant, trained),
    )  # fmt: skip


def _evaluation_values(evaluation: Evaluation, options: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """What an evaluation was made of, and that with its figures."""
    vessel, repair = options["vessel"], options["repair"] or options["rebuild_positions"]
    about = {
        **evaluation.remarks,
        "files": [str(path) for path in recording_paths(options["recordings"])],
        "vessel": str(vessel) if vessel else (evaluation.model.name if evaluation.model else ""),
        "stride_s": options["stride_s"],
        **({"any_commands": True} if options["all_windows"] else {}),
        "repair": repair,
        "rebuild_positions": options["rebuild_positions"],
        "seed": options["seed"],
    }
    return about, {**about, **evaluation.as_dict()}


@command(
    PREDICTIONS,
    folder="output",
    show=lambda evaluation, as_json, options: (
        print_line(json.dumps(_evaluation_values(evaluation, options)[1]))
        if as_json
        else print_result(evaluation, as_json, options)
    ),
)
def evaluate(
    recordings: analysis.Recordings,
    vessel: ReferenceName = None,
    horizon_s: Annotated[
        int, typer.Option("--horizon", min=2, help="The horizon of the predictions, in seconds.")
    ] = analysis.HORIZON_S,
    *,
    splits: Annotated[
        Sequence[str],
        Parsed(list[str]),
        typer.Option(
            "--split",
            help="leg, time, recording or random; may be repeated. Default: leg and time, and recording if there "
            "are several files.",
        ),
    ] = (),
    methods: Annotated[
        Sequence[str],
        Parsed(list[str]),
        typer.Option(
            "--method",
            help="A kind of calibrator, or FILE.py:CLASS of your own; may be repeated. "
            "Default: all but paper_adam.",
        ),
    ] = (),
    draws: Annotated[int, typer.Option(min=1, help="Number of random splits of legs, or of windows.")] = 5,
    stride_s: analysis.Stride = 5,
    all_windows: analysis.AllWindows = False,
    repair: analysis.Repair = False,
    rebuild_positions: analysis.RebuildPositions = False,
    output: Annotated[
        str | Path | None,
        Parsed(Path),
        typer.Option("-o", "--output", help="A folder for evaluation.json and evaluation.html."),
    ] = None,
    seed: Seed = 0,
) -> Evaluation:
    """Compare the methods by cross-validation, with 95 % intervals.

    Parameters
    ----------
    recordings
        A recording, several, or a table.
    vessel
        The reference model; by default that of the ship that the recordings name.
    horizon_s
        The horizon of the predictions [s].
    splits
        "leg", "time", "recording", "random"; by default leg and time, and recording where there are several.
    methods
        Kinds of calibrators, ``FILE.py:CLASS`` for your own; by default all but ``paper_adam`` that can be trained
        here.
    draws
        Number of random splits of legs, or of windows.
    stride_s
        Seconds between the starts of windows.
    all_windows
        All windows, under the commands as they were recorded, not only held ones.
    repair, rebuild_positions
        First repair faults beyond doubt; or replace jittering positions by dead reckoning, too.
    output
        A folder for ``evaluation.json`` and ``evaluation.html``.
    seed
        The same seed gives the same figures.

    Returns
    -------
    Evaluation
        The errors of each method and split with 95 % intervals by legs.

    Raises
    ------
    DataShortageError
        Where there are too few windows or legs for a split.

    Examples
    --------
    >>> import seatrial as st
    >>> evaluation = st.evaluate("trial.mcap", methods=["adaptive"], splits=["time"], stride_s=10)
    >>> errors = evaluation.to_frame().loc["time"]
    >>> {"constant_velocity", "reference", "adaptive"} <= set(errors.index)
    True
    """
    from seatrial.hybrid import calibrators
    from seatrial.hybrid.evaluation.study import evaluate_methods, refuse_unknown_splits, summarise_study
    from seatrial.hybrid.vessel.black_box import BlackBox
    from seatrial.hybrid.vessel.files import trials_of_recordings

    files = recording_paths(recordings)
    if not methods:
        _announce_networks("every method but adaptive")
    kinds = list(dict.fromkeys(splits)) or ["leg", "time", "recording"][: 2 if len(files) == 1 else 3]
    names = list(dict.fromkeys(methods or filter(calibrators.can_train, calibrators.COMPARED)))
    refuse_unknown_splits(kinds)
    for name in names:
        calibrators.refuse_untrainable(name)
    model = calibrators.choose_predicting_reference(trials_of_recordings(files), vessel)
    plant = model.model
    if isinstance(plant, BlackBox) and not methods:
        excluded = [name for name in names if calibrators.sets_states(name, plant)]
        names = [name for name in names if name not in excluded]
        if excluded:
            announce(f"left out, as this simulator cannot start from a state: {', '.join(excluded)}")
    for name in names:
        calibrators.refuse_untrainable(name, plant)
    dataset = _load_dataset(
        files, horizon_s, stride_s, analysis.ALL_OF_IT, all_windows, repair, rebuild_positions, plant, shorter=True
    )
    dataset = _add_truth_tracks(dataset, files, analysis.ALL_OF_IT, rebuild_positions)
    with errors.progress_bar("fitting") as progress:
        judged = evaluate_methods(dataset.windows, plant, names, kinds, draws, seed, progress)
    evaluation = replace(summarise_study(judged, plant.length_overall_m, seed), model=model.choice)
    if output is not None:
        from seatrial.hybrid.report.pages import write_evaluation

        options = {"recordings": files, "vessel": vessel, "stride_s": stride_s, "all_windows": all_windows,
                   "repair": repair, "rebuild_positions": rebuild_positions, "seed": seed}  # fmt: skip
        about, values = _evaluation_values(evaluation, options)
        for path in write_evaluation(evaluation, json.dumps(values), about, Path(output)):
            announce(path)
    return evaluation


@command(PREDICTIONS, show=print_result)
def predict(
    recording: Annotated[Data, Parsed(Path), typer.Argument(metavar="FILE", help="A recording.")],
    at: Annotated[str, typer.Option(help="ISO 8601 with zone, seconds since 1970, or +SECONDS from the start.")],
    calibrator: Calibrator = None,
    vessel: ReferenceName = None,
    horizon_s: Annotated[
        int | None,
        typer.Option(
            "--horizon", min=1, help="The horizon of the predictions in seconds; default: 15, or the calibrator's."
        ),
    ] = None,
    orders: PlannedOrders = None,
    *,
    method: CalibratorCode = None,
) -> Prediction:
    """Predict the track from one instant of a recording.

    Parameters
    ----------
    recording
        A recording, or a table.
    at
        The instant: ISO 8601 with zone, seconds since 1970, or ``"+SECONDS"`` from the start.
    calibrator
        A calibrator, or its folder; without one the model predicts.
    vessel
        The reference model; by default that of the calibrator, or of the ship that the recording names.
    horizon_s
        How far to predict [s]; by default 15, or the calibrator's horizon.
    orders
        A table of planned orders (``second`` or ``time``, and channels of actuators); by default they stay.
    method
        ``FILE.py:CLASS``: the code of a calibrator of your own.

    Returns
    -------
    Prediction
        The track, once a second, with the region that holds the position in 95 of 100 cases.

    Raises
    ------
    InputError
        For an instant outside the recording.

    See Also
    --------
    train
        Make a calibrator.
    watch
        Predict beside the recorder.

    Examples
    --------
    >>> import seatrial as st
    >>> prediction = st.predict("trial.mcap", at="+60", horizon_s=15)
    >>> prediction.track.shape
    (16, 3)
    >>> bool(abs(prediction.track[0] - prediction.measured[0]).max() < 1.0)
    True
    """
    from seatrial.analysis.tables.resample import resample
    from seatrial.analysis.tables.table import read_table, require, table_actuators, with_calm
    from seatrial.analysis.windows.held import second_by_second
    from seatrial.hybrid.calibrators import predict as predictions
    from seatrial.hybrid.vessel.files import trials_of_recordings

    files = recording_paths(recording)
    predictor = predictions.choose_predictor(
        trials_of_recordings(files), chosen_calibrator(calibrator, method, vessel), vessel, horizon_s
    )
    table = read_table(files)
    require(with_calm(table))
    recorded = second_by_second(partial(resample, table))
    planned = None if orders is None else predictions.read_commands(Path(orders), table_actuators(table))
    instant = predictions.parse_start_time(at, recorded.table)
    prediction = predictions.predict(
        recorded, instant, predictor.horizon_s, predictor.plant, predictor.trained, planned
    )
    return replace(prediction, model=predictor.choice)


def _print_conducted(conductor: Conductor, as_json: bool, options: Mapping[str, Any]) -> None:
    from seatrial.analysis.conduct.aboard import outcome_line

    if as_json:
        print_line(json.dumps(conductor.as_dict()))
    for entry in () if as_json else conductor.sailed:
        print_line(outcome_line(entry))


_SAME_LENGTH = 0.02  # of a programme's length, which may be rounded


def _check_ship_of_programme(vessel: Vessel, programme: TrialProgramme, name: Vessel | str | Path) -> None:
    """Raise :class:`ConfigurationError` for a vessel of another length than the programme's ship."""
    from seatrial.hybrid.effects import vessel_plant

    length_m, planned_m = vessel_plant(vessel).length_between_perpendiculars_m, programme.programme.length_m
    if abs(length_m / planned_m - 1.0) > _SAME_LENGTH:
        raise errors.ConfigurationError(
            "is another ship than the programme's",
            where=vessel.name if name is vessel else str(name),
            why=f"it is {length_m:.4g} m long, and the programme is for {planned_m:.4g} m",
            fix="correct length_m of the programme, or give the ship's own vessel file",
        )


def _outlook_maker(
    programme: TrialProgramme, stated: Vessel | str | Path | None, named: str | Path
) -> tuple[partial[Outlook] | None, str]:
    """What makes the outlook on the runs that remain; None and why where the programme's vessel is not there."""
    from seatrial.hybrid.identification.outlook import outlook_of_runs
    from seatrial.hybrid.vessel.files import load_vessel

    if not (stated or named):
        return None, ""
    try:
        vessel = load_vessel(stated or named)
        _check_ship_of_programme(vessel, programme, stated or named)
        return partial(outlook_of_runs, vessel, programme), ""
    except errors.ConfigurationError as error:
        if stated:
            raise
        return None, f"no outlook on the runs that remain: {error}"


@command(ABOARD, show=_print_conducted)
def conduct(
    programme: Annotated[
        str | Path,
        Parsed(Path),
        typer.Argument(help="The programme, a TOML file that `seatrial plan --write` writes."),
    ],
    config: Annotated[
        str | Path | None,
        Parsed(Path),
        typer.Option(help="The configuration that `seatrial record` runs with; default: the only recorder's."),
    ] = None,
    state: Annotated[
        str | Path | None,
        Parsed(Path),
        typer.Option(help="The file that has what was sailed; default: PROGRAMME.sailed.json. It is gone on from."),
    ] = None,
    address: Annotated[
        str, typer.Option(help="The address that the page for the bridge is served on; 0.0.0.0: to all computers.")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535, help="The port of that page; 0: no page.")] = 8767,
    duration_s: Annotated[
        float | None, typer.Option("--duration", min=0.0, help="Stop after this many seconds.")
    ] = None,
    vessel: PredictingVessel = None,
) -> Conductor:
    """Conduct a programme beside the running recorder: what is next, when to order, what is valid.

    Parameters
    ----------
    programme
        The programme, a TOML file.
    config
        The configuration that ``seatrial record`` runs with; by default that of the only recorder.
    state
        The file that has what was sailed; by default beside the programme. If it is there, it is gone on from.
    address, port
        Where the page for the bridge is served, read only; port 0 for none.
    duration_s
        When to stop [s]; by default on a signal, or where no run is left and nobody is at a terminal.
    vessel
        The vessel, its name or its file, by which the runs that remain are predicted from those before; by default
        that of the programme, and where it has none nothing is predicted.

    Returns
    -------
    Conductor
        The programme with what was ``sailed``.

    Raises
    ------
    ConfigurationError
        For a programme that cannot be used.
    InputError
        For the state of another programme, and for several recorders without ``config``.

    Examples
    --------
    It needs a recorder at work:

    >>> import seatrial as st
    >>> st.conduct("programme.toml", duration_s=60.0).sailed  # doctest: +SKIP
    []
    """
    with stop_on_signals() as stop:
        from seatrial.acquisition.config.trial_file import load_config
        from seatrial.analysis.conduct import aboard, conductor
        from seatrial.analysis.conduct.programme import load_programme

        trial, planned = None if config is None else load_config(Path(config)), load_programme(Path(programme))
        maker, remark = _outlook_maker(planned, vessel, planned.vessel_beside(Path(programme)))
        return aboard.conduct(
            planned,
            conductor.state_path(Path(programme)) if state is None else Path(state),
            stop,
            None if trial is None else (trial.trial.name, trial.path),
            duration_s,
            address,
            port or None,
            maker=maker,
            remark=remark,
        )


@command(ABOARD)
def watch(
    config: Annotated[
        str | Path, Parsed(Path), typer.Argument(help="The configuration that `seatrial record` runs with.")
    ],
    calibrator: Calibrator = None,
    vessel: ReferenceName = None,
    horizon_s: Annotated[
        int | None,
        typer.Option(
            "--horizon",
            min=2,
            max=300,
            help="The horizon of the predictions in seconds; default: 30, or the calibrator's.",
        ),
    ] = None,
    orders: Annotated[
        str | Path | None,
        Parsed(Path),
        typer.Option(
            "--commands",
            help="A table of planned orders: time or second, and channels of actuators; read "
            "again when it changes. Default: unchanged orders.",
        ),
    ] = None,
    duration_s: Annotated[
        float | None, typer.Option("--duration", min=0.0, help="Stop after this many seconds.")
    ] = None,
    *,
    method: CalibratorCode = None,
    log: Annotated[str, typer.Option(help="Log format without a terminal: text, or json lines.")] = "text",
    as_json: AsJson = False,
) -> WatchSummary:
    """Predict live beside the running recorder, and score earlier predictions.

    Parameters
    ----------
    config
        The configuration that ``seatrial record`` runs with.
    calibrator
        A calibrator, or its folder; without one the model predicts.
    vessel
        The reference model; by default that of the calibrator or of the configuration.
    horizon_s
        How far to predict [s]; by default 30, or the calibrator's horizon.
    orders
        A table of planned orders, read again when it changes.
    duration_s
        When to stop [s]; by default on a signal.
    method
        ``FILE.py:CLASS``: the code of a calibrator of your own.
    log
        "text" or "json" lines, where there is no terminal.
    as_json
        Print the counts as one JSON object.

    Returns
    -------
    WatchSummary
        Counts of predictions, mean errors, and latencies.

    Raises
    ------
    ConfigurationError
        For a configuration that cannot be used.

    Examples
    --------
    It needs a recorder at work:

    >>> import seatrial as st
    >>> st.watch("ship/trial.toml", calibrator="calibrator", duration_s=60.0)  # doctest: +SKIP
    """
    if log not in ("text", "json"):
        raise errors.UsageError("is neither text nor json", where="--log")
    with stop_on_signals() as stop:  # before the heavy imports: they take a while, and Ctrl-C may come
        with suppress(OSError, AttributeError):
            os.nice(_NICENESS)
        from seatrial.acquisition.config.trial_file import load_config
        from seatrial.hybrid import twin
        from seatrial.hybrid.calibrators.predict import choose_predictor
        from seatrial.hybrid.vessel.files import with_actuators

        trial = load_config(Path(config))
        trained = chosen_calibrator(calibrator, method, vessel)
        run_sheet = with_actuators(trial.trial, trial.expected_channels)
        predictor = choose_predictor({Path(config): run_sheet}, trained, vessel, horizon_s, WATCH_HORIZON_S)
        announce(predictor.choice)
        summary = twin.watch(
            trial, predictor, stop, duration_s,
            log_format=log, commands=None if orders is None else Path(orders),  # type: ignore[arg-type]
        )  # fmt: skip
    announce(summary)
    if as_json:
        print_line(json.dumps(twin.watch_summary_as_json(summary, predictor)))
    return summary


# What the model lacks


def _print_effects(table: pd.DataFrame, as_json: bool, options: Mapping[str, Any]) -> None:
    from seatrial.hybrid.effects import VERSION, catalogue_with
    from seatrial.hybrid.report.text import CATALOGUE_WIDTH, catalogue_tables
    from seatrial.hybrid.vessel.files import load_vessel

    catalogue = catalogue_with(options["effects"], vessel=load_vessel(options["vessel"]))
    if as_json:
        print_line(json.dumps({"version": VERSION, "effects": [effect.as_dict() for effect in catalogue.values()]}))
        return
    console = errors.Terminal()
    console.width = max(console.width, CATALOGUE_WIDTH)
    console.print(catalogue_tables(catalogue))


@command(DIAGNOSIS, show=_print_effects)
def effects(effects: Effects = (), vessel: VesselName = None) -> pd.DataFrame:
    """List the effects that a model may lack.

    Parameters
    ----------
    effects
        Files with effects of your own.
    vessel
        The vessel whose actuators the effects are of.

    Returns
    -------
    pandas.DataFrame
        One row a parameter: the effect, its family and kind, the parameter with unit, neutral value and bounds.

    Raises
    ------
    ConfigurationError
        For an unknown vessel, and for a file of effects that cannot be used.

    Examples
    --------
    >>> import seatrial as st
    >>> "ocean_current" in set(st.effects()["effect"])
    True
    """
    import pandas as pd

    from seatrial.hybrid.effects import catalogue_with
    from seatrial.hybrid.vessel.files import load_vessel

    files = [effects] if isinstance(effects, str | Path) else effects
    rows = [
        {"effect": effect.name, "family": effect.family, "kind": effect.kind, "parameter": parameter.name,
         "unit": parameter.unit, "neutral": parameter.neutral, "low": parameter.low, "high": parameter.high,
         "what": effect.what}
        for effect in catalogue_with(files, vessel=load_vessel(vessel)).values()
        for parameter in effect.parameters
    ]  # fmt: skip
    return pd.DataFrame(rows)


def _print_diagnosis(run: DiagnosisRun, as_json: bool, options: Mapping[str, Any]) -> None:
    from seatrial.hybrid.report.diagnosis import PAGE_FILE, model_line, summary

    diagnosis = run.diagnosis
    if as_json:
        print_line(json.dumps(diagnosis.as_dict()))
        return
    print_line(model_line(diagnosis))
    for name in ("not_asked", "pushes", "repaired", "left_out", "wind"):
        if name in diagnosis.provenance:
            print_line(f"{name.replace('_', ' ')}: {diagnosis.provenance[name]}")
    errors.Terminal().print(summary(diagnosis, run.extras.comparison))
    print_line(Path(options["output"]) / PAGE_FILE)


@command(DIAGNOSIS, folder="output", show=_print_diagnosis)
def diagnose(
    recordings: analysis.Recordings,
    vessel: ReferenceName = None,
    tolerance_percent: Annotated[
        float, typer.Option("--tolerance", help="The model error that is tolerated, in % of the force range.")
    ] = 1.0,
    *,
    output: Annotated[
        str | Path | None,
        Parsed(Path, required=True),
        typer.Option("-o", "--output", help="The folder for all output."),
    ] = None,
    effects: Effects = (),
    without: Without = (),
    repair_sensors: RepairSensors = False,
    rebuild_positions: RebuildIfJitter = None,
    time_range: analysis.TimeRange = analysis.ALL_OF_IT,
    identify: Annotated[
        bool | None,
        typer.Option(
            "--identify/--no-identify",
            help="First identify the model's coefficients (default: if many of them prove wrong).",
        ),
    ] = None,
    calibrate: Annotated[
        bool,
        typer.Option(
            "--calibrate", help="Also train a calibrator on the model with and without the named effects."
        ),
    ] = False,
    seed: Annotated[int, typer.Option(min=0, help="The same seed gives the same calibrators.")] = 0,
    still_water: StillWater = False,
    no_waves: NoWaves = False,
    no_wind: NoWind = False,
    surveyed: Surveyed = (),
    known: Known = (),
) -> DiagnosisRun:
    """Name the effects that the model lacks, add them, and show how the error shrinks.

    Parameters
    ----------
    recordings
        A recording, several, or a table.
    vessel
        The model: a vessel, its name or its file, or a simulator, of which only what acts outside it is asked
        (docs/own_simulator.md); by default that of the ship that the recordings name.
    tolerance_percent
        How far off the model may be anyway [% of the force range].
    output
        The folder for ``diagnosis.json``, ``vessel.toml``, ``report.html`` and the numbers behind its figures.
    effects, without
        Files with effects of your own, and effects to leave out of the catalogue.
    repair_sensors
        Repair the scales and delays of sensors, instead of naming them.
    rebuild_positions
        Take positions by dead reckoning; None: if their time stamps jitter.
    time_range
        The part of each recording's time [%], ``(0, 70)`` or ``"0..70"``.
    identify
        Have the coefficients identified before; None: if many of them prove wrong.
    calibrate
        Also train a calibrator on the model with and without the named effects.
    seed
        The same seed gives the same calibrators.
    still_water, no_waves, no_wind
        What was not there, as without current and waves in a towing tank: its effects are not searched. Recordings
        and vessel files declare it in ``[context]``.
    surveyed
        The sensors that were surveyed or calibrated, whose faults are not searched: ``position``, ``heading``,
        ``speed``, ``yaw_rate``, ``wind``, ``clock`` or ``all``.
    known
        Effects of known size, ``{"wake_both": {"fraction": 0.3}}`` or ``"wake_both:fraction=0.3"``: they belong to
        the model, and are not searched.

    Returns
    -------
    DiagnosisRun
        The ``diagnosis``: the effects named with their sizes and 95 % intervals, the gap before and after; and the
        tables that it was made from.

    Raises
    ------
    DataShortageError
        For recordings that are too short.
    InputError
        For a recording without what a diagnosis needs.

    See Also
    --------
    identify
        Fit the coefficients of the model.
    plan
        Ask before what a trial could find.
    load_diagnosis
        Read what was written.

    Examples
    --------
    >>> import seatrial as st
    >>> hidden = {"ocean_current": {"speed_mps": 0.5}}
    >>> table = st.simulate("current.mcap", duration_s=300.0, rate_hz=1.0, hide=hidden)
    >>> run = st.diagnose("current.mcap")
    >>> [effect.name for effect in run.diagnosis.effects]
    ['ocean_current']
    """
    from seatrial.analysis.tables.table import percent_of
    from seatrial.hybrid import calibrators, workflows
    from seatrial.hybrid.effects import catalogue_with
    from seatrial.hybrid.effects.context import declared_context
    from seatrial.hybrid.vessel.files import trials_of_recordings

    files = recording_paths(recordings)
    ship = calibrators.choose_reference(trials_of_recordings(files), vessel).file_or_simulator
    catalogue = catalogue_with(effects, without, ship)
    declared = declared_context(
        catalogue, still_water=still_water, no_waves=no_waves, no_wind=no_wind, surveyed=surveyed, known=known
    )
    with errors.progress_bar("diagnosing") as progress:
        run = workflows.diagnose_files(
            files, ship, tolerance_percent / 100.0, catalogue, percent_of(time_range),
            repair=repair_sensors, rebuild_positions=rebuild_positions, identify=identify, context=declared,
            progress=progress,
        )  # fmt: skip
    if calibrate:
        from seatrial.hybrid.diagnosis.calibrator_comparison import compare_calibrators, doubted_by_calibrator

        with errors.progress_bar("training") as progress:
            comparison = compare_calibrators(run.conclusion, run.tables, seed=seed, progress=progress)
        run = replace(
            run,
            diagnosis=doubted_by_calibrator(run.diagnosis, comparison),
            extras=replace(run.extras, comparison=comparison),
        )
    if output is not None:
        workflows.write_diagnosis(run, ship, Path(output))
    return run


@command(DIAGNOSIS, "output", "picture", show=print_result)
def identify(
    recordings: analysis.Recordings,
    vessel: InitialModel = None,
    output: WrittenVessel = None,
    horizon_s: Annotated[
        int, typer.Option("--horizon", min=2, help="The horizon of the predictions for validation, in seconds.")
    ] = 30,
    *,
    repair_sensors: RepairSensors = False,
    rebuild_positions: RebuildIfJitter = None,
    time_range: analysis.TimeRange = analysis.ALL_OF_IT,
    validation: Annotated[bool, typer.Option(help="Validate on a held-out part; takes twice the time.")] = True,
    segment_s: Annotated[
        float | None,
        typer.Option(
            "--segment",
            min=1.0,
            help="Length of a segment in seconds; default: 2.5, 5 or 10 ship lengths, whichever predicts held-out "
            "data best.",
        ),
    ] = None,
    picture: Annotated[
        str | Path | None, Parsed(Path), typer.Option(help="A picture of the fit: .png, .svg or .pdf.")
    ] = None,
    still_water: StillWater = False,
    no_waves: NoWaves = False,
    no_wind: NoWind = False,
    surveyed: Surveyed = (),
    known: Known = (),
) -> Identification:
    """Identify the coefficients of a model from recordings, with intervals.

    Parameters
    ----------
    recordings
        A recording, several, or a table. Each is checked before: values that were constant are excluded, and no
        segment goes over a jump of the positions.
    vessel
        The initial model: a vessel, its name or its file.
    output
        The vessel file to write.
    horizon_s
        The horizon of the predictions for validation [s].
    repair_sensors
        Repair the scales and delays of sensors before.
    rebuild_positions
        Take positions by dead reckoning; None: if their time stamps jitter.
    time_range
        The part of each recording's time [%], ``(0, 70)`` or ``"0..70"``.
    validation
        Predict a part that is held out; takes twice the time.
    segment_s
        How long each stretch is that the fit simulates from a start of its own [s]; by default the time for 2.5, 5
        or 10 ship lengths, whichever predicts the held-out part best; 2.5 without validation.
    picture
        A picture of the fit: .png, .svg or .pdf.
    still_water, no_waves, no_wind, surveyed, known
        What was not there, which sensors were surveyed, and effects of known size, as for :func:`diagnose`: they
        are not fitted.

    Returns
    -------
    Identification
        The coefficients with 95 % intervals, which the data do not determine, and the errors on the held-out part.

    Raises
    ------
    DataShortageError
        For recordings that are too short.

    Examples
    --------
    >>> import seatrial as st
    >>> identified = st.identify("trial.mcap", validation=False)
    >>> fitted = [coefficient for coefficient in identified.coefficients if coefficient.known]
    >>> all(coefficient.low < coefficient.value < coefficient.high for coefficient in fitted)
    True
    """
    from seatrial.analysis.tables.table import percent_of, warn_of_calm, with_calm
    from seatrial.analysis.windows.held import named_recordings
    from seatrial.hybrid.effects import catalogue_of, context
    from seatrial.hybrid.identification.fit import fixed_surroundings
    from seatrial.hybrid.identification.identify import identify_tables, identify_with_folds, possible_manoeuvres
    from seatrial.hybrid.vessel.files import reference_model, save_vessel, trials_of_recordings
    from seatrial.hybrid.workflows import usable_tables

    files = recording_paths(recordings)
    model = reference_model(trials_of_recordings(files), vessel)
    tables, excluded = usable_tables(
        named_recordings(files), percent_of(time_range),
        repaired=repair_sensors or bool(rebuild_positions), rebuild_positions=rebuild_positions,
    )  # fmt: skip
    for table in tables.values() if not validation else ():  # the validation reports it, too
        warn_of_calm(with_calm(table))
    catalogue = catalogue_of(model.vessel)
    declared = context.declared_context(
        catalogue, still_water=still_water, no_waves=no_waves, no_wind=no_wind, surveyed=surveyed, known=known
    )
    declared = context.context_of_recordings(trials_of_recordings(files), model.vessel, declared)
    fixed = fixed_surroundings(declared, catalogue)
    ship = context.with_known_effects(model.vessel, declared, catalogue)
    ranked = possible_manoeuvres(ship)
    with errors.progress_bar("identifying") as progress:
        if validation:
            identified, _ = identify_with_folds(
                tables, ship, horizon_s=horizon_s, segment_s=segment_s, fixed=fixed, candidates=ranked,
                progress=progress,
            )  # fmt: skip
        else:
            identified, _, _ = identify_tables(
                tables, ship, candidates=ranked, segment_s=segment_s, fixed=fixed, progress=progress
            )
    if output is not None:
        save_vessel(identified.vessel, output)
    identified = replace(
        identified, file=str(output or ""), model=model.choice, set_aside=excluded,
        context=context.DeclaredContext(declared.declarations, declared.known, fixed),
    )  # fmt: skip
    if picture is not None:
        from seatrial.analysis.report.pages import write_figure

        target = Path(picture)
        for path in write_figure(
            identified.plot(), target.parent, target.stem, [target.suffix.lstrip(".") or "png"]
        ):
            announce(path)
    return identified


# Results


def _print_speed_power(result: SpeedPower, as_json: bool, options: Mapping[str, Any]) -> None:
    from seatrial.analysis.speed_power.report import as_dict, power_text, speed_text

    speeds = [result.speed_at(power_kw) for power_kw in options["power_kw"]]
    if as_json:
        print_line(json.dumps(as_dict(result, speeds)))
        return
    print_result(result, as_json, options)
    for speed in speeds:
        text, interval = speed_text(speed)
        print_line(f"at {power_text(speed.power_kw)}: {text}, {interval or 'no interval'}")


@command(RECORDINGS, folder="output", show=_print_speed_power)
def speed_power(
    recordings: Annotated[
        Data,
        Parsed(list[Path]),
        typer.Argument(metavar="FILES", help="Recordings, or a table of run averages: .csv, .xlsx, one row a run."),
    ],
    conditions: SpeedConditions = None,
    vessel: VesselName = None,
    wind_coefficients: Annotated[
        str | Path | None,
        Parsed(Path),
        typer.Option(help="A table of the ship's wind resistance: columns angle off the bow in degrees and C_AA."),
    ] = None,
    *,
    power_kw: Annotated[
        Sequence[float],
        Parsed(list[float]),
        typer.Option("--power", help="Print the speed at this power in kW; may be repeated."),
    ] = (),
    output: analysis.OutputFolder = None,
) -> SpeedPower:
    """Speed-power curve from reciprocal runs, corrected for current and wind.

    Parameters
    ----------
    recordings
        Recordings of one trial, or tables of run averages (.csv, .xlsx) with one row a run.
    conditions
        The conditions of the ship and the day, or the TOML file that holds them; by default ``conditions.toml``
        beside the files. They are completed by those of the recordings or tables and by the vessel file.
    vessel
        A vessel, its name or its file; by default that of the ship which the first recording names.
    wind_coefficients
        A table of the ship's wind resistance: columns ``angle`` [deg] off the bow and ``C_AA``.
    power_kw
        Powers [kW] whose speeds the command prints; see ``speed_at`` of the result.
    output
        A folder for the page and its numbers.

    Returns
    -------
    SpeedPower
        Speeds at the power of each setting with 95 % intervals, the corrections with their sizes.

    Raises
    ------
    InputError
        Where no power was recorded, and for a table that is none of run averages.
    DataShortageError
        Without a double run.

    Notes
    -----
    ISO 15016:2015; see docs/speed_power.md.

    Examples
    --------
    Half a knot of current is with the first run and against the second:

    >>> import pandas as pd, seatrial as st
    >>> runs = {
    ...     "start": ["2026-05-01 08:00", "2026-05-01 08:40"], "duration [min]": [10, 10],
    ...     "heading [deg]": [0, 180], "speed over ground [kn]": [12.5, 11.5], "shaft power [kW]": [4000, 4000],
    ... }
    >>> pd.DataFrame(runs).to_csv("runs.csv", index=False)
    >>> round(st.speed_power("runs.csv").speed_at(4000.0).speed_mps / 1852.0 * 3600.0, 6)
    12.0
    """
    from seatrial.acquisition.config import declarations, run_sheet
    from seatrial.acquisition.recording.reader import read_recordings
    from seatrial.analysis.speed_power import analysis as calculation
    from seatrial.analysis.speed_power import formulas, runs
    from seatrial.analysis.tables.table import table_of
    from seatrial.hybrid.vessel import files as vessel_files

    files = recording_paths(recordings)
    if not isinstance(conditions, run_sheet.Conditions):
        text = run_sheet.read_statement_text(None if conditions is None else Path(conditions), files[0])
        conditions = run_sheet.statement_from_text(text).conditions
    if wind_coefficients is not None:
        conditions = replace(conditions, wind_resistance=formulas.read_wind_resistance(Path(wind_coefficients)))
    tables = [path for path in files if runs.is_run_table(path)]
    if tables and len(tables) < len(files):
        raise errors.InputError(
            "are tables of run averages and recordings", where=", ".join(path.name for path in files),
            fix="give either; one trial is in one form",
        )  # fmt: skip
    if tables:
        read = [runs.read_run_table(path) for path in files]
        for table in read:
            conditions = conditions.completed_from(table.conditions)
        if vessel is not None:
            conditions = conditions.completed_from(vessel_files.conditions_of(vessel_files.load_vessel(vessel)))
        result = calculation.speed_power_of_runs([run for table in read for run in table.runs], conditions)
        remarks = [f"columns of {path.name} that are not used: {', '.join(table.passed_over)}"
                   for path, table in zip(files, read, strict=True) if table.passed_over]  # fmt: skip
        result = replace(result, warnings=(*result.warnings, *remarks))
    else:
        raw = list(read_recordings(files))
        recorded = [(recording.trial, table_of(recording)) for recording in raw]
        ship = vessel or declarations.vessel_file_of_ship(raw[0].trial.vessel, raw[0].path.parent)
        loaded = vessel_files.load_vessel(ship) if ship else None
        conditions = vessel_files.correction_conditions(recorded, loaded, conditions)
        events = [event for recording in raw for event in recording.events]
        result = calculation.speed_power([table for _, table in recorded], conditions, events)
    for speed in power_kw:
        result.speed_at(speed)  # outside of the runs it is an error before anything is written
    if output is not None:
        from seatrial.analysis.speed_power.report import write_speed_power

        for path in write_speed_power(result, Path(output)):
            announce(path)
    return result


def _print_pages(paths: list[Path], as_json: bool, options: Mapping[str, Any]) -> None:
    if as_json:
        pages = [str(path) for path in paths if path.suffix != ".pdf"]
        pdfs = [str(path) for path in paths if path.suffix == ".pdf"]
        print_line(json.dumps({"report": pages[0], "pages": pages, "pdf": pdfs}))
    for path in () if as_json else paths:
        print_line(path)


@command(RECORDINGS, show=_print_pages)
def report(
    folder: Annotated[
        str | Path,
        Parsed(Path),
        typer.Argument(
            help="A recording, a folder of recordings, or an output folder of diagnose, reproduce or batch."
        ),
    ],
    calibrator: Annotated[
        str | Path | None,
        Parsed(Path),
        typer.Option(help="A calibrator: the folder written by `seatrial train`; default: the one in FOLDER."),
    ] = None,
    vessel: VesselFile = None,
    horizon_s: PredictionHorizon = None,
    *,
    method: CalibratorCode = None,
    time_range: analysis.TimeRange = analysis.ALL_OF_IT,
    no_repair: Annotated[bool, typer.Option("--no-repair", help="Do not repair anything.")] = False,
    allow_seen: AllowSeen = False,
    recordings: Annotated[
        str | Path | None,
        Parsed(Path),
        typer.Option(help="For the results of a batch: the folder of its recordings."),
    ] = None,
    length_m: Annotated[
        float | None,
        typer.Option(
            "--length",
            min=0.1,
            help="The ship's length between perpendiculars in metres, if no vessel file has it.",
        ),
    ] = None,
    interactive: Annotated[
        bool,
        typer.Option(
            "--interactive/--no-interactive", help="Also write an interactive page of track and channels."
        ),
    ] = True,
    conditions: Annotated[
        str | Path | None,
        Parsed(Path),
        typer.Option(
            help="A TOML file that states what the recordings do not: conditions, particulars, instruments, "
            "run sheet; default: conditions.toml beside the recordings."
        ),
    ] = None,
    pdf: Annotated[bool, typer.Option("--pdf/--no-pdf", help="Also write each page as PDF.")] = True,
) -> list[Path]:
    """Write the report of a trial, a diagnosis, a reproduction or a batch, as HTML and PDF.

    Parameters
    ----------
    folder
        A recording, a folder of recordings, or an output folder of diagnose, reproduce or batch.
    calibrator
        The folder of a calibrator; by default the one in ``folder``.
    vessel
        The name or the file of the vessel; by default that of the ship that the recordings name.
    horizon_s
        The horizon of the predictions [s]; by default 15, or the calibrator's.
    method
        ``FILE.py:CLASS``: the code of a calibrator of your own.
    time_range
        The part of each recording's time that the model is judged on [%].
    no_repair
        Repair nothing.
    allow_seen
        Also recordings that the calibrator was trained on.
    recordings
        For the results of a batch: the folder of its recordings.
    length_m
        The ship's length between perpendiculars [m], if no vessel file has it.
    interactive
        Also write an interactive page of track and channels.
    conditions
        A TOML file that states what the recordings do not; by default ``conditions.toml`` beside them.
    pdf
        Also write each page as PDF.

    Returns
    -------
    list of Path
        The pages, then their PDFs.

    Raises
    ------
    InputError
        For a folder that holds nothing to report on.

    See Also
    --------
    load_case
        The same sections for a notebook.

    Examples
    --------
    >>> import seatrial as st
    >>> [path.name for path in st.report("trial.mcap", interactive=False, pdf=False)]
    ['report.html']
    """
    from seatrial.analysis.report.pages import write_pdf
    from seatrial.analysis.tables.table import percent_of
    from seatrial.hybrid.report import folder as folders
    from seatrial.hybrid.report.text import FAILED

    place = Path(folder)
    choices = folders.Choices(
        None if calibrator is None else Path(calibrator), None if vessel is None else str(vessel), horizon_s,
        percent_of(time_range), not no_repair, allow_seen, interactive, length_m, method,
        None if conditions is None else Path(conditions),
    )  # fmt: skip
    source = None if recordings is None else Path(recordings)
    with lock_output_folder(folders.folder_for_report(place)), errors.progress_bar("report") as progress:
        pages = folders.write_reports(
            place, choices, source, errors.subtask_progress(progress, 0, 2) if pdf else progress
        )
        printed, warnings = list[Path](), list[str]()
        for number, page in enumerate(pages if pdf else ()):
            try:
                printed.append(write_pdf(page))
            except errors.ConfigurationError as error:
                warnings = [str(error)]
            progress(0.5 + 0.5 * (number + 1) / len(pages))
    warnings += [f"a section of {page} failed; its place in the page says why" for page in pages
                 if FAILED in page.read_text(encoding="utf-8")]  # fmt: skip
    for warning in warnings:
        announce(f"warning: {warning}")
    return [*pages, *printed]


# The paper


@command(PREDICTIONS, folder="output", group="reproduce", show=print_result)
def table3(
    output: analysis.OutputFolder = None,
    seed: Seed = 0,
    seeds: Annotated[int, typer.Option(min=1, help="Number of campaigns in each sea state.")] = 5,
    workers: analysis.Workers = None,
) -> Any:
    """Reproduce the paper's Table III on unseen sequences, and with the random split.

    Parameters
    ----------
    output
        A folder for the page with its figures, JSON and CSV.
    seed, seeds
        The first seed, and the number of campaigns in each sea state.
    workers
        Number of processes; by default one per core.

    Returns
    -------
    Table3
        Each published reduction beside ours.

    Raises
    ------
    ConfigurationError
        Without PyTorch, which trains the networks.

    Examples
    --------
    It takes minutes:

    >>> import seatrial as st
    >>> table = st.table3("reproduction", seeds=1)  # doctest: +SKIP
    """
    from seatrial.notebooks.wang2021 import campaign, figures, page
    from seatrial.notebooks.wang2021 import table3 as tables

    target = None if output is None else Path(output)
    jobs = tables.papers_jobs(seed, seeds)
    running = page.RunningTable(len(jobs), workers, target, announce)
    running.announce()
    with errors.progress_bar("campaigns") as progress:
        seas = campaign.seas_of(jobs, workers, progress, running.add)
    table = tables.table3(seas)
    if target is not None:
        with written_together(target / page.TABLE):
            figures.write_figures([sea for sea in seas if sea.job.seed == seed], target)
            written = page.write_table3(table, target)
        for path in (*written, page.write_page(target)):
            announce(path)
    return table


def _print_figures(paths: list[Path], as_json: bool, options: Mapping[str, Any]) -> None:
    if as_json:
        print_line(json.dumps({"figures": [str(path) for path in paths]}))
    for path in () if as_json else paths:
        print_line(path)


@command(PREDICTIONS, folder="output", group="reproduce", show=_print_figures)
def figures(
    output: Annotated[
        str | Path, Parsed(Path), typer.Option("-o", "--output", help="The folder for the figures.")
    ] = Path("reproduction"),
    seed: Seed = 0,
) -> list[Path]:
    """Reproduce the figures of the paper.

    Parameters
    ----------
    output
        The folder for the figures.
    seed
        The same seed gives the same figures.

    Returns
    -------
    list of Path
        The pictures and their numbers.

    Raises
    ------
    ConfigurationError
        Without PyTorch, which trains the networks.

    Examples
    --------
    It takes minutes:

    >>> import seatrial as st
    >>> paths = st.figures("reproduction")  # doctest: +SKIP
    """
    from seatrial.notebooks.wang2021 import campaign, table3
    from seatrial.notebooks.wang2021 import figures as drawings

    with errors.progress_bar("figures") as progress:
        seas = campaign.seas_of(table3.papers_jobs(seed, 1), progress=progress)
        return list(drawings.write_figures(seas, Path(output)))


def _print_fidelity(fidelity: Any, as_json: bool, options: Mapping[str, Any]) -> None:
    from seatrial.notebooks import fidelity_map

    numbers = fidelity_map.with_reading(fidelity)
    if as_json:
        print_line(json.dumps(numbers))
    for sentence in () if as_json else numbers["reading"]:
        print_line(sentence)


@command(PREDICTIONS, folder="output", group="reproduce", show=_print_fidelity)
def fidelity(
    output: analysis.OutputFolder = None,
    seed: Seed = 0,
    seeds: Annotated[int, typer.Option(min=1, help="Number of random training sets to average over.")] = 2,
    sea_state: SeaState = "gentle",
    method: Annotated[str, typer.Option(help="The calibrator to train on every reference model.")] = "paper",
    workers: analysis.Workers = None,
) -> Any:
    """Map how the hybrid's gain depends on the error of the reference model.

    Parameters
    ----------
    output
        A folder for the map.
    seed, seeds
        The first seed, and the number of random training sets to average over.
    sea_state
        A sea state of trials/sea_states.toml.
    method
        The calibrator to train on every reference model.
    workers
        Number of processes; by default one per core.

    Returns
    -------
    FidelityMap
        The errors of reference and hybrid for each degraded model.

    Raises
    ------
    ConfigurationError
        For an unknown method or sea state, and without PyTorch, which trains the networks.

    Examples
    --------
    It takes minutes:

    >>> import seatrial as st
    >>> mapped = st.fidelity("fidelity", seeds=1)  # doctest: +SKIP
    """
    from seatrial.hybrid.calibrators import refuse_untrainable
    from seatrial.hybrid.simulation.trial import sea_state_named
    from seatrial.notebooks import fidelity_map

    for name in (method, "data_driven"):
        refuse_untrainable(name)
    sea_state_named(sea_state)
    with errors.progress_bar("fidelity") as progress:
        mapped = fidelity_map.papers_map(sea_state, method, seed, seeds, workers, progress)
    if output is not None:
        target = Path(output)
        page = fidelity_map.page_of(mapped, f"{method}, {sea_state} sea").write(target / "fidelity_map.html")
        for path in (*fidelity_map.write_map(mapped, target), page):
            announce(path)
    return mapped


def _load_dataset(
    files: list[Path],
    horizon_s: int,
    stride_s: int,
    time_range: tuple[float, float] | str,
    all_windows: bool,
    repair: bool,
    rebuild_positions: bool,
    plant: MotionModel,
    *,
    shorter: bool = False,
    remark: bool = True,
) -> Dataset:
    """The windows of recordings; unless the result does so, with a ``remark`` on the time in which the ship is not
    free."""
    from seatrial.analysis.quality.situations import left_out_notes
    from seatrial.analysis.tables.table import percent_of
    from seatrial.hybrid.prediction.dataset import load_dataset

    with errors.progress_bar("reading") as progress:
        dataset = load_dataset(
            files, horizon_s, stride_s, percent_of(time_range), progress, shorter=shorter,
            any_commands=all_windows, length_m=plant.length_overall_m,
            repair=repair or rebuild_positions, rebuild_positions=rebuild_positions,
        )  # fmt: skip
    if remark:
        for note in left_out_notes(dataset.dropped):
            announce(note)
    return dataset


def _add_truth_tracks(
    dataset: Dataset, files: list[Path], time_range: tuple[float, float] | str, rebuilt: bool
) -> Dataset:
    """The data set with its windows' tracks by each sensor as it was measured."""
    from seatrial.analysis.tables.table import percent_of
    from seatrial.analysis.windows.held import tables_of_recordings
    from seatrial.hybrid.evaluation.validate import add_truth_tracks

    with errors.progress_bar("sensors") as progress:
        tables = dataset.tables
        if rebuilt:
            tables = tables_of_recordings(files, time_range=percent_of(time_range), repair=True)
        measured = {trial: table.table for trial, table in tables.items()}
        return replace(dataset, windows=add_truth_tracks(dataset.windows, measured, progress, rebuilt=rebuilt))
