"""What table and figures are made from: campaigns, and what every method predicts of each."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from acquisition.core.arrays import Floats
from acquisition.core.progress import Progress
from analysis.tables.resample import resample
from analysis.windows.held import held_windows
from hybrid.prediction.prediction_windows import PredictionWindows
from hybrid.reproduction.campaign import HORIZON_S, RATE_HZ, Campaign
from hybrid.reproduction.comparison import Errors, Job, compared, judged_by, parts_of
from hybrid.reproduction.processes import in_order
from hybrid.simulation.trial import simulate_trial

_EXAMPLE_S = 400.0


@dataclass(frozen=True, slots=True)
class Sea:
    """One sea state: its campaign, the reference's tracks on it, and the errors of all methods.

    ``unseen`` indexes the test sequences of the split by sequence; ``errors`` are those of
    :func:`~hybrid.reproduction.comparison.compared`.
    """

    job: Job
    campaign: Campaign
    reference: Floats
    unseen: NDArray[np.int64]
    errors: tuple[Errors, ...]

    @property
    def judged(self) -> PredictionWindows:
        """The windows that no method has seen."""
        return self.campaign.windows.subset(self.unseen)

    def gap_m(self, method: str, split: str = "sequence") -> Floats:
        """Predicted minus measured north and east [n, H, 2]."""
        return next(each.gap_m for each in self.errors if (each.method, each.split) == (method, split))

    def radius_m(self, method: str) -> Floats:
        """The radius of the method's 95 % regions on the unseen sequences [n, H]."""
        return next(each.radius_m for each in self.errors if (each.method, each.split) == (method, "sequence"))

    def predicted(self, method: str) -> Floats:
        """North and east that ``method`` predicts on the unseen sequences [n, H+1, 2]."""
        begin = self.judged.start[:, None, :2]
        return np.concatenate([begin, self.judged.track[:, 1:, :2] + self.gap_m(method)], axis=1)


def sea_of(job: Job) -> Sea:
    """Simulate the campaign of ``job``, train every method on it and judge them."""
    campaign, tracks = judged_by(job)
    unseen = np.flatnonzero(parts_of(campaign.windows, "sequence", job.seed).test.any(axis=1))
    return Sea(job, campaign, tracks, unseen, tuple(compared(job, campaign, tracks)))


def seas_of(
    jobs: Sequence[Job], workers: int | None = None, progress: Progress = lambda share: None
) -> tuple[Sea, ...]:
    """:func:`sea_of` each job, in their order; what comes out does not depend on the number of ``workers``."""
    return tuple(in_order([(sea_of, job) for job in jobs], workers or os.cpu_count() or 1, progress))


def example_sequence(sea_state: str, seed: int, vessel: str) -> pd.DataFrame:
    """One sequence of the campaign as it is recorded, every sample and channel, indexed by UTC."""
    table, _ = simulate_trial(vessel, sea_state, "paper", _EXAMPLE_S, RATE_HZ, seed)
    rows = held_windows(resample(table), HORIZON_S, 1, trial="example").rows
    first = rows[rows["second"] == 0]
    swung = first[(first["port_angle_deg"].abs() > 5.0) & (first["tunnel_rpm"].abs() < 5.0)]
    begin = pd.Timestamp(swung["start"].iloc[0])
    return table[(table.index >= begin) & (table.index < begin + pd.Timedelta(seconds=HORIZON_S))]
