"""The commands ashore that need no model: check, export, windows, manoeuvres, batch."""

from __future__ import annotations

import json
from contextlib import suppress
from pathlib import Path
from typing import Annotated

import typer

from seatrial.acquisition.cli import RECORDINGS, AsJson, Output, writes
from seatrial.acquisition.core.files import expect_suffix
from seatrial.acquisition.core.process import echo

RebuildPositions = Annotated[
    bool,
    typer.Option(
        "--rebuild-positions",
        help="Also replace positions with jittering time stamps by dead reckoning from speeds and heading, "
        "and such headings by the integrated yaw rate.",
    ),
]

Files = Annotated[list[Path], typer.Argument(help="A recording, or the parts of one.")]
Horizon = Annotated[int, typer.Option(min=2, help="The length of a window (the horizon) in seconds.")]
Stride = Annotated[int, typer.Option(min=1, help="Seconds between the starts of windows.")]


def mount(app: typer.Typer) -> None:
    """Add this package's commands to the command line; their help is what they say of themselves."""
    for command in (check, export, windows, manoeuvres, smooth, batch, serve):
        app.command(rich_help_panel=RECORDINGS)(command)


@writes("repair", folder="output")
def check(
    files: Files,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="A folder for quality.json, flags.parquet, quality.html.")
    ] = None,
    repair: Annotated[
        Path | None,
        typer.Option("--repair", help="Also write a repaired recording: only faults beyond doubt are repaired."),
    ] = None,
    rebuild_positions: RebuildPositions = False,
    own: Annotated[
        list[str] | None,
        typer.Option("--check", help="FILE.py:FUNCTION: a check of your own; may be repeated."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Check the data quality of a recording, channel by channel."""
    from seatrial.acquisition.recording.grouping import read_together
    from seatrial.analysis.quality.check import check_recording
    from seatrial.analysis.tables.table import table_of

    if repair is not None:
        expect_suffix(repair, ".mcap")
    elif rebuild_positions:
        raise typer.BadParameter("--rebuild-positions needs --repair")
    recording = read_together(files)
    if not recording.closed:
        names = ", ".join(map(str, files))
        echo(f"warning: {names} was not closed: its end may be missing; `seatrial recover` mends it", err=True)
    if recording.clock:
        echo(f"note: {recording.clock}", err=True)
    table = table_of(recording)
    quality = check_recording(recording, table, own or ())
    if output is not None:
        from seatrial.analysis.report.pages import write_quality
        from seatrial.analysis.tables.table import provenance_of

        for path in write_quality(quality, output, recording.trial.as_metadata(), provenance_of(table)):
            echo(path, err=True)
    if repair is not None:
        from seatrial.analysis.quality.repairs import write_repaired
        from seatrial.analysis.tables.table import count_bad

        repairs = write_repaired(
            recording, table, quality.findings, repair, quality.flags, rebuild_positions=rebuild_positions
        ).repairs
        for each in repairs:
            echo(f"repaired {each.channel}: {each.text}, {_values(each.changed)}", err=True)
        if not repairs:
            bad = count_bad(recording)
            without = f", without {_values(bad)} flagged bad in it" if bad else ""
            echo(f"nothing to repair: the recording is written as it is{without}", err=True)
        echo(repair, err=True)
    if as_json:
        echo(json.dumps(quality.as_json()))
        return
    from seatrial.acquisition.core.errors import Terminal

    Terminal().print(quality)


def _values(count: int) -> str:
    return "1 value" if count == 1 else f"{count:,} values"


@writes("output")
def export(
    files: Files,
    output: Output,
    rate: Annotated[float | None, typer.Option(help="Resample to this rate in Hz; default: raw samples.")] = None,
    smooth: Annotated[
        bool, typer.Option("--smooth", help="Write the smoothed motion, with uncertainties; default rate: 1 Hz.")
    ] = False,
    repair: Annotated[bool, typer.Option("--repair", help="First repair faults that are beyond doubt.")] = False,
    remove_delays: Annotated[
        bool, typer.Option("--remove-delays", help="Estimate the channels' delays and remove them.")
    ] = False,
    flags: Annotated[
        bool, typer.Option("--flags", help="Add a column of QARTOD flags for each channel; always in NetCDF.")
    ] = False,
    events: Annotated[
        bool,
        typer.Option("--events", help="Write marks, alarms and events of sources instead, .csv, .parquet, .xlsx."),
    ] = False,
    attribute: Annotated[
        list[str] | None,
        typer.Option(help="NAME=VALUE: a global attribute of the NetCDF, like license=CC-BY-4.0; may be repeated."),
    ] = None,
) -> None:
    """Write a recording as a table, Parquet, CSV, Excel, .mat or NetCDF (CF-1.11), or its track as KML or GPX."""
    from dataclasses import asdict

    from seatrial.acquisition.recording.grouping import read_together
    from seatrial.analysis.quality.repairs import Preparation, prepare
    from seatrial.analysis.tables.export import KINDS, export_table
    from seatrial.analysis.tables.table import history_of

    if events:
        if rate or smooth or repair or remove_delays or flags or attribute:
            raise typer.BadParameter("--events writes the log as it is: leave the other options out")
        _export_events(files, output)
        return
    netcdf = expect_suffix(output, *KINDS) == ".nc"
    attributes = _named_values(attribute or [])
    if attributes and not netcdf:
        raise typer.BadParameter("--attribute is for NetCDF: name the output .nc")
    how = Preparation(rate, repair, remove_delays, smooth, flags or netcdf)
    table = prepare(read_together(files), how)
    written, *beside = export_table(table, output, asdict(how), attributes)
    for step in history_of(table):
        if step["step"] in ("repair", "remove_delays"):
            echo(step["options"].get("text") or f"delays removed: {step['options']['delays_s']} s", err=True)
    echo(f"{len(table):,} rows of {len(table.columns)} columns", err=True)
    for path in beside:
        echo(f"units, trial and provenance: {path}", err=True)
    if netcdf:
        from seatrial.analysis.tables.export import remarks

        for remark in remarks(table, attributes):
            echo(remark, err=True)
    echo(written)


def _export_events(files: list[Path], output: Path) -> None:
    """Write the event log of a recording as a table."""
    from seatrial.acquisition.recording.grouping import read_together
    from seatrial.analysis.tables.export import event_table, export_events

    table = event_table(read_together(files))
    written = export_events(table, output)
    echo(f"{len(table):,} events", err=True)
    echo(written[0])


def _named_values(given: list[str]) -> dict[str, str]:
    """Options like NAME=VALUE by name."""
    pairs = [each.partition("=") for each in given]
    wrong = [name for name, _, value in pairs if not (name.isidentifier() and value)]
    if wrong:
        raise typer.BadParameter(f"{wrong[0]!r} is no NAME=VALUE, like license=CC-BY-4.0")
    return {name: value for name, _, value in pairs}


@writes("output")
def windows(
    files: Annotated[list[Path], typer.Argument(help="Recordings.")],
    output: Output,
    horizon: Horizon = 15,
    stride: Stride = 5,
    keep_moving: Annotated[
        bool,
        typer.Option(
            "--any",
            "--keep-moving",
            help="All windows with data, not only held windows; the column `held` marks those.",
        ),
    ] = False,
    repair: Annotated[bool, typer.Option("--repair", help="First repair faults that are beyond doubt.")] = False,
    remove_delays: Annotated[
        bool, typer.Option("--remove-delays", help="Estimate the channels' delays and remove them first.")
    ] = False,
    rebuild_positions: RebuildPositions = False,
    starts: Annotated[
        bool, typer.Option("--starts/--no-starts", help="Also write smoothed start states, to NAME.starts.parquet.")
    ] = True,
    as_json: AsJson = False,
) -> None:
    """Extract held windows: periods with steady controls."""
    from seatrial.acquisition.core.errors import bar
    from seatrial.analysis.windows.held import WindowOptions, windows_of_recordings, write_windows

    expect_suffix(output, ".parquet")
    repair = repair or rebuild_positions  # speeds are scaled before positions lean on them
    how = WindowOptions(horizon, stride, keep_moving, repair, remove_delays, starts, rebuild_positions)
    with bar("windows") as progress:
        found = windows_of_recordings(files, how, progress)
    write_windows(found, output)
    summary = {
        "recordings": len(files),
        "candidates": found.candidates,
        "kept": found.kept,
        "dropped": found.dropped,
    }
    if keep_moving:
        summary["moving"] = found.moving
    if as_json:
        echo(json.dumps(summary))
        return
    reasons = ", ".join(f"{count} {reason}" for reason, count in found.dropped.items()) or "none"
    recordings = "1 recording" if len(files) == 1 else f"{len(files)} recordings"
    kept = "kept" if keep_moving else "held"
    legs = "1 leg" if found.legs == 1 else f"{found.legs} legs"
    echo(
        f"{found.kept} of {found.candidates} windows of {horizon} s {kept}, in {legs} of {recordings}; "
        f"dropped: {reasons}",
        err=True,
    )
    echo(output)


@writes(folder="output")
def manoeuvres(
    files: Annotated[list[Path], typer.Argument(help="Recordings.")],
    output: Annotated[Path | None, typer.Option("-o", "--output", help="A folder for JSON and pictures.")] = None,
    length: Annotated[
        float | None,
        typer.Option(
            min=0.1,
            help="The ship's length between perpendiculars in metres, for IMO limits and lengths; default: that of "
            "the vessel file of the ship that the recording names.",
        ),
    ] = None,
    conditions: Annotated[
        Path | None,
        typer.Option(
            help="A TOML file with the conditions of the trial, to show the criteria of the standards; default: "
            "conditions.toml beside the recording."
        ),
    ] = None,
    every: Annotated[bool, typer.Option("--all", help="Show every index, including each overshoot.")] = False,
    own: Annotated[
        list[str] | None,
        typer.Option("--manoeuvre", help="FILE.py:FUNCTION: finds a manoeuvre of your own; may be repeated."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Find manoeuvres and compute their indices."""
    from seatrial.acquisition.config.run_sheet import statement_from_text, statement_text
    from seatrial.acquisition.core.errors import Terminal, bar
    from seatrial.acquisition.recording.grouping import whole_recordings
    from seatrial.analysis.report.tables import (
        manoeuvres_of,
        summary,
        terminal_tables,
        trial_criteria_lines,
        with_trial_currents,
        write_report,
    )

    with bar("manoeuvres") as progress:
        found, recordings = [], whole_recordings(files)
        for number, parts in enumerate(recordings, start=1):
            statement = statement_from_text(statement_text(conditions, parts[0]))
            found.append(manoeuvres_of(parts, length, own or (), statement))
            progress(number / len(recordings))
        found = with_trial_currents(found)
    if as_json:
        echo(json.dumps(summary(found, length)))
    elif output is None:
        for each in found:
            Terminal().print(terminal_tables(each, every=every))
        for line in trial_criteria_lines(found):
            echo(line)
    if output is not None:
        for path in write_report(found, output, length):
            echo(path, err=as_json)


@writes("output")
def smooth(
    files: Files,
    output: Output,
    rate: Annotated[float, typer.Option(help="Rows per second (Hz).")] = 1.0,
    as_json: AsJson = False,
) -> None:
    """Smooth the motion with a Kalman smoother, with uncertainties."""
    from seatrial.analysis.estimation.smoother import smooth as smooth_table
    from seatrial.analysis.estimation.smoother import summary_of, write_smoothed
    from seatrial.analysis.tables.table import read_table

    expect_suffix(output, ".parquet")
    smoothed = smooth_table(read_table(files), rate)
    write_smoothed(smoothed, output)
    for remark in smoothed.remarks:
        echo(remark, err=True)
    summary = summary_of(smoothed)
    if as_json:
        echo(json.dumps(summary))
        return
    noise = smoothed.noise
    echo(
        f"{summary['rows']:,} rows, {summary['missing']:,} of them in gaps; noise {noise.position_m:.3g} m, "
        f"{noise.heading_rad * 57.29578:.3g} deg, {noise.speed_mps:.3g} m/s, "
        f"{noise.yaw_rate_radps * 57.29578:.3g} deg/s; {sum(summary['rejected'].values()):,} samples refused",
        err=True,
    )
    echo(output)


@writes(folder="output")
def batch(
    folder: Annotated[Path, typer.Argument(help="A folder with recordings, also in subfolders.")],
    output: Output,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Number of worker processes; default: one per core.")
    ] = None,
    scheduler: Annotated[str | None, typer.Option(help="A running dask scheduler, like tcp://host:8786.")] = None,
    horizon: Horizon = 15,
    stride: Stride = 5,
    length: Annotated[
        float | None,
        typer.Option(
            min=0.1, help="The ship's length between perpendiculars in metres, for distances in ship lengths."
        ),
    ] = None,
    conditions: Annotated[
        Path | None,
        typer.Option(
            help="A TOML file that states what the recordings do not: conditions, particulars, instruments, "
            "run sheet; default: conditions.toml in the folder."
        ),
    ] = None,
    no_repair: Annotated[bool, typer.Option("--no-repair", help="Do not repair anything.")] = False,
    rebuild_positions: RebuildPositions = False,
    no_smooth: Annotated[
        bool, typer.Option("--no-smooth", help="Skip the smoother, and with it the uncertainties.")
    ] = False,
    no_pictures: Annotated[bool, typer.Option("--no-pictures", help="Pages without pictures, faster.")] = False,
    again: Annotated[bool, typer.Option("--again", help="Recompute existing results.")] = False,
    timeout: Annotated[
        float | None, typer.Option(min=0.1, help="Give up on a recording after this many seconds.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Analyse every recording in a folder; resumes."""
    if workers is not None and scheduler is not None:
        raise typer.BadParameter("give --workers or --scheduler, not both")
    from seatrial.acquisition.config.run_sheet import statement_text
    from seatrial.acquisition.core.errors import bar
    from seatrial.acquisition.core.process import Termination
    from seatrial.analysis.batch import run_batch
    from seatrial.analysis.products import Options

    if rebuild_positions and no_repair:
        raise typer.BadParameter("--rebuild-positions needs the repairs")
    options = Options(not no_repair, not no_smooth, not no_pictures, horizon, stride, length, rebuild_positions,
                      statement_text(conditions, folder))  # fmt: skip
    try:
        with bar("batch") as progress:
            summary = run_batch(
                folder, output, workers, scheduler, options, progress, again=again, timeout_s=timeout
            )
    except KeyboardInterrupt as stop:
        terminated = isinstance(stop, Termination)
        how = "terminated" if terminated else "interrupted"
        echo(f"seatrial: {how}; what is done stays, the same command goes on from there", err=True)
        raise typer.Exit(143 if terminated else 130) from None  # 128 and the signal, as shells have it
    for cause, names in summary.failures:
        echo(f"{len(names)} failed: {cause}\n    {', '.join(names)}", err=True)
    if cut_off := [row["name"] for row in summary.rows if row["status"] == "done" and row.get("closed") is False]:
        echo(f"{len(cut_off)} done, but cut off before the end: {', '.join(cut_off)}", err=True)
    if summary.gone:
        echo(f"{len(summary.gone)} of recordings that are gone: {', '.join(summary.gone)}", err=True)
    if as_json:
        echo(json.dumps(summary.as_json()))
    else:
        echo(f"{summary.done} done, {summary.reused} of them before, {summary.failed} failed", err=True)
        echo(summary.index)
    if summary.failed:
        raise typer.Exit(1)


def serve(
    folder: Annotated[Path, typer.Argument(help="A folder with recordings, also in subfolders.")],
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", help="The folder for results, for example that of `batch`; default: in the cache."
        ),
    ] = None,
    port: Annotated[
        int, typer.Option(min=1, max=65535, help="The port to listen on, on this computer only.")
    ] = 8766,  # 8765 is the live view's, which viewers expect there
    on_demand: Annotated[
        bool,
        typer.Option("--on-demand", help="Analyse only what is opened; default: everything, one after the other."),
    ] = False,
    upload: Annotated[bool, typer.Option("--upload", help="Allow uploads into FOLDER.")] = False,
    upload_mb: Annotated[float, typer.Option(min=0.1, help="The largest upload in MB.")] = 500.0,
) -> None:
    """Show a season of recordings as pages for a browser on this computer."""
    from seatrial.acquisition.core.errors import ConfigurationError

    try:
        import flask  # noqa: F401 - asked for before anything is begun
    except ImportError as error:
        raise ConfigurationError("serve needs the package flask", fix="pip install 'seatrial[serve]'") from error
    from seatrial.acquisition.config.run_sheet import statement_text
    from seatrial.acquisition.core.process import interrupt_on_terminate
    from seatrial.analysis.products import Options
    from seatrial.analysis.serve import Season, make_app, results_folder
    from seatrial.analysis.serve import serve as run

    options = Options(statement=statement_text(None, folder))
    season = Season(folder, output or results_folder(folder), options, eager=not on_demand)
    with interrupt_on_terminate(), suppress(KeyboardInterrupt), season:
        echo(f"results: {season.out}", err=True)
        run(make_app(season, upload_mb if upload else None), port, echo)
