"""The log of a trial: one row a second of measurements, and the controls and wind between the rows.

A measured value is the mean of all samples within half a second, and the model's mean is taken at the same
times, so neither the rate of a recording nor the curvature of the motion matters. Outlying samples are
rejected. The smoothed motion is only the first linearisation: it need not be exact, just close. Everything
recorded is used, not only windows with steady thrusters, which hide inertia and lags.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, get_args

import numpy as np
import pandas as pd
from numpy.lib.stride_tricks import sliding_window_view
from scipy.interpolate import CubicHermiteSpline
from scipy.ndimage import median_filter

from seatrial.acquisition.core import errors, ship
from seatrial.acquisition.core.quantities import Bools, Floats, Ints, integrate, to_earth
from seatrial.analysis.estimation.motion_model import NoiseLevels
from seatrial.analysis.estimation.smoother import smooth
from seatrial.analysis.series import edges_of_runs, robust_spread
from seatrial.analysis.speed_power.runs import power_columns, power_kw
from seatrial.analysis.tables.table import (
    NANO,
    require,
    table_actuators,
    table_controls,
    times_ns,
    with_order_of_actuators,
)
from seatrial.hybrid.vessel.actuators import control_units
from seatrial.hybrid.vessel.sensors import STATE_UNITS, states_of

BLOCK_S = 60
"""Length of a block [s], which starts from an unknown state; longer blocks gain nothing measurable."""

LEG_S = 180
"""Length of a leg [s]: the blocks that are held out together."""

_SHORTEST_BLOCK_S = 12
_LONGEST_BREAK_S = 60
_ARRAYS = ("measured", "weight", "nominal", "controls", "wind", "time_s", "block", "leg", "recording")

STEPS_PER_SECOND = 4
"""Thruster settings are averaged over quarters of a second, the longest step of the simulator, or over half or a
quarter of that for a craft that sails her length in little more than a second."""
_MOST_DOUBLED = 2
# A catamaran of 2 m at 2.3 m/s whose propellers are switched to and fro was predicted over 15 s to 0.155 m in steps
# of 0.29 of the time in which she sails her length, to 0.035 m and less in steps of 0.07.
_STEP_LENGTHS = 0.08
_WHOLE = 1e-6  # what a number of steps may be off a whole one by rounding

InputHold = Literal["line", "until the next record", "since the last record"]
"""Interpolation of settings between records: linear, previous value held, or next value already acting."""

INPUT_HOLDS: tuple[InputHold, ...] = get_args(InputHold)
_LONGEST_GAP_S = 1.2  # of a setting, unless it is recorded less often: what moved meanwhile is unknown
_GAP_STEPS = 2.5
SELDOM_S = 0.3  # between samples of a setting: beyond this the interpolation matters
_THRUST = re.compile(r"(?:(?P<shaft>\w+)_)?shaft_thrust_(?P<unit>n|kn)")
_NEWTONS = {"n": 1.0, "kn": 1e3}
_CURRENT = ("current_speed_mps", "current_direction_deg")
_BENDS = 3.0  # times the usual second difference: five standard deviations of white noise
_OUTLIER = 6.0


@dataclass(frozen=True, slots=True, eq=False)
class Log:
    """T seconds of one or more trials, in blocks of consecutive seconds.

    ``measured`` [T, 6] is the mean of the reported state at the sampling times, NaN without samples; ``weight``
    [T, 6, S + 1] gives these times, as weights of the S steps of a second from half a second before to half a
    second after; ``nominal`` [T, 6] is the smoothed state; ``controls`` [T, S, controls] and ``wind`` [T, 2]
    (direction FROM [rad], speed [m/s]) act in the second that follows; ``time_s`` [T] is UTC since 1970.
    ``block`` and ``leg`` [T] count from 0; ``recording`` [T] numbers the recordings ``names``. All SI, angles
    in radians, heading unwrapped. ``refused`` counts rejected outliers, ``setting_step_s`` is the interval at
    which thruster settings were recorded, ``input_hold`` the interpolation between them, ``held`` the controls
    under other holds; ``levels`` are the smoother's noise levels in the first recording. ``cut_from`` is the log
    that this is a part of, with the rows: what acts depends on what was before. ``meters`` are what was measured
    besides, NaN where it was not: ``thrust`` [N] and ``shaft_power`` [W] of each shaft [T, actuators],
    ``total_power`` of all [T, 1], ``water_speed`` [T, 1] along the ship [m/s], ``current`` [T, 2] to north and to
    east [m/s].
    """

    measured: Floats
    weight: Floats
    nominal: Floats
    controls: Floats
    wind: Floats
    time_s: Ints
    block: Ints
    leg: Ints
    recording: Ints
    actuators: ship.Actuators
    refused: int = 0
    setting_step_s: float = 0.1
    levels: NoiseLevels | None = None
    input_hold: InputHold = "line"
    held: Mapping[InputHold, Floats] = field(default_factory=dict)
    names: tuple[str, ...] = ()
    cut_from: tuple[Log, Ints] | None = None
    meters: Mapping[str, Floats] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.time_s)

    @property
    def steps_per_second(self) -> int:
        """In how many steps the motion within a second is followed."""
        return int(self.controls.shape[1])

    @property
    def block_edges(self) -> Ints:
        """The first row of each block, and the end of the last: [blocks + 1]."""
        starts = np.flatnonzero(np.diff(self.block, prepend=-1))
        return np.append(starts, len(self)).astype(np.int64)

    @property
    def leg_count(self) -> int:
        """The number of legs."""
        return int(self.leg.max()) + 1

    def subset(self, rows: Bools) -> Log:
        """The blocks of this log whose rows are chosen."""
        chosen = {name: getattr(self, name)[rows] for name in _ARRAYS}
        for name in ("block", "leg"):
            chosen[name] = np.unique(chosen[name], return_inverse=True)[1].astype(np.int64)
        held = {name: controls[rows] for name, controls in self.held.items()}
        parent, places = self.cut_from or (self, np.arange(len(self)))
        meters = {name: values[rows] for name, values in self.meters.items()}
        return replace(self, held=held, cut_from=(parent, places[rows]), meters=meters, **chosen)

    def mask_of_spread_blocks(self, seconds: float) -> Bools:
        """A mask of whole blocks, spread evenly over the log, ``seconds`` in all."""
        blocks = int(self.block.max()) + 1
        wanted = min(blocks, max(1, round(seconds * blocks / len(self))))
        chosen = np.unique(np.linspace(0, blocks - 1, wanted).round().astype(int))
        return np.asarray(np.isin(self.block, chosen))

    def with_input_hold(self, hold: InputHold) -> Log:
        """The log with this interpolation of the thruster settings between records."""
        if hold == self.input_hold:
            return self
        cut_from = self.cut_from and (self.cut_from[0].with_input_hold(hold), self.cut_from[1])
        held = {**self.held, self.input_hold: self.controls}  # a second diagnosis begins at the hold of the first
        return replace(self, controls=held[hold], held=held, input_hold=hold, cut_from=cut_from)


def log_of(
    tables: Sequence[pd.DataFrame],
    length_m: float = np.inf,
    fixed_step_s: float | None = None,
    actuators: ship.Actuators | None = None,
) -> Log:
    """The log of tables of samples of one ship's channels, at any rate, with NaN where a channel has no sample.

    Controls are in the order of ``actuators``, a model's, or of the first table's.

    A second is followed in more steps the sooner she sails her length, and in whole steps of a simulator that
    integrates in ``fixed_step_s``. Wind that was not recorded counts as calm; tables with the same recording's name
    are parts of it. Raises :class:`InputError` for a table without position, heading or thrusters,
    :class:`DataShortageError` if no stretch is long enough, :class:`ConfigurationError` for a fixed step of which a
    second cannot be followed in whole ones.
    """
    order = table_actuators(tables[0]) if actuators is None else actuators
    tables = [with_order_of_actuators(table, order) for table in tables]
    for table in tables:
        require(table, (*ship.POSE, *ship.control_names(table_actuators(table))))
    complete = [
        table.assign(**dict.fromkeys((name for name in ship.VELOCITY if name not in table), np.nan))
        for table in tables
    ]
    smoothed = [smoothed_motion(table) for table in complete]
    steps = _steps_per_second(length_m, [motion for _, motion, *_ in smoothed])
    steps = steps if fixed_step_s is None else _steps_of_whole(fixed_step_s, steps)
    parts = [_log_of_motion(table, steps, *motion) for table, motion in zip(complete, smoothed, strict=True)]
    first_block, first_leg, logs = 0, 0, list[Log]()
    names = recording_names(tables)
    recordings = list(dict.fromkeys(names))
    for name, part in zip(names, parts, strict=True):
        if len(part):
            block, leg = part.block + first_block, part.leg + first_leg
            recording = np.full(len(part), recordings.index(name))
            logs.append(replace(part, recording=recording, block=block, leg=leg))
            first_block, first_leg = int(block.max()) + 1, int(leg.max()) + 1
    if not logs:
        raise errors.DataShortageError(
            f"no stretch of {_SHORTEST_BLOCK_S} s has motion and thrusters",
            where=", ".join(str(table.attrs.get("recording", "the table")) for table in tables),
            fix="check what is missing with `seatrial check`",
        )
    held = {hold: np.concatenate([log.held[hold] for log in logs]) for hold in INPUT_HOLDS[1:]}
    widths = {name: values.shape[1] for log in logs for name, values in log.meters.items()}
    meters = {
        name: np.concatenate([log.meters.get(name, np.full((len(log), width), np.nan)) for log in logs])
        for name, width in widths.items()
    }
    together: dict[str, Any] = {name: np.concatenate([getattr(log, name) for log in logs]) for name in _ARRAYS}
    return Log(
        **together,
        held=held,
        refused=sum(log.refused for log in logs),
        setting_step_s=max(log.setting_step_s for log in logs),
        levels=logs[0].levels,
        actuators=logs[0].actuators,
        names=tuple(recordings),
        meters=meters,
    )


def recording_names(tables: Sequence[pd.DataFrame]) -> list[str]:
    """The recording that each table is of, or a number where it names none."""
    return [str(table.attrs.get("recording", number)) for number, table in enumerate(tables)]


def join_tables(parts: Sequence[pd.DataFrame]) -> pd.DataFrame:
    """The table of a recording from its parts, with a gap between them."""
    table = pd.concat(parts)
    table.attrs = parts[0].attrs
    return table


def _steps_per_second(length_m: float, motions: Sequence[Floats]) -> int:
    """In how many steps a second is followed, by the speed [m/s] at which the ship usually sails."""
    speeds = np.concatenate([np.hypot(motion[:, 3], motion[:, 4]) for motion in motions])
    usual = float(np.nanmedian(speeds)) if np.isfinite(speeds).any() else 0.0
    wanted = usual / (_STEP_LENGTHS * length_m)
    doubled = int(np.clip(np.ceil(np.log2(max(wanted / STEPS_PER_SECOND, 1.0))), 0, _MOST_DOUBLED))
    return int(STEPS_PER_SECOND * 2**doubled)


def _steps_of_whole(fixed_step_s: float, least: int) -> int:
    """In how many steps a second is followed, an even number of ``least`` or more, if each is so many whole ones of
    a simulator. Raises :class:`ConfigurationError` where none is."""
    for steps in range(least, STEPS_PER_SECOND * 2**_MOST_DOUBLED + 1, 2):
        whole = 1.0 / (steps * fixed_step_s)
        if abs(whole - max(1, round(whole))) < _WHOLE:
            return steps
    raise errors.ConfigurationError(
        f"integrates in steps of {fixed_step_s:g} s, in which a second cannot be followed", where="the simulator",
        fix=f"export it with a step that divides 1/{least} s, such as {0.2 / least:g} s",
    )  # fmt: skip


def _log_of_motion(
    table: pd.DataFrame, steps: int, seconds: Ints, motion: Floats, slopes: Floats, levels: NoiseLevels
) -> Log:
    actuators = table_actuators(table)
    measured, weight, refused = averaged_motion(table, seconds, motion, slopes, steps)
    controls = mean_settings(table, seconds, steps=steps)
    usable = np.asarray(np.isfinite(motion).all(axis=1) & np.isfinite(controls).all(axis=(1, 2)))
    block, leg = _blocks_and_legs(usable, seconds)
    rows = block >= 0
    settings = {hold: mean_settings(table, seconds, hold, steps) for hold in INPUT_HOLDS[1:]}
    held = {hold: np.where(np.isfinite(values), values, controls)[rows] for hold, values in settings.items()}
    meters = {name: values[rows] for name, values in mean_meters(table, seconds).items()}
    return Log(
        measured[rows], weight[rows], motion[rows], controls[rows], mean_wind(table, seconds)[rows], seconds[rows],
        block[rows], leg[rows], np.zeros(int(rows.sum()), dtype=np.int64), actuators, refused,
        setting_step_s(table), levels, held=held, meters=meters,
    )  # fmt: skip


def _blocks_and_legs(usable: Bools, seconds: Ints) -> tuple[Ints, Ints]:
    """The block and the leg of each second, -1 outside.

    Blocks are even parts of usable stretches, of about :data:`BLOCK_S`; legs are consecutive blocks, never across
    a long gap.
    """
    block, leg = np.full((2, len(usable)), -1, dtype=np.int64)
    blocks, legs, length, before = 0, 0, np.inf, 0
    for first, last in zip(*edges_of_runs(usable), strict=True):
        if last - first < _SHORTEST_BLOCK_S:
            continue
        pieces = max(1, round((last - first) / BLOCK_S))
        cuts = np.linspace(first, last, pieces + 1).round().astype(int)
        for a, b in itertools.pairwise(cuts):
            if length >= LEG_S - 0.5 * (b - a) or seconds[a] - before > _LONGEST_BREAK_S:
                legs, length = legs + 1, 0
            block[a:b], leg[a:b] = blocks, legs - 1
            blocks, length, before = blocks + 1, length + (b - a), int(seconds[b - 1])
    return block, leg


def smoothed_motion(table: pd.DataFrame) -> tuple[Ints, Floats, Floats, NoiseLevels]:
    """The motion without waves at full seconds: times [s], states and their rates [T, 6], and the noise levels."""
    motion = table[list(ship.POSE_AND_VELOCITY)].dropna(how="all")
    half = times_ns(motion) // (NANO // 2)
    if np.unique(half).size <= 0.7 * len(motion):  # two rows a second are enough for smoothing, and fast
        columns = motion.assign(
            **{name: ship.unwrap(motion[name]) for name in ship.CIRCULAR.intersection(ship.POSE_AND_VELOCITY)}
        )
        columns["time"] = times_ns(motion)
        middles = columns.groupby(half).median()  # robust against an outlier among several samples
        motion = pd.DataFrame({name: middles[name].to_numpy() for name in ship.POSE_AND_VELOCITY})
        motion["heading_deg"] %= 360.0
        times = pd.to_datetime(middles["time"].to_numpy().astype(np.int64), utc=True)
        motion.index = pd.DatetimeIndex(times, name="time")
        motion.attrs = table.attrs
    smoothed = smooth(motion, 1.0)
    slow = smoothed.slow
    seconds = (times_ns(slow) // NANO).astype(np.int64)
    states = states_of(slow)
    psi, u, v, r = states[:, 2:].T
    accelerations = slow[["surge_mps2", "sway_mps2", "yaw_dps2"]].to_numpy(dtype=float)
    slopes = np.column_stack([*to_earth(u, v, psi), r, accelerations * [1.0, 1.0, np.pi / 180.0]])
    return seconds, states, slopes, smoothed.noise


def averaged_motion(
    table: pd.DataFrame, seconds: Ints, motion: Floats, slopes: Floats, steps: int = STEPS_PER_SECOND
) -> tuple[Floats, Floats, int]:
    """The mean measured state of each second [T, 6], its weights [T, 6, steps + 1], and how many samples were
    rejected."""
    nodes = (seconds - seconds[0]).astype(float)
    measured, refused, count = np.full_like(motion, np.nan), 0, len(nodes)
    weight = np.zeros((*motion.shape, steps + 1))
    finite = np.isfinite(motion).all(axis=1)
    if finite.sum() < 2:
        return measured, weight, 0
    stamps = (times_ns(table) - int(seconds[0]) * NANO) / NANO
    path = CubicHermiteSpline(nodes[finite], motion[finite], slopes[finite])
    for column, name in enumerate(ship.POSE_AND_VELOCITY):
        values = table[name].to_numpy(dtype=float) * STATE_UNITS[column]
        rows = np.isfinite(values) & (stamps >= nodes[0] - 0.5) & (stamps < nodes[-1] + 0.5)
        if not rows.any():
            continue
        times, expected = stamps[rows], path(stamps[rows])[:, column]
        deviation = values[rows] - expected
        if ship.is_circular(name):
            deviation = (deviation + np.pi) % (2.0 * np.pi) - np.pi
        around = _neighbours(deviation, times)
        usual = robust_spread(np.abs(deviation - np.median(around, axis=1)))
        limit = np.maximum(_OUTLIER * usual, _usual_second_difference(expected + deviation))
        # An outlier leaves the samples on both sides. A speed that changes within a few leads from one to the
        # other, as a position does all the time: what counts of that is how far it is from its path.
        seen = expected + deviation if name in ship.VELOCITY else deviation
        sides = np.split(_neighbours(seen, times) if name in ship.VELOCITY else around, 2, axis=1)
        before, after = (np.median(side, axis=1) for side in sides)
        distance = np.maximum(np.minimum(before, after) - seen, seen - np.maximum(before, after)).clip(min=0.0)
        good = distance <= limit + 1e-9
        refused += int((~good).sum())

        node = np.floor(times[good] + 0.5).astype(int)  # the mean of the samples within half a second
        place = (times[good] - node + 0.5) * steps
        lower = np.minimum(place.astype(int), steps - 1)
        np.add.at(weight[:, column], (node, lower), 1.0 - (place - lower))
        np.add.at(weight[:, column], (node, lower + 1), place - lower)
        number = np.bincount(node, minlength=count)
        total = np.bincount(node, weights=(expected + deviation)[good], minlength=count)
        measured[:, column] = np.where(number > 0, total / np.maximum(number, 1), np.nan)
        weight[:, column] /= np.maximum(number, 1)[:, None]
    return measured, weight, refused


def _usual_second_difference(values: Floats) -> Floats:
    """How far samples may lie from the smoothed path by the usual second difference of those about each.

    White noise is an outlier further out than that; of a path without noise, as by dead reckoning, it is what
    distinguishes a manoeuvre from outliers.
    """
    if values.size < 3:
        return np.zeros(values.size)
    bends = np.abs(np.diff(values, 2))
    return np.asarray(_BENDS * median_filter(np.pad(bends, 1, mode="edge"), 9, mode="nearest"))


def _neighbours(values: Floats, times_s: Floats) -> Floats:
    """Each sample's neighbours within a third of a second, without itself, those before it first [n, even]; two on
    either side at least. Of four samples or fewer all have the median of them."""
    if values.size < 5:
        return np.full((values.size, 2), np.median(values) if values.size else 0.0)
    reach = int(np.clip(0.35 / max(float(np.median(np.diff(times_s))), 1e-3), 2, 50))
    around = sliding_window_view(np.pad(values, reach, mode="reflect"), 2 * reach + 1)
    return np.delete(around, reach, axis=1)


def mean_settings(
    table: pd.DataFrame, seconds: Ints, input_hold: InputHold = "line", steps: int = STEPS_PER_SECOND
) -> Floats:
    """The thrusters' mean setting in each step of the second after each node [T, steps, controls]."""
    after = np.arange(len(seconds) * steps + 1) / steps
    actuators = table_actuators(table)
    names, units = ship.control_names(actuators), control_units(actuators)
    result = np.empty((len(seconds), steps, len(names)))
    times_s, edges_s = times_ns(table) / NANO, after + float(seconds[0])
    for column, name in enumerate(names):
        values = table[name].to_numpy(dtype=float)
        mean = _means_between_edges(times_s, values, edges_s, input_hold, ship.is_circular(name)) * units[column]
        result[:, :, column] = mean.reshape(len(seconds), steps)
    return result


