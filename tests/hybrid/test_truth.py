"""Simulated trials: the published manoeuvres, seas with the right statistics, secrets that stay secret."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

import seatrial
from seatrial.acquisition.core.errors import ConfigurationError, ModelRangeError
from seatrial.acquisition.core.ship import BY_NAME, CHANNELS, NAMES, angle_difference
from seatrial.hybrid.simulation.manoeuvres import MANOEUVRES, Leg, helm_leg, manoeuvre_named, steer, zigzag
from seatrial.hybrid.simulation.trial import (
    SeaState,
    SimulationNoise,
    drift_series,
    jonswap_spectrum,
    sea_state_for_ship,
    sea_state_named,
    sea_states,
    simulate_trial,
    wave_motion,
    wind_series,
)
from seatrial.hybrid.vessel.dynamics import simulate_batch
from seatrial.hybrid.vessel.files import load_vessel
from seatrial.hybrid.vessel.plant import Plant
from seatrial.hybrid.vessel.sensors import controls_of, states_of, wind_of
from tests.conftest import nightly
from tests.hybrid.froude import froude_scaled

PERFECT = SimulationNoise().scaled(0.0)


def _rng(seed: int = 3) -> np.random.Generator:
    return np.random.default_rng(seed)


def test_the_table_keeps_the_contract() -> None:
    """13 channels in order and in range, a UTC index named time, at the rate and length asked for."""
    table, _ = simulate_trial("gunnerus_short", "moderate", "zigzag", 120.0, 5.0, seed=1)
    assert list(table.columns) == list(NAMES)
    assert len(table) == 600
    index = table.index
    assert isinstance(index, pd.DatetimeIndex)
    assert (index.name, str(index.tz)) == ("time", "UTC")
    assert (np.diff(index.as_unit("ns").asi8) == 200_000_000).all()
    for channel in CHANNELS:
        assert table[channel.name].map(channel.is_possible_value).all(), channel.name


def test_one_seed_is_one_trial() -> None:
    """The same seed gives the same table, another one another; a change to one stream leaves the others."""
    options = ("gunnerus_short", "gentle", "zigzag", 60.0, 2.0)
    first, truth = simulate_trial(*options, seed=4)
    again, _ = simulate_trial(*options, seed=4)
    other, _ = simulate_trial(*options, seed=5)
    pd.testing.assert_frame_equal(first, again)
    assert not np.allclose(first["wind_speed_mps"], other["wind_speed_mps"])
    _, quiet = simulate_trial(*options, seed=4, noise=PERFECT)
    assert np.array_equal(truth["states"], quiet["states"])


@pytest.mark.parametrize(
    ("angle_deg", "advance_m", "diameter_m"), [(10.0, 206.0, 373.0), (20.0, 113.0, 186.0), (30.0, 81.0, 118.0)]
)
def test_turning_circles(angle_deg: float, advance_m: float, diameter_m: float) -> None:
    """Published advance and tactical diameter at 171 rpm, from the order to turn, both ways."""
    for side in (1.0, -1.0):
        legs = (helm_leg(0.0, at_most_s=1.0), helm_leg(side * angle_deg))
        _, truth = simulate_trial("gunnerus_short", "calm", legs, 300.0, 10.0)
        states = truth["states"]
        north, east, turned_rad = states[:, 0], -side * states[:, 1], -side * states[:, 2]
        began = north[10]
        advance = np.interp(np.pi / 2, turned_rad, north) - began
        assert advance == pytest.approx(advance_m, rel=0.01, abs=0.5)
        assert np.interp(np.pi, turned_rad, east) == pytest.approx(diameter_m, rel=0.01, abs=0.5)


def test_zigzag_switches_at_its_heading_and_overshoots() -> None:
    """The azimuth goes over when the heading is off by the switching angle, and the ship goes on a little."""
    table, truth = simulate_trial("gunnerus_short", "calm", zigzag(20.0, 20.0), 120.0, 10.0, noise=PERFECT)
    heading = np.rad2deg(truth["states"][:, 2])
    angle = table["port_angle_deg"].to_numpy()
    changes = np.flatnonzero(np.abs(np.diff(np.sign(angle))) == 2)
    assert len(changes) > 4
    assert np.abs(np.abs(heading[changes - 8]) - 20.0).max() < 4.0
    assert 20.5 < np.abs(heading).max() < 30.0


def test_actuators_keep_their_limits() -> None:
    """No azimuth turns faster than 20 deg/s, no shaft faster than 203 rpm, and both lag by a second."""
    legs = (helm_leg(0.0, 100.0, at_most_s=5.0), Leg(rpm=300.0, helm_deg=60.0))
    with pytest.raises(ModelRangeError, match="range of the model"):
        simulate_trial("gunnerus_short", "calm", legs, 60.0, 10.0)
    table, _ = simulate_trial("gunnerus_short", "calm", legs, 9.0, 10.0, noise=PERFECT)
    assert np.diff(table["port_angle_deg"]).max() == pytest.approx(2.0)
    assert table["port_rpm"].max() <= 203.0
    since = table["port_rpm"].to_numpy()[50:] - 100.0
    assert since[10] == pytest.approx(103.0 * (1.0 - np.exp(-1.0)), rel=0.1)


def test_steering_keeps_a_course_in_a_moderate_sea() -> None:
    """The autopilot holds its course within a few degrees against wind and drift."""
    _, truth = simulate_trial("gunnerus_short", "moderate", (steer(0.0, 200.0), steer(90.0, 300.0)), 480.0, 2.0)
    heading = np.rad2deg(truth["states"][:, 2])
    assert np.abs(heading[100:390]).max() < 8.0
    assert np.abs(angle_difference(heading[600:], 90.0)).max() < 8.0


@pytest.mark.parametrize("name", MANOEUVRES)
@pytest.mark.parametrize("vessel", ["gunnerus_short", *nightly("gunnerus_long")])
def test_every_manoeuvre_stays_in_the_models_range(name: str, vessel: str) -> None:
    """Short and long ship, worst sea: half an hour of each runs through."""
    table, _ = simulate_trial(vessel, "moderate", name, 1800.0, 1.0, seed=2)
    assert table.notna().all().all()


def test_names_may_carry_sizes() -> None:
    """zigzag_10_30 and turning_circle_15 are manoeuvres; what is none lists those that are."""
    assert repr(manoeuvre_named("zigzag_10_30")) == repr(zigzag(10.0, 30.0))  # with numbers that are not given
    assert len(manoeuvre_named("turning_circle_15")) > 2
    with pytest.raises(ConfigurationError, match="programme"):
        manoeuvre_named("loop")


def test_sea_states_are_those_of_the_paper() -> None:
    """Table II: wind, wave height and current of the three sea states."""
    table = {name: (s.wind_mps, s.wave_height_m, s.current_mps) for name, s in sea_states().items()}
    assert table == {"calm": (0.0, 0.0, 0.0), "gentle": (4.0, 1.0, 0.2), "moderate": (8.0, 2.0, 0.2)}
    with pytest.raises(ConfigurationError, match="moderate"):
        sea_state_named("stormy")


def test_a_faulty_sea_state_is_named(tmp_path: Path) -> None:
    """An unknown key says file and key."""
    file = tmp_path / "seas.toml"
    file.write_text("[rough]\nwind_mps = 12.0\nwave_heigth_m = 3.0\nwave_period_s = 7.0\ncurrent_mps = 0.0\n")
    with pytest.raises(ConfigurationError, match=r"seas\.toml"):
        sea_states(file)


def test_the_wave_spectrum_has_the_height_and_the_peak() -> None:
    """Four times the root of its area is the significant height; it peaks at the peak period."""
    frequency = np.linspace(0.3, 6.0, 4000)
    spectrum = jonswap_spectrum(frequency, 2.0, 6.5)
    area = spectrum.sum() * (frequency[1] - frequency[0])
    assert 4.0 * np.sqrt(area) == pytest.approx(2.0)
    assert frequency[spectrum.argmax()] == pytest.approx(2.0 * np.pi / 6.5, rel=0.01)


def test_a_ship_in_very_long_waves_follows_the_water(plant: Plant) -> None:
    """Waves much longer than the ship: horizontal displacement has the amplitude of the surface."""
    sea = SeaState(wind_mps=0.0, wave_height_m=2.0, wave_period_s=25.0, current_mps=0.0, direction_from_deg=0.0)
    motion = wave_motion(_rng(), sea, plant, np.zeros((40000, 6)), 0.5)
    assert motion[:, 0].std() == pytest.approx(0.5, rel=0.1)
    assert np.abs(motion[:, 1]).max() < 1e-9
    short = SeaState(wind_mps=0.0, wave_height_m=2.0, wave_period_s=3.0, current_mps=0.0, direction_from_deg=0.0)
    assert wave_motion(_rng(), short, plant, np.zeros((4000, 6)), 0.5)[:, 0].std() < 0.06


def test_measured_wave_motion_is_consistent() -> None:
    """Without sensor noise the recorded speeds are the derivatives of the recorded positions and heading."""
    table, _ = simulate_trial("gunnerus_short", "moderate", "zigzag", 120.0, 20.0, seed=3, noise=PERFECT)
    x = states_of(table)
    rate = np.gradient(x[:, :3], 0.05, axis=0)[2:-2]
    x = x[2:-2]
    cosine, sine = np.cos(x[:, 2]), np.sin(x[:, 2])
    assert rate[:, 0] == pytest.approx(x[:, 3] * cosine - x[:, 4] * sine, abs=0.02)
    assert rate[:, 1] == pytest.approx(x[:, 3] * sine + x[:, 4] * cosine, abs=0.02)
    assert rate[:, 2] == pytest.approx(x[:, 5], abs=2e-3)


def test_wave_speeds_are_the_rates_of_the_displacements_at_any_step(plant: Plant) -> None:
    """Differences over the tenths of a second of a simulation would be some percent too small."""
    fine_s = np.arange(0.0, 60.0, 0.01)
    states = np.column_stack([5.0 * fine_s, *np.zeros((1, 6000)), 0.02 * fine_s, *np.zeros((3, 6000))])
    states[:, 3:] = np.column_stack([5.0 * np.cos(states[:, 2]), -5.0 * np.sin(states[:, 2]), np.full(6000, 0.02)])
    fine = wave_motion(_rng(), sea_state_named("moderate"), plant, states, 0.01)
    coarse = wave_motion(_rng(), sea_state_named("moderate"), plant, states[::10], 0.1)
    rate = np.gradient(fine[:, :3], 0.01, axis=0)[::10]
    assert coarse[1:, 3:] == pytest.approx(rate[1:], rel=1e-3, abs=1e-3 * np.abs(rate).max(axis=0).min())


def test_gusts_and_slow_drift_have_their_statistics() -> None:
    """Mean and spread of the wind, its correlation time, and a drift force that is exponential about its mean."""
    sea = sea_state_named("moderate")
    wind = wind_series(_rng(), sea, 200_000, 0.5)
    speed = wind[:, 1]
    assert speed.mean() == pytest.approx(8.0, rel=0.02)
    assert speed.std() == pytest.approx(0.8, rel=0.05)
    lag = round(sea.gust_length_m / sea.wind_mps / 0.5)
    centred = speed - speed.mean()
    assert np.mean(centred[lag:] * centred[:-lag]) / speed.var() == pytest.approx(np.exp(-1.0), abs=0.06)
    drift = drift_series(_rng(), sea, 200_000, 0.5)
    assert drift.min() >= 0.0
    assert drift.mean() == pytest.approx(1.0, rel=0.05)
    assert drift.std() == pytest.approx(1.0, rel=0.1)


def test_sensor_noise_has_its_size() -> None:
    """What is recorded differs from the truth by the sensors' noise and nothing else in a calm."""
    table, truth = simulate_trial("gunnerus_short", "calm", "zigzag", 600.0, 10.0, seed=8)
    error = states_of(table) - truth["states"]
    expected = [0.05, 0.05, np.deg2rad(0.1), 0.03, 0.03, np.deg2rad(0.05)]
    assert error.std(axis=0) == pytest.approx(expected, rel=0.05)
    assert (controls_of(table) - truth["controls"]).std(axis=0)[0] * 60.0 == pytest.approx(0.3, rel=0.05)


