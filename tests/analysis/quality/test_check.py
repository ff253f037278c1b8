"""The assembly: grades, flags on the joined table, findings once and in their order, the contract's keys."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from seatrial.acquisition.core.errors import DataShortageError, InputError
from seatrial.acquisition.core.quantities import Series
from seatrial.acquisition.core.ship import NAMES
from seatrial.acquisition.core.trial import Quality, Trial
from seatrial.acquisition.recording.reader import Recording, read_recording
from seatrial.acquisition.recording.writer import write_table
from seatrial.analysis.quality.channel_checks import grade_of
from seatrial.analysis.quality.check import SEVERITY, DataQuality, check_recording, check_table, rows_of_samples
from seatrial.analysis.quality.findings import WORDING
from seatrial.analysis.tables.table import table_of, times_ns
from seatrial.hybrid.simulation.trial import simulate_trial
from tests.analysis.quality import faults
from tests.analysis.quality.faults import Fault

KEYS = {"count", "rate_hz", "gaps", "stuck", "spikes", "out_of_range", "duplicates", "time_backwards", "grade"}
OWN = {
    "gap",
    "stuck",
    "spike",
    "out_of_range",
    "duplicate",
    "time_backwards",
    "quantised",
    "clock_jump",
    "time_jitter",
}


ROOT = Path(__file__).parents[3]
QUALITY = ROOT / "analysis" / "quality"


def test_every_code_has_a_place_among_the_others_and_a_line_in_the_documentation() -> None:
    page = (ROOT / "docs" / "data_quality.md").read_text(encoding="utf-8")
    sources = [path.read_text(encoding="utf-8") for path in QUALITY.rglob("*.py")]
    written = {code for text in sources for code in re.findall(r'Finding\(\s*"(\w+)"', text)}
    assert (written | set(WORDING)) - {"check_failed"} <= set(SEVERITY)
    assert [code for code in SEVERITY if f"`{code}`" not in page] == []


def test_the_documentation_names_the_modules_that_there_are() -> None:
    page = (ROOT / "docs" / "data_quality.md").read_text(encoding="utf-8")
    table = page.partition("## Comparison of channels")[2].partition("**Findings of one cause")[0]
    rows = [row.rstrip(" |").rpartition("|")[2] for row in table.splitlines() if row.startswith("| `")]
    named = {name for row in rows for name in re.findall(r"`([\w/]+)`", row)}
    assert named
    assert {name for name in named if not (QUALITY / f"{name}.py").is_file()} == set()


@pytest.fixture(scope="module")
def trial() -> pd.DataFrame:
    return simulate_trial("gunnerus_long", "gentle", "zigzag_20_20", 300.0, 4.0, seed=5, heading_deg=340.0)[0]


@pytest.fixture(scope="module")
def sound(trial: pd.DataFrame) -> DataQuality:
    return check_table(trial)


@pytest.fixture
def single_channels_only(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the checks across channels, which have their own tests and take their time."""
    monkeypatch.setattr("seatrial.analysis.quality.check.CHECKS", ())


def spoilt(trial: pd.DataFrame, fault: Fault, seed: int = 0) -> tuple[pd.DataFrame, str]:
    result = fault(trial, np.random.default_rng(seed))
    return result.table, result.code


def test_a_sound_trial_has_no_findings_and_good_channels(sound: DataQuality) -> None:
    assert sound.findings == ()
    assert {each.grade for each in sound.channels.values()} == {"good"}
    assert tuple(sound.channels) == NAMES


def test_the_json_has_the_keys_of_the_contract(trial: pd.DataFrame) -> None:
    table, _ = spoilt(trial, faults.gap(20.0))
    found = json.loads(json.dumps(check_table(table).as_dict()))
    assert set(found) == {"channels", "findings", "causes", "events", "unevaluated"}
    assert all(set(each) == KEYS for each in found["channels"].values())
    assert all(set(each["gaps"][0]) >= {"start", "seconds"} for each in found["channels"].values())
    for finding in found["findings"]:
        assert set(finding) == {"code", "channel", "start", "end", "text", "estimate"}


