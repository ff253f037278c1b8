"""A simulated trial: a ship with hidden effects in a sea state, as her sensors record it, with white noise.

Everything random hangs on one seed and on streams of its own: waves, gusts, drift and sensors, so that a
change to one leaves the others as they were.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from math import ceil
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from seatrial.acquisition.core.errors import ConfigurationError, printable_name
from seatrial.acquisition.core.files import write_text, written_together
from seatrial.acquisition.core.quantities import Floats, to_ship
from seatrial.acquisition.core.ship import Actuators, as_text
from seatrial.acquisition.core.trial import Trial, software_version
from seatrial.acquisition.recording.writer import write_table
from seatrial.hybrid.effects import Catalogue, apply_effects, vessel_plant
from seatrial.hybrid.simulation.autopilot import Drives, drives_of, sail
from seatrial.hybrid.simulation.handling import handling_of, steady_speed_mps
from seatrial.hybrid.simulation.manoeuvres import Leg, Manoeuvre, as_arrays, for_ship, manoeuvre_named, shafts_rpm
from seatrial.hybrid.simulation.sea_state import (
    SeaState,
    drift_series,
    sea_for,
    wave_motion,
    wind_series,
    with_waves,
)
from seatrial.hybrid.vessel.actuators import angle_columns, control_units
from seatrial.hybrid.vessel.channels import as_table
from seatrial.hybrid.vessel.effect import growth, scale_of
from seatrial.hybrid.vessel.files import load_vessel
from seatrial.hybrid.vessel.parameters import Vessel
from seatrial.hybrid.vessel.plant import Plant, bare_plant, pack
from seatrial.hybrid.vessel.sensors import acting_controls, measure
from seatrial.hybrid.vessel.simulate import Runs, combine_forces, range_error

_ANTENNA = {"antenna_forward_m": 0.0, "antenna_starboard_m": 0.0}  # positions are those of the body axes' origin


@dataclass(frozen=True, slots=True)
class SimulationNoise:
    """Standard deviations of the sensors' white noise, in the units of the channels."""

    position_m: float = 0.05
    heading_deg: float = 0.1
    speed_mps: float = 0.03
    yaw_rate_dps: float = 0.05
    wind_direction_deg: float = 3.0
    wind_speed_mps: float = 0.2
    shaft_rpm: float = 0.3
    azimuth_deg: float = 0.2

    def scaled(self, factor: float) -> SimulationNoise:
        """This noise times ``factor``; zero gives perfect sensors."""
        return SimulationNoise(*(factor * getattr(self, name) for name in self.__slots__))


def usual_noise(length_m: float) -> SimulationNoise:
    """The noise of the sensors of a ship of this length: a model, which moves less, has finer ones."""
    usual, scale = SimulationNoise(), min(scale_of(length_m), 1.0)
    return replace(
        usual,
        position_m=usual.position_m * growth("m", scale),
        speed_mps=usual.speed_mps * growth("m/s", scale),
        wind_speed_mps=usual.wind_speed_mps * growth("m/s", scale),
    )


def add_noise(
    generator: np.random.Generator,
    noise: SimulationNoise,
    states: Floats,
    controls: Floats,
    wind: Floats,
    actuators: Actuators,
) -> tuple[Floats, Floats, Floats]:
    """States [rows, 6], controls [rows, controls] and wind [rows, 2] with noise; a calm stays above zero."""
    turn = np.pi / 180.0
    motion = (
        [noise.position_m] * 2 + [noise.heading_deg * turn] + [noise.speed_mps] * 2 + [noise.yaw_rate_dps * turn]
    )
    units, angles = control_units(actuators), angle_columns(actuators)
    command = noise.shaft_rpm * units
    command[angles] = noise.azimuth_deg * units[angles]
    air = [noise.wind_direction_deg * turn, noise.wind_speed_mps]
    moving, acting, blowing = (
        values + generator.standard_normal(values.shape) * sigmas
        for values, sigmas in ((states, motion), (controls, command), (wind, air))
    )
    blowing[:, 1] = np.abs(blowing[:, 1])
    return moving, acting, blowing


START = pd.Timestamp("2026-06-01T08:00:00Z")
ORIGIN_DEG = (63.44, 10.40)
"""Latitude and longitude that simulated trials start from."""
SLOWEST_LOOP_HZ = 10.0
Hidden = Mapping[str, Mapping[str, float]]
_LONGEST_S = 7 * 86400.0


