"""``seatrial watch``: the twin follows a trial's recorder, predicts once a second and evaluates its predictions.

A prediction starts from the newest whole second of the last minute's samples. Only a fraction of a second of
data follows it, so the filter that brings the channels to 1 Hz is one-sided there, and the start state is that
of a Kalman filter (:mod:`seatrial.hybrid.prediction.kalman_filter`), less certain than a two-sided state
computed from a recording. Its error is computed as soon as its horizon has been measured. A prediction assumes
constant wind, and thrusters held or as planned: where a thruster moved otherwise, the error says little about
the model, and is counted, marked and excluded from the means.

The regions adapt to these errors: wider after the ship has left them too often, narrower after too seldom. The
factor on their size tracks the quantile that it stands for (adaptive conformal inference: Gibbs and Candes
2021; as a quantile tracker Angelopoulos, Candes and Tibshirani 2023, "Conformal PID control for time series
prediction", equation 3), on a logarithmic scale:

    log factor  <-  log factor + step (share of seconds outside - 0.05)

for each independent prediction, with larger steps at first. Predictions that start a second apart have nearly
the same error, so each counts as the seconds since the previous one over the horizon. Whatever the errors, the
mean share outside tends to 5 % as 1 / (number of independent predictions) while the factor is inside its
bounds.
"""

from __future__ import annotations

import logging
import sys
import threading
import time
from array import array
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import asdict, dataclass, field, replace
from functools import reduce
from math import exp, log
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import orjson
import pandas as pd
import pymap3d
from numpy.lib.stride_tricks import sliding_window_view
from rich.console import Console, ConsoleOptions, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text
from threadpoolctl import threadpool_limits

from seatrial.acquisition.config.trial_file import TrialConfig
from seatrial.acquisition.core import ship
from seatrial.acquisition.core.errors import DataShortageError, InputError, SeatrialError, Terminal
from seatrial.acquisition.core.quantities import Floats, Series, rotate_earth_to_ship
from seatrial.acquisition.core.trial import Quality, Trial
from seatrial.acquisition.logger import health, requests
from seatrial.acquisition.recording.reader import Recording
from seatrial.analysis.tables.resample import MOTION_FILTER, SETTING_FILTER, bridged_gap_s, resample_recording
from seatrial.analysis.tables.table import NANO, actuators_in_recording, table_actuators, table_controls, times_ns
from seatrial.analysis.windows import held as held_windows
from seatrial.hybrid.calibrators.predict import Prediction, Predictor, predict, read_commands
from seatrial.hybrid.prediction.baselines import COVERAGE, region_bands, region_outlines, relative_distances
from seatrial.hybrid.prediction.window_sets import PAST_S, angle_difference_rad
from seatrial.hybrid.vessel.black_box import MotionModel

if TYPE_CHECKING:
    from seatrial.hybrid.calibrators import TrainedCalibrator


_SOURCE = ("",)

Origin = tuple[float, float] | None
"""Latitude and longitude of the plane's origin [deg], if it is known."""

_TRACK_STYLE = {"color": "#ff7f0e", "weight": 4}
_BAND_STYLE = {"color": "#ff7f0e", "weight": 1, "fillOpacity": 0.15}

FILTER_REACH_S = MOTION_FILTER.reach
"""The delay after which the value of a second at 1 Hz is final [s]: the reach of the filter."""

AVERAGED_S = 300.0

_DRIVEN_S = 5
"""The time that a drive may need to follow an order [s]: with a lag of 1 s, the longest of the vessel files, it
is within a hundredth after 4.6 s."""

_MEANS = ("mean_distance_m", "end_distance_m", "along_m", "across_m", "heading_deg", "inside_band")

STEP = 0.3
"""The step after the first predictions. For errors that follow a Gaussian process, regions of half the right
width cover 94 % over the first hour of 30 s predictions, of twice the width 97 %, and right ones grow by 9 % in
area by chance; half the step takes twice as long, twice the step costs twice the area."""

LARGEST_FACTOR = 4.0
"""The largest factor; the smallest is its inverse. From there, as after a failed sensor, it recovers in an hour
of 30 s predictions."""

Notify = Callable[[str, str], None]
_MARGIN_S = 15.0  # longer than the filters' reach and the evaluation's delay
_LEAST_APART_S = 0.55  # the recorder accepts two a second
_STALLED_S = 3.0
_BACK_NS = 5_000_000_000  # a wrong time stamp in the future must not silence the twin for good
_POLL_S = 0.1
_LOG_EVERY_S = 30.0
_REDRAW_PER_S = 2.0
_MESSAGES = 5  # that are shown
_LEVELS = {"info": logging.INFO, "warning": logging.WARNING, "error": logging.ERROR}
_ROWS = 6
_LEVEL_STYLES = {"info": "dim", "warning": "yellow", "error": "bold red"}


@dataclass(frozen=True, slots=True)
class Forecast:
    """A prediction, the 1 Hz table that it was made of, and the channels that were held to its start."""

    prediction: Prediction
    table: pd.DataFrame
    held: tuple[str, ...]


