"""Ships with other actuators than R/V Gunnerus' have their manoeuvres, pages, plots and rows in a batch."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest

from seatrial.acquisition.core.trial import Trial
from seatrial.acquisition.recording.writer import write_table
from seatrial.analysis.batch import process_recording
from seatrial.analysis.manoeuvres.find import find_manoeuvres
from seatrial.analysis.manoeuvres.indices import Manoeuvre
from seatrial.analysis.manoeuvres.motion import motion_of
from seatrial.analysis.report.interactive import interactive_page, page_data
from seatrial.analysis.report.pages import fill_figure, numbers_in_figure
from seatrial.analysis.report.plots import axis_label, channels_figure, draw_manoeuvre
from seatrial.analysis.tables.resample import resample
from seatrial.hybrid.simulation.trial import simulate_trial
from seatrial.hybrid.vessel.files import load_vessel, save_vessel

SHIPS = {
    "ferry": {"one": (-13.0, -2.7), "two": (-13.0, 2.7), "three": (13.0, -2.7), "four": (13.0, 2.7)},
    "tug": {"pod": (-13.0, 0.0)},
}
"""Where the azimuth thrusters stand: forward and to starboard [m]. The tug has two tunnel thrusters besides."""
CONTROLS = {
    "ferry": [f"{name}_{what}" for name in SHIPS["ferry"] for what in ("rpm", "angle_deg")],
    "tug": ["pod_rpm", "pod_angle_deg", "bow_tunnel_rpm", "stern_tunnel_rpm"],
}


@pytest.fixture(scope="module")
def vessels(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A vessel file of each ship, R/V Gunnerus' hull with actuators of her kinds at other places."""
    folder, gunnerus = tmp_path_factory.mktemp("ships"), load_vessel("gunnerus_short")
    azimuth, _, tunnel = gunnerus.actuator
    for name, places in SHIPS.items():
        actuator = [replace(azimuth, name=each, x_m=x, y_m=y) for each, (x, y) in places.items()]
        if name == "tug":
            actuator += [replace(tunnel, name="bow_tunnel"), replace(tunnel, name="stern_tunnel", x_m=-8.0)]
        save_vessel(replace(gunnerus, name=name, base="", actuator=tuple(actuator)), folder / f"{name}.toml")
    return {name: folder / f"{name}.toml" for name in SHIPS}


def sailed(vessel: Path, manoeuvre: str, duration_s: float) -> pd.DataFrame:
    """Two rows a second of a simulated trial."""
    return simulate_trial(str(vessel), "calm", manoeuvre, duration_s, 10.0, 1)[0].iloc[::5]


@pytest.fixture(scope="module")
def zigzags(vessels: dict[str, Path]) -> dict[str, pd.DataFrame]:
    return {name: sailed(path, "zigzag_20_20", 240.0) for name, path in vessels.items()}


def found_in(table: pd.DataFrame, kind: str = "") -> list[Manoeuvre]:
    return [each for each in find_manoeuvres(table, 28.9) if kind in each.kind]


@pytest.mark.parametrize("ship", SHIPS)
def test_a_zigzag_is_found_whatever_steers(zigzags: dict[str, pd.DataFrame], ship: str) -> None:
    """Azimuth thrusters at the other end turn the ship by the opposite angle, and do not hide the helm."""
    (found,) = found_in(zigzags[ship])
    assert (found.kind, found.name, found.side) == ("zigzag", "zigzag 20/20", "port")
    assert found.settings["azimuth_deg"] == pytest.approx(20.0, abs=0.5)
    shafts = {name: value for name, value in found.settings.items() if name.endswith("_rpm")}
    assert list(shafts) == [f"{name}_rpm" for name in SHIPS[ship]]
    assert list(shafts.values()) == pytest.approx([171.0] * len(shafts), abs=1.0)