@pytest.mark.parametrize(
    ("fault", "channel"),
    [(faults.gap(20.0), "all"), (faults.duplicates, "all"), (faults.time_backwards, "all"),
     (faults.clock_jump(5.0), "all"), (faults.clock_jump(-4.0), "all"),
     (faults.stuck("heading_deg", 40.0), "heading_deg"),
     (faults.spikes("east_m", 15.0), "east_m"), (faults.out_of_range("wind_speed_mps", 655.35), "wind_speed_mps"),
     (faults.quantised("yaw_rate_dps", 0.5), "yaw_rate_dps")],
)  # fmt: skip
@pytest.mark.usefixtures("single_channels_only")
def test_a_fault_is_one_finding_and_no_other_of_its_kind(trial: pd.DataFrame, fault: Fault, channel: str) -> None:
    table, code = spoilt(trial, fault)
    quality = check_table(table)
    own = [(each.code, each.channel) for each in quality.findings if each.code in OWN]
    assert (code, channel) in own
    if code != "clock_jump":
        assert own == [(code, channel)]
    named = list(quality.channels) if channel == "all" else [channel]
    assert all(quality.channels[name].grade == "suspect" for name in named)


def test_a_jump_of_the_clock_is_not_also_a_gap(trial: pd.DataFrame) -> None:
    table, _ = spoilt(trial, faults.clock_jump(8.0))
    quality = check_table(table)
    assert [each.code for each in quality.findings if each.code in OWN] == ["clock_jump"]
    (jump,) = (each for each in quality.findings if each.code == "clock_jump")
    assert jump.estimate["low"] <= 8.0 <= jump.estimate["high"]


def test_findings_come_with_the_gravest_first(trial: pd.DataFrame) -> None:
    table, _ = spoilt(spoilt(trial, faults.gap(15.0))[0], faults.out_of_range("surge_mps", 99.0))
    codes = [each.code for each in check_table(table).findings if each.code in OWN]
    assert codes == ["out_of_range", "gap"]


@pytest.mark.usefixtures("single_channels_only")
def test_flags_stand_beside_the_rows_that_were_given(trial: pd.DataFrame, sound: DataQuality) -> None:
    assert sound.flags.index.equals(trial.index)
    assert set(np.unique(sound.flags)) == {Quality.GOOD}
    assert {str(each) for each in sound.flags.dtypes} == {"uint8"}
    table = trial.copy()
    table.iloc[300, table.columns.get_loc("surge_mps")] = 20.0
    table.iloc[310, table.columns.get_loc("sway_mps")] = np.nan
    shuffled = table.iloc[np.random.default_rng(0).permutation(len(table))]
    for given in (table, shuffled):
        flags = check_table(given).flags
        assert flags.index.equals(given.index)
        assert flags["sway_mps"].to_numpy()[np.flatnonzero(given["sway_mps"].isna())[0]] == Quality.MISSING
    assert check_table(table).flags["surge_mps"].iloc[300] == Quality.BAD


def test_channels_of_different_rates_share_the_joined_table(trial: pd.DataFrame, tmp_path: Path) -> None:
    slow = trial.copy()
    slow.loc[slow.index[1::2], ["wind_direction_deg", "wind_speed_mps"]] = np.nan
    path = tmp_path / "rates.mcap"
    write_table(slow, path, Trial(name="rates"))
    recording = read_recording(path)
    quality = check_recording(recording)
    assert quality.findings == ()
    assert quality.channels["wind_speed_mps"].rate_hz == pytest.approx(2.0, rel=0.01)
    table = table_of(recording)
    assert quality.flags.index.equals(table.index)
    assert (quality.flags["wind_speed_mps"].eq(Quality.MISSING) == table["wind_speed_mps"].isna()).all()


