"""A vessel's numbers: the frozen objects that a vessel file is read into.

The equations that use them are in ``hulls``, ``actuators``, ``wind.py`` and ``dynamics.py``; the file format is in
``files.py``. SI units and radians unless a name says otherwise.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Any, Literal, Union

from pydantic import Discriminator, Tag
from pydantic import StrictFloat as Number  # a text or a truth value is no number

from seatrial.acquisition.core.ship import Actuator, Actuators
from seatrial.hybrid.vessel.actuators import KINDS, ActuatorEntry
from seatrial.hybrid.vessel.hulls import HULLS
from seatrial.hybrid.vessel.hulls.kind import HullEntry
from seatrial.hybrid.vessel.wind import FujiwaraWind, NoWind, Wind

if TYPE_CHECKING:
    AnyActuator = ActuatorEntry
    AnyHull = HullEntry
else:  # the kinds' and models' entries, distinguished by a word in them
    AnyActuator = Annotated[Union[tuple(kind.entry for kind in KINDS.values())], Discriminator("kind")]  # noqa: UP007
    AnyHull = Annotated[Union[tuple(model.entry for model in HULLS.values())], Discriminator("model")]  # noqa: UP007

_STRICT = {"extra": "forbid"}
Values = Mapping[str, Number]
Provenance = Mapping[str, str | float | int | bool]
LONGEST_MODEL_M = 20.0
"""What is shorter is of a model's size."""


@dataclass(frozen=True, slots=True)
class Dimensions:
    """Main dimensions [m]."""

    length_overall_m: Number
    length_between_perpendiculars_m: Number
    beam_m: Number
    draught_m: Number

    @property
    def is_model(self) -> bool:
        """Whether the ship is of a model's size."""
        return self.length_between_perpendiculars_m < LONGEST_MODEL_M


@dataclass(frozen=True, slots=True)
class Validity:
    """Speeds through the water that the coefficients hold in [m/s, rad/s]; sway and yaw either way."""

    surge_low_mps: Number
    surge_high_mps: Number
    sway_mps: Number
    yaw_rate_radps: Number


@dataclass(frozen=True, slots=True)
class Inertia:
    """Rigid body and added mass; Yrd = Nvd.

    ``yaw_inertia_kgm2`` is about the centre of gravity, ``centre_of_gravity_m`` how far ahead of the origin of the
    body axes that lies; the added masses are about the origin.
    """

    mass_kg: Number
    yaw_inertia_kgm2: Number
    Xud: Number
    Yvd: Number
    Yrd: Number
    Nrd: Number
    centre_of_gravity_m: Number = 0.0
    model: Literal["si"] = "si"

    def in_si(self, vessel: Vessel) -> Inertia:
        """Itself."""
        return self


@dataclass(frozen=True, slots=True, kw_only=True)
class PrimedInertia:
    """Rigid body and added mass without dimension, as the MMG method writes them.

    Masses by rho/2 L^2 d, moments of inertia by rho/2 L^4 d, ``x_G`` by L; ``I_zG`` is about the centre of gravity.
    """

    model: Literal["primed"]
    m: Number
    m_x: Number
    m_y: Number
    I_zG: Number
    J_z: Number
    x_G: Number = 0.0

    def in_si(self, vessel: Vessel) -> Inertia:
        """These numbers in SI."""
        L = vessel.dimensions.length_between_perpendiculars_m
        mass = 0.5 * vessel.water_density_kgpm3 * L**2 * vessel.dimensions.draught_m
        inertia = mass * L**2
        return Inertia(
            self.m * mass,
            self.I_zG * inertia,
            -self.m_x * mass,
            -self.m_y * mass,
            0.0,
            -self.J_z * inertia,
            self.x_G * L,
        )


AnyWind = Annotated[Wind | FujiwaraWind | NoWind, Discriminator("model")]


AnyInertia = Annotated[
    Annotated[Inertia, Tag("si")] | Annotated[PrimedInertia, Tag("primed")],
    Discriminator(lambda value: str(value.get("model", "si") if isinstance(value, Mapping) else value.model)),
]


@dataclass(frozen=True, slots=True)
class Vessel:
    """A whole vessel as its file states it.

    ``actuator`` has an entry for each actuator; their order is that of the controls. ``effects`` are additions to
    the model, name to parameter values in the units of the parameters' names; ``base`` is the vessel that the
    file built upon, if it did; ``provenance`` is free text and numbers about where the values come from.
    ``estimated`` are the usual relative errors, one standard deviation, of numbers that a regression gave, by
    ``TABLE.NUMBER`` or ``ACTUATOR.NUMBER``.
    """

    name: str
    water_density_kgpm3: Number
    dimensions: Dimensions
    validity: Validity
    inertia: AnyInertia
    hull: AnyHull
    wind: AnyWind
    actuator: tuple[AnyActuator, ...]
    description: str = ""
    base: str = ""
    effects: Mapping[str, Values] = field(default_factory=dict)
    provenance: Provenance = field(default_factory=dict)
    estimated: Mapping[str, Number] = field(default_factory=dict)

    @property
    def actuators(self) -> Actuators:
        """The names and kinds of the actuators, in the order of their controls."""
        return tuple(Actuator(actuator.name, actuator.kind) for actuator in self.actuator)

    def of_kind(self, kind: str) -> tuple[Any, ...]:
        """The actuators of one kind."""
        return tuple(actuator for actuator in self.actuator if actuator.kind == kind)


_PARTS = (Dimensions, Validity, Inertia, PrimedInertia, Wind, FujiwaraWind, NoWind, Vessel)
_ENTRIES = (*(model.entry for model in HULLS.values()), *(kind.entry for kind in KINDS.values()))
for _part in (*_PARTS, *_ENTRIES):
    setattr(_part, "__pydantic_config__", _STRICT)  # noqa: B010 - not an attribute that mypy knows
