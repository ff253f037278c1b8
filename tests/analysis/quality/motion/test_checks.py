"""What the motion channels are said to have wrong: each fault by its code and size; nothing on sound trials."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from seatrial.acquisition.core.quantities import integrate, to_earth
from seatrial.acquisition.core.trial import Quality
from seatrial.acquisition.tables.import_table import import_table
from seatrial.analysis.quality.findings import CheckResult, Finding
from seatrial.analysis.quality.motion.findings import check_motion, delays_in_findings
from seatrial.analysis.quality.motion.model import MOTION
from seatrial.analysis.tables.table import read_table
from seatrial.hybrid.simulation.trial import SimulationNoise as SensorNoise
from seatrial.hybrid.simulation.trial import simulate_trial
from tests.analysis.quality.motion.kinematic_trials import Faults, Noise, sailed
from tests.conftest import nightly

MAPS = Path(__file__).parents[4] / "trials" / "columns"


def only(checked: CheckResult, code: str, channel: str) -> Finding:
    """The finding that is expected to be the only one."""
    assert [(each.code, each.channel) for each in checked.findings] == [(code, channel)]
    return checked.findings[0]


def near(finding: Finding, key: str, truth: float) -> bool:
    """Whether the estimate is within twice its own interval, which itself lies about it."""
    low, size, high = finding.estimate["low"], finding.estimate[key], finding.estimate["high"]
    assert low <= size <= high
    return abs(size - truth) <= high - low


LITTLE, MUCH = Noise(0.01, 0.02, 0.005, 0.01), Noise(0.5, 0.3, 0.1, 0.2)


@pytest.mark.parametrize(
    ("noise", "turning", "speed_changes", "heading"),
    [
        (LITTLE, 1.0, 1.0, 0.0), (Noise(), 0.0, 0.0, 359.9), (MUCH, 0.3, 1.0, 180.0),
        *nightly(
            (LITTLE, 0.0, 0.0, 359.9), (LITTLE, 0.3, 1.0, 180.0), (Noise(), 1.0, 1.0, 0.0),
            (Noise(), 0.3, 1.0, 180.0), (MUCH, 1.0, 1.0, 0.0), (MUCH, 0.0, 0.0, 359.9),
        ),
    ],
)  # fmt: skip
def test_nothing_is_said_of_a_sound_trial(
    noise: Noise, turning: float, speed_changes: float, heading: float
) -> None:
    table = sailed(noise=noise, turning=turning, speed_changes=speed_changes, heading_deg=heading)
    assert check_motion(table).findings == ()


@pytest.mark.parametrize("factor", [0.98, 1.0289, *nightly(0.9, 1.01)])
def test_a_wrong_knot_is_found_and_certain(factor: float) -> None:
    finding = only(check_motion(sailed(Faults(speed=factor))), "speed_scale", "surge_mps")
    assert near(finding, "factor", 1.0 / factor)
    assert finding.certain


@pytest.mark.parametrize("angle", [0.5, 30.0, *nightly(-2.0)])
@pytest.mark.parametrize("heading", [0.0, *nightly(180.0)])
def test_a_compass_that_is_off_is_found(angle: float, heading: float) -> None:
    finding = only(
        check_motion(sailed(Faults(heading_deg=angle), heading_deg=heading)), "heading_offset", "heading_deg"
    )
    assert near(finding, "angle_deg", angle)


def test_scale_and_bias_of_the_yaw_rate_are_found() -> None:
    scale = only(check_motion(sailed(Faults(yaw_rate=1.036))), "yaw_rate_scale", "yaw_rate_dps")
    bias = only(check_motion(sailed(Faults(yaw_rate_bias_dps=-0.05))), "yaw_rate_bias", "yaw_rate_dps")
    assert near(scale, "factor", 1.0 / 1.036)
    assert near(bias, "bias_dps", -0.05)


@pytest.mark.parametrize("channel", ["north_m", "yaw_rate_dps", *nightly("heading_deg", "surge_mps")])
@pytest.mark.parametrize("seconds", [0.3, *nightly(1.5)])
def test_the_late_channel_is_the_one_that_is_named(channel: str, seconds: float) -> None:
    finding = only(check_motion(sailed(Faults(late_s={channel: seconds}))), "channel_delay", channel)
    assert near(finding, "seconds", seconds)


@pytest.mark.parametrize(("seconds", "direction"), [(-0.9, "early"), *nightly((0.9, "late"))])
def test_a_delay_is_told_in_the_direction_of_its_interval(seconds: float, direction: str) -> None:
    """Too early by 0.9 s is too early by 0.8 to 1.0 s, not by -1.0 to -0.8 s."""
    finding = only(check_motion(sailed(Faults(late_s={"north_m": seconds}))), "channel_delay", "north_m")
    told = re.search(r"stamped ([\d.]+) s too (\w+) \(95 % (\S+) to (\S+) s\)", finding.text)
    assert told is not None
    assert told[2] == direction
    assert float(told[3]) <= float(told[1]) <= float(told[4])


def test_delays_by_channel_are_for_both_of_a_pair() -> None:
    found = check_motion(sailed(Faults(late_s={"north_m": 0.5}))).findings
    late = delays_in_findings(found)
    assert late.keys() == {"north_m", "east_m"}
    assert late["north_m"] == late["east_m"] == pytest.approx(0.5, abs=0.1)
    assert delays_in_findings(()) == {}


@pytest.mark.parametrize(("seconds", "lasts"), [(0.3, 0.0), (0.5, 8.0), *nightly((1.0, 0.0))])
def test_stamps_that_jitter_are_found_and_sized(seconds: float, lasts: float) -> None:
    finding = only(
        check_motion(sailed(Faults(jitter_s=seconds, jitter_lasts_s=lasts))), "position_time_jitter", "north_m"
    )
    assert near(finding, "seconds", seconds)


def test_noisy_positions_do_not_jitter() -> None:
    assert check_motion(sailed(noise=Noise(position_m=3.0))).findings == ()


def test_a_lever_arm_is_told_from_a_delay() -> None:
    finding = only(check_motion(sailed(Faults(forward_m=6.0, starboard_m=2.0))), "position_offset", "north_m")
    assert near(finding, "forward_m", 6.0)
    assert finding.estimate["starboard_m"] == pytest.approx(2.0, abs=0.2)


def test_several_faults_are_told_apart() -> None:
    faults = Faults(speed=0.98, heading_deg=2.0, late_s={"north_m": 1.0}, yaw_rate_bias_dps=0.1)
    sizes = {each.code: each for each in check_motion(sailed(faults)).findings}
    assert sizes.keys() == {"speed_scale", "heading_offset", "channel_delay", "yaw_rate_bias"}
    assert near(sizes["speed_scale"], "factor", 1.0 / 0.98)
    assert near(sizes["heading_offset"], "angle_deg", 2.0)
    assert near(sizes["channel_delay"], "seconds", 1.0)


def test_samples_are_flagged_and_none_is_dropped() -> None:
    table = sailed(duration_s=600.0)
    table.iloc[5, 0] = np.nan
    flags = check_motion(table).flags
    assert list(flags.columns) == list(MOTION)
    assert flags.index.equals(table.index)
    assert np.all(flags.dtypes == np.uint8)
    assert flags["north_m"].iloc[5] == Quality.MISSING
    assert (flags.to_numpy() == Quality.GOOD).sum() == flags.size - 1


def test_what_cannot_be_judged_is_not() -> None:
    short, without = sailed(duration_s=60.0), sailed(duration_s=300.0).drop(columns="heading_deg")
    for table in (short, without):
        checked = check_motion(table)
        assert checked.findings == ()
        assert np.all(checked.flags == Quality.NOT_EVALUATED)
    assert check_motion(pd.DataFrame(index=short.index)).findings == ()


def test_texts_are_one_line_with_what_to_do() -> None:
    faults = Faults(speed=0.9, heading_deg=5.0, late_s={"north_m": 1.0}, yaw_rate=1.1, yaw_rate_bias_dps=0.3)
    for finding in check_motion(sailed(faults)).findings:
        assert finding.text
        assert finding.remedy
        assert "\n" not in finding.as_json()["text"]


def test_a_simulated_ship_in_waves_is_sound_until_she_is_not() -> None:
    hidden = {"speed_scale": {"factor": 0.98}, "position_delay": {"seconds": 0.6}}
    for faults, codes in (({}, []), (hidden, ["speed_scale", "channel_delay"])):
        table, _ = simulate_trial("gunnerus_long", "moderate", "voyage", 900.0, 2.0, 3, faults, noise=SensorNoise())
        assert [each.code for each in check_motion(table).findings] == codes


@pytest.mark.shared
def test_trials_of_2022_read_two_percent_low_and_jitter(findings_of_2022: tuple[Finding, ...]) -> None:
    found = {finding.code: finding for finding in findings_of_2022}
    assert found["speed_scale"].estimate["factor"] == pytest.approx(1.020, abs=0.002)
    assert found["speed_scale"].certain
    assert 0.3 < found["position_time_jitter"].estimate["seconds"] < 2.0
    assert 0.2 < found["heading_time_jitter"].estimate["seconds"] < 2.0
    assert found["yaw_rate_scale"].estimate["factor"] == pytest.approx(1.0 / 1.036, abs=0.01)


@pytest.mark.slow
@pytest.mark.shared
def test_the_docking_of_2019_does_not_jitter(shared_data: Path, tmp_path: Path) -> None:
    name, file = "gunnerus_2019_docking", "docking_2019-11-09_part1.csv"
    import_table(shared_data / name / file, tmp_path / "docking.mcap", MAPS / f"{name}.toml")
    found = {each.code for each in check_motion(read_table(tmp_path / "docking.mcap")).findings}
    assert not found & {"position_time_jitter", "heading_time_jitter"}


def test_quarters_too_short_to_tell_of_heel_are_no_crash() -> None:
    """Five blocks of three cosines determine eight parameters so well that no noise is left."""
    table = sailed(Faults(late_s={"north_m": -1.0}), 900.0, 1.0, 1, speed_changes=0.0, turning=0.5)
    assert "channel_delay" in {each.code for each in check_motion(table).findings}


@pytest.mark.parametrize("turn_dps", [0.3, *nightly(0.0)])
def test_speeds_that_keep_two_values_are_no_copies_of_a_slower_source(turn_dps: float) -> None:
    """A table by a program: constant speeds ahead, others in the turn, and a compass that is 160 deg off."""
    t = np.arange(600.0)
    rate = np.where(t < 300.0, 0.0, turn_dps)
    heading, turning = 80.0 + integrate(rate, t), rate > 0.0
    surge, sway = np.where(turning, 4.99, 5.0), np.where(turning, -0.17, 0.0)
    course = np.deg2rad(heading)
    north, east = (integrate(velocity, t) for velocity in to_earth(surge, sway, course))
    columns = dict(zip(MOTION, (north, east, (heading + 160.0) % 360.0, surge, sway, rate), strict=True))
    index = pd.date_range("2026-05-17T12:00:00Z", periods=t.size, freq="s")
    (finding,) = check_motion(pd.DataFrame(columns, index)).findings
    assert finding.code == "heading_offset"


@pytest.mark.parametrize("seed", [0, *nightly(1, 2, 3)])
def test_a_late_heading_at_a_steady_speed_is_no_early_yaw_rate(seed: int) -> None:
    """Speeds that are so noisy tell little of the path; no sensor is early."""
    table = sailed(
        Faults(late_s={"heading_deg": 1.5}), 600.0, 1.0, seed, noise=Noise(speed_mps=0.2), speed_changes=0.0
    )
    (delay,) = [each for each in check_motion(table).findings if each.code == "channel_delay"]
    assert delay.channel == "heading_deg"
    assert near(delay, "seconds", 1.5)
