"""Wind that is not what it claims to be: apparent wind recorded as true, and a vane not aligned with the bow.

Winds and velocities are complex numbers here, north + i east, a wind being the vector towards where it comes
from. Then apparent wind = true wind + velocity of the ship, and a turn to starboard by an angle is a factor.
The true wind does not depend on the ship; the reading of the record that makes it the steadiest is the right one.

The conditions of a trial as its recording has them: stated, or measured by the ship's sensors.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from dataclasses import replace
from math import isfinite
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import special

from seatrial.acquisition.config.run_sheet import Conditions, conditions_in_trial
from seatrial.acquisition.core.quantities import Bools, Complexes, Floats, mean_wind_speed_and_direction
from seatrial.acquisition.core.ship import wrap_180, wrap_360
from seatrial.acquisition.core.trial import Quality, Trial
from seatrial.analysis.quality.findings import CheckResult, Finding, uniform_flags
from seatrial.analysis.series import ASSUMED, is_assumed, jackknife_error, leave_one_out_ratios
from seatrial.analysis.tables.table import NANO, Span, seconds_of, utc_index

WIND = ("wind_direction_deg", "wind_speed_mps")
_NEEDED = (*WIND, "heading_deg", "surge_mps", "sway_mps")
_BLOCK_S = 10.0
"""Gusts last longer than this and manoeuvres too: means over it lose the sensors' noise and little else."""
_PIECE_S = 40.0
"""Pieces for the jackknife: several blocks, as what is new in a block is hardly correlated with the next."""
_FEWEST_BLOCKS = 18
_FEWEST_PIECES = 8
_CHANCE = 1e-3
_EVIDENCE = 12.0
"""Natural logarithm of a likelihood ratio: 9 is what chance does once in 10 000, if gusts were Gaussian."""
_CLEAR_RATIO = 1.2
_OVERWHELMING_RATIO = 2.0
_SMALLEST_OFFSET_DEG = 2.0
_READINGS = ("relative to the bow", "relative to north")


def check_wind(table: pd.DataFrame) -> CheckResult:
    """Find apparent wind recorded as true (``wind_apparent``), else a turned vane (``wind_direction_offset``).

    ``estimate`` of the former: ``variance_ratio``, the variance of the wind as recorded over that of the true wind
    from the better reading, and ``relative_to_bow`` (1 or 0); certain where it is overwhelming. Of the latter:
    ``angle_deg`` by which the vane reads too much, with ``low`` and ``high``. A bias of the true wind's direction
    that is the same on all headings cannot be distinguished from a wind from there, and is not looked for. Wind
    that was assumed, not measured, is passed over.
    """
    names = tuple(name for name in WIND if name in table)
    blocks = _block_means(table)
    if blocks is None:
        return CheckResult(uniform_flags(table, names, Quality.NOT_EVALUATED))
    start, end = utc_index(table)[np.flatnonzero(table["wind_direction_deg"].notna())[[0, -1]]]
    finding = _find_apparent_wind(blocks, (start, end)) or _find_vane_offset(blocks, (start, end))
    if finding is None:
        return CheckResult(uniform_flags(table, names))
    return CheckResult(uniform_flags(table, names, Quality.SUSPECT), (finding,))


def true_wind(table: pd.DataFrame, relative_to_bow: bool) -> tuple[Floats, Floats]:
    """Direction [deg, from true north] and speed [m/s] of the true wind, the recorded one being apparent: [rows].

    Vectorised form of :func:`seatrial.acquisition.core.quantities.wind_over_ground`; NaN where a channel has been
    silent for 2 s, and where the wind itself is not recorded.
    """
    apparent, velocity, bow = _wind_ship_and_bow_vectors(table)
    true = apparent * bow - velocity if relative_to_bow else apparent - velocity
    recorded = table[list(WIND)].notna().to_numpy()
    direction = np.where(recorded[:, 0], wrap_360(np.rad2deg(np.angle(true))), np.nan)
    return direction, np.where(recorded[:, 1], np.abs(true), np.nan)


