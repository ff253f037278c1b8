"""The standard indices beside a fit: intervals follow covariance and form error; a worse model is said to be."""

from __future__ import annotations

import json
from dataclasses import replace
from math import nan

import numpy as np
import pandas as pd
import pytest

from seatrial.acquisition.core.quantities import Floats
from seatrial.analysis.manoeuvres.indices import Index
from seatrial.hybrid.evaluation.predicted_indices import (
    HeldOut,
    UncertainVessel,
    certain_vessel,
    form_errors,
    index_table,
    index_with_interval,
    standard_indices,
    uncertain_effects,
)
from seatrial.hybrid.identification.fit import with_values
from seatrial.hybrid.identification.identify import indices_of_file, uncertain_estimates
from seatrial.hybrid.prediction.baselines import Interval
from seatrial.hybrid.report.text import predicted_index_lines
from seatrial.hybrid.simulation.index_table import IndexTable, PredictedIndex
from seatrial.hybrid.simulation.manoeuvres import steer, usual_rpm, zigzag
from seatrial.hybrid.simulation.trial import SimulationNoise, simulate_trial
from seatrial.hybrid.simulation.vessel_check import STILL
from seatrial.hybrid.vessel.files import Vessel, load_vessel

SHIP = load_vessel("kvlcc2_7m")
DAMPING = -0.049


def with_damping(deviation: Floats) -> Vessel:
    """The ship with its yaw damping so many tenths larger."""
    return with_values(SHIP, {"hull.N_r": DAMPING * (1.0 + 0.1 * float(deviation[0]))})


def uncertain(variance: float) -> UncertainVessel:
    return UncertainVessel(with_damping, np.zeros(1), np.array([[variance]]))


@pytest.fixture(scope="module")
def sailed() -> pd.DataFrame:
    """A zigzag 20/20 of the ship after a straight approach."""
    rpm = usual_rpm(SHIP)
    legs = (steer(0.0, 40.0, rpm), *zigzag(20.0, 20.0, rpm, swings=10))
    return simulate_trial(SHIP, STILL, legs, 200.0, 10.0, 1, noise=SimulationNoise().scaled(0.1))[0]


def reach(table: IndexTable, name: str) -> float:
    """The relative half width of the interval of an index of a turning circle to port."""
    row = next(row for row in table.rows if row.name == name and row.side == "port")
    assert row.predicted is not None
    return float(np.log(row.predicted.high / row.predicted.value))


def test_an_interval_is_as_wide_as_the_covariance_says() -> None:
    narrow, wide = (index_table({}, SHIP, uncertain(variance)) for variance in (0.25, 1.0))
    assert reach(wide, "tactical_diameter_m") == pytest.approx(2.0 * reach(narrow, "tactical_diameter_m"), rel=0.1)
    by_hand = [standard_indices(with_damping(np.array([side]))) for side in (-1.0, 1.0)]
    key = ("turning circle 35 deg", "port", "tactical_diameter_m")
    expected = 1.96 * 0.5 * abs(np.log(by_hand[1][key] / by_hand[0][key]))
    assert reach(wide, "tactical_diameter_m") == pytest.approx(expected, rel=0.05)


def test_a_model_without_errors_has_no_interval() -> None:
    table = index_table({}, SHIP, certain_vessel(SHIP))
    assert table.rows
    assert all(row.predicted is not None and np.isnan(row.predicted.low) for row in table.rows)
    assert predicted_index_lines(table).columns == ["model"]
    assert not table.headline


def test_the_true_model_has_the_measured_indices_and_a_wrong_one_is_reported_as_worse(sailed: pd.DataFrame) -> None:
    wrong = with_damping(np.array([5.0]))
    better, worse = (
        index_table({"sailed": sailed}, *pair)
        for pair in ((wrong, certain_vessel(SHIP)), (SHIP, certain_vessel(wrong)))
    )
    measured = [row for row in better.rows if row.measured is not None]
    assert {row.name for row in measured} >= {"overshoot_1_from_order_deg", "overshoot_2_from_order_deg"}
    for row in measured:
        assert row.moved is not None
        assert abs(row.moved[1]) < 0.06 < abs(row.moved[0])
    assert "worse" not in better.headline
    assert worse.headline.startswith("The model is worse:")
    assert all(row.is_worse for row in worse.rows if row.moved is not None)


def test_an_index_of_nearly_nothing_does_not_make_the_others_badly_met() -> None:
    """An overshoot of a hundredth of a degree, of which the model has a degree."""
    sizes = (0.01, 1.0, 1.1), (10.0, 12.0, 11.0), (50.0, 55.0, 52.0)
    rows = [
        PredictedIndex("zigzag 10/10", "port", "overshoot_1_deg", Index(value, nan, nan, "deg"), before, after)
        for value, before, after in sizes
    ]
    assert "Half of 3 measured indices are met within 10%, before within 20%." in IndexTable(tuple(rows)).headline


