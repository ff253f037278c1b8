"""Speed and power of whole trials: a known power curve is found again, from any of the channels that tell power."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.optimize import brentq

import seatrial as st
from seatrial.acquisition.config.run_sheet import Conditions
from seatrial.acquisition.core import ship
from seatrial.acquisition.core.errors import DataShortageError, InputError
from seatrial.acquisition.core.result import from_json, to_json
from seatrial.acquisition.core.trial import Sample, Trial
from seatrial.acquisition.recording.writer import RecordingWriter
from seatrial.analysis.batch import process_recording
from seatrial.analysis.manoeuvres import conducted
from seatrial.analysis.manoeuvres.conducted import ConductedRun
from seatrial.analysis.products import Options
from seatrial.analysis.speed_power.analysis import SpeedPower, speed_power
from seatrial.analysis.speed_power.report import corrected_words, result_sentence
from seatrial.analysis.speed_power.runs import power_columns, power_runs
from seatrial.analysis.tables.table import times_ns
from seatrial.hybrid.report.trial import TrialCase
from tests.analysis.speed_power.trials import (
    BEAM_M,
    DRAUGHT_M,
    EFFICIENCY,
    FRONTAL_M2,
    LENGTH_M,
    VOLUME_M3,
    WIND_CURVE,
    Day,
    sail,
    true_power_kw,
)
from tests.conftest import Command

CONDITIONS = Conditions(
    length_m=LENGTH_M, beam_m=BEAM_M, draught_m=DRAUGHT_M, displacement_m3=VOLUME_M3, frontal_area_m2=FRONTAL_M2,
    wind_resistance=WIND_CURVE, propulsive_efficiency=EFFICIENCY,
)  # fmt: skip


def true_speed_mps(power_kw: float) -> float:
    return float(brentq(lambda speed: true_power_kw(speed) - power_kw, 1.0, 20.0))


def day_of(seed: int) -> Day:
    """Any sea: tides up to 1.6 knots from any side, wind up to 12 m/s, half to twice the noise."""
    random = np.random.default_rng(seed)
    return Day(
        tide_mps=random.uniform(0.0, 0.8), phase_rad=random.uniform(0.0, 2.0 * np.pi),
        steady_mps=random.uniform(-0.3, 0.3), current_to_deg=random.uniform(0.0, 360.0),
        wind_mps=random.uniform(0.0, 12.0), wind_from_deg=random.uniform(0.0, 360.0),
        noise=random.uniform(0.5, 2.0), seed=seed,
    )  # fmt: skip


@pytest.fixture(scope="module")
def table() -> pd.DataFrame:
    return sail(Day(wind_mps=7.0))


@pytest.fixture(scope="module")
def found(table: pd.DataFrame) -> SpeedPower:
    return speed_power([table], CONDITIONS)


def test_intervals_hold_the_true_curve_in_tide_wind_and_noise() -> None:
    inside, errors = list[bool](), list[float]()
    for seed in range(4):
        result = speed_power([sail(day_of(seed))], CONDITIONS)
        assert [each.runs for each in result.settings] == [2, 4, 2, 2]
        for each in (setting.iterative for setting in result.settings):
            true = true_speed_mps(each.power_kw)
            inside.append(each.low_mps <= true <= each.high_mps)
            errors.append(each.speed_mps - true)
    assert np.mean(inside) >= 0.85
    assert np.sqrt(np.mean(np.square(errors))) < 0.02  # 0.04 knots, of a current of up to 2


def test_current_of_each_run_is_the_tide_that_she_was_in(found: SpeedPower) -> None:
    day, first = Day(), pd.Timestamp("2026-05-01 06:00", tz="UTC")
    for each in found.runs:
        seconds = (each.run.start + (each.run.end - each.run.start) / 2 - first).total_seconds()
        tide = day.steady_mps + day.tide_mps * np.cos(2.0 * np.pi * seconds / (12.42 * 3600.0) + day.phase_rad)
        along = tide * np.cos(np.deg2rad(day.current_to_deg - each.run.heading_deg))
        assert each.current_mps == pytest.approx(along, abs=0.05)


def test_mean_of_means_of_two_double_runs_agrees(found: SpeedPower) -> None:
    both = next(each for each in found.settings if each.runs == 4)
    assert both.mean_of_means.speed_mps == pytest.approx(true_speed_mps(both.mean_of_means.power_kw), abs=0.03)
    assert both.mean_of_means.low_mps < both.iterative.speed_mps < both.mean_of_means.high_mps


def test_without_the_wind_s_curve_the_wind_stays_in_the_power(table: pd.DataFrame, found: SpeedPower) -> None:
    as_it_was = speed_power([table])
    assert {each.name for each in found.corrections if each.applied} == {"wind"}
    assert not any(each.applied for each in as_it_was.corrections)
    assert "without length_m or beam_m nothing bounds what they took" in as_it_was.no_interval
    assert np.isnan(as_it_was.fastest.low_mps)
    assert found.no_interval == ""
    powers = [[run.power_kw for run in each.runs[:2]] for each in (as_it_was, found)]
    assert np.ptp(powers[0]) < 20.0 < np.ptp(powers[1])  # kW, against and with the wind


@pytest.mark.parametrize(
    "columns",
    [
        lambda t: {"shaft_torque_knm": t["shaft_power_kw"] / (t["main_rpm"] * np.pi / 30.0)},
        lambda t: {"main_shaft_power_kw": t["shaft_power_kw"]},
        lambda t: {
            f"{side}_shaft_power_{unit}": t["shaft_power_kw"] * half
            for side, unit, half in (("port", "kw", 0.5), ("starboard", "w", 500.0))
        },
    ],
)
def test_power_of_any_channels_is_the_same(
    table: pd.DataFrame, columns: Callable[..., dict[str, pd.Series]]
) -> None:
    other = table.drop(columns="shaft_power_kw").assign(**columns(table), shaft_rpm=table["main_rpm"])
    runs = [power_runs(each)[0] for each in (table, other)]
    assert [each.power_kw for each in runs[1]] == pytest.approx([each.power_kw for each in runs[0]], rel=2e-3)


def test_a_total_counts_alone_and_torque_needs_a_shaft_speed(table: pd.DataFrame) -> None:
    both = table.assign(port_shaft_power_kw=table["shaft_power_kw"])
    assert power_columns(both) == {"": ("shaft_power_kw", "")}
    torque = table.drop(columns=["shaft_power_kw", "main_rpm"]).assign(port_shaft_torque_knm=1.0)
    assert power_columns(torque) == {}
    with pytest.raises(InputError, match="has no shaft power"):
        power_runs(torque)


@pytest.mark.parametrize(
    ("names", "meant"),
    [
        (("propeller",), {"": 0, "main": 0, "1": 0, "propeller": 0, "port": None}),
        (("port_propeller", "starboard_propeller"), {"port": 0, "starboard": 1, "": None, "1": None}),
        (("propeller_1", "propeller_2"), {"1": 0, "2": 1, "propeller_2": 1, "main": None}),
        (("main", "port", "starboard"), {"main": 0, "port": 1, "": None}),
    ],
)
def test_a_shafts_name_means_one_of_the_drives(names: tuple[str, ...], meant: dict[str, int | None]) -> None:
    drives = tuple(ship.Actuator(name, "propeller") for name in names)
    actuators = (ship.Actuator("rudder", "rudder"), *drives, ship.Actuator("port_tunnel", "tunnel"))
    assert {shaft: ship.drive_named(shaft, actuators) for shaft in meant} == {
        shaft: None if number is None else drives[number] for shaft, number in meant.items()
    }


def test_torque_of_the_only_shaft_goes_with_its_speed_whatever_it_is_called(table: pd.DataFrame) -> None:
    one = table.drop(columns=["shaft_power_kw"]).rename(columns={"main_rpm": "propeller_rpm"})
    assert power_columns(one.assign(aft_shaft_torque_knm=1.0)) == {"aft": ("aft_shaft_torque_knm", "propeller_rpm")}


def test_runs_of_a_controllable_propeller_are_at_one_setting_if_its_pitch_is_the_same(
    table: pd.DataFrame, found: SpeedPower
) -> None:
    """At one shaft speed the power goes by the pitch alone, whose thrust is that of the shaft speed's square."""
    pitched = table.assign(main_rpm=90.0, main_pitch_percent=100.0 * (table["main_rpm"] / 90.0) ** 2)
    propeller = ship.Actuator("main", "controllable_propeller")
    pitched.attrs["trial"] = {"actuators": ship.actuators_as_text((propeller,)), "vessel": ""}
    result = speed_power([pitched], CONDITIONS)
    speeds_mps = [setting.mean_of_means.speed_mps for setting in result.settings]
    assert speeds_mps == pytest.approx([setting.mean_of_means.speed_mps for setting in found.settings], abs=0.01)

    unknown = speed_power([table.assign(main_rpm=90.0)], CONDITIONS)
    assert len(unknown.settings) == 1
    assert any("count as one power setting" in warning for warning in unknown.warnings)
    assert not any("count as one power setting" in warning for warning in found.warnings)


