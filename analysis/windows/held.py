"""Held windows: stretches of a recording with constant actuator settings, on which models are tested.

A candidate starts every ``stride_s`` seconds of the table and covers seconds 0 to ``horizon_s``. It is kept if
all channels are present at every second and the controls of all actuators are held (:func:`steady_mask`);
otherwise it is counted under the first reason that applies. Windows that share a second, or that follow each
other at the same held setting, form a leg: a split by leg or by trial never has one second on both sides.

One rule serves all settings; it tolerates noise but not a ramp. A setting is held over a window if two
quantities are small: the range of its values, which catches steps and spikes, and the drift, the slope of the
least-squares line times the window's length, which catches slow ramps within the range. Both bounds combine a
floor, the natural variation of a held setting, with a multiple of the feedback noise, measured on the table
itself: added for the range, and as the root of squares for the drift, so that noise widens it no more than
necessary. Feedback faster than the table has been filtered: its noise is smaller but correlated, which reduces
second differences and increases drift. Both are corrected by the filter's correlation.

Near zero revolutions the rule concerns thrust, which is quadratic in them: within the idle band, with less than
1 % of the thrust at 130 rpm, a shaft may flicker and only the drift counts. Angles count whether a shaft turns
or not: a pod turned with an idle propeller still steers a moving ship, as does a rudder. Bounds of a shaft grow
with its usual speed, beyond that of a ship's: a 3 m model turns its propeller at 600 rpm, and the variation of
a held setting is a share of that.

A prediction starts from a state that cannot be measured without noise. Here it is the Kalman smoother's, with
its covariance, from the samples at their own times (:mod:`seatrial.analysis.estimation.smoother`): the motion as
perfect sensors would have measured it, including waves, and also the slow motion without them.

Predictions start not from that slow motion but from the causal state of the model's Kalman filter at second 0,
and, marked two-sided, from :mod:`seatrial.analysis.series`. Of the two that use later data,
judged by constant velocity over 15 s and 30 s, neither is always better: the smoother's is on a docking (1.3 m for
1.45 m rms at 15 s), and in waves it is equal in position and up to 10 % worse in heading; on a recording with
jitter in the times of positions it is much worse (16.9 m for 6.8 m).
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import pandas as pd
from numpy.lib.stride_tricks import sliding_window_view

from seatrial.acquisition.core import files, ship
from seatrial.acquisition.core.errors import DataShortageError, InputError, printable_path
from seatrial.acquisition.core.quantities import Bools, Floats, Ints, to_earth
from seatrial.acquisition.core.result import Result
from seatrial.acquisition.recording.reader import parts_by_recording, read_parts_of_recording
from seatrial.analysis.estimation import motion_model, smoother
from seatrial.analysis.quality import situations
from seatrial.analysis.quality.repairs import Preparation, prepare_table
from seatrial.analysis.tables import export
from seatrial.analysis.tables import table as tables
from seatrial.analysis.tables.resample import MOTION_FILTER, SETTING_FILTER, resample, resample_recording

if TYPE_CHECKING:
    from xarray import Dataset

Sort = Literal["azimuth", "shaft", "tunnel", "rudder", "nozzle", "pitch"]
_MOVED: dict[Sort, str] = {
    "azimuth": "azimuth_moved", "shaft": "rpm_moved", "tunnel": "tunnel_moved",
    "rudder": "rudder_moved", "nozzle": "nozzle_moved", "pitch": "pitch_moved",
}  # fmt: skip
MOVED = tuple(_MOVED.values())
"""The reasons for which a window is complete but not held."""
REASONS = ("gap", "missing_data", "position_jump", *situations.KINDS, *MOVED)
"""The reasons for dropping a candidate, in order of checking."""

_JUMP_M, _JUMP_DEVIATIONS = 2.0, 10.0
"""The limits of a one-second step relative to the measured speeds, in metres and in standard deviations of the
recording's other steps; beyond both, a receiver jumped or two parts were joined."""
_FILTERED_RATIO = 1.5  # of the noise seen two rows apart to that seen from row to row: 1 if white, 2.1 if filtered
SPAN_SIGMAS, DRIFT_SIGMAS = 8.0, 4.75
"""The number of standard deviations for range and drift: a held window of 15 s with Gaussian noise is lost once
in some 200,000; a ramp of 0.5 deg/s is recognised at noise of up to 1 deg."""

