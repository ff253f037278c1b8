"""The motion at the last second from what came before: exact on lines, calmer than a parabola, never ahead."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from acquisition.core.angles import difference, wrap_360
from analysis.estimation.last_motion import end_value, goes_on, last_motion
from analysis.estimation.slow_motion import MOTION, smooth_motion

SECONDS = np.arange(60.0)
INDEX = pd.date_range("2026-06-01T08:00:00Z", periods=60, freq="1s", name="time")


def turning(noise: float = 0.0, seed: int = 0) -> pd.DataFrame:
    """A turn through north that tightens, speed that falls steadily; a parabola of positions."""
    chance = np.random.default_rng(seed)
    columns = {
        "north_m": 3.0 * SECONDS - 0.02 * SECONDS**2, "east_m": 1.0 + 0.5 * SECONDS + 0.01 * SECONDS**2,
        "heading_deg": 300.0 + 1.5 * SECONDS, "surge_mps": 5.0 - 0.02 * SECONDS, "sway_mps": 0.01 * SECONDS,
        "yaw_rate_dps": 1.5 + 0.01 * SECONDS,
    }  # fmt: skip
    table = pd.DataFrame(
        {name: each + noise * chance.normal(size=60) for name, each in columns.items()}, index=INDEX
    )
    table["heading_deg"] = wrap_360(table["heading_deg"].to_numpy())
    return table


def test_lines_and_bent_positions_come_out_exactly_at_any_second() -> None:
    table = turning()
    for second in (10, 45, 59):
        row = last_motion(table.iloc[: second + 1], INDEX[second]).iloc[0]
        for name in MOTION:
            assert difference(row[name], table[name].iloc[second]) == pytest.approx(0.0, abs=1e-6), name


def test_what_comes_after_changes_nothing() -> None:
    table, spoilt = turning(0.3), turning(0.3)
    spoilt.iloc[41:] = 1e6
    pd.testing.assert_frame_equal(last_motion(table, INDEX[40]), last_motion(spoilt, INDEX[40]))


def test_in_waves_the_start_is_calmer_than_the_one_sided_parabola() -> None:
    """Waves of seven seconds at any phase and noise: half the error in speeds and yaw rate."""
    ours, parabola = [], []
    for seed in range(40):
        table = turning(0.05, seed)
        wave = 0.5 * np.sin(2.0 * np.pi * SECONDS / 7.0 + seed)
        for name in ("surge_mps", "sway_mps", "yaw_rate_dps"):
            table[name] += wave
            true = turning()[name].iloc[-1]
            ours.append(last_motion(table, INDEX[-1])[name].iloc[0] - true)
            parabola.append(smooth_motion(table)[name].iloc[-1] - true)
    assert np.std(ours) < 0.7 * np.std(parabola)


def test_a_value_that_is_missing_at_the_end_stays_missing_and_few_stay_as_they_are() -> None:
    table = turning()
    table.loc[INDEX[-1], "sway_mps"] = np.nan
    table.loc[INDEX[50:57], "surge_mps"] = np.nan
    table.loc[INDEX[-1], "surge_mps"] = 9.0
    row = last_motion(table, INDEX[-1]).iloc[0]
    assert np.isnan(row["sway_mps"])
    assert row["surge_mps"] == 9.0
    assert np.isnan(end_value(np.empty(0), np.empty(0), 1))


def test_a_recording_goes_on_where_all_motion_is_known_later() -> None:
    table = turning()
    table.loc[INDEX[55:], "east_m"] = np.nan
    assert goes_on(table, INDEX[53])
    assert not goes_on(table, INDEX[54])
