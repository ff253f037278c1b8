"""Every kind of ship makes every manoeuvre, turns to the side of the helm, and settles on a course."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.hybrid.diagnosis.map import cell_quantities
from seatrial.hybrid.diagnosis.planning import candidates_of_ship, rehearse, shafts_of
from seatrial.hybrid.effects import vessel_plant
from seatrial.hybrid.simulation.manoeuvres import (
    MANOEUVRES,
    Leg,
    handling_of,
    helm_leg,
    legs_as_arrays,
    pace_of,
    scale_times,
    scale_to_ship,
    steer,
    usual_rpm,
)
from seatrial.hybrid.simulation.trial import SimulationNoise, Voyage, sail_through, sea_state_named, simulate_trial
from seatrial.hybrid.simulation.vessel_check import check_vessel
from seatrial.hybrid.vessel.actuators.controllable_propeller import ControllablePropellerEntry
from seatrial.hybrid.vessel.actuators.waterjet import WaterjetEntry
from seatrial.hybrid.vessel.estimate.new_vessel import new_vessel
from seatrial.hybrid.vessel.files import Vessel, load_vessel
from tests.conftest import nightly

CALM = sea_state_named("calm")


def estimated(folder, **said) -> Vessel:  # type: ignore[no-untyped-def]
    file = folder / f"{said['name']}.toml"
    new_vessel(file, **said)
    return load_vessel(file)


def tanker(folder) -> Vessel:  # type: ignore[no-untyped-def]
    return estimated(
        folder, name="tanker", length_m=320.0, beam_m=58.0, draught_m=20.8, block=0.81, service_speed_mps=7.97,
        propellers=["diameter=9.86"], rudders=["area=112.5, span=15.8"], tunnels=["bow, diameter=3, power=2000"],
    )  # fmt: skip


def twin_screw(folder) -> Vessel:  # type: ignore[no-untyped-def]
    return estimated(
        folder, name="twin", length_m=120.0, beam_m=20.0, draught_m=6.0, block=0.6, service_speed_mps=9.0,
        propellers=["diameter=4"] * 2, rudders=[""] * 2,
    )  # fmt: skip


def four_azimuths(folder) -> Vessel:  # type: ignore[no-untyped-def]
    """Two of them ahead."""
    ship = estimated(
        folder, name="four", length_m=60.0, beam_m=14.0, draught_m=4.0, block=0.55, service_speed_mps=6.0,
        azimuths=["diameter=2"] * 4, hull="cross_flow",
    )  # fmt: skip
    ahead = [replace(each, x_m=abs(each.x_m)) for each in ship.actuator[:2]]  # type: ignore[type-var]
    return replace(ship, actuator=(*ahead, *ship.actuator[2:]))


def with_pitch(folder) -> Vessel:  # type: ignore[no-untyped-def]
    """KVLCC2's model with a propeller of controllable pitch."""
    ship = load_vessel("kvlcc2_7m")
    screw, rudder = ship.actuator
    own = {name: getattr(screw, name) for name in screw.__dataclass_fields__ if name != "kind"}  # type: ignore[attr-defined]
    blades = ControllablePropellerEntry(**own, kind="controllable_propeller", pitch_lag_s=0.5)
    return replace(ship, name="with_pitch", actuator=(blades, rudder))


def two_jets(folder) -> Vessel:  # type: ignore[no-untyped-def]
    """The Otter's hull with a waterjet to either side, whose nozzles steer."""
    jet = WaterjetEntry(
        name="port_jet", kind="waterjet", x_m=-1.0, y_m=-0.395, thrust_nn=0.45, thrust_nu=0.5, limit_rpm=1000.0,
        limit_deg=30.0, rate_limit_dps=60.0, shaft_lag_s=0.2, nozzle_lag_s=0.1,
    )  # fmt: skip
    both = (jet, replace(jet, name="starboard_jet", y_m=0.395))
    return replace(load_vessel("otter_2m"), name="two_jets", actuator=both)


SHIPS: dict[str, Callable[..., Vessel]] = {
    "gunnerus": lambda folder: load_vessel("gunnerus_short"),
    "kvlcc2": lambda folder: load_vessel("kvlcc2_7m"),
    "esso_osaka": lambda folder: load_vessel("esso_osaka_3m"),
    "otter": lambda folder: load_vessel("otter_2m"),
    "tanker": tanker,
    "twin_screw": twin_screw,
    "four_azimuths": four_azimuths,
    "with_pitch": with_pitch,
    "two_jets": two_jets,
}


BY_DAY = ("tanker", "with_pitch", "four_azimuths", "two_jets")
some_ships = pytest.mark.parametrize(
    "ship", [*BY_DAY, *nightly(*(name for name in SHIPS if name not in BY_DAY))], indirect=True
)
"""For what takes long: the others sail by night."""


