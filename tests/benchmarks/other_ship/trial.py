"""A trial of the other ship: orders, sea and hidden effects in, the 13 recorded channels and the truth out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from math import ceil
from typing import Any

import numpy as np
import pandas as pd

from seatrial.acquisition.core.errors import ConfigurationError, ModelRangeError
from seatrial.acquisition.core.quantities import Floats
from tests.benchmarks.other_ship.effects import Hidden, data_sheet
from tests.benchmarks.other_ship.forces import Body, body_of
from tests.benchmarks.other_ship.model_error import forces_of, with_error
from tests.benchmarks.other_ship.motion import Drives, sail
from tests.benchmarks.other_ship.outside import SHEAR_BOUND_MPS, Outside, outside_of, with_bank_beside
from tests.benchmarks.other_ship.programmes import PROGRAMMES, Order, packed
from tests.benchmarks.other_ship.sea import SEAS, Sea, air_motion, gusts, slow_drift, wave_motion, waves
from tests.benchmarks.other_ship.sensors import recorded, reported
from tests.benchmarks.other_ship.sheet import Sheet

START = pd.Timestamp("2026-09-01T06:00:00Z")
LEAD_S = 6.0
"""Simulated before and after the record, so that delays have something to look at."""
SLOWEST_STEP_S = 0.05
SHARES_EVERY = 10


@dataclass(frozen=True, slots=True)
class Surroundings:
    """The sea's course over a trial: air [steps, 2] m/s, slow drift [steps] N and where it goes to."""

    air: Floats
    slow_n: Floats
    slow_to_rad: float


@dataclass(frozen=True, slots=True)
class Run:
    """A voyage: states [steps, 8] through the water; feedback, what acts and what is ordered [steps, 5]."""

    states: Floats
    controls: Floats
    acting: Floats
    ordered: Floats


def make_trial(
    seed: int,
    hidden: Hidden | None = None,
    outside: Mapping[str, float] | None = None,
    sea: str | Sea = "calm",
    programme: str | tuple[Order, ...] = "programme",
    duration_s: float = 3600.0,
    rate_hz: float = 10.0,
    noise: float = 1.0,
    model_error_percent: float = 0.0,
    model_error_form: str = "coefficients",
    outliers: float = 0.0,
    gaps: float = 0.0,
    correlated: bool = False,
    heel_coupling: bool = True,
    vessel: str = "gunnerus_short",
) -> tuple[pd.DataFrame, dict[str, Any]]:
    """Simulate a trial; returns the recorded table and the truth.

    The table has the 13 channels in their units and a UTC index named ``time``. First heading, wind and wave
    directions hang on the seed; so do, each on a stream of its own, gusts, waves, sensors and the model error.
    The truth holds what was hidden, the sizes of errors along the trial, and, sampled like the table and without
    waves, ``states`` [rows, 6] (m, rad, over ground), ``controls`` and ``ordered`` [rows, 5] (rev/s, rad, rpm) and
    ``roll_rad``.

    Raises :class:`ConfigurationError` for names that are not known and :class:`ModelRangeError` where the ship
    leaves the range of her coefficients.
    """
    conditions, orders = _named(sea, programme)
    dt_s, per_row, rows = _timing(duration_s, rate_hz)
    lead = round(LEAD_S / dt_s)
    steps = (rows - 1) * per_row + 1 + 2 * lead
    places, wind_noise, wave_noise, error_noise, sensor_noise = (
        np.random.default_rng(each) for each in np.random.SeedSequence(seed).spawn(5)
    )
    heading, wind_from, spread, shear_to = places.uniform(0.0, 2.0 * np.pi, 4)
    wave_to = wind_from + np.pi + (spread - np.pi) / 9.0  # waves within 20 degrees of the wind
    components = waves(wave_noise, conditions, wave_to)
    around = Surroundings(
        air_motion(wind_from, conditions.wind_mps, gusts(wind_noise, conditions.wind_mps, steps, dt_s)),
        slow_drift(conditions, components, steps, dt_s),
        wave_to,
    )
    sheet = data_sheet(vessel, hidden or {})
    strange = outside_of(outside or {}, shear_to, LEAD_S, duration_s)
    body, strange, error = _ship(
        error_noise,
        sheet,
        strange,
        heel_coupling,
        model_error_percent,
        model_error_form,
        orders,
        around,
        heading,
        dt_s,
    )
    run = _sail(body, strange, sheet, orders, around, heading, dt_s)
    ground = _over_ground(run.states, sheet, strange, dt_s)
    earth_speed = np.gradient(ground[:, :2], dt_s, axis=0)
    motion = wave_motion(components, ground[:, :3], earth_speed, *_size(sheet), dt_s)
    every = slice(lead, steps - lead, per_row)
    seen = reported(sheet, ground, motion[:, :3], run.controls, around.air, dt_s)[every]
    index = START + pd.to_timedelta(np.round(np.arange(rows) / rate_hz * 1e9).astype("int64"), unit="ns")
    seen.index = pd.DatetimeIndex(index, name="time")
    table = recorded(sensor_noise, seen, rate_hz, noise, correlated, outliers, gaps)
    truth = {
        "seed": seed,
        "vessel": vessel,
        "hidden": {name: dict(values) for name, values in (hidden or {}).items()},
        "outside": dict(outside or {}),
        "sea": asdict(conditions),
        "programme": programme if isinstance(programme, str) else "own",
        "duration_s": duration_s,
        "rate_hz": rate_hz,
        "noise": {"factor": noise, "correlated": correlated, "outliers": outliers, "gaps": gaps},
        "model_error": {"percent": model_error_percent, "form": model_error_form, **error},
        "heading_deg": float(np.degrees(heading)),
        "wind_from_deg": float(np.degrees(wind_from)),
        "wave_to_deg": float(np.degrees(wave_to) % 360.0),
        **_shares(body, strange, dt_s, run),
        "current_spread_mps": _current(run.states, sheet, strange, dt_s).std(axis=0).tolist(),
        "states": ground[every],
        "controls": run.controls[every],
        "ordered": run.ordered[every],
        "roll_rad": run.states[every, 6] + motion[every, 3],
    }
    return table, truth


