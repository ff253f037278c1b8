"""Simulated trials: a ship with hidden effects in a sea state, as its sensors record it, singly and as a campaign.

One seed has separate random streams for waves, gusts, drift and sensors, so that a change to one leaves the others
as they were. Sea states are read from ``trials/sea_states.toml``. Wind and the waves' slow force are exact discrete
Ornstein-Uhlenbeck processes. Such a process has the Dryden spectrum of a longitudinal gust,
2 s^2 T / pi / (1 + (T w)^2), with T the length scale over the mean wind. Two of them in quadrature have an
exponentially distributed squared envelope, as waves in groups do, and the drift force follows the squared envelope.

The first-order wave motion of the ship is added to what the sensors measure: a long-crested sea with a JONSWAP
spectrum. The responses are simple on purpose and have no resonance: in surge, sway and yaw the ship follows the
water's orbital motion, averaged along its length and draught. With the wave's phase a = k x - w t + e at amidships,
wave number k, b the angle from the bow to where the waves go and q = k L cos(b) / 2:

- displacement in the waves' direction: -A sin(a) sin(q)/q (1 - exp(-k T)) / (k T)
- yaw: -A cos(a) sin(b) (6/L) (sin(q)/q^2 - cos(q)/q) (1 - exp(-k T)) / (k T)

A campaign simulates every vessel in every sea state, manoeuvre and seed on the worker processes of
:mod:`seatrial.analysis.batch`.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from hashlib import sha256
from itertools import product
from math import ceil, isfinite
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.signal import lfilter

from seatrial.acquisition.core.errors import ConfigurationError, Progress, printable_path
from seatrial.acquisition.core.files import atomic_file, load_toml, read_json, write_text, written_together
from seatrial.acquisition.core.process import announce
from seatrial.acquisition.core.quantities import GRAVITY_MPS2, Floats, rotate_earth_to_ship
from seatrial.acquisition.core.ship import Actuators, actuators_as_text
from seatrial.acquisition.core.trial import Trial, software_version
from seatrial.acquisition.recording.writer import write_table
from seatrial.analysis import batch
from seatrial.analysis.products import Options
from seatrial.analysis.tables.table import sha256_of
from seatrial.hybrid.effects import Catalogue, apply_effects, effect_named, vessel_plant
from seatrial.hybrid.effects.simulators import simulator_of
from seatrial.hybrid.simulation import manoeuvres
from seatrial.hybrid.simulation.manoeuvres import HandledShip
from seatrial.hybrid.vessel import dynamics, effect, files, sensors
from seatrial.hybrid.vessel.actuators import PLAY, angle_columns, control_units
from seatrial.hybrid.vessel.black_box import BlackBox, inside_error
from seatrial.hybrid.vessel.plant import Plant, bare_plant, pack

START = pd.Timestamp("2026-06-01T08:00:00Z")
ORIGIN_DEG = (63.44, 10.40)
"""Latitude and longitude that simulated trials start from."""
SLOWEST_LOOP_HZ = 10.0
Hidden = Mapping[str, Mapping[str, float]]
_LONGEST_S = 7 * 86400.0
SEA_STATES = Path(__file__).parents[2] / "trials" / "sea_states.toml"
LENGTH_M = 28.9
"""The length of the ship that drift forces are stated for [m]; its model's sea is at the scale of the two."""
PEAKEDNESS = 3.3
COMPONENTS = 50
_HALF_STEP_S = 0.002
_ROWS = 4096  # worked through at a time, to keep memory small
INDEX = "campaign.csv"
OCEAN_CURRENT = "ocean_current"
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
    usual, scale = SimulationNoise(), min(effect.scale_of(length_m), 1.0)
    return replace(
        usual,
        position_m=usual.position_m * effect.froude_growth("m", scale),
        speed_mps=usual.speed_mps * effect.froude_growth("m/s", scale),
        wind_speed_mps=usual.wind_speed_mps * effect.froude_growth("m/s", scale),
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
    vessel: HandledShip | str | Path | None = None,
    sea_state: SeaState | str = "calm",
    manoeuvre: manoeuvres.Manoeuvre | str = "voyage",
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
    range of its model. A sea state by name is at the scale of a ship's model, one that is given is as it is.
    """
    ship = handled_ship(vessel)
    sea = sea_state_for_ship(sea_state, ship.dimensions) if isinstance(sea_state, str) else sea_state
    legs = manoeuvre
    if isinstance(legs, str):
        legs = manoeuvres.scale_to_ship(manoeuvres.manoeuvre_named(legs, ship.actuators), ship)
    steps_per_row, rows = _steps_and_substeps(duration_s, rate_hz)
    streams = [np.random.default_rng(sequence) for sequence in np.random.SeedSequence(seed).spawn(4)]
    environment = sea.steady_effects(ship.dimensions.length_between_perpendiculars_m)
    plant = _plant_of_trial(ship, sea, environment, hidden or {}, catalogue)
    dt_s = 1.0 / (rate_hz * steps_per_row)
    voyage = sail_through(
        ship, plant, sea, legs, (rows - 1) * steps_per_row, dt_s, heading_deg, streams[0], streams[1]
    )
    hull = ship.dimensions if isinstance(ship, BlackBox) else plant  # with what effects make of its length
    moving = add_wave_motion(voyage.states, wave_motion(streams[2], sea, hull, voyage.states, dt_s))
    stride = slice(None, None, steps_per_row)
    reported = sensors.measure(moving, plant, dt_s)[stride]
    noise = noise or usual_noise(ship.dimensions.length_between_perpendiculars_m)
    recorded = add_noise(streams[3], noise, reported, voyage.controls[stride], voyage.wind[stride], ship.actuators)
    index = start_time + pd.to_timedelta(np.round(np.arange(rows) / rate_hz * 1e9).astype("int64"), unit="ns")
    table = sensors.states_as_table(*recorded, index=pd.DatetimeIndex(index, name="time"), actuators=ship.actuators)
    actuators = actuators_as_text(ship.actuators)
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
        "noise": asdict(noise),
        "states": voyage.states[stride],
        "controls": voyage.controls[stride],
        "wind": voyage.wind[stride],
        "plant": ship if isinstance(ship, BlackBox) else plant,
    }
    return table, truth


def _plant_of_trial(
    ship: HandledShip, sea: SeaState, environment: Hidden, hidden: Hidden, catalogue: Catalogue | None
) -> Plant:
    """The plant of a simulated ship in a sea, with what is hidden; of a simulator one that has its surroundings and
    sensors only.

    Raises :class:`ConfigurationError` for a sea that is too rough, and for effects that act inside a simulator.
    """
    if isinstance(ship, BlackBox):
        inside = [
            name for name in hidden if name != OCEAN_CURRENT and effect_named(name, catalogue).kind != "sensor"
        ]
        if inside:
            raise inside_error(
                ship, f"{inside[0]} would have to act in it; hide effects of sensors, or {OCEAN_CURRENT}"
            )
        if environment["wave_drift"]["force_n"]:
            announce("the mean force of the waves is left out: a simulator takes none")
        return apply_effects(
            bare_plant(files.load_vessel()), {OCEAN_CURRENT: environment[OCEAN_CURRENT], **hidden}, catalogue
        )
    plant = vessel_plant(ship, catalogue)
    try:
        plant = apply_effects(plant, environment, catalogue)
    except ConfigurationError as error:
        raise ConfigurationError(
            f"sea state {sea.name or 'given'} is too rough for a ship of "
            f"{plant.length_between_perpendiculars_m:g} m",
            why=str(error), fix="choose calm, or write one with waves of suitable size",
        ) from error  # fmt: skip
    return apply_effects(plant, hidden, catalogue)


def sail_through(
    vessel: HandledShip,
    plant: Plant,
    sea: SeaState,
    legs: manoeuvres.Manoeuvre,
    steps: int,
    dt_s: float,
    heading_deg: float,
    gusts: np.random.Generator,
    drift: np.random.Generator,
    drives: manoeuvres.Drives | None = None,
    *,
    repeat: bool = True,
) -> Voyage:
    """The motion of ``plant`` through a manoeuvre, with the autopilot of ``vessel``, and its drives or others.

    It has so many ``steps``; without ``repeat`` it ends with the manoeuvre, if that comes first.
    """
    true_wind = wind_series(gusts, sea, steps + 1, dt_s)
    wind = true_wind.copy()
    wind[:, 0] += plant.wind_direction_bias_rad
    wind[:, 1] *= plant.wind_speed_factor
    slow_n = plant.drift_force_n * drift_series(drift, sea, steps + 1, dt_s)
    (leg_array, ends), packed = manoeuvres.legs_as_arrays(legs, vessel), pack(plant)
    extra, parameters = dynamics.combine_forces((plant,))
    rpm = manoeuvres.shafts_rpm(legs[0], vessel)
    order = manoeuvres.handling_of(vessel).orders(rpm, 0.0) * control_units(vessel.actuators)
    steady_mps, heading = manoeuvres.steady_speed_mps(manoeuvres.bare_model(vessel), order), np.deg2rad(heading_deg)
    ahead, starboard = rotate_earth_to_ship(plant.current_north_mps, plant.current_east_mps, heading)
    start = np.array([0.0, 0.0, heading, steady_mps + ahead, starboard, 0.0])  # at the steady speed in still water
    drives = drives or manoeuvres.drives_of(vessel)
    late = partial(
        sensors.acting_controls, delay_s=-plant.command_delay_s, dt_s=dt_s, angles=angle_columns(vessel.actuators)
    )
    if isinstance(vessel, BlackBox):
        if slow := [name for name in vessel.numbers if name.endswith(("_lag_s", "_delay_s", PLAY))]:
            announce(f"{', '.join(slow)} of the simulator's file are left out: its drives follow as they state")
        model = vessel.shifted(current_north_mps=plant.current_north_mps, current_east_mps=plant.current_east_mps)
        states, controls = manoeuvres.sail_black_box(
            model, start, leg_array, ends, drives, true_wind[:-1], dt_s, repeat=repeat
        )
        rows = np.isfinite(states[:, 0])
        return Voyage(states[rows], late(controls[rows]), wind[rows])
    states, controls = np.full((steps + 1, 6), np.nan), np.full((steps + 1, leg_array.shape[1]), np.nan)
    failed_step = manoeuvres.sail(
        packed[0],
        start,
        leg_array,
        ends,
        drives,
        wind[:-1],
        slow_n,
        dt_s,
        1,
        extra,
        parameters[0],
        repeat,
        states,
        controls,
    )
    if failed_step >= 0:
        raise dynamics.range_error(dynamics.Runs(states[np.newaxis], np.array([failed_step])), plant, dt_s)
    rows = np.isfinite(states[:, 0])
    return Voyage(states[rows], late(controls[rows]), wind[rows])


def handled_ship(vessel: HandledShip | str | Path | None) -> HandledShip:
    """The vessel of a name or file, or the simulator. Raises :class:`ConfigurationError` for what is neither."""
    simulator = simulator_of(vessel)
    return files.load_vessel(vessel) if simulator is None else simulator  # type: ignore[arg-type]


def record_trial(
    table: pd.DataFrame, truth: Mapping[str, Any], path: Path, place: str = "simulated", **details: Any
) -> None:
    """Write a simulated trial as a recording, and beside it what was hidden, with further ``details``.

    The truth comes last and marks the recording as complete. Raises :class:`StorageError`.
    """
    latitude_deg, longitude_deg = ORIGIN_DEG
    sheet = Trial(
        name=printable_path(path.stem),
        vessel=truth["vessel"],
        actuators=actuators_as_text(truth["plant"].layout),
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
        plain = {key: value for key, value in truth.items() if not isinstance(value, np.ndarray | Plant | BlackBox)}
        text = json.dumps({**plain, **details, "software_version": software_version()}, indent=2)
        write_text(truth_path, text + "\n")


def _steps_and_substeps(duration_s: float, rate_hz: float) -> tuple[int, int]:
    """Steps of the simulation per recorded row, and the number of rows."""
    if not 0.0 < rate_hz <= 100.0:
        raise ConfigurationError(f"rate {rate_hz:g} Hz is out of bounds", fix="give 0.1 to 100 Hz")
    if not duration_s <= _LONGEST_S:
        raise ConfigurationError(f"duration {duration_s:g} s is out of bounds", fix="give a week at most")
    rows = round(duration_s * rate_hz)
    if rows < 2:
        raise ConfigurationError(f"duration {duration_s:g} s gives no samples", fix="give a longer duration")
    return max(1, ceil(SLOWEST_LOOP_HZ / rate_hz - 1e-9)), rows


@dataclass(frozen=True, slots=True)
class SeaState:
    """Wind, waves and current from one direction.

    Significant wave height and peak period describe a JONSWAP spectrum. ``drift_n_per_m2`` is the mean
    second-order force in beam sea over the square of the wave height, on a ship of 28.9 m; slow drift follows the
    wave groups with ``group_s``. Gusts have a standard deviation of ``gust_intensity`` of the mean wind, along and
    across it, and a length scale. Numbers that have a value here are assumptions: the paper's Table II states none
    of them.
    """

    wind_mps: float
    wave_height_m: float
    wave_period_s: float
    current_mps: float
    direction_from_deg: float = 30.0
    drift_n_per_m2: float = 1000.0
    group_s: float = 25.0
    gust_intensity: float = 0.1
    gust_length_m: float = 100.0
    name: str = ""

    @property
    def direction_to_deg(self) -> float:
        """Where wind, waves and current go to [deg]."""
        return (self.direction_from_deg + 180.0) % 360.0

    def steady_effects(self, length_m: float = LENGTH_M) -> dict[str, dict[str, float]]:
        """The sea state's steady parts as effects of the catalogue, for a ship of this length.

        The drift goes with the length over which the waves meet the ship (Maruo 1960).
        """
        current = {"speed_mps": self.current_mps, "direction_deg": self.direction_to_deg}
        drift_n = self.drift_n_per_m2 * self.wave_height_m**2 * (length_m / LENGTH_M)
        drift = {"force_n": drift_n, "direction_deg": self.direction_to_deg}
        return {"ocean_current": current, "wave_drift": drift}


SeaState.__pydantic_config__ = {"extra": "forbid"}  # type: ignore[attr-defined]


def sea_states(path: str | Path = SEA_STATES) -> dict[str, SeaState]:
    """All sea states of a file by name. Raises :class:`ConfigurationError` naming file, line and key."""
    states = load_toml(path, dict[str, SeaState])
    return {name: replace(state, name=name) for name, state in states.items()}


def sea_state_named(name: str) -> SeaState:
    """One of the sea states that come with Seatrial."""
    states = sea_states()
    if name not in states:
        raise ConfigurationError(f"no sea state {name!r}", fix=f"use one of {', '.join(states)}")
    return states[name]


def sea_state_for_ship(name: str, ship: files.Dimensions) -> SeaState:
    """A sea state as a ship meets it: for a ship as it is, for its model in a basin at the model's scale.

    There lengths are times the scale, speeds and times its root, as at the same Froude number; drift forces then go
    with the third power of the scale of themselves (:meth:`SeaState.effects`).
    """
    sea = sea_state_named(name)
    if not ship.is_model or sea.wind_mps == sea.wave_height_m == sea.current_mps == 0.0:
        return sea
    scale = ship.length_between_perpendiculars_m / LENGTH_M
    root = scale**0.5
    return replace(
        sea, wind_mps=sea.wind_mps * root, wave_height_m=sea.wave_height_m * scale,
        wave_period_s=sea.wave_period_s * root, current_mps=sea.current_mps * root, group_s=sea.group_s * root,
        gust_length_m=sea.gust_length_m * scale, name=f"{sea.name} at 1:{1.0 / scale:.3g}",
    )  # fmt: skip


def ornstein_uhlenbeck(generator: np.random.Generator, steps: int, dt_s: float, time_constant_s: float) -> Floats:
    """A stationary process of zero mean and unit variance with that correlation time: [steps]."""
    kept = np.exp(-dt_s / time_constant_s)
    shocks = generator.standard_normal(steps)
    shocks[1:] *= np.sqrt(1.0 - kept**2)
    return np.asarray(lfilter([1.0], [1.0, -kept], shocks), dtype=np.float64)


def wind_series(generator: np.random.Generator, sea: SeaState, steps: int, dt_s: float) -> Floats:
    """Direction the wind comes from [rad] and its speed [m/s] with gusts along and across it: [steps, 2]."""
    if sea.wind_mps == 0.0:
        return np.tile([np.deg2rad(sea.direction_from_deg), 0.0], (steps, 1))
    correlation_s = sea.gust_length_m / sea.wind_mps
    along_mps, across_mps = (
        sea.gust_intensity * sea.wind_mps * ornstein_uhlenbeck(generator, steps, dt_s, correlation_s)
        for _ in range(2)
    )
    direction = np.deg2rad(sea.direction_from_deg) + np.arctan2(across_mps, sea.wind_mps + along_mps)
    return np.column_stack([direction, np.hypot(sea.wind_mps + along_mps, across_mps)])


def drift_series(generator: np.random.Generator, sea: SeaState, steps: int, dt_s: float) -> Floats:
    """The wave drift force over its mean, never negative and one on average: [steps]."""
    if sea.wave_height_m == 0.0:
        return np.ones(steps)
    cosine, sine = (ornstein_uhlenbeck(generator, steps, dt_s, sea.group_s) for _ in range(2))
    return np.asarray(0.5 * (cosine**2 + sine**2))


def jonswap_spectrum(frequency_radps: Floats, wave_height_m: float, peak_period_s: float) -> Floats:
    """The JONSWAP spectrum [m2 s/rad] at evenly spaced frequencies, of area (wave height / 4)^2 over them.

    Hasselmann et al., Measurements of wind-wave growth (1973), with the mean peakedness of 3.3.
    """
    peak = 2.0 * np.pi / peak_period_s
    width = np.where(frequency_radps <= peak, 0.07, 0.09)
    raised = PEAKEDNESS ** np.exp(-0.5 * ((frequency_radps / peak - 1.0) / width) ** 2)
    shape = frequency_radps**-5.0 * np.exp(-1.25 * (peak / frequency_radps) ** 4) * raised
    area = shape.sum() * (frequency_radps[1] - frequency_radps[0])
    return np.asarray(shape * (wave_height_m / 4.0) ** 2 / area)


def wave_motion(
    generator: np.random.Generator, sea: SeaState, ship: Plant | files.Dimensions, states: Floats, dt_s: float
) -> Floats:
    """Displacement north and east [m] and yaw [rad] by waves at each of ``states``, and their rates: [rows, 6].

    ``states`` [rows, 6] are without waves. The rates are differences over 4 ms, the ship going on as it goes:
    over the steps of a simulation they would come out too small by some percent.
    """
    phases = generator.uniform(0.0, 2.0 * np.pi, COMPONENTS)
    jitter = generator.uniform(-0.5, 0.5, COMPONENTS)
    if sea.wave_height_m == 0.0:
        return np.zeros((len(states), 6))
    if not isfinite(ship.draught_m):
        raise ConfigurationError(
            "the simulator states no draught, with which the ship moves in waves",
            fix="write draught_m with its length, or choose calm",
        )
    peak = 2.0 * np.pi / sea.wave_period_s
    even = np.linspace(0.6 * peak, 2.6 * peak, COMPONENTS)
    spacing = even[1] - even[0]
    amplitude = np.sqrt(2.0 * jonswap_spectrum(even, sea.wave_height_m, sea.wave_period_s) * spacing)
    frequency = even + jitter * spacing  # uneven, so that the sea does not repeat itself
    times = np.arange(len(states), dtype=np.float64) * dt_s
    pose, velocity = states[:, :3], sensors.pose_rate(states)
    result = np.empty((len(states), 6))
    for first in range(0, len(states), _ROWS):
        rows = slice(first, first + _ROWS)
        before, after = (
            _wave_motion_at(
                times[rows] + h, pose[rows] + h * velocity[rows], sea, ship, amplitude, frequency, phases
            )
            for h in (-_HALF_STEP_S, _HALF_STEP_S)
        )
        result[rows] = np.hstack([0.5 * (before + after), (after - before) / (2.0 * _HALF_STEP_S)])
    return result


def add_wave_motion(states: Floats, motion: Floats) -> Floats:
    """States [rows, 6] with a wave motion and its rates [rows, 6] in position, heading and all speeds."""
    moved = states.copy()
    moved[:, :3] += motion[:, :3]
    north, east, turning = (sensors.pose_rate(states) + motion[:, 3:]).T
    moved[:, 3], moved[:, 4] = rotate_earth_to_ship(north, east, moved[:, 2])
    moved[:, 5] = turning
    return moved


def _wave_motion_at(
    times_s: Floats,
    pose: Floats,
    sea: SeaState,
    ship: Plant | files.Dimensions,
    amplitude: Floats,
    frequency: Floats,
    phases: Floats,
) -> Floats:
    number = frequency**2 / GRAVITY_MPS2
    to_rad, length = np.deg2rad(sea.direction_to_deg), ship.length_overall_m
    along = pose[:, 0] * np.cos(to_rad) + pose[:, 1] * np.sin(to_rad)
    b = to_rad - pose[:, 2]
    phase = np.outer(along, number) - np.outer(times_s, frequency) + phases
    q = 0.5 * length * np.outer(np.cos(b), number)
    depth = (1.0 - np.exp(-number * ship.draught_m)) / (number * ship.draught_m)
    shift = -(np.sin(phase) * np.sinc(q / np.pi)) @ (amplitude * depth)
    small = np.abs(q) < 1e-3
    safe = np.where(small, 1.0, q)
    turning = np.where(small, q / 3.0, np.sin(safe) / safe**2 - np.cos(safe) / safe)  # q/3 near zero
    turn = -(np.cos(phase) * turning) @ (amplitude * depth) * np.sin(b) * 6.0 / length
    return np.column_stack([shift * np.cos(to_rad), shift * np.sin(to_rad), turn])


@dataclass(frozen=True, slots=True)
class Campaign:
    """Which trials to simulate: each vessel in each sea state, manoeuvre and seed.

    ``hidden`` are effects of the catalogue in all of the ships, and in no recording's metadata.
    """

    vessels: tuple[str, ...]
    sea_states: tuple[str, ...]
    manoeuvres: tuple[str, ...]
    seeds: tuple[int, ...] = (0,)
    duration_s: float = 1200.0
    rate_hz: float = 10.0
    heading_deg: float = 0.0
    hidden: dict[str, dict[str, float]] = field(default_factory=dict)
    noise: SimulationNoise = field(default_factory=SimulationNoise)


Campaign.__pydantic_config__ = {"extra": "forbid"}  # type: ignore[attr-defined]


@dataclass(frozen=True, slots=True)
class PlannedTrial:
    """One trial of a campaign, by names; ``vessel`` may be the path of a vessel file."""

    name: str
    vessel: str
    sea_state: str
    manoeuvre: str
    seed: int
    duration_s: float
    rate_hz: float
    heading_deg: float
    hidden: dict[str, dict[str, float]]
    noise: SimulationNoise


@dataclass(frozen=True, slots=True, kw_only=True)
class TrialJob(batch.BatchJob):
    """A planned trial for a worker; ``path`` is the recording that it becomes."""

    trial: PlannedTrial


@dataclass(frozen=True, slots=True)
class CampaignResult:
    """What a campaign came to: a row a trial, and the table of them. ``reused`` were there before."""

    rows: list[batch.Row]
    reused: int
    index: Path

    @property
    def failed(self) -> list[batch.Row]:
        """The rows of the trials that could not be simulated."""
        return [row for row in self.rows if row["status"] == "failed"]


def load_campaign(path: Path | str) -> Campaign:
    """A campaign from TOML. Raises :class:`ConfigurationError` naming file, line and key."""
    return load_toml(path, Campaign)


def planned_trials(campaign: Campaign) -> tuple[PlannedTrial, ...]:
    """The trials of a campaign, the seeds changing fastest.

    Raises :class:`ConfigurationError` for a vessel, sea state, manoeuvre or effect that does not exist, and
    where two trials would have one name.
    """
    for sea, manoeuvre in product(campaign.sea_states, campaign.manoeuvres):
        sea_state_named(sea), manoeuvres.manoeuvre_named(manoeuvre)
    for vessel in campaign.vessels:
        apply_effects(vessel_plant(files.load_vessel(vessel)), campaign.hidden)
    common = {name: getattr(campaign, name) for name in ("duration_s", "rate_hz", "heading_deg", "hidden", "noise")}
    trials = tuple(
        PlannedTrial(
            f"{Path(vessel).stem}-{sea}-{manoeuvre}-{seed:03d}",
            files.locate_vessel(vessel),
            sea,
            manoeuvre,
            seed,
            **common,
        )
        for vessel, sea, manoeuvre, seed in product(
            campaign.vessels, campaign.sea_states, campaign.manoeuvres, campaign.seeds
        )
    )
    duplicates = {trial.name for trial in trials if sum(trial.name == candidate.name for candidate in trials) > 1}
    if duplicates or not trials:
        raise ConfigurationError(
            f"would make {sorted(duplicates)[0]} twice" if duplicates else "has no trial",
            where="campaign",
            fix="name every vessel, sea state, manoeuvre and seed once, and one of each at least",
        )
    return trials


def run_campaign(
    campaign: Campaign,
    out: Path | str,
    workers: int | None = None,
    scheduler: str | None = None,
    progress: Progress = lambda share: None,
) -> CampaignResult:
    """Simulate a campaign into ``out``: NAME.mcap and NAME.truth.json a trial, and one table of them all.

    Trials that are there already, made by the same version from the same numbers, are not made again. With one
    worker everything happens in this process; ``workers`` and ``scheduler`` otherwise, and their errors, are
    those of :func:`seatrial.analysis.batch.run_batch`.
    """
    out = Path(out).resolve()
    batch.check_address(scheduler)
    jobs = [
        TrialJob(trial.name, str(out / f"{trial.name}.mcap"), str(out), Options(), trial=trial)
        for trial in planned_trials(campaign)
    ]
    with batch.lock_batch_folder(out):
        if workers == 1 and scheduler is None:
            rows = batch.map_calls([(simulate_job, job) for job in jobs], 1, progress)
        else:
            rows = batch.run_jobs(jobs, simulate_job, workers, scheduler, progress)
        index = out / INDEX
        reused = sum(row.pop("reused", False) for row in rows)
        columns = ("name", "vessel", "sea_state", "manoeuvre", "seed", "duration_s", "rate_hz")  # nothing hidden
        planned = [
            {name: getattr(job.trial, name) for name in columns} | {"recording": Path(job.path).name}
            for job in jobs
        ]
        with atomic_file(index) as partial:
            pd.DataFrame(planned).merge(pd.DataFrame(rows), on="name", how="left").to_csv(partial, index=False)
    return CampaignResult(rows, reused, index)


def simulate_job(job: batch.BatchJob) -> batch.Row:
    """What a worker does for one trial; a row comes back whatever happens."""
    return batch.run_job_or_fail(job, _simulate_and_write)


def _simulate_and_write(job: batch.BatchJob) -> batch.Row:
    """Simulate and write one trial; the truth comes last and marks it as complete."""
    assert isinstance(job, TrialJob)
    trial, recording = job.trial, Path(job.path)
    truth_path = recording.with_suffix(".truth.json")
    # A digest of everything that the trial depends on: the plan, the ship's and the sea's numbers, our version.
    ship, sea = asdict(files.load_vessel(trial.vessel)), asdict(sea_state_named(trial.sea_state))
    numbers = {**asdict(trial), "vessel": ship, "sea_state": sea, "software": software_version()}
    plan = sha256(json.dumps(numbers, sort_keys=True, default=str).encode()).hexdigest()
    stored_plan = None
    if recording.is_file():
        with suppress(OSError, ValueError, LookupError, TypeError):
            stored_plan = str(read_json(truth_path)["plan"])
    if stored_plan == plan:
        return {"status": "done", "cause": "", "sha256": sha256_of(recording), "reused": True}
    table, truth = simulate_trial(
        trial.vessel, trial.sea_state, trial.manoeuvre, trial.duration_s, trial.rate_hz, trial.seed, trial.hidden,
        noise=trial.noise, heading_deg=trial.heading_deg,
    )  # fmt: skip
    record_trial(table, truth, recording, plan=plan)
    return {"status": "done", "cause": "", "sha256": sha256_of(recording)}
