"""The errors of the predictions of the last minutes, computed as soon as their horizons have been measured.

A prediction assumes constant wind, and thrusters held or as planned. If a thruster moved otherwise during the
horizon, which the prediction could not know, its error says little about the model: such errors are counted,
marked and excluded from the means.

The regions adapt to these errors: wider after the ship has left them too often, narrower after too seldom. The
factor on their size tracks the quantile that it stands for (adaptive conformal inference: Gibbs and Candes
2021; as a quantile tracker Angelopoulos, Candes and Tibshirani 2023, "Conformal PID control for time series
prediction", equation 3), on a logarithmic scale:

    log factor  <-  log factor + step (share of seconds outside - 0.05)

for each independent prediction, with larger steps at first. Predictions that start a second apart have nearly
the same error, so each counts as the seconds since the previous one over the horizon. Whatever the errors, the
mean share outside tends to 5 % as 1 / (number of independent predictions) while the factor is inside its
bounds.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import reduce
from math import exp, log
from typing import Any

import numpy as np
import pandas as pd
from numpy.lib.stride_tricks import sliding_window_view

from seatrial.acquisition.core.quantities import Floats, to_ship
from seatrial.acquisition.core.ship import (
    POSE_AND_VELOCITY,
    Actuators,
    control_names,
    is_circular,
    unwrap,
    wrap_180,
)
from seatrial.analysis.tables.resample import MOTION_FILTER, SETTING_FILTER
from seatrial.analysis.tables.table import NANO, table_actuators, table_controls, times_ns
from seatrial.analysis.windows.held import SPAN_SIGMAS, feedback_of, near_jumps, steady_mask, tolerance_of
from seatrial.hybrid.calibrators.predict import Prediction
from seatrial.hybrid.prediction.prediction_windows import difference_rad
from seatrial.hybrid.prediction.regions import COVERAGE, relative_distances

FILTER_REACH_S = MOTION_FILTER.reach
"""The delay after which the value of a second at 1 Hz is final [s]: the reach of the filter."""
AVERAGED_S = 300.0
_DRIVEN_S = 5
"""The time that a drive may need to follow an order [s]: with a lag of 1 s, the longest of the vessel files, it
is within a hundredth after 4.6 s."""


@dataclass(frozen=True, slots=True)
class TrackError:
    """The error of one prediction, whose start is in ns UTC. Distances are means over its seconds, or at the end.

    ``along_m`` and ``across_m`` are how far it was ahead and to starboard of the ship at the end, by her measured
    heading; ``inside_band`` is the share of its seconds inside the 95 % band, None without a band.
    """

    start_ns: int
    method: str
    thrusters_moved: bool
    mean_distance_m: float
    end_distance_m: float
    along_m: float
    across_m: float
    heading_deg: float
    inside_band: float | None

    def as_dict(self) -> dict[str, Any]:
        """For JSON, as the schema of ``/prediction`` has it."""
        values = asdict(self)
        return {"start": values.pop("start_ns") / NANO, **values}


_MEANS = ("mean_distance_m", "end_distance_m", "along_m", "across_m", "heading_deg", "inside_band")


@dataclass(frozen=True, slots=True)
class MeanErrors:
    """Means over evaluated predictions during which the thrusters did as assumed, None if there are none.

    ``along_m`` and ``across_m`` are signed. ``left_out`` counts the other predictions.
    """

    predictions: int = 0
    left_out: int = 0
    mean_distance_m: float | None = None
    end_distance_m: float | None = None
    along_m: float | None = None
    across_m: float | None = None
    heading_deg: float | None = None
    inside_band: float | None = None

    def with_error(self, error: TrackError) -> MeanErrors:
        """The means updated with one more prediction."""
        if error.thrusters_moved:
            return replace(self, left_out=self.left_out + 1)
        number, means = self.predictions + 1, dict[str, Any]()
        for name in _MEANS:
            value, mean = getattr(error, name), getattr(self, name)
            means[name] = value if mean is None else mean + (value - mean) / number
        return replace(self, predictions=number, **means)


def track_error(prediction: Prediction, measured: Floats, thrusters_moved: bool) -> TrackError:
    """The error of a prediction against the measured track [H+1, 3] of north, east [m] and heading [rad]."""
    gap = prediction.track[1:, :2] - measured[1:, :2]
    distance = np.hypot(gap[:, 0], gap[:, 1])
    along_m, across_m = to_ship(gap[-1, 0], gap[-1, 1], measured[-1, 2])
    turn = difference_rad(prediction.track[1:, 2], measured[1:, 2])
    return TrackError(
        start_ns=prediction.at.as_unit("ns").value,
        method=prediction.method,
        thrusters_moved=thrusters_moved,
        mean_distance_m=float(distance.mean()),
        end_distance_m=float(distance[-1]),
        along_m=float(along_m),
        across_m=float(across_m),
        heading_deg=float(np.rad2deg(np.abs(turn)).mean()),
        inside_band=_inside_band(prediction, measured),
    )


def _inside_band(prediction: Prediction, measured: Floats) -> float | None:
    """The share of seconds at which the region holds the measured track [H+1, 3]; None without a region."""
    if prediction.region_m is None:
        return None
    relative = relative_distances(prediction.track[None], measured[None], prediction.region_m[1:])
    return float(np.mean(relative <= 1.0))


def any_thruster_moved(
    table: pd.DataFrame, row: int, horizon_s: int, planned: Mapping[str, Floats] | None = None
) -> bool:
    """Whether a thruster departed from ``planned`` in the seconds ``row`` to ``row + horizon_s`` of a 1 Hz
    table.

    ``planned`` are channels [horizon_s] by name, all others are held. The tolerance is that of held windows.
    """
    actuators, plan = table_actuators(table), planned or {}
    return not all(
        as_planned(name, values, row, plan[name], actuators)
        if name in plan
        else steady_mask(name, values, horizon_s + 1, 1, actuators)[row]
        for name, values in ((name, table[name].to_numpy(dtype=float)) for name in control_names(actuators))
    )


def as_planned(name: str, values: Floats, row: int, planned: Floats, actuators: Actuators) -> bool:
    """Whether a control channel followed ``planned`` [H] from ``row`` on, in the channel's unit.

    Its mean over each second has to lie between the orders of the last :data:`_DRIVEN_S` seconds and those
    within reach of the 1 Hz filter, with the tolerance of a held setting. The last seconds, to which that
    filter carries values from after the horizon, do not count.
    """
    reach, circular = SETTING_FILTER.reach, is_circular(name)
    seconds = max(len(planned) - reach, 1)
    series = unwrap(values) if circular else values
    done = sliding_window_view(series[row : row + seconds + 1], 2).mean(axis=1)
    orders = np.concatenate([np.full(_DRIVEN_S, values[row]), planned, np.full(reach, planned[-1])])
    near = sliding_window_view(unwrap(orders) if circular else orders, _DRIVEN_S + 1 + reach)[:seconds]
    low, high = near.min(axis=1), near.max(axis=1)
    off = done - 0.5 * (low + high)
    tolerance = tolerance_of(name, actuators).at(series)
    span = tolerance.span + SPAN_SIGMAS * feedback_of(series, tolerance.noise).noise
    return bool((np.abs(wrap_180(off) if circular else off) <= 0.5 * (high - low) + span).all())


class RunningError:
    """Pending predictions, whose horizons are not over, and the errors of the latest ones whose horizons are.

    ``unmeasured`` counts those without a measured track because a channel was missing, positions jumped or
    another recording began.
    """

    def __init__(self, over_s: float = AVERAGED_S) -> None:
        self.over_s = over_s
        self.unmeasured = 0
        self._pending: deque[Prediction] = deque()
        self._last: deque[TrackError] = deque()

    def add(self, prediction: Prediction) -> None:
        """Add a prediction, later than those before it."""
        self._pending.append(prediction)

    def clear(self) -> None:
        """Drop the pending predictions and count them as unmeasured."""
        self.unmeasured += len(self._pending)
        self._pending.clear()

    def evaluate(self, table: pd.DataFrame, until_ns: int) -> list[TrackError]:
        """Evaluate predictions with a 1 Hz table known up to a time [ns]; the errors, earliest first."""
        found = []
        while self._pending:
            prediction = self._pending[0]
            start_ns, horizon_s = prediction.at.as_unit("ns").value, len(prediction.track) - 1
            if until_ns < start_ns + (horizon_s + FILTER_REACH_S) * NANO:
                break
            self._pending.popleft()
            error = self._error(prediction, table, start_ns, horizon_s)
            if error is None:
                self.unmeasured += 1
            else:
                found.append(error)
        self._last.extend(found)
        while self._last and self._last[0].start_ns < self._last[-1].start_ns - self.over_s * NANO:
            self._last.popleft()
        return found

    def mean(self) -> MeanErrors:
        """The means over the evaluated predictions of the last ``over_s`` seconds."""
        return reduce(MeanErrors.with_error, self._last, MeanErrors())

    def _error(
        self, prediction: Prediction, table: pd.DataFrame, start_ns: int, horizon_s: int
    ) -> TrackError | None:
        times = times_ns(table)
        row = int(np.searchsorted(times, start_ns))
        rows = slice(row, row + horizon_s + 1)
        seconds = table.iloc[rows]
        if len(seconds) <= horizon_s or times[row] != start_ns or times[rows][-1] != start_ns + horizon_s * NANO:
            return None
        heading = np.deg2rad(unwrap(seconds["heading_deg"].to_numpy(dtype=float)))
        track = np.column_stack([seconds["north_m"], seconds["east_m"], heading])
        if not (np.isfinite(track).all() and seconds[list(table_controls(table))].notna().all(axis=None)):
            return None
        if near_jumps(table[list(POSE_AND_VELOCITY)].to_numpy(dtype=float))[rows].any():
            return None
        moved = any_thruster_moved(table, row, horizon_s, prediction.planned)
        return track_error(prediction, track, moved)


STEP = 0.3
"""The step after the first predictions. For errors that follow a Gaussian process, regions of half the right
width cover 94 % over the first hour of 30 s predictions, of twice the width 97 %, and right ones grow by 9 % in
area by chance; half the step takes twice as long, twice the step costs twice the area."""
LARGEST_FACTOR = 4.0
"""The largest factor; the smallest is its inverse. From there, as after a failed sensor, it recovers in an hour
of 30 s predictions."""


def step(learned: float) -> float:
    """The step after a number of independent predictions: large at first, as t^-0.6 (Angelopoulos, Barber and
    Bates 2024, "Online conformal prediction with decaying step sizes"), then :data:`STEP`, since ships and days
    change."""
    return max(STEP, exp(-0.6 * log(max(learned, 1.0))))


@dataclass(frozen=True, slots=True)
class RegionFactor:
    """The factor on the size of the 95 % regions, the number of independent predictions behind it, and the
    start of the latest [ns UTC]."""

    factor: float = 1.0
    learned: float = 0.0
    start_ns: int | None = None

    def after(self, error: TrackError, horizon_s: int) -> RegionFactor:
        """The factor after one more evaluated prediction; unchanged if that had no region or a thruster moved."""
        if error.inside_band is None or error.thrusters_moved:
            return self
        apart_s = 0.0 if self.start_ns is None else (error.start_ns - self.start_ns) / NANO
        independent = min(max(apart_s, 0.0) / horizon_s, 1.0)
        learned, bound = self.learned + independent, log(LARGEST_FACTOR)
        raised = log(self.factor) + step(learned) * independent * (COVERAGE - error.inside_band)
        return RegionFactor(exp(min(max(raised, -bound), bound)), learned, error.start_ns)

    def widened(self, prediction: Prediction) -> Prediction:
        """A prediction with its region, if it has one, multiplied by the factor."""
        if prediction.region_m is None:
            return prediction
        return replace(prediction, region_m=self.factor * prediction.region_m)

    @property
    def is_at_bound(self) -> bool:
        """Whether it is at a bound, where regions no longer measure the errors."""
        return abs(log(self.factor)) > 0.999 * log(LARGEST_FACTOR)

    def __str__(self) -> str:
        """What it says of the regions in plain words.

        >>> print(RegionFactor(1.5))
        band 1.5 times as wide as the calibrator's, which held the ship too seldom
        """
        if abs(self.factor - 1.0) < 0.05:
            return "band as wide as the calibrator's"
        held = "held the ship too seldom" if self.factor > 1.0 else "was wider than needed"
        beyond = ": at its limit, train again" if self.is_at_bound else ""
        return f"band {self.factor:.2g} times as wide as the calibrator's, which {held}{beyond}"
