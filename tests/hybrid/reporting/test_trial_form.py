"""What a surveyor reads of a trial: the programme, the criteria by side, and each test as a table."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pandas as pd
import pytest

from seatrial.acquisition.core.quantities import KNOT_MPS
from seatrial.analysis.manoeuvres.criteria import criterion_results, index_rows
from seatrial.analysis.manoeuvres.find import find_manoeuvres
from seatrial.analysis.manoeuvres.indices import Manoeuvre
from seatrial.analysis.manoeuvres.motion import motion_of
from seatrial.hybrid.report.trial_form import (
    LONGEST_STEP_S,
    PROGRAMME,
    NumberedRun,
    arrange_on_one_sheet,
    criteria_rows,
    programme_rows,
    time_history_table,
)
from tests.benchmarks.yard_ship import YardShip
from tests.benchmarks.yard_trials import START, Recorder, Truth, record, sail

SHIP = YardShip(120.0, 0.16, 1.0, 4.0, 0.3, 6.0)
ANTENNA_M = (40.0, 5.0)


@cache
def circle() -> tuple[NumberedRun, Truth, pd.DataFrame]:
    """A turning circle with hardly any noise, its truth, and the track of midship by time [s]."""
    how = Recorder(2.0, 0.01, 0.01, 0.005, 0.002, 0.01, ANTENNA_M, True)
    sailed, truth = sail(SHIP, "turning_circle", 1.0)
    table = record(SHIP, sailed, how, 1).assign(wind_speed_mps=5.0, wind_direction_deg=90.0)
    found = [run for run in find_manoeuvres(table, SHIP.length_m) if run.kind == "turning_circle"]
    track = pd.DataFrame(
        {"north_m": sailed.north_m, "east_m": sailed.east_m, "heading_deg": sailed.heading_deg}, sailed.time_s
    )
    return NumberedRun(7, "run", found[0], table), truth, track


def test_history_is_the_motion_of_midship_from_the_order() -> None:
    run, truth, track = circle()
    motion = motion_of(run.table, SHIP.length_m)
    header, rows, step_s = time_history_table(motion, run)
    assert step_s <= LONGEST_STEP_S
    values = pd.DataFrame(rows, columns=header).astype(float)
    seconds = (run.manoeuvre.start - START).total_seconds() + values["time [s]"].to_numpy()
    assert seconds[0] == pytest.approx(truth.orders_s[0], abs=0.6)
    north, east, heading = (np.interp(seconds, track.index, track[name]) for name in track)
    course = np.deg2rad(run.manoeuvre.settings["approach_heading_deg"])
    ahead = (north - north[0]) * np.cos(course) + (east - east[0]) * np.sin(course)
    aside = (east - east[0]) * np.cos(course) - (north - north[0]) * np.sin(course)
    assert values["ahead [m]"].to_numpy() == pytest.approx(ahead, abs=2.0)
    assert values["across [m]"].to_numpy() == pytest.approx(aside, abs=2.0)
    assert np.cos(np.deg2rad(values["heading [deg]"] - heading)).min() > np.cos(np.deg2rad(0.5))
    assert values["speed [kn]"][0] == pytest.approx(SHIP.speed_mps / KNOT_MPS, rel=0.02)
    assert set(values["wind [m/s]"]) == {5.0}
    assert values["order [deg]"].iloc[-1] == pytest.approx(35.0)


@pytest.mark.parametrize("duration_s", [5.0, 40.0, 200.0, 900.0, 4000.0])
def test_history_of_any_length_fits_a_sheet(duration_s: float) -> None:
    run, _, _ = circle()
    motion = motion_of(run.table, SHIP.length_m)
    shortened = replace(run.manoeuvre, end=run.manoeuvre.start + pd.Timedelta(seconds=duration_s))
    header, rows, step_s = time_history_table(motion, replace(run, manoeuvre=shortened))
    assert (len(rows) - 1) * step_s <= duration_s < len(rows) * step_s + 1e-6
    assert step_s <= LONGEST_STEP_S or duration_s > 1700.0
    wide, printed = arrange_on_one_sheet(header, rows)
    assert len(printed) <= 45
    assert all(len(row) == len(wide) for row in printed)
    assert sum(1 for row in printed for cell in row[:: len(header) + 1] if cell) == len(rows)


def test_no_value_of_a_history_is_minus_nothing() -> None:
    run, _, _ = circle()
    _, rows, _ = time_history_table(motion_of(run.table, SHIP.length_m), run)
    assert not {"-0", "-0.0", "-0.00"} & {cell for row in rows for cell in row}


def test_programme_has_the_approach_and_the_wind() -> None:
    run, _, _ = circle()
    row = dict(zip(PROGRAMME, programme_rows([run])[0], strict=True))
    assert row[""] == "7"
    assert row["test"] == "turning circle 35 deg to starboard"
    assert float(row["speed [kn]"]) == pytest.approx(SHIP.speed_mps / KNOT_MPS, rel=0.02)
    assert float(row["shaft [rpm]"]) == pytest.approx(SHIP.rpm, abs=1.0)
    assert (row["wind [m/s]"], row["from"], row["Beaufort"]) == ("5.0", "90\u00b0", "3")


def test_programme_over_two_days_has_dates() -> None:
    run, _, _ = circle()
    later = replace(run.manoeuvre, start=run.manoeuvre.start + pd.Timedelta(days=1))
    times = [row[3] for row in programme_rows([run, replace(run, manoeuvre=later, recording="other")])]
    assert [time[:10] for time in times] == ["2026-06-01", "2026-06-02"]


def test_criteria_stand_port_beside_starboard() -> None:
    run, _, _ = circle()
    results = criterion_results(index_rows([run.manoeuvre]))
    rows = {title.partition(" [")[0]: sides for title, _, sides in criteria_rows(results)}
    assert list(rows) == [
        "advance", "tactical diameter", "initial turning", "first overshoot of 10/10", "second overshoot of 10/10",
        "first overshoot of 20/20", "track reach",
    ]  # fmt: skip
    port, starboard = rows["advance"]
    assert port[0] == "\u2013"
    advance = _advance(run.manoeuvre)
    assert starboard[0].startswith(f"{advance:.0f}"[:2])
    assert len(rows["track reach"]) == 1


def _advance(run: Manoeuvre) -> float:
    return run.indices[
        "advance_m_current_removed" if "advance_m_current_removed" in run.indices else "advance_m"
    ].value
