"""Foreign tables that nobody described: made of a known motion in the manner of yards, loggers and programs,
imported as they are understood, and held against the motion they were made of."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd
import pymap3d
import pytest
from scipy.io import savemat

from seatrial.acquisition.core.errors import ConfigurationError, InputError
from seatrial.acquisition.core.quantities import Floats, unit_scale
from seatrial.acquisition.core.ship import angle_difference, is_circular
from seatrial.acquisition.tables.column_names import match_quantities, split_header
from seatrial.acquisition.tables.evidence import Question
from seatrial.acquisition.tables.import_table import Proposal, import_proposed, import_table, propose_column_map
from seatrial.acquisition.tables.table_files import read_raw_table
from seatrial.analysis.tables.table import read_table
from tests.conftest import Command

KNOT = 1852.0 / 3600.0
START = pd.Timestamp("2026-05-03T23:58:00Z")  # over midnight UTC, a day that might be a month
PLACE = (57.6, 11.2)


@dataclass
class Truth:
    """Ten minutes of a ship with one propeller and one rudder: a zigzag that becomes a turning circle."""

    rows: int = 600
    step_s: float = 1.0
    start: pd.Timestamp = START
    place: tuple[float, float] = PLACE
    table: pd.DataFrame = field(init=False)

    def __post_init__(self) -> None:
        t = self.step_s * np.arange(self.rows)
        rate = 0.9 * np.sin(2 * np.pi * t / 120.0) + 0.8 / (1.0 + np.exp((300.0 - t) / 5.0))
        rate_in = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(t))])
        heading = 340.0 + rate_in
        u, v = 6.5 - 0.3 * rate**2, -0.35 * rate
        course = np.deg2rad(heading)
        north_rate, east_rate = u * np.cos(course) - v * np.sin(course), u * np.sin(course) + v * np.cos(course)
        north, east = (
            np.concatenate([[0.0], np.cumsum(0.5 * (each[1:] + each[:-1]) * np.diff(t))])
            for each in (north_rate, east_rate)
        )
        latitude, longitude, _ = pymap3d.ned2geodetic(north, east, 0.0, *self.place, 0.0)
        wind_ahead, wind_side = _felt(heading, u, v, 200.0, 8.0)
        self.table = pd.DataFrame(
            {
                "latitude_deg": latitude,
                "longitude_deg": longitude,
                "north_m": north,
                "east_m": east,
                "heading_deg": heading % 360.0,
                "surge_mps": u,
                "sway_mps": v,
                "yaw_rate_dps": rate,
                "speed_over_ground_mps": np.hypot(north_rate, east_rate),
                "course_over_ground_deg": np.rad2deg(np.arctan2(east_rate, north_rate)) % 360.0,
                "wind_direction_deg": 200.0,
                "wind_speed_mps": 8.0,
                "apparent_wind_angle_deg": np.rad2deg(np.arctan2(wind_side, wind_ahead)) % 360.0,
                "apparent_wind_speed_mps": np.hypot(wind_ahead, wind_side),
                "rpm": 95.0 + 3.0 * np.sin(t / 50.0),
                "rudder": 12.0 * np.sin(2 * np.pi * (t + 8.0) / 120.0) + np.where(t > 300.0, 10.0, 0.0),
            },
            index=self.start + pd.to_timedelta(t, unit="s"),
        )

    def __getattr__(self, name: str) -> Floats:
        return np.asarray(self.table[name].to_numpy())

    def local(self, zone: str = "UTC") -> pd.DatetimeIndex:
        return pd.DatetimeIndex(self.table.index).tz_convert(zone).tz_localize(None)


def _felt(heading: Floats, u: Floats, v: Floats, direction: float, speed: float) -> tuple[Floats, Floats]:
    """Where the wind on board comes from, ahead and to starboard."""
    angle = np.deg2rad(direction - heading)
    return speed * np.cos(angle) + u, speed * np.sin(angle) + v


def imported(path: Path, **answers: str) -> tuple[Proposal, pd.DataFrame]:
    """What is proposed for a file, and the recording that comes of it."""
    given = {key.replace("__", "."): value for key, value in answers.items()}
    raw = read_raw_table(path)
    proposal = propose_column_map(raw, given)
    output, columns = path.with_suffix(".mcap"), path.with_suffix(".toml")
    import_proposed(raw, proposal, output, columns)
    tomllib.loads(columns.read_text(encoding="utf-8"))
    return proposal, read_table(output)


def assert_true(found: pd.DataFrame, truth: Truth, names: str, tolerance: float = 1e-3) -> None:
    """Channels that are those of the motion, at its instants; ``channel=column`` where they are named apart."""
    for each in names.split():
        channel, _, column = each.partition("=")
        expected = pd.Series(truth.table[column or channel], copy=True)
        measured = found[channel].dropna()
        assert len(measured) > 0.9 * len(expected), channel
        values = np.interp(
            measured.index.as_unit("ns").asi8,
            expected.index.as_unit("ns").asi8,
            np.unwrap(expected, period=360.0) if is_circular(channel) else expected,
        )
        off = angle_difference(measured, values) if is_circular(channel) else measured - values
        assert float(np.max(np.abs(off))) < tolerance, channel


MOTION = "heading_deg surge_mps sway_mps yaw_rate_dps"
PLACES = "latitude_deg longitude_deg"
CONTROLS = "propeller_rpm=rpm rudder_angle_deg=rudder"


def text(path: Path, frame: pd.DataFrame, separator: str = ",", before: str = "", **how: object) -> Path:
    body = frame.to_csv(index=False, sep=separator, **how)  # type: ignore[call-overload]
    path.write_bytes((before + body).encode(str(how.get("encoding", "utf-8"))))
    return path


def test_a_german_csv_with_decimal_commas_in_a_windows_code_page(tmp_path: Path) -> None:
    truth = Truth()
    local = truth.local("Europe/Berlin")
    frame = pd.DataFrame(
        {
            "Datum": local.strftime("%d.%m.%Y"),
            "Uhrzeit": local.strftime("%H:%M:%S"),
            "Breite (°)": truth.latitude_deg,
            "Länge (°)": truth.longitude_deg,
            "Kreiselkurs (°)": truth.heading_deg,
            "Kurs ü. Grund (°)": truth.course_over_ground_deg,
            "Fahrt ü. Grund (kn)": truth.speed_over_ground_mps / KNOT,
            "Drehrate (°/min)": 60.0 * truth.yaw_rate_dps,
            "Ruderlage (°)": truth.rudder,
            "Drehzahl (1/min)": truth.rpm,
            "Bemerkung": "",
        }
    )
    path = tmp_path / "probefahrt.csv"
    content = frame.to_csv(index=False, sep=";", decimal=",", float_format="%.7f")
    path.write_bytes(("Schiff: MS Erprobung\n\n" + content).encode("cp1252"))
    _, found = imported(path, zone="Europe/Berlin")
    assert_true(found, truth, f"{PLACES} {MOTION} {CONTROLS}", 2e-3)


def test_an_excel_sheet_with_serial_dates_below_a_title(tmp_path: Path) -> None:
    pytest.importorskip("python_calamine")
    from openpyxl import Workbook

    truth = Truth()
    serial = (truth.local() - pd.Timestamp("1899-12-30")) / pd.Timedelta(days=1)
    book = Workbook()
    sheet = book.active
    assert sheet is not None
    sheet.append(["Sea trial report", None, None])
    sheet.append(["Hull no. 1234"])
    sheet.append(
        [
            "Time (UTC)",
            "Latitude",
            "Longitude",
            "Heading [deg]",
            "SOG [kn]",
            "COG [deg]",
            "Rudder angle PS+ [deg]",
            "Shaft speed [rpm]",
        ]
    )
    columns = [
        serial,
        truth.latitude_deg,
        truth.longitude_deg,
        truth.heading_deg,
        truth.speed_over_ground_mps / KNOT,
        truth.course_over_ground_deg,
        -truth.rudder,
        truth.rpm,
    ]
    for row in zip(*columns, strict=True):
        sheet.append([float(cell) for cell in row])
    book.create_sheet("Notes").append(["calm"])
    book.save(tmp_path / "trial.xlsx")
    proposal, found = imported(tmp_path / "trial.xlsx")
    assert_true(found, truth, f"{PLACES} heading_deg surge_mps sway_mps", 5e-3)
    assert_true(found.iloc[1:-1], truth, "yaw_rate_dps", 0.02)
    assert found["propeller_rpm"].to_numpy() == pytest.approx(truth.rpm)
    assert not proposal.questions


def test_an_excel_sheet_with_cells_of_dates(tmp_path: Path) -> None:
    pytest.importorskip("python_calamine")
    truth = Truth(rows=120)
    frame = pd.DataFrame(
        {"Zeitstempel": truth.local(), "Heading": truth.heading_deg, "ROT": 60 * truth.yaw_rate_dps}
    )
    frame.to_excel(tmp_path / "cells.xlsx", index=False)
    _, found = imported(tmp_path / "cells.xlsx")
    assert_true(found, truth, "heading_deg yaw_rate_dps")


def test_a_voyage_data_recorders_export(tmp_path: Path) -> None:
    """Lines before the header, a row of units, dates with slashes that only fit day first, marks for no value."""
    truth = Truth()
    rows = {
        "Date": truth.local().strftime("%d/%m/%Y"),
        "Time": truth.local().strftime("%H:%M:%S.%f").str[:-3],
        "LAT": _degrees_minutes(truth.latitude_deg),
        "N/S": "N",
        "LON": _degrees_minutes(truth.longitude_deg),
        "E/W": "E",
        "HDT": truth.heading_deg.round(4),
        "ROT": (60.0 * truth.yaw_rate_dps).round(4),
        "VTG SOG": (truth.speed_over_ground_mps / KNOT).round(4),
        "VTG COG": truth.course_over_ground_deg.round(4),
        "RSA STBD": truth.rudder.round(3),
        "RPM": truth.rpm.round(3),
    }
    frame = pd.DataFrame(rows).astype(str)
    frame.loc[5:8, ["HDT", "ROT"]] = "---"
    path = tmp_path / "vdr.csv"
    body = frame.to_csv(index=False).replace(
        "\n", "\nUTC,UTC,ddmm.mmmm,,dddmm.mmmm,,deg,deg/min,kn,deg,deg,1/min\n", 1
    )
    path.write_text(f"VDR Export V2.3\nIMO number,9391001\n# extracted 2026-05-09\n{body}")
    proposal, found = imported(path)
    assert_true(found, truth, f"{PLACES} heading_deg yaw_rate_dps", 5e-3)
    assert_true(found, truth, "surge_mps sway_mps", 5e-3)
    assert not proposal.questions
    assert found["heading_deg"].isna().sum() == found["surge_mps"].isna().sum() == 4


def _degrees_minutes(angle: Floats) -> list[str]:
    whole = np.trunc(angle)
    return [f"{100 * degrees + minutes:.6f}" for degrees, minutes in zip(whole, 60 * (angle - whole), strict=True)]


@pytest.mark.usefixtures("read_in_process")
def test_simulink_saves_a_structure_with_time(tmp_path: Path) -> None:
    truth = Truth()
    t = np.arange(600.0)

    def signal(values: Floats, label: str) -> dict[str, object]:
        return {"values": values[:, np.newaxis], "dimensions": 1.0, "label": label}

    signals = np.array(
        [
            signal(truth.surge_mps, "u"),
            signal(truth.sway_mps, "v"),
            signal(np.deg2rad(truth.yaw_rate_dps), "r"),
            signal(np.unwrap(np.deg2rad(truth.heading_deg)), "psi"),
            signal(truth.north_m, "x"),
            signal(truth.east_m, "y"),
            signal(np.deg2rad(truth.rudder), "delta"),
            signal(truth.rpm / 60.0, "n"),
        ],
        dtype=object,
    )
    savemat(
        tmp_path / "sim.mat", {"simout": {"time": t[:, np.newaxis], "signals": signals, "blockName": "ship/out"}}
    )
    first = propose_column_map(read_raw_table(tmp_path / "sim.mat"))
    assert {each.key for each in first.unanswered} <= {"unit.n"}
    _, found = imported(tmp_path / "sim.mat", start=START.isoformat(), unit__n="rps")
    assert_true(found, truth, f"north_m east_m {MOTION} {CONTROLS}", 5e-3)


def test_a_matlab_7_3_file_is_read_as_an_older_one(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    truth = Truth(rows=200)
    with h5py.File(tmp_path / "log.mat", "w", userblock_size=512) as file:
        group = file.create_group("log")
        datenum = 719_529.0 + pd.DatetimeIndex(truth.table.index).as_unit("ns").asi8 / 86_400e9
        for name, values in (
            ("time", datenum),
            ("heading", truth.heading_deg),
            ("lat", truth.latitude_deg),
            ("lon", truth.longitude_deg),
            ("sog_kn", truth.speed_over_ground_mps / KNOT),
        ):
            group.create_dataset(name, data=np.atleast_2d(values))
    with (tmp_path / "log.mat").open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(116) + bytes(8) + b"\x00\x02IM")
    _, found = imported(tmp_path / "log.mat")
    assert_true(found, truth, f"{PLACES} heading_deg speed_over_ground_mps", 5e-3)
    assert_true(found.iloc[1:-1], truth, "surge_mps sway_mps", 5e-3)


def test_a_long_table_has_a_row_for_each_value(tmp_path: Path) -> None:
    truth = Truth()
    parts = {
        "HDG": (truth.heading_deg, "deg"),
        "SOG": (truth.speed_over_ground_mps / KNOT, "kn"),
        "COG": (truth.course_over_ground_deg, "deg"),
        "Lat": (truth.latitude_deg, "deg"),
        "Lon": (truth.longitude_deg, "deg"),
        "ROT": (60 * truth.yaw_rate_dps, "deg/min"),
    }
    stamps = [f"{each.isoformat()}Z" for each in truth.local()]
    rows = [
        pd.DataFrame({"timestamp": stamps, "variable": name, "value": values, "unit": unit})
        for name, (values, unit) in parts.items()
    ]
    frame = pd.concat(rows).sort_values(["timestamp", "variable"])
    proposal, found = imported(text(tmp_path / "long.csv", frame, ";"))
    assert_true(found, truth, f"{PLACES} {MOTION}", 5e-3)
    assert not proposal.questions


def test_a_ros_bag_as_csv_counts_nanoseconds_and_turns_to_port(tmp_path: Path) -> None:
    truth = Truth()
    yaw = np.deg2rad(90.0 - truth.heading_deg)
    frame = pd.DataFrame(
        {
            "%time": pd.DatetimeIndex(truth.table.index).as_unit("ns").asi8,
            "field.header.seq": np.arange(600),
            "field.pose.pose.position.x": truth.east_m,
            "field.pose.pose.position.y": truth.north_m,
            "field.pose.pose.position.z": 0.0,
            "field.pose.pose.orientation.x": 0.0,
            "field.pose.pose.orientation.y": 0.0,
            "field.pose.pose.orientation.z": np.sin(yaw / 2),
            "field.pose.pose.orientation.w": np.cos(yaw / 2),
            "field.twist.twist.linear.x": truth.surge_mps,
            "field.twist.twist.linear.y": -truth.sway_mps,
            "field.twist.twist.angular.z": -np.deg2rad(truth.yaw_rate_dps),
            "field.pose.covariance0": 0.1,
        }
    )
    proposal, found = imported(text(tmp_path / "odom.csv", frame))
    assert_true(found, truth, f"north_m east_m {MOTION}", 5e-3)
    assert not proposal.questions


def test_an_ais_track_has_speeds_in_knots_and_codes_for_no_value(tmp_path: Path) -> None:
    truth = Truth(rows=120, step_s=10.0)
    heading = truth.heading_deg.copy()
    heading[7] = 511.0
    frame = pd.DataFrame(
        {
            "MMSI": 257000000,
            "BaseDateTime": truth.local().strftime("%Y-%m-%dT%H:%M:%S"),
            "LAT": truth.latitude_deg,
            "LON": truth.longitude_deg,
            "SOG": truth.speed_over_ground_mps / KNOT,
            "COG": truth.course_over_ground_deg,
            "Heading": heading,
            "VesselName": "TEST",
            "IMO": "IMO1234567",
            "Length": 180,
            "Draft": 9.5,
        }
    )
    proposal, found = imported(text(tmp_path / "ais.csv", frame))
    assert_true(found, truth, f"{PLACES} speed_over_ground_mps course_over_ground_deg heading_deg")
    assert_true(found, truth, "surge_mps sway_mps")
    assert np.isnan(found["heading_deg"].iloc[7])
    assert [each.key for each in proposal.questions] == ["zone"]


def test_a_gpx_track_gives_positions_and_the_speed_along_them(tmp_path: Path) -> None:
    truth = Truth()
    points = "\n".join(
        f'<trkpt lat="{lat:.9f}" lon="{lon:.9f}"><ele>0</ele><time>{time.isoformat()}Z</time></trkpt>'
        for lat, lon, time in zip(truth.latitude_deg, truth.longitude_deg, truth.local(), strict=True)
    )
    path = tmp_path / "track.gpx"
    path.write_text(f'<gpx xmlns="http://www.topografix.com/GPX/1/1"><trk><trkseg>{points}</trkseg></trk></gpx>')
    proposal, found = imported(path)
    assert_true(found, truth, f"{PLACES}", 1e-6)
    assert_true(found.iloc[2:-2], truth, "speed_over_ground_mps course_over_ground_deg", 0.1)
    assert "heading_deg" not in found
    assert any("heading" in each for each in proposal.warnings)


def test_gpx_tracks_of_one_time_are_refused_and_the_course_is_over_ground(tmp_path: Path) -> None:
    truth = Truth(rows=120)
    points = [
        f'<trkpt lat="{lat:.9f}" lon="{lon:.9f}"><time>{time.isoformat()}Z</time><course>{course}</course></trkpt>'
        for lat, lon, time, course in zip(
            truth.latitude_deg, truth.longitude_deg, truth.local(), truth.course_over_ground_deg, strict=True
        )
    ]

    def track(*parts: list[str]) -> Path:
        tracks = "".join(f"<trk><trkseg>{''.join(part)}</trkseg></trk>" for part in parts)
        (tmp_path / "track.gpx").write_text(f'<gpx xmlns="http://www.topografix.com/GPX/1/0">{tracks}</gpx>')
        return tmp_path / "track.gpx"

    proposal, found = imported(track(points[:60], points[60:]))
    assert not proposal.unanswered
    assert_true(found, truth, f"{PLACES} course_over_ground_deg", 1e-5)
    with pytest.raises(InputError, match="2 tracks, of which some are of the same time"):
        read_raw_table(track(points, points))


@pytest.mark.parametrize("head", ["MMSI", "src"])
def test_a_table_of_two_ships_or_senders_is_asked_for_one(head: str, tmp_path: Path) -> None:
    """They take turns; the map keeps the answer. Senders that fill columns of their own are one table."""
    truth = Truth(rows=120)
    one = pd.DataFrame(
        {
            "time": truth.local().astype(str) + "Z",
            head: 257000001,
            "lat": truth.latitude_deg,
            "lon": truth.longitude_deg,
            "heading": truth.heading_deg,
        }
    )
    other = one.assign(**{head: 257000002, "lat": truth.latitude_deg + 1.0})
    path = text(tmp_path / "ais.csv", pd.concat([one, other]).sort_index(kind="stable"))
    (question,) = propose_column_map(read_raw_table(path)).unanswered
    assert set(question.options) == {"257000001", "257000002"}
    proposal, found = imported(path, only="257000001")
    assert_true(found, truth, f"{PLACES} heading_deg")
    import_table(path, tmp_path / "again.mcap", path.with_suffix(".toml"), allow_missing=True)
    assert_true(read_table(tmp_path / "again.mcap"), truth, PLACES)
    assert tomllib.loads(proposal.text)["only"] == {"column": head, "value": "257000001"}


def test_senders_with_columns_of_their_own_are_one_table(tmp_path: Path) -> None:
    truth = Truth(rows=120)
    frame = pd.DataFrame({"time": truth.local().astype(str) + "Z", "source": "gyro", "heading": truth.heading_deg})
    fixes = pd.DataFrame(
        {"time": frame["time"], "source": "gps", "lat": truth.latitude_deg, "lon": truth.longitude_deg}
    )
    proposal, found = imported(text(tmp_path / "t.csv", pd.concat([frame, fixes]).sort_index(kind="stable")))
    assert not proposal.unanswered
    assert found["heading_deg"].count() == found["latitude_deg"].count() == truth.rows


def test_a_tab_separated_table_with_a_row_of_units(tmp_path: Path) -> None:
    truth = Truth()
    epoch = pd.DatetimeIndex(truth.table.index).as_unit("ns").asi8 / 1e9
    frame = pd.DataFrame(
        {
            "time": [f"{each:.3f}" for each in epoch],
            "x": truth.north_m,
            "y": truth.east_m,
            "psi": np.deg2rad(truth.heading_deg),
            "u": truth.surge_mps / KNOT,
            "v": truth.sway_mps / KNOT,
            "r": np.deg2rad(truth.yaw_rate_dps),
            "rudder": truth.rudder,
            "rpm": truth.rpm,
        }
    )
    body = frame.to_csv(index=False, sep="\t").replace(
        "\n", "\n[s]\t[m]\t[m]\t[rad]\t[kn]\t[kn]\t[rad/s]\t[deg]\t[rpm]\n", 1
    )
    (tmp_path / "run.tsv").write_text(body)
    proposal, found = imported(tmp_path / "run.tsv")
    assert_true(found, truth, f"north_m east_m {MOTION} {CONTROLS}", 2e-3)
    assert not proposal.questions


@pytest.mark.parametrize(("unit", "size"), [("ms", 1_000_000), ("us", 1_000)])
def test_counts_since_1970_are_known_by_their_size_and_speeds_by_the_track(
    tmp_path: Path, unit: str, size: int
) -> None:
    truth = Truth()
    frame = pd.DataFrame(
        {
            "timestamp": pd.DatetimeIndex(truth.table.index).as_unit("ns").asi8 // size,
            "lat": truth.latitude_deg,
            "lng": truth.longitude_deg,
            "hdg": truth.heading_deg,
            "speed": truth.speed_over_ground_mps * 3.6,
            "yaw_rate": np.deg2rad(truth.yaw_rate_dps),
        }
    )
    proposal, found = imported(text(tmp_path / f"epoch_{unit}.csv", frame))
    assert_true(found, truth, f"{PLACES} heading_deg yaw_rate_dps speed_over_ground_mps", 1e-2)
    assert not proposal.questions


def test_degrees_minutes_and_seconds_as_text_in_french(tmp_path: Path) -> None:
    truth = Truth(place=(-33.9, -18.4))

    def written(angle: float, letters: str) -> str:
        seconds = round(3600.0 * abs(angle), 4)
        return (
            f"{int(seconds // 3600)}°{int(seconds // 60 % 60):02d}'{seconds % 60:07.4f}\"{letters[int(angle < 0)]}"
        )

    frame = pd.DataFrame(
        {
            "Date": truth.local().strftime("%d/%m/%y"),
            "Heure UTC": truth.local().strftime("%H:%M:%S"),
            "Latitude": [written(each, "NS") for each in truth.latitude_deg],
            "Longitude": [written(each, "EW") for each in truth.longitude_deg],
            "Cap vrai (°)": truth.heading_deg,
            "Vitesse fond (nd)": truth.speed_over_ground_mps / KNOT,
            "Route fond (°)": truth.course_over_ground_deg,
            "Angle de barre (°)": truth.rudder,
            "Tours (tr/min)": truth.rpm,
        }
    )
    _, found = imported(text(tmp_path / "essai.csv", frame, ";", encoding="latin-1"))
    assert_true(found, truth, f"{PLACES} heading_deg surge_mps {CONTROLS}", 5e-3)
    assert_true(found.iloc[1:-1], truth, "yaw_rate_dps", 0.02)


@pytest.mark.parametrize("month_first", [False, True])
def test_the_order_of_day_and_month_is_found_by_the_span_or_asked(tmp_path: Path, month_first: bool) -> None:
    truth = Truth(rows=7 * 3600 // 60, step_s=60.0)
    form = "%m/%d/%Y" if month_first else "%d/%m/%Y"
    frame = pd.DataFrame(
        {
            "Date": truth.local().strftime(form),
            "Time UTC": truth.local().strftime("%H:%M:%S"),
            "Heading (deg)": truth.heading_deg,
        }
    )
    proposal, found = imported(text(tmp_path / "two_days.csv", frame))
    assert pd.Timestamp(found.index[0]) == START
    assert not proposal.questions
    one_day = frame.iloc[2:100]
    asked = propose_column_map(read_raw_table(text(tmp_path / "one_day.csv", one_day)))
    assert [each.key for each in asked.unanswered] == ["date_order"]
    assert "4 May 2026" in asked.unanswered[0].text
    assert "5 April 2026" in asked.unanswered[0].text
    with pytest.raises(InputError, match=r"--answer date_order=day-first\|month-first"):
        imported(tmp_path / "one_day.csv")
    _, found = imported(tmp_path / "one_day.csv", date_order="month-first" if month_first else "day-first")
    assert pd.Timestamp(found.index[0]) == START + pd.Timedelta(minutes=2)


def test_norwegian_words_and_apparent_wind_that_nobody_called_so(tmp_path: Path) -> None:
    truth = Truth()
    frame = pd.DataFrame(
        {
            "Tid (UTC)": truth.local().strftime("%Y-%m-%d %H:%M:%S"),
            "Breddegrad": truth.latitude_deg,
            "Lengdegrad": truth.longitude_deg,
            "Retning [grader]": truth.heading_deg,
            "Fart over grunn [knop]": truth.speed_over_ground_mps / KNOT,
            "Kurs over grunn [grader]": truth.course_over_ground_deg,
            "Vindretning [grader]": truth.apparent_wind_angle_deg,
            "Vindhastighet [m/s]": truth.apparent_wind_speed_mps,
            "Rorvinkel [grader]": truth.rudder,
            "Turtall [o/min]": truth.rpm,
            "Shaft power [kW]": 900.0,
        }
    )
    proposal, found = imported(text(tmp_path / "tokt.csv", frame))
    assert proposal.text.index("[apparent_wind]") < proposal.text.index("[[channel]]")  # each time the same map
    assert_true(found, truth, "apparent_wind_angle_deg apparent_wind_speed_mps surge_mps", 5e-3)
    assert_true(found, truth, "wind_direction_deg wind_speed_mps", 0.01)
    assert any("apparent" in reason for each in proposal.readings for reason in each.reasons)


def test_netcdf_4_of_others_by_its_standard_names(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    truth = Truth(rows=200)
    with h5py.File(tmp_path / "cruise.nc", "w") as file:
        time = file.create_dataset("TIME", data=np.arange(200.0) / 60.0)
        time.make_scale("TIME")
        time.attrs["units"] = f"minutes since {START:%Y-%m-%d %H:%M:%S}"
        for name, values, standard, unit in (
            ("A1", truth.latitude_deg, "latitude", "degrees_north"),
            ("A2", truth.longitude_deg, "longitude", "degrees_east"),
            ("A3", truth.heading_deg * 100.0, "platform_yaw", "degree"),
            ("A4", truth.speed_over_ground_mps, "speed over ground", "m s-1"),
        ):
            variable = file.create_dataset(name, data=values)
            variable.dims[0].attach_scale(time)
            variable.attrs["units"], variable.attrs["standard_name"] = unit, standard
        file["A3"].attrs["scale_factor"] = 0.01
    _, found = imported(tmp_path / "cruise.nc")
    assert_true(found, truth, f"{PLACES} heading_deg speed_over_ground_mps")


def test_a_speed_that_the_positions_contradict_is_said_with_its_likely_unit(tmp_path: Path) -> None:
    truth = Truth()
    frame = pd.DataFrame(
        {
            "time UTC": truth.local().astype(str),
            "lat": truth.latitude_deg,
            "lon": truth.longitude_deg,
            "SOG [m/s]": truth.speed_over_ground_mps / KNOT,
            "ROT [deg/s]": 60.0 * truth.yaw_rate_dps,
            "HDG": truth.heading_deg,
            "Torque": "",
        }
    )
    proposal, _ = imported(text(tmp_path / "wrong.csv", frame))
    assert any("0.514: knots?" in each for each in proposal.warnings)
    assert any("deg/min?" in each for each in proposal.warnings)


@pytest.mark.parametrize(
    ("name", "factor", "remark"),
    [
        ("Speed (mph)", 0.44704, ""),
        ("SOG", 0.44704, ""),
        ("SOG [ft/s]", 0.3048, ""),
        ("SOG", 1 / 1.3, "factor 0.769"),
    ],
)
def test_a_speed_in_a_rare_unit_or_in_none(name: str, factor: float, remark: str, tmp_path: Path) -> None:
    """Miles an hour are 15 % off knots; what the positions show to be in no unit is said to be off."""
    truth = Truth()
    frame = pd.DataFrame(
        {
            "time": truth.local().astype(str) + "Z",
            "lat": truth.latitude_deg,
            "lon": truth.longitude_deg,
            name: truth.speed_over_ground_mps / factor,
            "HDG": truth.heading_deg,
            "shaft speed [rad/s]": truth.rpm * np.pi / 30.0,
        }
    )
    proposal, found = imported(text(tmp_path / "miles.csv", frame))
    assert [remark in warning for warning in proposal.warnings] == ([True] if remark else [])
    assert_true(found, truth, "propeller_rpm=rpm" + ("" if remark else " speed_over_ground_mps"))


@pytest.mark.parametrize("code", [-999.0, -99.0, 999.0, 999.9])
def test_a_code_far_from_all_values_is_none_and_is_said(code: float, tmp_path: Path) -> None:
    """The quantity could have it, the column never does otherwise; an angle near it is a value."""
    truth = Truth()
    frame = pd.DataFrame(
        {
            "time": truth.local().astype(str) + "Z",
            "HDG": truth.heading_deg,
            "RPM": np.where(np.arange(truth.rows) % 9, truth.rpm, code),
            "rudder [deg]": truth.rudder,
        }
    )
    proposal, found = imported(text(tmp_path / "codes.csv", frame))
    assert any("far from all its other values" in warning for warning in proposal.warnings)
    assert found["propeller_rpm"].isna().sum() == 1 + truth.rows // 9
    assert found["propeller_rpm"].between(91.0, 99.0).sum() == found["propeller_rpm"].count()


@pytest.mark.parametrize(
    ("form", "sides"),
    [
        pytest.param(form, sides, marks=[] if place == number else [pytest.mark.slow])
        for number, form in enumerate(["{:.3f} {}", "{1}{0:.3f}", "{:.3f}° {}"])
        for place, sides in enumerate([("P", "S"), ("Bb", "Stb"), ("Port", "Stbd")])
    ],
)
def test_sides_in_words_are_signs(form: str, sides: tuple[str, str], tmp_path: Path) -> None:
    """To port is negative, and this is said; the south alone is no side."""
    truth = Truth()
    frame = pd.DataFrame(
        {
            "time": truth.local().astype(str) + "Z",
            "lat": [f"{lat:.7f} S" for lat in truth.latitude_deg],
            "lon": [f"{lon:.7f} E" for lon in truth.longitude_deg],
            "Rudder": [form.format(abs(angle), sides[int(angle > 0.0)]) for angle in truth.rudder],
        }
    )
    proposal, found = imported(text(tmp_path / "sides.csv", frame))
    assert any("to port is negative" in warning for warning in proposal.warnings)
    assert_true(found, truth, "rudder_angle_deg=rudder")
    assert found["latitude_deg"].max() < 0.0


@pytest.mark.parametrize("in_radians", [True, False])
def test_a_helm_in_radians_beside_a_heading_in_degrees_is_said(in_radians: bool, tmp_path: Path) -> None:
    truth = Truth()
    helm = np.deg2rad(truth.rudder) if in_radians else truth.rudder
    frame = pd.DataFrame({"time": truth.local().astype(str) + "Z", "HDG": truth.heading_deg, "delta": helm})
    proposal, _ = imported(text(tmp_path / "helm.csv", frame))
    assert any("unit.delta=rad" in warning for warning in proposal.warnings) == in_radians


def test_the_minus_sign_of_typographers_is_one(tmp_path: Path) -> None:
    truth = Truth()
    rates = [f"{rate:.6f}".replace("-", "\N{MINUS SIGN}") for rate in truth.yaw_rate_dps]
    frame = pd.DataFrame({"time": truth.local().astype(str) + "Z", "HDG": truth.heading_deg, "ROT [deg/s]": rates})
    _, found = imported(text(tmp_path / "minus.csv", frame))
    assert_true(found, truth, "yaw_rate_dps")


@pytest.mark.parametrize("name", ["wind_to_direction", "Wind direction towards"])
def test_where_the_wind_blows_to_is_turned(name: str, tmp_path: Path) -> None:
    truth = Truth()
    frame = pd.DataFrame(
        {
            "time": truth.local().astype(str) + "Z",
            name: (truth.wind_direction_deg + 180.0) % 360.0,
            "wind speed [m/s]": truth.wind_speed_mps,
        }
    )
    _, found = imported(text(tmp_path / "to.csv", frame))
    assert_true(found, truth, "wind_direction_deg wind_speed_mps")


def test_what_cannot_be_told_is_asked_and_both_readings_are_named(tmp_path: Path) -> None:
    truth = Truth(rows=60)
    frame = pd.DataFrame(
        {
            "time": truth.local().astype(str) + "Z",
            "HDG": truth.heading_deg,
            "Speed": 10.0 + truth.rudder,
            "TWS": 9.0,
            "n_prop": 12.5,
        }
    )
    raw = read_raw_table(text(tmp_path / "bare.csv", frame))
    asked = {each.key: each for each in propose_column_map(raw).unanswered}
    assert {"unit.speed", "unit.wind", "unit.n_prop"} == set(asked)
    assert {"m/s", "knots"} <= set(asked["unit.speed"].options)
    answers = {"unit.speed": "knots", "unit.wind": "m/s", "unit.n_prop": "skip"}
    proposal = propose_column_map(raw, answers)
    assert not proposal.questions
    assert "n_prop" not in tomllib.loads(proposal.text)["channels"]
    with pytest.raises(ConfigurationError, match="none of m/s, knots"):
        propose_column_map(raw, {"unit.speed": "furlongs"})
    assert isinstance(asked["unit.speed"], Question)
    course = propose_column_map(
        read_raw_table(text(tmp_path / "course.csv", frame[["time", "HDG"]].set_axis(["time", "Kurs"], axis=1)))
    )
    assert [each.key for each in course.unanswered] == ["course"]


def test_one_column_for_a_pair_of_thrusters_is_said(tmp_path: Path) -> None:
    frame = pd.DataFrame({"time": Truth(rows=20).local().astype(str) + "Z", "RPM": 90.0, "Azi": np.arange(20.0)})
    raw = read_raw_table(text(tmp_path / "pair.csv", frame))
    proposal = propose_column_map(raw, vessel="gunnerus_long")
    assert {"port_rpm", "starboard_rpm", "port_angle_deg"} <= set(tomllib.loads(proposal.text)["channels"])
    assert sum("alike" in each for each in proposal.warnings) == 2


def test_the_command_proposes_refuses_imports_and_writes_the_map(tmp_path: Path, command: Command) -> None:
    truth = Truth(rows=120)
    frame = pd.DataFrame(
        {
            "Zeit (UTC)": truth.local().astype(str),
            "Kreiselkurs": truth.heading_deg,
            "Drehrate": 60 * truth.yaw_rate_dps,
            "Leer": "",
        }
    )
    table, output = text(tmp_path / "fahrt.csv", frame, ";"), tmp_path / "fahrt.mcap"
    shown = command("import", table, "-o", output)
    assert shown.code == 1
    assert "--yes" in shown.err
    assert not output.exists()
    done = command("import", table, "-o", output, "--yes", "--preview", tmp_path / "fahrt.png")
    assert (done.code, done.out.strip()) == (0, str(output))
    assert (tmp_path / "fahrt.png").read_bytes().startswith(b"\x89PNG")
    again = command("import", table, "-o", output, "--yes")
    assert again.code == 1
    assert "--force" in again.err
    other = tmp_path / "again.mcap"
    assert command("import", table, "-o", other, "--columns", tmp_path / "fahrt.columns.toml").code == 0
    pd.testing.assert_frame_equal(read_table(other), read_table(output))
    assert command("import", table, "-o", output, "--yes", "--force").code == 0
    assert command("import", table, "-o", output, "--answer", "zone").code == 2


def test_the_sentences_digits_of_date_and_time_are_read(tmp_path: Path) -> None:
    truth = Truth()
    frame = pd.DataFrame(
        {
            "UTC": truth.local().strftime("%H%M%S.00"),
            "Date": truth.local().strftime("%d%m%y"),
            "Lat (ddmm.mmmm)": _degrees_minutes(truth.latitude_deg),
            "Lon (dddmm.mmmm)": _degrees_minutes(truth.longitude_deg),
            "HDT": truth.heading_deg,
        }
    )
    proposal, found = imported(text(tmp_path / "rmc.csv", frame))
    assert_true(found, truth, f"{PLACES} heading_deg", 1e-6)
    assert not proposal.questions


def test_azimuth_thrusters_have_their_shafts_orders_and_the_sign_that_turns_the_ship(tmp_path: Path) -> None:
    truth = Truth()
    frame = pd.DataFrame(
        {
            "Timestamp": truth.local().strftime("%Y/%m/%d %H:%M:%S"),
            "Gyro1": truth.heading_deg,
            "Gyro2": truth.heading_deg + 0.1,
            "Pos North": truth.north_m,
            "Pos East": truth.east_m,
            "Az Thruster PS Angle FB": truth.rudder,  # to starboard, as a rudder: turns the thrust to port
            "Az Thruster SB Angle FB": -truth.rudder,
            "Az Thruster PS RPM FB": truth.rpm,
            "Az Thruster SB RPM FB": truth.rpm + 1.0,
            "Az Thruster PS RPM CMD": truth.rpm + 2.0,
            "Bow Thruster %": np.linspace(0.0, 50.0, 600),
        }
    )
    proposal, found = imported(text(tmp_path / "dp.csv", frame), full_scale__tunnel="400")
    for channel in ("port_angle_deg", "starboard_angle_deg"):
        assert found[channel].to_numpy() == pytest.approx(-truth.rudder)
    assert found["starboard_rpm"].to_numpy() == pytest.approx(truth.rpm + 1.0)
    assert found["port_order_rpm"].to_numpy() == pytest.approx(truth.rpm + 2.0)
    assert found["tunnel_rpm"].iloc[-1] == pytest.approx(200.0)
    assert sum("sign" in each for each in proposal.warnings) == 1


@pytest.mark.parametrize(("amidships", "doubted"), [(0.0, False), (1.5, False), (360.0, False), (40.0, True)])
def test_an_ordered_angle_that_the_rudder_does_not_follow_is_doubted(
    amidships: float, doubted: bool, tmp_path: Path
) -> None:
    """As raw counts of an autopilot's board, 10 to 70 with 40 amidships; a turn more is the same angle."""
    truth = Truth()
    frame = pd.DataFrame(
        {
            "Timestamp": truth.local().strftime("%Y/%m/%d %H:%M:%S"),
            "Heading [deg]": truth.heading_deg,
            "Pos North [m]": truth.north_m,
            "Pos East [m]": truth.east_m,
            "rudder [deg]": truth.rudder,
            "rudder command [deg]": truth.rudder + amidships,
        }
    )
    proposal, found = imported(text(tmp_path / "orders.csv", frame))
    assert found["rudder_angle_deg"].to_numpy() == pytest.approx(truth.rudder)
    assert any("rudder_order_angle_deg" in each for each in proposal.warnings) == doubted