def test_effects_in_sensors_and_inputs_are_recorded_as_promised() -> None:
    """Hidden biases show in what is recorded: compass, and a vane whose wind still pushes from the true side."""
    hidden = {"heading_bias": {"angle_deg": 3.0}, "wind_direction_bias": {"angle_deg": 25.0}}
    straight = (steer(0.0, 60.0),)
    plain, _ = simulate_trial("gunnerus_short", "gentle", straight, 60.0, 2.0, noise=PERFECT)
    biased, truth = simulate_trial("gunnerus_short", "gentle", straight, 60.0, 2.0, hidden=hidden, noise=PERFECT)
    assert angle_difference(biased["heading_deg"], plain["heading_deg"]) == pytest.approx(3.0)
    turn = angle_difference(biased["wind_direction_deg"], plain["wind_direction_deg"])
    assert turn == pytest.approx(25.0)
    assert truth["hidden"] == hidden


def test_the_model_with_the_truths_effects_predicts_the_truth() -> None:
    """Driven by the recorded controls and wind, the true plant goes the true way in a sea without slow drift."""
    sea = SeaState(wind_mps=6.0, wave_height_m=0.0, wave_period_s=5.0, current_mps=0.3)
    hidden = {"thrust_loss_port": {"fraction": 0.1}}
    _, truth = simulate_trial("gunnerus_long", sea, "zigzag", 60.0, 10.0, hidden=hidden)
    replay = simulate_batch(truth["plant"], truth["states"][0], truth["controls"], truth["wind"], 0.1, 1).states[0]
    assert replay[:-1] == pytest.approx(truth["states"], abs=1e-9)


