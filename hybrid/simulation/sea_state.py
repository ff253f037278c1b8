"""Sea states of simulated trials: wind, waves and current, read from ``trials/sea_states.toml``, and as time
series.

Wind and the waves' slow force are exact discrete Ornstein-Uhlenbeck processes. Such a process has the Dryden
spectrum of a longitudinal gust, 2 s^2 T / pi / (1 + (T w)^2), with T the length scale over the mean wind. Two of
them in quadrature have an exponentially distributed squared envelope, as waves in groups do, and the drift force
follows the squared envelope.

The first-order wave motion of the ship is added to what the sensors measure: a long-crested sea with a JONSWAP
spectrum. The responses are simple on purpose and have no resonance: in surge, sway and yaw the ship follows the
water's orbital motion, averaged along her length and draught. With the wave's phase a = k x - w t + e at amidships,
wave number k, b the angle from the bow to where the waves go and q = k L cos(b) / 2:

- displacement in the waves' direction: -A sin(a) sin(q)/q (1 - exp(-k T)) / (k T)
- yaw: -A cos(a) sin(b) (6/L) (sin(q)/q^2 - cos(q)/q) (1 - exp(-k T)) / (k T)
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

from seatrial.acquisition.config.toml_file import load_toml
from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.acquisition.core.quantities import Floats, to_ship
from seatrial.hybrid.vessel.parameters import Dimensions
from seatrial.hybrid.vessel.plant import Plant
from seatrial.hybrid.vessel.sensors import pose_rate

SEA_STATES = Path(__file__).parents[2] / "trials" / "sea_states.toml"


LENGTH_M = 28.9
"""The length of the ship that drift forces are stated for [m]; her model's sea is at the scale of the two."""


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

    def at_scale(self, scale: float) -> SeaState:
        """This sea in a basin: lengths times ``scale``, speeds and times its root, as at the same Froude number.

        Drift forces then go with its third power of themselves: see :meth:`effects`.
        """
        root = scale**0.5
        return replace(
            self, wind_mps=self.wind_mps * root, wave_height_m=self.wave_height_m * scale,
            wave_period_s=self.wave_period_s * root, current_mps=self.current_mps * root,
            group_s=self.group_s * root, gust_length_m=self.gust_length_m * scale,
            name=f"{self.name} at 1:{1.0 / scale:.3g}",
        )  # fmt: skip

    @property
    def direction_to_deg(self) -> float:
        """Where wind, waves and current go to [deg]."""
        return (self.direction_from_deg + 180.0) % 360.0

    @property
    def drift_n(self) -> float:
        """Mean wave drift force in beam sea on a ship of 28.9 m [N]."""
        return self.drift_n_per_m2 * self.wave_height_m**2

    def effects(self, length_m: float = LENGTH_M) -> dict[str, dict[str, float]]:
        """The sea state's steady parts as effects of the catalogue, for a ship of this length.

        The drift goes with the length over which the waves meet the ship (Maruo 1960).
        """
        current = {"speed_mps": self.current_mps, "direction_deg": self.direction_to_deg}
        drift = {"force_n": self.drift_n * (length_m / LENGTH_M), "direction_deg": self.direction_to_deg}
        return {"ocean_current": current, "wave_drift": drift}


SeaState.__pydantic_config__ = {"extra": "forbid"}  # type: ignore[attr-defined]


def sea_states(path: str | Path = SEA_STATES) -> dict[str, SeaState]:
    """All sea states of a file by name. Raises :class:`ConfigurationError` naming file, line and key."""
    states = load_toml(path, dict[str, SeaState])
    return {name: replace(state, name=name) for name, state in states.items()}


def sea_state_named(name: str) -> SeaState:
    """One of the sea states that come with Seatrial."""
    known = sea_states()
    if name not in known:
        raise ConfigurationError(f"no sea state {name!r}", fix=f"use one of {', '.join(known)}")
    return known[name]


def sea_for(name: str, ship: Dimensions) -> SeaState:
    """A sea state as a ship meets it: for her model at the model's scale, for a ship what it is."""
    sea = sea_state_named(name)
    if not ship.is_model or sea.wind_mps == sea.wave_height_m == sea.current_mps == 0.0:
        return sea
    return sea.at_scale(ship.length_between_perpendiculars_m / LENGTH_M)


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
    along, across = (
        sea.gust_intensity * sea.wind_mps * ornstein_uhlenbeck(generator, steps, dt_s, correlation_s)
        for _ in range(2)
    )
    direction = np.deg2rad(sea.direction_from_deg) + np.arctan2(across, sea.wind_mps + along)
    return np.column_stack([direction, np.hypot(sea.wind_mps + along, across)])


