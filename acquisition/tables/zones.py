"""Local times of a table's rows as UTC: by names of zones, offsets, GPS time, and over ends of summer time.

One row alone does not state which of autumn's two hours it is of: the order of the rows does.
"""

from __future__ import annotations

import datetime as dt
from zoneinfo import ZoneInfo, available_timezones

import numpy as np
import pandas as pd

from seatrial.acquisition.core.arrays import Bools, Ints
from seatrial.acquisition.core.frames import NANO
from seatrial.acquisition.core.times import gps_ahead_s, is_of_several, offset_s

GPS = "GPS"
"""The zone of GPS time, which is ahead of UTC by the leap seconds since 1980."""
_CLOSE_NS = 300 * NANO  # rows no further apart have no hour between them
_FALL_NS = 60 * NANO  # rows out of order go back by less, a clock that is put back by more


def known_zone(zone: str) -> str:
    """A zone's name or offset as it is written; :class:`ValueError` for another text.

    >>> known_zone("UTC+02:00"), known_zone("CEST"), known_zone("Europe/Oslo")
    ('UTC+02:00', 'CEST', 'Europe/Oslo')
    """
    if zone == GPS or zone in available_timezones() or offset_s(zone) is not None:
        return zone
    why = "stands for several time zones" if is_of_several(zone) else "is no time zone"
    raise ValueError(f"{why}; write UTC, an offset like +02:00, GPS, or a name like Europe/Oslo")


def to_utc(local_ns: Ints, zone: str) -> tuple[Ints, str]:
    """Local times [n, ns since 1970 on the zone's clock, in the order of their rows] as UTC, and a remark.

    The remark is empty where nothing is to be known. Times in the hour that spring leaves out, and in autumn's two
    hours without a step back, are of a clock that was not put forward or back: all rows then have the offset of the
    time before. A single row in an hour that does not exist has the offset before it.
    """
    if zone == GPS:
        return local_ns - NANO * np.array(
            [gps_ahead_s(instant_ns) for instant_ns in local_ns.tolist()], dtype=np.int64
        ), ""
    ahead_s = offset_s(zone)
    if ahead_s is not None and zone not in available_timezones():
        return local_ns - ahead_s * NANO, ""
    summer, winter = (_utc_ns(local_ns, zone, fold) for fold in (0, 1))
    if np.array_equal(summer, winter):
        return summer, ""
    skipped, doubled = winter < summer, winter > summer
    if np.count_nonzero(skipped) > 1:
        first = int(np.flatnonzero(skipped)[0])
        return _unchanged(local_ns, summer, first, f"the hour that {zone} leaves out", "forward")
    result = summer.copy()
    remark = ""
    for run in _stretches(doubled):
        start = _first_of_second_hour(local_ns, run)
        if start is None:
            return _unchanged(local_ns, summer, run[0], f"the hour that comes twice in {zone}, once", "back")
        if start < 0:
            start = int(run[-1]) + 1
            winter_offset = _offset(local_ns, winter, run[0])
            remark = (
                f"{run.size} rows of {_day(local_ns[run[0]])} are in the hour that comes twice in {zone}; nothing"
                f" states which: summer time is taken, --answer zone={winter_offset} is the other"
            )
        result[start : run[-1] + 1] = winter[start : run[-1] + 1]
    return result, remark


def _utc_ns(local_ns: Ints, zone: str, fold: int) -> Ints:
    """UTC by the first (0) or the second meaning of a local time, which differ where clocks are changed."""
    quarter_index, part = np.divmod(local_ns, 900 * NANO)  # clocks are changed at quarters of an hour
    quarters, places = np.unique(quarter_index, return_inverse=True)
    info = ZoneInfo(zone)
    offsets = [
        (dt.datetime(1970, 1, 1) + dt.timedelta(seconds=900 * quarter)).replace(tzinfo=info, fold=fold).utcoffset()
        for quarter in quarters.tolist()
    ]
    ahead_ns = np.array(
        [round((offset or dt.timedelta()).total_seconds()) * NANO for offset in offsets], dtype=np.int64
    )
    return np.asarray(quarter_index * 900 * NANO + part - ahead_ns[places], dtype=np.int64)


def _stretches(mask: Bools) -> list[Ints]:
    """The stretches of rows that a mask holds."""
    places = np.flatnonzero(mask)
    return [run for run in np.split(places, np.flatnonzero(np.diff(places) > 1) + 1) if run.size]


def _first_of_second_hour(local_ns: Ints, run: Ints) -> int | None:
    """The first row of a stretch in the doubled hour that is of the second one; one beyond its end where none is.

    None where the rows run on before and behind as if clocks were not changed, -1 where nothing decides.
    """
    falls = np.flatnonzero(np.diff(local_ns[run]) < -_FALL_NS)
    if falls.size:
        return int(run[falls[0] + 1])
    usual = int(np.median(np.abs(np.diff(local_ns)))) if local_ns.size > 1 else 0
    first, last = int(run[0]), int(run[-1])
    near_ns = max(3 * usual, _CLOSE_NS)
    joins_before = first > 0 and abs(int(local_ns[first] - local_ns[first - 1])) <= near_ns
    joins_after = last + 1 < local_ns.size and abs(int(local_ns[last + 1] - local_ns[last])) <= near_ns
    if joins_before and joins_after:
        return None
    return last + 1 if joins_before else first if joins_after else -1


def _unchanged(local_ns: Ints, utc_ns: Ints, row: int, hour: str, way: str) -> tuple[Ints, str]:
    """All rows with the offset that one of them has before the change; a remark that it was not changed."""
    remark = (
        f"on {_day(local_ns[row])} rows run on through {hour}: that clock was not put {way};"
        f" all times are read as of zone {_offset(local_ns, utc_ns, row)}, --answer zone=... names another"
    )
    return local_ns - (local_ns[row] - utc_ns[row]), remark


def _offset(local_ns: Ints, utc_ns: Ints, row: int) -> str:
    minutes = int(local_ns[row] - utc_ns[row]) // (60 * NANO)
    return f"{'-' if minutes < 0 else '+'}{abs(minutes) // 60:02d}:{abs(minutes) % 60:02d}"


def _day(local_ns: int) -> str:
    return str(pd.Timestamp(int(local_ns)).date())
