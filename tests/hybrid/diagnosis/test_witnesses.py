"""Meters aboard: thrust tells a propeller that pushes more from a hull that resists less, a speed log either from a
current, which tracks hardly do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from seatrial.acquisition.core.quantities import Floats
from seatrial.acquisition.core.ship import Actuator, control_names
from seatrial.acquisition.tables.import_table import propose_column_map
from seatrial.acquisition.tables.table_files import read_raw_table
from seatrial.hybrid.diagnosis.few_causes import search_of
from seatrial.hybrid.diagnosis.gap import unseen_windows
from seatrial.hybrid.diagnosis.linearise import ModelWithEffects
from seatrial.hybrid.diagnosis.log import Log, mean_meters, thrust_columns
from seatrial.hybrid.diagnosis.witnesses import METERS, witnesses_of
from seatrial.hybrid.effects import apply_effects, catalogue_of
from seatrial.hybrid.vessel.actuators.propeller import screw_power
from seatrial.hybrid.vessel.dynamics import shaft_loads
from seatrial.hybrid.vessel.files import load_vessel
from seatrial.hybrid.vessel.plant import Plant, bare_plant
from tests.conftest import nightly
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


def read_of(meter: str, log: Log, ship: Plant, factor: float, scatter: float) -> Floats:
    """What a meter reads aboard a ship, off by a factor, with noise."""
    true = METERS[meter].modelled_readings(log, ModelWithEffects(ship, {}), np.arange(len(log)))
    return true * factor * np.random.default_rng(3).normal(1.0, scatter, true.shape)


@pytest.mark.parametrize("hidden", [PUSHES_MORE, RESISTS_LESS], ids=["propeller", "hull"])
@pytest.mark.parametrize(
    ("meter", "factor"), [("thrust", 1.03), *nightly(("thrust", 1.0), ("shaft_power", 1.0)), ("total_power", 0.93)]
)
def test_a_meter_on_the_shaft_tells_the_propeller_from_the_hull(
    model: Plant, hidden: tuple[str, dict], meter: str, factor: float
) -> None:
    """Tracks at one shaft speed alone fit either; thrust or power leaves the one that is there, whatever the
    meter's factor within its usual error."""
    name, values = hidden
    (other,) = {PUSHES_MORE[0], RESISTS_LESS[0]} - {name}
    ship = apply_effects(model, {name: values}, CATALOGUE)
    blocks = tuple(range(BLOCK_S, SECONDS, BLOCK_S))
    log = a_log(ship, SECONDS, blocks, (), weaving(SECONDS), START, wind_mps=0.0)
    read = read_of(meter, log, ship, factor, 0.02)
    both = ModelWithEffects(model, {each: CATALOGUE[each] for each in (name, other)})
    search, by_tracks = (
        search_of(unseen_windows(each, both), lambda names: True)
        for each in (replace(log, meters={meter: read}), log)
    )
    right, wrong = search.fit_of((name,), {}), by_tracks.fit_of((other,), {})
    assert wrong.mean_m() < 0.5 * search.fit_of((), {}).mean_m()  # by the tracks alone it would do
    assert search._contradicts_meters(wrong.at, right.at)
    assert not search._contradicts_meters(right.at, {})
    assert search.search().names == (name,)


@pytest.mark.parametrize("hidden", ["ocean_current", "hull_fouling"])
@pytest.mark.parametrize(
    ("meter", "factor"), [("water_speed", 1.0), ("water_speed", 0.97), ("current", 1.0), ("current", 0.9)]
)
def test_a_meter_of_the_water_tells_the_current_from_the_resistance(
    model: Plant, hidden: str, meter: str, factor: float
) -> None:
    """A following current and a hull that resists less both make a ship faster over ground; a log of the speed
    through the water or a current meter, whatever its factor within its usual error, fits the one that is there
    only."""
    sizes = {"ocean_current": (0.115, 0.035), "hull_fouling": (-0.3,)}
    values = {
        "ocean_current": {"speed_mps": 0.12, "direction_deg": 17.0},
        "hull_fouling": {"resistance_factor": 0.7},
    }
    ship = apply_effects(model, {hidden: values[hidden]}, CATALOGUE)
    log = a_log(ship, SECONDS, tuple(range(BLOCK_S, SECONDS, BLOCK_S)), (), weaving(SECONDS), START, wind_mps=0.0)
    read = read_of(meter, log, ship, factor, 0.01)
    if meter == "current":  # no noise in proportion to water at rest
        read = read + np.random.default_rng(5).normal(0.0, 0.01, read.shape)
    both = ModelWithEffects(model, {name: CATALOGUE[name] for name in values})
    search = search_of(unseen_windows(replace(log, meters={meter: read}), both), lambda names: True)
    (other,) = set(sizes) - {hidden}
    assert search._contradicts_meters({other: sizes[other]}, {hidden: sizes[hidden]})
    (witness,) = search.witnesses
    assert (
        search._chi_squared_of_witnesses({hidden: sizes[hidden]}) < witness.standardised_error({}).size
    )  # no more than noise
    assert search.search().names == (hidden,)


