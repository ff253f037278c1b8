"""The cells of the map: seconds of a log alike in speed, turning, drift, heading, wind, thrusters, time or place.

Edges are round numbers over the range of the log, so that a person can say where a cell is.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from acquisition.core.arrays import Floats
from hybrid.diagnosis.log import Log
from hybrid.vessel.channels import RPM_PER_RPS

LEAST_S = 20
"""A cell of fewer seconds is none."""

_WANTED = 5  # cells a quantity, about
_ROUND = (1.0, 2.0, 2.5, 5.0, 10.0)
_WIND_MPS, _MOVING_MPS, _RUNNING_RPM = 1.0, 0.3, 5.0
_QUARTERS, _GRID = 4, 3
_FINEST = {
    "speed_mps": 0.25,
    "yaw_rate_dps": 0.25,
    "drift_angle_deg": 1.0,
    "rpm": 5.0,
    "port_less_starboard_rpm": 5.0,
    "azimuth_deg": 2.0,
    "tunnel_rpm": 10.0,
}
"""Steps below which a cell would part what no sensor or drive tells apart."""


@dataclass(frozen=True, slots=True)
class Cell:
    """Some seconds of a log, ``rows`` [T], and the spans that say which: from, to (less than)."""

    quantity: str
    span: dict[str, tuple[float, float]]
    rows: NDArray[np.bool_]


def quantities(log: Log, origin: Floats) -> dict[str, Floats]:
    """What the cells are of, each [T], NaN where it means nothing: there is no drift angle without way."""
    u, v = origin[:, 3], origin[:, 4]
    port_rps, port_rad, starboard_rps, starboard_rad, tunnel_rpm = log.controls.mean(axis=1).T
    port, starboard = port_rps * RPM_PER_RPS, starboard_rps * RPM_PER_RPS
    running = np.maximum(np.abs(port), np.abs(starboard)) > _RUNNING_RPM
    azimuth_rad = np.angle(np.exp(1j * port_rad) + np.exp(1j * starboard_rad))
    moving, windy = np.hypot(u, v) > _MOVING_MPS, log.wind[:, 1] > _WIND_MPS
    drift = np.degrees(np.arctan2(-v, u))
    from_deg = np.degrees(log.wind[:, 0] - origin[:, 2]) % 360.0
    return {
        "speed_mps": np.hypot(u, v),
        "yaw_rate_dps": np.degrees(origin[:, 5]),
        "drift_angle_deg": np.where(moving, drift, np.nan),
        "heading_deg": np.degrees(origin[:, 2]) % 360.0,
        "relative_wind_deg": np.where(windy, from_deg, np.nan),
        "rpm": 0.5 * (np.abs(port) + np.abs(starboard)),
        "port_less_starboard_rpm": port - starboard,
        "azimuth_deg": np.where(running, np.degrees(azimuth_rad), np.nan),
        "tunnel_rpm": tunnel_rpm,
        "time_s": (log.time_s - log.time_s[0]).astype(float),
    }


def cells_of(log: Log, origin: Floats) -> list[Cell]:
    """All cells with enough seconds, by quantity; a quantity with one cell only says nothing and is left out."""
    found = [
        Cell(name, {name: span}, _inside(values, span))
        for name, values in quantities(log, origin).items()
        for span in _spans(name, values)
    ]
    found += _places(origin)
    large = [each for each in found if each.rows.sum() >= LEAST_S]
    several = {each.quantity for each in large if sum(other.quantity == each.quantity for other in large) > 1}
    return [each for each in large if each.quantity in several]


def _spans(name: str, values: Floats) -> Iterable[tuple[float, float]]:
    if name in ("heading_deg", "relative_wind_deg"):  # north, or ahead, in the middle of the first
        return [(45.0 * each - 22.5, 45.0 * each + 22.5) for each in range(8)]
    known = values[np.isfinite(values)]
    if not known.size:
        return []
    if name == "time_s":
        edges = np.linspace(0.0, known.max() + 1.0, _QUARTERS + 1)
        return _pairs(edges)
    low, high = (float(each) for each in np.quantile(known, (0.01, 0.99)))
    return _pairs(np.concatenate([[known.min()], round_edges(low, high, _FINEST[name]), [_above(known.max())]]))


def round_edges(low: float, high: float, finest: float) -> Floats:
    """Round edges between about five cells over ``low`` to ``high``, none narrower than ``finest`` or half a step.

    Where the values lie on both sides of zero, a cell has zero in its middle.
    """
    raw = max((high - low) / _WANTED, finest)
    power = 10.0 ** np.floor(np.log10(raw))
    step = power * next(each for each in _ROUND if each >= raw / power - 1e-9)
    shift = 0.5 if low < 0.0 < high else 0.0
    edges = (np.arange(np.floor(low / step), np.ceil(high / step) + 1) + shift) * step
    return np.asarray(edges[(edges > low + 0.5 * step) & (edges < high - 0.5 * step)])


def _above(value: float) -> float:
    """The next number: the end of a span that is to hold ``value``."""
    return float(np.nextafter(value, np.inf))


def _pairs(edges: Floats) -> Iterator[tuple[float, float]]:
    for low, high in itertools.pairwise(edges):
        yield float(low), float(high)


def _inside(values: Floats, span: tuple[float, float]) -> NDArray[np.bool_]:
    low, high = span
    with np.errstate(invalid="ignore"):
        inside = (values >= low) & (values < high)
        return inside | (values >= low + 360.0) if low < 0.0 and high - low == 45.0 else inside


def _places(origin: Floats) -> list[Cell]:
    """A grid over the trial's area."""
    found = []
    edges = [np.linspace(origin[:, axis].min(), _above(origin[:, axis].max()), _GRID + 1) for axis in (0, 1)]
    for north in _pairs(edges[0]):
        for east in _pairs(edges[1]):
            rows = _inside(origin[:, 0], north) & _inside(origin[:, 1], east)
            found.append(Cell("place", {"north_m": north, "east_m": east}, rows))
    return found
