"""A recording's heading and axes against its track, with speeds that were derived from the heading or not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pymap3d
import pytest

from seatrial.acquisition.core.quantities import to_earth
from seatrial.acquisition.tables.column_map import add_derived_channels
from seatrial.analysis.quality.check import check_table
from seatrial.analysis.quality.findings import Finding
from seatrial.analysis.quality.motion.findings import axes_finding, check_motion, heading_convention_finding
from seatrial.hybrid.simulation.trial import simulate_trial
from tests.analysis.quality.motion.kinematic_trials import Faults, Noise, sailed
from tests.conftest import nightly

NAMES = ["surge_mps", "sway_mps", "yaw_rate_dps"]


@pytest.fixture(scope="module")
def sound() -> pd.DataFrame:
    return sailed(duration_s=900.0, heading_deg=40.0)


def with_derived(table: pd.DataFrame, names: list[str] = NAMES) -> pd.DataFrame:
    """The table with speeds and yaw rate as an import derives them of what else it holds."""
    made = table.drop(columns=names)
    sources = add_derived_channels(made, names)
    made.attrs["sources"] = {name: [sources.get(name, "table")] for name in made}
    return made


def contradiction(table: pd.DataFrame) -> Finding:
    findings = check_motion(table).findings
    assert [each.code for each in findings] == ["motion_contradiction"]
    assert not findings[0].certain
    return findings[0]


WRONG = {
    "anticlockwise from north": lambda heading: -heading % 360.0,
    "anticlockwise from east": lambda heading: (90.0 - heading) % 360.0,
    "anticlockwise from south": lambda heading: (180.0 - heading) % 360.0,
    "tenths of a degree": lambda heading: 10.0 * heading % 360.0,
    "radians": np.deg2rad,
}


@pytest.mark.parametrize("words", WRONG)
def test_speeds_that_were_derived_from_a_wrong_heading_do_not_hide_it(sound: pd.DataFrame, words: str) -> None:
    finding = contradiction(with_derived(sound.assign(heading_deg=WRONG[words](sound["heading_deg"]))))
    assert finding.channel == "heading_deg"
    assert words in finding.text


@pytest.mark.parametrize("words", list(WRONG)[:3])
def test_mirrored_positions_are_named_too_unless_the_yaw_rate_tells(sound: pd.DataFrame, words: str) -> None:
    table = sound.assign(heading_deg=WRONG[words](sound["heading_deg"]))
    assert "or as well if the positions are wrong" in contradiction(with_derived(table)).text
    confirmed = contradiction(with_derived(table, NAMES[:2])).text
    assert "which the yaw rate confirms" in confirmed
    assert "positions are wrong" not in confirmed


@pytest.mark.parametrize("words", [*list(WRONG)[:2], "radians"])
def test_speeds_of_a_sensor_name_the_same_convention(sound: pd.DataFrame, words: str) -> None:
    assert words in contradiction(sound.assign(heading_deg=WRONG[words](sound["heading_deg"]))).text


@pytest.mark.parametrize("words", list(WRONG)[:3])
def test_positions_and_heading_alone_are_enough(sound: pd.DataFrame, words: str) -> None:
    table = sound.drop(columns=NAMES).assign(heading_deg=WRONG[words](sound["heading_deg"]))
    assert words in contradiction(table).text


@pytest.mark.parametrize("words", list(WRONG)[:3])
@pytest.mark.parametrize("place", [(57.6, 11.2), (-33.9, 18.4), (0.5, -150.0)])
def test_geographic_positions_are_enough(sound: pd.DataFrame, words: str, place: tuple[float, float]) -> None:
    latitude, longitude, _ = pymap3d.ned2geodetic(sound["north_m"], sound["east_m"], 0.0, *place, 0.0)
    table = pd.DataFrame({"latitude_deg": latitude, "longitude_deg": longitude}, index=sound.index)
    assert check_motion(table.assign(heading_deg=sound["heading_deg"])).findings == ()
    assert words in contradiction(table.assign(heading_deg=WRONG[words](sound["heading_deg"]))).text


def test_headings_in_tenths_are_told_from_impossible_values_alone(sound: pd.DataFrame) -> None:
    table = with_derived(sound)
    table["heading_deg"] = np.round(10.0 * sound["heading_deg"])
    findings = {each.code: each.text for each in check_table(table).findings}
    assert "tenths of a degree" in findings["motion_contradiction"]
    assert "counts otherwise" not in findings["out_of_range"]


@pytest.mark.parametrize("axes", ["to north and to east", "to east and to north"])
@pytest.mark.parametrize("seed", [0, *nightly(1, 2)])
def test_speeds_along_north_and_east_are_not_taken_for_km_per_hour(axes: str, seed: int) -> None:
    table = sailed(duration_s=600.0, seed=seed)
    pair = to_earth(table["surge_mps"], table["sway_mps"], np.deg2rad(table["heading_deg"]))
    north, east = pair if axes.startswith("to north") else pair[::-1]
    finding = contradiction(table.assign(surge_mps=north, sway_mps=east))
    assert finding.channel == "surge_mps"
    assert axes in finding.text
    assert "km/h" not in finding.text


@pytest.mark.parametrize("rate_hz", [0.2, 2.0, *nightly(1.0)])
@pytest.mark.parametrize("names", [NAMES, NAMES[:2], NAMES[2:]])
def test_nothing_that_an_import_derived_is_accused(names: list[str], rate_hz: float) -> None:
    """Slopes over three seconds smooth a yaw rate: a gyro that did so would read too little in turns."""
    findings = check_motion(with_derived(sailed(rate_hz=rate_hz), names)).findings
    assert not [each for each in findings if each.channel in names]


@pytest.mark.parametrize("noise", [Noise(), Noise(position_m=2.0), Noise(position_m=0.0)])
@pytest.mark.parametrize("turning", [0.0, 0.3, 1.0])
def test_sound_headings_and_axes_have_no_finding(noise: Noise, turning: float) -> None:
    for faults in (Faults(), Faults(forward_m=40.0), Faults(heading_deg=10.0), Faults(late_s={"heading_deg": 2.0})):
        for duration_s in (20.0, 60.0, 600.0):
            table = sailed(faults, duration_s=duration_s, noise=noise, turning=turning, heading_deg=100.0)
            assert heading_convention_finding(table) is None
            assert axes_finding(table) is None


@pytest.mark.parametrize("vessel", ["gunnerus_long", "kvlcc2_7m", *nightly("otter_2m", "esso_osaka_3m")])
@pytest.mark.parametrize("manoeuvre", ["zigzag_10_10", "turning_circle_35", "stopping", "reciprocal"])
@pytest.mark.parametrize("sea_state", ["moderate", *nightly("calm")])
def test_simulated_ships_have_no_finding(vessel: str, manoeuvre: str, sea_state: str) -> None:
    table, _ = simulate_trial(vessel, sea_state, manoeuvre, 300.0, 1.0, 7)
    assert heading_convention_finding(table) is None
    assert axes_finding(table) is None


def test_a_long_gap_in_a_turn_is_no_straight_course(sound: pd.DataFrame) -> None:
    table = sound.copy()
    table.iloc[300:1300] = np.nan
    assert heading_convention_finding(table) is None


@pytest.mark.shared
@pytest.mark.parametrize("name", ["Z_10_05", "Z_20_10_S"])
def test_the_speeds_of_a_towing_tank_are_named_by_their_axes(name: str, shared_data: Path) -> None:
    raw = pd.read_csv(shared_data / "kvlcc2_hsva" / f"{name}.csv.gz")
    columns = {"north_m": "x north [m]", "east_m": "y east [m]", "heading_deg": "Heading [deg]",
               "surge_mps": "u [m/s]", "sway_mps": "v [m/s]", "yaw_rate_dps": "Yaw rate [deg/s]"}  # fmt: skip
    table = pd.DataFrame({channel: raw[column] for channel, column in columns.items()})
    table["heading_deg"] %= 360.0
    index = pd.Timestamp("2006-01-01T00:00Z") + pd.to_timedelta(raw["Time [s]"], unit="s")
    assert "to north and to east" in contradiction(table.set_axis(pd.DatetimeIndex(index))).text


@pytest.mark.parametrize("sway", [0.0, 1.0])
def test_causes_that_explain_as_much_are_both_said(sway: float) -> None:
    """Without sway a chart with its east to the west is a heading that counts anticlockwise."""
    still = sailed(Faults(), duration_s=900.0, heading_deg=40.0)
    heading = np.deg2rad(still["heading_deg"])
    north, east = to_earth(still["surge_mps"], sway * still["sway_mps"], heading)
    path = {name: np.cumsum(each) / 2.0 for name, each in (("north_m", north), ("east_m", -east))}
    text = contradiction(still.assign(**path, sway_mps=sway * still["sway_mps"])).text
    assert "east counts to the west" in text
    assert ("counts anticlockwise from north" in text) == (sway == 0.0)
