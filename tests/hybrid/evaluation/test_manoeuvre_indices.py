"""Measured beside simulated indices: on its own recording a model has no difference, a known effect shows."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from math import inf
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as numbers

import seatrial
from seatrial.acquisition.core.errors import DataShortageError
from seatrial.analysis.manoeuvres.find import find_manoeuvres
from seatrial.analysis.manoeuvres.indices import Current, Index, Manoeuvre
from seatrial.analysis.manoeuvres.kinds import GATHERING_WAY
from seatrial.analysis.manoeuvres.measures import SHAFTS_CHANGED
from seatrial.analysis.tables.resample import resample
from seatrial.analysis.windows.held import OneHertzTables
from seatrial.hybrid.calibrators import make_calibrator
from seatrial.hybrid.calibrators.adaptive import AdaptiveCalibrator, parameter_names
from seatrial.hybrid.calibrators.predict import Predictor
from seatrial.hybrid.effects import vessel_plant
from seatrial.hybrid.evaluation.manoeuvre_indices import (
    IndexComparison,
    IndexComparisons,
    JudgedModel,
    SimulatedIndex,
    index_comparison,
    keep_comparable_indices,
    models_of_predictor,
    predicted_indices,
)
from seatrial.hybrid.evaluation.validate import LengthErrors, errors_after_lengths
from seatrial.hybrid.prediction.dataset import dataset_of
from seatrial.hybrid.report.trial_form import INDEX_HEADER, index_tables, notes_on_index_tables
from seatrial.hybrid.simulation.manoeuvres import Leg, pace_of, steer, turning_circle, usual_rpm, zigzag
from seatrial.hybrid.simulation.manoeuvres import Manoeuvre as Legs
from seatrial.hybrid.simulation.trial import SeaState, record_trial, simulate_trial
from seatrial.hybrid.simulation.vessel_check import trial_ship_at_rpm
from seatrial.hybrid.simulation.vessel_check import turning_circle_test as sail_circle
from seatrial.hybrid.vessel.files import Vessel, load_vessel
from tests.conftest import nightly

STILL = SeaState(0.0, 0.0, 5.0, 0.0)
SHIPS = ("gunnerus_short", "kvlcc2_7m", "esso_osaka_3m")


def programme_of(ship: Vessel) -> tuple[Legs, float]:
    """A circle to either side, two zigzags and a crash stop, each after a long approach, and how long they take."""
    rpm, longer = usual_rpm(ship), pace_of(ship).time
    approach = steer(0.0, 150.0 * longer, rpm)
    circles = [turning_circle(side * 30.0, rpm)[1] for side in (-1.0, 1.0)]
    swings = [
        replace(leg, at_most_s=inf) for angle in (20.0, 10.0) for leg in zigzag(-angle, -angle, rpm, swings=5)
    ]
    legs = (
        approach, circles[0], approach, circles[1], approach, *swings[:5], approach, *swings[5:], approach,
        Leg(rpm=-rpm, slower_mps=-pace_of(ship).speed), Leg(rpm=0.0),
    )  # fmt: skip
    return legs, 1750.0 * longer


@cache
def trial(name: str, sea: SeaState = STILL, hidden: str = "") -> tuple[pd.DataFrame, tuple[Manoeuvre, ...]]:
    """A simulated trial with the sensors' noise, and the manoeuvres found in it."""
    ship = load_vessel(name)
    legs, seconds = programme_of(ship)
    rate_hz = float(np.clip(5.0 / pace_of(ship).time, 1.0, 10.0))
    table, _ = simulate_trial(ship, sea, legs, seconds, rate_hz, 3, json.loads(hidden or "{}"))
    return table, find_manoeuvres(table, ship.dimensions.length_between_perpendiculars_m)


def predictor(name: str) -> Predictor:
    ship = load_vessel(name)
    return Predictor(name, vessel_plant(ship), 15, ship=ship)


def rows_by_name(found: IndexComparisons) -> Mapping[tuple[str, str, str], IndexComparison]:
    return {(row.test.split()[0], row.side, row.name): row for row in found.rows}


def is_near(simulated: SimulatedIndex | None, share: float) -> bool:
    """Within the measured interval, or a share of the value beside it."""
    if simulated is None:
        return False
    measured = simulated.measured
    return abs(simulated.difference) <= 0.5 * (measured.high - measured.low) + share * abs(measured.value)


