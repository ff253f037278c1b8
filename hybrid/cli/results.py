"""``seatrial diagnose``, ``identify``, ``reproduce`` and ``report``: they parse, call and print."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from seatrial.acquisition.cli import AsJson, writes
from seatrial.acquisition.core.errors import bar, part_of
from seatrial.acquisition.core.files import written_together
from seatrial.acquisition.core.process import echo
from seatrial.hybrid.cli import (
    AllowSeenOption,
    CodeOption,
    EffectsOption,
    HorizonOption,
    PartOption,
    Recordings,
    SeaStateOption,
    VesselOption,
    WorkersOption,
    print_result,
)

Folder = Annotated[Path | None, typer.Option("-o", "--output", help="A folder for the results.")]
RepairSensors = Annotated[
    bool, typer.Option("--repair", help="Also repair the scales and delays of sensors, instead of naming them.")
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


@writes(folder="output")
def speed_power(
    files: Annotated[
        list[Path], typer.Argument(help="Recordings, or a table of run averages: .csv, .xlsx, one row a run.")
    ],
    conditions: Annotated[
        Path | None,
        typer.Option(
            help="A TOML file with the ship's data and the conditions, which goes above those of the "
            "recordings; default: conditions.toml beside the files."
        ),
    ] = None,
    wind_coefficients: Annotated[
        Path | None,
        typer.Option(help="A table of the ship's wind resistance: columns angle off the bow in degrees and C_AA."),
    ] = None,
    vessel: VesselOption = None,
    power: Annotated[
        list[float] | None, typer.Option(help="Print the speed at this power in kW; may be repeated.")
    ] = None,
    output: Folder = None,
    as_json: AsJson = False,
) -> None:
    """Speed-power curve from reciprocal runs, corrected for current and wind."""
    from seatrial.hybrid.scripting import speed_power as analyse

    found = analyse(files, conditions, vessel, wind_coefficients)
    asked = [found.speed_at(each) for each in power or ()]
    if output is not None:
        from seatrial.analysis.speed_power.report import write_speed_power

        for path in write_speed_power(found, output):
            echo(path, err=True)
    from seatrial.analysis.speed_power.report import as_dict, power_text, speed_text

    print_result(as_dict(found, asked), found, as_json=as_json)
    for each in asked if not as_json else ():
        speed, interval = speed_text(each)
        echo(f"at {power_text(each.power_kw)}: {speed}, {interval or 'no interval'}")


@writes(folder="output")
def diagnose(
    files: Recordings,
    output: Annotated[Path, typer.Option("-o", "--output", help="The folder for all output.")],
    vessel: VesselOption = None,
    tolerance: Annotated[
        float, typer.Option(help="The model error that is tolerated, in % of the force range.")
    ] = 1.0,
    effects: EffectsOption = None,
    without: Annotated[
        list[str] | None, typer.Option(help="An effect to leave out of the catalogue; may be repeated.")
    ] = None,
    repair: RepairSensors = False,
    rebuild_positions: RebuildIfJitter = None,
    part: PartOption = "0..100",
    identify_first: Annotated[
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
    as_json: AsJson = False,
) -> None:
    """Name the effects that the model lacks, add them, and show how the error shrinks."""
    from seatrial.analysis.tables.table import percent_of
    from seatrial.hybrid.effects.catalogue import catalogue_with
    from seatrial.hybrid.vessel.files import reference_model, trials_of
    from seatrial.hybrid.workflows import diagnose_files, write_diagnosis

    ship = reference_model(trials_of(files), vessel).vessel
    catalogue = catalogue_with(effects or (), without or (), ship)
    with bar("diagnosing") as progress:
        diagnosed = diagnose_files(
            files, ship, tolerance / 100.0, catalogue, percent_of(part),
            repair=repair, rebuild_positions=rebuild_positions, identify=identify_first, progress=progress,
        )  # fmt: skip
    if calibrate:
        from dataclasses import replace

        from seatrial.hybrid.diagnosis.calibrator_comparison import compare_calibrators, doubted_by_calibrator

        with bar("training") as progress:
            ladder = compare_calibrators(diagnosed.conclusion, diagnosed.tables, seed=seed, progress=progress)
        diagnosed = replace(
            diagnosed,
            diagnosis=doubted_by_calibrator(diagnosed.diagnosis, ladder),
            extras=replace(diagnosed.extras, ladder=ladder),
        )
    page = write_diagnosis(diagnosed, ship, output)
    diagnosis = diagnosed.diagnosis
    if as_json:
        echo(json.dumps(diagnosis.as_dict()))
        return
    from seatrial.acquisition.core.errors import Terminal
    from seatrial.hybrid.report.diagnosis import model_line, summary

    echo(model_line(diagnosis))
    for name in ("repaired", "left_out", "wind"):
        if name in diagnosis.provenance:
            echo(f"{name.replace('_', ' ')}: {diagnosis.provenance[name]}")
    Terminal().print(summary(diagnosis, diagnosed.extras.ladder))
    echo(str(page))


@writes("output", "picture")
def identify(
    files: Recordings,
    output: Annotated[Path, typer.Option("-o", "--output", help="The vessel file to write.")],
    vessel: Annotated[
        str | None, typer.Option(help="The initial model: a vessel of trials/vessels, or a vessel file.")
    ] = None,
    horizon: Annotated[
        int, typer.Option(min=2, help="The horizon of the predictions for validation, in seconds.")
    ] = 30,
    repair: RepairSensors = False,
    rebuild_positions: RebuildIfJitter = None,
    part: PartOption = "0..100",
    validation: Annotated[bool, typer.Option(help="Validate on a held-out part; takes twice the time.")] = True,
    segment: Annotated[
        float | None,
        typer.Option(
            min=1.0,
            help="Length of a segment in seconds; default: about the time for one ship length.",
        ),
    ] = None,
    picture: Annotated[Path | None, typer.Option(help="A picture of the fit: .png, .svg or .pdf.")] = None,
    as_json: AsJson = False,
) -> None:
    """Identify the coefficients of a model from recordings, with intervals."""
    from seatrial.hybrid.scripting import identify as run

    found = run(
        files, vessel, output, horizon, repair=repair, rebuild_positions=rebuild_positions, validation=validation,
        segment_s=segment, part=part,
    )  # fmt: skip
    if picture is not None:
        from seatrial.analysis.report.rendering import write_figure

        for path in write_figure(found.plot(), picture.parent, picture.stem, [picture.suffix.lstrip(".") or "png"]):
            echo(path, err=True)
    print_result(found.as_dict(), found, as_json=as_json)


@writes(folder="output")
def table3(
    output: Folder = None,
    seed: Seed = 0,
    seeds: Annotated[int, typer.Option(min=1, help="Number of campaigns in each sea state.")] = 5,
    workers: WorkersOption = None,
    as_json: AsJson = False,
) -> None:
    """Reproduce the paper's Table III on unseen sequences, and with the random split."""
    from seatrial.notebooks.wang2021.campaign import seas_of
    from seatrial.notebooks.wang2021.page import RunningTable, write_table3
    from seatrial.notebooks.wang2021.table3 import papers_jobs
    from seatrial.notebooks.wang2021.table3 import table3 as table_of

    jobs = papers_jobs(seed, seeds)
    running = RunningTable(len(jobs), workers, output, partial(echo, err=True))
    running.announce()
    with bar("campaigns") as progress:
        seas = seas_of(jobs, workers, progress, running.add)
    table = table_of(seas)
    if output is not None:
        from seatrial.notebooks.wang2021.figures import write_figures
        from seatrial.notebooks.wang2021.page import TABLE, write_page

        with written_together(output / TABLE):
            write_figures([sea for sea in seas if sea.job.seed == seed], output)
            written = write_table3(table, output)
        for path in (*written, write_page(output)):
            echo(path, err=True)
    print_result(table.as_dict(), table, as_json=as_json)


