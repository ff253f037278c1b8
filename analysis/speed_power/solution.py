"""The speeds through the water, the current and the curve of a trial, from speeds over ground and powers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from seatrial.acquisition.config.conditions import Conditions
from seatrial.acquisition.core.quantities import Floats
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
from seatrial.analysis.speed_power.current import (
    IterativeCurrent,
    PowerCurve,
    fit_curve,
    iterate_current,
    mean_of_means,
)
from seatrial.analysis.speed_power.runs import PowerRun, settings_of

_PASSES = 3  # the corrections hang on the speed through the water, by a few percent of a few percent


@dataclass(frozen=True, slots=True)
class SpeedTrial:
    """What stays as it is while speeds and powers are varied: the runs as arrays [runs], the places of the runs of
    each power setting in ``groups``, and the corrections that apply, by name with their method."""

    given: Conditions
    time_s: Floats
    heading_deg: Floats
    along: Floats
    wind_from_deg: Floats
    wind_mps: Floats
    sea: RunSeas
    groups: list[list[int]]
    pairs: Floats
    methods: Mapping[str, str]

    def without(self, name: str) -> SpeedTrial:
        """This trial without one of the corrections."""
        return replace(self, methods={each: method for each, method in self.methods.items() if each != name})

    def corrected_by(self, name: str, method: str = "") -> SpeedTrial:
        """This trial with one more correction."""
        return replace(self, methods={**self.methods, name: method})


@dataclass(frozen=True, slots=True)
class SpeedPowerSolution:
    """What a trial was found to be.

    ``added_n`` is what was added to the resistance of each run [N], ``current`` what was found in the water as it
    was, ``speed_mps`` and ``power_kw`` those of each run without what was added, ``curve`` that through them, and
    ``means`` of each setting the speed by the mean of means and the mean power [settings, 2].
    """

    added_n: dict[str, Floats]
    current: IterativeCurrent
    speed_mps: Floats
    power_kw: Floats
    curve: PowerCurve
    means: Floats


def trial_of(given: Conditions, runs: Sequence[PowerRun], corrections: Sequence[Correction]) -> SpeedTrial:
    """The runs as arrays; the wind is the mean vector of each double run, as the ship disturbs it on both courses
    differently."""
    heading = np.array([run.heading_deg for run in runs])
    middle = np.array([(run.start + (run.end - run.start) / 2).timestamp() for run in runs])
    pairs = np.array([run.double_run for run in runs])
    wind = np.array([run.wind_mps * np.exp(1j * np.deg2rad(run.wind_from_deg)) for run in runs])
    wind = np.array([wind[pairs == pair].mean() for pair in pairs])
    return SpeedTrial(
        given, middle - middle[0], heading, np.cos(np.deg2rad(heading - heading[0])),
        np.rad2deg(np.angle(wind)) % 360.0, np.abs(wind), sea_of(given, runs), settings_of(runs), pairs,
        {each.name: each.method for each in corrections if each.applied},
    )  # fmt: skip


def solve(trial: SpeedTrial, over_ground: Floats, power: Floats) -> SpeedPowerSolution:
    """The speeds, the current and the curve of measured speeds and powers."""
    given, settings = trial.given, len(trial.groups)
    through = np.array([over_ground[trial.pairs == pair].mean() for pair in trial.pairs])
    for _ in range(_PASSES):
        added = _added_n(trial, over_ground, through, power)
        total = np.sum(list(added.values()), axis=0)
        ideal = ideal_power_kw(given, power, total, through) if trial.methods.keys() & added.keys() else power
        current = iterate_current(trial.time_s, trial.along, over_ground, ideal, through, settings)
        through = current.speed_mps
    means = np.array([_means(trial, group, over_ground, ideal) for group in trial.groups])
    depth = np.array([trial.sea.water_depth_m[group].mean() for group in trial.groups])
    speed, final = _in_deep_water(trial, through, ideal, trial.sea.water_depth_m)
    means = np.column_stack(_in_deep_water(trial, means[:, 0], means[:, 1], depth))
    curve = current.curve
    if trial.methods.keys() & {"shallow water", "displacement"}:
        curve = fit_curve(speed, final, settings)
    return SpeedPowerSolution(added, current, speed, final, curve, means)


def _added_n(trial: SpeedTrial, over_ground: Floats, through: Floats, power: Floats) -> dict[str, Floats]:
    """What wind, waves and water add to the resistance of each run."""
    given, nothing, methods = trial.given, np.zeros_like(through), trial.methods
    return {
        "wind": wind_resistance_n(given, trial.heading_deg, over_ground, trial.wind_from_deg, trial.wind_mps)
        if "wind" in methods else nothing,
        "waves": wave_resistance_n(given, trial.heading_deg, through, trial.sea, methods["waves"])
        if "waves" in methods else nothing,
        "water": water_resistance_n(given, through, power) if "water" in methods else nothing,
    }  # fmt: skip


def _means(trial: SpeedTrial, group: list[int], over_ground: Floats, power: Floats) -> tuple[float, float]:
    """Speed and power of a setting by the mean of means, both with the same weights."""
    along = trial.along[group]
    alternating = bool(np.all(along[1:] * along[:-1] < 0.0))
    return mean_of_means(over_ground[group], alternating), mean_of_means(power[group], alternating)


def _in_deep_water(trial: SpeedTrial, speed: Floats, power: Floats, depth: Floats) -> tuple[Floats, Floats]:
    """Speed and power without the shallow water, at the displacement that is stated."""
    given = trial.given
    if "shallow water" in trial.methods:
        if given.lacks(*RAVEN):
            speed = speed + lackenby_mps(given, speed, depth)
        else:
            power = raven_kw(given, speed, power, depth)
    if "displacement" in trial.methods:
        ratio = given.number("stated_displacement_m3") / given.number("displacement_m3")
        power = power * ratio ** (2.0 / 3.0)  # the admiralty coefficient, at one speed
    return speed, power
