"""Between the channels of a table, in their contractual units, and the simulator's SI arrays."""

from __future__ import annotations

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from seatrial.acquisition.core.errors import InputError
from seatrial.acquisition.core.quantities import Floats
from seatrial.acquisition.core.ship import (
    DEFAULT,
    ENVIRONMENT,
    POSE_AND_VELOCITY,
    Actuators,
    control_names,
    unwrap,
    wrap_180,
    wrap_360,
)
from seatrial.analysis.tables.table import table_actuators
from seatrial.hybrid.vessel.actuators import angle_columns, control_units
from seatrial.hybrid.vessel.plant import Plant

STATE_UNITS = np.array([1.0, 1.0, np.pi / 180.0, 1.0, 1.0, np.pi / 180.0])
WIND_UNITS = np.array([np.pi / 180.0, 1.0])


def check_ship(recorded: Actuators, plant: Plant) -> None:
    """Raise :class:`InputError` where a recording is of a ship with other actuators than the model has."""
    if recorded != plant.layout:
        raise InputError(
            f"the recording is of a ship with {in_words(recorded)}, the model of one with {in_words(plant.layout)}",
            fix="give the recorded ship's file with --vessel, or a calibrator of this ship",
        )


def in_words(actuators: Actuators) -> str:
    """Actuators by name and kind."""
    return ", ".join(f"{actuator.name} ({actuator.kind})" for actuator in actuators)


def states_of(table: pd.DataFrame) -> Floats:
    """North, east [m], heading [rad, unwrapped], surge, sway [m/s], yaw rate [rad/s]: [rows, 6]."""
    values = _columns(table, POSE_AND_VELOCITY)
    values[:, 2] = unwrap(values[:, 2])
    return np.asarray(values * STATE_UNITS)


def controls_of(table: pd.DataFrame, actuators: Actuators | None = None) -> Floats:
    """The controls of a ship in SI, actuator by actuator: [rows, controls]; by default those that a table is of."""
    actuators = table_actuators(table) if actuators is None else actuators
    return np.asarray(_columns(table, control_names(actuators)) * control_units(actuators))


def wind_of(table: pd.DataFrame) -> Floats:
    """Direction the wind comes from [rad] and its speed [m/s]: [rows, 2]."""
    return np.asarray(_columns(table, ENVIRONMENT) * WIND_UNITS)


def as_table(
    states: ArrayLike, controls: ArrayLike, wind: ArrayLike, index: pd.Index, actuators: Actuators = DEFAULT
) -> pd.DataFrame:
    """The channels from states [rows, 6], controls [rows, controls] and wind [rows, 2], angles wrapped."""
    motion = np.asarray(states, dtype=np.float64) / STATE_UNITS
    command = np.asarray(controls, dtype=np.float64) / control_units(actuators)
    air = np.asarray(wind, dtype=np.float64) / WIND_UNITS
    motion[:, 2], air[:, 0] = wrap_360(motion[:, 2]), wrap_360(air[:, 0])
    angles = angle_columns(actuators)
    command[:, angles] = wrap_180(command[:, angles])
    names = [*POSE_AND_VELOCITY, *ENVIRONMENT, *control_names(actuators)]
    return pd.DataFrame(np.hstack([motion, air, command]), index=index, columns=names)


def _columns(table: pd.DataFrame, names: tuple[str, ...]) -> Floats:
    missing = [name for name in names if name not in table.columns]
    if missing:
        raise InputError(
            f"the table lacks {', '.join(missing)}", fix="give all channels, or map the columns to them"
        )
    return table[list(names)].to_numpy(dtype=np.float64, copy=True)
