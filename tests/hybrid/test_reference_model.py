"""Which model recordings are held against: that of the ship that they name, and what is said of any other."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest

import seatrial as st
from seatrial.acquisition.config.trial_file import load_config
from seatrial.acquisition.core.errors import ConfigurationError, InputError
from seatrial.acquisition.core.ship import DEFAULT, VESSELS, actuators_as_text, control_names
from seatrial.acquisition.core.trial import Trial
from seatrial.acquisition.logger.record import record
from seatrial.acquisition.logger.survey import redecode
from seatrial.acquisition.protocols.nmea0183 import frame_sentence
from seatrial.acquisition.recording.reader import read_recording, read_trial
from seatrial.acquisition.recording.writer import write_table
from seatrial.acquisition.tables.import_table import import_table
from seatrial.analysis.tables.table import table_actuators
from seatrial.hybrid.simulation.trial import simulate_trial
from seatrial.hybrid.vessel.files import (
    ReferenceModel,
    add_effects,
    load_vessel,
    reference_model,
    save_vessel,
    trials_of_recordings,
)
from tests.conftest import Command

TANKER = (VESSELS / "esso_osaka_3m.toml").read_text().replace("esso_osaka_3m", "tanker")


def recording_of(ship: str, path: Path, like: str = "") -> Path:
    """Some seconds at rest of a ship with the actuators of ``like``, R/V Gunnerus' without."""
    times = pd.date_range("2026-06-01", periods=3, freq="s", tz="UTC", name="time")
    actuators = load_vessel(like or None).actuators
    trial = Trial(name=path.stem, vessel=ship, actuators=actuators_as_text(actuators))
    table = pd.DataFrame(0.0, index=times, columns=["heading_deg", *control_names(actuators)])
    write_table(table, path, trial, source="test")
    return path


def model_of(*recordings: Path, vessel: str | Path | None = None) -> ReferenceModel:
    return reference_model(trials_of_recordings(recordings), vessel)


def test_the_model_is_that_of_the_ship_that_is_named(tmp_path: Path) -> None:
    for ship in ("gunnerus_long", "esso_osaka_3m", "otter_2m"):
        found = model_of(recording_of(ship, tmp_path / "trial.mcap", ship))
        assert (found.file, found.vessel) == (ship, load_vessel(ship))
        assert str(found.choice) == f"model: {ship}"
        assert found.choice.remarks == {}


