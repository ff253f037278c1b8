"""``seatrial predict``: one prediction from one instant of a recording, by a reference model or a calibrator.

Planned commands for the seconds to come are a table of when each order would be given:

    second,port_rpm,starboard_rpm,rudder_angle_deg      time,rudder_angle_deg
    0,120,120,0                                         2026-06-01T10:00:00Z,0
    5,120,120,-20                                       2026-06-01T10:04:30Z,-20

``second`` counts from the start of a prediction; ``time`` is ISO 8601 with zone, or seconds since 1970. An order
holds until the next row; what has no column, and what comes before the first row, goes on as it is now. The last
order by ``time`` holds for one horizon: then the plan is over.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from seatrial.acquisition.config.declarations import vessel_file_of_ship, vessel_names
from seatrial.acquisition.core import errors, process, result
from seatrial.acquisition.core.files import read_regular_file
from seatrial.acquisition.core.quantities import Floats
from seatrial.acquisition.core.ship import Actuators, control_names, trial_channel_names, wrap_360
from seatrial.acquisition.tables import table_files, time_columns
from seatrial.analysis.tables.table import table_actuators
from seatrial.analysis.windows.held import OneHertzTables
from seatrial.hybrid import calibrators, effects
from seatrial.hybrid.calibrators.own import load
from seatrial.hybrid.prediction import baselines, kalman_filter, window_sets
from seatrial.hybrid.vessel import black_box, sensors
from seatrial.hybrid.vessel.actuators import angle_columns, control_units
from seatrial.hybrid.vessel.files import Trials, Vessel, chosen_model, reference_model

HORIZON_S = 15
"""The default horizon [s]."""
_PARTS = 20  # of a second: orders may come between full seconds


@dataclass(frozen=True, slots=True)
class Predictor:
    """The reference model of a vessel, or a calibrator on it, with the horizon [s].

    ``calibrator`` is the folder that it came from; ``choice`` is how the model was chosen, with remarks; ``ship``
    is the vessel file of the model, None where that of a calibrator's is not at hand.
    """

    vessel: str
    plant: black_box.MotionModel
    horizon_s: int
    trained: calibrators.TrainedCalibrator | None = None
    calibrator: str = ""
    choice: result.ChosenModel = field(default_factory=lambda: result.ChosenModel(""))
    ship: Vessel | None = None


def choose_predictor(
    trials: Trials,
    calibrator: calibrators.TrainedCalibrator | str | Path | None = None,
    vessel: calibrators.VesselChoice | None = None,
    horizon_s: int | None = None,
    usual_s: int = HORIZON_S,
) -> Predictor:
    """The calibrator, or without one the reference model that :func:`.reference_model` chooses for recordings.

    The default horizon is the calibrator's, or ``usual_s``. The path of the vessel file in a calibrator, which may
    be another person's, is not opened: the file is looked for where those of recordings are. Raises
    :class:`InputError` for an unreadable calibrator, :class:`ConfigurationError` for a vessel other than the
    calibrator's.
    """
    if calibrator is None:
        model = calibrators.choose_predicting_reference(trials, vessel)
        return Predictor(model.file, model.model, horizon_s or usual_s, choice=model.choice, ship=model.ship)
    loaded = isinstance(calibrator, calibrators.TrainedCalibrator)
    if isinstance(calibrator, calibrators.TrainedCalibrator):
        trained = calibrator
    else:
        trained = load(Path(calibrator), vessel=vessel)
    seconds = horizon_s or trained.horizon_s
    trained.refuse_horizon(seconds)
    plant = calibrators.plant_of_calibrator(trained, vessel)
    if isinstance(plant, black_box.BlackBox):
        chosen = calibrators.choose_reference(trials, plant)
        return Predictor(chosen.file, plant, seconds, trained, "" if loaded else str(calibrator), chosen.choice)
    name = Path(trained.vessel).stem
    remark, ship = chosen_model(name, {name}, trials), None
    with suppress(errors.ConfigurationError):
        files = (vessel_file_of_ship(name, path.parent) for path in trials)
        file = trained.vessel if trained.vessel in vessel_names() else next(filter(None, files), None)
        if file is not None:
            model_file = reference_model(trials, file)
            remark = model_file.choice
            ship = model_file.vessel if effects.vessel_plant(model_file.vessel) == trained.plant else None
    return Predictor(trained.vessel, plant, seconds, trained, "" if loaded else str(calibrator), remark, ship)


@dataclass(frozen=True, slots=True, repr=False)
class Prediction(result.ModelResult):
    """One predicted track.

    ``track`` [H+1, 3]: north, east [m], heading [rad]; ``region_m`` [H+1, 2]: the semi-axes of its 95 % region,
    along and across its course, if the method has one; ``measured`` [H+1, 3] where the recording goes on long
    enough. ``outside_domain`` says that the start lies outside the calibrator's domain of applicability: unless the
    calibrator extrapolates, ``method`` then names the fallback's main baseline.
    ``planned`` are the channels [H] of actuators that a plan had orders for, second by second.
    """

    at: pd.Timestamp
    method: str
    track: Floats
    region_m: Floats | None
    measured: Floats | None
    outside_domain: bool = False
    planned: Mapping[str, Floats] = field(default_factory=dict)
    view = "seatrial.hybrid.report.text:prediction_table"
    frame = "track"
    drawing = "seatrial.hybrid.report.plots:draw_prediction"
    size_inch = (9.0, 5.0)

    @property
    def band_m(self) -> Floats | None:
        """The radius [H+1] of the circle that holds the region."""
        return None if self.region_m is None else self.region_m.max(axis=-1)

    def as_dict(self) -> dict[str, Any]:
        """One object for each second, for JSON."""
        rows, region = [], baselines.region_bands(self.region_m)
        for second, (north, east, heading) in enumerate(self.track):
            row: dict[str, Any] = {"second": second, "north_m": float(north), "east_m": float(east)}
            row["heading_deg"] = float(wrap_360(np.rad2deg(heading)))
            row.update({name: None if band is None else float(band[second]) for name, band in region.items()})
            if self.measured is not None:
                row["measured_north_m"], row["measured_east_m"] = map(float, self.measured[second, :2])
            rows.append(row)
        return {
            **self.remarks,
            "at": self.at.isoformat(),
            "horizon_s": len(self.track) - 1,
            "method": self.method,
            "outside_training_range": self.outside_domain,
            "track": rows,
        }


def parse_start_time(text: str, table: pd.DataFrame) -> pd.Timestamp:
    """An instant as ISO 8601 with zone, seconds since 1970, or ``+SECONDS`` from the recording's start.

    Raises :class:`InputError` for anything else.
    """
    start = pd.Timestamp(table.index[0])
    try:
        if text.startswith(("+", "-")):
            return start + pd.Timedelta(seconds=float(text))
        if text.replace(".", "", 1).isdigit():
            return pd.Timestamp(float(text), unit="s", tz="UTC")
        at = pd.Timestamp(text)
    except ValueError as error:
        raise errors.InputError(
            f"{text!r} is not a time",
            fix=f"write it like {start.isoformat()}, as seconds since 1970, or as +SECONDS from the start",
        ) from error
    if at.tzinfo is None:
        raise errors.InputError(f"{text!r} has no time zone", fix=f"write it like {start.isoformat()}")
    return at.tz_convert("UTC")


def window_starting_at(
    recorded: OneHertzTables, at: pd.Timestamp, horizon_s: int
) -> tuple[window_sets.PredictionWindows, bool]:
    """The window that starts at ``at`` in a recording at 1 Hz, and whether the recording covers all of it.

    Raises :class:`InputError` when the instant lies outside or a channel has no value there.
    """
    table, times = recorded.table, pd.DatetimeIndex(recorded.table.index)
    first, last = pd.Timestamp(times[0]), pd.Timestamp(times[-1])
    if not first <= at <= last:
        raise errors.InputError(
            f"{at.isoformat()} is outside the recording",
            fix=f"choose from {first.isoformat()} to {last.isoformat()}",
        )
    times_ns, actuators = times.as_unit("ns").asi8, table_actuators(table)
    start_ns = times_ns[[np.argmin(np.abs(times_ns - at.as_unit("ns").value))]]
    channels = window_sets.channel_rows_after_starts(table, start_ns, np.arange(horizon_s + 1), actuators)
    finite = np.isfinite(channels[0])
    missing = [name for name, present in zip(trial_channel_names(actuators), finite[0], strict=True) if not present]
    if missing:
        start = pd.Timestamp(start_ns[0], tz="UTC").isoformat()
        raise errors.InputError(f"{', '.join(missing)} has no value at {start}", fix="choose another time")
    name = np.array(["prediction"])
    windows = window_sets.windows_of_channels(
        channels, actuators, name, name, start_ns, None, {"prediction": recorded}
    )
    return windows, bool(finite[:, : sensors.HEADING + 1].all())


def predict(
    recorded: OneHertzTables,
    at: pd.Timestamp,
    horizon_s: int,
    plant: black_box.MotionModel,
    trained: calibrators.TrainedCalibrator | None = None,
    commands: pd.DataFrame | None = None,
) -> Prediction:
    """Predict from ``at`` with the actuators held, or under planned ``commands`` (:func:`.read_commands`).

    The prediction is the reference model's, or the calibrator's; the wind is held, or decays to its mean as
    gusts do. Raises :class:`InputError` for a longer horizon than the calibrator's or an instant outside the
    recording, :class:`ModelRangeError` if the reference leaves its range.
    """
    if trained is not None:
        trained.refuse_horizon(horizon_s)
    windows, covered = window_starting_at(recorded, at, horizon_s)
    windows = kalman_filter.filtered_starts(windows, plant)
    planned: Mapping[str, Floats] = {}
    if commands is not None:
        if trained is not None:
            trained.refuse_commands()
        orders, applies = commands, True
        if isinstance(commands.index, pd.DatetimeIndex):
            seconds = (commands.index - pd.Timestamp(windows.start_time[0])) / pd.Timedelta(seconds=1)
            orders = commands.set_axis(seconds)
            applies = seconds[0] < horizon_s and seconds[-1] > -horizon_s
        if applies:  # else the plan begins after the horizon, or is over
            layout = windows.actuators
            controls = mean_planned_controls(orders, windows.control[0], layout, windows.horizon_s)
            channels = zip(control_names(layout), (controls / control_units(layout)).T, strict=True)
            planned = {name: values for name, values in channels if name in orders}
            windows = replace(windows, commands=controls[None])
    track = baselines.simulate_reference(windows, plant)
    if not np.isfinite(track).all():
        raise errors.ModelRangeError(
            f"from {at.isoformat()} the reference model leaves its valid range",
            why="speeds or thrust are outside those of this vessel",
            fix="choose another time, or check --vessel and the units of the recording",
        )
    region_m, outside_domain, source = None, False, "reference"
    if trained is not None:
        predicted = trained.predict_tracks(windows, track)
        track, source = predicted.tracks, str(predicted.source[0])
        outside_domain = bool(predicted.outside_domain[0])
        region_m = np.vstack([np.zeros(2), predicted.region_m[0]])
    return Prediction(
        at=pd.Timestamp(windows.start_time[0]),
        method=source,
        track=track[0],
        region_m=region_m,
        measured=windows.track[0] if covered else None,
        outside_domain=outside_domain,
        planned=planned,
    )


def read_commands(path: Path, actuators: Actuators) -> pd.DataFrame:
    """The table of a CSV or Parquet file: by ``second`` [s] after the start or by ``time`` (UTC), columns as the
    channels of ``actuators``.

    Raises :class:`InputError` naming what is missing, unknown, unsorted or no number.
    """
    try:
        if path.suffix == ".parquet":
            table = process.read_in_child(table_files.FOREIGN_READER, "parquet", path).to_pandas()
        else:
            table = pd.read_csv(BytesIO(read_regular_file(path, process.CONFIGURATION_BYTES)), comment="#")
    except errors.InputError:
        raise
    except (OSError, ValueError) as error:
        raise errors.InputError("cannot be read as a table of commands", where=str(path), why=str(error)) from error
    names, channels = [str(name).strip() for name in table.columns], control_names(actuators)
    table.columns = pd.Index(names)
    time_column = next((name for name in names if name in ("second", "time")), None)
    if time_column is None:
        raise errors.InputError(
            "has no column second or time", where=str(path), fix="give the seconds after the start, or the times"
        )
    unknown = sorted(set(names) - {time_column, *channels})
    if unknown or len(set(names)) < len(names) or len(names) < 2:
        raise errors.InputError(
            f"has the columns {', '.join(names)}", where=str(path),
            fix=f"give second or time, and each at most once of {', '.join(channels)}",
        )  # fmt: skip
    if time_column == "time" and len(table):
        table["time"] = time_columns.parse_times(table_files.RawTable(path, table), "time")
    else:
        table[time_column] = pd.to_numeric(table[time_column], errors="coerce").replace(np.inf, np.nan)
    orders = pd.DataFrame(table.set_index(time_column).apply(pd.to_numeric, errors="coerce"))
    if orders.empty or orders.index.hasnans or not np.isfinite(orders.to_numpy(dtype=float)).all():
        raise errors.InputError("contains cells that are not numbers, or no row", where=str(path))
    if not (orders.index.is_monotonic_increasing and orders.index.is_unique):
        raise errors.InputError(
            f"its {time_column}s do not increase from row to row", where=str(path), fix="sort them, each once"
        )
    return orders


def mean_planned_controls(table: pd.DataFrame, initial: Floats, actuators: Actuators, horizon_s: int) -> Floats:
    """The mean controls over each second of the horizon [H, controls] in SI, starting from ``initial`` [controls].

    ``table`` is that of :func:`read_commands` by seconds after the start; the last row before it is the current
    order. Angles are averaged the shorter way round.
    """
    times = (np.arange(horizon_s * _PARTS) + 0.5) / _PARTS
    row = np.searchsorted(table.index.to_numpy(dtype=float), times, side="right")  # 0: before the first
    settings = np.tile(initial, (len(table) + 1, 1))
    for column, (name, unit) in enumerate(zip(control_names(actuators), control_units(actuators), strict=True)):
        if name in table:
            settings[1:, column] = table[name].to_numpy(dtype=float) * unit
    orders, angles = settings[row], angle_columns(actuators)
    orders[:, angles] = initial[angles] + window_sets.angle_difference_rad(orders[:, angles], initial[angles])
    return np.asarray(orders.reshape(horizon_s, _PARTS, -1).mean(axis=1))