def setting_step_s(table: pd.DataFrame) -> float:
    """The interval between records of thruster settings [s], the longest of all."""
    steps = [0.0]
    for name in table_controls(table):
        times = times_ns(table)[table[name].notna().to_numpy()] / NANO
        if times.size > 2:
            steps.append(float(np.median(np.diff(times))))
    return max(steps)


def mean_wind(table: pd.DataFrame, seconds: Ints) -> Floats:
    """Wind direction FROM [rad] and speed [m/s] in the second after each node, 0 if not recorded."""
    edges = np.arange(len(seconds) + 1, dtype=np.float64) + float(seconds[0])
    if not set(ship.ENVIRONMENT) <= set(table.columns):
        return np.zeros((len(seconds), 2))
    direction, speed = (table[name].to_numpy(dtype=float) for name in ship.ENVIRONMENT)
    # Components, not speeds, are averaged, so that the vane's noise adds no wind.
    towards = speed * np.cos(np.deg2rad(direction)), speed * np.sin(np.deg2rad(direction))
    means = [_means_between_edges(times_ns(table) / NANO, component, edges) for component in towards]
    for mean in means:  # missing seconds are interpolated
        finite = np.flatnonzero(np.isfinite(mean))
        mean[:] = np.interp(np.arange(len(mean)), finite, mean[finite]) if finite.size else 0.0
    north, east = means
    return np.column_stack([np.arctan2(east, north), np.hypot(north, east)])


