"""One campaign, every method, two splits: what each predicts on sequences, or on seconds, it was not trained on.

Split by sequence, a test sequence shares nothing with the training. Split at random, as the paper does, the rows
are the seconds of all sequences, and those before and after a test row are in the training: the leak.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from acquisition.core.arrays import Bools, Floats
from hybrid.calibrators import make_calibrator
from hybrid.calibrators.calibrator import Examples
from hybrid.effects.catalogue import vessel_plant
from hybrid.prediction.baselines import constant_velocity, reference
from hybrid.prediction.prediction_windows import PredictionWindows, split_by_group
from hybrid.reproduction.campaign import HORIZON_S, MODEL, SEQUENCES, TRUTH, Campaign, paper_campaign
from hybrid.vessel.files import load_vessel
from hybrid.vessel.plant import Plant

TEST_SHARE, STOPPING_SHARE = 0.2, 0.2
OURS = "adaptive"
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


def judged_by(job: Job) -> tuple[Campaign, Floats]:
    """The campaign of a job and the reference's tracks on it, without windows in which it leaves its range."""
    campaign = paper_campaign(job.sea_state, job.seed, job.vessel, job.sequences, job.horizon_s)
    tracks = reference(campaign.windows, vessel_plant(load_vessel(job.model)))
    inside = np.asarray(np.isfinite(tracks).all(axis=(1, 2)))
    return campaign.subset(inside), tracks[inside]


def compared(job: Job, campaign: Campaign, tracks: Floats) -> list[Errors]:
    """The errors of every method on a campaign under both splits."""
    plant = vessel_plant(load_vessel(job.model))
    return [
        error
        for split in SPLITS
        for error in _compared(job, campaign, tracks, plant, split, parts_of(campaign.windows, split, job.seed))
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


def _compared(job: Job, campaign: Campaign, tracks: Floats, plant: Plant, split: str, parts: Parts) -> list[Errors]:
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