@pytest.mark.parametrize(
    "answer",
    [
        {"zone": "Oslo"}, {"start": "noon"}, {"day": "17.5.2026"}, {"full_scale.port": "fast"},
        {"units.u": "m/s"}, {"unit.HDG": "knots"},
    ],
)  # fmt: skip
def test_an_answer_that_cannot_be_one_is_a_line(tmp_path: Path, answer: dict[str, str]) -> None:
    path = tmp_path / "table.csv"
    path.write_text(
        "t,clock,HDG,port rpm [%],port azimuth [deg]\n0,12:00,9,50,0\n1,12:01,10,50,0\n2,12:02,11,50,0\n"
    )
    if "day" in answer or "zone" in answer:
        path.write_text(path.read_text().replace("t,clock", "number,time"))
    if "start" in answer:
        path.write_text(path.read_text().replace("clock", "spare"))
    with pytest.raises(ConfigurationError):
        propose_column_map(read_raw_table(path), answer)


@pytest.mark.shared
@pytest.mark.parametrize(
    ("file", "known", "answers", "missing"),
    [
        (
            "gunnerus_2019_docking/docking_2019-11-09_part1.csv",
            "gunnerus_2019_docking",
            {"full_scale": "203", "full_scale.tunnel": "450"},
            set(),
        ),
        (
            "gunnerus_2022_trials/trials_2022-10-27_part1.csv",
            "gunnerus_2022_trials",
            {"start": "2022-10-27T00:00:00Z"},
            {"wind_direction_deg", "wind_speed_mps", "tunnel_rpm"},
        ),
        ("esso_osaka/zigzag/zigzag_31-Jul-2020_13_22_52.csv.gz", "esso_osaka", {}, set()),
        ("esso_osaka/berthing/berthing_12-Nov-2020_11_07_23.csv.gz", "esso_osaka", {}, set()),
    ],
)
def test_published_recordings_are_understood_as_their_maps_have_them(
    shared_data: Path, tmp_path: Path, file: str, known: str, answers: dict[str, str], missing: set[str]
) -> None:
    """But for what only a person knows: percent of which speed, one order for two thrusters, the start."""
    from seatrial.acquisition.tables.import_table import read_table_file

    raw = read_raw_table(shared_data / file)
    vessel = "gunnerus_long" if known == "gunnerus_2022_trials" else None
    proposal = propose_column_map(raw, answers, vessel)
    assert not proposal.unanswered
    written = tmp_path / "proposed.toml"
    written.write_text(proposal.text, encoding="utf-8")
    ours = read_table_file(shared_data / file, written).table
    maps = Path(__file__).parents[2] / "trials" / "columns"
    theirs = read_table_file(shared_data / file, maps / f"{known}.toml").table
    assert set(theirs) - set(ours) == missing
    for name in set(theirs) - missing:
        np.testing.assert_allclose(ours[name].to_numpy(), theirs[name].to_numpy(), atol=1e-9, err_msg=name)
    steps = [np.diff(pd.DatetimeIndex(table.index).as_unit("ns").asi8) for table in (ours, theirs)]
    np.testing.assert_array_equal(*steps)


