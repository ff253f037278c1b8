"""Effects that no catalogue holds: an honest diagnosis must say that it does not know them. Some that change."""

from __future__ import annotations

from collections.abc import Mapping
from math import cos, sin, tanh
from typing import NamedTuple

import numpy as np
from numba import njit

from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.acquisition.core.quantities import Floats

OUTSIDE = ("yaw_moment_4psi", "sheared_current", "bank_suction", "fading_thrust", "one_sided_stall")
CHANGING = ("tide_north_mps", "tide_east_mps", "tow_n", "tow_share")
"""Of effects of the catalogue that change in a trial: by how much the current to the north and east has turned at
its end; a tow, and for what share of the trial it is there."""
SHEAR_BOUND_MPS = 0.5
BANK_REACH_M, BANK_SOFT_M, BANK_ASIDE_M, BANK_LEVER_M = 150.0, 20.0, 60.0, 4.0
STALL_RAD, STALL_WIDTH_RAD = 25.0 * np.pi / 180.0, 1.0 * np.pi / 180.0


class Outside(NamedTuple):
    """Sizes of the effects, zero where absent, and where they lie."""

    yaw_moment_nm: float = 0.0
    shear_per_s: float = 0.0
    shear_to_rad: float = 0.0
    bank_n: float = 0.0
    bank_north_m: float = 0.0
    bank_east_m: float = 0.0
    bank_along_rad: float = 0.0
    fading: float = 0.0
    fading_from_s: float = 0.0
    fading_over_s: float = 1.0
    stall: float = 0.0
    tide_north_mps: float = 0.0
    tide_east_mps: float = 0.0
    tow_n: float = 0.0
    tow_share: float = 1.0


def outside_of(sizes: Mapping[str, float], shear_to_rad: float, from_s: float, over_s: float) -> Outside:
    """The effects from their sizes: N m, m/s per 100 m, N, and fractions; fading runs from ``from_s`` on.

    Raises :class:`ConfigurationError` for a name that is not known.
    """
    possible = (*OUTSIDE, *CHANGING)
    unknown = [name for name in sizes if name not in possible]
    if unknown:
        raise ConfigurationError(
            f"no effect {unknown[0]!r} outside the catalogue", fix=f"use {', '.join(possible)}"
        )
    moment, shear, bank, fading, stall = (float(sizes.get(name, 0.0)) for name in OUTSIDE)
    return Outside(
        moment,
        shear / 100.0,
        shear_to_rad,
        bank,
        fading=fading,
        fading_from_s=float(from_s),
        fading_over_s=float(over_s),  # of a whole number all would be compiled once more
        stall=stall,
        **{name: float(sizes[name]) for name in CHANGING if name in sizes},
    )


def with_bank_beside(outside: Outside, north_m: Floats, east_m: Floats) -> Outside:
    """The bank along the main direction of a track, so far beside its middle that the ship feels it."""
    track = np.column_stack([north_m, east_m])
    middle = np.median(track, axis=0)
    along = np.linalg.svd(track[:: max(1, len(track) // 2000)] - middle, full_matrices=False)[2][0]
    place = middle + BANK_ASIDE_M * np.array([-along[1], along[0]])
    return outside._replace(
        bank_north_m=place[0], bank_east_m=place[1], bank_along_rad=np.arctan2(along[1], along[0])
    )


@njit(error_model="numpy")
def sheared(o: Outside, north_m: float, east_m: float) -> tuple[float, float]:
    """Speed of the sheared current [m/s] and its growth across its direction [1/s].

    The middle is at rest; far out the current grows no more, turns back and so on, so that no long track is
    ever in a uniform one.
    """
    across = east_m * cos(o.shear_to_rad) - north_m * sin(o.shear_to_rad)
    phase = o.shear_per_s * across / SHEAR_BOUND_MPS
    return SHEAR_BOUND_MPS * sin(phase), o.shear_per_s * cos(phase)


@njit(error_model="numpy")
def bank_force(o: Outside, north_m: float, east_m: float, heading_rad: float) -> tuple[float, float]:
    """Sway force towards the bank [N] and moment that turns the bow away from it [N m]."""
    away = (east_m - o.bank_east_m) * cos(o.bank_along_rad) - (north_m - o.bank_north_m) * sin(o.bank_along_rad)
    pull = -o.bank_n * tanh(away / BANK_SOFT_M) * np.exp(-abs(away) / BANK_REACH_M)
    Y = pull * cos(o.bank_along_rad - heading_rad)
    return Y, -BANK_LEVER_M * Y


@njit(error_model="numpy")
def through(o: Outside, time_s: float) -> float:
    """The share of the trial that is through."""
    return min(max((time_s - o.fading_from_s) / o.fading_over_s, 0.0), 1.0)


@njit(error_model="numpy")
def tow(o: Outside, time_s: float) -> float:
    """What a tow holds the ship back with [N], until it is dropped."""
    return o.tow_n if through(o, time_s) < o.tow_share else 0.0


@njit(error_model="numpy")
def thrust_left(o: Outside, time_s: float) -> float:
    """The share of thrust that is left by now."""
    return 1.0 - o.fading * through(o, time_s)


@njit(error_model="numpy")
def lift_left(o: Outside, angle_rad: float) -> float:
    """The share of a pod's lift that is left at an azimuth angle: it stalls on the starboard side only."""
    return 1.0 - 0.5 * o.stall * (1.0 + tanh((angle_rad - STALL_RAD) / STALL_WIDTH_RAD))
