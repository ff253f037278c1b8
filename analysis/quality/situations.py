"""Situations in which the ship is not free: without them a moored ship is judged by a model of a sailing one.

Held (moored, anchored, aground, in a lock): the ship lies still for minutes in which its thrusters do not control
that. A free ship has forces on it: in 3 minutes a current of 2 cm/s carries it 3.6 m, a force of 0.2 N a tonne
3.2 m. It keeps its place only if its thrusters balance the forces to better than that, and what balances a wind
has to follow it. So lying still is evidence where the thrusters idle or are constant, for then nothing follows the
wind, and where they push much harder at one time than at another, for then nothing balances. A ship that lies still
on dynamic positioning, its thrust gently following the wind, cannot be distinguished from a held one and counts as
free. A ship at rest in still water with idle thrusters counts as held: there is nothing to be learned of it either.

Under tow: the thrusters idle for ten minutes and the ship makes way, bow first, without slowing down. A ship that
coasts slows down, to 37 % in a head reach constant (its mass by its resistance at unit speed), at most 8 km for the
largest ships. One that a current carries lies at any angle to its course; where it happens to lie along it,
it cannot be distinguished from a towed one over ground. Where shafts were not recorded, or never turned, nothing is
claimed.

All this is judged by medians of 21 s, which waves, outliers and white noise hardly affect. What these leave of the
noise, measured on the channel itself, widens the tolerances. A ship that swings on its anchor is not recognised.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from seatrial.acquisition.core import ship
from seatrial.acquisition.core.quantities import Bools, Floats, Ints
from seatrial.analysis.quality.findings import SHIP, CheckResult, Finding, uniform_flags, utc_timestamp
from seatrial.analysis.series import edges_of_runs, is_assumed, mask_of_runs, white_noise_standard_deviation
from seatrial.analysis.tables.table import NANO, table_actuators, times_ns

Kind = Literal["ship_held", "ship_towed"]
KINDS: tuple[Kind, ...] = ("ship_held", "ship_towed")
"""Codes of situations: of findings, and of the reasons for which windows are dropped."""
_IN_WORDS: dict[Kind, str] = {
    "ship_held": "the ship is held in them (moored, anchored or aground)",
    "ship_towed": "the ship is towed, or carried by a current, in them",
}

STILL_S = 180
"""The shortest time of lying still [s], twice as long as free ships do by the tolerances below: R/V Gunnerus
between manoeuvres in a harbour (2019) for 84 s, a 5 m ferry keeping its station for 76 s, models before a run for
73 s."""
TOWED_S = 600
"""The shortest time under tow [s]: in less, a tanker's coasting at 1 m/s could pass for a constant speed."""
_SMOOTHING_S = 21  # longer than two waves, shorter than any manoeuvre
_GAP_S = 30.0  # across which a channel is interpolated
_MEDIAN_NOISE = 1.25  # the standard deviation of a median to that of a mean
_MOST_NOISE_MPS = 0.2  # of speeds; more of it hides that a position is frozen
_RANGE_SIGMAS = 6.0  # the range of some ten independent medians exceeds it once in 1,000 times
_TOWED_MPS = 1.0
_SLOWED, _DRIFT_ANGLE = 0.95, 0.3
"""A ship of a head reach constant of 8 km (300,000 t) comes from 1 m/s to 0.93 of that in 600 s of coasting; a
third as much sway as surge is a drift angle of 17 deg."""
_IDLE, _CONSTANT, _PUSH = 0.05, 0.005, 0.2
"""Of the usual revolutions or full pitch: those of an idle drive (12 of 240 rpm, as for held windows), the range of
a constant one; of the usual thrust: the range that nothing outside the ship balances."""
_ORDINARY_RPM, _ORDINARY_PERCENT = 240.0, 100.0
_ANGLE_DEG, _CONSTANT_S, _UNCONTROLLED = 1.0, 90, 0.5
"""What controls a position changes its thrust more often than every 90 s, as its periods are 1 to 3 minutes. Of a
stay with constant thrust for at least half of the time the rest belongs to it."""
_LEAST_STILL_S, _CARRIED_M = 120, 5.0
"""Of a held ship, without coming and leaving; and how far its positions may have wandered meanwhile: a receiver's
error does, lines do not give so much, and what creeps further adrift in a light air is free."""
_EDGE_S, _EDGE_M, _EDGE_MPS, _EDGE_DEG = 60, 0.3, 0.05, 1.0
_EDGE_SMOOTHING_S = 5