HEADS = {
    "cp932": "日時(UTC),緯度[deg],経度[deg],船首方位[deg],対地速力[knot],対地針路[deg],回頭角速度[deg/min],"
    "舵角[deg],プロペラ回転数[rpm]",
    "gb18030": "时间(UTC),纬度,经度,艏向(°),对地航速(kn),对地航向(°),转艏角速度(°/min),舵角(°),主轴转速(r/min)",
    "utf-16": "时间(UTC),纬度,经度,艏向(°),对地航速(节),对地航向(°),转艏角速度(度/分),舵角(度),螺旋桨转速(转/分)",
    "cp1252": "Zeitstempel (UTC),Breitengrad,Längengrad,Steuerkurs [°],Geschw. ü. G. [kn],Kurs ü. G. [°],"
    "Wendegeschw. [°/min],Ruderlage [°],Wellendrehz. [1/min]",
    "utf-8": "Horodatage UTC,Latitude,Longitude,Cap vrai (°),Vitesse fond (nds),Route fond (°),"
    "Taux de giration (°/mn),Angle de barre (°),Régime arbre (tr/min)",
}


@pytest.mark.parametrize("encoding", HEADS)
def test_heads_of_yards_in_their_languages_and_code_pages(tmp_path: Path, encoding: str) -> None:
    truth = Truth()
    frame = pd.DataFrame(
        {
            "time": truth.local().strftime("%Y/%m/%d %H:%M:%S"), "lat": truth.latitude_deg,
            "lon": truth.longitude_deg, "hdg": truth.heading_deg, "sog": truth.speed_over_ground_mps / KNOT,
            "cog": truth.course_over_ground_deg, "rot": 60.0 * truth.yaw_rate_dps, "rudder": truth.rudder,
            "rpm": truth.rpm,
        }
    )  # fmt: skip
    frame.columns = pd.Index(HEADS[encoding].split(","))
    path = text(tmp_path / "table.csv", frame, float_format="%.7f", encoding=encoding)
    _, found = imported(path)
    assert_true(found, truth, f"{PLACES} {MOTION} {CONTROLS} speed_over_ground_mps", 2e-3)


