"""Errors of predictions second by second, the calibration of their 95 % regions, and residual accelerations.

Errors are predicted less measured: along and across the heading, in heading, in speed; windows are [N], seconds
1 to H. The ship's acceleration comes from the Kalman smoother, without wave motion; the model's from its forces
at the motion, settings and wind of that second. Their difference is averaged in cells of two quantities.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pandas as pd
from scipy.stats import t

from seatrial.acquisition.core.quantities import Floats, Ints, rotate_earth_to_ship
from seatrial.acquisition.core.ship import wrap_180, wrap_360
from seatrial.analysis.estimation.smoother import SmoothedMotion
from seatrial.analysis.tables.table import NANO, index_of, trial_channels
from seatrial.hybrid.effects import quantities_along, steering_angles
from seatrial.hybrid.prediction import baselines, window_sets
from seatrial.hybrid.vessel import black_box, dynamics, sensors

COLUMNS = ("north_m", "east_m", "heading_deg", "surge_mps", "sway_mps", "yaw_rate_dps", "speed_mps")

QUANTITIES = {
    "distance": "distance [m]",
    "along": "along the heading [m]",
    "across": "across the heading [m]",
    "heading": "heading [deg]",
    "speed": "speed over ground [m/s]",
}
"""What a prediction may be off in, for people; the names are the attributes of :class:`ErrorComponents`."""

_LEAST_WAY_M = 0.1
_LOG_OUTSIDE = -np.log(0.05)  # a Rayleigh law leaves this outside of its 95 % region
ACCELERATIONS = ("surge_mps2", "sway_mps2", "yaw_dps2")

PLANES = (("surge_mps", "yaw_rate_dps"), ("rpm", "sway_mps"), ("azimuth_deg", "relative_wind_deg"))
"""What the cells are of."""

LEAST_S = 5
"""A cell of fewer seconds says nothing."""

ENOUGH_S = 60
"""A map of fewer seconds shows nothing."""

_STEP_S = 0.01
_EDGES = {"relative_wind_deg": np.linspace(-180.0, 180.0, 9)}
_CELLS = 9
_CALM_MPS = 0.1
_BLOCK_S = 15  # a few of a ship's own time constants at ordinary speeds
_CHANCE = 0.05


def speeds_of_tracks(track: Floats) -> Floats:
    """Surge, sway [m/s], yaw rate [rad/s] and speed over ground [m/s] of tracks [N, H+1, 3]: [N, H+1, 4].

    Central differences over two seconds, one-sided ones at the ends.
    """
    slope = np.gradient(track, axis=1)
    north, east = slope[..., 0], slope[..., 1]
    surge, sway = rotate_earth_to_ship(north, east, track[..., 2])
    return np.stack([surge, sway, slope[..., 2], np.hypot(north, east)], axis=-1)


def consecutive_windows(horizons: window_sets.PredictionWindows) -> Ints:
    """Windows that follow each other without an overlap, as many as fit, in the order of time."""
    start_ns = horizons.start_ns
    chosen, until_ns, trial = [], -1, ""
    for number in np.lexsort((start_ns, horizons.trial)):
        if horizons.trial[number] != trial:
            until_ns, trial = -1, horizons.trial[number]
        if start_ns[number] >= until_ns:
            chosen.append(int(number))
            until_ns = int(start_ns[number]) + horizons.horizon_s * NANO
    return np.array(chosen, dtype=np.int64)


def predicted_motion(horizons: window_sets.PredictionWindows, tracks: Floats, chosen: Ints) -> pd.DataFrame:
    """The motion that tracks [N, H+1, 3] predict in the ``chosen`` windows, a row a window and second.

    Columns :data:`COLUMNS` in the units of the channels and ``window``; the index is UTC.
    """
    shown = tracks[chosen]
    speeds = speeds_of_tracks(shown)
    seconds = np.arange(shown.shape[1]) * NANO
    times = horizons.start_ns[chosen][:, None] + seconds
    values = np.concatenate([shown, speeds], axis=-1).reshape(-1, 7)
    values[:, 2] = wrap_360(np.rad2deg(values[:, 2]))
    values[:, 5] = np.rad2deg(values[:, 5])
    table = pd.DataFrame(values, index=index_of(times.ravel()), columns=list(COLUMNS))
    return table.assign(window=np.repeat(chosen, shown.shape[1]))


@dataclass(frozen=True, slots=True)
class ErrorComponents:
    """Errors of one method [N, H]: ``distance``, ``along`` and ``across`` the measured heading [m] (ahead and to
    starboard positive), ``heading`` [deg], ``speed`` over ground [m/s], which is a difference of the track over two
    seconds; that of the last second is that of the one before.
    """

    distance: Floats
    along: Floats
    across: Floats
    heading: Floats
    speed: Floats

    def by_second(self, quantity: str, share: float) -> Floats:
        """The size that ``share`` of the windows stay below, at each second [H]."""
        return np.asarray(np.nanquantile(np.abs(getattr(self, quantity)), share, axis=0))


def error_components(predicted: Floats, horizons: window_sets.PredictionWindows) -> ErrorComponents:
    """The errors of tracks [N, H+1, 3] of north, east [m], heading [rad]."""
    measured = horizons.track
    gap = (predicted - measured)[:, 1:, :2]
    along, across = rotate_earth_to_ship(gap[..., 0], gap[..., 1], measured[:, 1:, 2])
    turned = np.rad2deg(window_sets.angle_difference_rad(predicted[:, 1:, 2], measured[:, 1:, 2]))
    speed = (speeds_of_tracks(predicted)[..., 3] - speeds_of_tracks(measured)[..., 3])[:, 1:]
    if speed.shape[1] > 1:
        speed[:, -1] = speed[:, -2]  # a difference over one second has twice the noise of one over two
    return ErrorComponents(baselines.distances(predicted, measured), along, across, turned, speed)


@dataclass(frozen=True, slots=True)
class Calibration:
    """Whether 95 % regions hold what they say, by second [H].

    ``picp`` is the share of positions inside (prediction interval coverage probability), ``pinaw`` the mean
    width of circles as large as the regions over the mean way covered by then (prediction interval
    normalised average width), NaN while the ship lies still. ``low`` and ``high`` are the 95 % interval of
    ``picp`` by a bootstrap over legs, not windows; NaN with one leg.
    ``pit`` [N H] is the probability integral transform of the distances, as seen from the regions: even from 0 to 1
    where errors are normal and of the size that the regions say.
    """

    picp: Floats
    pinaw: Floats
    low: Floats
    high: Floats
    pit: Floats
    legs: int


def region_calibration(predicted: Floats, region_m: Floats, horizons: window_sets.PredictionWindows) -> Calibration:
    """How regions of semi-axes ``region_m`` [N, H, 2] about predicted tracks [N, H+1, 3] stand up."""
    relative = baselines.relative_distances(predicted, horizons.track, region_m)
    inside = (relative <= 1.0).astype(float)
    way = np.hypot(*(horizons.track[:, 1:, :2] - horizons.track[:, :1, :2]).transpose(2, 0, 1)).mean(axis=0)
    legs = baselines.LegBootstrap.of(horizons.leg, seed=0)
    shares = legs.column_means(inside)
    with np.errstate(divide="ignore", invalid="ignore"):
        pit = 1.0 - np.exp(-_LOG_OUTSIDE * relative**2)
        pinaw = np.where(way > _LEAST_WAY_M, 2.0 * baselines.equal_area_radius(region_m).mean(axis=0) / way, np.nan)
    low, high = (np.array([getattr(share, name) for share in shares]) for name in ("low", "high"))
    return Calibration(inside.mean(axis=0), pinaw, low, high, pit.ravel(), legs.leg_count)


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


def modelled_acceleration(plant: black_box.MotionModel, states: Floats, controls: Floats, wind: Floats) -> Floats:
    """The rates of surge, sway [m/s2] and yaw rate [rad/s2] that the model has at states [T, 6]: [T, 3]."""
    later = dynamics.simulate_batch(plant, states, controls[:, None], wind[:, None], _STEP_S, 1, controls).states[
        :, 1
    ]
    return np.asarray((later[:, 3:] - states[:, 3:]) / _STEP_S)


def acceleration_residuals(one_hz: pd.DataFrame, motion: SmoothedMotion, plant: black_box.MotionModel) -> Residuals:
    """The accelerations that ``plant`` lacks where a 1 Hz table and the smoothed motion are whole."""
    slow = motion.slow.reindex(one_hz.index)
    table = one_hz.assign(**{str(name): slow[name] for name in slow})
    complete = table.dropna(subset=[*trial_channels(table), *ACCELERATIONS])
    states, controls, wind = (
        sensors.states_of(complete),
        sensors.controls_of(complete, plant.layout),
        sensors.wind_of(complete),
    )
    model = modelled_acceleration(plant, states, controls, wind) * np.array([1.0, 1.0, np.rad2deg(1.0)])
    measured = complete[list(ACCELERATIONS)].to_numpy(dtype=float)
    relative = wrap_180(complete["wind_direction_deg"].to_numpy() - complete["heading_deg"].to_numpy())
    along = quantities_along(plant.layout, states, controls, wind)
    shown = ("surge_mps", "sway_mps", "yaw_rate_dps", "rpm", *steering_angles(plant.layout))
    quantities = {name: along[name] for name in shown if name in along}
    if complete["wind_speed_mps"].max() > _CALM_MPS:  # a calm, or a wind that was not recorded, has no direction
        quantities["relative_wind_deg"] = np.asarray(relative)
    return Residuals(measured - model, quantities)


@dataclass(frozen=True, slots=True)
class LargestResidual:
    """Where the model lacks most of one acceleration: the class of a quantity, from ``low`` to ``high``, in which
    the mean that is missing explains most of it, with the half of its 95 % interval and the chance of such a mean
    where nothing is missing (t test), and how many ``seconds``.
    """

    acceleration: str
    quantity: str
    low: float
    high: float
    mean: float
    half_width: float
    seconds: int
    p_value: float


def largest_residuals(residuals: Residuals) -> list[LargestResidual]:
    """Of each of :data:`ACCELERATIONS` the class that stands out most, in their order; none where none does.

    Residuals of seconds that follow each other are alike: a mean's interval is that of means over blocks. What
    stands out does so at 5 % though as many classes are tried (Bonferroni).
    """
    candidates = []
    for name, values in zip(ACCELERATIONS, residuals.missing.T, strict=True):
        for quantity, x in residuals.quantities.items():
            for low, high in pairwise(_EDGES.get(quantity, round_cell_edges(x)).tolist()):
                inside = values[(x >= low) & (x < high)]
                if inside.size < ENOUGH_S:
                    continue
                blocks = np.array([part.mean() for part in np.array_split(inside, inside.size // _BLOCK_S)])
                error = max(float(np.std(blocks, ddof=1)) / np.sqrt(blocks.size), 1e-300)
                mean, law = float(inside.mean()), t(blocks.size - 1)
                half, p_value = float(law.ppf(0.975) * error), float(2.0 * law.sf(abs(mean) / error))
                span = name, quantity, low, high
                candidates.append(LargestResidual(*span, mean, half, int(inside.size), p_value))
    sure = [candidate for candidate in candidates if candidate.p_value * len(candidates) < _CHANCE]
    best = {
        candidate.acceleration: candidate
        for candidate in sorted(sure, key=lambda candidate: candidate.seconds * candidate.mean**2)
    }
    return [best[name] for name in ACCELERATIONS if name in best]


def average_in_cells(residuals: Residuals, x: str, y: str) -> Cells:
    """The residuals averaged in cells of two of their quantities."""
    across, up = residuals.quantities[x], residuals.quantities[y]
    x_edges, y_edges = (_EDGES.get(name, round_cell_edges(residuals.quantities[name])) for name in (x, y))
    seconds, *_ = np.histogram2d(up, across, bins=(y_edges, x_edges))
    sums = [
        np.histogram2d(up, across, bins=(y_edges, x_edges), weights=missing)[0] for missing in residuals.missing.T
    ]
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.where(seconds >= LEAST_S, np.array(sums) / seconds, np.nan)
    return Cells(x_edges, y_edges, mean, seconds)


def round_cell_edges(values: Floats) -> Floats:
    """Edges at round numbers that hold all values, some nine cells.

    >>> round_cell_edges(np.array([0.1, 3.9]))
    array([0. , 0.5, 1. , 1.5, 2. , 2.5, 3. , 3.5, 4. ])
    """
    low, high = (float(values.min()), float(values.max())) if values.size else (0.0, 1.0)
    wanted = max((high - low) / _CELLS, 1e-3)
    ten = 10.0 ** np.floor(np.log10(wanted))
    step = next(factor * ten for factor in (1.0, 2.0, 5.0, 10.0) if factor * ten >= wanted * (1.0 - 1e-9))
    first, last = np.floor(low / step), max(np.ceil(high / step), np.floor(low / step) + 1)
    return np.asarray(np.arange(first, last + 1) * step)
