"""Indices by the letter of the standard: from the order, at midship; against an independent simulation."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seatrial.acquisition.config.run_sheet import Conditions, conditions_in_trial
from seatrial.acquisition.config.trial_file import parse_config
from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.acquisition.core.trial import Trial
from seatrial.analysis.manoeuvres.find import find_manoeuvres
from seatrial.analysis.manoeuvres.indices import Manoeuvre
from seatrial.analysis.quality.wind import parse_sea_state, recorded_conditions
from seatrial.hybrid.simulation.trial import simulate_trial
from tests.acquisition.conftest import config_text, free_port
from tests.benchmarks.yard_ship import YardShip
from tests.benchmarks.yard_trials import Recorder, Score, judge, judge_near_limit, record, sail
from tests.conftest import nightly

SHIP = YardShip(180.0, helm_rate_dps=2.5)
QUIET = Recorder(2.0, 0.02, 0.01, 0.005, 0.003, 0.02, (0.0, 0.0), orders=False)


def circle_of(table: pd.DataFrame, length_m: float | None = 180.0) -> Manoeuvre:
    (found,) = (run for run in find_manoeuvres(table, length_m) if run.kind == "turning_circle")
    return found


@pytest.mark.parametrize("ships", [1, *nightly(6)])
def test_every_index_of_large_ships_counts_from_the_order_and_its_interval_holds_the_truth(ships: int) -> None:
    score = Score()
    for number in range(ships):
        judge(number, score)
    assert score.found == score.tests == 4 * ships
    assert score.coverage > 0.88


@pytest.mark.parametrize(("ships", "least"), [(6, 3), *nightly((14, 8))])
def test_no_criterion_is_met_that_is_not(ships: int, least: int) -> None:
    judged = [entry for number in range(ships) if (entry := judge_near_limit(number)) is not None]
    assert len(judged) >= least  # overshoots cannot always be near their limits
    for _, ratio, result in judged:
        assert result != "met" or ratio <= 1.0
        assert result != "not_met" or ratio > 1.0


@pytest.mark.parametrize("dead_time_s", [0.0, 4.0, 9.0])
def test_a_recorded_order_counts_however_late_the_helm_follows(dead_time_s: float) -> None:
    sailed, truth = sail(SHIP, "turning_circle", 1.0)
    rows = round(10.0 * dead_time_s)
    earlier = np.append(sailed.helm_order_deg[rows:], np.full(rows, sailed.helm_order_deg[-1]))
    table = record(SHIP, replace(sailed, helm_order_deg=earlier), replace(QUIET, orders=True), seed=1)
    found = circle_of(table)
    more_m = dead_time_s * SHIP.speed_mps
    assert found.indices["advance_m"].value == pytest.approx(truth.indices["advance_m"] + more_m, abs=4.0)
    assert not any("orders were not recorded" in note for note in found.notes)


@pytest.mark.parametrize("place_m", [(-70.0, 0.0), (60.0, 8.0)])
def test_indices_are_those_of_midship_wherever_the_antenna_stands(place_m: tuple[float, float]) -> None:
    sailed, truth = sail(SHIP, "turning_circle", -1.0)
    table = record(SHIP, sailed, replace(QUIET, antenna_m=place_m), seed=2)
    known = circle_of(table)
    table.attrs["trial"] = {name: value for name, value in table.attrs["trial"].items() if "antenna" not in name}
    unknown = circle_of(table)
    for name in ("advance_m", "transfer_m", "tactical_diameter_m"):
        value = truth.indices[name]
        assert known.indices[name].value == pytest.approx(value, abs=5.0), name
        assert unknown.indices[name].low < value < unknown.indices[name].high, name
    assert unknown.indices["advance_m"].value != pytest.approx(truth.indices["advance_m"], abs=30.0)
    assert any("antenna's position" in note for note in unknown.notes)
    assert not any("antenna's position" in note for note in known.notes)
    assert any("the intervals leave it out" in note for note in circle_of(table, None).notes)


@given(st.builds(
    Conditions, length_m=st.none() | st.floats(1.0, 400.0), trim_m=st.none() | st.floats(-5.0, 5.0),
    beaufort=st.none() | st.integers(0, 12), wind_resistance=st.tuples(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0)),
    chemical_or_gas_tanker=st.booleans(),
))  # fmt: skip
def test_conditions_survive_the_recording(conditions: Conditions) -> None:
    trial = Trial(conditions=conditions.as_text())
    assert conditions_in_trial(Trial.from_metadata(trial.as_metadata())) == conditions


def test_the_configuration_gives_conditions_and_the_antennas_place() -> None:
    text = config_text(f'type = "udp"\nport = {free_port()}\n')
    more = "\n[conditions]\ntrim_m = 0.2\nfull_load_draught_m = 8.0\n[instruments]\nantenna_forward_m = -12.5\n"
    trial = parse_config(text + more, Path("trial.toml")).trial
    assert (trial.antenna_forward_m, trial.antenna_starboard_m) == (-12.5, None)
    known = recorded_conditions(replace(trial, draught_m=7.9, sea_state="slight"), pd.DataFrame())
    assert (known.trim_m, known.full_load_draught_m, known.draught_m, known.sea_state) == (0.2, 8.0, 7.9, 3)
    with pytest.raises(ConfigurationError, match="full_load_draft_m"):
        parse_config(text + "\n[conditions]\nfull_load_draft_m = 8.0\n", Path("trial.toml"))


@pytest.mark.parametrize("text", ["no JSON", "[]", '{"trim_m": "deep"}', '{"draught_m": -1.0}', '{"nobody": 1}'])
def test_conditions_that_are_none_are_reported_and_not_taken(text: str, caplog: pytest.LogCaptureFixture) -> None:
    assert recorded_conditions(Trial(name="x", conditions=text, trim_m=0.1), pd.DataFrame()).trim_m == 0.1
    assert "x: its metadata" in caplog.text


@pytest.mark.parametrize(("words", "state"), [
    ("3", 3), ("sea state 4", 4), ("Douglas 2", 2), ("slight", 3), ("Very rough sea", 6), ("calm to slight", None),
    ("", None), ("swell from NW", None), ("12", None),
])  # fmt: skip
def test_a_state_of_the_sea_is_read_only_where_it_is_named(words: str, state: int | None) -> None:
    assert parse_sea_state(words) == state


def test_a_wind_that_an_import_assumed_is_not_known() -> None:
    index = pd.date_range("2026-06-01", periods=3, freq="s", tz="UTC")
    table = pd.DataFrame({"wind_speed_mps": [6.0] * 3, "wind_direction_deg": [10.0] * 3}, index=index)
    assert recorded_conditions(Trial(), table).beaufort == 4
    table.attrs["sources"] = {"wind_speed_mps": ["assumed"]}
    assert recorded_conditions(Trial(), table).beaufort is None


def test_a_helm_that_only_passes_on_its_way_is_no_swing(sail_programme: pd.DataFrame) -> None:
    """A course is steered hard to port when the zigzag to starboard is ordered: the orders stay in their order."""
    for run in find_manoeuvres(sail_programme, 28.9):
        orders = [run.start, *run.executes]
        assert all(later > earlier for earlier, later in pairwise(orders)), run.name
        for name, index in run.indices.items():
            if "overshoot" in name and np.isfinite(index.low):
                assert index.value < 10.0, (run.name, name)


@pytest.fixture(scope="module")
def sail_programme() -> pd.DataFrame:
    table, _ = simulate_trial("gunnerus_short", "gentle", "programme", 1100.0, 10.0, 2)
    return table.iloc[::10]


@pytest.mark.parametrize("late_s", [-6.0, None])
def test_recorded_orders_that_do_not_precede_the_helm_show_nothing(late_s: float | None) -> None:
    """A channel that is late, or constant: the order is taken from the helm, and that is reported."""
    sailed, truth = sail(SHIP, "turning_circle", 1.0)
    late = np.zeros_like(sailed.helm_order_deg)
    if late_s is not None:
        rows = round(-10.0 * late_s)
        late = np.append(np.zeros(rows), sailed.helm_order_deg[:-rows])
    table = record(SHIP, replace(sailed, helm_order_deg=late), replace(QUIET, orders=True), seed=1)
    (found,) = (run for run in find_manoeuvres(table, 180.0) if run.kind == "turning_circle")
    assert found.indices["advance_m"].value == pytest.approx(truth.indices["advance_m"], abs=6.0)
    assert any("do not precede" in note for note in found.notes)
    assert any("do not precede" in reason for reason in found.indices["advance_m"].missing)
