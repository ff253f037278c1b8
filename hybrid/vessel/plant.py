"""The plant: everything that one simulated run needs, as one flat set of named numbers.

A vessel file becomes a :class:`Plant`; effects turn one plant into another; the compiled core sees the plant
packed into a numpy record, whose fields it reads by the same names; its actuators are rows of a table in that
record, one each. This is the one place where named objects become arrays. Besides the vessel's own numbers a plant
has slots for everything the effects of the catalogue touch; their defaults are neutral and switch them off exactly.

An actuator's numbers have its name before theirs: ``port_x_m``. Those that describe a kind (``thrust_nn``) mean
all actuators of that kind where the name is not there. As plain numbers a plant can be written down, read back, and
told from another by a hash.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import lru_cache, partial
from operator import add, attrgetter
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from acquisition.core.actuators import Actuator, Actuators
from acquisition.core.arrays import Floats
from acquisition.core.errors import ConfigurationError
from analysis.compiling import source_stamp
from hybrid.vessel.actuators import CODES, CONTROLS_OF, IS_ANGLE, KINDS, ROW_SIZE
from hybrid.vessel.actuators.kind import CONTROL, FIRST_NUMBER, KIND
from hybrid.vessel.hulls import HULL_CODES, HULL_SIZE, HULLS
from hybrid.vessel.hulls.kind import HullModel
from hybrid.vessel.parameters import Vessel
from hybrid.vessel.wind import TABLE_SIZE

PHYSICS_STAMP = source_stamp(Path(__file__).parent)
"""A digest of this package, on which every compiled simulation depends."""

ForceFunction = Callable[..., tuple[float, float, float]]
"""``force(time_s, state, control, environment, parameters) -> X [N], Y [N], N [N m]``; see simulate.py."""


@dataclass(frozen=True, slots=True)
class ExtraForce:
    """A force that no slot of the plant expresses: a function for numba, and its parameters."""

    function: ForceFunction
    parameters: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class HullNumbers:
    """The hull of a plant: its model, and its coefficients in the order of the model's."""

    model: str
    values: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Form:
    """What a plant's numbers are called: the hull's model, and the names and kinds of the actuators."""

    hull: str
    actuators: Actuators


