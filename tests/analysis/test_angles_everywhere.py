"""Turning a whole trial by any angle changes nothing but that angle, in every step from table to products.

Heading and wind are turned and the track is rotated; azimuths, which are body-fixed, are shifted by an angle of
their own where a step looks at nothing but their differences.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from seatrial.acquisition.core.ship import CIRCULAR, NAMES, angle_difference, wrap_180, wrap_360
from seatrial.acquisition.core.trial import Trial
from seatrial.acquisition.recording.reader import read_recording
from seatrial.acquisition.recording.writer import write_table
from seatrial.acquisition.tables.import_table import import_table
from seatrial.analysis.estimation.smoother import smooth
from seatrial.analysis.manoeuvres.find import find_manoeuvres
from seatrial.analysis.quality.check import check_table
from seatrial.analysis.series import smooth_motion
from seatrial.analysis.tables.export import export_table
from seatrial.analysis.tables.resample import resample, resample_recording
from seatrial.analysis.tables.table import join_channels, read_table
from seatrial.analysis.windows.held import held_windows
from tests.analysis.conftest import turn_between
from tests.conftest import nightly

TURNS = st.floats(-400.0, 400.0)
AZIMUTHS = ("port_angle_deg", "starboard_angle_deg")
FEW = settings(max_examples=8, deadline=None)
FEWEST = settings(max_examples=3, deadline=None)


@pytest.fixture(scope="module")
def trial() -> pd.DataFrame:
    """A zigzag about north at 4 Hz, eight minutes: the heading crosses 359 -> 1 again and again."""
    from seatrial.hybrid.simulation.trial import simulate_trial

    return simulate_trial("gunnerus_short", "gentle", "zigzag_20_20", 480.0, 4.0, 5)[0]


@pytest.fixture(scope="module")
def steps() -> pd.DataFrame:
    """A quarter of an hour at 1 Hz of settings that are held and changed."""
    from seatrial.hybrid.simulation.trial import simulate_trial

    return simulate_trial("gunnerus_short", "gentle", "paper", 900.0, 1.0, 5)[0]


def turned(table: pd.DataFrame, angle_deg: float, azimuth_deg: float = 0.0) -> pd.DataFrame:
    """The same trial on another course: earth-fixed angles turned, the track rotated, azimuths shifted."""
    angle = np.deg2rad(angle_deg)
    result = table.copy()
    result["north_m"] = np.cos(angle) * table["north_m"] - np.sin(angle) * table["east_m"]
    result["east_m"] = np.sin(angle) * table["north_m"] + np.cos(angle) * table["east_m"]
    for name in ("heading_deg", "wind_direction_deg"):
        result[name] = wrap_360(table[name] + angle_deg)
    for name in AZIMUTHS:
        result[name] = wrap_180(table[name] + azimuth_deg)
    return result


def apart(left: pd.DataFrame, right: pd.DataFrame) -> float:
    """The largest difference between two tables of channels, which have the same holes; angles on the circle."""
    assert left.index.equals(right.index)
    assert left.isna().equals(right.isna())
    return max(off(left, right, str(name)) for name in left.columns if left[name].notna().any())


def off(left: pd.DataFrame, right: pd.DataFrame, name: str) -> float:
    """The largest difference in one channel; an angle's is the shortest turn."""
    apart = angle_difference(left[name], right[name]) if name in CIRCULAR else left[name] - right[name]
    return float(np.nanmax(np.abs(apart)))


@FEW
@given(angle=TURNS, azimuth=TURNS, rate_hz=st.sampled_from([0.5, 1.0, 4.0, 10.0]))
@example(angle=180.0, azimuth=180.0, rate_hz=1.0)
def test_resampling(trial: pd.DataFrame, angle: float, azimuth: float, rate_hz: float) -> None:
    here, there = resample(trial, rate_hz), resample(turned(trial, angle, azimuth), rate_hz)
    assert apart(there, turned(here, angle, azimuth)) < 1e-6
    for name in CIRCULAR.intersection(NAMES):
        low = -180.0 if name in AZIMUTHS else 0.0
        assert there[name].min() >= low
        assert there[name].max() <= low + 360.0


@FEW
@given(angle=TURNS)
@example(angle=180.0)
def test_the_slow_motion(trial: pd.DataFrame, angle: float) -> None:
    one_hz = resample(trial)
    here, there = smooth_motion(one_hz), smooth_motion(turned(one_hz, angle))
    wind = one_hz[["wind_direction_deg", *AZIMUTHS]]
    assert apart(there, turned(here.join(wind), angle)[list(here.columns)]) < 1e-6


