"""Times of tables: written in a known form from known instants, and read back by ``import``."""

from __future__ import annotations

import contextlib
import datetime as dt
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from seatrial.acquisition.core.errors import ConfigurationError, InputError
from seatrial.acquisition.core.times import gps_minus_utc_s
from seatrial.acquisition.tables.column_map import apply_column_map, parse_column_map
from seatrial.acquisition.tables.import_table import Proposal, import_table, propose_column_map
from seatrial.acquisition.tables.table_files import read_raw_table
from seatrial.acquisition.tables.time_columns import TimeColumn, checked_zone, local_times_to_utc, resolve_times
from tests.conftest import Command, nightly

START = dt.datetime(2026, 5, 17, 12, 0, 0, 500_000, dt.UTC)


def instants(rows: int = 60, start: dt.datetime = START, step_s: float = 1.0) -> pd.DatetimeIndex:
    return pd.DatetimeIndex([start + dt.timedelta(seconds=row * step_s) for row in range(rows)]).as_unit("ns")


def table(path: Path, cells: list[str], head: str = "time", date: list[str] | None = None) -> Path:
    """A semicolon table of times and a heading."""
    names = [*(["Date"] if date else []), head, "heading"]
    lines = [";".join(names)]
    for row, cell in enumerate(cells):
        lines.append(";".join([*([date[row]] if date else []), cell, f"{100.0 + row / 2:.1f}"]))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def read(path: Path, **answers: str) -> tuple[Proposal, pd.DatetimeIndex]:
    """What is proposed for a table, and its times."""
    import tomllib

    raw = read_raw_table(path)
    proposal = propose_column_map(raw, answers)
    assert not proposal.unanswered, proposal.unanswered
    return proposal, resolve_times(raw, TimeColumn(**tomllib.loads(proposal.text)["time"])).index


@pytest.mark.parametrize(
    "form",
    [
        "%d.%m.%Y %H:%M:%S.%f", "%Y-%m-%d %H:%M:%S:%f", "%d-%b-%Y %I:%M:%S.%f %p", "%Y/%m/%d %H:%M:%S,%f",
        "%B %d, %Y %I:%M:%S.%f %p", "%d %B %Y, %H:%M:%S.%f", "%Y%m%dT%H%M%S.%f", "%Y%m%d%H%M%S.%f",
        "%a %d.%m.%y %H:%M:%S.%f", "%m/%d/%Y %H.%M.%S.%f", "%Y-%j:%H:%M:%S.%f", "%d.%m.%Y - %H:%M:%S.%f",
        "%d/%b/%Y %Hh%Mm%S.%fs", "%Y-%m-%d %H h %M min %S,%f s", "%Y%m%d %H:%M:%S.%f",
    ],
)  # fmt: skip
@pytest.mark.parametrize(
    ("zone", "hours"),
    [
        ("", 0.0), (" CEST", 2.0),
        *nightly((" GMT-3", -3.0), (" UTC+02:00", 2.0), (" EST", -5.0), ("Z", 0.0), (" +0530", 5.5)),
    ],
)  # fmt: skip
def test_times_in_any_form_and_zone_come_back(tmp_path: Path, form: str, zone: str, hours: float) -> None:
    expected = instants()
    local = expected + pd.Timedelta(hours=hours)
    _, found = read(table(tmp_path / "t.csv", [each.strftime(form) + zone for each in local]))
    assert found.asi8.tolist() == expected.asi8.tolist()


@pytest.mark.parametrize("unit", ["ms", "us"])
def test_a_counter_of_32_bits_runs_on(unit: str, tmp_path: Path) -> None:
    """One that begins again is told from one that is started again: it does so at its end."""
    step = 1000 if unit == "ms" else 1_000_000
    counts = [(2**32 - 30 * step - 1 + row * step) % 2**32 for row in range(60)]
    proposal, found = read(table(tmp_path / "t.csv", [str(count) for count in counts], f"time [{unit}]"))
    assert np.diff(found.asi8).tolist() == [10**9] * 59
    assert any("began again" in warning for warning in proposal.warnings)
    restarted = [str(count) for count in (*range(9 * step, 39 * step, step), *range(0, 30 * step, step))]
    proposal, _ = read(table(tmp_path / "r.csv", restarted, f"time [{unit}]"))
    assert not any("began again" in warning for warning in proposal.warnings)


