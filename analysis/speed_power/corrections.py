"""What wind, waves, water and a shallow sea add to the power of a run: the corrections of ISO 15016:2015.

Its ITTC twin is 7.5-04-01-01.1 (2017, 2021). Resistances are in newtons, powers in kilowatts, speeds in metres a
second; arrays have one element a run. Directions that wind and waves come from are clockwise from true north. The
end says which formulas can be used with what is known, and where the standard does not apply.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from acquisition.config.conditions import REFERENCE_DENSITY_KGPM3, REFERENCE_TEMPERATURE_DEGC, Conditions
from acquisition.core.arrays import Floats
from analysis.manoeuvres.report import number_text
from analysis.manoeuvres.runs import RECIPROCAL_DEG
from analysis.speed_power.runs import RUN_MINUTES, PowerRun

GRAVITY_MPS2 = 9.80665
_BOW_DEG = 45.0  # STAWAVE-1 is for waves from so far off the bow at most
_LEAST_BLOCKAGE = 0.05  # of midship section by the square of the depth: Lackenby's formula begins there
_MOST_SINKAGE = 0.05  # of the displacement, Raven


@dataclass(frozen=True, slots=True)
class Correction:
    """One correction: whether it was ``applied``, and by which ``method``, or why not."""

    name: str
    applied: bool
    method: str


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
    curve = np.asarray(given.wind_resistance)
    coefficient = np.interp(angle, np.linspace(0.0, np.pi, curve.size), curve)
    pressure = 0.5 * given.air_density_kgpm3 * given.number("frontal_area_m2")
    return np.asarray(pressure * (coefficient * (ahead**2 + aside**2) - curve[0] * speed_mps**2))


def wave_resistance_n(given: Conditions, heading_deg: Floats) -> Floats:
    """R_AW by STAWAVE-1, of a ship that hardly heaves and pitches; nothing where waves are not from ahead."""
    off = (given.number("wave_from_deg") - heading_deg + 180.0) % 360.0 - 180.0
    beam, bow = given.number("beam_m"), given.number("bow_length_m")
    height = given.number("wave_height_m")
    ahead = given.water_density_kgpm3 * GRAVITY_MPS2 * height**2 * beam * np.sqrt(beam / bow) / 16.0
    return np.where(np.abs(off) <= _BOW_DEG, ahead, 0.0)


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


def lackenby_mps(given: Conditions, speed_mps: Floats) -> Floats:
    """The speed that shallow water has taken, to be added (Lackenby 1963; ISO 15016:2015)."""
    depth = given.number("water_depth_m")
    blockage = given.number("midship_section_m2") / depth**2
    loss = 0.1242 * (blockage - _LEAST_BLOCKAGE) + 1.0 - np.sqrt(np.tanh(GRAVITY_MPS2 * depth / speed_mps**2))
    return speed_mps * loss if blockage >= _LEAST_BLOCKAGE else np.zeros_like(speed_mps)


def raven_kw(given: Conditions, speed_mps: Floats, power_kw: Floats) -> Floats:
    """The power in deep water of one in shallow (Raven 2019, Ship Technology Research 66; ITTC 2021)."""
    length, depth = given.number("length_m"), given.number("water_depth_m")
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


def _depth_term(speed_mps: Floats, depth_m: float) -> Floats:
    square = np.minimum(speed_mps**2 / (GRAVITY_MPS2 * depth_m), 0.99)
    return np.asarray(square / np.sqrt(1.0 - square))


def is_shallow(given: Conditions, speed_mps: float) -> bool:
    """Whether depth is below 3 sqrt(B T) or 2.75 V^2 / g, where it is to be corrected for."""
    wide = 3.0 * np.sqrt(given.number("beam_m") * given.number("draught_m"))
    return bool(given.number("water_depth_m") < max(wide, 2.75 * speed_mps**2 / GRAVITY_MPS2))


FOUR = 4  # runs: with fewer the mean of means leaves of a changing current what nobody knows
_LEAST_LENGTH_M, _LEAST_SETTINGS, _LEAST_DOUBLE_RUNS = 100.0, 3, 4
_MOST_DISPLACEMENT_SHARE = 0.02
_LIGHT_MPS = 3.3  # the upper end of Beaufort 2, which the standard takes for none
_WINDS_MPS = {True: 10.7, False: 13.8}  # the upper ends of Beaufort 5, for up to 100 m, and 6
RAVEN = (
    "form_factor", "wetted_area_m2", "waterplane_area_m2", "displacement_m3", "draught_m", "length_m",
    "propulsive_efficiency",
)  # fmt: skip
_NEEDED = {
    "wind": ("frontal_area_m2", "wind_resistance", "propulsive_efficiency"),
    "waves": ("wave_height_m", "wave_from_deg", "beam_m", "bow_length_m", "propulsive_efficiency"),
    "water": ("water_temperature_degc", "wetted_area_m2", "length_m", "propulsive_efficiency"),
    "shallow water": ("water_depth_m", "beam_m", "draught_m"),
    "displacement": ("displacement_m3", "stated_displacement_m3"),
}
_METHODS = {
    "wind": "relative wind, mean of each double run, brought to the height of the coefficients",
    "waves": "STAWAVE-1",
    "water": "ITTC 1957 friction line, to 15 deg C and 1026 kg/m3",
    "displacement": "admiralty coefficient",
}
_TERMS = {1: "does not change", 2: "changes evenly", 3: "changes evenly and with a part of the tide"}
Groups = Sequence[Sequence[int]]


def corrections_of(given: Conditions, runs: Sequence[PowerRun]) -> tuple[Correction, ...]:
    """What is corrected for, and of what is not why."""
    return tuple(_correction(name, given, runs) for name in _NEEDED)


def _correction(name: str, given: Conditions, runs: Sequence[PowerRun]) -> Correction:
    lacking = given.lacks(*_NEEDED[name])
    if name == "wind" and not all(np.isfinite(each.wind_mps) for each in runs):
        lacking.insert(0, "the wind during the runs")
    if lacking:
        return Correction(name, False, f"not known: {', '.join(lacking)}")
    if name != "shallow water":
        return Correction(name, True, _METHODS[name])
    if not is_shallow(given, max(each.speed_mps for each in runs)):
        return Correction(name, False, "not needed: deeper than 3 sqrt(B T) and 2.75 V^2 / g")
    if not given.lacks(*RAVEN):
        return Correction(name, True, "Raven")
    if given.midship_section_m2 is not None:
        return Correction(name, True, "Lackenby")
    return Correction(name, False, "not known: midship_section_m2, or what Raven's method asks for")


def warnings_of(
    given: Conditions, runs: Sequence[PowerRun], applied: Collection[str], groups: Groups, terms: int
) -> tuple[str, ...]:
    """Where the standard does not apply or asks for more.

    Corrections are ``applied`` by name, ``groups`` are the places of the runs of each power setting, and so many
    ``terms`` of the current were found.
    """
    return (
        *_of_ship(given), *_of_runs(runs), *_of_programme(runs, groups, terms), *_of_sea(given, runs),
        *_left_in(given, runs, applied),
    )  # fmt: skip


def _left_in(given: Conditions, runs: Sequence[PowerRun], applied: Collection[str]) -> Iterator[str]:
    """What is known to have been there and was not corrected for; no interval holds it."""
    wind = max(each.wind_mps for each in runs)
    if "wind" not in applied and not wind <= _LIGHT_MPS:
        much = f"wind of up to {wind:.1f} m/s" if np.isfinite(wind) else "whatever wind there was"
        yield f"{much} is not corrected for: what it takes is in the result, and in no interval"
    if "waves" not in applied and given.wave_height_m:
        yield f"waves of {given.wave_height_m:g} m are not corrected for: what they take is in the result"


def _of_ship(given: Conditions) -> Iterator[str]:
    if not given.number("length_m") >= _LEAST_LENGTH_M:
        long = "of unknown length" if given.length_m is None else f"{given.length_m:g} m long"
        yield f"the ship is {long}: the standard's methods rest on ships of {_LEAST_LENGTH_M:.0f} m and more"
    if missing := given.lacks("draught_m", "displacement_m3"):
        yield f"the loading is not known ({', '.join(missing)}): the result is that of the trial as she lay"
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
            f"before {hasty} of {len(runs)} runs she had gone steadily for less than {RUN_MINUTES:.0f} min, once "
            f"for {least:.1f} min: whether she had gathered all her way is not known"
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
    if single := sum(len(group) < FOUR for group in groups):
        yield (
            f"{number_text(single, 'power setting')} without two double runs: there the mean of means removes a "
            "steady current only, and has no interval"
        )


def _of_sea(given: Conditions, runs: Sequence[PowerRun]) -> Iterator[str]:
    length, fastest = given.length_m or _LEAST_LENGTH_M, max(each.speed_mps for each in runs)
    wind, most = max(each.wind_mps for each in runs), _WINDS_MPS[length <= _LEAST_LENGTH_M]
    if wind > most:
        yield f"the wind was up to {wind:.1f} m/s, more than the {most:g} m/s of the standard"
    if given.number("wave_height_m") > 2.25 * np.sqrt(length / 100.0):
        yield f"waves of {given.wave_height_m:g} m are higher than 2.25 sqrt(L / 100 m), the limit of STAWAVE-1"
    wide = 2.0 * np.sqrt(given.number("beam_m") * given.number("draught_m"))
    least = float(np.fmax(wide, 2.0 * fastest**2 / GRAVITY_MPS2))
    if given.number("water_depth_m") < least:
        yield f"{given.water_depth_m:g} m of water are less than the {least:.0f} m that the standard allows"