def test_power_is_that_of_shafts_that_turn_to_either_side(table: pd.DataFrame, found: SpeedPower) -> None:
    torque_knm = 0.5 * table["shaft_power_kw"] / (table["main_rpm"] * np.pi / 30.0)
    twin = table.drop(columns=["shaft_power_kw", "main_rpm"]).assign(
        port_rpm=table["main_rpm"], starboard_rpm=-table["main_rpm"],
        port_shaft_torque_knm=torque_knm, starboard_shaft_torque_knm=torque_knm,
    )  # fmt: skip
    propellers = (ship.Actuator("port", "propeller"), ship.Actuator("starboard", "propeller"))
    twin.attrs["trial"] = {"actuators": ship.actuators_as_text(propellers), "vessel": ""}
    result = speed_power([twin], CONDITIONS)
    assert result.curve.speed_mps(5000.0) == pytest.approx(float(found.curve.speed_mps(5000.0)), abs=0.01)


def test_runs_that_the_crew_marked_are_the_runs(table: pd.DataFrame) -> None:
    begin = table.index[0].value
    marks = [(1500, "speed run 1 start"), (1860, "speed run 1 end"), (3800, "run 2 start"), (4160, "run 2 end")]
    runs, _ = power_runs(table, [(begin + second * 10**9, text) for second, text in marks])
    assert [round((each.start - table.index[0]).total_seconds()) for each in runs] == [1500, 3800]
    assert [each.minutes for each in runs] == pytest.approx([6.0, 6.0], abs=0.05)