@pytest.mark.parametrize(
    ("sea", "low_m", "high_m"), [("calm", 1.7, 2.6), ("gentle", 2.1, 3.4), ("moderate", 2.5, 4.6)]
)
def test_the_reference_misses_the_long_ship_as_in_the_paper(
    sea: str, low_m: float, high_m: float, plant: Plant
) -> None:
    """Held windows of 30 s of the long ship, predicted by the short one: the paper's order of error."""
    table, _ = simulate_trial("gunnerus_long", sea, "paper", 2400.0, 1.0, seed=1)
    states, controls, wind = states_of(table), controls_of(table), wind_of(table)
    angle = np.rad2deg(controls[:, 1])
    windows = np.lib.stride_tricks.sliding_window_view(angle, 31)
    firsts = np.flatnonzero(np.ptp(windows, axis=1) < 1.6)
    steps = firsts[:, np.newaxis] + np.arange(31)
    runs = simulate_batch(plant, states[firsts], controls[steps[:, :-1]], wind[steps[:, :-1]], 1.0).states
    error = (runs - states[steps])[:, 1:, :2]
    assert len(firsts) > 100
    assert low_m < np.hypot(error[..., 0], error[..., 1]).mean() < high_m


def test_the_command_writes_a_recording_and_keeps_the_secret(tmp_path: Path) -> None:
    """OUT.truth.json says what was hidden; the recording has no word of it."""
    app = seatrial.app
    out = tmp_path / "trial.mcap"
    options = ["-o", str(out), "--vessel", "gunnerus_long", "--sea-state", "gentle", "--duration", "20"]
    options += ["--rate", "5", "--seed", "3", "--hide", "hull_fouling:resistance_factor=1.3"]
    result = CliRunner().invoke(app, ["simulate", *options])
    assert result.exit_code == 0, result.output
    truth = json.loads((tmp_path / "trial.truth.json").read_text())
    assert truth["hidden"] == {"hull_fouling": {"resistance_factor": 1.3}}
    assert truth["seed"] == 3
    recorded = out.read_bytes()
    for secret in (b"hull_fouling", b"resistance_factor", b"hull_lengthening"):
        assert secret not in recorded


