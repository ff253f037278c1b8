"""What effects of sensors, clocks and drives do to what is recorded."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from seatrial.acquisition.core.errors import InputError
from seatrial.acquisition.core.quantities import Floats
from seatrial.hybrid.effects import CATALOGUE
from seatrial.hybrid.simulation.manoeuvres import manoeuvre_named
from seatrial.hybrid.simulation.trial import SimulationNoise, simulate_trial
from seatrial.hybrid.vessel.dynamics import simulate, simulate_batch
from seatrial.hybrid.vessel.plant import Plant
from seatrial.hybrid.vessel.sensors import acting_controls, behind_play, controls_of, measure, wind_of
from tests.hybrid.conftest import Held

ANGLES = (1, 3)
PERFECT = SimulationNoise().scaled(0.0)
TURN = {"angle_deg": (15.0, 15.0), "tunnel_rpm": 100.0}


def reported(states: Floats, plant: Plant, name: str, dt_s: float = 1.0, **values: float) -> Floats:
    """States as the sensors report them with one effect."""
    return measure(states, CATALOGUE[name].apply(plant, values), dt_s)


@pytest.mark.parametrize(("name", "columns"), [("heading_delay", [2]), ("speed_delay", [3, 4, 5])])
@pytest.mark.parametrize("seconds", [2.0, -3.0])
def test_late_is_what_was_before(name: str, columns: list[int], seconds: float, plant: Plant, held: Held) -> None:
    """Whole samples late (or early) are those samples; the other channels are on time.

    Headings are found from turning speeds, here a second apart: a thousandth of a radian is lost.
    """
    true, shift = held(plant, **TURN), int(seconds)
    late = reported(true, plant, name, seconds=seconds)
    inside = slice(max(shift, 0), len(true) + min(shift, 0))
    origin = slice(max(-shift, 0), len(true) - max(shift, 0))
    exact = 1e-3 if name == "heading_delay" else 1e-12
    assert late[inside, columns] == pytest.approx(true[origin, columns], abs=exact)
    others = [column for column in range(6) if column not in columns]
    assert np.array_equal(late[:, others], true[:, others])


@pytest.mark.parametrize(("name", "columns"), [("heading_delay", [2]), ("position_delay", [0, 1])])
def test_late_poses_of_a_fine_record_are_those_before(name: str, columns: list[int], plant: Plant) -> None:
    """At eight samples a second nothing is lost by going back along the speeds."""
    controls = np.tile([2.5, 0.25, 2.5, 0.25, 0.0], (240, 1))
    true = simulate(plant, [0.0, 0.0, 0.2, 4.0, 0.0, 0.0], controls, np.zeros((240, 2)), 0.125)
    late = reported(true, plant, name, 0.125, seconds=1.5)
    assert late[20:, columns] == pytest.approx(true[8:-12, columns], abs=2e-5)


@pytest.mark.parametrize("seconds", [0.4, 1.6, -0.7])
def test_a_pose_that_is_off_moves_no_other_sample(plant: Plant, held: Held, seconds: float) -> None:
    """A fault of one pose stays with that sample: the others are where the ship was."""
    true = held(plant, **TURN)
    off = true.copy()
    off[12, :2] += [3.0, -2.0]
    changed = reported(off, plant, "position_delay", seconds=seconds)
    change = changed - reported(true, plant, "position_delay", seconds=seconds)
    assert change == pytest.approx(off - true, abs=1e-9)


def test_half_a_second_late_lies_between_the_samples(plant: Plant) -> None:
    """Speeds and heading stamped 0.5 s late, from a record a second apart, are those of a finer run."""
    controls = np.tile([2.5, 0.25, 2.5, 0.25, 0.0], (60, 1))
    fine = simulate(plant, [0.0, 0.0, 0.2, 4.0, 0.0, 0.0], controls, np.zeros((60, 2)), 0.5)
    coarse = fine[::2]
    assert reported(coarse, plant, "heading_delay", seconds=0.5)[1:, 2] == pytest.approx(fine[1::2, 2], abs=1e-3)
    speeds = reported(coarse, plant, "speed_delay", seconds=0.5)[2:, 3:]
    jumped = np.abs(fine[3::2, 3:] - coarse[2:, 3:]).max(axis=0)
    assert (np.abs(speeds - fine[3::2, 3:]).max(axis=0) < 0.05 * jumped + 1e-4).all()


def test_speeds_before_the_record_go_on_as_it_began(plant: Plant) -> None:
    """At the first sample a small delay is the first acceleration times it; a long one is bounded by a sample's."""
    ramp = np.zeros((6, 6))
    ramp[:, 3] = 2.0 + 0.1 * np.arange(6)
    assert reported(ramp, plant, "speed_delay", seconds=0.25)[:, 3] == pytest.approx(ramp[:, 3] - 0.025)
    assert reported(ramp, plant, "speed_delay", seconds=4.0)[0, 3] == pytest.approx(1.9)
    assert np.array_equal(reported(ramp[:1], plant, "speed_delay", seconds=0.5), ramp[:1])