def test_of_a_conducted_programme_valid_speed_runs_are_the_runs(table: pd.DataFrame, tmp_path: Path) -> None:
    """An invalid run is left out by name and reason; what lies between the runs is no run; a note is no mark.
    The command and the report agree."""

    def led(number: int, start: float, minutes: float, outcome: str, *reasons: str) -> ConductedRun:
        ordered, over = (table.index[0] + pd.Timedelta(seconds=start + 60.0 * later) for later in (0.0, minutes))
        judged = conducted.JudgedSpan("speed_run", ordered, over + pd.Timedelta(seconds=conducted.MARGIN_S))
        return ConductedRun(number, "speed run", outcome, ordered, over, judged, reasons)

    # legs of 2310 s, of which the first 150 turn; the fourth run is a repeat on the same leg
    wind = "the wind was of force 8, above 5"
    day = [led(1, 1500.0, 10.0, "valid"), led(2, 3000.0, 5.0, "invalid", wind), led(3, 3800.0, 10.0, "valid"),
           led(4, 8500.0, 10.0, "valid"), led(5, 10_700.0, 10.0, "aborted", "traffic")]  # fmt: skip
    events = [(run.judged.end.value, run.mark()) for run in day if run.judged]
    events += [(events[0][0] - 10**9, "run 1: note: start of rain"), (events[0][0], "run 1: note: rain at its end")]
    runs, left_out = power_runs(table, events)
    in_programme = [run for run in runs if run.start <= day[-1].ordered]
    assert [run.start for run in in_programme] == [run.ordered for run in day if run.outcome == "valid"]
    assert [run.minutes for run in in_programme] == pytest.approx([10.0] * 3, abs=0.05)
    assert [each.why for each in left_out] == [
        f"run 2 was invalid: {wind}", conducted.BETWEEN_RUNS, "run 5 was aborted: traffic"
    ]  # fmt: skip
    assert len(runs) - len(in_programme) == 5  # the legs after the programme, as without one

    recording = tmp_path / "trial.mcap"
    channels = [st.declare("shaft_power_kw", "kW", 0, 50_000), st.declare("main_rpm", "rpm", 0, 200)]
    trial = Trial("day", channels=ship.declared_channels_as_json(channels))
    with RecordingWriter(recording, trial) as writer:
        for text_ns, text in events:
            writer.write_event(text, text_ns, name="mark")
        part = table.iloc[:11_700:2]  # the programme, every other second
        for time_ns, row in zip(times_ns(part), part.to_dict("records"), strict=True):
            for name, value in row.items():
                writer.write_sample(Sample(str(name), value, "x", time_ns, 0, time_ns))
    result, in_report = st.speed_power(recording), TrialCase((recording,), None).speed_power
    assert in_report is not None
    for one in (result, in_report):
        assert f"run 2 was invalid: {wind}" in {each.why for each in one.left_out}
    assert f"no speed run: run 2 was invalid: {wind} (" in " ".join(str(result).split())


