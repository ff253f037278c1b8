"""A manoeuvre rehearsed on the simulator, as a log: what the ship would do, without noise or gaps.

How much a trial says of an effect hangs on where it takes the ship, not on what the sensors happen to read. So a
rehearsal needs no smoothing and no chance: its true motion is its measured one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from acquisition.core.arrays import Floats
from hybrid.diagnosis.log import BLOCK_S, LEG_S, STEPS_PER_SECOND, Log
from hybrid.simulation.manoeuvres import Manoeuvre
from hybrid.simulation.sea_state import SeaState
from hybrid.simulation.trial import sail_through
from hybrid.vessel.parameters import Vessel
from hybrid.vessel.plant import Plant
from hybrid.vessel.sensors import measured

_STEPS = 4  # of the simulator in a quarter of a second, so that the autopilot's loop is no slower than a real one
_SEED = 20260903


def rehearsed(
    legs: Manoeuvre, vessel: Vessel, plant: Plant, sea: SeaState, seconds: int, heading_deg: float = 0.0
) -> Log:
    """The log of ``seconds`` of a manoeuvre by ``plant``, the autopilot and drives of ``vessel`` at work.

    Gusts are those of the ``sea``, always the same; its waves and current are not: they belong to the noise and to
    the plant. Raises :class:`ModelRangeError` if the ship leaves the range of her model.
    """
    per_second = STEPS_PER_SECOND * _STEPS
    streams = [np.random.default_rng(each) for each in np.random.SeedSequence(_SEED).spawn(2)]
    dt_s = 1.0 / per_second
    voyage = sail_through(
        vessel, plant, sea, legs, (seconds + 1) * per_second, dt_s, heading_deg, streams[0], streams[1]
    )
    seen = measured(voyage.states, plant, dt_s)[:-1:per_second][: seconds + 1]
    return _log(seen, _mean(voyage.controls, _STEPS), voyage.wind[::per_second], seconds + 1)


def _log(seen: Floats, controls: Floats, wind: Floats, rows: int) -> Log:
    block = np.arange(rows, dtype=np.int64) * max(1, round(rows / BLOCK_S)) // rows
    weight = np.zeros((rows, 6, STEPS_PER_SECOND + 1))
    weight[:, :, STEPS_PER_SECOND // 2] = 1.0
    return Log(
        seen, weight, seen.copy(), controls[: rows * STEPS_PER_SECOND].reshape(rows, STEPS_PER_SECOND, -1),
        wind[:rows].copy(), np.arange(rows, dtype=np.int64), block, block // round(LEG_S / BLOCK_S),
        np.zeros(rows, dtype=np.int64),
    )  # fmt: skip


def _mean(series: Floats, number: int) -> Floats:
    """Means of ``number`` rows at a time."""
    whole = len(series) // number * number
    return np.asarray(series[:whole].reshape(-1, number, series.shape[1]).mean(axis=1))


def one_leg(log: Log) -> Log:
    """The same log as a single leg."""
    return replace(log, leg=np.zeros(len(log), dtype=np.int64))


def behind(first: Log, others: Sequence[Log]) -> Log:
    """One log of several: each follows the one before at its place and, after a break, at its time.

    What no sensor of ``first`` measured, the others do not measure either.
    """
    parts = [first]
    missing = ~np.isfinite(first.measured).any(axis=0)
    for other in others:
        last = parts[-1]
        shift = np.zeros(6)
        shift[:2] = last.nominal[-1, :2] - other.nominal[0, :2]
        seen = other.measured + shift
        seen[:, missing] = np.nan
        parts.append(
            replace(
                other, measured=seen, nominal=other.nominal + shift,
                time_s=other.time_s - other.time_s[0] + last.time_s[-1] + BLOCK_S,
                block=other.block + last.block[-1] + 1, leg=other.leg + last.leg[-1] + 1,
                recording=other.recording + last.recording[-1] + 1,
            )
        )  # fmt: skip
    arrays = [name for name in Log.__slots__ if isinstance(getattr(first, name), np.ndarray)]
    together: dict[str, Any] = {name: np.concatenate([getattr(part, name) for part in parts]) for name in arrays}
    return replace(first, held={}, **together)  # a rehearsal has settings of one kind only
