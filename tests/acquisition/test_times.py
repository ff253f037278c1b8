"""Times as text: what is written in any form comes back, and the order of day and month is decided by the log."""

from __future__ import annotations

import datetime as dt
import os
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from seatrial.acquisition.core.times import ORDERS, Order, Stamp, find_stamp, infer_date_order
from seatrial.acquisition.protocols import clock
from seatrial.acquisition.protocols.nmea0183 import frame_sentence
from seatrial.acquisition.recording.reader import read_recording
from tests.acquisition.conftest import config_text
from tests.conftest import Command

MOMENTS = st.datetimes(dt.datetime(2010, 1, 1), dt.datetime(2079, 12, 31)).map(
    lambda moment: moment.replace(microsecond=moment.microsecond // 1000 * 1000)
)
ZONES = {
    "": 0.0,
    " UTC": 0.0,
    "Z": 0.0,
    " GMT+2": 2.0,
    " UTC-03:30": -3.5,
    "+0530": 5.5,
    " CEST": 2.0,
    " EST": -5.0,
}
BEFORE = ("", "NAV ", "[", "x,")
UNAMBIGUOUS = (
    "%Y-%m-%d %H:%M:%S.%f", "%Y/%m/%d,%H:%M:%S,%f", "%Y.%m.%d %H:%M:%S.%f", "%Y%m%dT%H%M%S.%f", "%Y-%j:%H:%M:%S.%f",
    "%d.%m.%Y %H:%M:%S.%f", "%d.%m.%y %H:%M:%S:%f", "%d-%b-%Y %H:%M:%S.%f", "%d %B %Y %H:%M:%S.%f",
    "%b %d, %Y at %I:%M:%S.%f %p", "%d/%b/%Y:%H:%M:%S.%f", "%Y-%b-%d %H:%M:%S.%f",
    "%d. %B %Y %H:%M:%S.%f", "%d-%b-%y:%H:%M:%S.%f",
    "%Y-%m-%d %Hh%Mm%S.%fs", "%d %B %Y %H h %M min %S,%f s", "%d.%m.%Y %Hh%Mmn%S.%f", "%Y%m%d %H:%M:%S.%f",
)  # fmt: skip
AMBIGUOUS = ("%d/%m/%Y %I:%M:%S.%f %p", "%m/%d/%Y %H:%M:%S.%f", "%d-%m-%y %H:%M:%S.%f", "%m-%d-%Y,%H:%M:%S.%f")


def stamp_of(text: str) -> Stamp:
    stamp = find_stamp(text)
    assert stamp is not None, text
    return stamp


def utc_ns(moment: dt.datetime, hours: float = 0.0) -> int:
    since = moment - dt.datetime(1970, 1, 1) - dt.timedelta(hours=hours)
    return (since.days * 86_400 + since.seconds) * 10**9 + since.microseconds * 1000


@given(MOMENTS, st.sampled_from(UNAMBIGUOUS), st.sampled_from(sorted(ZONES)), st.sampled_from(BEFORE))
def test_a_time_written_in_any_form_comes_back(moment: dt.datetime, form: str, zone: str, before: str) -> None:
    text = moment.strftime(form) + zone
    stamp = stamp_of(f"{before}{text} ")
    assert len(stamp.orders) == 1
    assert stamp.utc_ns(stamp.orders[0]) == utc_ns(moment, ZONES[zone]), text


@given(MOMENTS, st.sampled_from(AMBIGUOUS))
def test_the_meaning_of_an_ambiguous_date_is_among_its_orders(moment: dt.datetime, form: str) -> None:
    stamp = stamp_of(moment.strftime(form))
    assert utc_ns(moment) in {stamp.utc_ns(order) for order in stamp.orders}


@given(st.text(max_size=60))
def test_any_text_has_a_possible_time_or_none(text: str) -> None:
    stamp = find_stamp(text)
    if stamp is not None and stamp.has_year:
        for order in stamp.orders:
            assert 0 <= stamp.local_ns(order) < 4_200_000_000 * 10**9


@pytest.mark.parametrize(
    "text",
    ["32/01/2026 12:00:00", "2026-13-01 12:00:00", "2026-02-30 12:00:00", "17-Xyz-2026 12:00:00",
     "2026-05-17 24:00:00", "05/17/2026 13:00:00 PM", "12:00:00", "1384923604.5", "29/02/2025 12:00:00", ""],
)  # fmt: skip
def test_what_is_no_time_is_none(text: str) -> None:
    assert find_stamp(text) is None


@pytest.mark.parametrize("zone", ["CST", "IST", "BST"])
def test_a_zone_that_stands_for_several_is_named_and_not_applied(zone: str) -> None:
    stamp = stamp_of(f"2026-05-17 12:00:00 {zone}")
    assert (stamp.zone, stamp.offset_s) == (zone, None)


@given(MOMENTS, st.sampled_from(["%b %d %H:%M:%S.%f bridge gps: ", "%d %b %H:%M:%S.%f", "%d. %B %H:%M:%S.%f"]))
def test_a_time_without_a_year_says_so(moment: dt.datetime, form: str) -> None:
    stamp = stamp_of(moment.strftime(form))
    assert not stamp.has_year
    assert stamp.utc_ns("year-first", moment.year) == utc_ns(moment)


def stamps(form: str, *moments: dt.datetime) -> list[Stamp]:
    return [stamp_of(moment.strftime(form)) for moment in moments]


FORMS: dict[Order, str] = {"day-first": "%d/%m/%Y %H:%M:%S", "month-first": "%m/%d/%Y %H:%M:%S"}


@pytest.mark.parametrize("order", list(FORMS))
@given(st.datetimes(dt.datetime(2015, 1, 1), dt.datetime(2030, 12, 28)))
def test_a_day_beyond_the_12th_decides(order: Order, moment: dt.datetime) -> None:
    moments = (moment.replace(day=day) for day in (1, 12, 13, 28))
    assert infer_date_order(stamps(FORMS[order], *moments))[0] == order


@pytest.mark.parametrize("order", list(FORMS))
@given(st.datetimes(dt.datetime(2015, 1, 1), dt.datetime(2030, 12, 31)), st.integers(-14, 14))
def test_a_date_of_another_origin_decides(order: Order, moment: dt.datetime, hours: int) -> None:
    (stamp,) = stamps(FORMS[order], moment)
    found, _ = infer_date_order([stamp], [(stamp, utc_ns(moment, hours))])
    assert stamp.utc_ns(found) == stamp.utc_ns(order)


@pytest.mark.parametrize("order", list(FORMS))
def test_continuity_over_midnight_decides(order: Order) -> None:
    moments = dt.datetime(2026, 5, 6, 23, 59), dt.datetime(2026, 5, 7, 0, 1)
    found, why = infer_date_order(stamps(FORMS[order], *moments))
    assert found == order
    assert why


def test_nothing_that_decides_gives_no_reason() -> None:
    assert infer_date_order(stamps(FORMS["day-first"], dt.datetime(2026, 5, 6))) == ("month-first", "")
    assert set(ORDERS) == {"year-first", *FORMS}


# Logs


@pytest.fixture
def recorded(tmp_path: Path, command: Command) -> Callable[..., tuple[list[str], str]]:
    """Record a log of headings with these texts before them; the times of the headings, and what was reported."""

    def record(before: list[str], options: str = "", more: bytes = b"") -> tuple[list[str], str]:
        log = tmp_path / "in.log"
        log.write_bytes(b"".join(text.encode() + frame_sentence("HEHDT,45.0,T") + more for text in before))
        os.utime(log, (1_700_000_000, 1_700_000_000))
        section = f'type = "file"\npath = "in.log"\n{options}'
        (tmp_path / "trial.toml").write_text(config_text(section, ("heading_deg",), clock="receiver"))
        done = command("record", tmp_path / "trial.toml", "-o", tmp_path / "out")
        assert done.code == 0, done.err
        (path,) = (tmp_path / "out").iterdir()
        recording = read_recording(path)
        times = recording.series["heading_deg"].received_ns if "heading_deg" in recording.series else []
        stamped = [
            dt.datetime.fromtimestamp(time_ns / 1e9, dt.UTC).strftime("%Y-%m-%dT%H:%M:%S") for time_ns in times
        ]
        return stamped, " | ".join(text for _, text in recording.events)

    return record


@pytest.mark.parametrize(
    "form",
    ["%d-%m-%Y %H:%M:%S ", "%d.%m.%Y %H:%M:%S.000 ", "%d-%b-%Y %H:%M:%S ", "%d/%m/%y %H:%M:%S ",
     "%m/%d/%Y,%H:%M:%S,",
     "%b %d, %Y %H:%M:%S: ", "%a %b %d %H:%M:%S %Y ", "%d/%m/%Y %I:%M:%S %p ", "%Y-%m-%d %H:%M:%S:000 ",
     "%d %B %Y %H:%M:%S "],
)  # fmt: skip
def test_a_log_with_dates_of_any_form_has_its_own_times(
    recorded: Callable[..., tuple[list[str], str]], form: str
) -> None:
    moments = [dt.datetime(2026, 5, 17, 12, 0, second) for second in range(3)]
    times, remarks = recorded([moment.strftime(form) for moment in moments])
    assert times == [moment.isoformat() for moment in moments]
    assert "no date" not in remarks


@pytest.mark.parametrize("order", list(FORMS))
def test_a_log_whose_dates_may_be_two_says_so_and_takes_the_answer(
    recorded: Callable[..., tuple[list[str], str]], order: Order
) -> None:
    moment = dt.datetime(2026, 5, 6, 12)
    times, remarks = recorded([moment.strftime(FORMS[order]) + " "], f'date_order = "{order}"\n')
    assert times == [moment.isoformat()]
    assert "may have the day or the month first" not in remarks


def test_a_log_whose_dates_may_be_two_says_so(recorded: Callable[..., tuple[list[str], str]]) -> None:
    _, remarks = recorded(["06/05/2026 12:00:00 "])
    assert "'06/05/2026 12:00:00', may have the day or the month first: month-first is taken" in remarks


def test_the_end_of_a_log_decides_the_order_of_its_beginning(
    recorded: Callable[..., tuple[list[str], str]],
) -> None:
    """The head alone, of one day in some 10,000 lines, may be read both ways."""
    begun = dt.datetime(2026, 6, 12, 21)
    moments = [begun + dt.timedelta(seconds=number) for number in range(12_000)]
    times, _ = recorded([moment.strftime("%d/%m/%Y %H:%M:%S ") for moment in moments])
    assert (times[0], times[-1]) == (moments[0].isoformat(), moments[-1].isoformat())


def test_a_date_that_is_not_understood_is_shown(recorded: Callable[..., tuple[list[str], str]]) -> None:
    _, remarks = recorded(["17~V~2026 12:00:00 "])
    assert "the date in '17~V~2026 12:00:00' could not be read" in remarks


def test_dates_without_a_year_take_it_from_a_sentence_and_say_so(
    recorded: Callable[..., tuple[list[str], str]],
) -> None:
    zda = b"May 17 12:00:00 x: " + frame_sentence("GPZDA,120000.00,17,05,2026,00,00")
    times, remarks = recorded([f"May 17 12:00:0{second} x: " for second in range(3)], more=zda)
    assert times[0] == "2026-05-17T12:00:00"
    assert "have no year" in remarks


@pytest.mark.parametrize(
    ("date", "expected"),
    [("011006", "2026-05-17"), ("170526", "2026-05-17"), ("021005", "2025-05-18")],
    ids=["rolled over", "right", "rolled over, a year before"],
)
def test_a_receiver_whose_weeks_have_rolled_over_gives_its_date_and_this_is_said(
    recorded: Callable[..., tuple[list[str], str]], date: str, expected: str
) -> None:
    rmc = b"".join(
        frame_sentence(f"GPRMC,1200{second:02d},A,6326.4,N,01024.0,E,5.0,45.0,{date},,,A")
        + frame_sentence("HEHDT,45.0,T")
        for second in range(3)
    )
    times, remarks = recorded([""], more=rmc)
    assert times[1:] == [f"{expected}T12:00:0{second}" for second in range(3)]
    assert ("rolled over" in remarks) == (date != "170526")


@pytest.mark.parametrize(
    "date", [dt.date(1980, 1, 6), dt.date(1999, 8, 22), dt.date(1970, 1, 1), dt.date(2009, 12, 31)]
)
def test_a_receiver_that_does_not_know_the_date_has_not_rolled_over(date: dt.date) -> None:
    later_ns = clock.utc_ns_of_date(dt.date(2026, 11, 28), 0.0)
    assert clock.correct_week_rollover(clock.utc_ns_of_date(date, 5.0), later_ns) is None
