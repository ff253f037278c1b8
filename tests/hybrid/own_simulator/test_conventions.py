"""What a simulator counts in other units, sides and zeros: the same physics; what contradicts itself is said."""

from __future__ import annotations

import logging
import zipfile
from itertools import product
from pathlib import Path

import numpy as np
import pytest

import seatrial as st
from seatrial.acquisition.core.errors import SourceError
from seatrial.acquisition.core.quantities import Floats
from seatrial.acquisition.core.ship import Actuator
from seatrial.hybrid.vessel.dynamics import simulate_batch
from seatrial.hybrid.vessel.signals import contradictions
from seatrial.hybrid.vessel.simulator_map import (
    MappedActuator,
    ShipEntry,
    SignalEntry,
    SimulatorMap,
    signals_of_map,
)

SHIP = ShipEntry("Ship", 30.0)


def bearing_of(angle_deg: float, convention: str, zero: str, positive: str) -> float:
    """Where a wind comes from, clockwise from north [rad], by the rules of compass and mathematics."""
    angle_deg = -angle_deg if positive == "port" else angle_deg
    angle_deg += 90.0 if zero == "east" else 0.0
    return float(np.radians(angle_deg + (180.0 if convention == "to" else 0.0)))


@pytest.mark.parametrize(
    ("convention", "zero", "positive"), list(product(("from", "to"), ("north", "east"), ("starboard", "port")))
)
def test_air_moves_alike_by_every_convention(convention: str, zero: str, positive: str) -> None:
    """What a simulator is told, read by its own convention, is the wind that was meant."""
    entry = SignalEntry("deg", convention=convention, zero=zero, positive=positive)  # type: ignore[arg-type]
    mapped = SimulatorMap(SHIP, wind={"direction": entry, "speed": SignalEntry("knots")})
    signals = signals_of_map(mapped, (Actuator("rudder", "rudder"),), Path("ship.toml"), complete=False)
    wind, states = np.array([[3.8, 9.0], [-0.4, 2.0]]), np.zeros((2, 6))
    told = signals.wind.to_theirs(wind, states)
    meant = [bearing_of(angle, convention, zero, positive) for angle in told[:, 0]]
    np.testing.assert_allclose(np.exp(1j * np.array(meant)), np.exp(1j * wind[:, 0]), atol=1e-12)
    np.testing.assert_allclose(told[:, 1] * 1852.0 / 3600.0, wind[:, 1])


def test_wind_felt_aboard_is_that_of_air_and_ship(tmp_path: Path) -> None:
    """Dead into a wind of 5 m/s at 3 m/s 8 m/s come from ahead; in still air of one's own way; as components the
    air moves away from where the wind comes from."""
    states = np.array([[0.0, 0.0, np.pi / 2.0, 3.0, 0.0, 0.0]] * 2)
    wind = np.array([[np.pi / 2.0, 5.0], [1.0, 0.0]])
    told = {}
    for frame in ("apparent", "relative"):
        entry = SignalEntry("deg", frame=frame)  # type: ignore[arg-type]
        mapped = SimulatorMap(SHIP, wind={"direction": entry, "speed": SignalEntry("m/s")})
        signals = signals_of_map(mapped, (Actuator("rudder", "rudder"),), tmp_path / "no.toml", complete=False)
        told[frame] = signals.wind.to_theirs(wind, states)
    np.testing.assert_allclose(told["apparent"], [[0.0, 8.0], [0.0, 3.0]], atol=1e-12)
    np.testing.assert_allclose(told["relative"][0], [0.0, 5.0], atol=1e-12)
    mapped = SimulatorMap(SHIP, wind={"north": SignalEntry("m/s"), "east": SignalEntry("m/s")})
    signals = signals_of_map(mapped, (Actuator("rudder", "rudder"),), tmp_path / "no.toml", complete=False)
    np.testing.assert_allclose(signals.wind.to_theirs(wind, states)[0], [0.0, -5.0], atol=1e-12)


