"""Typical coefficients of wind resistance by kind of ship, where those of the ship herself are not known.

From the data sets of ITTC 7.5-04-01-01.1 (2021), section F.3, which ISO 15016:2015, annex C, has too: wind tunnel
results of the STA joint industry project. The standard itself was not at hand. The numbers are those in which two
independent transcriptions agree; of the tanker in ballast there was one. The other kinds of the standard, such as
car carriers and ferries, are left out: of them there was one, read off charts.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from seatrial.acquisition.config.conditions import Conditions, WindType
from seatrial.acquisition.core.errors import InputError
from seatrial.acquisition.tables.table_files import read_raw

TYPICAL_WIND_RESISTANCE: dict[WindType, tuple[float, ...]] = {
    "tanker_loaded": (
        0.96, 0.93, 0.85, 0.73, 0.62, 0.47, 0.34, 0.17, 0.06, -0.05,
        -0.14, -0.22, -0.29, -0.40, -0.53, -0.66, -0.75, -0.79, -0.77,
    ),
    "tanker_ballast": (
        0.86, 0.76, 0.62, 0.45, 0.32, 0.21, 0.13, 0.06, 0.04, -0.02,
        -0.08, -0.19, -0.29, -0.38, -0.47, -0.56, -0.61, -0.66, -0.63,
    ),
    "gas_carrier_prismatic": (
        1.02, 0.99, 0.93, 0.83, 0.67, 0.48, 0.30, 0.14, 0.03, -0.05,
        -0.11, -0.24, -0.41, -0.56, -0.68, -0.79, -0.88, -0.92, -0.91,
    ),
    "container_loaded": (
        1.01, 1.11, 1.11, 0.95, 0.74, 0.46, 0.13, -0.28, -0.77, -1.09, -1.18, -1.19, -0.94,
    ),
    "general_cargo": (
        0.60, 0.87, 1.00, 1.00, 0.88, 0.85, 0.65, 0.42, 0.27, 0.09,
        -0.09, -0.49, -0.84, -1.15, -1.39, -1.47, -1.34, -0.92, -0.82,
    ),
}  # fmt: skip
"""C_AA at equal steps from 0 to 180 deg off the bow: a tanker of 280,000 dwt with a conventional bow, a gas carrier
with integrated prismatic tanks, a container ship of 6800 TEU with containers, a general cargo ship."""


def wind_resistance_of(given: Conditions) -> tuple[float, ...]:
    """C_AA of a ship at equal steps from 0 to 180 deg off the bow: its own, else those typical of its kind."""
    if given.wind_resistance or given.wind_resistance_type is None:
        return given.wind_resistance
    return TYPICAL_WIND_RESISTANCE[given.wind_resistance_type]


def read_wind_resistance(path: Path | str) -> tuple[float, ...]:
    """C_AA every 5 deg from 0 to 180 off the bow, of a table with the columns ``angle`` [deg] and ``C_AA``.

    Raises :class:`InputError` for a table without them, or whose angles do not go from 0 to 180 deg.
    """
    table = read_raw(path).columns
    named = {str(name).lower().split("[")[0].strip().removesuffix("_deg"): name for name in table.columns}
    if not {"angle", "c_aa"} <= named.keys():
        raise InputError(
            "has no columns angle and C_AA", where=str(path), why=f"it has {', '.join(map(str, table.columns))}",
            fix="name the angle off the bow 'angle [deg]' and the coefficient 'C_AA'",
        )  # fmt: skip
    try:
        angle, drag = (table[named[name]].to_numpy(dtype=float) for name in ("angle", "c_aa"))
    except ValueError as error:
        raise InputError("holds text among its numbers", where=str(path), why=str(error)) from error
    order = np.argsort(angle)
    if not (np.isfinite([angle, drag]).all() and angle.size > 2 and np.ptp(angle) == angle.max() == 180.0):
        raise InputError(
            "does not go from 0 to 180 deg", where=str(path), fix="give C_AA from 0 to 180 deg off the bow"
        )
    if np.interp(0.0, angle[order], drag[order]) <= 0.0:
        raise InputError(
            "has no resistance to the wind from ahead", where=str(path),
            fix="change the sign: C_AA is positive where the air brakes, C_X the other way round",
        )  # fmt: skip
    return tuple(map(float, np.interp(np.arange(0.0, 181.0, 5.0), angle[order], drag[order])))
