"""A vessel's numbers: the frozen objects that a vessel file is read into, and nothing computed.

The equations that use them are in ``hull.py``, ``thrusters.py``, ``wind.py`` and ``drift.py``; the file
format is in ``files.py``. SI units and radians unless a name says otherwise.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from pydantic import StrictFloat as Number  # a text or a truth value is no number

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


@dataclass(frozen=True, slots=True)
class Surge:
    """Hull coefficients of X; ``absv`` stands for \\|v\\|."""

    Xuu: Number
    Xvv: Number
    Xrr: Number
    Xrv: Number
    Xuvv: Number
    Xrvu: Number
    Xurr: Number
    Xu_absv: Number


@dataclass(frozen=True, slots=True)
class Sway:
    """Hull coefficients of Y; ``absr`` and ``absv`` stand for \\|r\\| and \\|v\\|."""

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


@dataclass(frozen=True, slots=True)
class Yaw:
    """Hull coefficients of N; ``absr`` and ``absv`` stand for \\|r\\| and \\|v\\|."""

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
class Pods:
    """Two like azimuth pods: places, propeller, force coefficients, and what their drives can do."""

    port_x_m: Number
    port_y_m: Number
    starboard_x_m: Number
    starboard_y_m: Number
    diameter_m: Number
    thrust_nn: Number
    thrust_nu: Number
    thrust_uu: Number
    side_nv: Number
    side_uv: Number
    side_vv: Number
    limit_rpm: Number
    azimuth_rate_limit_dps: Number
    azimuth_lag_s: Number
    shaft_lag_s: Number


@dataclass(frozen=True, slots=True)
class Tunnel:
    """The tunnel thruster: place, side force as a polynomial of the shaft speed in rpm, and its drive."""

    x_m: Number
    cubic_n: Number
    quadratic_n: Number
    linear_n: Number
    limit_rpm: Number
    shaft_lag_s: Number


@dataclass(frozen=True, slots=True)
class Wind:
    """Windage areas and the coefficients at 0, 10, ... 180 degrees off the bow."""

    frontal_area_m2: Number
    lateral_area_m2: Number
    air_density_kgpm3: Number
    CX: Table
    CY: Table
    CN: Table


@dataclass(frozen=True, slots=True)
class Vessel:
    """A whole vessel as its file states it.

    ``effects`` are additions to the model, name to parameter values in the units of the parameters' names;
    ``base`` is the vessel that the file built upon, if it did; ``provenance`` is free text and numbers about
    where the values come from.
    """

    name: str
    water_density_kgpm3: Number
    dimensions: Dimensions
    validity: Validity
    inertia: Inertia
    surge: Surge
    sway: Sway
    yaw: Yaw
    pods: Pods
    tunnel: Tunnel
    wind: Wind
    description: str = ""
    base: str = ""
    effects: Mapping[str, Values] = field(default_factory=dict)
    provenance: Provenance = field(default_factory=dict)


for _part in (Dimensions, Validity, Inertia, Surge, Sway, Yaw, Pods, Tunnel, Wind, Vessel):
    setattr(_part, "__pydantic_config__", _STRICT)  # noqa: B010 - not an attribute that mypy knows
