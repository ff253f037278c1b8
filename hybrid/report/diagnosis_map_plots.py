"""Figures of the map of a diagnosis, in the house's style: functions draw a map into axes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import product

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from seatrial.analysis.report.plots import FAINT, INK, PALETTE
from seatrial.hybrid.diagnosis.result import FORCES, GapCell, Map
from seatrial.hybrid.report.plots import LESS_MORE, legend_above
from seatrial.hybrid.report.words import force_unit, quantity_title

QUANTITIES = {
    "speed_mps": "speed [m/s]",
    "yaw_rate_dps": "yaw rate [deg/s]",
    "drift_angle_deg": "drift angle [deg]",
    "heading_deg": "heading [deg]",
    "relative_wind_deg": "relative wind direction [deg]",
    "rpm": "mean shaft speed [rpm]",
    "pitch_percent": "mean pitch [%]",
    "azimuth_deg": "mean azimuth angle [deg]",
    "rudder_deg": "mean rudder angle [deg]",
    "nozzle_deg": "mean nozzle angle [deg]",
    "time_s": "time [min]",
    "place": "position north, east [m]",
}
"""What the cells are of, for people."""


def axis_title(name: str) -> str:
    """What a cell is of, for people; the shafts of a ship's actuators by their names."""
    if name in QUANTITIES:
        return QUANTITIES[name]
    if name.endswith("_rpm") and "_less_" not in name:
        return f"{name.removesuffix('_rpm').replace('_', ' ')} thruster [rpm]"
    return quantity_title(name)


_MINUTE_S = 60.0
_FULL = 12.0  # standard errors at full colour
_SURE = 3.3  # standard errors beyond which a force is printed dark
_ROW_INCH, _EDGE_INCH = 0.19, 0.7

Rows = list[tuple[str, list[GapCell]]]


def force_titles(unit: str) -> tuple[str, str, str]:
    """The axes' forces, with their unit.

    >>> force_titles("kN")
    ('surge [kN]', 'sway [kN]', 'yaw [kN m]')
    """
    return f"surge [{unit}]", f"sway [{unit}]", f"yaw [{unit} m]"


def _unit_of(places: Sequence[GapCell]) -> tuple[float, str]:
    return force_unit(max((abs(each.error) for each in places if each.channel in FORCES), default=0.0))


def map_height_inch(places: Sequence[GapCell]) -> float:
    """A height at which the rows of :func:`force_map` stand clear of each other."""
    return _EDGE_INCH + _ROW_INCH * max(len(half) for half in _halves(_rows(places)))


def force_map(figure: Figure, places: Sequence[GapCell]) -> None:
    """The steady force that the model lacks in each cell, by axis: colour says how sure, the number how much."""
    axes = figure.subplots(1, 2, squeeze=False)[0]
    halves = _halves(_rows(places))
    for one, rows in zip(axes, halves, strict=True):
        if rows:
            _matrix(one, rows, *_unit_of(places))
            one.set_ylim(max(map(len, halves)) - 0.5, -0.5)  # rows of one height on both sides
        else:
            one.set_axis_off()


def map_sentences(places: Sequence[GapCell]) -> list[str]:
    """What a map says: of each force the cell in which it is surest, where one stands out."""
    sentences = []
    size_n, unit = _unit_of(places)
    for channel, title in zip(FORCES, force_titles(unit), strict=True):
        mine = [each for each in places if each.channel == channel and abs(each.z) > _SURE]
        if not mine:
            continue
        most = max(mine, key=lambda each: abs(each.z))
        words, unit = title.rstrip("]").split(" [")
        what = f"missing {words} {'moment' if words == 'yaw' else 'force'}"
        quantity, _, of = axis_title(quantity_of(most)).rstrip("]").partition(" [")
        half = 1.96 * abs(most.error / most.z)
        ends = (most.error - half, most.error, most.error + half)
        low, value, high = (_force_text(each / size_n) for each in ends)
        sentences.append(f"By {quantity}, the {what} at {cell_name(most)} {of} is {value} {unit} "
                         f"(95 % interval {low} to {high}).")  # fmt: skip
    return sentences


def residual_force(axes: Axes, made: Map, channel: str, quantity: str) -> None:
    """The slow force that the model lacks against a quantity: seconds in grey, cells with 95 % intervals."""
    axis = FORCES.index(channel)
    scale = _MINUTE_S if quantity == "time_s" else 1.0
    size_n, unit = _unit_of(made.places)
    seconds, force = made.quantities[quantity] / scale, made.force[:, axis] / size_n
    axes.plot(seconds, force, ".", color=FAINT, markersize=2, label="reconstructed, each second")
    cells = [each for each in made.places if each.channel == channel and quantity in each.cell]
    cells = sorted(cells, key=lambda each: each.cell[quantity])
    middle = np.array([np.mean(each.cell[quantity]) for each in cells]) / scale
    if quantity in ("heading_deg", "relative_wind_deg"):
        middle = middle % 360.0
    error = np.array([each.error for each in cells]) / size_n
    reach = 1.96 * np.abs(error / np.array([each.z or 1.0 for each in cells]))
    axes.errorbar(middle, error, yerr=reach, fmt="o", color=PALETTE[0], capsize=3, label="mean of a cell")
    axes.axhline(0.0, color=INK, linewidth=0.8)
    axes.set(xlabel=axis_title(quantity), ylabel="missing force: " + force_titles(unit)[axis])
    legend_above(axes, 2)


