"""A channel that repeats the values of a slower source is found, and one that is coarse or at rest is not."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pandas as pd
import pytest

from seatrial.analysis.manoeuvres.find import find_manoeuvres
from seatrial.analysis.quality.channel_checks import check_repeats
from seatrial.analysis.quality.check import check_table
from seatrial.analysis.quality.repairs import repair_table
from seatrial.analysis.series import without_repeats
from tests.analysis.rudder_ships import Ship, sail, turn, zigzag

POSITIONS = ["north_m", "east_m"]


def renewed(table: pd.DataFrame, names: list[str], every: int, *, held: bool) -> pd.DataFrame:
    """Every so many rows a value of some channels, which is held until the next, or not."""
    part = table[names].copy()
    part[np.arange(len(table)) % every != 0] = np.nan
    return table.assign(**(part.ffill() if held else part))


@pytest.fixture(scope="module")
def voyage() -> pd.DataFrame:
    return sail(Ship(), zigzag(20.0, 20.0, 120.0), 400.0, rate_hz=1.0)


@pytest.mark.parametrize("every", [2, 3, 5])
@pytest.mark.parametrize("names", [POSITIONS, ["heading_deg"], ["surge_mps", "yaw_rate_dps"], ["rudder_angle_deg"]])
def test_repeats_are_found_and_left_out(voyage: pd.DataFrame, names: list[str], every: int) -> None:
    held, sparse = (renewed(voyage, names, every, held=held) for held in (True, False))
    findings = check_repeats(held).findings
    assert [finding.channel for finding in findings] == [name for name in voyage if name in names]
    assert all(finding.estimate["period_s"] == every for finding in findings)
    pd.testing.assert_frame_equal(without_repeats(held, names), sparse)
    quality = check_table(held)
    repaired = repair_table(held, quality.findings, quality.flags).table
    assert repaired[names].notna().sum().tolist() == sparse[names].notna().sum().tolist()


@pytest.mark.parametrize(
    "change",
    [
        lambda table: table,
        lambda table: table.assign(heading_deg=np.round(table["heading_deg"])),
        lambda table: table.assign(heading_deg=np.round(table["heading_deg"] / 5.0) * 5.0),
        lambda table: table.assign(**{name: np.round(table[name] / 20.0) * 20.0 for name in POSITIONS}),
        lambda table: table.assign(**{name: table[name].iloc[0] for name in POSITIONS}),
        lambda table: table.assign(rudder_angle_deg=20.0 * (np.arange(len(table)) // 30 % 2)),
        lambda table: renewed(table, POSITIONS, 3, held=False),
        lambda table: pd.concat([table, table]).sort_index(kind="stable"),
    ],
    ids=["as it is", "steps of 1 deg", "steps of 5 deg", "steps of 20 m", "at rest", "orders", "sparse", "twice"],
)
def test_coarse_sparse_and_still_channels_repeat_no_source(
    voyage: pd.DataFrame, change: Callable[[pd.DataFrame], pd.DataFrame]
) -> None:
    assert check_repeats(change(voyage)).findings == ()


def test_a_still_ship_keeps_its_samples(voyage: pd.DataFrame) -> None:
    """Of a source that goes on every five seconds one value in five remains, also where they are all the same."""
    still = voyage.assign(north_m=voyage["north_m"].where(np.arange(len(voyage)) < 300).ffill())
    sparse = without_repeats(renewed(still, POSITIONS, 5, held=True), POSITIONS)
    assert sparse["north_m"].notna().to_numpy().nonzero()[0].tolist() == list(range(0, len(voyage), 5))


@pytest.mark.parametrize(
    "names", [POSITIONS, ["heading_deg"], [*POSITIONS, "surge_mps", "sway_mps"], ["rudder_angle_deg"]]
)
def test_manoeuvres_are_those_of_the_slower_source(names: list[str]) -> None:
    """Positions that are seconds late would make the advance of a circle longer and its transfer less."""
    table = sail(Ship(), turn(-35.0, 120.0), 400.0, rate_hz=1.0)
    (held,), (sparse,) = (
        [run for run in find_manoeuvres(renewed(table, names, 4, held=held), 100.0) if run.kind == "turning_circle"]
        for held in (True, False)
    )
    assert held == sparse
