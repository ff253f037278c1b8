"""Blind trials of ships with a propeller and a rudder: two hull models, tested as ship models and at 120 and 140 m.

One effect is hidden in each trial, or none, which the analyst diagnoses from the ship's channels alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import pandas as pd

from seatrial.hybrid.diagnosis.verdict import TOLERANCE
from seatrial.hybrid.effects import catalogue_of
from seatrial.hybrid.simulation.manoeuvres import (
    Leg,
    Manoeuvre,
    pace_of,
    scale_to_ship,
    settle,
    steer,
    straight_runs_on_four_headings,
    turning_circle,
    zigzag,
)
from seatrial.hybrid.simulation.trial import SeaState, simulate_trial
from seatrial.hybrid.vessel.files import Vessel, load_vessel
from seatrial.hybrid.workflows import diagnose_tables
from tests.hybrid.froude import froude_scaled

SHIPS = {"esso_osaka_3m": ("esso_osaka_3m", 1.0), "kvlcc2_7m": ("kvlcc2_7m", 1.0),
         "esso_osaka_120m": ("esso_osaka_3m", 40.0), "kvlcc2_140m": ("kvlcc2_7m", 20.0)}  # fmt: skip
"""Each ship's file, and how many times as large she is: hulls by cross-flow and by the MMG method."""

EFFECTS = (
    "thrust_loss_propeller", "wake_propeller", "astern_thrust_propeller", "rudder_offset_rudder",
    "rudder_loss_rudder", "lag_rudder", "ocean_current", "wave_drift", "loading", "hull_fouling",
    "cross_flow_drag", "drift_moment", "yaw_damping", "towed_load", "yaw_asymmetry", "heading_bias", "speed_scale",
    "position_antenna_offset", "position_delay",
)  # fmt: skip
"""Hidden in trials of either hull; and one more, which the other ship does not have or cannot show."""
_ONE_MORE = {"esso_osaka": "wind_side_load", "kvlcc2": "drift_force"}
_LARGE_EVERY = 5  # of so many singles one is of the large ship

_SIZES = {"astern_thrust_propeller": 2.0, "wind_side_load": 2.5, "heading_bias": 1.5, "speed_scale": 1.5}
"""How many times as large as is ordinary, where what is ordinary is about as large as what such a trial shows."""

_TRIAL_S = 2400.0  # of R/V Gunnerus; another ship's goes with the time for her own length
_USUAL_LENGTH_M = 28.9
_WIND_MPS, _WAVE_M, _WAVE_S = 4.0, 0.5, 5.0


@dataclass(frozen=True, slots=True)
class RudderCase:
    """A trial of a ship with an effect hidden in it, or none; in calm where the seed is even, else in wind."""

    ship: str
    effect: str
    seed: int

    @property
    def key(self) -> str:
        """The case in one word."""
        return f"{self.ship}/{self.effect or 'nothing'}/{self.seed}"


def singles() -> list[RudderCase]:
    """Forty trials with one effect each, by turns of either hull."""
    cases = []
    for number, effect in enumerate((*EFFECTS, "")):
        for hull, small, large in (("esso_osaka", "3m", "120m"), ("kvlcc2", "7m", "140m")):
            size = large if number % _LARGE_EVERY == _LARGE_EVERY - 1 else small
            cases.append(RudderCase(f"{hull}_{size}", effect or _ONE_MORE[hull], 2 * len(cases) + number % 2))
    return cases


def sound() -> list[RudderCase]:
    """Twenty trials with nothing hidden, half of them in wind."""
    ships = [*(("esso_osaka_3m", "kvlcc2_7m") * 4), "esso_osaka_120m", "kvlcc2_140m"] * 2
    return [RudderCase(ship, "", 3000 + number // 2 + number // 10) for number, ship in enumerate(ships)]


@lru_cache(maxsize=8)
def ship_named(name: str) -> Vessel:
    """One of :data:`SHIPS`."""
    file, scale = SHIPS[name]
    return load_vessel(file) if scale == 1.0 else froude_scaled(load_vessel(file), scale)


def hidden_in(case: RudderCase) -> dict[str, dict[str, float]]:
    """The effect at its size; its sign and direction by the seed."""
    if not case.effect:
        return {}
    effect, random = catalogue_of(ship_named(case.ship))[case.effect], np.random.default_rng(case.seed)
    size, first = _SIZES.get(case.effect, 1.0), effect.parameters[0]
    free = size * np.array(effect.free_scale)
    if effect.chart == "polar":
        angle = random.uniform(0.0, 2.0 * np.pi)
        free = free[0] * np.array([np.cos(angle), np.sin(angle)])
    elif first.neutral - free[0] > first.low:
        free = free * random.choice([-1.0, 1.0])
    return {case.effect: effect.complete_values(effect.values_at(free.tolist()))}


def exercises() -> Manoeuvre:
    """Forty minutes of R/V Gunnerus: turns, zigzags on four headings, runs, stops with the shaft astern."""
    runs = ((0.0, 171.0, 20.0), (180.0, 130.0, 20.0), (90.0, 171.0, 10.0), (270.0, 110.0, 20.0))
    stop = (Leg(rpm=0.0, at_most_s=20.0), Leg(rpm=-110.0, at_least_s=20.0, slower_mps=0.5, at_most_s=45.0))
    legs = [
        leg
        for course, rpm, angle in runs
        for leg in (settle(course, rpm), *zigzag(angle, angle, rpm, swings=6), steer(course, 30.0), *stop)
    ]
    return (*turning_circle(30.0, 160.0, 400.0), *legs, *straight_runs_on_four_headings(40.0), *stop)


def trial_of(case: RudderCase, rate_hz: float = 4.0) -> pd.DataFrame:
    """The recorded table of a case."""
    vessel, random = ship_named(case.ship), np.random.default_rng(1000 + case.seed)
    sea, heading_deg = _sea(vessel, random, case.seed % 2 == 1), float(random.uniform(0.0, 360.0))
    return simulate_trial(
        vessel, sea, scale_to_ship(exercises(), vessel), _TRIAL_S * pace_of(vessel).time, rate_hz, case.seed,
        hidden_in(case), catalogue=catalogue_of(vessel), heading_deg=heading_deg,
    )[0]  # fmt: skip


def _sea(vessel: Vessel, random: np.random.Generator, windy: bool) -> SeaState:
    """A calm, or wind and waves as large for this ship as gentle ones for R/V Gunnerus; nothing that drifts."""
    scale, some = vessel.dimensions.length_between_perpendiculars_m / _USUAL_LENGTH_M, float(windy)
    root, from_deg = scale**0.5, float(random.uniform(0.0, 360.0))
    wind_mps, wave_m = some * _WIND_MPS * root, some * _WAVE_M * scale
    return SeaState(
        wind_mps, wave_m, _WAVE_S * root, 0.0, from_deg, drift_n_per_m2=0.0, gust_length_m=100.0 * scale
    )


def judged(case: RudderCase) -> dict[str, Any]:
    """What was hidden, and what was said, as :mod:`.scoring` reads them."""
    vessel = ship_named(case.ship)
    plain = diagnose_tables([trial_of(case)], vessel, TOLERANCE, catalogue_of(vessel)).diagnosis.as_dict()
    kept = ("verdict", "effects", "indistinguishable", "unknown")
    return {
        "group": "rudder ships" if case.effect else "rudder ships, sound",
        "ship": case.ship,
        "hidden": hidden_in(case),
        "said": {name: plain[name] for name in kept},
    }
