"""What a surveyor reads of a trial: the programme, the criteria, each test as a table of what was recorded, and
the measured indices beside simulated ones.

The criteria stand as in the form of MSC/Circ.1053, appendix 6; a test is tabulated at intervals of 20 s and
less, as the circular asks for the recording of position, heading, speed, helm, shafts and wind.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from seatrial.acquisition.config.run_sheet import standard_errors_in_trial
from seatrial.acquisition.core import quantities
from seatrial.acquisition.core.ship import channel_unit, is_order_channel
from seatrial.analysis.manoeuvres import criteria, indices
from seatrial.analysis.manoeuvres.motion import Motion
from seatrial.analysis.products import Products
from seatrial.analysis.quality.wind import beaufort_number
from seatrial.analysis.report.tables import has_date, index_cells, plain_name, readable_names
from seatrial.analysis.series import ASSUMED, is_assumed, white_noise_standard_deviation
from seatrial.analysis.speed_power import report, runs
from seatrial.analysis.tables.table import NANO, times_ns

if TYPE_CHECKING:
    from seatrial.hybrid.evaluation.manoeuvre_indices import IndexComparisons
    from seatrial.hybrid.evaluation.validate import LengthErrors


LONGEST_STEP_S = 20.0
"""The longest interval between the rows of a test, by MSC/Circ.1053."""

_STEPS_S = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, LONGEST_STEP_S)
_FEWEST_ROWS, _ROWS_ON_SHEET = 24, 44  # of a test's table: as many stand on a sheet under its picture
_MOST_SHAFTS_TWICE = 1  # that two tables beside each other have room for
_LEAST_NOISE = 1e-6  # in any unit: less is left by arithmetic
_APPROACH_S = 30.0  # of which the output before the order is the mean
_GAP = "\u2003"  # between two tables beside each other
_NOT_MEASURED = "\u2013"
PROGRAMME = (
    "", "test", "recording", "order, UTC", "speed [kn]", "heading", "shaft [rpm]", "power [kW]", "wind [m/s]",
    "from", "Beaufort", "drift [kn]",
)  # fmt: skip
_ASKED = ("shaft [rpm]", "power [kW]", "wind [m/s]")  # of a trial, by MSC/Circ.1053
Columns = dict[str, tuple[quantities.Floats, int]]

SIGNATURES = [
    [party, "", "", ""] for party in ("the yard", "the owner", "the classification society", "the administration")
]
"""Who signs a trial's report."""

INSTRUMENTS = ("channel", "source", "samples a second", "noise, from sample to sample", "accuracy, as stated")
INDEX_HEADER = ("index", "measured", "95 % interval", "predicted", "difference", "replayed", "difference")
OUTSIDE, REMOVED = "*", "\u2020"
LEGEND = (
    "predicted: the same test by the model in still air; replayed: the recorded controls and wind from "
    f"the state at the order; {OUTSIDE} outside the measured 95 % interval"
)


@dataclass(frozen=True, slots=True)
class NumberedRun:
    """A manoeuvre of a trial with its number and the recording that it is in."""

    number: int
    recording: str
    manoeuvre: indices.Manoeuvre
    table: pd.DataFrame

    @property
    def title(self) -> str:
        run = self.manoeuvre
        time = f"{run.start:%Y-%m-%d %H:%M:%S} UTC" if has_date(run.start) else f"{run.start:%H:%M:%S}"
        return f"Test {self.number}: {run.sided_name}, {time}"