def newest_second_ns(recording: Recording) -> int | None:
    """The newest whole second [ns] covered by all motion channels; None if there is none.

    Wind and thrusters are held anyway, and may be older.
    """
    spans = [_span_ns(recording.series.get(name)) for name in ship.POSE_AND_VELOCITY]
    covered = [span for span in spans if span is not None]
    if len(covered) < len(ship.POSE_AND_VELOCITY):
        return None
    second_ns = min(newest for _, newest in covered) // NANO * NANO
    return second_ns if second_ns >= max(oldest for oldest, _ in covered) else None


def channels_missing_at(recording: Recording, at_ns: int | None) -> list[str]:
    """The trial's channels without a value at a second: never received, or too long before it.

    Without a second (None) those that were never received.
    """
    missing = []
    for name in ship.trial_channel_names(actuators_in_recording(recording)):
        span = _span_ns(recording.series.get(name))
        if span is None:
            missing.append(name)
        elif at_ns is not None:
            intervals = np.diff(np.sort(recording.series[name].measured_ns))
            longest_hold_s = bridged_gap_s(float(np.median(intervals)) if intervals.size else 0.0)
            if at_ns - span[1] > longest_hold_s * NANO:
                missing.append(name)
    return missing


def predict_now(
    recording: Recording,
    horizon_s: int,
    plant: MotionModel,
    trained: TrainedCalibrator | None = None,
    at_ns: int | None = None,
    commands: pd.DataFrame | None = None,
) -> Forecast:
    """Predict from the newest whole second of the last minute or so, or from the second ``at_ns``, with the
    thrusters as they are or under planned ``commands`` (:func:`.read_commands`).

    Raises :class:`DataShortageError` naming the channels that are missing, :class:`InputError` where one has a gap
    at that second, :class:`ModelRangeError` where the reference leaves its range.
    """
    start_ns = newest_second_ns(recording) if at_ns is None else at_ns
    missing = channels_missing_at(recording, start_ns)
    if missing:
        raise DataShortageError(f"{', '.join(missing)} missing", fix="run `seatrial record --check`")
    if start_ns is None:
        raise DataShortageError("no whole second of the ship's motion", fix="wait for more")

    series, held = dict(recording.series), []
    for name in ship.trial_channel_names(actuators_in_recording(recording)):
        span = _span_ns(series[name])
        if name in ship.POSE_AND_VELOCITY or span is None or span[1] >= start_ns:
            continue
        # wind and thrusters are held from their newest sample to that second
        valid = np.flatnonzero(series[name].quality < Quality.BAD)
        newest = valid[np.argmax(series[name].measured_ns[valid])]
        repeated = replace(series[name].subset(np.array([newest])), measured_ns=np.array([start_ns]))
        series[name] = Series.concatenate([series[name], repeated])
        held.append(name)
    table = resample_recording(replace(recording, series=series) if held else recording)
    at = pd.Timestamp(start_ns, unit="ns", tz="UTC")
    prediction = predict(held_windows.OneHertzTables(table), at, horizon_s, plant, trained, commands)
    return Forecast(prediction, table, tuple(held))


def _span_ns(series: Series | None) -> tuple[int, int] | None:
    """The times of a channel's first and last valid samples [ns]; None without one."""
    if series is None:
        return None
    valid = series.measured_ns[series.quality < Quality.BAD]
    return (int(valid.min()), int(valid.max())) if valid.size else None


class RecentSamples:
    """The samples received in the last ``keep_s`` seconds before the newest one, by channel."""

    def __init__(self, keep_s: float) -> None:
        self._keep_ns = round(keep_s * 1e9)
        self._samples: dict[str, Series] = {}
        self.newest_received_ns = 0

    def clear(self) -> None:
        """Drop all samples."""
        self._samples.clear()
        self.newest_received_ns = 0

    def add(self, samples: Mapping[str, Series]) -> None:
        """Append samples by channel."""
        for name, added in samples.items():
            earlier = self._samples.get(name)
            if added.received_ns.size:
                self.newest_received_ns = max(self.newest_received_ns, int(added.received_ns.max()))
            self._samples[name] = added if earlier is None else Series.concatenate([earlier, added])
        oldest_ns = self.newest_received_ns - self._keep_ns
        self._samples = {
            name: series.subset(series.received_ns >= oldest_ns) for name, series in self._samples.items()
        }

    def recording(self, trial: Trial, path: Path) -> Recording:
        """The samples as a recording, without their sources."""
        series = {
            name: replace(series, sources=_SOURCE, source_index=np.zeros(series.value.size, np.int32))
            for name, series in self._samples.items()
            if series.value.size
        }
        return Recording(path, trial, series, {}, [], 0, False, 0, self.newest_received_ns)


