"""Speed and power of a ship from double runs: corrected run by run, current removed, with intervals.

What differs from run to run is estimated from the runs themselves. The current along the course is a constant, a
tide of 12.4 h with its half and its double period, and an irregular part; how likely each strength of tide and
irregular part is, follows from the speeds of the runs (restricted maximum likelihood over a grid, every power
setting with a speed of its own). Of each such current the variance of the result follows from how the result
changes with the speed of each run (JCGM 100, 5.1.3), and the interval holds 95 % of the mixture.

Errors common to all runs do not show in them: of the power measurement, of the anemometer, of coefficients and
formulas. They are propagated from the standard uncertainties below. Wind and waves that were not corrected for move
the middle of the interval by what they may have taken, where the ship's size is known.

The speeds through the water, the current and the power curve follow from speeds over ground and powers by the mean
of means and by the iterative method, as ISO 15016:2015 and ITTC 7.5-04-01-01.1 have both. The mean of means takes
runs at one power, to and fro, evenly spaced in time: weights 1, 3, 3, 1 of four runs remove a current that changes
as a parabola, 1 and 1 of two only one that does not change. The iterative method takes all powers together: the
current is V_C(t) = V_CC cos(2 pi t / T_C) + V_CS sin(2 pi t / T_C) + V_CT t + V_C0 along the course, the power P(V)
= a + b V^q.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from math import comb
from typing import ClassVar

import numpy as np
import pandas as pd
from scipy.special import ndtr

from seatrial.acquisition.config.run_sheet import Conditions
from seatrial.acquisition.core.errors import DataShortageError, InputError
from seatrial.acquisition.core.quantities import GRAVITY_MPS2, Floats
from seatrial.acquisition.core.result import Number, Result
from seatrial.acquisition.core.trial import software_version
from seatrial.analysis.manoeuvres import indices, straight_runs
from seatrial.analysis.speed_power import formulas
from seatrial.analysis.speed_power.runs import PowerRun, double_runs, power_runs

_PASSES = 3  # the corrections depend on the speed through the water, by a few percent of a few percent
TIDE_S = 0.51753 * 86_400.0
"""T_C: 12 h 25 min 14.6 s, the standard's 0.51753 day of half a lunar day."""
_SLOWEST_Q, _FASTEST_Q = 1.0, 9.0
_ITERATIONS, _CLOSE_MPS = 400, 1e-7


@dataclass(frozen=True, slots=True)
class SpeedTrial:
    """What stays as it is while speeds and powers are varied: the runs as arrays [runs], the places of the runs of
    each power setting in ``groups``, and the corrections that apply, by name with their method."""

    conditions: Conditions
    time_s: Floats
    heading_deg: Floats
    along: Floats
    wind_from_deg: Floats
    wind_mps: Floats
    sea: formulas.RunSeas
    groups: list[list[int]]
    pairs: Floats
    methods: Mapping[str, str]

    def without_correction(self, name: str) -> SpeedTrial:
        """This trial without one of the corrections."""
        return replace(
            self, methods={correction: method for correction, method in self.methods.items() if correction != name}
        )

    def with_correction(self, name: str, method: str = "") -> SpeedTrial:
        """This trial with one more correction."""
        return replace(self, methods={**self.methods, name: method})


@dataclass(frozen=True, slots=True)
class SpeedPowerSolution:
    """The solution of a trial.

    ``added_n`` is what was added to the resistance of each run [N], ``current`` the result of the iterative method
    in the water as it was, ``speed_mps`` and ``power_kw`` those of each run without what was added, ``curve`` that
    through them, and ``means`` of each setting the speed by the mean of means and the mean power [settings, 2].
    """

    added_n: dict[str, Floats]
    current: IterativeCurrent
    speed_mps: Floats
    power_kw: Floats
    curve: PowerCurve
    means: Floats


