"""The paper's campaign in one sea state: zigzags of the elongated ship, cut into sequences of 30 s at 20 Hz.

The sequences are swings of the zigzags, at most one a swing, drawn at random but as many to either side and at
each azimuth. No second of a sequence lies in another sequence or in what another one knows of the time before
its start: a split by sequence shares nothing.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from acquisition.core.arrays import Floats, Ints
from acquisition.core.errors import DataShortageError
from analysis.tables.resample import resample
from analysis.windows.held import held_windows
from hybrid.prediction.dataset import start_motion
from hybrid.prediction.prediction_windows import PAST_S, PredictionWindows, windows_from_rows
from hybrid.simulation.manoeuvres import Manoeuvre, manoeuvre_named
from hybrid.simulation.trial import simulate_trial
from hybrid.vessel.plant import Plant

SEA_STATES = ("calm", "gentle", "moderate")
AZIMUTHS_DEG = (10.0, 20.0, 30.0)
SEQUENCES, HORIZON_S, RATE_HZ = 70, 30, 20.0
TRUTH, MODEL = "gunnerus_long", "gunnerus_short"
_SWINGS = tuple(side * angle for side, angle in product((-1.0, 1.0), AZIMUTHS_DEG))
_NEAR_DEG = 2.0
_SETTLING_S = 8  # of thrusters after an order, and of the filters about it: part of a swing that is not held
_STRETCHES, _SPARE, _TRIES = 2.3, 8, 4
"""The trial is so many times as long as that many sequences, and a few more, laid end to end."""


@dataclass(frozen=True, slots=True)
class Campaign:
    """The sequences of one sea state as N windows, and the plant that made them.

    ``azimuth_deg`` [N] is the order of each sequence, positive turning the ship to port. ``truth`` is the
    ship in the mean current and drift of the sea state, ``ship_start`` [N, 6] how she was at second 0 and
    ``ship_track`` [N, H+1, 3] where she went, without the first-order motion in waves and without sensors.
    """

    windows: PredictionWindows
    azimuth_deg: Floats
    ship_start: Floats
    ship_track: Floats
    truth: Plant
    sea_state: str
    seed: int

    def __len__(self) -> int:
        return len(self.windows)

    def subset(self, chosen: NDArray[np.bool_]) -> Campaign:
        """The sequences that a mask chooses."""
        return replace(
            self,
            windows=self.windows.subset(chosen),
            azimuth_deg=self.azimuth_deg[chosen],
            ship_start=self.ship_start[chosen],
            ship_track=self.ship_track[chosen],
        )


def paper_campaign(
    sea_state: str,
    seed: int = 0,
    vessel: str = TRUTH,
    sequences: int = SEQUENCES,
    horizon_s: int = HORIZON_S,
) -> Campaign:
    """The campaign in a sea state of ``trials/sea_states.toml``; the same seed gives the same campaign.

    Starts are smoothed as those of recordings are. Raises :class:`DataShortageError` where the ship's zigzags
    do not give enough held swings.
    """
    manoeuvre = _held_for(manoeuvre_named("paper"), horizon_s)
    duration_s = _STRETCHES * (sequences + _SPARE) * (horizon_s + PAST_S)
    found = 0
    for _ in range(_TRIES):
        table, truth = simulate_trial(vessel, sea_state, manoeuvre, duration_s, RATE_HZ, seed)
        one_hz = resample(table)
        rows = held_windows(one_hz, horizon_s, 1, trial=f"{sea_state}-{seed}").rows
        numbers, azimuth_deg = _drawn(rows, sequences, horizon_s, seed)
        if len(numbers) == sequences:
            chosen = rows[rows["window"].isin(numbers)]
            windows = windows_from_rows(chosen, start_motion(chosen, one_hz), {f"{sea_state}-{seed}": one_hz})
            ship = _ship_states(windows, table.index[0], truth["states"])
            return Campaign(windows, azimuth_deg, ship[:, 0], ship[..., :3], truth["plant"], sea_state, seed)
        duration_s, found = 1.5 * duration_s, len(numbers)
    raise DataShortageError(
        f"{found} of {sequences} sequences found in {duration_s / 1.5:.0f} s of zigzags in a {sea_state} sea",
        fix="ask for fewer sequences or a shorter horizon",
    )


def _held_for(manoeuvre: Manoeuvre, horizon_s: int) -> Manoeuvre:
    """The manoeuvre with swings that are held long enough for a sequence each."""
    least_s = float(horizon_s + _SETTLING_S)
    return tuple(
        replace(leg, at_least_s=max(leg.at_least_s, least_s), at_most_s=max(leg.at_most_s, 2.0 * least_s))
        if np.isfinite(leg.deviation_deg)
        else leg
        for leg in manoeuvre
    )


def _ship_states(windows: PredictionWindows, began: pd.Timestamp, states: Floats) -> Floats:
    """The ship's state at the seconds of each window [N, H+1, 6], from her ``states`` [rows, 6] at RATE_HZ."""
    first = np.round((windows.start_time - began).total_seconds().to_numpy() * RATE_HZ).astype(np.int64)
    rows = first[:, None] + np.round(np.arange(windows.horizon_s + 1) * RATE_HZ).astype(np.int64)
    return np.asarray(states[rows])


def _drawn(rows: pd.DataFrame, sequences: int, horizon_s: int, seed: int) -> tuple[Ints, Floats]:
    """The numbers of the windows drawn, in time order, and the azimuth of each [deg]; fewer if there are no more.

    ``rows`` is the long table of held windows, a candidate every second.
    """
    first = rows[rows["second"] == 0].reset_index(drop=True)
    order_deg = _ordered_deg(rows)
    begins_s = pd.DatetimeIndex(first["start"]).as_unit("s").asi8
    room = {swing: sequences // len(_SWINGS) for swing in _SWINGS}
    for swing in _SWINGS[: sequences % len(_SWINGS)]:
        room[swing] += 1
    apart_s, taken = horizon_s + PAST_S, list[int]()
    for each in np.random.default_rng(seed).permutation(len(first)):
        free = room.get(float(order_deg[each]), 0) > 0
        if free and all(abs(begins_s[each] - begins_s[other]) > apart_s for other in taken):
            room[order_deg[each]] -= 1
            taken.append(int(each))
    drawn = np.array(sorted(taken), dtype=np.int64)
    return first["window"].to_numpy(dtype=np.int64)[drawn], order_deg[drawn]


def _ordered_deg(rows: pd.DataFrame) -> Floats:
    """The order of each window [deg]: the swing that both pods' angles are near, or NaN."""
    angles = rows.groupby("window", sort=True)[["port_angle_deg", "starboard_angle_deg"]].median().to_numpy()
    swings = np.array(_SWINGS)
    off = np.abs(angles[:, None, :] - swings[:, None]).max(axis=2)
    nearest = off.argmin(axis=1)
    return np.where(off.min(axis=1) < _NEAR_DEG, swings[nearest], np.nan)
