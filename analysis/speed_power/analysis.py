"""Speed and power of a ship from double runs: corrected run by run, current removed, with intervals."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pandas as pd

from acquisition.config.conditions import Conditions
from acquisition.core.arrays import Floats
from acquisition.core.errors import DataShortageError, InputError
from acquisition.core.result import Result
from acquisition.core.serialisation import Number
from acquisition.core.trial import software_version
from analysis.manoeuvres.indices import LeftOut
from analysis.speed_power.corrections import (
    FOUR,
    RAVEN,
    Correction,
    corrections_of,
    ideal_power_kw,
    lackenby_mps,
    raven_kw,
    warnings_of,
    water_resistance_n,
    wave_resistance_n,
    wind_resistance_n,
)
from analysis.speed_power.current import IterativeCurrent, PowerCurve, fit_curve, iterate_current, mean_of_means
from analysis.speed_power.runs import ERROR_FREEDOM, PowerRun, double_runs, power_runs, settings_of

_BAND_POINTS = 25
_PASSES = 3  # the corrections hang on the speed through the water, by a few percent of a few percent


@dataclass(frozen=True, slots=True)
class CorrectedRun:
    """A run, what wind, waves and water added to its resistance [N], the current that it went with [m/s], and its
    point on the curve: speed through deep water [m/s] and power [kW] without what was added."""

    run: PowerRun
    wind_n: float
    waves_n: float
    water_n: float
    current_mps: float
    speed_mps: float
    power_kw: float


@dataclass(frozen=True, slots=True)
class SpeedAtPower:
    """The speed at a power, with its 95 % interval, NaN where that is not known."""

    power_kw: float
    speed_mps: float
    low_mps: Number
    high_mps: Number


@dataclass(frozen=True, slots=True)
class PowerSetting:
    """The runs of one power setting: the speed at their mean power by both methods."""

    runs: int
    mean_of_means: SpeedAtPower
    iterative: SpeedAtPower


@dataclass(frozen=True, slots=True)
class SpeedPower(Result):
    """Speed and power of a ship in still water: ``settings`` by both methods, ``curve`` and ``band`` by the
    iterative one, ``current_terms`` as in :class:`IterativeCurrent` along ``current_towards_deg``.
    """

    view: ClassVar[str] = "analysis.speed_power.report:view"
    drawing: ClassVar[str] = "analysis.speed_power.report:draw"
    size_inch: ClassVar[tuple[float, float]] = (9.0, 5.5)

    runs: tuple[CorrectedRun, ...]
    settings: tuple[PowerSetting, ...]
    curve: PowerCurve
    band: tuple[SpeedAtPower, ...]
    current_terms: tuple[float, ...]
    current_towards_deg: float
    corrections: tuple[Correction, ...]
    warnings: tuple[str, ...]
    left_out: tuple[LeftOut, ...]
    software_version: str

    @property
    def fastest(self) -> SpeedAtPower:
        """The speed at the highest power setting, by the iterative method."""
        return max((each.iterative for each in self.settings), key=lambda each: each.power_kw)

    def speed_at(self, power_kw: float) -> SpeedAtPower:
        """The speed at a power between those of the runs. Raises :class:`InputError` for another."""
        powers = np.array([each.power_kw for each in self.band])
        if not powers[0] <= power_kw <= powers[-1]:
            raise InputError(
                f"{power_kw:g} kW is outside the range of the runs",
                why=f"they span {powers[0]:.4g} to {powers[-1]:.4g} kW",
                fix="ask for a power in this range",
            )  # fmt: skip
        low, high = (np.interp(power_kw, powers, [getattr(each, name) - each.speed_mps for each in self.band])
                     for name in ("low_mps", "high_mps"))  # fmt: skip
        speed = float(self.curve.speed_mps(power_kw))
        return SpeedAtPower(power_kw, speed, speed + float(low), speed + float(high))


@dataclass(frozen=True, slots=True)
class _Trial:
    """What stays as it is while speeds and powers are varied: the runs as arrays, and which corrections apply."""

    given: Conditions
    time_s: Floats
    heading_deg: Floats
    along: Floats
    wind_from_deg: Floats
    wind_mps: Floats
    groups: list[list[int]]
    pairs: Floats
    applied: frozenset[str]


@dataclass(frozen=True, slots=True)
class _Solution:
    added_n: dict[str, Floats]
    found: IterativeCurrent  # in the water as it was
    speed_mps: Floats
    power_kw: Floats
    curve: PowerCurve
    means: Floats  # [settings, 2]: speed by the mean of means, mean power


def speed_power(
    tables: Iterable[pd.DataFrame], conditions: Conditions | None = None, events: Iterable[tuple[int, str]] = ()
) -> SpeedPower:
    """Speed and power from tables of samples, one trial's, after ISO 15016:2015.

    Runs are looked for in each table, or where ``events`` (time [ns since 1970], text) mark them; double runs and
    power settings are made of all of them. ``conditions`` say what the corrections need: what is not known is not
    corrected for, and said. Raises :class:`InputError` where no power was recorded, and :class:`DataShortageError`
    without a double run, and where the power does not grow with the speed.
    """
    marks, every, left_out = list(events), list[PowerRun](), list[LeftOut]()
    for table in tables:
        found, others = power_runs(table, marks)
        every, left_out = [*every, *found], [*left_out, *others]
    runs, alone = double_runs(every)
    return _analyse(runs, conditions or Conditions(), sorted([*left_out, *alone], key=lambda each: each.start))


def _analyse(runs: Sequence[PowerRun], given: Conditions, left_out: Sequence[LeftOut]) -> SpeedPower:
    if not runs:
        why = "; ".join(sorted({each.why for each in left_out})) or "no steady straight stretch of half a minute"
        raise DataShortageError(
            "no double run was found", why=why, fix="record runs at one power on reciprocal courses"
        )
    over_ground, power = (np.array([getattr(each, name) for each in runs]) for name in ("speed_mps", "power_kw"))
    corrections = corrections_of(given, runs)
    trial = _trial_of(given, runs, frozenset(each.name for each in corrections if each.applied))
    best = _solve(trial, over_ground, power)
    band_kw = np.linspace(best.power_kw.min(), best.power_kw.max(), _BAND_POINTS)

    def speeds(solution: _Solution) -> Floats:
        at_settings = solution.curve.speed_mps(best.means[:, 1])
        means = solution.means[:, 0] + (best.means[:, 1] - solution.means[:, 1]) / best.curve.slope(
            best.means[:, 0]
        )
        return np.concatenate([solution.curve.speed_mps(band_kw), at_settings, means])

    values, within = speeds(best), _half_intervals(trial, runs, best, speeds)
    within[-len(trial.groups) :][[len(group) < FOUR for group in trial.groups]] = np.nan
    at = [SpeedAtPower(float(kw), float(v), float(v - w), float(v + w)) for kw, v, w in zip(
        np.concatenate([band_kw, best.means[:, 1], best.means[:, 1]]), values, within, strict=True)]  # fmt: skip
    band, by_curve, by_means = at[:_BAND_POINTS], at[_BAND_POINTS : -len(trial.groups)], at[-len(trial.groups) :]
    settings = tuple(PowerSetting(len(group), *pair) for group, *pair in zip(
        trial.groups, by_means, by_curve, strict=True))  # fmt: skip
    terms = best.found.terms
    rows = zip(runs, *best.added_n.values(), best.found.current_mps, best.speed_mps, best.power_kw, strict=True)
    corrected = tuple(CorrectedRun(run, *map(float, numbers)) for run, *numbers in rows)
    return SpeedPower(
        corrected, settings, best.curve, tuple(band), terms, runs[0].heading_deg, corrections,
        warnings_of(given, runs, trial.applied, trial.groups, len(terms)), tuple(left_out), software_version(),
    )  # fmt: skip


def _trial_of(given: Conditions, runs: Sequence[PowerRun], applied: frozenset[str]) -> _Trial:
    """The runs as arrays; the wind is the mean vector of each double run, as the ship disturbs it on both courses
    differently."""
    heading = np.array([each.heading_deg for each in runs])
    middle = np.array([(each.start + (each.end - each.start) / 2).timestamp() for each in runs])
    pairs = np.array([each.double_run for each in runs])
    wind = np.array([each.wind_mps * np.exp(1j * np.deg2rad(each.wind_from_deg)) for each in runs])
    wind = np.array([wind[pairs == pair].mean() for pair in pairs])
    return _Trial(
        given, middle - middle[0], heading, np.cos(np.deg2rad(heading - heading[0])),
        np.rad2deg(np.angle(wind)) % 360.0, np.abs(wind), settings_of(runs), pairs, applied,
    )  # fmt: skip


def _solve(trial: _Trial, over_ground: Floats, power: Floats) -> _Solution:
    """The speeds, the current and the curve of measured speeds and powers."""
    given, settings = trial.given, len(trial.groups)
    through = np.array([over_ground[trial.pairs == pair].mean() for pair in trial.pairs])
    for _ in range(_PASSES):
        added = _added_n(trial, over_ground, through, power)
        total = np.sum(list(added.values()), axis=0)
        ideal = ideal_power_kw(given, power, total, through) if trial.applied & added.keys() else power
        found = iterate_current(trial.time_s, trial.along, over_ground, ideal, through, settings)
        through = found.speed_mps
    means = np.array([_means(trial, group, over_ground, ideal) for group in trial.groups])
    speed, final = _in_deep_water(trial, through, ideal)
    means = np.column_stack(_in_deep_water(trial, means[:, 0], means[:, 1]))
    curve = found.curve
    if trial.applied & {"shallow water", "displacement"}:
        curve = fit_curve(speed, final, settings)
    return _Solution(added, found, speed, final, curve, means)


def _added_n(trial: _Trial, over_ground: Floats, through: Floats, power: Floats) -> dict[str, Floats]:
    """What wind, waves and water add to the resistance of each run."""
    given, nothing = trial.given, np.zeros_like(through)
    return {
        "wind": wind_resistance_n(given, trial.heading_deg, over_ground, trial.wind_from_deg, trial.wind_mps)
        if "wind" in trial.applied else nothing,
        "waves": wave_resistance_n(given, trial.heading_deg) if "waves" in trial.applied else nothing,
        "water": water_resistance_n(given, through, power) if "water" in trial.applied else nothing,
    }  # fmt: skip


def _means(trial: _Trial, group: list[int], over_ground: Floats, power: Floats) -> tuple[float, float]:
    """Speed and power of a setting by the mean of means, both with the same weights."""
    along = trial.along[group]
    alternating = bool(np.all(along[1:] * along[:-1] < 0.0))
    return mean_of_means(over_ground[group], alternating), mean_of_means(power[group], alternating)


def _in_deep_water(trial: _Trial, speed: Floats, power: Floats) -> tuple[Floats, Floats]:
    """Speed and power without the shallow water, at the displacement that is stated."""
    given = trial.given
    if "shallow water" in trial.applied:
        if given.lacks(*RAVEN):
            speed = speed + lackenby_mps(given, speed)
        else:
            power = raven_kw(given, speed, power)
    if "displacement" in trial.applied:
        ratio = given.number("stated_displacement_m3") / given.number("displacement_m3")
        power = power * ratio ** (2.0 / 3.0)  # the admiralty coefficient, at one speed
    return speed, power


def _half_intervals(
    trial: _Trial, runs: Sequence[PowerRun], best: _Solution, speeds: Callable[[_Solution], Floats]
) -> Floats:
    """Halves of the 95 % intervals of the ``speeds`` of a solution.

    Every measured speed and power is moved by its standard error in turn, and the squares of the changes add up
    (JCGM 100, 5.1.3), with Student's factor for their effective degrees of freedom (G.4). Where the runs lie
    farther off the curve than these errors explain, all grow with that (Birge 1932).
    """
    from scipy.special import stdtrit

    measured = np.array([[each.speed_mps, each.power_kw] for each in runs])
    errors = np.array([[each.speed_se_mps, each.power_se_kw] for each in runs])
    changes, values = [], speeds(best)
    for place in np.ndindex(measured.shape):
        moved = measured.copy()
        moved[place] += errors[place]
        changes.append(speeds(_solve(trial, *moved.T)) - values)
    squares = np.square(changes)
    square = squares.sum(axis=0)
    freedom = ERROR_FREEDOM * square**2 / np.maximum((squares**2).sum(axis=0), 1e-300)
    expected = np.hypot(errors[:, 0], errors[:, 1] / best.curve.slope(best.found.speed_mps))
    known = best.found.free > 0 and bool(expected.all())
    scatter = float(np.sum((best.found.misfit_mps / expected) ** 2)) / best.found.free if known else 1.0
    return np.asarray(stdtrit(freedom, 0.975) * np.sqrt(square * max(1.0, scatter)))