def trial_of(
    conditions: Conditions, runs: Sequence[PowerRun], corrections: Sequence[formulas.Correction]
) -> SpeedTrial:
    """The runs as arrays; the wind is the mean vector of each double run, as the ship disturbs it on both courses
    differently."""
    heading = np.array([run.heading_deg for run in runs])
    middle = np.array([(run.start + (run.end - run.start) / 2).timestamp() for run in runs])
    pairs = np.array([run.double_run for run in runs])
    wind = np.array([run.wind_mps * np.exp(1j * np.deg2rad(run.wind_from_deg)) for run in runs])
    wind = np.array([wind[pairs == pair].mean() for pair in pairs])
    groups: list[list[int]] = []  # in order of the setting
    for place in sorted(range(len(runs)), key=lambda number: runs[number].setting):
        near = groups and straight_runs.is_same_setting(runs[groups[-1][0]].setting, runs[place].setting)
        groups[-1:] = [[*groups[-1], place]] if near else [*groups[-1:], [place]]
    return SpeedTrial(
        conditions, middle - middle[0], heading, np.cos(np.deg2rad(heading - heading[0])),
        np.rad2deg(np.angle(wind)) % 360.0, np.abs(wind), formulas.sea_of(conditions, runs),
        [sorted(group) for group in groups], pairs,
        {correction.name: correction.method for correction in corrections if correction.applied},
    )  # fmt: skip


def solve(trial: SpeedTrial, over_ground: Floats, power: Floats) -> SpeedPowerSolution:
    """The speeds, the current and the curve of measured speeds and powers."""
    conditions, methods, heading, settings = trial.conditions, trial.methods, trial.heading_deg, len(trial.groups)
    through = np.array([over_ground[trial.pairs == pair].mean() for pair in trial.pairs])
    for _ in range(_PASSES):
        added = {name: np.zeros_like(through) for name in ("wind", "waves", "water")}
        if "wind" in methods:
            added["wind"] = formulas.wind_resistance_n(
                conditions, heading, over_ground, trial.wind_from_deg, trial.wind_mps
            )
        if "waves" in methods:
            added["waves"] = formulas.wave_resistance_n(conditions, heading, through, trial.sea, methods["waves"])
        if "water" in methods:
            added["water"] = formulas.water_resistance_n(conditions, through, power)
        total = np.sum(list(added.values()), axis=0)
        ideal = (
            formulas.ideal_power_kw(conditions, power, total, through) if methods.keys() & added.keys() else power
        )
        current = iterate_current(trial.time_s, trial.along, over_ground, ideal, through, settings)
        through = current.speed_mps
    pairs = []  # of each setting speed and power by the mean of means, both with the same weights
    for group in trial.groups:
        along = trial.along[group]
        alternating = bool(np.all(along[1:] * along[:-1] < 0.0))
        pairs.append([mean_of_means(values[group], alternating) for values in (over_ground, ideal)])
    means = np.array(pairs)
    depth = np.array([trial.sea.water_depth_m[group].mean() for group in trial.groups])
    speed, final = _correct_depth_and_displacement(trial, through, ideal, trial.sea.water_depth_m)
    means = np.column_stack(_correct_depth_and_displacement(trial, means[:, 0], means[:, 1], depth))
    curve = current.curve
    if methods.keys() & {"shallow water", "displacement"}:
        curve = fit_curve(speed, final, settings)
    return SpeedPowerSolution(added, current, speed, final, curve, means)


def _correct_depth_and_displacement(
    trial: SpeedTrial, speed: Floats, power: Floats, depth: Floats
) -> tuple[Floats, Floats]:
    """Speed and power without the shallow water, at the displacement that is stated."""
    conditions = trial.conditions
    if "shallow water" in trial.methods:
        if conditions.unknown_names(*formulas.RAVEN):
            speed = speed + formulas.lackenby_mps(conditions, speed, depth)
        else:
            power = formulas.raven_kw(conditions, speed, power, depth)
    if "displacement" in trial.methods:
        ratio = conditions.number("stated_displacement_m3") / conditions.number("displacement_m3")
        power = power * ratio ** (2.0 / 3.0)  # the admiralty coefficient, at one speed
    return speed, power


@dataclass(frozen=True, slots=True)
class PowerCurve:
    """P(V) = a + b V^q, P in kW and V in m/s."""

    a: float
    b: float
    q: float

    def power_kw(self, speed_mps: Floats) -> Floats:
        """The power at speeds."""
        return np.asarray(self.a + self.b * speed_mps**self.q)

    def slope(self, speed_mps: Floats) -> Floats:
        """dP/dV [kW s/m] at speeds."""
        return np.asarray(self.q * self.b * speed_mps ** (self.q - 1.0))

    def speed_mps(self, power_kw: Floats | float) -> Floats:
        """The speed at powers; NaN below the curve's foot."""
        share = (np.asarray(power_kw, dtype=float) - self.a) / self.b
        return np.asarray(np.where(share > 0.0, np.abs(share) ** (1.0 / self.q), np.nan))