def test_share_of_a_shaft_speed_is_a_unit(tmp_path: Path) -> None:
    """``300 rpm`` is a signal of which 1 is 300 rpm: 2.5 rev/s are a half of it."""
    mapped = SimulatorMap(SHIP, (MappedActuator("propeller", "propeller"),),
                          control={"propeller_rpm": SignalEntry("300 rpm")})  # fmt: skip
    signals = signals_of_map(mapped, mapped.actuators, tmp_path / "no.toml", complete=False)
    np.testing.assert_allclose(signals.control.to_theirs(np.array([[2.5]])), [[0.5]])


@pytest.fixture
def turning() -> Floats:
    """Exact states of ships that turn and slip, a second apart: constant speeds along an arc."""
    surge, sway, rate = 4.0, -0.5, np.array([[0.03], [-0.05]])
    heading = 1.0 + rate * np.arange(20.0)
    along, across = (np.sin(heading) - np.sin(1.0)) / rate, (np.cos(heading) - np.cos(1.0)) / rate
    north, east = surge * along + sway * across, sway * along - surge * across
    return np.stack(np.broadcast_arrays(north, east, heading, surge, sway, rate), axis=-1)


@pytest.mark.parametrize(
    ("column", "factor", "words"),
    [
        (3, 1.0, ""), (5, -1.0, "heading turns by -1 times what its yaw rate says"),
        (4, -1.0, "what its sway says"),
        (5, 180.0 / np.pi, "heading turns by 0.017 times"), (3, 3600.0 / 1852.0, "position moves by 0.51 times"),
        (2, -1.0, "what its surge says"),
    ],
)  # fmt: skip
def test_speeds_that_poses_contradict_are_named(turning: Floats, column: int, factor: float, words: str) -> None:
    """A side or a unit mistaken shows in the simulator's own motion, whatever the trial; a sound one is silent."""
    turning[..., column] *= factor
    sentences = contradictions(turning, 1.0)
    assert bool(sentences) == bool(words)
    assert words in "; ".join(sentences)


