"""The map of reference, hybrid and pure data: the errors at every point, who wins, and where the borders lie.

How bad a reference is, is always said as its own mean distance on the windows judged, so that the user of another
model finds his place on the map.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from acquisition.core.arrays import Bools, Floats
from hybrid.reproduction.degradation import OVERALL

SAME = 0.05
"""Two methods whose errors differ by a smaller share than this count as equally good: another seed moves a small
network by as much."""
LEAST_M = 1e-3
"""Errors below a millimetre count as one."""


@dataclass(frozen=True, slots=True)
class FidelityMap:
    """Mean distances [m] on unseen windows: D references, W amounts of data.

    ``reference_m`` [D] is each degraded reference alone, ``hybrid_m`` [D, W] the calibrator ``method`` on it,
    ``data_driven_m`` [W] the data alone; ``axis`` and ``label`` [D] say what was degraded.
    """

    method: str
    axis: tuple[str, ...]
    label: tuple[str, ...]
    windows: tuple[int, ...]
    reference_m: Floats
    hybrid_m: Floats
    data_driven_m: Floats
    constant_velocity_m: float
    unseen_windows: int
    seeds: tuple[int, ...]

    @property
    def rivals(self) -> tuple[str, ...]:
        """The methods compared, in the order of :meth:`errors_m`."""
        return "reference", "constant_velocity", "data_driven", self.method

    def errors_m(self) -> Floats:
        """Mean distance of every rival at every point of the map [4, D, W]."""
        shape = self.hybrid_m.shape
        alone = np.broadcast_to(self.reference_m[:, None], shape)
        data = np.broadcast_to(self.data_driven_m[None, :], shape)
        return np.stack([alone, np.full(shape, self.constant_velocity_m), data, self.hybrid_m])

    def overall(self) -> FidelityMap:
        """The main axis alone, the best reference first."""
        rows = [number for number, axis in enumerate(self.axis) if axis == OVERALL]
        rows.sort(key=lambda row: float(self.reference_m[row]))
        return replace(
            self,
            axis=tuple(self.axis[row] for row in rows),
            label=tuple(self.label[row] for row in rows),
            reference_m=self.reference_m[rows],
            hybrid_m=self.hybrid_m[rows],
        )

    def as_dict(self) -> dict[str, Any]:
        """For JSON, with the thresholds; none where there is no limit."""
        plain = {name: value.tolist() if isinstance(value, np.ndarray) else value
                 for name, value in asdict(self).items()}  # fmt: skip
        limits = [None if np.isinf(each) else float(each) for each in useful_up_to_m(self)]
        return {**plain, "useful_up_to_m": limits}


def useful_up_to_m(found: FidelityMap) -> Floats:
    """The reference's own error up to which the hybrid is better than the data alone, per amount of data [W].

    Better is by more than :data:`SAME`. Zero where not even the best reference helps, infinite where the worst
    still does; between two references it is interpolated on the logarithm of their errors.
    """
    main = found.overall()
    gain = np.asarray(1.0 - main.hybrid_m / main.data_driven_m - SAME)
    log_errors = np.log(np.maximum(main.reference_m, LEAST_M))
    return np.array([_falls_below_zero(log_errors, column) for column in gain.T])


def _falls_below_zero(log_errors: Floats, gain: Floats) -> float:
    useless = np.flatnonzero(gain <= 0.0)
    if not useless.size:
        return float("inf")
    after = int(useless[0])
    if after == 0:
        return 0.0
    share = gain[after - 1] / (gain[after - 1] - gain[after])
    return float(np.exp(log_errors[after - 1] + share * (log_errors[after] - log_errors[after - 1])))


def enough_alone_m(found: FidelityMap) -> Floats:
    """Up to which of the references tried no other method beats the reference by more than :data:`SAME` [W].

    Zero where the best of them is beaten.
    """
    main = found.overall()
    others = main.errors_m()[1:].min(axis=0)
    enough = np.logical_and.accumulate(main.reference_m[:, None] * (1.0 - SAME) <= others, axis=0)
    return np.asarray(np.where(enough, main.reference_m[:, None], 0.0).max(axis=0))


def hybrid_wins(found: FidelityMap) -> Bools:
    """Where on the main axis the hybrid beats all others, constant velocity included [D, W]."""
    return edge(found.overall()) < 1.0 - SAME


def edge(found: FidelityMap) -> Floats:
    """The hybrid's error over that of the best of all other methods [D, W]."""
    return np.asarray(found.hybrid_m / np.maximum(found.errors_m()[:-1].min(axis=0), LEAST_M))
