"""Is a thruster held? One rule for shafts and azimuths, that noise does not defeat and a ramp does not pass.

A setting is held over a window when two things are small: the range of its values, which catches steps and
spikes, and the drift, which is the slope of the best line through them times the window's length and catches
slow ramps that stay within the range. Both bounds join a floor, what a held handle does by itself, and a
multiple of the noise of the feedback, which is measured on the table itself: as a sum for the range, where the
two add up, and as the root of squares for the drift, so that noise opens it no wider than it must. Feedback that
was faster than the table has been filtered: its noise is less, but neighbours share it, which second differences
take for quiet and a line through a window for drift. The filter's own correlation puts both right.

Near zero revolutions the rule is about thrust, which goes with their square: a shaft that stays within the
idle band throughout, where it gives less than 1 % of its thrust at 130 rpm, may flicker in it and only the
drift counts. An azimuth counts whether its shaft turns or not: a pod that swings with an idle propeller still
steers a ship that has way on.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from acquisition.core.actuators import DEFAULT, Actuators, kind_of_control
from acquisition.core.angles import unwrap
from acquisition.core.arrays import Bools, Floats
from acquisition.core.channels import is_circular
from analysis.estimation.noise_levels import noise_of
from analysis.tables.resample import SETTING_FILTER

Sort = Literal["azimuth", "shaft", "tunnel"]
_FILTERED_RATIO = 1.5  # of the noise seen two rows apart to that seen from row to row: 1 if white, 2.1 if filtered


@dataclass(frozen=True, slots=True)
class Tolerance:
    """What a held setting may do without noise, in the channel's unit, and the most noise to allow for.

    ``noise`` bounds the standard deviation: more than that is no noise but somebody at the handle.
    """

    span: float
    drift: float
    noise: float


@dataclass(frozen=True, slots=True)
class Tolerances:
    """The rule for each sort of setting (:func:`sort_of`); the multiples of noise are in standard deviations.

    At 8 standard deviations of range and 4.75 of drift a held window of 15 s with Gaussian noise is lost
    once in some 200,000; a ramp of 0.5 deg/s is told from held at noise of up to 1 deg. ``idle_rpm`` is the
    idle band of a shaft and ``idle_drift_rpm`` what it may drift in it over a window.
    """

    shaft: Tolerance = field(default_factory=lambda: Tolerance(span=3.0, drift=1.5, noise=4.0))
    azimuth: Tolerance = field(default_factory=lambda: Tolerance(span=2.0, drift=1.0, noise=2.0))
    tunnel: Tolerance = field(default_factory=lambda: Tolerance(span=10.0, drift=5.0, noise=10.0))
    span_sigmas: float = 8.0
    drift_sigmas: float = 4.75
    idle_rpm: float = 12.0
    idle_drift_rpm: float = 5.0


@dataclass(frozen=True, slots=True)
class Feedback:
    """The noise on a setting's feedback: its standard deviation, and whether neighbours share it."""

    noise: float
    filtered: bool

    def drift_of(self, line: Floats) -> float:
        """The standard deviation that this noise gives the sum of values weighted with ``line`` [rows]."""
        shared = _shared(line.size) if self.filtered else np.eye(1, line.size)[0]
        apart = np.abs(np.subtract.outer(np.arange(line.size), np.arange(line.size)))
        return self.noise * float(np.sqrt((line @ shared[apart] * line).sum()))


def feedback_of(values: Floats, most: float = np.inf) -> Feedback:
    """The noise on a series that may have been filtered, ``most`` at most; see :func:`noise_of`."""
    noise, wide = noise_of(values), noise_of(values, 2)
    if wide <= _FILTERED_RATIO * noise:
        return Feedback(min(noise, most), False)
    _, _, second, _, fourth = _shared(5)
    return Feedback(min(wide / float(np.sqrt(1.0 - 4.0 / 3.0 * second + fourth / 3.0)), most), True)


def _shared(rows: int) -> Floats:
    """The correlation of filtered noise 0, 1, 2 .. rows apart [rows], from the filter's weights."""
    parts = 50
    offset = np.arange(-SETTING_FILTER.reach * parts, SETTING_FILTER.reach * parts + 1) / parts
    weight = (0.5 + 0.5 * np.cos(np.pi * offset / SETTING_FILTER.reach)) ** SETTING_FILTER.taper
    product = np.correlate(weight, weight, "full")[weight.size - 1 :: parts]
    result = np.zeros(max(rows, product.size))
    result[: product.size] = product / product[0]
    return result[:rows]


def held(
    name: str, values: Floats, rows: int, stride: int, rule: Tolerances, actuators: Actuators = DEFAULT
) -> Bools:
    """For each candidate window of ``rows`` values, every ``stride`` values: is the setting held in it?

    ``name`` is a control channel of a ship with these ``actuators``; a window with a NaN is not held.
    """
    series = unwrap(values) if is_circular(name) else values
    tolerance = tolerance_of(name, rule, actuators)
    feedback = feedback_of(series, tolerance.noise)
    windows = sliding_window_view(series, rows)[::stride]
    line = _line_weights(rows)
    span = windows.max(axis=1) - windows.min(axis=1)
    drift = (windows - windows[:, :1]) @ line
    span_limit = tolerance.span + rule.span_sigmas * feedback.noise
    drift_limit = np.hypot(tolerance.drift, rule.drift_sigmas * feedback.drift_of(line))
    steady = (span <= span_limit) & (np.abs(drift) <= drift_limit)
    if not is_circular(name):
        steady |= (np.abs(windows).max(axis=1) <= rule.idle_rpm) & (np.abs(drift) <= rule.idle_drift_rpm)
    return np.asarray(steady)


def sort_of(name: str, actuators: Actuators) -> Sort:
    """What sort of setting a control channel is: an angle, a tunnel thruster's shaft, another shaft."""
    if is_circular(name):
        return "azimuth"
    return "tunnel" if kind_of_control(name, actuators) == "tunnel" else "shaft"


def tolerance_of(name: str, rule: Tolerances, actuators: Actuators = DEFAULT) -> Tolerance:
    """The tolerance that applies to a control channel of a ship with these actuators."""
    tolerance: Tolerance = getattr(rule, sort_of(name, actuators))
    return tolerance


def _line_weights(rows: int) -> Floats:
    """What a window is multiplied with to get the rise of its best line from first to last value."""
    centred = np.arange(rows) - (rows - 1) / 2.0
    return np.asarray(centred / (centred @ centred) * (rows - 1))