@pytest.mark.parametrize("name", SHIPS)
def test_a_model_has_the_indices_of_its_own_recording(name: str) -> None:
    """Azimuths and rudders: predicted at the approach speed and replayed from a noisy start."""
    found = index_comparison([trial(name)], predictor(name))
    assert {row.test.split()[0] for row in found.rows} == {"turning", "zigzag", "stopping"}
    assert not found.left_out
    for row in found.rows:
        if row.name in ("lateral_deviation_m", "heading_change_deg"):
            continue  # of a stop, whose heading hangs on the last of the noise
        if row.name == "approach_rpm":
            assert abs(row.predicted.difference) < 0.06 * row.measured.value  # some still gather way
            continue
        assert is_near(row.predicted, 0.04), row
        if row.name != "period_s":
            assert is_near(row.replayed, 0.05), row
    within = [form.within for row in found.rows for form in (row.predicted, row.replayed)
              if form and form.within is not None]  # fmt: skip
    assert np.mean(within) > 0.6


@pytest.mark.parametrize("name", ["gunnerus_short", *nightly("kvlcc2_7m")])
def test_both_forms_hold_in_a_current_that_the_circle_shows(name: str) -> None:
    """The way of a stop over ground changes by the current; sailed in the same water it does not differ."""
    scale = pace_of(load_vessel(name)).speed
    table, runs = trial(name, SeaState(0.0, 0.0, 5.0, 0.5 * scale))
    found = rows_by_name(index_comparison([(table, runs)], predictor(name)))
    for side in ("starboard", "port"):
        for index in ("advance_m", "transfer_m", "tactical_diameter_m"):
            row = found["turning", side, index]
            assert row.current_removed
            assert is_near(row.replayed, 0.02), row
            assert is_near(row.predicted, 0.04), row
    for form in (found["stopping", "", "track_reach_m"].predicted, found["stopping", "", "track_reach_m"].replayed):
        assert is_near(form, 0.03)


@pytest.mark.parametrize("name", ["kvlcc2_7m", *nightly("gunnerus_short")])
def test_an_effect_that_the_model_lacks_shows_with_its_direction_and_size(name: str) -> None:
    """The sailed ship resists turning more: the model's circle is as much smaller as the effect makes it."""
    hidden = {"yaw_damping": {"factor": 1.4}}
    ship = load_vessel(name)
    found = rows_by_name(index_comparison([trial(name, STILL, json.dumps(hidden))], predictor(name)))
    plain, damped = (
        sail_circle(trial_ship_at_rpm(each, usual_rpm(each)), 1.0, 30.0).indices["tactical_diameter_m"].value
        for each in (ship, replace(ship, effects=hidden))
    )
    row = found["turning", "starboard", "tactical_diameter_m"]
    assert plain < damped
    for form in (row.predicted, row.replayed):
        assert form is not None
        assert form.difference == pytest.approx(plain - damped, rel=0.1)
        assert form.within is False


def test_a_model_of_another_ship_makes_no_manoeuvre_and_says_why() -> None:
    found = index_comparison([trial("gunnerus_short")], predictor("kvlcc2_7m"))
    assert not found.rows
    assert {each.form for each in found.left_out} == {"predicted", "replayed"}
    assert all("the recording is of a ship with" in each.why for each in found.left_out)
    assert any(note.startswith("Not predicted by the reference model: turning circle")
               for note in notes_on_index_tables(found))  # fmt: skip


def test_a_test_at_a_speed_that_the_model_does_not_make_is_replayed_only() -> None:
    table, runs = trial("gunnerus_short")
    fast = [replace(run, settings={**run.settings, "approach_mps": 19.0}) for run in runs if run.kind == "zigzag"]
    found = index_comparison([(table, fast)], predictor("gunnerus_short"))
    assert all(row.predicted is None and row.replayed is not None for row in found.rows)
    assert {each.form for each in found.left_out} == {"predicted"}


def test_a_zigzag_begun_while_gathering_way_is_replayed_only() -> None:
    """A steady approach at its speed of the moment takes a fraction of the shaft speed that drives the ship on."""
    table, runs = trial("gunnerus_short")
    zigzags = [run for run in runs if run.kind == "zigzag"]
    begun = [
        replace(run, indices={name: index for name, index in run.indices.items() if name != "speed_loss"})
        for run in zigzags
    ]
    found = index_comparison([(table, begun)], predictor("gunnerus_short"))
    assert found.rows
    assert all(row.predicted is None and row.replayed is not None for row in found.rows)
    assert any(GATHERING_WAY in note for note in notes_on_index_tables(found))


