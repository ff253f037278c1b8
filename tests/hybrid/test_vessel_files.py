"""Vessel files: read, refused with the place of the fault, written back the same."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from seatrial.acquisition.config.declarations import load_actuators, vessel_names
from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.acquisition.core.ship import VESSELS, Actuator
from seatrial.hybrid.effects import catalogue_of_actuators
from seatrial.hybrid.vessel.files import Vessel, add_effects, load_vessel, save_vessel
from seatrial.hybrid.vessel.plant import Plant, bare_plant, flat_numbers, number_places, pack, plant_dtype

SHORT = (VESSELS / "gunnerus_short.toml").read_text()


def test_vessels_are_found_by_name_or_file(tmp_path: Path, vessel: Vessel) -> None:
    """A name is a file of trials/vessels; a path is any file."""
    assert {"gunnerus_short", "gunnerus_long"} <= set(vessel_names())
    file = tmp_path / "mine.toml"
    file.write_text(SHORT)
    assert load_vessel(file) == vessel


@pytest.mark.parametrize(("old", "new", "named"), [
    ("mass_kg = 410930.0", "", r"inertia\.mass_kg"),
    ("mass_kg = 410930.0", "mas_kg = 410930.0", r"inertia\.ma"),
    ("mass_kg = 410930.0", 'mass_kg = "410930"', r"line \d+.*inertia\.mass_kg"),
    ("mass_kg = 410930.0", "mass_kg = true", r"inertia\.mass_kg"),
    ("mass_kg = 410930.0", "mass_kg = -1.0", r"line \d+.*inertia\.mass_kg"),
    ("mass_kg = 410930.0", "mass_kg = nan", r"inertia\.mass_kg"),
    ("CN = [0.0, ", "CN = [", r"wind\.CN"),
    ("[inertia]", "[inertea]", "inert"),
    ("[inertia]", "[inertia", "not valid TOML"),
])  # fmt: skip
def test_faults_are_named_with_file_and_key(old: str, new: str, named: str, tmp_path: Path) -> None:
    """What is missing, unknown, ill-typed or impossible is said with its place."""
    assert old in SHORT
    file = tmp_path / "faulty.toml"
    file.write_text(SHORT.replace(old, new, 1))
    with pytest.raises(ConfigurationError, match=named) as caught:
        load_vessel(file)
    assert "faulty.toml" in str(caught.value)


def test_an_unknown_vessel_lists_the_known() -> None:
    """A name that is none says which there are."""
    with pytest.raises(ConfigurationError, match="gunnerus_short"):
        load_vessel("titanic")


@pytest.mark.parametrize("load", [load_vessel, load_actuators])
@pytest.mark.parametrize("first", ["a.toml", "outside.toml"])
def test_a_circle_of_bases_is_refused(load: Callable[[Path], object], first: str, tmp_path: Path) -> None:
    """A file that builds on itself is no ship, nor is one that builds on such files."""
    for name, base in (("outside", "a"), ("a", "b"), ("b", "c"), ("c", "a")):
        (tmp_path / f"{name}.toml").write_text(f'base = "{base}.toml"')
    with pytest.raises(ConfigurationError, match="leads back"):
        load(tmp_path / first)


@pytest.mark.parametrize("how", ["name", "absolute", "relative"])
def test_recorder_and_simulator_find_the_same_base(
    how: str, tmp_path: Path, vessel: Vessel, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By the name of one of Seatrial's own, by a path from anywhere, and by one from the derived file's folder."""
    (tmp_path / "ships").mkdir()
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    whole = tmp_path / "whole.toml"
    whole.write_text(SHORT)
    base = {"name": "gunnerus_short", "absolute": str(whole), "relative": "../whole.toml"}[how]
    derived = tmp_path / "ships" / "derived.toml"
    derived.write_text(f"base = {base!r}\n[[actuator]]\nname = 'tunnel'\nx_m = 9.0\n")
    assert load_actuators(derived) == load_actuators("gunnerus_short") == vessel.actuators
    assert load_vessel(derived).actuator[-1] == replace(vessel.actuator[-1], x_m=9.0)


