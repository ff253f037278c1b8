"""The plant: everything that one simulated run needs, as one flat set of named numbers.

A vessel file becomes a :class:`Plant`; effects turn one plant into another; the compiled core sees the plant
packed into a numpy record, whose fields it reads by the same names. This is the one place where named
objects become arrays. Besides the vessel's own numbers a plant has slots for everything the effects of the
catalogue touch; their defaults are neutral and switch them off exactly.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from operator import attrgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from acquisition.core.arrays import Floats
from acquisition.core.errors import ConfigurationError
from hybrid.vessel.parameters import Surge, Sway, Vessel, Yaw
from hybrid.vessel.wind import TABLE_SIZE

ForceFunction = Callable[..., tuple[float, float, float]]
"""``force(time_s, state, control, environment, parameters) -> X [N], Y [N], N [N m]``; see simulate.py."""


@dataclass(frozen=True, slots=True)
class ExtraForce:
    """A force that no slot of the plant expresses: a function for numba, and its parameters."""

    function: ForceFunction
    parameters: tuple[float, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Plant:
    """One run's numbers, SI and radians; the hull's coefficients carry their own names."""

    # dimensions and range
    length_overall_m: float
    length_between_perpendiculars_m: float
    beam_m: float
    draught_m: float
    water_density_kgpm3: float
    surge_low_mps: float
    surge_high_mps: float
    sway_limit_mps: float
    yaw_rate_limit_radps: float
    # rigid body and added mass
    mass_kg: float
    yaw_inertia_kgm2: float
    Xud: float
    Yvd: float
    Yrd: float
    Nrd: float
    # hull
    Xuu: float
    Xvv: float
    Xrr: float
    Xrv: float
    Xuvv: float
    Xrvu: float
    Xurr: float
    Xu_absv: float
    Yuv: float
    Yur: float
    Yuur: float
    Yuuv: float
    Yvvv: float
    Yrrr: float
    Yrrv: float
    Yvvr: float
    Y_absr_v: float
    Y_absv_v: float
    Y_absr_r: float
    Y_absv_r: float
    Nuv: float
    Nur: float
    Nuur: float
    Nuuv: float
    Nvvv: float
    Nrrr: float
    Nrrv: float
    Nvvr: float
    N_absr_v: float
    N_absv_v: float
    N_absr_r: float
    N_absv_r: float
    # pods and tunnel thruster
    port_x_m: float
    port_y_m: float
    starboard_x_m: float
    starboard_y_m: float
    propeller_diameter_m: float
    thrust_nn: float
    thrust_nu: float
    thrust_uu: float
    side_nv: float
    side_uv: float
    side_vv: float
    tunnel_x_m: float
    tunnel_cubic_n: float
    tunnel_quadratic_n: float
    tunnel_linear_n: float
    # wind
    frontal_area_m2: float
    lateral_area_m2: float
    air_density_kgpm3: float
    CX: tuple[float, ...]
    CY: tuple[float, ...]
    CN: tuple[float, ...]
    # slots of effects, neutral: propulsion
    port_thrust_loss: float = 0.0
    starboard_thrust_loss: float = 0.0
    port_angle_offset_rad: float = 0.0
    starboard_angle_offset_rad: float = 0.0
    azimuth_scale: float = 1.0
    thruster_lag_s: float = 0.0
    command_delay_s: float = 0.0
    # slots of effects, neutral: environment and constant forces
    wind_load_factor: float = 1.0
    current_north_mps: float = 0.0
    current_east_mps: float = 0.0
    drift_force_n: float = 0.0
    drift_north: float = 1.0
    drift_east: float = 0.0
    constant_X_n: float = 0.0
    constant_Y_n: float = 0.0
    constant_N_nm: float = 0.0
    # slots of effects, neutral: sensors (reported = factor x true, or true + bias)
    wind_direction_bias_rad: float = 0.0
    wind_speed_factor: float = 1.0
    heading_bias_rad: float = 0.0
    antenna_forward_m: float = 0.0
    antenna_starboard_m: float = 0.0
    position_delay_s: float = 0.0
    heading_delay_s: float = 0.0
    speed_delay_s: float = 0.0
    speed_scale: float = 1.0
    speed_sensor_forward_m: float = 0.0
    speed_sensor_starboard_m: float = 0.0
    speed_sensor_angle_rad: float = 0.0
    sway_bias_mps: float = 0.0
    yaw_rate_scale: float = 1.0
    yaw_rate_bias_radps: float = 0.0
    # forces that no slot expresses
    forces: tuple[ExtraForce, ...] = ()

    def scaled(self, factor: float, *names: str) -> Plant:
        """This plant with the named numbers, or tables, multiplied by ``factor``."""
        return replace(self, **{name: _times(getattr(self, name), factor) for name in names})

    def shifted(self, **amounts: float) -> Plant:
        """This plant with each amount added to the number of its name."""
        return replace(self, **{name: getattr(self, name) + amount for name, amount in amounts.items()})

    def with_force(self, function: ForceFunction, *parameters: float) -> Plant:
        """This plant with one more force that the simulator adds up."""
        return replace(self, forces=(*self.forces, ExtraForce(function, parameters)))


def _times(value: float | tuple[float, ...], factor: float) -> Any:
    return tuple(factor * each for each in value) if isinstance(value, tuple) else value * factor


NUMBERS: tuple[str, ...] = tuple(field.name for field in fields(Plant) if field.name != "forces")
"""The names of a plant's numbers, in their order in :data:`DTYPE`."""