@pytest.mark.parametrize(("head", "east", "west"), [("E/O", "E", "O"), ("O/W", "O", "W"), ("E/W", "E", "W")])
@pytest.mark.parametrize("longitude", [73.1, -73.1])
def test_o_is_west_beside_e_and_east_beside_w(
    tmp_path: Path, head: str, east: str, west: str, longitude: float
) -> None:
    """Oeste, ouest and ovest are west, Ost is east: a hemisphere read wrongly mirrors the track."""
    truth = Truth(place=(-36.8, longitude))
    frame = pd.DataFrame(
        {
            "UTC": truth.local().strftime("%Y-%m-%d %H:%M:%S"), "Lat": np.abs(truth.latitude_deg), "N/S": "S",
            "Lon": np.abs(truth.longitude_deg), head: east if longitude > 0.0 else west,
            "Heading": truth.heading_deg,
        }
    )  # fmt: skip
    proposal, found = imported(text(tmp_path / "table.csv", frame, float_format="%.8f"))
    assert_true(found, truth, f"{PLACES} heading_deg", 2e-3)
    assert not proposal.warnings


def test_an_o_that_may_be_east_or_west_is_not_guessed(tmp_path: Path) -> None:
    truth = Truth()
    frame = pd.DataFrame({"UTC": truth.local().strftime("%Y-%m-%d %H:%M:%S"), "Lat": [f"{x:.6f} N" for x in
                          truth.latitude_deg], "Lon": [f"{x:.6f} O" for x in truth.longitude_deg]})  # fmt: skip
    with pytest.raises(InputError, match="east in some languages and west in others"):
        imported(text(tmp_path / "table.csv", frame))


