"""The plant: everything that one simulated run needs, as one flat set of named numbers.

A vessel file becomes a :class:`Plant`; effects turn one plant into another; the compiled core sees the plant
packed into a numpy record, whose fields it reads by the same names; its actuators are rows of a table in that
record, one each. This is the one place where named objects become arrays. Besides the vessel's own numbers a plant
has slots for everything the effects of the catalogue touch; their defaults are neutral and switch them off exactly.

An actuator's numbers have its name before theirs: ``port_x_m``. Those that describe a kind (``thrust_nn``) mean
all actuators of that kind where the name is not there. As plain numbers a plant can be written down, read back, and
distinguished by a hash.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import lru_cache, partial
from operator import add, mul
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.acquisition.core.quantities import Floats
from seatrial.acquisition.core.ship import Actuators
from seatrial.analysis.compiling import source_stamp
from seatrial.hybrid.vessel.actuators import (
    CODES,
    CONTROL,
    CONTROLS_OF,
    FIRST_NUMBER,
    IS_ANGLE,
    KIND,
    KINDS,
    ROW_SIZE,
)
from seatrial.hybrid.vessel.files import Vessel
from seatrial.hybrid.vessel.hulls import HULL_CODES, HULL_SIZE, HULLS
from seatrial.hybrid.vessel.hulls.kind import HullModel
from seatrial.hybrid.vessel.wind import TABLE_SIZE

PHYSICS_STAMP = source_stamp(Path(__file__).parent)
"""A digest of this package, on which every compiled simulation depends."""

ForceFunction = Callable[..., tuple[float, float, float]]
"""``force(time_s, state, control, environment, parameters) -> X [N], Y [N], N [N m]``, as :func:`.total_force`."""


@dataclass(frozen=True, slots=True)
class ExtraForce:
    """A force that no slot of the plant expresses: a function for numba, and its parameters."""

    function: ForceFunction
    parameters: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Form:
    """What a plant's numbers are called: the hull's model, and the names and kinds of the actuators.

    ``places`` tells where each number stands in a flat packed plant (:func:`number_places`).
    """

    hull: str
    actuators: Actuators
    places: Mapping[str, tuple[int, ...]] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Look up where each number stands in a packed plant once, not whenever one is read; an actuator's own name
        comes before that of a number of its kind."""
        record = _record_places(plant_dtype(len(self.actuators)))
        hull = {name: (int(record["hull"][number]),) for number, name in enumerate(HULLS[self.hull].numbers)}
        by_actuator, shared = dict[str, tuple[int, ...]](), dict[str, tuple[int, ...]]()
        for row, actuator in zip(record["actuators"][: len(self.actuators)], self.actuators, strict=True):
            kind = KINDS[actuator.kind]
            for place, name in zip(row[FIRST_NUMBER:].astype(int).tolist(), kind.numbers, strict=False):
                called = f"{actuator.name}_{name}"
                by_actuator[called] = (*by_actuator.get(called, ()), place)
                if name in kind.shared:
                    shared[name] = (*shared.get(name, ()), place)
        object.__setattr__(self, "places", {**shared, **by_actuator, **hull, **_SCALAR_PLACES})


TABLES = ("CX", "CY", "CN")
_STATED = (
    "length_overall_m", "length_between_perpendiculars_m", "beam_m", "draught_m", "water_density_kgpm3",
    "surge_low_mps", "surge_high_mps", "sway_limit_mps", "yaw_rate_limit_radps",
    "mass_kg", "yaw_inertia_kgm2", "Xud", "Yvd", "Yrd", "Nrd",
    "frontal_area_m2", "lateral_area_m2", "air_density_kgpm3", *TABLES,
)  # fmt: skip
"""What every ship has: dimensions and range, rigid body and added mass, wind."""

_NEUTRAL = {
    # what only some ships have
    "centre_of_gravity_m": 0.0, "wind_model": 0.0,
    # slots of effects: propulsion
    "azimuth_scale": 1.0, "thruster_lag_s": 0.0, "command_delay_s": 0.0,
    # slots of effects: environment, constant forces, damping near rest
    "wind_load_factor": 1.0, "current_north_mps": 0.0, "current_east_mps": 0.0,
    "drift_force_n": 0.0, "drift_north": 1.0, "drift_east": 0.0,
    "constant_X_n": 0.0, "constant_Y_n": 0.0, "constant_N_nm": 0.0,
    "surge_damping_ps": 0.0, "sway_damping_ps": 0.0, "yaw_damping_ps": 0.0,
    # slots of effects: sensors (reported = factor x true, or true + bias)
    "wind_direction_bias_rad": 0.0, "wind_speed_factor": 1.0, "heading_bias_rad": 0.0,
    "antenna_forward_m": 0.0, "antenna_starboard_m": 0.0,
    "position_delay_s": 0.0, "heading_delay_s": 0.0, "speed_delay_s": 0.0, "speed_scale": 1.0,
    "speed_sensor_forward_m": 0.0, "speed_sensor_starboard_m": 0.0, "speed_sensor_angle_rad": 0.0,
    "sway_bias_mps": 0.0, "yaw_rate_scale": 1.0, "yaw_rate_bias_radps": 0.0,
}  # fmt: skip
SCALARS = (*_STATED, *_NEUTRAL)
"""The names of a plant's numbers besides its hull's and actuators', in their order in its record."""

