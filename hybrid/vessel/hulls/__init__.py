"""The hull models, one file each, and the compiled loop's way from a model's code to its force.

To add a model: a file like ``mmg.py`` and a line in :data:`HULLS`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

from analysis.compiling import compiled
from hybrid.vessel.hulls.cross_flow import CROSS_FLOW
from hybrid.vessel.hulls.kind import HullModel
from hybrid.vessel.hulls.mmg import MMG
from hybrid.vessel.hulls.polynomial import POLYNOMIAL

HULLS: dict[str, HullModel] = {"polynomial": POLYNOMIAL, "mmg": MMG, "cross_flow": CROSS_FLOW}


class HullEntry(Protocol):
    """The ``[hull]`` table of a vessel file, of whatever model."""

    @property
    def model(self) -> str:
        """Its model, one of :data:`HULLS`."""


HULL_CODES: dict[str, float] = {name: float(code) for code, name in enumerate(HULLS)}
HULL_SIZE = max(len(model.numbers) for model in HULLS.values())


def _chained(models: list[tuple[int, HullModel]]) -> Callable[..., tuple[float, float, float]]:
    """One compiled function with the force of a hull of any model: the way from the code in its record."""
    (code, model), *others = models
    own: Any = model.force
    if not others:
        return own  # type: ignore[no-any-return]
    other: Any = _chained(others)

    @compiled
    def force(p, u, v, r):  # type: ignore[no-untyped-def]
        if p.hull_model == code:
            return own(p, u, v, r)
        return other(p, u, v, r)

    return force  # type: ignore[no-any-return]


hull_force = _chained(list(enumerate(HULLS.values())))
"""``hull_force(p, u, v, r)``: force and moment X [N], Y [N], N [N m] at velocities through the water."""