@pytest.mark.parametrize(("said", "hours"), [("UTC+2", 2), ("UTC -03:00", -3), ("GMT+1", 1), ("UTC+0", 0)])
def test_an_offset_from_utc_in_the_head_is_taken_off(tmp_path: Path, said: str, hours: int) -> None:
    truth = Truth()
    frame = pd.DataFrame(
        {
            f"Time ({said})": (truth.local() + pd.Timedelta(hours=hours)).strftime("%Y-%m-%d %H:%M:%S"),
            "Lat": truth.latitude_deg, "Lon": truth.longitude_deg, "Heading": truth.heading_deg,
        }
    )  # fmt: skip
    proposal, found = imported(text(tmp_path / "table.csv", frame, float_format="%.8f"))
    assert_true(found, truth, f"{PLACES} heading_deg", 2e-3)
    assert not proposal.warnings


def test_positions_of_a_grid_count_from_where_they_begin(tmp_path: Path) -> None:
    """Six million metres of a northing in UTM are no position out of range."""
    truth = Truth()
    frame = pd.DataFrame(
        {
            "Time (UTC)": truth.local().strftime("%Y-%m-%d %H:%M:%S"), "Easting (m)": 400_000.0 + truth.east_m,
            "Northing (m)": 6_384_400.0 + truth.north_m, "Heading (rad)": np.deg2rad(truth.heading_deg),
            "Prop (rps)": truth.rpm / 60.0,
        }
    )  # fmt: skip
    proposal, found = imported(text(tmp_path / "table.csv", frame, float_format="%.6f"))
    assert any("UTM" in each for each in proposal.warnings)
    assert_true(found, truth, "heading_deg propeller_rpm=rpm", 1e-2)
    for name in ("north_m", "east_m"):
        moved = found[name] - found[name].iloc[0]
        assert float(np.max(np.abs(moved - truth.table[name].to_numpy()))) < 1e-3


