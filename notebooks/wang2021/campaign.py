"""The paper's campaign in one sea state, and every method on it: zigzags of the elongated ship, cut into sequences
of 30 s at 20 Hz.

The sequences are swings of the zigzags, at most one a swing, drawn at random but as many to either side and at each
azimuth. No second of a sequence lies in another sequence or in what another one knows of the time before its start:
split by sequence, a test sequence shares nothing with the training. Split at random, as the paper does, the rows
are the seconds of all sequences, and those before and after a test row are in the training: the leak.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import pandas as pd

from seatrial.acquisition.core.errors import DataShortageError, Progress
from seatrial.acquisition.core.quantities import Bools, Floats, Ints
from seatrial.acquisition.core.ship import names_of_kind
from seatrial.analysis.batch import map_calls
from seatrial.analysis.tables.resample import resample
from seatrial.analysis.tables.table import table_actuators
from seatrial.analysis.windows.held import OneHertzTables, held_windows
from seatrial.hybrid.calibrators import Examples, make_calibrator, refuse_untrainable
from seatrial.hybrid.effects import vessel_plant
from seatrial.hybrid.prediction.baselines import constant_velocity, relative_distances, simulate_reference
from seatrial.hybrid.prediction.dataset import start_motion
from seatrial.hybrid.prediction.window_sets import (
    PredictionWindows,
    draw_groups,
    replace_by_two_sided_starts,
    windows_from_rows,
)
from seatrial.hybrid.simulation.manoeuvres import Manoeuvre, manoeuvre_named
from seatrial.hybrid.simulation.trial import simulate_trial
from seatrial.hybrid.vessel.files import load_vessel
from seatrial.hybrid.vessel.plant import Plant

SEA_STATES = ("calm", "gentle", "moderate")
AZIMUTHS_DEG = (10.0, 20.0, 30.0)
SEQUENCES, HORIZON_S, RATE_HZ = 70, 30, 20.0
TRUTH, MODEL = "gunnerus_long", "gunnerus_short"
_SWINGS = tuple(side * angle for side, angle in product((-1.0, 1.0), AZIMUTHS_DEG))
_NEAR_DEG = 2.0

BEFORE_S = 60
"""How much of the past of a sequence no other takes part in, and is known of it [s]."""

_SETTLING_S = 8  # of thrusters after an order, and of the filters about it: part of a swing that is not held

_STRETCHES, _SPARE, _TRIES = 2.3, 8, 4
"""The trial is so many times as long as that many sequences, and a few more, laid end to end."""

TEST_SHARE, STOPPING_SHARE = 0.2, 0.2
OURS = "adaptive"
_EXAMPLE_S = 400.0

LEARNED = {"paper": "paper", "data_driven": "data_driven", "additive": "additive", "hybrid": OURS}
"""The methods of the table that learn, and the calibrator that each is."""

SPLITS = ("sequence", "random")


@dataclass(frozen=True, slots=True)
class CampaignWindows:
    """The sequences of one sea state as N windows, and the plant that made them.

    ``azimuth_deg`` [N] is the order of each sequence, positive turning the ship to port. ``truth`` is the
    ship in the mean current and drift of the sea state, ``ship_start`` [N, 6] its state at second 0 and
    ``ship_track`` [N, H+1, 3] its track, without the first-order motion in waves and without sensors.
    """

    windows: PredictionWindows
    azimuth_deg: Floats
    ship_start: Floats
    ship_track: Floats
    truth: Plant

    def __len__(self) -> int:
        return len(self.windows)

    def subset(self, chosen: Bools) -> CampaignWindows:
        """The sequences that a mask chooses."""
        return replace(
            self,
            windows=self.windows.subset(chosen),
            azimuth_deg=self.azimuth_deg[chosen],
            ship_start=self.ship_start[chosen],
            ship_track=self.ship_track[chosen],
        )


def paper_campaign(
    sea_state: str, seed: int = 0, vessel: str = TRUTH, sequences: int = SEQUENCES, horizon_s: int = HORIZON_S
) -> CampaignWindows:
    """The campaign in a sea state of ``trials/sea_states.toml``; the same seed gives the same campaign.

    Windows start from what is known afterwards, as a state that is taken for known. Raises
    :class:`DataShortageError` where the ship's zigzags do not give enough held swings.
    """
    manoeuvre = _held_for(manoeuvre_named("paper"), horizon_s)
    duration_s = _STRETCHES * (sequences + _SPARE) * (horizon_s + BEFORE_S)
    drawn = 0
    for _ in range(_TRIES):
        table, truth = simulate_trial(vessel, sea_state, manoeuvre, duration_s, RATE_HZ, seed)
        one_hz = resample(table)
        rows = held_windows(one_hz, horizon_s, 1, trial=f"{sea_state}-{seed}").rows
        numbers, azimuth_deg = _drawn(rows, sequences, horizon_s, seed)
        if len(numbers) == sequences:
            chosen = rows[rows["window"].isin(numbers)]
            past = {f"{sea_state}-{seed}": OneHertzTables(one_hz)}
            windows = replace_by_two_sided_starts(windows_from_rows(chosen, start_motion(chosen, one_hz), past))
            windows.past[:, BEFORE_S + 1 :] = np.nan
            begins_s = (windows.start_time - table.index[0]).total_seconds().to_numpy()
            offsets = np.round(np.arange(windows.horizon_s + 1) * RATE_HZ).astype(np.int64)
            ship = truth["states"][np.round(begins_s * RATE_HZ).astype(np.int64)[:, None] + offsets]
            return CampaignWindows(windows, azimuth_deg, ship[:, 0], ship[..., :3], truth["plant"])
        duration_s, drawn = 1.5 * duration_s, len(numbers)
    raise DataShortageError(
        f"{drawn} of {sequences} sequences found in {duration_s / 1.5:.0f} s of zigzags in a {sea_state} sea",
        fix="ask for fewer sequences or a shorter horizon",
    )


def _held_for(manoeuvre: Manoeuvre, horizon_s: int) -> Manoeuvre:
    """The manoeuvre with swings that are held long enough for a sequence each."""
    least_s = float(horizon_s + _SETTLING_S)
    return tuple(
        replace(leg, at_least_s=max(leg.at_least_s, least_s), at_most_s=max(leg.at_most_s, 2.0 * least_s))
        if np.isfinite(leg.deviation_deg)
        else leg
        for leg in manoeuvre
    )


def _drawn(rows: pd.DataFrame, sequences: int, horizon_s: int, seed: int) -> tuple[Ints, Floats]:
    """The numbers of the windows drawn, in time order, and the azimuth of each [deg]; fewer if there are no more.

    ``rows`` is the long table of held windows, a candidate every second.
    """
    first = rows[rows["second"] == 0].reset_index(drop=True)
    pods = [f"{name}_angle_deg" for name in names_of_kind(table_actuators(rows), "azimuth")]
    angles = rows.groupby("window", sort=True)[pods].median().to_numpy()
    swings = np.array(_SWINGS)
    deviation = np.abs(angles[:, None, :] - swings[:, None]).max(axis=2)  # of all pods from each order
    order_deg = np.where(deviation.min(axis=1) < _NEAR_DEG, swings[deviation.argmin(axis=1)], np.nan)
    begins_s = pd.DatetimeIndex(first["start"]).as_unit("s").asi8
    room = {swing: sequences // len(_SWINGS) for swing in _SWINGS}
    for swing in _SWINGS[: sequences % len(_SWINGS)]:
        room[swing] += 1
    apart_s, chosen_rows = horizon_s + BEFORE_S, list[int]()
    for candidate in np.random.default_rng(seed).permutation(len(first)):
        free = room.get(float(order_deg[candidate]), 0) > 0
        if free and all(abs(begins_s[candidate] - begins_s[accepted]) > apart_s for accepted in chosen_rows):
            room[order_deg[candidate]] -= 1
            chosen_rows.append(int(candidate))
    drawn = np.array(sorted(chosen_rows), dtype=np.int64)
    return first["window"].to_numpy(dtype=np.int64)[drawn], order_deg[drawn]


@dataclass(frozen=True, slots=True)
class CampaignJob:
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
class SequenceErrors:
    """Predicted minus measured north and east [n, H, 2] of the n sequences with test rows, NaN beside these.

    ``inside`` [n, H] is 1 where the method's 95 % region holds the measured position and 0 elsewhere, ``region_m``
    [n, H, 2] are its semi-axes; NaN for methods that have none.
    """

    gap_m: Floats
    inside: Floats
    region_m: Floats


def parts_of(windows: PredictionWindows, split: str, seed: int) -> Parts:
    """The parts of a split: whole sequences, or seconds drawn at random from all sequences."""
    shape = (len(windows), windows.horizon_s)
    if split == "random":
        drawn = np.random.default_rng(seed).random(shape)
        test = drawn < TEST_SHARE
        stopping = ~test & (drawn < TEST_SHARE + STOPPING_SHARE * (1.0 - TEST_SHARE))
        return Parts(~test & ~stopping, stopping, test)
    test = draw_groups(windows.leg, TEST_SHARE, seed)
    stopping = np.zeros(len(windows), dtype=bool)
    stopping[~test] = draw_groups(windows.leg[~test], STOPPING_SHARE, seed)
    rows = (np.broadcast_to(mask[:, None], shape) for mask in (~test & ~stopping, stopping, test))
    return Parts(*rows)


def _compare(
    job: CampaignJob, campaign: CampaignWindows, tracks: Floats, plant: Plant, split: str
) -> dict[str, SequenceErrors]:
    """The errors of every method on the test rows of a split, baselines and floor first."""
    windows, parts = campaign.windows, parts_of(campaign.windows, split, job.seed)
    tested = np.asarray(parts.test.any(axis=1))
    judged = windows.subset(tested)
    predicted = {
        "constant_velocity": constant_velocity(judged),
        "reference": tracks[tested],
        "floor": simulate_reference(judged, campaign.truth),
        "perfect_start": simulate_reference(replace(judged, start=campaign.ship_start[tested]), campaign.truth),
        "waves_only": campaign.ship_track[tested],
    }
    training = _examples(windows, tracks, parts.training)
    stopping = _examples(windows, tracks, parts.stopping)
    region_m = {method: np.full((len(judged), judged.horizon_s, 2), np.nan) for method in predicted}
    for method, calibrator in LEARNED.items():
        learned = make_calibrator(calibrator, job.seed, plant).fit(training, stopping)
        predicted[method], uncertainty = learned.predict_with_uncertainty(judged, tracks[tested])
        region_m[method] = uncertainty[..., None] * learned.conformal_region(stopping)
    measured = _masked(judged.track, parts.test[tested])
    errors = {}
    for method, track in predicted.items():
        relative = relative_distances(track, measured, region_m[method])
        inside = np.where(np.isfinite(relative), relative <= 1.0, np.nan)
        errors[method] = SequenceErrors((track[..., :2] - measured[..., :2])[:, 1:], inside, region_m[method])
    return errors


def _examples(windows: PredictionWindows, tracks: Floats, rows: Bools) -> Examples:
    """The windows with any of ``rows`` [N, H], with a measured track at these seconds only."""
    chosen_sequences = np.asarray(rows.any(axis=1))
    chosen = windows.subset(chosen_sequences)
    return replace(chosen, track=_masked(chosen.track, rows[chosen_sequences])), tracks[chosen_sequences]


def _masked(track: Floats, rows: Bools) -> Floats:
    """A track [N, H+1, 3] with NaN at the seconds 1 to H that are not in ``rows``."""
    measured = np.concatenate([np.ones((len(rows), 1), dtype=bool), rows], axis=1)
    return np.where(measured[..., None], track, np.nan)


@dataclass(frozen=True, slots=True)
class SeaResults:
    """One sea state: its campaign, the reference's tracks on it, and the errors by split and method."""

    job: CampaignJob
    campaign: CampaignWindows
    reference: Floats
    errors: Mapping[str, Mapping[str, SequenceErrors]]

    @property
    def unseen(self) -> Ints:
        """The numbers of the test sequences of the split by sequence."""
        return np.flatnonzero(parts_of(self.campaign.windows, "sequence", self.job.seed).test.any(axis=1))

    @property
    def judged(self) -> PredictionWindows:
        """The windows that no method has seen."""
        return self.campaign.windows.subset(self.unseen)

    def predicted(self, method: str) -> Floats:
        """North and east that ``method`` predicts on the unseen sequences [n, H+1, 2]."""
        begin = self.judged.start[:, None, :2]
        gap_m = self.errors["sequence"][method].gap_m
        return np.concatenate([begin, self.judged.track[:, 1:, :2] + gap_m], axis=1)


