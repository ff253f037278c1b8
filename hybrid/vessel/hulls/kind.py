"""What a hull model is to the rest: its table in a vessel file, its coefficients, its force.

The compiled core sees a hull as the code of its model and one row of coefficients.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import MISSING, dataclass, fields
from typing import Any


def coefficient_names(entry: type) -> tuple[str, ...]:
    """The names of the coefficients in a model's ``[hull]`` table: its numbers that have no usual value."""
    return tuple(field.name for field in fields(entry) if field.name != "model" and field.default is MISSING)


def stated_coefficients(
    entry: Any, water_density_kgpm3: float, length_m: float, draught_m: float
) -> tuple[float, ...]:
    """The coefficients of an entry that states them as its model computes with them."""
    return tuple(getattr(entry, name) for name in coefficient_names(type(entry)))


@dataclass(frozen=True, slots=True, kw_only=True)
class HullEntry:
    """The ``[hull]`` table of a vessel file: the name of its model, and in each model the coefficients."""

    model: str


@dataclass(frozen=True, slots=True)
class HullModel:
    """A hull model.

    ``entry`` is the class of its ``[hull]`` table, ``numbers`` are the coefficients in the order of their row.
    ``force(p, u, v, r) -> X, Y, N`` is compiled: the water's force at velocities through it, the Coriolis terms of
    the added mass with it. ``linear`` names the coefficients that give Y and N in proportion to v and to r, in the
    order Y v, Y r, N v, N r. Effects speak of a hull by the other tuples: what brakes it straight ahead, what
    resists when it is dragged sideways, and its force and moment in drift and turn. ``keeps_sign`` are
    coefficients that damp. ``in_si(entry, rho, L, d)`` are the coefficients of an entry that may state them
    otherwise than the model computes with them. A ``primed`` model's coefficients are without dimension, so that
    they grow with the ship's length; ``munk`` tells that the moment of u v that the added masses give stands
    beside N's coefficients, not in them.
    """

    entry: type[HullEntry]
    numbers: tuple[str, ...]
    force: Callable[..., tuple[float, float, float]]
    linear: tuple[str, str, str, str]
    resistance: tuple[str, ...]
    cross_flow_drag: tuple[str, ...]
    drift_force: tuple[str, ...]
    drift_moment: tuple[str, ...]
    turning_force: tuple[str, ...]
    turning_drag: tuple[str, ...]
    yaw_damping: tuple[str, ...]
    keeps_sign: tuple[str, ...]
    in_si: Callable[[Any, float, float, float], tuple[float, ...]] = stated_coefficients
    primed: bool = False
    munk: bool = False

    @property
    def turning_coefficients(self) -> tuple[str, ...]:
        """The coefficients of force and moment that the turning rate alone gives, or with the speed ahead."""
        return self.turning_force + self.yaw_damping

    def sideways_coefficients(self, axis: str) -> list[str]:
        """The other coefficients of the force Y or the moment N."""
        first = axis if axis == "N" else ("Y", "C_D")
        return [name for name in self.numbers if name.startswith(first) and name not in self.turning_coefficients]

    def moments_of(self) -> list[tuple[str, str]]:
        """Pairs of a moment's coefficient and the side force's of like name."""
        pairs = ((name, f"Y{name[1:]}") for name in self.numbers if name.startswith("N"))
        return [(moment, force) for moment, force in pairs if force in self.numbers]