def test_a_meter_within_its_usual_error_contradicts_nothing(model: Plant) -> None:
    """One factor throughout costs what its usual size makes likely, however long it is measured."""
    log = a_log(model, SECONDS, (), (), weaving(SECONDS), START, wind_mps=0.0)
    rows = np.arange(600).reshape(40, 15)
    read = read_of("thrust", log, model, 1.0 + METERS["thrust"].factor_error, 0.0)
    (witness,) = witnesses_of(replace(log, meters={"thrust": read}), ModelWithEffects(model, {}), rows)
    assert witness.inner_products([witness.standardised_error({})])[0, 0] == pytest.approx(1.0, abs=0.1)


def test_thrust_on_the_shaft_drives_the_ship_less_the_deduction(model: Plant) -> None:
    """Straight ahead the force of the propeller is (1 - t) T; a pod has no shaft whose thrust a meter reads, but
    power, as its tunnel thruster has not."""
    (thrust, power), (rudder, _) = shaft_loads(model, [[1.1, 0.0, 0.0]], [[10.0, 0.0]])[0]
    lost = model.replaced(propeller_thrust_loss=0.1)
    (deduced, less), _ = shaft_loads(lost, [[1.1, 0.0, 0.0]], [[10.0, 0.0]])[0]
    assert thrust > 0.0
    assert deduced == pytest.approx(0.9 * thrust)
    assert np.isnan(rudder)
    assert 0.8 * power < less < 0.95 * power
    pods = bare_plant(load_vessel("gunnerus_short"))
    loads = shaft_loads(pods, [[4.0, 0.0, 0.0]], [[2.0, 0.0, 2.0, 0.0, 0.0]])[0]
    assert np.isnan(loads[:, 0]).all()
    assert np.isnan(loads[2]).all()
    assert loads[0, 1] == pytest.approx(loads[1, 1])
    assert loads[0, 1] > 0.0
    astern = shaft_loads(pods, [[4.0, 0.0, 0.0]], [[-2.0, 0.0, 2.0, 0.0, 0.0]])[0, :, 1]
    assert np.isnan(astern[0])


@pytest.mark.parametrize(
    ("J", "K_T", "K_Q"),
    [
        (0.833, 0.146, 0.0280),  # DTMB 4119, design point
        (0.8, 0.5100, 0.1178),  # Potsdam VP1304, SVA report 3752
        (1.2, 0.2949, 0.0776),
        (1.4, 0.1878, 0.0559),
    ],
)
def test_the_power_of_a_screw_is_that_of_screws_in_open_water(J: float, K_T: float, K_Q: float) -> None:
    """Two screws of other series, the second of more pitch than any that the losses were fitted to."""
    density, D, n = 1000.0, 0.25, 15.0
    power = screw_power(density, D, n, K_T * density * n**2 * D**4, J * n * D)
    measured = 2.0 * np.pi * K_Q * density * n**3 * D**5
    assert power == pytest.approx(measured, rel=METERS["shaft_power"].factor_error)


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


def test_power_and_current_are_meters_in_watts_and_to_the_north() -> None:
    """Torque times the shaft's speed is its power; a power without a shaft's name is all shafts' together; currents
    are averaged by their components, as a set through north shows."""
    times = np.arange(0.0, 30.0, 0.25)
    index = pd.DatetimeIndex(pd.to_datetime(1_800_000_000 + times, unit="s", utc=True), name="time")
    seconds = 1_800_000_000 + np.arange(29)
    torque = pd.DataFrame({"shaft_torque_knm": 2.0, "propeller_rpm": 60.0, "rudder_angle_deg": 0.0}, index=index)
    torque.attrs["actuators"] = VESSEL.actuators
    assert mean_meters(torque, seconds)["shaft_power"][5, 0] == pytest.approx(2e3 * 2.0 * np.pi)
    current = torque.assign(current_speed_mps=0.5, current_direction_deg=np.where(np.arange(120) % 2, 350.0, 10.0))
    assert mean_meters(current, seconds)["current"][5] == pytest.approx([0.5 * np.cos(np.deg2rad(10.0)), 0.0])
    pods = load_vessel("gunnerus_short").actuators
    controls = pd.DataFrame(0.0, index=index, columns=control_names(pods))
    controls.attrs["actuators"] = pods
    shared = controls.assign(shaft_power_kw=300.0)
    apart = controls.assign(port_shaft_power_kw=100.0, starboard_shaft_power_kw=200.0)
    assert mean_meters(shared, seconds)["total_power"][5] == pytest.approx([3e5])
    assert mean_meters(apart, seconds)["shaft_power"][5] == pytest.approx([1e5, 2e5, np.nan], nan_ok=True)