_NUMBERS_OF = attrgetter(*NUMBERS)

TABLES = ("CX", "CY", "CN")
DTYPE = np.dtype([(name, np.float64, (TABLE_SIZE,) if name in TABLES else ()) for name in NUMBERS])
"""The record that a plant is packed into: float64 throughout, so :func:`flat` is a view."""

HULL: tuple[str, ...] = tuple(field.name for part in (Surge, Sway, Yaw) for field in fields(part))
"""The names of the hull's coefficients, without the added masses."""


def bare_plant(vessel: Vessel) -> Plant:
    """The plant of a vessel *without* the effects its file may add; those: ``effects.vessel_plant``."""
    values: dict[str, Any] = {"water_density_kgpm3": vessel.water_density_kgpm3}
    for part in (vessel.dimensions, vessel.inertia, vessel.surge, vessel.sway, vessel.yaw, vessel.wind):
        values |= {field.name: getattr(part, field.name) for field in fields(part)}
    renamed = {"diameter_m": "propeller_diameter_m"}
    for field in fields(vessel.pods):
        name = renamed.get(field.name, field.name)
        if name in NUMBERS:
            values[name] = getattr(vessel.pods, field.name)
    for name in ("x_m", "cubic_n", "quadratic_n", "linear_n"):
        values[f"tunnel_{name}"] = getattr(vessel.tunnel, name)
    limits = vessel.validity
    return Plant(
        **values,
        surge_low_mps=limits.surge_low_mps,
        surge_high_mps=limits.surge_high_mps,
        sway_limit_mps=limits.sway_mps,
        yaw_rate_limit_radps=limits.yaw_rate_radps,
    )


Plants = Plant | Sequence[Plant] | NDArray[np.void]
"""One plant, one a run, or thousands already packed: an array [P] of :data:`DTYPE`, made without objects."""


def pack(plants: Plants) -> NDArray[np.void]:
    """Plants as a record array [P] of :data:`DTYPE`; their extra forces are not in it.

    An array that is packed already comes back as it is. Raises :class:`ConfigurationError` for another
    array, and where there is no plant.
    """
    if isinstance(plants, Plant):
        return np.array([_NUMBERS_OF(plants)], dtype=DTYPE)
    if len(plants) == 0:
        raise ConfigurationError("no plant to simulate", fix="give one plant, or one for each run")
    if not isinstance(plants, np.ndarray):
        return np.array([*map(_NUMBERS_OF, plants)], dtype=DTYPE)
    if plants.dtype != DTYPE or plants.ndim != 1:
        raise ConfigurationError(
            f"packed plants are an array of {plants.dtype.name} with shape {plants.shape}",
            fix="make it with plant.pack, or with np.empty(N, plant.DTYPE) and fill every field",
        )
    return np.ascontiguousarray(plants)


def flat(packed: NDArray[np.void]) -> Floats:
    """Packed plants as plain numbers, [P, numbers]; a view."""
    return packed.view(np.float64).reshape(len(packed), -1)