def test_the_speeds_of_a_point_off_the_centre_are_those_of_its_track(plant: Plant) -> None:
    """A sensor off the reference point reports the derivative of its own position, in the ship's axes."""
    controls = np.tile([2.5, 0.3, 2.5, 0.3, 0.0], (400, 1))
    true = simulate(plant, [0.0, 0.0, 0.3, 4.0, 0.2, 0.02], controls, np.zeros((400, 2)), 0.05)
    place = {"forward_m": 7.0, "starboard_m": -3.0}
    track = reported(true, plant, "position_antenna_offset", 0.05, **place)[:, :2]
    north, east = np.gradient(track, 0.05, axis=0, edge_order=2).T
    cosine, sine = np.cos(true[:, 2]), np.sin(true[:, 2])
    speeds = reported(true, plant, "speed_sensor_offset", 0.05, **place)
    assert speeds[:, 3] == pytest.approx(north * cosine + east * sine, abs=1e-3)
    assert speeds[:, 4] == pytest.approx(east * cosine - north * sine, abs=1e-3)
    assert np.array_equal(speeds[:, [0, 1, 2, 5]], true[:, [0, 1, 2, 5]])


def test_a_turned_speed_sensor_sees_the_same_velocity_from_its_axes(plant: Plant, held: Held) -> None:
    """Turned clockwise by 3 degrees, the velocity lies 3 degrees further to port, and is no longer or shorter."""
    true = held(plant, **TURN)
    turned = reported(true, plant, "speed_sensor_rotation", angle_deg=3.0)
    drift = [np.arctan2(each[:, 4], each[:, 3]) for each in (turned, true)]
    assert drift[0] - drift[1] == pytest.approx(-np.deg2rad(3.0))
    assert np.hypot(turned[:, 3], turned[:, 4]) == pytest.approx(np.hypot(true[:, 3], true[:, 4]))


def test_gyro_and_log_report_what_their_effects_say(plant: Plant, held: Held) -> None:
    """Factor times true plus bias, and the other channels as they are; the ship moves as ever."""
    true = held(plant, **TURN)
    both = CATALOGUE["yaw_rate_scale"].apply(plant, {"factor": 1.1})
    both = CATALOGUE["yaw_rate_bias"].apply(both, {"rate_dps": 0.5})
    both = CATALOGUE["sway_bias"].apply(both, {"speed_mps": -0.2})
    seen = measure(true, both, 1.0)
    assert seen[:, 5] == pytest.approx(1.1 * true[:, 5] + np.deg2rad(0.5))
    assert seen[:, 4] == pytest.approx(true[:, 4] - 0.2)
    assert np.array_equal(seen[:, :4], true[:, :4])
    assert np.array_equal(held(both, **TURN), true)


def test_the_anemometer_reports_its_factor_times_the_wind(plant: Plant, held: Held) -> None:
    """A reported wind a quarter too strong pushes like the true one, in the model and in a simulated trial."""
    scaled = CATALOGUE["wind_speed_scale"].apply(plant, {"factor": 1.25})
    assert held(scaled, wind=(75.0, 12.5)) == pytest.approx(held(plant, wind=(75.0, 10.0)), abs=1e-12)
    trial: dict[str, Any] = {"sea_state": "gentle", "duration_s": 20.0, "rate_hz": 2.0, "noise": PERFECT}
    plain, before = simulate_trial(**trial)
    more, after = simulate_trial(**trial, hidden={"wind_speed_scale": {"factor": 1.25}})
    assert wind_of(more)[:, 1] == pytest.approx(1.25 * wind_of(plain)[:, 1])
    assert after["states"] == pytest.approx(before["states"], abs=1e-9)


controls_arrays = hnp.arrays(np.float64, (12, 5), elements=st.floats(-3.0, 3.0))


@given(controls=controls_arrays, samples=st.integers(-5, 5))
def test_delays_of_whole_samples_move_rows(controls: Floats, samples: int) -> None:
    """What acts is recorded so many rows later; beyond the ends the last known holds."""
    acting = acting_controls(controls, samples * 0.5, 0.5, ANGLES)
    rows = np.clip(np.arange(12) + samples, 0, 11)
    assert acting == pytest.approx(controls[rows], abs=1e-12)