def test_what_the_standard_asks_for_is_said(table: pd.DataFrame) -> None:
    part = table.iloc[:6900]  # two legs at the first power, one at the second
    result = speed_power([part], Conditions(length_m=34.0, water_depth_m=9.0, beam_m=9.6, draught_m=2.8))
    said = " | ".join(result.warnings)
    for words in ("34 m long", "displacement_m3", "1 double run at 1 power setting", "9 m of water"):
        assert words in said
    alone = "no run on the reciprocal course at this power within two hours"
    assert [each.why for each in result.left_out] == [alone]
    assert "midship_section_m2" in next(each.method for each in result.corrections if each.name == "shallow water")


def test_one_leg_is_no_double_run(table: pd.DataFrame) -> None:
    with pytest.raises(DataShortageError, match="no double run was found"):
        speed_power([table.iloc[:2300]])


def test_two_tables_are_one_trial(table: pd.DataFrame, found: SpeedPower) -> None:
    parts = speed_power([table.iloc[:9000], table.iloc[9000:]], CONDITIONS)
    assert parts.curve.speed_mps(5000.0) == pytest.approx(found.curve.speed_mps(5000.0), abs=0.01)


def test_result_prints_draws_and_goes_to_json_and_back(found: SpeedPower) -> None:
    text = str(found)
    assert "Speed at power, ISO 15016:2015" in text
    assert "those of the ship" in text
    assert "not known: wave_height_m, wave_from_deg" in text
    assert not re.search(r"\de[+-]\d", text)  # numbers as people write them
    assert to_json(from_json(SpeedPower, json.loads(json.dumps(to_json(found))))) == to_json(found)
    assert len(found.plot().axes) == 1
    asked = found.speed_at(5000.0)
    assert asked.low_mps < true_speed_mps(5000.0) < asked.high_mps
    with pytest.raises(InputError, match="outside the range of the runs"):
        found.speed_at(50_000.0)