def _wind_ship_and_bow_vectors(table: pd.DataFrame) -> tuple[Complexes, Complexes, Complexes]:
    """Recorded wind, velocity of the ship and its bow, as north + i east, in the rows of the wind: each [rows].

    Of channels that came at other times they have the last values of two seconds.
    """
    needed = table[list(_NEEDED)]
    values, recorded = needed.to_numpy(dtype=float), needed.notna().to_numpy()
    if not np.count_nonzero(recorded.all(axis=1)) > 0.5 * np.count_nonzero(recorded[:, 0]):
        times = utc_index(table)
        latest = np.maximum.accumulate(np.where(recorded, np.arange(len(table))[:, np.newaxis], -1))
        age_ns = times.asi8[:, np.newaxis] - times.asi8[np.maximum(latest, 0)]
        recent = (latest >= 0) & (age_ns <= 2 * NANO)
        values = np.where(recent, np.take_along_axis(values, np.maximum(latest, 0), axis=0), np.nan)
    direction, speed, heading, surge, sway = values.T
    bow = np.exp(1j * np.deg2rad(heading))
    return speed * np.exp(1j * np.deg2rad(direction)), (surge + 1j * sway) * bow, bow


class _Blocks(NamedTuple):
    """Means over 10 s, all [n]: recorded wind, that turned by the heading, the ship's velocity; their times; which
    but the first follow directly on the one before [n - 1]."""

    recorded: Complexes
    turned: Complexes
    velocity: Complexes
    time_s: Floats
    follows: Bools


def _block_means(table: pd.DataFrame) -> _Blocks | None:
    """Block means of what is needed, or None where wind or motion is missing, assumed, or there is too little."""
    sources = table.attrs.get("sources", {})
    if any(name not in table for name in _NEEDED) or any(ASSUMED in sources.get(name, ()) for name in WIND):
        return None
    since_s = seconds_of(table)
    recorded, velocity, bow = _wind_ship_and_bow_vectors(table)
    valid = np.isfinite(recorded * velocity)
    if not valid.any() or not np.ptp(np.abs(recorded[valid])) > 0.0:
        return None
    number, group = np.unique(np.floor(since_s[valid] / _BLOCK_S), return_inverse=True)
    count = np.bincount(group)
    full = count >= 0.5 * np.median(count)
    if full.sum() < _FEWEST_BLOCKS:
        return None
    recorded, turned, velocity = (
        (_sum_by_group(group, quantity[valid]) / count)[full] for quantity in (recorded, recorded * bow, velocity)
    )
    time_s = number[full] * _BLOCK_S
    follows = np.diff(time_s) < 1.5 * _BLOCK_S
    # What is new in a block is relative to the one before.
    return _Blocks(recorded, turned, velocity, time_s, follows) if follows.any() else None


def _sum_by_group(group: NDArray[np.intp], vector: Complexes) -> Complexes:
    """The sum of ``vector`` by group."""
    total: Complexes = np.bincount(group, vector.real) + 1j * np.bincount(group, vector.imag)
    return total