@pytest.mark.parametrize("factor", [0.7, 1.0, 1.3])
def test_a_circle_in_which_the_shafts_were_changed_is_replayed_only(factor: float) -> None:
    """The same test keeps its shaft speed: its rate of turn is no error of a model that keeps it."""
    ship, rpm = load_vessel("gunnerus_short"), 140.0
    legs = (steer(0.0, 60.0, rpm), *turning_circle(-20.0, factor * rpm)[1:2])
    table, _ = simulate_trial(ship, STILL, legs, 260.0, 1.0, 3)
    runs = find_manoeuvres(table, ship.dimensions.length_between_perpendiculars_m)
    found = index_comparison([(table, runs)], predictor("gunnerus_short"))
    is_same_test = factor == 1.0
    assert found.rows
    assert all((row.predicted is not None) == is_same_test for row in found.rows if row.replayed is not None)
    assert any(SHAFTS_CHANGED in note for note in notes_on_index_tables(found)) is not is_same_test


def test_model_that_turns_too_slowly_for_the_current_is_said() -> None:
    """Over ground and with the current removed are not compared with each other."""
    stiff = replace(load_vessel("gunnerus_short"), effects={"yaw_damping": {"factor": 5.0}})
    found = index_comparison([trial("gunnerus_short")], Predictor("stiff", vessel_plant(stiff), 15, ship=stiff))
    assert any("too little to remove the current" in each.why for each in found.left_out)
    assert all(row.replayed is None for row in found.rows if row.current_removed)


def test_helm_beyond_the_model_is_no_test_of_it() -> None:
    """Not silently made with less helm."""
    ship = load_vessel("kvlcc2_7m")
    short = replace(ship, actuator=tuple(
        replace(each, limit_deg=15.0) if each.kind == "rudder" else each for each in ship.actuator
    ))  # fmt: skip
    model = Predictor("short", vessel_plant(ship), 15, ship=short)
    found = index_comparison([trial("kvlcc2_7m")], model)
    assert any("beyond the model's limit of 15 deg" in each.why for each in found.left_out)
    assert {row.test for row in found.rows if row.predicted} >= {"zigzag 10/10"}


def test_ship_steered_by_its_shafts_is_replayed_only() -> None:
    """Its helm has no angle that two ships, or two speeds, would share; the recorded shafts tell all."""
    ship = load_vessel("otter_2m")
    rpm, longer = usual_rpm(ship), pace_of(ship).time
    legs = (steer(0.0, 60.0 * longer, rpm), turning_circle(-20.0, rpm)[1], steer(0.0, 60.0 * longer, rpm))
    table, _ = simulate_trial(ship, STILL, legs, 300.0 * longer, 10.0, 1)
    order = table.index[0] + pd.Timedelta(seconds=np.ceil(60.0 * longer * 10.0) / 10.0)
    end = order + pd.Timedelta(seconds=200.0 * longer)
    turned_deg = float(np.abs(np.ptp(np.unwrap(table["heading_deg"][order:end], period=360.0))))
    settings = {"turned_deg": turned_deg, "approach_mps": 1.0, "approach_heading_deg": 0.0}
    circle = Manoeuvre("turning_circle", "circle", order, end, "starboard", settings, {
        "tactical_diameter_m": Index(10.0, 9.0, 11.0, "m")
    })  # fmt: skip
    found = index_comparison([(table, [circle])], predictor("otter_2m"))
    assert [each.form for each in found.left_out] == ["predicted"]
    assert "difference of its shafts" in found.left_out[0].why
    motion = find_diameter(table, order, end)
    (row,) = found.rows
    assert row.replayed is not None
    assert row.replayed.value == pytest.approx(motion, rel=0.05)


def find_diameter(table: pd.DataFrame, order: pd.Timestamp, end: pd.Timestamp) -> float:
    """The way to starboard of the approach until half a turn, by the noisy positions."""
    part = table[order:end]
    turned = np.unwrap(part["heading_deg"], period=360.0)
    row = int(np.argmax(np.abs(turned - turned[0]) >= 180.0))
    return float(part["east_m"].iloc[row] - part["east_m"].iloc[0])


def test_depth_and_draught_that_the_model_does_not_know_are_said() -> None:
    table, runs = trial("gunnerus_short")
    shallow = table.copy()
    shallow.attrs["trial"] = {**table.attrs.get("trial", {}), "water_depth_m": 6.0, "draught_m": 3.6}
    remarks = index_comparison([(shallow, runs)], predictor("gunnerus_short")).remarks
    assert any("6 m of water" in each for each in remarks)
    assert any("draught of 3.6 m" in each for each in remarks)


