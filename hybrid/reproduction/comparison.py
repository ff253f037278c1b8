"""One campaign, every method, two splits: what each predicts on sequences, or on seconds, it was not trained on.

Split by sequence, a test sequence shares nothing with the training. Split at random, as the paper does, the rows
are the seconds of all sequences, and those before and after a test row are in the training: the leak.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from acquisition.core.arrays import Bools, Floats
from acquisition.core.progress import Progress
from analysis.batch.workers import map_calls
from analysis.tables.resample import resample
from analysis.windows.held import held_windows
from hybrid.calibrators import make_calibrator
from hybrid.calibrators.calibrator import Examples
from hybrid.effects.catalogue import vessel_plant
from hybrid.prediction.baselines import constant_velocity, reference
from hybrid.prediction.prediction_windows import PredictionWindows, split_by_group
from hybrid.reproduction.campaign import HORIZON_S, MODEL, RATE_HZ, SEQUENCES, TRUTH, Campaign, paper_campaign
from hybrid.simulation.trial import simulate_trial
from hybrid.vessel.files import load_vessel
from hybrid.vessel.plant import Plant

TEST_SHARE, STOPPING_SHARE = 0.2, 0.2
OURS = "adaptive"
_EXAMPLE_S = 400.0
LEARNED = {"paper": "paper", "data_driven": "data_driven", "additive": "additive", "hybrid": OURS}
"""The methods of the table that learn, and the calibrator that each is."""
SPLITS = ("sequence", "random")


@dataclass(frozen=True, slots=True)
class Job:
    """What is compared: one campaign, by its sea state and seed."""

    sea_state: str
    seed: int
    sequences: int = SEQUENCES
    horizon_s: int = HORIZON_S
    vessel: str = TRUTH
    model: str = MODEL


@dataclass(frozen=True, slots=True)
class Parts:
    """Which seconds [N, H] a method learns from, stops by and is judged on; no second is in two of them."""

    training: Bools
    stopping: Bools
    test: Bools


@dataclass(frozen=True, slots=True)
class Errors:
    """Predicted minus measured north and east [n, H, 2] of the n sequences with test rows, NaN beside these.

    ``radius_m`` [n, H] is that of the method's 95 % regions, NaN for those that have none.
    """

    job: Job
    method: str
    split: str
    gap_m: Floats
    radius_m: Floats


def campaign_of(job: Job) -> tuple[Campaign, Floats]:
    """The campaign of a job and the reference's tracks on it, without windows in which it leaves its range."""
    campaign = paper_campaign(job.sea_state, job.seed, job.vessel, job.sequences, job.horizon_s)
    tracks = reference(campaign.windows, vessel_plant(load_vessel(job.model)))
    inside = np.asarray(np.isfinite(tracks).all(axis=(1, 2)))
    return campaign.subset(inside), tracks[inside]


def compare_methods(job: Job, campaign: Campaign, tracks: Floats) -> list[Errors]:
    """The errors of every method on a campaign under both splits."""
    plant = vessel_plant(load_vessel(job.model))
    return [
        error
        for split in SPLITS
        for error in _compare(job, campaign, tracks, plant, split, parts_of(campaign.windows, split, job.seed))
    ]


def parts_of(windows: PredictionWindows, split: str, seed: int) -> Parts:
    """The parts of a split: whole sequences, or seconds drawn at random from all sequences."""
    shape = (len(windows), windows.horizon_s)
    if split == "random":
        drawn = np.random.default_rng(seed).random(shape)
        test = drawn < TEST_SHARE
        stopping = ~test & (drawn < TEST_SHARE + STOPPING_SHARE * (1.0 - TEST_SHARE))
        return Parts(~test & ~stopping, stopping, test)
    learned, held_out = split_by_group(windows.leg, TEST_SHARE, seed)
    _, stops = split_by_group(windows.leg[learned], STOPPING_SHARE, seed)
    stopping = np.zeros(len(windows), dtype=bool)
    stopping[np.flatnonzero(learned)[stops]] = True
    rows = (np.broadcast_to(each[:, None], shape) for each in (learned & ~stopping, stopping, held_out))
    return Parts(*rows)


