"""A vessel file from what an owner knows: what it says, and how the ship that it states behaves."""

from __future__ import annotations

import tomllib
from math import isfinite
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, strategies
from typer.testing import CliRunner

import seatrial as st
from seatrial.acquisition.core.errors import InputError
from seatrial.hybrid.vessel.estimate.devices import Propeller, Rudder, Tunnel, parse_device
from seatrial.hybrid.vessel.estimate.new_vessel import NewVessel, new_vessel

KVLCC2: dict[str, Any] = {
    "name": "kvlcc2_estimated", "length_m": 7.0, "beam_m": 1.27, "draught_m": 0.46, "block": 0.81,
    "service_speed_mps": 1.179, "water_density_kgpm3": 1000.0,
    "propellers": ["diameter=0.216, pitch_ratio=0.721, area_ratio=0.431"],
    "rudders": ["area=0.0539, span=0.345"],
}  # fmt: skip
TWIN: dict[str, Any] = {
    "name": "twin", "length_m": 120.0, "beam_m": 20.0, "draught_m": 6.0, "block": 0.6, "service_speed_mps": 9.0,
    "propellers": ["diameter=4"] * 2, "rudders": [""] * 2,
}  # fmt: skip
TUNNELS: dict[str, Any] = {
    "name": "tunnels", "length_m": 150.0, "beam_m": 24.0, "draught_m": 9.0, "block": 0.72, "service_speed_mps": 7.7,
    "propellers": ["main, diameter=6, rpm=110"], "rudders": [Rudder()],
    "tunnels": ["bow, diameter=2, power=900", Tunnel(name="stern", force=8e4)],
}  # fmt: skip
FOUR: dict[str, Any] = {
    "name": "four", "length_m": 60.0, "beam_m": 14.0, "draught_m": 4.0, "block": 0.55, "service_speed_mps": 6.0,
    "azimuths": ["diameter=2"] * 4, "hull": "cross_flow",
}  # fmt: skip
CATAMARAN: dict[str, Any] = {
    "name": "catamaran", "length_m": 2.0, "beam_m": 1.08, "demihull_beam_m": 0.25, "draught_m": 0.134, "block": 0.4,
    "service_speed_mps": 2.0, "propellers": ["port, diameter=0.2", "starboard, diameter=0.2"],
}  # fmt: skip
SHIPS = {"kvlcc2": KVLCC2, "twin": TWIN, "tunnels": TUNNELS, "four": FOUR, "catamaran": CATAMARAN}


@pytest.fixture(params=SHIPS)
def ship(request: pytest.FixtureRequest) -> NewVessel:
    return new_vessel(**SHIPS[request.param])


def test_every_estimated_number_is_in_the_file_with_its_error_and_source(ship: NewVessel) -> None:
    tree = tomllib.loads(ship.text)
    tables = tree | {each["name"]: each for each in tree["actuator"]}
    assert len(tree["estimated"]) > 30
    for key, error in tree["estimated"].items():
        table, _, number = key.partition(".")
        assert error > 0.0
        assert isinstance(tables[table][number], float)
        line = next(line for line in ship.text.splitlines() if line.startswith(f"{number} ="))
        assert "%: " in line


def test_names_places_and_races_follow_from_what_is_said() -> None:
    twin = {each["name"]: each for each in tomllib.loads(new_vessel(**TWIN).text)["actuator"]}
    assert twin["port_rudder"]["behind"] == "port_propeller"
    assert twin["starboard_rudder"]["behind"] == "starboard_propeller"
    assert twin["port_propeller"]["y_m"] == -twin["starboard_propeller"]["y_m"] < 0.0
    assert twin["port_rudder"]["y_m"] == twin["port_propeller"]["y_m"]
    four = tomllib.loads(new_vessel(**FOUR).text)["actuator"]
    assert [each["x_m"] > 0.0 for each in four] == [True, True, False, False]
    tunnels = {each["name"]: each for each in tomllib.loads(new_vessel(**TUNNELS).text)["actuator"]}
    assert tunnels["bow"]["x_m"] > 0.0 > tunnels["stern"]["x_m"]
    assert tunnels["stern"]["quadratic_n"] * tunnels["stern"]["limit_rpm"] ** 2 == pytest.approx(8e4, rel=1e-3)
    assert tunnels["rudder"]["behind"] == "main"


