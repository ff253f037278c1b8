"""What the model's acceleration lacks at every second of a trial, and where: by speeds, thrusters and wind.

The ship's acceleration comes from the Kalman smoother, without her swing in waves; the model's from its forces at
the motion, settings and wind of that second. Their difference is averaged in cells of two quantities.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from acquisition.core.actuators import names_of
from acquisition.core.angles import difference, wrap_180
from acquisition.core.arrays import Floats
from analysis.estimation.smoother import Smoothed
from analysis.tables.table import trial_channels
from hybrid.vessel.channels import controls_of, states_of, wind_of
from hybrid.vessel.plant import Plant
from hybrid.vessel.simulate import simulate_batch

ACCELERATIONS = ("surge_mps2", "sway_mps2", "yaw_dps2")
PLANES = (
    ("surge_mps", "yaw_rate_dps"),
    ("surge_mps", "sway_mps"),
    ("azimuth_deg", "relative_wind_deg"),
)
"""What the cells are of."""

LEAST_S = 5
"""A cell of fewer seconds says nothing."""

ENOUGH_S = 60
"""A map of fewer seconds shows nothing."""

_STEP_S = 0.01
_EDGES = {"relative_wind_deg": np.linspace(-180.0, 180.0, 9)}
_CELLS = 9


@dataclass(frozen=True, slots=True)
class Residuals:
    """Second by second [T]: ``missing`` [T, 3], measured less modelled acceleration in the units of
    :data:`ACCELERATIONS`, and ``quantities`` by name.
    """

    missing: Floats
    quantities: dict[str, Floats]


@dataclass(frozen=True, slots=True)
class Cells:
    """A plane cut into cells: edges of x [X+1] and y [Y+1], the mean of each acceleration that the model lacks
    ``mean`` [3, Y, X], NaN where fewer than :data:`LEAST_S` seconds are, and the ``seconds`` [Y, X] in each.
    """

    x_edges: Floats
    y_edges: Floats
    mean: Floats
    seconds: Floats


def modelled_acceleration(plant: Plant, states: Floats, controls: Floats, wind: Floats) -> Floats:
    """The rates of surge, sway [m/s2] and yaw rate [rad/s2] that the model has at states [T, 6]: [T, 3]."""
    later = simulate_batch(plant, states, controls[:, None], wind[:, None], _STEP_S, 1, controls).states[:, 1]
    return np.asarray((later[:, 3:] - states[:, 3:]) / _STEP_S)


def residuals_of(one_hz: pd.DataFrame, motion: Smoothed, plant: Plant) -> Residuals:
    """The accelerations that ``plant`` lacks where a 1 Hz table and the smoothed motion are whole."""
    slow = motion.slow.reindex(one_hz.index)
    table = one_hz.assign(**{str(name): slow[name] for name in slow})
    whole = table.dropna(subset=[*trial_channels(table), *ACCELERATIONS])
    states, controls = states_of(whole), controls_of(whole, plant.layout)
    model = modelled_acceleration(plant, states, controls, wind_of(whole)) * np.array([1.0, 1.0, np.rad2deg(1.0)])
    measured = whole[list(ACCELERATIONS)].to_numpy(dtype=float)
    angles = [whole[f"{name}_angle_deg"].to_numpy(dtype=float) for name in names_of(plant.layout, "azimuth")]
    first = angles[0] if angles else np.zeros(len(whole))
    turned = [difference(each, first) for each in angles[1:]]
    azimuth = wrap_180(
        first + sum(turned, np.zeros(len(whole))) / max(len(angles), 1)
    )  # the mean the short way round
    relative = wrap_180(whole["wind_direction_deg"].to_numpy() - whole["heading_deg"].to_numpy())
    quantities = {name: whole[name].to_numpy(dtype=float) for name in ("surge_mps", "sway_mps", "yaw_rate_dps")}
    quantities |= {"azimuth_deg": np.asarray(azimuth), "relative_wind_deg": np.asarray(relative)}
    return Residuals(measured - model, quantities)


def cells_of(residuals: Residuals, x: str, y: str) -> Cells:
    """The residuals averaged in cells of two of their quantities."""
    across, up = residuals.quantities[x], residuals.quantities[y]
    x_edges, y_edges = (_EDGES.get(name, edges_of(residuals.quantities[name])) for name in (x, y))
    seconds, *_ = np.histogram2d(up, across, bins=(y_edges, x_edges))
    sums = [np.histogram2d(up, across, bins=(y_edges, x_edges), weights=each)[0] for each in residuals.missing.T]
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.where(seconds >= LEAST_S, np.array(sums) / seconds, np.nan)
    return Cells(x_edges, y_edges, mean, seconds)


def edges_of(values: Floats) -> Floats:
    """Edges at round numbers that hold all values, some nine cells.

    >>> edges_of(np.array([0.1, 3.9]))
    array([0. , 0.5, 1. , 1.5, 2. , 2.5, 3. , 3.5, 4. ])
    """
    low, high = (float(values.min()), float(values.max())) if values.size else (0.0, 1.0)
    wanted = max((high - low) / _CELLS, 1e-3)
    ten = 10.0 ** np.floor(np.log10(wanted))
    step = next(each * ten for each in (1.0, 2.0, 5.0, 10.0) if each * ten >= wanted * (1.0 - 1e-9))
    first, last = np.floor(low / step), max(np.ceil(high / step), np.floor(low / step) + 1)
    return np.asarray(np.arange(first, last + 1) * step)
