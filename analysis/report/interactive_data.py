"""What the interactive page shows, as plain values: thinned where there is too much, rounded, lifted at the wrap.

Times are seconds since the page's first row; a ``lift`` is a row before which a line must not be joined to the
row before it. The page's script draws from these values and computes none of them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from acquisition.core.angles import wrap_180, wrap_360
from acquisition.core.arrays import Floats, Ints
from acquisition.core.channels import BY_NAME, NAMES, is_circular
from acquisition.core.errors import DataShortageError, InputError
from analysis.tables.time_index import NANO, times_ns

if TYPE_CHECKING:
    from analysis.manoeuvres import Manoeuvre


MOST_ROWS = 20_000
"""Rows that a browser draws at once without a pause; of more, those with extremes are kept."""
MOST_PREDICTED = 12_000
"""Rows of one method's predictions; of more, every second, third, ... window is kept."""
PREDICTED = ("north_m", "east_m", "heading_deg", "surge_mps", "sway_mps", "yaw_rate_dps")
DECIMALS = {"m": 2, "deg": 2, "m/s": 3, "deg/s": 3, "rpm": 1}
"""Decimals by unit: finer than any sensor aboard, and a third of the digits of a double."""

_MILLI = NANO // 1000
_HOLE = 2.5  # a line is lifted where rows are further apart than this many of the usual steps