def _named(sea: str | Sea, programme: str | tuple[Order, ...]) -> tuple[Sea, tuple[Order, ...]]:
    for given, known in ((sea, SEAS), (programme, PROGRAMMES)):
        if isinstance(given, str) and given not in known:
            raise ConfigurationError(f"no {given!r}", fix="use one of " + ", ".join(known))
    return (
        SEAS[sea] if isinstance(sea, str) else sea,
        PROGRAMMES[programme] if isinstance(programme, str) else programme,
    )


def _timing(duration_s: float, rate_hz: float) -> tuple[float, int, int]:
    """The step [s], steps a row, and the number of rows."""
    rows = round(duration_s * rate_hz)
    if rows < 2:
        raise ConfigurationError(
            f"{duration_s:g} s at {rate_hz:g} Hz give no samples", fix="give a longer duration"
        )
    per_row = ceil(1.0 / (rate_hz * SLOWEST_STEP_S) - 1e-9)
    return 1.0 / (rate_hz * per_row), per_row, rows


def _ship(
    random: np.random.Generator,
    sheet: Sheet,
    outside: Outside,
    heel_coupling: bool,
    percent: float,
    form: str,
    orders: tuple[Order, ...],
    around: Surroundings,
    heading_rad: float,
    dt_s: float,
) -> tuple[Body, Outside, dict[str, list[float]]]:
    """The ship as she is; a first voyage shows where a bank must lie and how large a model error may be."""
    body = body_of(sheet, heel_coupling)
    error: dict[str, list[float]] = {}
    if percent > 0.0 or outside.bank_n != 0.0:
        first = _sail(body, outside._replace(bank_n=0.0), sheet, orders, around, heading_rad, dt_s)
        if outside.bank_n != 0.0:
            outside = with_bank_beside(outside, first.states[:, 0], first.states[:, 1])
        if percent > 0.0:
            body, error = with_error(random, sheet, heel_coupling, percent, form, dt_s, first.states, first.acting)
    return body, outside, error