IDLE_RPM, IDLE_DRIFT_RPM = 12.0, 5.0
"""The idle band of a shaft and the drift allowed in it over a window; they scale with its bounds."""
SLOW_STATES = tuple(f"slow_{name}" for name in ship.POSE_AND_VELOCITY)
START_COLUMNS = (
    "window", "trial", "leg", "start", *ship.POSE_AND_VELOCITY, *smoother.COVARIANCE_NAMES, *SLOW_STATES
)  # fmt: skip
"""The columns of the starts: states in the units of the channels, covariances in SI with angles in radians."""


def window_columns(actuators: ship.Actuators) -> tuple[str, ...]:
    """The columns of the long table of windows; where moving ones are kept too, ``held`` (bool) comes last."""
    return ("window", "second", *ship.trial_channel_names(actuators), "trial", "leg", "start")


@dataclass(frozen=True, slots=True, repr=False)
class HeldWindows(Result):
    """The kept windows and the count of all candidates.

    ``rows`` has one row for each window and second: ``window`` (unique number), ``second`` 0 to the horizon,
    the channels, ``trial``, ``leg`` and ``start`` (UTC time of second 0). ``candidates`` equals ``kept`` plus
    all of ``dropped``. ``starts`` has one row for each window, see
    :func:`seatrial.analysis.windows.held.add_start_states`. ``provenance`` is by trial
    (:func:`seatrial.analysis.tables.table.provenance_of`).
    """

    rows: pd.DataFrame
    candidates: int
    kept: int
    dropped: dict[str, int]
    horizon_s: int = 15
    stride_s: int = 5
    starts: pd.DataFrame | None = None
    provenance: Mapping[str, Any] = field(default_factory=dict)
    view = "seatrial.analysis.report.plots:windows_view"
    drawing = "seatrial.analysis.report.plots:draw_windows"
    size_inch = (7.0, 7.0)

    def to_frame(self) -> pd.DataFrame:
        """One row a second of each window."""
        return self.rows

    def to_xarray(self) -> Dataset:
        """The channels [window, second], with trial, leg and start (UTC) of each window as coordinates.

        ``attrs`` holds the run sheets of the trials as JSON text. Raises :class:`ConfigurationError` without
        xarray.
        """
        firsts = self.rows[self.rows["second"] == 0]
        shape = (len(firsts), self.horizon_s + 1)
        places = [name for name in ("trial", "leg", "held") if name in self.rows]
        channels = [name for name in self.rows if name not in ("window", "second", "start", *places)]
        trials = {trial: stated.get("trial", {}) for trial, stated in self.provenance.items()}
        return export.as_dataset(
            {str(name): (("window", "second"), self.rows[name].to_numpy().reshape(shape)) for name in channels},
            {
                "window": firsts["window"].to_numpy(),
                "second": np.arange(shape[1]),
                "start": ("window", firsts["start"].dt.tz_convert(None).to_numpy()),
                **{name: ("window", firsts[name].to_numpy()) for name in places},
            },
            {"horizon_s": self.horizon_s, "stride_s": self.stride_s, "trials": json.dumps(trials)},
        )

    @property
    def leg_count(self) -> int:
        """The number of legs among the kept windows."""
        return int(self.rows["leg"].nunique())

    @property
    def moving_count(self) -> int:
        """The number of kept windows in which a thruster moved: 0 unless they were asked for."""
        if "held" not in self.rows:
            return 0
        return int((~self.rows.loc[self.rows["second"] == 0, "held"]).sum())


