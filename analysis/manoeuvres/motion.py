"""Path, motion and helm of a ship on one uniform grid: the input of all finders and indices.

The path combines position and speed. The speeds, rotated by the heading and integrated, reproduce every bend
but drift; the positions do not drift but may be quantised, jump or be delayed. Their difference is slow, so a
fit over half a minute removes its noise without rounding off the path.

The helm of a ship with rudders is their mean angle. Of a ship steered by thrust, with azimuth thrusters or
waterjets, it is the direction of their total thrust, taken as proportional to the square of the shaft speed:
the common angle of similar drives, the angle of the one that runs when the others are stopped, and zero for a
drive that pulls while facing aft. Drives at the other end of the ship, which turn it by the opposite angle, are
recognised by that and counted with their sign. Of a ship with neither, but with propellers to port and to
starboard, it is the angle whose tangent is the difference of both thrusts over their sum, positive where port
pushes more and turns the ship to starboard: 0 for like propellers, 45 deg for one alone. Other ships have no helm.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from datetime import datetime
from typing import Any

import numpy as np
import pandas as pd

from seatrial.acquisition.core import errors, ship
from seatrial.acquisition.core.quantities import (
    Bools,
    Complexes,
    Floats,
    Ints,
    integrate,
    rotate_earth_to_ship,
    to_earth,
)
from seatrial.analysis import series
from seatrial.analysis.quality.controls import ORDER_INTERPOLATED, check_orders
from seatrial.analysis.quality.motion.model import heading_deviation, wild_heading_mask
from seatrial.analysis.tables import table as tables
from seatrial.analysis.tables.resample import resample

FASTEST_HZ = 5.0
_PATH_HALF_WIDTH_S = 20.0
_SLOPE_HALF_WIDTH_S, _SLOPE_ROWS = 2.0, 3.0  # as narrow as possible: indices come from wider fits
_WILD = 3.0  # factor on the change exceeded in a fiftieth of the recording: a splice, not motion
_MEDIAN_OF_FIVE = 1.1  # white noise in means of running medians of five, by that in means of the values
_JUMP_S, _JUMP_DEG, _JUMP_SHARE = 4.0, 6.0, 5.0
_LONGEST_GAP_S = 60.0  # longer ones part a recording: what is interpolated over them is no helm and no way
_RUDDER = "rudder"  # steering that works without thrust
BY_DIFFERENCE = "thrust"  # steering by propellers to both sides
_SIDES = (re.compile(r"(^|_)(port|left|bb|ps)(_|$)"), re.compile(r"(^|_)(starboard|stbd|right|sb)(_|$)"))
_STILL_SHARE = 0.2  # of the mean side thrust, that it changes by in a turn that lasts for the whole recording
_OPPOSED = -0.9  # correlation of side thrusts under way, below which a drive is at the other end of the ship
_FEWEST_HELMS, _LONGEST_HELM_INTERVAL_S, _BRIEF_SHARE = 10, 7.5, 0.2
_IN_STEP = 0.98  # the mean of unit vectors at the phases of samples, above which they are in step


@dataclass(frozen=True, slots=True)
class Motion:
    """Rows of one even grid, all [rows]: ``time_s`` since ``origin_ns`` (UTC).

    ``heading_deg`` is unwrapped. ``helm_deg`` is -180 < x <= 180, as the actuators of the kind that ``steering``
    names count it ("azimuth", "rudder", "nozzle", "thrust" for propellers to both sides; "" for none); of one that
    steers by thrust it means nothing where no drive runs. ``thrust`` is the sum of n|n| along the bow of all drives
    [rpm^2]. ``drives`` are the shafts of the propulsors, ``tunnels`` those of tunnel thrusters [rpm], by channel,
    and ``words`` their names in text; the shaft of a controllable propeller counts as what gives its thrust at full
    pitch. ``measured`` is where pose and speeds were measured; elsewhere they are interpolated. ``broken`` is where
    position or heading jump as no ship does, such as where a piece was cut out of a recording, and where they are
    missing for more than a minute: nothing reaches across. ``path_sd_m`` is the standard deviation of a point of
    the path, by how the positions wander about it. ``orders_are_events``: the helm was recorded when it changed and
    filled in between, so that the beginning of a change is not known. ``length_m`` is the ship's length between
    perpendiculars, if known, ``helm_rate_dps`` the usual rate of the helm. ``helm_order_deg`` and ``thrust_order``
    are the ordered helm and thrust, None where orders were not recorded.
    """

    origin_ns: int
    time_s: Floats
    north_m: Floats
    east_m: Floats
    heading_deg: Floats
    surge_mps: Floats
    sway_mps: Floats
    yaw_rate_dps: Floats
    helm_deg: Floats
    thrust: Floats
    drives: Mapping[str, Floats]
    tunnels: Mapping[str, Floats]
    measured: Bools
    broken: Bools
    path_sd_m: float = 0.0
    orders_are_events: bool = False
    steering: str = "azimuth"
    words: Mapping[str, str] = field(default_factory=dict)
    length_m: float | None = None
    helm_rate_dps: float = np.inf
    helm_order_deg: Floats | None = None
    thrust_order: Floats | None = None
    is_midship: bool = False

    @property
    def steers_by_thrust(self) -> bool:
        """Whether the helm has no effect when no propulsor runs."""
        return self.steering != _RUDDER

    @property
    def turns_to_starboard(self) -> float:
        """1 where a positive helm turns the ship to starboard, -1 to port."""
        return 1.0 if self.steering in (_RUDDER, BY_DIFFERENCE) else -1.0

    @property
    def helm_setting(self) -> str:
        """The name of the helm among the settings of a manoeuvre."""
        return f"{self.steering}_angle_deg" if self.steering == BY_DIFFERENCE else f"{self.steering}_deg"

    @property
    def main_rpm(self) -> Floats:
        """The shaft speed of the first propulsor, which names runs [rpm, rows]."""
        return next(iter(self.drives.values()), np.zeros(self.time_s.size))

    @property
    def drive_noise_rpm(self) -> float:
        """The noise of the noisiest drive's shaft [rpm]."""
        return max(map(row_to_row_noise, self.drives.values()), default=0.0)

    @property
    def step_s(self) -> float:
        """Seconds between rows."""
        return float(self.time_s[1] - self.time_s[0]) if self.time_s.size > 1 else 1.0

    @property
    def speed_mps(self) -> Floats:
        """Speed over ground [rows]."""
        return np.hypot(self.surge_mps, self.sway_mps)

    @property
    def fastest_mps(self) -> float:
        """The speed exceeded in a fiftieth of the measurements."""
        return float(np.percentile(self.speed_mps[self.measured], 98)) if self.measured.any() else 0.0

    def rows(self, first: int, end: int) -> Motion:
        """The rows from ``first`` up to ``end``."""
        part, columns = slice(max(first, 0), end), dict[str, Any]()
        for name in (attribute.name for attribute in fields(self)):
            values = getattr(self, name)
            if isinstance(values, np.ndarray):
                columns[name] = values[part]
            elif isinstance(values, Mapping) and name != "words":
                columns[name] = {channel: column[part] for channel, column in values.items()}
        return replace(self, **columns)

    def between(self, start_s: float, end_s: float) -> Motion:
        """The rows of a span of time, ends included."""
        first, end = np.searchsorted(self.time_s, [start_s - 1e-6, end_s + 1e-6])
        return self.rows(int(first), int(end))

    def around(self, start_s: float, end_s: float, margin_s: float) -> Motion:
        """The rows of a span with a margin, which ends at breaks."""
        breaks = self.time_s[self.broken]
        before, after = breaks[breaks < start_s], breaks[breaks > end_s]
        first = max(start_s - margin_s, float(before[-1]) + self.step_s if before.size else -np.inf)
        last = min(end_s + margin_s, float(after[0]) - self.step_s if after.size else np.inf)
        return self.between(first, last)

    def row_before(self, row: int, seconds: float) -> int:
        """The row this many seconds before another, or the first after a break in between."""
        first = max(0, row - round(seconds / self.step_s))
        breaks = np.flatnonzero(self.broken[first:row])
        return first + int(breaks[-1]) + 1 if breaks.size else first

    def at(self, name: str, time_s: float) -> float:
        """A column at any time, by linear interpolation."""
        return float(np.interp(time_s, self.time_s, getattr(self, name)))

    def utc(self, time_s: float) -> pd.Timestamp:
        """A time of the grid in UTC."""
        return pd.Timestamp(self.origin_ns + round(time_s * tables.NANO), unit="ns", tz="UTC")

    def seconds_of(self, time: datetime) -> float:
        """A time in UTC on the grid's clock [s]."""
        return (pd.Timestamp(time).value - self.origin_ns) / tables.NANO