def prediction_message_body(
    prediction: Prediction,
    held: Sequence[str],
    origin: Origin,
    model: tuple[str, str],
    made_ns: int,
    latency_s: float,
    error: TrackError | None,
    running: tuple[float, MeanErrors],
    band_factor: float = 1.0,
) -> dict[str, Any]:
    """The message body. ``model`` names the vessel and the calibrator's folder, ``running`` has the mean errors
    and the seconds that they cover, ``band_factor`` is the factor on the band. Positions are to the millimetre,
    unknown quantities of the track are empty."""
    north_m, east_m, heading = prediction.track.T
    latitude_deg, longitude_deg = geographic_positions(north_m, east_m, origin)
    regions = region_bands(prediction.region_m)
    track = {
        "seconds": np.arange(len(north_m), dtype=float).tolist(),
        "north_m": north_m.round(3).tolist(),
        "east_m": east_m.round(3).tolist(),
        "heading_deg": ship.wrap_360(np.rad2deg(heading)).round(3).tolist(),
        **{name: [] if bounds is None else bounds.round(3).tolist() for name, bounds in regions.items()},
        "latitude_deg": latitude_deg.round(8).tolist(),
        "longitude_deg": longitude_deg.round(8).tolist(),
    }
    over_s, mean = running
    body = {
        "start": prediction.at.as_unit("ns").value / NANO,
        "made_at": made_ns / NANO,
        "latency_s": round(latency_s, 4),
        "horizon_s": len(prediction.track) - 1,
        "method": prediction.method,
        "vessel": model[0][-200:],
        "calibrator": model[1][-200:],
        "outside_training_range": prediction.outside_domain,
        "held_channels": list(held),
        "track": track,
        "running": {"over_s": over_s, **_drop_none(asdict(mean))},
    }
    if prediction.region_m is not None:
        body["band_factor"] = round(band_factor, 4)
    if prediction.planned:
        body["planned_channels"] = list(prediction.planned)
    return body if error is None else {**body, "error": _drop_none(error.as_dict())}


def _drop_none(values: dict[str, Any]) -> dict[str, Any]:
    """The dictionary without None values."""
    return {name: value for name, value in values.items() if value is not None}


def geographic_positions(north_m: Floats, east_m: Floats, origin: Origin) -> tuple[Floats, Floats]:
    """Latitudes and longitudes [deg] of points of the plane; empty without an origin."""
    if origin is None:
        return np.empty(0), np.empty(0)
    latitude, longitude, _ = pymap3d.ned2geodetic(north_m, east_m, np.zeros_like(north_m), *origin, 0.0)
    return np.asarray(latitude), np.asarray(longitude)


def track_geojson(prediction: Prediction, origin: Origin) -> str:
    """The track as a line, and the 95 % region at its end, for a map; empty without an origin."""
    if origin is None:
        return ""
    horizon_s = len(prediction.track) - 1
    shapes = [("LineString", prediction.track[:, :2], f"{prediction.method}, {horizon_s} s", _TRACK_STYLE)]
    if prediction.region_m is not None:
        corners = region_outlines(prediction.track, prediction.region_m[1:])[-1]
        ring = np.concatenate([corners, corners[:1]])
        shapes.append(("Polygon", ring, f"95 % after {horizon_s} s", _BAND_STYLE))
    features = []
    for kind, points, name, style in shapes:
        latitude, longitude = geographic_positions(points[:, 0], points[:, 1], origin)
        coordinates = np.column_stack([longitude, latitude]).round(8).tolist()  # longitude first, as GeoJSON has it
        geometry = {"type": kind, "coordinates": [coordinates] if kind == "Polygon" else coordinates}
        features.append({"type": "Feature", "properties": {"name": name, "style": style}, "geometry": geometry})
    return orjson.dumps({"type": "FeatureCollection", "features": features}).decode()


@dataclass(frozen=True, slots=True)
class TrackError:
    """The error of one prediction, whose start is in ns UTC. Distances are means over its seconds, or at the end.

    ``along_m`` and ``across_m`` are how far it was ahead and to starboard of the ship at the end, by its measured
    heading; ``inside_band`` is the share of its seconds inside the 95 % band, None without a band.
    """

    start_ns: int
    method: str
    thrusters_moved: bool
    mean_distance_m: float
    end_distance_m: float
    along_m: float
    across_m: float
    heading_deg: float
    inside_band: float | None

    def as_dict(self) -> dict[str, Any]:
        """For JSON, as the schema of ``/prediction`` has it."""
        values = asdict(self)
        return {"start": values.pop("start_ns") / NANO, **values}


@dataclass(frozen=True, slots=True)
class MeanErrors:
    """Means over evaluated predictions during which the thrusters did as assumed, None if there are none.

    ``along_m`` and ``across_m`` are signed. ``left_out`` counts the other predictions.
    """

    predictions: int = 0
    left_out: int = 0
    mean_distance_m: float | None = None
    end_distance_m: float | None = None
    along_m: float | None = None
    across_m: float | None = None
    heading_deg: float | None = None
    inside_band: float | None = None

    def with_error(self, error: TrackError) -> MeanErrors:
        """The means updated with one more prediction."""
        if error.thrusters_moved:
            return replace(self, left_out=self.left_out + 1)
        number, means = self.predictions + 1, dict[str, Any]()
        for name in _MEANS:
            value, mean = getattr(error, name), getattr(self, name)
            means[name] = value if mean is None else mean + (value - mean) / number
        return replace(self, predictions=number, **means)