@pytest.mark.slow
def test_the_row_of_a_batch_has_the_speed_at_the_highest_power(table: pd.DataFrame, tmp_path: Path) -> None:
    """A recording without power at its shafts, or without reciprocal runs, has none."""
    calm, path = sail(Day(), rpm={60.0: 1, 90.0: 1}), tmp_path / "trial.mcap"
    channels = [st.declare("shaft_power_kw", "kW", 0, 50_000), st.declare("main_rpm", "rpm", 0, 200)]
    st.write(calm, path, declared=channels)
    options = Options(smooth=False, pictures=False)
    found = process_recording(path, tmp_path / "out", options)["indices"]
    assert found["speed_power_mps"] == pytest.approx(true_speed_mps(found["speed_power_kw"]), abs=0.1)
    assert " kn" in (tmp_path / "out" / "page.html").read_text()
    for name, less in (
        ("no_power", calm.drop(columns="shaft_power_kw")),
        ("one_way", calm[calm.index < calm.index[2000]]),
    ):
        st.write(less, tmp_path / f"{name}.mcap", declared=channels)
        assert (
            "speed_power_mps"
            not in process_recording(tmp_path / f"{name}.mcap", tmp_path / name, options)["indices"]
        )


def test_a_sentence_tells_the_speed_and_what_it_is_corrected_for(found: SpeedPower) -> None:
    assert re.fullmatch(
        r"In still water the ship makes 1\d\.\d+ kn \(95 % interval .* kn\) at 8,\d+ kW\.",
        result_sentence(found),
    )
    assert corrected_words(found).startswith("Corrected for current, wind")
    assert found.fastest.power_kw == max(each.iterative.power_kw for each in found.settings)


def test_conditions_that_a_recording_carries_are_used(tmp_path: Path) -> None:
    """Those of its configuration or column map, in the command's function and in the report's case alike."""
    recording = tmp_path / "trial.mcap"
    channels = [st.declare("shaft_power_kw", "kW", 0, 50_000), st.declare("main_rpm", "rpm", 0, 200)]
    table = sail(Day(wind_mps=7.0), rpm={60.0: 1, 90.0: 1})
    st.write(table, recording, declared=channels, conditions=CONDITIONS.as_text())
    carried = st.speed_power(recording)
    assert "wind" in {each.name for each in carried.corrections if each.applied}
    in_report = TrialCase((recording,), None).speed_power
    assert in_report is not None
    assert in_report.fastest.speed_mps == pytest.approx(carried.fastest.speed_mps, abs=0.01)
    assert [each.applied for each in in_report.corrections] == [each.applied for each in carried.corrections]
    (tmp_path / "conditions.toml").write_text("[conditions]\npower_error_percent = 8.0\n")
    stated = st.speed_power(recording)  # beside the recording, as for the report and a batch
    assert stated.fastest.high_mps > carried.fastest.high_mps
    assert [each.applied for each in stated.corrections] == [each.applied for each in carried.corrections]


def test_command_says_the_speed_at_a_power(command: Command, table: pd.DataFrame, tmp_path: Path) -> None:
    recording, day = tmp_path / "trial.mcap", tmp_path / "day.toml"
    channels = [st.declare("shaft_power_kw", "kW", 0, 50_000), st.declare("main_rpm", "rpm", 0, 200)]
    st.write(table, recording, declared=channels)
    day.write_text("length_m = 180.0\ndraught_m = 11.0\n")
    asked = ("--conditions", day, "--power", "5000")
    done = command("speed-power", recording, *asked, "-o", tmp_path / "out", "--json")
    assert done.code == 0, done.err
    values = json.loads(done.out)
    assert values["asked"][0]["power_kw"] == 5000.0
    assert {path.name for path in (tmp_path / "out").iterdir()} >= {"speed_power.json", "speed_power.png"}
    day.write_text("lenght_m = 180.0\n")
    wrong = command("speed-power", recording, "--conditions", day)
    assert wrong.code == 1
    assert "line 1" in wrong.err
    assert "lenght_m" in wrong.err
