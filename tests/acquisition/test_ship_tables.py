"""Tables of one ship whose motion and wind are known, as loggers write them: codes for no value, lost fixes, winds
from the bow or in parts, variations, orders, and positions in radians."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pymap3d
import pytest

from seatrial.acquisition.core.quantities import Floats
from seatrial.acquisition.core.ship import angle_difference
from seatrial.acquisition.tables.column_map import apply_column_map, parse_column_map
from seatrial.acquisition.tables.import_table import Proposal, propose_column_map
from seatrial.acquisition.tables.table_files import read_raw_table

KNOT_MPS = 1852.0 / 3600.0
seconds = np.arange(0.0, 600.0)
_turning = np.where(seconds < 300.0, 1.0, 0.1) * np.sin(2.0 * np.pi * seconds / 100.0) + 0.8 * (seconds > 400.0)
heading_deg = (40.0 + np.cumsum(_turning)) % 360.0
_velocity = (6.0 - 1.5j * _turning) * np.exp(1j * np.deg2rad(heading_deg))  # north + i east, outward in a turn
_track = np.concatenate([[0.0], np.cumsum(0.5 * (_velocity[1:] + _velocity[:-1]))])
_wind = (8.0 + 0.3 * np.sin(seconds / 50.0)) * np.exp(1j * np.deg2rad(250.0 + 4.0 * np.sin(seconds / 70.0)))
_apparent = (_wind + _velocity) * np.exp(-1j * np.deg2rad(heading_deg))
wind_from_deg = np.rad2deg(np.angle(_wind)) % 360.0


def ship(**columns: object) -> pd.DataFrame:
    """A table of the ship in degrees, knots and seconds since 1970, with ``columns`` added, or left out as None."""
    latitude, longitude, _ = pymap3d.ned2geodetic(_track.real, _track.imag, np.zeros(600), 63.44, 10.4, 0.0)
    usual = {
        "time": 1_780_000_000 + seconds, "lat": latitude, "lon": longitude, "heading": heading_deg,
        "sog_kn": np.abs(_velocity) / KNOT_MPS, "cog": np.rad2deg(np.angle(_velocity)) % 360.0, "rpm": 110.0,
    }  # fmt: skip
    return pd.DataFrame({name: values for name, values in (usual | columns).items() if values is not None})


def propose(table: pd.DataFrame, folder: Path, **answers: str) -> Proposal:
    table.to_csv(folder / "ship.csv", index=False)
    return propose_column_map(read_raw_table(folder / "ship.csv"), answers)


def imported(table: pd.DataFrame, folder: Path, **answers: str) -> tuple[pd.DataFrame, str]:
    """The channels as they are imported, and the warnings."""
    proposal = propose(table, folder, **answers)
    assert not proposal.unanswered, proposal.unanswered
    columns, declared = parse_column_map(proposal.text, folder / "map.toml")
    file = apply_column_map(read_raw_table(folder / "ship.csv"), columns, folder / "map.toml", declared)
    return file.table, "\n".join(proposal.warnings)


def largest_error(measured: pd.Series, truth: Floats, *, angle: bool = False) -> float:
    """Of the rows with a value, and these are not few."""
    values = measured.to_numpy(dtype=float)
    valid = np.isfinite(values)
    assert valid.sum() > 400
    errors = angle_difference(values, truth) if angle else values - truth
    return float(np.max(np.abs(np.asarray(errors)[valid])))


@pytest.mark.parametrize("code", [-1, -99, -999, 9999, 9999.99, 99999.9, -32768])
def test_a_code_for_no_value_is_none(code: float, tmp_path: Path) -> None:
    table = ship()
    for row, name in enumerate(("heading", "sog_kn", "rpm")):
        table.loc[100 + 50 * row : 120 + 50 * row, name] = code
    table.loc[300:310, ["lat", "lon"]] = code
    channels, _ = imported(table, tmp_path)
    assert largest_error(channels["heading_deg"], heading_deg, angle=True) < 1e-6
    assert largest_error(channels["speed_over_ground_mps"], np.abs(_velocity)) < 1e-6
    assert largest_error(channels["propeller_rpm"], np.full(600, 110.0)) < 1e-6
    assert largest_error(channels["north_m"], _track.real) < 1e-3
    assert channels["heading_deg"].isna().sum() == 21


def test_a_code_for_no_value_is_none_of_a_declared_channel_either(tmp_path: Path) -> None:
    power = np.where((seconds > 100.0) & (seconds < 120.0), -999.0, 1500.0 + seconds / 10.0)
    channels, warnings = imported(ship(**{"Shaft power [kW]": power}), tmp_path)
    assert largest_error(channels["shaft_power_kw"], 1500.0 + seconds / 10.0) < 1e-6
    assert "'Shaft power [kW]' is -999 in some rows" in warnings


def test_what_goes_below_zero_by_itself_has_no_code_there(tmp_path: Path) -> None:
    """A helm of -1 is one, and so are a few revolutions astern."""
    helm, astern = np.round(10.0 * _turning), np.where(seconds < 300.0, 0.0, -1.0)
    channels, _ = imported(ship(rudder=helm, rpm=astern), tmp_path)
    assert largest_error(channels["rudder_angle_deg"], helm) == 0.0
    assert largest_error(channels["propeller_rpm"], astern) == 0.0


@pytest.mark.parametrize(
    ("name", "fixed", "lost"),
    [("fix_quality", 1, 0), ("GPS quality", 4, 0), ("gps_fix", 0, -1), ("status", "A", "V")],
)
def test_without_a_fix_there_is_no_position(name: str, fixed: object, lost: object, tmp_path: Path) -> None:
    """A receiver repeats its last position until it has a fix again."""
    table = ship().assign(**{name: fixed}).astype({name: object})
    table.loc[200:260, name] = lost
    for column in ("lat", "lon", "sog_kn", "cog"):
        table.loc[200:260, column] = table[column][200]
    channels, warnings = imported(table, tmp_path)
    for channel, truth in (("north_m", _track.real), ("east_m", _track.imag)):
        assert largest_error(channels[channel], truth) < 1e-3
    assert channels[["north_m", "latitude_deg", "speed_over_ground_mps"]].isna().sum().tolist() == [61] * 3
    assert f"{name!r}, of the fix, is {fixed} in 539 rows, {lost} in 61 rows" in warnings


@pytest.mark.parametrize(("name", "values"), [("fix_quality", 0), ("gps_fix", 0), ("status", 0), ("quality", 1)])
def test_a_quality_that_never_changes_takes_no_position(name: str, values: int, tmp_path: Path) -> None:
    channels, warnings = imported(ship().assign(**{name: values}), tmp_path)
    assert channels["north_m"].notna().all()
    assert ("all positions are taken" in warnings) == (name in ("fix_quality", "gps_fix"))


_FROM_BOW_DEG = (wind_from_deg - heading_deg + 180.0) % 360.0 - 180.0
_KNOTS = np.abs(_wind) / KNOT_MPS
_WINDS = {
    "from the bow": {"TWA": _FROM_BOW_DEG, "TWS (kn)": _KNOTS},
    "from the bow, called true": {"True wind direction": _FROM_BOW_DEG % 360.0, "True wind speed (kn)": _KNOTS},
    "in parts": {"wind_u [m/s]": -_wind.imag, "wind_v [m/s]": -_wind.real},
    "in words": {"eastward_wind (kn)": -_wind.imag / KNOT_MPS, "northward_wind (kn)": -_wind.real / KNOT_MPS},
    "apparent": {"AWA": np.rad2deg(np.angle(_apparent)), "AWS [m/s]": np.abs(_apparent)},
    "apparent, positive to port": {"AWA": -np.rad2deg(np.angle(_apparent)), "AWS [m/s]": np.abs(_apparent)},
}  # fmt: skip


@pytest.mark.parametrize("kind", _WINDS)
def test_the_wind_over_ground_comes_back(kind: str, tmp_path: Path) -> None:
    channels, warnings = imported(ship(**_WINDS[kind]), tmp_path)
    assert largest_error(channels["wind_direction_deg"], wind_from_deg, angle=True) < 0.5
    assert largest_error(channels["wind_speed_mps"], np.abs(_wind)) < 0.05
    assert bool(warnings) == (kind != "apparent")
    if "apparent_wind_angle_deg" in channels:
        expected = np.rad2deg(np.angle(_apparent))
        assert largest_error(channels["apparent_wind_angle_deg"], expected, angle=True) < 0.5


def test_parts_of_the_wind_along_the_ship_are_not_taken_for_north_and_east(tmp_path: Path) -> None:
    table = ship(**{"wind_u [m/s]": _apparent.real, "wind_v [m/s]": _apparent.imag})
    channels, warnings = imported(table, tmp_path)
    assert "wind_direction_deg" not in channels
    assert "along the ship's axes" in warnings


def test_an_answer_keeps_a_wind_as_it_is_called(tmp_path: Path) -> None:
    channels, warnings = imported(ship(**_WINDS["from the bow, called true"]), tmp_path, wind="true")
    assert largest_error(channels["wind_direction_deg"], _FROM_BOW_DEG, angle=True) < 1e-6
    assert not warnings


def _variation_columns(variation: float) -> dict[str, dict[str, object]]:
    side = "E" if variation > 0.0 else "W"
    return {
        "signed": {"Variation": variation},
        "letters": {"Variation": abs(variation), "Var dir": side},
        "text": {"Variation": f"{abs(variation)} {side}"},
    }


@pytest.mark.parametrize("variation", [4.5, -7.0])
@pytest.mark.parametrize("form", ["signed", "letters", "text"])
@pytest.mark.parametrize("name", ["HDG", "Heading (mag)"])
def test_a_heading_beside_the_variation_is_made_true(
    name: str, form: str, variation: float, tmp_path: Path
) -> None:
    columns = _variation_columns(variation)[form]
    table = ship(heading=None, **{name: (heading_deg - variation) % 360.0}, **columns)
    channels, warnings = imported(table, tmp_path)
    assert largest_error(channels["heading_deg"], heading_deg, angle=True) < 1e-6
    assert ("taken for magnetic" in warnings) == (name == "HDG")


def test_a_true_heading_beside_the_variation_stays(tmp_path: Path) -> None:
    channels, warnings = imported(ship(heading=None, HDG=heading_deg, Variation=4.5), tmp_path)
    assert largest_error(channels["heading_deg"], heading_deg, angle=True) < 1e-6
    assert not warnings


@pytest.mark.parametrize(("north", "added"), [("magnetic", 4.5), ("true", 0.0)])
def test_without_a_track_the_north_of_a_heading_is_asked(north: str, added: float, tmp_path: Path) -> None:
    table = ship(heading=None, lat=None, lon=None, sog_kn=None, cog=None, HDG=heading_deg, Variation=4.5)
    assert [question.key for question in propose(table, tmp_path).unanswered] == ["north"]
    channels, _ = imported(table, tmp_path, north=north)
    assert largest_error(channels["heading_deg"], heading_deg + added, angle=True) < 1e-6


def test_an_order_that_is_taken_for_the_helm_is_told(tmp_path: Path) -> None:
    helm = np.round(10.0 * _turning)
    _, alone = imported(ship(rudder_cmd=helm), tmp_path)
    _, beside = imported(ship(rudder_cmd=helm, rudder=helm), tmp_path)
    assert ("is an order" in alone, "is an order" in beside) == (True, False)


@pytest.mark.parametrize("unit", ["deg", "rad"])
def test_small_angles_beside_a_heading_in_degrees_are_told(unit: str, tmp_path: Path) -> None:
    roll_deg = 4.0 * np.sin(seconds)
    _, warnings = imported(ship(Roll=np.deg2rad(roll_deg) if unit == "rad" else roll_deg), tmp_path)
    assert ("--answer unit.Roll=rad" in warnings) == (unit == "rad")


@pytest.mark.parametrize("column", [{}, {"sog_kn": None}])
def test_positions_in_radians_are_known_by_a_speed_or_asked(column: dict[str, None], tmp_path: Path) -> None:
    def turned(table: pd.DataFrame, turn: Callable[[pd.Series], pd.Series]) -> pd.DataFrame:
        return table.assign(lat=turn(table["lat"]), lon=turn(table["lon"]))

    table = turned(ship(**column), np.deg2rad)
    questions = [question.key for question in propose(table, tmp_path).unanswered]
    assert questions == (["unit.lat"] if column else [])
    channels, _ = imported(table, tmp_path, **({"unit.lat": "rad"} if column else {}))
    assert largest_error(channels["north_m"], _track.real) < 1e-2


@pytest.mark.parametrize("seconds_too", [False, True])
@pytest.mark.parametrize("letters", [False, True])
def test_degrees_and_minutes_in_columns_of_their_own(seconds_too: bool, letters: bool, tmp_path: Path) -> None:
    latitude, longitude = ship()["lat"].to_numpy(), ship()["lon"].to_numpy() - 20.0
    columns: dict[str, object] = {"lat": None, "lon": None}
    for name, angles, side in (("lat", latitude, "N"), ("lon", longitude, "W")):
        whole, minutes = np.divmod(np.abs(angles), 1.0)
        minutes *= 60.0
        columns[f"{name}_deg"] = whole if letters or name == "lat" else -whole
        columns[f"{name}_min"] = np.floor(minutes) if seconds_too else minutes
        columns |= {f"{name}_sec": 60.0 * (minutes % 1.0)} if seconds_too else {}
        columns |= {{"lat": "N/S", "lon": "E/W"}[name]: side} if letters else {}
    channels, _ = imported(ship(cog=None, sog_kn=None, **columns), tmp_path)
    assert largest_error(channels["latitude_deg"], latitude) < 1e-9
    assert largest_error(channels["longitude_deg"], longitude) < 1e-9


def test_whole_degrees_alone_are_told(tmp_path: Path) -> None:
    _, warnings = imported(ship(lat=63.0, lon=10.0), tmp_path)
    assert "'lat' is in whole degrees" in warnings


@pytest.mark.parametrize(("name", "offset"), [("rudder", 35.0), ("rudder", 0.0)])
def test_a_helm_that_counts_from_elsewhere_than_amidships_is_told(name: str, offset: float, tmp_path: Path) -> None:
    _, warnings = imported(ship(**{name: offset + 10.0 * _turning}), tmp_path)
    assert ("elsewhere than amidships" in warnings) == (offset > 0.0)


@pytest.mark.parametrize("name", ["Rudder [V]", "rudder_mV", "Rudder angle (mA)"])
def test_the_signal_of_a_sensor_is_no_angle(name: str, tmp_path: Path) -> None:
    channels, _ = imported(ship(**{name: 2.5 + 0.1 * _turning}), tmp_path)
    assert not any("rudder" in channel for channel in channels)


def test_a_last_line_that_breaks_off_is_left_out(tmp_path: Path) -> None:
    table = ship()
    table.to_csv(tmp_path / "ship.csv", index=False)
    text = (tmp_path / "ship.csv").read_text()
    (tmp_path / "ship.csv").write_text(text[: text.rfind(",10.4") + 5])
    raw = read_raw_table(tmp_path / "ship.csv")
    assert len(raw.columns) == len(table) - 1
    assert any("breaks off" in remark for remark in raw.remarks)


def test_small_angles_beside_messages_of_ros_are_in_radians(tmp_path: Path) -> None:
    ship(rudder=np.deg2rad(10.0 * _turning)).to_csv(tmp_path / "ship.csv", index=False)
    raw = replace(read_raw_table(tmp_path / "ship.csv"), remarks=("/odom: y to port, as in ROS (REP 103)",))
    proposal = propose_column_map(raw)
    assert ("rudder", "rad") in [(reading.column, reading.unit) for reading in proposal.readings]
    assert any("--answer unit.rudder=deg" in warning for warning in proposal.warnings)


def test_a_column_whose_name_has_ros_in_it_makes_no_radians(tmp_path: Path) -> None:
    ship(rudder=2.0 * _turning).to_csv(tmp_path / "ship.csv", index=False)
    raw = replace(read_raw_table(tmp_path / "ship.csv"), remarks=("2 rows have no number in 'MICROSTRAIN'",))
    assert ("rudder", "deg") in [(reading.column, reading.unit) for reading in propose_column_map(raw).readings]


@pytest.mark.parametrize(
    ("names", "channel"),
    [
        (["thruster rpm"], "propeller_rpm"),
        (["bow thruster rpm"], "tunnel_rpm"),
        (["thruster rpm", "rpm"], "tunnel_rpm"),
    ],
)
def test_a_thruster_of_no_place_drives_a_ship_that_nothing_else_drives(
    names: list[str], channel: str, tmp_path: Path
) -> None:
    channels, warnings = imported(ship(**{"rpm": None} | dict.fromkeys(names, 90.0 + seconds / 600.0)), tmp_path)
    assert channel in channels
    assert ("taken for what drives the ship" in warnings) == (channel == "propeller_rpm")