def test_a_current_that_no_circle_shows_is_no_error_of_the_form() -> None:
    rpm = usual_rpm(SHIP)
    water = (0.0, 0.05)  # from abeam, 5 % of the speed
    sailing = replace(SHIP, effects={"ocean_current": {"speed_mps": water[1], "direction_deg": 90.0}})
    legs = (steer(0.0, 40.0, rpm), *zigzag(20.0, 20.0, rpm, swings=10))
    table, _ = simulate_trial(sailing, STILL, legs, 200.0, 10.0, 1, noise=SimulationNoise().scaled(0.1))
    tables, exact = {"sailed": table}, certain_vessel(SHIP)
    known, taken_for_drift = (
        index_table(tables, SHIP, exact, [HeldOut(tables, exact)], currents=currents)
        for currents in ({"sailed": water}, {})
    )
    assert known.form_errors[""][0] < 0.02
    assert taken_for_drift.form_errors[""][0] > 2.0 * known.form_errors[""][0]


def test_sailed_manoeuvres_are_not_predicted_again(sailed: pd.DataFrame) -> None:
    table = index_table({"sailed": sailed}, SHIP, uncertain(1.0))
    keys = [(row.test, row.side, row.name) for row in table.rows]
    assert len(set(keys)) == len(keys)
    assert {row.test for row in table.rows if row.measured is None} >= {"turning circle 35 deg", "zigzag 10/10"}


def test_a_wrong_form_shows_in_held_out_runs_and_widens_what_was_not_sailed(sailed: pd.DataFrame) -> None:
    wrong = UncertainVessel(lambda _: with_damping(np.array([3.0])), np.zeros(0), np.zeros((0, 0)))
    table = index_table({"sailed": sailed}, SHIP, wrong, [HeldOut({"sailed": sailed}, wrong)])
    assert table.form_errors["overshoot"][0] > 0.05
    for row in (row for row in table.rows if row.measured is not None and row.predicted is not None):
        assert row.held_out is not None
        assert row.predicted is not None
        assert row.measured is not None
        assert row.predicted.low < row.measured.value < row.predicted.high
    assert reach(table, "advance_m") > 0.1


def test_an_error_that_the_coefficients_explain_is_none_of_the_form() -> None:
    rows = [PredictedIndex("zigzag", "port", "advance_m", Index(1.0, 1.0, 1.0, "m"), held_out=1.1)] * 4
    explained, unexplained = (form_errors([(row, error) for row in rows]) for error in (0.2, 0.0))
    assert explained["turn"] == (0.0, 4)
    assert unexplained["turn"][0] == pytest.approx(np.log(1.1))
    assert (
        index_with_interval("advance_m", 2.0, 0.0, unexplained).high
        > index_with_interval("advance_m", 2.0, 0.0, explained).high
    )


def test_effects_move_the_indices_within_their_intervals() -> None:
    named = {"hull_fouling": {"resistance_factor": Interval(1.5, 1.3, 1.7)}}
    vessel = uncertain_effects(SHIP, named)
    ends = [
        vessel.vessel_at(np.array([side])).effects["hull_fouling"]["resistance_factor"] for side in (-1.96, 1.96)
    ]
    assert ends == pytest.approx([1.3, 1.7], rel=1e-5)


def test_what_was_not_sailed_is_as_uncertain_as_the_file_says_and_in_still_water(sailed: pd.DataFrame) -> None:
    """Of a zigzag nothing follows for the thrust astern, which the file calls estimated: the stop is as uncertain
    as before. What was sailed shows how far a model is off, though nothing was fitted; and the day's current is no
    part of a standard manoeuvre."""
    ship = replace(SHIP, estimated={"propeller.astern_0": 0.3, "propeller.astern_1": 0.3})
    day = replace(ship, effects={"ocean_current": {"speed_mps": 0.1, "direction_deg": 40.0}})
    stated = {row.name: row.predicted for row in indices_of_file(ship).rows}
    assert standard_indices(day) == standard_indices(ship)
    table = index_table({"a": sailed}, ship, certain_vessel(ship), estimates=uncertain_estimates(ship))
    rows = {(row.test, row.side, row.name): row for row in table.rows}
    stop = rows["stopping with thrust astern", "", "track_reach_m"].predicted
    before = stated["track_reach_m"]
    assert stop is not None
    assert before is not None
    assert stop.high / stop.low >= 0.99 * before.high / before.low > 1.1
    turn = rows["turning circle 35 deg", "port", "advance_m"].predicted
    assert turn is not None
    assert 1.0 < turn.high / turn.low < 1.3


def test_errors_stated_in_a_vessel_file_give_its_manoeuvres_intervals() -> None:
    vessel = replace(SHIP, estimated={"hull.N_r": 0.1})
    assert reach(indices_of_file(vessel), "advance_m") > 0.01


def test_a_table_goes_to_json_and_back(sailed: pd.DataFrame) -> None:
    table = index_table({"sailed": sailed}, SHIP, uncertain(1.0))
    rows = json.loads(json.dumps(table.as_json()))
    assert {"name", "side", "measured", "before", "after", "predicted", "replayed"} <= set(rows[0])
    assert IndexTable.from_json(rows).as_json() == rows


def test_a_measured_index_stands_with_its_interval() -> None:
    """So that one of an antenna somewhere on the ship is not read as the ship's to a decimetre."""
    measured = Index(45.7, 27.4, 64.0, "m")
    row = PredictedIndex("turning circle 25 deg", "port", "transfer_m", measured, 55.9, 56.3, replayed=56.0)
    lines = predicted_index_lines(IndexTable((row, replace(row, measured=None, replayed=None))))
    assert lines.columns[0] == "measured"
    assert lines.tests[0][1][0][1] == "45.7 ± 18"
    assert lines.tests[0][1][1][1] == ""
