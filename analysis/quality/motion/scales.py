"""Scales, a bias and an offset of the motion channels as findings, where they are significant.

What is significant may yet not be certain: a factor must be known to half a percent over the whole recording, and
be one that no other channel could be to blame for. A gross factor points to a unit.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from analysis.quality.findings import Finding
from analysis.quality.motion.kinematics import CHANCE, NAMES, Kinematics, quantile

_SMALLEST = {
    "speed_factor": 0.005,
    "yaw_rate_factor": 0.01,
    "yaw_rate_bias_radps": np.deg2rad(0.02),
    "heading_offset_rad": np.deg2rad(0.3),
}
_SYSTEMATIC = {
    "speed_factor": 2e-4,
    "yaw_rate_factor": 5e-4,
    "yaw_rate_bias_radps": np.deg2rad(5e-4),
    "heading_offset_rad": np.deg2rad(0.01),
}
"""What sampling and interpolation may do, as standard deviations: no interval is narrower."""

_CERTAIN_HALF_WIDTH = 0.005


def _interval(fit: Kinematics, name: str) -> tuple[float, float]:
    low, high = fit.interval(name)
    half = float(np.hypot(0.5 * (high - low), 1.96 * _systematic(fit, name)))
    return fit.value(name) - half, fit.value(name) + half


def _clear(fit: Kinematics, name: str, neutral: float = 0.0) -> bool:
    """Whether a figure differs from its neutral value significantly, and by enough to matter."""
    away = abs(fit.value(name) - neutral)
    critical = quantile(1.0 - 0.5 * CHANCE, fit.informative[NAMES.index(name)])
    return bool(away > max(_SMALLEST[name], critical * np.hypot(fit.standard_error(name), _systematic(fit, name))))


def _systematic(fit: Kinematics, name: str) -> float:
    """The systematic standard deviation of a figure; of a factor in proportion to it."""
    return float(_SYSTEMATIC[name] * (abs(fit.value(name)) if name.endswith("factor") else 1.0))


def speed_scale(fit: Kinematics, start: pd.Timestamp, end: pd.Timestamp) -> Finding | None:
    """The factor of surge and sway against the rate of the positions."""
    factor = fit.value("speed_factor")
    how = (
        f"are {_percent_off(factor)} too {'low' if factor > 1.0 else 'high'} for" if factor > 0.0 else "run against"
    )
    found = Finding("speed_scale", "surge_mps", start, end, f"Surge and sway {how} the rate of the positions")
    return _with_factor(found, fit, "speed_factor", SPEED_UNITS, "surge and sway")


def yaw_rate_scale(fit: Kinematics, start: pd.Timestamp, end: pd.Timestamp) -> Finding | None:
    """The factor of the yaw rate against the turns of the heading."""
    factor = fit.value("yaw_rate_factor")
    how = f"{_percent_off(factor)} {'less' if factor > 1.0 else 'more'} than the heading turns"
    text = f"The yaw rate reads {how if factor > 0.0 else 'against the turns of the heading'}"
    found = Finding("yaw_rate_scale", "yaw_rate_dps", start, end, text)
    return _with_factor(found, fit, "yaw_rate_factor", YAW_RATE_UNITS, "the yaw rate")


def _percent_off(factor: float) -> str:
    return f"{abs(1.0 / factor - 1.0):.1%}"


def _with_factor(
    finding: Finding, fit: Kinematics, name: str, units: tuple[Unit, ...], what: str
) -> Finding | None:
    """The finding with its factor in the text and the estimate, and what to do about it; None for none.

    A factor whose interval holds that nothing is wrong is not applied.
    """
    if not _clear(fit, name, 1.0):
        return None
    factor, (low, high) = fit.value(name), _interval(fit, name)
    unit = unit_of(factor, units, low, high)
    text = f"{finding.text} (factor {factor:.4f}, 95 % {low:.4f} to {high:.4f})"
    if unit is not None:
        text += f", {unit.words}"
    if fit.half_between[NAMES.index(name)] > max(_SMALLEST[name], 2.0 * fit.standard_error(name)):
        text += "; it is not the same throughout the recording"
    remedy = f"Multiply {what} by {factor:.4f}."
    if unit is not None and not unit.sure:
        remedy = "Find out which it is."
    elif low <= 1.0 <= high:
        remedy = f"Look at {what} part by part: over the whole recording no one factor is right."
    half = 0.5 * (high - low)
    precise = half < _CERTAIN_HALF_WIDTH * abs(factor) and abs(factor - 1.0) > 4.0 * half
    plausible = unit.sure if unit is not None else FACTORS[0] <= factor <= FACTORS[1]
    estimate = {"factor": factor, "low": low, "high": high}
    return replace(finding, text=text, remedy=remedy, estimate=estimate, certain=bool(precise and plausible))


def yaw_rate_bias(fit: Kinematics, start: pd.Timestamp, end: pd.Timestamp) -> Finding | None:
    """What the yaw rate reads while the heading stays [deg/s]."""
    name = "yaw_rate_bias_radps"
    if not _clear(fit, name):
        return None
    figures = np.array([fit.value(name), *_interval(fit, name)])
    bias, high, low = (-180.0 / np.pi / fit.value("yaw_rate_factor") * figures).tolist()
    text = f"The yaw rate reads {bias:+.3f} deg/s while the heading stays (95 % {low:+.3f} to {high:+.3f})"
    return Finding(
        "yaw_rate_bias", "yaw_rate_dps", start, end, text, "Subtract it, and set the gyro's zero.",
        {"bias_dps": bias, "low": low, "high": high},
    )  # fmt: skip


def heading_offset(fit: Kinematics, start: pd.Timestamp, end: pd.Timestamp) -> Finding | None:
    """The heading against course and drift angle [deg]."""
    name = "heading_offset_rad"
    if not _clear(fit, name):
        return None
    angle, low, high = np.rad2deg([fit.value(name), *_interval(fit, name)]).tolist()
    astern = ", unless surge and sway have the wrong sign" if abs(angle) > 175.0 else ""
    text = (
        f"The heading reads {abs(angle):.2f} deg too far to {'starboard' if angle > 0.0 else 'port'} for course and"
        f" drift angle (95 % {low:+.2f} to {high:+.2f}){astern}"
    )
    return Finding(
        "heading_offset", "heading_deg", start, end, text,
        "Align the compass or subtract the offset, unless the speed sensor's axes are turned the other way.",
        {"angle_deg": angle, "low": low, "high": high},
    )  # fmt: skip


_MATCHES = 0.005
FACTORS = (0.3, 3.0)
"""Beyond these a factor is put right without asking only where it is a unit's."""


