"""The benchmark's own simulator: published figures, the reference model as oracle, signs of the contract."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from seatrial.acquisition.core.errors import ConfigurationError, ModelRangeError
from seatrial.acquisition.core.ship import NAMES
from seatrial.acquisition.tables.import_table import import_table
from seatrial.analysis.tables.table import read_table
from seatrial.hybrid.diagnosis.linearise import plays_of
from seatrial.hybrid.effects import CATALOGUE, apply_effects
from seatrial.hybrid.vessel.dynamics import simulate
from seatrial.hybrid.vessel.plant import Plant
from seatrial.hybrid.vessel.sensors import behind_play, controls_of, measure, states_of, wind_of
from tests.benchmarks.other_ship import EFFECTS, OUTSIDE, PROGRAMMES, SEAS, Sea, make_trial
from tests.benchmarks.other_ship.__main__ import main
from tests.benchmarks.other_ship.effects import data_sheet
from tests.benchmarks.other_ship.forces import body_of
from tests.benchmarks.other_ship.model_error import FORMS
from tests.benchmarks.other_ship.programmes import Order, hold, steer, turn, zigzag
from tests.benchmarks.other_ship.trial import steady_speed
from tests.conftest import nightly

KNOT = 1852.0 / 3600.0
WINDY = Sea(8.0, 0.0, 5.0)
SHORT: tuple[Order, ...] = (
    steer(0, 170, 20), zigzag(0, 170, 20, 20, 3), turn(150, -30, 200),
    Order(1, 150.0, 60.0, 10.0, -5.0, seconds=60.0), hold(60, 10, 60, 150),
)  # fmt: skip
"""A bit of everything, in five minutes."""
NEAR_REST: dict[str, Any] = {
    "programme": (
        hold(20, 0, 60), Order(1, -25.0, -25.0, seconds=50.0), hold(0, 0, 30, 120), hold(0, 0, 60, -120),
        hold(0, 0, 40), hold(15, 90, 30, -80), hold(0, 0, 30),
    ), "sea": "calm",
}  # fmt: skip
"""Pushed about by little, for effects that are gone under way."""
STOPPING: dict[str, Any] = {
    "programme": (
        hold(150, 0, 60), hold(-90, 0, 40),
        Order(1, 60.0, -90.0, seconds=40.0), Order(1, -90.0, 60.0, seconds=40.0),
    ), "sea": "calm",
}  # fmt: skip
"""Shafts turn astern, together and one by one."""
WHERE_IT_SHOWS = {
    "low_speed_damping": NEAR_REST, **{name: STOPPING for name in EFFECTS if name.startswith("astern_thrust")},
}  # fmt: skip
"""The programme of an effect that the usual one does not show."""


def perfect(
    hidden: dict[str, dict[str, float]] | None = None, **options: Any
) -> tuple[pd.DataFrame, dict[str, Any]]:
    """A short trial without heel coupling, as perfect sensors see it."""
    settings: dict[str, Any] = {
        "programme": SHORT, "duration_s": 300.0, "noise": 0.0, "heel_coupling": False, "sea": WINDY,
    }  # fmt: skip
    return make_trial(4, hidden, **(settings | options))


def worst(plant: Plant, table: pd.DataFrame, truth: dict[str, Any], horizon_s: float = 15.0) -> np.ndarray:
    """The largest errors of what ``plant`` reports over windows of a trial, from its true states on [6]."""
    steps = round(horizon_s * truth["rate_hz"])
    dt_s = 1.0 / truth["rate_hz"]
    states, command, wind, seen = truth["states"], controls_of(table), wind_of(table), states_of(table)
    command, wind = (0.5 * (each[:-1] + each[1:]) for each in (command, wind))
    more = steps + round(2.0 / dt_s)  # late commands look ahead
    # The first windows only fill what lags, and show on which side of its play a gear is.
    begins = range(2 * steps, len(states) - more, steps)
    lagging = {}
    if plant.thruster_lag_s:
        lagging["acting_start"] = _followed(command, plant.thruster_lag_s, dt_s)[list(begins)]
    if any(plays_of(plant)):
        dragged = [behind_play(*each) for each in zip(command.T, plays_of(plant), strict=True)]
        lagging["acting_start"] = np.column_stack(dragged)[[begin - 1 for begin in begins]]
    runs = simulate(
        plant,
        states[list(begins)],
        np.stack([command[i : i + more] for i in begins]),
        np.stack([wind[i : i + more] for i in begins]),
        dt_s,
        **lagging,
    )
    errors = measure(runs, plant, dt_s)[:, : steps + 1] - np.stack([seen[i : i + steps + 1] for i in begins])
    errors[..., 2] = (errors[..., 2] + np.pi) % (2.0 * np.pi) - np.pi
    return np.abs(errors[:, 10:]).max(axis=(0, 1))  # a delayed position looks back beyond the window's start


def _followed(command: np.ndarray, lag_s: float, dt_s: float) -> np.ndarray:
    acting = command.copy()
    for i in range(1, len(command)):
        acting[i] = acting[i - 1] + (1.0 - np.exp(-dt_s / lag_s)) * (command[i - 1] - acting[i - 1])
    return acting


@pytest.mark.parametrize(("rpm", "knots"), [(165, 9.5), (180, 10.3), (200, 11.5)])
def test_steady_speeds_are_the_published_ones(rpm: float, knots: float) -> None:
    body = body_of(data_sheet("gunnerus_short", {}), heel_coupling=True)
    assert steady_speed(body, rpm, rpm) / KNOT == pytest.approx(knots, abs=0.06)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("angle", "advance_m", "diameter_m"), [(20, 113, 186), *nightly((10, 206, 373), (30, 81, 118))]
)
def test_turning_circles_are_the_published_ones(angle: float, advance_m: float, diameter_m: float) -> None:
    """Advance at 90 degrees and tactical diameter at 180, either side, from the moment of the order."""
    for side in (-1, 1):
        programme = (steer(0, 171, 30), hold(171, -side * angle, 300))
        states = perfect(programme=programme, sea="calm", duration_s=230)[1]["states"][300:]
        heading = states[0, 2]
        away = (states[:, :2] - states[0, :2]) @ np.array(
            [[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]]
        )
        turned = side * (states[:, 2] - heading)
        assert away[np.argmax(turned > np.pi / 2), 0] == pytest.approx(advance_m, rel=0.04)
        assert side * away[np.argmax(turned > np.pi), 1] == pytest.approx(diameter_m, rel=0.04)


def test_the_reference_model_follows_within_five_centimetres(plant: Plant) -> None:
    """Nothing hidden, perfect sensors, wind: centimetres over 15 s, with the heel's couplings too."""
    for coupled, limit_m in ((False, 0.01), (True, 0.05)):
        assert worst(plant, *perfect(heel_coupling=coupled))[:2].max() < limit_m


