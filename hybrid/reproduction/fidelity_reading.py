"""The fidelity map in three sentences, every word of which follows from its numbers."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import groupby
from operator import itemgetter
from typing import Any

import numpy as np

from acquisition.core.arrays import Floats
from hybrid.report.words import listed
from hybrid.reproduction.fidelity_map import SAME, FidelityMap, edge, enough_alone_m, hybrid_wins, useful_up_to_m

_NAMED = {"reference": "the reference", "constant_velocity": "constant velocity", "data_driven": "the data alone"}


def with_reading(found: FidelityMap) -> dict[str, Any]:
    """The map for JSON, with its reading."""
    return {**found.as_dict(), "reading": list(reading(found))}


def reading(found: FidelityMap) -> tuple[str, str, str]:
    """How bad a reference may be; where the hybrid is the best choice and where it is not needed; what it gains."""
    main = found.overall()
    return _how_bad(main), _best_choice(main), _gain(main)


def _how_bad(main: FidelityMap) -> str:
    """Up to which error of the reference the hybrid beats the data, for each amount of data."""
    said = {
        0.0: f"even the best reference, {main.reference_m[0]:.2f} m off, is not good enough",
        np.inf: f"even the worst tried, {main.reference_m[-1]:.2f} m off, is good enough",
    }
    parts = [
        f"with {amounts} windows {said.get(limit_m, f'one less than {limit_m:.2f} m off is good enough')}"
        for limit_m, amounts in _by_amount(main, useful_up_to_m(main))
    ]
    return (
        f"For a hybrid ({main.method}) to beat the data alone by more than {100.0 * SAME:.0f} % after learning "
        f"from as much: {'; '.join(parts)} (constant velocity is {main.constant_velocity_m:.2f} m off)."
    )


def _best_choice(main: FidelityMap) -> str:
    """On how many references the hybrid beats all others, and which need no calibrator, by amount of data."""
    won = [
        f"{int(count) or 'none'} with {amounts}"
        for count, amounts in _by_amount(main, hybrid_wins(main).sum(axis=0).astype(float))
    ]
    enough = [
        f"{f'up to {limit_m:.2f} m off' if limit_m else 'nowhere'} with {amounts}"
        for limit_m, amounts in _by_amount(main, enough_alone_m(main))
    ]
    return (
        f"It beats all other methods, constant velocity and the reference alone included, on so many of the "
        f"{len(main.reference_m)} references: {', '.join(won)} windows; the reference needs no calibrator "
        f"{', '.join(enough)}."
    )


def _gain(main: FidelityMap) -> str:
    """Where the hybrid gains most on the best of the others, and what a better reference is worth to it."""
    row, column = np.unravel_index(int(np.argmin(edge(main))), main.hybrid_m.shape)
    others_m = main.errors_m()[:-1, row, column]
    gains = "gains most" if hybrid_wins(main).any() else "gains nowhere, and comes nearest to the others,"
    return (
        f"It {gains} with {main.windows[column]} windows on the reference that is {main.reference_m[row]:.2f} m "
        f"off: {main.hybrid_m[row, column]:.2f} m against {others_m.min():.2f} m of "
        f"{_NAMED[main.rivals[int(others_m.argmin())]]}; with {main.windows[-1]} it leaves "
        f"{main.hybrid_m[0, -1]:.2f} m on the best reference and {main.hybrid_m[-1, -1]:.2f} m on the worst, the "
        f"data alone {main.data_driven_m[-1]:.2f} m."
    )


def _by_amount(main: FidelityMap, values: Floats) -> Iterator[tuple[float, str]]:
    """Each of ``values`` [W] with the amounts of data that it is said of, neighbours of one value together."""
    for value, group in groupby(zip(values, main.windows, strict=True), key=itemgetter(0)):
        yield float(value), listed([str(amount) for _, amount in group])