def track_error(prediction: Prediction, measured: Floats, thrusters_moved: bool) -> TrackError:
    """The error of a prediction against the measured track [H+1, 3] of north, east [m] and heading [rad]."""
    gap = prediction.track[1:, :2] - measured[1:, :2]
    distance = np.hypot(gap[:, 0], gap[:, 1])
    along_m, across_m = rotate_earth_to_ship(gap[-1, 0], gap[-1, 1], measured[-1, 2])
    turn = angle_difference_rad(prediction.track[1:, 2], measured[1:, 2])
    inside_band = None
    if prediction.region_m is not None:
        relative = relative_distances(prediction.track[None], measured[None], prediction.region_m[1:])
        inside_band = float(np.mean(relative <= 1.0))
    return TrackError(
        start_ns=prediction.at.as_unit("ns").value,
        method=prediction.method,
        thrusters_moved=thrusters_moved,
        mean_distance_m=float(distance.mean()),
        end_distance_m=float(distance[-1]),
        along_m=float(along_m),
        across_m=float(across_m),
        heading_deg=float(np.rad2deg(np.abs(turn)).mean()),
        inside_band=inside_band,
    )


def follows_plan(name: str, values: Floats, row: int, planned: Floats, actuators: ship.Actuators) -> bool:
    """Whether a control channel followed ``planned`` [H] from ``row`` on, in the channel's unit.

    Its mean over each second has to lie between the orders of the last :data:`_DRIVEN_S` seconds and those
    within reach of the 1 Hz filter, with the tolerance of a held setting. The last seconds, to which that
    filter carries values from after the horizon, do not count.
    """
    reach, circular = SETTING_FILTER.reach, ship.is_circular(name)
    seconds = max(len(planned) - reach, 1)
    series = ship.unwrap(values) if circular else values
    reached = sliding_window_view(series[row : row + seconds + 1], 2).mean(axis=1)
    orders = np.concatenate([np.full(_DRIVEN_S, values[row]), planned, np.full(reach, planned[-1])])
    near = sliding_window_view(ship.unwrap(orders) if circular else orders, _DRIVEN_S + 1 + reach)[:seconds]
    low, high = near.min(axis=1), near.max(axis=1)
    deviation = reached - 0.5 * (low + high)
    tolerance = held_windows.tolerance_of(name, actuators).for_values(series)
    span = tolerance.span + held_windows.SPAN_SIGMAS * held_windows.feedback_of(series, tolerance.noise).noise
    return bool((np.abs(ship.wrap_180(deviation) if circular else deviation) <= 0.5 * (high - low) + span).all())


class RunningError:
    """Pending predictions, whose horizons are not over, and the errors of the latest ones whose horizons are.

    ``unmeasured`` counts those without a measured track because a channel was missing, positions jumped or
    another recording began.
    """

    def __init__(self, over_s: float = AVERAGED_S) -> None:
        self.over_s = over_s
        self.unmeasured = 0
        self._pending: deque[Prediction] = deque()
        self._last: deque[TrackError] = deque()

    def add(self, prediction: Prediction) -> None:
        """Add a prediction, later than those before it."""
        self._pending.append(prediction)

    def clear(self) -> None:
        """Drop the pending predictions and count them as unmeasured."""
        self.unmeasured += len(self._pending)
        self._pending.clear()

    def evaluate(self, table: pd.DataFrame, until_ns: int) -> list[TrackError]:
        """Evaluate predictions with a 1 Hz table known up to a time [ns]; the errors, earliest first."""
        errors = []
        while self._pending:
            prediction = self._pending[0]
            start_ns, horizon_s = prediction.at.as_unit("ns").value, len(prediction.track) - 1
            if until_ns < start_ns + (horizon_s + FILTER_REACH_S) * NANO:
                break
            self._pending.popleft()
            error = self._error(prediction, table, start_ns, horizon_s)
            if error is None:
                self.unmeasured += 1
            else:
                errors.append(error)
        self._last.extend(errors)
        while self._last and self._last[0].start_ns < self._last[-1].start_ns - self.over_s * NANO:
            self._last.popleft()
        return errors

    def mean(self) -> MeanErrors:
        """The means over the evaluated predictions of the last ``over_s`` seconds."""
        return reduce(MeanErrors.with_error, self._last, MeanErrors())

    def _error(
        self, prediction: Prediction, table: pd.DataFrame, start_ns: int, horizon_s: int
    ) -> TrackError | None:
        times = times_ns(table)
        row = int(np.searchsorted(times, start_ns))
        rows = slice(row, row + horizon_s + 1)
        seconds = table.iloc[rows]
        if len(seconds) <= horizon_s or times[row] != start_ns or times[rows][-1] != start_ns + horizon_s * NANO:
            return None
        heading = np.deg2rad(ship.unwrap(seconds["heading_deg"].to_numpy(dtype=float)))
        track = np.column_stack([seconds["north_m"], seconds["east_m"], heading])
        if not (np.isfinite(track).all() and seconds[list(table_controls(table))].notna().all(axis=None)):
            return None
        if held_windows.near_jumps(table[list(ship.POSE_AND_VELOCITY)].to_numpy(dtype=float))[rows].any():
            return None
        actuators, planned = table_actuators(table), prediction.planned or {}
        as_assumed = all(  # as planned, or held within the tolerance of held windows
            follows_plan(name, values, row, planned[name], actuators)
            if name in planned
            else held_windows.steady_mask(name, values, horizon_s + 1, 1, actuators)[row]
            for name, values in (
                (name, table[name].to_numpy(dtype=float)) for name in ship.control_names(actuators)
            )
        )
        return track_error(prediction, track, not as_assumed)


