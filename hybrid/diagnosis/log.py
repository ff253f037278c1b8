"""A trial as the diagnosis sees it: what was measured at each full second, and what drove the ship between them.

A measured value is the mean of all samples within half a second, and the model is asked for the mean at the same
times, so that neither the rate of a recording nor the curvature of the motion matters. The smoothed motion is only
where the equations are made linear: it need not be right, just near. All that was recorded is used, not only
windows in which the thrusters were held: those hide inertia and lags.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from acquisition.core.arrays import Floats, Ints
from acquisition.core.channels import COMMAND
from acquisition.core.errors import DataShortageError
from analysis.estimation.noise_levels import NoiseLevels
from analysis.tables.table import require
from hybrid.diagnosis.averages import (
    MOTION,
    Reading,
    averaged_motion,
    mean_settings,
    mean_wind,
    setting_step_s,
    smoothed_motion,
)

BLOCK_S = 60
"""Each block starts from a state of its own that nobody knows; longer ones gain nothing that can be measured."""

LEG_S = 180
"""Blocks of so long a stretch are kept together when some are left out."""

_SHORTEST_BLOCK_S = 12
_LONGEST_BREAK_S = 60


@dataclass(frozen=True, slots=True)
class Log:
    """T seconds of one or more trials, in blocks of consecutive seconds.

    ``measured`` [T, 6] is the mean of the reported state at the samples' times, NaN where there is none; ``weight``
    [T, 6, 5] says which, as weights of the quarters of a second from half a second before to half a second after;
    ``nominal`` [T, 6] is the smoothed state; ``controls`` [T, 4, 5] and ``wind`` [T, 2] (direction FROM [rad],
    speed [m/s]) act in the second after each; ``time_s`` [T] is UTC since 1970. ``block`` and ``leg`` [T] count up
    from 0. All SI, angles in radians, heading without jumps. ``refused`` counts samples that lay off by themselves,
    ``setting_step_s`` is how often thruster settings were recorded, ``reading`` what they are taken to do between,
    ``levels`` what the smoother thought of noise.
    """

    measured: Floats
    weight: Floats
    nominal: Floats
    controls: Floats
    wind: Floats
    time_s: Ints
    block: Ints
    leg: Ints
    recording: Ints
    refused: int = 0
    setting_step_s: float = 0.1
    levels: tuple[NoiseLevels, ...] = ()
    reading: Reading = "line"

    def __len__(self) -> int:
        return len(self.time_s)

    @property
    def edges(self) -> Ints:
        """Where each block begins, and the end of the last: [blocks + 1]."""
        starts = np.flatnonzero(np.diff(self.block, prepend=-1))
        return np.append(starts, len(self)).astype(np.int64)

    @property
    def legs(self) -> int:
        """The number of legs."""
        return int(self.leg.max()) + 1

    def subset(self, rows: NDArray[np.bool_]) -> Log:
        """Some blocks of this log: those whose rows are chosen."""
        chosen = {name: getattr(self, name)[rows] for name in _ARRAYS}
        for name in ("block", "leg"):
            chosen[name] = np.unique(chosen[name], return_inverse=True)[1].astype(np.int64)
        return replace(self, **chosen)


_ARRAYS = ("measured", "weight", "nominal", "controls", "wind", "time_s", "block", "leg", "recording")


def log_of(tables: Sequence[pd.DataFrame], block_s: int = BLOCK_S) -> Log:
    """The log of raw tables of the 13 channels, at any rate and with NaN where a channel has no sample.

    Wind that was not recorded counts as none. Raises :class:`InputError` for a table without motion or thrusters,
    :class:`DataShortageError` where no stretch is long enough.
    """
    parts = [_one(table, block_s) for table in tables]
    first_block, first_leg, joined = 0, 0, list[Log]()
    for number, part in enumerate(parts):
        if not len(part):
            continue
        moved = {"block": part.block + first_block, "leg": part.leg + first_leg}
        joined.append(replace(part, recording=np.full(len(part), number), **moved))  # type: ignore[arg-type]
        first_block, first_leg = int(moved["block"].max()) + 1, int(moved["leg"].max()) + 1
    if not joined:
        raise DataShortageError(
            f"no stretch of {_SHORTEST_BLOCK_S} s has motion and thrusters",
            where=", ".join(str(table.attrs.get("recording", "the table")) for table in tables),
            fix="see what is missing with `seatrial check`",
        )
    together: dict[str, Any] = {name: np.concatenate([getattr(each, name) for each in joined]) for name in _ARRAYS}
    return Log(
        **together,
        refused=sum(each.refused for each in joined),
        setting_step_s=max(each.setting_step_s for each in joined),
        levels=tuple(level for each in joined for level in each.levels),
    )


def _one(table: pd.DataFrame, block_s: int) -> Log:
    require(table, (*MOTION, *COMMAND))
    seconds, motion, slopes, levels = smoothed_motion(table)
    measured, weight, refused = averaged_motion(table, seconds, motion, slopes)
    controls = mean_settings(table, seconds)
    usable = np.asarray(np.isfinite(motion).all(axis=1) & np.isfinite(controls).all(axis=(1, 2)))
    block = _blocks(usable, block_s)
    leg = np.where(block >= 0, _legs(block, seconds), -1)
    rows = block >= 0
    return Log(
        measured[rows], weight[rows], motion[rows], controls[rows], mean_wind(table, seconds)[rows], seconds[rows],
        block[rows],
        leg[rows], np.zeros(int(rows.sum()), dtype=np.int64), refused, setting_step_s(table), (levels,),
    )  # fmt: skip


def _blocks(usable: NDArray[np.bool_], block_s: int) -> Ints:
    """Number of the block of each second, -1 outside: usable stretches in even blocks of about ``block_s``."""
    block = np.full(len(usable), -1, dtype=np.int64)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], usable.astype(int), [0]])))
    number = 0
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        if last - first < _SHORTEST_BLOCK_S:
            continue
        pieces = max(1, round((last - first) / block_s))
        cuts = np.linspace(first, last, pieces + 1).round().astype(int)
        for a, b in itertools.pairwise(cuts):
            block[a:b] = number
            number += 1
    return block


def _legs(block: Ints, seconds: Ints) -> Ints:
    """Number of the leg of each second: blocks together until they are long enough, never across a long break."""
    leg = np.zeros(len(block), dtype=np.int64)
    number, length, before = -1, np.inf, 0
    for current in range(int(block.max(initial=-1)) + 1):
        rows = np.flatnonzero(block == current)
        if length >= LEG_S - 0.5 * len(rows) or seconds[rows[0]] - before > _LONGEST_BREAK_S:
            number, length = number + 1, 0
        leg[rows] = number
        length, before = length + len(rows), int(seconds[rows[-1]])
    return leg