def held_windows(
    table: pd.DataFrame, horizon_s: int = 15, stride_s: int = 5, trial: str = "trial", *, keep_moving: bool = False
) -> HeldWindows:
    """The held windows of a table of one row a second, as :func:`seatrial.analysis.tables.resample.resample` gives
    it.

    ``trial`` names the recording; windows and legs carry it. With ``keep_moving`` windows in which only a
    thruster moved are kept too, and distinguished by a column ``held``; legs are then as long as windows follow
    each other without a break. A table shorter than the horizon has no candidates; one without wind is taken as of
    a calm. Raises :class:`InputError` for a table that lacks channels or is not on whole seconds.
    """
    if horizon_s < 2 or stride_s < 1:
        fix = "give a horizon of at least 2 s and a stride of at least 1 s"
        raise InputError(f"a horizon of {horizon_s} s every {stride_s} s is not possible", fix=fix)
    actuators, table = tables.table_actuators(table), tables.with_calm(table)
    tables.require_actuators(table, actuators)
    names = ship.trial_channel_names(actuators)
    time_ns, values, present = _every_second(table, names)
    reason = np.empty(0, dtype=np.int64)
    if time_ns.size > horizon_s:
        not_free = situations.not_free_at(time_ns, situations.find_situations(table))
        reason = _reason_numbers(values, actuators, present, not_free, horizon_s + 1, stride_s)
    is_held = reason == len(REASONS)
    selected = is_held | np.isin(reason, [REASONS.index(name) for name in MOVED]) if keep_moving else is_held
    counts = np.bincount(reason[~selected], minlength=len(REASONS))
    dropped = {name: int(times) for name, times in zip(REASONS, counts, strict=True) if times}

    starts = np.flatnonzero(selected).astype(np.int64) * stride_s
    legs = _leg_numbers(values, actuators, starts, horizon_s, stride_s)
    second = np.arange(horizon_s + 1, dtype=np.int64)
    row = (starts[:, None] + second).ravel()
    leg_names = pd.array([f"{trial}/{number + 1:03d}" for number in range(legs.max(initial=-1) + 1)], dtype="str")
    columns = {
        "window": np.repeat(np.arange(starts.size, dtype=np.int64), second.size),
        "second": np.tile(second, starts.size),
        **dict(zip(names, values[row].T, strict=True)),
        "trial": pd.array([trial], dtype="str").take(np.zeros(row.size, dtype=np.int64)),
        "leg": leg_names.take(np.repeat(legs, second.size)),
        "start": tables.index_of(np.repeat(time_ns[starts], second.size)),
    }
    rows = pd.DataFrame(columns, columns=list(window_columns(actuators)))
    rows.attrs.update(tables.actuator_attributes(actuators))
    if keep_moving:
        rows = rows.assign(held=np.repeat(is_held[selected], second.size))
    return HeldWindows(rows, int(reason.size), int(starts.size), dropped, horizon_s, stride_s)


def _every_second(table: pd.DataFrame, names: tuple[str, ...]) -> tuple[Ints, Floats, Bools]:
    """Times [s], values of the channels [s, channels] and where the table has a row, without holes in time."""
    missing = [name for name in names if name not in table.columns]
    if missing:
        fix = "record the channel, or import with a map that gives it a constant"
        if derivable := [name for name in missing if name in ship.VELOCITY]:
            derive = f"derive = {json.dumps(derivable)}"
            fix = f"record the channel, or import with {derive} in the column map, from positions and heading"
        raise InputError(f"has no {', '.join(missing)}", where=str(table.attrs.get("recording", "table")), fix=fix)
    time_ns = tables.times_ns(table)
    if time_ns.size == 0:
        return np.empty(0, dtype=np.int64), np.empty((0, len(names))), np.empty(0, dtype=bool)
    row = (time_ns - time_ns[0]) // tables.NANO
    if np.any(time_ns % tables.NANO != 0) or np.any(np.diff(row) <= 0):
        fix = "resample it to 1 Hz first"
        raise InputError("the table does not have one row per second, in order and on whole seconds", fix=fix)
    values = np.full((int(row[-1]) + 1, len(names)), np.nan)
    values[row] = table[list(names)].to_numpy(dtype=float)
    present = np.zeros(values.shape[0], dtype=bool)
    present[row] = True
    return time_ns[0] + np.arange(values.shape[0], dtype=np.int64) * tables.NANO, values, present


