"""The functions of ``import seatrial as st``: one call a job, on files and tables, with names for what comes along.

They load what their arguments name (recordings, a vessel, a calibrator's folder), show progress on a terminal, and
return tables or result objects. The commands call them too, so that a script and the command line agree. A
*recording* is the path of an MCAP file, or those of its parts; where several may be given, one path or a sequence
of them, in which parts that follow each other are one recording. ``part`` is a share of each recording's time in
percent, as ``"0..70"``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from seatrial.acquisition.core.errors import bar, printable_name
from seatrial.acquisition.recording.grouping import read_recordings, read_together
from seatrial.acquisition.recording.reader import describe
from seatrial.analysis.tables.table import (
    percent_of,
    read_table,
    require,
    table_actuators,
    table_of,
    warn_of_calm,
    with_calm,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from seatrial.acquisition.core.ship import Channel
    from seatrial.analysis.quality.check import DataQuality
    from seatrial.analysis.speed_power import Conditions, SpeedPower
    from seatrial.analysis.windows.held import HeldWindows
    from seatrial.hybrid.calibrators import TrainedCalibrator
    from seatrial.hybrid.calibrators.predict import Prediction
    from seatrial.hybrid.effects.catalogue import Catalogue
    from seatrial.hybrid.evaluation.study import Evaluation
    from seatrial.hybrid.evaluation.validate import Validation
    from seatrial.hybrid.identification.identify import Identification
    from seatrial.hybrid.planning import Plan
    from seatrial.hybrid.prediction.dataset import Dataset
    from seatrial.hybrid.simulation.vessel_check import VesselCheck
    from seatrial.hybrid.vessel.files import ReferenceModel
    from seatrial.hybrid.vessel.parameters import Vessel
    from seatrial.hybrid.vessel.plant import Plant
    from seatrial.hybrid.workflows import DiagnosisRun

Paths = str | Path | Sequence[str | Path]
HORIZON_S = 15
"""How far is predicted where nobody says [s]."""


def write(
    table: pd.DataFrame, path: str | Path, vessel: str = "", declared: Sequence[Channel] = (), **trial: Any
) -> Path:
    """A table of channels as a recording; ``trial`` is what :class:`seatrial.acquisition.core.trial.Trial` holds.

    The table has a UTC index and the columns of the conventions; a ship's actuators are as their columns are named,
    unless ``trial`` lists them. Other columns have to be ``declared``
    (:func:`seatrial.acquisition.core.ship.declare`), unless the table was read from a recording that declares
    them. Raises :class:`InputError` for what is no channel, :class:`StorageError`.
    """
    from seatrial.acquisition.core.ship import as_text, declared_in, declared_text
    from seatrial.acquisition.core.trial import Trial
    from seatrial.acquisition.recording.writer import write_table
    from seatrial.acquisition.tables.import_table import actuators_in_columns

    target, channels = Path(path), {each.name: each for each in (*declared_in(table.attrs), *declared)}
    said = {
        "name": printable_name(target.stem),
        "vessel": vessel,
        "channels": declared_text(channels.values()),
        **trial,
    }
    hers = actuators_in_columns(map(str, table), Trial(channels=said["channels"]))
    write_table(table, target, Trial(**{"actuators": as_text(hers), **said}), source="table")
    return target


def info(recording: Paths) -> dict[str, Any]:
    """What is in a recording or its parts: channels with counts, rates, spans, sources; its events; whether it was
    closed."""
    from seatrial.acquisition.recording.grouping import events_of

    read = read_together(recording)
    return {**describe(read), "events": [event.as_json() for event in events_of(read)]}


def events(recording: Paths) -> pd.DataFrame:
    """The event log of a recording or its parts: marks, alarms, what happened to its sources and to the recorder.

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
    """
    from seatrial.analysis.tables.export import event_table

    return event_table(read_together(recording))


def check(data: Paths | pd.DataFrame, own: Sequence[str] = ()) -> DataQuality:
    """What is wrong with a recording or a table of raw samples: channel by channel, and against each other.

    ``own`` are checks of one's own, ``FILE.py:FUNCTION``.
    """
    from seatrial.analysis.quality.check import check_recording, check_table

    if isinstance(data, pd.DataFrame):
        return check_table(data, own)
    return check_recording(read_together(data), user_checks=own)


def prepare(
    recording: Paths,
    rate_hz: float | None = 1.0,
    *,
    repair: bool = True,
    remove_delays: bool = False,
    smooth: bool = False,
    flags: bool = False,
) -> pd.DataFrame:
    """The table of a recording at ``rate_hz`` (raw samples for ``None``), by default with the certain repairs.

    ``smooth`` takes the motion from the Kalman smoother, with standard deviations; ``flags`` adds a quality flag
    beside every value. What was done stands in ``table.attrs``.
    """
    from seatrial.analysis.quality.repairs import Preparation
    from seatrial.analysis.quality.repairs import prepare as prepare_recording

    return prepare_recording(read_together(recording), Preparation(rate_hz, repair, remove_delays, smooth, flags))


def windows(
    data: Paths | pd.DataFrame,
    horizon_s: int = HORIZON_S,
    stride_s: int = 5,
    *,
    any_commands: bool = False,
    repair: bool = False,
) -> HeldWindows:
    """The stretches of ``horizon_s`` in which the actuators were held: of recordings, or of a table at 1 Hz.

    With ``any_commands`` all stretches that have data, whatever the actuators do; ``held`` tells them apart.
    """
    from seatrial.analysis.windows.held import WindowOptions, held_windows, windows_of_recordings

    if isinstance(data, pd.DataFrame):
        return held_windows(data, horizon_s, stride_s, keep_moving=any_commands)
    with bar("reading") as progress:
        how = WindowOptions(horizon_s, stride_s, any_commands, repair=repair, starts=False)
        return windows_of_recordings(as_paths(data), how, progress)


def manoeuvres(
    recording: Paths,
    length_m: float | None = None,
    own: Sequence[str] = (),
    conditions: Conditions | str | Path | None = None,
) -> pd.DataFrame:
    """The manoeuvres of a recording: one row an index, with its 95 % interval, its unit and its IMO limit.

    Parameters
    ----------
    recording
        A recording, or its parts.
    length_m
        The length between perpendiculars [m], for indices in ship lengths and the limits that depend on it; without
        it that of the vessel file of the ship that the recording names.
    own
        Finders of the user's own manoeuvres, ``FILE.py:FUNCTION``.
    conditions
        The conditions of the trial, or the TOML file that holds them; they complete those of the recording.

    Returns
    -------
    pandas.DataFrame
        ``counted_from`` is the moment from which an index counts; ``result`` is ``met``, ``not_met``,
        ``cannot_be_said`` or ``not_shown`` where there is a ``limit``, and ``missing`` lists what is missing to
        show the criterion.
    """
    from seatrial.acquisition.config.run_sheet import Conditions, Statement, load_statement
    from seatrial.analysis.report.tables import manoeuvres_of

    known = Statement(conditions=conditions) if isinstance(conditions, Conditions) else None
    known = load_statement(conditions) if isinstance(conditions, str | Path) else known
    rows = [
        {"manoeuvre": each.name, "kind": each.kind, "side": each.side, "start": each.start, "index": name,
         "value": index.value, "low": index.low, "high": index.high, "unit": index.unit, "limit": index.limit,
         "counted_from": index.counted_from, "result": index.result, "missing": "; ".join(index.missing)}
        for each in manoeuvres_of(recording, length_m, own, known).manoeuvres
        for name, index in each.indices.items()
    ]  # fmt: skip
    columns = ["manoeuvre", "kind", "side", "start", "index", "value", "low", "high", "unit", "limit",
               "counted_from", "result", "missing"]  # fmt: skip
    return pd.DataFrame(rows, columns=columns)


def speed_power(
    recordings: Paths,
    conditions: Conditions | str | Path | None = None,
    vessel: str | Path | Vessel | None = None,
    wind_coefficients: str | Path | None = None,
) -> SpeedPower:
    """The speed of a ship at its power in still water, from the double runs of one trial (ISO 15016:2015).

    Parameters
    ----------
    recordings
        Recordings, or tables of run averages (.csv, .xlsx) with one row a run.
    conditions
        The conditions of the ship and the day, or the TOML file that holds them; without them ``conditions.toml``
        beside the files. They are completed by those of the recordings or tables and by the vessel file.
    vessel
        A vessel, or its file; without it that of the ship which the first recording names.
    wind_coefficients
        A table of the ship's wind resistance: columns ``angle`` [deg] off the bow and ``C_AA``.

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
    """
    from seatrial.acquisition.config.run_sheet import Conditions, statement_from_text, statement_text
    from seatrial.acquisition.core.errors import InputError
    from seatrial.analysis.speed_power.corrections import read_wind_resistance
    from seatrial.analysis.speed_power.runs import is_run_table

    paths = as_paths(recordings)
    if isinstance(conditions, Conditions):
        given = conditions
    else:
        file = None if conditions is None else Path(conditions)
        given = statement_from_text(statement_text(file, paths[0])).conditions
    if wind_coefficients is not None:
        given = replace(given, wind_resistance=read_wind_resistance(wind_coefficients))
    tables = [path for path in paths if is_run_table(path)]
    if tables and len(tables) < len(paths):
        raise InputError(
            "are tables of run averages and recordings", where=", ".join(path.name for path in paths),
            fix="give either; one trial is in one form",
        )  # fmt: skip
    return _power_of_tables(tables, given, vessel) if tables else _power_of_recordings(paths, given, vessel)


def _power_of_tables(paths: list[Path], given: Conditions, vessel: str | Path | Vessel | None) -> SpeedPower:
    from seatrial.analysis.speed_power import speed_power_of_runs
    from seatrial.analysis.speed_power.runs import read_run_table
    from seatrial.hybrid.vessel.files import load_vessel
    from seatrial.hybrid.vessel.windage import conditions_of

    tables = [read_run_table(path) for path in paths]
    for table in tables:
        given = given.with_known(table.conditions)
    if vessel is not None:
        given = given.with_known(conditions_of(load_vessel(vessel)))
    result = speed_power_of_runs([run for table in tables for run in table.runs], given)
    remarks = [f"columns of {path.name} that are not used: {', '.join(table.passed_over)}"
               for path, table in zip(paths, tables, strict=True) if table.passed_over]  # fmt: skip
    return replace(result, warnings=(*result.warnings, *remarks))


def _power_of_recordings(paths: list[Path], given: Conditions, vessel: str | Path | Vessel | None) -> SpeedPower:
    from seatrial.acquisition.config.declarations import vessel_of_ship
    from seatrial.analysis.speed_power import speed_power as analyse
    from seatrial.hybrid.vessel.files import load_vessel
    from seatrial.hybrid.vessel.windage import known_conditions

    read = list(read_recordings(paths))
    tables = [table_of(each) for each in read]
    ship = vessel or vessel_of_ship(read[0].trial.vessel, read[0].path.parent)
    recorded = [(each.trial, table) for each, table in zip(read, tables, strict=True)]
    known = known_conditions(recorded, load_vessel(ship) if ship else None, given)
    return analyse(tables, known, [event for each in read for event in each.events])


def simulate(
    path: str | Path,
    vessel: str | Path | Vessel | None = None,
    sea_state: str = "calm",
    manoeuvre: str = "voyage",
    duration_s: float = 1200.0,
    rate_hz: float = 10.0,
    seed: int = 0,
    hidden: Mapping[str, Mapping[str, float]] | None = None,
    *,
    catalogue: Catalogue | None = None,
) -> pd.DataFrame:
    """A simulated trial as its sensors would have recorded it: written as a recording to ``path``, and returned.

    ``hidden`` maps names of effects to their parameters; what was hidden goes to ``PATH.truth.json`` and into
    nothing else.
    """
    from seatrial.acquisition.core.files import expect_suffix
    from seatrial.hybrid.effects.catalogue import catalogue_with
    from seatrial.hybrid.simulation.trial import record_trial, simulate_trial
    from seatrial.hybrid.vessel.files import load_vessel

    expect_suffix(path, ".mcap")
    target, ship = Path(path), load_vessel(vessel)
    known = catalogue_with(vessel=ship) if catalogue is None else catalogue
    table, truth = simulate_trial(ship, sea_state, manoeuvre, duration_s, rate_hz, seed, hidden, catalogue=known)
    record_trial(table, truth, target, place="Trondheimsfjord, simulated")
    return table


def effects(*files: str | Path) -> pd.DataFrame:
    """The catalogue of effects that a model may lack, with those of ``files``: one row a parameter."""
    from seatrial.hybrid.effects.catalogue import catalogue_with

    rows = [
        {"effect": effect.name, "family": effect.family, "kind": effect.kind, "parameter": each.name,
         "unit": each.unit, "neutral": each.neutral, "low": each.low, "high": each.high, "what": effect.what}
        for effect in catalogue_with(files).values()
        for each in effect.parameters
    ]  # fmt: skip
    return pd.DataFrame(rows)


def train(
    recordings: Paths,
    vessel: str | Path | None = None,
    method: str = "adaptive",
    horizon_s: int = HORIZON_S,
    *,
    stride_s: int = 5,
    part: str = "0..100",
    any_commands: bool = False,
    repair: bool = False,
    rebuild_positions: bool = False,
    seed: int = 0,
) -> TrainedCalibrator:
    """A calibrator on the model of ``vessel``, trained on held windows of recordings; with ``any_commands`` on all
    windows, under the commands as they were recorded.

    Raises :class:`DataShortageError` where there is no window, :class:`ConfigurationError` for an unknown method.
    """
    from seatrial.hybrid.calibrators import refuse_untrainable
    from seatrial.hybrid.calibrators import train as train_calibrator
    from seatrial.hybrid.effects.catalogue import vessel_plant

    refuse_untrainable(method)
    model = _model(recordings, vessel)
    plant = vessel_plant(model.vessel)
    dataset = _dataset(
        recordings, horizon_s, stride_s, part, any_commands, repair, rebuild_positions, plant, shorter=True
    )
    with bar("training") as progress:
        trained = train_calibrator(dataset, model.file, plant, method, seed, progress)
    return replace(trained, model=model.said)


def validate(
    recordings: Paths,
    calibrator: TrainedCalibrator | str | Path | None = None,
    vessel: str | Path | None = None,
    horizon_s: int | None = None,
    *,
    stride_s: int = 5,
    part: str = "0..100",
    any_commands: bool = False,
    repair: bool = False,
    rebuild_positions: bool = False,
    allow_seen: bool = False,
) -> Validation:
    """Every baseline, and the calibrator if one is given, judged on the held windows of recordings; with
    ``any_commands`` on all windows, under the commands as they were recorded. With it the errors after 1, 2 and 5
    L/V, and the indices of the manoeuvres found beside those that the model has.

    Recordings that the calibrator was trained on are refused with :class:`InputError` unless ``allow_seen``.
    """
    from seatrial.hybrid.calibrators.predict import predictor_of
    from seatrial.hybrid.evaluation.manoeuvre_indices import index_comparison, runs_of_recordings
    from seatrial.hybrid.evaluation.validate import errors_by_length, refuse_training_data
    from seatrial.hybrid.evaluation.validate import validate as validate_dataset
    from seatrial.hybrid.vessel.files import trials_of

    by = predictor_of(trials_of(as_paths(recordings)), calibrator, vessel, horizon_s)
    dataset = _dataset(recordings, by.horizon_s, stride_s, part, any_commands, repair, rebuild_positions, by.plant)
    if by.trained is not None and not allow_seen:
        refuse_training_data(dataset.sources, by.trained)
    judged = _with_truths(dataset, recordings, part, rebuild_positions)
    found = validate_dataset(judged, by.plant, by.trained)
    runs = runs_of_recordings(
        as_paths(recordings), by.plant.length_between_perpendiculars_m, percent_of(part),
        repair=repair or rebuild_positions, rebuild_positions=rebuild_positions,
    )  # fmt: skip
    return replace(
        found, model=by.said, indices=index_comparison(runs, by),
        by_length=errors_by_length(dataset.tables, found.windows, by.plant, by.trained),
    )  # fmt: skip


def evaluate(
    recordings: Paths,
    vessel: str | Path | None = None,
    horizon_s: int = HORIZON_S,
    *,
    splits: Sequence[str] = (),
    methods: Sequence[str] = (),
    draws: int = 5,
    stride_s: int = 5,
    any_commands: bool = False,
    repair: bool = False,
    rebuild_positions: bool = False,
    seed: int = 0,
) -> Evaluation:
    """What each method is worth on recordings like these: fitted on one part of them and judged on the other.

    ``splits`` are ``leg``, ``time``, ``recording``, ``random`` (without any: leg and time, and recording where
    there are several); ``methods`` are kinds of calibrators, ``FILE.py:CLASS`` for one's own (without any: all but
    ``paper_adam`` that can be trained here). With ``any_commands`` on all windows that have data, under the
    commands as they were recorded; otherwise on held ones.
    """
    from seatrial.hybrid.calibrators import COMPARED, can_train, refuse_untrainable
    from seatrial.hybrid.effects.catalogue import vessel_plant
    from seatrial.hybrid.evaluation import study as split_kinds
    from seatrial.hybrid.evaluation.study import evaluation_of, study

    kinds = (
        list(dict.fromkeys(splits)) or ["leg", "time", "recording"][: 2 if len(as_paths(recordings)) == 1 else 3]
    )
    names = list(dict.fromkeys(methods or filter(can_train, COMPARED)))
    split_kinds.refuse_unknown(kinds)
    for each in names:
        refuse_untrainable(each)
    model = _model(recordings, vessel)
    plant = vessel_plant(model.vessel)
    dataset = _dataset(
        recordings, horizon_s, stride_s, "0..100", any_commands, repair, rebuild_positions, plant, shorter=True
    )
    dataset = _with_truths(dataset, recordings, "0..100", rebuild_positions)
    with bar("fitting") as progress:
        judged = study(dataset.windows, plant, names, kinds, draws, seed, progress)
    return replace(evaluation_of(judged, plant.length_overall_m, seed), model=model.said)


def predict(
    recording: str | Path,
    at: str,
    calibrator: TrainedCalibrator | str | Path | None = None,
    vessel: str | Path | None = None,
    horizon_s: int | None = None,
    commands: str | Path | None = None,
) -> Prediction:
    """One predicted track with its region, from the instant ``at`` of a recording.

    ``at`` is ISO 8601 with zone, seconds since 1970, or ``+SECONDS`` from the recording's start. ``commands`` is a
    table of the orders that are planned (:mod:`.planned_commands`); without it the actuators stay as they are.
    """
    from functools import partial

    from seatrial.analysis.tables.resample import resample
    from seatrial.analysis.windows.held import second_by_second
    from seatrial.hybrid.calibrators.predict import parse_time, predictor_of, read_commands
    from seatrial.hybrid.calibrators.predict import predict as predict_at
    from seatrial.hybrid.vessel.files import trials_of

    by = predictor_of(trials_of([Path(recording)]), calibrator, vessel, horizon_s)
    table = read_table(recording)
    require(with_calm(table))
    recorded = second_by_second(partial(resample, table))
    planned = None if commands is None else read_commands(Path(commands), table_actuators(table))
    instant = parse_time(at, recorded.table)
    found = predict_at(recorded, instant, by.horizon_s, by.plant, by.trained, planned)
    return replace(found, model=by.said)


def diagnose(
    recordings: Paths,
    vessel: str | Path | Vessel | None = None,
    tolerance_percent: float = 1.0,
    *,
    effect_files: Sequence[str | Path] = (),
    without: Sequence[str] = (),
    part: str = "0..100",
    repair: bool = False,
    rebuild_positions: bool | None = None,
    identify: bool | None = None,
) -> DiagnosisRun:
    """What the model of ``vessel`` lacks, by recordings: the effects named, their sizes, the gap before and after.

    ``tolerance_percent`` of the force range is how far off the model may be anyway; ``effect_files`` add effects to
    the catalogue, ``without`` takes effects out of it; ``identify`` has the coefficients identified before,
    ``None`` where many of them prove wrong. Faults of the record that no effect could be are repaired, with
    ``repair`` the scales and delays of sensors, too; ``rebuild_positions`` takes positions by dead reckoning,
    ``None`` where their time stamps jitter.
    """
    from seatrial.hybrid.effects.catalogue import catalogue_with
    from seatrial.hybrid.workflows import diagnose_files

    ship = _model(recordings, vessel).vessel
    catalogue = catalogue_with(effect_files, without, ship)
    with bar("diagnosing") as progress:
        return diagnose_files(
            as_paths(recordings), ship, tolerance_percent / 100.0, catalogue, percent_of(part),
            repair=repair, rebuild_positions=rebuild_positions, identify=identify, progress=progress,
        )  # fmt: skip


def identify(
    recordings: Paths,
    vessel: str | Path | Vessel | None = None,
    output: str | Path | None = None,
    horizon_s: int = 30,
    *,
    repair: bool = False,
    rebuild_positions: bool | None = None,
    validation: bool = True,
    segment_s: float | None = None,
    part: str = "0..100",
) -> Identification:
    """The coefficients of the model of ``vessel`` by recordings, with intervals, judged on what is left out.

    The vessel with them goes to ``output`` if that is named. Predictions are judged over ``horizon_s``, under the
    commands as they were recorded; without ``validation`` they are not. ``repair`` and ``rebuild_positions`` are
    those of :func:`diagnose`. ``segment_s`` is how long each stretch is that the fit simulates from a start of its
    own, without it about a ship length. Each recording is checked before: values that stood still are set aside,
    and no stretch goes over a jump of the positions.
    """
    from seatrial.analysis.windows.held import named_recordings
    from seatrial.hybrid.identification.identify import identify_tables, judge, repertoire_of
    from seatrial.hybrid.vessel.files import save_vessel
    from seatrial.hybrid.workflows import usable_tables

    chosen = _model(recordings, vessel)
    ship, paths = chosen.vessel, as_paths(recordings)
    tables, set_aside = usable_tables(
        named_recordings(paths), percent_of(part),
        repaired=repair or bool(rebuild_positions), rebuild_positions=rebuild_positions,
    )  # fmt: skip
    for table in tables.values() if not validation else ():  # the validation reports it, too
        warn_of_calm(with_calm(table))
    with bar("identifying") as progress:
        found, fitted, model = identify_tables(
            tables, ship, candidates=repertoire_of(ship), segment_s=segment_s, progress=progress
        )
    if validation:
        with bar("validating") as progress:
            found = replace(found, validation=judge(tables, model, fitted, horizon_s, progress))
    if output is not None:
        save_vessel(found.vessel, output)
    return replace(found, file=str(output or ""), model=chosen.said, set_aside=set_aside)


def plan(
    vessel: str | Path | None = None,
    manoeuvres: Sequence[str] = (),
    duration_min: float = 60.0,
    sea_state: str | None = None,
    tolerance_percent: float = 1.0,
    *,
    effect_files: Sequence[str | Path] = (),
    without: Sequence[str] = (),
) -> Plan:
    """Before a trial: which effects a programme of manoeuvres would show, from what size, and a better one.

    Without a sea state in a gentle sea, a ship's model in a calm basin.
    """
    from seatrial.hybrid.effects.catalogue import catalogue_with
    from seatrial.hybrid.planning import noise_in, programme_of
    from seatrial.hybrid.planning import plan as plan_programme
    from seatrial.hybrid.simulation.trial import sea_for
    from seatrial.hybrid.vessel.files import load_vessel

    ship = load_vessel(vessel)
    sea = sea_for(sea_state or ("calm" if ship.dimensions.is_model else "gentle"), ship.dimensions)
    catalogue, share = catalogue_with(effect_files, without, ship), tolerance_percent / 100.0
    parts = programme_of(manoeuvres, ship, duration_min)
    with bar("noise") as progress:
        noise = noise_in(ship, sea, share, catalogue, progress)
    with bar("planning") as progress:
        return plan_programme(parts, ship, sea, noise, share, catalogue, progress)


def vessel_check(vessel: str | Path | Vessel | None = None, rpm: float | None = None) -> VesselCheck:
    """The standard manoeuvres of a vessel file, simulated in still water and air, beside IMO's limits.

    Steady speeds, turning circles, zigzags, pull-outs and a crash stop; ``rpm`` is the tests' shaft speed, by
    default that of 85 % of the highest power.
    """
    from seatrial.hybrid.simulation.vessel_check import check_vessel
    from seatrial.hybrid.vessel.files import load_vessel

    return check_vessel(load_vessel(vessel), rpm)


def report(folder: str | Path, **choices: Any) -> list[Path]:
    """The notebook report of a folder (a trial, a diagnosis, the paper's results, a batch) or of one recording.

    ``choices`` are the fields of :class:`seatrial.hybrid.report.folder.Choices`. Returns the paths of its pages.
    """
    from seatrial.hybrid.report.folder import Choices
    from seatrial.hybrid.report.folder import report as write_reports

    with bar("report") as progress:
        return write_reports(Path(folder), Choices(**choices), progress=progress)


def plot(table: pd.DataFrame) -> Figure:
    """The track and the channels of a table, side by side. Raises :class:`DataShortageError` for an empty table."""
    from matplotlib.figure import Figure

    from seatrial.acquisition.core.errors import DataShortageError
    from seatrial.analysis.report.plots import channels_figure, track_figure

    parts = [each for each in (track_figure(table), channels_figure(table)) if each is not None]
    if not parts:
        raise DataShortageError(
            "the table has no channel to plot", fix="give a table with columns of the conventions"
        )
    figure = Figure(figsize=(8.0 * len(parts), 8.0), layout="constrained")
    places = figure.subfigures(1, len(parts), squeeze=False)[0]
    for (draw, _, _), place in zip(parts, places, strict=True):
        draw(place)
    return figure


def as_paths(recordings: Paths) -> list[Path]:
    """One path, or several, as a list."""
    return [Path(recordings)] if isinstance(recordings, str | Path) else [Path(each) for each in recordings]


def _model(recordings: Paths, vessel: str | Path | Vessel | None) -> ReferenceModel:
    from seatrial.hybrid.vessel.files import reference_model, trials_of

    return reference_model(trials_of(as_paths(recordings)), vessel)


def _dataset(
    recordings: Paths,
    horizon_s: int,
    stride_s: int,
    part: str,
    any_commands: bool,
    repair: bool,
    rebuild_positions: bool,
    plant: Plant,
    *,
    shorter: bool = False,
) -> Any:
    from seatrial.hybrid.prediction.dataset import load_dataset

    with bar("reading") as progress:
        return load_dataset(
            as_paths(recordings), horizon_s, stride_s, percent_of(part), progress, shorter=shorter,
            any_commands=any_commands, length_m=plant.length_overall_m,
            repair=repair or rebuild_positions, rebuild_positions=rebuild_positions,
        )  # fmt: skip


def _with_truths(dataset: Dataset, recordings: Paths, part: str, rebuilt: bool) -> Dataset:
    """The data set with its windows' tracks by each sensor as it was measured."""
    from seatrial.analysis.windows.held import tables_of_recordings
    from seatrial.hybrid.evaluation.validate import with_truths

    with bar("sensors") as progress:
        tables = dataset.tables
        if rebuilt:
            tables = tables_of_recordings(as_paths(recordings), part_percent=percent_of(part), repair=True)
        measured = {trial: each.table for trial, each in tables.items()}
        return replace(dataset, windows=with_truths(dataset.windows, measured, progress, rebuilt=rebuilt))
