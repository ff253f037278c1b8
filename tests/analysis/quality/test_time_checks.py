"""Jumps of the clock told from gaps by the ship's own motion, clocks against reception, and stamps that jitter."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from seatrial.acquisition.core.quantities import Series
from seatrial.analysis.quality.time_checks import find_clock_jumps, find_reception_jumps, jitter_s
from seatrial.analysis.tables.table import NANO, index_of, times_ns
from seatrial.hybrid.simulation.trial import simulate_trial

RATE_HZ = 5.0


@pytest.fixture(scope="module", params=[("zigzag_20_20", 350.0), ("voyage", 90.0)], ids=lambda each: str(each[0]))
def trial(request: pytest.FixtureRequest) -> pd.DataFrame:
    manoeuvre, heading_deg = request.param
    return simulate_trial("gunnerus_short", "gentle", manoeuvre, 300.0, RATE_HZ, seed=3, heading_deg=heading_deg)[0]


def shifted(table: pd.DataFrame, seconds: float, row: int = 800) -> pd.DataFrame:
    stamps = times_ns(table).copy()
    stamps[row:] += round(seconds * NANO)
    return table.set_axis(index_of(stamps), axis=0)


@pytest.mark.parametrize("seconds", [-20.0, -2.0, 0.5, 3.0, 30.0])
def test_a_jump_is_found_with_its_size_inside_its_interval(trial: pd.DataFrame, seconds: float) -> None:
    (jump,) = find_clock_jumps(shifted(trial, seconds))
    assert jump.low <= seconds <= jump.high
    assert jump.high - jump.low < 0.4
    first, last = sorted((799, 800), key=lambda row: times_ns(shifted(trial, seconds))[row])
    assert (jump.start_ns, jump.end_ns) == tuple(times_ns(shifted(trial, seconds))[[first, last]])


def test_two_jumps_are_two(trial: pd.DataFrame) -> None:
    jumps = find_clock_jumps(shifted(shifted(trial, 5.0, 400), -3.0, 1000))
    assert [round(each.seconds) for each in jumps] == [5, -3]


def test_sound_stamps_and_true_gaps_are_no_jumps(trial: pd.DataFrame) -> None:
    """The ship sailed on while nothing was recorded."""
    assert find_clock_jumps(trial) == []
    for seconds in (1, 5, 20, 60):
        rows = slice(700, 700 + int(seconds * RATE_HZ))
        assert find_clock_jumps(trial.drop(trial.index[rows])) == []


def test_rows_that_came_late_or_twice_are_no_jumps(trial: pd.DataFrame) -> None:
    order = np.arange(len(trial))
    order[500:508] = np.roll(order[500:508], 4)
    assert find_clock_jumps(trial.iloc[order]) == []
    assert find_clock_jumps(trial.iloc[np.sort(np.append(order, [300, 301, 302, 900]))]) == []


def test_a_ship_that_lies_still_tells_nothing(trial: pd.DataFrame) -> None:
    random = np.random.default_rng(0)
    still = pd.DataFrame(
        {name: scale * random.standard_normal(len(trial)) for name, scale in
         (("north_m", 0.05), ("east_m", 0.05), ("surge_mps", 0.03), ("sway_mps", 0.03), ("yaw_rate_dps", 0.05))},
        index=trial.index,
    ).assign(heading_deg=10.0 + 0.1 * random.standard_normal(len(trial)))  # fmt: skip
    assert find_clock_jumps(shifted(still, 10.0)) == []


def test_without_the_motion_there_is_nothing_to_say(trial: pd.DataFrame) -> None:
    assert find_clock_jumps(shifted(trial, 10.0).drop(columns="surge_mps")) == []
    assert find_clock_jumps(shifted(trial, 10.0).iloc[:10]) == []


def series(measured_ns: np.ndarray, received_ns: np.ndarray, source: str) -> Series:
    size = measured_ns.size
    return Series(
        measured_ns, received_ns, np.zeros(size), np.ones(size, np.uint8), (source,), np.zeros(size, np.int32)
    )


def test_a_source_whose_clock_steps_against_reception_is_found_and_named() -> None:
    random = np.random.default_rng(0)
    received = (np.arange(2000) * 0.1 * NANO + random.uniform(0, 0.02, 2000) * NANO).astype(np.int64)
    measured = (np.arange(2000) * 0.1 * NANO - 0.05 * NANO).astype(np.int64)
    measured[1200:] -= 2 * NANO
    steady = (np.arange(2000) * 0.1 * NANO).astype(np.int64)
    ((source, jump),) = find_reception_jumps({
        "heading_deg": series(measured, received, "gyro"), "yaw_rate_dps": series(measured, received, "gyro"),
        "surge_mps": series(steady, received, "log"),
    })  # fmt: skip
    assert source == "gyro"
    assert jump.low <= -2.0 <= jump.high
    assert abs(jump.seconds + 2.0) < 0.05


def test_latency_and_a_drifting_clock_are_no_jumps() -> None:
    random = np.random.default_rng(1)
    measured = (np.arange(3000) * 0.1 * NANO * 1.00005).astype(np.int64)
    received = (np.arange(3000) * 0.1 * NANO + random.gamma(2.0, 0.02, 3000) * NANO).astype(np.int64)
    assert find_reception_jumps({"heading_deg": series(measured, received, "gyro")}) == []


@pytest.mark.parametrize("sigma_s", [0.02, 0.1])
def test_jitter_about_a_regular_clock_is_measured(sigma_s: float) -> None:
    random = np.random.default_rng(0)
    stamps = np.arange(4000) * 0.5 + sigma_s * random.standard_normal(4000)
    assert jitter_s((stamps * NANO).astype(np.int64)) == pytest.approx(sigma_s, rel=0.1)


def test_a_regular_clock_and_a_channel_that_reports_on_events_do_not_jitter() -> None:
    events = np.cumsum(np.random.default_rng(0).exponential(1.0, 2000))
    assert jitter_s((events * NANO).astype(np.int64)) == 0.0
    assert jitter_s(np.arange(2000, dtype=np.int64) * NANO // 3) == 0.0
