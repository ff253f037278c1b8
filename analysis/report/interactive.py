"""A trial as one page to zoom into: the track and the time series, linked, in a file that needs no network.

The values come from :mod:`analysis.report.interactive_data`; ``interactive.js`` beside this module draws
them with plotly, which is embedded and is an extra of the installation.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from html import escape
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

from acquisition.core.channels import BY_NAME, NAMES, is_circular
from acquisition.core.errors import ConfigurationError
from acquisition.core.trial import software_version
from analysis.report.interactive_data import DECIMALS, page_data, panels_of
from analysis.tables.files import atomic_file, expect_suffix

if TYPE_CHECKING:
    import pandas as pd

    from analysis.manoeuvres import Manoeuvre

PANELS = {
    "heading [deg]": ("heading_deg",),
    "surge [m/s]": ("surge_mps",),
    "sway [m/s]": ("sway_mps",),
    "yaw rate [deg/s]": ("yaw_rate_dps",),
    "thrusters [rpm]": ("port_rpm", "starboard_rpm", "tunnel_rpm"),
    "azimuths [deg]": ("port_angle_deg", "starboard_angle_deg"),
    "wind speed [m/s]": ("wind_speed_mps",),
    "wind from [deg]": ("wind_direction_deg",),
}
"""The panels over the axis of time, from above; one without anything to show is left out."""

_PANEL_PX, _FRAME_PX = 120, 104
_TRACK_PX = (260, 640)  # a track to scale should fill its picture, within reason
_TRACK_WIDTH_PX = 500
_NOTHING_LOADED = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:; "
    "worker-src blob:"
)
"""What the browser is told: nothing may be fetched from anywhere, not even by the embedded library."""
_KEY = "Dark: measured. Blue shade: thrusters held. Orange: a manoeuvre; dotted, where its command changed."
_KNOWN_METHODS = {"constant_velocity": 3, "reference": 4, "data_driven": 2, "hybrid": 0}
_SHIP = (
    '<g id="ship"><path id="hull" d="M0,-15 L5,-7 V12 H-5 V-7 Z"/>'
    '<path id="dot" d="M-6,0a6,6 0 1 0 12,0a6,6 0 1 0 -12,0"/></g>'
)
"""The outline, pointing north; a dot where the heading is not known."""


def interactive_page(
    table: pd.DataFrame,
    windows: pd.DataFrame | None = None,
    predicted: Mapping[str, pd.DataFrame] | None = None,
    manoeuvres: Iterable[Manoeuvre] = (),
    title: str = "",
    subtitle: str = "",
) -> str:
    """The whole page as text: track and time series of one trial, to be written with the suffix ``.html``.

    ``table`` is indexed by UTC, as resampled to 1 Hz or faster, and holds any of the 13 channels in their own
    units; above 20,000 rows it is thinned with all extremes kept, and the page says so. ``windows`` is the long
    table of this trial's held windows. ``predicted`` has by method's name a table indexed by UTC, with any of
    ``north_m``, ``east_m``, ``heading_deg``, ``surge_mps``, ``sway_mps``, ``yaw_rate_dps`` and the number of the
    ``window``, without which a line ends where time does not go on.

    Raises :class:`ConfigurationError` without plotly, :class:`DataShortageError` for a table without rows or
    without any channel and :class:`InputError` for one whose index is not UTC in increasing order.
    """
    library = _plotly()
    data = page_data(table, windows, predicted, manoeuvres)
    data |= {"style": _style(data), "angles": [name for name in data["channels"] if is_circular(name)]}
    heading = title or "Trial"
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta http-equiv="Content-Security-Policy" content="{_NOTHING_LOADED}">'
        f'<meta name="viewport" content="width=device-width"><title>{escape(heading)}</title>'
        f"<style>{_beside('interactive.css')}</style></head>\n<body>{_header(heading, subtitle, data)}\n"
        f'<main><section>{_left(data)}</section>\n<section><div class="plot">'
        f'<div id="series" style="height:{_FRAME_PX + _PANEL_PX * len(data["style"]["panels"])}px"></div>'
        f'<div class="line" id="cursor" hidden></div><div class="line" id="hovered" hidden></div></div>'
        f'<p class="soft">{_KEY}</p></section>'
        f'</main>\n<footer class="soft">{escape(software_version())}</footer>\n'
        f'<script type="application/json" id="data">{_json(data)}</script>\n'
        f"<script>{library}</script>\n<script>{_beside('interactive.js')}</script></body></html>\n"
    )


def write_interactive(
    path: Path | str,
    table: pd.DataFrame,
    windows: pd.DataFrame | None = None,
    predicted: Mapping[str, pd.DataFrame] | None = None,
    manoeuvres: Iterable[Manoeuvre] = (),
    title: str = "",
    subtitle: str = "",
) -> Path:
    """Write :func:`interactive_page` to ``path``, complete or not at all; the path that was written.

    Raises what :func:`interactive_page` raises, :class:`InputError` for another suffix than ``.html``, and
    :class:`StorageError` for what the system refuses.
    """
    expect_suffix(path, ".html")
    html = interactive_page(table, windows, predicted, manoeuvres, title, subtitle)
    with atomic_file(path) as partial:
        partial.write_text(html, encoding="utf-8")
    return Path(path)


def _plotly() -> str:
    """The library's script. Raises :class:`ConfigurationError` where it is not installed."""
    try:
        from plotly.offline import get_plotlyjs
    except ImportError as error:
        raise ConfigurationError(
            "the interactive page needs the package plotly", fix="pip install 'seatrial[interactive]'"
        ) from error
    return str(get_plotlyjs())