@pytest.mark.parametrize("angle", [-97.3, *nightly(180.0)])
def test_the_smoother(trial: pd.DataFrame, angle: float) -> None:
    """To a hundredth of what it says of its own uncertainty: the levels of noise are found by a search."""
    part = trial.iloc[:240]
    here, there = smooth(part, 1.0), smooth(turned(part, angle), 1.0)
    others = resample(part)[["wind_direction_deg", *AZIMUTHS]]
    expected = turned(here.states.join(others), angle)[list(here.states.columns)]
    sigma = here.standard_deviations()
    for name in expected.columns:
        assert off(there.states, expected, name) < 0.05 * sigma[name].median(), name


@FEW
@given(angle=TURNS, azimuth=TURNS)
@example(angle=90.0, azimuth=180.0)
@example(angle=-90.0, azimuth=-180.0)
def test_held_windows(steps: pd.DataFrame, angle: float, azimuth: float) -> None:
    """Azimuths near the seam are as held as any: the same windows, legs and reasons."""
    here, there = held_windows(steps), held_windows(turned(steps, angle, azimuth))
    assert (there.candidates, there.kept, there.dropped) == (here.candidates, here.kept, here.dropped)
    labels = ["window", "second", "leg", "start"]
    pd.testing.assert_frame_equal(there.rows[labels], here.rows[labels])
    assert here.kept > 5
    names = list(NAMES)
    assert apart(there.rows[names], turned(here.rows[names], angle, azimuth)) < 1e-6


@FEW
@given(angle=TURNS, azimuth=TURNS, suffix=st.sampled_from([".csv", ".parquet", ".mat"]))
@example(angle=360.0, azimuth=180.0, suffix=".csv")
def test_recording_export_and_import(
    trial: pd.DataFrame, tmp_path_factory: pytest.TempPathFactory, angle: float, azimuth: float, suffix: str
) -> None:
    folder, table = tmp_path_factory.mktemp("turned"), turned(trial.iloc[:60], angle, azimuth)
    write_table(table, folder / "first.mcap", Trial())
    export_table(read_table(folder / "first.mcap"), folder / f"table{suffix}")
    assert import_table(folder / f"table{suffix}", folder / "again.mcap").out_of_range == {}
    pd.testing.assert_frame_equal(read_table(folder / "again.mcap"), table, check_exact=True, check_freq=False)
    alone = resample_recording(read_recording(folder / "again.mcap"))
    assert apart(alone, turned(resample(trial.iloc[:60]), angle, azimuth)) < 1e-6


@FEW
@given(angle=TURNS, seed=st.integers(0, 2**16))
def test_joining_channels_of_different_times(trial: pd.DataFrame, angle: float, seed: int) -> None:
    """Resampled after joining, each channel is what it is alone; none leaks into another's turn."""
    random = np.random.default_rng(seed)
    table = turned(trial.iloc[:200], angle, angle)
    time_ns = table.index.as_unit("ns").asi8
    channels = {}
    for name in NAMES:
        kept = np.sort(random.choice(len(table), 150, replace=False))
        channels[name] = time_ns[kept] + int(random.integers(10**8)), table[name].to_numpy()[kept]
    together = resample(join_channels(channels))
    for name, each in channels.items():
        single = resample(join_channels({name: each}))[name]
        assert turn_between(together[name].dropna(), single.dropna()) == 0.0


@pytest.mark.slow
@FEWEST
@given(angle=TURNS)
@example(angle=180.0)
def test_manoeuvres(trial: pd.DataFrame, angle: float) -> None:
    """The same zigzag, its indices far within their own intervals."""
    one_hz = resample(trial)
    here, there = find_manoeuvres(one_hz), find_manoeuvres(turned(one_hz, angle))
    assert here
    assert [(each.kind, each.side, each.start) for each in there] == [
        (each.kind, each.side, each.start) for each in here
    ]
    for first, second in zip(here, there, strict=True):
        for name, index in first.indices.items():
            width = max(index.high - index.low, 1e-3 * abs(index.value))
            assert abs(second.indices[name].value - index.value) <= 0.2 * width, name


@pytest.mark.slow
@FEWEST
@given(angle=TURNS)
@example(angle=180.0)
def test_checks(trial: pd.DataFrame, angle: float) -> None:
    """What is wrong with the data does not hang on the course: the same codes for the same channels.

    Position is one thing with two axes, so that its findings may change names.
    """
    part = trial.iloc[:1200]

    def found(table: pd.DataFrame) -> set[tuple[str, str]]:
        findings = check_table(table).findings
        return {(each.code, each.channel.replace("east_m", "north_m")) for each in findings}

    assert found(turned(part, angle)) == found(part)