class _Tolerance(NamedTuple):
    """The ranges within :data:`STILL_S` of a ship that lies still, and its largest speed, without noise."""

    metres: float
    degrees: float
    mps: float


_MOORED = _Tolerance(2.0, 5.0, 0.1)
"""R/V Gunnerus at the quay on slack lines (2019): 0.8 m and 3.5 deg in two minutes, 0.02 m/s. A receiver without
corrections wanders 0.5 to 1 m in 3 minutes."""
_FAST = _Tolerance(0.3, 1.0, 0.03)
"""For where the thrusters push: lines stretch by decimetres."""


@dataclass(frozen=True, slots=True)
class Situation:
    """A stretch of time [ns since 1970] in which the ship is held or towed; ``idle`` is the fraction of it with all
    thrusters idle, NaN where that was not recorded, ``metres`` the distance between its ends."""

    kind: Kind
    start_ns: int
    end_ns: int
    idle: float
    metres: float

    @property
    def seconds(self) -> float:
        return (self.end_ns - self.start_ns) / NANO

    def finding(self) -> Finding:
        """The situation as a finding about the ship, not about a channel."""
        start, end = utc_timestamp(self.start_ns), utc_timestamp(self.end_ns)
        span = f"for {self.seconds / 60.0:.1f} min, {start:%H:%M:%S} to {end:%H:%M:%S},"
        if self.kind == "ship_towed":
            speed = self.metres / max(self.seconds, 1.0)
            text = (
                f"The ship makes way {span} at {speed:.1f} m/s without slowing down although its thrusters idle: "
                "under tow, or carried by a current"
            )
        else:
            how = "although its thrusters work" if self.idle < 0.95 else "with its thrusters idle"
            held = "moored, anchored or aground" if self.idle < 0.95 else "moored, anchored, aground or at rest"
            text = f"The ship lies still {span}{'' if np.isnan(self.idle) else f' {how}'}: {held}"
        remedy = "Windows, training, evaluation and diagnosis leave this time out"
        estimate = {"seconds": self.seconds, "metres": self.metres}
        return Finding(self.kind, SHIP, start, end, text, remedy, estimate)


def check_situations(table: pd.DataFrame) -> CheckResult:
    """Report where the ship is held or towed; no sample is flagged for it."""
    return CheckResult(uniform_flags(table), tuple(situation.finding() for situation in find_situations(table)))


def not_free_at(time_ns: Ints, situations: Iterable[Situation]) -> Bools:
    """Masks [kinds, times] of the times [ns since 1970] within the situations of each of :data:`KINDS`."""
    masks = np.zeros((len(KINDS), time_ns.size), dtype=bool)
    for situation in situations:
        within = (time_ns >= situation.start_ns) & (time_ns <= situation.end_ns)
        masks[KINDS.index(situation.kind)] |= within
    return masks


def left_out_notes(dropped: Mapping[str, int]) -> list[str]:
    """In words how many windows are left out, of those ``dropped`` by reason, because the ship is not free.

    >>> left_out_notes({"gap": 3, "ship_held": 120})
    ['120 windows left out: the ship is held in them (moored, anchored or aground)']
    """
    return [f"{dropped[kind]} windows left out: {why}" for kind, why in _IN_WORDS.items() if dropped.get(kind)]


