"""How far predictions are off: the contract's figures, over windows and second by second."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from acquisition.core.arrays import Floats
from hybrid.prediction.prediction_windows import difference_rad


@dataclass(frozen=True, slots=True)
class Score:
    """Errors of one method over N windows of H seconds; means run over windows and seconds 1 to H."""

    mean_distance_m: float
    end_distance_m: float
    mae_north_m: float
    mae_east_m: float
    heading_error_deg: float
    by_second: tuple[float, ...]

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {**asdict(self), "by_second": list(self.by_second)}


def distances(predicted: Floats, measured: Floats) -> Floats:
    """How far apart two tracks [N, H+1, 2 or 3] are at seconds 1 to H [N, H], in metres."""
    gap = predicted[:, 1:, :2] - measured[:, 1:, :2]
    return np.asarray(np.hypot(gap[..., 0], gap[..., 1]))


def score(predicted: Floats, measured: Floats) -> Score:
    """Compare tracks [N, H+1, 3] of north, east [m] and heading [rad]."""
    gap = predicted[:, 1:] - measured[:, 1:]
    distance = distances(predicted, measured)
    turn = difference_rad(predicted[:, 1:, 2], measured[:, 1:, 2])
    return Score(
        mean_distance_m=float(distance.mean()),
        end_distance_m=float(distance[:, -1].mean()),
        mae_north_m=float(np.abs(gap[..., 0]).mean()),
        mae_east_m=float(np.abs(gap[..., 1]).mean()),
        heading_error_deg=float(np.rad2deg(np.abs(turn)).mean()),
        by_second=tuple(float(each) for each in distance.mean(axis=0)),
    )