def region_factor_step(learned: float) -> float:
    """The step after a number of independent predictions: large at first, as t^-0.6 (Angelopoulos, Barber and
    Bates 2024, "Online conformal prediction with decaying step sizes"), then :data:`STEP`, since ships and days
    change."""
    return max(STEP, exp(-0.6 * log(max(learned, 1.0))))


@dataclass(frozen=True, slots=True)
class RegionFactor:
    """The factor on the size of the 95 % regions, the number of independent predictions behind it, and the
    start of the latest [ns UTC]."""

    factor: float = 1.0
    learned: float = 0.0
    start_ns: int | None = None

    def updated_by_error(self, error: TrackError, horizon_s: int) -> RegionFactor:
        """The factor after one more evaluated prediction; unchanged if that had no region or a thruster moved."""
        if error.inside_band is None or error.thrusters_moved:
            return self
        apart_s = 0.0 if self.start_ns is None else (error.start_ns - self.start_ns) / NANO
        independent = min(max(apart_s, 0.0) / horizon_s, 1.0)
        learned, bound = self.learned + independent, log(LARGEST_FACTOR)
        raised = log(self.factor) + region_factor_step(learned) * independent * (COVERAGE - error.inside_band)
        return RegionFactor(exp(min(max(raised, -bound), bound)), learned, error.start_ns)

    def widen_prediction(self, prediction: Prediction) -> Prediction:
        """A prediction with its region, if it has one, multiplied by the factor."""
        if prediction.region_m is None:
            return prediction
        return replace(prediction, region_m=self.factor * prediction.region_m)

    @property
    def is_at_bound(self) -> bool:
        """Whether it is at a bound, where regions no longer measure the errors."""
        return abs(log(self.factor)) > 0.999 * log(LARGEST_FACTOR)

    def __str__(self) -> str:
        """What it says of the regions in plain words.

        >>> print(RegionFactor(1.5))
        band 1.5 times as wide as the calibrator's, which held the ship too seldom
        """
        if abs(self.factor - 1.0) < 0.05:
            return "band as wide as the calibrator's"
        held = "held the ship too seldom" if self.factor > 1.0 else "was wider than needed"
        beyond = ": at its limit, train again" if self.is_at_bound else ""
        return f"band {self.factor:.2g} times as wide as the calibrator's, which {held}{beyond}"


class PlanFile:
    """The orders of a plan file, reread whenever it changes; ``notify`` gets level and text each time.

    Without the file the present orders continue. An unreadable file is reported, and the previous plan is
    followed until it can be read.
    """

    def __init__(self, path: Path, actuators: ship.Actuators, notify: Notify) -> None:
        self.path = path
        self._actuators, self._notify = actuators, notify
        self._orders: pd.DataFrame | None = None
        self._version: tuple[int, ...] | None = ()  # as no file is

    def orders(self) -> pd.DataFrame | None:
        """The orders as :func:`.read_commands` gives them; None without a plan."""
        version: tuple[int, ...] | None = None
        with suppress(OSError):
            status = self.path.stat()
            version = status.st_ino, status.st_size, status.st_mtime_ns
        if version == self._version:
            return self._orders
        self._version = version
        if version is None:
            self._orders = None
            self._notify("warning", f"no plan at {self.path}: what is ordered now goes on")
            return None
        try:
            self._orders = read_commands(self.path, self._actuators)
        except InputError as error:
            fallback = "what is ordered now goes on" if self._orders is None else "the plan before goes on"
            self._notify("warning", f"no new plan, {fallback}: {error}")
        else:
            self._notify("info", plan_text(self._orders))
        return self._orders


def plan_text(orders: pd.DataFrame) -> str:
    """A plan in one line: what it orders, and from when to when.

    >>> plan_text(pd.DataFrame({"rudder_angle_deg": [0.0, -20.0]}, index=pd.Index([0.0, 5.0], name="second")))
    'plan of rudder_angle_deg: 2 orders, 0 to 5 s after the start of each prediction'
    """
    first, last = orders.index[[0, -1]]
    period = (
        f"{first:%Y-%m-%d %H:%M:%S} to {last:%Y-%m-%d %H:%M:%S} UTC"
        if isinstance(first, pd.Timestamp)
        else f"{first:g} to {last:g} s after the start of each prediction"
    )
    number = "1 order" if len(orders) == 1 else f"{len(orders)} orders"
    return f"plan of {', '.join(map(str, orders.columns))}: {number}, {period}"


