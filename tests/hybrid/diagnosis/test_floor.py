"""What noise alone leaves, against windows drawn second by second from the same levels."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from seatrial.acquisition.core.quantities import Floats
from seatrial.hybrid.diagnosis import gap
from seatrial.hybrid.diagnosis.disturbance_model import DisturbanceNoise, smooth_state
from seatrial.hybrid.diagnosis.gap import HeldOutGap, noise_floor_m, with_noise_floor
from seatrial.hybrid.diagnosis.linearise import LinearModel
from seatrial.hybrid.diagnosis.regression import NormalEquations
from seatrial.hybrid.diagnosis.result import Gap
from tests.hybrid.diagnosis.linear_by_hand import DISTURBANCES, a_ship, one_column
from tests.hybrid.diagnosis.made_up import tracks

EDGES = 40 * np.arange(6)
STARTS = np.array([0, 20, 60, 100, 140])
HORIZON_S, DRAWS = 15, 300


@pytest.mark.parametrize("noise", DISTURBANCES.values(), ids=DISTURBANCES)
def test_it_is_the_mean_distance_of_drawn_windows(noise: DisturbanceNoise) -> None:
    linear = a_ship(int(EDGES[-1]), 61)
    examination = cast(
        "NormalEquations", SimpleNamespace(linear=linear, noise=noise, log=SimpleNamespace(block_edges=EDGES))
    )
    variance = smooth_state(linear, one_column(linear.observed), noise, EDGES)[1]
    random = np.random.default_rng(62)
    away = np.concatenate([_drawn_distances(linear, variance, noise, at, random) for at in STARTS])
    assert noise_floor_m(examination, STARTS, HORIZON_S) == pytest.approx(away.mean(), rel=0.06)


def _drawn_distances(
    linear: LinearModel, variance: Floats, noise: DisturbanceNoise, start: int, random: np.random.Generator
) -> Floats:
    """Distances [draws, H] of one window's measured from its predicted track."""
    x = random.standard_normal((DRAWS, 6)) * np.sqrt(variance[start, :6])
    slow, kept = random.standard_normal((DRAWS, 3)) * noise.slow, np.exp(-1.0 / noise.slow_s)
    wave, stays = random.standard_normal((DRAWS, 1)) * noise.wave_drift_n, np.exp(-1.0 / noise.wave_drift_s)
    seen = np.sqrt(noise.position_m**2 + noise.drift[0] ** 2 + np.square(noise.waves[:2]))
    result = []
    for k in range(start, start + HORIZON_S):
        b = noise.wave_towards_rad - linear.origin[k, 2]
        pushed = np.array([0.35 * np.cos(b), np.sin(b), 0.06 * noise.length_m * np.sin(2.0 * b)])
        force = slow + wave * pushed + random.standard_normal((DRAWS, 3)) * noise.gust
        x = x @ linear.A[k].T + force @ linear.B[k].T
        slow = kept * slow + np.sqrt(1.0 - kept**2) * random.standard_normal((DRAWS, 3)) * noise.slow
        wave = stays * wave + np.sqrt(1.0 - stays**2) * random.standard_normal((DRAWS, 1)) * noise.wave_drift_n
        result.append(np.linalg.norm(x[:, :2] + random.standard_normal((DRAWS, 2)) * seen, axis=1))
    return np.column_stack(result)


def test_more_noise_leaves_more() -> None:
    linear, log = a_ship(int(EDGES[-1]), 63), SimpleNamespace(block_edges=EDGES)
    left = [
        noise_floor_m(
            cast("NormalEquations", SimpleNamespace(linear=linear, noise=each, log=log)), STARTS, HORIZON_S
        )
        for each in (
            DisturbanceNoise(),
            DisturbanceNoise(gust=(3e3, 3e3, 3e4)),
            DisturbanceNoise(gust=(9e3, 9e3, 9e4)),
        )
    ]
    assert left == sorted(left)
    assert left[2] > 2.0 * left[0]


def test_shares_add_up_to_what_is_closed_with_noise_as_the_floor(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a floor that lies lower, the same effects close less."""
    monkeypatch.setattr(gap, "noise_floor_m", lambda *_: 0.1)
    monkeypatch.setattr(gap, "window_starts", lambda log: np.zeros(1))
    held = HeldOutGap(Gap(1.0, 0.4, 0.4, 1.2, 10, 15), {"trim": 0.75, "skeg": 0.25}, tracks(), {}, 0.4)
    lower = with_noise_floor(held, cast("NormalEquations", SimpleNamespace(log=None)))
    assert lower.gap.closed == pytest.approx(2.0 / 3.0)
    assert sum(lower.shares.values()) == pytest.approx(lower.gap.closed)
    assert lower.shares["trim"] == pytest.approx(3.0 * lower.shares["skeg"])


def test_an_error_of_three_times_the_noise_is_never_nothing() -> None:
    """With the sizes that fit best; a poor choice on held-out legs alone says nothing."""
    held = HeldOutGap(Gap(1.0, 0.4, 0.1, 1.2, 10, 15), {}, tracks(), {}, 0.31)
    assert held.beyond_noise
    assert not replace(held, least_m=0.29).beyond_noise
