"""The intervals of the speed at a power: they hold the truth, and grow with what is not known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

from seatrial.analysis.speed_power.analysis import SpeedPower, _mixture_half, speed_power_of_runs
from seatrial.analysis.speed_power.report import (
    correction_rows,
    power_text,
    result_sentence,
    run_rows,
    setting_rows,
    uncertainty_rows,
)
from seatrial.analysis.speed_power.runs import runs_in_table
from tests.benchmarks.speed_trials import Programme, rows_of
from tests.conftest import nightly


@pytest.fixture(scope="module")
def programme() -> Programme:
    """Three settings of two double runs in wind."""
    return next(each for each in map(Programme, range(100))
                if (each.settings, each.double_runs) == (3, 2) and each.wind.mean() > 5.0)  # fmt: skip


@pytest.fixture(scope="module")
def result(programme: Programme) -> SpeedPower:
    return programme.result()


def width(result: SpeedPower) -> float:
    return result.fastest.high_mps - result.fastest.low_mps


@pytest.mark.parametrize("programmes", [10, *nightly(24)])
def test_intervals_hold_the_truth_of_ships_of_another_simulation(programmes: int) -> None:
    """Programmes of 1 to 3 settings and double runs; the benchmark has hundreds."""
    rows = [row for seed in range(2000, 2000 + programmes) for row in rows_of(Programme(seed))]
    assert np.mean([row.holds for row in rows]) >= 0.88
    error = np.sqrt(np.mean([row.error_kn**2 for row in rows]))
    assert np.median([row.half_kn for row in rows]) < 3.0 * error  # not wide for nothing


def test_half_of_a_mixture_holds_95_percent() -> None:
    one = _mixture_half(np.array([1.0]), np.array([[0.04]]))
    assert one[0] == pytest.approx(norm.ppf(0.975) * 0.2, rel=1e-4)
    two = _mixture_half(np.array([0.5, 0.5]), np.array([[0.04], [1.0]]))[0]
    inside = 0.5 * sum(norm.cdf(two / sigma) - norm.cdf(-two / sigma) for sigma in (0.2, 1.0))
    assert inside == pytest.approx(0.95, abs=1e-6)


def test_a_worse_power_measurement_widens_the_interval(programme: Programme, result: SpeedPower) -> None:
    runs = runs_in_table(programme.table).runs
    worse = speed_power_of_runs(runs, replace(programme.conditions, power_error_percent=5.0))
    assert worse.fastest.speed_mps == result.fastest.speed_mps
    halves = {each.name: each.half_mps for each in worse.uncertainties}
    slope = result.curve.slope(np.array(result.fastest.speed_mps))
    assert halves["power measurement"] == pytest.approx(
        1.96 * 0.05 / np.sqrt(3.0) * result.fastest.power_kw / slope, rel=0.15
    )
    assert width(worse) > 1.3 * width(result)


def test_one_double_run_has_a_wide_interval_and_three_a_narrow_one(programme: Programme) -> None:
    """What a current did between two runs of one pair, nothing tells but how currents are."""
    table = programme.table
    runs = runs_in_table(table[table["shaft speed [rpm]"] == table["shaft speed [rpm]"].iloc[0]]).runs
    one, two = (speed_power_of_runs(part, programme.conditions) for part in (runs[:2], runs))
    assert width(one) > 1.5 * width(two)


def test_waves_that_nobody_observed_widen_the_interval_upwards(programme: Programme) -> None:
    """They can only have slowed the ship: it may be faster in still water."""
    table = programme.table.drop(columns=[name for name in programme.table if name.startswith("wave")])
    calm = table.assign(**{"wave height [m]": 0.0})
    unknown, none = (speed_power_of_runs(runs_in_table(each).runs, programme.conditions) for each in (table, calm))
    assert unknown.fastest.speed_mps == pytest.approx(none.fastest.speed_mps)
    above, below = (
        abs(getattr(unknown.fastest, side) - getattr(none.fastest, side)) for side in ("high_mps", "low_mps")
    )
    assert above > below


def test_without_the_wind_there_is_no_interval(programme: Programme) -> None:
    table = programme.table.drop(columns=[name for name in programme.table if "wind" in name])
    result = speed_power_of_runs(runs_in_table(table).runs, programme.conditions)
    assert result.no_interval == "the wind during the runs is not known"
    assert np.isnan(result.fastest.low_mps)
    assert "no interval, as the wind during the runs is not known" in result_sentence(result)
    assert uncertainty_rows(result) == []
    assert str(result)


def test_rows_of_the_report_are_as_people_write_numbers(result: SpeedPower) -> None:
    rows = [*run_rows(result), *setting_rows(result), *correction_rows(result), *uncertainty_rows(result)]
    assert not any("e+" in cell or "nan" in cell for row in rows for cell in row)
    assert power_text(10_323.4) == "10,323 kW"
    wind = next(row for row in correction_rows(result) if row[0] == "wind")
    assert wind[1].endswith(" kW")
    assert wind[2].endswith(" kn")


def test_a_correction_is_as_large_as_the_result_without_it_says(programme: Programme, result: SpeedPower) -> None:
    runs = runs_in_table(programme.table).runs
    without = speed_power_of_runs(runs, replace(programme.conditions, wind_resistance=()))
    wind = next(each for each in result.corrections if each.name == "wind")
    highest = result.fastest.power_kw
    assert wind.speed_mps == pytest.approx(
        float(result.curve.speed_mps(highest) - without.curve.speed_mps(highest)), abs=1e-3
    )
    assert np.sign(wind.power_kw) == -np.sign(wind.speed_mps)