def data_needed_for_prediction_s(horizon_s: int) -> float:
    """The seconds of data needed for prediction and evaluation."""
    return max(PAST_S, horizon_s) + _MARGIN_S


@dataclass(slots=True)
class Statistics:
    """Counts and means since the start, and the latency of each prediction [s]."""

    made: int = 0
    recorded: int = 0
    latency_s: array[float] = field(default_factory=lambda: array("d"))
    errors: MeanErrors = field(default_factory=MeanErrors)


class Twin:
    """The twin of the recorder of trial ``name``; to be closed. Call :meth:`poll` about ten times a second.

    The thrusters are held, or follow a ``plan`` of orders.
    """

    def __init__(
        self,
        name: str,
        configuration: Path,
        predictor: Predictor,
        notify: Notify,
        folder: Path | None = None,
        plan: PlanFile | None = None,
    ) -> None:
        self.predictor, self.statistics, self.errors = predictor, Statistics(), RunningError()
        self.region = RegionFactor()
        self.last: Forecast | None = None
        self.last_error: TrackError | None = None
        self.follower = requests.Follower(
            name, configuration, data_needed_for_prediction_s(predictor.horizon_s), notify, folder
        )
        self._recent, self._plan = RecentSamples(data_needed_for_prediction_s(predictor.horizon_s)), plan
        self._notify, self._last_notice = notify, ""
        self._start_ns, self._made_s, self._new_s = 0, 0.0, time.monotonic()

    def close(self) -> None:
        """Close the recording."""
        self.follower.close()

    def poll(self) -> bool:
        """Read new samples; whether they led to a new prediction."""
        news = self.follower.news()
        if news.restarted:
            self._recent.clear()
            self.errors.clear()
            self._start_ns, self._new_s = 0, time.monotonic()
        for samples in news.samples:
            self._recent.add(samples)
        path = self.follower.part_path
        if not news.samples or path is None or time.monotonic() - self._made_s < _LEAST_APART_S:
            return False
        recording = self._recent.recording(self.follower.trial, path)
        start_ns = newest_second_ns(recording)
        if start_ns is not None and start_ns < self._start_ns - _BACK_NS:
            back_s = (self._start_ns - start_ns) / NANO
            self._notify_once("warning", f"the sources' times went back by {back_s:.0f} s: begun anew")
            self._start_ns = 0
            self.errors.clear()
        if start_ns is not None and start_ns > self._start_ns:
            self._start_ns = start_ns
            return self._predict_and_send(recording, start_ns)

        if time.monotonic() - self._new_s >= _STALLED_S:  # name the channels without which nothing is predicted
            newest = [int(series.measured_ns.max()) for name, series in recording.series.items()
                      if name in ship.trial_channel_names(actuators_in_recording(recording))]  # fmt: skip
            missing = channels_missing_at(recording, max(newest) // NANO * NANO if newest else None)
            if missing:
                self._notify_once("warning", f"no prediction: nothing comes of {', '.join(missing)}")
        return False

    def _predict_and_send(self, recording: Recording, start_ns: int) -> bool:
        """Predict, judge earlier predictions by what has been measured since, and send the new one."""
        self._made_s = time.monotonic()
        predictor, orders = self.predictor, None if self._plan is None else self._plan.orders()
        try:
            forecast = predict_now(
                recording, predictor.horizon_s, predictor.plant, predictor.trained, start_ns, orders
            )
        except SeatrialError as error:
            self._notify_once("warning", f"no prediction: {error}")
            return False
        self._new_s = time.monotonic()
        errors = self.errors.evaluate(forecast.table, start_ns)
        for past_error in errors:
            self.statistics.errors = self.statistics.errors.with_error(past_error)
            self.region = self.region.updated_by_error(past_error, predictor.horizon_s)
        self.last_error = errors[-1] if errors else None
        prediction = self.region.widen_prediction(forecast.prediction)
        self.last = replace(forecast, prediction=prediction)
        self.errors.add(prediction)

        origin, made_ns = self.follower.trial.origin, self.follower.utc_ns
        latency_s = max((made_ns - self._recent.newest_received_ns) / NANO, 0.0)
        self.statistics.made += 1
        self.statistics.latency_s.append(latency_s)
        body = prediction_message_body(
            prediction, forecast.held, origin, (predictor.vessel, predictor.calibrator), made_ns, latency_s,
            self.last_error, (self.errors.over_s, self.errors.mean()), self.region.factor,
        )  # fmt: skip
        if self.follower.recorder is not None:
            refused = requests.send_prediction(self.follower.recorder[0], body, track_geojson(prediction, origin))
            self.statistics.recorded += not refused
            self._notify_once(
                "warning" if refused else "info", f"not recorded: {refused}" if refused else "predicting"
            )
        return True

    def _notify_once(self, level: str, text: str) -> None:
        """Notify once of each new text."""
        if text != self._last_notice:
            self._last_notice = text
            self._notify(level, text)


def compile_predictor(predictor: Predictor) -> None:
    """Make one prediction for a ship at rest, so that compilation happens before it matters."""
    with suppress(SeatrialError):
        at_rest = recording_at_rest(data_needed_for_prediction_s(predictor.horizon_s), predictor.plant.layout)
        predict_now(at_rest, predictor.horizon_s, predictor.plant, predictor.trained)


def recording_at_rest(seconds: float, actuators: ship.Actuators = ship.DEFAULT) -> Recording:
    """A recording with all channels of a ship at zero, one sample a second."""
    times_ns = np.arange(int(seconds) + 1, dtype=np.int64) * NANO
    zeros = np.zeros(times_ns.size)
    flags = np.full(times_ns.size, Quality.GOOD, np.uint8)
    series = Series(times_ns, times_ns, zeros, flags, ("",), np.zeros(times_ns.size, np.int32))
    return Recording(
        Path(), Trial(actuators=ship.actuators_as_text(actuators)),
        dict.fromkeys(ship.trial_channel_names(actuators), series), {}, [], 0, True, 0, int(times_ns[-1]),
    )  # fmt: skip


@dataclass(frozen=True, slots=True)
class WatchSummary:
    """Counts of predictions, mean errors, and latencies.

    ``made`` predictions, of which the logger ``recorded`` some; ``judged`` against measurements, ``left_out``
    of the means because a thruster departed from the plan, ``unmeasured`` for lack of a measured track.
    ``band_factor`` is the final factor on the calibrator's band.
    """

    made: int
    recorded: int
    judged: int
    left_out: int
    unmeasured: int
    mean_distance_m: float | None
    end_distance_m: float | None
    heading_deg: float | None
    inside_band: float | None
    band_factor: float | None
    latency_median_s: float | None
    latency_95_s: float | None
    latency_max_s: float | None

    def __str__(self) -> str:
        text = f"{self.made:,} predictions, {self.recorded:,} recorded, {self.judged:,} judged"
        text += f", {self.left_out:,} left out as a thruster moved"
        if self.mean_distance_m is not None:
            text += f"; {self.mean_distance_m:.2f} m off on the way, {self.end_distance_m:.2f} m at the end"
        if self.inside_band is not None:
            text += f", {self.inside_band:.0%} inside the band"
        if self.band_factor is not None:
            text += f"; {RegionFactor(self.band_factor)}"
        if self.latency_median_s is not None:
            text += f"; latency {self.latency_median_s:.2f} s, {self.latency_95_s:.2f} s in 95 of 100 cases"
        return text


def watch_summary(statistics: Statistics, unmeasured: int, region: RegionFactor) -> WatchSummary:
    """A summary of the statistics and of the adaptation of the regions."""
    errors, latency_s = statistics.errors, statistics.latency_s
    latencies = np.quantile(latency_s, (0.5, 0.95, 1.0)).tolist() if latency_s else (None, None, None)
    return WatchSummary(
        statistics.made, statistics.recorded, errors.predictions, errors.left_out, unmeasured,
        errors.mean_distance_m, errors.end_distance_m, errors.heading_deg, errors.inside_band,
        None if errors.inside_band is None else region.factor, *latencies,
    )  # fmt: skip


def watch(
    config: TrialConfig,
    predictor: Predictor,
    stop: threading.Event,
    duration_s: float | None = None,
    log_format: health.LogFormat = "text",
    folder: Path | None = None,
    commands: Path | None = None,
) -> WatchSummary:
    """Predict beside the recorder of a trial until ``stop`` is set or ``duration_s`` is over.

    Waits where there is no recorder, and goes on with the next where one ends. ``folder`` is where recorders
    leave their sockets, if not in the usual place; ``commands`` a file of planned orders (:class:`.PlanFile`).
    Raises :class:`InputError` for a calibrator of held controls beside such a file.
    """
    if commands is not None and predictor.trained is not None:
        predictor.trained.refuse_commands()
    messages: deque[tuple[str, str]] = deque(maxlen=_MESSAGES)
    on_terminal = sys.stderr.isatty()

    def notify(level: str, text: str) -> None:
        if on_terminal:
            messages.append((level, text))
        else:
            health.LOG.log(_LEVELS[level], text)

    with ExitStack() as stack:
        stack.enter_context(threadpool_limits(limits=1))  # leave the other cores to the logger
        plan = None if commands is None else PlanFile(commands, predictor.plant.layout, notify)
        twin = Twin(config.trial.name, config.path, predictor, notify, folder, plan)
        stack.callback(twin.close)
        display = Live(
            Display(twin, messages), console=Terminal(stderr=True), refresh_per_second=_REDRAW_PER_S, screen=True
        )  # drawn by a thread of its own
        stack.enter_context(display if on_terminal else health.log_to(sys.stderr, log_format))
        compile_predictor(predictor)
        until_s = float("inf") if duration_s is None else time.monotonic() + duration_s
        logged_s = time.monotonic()
        while time.monotonic() < until_s and not stop.wait(_POLL_S):
            twin.poll()
            if time.monotonic() - logged_s >= _LOG_EVERY_S and twin.statistics.made:
                logged_s = time.monotonic()
                mean = mean_error_text(twin.errors.mean(), twin.errors.over_s)
                health.LOG.info("%s; %s; %s", latency_text(twin), mean, twin.region)
        return watch_summary(twin.statistics, twin.errors.unmeasured, twin.region)


def watch_summary_as_json(summary: WatchSummary, predictor: Predictor) -> dict[str, object]:
    """One object for other programs."""
    return {
        **predictor.choice.remarks,
        "horizon_s": predictor.horizon_s,
        "vessel": predictor.vessel,
        "calibrator": predictor.calibrator,
        **asdict(summary),
    }


@dataclass(frozen=True, slots=True)
class Display:
    """A twin's state for a terminal, for every redrawing."""

    twin: Twin
    messages: deque[tuple[str, str]]

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[RenderableType]:
        twin, path = self.twin, self.twin.follower.part_path
        part = "waiting" if path is None else path.name
        yield _one_line_text(("● TWIN ", "bold cyan"), f"{twin.statistics.made:,} predictions  {part}")
        if twin.last is not None:
            prediction = twin.last.prediction
            beyond = ", outside the calibrator's training range" if prediction.outside_domain else ""
            planned = f", with {', '.join(prediction.planned)} as planned" if prediction.planned else ""
            source = f"{prediction.method} from {prediction.at:%H:%M:%SZ}{beyond}{planned}"
            yield _one_line_text((source, "yellow" if prediction.outside_domain else "green"))
            yield track_table(prediction)
            if prediction.region_m is not None:
                yield _one_line_text((str(twin.region), "red" if twin.region.is_at_bound else ""))
        yield _one_line_text(latency_text(twin))
        error = twin.last_error
        if error is None:
            yield _one_line_text("no earlier prediction to judge")
        else:
            why = "  a thruster moved: not in the means" if error.thrusters_moved else ""
            distances = f"{error.end_distance_m:.1f} m off at the end, {error.mean_distance_m:.1f} m on the way"
            yield _one_line_text(f"then: {distances}{why}")
        for line in mean_error_text(twin.errors.mean(), twin.errors.over_s).split("; "):
            yield _one_line_text(line)
        for level, text in tuple(self.messages):
            yield _one_line_text((text, _LEVEL_STYLES.get(level, "")))


def _one_line_text(*parts: str | tuple[str, str]) -> Text:
    return Text.assemble(*parts, no_wrap=True, overflow="ellipsis")


def track_table(prediction: Prediction) -> Table:
    """A row every few seconds: distance ahead and to starboard of the present position, heading, band."""
    table = Table(box=None, padding=(0, 1, 0, 0), header_style="dim")
    for title in ("in s", "ahead m", "starboard m", "heading deg", "95 % band m"):
        table.add_column(title, justify="right", min_width=8, no_wrap=True)
    horizon_s = len(prediction.track) - 1
    north, east, heading = prediction.track[0]
    for second in np.unique(np.linspace(0, horizon_s, _ROWS + 1).round().astype(int))[1:]:
        away_north, away_east = prediction.track[second, :2] - (north, east)
        ahead, starboard = rotate_earth_to_ship(away_north, away_east, heading)
        band = "–" if prediction.band_m is None else f"{prediction.band_m[second]:.1f}"
        there_deg = float(ship.wrap_360(np.rad2deg(prediction.track[second, 2])))
        table.add_row(str(second), f"{ahead:.1f}", f"{starboard:.1f}", f"{there_deg:.1f}", band)
    return table


def latency_text(twin: Twin) -> str:
    """The latency of the newest prediction."""
    times_s = twin.statistics.latency_s
    return f"latency {times_s[-1]:.2f} s" if times_s else "no prediction yet"


def mean_error_text(mean: MeanErrors, over_s: float) -> str:
    """The means over the last minutes."""
    if mean.mean_distance_m is None or mean.along_m is None or mean.across_m is None:
        return f"last {over_s / 60:g} min: none judged, {mean.left_out} left out as a thruster moved"
    inside = "" if mean.inside_band is None else f", {mean.inside_band:.0%} inside the band"
    period = f"last {over_s / 60:g} min"
    return (
        f"{period}: {mean.mean_distance_m:.2f} m on the way, {mean.end_distance_m:.2f} m at the end "
        f"({mean.along_m:+.2f} ahead, {mean.across_m:+.2f} to starboard), {mean.heading_deg:.2f} deg{inside}; "
        f"{mean.predictions} judged, {mean.left_out} left out as a thruster moved"
    )
