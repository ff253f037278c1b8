"""Recording to table and back: joined on measured time, nothing lost, exports that import again."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seatrial.acquisition.core.errors import InputError
from seatrial.acquisition.core.quantities import Series
from seatrial.acquisition.core.ship import BY_NAME, NAMES
from seatrial.acquisition.core.trial import Quality, Trial
from seatrial.acquisition.recording.reader import Recording
from seatrial.acquisition.recording.writer import write_table
from seatrial.acquisition.tables.import_table import import_table
from seatrial.analysis.tables.export import export_table
from seatrial.analysis.tables.resample import resample
from seatrial.analysis.tables.table import read_table, select, table_of
from tests.analysis.conftest import START_S, steady_table, table_at

TRIAL = Trial(name="voyage", vessel="gunnerus_long", origin_latitude_deg=63.4, origin_longitude_deg=10.4)


def recording_of(**channels: list[tuple[float, float]]) -> Recording:
    """A recording of (second, value) pairs by channel, as if it had been read."""
    series = {}
    for name, pairs in channels.items():
        time_ns = np.array([START_S * 10**9 + round(second * 1e9) for second, _ in pairs], np.int64)
        value, count = np.array([value for _, value in pairs]), len(pairs)
        quality = np.full(count, Quality.NOT_EVALUATED, np.uint8)
        series[name] = Series(time_ns, time_ns, value, quality, ("test",), np.zeros(count, np.int64))
    return Recording(Path("voyage.mcap"), TRIAL, series, {}, [], 0, True, 0, 0)


def test_channels_are_joined_on_their_measured_time() -> None:
    table = table_of(recording_of(surge_mps=[(0, 1.0), (2, 2.0)], heading_deg=[(2, 350.0), (1, 10.0)]))
    assert list(table.columns) == ["heading_deg", "surge_mps"]
    expected = table_at([0, 1, 2], {"heading_deg": [np.nan, 10.0, 350.0], "surge_mps": [1.0, np.nan, 2.0]})
    pd.testing.assert_frame_equal(table, expected)
    assert table.attrs["trial"]["vessel"] == "gunnerus_long"


@given(
    st.lists(st.tuples(st.integers(0, 5), st.floats(-30, 30)), min_size=1, max_size=30),
    st.lists(st.tuples(st.integers(0, 5), st.floats(-30, 30)), min_size=1, max_size=30),
)
@settings(max_examples=60, deadline=None)
def test_no_sample_is_lost_however_often_a_time_comes(
    surge: list[tuple[int, float]], sway: list[tuple[int, float]]
) -> None:
    table = table_of(recording_of(surge_mps=surge, sway_mps=sway))  # type: ignore[arg-type]
    assert table.index.is_monotonic_increasing
    for name, pairs in (("surge_mps", surge), ("sway_mps", sway)):
        kept = table[name].dropna()
        assert kept.tolist() == [value for _, value in sorted(pairs, key=lambda pair: pair[0])]


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".mat"])
def test_an_export_imports_again_without_a_map(tmp_path: Path, suffix: str) -> None:
    table = steady_table(30, 0.3, 0.2).assign(roll_deg=1.25)
    table.iloc[3:6, 2] = np.nan
    table.index += pd.Timedelta(microseconds=123457)
    write_table(table, tmp_path / "first.mcap", TRIAL)
    export_table(read_table(tmp_path / "first.mcap"), tmp_path / f"voyage{suffix}")
    imported = import_table(tmp_path / f"voyage{suffix}", tmp_path / "again.mcap")
    again = read_table(tmp_path / "again.mcap")
    pd.testing.assert_frame_equal(again, read_table(tmp_path / "first.mcap"), check_exact=True)
    assert imported.passed_over == ()
    if suffix != ".csv":  # CSV has no place for it
        assert again.attrs["trial"]["origin_latitude_deg"] == 63.4


def test_a_resampled_export_says_its_units(tmp_path: Path) -> None:
    export_table(resample(steady_table(20), 2.0), tmp_path / "table.parquet")
    schema = pq.read_schema(tmp_path / "table.parquet")
    assert {name: schema.field(name).metadata[b"unit"].decode() for name in NAMES} == {
        name: BY_NAME[name].unit for name in NAMES
    }
    assert schema.metadata[b"seatrial.rate_hz"] == b"2.0"
    frame = pd.read_parquet(tmp_path / "table.parquet")
    assert frame.index.name == "time"
    assert str(frame.index.tz) == "UTC"


@given(cut=st.floats(1, 99), seconds=st.integers(1, 200))
def test_parts_that_meet_share_no_row_and_lose_none(cut: float, seconds: int) -> None:
    table = table_at(np.arange(seconds), {"north_m": np.arange(seconds, dtype=float)})
    parts = [select(table, (0.0, cut)), select(table, f"{cut!r}..100")]
    if seconds > 1:
        assert pd.concat(parts)["north_m"].tolist() == list(range(seconds))


def test_a_part_is_a_share_of_the_time_not_of_the_rows() -> None:
    table = table_at([0, 1, 2, 3, 100], {"north_m": [0.0, 1.0, 2.0, 3.0, 4.0]})
    assert len(select(table, "0..50")) == 4
    for wrong in ("70..20", "0-70", "0..120", "a..b"):
        with pytest.raises(InputError, match="part"):
            select(table, wrong)


def test_an_export_of_another_kind_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="parquet"):
        export_table(steady_table(3), tmp_path / "table.docx")