def test_what_is_said_stands_as_it_was_said() -> None:
    made = new_vessel(
        **KVLCC2 | {"centre_of_gravity_m": 0.25, "frontal_area_m2": 0.9, "propellers": ["diameter=0.216, x=-3.3"]}
    )
    tree = tomllib.loads(made.text)
    assert tree["inertia"]["x_G"] == pytest.approx(0.25 / 7.0, rel=1e-3)
    assert tree["wind"]["frontal_area_m2"] == 0.9
    assert tree["actuator"][0]["x_m"] == -3.3
    assert {"inertia.x_G", "wind.frontal_area_m2"}.isdisjoint(tree["estimated"])


def test_a_known_pitch_makes_the_thrust_better_known() -> None:
    known = tomllib.loads(new_vessel(**KVLCC2).text)["estimated"]["propeller.k_0"]
    unknown = new_vessel(**KVLCC2 | {"propellers": ["diameter=0.216"]})
    assert tomllib.loads(unknown.text)["estimated"]["propeller.k_0"] > 2.0 * known


def test_the_pitch_follows_from_the_shaft_speed_where_that_is_said() -> None:
    made = new_vessel(**TUNNELS)
    assert made.service_rpm["main"] == pytest.approx(110.0, rel=0.02)
    assert not made.warnings


def test_a_shaft_speed_that_does_not_fit_and_an_unusual_ship_are_mentioned() -> None:
    made = new_vessel(**KVLCC2 | {"propellers": ["diameter=0.216, pitch_ratio=0.721, rpm=400"]})
    assert "400 rpm" in made.warnings[0]
    wide = new_vessel(**KVLCC2 | {"beam_m": 3.4, "draught_m": 1.0, "block": 0.45})
    assert len(wide.warnings) == 3
    assert all(f"# Note: {warning}." in wide.text for warning in wide.warnings)


SHARES = strategies.floats(0.0, 1.0)


