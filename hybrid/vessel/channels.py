"""Between the 13 channels of a table, in their contractual units, and the simulator's SI arrays."""

from __future__ import annotations

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from acquisition.core.angles import unwrap, wrap_180, wrap_360
from acquisition.core.arrays import Floats
from acquisition.core.channels import COMMAND, ENVIRONMENT, NAMES, POSE, VELOCITY
from acquisition.core.errors import InputError

RPM_PER_RPS = 60.0
STATE_UNITS = np.array([1.0, 1.0, np.pi / 180.0, 1.0, 1.0, np.pi / 180.0])
CONTROL_UNITS = np.array([1.0 / RPM_PER_RPS, np.pi / 180.0, 1.0 / RPM_PER_RPS, np.pi / 180.0, 1.0])
_WIND_UNITS = np.array([np.pi / 180.0, 1.0])


def states_of(table: pd.DataFrame) -> Floats:
    """North, east [m], heading [rad, unwrapped], surge, sway [m/s], yaw rate [rad/s]: [rows, 6]."""
    values = _columns(table, (*POSE, *VELOCITY))
    values[:, 2] = unwrap(values[:, 2])
    return np.asarray(values * STATE_UNITS)


def controls_of(table: pd.DataFrame) -> Floats:
    """Port [rev/s], its angle [rad], starboard [rev/s], its angle [rad], tunnel [rpm]: [rows, 5]."""
    return np.asarray(_columns(table, COMMAND) * CONTROL_UNITS)


def wind_of(table: pd.DataFrame) -> Floats:
    """Direction the wind comes from [rad] and its speed [m/s]: [rows, 2]."""
    return np.asarray(_columns(table, ENVIRONMENT) * _WIND_UNITS)


def as_table(states: ArrayLike, controls: ArrayLike, wind: ArrayLike, index: pd.Index) -> pd.DataFrame:
    """The 13 channels from states [rows, 6], controls [rows, 5] and wind [rows, 2], angles wrapped."""
    motion = np.asarray(states, dtype=np.float64) / STATE_UNITS
    command = np.asarray(controls, dtype=np.float64) / CONTROL_UNITS
    air = np.asarray(wind, dtype=np.float64) / _WIND_UNITS
    motion[:, 2], air[:, 0] = wrap_360(motion[:, 2]), wrap_360(air[:, 0])
    command[:, (1, 3)] = wrap_180(command[:, (1, 3)])
    names = [*POSE, *VELOCITY, *ENVIRONMENT, *COMMAND]
    return pd.DataFrame(np.hstack([motion, air, command]), index=index, columns=names)[list(NAMES)]


def _columns(table: pd.DataFrame, names: tuple[str, ...]) -> Floats:
    missing = [name for name in names if name not in table.columns]
    if missing:
        raise InputError(
            f"the table lacks {', '.join(missing)}", fix="give all 13 channels, or map the columns to them"
        )
    return table[list(names)].to_numpy(dtype=np.float64, copy=True)
