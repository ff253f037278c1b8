"""The small functions that the Kalman kernels are made of, for tests that call one on its own.

They are compiled into the kernels that call them, and kept with those; on their own they would be compiled in every
run of the tests, for seconds each.
"""

from __future__ import annotations

from typing import Any

from numba import njit

from seatrial.analysis.compiling import FAST
from seatrial.analysis.estimation import kalman_kernel as kernel
from seatrial.hybrid.diagnosis import disturbance_model as model


def _kept(stamp: int) -> tuple[Any, ...]:
    """The calls below; the stamp of the equations is part of what numba keeps them by."""
    keep = njit(cache=True, fastmath=FAST, error_model="numpy")

    @keep
    def states_of(noise):  # type: ignore[no-untyped-def]
        return model.states_of(noise) if stamp != 0 else 0

    @keep
    def initial_covariance(noise, origin, free, P):  # type: ignore[no-untyped-def]
        if stamp != 0:
            model.initial_covariance(noise, origin, free, P)

    @keep
    def transition(A, B, noise, origin, F, Q):  # type: ignore[no-untyped-def]
        if stamp != 0:
            model.transition(A, B, noise, origin, F, Q)

    @keep
    def measurement_rows(H, origin, noise, rows):  # type: ignore[no-untyped-def]
        if stamp != 0:
            model.measurement_rows(H, origin, noise, rows)

    @keep
    def predict_covariance(F, Q, P, work):  # type: ignore[no-untyped-def]
        if stamp != 0:
            kernel.predict_covariance(F, Q, P, work)

    @keep
    def projected_variance(P, h, Ph):  # type: ignore[no-untyped-def]
        return kernel.projected_variance(P, h, Ph) if stamp != 0 else 0.0

    return states_of, initial_covariance, transition, measurement_rows, predict_covariance, projected_variance


(
    states_of, initial_covariance, transition, measurement_rows, predict_covariance, projected_variance
) = _kept(model.STAMP)  # fmt: skip
