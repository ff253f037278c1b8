"""Ships that are nobody's, each one file: from the simulated trial to windows, a calibrator and a named loss."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

import pandas as pd
import pytest

import seatrial as st
from seatrial.acquisition.core.errors import ConfigurationError, InputError
from seatrial.acquisition.tables.import_table import import_table
from seatrial.hybrid.calibrators.adaptive import fit_parameter_vector
from seatrial.hybrid.calibrators.own import save
from seatrial.hybrid.vessel.files import load_vessel, save_vessel
from tests.conftest import nightly

HULL = load_vessel("gunnerus_short")
POD, _, TUNNEL = HULL.actuator
FOUR_PODS = tuple(
    replace(POD, name=name, x_m=x_m, y_m=y_m, propeller_diameter_m=1.6)
    for name, x_m, y_m in (
        ("fore_left", 11.0, -2.0), ("fore_right", 11.0, 2.0), ("aft_left", -13.0, -2.7), ("aft_right", -13.0, 2.7)
    )
)  # fmt: skip
POD_AND_TUNNELS = (
    replace(POD, name="main", y_m=0.0, propeller_diameter_m=2.3),
    replace(TUNNEL, name="bow"),
    replace(TUNNEL, name="aft", x_m=-11.0),
)
SHIPS = {"four_pods": (FOUR_PODS, "aft_left"), "pod_and_tunnels": (POD_AND_TUNNELS, "main")}
BY_SHIP = ["pod_and_tunnels", *nightly("four_pods")]
"""What takes long is left to ``make nightly`` for the ship with more actuators."""
LOSS = 0.3


@pytest.fixture(scope="module", params=SHIPS)
def ship(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """The file of a ship, with two trials of it beside the file, and the actuator that has lost 30 % of its force.

    What is simulated goes through a table: as if another program had written it.
    """
    folder = tmp_path_factory.mktemp(request.param)
    actuators, weak = SHIPS[request.param]
    file = folder / "ship.toml"
    save_vessel(replace(HULL, name=request.param, base="", actuator=actuators), file)
    for seed in (1, 2):
        trial = folder / f"simulated_{seed}.mcap"
        hidden = {f"thrust_loss_{weak}": {"fraction": LOSS}}
        st.simulate(trial, vessel=file, manoeuvre="paper", duration_s=900.0, rate_hz=1.0, seed=seed, hide=hidden)
        st.read(trial).to_csv(folder / f"{seed}.csv")
        import_table(folder / f"{seed}.csv", folder / f"{seed}.mcap")
    return file, weak


def test_recording_tells_its_ship(ship: tuple[Path, str]) -> None:
    """The controls of her actuators came through the table, with their units, and nobody else's are missed."""
    names = [each.name for each in load_vessel(ship[0]).actuators]
    trial = ship[0].parent / "1.mcap"
    table = st.read(trial)
    assert [name.removesuffix("_rpm") for name in table if name.endswith("_rpm")] == names
    assert {"port_rpm", "starboard_rpm"}.isdisjoint(table.columns)
    assert not st.check(trial).findings


def test_windows_hold_every_actuator(ship: tuple[Path, str]) -> None:
    held = st.windows(ship[0].parent / "1.mcap").rows
    shafts = [name for name in held if str(name).endswith("_rpm")]
    spread = held.groupby("window")[shafts].agg(lambda values: values.max() - values.min())
    assert len(spread) > 20
    assert (spread.max() < 25.0).all()