@dataclass(frozen=True, slots=True)
class ActuatorNumbers:
    """One actuator of a plant: its name, its kind, and its numbers in the order of the kind's."""

    name: str
    kind: str
    values: tuple[float, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Plant:
    """One run's numbers, SI and radians; the hull's coefficients are read by their own names, too."""

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
    # wind
    frontal_area_m2: float
    lateral_area_m2: float
    air_density_kgpm3: float
    CX: tuple[float, ...]
    CY: tuple[float, ...]
    CN: tuple[float, ...]
    hull: HullNumbers
    actuators: tuple[ActuatorNumbers, ...]
    # what only some ships have
    centre_of_gravity_m: float = 0.0
    wind_model: float = 0.0
    # slots of effects, neutral: propulsion
    azimuth_scale: float = 1.0
    thruster_lag_s: float = 0.0
    command_delay_s: float = 0.0
    # slots of effects, neutral: environment, constant forces, damping near rest
    wind_load_factor: float = 1.0
    current_north_mps: float = 0.0
    current_east_mps: float = 0.0
    drift_force_n: float = 0.0
    drift_north: float = 1.0
    drift_east: float = 0.0
    constant_X_n: float = 0.0
    constant_Y_n: float = 0.0
    constant_N_nm: float = 0.0
    surge_damping_ps: float = 0.0
    sway_damping_ps: float = 0.0
    yaw_damping_ps: float = 0.0
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

    def __getattr__(self, name: str) -> float:
        """A coefficient of the hull by its name."""
        if name != "hull" and name in HULLS[self.hull.model].numbers:
            return self.hull.values[HULLS[self.hull.model].numbers.index(name)]
        raise AttributeError(f"a plant has no {name}")

    def number(self, name: str) -> Any:
        """A number, or table, by its name; of a kind's number the one of its first actuator.

        Raises :class:`KeyError` for what is none.
        """
        if name in SCALARS:
            return getattr(self, name)
        which, place = _places(self.form, name)[0]
        return self._values[which][place]

    def numbers(self) -> dict[str, float | tuple[float, ...]]:
        """Every number by name; one of a kind without the actuators' names where it is the same in all."""
        result = {name: getattr(self, name) for name in SCALARS}
        result |= zip(HULLS[self.hull.model].numbers, self.hull.values, strict=True)
        for each in self.actuators:
            kind = KINDS[each.kind]
            for name, value in zip(kind.numbers, each.values, strict=True):
                alike = name in kind.shared and {*self._numbers_of_kind(each.kind, name)} == {value}
                result[name if alike else f"{each.name}_{name}"] = value
        return result

    def replaced(self, **values: Any) -> Plant:
        """This plant with numbers, or tables, of these names instead."""
        return self._with({name: partial(_second, value) for name, value in values.items()})

    def _with(self, changes: Mapping[str, Callable[[Any], Any]]) -> Plant:
        scalars = {name: change(getattr(self, name)) for name, change in changes.items() if name in SCALARS}
        plant = replace(self, **scalars)
        if len(scalars) == len(changes):
            return plant
        rows = [list(values) for values in self._values]
        for name, change in changes.items():
            for which, place in () if name in SCALARS else _places(self.form, name):
                rows[which][place] = change(rows[which][place])
        *actuators, hull = map(tuple, rows)
        return replace(
            plant,
            hull=HullNumbers(self.hull.model, hull),
            actuators=tuple(replace(each, values=row) for each, row in zip(self.actuators, actuators, strict=True)),
        )

    def scaled(self, factor: float, *names: str) -> Plant:
        """This plant with the named numbers, or tables, multiplied by ``factor``."""
        return self._with(dict.fromkeys(names, partial(_times, factor=factor)))

    def shifted(self, **amounts: float) -> Plant:
        """This plant with each amount added to the number of its name."""
        return self._with({name: partial(add, amount) for name, amount in amounts.items()})

    def with_force(self, function: ForceFunction, *parameters: float) -> Plant:
        """This plant with one more force that the simulator adds up."""
        return replace(self, forces=(*self.forces, ExtraForce(function, parameters)))

    @property
    def layout(self) -> Actuators:
        """The names and kinds of the actuators, in the order of their controls."""
        return tuple(Actuator(each.name, each.kind) for each in self.actuators)

    @property
    def form(self) -> Form:
        """What the numbers are called."""
        return Form(self.hull.model, self.layout)

    @property
    def hull_model(self) -> HullModel:
        """The hull's model."""
        return HULLS[self.hull.model]

    @property
    def _values(self) -> tuple[tuple[float, ...], ...]:
        """The numbers of each actuator, and last the hull's."""
        return (*(each.values for each in self.actuators), self.hull.values)

    def _numbers_of_kind(self, kind: str, number: str) -> list[float]:
        place = KINDS[kind].numbers.index(number)
        return [each.values[place] for each in self.actuators if each.kind == kind]


def _second(value: Any, _: Any) -> Any:
    return value


def _times(value: float | tuple[float, ...], factor: float) -> Any:
    return tuple(factor * each for each in value) if isinstance(value, tuple) else value * factor


_GROUPS = ("hull", "actuators", "forces")
SCALARS: tuple[str, ...] = tuple(field.name for field in fields(Plant) if field.name not in _GROUPS)
"""The names of a plant's numbers besides its hull's and actuators', in their order in its record."""

_SCALARS_OF = attrgetter(*SCALARS)

TABLES = ("CX", "CY", "CN")
_SCALAR_TYPES = [(name, np.float64, (TABLE_SIZE,) if name in TABLES else ()) for name in SCALARS]


@lru_cache(maxsize=32)
def dtype_of(actuators: int) -> np.dtype[np.void]:
    """The record that a plant with so many actuators is packed into: float64 throughout, so :func:`flat` is a view.

    ``hull`` in it is the row of the hull's coefficients, ``actuators`` the table
    [actuators, :data:`~hybrid.vessel.actuators.ROW_SIZE`] of their rows.
    """
    hull = [("hull_model", np.float64), ("hull", np.float64, (HULL_SIZE,))]
    return np.dtype([*_SCALAR_TYPES, *hull, ("actuators", np.float64, (actuators, ROW_SIZE))])


def bare_plant(vessel: Vessel) -> Plant:
    """The plant of a vessel *without* the effects its file may add; those: ``effects.vessel_plant``."""
    values: dict[str, Any] = {"water_density_kgpm3": vessel.water_density_kgpm3}
    for part in (vessel.dimensions, vessel.inertia.in_si(vessel)):
        values |= {field.name: getattr(part, field.name) for field in fields(part) if field.name != "model"}
    length_m, draught_m = vessel.dimensions.length_between_perpendiculars_m, vessel.dimensions.draught_m
    values |= vessel.wind.numbers(length_m, vessel.dimensions.beam_m)
    limits, model = vessel.validity, vessel.hull.model
    names = [each.name for each in vessel.actuator]
    return Plant(
        **values,
        surge_low_mps=limits.surge_low_mps,
        surge_high_mps=limits.surge_high_mps,
        sway_limit_mps=limits.sway_mps,
        yaw_rate_limit_radps=limits.yaw_rate_radps,
        hull=HullNumbers(model, HULLS[model].values(vessel.hull, vessel.water_density_kgpm3, length_m, draught_m)),
        actuators=tuple(_numbers_of(each, names) for each in vessel.actuator),
    )


def _numbers_of(entry: Any, names: list[str]) -> ActuatorNumbers:
    kind = KINDS[entry.kind]
    given = {**kind.slots, **kind.numbers_of(entry)}
    values = (given[name] if name in given else getattr(entry, name) for name in kind.numbers)
    return ActuatorNumbers(entry.name, entry.kind, tuple(_as_number(value, names) for value in values))


def _as_number(value: float | str, names: list[str]) -> float:
    """A number as it is, another actuator's name as its place in the list; -1 for none."""
    if isinstance(value, str):
        return float(names.index(value)) if value else -1.0
    return float(value)


def _row(plant: Plant) -> tuple[Any, ...]:
    """A plant as its record."""
    padding = (0.0,) * (HULL_SIZE - len(plant.hull.values))
    return (
        *_SCALARS_OF(plant),
        HULL_CODES[plant.hull.model],
        (*plant.hull.values, *padding),
        _actuator_rows(plant),
    )


def _actuator_rows(plant: Plant) -> list[tuple[float, ...]]:
    """The actuators as rows of the compiled core: kind, first control, numbers."""
    rows, first = [], 0
    for each in plant.actuators:
        padding = (0.0,) * (ROW_SIZE - FIRST_NUMBER - len(each.values))
        rows.append((CODES[each.kind], float(first), *each.values, *padding))
        first += len(KINDS[each.kind].units)
    return rows


def controls_in(packed: NDArray[np.void]) -> int:
    """How many controls packed plants have."""
    last = packed["actuators"][0, -1]
    return int(last[CONTROL]) + int(CONTROLS_OF[int(last[KIND])])


def angles_in(packed: NDArray[np.void]) -> list[int]:
    """Which of the controls of packed plants are angles."""
    rows = packed["actuators"][0]
    return [int(row[CONTROL]) + int(place) for row in rows for place in np.flatnonzero(IS_ANGLE[int(row[KIND])])]


def places_of(form: Form, name: str) -> list[int]:
    """Where a number stands in a flat packed plant (:func:`flat`): one place, or one for each actuator it means."""
    dtype = dtype_of(len(form.actuators))
    record = np.arange(dtype.itemsize // 8, dtype=np.float64).view(dtype)[0]
    if name in SCALARS:
        return [int(place) for place in np.atleast_1d(record[name])]
    return [
        int(record["hull"][place] if which == _HULL_ROW else record["actuators"][which, FIRST_NUMBER + place])
        for which, place in _places(form, name)
    ]


_HULL_ROW = -1


@lru_cache(maxsize=4096)
def _places(form: Form, name: str) -> tuple[tuple[int, int], ...]:
    """Which actuators, or the hull, and where in their values, a name means. Raises :class:`KeyError` if none."""
    if name in HULLS[form.hull].numbers:
        return ((_HULL_ROW, HULLS[form.hull].numbers.index(name)),)
    own, shared = [], []
    for which, each in enumerate(form.actuators):
        numbers = KINDS[each.kind].numbers
        number = name.removeprefix(f"{each.name}_")
        if number != name and number in numbers:
            own.append((which, numbers.index(number)))
        if name in KINDS[each.kind].shared:
            shared.append((which, numbers.index(name)))
    if not own and not shared:
        raise KeyError(f"{name} is not a number of a plant")
    return tuple(own or shared)


Plants = Plant | Sequence[Plant] | NDArray[np.void]
"""One plant, one a run, or thousands already packed: an array [P] of :func:`dtype_of`, made without objects."""


def pack(plants: Plants) -> NDArray[np.void]:
    """Plants as a record array [P] of :func:`dtype_of`; their extra forces are not in it.

    An array that is packed already comes back as it is. Raises :class:`ConfigurationError` for another
    array, where there is no plant, and for plants whose actuators differ in number, name or kind.
    """
    if isinstance(plants, Plant):
        return np.array([_row(plants)], dtype=dtype_of(len(plants.actuators)))
    if len(plants) == 0:
        raise ConfigurationError("no plant to simulate", fix="give one plant, or one for each run")
    if not isinstance(plants, np.ndarray):
        layout = plants[0].layout
        if any(each.layout != layout for each in plants):
            raise ConfigurationError("the plants have different actuators", fix="simulate each ship by itself")
        return np.array([_row(each) for each in plants], dtype=dtype_of(len(layout)))
    names = plants.dtype.names or ()
    size = plants.dtype["actuators"].shape[0] if "actuators" in names else 0
    if plants.dtype != dtype_of(size) or plants.ndim != 1:
        raise ConfigurationError(
            f"packed plants are an array of {plants.dtype.name} with shape {plants.shape}",
            fix="make it with plant.pack, or with np.empty(N, plant.dtype_of(actuators)) and fill every field",
        )
    return np.ascontiguousarray(plants)


def flat(packed: NDArray[np.void]) -> Floats:
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
    return {name: _plain(value) for name, value in plant.numbers().items() if LATER.get(name) != value}


def plant_of(numbers: Mapping[str, float | tuple[float, ...]], layout: Actuators) -> Plant:
    """The plant with these numbers, named as :func:`plant_numbers` names them.

    Raises :class:`ValueError` for a missing, unknown or ill-shaped one.
    """
    numbers = {**LATER, **numbers}
    zeros = tuple(ActuatorNumbers(each.name, each.kind, (0.0,) * len(KINDS[each.kind].numbers)) for each in layout)
    scalars = {name: numbers[name] for name in SCALARS if name in numbers}
    missing = [name for name in SCALARS if name not in numbers]
    if missing:
        raise ValueError(f"{missing[0]} is missing")
    wrong = [name for name, value in numbers.items() if _size(value) != (TABLE_SIZE if name in TABLES else 0)]
    if wrong:
        raise ValueError(f"{wrong[0]} has {_size(numbers[wrong[0]])} columns")
    hull = _hull_in(numbers)
    plant = Plant(**scalars, hull=HullNumbers(hull, (0.0,) * len(HULLS[hull].numbers)), actuators=zeros)  # type: ignore[arg-type]
    others = {name: value for name, value in numbers.items() if name not in SCALARS}
    try:
        plant = plant.replaced(**others)
    except KeyError as error:
        raise ValueError(str(error.args[0])) from error
    lacking = [name for name in plant.numbers() if name not in numbers]
    if lacking:
        raise ValueError(f"{lacking[0]} is missing")
    return plant


def _hull_in(numbers: Mapping[str, float | tuple[float, ...]]) -> str:
    """The hull model whose coefficients are among the numbers. Raises :class:`ValueError` for none."""
    for name, model in HULLS.items():
        if set(model.numbers) <= set(numbers):
            return name
    raise ValueError("the coefficients of no hull model are there")


def plant_hash(plant: Plant) -> str:
    """A fingerprint (SHA-256) of every number of a vessel model, the same in every session."""
    return hashlib.sha256(json.dumps(plant_numbers(plant), sort_keys=True).encode()).hexdigest()


def _plain(value: float | tuple[float, ...]) -> float | tuple[float, ...]:
    return tuple(float(each) for each in value) if isinstance(value, tuple) else float(value)


def _size(value: float | tuple[float, ...]) -> int:
    return len(value) if isinstance(value, tuple) else 0