def test_chance_in_a_simulator_is_said(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """One that gives another result for the same run: once, when it is first asked for many."""
    (tmp_path / "ship.py").write_text(
        "import random\n\n\nclass Ship:\n    length_m = 30.0\n    actuators = {'propeller': 'propeller'}\n\n"
        "    def step(self, state, controls, wind, dt_s):\n"
        "        north, east, heading, surge, sway, rate = state\n"
        "        return [north + dt_s * surge + random.gauss(0.0, SIZE), east, 0.0, surge, 0.0, 0.0]\n"
    )
    runs = np.tile([0.0, 0.0, 0.0, 2.0, 0.0, 0.0], (8, 1)), np.ones((8, 6, 1)), np.zeros((8, 6, 2))
    text = (tmp_path / "ship.py").read_text()
    for size, warned in (("0.0", 0), ("0.01", 1)):
        (tmp_path / "ship.py").write_text(text.replace("SIZE", size))
        with caplog.at_level(logging.WARNING, "seatrial.own"):
            for _ in range(2):
                simulate_batch(st.load_simulator(f"{tmp_path}/ship.py:Ship"), *runs, 1.0)
        assert caplog.text.count("another result when it is done again") == warned


SLIDING = """
class Sound:
    length_m = 30.0
    actuators = {"propeller": "propeller"}

    def step(self, state, controls, wind, dt_s):
        north, *others = state
        return [north + dt_s * others[2], *others]


class OtherStep(Sound):
    def step(self, state, controls, wind, dt_s):
        return super().step(state, controls, wind, 0.1)


class OtherOrder(Sound):
    def step(self, state, controls, wind, dt_s):
        return [*state[3:], *state[:3]]


class Failing(Sound):
    def step(self, state, controls, wind, dt_s):
        raise ValueError(f"no table at {state[0]}")
"""


def test_each_class_of_a_file_is_examined(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """A step that is ignored, a state in another order; failures that differ in their numbers are one line."""
    (tmp_path / "sliding.py").write_text(SLIDING)
    start = np.zeros((8, 6))
    start[:, 0], start[:, 3] = np.arange(8.0) * 1.7, 2.0
    said = {}
    for name in ("Sound", "OtherStep", "OtherOrder"):
        caplog.clear()
        simulate_batch(st.load_simulator(f"{tmp_path}/sliding.py:{name}"), start, np.ones((8, 6, 1)),
                       np.zeros((8, 6, 2)), 1.0)  # fmt: skip
        said[name] = caplog.text
    assert not said["Sound"]
    assert "its position moves by 0.1 times what its surge says" in said["OtherStep"]
    assert "what its surge says" in said["OtherOrder"]
    caplog.clear()
    with pytest.raises(SourceError, match="no table at"):
        simulate_batch(st.load_simulator(f"{tmp_path}/sliding.py:Failing"), start, np.ones((8, 6, 1)),
                       np.zeros((8, 6, 2)), 1.0)  # fmt: skip
    assert caplog.text.count("left out") == 1


SPARE = ("north_m", "east_m", "heading", "surge", "sway", "rot")


def described(folder: Path, descriptions: dict[str, str], inputs: tuple[str, ...]) -> Path:
    """An FMU of which there is only the description, with what it says of some variables."""
    units = dict(zip(SPARE, ("m", "m", "deg", "m/s", "m/s", "deg/s"), strict=True))
    lines = [
        f'<ScalarVariable name="{name}" valueReference="{number}" variability="continuous" '
        f'causality="{"output" if name in units else "input"}" description="{descriptions.get(name, "")}"><Real'
        + (f' unit="{units[name]}"' if name in units else ' start="0"') + "/></ScalarVariable>"
        for number, name in enumerate((*SPARE, *inputs))
    ]  # fmt: skip
    with zipfile.ZipFile(folder / "ship.fmu", "w") as archive:
        archive.writestr(
            "modelDescription.xml",
            '<?xml version="1.0"?><fmiModelDescription fmiVersion="2.0" modelName="Ship" guid="ship">'
            '<CoSimulation modelIdentifier="ship"/><UnitDefinitions>'
            + "".join(f'<Unit name="{unit}"/>' for unit in set(units.values()))
            + f"</UnitDefinitions><ModelVariables>{''.join(lines)}</ModelVariables><ModelStructure/>"
            "</fmiModelDescription>",
        )
    return folder / "ship.fmu"


def test_sides_that_descriptions_state_go_before_the_axes(tmp_path: Path) -> None:
    """A compass counted backwards, sway to port: read, not asked, and an answer has the last word."""
    pytest.importorskip("fmpy", reason="FMPy, which reads FMUs, is not installed")
    says = {"heading": "Heading counter-clockwise from north", "sway": "Speed, positive to port",
            "rot": "Rate of turn, clockwise"}  # fmt: skip
    file = described(tmp_path, says, ("shaft",))
    answers = {"ship.length_m": "30", "axes": "ned", "control.propeller_rpm.unit": "300 rpm"}
    text = st.vessel_map(file, answer=answers).text
    assert 'heading = { variable = "heading", unit = "deg", positive = "port" }' in text
    assert 'sway = { variable = "sway", unit = "m/s", positive = "port" }' in text
    assert 'yaw_rate = { variable = "rot", unit = "deg/s" }' in text
    assert 'propeller_rpm = { variable = "shaft", unit = "300 rpm" }' in text
    text = st.vessel_map(file, answer={**answers, "state.sway.positive": "starboard"}).text
    assert 'sway = { variable = "sway", unit = "m/s" }' in text


def test_wind_of_any_name_can_be_answered(tmp_path: Path) -> None:
    """Inputs that nothing calls a wind are asked, and mapped as one."""
    pytest.importorskip("fmpy", reason="FMPy, which reads FMUs, is not installed")
    file = described(tmp_path, {}, ("shaft", "V_w", "beta_w"))
    answers = {"ship.length_m": "30", "axes": "ned", "control.propeller_rpm.unit": "rps"}
    asked = {question.key for question in st.vessel_map(file, answer=answers).questions}
    assert asked == {"input.V_w", "input.beta_w"}
    wind = {"direction": "beta_w", "speed": "V_w", "direction.unit": "deg", "speed.unit": "kn",
            "direction.convention": "to", "direction.zero": "north", "direction.positive": "starboard",
            "direction.frame": "true"}  # fmt: skip
    proposal = st.vessel_map(file, answer=answers | {f"wind.{key}": value for key, value in wind.items()})
    assert not proposal.questions
    assert 'direction = { variable = "beta_w", unit = "deg", convention = "to"' in proposal.text
    assert 'speed = { variable = "V_w", unit = "kn" }' in proposal.text
