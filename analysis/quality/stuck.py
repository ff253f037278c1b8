"""Values that stand still although the channel lives: exact repeats beyond the channel's own habit.

A long repeat alone proves nothing: a thruster at rest, a held order, an assumed constant and a still ship on a
coarse sensor repeat for minutes. Two things prove it: the channel's own noise, there right before and after,
is gone; or related channels show motion that this one would have had to follow.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from acquisition.core.arrays import Floats, Ints
from acquisition.core.channels import Channel
from acquisition.core.frames import Quality
from analysis.quality.findings import Flags
from analysis.quality.quantisation import grid_step, noise_beside
from analysis.quality.samples import flags_where, in_time, times_of, turns_between
from analysis.tables.time_index import NANO

_SHORTEST, _BESIDE = 8, 100
_LIKELY = 1e-4
_TURNING = 0.3
_LEAST_TRAVEL = {"m": 1.0, "deg": 1.0}


def stuck(samples: pd.Series[Any], channel: Channel, rate: pd.Series[Any] | None = None) -> Flags:
    """Bad where the value stands still, from the second of the repeated values on.

    ``rate`` is how fast related channels say that this one changes [its unit per s], at times of its own: yaw
    rate for the heading, speed over ground for a position.
    """
    places, times, values = in_time(samples, channel)
    bad = np.zeros(len(samples), dtype=bool)
    starts, lengths = _repeats(values, channel)
    coarse = lengths.size > 1 and _coarse(values)
    always_moves = channel.group != "command" and _never_repeats(values, lengths)
    for start, length in zip(starts, lengths, strict=True):
        inside = slice(start, start + length)
        usual = not coarse or length >= 5 * np.sort(lengths)[-2]
        silent = (
            usual
            and not _at_rest(float(values[start]), channel)
            and _noise_is_gone(values, start, length, always_moves)
        )
        if silent or _should_have_moved(times[inside], values, channel, rate):
            bad[places[start + 1 : start + length]] = True
    return flags_where(bad, Quality.BAD, samples.to_numpy(dtype=float))


def _repeats(values: Floats, channel: Channel) -> tuple[Ints, Ints]:
    """First places and lengths of the runs of one value, from eight samples on."""
    if values.size < 2 * _SHORTEST:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    changes = np.flatnonzero(turns_between(values, channel.circular) != 0.0) + 1
    starts = np.concatenate([[0], changes])
    lengths = np.diff(np.concatenate([starts, [values.size]]))
    long = lengths >= _SHORTEST
    return starts[long], lengths[long]


def _at_rest(value: float, channel: Channel) -> bool:
    """A stopped thruster, a ship alongside and calm air are silent by themselves."""
    return value == 0.0 and (channel.unit in ("rpm", "m/s", "deg/s") or channel.group == "environment")


def _coarse(values: Floats) -> bool:
    """Whether the channel is on a grid wider than its noise, and so stands on it for a long time now and then."""
    step = grid_step(values)
    return step > 0.0 and step > noise_beside(values, step)


def _never_repeats(values: Floats, lengths: Ints) -> bool:
    """Whether values repeat in less than one of a hundred samples, but for the long runs."""
    repeats = np.count_nonzero(np.diff(values) == 0.0) - int(np.sum(lengths - 1))
    return bool(repeats < 0.01 * values.size)


def _noise_is_gone(values: Floats, start: int, length: int, always_moves: bool) -> bool:
    """Whether both sides of a run (one at the ends) are noisy, and too lively for the run to be chance.

    Noisy: a third of the changes turn back at once, two thirds being white noise; a motion that never repeats
    a value need not be noisy, as it cannot hold still either, but an order can. Chance: the share of repeats
    on a side to the power of the run's length, times the samples of the record; and the run is five times as
    long as the longest beside it.
    """
    left = values[max(start - _BESIDE, 0) : start]
    right = values[start + length : start + length + _BESIDE]
    sides = [side for side in (left, right) if side.size >= _SHORTEST]
    if always_moves and len(sides) < 2:  # a simulated ship may start without moving
        always_moves = False
    return bool(sides) and all(_lively(side, length, values.size, always_moves) for side in sides)


def _lively(side: Floats, length: int, total: int, always_moves: bool) -> bool:
    steps = np.diff(side)
    moved = steps[steps != 0.0]
    if moved.size < _SHORTEST // 2 or (not always_moves and np.mean(moved[1:] * moved[:-1] < 0.0) < _TURNING):
        return False
    repeats = (np.sum(steps == 0.0) + 1.0) / (steps.size + 2.0)
    if repeats > 0.5:  # stairs, as a held order goes up and down, are no noise
        return False
    edges = np.flatnonzero(np.concatenate([[True], steps != 0.0, [True]]))
    return bool(total * repeats**length < _LIKELY and length >= 5 * np.diff(edges).max())


def _should_have_moved(times: Ints, values: Floats, channel: Channel, rate: pd.Series[Any] | None) -> bool:
    """Whether the rate adds up to more than five of the channel's usual steps, and 1 m or 1 deg, in the run."""
    if rate is None or channel.unit not in _LEAST_TRAVEL:
        return False
    at = times_of(rate)
    first, last = np.searchsorted(at, times[[0, -1]])
    if last - first < 2:
        return False
    seconds, rates = at[first:last] / NANO, rate.to_numpy(dtype=float)[first:last]
    travel = abs(float(np.trapezoid(rates, seconds)))
    steps = np.abs(np.diff(values))
    usual = float(np.quantile(steps[steps > 0.0], 0.1)) if np.any(steps > 0.0) else np.inf
    return travel > max(5.0 * usual, _LEAST_TRAVEL[channel.unit])


def following_rates(table: pd.DataFrame) -> dict[str, pd.Series[Any]]:
    """How fast the pose should change by the speeds, the yaw rate and the heading: north, east, heading.

    Channels need not share rows: the last heading stands where the speeds have none. What lacks a channel is
    left out.
    """
    rates: dict[str, pd.Series[Any]] = {}
    if "yaw_rate_dps" in table:
        rates["heading_deg"] = table["yaw_rate_dps"].dropna()
    if {"surge_mps", "sway_mps", "heading_deg"} <= set(table.columns):
        moving = table[["surge_mps", "sway_mps", "heading_deg"]].ffill().dropna()
        psi = np.deg2rad(moving["heading_deg"])
        rates["north_m"] = moving["surge_mps"] * np.cos(psi) - moving["sway_mps"] * np.sin(psi)
        rates["east_m"] = moving["surge_mps"] * np.sin(psi) + moving["sway_mps"] * np.cos(psi)
    return {name: rate for name, rate in rates.items() if len(rate)}