def test_a_long_table_of_name_value_and_time(tmp_path: Path) -> None:
    truth = Truth()
    wide = {"GPS.Latitude": truth.latitude_deg, "GPS.Longitude": truth.longitude_deg, "Shaft.RPM": truth.rpm,
            "Gyro.Heading": truth.heading_deg, "Rudder.Angle": truth.rudder}  # fmt: skip
    seconds = pd.DatetimeIndex(truth.table.index).as_unit("ns").asi8 / 1e9
    frame = pd.DataFrame({"name": np.repeat(list(wide), truth.rows), "value": np.concatenate(list(wide.values())),
                          "time": np.tile(seconds, len(wide))})  # fmt: skip
    _, found = imported(text(tmp_path / "table.csv", frame))
    assert_true(found, truth, f"{PLACES} heading_deg {CONTROLS}", 2e-3)


def test_a_time_that_is_said_to_be_local_is_asked_of_which_zone(tmp_path: Path) -> None:
    truth = Truth()
    frame = pd.DataFrame(
        {
            "Zeit (Ortszeit)": truth.local("Europe/Berlin").strftime("%d.%m.%Y %H:%M:%S"),
            "Breite [°]": truth.latitude_deg, "Länge [°]": truth.longitude_deg, "Heading [°]": truth.heading_deg,
        }
    )  # fmt: skip
    path = text(tmp_path / "table.csv", frame, float_format="%.8f")
    assert [each.key for each in propose_column_map(read_raw_table(path)).unanswered] == ["zone"]
    _, found = imported(path, zone="Europe/Berlin")
    assert_true(found, truth, f"{PLACES} heading_deg", 2e-3)