def test_what_shaft_speed_the_approach_takes_is_a_row() -> None:
    """A model of a cleaner hull needs fewer revolutions for the recorded speed."""
    ship = load_vessel("gunnerus_short")
    found = index_comparison([trial("gunnerus_short", STILL, '{"hull_fouling": {"resistance_factor": 1.3}}')],
                             predictor("gunnerus_short"))  # fmt: skip
    row = rows_by_name(found)["turning", "starboard", "approach_rpm"]
    assert row.measured.value == pytest.approx(usual_rpm(ship), rel=0.01)
    assert row.replayed is None
    assert row.predicted is not None
    assert row.predicted.within is None
    assert row.predicted.percent is not None
    assert -15.0 < row.predicted.percent < -4.0


def adaptive(name: str, **deviations: float) -> AdaptiveCalibrator:
    """A calibrator that has learned some parameters, in their prior standard deviations."""
    plant = vessel_plant(load_vessel(name))
    calibrator = make_calibrator("adaptive", 0, plant)
    assert isinstance(calibrator, AdaptiveCalibrator)
    names = parameter_names(plant.form)
    calibrator.vectors_ = np.tile([deviations.get(each, 0.0) for each in names], (2, 1))
    return calibrator


def test_a_calibrator_that_adapts_the_model_is_a_model_and_a_network_is_none() -> None:
    plant = vessel_plant(load_vessel("gunnerus_short"))
    assert adaptive("gunnerus_short").adapted_model() == plant
    heavier = adaptive("gunnerus_short", mass_kg=0.5).adapted_model()
    assert heavier.mass_kg == pytest.approx(plant.mass_kg * np.exp(0.25))
    assert make_calibrator("paper", 0, plant).adapted_model() is None
    assert models_of_predictor(predictor("gunnerus_short")) == {
        "reference": JudgedModel(plant, load_vessel("gunnerus_short"))
    }


ROUNDED = numbers.floats(-100.0, 100.0).map(lambda value: round(value, 6))


@given(value=ROUNDED, half=numbers.floats(0.0, 50.0), simulated=ROUNDED)
def test_difference_percent_and_within_agree(value: float, half: float, simulated: float) -> None:
    index = Index(value, value - half, value + half, "m")
    beside = SimulatedIndex(simulated, index)
    assert beside.difference == simulated - value
    assert beside.within == (index.low <= simulated <= index.high)
    if beside.percent is not None:
        assert beside.percent * abs(value) / 100.0 == pytest.approx(beside.difference)
        assert half < abs(value)
    assert SimulatedIndex(simulated, replace(index, low=np.nan)).within is None


def test_cells_have_the_digits_of_the_measured_value() -> None:
    title, lines = index_tables(index_comparison([trial("gunnerus_short")], predictor("gunnerus_short")))[0]
    assert "turning circle 30 deg to starboard" in title
    for line in lines:
        assert len(line) == len(INDEX_HEADER)
        decimals = [cell.split()[0].partition(".")[2] for cell in (line[1], line[3], line[5]) if cell]
        assert len(set(map(len, decimals))) == 1, line


def recorded(folder: Path, name: str, change: Callable[[pd.DataFrame], pd.DataFrame] = lambda table: table) -> Path:
    ship = load_vessel(name)
    legs, _ = programme_of(ship)
    table, truth = simulate_trial(ship, STILL, legs[:2], 330.0 * pace_of(ship).time, 5.0, 1)
    path = folder / "trial.mcap"
    record_trial(change(table), truth, path)
    return path


def test_validate_says_indices_and_errors_by_length(tmp_path: Path) -> None:
    path = recorded(tmp_path, "gunnerus_short")
    validation = seatrial.validate(path)
    answer = validation.as_dict()
    circle = {row["name"]: row for row in answer["indices"]}
    diameter = circle["tactical_diameter_m"]
    assert (diameter["method"], diameter["side"], diameter["unit"]) == ("reference", "starboard", "m")
    assert diameter["measured"]["low"] < diameter["measured"]["value"] < diameter["measured"]["high"]
    for form in ("predicted", "replayed"):
        assert abs(diameter[form]["percent"]) < 2.0
        assert diameter[form]["value"] - diameter["measured"]["value"] == pytest.approx(
            diameter[form]["difference"]
        )
    lengths = answer["by_length"]
    assert lengths["length_time_s"] == pytest.approx(lengths["length_m"] / lengths["speed_mps"])
    assert lengths["horizon_lengths"] == pytest.approx(15.0 / lengths["length_time_s"])
    assert [each["lengths"] for each in lengths["errors"]] == [1, 2, 5]
    assert "tactical diameter" in str(validation)
    assert "L/V" in str(validation)


