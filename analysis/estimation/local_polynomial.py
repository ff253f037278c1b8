"""Two-sided smoothing of the motion by local polynomials, which removes waves and noise.

A prediction over half a minute starts from a speed and a heading. In waves with a period of five seconds the
measured ones oscillate by decimetres a second and tenths of a degree, which is no basis for a prediction. Each
motion channel is replaced by a local second-degree polynomial fitted to the samples within 10 s on either side,
weighted with a raised cosine (Savitzky and Golay 1964, with weights; Cleveland 1979): slow motion and its
curvature are reproduced exactly, waves of 4 to 8 s are attenuated by a factor of ten and more.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from seatrial.acquisition.core.quantities import Floats
from seatrial.acquisition.core.ship import POSE_AND_VELOCITY, is_circular, unwrap, wrap_360

HALF_WIDTH_S, USUAL_LENGTH_M = 10.0, 25.0
_LEAST_SAMPLES = 5


def half_width_for(length_m: float) -> float:
    """The half-width of the fits for a ship of this length [s]: :data:`HALF_WIDTH_S`, scaled with the root of
    the length below :data:`USUAL_LENGTH_M`, since a model moves that much faster (Froude)."""
    return HALF_WIDTH_S * min(1.0, float(np.sqrt(length_m / USUAL_LENGTH_M)))


def smooth_motion(table: pd.DataFrame, half_width_s: float = HALF_WIDTH_S) -> pd.DataFrame:
    """Smooth the motion channels of a table with evenly spaced rows; NaN stays NaN.

    Near gaps and ends the fit is one-sided; with fewer than five samples nearby, values are unchanged.
    """
    times_ns = pd.DatetimeIndex(table.index).as_unit("ns").asi8
    step_s = float(np.median(np.diff(times_ns))) / 1e9 if len(table) > 1 else 1.0
    columns = {}
    for name in POSE_AND_VELOCITY:
        values = table[name].to_numpy(dtype=float)
        smooth = local_quadratic(unwrap(values) if is_circular(name) else values, half_width_s / step_s)
        columns[name] = wrap_360(smooth) if is_circular(name) else smooth
    return pd.DataFrame(columns, index=table.index)


def local_quadratic(values: Floats, half_width: float) -> Floats:
    """A weighted second-degree fit around each sample [rows], evaluated there; ``half_width`` in samples.

    The normal equations of all fits are nine convolutions; each is then a 3 by 3 system.
    """
    reach = int(np.ceil(half_width))
    offset = np.arange(-reach, reach + 1) / max(half_width, 1.0)
    weight = 0.5 + 0.5 * np.cos(np.pi * np.clip(offset, -1.0, 1.0))
    present = np.isfinite(values)
    if not present.any() or reach < 1:
        return values.copy()
    centre = float(values[present].mean())
    filled = np.where(present, values - centre, 0.0)
    moments = [_weighted_sum(present.astype(float), weight * offset**k) for k in range(5)]
    products = [_weighted_sum(filled, weight * offset**k) for k in range(3)]
    samples_in_reach = _weighted_sum(present.astype(float), (weight > 0).astype(float))
    normal = np.stack([np.stack([moments[i + j] for j in range(3)], axis=-1) for i in range(3)], axis=-2)
    right = np.stack(products, axis=-1)[..., None]
    fitted = values.copy()
    enough = present & (samples_in_reach >= _LEAST_SAMPLES)
    fitted[enough] = np.linalg.solve(normal[enough], right[enough])[:, 0, 0] + centre
    return fitted


def _weighted_sum(values: Floats, kernel: Floats) -> Floats:
    """The sum of ``values`` around each sample, weighted with a kernel of odd length."""
    reach = kernel.size // 2
    return np.asarray(np.convolve(values, kernel[::-1])[reach : reach + values.size])