@pytest.mark.parametrize(
    ("name", "channel"),
    [
        ("Fahrt voraus [kn]", "surge_mps"), ("Fahrt quer [kn]", "sway_mps"), ("Speed long. (kn)", "surge_mps"),
        ("Speed transv. (kn)", "sway_mps"), ("Speed to starboard [kn]", "sway_mps"),
        ("Fahrt [kn]", "speed_over_ground_mps"),
    ],
)  # fmt: skip
def test_the_two_parts_of_a_speed_are_not_taken_for_the_whole(name: str, channel: str) -> None:
    assert match_quantities(split_header(name).name)[0].quantity.name == channel


@pytest.mark.parametrize(
    ("quantity", "unit"), [("shaft power", "shaft_power_kw"), ("shaft torque", "shaft_torque_knm")]
)
def test_the_load_of_one_shaft_is_not_the_ships(quantity: str, unit: str, tmp_path: Path) -> None:
    """Two shafts have a channel each; a bow thruster and the hull about its axes have none, and this is said."""
    truth = Truth()
    frame = pd.DataFrame({"time": truth.local().astype(str) + "Z", "HDG": truth.heading_deg})
    head_unit = "kW" if "power" in quantity else "kNm"
    for side, load in (("port", 100.0), ("stbd", 200.0)):
        frame[f"{side} rpm"] = truth.rpm
        frame[f"{side} {quantity} [{head_unit}]"] = load
    frame[f"bow thruster {quantity.split()[1]} [{head_unit}]"] = 300.0
    frame["yaw moment [kNm]"] = 400.0
    proposal, found = imported(text(tmp_path / "twin.csv", frame))
    assert found[f"port_propeller_{unit}"].mean() == 100.0
    assert found[f"starboard_propeller_{unit}"].mean() == 200.0
    assert unit not in found
    assert sum("is left out" in warning for warning in proposal.warnings) == 2