def thrust_columns(names: Iterable[str], actuators: ship.Actuators) -> dict[int, tuple[str, float]]:
    """By the number of an actuator, the column of its shaft's thrust and what makes it newtons.

    ``shaft_thrust_kn`` is that of a ship's only shaft, ``port_shaft_thrust_kn`` that of the actuator ``port`` or
    ``port_propeller``.
    """
    return {
        actuators.index(drive): (match[0], _NEWTONS[match["unit"]])
        for match in filter(None, map(_THRUST.fullmatch, names))
        if (drive := ship.drive_named(match["shaft"] or "", actuators))
    }


def mean_meters(table: pd.DataFrame, seconds: Ints) -> dict[str, Floats]:
    """The meters of a table as :class:`Log` has them, in means within half a second of each node."""
    actuators, times, meters = table_actuators(table), times_ns(table), dict[str, Floats]()

    def means(name: str) -> Floats:
        return _means_at_nodes(times, table[name].to_numpy(dtype=float), seconds)

    if columns := thrust_columns(map(str, table.columns), actuators):
        meters["thrust"] = np.full((len(seconds), len(actuators)), np.nan)
        for number, (name, newtons) in columns.items():
            meters["thrust"][:, number] = newtons * means(name)
    for shaft, power in power_columns(table).items():
        watts = 1e3 * power_kw({shaft: power}, means)
        if drive := ship.drive_named(shaft, actuators):
            by_shaft = meters.setdefault("shaft_power", np.full((len(seconds), len(actuators)), np.nan))
            by_shaft[:, actuators.index(drive)] = watts
        elif not shaft:
            meters["total_power"] = watts[:, None]
    if "speed_through_water_mps" in table:
        meters["water_speed"] = means("speed_through_water_mps")[:, None]
    if set(_CURRENT) <= set(table):
        speed, toward = (table[name].to_numpy(dtype=float) for name in _CURRENT)
        parts = (speed * np.cos(np.deg2rad(toward)), speed * np.sin(np.deg2rad(toward)))
        meters["current"] = np.column_stack([_means_at_nodes(times, part, seconds) for part in parts])
    return meters