def steering_actuators(actuators: ship.Actuators) -> ship.Actuators:
    """The actuators that steer a ship: its rudders, else the propulsors with a thrust angle; none if it has
    neither."""
    with_angle = tuple(actuator for actuator in actuators if actuator.angle is not None)
    return tuple(actuator for actuator in with_angle if not actuator.drives) or with_angle


def recorded_actuators(table: pd.DataFrame) -> ship.Actuators:
    """The actuators of a table's ship; a rudder alone if it has that angle and no channel of theirs."""
    recorded = table.loc[:, table.notna().any()]
    actuators = tables.table_actuators(recorded)
    is_rudder_alone = ship.RUDDER in table and not set(ship.control_names(actuators)) & set(recorded)
    return (ship.Actuator(_RUDDER, _RUDDER),) if is_rudder_alone else actuators


def motion_of(table: pd.DataFrame, length_m: float | None = None) -> Motion:
    """The motion in a table of raw or resampled samples, at its own rate up to 5 Hz, for a ship of this length.

    Missing speeds and rate of turn are derived from positions and heading. Raises :class:`InputError` if
    position, heading or the first steering actuator are missing, or if nothing drives or steers the ship; other
    missing actuators are taken as stopped.
    """
    actuators = recorded_actuators(table)
    steering, driving = steering_actuators(actuators), tuple(actuator for actuator in actuators if actuator.drives)
    tables.require_actuators(table, (*steering, *driving))
    helms = [actuator.angle.name for actuator in steering if actuator.angle is not None]
    tables.require(table, (*ship.POSE, *(helms or [channel.name for channel in driving[0].channels])[:1]))
    table = series.without_repeats(table, (*ship.POSE_AND_VELOCITY, *helms))
    grid, time_ns = _resample_to_even_grid(table, helms)
    time_s = (time_ns - time_ns[0]) / tables.NANO
    step_s = float(time_s[1] - time_s[0]) if time_s.size > 1 else 1.0
    grid = _add_velocities(grid, step_s)

    measured = grid[[*ship.POSE_AND_VELOCITY]].notna().all(axis=1).to_numpy(dtype=bool)
    surge, sway, yaw_rate = (interpolate_gaps(grid[name].to_numpy()) for name in ship.VELOCITY)
    integral = integrate(yaw_rate, step_s)  # which the heading follows over gaps
    turned = np.asarray(
        integral + interpolate_gaps(ship.unwrap(ship.wrap_360(grid["heading_deg"].to_numpy() - integral)))
    )
    broken = _jump_mask(interpolate_gaps(ship.unwrap(grid["heading_deg"].to_numpy() - integral)), step_s, _JUMP_DEG)
    for first, end in runs_of_true(~measured, round(_LONGEST_GAP_S / step_s)):
        broken[first:end] = True
    (north, east), broken, spread = _dead_reckoned_path(table, grid, turned, surge, sway, broken, step_s)

    drives, tunnels, words = dict[str, Floats](), dict[str, Floats](), dict[str, str]()
    for actuator in actuators:
        if actuator.drives or actuator.angle is None:
            shaft, text = actuator.channels[0].name, actuator.name.replace("_", " ")
            name = shaft if _pitch_channel_name(actuator) is None else f"{actuator.name}_at_full_pitch_rpm"
            (drives if actuator.drives else tunnels)[name] = shaft_speed_rpm(grid, actuator)
            words[name] = text if actuator.noun in text else f"{text} {actuator.noun}"
    kind, helm, thrust = _helm_and_thrust(grid, steering, driving, surge)
    recorded_orders = [
        name for name in map(ship.order_channel_name, helms) if name in grid and grid[name].notna().any()
    ]
    orders = [interpolate_gaps(ship.unwrap(grid[name].to_numpy())) for name in recorded_orders]
    motion = Motion(
        int(time_ns[0]), time_s, north, east, turned, surge, sway, yaw_rate, helm, thrust, drives, tunnels,
        measured & ~broken, broken, spread, orders_are_events(table), kind, words, length_m,
        helm_order_deg=ship.circular_mean(orders, axis=0) if orders else None,
        thrust_order=_ordered_surge_thrust(grid, driving),
    )  # fmt: skip
    trial = tables.trial_of(table)
    if trial.antenna_forward_m is None:
        return motion
    return move_motion_to_midship(motion, (trial.antenna_forward_m, trial.antenna_starboard_m or 0.0))


