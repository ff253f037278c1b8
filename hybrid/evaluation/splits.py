"""How windows are parted into those that a method learns from and those that it is judged on.

``leg`` keeps whole legs back, drawn at random; ``time`` keeps the end of every recording back, ``recording`` one
recording after the other. In these no second of a window that is judged was ever fitted. ``random`` draws windows
one by one, as is often published: windows overlap, so most seconds that are judged were fitted too. It stands
beside the others to show how much that flatters.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from acquisition.core.arrays import Bools
from acquisition.core.errors import ConfigurationError, DataShortageError
from hybrid.calibrators.train import HELD_OUT_SHARE
from hybrid.prediction.prediction_windows import PredictionWindows, draw_legs

TEST_SHARE = 0.3
"""The share of the windows, or of a recording's time, that is kept back to judge by."""


@dataclass(frozen=True, slots=True)
class Draw:
    """One way to part N windows, as masks [N] that exclude each other.

    ``fitting`` is learned from, ``stopping`` ends the learning and sizes the regions, ``held_out`` is judged on and
    holds whole windows only.
    Windows in none of them share seconds with both sides.
    """

    fitting: Bools
    stopping: Bools
    held_out: Bools


def draws_of(kind: str, windows: PredictionWindows, draws: int, seed: int) -> list[Draw]:
    """The draws of a kind of split: ``draws`` of them where chance plays, otherwise as many as there are.

    Raises :class:`DataShortageError` where windows cannot be parted in that way.
    """
    return SPLITS[kind](windows, draws, seed)


def refuse_unknown(kinds: Sequence[str]) -> None:
    """Raise :class:`ConfigurationError` when one of the names is no kind of split."""
    for kind in kinds:
        if kind not in SPLITS:
            raise ConfigurationError(f"no split is called {kind!r}", fix=f"use one of {', '.join(SPLITS)}")


def by_leg(windows: PredictionWindows, draws: int, seed: int) -> list[Draw]:
    """Whole legs with about 30 % of the windows kept back, drawn anew each time."""
    parts = [draw_legs(windows, TEST_SHARE, seed + draw) for draw in range(draws)]
    return [with_stopping(windows, ~unseen, unseen, seed + draw) for draw, unseen in enumerate(parts)]


def by_time(windows: PredictionWindows, draws: int, seed: int) -> list[Draw]:
    """The last 30 % of each recording's time kept back; windows that meet the border are dropped."""
    first, last = windows.known_seconds()
    known, unseen = np.zeros(len(windows), dtype=bool), np.zeros(len(windows), dtype=bool)
    for trial in np.unique(windows.trial):
        mine = windows.trial == trial
        border = first[mine].min() + (1.0 - TEST_SHARE) * (last[mine].max() - first[mine].min())
        known |= mine & (last < border)
        unseen |= mine & (first > border)
    if not known.any() or not unseen.any():
        raise DataShortageError("no held window on one side of 70 % of the time", fix="give longer recordings")
    return [with_stopping(windows, known, unseen, seed)]


def by_recording(windows: PredictionWindows, draws: int, seed: int) -> list[Draw]:
    """Each recording in turn kept back from all others."""
    trials = np.unique(windows.trial)
    if len(trials) < 2:
        raise DataShortageError("one recording cannot be kept back from others", fix="give two or more")
    return [with_stopping(windows, windows.trial != each, windows.trial == each, seed) for each in trials]


def at_random(windows: PredictionWindows, draws: int, seed: int) -> list[Draw]:
    """Single windows kept back, whatever leg they are of, and others of them to stop by: this leaks."""
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
"""The kinds of split by name."""


def shared_seconds(windows: PredictionWindows, known: Bools, unseen: Bools) -> int:
    """How many seconds of the windows ``unseen`` are also in windows that are ``known``, trial by trial."""
    first, _ = windows.known_seconds()
    seconds = first[:, None] + np.arange(windows.horizon_s + 1)
    there = np.isfinite(windows.track[..., 0])
    mine = [windows.trial == trial for trial in np.unique(windows.trial)]
    sides = [[seconds[some & each][there[some & each]] for some in (known, unseen)] for each in mine]
    return sum(np.intersect1d(*both).size for both in sides)


def leaked_share(windows: PredictionWindows, draw: Draw) -> float:
    """The share of the seconds that are judged which were learned from too."""
    judged = shared_seconds(windows, draw.held_out, draw.held_out)
    return shared_seconds(windows, draw.fitting | draw.stopping, draw.held_out) / judged


def with_stopping(windows: PredictionWindows, known: Bools, unseen: Bools, seed: int) -> Draw:
    """The draw in which whole legs of what is known are left out of the fit, to stop by."""
    stopping = np.zeros(len(windows), dtype=bool)
    stopping[known] = draw_legs(windows.subset(known), HELD_OUT_SHARE, seed)
    return Draw(known & ~stopping, stopping, unseen & windows.whole)
