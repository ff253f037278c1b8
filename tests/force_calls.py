"""The forces that the compiled simulator is made of, for tests that ask for one on its own.

They are compiled into the simulator, and kept with it; on their own they would be compiled in every run of the
tests, for seconds each.
"""

from __future__ import annotations

from typing import Any

from numba import njit

from seatrial.analysis.compiling import FAST
from seatrial.hybrid.vessel import dynamics, hulls, wind
from seatrial.hybrid.vessel.actuators import azimuth
from seatrial.hybrid.vessel.hulls import cross_flow
from seatrial.hybrid.vessel.plant import PHYSICS_STAMP


def _kept(stamp: int) -> tuple[Any, ...]:
    """The calls below; the stamp of the equations is part of what numba keeps them by."""
    keep = njit(cache=True, fastmath=FAST, error_model="numpy")

    @keep
    def actuators_force(p, control, work, u, v, r):  # type: ignore[no-untyped-def]
        """Of controls that are held, in still water."""
        if stamp != 0:
            dynamics.step_constants(p, control, work, 0.0, 0.0)
        return dynamics.actuators_force(p, work, u, v, r)

    @keep
    def hull_force(p, u, v, r):  # type: ignore[no-untyped-def]
        return hulls.hull_force(p, u, v, r) if stamp != 0 else (0.0, 0.0, 0.0)

    @keep
    def drag_across(v, w):  # type: ignore[no-untyped-def]
        return cross_flow.cross_flow_drag_integrals(v, w) if stamp != 0 else (0.0, 0.0)

    @keep
    def wind_force(p, ahead, across):  # type: ignore[no-untyped-def]
        return wind.wind_force(p, ahead, across) if stamp != 0 else (0.0, 0.0, 0.0)

    @keep
    def azimuth_force(p, i, work, u, v, r):  # type: ignore[no-untyped-def]
        return azimuth.force(p, i, work, u, v, r) if stamp != 0 else (0.0, 0.0, 0.0)

    return actuators_force, hull_force, drag_across, wind_force, azimuth_force


actuators_force, hull_force, drag_across, wind_force, azimuth_force = _kept(PHYSICS_STAMP)
