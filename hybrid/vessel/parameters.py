"""A vessel's numbers: the frozen objects that a vessel file is read into, and nothing computed.

The equations that use them are in ``hull.py``, ``actuators``, ``wind.py`` and ``drift.py``; the file format is in
``files.py``. SI units and radians unless a name says otherwise.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Any, Literal, Union

from pydantic import Discriminator
from pydantic import StrictFloat as Number  # a text or a truth value is no number

from acquisition.core.actuators import Actuators
from hybrid.vessel.actuators import KINDS, Entry, list_of

if TYPE_CHECKING:
    AnyActuator = Entry
else:  # the kinds' entries, told apart by `kind`
    AnyActuator = Annotated[Union[tuple(kind.entry for kind in KINDS.values())], Discriminator("kind")]  # noqa: UP007

_STRICT = {"extra": "forbid"}
Table = tuple[Number, ...]
Values = Mapping[str, Number]
Provenance = Mapping[str, str | float | int | bool]


@dataclass(frozen=True, slots=True)
class Dimensions:
    """Main dimensions [m]."""

    length_overall_m: Number
    length_between_perpendiculars_m: Number
    beam_m: Number
    draught_m: Number


@dataclass(frozen=True, slots=True)
class Validity:
    """Speeds through the water that the coefficients hold in [m/s, rad/s]; sway and yaw either way."""

    surge_low_mps: Number
    surge_high_mps: Number
    sway_mps: Number
    yaw_rate_radps: Number


@dataclass(frozen=True, slots=True)
class Inertia:
    """Rigid body and added mass about the centre of gravity; Yrd = Nvd."""

    mass_kg: Number
    yaw_inertia_kgm2: Number
    Xud: Number
    Yvd: Number
    Yrd: Number
    Nrd: Number


@dataclass(frozen=True, slots=True, kw_only=True)
class Polynomial:
    """A hull as a polynomial of u, v, r by Fossen's names; ``absr``, ``absv`` stand for \\|r\\| and \\|v\\|."""

    model: Literal["polynomial"]
    Xuu: Number
    Xvv: Number
    Xrr: Number
    Xrv: Number
    Xuvv: Number
    Xrvu: Number
    Xurr: Number
    Xu_absv: Number
    Yuv: Number
    Yur: Number
    Yuur: Number
    Yuuv: Number
    Yvvv: Number
    Yrrr: Number
    Yrrv: Number
    Yvvr: Number
    Y_absr_v: Number
    Y_absv_v: Number
    Y_absr_r: Number
    Y_absv_r: Number
    Nuv: Number
    Nur: Number
    Nuur: Number
    Nuuv: Number
    Nvvv: Number
    Nrrr: Number
    Nrrv: Number
    Nvvr: Number
    N_absr_v: Number
    N_absv_v: Number
    N_absr_r: Number
    N_absv_r: Number


@dataclass(frozen=True, slots=True)
class Wind:
    """Windage areas and the coefficients at 0, 10, ... 180 degrees off the bow."""

    model: Literal["coefficients"]
    frontal_area_m2: Number
    lateral_area_m2: Number
    air_density_kgpm3: Number
    CX: Table
    CY: Table
    CN: Table


@dataclass(frozen=True, slots=True)
class Vessel:
    """A whole vessel as its file states it.

    ``actuator`` has an entry for each actuator; their order is that of the controls. ``effects`` are additions to
    the model, name to parameter values in the units of the parameters' names; ``base`` is the vessel that the
    file built upon, if it did; ``provenance`` is free text and numbers about where the values come from.
    """

    name: str
    water_density_kgpm3: Number
    dimensions: Dimensions
    validity: Validity
    inertia: Inertia
    hull: Polynomial
    wind: Wind
    actuator: tuple[AnyActuator, ...]
    description: str = ""
    base: str = ""
    effects: Mapping[str, Values] = field(default_factory=dict)
    provenance: Provenance = field(default_factory=dict)

    @property
    def actuators(self) -> Actuators:
        """The names and kinds of the actuators, in the order of their controls."""
        return list_of(self.actuator)

    def of_kind(self, kind: str) -> tuple[Any, ...]:
        """The actuators of one kind."""
        return tuple(each for each in self.actuator if each.kind == kind)


for _part in (Dimensions, Validity, Inertia, Polynomial, Wind, Vessel, *(kind.entry for kind in KINDS.values())):
    setattr(_part, "__pydantic_config__", _STRICT)  # noqa: B010 - not an attribute that mypy knows
