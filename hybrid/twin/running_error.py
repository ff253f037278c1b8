"""How far off the predictions of the last minutes were, as soon as what they foretold has been measured.

A prediction is made with thrusters and wind held. Where a thruster moved in its horizon, which it could not know,
its error says little of the model: such errors are counted, marked and left out of the means.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd

from acquisition.core.angles import unwrap
from acquisition.core.arrays import Floats
from acquisition.core.channels import COMMAND
from analysis.tables.resample import MOTION_FILTER
from analysis.tables.time_index import NANO, times_ns
from analysis.windows.steady_controls import Tolerances, held
from hybrid.prediction.prediction_windows import difference_rad, in_ship_axes
from hybrid.workflows.predict import Prediction

SETTLED_S = MOTION_FILTER.reach
"""So long after the end of a horizon its last second is measured as it will be found in the recording."""
OVER_S = 300.0


@dataclass(frozen=True, slots=True)
class Judged:
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
        names = ("method", "thrusters_moved", "mean_distance_m", "end_distance_m", "along_m", "across_m",
                 "heading_deg", "inside_band")  # fmt: skip
        return {"start": self.start_ns / NANO, **{name: getattr(self, name) for name in names}}


@dataclass(frozen=True, slots=True)
class Mean:
    """Means over judged predictions in whose horizon no thruster moved, None where there is none.

    ``along_m`` and ``across_m`` keep their sign. ``left_out`` counts those in which one moved.
    """

    predictions: int
    left_out: int
    mean_distance_m: float | None = None
    end_distance_m: float | None = None
    along_m: float | None = None
    across_m: float | None = None
    heading_deg: float | None = None
    inside_band: float | None = None


def judged(prediction: Prediction, measured: Floats, thrusters_moved: bool) -> Judged:
    """The error of a prediction against the measured track [H+1, 3] of north, east [m] and heading [rad]."""
    gap = prediction.track[1:, :2] - measured[1:, :2]
    distance = np.hypot(gap[:, 0], gap[:, 1])
    along_m, across_m = in_ship_axes(gap[-1, 0], gap[-1, 1], measured[-1, 2])
    turn = difference_rad(prediction.track[1:, 2], measured[1:, 2])
    inside = None if prediction.band_m is None else float(np.mean(distance <= prediction.band_m[1:]))
    return Judged(
        start_ns=prediction.at.as_unit("ns").value,
        method=prediction.method,
        thrusters_moved=thrusters_moved,
        mean_distance_m=float(distance.mean()),
        end_distance_m=float(distance[-1]),
        along_m=float(along_m),
        across_m=float(across_m),
        heading_deg=float(np.rad2deg(np.abs(turn)).mean()),
        inside_band=inside,
    )


def mean_of(errors: Iterable[Judged]) -> Mean:
    """The means over judged predictions."""
    every = list(errors)
    counted = [each for each in every if not each.thrusters_moved]
    result = Mean(len(counted), len(every) - len(counted))
    if not counted:
        return result
    inside = [each.inside_band for each in counted if each.inside_band is not None]
    return replace(
        result,
        mean_distance_m=float(np.mean([each.mean_distance_m for each in counted])),
        end_distance_m=float(np.mean([each.end_distance_m for each in counted])),
        along_m=float(np.mean([each.along_m for each in counted])),
        across_m=float(np.mean([each.across_m for each in counted])),
        heading_deg=float(np.mean([each.heading_deg for each in counted])),
        inside_band=float(np.mean(inside)) if inside else None,
    )


def thrusters_moved(table: pd.DataFrame, row: int, horizon_s: int, rule: Tolerances | None = None) -> bool:
    """Whether a thruster moved in the seconds ``row`` to ``row + horizon_s`` of a 1 Hz table.

    What counts as moved is the rule by which windows are held.
    """
    rules, rows = rule or Tolerances(), horizon_s + 1
    return not all(held(name, table[name].to_numpy(dtype=float), rows, 1, rules)[row] for name in COMMAND)


class RunningError:
    """Predictions that wait for what they foretold, and the errors of those that have been judged.

    ``unmeasured`` counts those that never can be, as a channel was missing or another recording began.
    """

    def __init__(self, over_s: float = OVER_S) -> None:
        self.over_s = over_s
        self.unmeasured = 0
        self._waiting: deque[Prediction] = deque()
        self._last: deque[Judged] = deque()

    def add(self, prediction: Prediction) -> None:
        """Take a prediction, later than those before it."""
        self._waiting.append(prediction)

    def forget(self) -> None:
        """What waits will not be measured."""
        self.unmeasured += len(self._waiting)
        self._waiting.clear()

    def measured(self, table: pd.DataFrame, until_ns: int) -> list[Judged]:
        """Judge what can be judged by a 1 Hz table that is known up to a time [ns]; the errors, earliest first."""
        found = []
        while self._waiting:
            prediction = self._waiting[0]
            start_ns, horizon_s = prediction.at.as_unit("ns").value, len(prediction.track) - 1
            if until_ns < start_ns + (horizon_s + SETTLED_S) * NANO:
                break
            self._waiting.popleft()
            error = self._judged(prediction, table, start_ns, horizon_s)
            if error is None:
                self.unmeasured += 1
            else:
                found.append(error)
        self._last.extend(found)
        while self._last and self._last[0].start_ns < self._last[-1].start_ns - self.over_s * NANO:
            self._last.popleft()
        return found

    def mean(self) -> Mean:
        """The means over the last ``over_s`` seconds of predictions that have been judged."""
        return mean_of(self._last)

    def _judged(self, prediction: Prediction, table: pd.DataFrame, start_ns: int, horizon_s: int) -> Judged | None:
        times = times_ns(table)
        row = int(np.searchsorted(times, start_ns))
        rows = slice(row, row + horizon_s + 1)
        seconds = table.iloc[rows]
        if len(seconds) <= horizon_s or times[row] != start_ns or times[rows][-1] != start_ns + horizon_s * NANO:
            return None
        heading = np.deg2rad(unwrap(seconds["heading_deg"].to_numpy(dtype=float)))
        track = np.column_stack([seconds["north_m"], seconds["east_m"], heading])
        if not (np.isfinite(track).all() and seconds[list(COMMAND)].notna().all(axis=None)):
            return None
        return judged(prediction, track, thrusters_moved(table, row, horizon_s))
