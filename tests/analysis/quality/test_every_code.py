"""No code of a finding without a fault that provokes it: whoever adds a check adds its fault here, or in the
benchmark.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pandas as pd
import pytest

from seatrial.acquisition.core.ship import BY_NAME
from seatrial.acquisition.core.trial import Quality
from seatrial.analysis.quality.channel_checks import find_channel_faults
from seatrial.analysis.quality.check import SEVERITY, check_table
from seatrial.analysis.quality.findings import findings_of_code
from seatrial.analysis.series import series_from_values
from seatrial.analysis.tables.table import NANO, index_of, times_ns
from seatrial.hybrid.simulation.trial import simulate_trial
from tests.analysis.quality.motion import kinematic_trials
from tests.analysis.quality.test_exchanged import exchanged, ordered
from tests.analysis.quality.test_situations import IDLE_IN_TOW, TOW, recorded, voyage_with_stay
from tests.analysis.rudder_ships import Ship, sail, zigzag
from tests.benchmarks.quality_trials import FAULTS


@cache
def voyage() -> pd.DataFrame:
    """A single-screw ship with a rudder on a zigzag."""
    return sail(Ship(), zigzag(20.0, 20.0, 120.0), 400.0, rate_hz=1.0)


def sailed(**faults: float) -> pd.DataFrame:
    return kinematic_trials.sailed(kinematic_trials.Faults(**faults))  # type: ignore[arg-type]


def stamped(table: pd.DataFrame, times: np.ndarray) -> pd.DataFrame:
    return table.set_axis(index_of(times), axis=0)


def with_clock_of_1970() -> pd.DataFrame:
    times = times_ns(voyage()).copy()
    times[0] = 0
    return stamped(voyage(), times)


def with_jittering_stamps() -> pd.DataFrame:
    scatter_ns = (0.25 * NANO * np.random.default_rng(0).standard_normal(len(voyage()))).astype(np.int64)
    return stamped(voyage(), times_ns(voyage()) + scatter_ns)


def with_two_compasses() -> pd.DataFrame:
    second = np.where(np.arange(len(voyage())) % 2, 62.7, 0.0)
    return voyage().assign(heading_deg=(voyage()["heading_deg"] + second) % 360.0)


def with_jump_of_position() -> pd.DataFrame:
    table = sailed()
    return table.assign(north_m=table["north_m"] + np.where(np.arange(len(table)) > len(table) // 2, 30.0, 0.0))


def with_repeated_headings() -> pd.DataFrame:
    heading = voyage()["heading_deg"].where(np.arange(len(voyage())) % 3 == 0).ffill()
    return voyage().assign(heading_deg=heading)


PROVOKING: dict[str, Callable[[], pd.DataFrame]] = {
    "time_outlier": with_clock_of_1970,
    "time_jitter": with_jittering_stamps,
    "alternating_levels": with_two_compasses,
    "repeated": with_repeated_headings,
    "feedback_exchanged": lambda: exchanged(ordered(15.0), "rpm"),
    "helm_sign": lambda: voyage().assign(rudder_angle_deg=-voyage()["rudder_angle_deg"]),
    "shaft_sign": lambda: voyage().assign(propeller_rpm=-voyage()["propeller_rpm"]),
    "motion_contradiction": lambda: sailed().assign(east_m=-sailed()["east_m"]),
    "position_jump": with_jump_of_position,
    "yaw_rate_bias": lambda: sailed(yaw_rate_bias_dps=-0.05),
    "position_offset": lambda: sailed(forward_m=6.0, starboard_m=2.0),
    "ship_held": lambda: voyage_with_stay(0.0),
    "ship_towed": lambda: recorded(TOW, 0.0, 40.0, IDLE_IN_TOW),
}
"""Tables with a fault by the code of its finding, beside the faults of the benchmark."""


def test_every_code_has_a_fault_that_provokes_it() -> None:
    table = simulate_trial("gunnerus_short", "moderate", "programme", 900.0, 1.0, 3)[0]
    random = np.random.default_rng(0)
    in_benchmark = {fault(table, random).code for faults in FAULTS.values() for fault in faults}
    assert in_benchmark | set(PROVOKING) | {"marked_suspect"} == set(SEVERITY)


@pytest.mark.parametrize("code", PROVOKING)
def test_its_fault_provokes_the_code(code: str) -> None:
    assert code in {finding.code for finding in check_table(PROVOKING[code]()).findings}


def test_samples_marked_by_their_source_provoke_the_code() -> None:
    """The mark is the samples', which no table holds."""
    random, channel = np.random.default_rng(0), BY_NAME["north_m"]
    samples = series_from_values(np.arange(90) * NANO, 0.5 * np.arange(90) + random.standard_normal(90))
    marked = replace(samples, quality=np.where(np.arange(90) < 30, Quality.SUSPECT, samples.quality))
    stretches = find_channel_faults(channel, marked).stretches("marked_suspect")
    (finding,) = findings_of_code("marked_suspect", {channel.name: stretches}, {channel.name: channel})
    assert finding.code == "marked_suspect"