def move_motion_to_midship(motion: Motion, place_m: tuple[float, float]) -> Motion:
    """The motion of midship from that of another point of the ship, so far forward and to starboard of it [m].

    A point of a rigid ship moves with ``u - r y`` and ``v + r x`` (Fossen 2011, eq. 2.118 in the plane).
    """
    north, east = to_earth(*place_m, np.deg2rad(motion.heading_deg))
    turning = np.deg2rad(motion.yaw_rate_dps)
    return replace(
        motion, north_m=motion.north_m - north, east_m=motion.east_m - east,
        surge_mps=motion.surge_mps + turning * place_m[1], sway_mps=motion.sway_mps - turning * place_m[0],
        is_midship=True,
    )  # fmt: skip


def _add_velocities(grid: pd.DataFrame, step_s: float) -> pd.DataFrame:
    """The grid with missing speeds and rate of turn derived from local fits of position and heading, without
    implausible jumps."""
    lacking = [name for name in ship.VELOCITY if name not in grid or not grid[name].notna().any()]
    if not lacking:
        return grid
    if len(grid) < 2:
        raise errors.DataShortageError("holds too few positions to derive speeds from", fix="record for longer")
    rows = max(_SLOPE_HALF_WIDTH_S / step_s, _SLOPE_ROWS)
    north, east = (interpolate_gaps(grid[name].to_numpy()) for name in ship.POSE[:2])
    heading = ship.unwrap(interpolate_gaps(ship.unwrap(grid[ship.POSE[2]].to_numpy())))
    slopes = (np.gradient(series.local_quadratic(values, rows), step_s) for values in (north, east, heading))
    over_north, over_east, yaw_rate = (
        interpolate_gaps(np.where(np.abs(slope) > _WILD * np.percentile(np.abs(slope), 98), np.nan, slope))
        for slope in slopes
    )
    surge, sway = rotate_earth_to_ship(over_north, over_east, np.deg2rad(heading))
    gaps = grid[[*ship.POSE]].isna().any(axis=1)
    derived = dict(zip(ship.VELOCITY, (surge, sway, yaw_rate), strict=True))
    return grid.assign(**{name: np.where(gaps, np.nan, derived[name]) for name in lacking})