def test_every_effect_of_the_catalogue_is_written_a_second_time_and_none_from_outside_is_in_it() -> None:
    assert set(EFFECTS) == set(CATALOGUE)
    assert not set(OUTSIDE) & set(CATALOGUE)


@pytest.mark.parametrize("name", EFFECTS)
def test_an_effect_is_what_the_catalogue_says(plant: Plant, name: str) -> None:
    """The reference model follows once it has the same effect, and is much further off without."""
    effect = CATALOGUE[name]
    table, truth = perfect({name: effect.typical_values}, **WHERE_IT_SHOWS.get(name, {}))
    scale = np.array([1.0, 1.0, 0.1, 0.3, 0.3, 0.02])
    bare = worst(plant, table, truth) / scale
    known = worst(apply_effects(plant, {name: effect.typical_values}), table, truth) / scale
    assert known.max() < 0.02
    assert bare.max() > 4.0 * known.max()


def test_a_current_carries_the_ship_where_it_goes_to() -> None:
    """The same orders in still air: after 100 s of one heading she is 100 s of current further."""
    straight = {"programme": (steer(0, 150, 500),), "sea": "calm", "duration_s": 101.0, "rate_hz": 1.0}
    still = perfect(**straight)[0]
    carried = perfect({"ocean_current": {"speed_mps": 0.5, "direction_deg": 90.0}}, **straight)[0]
    moved = (carried - still)[["north_m", "east_m"]].diff().sum()
    assert moved.to_numpy() == pytest.approx([0.0, 50.0], abs=1.0)


def test_sensor_effects_have_the_contracts_signs() -> None:
    table, truth = perfect()
    biased = perfect({"heading_bias": {"angle_deg": 2.0}, "speed_scale": {"factor": 1.1}})[0]
    turned = (biased["heading_deg"] - table["heading_deg"] + 180.0) % 360.0 - 180.0
    assert turned.to_numpy() == pytest.approx(2.0)
    assert biased["surge_mps"].to_numpy() == pytest.approx(1.1 * table["surge_mps"].to_numpy())
    vane = perfect({"wind_direction_bias": {"angle_deg": 15.0}})[0]
    assert ((vane["wind_direction_deg"] - table["wind_direction_deg"]) % 360.0).to_numpy() == pytest.approx(15.0)
    late = perfect({"position_delay": {"seconds": 1.0}})[0]
    assert late["north_m"].to_numpy()[10:] == pytest.approx(table["north_m"].to_numpy()[:-10], abs=1e-6)
    ahead = perfect({"position_antenna_offset": {"forward_m": 3.0}})[0]
    lever = (ahead - table)[["north_m", "east_m"]].to_numpy()
    heading = truth["states"][:, 2]
    assert lever == pytest.approx(3.0 * np.column_stack([np.cos(heading), np.sin(heading)]), abs=1e-6)


