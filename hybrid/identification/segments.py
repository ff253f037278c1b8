"""Recordings cut into segments, each simulated from its own start.

A segment lasts about the time to sail a ship length, in which she responds to her helm: long enough to show the
effect of coefficients, short enough that model errors do not carry the ship away, and that there are many
segments for estimating errors by leaving out each in turn.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import ceil

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from seatrial.acquisition.core.errors import DataShortageError
from seatrial.acquisition.core.quantities import Bools, Floats, Ints
from seatrial.analysis.series import half_width_for, smooth_motion
from seatrial.analysis.tables.resample import rate_fraction, resample
from seatrial.analysis.tables.table import seconds_of, table_actuators, with_calm
from seatrial.hybrid.prediction.prediction_windows import mean_controls
from seatrial.hybrid.vessel.channels import check_ship, controls_of, states_of, wind_of
from seatrial.hybrid.vessel.plant import Plant

LENGTHS = 1.0
"""A segment's duration, in ship lengths at her usual speed."""

SHORTEST_S, LONGEST_S = 15.0, 240.0
COMPARED = 30
"""The number of comparisons with measurements in a segment."""

LEAST_EVERY, MOST_EVERY = 3, 8
"""The least number of control steps between comparisons. As far as possible a step equals the interval of the
records or a whole fraction of it, since between records a moving rudder is not on the interpolated line."""

MOST = 400
"""The number of segments beyond which only every second, third ... one of a longer recording is used."""

_MOVING_SHARE = 0.2
_LEAST = 4


@dataclass(frozen=True, slots=True)
class Segments:
    """S segments of K steps of ``dt_s``, compared at T times.

    ``measured`` [S, T, 6] as reported, NaN where nothing was; ``motion`` [S, T, 6] a first guess of the states;
    ``controls`` [S, K, controls] and ``wind`` [S, K, 2] in SI; ``recording`` [S] counts the recordings, called
    ``names``; ``speed_mps`` is the ship's usual one. ``left_out`` counts candidates that lack data.
    """

    measured: Floats
    motion: Floats
    controls: Floats
    wind: Floats
    recording: Ints
    names: tuple[str, ...]
    dt_s: float
    speed_mps: float
    left_out: int = 0

    def __len__(self) -> int:
        return len(self.measured)

    @property
    def start(self) -> Floats:
        """An initial estimate of the states [S, 6] at the start."""
        return self.motion[:, 0]

    @property
    def every(self) -> int:
        """The steps between comparisons."""
        return int(self.controls.shape[1] // self.measured.shape[1])

    @property
    def duration_s(self) -> float:
        """The length of a segment [s]."""
        return float(self.controls.shape[1] * self.dt_s)

    def subset(self, chosen: Bools | NDArray[np.int64]) -> Segments:
        """The segments that a mask or index chooses."""
        rows = {name: getattr(self, name)[chosen] for name in _ROWS}
        return replace(self, **rows)

    def split(self, parts: int) -> Segments:
        """Segments divided into this number of parts."""
        measured, motion, controls, wind = (_in_parts(getattr(self, name), parts) for name in _ROWS[:-1])
        return replace(
            self, measured=measured, motion=motion, controls=controls, wind=wind,
            recording=np.repeat(self.recording, parts),
        )  # fmt: skip


_ROWS = ("measured", "motion", "controls", "wind", "recording")


def _in_parts(rows: Floats, parts: int) -> Floats:
    """Rows [S, n, ...] as [S parts, n / parts, ...]."""
    return rows.reshape(len(rows) * parts, rows.shape[1] // parts, *rows.shape[2:])


def segments_of(tables: Mapping[str, pd.DataFrame], plant: Plant, duration_s: float | None = None) -> Segments:
    """The segments of tables of samples, at any rate, by the recording's name.

    Raises :class:`DataShortageError` if there are fewer than a handful, :class:`InputError` for recordings of
    another ship.
    """
    speed = _usual_speed(tables)
    length_m = plant.length_between_perpendiculars_m
    lasting = duration_s or float(np.clip(LENGTHS * length_m / max(speed, 1e-3), SHORTEST_S, LONGEST_S))
    dt_s, steps = _steps(lasting, tables)
    parts = [_cut(resample(table, 1.0 / dt_s), plant, steps) for table in tables.values()]
    number = [len(part[0]) for part in parts]
    measured, motion, controls, wind = (np.concatenate([part[column] for part in parts]) for column in range(4))
    segments = Segments(
        measured, motion, controls, wind,
        recording=np.repeat(np.arange(len(parts)), number),
        names=tuple(tables), dt_s=dt_s, speed_mps=speed, left_out=sum(int(part[4]) for part in parts),
    )  # fmt: skip
    if len(segments) < _LEAST:
        raise DataShortageError(
            f"only {len(segments)} segments of {lasting:.0f} s have motion and controls",
            where=", ".join(tables), fix="give longer recordings, or check these with `seatrial check`",
        )  # fmt: skip
    stride = -(-len(segments) // MOST)
    return segments if stride == 1 else segments.subset(np.arange(0, len(segments), stride))


def _usual_speed(tables: Mapping[str, pd.DataFrame]) -> float:
    """The median speed ahead [m/s] while the ship moves."""
    speed = np.abs(np.concatenate([table["surge_mps"].dropna().to_numpy() for table in tables.values()]))
    if not speed.size or not speed.max() > 0.0:
        raise DataShortageError("the ship does not move", where=", ".join(tables), fix="give recordings under way")
    return float(np.median(speed[speed >= _MOVING_SHARE * np.percentile(speed, 99.0)]))


def _steps(lasting_s: float, tables: Mapping[str, pd.DataFrame]) -> tuple[float, int]:
    """The length of a step [s], and the number of steps between comparisons."""
    records = [np.diff(seconds_of(table[["surge_mps"]].dropna())) for table in tables.values()]
    interval_s = float(np.median(np.concatenate(records)))
    apart_s = lasting_s / COMPARED
    count = ceil(interval_s * LEAST_EVERY / apart_s - 0.01)  # steps from one record to the next
    dt_s = max(interval_s / count, apart_s / MOST_EVERY)
    steps = count * ceil(apart_s / interval_s - 0.01) if interval_s <= apart_s else round(apart_s / dt_s)
    return float(1 / rate_fraction(1.0 / dt_s)), min(max(steps, LEAST_EVERY), MOST_EVERY)


def _cut(table: pd.DataFrame, plant: Plant, interval: int) -> tuple[Floats, Floats, Floats, Floats, int]:
    """Measured, motion, controls and wind of the whole segments of one table, and how many lack data."""
    check_ship(table_actuators(table), plant)
    measured, controls = states_of(table), controls_of(table, plant.layout)
    wind = wind_of(with_calm(table))
    motion = states_of(smooth_motion(table, half_width_for(plant.length_overall_m)))
    motion[:, 2] += 2.0 * np.pi * np.round((measured[:, 2] - motion[:, 2]) / (2.0 * np.pi))
    steps = COMPARED * interval
    count = max(0, len(table) - 1) // steps
    rows = np.arange(count * steps).reshape(count, steps)
    ends = np.append(rows, rows[:, -1:] + 1, axis=1)
    complete = np.isfinite(np.column_stack([controls, wind]))[ends].all(axis=(1, 2))
    complete &= np.isfinite(motion[rows[:, ::interval]]).all(axis=(1, 2))
    rows, ends = rows[complete], ends[complete]
    acting, compared = mean_controls(controls[ends], plant.layout), rows[:, ::interval]
    return measured[compared], motion[compared], acting, wind[rows], int((~complete).sum())
