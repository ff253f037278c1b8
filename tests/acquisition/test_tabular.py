"""Tables to recordings: what is read, what is refused in one line, what a map makes of a foreign table."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pymap3d
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.io import savemat

import seatrial
from seatrial.acquisition.core.errors import ConfigurationError, InputError
from seatrial.acquisition.core.quantities import KNOT_MPS, from_degrees_and_minutes
from seatrial.acquisition.core.ship import BY_NAME, MOTION, NAMES
from seatrial.acquisition.recording.reader import read_recording
from seatrial.acquisition.tables.column_map import true_wind
from seatrial.acquisition.tables.import_table import (
    import_table,
    propose_column_map,
    quality_flags,
    read_table_file,
)
from seatrial.acquisition.tables.table_files import read_raw_table

TIMES = [f"2026-05-17T12:00:0{second}Z" for second in range(5)]
EPOCH_S = pd.Timestamp(TIMES[0]).timestamp()


def standard(**columns: object) -> pd.DataFrame:
    """Five rows of all 13 channels; keywords replace columns or add others."""
    return pd.DataFrame({"time": TIMES, **dict.fromkeys(NAMES, 1.0)}).assign(**columns)


def csv(folder: Path, table: pd.DataFrame | str) -> Path:
    path = folder / "table.csv"
    path.write_text(table) if isinstance(table, str) else table.to_csv(path, index=False)
    return path


def column_map(folder: Path, text: str) -> Path:
    path = folder / "map.toml"
    path.write_text(text)
    return path


def test_a_table_in_standard_names_needs_no_map(tmp_path: Path) -> None:
    summary = import_table(csv(tmp_path, standard(roll_deg=2.0, leg="a/001")), tmp_path / "out.mcap")
    recording = read_recording(tmp_path / "out.mcap")
    assert summary.samples == 5 * 14
    assert set(recording.series) == {*NAMES, "roll_deg"}
    assert recording.series["north_m"].measured_ns.tolist() == [pd.Timestamp(time).value for time in TIMES]
    assert recording.trial.name == "table"
    assert recording.closed


@pytest.mark.parametrize(
    "times",
    [
        [EPOCH_S + second for second in range(5)],
        [f"2026-05-17T14:00:0{second}+02:00" for second in range(5)],
        [f"2026-05-17 12:00:0{second}.000000+00" for second in range(5)],
        [*TIMES[:4], "2026-05-17T07:00:04-05:00"],
    ],
)
def test_times_are_iso_with_zone_or_seconds_since_1970(tmp_path: Path, times: list[object]) -> None:
    table = read_table_file(csv(tmp_path, standard(time=times))).table
    assert [time.isoformat() for time in table.index] == [time.replace("Z", "+00:00") for time in TIMES]


@given(microseconds=st.integers(0, 2**51))
def test_seconds_since_1970_are_exact_to_the_microsecond(microseconds: int) -> None:
    from seatrial.acquisition.tables.table_files import RawTable
    from seatrial.acquisition.tables.time_columns import parse_times

    raw = RawTable(Path("x.csv"), pd.DataFrame({"time": [microseconds / 1e6]}))
    assert parse_times(raw, "time").as_unit("ns").asi8[0] == microseconds * 1000


@pytest.mark.parametrize(
    ("table", "says"),
    [
        (standard(time=[time.rstrip("Z") for time in TIMES]), "row 1 of column 'time' has no zone"),
        (standard(time=[*TIMES[:3], "2026-05-17T12:00:03", TIMES[4]]), "row 4 of column 'time' has no zone"),
        (standard(time=[*TIMES[:2], "noon", *TIMES[3:]]), "row 3 .* 'noon', which is not an ISO 8601 time"),
        (standard(time=[*TIMES[:4], None]), "row 5 of column 'time' has no time"),
        (standard(sway_mps=["1", "2", "fast", "4", "5"]), "row 3 of column 'sway_mps' is not a number: 'fast'"),
        (standard(Heading=3.0), r"Heading \(did you mean heading_deg\?\).*--ignore-unknown"),
        (standard().drop(columns=["heading_deg", "sway_mps"]), "no heading_deg, sway_mps.*--allow-missing"),
        (standard().rename(columns={"time": "Time"}), "no column `time`.*Time"),
        ("time,north_m\n", "has no rows"),
        ("", "is empty"),
        ("time,north_m,north_m\n2026-05-17T12:00:00Z,1,2\n", "more than one column 'north_m'"),
        ("time,north_m\n2026-05-17T12:00:00Z,1,2,3\n", "not a readable .csv"),
    ],
)
def test_a_faulty_table_is_one_line_that_says_where(tmp_path: Path, table: pd.DataFrame | str, says: str) -> None:
    with pytest.raises(InputError, match=says) as caught:
        import_table(csv(tmp_path, table), tmp_path / "out.mcap")
    assert str(tmp_path / "table.csv") in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "out.mcap").exists()


@pytest.mark.parametrize("name", ["junk.csv", "junk.parquet", "junk.mat", "junk.xlsx"])
@pytest.mark.parametrize("content", [b"\x89PNG\r\n\x00\xff" * 90, b"abc" * 200, bytes(range(1, 256)) * 9, b""])
def test_junk_under_any_name_is_one_line(tmp_path: Path, name: str, content: bytes) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError) as caught:
        import_table(tmp_path / name, tmp_path / "out.mcap")
    assert "\n" not in str(caught.value)


def test_a_recording_that_is_there_is_replaced_on_request_only(tmp_path: Path) -> None:
    table, output = csv(tmp_path, standard()), tmp_path / "out.mcap"
    import_table(table, output)
    before = output.read_bytes()
    with pytest.raises(InputError, match="already exists"):
        import_table(table, output)
    assert output.read_bytes() == before
    import_table(table, output, force=True)


def test_impossible_values_are_kept_and_flagged(tmp_path: Path) -> None:
    table = standard(heading_deg=[0.0, 360.0, -5.0, 400.0, 359.9], surge_mps=[1.0, np.nan, np.inf, 31.0, 2.0])
    summary = import_table(csv(tmp_path, table), tmp_path / "out.mcap")
    series = read_recording(tmp_path / "out.mcap").series
    assert series["heading_deg"].value.tolist() == [0.0, 360.0, -5.0, 400.0, 359.9]
    assert series["heading_deg"].quality.tolist() == [2, 4, 4, 4, 2]
    assert series["surge_mps"].value.tolist() == [1.0, 31.0, 2.0]
    assert series["surge_mps"].quality.tolist() == [2, 4, 2]
    assert summary.out_of_range == {"heading_deg": 3, "surge_mps": 1}
    assert summary.infinite == {"surge_mps": 1}
    assert summary.samples == 5 * 13 - 2


def test_a_heading_that_runs_on_is_wrapped_without_a_map_too(tmp_path: Path) -> None:
    heading = np.array([715.0, 719.0, 723.0, 727.0, 731.0])
    import_table(csv(tmp_path, standard(heading_deg=heading)), tmp_path / "out.mcap")
    assert read_recording(tmp_path / "out.mcap").series["heading_deg"].value == pytest.approx(heading % 360.0)


@given(st.sampled_from(list(BY_NAME)), st.floats(allow_nan=False, allow_infinity=False))
def test_flags_agree_with_the_channels_range(name: str, value: float) -> None:
    flag = quality_flags(pd.DataFrame({name: [value]}))[name][0]
    assert flag == (2 if BY_NAME[name].is_possible_value(value) else 4)


def test_rows_out_of_order_stay_as_they_are_and_are_counted(tmp_path: Path) -> None:
    table = standard(time=[TIMES[0], TIMES[0], TIMES[3], TIMES[2], TIMES[4]], north_m=[0.0, 1.0, 2.0, 3.0, 4.0])
    summary = import_table(csv(tmp_path, table), tmp_path / "out.mcap")
    assert (summary.times_twice, summary.times_backwards) == (1, 1)
    assert read_recording(tmp_path / "out.mcap").series["north_m"].value.tolist() == [0.0, 1.0, 2.0, 3.0, 4.0]


def test_what_is_missing_or_unknown_may_be_allowed_and_is_said(tmp_path: Path) -> None:
    path = csv(tmp_path, standard(Engine=1.0).drop(columns="tunnel_rpm"))
    ship = "gunnerus_short"
    with pytest.raises(InputError, match=r"no tunnel_rpm.*--allow-missing"):
        import_table(path, tmp_path / "out.mcap", ignore_unknown=True, vessel=ship)
    summary = import_table(path, tmp_path / "out.mcap", allow_missing=True, ignore_unknown=True, vessel=ship)
    assert "missing: tunnel_rpm; ignored: Engine" in str(summary)


OWN_LIKE_GUNNERUS = 'name = "sister"\nbase = "gunnerus_short"\n'


@pytest.mark.parametrize(
    ("columns", "map_text", "vessel", "missing"),
    [
        ([], "", None, ()),
        (["port_rpm"], "", None, ()),
        (["port_rpm", "starboard_rpm", "tunnel_rpm"], "", None, ()),
        (["propeller_rpm", "rudder_angle_deg"], "", None, ()),
        ([], "", "kvlcc2_7m", ("propeller_rpm", "rudder_angle_deg")),
        (["port_rpm", "starboard_rpm"], "", "otter_2m", ()),
        (["port_rpm", "port_angle_deg"], "", "sister.toml",
         ("starboard_rpm", "starboard_angle_deg", "tunnel_rpm")),
        (["port_rpm"], '[trial]\nvessel = "MV Unknown"\n', None, ()),
        (["port_rpm"], '[[actuator]]\nname = "port"\nkind = "azimuth"\n', None, ("port_angle_deg",)),
        (["port_rpm"], '[trial]\nvessel = "otter_2m"\n', None, ("starboard_rpm",)),
    ],
)  # fmt: skip
def test_a_table_lacks_controls_of_a_ship_that_is_named_only(
    tmp_path: Path, columns: list[str], map_text: str, vessel: str | None, missing: tuple[str, ...]
) -> None:
    (tmp_path / "sister.toml").write_text(OWN_LIKE_GUNNERUS)
    table = standard()[["time", *MOTION]].assign(**dict.fromkeys(columns, 1.0))
    named = "".join(f'{name} = {{ column = "{name}" }}\n' for name in (*MOTION, *columns))
    (tmp_path / "map.toml").write_text(f'{map_text}[time]\ncolumn = "time"\n[channels]\n{named}')
    given = None if vessel is None else str(tmp_path / vessel) if vessel.endswith(".toml") else vessel
    columns_map = tmp_path / "map.toml" if map_text else None
    options: dict[str, Any] = {"map_path": columns_map, "vessel": given}
    path = csv(tmp_path, table)
    if missing:
        with pytest.raises(InputError, match=f"has no {', '.join(missing)}"):
            import_table(path, tmp_path / "out.mcap", **options)
    summary = import_table(path, tmp_path / "out.mcap", allow_missing=bool(missing), **options)
    assert summary.missing == missing


@pytest.mark.parametrize(
    ("columns", "vessel", "absent"),
    [
        ({}, None, []),
        ({"RPM": 100.0}, None, []),
        ({"Rudder [deg]": 5.0, "RPM": 100.0}, None, []),
        ({"Port thruster [rpm]": 50.0, "Stbd thruster [rpm]": 50.0}, None, []),
        ({"Rudder [deg]": 5.0}, "kvlcc2_7m", ["propeller_rpm"]),
    ],
)
def test_a_proposed_map_lists_no_other_ships_channels_as_absent(
    tmp_path: Path, columns: dict[str, float], vessel: str | None, absent: list[str]
) -> None:
    rows = np.arange(60.0)
    table = pd.DataFrame({
        "Time": pd.date_range("2026-05-17", periods=60, freq="s", tz="UTC").strftime("%Y-%m-%dT%H:%M:%SZ"),
        "Latitude": 63.44 + 3e-5 * rows, "Longitude": 10.4 + 0.0 * rows, "Heading [deg]": 0.0 * rows,
    }).assign(**columns)  # fmt: skip
    proposal = propose_column_map(read_raw_table(csv(tmp_path, table)), None, vessel)
    controls = [name for name in tomllib.loads(proposal.text)["absent"] if name not in MOTION]
    assert controls == absent


def test_semicolons_with_decimal_commas_are_read(tmp_path: Path) -> None:
    path = csv(tmp_path, "time;north_m;east_m;\n2026-05-17T12:00:00Z;1,5;-2,25;\n")
    table = read_table_file(path, allow_missing=True).table
    assert table.iloc[0].tolist() == [1.5, -2.25]


@pytest.mark.usefixtures("read_in_process")
def test_parquet_with_a_time_index_and_mat_with_vectors_or_a_struct(tmp_path: Path) -> None:
    vectors = {"time": EPOCH_S + np.arange(5.0), **{name: np.arange(5.0) for name in NAMES}}
    plain = pd.DataFrame(vectors).drop(columns="time").set_index(pd.DatetimeIndex(TIMES))
    plain.to_parquet(tmp_path / "index.parquet")
    savemat(tmp_path / "vectors.mat", vectors)
    savemat(tmp_path / "struct.mat", {"run": vectors, "comment": "calm"})
    savemat(tmp_path / "trial.mat", {"trial": vectors})  # called as what our exports say of a trial
    for name in ("index.parquet", "vectors.mat", "struct.mat", "trial.mat"):
        pd.testing.assert_frame_equal(read_table_file(tmp_path / name).table, plain, check_index_type=False,
                                      check_names=False, check_freq=False)  # fmt: skip
    savemat(tmp_path / "odd.mat", vectors | {"north_m": np.arange(3.0)})
    with pytest.raises(InputError, match=r"not 5 long: north_m \(3\)"):
        read_table_file(tmp_path / "odd.mat")
    plain.tz_localize(None).to_parquet(tmp_path / "local.parquet")
    with pytest.raises(InputError, match="no zone"):
        read_table_file(tmp_path / "local.parquet")


MAP = """
absent = ["wind_direction_deg", "wind_speed_mps", "sway_mps", "yaw_rate_dps"]
[trial]
name = "mapped"
[time]
column = "t"
format = "seconds"
start = "2026-05-17T12:00:00Z"
[position]
latitude = "lat"
longitude = "lon"
unit = "ddmm"
[channels]
heading_deg = { column = "psi", unit = "rad" }
surge_mps = { column = "u", unit = "knots" }
port_rpm = { column = "n", unit = "percent", full_scale = 200 }
port_angle_deg = { column = "angle", unit = "deg", scale = -1, offset = 10 }
starboard_rpm = { column = "n", unit = "percent", full_scale = 200 }
starboard_angle_deg = { column = "angle" }
tunnel_rpm = { constant = 0 }
"""
FOREIGN = pd.DataFrame(
    {
        "t": [0.0, 0.5, 1.0],
        "lat": [6228.146161, 6228.2, 6229.0],
        "lon": [609.307273, 609.4, 610.0],
        "psi": [-np.pi / 2, 0.0, 2 * np.pi],
        "u": [10.0, 0.0, -10.0],
        "n": [50.0, 0.0, -100.0],
        "angle": [-175.0, 10.0, 0.0],
        "spare": [1.0, 2.0, 3.0],
    }
)


def test_a_map_turns_units_signs_and_degrees_and_minutes(tmp_path: Path) -> None:
    file = read_table_file(csv(tmp_path, FOREIGN), column_map(tmp_path, MAP))
    table = file.table
    assert table["heading_deg"].tolist() == pytest.approx([270.0, 0.0, 0.0])
    assert table["surge_mps"].tolist() == pytest.approx([5.144444, 0.0, -5.144444])
    assert table["port_rpm"].tolist() == [100.0, 0.0, -200.0]
    assert table["port_angle_deg"].tolist() == pytest.approx([-175.0, 0.0, 10.0])
    assert table["latitude_deg"].iloc[0] == pytest.approx(62 + 28.146161 / 60)
    assert (table["north_m"].iloc[0], table["east_m"].iloc[0]) == pytest.approx((0.0, 0.0), abs=1e-6)
    back = pymap3d.ned2geodetic(
        table["north_m"], table["east_m"], 0, file.trial.origin_latitude_deg, file.trial.origin_longitude_deg, 0
    )
    assert back[0] == pytest.approx(table["latitude_deg"].to_numpy(), abs=1e-6)
    assert file.assumed == {"tunnel_rpm": 0.0}
    assert file.passed_over == ("spare",)
    assert table.index[1].isoformat() == "2026-05-17T12:00:00.500000+00:00"


def test_constants_are_recorded_as_assumed(tmp_path: Path) -> None:
    import_table(csv(tmp_path, FOREIGN), tmp_path / "out.mcap", column_map(tmp_path, MAP))
    tunnel = read_recording(tmp_path / "out.mcap").series["tunnel_rpm"]
    assert tunnel.sources == ("assumed",)
    assert tunnel.quality.tolist() == [2, 2, 2]


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        ('column = "psi"', 'column = "psy"', 14),
        ('unit = "knots"', 'unit = "rpm"', 15),
        ("full_scale = 200 }", "fullscale = 200 }", 16),
        ("heading_deg =", "headin_deg =", 14),
        ('latitude = "lat"', 'latitude = "latitude"', 10),
        ("12:00:00Z", "12:00:00", 8),
        ('column = "t"', 'column = "t"\nzone = "Oslo"', 7),
        ("tunnel_rpm = { constant = 0 }", "tunnel_rpm = { unit = 'rpm' }", 20),
    ],
)
def test_a_wrong_map_names_the_line(tmp_path: Path, old: str, new: str, line: int) -> None:
    path = column_map(tmp_path, MAP.replace(old, new, 1))
    with pytest.raises(ConfigurationError, match=rf"map\.toml, line {line}"):
        read_table_file(csv(tmp_path, FOREIGN), path)


def test_a_map_without_a_channel_says_how_to_leave_it_out(tmp_path: Path) -> None:
    path = column_map(tmp_path, MAP.replace('"sway_mps", ', ""))
    with pytest.raises(InputError, match=r"no sway_mps.*absent"):
        read_table_file(csv(tmp_path, FOREIGN), path)
    assert "sway_mps" not in read_table_file(csv(tmp_path, FOREIGN), path, allow_missing=True).table


def test_decimal_degrees_mapped_as_degrees_and_minutes_are_noticed(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="more than 60 minutes"):
        read_table_file(csv(tmp_path, FOREIGN.assign(lat=62.469)), column_map(tmp_path, MAP))


@given(st.floats(-89.9, 89.9))
def test_degrees_and_minutes_invert(degrees: float) -> None:
    whole = np.trunc(degrees)
    ddmm = 100.0 * whole + 60.0 * (degrees - whole)
    assert from_degrees_and_minutes(np.array([ddmm]))[0] == pytest.approx(degrees, abs=1e-9)


@given(
    st.floats(0, 359.9), st.floats(0.1, 40), st.floats(0, 359.9), st.floats(-10, 10), st.floats(-3, 3)
)  # fmt: skip
def test_true_wind_undoes_the_ships_own_motion(
    direction_deg: float, speed_mps: float, heading_deg: float, surge_mps: float, sway_mps: float
) -> None:
    """Apparent wind made of true wind by vectors in the earth frame, and back."""
    psi, wind = np.deg2rad(heading_deg), np.deg2rad(direction_deg)
    ship = complex(surge_mps, sway_mps) * np.exp(1j * psi)
    past_ship = -speed_mps * np.exp(1j * wind) - ship
    angle = np.angle(-past_ship * np.exp(-1j * psi))
    motion = (np.array([value]) for value in (heading_deg, surge_mps, sway_mps))
    found_deg, found_mps = true_wind(np.array([angle]), np.array([abs(past_ship)]), *motion)
    assert found_mps[0] == pytest.approx(speed_mps, abs=1e-9)
    assert abs(np.exp(1j * np.deg2rad(found_deg[0])) - np.exp(1j * wind)) < 1e-6


RUDDER_MAP = """
unreadable_rows = "drop"
[[actuator]]
name = "main"
kind = "propeller"
[[actuator]]
name = "rudder"
kind = "rudder"
[time]
column = "t"
format = "seconds"
zone = "Asia/Tokyo"
in_name = "%d-%b-%Y_%H_%M_%S"
[channels]
north_m = { column = "x", unit = "m" }
east_m = { constant = 0 }
heading_deg = { column = "psi", unit = "rad" }
surge_mps = { column = "u" }
sway_mps = { constant = 0 }
yaw_rate_dps = { column = "r", unit = "rad/s" }
wind_direction_deg = { constant = 0 }
wind_speed_mps = { constant = 0 }
main_rpm = { column = "n", unit = "rps" }
rudder_angle_deg = { column = "delta", unit = "rad" }
"""
TURNING = pd.DataFrame(
    {
        "t": np.arange(0.0, 100.0, 10.0),
        "x": np.arange(10.0),
        "psi": np.arange(10.0) * 2.0 - 1.0,
        "u": 0.5,
        "r": 0.2,
        "n": 10.0,
        "delta": np.pi / 6,
    }
)


def packed(folder: Path, table: pd.DataFrame, ending: str = ".gz") -> Path:
    path = folder / f"turn_14-Sep-2020_13_39_32.csv{ending}"
    table.to_csv(path, index=False)
    return path


@pytest.mark.parametrize("ending", ["", ".gz", ".bz2", ".xz"])
def test_a_rudder_ships_map_names_her_actuators_and_the_file_its_time(tmp_path: Path, ending: str) -> None:
    path, columns = packed(tmp_path, TURNING, ending), column_map(tmp_path, RUDDER_MAP)
    import_table(path, tmp_path / "out.mcap", columns)
    recording = read_recording(tmp_path / "out.mcap")
    assert recording.trial.actuators == "main:propeller, rudder:rudder"
    assert recording.trial.name == "turn_14-Sep-2020_13_39_32"
    assert recording.series["main_rpm"].value.tolist() == [600.0] * 10
    assert recording.series["rudder_angle_deg"].value == pytest.approx([30.0] * 10)
    assert recording.series["yaw_rate_dps"].value == pytest.approx(np.rad2deg([0.2] * 10))
    times = recording.series["north_m"].measured_ns
    assert pd.Timestamp(times[0], tz="UTC").isoformat() == "2020-09-14T04:39:32+00:00"
    last = column_map(tmp_path, RUDDER_MAP.replace("in_name", 'name_tells = "end"\nin_name'))
    assert read_table_file(path, last).table.index[-1].isoformat() == "2020-09-14T04:39:32+00:00"


def test_a_heading_that_runs_on_is_wrapped_and_a_sentinel_is_not(tmp_path: Path) -> None:
    """17 rad are two turns and more; 9999 rad is no heading, wherever the others run to."""
    psi = TURNING["psi"].where(TURNING.index != 4, 9999.0)
    found = read_table_file(packed(tmp_path, TURNING.assign(psi=psi)), column_map(tmp_path, RUDDER_MAP)).table
    heading = found["heading_deg"].to_numpy()
    others = np.arange(10) != 4
    assert heading[others] == pytest.approx(np.rad2deg(psi[others]) % 360.0)
    assert heading[4] == pytest.approx(np.rad2deg(9999.0))


def test_rows_that_cannot_be_read_are_dropped_with_a_count_where_a_map_says_so(tmp_path: Path) -> None:
    faulty = TURNING.astype(object)
    faulty.loc[2, "u"] = "#NAME?"
    faulty.loc[3, "t"] = None
    faulty.loc[4, ["t", "u"]] = "lost"
    faulty.loc[5, "u"] = None  # an empty cell is a missing value, and the row stays
    path = packed(tmp_path, faulty)
    summary = import_table(path, tmp_path / "out.mcap", column_map(tmp_path, RUDDER_MAP))
    assert (summary.rows, summary.dropped) == (7, {"without a time": 2, "with text for a number": 1})
    assert "2 rows without a time dropped; 1 row with text for a number dropped" in str(summary)
    series = read_recording(tmp_path / "out.mcap").series
    assert series["north_m"].value.tolist() == [0.0, 1.0, 5.0, 6.0, 7.0, 8.0, 9.0]
    assert series["surge_mps"].value.size == 6
    with pytest.raises(InputError, match="row 5 of column 't' is not a number: 'lost'"):
        read_table_file(path, column_map(tmp_path, RUDDER_MAP.replace('unreadable_rows = "drop"', "")))
    faulty["t"] = "lost"
    with pytest.raises(InputError, match="has no readable row: 10 without a time"):
        read_table_file(packed(tmp_path, faulty), column_map(tmp_path, RUDDER_MAP))


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('kind = "rudder"', 'kind = "sail"', r"map\.toml, line \d+: actuator rudder: no kind 'sail'"),
        ("%d-%b", "%d-%Q", "line 13.*no time such as"),
        ("main_rpm =", "port_rpm =", "port_rpm.*not a channel of a ship with actuators main, rudder"),
        ('zone = "Asia/Tokyo"', "", "in_name is for seconds, with a zone"),
    ],
)
def test_a_rudder_ships_wrong_map_says_what_is_wrong(tmp_path: Path, old: str, new: str, says: str) -> None:
    with pytest.raises(ConfigurationError, match=says):
        read_table_file(packed(tmp_path, TURNING), column_map(tmp_path, RUDDER_MAP.replace(old, new, 1)))


def test_a_file_without_a_time_in_its_name_is_told_so(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="holds no time like %d-%b-%Y_%H_%M_%S in its name"):
        read_table_file(csv(tmp_path, TURNING), column_map(tmp_path, RUDDER_MAP))


def test_info_shows_a_columns_unit_in_brackets(tmp_path: Path) -> None:
    from typer.testing import CliRunner

    from seatrial import app

    columns = column_map(tmp_path, RUDDER_MAP.replace('"x"', '"x [m]"'))
    import_table(packed(tmp_path, TURNING.rename(columns={"x": "x [m]"})), tmp_path / "out.mcap", columns)
    shown = CliRunner().invoke(app, ["info", str(tmp_path / "out.mcap")], env={"COLUMNS": "200"})
    assert "table: x [m]" in shown.output


LONG_MAP = """
absent = ["yaw_rate_dps"]
[time]
column = "timestamp"
zone = "UTC"
[long]
variable = "var"
unit = "unit"
[trial]
name = "long"
origin = { latitude_deg = 63.44, longitude_deg = 10.4 }
[channels]
heading_deg = { column = "ship/MRU/Heading" }
surge_mps = { column = "ship/Vbw/Ahead" }
sway_mps = { column = "ship/Vbw/Aside", unit = "m/s" }
"""


def long_table(path: Path) -> None:
    rows = ["timestamp;var;value;unit", "2024-09-10 06:30:01.5;ship/Mode;None;"]
    for second in (3, 1, 2):
        rows += [f"2024-09-10 06:30:0{second};ship/MRU/Heading;{second}.5;deg"]
        rows += [f"2024-09-10 06:30:0{second};ship/Vbw/Ahead;{second};knots"] * (2 if second == 2 else 1)
    path.write_text("\n".join([*rows, "2024-09-10 06:30:07;ship/Vbw/Aside;0.5;knots"]))


def test_a_long_table_is_read_through_its_map(tmp_path: Path) -> None:
    """A row a value, its unit beside it unless the map says another; in the file's order, gaps left empty."""
    long_table(tmp_path / "long.csv")
    (tmp_path / "map.toml").write_text(LONG_MAP)
    file = read_table_file(tmp_path / "long.csv", tmp_path / "map.toml", allow_missing=True)
    assert [each.second for each in file.table.index] == [3, 1, 2, 7]
    assert file.table["heading_deg"].tolist()[:3] == [3.5, 1.5, 2.5]
    assert file.table["surge_mps"].tolist()[:3] == pytest.approx([3 * KNOT_MPS, KNOT_MPS, 2 * KNOT_MPS])
    assert file.table["sway_mps"].tolist()[3] == 0.5
    assert file.table["heading_deg"].isna().tolist() == [False, False, False, True]
    assert file.passed_over == ("ship/Mode",)
    assert file.dropped == {"twice of one variable and time": 1}