def _find_apparent_wind(blocks: _Blocks, span: Span) -> Finding | None:
    """Whether the true wind is clearly likelier when the recorded one is taken for apparent.

    Gusts are correlated over a minute and turns of the ship are not, so the winds are compared by what is new in
    each block: the likelihood of a first-order autoregression. The readings are shifts and turns of the same
    record without a free parameter, which makes likelihoods comparable as they are.
    """
    readings = blocks.turned - blocks.velocity, blocks.recorded - blocks.velocity, blocks.recorded
    new_in_block = [_mean_square(_autoregression_innovations(blocks, reading, reading)) for reading in readings]
    best = int(np.argmin(new_in_block[:2]))
    evidence = np.count_nonzero(blocks.follows) * np.log(new_in_block[2] / max(new_in_block[best], 1e-12))
    recorded_variance, variance = (
        _mean_square(_detrend_over_blocks(blocks, readings[place])) for place in (2, best)
    )
    ratio = recorded_variance / max(variance, 1e-12)
    if evidence < _EVIDENCE or ratio < _CLEAR_RATIO:
        return None
    text = (
        f"wind is recorded as felt on board, {_READINGS[best]}: taken so, the true wind is steadier by a factor of "
        f"{ratio:.1f} in variance"
    )
    remedy = "Take off the ship's velocity to get the true wind"
    estimate = {"variance_ratio": ratio, "relative_to_bow": float(best == 0)}
    certain = bool(evidence > 3.0 * _EVIDENCE and ratio > _OVERWHELMING_RATIO)
    return Finding("wind_apparent", WIND[0], *span, text, remedy, estimate, certain)


def _find_vane_offset(blocks: _Blocks, span: Span) -> Finding | None:
    """The angle by which a vane is turned, from true wind that moves with the ship.

    With the vane turned by b the recorded wind is (T + V) exp(ib) - V, T being the true wind and V the ship's
    velocity; T is steadiest for the b that is the argument of the covariance of recorded wind + V with V, the gain.
    Both are taken by what is new in each block, weighted so as generalised least squares does for gusts with a
    memory; that memory is known once b is. The uncertainty is that of a jackknife over pieces of 40 s. The gain
    should be exp(ib): a modulus that is not about one shows that something else is wrong with the wind.
    """
    apparent, velocity, gain = blocks.recorded + blocks.velocity, blocks.velocity, 1.0 + 0.0j
    number = np.unique(np.floor(blocks.time_s[1:][blocks.follows] / _PIECE_S), return_inverse=True)[1]
    for _ in range(3):
        gusts = apparent / gain - velocity
        new_apparent, new_velocity = (
            _autoregression_innovations(blocks, vector, gusts) for vector in (apparent, velocity)
        )
        cross = _sum_by_group(number, new_apparent * new_velocity.conj())
        squares = np.bincount(number, np.abs(new_velocity) ** 2)
        gain = complex(cross.sum() / max(squares.sum(), 1e-12)) or 1.0 + 0.0j
    degrees_of_freedom = cross.size - 1
    if degrees_of_freedom < _FEWEST_PIECES - 1:
        return None
    relative = leave_one_out_ratios(cross, squares) / gain
    modulus_error = float(jackknife_error(relative.real))
    error_deg = float(np.rad2deg(float(jackknife_error(relative.imag))))
    angle_deg = float(np.rad2deg(np.angle(gain)))
    significant_deg, half = (
        float(special.stdtrit(degrees_of_freedom, probability)) * error_deg
        for probability in (1.0 - _CHANCE / 2.0, 0.975)
    )
    is_clear = abs(angle_deg) >= max(significant_deg, _SMALLEST_OFFSET_DEG)
    if not is_clear or not 0.7 < abs(gain) < 1.4 or modulus_error > 0.15:
        return None
    text = f"the vane reads {angle_deg:+.1f} deg too much ({angle_deg - half:.1f} to {angle_deg + half:.1f}): "
    text += "the true wind shifts with the ship's heading and speed"
    remedy = "Take the angle off the apparent wind and derive the true wind again"
    low, high = wrap_180(angle_deg - half), wrap_180(angle_deg + half)
    estimate = {"angle_deg": angle_deg, "low": float(low), "high": float(high)}
    return Finding("wind_direction_offset", WIND[0], *span, text, remedy, estimate)


def _detrend_over_blocks(blocks: _Blocks, vector: Complexes) -> Complexes:
    """Without its mean and trend: a wind that veers slowly must not count for the ship's turns."""
    since = np.polynomial.legendre.legvander(np.interp(blocks.time_s, blocks.time_s[[0, -1]], [-1.0, 1.0]), 2)
    return np.asarray(vector - since @ np.linalg.lstsq(since, vector, rcond=None)[0])