def test_a_current_is_declared_and_an_electric_one_is_not(tmp_path: Path) -> None:
    truth = Truth()
    frame = pd.DataFrame({"time": truth.local().astype(str) + "Z", "HDG": truth.heading_deg})
    measured = {"Current speed [kn]": 1.0, "Current direction [deg]": 45.0, "Motor current [A]": 9.0}
    _, found = imported(text(tmp_path / "current.csv", frame.assign(**measured)))
    assert found["current_speed_mps"].mean() == pytest.approx(0.514444, abs=1e-5)
    assert found["current_direction_deg"].mean() == 45.0
    assert not {name for name in found if "motor" in name}


@pytest.mark.parametrize(
    ("header", "speed_mps"),
    [
        ("SOG [m/min]", 1 / 60), ("STW (m min-1)", 1 / 60), ("SOG in km/min", 1000 / 60),
        ("Log speed [ft/min]", 0.3048 / 60), ("SOG [km h-1]", 1 / 3.6), ("STW [nm/hr]", 1852 / 3600),
        ("Speed [cm s-1]", 0.01), ("SOG [0.1 kn]", 185.2 / 3600),
        ("SOG x10 [kn]", 185.2 / 3600), ("SOG (kn*10)", 185.2 / 3600), ("STW [1/100 kn]", 18.52 / 3600),
        ("STW [10^-2 m/s]", 0.01),
    ],
)  # fmt: skip
def test_a_rate_and_a_fixed_point_unit_are_read_by_their_parts(header: str, speed_mps: float) -> None:
    head = split_header(header)
    assert match_quantities(head.name)[0].quantity.unit == "m/s"
    assert unit_scale("m/s", head.units[0]) == pytest.approx(speed_mps)


@pytest.mark.parametrize("header", ["STW [cables/min]", "SOG [furlongs/h]", "SOG [M/h]"])
def test_a_unit_that_is_not_known_is_not_read_in_part(header: str) -> None:
    """Not as the minutes or hours behind its slash; an M is a mile at sea, and a metre elsewhere."""
    assert split_header(header).units == ()