def depends_most(made: Map) -> tuple[str, str] | None:
    """The force and the quantity whose cells differ most for what is known of them; None without cells."""
    scores = dict[tuple[str, str], float]()
    for pair in product(FORCES, made.quantities):
        cells = [each for each in made.places if (each.channel, *each.cell) == pair]
        z, error = np.array([each.z for each in cells]), np.array([each.error for each in cells])
        if len(cells) > 1:
            weight = (z / np.where(error == 0.0, 1.0, error)) ** 2
            away = error - np.average(error, weights=weight + 1e-30)
            scores[pair] = float((weight * away**2).sum() / (len(z) - 1))
    return max(scores, key=lambda pair: (scores[pair], pair), default=None)


def cell_name(place: GapCell) -> str:
    """A cell's span for people, without its unit: degrees and times to whole numbers."""
    if "north_m" in place.cell:
        north, east = (np.mean(place.cell[name]) for name in ("north_m", "east_m"))
        return f"{_plain(float(north), 0)}, {_plain(float(east), 0)}"
    ((quantity, (low, high)),) = place.cell.items()
    if quantity in ("heading_deg", "relative_wind_deg"):
        return f"{0.5 * (low + high):.0f} ± {0.5 * (high - low):.0f}"
    scale = _MINUTE_S if quantity == "time_s" else 1.0
    digits = 1 if max(abs(low), abs(high)) / scale >= 5.0 else 2
    return f"{_plain(low / scale, digits)} to {_plain(high / scale, digits)}"


def quantity_of(place: GapCell) -> str:
    """What a cell is of, as in :data:`QUANTITIES`."""
    return "place" if "north_m" in place.cell else next(iter(place.cell))


def _plain(value: float, digits: int) -> str:
    text = f"{value:.{digits}f}"
    text = text.rstrip("0").rstrip(".") if "." in text else text
    return text.replace("-", "\u2212") if text != "-0" else "0"


def _in_order(found: Iterable[str]) -> list[str]:
    """Quantities in the order of the titles; what one shaft runs faster than another after their mean, tunnel
    thrusters after the angles.
    """
    own = [name for name in found if name not in QUANTITIES]
    after = {"rpm": [name for name in own if "_less_" in name]}
    after["nozzle_deg"] = [name for name in own if name not in after["rpm"]]
    return [name for title in QUANTITIES for name in (title, *after.get(title, ()))]


def _rows(places: Sequence[GapCell]) -> Rows:
    """A row a cell, by quantity in the order of the titles: its name, its three forces."""
    result: Rows = []
    for quantity in _in_order({quantity_of(each): None for each in places}):
        mine = [each for each in places if each.channel in FORCES and quantity_of(each) == quantity]
        spans = sorted({tuple(each.cell.values()) for each in mine})
        if spans:
            result.append((axis_title(quantity), []))
        for span in spans:
            row = {each.channel: each for each in mine if tuple(each.cell.values()) == span}
            result.append((cell_name(next(iter(row.values()))), [row[channel] for channel in FORCES]))
    return result


def _halves(rows: Rows) -> tuple[Rows, Rows]:
    """The rows in two columns of about one height, parted between two quantities."""
    begins = [number for number, (_, forces) in enumerate(rows) if not forces] or [0]
    cut = min([*begins[1:], len(rows)], key=lambda each: abs(each - len(rows) / 2))
    return rows[:cut], rows[cut:]


def _matrix(axes: Axes, rows: Rows, size_n: float, unit: str) -> None:
    z = np.array([[each.z for each in forces] or [np.nan] * 3 for _, forces in rows])
    axes.imshow(z, cmap=LESS_MORE, vmin=-_FULL, vmax=_FULL, aspect="auto")
    for row, (name, forces) in enumerate(rows):
        for column, each in enumerate(forces):
            dark = abs(each.z) > _SURE
            bright = abs(each.z) > 0.75 * _FULL and dark
            colour = "white" if bright else INK if dark else "#9A9A9A"
            text = _force_text(each.error / size_n)
            axes.text(column, row, text, ha="center", va="center", fontsize=7.5, color=colour)
        if not forces:
            axes.text(-0.62, row, name, ha="right", va="center", fontsize=8, weight="bold", color=INK)
    names = [name if forces else "" for name, forces in rows]
    axes.set_yticks(range(len(rows)), names, fontsize=7.5)
    axes.set_xticks(range(3), force_titles(unit))
    axes.tick_params(length=0, labeltop=True, labelbottom=False)
    axes.spines[:].set_visible(False)
    axes.grid(visible=False)


def _force_text(value: float) -> str:
    size = abs(value)
    return _plain(value, 0 if size >= 20.0 else 1 if size >= 0.95 else 2)
