"""Which corrections of ISO 15016:2015 can be made with what is known, and where the standard does not apply."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence

import numpy as np

from analysis.manoeuvres.report import number_text
from analysis.manoeuvres.runs import RECIPROCAL_DEG
from analysis.speed_power.conditions import Conditions
from analysis.speed_power.corrections import GRAVITY_MPS2, Correction, is_shallow
from analysis.speed_power.runs import RUN_MINUTES, PowerRun

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
