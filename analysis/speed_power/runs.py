"""Speed runs with power: found in recordings, measured, and put together in double runs and power settings."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from itertools import pairwise

import numpy as np
import pandas as pd

from seatrial.acquisition.core.errors import InputError
from seatrial.acquisition.core.quantities import Floats
from seatrial.acquisition.core.result import Number
from seatrial.acquisition.core.ship import POSE_AND_VELOCITY, RUDDER, circular_mean, wrap_360
from seatrial.analysis.manoeuvres.find import marks_of
from seatrial.analysis.manoeuvres.indices import LeftOut
from seatrial.analysis.manoeuvres.measures import WIDEST_S, smooth_motion
from seatrial.analysis.manoeuvres.motion import Motion, motion_of
from seatrial.analysis.manoeuvres.runs import (
    LEAST_RUN_S,
    Course,
    is_same_setting,
    no_speed_run,
    reciprocal_pairs,
    straight_stretches,
)
from seatrial.analysis.tables.table import NANO, table_actuators, times_ns

_POWER = re.compile(r"(?:(?P<shaft>\w+)_)?shaft_(?P<what>power|torque)_(?P<unit>w|kw|mw|nm|knm)")
_TO_KILO = {"w": 1e-3, "kw": 1.0, "mw": 1e3, "nm": 1e-3, "knm": 1.0}
_BLOCKS = 6
ERROR_FREEDOM = _BLOCKS - 2
"""The degrees of freedom of a run's standard errors."""
RUN_MINUTES = 10.0
"""The least that ISO 15016:2015 asks of a run."""
_FEWEST_SAMPLES = 3  # of the power, in each block


@dataclass(frozen=True, slots=True)
class PowerRun:
    """One run: where it went, how fast over ground and with what power, both means with their standard errors.

    ``speed_mps`` is the way made good along the heading, by the time. ``setting`` is the shaft speed [rpm], or
    the cube root of the power [kW] where no shaft speed was recorded; ``double_run`` counts the pairs from 1. The
    wind is the true one at the anemometer, NaN where it was not recorded; so are waves and depth, which a table of
    run averages may have. ``approach_minutes`` is how long the ship went steadily before, NaN where not known.
    """

    start: datetime
    end: datetime
    heading_deg: float
    speed_mps: float
    speed_se_mps: float
    power_kw: float
    power_se_kw: float
    setting: float
    wind_from_deg: Number
    wind_mps: Number
    approach_minutes: Number = 0.0
    double_run: int = 0
    wave_height_m: Number = float("nan")
    wave_from_deg: Number = float("nan")
    wave_period_s: Number = float("nan")
    water_depth_m: Number = float("nan")

    @property
    def minutes(self) -> float:
        return float((self.end - self.start).total_seconds() / 60.0)


def power_columns(table: pd.DataFrame) -> dict[str, tuple[str, str]]:
    """By shaft the column of its power, or of its torque with that of its shaft speed, "" for none.

    A column without a shaft's name is the whole ship's and counts alone. Power goes before torque.
    """
    measured = {name for name in map(str, table.columns) if table[name].notna().any()}
    drives = [each.channels[0].name for each in table_actuators(table) if each.drives]
    shafts: dict[str, tuple[str, str]] = {}
    for name in sorted(measured, key=lambda each: "torque" in each):
        if not (match := _POWER.fullmatch(name)):
            continue
        shaft = match["shaft"] or ""
        speeds = [f"{shaft}_rpm", f"{shaft}_shaft_rpm", "shaft_rpm", *(drives if len(drives) == 1 else ())]
        speed = next((each for each in speeds if each in measured), "")
        if match["what"] == "power" or speed:
            shafts.setdefault(shaft, (name, "" if match["what"] == "power" else speed))
    return {"": shafts[""]} if "" in shafts else shafts


def mean_power_kw(table: pd.DataFrame) -> float | None:
    """The mean power at all shafts over a table's rows [kW]; None where it was not recorded."""
    powers = []
    for name, speed in power_columns(table).values():
        turning = table[speed].mean() * np.pi / 30.0 if speed else 1.0
        powers.append(float(table[name].mean()) * _TO_KILO[name.rpartition("_")[2]] * turning)
    return float(np.sum(powers)) if powers else None