def page_data(
    table: pd.DataFrame,
    windows: pd.DataFrame | None = None,
    predicted: Mapping[str, pd.DataFrame] | None = None,
    manoeuvres: Iterable[Manoeuvre] = (),
) -> dict[str, Any]:
    """Everything that the page draws, fit for JSON: NaN is null, times count from ``start_ms`` [ms since 1970].

    ``table`` holds any of the 13 channels, in order of time. ``windows`` is the long table of held windows,
    ``predicted`` has a table of :data:`PREDICTED` by method, with the number of the ``window``.
    Raises :class:`InputError` for a table that is not in order of time, :class:`DataShortageError` for one
    without rows or without any channel.
    """
    time_ns = times_ns(table)
    if time_ns.size == 0:
        raise DataShortageError("the table has no row to show", fix="give a recording that holds samples")
    if np.any(np.diff(time_ns) <= 0):
        raise InputError("the table's times do not increase", fix="sort it and drop double times, or resample it")
    names = [name for name in NAMES if name in table and table[name].notna().any()]
    if not names:
        raise DataShortageError("the table has none of the 13 channels", fix="name its columns with a column map")
    columns = {name: table[name].to_numpy(dtype=float) for name in names}
    holes = holes_of(time_ns)
    rows = kept_rows(columns, holes, time_ns.size)
    start_ms = int(time_ns[0] // _MILLI)
    shown = {name: rounded(name, values[rows]) for name, values in columns.items()}
    broken = np.searchsorted(rows, holes)
    return {
        "start_ms": start_ms,
        "rows": int(time_ns.size),
        "time_s": seconds_since(time_ns[rows], start_ms),
        "channels": {name: nullable(values) for name, values in shown.items()},
        "holes": broken.tolist(),
        "lifts": {name: wraps_of(values) for name, values in shown.items() if is_circular(name)},
        "legs": [] if windows is None else leg_stretches(windows, start_ms),
        "held": [] if windows is None else held_stretches(windows, start_ms),
        "predicted": {name: prediction_data(each, start_ms) for name, each in (predicted or {}).items()},
        "manoeuvres": [_manoeuvre(each, start_ms) for each in manoeuvres],
    }


def rounded(name: str, values: Floats) -> Floats:
    """Values of a channel with the decimals of its unit; angles stay inside their turn."""
    channel = BY_NAME[name]
    decimals = DECIMALS[channel.unit]
    short = np.round(values, decimals)
    if not channel.circular:
        return short + 0.0  # -0.0 is no news to anybody
    return np.round(wrap_180(short) if channel.low < 0 else wrap_360(short), decimals) + 0.0


def nullable(values: Floats) -> list[float | int | None]:
    """Numbers for JSON, whole ones without a point, None for NaN and infinities.

    >>> nullable(np.array([1.0, 2.5, np.nan]))
    [1, 2.5, None]
    """
    return [None if not np.isfinite(each) else int(each) if each.is_integer() else each for each in values.tolist()]


def seconds_since(time_ns: Ints, start_ms: int) -> list[float | int | None]:
    """Times as seconds since ``start_ms`` [ms since 1970], to the millisecond."""
    return nullable((np.round(time_ns / _MILLI).astype(np.int64) - start_ms) / 1000.0)


def holes_of(time_ns: Ints) -> Ints:
    """The rows that come after a hole in time."""
    step = np.diff(time_ns)
    return np.flatnonzero(step > _HOLE * np.median(step)) + 1 if step.size else np.empty(0, dtype=np.int64)


def wraps_of(angle_deg: Floats) -> list[int]:
    """The rows at which a drawn line would cross the whole turn.

    >>> wraps_of(np.array([350.0, 359.0, 1.0, np.nan, 359.0]))
    [2]
    """
    with np.errstate(invalid="ignore"):
        return (np.flatnonzero(np.abs(np.diff(angle_deg)) > 180.0) + 1).tolist()


def kept_rows(columns: Mapping[str, Floats], holes: Ints, rows: int, most: int = MOST_ROWS) -> Ints:
    """The rows to show: all of them, or at most ``most`` with every channel's extremes.

    The rows are cut into stretches of equal length, as many as fit. Of each stretch the first row is kept, each
    channel's least and greatest and the first at which it is missing, so that no peak and no hole is lost.
    """
    if rows <= most:
        return np.arange(rows)
    length = -(-rows // most)
    while True:
        kept = np.zeros(rows, dtype=bool)
        kept[::length] = True
        kept[[0, rows - 1, *holes, *(holes - 1)]] = True
        for values in columns.values():
            kept[_telling(values, length)] = True
        if kept.sum() <= most or length > rows:
            return np.flatnonzero(kept)
        length = max(length + 1, int(1.3 * length))


def _telling(values: Floats, length: int) -> Ints:
    """The rows of the least, the greatest and the first missing value of every stretch of ``length`` rows."""
    padded = np.full(-(-values.size // length) * length, np.inf)
    padded[: values.size] = values
    first = np.arange(0, padded.size, length)
    stretches = padded.reshape(-1, length)
    known = np.isfinite(stretches)
    least = np.where(known, stretches, np.inf).argmin(axis=1)
    greatest = np.where(known, stretches, -np.inf).argmax(axis=1)
    rows = np.concatenate([first + least, first + greatest, first + np.isnan(stretches).argmax(axis=1)])
    return rows[rows < values.size]


def held_stretches(windows: pd.DataFrame, start_ms: int) -> list[list[float]]:
    """Begin and end [s] of every stretch of windows that overlap or touch."""
    chosen = windows[windows["held"]] if "held" in windows else windows
    if chosen.empty:
        return []
    first = pd.DatetimeIndex(chosen.groupby("window")["start"].first()).as_unit("ns").asi8
    begin_s = np.sort((first / _MILLI - start_ms) / 1000.0)
    end_s = begin_s + float(chosen["second"].max())
    new = np.append(True, begin_s[1:] > end_s[:-1])
    last = np.append(new[1:], True)
    return [[round(begin, 3), round(end, 3)] for begin, end in zip(begin_s[new], end_s[last], strict=True)]


def leg_stretches(windows: pd.DataFrame, start_ms: int) -> list[dict[str, Any]]:
    """The stretches of every leg, in the order in which the legs appear."""
    return [
        {"leg": str(name), "held": held_stretches(rows, start_ms)}
        for name, rows in windows.groupby("leg", sort=False)
    ]


def prediction_data(predicted: pd.DataFrame, start_ms: int) -> dict[str, Any]:
    """One method's predictions; ``every`` says that every n-th window was kept, ``lifts`` where one begins."""
    every = -(-len(predicted) // MOST_PREDICTED)
    number = _window_numbers(predicted)
    chosen = np.flatnonzero(number % max(every, 1) == 0)
    begins = (np.flatnonzero(np.diff(number[chosen])) + 1).tolist()
    shown = {
        name: rounded(name, predicted[name].to_numpy(dtype=float)[chosen])
        for name in PREDICTED
        if name in predicted
    }
    turns = {name: wraps_of(values) for name, values in shown.items() if is_circular(name)}
    return {
        "every": max(every, 1),
        "time_s": seconds_since(times_ns(predicted)[chosen], start_ms),
        "channels": {name: nullable(values) for name, values in shown.items()},
        "holes": begins,
        "lifts": turns,
    }


def _window_numbers(predicted: pd.DataFrame) -> Ints:
    """0, 1, 2, ... by window in the order of the rows; without a column ``window``, where time does not go on."""
    if "window" in predicted:
        return np.asarray(pd.factorize(predicted["window"])[0], dtype=np.int64)
    time_ns = times_ns(predicted)
    new = np.diff(time_ns) <= 0
    new[holes_of(time_ns) - 1] = True
    return np.cumsum(np.append(0, new)) if time_ns.size else np.empty(0, dtype=np.int64)


def _manoeuvre(manoeuvre: Manoeuvre, start_ms: int) -> dict[str, Any]:
    """Name, side, begin, end and changes of command [s] of a manoeuvre."""
    times = (manoeuvre.start, manoeuvre.end, *manoeuvre.executes)
    begin, end, *changes = (float(np.round(each.timestamp() - start_ms / 1000.0, 3)) for each in times)
    return {"name": manoeuvre.name, "side": manoeuvre.side, "start_s": begin, "end_s": end, "executes_s": changes}


def panels_of(channels: Iterable[str], panels: Mapping[str, Sequence[str]]) -> list[dict[str, Any]]:
    """Of the panels of time series by title those that have something to show, with the channels that there are.

    The first one stays where there is none: the cursor needs an axis of time.
    """
    there = set(channels)
    chosen = [(title, [name for name in names if name in there]) for title, names in panels.items()]
    return [{"title": title, "names": names} for title, names in chosen if names] or [
        {"title": title, "names": []} for title in list(panels)[:1]
    ]
