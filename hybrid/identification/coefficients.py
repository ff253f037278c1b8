"""The numbers of a vessel file that a trial can tell of, each with what is thought of it before.

A coefficient is named as in ``[estimated]``: ``hull.Y_v``, ``rudder.a_H``. Before any data its departure is normal,
of the relative width that ``[estimated]`` says, or else of one that is usual for such a number. Numbers that keep
their sign, as damping, masses and all of an actuator's do, depart by a factor exp(width z), the others by a share
1 + width z. Dimensions, places and limits are known, and so is whatever is zero: a term that the model lacks.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from math import exp
from typing import Any

from acquisition.core.arrays import Floats
from hybrid.vessel.actuators import KINDS
from hybrid.vessel.hulls import HULLS
from hybrid.vessel.parameters import Vessel

USUAL_WIDTHS = {"hull": 0.3, "inertia": 0.15, "actuator": 0.2}
"""The relative widths of numbers that nobody gave an error for: about those of ``vessel new``."""

WIND_LOAD, WIND_LOAD_WIDTH = "effects.wind_load.factor", 0.2
"""The wind's coefficients as a whole: their regressions err by a fifth (Fujiwara, Ueno and Nimura 1998)."""

_ADDED_MASSES = ("Xud", "Yvd", "Yrd", "Nrd", "m_x", "m_y", "J_z", "I_zG", "yaw_inertia_kgm2")
_POSITIVE = ("mass_kg", "yaw_inertia_kgm2", "Xud", "Yvd", "Nrd", "m", "m_x", "m_y", "I_zG", "J_z", "draught_m",
             "superstructure_area_m2", "frontal_area_m2", "lateral_area_m2", "lateral_centre_height_m",
             "bridge_height_m")  # fmt: skip


@dataclass(frozen=True, slots=True)
class Coefficient:
    """One number: its name, what it is at first, the relative width of what is thought of it, and its form."""

    name: str
    start: float
    width: float
    keeps_sign: bool

    def value(self, z: float) -> float:
        """The number at a departure of ``z`` standard deviations."""
        return self.start * (exp(self.width * z) if self.keeps_sign else 1.0 + self.width * z)


def coefficients_of(vessel: Vessel) -> tuple[Coefficient, ...]:
    """The coefficients of a vessel that trials can tell of."""
    return tuple(_coefficients(vessel))


def _coefficients(vessel: Vessel) -> Iterable[Coefficient]:
    hull = HULLS[vessel.hull.model]
    yield from _of_table(vessel, "inertia", vessel.inertia, _ADDED_MASSES, _POSITIVE)
    yield from _of_table(vessel, "hull", vessel.hull, hull.numbers, hull.keeps_sign)
    yield from _of_table(vessel, "wind", vessel.wind, (), _POSITIVE)
    if vessel.wind.model != "none":
        start = float(vessel.effects.get("wind_load", {}).get("factor", 1.0))
        yield Coefficient(WIND_LOAD, start, WIND_LOAD_WIDTH, keeps_sign=True)
    listed: tuple[Any, ...] = vessel.actuator
    for each in listed:
        kind = KINDS[each.kind]
        usual = (*kind.keeps_sign, *kind.adapted)
        yield from _of_table(vessel, each.name, each, usual, [field.name for field in fields(each)])


def _of_table(
    vessel: Vessel, label: str, entry: Any, usual: Sequence[str], keeps_sign: Sequence[str]
) -> Iterable[Coefficient]:
    """Those of one table of the file: what has an error there, and the ``usual`` ones."""
    width = USUAL_WIDTHS.get(label, USUAL_WIDTHS["actuator"])
    for name in (field.name for field in fields(entry)):
        start, given = getattr(entry, name), vessel.estimated.get(f"{label}.{name}", 0.0)
        if isinstance(start, float) and start != 0.0 and (given > 0.0 or name in usual):
            yield Coefficient(f"{label}.{name}", start, float(given) or width, name in keeps_sign)


def values_at(coefficients: Sequence[Coefficient], z: Floats) -> dict[str, float]:
    """The numbers by name at departures ``z`` [coefficients]."""
    return {each.name: each.value(float(at)) for each, at in zip(coefficients, z, strict=True)}


def with_values(vessel: Vessel, values: Mapping[str, float]) -> Vessel:
    """A vessel with numbers of these names instead."""
    tables: dict[str, dict[str, float]] = {}
    for name, value in values.items():
        table, _, number = name.rpartition(".")
        tables.setdefault(table, {})[number] = value
    parts = {name: replace(getattr(vessel, name), **tables[name]) for name in ("inertia", "hull", "wind")
             if name in tables}  # fmt: skip
    listed: tuple[Any, ...] = vessel.actuator
    actuators = tuple(replace(each, **tables.get(each.name, {})) for each in listed)
    loads = {name.partition(".")[2]: own for name, own in tables.items() if name.startswith("effects.")}
    changed = {name: own for name, own in loads.items() if name in vessel.effects or own != {"factor": 1.0}}
    return replace(vessel, **parts, actuator=actuators, effects={**vessel.effects, **changed})