def _reason_numbers(
    values: Floats, actuators: ship.Actuators, present: Bools, not_free: Bools, rows: int, stride: int
) -> Ints:
    """For each candidate the index of the first of :data:`REASONS` that applies, their number if none does;
    ``not_free`` [kinds, rows] is where the ship is held or towed."""

    def in_all_rows(flag: Bools) -> Bools:
        return np.asarray(sliding_window_view(flag, rows)[::stride].all(axis=1))

    valid = np.isfinite(values)
    steady = {sort: np.ones(len(in_all_rows(present)), dtype=bool) for sort in _MOVED}
    for name, series in zip(ship.control_names(actuators), values[:, len(ship.MOTION) :].T, strict=True):
        steady[sort_of(name, actuators)] &= steady_mask(name, series, rows, stride, actuators)
    passed = (
        in_all_rows(np.asarray(present & valid.any(axis=1))),
        in_all_rows(np.asarray(valid.all(axis=1))),
        in_all_rows(~near_jumps(values)),
        *(in_all_rows(~kind_rows) for kind_rows in not_free),
        *steady.values(),
    )
    failed = ~np.stack([*passed, np.zeros_like(passed[0])], axis=1)
    return np.asarray(failed.argmax(axis=1), dtype=np.int64)


def near_jumps(values: Floats) -> Bools:
    """Mask of the seconds [rows] at which the positions of a trial [rows, channels] jump, or within reach of a
    filter.

    Steps are compared with the mean speeds; their scatter is estimated by medians.
    """
    north_m, east_m, heading_deg, surge_mps, sway_mps = values[:, :5].T
    speed = np.column_stack(to_earth(surge_mps, sway_mps, np.deg2rad(heading_deg)))
    moved = np.diff(np.column_stack([north_m, east_m]), axis=0)
    deviation = moved - 0.5 * (speed[1:] + speed[:-1])
    if not np.isfinite(deviation).all(axis=1).any():
        return np.zeros(len(values), dtype=bool)
    # a speed through the water always differs by the current
    residual_m = np.hypot(*(deviation - np.nanmedian(deviation, axis=0)).T)
    limit_m = _JUMP_M + _JUMP_DEVIATIONS * 1.48 * np.nanmedian(residual_m)
    jumped = np.flatnonzero(np.nan_to_num(residual_m) > limit_m)
    near_jump = np.zeros(len(values), dtype=bool)
    for row in jumped:
        near_jump[max(0, row - MOTION_FILTER.reach + 1) : row + 1 + MOTION_FILTER.reach] = True
    return near_jump


def _leg_numbers(values: Floats, actuators: ship.Actuators, starts: Ints, horizon_s: int, stride_s: int) -> Ints:
    """The number of the leg of each window.

    A window continues the leg of the one before it if the two share a second, or if it starts within a
    stride after the other's end at the same setting.
    """
    if starts.size == 0:
        return np.empty(0, dtype=np.int64)
    names, settings = ship.control_names(actuators), values[:, len(ship.MOTION) :]
    setting = settings[starts[:, None] + np.arange(horizon_s + 1)]
    change = np.abs(np.diff(np.median(setting, axis=1), axis=0))
    for column, name in enumerate(names):
        if ship.is_circular(name):
            middle = setting[:, 0, column] + np.median(
                ship.angle_difference(setting[:, :, column], setting[:, :1, column]), axis=1
            )
            change[:, column] = np.abs(ship.angle_difference(middle[1:], middle[:-1]))
    limit = np.array(
        [
            tolerance_of(name, actuators).for_values(series).span
            for name, series in zip(names, settings.T, strict=True)
        ]
    )
    between = starts[1:] - (starts[:-1] + horizon_s)
    same_leg = (between <= 0) | ((between <= stride_s) & (change <= limit).all(axis=1))
    return np.concatenate([[0], np.cumsum(~same_leg)])


def held_spans_ns(windows: pd.DataFrame) -> Ints:
    """Begin and end of every stretch of held windows that overlap or touch: [stretches, 2], ns since 1970."""
    held = windows[windows["held"]] if "held" in windows else windows
    begin = np.sort(pd.DatetimeIndex(held.groupby("window")["start"].first()).as_unit("ns").asi8)
    end = begin + (int(held["second"].max()) if begin.size else 0) * tables.NANO
    new = np.append(True, begin[1:] > end[:-1])[: begin.size]
    return np.column_stack([begin[new], end[np.append(new[1:], True)[: begin.size]]])