def fit_curve(speed_mps: Floats, power_kw: Floats, settings: int) -> PowerCurve:
    """The curve through runs, by least squares of power; a is 0 with two settings, and q is 3 with one.

    For every q the best a and b are those of a line, so that q alone is searched for.
    """
    from scipy.optimize import minimize_scalar

    if settings < 2:
        return _fit_with_exponent(speed_mps, power_kw, 3.0, through_zero=True)

    def misfit(q: float) -> float:
        curve = _fit_with_exponent(speed_mps, power_kw, q, through_zero=settings < 3)
        return float(np.sum((curve.power_kw(speed_mps) - power_kw) ** 2))

    best = minimize_scalar(misfit, bounds=(_SLOWEST_Q, _FASTEST_Q), method="bounded", options={"xatol": 1e-7})
    return _fit_with_exponent(speed_mps, power_kw, float(best.x), through_zero=settings < 3)


def _fit_with_exponent(speed_mps: Floats, power_kw: Floats, q: float, *, through_zero: bool) -> PowerCurve:
    scale = float(speed_mps.mean())
    powered = (speed_mps / scale) ** q
    design = np.column_stack([powered] if through_zero else [powered, np.ones_like(powered)])
    coefficients = np.linalg.lstsq(design, power_kw, rcond=None)[0]
    return PowerCurve(0.0 if through_zero else float(coefficients[1]), float(coefficients[0]) / scale**q, q)


def mean_of_means(values: Floats, alternating: bool = True) -> float:
    """The repeated mean of neighbours of runs in order of time: weights 1, 3, 3, 1 of four, 1, 2, 1 of three.

    Runs that do not go to and fro in turn have their plain mean: other weights would not balance their courses.

    >>> mean_of_means(np.array([10.0, 12.0, 10.0, 12.0]))
    11.0
    """
    weights = [comb(values.size - 1, k) for k in range(values.size)] if alternating else np.ones(values.size)
    return float(np.average(values, weights=weights))


@dataclass(frozen=True, slots=True)
class IterativeCurrent:
    """The result of the iterative method: the curve, the speed through the water of each run, and the current.

    ``terms`` are V_C0, V_CT, V_CS and V_CC [m/s, m/s a day, m/s, m/s], as many as the runs allow, positive along
    the course of the first run; ``current_mps`` is what each run went with. ``misfit_mps`` are the runs' distances
    in speed from the curve, ``free`` how many more runs there are than unknowns.
    """

    curve: PowerCurve
    speed_mps: Floats
    terms: tuple[float, ...]
    current_mps: Floats
    misfit_mps: Floats
    free: int


def iterate_current(
    time_s: Floats, along: Floats, over_ground_mps: Floats, power_kw: Floats, start_mps: Floats, settings: int
) -> IterativeCurrent:
    """The curve and the current that agree with all runs, estimated in turn until the speeds converge.

    The terms of the current are a constant, an even change a day, sine and cosine of the tide: as many as can be
    estimated with the curve and one run in excess.
    ``time_s`` are the middles of the runs, ``along`` 1 or -1 for runs with or against the course that the current
    is counted along, ``start_mps`` first speeds through the water: the mean of each double run. Raises
    :class:`DataShortageError` where more power goes with less speed.
    """
    phase = 2.0 * np.pi * time_s / TIDE_S
    columns = [np.ones_like(phase), time_s / 86_400.0, np.sin(phase), np.cos(phase)]
    term_count = max(1, min(len(columns), time_s.size - min(settings, 3) - 1))
    design = np.column_stack(columns)[:, :term_count] * along[:, np.newaxis]
    speed, share, last_change = start_mps, 1.0, np.inf
    for _ in range(_ITERATIONS):
        curve = fit_curve(speed, power_kw, settings) if speed.min() > 0.0 else None
        if curve is None or not curve.b > 0.0:
            raise DataShortageError(
                "the power of the runs does not grow with their speed", why="no curve and no current explain them",
                fix="check the speeds and powers of the runs, and whether the channel is the shaft power",
            )  # fmt: skip
        # The speed at which the curve has the run's power, by the slope where the run is: it need not reach it.
        by_power = speed + (power_kw - curve.power_kw(speed)) / curve.slope(speed)
        terms = np.linalg.lstsq(design, over_ground_mps - by_power, rcond=None)[0]
        step = over_ground_mps - design @ terms - speed
        change = float(np.max(np.abs(step)))
        if change > last_change:  # with few runs whole steps may swing about the solution, or away from it
            share = 0.5 * share
        speed, last_change = speed + share * step, change
        if change < _CLOSE_MPS:
            break
    curve = fit_curve(speed, power_kw, settings)
    misfit = (power_kw - curve.power_kw(speed)) / curve.slope(speed)
    free = time_s.size - design.shape[1] - min(settings, 3)
    return IterativeCurrent(curve, speed, tuple(map(float, terms)), design @ terms, misfit, free)


