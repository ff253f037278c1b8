"""Splits of windows into training and test sets, and their classification.

``leg`` holds out whole legs, drawn at random; ``time`` the end of every recording; ``recording`` one recording
after the other. In these no second of a test window was used for fitting: with any commands, where legs follow
each other without end, windows that share a second with the other side are left out. ``random`` draws single
windows, as is often published: windows overlap, so most test seconds were also fitted. It is included to show
by how much that flatters.

Classes are by what the ship did, by wind and by recording, to show where a method is good and where it is not.
Their limits scale with the ship: lengths in ship lengths, speeds as Froude numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from seatrial.acquisition.core.errors import ConfigurationError, DataShortageError
from seatrial.acquisition.core.quantities import Bools, Floats, to_ship
from seatrial.hybrid.calibrators.train import HELD_OUT_SHARE
from seatrial.hybrid.prediction.prediction_windows import (
    WIND,
    PredictionWindows,
    clear_of,
    draw_windows,
    unlike_groups,
)

TEST_SHARE = 0.3
"""The share of the windows, or of a recording's time, that is held out for testing."""


@dataclass(frozen=True, slots=True)
class Draw:
    """A split of N windows, as disjoint masks [N].

    ``fitting`` is for training, ``stopping`` for early stopping and for the size of regions, ``held_out`` for
    testing; the latter holds whole windows only. Windows in none of them share seconds with both sides.
    """

    fitting: Bools
    stopping: Bools
    held_out: Bools


def refuse_unknown(kinds: Sequence[str]) -> None:
    """Raise :class:`ConfigurationError` if one of the names is no kind of split."""
    for kind in kinds:
        if kind not in SPLITS:
            raise ConfigurationError(f"unknown split {kind!r}", fix=f"use one of {', '.join(SPLITS)}")


def by_leg(windows: PredictionWindows, draws: int, seed: int) -> list[Draw]:
    """Whole legs with about 30 % of the windows held out, drawn anew each time."""
    parts = [draw_windows(windows, windows.leg, TEST_SHARE, seed + draw) for draw in range(draws)]
    return [
        with_stopping(windows, clear_of(windows, ~unseen, unseen), unseen, seed + draw)
        for draw, unseen in enumerate(parts)
    ]


def by_time(windows: PredictionWindows, draws: int, seed: int) -> list[Draw]:
    """The last 30 % of each recording's time held out; windows across the border are dropped."""
    first, last = windows.known_seconds()
    known, unseen = np.zeros(len(windows), dtype=bool), np.zeros(len(windows), dtype=bool)
    for trial in np.unique(windows.trial):
        mine = windows.trial == trial
        border = first[mine].min() + (1.0 - TEST_SHARE) * (last[mine].max() - first[mine].min())
        known |= mine & (last < border)
        unseen |= mine & (first > border)
    if not known.any() or not unseen.any():
        raise DataShortageError("no window on one side of 70 % of the time", fix="give longer recordings")
    return [with_stopping(windows, known, unseen, seed)]


def by_recording(windows: PredictionWindows, draws: int, seed: int) -> list[Draw]:
    """Each recording in turn held out from all others, if it has whole windows."""
    trials = np.unique(windows.trial[windows.whole])
    if len(trials) < 2:
        raise DataShortageError("a split by recording needs two recordings or more", fix="give two or more")
    return [with_stopping(windows, windows.trial != each, windows.trial == each, seed) for each in trials]


def at_random(windows: PredictionWindows, draws: int, seed: int) -> list[Draw]:
    """Single windows held out, whatever their leg, and others for early stopping: this leaks."""
    result = []
    for draw in range(draws):
        rank = np.random.default_rng(seed + draw).permutation(len(windows)) / len(windows)
        stopping = (rank >= TEST_SHARE) & (rank < TEST_SHARE + HELD_OUT_SHARE * (1.0 - TEST_SHARE))
        held_out = rank < TEST_SHARE
        result.append(Draw(~held_out & ~stopping, stopping, held_out & windows.whole))
    return result


SPLITS: dict[str, Callable[[PredictionWindows, int, int], list[Draw]]] = {
    "leg": by_leg,
    "time": by_time,
    "recording": by_recording,
    "random": at_random,
}
"""The kinds of split by name, as functions of windows, a number of draws, which counts where these are random, and
a seed. They raise :class:`DataShortageError` if windows cannot be split in that way."""


def shared_seconds(windows: PredictionWindows, known: Bools, unseen: Bools) -> int:
    """The number of seconds of the windows ``unseen`` that are also in windows ``known``, trial by trial."""
    first, _ = windows.known_seconds()
    seconds = first[:, None] + np.arange(windows.horizon_s + 1)
    there = np.isfinite(windows.track[..., 0])
    mine = [windows.trial == trial for trial in np.unique(windows.trial)]
    sides = [[seconds[some & each][there[some & each]] for some in (known, unseen)] for each in mine]
    return sum(np.intersect1d(*both).size for both in sides)


