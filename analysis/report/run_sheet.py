"""The run sheet: everything that a reader wants to know of a trial before its numbers, and what nobody wrote down.

Fields as in the form of MSC/Circ.1053, appendix 6; what the crew says comes from the recording's metadata, wind and
times from its channels.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from acquisition.core.trial import software_version
from analysis.kinematics import mean_wind
from analysis.tables.provenance import sha256_of

if TYPE_CHECKING:
    from acquisition.recording.reader import Recording
    from analysis.manoeuvres import Manoeuvre

_NUMBERS = re.compile(r"[+-]?\d[\d.,]*")
UNKNOWN = "not recorded"
ASSUMED = "assumed"
"""The source of a channel that a column map gave a value to."""
BEAUFORT_MPS = (0.3, 1.6, 3.4, 5.5, 8.0, 10.8, 13.9, 17.2, 20.8, 24.5, 28.5, 32.7)
"""The lowest speed of wind forces 1 to 12 [m/s], of the World Meteorological Organization."""


@dataclass(frozen=True, slots=True)
class Ship:
    """Main dimensions [m], from a vessel file or a person."""

    name: str
    over_all_m: float
    between_perpendiculars_m: float
    beam_m: float
    draught_m: float


def run_sheet(
    recording: Recording, one_hz: pd.DataFrame, manoeuvres: Iterable[Manoeuvre] = (), ship: Ship | None = None
) -> list[tuple[str, str]]:
    """What and its value as text, in the order of a run sheet; what is not known says so.

    ``one_hz`` is the recording once a second. ``manoeuvres`` whose turns show a current give it.
    """
    trial = recording.trial
    return [
        ("ship", trial.vessel or UNKNOWN),
        ("trial", trial.name or UNKNOWN),
        *_when(one_hz),
        ("place", trial.place or UNKNOWN),
        ("origin of north and east", _origin(trial.origin)),
        ("loading", trial.loading or UNKNOWN),
        ("draught", _metres(trial.draught_m)),
        ("trim by the stern", _metres(trial.trim_m)),
        ("water depth", _depth(trial.water_depth_m, trial.draught_m or (ship.draught_m if ship else None))),
        ("wind", _wind(recording, one_hz)),
        ("sea state", trial.sea_state or UNKNOWN),
        ("current", _current(manoeuvres)),
        *_form(ship, one_hz),
        ("crew's notes", trial.crew_notes or UNKNOWN),
        ("recording", f"{recording.path.name}, {recording.path.stat().st_size:,} bytes"),
        ("SHA-256", sha256_of(recording.path) or UNKNOWN),
        ("closed properly", "yes" if recording.closed else "no: it is read as far as it goes"),
        ("this page by", software_version()),
    ]


def _when(one_hz: pd.DataFrame) -> list[tuple[str, str]]:
    first, last = one_hz.index[0], one_hz.index[-1]
    minutes = (last - first).total_seconds() / 60.0
    until = f"{last:%H:%M:%S}" if last.date() == first.date() else f"{last:%Y-%m-%d %H:%M:%S}"
    return [("date", f"{first:%Y-%m-%d}"), ("time, UTC", f"{first:%H:%M:%S} to {until}, {minutes:.1f} min")]


def _origin(origin: tuple[float, float] | None) -> str:
    if origin is None:
        return UNKNOWN
    latitude, longitude = origin
    return (
        f"{abs(latitude):.5f}\u00b0 {'N' if latitude >= 0 else 'S'}, "
        f"{abs(longitude):.5f}\u00b0 {'E' if longitude >= 0 else 'W'}"
    )


def _metres(value: float | None) -> str:
    return UNKNOWN if value is None else f"{value:g} m"


def _depth(depth_m: float | None, draught_m: float | None) -> str:
    if depth_m is None or not draught_m:
        return _metres(depth_m)
    return f"{depth_m:g} m, {depth_m / draught_m:.1f} draughts"


def _wind(recording: Recording, one_hz: pd.DataFrame) -> str:
    """The wind as it was measured; one that an import assumed is none."""
    series = recording.series.get("wind_speed_mps")
    return f"{UNKNOWN}, a calm was assumed" if series and series.sources == (ASSUMED,) else wind_words(one_hz)


def beaufort(speed_mps: float) -> int:
    """The wind's force from its mean speed [m/s].

    >>> beaufort(0.2), beaufort(8.0), beaufort(40.0)
    (0, 5, 12)
    """
    return bisect_right(BEAUFORT_MPS, speed_mps)


def wind_words(table: pd.DataFrame) -> str:
    """The mean wind, where it comes from, how it gusts, and its force."""
    names = ["wind_speed_mps", "wind_direction_deg"]
    air = table[names].dropna() if set(names) <= set(table.columns) else pd.DataFrame()
    if air.empty:
        return UNKNOWN
    speed_mps, from_deg = mean_wind(air)
    gust = float(np.quantile(air["wind_speed_mps"], 0.99))
    return f"{speed_mps:.1f} m/s from {from_deg:.0f}\u00b0, gusts {gust:.1f} m/s, Beaufort {beaufort(speed_mps)}"


def _current(manoeuvres: Iterable[Manoeuvre]) -> str:
    """The mean of what turns of more than one and a half circles show."""
    found = [each.current for each in manoeuvres if each.current is not None]
    if not found:
        return "not known: no turn of one and a half circles"
    north, east = (float(np.mean([getattr(each, name) for each in found])) for name in ("north_mps", "east_mps"))
    towards = np.rad2deg(np.arctan2(east, north)) % 360.0
    turns = f"{len(found)} turn{'' if len(found) == 1 else 's'}"
    return f"{np.hypot(north, east):.2f} m/s towards {towards:.0f}\u00b0, from {turns}, wind drift included"


def _form(ship: Ship | None, one_hz: pd.DataFrame) -> list[tuple[str, str]]:
    """Dimensions and the ratios that the IMO's form asks for; the speed is the median of what the ship made
    good."""
    if ship is None:
        return [("dimensions", "not known: the recording names none of the vessel files")]
    both = one_hz.reindex(columns=["surge_mps", "sway_mps"]).dropna()
    speed = float(np.median(np.hypot(both["surge_mps"], both["sway_mps"]))) if len(both) else 0.0
    length_m = ship.between_perpendiculars_m
    per_speed = f", L/V {length_m / speed:.1f} s at the median speed of {speed:.2f} m/s" if speed > 0.1 else ""
    words = (
        f"{ship.over_all_m:g} m over all, {length_m:g} m between perpendiculars (L), {ship.beam_m:g} m wide, "
        f"draught {ship.draught_m:g} m, by the vessel file {ship.name}"
    )
    return [
        ("dimensions", words),
        ("ratios", f"L/B {length_m / ship.beam_m:.2f}, B/T {ship.beam_m / ship.draught_m:.2f}{per_speed}"),
    ]


def events_of(recording: Recording) -> list[list[str]]:
    """Marks, warnings and changes of configuration in the order of time: when they were heard, UTC, and the text.

    Events that differ in their numbers only stand once, with how often they came.
    """
    rows: list[list[str]] = []
    alike: dict[str, int] = {}
    for time_ns, text in recording.events:
        pattern = _NUMBERS.sub("N", text)
        alike[pattern] = alike.get(pattern, 0) + 1
        if alike[pattern] == 1:
            rows.append([f"{pd.Timestamp(time_ns, unit='ns', tz='UTC'):%Y-%m-%d %H:%M:%S}", text])
    counts = [alike[_NUMBERS.sub("N", text)] for _, text in rows]
    return [[time, f"{text} ({count} times the like)" if count > 1 else text]
            for (time, text), count in zip(rows, counts, strict=True)]  # fmt: skip