def power_runs(table: pd.DataFrame, events: Iterable[tuple[int, str]] = ()) -> tuple[list[PowerRun], list[LeftOut]]:
    """The speed runs in a table of samples that have power, and the stretches that are none, with the reason.

    ``events`` are (time [ns since 1970], text) as in a recording: runs that the crew marked are the only ones then.
    Raises :class:`InputError` where neither the power nor the torque and the speed of a shaft were recorded.
    """
    columns = power_columns(table)
    if not columns:
        raise InputError(
            "has no shaft power", where=str(table.attrs.get("recording", "table")),
            why="the analysis relates speed to power",
            fix="record or import shaft_power_kw, or shaft_torque_knm with the"
            " shaft's rpm; `engine_room` in trials/packs has both",
        )  # fmt: skip
    motion = motion_of(_without_controls(table))
    power = np.sum([_power_kw(motion, table, *each) for each in columns.values()], axis=0)
    setting = _setting(motion, table, power)
    motion = replace(motion, drives={"setting": setting}, thrust=np.sign(setting) * setting**2)
    smooth = smooth_motion(motion, max(WIDEST_S, 3 * motion.step_s))
    runs, left_out = list[PowerRun](), list[LeftOut]()
    for begun, first, end in _rows_of_runs(motion, smooth, events):
        start, stop = (motion.utc(motion.time_s[row]) for row in (first, end - 1))
        part = table.loc[start:stop]
        why = no_speed_run(smooth, first, end)
        if not why and part[[name for name, _ in columns.values()]].count().min() < _FEWEST_SAMPLES * _BLOCKS:
            why = "its power was hardly measured"
        if why:
            left_out.append(LeftOut("speed_run", start, stop, why))
        else:
            runs.append(_run(motion, part, power, begun, first, end))
    return runs, left_out


def _without_controls(table: pd.DataFrame) -> pd.DataFrame:
    """Pose and velocity alone, with a helm that says nothing: runs are straight by the heading."""
    motion = table[[name for name in POSE_AND_VELOCITY if name in table]]
    motion.attrs = {name: value for name, value in table.attrs.items() if name != "actuators"}
    return motion.assign(**{RUDDER: 0.0})


def _on_grid(motion: Motion, table: pd.DataFrame, name: str) -> Floats:
    samples = table[name].dropna().sort_index()
    seconds = (times_ns(samples.to_frame()) - motion.origin_ns) / NANO
    return np.asarray(np.interp(motion.time_s, seconds, samples.to_numpy(dtype=float)))


def _power_kw(motion: Motion, table: pd.DataFrame, name: str, speed: str) -> Floats:
    """A column of power, or of torque with that of the speed of its shaft [rpm]."""
    turning = _on_grid(motion, table, speed) * np.pi / 30.0 if speed else 1.0
    return _on_grid(motion, table, name) * _TO_KILO[name.rpartition("_")[2]] * turning


def _setting(motion: Motion, table: pd.DataFrame, power: Floats) -> Floats:
    """The mean shaft speed of the drives that were recorded [rpm]; without one the cube root of the power."""
    names = [each.channels[0].name for each in table_actuators(table) if each.drives]
    known = [name for name in names if name in table and table[name].notna().any()]
    if known:
        return np.asarray(np.mean([_on_grid(motion, table, name) for name in known], axis=0))
    return np.asarray(np.cbrt(power))


