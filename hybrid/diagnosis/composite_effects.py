"""Whether several named effects may be one that is not in the catalogue.

An effect that is not in the catalogue is taken for what is most like it, often for two of its siblings at once: a
loss of thrust at both pods for one at port and one at starboard. Where the catalogue has an effect that the two
make together, it was tried and was worse. Where it has none, no data can tell.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from hybrid.diagnosis.view import View
from hybrid.effects import Effect

_MADE = 0.9  # of an effect's own squares: two that explain so much of it make it together


def perhaps_one(view: View, names: Sequence[str]) -> list[tuple[str, ...]]:
    """Groups of named effects each of which may be one effect that is not in the catalogue."""
    catalogue = view.examination.model.catalogue
    found: list[set[str]] = []
    for one, other in combinations(names, 2):
        if not _akin(catalogue[one], catalogue[other]) or _tried_together(view, one, other):
            continue
        joined = [group for group in found if group & {one, other}]
        found = [group for group in found if group not in joined] + [{one, other}.union(*joined)]
    return [tuple(name for name in names if name in group) for group in found]


def _akin(one: Effect, other: Effect) -> bool:
    """Whether one cause may well show as both."""
    if one.family != other.family or one.kind != other.kind or any(_comes_along(each) for each in (one, other)):
        return False
    return one.family == "clock" or other.name in one.confused_with or one.name in other.confused_with


def _comes_along(effect: Effect) -> bool:
    """Whether it is no wonder beside others of its family.

    Sea and current come together, and each instrument has errors of its own; a factor on what the wind does is an
    error of the model.
    """
    return effect.family == "sensor" or (effect.family == "environment" and effect.parameters[0].unit != "1")


def _tried_together(view: View, one: str, other: str) -> bool:
    """Whether the catalogue has an effect of their family that the two make together, each with a part in it."""
    catalogue = view.examination.model.catalogue
    return any(
        _explained(view, name, (one, other)) > _MADE > max(_explained(view, name, (each,)) for each in (one, other))
        for name, effect in catalogue.items()
        if effect.family == catalogue[one].family and name not in (one, other)
    )


def _explained(view: View, name: str, by: Sequence[str]) -> float:
    """The share of an effect's whitened signature that others explain, in the direction they explain least."""
    own, others = np.array(view.columns([name])), np.array(view.columns(by))
    block = view.inner[np.ix_(own, own)]
    cross, inner = view.inner[np.ix_(others, own)], view.inner[np.ix_(others, others)]
    scale = np.sqrt(np.maximum(np.diag(inner), 1e-300))
    inner = inner / np.outer(scale, scale) + 1e-9 * np.eye(len(others))
    explained = (cross / scale[:, None]).T @ np.linalg.solve(inner, cross / scale[:, None])
    size = np.sqrt(np.maximum(np.diag(block), 1e-300))
    return float(np.linalg.eigvalsh(explained / np.outer(size, size))[0])