def _sail(
    body: Body,
    outside: Outside,
    sheet: Sheet,
    orders: tuple[Order, ...],
    around: Surroundings,
    heading_rad: float,
    dt_s: float,
) -> Run:
    steps = len(around.air)
    first = orders[0]
    speed = steady_speed(body, first.port_rpm, first.starboard_rpm)
    current = np.array(sheet.current_mps)
    ahead = np.array([np.cos(heading_rad), np.sin(heading_rad)])
    start = np.array([*(-LEAD_S * (speed * ahead + current)), heading_rad, speed, 0.0, 0.0, 0.0, 0.0])
    run = Run(np.empty((steps, 8)), *(np.empty((steps, 5)) for _ in range(3)))
    valid = sheet.numbers["validity"]
    limits = [valid[name] for name in ("surge_low_mps", "surge_high_mps", "sway_mps", "yaw_rate_radps")]
    left = sail(
        body, outside, packed(orders), Drives(), LEAD_S, heading_rad, start, current, around.air, around.slow_n,
        around.slow_to_rad, sheet.lag_s, np.array(sheet.pod_play_rad), np.array(limits), dt_s, run.states,
        run.controls, run.acting, run.ordered,
    )  # fmt: skip
    if left >= 0:
        u, v, r = run.states[left, 3:6]
        raise ModelRangeError(
            f"left the range of the model {left * dt_s - LEAD_S:.0f} s into the trial",
            why=f"surge {u:.2f} m/s, sway {v:.2f} m/s, yaw rate {r:.3f} rad/s",
            fix="hide less, or order less",
        )
    return run


def steady_speed(body: Body, port_rpm: float, starboard_rpm: float) -> float:
    """The speed [m/s] on a straight course through still water and air at which all forces ahead are in balance."""
    speeds = np.linspace(0.0, 10.0, 1001)
    states, acting = np.zeros((len(speeds), 8)), np.zeros((len(speeds), 5))
    states[:, 3], acting[:, 0], acting[:, 2] = speeds, port_rpm / 60.0, starboard_rpm / 60.0
    push = forces_of(body, Outside(), 1.0, states, acting)[:, 0]
    return float(np.interp(0.0, -push, speeds))


def _over_ground(states: Floats, sheet: Sheet, outside: Outside, dt_s: float) -> Floats:
    """North, east, heading, surge and sway over ground, yaw rate [steps, 6] of states through the water."""
    c, s = np.cos(states[:, 2]), np.sin(states[:, 2])
    north, east = _current(states, sheet, outside, dt_s).T
    return np.column_stack(
        [states[:, :3], states[:, 3] + north * c + east * s, states[:, 4] + east * c - north * s, states[:, 5]]
    )


def _current(states: Floats, sheet: Sheet, outside: Outside, dt_s: float) -> Floats:
    """The water's motion [steps, 2] at the ship's places."""
    through = (np.arange(len(states)) * dt_s - outside.fading_from_s) / outside.fading_over_s
    tide = np.clip(through, 0.0, 1.0)[:, np.newaxis] * [outside.tide_north_mps, outside.tide_east_mps]
    towards = np.array([np.cos(outside.shear_to_rad), np.sin(outside.shear_to_rad)])
    across = states[:, 1] * towards[0] - states[:, 0] * towards[1]
    speed = SHEAR_BOUND_MPS * np.sin(outside.shear_per_s * across / SHEAR_BOUND_MPS)
    return np.asarray(np.array(sheet.current_mps) + speed[:, np.newaxis] * towards + tide)


def _size(sheet: Sheet) -> tuple[float, float]:
    size = sheet.numbers["dimensions"]
    return size["length_overall_m"], size["draught_m"]


def _shares(body: Body, outside: Outside, dt_s: float, run: Run) -> dict[str, list[float]]:
    """How much heel and what is outside the catalogue weighed along the trial, root mean square [N, N, N m]."""
    sampled = SHARES_EVERY * dt_s, run.states[::SHARES_EVERY], run.acting[::SHARES_EVERY]
    whole = forces_of(body, outside, *sampled)[:, :3]
    without = {
        "outside_rms": (body, Outside()),
        "heel_rms": (body._replace(heel=body.heel._replace(resistance=0.0, side=0.0, turning=0.0)), outside),
    }
    return {
        name: np.sqrt(np.mean((whole - forces_of(*other, *sampled)[:, :3]) ** 2, axis=0)).tolist()
        for name, other in without.items()
    }