def test_rows_of_samples_follow_the_joined_table() -> None:
    """A time that one channel has twice stands in two rows."""
    rows = rows_of_samples(np.array([0, 1, 1, 2, 5]), np.array([5, 1, 0, 1]))
    assert rows.tolist() == [4, 1, 0, 2]


def test_what_a_decoder_called_bad_is_bad_and_may_be_out_of_range(trial: pd.DataFrame) -> None:
    series = {}
    for name in trial:
        values, quality = trial[name].to_numpy().copy(), np.ones(len(trial), np.uint8)
        if name == "surge_mps":
            values[50], quality[50:52] = 327.67, Quality.BAD
        stamps = times_ns(trial)
        series[str(name)] = Series(stamps, stamps, values, quality, ("bus",), np.zeros(len(trial), np.int32))
    recording = Recording(
        Path("x.mcap"), Trial(), series, {}, [], len(trial), True, int(stamps[0]), int(stamps[-1])
    )
    quality = check_recording(recording)
    assert quality.channels["surge_mps"].out_of_range == 1
    assert quality.channels["surge_mps"].count == len(trial)


def test_an_assumed_constant_is_no_stuck_channel(trial: pd.DataFrame) -> None:
    table = trial.assign(wind_speed_mps=0.0, wind_direction_deg=0.0, tunnel_rpm=0.0)
    assumed = ("wind_speed_mps", "wind_direction_deg", "tunnel_rpm")
    table.attrs["sources"] = {name: ["assumed" if name in assumed else "bus"] for name in table}
    assert check_table(table).findings == ()


@pytest.mark.parametrize(
    ("flagged", "missing", "named", "grade"),
    [({1: 1000}, 0, False, "good"), ({1: 1000}, 0, True, "suspect"), ({1: 980, 3: 20}, 0, False, "suspect"),
     ({1: 995, 4: 5}, 0, False, "good"), ({1: 700, 4: 300}, 0, True, "bad"), ({1: 700}, 300, False, "bad"),
     ({}, 0, False, "bad")],
)  # fmt: skip
def test_grades_go_by_shares_of_the_samples_that_were_due(
    flagged: dict[int, int], missing: int, named: bool, grade: str
) -> None:
    assert grade_of(flagged, missing, named) == grade


def test_tables_that_cannot_be_checked_say_so(trial: pd.DataFrame) -> None:
    with pytest.raises(InputError, match="zone"):
        check_table(trial.tz_localize(None))
    empty = Recording(Path("x.mcap"), Trial(), {}, {}, [], 0, True, 0, 0)
    with pytest.raises(DataShortageError):
        check_recording(empty)


@pytest.mark.parametrize("rows", [1, 2, 10])
def test_a_table_of_few_rows_is_checked_without_complaint(trial: pd.DataFrame, rows: int) -> None:
    assert check_table(trial.iloc[:rows]).findings == ()


@pytest.mark.parametrize(("speed_mps", "spikes"), [(0.05, 0), (5.0, 1)])
def test_a_faint_wind_may_turn_at_once_and_a_strong_one_not(
    single_channels_only: None, speed_mps: float, spikes: int
) -> None:
    """Half a turn of 0.05 m/s is a stir of the air as any other; half a turn of 5 m/s is a reading astray."""
    random = np.random.default_rng(1)
    direction = 200.0 + 2.0 * random.standard_normal(600)
    speed = np.abs(speed_mps + 0.03 * random.standard_normal(600))
    direction[300] += 150.0
    index = pd.date_range("2026-05-17", periods=600, freq="100ms", tz="UTC", unit="ns")
    table = pd.DataFrame({"wind_direction_deg": direction % 360.0, "wind_speed_mps": speed}, index=index)
    assert check_table(table).channels["wind_direction_deg"].spikes == spikes
