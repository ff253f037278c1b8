"""The coefficients of a vessel file that trials can determine, with their priors.

A coefficient is named as in ``[estimated]``: ``hull.Y_v``, ``rudder.a_H``. The prior of its deviation is
normal, with the relative width given in ``[estimated]`` or else the usual one. Coefficients that keep their
sign, such as damping, masses and all of an actuator's, vary by a factor exp(width z), the others by 1 + width
z. Dimensions, positions and limits are known, and so is everything that is zero: a term that the model does not
have.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from math import exp, inf
from typing import Any

from seatrial.acquisition.core.quantities import Floats
from seatrial.hybrid.effects.catalogue import catalogue_of
from seatrial.hybrid.vessel.actuators import KINDS
from seatrial.hybrid.vessel.hulls import HULLS
from seatrial.hybrid.vessel.parameters import Vessel

USUAL_WIDTHS = {"hull": 0.3, "inertia": 0.15, "actuator": 0.2}
"""The relative prior widths of coefficients without a stated error: about those of ``vessel new``."""

WIND_LOAD_WIDTH, ASTERN_WIDTH = 0.2, 0.3
"""The relative prior width of the wind coefficients as a whole, whose regressions have errors of a fifth
(Fujiwara, Ueno and Nimura 1998), and of a shaft's astern thrust if the file does not give it."""

_FAR = 100.0
"""A bound on logarithms; the model leaves its range where a search reaches it."""

_ADDED_MASSES = ("Xud", "Yvd", "Yrd", "Nrd", "m_x", "m_y", "J_z", "I_zG", "yaw_inertia_kgm2")
_POSITIVE = ("mass_kg", "yaw_inertia_kgm2", "Xud", "Yvd", "Nrd", "m", "m_x", "m_y", "I_zG", "J_z", "draught_m",
             "superstructure_area_m2", "frontal_area_m2", "lateral_area_m2", "lateral_centre_height_m",
             "bridge_height_m")  # fmt: skip


@dataclass(frozen=True, slots=True)
class Coefficient:
    """A coefficient: its name, its initial value, the relative width of its prior, and its parametrisation.

    ``twins`` are the names of the same coefficient of identical actuators; ``most`` is its upper bound.
    """

    name: str
    start: float
    width: float
    keeps_sign: bool
    twins: tuple[str, ...] = ()
    most: float = inf

    def value(self, z: float) -> float:
        """The value at a deviation of ``z`` standard deviations."""
        departed = exp(min(self.width * z, _FAR)) if self.keeps_sign else 1.0 + self.width * z
        return min(self.start * departed, self.most)


def coefficients_of(vessel: Vessel) -> tuple[Coefficient, ...]:
    """The coefficients of a vessel that trials can determine."""
    return tuple(_coefficients(vessel))


def _coefficients(vessel: Vessel) -> Iterable[Coefficient]:
    hull = HULLS[vessel.hull.model]
    yield from _of_table(vessel, "inertia", vessel.inertia, _ADDED_MASSES, _POSITIVE)
    yield from _of_table(vessel, "hull", vessel.hull, hull.numbers, hull.keeps_sign)
    yield from _of_table(vessel, "wind", vessel.wind, (), _POSITIVE)
    if vessel.wind.model != "none":
        yield _factor(vessel, "wind_load", WIND_LOAD_WIDTH)
    for first, *duplicates in _alike(vessel):
        for coefficient in _of_actuator(vessel, first):
            yield replace(
                coefficient,
                twins=tuple(_renamed(coefficient.name, first.name, duplicate.name) for duplicate in duplicates),
            )


_OWN = {"name": "", "y_m": 0.0, "behind": ""}


def _alike(vessel: Vessel) -> list[list[Any]]:
    """The actuators, grouped if identical but for name and side."""
    groups: dict[Any, list[Any]] = {}
    listed: tuple[Any, ...] = vessel.actuator
    for actuator in listed:
        same = replace(actuator, **{name: value for name, value in _OWN.items() if hasattr(actuator, name)})
        groups.setdefault(same, []).append(actuator)
    return list(groups.values())


def _renamed(name: str, old: str, new: str) -> str:
    """The name of a coefficient of the ``old`` actuator for the ``new`` one."""
    table, _, number = name.rpartition(".")
    return f"{table.removesuffix(old)}{new}.{number}"


def _of_actuator(vessel: Vessel, entry: Any) -> Iterable[Coefficient]:
    kind, astern = KINDS[entry.kind], f"astern_thrust_{entry.name}"
    usual = (*kind.keeps_sign, *kind.adapted)
    yield from _of_table(vessel, entry.name, entry, usual, [field.name for field in fields(entry)])
    if astern in catalogue_of(vessel) and not hasattr(entry, "astern_0"):
        yield _factor(vessel, astern, ASTERN_WIDTH)


def _factor(vessel: Vessel, effect: str, width: float) -> Coefficient:
    """The factor of an effect, from the file or 1, within the effect's bounds."""
    start = float(vessel.effects.get(effect, {}).get("factor", 1.0))
    (factor,) = catalogue_of(vessel)[effect].parameters
    return Coefficient(f"effects.{effect}.factor", start, width, keeps_sign=True, most=factor.high)


def _of_table(
    vessel: Vessel, label: str, entry: Any, usual: Sequence[str], keeps_sign: Sequence[str]
) -> Iterable[Coefficient]:
    """The coefficients of one table of the file: those with a stated error, and the ``usual`` ones."""
    width = USUAL_WIDTHS.get(label, USUAL_WIDTHS["actuator"])
    for name in (field.name for field in fields(entry)):
        start, stated_error = getattr(entry, name), vessel.estimated.get(f"{label}.{name}", 0.0)
        if isinstance(start, float) and start != 0.0 and (stated_error > 0.0 or name in usual):
            yield Coefficient(f"{label}.{name}", start, float(stated_error) or width, name in keeps_sign)


def values_at(coefficients: Sequence[Coefficient], z: Floats) -> dict[str, float]:
    """The values by name at deviations ``z`` [coefficients]."""
    return {
        name: coefficient.value(float(at))
        for coefficient, at in zip(coefficients, z, strict=True)
        for name in (coefficient.name, *coefficient.twins)
    }


def with_values(vessel: Vessel, values: Mapping[str, float]) -> Vessel:
    """A vessel with these coefficients replaced."""
    tables: dict[str, dict[str, float]] = {}
    for name, value in values.items():
        table, _, number = name.rpartition(".")
        tables.setdefault(table, {})[number] = value
    parts = {name: replace(getattr(vessel, name), **tables[name]) for name in ("inertia", "hull", "wind")
             if name in tables}  # fmt: skip
    listed: tuple[Any, ...] = vessel.actuator
    actuators = tuple(replace(actuator, **tables.get(actuator.name, {})) for actuator in listed)
    loads = {name.partition(".")[2]: numbers for name, numbers in tables.items() if name.startswith("effects.")}
    changed = {
        name: numbers for name, numbers in loads.items() if name in vessel.effects or numbers != {"factor": 1.0}
    }
    return replace(vessel, **parts, actuator=actuators, effects={**vessel.effects, **changed})
