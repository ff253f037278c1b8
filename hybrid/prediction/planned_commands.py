"""The commands that are planned for the seconds to come, from a table: when each order would be given.

    second,port_rpm,starboard_rpm,rudder_angle_deg      time,rudder_angle_deg
    0,120,120,0                                         2026-06-01T10:00:00Z,0
    5,120,120,-20                                       2026-06-01T10:04:30Z,-20

``second`` counts from the start of a prediction; ``time`` is ISO 8601 with zone, or seconds since 1970. An order
holds until the next row; what has no column, and what comes before the first row, goes on as it is now. The last
order by ``time`` holds for one horizon: then the plan is over.
"""

from __future__ import annotations

from io import BytesIO
from pathlib import Path

import numpy as np
import pandas as pd

from seatrial.acquisition.core.errors import InputError
from seatrial.acquisition.core.files import read_regular
from seatrial.acquisition.core.process import CONFIGURATION_BYTES, read_in_child
from seatrial.acquisition.core.quantities import Floats
from seatrial.acquisition.core.ship import Actuators, control_names
from seatrial.acquisition.tables.table_files import FOREIGN_READER, RawTable
from seatrial.acquisition.tables.time_columns import parse_times
from seatrial.hybrid.prediction.prediction_windows import difference_rad
from seatrial.hybrid.vessel.actuators import angle_columns, control_units

_PARTS = 20  # of a second: orders may come between full seconds


def read_commands(path: Path, actuators: Actuators) -> pd.DataFrame:
    """The table of a CSV or Parquet file: by ``second`` [s] after the start or by ``time`` (UTC), columns as the
    channels of ``actuators``.

    Raises :class:`InputError` naming what is missing, unknown, unsorted or no number.
    """
    try:
        if path.suffix == ".parquet":
            table = read_in_child(FOREIGN_READER, "parquet", path).to_pandas()
        else:
            table = pd.read_csv(BytesIO(read_regular(path, CONFIGURATION_BYTES)), comment="#")
    except InputError:
        raise
    except (OSError, ValueError) as error:
        raise InputError("cannot be read as a table of commands", where=str(path), why=str(error)) from error
    names, known = [str(name).strip() for name in table.columns], control_names(actuators)
    table.columns = pd.Index(names)
    when = next((name for name in names if name in ("second", "time")), None)
    if when is None:
        raise InputError(
            "has no column second or time", where=str(path), fix="give the seconds after the start, or the times"
        )
    unknown = sorted(set(names) - {when, *known})
    if unknown or len(set(names)) < len(names) or len(names) < 2:
        raise InputError(
            f"has the columns {', '.join(names)}", where=str(path),
            fix=f"give second or time, and each at most once of {', '.join(known)}",
        )  # fmt: skip
    if when == "time" and len(table):
        table["time"] = parse_times(RawTable(path, table), "time")
    else:
        table[when] = pd.to_numeric(table[when], errors="coerce").replace(np.inf, np.nan)
    orders = pd.DataFrame(table.set_index(when).apply(pd.to_numeric, errors="coerce"))
    if orders.empty or orders.index.hasnans or not np.isfinite(orders.to_numpy(dtype=float)).all():
        raise InputError("contains cells that are not numbers, or no row", where=str(path))
    if not (orders.index.is_monotonic_increasing and orders.index.is_unique):
        raise InputError(
            f"its {when}s do not increase from row to row", where=str(path), fix="sort them, each once"
        )
    return orders


def commands_from(table: pd.DataFrame, at: pd.Timestamp, horizon_s: int) -> pd.DataFrame | None:
    """The table of :func:`read_commands` by seconds after ``at``; None if it is by ``time`` and begins after
    the horizon or is over.

    Rows before ``at`` are kept: the last of them is the current order.
    """
    if not isinstance(table.index, pd.DatetimeIndex):
        return table
    seconds = (table.index - at) / pd.Timedelta(seconds=1)
    return table.set_axis(seconds) if seconds[0] < horizon_s and seconds[-1] > -horizon_s else None


def planned_commands(table: pd.DataFrame, now: Floats, actuators: Actuators, horizon_s: int) -> Floats:
    """The mean controls over each second of the horizon [H, controls] in SI, starting from ``now`` [controls].

    ``table`` comes from :func:`commands_from`. Angles are averaged the shorter way round.
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
