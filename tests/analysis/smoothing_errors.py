"""A smoothed motion against a known truth: errors, coverage of the 95 % bands, normalised error squared."""

from __future__ import annotations

import numpy as np
import pandas as pd

from seatrial.acquisition.core.quantities import Bools, Floats
from seatrial.acquisition.core.ship import angle_difference
from seatrial.analysis.estimation.motion_model import BODY
from seatrial.analysis.estimation.smoother import SmoothedMotion

_NORMAL_95 = 1.959964


def errors_of(smoothed: SmoothedMotion, truth: pd.DataFrame) -> Floats:
    """Estimate minus truth [rows, 9] in SI, angles in radians; NaN where either says nothing.

    ``truth`` has the columns of the states, or those six that are channels, at times that include the rows'.
    """
    aligned = truth.reindex(smoothed.states.index)
    errors = np.full(smoothed.states.shape, np.nan)
    for number, name in enumerate(BODY):
        if name not in aligned:
            continue
        apart = smoothed.states[name].to_numpy() - aligned[name].to_numpy()
        if name == "heading_deg":
            apart = angle_difference(smoothed.states[name], aligned[name])
        errors[:, number] = np.deg2rad(apart) if name in ("heading_deg", "yaw_rate_dps", "yaw_dps2") else apart
    return errors


def with_accelerations(perfect: pd.DataFrame) -> pd.DataFrame:
    """A noise-free table of the six motion channels with the rates of change of its velocities."""
    seconds = perfect.index.as_unit("ns").asi8 / 1e9  # type: ignore[attr-defined]
    rates = {
        f"{name.rsplit('_', 1)[0].removesuffix('_rate')}_{'dps2' if name.endswith('dps') else 'mps2'}": np.gradient(
            perfect[name].to_numpy(), seconds - seconds[0]
        )
        for name in ("surge_mps", "sway_mps", "yaw_rate_dps")
    }
    return perfect.assign(**rates)


def coverage(smoothed: SmoothedMotion, truth: pd.DataFrame, margin_s: float = 0.0) -> dict[str, float]:
    """The share of rows in which each state's 95 % band holds the truth; ``margin_s`` at the ends is left out."""
    errors = errors_of(smoothed, truth)
    deviation = np.sqrt(np.diagonal(smoothed.covariance, axis1=1, axis2=2))
    inside = np.abs(errors) <= _NORMAL_95 * deviation
    some = _interior(smoothed.states, margin_s)
    return {
        name: float(inside[some & np.isfinite(errors[:, number]), number].mean())
        for number, name in enumerate(BODY)
        if np.isfinite(errors[:, number]).any()
    }


def nees(smoothed: SmoothedMotion, truth: pd.DataFrame, states: int = 6) -> Floats:
    """Normalised estimation error squared [rows] of the first ``states``; its mean is their number."""
    errors = errors_of(smoothed, truth)[:, :states]
    rows = np.flatnonzero(np.isfinite(errors).all(axis=1))
    result = np.full(len(errors), np.nan)
    some = smoothed.covariance[rows][:, :states, :states]
    result[rows] = np.einsum("ki,ki->k", errors[rows], np.linalg.solve(some, errors[rows][..., None])[..., 0])
    return result


def _interior(states: pd.DataFrame, margin_s: float) -> Bools:
    index, margin = pd.DatetimeIndex(states.index), pd.Timedelta(seconds=margin_s)
    return np.asarray((index >= index[0] + margin) & (index <= index[-1] - margin))