@pytest.mark.parametrize("place", ["beside", "here"])
@pytest.mark.parametrize("file", ["tanker.toml", "hull_7.toml"])
def test_a_file_of_her_beside_the_recording_or_here_is_hers(
    place: str, file: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By the file's name, or by the name in it; configurations and column maps that lie there too are no ships."""
    folder, here = tmp_path / "trials", tmp_path / "here"
    folder.mkdir(), here.mkdir()
    monkeypatch.chdir(here)
    own = {"beside": folder, "here": here}[place] / file
    own.write_text(TANKER)
    (own.parent / "other.toml").write_text('[trial]\nname = "tanker"\nvessel = "tanker"\n')
    (own.parent / "broken.toml").write_text("[trial")
    recording = recording_of("tanker", folder / "a.mcap", "esso_osaka_3m")
    found = model_of(recording)
    assert Path(found.file) == own
    assert found.vessel.hull == load_vessel("esso_osaka_3m").hull
    assert not found.choice.doubt
    (own.parent / "hull_8.toml").write_text(TANKER)
    if file == "tanker.toml":  # the one that is called so
        assert Path(model_of(recording).file) == own
    else:
        with pytest.raises(ConfigurationError, match=r"hull_7\.toml and hull_8\.toml.*--vessel"):
            model_of(recording)


def test_another_model_is_used_when_asked_for_and_said_first(tmp_path: Path) -> None:
    long = recording_of("gunnerus_long", tmp_path / "long.mcap")
    found = model_of(long, vessel="gunnerus_short")
    said = "model: gunnerus_short, not the ship that the recording names (gunnerus_long)"
    assert found.file == "gunnerus_short"
    assert str(found.choice) == said
    assert found.choice.remarks == {"remarks": [said]}
    both = model_of(long, recording_of("kvlcc2_7m", tmp_path / "b.mcap", "kvlcc2_7m"), vessel="gunnerus_long")
    assert str(both.choice).endswith("not the ship that the recordings name (kvlcc2_7m)")


def test_a_model_made_from_hers_is_hers(tmp_path: Path) -> None:
    """With effects that a diagnosis added, or with another loading."""
    recording = recording_of("gunnerus_short", tmp_path / "a.mcap")
    added = add_effects(load_vessel("gunnerus_short"), {"loading": {"mass_factor": 1.1}})
    save_vessel(added, tmp_path / "diagnosed.toml")
    (tmp_path / "heavy.toml").write_text('base = "gunnerus_short"\n[effects.loading]\nmass_factor = 1.2\n')
    for file in ("diagnosed.toml", "heavy.toml"):
        assert not model_of(recording, vessel=tmp_path / file).choice.doubt
    assert model_of(recording, vessel="gunnerus_long").choice.doubt
    assert load_vessel(tmp_path / "heavy.toml").name == "heavy"


def test_recordings_that_name_none_are_of_the_ship_that_all_were_of(tmp_path: Path) -> None:
    nameless = recording_of("", tmp_path / "old.mcap")
    found = model_of(nameless)
    assert found.file == "gunnerus_short"
    assert str(found.choice) == "model: gunnerus_short; the recording names no ship: chosen by the actuators"
    with pytest.raises(InputError, match=r"rudder\.mcap: names no ship.*--vessel.*seatrial vessel new"):
        model_of(recording_of("", tmp_path / "rudder.mcap", "kvlcc2_7m"))
    assert model_of(nameless, recording_of("gunnerus_long", tmp_path / "new.mcap")).file == "gunnerus_long"


@pytest.mark.parametrize("missing", [("tunnel",), ("angle", "tunnel"), ("angle", "rpm")])
def test_part_of_the_actuators_of_a_ship_does_not_name_it(missing: tuple[str, ...], tmp_path: Path) -> None:
    """Neither two propellers called port and starboard nor motion alone are R/V Gunnerus."""
    table = simulate_trial("gunnerus_short", "calm", "zigzag", 30.0, 1.0)[0]
    lacking = [name for name in control_names(DEFAULT) if any(part in name for part in missing)]
    table = table.drop(columns=lacking)
    table.attrs.clear()
    path = st.write(table, tmp_path / "trial.mcap")
    with pytest.raises(InputError, match="names no ship; choose one of"):
        model_of(path)
    assert set(control_names(table_actuators(st.read(path)))) == set(table) & set(control_names(DEFAULT))


def test_table_written_as_a_vessel_has_its_actuators(tmp_path: Path) -> None:
    """Not R/V Gunnerus', to which the names of two propellers would fit as well."""
    times = pd.date_range("2026-06-01", periods=3, freq="s", tz="UTC", name="time")
    table = pd.DataFrame(1.0, index=times, columns=["heading_deg", "port_rpm", "starboard_rpm"])
    path = st.write(table, tmp_path / "trial.mcap", vessel="otter_2m")
    assert table_actuators(st.read(path)) == load_vessel("otter_2m").actuators
    assert model_of(path).file == "otter_2m"


def test_a_ship_without_a_file_and_two_ships_are_refused_with_what_to_do(tmp_path: Path) -> None:
    unknown = recording_of("titanic", tmp_path / "a.mcap")
    with pytest.raises(InputError, match=r"'titanic'.*gunnerus_long.*--vessel.*seatrial vessel new"):
        model_of(unknown)
    with pytest.raises(InputError, match=r"esso_osaka_3m, titanic.*--vessel"):
        model_of(unknown, recording_of("esso_osaka_3m", tmp_path / "b.mcap", "esso_osaka_3m"))
    assert model_of(unknown, vessel="gunnerus_long").choice.doubt


def test_a_table_becomes_a_recording_of_the_ship_that_is_given(tmp_path: Path) -> None:
    """By option over what its map says; from there to the model."""
    (tmp_path / "hers.toml").write_text(TANKER)
    table = simulate_trial("esso_osaka_3m", "calm", "zigzag", 30.0, 1.0)[0]
    table.to_csv(tmp_path / "trial.csv")
    columns = "\n".join(f'{name} = {{ column = "{name}" }}' for name in table)
    (tmp_path / "map.toml").write_text(
        f'[trial]\nvessel = "kvlcc2_7m"\n[time]\ncolumn = "time"\n[channels]\n{columns}'
    )
    for given in ({}, {"map_path": tmp_path / "map.toml", "force": True}):
        import_table(tmp_path / "trial.csv", tmp_path / "a.mcap", vessel=tmp_path / "hers.toml", **given)
        assert read_trial(tmp_path / "a.mcap").vessel == "tanker"
        assert Path(model_of(tmp_path / "a.mcap").file) == tmp_path / "hers.toml"
    import_table(tmp_path / "trial.csv", tmp_path / "b.mcap", tmp_path / "map.toml")
    assert model_of(tmp_path / "b.mcap").file == "kvlcc2_7m"


def test_a_configuration_that_names_her_has_her_actuators(tmp_path: Path) -> None:
    """From a vessel file beside it; what was recorded is decoded anew without that file."""
    (tmp_path / "hers.toml").write_text(TANKER)
    (tmp_path / "bridge.log").write_bytes(frame_sentence("HEHDT,12.0,T") + frame_sentence("IIRSA,-5.0,A,,V"))
    (tmp_path / "trial.toml").write_text(
        '[trial]\nname = "a"\nvessel = "tanker"\n[[source]]\nname = "line"\ntype = "file"\npath = "bridge.log"\n'
        'channels = ["heading_deg", "rudder_angle_deg"]\n'
    )
    (path, *_), _ = record(load_config(tmp_path / "trial.toml"), tmp_path / "out")
    assert read_recording(path).series["rudder_angle_deg"].value.tolist() == [-5.0]
    assert read_trial(path).vessel == "tanker"
    assert (
        Path(reference_model(trials_of_recordings([path.rename(tmp_path / "a.mcap")])).file)
        == tmp_path / "hers.toml"
    )
    (tmp_path / "hers.toml").unlink()
    redecode([tmp_path / "a.mcap"], tmp_path / "again.mcap")
    assert "rudder_angle_deg" in read_recording(tmp_path / "again.mcap").series


def test_commands_say_the_model_first(tmp_path: Path, command: Command) -> None:
    path = tmp_path / "zigzag.mcap"
    done = command("simulate", "-o", path, "--vessel", "esso_osaka_3m", "--duration", "120", "--rate", "5")
    assert done.code == 0
    told = command("validate", path, "--any", "--horizon", "10")
    assert told.code == 0
    assert told.out.startswith("model: esso_osaka_3m\n")
    assert "remarks" not in command("validate", path, "--any", "--horizon", "10", "--json").json
    (tmp_path / "other.toml").write_text(TANKER.replace("0.3278", "0.36"))
    told = command("predict", path, "--at", "+60", "--vessel", tmp_path / "other.toml")
    said = "model: tanker (other.toml), not the ship that the recording names (esso_osaka_3m)"
    assert told.out.startswith(said + "\n")
    plain = command("predict", path, "--at", "+60", "--vessel", tmp_path / "other.toml", "--json").json
    assert next(iter(plain.items())) == ("remarks", [said])