def _beside(name: str) -> str:
    return resources.files("analysis.report").joinpath(name).read_text(encoding="utf-8")


def _json(data: Mapping[str, Any]) -> str:
    """JSON that no text in it can end: what looks like markup is escaped."""
    return json.dumps(data, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")


def _style(data: Mapping[str, Any]) -> dict[str, Any]:
    """Colours, panels, labels and decimals: what the page looks like, in the house's palette."""
    from analysis.report.plots import FAINT, HELD, INK, PALETTE, label

    spare = [number for number in range(len(PALETTE)) if number not in _KNOWN_METHODS.values()]
    methods = {
        name: PALETTE[_KNOWN_METHODS.get(name, spare[number % len(spare)])]
        for number, name in enumerate(data["predicted"])
    }
    return {
        "colours": {
            "ink": INK, "faint": FAINT, "held": HELD, "grid": "#E6E6E6", "manoeuvre": PALETTE[1],
            "palette": PALETTE,
            "thrusters": {"port": PALETTE[4], "starboard": PALETTE[2], "tunnel": PALETTE[0]},
        },
        "methods": methods,
        "panels": panels_of(data["channels"], PANELS),
        "labels": {name: label(name) for name in NAMES},
        "decimals": {name: DECIMALS[BY_NAME[name].unit] for name in NAMES},
    }  # fmt: skip


def _header(title: str, subtitle: str, data: Mapping[str, Any]) -> str:
    tiles = "".join(f"<div><b>{value}</b>{name}</div>" for name, value in _figures(data).items())
    notes = "".join(f'<p class="note">{escape(text)}</p>' for text in _notes(data))
    return (
        f'<header><h1>{escape(title)}</h1><p class="soft">{escape(subtitle)}</p>'
        f'<div class="tiles">{tiles}</div>{notes}'
        f'<div class="bar">{_method_buttons(data)}<button id="whole">Whole trial</button>'
        f'<button id="fit">Fit to stretch</button><span class="soft">shown: <b id="shown"></b></span>'
        f'<span class="soft keys">Drag to zoom, double click for all, click to set the cursor; '
        f"<kbd>←</kbd> <kbd>→</kbd> move it by 1 s, with <kbd>Shift</kbd> by 10 s.</span></div></header>"
    )


def _figures(data: Mapping[str, Any]) -> dict[str, str]:
    hours, rest = divmod(round(data["time_s"][-1]), 3600)
    duration = f"{hours} h {rest // 60:02d} min" if hours else f"{rest // 60} min {rest % 60:02d} s"
    held_s = sum(end - begin for begin, end in data["held"])
    figures = {
        "duration": duration,
        "rows": f"{data['rows']:,}",
        "channels": f"{len(data['channels'])} of {len(NAMES)}",
    }
    if data["held"]:
        figures |= {"held": f"{held_s / 60:.1f} min", "legs": str(len(data["legs"]))}
    if data["manoeuvres"]:
        figures["manoeuvres"] = str(len(data["manoeuvres"]))
    return figures


def _notes(data: Mapping[str, Any]) -> list[str]:
    """What the reader has to know of the values that are shown."""
    notes = []
    shown = len(data["time_s"])
    if shown < data["rows"]:
        notes.append(
            f"Of {data['rows']:,} rows {shown:,} are shown: of every stretch the first, and each channel's least "
            "and greatest value."
        )
    missing = [name for name in NAMES if name not in data["channels"]]
    if missing:
        notes.append(f"Without {', '.join(missing)}.")
    every = {method: each["every"] for method, each in data["predicted"].items()}
    for number in sorted(set(every.values()) - {1}):
        which = ", ".join(_words(method) for method in every if every[method] == number)
        notes.append(f"Of the predictions ({which}) one window in {number} is shown.")
    return notes


def _words(method: str) -> str:
    return method.replace("_", " ")


def _method_buttons(data: Mapping[str, Any]) -> str:
    colours = data["style"]["methods"]
    return "".join(
        f'<button data-method="{escape(name)}" aria-pressed="true" style="--colour:{colours[name]}">'
        f"{escape(_words(name))}</button>"
        for name in data["predicted"]
    )


def _left(data: Mapping[str, Any]) -> str:
    """The track, the values at the cursor, the manoeuvres."""
    there = {"north_m", "east_m"} <= set(data["channels"])
    plot = (
        f'<div class="plot"{"" if there else " hidden"}><div id="track" style="height:{_track_px(data)}px"></div>'
        f'<svg id="overlay">{_SHIP}</svg><div id="tip" hidden></div></div>'
    )
    caption = (
        "North up, to scale; a colour for each leg of held thrusters. The outline shows the heading, not the size."
        if there
        else "No positions were recorded, so there is no track."
    )
    return f'{plot}<p class="soft">{caption}</p>{_readout(data)}{_manoeuvre_table(data)}'


def _track_px(data: Mapping[str, Any]) -> int:
    """The height that a track to scale needs."""
    extent = {}
    for name in ("north_m", "east_m"):
        known = [each for each in data["channels"].get(name, ()) if each is not None]
        extent[name] = max(known, default=0.0) - min(known, default=0.0)
    least, most = _TRACK_PX
    return round(
        min(max(80 + 1.1 * _TRACK_WIDTH_PX * extent["north_m"] / max(extent["east_m"], 1e-3), least), most)
    )


def _readout(data: Mapping[str, Any]) -> str:
    """The table of values at the cursor, in two columns; the script fills the cells."""
    labels = data["style"]["labels"]
    rows = [
        f'<tr><td>{labels[name]}</td><td class="n" data-channel="{name}"></td></tr>' for name in data["channels"]
    ]
    rows.append('<tr><td>speed over ground [m/s]</td><td class="n" id="speed"></td></tr>')
    half = -(-len(rows) // 2)
    return (
        f'<div id="readout"><h2>At <span id="time"></span></h2><table>{"".join(rows[:half])}</table>'
        f"<table>{''.join(rows[half:])}</table></div>"
    )


def _manoeuvre_table(data: Mapping[str, Any]) -> str:
    if not data["manoeuvres"]:
        return ""
    rows = "".join(_manoeuvre_row(number, each) for number, each in enumerate(data["manoeuvres"]))
    return f'<div id="manoeuvres"><h2>Manoeuvres</h2><table>{rows}</table></div>'


def _manoeuvre_row(number: int, manoeuvre: Mapping[str, Any]) -> str:
    side = f" to {manoeuvre['side']}" if manoeuvre["side"] and manoeuvre["side"] not in manoeuvre["name"] else ""
    duration_s = manoeuvre["end_s"] - manoeuvre["start_s"]
    return (
        f'<tr data-number="{number}"><td>'
        f'<button data-number="{number}" title="Zoom to it">{number + 1}</button></td>'
        f'<td>{escape(manoeuvre["name"] + side)}</td><td class="n">{duration_s:.0f} s</td></tr>'
    )
