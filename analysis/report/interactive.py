"""A trial as one page to zoom into: the track and the time series, linked, in a file that needs no network.

``interactive.js`` beside the page's template draws with plotly, which is embedded and is an extra of the
installation. It draws plain values and computes none of them: thinned where there is too much, rounded. An angle is
drawn as one line that runs on beyond the whole turn (``drawn``), its axis names the angles of the turn; one that
changes too fast for that is cut where it wraps. Times are seconds since the page's first row; a ``lift`` is a row
before which a line must not be joined to the row before it.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from markupsafe import Markup

from seatrial.acquisition.core import errors, ship
from seatrial.acquisition.core.quantities import Floats, Ints
from seatrial.analysis.report import pages, plots
from seatrial.analysis.tables.table import NANO, declared_channels, table_actuators, times_ns, trial_channels
from seatrial.analysis.windows.held import held_spans_ns

if TYPE_CHECKING:
    from seatrial.analysis.manoeuvres.indices import Manoeuvre

MOST_ROWS = 20_000
"""Rows that a browser draws at once without a pause; of more, those with extremes are kept."""
MOST_PREDICTED = 12_000
"""Rows of one method's predictions; of more, every second, third, ... window is kept."""
DECIMALS = {"m": 2, "deg": 2, "m/s": 3, "deg/s": 3, "rpm": 1, "%": 1}
"""Decimals by unit: finer than any sensor aboard, and a third of the digits of a double."""

_MILLI = NANO // 1000
_MOST_STEP_DEG = 90.0  # between rows; an angle that changes more may have gone either way round
_HOLE = 2.5  # a line is lifted where rows are further apart than this many of the usual steps
_PANEL_PX, _FRAME_PX = 120, 104
_TRACK_PX = (260, 640)  # a track to scale should fill its picture, within reason
_TRACK_WIDTH_PX = 500
_NOTHING_LOADED = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:; "
    "worker-src blob:"
)
"""The page's content security policy: nothing may be fetched, not even by the embedded library."""
_KNOWN_METHODS = {"constant_velocity": 3, "reference": 4, "data_driven": 2, "hybrid": 0}
_ACTUATOR_COLOURS = (4, 2, 0, 1, 3, 5, 6)
"""Places in the palette of a ship's actuators, in their order."""


