"""Speed and power of a ship from double runs: corrected run by run, current removed, with intervals."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import pandas as pd

from seatrial.acquisition.config.conditions import Conditions
from seatrial.acquisition.core.errors import DataShortageError, InputError
from seatrial.acquisition.core.quantities import Floats
from seatrial.acquisition.core.result import Number, Result
from seatrial.acquisition.core.trial import software_version
from seatrial.analysis.manoeuvres.indices import LeftOut
from seatrial.analysis.speed_power.corrections import Correction, corrections_of, warnings_of
from seatrial.analysis.speed_power.current import PowerCurve
from seatrial.analysis.speed_power.runs import PowerRun, double_runs, power_runs
from seatrial.analysis.speed_power.solution import SpeedPowerSolution, SpeedTrial, solve, trial_of
from seatrial.analysis.speed_power.uncertainty import Intervals, intervals_of, why_unbounded

_BAND_POINTS = 25


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
class Uncertainty:
    """One source of uncertainty of the speed at the highest power setting: half of its 95 % interval alone."""

    name: str
    half_mps: float


@dataclass(frozen=True, slots=True)
class SpeedPower(Result):
    """Speed and power of a ship in still water: ``settings`` by both methods, ``curve`` and ``band`` by the
    iterative one, ``current_terms`` as in :class:`IterativeCurrent` along ``current_towards_deg``, the
    ``uncertainties`` that its interval is made of, ``no_interval`` why there is none.
    """

    view: ClassVar[str] = "seatrial.analysis.speed_power.report:view"
    drawing: ClassVar[str] = "seatrial.analysis.speed_power.report:draw"
    size_inch: ClassVar[tuple[float, float]] = (9.0, 5.5)

    runs: tuple[CorrectedRun, ...]
    settings: tuple[PowerSetting, ...]
    curve: PowerCurve
    band: tuple[SpeedAtPower, ...]
    current_terms: tuple[float, ...]
    current_towards_deg: float
    corrections: tuple[Correction, ...]
    uncertainties: tuple[Uncertainty, ...]
    no_interval: str
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
                f"{power_kw:,.0f} kW is outside the range of the runs",
                why=f"they span {powers[0]:,.0f} to {powers[-1]:,.0f} kW",
                fix="ask for a power in this range",
            )  # fmt: skip
        low, high = (np.interp(power_kw, powers, [getattr(each, name) - each.speed_mps for each in self.band])
                     for name in ("low_mps", "high_mps"))  # fmt: skip
        speed = float(self.curve.speed_mps(power_kw))
        return SpeedAtPower(power_kw, speed, speed + float(low), speed + float(high))


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
    return speed_power_of_runs(every, conditions, left_out)


def speed_power_of_runs(
    runs: Iterable[PowerRun], conditions: Conditions | None = None, left_out: Iterable[LeftOut] = ()
) -> SpeedPower:
    """Speed and power from the runs of one trial, after ISO 15016:2015.

    Parameters
    ----------
    runs
        Runs of :func:`power_runs`, or of a table of run averages (:func:`.run_table.read_run_table`).
    conditions
        The ship, the sea and the air, for the corrections.
    left_out
        What was no run, to stand in the result.

    Raises
    ------
    DataShortageError
        Without a double run, and where the power does not grow with the speed.
    """
    pairs, alone = double_runs(runs)
    excluded = sorted([*left_out, *alone], key=lambda each: each.start)
    if not pairs:
        why = "; ".join(sorted({each.why for each in excluded})) or "no steady straight stretch of half a minute"
        raise DataShortageError(
            "no double run was found", why=why, fix="record runs at one power on reciprocal courses"
        )
    return _analyse(pairs, conditions or Conditions(), tuple(excluded))


def _analyse(runs: Sequence[PowerRun], given: Conditions, left_out: tuple[LeftOut, ...]) -> SpeedPower:
    over_ground, power = (np.array([getattr(run, name) for run in runs]) for name in ("speed_mps", "power_kw"))
    corrections = corrections_of(given, runs)
    trial = trial_of(given, runs, corrections)
    best = solve(trial, over_ground, power)
    band_kw = np.linspace(best.power_kw.min(), best.power_kw.max(), _BAND_POINTS)

    def speeds(solution: SpeedPowerSolution) -> Floats:
        at_settings = solution.curve.speed_mps(best.means[:, 1])
        means = solution.means[:, 0] + (best.means[:, 1] - solution.means[:, 1]) / best.curve.slope(
            best.means[:, 0]
        )
        return np.concatenate([solution.curve.speed_mps(band_kw), at_settings, means])

    no_interval, within = why_unbounded(trial), None
    if not no_interval:
        try:
            within = intervals_of(trial, runs, best, over_ground, power, speeds)
        except DataShortageError:
            no_interval = "runs that differ by less than their errors would have no solution"
    values = speeds(best)
    powers = np.concatenate([band_kw, best.means[:, 1], best.means[:, 1]])
    at = _speeds_at(powers, values, within)
    count = len(trial.groups)
    band, by_curve, by_means = at[:_BAND_POINTS], at[_BAND_POINTS:-count], at[-count:]
    settings = tuple(PowerSetting(len(group), *pair) for group, *pair in zip(
        trial.groups, by_means, by_curve, strict=True))  # fmt: skip
    rows = zip(runs, *best.added_n.values(), best.current.current_mps, best.speed_mps, best.power_kw, strict=True)
    corrected = tuple(CorrectedRun(run, *map(float, numbers)) for run, *numbers in rows)
    return SpeedPower(
        corrected, settings, best.curve, tuple(band), best.current.terms, runs[0].heading_deg,
        _sizes(trial, over_ground, power, best, corrections),
        _uncertainties(within, _BAND_POINTS + int(np.argmax(best.means[:, 1]))), no_interval,
        warnings_of(given, runs, trial.groups, len(best.current.terms)), left_out, software_version(),
    )  # fmt: skip


def _speeds_at(powers: Floats, values: Floats, within: Intervals | None) -> list[SpeedAtPower]:
    """Speeds at powers with their intervals, which hold the speed itself wherever their middle lies."""
    low = high = np.full_like(values, np.nan)
    if within is not None:
        middle = values + within.shift_mps
        low, high = np.minimum(values, middle - within.half_mps), np.maximum(values, middle + within.half_mps)
    return [SpeedAtPower(*map(float, row)) for row in zip(powers, values, low, high, strict=True)]


def _uncertainties(within: Intervals | None, place: int) -> tuple[Uncertainty, ...]:
    sources = within.sources if within is not None else ()
    halves = [(source.name, 1.96 * float(source.standard_mps[place])) for source in sources]
    return tuple(Uncertainty(*each) for each in sorted(halves, key=lambda each: -each[1]))


def _sizes(
    trial: SpeedTrial, speed: Floats, power: Floats, best: SpeedPowerSolution, corrections: Iterable[Correction]
) -> tuple[Correction, ...]:
    """The corrections with their sizes: the result with all of them less that without each."""
    highest_kw = float(best.means[:, 1].max())
    fastest = best.curve.speed_mps(highest_kw)
    sized = []
    for correction in corrections:
        if correction.applied:
            curve = solve(trial.without(correction.name), speed, power).curve
            correction = replace(
                correction, power_kw=float(highest_kw - curve.power_kw(fastest)),
                speed_mps=float(fastest - curve.speed_mps(highest_kw)),
            )  # fmt: skip
        sized.append(correction)
    return tuple(sized)
