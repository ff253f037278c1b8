"""From what a model lacks to the regime in which it lacks it, and to an effect that the simulator runs."""

from __future__ import annotations

from dataclasses import replace
from math import inf
from pathlib import Path

import numpy as np
import pytest

from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.acquisition.core.ship import DEFAULT
from seatrial.hybrid.diagnosis.map import FoundRegime, explained_shares, find_regimes, shape_of
from seatrial.hybrid.diagnosis.result import Replication
from seatrial.hybrid.diagnosis.verdict import diagnose
from seatrial.hybrid.effects import (
    MOST,
    Regime,
    apply_effects,
    as_file,
    catalogue_of,
    load_effects,
    quantities_along,
    regime_effect,
)
from seatrial.hybrid.report.diagnosis import regime_in_words
from seatrial.hybrid.simulation.manoeuvres import Leg
from seatrial.hybrid.simulation.trial import simulate_trial
from seatrial.hybrid.vessel.dynamics import simulate
from seatrial.hybrid.vessel.files import add_effects, load_vessel
from seatrial.hybrid.vessel.plant import Plant

ASTERN = Regime("surge", {"rpm": (-inf, 0.0)}, "rpm", -100.0)
SECONDS = 800


def a_motion(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """States, controls and wind of some minutes with shafts that turn ahead and astern."""
    rng, steps = np.random.default_rng(seed), np.arange(SECONDS)
    surge, sway = 2.0 + 2.0 * np.sin(steps / 90.0), 0.3 * rng.standard_normal(SECONDS)
    states = np.column_stack([np.zeros((SECONDS, 3)), surge, sway, 0.02 * np.cos(steps / 40.0)])
    rps = 2.0 * np.sin(steps / 55.0)
    angle = np.deg2rad(30.0) * np.sin(steps / 30.0)
    controls = np.column_stack([rps, angle, rps, angle, np.full(SECONDS, 50.0)])
    return (
        states,
        controls,
        np.column_stack([rng.uniform(0.0, 2.0 * np.pi, SECONDS), rng.uniform(2.0, 9.0, SECONDS)]),
    )


@pytest.mark.parametrize("regime", [
    ASTERN,
    Regime("sway", {"surge_mps": (1.0, inf)}, "tunnel_rpm", 100.0),
    Regime("yaw", {"relative_wind_deg": (90.0, 180.0)}, "wind_mps", 8.0),
])  # fmt: skip
def test_the_regime_in_which_a_force_is_missing_is_found_among_noise(regime: Regime) -> None:
    """Half of the force's own size as noise: regime, size and share come out."""
    states, controls, wind = a_motion(1)
    controls[:, 4] = 200.0 * np.sin(np.arange(SECONDS) / 20.0)
    quantities = quantities_along(DEFAULT, states, controls, wind)
    shape = shape_of(regime, quantities)
    force = 4e3 * 0.5 * shape.std() * np.random.default_rng(2).standard_normal((SECONDS, 3))
    axis = ("surge", "sway", "yaw").index(regime.axis)
    force[:, axis] += 4e3 * shape
    best = find_regimes(quantities, force, np.arange(SECONDS) // 50 % 4)[0]
    found, size, share = best.regime, best.size, best.share
    assert (found.axis, found.grows_with) == (regime.axis, regime.grows_with)
    there = shape_of(found, quantities) * size / 4e3
    assert np.corrcoef(there, shape)[0, 1] > 0.98
    assert 0.7 < share < 1.0


def test_noise_has_no_regime() -> None:
    states, controls, wind = a_motion(3)
    noise = np.random.default_rng(4).standard_normal((SECONDS, 3))
    assert find_regimes(quantities_along(DEFAULT, states, controls, wind), noise, np.arange(SECONDS) % 4) == []


def test_a_share_is_of_parts_that_had_no_part_in_the_size() -> None:
    """A shape that is there in one part of four only explains nothing of the others."""
    fold = np.repeat(np.arange(4), 50)
    shape, force = np.ones((200, 1)), np.zeros((200, 3))
    force[fold == 0] = 1.0
    force[fold == 1] = -1.0
    _, share, agree = explained_shares(shape, force, fold)
    assert (share <= 0.0).all()
    assert not agree.any()


def test_the_simulator_pushes_where_the_regime_says(plant: Plant) -> None:
    """1 kN ahead at -100 rpm: going ahead is as without it; astern Newton says what it changes."""
    pushed = apply_effects(plant, {"found": {"force_n": 1000.0}}, {"found": regime_effect("found", ASTERN, 1e3)})
    for rpm, less in ((100.0, 0.0), (-100.0, 1.0), (-50.0, 0.25)):
        controls = np.tile([rpm / 60.0, 0.0, rpm / 60.0, 0.0, 0.0], (2, 1))
        still, start = np.zeros((2, 2)), np.zeros(6)
        with_, without = (simulate(each, start, controls, still, 0.05)[-1, 3] for each in (pushed, plant))
        gained = less * 0.1 * 1000.0 / (plant.mass_kg - plant.Xud)
        assert with_ - without == pytest.approx(gained, rel=0.01, abs=1e-12)


def test_what_is_searched_is_what_is_simulated(plant: Plant) -> None:
    """One definition of every quantity: the shape over a motion is the force of the compiled effect."""
    states, controls, wind = a_motion(5)
    regime = Regime("sway", {"surge_mps": (1.0, inf), "azimuth_deg": (-5.0, 20.0)}, "wind_mps", 5.0)
    shape = shape_of(regime, quantities_along(DEFAULT, states, controls, wind))
    pushed = regime_effect("found", regime, 1.0).apply(plant, {"force_n": 1e3})
    for second in range(0, SECONDS, 97):
        at = (states[second], np.tile(controls[second], (1, 1)), np.tile(wind[second], (1, 1)), 1e-3, 1)
        with_, without = (simulate(each, *at)[-1, 4] for each in (pushed, plant))
        assert (abs(with_ - without) > 1e-9) == (shape[second] > 0.0)


def test_several_regimes_act_together_up_to_a_limit(plant: Plant) -> None:
    ahead = regime_effect("ahead", Regime("surge"), 1.0)
    both = plant
    for _ in range(MOST):
        both = ahead.apply(both, {"force_n": 500.0})
    controls, still = np.zeros((1, 5)), np.zeros((1, 2))
    gained = simulate(both, np.zeros(6), controls, still, 0.1)[-1, 3]
    assert gained == pytest.approx(0.1 * MOST * 500.0 / (plant.mass_kg - plant.Xud), rel=0.01)
    with pytest.raises(ConfigurationError, match="regimes"):
        ahead.apply(both, {"force_n": 1.0})


def test_a_regime_of_what_the_ship_lacks_is_refused(plant: Plant) -> None:
    with pytest.raises(ConfigurationError, match="no quantity 'rudder_deg'"):
        regime_effect("x", Regime("yaw", {"rudder_deg": (0.0, inf)}), 1.0).apply(plant, {"moment_nm": 1.0})


def test_the_file_of_effects_is_read_back(tmp_path: Path, plant: Plant) -> None:
    path = tmp_path / "regimes.py"
    path.write_text(as_file({"found": (ASTERN, -2e3), "other": (Regime("yaw", {"speed_mps": (1.0, 2.0)}), 5.0)}))
    found, other = load_effects(path).values()
    assert (found.name, found.parameters[0].typical, other.parameters[0].name) == ("found", 2e3, "moment_nm")
    assert found.apply(plant, {"force_n": 7.0}) == regime_effect("found", ASTERN, 2e3).apply(
        plant, {"force_n": 7.0}
    )


def test_the_sentence_says_force_regime_and_gain() -> None:
    found = FoundRegime("x", ASTERN, 24e3, 1e3, 0.41, Replication(4, 4), 0.34)
    said = regime_in_words(found)
    assert said.sentence == (
        "The model lacks 24 kN ahead while the mean shaft speed is below 0 rpm, proportional to the square of the "
        "mean shaft speed (the figure is for −100 rpm): 41 % of the missing surge force; with it the error on "
        "held-out legs is 0.34 m."
    )
    assert said.within == {"rpm": (None, 0.0)}
    port = regime_in_words(replace(found, regime=Regime("yaw", {"speed_mps": (1.0, 2.0)}), value=-3e3))
    assert port.sentence.startswith("The model lacks 3 kN m to port while the speed is 1 to 2 m/s: 41 %")
    assert port.parameters["moment_nm"].unit == "N m"


@pytest.mark.slow
def test_thrust_astern_that_no_effect_can_name_is_found_as_a_regime() -> None:
    """Runs ahead and astern with a third of the thrust astern, and a catalogue that has no such effect."""
    model, random = load_vessel("gunnerus_long"), np.random.default_rng(3)
    legs = [
        Leg(
            rpm=sign * random.uniform(80.0, 120.0),
            helm_deg=random.uniform(-10.0, 10.0),
            at_most_s=lasts,
        )
        for _ in range(40)
        for sign, lasts in ((1.0, random.uniform(25.0, 60.0)), (-1.0, random.uniform(15.0, 35.0)))
    ]
    true = add_effects(model, {"astern_thrust_both": {"factor": 0.33}})
    table, _ = simulate_trial(true, "gentle", tuple(legs), 1500.0, 1.0, seed=4)
    known = {name: each for name, each in catalogue_of(model).items() if not name.startswith("astern")}
    conclusion = diagnose([table], model, catalogue=known)
    first = conclusion.regimes[0]
    assert first.regime.axis == "surge"
    assert first.regime.within["rpm"][1] <= 0.0
    assert first.value > 0.0
    assert first.share > 0.5
    assert first.after_m < 0.6 * conclusion.gap.gap.before_m
