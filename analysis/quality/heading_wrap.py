"""Angles that were resampled as plain numbers: straight lines between 360 and 0, or between 180 and -180.

A ship that passes north turns by a degree or two; her heading as a number falls by almost a whole turn. Whoever
interpolates the numbers draws a line across the circle, and its samples point anywhere. Found from the rate of
turn: the ends of such a line agree with it on the circle, and what lies between does not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy import special

from seatrial.acquisition.core.quantities import Bools, Floats
from seatrial.acquisition.core.ship import BY_NAME, difference, is_circular, wrap_360
from seatrial.acquisition.core.trial import Quality
from seatrial.analysis.quality.findings import CheckResult, Finding, mark, uniform_flags
from seatrial.analysis.quality.samples import Samples, robust_spread, runs, runs_of_equal, samples_of
from seatrial.analysis.tables.table import table_controls, utc_index

WRAP_INTERPOLATED = "heading_wrap_interpolated"
_ALWAYS_JUDGED = ("heading_deg", "wind_direction_deg")
_SMALLEST_DEG = 1.0
"""Samples nearer than this to where they belong are left: they do no harm and noise looks like them."""
_LARGEST_DEG = 45.0
"""An angle whose steps scatter so widely (wind in a calm) that the limit would be larger is not judged."""
_LONGEST_STEP = 5.0
"""Steps longer than so many usual ones are holes: what happened there is not known."""
_FEWEST_SPOILT = 0.1
_LUCK = 1e-4
_CONTROL_TURNS_DEG = (73.0, 131.0, 229.0, 287.0)
"""Not halves, thirds or quarters of a turn: samples on the lines crowd there."""


def is_judged(table: pd.DataFrame, name: str) -> bool:
    """Whether a channel is an angle that :func:`check_heading_wrap` judges: heading, wind, an actuator's."""
    return name in _ALWAYS_JUDGED or (name in table_controls(table) and is_circular(name))


def check_heading_wrap(table: pd.DataFrame) -> CheckResult:
    """Find angles that were interpolated straight through their seam (``heading_wrap_interpolated``).

    Judges the heading, the wind's direction and the azimuths, one finding a channel; the samples on the
    lines are flagged bad. ``estimate`` says how many ``samples`` on how many ``places``.
    """
    judged = (name for name in (*_ALWAYS_JUDGED, *table_controls(table)) if is_judged(table, name))
    names = tuple(name for name in judged if name in table)
    flags, index, findings = uniform_flags(table, names), utc_index(table), []
    for name in names:
        series = _possible(table, name)
        wrong, places = _wrong_samples(table, name, series)
        rows = series.rows[wrong]
        mark(flags, name, rows, Quality.BAD)
        if places:
            findings.append(_finding(name, index[rows[0]], index[rows[-1]], rows.size, places))
    return CheckResult(flags, tuple(findings))


def seam_line_mask(table: pd.DataFrame, name: str) -> Bools:
    """Whether each value of an angle lies on a straight line through its seam: [rows]."""
    wrong = np.zeros(len(table), np.bool_)
    series = _possible(table, name)
    wrong[series.rows[_wrong_samples(table, name, series)[0]]] = True
    return wrong


def _finding(name: str, start: pd.Timestamp, end: pd.Timestamp, samples: int, places: int) -> Finding:
    seam = "360 and 0" if BY_NAME[name].low == 0.0 else "180 and -180"
    text = f"{name} was interpolated as a plain number between {seam}: {samples} samples in {places} places"
    remedy = "They are put back on the circle between their neighbours by --repair"
    return Finding(WRAP_INTERPOLATED, name, start, end, text, remedy,
                   {"samples": float(samples), "places": float(places)}, certain=True)  # fmt: skip


def _possible(table: pd.DataFrame, name: str) -> Samples:
    """The values that are angles; a sentinel is none, and no place on a line either."""
    series, channel = samples_of(table, name), BY_NAME[name]
    held = (series.value >= channel.low) & (series.value <= channel.high)
    return Samples(series.rows[held], series.time_s[held], series.value[held])


def _wrong_samples(table: pd.DataFrame, name: str, series: Samples) -> tuple[Bools, int]:
    """The wrong samples [n] and the number of places; none where chance explains them as well.

    A spike that happens to stand where the ship passes north looks the same. It would stand as often where she
    passes east, so the circle is turned, and what is found then is what chance brings; and spikes stand in few
    of the passages, and at other places too. Angles without a measured rate must show three places.
    """
    nothing = np.zeros(series.rows.size, np.bool_), 0
    if series.rows.size < 4:
        return nothing
    expected_deg = _expected_steps(table, name, series)
    scatter_deg = robust_spread(difference(np.diff(series.value), expected_deg))
    if 10.0 * scatter_deg > _LARGEST_DEG:
        return nothing
    limit_deg = max(10.0 * scatter_deg, _SMALLEST_DEG)
    from_seam = wrap_360(series.value - BY_NAME[name].low)
    lines = _lines(series.time_s, from_seam, expected_deg, limit_deg)
    if lines.places < (1 if name == "heading_deg" else 3) or lines.could_be_spikes():
        return nothing
    turned = [
        _lines(series.time_s, wrap_360(from_seam + turn), expected_deg, limit_deg).places
        for turn in _CONTROL_TURNS_DEG
    ]
    return (lines.wrong, lines.places) if lines.places > 3 * max(turned) else nothing


