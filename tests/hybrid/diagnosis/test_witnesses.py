"""Meters aboard: thrust tells a propeller that pushes more from a hull that resists less, a speed log either from a
current, which tracks hardly do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from seatrial.acquisition.core.quantities import Floats
from seatrial.acquisition.core.ship import Actuator
from seatrial.acquisition.tables.import_table import propose_column_map
from seatrial.acquisition.tables.table_files import read_raw_table
from seatrial.hybrid.diagnosis.few_causes import search_of
from seatrial.hybrid.diagnosis.gap import unseen_windows
from seatrial.hybrid.diagnosis.linearise import ModelWithEffects
from seatrial.hybrid.diagnosis.log import mean_meters, thrust_columns
from seatrial.hybrid.diagnosis.witnesses import METERS, model_thrust, model_water_speed, witnesses_of
from seatrial.hybrid.effects import apply_effects, catalogue_of
from seatrial.hybrid.vessel.dynamics import shaft_thrusts
from seatrial.hybrid.vessel.files import load_vessel
from seatrial.hybrid.vessel.plant import Plant, bare_plant
from tests.hybrid.diagnosis.log_by_hand import DT_S, a_log

VESSEL = load_vessel("kvlcc2_7m")
CATALOGUE = catalogue_of(VESSEL)
PUSHES_MORE = "thrust_loss_propeller", {"fraction": -0.35}
RESISTS_LESS = "hull_fouling", {"resistance_factor": 0.7}
SECONDS, BLOCK_S = 640, 40
START = (0.0, 0.0, 0.3, 1.2, 0.0, 0.0)


@pytest.fixture(scope="module")
def model() -> Plant:
    return bare_plant(VESSEL)


def weaving(seconds: int) -> Floats:
    """A shaft that turns evenly and a rudder that swings [4 seconds, 2]."""
    t = np.arange(round(seconds / DT_S)) * DT_S
    return np.column_stack([np.full_like(t, 10.0), np.deg2rad(12.0) * np.sin(2.0 * np.pi * t / 47.0)])


@pytest.mark.parametrize("hidden", [PUSHES_MORE, RESISTS_LESS], ids=["propeller", "hull"])
@pytest.mark.parametrize("factor", [1.0, 1.03], ids=["true meter", "meter off"])
def test_thrust_tells_the_propeller_from_the_hull(model: Plant, hidden: tuple[str, dict], factor: float) -> None:
    """Tracks at one shaft speed alone fit either; the thrust leaves the one that is there, whatever the meter's
    factor within its usual error."""
    name, values = hidden
    (other,) = {PUSHES_MORE[0], RESISTS_LESS[0]} - {name}
    ship = apply_effects(model, {name: values}, CATALOGUE)
    blocks = tuple(range(BLOCK_S, SECONDS, BLOCK_S))
    log = a_log(ship, SECONDS, blocks, (), weaving(SECONDS), START, wind_mps=0.0)
    noise = np.random.default_rng(3).normal(1.0, 0.02, (len(log), 1))
    read = model_thrust(log, ModelWithEffects(ship, {}), np.arange(len(log))) * factor * noise
    both = ModelWithEffects(model, {each: CATALOGUE[each] for each in (name, other)})
    search, by_tracks = (
        search_of(unseen_windows(each, both), lambda names: True)
        for each in (replace(log, meters={"thrust": read}), log)
    )
    right, wrong = search.fitted((name,), {}), by_tracks.fitted((other,), {})
    assert wrong.mean_m() < 0.5 * search.fitted((), {}).mean_m()  # by the tracks alone it would do
    assert search._contradicts_meters(wrong.at, right.at)
    assert not search._contradicts_meters(right.at, {})
    assert search.search().names == (name,)


@pytest.mark.parametrize("hidden", ["ocean_current", "hull_fouling"])
@pytest.mark.parametrize("factor", [1.0, 0.97], ids=["true log", "log off"])
def test_a_speed_log_tells_the_current_from_the_resistance(model: Plant, hidden: str, factor: float) -> None:
    """A following current and a hull that resists less both make a ship faster over ground; a log of the speed
    through the water, whatever its factor within its usual error, fits the one that is there only."""
    sizes = {"ocean_current": (0.115, 0.035), "hull_fouling": (-0.3,)}
    values = {
        "ocean_current": {"speed_mps": 0.12, "direction_deg": 17.0},
        "hull_fouling": {"resistance_factor": 0.7},
    }
    ship = apply_effects(model, {hidden: values[hidden]}, CATALOGUE)
    log = a_log(ship, SECONDS, tuple(range(BLOCK_S, SECONDS, BLOCK_S)), (), weaving(SECONDS), START, wind_mps=0.0)
    noise = np.random.default_rng(5).normal(1.0, 0.01, (len(log), 1))
    read = model_water_speed(log, ModelWithEffects(ship, {}), np.arange(len(log))) * factor * noise
    both = ModelWithEffects(model, {name: CATALOGUE[name] for name in values})
    search = search_of(unseen_windows(replace(log, meters={"water_speed": read}), both), lambda names: True)
    (other,) = set(sizes) - {hidden}
    assert search._contradicts_meters({other: sizes[other]}, {hidden: sizes[hidden]})
    assert search._misfit_of_meters({hidden: sizes[hidden]}) < 5.0
    assert search.search().names == (hidden,)


def test_a_meter_within_its_usual_error_contradicts_nothing(model: Plant) -> None:
    """One factor throughout costs what its usual size makes likely, however long it is measured."""
    log = a_log(model, SECONDS, (), (), weaving(SECONDS), START, wind_mps=0.0)
    rows = np.arange(600).reshape(40, 15)
    read = model_thrust(log, ModelWithEffects(model, {}), np.arange(len(log))) * (
        1.0 + METERS["thrust"].factor_error
    )
    (witness,) = witnesses_of(replace(log, meters={"thrust": read}), ModelWithEffects(model, {}), rows)
    assert witness.form([witness.error({})])[0, 0] == pytest.approx(1.0, abs=0.1)


def test_thrust_on_the_shaft_drives_the_ship_less_the_deduction(model: Plant) -> None:
    """Straight ahead the force of the propeller is (1 - t) T; a pod has no shaft whose thrust a meter reads."""
    thrust = shaft_thrusts(model, [[1.1, 0.0, 0.0]], [[10.0, 0.0]])
    deduced = shaft_thrusts(model.replaced(propeller_thrust_loss=0.1), [[1.1, 0.0, 0.0]], [[10.0, 0.0]])
    assert thrust[0, 0] > 0.0
    assert deduced[0, 0] == pytest.approx(0.9 * thrust[0, 0])
    assert np.isnan(thrust[0, 1])
    pods = bare_plant(load_vessel("gunnerus_short"))
    assert np.isnan(shaft_thrusts(pods, [[4.0, 0.0, 0.0]], [[2.0, 0.0, 2.0, 0.0, 0.0]])).all()


def test_a_column_of_thrust_belongs_to_its_shaft() -> None:
    twin = (Actuator("port", "propeller"), Actuator("starboard", "propeller"), Actuator("rudder", "rudder"))
    names = ["port_shaft_thrust_n", "starboard_shaft_thrust_kn", "shaft_thrust_kn", "middle_shaft_thrust_kn"]
    assert thrust_columns(names, twin) == {0: (names[0], 1.0), 1: (names[1], 1e3)}
    assert thrust_columns(names[2:], twin[1:]) == {0: (names[2], 1e3)}
    assert thrust_columns(["shaft_power_kw", "thrust_n"], twin) == {}


def test_thrust_is_imported_and_averaged_by_the_second(tmp_path) -> None:
    """A column named Thrust with a unit becomes a channel; what is read within half a second of one is averaged."""
    times = np.arange(0.0, 60.0, 0.25)
    table = pd.DataFrame(
        {"time [s]": times, "heading [deg]": 10.0, "x north [m]": times, "y east [m]": 0.2 * times,
         "propeller [rpm]": 600.0, "rudder angle [deg]": 0.0, "Thrust [N]": 40.0 + times}
    )  # fmt: skip
    path = tmp_path / "run.csv"
    table.to_csv(path, index=False)
    proposal = propose_column_map(read_raw_table(path), {"start": "2026-05-17T12:00:00Z"}, "kvlcc2_7m")
    assert 'shaft_thrust_kn = { column = "Thrust [N]", unit = "N" }' in proposal.text
    index = pd.DatetimeIndex(pd.to_datetime(1_800_000_000 + times, unit="s", utc=True), name="time")
    recorded = pd.DataFrame({"shaft_thrust_kn": (40.0 + times) / 1e3}, index=index)
    recorded.attrs["actuators"] = VESSEL.actuators
    seconds = 1_800_000_000 + np.arange(59)
    read = mean_meters(recorded.assign(propeller_rpm=600.0, rudder_angle_deg=0.0), seconds)["thrust"]
    assert read[5:50, 0] == pytest.approx(40.0 + np.arange(5, 50) - 0.125)