def drift_series(generator: np.random.Generator, sea: SeaState, steps: int, dt_s: float) -> Floats:
    """The wave drift force over its mean, never negative and one on average: [steps]."""
    if sea.wave_height_m == 0.0:
        return np.ones(steps)
    cosine, sine = (ornstein_uhlenbeck(generator, steps, dt_s, sea.group_s) for _ in range(2))
    return np.asarray(0.5 * (cosine**2 + sine**2))


GRAVITY_MPS2 = 9.81
PEAKEDNESS = 3.3
COMPONENTS = 50
_HALF_STEP_S = 0.002
_ROWS = 4096  # worked through at a time, to keep memory small


def jonswap(frequency_radps: Floats, wave_height_m: float, peak_period_s: float) -> Floats:
    """The JONSWAP spectrum [m2 s/rad] at evenly spaced frequencies, of area (wave height / 4)^2 over them.

    Hasselmann et al., Measurements of wind-wave growth (1973), with the mean peakedness of 3.3.
    """
    peak = 2.0 * np.pi / peak_period_s
    width = np.where(frequency_radps <= peak, 0.07, 0.09)
    raised = PEAKEDNESS ** np.exp(-0.5 * ((frequency_radps / peak - 1.0) / width) ** 2)
    shape = frequency_radps**-5.0 * np.exp(-1.25 * (peak / frequency_radps) ** 4) * raised
    area = shape.sum() * (frequency_radps[1] - frequency_radps[0])
    return np.asarray(shape * (wave_height_m / 4.0) ** 2 / area)


def wave_motion(generator: np.random.Generator, sea: SeaState, plant: Plant, states: Floats, dt_s: float) -> Floats:
    """Displacement north and east [m] and yaw [rad] by waves at each of ``states``, and their rates: [rows, 6].

    ``states`` [rows, 6] are without waves. The rates are differences over 4 ms, the ship going on as she goes:
    over the steps of a simulation they would come out too small by some percent.
    """
    phases = generator.uniform(0.0, 2.0 * np.pi, COMPONENTS)
    jitter = generator.uniform(-0.5, 0.5, COMPONENTS)
    if sea.wave_height_m == 0.0:
        return np.zeros((len(states), 6))
    peak = 2.0 * np.pi / sea.wave_period_s
    even = np.linspace(0.6 * peak, 2.6 * peak, COMPONENTS)
    spacing = even[1] - even[0]
    amplitude = np.sqrt(2.0 * jonswap(even, sea.wave_height_m, sea.wave_period_s) * spacing)
    frequency = even + jitter * spacing  # uneven, so that the sea does not repeat itself
    times = np.arange(len(states), dtype=np.float64) * dt_s
    pose, velocity = states[:, :3], pose_rate(states)
    result = np.empty((len(states), 6))
    for first in range(0, len(states), _ROWS):
        rows = slice(first, first + _ROWS)
        before, after = (
            _motion(times[rows] + h, pose[rows] + h * velocity[rows], sea, plant, amplitude, frequency, phases)
            for h in (-_HALF_STEP_S, _HALF_STEP_S)
        )
        result[rows] = np.hstack([0.5 * (before + after), (after - before) / (2.0 * _HALF_STEP_S)])
    return result


def with_waves(states: Floats, motion: Floats) -> Floats:
    """States [rows, 6] with a wave motion and its rates [rows, 6] in position, heading and all speeds."""
    moved = states.copy()
    moved[:, :3] += motion[:, :3]
    north, east, turning = (pose_rate(states) + motion[:, 3:]).T
    moved[:, 3], moved[:, 4] = to_ship(north, east, moved[:, 2])
    moved[:, 5] = turning
    return moved


def _motion(
    times_s: Floats, pose: Floats, sea: SeaState, plant: Plant, amplitude: Floats, frequency: Floats, phases: Floats
) -> Floats:
    number = frequency**2 / GRAVITY_MPS2
    to_rad, length = np.deg2rad(sea.direction_to_deg), plant.length_overall_m
    along = pose[:, 0] * np.cos(to_rad) + pose[:, 1] * np.sin(to_rad)
    b = to_rad - pose[:, 2]
    phase = np.outer(along, number) - np.outer(times_s, frequency) + phases
    q = 0.5 * length * np.outer(np.cos(b), number)
    depth = (1.0 - np.exp(-number * plant.draught_m)) / (number * plant.draught_m)
    shift = -(np.sin(phase) * np.sinc(q / np.pi)) @ (amplitude * depth)
    turn = -(np.cos(phase) * _turning(q)) @ (amplitude * depth) * np.sin(b) * 6.0 / length
    return np.column_stack([shift * np.cos(to_rad), shift * np.sin(to_rad), turn])


def _turning(q: Floats) -> Floats:
    """sin(q)/q^2 - cos(q)/q, which is q/3 near zero."""
    small = np.abs(q) < 1e-3
    safe = np.where(small, 1.0, q)
    return np.where(small, q / 3.0, np.sin(safe) / safe**2 - np.cos(safe) / safe)
