"""The speeds through the water, the current and the power curve of a trial, from speeds over ground and powers.

By the mean of means and by the iterative method, as ISO 15016:2015 and ITTC 7.5-04-01-01.1 have both. The mean of
means takes runs at one power, to and fro, evenly spaced in time: weights 1, 3, 3, 1 of four runs remove a current
that changes as a parabola, 1 and 1 of two only one that does not change. The iterative method takes all powers
together: the current is V_C(t) = V_CC cos(2 pi t / T_C) + V_CS sin(2 pi t / T_C) + V_CT t + V_C0 along the course,
the power P(V) = a + b V^q.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import comb

import numpy as np

from seatrial.acquisition.config.run_sheet import Conditions
from seatrial.acquisition.core.errors import DataShortageError
from seatrial.acquisition.core.quantities import Floats
from seatrial.analysis.manoeuvres.runs import is_same_setting
from seatrial.analysis.speed_power.corrections import (
    RAVEN,
    Correction,
    RunSeas,
    ideal_power_kw,
    lackenby_mps,
    raven_kw,
    sea_of,
    water_resistance_n,
    wave_resistance_n,
    wind_resistance_n,
)
from seatrial.analysis.speed_power.runs import PowerRun

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
    sea: RunSeas
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


def trial_of(conditions: Conditions, runs: Sequence[PowerRun], corrections: Sequence[Correction]) -> SpeedTrial:
    """The runs as arrays; the wind is the mean vector of each double run, as the ship disturbs it on both courses
    differently."""
    heading = np.array([run.heading_deg for run in runs])
    middle = np.array([(run.start + (run.end - run.start) / 2).timestamp() for run in runs])
    pairs = np.array([run.double_run for run in runs])
    wind = np.array([run.wind_mps * np.exp(1j * np.deg2rad(run.wind_from_deg)) for run in runs])
    wind = np.array([wind[pairs == pair].mean() for pair in pairs])
    groups: list[list[int]] = []  # in order of the setting
    for place in sorted(range(len(runs)), key=lambda number: runs[number].setting):
        near = groups and is_same_setting(runs[groups[-1][0]].setting, runs[place].setting)
        groups[-1:] = [[*groups[-1], place]] if near else [*groups[-1:], [place]]
    return SpeedTrial(
        conditions, middle - middle[0], heading, np.cos(np.deg2rad(heading - heading[0])),
        np.rad2deg(np.angle(wind)) % 360.0, np.abs(wind), sea_of(conditions, runs),
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
            added["wind"] = wind_resistance_n(conditions, heading, over_ground, trial.wind_from_deg, trial.wind_mps)
        if "waves" in methods:
            added["waves"] = wave_resistance_n(conditions, heading, through, trial.sea, methods["waves"])
        if "water" in methods:
            added["water"] = water_resistance_n(conditions, through, power)
        total = np.sum(list(added.values()), axis=0)
        ideal = ideal_power_kw(conditions, power, total, through) if methods.keys() & added.keys() else power
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
        if conditions.lacks(*RAVEN):
            speed = speed + lackenby_mps(conditions, speed, depth)
        else:
            power = raven_kw(conditions, speed, power, depth)
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
