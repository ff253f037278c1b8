"""What wind, waves, water and a shallow sea add to the power of a run: the corrections of ISO 15016:2015.

Its ITTC twin is 7.5-04-01-01.1 (2017, 2021). Resistances are in newtons, powers in kilowatts, speeds in metres a
second; arrays have one element a run. Directions that wind and waves come from are clockwise from true north. The
end says which formulas can be used with what is known, and where the standard does not apply.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from seatrial.acquisition.config.conditions import REFERENCE_DENSITY_KGPM3, REFERENCE_TEMPERATURE_DEGC, Conditions
from seatrial.acquisition.core.quantities import Floats
from seatrial.acquisition.core.result import Number
from seatrial.analysis.manoeuvres.report import number_text
from seatrial.analysis.manoeuvres.runs import RECIPROCAL_DEG
from seatrial.analysis.speed_power.runs import RUN_MINUTES, PowerRun
from seatrial.analysis.speed_power.typical_wind import wind_resistance_of
from seatrial.analysis.speed_power.waves import (
    GRAVITY_MPS2,
    STAWAVE_1,
    STAWAVE_2,
    from_ahead,
    outside_stawave2,
    stawave1_limit_m,
    stawave1_n,
    stawave2_n,
)

_LEAST_BLOCKAGE = 0.05  # of midship section by the square of the depth: Lackenby's formula begins there
_MOST_SINKAGE = 0.05  # of the displacement, Raven


@dataclass(frozen=True, slots=True)
class Correction:
    """One correction: whether it was ``applied``, and by which ``method``, or why not.

    ``power_kw`` and ``speed_mps`` are how much it changed the power at the speed, and the speed at the power, of
    the highest setting; NaN where it was not applied.
    """

    name: str
    applied: bool
    method: str
    power_kw: Number = float("nan")
    speed_mps: Number = float("nan")


@dataclass(frozen=True, slots=True)
class RunSeas:
    """The sea of each run, arrays [runs]: significant height, mean period and direction of the waves, and depth.

    What was not recorded for a run is that of the conditions, NaN where they do not say it either.
    """

    wave_height_m: Floats
    wave_period_s: Floats
    wave_from_deg: Floats
    water_depth_m: Floats


def sea_of(given: Conditions, runs: Sequence[PowerRun]) -> RunSeas:
    """The sea of each run."""

    def column(name: str) -> Floats:
        values = np.array([getattr(run, name) for run in runs], dtype=float)
        return np.where(np.isfinite(values), values, given.number(name))

    return RunSeas(*map(column, ("wave_height_m", "wave_period_s", "wave_from_deg", "water_depth_m")))


def wind_resistance_n(
    given: Conditions, heading_deg: Floats, speed_mps: Floats, wind_from_deg: Floats, wind_mps: Floats
) -> Floats:
    """R_AA: the air's resistance beyond that of still air at the same speed over ground.

    The true wind at the anemometer is brought to the reference height by the seventh root of their ratio.
    ISO 15016:2015 (ITTC since 2017: the ninth).
    """
    height_m = given.anemometer_height_m or given.wind_reference_height_m
    true = wind_mps * (given.wind_reference_height_m / height_m) ** (1.0 / 7.0)
    off = np.deg2rad(wind_from_deg - heading_deg)
    ahead, aside = speed_mps + true * np.cos(off), true * np.sin(off)
    angle = np.abs(np.arctan2(aside, ahead))
    curve = np.asarray(wind_resistance_of(given))
    coefficient = np.interp(angle, np.linspace(0.0, np.pi, curve.size), curve)
    pressure = 0.5 * given.air_density_kgpm3 * given.number("frontal_area_m2")
    return np.asarray(pressure * (coefficient * (ahead**2 + aside**2) - curve[0] * speed_mps**2))


def wave_resistance_n(
    given: Conditions, heading_deg: Floats, speed_mps: Floats, sea: RunSeas, method: str
) -> Floats:
    """R_AWL by STAWAVE-1 or STAWAVE-2; nothing where waves are not from ahead."""
    ahead = from_ahead(heading_deg, sea.wave_from_deg)
    added = (
        stawave1_n(given, sea.wave_height_m)
        if method.startswith(WAVE_METHODS[0])
        else stawave2_n(given, sea.wave_height_m, sea.wave_period_s, speed_mps)
    )
    return np.where(ahead & (sea.wave_height_m > 0.0), added, 0.0)


def viscosity_m2ps(temperature_degc: float, density_kgpm3: float) -> float:
    """Kinematic viscosity of fresh to salt water; within 1 % of ITTC 7.5-02-01-03."""
    rho = 1e-3 * density_kgpm3
    slope = (43.4233 - 31.38 * rho) * (temperature_degc + 20.0) ** (1.72 * rho - 2.202)
    return float(1e-6 * (slope + 4.7478 - 5.779 * rho))


def friction_coefficient(speed_mps: Floats, length_m: float, viscosity: float) -> Floats:
    """The line of the ITTC 1957."""
    return np.asarray(0.075 / (np.log10(speed_mps * length_m / viscosity) - 2.0) ** 2)


def water_resistance_n(given: Conditions, speed_mps: Floats, power_kw: Floats) -> Floats:
    """R_AS: what water of another density and temperature than the reference adds.

    The total resistance that ISO takes from model tests is taken from the measured power itself.
    """
    length, density = given.number("length_m"), given.water_density_kgpm3
    temperature = given.number("water_temperature_degc")
    here = friction_coefficient(speed_mps, length, viscosity_m2ps(temperature, density))
    there = friction_coefficient(
        speed_mps, length, viscosity_m2ps(REFERENCE_TEMPERATURE_DEGC, REFERENCE_DENSITY_KGPM3)
    )
    total = 1e3 * power_kw * given.number("propulsive_efficiency") / speed_mps
    friction = 0.5 * density * given.number("wetted_area_m2") * speed_mps**2 * here
    return total * (1.0 - REFERENCE_DENSITY_KGPM3 / density) - friction * (there / here - 1.0)


def ideal_power_kw(given: Conditions, power_kw: Floats, added_n: Floats, speed_mps: Floats) -> Floats:
    """P_Did of the direct power method: the power without the added resistance, ISO 15016:2015."""
    added = 1e-3 * added_n * speed_mps / given.number("propulsive_efficiency")
    rest = power_kw - added
    under = np.maximum(rest**2 + 4.0 * power_kw * added * given.load_variation, 0.0)
    return np.asarray(0.5 * (rest + np.sqrt(under)))


def lackenby_mps(given: Conditions, speed_mps: Floats, depth: Floats) -> Floats:
    """The speed that shallow water has taken, to be added (Lackenby 1963; ISO 15016:2015)."""
    blockage = given.number("midship_section_m2") / depth**2
    loss = 0.1242 * (blockage - _LEAST_BLOCKAGE) + 1.0 - np.sqrt(np.tanh(GRAVITY_MPS2 * depth / speed_mps**2))
    return np.where(blockage >= _LEAST_BLOCKAGE, speed_mps * loss, 0.0)


def raven_kw(given: Conditions, speed_mps: Floats, power_kw: Floats, depth: Floats) -> Floats:
    """The power in deep water of one in shallow (Raven 2019, Ship Technology Research 66; ITTC 2021)."""
    length = given.number("length_m")
    efficiency, volume = given.number("propulsive_efficiency"), given.number("displacement_m3")
    density = given.water_density_kgpm3
    temperature = given.water_temperature_degc or REFERENCE_TEMPERATURE_DEGC
    friction = friction_coefficient(speed_mps, length, viscosity_m2ps(temperature, density))
    area, form = given.number("wetted_area_m2"), given.number("form_factor")
    viscous_n = 0.5 * density * area * speed_mps**2 * form * friction
    added_n = 0.57 * viscous_n * (given.number("draught_m") / depth) ** 1.79
    sinkage_m = 1.46 * volume / length**2 * (_depth_term(speed_mps, depth) - _depth_term(speed_mps, 0.3 * length))
    fuller = np.clip(sinkage_m * given.number("waterplane_area_m2") / volume, 0.0, _MOST_SINKAGE)
    return np.asarray(power_kw / (1.0 + fuller) ** (2.0 / 3.0) - 1e-3 * added_n * speed_mps / efficiency)


def _depth_term(speed_mps: Floats, depth_m: Floats | float) -> Floats:
    square = np.minimum(speed_mps**2 / (GRAVITY_MPS2 * depth_m), 0.99)
    return np.asarray(square / np.sqrt(1.0 - square))


def is_shallow(given: Conditions, depth_m: float, speed_mps: float) -> bool:
    """Whether depth is below 3 sqrt(B T) or 2.75 V^2 / g, where it is to be corrected for."""
    wide = 3.0 * np.sqrt(given.number("beam_m") * given.number("draught_m"))
    return bool(depth_m < max(wide, 2.75 * speed_mps**2 / GRAVITY_MPS2))


_FOUR = 4  # runs: with fewer the mean of means leaves a part of a changing current
_LEAST_LENGTH_M, _LEAST_SETTINGS, _LEAST_DOUBLE_RUNS = 100.0, 3, 4
_MOST_DISPLACEMENT_SHARE = 0.02
_WINDS_MPS = {True: 10.7, False: 13.8}  # the upper ends of Beaufort 5, for up to 100 m, and 6
RAVEN = (
    "form_factor", "wetted_area_m2", "waterplane_area_m2", "displacement_m3", "draught_m", "length_m",
    "propulsive_efficiency",
)  # fmt: skip
_NEEDED = {
    "wind": ("frontal_area_m2", "propulsive_efficiency"),
    "waves": ("propulsive_efficiency",),
    "water": ("water_temperature_degc", "wetted_area_m2", "length_m", "propulsive_efficiency"),
    "shallow water": ("beam_m", "draught_m"),
    "displacement": ("displacement_m3", "stated_displacement_m3"),
}
WAVE_METHODS = ("STAWAVE-1", "STAWAVE-2")
_TERMS = {1: "does not change", 2: "changes evenly", 3: "changes evenly and with a part of the tide"}
Groups = Sequence[Sequence[int]]


def corrections_of(given: Conditions, runs: Sequence[PowerRun]) -> tuple[Correction, ...]:
    """What is corrected for, and of what is not why."""
    sea = sea_of(given, runs)
    speeds = np.array([run.speed_mps for run in runs])
    chosen = {
        "wind": _wind(given, runs), "waves": _waves(given, runs, sea),
        "water": (True, "ITTC 1957 friction line, to 15 deg C and 1026 kg/m3"),
        "shallow water": _shallow_water(given, float(sea.water_depth_m.min()), float(speeds.max())),
        "displacement": (True, "admiralty coefficient"),
    }  # fmt: skip
    return tuple(
        Correction(name, False, f"not known: {', '.join(lacking)}")
        if (lacking := given.lacks(*_NEEDED[name]))
        else Correction(name, *method)
        for name, method in chosen.items()
    )


def _wind(given: Conditions, runs: Sequence[PowerRun]) -> tuple[bool, str]:
    if not all(np.isfinite(run.wind_mps) for run in runs):
        return False, "not known: the wind during the runs"
    if not wind_resistance_of(given):
        return False, "not known: wind_resistance, or wind_resistance_type"
    own = bool(given.wind_resistance)
    kind = "those of the ship" if own else f"typical of a {(given.wind_resistance_type or '').replace('_', ' ')}"
    return True, f"mean true wind of each double run, at the height of the coefficients; coefficients: {kind}"


def _waves(given: Conditions, runs: Sequence[PowerRun], sea: RunSeas) -> tuple[bool, str]:
    """STAWAVE-2 where what it asks for is known and within its range, else STAWAVE-1, else why neither."""
    if (sea.wave_height_m == 0.0).all():
        return False, "not needed: no waves"
    unknown = [name for name in ("wave_height_m", "wave_from_deg") if not np.isfinite(getattr(sea, name)).all()]
    if unknown:
        return False, f"not known: {', '.join(unknown)}"
    heading = np.array([run.heading_deg for run in runs])
    if not from_ahead(heading, sea.wave_from_deg).any():
        return False, "refused: no run had waves within 45 deg of the bow, where STAWAVE-1 and -2 hold"
    lacking = given.lacks(*STAWAVE_2)
    if not np.isfinite(sea.wave_period_s).all():
        lacking.append("wave_period_s")
    speeds = [run.speed_mps for run in runs]
    outside = list(outside_stawave2(given, min(speeds), max(speeds))) if not lacking else []
    if not lacking and not outside:
        return True, f"{WAVE_METHODS[1]}, for the runs with waves within 45 deg of the bow"
    second = f"not known: {', '.join(lacking)}" if lacking else "; ".join(outside)
    if unknown := given.lacks(*STAWAVE_1, "length_m"):
        return False, f"not known: {', '.join(unknown)} for STAWAVE-1; STAWAVE-2: {second}"
    limit = stawave1_limit_m(given.number("length_m"))
    if (height := float(sea.wave_height_m.max())) > limit:
        return False, f"refused: waves of {height:g} m, STAWAVE-1 is for {limit:.1f} m at most; STAWAVE-2: {second}"
    return True, (
        f"{WAVE_METHODS[0]}, for the runs with waves within 45 deg of the bow; it is for a ship that hardly heaves "
        f"and pitches. STAWAVE-2: {second}"
    )


def _shallow_water(given: Conditions, depth_m: float, fastest_mps: float) -> tuple[bool, str]:
    if not np.isfinite(depth_m):
        return False, "not known: water_depth_m"
    if not is_shallow(given, depth_m, fastest_mps):
        return False, "not needed: deeper than 3 sqrt(B T) and 2.75 V^2 / g"
    if not given.lacks(*RAVEN):
        return True, "Raven"
    if given.midship_section_m2 is not None:
        return True, "Lackenby"
    return False, "not known: midship_section_m2, or what Raven's method asks for"


def warnings_of(given: Conditions, runs: Sequence[PowerRun], groups: Groups, terms: int) -> tuple[str, ...]:
    """Where the standard does not apply or asks for more.

    ``groups`` are the places of the runs of each power setting, and so many ``terms`` of the current were found.
    """
    return (
        *_of_ship(given, runs), *_of_runs(runs), *_of_programme(runs, groups, terms), *_of_sea(given, runs),
    )  # fmt: skip


def _of_ship(given: Conditions, runs: Sequence[PowerRun]) -> Iterator[str]:
    if not given.number("length_m") >= _LEAST_LENGTH_M:
        long = "of unknown length" if given.length_m is None else f"{given.length_m:g} m long"
        yield f"the ship is {long}: the standard's methods rest on ships of {_LEAST_LENGTH_M:.0f} m and more"
    if missing := given.lacks("draught_m", "displacement_m3"):
        yield f"the loading is not known ({', '.join(missing)}): the result is for the loading of the trial"
    if given.water_depth_m is None and not all(np.isfinite(run.water_depth_m) for run in runs):
        yield "the depth of the water is not known: it is taken to be deep"
    off = abs(given.number("displacement_m3") / given.number("stated_displacement_m3") - 1.0)
    if off > _MOST_DISPLACEMENT_SHARE:
        yield f"the displacement differs by {off:.1%}: the admiralty coefficient is for 2 % at most"


def _of_runs(runs: Sequence[PowerRun]) -> Iterator[str]:
    if short := sum(each.minutes < 0.99 * RUN_MINUTES for each in runs):
        least = min(each.minutes for each in runs)
        yield f"{short} of {len(runs)} runs are shorter than {RUN_MINUTES:.0f} min, the shortest {least:.1f} min"
    if hasty := sum(each.approach_minutes < RUN_MINUTES for each in runs):
        least = min(each.approach_minutes for each in runs)
        yield (
            f"before {hasty} of {len(runs)} runs the ship was steady for less than {RUN_MINUTES:.0f} min, once for "
            f"{least:.1f} min: whether it had reached its speed is not known"
        )
    off = np.deg2rad([each.heading_deg - runs[0].heading_deg for each in runs])
    if (across := float(np.rad2deg(np.arcsin(np.abs(np.sin(off)).max())))) > RECIPROCAL_DEG:
        yield f"courses differ by up to {across:.0f} deg: only the current along the first is removed"


def _of_programme(runs: Sequence[PowerRun], groups: Groups, terms: int) -> Iterator[str]:
    pairs = max(each.double_run for each in runs)
    if len(groups) < _LEAST_SETTINGS or pairs < _LEAST_DOUBLE_RUNS:
        yield (
            f"{number_text(pairs, 'double run')} at {number_text(len(groups), 'power setting')}: the standard asks "
            f"for {_LEAST_DOUBLE_RUNS} at {_LEAST_SETTINGS}"
        )
    if course := _TERMS.get(terms):
        yield f"{len(runs)} runs are too few for a tide: the iterative method takes it that the current {course}"
    if single := sum(len(group) < _FOUR for group in groups):
        yield (
            f"{number_text(single, 'power setting')} without two double runs: there the mean of means removes a "
            "steady current only"
        )


def _of_sea(given: Conditions, runs: Sequence[PowerRun]) -> Iterator[str]:
    length, fastest = given.length_m or _LEAST_LENGTH_M, max(each.speed_mps for each in runs)
    wind, most = max(each.wind_mps for each in runs), _WINDS_MPS[length <= _LEAST_LENGTH_M]
    if wind > most:
        yield f"the wind was up to {wind:.1f} m/s, more than the {most:g} m/s of the standard"
    sea = sea_of(given, runs)
    if (highest := float(np.fmax.reduce(sea.wave_height_m))) > stawave1_limit_m(length):
        yield f"waves of {highest:g} m are higher than 2.25 sqrt(L / 100 m), the limit of the standard"
    wide = 2.0 * np.sqrt(given.number("beam_m") * given.number("draught_m"))
    least = float(np.fmax(wide, 2.0 * fastest**2 / GRAVITY_MPS2))
    if (depth := float(np.fmin.reduce(sea.water_depth_m))) < least:
        yield f"{depth:g} m of water are less than the {least:.0f} m that the standard allows"