def test_the_catalogue_prints_as_json() -> None:
    """The effects command prints one JSON object."""
    app = seatrial.app
    result = CliRunner().invoke(app, ["effects", "--json"])
    assert result.exit_code == 0
    assert "ocean_current" in {each["name"] for each in json.loads(result.stdout)["effects"]}


def test_channels_convert_there_and_back() -> None:
    """A table to arrays and back is the table, angles at the wrap included."""
    table, truth = simulate_trial("gunnerus_short", "gentle", "zigzag", 30.0, 2.0, heading_deg=359.0)
    from seatrial.hybrid.vessel.sensors import states_as_table

    back = states_as_table(states_of(table), controls_of(table), wind_of(table), table.index)
    pd.testing.assert_frame_equal(back, table)
    assert BY_NAME["heading_deg"].is_possible_value(float(back["heading_deg"].iloc[0]))
    assert np.ptp(truth["states"][:, 2]) < 2.0


@pytest.mark.parametrize("sea_state", ["gentle", "moderate"])
def test_a_model_meets_her_sea_at_her_scale(sea_state: str) -> None:
    """Froude's law: R/V Gunnerus and her model at 1:10 sail one track in lengths, at times as their roots."""
    ship, root = load_vessel("gunnerus_short"), 0.1**0.5
    (_, full), (_, model) = (
        simulate_trial(each, sea_state, "turning_circle_20", 120.0 * slower, 10.0 / slower, 5, noise=PERFECT)
        for each, slower in ((ship, 1.0), (froude_scaled(ship, 0.1), root))
    )
    assert model["wind"][:, 1] == pytest.approx(root * full["wind"][:, 1])
    lengths = np.array([0.1, 0.1, 1.0, root, root, 1.0 / root])
    off = np.abs(model["states"] - lengths * full["states"]).max(axis=0)
    assert (off < 0.01 * np.ptp(lengths * full["states"], axis=0)).all(), off


def test_ships_of_full_size_meet_the_sea_as_it_is() -> None:
    """Waves are no smaller for a smaller ship; a calm is a calm for all."""
    for vessel in ("gunnerus_short", "gunnerus_long"):
        assert sea_state_for_ship("moderate", load_vessel(vessel).dimensions) == sea_state_named("moderate")
    assert sea_state_for_ship("calm", load_vessel("otter_2m").dimensions) == sea_state_named("calm")


@pytest.mark.parametrize("vessel", ["esso_osaka_3m", "otter_2m", "kvlcc2_7m"])
@pytest.mark.parametrize("sea_state", ["gentle", "moderate"])
def test_models_stay_in_the_range_of_their_coefficients(vessel: str, sea_state: str) -> None:
    for manoeuvre in ("zigzag_20_20", "turning_circle_30"):
        _, truth = simulate_trial(vessel, sea_state, manoeuvre, 300.0, 2.0, 1)
        assert truth["sea_state"]["name"].startswith(f"{sea_state} at 1:")
