"""What holds in the slow motion of a ship is found and repaired; what waves do to an antenna high up is not."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from seatrial.acquisition.core.trial import Quality
from seatrial.analysis.quality.check import check_table
from seatrial.analysis.quality.motion.findings import check_motion
from seatrial.analysis.quality.motion.fit import SLOW_HZ, fit_kinematics
from seatrial.analysis.quality.repairs import repair_table
from seatrial.analysis.tables.table import move_stamps, seconds_of
from tests.analysis.quality.motion.kinematic_trials import Faults, Noise, sailed
from tests.benchmarks.wave_trials import judged
from tests.conftest import nightly

TRUE_SPEED_FACTOR = 1.0 / 0.97


def tossed(table: pd.DataFrame, share: float, period_s: float = 7.0, sway_mps: float = 0.6) -> pd.DataFrame:
    """A table with waves on top, in which the antenna moves by ``share`` more to the side than the ship does."""
    phase = 2.0 * np.pi * seconds_of(table) / period_s
    aside_m = sway_mps * period_s / (2.0 * np.pi) * np.sin(phase) * (1.0 + share)
    psi = np.deg2rad(table["heading_deg"])
    return table.assign(
        north_m=table["north_m"] - aside_m * np.sin(psi), east_m=table["east_m"] + aside_m * np.cos(psi),
        sway_mps=table["sway_mps"] + sway_mps * np.cos(phase),
    )  # fmt: skip


@pytest.mark.parametrize("number", [0, *nightly(1, 2, 6, 9, 14, 32, 241)])
def test_nothing_is_repaired_in_waves(number: int) -> None:
    """A few of the ships of the benchmark: at work, under way and manoeuvring, antennas anywhere on board.

    Number 241 heels in turns: taken for a delay of 0.4 s before that was known; number 14 has a wave of 4 s at 1 Hz
    whose trough is no spike.
    """
    what, findings, repairs = judged(number)
    assert repairs == [], what
    assert findings == [], what


@pytest.mark.slow
def test_a_hundred_ships_in_waves_are_left_as_they_are() -> None:
    results = [judged(number) for number in range(100)]
    assert [what for what, _, repairs in results if repairs] == []
    assert sum(bool(findings) for _, findings, _ in results) <= 3


@pytest.mark.parametrize("share", [-0.1, 0.03])
def test_an_antenna_that_waves_move_is_no_scale(share: float) -> None:
    """Position rate and sway differ by as much at 0.14 Hz, and agree below 0.03 Hz."""
    table = tossed(sailed(turning=0.02, speed_changes=0.1), share)
    assert not [each for each in check_motion(table).findings if each.certain]


@pytest.mark.parametrize("share", [0.1, *nightly(0.0)])
def test_a_true_scale_is_told_from_what_waves_do(share: float) -> None:
    table = tossed(sailed(), share)
    scaled = table.assign(surge_mps=0.97 * table["surge_mps"], sway_mps=0.97 * table["sway_mps"])
    (finding,) = [each for each in check_motion(scaled).findings if each.code == "speed_scale"]
    assert finding.certain
    assert finding.estimate["low"] <= TRUE_SPEED_FACTOR <= finding.estimate["high"]


def test_a_finding_names_its_band() -> None:
    (finding,) = check_motion(sailed(Faults(heading_deg=2.0))).findings
    low, high = finding.as_json()["band_hz"]
    assert low == 0.0
    assert high >= SLOW_HZ / 1.5
    assert f"up to {high:.2g} Hz" in finding.text


def test_what_shows_in_waves_alone_is_said_so_and_left() -> None:
    """On a straight course at one speed a late position shows in the waves and nowhere else."""
    table = sailed(
        Faults(late_s={"north_m": 0.5}), turning=0.0, speed_changes=0.0, noise=Noise(0.005, 0.01, 0.003, 0.01)
    )
    found = [each for each in check_motion(table).findings if each.band_hz and each.band_hz[0] > 0.0]
    assert not any(each.certain for each in found)
    assert all("slower motion does not tell" in each.text for each in found)


@pytest.mark.parametrize(
    ("channel", "seconds"), [("heading_deg", -1.2), *nightly(("north_m", 1.1), ("surge_mps", 1.5))]
)
def test_a_delay_is_taken_off_the_stamps(channel: str, seconds: float) -> None:
    """Samples come every half second: a delay of more than two of them is taken off."""
    table = sailed(Faults(late_s={channel: seconds}))
    quality = check_table(table)
    repaired = repair_table(table, quality.findings, quality.flags)
    assert [each.code for each in repaired.repairs] == ["channel_delay"]
    assert repaired.table[channel].count() == table[channel].count()
    moved = repaired.table[channel].first_valid_index() - table.index[0]
    assert moved.total_seconds() == pytest.approx(-seconds, abs=0.1)
    assert not [each for each in check_motion(repaired.table).findings if each.code == "channel_delay"]
    assert repaired.flags is not None
    assert repaired.flags.index.equals(repaired.table.index)
    there = repaired.table[channel].notna().to_numpy()
    assert ((repaired.flags[channel] == Quality.MISSING).to_numpy() == ~there).all()


def test_stamps_move_by_column_and_no_value_is_lost() -> None:
    table = sailed(duration_s=100.0)
    moved = move_stamps(table, {"heading_deg": 250_000_000})
    assert moved["heading_deg"].dropna().tolist() == table["heading_deg"].tolist()
    assert moved["surge_mps"].dropna().equals(table["surge_mps"])


@pytest.mark.parametrize("rate_hz", [1.0, *nightly(2.0, 10.0)])
@pytest.mark.parametrize("turning", [0.02, 1.0, *nightly(0.0, 0.2)])
def test_headings_in_whole_degrees_are_fitted(rate_hz: float, turning: float) -> None:
    """Their steps are those of the rounding, mostly none: they are not taken for jumps, and nothing breaks."""
    table = sailed(rate_hz=rate_hz, turning=turning, seed=3, noise=Noise(heading_deg=0.0), duration_s=900.0)
    rounded = table.assign(heading_deg=table["heading_deg"].round() % 360.0)
    assert [each.code for each in check_motion(rounded).findings if each.certain] == []
    assert fit_kinematics(rounded).converged


@pytest.mark.parametrize("turns", [-3.0, *nightly(2.0, 5.0)])
def test_a_heading_that_runs_on_is_wrapped(turns: float) -> None:
    table = sailed(duration_s=400.0)
    on = table.assign(heading_deg=np.rad2deg(np.unwrap(np.deg2rad(table["heading_deg"]))) + 360.0 * turns)
    parameters = fit_kinematics(on).selected.parameters
    assert parameters == pytest.approx(np.asarray(fit_kinematics(table).selected.parameters), abs=1e-9)
    quality = check_table(on)
    assert [each.code for each in quality.findings] == ["out_of_range"]
    repaired = repair_table(on, quality.findings, quality.flags).table["heading_deg"]
    assert repaired.to_numpy() == pytest.approx(table["heading_deg"].to_numpy())
