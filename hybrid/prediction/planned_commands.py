"""The commands that are planned for the seconds to come, from a table: second by second what an order would be.

    second,port_rpm,starboard_rpm,rudder_angle_deg
    0,120,120,0
    5,120,120,-20

An order holds until the next row; what has no column, and what comes before the first row, goes on as it is now.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from acquisition.core.actuators import Actuators, control_names
from acquisition.core.arrays import Floats
from acquisition.core.errors import InputError
from hybrid.prediction.prediction_windows import difference_rad
from hybrid.vessel.actuators import angle_columns, control_units

_PARTS = 20  # of a second: an order may come between two seconds


def read_commands(path: Path, actuators: Actuators) -> pd.DataFrame:
    """The table of a CSV or Parquet file: by ``second`` [s] after the start, columns as the channels of
    ``actuators``.

    Raises :class:`InputError` naming what is missing, unknown, unsorted or no number.
    """
    try:
        table = pd.read_parquet(path) if path.suffix == ".parquet" else pd.read_csv(path, comment="#")
    except (OSError, ValueError) as error:
        raise InputError("cannot be read as a table of commands", where=str(path), why=str(error)) from error
    names, known = [str(name).strip() for name in table.columns], control_names(actuators)
    table.columns = pd.Index(names)
    if "second" not in names:
        raise InputError("has no column second", where=str(path), fix="give the seconds after the start")
    unknown = sorted(set(names) - {"second", *known})
    if unknown or len(set(names)) < len(names) or len(names) < 2:
        raise InputError(
            f"has the columns {', '.join(names)}", where=str(path),
            fix=f"give second and each at most once of {', '.join(known)}",
        )  # fmt: skip
    numbers = table.apply(pd.to_numeric, errors="coerce")
    if table.empty or not np.isfinite(numbers.to_numpy(dtype=float)).all():
        raise InputError("holds cells that are no numbers, or no row", where=str(path))
    if not (np.diff(numbers["second"]) > 0.0).all():
        raise InputError("its seconds do not grow from row to row", where=str(path), fix="sort them, each once")
    return pd.DataFrame(numbers).set_index("second")


def planned_commands(table: pd.DataFrame, now: Floats, actuators: Actuators, horizon_s: int) -> Floats:
    """The mean controls over each second of the horizon [H, controls] in SI, from ``now`` [controls] on.

    ``table`` as of :func:`read_commands`. Angles are averaged the shorter way round.
    """
    times = (np.arange(horizon_s * _PARTS) + 0.5) / _PARTS
    row = np.searchsorted(table.index.to_numpy(dtype=float), times, side="right")  # 0: before the first
    ordered = np.tile(now, (len(table) + 1, 1))
    for column, (name, unit) in enumerate(zip(control_names(actuators), control_units(actuators), strict=True)):
        if name in table:
            ordered[1:, column] = table[name].to_numpy(dtype=float) * unit
    orders, angles = ordered[row], angle_columns(actuators)
    orders[:, angles] = now[angles] + difference_rad(orders[:, angles], now[angles])
    return np.asarray(orders.reshape(horizon_s, _PARTS, -1).mean(axis=1))