def _autoregression_innovations(blocks: _Blocks, vector: Complexes, gusts: Complexes) -> Complexes:
    """Innovations of a first-order autoregression with the memory of ``gusts``, 0 to 0.95: each block less its
    prediction from the one before."""
    deviations = _detrend_over_blocks(blocks, gusts)
    before, after = deviations[:-1][blocks.follows], deviations[1:][blocks.follows]
    correlation = np.sum(after * before.conj()).real / max(np.sum(np.abs(before) ** 2), 1e-12)
    memory = float(np.clip(correlation, 0.0, 0.95))
    deviations = _detrend_over_blocks(blocks, vector)
    innovations: Complexes = (deviations[1:] - memory * deviations[:-1])[blocks.follows]
    return innovations


def _mean_square(vector: Complexes) -> float:
    return float(np.mean(np.abs(vector) ** 2))


BEAUFORT_MPS = (0.3, 1.6, 3.4, 5.5, 8.0, 10.8, 13.9, 17.2, 20.8, 24.5, 28.5, 32.7)
"""The mean speeds from which the force of the wind is one more, by the World Meteorological Organization."""

_WIND = ["wind_speed_mps", "wind_direction_deg"]
_SEA_WORDS = {
    "glassy": 0, "rippled": 1, "smooth": 2, "slight": 3, "moderate": 4, "rough": 5, "very rough": 6, "high": 7,
    "very high": 8, "phenomenal": 9,
}  # fmt: skip
"""The words of the state of the sea (World Meteorological Organization, code table 3700)."""


def beaufort_number(speed_mps: float) -> int:
    """The wind's force from its mean speed [m/s].

    >>> beaufort_number(0.2), beaufort_number(8.0), beaufort_number(40.0)
    (0, 5, 12)
    """
    return bisect_right(BEAUFORT_MPS, speed_mps)


def parse_sea_state(words: str) -> int | None:
    """The state of the sea that the crew's words name, by its number or its word; None where they name none or two.

    >>> [parse_sea_state(words) for words in ("sea state 3", "very rough", "2 to 3", "swell 2 m")]
    [3, 6, None, None]
    """
    number = re.fullmatch(r"(?:sea\s*state\s*|ss\s*|douglas\s*)?(\d)", words.strip(), re.I)
    if number:
        return int(number[1])
    plain = re.sub(r"\bseas?\b", "", words.lower()).strip()
    return _SEA_WORDS.get(plain)


def recorded_conditions(trial: Trial, table: pd.DataFrame) -> Conditions:
    """The conditions in a recording: its ``[conditions]`` and run sheet, the mean wind, the water's temperature."""
    temperature_degc = (
        float(table["water_temperature_degc"].mean()) if "water_temperature_degc" in table else float("nan")
    )
    air = table.reindex(columns=_WIND).dropna().iloc[: 0 if is_assumed(table, _WIND[0]) else None]
    measured = Conditions(
        water_depth_m=trial.water_depth_m, draught_m=trial.draught_m, trim_m=trial.trim_m,
        sea_state=parse_sea_state(trial.sea_state),
        beaufort=beaufort_number(mean_wind_speed_and_direction(air)[0]) if len(air) else None,
        water_temperature_degc=temperature_degc if isfinite(temperature_degc) else None,
    )  # fmt: skip
    return replace_by_stronger_wind(conditions_in_trial(trial).completed_from(measured), measured)


def replace_by_stronger_wind(stated: Conditions, measured: Conditions) -> Conditions:
    """Stated conditions, with the wind that was measured where that was stronger."""
    forces = [force for force in (stated.beaufort, measured.beaufort) if force is not None]
    return replace(stated, beaufort=max(forces, default=None))