def join_windows(parts: Sequence[HeldWindows]) -> HeldWindows:
    """The windows of several recordings in one, with window numbers that are unique across them.

    Raises :class:`InputError` when two recordings have one name or different horizons.
    """
    names = [str(name) for part in parts for name in part.rows["trial"].unique()]
    if len(set(names)) < len(names):
        raise InputError("two recordings have the same name", fix="name each recording's trial differently")
    if len({part.horizon_s for part in parts}) != 1:
        raise InputError("windows of different horizons cannot be joined", fix="use one horizon")
    offset, frames, dropped = 0, [], dict[str, int]()
    for part in parts:
        frames.append(part.rows.assign(window=part.rows["window"] + offset))
        offset += part.kept
        for reason, times in part.dropped.items():
            dropped[reason] = dropped.get(reason, 0) + times
    if len({tuple(frame.columns) for frame in frames}) > 1:
        raise InputError("windows of ships with different actuators cannot be joined", fix="take one ship's trials")
    rows = pd.concat([frame for frame in frames if len(frame)] or frames[:1], ignore_index=True)
    ordered = {reason: dropped[reason] for reason in REASONS if reason in dropped}
    candidates = sum(part.candidates for part in parts)
    return HeldWindows(rows, candidates, offset, ordered, parts[0].horizon_s, parts[0].stride_s)


def require_windows(windows: HeldWindows, where: str) -> HeldWindows:
    """Return the windows. Raises :class:`DataShortageError` with the counts by reason if there are none."""
    if windows.kept:
        return windows
    reasons = ", ".join(f"{times} {reason.replace('_', ' ')}" for reason, times in windows.dropped.items())
    sort, fix = "held window (steady controls)", "use every window, with its controls, by --any; or lower --horizon"
    if "held" in windows.rows or not windows.candidates:
        sort = "whole window" if "held" in windows.rows else sort
        fix = "lower --horizon, or give recordings with longer stretches"
    what = f"none of {windows.candidates} candidates of {windows.horizon_s} s is a {sort}"
    raise DataShortageError(what, where=where, why=reasons or "shorter than the horizon", fix=fix)


@dataclass(frozen=True, slots=True)
class Tolerance:
    """The allowed variation of a held setting without noise, in the channel's unit, and the largest noise.

    ``noise`` bounds the standard deviation: more than that is a handle being moved. For a setting that is
    usually larger than ``ordinary`` all three grow in proportion.
    """

    span: float
    drift: float
    noise: float
    ordinary: float = np.inf

    def bound_factor(self, values: Floats) -> float:
        """The factor on the bounds for a setting with these ``values`` [rows], from its 98th percentile."""
        size = np.abs(values[np.isfinite(values)])
        return max(1.0, float(np.quantile(size, 0.98)) / self.ordinary) if size.size else 1.0

    def for_values(self, values: Floats) -> Tolerance:
        """The tolerance of a setting with these ``values`` [rows]."""
        factor = self.bound_factor(values)
        return Tolerance(factor * self.span, factor * self.drift, factor * self.noise, self.ordinary)


TOLERANCES: dict[Sort, Tolerance] = {
    "azimuth": Tolerance(span=2.0, drift=1.0, noise=2.0),
    "shaft": Tolerance(span=3.0, drift=1.5, noise=4.0, ordinary=240.0),
    "tunnel": Tolerance(span=10.0, drift=5.0, noise=10.0, ordinary=500.0),
    "rudder": Tolerance(span=2.0, drift=1.0, noise=1.0),
    "nozzle": Tolerance(span=2.0, drift=1.0, noise=1.0),
    "pitch": Tolerance(span=2.0, drift=1.0, noise=2.0),
}
"""The tolerance of each sort of setting: 3 rpm of 240 are a fortieth of the thrust, and so, nearly, are 2 % of
pitch."""


@dataclass(frozen=True, slots=True)
class Feedback:
    """The noise on a setting's feedback: its standard deviation, and whether it is correlated."""

    noise: float
    filtered: bool


def feedback_of(values: Floats, most: float = np.inf) -> Feedback:
    """The noise on a series that may have been filtered, at most ``most``; see :func:`noise_standard_deviation`."""
    noise, wide_noise = (
        motion_model.noise_standard_deviation(values),
        motion_model.noise_standard_deviation(values, 2),
    )
    if wide_noise <= _FILTERED_RATIO * noise:
        return Feedback(min(noise, most), False)
    _, _, second, _, fourth = _noise_correlation(5)
    return Feedback(min(wide_noise / float(np.sqrt(1.0 - 4.0 / 3.0 * second + fourth / 3.0)), most), True)


