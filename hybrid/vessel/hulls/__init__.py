"""The hull models, one file each, and the compiled loop's way from a model's code to its force.

To add a model: a file like ``mmg.py`` and a line in :data:`HULLS`.
"""

from __future__ import annotations

from seatrial.analysis.compiling import compiled, dispatch_by_code
from seatrial.hybrid.vessel.hulls import cross_flow, kind, mmg, polynomial

HULLS: dict[str, kind.HullModel] = {
    "polynomial": polynomial.POLYNOMIAL,
    "mmg": mmg.MMG,
    "cross_flow": cross_flow.CROSS_FLOW,
}
HULL_CODES: dict[str, float] = {name: float(code) for code, name in enumerate(HULLS)}
HULL_SIZE = max(len(model.numbers) for model in HULLS.values())


@compiled
def _model_of(p, u, v, r):  # type: ignore[no-untyped-def]
    return p.hull_model


hull_force = dispatch_by_code([model.force for model in HULLS.values()], _model_of)
"""``hull_force(p, u, v, r)``: force and moment X [N], Y [N], N [N m] at velocities through the water."""
