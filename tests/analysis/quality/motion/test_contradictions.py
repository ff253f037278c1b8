"""Motion channels that are grossly wrong are found for what they are, and nothing false is certain."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from seatrial.acquisition.core.trial import Quality
from seatrial.analysis.quality.findings import CheckResult, Finding
from seatrial.analysis.quality.motion.findings import check_motion, delays_in_findings
from seatrial.analysis.quality.motion.model import GROUPS, fit_coarsely
from seatrial.analysis.quality.repairs import repair_table
from seatrial.hybrid.simulation.trial import simulate_trial
from tests.analysis.quality.motion.kinematic_trials import Faults, Noise, sailed
from tests.conftest import nightly

MAPS = Path(__file__).parents[4] / "trials" / "columns"
KNOT = 1852.0 / 3600.0


@pytest.fixture(scope="module")
def sound() -> pd.DataFrame:
    return sailed(duration_s=900.0)


def only(checked: CheckResult, code: str) -> Finding:
    assert [each.code for each in checked.findings] == [code]
    return checked.findings[0]


def scaled(table: pd.DataFrame, **factors: float) -> pd.DataFrame:
    return table.assign(**{name: table[name] * factor for name, factor in factors.items()})


@pytest.mark.parametrize("angle", [-179.0, *nightly(90.0, 60.0, 180.0, -90.0)])
def test_a_heading_however_far_off_is_found_and_nothing_else(sound: pd.DataFrame, angle: float) -> None:
    table = sound.assign(heading_deg=(sound["heading_deg"] + angle) % 360.0)
    finding = only(check_motion(table), "heading_offset")
    apart = (finding.estimate["angle_deg"] - angle + 180.0) % 360.0 - 180.0
    assert abs(apart) < 0.1
    assert not finding.certain


@pytest.mark.parametrize(
    ("factor", "words", "certain"),
    [
        (1.0 / KNOT, "knots", True), (-1.0, "wrong way", False),
        *nightly((3.6, "km/h", True), (KNOT, "knots", True), (2.5, "", True), (1.0 / 5.0, "", False)),
    ],
)  # fmt: skip
def test_speeds_in_another_unit_are_found_with_the_right_factor(
    sound: pd.DataFrame, factor: float, words: str, certain: bool
) -> None:
    finding = only(check_motion(scaled(sound, surge_mps=factor, sway_mps=factor)), "speed_scale")
    unit = certain and bool(words)  # which is exact; an estimate would leave its own error in what is repaired
    assert finding.estimate["factor"] == pytest.approx(1.0 / factor, rel=1e-12 if unit else 0.003)
    assert finding.estimate["low"] <= 1.0 / factor <= finding.estimate["high"]
    assert words in finding.text
    assert finding.certain == certain


@pytest.mark.parametrize("channel", ["surge_mps", "sway_mps"])
@pytest.mark.parametrize(("unit", "factor"), [("knots", 1.0 / KNOT), ("km/h", 3.6)])
def test_one_speed_in_another_unit_than_the_other_is_named_and_neither_is_scaled(
    channel: str, unit: str, factor: float
) -> None:
    """Sway in turns looks much like a lever arm, so that one factor for both would pass."""
    table = scaled(simulate_trial("gunnerus_long", "gentle", "programme", 1200.0, 1.0, 3)[0], **{channel: factor})
    finding = only(check_motion(table), "motion_contradiction")
    assert finding.channel == channel
    assert f"{channel.removesuffix('_mps')} alone is in {unit}" in finding.text
    assert not finding.certain


@pytest.mark.parametrize(("channel", "factor"), [
    ("sway_mps", 0.6), *nightly(("surge_mps", 0.5), ("sway_mps", 0.2), ("sway_mps", KNOT), ("sway_mps", 1.5)),
])  # fmt: skip
def test_no_unit_is_named_of_the_channel_that_is_sound(channel: str, factor: float) -> None:
    """A sway that is half of what it should be makes surge look as if it were in knots, but for the whole way."""
    table = scaled(simulate_trial("gunnerus_long", "gentle", "programme", 1200.0, 1.0, 3)[0], **{channel: factor})
    assert not [each for each in check_motion(table).findings if "alone" in each.text]


def test_positions_in_feet_are_not_the_speeds_to_mend(sound: pd.DataFrame) -> None:
    finding = only(check_motion(scaled(sound, north_m=1.0 / 0.3048, east_m=1.0 / 0.3048)), "speed_scale")
    assert finding.estimate["factor"] == pytest.approx(1.0 / 0.3048, rel=0.003)
    assert "positions were in feet" in finding.text
    assert not finding.certain


@pytest.mark.parametrize(
    ("factor", "words"), [(60.0, "deg/min"), (-1.0, "port"), *nightly((np.pi / 180.0, "rad/s"))]
)
def test_a_yaw_rate_in_another_unit_or_sign_is_found(sound: pd.DataFrame, factor: float, words: str) -> None:
    table = scaled(sound, yaw_rate_dps=factor)
    finding = only(check_motion(table), "yaw_rate_scale")
    assert finding.estimate["factor"] == pytest.approx(1.0 / factor, rel=0.005)
    assert words in finding.text
    assert finding.certain
    mended = repair_table(table, [finding]).table
    assert check_motion(mended).findings == ()


@pytest.mark.parametrize(
    ("columns", "channel", "words"),
    [
        ({"north_m": ("north_m", -1.0)}, "north_m", "north counts to the south"),
        ({"east_m": ("east_m", -1.0)}, "east_m", "east counts to the west"),
        ({"north_m": ("east_m", 1.0), "east_m": ("north_m", 1.0)}, "north_m", "north and east are exchanged"),
        ({"sway_mps": ("sway_mps", -1.0)}, "sway_mps", "sway counts to port"),
        ({"surge_mps": ("surge_mps", -1.0)}, "surge_mps", "surge counts astern"),
        ({"surge_mps": ("sway_mps", 1.0), "sway_mps": ("surge_mps", 1.0)}, "surge_mps", "are exchanged"),
        ({"heading_deg": ("heading_deg", np.pi / 180.0)}, "heading_deg", "radians"),
    ],
)
def test_wrong_signs_and_axes_are_named_and_nothing_else_is_said(
    sound: pd.DataFrame, columns: dict[str, tuple[str, float]], channel: str, words: str
) -> None:
    checked = check_motion(sound.assign(**{name: sound[of] * by for name, (of, by) in columns.items()}))
    finding = only(checked, "motion_contradiction")
    assert finding.channel == channel
    assert words in finding.text
    assert not finding.certain
    group = next(names for names in GROUPS.values() if channel in names)
    assert (checked.flags[list(group)] == Quality.SUSPECT).all(axis=None)


def test_channels_of_another_ship_tell_of_no_one_motion(sound: pd.DataFrame) -> None:
    other = sailed(duration_s=900.0, seed=5, turning=2.5)
    finding = only(
        check_motion(sound.assign(north_m=other["north_m"], east_m=other["east_m"])), "motion_contradiction"
    )
    assert finding.estimate["left"] > 0.2
    assert not finding.certain


@pytest.mark.parametrize("noise", [Noise(0.0, 0.0, 0.0, 0.0), Noise(3.0, 1.0, 0.3, 0.5)])
@pytest.mark.parametrize("turning", [0.0, 1.0])
def test_nothing_contradicts_in_a_sound_trial_however_noisy(noise: Noise, turning: float) -> None:
    for faults in (Faults(), Faults(forward_m=40.0), Faults(jitter_s=1.0, late_s={"heading_deg": 2.0})):
        coarse = fit_coarsely(sailed(faults, duration_s=600.0, noise=noise, turning=turning))
        assert not coarse.contradiction
        assert coarse.is_neutral


@pytest.mark.parametrize("noise", [Noise(position_m=1.0), *nightly(Noise())])
def test_positions_that_jump_and_return_are_found_and_flagged(noise: Noise) -> None:
    table = sailed(duration_s=900.0, noise=noise)
    table.iloc[1000:1031, 0] += 30.0
    table.iloc[1000:1031, 1] -= 40.0
    checked = check_motion(table)
    finding = only(checked, "position_jump")
    assert finding.estimate["metres"] == pytest.approx(50.0, abs=3.0)
    assert finding.estimate["north_m"] == pytest.approx(30.0, abs=3.0)
    assert (finding.start, finding.end) == (table.index[1000], table.index[1031])
    bad = (checked.flags["north_m"] == Quality.BAD).to_numpy()
    assert np.array_equal(np.flatnonzero(bad), np.arange(1000, 1031))
    assert (checked.flags["heading_deg"] == Quality.GOOD).all()


def test_positions_that_jump_for_good_displace_no_one(sound: pd.DataFrame) -> None:
    table = sound.copy()
    table.iloc[700:, 0] += 100.0
    checked = check_motion(table)
    finding = only(checked, "position_jump")
    assert finding.start == finding.end == table.index[700]
    assert "do not return" in finding.text
    assert not (checked.flags["north_m"] == Quality.BAD).any()


def test_positions_that_stand_or_jitter_do_not_jump(sound: pd.DataFrame) -> None:
    stuck = sound.copy()
    stuck.iloc[1000:1060, 1] = float(stuck["east_m"].iloc[1000])
    jittering = sailed(Faults(jitter_s=1.0, jitter_lasts_s=8.0), duration_s=900.0)
    for table in (stuck, jittering):
        assert "position_jump" not in {each.code for each in check_motion(table).findings}


def test_a_factor_that_changes_half_way_is_not_certain() -> None:
    table = sailed()
    second = np.arange(len(table)) >= len(table) // 2
    for name in ("surge_mps", "sway_mps"):
        table[name] *= np.where(second, 0.94, 0.98)
    finding = next(each for each in check_motion(table).findings if each.code == "speed_scale")
    assert not finding.certain
    assert "not the same throughout" in finding.text
    assert finding.estimate["low"] < 1.0 / 0.98 < 1.0 / 0.94 < finding.estimate["high"]


def test_all_samples_of_a_channel_that_is_condemned_are_suspect() -> None:
    flags = check_motion(sailed(Faults(speed=0.98), duration_s=900.0)).flags
    assert (flags[["surge_mps", "sway_mps"]] == Quality.SUSPECT).all(axis=None)
    assert (flags[["north_m", "heading_deg", "yaw_rate_dps"]] == Quality.GOOD).all(axis=None)


def test_what_the_receiver_stamps_is_late_with_the_positions() -> None:
    late = Finding("channel_delay", "north_m", pd.Timestamp(0), pd.Timestamp(1), "", estimate={"seconds": 0.5})
    names = ["north_m", "latitude_deg", "longitude_deg", "speed_over_ground_mps", "roll_deg"]
    table = pd.DataFrame(columns=names, dtype=float)
    geographic = {"north_m", "east_m", "latitude_deg", "longitude_deg"}
    assert delays_in_findings([late], table).keys() == geographic
    table.attrs["sources"] = {"north_m": ("gps",), "speed_over_ground_mps": ("gps",), "surge_mps": ("log",)}
    assert delays_in_findings([late], table).keys() == geographic | {"speed_over_ground_mps"}
    assert set(delays_in_findings([late], table).values()) == {0.5}


def test_an_arm_that_was_not_fitted_is_not_printed() -> None:
    finding = only(check_motion(sailed(Faults(forward_m=6.0))), "position_offset")
    assert "forward" in finding.text
    assert "starboard" not in finding.text


@pytest.mark.shared
def test_real_recordings_that_change_say_so(findings_of_2022: tuple[Finding, ...]) -> None:
    found = {finding.code: finding for finding in findings_of_2022}
    jumps = [each for each in findings_of_2022 if each.code == "position_jump"]
    assert [each.estimate["metres"] for each in jumps] == pytest.approx([340.0, 255.0], abs=10.0)
    assert found["speed_scale"].certain
    assert not found["yaw_rate_scale"].certain
    assert found["yaw_rate_scale"].estimate["high"] - found["yaw_rate_scale"].estimate["low"] > 0.1


METRES = dict.fromkeys(("north_m", "east_m", "surge_mps", "sway_mps"), 0.1)
"""A tenth of all lengths in the same time: a model that makes 0.4 m/s."""


def test_a_models_jump_of_a_ships_breadth_is_found(sound: pd.DataFrame) -> None:
    model = scaled(sound, **METRES)
    assert check_motion(model).findings == ()
    jumped = model["north_m"] + np.where(np.arange(len(model)) > len(model) / 2, 0.8, 0.0)
    finding = only(check_motion(model.assign(north_m=jumped)), "position_jump")
    assert finding.estimate["metres"] == pytest.approx(0.8, abs=0.05)


def test_a_models_channels_of_different_motions_are_found(sound: pd.DataFrame) -> None:
    elsewhere = sailed(duration_s=900.0, seed=7, heading_deg=120.0)
    mixed = scaled(sound, **METRES).assign(
        **{name: 0.1 * elsewhere[name].to_numpy() for name in ("north_m", "east_m")}
    )
    assert "motion_contradiction" in {each.code for each in check_motion(mixed).findings}
