"""The steering gear from order and feedback: rate, lag and dead band, before the hull is fitted.

What turns the ship is the angle that acts, so the hull is fitted to the feedback; what a manoeuvre not yet sailed
does depends on how that angle follows its order. Where both are recorded, the gear is known by itself, and an error
in it is not put into the hull.

The angle moves towards the order with a first-order lag, no faster than its rate, and stands where it is within the
dead band of the order. Rate and lag are fitted by least squares for each dead band of a search; intervals come from
leaving out each of some stretches in turn (jackknife, Efron and Stein 1981).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import exp, log
from typing import Any

import numpy as np
import pandas as pd
from scipy.optimize import least_squares, minimize_scalar
from scipy.stats import t as student_t

from seatrial.acquisition.core.quantities import Floats
from seatrial.acquisition.core.ship import is_circular, order_channel_name, unwrap
from seatrial.analysis.tables.table import NANO, times_ns
from seatrial.hybrid.prediction.baselines import Interval
from seatrial.hybrid.simulation.manoeuvres import follow_with_band
from seatrial.hybrid.vessel.actuators import KINDS
from seatrial.hybrid.vessel.files import Vessel

_LEAST_TRAVEL_DEG, _LEAST_CHANGES = 10.0, 4  # of the orders, below which a gear does not show
_WIDEST_BAND_DEG, _BLOCKS = 4.0, 8
_BAND_GAIN = 0.98  # of the squares: a dead band that leaves more of them is none
_STEPS_PER_RECORD, _SHORTEST_STEP_S, _LONGEST_STEP_S = 10, 0.01, 0.2


@dataclass(frozen=True, slots=True)
class GearFit:
    """The gear of one angle: its rate [deg/s], lag [s] and dead band [deg], and the rms residual [deg]."""

    channel: str
    rate_dps: Interval
    lag_s: Interval
    dead_band_deg: Interval
    error_deg: float


@dataclass(frozen=True, slots=True)
class _Stretch:
    """Orders on an even grid [K] of ``step_s``, and the feedback [T] at the grid's ``rows`` [T]; in degrees."""

    orders: Floats
    feedback: Floats
    rows: np.ndarray
    step_s: float

    def residual(self, rate_dps: float, lag_s: float, band_deg: float) -> Floats:
        """The response less the feedback [T]."""
        response = follow_with_band(self.orders, self.feedback[0], rate_dps, lag_s, band_deg, self.step_s)
        return np.asarray(response[self.rows] - self.feedback)


def fit_gear(tables: Mapping[str, pd.DataFrame], vessel: Vessel) -> tuple[Vessel, tuple[GearFit, ...]]:
    """The vessel with the rate and lag of every angle whose order and feedback are recorded, and the fits.

    ``tables`` are tables of samples by recording. An angle that was hardly ordered about stays as it is.
    """
    fits, entries = list[GearFit](), list[Any](vessel.actuator)
    for number, (entry, actuator) in enumerate(zip(vessel.actuator, vessel.actuators, strict=True)):
        names = KINDS[entry.kind].gear
        if names is None or actuator.angle is None:
            continue
        channel = actuator.angle.name
        stretches = [stretch for table in tables.values() for stretch in _order_feedback_stretches(table, channel)]
        changes = sum(np.count_nonzero(np.diff(stretch.orders)) for stretch in stretches)
        if changes < _LEAST_CHANGES or max(np.ptp(stretch.orders) for stretch in stretches) < _LEAST_TRAVEL_DEG:
            continue  # the orders do not move the angle enough to show its gear
        gear = _fit_with_intervals(channel, stretches, getattr(entry, names[0]), getattr(entry, names[1]))
        changed: dict[str, Any] = {names[0]: gear.rate_dps.value, names[1]: gear.lag_s.value}
        entries[number] = replace(entry, **changed)
        fits.append(gear)
    return replace(vessel, actuator=tuple(entries)), tuple(fits)