@pytest.mark.parametrize("text", ["actuator = 3", "[[actuator]]\nname = 'port'", "[[actuator]]\nkind = 'tunnel'"])
def test_a_list_of_actuators_that_is_none_is_refused(text: str, tmp_path: Path) -> None:
    (tmp_path / "ship.toml").write_text(text)
    with pytest.raises(ConfigurationError, match=r"ship\.toml.*name and kind"):
        load_actuators(tmp_path / "ship.toml")


def test_an_actuator_may_not_take_the_name_of_a_pair() -> None:
    """``thrust_loss_both`` is the loss of both of a pair; of an actuator called so it would be another effect."""
    with pytest.raises(ConfigurationError, match=r"two effects of this ship are called .*thrust_loss_both"):
        catalogue_of_actuators((Actuator("both", "azimuth"), Actuator("port", "azimuth")))


def test_a_file_on_a_base_overrides_single_numbers(tmp_path: Path, vessel: Vessel) -> None:
    """Only what differs has to be stated."""
    file = tmp_path / "heavy.toml"
    file.write_text('base = "gunnerus_short"\n[inertia]\nmass_kg = 493500.0\n')
    heavy = load_vessel(file)
    assert heavy.inertia == replace(vessel.inertia, mass_kg=493500.0)
    assert heavy.hull == vessel.hull


def test_whole_vessels_round_trip(tmp_path: Path, vessel: Vessel) -> None:
    """A vessel of its own is written in full and read back equal."""
    own = replace(vessel, name="own", description='a "quoted" ship \\ æøå')
    save_vessel(own, tmp_path / "own.toml")
    assert load_vessel(tmp_path / "own.toml") == own


def test_a_hull_may_be_stated_without_dimension(tmp_path: Path) -> None:
    """Y_v' of v U and N_rrr' of r^3 / U by hand; the rest of the file as it is."""
    ship = load_vessel("gunnerus_short")
    primed = replace(ship.hull, units="primed", reference_speed_mps=5.0, Yuv=-0.4, Nrrr=-0.02)  # type: ignore[type-var]
    save_vessel(replace(ship, name="primed", hull=primed), tmp_path / "primed.toml")
    plant = bare_plant(load_vessel(tmp_path / "primed.toml"))
    q, L = 0.5 * 1025.0 * 28.9 * 2.6, 28.9
    assert plant.Yuv == pytest.approx(-0.4 * q)
    assert plant.Nrrr == pytest.approx(-0.02 * q * L * L**3 / 5.0)


def test_a_model_with_effects_added_round_trips_with_its_provenance(tmp_path: Path, vessel: Vessel) -> None:
    """The file states base, effects and where they come from, and little else."""
    added = add_effects(vessel, {"hull_fouling": {"resistance_factor": 1.2}}, low=1.1, method="test", windows=12)
    file = tmp_path / "found.toml"
    save_vessel(added, file)
    assert load_vessel(file) == added
    assert len(file.read_text().splitlines()) < 20
    assert load_vessel("gunnerus_long").effects == {"hull_lengthening": {"length_m": 5.0}}


def test_packing_keeps_every_number(plant: Plant) -> None:
    """The record holds the plant's numbers by name; flat, it is all float64."""
    packed = pack([plant, plant.scaled(2.0, "mass_kg")])
    assert packed["mass_kg"].tolist() == [plant.mass_kg, 2.0 * plant.mass_kg]
    assert packed["CX"][0].tolist() == list(plant.CX)
    assert flat_numbers(packed).shape == (2, plant_dtype(3).itemsize // 8)
    assert np.isfinite(flat_numbers(packed)).all()
    for name, value in plant.numbers().items():
        if name not in ("CX", "CY", "CN", "mass_kg"):
            assert (flat_numbers(packed)[:, number_places(plant.form, name)] == value).all()
