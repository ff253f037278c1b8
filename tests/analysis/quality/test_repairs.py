"""What is certain is put right, nearer to the truth than before, once, on the record, and never in the original."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from seatrial.acquisition.core.errors import InputError
from seatrial.acquisition.core.ship import (
    BY_NAME,
    NAMES,
    angle_difference,
    is_off_by_whole_turns,
    unwrap,
    wrap_360,
)
from seatrial.acquisition.core.trial import Quality, Trial
from seatrial.acquisition.recording.reader import read_recording
from seatrial.acquisition.recording.writer import write_table
from seatrial.acquisition.tables.import_table import import_table
from seatrial.analysis.quality.channel_checks import check_heading_wrap
from seatrial.analysis.quality.check import check_recording
from seatrial.analysis.quality.controls import check_orders
from seatrial.analysis.quality.findings import CheckResult, Finding
from seatrial.analysis.quality.repairs import RepairResult, repair_table, write_repaired
from seatrial.analysis.quality.wind import check_wind
from seatrial.analysis.tables.table import history_of, read_table, table_of
from seatrial.hybrid.simulation.trial import simulate_trial
from tests.analysis.conftest import table_at
from tests.analysis.quality import faults
from tests.analysis.test_real_recordings import MAPS, TRIALS
from tests.conftest import nightly

TRIAL = Trial(name="voyage", vessel="gunnerus_long", origin_latitude_deg=63.4, origin_longitude_deg=10.4)


@pytest.fixture(scope="module")
def sound() -> pd.DataFrame:
    return simulate_trial("gunnerus_long", "gentle", "zigzag_20_20", 900.0, 2.0, 11)[0]


def stated(table: pd.DataFrame, code: str, channel: str, certain: bool = True, **estimate: float) -> Finding:
    return Finding(code, channel, table.index[0], table.index[-1], code, "", estimate, certain)


def rms(off: object) -> float:
    return float(np.sqrt(np.nanmean(np.square(np.asarray(off, dtype=float)))))


def dice() -> np.random.Generator:
    return np.random.default_rng(3)


def test_headings_come_back_onto_the_circle(sound: pd.DataFrame) -> None:
    spoilt = faults.heading_wrap_interpolated(0.9)(sound, dice()).table
    repaired = repair_table(spoilt, check_heading_wrap(spoilt).findings)
    before, after = (
        rms(angle_difference(each["heading_deg"], sound["heading_deg"])) for each in (spoilt, repaired.table)
    )
    assert before > 10.0
    assert after < 1.0
    assert check_heading_wrap(repaired.table).findings == ()
    assert repaired.repairs[0].changed == check_heading_wrap(spoilt).findings[0].estimate["samples"]
    assert repaired.table["heading_deg"].between(0.0, 360.0, inclusive="left").all()


def test_long_holes_become_gaps_where_no_rate_is_known() -> None:
    at_s = np.arange(0.0, 600.0, 0.5)
    knots_s = np.arange(0.0, 615.0, 15.0)
    swinging = table_at(at_s, {"heading_deg": np.interp(at_s, knots_s, wrap_360(20.0 * np.sin(knots_s / 40.0)))})
    (finding,) = check_heading_wrap(swinging).findings
    repaired = repair_table(swinging, [finding]).table["heading_deg"]
    assert repaired.isna().sum() == finding.estimate["samples"] > 50


def test_speeds_are_scaled_once_for_both_findings(sound: pd.DataFrame) -> None:
    spoilt = faults.speed_scale(0.98)(sound, dice()).table
    findings = [stated(sound, "speed_scale", name, factor=1.0 / 0.98) for name in ("surge_mps", "sway_mps")]
    repaired = repair_table(spoilt, findings)
    for name in ("surge_mps", "sway_mps"):
        assert repaired.table[name].to_numpy() == pytest.approx(sound[name].to_numpy(), abs=1e-12)
    assert [each.code for each in repaired.repairs] == ["speed_scale"]


@pytest.mark.parametrize("fault", [faults.position_time_jitter(0.6), faults.position_time_jitter(0.6, 5.0)])
def test_positions_come_back_to_where_the_ship_was(sound: pd.DataFrame, fault: faults.Fault) -> None:
    spoilt = fault(sound, dice()).table
    repaired = repair_table(spoilt, [stated(sound, "position_time_jitter", "north_m")]).table
    before, after = (
        rms(table[["north_m", "east_m"]] - sound[["north_m", "east_m"]]) for table in (spoilt, repaired)
    )
    assert after < 0.5 * before


def test_speeds_are_scaled_before_positions_lean_on_them(sound: pd.DataFrame) -> None:
    spoilt = faults.position_time_jitter(0.6)(faults.speed_scale(0.9)(sound, dice()).table, dice()).table
    findings = [
        stated(sound, "position_time_jitter", "north_m"),
        stated(sound, "speed_scale", "surge_mps", factor=1 / 0.9),
    ]
    repaired = repair_table(spoilt, findings)
    assert [each.code for each in repaired.repairs] == ["speed_scale", "position_time_jitter"]
    assert rms(repaired.table[["north_m", "east_m"]] - sound[["north_m", "east_m"]]) < 1.0


def test_a_heading_offset_that_was_not_mended_does_not_lead_positions_astray(sound: pd.DataFrame) -> None:
    askew = faults.heading_offset(10.0)(sound, dice()).table
    repaired = repair_table(askew, [stated(sound, "position_time_jitter", "north_m")]).table
    assert rms(repaired[["north_m", "east_m"]] - sound[["north_m", "east_m"]]) < 10.0


def test_stamps_whose_errors_add_up_do_not_pull_the_path() -> None:
    """On a straight run a second of the way is lost for the positions now and then, as in the trials of 2022."""
    at_s, random = np.arange(0.0, 900.0, 0.5), dice()
    lost_s = np.cumsum(random.random(at_s.size) < 0.02)
    columns = {"north_m": 3.0 * (at_s - lost_s), "east_m": 4.0 * (at_s - lost_s), "surge_mps": 5.0, "sway_mps": 0.0,
               "heading_deg": np.rad2deg(np.arctan2(4.0, 3.0))}  # fmt: skip
    spoilt = table_at(at_s, {name: value + random.normal(0.0, 0.03, at_s.size) for name, value in columns.items()})
    repaired = repair_table(spoilt, [stated(spoilt, "position_time_jitter", "north_m")]).table
    step_m = repaired[["north_m", "east_m"]].diff(20).to_numpy()[20:]
    way = np.hypot(step_m[:, 0], step_m[:, 1])
    assert way == pytest.approx(50.0, abs=1.0)


def test_apparent_wind_becomes_true(sound: pd.DataFrame) -> None:
    spoilt = faults.wind_apparent(sound, dice()).table
    repaired = repair_table(spoilt, check_wind(spoilt).findings).table
    assert repaired["wind_speed_mps"].to_numpy() == pytest.approx(sound["wind_speed_mps"].to_numpy(), abs=1e-9)
    assert rms(angle_difference(repaired["wind_direction_deg"], sound["wind_direction_deg"])) < 1e-6
    assert check_wind(repaired).findings == ()


def test_orders_are_held(sound: pd.DataFrame) -> None:
    spoilt = faults.order_interpolated(sound, dice())
    repaired = repair_table(spoilt.table, check_orders(spoilt.table).findings).table
    assert check_orders(repaired).findings == ()
    for name in spoilt.channels:
        assert rms(repaired[name] - sound[name]) <= rms(spoilt.table[name] - sound[name]) + 0.5


def test_flagged_values_become_gaps(sound: pd.DataFrame) -> None:
    spoilt = faults.out_of_range("surge_mps", 327.67)(sound, dice()).table
    spoilt = faults.spikes("sway_mps", 5.0)(spoilt, dice()).table
    flags = {"sway_mps": np.where(spoilt["sway_mps"] != sound["sway_mps"], 4, 1).astype(np.uint8)}
    findings = [stated(sound, "out_of_range", "surge_mps"), stated(sound, "spike", "sway_mps")]
    repaired = repair_table(spoilt, findings, flags)
    for name, count in (("surge_mps", 4), ("sway_mps", 5)):
        wrong = spoilt[name] != sound[name]
        assert wrong.sum() == count
        assert repaired.table.loc[wrong, name].isna().all()
        assert (repaired.table.loc[~wrong, name] == sound.loc[~wrong, name]).all()
    unflagged = repair_table(spoilt, findings)
    assert [each.code for each in unflagged.repairs] == ["out_of_range"]


def test_spikes_become_gaps_and_lines_through_north_do_not(sound: pd.DataFrame) -> None:
    spoilt = faults.heading_wrap_interpolated(0.9)(sound, dice()).table
    on_lines = np.asarray(check_heading_wrap(spoilt).flags["heading_deg"] == Quality.BAD)
    aside = np.abs(angle_difference(sound["heading_deg"], 0.0)) > 12.0
    spikes = np.flatnonzero(aside & ~on_lines)[[100, 200]]
    spoilt.loc[spoilt.index[spikes], "heading_deg"] += 90.0
    flags = check_heading_wrap(spoilt).flags
    flags.loc[flags.index[spikes], "heading_deg"] = Quality.BAD
    findings = (*check_heading_wrap(spoilt).findings, stated(spoilt, "spike", "heading_deg"))
    repaired = repair_table(spoilt, findings, flags)
    assert [each.code for each in repaired.repairs] == ["spike", "heading_wrap_interpolated"]
    assert np.flatnonzero(repaired.table["heading_deg"].isna()).tolist() == spikes.tolist()
    assert rms(angle_difference(repaired.table["heading_deg"], sound["heading_deg"])) < 1.0


def test_a_yaw_rate_is_scaled(sound: pd.DataFrame) -> None:
    spoilt = faults.yaw_rate_scale(1.036)(sound, dice())
    repaired = repair_table(
        spoilt.table, [stated(sound, spoilt.code, "yaw_rate_dps", factor=spoilt.truth["factor"])]
    ).table
    assert repaired["yaw_rate_dps"].to_numpy() == pytest.approx(sound["yaw_rate_dps"].to_numpy(), abs=1e-12)


def test_repeated_samples_become_gaps_and_keep_their_rows(sound: pd.DataFrame) -> None:
    spoilt = faults.duplicates(sound, dice()).table
    repaired = repair_table(spoilt, [stated(sound, "duplicate", "all")]).table
    assert len(repaired) == len(spoilt)
    assert (repaired.notna().sum() == len(sound)).all()


def test_what_is_uncertain_or_lacking_stays(sound: pd.DataFrame) -> None:
    doubtful = stated(sound, "speed_scale", "surge_mps", certain=False, factor=2.0)
    unknown = stated(sound, "heading_offset", "heading_deg", angle_deg=1.0)
    lacking = stated(sound, "position_time_jitter", "north_m")
    assert repair_table(sound, [doubtful, unknown]).table is sound
    assert repair_table(sound[["north_m", "east_m"]], [lacking]).repairs == ()
    assert (
        repair_table(sound.drop(columns="heading_deg"), [stated(sound, "out_of_range", "heading_deg")]).repairs
        == ()
    )


CHECKS: tuple[Callable[[pd.DataFrame], CheckResult], ...] = (check_heading_wrap, check_orders, check_wind)


@pytest.fixture(scope="module")
def written(sound: pd.DataFrame, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, RepairResult]:
    folder = tmp_path_factory.mktemp("repaired")
    spoilt = faults.heading_wrap_interpolated(0.9)(sound, dice()).table
    spoilt = faults.order_interpolated(faults.speed_scale(0.98)(spoilt, dice()).table, dice()).table
    original, target = folder / "original.mcap", folder / "repaired.mcap"
    write_table(spoilt, original, TRIAL, "test")
    recording, table = read_recording(original), read_table(original)
    findings = [finding for check in CHECKS for finding in check(table).findings]
    findings.append(stated(table, "speed_scale", "surge_mps", factor=1.0 / 0.98))
    flags = check_heading_wrap(table).flags
    return original, target, write_repaired(recording, table, findings, target, flags)


def test_a_repaired_recording_reads_as_it_was_repaired(written: tuple[Path, Path, RepairResult]) -> None:
    original, target, repaired = written
    again = read_table(target)
    pd.testing.assert_frame_equal(again, repaired.table, check_exact=True)
    assert history_of(again) == history_of(repaired.table)
    assert [step["options"]["code"] for step in history_of(again)] == [each.code for each in repaired.repairs]
    assert history_of(again)[0]["options"]["changed"] == repaired.repairs[0].changed
    assert again.attrs["trial"] == read_table(original).attrs["trial"]
    assert again.attrs["sources"]["surge_mps"] == ["test repaired"]
    assert again.attrs["sources"]["north_m"] == ["test"]
    mended = read_recording(target).series["heading_deg"].quality
    assert (mended == Quality.SUSPECT).sum() == repaired.repairs[0].changed


def test_after_the_repair_nothing_is_found_and_nothing_is_left_to_do(
    written: tuple[Path, Path, RepairResult], tmp_path: Path
) -> None:
    _, target, _ = written
    table = read_table(target)
    findings = [finding for check in CHECKS for finding in check(table).findings]
    assert findings == []
    again = write_repaired(read_recording(target), table, findings, tmp_path / "again.mcap")
    assert again.repairs == ()
    assert history_of(read_table(tmp_path / "again.mcap")) == history_of(table)


def test_the_original_is_never_touched(written: tuple[Path, Path, RepairResult], tmp_path: Path) -> None:
    original, _, _ = written
    before = original.read_bytes()
    recording, table = read_recording(original), read_table(original)
    (tmp_path / "link.mcap").symlink_to(original)
    (tmp_path / "hard.mcap").hardlink_to(original)
    for path_ in (original, original.parent / "." / original.name, tmp_path / "link.mcap", tmp_path / "hard.mcap"):
        with pytest.raises(InputError, match="is the recording itself"):
            write_repaired(recording, table, [], path_)
    assert original.read_bytes() == before


@pytest.mark.shared
def test_positions_of_2022_agree_with_the_speeds_afterwards(shared_data: Path, tmp_path: Path) -> None:
    name = "gunnerus_2022_trials"
    import_table(shared_data / name / TRIALS[name], tmp_path / "t.mcap", MAPS / f"{name}.toml")
    table = read_table(tmp_path / "t.mcap")
    findings = [finding for check in (check_heading_wrap, check_orders) for finding in check(table).findings]
    findings += [
        stated(table, "speed_scale", "surge_mps", factor=1.0203),
        stated(table, "position_time_jitter", "north_m"),
    ]
    repaired = repair_table(table, findings).table
    turned = np.abs(np.diff(unwrap(repaired["heading_deg"])))
    assert np.quantile(turned, 0.999) < 4.0
    usual = []
    for each in (table, repaired):
        psi = np.deg2rad(wrap_360(repaired["heading_deg"]))
        way = np.cumsum(0.5 * (each["surge_mps"] + 1j * each["sway_mps"]).to_numpy() * np.exp(1j * psi))
        off = (each["north_m"] + 1j * each["east_m"]).to_numpy() - way
        usual.append(np.quantile(np.abs(off[20:] - off[:-20]), 0.95))
    assert usual[1] < 0.1 * usual[0]
    assert set(NAMES) <= set(repaired.columns)


OTHER_TURNS = {
    "heading_deg": lambda angle: np.where(angle > 180.0, angle - 360.0, angle),
    "port_angle_deg": lambda angle: np.where(angle < 0.0, angle + 360.0, angle),
}


@pytest.fixture(scope="module")
def turning(sound: pd.DataFrame) -> pd.DataFrame:
    """The trial with both azimuths and headings going all round, recorded."""
    away = np.linspace(0.0, 900.0, len(sound)) + 0.2 * dice().standard_normal(len(sound))
    return sound.assign(heading_deg=away % 360.0, port_angle_deg=180.0 - away % 360.0)


@pytest.mark.parametrize("name", sorted(OTHER_TURNS))
def test_angles_of_the_other_convention_are_named_and_turned(
    turning: pd.DataFrame, tmp_path: Path, name: str
) -> None:
    path = tmp_path / "other.mcap"
    other = turning.assign(**{name: OTHER_TURNS[name](turning[name].to_numpy())})
    count = int((other[name] != turning[name]).sum())
    quality_flags = {name: np.where(other[name] != turning[name], 4, 2).astype(np.uint8)}  # as an import flags them
    write_table(other, path, Trial(), qualities=quality_flags)
    recording = read_recording(path)
    quality = check_recording(recording)
    said = next(each for each in quality.findings if each.code == "out_of_range")
    assert f"otherwise than {'-180..180' if BY_NAME[name].low < 0.0 else '0..360'}" in said.text
    assert said.estimate["count"] == count
    write_repaired(recording, table_of(recording), quality.findings, tmp_path / "mended.mcap", quality.flags)
    mended = read_table(tmp_path / "mended.mcap")
    assert np.abs(angle_difference(mended[name], turning[name])).max() < 1e-9
    assert np.isfinite(mended[name]).all()


@pytest.mark.parametrize("values", [[10.0, 20.0, -99.0, 30.0, -99.0], [200.0, -1.0, -2.0, -3.0], [5.0, 370.0]])
def test_codes_for_no_value_are_no_convention(values: list[float]) -> None:
    """One value again and again, angles of both conventions, or more than either has."""
    assert not is_off_by_whole_turns(BY_NAME["heading_deg"], np.array(values))


def test_impossible_values_that_the_reader_left_out_are_counted_as_repaired(
    sound: pd.DataFrame, tmp_path: Path
) -> None:
    flags = np.full(len(sound), 2, dtype=np.uint8)
    flags[100:106] = 4
    surge = sound["surge_mps"].to_numpy(copy=True)
    surge[100:106] = 9999.0
    write_table(sound.assign(surge_mps=surge), tmp_path / "a.mcap", Trial(), qualities={"surge_mps": flags})
    recording = read_recording(tmp_path / "a.mcap")
    quality = check_recording(recording)
    assert "6 samples" in next(each for each in quality.findings if each.code == "out_of_range").text
    done = write_repaired(recording, table_of(recording), quality.findings, tmp_path / "b.mcap", quality.flags)
    assert [(each.code, each.changed) for each in done.repairs] == [("out_of_range", 6)]
    assert np.abs(read_recording(tmp_path / "b.mcap").series["surge_mps"].value).max() < 30.0
    assert "repair" in [step["step"] for step in history_of(read_table(tmp_path / "b.mcap"))]


@pytest.mark.parametrize("sign", [-1.0, *nightly(1.0)])
def test_a_yaw_rate_in_degrees_per_minute_beyond_its_limits_is_scaled_and_not_emptied(
    tmp_path: Path, sign: float
) -> None:
    table = simulate_trial("gunnerus_long", "gentle", "zigzag_20_20", 900.0, 2.0, seed=1)[0]
    per_minute = table.assign(yaw_rate_dps=sign * 60.0 * table["yaw_rate_dps"])
    assert (per_minute["yaw_rate_dps"].abs() > 60.0).mean() > 0.05
    path = tmp_path / "per_minute.mcap"
    write_table(per_minute, path, Trial("trial", "ship"))
    recording = read_recording(path)
    quality = check_recording(recording)
    assert [each.code for each in quality.findings] == ["yaw_rate_scale"]
    repaired = write_repaired(
        recording, table_of(recording), quality.findings, tmp_path / "mended.mcap", quality.flags
    )
    np.testing.assert_allclose(repaired.table["yaw_rate_dps"], table["yaw_rate_dps"], rtol=1e-9)
    assert check_recording(read_recording(tmp_path / "mended.mcap")).findings == ()


def test_a_yaw_rate_with_impossible_values_and_no_other_unit_loses_them(tmp_path: Path) -> None:
    table = simulate_trial("gunnerus_long", "gentle", "zigzag_20_20", 900.0, 2.0, seed=1)[0]
    wild = table["yaw_rate_dps"].where(np.arange(len(table)) % 20 > 0, 1800.0)
    write_table(table.assign(yaw_rate_dps=wild), tmp_path / "wild.mcap", Trial("trial", "ship"))
    recording = read_recording(tmp_path / "wild.mcap")
    quality = check_recording(recording)
    assert "out_of_range" in {each.code for each in quality.findings}
    assert repair_table(table_of(recording), quality.findings, quality.flags, recording).table[
        "yaw_rate_dps"
    ].isna().sum() == np.count_nonzero(wild == 1800.0)