_BAND_POINTS = 25
Outputs = Callable[[SpeedPowerSolution], Floats]
"""The speeds [m/s] that are wanted of a solution."""
# What a current and a sea are like in general, set before and checked with the programmes 0 to 399 of
# tests/benchmarks/speed_trials.py: of the errors, 95 % are to be within the intervals.
_TIDES_MPS = (0.02, 0.05, 0.12, 0.25, 0.5, 1.0)
_IRREGULAR_MPS = (0.005, 0.01, 0.02, 0.04, 0.08, 0.16)
_CORRELATED_S = (1800.0, 7200.0)
_USUAL_IRREGULAR_MPS = 0.02  # its logarithm is taken to be normal with a deviation of one
_CONSTANT_MPS = 0.2
_HALF_PERIOD, _DOUBLE_PERIOD = 0.1, 0.2  # of the tide's amplitude: overtides in shallow water, daily tides
_STEP_MPS, _STEP_POWER = 0.005, 0.002
_HALVINGS = 40
_WIND_SPEED, _WIND_DEG = 0.08, 5.0  # of the true wind: the ship disturbs the flow at the anemometer
_OWN_WIND_CURVE, _TYPICAL_WIND_CURVE = 0.10, 0.20
_EFFICIENCY, _LOAD_VARIATION = 0.03, -0.1
_WAVES = 0.4  # of the resistance: 15 % of a height that was observed, 30 % of the formula
_NO_WAVES_DEG = 100.0  # off the bow, from where waves add nothing; between the bow's sector and there they fade
_SHALLOW, _DISPLACEMENT, _WATER = 0.3, 0.1, 0.1  # of the correction
_VISCOUS_SHARE = 0.8  # of the resistance
_USUAL_EFFICIENCY, _USUAL_FRONTAL, _USUAL_SLENDERNESS, _USUAL_BEAM = 0.65, 0.7, 6.5, 2.6
_UNKNOWN_DEPTH = 0.5  # of the correction
_UNKNOWN_WIND = 0.6  # of its effect, with the usual values of what is not known
_FULLY_DEVELOPED = 0.21  # H g / U^2 of waves that the wind has raised for long (Pierson and Moskowitz 1964)


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


