"""Headings whose stamps jitter: found, sized, mended by the yaw rate where it can; nothing else is taken for it."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray

from seatrial.acquisition.core.ship import angle_difference, wrap_360
from seatrial.analysis.quality.findings import Finding
from seatrial.analysis.quality.motion.findings import check_motion
from seatrial.analysis.quality.motion.positions import reconstruct_heading
from seatrial.analysis.quality.repairs import repair_table
from tests.analysis.quality import faults
from tests.analysis.quality.faults import Fault
from tests.analysis.quality.motion.kinematic_trials import Faults, Noise, sailed
from tests.conftest import nightly

CODE = "heading_time_jitter"
QUIET = Noise(heading_deg=0.02)
PLACES = ["north_m", "east_m"]


@pytest.fixture(scope="module")
def sound() -> pd.DataFrame:
    return sailed(noise=QUIET)


def dice() -> np.random.Generator:
    return np.random.default_rng(5)


def codes(table: pd.DataFrame) -> list[str]:
    return [each.code for each in check_motion(table).findings]


def stated(table: pd.DataFrame, code: str = CODE, channel: str = "heading_deg") -> Finding:
    return Finding(code, channel, table.index[0], table.index[-1], code, certain=True)


def off_deg(table: pd.DataFrame, truth: pd.DataFrame) -> NDArray[np.float64]:
    return np.asarray(angle_difference(table["heading_deg"].to_numpy(), truth["heading_deg"].to_numpy()))


def error_in_turns_deg(table: pd.DataFrame, truth: pd.DataFrame) -> float:
    """Root mean square of what the heading is off where the ship turns by a degree a second and more."""
    turning = truth["yaw_rate_dps"].abs().to_numpy() > 1.0
    return float(np.sqrt(np.mean(off_deg(table, truth)[turning] ** 2)))


@pytest.mark.parametrize(("seconds", "block_s"), [(0.2, 0.0), (0.6, 5.0), *nightly((0.6, 0.0))])
@pytest.mark.parametrize("heading_deg", [0.0, *nightly(180.0)])
def test_jitter_is_found_and_sized(seconds: float, block_s: float, heading_deg: float) -> None:
    jittering = faults.heading_time_jitter(seconds, block_s)(sailed(heading_deg=heading_deg), dice()).table
    (finding,) = check_motion(jittering).findings
    assert (finding.code, finding.channel, finding.certain) == (CODE, "heading_deg", False)
    low, size, high = (finding.estimate[key] for key in ("low", "seconds", "high"))
    assert low <= size <= high
    assert abs(size - seconds) <= high - low
    assert size == pytest.approx(seconds, rel=0.4)


def changing_scale(table: pd.DataFrame, _: np.random.Generator) -> faults.Spoilt:
    """A yaw rate that reads 3 % too much at first and 3 % too little in the end."""
    scale = np.linspace(1.03, 0.97, len(table))
    return faults.Spoilt(table.assign(yaw_rate_dps=table["yaw_rate_dps"] * scale), "", ())


@pytest.mark.parametrize(
    "fault",
    [
        faults.channel_delay("heading", 0.7), faults.quantised("heading_deg", 1.0), changing_scale,
        faults.heading_wrap_interpolated(1.3),
        *nightly(
            faults.yaw_rate_scale(1.036), faults.channel_delay("yaw_rate", 0.7),
            faults.quantised("yaw_rate_dps", 0.1), faults.position_time_jitter(0.6, 5.0),
        ),
    ],
)  # fmt: skip
def test_other_faults_are_not_taken_for_jitter(sound: pd.DataFrame, fault: Fault) -> None:
    assert CODE not in codes(fault(sound, dice()).table)


@pytest.mark.parametrize("noise", [Noise(heading_deg=1.0), Noise(yaw_rate_dps=1.0)])
def test_noise_is_not_taken_for_jitter(noise: Noise) -> None:
    assert CODE not in codes(sailed(noise=noise))


@pytest.mark.parametrize(("seconds", "block_s"), [(0.3, 0.0), (0.6, 5.0)])
@pytest.mark.parametrize("heading_deg", [0.0, *nightly(180.0)])
def test_turns_get_their_shape_back(seconds: float, block_s: float, heading_deg: float) -> None:
    truth = sailed(noise=QUIET, heading_deg=heading_deg)
    jittering = faults.heading_time_jitter(seconds, block_s)(truth, dice()).table
    rebuilt = repair_table(jittering, [stated(jittering)]).table
    assert error_in_turns_deg(rebuilt, truth) < 0.5 * error_in_turns_deg(jittering, truth)
    assert rebuilt["heading_deg"].between(0.0, 360.0, inclusive="left").all()
    assert CODE not in codes(rebuilt)


def test_scale_bias_and_delay_of_the_yaw_rate_do_not_enter_the_heading(sound: pd.DataFrame) -> None:
    off = sailed(Faults(yaw_rate=1.05, yaw_rate_bias_dps=0.2, late_s={"yaw_rate_dps": 0.5}), noise=QUIET)
    jittering = faults.heading_time_jitter(0.6)(off, dice()).table
    rebuilt = repair_table(jittering, [stated(jittering)]).table
    assert error_in_turns_deg(rebuilt, sound) < 0.5 * error_in_turns_deg(jittering, sound)


def test_positions_take_the_mended_turns(sound: pd.DataFrame) -> None:
    """Over 15 s, as windows are judged, the rebuilt path is nearer to the truth with the mended heading."""
    rough = faults.heading_time_jitter(0.6, 5.0)(
        faults.position_time_jitter(0.6)(sound, dice()).table, dice()
    ).table
    findings = check_motion(rough).findings
    assert {CODE, "position_time_jitter"} <= {each.code for each in findings}
    mended = repair_table(rough, findings, rebuild_positions=True)
    assert [each.code for each in mended.repairs] == [CODE, "position_time_jitter"]
    without = repair_table(rough, [stated(rough, "position_time_jitter", "north_m")])
    off_m = [
        np.hypot(*(each.table[PLACES].diff(30) - sound[PLACES].diff(30)).to_numpy()[30:].T)
        for each in (mended, without)
    ]
    assert np.sqrt(np.mean(off_m[0] ** 2)) < 0.9 * np.sqrt(np.mean(off_m[1] ** 2))


def test_a_sound_heading_stays_as_it_is(sound: pd.DataFrame) -> None:
    jittering = faults.position_time_jitter(0.6)(sound, dice()).table
    mended = repair_table(jittering, check_motion(jittering).findings, rebuild_positions=True)
    assert [each.code for each in mended.repairs] == ["position_time_jitter"]
    assert mended.table["heading_deg"].equals(sound["heading_deg"])


def test_repair_without_the_order_leaves_jitter_alone(sound: pd.DataFrame) -> None:
    jittering = faults.heading_time_jitter(0.6)(sound, dice()).table
    assert CODE not in [each.code for each in repair_table(jittering, check_motion(jittering).findings).repairs]


def test_each_side_of_a_splice_keeps_its_heading(sound: pd.DataFrame) -> None:
    half = len(sound) // 2
    turned = sound["heading_deg"].where(np.arange(len(sound)) < half, wrap_360(sound["heading_deg"] + 40.0))
    spliced = sound.assign(heading_deg=turned)
    jittering = faults.heading_time_jitter(0.3)(sound, dice()).table
    rough = jittering.assign(
        heading_deg=wrap_360(jittering["heading_deg"] + 40.0 * (np.arange(len(sound)) >= half))
    )
    rebuilt = repair_table(rough, [stated(rough)]).table
    near = slice(half - 10, half + 10)
    assert np.abs(off_deg(rebuilt, spliced)[near]).max() < 2.0
    assert error_in_turns_deg(rebuilt, spliced) < 0.6 * error_in_turns_deg(rough, spliced)


def test_gaps_stay_gaps_and_a_hole_in_the_yaw_rate_does_no_harm(sound: pd.DataFrame) -> None:
    jittering = faults.heading_time_jitter(0.3)(sound, dice()).table
    jittering.loc[jittering.index[300:340], "yaw_rate_dps"] = np.nan
    jittering.loc[jittering.index[900:905], "heading_deg"] = np.nan
    rebuilt = repair_table(jittering, [stated(jittering)]).table
    assert rebuilt["heading_deg"].isna().equals(jittering["heading_deg"].isna())
    assert off_deg(rebuilt, jittering)[300:340] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("noise_dps", [4.0, None])
def test_a_yaw_rate_that_cannot_help_is_said_to(sound: pd.DataFrame, noise_dps: float | None) -> None:
    jittering = faults.heading_time_jitter(0.2)(sound, dice()).table
    if noise_dps is None:
        poor = jittering.drop(columns="yaw_rate_dps")
    else:
        poor = jittering.assign(
            yaw_rate_dps=jittering["yaw_rate_dps"] + dice().normal(0.0, noise_dps, len(jittering))
        )
    assert reconstruct_heading(poor) is None
    (left,) = repair_table(poor, [stated(poor)]).repairs
    assert left.changed == 0
    assert "left as it is" in left.text