@dataclass(frozen=True, slots=True)
class Voyage:
    """A simulated motion without sensors, a row for every step of the simulation.

    ``states`` [K+1, 6], ``controls`` [K+1, controls] as the drives' feedback shows them with the plant's delay, and
    ``wind`` [K+1, 2] as a perfect sensor with the plant's bias and factor reports it.
    """

    states: Floats
    controls: Floats
    wind: Floats


def simulate_trial(
    vessel: Vessel | str | None = None,
    sea_state: SeaState | str = "calm",
    manoeuvre: Manoeuvre | str = "voyage",
    duration_s: float = 1200.0,
    rate_hz: float = 10.0,
    seed: int = 0,
    hidden: Hidden | None = None,
    *,
    noise: SimulationNoise | None = None,
    catalogue: Catalogue | None = None,
    heading_deg: float = 0.0,
    start_time: pd.Timestamp = START,
) -> tuple[pd.DataFrame, dict[str, Any]]:
    """Simulate a trial and return the recorded table and the truth.

    The table has the channels of the vessel in their units and a UTC index named ``time``, from ``start_time`` for
    ``duration_s`` at ``rate_hz``. The truth says what was hidden and by which weather, and holds the
    noise-free ``states`` [rows, 6], ``controls`` [rows, controls], ``wind`` [rows, 2] and the ``plant``. Raises
    :class:`ConfigurationError` for names that do not exist, :class:`ModelRangeError` if the ship leaves the
    range of her model. A sea state by name is at the scale of a ship's model, one that is given is as it is.
    """
    ship = load_vessel(vessel)
    sea = sea_for(sea_state, ship.dimensions) if isinstance(sea_state, str) else sea_state
    legs = for_ship(manoeuvre_named(manoeuvre, ship.actuators), ship) if isinstance(manoeuvre, str) else manoeuvre
    steps_per_row, rows = _timing(duration_s, rate_hz)
    streams = [np.random.default_rng(each) for each in np.random.SeedSequence(seed).spawn(4)]
    environment = sea.effects(ship.dimensions.length_between_perpendiculars_m)
    plant = _in_sea(vessel_plant(ship, catalogue), sea, environment, catalogue)
    plant = apply_effects(plant, hidden or {}, catalogue)
    dt_s = 1.0 / (rate_hz * steps_per_row)
    voyage = sail_through(
        ship, plant, sea, legs, (rows - 1) * steps_per_row, dt_s, heading_deg, streams[0], streams[1]
    )
    moving = with_waves(voyage.states, wave_motion(streams[2], sea, plant, voyage.states, dt_s))
    every = slice(None, None, steps_per_row)
    reported = measure(moving, plant, dt_s)[every]
    sensors = noise or usual_noise(ship.dimensions.length_between_perpendiculars_m)
    recorded = add_noise(streams[3], sensors, reported, voyage.controls[every], voyage.wind[every], ship.actuators)
    index = start_time + pd.to_timedelta(np.round(np.arange(rows) / rate_hz * 1e9).astype("int64"), unit="ns")
    table = as_table(*recorded, index=pd.DatetimeIndex(index, name="time"), actuators=ship.actuators)
    actuators = as_text(ship.actuators)
    ship_named = {"vessel": ship.name, "actuators": actuators} if actuators else {}
    table.attrs["trial"] = {**ship_named, **_ANTENNA}
    truth = {
        "vessel": ship.name,
        "sea_state": asdict(sea),
        "manoeuvre": manoeuvre if isinstance(manoeuvre, str) else "own",
        "duration_s": duration_s,
        "rate_hz": rate_hz,
        "seed": seed,
        "hidden": {name: dict(values) for name, values in (hidden or {}).items()},
        "vessel_effects": {name: dict(values) for name, values in ship.effects.items()},
        "environment": environment,
        "noise": asdict(sensors),
        "states": voyage.states[every],
        "controls": voyage.controls[every],
        "wind": voyage.wind[every],
        "plant": plant,
    }
    return table, truth


def _in_sea(plant: Plant, sea: SeaState, environment: Hidden, catalogue: Catalogue | None) -> Plant:
    """The plant in current and drift. Raises :class:`ConfigurationError` for a sea that is too rough for her."""
    try:
        return apply_effects(plant, environment, catalogue)
    except ConfigurationError as error:
        raise ConfigurationError(
            f"sea state {sea.name or 'given'} is too rough for a ship of "
            f"{plant.length_between_perpendiculars_m:g} m",
            why=str(error), fix="choose calm, or write one with waves of suitable size",
        ) from error  # fmt: skip


