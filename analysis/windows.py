"""Held windows: stretches of a 1 Hz table over which the thrusters were held.

A window is kept when no channel has a hole in it and every thruster channel stayed where it was. Noise on the
feedback must not defeat that, so what is allowed grows with the channel's own noise; a slow ramp must not pass,
so the drift over the window is bounded more tightly than the range. An azimuth counts although its propeller
may stand still: its wake and its next use depend on it, and the rule stays the paper's.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from acquisition.angles import difference, unwrap
from acquisition.channels import CIRCULAR, COMMAND, NAMES
from acquisition.errors import DataShortageError, InputError
from analysis.resample import resample
from analysis.table import read_table, require, select

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

TOLERANCE: dict[str, float] = {name: 2.0 if name in CIRCULAR else 4.0 for name in COMMAND}
"""How far a noiseless thruster channel may move within a window [deg or rpm]."""
_LARGEST_NOISE = {name: 2.5 if name in CIRCULAR else 6.0 for name in COMMAND}
_RANGE_OF_NOISE = 7.0  # the range of 16 to 61 normal samples stays below 7 deviations in 999 of 1000 windows
_DRIFT_OF_NOISE = 4.0
_REASONS = {
    "port_rpm": "rpm_moved", "starboard_rpm": "rpm_moved", "port_angle_deg": "azimuth_moved",
    "starboard_angle_deg": "azimuth_moved", "tunnel_rpm": "tunnel_moved",
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class HeldWindows:
    """Windows as a long table, one row a window and second: ``window``, ``second``, the 13 channels,
    ``trial``, ``leg``, ``start``; how many were looked at, and why the others were dropped.
    """

    rows: pd.DataFrame
    candidates: int
    kept: int
    dropped: dict[str, int]


def held_windows(
    table: pd.DataFrame,
    horizon_s: int = 15,
    stride_s: int = 5,
    tolerance: Mapping[str, float] = TOLERANCE,
    trial: str = "trial",
) -> HeldWindows:
    """The held windows of ``horizon_s`` seconds in a 1 Hz table, one tried every ``stride_s`` seconds.

    Legs are named ``trial/001`` on. Raises :class:`InputError` when a channel is missing, the table is not
    at 1 Hz, or horizon or stride is not a positive number of seconds.
    """
    require(table)
    _check(table, horizon_s, stride_s)
    values = table[list(NAMES)].to_numpy(float)
    starts = np.arange(0, max(len(table) - horizon_s, 0), stride_s)
    reason = _reasons(values, starts, horizon_s, tolerance)
    kept = starts[reason == ""]
    dropped = {str(name): int(count) for name, count in zip(*np.unique(reason, return_counts=True), strict=True)}
    dropped.pop("", None)
    legs = _legs(values, kept, horizon_s, tolerance)
    rows = _rows(table, values, kept, horizon_s, trial, legs)
    return HeldWindows(rows, len(starts), len(kept), dropped)


def feedback_noise(values: Floats) -> float:
    """The deviation of the white noise on a feedback signal, from its second differences (robust).

    Ramps and steps leave the second differences alone except at their corners, and the median passes over
    those: 1.4826 MAD / sqrt(6).
    """
    second = values[2:] - 2.0 * values[1:-1] + values[:-2]
    second = second[np.isfinite(second)]
    return float(1.4826 * np.median(np.abs(second)) / np.sqrt(6.0)) if second.size else 0.0


def _check(table: pd.DataFrame, horizon_s: int, stride_s: int) -> None:
    if horizon_s < 1 or stride_s < 1:
        raise InputError("horizon and stride are whole seconds from 1 on", fix="e.g. --horizon 15 --stride 5")
    steps = np.diff(pd.DatetimeIndex(table.index).as_unit("ns").asi8)
    if steps.size and not (steps == 1_000_000_000).all():
        raise InputError("windows are cut from a table at 1 Hz", fix="resample it first")


def _reasons(
    values: Floats, starts: NDArray[np.int64], horizon_s: int, tolerance: Mapping[str, float]
) -> NDArray[np.str_]:
    """Why each candidate is dropped; empty where it is kept. The first reason found counts."""
    reason = np.full(starts.size, "", dtype="<U16")
    if not starts.size:
        return reason
    hole = ~np.isfinite(values).all(axis=1)
    reason[sliding_window_view(hole, horizon_s + 1)[starts].any(axis=1)] = "missing_data"
    for name in COMMAND:
        column = values[:, NAMES.index(name)]
        moved = ~_held(unwrap(column) if name in CIRCULAR else column, starts, horizon_s, name, tolerance[name])
        reason[moved & (reason == "")] = _REASONS[name]
    return reason


def _held(values: Floats, starts: NDArray[np.int64], horizon_s: int, name: str, tolerance: float) -> Mask:
    """Whether a channel stays within its range and does not drift, for each window."""
    noise = min(feedback_noise(values), _LARGEST_NOISE[name])
    windows = sliding_window_view(values, horizon_s + 1)[starts]
    centred = np.arange(horizon_s + 1) - horizon_s / 2.0
    slope = windows @ centred / (centred @ centred)
    slope_noise = noise / np.sqrt(centred @ centred)
    spread = windows.max(axis=1) - windows.min(axis=1)
    drift = np.abs(slope) * horizon_s
    within = spread <= tolerance + _RANGE_OF_NOISE * noise
    return np.asarray(within & (drift <= tolerance + _DRIFT_OF_NOISE * slope_noise * horizon_s))


def _legs(
    values: Floats, starts: NDArray[np.int64], horizon_s: int, tolerance: Mapping[str, float]
) -> NDArray[np.int64]:
    """The number of each window's leg: windows that share a second, or follow each other closely at the
    same setting, are one leg, so that a split by leg never has one second on both sides.
    """
    if not starts.size:
        return np.empty(0, dtype=np.int64)
    columns = [NAMES.index(name) for name in COMMAND]
    setting = np.stack([np.median(values[s : s + horizon_s + 1, columns], axis=0) for s in starts])
    apart = np.diff(starts) > horizon_s
    far = np.diff(starts) > 2 * horizon_s
    changed = np.zeros(starts.size - 1, dtype=bool)
    for column, name in enumerate(COMMAND):
        step = setting[1:, column] - setting[:-1, column]
        step = difference(step, 0.0) if name in CIRCULAR else step
        changed |= np.abs(step) > 2.0 * tolerance[name]
    return np.concatenate([[0], np.cumsum(far | (apart & changed))])


def _rows(
    table: pd.DataFrame,
    values: Floats,
    starts: NDArray[np.int64],
    horizon_s: int,
    trial: str,
    legs: NDArray[np.int64],
) -> pd.DataFrame:
    length = horizon_s + 1
    index = (starts[:, None] + np.arange(length)).ravel()
    rows = pd.DataFrame(values[index], columns=list(NAMES))
    rows.insert(0, "window", np.repeat(np.arange(starts.size), length))
    rows.insert(1, "second", np.tile(np.arange(length), starts.size))
    names = np.array([f"{trial}/{leg + 1:03d}" for leg in legs], dtype=object)
    rows["trial"] = pd.Series([trial] * len(rows), dtype="str")
    rows["leg"] = pd.Series(np.repeat(names, length), dtype="str")
    rows["start"] = pd.DatetimeIndex(table.index)[np.repeat(starts, length)]
    return rows


def windows_of_recordings(
    paths: Sequence[Path],
    horizon_s: int,
    stride_s: int,
    progress: Callable[[float], None] = lambda share: None,
    part_percent: tuple[float, float] = (0.0, 100.0),
) -> HeldWindows:
    """The held windows of recordings at 1 Hz, or of a part of each one's time; trials are named as the files.

    Raises :class:`DataShortageError` with the counts by reason when no window is held in any of them.
    """
    parts = []
    for number, path in enumerate(paths):
        table = resample(select(read_table(path), part_percent), 1.0)
        parts.append(held_windows(table, horizon_s, stride_s, trial=path.stem))
        progress((number + 1) / len(paths))
    found = joined(parts)
    if found.kept == 0:
        reasons = ", ".join(f"{count} {reason}" for reason, count in found.dropped.items()) or "too short"
        raise DataShortageError(
            f"no window of {horizon_s} s in which the thrusters were held",
            where=", ".join(map(str, paths)),
            why=reasons,
            fix="lower --horizon, or give recordings with held stretches",
        )
    return found


def joined(parts: Sequence[HeldWindows]) -> HeldWindows:
    """The windows of several trials in one, numbered on."""
    rows, offset = [], 0
    dropped: dict[str, int] = {}
    for part in parts:
        rows.append(part.rows.assign(window=part.rows["window"] + offset))
        offset += part.kept
        for reason, count in part.dropped.items():
            dropped[reason] = dropped.get(reason, 0) + count
    return HeldWindows(pd.concat(rows, ignore_index=True), sum(part.candidates for part in parts), offset, dropped)


def write_windows(windows: HeldWindows, path: Path) -> None:
    """Write the long table as Parquet."""
    windows.rows.to_parquet(path, index=False)


def read_windows(path: Path) -> pd.DataFrame:
    """Read the long table back. Raises :class:`InputError` when it is none."""
    try:
        rows = pd.read_parquet(path)
    except (OSError, ValueError) as error:
        raise InputError("is no table of windows", where=str(path), why=str(error)) from error
    missing = [name for name in ("window", "second", *NAMES, "trial", "leg", "start") if name not in rows]
    if missing:
        raise InputError(f"lacks {', '.join(missing)}", where=str(path), fix="make it with `seatrial windows`")
    return rows
