"""Putting a programme of manoeuvres together: one after the other by what it adds, and then exchanging.

What counts is every effect of an ordinary size, whether it would be seen, and every pair of effects, whether they
would be told apart. Each is a term that falls as its evidence grows and hardly falls once there is enough: so the
worst weigh the most, and no evidence is piled up where there is plenty (after Fedorov 1972).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, log1p

import numpy as np

from acquisition.core.arrays import Floats
from acquisition.core.progress import Progress
from hybrid.planning.information import TOLD_APART, Design, Information, noncentrality, told_apart

_SEEN = noncentrality(16.0, 1)
_LEAST = 1e-3  # evidence below this is none
_EXCHANGES = 2


@dataclass(frozen=True, slots=True)
class Aims:
    """What a programme is for: effects to be seen, and pairs to be told apart, of ordinary sizes."""

    effects: tuple[str, ...]
    pairs: tuple[tuple[str, str], ...]


def composed(
    design: Design, legs: Sequence[int], slots: int, aims: Aims, progress: Progress = lambda share: None
) -> list[int]:
    """Which of the ``legs`` to sail, ``slots`` in all, any of them twice if that is best; in their own order."""
    chosen: list[int] = []
    for number in range(slots):
        chosen.append(min(legs, key=lambda leg: cost(design, [*chosen, leg], aims)))
        progress((number + 1) / (slots + _EXCHANGES))
    for number in range(_EXCHANGES):
        before = list(chosen)
        chosen = _exchanged(design, chosen, legs, aims)
        progress((slots + number + 1) / (slots + _EXCHANGES))
        if chosen == before:
            break
    return sorted(chosen)


def _exchanged(design: Design, chosen: list[int], legs: Sequence[int], aims: Aims) -> list[int]:
    """Each of the chosen in turn replaced by whatever is best in its place."""
    for place in range(len(chosen)):
        others = [leg for number, leg in enumerate(chosen) if number != place]
        best = min(legs, key=lambda leg: cost(design, [*others, leg], aims))
        if cost(design, [*others, best], aims) < cost(design, chosen, aims) - 1e-9:
            chosen = [*chosen[:place], best, *chosen[place + 1 :]]
    return chosen


def cost(design: Design, legs: Sequence[int], aims: Aims) -> float:
    """How far these legs are from doing all that they are to do; 0 would be perfect."""
    information = design.information(legs)
    seen = sum(log1p(_SEEN / max(ordinary(information, name), _LEAST)) for name in aims.effects)
    apart = sum(log1p(TOLD_APART / max(alike(information, *pair), _LEAST)) for pair in aims.pairs)
    return seen / max(len(aims.effects), 1) + apart / max(len(aims.pairs), 1)


def ordinary(information: Information, name: str) -> float:
    """Twice the log likelihood that an effect of its ordinary size is worth, in the worst direction."""
    scale = np.array(information.catalogue[name].free_scale)
    block = information.of(name)
    if len(scale) == 1:
        return float(block[0, 0] * scale[0] ** 2)
    return float(np.linalg.eigvalsh(block * np.outer(scale, scale))[0])


def alike(information: Information, name: str, rival: str) -> float:
    """Twice the log likelihood that tells two effects of ordinary sizes apart, whichever of them is there.

    Infinite where neither would be seen at all: then they are not taken for each other.
    """
    ways = ((name, rival), (rival, name))
    seen = [pair for pair in ways if ordinary(information, pair[0]) >= TOLD_APART]
    return min((told_apart(information, *pair) for pair in seen), default=inf)


def matrix(information: Information, names: Sequence[str]) -> Floats:
    """:func:`alike` for all pairs [E, E], infinite for an effect and itself."""
    result = np.full((len(names), len(names)), np.inf)
    for i, name in enumerate(names):
        for j in range(i):
            result[i, j] = result[j, i] = alike(information, name, names[j])
    return result
