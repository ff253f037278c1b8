"""A plant as plain numbers that can be written down, read back, and told from another by a hash."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping

from acquisition.core.actuators import Actuators
from acquisition.core.errors import ConfigurationError
from hybrid.vessel.actuators import KINDS
from hybrid.vessel.hulls import HULLS
from hybrid.vessel.plant import SCALARS, TABLES, ActuatorNumbers, HullNumbers, Plant
from hybrid.vessel.wind import TABLE_SIZE

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
