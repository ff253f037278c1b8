"""The paper's campaign: sequences that are held, balanced, and share no second with each other."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from seatrial.acquisition.core.errors import DataShortageError
from seatrial.hybrid.effects import vessel_plant
from seatrial.hybrid.prediction.baselines import constant_velocity, score, simulate_reference
from seatrial.hybrid.vessel.files import load_vessel
from seatrial.notebooks.wang2021 import campaign as campaigns
from seatrial.notebooks.wang2021.campaign import AZIMUTHS_DEG, BEFORE_S, CampaignWindows, paper_campaign


@pytest.fixture(scope="module")
def calm() -> CampaignWindows:
    """Eight sequences in a calm: one or two of each of the six swings."""
    return paper_campaign("calm", seed=3, sequences=8)


@pytest.mark.parametrize(("sea_state", "sequences", "horizon_s"), [("gentle", 7, 12), ("calm", 6, 45)])
def test_any_number_and_length_of_sequences(sea_state: str, sequences: int, horizon_s: int) -> None:
    """Sequences longer than the paper's swings too: the swings are held for as long as it takes."""
    made = paper_campaign(sea_state, 1, sequences=sequences, horizon_s=horizon_s)
    assert len(made) == sequences
    assert made.windows.track.shape == (sequences, horizon_s + 1, 3)
    assert np.isfinite(made.windows.track).all()
    assert len(set(made.windows.leg)) == sequences
    _share_no_second(made)


def test_as_many_swings_to_either_side_at_each_azimuth(calm: CampaignWindows) -> None:
    """No swing is there more than once more often than another."""
    counts = Counter(calm.azimuth_deg.tolist())
    assert set(counts) == {side * angle for angle in AZIMUTHS_DEG for side in (-1.0, 1.0)}
    assert max(counts.values()) - min(counts.values()) <= 1


def test_the_thrusters_stand_where_they_were_ordered(calm: CampaignWindows) -> None:
    """Both pods at the order at the start, and to the end: the truth with thrusters held stays on the track."""
    reported_deg = np.rad2deg(calm.windows.control[:, [1, 3]])
    assert reported_deg == pytest.approx(np.repeat(calm.azimuth_deg[:, None], 2, axis=1), abs=1.0)
    gap = simulate_reference(calm.windows, calm.truth)[:, -1, :2] - calm.windows.track[:, -1, :2]
    travelled_m = np.linalg.norm(calm.windows.track[:, -1, :2] - calm.windows.track[:, 0, :2], axis=1)
    assert (np.hypot(*gap.T) < 0.02 * travelled_m).all()


def test_a_positive_azimuth_turns_the_ship_to_port(calm: CampaignWindows) -> None:
    turned = calm.windows.track[:, -1, 2] - calm.windows.track[:, 15, 2]
    assert (np.sign(turned) == -np.sign(calm.azimuth_deg)).all()


def test_sequences_share_no_second(calm: CampaignWindows) -> None:
    """Neither with each other nor with what another one knows of the time before its start."""
    _share_no_second(calm)


def _share_no_second(campaign: CampaignWindows) -> None:
    begins_s = (campaign.windows.start_time - campaign.windows.start_time[0]).total_seconds().to_numpy()
    between_s = np.diff(begins_s)
    assert (between_s > campaign.windows.horizon_s + BEFORE_S).all()
    assert np.isfinite(campaign.windows.past[1:, : BEFORE_S + 1]).all()


def test_the_floor_is_far_below_the_reference(calm: CampaignWindows) -> None:
    """The truth from the same measurements beats the ship before her elongation and the motion held."""
    windows = calm.windows
    short = vessel_plant(load_vessel("gunnerus_short"))
    floor, model, held = (
        score(each, windows.track).mean_distance_m
        for each in (
            simulate_reference(windows, calm.truth),
            simulate_reference(windows, short),
            constant_velocity(windows),
        )
    )
    assert floor < 0.25 * model
    assert floor < 0.5 * held


def test_in_a_calm_only_the_sensors_part_the_ship_from_her_measured_track(calm: CampaignWindows) -> None:
    """Centimetres after the filter; the heading, which turns, agrees too."""
    gap = calm.ship_track - calm.windows.track
    assert np.abs(gap[..., :2]).max() < 0.15
    assert np.abs(np.angle(np.exp(1j * gap[..., 2]))).max() < np.deg2rad(0.5)


def test_in_a_calm_the_true_ship_from_her_true_state_is_nearly_where_she_was(calm: CampaignWindows) -> None:
    """Nothing is unknown there but what the thrusters' feedback at second 0 errs by."""
    known = simulate_reference(replace(calm.windows, start=calm.ship_start), calm.truth)
    model = simulate_reference(calm.windows, vessel_plant(load_vessel("gunnerus_short")))
    off_m, model_off_m = (score(each, calm.ship_track).mean_distance_m for each in (known, model))
    assert off_m < 0.1 * model_off_m
    assert np.array_equal(known[:, 0], calm.ship_track[:, 0])


def test_the_same_seed_gives_the_same_campaign(calm: CampaignWindows) -> None:
    again, other = paper_campaign("calm", 3, sequences=8), paper_campaign("calm", 4, sequences=8)
    assert np.array_equal(again.windows.track, calm.windows.track)
    assert np.array_equal(again.windows.past, calm.windows.past, equal_nan=True)
    assert not np.array_equal(other.windows.track, calm.windows.track)


def test_too_short_a_trial_is_an_error_with_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(campaigns, "_STRETCHES", 0.1)
    with pytest.raises(DataShortageError, match=r"\d+ of 20 sequences found in \d+ s of zigzags in a calm sea"):
        paper_campaign("calm", sequences=20)