@given(slope=hnp.arrays(np.float64, 5, elements=st.floats(-0.4, 0.4)), delay_s=st.floats(-2.0, 2.0))
def test_a_steady_change_is_moved_exactly_and_back(slope: Floats, delay_s: float) -> None:
    """Along a straight line recording late and acting early undo each other, angles on the circle."""
    times = np.arange(20.0)[:, None]
    controls = slope * times
    wrapped = controls.copy()
    wrapped[:, (1, 3)] = np.angle(np.exp(1j * controls[:, (1, 3)]))
    acting = acting_controls(wrapped, delay_s, 1.0, ANGLES)[3:-3]
    off = acting - slope * (times[3:-3] + delay_s)
    off[:, (1, 3)] = np.angle(np.exp(1j * off[:, (1, 3)]))
    assert np.abs(off).max() < 1e-9
    there_and_back = acting_controls(acting_controls(controls, delay_s, 1.0, ANGLES), -delay_s, 1.0, ANGLES)
    assert there_and_back[6:-6] == pytest.approx(controls[6:-6], abs=1e-9)


@given(motor=hnp.arrays(np.float64, 30, elements=st.floats(-2.0, 2.0)), width=st.floats(0.0, 2.0))
def test_play_keeps_within_half_of_itself_and_moves_only_when_pushed(motor: Floats, width: float) -> None:
    """The end of a loose gear is never further off than half the play, and just that far where it is dragged."""
    end = behind_play(motor, width)
    off = end - motor
    assert np.abs(off).max() <= 0.5 * width + 1e-12
    pushed = np.abs(np.diff(end)) > 1e-12
    assert np.abs(np.abs(off[1:][pushed]) - 0.5 * width).max(initial=0.0) < 1e-12
    assert np.array_equal(behind_play(motor, 0.0), motor)


def test_no_delay_is_no_change() -> None:
    """Without a delay the very array comes back."""
    controls = np.random.default_rng(1).normal(size=(4, 5))
    assert acting_controls(controls, 0.0, 1.0, ANGLES) is controls


def test_a_batch_takes_each_plants_delay(plant: Plant) -> None:
    """Plants may differ in their delay: each run is the one with its controls moved, alone or in a batch."""
    controls = np.tile([2.5, 0.0, 2.5, 0.0, 0.0], (20, 1))
    controls[8:, (1, 3)] = 0.3
    start, wind = [0.0, 0.0, 0.0, 4.0, 0.0, 0.0], np.zeros((20, 2))
    delays = [0.0, 1.5, -2.0]
    plants = [CATALOGUE["command_delay"].apply(plant, {"seconds": each}) for each in delays]
    runs = simulate_batch(plants, start, controls, wind, 1.0).states
    for run, changed, delay in zip(runs, plants, delays, strict=True):
        expected = simulate(plant, start, acting_controls(controls, delay, 1.0, ANGLES), wind, 1.0)
        assert run == pytest.approx(expected, abs=1e-12)
        assert simulate(changed, start, controls, wind, 1.0) == pytest.approx(expected, abs=1e-12)
    assert runs[1, -1, 2] < runs[0, -1, 2] < runs[2, -1, 2] < 0.0  # what is stamped late acted earlier
    with pytest.raises(InputError, match="controls 2 for 3 runs"):
        simulate_batch(plants, start, np.tile(controls, (2, 1, 1)), wind, 1.0)


@pytest.mark.parametrize("seconds", [0.7, -0.4])
def test_a_ship_with_late_feedback_records_it_late(seconds: float) -> None:
    """She moves as ever; her drives are recorded later; and the model with the delay follows her record."""
    trial: dict[str, Any] = {
        "manoeuvre": manoeuvre_named("zigzag"),
        "duration_s": 40.0,
        "rate_hz": 10.0,
        "noise": PERFECT,
    }
    plain, before = simulate_trial(**trial)
    late, after = simulate_trial(**trial, hidden={"command_delay": {"seconds": seconds}})
    assert np.array_equal(after["states"], before["states"])
    rows = round(seconds * 10.0)
    first, then = (slice(0, -rows), slice(rows, None)) if rows > 0 else (slice(-rows, None), slice(0, rows))
    assert controls_of(late)[then] == pytest.approx(controls_of(plain)[first], abs=1e-9)
    delayed, prompt = (
        simulate(plant, after["states"][0], after["controls"][:-1], after["wind"][:-1], 0.1, 1)
        for plant in (after["plant"], before["plant"])
    )
    missed_m = [np.hypot(*(run - after["states"])[:, :2].T).max() for run in (delayed, prompt)]
    assert missed_m[0] < 0.3 * missed_m[1]
