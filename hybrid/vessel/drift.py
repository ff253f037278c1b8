"""Steady forces that the reference model lacks: second-order wave drift and constant body forces.

Neutral in every vessel file; the effects of the catalogue switch them on.
"""

from __future__ import annotations

from analysis.compiling import Record, compiled


@compiled
def wave_drift_force(p: Record, cosine: float, sine: float) -> tuple[float, float, float]:
    """Mean second-order wave force X [N], Y [N], N [N m] at the heading with this cosine and sine.

    With b the angle from the bow to where the waves go, the force is 0.35 F cos b ahead and F sin b to
    starboard, its moment 0.06 Loa F sin 2b; F is the force in beam sea.
    """
    F = p.drift_force_n
    cos_b = p.drift_north * cosine + p.drift_east * sine
    sin_b = p.drift_east * cosine - p.drift_north * sine
    return 0.35 * F * cos_b, F * sin_b, 0.12 * p.length_overall_m * F * sin_b * cos_b


@compiled
def constant_force(p: Record) -> tuple[float, float, float]:
    """The constant force and moment in body axes X [N], Y [N], N [N m] (towed load, asymmetry)."""
    return p.constant_X_n, p.constant_Y_n, p.constant_N_nm
