"""A turning circle predicted from zigzags of a ship that is not quite that of its file."""

from __future__ import annotations

import pickle
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import seatrial as st
from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.analysis.conduct.outlook import Outlook, RecordedRun
from seatrial.analysis.conduct.programme import PlannedRun, TrialProgramme, programme_from_template
from seatrial.analysis.manoeuvres import criteria
from seatrial.analysis.manoeuvres.indices import Index
from seatrial.hybrid.evaluation.predicted_indices import (
    HeldOut,
    UncertainVessel,
    certain_vessel,
    form_errors,
    unseen_rows,
)
from seatrial.hybrid.identification.fit import with_values
from seatrial.hybrid.identification.outlook import (
    indices_of_run,
    legs_of_run,
    outlook_of_runs,
    predicted_criteria,
    trial_ship_of,
)
from seatrial.hybrid.simulation import vessel_check
from seatrial.hybrid.simulation.index_table import PredictedIndex
from seatrial.hybrid.simulation.trial import SeaState, SimulationNoise, simulate_trial
from seatrial.hybrid.vessel.files import load_vessel

FILE = load_vessel("kvlcc2_7m")
SHIP = with_values(FILE, {"hull.N_r": 1.15 * FILE.hull.N_r, "hull.Y_v": 0.9 * FILE.hull.Y_v})
"""The ship that sails: she damps turns more than her file says."""


@pytest.fixture(scope="module")
def programme() -> TrialProgramme:
    ship = vessel_check.ship_for_trials(FILE)
    return programme_from_template("imo", ship.length_m, vessel_check.test_speed_mps(FILE, ship.rpm))


def sailed(run: PlannedRun, programme: TrialProgramme, seed: int, rate_hz: float = 5.0) -> pd.DataFrame:
    """The samples of a run in a current from abeam."""
    current = SeaState(0.0, 0.0, 5.0, 0.04 * programme.programme.speed_mps)
    legs = legs_of_run(run, trial_ship_of(run, programme, SHIP), programme.length_s)
    duration_s = 60.0 * programme.minutes_of(run) + 5.0 * programme.length_s
    return simulate_trial(SHIP, current, legs, duration_s, rate_hz, seed, noise=SimulationNoise().scaled(0.1))[0]


@pytest.fixture(scope="module")
def recorded(programme: TrialProgramme) -> list[RecordedRun]:
    """Three zigzags."""
    runs = list[RecordedRun]()
    for seed, run in enumerate(run for run in programme.run[:3]):
        assert run.kind == "zigzag"
        runs.append(RecordedRun(run, sailed(run, programme, seed), valid=True))
    return runs


@pytest.fixture(scope="module")
def outlook(programme: TrialProgramme, recorded: list[RecordedRun]) -> Outlook:
    remaining = {place: run for place, run in enumerate(programme.run) if place > 2}
    maker = partial(outlook_of_runs, FILE, programme)
    made: Outlook = pickle.loads(pickle.dumps(maker))(recorded, remaining)  # as in its process
    return made


@pytest.mark.parametrize("rate_hz", [5.0, 1.0])
def test_way_to_the_first_turn_is_held_against_models_at_any_rate(
    programme: TrialProgramme, rate_hz: float
) -> None:
    run = programme.run[0]
    assert run.switch_deg == 10.0
    for switch_deg, reached in ((10.0, True), (5.0, False)):
        table = sailed(replace(run, switch_deg=switch_deg), programme, 0, rate_hz)
        rows = unseen_rows([HeldOut({"zigzag": table}, certain_vessel(SHIP))], {})
        assert ("initial_turning_m" in {row.name for row, _ in rows}) == reached


def test_intervals_hold_the_circle_that_was_not_sailed(programme: TrialProgramme, outlook: Outlook) -> None:
    circles = {place: run for place, run in enumerate(programme.run) if run.kind == "turning_circle"}
    for place, run in circles.items():
        truth, stated = (indices_of_run(run, programme, vessel) for vessel in (SHIP, FILE))
        predicted = outlook.runs[place].predicted
        assert set(predicted) == {"advance", "tactical diameter"}
        for criterion in criteria.CRITERIA[:2]:
            index = predicted[criterion.name]
            assert index.low <= truth[criterion.index] <= index.high
            assert abs(index.value - truth[criterion.index]) < abs(stated[criterion.index] - truth[criterion.index])
            assert index.limit == criterion.limit(programme.programme.length_m, programme.programme.speed_mps)


def test_what_was_sailed_with_a_small_helm_says_less_of_a_large_one(programme: TrialProgramme) -> None:
    ship = UncertainVessel(
        lambda z: with_values(FILE, {"hull.N_r": FILE.hull.N_r * (1.0 + 0.05 * float(z[0]))}),
        np.zeros(1),
        np.eye(1),
    )
    circle = next(run for run in programme.run if run.kind == "turning_circle")
    near, far = (
        predicted_criteria(ship, {"turn": (0.02, 6)}, circle, programme, sailed_deg)["advance"]
        for sailed_deg in (35.0, 10.0)
    )
    assert np.log(far.high / far.value) == pytest.approx(3.5 * np.log(near.high / near.value))
    assert not predicted_criteria(ship, {"turn": (0.02, 2)}, circle, programme, 35.0)
    assert not predicted_criteria(ship, {"overshoot": (0.02, 6)}, circle, programme, 35.0)


def test_coarse_measurements_that_agree_show_no_exact_form() -> None:
    measured = Index(4.0, 3.2, 4.8, "deg")
    name = "overshoot_1_from_order_deg"
    rows = [PredictedIndex("zigzag 20/20", "port", name, measured, held_out=4.0)] * 4
    coarse, exact = ([(row, error) for row in rows] for error in (0.1, 0.0))
    assert form_errors(coarse, at_least_shown=True)["overshoot"] == (pytest.approx(0.05), 4)
    assert form_errors(exact, at_least_shown=True)["overshoot"] == (0.0, 4)


def test_what_no_held_out_run_tests_is_not_predicted(programme: TrialProgramme, outlook: Outlook) -> None:
    (stop,) = (place for place, run in enumerate(programme.run) if run.kind == "stopping")
    assert not outlook.runs[stop].predicted
    assert not outlook.runs[stop].is_needless(programme.run[stop])


def test_every_run_that_remains_would_tell_something(outlook: Outlook) -> None:
    for run in outlook.runs.values():
        assert run.gain > 0.0
        assert 0.0 < run.left < 1.0
    assert 0 < outlook.known < outlook.coefficients


@pytest.mark.parametrize(("vessel", "length_m"), [("kvlcc2_7m", 7), ("gunnerus_long", 33.9)])
def test_ship_of_another_length_than_the_programmes_predicts_nothing(
    vessel: str, length_m: float, tmp_path: Path
) -> None:
    """The length of a ship whose file lengthens another's is her own, as in the programme written for her."""
    path = tmp_path / "day.toml"
    path.write_text('[programme]\nname = "day"\nlength_m = 60.0\nspeed_mps = 5.0\n[[run]]\nkind = "stopping"\n')
    with pytest.raises(
        ConfigurationError, match=f"another ship.* {length_m} m long, and the programme is for 60 m"
    ):
        st.conduct(path, vessel=vessel)