def _means_at_nodes(times: Ints, values: Floats, seconds: Ints) -> Floats:
    """The mean of samples at times [ns] within half a second of each node [T], NaN without one."""
    rows = len(seconds)
    node = np.floor((times - int(seconds[0]) * NANO) / NANO + 0.5).astype(int)
    used = np.isfinite(values) & (node >= 0) & (node < rows)
    count, total = (np.bincount(node[used], weights, rows) for weights in (None, values[used]))
    return np.asarray(np.where(count > 0, total / np.maximum(count, 1), np.nan))


def _means_between_edges(
    times_s: Floats, values: Floats, edges_s: Floats, input_hold: InputHold = "line", circular: bool = False
) -> Floats:
    """The mean of samples between consecutive edges, interpolated between them; NaN across long gaps."""
    rows = np.isfinite(values)
    times, values = times_s[rows], values[rows]
    if times.size < 2:
        return np.full(len(edges_s) - 1, np.nan)
    if circular:
        values = ship.unwrap(values)
    steps = np.diff(times)
    if times.size >= 5 and np.median(steps) <= 0.5:  # blips are interpolated; at lower rates a jump may be real
        distance = np.abs(values - median_filter(values, 5, mode="nearest"))
        # A reversing drive also differs from its neighbours, by its movement in a step.
        moves = median_filter(np.abs(np.diff(values, append=values[-1])), 9, mode="nearest")
        good = distance <= _OUTLIER * robust_spread(distance) + 3.0 * moves + 1e-9
        values = np.interp(times, times[good], values[good])
    vertices = times, values
    if input_hold == "line":
        vertices = _insert_ramp_corners(*vertices)
    else:  # two vertices at each step
        stepped = np.repeat(vertices[0], 2), np.repeat(vertices[1], 2)
        until_next = input_hold == "until the next record"
        vertices = (stepped[0][1:], stepped[1][:-1]) if until_next else (stepped[0][:-1], stepped[1][1:])
    starts_s, starts = vertices
    index = np.clip(np.searchsorted(starts_s, edges_s, side="right") - 1, 0, starts_s.size - 2)
    length_s = np.diff(starts_s)[index]
    slope = np.diff(starts)[index] / np.where(length_s > 0.0, length_s, 1.0)
    elapsed_s = edges_s - starts_s[index]
    area = integrate(starts, starts_s)[index]
    integral = area + starts[index] * elapsed_s + 0.5 * slope * elapsed_s**2
    gap = steps > max(_LONGEST_GAP_S, _GAP_STEPS * float(np.median(steps)))
    crosses = np.diff(np.interp(edges_s, times, np.append(0.0, np.cumsum(gap)))) > 0.0
    outside = (edges_s[:-1] < times[0] - 1.0) | (edges_s[1:] > times[-1] + 1.0)
    return np.where(crosses | outside, np.nan, np.diff(integral) / np.diff(edges_s))


def _insert_ramp_corners(times_s: Floats, values: Floats) -> tuple[Floats, Floats]:
    """Sparse samples, with added corners where a drive began or stopped moving at a constant rate.

    Where the lines through the two samples before and the two after intersect within a step, they form a corner
    that linear interpolation would cut off; the difference would be taken for a force. Noise forms no corners.
    """
    steps = np.diff(times_s)
    if times_s.size < 4 or np.median(steps) < SELDOM_S or (steps <= 0.0).any():
        return times_s, values
    slope = np.diff(values) / steps
    turns = np.diff(slope)  # at each inner sample
    before, behind, inside = slope[:-2], slope[2:], slope[1:-1]
    beyond_noise = np.abs(before - behind) > _OUTLIER * robust_spread(turns)
    alike = (turns[:-1] * turns[1:] > 0.0) & beyond_noise
    part = np.where(alike, (inside - behind) / np.where(alike, before - behind, 1.0), 0.0)
    corner_s = (times_s[1:-2] + part * steps[1:-1])[alike]
    corner = (values[1:-2] + before * part * steps[1:-1])[alike]
    place = np.flatnonzero(alike) + 2
    return np.insert(times_s, place, corner_s), np.insert(values, place, corner)
