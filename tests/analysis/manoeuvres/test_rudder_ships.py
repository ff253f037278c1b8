"""Manoeuvres of ships with propellers and rudders, controllable pitch and waterjets, made by hand and real."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from seatrial.acquisition.core.errors import InputError
from seatrial.acquisition.core.ship import Actuator, actuators_as_text
from seatrial.acquisition.tables.import_table import read_table_file
from seatrial.analysis.manoeuvres.find import find_manoeuvres, find_manoeuvres_and_left_out
from seatrial.analysis.manoeuvres.indices import Manoeuvre
from seatrial.analysis.manoeuvres.motion import motion_of
from tests.analysis.rudder_ships import MODEL, TWIN, Orders, Ship, sail, turn, zigzag

COLUMNS = Path(__file__).parents[3] / "trials" / "columns" / "esso_osaka.toml"
SHIPS = {"single": Ship(), "twin": replace(Ship(), actuators=TWIN), "model": MODEL}
RPM = {"single": 120.0, "twin": 120.0, "model": 600.0}


def found_in(table: pd.DataFrame, kind: str, length_m: float | None = None) -> list[Manoeuvre]:
    return [each for each in find_manoeuvres(table, length_m) if each.kind == kind]


def truth(ship: Ship, orders: Orders, duration_s: float) -> pd.DataFrame:
    """The same without noise, the heading running on."""
    table = sail(replace(ship, noise=0.0), orders, duration_s)
    return table.assign(heading_deg=np.rad2deg(np.unwrap(np.deg2rad(table["heading_deg"]))))


@pytest.mark.parametrize("name", SHIPS)
@pytest.mark.parametrize(("angle", "first"), [(20.0, 1.0), (10.0, -1.0)])
def test_a_zigzag_by_rudder_has_the_overshoots_of_its_heading(name: str, angle: float, first: float) -> None:
    ship, orders = SHIPS[name], zigzag(angle, angle, RPM[name], first=first)
    duration_s = 130.0 if ship is MODEL else 420.0
    (found,) = found_in(sail(ship, orders, duration_s), "zigzag", 3.0 if ship is MODEL else 100.0)
    assert found.name == f"zigzag {angle:.0f}/{angle:.0f}"
    assert found.side == ("starboard" if first > 0 else "port")
    assert found.settings["rudder_deg"] == pytest.approx(angle, abs=0.3)
    exact = truth(ship, orders, duration_s)
    helm, heading = exact.filter(like="rudder").iloc[:, 0].to_numpy(), exact["heading_deg"].to_numpy()
    executes = [row for row in range(1, helm.size) if helm[row] * helm[row - 1] <= 0.0 and helm[row - 1]]
    for number, (row, end) in enumerate(pairwise(executes[:3]), start=1):
        overshoot = np.abs(heading[row:end]).max() - np.abs(heading[row])
        index = found.indices[f"overshoot_{number}_deg"]
        assert index.value == pytest.approx(overshoot, abs=0.2 + 0.06 * overshoot)
    both = [found.indices.get(f"overshoot_1{each}_deg") for each in ("", "_from_order")]
    assert sum(index is not None and index.limit is not None for index in both) == 1


@pytest.mark.parametrize("name", SHIPS)
@pytest.mark.parametrize("angle", [35.0, -35.0])
def test_a_turning_circle_by_rudder_has_the_sizes_of_its_track(name: str, angle: float) -> None:
    ship, orders = SHIPS[name], turn(angle, RPM[name])
    duration_s = 150.0 if ship is MODEL else 450.0
    (found,) = found_in(sail(ship, orders, duration_s), "turning_circle", 100.0)
    assert (found.name, found.side) == ("turning circle 35 deg", "starboard" if angle > 0 else "port")
    assert found.settings["rudder_deg"] == pytest.approx(angle, abs=0.3)
    assert found.helm_deg == found.settings["rudder_deg"]
    exact = truth(ship, orders, duration_s)
    north, east, heading = (np.abs(exact[each].to_numpy()) for each in ("north_m", "east_m", "heading_deg"))
    execute = 300  # the trial goes straight for 30 s
    at = np.interp([90.0, 180.0], heading[300:], np.arange(300.0, heading.size))
    rows = np.arange(heading.size)
    for name_of, size in {
        "advance_m": np.interp(at[0], rows, north) - north[execute],
        "transfer_m": np.interp(at[0], rows, east) - east[execute],
        "tactical_diameter_m": np.interp(at[1], rows, east) - east[execute],
    }.items():
        assert found.indices[name_of].value == pytest.approx(size, rel=0.02)
    assert found.indices["advance_m"].limit == 450.0


@pytest.mark.parametrize(
    ("orders", "kind"), [(turn(-35.0, 120.0), "turning_circle"), (zigzag(20.0, 20.0, 120.0), "zigzag")]
)
def test_going_astern_a_test_has_the_indices_of_its_course_and_no_limits(orders: Orders, kind: str) -> None:
    """A ship that answers the helm astern as ahead makes the same way, to the other end."""
    ship = Ship(sway_m=0.0)
    astern = sail(ship, lambda *state: (orders(*state)[0], -orders(*state)[1]), 450.0)
    (ahead,), (found,) = (found_in(table, kind, 100.0) for table in (sail(ship, orders, 450.0), astern))
    assert (found.name, found.side) == (f"{ahead.name} astern", ahead.side)
    for name, index in ahead.indices.items():
        other = found.indices[name]
        within = (index.high - index.low) + (other.high - other.low) + 0.01 * abs(index.value)
        assert other.value == pytest.approx(index.value, abs=within), name
    assert any(index.limit for index in ahead.indices.values())
    assert not any(index.limit for index in found.indices.values())


def test_rudders_that_count_against_each_other_are_the_reason_why_there_is_no_turn() -> None:
    table = sail(SHIPS["twin"], zigzag(20.0, 20.0, 120.0), 420.0)
    runs, left_out = find_manoeuvres_and_left_out(
        table.assign(port_rudder_angle_deg=-table["port_rudder_angle_deg"])
    )
    assert not any(run.kind == "zigzag" for run in runs)
    assert "port_rudder_angle_deg counts to the wrong side" in left_out[0].why
    both = table.assign(**{name: -table[name] for name in table if "rudder" in name})
    runs, left_out = find_manoeuvres_and_left_out(both)
    assert any(run.kind == "zigzag" for run in runs)
    assert not any("wrong side" in candidate.why for candidate in left_out)


def test_pitch_taken_off_a_shaft_that_runs_on_is_a_stop() -> None:
    """A controllable propeller turns all the time; what drives the ship is her pitch."""
    ship = replace(Ship(), actuators=(Actuator("main", "controllable_propeller"), Actuator("rudder", "rudder")))
    table = sail(ship, lambda time_s, _, __: (0.0, 120.0 if time_s < 150.0 else 0.0), 400.0)
    pitch = 100.0 * (table["main_rpm"] / 120.0)
    (stop,) = found_in(table.assign(main_rpm=120.0, main_pitch_percent=pitch), "stopping")
    assert stop.name == "stopping without thrust"
    assert (stop.start - table.index[0]).total_seconds() == pytest.approx(150.0, abs=1.0)
    assert stop.settings["thrust_before_rpm"] == pytest.approx(120.0, abs=1.0)
    assert stop.settings["main_at_full_pitch_rpm"] == pytest.approx(120.0, abs=1.0)


def test_one_of_two_propellers_alone_is_called_so() -> None:
    table = sail(SHIPS["twin"], lambda *_: (0.0, 120.0), 300.0)
    resting = np.arange(len(table)) >= 750
    names = {
        each.name
        for each in found_in(table.assign(starboard_rpm=table["starboard_rpm"] * ~resting), "thruster_test")
    }
    assert names == {"port propeller alone"}


def test_a_waterjet_turns_the_ship_to_the_other_side_of_its_jet() -> None:
    """A nozzle to starboard pushes the stern to starboard, and the bow to port."""
    jets = (Actuator("port_jet", "waterjet"), Actuator("starboard_jet", "waterjet"))
    table = sail(SHIPS["single"], turn(-30.0, 120.0), 400.0)
    for each in jets:
        table = table.assign(
            **{f"{each.name}_rpm": table["propeller_rpm"], f"{each.name}_angle_deg": -table["rudder_angle_deg"]}
        )
    table = table.drop(columns=["propeller_rpm", "rudder_angle_deg"])
    table.attrs["trial"] = {"actuators": actuators_as_text(jets)}
    (found,) = found_in(table, "turning_circle")
    assert (found.side, round(found.settings["nozzle_deg"])) == ("port", 30)


def test_a_ship_without_a_rudder_has_her_runs_and_one_without_a_drive_is_refused() -> None:
    table = sail(SHIPS["single"], lambda *_: (0.0, 120.0), 200.0).drop(columns="rudder_angle_deg")
    table.attrs["trial"] = {"actuators": "propeller:propeller"}
    assert [each.kind for each in find_manoeuvres(table)] == ["speed_run"]
    table.attrs["trial"] = {"actuators": "bow:tunnel"}
    with pytest.raises(InputError, match="nothing drives or steers"):
        motion_of(table)


def test_a_missing_shaft_does_not_hide_a_rudders_helm() -> None:
    table = sail(SHIPS["single"], turn(35.0, 120.0), 300.0).drop(columns="propeller_rpm")
    assert len(found_in(table, "turning_circle")) == 1


ESSO_OSAKA = {
    "turning/turn_14-Sep-2020_13_39_32": ("turning circle 35 deg", "starboard", 120.0, 8.21, 7.27),
    "turning/turn_14-Sep-2020_13_51_45": ("turning circle 35 deg", "starboard", 120.0, 8.39, 7.18),
    "turning/turn_14-Sep-2020_14_16_04": ("turning circle 35 deg", "port", 120.0, 6.65, 7.52),
    "turning/turn_14-Sep-2020_14_50_41": ("turning circle 35 deg", "starboard", 160.0, 8.14, 6.77),
    "zigzag/zigzag_31-Jul-2020_13_04_24": ("zigzag 20/20", "starboard", 44.2, 4.63, 8.66),
    "zigzag/zigzag_31-Jul-2020_13_14_21": ("zigzag 30/30", "starboard", 18.4, 7.40, 7.88),
    "zigzag/zigzag_31-Jul-2020_13_22_52": ("zigzag 15/15", "starboard", 36.1, 0.34, 13.24),
    "zigzag/zigzag_31-Jul-2020_13_29_19": ("zigzag 15/15", "starboard", 42.6, 4.22, 10.29),
}
"""When the rudder was put over [s], and advance and tactical diameter [m] or the first two overshoots [deg], read
off the published tables by hand: single samples, from the row of the first order."""


@pytest.mark.parametrize("trial", ESSO_OSAKA)
def test_the_circles_and_zigzags_of_esso_osaka_are_those_read_off_by_hand(shared_data: Path, trial: str) -> None:
    path = shared_data / "esso_osaka" / f"{trial}.csv.gz"
    if not path.is_file():
        pytest.skip(f"no {path}")
    file = read_table_file(path, COLUMNS)
    file.table.attrs["trial"] = file.trial.as_metadata()
    name, side, execute_s, one, other = ESSO_OSAKA[trial]
    (found,) = (each for each in find_manoeuvres(file.table, 3.0) if each.kind in ("zigzag", "turning_circle"))
    assert (found.name, found.side) == (name, side)
    assert (found.start - file.table.index[0]).total_seconds() == pytest.approx(execute_s, abs=0.25)
    if found.kind == "turning_circle":
        assert found.indices["advance_m"].value == pytest.approx(one, abs=0.12)
        assert found.indices["tactical_diameter_m"].value == pytest.approx(other, abs=0.02)
    else:
        assert found.indices["overshoot_1_deg"].value == pytest.approx(one, abs=0.8)
        assert found.indices["overshoot_2_deg"].value == pytest.approx(other, abs=0.8)
        assert "the ship was still gathering way at the execute" in found.notes