def test_a_variable_that_a_long_table_has_not_is_named_with_what_may_be_meant(tmp_path: Path) -> None:
    long_table(tmp_path / "long.csv")
    (tmp_path / "map.toml").write_text(LONG_MAP.replace("MRU/Heading", "MRU/Heeding"))
    with pytest.raises(ConfigurationError, match="did you mean 'ship/MRU/Heading'") as caught:
        read_table_file(tmp_path / "long.csv", tmp_path / "map.toml", allow_missing=True)
    assert "map.toml, line 13" in str(caught.value)


def test_a_long_table_of_channels_needs_no_map(tmp_path: Path) -> None:
    text = "timestamp;variable;value;unit\n2026-05-17T12:00:00Z;heading_deg;1.5;rad\n"
    (tmp_path / "long.csv").write_text(
        f"{text}2026-05-17T12:00:01Z;surge_mps;3;\n2026-05-17T12:00:01Z;fuel;3;l/h\n"
    )
    file = read_table_file(tmp_path / "long.csv", allow_missing=True)
    assert file.table["heading_deg"].dropna().tolist() == pytest.approx([np.rad2deg(1.5)])
    assert file.table["surge_mps"].dropna().tolist() == [3.0]
    assert file.passed_over == ("fuel",)


@pytest.mark.usefixtures("read_in_process")
def test_channel_that_is_computed_from_others_is_said(tmp_path: Path) -> None:
    """With those that it is from, beside what the table lacks: nobody takes it for measured."""
    table = pd.DataFrame({"time": TIMES, "Heading [deg]": np.linspace(10.0, 30.0, 5), "Rudder [deg]": np.zeros(5),
                          "Speed [mrad/s]": np.zeros(5)})  # fmt: skip
    table.to_csv(tmp_path / "trip.csv", index=False)
    done = seatrial.import_table(tmp_path / "trip.csv", tmp_path / "trip.mcap", yes=True, allow_missing=True)
    assert "yaw_rate_dps from heading_deg" in str(done)
    rate = table.drop(columns="Speed [mrad/s]").assign(**{"ROT [mrad/s]": np.full(5, 50.0)})
    rate.to_csv(tmp_path / "rate.csv", index=False)
    done = seatrial.import_table(tmp_path / "rate.csv", tmp_path / "rate.mcap", yes=True, allow_missing=True)
    assert "derived" not in str(done)
    recorded = seatrial.read(tmp_path / "rate.mcap")["yaw_rate_dps"].dropna()
    np.testing.assert_allclose(recorded, np.degrees(0.05))