@pytest.fixture(scope="module", params=SHIPS)
def ship(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Vessel:
    return SHIPS[request.param](tmp_path_factory.mktemp("ships"))


def sailed(vessel: Vessel, *legs: Leg, seconds: float) -> Voyage:
    """A manoeuvre in R/V Gunnerus' time, in still water and air; a row a tenth of a second of that."""
    time, still = pace_of(vessel).time, np.random.default_rng(0)
    return sail_through(
        vessel,
        vessel_plant(vessel),
        CALM,
        scale_times(legs, time),
        round(10 * seconds),
        0.1 * time,
        0.0,
        still,
        still,
    )


@some_ships
def test_every_manoeuvre_is_made(ship: Vessel) -> None:
    """She is under way, and her shafts are what drives her."""
    for name in MANOEUVRES:
        table, truth = simulate_trial(
            ship, "calm", name, 900.0 * pace_of(ship).time, 5.0, noise=SimulationNoise().scaled(0.0)
        )
        assert table.notna().all().all(), name
        assert truth["states"][:, 3].max() > 0.2 * pace_of(ship).speed * 5.04, name
        main = [column for column, drives in zip(range(100), handling_of(ship).main, strict=False) if drives]
        assert np.abs(truth["controls"][:, main]).max() > 0.0, name


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_she_turns_to_the_side_of_the_helm(ship: Vessel, side: float) -> None:
    """A positive helm to port, whatever has to move for it."""
    states = sailed(ship, helm_leg(side * 15.0, usual_rpm(ship)), seconds=60.0).states
    assert -side * np.rad2deg(states[-1, 2]) > 30.0


@pytest.mark.parametrize("share", [1.0, 0.5])
def test_she_settles_on_a_course_without_hunting(ship: Vessel, share: float) -> None:
    """At the usual shaft speed and at half of it: after a change of 30 deg neither heading nor helm moves."""
    rpm = share * usual_rpm(ship)
    voyage = sailed(ship, steer(0.0, 60.0, rpm), steer(30.0, 1e4, rpm), seconds=900.0)
    heading = np.rad2deg(voyage.states[:, 2])
    assert heading.max() < 42.0
    assert heading[-1000:] == pytest.approx(np.full(1000, 30.0), abs=0.2)
    assert np.ptp(voyage.controls[-1000:, handling_of(ship).helm != 0.0], axis=0).max() < np.deg2rad(0.3)


def test_a_shaft_of_controllable_pitch_never_reverses(tmp_path) -> None:  # type: ignore[no-untyped-def]
    orders, _ = legs_as_arrays((Leg(rpm=400.0), Leg(rpm=-300.0)), with_pitch(tmp_path))
    assert orders[:, :2] == pytest.approx(np.array([[400.0 / 60.0, 1.0], [300.0 / 60.0, -1.0]]))


def test_a_sea_that_would_throw_her_about_is_refused() -> None:
    """Named seas are scaled for a model; a given one is as it is, here waves of 2 m for a boat of 2 m."""
    with pytest.raises(ConfigurationError, match="too rough for a ship of 2 m"):
        simulate_trial(load_vessel("otter_2m"), sea_state_named("moderate"), "zigzag", 60.0)


def test_a_ship_of_one_propeller_and_nothing_else_cannot_be_steered() -> None:
    vessel = load_vessel("kvlcc2_7m")
    alone = replace(vessel, name="log", actuator=vessel.actuator[:1])
    with pytest.raises(ConfigurationError, match="log cannot be steered: it has propeller"):
        simulate_trial(alone, "calm", "zigzag", 60.0)


@some_ships
def test_the_check_is_whole_and_symmetric_ships_turn_alike(ship: Vessel) -> None:
    check = check_vessel(ship)
    assert not check.left_out
    starboard, port = check.of_kind("turning_circle")
    assert starboard.indices["transfer_m"].value > 0.0 < port.indices["transfer_m"].value
    for test in check.of_kind("zigzag"):
        assert test.indices["overshoot_1_from_order_deg"].value > 0.0
    assert check.of_kind("stopping")[0].indices["track_reach_m"].lengths < 15.0  # type: ignore[operator]
    judged = {result.result for result in check.criteria if result.mean}
    assert (judged != {"not_shown"}) == (ship.name in ("tanker", "twin"))


def test_kvlcc2_turns_as_published() -> None:
    """About 3.1 to 3.3 L with 35 deg, from the order (Yasukawa and Yoshimura 2015)."""
    circle = check_vessel(load_vessel("kvlcc2_7m")).of_kind("turning_circle")[0]
    advance, diameter = (circle.indices[name].value for name in ("advance_m", "tactical_diameter_m"))
    assert advance / 7.0 == pytest.approx(3.2, rel=0.08)
    assert diameter / 7.0 == pytest.approx(3.2, rel=0.08)


@pytest.mark.parametrize("name", ["kvlcc2", "otter", "twin_screw"])
def test_a_rehearsal_stays_in_her_range_and_its_map_names_her_settings(name: str, tmp_path) -> None:  # type: ignore[no-untyped-def]
    ship = SHIPS[name](tmp_path)
    plant = vessel_plant(ship)
    for candidate in candidates_of_ship(shafts_of(ship, usual_rpm(ship))):
        log = rehearse(candidate.legs, ship, plant, CALM, round(60 * candidate.minutes))
        assert np.isfinite(log.measured).all(), candidate.name
        found = cell_quantities(log, log.nominal)
        assert "rpm" in found
        assert ("rudder_deg" in found) == (name != "otter")
        assert ("port_less_starboard_rpm" in found) == (name == "otter")


def test_a_named_manoeuvre_keeps_its_share_of_the_limit() -> None:
    """171 of 203 rpm is 632 of 750, and a tunnel thruster's 300 of 400 the same of its own."""
    (first, *_) = scale_to_ship((Leg(),), load_vessel("kvlcc2_7m"))
    assert first.rpm == pytest.approx(171.0 / 203.0 * 750.0)