@pytest.mark.parametrize(("unit", "step"), [("ns", 10**9), ("ns", 10**6), ("min", 1), ("h", 1)])
def test_a_step_back_is_no_counter_that_began_again(unit: str, step: int, tmp_path: Path) -> None:
    """Of times since 1970 in ns, where two rows are exchanged, and of counts that are far below 2^32."""
    counts = [1_779_019_200 * 10**9 // (1 if unit == "ns" else 10**15) + row * step for row in range(60)]
    counts[30], counts[31] = counts[31], counts[30]
    proposal, found = read(table(tmp_path / "t.csv", [str(count) for count in counts], f"time [{unit}]"))
    assert not any("began again" in warning for warning in proposal.warnings)
    assert len(found) == 60
    assert (found.max() - found.min()).value == 59 * step * {"ns": 1, "min": 60 * 10**9, "h": 3600 * 10**9}[unit]


@pytest.mark.parametrize("has_clock", [True, False])
@pytest.mark.parametrize(
    "names", ["Year Month Day Hour Minute Second", "UTC yr,UTC mon,UTC day,UTC hr,UTC min,UTC sec"]
)
def test_the_parts_of_a_time_in_columns_of_their_own(tmp_path: Path, names: str, has_clock: bool) -> None:
    """Over the end of a month; the seconds have decimals, and the time of day may be one column."""
    expected = instants(start=dt.datetime(2026, 5, 31, 23, 59, 30, 250_000, dt.UTC))
    forms = ["%Y", "%m", "%d", "%H", "%M", "%S.%f"]
    heads = names.split("," if "," in names else None)
    if has_clock:
        heads, forms = [*heads[:3], "Time"], [*forms[:3], "%H:%M:%S.%f"]
    rows = [[each.strftime(form) for form in forms] for each in expected]
    lines = [";".join([*heads, "heading"]), *(";".join([*cells, "100.0"]) for cells in rows)]
    (tmp_path / "t.csv").write_text("\n".join(lines) + "\n")
    _, found = read(tmp_path / "t.csv")
    assert found.asi8.tolist() == expected.asi8.tolist()
    import_table(tmp_path / "t.csv", tmp_path / "t.mcap", _written_map(tmp_path), allow_missing=True)


def _written_map(folder: Path) -> Path:
    text = propose_column_map(read_raw_table(folder / "t.csv")).text
    (folder / "map.toml").write_text(text)
    return folder / "map.toml"


def _cells(index: pd.DatetimeIndex, form: str) -> list[str]:
    """Cells of a form: of strftime, or a sum of the parts of a day that is worked out here."""
    day_s = (index - index.normalize()).total_seconds()
    days_1970 = index.asi8 / 86_400e9
    numbers = {
        "doy": index.day_of_year.to_numpy(), "decimal doy": index.day_of_year + day_s / 86_400.0,
        "second of day": day_s, "hours": day_s / 3600.0, "ms of day": (day_s * 1000.0).round().astype(int),
        "decimal day": index.day + day_s / 86_400.0, "ms": index.microsecond // 1000, "days 1970": days_1970,
        "excel": days_1970 + 25_569.0, "excel day": np.floor(days_1970).astype(int) + 25_569,
        "datenum": days_1970 + 719_529.0, "excel 1904": days_1970 + 24_107.0, "unix": index.asi8 // 10**9,
        "nsec": index.asi8 % 10**9, "days 1950": days_1970 + 7305.0, "hours 2026": (days_1970 - 20_454.0) * 24.0,
        "s 2000": days_1970 * 86_400.0 - 946_684_800.0, "ntp": days_1970 * 86_400.0 + 2_208_988_800.0,
    }  # fmt: skip
    values = numbers.get(form)
    if values is None:
        return list(index.strftime(form))
    return [f"{value:.10f}" if isinstance(value, float) else str(value) for value in np.asarray(values).tolist()]


@pytest.mark.parametrize(
    "forms",
    [
        {"Year": "%Y", "DOY": "doy", "Seconds": "second of day"},
        {"Year": "%Y", "Julian day": "doy", "Time": "%H:%M:%S.%f"},
        {"year": "%Y", "yday": "doy", "hour": "%H", "minute": "%M", "second": "%S.%f"},
        {"Year": "%Y", "DOY": "decimal doy"},
        {"Date": "%Y%j", "Time": "%H:%M:%S.%f"},
        {"Date": "%Y-%j", "UTC": "%H:%M:%S.%f"},
        {"Date": "%Y-%m-%d", "Seconds of day": "second of day"},
        {"Date": "%d.%m.%Y", "Time [ms]": "ms of day"},
        {"Date": "%Y-%m-%d", "Hour": "%H", "Minute": "%M", "Second": "%S.%f"},
        {"Date": "excel day", "Time": "%H:%M:%S.%f"},
        {"Date": "%Y-%m-%d", "Time": "%H:%M:%S", "ms": "ms"},
        {"DateTime": "%d.%m.%Y %H:%M:%S", "Milliseconds": "ms"},
        {"Year": "%Y", "Month": "%m", "Day": "%d", "Hour": "hours"},
        {"Year": "%Y", "Month": "%m", "Day": "decimal day"},
        {"YYYY": "%Y", "MM": "%m", "DD": "%d", "hh": "%H", "mm": "%M", "ss": "%S.%f"},
        {"UTC": "%H%M%S.%f", "Date yymmdd": "%y%m%d"},
        {"Date (ddmmyy)": "%d%m%y", "Time (hhmmss)": "%H%M%S.%f"},
        {"secs": "unix", "nsecs": "nsec"},
        {"Unix time": "unix", "ms": "ms"},
        {"Unix time": "unix", "ns": "nsec"},
        {"NTP time": "ntp"},
        {"days since 1970-01-01": "days 1970"},
        {"Time (d)": "days 1970"},
        {"Time [days since 1950-01-01]": "days 1950"},
        {"hours since 2026-01-01 00:00:00": "hours 2026"},
        {"time_seconds_since_2000-01-01": "s 2000"},
        {"Excel serial": "excel"},
        {"datenum": "datenum"},
        {"Excel date 1904": "excel 1904"},
    ],
    ids=lambda forms: ", ".join(forms),
)  # fmt: skip
def test_times_in_parts_and_counts_come_back(tmp_path: Path, forms: dict[str, str]) -> None:
    """Over the end of a day in a leap year; to the rounding of what is written."""
    expected = instants(300, dt.datetime(2024, 5, 12, 23, 58, 10, 250_000, dt.UTC))
    columns = {name: _cells(expected, form) for name, form in forms.items()}
    rows = [";".join([*cells, "100.0"]) for cells in zip(*columns.values(), strict=True)]
    (tmp_path / "t.csv").write_text("\n".join([";".join([*columns, "heading"]), *rows]) + "\n")
    _, found = read(tmp_path / "t.csv")
    assert np.abs(found.asi8 - expected.asi8).max() < 100_000
    import_table(tmp_path / "t.csv", tmp_path / "t.mcap", _written_map(tmp_path), allow_missing=True)


def test_the_day_of_a_year_without_the_year_is_asked(tmp_path: Path) -> None:
    path = table(tmp_path / "t.csv", [f"{137.5 + row / 86_400:.9f}" for row in range(30)], "DOY")
    assert [question.key for question in propose_column_map(read_raw_table(path)).unanswered] == ["year"]
    _, found = read(path, year="2024")
    assert found[0] == pd.Timestamp("2024-05-16T12:00:00Z")


@pytest.mark.parametrize(
    ("answer", "hour"), [({"time_unit": "s"}, 12), ({"time_unit": "hhmmss"}, 4)], ids=["seconds", "hhmmss"]
)
def test_digits_that_may_be_seconds_since_midnight_are_asked(
    answer: dict[str, str], hour: int, tmp_path: Path
) -> None:
    """43200 is noon or 04:32:00; 43260 in a later row is no time of day in digits."""
    day = ["2026-05-17"] * 30
    path = table(tmp_path / "t.csv", [str(43_200 + row) for row in range(30)], date=day)
    assert [question.key for question in propose_column_map(read_raw_table(path)).unanswered] == ["time_unit"]
    assert read(path, **answer)[1][0].hour == hour
    path = table(tmp_path / "u.csv", [str(43_250 + row) for row in range(30)], date=day)
    assert read(path)[1][0] == pd.Timestamp("2026-05-17T12:00:50Z")


def test_a_count_beside_a_date_is_said_to_be_since_midnight(tmp_path: Path) -> None:
    """It may be one since the log began, of which the answer is the first row's time."""
    path = table(tmp_path / "t.csv", [str(row) for row in range(30)], "Time [s]", date=["2026-05-17"] * 30)
    proposal, found = read(path)
    assert found[0] == pd.Timestamp("2026-05-17T00:00:00Z")
    assert any("since midnight" in warning and "start=" in warning for warning in proposal.warnings)
    _, found = read(path, start="2026-05-17T12:00:00Z")
    assert found[0] == pd.Timestamp("2026-05-17T12:00:00Z")
    assert np.diff(found.asi8).tolist() == [10**9] * 29


def test_seconds_of_the_size_of_serial_days_are_not_taken_for_days(tmp_path: Path) -> None:
    """Noon in seconds since midnight is a day of 2018 in Excel; at 100 Hz the steps decide nothing."""
    cells = [f"{43_200.0 + row / 100:.2f}" for row in range(60)]
    _, found = read(table(tmp_path / "t.csv", cells, "time [s]"))
    assert (found[-1] - found[0]).total_seconds() == 0.59
    assert [
        question.key for question in propose_column_map(read_raw_table(table(tmp_path / "u.csv", cells))).unanswered
    ] == ["time_unit"]


@pytest.mark.parametrize(("month", "number"), [("mai", 5), ("août", 8), ("Dez", 12), ("Okt.", 10), ("mrt", 3)])
def test_months_by_their_names_in_other_languages(tmp_path: Path, month: str, number: int) -> None:
    cells = [f"17 {month} 2026 12:00:{second:02d}" for second in range(20)]
    _, found = read(table(tmp_path / "t.csv", cells))
    assert found[0] == pd.Timestamp(2026, number, 17, 12, tz="UTC")


@pytest.mark.parametrize("order", ["day-first", "month-first"])
def test_the_whole_column_decides_the_order_of_day_and_month(tmp_path: Path, order: str) -> None:
    """The 13th is in the last row alone."""
    form = "%d/%m/%Y %H:%M:%S" if order == "day-first" else "%m/%d/%Y %H:%M:%S"
    expected = instants(100, dt.datetime(2026, 5, 12, 22, tzinfo=dt.UTC), 75.0)
    proposal, found = read(table(tmp_path / "t.csv", [each.strftime(form) for each in expected]))
    assert found.asi8.tolist() == expected.asi8.tolist()
    assert not proposal.questions or proposal.questions[0].key == "zone"
    other = "month-first" if order == "day-first" else "day-first"
    with pytest.raises(ConfigurationError, match=f"date_order={other} cannot be used"):
        propose_column_map(read_raw_table(tmp_path / "t.csv"), {"date_order": other})


def test_an_order_that_nothing_decides_is_asked_with_the_first_example(tmp_path: Path) -> None:
    path = table(tmp_path / "t.csv", [f"05/06/26 12:00:{second:02d}" for second in range(30)])
    (question,) = propose_column_map(read_raw_table(path)).unanswered
    assert question.key == "date_order"
    assert "05/06/26 12:00:00" in question.text
    assert "5 June 2026" in question.text
    for order, day in (("day-first", "2026-06-05"), ("month-first", "2026-05-06")):
        _, found = read(path, date_order=order)
        assert str(found[0].date()) == day


@pytest.mark.parametrize("text", ["12 Uhr 7", "noon", "2026-05-17T25:61:00", "17 Xyz 2026 12:00:07", "1,2,3"])
def test_a_time_that_is_not_understood_is_shown(tmp_path: Path, text: str) -> None:
    with pytest.raises(InputError) as caught:
        propose_column_map(read_raw_table(table(tmp_path / "t.csv", [text] * 9)))
    assert text in str(caught.value)
    assert "rename" not in str(caught.value)


def test_rows_without_a_time_are_counted_with_an_example(tmp_path: Path) -> None:
    cells = [f"17.05.2026 12:00:{second:02d}" for second in range(30)]
    cells[4] = "no fix"
    proposal, _ = read(table(tmp_path / "t.csv", cells))
    assert any("1 rows" in each and "'no fix' in row 5" in each for each in proposal.warnings)


ZONES = ["Europe/Berlin", "America/New_York", "Australia/Lord_Howe", "Atlantic/Azores", "America/St_Johns"]


@given(
    zone=st.sampled_from(ZONES), year=st.integers(2010, 2026), before_min=st.integers(80, 300),
    rows=st.integers(100, 400), step_s=st.sampled_from([60, 97, 150]),
)  # fmt: skip
@settings(max_examples=60, deadline=None)
def test_rows_run_on_when_the_clock_is_changed(
    zone: str, year: int, before_min: int, rows: int, step_s: int
) -> None:
    """The order of the rows states which of the doubled hours it is."""
    hours = pd.date_range(f"{year}-01-01", f"{year + 1}-01-01", freq="h", tz="UTC")
    offsets = hours.tz_convert(zone).tz_localize(None) - hours.tz_localize(None)
    for change in hours[1:][np.diff(offsets.asi8) != 0]:
        expected = pd.date_range(
            change - pd.Timedelta(minutes=before_min), periods=rows, freq=f"{step_s}s"
        ).as_unit("ns")
        local = expected.tz_convert(zone).tz_localize(None).as_unit("ns").asi8
        found, remark = local_times_to_utc(local, zone)
        assert found.tolist() == expected.asi8.tolist()
        assert not remark


@pytest.mark.parametrize(("start", "hours"), [("2018-10-27T22:00:00", 2), ("2018-03-24T23:00:00", 1)])
def test_a_clock_that_was_not_changed_keeps_its_durations(start: str, hours: int) -> None:
    expected = pd.date_range(start, periods=300, freq="60s").as_unit("ns").asi8
    found, remark = local_times_to_utc(expected + hours * 3600 * 10**9, "Europe/Berlin")
    assert found.tolist() == expected.tolist()
    assert "was not put" in remark
    assert f"+0{hours}:00" in remark


def test_a_doubled_hour_that_nothing_decides_is_said() -> None:
    local = pd.date_range("2018-10-28T02:10:00", periods=20, freq="60s").as_unit("ns").asi8
    found, remark = local_times_to_utc(local, "Europe/Berlin")
    assert found[0] == pd.Timestamp("2018-10-28T00:10:00").as_unit("ns").value
    assert "comes twice" in remark
    assert "zone=+01:00" in remark


@pytest.mark.parametrize(
    ("day", "seconds"),
    [("1999-08-21", 13), ("2005-12-31", 13), ("2008-12-31", 14), ("2012-07-02", 16), ("2016-12-31", 17),
     ("2026-05-17", 18)],
)  # fmt: skip
@pytest.mark.parametrize("head", ["GPS Zeit", *nightly("GPST", "GPS time", "gps_time")])
def test_gps_time_is_ahead_by_the_leap_seconds_of_its_day(
    tmp_path: Path, day: str, seconds: int, head: str
) -> None:
    path = table(tmp_path / "t.csv", [f"{day} 12:00:{second:02d}" for second in range(30)], head)
    proposal, found = read(path)
    assert found[0] == pd.Timestamp(f"{day}T12:00:00Z") - pd.Timedelta(seconds=seconds)
    assert any("leap seconds" in each for each in proposal.warnings)
    _, as_utc = read(path, zone="UTC")
    assert as_utc[0] == pd.Timestamp(f"{day}T12:00:00Z")


@pytest.mark.parametrize("form", ["text", "s since 1970", "ns since 1970", "s since 1958", "in the cells"])
def test_times_of_tai_become_utc(tmp_path: Path, form: str) -> None:
    """By their name: they were taken for UTC, 37 s off. TAI - UTC is 37 s since 2017 (IERS, Bulletin C)."""
    tai = instants() + pd.Timedelta(37, "s")
    seconds = tai.as_unit("ns").asi8 / 1e9
    cells, head = {
        "text": ([f"{stamp:%Y-%m-%d %H:%M:%S.%f}" for stamp in tai], "Time (TAI)"),
        "s since 1970": ([f"{second:.6f}" for second in seconds], "time_tai [s]"),
        "ns since 1970": ([str(ns) for ns in tai.as_unit("ns").asi8], "timestamp_tai_ns"),
        "s since 1958": ([f"{second - pd.Timestamp('1958-01-01').timestamp():.6f}" for second in seconds], "tai_s"),
        "in the cells": ([f"{stamp:%Y-%m-%d %H:%M:%S.%f} TAI" for stamp in tai], "time"),
    }[form]
    path = table(tmp_path / "t.csv", cells, head)
    _, found = read(path)
    assert np.abs(found - instants()).max() <= pd.Timedelta(1, "us")
    if form != "s since 1958":
        assert np.abs(read(path, zone="UTC")[1] - tai).max() <= pd.Timedelta(1, "us")


def test_times_of_tai_that_name_a_zone_are_asked(tmp_path: Path) -> None:
    path = table(tmp_path / "t.csv", [f"{stamp:%Y-%m-%dT%H:%M:%SZ}" for stamp in instants()], "time_tai")
    (question,) = propose_column_map(read_raw_table(path)).unanswered
    assert (question.key, question.options) == ("zone", ("TAI", "UTC"))
    assert read(path, zone="TAI")[1][0] == read(path, zone="UTC")[1][0] - pd.Timedelta(37, "s")


@pytest.mark.parametrize("head", ["GPS UTC time", "Time (UTC) from GPS", "gps_utc"])
def test_utc_that_a_receiver_states_is_utc(tmp_path: Path, head: str) -> None:
    _, found = read(table(tmp_path / "t.csv", [f"2026-05-17 12:00:{second:02d}" for second in range(9)], head))
    assert found[0] == pd.Timestamp("2026-05-17T12:00:00Z")


def test_leap_seconds_are_those_of_the_instant() -> None:
    """The last of 2016 was inserted at 2017-01-01 00:00:17 GPS time."""
    last = int(pd.Timestamp("2017-01-01T00:00:17").as_unit("ns").value)
    assert (gps_minus_utc_s(last - 1), gps_minus_utc_s(last), gps_minus_utc_s(last + 10**9)) == (17, 17, 18)
    assert gps_minus_utc_s(0) == 0


@pytest.mark.parametrize(
    ("head", "hours"),
    [("Time (CEST)", 2), ("Zeit [MESZ]", 2), ("Time UTC+05:30", 5.5), ("time EST", -5), ("Time (Europe/Oslo)", 2),
     ("Timestamp (GMT-3)", -3), ("Time (+02:00)", 2)],
)  # fmt: skip
def test_a_zone_in_the_head_is_applied(tmp_path: Path, head: str, hours: float) -> None:
    expected = instants(20, dt.datetime(2026, 5, 17, 12, tzinfo=dt.UTC))
    cells = [(each + pd.Timedelta(hours=hours)).strftime("%Y-%m-%d %H:%M:%S") for each in expected]
    proposal, found = read(table(tmp_path / "t.csv", cells, head))
    assert found.asi8.tolist() == expected.asi8.tolist()
    assert not proposal.warnings


@pytest.mark.parametrize("zone", ["CST", "IST", "BST"])
@pytest.mark.parametrize("place", ["cell", "head"])
def test_a_zone_that_stands_for_several_is_asked(tmp_path: Path, zone: str, place: str) -> None:
    behind, head = (f" {zone}", "time") if place == "cell" else ("", f"Time ({zone})")
    path = table(tmp_path / "t.csv", [f"17.05.2026 12:00:{second:02d}{behind}" for second in range(9)], head)
    assert [each.key for each in propose_column_map(read_raw_table(path)).unanswered] == ["zone"]
    _, found = read(path, zone="-06:00")
    assert found[0] == pd.Timestamp("2026-05-17T18:00:00Z")


@pytest.mark.parametrize(
    "zone", ["UTC+2", "Europe/Berlin", *nightly("Etc/GMT-2", "+02:00", "GMT+2", "CEST", "+0200")]
)
@pytest.mark.parametrize("way", ["proposed", "standard names", "map", "map of text"])
def test_an_answered_zone_is_honoured_whatever_the_way(
    tmp_path: Path, command: Command, zone: str, way: str
) -> None:
    head = "heading" if way == "proposed" else "heading_deg"
    stamp = "2026-05-17T14:00:0{}" if way != "map of text" else "17.05.2026 14:00:0{}"
    path = tmp_path / "t.csv"
    path.write_text(f"time,{head}\n" + "".join(f"{stamp.format(second)},{second}\n" for second in range(9)))
    columns = tmp_path / "map.toml"
    form = "text" if way == "map of text" else "iso"
    columns.write_text(
        f'absent = {ABSENT}\n[time]\ncolumn = "time"\nformat = "{form}"\nzone = "UTC"\n'
        '[channels]\nheading_deg = { column = "heading_deg" }\n'
    )
    options = ["--columns", columns] if way.startswith("map") else ["--yes", "--allow-missing"]
    done = command("import", path, "-o", tmp_path / "o.mcap", *options, "--answer", f"zone={zone}")
    assert done.code == 0, done.err
    command("export", tmp_path / "o.mcap", "-o", tmp_path / "v.csv")
    assert (tmp_path / "v.csv").read_text().splitlines()[1].startswith("2026-05-17T12:00:00")


ABSENT = (
    '["north_m", "east_m", "surge_mps", "sway_mps", "yaw_rate_dps", "wind_direction_deg", "wind_speed_mps",'
    ' "port_rpm", "port_angle_deg", "starboard_rpm", "starboard_angle_deg", "tunnel_rpm"]'
)


def test_an_answer_counts_for_more_than_what_the_text_names(tmp_path: Path) -> None:
    """A logger that writes Z behind its local time."""
    path = table(tmp_path / "t.csv", [f"2026-05-17T14:00:{second:02d}Z" for second in range(9)])
    proposal, found = read(path, zone="+02:00")
    assert found[0] == pd.Timestamp("2026-05-17T12:00:00Z")
    assert any("ignored" in reason for each in proposal.readings for reason in each.reasons)


@pytest.mark.parametrize(
    ("answers", "says"),
    [({"start": "2026-05-17T12:00:00Z"}, None), ({"date_order": "day-first"}, "date_order"),
     ({"wind": "true"}, "wind"), ({"zone": "Mars"}, "zone"), ({"unit.heading": "furlongs"}, "furlongs"),
     ({"unit.x": "m"}, "unit.x")],
)  # fmt: skip
def test_an_answer_beside_a_map_is_applied_or_refused(
    tmp_path: Path, answers: dict[str, str], says: str | None
) -> None:
    path = table(tmp_path / "t.csv", [str(second) for second in range(9)], "t")
    (tmp_path / "map.toml").write_text(
        f'absent = {ABSENT}\n[time]\ncolumn = "t"\nformat = "seconds"\n'
        '[channels]\nheading_deg = { column = "heading" }\n'
    )

    def run() -> object:
        return import_table(path, tmp_path / "o.mcap", tmp_path / "map.toml", answers=answers)

    if says is None:
        run()
    else:
        with pytest.raises(ConfigurationError, match=says):
            run()


def test_an_answer_that_is_not_needed_is_said(tmp_path: Path) -> None:
    path = table(tmp_path / "t.csv", [f"2026-05-17T14:00:{second:02d}Z" for second in range(9)])
    proposal, _ = read(path, day="2026-05-17")
    assert any("day=2026-05-17 is not used" in each for each in proposal.warnings)


@pytest.mark.parametrize(
    "write",
    [
        lambda times: table_of_both(times, "%Y-%m-%dT%H:%M:%S.%fZ"),
        lambda times: table_of_both(times, "%d.%m.%Y %H:%M:%S.%f"),
        lambda times: [f"{each.timestamp():.3f}" for each in times],
    ],
)
def test_the_newest_row_first_is_turned_round_and_said(
    tmp_path: Path, write: Callable[[pd.DatetimeIndex], list[str]]
) -> None:
    expected = instants()
    path = table(tmp_path / "t.csv", write(expected[::-1]), "time UTC")
    proposal, found = read(path)
    assert found.asi8.tolist() == expected.asi8.tolist()
    assert any("newest row" in each for each in proposal.warnings)


def table_of_both(times: pd.DatetimeIndex, form: str) -> list[str]:
    return [each.strftime(form) for each in times]


def test_times_of_day_alone_newest_first_run_over_midnight(tmp_path: Path) -> None:
    expected = instants(120, dt.datetime(2026, 5, 17, 23, 59, tzinfo=dt.UTC))
    path = table(tmp_path / "t.csv", [each.strftime("%H:%M:%S") for each in expected[::-1]], "time UTC")
    _, found = read(path, day="2026-05-17")
    assert found.asi8.tolist() == expected.asi8.tolist()


@pytest.mark.parametrize(
    "start", ["1970-01-01 00:00:05", "1980-01-06 00:00:05", "1899-12-30 07:00:00", "1904-01-01 00:00:00",
              "0001-01-01 00:00:01"]
)  # fmt: skip
def test_a_clock_that_was_not_set_costs_no_durations(tmp_path: Path, start: str) -> None:
    began = dt.datetime.fromisoformat(start)
    steps = np.array([0, 1, 2, 5, 6, 7, 60, 61, 62, 63])
    path = table(tmp_path / "t.csv", [str(began + dt.timedelta(seconds=int(step))) for step in steps])
    proposal, found = read(path)
    assert ((found.asi8 - found.asi8[0]) / 1e9).tolist() == steps.tolist()
    assert any("--answer start=" in each for each in proposal.warnings)
    _, set_right = read(path, start="2026-05-17T12:00:00Z")
    assert set_right[0] == pd.Timestamp("2026-05-17T12:00:00Z")
    assert ((set_right.asi8 - set_right.asi8[0]) / 1e9).tolist() == steps.tolist()


def test_a_clock_that_is_set_within_the_table_is_said_and_rows_run_on(tmp_path: Path) -> None:
    early = [f"1970-01-01 00:00:{second:02d}" for second in range(20)]
    late = [f"2026-05-17 12:00:{second:02d}" for second in range(20)]
    proposal, found = read(table(tmp_path / "t.csv", early + late))
    assert np.diff(found.asi8).tolist() == [10**9] * 39
    assert found[20] == pd.Timestamp("2026-05-17T12:00:00Z")
    assert any("was set in row 21" in each for each in proposal.warnings)


def test_dates_without_a_year_are_asked(tmp_path: Path) -> None:
    path = table(tmp_path / "t.csv", [f"May 17 12:00:{second:02d}" for second in range(9)])
    assert [each.key for each in propose_column_map(read_raw_table(path)).unanswered] == ["year"]
    _, found = read(path, year="2026")
    assert found[0] == pd.Timestamp("2026-05-17T12:00:00Z")


@pytest.mark.parametrize(
    ("dates", "clocks"),
    [("%d.%m.%Y", "%H:%M:%S"), ("%Y-%m-%d", "%I:%M:%S %p"), ("%d-%b-%y", "%H:%M:%S:%f"), ("%Y%m%d", "%H%M%S"),
     ("%d%m%y", "%H%M%S.%f"), ("%Y/%m/%d", "%H.%M.%S")],
)  # fmt: skip
def test_date_and_time_in_two_columns(tmp_path: Path, dates: str, clocks: str) -> None:
    expected = instants(90, dt.datetime(2026, 5, 17, 23, 59, tzinfo=dt.UTC))
    cells = [each.strftime(clocks) for each in expected]
    path = table(tmp_path / "t.csv", cells, "Time UTC", [each.strftime(dates) for each in expected])
    _, found = read(path)
    assert found.asi8.tolist() == expected.asi8.tolist()


@pytest.mark.parametrize("head", ["original_timestamp", "log entry", "Unnamed", "recorded at", "stempel"])
def test_a_column_of_dates_is_found_under_a_name_that_says_nothing(tmp_path: Path, head: str) -> None:
    _, found = read(table(tmp_path / "t.csv", [f"2026-05-17 12:00:{second:02d}" for second in range(20)], head))
    assert found[0] == pd.Timestamp("2026-05-17T12:00:00Z")


def test_seconds_count_from_the_start_in_the_lines_before_the_header(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    rows = "".join(f"{second},{second}.0\n" for second in range(20))
    path.write_text(f"Yard,X\nStart of log: 17.05.2026 12:00:00\nExported: 2026-06-01 08:00:00\nt,heading\n{rows}")
    proposal, found = read(path, **{"unit.heading": "deg"})
    assert found[0] == pd.Timestamp("2026-05-17T12:00:00Z")
    assert not any("unknown start" in each for each in proposal.warnings)


@pytest.mark.parametrize("zone", ["Oslo", "+25", "UTC+", "CST", "", "GPS time"])
def test_what_is_no_zone_is_refused(zone: str) -> None:
    with pytest.raises(ValueError, match="zone"):
        checked_zone(zone)


@given(
    head=st.sampled_from(["time", "GPS time", "date", "t", "x", "Zeit (CST)"]),
    cells=st.lists(
        st.one_of(
            st.text(alphabet="0123456789:-/. TZUCPMapm+", max_size=24), st.floats(0, 1e19).map(str),
            st.integers(10**7, 10**15).map(str), st.datetimes().map(str),
            st.sampled_from(["", "-", "May 17 12:00"]),
        ),
        min_size=1, max_size=12,
    ),
)  # fmt: skip
@settings(max_examples=100, deadline=None)
@example(head="time", cells=["00000101 00", "00000101T00Z"])
def test_any_cells_are_times_or_an_error_of_ours(
    tmp_path_factory: pytest.TempPathFactory, head: str, cells: list[str]
) -> None:
    path = table(tmp_path_factory.mktemp("any") / "t.csv", cells, head)
    with contextlib.suppress(InputError, ConfigurationError):
        propose_column_map(read_raw_table(path))


@pytest.mark.parametrize(
    "head",
    [
        "GPS week;TOW [s]",
        "week;time of week",
        "GWk;GMS",
        "gps_week;itow",
        "Week;GPSTime",
        "GPS Week;Seconds of Week (s)",
    ],
)
@pytest.mark.parametrize(
    "start", [START, dt.datetime(2026, 5, 16, 23, 59, 30, tzinfo=dt.UTC), dt.datetime(2012, 6, 3, tzinfo=dt.UTC)]
)
def test_weeks_of_gps_and_what_has_passed_of_them(tmp_path: Path, head: str, start: dt.datetime) -> None:
    expected = instants(start=start)
    gps_ns = [
        each + gps_minus_utc_s(each) * 10**9 - pd.Timestamp("1980-01-06").value for each in expected.asi8.tolist()
    ]
    weeks, passed = np.divmod(np.array(gps_ns), 7 * 86_400 * 10**9)
    in_ms = any(word in head for word in ("GMS", "itow"))
    lines = [
        f"{week};{ns / (1e6 if in_ms else 1e9):.3f};{100.0 + row}"
        for row, (week, ns) in enumerate(zip(weeks, passed, strict=True))
    ]
    path = tmp_path / "t.csv"
    path.write_text("\n".join([f"{head};heading", *lines]) + "\n")
    proposal, found = read(path)
    assert found.asi8.tolist() == expected.asi8.tolist()
    assert any("GPS time, which is ahead of UTC by the leap seconds" in warning for warning in proposal.warnings)
    _, as_utc = read(path, zone="UTC")
    assert ((as_utc - expected).total_seconds() == gps_minus_utc_s(expected.asi8[0])).all()


def test_weeks_that_have_rolled_over_are_reported(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_text("week,tow,heading\n" + "".join(f"371,{43_218 + row},{row}\n" for row in range(20)))
    proposal, _ = read(path)
    assert any("count weeks to 1023" in warning for warning in proposal.warnings)
    _, found = read(path, start="2026-05-17T12:00:00Z")
    assert found[0] == pd.Timestamp("2026-05-17T12:00:00Z")
    assert (np.diff(found.asi8) == 10**9).all()


def test_a_time_of_week_alone_keeps_its_durations(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_text("iTOW,heading\n" + "".join(f"{604_700_000 + 500 * row},{row}\n" for row in range(20)))
    proposal, found = read(path)
    assert any("unknown start" in warning for warning in proposal.warnings)
    assert (np.diff(found.asi8) == 5 * 10**8).all()


@pytest.mark.parametrize(
    ("form", "other"), [("%d/%m/%y", "year-first"), ("%y/%m/%d", "year-first"), ("%m/%d/%y", None)]
)
def test_two_digits_of_a_year_stand_last_behind_slashes_which_is_reported(
    tmp_path: Path, form: str, other: str | None
) -> None:
    expected = instants(start=dt.datetime(2026, 5, 17, 12, tzinfo=dt.UTC))
    path = table(tmp_path / "t.csv", [each.strftime(f"{form} %H:%M:%S") for each in expected])
    proposal, found = read(path)
    warned = [warning for warning in proposal.warnings if "date_order=year-first" in warning]
    assert len(warned) == (other is not None)
    if form == "%y/%m/%d":
        assert "17 May 2026" in warned[0]
        _, found = read(path, date_order="year-first")
    assert found.asi8.tolist() == expected.asi8.tolist()


@pytest.mark.parametrize(
    "head", ["Time zone", "Zeitzone", *nightly("tz", "UTC offset", "timezone", "fuseau horaire")]
)
@pytest.mark.parametrize(
    ("zone", "hours"), [("+02:00", 2), ("-03:30", -3.5), ("CEST", 2), ("Europe/Oslo", 2), ("UTC", 0)]
)
def test_a_zone_in_a_column_of_its_own_is_applied(tmp_path: Path, head: str, zone: str, hours: float) -> None:
    expected = instants()
    local = expected + pd.Timedelta(hours=hours)
    lines = [f"{each:%Y-%m-%d};{each:%H:%M:%S.%f};{zone};{row}" for row, each in enumerate(local)]
    path = tmp_path / "t.csv"
    path.write_text("\n".join([f"Date;Time;{head};heading", *lines]) + "\n")
    proposal, found = read(path)
    assert found.asi8.tolist() == expected.asi8.tolist()
    assert not any("UTC is assumed" in warning for warning in proposal.warnings)


def test_zones_that_change_within_their_column_are_asked_about(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    rows = [f"2026-10-25 02:{row:02d}:00;{'CEST' if row < 30 else 'CET'};{row}" for row in range(60)]
    path.write_text("\n".join(["time;tz;heading", *rows]) + "\n")
    question = propose_column_map(read_raw_table(path)).unanswered[0]
    assert question.key == "zone"
    assert "states the zone as CEST, CET" in question.text


@pytest.mark.parametrize("number", ["-330", "2", "7200", "-0330"])
def test_a_zone_in_numbers_is_asked_about(tmp_path: Path, number: str) -> None:
    """Hours, minutes, seconds, or hours and minutes: nothing states which."""
    path = tmp_path / "t.csv"
    path.write_text(
        "time;tz;heading\n" + "".join(f"2026-05-17 12:{row:02d}:00;{number};{row}\n" for row in range(60))
    )
    assert propose_column_map(read_raw_table(path)).unanswered[0].key == "zone"
    _, found = read(path, zone="-03:30")
    assert found[0] == pd.Timestamp("2026-05-17T15:30:00Z")


def test_microseconds_of_an_autopilot_are_no_seconds_since_1970(tmp_path: Path) -> None:
    """Of its first minutes they are as large; the steps tell, and which unit they are in is asked."""
    cells = [str(12_345_678 + 200_000 * row) for row in range(3000)]
    path = table(tmp_path / "x.csv", cells, "timestamp")
    (question,) = propose_column_map(read_raw_table(path)).unanswered
    assert question.key == "time_unit"
    proposal, times = read(path, time_unit="us")
    assert not proposal.unanswered
    assert times[-1] - times[0] == pd.Timedelta(seconds=0.2 * 2999)


def headings(path: Path, times: list[str], **columns: list[object]) -> Path:
    """A table of a ship that turns by a degree in a row, and of further columns."""
    turning = [str(row % 360) for row in range(len(times))]
    pd.DataFrame({"time": times, "heading": turning, **columns}).to_csv(path, index=False)
    return path


@pytest.mark.parametrize("rate_hz", [2, 5, 10])
@pytest.mark.parametrize("form", ["%Y-%m-%dT%H:%M:%SZ", "%d.%m.%Y %H:%M:%S UTC"])
def test_rows_that_share_a_whole_second_are_spread_over_it(rate_hz: int, form: str, tmp_path: Path) -> None:
    """Recorded from the middle of a second on, and with a gap that ends in the middle of another."""
    expected = instants(80, START.replace(microsecond=500_000), 1.0 / rate_hz)
    expected = expected.append(expected + pd.Timedelta(100.0 + 1.0 / rate_hz, "s"))
    proposal, found = read(headings(tmp_path / "t.csv", [each.strftime(form) for each in expected]))
    assert np.abs((found - expected).total_seconds()).max() < 1.01 / rate_hz
    assert np.median(np.abs((found - expected).total_seconds())) < 0.51 / rate_hz  # where in its step a row was
    assert any("spread evenly" in warning for warning in proposal.warnings)


def test_rows_that_complete_or_repeat_each_other_keep_their_times(tmp_path: Path) -> None:
    times = [each.strftime("%Y-%m-%dT%H:%M:%SZ") for each in instants(40) for _ in range(2)]
    senders = pd.DataFrame({"time": times, "heading": np.arange(80.0), "sog_kn": 5.0 + 0.01 * np.arange(80)})
    senders.loc[::2, "heading"] = senders.loc[1::2, "sog_kn"] = np.nan
    senders.to_csv(tmp_path / "senders.csv", index=False)
    doubled = senders.assign(heading=np.arange(80) // 2, sog_kn=5.0)
    doubled.to_csv(tmp_path / "doubled.csv", index=False)
    for name in ("senders", "doubled"):
        assert [each.strftime("%Y-%m-%dT%H:%M:%SZ") for each in read(tmp_path / f"{name}.csv")[1]] == times


def test_times_that_a_spreadsheet_cut_short_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="one time in all 60 rows"):
        propose_column_map(read_raw_table(headings(tmp_path / "t.csv", ["1.77901E+12"] * 60)))


@pytest.mark.parametrize(("decimals", "is_told"), [(4, True), (5, True), (7, False)])
def test_serial_days_with_few_decimals_are_told(decimals: int, is_told: bool, tmp_path: Path) -> None:
    days = [round(46_159.4 + row / 86_400, decimals) for row in range(200)]
    proposal, found = read(headings(tmp_path / "t.csv", [str(day) for day in days]))
    assert any("decimals of a day" in warning for warning in proposal.warnings) == is_told
    expected = pd.Timestamp("1899-12-30", tz="UTC") + pd.to_timedelta(46_159.4 + np.arange(200) / 86_400, unit="D")
    assert np.abs((found - expected).total_seconds()).max() < 0.6 * 86_400 / 10**decimals


@pytest.mark.parametrize("instant", ["2026-10-25T00:58:00+00:00", "2026-03-29T00:58:00+00:00"])
def test_times_that_step_by_an_hour_are_asked_of_their_zone(instant: str, tmp_path: Path) -> None:
    expected = instants(240, dt.datetime.fromisoformat(instant))
    local = [each.strftime("%Y-%m-%d %H:%M:%S") for each in expected.tz_convert("Europe/Oslo")]
    path = headings(tmp_path / "t.csv", local)
    (question,) = propose_column_map(read_raw_table(path)).unanswered
    assert question.key == "zone"
    assert read(path, zone="Europe/Oslo")[1].asi8.tolist() == expected.asi8.tolist()


@pytest.mark.parametrize("late", [3, 200])
def test_a_date_that_stands_still_over_midnight_costs_no_day(late: int, tmp_path: Path) -> None:
    """It is that of the start, or changes some rows later than the time of day."""
    expected = instants(120, dt.datetime(2026, 5, 17, 23, 59, 0, tzinfo=dt.UTC))
    dates = [each.strftime("%d.%m.%Y") for each in [*[expected[0]] * late, *expected][: len(expected)]]
    times = [each.strftime("%H:%M:%S UTC") for each in expected]
    proposal, found = read(table(tmp_path / "t.csv", times, date=dates))
    assert found.asi8.tolist() == expected.asi8.tolist()
    assert any("stands still" in warning for warning in proposal.warnings)


def test_rows_in_no_order_are_put_in_that_of_their_times(tmp_path: Path) -> None:
    times = [each.strftime("%Y-%m-%dT%H:%M:%SZ") for each in instants(100)]
    sorted_path, mixed_path = headings(tmp_path / "t.csv", times), tmp_path / "mixed.csv"
    pd.read_csv(sorted_path).sample(frac=1.0, random_state=3).to_csv(mixed_path, index=False)
    proposal, found = read(mixed_path)
    assert found.is_monotonic_increasing
    assert any("put in their order" in warning for warning in proposal.warnings)


def test_a_time_that_goes_back_costs_no_rate_of_turn(tmp_path: Path) -> None:
    times = [each.strftime("%Y-%m-%dT%H:%M:%SZ") for each in instants(60)]
    path = headings(tmp_path / "t.csv", times + times[20:])
    proposal = propose_column_map(read_raw_table(path))
    assert any("times that go back: 1" in warning for warning in proposal.warnings)
    columns, _ = parse_column_map(proposal.text, tmp_path / "map.toml")
    rates = apply_column_map(read_raw_table(path), columns, tmp_path / "map.toml").table["yaw_rate_dps"]
    np.testing.assert_allclose(rates, 1.0)


@pytest.mark.parametrize(("system", "zero_s"), [("julian", -210_866_760_000), ("LabVIEW", -2_082_844_800)])
@pytest.mark.parametrize("year", [2001, 2026])
def test_days_since_julius_caesar_and_seconds_since_1904(
    system: str, zero_s: int, year: int, tmp_path: Path
) -> None:
    """Julian days, as SQLite has them, begin at noon in 4713 BC; LabVIEW's seconds would be of 2092."""
    times = instants(start=dt.datetime(year, 5, 17, 12, 0, 0, 250_000))
    seconds = times.as_unit("ns").asi8 / 1e9 - zero_s
    cells = [f"{value:.9f}" if system == "LabVIEW" else f"{value / 86_400.0:.12f}" for value in seconds]
    _, found = read(table(tmp_path / "t.csv", cells))
    assert np.abs(found.as_unit("ns").asi8 - times.as_unit("ns").asi8).max() < 50_000  # what a float of days holds


@pytest.mark.parametrize("head", ["time", "mjd", "MJD"])
@pytest.mark.parametrize("year", [2001, 2026])
def test_modified_julian_days_are_no_days_of_excel(head: str, year: int, tmp_path: Path) -> None:
    """They begin on 17 November 1858; Excel's of the same numbers would be of 2041 and later."""
    times = instants(start=dt.datetime(year, 5, 17, 12, 0, 0, 250_000))
    elapsed = times.as_unit("ns") - pd.Timestamp("1858-11-17")
    _, found = read(
        table(tmp_path / "t.csv", [f"{days:.12f}" for days in elapsed / pd.Timedelta(1, "D")], head=head)
    )
    assert np.abs(found.as_unit("ns").asi8 - times.as_unit("ns").asi8).max() <= 2_000  # of microseconds


def test_seconds_under_a_name_of_gps_are_asked_for_their_start_if_both_are_possible(tmp_path: Path) -> None:
    """Of ten years ago since 1970, or of now since 1980: not for a file that was written in between."""
    times = instants()
    ahead_s = gps_minus_utc_s(int(times[0].value)) - pd.Timestamp("1980-01-06").timestamp()
    cells = [f"{stamp.timestamp() + ahead_s:.3f}" for stamp in times]
    path = table(tmp_path / "t.csv", cells, head="gps_time")
    os.utime(path, (times[-1].timestamp(),) * 2)
    (question,) = propose_column_map(read_raw_table(path)).unanswered
    assert (question.key, question.options) == ("since", ("1970", "1980"))
    assert read(path, since="1980")[1].asi8.tolist() == times.asi8.tolist()
    early = instants(start=dt.datetime(2016, 5, 12, 12, 0, 17, 500_000, dt.UTC))
    assert np.abs(read(path, since="1970")[1] - early).max() < pd.Timedelta(2, "s")
    os.utime(path, (times[-1].timestamp() - 86_400 * 365,) * 2)
    proposal, as_utc = read(path)
    assert (as_utc == read(path, since="1970")[1]).all()
    assert any("--answer zone=GPS" in warning for warning in proposal.warnings)
    assert (as_utc - read(path, zone="GPS")[1] == pd.Timedelta(gps_minus_utc_s(as_utc.asi8[0]), "s")).all()


@pytest.mark.parametrize("unit", ["ns", "us", "ms"])
def test_durations_count_from_a_start_that_is_asked(unit: str, tmp_path: Path) -> None:
    elapsed = pd.to_timedelta(np.arange(60) * 200, unit="ms").as_unit(unit)
    frame = pd.DataFrame({"elapsed": elapsed, "heading": 100.0 + np.arange(60) / 2})
    frame.to_parquet(tmp_path / "t.parquet")
    assert "start" in [
        question.key for question in propose_column_map(read_raw_table(tmp_path / "t.parquet")).questions
    ]
    _, found = read(tmp_path / "t.parquet", start="2026-05-17T12:00:00.5Z")
    assert found.asi8.tolist() == instants(step_s=0.2).asi8.tolist()


@pytest.mark.parametrize("head", ["time [ms]", "time_ms"])
def test_milliseconds_of_a_controller_that_ran_for_days_are_no_seconds_since_1970(
    head: str, tmp_path: Path
) -> None:
    uptime = 5 * 86_400_000 + 200 * np.arange(60)
    proposal, found = read(table(tmp_path / "t.csv", [str(value) for value in uptime], head=head))
    assert "counts from an unknown start" in " ".join(proposal.warnings)
    np.testing.assert_array_equal(np.diff(found.as_unit("ns").asi8), 200_000_000)
    unnamed = propose_column_map(read_raw_table(table(tmp_path / "u.csv", [str(value) for value in uptime])))
    assert [question.key for question in unnamed.unanswered] == ["time_unit"]
