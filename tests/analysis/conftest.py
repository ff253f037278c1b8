"""What the analysis tests share: tables on whole seconds, and the angles' distance."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from seatrial.acquisition.core.ship import NAMES, angle_difference
from seatrial.analysis.tables.table import NANO, index_of

START_S = 1_573_287_600


def table_at(seconds: ArrayLike, columns: Mapping[str, ArrayLike]) -> pd.DataFrame:
    """A table at times in seconds after a fixed start, which is a whole second."""
    since = np.rint(np.asarray(seconds, dtype=float) * NANO).astype(np.int64)
    return pd.DataFrame(dict(columns), index=index_of(START_S * NANO + since))


def steady_table(seconds: int, noise_rpm: float = 0.0, noise_deg: float = 0.0, seed: int = 0) -> pd.DataFrame:
    """All 13 channels at 1 Hz with every thruster held, white noise on the feedback, azimuths about 180 deg."""
    random = np.random.default_rng(seed)
    values: dict[str, NDArray[np.float64]] = {name: np.ones(seconds) for name in NAMES}
    for name in ("port_rpm", "starboard_rpm", "tunnel_rpm"):
        values[name] = 120.0 + noise_rpm * random.standard_normal(seconds)
    for name in ("port_angle_deg", "starboard_angle_deg"):
        values[name] = angle_difference(180.0 + noise_deg * random.standard_normal(seconds), 0.0)
    return table_at(np.arange(seconds), values)


def turn_between(left_deg: ArrayLike, right_deg: ArrayLike) -> float:
    """The largest turn between two series of angles [deg]."""
    return float(np.abs(angle_difference(left_deg, right_deg)).max())
