"""Thruster settings between their records: what each reading makes of them, and which one the motion asks for."""

from __future__ import annotations

from itertools import product

import numpy as np
import pandas as pd
import pytest

from seatrial.acquisition.core.ship import COMMAND, DEFAULT
from seatrial.hybrid.diagnosis.disturbance_model import DisturbanceNoise, NoiseEstimate
from seatrial.hybrid.diagnosis.linearise import ModelWithEffects, linearise
from seatrial.hybrid.diagnosis.log import INPUT_HOLDS, InputHold, log_of, mean_settings
from seatrial.hybrid.diagnosis.planning import append_rehearsals
from seatrial.hybrid.diagnosis.verdict import choose_input_hold
from seatrial.hybrid.effects import CATALOGUE, apply_effects
from seatrial.hybrid.vessel.actuators import control_units
from seatrial.hybrid.vessel.dynamics import simulate
from seatrial.hybrid.vessel.plant import Plant
from seatrial.hybrid.vessel.sensors import STATE_UNITS
from tests.conftest import nightly
from tests.hybrid.diagnosis.examination_by_hand import SMALL_CATALOGUE

DT_S, SECONDS = 0.1, 600
LEVELS = DisturbanceNoise(position_m=0.05, heading_rad=2e-3, surge_mps=0.03, sway_mps=0.03, yaw_rate_radps=1e-3)
MOTION = ("north_m", "east_m", "heading_deg", "surge_mps", "sway_mps", "yaw_rate_dps")


def settings(kind: InputHold) -> np.ndarray:
    """Shaft speeds and azimuths [10 Hz, 5] that change every 20 s: at once, or as drives move, in four seconds."""
    random = np.random.default_rng(1)
    count = SECONDS // 20
    port, starboard = random.uniform(1.5, 3.0, (2, count))
    angle = np.deg2rad(random.choice([-25.0, -10.0, 0.0, 10.0, 25.0], count))
    steps = np.repeat(np.column_stack([port, angle, starboard, angle, np.zeros(count)]), 200, axis=0)
    if kind != "line":
        return steps
    width = np.ones(40) / 40.0
    return np.column_stack([np.convolve(np.pad(each, 40, "edge"), width, "same")[40:-40] for each in steps.T])


def recorded(plant: Plant, kind: InputHold) -> pd.DataFrame:
    """A trial with settings of this kind, recorded once a second, with some noise."""
    acting = settings(kind)
    wind = np.tile([1.0, 4.0], (len(acting), 1))
    rows = np.arange(0, len(acting), 10)
    motion = simulate(plant, [0.0, 0.0, 0.3, 4.0, 0.0, 0.0], acting, wind, DT_S)[rows] / STATE_UNITS
    noise = np.array([0.05, 0.05, 0.1, 0.03, 0.03, 0.05]) * np.random.default_rng(2).standard_normal(motion.shape)
    records = acting[np.maximum(rows - 1, 0)] if kind == "since the last record" else acting[rows]
    table = pd.DataFrame(
        np.hstack([motion + noise, np.tile([57.3, 4.0], (len(rows), 1)), records / control_units(DEFAULT)]),
        columns=[*MOTION, "wind_direction_deg", "wind_speed_mps", *COMMAND],
        index=pd.to_datetime(1_800_000_000_000_000_000 + rows * 100_000_000, utc=True),
    )
    table["heading_deg"] %= 360.0
    table.index.name = "time"
    return table


@pytest.mark.parametrize("kind", ["line", "until the next record", *nightly("since the last record")])
def test_the_motion_says_how_settings_are_to_be_read(plant: Plant, kind: InputHold) -> None:
    """Also where the drives lag."""
    lags = {"thruster_lag": {"time_constant_s": 2.0}} if kind == "until the next record" else {}
    table = recorded(apply_effects(plant, lags), kind)
    log = log_of([table])
    assert log.input_hold == "line"
    model = ModelWithEffects(plant, {**SMALL_CATALOGUE, **{name: CATALOGUE[name] for name in lags}})
    read = choose_input_hold(NoiseEstimate(linearise(log, model, 0.01), LEVELS)).linearisation.log
    assert read.input_hold == kind
    assert (read is log) == (kind == "line")


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["since the last record", *nightly("line", "until the next record")])
def test_with_a_model_that_is_far_off_the_motion_still_says_so(plant: Plant, kind: InputHold) -> None:
    """The search for effects does not converge there; the linearisation about none decides."""
    log = log_of([recorded(plant, kind)])
    coarse = plant.scaled(2.0, *plant.hull_model.numbers)
    estimate = NoiseEstimate(linearise(log, ModelWithEffects(coarse, SMALL_CATALOGUE), 0.01), LEVELS)
    assert choose_input_hold(estimate).linearisation.log.input_hold == kind


def test_what_a_setting_does_between_two_records() -> None:
    times = np.arange(1000, 1021)
    table = pd.DataFrame(0.0, columns=list(COMMAND), index=pd.to_datetime(times, unit="s", utc=True))
    table["port_rpm"] = np.where(times < 1010, 60.0, 120.0)
    quarters = {each: mean_settings(table, times, each)[:, :, 0] for each in INPUT_HOLDS}
    assert quarters["until the next record"][9] == pytest.approx(1.0)
    assert quarters["since the last record"][9] == pytest.approx(2.0)
    assert quarters["line"][9] == pytest.approx([1.125, 1.375, 1.625, 1.875])
    for each in quarters.values():
        assert each[:9] == pytest.approx(1.0)
        assert each[10:20] == pytest.approx(2.0)


def test_a_log_of_two_recordings_is_read_again_as_a_whole(plant: Plant) -> None:
    table = recorded(plant, "until the next record")
    later = table.set_axis(table.index + pd.Timedelta(days=1))
    log = log_of([table, later])
    held = log.with_input_hold("until the next record")
    halves = [held.controls[held.recording == number] for number in (0, 1)]
    assert halves[0] == pytest.approx(halves[1])
    inside = held.controls[:, :, 0]
    assert np.ptp(inside, axis=1).max() < 1e-9  # it changes at full seconds only
    assert np.ptp(log.controls[:, :, 0], axis=1).max() > 0.1


def test_a_log_goes_from_any_hold_to_any_other(plant: Plant) -> None:
    """A second diagnosis begins with the hold of the first, and compares all again."""
    log = log_of([recorded(plant, "until the next record")])
    for first, second in product(INPUT_HOLDS, repeat=2):
        again = log.with_input_hold(first).subset(log.leg == 0).with_input_hold(second)
        assert again.input_hold == second
        np.testing.assert_array_equal(again.controls, log.with_input_hold(second).controls[log.leg == 0])


def test_a_rehearsal_behind_a_recording_makes_a_log_whose_parts_can_be_taken(plant: Plant) -> None:
    log = log_of([recorded(plant, "line")])
    joined = append_rehearsals(log, [log])
    assert len(joined.subset(joined.leg > log.leg.max())) == len(log)