def _compare(job: Job, campaign: Campaign, tracks: Floats, plant: Plant, split: str, parts: Parts) -> list[Errors]:
    """The errors on the test rows, baselines and floor first."""
    windows = campaign.windows
    tested = np.asarray(parts.test.any(axis=1))
    judged = windows.subset(tested)
    predicted = {
        "constant_velocity": constant_velocity(judged),
        "reference": tracks[tested],
        "floor": reference(judged, campaign.truth),
        "perfect_start": reference(replace(judged, start=campaign.ship_start[tested]), campaign.truth),
        "waves_only": campaign.ship_track[tested],
    }
    training = _examples(windows, tracks, parts.training)
    stopping = _examples(windows, tracks, parts.stopping)
    radius_m = {method: np.full((len(judged), judged.horizon_s), np.nan) for method in predicted}
    for method, calibrator in LEARNED.items():
        learned = make_calibrator(calibrator, job.seed, plant).fit(training, stopping)
        predicted[method], uncertainty = learned.predict_with_uncertainty(judged, tracks[tested])
        radius_m[method] = uncertainty * learned.conformal_radius(stopping)
    measured = _masked(judged.track, parts.test[tested])
    return [
        Errors(job, method, split, (track[..., :2] - measured[..., :2])[:, 1:], radius_m[method])
        for method, track in predicted.items()
    ]


def _examples(windows: PredictionWindows, tracks: Floats, rows: Bools) -> Examples:
    """The windows with any of ``rows`` [N, H], with a measured track at these seconds only."""
    some = np.asarray(rows.any(axis=1))
    chosen = windows.subset(some)
    return replace(chosen, track=_masked(chosen.track, rows[some])), tracks[some]


def _masked(track: Floats, rows: Bools) -> Floats:
    """A track [N, H+1, 3] with NaN at the seconds 1 to H that are not in ``rows``."""
    kept = np.concatenate([np.ones((len(rows), 1), dtype=bool), rows], axis=1)
    return np.where(kept[..., None], track, np.nan)


@dataclass(frozen=True, slots=True)
class Sea:
    """One sea state: its campaign, the reference's tracks on it, and the errors of all methods.

    ``unseen`` indexes the test sequences of the split by sequence; ``errors`` are those of
    :func:`compare_methods`.
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
    campaign, tracks = campaign_of(job)
    unseen = np.flatnonzero(parts_of(campaign.windows, "sequence", job.seed).test.any(axis=1))
    return Sea(job, campaign, tracks, unseen, tuple(compare_methods(job, campaign, tracks)))


def seas_of(
    jobs: Sequence[Job], workers: int | None = None, progress: Progress = lambda share: None
) -> tuple[Sea, ...]:
    """:func:`sea_of` each job, in their order; what comes out does not depend on the number of ``workers``."""
    return tuple(map_calls([(sea_of, job) for job in jobs], workers, progress))


def example_sequence(sea_state: str, seed: int, vessel: str) -> pd.DataFrame:
    """One sequence of the campaign as it is recorded, every sample and channel, indexed by UTC."""
    table, _ = simulate_trial(vessel, sea_state, "paper", _EXAMPLE_S, RATE_HZ, seed)
    rows = held_windows(resample(table), HORIZON_S, 1, trial="example").rows
    first = rows[rows["second"] == 0]
    swung = first[(first["port_angle_deg"].abs() > 5.0) & (first["tunnel_rpm"].abs() < 5.0)]
    begin = pd.Timestamp(swung["start"].iloc[0])
    return table[(table.index >= begin) & (table.index < begin + pd.Timedelta(seconds=HORIZON_S))]