def programme_rows(tests: Sequence[NumberedRun]) -> list[list[str]]:
    """One row a test: when it was ordered, the approach with the output of the engine, and the wind.

    The date is left out where all are of one day, and the recording where there is but one.
    """
    is_one_day = len({test.manoeuvre.start.date() for test in tests}) == 1
    is_one_recording = len({test.recording for test in tests}) == 1
    rows = []
    for test in tests:
        run = test.manoeuvre
        speed, heading = (run.settings.get(name) for name in ("approach_mps", "approach_heading_deg"))
        if speed is not None:
            approach = test.table.loc[run.start - pd.Timedelta(seconds=_APPROACH_S) : run.start]
        else:  # it is steady itself
            approach = test.table.loc[run.start : run.end]
        shafts = [name for name in map(str, approach) if name.endswith("_rpm") and not is_order_channel(name)]
        shaft_rpm = [f"{approach[name].mean():z.0f}" for name in measured_channels(approach, shafts)]
        power = runs.mean_power_kw(approach)
        wind = approach.reindex(
            columns=measured_channels(test.table, ["wind_speed_mps", "wind_direction_deg"])
        ).dropna()
        air = quantities.mean_wind_speed_and_direction(wind) if wind.shape[1] == 2 and len(wind) else None
        rows.append([
            f"{test.number}", run.sided_name, "" if is_one_recording else test.recording,
            f"{run.start:{'%H:%M:%S' if is_one_day else '%Y-%m-%d %H:%M:%S'}}",
            "" if speed is None else f"{speed / quantities.KNOT_MPS:.2f}",
            "" if heading is None else f"{round(heading) % 360:03d}\u00b0",
            " / ".join(shaft_rpm), "" if power is None else report.power_text(power).removesuffix(" kW"),
            *(("", "", "") if air is None
              else (f"{air[0]:.1f}", f"{air[1]:.0f}\u00b0", f"{beaufort_number(air[0])}")),
            "" if run.current is None else f"{run.current.as_json()['speed_mps'] / quantities.KNOT_MPS:.2f}",
        ])  # fmt: skip
    return rows


def unrecorded_requirements(rows: Sequence[Sequence[str]]) -> list[str]:
    """What the circular asks to be recorded and no row of the programme has."""
    columns = dict(zip(PROGRAMME, zip(*rows, strict=True), strict=True))
    return [name.partition(" [")[0] for name in _ASKED if not any(columns[name])]


def measured_channels(table: pd.DataFrame, names: Sequence[str]) -> list[str]:
    """Those of some channels that a table has values of, other than assumed ones."""
    return [name for name in names if name in table and table[name].notna().any() and not is_assumed(table, name)]


def criteria_rows(
    results: Sequence[criteria.CriterionResult], length_m: float | None = None
) -> list[tuple[str, str, list[tuple[str, str, str]]]]:
    """One row a criterion: its name with the clause, its limit, and of each side value, interval and result; of a
    test without sides there is one. Limits that depend on the ship's length [m] alone need no run.
    """
    by_criterion: dict[str, list[criteria.CriterionResult]] = {}
    for result in results:
        by_criterion.setdefault(result.criterion.name, []).append(result)
    rows = []
    for sides in by_criterion.values():
        criterion, unit = sides[0].criterion, indices.unit_in_name(sides[0].criterion.index)
        limits = [result.mean.index for result in sides if result.mean and result.mean.index.limit]
        if limits:
            limit = index_cells(min(limits, key=lambda index: index.limit or 0.0))[3].replace(f" {unit}", "")
        else:
            bound = criterion.limit(length_m, 0.0)
            lengths = f" ({bound / length_m:.1f} L)" if bound and length_m and unit == "m" else ""
            limit = f"{bound:.1f}{lengths}" if bound else ""
        cells = []
        for result in sides:
            value, interval = _NOT_MEASURED, ""
            if result.mean is not None:
                value, interval, lengths, _ = index_cells(result.mean.index)
                value = value.removesuffix(f" {result.mean.index.unit}") + (f" ({lengths} L)" if lengths else "")
            cells.append((value, interval, result.result.replace("_", " ")))
        title = f"{criterion.name} [{unit}] ({criterion.clause})"
        rows.append((title, f"\u2264 {limit}" if limit else "", cells))
    return rows


