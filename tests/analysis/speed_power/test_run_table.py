"""Tables of run averages: read whatever their columns are called, and what is wrong with them is said."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

import seatrial
from seatrial.acquisition.core.errors import InputError
from seatrial.acquisition.core.result import to_json
from seatrial.analysis.speed_power.runs import read_run_table, runs_in_table
from tests.benchmarks.speed_trials import Programme
from tests.conftest import Command

TABLE = pd.DataFrame({
    "Run": [1, 2], "Start": ["2026-05-01 23:50", "2026-05-02 00:30"], "Duration [min]": [10.0, 12.0],
    "Heading [deg]": [30.0, 210.0], "Speed over ground [kn]": [14.0, 13.5], "Shaft power [kW]": [8000.0, 8010.0],
    "Shaft speed [rpm]": [90.0, 90.1], "True wind speed [m/s]": [5.0, 6.0], "True wind direction [deg]": [300, 310],
    "Wave height [m]": [0.5, 0.6], "Wave direction [deg]": [300, 300], "Wave period [s]": [4.0, 4.0],
    "Water depth [m]": [60.0, 70.0], "Draught fore [m]": [8.0, 8.0], "Draught aft [m]": [8.4, 8.4],
    "Remarks": ["", "rain"],
})  # fmt: skip


def test_a_table_is_read_by_the_names_of_its_columns() -> None:
    read = runs_in_table(TABLE)
    first, second = read.runs
    assert (first.minutes, second.minutes) == (10.0, 12.0)
    assert (second.start - first.start).total_seconds() == 2400.0
    assert first.speed_mps == pytest.approx(14.0 * 1852.0 / 3600.0)
    assert (second.heading_deg, second.power_kw, second.setting) == (210.0, 8010.0, 90.1)
    assert (first.wind_mps, first.wind_from_deg, first.wave_height_m, second.water_depth_m) == (
        5.0,
        300.0,
        0.5,
        70.0,
    )
    assert read.conditions.draught_m == pytest.approx(8.2)
    assert read.conditions.trim_m == pytest.approx(0.4)
    assert read.passed_over == ("Run", "Remarks")


def test_units_are_those_that_the_names_say() -> None:
    other = pd.DataFrame({
        "begin": TABLE["Start"], "end": ["2026-05-02 00:00", "2026-05-02 00:42"], "hdg": [30.0, 210.0],
        "sog_mps": TABLE["Speed over ground [kn]"] * 1852.0 / 3600.0, "shaft_power_mw": [8.0, 8.01],
        "rpm": [90.0, 90.1],
    })  # fmt: skip
    for one, two in zip(runs_in_table(TABLE).runs, runs_in_table(other).runs, strict=True):
        assert (two.speed_mps, two.power_kw, two.minutes) == pytest.approx(
            (one.speed_mps, one.power_kw, one.minutes)
        )


def test_shafts_add_up_and_torque_turns() -> None:
    both = TABLE.drop(columns="Shaft power [kW]").assign(
        **{"Port shaft power [kW]": 4000.0, "Starboard power [kW]": 3900.0}
    )
    assert [run.power_kw for run in runs_in_table(both).runs] == [7900.0, 7900.0]
    total = TABLE.assign(**{"Port shaft power [kW]": 4000.0})
    assert runs_in_table(total).runs[0].power_kw == 8000.0  # that of the whole ship counts alone
    torque = TABLE.drop(columns="Shaft power [kW]").assign(**{"Torque [kNm]": 800.0})
    assert runs_in_table(torque).runs[0].power_kw == pytest.approx(800.0 * 90.0 * np.pi / 30.0)


@given(st.floats(0.0, 360.0), st.floats(0.5, 12.0), st.floats(0.5, 20.0), st.floats(0.0, 360.0))
def test_relative_wind_is_the_true_one_seen_from_the_ship(
    heading: float, speed: float, wind: float, wind_from: float
) -> None:
    ahead = wind * np.exp(1j * np.deg2rad(wind_from - heading)) + speed
    table = pd.DataFrame({
        "start": ["2026-05-01 06:00"], "duration [min]": [10.0], "heading": [heading], "sog [m/s]": [speed],
        "power [kW]": [1000.0], "relative wind speed [m/s]": [abs(ahead)],
        "relative wind direction [deg]": [float(np.rad2deg(np.angle(ahead)))],
    })  # fmt: skip
    run = runs_in_table(table).runs[0]
    found = run.wind_mps * np.exp(1j * np.deg2rad(run.wind_from_deg))
    assert found == pytest.approx(wind * np.exp(1j * np.deg2rad(wind_from)), abs=1e-6)


def test_times_of_day_go_past_midnight() -> None:
    runs = runs_in_table(TABLE.assign(Start=["23:50", "00:30"])).runs
    assert (runs[1].start - runs[0].start).total_seconds() == 2400.0
    dated = TABLE.assign(Date=["01.05.2026", "02.05.2026"], Start=["23:50", "0:30"])
    assert runs_in_table(dated).runs[1].start == runs_in_table(TABLE).runs[1].start


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (lambda t: t.drop(columns="Shaft power [kW]"), "has no column for the power.*'shaft power'.*kW"),
        (lambda t: t.drop(columns="Heading [deg]"), "has no column for the heading"),
        (lambda t: t.drop(columns="Duration [min]"), "has no column for the duration"),
        (lambda t: t.drop(columns="Start"), "has no column for the start"),
        (
            lambda t: t.rename(columns={"Speed over ground [kn]": "SOG"}),
            r"column 'SOG' has no unit.*SOG \[kn\]",
        ),
        (lambda t: t.assign(sog_kn=14.0), "are the same quantity"),
        (lambda t: t.rename(columns={"Speed over ground [kn]": "Speed [kn]"}), "has no column for the speed"),
        (lambda t: t.assign(**{"Shaft power [kW]": [8.0e6, 8.0e6]}), r"holds 8e\+06 in run 1: in kW it can be"),
        (lambda t: t.assign(**{"Water depth [m]": [60.0, -70.0]}), "holds -70 in run 2"),
        (lambda t: t.assign(**{"Shaft power [kW]": [8000.0, None]}), "has no power in run 2"),
        (lambda t: t.assign(**{"Shaft power [kW]": ["8000", "8,1 MW"]}), "holds '8,1 MW'"),
        (lambda t: t.assign(Start=["yesterday", "today"]), "holds no time: 'yesterday'"),
        (lambda t: t.drop(columns="True wind speed [m/s]"), "has no column for the wind speed"),
        (lambda t: pd.concat([t] * 200), "has 400 rows, which are no runs"),
    ],
)
def test_what_is_wrong_with_a_table_is_said(change, why: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(InputError, match=why):
        runs_in_table(change(TABLE))


def test_a_workbook_and_a_text_hold_the_same_runs(tmp_path: Path) -> None:
    pytest.importorskip("python_calamine")
    pytest.importorskip("xlsxwriter")
    TABLE.to_csv(tmp_path / "runs.csv", index=False)
    TABLE.assign(Start=pd.to_datetime(TABLE["Start"])).to_excel(tmp_path / "runs.xlsx", index=False)
    sheet, text = (to_json(read_run_table(tmp_path / name)) for name in ("runs.xlsx", "runs.csv"))
    assert sheet == text


def test_the_command_takes_a_table_of_run_averages(command: Command, tmp_path: Path) -> None:
    programme = Programme(3)
    programme.table.assign(**{"Wind speed [m/s]": 3.0}).to_csv(tmp_path / "runs.csv", index=False)
    day = tmp_path / "day.toml"
    values = json.loads(programme.conditions.as_text())
    day.write_text("".join(f"{name} = {value}\n" for name, value in values.items()))
    done = command("speed-power", tmp_path / "runs.csv", "--conditions", day, "--json")
    assert done.code == 0, done.err
    fastest = done.json["settings"][-1]["iterative"]
    same = seatrial.speed_power(tmp_path / "runs.csv", day).fastest
    assert fastest["speed_mps"] == pytest.approx(same.speed_mps)
    assert "columns of runs.csv that are not used: Wind speed [m/s]" in done.json["warnings"]
    curve = tmp_path / "wind.csv"
    curve.write_text("angle [deg],C_AA\n0,0.1\n90,0.0\n180,-0.1\n")
    other = seatrial.speed_power(tmp_path / "runs.csv", day, wind_coefficients=curve)
    assert other.fastest.power_kw != pytest.approx(same.power_kw, rel=1e-3)
    (tmp_path / "none.csv").write_text("a,b\n1,2\n")
    wrong = command("speed-power", tmp_path / "none.csv")
    assert wrong.code == 1
    assert "none.csv" in wrong.err
    assert "start" in wrong.err