def _noise_correlation(rows: int) -> Floats:
    """The correlation of filtered noise 0, 1, 2 .. rows apart [rows], from the filter's weights."""
    parts = 50
    offset = np.arange(-SETTING_FILTER.reach * parts, SETTING_FILTER.reach * parts + 1) / parts
    weight = (0.5 + 0.5 * np.cos(np.pi * offset / SETTING_FILTER.reach)) ** SETTING_FILTER.taper
    product = np.correlate(weight, weight, "full")[weight.size - 1 :: parts]
    result = np.zeros(max(rows, product.size))
    result[: product.size] = product / product[0]
    return result[:rows]


def steady_mask(
    name: str, values: Floats, rows: int, stride: int, actuators: ship.Actuators = ship.DEFAULT
) -> Bools:
    """Mask of the candidate windows of ``rows`` values, every ``stride`` values, in which the setting is held.

    ``name`` is a control channel of a ship with these ``actuators``; a window with a NaN is not held.
    """
    series = ship.unwrap(values) if ship.is_circular(name) else values
    base = tolerance_of(name, actuators)
    tolerance = base.for_values(series)
    feedback = feedback_of(series, tolerance.noise)
    windows = sliding_window_view(series, rows)[::stride]
    centred = np.arange(rows) - (rows - 1) / 2.0
    rise_weights = np.asarray(centred / (centred @ centred) * (rows - 1))  # of the least-squares line
    span = windows.max(axis=1) - windows.min(axis=1)
    drift = (windows - windows[:, :1]) @ rise_weights
    span_limit = tolerance.span + SPAN_SIGMAS * feedback.noise
    correlation = _noise_correlation(rows) if feedback.filtered else np.eye(1, rows)[0]
    lag = np.abs(np.subtract.outer(np.arange(rows), np.arange(rows)))
    drift_noise = feedback.noise * float(np.sqrt((rise_weights @ correlation[lag] * rise_weights).sum()))
    drift_limit = np.hypot(tolerance.drift, DRIFT_SIGMAS * drift_noise)
    steady = (span <= span_limit) & (np.abs(drift) <= drift_limit)
    if name.endswith("_rpm"):
        factor = base.bound_factor(series)
        idle = np.abs(windows).max(axis=1) <= factor * IDLE_RPM
        steady |= idle & (np.abs(drift) <= factor * IDLE_DRIFT_RPM)
    return np.asarray(steady)


def sort_of(name: str, actuators: ship.Actuators) -> Sort:
    """The sort of setting of a control channel, by its actuator's kind: an azimuth, a rudder, a shaft ...

    Raises :class:`KeyError` for a channel that is no control of the ship.
    """
    sort: Sort = ship.control_kind_of_channel(name, actuators).removesuffix(" thruster")  # type: ignore[assignment]
    return sort


def tolerance_of(name: str, actuators: ship.Actuators = ship.DEFAULT) -> Tolerance:
    """The tolerance that is stated for a control channel of a ship with these actuators."""
    return TOLERANCES[sort_of(name, actuators)]


@dataclass(frozen=True, slots=True)
class OneHertzTables:
    """A recording at 1 Hz: ``table`` with two-sided resampling, ``newest`` with its rows as they were known 0,
    1, ... seconds later.

    A channel recorded more often than once a second is filtered, by samples of the seconds on either side.
    """

    table: pd.DataFrame
    newest: tuple[pd.DataFrame, ...] = ()


def second_by_second(resampled: Callable[..., pd.DataFrame]) -> OneHertzTables:
    """Samples at 1 Hz by one of the functions of :mod:`seatrial.analysis.tables.resample`, its samples given.

    Where no wind was recorded, they are of a calm, which is reported.
    """
    newest = (tables.with_calm(resampled(lookahead_steps=seconds)) for seconds in range(MOTION_FILTER.reach))
    table = tables.with_calm(resampled())
    tables.warn_of_calm(table)
    return OneHertzTables(table, tuple(newest))


