"""What is known of a ship from the start, and what an estimated number is."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from math import isfinite, sqrt

from seatrial.acquisition.core.errors import InputError
from seatrial.hybrid.vessel.parameters import LONGEST_MODEL_M

GRAVITY_MPS2 = 9.80665
SEA_WATER_KGPM3 = 1025.0
_FRESH_BELOW_KGPM3 = 1010.0
_NEAR_ZERO = 0.01


@dataclass(frozen=True, slots=True)
class SourcedValue:
    """A number, its usual relative error (one standard deviation) and where it is from.

    Without an error it is assumed for the reason that ``source`` tells, or given where it tells none.
    """

    value: float
    error: float = 0.0
    source: str = ""

    def times(self, factor: float) -> SourcedValue:
        """The same estimate in another unit."""
        return replace(self, value=factor * self.value)


Estimates = dict[str, SourcedValue]


def with_scatter(value: float, scatter: float, source: str) -> SourcedValue:
    """An estimate from the usual error in its own unit; a relative one of a number near zero is large."""
    return SourcedValue(value, scatter / max(abs(value), _NEAR_ZERO * scatter), source)


@dataclass(frozen=True, slots=True, kw_only=True)
class MainParticulars:
    """The main particulars of a ship: length between perpendiculars, beam, mean draught [m], block coefficient.

    ``service_speed_mps`` is the speed through still water that the resistance is estimated for,
    ``centre_of_gravity_m`` lies forward of midship; without it, it is estimated too. Raises :class:`InputError` for
    what no ship has.
    """

    length_m: float
    beam_m: float
    draught_m: float
    block: float
    service_speed_mps: float
    centre_of_gravity_m: float | None = None
    water_density_kgpm3: float = SEA_WATER_KGPM3
    screws: int = 1

    def __post_init__(self) -> None:
        for name, unit, low, value, high in _possible(self):
            if not low < value < high:
                raise InputError(
                    f"{name} is {value:g}{unit}",
                    why=f"a displacement ship has between {low:g} and {high:g}{unit}",
                    fix="check the main particulars and their units",
                )

    @property
    def volume_m3(self) -> float:
        """Displaced volume [m3]."""
        return self.block * self.length_m * self.beam_m * self.draught_m

    @property
    def fullness(self) -> float:
        """Block coefficient times beam by length, which most of the regressions go with."""
        return self.block * self.beam_m / self.length_m

    @property
    def mass(self) -> float:
        """Mass by (1/2) rho L^2 d."""
        return 2.0 * self.fullness

    @property
    def froude(self) -> float:
        """Froude number at service speed."""
        return self.service_speed_mps / sqrt(GRAVITY_MPS2 * self.length_m)

    @property
    def viscosity_m2ps(self) -> float:
        """Kinematic viscosity of water at 15 degrees [m2/s], fresh or salt by its density (ITTC 7.5-02-01-03)."""
        return 1.139e-6 if self.water_density_kgpm3 < _FRESH_BELOW_KGPM3 else 1.188e-6

    @property
    def is_model(self) -> bool:
        """Whether she is of a model's size: tested smooth, without the allowance for a ship's rough plates."""
        return self.length_m < LONGEST_MODEL_M


def _possible(ship: MainParticulars) -> Iterator[tuple[str, str, float, float, float]]:
    """What makes a number impossible rather than unusual: name, unit, low, value, high."""
    yield "the length", " m", 0.5, ship.length_m, 600.0
    yield "the block coefficient", "", 0.3, ship.block, 0.95
    yield "length by beam", "", 1.8, ship.length_m / ship.beam_m, 15.0
    yield "beam by draught", "", 1.2, ship.beam_m / ship.draught_m, 12.0
    yield "the Froude number at service speed", "", 0.01, ship.froude, 0.8
    yield "the centre of gravity by length", "", -0.15, (ship.centre_of_gravity_m or 0.0) / ship.length_m, 0.15


_SAMPLES = {
    "hull and rudder": (
        ("block coefficient", 0.50, 0.86),
        ("length by beam", 2.6, 8.0),
        ("beam by draught", 2.0, 5.0),
        ("Froude number", 0.0, 0.35),
    ),
    "resistance": (("length by beam", 3.9, 15.0), ("beam by draught", 2.1, 4.0)),
}
"""The ships that each group of regressions comes from: merchant ships and fishing vessels; Holtrop's own limits."""


def outside_samples(ship: MainParticulars) -> list[str]:
    """What of a ship lies outside the ships that the regressions come from, a sentence each: errors are larger."""
    values = {
        "block coefficient": ship.block,
        "length by beam": ship.length_m / ship.beam_m,
        "beam by draught": ship.beam_m / ship.draught_m,
        "Froude number": ship.froude,
    }
    return [
        f"{name} {values[name]:.3g} is outside {low:g} to {high:g}, the sample of the regressions of {what}"
        for what, limits in _SAMPLES.items()
        for name, low, high in limits
        if not low <= values[name] <= high
    ]


DIGITS = 5
Cell = str | float | SourcedValue


@dataclass(frozen=True, slots=True)
class Table:
    """A table of the file: its head, what its numbers are called in ``[estimated]``, and its rows."""

    head: str
    label: str
    rows: dict[str, Cell]


def text_of(table: Table) -> str:
    """A table as TOML, a comment at each number that was not given."""
    return "\n".join([table.head, *(_row(key, cell) for key, cell in table.rows.items())]) + "\n"


def estimated(tables: Iterable[Table]) -> str:
    """The table of relative errors of all numbers that a regression gave."""
    rows = [
        f'"{table.label}.{key}" = {_number(round(cell.error, 3))}'
        for table in tables
        for key, cell in table.rows.items()
        if isinstance(cell, SourcedValue) and cell.error > 0.0
    ]
    return "\n".join(["[estimated]", *rows]) + "\n"


def _row(key: str, cell: Cell) -> str:
    if isinstance(cell, str):
        return f"{key} = {json.dumps(cell)}"
    number = cell if isinstance(cell, SourcedValue) else SourcedValue(cell)
    text = f"{key} = {_number(number.value)}"
    error = f"+-{100.0 * number.error:.0f} %: " if number.error > 0.0 else ""
    return f"{text:<34}  # {error}{number.source}" if number.source else text


def _number(value: float) -> str:
    assert isfinite(value)
    return repr(float(f"{value:.{DIGITS}g}"))