def _order_feedback_stretches(table: pd.DataFrame, channel: str) -> Iterator[_Stretch]:
    """Order and feedback of one table; none where one is not recorded. An order holds until the next."""
    order = order_channel_name(channel)
    if not {order, channel} <= set(table) or table[order].notna().sum() < _LEAST_CHANGES:
        return
    orders, feedback = table[order].dropna(), table[channel].dropna()
    order_s, feedback_s = (times_ns(series.to_frame()) / NANO for series in (orders, feedback))
    ordered = feedback_s >= order_s[0]
    feedback_s = feedback_s[ordered]
    if feedback_s.size < _LEAST_CHANGES:
        return
    order_deg, feedback_deg = (
        unwrap(values) if is_circular(channel) else values
        for values in (orders.to_numpy(dtype=float), feedback.to_numpy(dtype=float)[ordered])
    )
    interval_s = np.median(np.diff(feedback_s))
    step_s = float(np.clip(interval_s / _STEPS_PER_RECORD, _SHORTEST_STEP_S, _LONGEST_STEP_S))
    grid_s = np.arange(feedback_s[0], feedback_s[-1] + step_s, step_s)
    order_on_grid = order_deg[np.searchsorted(order_s, grid_s, side="right") - 1]
    rows = np.minimum(np.rint((feedback_s - feedback_s[0]) / step_s).astype(int), grid_s.size - 1)
    yield _Stretch(order_on_grid, feedback_deg, rows, step_s)


def _fit_with_intervals(channel: str, stretches: Sequence[_Stretch], rate_dps: float, lag_s: float) -> GearFit:
    """The gear with jackknife intervals over blocks of the records."""
    blocks = np.concatenate([np.arange(s.feedback.size) * _BLOCKS // s.feedback.size for s in stretches])
    start = log(max(rate_dps, 0.1)), log(max(lag_s, 0.05))
    best = _fit_numbers(stretches, start, np.ones(blocks.size, dtype=bool))
    begin = log(best[0]), log(best[1])
    without = np.array([_fit_numbers(stretches, begin, blocks != block) for block in range(_BLOCKS)])
    spread = np.sqrt((_BLOCKS - 1) / _BLOCKS * np.square(without - without.mean(axis=0)).sum(axis=0))
    within = student_t.ppf(0.975, _BLOCKS - 1) * spread
    residual = np.concatenate([stretch.residual(*best) for stretch in stretches])
    bounds = zip(best, within.tolist(), strict=True)
    rate, lag, band = (Interval(value, max(value - reach, 0.0), value + reach) for value, reach in bounds)
    return GearFit(channel, rate, lag, band, float(np.sqrt(np.mean(residual**2))))


def _fit_numbers(
    stretches: Sequence[_Stretch], start: tuple[float, float], chosen: np.ndarray
) -> tuple[float, float, float]:
    """Rate [deg/s], lag [s] and dead band [deg] with the least squares over the ``chosen`` records."""

    def fit_rate_and_lag(band_deg: float) -> tuple[float, Floats]:
        def residual(logs: Floats) -> Floats:
            parts = [stretch.residual(exp(logs[0]), exp(logs[1]), band_deg) for stretch in stretches]
            return np.asarray(np.concatenate(parts)[chosen])

        solution = least_squares(residual, start, bounds=(np.log([0.05, 1e-3]), np.log([200.0, 60.0])),
                                 diff_step=1e-3, loss="soft_l1")  # fmt: skip
        return float(solution.cost), solution.x

    without_band = fit_rate_and_lag(0.0)
    search = minimize_scalar(
        lambda band_deg: fit_rate_and_lag(band_deg)[0],
        bounds=(0.0, _WIDEST_BAND_DEG),
        method="bounded",
        options={"xatol": 0.02},
    )
    band_deg = float(search.x) if search.fun < _BAND_GAIN * without_band[0] else 0.0
    rate, lag = np.exp(without_band[1] if band_deg == 0.0 else fit_rate_and_lag(band_deg)[1]).tolist()
    return rate, lag, band_deg