def leaked_share(windows: PredictionWindows, draw: Draw) -> float:
    """The share of the test seconds that were also used for training."""
    judged = shared_seconds(windows, draw.held_out, draw.held_out)
    return shared_seconds(windows, draw.fitting | draw.stopping, draw.held_out) / judged


def with_stopping(windows: PredictionWindows, known: Bools, unseen: Bools, seed: int) -> Draw:
    """The draw in which whole legs, or recordings, of the known windows are kept for early stopping."""
    stopping = np.zeros(len(windows), dtype=bool)
    some = windows.subset(known)
    stopping[known] = draw_windows(some, unlike_groups(some), HELD_OUT_SHARE, seed)
    return Draw(clear_of(windows, known & ~stopping, stopping), stopping, unseen & windows.whole)


GRAVITY_MPS2 = 9.81
SLOW_FROUDE = 0.06
"""Froude number below which a ship is docking, drifting or keeping her position."""
SIDEWAYS_DEG = 30.0
"""Drift angle beyond which the ship moves sideways or astern."""
TURNING_DEG_PER_LENGTH = 4.0
"""Change of heading over a ship length above which she is turning: a circle of less than 29 lengths."""
ACCELERATING_PER_LENGTH = 0.02
"""Relative change of speed over a ship length above which she accelerates."""

MANOEUVRES = ("straight", "turning", "accelerating", "slow", "other")
BEAUFORT_MPS = (3.4, 8.0, 13.9)
WINDS = ("0-2 Bft", "3-4 Bft", "5-6 Bft", "7 Bft and more")


def classes_of(windows: PredictionWindows, length_m: float) -> dict[str, dict[str, Bools]]:
    """Masks [N] by kind of class and class, without empty ones; those of a kind cover all windows."""
    named = {
        "manoeuvre": (manoeuvres(windows, length_m), MANOEUVRES),
        "wind": (winds(windows), WINDS),
        "recording": (windows.trial, tuple(np.unique(windows.trial))),
    }
    return {
        kind: {str(name): mask for name in names if (mask := np.asarray(given == name)).any()}
        for kind, (given, names) in named.items()
    }


def manoeuvres(windows: PredictionWindows, length_m: float) -> NDArray[np.str_]:
    """The class of motion of each window's measured track [N], one of :data:`MANOEUVRES`.

    The first that applies of: slow; other, sideways or astern; turning; accelerating; straight.
    """
    seconds = windows.horizon_s
    steps = np.diff(windows.track[..., :2], axis=1)
    way_m = np.hypot(steps[..., 0], steps[..., 1]).sum(axis=1)
    lengths = np.maximum(way_m / length_m, 1e-9)
    turned_deg = np.rad2deg(np.abs(windows.track[:, -1, 2] - windows.track[:, 0, 2]))
    slow = way_m / seconds < SLOW_FROUDE * np.sqrt(GRAVITY_MPS2 * length_m)
    rules = {
        "slow": slow,
        "other": _drift_deg(windows, steps) > SIDEWAYS_DEG,
        "turning": turned_deg / lengths > TURNING_DEG_PER_LENGTH,
        "accelerating": _speed_change(steps) / lengths > ACCELERATING_PER_LENGTH,
    }
    return np.asarray(np.select(list(rules.values()), list(rules), "straight"))


_MINUTE = 61


def winds(windows: PredictionWindows) -> NDArray[np.str_]:
    """The wind of the minute before each window by its Beaufort number [N], of :data:`WINDS`."""
    speed_mps = np.nanmean(np.column_stack([windows.wind[:, -1], windows.past[:, :_MINUTE, WIND][..., -1]]), axis=1)
    return np.asarray(np.array(WINDS)[np.searchsorted(BEAUFORT_MPS, speed_mps, side="right")])


def _drift_deg(windows: PredictionWindows, steps: Floats) -> Floats:
    """The mean angle between course and heading over each window [N]."""
    heading = 0.5 * (windows.track[:, 1:, 2] + windows.track[:, :-1, 2])
    ahead, aside = to_ship(steps[..., 0], steps[..., 1], heading)
    return np.asarray(np.rad2deg(np.abs(np.arctan2(aside.sum(axis=1), ahead.sum(axis=1)))))


def _speed_change(steps: Floats) -> Floats:
    """The relative change of speed from the first to the last third of each window [N]."""
    third = max(1, steps.shape[1] // 3)
    speeds = [np.hypot(*part.mean(axis=1).T) for part in (steps[:, :third], steps[:, -third:])]
    return np.asarray(np.abs(speeds[1] - speeds[0]) / np.maximum(0.5 * (speeds[0] + speeds[1]), 1e-9))