def test_a_recording_that_allows_no_manoeuvres_is_left_out_with_a_warning(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As one too long for a table of all its samples: the errors of predictions are there nevertheless."""

    def too_long(*_: object) -> None:
        raise DataShortageError("holds too many samples")

    monkeypatch.setattr("seatrial.hybrid.evaluation.manoeuvre_indices.prepare_table", lambda *_, **__: too_long())
    answer = seatrial.validate(recorded(tmp_path, "gunnerus_short")).as_dict()
    assert answer["windows"] > 0
    assert answer["indices"] == []
    assert "its manoeuvres are not compared: holds too many samples" in caplog.text


def test_a_recording_without_manoeuvres_has_no_table_of_them(tmp_path: Path) -> None:
    path = recorded(tmp_path, "gunnerus_short", lambda table: table.iloc[: 5 * 55])
    validation = seatrial.validate(path)
    answer = validation.as_dict()
    assert answer["indices"] == answer["indices_left_out"] == []
    assert "predicted" not in str(validation)


def errors_of(name: str, table: pd.DataFrame) -> LengthErrors:
    """The errors by L/V on a table at 1 Hz of a ship by her own model."""
    plant, tables = vessel_plant(load_vessel(name)), {"own": OneHertzTables(table)}
    found = errors_after_lengths(tables, dataset_of(tables, 15, 5, any_commands=True).windows, plant)
    assert found is not None
    return found


@pytest.mark.parametrize("name", ["gunnerus_short", "kvlcc2_7m"])
def test_errors_by_length_are_at_whole_seconds_of_the_ship(name: str) -> None:
    """The own model errs less than constant velocity after five lengths of a zigzag; both err more with time."""
    found = errors_of(name, resample(trial(name)[0]))
    length_s = load_vessel(name).dimensions.length_between_perpendiculars_m / found.speed_mps
    assert found.seconds == tuple(round(each * length_s) for each in (1, 2, 5))
    kept, own = (found.methods[method] for method in ("constant_velocity", "reference"))
    assert own[2].distance_m < 0.5 * kept[2].distance_m
    for errors in (kept, own):
        assert np.all(np.diff([each.distance_m for each in errors]) > 0.0)
        for each in errors:
            assert each.distance_lengths == pytest.approx(each.distance_m / found.length_m)


def test_times_longer_than_the_recording_are_left_out() -> None:
    short = resample(trial("gunnerus_short")[0]).iloc[:26]
    assert errors_of("gunnerus_short", short).lengths == (1, 2)


def test_runs_with_the_current_of_others_are_compared_over_ground() -> None:
    """A zigzag whose current is that of a circle elsewhere does not show it: its model sails in the current."""
    start = pd.Timestamp("2026-06-01T12:00:00Z")
    index = Index(100.0, 90.0, 110.0, "m")
    zigzag = Manoeuvre("zigzag", "zigzag 10/10", start, start, "port", {}, {"initial_turning_m": index},
                       current=Current(0.3, 0.0, 0.01, 0.01))  # fmt: skip
    zigzag = replace(zigzag, indices={**zigzag.indices, "initial_turning_m_current_removed": index})
    assert keep_comparable_indices(zigzag).current is None
    assert list(keep_comparable_indices(zigzag).indices) == ["initial_turning_m"]
    circle = replace(zigzag, kind="turning_circle", settings={"turned_deg": 560.0})
    assert keep_comparable_indices(circle) == circle


def test_run_without_an_approach_is_left_out_with_its_reason() -> None:
    """As in a programme of a small craft, whose tests follow each other without a break."""
    ship = load_vessel("gunnerus_short")
    recorded: Any = SimpleNamespace(motion=SimpleNamespace(at=lambda *_: 1.0), seconds=lambda _: 0.0)
    run: Any = SimpleNamespace(kind="turning_circle", indices={}, settings={}, start=None)
    with pytest.raises(DataShortageError, match="no approach"):
        predicted_indices(recorded, run, JudgedModel(vessel_plant(ship), ship), None)