@dataclass(frozen=True, slots=True)
class Unit:
    """A factor that a unit or sign makes, in words; ``sure`` where no other channel could be to blame."""

    factor: float
    words: str
    sure: bool = True


SPEED_UNITS = (
    Unit(1852.0 / 3600.0, "as if knots were taken for m/s"),
    Unit(1.0 / 3.6, "as if km/h were taken for m/s"),
    Unit(3600.0 / 1852.0, "as if m/s had been converted from knots twice"),
    Unit(3.6, "as if m/s had been converted from km/h twice"),
    Unit(1.0 / 0.3048, "as if the positions were in feet", sure=False),
    Unit(0.3048, "as if ft/s were taken for m/s", sure=False),
    Unit(-1.0, "as if surge and sway counted the wrong way, unless the heading is half a turn off", sure=False),
)
YAW_RATE_UNITS = (
    Unit(57.29577951308232, "as if rad/s were taken for deg/s"),
    Unit(1.0 / 60.0, "as if deg/min were taken for deg/s"),
    Unit(60.0, "as if deg/s had been converted from deg/min twice"),
    Unit(1.0 / 57.29577951308232, "as if deg/s had been converted from rad/s twice"),
    Unit(-1.0, "as if it counted positive to port"),
    Unit(-57.29577951308232, "as if rad/s were taken for deg/s, and counted positive to port"),
    Unit(-1.0 / 60.0, "as if deg/min were taken for deg/s, and counted positive to port"),
)


def unit_of(factor: float, units: tuple[Unit, ...], low: float, high: float) -> Unit | None:
    """The unit whose factor is this one, within its interval and half a percent."""
    return next(
        (
            unit
            for unit in units
            if low - abs(_MATCHES * unit.factor) <= unit.factor <= high + abs(_MATCHES * unit.factor)
            and abs(factor / unit.factor - 1.0) < _MATCHES
        ),
        None,
    )
