"""Functions of ``import seatrial as st`` that need no model, and are commands, too: from check to serve."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Union

import typer

from seatrial.acquisition import commands
from seatrial.acquisition.commands import Data, Output, Parsed, Recording
from seatrial.acquisition.core import errors, process, stores
from seatrial.acquisition.core.files import require_suffix

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure
    from xarray import Dataset

    from seatrial.acquisition.config.run_sheet import Conditions
    from seatrial.analysis.batch import BatchSummary
    from seatrial.analysis.estimation.smoother import SmoothedMotion
    from seatrial.analysis.quality.check import DataQuality
    from seatrial.analysis.report.tables import ManoeuvreTable
    from seatrial.analysis.windows.held import HeldWindows

HORIZON_S = 15
"""How far is predicted unless stated otherwise [s]."""

Recordings = Annotated[Data, Parsed(list[Path]), typer.Argument(metavar="FILES", help="Recordings.")]
CommandOutput = Annotated[
    str | Path | None,
    Parsed(Path, required=True),
    typer.Option("-o", "--output", help="The file or folder to write."),
]
"""What a command has to name and a script may leave out."""
OutputFolder = Annotated[
    str | Path | None, Parsed(Path), typer.Option("-o", "--output", help="A folder for the results.")
]
Horizon = Annotated[int, typer.Option("--horizon", min=2, help="The length of a window (the horizon) in seconds.")]
Stride = Annotated[int, typer.Option("--stride", min=1, help="Seconds between the starts of windows.")]
AllWindows = Annotated[
    bool,
    typer.Option(
        "--all-windows", "--any", help="All windows with data, with the recorded controls; not only held windows."
    ),
]
Repair = Annotated[bool, typer.Option("--repair", help="First repair faults that are beyond doubt.")]
RemoveDelays = Annotated[
    bool, typer.Option("--remove-delays", help="Estimate the channels' delays and remove them first.")
]
RebuildPositions = Annotated[
    bool,
    typer.Option(
        "--rebuild-positions",
        help="Also replace positions with jittering time stamps by dead reckoning from speeds and heading, "
        "and such headings by the integrated yaw rate.",
    ),
]
TimeRange = Annotated[
    tuple[float, float] | str,
    Parsed(str),
    typer.Option("--time-range", "--part", help="A part of each recording's time in percent, e.g. 0..70."),
]
ALL_OF_IT = "0..100"
Length = Annotated[
    float | None,
    typer.Option(
        "--length",
        min=0.1,
        help="The ship's length between perpendiculars in metres, for IMO limits and lengths; default: that of "
        "the vessel file of the ship that the recording names.",
    ),
]
TrialConditions = Annotated[
    Union["Conditions", str, Path, None],
    Parsed(Path),
    typer.Option(
        "--conditions",
        help="A TOML file with the conditions of the trial, to show the criteria of the standards; default: "
        "conditions.toml beside the recording.",
    ),
]
Workers = Annotated[int | None, typer.Option(min=1, help="Number of worker processes; default: one per core.")]
Scheduler = Annotated[str | None, typer.Option(help="A running dask scheduler, like tcp://host:8786.")]


@commands.command(commands.RECORDINGS, "repair", folder="output", show=commands.print_result, in_store=True)
def check(
    recording: Recording,
    output: Annotated[
        str | Path | None,
        Parsed(Path),
        typer.Option("-o", "--output", help="A folder for quality.json, flags.parquet, quality.html."),
    ] = None,
    repair: Annotated[
        str | Path | None,
        Parsed(Path),
        typer.Option("--repair", help="Also write a repaired recording: only faults beyond doubt are repaired."),
    ] = None,
    *,
    rebuild_positions: RebuildPositions = False,
    checks: Annotated[
        Sequence[str],
        Parsed(list[str]),
        typer.Option("--check", help="FILE.py:FUNCTION: a check of your own; may be repeated."),
    ] = (),
) -> DataQuality:
    """Check the data quality of a recording, channel by channel.

    Parameters
    ----------
    recording
        A recording, the files of one in parts, or a table of raw samples.
    output
        A folder for ``quality.json``, ``flags.parquet`` and ``quality.html``.
    repair
        A repaired recording to write: only faults beyond doubt are repaired.
    rebuild_positions
        With ``repair``: replace positions with jittering time stamps by dead reckoning, and such headings by the
        integrated yaw rate.
    checks
        Checks of your own, ``FILE.py:FUNCTION``.

    Returns
    -------
    DataQuality
        ``channels`` with counts, gaps and grades, the ``findings``, and a flag for each sample.

    Raises
    ------
    InputError
        For what is no recording.

    Examples
    --------
    >>> import numpy as np, pandas as pd, seatrial as st
    >>> index = pd.date_range("2026-05-17", periods=600, freq="1s", tz="UTC", name="time", unit="ns")
    >>> heading = pd.DataFrame({"heading_deg": np.linspace(0.0, 90.0, 600)}, index=index)
    >>> st.check(heading).findings
    ()
    """
    from seatrial.acquisition.recording.reader import read_as_one_recording
    from seatrial.analysis.quality.check import check_recording, check_table
    from seatrial.analysis.tables.table import table_of

    if repair is not None:
        require_suffix(repair, ".mcap")
    elif rebuild_positions:
        raise errors.UsageError("--rebuild-positions needs --repair")
    if commands.is_table(recording) and output is None and repair is None:
        return check_table(recording, checks)
    files = commands.recording_paths(recording)
    read = read_as_one_recording(files)
    if not read.closed:
        names = ", ".join(map(str, files))
        process.announce(f"warning: {names} was not closed: its end may be missing; `seatrial recover` mends it")
    if read.clock:
        process.announce(f"note: {read.clock}")
    table = table_of(read)
    with errors.progress_bar("checking") as progress:
        quality = check_recording(read, table, checks, progress)
    if output is not None:
        from seatrial.analysis.report.pages import write_quality
        from seatrial.analysis.tables.table import provenance_of

        for path in write_quality(quality, Path(output), read.trial.as_metadata(), provenance_of(table)):
            process.announce(stores.place_name(path))
    if repair is not None:
        from seatrial.analysis.quality.repairs import write_repaired
        from seatrial.analysis.tables.table import count_invalid_values

        repairs = write_repaired(
            read, table, quality.findings, Path(repair), quality.flags, rebuild_positions=rebuild_positions
        ).repairs
        for step in repairs:
            process.announce(f"repaired {step.channel}: {step.text}, {_value_count_text(step.changed)}")
        if not repairs:
            bad = count_invalid_values(read)
            without = f", without {_value_count_text(bad)} flagged bad in it" if bad else ""
            process.announce(f"nothing to repair: the recording is written as it is{without}")
        process.announce(stores.place_name(repair))
    return quality


def _value_count_text(count: int) -> str:
    return "1 value" if count == 1 else f"{count:,} values"


def prepare(
    recording: Data,
    rate_hz: float | None = 1.0,
    *,
    repair: bool = True,
    remove_delays: bool = False,
    smooth: bool = False,
    flags: bool = False,
) -> pd.DataFrame:
    """The table of a recording at one rate, by default with the certain repairs.

    Parameters
    ----------
    recording
        A recording, the files of one in parts, or a table of its samples.
    rate_hz
        Rows per second [Hz]; None for the raw samples.
    repair
        Repair faults that are beyond doubt.
    remove_delays
        Estimate the channels' delays and remove them.
    smooth
        Take the motion from the Kalman smoother, with standard deviations.
    flags
        Add a quality flag (QARTOD) beside every value.

    Returns
    -------
    pandas.DataFrame
        UTC index ``time``, one column a channel with its unit in the name; the trial, the sources and what was done
        stand in ``attrs``.

    Raises
    ------
    DataShortageError
        For a recording without samples.
    InputError
        Where smoothing lacks position or heading.

    See Also
    --------
    read
        The raw samples, as they were recorded.
    resample
        A table at another rate, without repairs.
    smooth
        The smoothed motion with its covariance.

    Examples
    --------
    >>> import seatrial as st
    >>> table = st.prepare("trial.mcap", rate_hz=2.0)
    >>> table.index.name, table.index[1] - table.index[0]
    ('time', Timedelta('0 days 00:00:00.500000'))
    >>> table.attrs["trial"]["vessel"]
    'gunnerus_short'
    """
    from seatrial.acquisition.recording.reader import read_as_one_recording
    from seatrial.analysis.quality import repairs

    how = repairs.Preparation(rate_hz, repair, remove_delays, smooth, flags)
    return repairs.prepare_table(read_as_one_recording(commands.recording_paths(recording)), how)


@commands.command(commands.RECORDINGS, "output")
def export(
    recording: Recording,
    output: Output,
    rate_hz: Annotated[
        float | None, typer.Option("--rate", help="Resample to this rate in Hz; default: raw samples.")
    ] = None,
    *,
    smooth: Annotated[
        bool, typer.Option("--smooth", help="Write the smoothed motion, with uncertainties; default rate: 1 Hz.")
    ] = False,
    repair: Repair = False,
    remove_delays: RemoveDelays = False,
    flags: Annotated[
        bool, typer.Option("--flags", help="Add a column of QARTOD flags for each channel; always in NetCDF.")
    ] = False,
    events: Annotated[
        bool,
        typer.Option("--events", help="Write marks, alarms and events of sources instead, .csv, .parquet, .xlsx."),
    ] = False,
    attribute: Annotated[
        Mapping[str, str] | Sequence[str],
        Parsed(list[str]),
        typer.Option(help="NAME=VALUE: a global attribute of the NetCDF, like license=CC-BY-4.0; may be repeated."),
    ] = (),
) -> list[Path]:
    """Write a recording as a table (Parquet, CSV, Excel, .mat, NetCDF by CF-1.11), a bag of ROS 2 or an MDF
    measurement, or its track as KML or GPX.

    Parameters
    ----------
    recording
        A recording, the files of one in parts, or a table, which is written as it is.
    output
        The file: .parquet, .csv, .xlsx, .mat, .nc, .db3 (ROS 2), .mf4, .kml or .gpx.
    rate_hz
        Resample to this rate [Hz]; by default the raw samples.
    smooth
        Write the smoothed motion, with standard deviations; at 1 Hz unless ``rate_hz`` is given.
    repair
        First repair faults that are beyond doubt.
    remove_delays
        Estimate the channels' delays and remove them first.
    flags
        Add a column of QARTOD flags for each channel; always in NetCDF.
    events
        Write the event log instead.
    attribute
        Global attributes of the NetCDF.

    Returns
    -------
    list of Path
        The files that were written.

    Raises
    ------
    InputError
        For another suffix.
    StorageError
        Where it cannot be written.

    See Also
    --------
    prepare
        The same table in memory.
    import_table
        The way back, to a recording.

    Examples
    --------
    >>> import seatrial as st
    >>> [path.name for path in st.export("trial.mcap", "trial.csv", rate_hz=1.0)]
    ['trial.csv', 'trial.csv.json']
    """
    from dataclasses import asdict

    from seatrial.acquisition.recording.reader import read_as_one_recording
    from seatrial.analysis.quality import repairs
    from seatrial.analysis.tables.export import KINDS, event_table, export_events, export_table, remarks_on_metadata
    from seatrial.analysis.tables.table import history_of

    target, options = Path(output), (rate_hz, smooth, repair, remove_delays, flags)
    if events:
        if any(options) or attribute:
            raise errors.UsageError("--events writes the log as it is: leave the other options out")
        log = event_table(read_as_one_recording(commands.recording_paths(recording)))
        written = export_events(log, target)
        process.announce(f"{len(log):,} events")
        process.announce(stores.place_name(written[0]), err=False)
        return written
    netcdf = require_suffix(target, *KINDS) == ".nc"
    if isinstance(attribute, Mapping):
        attributes = dict(attribute)
    else:
        pairs = [pair.partition("=") for pair in attribute]
        if wrong := [name for name, _, value in pairs if not (name.isidentifier() and value)]:
            raise errors.UsageError(f"{wrong[0]!r} is no NAME=VALUE, like license=CC-BY-4.0")
        attributes = {name: value for name, _, value in pairs}
    if attributes and not netcdf:
        raise errors.UsageError("--attribute is for NetCDF: name the output .nc")
    how = repairs.Preparation(rate_hz, repair, remove_delays, smooth, flags or netcdf)
    if commands.is_table(recording) and not any(options):
        table, done = recording, dict[str, Any]()
    else:
        table, done = (
            repairs.prepare_table(read_as_one_recording(commands.recording_paths(recording)), how),
            asdict(how),
        )
    written = export_table(table, target, done, attributes)
    for step in history_of(table):
        if step["step"] in ("repair", "remove_delays"):
            process.announce(step["options"].get("text") or f"delays removed: {step['options']['delays_s']} s")
    process.announce(f"{len(table):,} rows of {len(table.columns)} columns")
    for path in written[1:]:
        process.announce(f"units, trial and provenance: {stores.place_name(path)}")
    for remark in remarks_on_metadata(table, attributes) if netcdf else ():
        process.announce(remark)
    process.announce(stores.place_name(written[0]), err=False)
    return written


def events(recording: Data) -> pd.DataFrame:
    """The event log of a recording: marks, alarms, what happened to its sources and to the recorder.

    Parameters
    ----------
    recording
        The file, or the files of one recording in parts.

    Returns
    -------
    pandas.DataFrame
        A row an event, in the order of time: ``kind`` (mark, alarm, source, recorder), ``level`` (info, warning,
        error), ``source`` (which one, if any) and ``text``, with a UTC index named ``time``.

    Raises
    ------
    InputError
        For a file that is missing or no recording.

    Examples
    --------
    >>> import seatrial as st
    >>> st.events("trial.mcap").columns.tolist()
    ['kind', 'level', 'source', 'text']
    """
    from seatrial.acquisition.recording.reader import read_as_one_recording
    from seatrial.analysis.tables.export import event_table

    return event_table(read_as_one_recording(commands.recording_paths(recording)))


def open_dataset(recording: Data, *, flags: bool = True) -> Dataset:
    """A recording as an xarray dataset with the attributes of the CF conventions, as in its NetCDF file.

    Parameters
    ----------
    recording
        A recording, its parts, or a table such as :func:`seatrial.prepare` returns.
    flags
        With the quality flag of each channel of a recording, ``surge_mps_flag``.

    Returns
    -------
    xarray.Dataset
        A variable a channel along ``time`` (UTC), with ``units``, ``standard_name`` and ``long_name``; latitude and
        longitude as coordinates where positions have them; ship, trial and provenance in ``attrs``.

    Raises
    ------
    ConfigurationError
        Without the package xarray.
    InputError
        For what is no recording.

    See Also
    --------
    export
        The same as a file, ``.nc``.
    read
        The samples as a table.

    Examples
    --------
    >>> import seatrial as st
    >>> dataset = st.open_dataset("trial.mcap")
    >>> dataset["surge_mps"].attrs["units"], dataset.attrs["featureType"]
    ('m s-1', 'trajectory')
    """
    from seatrial.acquisition.recording.reader import read_as_one_recording
    from seatrial.analysis.quality import repairs
    from seatrial.analysis.tables.export import cf_dataset

    if commands.is_table(recording):
        return cf_dataset(recording)
    opened = read_as_one_recording(commands.recording_paths(recording))
    return cf_dataset(repairs.prepare_table(opened, repairs.Preparation(flags=flags)))


def _print_windows(windows: HeldWindows, as_json: bool, options: Mapping[str, Any]) -> None:
    files, all_windows = len(options["recordings"]), options["all_windows"]
    summary = {
        "recordings": files,
        "candidates": windows.candidates,
        "kept": windows.kept,
        "dropped": windows.dropped,
    }
    if all_windows:
        summary["moving"] = windows.moving_count
    if as_json:
        process.print_line(json.dumps(summary))
        return
    reasons = ", ".join(f"{count} {reason}" for reason, count in windows.dropped.items()) or "none"
    recordings = "1 recording" if files == 1 else f"{files} recordings"
    legs = "1 leg" if windows.leg_count == 1 else f"{windows.leg_count} legs"
    process.print_line(
        f"{windows.kept} of {windows.candidates} windows of {options['horizon_s']} s "
        f"{'kept' if all_windows else 'held'}, in {legs} of {recordings}; dropped: {reasons}",
        err=True,
    )
    process.print_line(stores.place_name(options["output"]))


@commands.command(commands.RECORDINGS, "output", show=_print_windows)
def windows(
    recordings: Recordings,
    output: CommandOutput = None,
    horizon_s: Horizon = HORIZON_S,
    stride_s: Stride = 5,
    *,
    all_windows: Annotated[
        bool,
        typer.Option(
            "--all-windows",
            "--any",
            "--keep-moving",
            help="All windows with data, not only held windows; the column `held` marks those.",
        ),
    ] = False,
    repair: Repair = False,
    remove_delays: RemoveDelays = False,
    rebuild_positions: RebuildPositions = False,
    starts: Annotated[
        bool, typer.Option("--starts/--no-starts", help="Also write smoothed start states, to NAME.starts.parquet.")
    ] = True,
) -> HeldWindows:
    """Extract held windows: periods with steady controls.

    Parameters
    ----------
    recordings
        A recording, several, or a table of one with a row a second.
    output
        A Parquet file to write.
    horizon_s
        The length of a window [s].
    stride_s
        Seconds between the starts of windows.
    all_windows
        Also windows in which a control moved; the column ``held`` marks the others.
    repair
        First repair faults that are beyond doubt.
    remove_delays
        Estimate the channels' delays and remove them first.
    rebuild_positions
        Repair, and replace positions with jittering time stamps by dead reckoning.
    starts
        Smoothed start states too; they are computed for an ``output`` only.

    Returns
    -------
    HeldWindows
        ``rows`` with one row a second of each window, the count of ``candidates``, and why others were dropped.

    Raises
    ------
    InputError
        For a table that lacks channels or is not on whole seconds.

    Examples
    --------
    >>> import seatrial as st
    >>> held = st.windows("trial.mcap", horizon_s=15)
    >>> held.kept + sum(held.dropped.values()) == held.candidates
    True
    >>> held.to_frame().groupby("window").size().unique().tolist()
    [16]
    """
    from seatrial.analysis.windows.held import WindowOptions, held_windows, windows_of_recordings, write_windows

    if output is not None:
        require_suffix(output, ".parquet")
    repair = repair or rebuild_positions  # speeds are scaled before positions lean on them
    if commands.is_table(recordings) and output is None and not (repair or remove_delays):
        return held_windows(recordings, horizon_s, stride_s, keep_moving=all_windows)
    how = WindowOptions(
        horizon_s, stride_s, all_windows, repair, remove_delays, starts and output is not None, rebuild_positions
    )
    with errors.progress_bar("windows") as progress:
        held = windows_of_recordings(commands.recording_paths(recordings), how, progress)
    if output is not None:
        write_windows(held, Path(output))
    return held


def _print_manoeuvres(table: ManoeuvreTable, as_json: bool, options: Mapping[str, Any]) -> None:
    from seatrial.analysis.report.tables import summarise_manoeuvres, terminal_tables, trial_criteria_lines

    if as_json:
        process.print_line(json.dumps(summarise_manoeuvres(table.recorded, options["length_m"])))
    for path in table.pages:
        process.print_line(path, err=as_json)
    if as_json or table.pages:
        return
    for recording in table.recorded:
        errors.Terminal().print(terminal_tables(recording, all_indices=options["all_indices"]))
    for line in trial_criteria_lines(table.recorded):
        process.print_line(line)


@commands.command(commands.RECORDINGS, folder="output", show=_print_manoeuvres)
def manoeuvres(
    recordings: Recordings,
    length_m: Length = None,
    *,
    output: Annotated[
        str | Path | None,
        Parsed(Path),
        typer.Option("-o", "--output", help="A folder for JSON and pictures."),
    ] = None,
    conditions: TrialConditions = None,
    all_indices: Annotated[bool, typer.Option("--all", help="Show every index, including each overshoot.")] = False,
    finders: Annotated[
        Sequence[str],
        Parsed(list[str]),
        typer.Option("--manoeuvre", help="FILE.py:FUNCTION: finds a manoeuvre of your own; may be repeated."),
    ] = (),
) -> ManoeuvreTable:
    """Find manoeuvres and compute their indices.

    Parameters
    ----------
    recordings
        A recording, several of one trial, or a table.
    length_m
        The length between perpendiculars [m], for indices in ship lengths and the limits that depend on it; without
        it that of the vessel file of the ship that the recording names.
    output
        A folder for ``manoeuvres.json`` and ``manoeuvres.html`` with its pictures.
    conditions
        The conditions of the trial, or the TOML file that holds them; they complete those of the recording.
    all_indices
        The terminal shows every index; the returned table always has all.
    finders
        Finders of the user's own manoeuvres, ``FILE.py:FUNCTION``.

    Returns
    -------
    ManoeuvreTable
        A table, one row an index, with its 95 % interval, unit and IMO limit. ``counted_from`` is the moment from
        which an index counts; ``result`` is ``met``, ``not_met``, ``cannot_be_said`` or ``not_shown`` where there
        is a ``limit``, and ``missing`` lists what is missing to show the criterion.

    Raises
    ------
    InputError
        For a file that is missing or no recording.

    Examples
    --------
    >>> import seatrial as st
    >>> table = st.simulate("circle.mcap", manoeuvre="turning_circle_30", duration_s=400.0, rate_hz=1.0)
    >>> indices = st.manoeuvres("circle.mcap", length_m=28.9)
    >>> diameter = indices[indices["index"] == "tactical_diameter_m"].iloc[0]
    >>> bool(diameter["low"] < diameter["value"] < diameter["high"] < 5.0 * 28.9)
    True
    """
    from seatrial.acquisition.config.run_sheet import Statement, read_statement_text, statement_from_text
    from seatrial.acquisition.recording.reader import parts_by_recording
    from seatrial.analysis.report import tables

    recorded, parts_of_recordings = [], parts_by_recording(commands.recording_paths(recordings))
    with errors.progress_bar("manoeuvres") as progress:
        for number, parts in enumerate(parts_of_recordings, start=1):
            if conditions is None or isinstance(conditions, str | Path):
                file = None if conditions is None else Path(conditions)
                statement = statement_from_text(read_statement_text(file, parts[0]))
            else:
                statement = Statement(conditions=conditions)
            recorded.append(tables.manoeuvres_of_recording(parts, length_m, finders, statement))
            progress(number / len(parts_of_recordings))
        recorded = tables.share_trial_currents(recorded)
    pages = () if output is None else tables.write_report(recorded, Path(output), length_m)
    return tables.manoeuvre_table(recorded, pages)


def _print_smoothed(smoothed: SmoothedMotion, as_json: bool, options: Mapping[str, Any]) -> None:
    from seatrial.analysis.estimation.smoother import summarise_smoothing

    for remark in smoothed.remarks:
        process.print_line(remark, err=True)
    summary = summarise_smoothing(smoothed)
    if as_json:
        process.print_line(json.dumps(summary))
        return
    noise = smoothed.noise
    process.print_line(
        f"{summary['rows']:,} rows, {summary['missing']:,} of them in gaps; noise {noise.position_m:.3g} m, "
        f"{noise.heading_rad * 57.29578:.3g} deg, {noise.speed_mps:.3g} m/s, "
        f"{noise.yaw_rate_radps * 57.29578:.3g} deg/s; {sum(summary['rejected'].values()):,} samples refused",
        err=True,
    )
    process.print_line(options["output"])


@commands.command(commands.RECORDINGS, "output", show=_print_smoothed)
def smooth(
    recording: Recording,
    output: CommandOutput = None,
    rate_hz: Annotated[float, typer.Option("--rate", help="Rows per second (Hz).")] = 1.0,
) -> SmoothedMotion:
    """Smooth the motion with a Kalman smoother, with uncertainties.

    Parameters
    ----------
    recording
        A recording, the files of one in parts, or a table of raw samples.
    output
        A Parquet file to write.
    rate_hz
        Rows per second [Hz].

    Returns
    -------
    SmoothedMotion
        ``states`` [rows] with pose, velocity and acceleration, their ``covariance`` [rows, 9, 9] in SI, the noise
        of the sensors, and which samples were refused.

    Raises
    ------
    InputError
        Without position or heading.

    Examples
    --------
    >>> import seatrial as st
    >>> smoothed = st.smooth("trial.mcap", rate_hz=1.0)
    >>> smoothed.covariance.shape
    (300, 9, 9)
    >>> bool((smoothed.standard_deviations()["north_m"] > 0.0).all())
    True
    """
    from seatrial.analysis.estimation import smoother
    from seatrial.analysis.tables.table import read_table

    if output is not None:
        require_suffix(output, ".parquet")
    table = recording if commands.is_table(recording) else read_table(commands.recording_paths(recording))
    smoothed = smoother.smooth(table, rate_hz)
    if output is not None:
        smoother.write_smoothed(smoothed, output)
    return smoothed


def _print_batch(summary: BatchSummary, as_json: bool, options: Mapping[str, Any]) -> None:
    for cause, names in summary.failures:
        process.print_line(f"{len(names)} failed: {cause}\n    {', '.join(names)}", err=True)
    if cut_off := [row["name"] for row in summary.rows if row["status"] == "done" and row.get("closed") is False]:
        process.print_line(f"{len(cut_off)} done, but cut off before the end: {', '.join(cut_off)}", err=True)
    if summary.gone:
        process.print_line(f"{len(summary.gone)} of recordings that are gone: {', '.join(summary.gone)}", err=True)
    if summary.remainder is not None:
        process.print_line(f"{summary.remainder}; the same command without --sample does them", err=True)
    if as_json:
        process.print_line(json.dumps(summary.as_json()))
    else:
        process.print_line(
            f"{summary.done} done, {summary.reused} of them before, {summary.failed} failed", err=True
        )
        process.print_line(stores.place_name(summary.index))
    if summary.failed:
        raise typer.Exit(1)


@commands.command(commands.RECORDINGS, folder="output", show=_print_batch, in_store=True)
def batch(
    folder: Annotated[
        str | Path, Parsed(Path), typer.Argument(help="A folder with recordings, also in subfolders.")
    ],
    output: Output,
    workers: Workers = None,
    scheduler: Scheduler = None,
    *,
    horizon_s: Horizon = HORIZON_S,
    stride_s: Stride = 5,
    length_m: Annotated[
        float | None,
        typer.Option(
            "--length",
            min=0.1,
            help="The ship's length between perpendiculars in metres, for distances in ship lengths.",
        ),
    ] = None,
    conditions: Annotated[
        str | Path | None,
        Parsed(Path),
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
    timeout_s: Annotated[
        float | None, typer.Option("--timeout", min=0.1, help="Give up on a recording after this many seconds.")
    ] = None,
    sample: Annotated[
        int | None,
        typer.Option(min=1, help="Analyse so many recordings, spread over all, and state what the rest will take."),
    ] = None,
) -> BatchSummary:
    """Analyse every recording in a folder; resumes.

    Parameters
    ----------
    folder
        A folder with recordings, also in subfolders.
    output
        The folder for the results of each recording and the index of all.
    workers, scheduler
        How many processes on this computer, or the address of a running dask scheduler.
    horizon_s, stride_s
        Length of the windows and time between their starts [s].
    length_m
        The ship's length between perpendiculars [m], for distances in ship lengths.
    conditions
        A TOML file that states what the recordings do not; by default ``conditions.toml`` in the folder.
    no_repair, rebuild_positions
        Repair nothing; or replace jittering positions by dead reckoning, too.
    no_smooth, no_pictures
        Leave out the smoother or the pictures, which take most of the time.
    again
        Recompute results that exist.
    timeout_s
        Give up on a recording after this time [s].
    sample
        Analyse so many recordings only, spread over all: the result's ``remainder`` is what is left and how long
        it takes.

    Returns
    -------
    BatchSummary
        A row a recording, and how many were done, reused and failed.

    Raises
    ------
    InputError
        For a folder or an address that is none.
    DataShortageError
        For a folder without recordings.

    See Also
    --------
    serve
        The same as pages for a browser.
    campaign
        Simulate a folder of recordings.

    Examples
    --------
    >>> import seatrial as st
    >>> table = st.simulate("season/monday.mcap", duration_s=120.0, rate_hz=1.0)
    >>> summary = st.batch("season", "results", workers=1, no_smooth=True, no_pictures=True)
    >>> summary.done, summary.failed
    (1, 0)
    """
    from seatrial.acquisition.config.run_sheet import CONDITIONS_FILE, read_statement_text
    from seatrial.acquisition.core.stores import exists, is_remote, lasting_copies
    from seatrial.analysis.batch import run_batch
    from seatrial.analysis.products import Options

    if workers is not None and scheduler is not None:
        raise errors.UsageError("give --workers or --scheduler, not both")
    if rebuild_positions and no_repair:
        raise errors.UsageError("--rebuild-positions needs the repairs")
    source = Path(folder)
    statement = None if conditions is None else Path(conditions)
    if statement is None and is_remote(source) and exists(source / CONDITIONS_FILE):
        statement = source / CONDITIONS_FILE
    (statement,) = [None] if statement is None else lasting_copies([statement])
    options = Options(
        not no_repair, not no_smooth, not no_pictures, horizon_s, stride_s, length_m, rebuild_positions,
        read_statement_text(statement, source),
    )  # fmt: skip
    try:
        with errors.progress_bar("batch") as progress:
            return run_batch(
                source, output, workers, scheduler, options, progress, again=again, timeout_s=timeout_s,
                sample=sample,
            )  # fmt: skip
    except KeyboardInterrupt as stop:
        how = "terminated" if isinstance(stop, process.Termination) else "interrupted"
        process.announce(f"seatrial: {how}; what is done stays, the same command goes on from there")
        raise


@commands.command(commands.RECORDINGS)
def serve(
    folder: Annotated[
        str | Path, Parsed(Path), typer.Argument(help="A folder with recordings, also in subfolders.")
    ],
    output: Annotated[
        str | Path | None,
        Parsed(Path),
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
    """Show a season of recordings as pages for a browser on this computer.

    Parameters
    ----------
    folder
        A folder with recordings, also in subfolders.
    output
        The folder for results; by default in the cache.
    port
        The port to listen on, on this computer only.
    on_demand
        Analyse only what is opened.
    upload, upload_mb
        Allow uploads into the folder, and the largest [MB].

    Raises
    ------
    ConfigurationError
        Without the package flask.

    Examples
    --------
    It serves until Ctrl-C:

    >>> import seatrial as st
    >>> st.serve("season", output="results", port=8766)  # doctest: +SKIP
    """

    try:
        import flask  # noqa: F401 - asked for before anything is begun
    except ImportError as error:
        raise errors.ConfigurationError(
            "serve needs the package flask", fix="pip install 'seatrial[serve]'"
        ) from error
    from seatrial.acquisition.config.run_sheet import read_statement_text
    from seatrial.analysis import serve as server
    from seatrial.analysis.products import Options

    source = Path(folder)
    options = Options(statement=read_statement_text(None, source))
    results = server.results_folder(source) if output is None else Path(output)
    season = server.Season(source, results, options, eager=not on_demand)
    with process.interrupt_on_terminate(), suppress(KeyboardInterrupt), season:
        process.print_line(f"results: {season.out}", err=True)
        server.serve(server.make_app(season, upload_mb if upload else None), port, process.print_line)


def plot(table: pd.DataFrame) -> Figure:
    """The track and the channels of a table, side by side.

    Parameters
    ----------
    table
        A table with columns of the conventions.

    Returns
    -------
    matplotlib.figure.Figure
        Track and channels, a panel each.

    Raises
    ------
    DataShortageError
        For a table with nothing to draw.

    Examples
    --------
    >>> import seatrial as st
    >>> figure = st.plot(st.prepare("trial.mcap"))
    >>> figure.savefig("trial.png")
    """
    from seatrial.analysis.report import pages, plots

    parts = [part for part in (plots.track_figure(table), plots.channels_figure(table)) if part is not None]
    if not parts:
        raise errors.DataShortageError(
            "the table has no channel to plot", fix="give a table with columns of the conventions"
        )

    def fill(figure: Figure) -> None:
        panels = figure.subfigures(1, len(parts), squeeze=False)[0]
        for (draw, _, _), panel in zip(parts, panels, strict=True):
            draw(panel)

    return pages.fill_figure(fill, (8.0 * len(parts), 8.0))