def sea_of(job: CampaignJob) -> SeaResults:
    """Simulate the campaign of ``job``, train every method on it under both splits, and judge them.

    Windows in which the reference leaves its range are left out.
    """
    complete = paper_campaign(job.sea_state, job.seed, job.vessel, job.sequences, job.horizon_s)
    plant = vessel_plant(load_vessel(job.model))
    tracks = simulate_reference(complete.windows, plant)
    inside = np.asarray(np.isfinite(tracks).all(axis=(1, 2)))
    campaign, tracks = complete.subset(inside), tracks[inside]
    return SeaResults(
        job, campaign, tracks, {split: _compare(job, campaign, tracks, plant, split) for split in SPLITS}
    )


def seas_of(
    jobs: Sequence[CampaignJob],
    workers: int | None = None,
    progress: Progress = lambda share: None,
    finished: Callable[[SeaResults], None] = lambda sea: None,
) -> tuple[SeaResults, ...]:
    """:func:`sea_of` each job, in their order; what comes out does not depend on the number of ``workers``.

    ``finished`` is called with each one as soon as it is there.
    """
    refuse_untrainable("paper")  # before the simulations
    calls = [(sea_of, job) for job in jobs]
    return tuple(map_calls(calls, workers, progress, lambda number, sea: finished(sea)))


def example_sequence(job: CampaignJob) -> pd.DataFrame:
    """One sequence of a campaign as it is recorded, every sample and channel, indexed by UTC."""
    table, _ = simulate_trial(job.vessel, job.sea_state, "paper", _EXAMPLE_S, RATE_HZ, job.seed)
    rows = held_windows(resample(table), HORIZON_S, 1, trial="example").rows
    first = rows[rows["second"] == 0]
    actuators = table_actuators(table)
    turned = first[f"{names_of_kind(actuators, 'azimuth')[0]}_angle_deg"].abs() > 5.0
    idle = (first[[f"{name}_rpm" for name in names_of_kind(actuators, "tunnel")]].abs() < 5.0).all(axis=1)
    begin = pd.Timestamp(first.loc[turned & idle, "start"].iloc[0])
    return table[(table.index >= begin) & (table.index < begin + pd.Timedelta(seconds=HORIZON_S))]