@pytest.mark.slow
@pytest.mark.parametrize("ship", BY_SHIP, indirect=True)
def test_calibrator_beats_the_model_that_lacks_something(
    ship: tuple[Path, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Trained on one trial, in a few steps, judged on the other; and saved, loaded and used for one prediction."""
    monkeypatch.setattr(
        "seatrial.hybrid.calibrators.adaptive.fit_parameter_vector", partial(fit_parameter_vector, steps=2)
    )
    file, folder = ship[0], ship[0].parent
    trained = st.train(folder / "1.mcap", vessel=file)
    save(trained, folder / "calibrator")
    judged = st.validate(folder / "2.mcap", st.load_calibrator(folder / "calibrator"))
    assert judged.reduction is not None
    assert judged.reduction > 0.2
    assert len(st.predict(folder / "2.mcap", "+300", trained).track) == 16


@pytest.mark.slow
def test_diagnosis_names_the_actuator_that_lost_force(ship: tuple[Path, str]) -> None:
    file, weak = ship
    found = st.diagnose(file.parent / "1.mcap", vessel=file).diagnosis
    named = {each.name: each for each in found.effects}
    fraction = named[f"thrust_loss_{weak}"].parameters["fraction"]
    assert fraction.low < LOSS < fraction.high
    assert not [name for name in named if name.startswith("thrust_loss_") and name != f"thrust_loss_{weak}"]


@pytest.mark.parametrize("ship", BY_SHIP, indirect=True)
def test_model_of_another_ship_is_refused_by_name(ship: tuple[Path, str]) -> None:
    """A recording that names no ship has no model without --vessel; one of another ship is refused by actuators."""
    trial = ship[0].parent / "1.mcap"
    for use in (st.validate, st.diagnose):
        with pytest.raises(InputError, match="names no ship; choose one of"):
            use(trial)
        with pytest.raises(InputError, match=rf"{ship[1]} \(azimuth\).* port \(azimuth\)"):
            use(trial, vessel="gunnerus_short")


def test_table_of_another_ship_needs_no_word_but_a_misspelt_one_is_found(
    ship: tuple[Path, str], tmp_path: Path
) -> None:
    """Columns that share nothing with R/V Gunnerus' are a ship of their own; ``prot_rpm`` beside hers is not."""
    table = pd.read_csv(ship[0].parent / "1.csv")
    weak = ship[1]
    half = tmp_path / "half.csv"
    table.rename(columns={f"{weak}_rpm": "port_rpm"}).to_csv(half, index=False)
    with pytest.raises(InputError, match=f"unknown columns .*{weak}_angle_deg.*--vessel"):
        import_table(half, tmp_path / "half.mcap")
    with pytest.raises(InputError, match="has unknown columns port_rpm"):
        import_table(half, tmp_path / "half.mcap", vessel=ship[0])
    whole = tmp_path / "whole.csv"
    table.drop(columns=f"{weak}_angle_deg").to_csv(whole, index=False)
    with pytest.raises(InputError, match=f"has no {weak}_angle_deg"):
        import_table(whole, tmp_path / "whole.mcap", vessel=ship[0])
    with pytest.raises(ConfigurationError, match=r"no vessel .*none\.toml"):
        import_table(whole, tmp_path / "whole.mcap", vessel=tmp_path / "none.toml")


def test_column_map_of_another_ship(ship: tuple[Path, str], tmp_path: Path) -> None:
    """A map may name any ship's controls; one that is not hers is found out with its line."""
    table = pd.read_csv(ship[0].parent / "1.csv")
    names = [name for name in table if name != "time"]
    foreign = tmp_path / "foreign.csv"
    table.rename(columns={name: f"signal {number}" for number, name in enumerate(names)}).to_csv(
        foreign, index=False
    )
    entries = [f'[channels.{name}]\ncolumn = "signal {number}"' for number, name in enumerate(names)]
    columns = tmp_path / "columns.toml"
    columns.write_text('[time]\ncolumn = "time"\n' + "\n".join(entries) + "\n")
    summary = import_table(foreign, tmp_path / "mapped.mcap", columns)
    assert set(summary.channels) == set(names)
    assert not summary.missing
    columns.write_text(columns.read_text().replace(f"[channels.{ship[1]}_rpm]", "[channels.mian_rpm]"))
    with pytest.raises(ConfigurationError, match=r"mian_rpm .*is not a channel of a ship"):
        import_table(foreign, tmp_path / "again.mcap", columns, vessel=ship[0])
