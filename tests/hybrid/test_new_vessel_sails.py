"""How a ship sails whose file was estimated from main dimensions: speed, turning circle, stability of the hull."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from seatrial.acquisition.core.quantities import Floats
from seatrial.hybrid.effects import vessel_plant
from seatrial.hybrid.vessel.actuators import control_units
from seatrial.hybrid.vessel.dynamics import simulate
from seatrial.hybrid.vessel.estimate.new_vessel import NewVessel, new_vessel
from seatrial.hybrid.vessel.files import Vessel, load_vessel, save_vessel
from seatrial.hybrid.vessel.plant import Plant
from tests.hybrid.test_new_vessel import CATAMARAN, FOUR, KVLCC2, SHIPS, TUNNELS, TWIN

STEPS_A_LENGTH = 40


class Sailing:
    """An estimated ship and the settings that drive her at service speed."""

    def __init__(self, said: dict[str, Any], folder: Path) -> None:
        file = folder / "ship.toml"
        self.made: NewVessel = new_vessel(file, **said)
        self.vessel: Vessel = load_vessel(file)
        self.plant: Plant = vessel_plant(self.vessel)
        self.speed, self.length = said["service_speed_mps"], said["length_m"]
        self.step_s = self.length / self.speed / STEPS_A_LENGTH

    def control(self, helm_deg: float = 0.0) -> Floats:
        """All shafts at service speed, rudders at an angle; azimuths astern the other way, those ahead alike."""
        said = [
            self.made.service_rpm.get(actuator.name, 0.0) if channel.unit == "rpm" else self._helm(index) * helm_deg
            for index, actuator in enumerate(self.vessel.actuators)
            for channel in actuator.channels
        ]
        return np.array(said) * control_units(self.vessel.actuators)

    def _helm(self, index: int) -> float:
        entry = self.vessel.actuator[index]
        if entry.kind == "rudder":
            return 1.0
        return 1.0 if entry.x_m > 0.0 else -1.0

    def sail(self, lengths: float, helm_deg: float = 0.0, yaw_rate: float = 0.0) -> Floats:
        """The states over the time of so many lengths at service speed, from service speed."""
        n = int(lengths * STEPS_A_LENGTH)
        start = [0.0, 0.0, 0.0, self.speed, 0.0, yaw_rate]
        controls = np.tile(self.control(helm_deg), (n, 1))
        return simulate(self.plant, start, controls, np.zeros((n, 2)), self.step_s)


@pytest.fixture(scope="module", params=SHIPS)
def ship(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Sailing:
    return Sailing(SHIPS[request.param], tmp_path_factory.mktemp(request.param))


def test_the_file_is_a_vessel_and_keeps_its_errors_when_saved(ship: Sailing, tmp_path: Path) -> None:
    assert dict(ship.vessel.estimated) == tomllib.loads(ship.made.text)["estimated"]
    save_vessel(ship.vessel, tmp_path / "again.toml")
    assert load_vessel(tmp_path / "again.toml").estimated == ship.vessel.estimated


def test_the_shafts_said_drive_her_at_service_speed(ship: Sailing) -> None:
    end = ship.sail(60.0)[-1]
    assert end[3] == pytest.approx(ship.speed, rel=0.05)
    assert abs(end[4]) + abs(end[5]) < 1e-6


@pytest.mark.parametrize("said", [KVLCC2, TWIN, TUNNELS, FOUR], ids=lambda said: str(said["name"]))
def test_she_turns_like_a_ship(said: dict[str, Any], tmp_path: Path) -> None:
    """Advance and tactical diameter as IMO's standard bounds them from above, and no smaller than two lengths."""
    ship = Sailing(said, tmp_path)
    track = ship.sail(25.0, helm_deg=20.0 if said is FOUR else 35.0)
    quarter, half = (np.argmax(track[:, 2] > turn) for turn in (0.5 * np.pi, np.pi))
    assert 2.0 < track[quarter, 0] / ship.length < 4.5
    assert 2.0 < track[half, 1] / ship.length < 5.0
    assert np.hypot(*track[-1, 3:5]) < 0.8 * ship.speed


def test_a_catamaran_turns_by_the_difference_of_its_propellers(tmp_path: Path) -> None:
    """The faster propeller on the port side turns it to starboard, and that on the other the same way to port."""
    ship = Sailing(CATAMARAN, tmp_path)
    n = 8 * STEPS_A_LENGTH
    turns = []
    for difference in (0.2, -0.2):
        controls = np.tile(ship.control() * [1.0 + difference, 1.0 - difference], (n, 1))
        track = simulate(ship.plant, [0.0, 0.0, 0.0, ship.speed, 0.0, 0.0], controls, np.zeros((n, 2)), ship.step_s)
        turns.append(track[-1, 2])
    assert turns[0] > 0.5
    assert turns[1] == pytest.approx(-turns[0])


def test_every_option_of_a_device_makes_a_vessel(tmp_path: Path) -> None:
    """Controllable pitch, a rudder in no race, a pod beside a propeller; each is what its table says."""
    said = TWIN | {
        "propellers": ["main, diameter=4, blades=5, area_ratio=0.6, rpm=150, x=-55, y=1, controllable=yes"],
        "azimuths": ["pod, diameter=2.5, pitch_ratio=1, rate=15"],
        "rudders": ["aft, area=12, span=4.5, limit=45, rate=3", "spade, behind="],
    }
    ship = Sailing(said, tmp_path)
    kinds = {each.name: each.kind for each in ship.vessel.actuators}
    assert kinds == {"main": "controllable_propeller", "pod": "azimuth", "aft": "rudder", "spade": "rudder"}
    main, pod, aft, spade = ship.vessel.actuator
    assert (main.x_m, main.y_m, pod.azimuth_rate_limit_dps) == (-55.0, 1.0, 15.0)
    assert (aft.area_m2, aft.span_m, aft.limit_deg, aft.rate_limit_dps) == (12.0, 4.5, 45.0, 3.0)
    assert spade.behind == ""


def test_port_is_the_mirror_image_of_starboard(ship: Sailing) -> None:
    starboard, port = ship.sail(8.0, helm_deg=20.0), ship.sail(8.0, helm_deg=-20.0)
    np.testing.assert_allclose(port * [1, -1, -1, 1, -1, -1], starboard, atol=1e-6 * ship.length)


def test_a_bare_hull_leaves_its_course_where_the_derivatives_say_so(tmp_path: Path) -> None:
    """A full tanker does, a slender ship with her weight forward does not: a small turn grows, or dies away."""
    slender = TWIN | {"length_m": 150.0, "beam_m": 18.0, "draught_m": 7.5, "block": 0.5, "centre_of_gravity_m": 4.0}
    for said, stable in ((KVLCC2, False), (slender, True)):
        bare = Sailing(said | {"rudders": []}, tmp_path)
        assert bare.made.course_stable is stable
        turn = 1e-3 * bare.speed / bare.length
        rate = abs(bare.sail(12.0, yaw_rate=turn)[:, 5])
        assert (rate[-1] > rate[len(rate) // 2]) is np.bool_(not stable)