def _rows_of_runs(motion: Motion, smooth: Motion, events: Iterable[tuple[int, str]]) -> list[tuple[int, int, int]]:
    """Of each run the row at which its steady stretch begins, its first row and its end.

    A run is what the crew marked ("run 1 start", "run 1 end"). Without marks it is the last ten minutes of its
    stretch: what lies before is the approach, on which the ship regains the speed that a turn has cost.
    """
    free = np.ones(motion.time_s.size, dtype=bool)
    stretches = straight_stretches(motion, smooth, free, bridge_s=LEAST_RUN_S)
    marks = [each for each in marks_of(events) if re.search(r"\brun\b", each.text, re.I)]
    if not marks:
        rows = round(60.0 * RUN_MINUTES / motion.step_s) + 1
        return [(first, max(first, end - rows), end) for first, end in stretches]
    spans = [np.searchsorted(motion.time_s, (np.array([mark.start_ns, mark.end_ns]) - motion.origin_ns) / NANO)
             for mark in marks]  # fmt: skip
    inside = [
        (first, max(first, int(start)), min(end, int(stop))) for first, end in stretches for start, stop in spans
    ]
    return [each for each in inside if (each[2] - each[1]) * motion.step_s >= LEAST_RUN_S]


def _along(motion: Motion, edges: Floats) -> Floats:
    """The speed made good along the mean heading between rows [m/s]."""
    heading = np.deg2rad(float(circular_mean(motion.heading_deg[edges[0] : edges[-1] + 1])))
    north, east, time_s = (np.diff(column[edges]) for column in (motion.north_m, motion.east_m, motion.time_s))
    return np.asarray((north * np.cos(heading) + east * np.sin(heading)) / time_s)


def _run(motion: Motion, part: pd.DataFrame, power: Floats, begun: int, first: int, end: int) -> PowerRun:
    edges = np.linspace(first, end - 1, _BLOCKS + 1).astype(int)
    speeds = _along(motion, edges)
    powers = np.array([power[a:b].mean() for a, b in pairwise(edges)])
    return PowerRun(
        motion.utc(motion.time_s[first]), motion.utc(motion.time_s[end - 1]),
        float(wrap_360(circular_mean(motion.heading_deg[first:end]))),
        float(_along(motion, edges[[0, -1]])[0]), _error(speeds), float(powers.mean()), _error(powers),
        float(motion.main_rpm[first:end].mean()), *_wind(part),
        float(motion.time_s[first] - motion.time_s[begun]) / 60.0,
    )  # fmt: skip


def _error(blocks: Floats) -> float:
    """The standard error of a mean from the means of blocks, an even drift taken out: a current makes one."""
    rows = np.arange(blocks.size)
    rest = blocks - np.polyval(np.polyfit(rows, blocks, 1), rows)
    return float(np.sqrt(rest @ rest / ERROR_FREEDOM / blocks.size))


def _wind(part: pd.DataFrame) -> tuple[float, float]:
    """Where the mean true wind comes from [deg] and its speed [m/s], as a vector; NaN where there is none."""
    both = part.reindex(columns=["wind_direction_deg", "wind_speed_mps"]).ffill().dropna().to_numpy(dtype=float)
    if not both.size:
        return float("nan"), float("nan")
    vector = np.mean(both[:, 1] * np.exp(1j * np.deg2rad(both[:, 0])))
    return float(np.rad2deg(np.angle(vector)) % 360.0), float(abs(vector))


def double_runs(runs: Iterable[PowerRun]) -> tuple[list[PowerRun], list[LeftOut]]:
    """The runs that make :func:`reciprocal_pairs`, numbered by pairs; of the others the current is not known."""
    ordered = sorted(runs, key=lambda each: each.start)
    pairs = reciprocal_pairs([Course(each.start, each.end, each.heading_deg, each.setting) for each in ordered])
    number = {place: count for count, pair in enumerate(pairs, start=1) for place in pair}
    alone = "no run on the reciprocal course at this power within two hours"
    left_out = [LeftOut("speed_run", each.start, each.end, alone)
                for place, each in enumerate(ordered) if place not in number]  # fmt: skip
    return [replace(ordered[place], double_run=number[place]) for place in sorted(number)], left_out


def settings_of(runs: Sequence[PowerRun]) -> list[list[int]]:
    """The places of the runs of each power setting, in order of the setting."""
    groups: list[list[int]] = []
    for place in sorted(range(len(runs)), key=lambda each: runs[each].setting):
        near = groups and is_same_setting(runs[groups[-1][0]].setting, runs[place].setting)
        groups[-1:] = [[*groups[-1], place]] if near else [*groups[-1:], [place]]
    return [sorted(group) for group in groups]