def interactive_page(
    table: pd.DataFrame,
    windows: pd.DataFrame | None = None,
    predicted: Mapping[str, pd.DataFrame] | None = None,
    manoeuvres: Iterable[Manoeuvre] = (),
    title: str = "",
    subtitle: str = "",
) -> pages.Page:
    """The whole page: track and time series of one trial.

    ``table`` is indexed by UTC, as resampled to 1 Hz or faster, and holds any channels of a trial in their own
    units; above 20,000 rows it is thinned with all extremes kept, and the page says so. ``windows`` is the long
    table of this trial's held windows. ``predicted`` has by method's name a table indexed by UTC, with any of
    ``north_m``, ``east_m``, ``heading_deg``, ``surge_mps``, ``sway_mps``, ``yaw_rate_dps`` and the number of the
    ``window``, without which a line ends where time does not go on.

    Raises :class:`ConfigurationError` without plotly, :class:`DataShortageError` for a table without rows or
    without any channel and :class:`InputError` for one whose index is not UTC in increasing order.
    """
    try:
        from plotly.offline import get_plotlyjs
    except ImportError as error:
        raise errors.ConfigurationError(
            "the interactive page needs the package plotly", fix="pip install 'seatrial[interactive]'"
        ) from error
    data = page_data(table, windows, predicted, manoeuvres)
    data["style"] = _style(data, table)
    channels = ship.channels_by_name_of(table.attrs)
    data["angles"] = {name: min(channels[name].low, 0) for name in data["channels"] if channels[name].circular}
    track_px = 0
    if {"north_m", "east_m"} <= set(data["channels"]):
        north, east = (
            np.ptp([x for x in data["channels"][name] if x is not None]) for name in ("north_m", "east_m")
        )
        track_px = round(float(np.clip(80 + 1.1 * _TRACK_WIDTH_PX * north / max(east, 1e-3), *_TRACK_PX)))
    css, script = (Markup((pages.TEMPLATES / f"interactive.{kind}").read_text("utf-8")) for kind in ("css", "js"))
    # JSON that no text in it can end: what looks like markup is escaped.
    text = json.dumps(data, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    return pages.render(
        "interactive.html", title=title or "Trial", subtitle=subtitle, data=data, json=Markup(text),
        figures=_axis_figures(data, trial_channels(table)), notes=_notes(data, trial_channels(table)),
        policy=Markup(_NOTHING_LOADED), css=css, library=Markup(get_plotlyjs()), script=script,
        held=plots.held_controls_in_words(table), track_px=track_px,
        series_px=_FRAME_PX + _PANEL_PX * len(data["style"]["panels"]),
    )  # fmt: skip


def _style(data: Mapping[str, Any], table: pd.DataFrame) -> dict[str, Any]:
    """Colours, panels, labels and decimals: what the page looks like, in the house's palette."""
    present, actuators, channels = (
        list(data["channels"]),
        table_actuators(table),
        ship.channels_by_name_of(table.attrs),
    )
    spare = [number for number in range(len(plots.PALETTE)) if number not in _KNOWN_METHODS.values()]
    methods = {
        name: plots.PALETTE[_KNOWN_METHODS.get(name, spare[number % len(spare)])]
        for number, name in enumerate(data["predicted"])
    }
    groups = sorted(plots.control_groups(actuators).items(), key=lambda group: "[rpm]" not in group[0])
    panels = [
        *((plots.axis_label(name), (name,)) for name in ship.POSE_AND_VELOCITY[2:]),
        *groups,
        (plots.axis_label("wind_speed_mps"), ("wind_speed_mps",)), ("wind from [deg]", ("wind_direction_deg",)),
        *plots.declared_groups(table).items(),
    ]  # fmt: skip
    orders = {order.name: channel.name for actuator in actuators
              for channel, order in zip(actuator.channels, actuator.orders, strict=True)}  # fmt: skip
    panels = [(title, (*names, *(order for order, control in orders.items() if control in names)))
              for title, names in panels]  # fmt: skip
    shown = [{"title": title, "names": [name for name in names if name in present]} for title, names in panels]
    controls = {
        channel.name: {
            "actuator": actuator.name.replace("_", " "),
            "colour": plots.PALETTE[_ACTUATOR_COLOURS[number % len(plots.PALETTE)]],
            "width": 1.2 if number else 2.6,  # a rim where others lie on it
        }
        for number, actuator in enumerate(actuators)
        for channel in actuator.channels
    }
    ordered = {order: {**controls[control], "width": 1.2, "dash": "dash"} for order, control in orders.items()}
    return {
        "colours": {
            "ink": plots.INK, "faint": plots.FAINT, "held": plots.HELD, "grid": "#E6E6E6",
            "manoeuvre": plots.PALETTE[1],
        },
        "controls": {**controls, **ordered},
        "methods": methods,
        "panels": [panel for panel in shown if panel["names"]] or shown[:1],  # the cursor needs an axis of time
        "labels": {name: plots.axis_label(name, channels) for name in ("north_m", "east_m", *present)},
        "decimals": {name: decimals_of_channel(channels[name]) for name in present},
    }  # fmt: skip


def _axis_figures(data: Mapping[str, Any], channels: tuple[str, ...]) -> dict[str, str]:
    figures = {
        "duration": pages.duration_text(data["time_s"][-1]),
        "rows": f"{data['rows']:,}",
        "channels": f"{len([name for name in channels if name in data['channels']])} of {len(channels)}",
    }
    if data["held"]:
        held_s = sum(end - begin for begin, end in data["held"])
        figures |= {"held": f"{held_s / 60:.1f} min", "legs": str(data["legs"])}
    if data["manoeuvres"]:
        figures["manoeuvres"] = str(len(data["manoeuvres"]))
    return figures


def _notes(data: Mapping[str, Any], channels: tuple[str, ...]) -> list[str]:
    """What the reader has to know of the values that are shown."""
    notes = []
    shown = len(data["time_s"])
    if shown < data["rows"]:
        notes.append(
            f"Of {data['rows']:,} rows {shown:,} are shown: of every stretch the first, and each channel's least "
            "and greatest value."
        )
    missing = [name for name in channels if name not in data["channels"]]
    if missing:
        notes.append(f"Without {', '.join(missing)}.")
    strides = {method: prediction["every"] for method, prediction in data["predicted"].items()}
    for number in sorted(set(strides.values()) - {1}):
        which = ", ".join(method.replace("_", " ") for method in strides if strides[method] == number)
        notes.append(f"Of the predictions ({which}) one window in {number} is shown.")
    return notes


def page_data(
    table: pd.DataFrame,
    windows: pd.DataFrame | None = None,
    predicted: Mapping[str, pd.DataFrame] | None = None,
    manoeuvres: Iterable[Manoeuvre] = (),
) -> dict[str, Any]:
    """Everything that the page draws, fit for JSON: NaN is null, times count from ``start_ms`` [ms since 1970].

    ``table`` holds any of the channels of a trial, in order of time. ``windows`` is the long table of held windows,
    ``predicted`` has a table of pose and velocity by method, with the number of the ``window``.
    Raises :class:`InputError` for a table that is not in order of time, :class:`DataShortageError` for one
    without rows or without any channel.
    """
    time_ns = times_ns(table)
    if time_ns.size == 0:
        raise errors.DataShortageError("the table has no row to show", fix="give a recording with samples")
    if np.any(np.diff(time_ns) <= 0):
        raise errors.InputError(
            "the table's times do not increase", fix="sort it and drop duplicate times, or resample it"
        )
    channels = trial_channels(table)
    declared = [channel.name for channel in declared_channels(table)]
    orders = [order.name for actuator in table_actuators(table) for order in actuator.orders]
    names = [name for name in (*channels, *declared, *orders) if name in table and table[name].notna().any()]
    if not names:
        raise errors.DataShortageError(
            f"the table has none of the {len(channels)} channels", fix="name its columns with a column map"
        )
    holes = rows_after_holes(time_ns)
    rows = select_rows({name: table[name].to_numpy(dtype=float) for name in names}, holes, time_ns.size)
    start_ms = int(time_ns[0] // _MILLI)
    steady = {}  # the angles that can be followed from row to row, which run on beyond the whole turn
    for name in names:
        if ship.channels_by_name_of(table.attrs)[name].circular:
            angle = ship.unwrap(table[name].to_numpy(dtype=float))
            if (np.abs(np.diff(angle[np.isfinite(angle)])) <= _MOST_STEP_DEG).all():
                steady[name] = angle
    drawn = pd.DataFrame(steady, index=table.index)
    held_ns = np.empty((0, 2)) if windows is None else held_spans_ns(windows)
    spans = []
    for manoeuvre in manoeuvres:
        times = (manoeuvre.start, manoeuvre.end, *manoeuvre.executes)
        begin, end, *changes = (float(np.round(time.timestamp() - start_ms / 1000.0, 3)) for time in times)
        spans.append({"name": manoeuvre.name, "side": manoeuvre.side, "start_s": begin, "end_s": end,
                      "executes_s": changes})  # fmt: skip
    return {
        "start_ms": start_ms,
        "rows": int(time_ns.size),
        "time_s": seconds_since(time_ns[rows], start_ms),
        **_page_columns(table.iloc[rows], names, drawn.iloc[rows]),
        "holes": np.searchsorted(rows, holes).tolist(),
        "legs": 0 if windows is None else int(windows["leg"].nunique()),
        "held": np.round((held_ns / _MILLI - start_ms) / 1000.0, 3).tolist(),
        "predicted": {name: _prediction_data(motion, start_ms, drawn)
                      for name, motion in (predicted or {}).items()},
        "manoeuvres": spans,
    }  # fmt: skip


def _page_columns(table: pd.DataFrame, names: Iterable[str], drawn: pd.DataFrame) -> dict[str, Any]:
    """The channels of a table, how angles are ``drawn``, and of others the rows at which a line would cross the
    turn."""
    channels = ship.channels_by_name_of(table.attrs)
    shown = {name: round_values(channels[name], table[name].to_numpy(dtype=float)) for name in names}
    cut = [name for name in shown if channels[name].circular and name not in drawn]
    return {
        "channels": {name: nan_to_none(values) for name, values in shown.items()},
        "drawn": {str(name): nan_to_none(drawn[name].round(DECIMALS["deg"]).to_numpy()) for name in drawn},
        "lifts": {name: ship.full_circle_jumps(shown[name]).tolist() for name in cut},
    }


def decimals_of_channel(channel: ship.Channel) -> int:
    """How many decimals of a channel are shown: those of its unit, else a ten-thousandth of its range."""
    decimals = int(np.clip(np.ceil(4.0 - np.log10(channel.high - channel.low)), 0, 6))
    return decimals if channel.group == "declared" else DECIMALS[channel.unit]


def round_values(channel: ship.Channel, values: Floats) -> Floats:
    """Values of a channel with the decimals of its unit; angles stay inside their turn."""
    decimals = decimals_of_channel(channel)
    rounded = np.round(values, decimals)
    return np.round(ship.wrap_to_range(channel, rounded), decimals) + 0.0  # no -0.0


def nan_to_none(values: Floats) -> list[float | int | None]:
    """Numbers for JSON, whole ones without a point, None for NaN and infinities.

    >>> nan_to_none(np.array([1.0, 2.5, np.nan]))
    [1, 2.5, None]
    """
    numbers = (value if np.isfinite(value) else None for value in values.tolist())
    return [int(value) if value is not None and value.is_integer() else value for value in numbers]


def seconds_since(time_ns: Ints, start_ms: int) -> list[float | int | None]:
    """Times as seconds since ``start_ms`` [ms since 1970], to the millisecond."""
    return nan_to_none((np.round(time_ns / _MILLI).astype(np.int64) - start_ms) / 1000.0)


def rows_after_holes(time_ns: Ints) -> Ints:
    """The rows that come after a hole in time."""
    step = np.diff(time_ns)
    return np.flatnonzero(step > _HOLE * np.median(step)) + 1 if step.size else np.empty(0, dtype=np.int64)


def select_rows(columns: Mapping[str, Floats], holes: Ints, rows: int, most: int = MOST_ROWS) -> Ints:
    """The rows to show: all of them, or at most ``most`` with every channel's extremes.

    The rows are cut into stretches of equal length, as many as fit. Of each stretch the first row is kept, each
    channel's least and greatest and the first at which it is missing, so that no peak and no hole is lost.
    """
    if rows <= most:
        return np.arange(rows)
    length = -(-rows // most)
    while True:
        first = np.arange(0, rows, length)
        kept = np.zeros(first.size * length, dtype=bool)
        kept[first] = True
        kept[[0, rows - 1, *holes, *(holes - 1)]] = True
        for values in columns.values():
            padded = np.full(kept.size, np.inf)
            padded[:rows] = values
            stretches = padded.reshape(-1, length)
            finite = np.isfinite(stretches)
            kept[first + np.where(finite, stretches, np.inf).argmin(axis=1)] = True
            kept[first + np.where(finite, stretches, -np.inf).argmax(axis=1)] = True
            kept[first + np.isnan(stretches).argmax(axis=1)] = True
        kept = kept[:rows]
        if kept.sum() <= most or length > rows:
            return np.flatnonzero(kept)
        length = max(length + 1, int(1.3 * length))


def _prediction_data(predicted: pd.DataFrame, start_ms: int, drawn: pd.DataFrame) -> dict[str, Any]:
    """One method's predictions, angles near those that are ``drawn``; ``every`` says that every n-th window was
    kept, ``holes`` where a window begins."""
    stride = max(-(-len(predicted) // MOST_PREDICTED), 1)
    if "window" in predicted:  # numbered in the order of the rows
        number = np.asarray(pd.factorize(predicted["window"])[0], dtype=np.int64)
    else:  # another begins where time does not go on
        time_ns = times_ns(predicted)
        is_new = np.diff(time_ns) <= 0
        is_new[rows_after_holes(time_ns) - 1] = True
        number = np.cumsum(np.append(0, is_new)) if time_ns.size else np.empty(0, dtype=np.int64)
    chosen = np.flatnonzero(number % stride == 0)
    kept = predicted.iloc[chosen]
    nearest = drawn.index.get_indexer(kept.index, method="nearest")
    angles = kept[[name for name in kept if name in drawn]]
    measured = drawn[list(angles)].ffill().bfill().to_numpy()[nearest]
    angles = angles + 360.0 * np.round((measured - angles) / 360.0)  # in the turn in which it is drawn
    return {
        "every": stride,
        "time_s": seconds_since(times_ns(kept), start_ms),
        **_page_columns(kept, [name for name in ship.POSE_AND_VELOCITY if name in kept], angles),
        "holes": (np.flatnonzero(np.diff(number[chosen])) + 1).tolist(),
    }