@given(
    strategies.tuples(SHARES, SHARES, SHARES, SHARES, SHARES, SHARES),
    strategies.integers(1, 4),
    strategies.sampled_from(["propellers", "azimuths"]),
    strategies.sampled_from(["mmg", "cross_flow"]),
)
def test_any_displacement_ship_gets_a_file_of_finite_numbers(
    form: tuple[float, ...], count: int, kind: str, hull: str
) -> None:
    length_m = 0.6 * 900.0 ** form[0]
    beam_m = length_m / (1.1 + 12.8 * form[1])
    draught_m = beam_m / (1.3 + 10.0 * form[2])
    made = new_vessel(
        name="any", length_m=length_m, beam_m=beam_m, draught_m=draught_m, block=0.31 + 0.63 * form[3],
        service_speed_mps=(0.02 + 0.77 * form[4]) * (9.81 * length_m) ** 0.5, hull=hull,  # type: ignore[arg-type]
        **{kind: [f"diameter={(0.2 + 0.7 * form[5]) * draught_m}"] * count},  # type: ignore[arg-type]
    )  # fmt: skip
    tree = tomllib.loads(made.text)
    assert len(tree["actuator"]) == count
    assert all(isfinite(value) for value in tree["hull"].values() if isinstance(value, float))
    assert all(isfinite(rpm) and rpm > 0.0 for rpm in made.service_rpm.values())


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"propellers": []}, "no propulsor"),
        ({"propellers": ["pitch_ratio=0.8"]}, "its diameter is missing"),
        ({"propellers": ["diameter=big"]}, "diameter is 'big'"),
        ({"propellers": ["diameter=-2"]}, "diameter is -2"),
        ({"propellers": ["diameter=2, diameter=3"]}, "'diameter' is said twice"),
        ({"propellers": ["diameter=2, colour=3"]}, "'colour' is not known"),
        ({"rudders": ["behind=main"]}, "behind 'main'.*propeller"),
        ({"tunnels": ["bow"]}, "bow,force=N"),
        ({"propellers": ["main, diameter=2", "main, diameter=2"]}, "two actuators are called 'main'"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(change: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words) as raised:
        new_vessel(**KVLCC2 | change)
    assert "\n" not in str(raised.value)


def test_a_catamaran_is_two_hulls_apart() -> None:
    both = tomllib.loads(new_vessel(**CATAMARAN).text)
    one = tomllib.loads(new_vessel(**CATAMARAN | {"demihull_beam_m": None, "beam_m": 0.25}).text)
    assert both["dimensions"]["beam_m"] == 1.08
    for name in ("m", "m_x", "m_y"):
        assert both["inertia"][name] == pytest.approx(2.0 * one["inertia"][name], rel=1e-3)
    assert both["inertia"]["I_zG"] > 2.0 * one["inertia"]["I_zG"]
    for name in ("R_0", "Y_v", "N_v", "Y_vvv"):
        assert both["hull"][name] == pytest.approx(2.0 * one["hull"][name], rel=1e-3)
    assert both["hull"]["N_r"] < 2.0 * one["hull"]["N_r"] < 0.0
    assert [entry["y_m"] for entry in both["actuator"]] == pytest.approx([-0.415, 0.415])


def test_a_beam_that_two_hulls_do_not_fit_in_and_one_wider_than_the_ship_is_long_are_refused() -> None:
    with pytest.raises(InputError, match="--demihull-beam"):
        new_vessel(**CATAMARAN | {"demihull_beam_m": 0.6})
    with pytest.raises(InputError, match=r"length by beam is 0\.9.*--demihull-beam"):
        new_vessel(**CATAMARAN | {"demihull_beam_m": None, "beam_m": 2.1})


def test_a_device_is_its_text() -> None:
    assert parse_device(Propeller, "main, diameter=5, blades=5, controllable=yes") == Propeller(
        name="main", diameter=5.0, blades=5, controllable=True
    )
    with pytest.raises(InputError, match=r"blades is '4\.5'"):
        parse_device(Propeller, "diameter=5, blades=4.5")


# The command

OPTIONS = ["--length", "7", "--beam", "1.27", "--draught", "0.46", "--block", "0.81", "--service-speed", "1.179"]


def test_the_command_writes_what_the_function_makes(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    done = CliRunner().invoke(st.app, ["vessel", "new", "-o", str(file), *OPTIONS, "--propeller", "diameter=0.216"])
    assert done.exit_code == 0, done.output
    dimensions = {key: KVLCC2[key] for key in ("length_m", "beam_m", "draught_m", "block", "service_speed_mps")}
    assert file.read_text() == st.new_vessel(name="mine", propellers=["diameter=0.216"], **dimensions).text
    assert "takes propeller" in done.stderr


def test_without_a_terminal_everything_that_is_missing_is_named(tmp_path: Path) -> None:
    done = CliRunner().invoke(st.app, ["vessel", "new", "-o", str(tmp_path / "x.toml"), "--beam", "1.27"])
    assert done.exit_code == 2
    for option in ("--length", "--draught", "--block", "--service-speed", "--propeller or --azimuth"):
        assert option in done.stderr.replace("\n", " ")
    assert not list(tmp_path.iterdir())


def test_at_a_terminal_what_is_missing_is_asked_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("seatrial.hybrid.commands.is_at_terminal", lambda: True)
    file = tmp_path / "asked.toml"
    answers = ["0.81", "main, diameter=0.216", "", "", "area=0.0539", "", ""]
    done = CliRunner().invoke(
        st.app, ["vessel", "new", "-o", str(file), *OPTIONS[:6], *OPTIONS[8:]], input="\n".join(answers) + "\n"
    )
    assert done.exit_code == 0, done.output
    tree = tomllib.loads(file.read_text())
    assert [each["name"] for each in tree["actuator"]] == ["main", "rudder"]
    assert tree["provenance"]["block_coefficient"] == 0.81