@pytest.mark.parametrize(
    ("name", "values"),
    [("azimuth_offset_both", {"angle_deg": 3.0}), ("yaw_asymmetry", {"moment_nm": -40e3}),
     ("thrust_loss_starboard", {"fraction": -0.3}), ("azimuth_offset_port", {"angle_deg": 3.0})],
)  # fmt: skip
def test_what_should_turn_her_to_port_does(name: str, values: dict[str, float]) -> None:
    states = perfect({name: values}, programme=(hold(150, 0, 60),), sea="calm", duration_s=30)[1]["states"]
    assert states[-1, 2] - states[0, 2] < -0.01


def test_the_same_seed_gives_the_same_trial() -> None:
    options: dict[str, Any] = {
        "sea": "moderate", "duration_s": 60.0, "model_error_percent": 2.0, "outliers": 0.01, "gaps": 0.1,
    }  # fmt: skip
    first, again, other = (make_trial(seed, **options)[0] for seed in (7, 7, 8))
    pd.testing.assert_frame_equal(first, again)
    assert not first.equals(other)
    assert list(first.columns) == list(NAMES)
    assert str(first.index.tz) == "UTC"
    assert first.index.name == "time"


def test_streams_of_chance_leave_each_other_alone() -> None:
    """What is hidden, the noise and the gaps do not change the weather."""
    plain = make_trial(3, sea="rough", duration_s=60.0, noise=0.0)[0]
    other = make_trial(3, {"towed_load": {"force_n": 5e3}}, sea="rough", duration_s=60.0, noise=0.0)[0]
    assert other["wind_speed_mps"].equals(plain["wind_speed_mps"])


def test_outliers_and_gaps_come_in_the_share_asked_for() -> None:
    options: dict[str, Any] = {"duration_s": 4000.0, "rate_hz": 1.0, "programme": "one_heading", "correlated": True}
    clean = make_trial(1, **options)[0]
    wild = make_trial(1, outliers=0.02, **options)[0]
    far = (wild["north_m"] - clean["north_m"]).abs() > 10 * 0.05
    assert far.mean() == pytest.approx(0.02, abs=0.005)
    holes = make_trial(1, gaps=0.1, **options)[0].isna()
    assert holes.mean().mean() == pytest.approx(0.1, abs=0.03)
    assert holes["north_m"].equals(holes["east_m"])
    assert holes["north_m"].astype(int).diff().abs().sum() < 0.6 * holes["north_m"].sum()  # in runs, not in grains


def test_noise_has_the_size_of_the_trials() -> None:
    """Noise is what a trial has beyond the same one with perfect sensors; correlated, it is as large."""
    clean = perfect()[0]
    for correlated in (False, True):
        noisy = perfect(noise=2.0, correlated=correlated)[0] - clean
        assert noisy["north_m"].std() == pytest.approx(0.1, rel=0.25)
        assert noisy["surge_mps"].std() == pytest.approx(0.06, rel=0.25)
        assert (noisy["surge_mps"].autocorr(10) > 0.15) == correlated


@pytest.mark.parametrize("form", FORMS)
def test_a_model_error_stays_within_its_percentage(form: str) -> None:
    """... and is there: the worst of the three directions has most of what is allowed, or the factors are small."""
    truth = make_trial(2, model_error_percent=2.0, model_error_form=form, duration_s=900.0)[1]["model_error"]
    shares = 100.0 * np.array(truth["error_rms"]) / np.array(truth["force_range"])
    assert shares.max() <= 2.0 + 1e-6
    assert shares.max() > 0.5
    exact = make_trial(2, duration_s=60.0, noise=0.0)[0]
    off = make_trial(2, duration_s=60.0, noise=0.0, model_error_percent=2.0, model_error_form=form)[0]
    assert not exact["north_m"].equals(off["north_m"])


def test_the_sea_is_as_rough_as_it_says() -> None:
    """Gusts, orbital motion and roll grow with the sea; the wind keeps its mean, the slow drift none."""
    heave = {}
    for name, sea in SEAS.items():
        table, truth = make_trial(6, sea=name, programme="one_heading", duration_s=900.0, noise=0.0)
        ripple = table["north_m"].to_numpy() - truth["states"][:, 0]
        heave[name] = ripple.std()
        assert table["wind_speed_mps"].mean() == pytest.approx(sea.wind_mps, rel=0.03, abs=0.01)
        assert np.degrees(truth["roll_rad"]).std() < 8.0
    assert heave["calm"] == 0.0
    assert heave["gentle"] < heave["moderate"]
    assert 0.02 < heave["gentle"] < 0.25  # less than the water's own quarter of the wave height