def find_situations(table: pd.DataFrame) -> tuple[Situation, ...]:
    """The stretches of time in which a ship is held or towed, in their order.

    Parameters
    ----------
    table
        The channels of a recording at any rate, with a sorted UTC index and NaN where a channel has no sample;
        without position or heading nothing is claimed.

    Returns
    -------
    tuple of Situation
        Held for :data:`STILL_S`, of which the ends may go in which the ship comes or leaves, or towed for
        :data:`TOWED_S` at least.
    """
    if not set(ship.POSE) <= set(table) or len(table) < STILL_S // 10:
        return ()
    seconds = _by_second(table)
    if len(seconds) < STILL_S:
        return ()
    noise = {str(name): white_noise_standard_deviation(seconds[name].dropna().to_numpy()) for name in seconds}
    slow = seconds.rolling(_SMOOTHING_S, center=True, min_periods=_SMOOTHING_S // 2).median()
    slow = slow.where(seconds.notna())
    drives = _Drives.of(slow, noise, table)
    situations = []
    held = _held_rows(seconds, slow, noise, drives)
    for kind, mask in zip(KINDS, (held, _towed_rows(slow, drives) & ~held), strict=True):
        for first, stop in zip(*edges_of_runs(mask), strict=True):
            ends = slow.iloc[[first, stop - 1]]
            metres = float(np.hypot(np.diff(ends["north_m"]), np.diff(ends["east_m"]))[0])
            if kind == "ship_held" and (stop - first < _LEAST_STILL_S or metres > _CARRIED_M):
                continue
            begin_ns, end_ns = (int(seconds.index[row]) * NANO for row in (first, stop - 1))
            idle = float(drives.idle[first:stop].mean()) if drives.recorded[first:stop].all() else np.nan
            situations.append(Situation(kind, begin_ns, end_ns, idle, metres))
    return tuple(sorted(situations, key=lambda situation: situation.start_ns))


def _by_second(table: pd.DataFrame) -> pd.DataFrame:
    """Means of motion and controls by second since 1970, interpolated across short gaps, angles unwrapped."""
    actuators = table_actuators(table)
    names = (*ship.POSE, "surge_mps", "sway_mps", "speed_through_water_mps", *ship.control_names(actuators))
    second = np.floor(times_ns(table) / NANO).astype(np.int64)
    row, count = second - second[0], int(second[-1] - second[0]) + 1
    columns = dict[str, Floats]()
    for name in (name for name in names if name in table):
        values = table[name].to_numpy(dtype=float)
        valid = np.isfinite(values)
        if not valid.any():
            continue
        place, values = row[valid], values[valid]
        values = ship.unwrap(values) if ship.is_circular(name) else values
        number = np.bincount(place, minlength=count)
        present = np.flatnonzero(number)
        mean = np.bincount(place, weights=values, minlength=count)[present] / number[present]
        column = np.interp(np.arange(count), present, mean, left=np.nan, right=np.nan)
        for last in present[:-1][np.diff(present) > _GAP_S]:
            column[last + 1 : present[np.searchsorted(present, last) + 1]] = np.nan
        columns[name] = column
    return pd.DataFrame(columns, index=second[0] + np.arange(count))


@dataclass(frozen=True, slots=True)
class _Drives:
    """By second: whether all drives are ``recorded``, are ``idle``, stay ``constant`` for :data:`_CONSTANT_S` to
    come, and whether the thrust of one changes much within :data:`STILL_S` (``push``); ``turned`` is whether a
    propulsor ever worked."""

    recorded: Bools
    idle: Bools
    constant: Bools
    push: Bools
    turned: bool

    @classmethod
    def of(cls, slow: pd.DataFrame, noise: Mapping[str, float], table: pd.DataFrame) -> _Drives:
        recorded, idle, constant = np.ones((3, len(slow)), dtype=bool)
        push, turned = np.zeros(len(slow), dtype=bool), False
        actuators = table_actuators(table)
        recorded[:] = any(actuator.drives for actuator in actuators)
        for actuator in sorted(actuators, key=lambda actuator: actuator.kind == "rudder"):
            names = [channel.name for channel in actuator.channels]
            if not set(names) <= set(slow) or (actuator.drives and any(is_assumed(table, name) for name in names)):
                recorded[:] = False
            elif actuator.kind == "rudder":
                constant &= _is_constant_angle(slow[names[0]], noise) | _holds_for_rows(idle, _CONSTANT_S)
            else:
                recorded &= slow[names].notna().all(axis=1).to_numpy()
                thrust, settings_constant = _thrust_of(slow, noise, actuator)
                for component in (thrust.real, thrust.imag):
                    push |= np.nan_to_num(_running_range(component)) >= _PUSH
                idle &= thrust == 0.0
                constant &= settings_constant
                turned |= actuator.drives and bool((np.abs(thrust) > 0.0).sum() >= _SMOOTHING_S)
        constant &= _holds_for_rows(recorded, _CONSTANT_S)
        return cls(recorded, idle & recorded, constant, push & _holds_for_rows(recorded), turned)


def _thrust_of(
    slow: pd.DataFrame, noise: Mapping[str, float], actuator: ship.Actuator
) -> tuple[NDArray[np.complex128], Bools]:
    """The thrust of a drive ahead and, imaginary, to starboard, as a fraction of the usual, 0 where it idles; and
    whether its settings stay constant for :data:`_CONSTANT_S`."""
    idle, constant, angle_constant = np.zeros(len(slow), bool), *np.ones((2, len(slow)), dtype=bool)
    thrust = np.ones(len(slow), dtype=complex)
    for channel in actuator.channels:
        value = slow[channel.name].to_numpy()
        if channel.unit == "deg":
            angle_constant = _is_constant_angle(slow[channel.name], noise)
            thrust *= np.exp(1j * np.deg2rad(value))
            continue
        usual = _ORDINARY_RPM if channel.unit == "rpm" else _ORDINARY_PERCENT
        usual = max(usual, float(slow[channel.name].abs().quantile(0.98)))
        ratio = value / usual
        idle |= np.abs(ratio) <= _IDLE
        # within the idle band too, where thrust can still hold a ship in a light air
        constant &= _running_range(ratio, _CONSTANT_S) <= _CONSTANT + _noise_range(
            min(noise[channel.name] / usual, _CONSTANT)
        )
        thrust *= ratio * np.abs(ratio) if channel.unit == "rpm" else ratio
    return np.where(idle, 0.0, thrust), constant & (angle_constant | _holds_for_rows(idle, _CONSTANT_S))


def _is_constant_angle(angle_deg: pd.Series, noise: Mapping[str, float]) -> Bools:
    sigma = min(noise[str(angle_deg.name)], _ANGLE_DEG)
    return np.asarray(_running_range(angle_deg.to_numpy(), _CONSTANT_S) <= _ANGLE_DEG + _noise_range(sigma))


def _running_extremes(values: Floats, rows: int = STILL_S) -> tuple[Floats, Floats]:
    """The least and the greatest of the ``rows`` values from each on; NaN where one is lacking, or the end near."""
    ahead = pd.Series(values[::-1]).rolling(rows)
    return ahead.min().to_numpy()[::-1], ahead.max().to_numpy()[::-1]


def _running_range(values: Floats, rows: int = STILL_S) -> Floats:
    lowest, highest = _running_extremes(values, rows)
    return np.asarray(highest - lowest)


def _holds_for_rows(mask: Bools, rows: int = STILL_S) -> Bools:
    """Whether a mask holds for the ``rows`` values from each on."""
    return np.asarray(_running_range(np.where(mask, 0.0, np.nan), rows) == 0.0)


def _rows_of_windows(starts: Bools, rows: int = STILL_S) -> Bools:
    """Mask of all rows of the windows that start where ``starts`` says."""
    first = np.flatnonzero(starts)
    return mask_of_runs(first, np.minimum(first + rows, starts.size), starts.size)


def _noise_range(sigma: float) -> float:
    """The range that white noise alone gives medians."""
    return float(_RANGE_SIGMAS * _MEDIAN_NOISE * sigma / np.sqrt(_SMOOTHING_S))


def _held_rows(seconds: pd.DataFrame, slow: pd.DataFrame, noise: Mapping[str, float], drives: _Drives) -> Bools:
    moved_m = np.hypot(_running_range(slow["north_m"].to_numpy()), _running_range(slow["east_m"].to_numpy()))
    noise_m = _noise_range(min(max(noise["north_m"], noise["east_m"]), _MOORED.metres))
    turned_deg = _running_range(slow["heading_deg"].to_numpy())
    noise_deg = _noise_range(min(noise["heading_deg"], _FAST.degrees))
    speeds = [name for name in ("surge_mps", "sway_mps") if name in slow]
    speed, noise_mps = np.zeros(len(slow)), 0.0
    for name in speeds:
        speed = np.hypot(speed, slow[name].to_numpy())
        noise_mps = max(noise_mps, 0.5 * _noise_range(min(noise[name], _MOST_NOISE_MPS)))
    fastest_mps = _running_extremes(speed)[1]
    # where neither positions nor speeds change in the last digit a receiver stopped, which is no mooring
    alive = np.zeros(len(slow), dtype=bool)
    for name in ("north_m", "east_m", *speeds):
        alive |= _running_range(seconds[name].to_numpy()) > 0.0

    def lies_still(tolerance: _Tolerance) -> Bools:
        within = (moved_m <= tolerance.metres + noise_m) & (turned_deg <= tolerance.degrees + noise_deg)
        return np.asarray(within & (fastest_mps <= tolerance.mps + noise_mps) & alive)

    calm, held = _rows_of_windows(lies_still(_MOORED)), _rows_of_windows(lies_still(_FAST) & drives.push)
    uncontrolled = _rows_of_windows(drives.constant & _holds_for_rows(calm, _CONSTANT_S), _CONSTANT_S)
    for first, stop in zip(*edges_of_runs(calm), strict=True):
        held[first:stop] |= bool(uncontrolled[first:stop].mean() >= _UNCONTROLLED)
    held |= _rows_of_windows(_holds_for_rows(uncontrolled & calm))
    return _without_departures(seconds, noise, held)


def _without_departures(seconds: pd.DataFrame, noise: Mapping[str, float], held: Bools) -> Bools:
    """The rows without those at the ends in which the ship comes to lie, or leaves, within the tolerances."""
    names = [name for name in ("north_m", "east_m", "heading_deg", "surge_mps", "sway_mps") if name in seconds]
    limit = dict(zip(names, (_EDGE_M, _EDGE_M, _EDGE_DEG, _EDGE_MPS, _EDGE_MPS), strict=False))
    near = seconds[names].rolling(_EDGE_SMOOTHING_S, center=True, min_periods=1).median()
    result = held.copy()
    for first, stop in zip(*edges_of_runs(held), strict=True):
        for inwards in (slice(first, stop), slice(stop - 1, first - 1 if first else None, -1)):
            values = near.iloc[inwards]
            inside = values.iloc[_EDGE_S:STILL_S]
            place, reach = inside.median(), 0.5 * (inside.max() - inside.min())
            displaced = np.zeros(len(values), dtype=bool)
            for name in names:
                centre = 0.0 if name.endswith("_mps") else place[name]
                tolerance = limit[name] + reach[name] + 4.0 * noise[name] / np.sqrt(_EDGE_SMOOTHING_S)
                displaced |= np.abs(values[name].to_numpy() - centre) > tolerance
            departed = np.flatnonzero(displaced[:_EDGE_S])
            if departed.size:
                result[np.arange(len(held))[inwards][: departed[-1] + 1]] = False
    return result


def _towed_rows(slow: pd.DataFrame, drives: _Drives) -> Bools:
    if not {"surge_mps", "sway_mps"} <= set(slow) or not drives.turned:
        return np.zeros(len(slow), dtype=bool)
    surge = slow["surge_mps"].to_numpy()
    bow_first = drives.idle & (surge >= _TOWED_MPS) & (np.abs(slow["sway_mps"].to_numpy()) <= _DRIFT_ANGLE * surge)
    if "speed_through_water_mps" in slow:
        bow_first &= ~(slow["speed_through_water_mps"].to_numpy() < _TOWED_MPS)
    later = np.append(surge[TOWED_S - 1 :], np.full(min(TOWED_S - 1, surge.size), np.nan))[: surge.size]
    return _rows_of_windows(_holds_for_rows(bow_first, TOWED_S) & (later >= _SLOWED * surge), TOWED_S)