def test_turns_of_a_ship_with_thrusters_at_both_ends(vessels: dict[str, Path]) -> None:
    circles = found_in(sailed(vessels["ferry"], "turning_circle_30", 330.0), "turning_circle")
    assert [each.side for each in circles][:2] == ["port", "starboard"]
    assert [each.settings["azimuth_deg"] for each in circles][:2] == pytest.approx([30.0, -30.0], abs=0.5)


def test_each_thruster_alone_has_its_own_name(vessels: dict[str, Path]) -> None:
    names = [each.name for each in found_in(sailed(vessels["ferry"], "one_thruster", 460.0), "thruster_test")]
    assert names[:4] == [f"{name} thruster alone" for name in SHIPS["ferry"]]
    tunnels = found_in(sailed(vessels["tug"], "tunnel_test", 400.0), "thruster_test")
    assert [(each.name, each.side) for each in tunnels] == [
        ("bow tunnel thruster to starboard", "starboard"), ("bow tunnel thruster to port", "port"),
        ("stern tunnel thruster to starboard", "port"), ("stern tunnel thruster to port", "starboard"),
    ]  # fmt: skip
    assert tunnels[0].settings["bow_tunnel_rpm"] > 250.0 > 50.0 > abs(tunnels[0].settings["stern_tunnel_rpm"])


@pytest.mark.parametrize("ship", SHIPS)
def test_plots_show_every_actuator(zigzags: dict[str, pd.DataFrame], ship: str) -> None:
    one_hz = resample(zigzags[ship], 1.0)
    drawing = channels_figure(one_hz)
    assert drawing is not None
    labels = re.findall(r'"label": "([^"]*)"', json.dumps(numbers_in_figure(fill_figure(*drawing[:2]))))
    assert {axis_label(name) for name in CONTROLS[ship]} - {"pod angle [deg]"} <= set(labels)
    motion = motion_of(zigzags[ship])
    run = replace(found_in(zigzags[ship])[0], kind="speed_run")
    shown = json.dumps(
        numbers_in_figure(fill_figure(lambda figure: draw_manoeuvre(figure, motion, run), (9.0, 5.0)))
    )
    assert all(f'"label": "{name.replace("_", " ")}"' in shown for name in SHIPS[ship])


@pytest.mark.parametrize("ship", SHIPS)
def test_the_interactive_page_has_every_actuator(zigzags: dict[str, pd.DataFrame], ship: str) -> None:
    one_hz = resample(zigzags[ship], 1.0)
    assert set(CONTROLS[ship]) <= set(page_data(one_hz)["channels"])
    html = interactive_page(one_hz).html
    assert "Without" not in re.sub(r"<script.*?</script>", "", html, flags=re.DOTALL)
    found = re.search(r'id="data">(.*?)</script>', html, re.DOTALL)
    assert found is not None
    style = json.loads(found[1])["style"]
    panels = {each["title"]: each["names"] for each in style["panels"]}
    assert panels["thrusters [rpm]"] + panels["azimuths [deg]"] == sorted(
        CONTROLS[ship], key=lambda name: name.endswith("_deg")
    )
    colours = {each["actuator"]: each["colour"] for each in style["controls"].values()}
    assert len(set(colours.values())) == len(colours)


@pytest.mark.parametrize("ship", [pytest.param("ferry", marks=pytest.mark.slow), "tug"])
def test_a_batch_has_her_row_and_page(zigzags: dict[str, pd.DataFrame], ship: str, tmp_path: Path) -> None:
    table = zigzags[ship]
    trial = Trial(name=ship, actuators=table.attrs["trial"]["actuators"])
    write_table(table, tmp_path / "trial.mcap", trial, source="test")
    row = process_recording(tmp_path / "trial.mcap", tmp_path / "out")
    assert (row["missing"], row["channels"]) == ([], 8 + len(CONTROLS[ship]))
    assert row["manoeuvres"]["zigzag"] == 1
    assert row["status"] == "done", row["cause"]
    page = (tmp_path / "out" / "page.html").read_text(encoding="utf-8")
    assert "zigzag 20/20" in page
    assert "channels missing" not in page