def time_history_table(motion: Motion, test: NumberedRun) -> tuple[list[str], list[list[str]], float]:
    """A test at even intervals: header, rows, and the interval [s].

    Position counts from that of the order, ahead and to starboard of the approach; a column of the wind follows
    where it was recorded.
    """
    run = test.manoeuvre
    start, end = ((time.value - motion.origin_ns) / NANO for time in (run.start, run.end))
    duration_s, sheet_columns = end - start, 2 if len(motion.drives) <= _MOST_SHAFTS_TWICE else 1
    # the longest interval that still shows the course of the test; of a long test the one by which it fills a sheet
    step_s = max((step for step in _STEPS_S if duration_s / step >= _FEWEST_ROWS), default=_STEPS_S[0])
    step_s = step_s * max(1, int(np.ceil(duration_s / step_s / (sheet_columns * (_ROWS_ON_SHEET - 1)))))
    time_s = np.arange(start, end + 1e-6, step_s)

    def sampled(name: str) -> quantities.Floats:
        return np.asarray(np.interp(time_s, motion.time_s, getattr(motion, name)))

    north, east = (sampled(name) - motion.at(name, start) for name in ("north_m", "east_m"))
    course = np.deg2rad(run.settings.get("approach_heading_deg", motion.at("heading_deg", start)))
    ahead, starboard = quantities.rotate_earth_to_ship(north, east, course)
    columns = {
        "time [s]": (time_s - start, 1 if step_s < 1.0 else 0),
        "heading [deg]": (sampled("heading_deg") % 360.0, 1),
        "speed [kn]": (sampled("speed_mps") / quantities.KNOT_MPS, 2),
        "rate [deg/s]": (sampled("yaw_rate_dps"), 2),
    }
    if motion.steering:
        columns[f"{motion.steering} [deg]"] = sampled("helm_deg"), 1
    if motion.helm_order_deg is not None:
        last = np.searchsorted(motion.time_s, time_s + 1e-6, side="right") - 1  # an order holds until the next one
        columns["order [deg]"] = motion.helm_order_deg[last], 1
    for name, values in motion.drives.items():
        words = "shaft" if len(motion.drives) == 1 else motion.words.get(name, readable_names(name))
        columns[f"{words} [rpm]"] = np.interp(time_s, motion.time_s, values), 0
    digits = 1 if float(np.ptp(np.hypot(north, east))) < 300.0 else 0
    columns |= {"ahead [m]": (ahead, digits), "across [m]": (starboard, digits)}
    if measured_channels(test.table, ["wind_speed_mps"]):
        wind = test.table["wind_speed_mps"].dropna()
        times_s = (times_ns(wind.to_frame()) - run.start.value) / NANO
        columns["wind [m/s]"] = np.interp(time_s - start, times_s, wind.to_numpy(dtype=float)), 1
    cells = [[f"{value:.{places}f}" for value in values.round(places) + 0.0] for values, places in columns.values()]
    return list(columns), [list(row) for row in zip(*cells, strict=True)], step_s


def arrange_on_one_sheet(header: Sequence[str], rows: Sequence[list[str]]) -> tuple[list[str], list[list[str]]]:
    r"""A table of many rows with its second half beside the first.

    >>> header, rows = arrange_on_one_sheet(["n"], [[str(number)] for number in range(45)])
    >>> len(rows), header, rows[0], rows[-1]
    (23, ['n', '\u2003', 'n'], ['0', '\u2003', '23'], ['22', '\u2003', ''])
    """
    if len(rows) <= _ROWS_ON_SHEET:
        return list(header), list(rows)
    middle = (len(rows) + 1) // 2
    pairs = zip(rows[:middle], [*rows[middle:], [""] * len(header)], strict=False)
    return [*header, _GAP, *header], [[*row, _GAP, *partner] for row, partner in pairs]


def instrument_rows(products: Mapping[str, Products]) -> list[list[str]]:
    """One row a channel and source of all recordings: how often it comes, how it scatters, and how accurate its
    maker says it is."""
    intervals, scatters = (
        defaultdict[tuple[str, str], list[float]](list),
        defaultdict[tuple[str, str], list[float]](list),
    )
    accuracy: dict[str, float] = {}
    for recorded in products.values():
        accuracy |= standard_errors_in_trial(recorded.recording.trial)
        for name, series in recorded.recording.series.items():
            key = name, ", ".join(series.sources)
            if name in recorded.table and series.measured_ns.size > 1 and series.sources != (ASSUMED,):
                intervals[key].append(float(np.median(np.diff(np.sort(series.measured_ns)))) / NANO)
                scatters[key].append(white_noise_standard_deviation(series.value[np.isfinite(series.value)]))
    return [
        [readable_names(name), source, f"{1.0 / np.median(values):.3g}",
         _value_with_unit(float(np.median(scatters[name, source])), name),
         _value_with_unit(accuracy.get(name, np.nan), name)]
        for (name, source), values in intervals.items()
    ]  # fmt: skip