@writes(folder="output")
def figures(
    output: Annotated[Path, typer.Option("-o", "--output", help="The folder for the figures.")] = Path(
        "reproduction"
    ),
    seed: Seed = 0,
    as_json: AsJson = False,
) -> None:
    """Reproduce the figures of the paper."""
    from seatrial.notebooks.wang2021.campaign import seas_of
    from seatrial.notebooks.wang2021.figures import write_figures
    from seatrial.notebooks.wang2021.table3 import papers_jobs

    with bar("figures") as progress:
        paths = write_figures(seas_of(papers_jobs(seed, 1), progress=progress), output)
    if as_json:
        echo(json.dumps({"figures": [str(path) for path in paths]}))
        return
    for path in paths:
        echo(path)


@writes(folder="output")
def fidelity(
    output: Folder = None,
    seed: Seed = 0,
    seeds: Annotated[int, typer.Option(min=1, help="Number of random training sets to average over.")] = 2,
    sea_state: SeaStateOption = "gentle",
    method: Annotated[str, typer.Option(help="The calibrator to train on every reference model.")] = "paper",
    workers: WorkersOption = None,
    as_json: AsJson = False,
) -> None:
    """Map how the hybrid's gain depends on the error of the reference model."""
    from seatrial.hybrid.calibrators import refuse_untrainable
    from seatrial.hybrid.simulation.trial import sea_state_named
    from seatrial.notebooks import fidelity_map

    for each in (method, "data_driven"):
        refuse_untrainable(each)
    sea_state_named(sea_state)
    with bar("fidelity") as progress:
        found = fidelity_map.papers_map(sea_state, method, seed, seeds, workers, progress)
    if output is not None:
        page = fidelity_map.page_of(found, f"{method}, {sea_state} sea").write(output / "fidelity_map.html")
        for path in (*fidelity_map.write_map(found, output), page):
            echo(path, err=True)
    numbers = fidelity_map.with_reading(found)
    if as_json:
        echo(json.dumps(numbers))
        return
    for sentence in numbers["reading"]:
        echo(sentence)


