"""What wind, waves, water and a shallow sea add to the power of a run: the corrections of ISO 15016:2015.

Its ITTC twin is 7.5-04-01-01.1 (2017, 2021). Resistances are in newtons, powers in kilowatts, speeds in metres a
second; arrays have one element a run. Directions that wind and waves come from are clockwise from true north.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from acquisition.core.arrays import Floats
from analysis.speed_power.conditions import REFERENCE_DENSITY_KGPM3, REFERENCE_TEMPERATURE_DEGC, Conditions

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
    """The power in deep water of one in shallow (Raven 2019, Conditions Technology Research 66; ITTC 2021)."""
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
