"""The corrections of ISO 15016:2015: what wind, waves, water and a shallow sea add to the power of a run.

The same is in ITTC 7.5-04-01-01.1 (2017, 2021). Resistances are in newtons, powers in kilowatts, speeds in metres a
second; arrays have one element a run. Directions that wind and waves come from are clockwise from true north.
:func:`corrections_of` chooses the formulas that the known conditions allow, :func:`warnings_of` tells where the
standard does not apply.

The waves' part is STAWAVE-1 and STAWAVE-2 (annex D). Both are for waves from up to 45 deg off the bow; waves from
other directions are taken to add nothing. STAWAVE-1 is for a ship that hardly heaves and pitches, as its waves are
short; STAWAVE-2 adds what heave and pitch take.

Where the wind resistance of the ship is not known, it is typical of its kind: coefficients of the STA joint
industry project (ITTC 7.5-04-01-01.1 (2021), section F.3; ISO 15016:2015, annex C). The standard itself was not at
hand. The numbers are those in which two independent transcriptions agree; of the tanker in ballast there was one.
Kinds of which there was only one, read off charts, such as car carriers and ferries, are left out.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.special import i1e, k1e

from seatrial.acquisition.config import run_sheet
from seatrial.acquisition.config.run_sheet import Conditions, WindType
from seatrial.acquisition.core import errors, result
from seatrial.acquisition.core.quantities import GRAVITY_MPS2, Bools, Floats
from seatrial.acquisition.tables.table_files import read_raw_table
from seatrial.analysis.manoeuvres.straight_runs import RECIPROCAL_DEG
from seatrial.analysis.report.tables import number_text
from seatrial.analysis.speed_power.runs import RUN_MINUTES, PowerRun

_LEAST_BLOCKAGE = 0.05  # of midship section by the square of the depth: Lackenby's formula begins there
_MOST_SINKAGE = 0.05  # of the displacement, Raven
_TWO_DOUBLE_RUNS = 4  # runs: with fewer the mean of means leaves a part of a changing current
_LEAST_LENGTH_M, _LEAST_SETTINGS, _LEAST_DOUBLE_RUNS = 100.0, 3, 4
_MOST_DISPLACEMENT_SHARE = 0.02
_ONE_SETTING = 1.3  # times the least power at one shaft speed: a strong wind makes a fifth, settings a third
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
_TERM_WORDS = {1: "does not change", 2: "changes evenly", 3: "changes evenly and with a part of the tide"}
Groups = Sequence[Sequence[int]]
BOW_DEG = 45.0
_GYRADIUS_SHARE = 0.25  # of the length: the pitch of a ship whose radius of gyration is not known
_FREQUENCIES = 200
_LOWEST_SHARE, _HIGHEST_SHARE = 0.65, 5.9  # of the peak's frequency: between them lies 99.8 % of the energy
STAWAVE_1 = ("beam_m", "bow_length_m")
STAWAVE_2 = ("length_m", "beam_m", "draught_m", "displacement_m3")
_RANGES = {
    "L_PP": (75.0, 350.0), "L_PP / B": (4.0, 9.0), "B / T": (2.2, 5.5), "Fr": (0.10, 0.30), "C_B": (0.50, 0.90),
}  # fmt: skip
"""Where STAWAVE-2 may be used: ITTC 7.5-04-01-01.2 (2014)."""
TYPICAL_WIND_RESISTANCE: dict[WindType, tuple[float, ...]] = {
    "tanker_loaded": (
        0.96, 0.93, 0.85, 0.73, 0.62, 0.47, 0.34, 0.17, 0.06, -0.05,
        -0.14, -0.22, -0.29, -0.40, -0.53, -0.66, -0.75, -0.79, -0.77,
    ),
    "tanker_ballast": (
        0.86, 0.76, 0.62, 0.45, 0.32, 0.21, 0.13, 0.06, 0.04, -0.02,
        -0.08, -0.19, -0.29, -0.38, -0.47, -0.56, -0.61, -0.66, -0.63,
    ),
    "gas_carrier_prismatic": (
        1.02, 0.99, 0.93, 0.83, 0.67, 0.48, 0.30, 0.14, 0.03, -0.05,
        -0.11, -0.24, -0.41, -0.56, -0.68, -0.79, -0.88, -0.92, -0.91,
    ),
    "container_loaded": (
        1.01, 1.11, 1.11, 0.95, 0.74, 0.46, 0.13, -0.28, -0.77, -1.09, -1.18, -1.19, -0.94,
    ),
    "general_cargo": (
        0.60, 0.87, 1.00, 1.00, 0.88, 0.85, 0.65, 0.42, 0.27, 0.09,
        -0.09, -0.49, -0.84, -1.15, -1.39, -1.47, -1.34, -0.92, -0.82,
    ),
}  # fmt: skip
"""C_AA at equal steps from 0 to 180 deg off the bow: a tanker of 280,000 dwt with a conventional bow, a gas carrier
with integrated prismatic tanks, a container ship of 6800 TEU with containers, a general cargo ship."""


@dataclass(frozen=True, slots=True)
class Correction:
    """One correction: whether it was ``applied``, and by which ``method``, or why not.

    ``power_kw`` and ``speed_mps`` are how much it changed the power at the speed, and the speed at the power, of
    the highest setting; NaN where it was not applied.
    """

    name: str
    applied: bool
    method: str
    power_kw: result.Number = float("nan")
    speed_mps: result.Number = float("nan")


@dataclass(frozen=True, slots=True)
class RunSeas:
    """The sea of each run, arrays [runs]: significant height, mean period and direction of the waves, and depth.

    What was not recorded for a run is that of the conditions, NaN where they do not say it either.
    """

    wave_height_m: Floats
    wave_period_s: Floats
    wave_from_deg: Floats
    water_depth_m: Floats


def sea_of(conditions: Conditions, runs: Sequence[PowerRun]) -> RunSeas:
    """The sea of each run."""

    def column(name: str) -> Floats:
        values = np.array([getattr(run, name) for run in runs], dtype=float)
        return np.where(np.isfinite(values), values, conditions.number(name))

    return RunSeas(*map(column, ("wave_height_m", "wave_period_s", "wave_from_deg", "water_depth_m")))


def wind_resistance_n(
    conditions: Conditions, heading_deg: Floats, speed_mps: Floats, wind_from_deg: Floats, wind_mps: Floats
) -> Floats:
    """R_AA: the air's resistance beyond that of still air at the same speed over ground.

    The true wind at the anemometer is brought to the reference height by the seventh root of their ratio.
    ISO 15016:2015 (ITTC since 2017: the ninth).
    """
    height_m = conditions.anemometer_height_m or conditions.wind_reference_height_m
    wind_at_height_mps = wind_mps * (conditions.wind_reference_height_m / height_m) ** (1.0 / 7.0)
    off_bow = np.deg2rad(wind_from_deg - heading_deg)
    ahead, across = speed_mps + wind_at_height_mps * np.cos(off_bow), wind_at_height_mps * np.sin(off_bow)
    angle = np.abs(np.arctan2(across, ahead))
    curve = np.asarray(wind_resistance_of(conditions))
    coefficient = np.interp(angle, np.linspace(0.0, np.pi, curve.size), curve)
    pressure = 0.5 * conditions.air_density_kgpm3 * conditions.number("frontal_area_m2")
    return np.asarray(pressure * (coefficient * (ahead**2 + across**2) - curve[0] * speed_mps**2))


def wave_resistance_n(
    conditions: Conditions, heading_deg: Floats, speed_mps: Floats, sea: RunSeas, method: str
) -> Floats:
    """R_AWL by STAWAVE-1 or STAWAVE-2; nothing where waves are not from ahead."""
    ahead = from_ahead(heading_deg, sea.wave_from_deg)
    added = (
        stawave1_n(conditions, sea.wave_height_m)
        if method.startswith(WAVE_METHODS[0])
        else stawave2_n(conditions, sea.wave_height_m, sea.wave_period_s, speed_mps)
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


def water_resistance_n(conditions: Conditions, speed_mps: Floats, power_kw: Floats) -> Floats:
    """R_AS: what water of another density and temperature than the reference adds.

    The total resistance that ISO takes from model tests is taken from the measured power itself.
    """
    length, density = conditions.number("length_m"), conditions.water_density_kgpm3
    temperature = conditions.number("water_temperature_degc")
    actual = friction_coefficient(speed_mps, length, viscosity_m2ps(temperature, density))
    reference = friction_coefficient(
        speed_mps, length, viscosity_m2ps(run_sheet.REFERENCE_TEMPERATURE_DEGC, run_sheet.REFERENCE_DENSITY_KGPM3)
    )
    total = 1e3 * power_kw * conditions.number("propulsive_efficiency") / speed_mps
    friction = 0.5 * density * conditions.number("wetted_area_m2") * speed_mps**2 * actual
    return total * (1.0 - run_sheet.REFERENCE_DENSITY_KGPM3 / density) - friction * (reference / actual - 1.0)


def ideal_power_kw(conditions: Conditions, power_kw: Floats, added_n: Floats, speed_mps: Floats) -> Floats:
    """P_Did of the direct power method: the power without the added resistance, ISO 15016:2015."""
    added = 1e-3 * added_n * speed_mps / conditions.number("propulsive_efficiency")
    reduced = power_kw - added
    under = np.maximum(reduced**2 + 4.0 * power_kw * added * conditions.load_variation, 0.0)
    return np.asarray(0.5 * (reduced + np.sqrt(under)))


def lackenby_mps(conditions: Conditions, speed_mps: Floats, depth: Floats) -> Floats:
    """The speed that shallow water has taken, to be added (Lackenby 1963; ISO 15016:2015)."""
    blockage = conditions.number("midship_section_m2") / depth**2
    loss = 0.1242 * (blockage - _LEAST_BLOCKAGE) + 1.0 - np.sqrt(np.tanh(GRAVITY_MPS2 * depth / speed_mps**2))
    return np.where(blockage >= _LEAST_BLOCKAGE, speed_mps * loss, 0.0)


def raven_kw(conditions: Conditions, speed_mps: Floats, power_kw: Floats, depth: Floats) -> Floats:
    """The power in deep water of one in shallow (Raven 2019, Ship Technology Research 66; ITTC 2021)."""
    length = conditions.number("length_m")
    efficiency, volume = conditions.number("propulsive_efficiency"), conditions.number("displacement_m3")
    density = conditions.water_density_kgpm3
    temperature = conditions.water_temperature_degc or run_sheet.REFERENCE_TEMPERATURE_DEGC
    friction = friction_coefficient(speed_mps, length, viscosity_m2ps(temperature, density))
    area, form = conditions.number("wetted_area_m2"), conditions.number("form_factor")
    viscous_n = 0.5 * density * area * speed_mps**2 * form * friction
    added_n = 0.57 * viscous_n * (conditions.number("draught_m") / depth) ** 1.79
    sinkage_m = 1.46 * volume / length**2 * (_depth_term(speed_mps, depth) - _depth_term(speed_mps, 0.3 * length))
    fuller = np.clip(sinkage_m * conditions.number("waterplane_area_m2") / volume, 0.0, _MOST_SINKAGE)
    return np.asarray(power_kw / (1.0 + fuller) ** (2.0 / 3.0) - 1e-3 * added_n * speed_mps / efficiency)


def _depth_term(speed_mps: Floats, depth_m: Floats | float) -> Floats:
    square = np.minimum(speed_mps**2 / (GRAVITY_MPS2 * depth_m), 0.99)
    return np.asarray(square / np.sqrt(1.0 - square))


def corrections_of(conditions: Conditions, runs: Sequence[PowerRun]) -> tuple[Correction, ...]:
    """All corrections: those that apply with their method, the others with the reason.

    A depth is corrected for below 3 sqrt(B T) and below 2.75 V^2 / g.
    """
    sea = sea_of(conditions, runs)
    kind = f"typical of a {(conditions.wind_resistance_type or '').replace('_', ' ')}"
    kind = "those of the ship" if conditions.wind_resistance else kind
    wind = True, f"mean true wind of each double run, at the height of the coefficients; coefficients: {kind}"
    if not all(np.isfinite(run.wind_mps) for run in runs):
        wind = False, "not known: the wind during the runs"
    elif not wind_resistance_of(conditions):
        wind = False, "not known: wind_resistance, or wind_resistance_type"
    depth_m, fastest_mps = float(sea.water_depth_m.min()), float(max(run.speed_mps for run in runs))
    wide = 3.0 * np.sqrt(conditions.number("beam_m") * conditions.number("draught_m"))
    shallow = False, "not known: midship_section_m2, or what Raven's method asks for"
    if not np.isfinite(depth_m):
        shallow = False, "not known: water_depth_m"
    elif not depth_m < max(wide, 2.75 * fastest_mps**2 / GRAVITY_MPS2):
        shallow = False, "not needed: deeper than 3 sqrt(B T) and 2.75 V^2 / g"
    elif not conditions.unknown_names(*RAVEN):
        shallow = True, "Raven"
    elif conditions.midship_section_m2 is not None:
        shallow = True, "Lackenby"
    chosen = {
        "wind": wind, "waves": _wave_method(conditions, runs, sea),
        "water": (True, "ITTC 1957 friction line, to 15 deg C and 1026 kg/m3"),
        "shallow water": shallow,
        "displacement": (True, "admiralty coefficient"),
    }  # fmt: skip
    return tuple(
        Correction(name, False, f"not known: {', '.join(lacking)}")
        if (lacking := conditions.unknown_names(*_NEEDED[name]))
        else Correction(name, *method)
        for name, method in chosen.items()
    )


def _wave_method(conditions: Conditions, runs: Sequence[PowerRun], sea: RunSeas) -> tuple[bool, str]:
    """STAWAVE-2 where what it asks for is known and within its range, else STAWAVE-1, else why neither."""
    if (sea.wave_height_m == 0.0).all():
        return False, "not needed: no waves"
    unknown = [name for name in ("wave_height_m", "wave_from_deg") if not np.isfinite(getattr(sea, name)).all()]
    if unknown:
        return False, f"not known: {', '.join(unknown)}"
    heading = np.array([run.heading_deg for run in runs])
    if not from_ahead(heading, sea.wave_from_deg).any():
        return False, "refused: no run had waves within 45 deg of the bow, where STAWAVE-1 and -2 hold"
    lacking = conditions.unknown_names(*STAWAVE_2)
    if not np.isfinite(sea.wave_period_s).all():
        lacking.append("wave_period_s")
    speeds = [run.speed_mps for run in runs]
    outside = list(outside_stawave2(conditions, min(speeds), max(speeds))) if not lacking else []
    if not lacking and not outside:
        return True, f"{WAVE_METHODS[1]}, for the runs with waves within 45 deg of the bow"
    second = f"not known: {', '.join(lacking)}" if lacking else "; ".join(outside)
    if unknown := conditions.unknown_names(*STAWAVE_1, "length_m"):
        return False, f"not known: {', '.join(unknown)} for STAWAVE-1; STAWAVE-2: {second}"
    limit = stawave1_limit_m(conditions.number("length_m"))
    if (height := float(sea.wave_height_m.max())) > limit:
        return False, f"refused: waves of {height:g} m, STAWAVE-1 is for {limit:.1f} m at most; STAWAVE-2: {second}"
    return True, (
        f"{WAVE_METHODS[0]}, for the runs with waves within 45 deg of the bow; it is for a ship that hardly heaves "
        f"and pitches. STAWAVE-2: {second}"
    )


def warnings_of(conditions: Conditions, runs: Sequence[PowerRun], groups: Groups, terms: int) -> tuple[str, ...]:
    """Where the standard does not apply or asks for more.

    ``groups`` are the places of the runs of each power setting, and so many ``terms`` of the current were found.
    """
    warnings = []
    if not conditions.number("length_m") >= _LEAST_LENGTH_M:
        long = "of unknown length" if conditions.length_m is None else f"{conditions.length_m:g} m long"
        warnings.append(
            f"the ship is {long}: the standard's methods rest on ships of {_LEAST_LENGTH_M:.0f} m and more"
        )
    if missing := conditions.unknown_names("draught_m", "displacement_m3"):
        warnings.append(
            f"the loading is not known ({', '.join(missing)}): the result is for the loading of the trial"
        )
    if conditions.water_depth_m is None and not all(np.isfinite(run.water_depth_m) for run in runs):
        warnings.append("the depth of the water is not known: it is taken to be deep")
    deviation = abs(conditions.number("displacement_m3") / conditions.number("stated_displacement_m3") - 1.0)
    if deviation > _MOST_DISPLACEMENT_SHARE:
        warnings.append(
            f"the displacement differs by {deviation:.1%}: the admiralty coefficient is for 2 % at most"
        )
    warnings += _programme_warnings(runs, groups, terms)

    length, fastest = conditions.length_m or _LEAST_LENGTH_M, max(run.speed_mps for run in runs)
    wind, most = max(run.wind_mps for run in runs), _WINDS_MPS[length <= _LEAST_LENGTH_M]
    if wind > most:
        warnings.append(f"the wind was up to {wind:.1f} m/s, more than the {most:g} m/s of the standard")
    sea = sea_of(conditions, runs)
    if (highest := float(np.fmax.reduce(sea.wave_height_m))) > stawave1_limit_m(length):
        warnings.append(f"waves of {highest:g} m are higher than 2.25 sqrt(L / 100 m), the limit of the standard")
    wide = 2.0 * np.sqrt(conditions.number("beam_m") * conditions.number("draught_m"))
    least = float(np.fmax(wide, 2.0 * fastest**2 / GRAVITY_MPS2))
    if (depth := float(np.fmin.reduce(sea.water_depth_m))) < least:
        warnings.append(f"{depth:g} m of water are less than the {least:.0f} m that the standard allows")
    return tuple(warnings)


def _programme_warnings(runs: Sequence[PowerRun], groups: Groups, terms: int) -> Iterator[str]:
    """Warnings of single runs, then of the programme as a whole."""
    if short := sum(run.minutes < 0.99 * RUN_MINUTES for run in runs):
        least = min(run.minutes for run in runs)
        yield f"{short} of {len(runs)} runs are shorter than {RUN_MINUTES:.0f} min, the shortest {least:.1f} min"
    if hasty := sum(run.approach_minutes < RUN_MINUTES for run in runs):
        least = min(run.approach_minutes for run in runs)
        yield (
            f"before {hasty} of {len(runs)} runs the ship was steady for less than {RUN_MINUTES:.0f} min, once for "
            f"{least:.1f} min: whether it had reached its speed is not known"
        )
    course_changes = np.deg2rad([run.heading_deg - runs[0].heading_deg for run in runs])
    if (across := float(np.rad2deg(np.arcsin(np.abs(np.sin(course_changes)).max())))) > RECIPROCAL_DEG:
        yield f"courses differ by up to {across:.0f} deg: only the current along the first is removed"
    for group in groups:
        powers = [runs[place].power_kw for place in group]
        if max(powers) > _ONE_SETTING * min(powers):
            yield (
                f"runs at one shaft speed took {min(powers):,.0f} to {max(powers):,.0f} kW and count as one power "
                "setting: of a controllable propeller the pitch has to be recorded, too"
            )
    pairs = max(run.double_run for run in runs)
    if len(groups) < _LEAST_SETTINGS or pairs < _LEAST_DOUBLE_RUNS:
        yield (
            f"{number_text(pairs, 'double run')} at {number_text(len(groups), 'power setting')}: the standard asks "
            f"for {_LEAST_DOUBLE_RUNS} at {_LEAST_SETTINGS}"
        )
    if course := _TERM_WORDS.get(terms):
        yield f"{len(runs)} runs are too few for a tide: the iterative method takes it that the current {course}"
    if single := sum(len(group) < _TWO_DOUBLE_RUNS for group in groups):
        yield (
            f"{number_text(single, 'power setting')} without two double runs: there the mean of means removes a "
            "steady current only"
        )


def from_ahead(heading_deg: Floats, wave_from_deg: Floats) -> Bools:
    """The runs with waves from up to 45 deg off the bow."""
    off_bow_deg = (wave_from_deg - heading_deg + 180.0) % 360.0 - 180.0
    return np.asarray(np.abs(off_bow_deg) <= BOW_DEG)


def stawave1_n(conditions: Conditions, height_m: Floats) -> Floats:
    """R_AWL = rho g H^2 B sqrt(B / L_BWL) / 16 [N] of head waves of a significant height [m]."""
    beam, bow = conditions.number("beam_m"), conditions.number("bow_length_m")
    return np.asarray(
        conditions.water_density_kgpm3 * GRAVITY_MPS2 * height_m**2 * beam * np.sqrt(beam / bow) / 16.0
    )


def stawave2_n(conditions: Conditions, height_m: Floats, period_s: Floats, speed_mps: Floats) -> Floats:
    """R_AWL [N] of head waves of a significant height [m] and mean period T01 [s], at speeds through the water.

    The response in regular waves, times twice the spectrum of ITTC 1978, 173 H^2 / (T^4 w^5) exp(-691 / (T^4 w^4)).
    """
    peak = (0.8 * 691.0) ** 0.25 / period_s
    share = np.geomspace(_LOWEST_SHARE, _HIGHEST_SHARE, _FREQUENCIES)
    omega = peak[:, np.newaxis] * share
    fourth = (period_s**4)[:, np.newaxis]
    spectrum = 173.0 * (height_m**2)[:, np.newaxis] / fourth / omega**5 * np.exp(-691.0 / fourth / omega**4)
    response = regular_waves_n(conditions, omega, speed_mps[:, np.newaxis])
    return np.asarray(2.0 * np.trapezoid(response * spectrum, omega, axis=1))


def regular_waves_n(conditions: Conditions, omega: Floats, speed_mps: Floats) -> Floats:
    """R_AW / zeta_A^2 [N/m^2] of STAWAVE-2 in regular head waves of a frequency [rad/s]: motion and reflection."""
    L, B, T = (conditions.number(name) for name in STAWAVE_2[:3])
    C_B = conditions.number("displacement_m3") / (L * B * T)
    k_yy = (conditions.pitch_gyradius_m or _GYRADIUS_SHARE * L) / L
    rho_g = conditions.water_density_kgpm3 * GRAVITY_MPS2
    Fr = speed_mps / np.sqrt(GRAVITY_MPS2 * L)
    ratio = np.sqrt(L / GRAVITY_MPS2) * np.cbrt(k_yy) / (1.17 * Fr**-0.143) * omega
    a = 60.3 * C_B**1.34
    b = np.where(ratio < 1.0, 11.0, -8.5)
    d = np.where(ratio < 1.0, 14.0, -566.0 * (L / B) ** -2.66)
    motion = ratio**b * np.exp(b / d * (1.0 - ratio**d)) * a * Fr**1.5 * np.exp(-3.5 * Fr)
    f = 0.692 * (speed_mps / np.sqrt(T * GRAVITY_MPS2)) ** 0.769 + 1.81 * C_B**6.95
    x = 1.5 * omega**2 / GRAVITY_MPS2 * T
    # pi^2 I^2 / (pi^2 I^2 + K^2), of the scaled Bessel functions: I alone is beyond a float's range in short waves
    transmitted = (k1e(x) / i1e(x) * np.exp(-2.0 * x) / np.pi) ** 2
    return np.asarray(4.0 * rho_g * B**2 / L * motion + 0.5 * rho_g * B * f / (1.0 + transmitted))


def stawave1_limit_m(length_m: float) -> float:
    """The highest waves [m] of STAWAVE-1: 2.25 sqrt(L_PP / 100 m)."""
    return float(2.25 * np.sqrt(length_m / 100.0))


def outside_stawave2(conditions: Conditions, slowest_mps: float, fastest_mps: float) -> Iterator[str]:
    """Where a ship at speeds through the water lies outside the range of STAWAVE-2."""
    L, B, T = (conditions.number(name) for name in STAWAVE_2[:3])
    froude = [speed / np.sqrt(GRAVITY_MPS2 * L) for speed in (slowest_mps, fastest_mps)]
    values = {
        "L_PP": [L], "L_PP / B": [L / B], "B / T": [B / T], "Fr": froude,
        "C_B": [conditions.number("displacement_m3") / (L * B * T)],
    }  # fmt: skip
    for name, (low, high) in _RANGES.items():
        for value in values[name]:
            if not low <= value <= high:
                yield f"{name} of {value:.3g} is not {low:g} to {high:g}"
                break


def wind_resistance_of(conditions: Conditions) -> tuple[float, ...]:
    """C_AA of a ship at equal steps from 0 to 180 deg off the bow: its own, else those typical of its kind."""
    if conditions.wind_resistance or conditions.wind_resistance_type is None:
        return conditions.wind_resistance
    return TYPICAL_WIND_RESISTANCE[conditions.wind_resistance_type]


def read_wind_resistance(path: Path | str) -> tuple[float, ...]:
    """C_AA every 5 deg from 0 to 180 off the bow, of a table with the columns ``angle`` [deg] and ``C_AA``.

    Raises :class:`InputError` for a table without them, or whose angles do not go from 0 to 180 deg.
    """
    table = read_raw_table(path).columns
    named = {str(name).lower().split("[")[0].strip().removesuffix("_deg"): name for name in table.columns}
    if not {"angle", "c_aa"} <= named.keys():
        raise errors.InputError(
            "has no columns angle and C_AA", where=str(path), why=f"it has {', '.join(map(str, table.columns))}",
            fix="name the angle off the bow 'angle [deg]' and the coefficient 'C_AA'",
        )  # fmt: skip
    try:
        angle, drag = (table[named[name]].to_numpy(dtype=float) for name in ("angle", "c_aa"))
    except ValueError as error:
        raise errors.InputError("holds text among its numbers", where=str(path), why=str(error)) from error
    order = np.argsort(angle)
    if not (np.isfinite([angle, drag]).all() and angle.size > 2 and np.ptp(angle) == angle.max() == 180.0):
        raise errors.InputError(
            "does not go from 0 to 180 deg", where=str(path), fix="give C_AA from 0 to 180 deg off the bow"
        )
    if np.interp(0.0, angle[order], drag[order]) <= 0.0:
        raise errors.InputError(
            "has no resistance to the wind from ahead", where=str(path),
            fix="change the sign: C_AA is positive where the air brakes, C_X the other way round",
        )  # fmt: skip
    return tuple(map(float, np.interp(np.arange(0.0, 181.0, 5.0), angle[order], drag[order])))