def tables_of_recordings(
    paths: Sequence[Path],
    progress: Callable[[float], None] = lambda _: None,
    time_range: tuple[float, float] = (0.0, 100.0),
    *,
    repair: bool = False,
    rebuild_positions: bool = False,
) -> dict[str, OneHertzTables]:
    """Recordings, or a part of each one's time, at 1 Hz, by the trial's name, which is the first file's.

    ``repair`` first corrects faults that a check of the whole recording is certain of, ``rebuild_positions``
    the positions as well (:func:`seatrial.analysis.quality.repairs.prepare_table`).
    """
    by_trial = {}
    recordings = named_recordings(paths)
    for number, (trial, parts) in enumerate(recordings.items()):
        recording = read_parts_of_recording(parts)
        if repair:
            prepared = prepare_table(recording, Preparation(repair=True), rebuild_positions=rebuild_positions)
            by_trial[trial] = second_by_second(partial(resample, tables.select(prepared, time_range)))
        else:
            by_trial[trial] = second_by_second(partial(resample_recording, recording, time_range=time_range))
        progress((number + 1) / len(recordings))
    return by_trial


def named_recordings(paths: Sequence[Path]) -> dict[str, tuple[Path, ...]]:
    """The recordings in some files, each with its parts, by :func:`names_of_trials` of their first files."""
    recordings = parts_by_recording(map(Path, paths))
    return dict(zip(names_of_trials([parts[0] for parts in recordings]), recordings, strict=True))


def windows_of_tables(
    tables: Mapping[str, OneHertzTables], horizon_s: int = 15, stride_s: int = 5, *, keep_moving: bool = False
) -> HeldWindows:
    """The held windows of 1 Hz tables by trial, joined; with ``keep_moving`` all windows that have data.

    Raises :class:`DataShortageError` with the counts by reason when there is none in any of them.
    """
    parts = [
        held_windows(sampled.table, horizon_s, stride_s, trial=trial, keep_moving=keep_moving)
        for trial, sampled in tables.items()
    ]
    return require_windows(join_windows(parts), ", ".join(tables))


def names_of_trials(paths: Sequence[Path]) -> list[str]:
    """The files' names without suffix, numbered where files in different folders are called the same."""
    stems = [printable_path(Path(path).stem) for path in paths]
    unique = {stem for stem in stems if stems.count(stem) == 1}
    names, taken = [], set(unique)
    for stem in stems:
        if stem not in unique:
            stem = next(name for name in (f"{stem}-{number}" for number in count(1)) if name not in taken)
            taken.add(stem)
        names.append(stem)
    return names


@dataclass(frozen=True, slots=True)
class WindowOptions:
    """Options for extracting windows from recordings.

    ``keep_moving`` keeps those in which a thruster moved; ``repair`` and ``remove_delays`` first correct faults
    that a check is certain of, ``rebuild_positions`` the positions as well; ``starts`` adds start states.
    """

    horizon_s: int = 15
    stride_s: int = 5
    keep_moving: bool = False
    repair: bool = False
    remove_delays: bool = False
    starts: bool = True
    rebuild_positions: bool = False


def add_start_states(windows: HeldWindows, motion: Mapping[str, smoother.SmoothedMotion]) -> HeldWindows:
    """The windows with ``starts``, from the smoothed motion of each of their trials at whole seconds.

    One row a window in the order of their numbers; NaN where the motion has no estimate.
    """
    first, parts = windows.rows.loc[windows.rows["second"] == 0, ["window", "trial", "leg", "start"]], []
    for trial, smoothed in motion.items():
        window_starts = first[first["trial"] == trial]
        columns = (
            smoothed.states[list(ship.POSE_AND_VELOCITY)],
            smoothed.covariance_columns(),
            smoothed.slow[list(ship.POSE_AND_VELOCITY)].set_axis(list(SLOW_STATES), axis=1),
        )
        at = pd.DatetimeIndex(window_starts["start"])
        values = [frame.reindex(at).reset_index(drop=True) for frame in columns]
        parts.append(pd.concat([window_starts.reset_index(drop=True), *values], axis=1)[list(START_COLUMNS)])
    filled = [part for part in parts if len(part)] or parts[:1]
    starts = pd.concat(filled).sort_values("window", ignore_index=True) if filled else None
    return replace(windows, starts=starts)