def test_slow_drift_has_no_mean() -> None:
    """On one heading it pushes to and fro: the speed it leaves on average is that of the calm."""
    rough, still = (
        make_trial(9, sea=sea, programme=(steer(0, 160, 9e9),), duration_s=1800.0, noise=0.0)[1]["states"]
        for sea in (Sea(0.0, 2.5, 7.2), "calm")
    )
    assert rough[:, 3].std() > 3.0 * still[:, 3].std()
    assert rough[:, 3].mean() == pytest.approx(still[:, 3].mean(), abs=0.01)


@pytest.mark.parametrize("size", [*zip(OUTSIDE, (30e3, 0.05, 4e3, 0.2, 0.6), strict=True)], ids=OUTSIDE)
def test_effects_outside_the_catalogue_are_felt(size: tuple[str, float]) -> None:
    programme = (hold(150, 30, 100), hold(150, -30, 100))
    plain = perfect(programme=programme, duration_s=200)[1]
    felt = perfect(programme=programme, duration_s=200, outside=dict([size]))[1]
    assert np.abs(felt["states"] - plain["states"])[:, :2].max() > 0.5
    assert (max(felt["outside_rms"]) > 100.0) == (size[0] != "sheared_current")


@pytest.mark.parametrize("programme", PROGRAMMES)
def test_programmes_keep_within_the_model(programme: str) -> None:
    """In a moderate sea; thrusters are alike except where one runs at a time."""
    duration_s = 3600.0 if programme == "programme" else 1500.0
    truth = make_trial(11, sea="moderate", programme=programme, duration_s=duration_s, rate_hz=2.0)[1]
    port, starboard = truth["controls"][:, :2], truth["controls"][:, 2:4]
    assert np.allclose(port, starboard) == (programme != "programme")
    assert np.abs(truth["states"][:, 5]).max() < 0.1


def test_the_full_programme_shows_what_separates_effects() -> None:
    states, controls = (make_trial(11, rate_hz=2.0)[1][key] for key in ("states", "controls"))
    turned = np.degrees(states[:, 2] - states[0, 2])
    assert np.ptp(turned) >= 720.0
    assert np.abs(controls[:, 4]).max() > 150.0
    assert states[:, 3].min() < 2.5
    alone = (np.abs(controls[:, 0]) < 0.1) ^ (np.abs(controls[:, 2]) < 0.1)
    assert alone.mean() > 0.08


def test_what_is_not_known_or_not_possible_is_refused() -> None:
    for options in (
        {"hidden": {"kraken": {}}},
        {"outside": {"kraken": 1.0}},
        {"sea": "flat"},
        {"programme": "nap"},
    ):
        with pytest.raises(ConfigurationError):
            make_trial(0, duration_s=10.0, **options)  # type: ignore[arg-type]
    with pytest.raises(ModelRangeError, match="left the range"):
        make_trial(0, {"yaw_asymmetry": {"moment_nm": 1e7}}, duration_s=120.0)


def test_the_command_writes_what_import_takes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out = tmp_path / "trial.csv"
    options = "--seed 3 --duration 60 --gaps 0.05 --rate 5 --hide ocean_current:speed_mps=0.2,direction_deg=205"
    monkeypatch.setattr(sys, "argv", ["other_ship", *options.split(), "-o", str(out)])
    main()
    truth = json.loads(out.with_suffix(".truth.json").read_text())
    assert truth["hidden"] == {"ocean_current": {"speed_mps": 0.2, "direction_deg": 205.0}}
    import_table(out, tmp_path / "trial.mcap")
    assert len(read_table(tmp_path / "trial.mcap")) > 280


def test_she_heels_outward_in_a_turn_and_rolls_in_waves() -> None:
    """To port in a turn to starboard, a few degrees; on a straight course in a calm not at all."""
    for side in (-1, 1):
        roll = perfect(programme=(hold(170, -side * 25, 90),), sea="calm", duration_s=80.0, heel_coupling=True)[1]
        assert 0.5 < np.degrees(-side * roll["roll_rad"][-1]) < 5.0
    straight = {"programme": (steer(0, 150, 90),), "duration_s": 80.0}
    assert np.abs(perfect(sea="calm", **straight)[1]["roll_rad"]).max() < 1e-6
    assert np.degrees(perfect(sea="moderate", **straight)[1]["roll_rad"].std()) > 1.0
