"""A plant as plain numbers that can be written down, read back, and told from another by a hash."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping

from acquisition.core.errors import ConfigurationError
from hybrid.vessel.plant import NUMBERS, TABLES, Plant
from hybrid.vessel.wind import TABLE_SIZE

Numbers = dict[str, float | tuple[float, ...]]


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
    return {name: _plain(getattr(plant, name)) for name in NUMBERS}


def plant_of(numbers: Mapping[str, float | tuple[float, ...]]) -> Plant:
    """The inverse of :func:`plant_numbers`. Raises :class:`ValueError` for a missing, unknown or ill-shaped one."""
    if set(numbers) != set(NUMBERS):
        differing = sorted(set(numbers) ^ set(NUMBERS))
        raise ValueError(f"{differing[0]} is {'no number of a plant' if differing[0] in numbers else 'missing'}")
    wrong = [name for name, value in numbers.items() if _size(value) != (TABLE_SIZE if name in TABLES else 0)]
    if wrong:
        raise ValueError(f"{wrong[0]} has {_size(numbers[wrong[0]])} columns")
    return Plant(**numbers)  # type: ignore[arg-type]


def plant_hash(plant: Plant) -> str:
    """A fingerprint (SHA-256) of every number of a vessel model, the same in every session."""
    return hashlib.sha256(json.dumps(plant_numbers(plant), sort_keys=True).encode()).hexdigest()


def _plain(value: float | tuple[float, ...]) -> float | tuple[float, ...]:
    return tuple(float(each) for each in value) if isinstance(value, tuple) else float(value)


def _size(value: float | tuple[float, ...]) -> int:
    return len(value) if isinstance(value, tuple) else 0