def windows_of_recordings(
    paths: Sequence[Path], options: WindowOptions | None = None, progress: Callable[[float], None] = lambda _: None
) -> HeldWindows:
    """The windows of recordings, by the trial's name, which is the file's, with their starts.

    Raises :class:`DataShortageError` with the counts by reason when no window is held in any of them, and
    :class:`InputError` when one recording is given twice.
    """
    options = options or WindowOptions()
    tables.hash_distinct_files(paths)  # refuses one that is given twice
    pieces, motion, provenance, recordings = [], {}, {}, named_recordings(paths)
    simple = not (options.starts or options.repair or options.remove_delays)
    rate_hz = 1.0 if simple else None
    preparation = Preparation(rate_hz, repair=options.repair, remove_delays=options.remove_delays)
    for number, (trial, parts) in enumerate(recordings.items()):
        table = prepare_table(
            read_parts_of_recording(parts), preparation, rebuild_positions=options.rebuild_positions
        )
        seconds = tables.with_calm(table if simple else resample(table, 1.0))
        tables.warn_of_calm(seconds)
        pieces.append(
            held_windows(seconds, options.horizon_s, options.stride_s, trial=trial, keep_moving=options.keep_moving)
        )
        provenance[trial] = tables.provenance_of(seconds, asdict(options), parts[0])
        if options.starts and pieces[-1].kept:
            motion[trial] = smoother.smooth(table, 1.0)
        progress((number + 1) / len(recordings))
    windows = replace(require_windows(join_windows(pieces), ", ".join(recordings)), provenance=provenance)
    return add_start_states(windows, motion) if options.starts else windows


def write_windows(windows: HeldWindows, path: Path | str) -> None:
    """Write the windows as Parquet, the account of the candidates and their provenance in the file's metadata.

    Their starts, if they have them, go into ``<name>.starts.parquet`` in the same folder. Raises
    :class:`seatrial.acquisition.core.errors.StorageError` when a file cannot be written.
    """
    account = {key: getattr(windows, key) for key in ("candidates", "kept", "dropped", "horizon_s", "stride_s")}
    units = {name: ship.BY_NAME[name].unit for name in tables.trial_channels(windows.rows)} | {"second": "s"}
    provenance = {"provenance": json.dumps(windows.provenance)}
    attributes = tables.actuator_attributes(tables.table_actuators(windows.rows)).get("trial", {})
    states = {f"{kind}{name}": unit for name, unit in units.items() for kind in ("", "slow_")}
    with files.written_together(Path(path)):
        if windows.starts is not None:
            metadata = {"covariance": "SI, angles in radians", **provenance}
            export.write_parquet(windows.starts, starts_path(path), states, metadata)
        export.write_parquet(
            windows.rows, path, units, {"windows": json.dumps(account), **provenance, **attributes}
        )


def starts_path(path: Path | str) -> Path:
    """The path of the start states of windows written to ``path``."""
    return Path(path).with_suffix(".starts.parquet")


def read_windows(path: Path | str) -> HeldWindows:
    """Read what :func:`write_windows` wrote. Raises :class:`InputError` for any other file."""
    rows, metadata = export.read_parquet(path)
    actuators = (
        ship.parse_actuators(metadata["actuators"]) if "actuators" in metadata else tables.table_actuators(rows)
    )
    columns = window_columns(actuators)
    if "windows" not in metadata or set(columns) - set(rows.columns):
        raise InputError("contains no windows", where=str(path), fix="make one with `seatrial windows`")
    rows.attrs.update(tables.actuator_attributes(actuators))
    names = [*columns, *(["held"] if "held" in rows else [])]
    try:
        account, provenance = (files.parse_json(metadata.get(name, "{}")) for name in ("windows", "provenance"))
        starts = None
        if starts_path(path).is_file():
            starts, _ = export.read_parquet(starts_path(path))
            first, keys = rows.loc[rows["second"] == 0], ["window", "trial", "start"]
            same = set(keys) <= set(starts.columns) and len(first) == len(starts)
            if not (same and all((first[key].to_numpy() == starts[key].to_numpy()).all() for key in keys)):
                starts = None  # they belong to other windows
        return HeldWindows(rows[names], **account, starts=starts, provenance=provenance)
    except (ValueError, TypeError) as error:
        raise InputError("was not written by this version", where=str(path), why=str(error),
                         fix="run `seatrial windows` again") from error  # fmt: skip