_SCALAR_TYPES = [(name, np.float64, (TABLE_SIZE,) if name in TABLES else ()) for name in SCALARS]


def _record_places(dtype: np.dtype[np.void]) -> np.void:
    """Where each number of a record of float64 stands in it."""
    place: np.void = np.arange(dtype.itemsize // 8, dtype=np.float64).view(dtype)[0]
    return place


_SCALAR_PLACES = {
    name: tuple(np.atleast_1d(_record_places(np.dtype(_SCALAR_TYPES))[name]).astype(int).tolist())
    for name in SCALARS
}


_ROWS = 8  # of actuators; KVLCC2 has two, R/V Gunnerus three, a ferry with four azimuths and tunnels six


@lru_cache(maxsize=32)
def plant_dtype(actuator_count: int) -> np.dtype[np.void]:
    """The record that a plant with so many actuators is packed into: float64, so :func:`flat_numbers` is a view.

    ``hull`` in it is the row of the hull's coefficients, ``actuators`` the table
    [rows, :data:`~seatrial.hybrid.vessel.actuators.ROW_SIZE`] of the actuators' rows, the first ``actuator_count``
    of which are in use: a kernel compiles for a record of one size, so ships of up to eight actuators share one.
    """
    rows = _ROWS * -(-actuator_count // _ROWS)
    hull = [("hull_model", np.float64), ("hull", np.float64, (HULL_SIZE,))]
    table = [("actuator_count", np.float64), ("actuators", np.float64, (rows, ROW_SIZE))]
    return np.dtype([*_SCALAR_TYPES, *hull, *table])


def number_places(form: Form, name: str) -> tuple[int, ...]:
    """Where a number stands in a flat plant (:func:`flat_numbers`): one place, or one for each actuator it means.

    Raises :class:`KeyError` for what is no number.
    """
    if name not in form.places:
        raise KeyError(f"{name} is not a number of a plant")
    return form.places[name]


@dataclass(frozen=True, slots=True)
class Plant:
    """One run's numbers, SI and radians, in the order of its record, and the forces that no slot expresses.

    All but the actuators' are read by their own names: ``plant.mass_kg``, ``plant.Yuv``.
    """

    form: Form
    values: tuple[float, ...]
    forces: tuple[ExtraForce, ...] = ()

    def __getattr__(self, name: str) -> float:
        """A number of the ship or its hull by its name."""
        if name in _SCALAR_PLACES or (name != "form" and name in HULLS[self.form.hull].numbers):
            return self.number(name)  # type: ignore[no-any-return]
        raise AttributeError(f"a plant has no {name}")

    def number(self, name: str) -> Any:
        """A number, or table, by its name; of a kind's number the one of its first actuator.

        Raises :class:`KeyError` for what is none.
        """
        places = number_places(self.form, name)
        return tuple(self.values[place] for place in places) if name in TABLES else self.values[places[0]]

    def numbers(self) -> dict[str, float | tuple[float, ...]]:
        """Every number by name; one of a kind without the actuators' names where it is the same in all."""
        result = {name: self.number(name) for name in (*SCALARS, *HULLS[self.form.hull].numbers)}
        kinds = np.array([actuator.kind for actuator in self.layout])
        table = actuator_rows(pack(self))
        for actuator, row in zip(self.layout, table, strict=True):
            kind = KINDS[actuator.kind]
            for place, name in enumerate(kind.numbers, FIRST_NUMBER):
                is_shared = name in kind.shared and (table[kinds == actuator.kind, place] == row[place]).all()
                result[name if is_shared else f"{actuator.name}_{name}"] = float(row[place])
        return result

    def replaced(self, **values: Any) -> Plant:
        """This plant with numbers, or tables, of these names instead."""
        result = np.array(self.values)
        for name, value in values.items():
            result[list(number_places(self.form, name))] = value
        return replace(self, values=tuple(result.tolist()))

    def scaled(self, factor: float, *names: str) -> Plant:
        """This plant with the named numbers, or tables, multiplied by ``factor``."""
        return self._with_changed_numbers(dict.fromkeys(names, partial(mul, factor)))

    def shifted(self, **amounts: float) -> Plant:
        """This plant with each amount added to the number of its name."""
        return self._with_changed_numbers({name: partial(add, amount) for name, amount in amounts.items()})

    def _with_changed_numbers(self, changes: Mapping[str, Callable[[float], float]]) -> Plant:
        values = list(self.values)
        for name, change in changes.items():
            for place in number_places(self.form, name):
                values[place] = change(values[place])
        return replace(self, values=tuple(values))

    def with_force(self, function: ForceFunction, *parameters: float) -> Plant:
        """This plant with one more force that the simulator adds up."""
        return replace(self, forces=(*self.forces, ExtraForce(function, parameters)))

    @property
    def layout(self) -> Actuators:
        """The names and kinds of the actuators, in the order of their controls."""
        return self.form.actuators

    @property
    def hull_model(self) -> HullModel:
        """The hull's model."""
        return HULLS[self.form.hull]


def _neutral_packed_plant(form: Form) -> NDArray[np.void]:
    """A plant without any of its ship's numbers, packed [1]."""
    packed = np.zeros(1, plant_dtype(len(form.actuators)))
    for name, value in _NEUTRAL.items():
        packed[name] = value
    packed["hull_model"] = HULL_CODES[form.hull]
    packed["actuator_count"] = len(form.actuators)
    kinds = [actuator.kind for actuator in form.actuators]
    rows = actuator_rows(packed)
    rows[:, KIND] = [CODES[kind] for kind in kinds]
    rows[:, CONTROL] = np.cumsum([0, *(len(KINDS[kind].units) for kind in kinds[:-1])])
    return packed


def _unpack_plant(form: Form, packed: NDArray[np.void]) -> Plant:
    return Plant(form, tuple(flat_numbers(packed)[0].tolist()))


def bare_plant(vessel: Vessel) -> Plant:
    """The plant of a vessel *without* the effects its file may add; those: ``effects.vessel_plant``."""
    form, limits = Form(vessel.hull.model, vessel.actuators), vessel.validity
    length_m, draught_m = vessel.dimensions.length_between_perpendiculars_m, vessel.dimensions.draught_m
    values: dict[str, Any] = {
        "water_density_kgpm3": vessel.water_density_kgpm3,
        "surge_low_mps": limits.surge_low_mps, "surge_high_mps": limits.surge_high_mps,
        "sway_limit_mps": limits.sway_mps, "yaw_rate_limit_radps": limits.yaw_rate_radps,
        **vessel.wind.numbers(length_m, vessel.dimensions.beam_m),
    }  # fmt: skip
    for part in (vessel.dimensions, vessel.inertia.in_si(vessel)):
        values |= {entry.name: getattr(part, entry.name) for entry in fields(part) if entry.name != "model"}
    packed, model = _neutral_packed_plant(form), HULLS[form.hull]
    for name, value in values.items():
        packed[name] = value
    stated = model.in_si(vessel.hull, vessel.water_density_kgpm3, length_m, draught_m)
    packed["hull"][0, : len(stated)] = stated
    names = [actuator.name for actuator in vessel.actuators]
    for row, entry in zip(actuator_rows(packed), vessel.actuator, strict=True):
        kind = KINDS[entry.kind]
        numbers = {**kind.slots, **kind.numbers_of(entry)}
        stated_values = [numbers[name] if name in numbers else getattr(entry, name) for name in kind.numbers]
        row[FIRST_NUMBER:][: len(kind.numbers)] = [  # another actuator's name as its place in the list; -1 for none
            (names.index(value) if value else -1.0) if isinstance(value, str) else value for value in stated_values
        ]
    return _unpack_plant(form, packed)


def actuator_rows(packed: NDArray[np.void]) -> Floats:
    """The rows of the first packed plant's actuators [actuators, ROW_SIZE]; a view."""
    rows: Floats = packed["actuators"][0, : int(packed["actuator_count"][0])]
    return rows


def number_of_controls(packed: NDArray[np.void]) -> int:
    """How many controls packed plants have."""
    last = actuator_rows(packed)[-1]
    return int(last[CONTROL]) + int(CONTROLS_OF[int(last[KIND])])


def angles_in(packed: NDArray[np.void]) -> list[int]:
    """Which of the controls of packed plants are angles."""
    rows = actuator_rows(packed)
    return [int(row[CONTROL]) + int(place) for row in rows for place in np.flatnonzero(IS_ANGLE[int(row[KIND])])]


Plants = Plant | Sequence[Plant] | NDArray[np.void]
"""One plant, one a run, or thousands already packed: an array [P] of :func:`plant_dtype`, made without objects."""


def pack(plants: Plants) -> NDArray[np.void]:
    """Plants as a record array [P] of :func:`plant_dtype`; their extra forces are not in it.

    An array that is packed already comes back as it is. Raises :class:`ConfigurationError` for another
    array, where there is no plant, and for plants whose actuators differ in number, name or kind.
    """
    if isinstance(plants, Plant):
        return np.array(plants.values).view(plant_dtype(len(plants.layout)))
    if len(plants) == 0:
        raise ConfigurationError("no plant to simulate", fix="give one plant, or one for each run")
    if not isinstance(plants, np.ndarray):
        layout = plants[0].layout
        if any(plant.layout != layout for plant in plants):
            raise ConfigurationError("the plants have different actuators", fix="simulate each ship by itself")
        return np.array([plant.values for plant in plants]).view(plant_dtype(len(layout)))[:, 0]
    names = plants.dtype.names or ()
    size = plants.dtype["actuators"].shape[0] if "actuators" in names else 0
    if plants.dtype != plant_dtype(size) or plants.ndim != 1:
        raise ConfigurationError(
            f"packed plants are an array of {plants.dtype.name} with shape {plants.shape}",
            fix="make it with plant.pack, or with np.empty(N, plant.dtype_of(actuators)) and fill every field",
        )
    counts = plants["actuator_count"]
    alike = counts[0] in range(1, size + 1) and (counts == counts[0]).all()
    kinds = plants["actuators"][:, : int(counts[0]) if alike else 0, [KIND, CONTROL]]
    if not alike or (kinds != kinds[0]).any():
        raise ConfigurationError(
            "packed plants have different actuators, or none",
            fix="simulate each ship by itself, with the number of its actuators in actuator_count",
        )
    return np.ascontiguousarray(plants)


def flat_numbers(packed: NDArray[np.void]) -> Floats:
    """Packed plants as plain numbers, [P, numbers]; a view."""
    return packed.view(np.float64).reshape(len(packed), -1)


Numbers = dict[str, float | tuple[float, ...]]
LATER = dict.fromkeys(
    ("centre_of_gravity_m", "wind_model", "surge_damping_ps", "sway_damping_ps", "yaw_damping_ps"), 0.0
)
"""Numbers that plants were stored without; left out where they say nothing, so that old fingerprints hold."""


def plant_numbers(plant: Plant) -> Numbers:
    """Every number of a plant by name, SI and radians.

    Raises :class:`ConfigurationError` for a plant with forces that are code, which no number stands for.
    """
    if plant.forces:
        raise ConfigurationError(
            "a model with forces of one's own cannot be stored",
            why="they are code, not numbers",
            fix="use effects of the catalogue",
        )
    return {name: value for name, value in plant.numbers().items() if LATER.get(name) != value}


def plant_from_numbers(numbers: Mapping[str, float | tuple[float, ...]], layout: Actuators) -> Plant:
    """The plant with these numbers, named as :func:`plant_numbers` names them.

    Raises :class:`ValueError` for a missing, unknown or ill-shaped one.
    """
    numbers = {**LATER, **numbers}
    if missing := [name for name in SCALARS if name not in numbers]:
        raise ValueError(f"{missing[0]} is missing")
    for name, value in numbers.items():
        columns = len(value) if isinstance(value, tuple) else 0
        if columns != (TABLE_SIZE if name in TABLES else 0):
            raise ValueError(f"{name} has {columns} columns")
    hull = next((name for name, model in HULLS.items() if set(model.numbers) <= set(numbers)), None)
    if hull is None:
        raise ValueError("the coefficients of no hull model are there")
    form = Form(hull, layout)
    try:
        plant = _unpack_plant(form, _neutral_packed_plant(form)).replaced(**numbers)
    except KeyError as error:
        raise ValueError(str(error.args[0])) from error
    lacking = [name for name in plant.numbers() if name not in numbers]
    if lacking:
        raise ValueError(f"{lacking[0]} is missing")
    return plant


def plant_hash(plant: Plant) -> str:
    """A fingerprint (SHA-256) of every number of a vessel model, the same in every session."""
    return hashlib.sha256(json.dumps(plant_numbers(plant), sort_keys=True).encode()).hexdigest()