def orders_are_events(table: pd.DataFrame) -> bool:
    """Whether a helm's values between its changes are interpolated, linearly or by a repair."""
    repaired = {entry["options"].get("channel") for entry in tables.history_of(table)
              if entry["options"].get("code") == ORDER_INTERPOLATED}  # fmt: skip
    angles = [
        actuator.angle.name
        for actuator in steering_actuators(recorded_actuators(table))
        if actuator.angle is not None
    ]
    return bool(repaired & set(angles)) or bool(check_orders(table[[*filter(table.__contains__, angles)]]).findings)


def interpolate_gaps(values: Floats) -> Floats:
    """``values`` with NaN replaced by linear interpolation; all zero if nothing is known."""
    present = np.isfinite(values)
    if present.all():
        return values
    rows = np.arange(values.size)
    return np.interp(rows, rows[present], values[present]) if present.any() else np.zeros(values.size)


def running_median(values: Floats, rows: int) -> Floats:
    """The median of about ``rows`` values around each, fewer at the ends; NaN are left out."""
    return np.asarray(pd.Series(values).rolling(2 * (rows // 2) + 1, center=True, min_periods=1).median())


def row_to_row_noise(values: Floats) -> float:
    """The standard deviation of row-to-row noise; zero for a smooth curve, and robust against a few steps."""
    return series.white_noise_standard_deviation(values[np.isfinite(values)])


def _resample_to_even_grid(table: pd.DataFrame, helms: Sequence[str]) -> tuple[pd.DataFrame, Ints]:
    """A table at its own rate, up to 5 Hz, and the times of its rows [ns]; ``helms`` are the angles that steer.

    The grid lies at the samples of the heading where they are in step: then nothing is interpolated, which would
    take off noise that the intervals are to show. Nor is a helm that is over within few of its own samples: that
    would be a slower one.
    """
    times = tables.times_ns(table)[table["heading_deg"].notna().to_numpy()]
    distinct = np.unique(times)
    interval_s = float(np.median(np.diff(distinct))) / tables.NANO if distinct.size > 1 else 1.0
    interval_s = max([interval_s, *(_brief_helm_interval_s(table, name) for name in helms)])
    rate_hz = min(1.0 / interval_s, FASTEST_HZ)
    rate_hz = float(np.round(rate_hz)) if rate_hz >= 1.0 else rate_hz
    step_ns = tables.NANO / rate_hz
    phases = np.exp(2j * np.pi * (times % step_ns) / step_ns) if times.size else np.ones(1, dtype=complex)
    mean = complex(phases.mean())
    delay_ns = round(float(np.angle(mean)) / (2.0 * np.pi) * step_ns) if abs(mean) > _IN_STEP else 0
    on_grid = table.assign(heading_deg=_clean_heading_deg(table))
    on_grid.index = pd.DatetimeIndex(table.index) - pd.to_timedelta(delay_ns, unit="ns")
    grid = resample(on_grid, rate_hz)

    # Settings of a faster table are sampled at the rows: the anti-aliasing filter turns a step into a ramp that
    # begins early, and an execute matters to a tenth of a second for a model that turns by 3 deg in one.
    at, sharp = tables.times_ns(grid), {}
    for name in filter(on_grid.__contains__, tables.table_controls(on_grid)):
        samples = on_grid[name].dropna().sort_index()
        stamps = tables.times_ns(samples.to_frame())
        if stamps.size > 1 and np.median(np.diff(stamps)) < 0.8 * step_ns:
            values = samples.to_numpy(dtype=float)
            values = np.interp(at, stamps, ship.unwrap(values) if ship.is_circular(name) else values)
            sharp[name] = ship.wrap_180(values) if ship.is_circular(name) else values
    return grid.assign(**sharp), at + delay_ns


def _brief_helm_interval_s(table: pd.DataFrame, name: str) -> float:
    """The interval of a helm that comes evenly and moves by a fifth of its range from one sample to the next [s],
    0 of any other."""
    samples = series.finite_samples(table, name)
    if samples.value.size < _FEWEST_HELMS:
        return 0.0
    intervals_s, helm_deg = np.diff(samples.time_s), ship.unwrap(samples.value)
    interval_s = float(np.median(intervals_s))
    is_even = float(np.quantile(intervals_s, 0.9)) <= 1.5 * interval_s <= _LONGEST_HELM_INTERVAL_S
    is_brief = np.abs(np.diff(helm_deg)).max() > _BRIEF_SHARE * np.ptp(np.quantile(helm_deg, [0.01, 0.99]))
    return interval_s if is_even and is_brief else 0.0


def _clean_heading_deg(table: pd.DataFrame) -> Floats:
    """The heading without samples that contradict the yaw rate and their neighbours, such as interpolations
    through 360 -> 0 by a logger."""
    heading = table["heading_deg"].to_numpy(dtype=float, copy=True)
    if "yaw_rate_dps" not in table or not table["yaw_rate_dps"].notna().any():
        return heading
    rows = np.flatnonzero(np.isfinite(heading))
    seconds = tables.seconds_of(table)[rows]
    yaw_rate = interpolate_gaps(table["yaw_rate_dps"].to_numpy(dtype=float))[rows]
    turned = integrate(np.deg2rad(yaw_rate), seconds)
    interval_s = float(np.median(np.diff(seconds))) if rows.size > 1 else 1.0
    _, deviation = heading_deviation(np.deg2rad(heading[rows]), turned, max(interval_s, 1e-3))
    heading[rows[wild_heading_mask(deviation, turned)]] = np.nan
    return heading


def _dead_reckoned_path(
    table: pd.DataFrame, grid: pd.DataFrame, heading_deg: Floats, surge: Floats, sway: Floats, broken: Bools,
    step_s: float,
) -> tuple[list[Floats], Bools, float]:  # fmt: skip
    """The path north and east [m], by dead reckoning and the smooth difference of the positions from it.

    With it the rows that are ``broken`` or at which the positions jump, and the standard deviation of a point [m].
    """
    reckoned = [integrate(velocity, step_s) for velocity in to_earth(surge, sway, np.deg2rad(heading_deg))]
    differences = [
        interpolate_gaps(grid[name].to_numpy() - path) for name, path in zip(ship.POSE, reckoned, strict=False)
    ]
    offsets = [running_median(difference, 5) for difference in differences]
    fastest_mps = float(np.percentile(np.hypot(surge, sway), 98))
    for offset in offsets:
        broken = broken | _jump_mask(offset, step_s, _JUMP_S * fastest_mps)
    half_width = _PATH_HALF_WIDTH_S / step_s
    trends = [offset.copy() for offset in offsets]
    for trend in trends:  # piece by piece
        for first, end in runs_of_true(~broken):
            trend[first:end] = series.local_quadratic(trend[first:end], half_width)

    # The positions wander by the spread of ten-second means of the fit's residuals, two of which cover its width.
    wanders_m, rows = list[float](), max(1, round(0.5 * _PATH_HALF_WIDTH_S / step_s))
    for offset, trend in zip(offsets, trends, strict=True):
        means = (offset - trend)[: offset.size // rows * rows].reshape(-1, rows).mean(axis=1)
        wanders_m.append(series.robust_spread(means) / np.sqrt(2.0))
    # The fit passes a part of the white noise of the positions, and that of the speeds drifts until it corrects it.
    sideways_mps = fastest_mps * np.deg2rad(
        row_to_row_noise(heading_deg)
    )  # what the heading's noise does to the speeds
    speed_noise_mps = float(np.hypot(max(row_to_row_noise(surge), row_to_row_noise(sway)), sideways_mps))
    scatters_m = list(map(row_to_row_noise, differences))
    for name in ship.POSE[:2]:  # as for one sample a step: what is on the grid was interpolated or filtered
        samples = table[name].dropna().sort_index()
        interval_s = (
            float(np.median(np.diff(tables.times_ns(samples.to_frame())))) / tables.NANO
            if len(samples) > 1
            else step_s
        )
        scatters_m.append(row_to_row_noise(samples.to_numpy(dtype=float)) * np.sqrt(min(interval_s / step_s, 1.0)))
    impulse = np.zeros(4 * int(np.ceil(half_width)) + 1)
    impulse[impulse.size // 2] = 1.0
    kernel = series.local_quadratic(impulse, half_width)
    drift_m = speed_noise_mps * step_s * np.linalg.norm(np.cumsum(impulse) - np.cumsum(kernel))
    noise_m = float(np.hypot(_MEDIAN_OF_FIVE * float(max(scatters_m)) * np.linalg.norm(kernel), drift_m))
    spread_m = float(np.hypot(float(np.linalg.norm(wanders_m)), noise_m))
    return [path + trend for path, trend in zip(reckoned, trends, strict=True)], broken, spread_m


def _jump_mask(values: Floats, step_s: float, least: float) -> Bools:
    """Mask of changes of ``values`` within three seconds by more than ``least`` and far more than elsewhere."""
    rows = max(1, round(1.5 / step_s))
    change = np.zeros(values.size)
    if values.size > 2 * rows:
        change[rows:-rows] = np.abs(values[2 * rows :] - values[: -2 * rows])
    return change > max(least, _JUMP_SHARE * float(np.percentile(change, 90)))


def runs_of_true(mask: Bools, least_rows: int = 1) -> list[tuple[int, int]]:
    """First row and end of every run of true values that is long enough.

    >>> runs_of_true(np.array([True, True, False, True]))
    [(0, 2), (3, 4)]
    """
    return [(int(a), int(b)) for a, b in zip(*series.edges_of_runs(mask), strict=True) if b - a >= least_rows]


def _pitch_channel_name(actuator: ship.Actuator) -> str | None:
    return next((channel.name for channel in actuator.channels if channel.unit == "%"), None)


def shaft_speed_rpm(grid: pd.DataFrame, actuator: ship.Actuator) -> Floats:
    """The shaft speed of an actuator [rpm], at full pitch; zero if not recorded."""
    name, pitch = actuator.channels[0].name, _pitch_channel_name(actuator)
    rpm = interpolate_gaps(grid[name].to_numpy()) if name in grid else np.zeros(len(grid))
    if pitch is None or pitch not in grid:
        return rpm
    share = (
        interpolate_gaps(grid[pitch].to_numpy()) / 100.0
    )  # thrust goes with the pitch and the square of the speed
    return np.asarray(rpm * np.sign(share) * np.sqrt(np.abs(share)))


def _angle_deg(grid: pd.DataFrame, actuator: ship.Actuator) -> Floats:
    """The angle of an actuator [deg], unwrapped; zero where missing."""
    if actuator.angle is None or actuator.angle.name not in grid:
        return np.zeros(len(grid))
    return interpolate_gaps(ship.unwrap(grid[actuator.angle.name].to_numpy()))


def _helm_and_thrust(
    grid: pd.DataFrame, steering: ship.Actuators, driving: ship.Actuators, surge: Floats
) -> tuple[str, Floats, Floats]:
    """What steers the ship, "" for nothing, the helm [deg] and the thrust along the bow [rpm^2]."""
    zero = np.zeros(len(grid))
    pushes = {actuator: _thrust_vector(grid, actuator) for actuator in driving}
    ahead = np.sum([zero, *(push.real for push in pushes.values())], axis=0)
    if not steering:
        if not (sides := drives_by_side(driving)):
            return "", zero, ahead
        shafts = ([shaft_speed_rpm(grid, drive) for drive in side] for side in sides)
        port, starboard = (np.sum([rpm * np.abs(rpm) for rpm in group], axis=0) for group in shafts)
        return BY_DIFFERENCE, np.rad2deg(np.arctan2(port - starboard, port + starboard)), ahead
    kind = steering[0].steers_by
    if not steering[0].drives or not any(actuator.channels[0].name in grid for actuator in steering):
        angles = [
            _angle_deg(grid, actuator) for actuator in steering if actuator.angle and actuator.angle.name in grid
        ]
        return kind, np.mean(angles, axis=0) if angles else zero, ahead

    turned = [pushes[actuator] for actuator in steering]
    under_way = np.abs(surge) >= 0.5 * np.percentile(np.abs(surge), 98)
    sides_of_turn = []
    for push in turned:  # one at the other end of the ship pushes against the first, in its changes if it has any
        pair = push.imag[under_way], turned[0].imag[under_way]
        constant = all(values.std() < _STILL_SHARE * abs(values.mean()) for values in pair)
        a, b = (values if constant else values - values.mean() for values in pair)
        sides_of_turn.append(-1.0 if a @ b < _OPPOSED * np.sqrt((a @ a) * (b @ b)) else 1.0)
    along = np.sum([push.real for push in turned], axis=0)
    sideways = np.sum([side * push.imag for side, push in zip(sides_of_turn, turned, strict=True)], axis=0)
    return kind, ship.wrap_180(np.rad2deg(np.arctan2(sideways, along))), ahead


def drives_by_side(driving: ship.Actuators) -> tuple[ship.Actuators, ship.Actuators] | tuple[()]:
    """The propellers to port and to starboard, by their names; of a pair that its names do not tell the port one
    comes first. Empty where they are not to both sides."""
    port, starboard = (tuple(drive for drive in driving if side.search(drive.name)) for side in _SIDES)
    if len(driving) == 2 and not (port or starboard):
        return driving[:1], driving[1:]
    return (port, starboard) if port and starboard else ()


def _ordered_surge_thrust(grid: pd.DataFrame, driving: ship.Actuators) -> Floats | None:
    """The thrust along the bow that was ordered of the drives whose orders were recorded [rpm^2], None if none
    were."""
    orders: dict[str, pd.Series] = {}
    ordered = list[ship.Actuator]()
    for drive in driving:
        names = {channel.name: ship.order_channel_name(channel.name) for channel in drive.channels}
        recorded = {
            name: grid[order] for name, order in names.items() if order in grid and grid[order].notna().any()
        }
        if any(not name.endswith("_angle_deg") for name in recorded):
            orders |= recorded
            ordered.append(drive)
    if not ordered:
        return None
    as_ordered = grid.assign(**orders)
    return np.asarray(np.sum([_thrust_vector(as_ordered, drive).real for drive in ordered], axis=0))


def _thrust_vector(grid: pd.DataFrame, actuator: ship.Actuator) -> Complexes:
    """n|n| of a propulsor in the direction of its thrust [rpm^2]."""
    rpm = shaft_speed_rpm(grid, actuator)
    return np.asarray(rpm * np.abs(rpm) * np.exp(1j * np.deg2rad(_angle_deg(grid, actuator))))