def report(
    folder: Annotated[
        Path,
        typer.Argument(
            help="A recording, a folder of recordings, or an output folder of diagnose, reproduce or batch."
        ),
    ],
    calibrator: Annotated[
        Path | None,
        typer.Option(help="A calibrator: the folder written by `seatrial train`; default: the one in FOLDER."),
    ] = None,
    method: CodeOption = None,
    vessel: VesselOption = None,
    horizon: HorizonOption = None,
    part: PartOption = "0..100",
    no_repair: Annotated[bool, typer.Option("--no-repair", help="Do not repair anything.")] = False,
    allow_seen: AllowSeenOption = False,
    recordings: Annotated[
        Path | None, typer.Option(help="For the results of a batch: the folder of its recordings.")
    ] = None,
    length: Annotated[
        float | None,
        typer.Option(min=0.1, help="The ship's length between perpendiculars in metres, if no vessel file has it."),
    ] = None,
    interactive: Annotated[
        bool,
        typer.Option(
            "--interactive/--no-interactive", help="Also write an interactive page of track and channels."
        ),
    ] = True,
    conditions: Annotated[
        Path | None,
        typer.Option(
            help="A TOML file that states what the recordings do not: conditions, particulars, instruments, "
            "run sheet; default: conditions.toml beside the recordings."
        ),
    ] = None,
    pdf: Annotated[bool, typer.Option("--pdf/--no-pdf", help="Also write each page as PDF.")] = True,
    as_json: AsJson = False,
) -> None:
    """Write the report of a trial, a diagnosis, a reproduction or a batch, as HTML and PDF."""
    from seatrial.acquisition.core.errors import ConfigurationError
    from seatrial.acquisition.core.files import locked_folder
    from seatrial.analysis.report.rendering import write_pdf
    from seatrial.hybrid.report.folder import Choices, report_folder
    from seatrial.hybrid.report.folder import report as run
    from seatrial.hybrid.report.sections import FAILED

    choices = Choices(calibrator, vessel, horizon, part, not no_repair, allow_seen, interactive, length, method,
                      conditions)  # fmt: skip
    with locked_folder(report_folder(folder)), bar("report") as progress:
        pages = run(folder, choices, recordings, part_of(progress, 0, 2) if pdf else progress)
        printed, warnings = list[Path](), list[str]()
        for number, page in enumerate(pages if pdf else ()):
            try:
                printed.append(write_pdf(page))
            except ConfigurationError as error:
                warnings = [str(error)]
            progress(0.5 + 0.5 * (number + 1) / len(pages))
    warnings += [f"a section of {page} failed; its place in the page says why" for page in pages
                 if FAILED in page.read_text(encoding="utf-8")]  # fmt: skip
    if as_json:
        named = {"pages": [str(page) for page in pages], "pdf": [str(each) for each in printed]}
        echo(json.dumps({"report": str(pages[0]), **named}))
    for path in () if as_json else (*pages, *printed):
        echo(path)
    for warning in warnings:
        echo(f"warning: {warning}", err=True)
