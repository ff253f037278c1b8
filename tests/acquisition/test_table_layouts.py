"""Layouts of tables as loggers and programs write them, hemispheres by words, and names of a ship's own."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pymap3d
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seatrial.acquisition.core.errors import InputError
from seatrial.acquisition.core.quantities import Floats
from seatrial.acquisition.tables.column_map import (
    hemisphere_signs,
    infer_hemisphere_of_letter_o,
    parse_positions_in_degrees,
)
from seatrial.acquisition.tables.import_table import is_standard_table, propose_column_map
from seatrial.acquisition.tables.table_files import read_raw_table
from seatrial.analysis.tables.table import read_table
from tests.conftest import Command, nightly

ROWS = 60
HEADING = 120.0 + 0.5 * np.arange(ROWS)
LATITUDE, LONGITUDE = 63.44 + 2e-5 * np.arange(ROWS), 10.4 + 3e-5 * np.arange(ROWS)
TIMES = [f"2026-05-17T12:00:{second:02d}Z" for second in range(ROWS)]


def rows(separator: str = ",") -> list[str]:
    return [
        separator.join((time, f"{latitude:.7f}", f"{longitude:.7f}", f"{heading:.2f}"))
        for time, latitude, longitude, heading in zip(TIMES, LATITUDE, LONGITUDE, HEADING, strict=True)
    ]


def recorded(command: Command, path: Path, *options: object) -> pd.DataFrame:
    """The recording that ``import --yes`` makes of a file."""
    output = path.with_suffix(".mcap")
    done = command("import", path, "-o", output, "--yes", "--force", *options)
    assert done.code == 0, done.err
    return read_table(output)


def assert_all_rows(found: pd.DataFrame) -> None:
    assert found["heading_deg"].to_numpy() == pytest.approx(HEADING)
    assert found["latitude_deg"].to_numpy() == pytest.approx(LATITUDE, abs=1e-7)
    assert found["longitude_deg"].to_numpy() == pytest.approx(LONGITUDE, abs=1e-7)


@pytest.mark.parametrize("every", [7, *nightly(20, 59)])
@pytest.mark.parametrize("head", [["time,lat,lon,heading"], ["time,lat,lon,heading", "UTC,deg,deg,deg"]])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_a_header_that_is_repeated_costs_no_row(
    tmp_path: Path, command: Command, every: int, head: list[str], end: str
) -> None:
    lines = [line for row, text in enumerate(rows()) for line in ([*head, text] if row % every == 0 else [text])]
    path = tmp_path / "t.csv"
    path.write_bytes(end.join([*lines, ""]).encode())
    done = command("import", path, "-o", tmp_path / "t.mcap", "--yes")
    assert "header is repeated" in done.err
    assert_all_rows(read_table(tmp_path / "t.mcap"))


@pytest.mark.parametrize(
    "head",
    [
        ["Clock,Position,,Gyro", "UTC,Lat,Lon,Heading"],
        ["Time,Latitude,Longitude,True", "UTC,WGS 84,WGS 84,heading"],
        ["Time,Lat,Lon,Heading", "[UTC],[°],[°],[°]"],
        ["Report of a trial,,,", "Yard,Harbour,,", "Time,Lat,Lon,Heading", "UTC,deg,deg,deg"],
        ["TOA5,ship,CR1000,3", "TIMESTAMP,Lat,Lon,Heading", "TS,deg,deg,deg", ",Smp,Smp,Smp"],
    ],
)
@pytest.mark.parametrize("suffix", ["csv", *nightly("xlsx")])
def test_headers_of_several_rows(tmp_path: Path, command: Command, head: list[str], suffix: str) -> None:
    lines = [line.split(",") for line in [*head, *rows()]]
    path = tmp_path / f"t.{suffix}"
    if suffix == "csv":
        path.write_text("\n".join(map(",".join, lines)) + "\n")
    else:
        pytest.importorskip("python_calamine")
        openpyxl = pytest.importorskip("openpyxl")
        book = openpyxl.Workbook()
        for line in lines:
            book.active.append([float(cell) if re.fullmatch(r"[\d.]+", cell) else cell or None for cell in line])
        book.save(path)
    assert_all_rows(recorded(command, path))


def test_speed_below_wind_is_the_winds(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    body = "".join(f"{text},{5 + row / 10},{200 + row}\n" for row, text in enumerate(rows()))
    path.write_text(f"Clock,GPS,,Gyro,True wind,\nUTC,Lat,Lon,Heading,Speed,Direction\n{body}")
    taken = {
        each.column: each.taken_for
        for each in propose_column_map(read_raw_table(path), {"unit.wind": "m/s"}).readings
    }
    assert taken["True wind Speed"] == "wind_speed_mps"
    assert taken["True wind Direction"] == "wind_direction_deg"


@pytest.mark.parametrize(
    "content",
    [
        b"\xef\xbb\xbf%s", b"\xef\xbb\xbf\xef\xbb\xbf%s", b"%s", b"\xef\xbb\xbf%s|utf-16-le", b"%s|utf-16-be",
    ],
)  # fmt: skip
def test_a_byte_order_mark_is_no_part_of_a_name(tmp_path: Path, command: Command, content: bytes) -> None:
    form, _, encoding = content.partition(b"|")
    text = "\n".join(["time,lat,lon,heading", *rows(), ""])
    written = text.encode(encoding.decode() or "utf-8")
    path = tmp_path / "t.csv"
    path.write_bytes(form.replace(b"%s", written) if not encoding else written)
    assert_all_rows(recorded(command, path))


@pytest.mark.parametrize("separator", [" ", "\t", ",", ";"])
@pytest.mark.parametrize("suffix", ["dat", *nightly("txt", "csv")])
def test_a_table_without_names_says_so_and_takes_a_map(
    tmp_path: Path, command: Command, separator: str, suffix: str
) -> None:
    path = tmp_path / f"t.{suffix}"
    path.write_text("\n".join(rows(separator)) + "\n")
    refused = command("import", path, "-o", tmp_path / "t.mcap", "--yes")
    assert refused.code == 1
    assert "no row of names" in refused.err
    assert "'column 4'" in refused.err
    (tmp_path / "map.toml").write_text(
        'derive = ["yaw_rate_dps"]\nabsent = ["surge_mps", "sway_mps", "wind_direction_deg", "wind_speed_mps",'
        ' "port_rpm", "port_angle_deg", "starboard_rpm", "starboard_angle_deg", "tunnel_rpm"]\n'
        '[time]\ncolumn = "column 1"\n'
        '[position]\nlatitude = "column 2"\nlongitude = "column 3"\n'
        '[channels]\nheading_deg = { column = "column 4" }\n'
    )
    assert_all_rows(recorded(command, path, "--columns", tmp_path / "map.toml"))


def test_labviews_measurement_has_its_start_in_its_head(tmp_path: Path, command: Command) -> None:
    head = (
        "LabVIEW Measurement\t\nWriter_Version\t2\nSeparator\tTab\nDate\t2026/05/17\nTime\t11:59:58.0\n"
        "***End_of_Header***\t\n\t\nChannels\t1\t\nSamples\t60\t\nDate\t2026/05/17\t\nTime\t12:00:00.0\t\n"
        "X_Dimension\tTime\t\nX0\t0.0E+0\t\nDelta_X\t1.0\t\n***End_of_Header***\t\t\nX_Value\tHeading\tComment\n"
    )
    path = tmp_path / "t.lvm"
    path.write_text(head + "".join(f"{row}.000000\t{heading}\t\n" for row, heading in enumerate(HEADING)))
    found = recorded(command, path)
    assert found["heading_deg"].to_numpy() == pytest.approx(HEADING)
    assert found.index[0] == pd.Timestamp("2026-05-17T12:00:00Z")


@pytest.mark.parametrize("comma", [False, True])
def test_segments_of_labview_count_from_their_own_starts(tmp_path: Path, command: Command, comma: bool) -> None:
    text = "LabVIEW Measurement\t\nSeparator\tTab\nDate\t2026/05/17\nTime\t11:59:58.0\n***End_of_Header***\t\n\t\n"
    for first, start in ((0, "12:00:00.0"), (20, "12:00:25.5"), (40, "12:10:00.0")):
        text += (
            f"Channels\t1\t\nSamples\t20\t\nDate\t2026/05/17\t\nTime\t{start}\t\nX_Dimension\tTime\t\n"
            "X0\t0.0E+0\t\n***End_of_Header***\t\t\nX_Value\tHeading\tComment\n"
        )
        text += "".join(f"{row:.6f}\t{HEADING[first + row]}\t\n" for row in range(20)) + "\n"
    path = tmp_path / "t.lvm"
    path.write_text(text.replace(".", ",") if comma else text)
    found = recorded(command, path)
    assert found["heading_deg"].to_numpy() == pytest.approx(HEADING)
    seconds = (found.index - pd.Timestamp("2026-05-17T12:00:00Z")).total_seconds()
    assert seconds[[0, 19, 20, 39, 40, 59]].to_list() == [0.0, 19.0, 25.5, 44.5, 600.0, 619.0]


def test_segments_of_labview_with_other_columns_or_no_start_are_refused(tmp_path: Path, command: Command) -> None:
    head = "LabVIEW Measurement\t\nSeparator\tTab\n***End_of_Header***\t\n"
    first = "Channels\t1\nDate\t2026/05/17\nTime\t12:00:00\n***End_of_Header***\nX_Value\tHeading\n0\t1\n1\t2\n"
    path = tmp_path / "t.lvm"
    for second, why in (
        (first.replace("Heading", "Wind"), "other columns"),
        ("Channels\t1\n" + first.partition("12:00:00\n")[2], "no start"),
    ):
        path.write_text(head + first + second)
        refused = command("import", path, "-o", tmp_path / "t.mcap", "--yes")
        assert refused.code == 1
        assert "segment 2 of this LabVIEW measurement" in refused.err
        assert why in refused.err


RTKLIB_HEAD = "% program   : RTKPOST ver.2.4.2\n% obs start : 2026/05/17 12:00:18.0 GPST (week2419   43218.0s)\n%\n"
RTKLIB_REST = "Q  ns   sdn(m)   sde(m)   sdu(m)  sdne(m)  sdeu(m)  sdun(m) age(s)  ratio"


def rtklib(system: str, places: str, time: Callable[[int], str], place: Callable[[int], str]) -> str:
    behind = "   9   0.0100   0.0100   0.0200   0.0000   0.0000   0.0000   1.00    5.0"
    lines = [f"{time(row)}  {place(row)}   50.1234   {2 - row % 2}{behind}" for row in range(ROWS)]
    return "\n".join([f"{RTKLIB_HEAD}%  {system}   {places}  height(m)   {RTKLIB_REST}", *lines, ""])


def degrees_at(row: int) -> str:
    return f"{LATITUDE[row]:.9f}   {LONGITUDE[row]:.9f}"


RTKLIB_TIMES: dict[str, tuple[str, Callable[[int], str]]] = {
    "gpst": (
        "GPST",
        lambda row: f"2026/05/17 {12 + (row + 18) // 3600:02d}:{(row + 18) // 60:02d}:{(row + 18) % 60:02d}.000",
    ),
    "utc": ("UTC ", lambda row: f"2026/05/17 12:00:{row:02d}.000"),
    "jst": ("JST ", lambda row: f"2026/05/17 21:00:{row:02d}.000"),
    "week": ("GPST", lambda row: f"2419  {43_218 + row:.3f}"),
}


@pytest.mark.parametrize("form", RTKLIB_TIMES)
@pytest.mark.parametrize("separator", ["  ", *nightly(",", "\t")])
def test_solutions_of_rtklib_are_read_in_their_time(
    tmp_path: Path, command: Command, form: str, separator: str
) -> None:
    text = rtklib(RTKLIB_TIMES[form][0], "latitude(deg) longitude(deg)", RTKLIB_TIMES[form][1], degrees_at)
    if separator != "  ":
        head, _, body = text.partition("%  ")
        text = (
            head + "%  " + re.sub(r"[ \t]+", separator, body) if form == "week" else text.replace("   ", separator)
        )
    path = tmp_path / "t.pos"
    path.write_text(text)
    found = recorded(command, path)
    assert found.index[0] == pd.Timestamp("2026-05-17T12:00:00Z")
    assert found.index[-1] == pd.Timestamp("2026-05-17T12:00:59Z")
    assert found["latitude_deg"].to_numpy() == pytest.approx(LATITUDE, abs=1e-8)
    said = command("import", path, "-o", path.with_suffix(".mcap"), "--yes", "--force").err
    assert "30 fixed, 30 float" in said
    assert ("leap seconds" in said) == (form in ("gpst", "week"))


def test_degrees_minutes_and_the_earths_centre_of_rtklib(tmp_path: Path, command: Command) -> None:
    def sexagesimal(angle: float) -> str:
        minutes, seconds = divmod(abs(angle) * 3600.0, 60.0)
        return f"{'-' if angle < 0 else ''}{int(minutes) // 60} {int(minutes) % 60:02d} {seconds:08.5f}"

    def centre(row: int) -> str:
        return " ".join(
            f"{each:.4f}" for each in pymap3d.geodetic2ecef(-LATITUDE[row], -LONGITUDE[row] / 100, 50.0)
        )

    system, time = RTKLIB_TIMES["utc"]
    path = tmp_path / "t.pos"
    by_minutes = rtklib(
        system,
        "latitude(d'\") longitude(d'\")",
        time,
        lambda row: f"{sexagesimal(-LATITUDE[row])} {sexagesimal(-LONGITUDE[row] / 100)}",
    )
    by_centre = rtklib(system, "x-ecef(m) y-ecef(m) z-ecef(m)", time, centre)
    by_centre = by_centre.replace("  height(m)", "").replace("   50.1234", "")
    for text in (by_minutes, by_centre):
        path.write_text(text)
        found = recorded(command, path)
        assert found["latitude_deg"].to_numpy() == pytest.approx(-LATITUDE, abs=2e-8)
        assert found["longitude_deg"].to_numpy() == pytest.approx(-LONGITUDE / 100, abs=2e-8)


def test_a_damaged_line_of_rtklib_is_named(tmp_path: Path, command: Command) -> None:
    path = tmp_path / "t.pos"
    path.write_text(
        rtklib("UTC", "latitude(deg) longitude(deg)", RTKLIB_TIMES["utc"][1], degrees_at)
        + "2026/05/17 12:01:00.000 63.4\n"
    )
    refused = command("import", path, "-o", tmp_path / "t.mcap", "--yes")
    assert refused.code == 1
    assert f"line {ROWS + 5} has 3 cells, the header 15" in refused.err


def test_expeditions_pairs_are_its_own_boats(tmp_path: Path, command: Command) -> None:
    lines = ["!Boat,Utc,BSP,HDG,LAT,LON,SOG", "!boat,0,1,13,48,49,51", "!v11.10"]
    for row in range(ROWS):
        day = 46159.5 + row / 86_400.0
        pairs = (
            f"13,{HEADING[row]},48,{LATITUDE[row]:.7f}" if row % 2 else f"48,{LATITUDE[row]:.7f},13,{HEADING[row]}"
        )
        lines += [f"0,{day:.8f},{pairs},49,{LONGITUDE[row]:.7f},51,9.7", f"1,{day:.8f},49,11.0,48,60.0"]
    path = tmp_path / "t.csv"
    path.write_text("\n".join(lines) + "\n")
    found = recorded(command, path)
    assert_all_rows(found)
    assert found["speed_over_ground_mps"].to_numpy() == pytest.approx(9.7 * 1852 / 3600)
    path.write_text("\n".join([*lines, "0,46159.6,13"]) + "\n")
    with pytest.raises(InputError, match=r"line 124 .*pairs"):
        read_raw_table(path)


@pytest.mark.parametrize(
    "head",
    ["Time Stamp,ID,Extended,Dir,Bus,LEN,D1,D2,D3,D4,D5,D6,D7,D8",
     "timestamp,arbitration_id,extended,remote,error,dlc,data", "Time,CAN ID,Data", "ts,id,dlc,d0,d1,d2,d3"],
)  # fmt: skip
def test_frames_of_a_bus_are_called_so(tmp_path: Path, head: str) -> None:
    path = tmp_path / "t.csv"
    path.write_text(f"{head}\n" + ("0," * head.count(",") + "00\n") * 5)
    with pytest.raises(InputError, match=r"frames of a CAN bus.*record"):
        read_raw_table(path)


@pytest.mark.parametrize(
    ("content", "says"),
    [("time,heading\n2026-05-17T12:00:00Z,1\n2026-05-17T12:00:01Z,1,2\n", "line 3 has 3 cells, the header 2"),
     ("# log\n\ntime,heading\n2026-05-17T12:00:00Z,1,2,3\n", "line 4 has 4 cells, the header 2")],
)  # fmt: skip
def test_a_row_too_long_is_named_in_our_own_words(tmp_path: Path, content: str, says: str) -> None:
    path = tmp_path / "t.csv"
    path.write_text(content)
    with pytest.raises(InputError, match=says) as caught:
        read_raw_table(path)
    assert "tokeniz" not in str(caught.value)


@pytest.mark.parametrize("suffix", [".xlsx", ".parquet", ".mat", ".nc"])
def test_a_damaged_file_gives_no_librarys_message(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"t{suffix}"
    path.write_bytes(b"PK\x03\x04" + bytes(range(256)) * 4)
    with pytest.raises(
        InputError, match=r"damaged, cut short, or of another kind|takes too much|needs the package"
    ):
        read_raw_table(path)


HEMISPHERES = [
    ("N/S", "E/W"), ("North/South", "East/West"), ("Nord/Süd", "Ost/West"), ("Nord/Sud", "Est/Ouest"),
    ("Norte/Sur", "Este/Oeste"), ("Noord/Zuid", "Oost/West"), ("Nord/Syd", "Øst/Vest"), ("n/s", "L/O"),
    ("norte/sul", "Leste/Oeste"), ("N/S", "Ø/V"), ("北/南", "东/西"), ("север/юг", "восток/запад"),
]  # fmt: skip


def positions(latitude: Floats, longitude: Floats, letters: tuple[str, str], heads: tuple[str, str]) -> str:
    lines = [f"time;lat;{heads[0]};lon;{heads[1]};heading"]
    for time, north, east in zip(TIMES, latitude, longitude, strict=True):
        lines.append(f"{time};{abs(north):.7f};{letters[0]};{abs(east):.7f};{letters[1]};120")
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize(("north_south", "east_west"), HEMISPHERES)
@pytest.mark.parametrize("place", [-1, *nightly(1)])
@pytest.mark.parametrize("heads", [("a", "b"), *nightly(["N/S", "E/W"], ["Hemisphere lat", "Hemisphere lon"])])
def test_hemispheres_by_words_of_many_languages(
    tmp_path: Path, command: Command, north_south: str, east_west: str, place: int, heads: tuple[str, str]
) -> None:
    letters = north_south.split("/")[place < 0], east_west.split("/")[place < 0]
    if letters[1] == "O" and heads[1] != "O/L":
        heads = heads[0], "L/O"
    path = tmp_path / "t.csv"
    path.write_text(positions(LATITUDE, LONGITUDE, letters, heads), encoding="utf-8")
    found = recorded(command, path)
    assert found["latitude_deg"].to_numpy() == pytest.approx(place * LATITUDE, abs=1e-7)
    assert found["longitude_deg"].to_numpy() == pytest.approx(place * LONGITUDE, abs=1e-7)


@pytest.mark.parametrize("word", ["Foo", "X", "Nowhere", "E", "0", "NS"])
def test_a_hemisphere_that_is_not_known_is_refused(tmp_path: Path, word: str) -> None:
    path = tmp_path / "t.csv"
    path.write_text(positions(LATITUDE, LONGITUDE, (word, "E"), ("N/S", "E/W")))
    with pytest.raises(InputError, match=f"hemisphere that is not known: .*{word}"):
        propose_column_map(read_raw_table(path))


def test_an_unclear_o_is_asked_and_the_answer_stays_in_the_map(tmp_path: Path, command: Command) -> None:
    path = tmp_path / "t.csv"
    path.write_text(positions(LATITUDE, LONGITUDE, ("N", "O"), ("N/S", "E/W")))
    assert [each.key for each in propose_column_map(read_raw_table(path)).unanswered] == ["o_is"]
    for answer, sign in (("east", 1), ("west", -1)):
        found = recorded(command, path, "--answer", f"o_is={answer}")
        assert found["longitude_deg"].to_numpy() == pytest.approx(sign * LONGITUDE, abs=1e-7)


def test_a_negative_angle_of_the_north_is_refused_and_of_the_south_is_south(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_text("time,lat,N/S,lon,E/W\n" + "".join(f"{time},-33.9,N,18.4,E\n" for time in TIMES))
    with pytest.raises(InputError, match="negative"):
        propose_column_map(read_raw_table(path))
    assert hemisphere_signs(pd.Series(["S", "S"]), "north_south").tolist() == [-1.0, -1.0]


WORDS = {"N": "North", "S": "South", "E": "East", "W": "West"}
TEXTS = {
    "6326.4000N": lambda a, p, n: f"{int(a):02d}{60 * (a % 1):07.4f}{p if n else '-'}",
    "63°26.4000'N": lambda a, p, n: f"{int(a)}°{60 * (a % 1):07.4f}'{p}",
    "N 63 26.4000": lambda a, p, n: f"{p} {int(a)} {60 * (a % 1):07.4f}",
    "63 deg 26.4 min N": lambda a, p, n: f"{int(a)} deg {60 * (a % 1):07.4f} min {p}",
    "63.44 North": lambda a, p, n: f"{a:.7f} {WORDS[p]}",
    "63d26m24.0s N": lambda a, p, n: f"{int(a)}d{int(60 * (a % 1))}m{3600 * a % 60:07.4f}s {p}",
    "6326.4000,N": lambda a, p, n: f"{int(a):03d}{60 * (a % 1):07.4f} {p}",
}


@pytest.mark.parametrize("form", TEXTS)
@given(north=st.floats(-89.9, 89.9), east=st.floats(-179.9, 179.9))
def test_positions_as_text_come_back(form: str, north: float, east: float) -> None:
    def written(angle: float, letters: str) -> str:
        size = round(abs(angle) * 36_000) / 36_000 + 1e-9
        return str(TEXTS[form](size, letters[angle < 0], True))

    column = pd.Series([written(north, "NS"), written(60.5, "NS")])
    other = pd.Series([written(east, "EW"), written(100.5, "EW")])
    sizes, signs = parse_positions_in_degrees(column, other)
    for values, sign, angle in zip(sizes, signs, (north, east), strict=True):
        assert values[0] * sign[0] == pytest.approx(angle, abs=2e-4 / 60 + 2e-5)


@pytest.mark.parametrize(
    ("words", "name", "meaning"),
    [(["o", "e"], "lon", "west"), (["o", "w"], "lon", "east"), (["o"], "E/O", "west"), (["o"], "O/W", "east"),
     (["o", "l"], "lon", "west"), (["o", "v"], "lon", "east"), (["o"], "E/W", None), (["o"], "lon", None),
     (["o", "w"], "E/O", "east")],
)  # fmt: skip
def test_what_an_o_means(words: list[str], name: str, meaning: str | None) -> None:
    assert infer_hemisphere_of_letter_o(words, name) == meaning


@pytest.mark.parametrize(
    ("head", "channel"),
    [("time,heading_deg,sog_kn", "speed_over_ground_mps"),
     ("time,north_m,east_m,heading_deg,ROT [deg/min]", "yaw_rate_dps"),
     ("time,wind_speed_mps,wind_direction_deg,Kurs über Grund [°]", "course_over_ground_deg")],
)  # fmt: skip
def test_exact_standard_names_switch_no_recognition_off(tmp_path: Path, head: str, channel: str) -> None:
    path = tmp_path / "t.csv"
    path.write_text(
        f"{head}\n" + "".join(time + ",10" * head.count(",") + "\n" for time in TIMES), encoding="utf-8"
    )
    raw = read_raw_table(path)
    assert not is_standard_table(raw)
    taken = {each.taken_for for each in propose_column_map(raw).readings}
    assert {channel, *(name for name in head.split(",") if name[-4:] in ("_mps", "_deg"))} <= taken


@pytest.mark.parametrize("form", ["{} rpm", "{}_rpm", "{} [rpm]", "{} rpm [1/min]", "{} rpm (rps)"])
def test_columns_called_as_the_ships_own_thrusters_are_theirs(tmp_path: Path, form: str) -> None:
    otter = (Path(__file__).parents[2] / "trials" / "vessels" / "otter_2m.toml").read_text()
    vessel = tmp_path / "ship.toml"
    vessel.write_text(otter.replace('name = "port"', 'name = "t1"').replace('name = "starboard"', 'name = "t2"'))
    path = tmp_path / "t.csv"
    path.write_text(
        f"time,heading,{form.format('t1')},{form.format('t2')}\n" + "".join(f"{time},90,5,6\n" for time in TIMES)
    )
    taken = {each.taken_for for each in propose_column_map(read_raw_table(path), vessel=vessel).readings}
    assert {"t1_rpm", "t2_rpm"} <= taken


@pytest.mark.parametrize(
    "name", ["yaw_setpoint", "Heading order", "desired heading", "SOG ref [kn]", "Kurs Soll [°]"]
)
def test_what_is_wanted_of_the_motion_is_not_the_motion(tmp_path: Path, name: str) -> None:
    path = tmp_path / "t.csv"
    path.write_text(
        f"time,lat,lon,{name}\n" + "".join(f"{time},63.4,10.4,90\n" for time in TIMES), encoding="utf-8"
    )
    assert name not in {each.column for each in propose_column_map(read_raw_table(path)).readings}


@pytest.mark.parametrize(("north", "west"), [("с.ш.", "з.д."), ("с. ш.", "з. д."), ("сш", "зд"), ("С.Ш.", "З.Д.")])
def test_hemispheres_of_two_letters_in_russian(north: str, west: str) -> None:
    latitude, longitude = (
        pd.Series([f"63.44 {north}", f"63°26.4' {north}"]),
        pd.Series([f"10.4 {west}", f"10°24' {west}"]),
    )
    angles, signs = parse_positions_in_degrees(latitude, longitude)
    assert np.concatenate(angles) == pytest.approx([63.44, 63.44, 10.4, 10.4])
    assert [each.tolist() for each in signs] == [[1.0, 1.0], [-1.0, -1.0]]
    assert hemisphere_signs(pd.Series([north, "ю.ш."]), "north_south").tolist() == [1.0, -1.0]


def test_rows_without_a_fix_have_no_position_nor_speed(tmp_path: Path, command: Command) -> None:
    """Latitude and longitude 0 would be a ship that stands still for as long."""
    latitude, longitude = LATITUDE.copy(), LONGITUDE.copy()
    latitude[20:35] = longitude[20:35] = 0.0
    path = tmp_path / "t.csv"
    path.write_text(
        "time,lat,lon,heading\n"
        + "\n".join(
            f"{t},{a:.7f},{b:.7f},{h}" for t, a, b, h in zip(TIMES, latitude, longitude, HEADING, strict=True)
        )
        + "\n"
    )
    done = command("import", path, "-o", tmp_path / "t.mcap", "--yes")
    assert "15 rows at latitude 0, longitude 0" in done.err
    found = read_table(tmp_path / "t.mcap")
    for name in ("latitude_deg", "north_m", "surge_mps"):
        assert np.isnan(found[name].to_numpy()[22:33]).all(), name
    assert np.nanmin(np.hypot(found["surge_mps"], found["sway_mps"])) > 2.0


@pytest.mark.parametrize(
    ("unit", "factor"), [("kn", 1852 / 3600), (" kn", 1852 / 3600), (" km/h", 1 / 3.6), ("m/s", 1.0)]
)
@pytest.mark.parametrize("comma", [False, True])
def test_a_unit_behind_each_number_is_the_columns(
    tmp_path: Path, command: Command, unit: str, factor: float, comma: bool
) -> None:
    lines = ["time;lat;lon;heading;SOG"]
    for time, latitude, longitude, heading in zip(TIMES, LATITUDE, LONGITUDE, HEADING, strict=True):
        cells = (f"{latitude:.7f}", f"{longitude:.7f}", f"{heading}°", f"7.5{unit}")
        lines.append(";".join((time, *(cell.replace(".", ",") if comma else cell for cell in cells))))
    path = tmp_path / "t.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    found = recorded(command, path)
    assert_all_rows(found)
    assert found["speed_over_ground_mps"].to_numpy() == pytest.approx(7.5 * factor)


def test_letters_of_hemispheres_are_no_units_and_units_that_change_none(tmp_path: Path, command: Command) -> None:
    path = tmp_path / "t.csv"
    body = [
        f"{time},{latitude:.7f} N,{longitude:.7f} E,{heading}"
        for time, latitude, longitude, heading in zip(TIMES, LATITUDE, LONGITUDE, HEADING, strict=True)
    ]
    path.write_text("\n".join(["time,lat,lon,heading", *body]) + "\n")
    assert_all_rows(recorded(command, path))
    body = [f"{time},{10 + row} {'kn' if row % 2 else 'm/s'}" for row, time in enumerate(TIMES)]
    path.write_text("\n".join(["time,sog", *body]) + "\n")
    refused = command("import", path, "-o", tmp_path / "u.mcap", "--yes")
    assert refused.code == 1
    assert "is not a number: '10 m/s'" in refused.err


@pytest.mark.parametrize("word", ["ERR", "OVER", "sensor fault", "1.2.3"])
def test_few_words_among_numbers_cost_their_rows_and_many_the_import(
    tmp_path: Path, command: Command, word: str
) -> None:
    lines = rows()
    lines[7] = lines[7].rpartition(",")[0] + f",{word}"
    path = tmp_path / "t.csv"
    path.write_text("\n".join(["time,lat,lon,heading", *lines]) + "\n")
    done = command("import", path, "-o", tmp_path / "t.mcap", "--yes")
    assert f"1 rows have no number in 'heading', like '{word}' in row 8; they are dropped" in done.err
    assert len(read_table(tmp_path / "t.mcap")) == ROWS - 1
    lines[::3] = [line.rpartition(",")[0] + f",{word}" for line in lines[::3]]
    path.write_text("\n".join(["time,lat,lon,heading", *lines]) + "\n")
    assert command("import", path, "-o", tmp_path / "u.mcap", "--yes").code == 1


@pytest.mark.parametrize("between", ["", "\n", "second table\n"])
def test_another_table_behind_the_first_is_refused_with_its_line(
    tmp_path: Path, command: Command, between: str
) -> None:
    """Its rudder angles would else be latitudes."""
    other = "".join(f"{time},1.0\n" for time in TIMES)
    path = tmp_path / "t.csv"
    path.write_text("\n".join(["time,lat,lon,heading", *rows()]) + f"\n{between}time,rudder\n{other}")
    refused = command("import", path, "-o", tmp_path / "t.mcap", "--yes")
    assert refused.code == 1
    assert f"in line {ROWS + 2 + between.count(chr(10))} another table begins, 'time,rudder'" in refused.err


def test_annotated_csv_of_influxdb_is_a_row_per_value(tmp_path: Path) -> None:
    """Fields of two measurements; what tells them apart is in the name, and a blank line begins another table."""
    annotations = (
        "#group,false,false,false,false,true,true\n#datatype,string,long,dateTime:RFC3339,double,string,string\n"
    )
    head = annotations + "#default,_result,,,,,\n,result,table,_time,_value,_field,_measurement\n"
    rows = [
        [
            f",,{number},2026-05-17T12:00:{second:02d}.5Z,{start + second},{field},{measurement}"
            for second in range(20)
        ]
        for number, (field, measurement, start) in enumerate(
            [("heading", "gyro", 90), ("latitude", "gps", 63), ("longitude", "gps", 10)]
        )
    ]
    path = tmp_path / "query.csv"
    path.write_text(head + "\n".join([*rows[0], *rows[1]]) + "\n\n" + head + "\n".join(rows[2]) + "\n")
    raw = read_raw_table(path)
    assert [*raw.columns] == ["timestamp", "variable", "value"]
    assert [*raw.columns["variable"].unique()] == ["gyro heading", "gps latitude", "gps longitude"]
    assert raw.columns["value"].tolist() == [start + second for start in (90, 63, 10) for second in range(20)]


@pytest.mark.parametrize("prefix", ["", "2026-05-17T12:00:00Z "])
def test_sentences_under_the_suffix_of_a_table_are_called_so(prefix: str, tmp_path: Path) -> None:
    (tmp_path / "bridge.txt").write_text(f"{prefix}$HEHDT,12.3,T*1F\n{prefix}$RCTRD,3,-17.8,R,,V,*59\n" * 9)
    with pytest.raises(InputError, match=r"sentences of NMEA 0183; .*seatrial discover"):
        read_raw_table(tmp_path / "bridge.txt")
