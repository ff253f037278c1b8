"""The fidelity map in three sentences, every word of which follows from its numbers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hybrid.plots import title_of
from hybrid.reproduction.fidelity_map import SAME, FidelityMap, edge, enough_alone_m, hybrid_wins, useful_up_to_m

Flags = NDArray[np.bool_]


def with_reading(found: FidelityMap) -> dict[str, Any]:
    """The map for JSON, with its reading."""
    return {**found.as_dict(), "reading": list(reading(found))}


def reading(found: FidelityMap) -> tuple[str, str, str]:
    """How bad a reference may be; where the hybrid is the best choice and where it is not needed; what it gains."""
    main = found.overall()
    return _how_bad(main), _best_choice(main), _gain(main)


def _how_bad(main: FidelityMap) -> str:
    """Up to which error of the reference the hybrid beats the data, for each amount of data."""
    limits, still, worst = useful_up_to_m(main), main.constant_velocity_m, main.reference_m[-1]
    always, never = (_amounts(main, chosen) for chosen in (np.isinf(limits), limits == 0.0))
    parts = [f"from {always} windows on every reference tried, up to {worst:.2f} m off"] if always else []
    parts += [
        f"from {amount} windows where the reference is less than {limit:.2f} m off"
        for limit, amount in zip(limits, main.windows, strict=True)
        if 0.0 < limit < np.inf
    ]
    parts += [f"from {never} windows not even on the best reference"] if never else []
    return (
        f"A hybrid ({main.method}) beats the data alone by more than {SAME:.0%} when it learns "
        f"{'; '.join(parts)} (constant velocity is {still:.2f} m off)."
    )


def _best_choice(main: FidelityMap) -> str:
    """On which references the hybrid beats all others, and which need no calibrator, with few and many windows."""
    wins, alone, count = hybrid_wins(main), enough_alone_m(main), len(main.reference_m)
    ends = [(place, main.windows[place]) for place in (0, -1)]
    won = [
        f"{_where_won(main, wins[:, place])} of {count} references from {amount} windows" for place, amount in ends
    ]
    enough = [_enough(alone[place], amount) for place, amount in ends]
    return (
        f"It beats every other method, constant velocity and the reference itself included, on {_listed(won)}; the "
        f"reference alone is as good as any {_listed(enough)}."
    )


def _where_won(main: FidelityMap, won: Flags) -> str:
    errors_m = [f"{each:.2f}" for each in main.reference_m[won]]
    between = f" ({' to '.join(dict.fromkeys([errors_m[0], errors_m[-1]]))} m off)" if errors_m else ""
    return f"{len(errors_m)}{between}"


def _enough(limit_m: float, amount: int) -> str:
    if limit_m == 0.0:
        return f"nowhere beside one that learned from {amount} windows"
    return f"up to {limit_m:.2f} m off beside one that learned from {amount} windows"


def _gain(main: FidelityMap) -> str:
    """Where the hybrid gains most on the best of the others, and what it makes of the worst reference."""
    row, column = np.unravel_index(int(np.argmin(edge(main))), main.hybrid_m.shape)
    others_m = main.errors_m()[:-1, row, column]
    next_best = main.rivals[int(others_m.argmin())]
    gains = "gains most" if hybrid_wins(main).any() else "gains nowhere, and comes nearest to the best"
    worst = len(main.reference_m) - 1
    return (
        f"It {gains} on the reference that is {main.reference_m[row]:.2f} m off, from {main.windows[column]} "
        f"windows: {main.hybrid_m[row, column]:.2f} m against {others_m.min():.2f} m of {_named(next_best)}; on the "
        f"worst, {main.reference_m[worst]:.2f} m off, it leaves {main.hybrid_m[worst, -1]:.2f} m from {main.windows[-1]} "
        f"windows, the data alone {main.data_driven_m[-1]:.2f} m."
    )


def _named(rival: str) -> str:
    return {"reference": "the reference", "data_driven": "the data alone"}.get(rival, title_of(rival))


def _amounts(main: FidelityMap, chosen: Flags) -> str:
    return _listed([str(amount) for amount, mine in zip(main.windows, chosen, strict=True) if mine])


def _listed(parts: Sequence[str]) -> str:
    """Parts of a sentence, one after the other.

    >>> _listed(["10", "20", "50"])
    '10, 20 and 50'
    """
    return " and ".join(filter(None, [", ".join(parts[:-1]), *parts[-1:]]))
