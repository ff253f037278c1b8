"""Windows as arrays in SI units and radians: what every prediction method starts from and is judged by.

A method may see the start of a window only: the state, the wind and the thrusters at second 0. What follows
is the measured track that its prediction is compared with.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from acquisition.angles import difference, unwrap
from acquisition.channels import NAMES, POSE, VELOCITY
from acquisition.errors import DataShortageError

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Horizons:
    """N windows of H seconds, arrays with N first.

    ``start`` [N, 6]: north, east [m], heading [rad], surge, sway [m/s], yaw rate [rad/s] at second 0;
    ``track`` [N, H+1, 3]: measured north, east [m] and heading [rad] without jumps, second by second;
    ``wind`` [N, 2]: direction it comes from [rad], speed [m/s]; ``control`` [N, 5]: port [rev/s], port angle
    [rad], starboard [rev/s], starboard angle [rad], tunnel [rpm]; ``trial``, ``leg`` [N] name where each
    window comes from and ``start_time`` [N] when it starts.
    """

    start: Floats
    track: Floats
    wind: Floats
    control: Floats
    trial: NDArray[np.str_]
    leg: NDArray[np.str_]
    start_time: pd.DatetimeIndex

    def __len__(self) -> int:
        return len(self.start)

    @property
    def horizon_s(self) -> int:
        """The length of the windows [s]."""
        return int(self.track.shape[1]) - 1

    def subset(self, chosen: NDArray[np.bool_] | NDArray[np.int64]) -> Horizons:
        """The windows that a mask or index chooses."""
        return Horizons(
            self.start[chosen],
            self.track[chosen],
            self.wind[chosen],
            self.control[chosen],
            self.trial[chosen],
            self.leg[chosen],
            self.start_time[chosen],
        )


def from_rows(rows: pd.DataFrame, motion: pd.DataFrame | None = None) -> Horizons:
    """Arrays from the long table of held windows: one row a window and second, second 0 first.

    ``motion`` has the state that each window starts from, in the order of the windows' numbers; without it
    the measured values at second 0 are taken.

    Raises :class:`DataShortageError` when there is no window in it.
    """
    if rows.empty:
        raise DataShortageError("no held window to work with", fix="lower --horizon or record held stretches")
    ordered = rows.sort_values(["window", "second"], kind="stable")
    count = ordered["window"].nunique()
    cube = ordered[list(NAMES)].to_numpy(dtype=float).reshape(count, -1, len(NAMES))
    value = {name: cube[:, :, column] for column, name in enumerate(NAMES)}
    first = ordered.groupby("window", sort=True).first()
    heading = np.deg2rad(np.apply_along_axis(unwrap, 1, value["heading_deg"]))
    track = np.stack([value["north_m"], value["east_m"], heading], axis=-1)
    return Horizons(
        start=_start(value, motion),
        track=track,
        wind=np.column_stack([np.deg2rad(value["wind_direction_deg"][:, 0]), value["wind_speed_mps"][:, 0]]),
        control=_control(value),
        trial=first["trial"].to_numpy(dtype=str),
        leg=first["leg"].to_numpy(dtype=str),
        start_time=pd.DatetimeIndex(first["start"]),
    )


def _start(value: dict[str, Floats], motion: pd.DataFrame | None) -> Floats:
    """North, east, heading, surge, sway and yaw rate at second 0 in SI units; the heading as the track's."""
    measured = {name: value[name][:, 0] for name in (*POSE, *VELOCITY)}
    if motion is not None:
        measured = {name: motion[name].to_numpy(dtype=float) for name in measured}
    north, east, heading, surge, sway, rate = measured.values()
    near = value["heading_deg"][:, 0] + difference(heading, value["heading_deg"][:, 0])
    return np.column_stack([north, east, np.deg2rad(near), surge, sway, np.deg2rad(rate)])


def _control(value: dict[str, Floats]) -> Floats:
    return np.column_stack(
        [
            value["port_rpm"][:, 0] / 60.0,
            np.deg2rad(value["port_angle_deg"][:, 0]),
            value["starboard_rpm"][:, 0] / 60.0,
            np.deg2rad(value["starboard_angle_deg"][:, 0]),
            value["tunnel_rpm"][:, 0],
        ]
    )


def split_by_group(
    groups: NDArray[np.str_], share: float, seed: int
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Two masks that part the windows by whole groups (legs, recordings), never by row.

    Groups are drawn at random until the second part holds about ``share`` of the windows, at least one group
    and never all. Raises :class:`DataShortageError` when there is one group only.
    """
    names, counts = np.unique(groups, return_counts=True)
    if len(names) < 2:
        raise DataShortageError(
            f"only one leg ({names[0] if len(names) else 'none'}), which cannot be split",
            fix="give more recordings, or longer ones with more held stretches",
        )
    wanted = share * len(groups)
    held_out: list[int] = []
    taken = 0
    for group in np.random.default_rng(seed).permutation(len(names)):
        fits = taken + counts[group] <= 1.25 * wanted  # one long leg must not take half of the windows away
        if fits and taken < wanted and len(held_out) < len(names) - 1:
            held_out.append(int(group))
            taken += int(counts[group])
    second = np.isin(groups, names[held_out or [int(np.argmin(counts))]])
    return ~second, second