@dataclass(frozen=True, slots=True, repr=False)
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
    corrections: tuple[formulas.Correction, ...]
    uncertainties: tuple[Uncertainty, ...]
    no_interval: str
    warnings: tuple[str, ...]
    left_out: tuple[indices.LeftOut, ...]
    software_version: str

    @property
    def fastest(self) -> SpeedAtPower:
        """The speed at the highest power setting, by the iterative method."""
        return max((setting.iterative for setting in self.settings), key=lambda speed: speed.power_kw)

    def to_frame(self) -> pd.DataFrame:
        """The curve: a power [kW], its speed and the ends of the 95 % interval [m/s] in a row."""
        return pd.DataFrame(self.band)

    def speed_at(self, power_kw: float) -> SpeedAtPower:
        """The speed at a power between those of the runs. Raises :class:`InputError` for another."""
        powers = np.array([point.power_kw for point in self.band])
        if not powers[0] <= power_kw <= powers[-1]:
            raise InputError(
                f"{power_kw:,.0f} kW is outside the range of the runs",
                why=f"they span {powers[0]:,.0f} to {powers[-1]:,.0f} kW",
                fix="ask for a power in this range",
            )  # fmt: skip
        low, high = (np.interp(power_kw, powers, [getattr(point, name) - point.speed_mps for point in self.band])
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
    marks, runs, left_out = list(events), list[PowerRun](), list[indices.LeftOut]()
    for table in tables:
        table_runs, rejected = power_runs(table, marks)
        runs, left_out = [*runs, *table_runs], [*left_out, *rejected]
    return speed_power_of_runs(runs, conditions, left_out)


def speed_power_of_runs(
    runs: Iterable[PowerRun], conditions: Conditions | None = None, left_out: Iterable[indices.LeftOut] = ()
) -> SpeedPower:
    """Speed and power from the runs of one trial, after ISO 15016:2015.

    Parameters
    ----------
    runs
        Runs of :func:`power_runs`, or of a table of run averages (:func:`.run_table.read_run_table`).
    conditions
        The ship, the sea and the air, for the corrections.
    left_out
        The rejected candidates, for the result.

    Raises
    ------
    DataShortageError
        Without a double run, and where the power does not grow with the speed.
    """
    pairs, unpaired = double_runs(runs)
    excluded = sorted([*left_out, *unpaired], key=lambda candidate: candidate.start)
    if not pairs:
        why = (
            "; ".join(sorted({candidate.why for candidate in excluded}))
            or "no steady straight stretch of half a minute"
        )
        raise DataShortageError(
            "no double run was found", why=why, fix="record runs at one power on reciprocal courses"
        )
    return _analyse(pairs, conditions or Conditions(), tuple(excluded))


def _analyse(runs: Sequence[PowerRun], conditions: Conditions, left_out: tuple[indices.LeftOut, ...]) -> SpeedPower:
    over_ground, power = (np.array([getattr(run, name) for run in runs]) for name in ("speed_mps", "power_kw"))
    corrections = formulas.corrections_of(conditions, runs)
    trial = trial_of(conditions, runs, corrections)
    best = solve(trial, over_ground, power)
    band_kw = np.linspace(best.power_kw.min(), best.power_kw.max(), _BAND_POINTS)

    def speeds(solution: SpeedPowerSolution) -> Floats:
        at_settings = solution.curve.speed_mps(best.means[:, 1])
        slope = best.curve.slope(best.means[:, 0])
        means = solution.means[:, 0] + (best.means[:, 1] - solution.means[:, 1]) / slope
        return np.concatenate([solution.curve.speed_mps(band_kw), at_settings, means])

    no_interval = ""  # why there is none: what wind or waves took is neither corrected for nor bounded
    is_bounded = {"wind", "waves"} <= trial.methods.keys() or conditions.beam_m or conditions.length_m
    if not np.isfinite(trial.wind_mps).all():
        no_interval = "the wind during the runs is not known"
    elif not is_bounded:
        unbounded = "without length_m or beam_m nothing bounds what they took"
        no_interval = f"wind or waves are not corrected for, and {unbounded}"
    values = speeds(best)
    low = high = np.full_like(values, np.nan)
    sources = dict[str, Floats]()
    if not no_interval:
        try:
            shift, half, sources = intervals_of(trial, runs, best, over_ground, power, speeds)
        except DataShortageError:
            no_interval = "runs that differ by less than their errors would have no solution"
        else:  # they hold the speed itself wherever their middle lies
            low, high = np.minimum(values, values + shift - half), np.maximum(values, values + shift + half)
    powers = np.concatenate([band_kw, best.means[:, 1], best.means[:, 1]])
    place = _BAND_POINTS + int(np.argmax(best.means[:, 1]))
    halves = [(name, 1.96 * float(standard[place])) for name, standard in sources.items()]
    points = [SpeedAtPower(*map(float, row)) for row in zip(powers, values, low, high, strict=True)]
    count = len(trial.groups)
    band, by_curve, by_means = points[:_BAND_POINTS], points[_BAND_POINTS:-count], points[-count:]
    settings = tuple(PowerSetting(len(group), *pair) for group, *pair in zip(
        trial.groups, by_means, by_curve, strict=True))  # fmt: skip
    rows = zip(runs, *best.added_n.values(), best.current.current_mps, best.speed_mps, best.power_kw, strict=True)
    corrected = tuple(CorrectedRun(run, *map(float, numbers)) for run, *numbers in rows)
    return SpeedPower(
        corrected, settings, best.curve, tuple(band), best.current.terms, runs[0].heading_deg,
        _add_sizes(trial, over_ground, power, best, corrections),
        tuple(Uncertainty(*source) for source in sorted(halves, key=lambda source: -source[1])), no_interval,
        formulas.warnings_of(conditions, runs, trial.groups, len(best.current.terms)), left_out, software_version(),
    )  # fmt: skip


def _add_sizes(
    trial: SpeedTrial,
    speed: Floats,
    power: Floats,
    best: SpeedPowerSolution,
    corrections: Iterable[formulas.Correction],
) -> tuple[formulas.Correction, ...]:
    """The corrections with their sizes: the result with all of them less that without each."""
    highest_kw = float(best.means[:, 1].max())
    fastest = best.curve.speed_mps(highest_kw)
    sized = []
    for correction in corrections:
        if correction.applied:
            curve = solve(trial.without_correction(correction.name), speed, power).curve
            correction = replace(
                correction, power_kw=float(highest_kw - curve.power_kw(fastest)),
                speed_mps=float(fastest - curve.speed_mps(highest_kw)),
            )  # fmt: skip
        sized.append(correction)
    return tuple(sized)


def intervals_of(
    trial: SpeedTrial,
    runs: Sequence[PowerRun],
    best: SpeedPowerSolution,
    speed: Floats,
    power: Floats,
    outputs: Outputs,
) -> tuple[Floats, Floats, dict[str, Floats]]:
    """The 95 % intervals of the ``outputs`` of a solution, of measured speeds over ground [m/s] and powers [kW].

    They are the middle of each less the output, half its width, and by source its standard uncertainties [m/s].
    """
    values = outputs(best)
    speed_columns, power_columns = [], []  # how the outputs change with the speed and the power of each run
    for run in range(speed.size):
        step = np.zeros_like(speed)
        step[run] = 1.0
        speed_columns.append((outputs(solve(trial, speed + _STEP_MPS * step, power)) - values) / _STEP_MPS)
        change = _STEP_POWER * power[run]
        power_columns.append((outputs(solve(trial, speed, power + change * step)) - values) / change)
    by_speed, by_power = np.array(speed_columns).T, np.array(power_columns).T
    weights, variances = _random_uncertainty(trial, runs, best, speed, by_speed, by_power)

    sources = {"current and scatter of the runs": np.sqrt(weights @ variances)}
    shift, systematic = np.zeros_like(values), np.zeros_like(values)
    changes = list(_changes(trial))
    for name in dict.fromkeys(change.name for change in changes):
        source_shift, variance = np.zeros_like(values), np.zeros_like(values)
        for change in (candidate for candidate in changes if candidate.name == name):
            moved = outputs(solve(change.trial, speed, power * change.power_factor)) - values
            source_shift, variance = source_shift + change.shift * moved, variance + (change.spread * moved) ** 2
        sources[name] = np.sqrt(variance)
        shift, systematic = shift + source_shift, systematic + sources[name] ** 2
    return shift, _mixture_half(weights, variances + systematic), sources


def _random_uncertainty(
    trial: SpeedTrial,
    runs: Sequence[PowerRun],
    best: SpeedPowerSolution,
    speed: Floats,
    by_speed: Floats,
    by_power: Floats,
) -> tuple[Floats, Floats]:
    """How likely each current of the grid is, and the variances of the outputs with it [currents, outputs]."""
    errors = np.array([[run.speed_se_mps, run.power_se_kw] for run in runs])
    speed_se, share_se = np.sqrt(np.mean([errors[:, 0] ** 2, (errors[:, 1] / best.power_kw) ** 2], axis=1))
    power_se = share_se * best.power_kw
    slope = best.current.curve.slope(best.current.speed_mps)
    residual = speed - best.current.speed_mps - best.current.misfit_mps
    settings = np.zeros((speed.size, len(trial.groups)))
    for column, group in enumerate(trial.groups):
        settings[group, column] = 1.0
    lag_s = np.abs(trial.time_s[:, np.newaxis] - trial.time_s)
    phase = 2.0 * np.pi * lag_s / TIDE_S
    regular = np.cos(phase) + _HALF_PERIOD**2 * np.cos(2.0 * phase) + _DOUBLE_PERIOD**2 * np.cos(0.5 * phase)
    logs, variances = [], []
    for tide, irregular, scale in product(_TIDES_MPS, _IRREGULAR_MPS, _CORRELATED_S):
        slow = 0.5 * irregular**2 * np.exp(-lag_s / scale)
        covariance = np.outer(trial.along, trial.along) * (_CONSTANT_MPS**2 + 0.5 * tide**2 * regular + slow)
        total = covariance + np.diag(0.5 * irregular**2 + speed_se**2 + (power_se / slope) ** 2)
        # the restricted likelihood of residuals whose means by setting are free
        inverse = np.linalg.inv(total)
        information = settings.T @ inverse @ settings
        centred = residual - settings @ np.linalg.solve(information, settings.T @ inverse @ residual)
        determinants = np.linalg.slogdet(total)[1] + np.linalg.slogdet(information)[1]
        prior = -0.5 * np.log(irregular / _USUAL_IRREGULAR_MPS) ** 2
        logs.append(prior + float(-0.5 * (determinants + centred @ inverse @ centred)))
        drift = np.einsum("oi,ij,oj->o", by_speed, covariance, by_speed)
        white = (0.5 * irregular**2 + speed_se**2) * np.sum(by_speed**2, axis=1)
        variances.append(drift + white + (by_power**2) @ power_se**2)
    weights = np.exp(np.array(logs) - np.max(logs))
    return weights / weights.sum(), np.array(variances)


def _mixture_half(weights: Floats, variances: Floats) -> Floats:
    """Half of the interval that holds 95 % of a mixture of normal distributions about zero, of each output."""
    low, high = np.zeros(variances.shape[1]), 8.0 * np.sqrt(variances.max(axis=0))
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        inside = weights @ (2.0 * ndtr(middle / np.sqrt(np.maximum(variances, 1e-12))) - 1.0)
        low, high = np.where(inside < 0.95, middle, low), np.where(inside < 0.95, high, middle)
    return np.asarray(high)


@dataclass(frozen=True, slots=True)
class _Change:
    """A trial in which a value common to all runs is changed: how much of the change of the result is expected
    (``shift``), and how much of it is one standard uncertainty (``spread``)."""

    name: str
    trial: SpeedTrial
    power_factor: float = 1.0
    shift: float = 0.0
    spread: float = 1.0


def _changes(trial: SpeedTrial) -> Iterator[_Change]:
    conditions, methods = trial.conditions, trial.methods
    # An accuracy is half of a rectangular distribution (JCGM 100, 4.3.7)
    yield _Change("power measurement", trial, 1.0 + conditions.power_error_percent / 100.0 / np.sqrt(3.0))
    yield from _wind_changes(trial)
    yield from _wave_changes(trial)
    if methods.keys() & {"wind", "waves", "water"}:
        efficiency = conditions.number("propulsive_efficiency") * (1.0 - _EFFICIENCY)
        yield _Change("propulsive efficiency", _with_conditions(trial, propulsive_efficiency=efficiency))
        variation = conditions.load_variation + _LOAD_VARIATION
        yield _Change("propulsive efficiency", _with_conditions(trial, load_variation=variation))
    if "shallow water" not in methods:  # what the bottom may have taken
        usual, depth_m = _with_usual_values(conditions), float(trial.sea.water_depth_m.min())
        beam_m, draught_m = usual.number("beam_m"), usual.number("draught_m")
        if depth_m < 3.0 * np.sqrt(beam_m * draught_m):  # in shallow water Lackenby's part of a usual ship
            shallow = replace(trial, conditions=replace(usual, form_factor=None))
            yield _Change(
                "shallow water", shallow.with_correction("shallow water"), shift=1.0, spread=_UNKNOWN_DEPTH
            )
        elif np.isfinite(depth_m):  # in deep water Raven's viscous part
            share = _VISCOUS_SHARE * 0.57 * (draught_m / depth_m) ** 1.79
            yield _Change("shallow water", trial, 1.0 - share, shift=1.0, spread=0.5)
    for name, share in (("shallow water", _SHALLOW), ("displacement", _DISPLACEMENT), ("water", _WATER)):
        if name in methods:
            yield _Change(name, trial.without_correction(name), spread=share)


def _with_conditions(trial: SpeedTrial, **conditions: float) -> SpeedTrial:
    return replace(trial, conditions=replace(trial.conditions, **conditions))  # type: ignore[arg-type]


def _wind_changes(trial: SpeedTrial) -> Iterator[_Change]:
    """Errors of the wind and its resistance; where it was not corrected for, what it may have taken."""
    if "wind" not in trial.methods:
        usual = replace(trial, conditions=_with_usual_values(trial.conditions))
        yield _Change("wind", usual.with_correction("wind"), shift=1.0, spread=_UNKNOWN_WIND)
        return
    curve = np.array(formulas.wind_resistance_of(trial.conditions))
    error = _OWN_WIND_CURVE if trial.conditions.wind_resistance else _TYPICAL_WIND_CURVE
    yield _Change("wind", replace(trial, wind_mps=trial.wind_mps * (1.0 + _WIND_SPEED)))
    yield _Change("wind", replace(trial, wind_from_deg=trial.wind_from_deg + _WIND_DEG))
    scaled = replace(trial.conditions, wind_resistance=tuple(map(float, curve * (1.0 + error))))
    yield _Change("wind", replace(trial, conditions=scaled))


def _wave_changes(trial: SpeedTrial) -> Iterator[_Change]:
    """Errors of the waves and what waves from the side may take, which the formulas leave out; where they were not
    corrected for, what waves of their height, or any that the wind may raise, may have taken."""
    sea = trial.sea
    if "waves" in trial.methods:
        height = sea.wave_height_m * np.sqrt(1.0 + _WAVES)
        yield _Change("waves", replace(trial, sea=replace(sea, wave_height_m=height)))
        if not formulas.from_ahead(trial.heading_deg, sea.wave_from_deg).all():
            yield _Change("waves", _with_side_waves(trial), shift=1.0, spread=0.6)
        return
    height, spread = sea.wave_height_m, _UNKNOWN_WIND
    if not np.isfinite(height).all():  # the square of a height that lies anywhere below the highest one
        height, spread = _FULLY_DEVELOPED * trial.wind_mps**2 / GRAVITY_MPS2 / np.sqrt(3.0), np.sqrt(0.8)
    wave_from_deg = np.where(np.isfinite(sea.wave_from_deg), sea.wave_from_deg, trial.wind_from_deg)
    sea = replace(sea, wave_height_m=height, wave_from_deg=wave_from_deg)
    usual = replace(trial, conditions=_with_usual_values(trial.conditions), sea=sea)
    yield _Change(
        "waves",
        _with_side_waves(usual.with_correction("waves", formulas.WAVE_METHODS[0])),
        shift=1.0,
        spread=spread,
    )


def _with_side_waves(trial: SpeedTrial) -> SpeedTrial:
    off_bow_deg = np.abs((trial.sea.wave_from_deg - trial.heading_deg + 180.0) % 360.0 - 180.0)
    share = np.clip((_NO_WAVES_DEG - off_bow_deg) / (_NO_WAVES_DEG - formulas.BOW_DEG), 0.0, 1.0)
    sea = replace(
        trial.sea, wave_height_m=np.sqrt(share) * trial.sea.wave_height_m, wave_from_deg=trial.heading_deg
    )
    return replace(trial, sea=sea)


def _with_usual_values(conditions: Conditions) -> Conditions:
    """The conditions with usual values of what wind, waves and depth act on, where they are not known."""
    beam = conditions.beam_m or conditions.number("length_m") / _USUAL_SLENDERNESS
    draught = conditions.draught_m or beam / _USUAL_BEAM
    return replace(
        conditions, beam_m=beam, draught_m=draught, bow_length_m=conditions.bow_length_m or beam,
        midship_section_m2=conditions.midship_section_m2 or 0.98 * beam * draught,
        frontal_area_m2=conditions.frontal_area_m2 or _USUAL_FRONTAL * beam**2,
        propulsive_efficiency=conditions.propulsive_efficiency or _USUAL_EFFICIENCY,
        wind_resistance=formulas.wind_resistance_of(conditions)
        or formulas.TYPICAL_WIND_RESISTANCE["tanker_loaded"],
    )  # fmt: skip