def _value_with_unit(value: float, name: str) -> str:
    return f"{value:.2g} {channel_unit(name) or ''}".strip() if np.isfinite(value) and value > _LEAST_NOISE else ""


def index_tables(comparisons: IndexComparisons) -> list[tuple[str, list[list[str]]]]:
    """A table a test and model: its title, and a line an index in the columns of :data:`INDEX_HEADER`, differences
    in its unit and in percent."""
    several = len({row.method for row in comparisons.rows}) > 1
    tables = []
    grouped = groupby(comparisons.rows, key=lambda row: (row.start, row.test, row.side, row.method))
    for (start, test, side, method), rows in grouped:
        lines = []
        for row in rows:
            value, interval, *_ = index_cells(row.measured)
            decimals = len(value.split()[0].partition(".")[2])
            cells = [plain_name(row.name) + REMOVED * row.current_removed, value, interval]
            for simulated in (row.predicted, row.replayed):
                if simulated is None:
                    cells += ["", ""]
                    continue
                percent = "" if simulated.percent is None else f" ({simulated.percent:+.1f} %)"
                outside = OUTSIDE if simulated.within is False else ""
                difference = f"{simulated.difference:+.{decimals}f}{percent}{outside}"
                cells += [f"{simulated.value:.{decimals}f}", difference.replace("-", "\u2212")]
            lines.append(cells)
        tables.append((test_title(test, side, method if several else "", f"{start:%H:%M:%S}"), lines))
    return tables


def test_title(test: str, side: str, method: str, time: str) -> str:
    """The time, the test, its side, and the model.

    >>> test_title("zigzag 10/10", "port", "hybrid", "10:00:00")
    '10:00:00 zigzag 10/10 to port, hybrid'
    """
    sided = f"{test} to {side}" if side and side not in test else test
    return f"{time} {sided}{', ' * bool(method)}{method}"


def notes_on_index_tables(comparisons: IndexComparisons) -> list[str]:
    """What the tables mean, what the model does not know, and which tests it did not make, by reason: a sentence
    each."""
    removed = [f"{REMOVED} the current removed."] if any(row.current_removed for row in comparisons.rows) else []
    legend = [f"{LEGEND[0].upper()}{LEGEND[1:]}."] if comparisons.rows else []
    remarks = [f"{remark[0].upper()}{remark[1:]}." for remark in comparisons.remarks]
    tests: dict[tuple[str, str, str], list[str]] = {}
    for test in comparisons.left_out:
        named = test_title(test.test, test.side, "", "").strip()
        tests.setdefault((test.method, test.form, test.why), []).append(named)
    left_out = [
        f"Not {form} by the {method} model: {', '.join(dict.fromkeys(names))}: {why}."
        for (method, form, why), names in tests.items()
    ]
    return [*legend, *removed, *remarks, *left_out]


def errors_after_lengths_table(errors: LengthErrors, horizon_s: int) -> tuple[str, list[str], list[list[str]]]:
    """The errors after so many L/V: what L/V is and how many of it the horizon is, the columns, and a line a method
    with the distance, in ship lengths, and the heading error at each time."""
    time_s = errors.length_time_s
    title = (
        f"error after L/V = {errors.length_m:.3g} m / {errors.speed_mps:.3g} m/s = {time_s:.3g} s, in "
        f"{errors.windows} windows under their commands ({horizon_s} s = {horizon_s / time_s:.2g} L/V)"
    )
    times = zip(errors.lengths, errors.seconds, strict=True)
    header = ["method", *(f"{lengths} L/V = {seconds} s" for lengths, seconds in times)]
    rows = [
        [name.replace("_", " "), *(f"{error.distance_m:.3g} m, {error.distance_lengths:.2f} L, "
                                   f"{error.heading_error_deg:.1f} deg" for error in method_errors)]
        for name, method_errors in errors.methods.items()
    ]  # fmt: skip
    return title, header, rows