def sail_through(
    vessel: Vessel,
    plant: Plant,
    sea: SeaState,
    legs: Manoeuvre,
    steps: int,
    dt_s: float,
    heading_deg: float,
    gusts: np.random.Generator,
    drift: np.random.Generator,
    drives: Drives | None = None,
) -> Voyage:
    """The motion of ``plant`` through a manoeuvre, with the autopilot of ``vessel``, and its drives or others."""
    wind = wind_series(gusts, sea, steps + 1, dt_s)
    wind[:, 0] += plant.wind_direction_bias_rad
    wind[:, 1] *= plant.wind_speed_factor
    slow_n = plant.drift_force_n * drift_series(drift, sea, steps + 1, dt_s)
    (leg_array, ends), packed = as_arrays(legs, vessel), pack(plant)
    extra, parameters = combine_forces((plant,))
    start = _start(vessel, plant, legs[0], heading_deg)
    states, controls = np.full((steps + 1, 6), np.nan), np.full((steps + 1, leg_array.shape[1]), np.nan)
    left = sail(
        packed[0], start, leg_array, ends, drives or drives_of(vessel), wind[:-1], slow_n, dt_s, 1, extra,
        parameters[0], states, controls,
    )  # fmt: skip
    if left >= 0:
        raise range_error(Runs(states[np.newaxis], np.array([left])), plant, dt_s)
    return Voyage(
        states, acting_controls(controls, -plant.command_delay_s, dt_s, angle_columns(vessel.actuators)), wind
    )


def record_trial(
    table: pd.DataFrame, truth: Mapping[str, Any], path: Path, place: str = "simulated", **known: Any
) -> None:
    """Write a simulated trial as a recording, and beside it what was hidden, with what else is ``known`` of it.

    The truth comes last and marks the recording as complete. Raises :class:`StorageError`.
    """
    latitude_deg, longitude_deg = ORIGIN_DEG
    sheet = Trial(
        name=printable_name(path.stem),
        vessel=truth["vessel"],
        actuators=as_text(truth["plant"].layout),
        place=place,
        origin_latitude_deg=latitude_deg,
        origin_longitude_deg=longitude_deg,
        sea_state=truth["sea_state"]["name"],
        crew_notes=f"simulated {truth['manoeuvre']}",
        antenna_forward_m=0.0,
        antenna_starboard_m=0.0,
    )
    truth_path = path.with_suffix(".truth.json")
    with written_together(truth_path):
        write_table(table, path, sheet, source="simulated")
        write_truth({**truth, **known}, truth_path)


def write_truth(truth: Mapping[str, Any], path: str | Path) -> None:
    """Write what was hidden as JSON, without the arrays. Raises :class:`StorageError`."""
    plain = {key: value for key, value in truth.items() if not isinstance(value, np.ndarray | Plant)}
    text = json.dumps({**plain, "software_version": software_version()}, indent=2)
    write_text(path, text + "\n")


def _timing(duration_s: float, rate_hz: float) -> tuple[int, int]:
    """Steps of the simulation per recorded row, and the number of rows."""
    if not 0.0 < rate_hz <= 100.0:
        raise ConfigurationError(f"rate {rate_hz:g} Hz is out of bounds", fix="give 0.1 to 100 Hz")
    if not duration_s <= _LONGEST_S:
        raise ConfigurationError(f"duration {duration_s:g} s is out of bounds", fix="give a week at most")
    rows = round(duration_s * rate_hz)
    if rows < 2:
        raise ConfigurationError(f"duration {duration_s:g} s gives no samples", fix="give a longer duration")
    return max(1, ceil(SLOWEST_LOOP_HZ / rate_hz - 1e-9)), rows


def _start(vessel: Vessel, plant: Plant, leg: Leg, heading_deg: float) -> Floats:
    """At the origin, on the first heading, at the speed that the first leg's shafts hold in still water."""
    order = handling_of(vessel).orders(shafts_rpm(leg, vessel), 0.0) * control_units(vessel.actuators)
    steady_mps = steady_speed_mps(bare_plant(vessel), order)
    heading = np.deg2rad(heading_deg)
    ahead, aside = to_ship(plant.current_north_mps, plant.current_east_mps, heading)
    return np.array([0.0, 0.0, heading, steady_mps + ahead, aside, 0.0])