def _expected_steps(table: pd.DataFrame, name: str, series: Samples) -> Floats:
    """How far the angle should turn from each sample to the next [n-1, deg]: by the yaw rate, else not at all."""
    rate = samples_of(table, "yaw_rate_dps")
    if name != "heading_deg" or rate.rows.size < 2:
        return np.zeros(series.rows.size - 1)
    rate_dps = np.interp(series.time_s, rate.time_s, rate.value)
    return 0.5 * (rate_dps[1:] + rate_dps[:-1]) * np.diff(series.time_s)


@dataclass(frozen=True, slots=True)
class _Group:
    """Consecutive steps that the rate of turn does not explain, samples ``first`` to ``last``."""

    first: int
    last: int
    turns: int
    off_deg: Floats
    """How far the samples between the ends are from where they belong."""
    closes: bool
    """Whether the ends agree with the rate of turn on the circle."""
    at_seam: bool


@dataclass(frozen=True, slots=True)
class _Lines:
    """The samples on lines across the circle [n], on how many ``places``, and the evidence for spikes instead."""

    wrong: Bools
    places: int
    spoilt_passages: int
    sound_passages: int
    elsewhere: int
    """Excursions of the same kind that have nothing to do with the seam."""

    def could_be_spikes(self) -> bool:
        """Whether few of the passages are affected, or no more than the excursions elsewhere make likely."""
        passages = self.spoilt_passages + self.sound_passages
        share = _LUCK + 3.0 * self.elsewhere / self.wrong.size
        by_chance = float(special.bdtrc(self.spoilt_passages - 1, passages, min(share, 1.0)))
        return self.spoilt_passages < _FEWEST_SPOILT * passages or by_chance > 0.01


def _lines(time_s: Floats, from_seam_deg: Floats, expected_deg: Floats, limit_deg: float) -> _Lines:
    """Lines across the circle of angles that are counted from the seam."""
    step_deg = np.diff(from_seam_deg)
    hole = np.diff(time_s) > _LONGEST_STEP * np.median(np.diff(time_s))
    wild = (np.abs(step_deg - expected_deg) > limit_deg) & ~hole
    # Two stray samples may stand level, so that the step between them looks sound.
    wild[1:-1] |= wild[:-2] & wild[2:] & ~hole[1:-1]
    path_deg = np.concatenate([[0.0], np.cumsum(expected_deg)])
    groups = [
        _group(int(first), int(stop), from_seam_deg, path_deg, limit_deg)
        for first, stop in zip(*runs(wild), strict=True)
        if stop - first >= 2
    ]
    usable = [group for group in groups if group.closes and (np.abs(group.off_deg) > 2.0 * limit_deg).any()]
    wrong = np.zeros(time_s.size, np.bool_)
    whole_deg = 360.0 - 6.0 * limit_deg
    certain = [
        group
        for group in usable
        if abs(group.turns) == 1 or _makes_whole_turn(step_deg[group.first : group.last], whole_deg)
    ]
    # Swinging about the seam, samples may go astray twice and come back on the side they left from: no turn
    # is left over. Alone that is a spike near north; beside places that are sure it is one of them.
    swings = [group for group in usable if group.turns == 0 and group.at_seam and len(certain) >= 3]
    for group in (*certain, *swings):
        wrong[group.first + 1 : group.last] |= np.abs(group.off_deg) > limit_deg
    passes = (np.abs(step_deg) > whole_deg) & ~wrong[:-1] & ~wrong[1:]
    elsewhere = sum(group.turns == 0 and not group.at_seam for group in usable)
    return _Lines(wrong, int(runs(wrong)[0].size), len(certain), int(passes.sum()), int(elsewhere))


def _group(first: int, last: int, from_seam_deg: Floats, path_deg: Floats, limit_deg: float) -> _Group:
    turned = from_seam_deg[last] - from_seam_deg[first]
    expected = path_deg[last] - path_deg[first]
    turns = round((turned - expected) / 360.0)
    left_deg = turned - expected - 360.0 * turns
    inside = np.arange(first + 1, last)
    share = (inside - first) / (last - first)
    belongs = from_seam_deg[first] + path_deg[inside] - path_deg[first] + share * left_deg
    off_deg = difference(from_seam_deg[inside], belongs)
    # A rate of turn that is a few per cent wrong adds its share over a long group.
    closes = abs(left_deg) < limit_deg * np.sqrt(last - first) + 0.1 * abs(expected)
    ends = from_seam_deg[[first, last]]
    at_seam = bool((np.minimum(ends, 360.0 - ends) < 3.0 * limit_deg).all())
    return _Group(first, last, turns, off_deg, bool(closes), at_seam)


def _makes_whole_turn(step_deg: Floats, whole_deg: float) -> bool:
    """Whether a stretch of one sign, of two steps or more, makes up a whole turn: there and back again."""
    sign = np.sign(step_deg)
    starts, lengths = runs_of_equal(np.diff(sign) != 0.0)
    return bool(((np.abs(np.add.reduceat(step_deg, starts)) > whole_deg) & (lengths >= 2)).any())
