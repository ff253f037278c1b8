"""The linear model against the simulator: zero on its own runs, its slopes, and what effects do to it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from seatrial.acquisition.core.quantities import Floats
from seatrial.hybrid.diagnosis.linearise import (
    ModelWithEffects,
    acting_settings,
    linear_model,
    next_states,
    sensor_readings,
    signatures,
    true_states,
)
from seatrial.hybrid.diagnosis.log import STEPS_PER_SECOND, Log
from seatrial.hybrid.effects import CATALOGUE
from seatrial.hybrid.vessel.dynamics import simulate
from seatrial.hybrid.vessel.plant import Plant
from tests.hybrid.diagnosis.log_by_hand import DT_S, a_log, orders

SMALL = np.array([0.03, 0.03, 1e-3, 0.02, 0.02, 5e-4])
"""Usual noise of a sample: what is small beside it is nothing."""

FORCES = {"constant_X_n": 1e2, "constant_Y_n": 1e2, "constant_N_nm": 1e3}
SENSORS = [name for name, effect in CATALOGUE.items() if effect.kind == "sensor" and "wind" not in name]
LATE = ["position_delay", "heading_delay", "speed_delay"]


@pytest.fixture(scope="module")
def log(plant: Plant) -> Log:
    """A run of the reference ship."""
    return a_log(plant)


def typical(plant: Plant, *names: str) -> Plant:
    """The plant with effects of an ordinary size."""
    for name in names:
        plant = CATALOGUE[name].apply(plant, CATALOGUE[name].typical_values)
    return plant


def inside(log: Log, margin: int = 1) -> slice:
    """Without the ends of the run, beyond which no one looks."""
    return slice(margin, len(log) - margin)


@pytest.mark.parametrize("name", [None, "ocean_current", "thruster_lag", "command_delay", "shallow_water"])
def test_the_models_own_run_leaves_nothing(plant: Plant, name: str | None) -> None:
    """Defect of the equations and what is left of the samples, of a run of exactly this plant."""
    own = typical(plant, name) if name else plant
    if name == "thruster_lag":  # the start of a run knows no earlier setting
        own = plant.shifted(thruster_lag_s=1.0)
    log = a_log(own)
    linear = linear_model(log, own)
    assert np.abs(linear.defect).max() < 1e-6
    assert np.abs(linear.observed[inside(log)]).max() < 1e-6


@pytest.mark.parametrize("names", [(each,) for each in SENSORS] + [("heading_bias", "speed_delay", "speed_scale")])
def test_a_sensor_that_the_model_knows_leaves_little(plant: Plant, names: tuple[str, ...]) -> None:
    """The true motion is found again from what is reported, and moves as the equations say."""
    own = typical(plant, *names)
    log = a_log(own)
    linear = linear_model(log, own)
    middle = inside(log, 8)
    does = np.abs(own_report(log, own) - linear.origin).max(axis=0)
    left = np.sqrt((linear.observed[middle] ** 2).mean(axis=0))
    assert (np.abs(linear.defect[middle]) < 0.1 * SMALL).all()
    assert (left < 0.05 * does + 0.05 * SMALL).all()  # of what the sensors do within the second


@pytest.mark.parametrize(
    ("name", "seconds"),
    [(name, 0.5) for name in LATE] + [("position_delay", 1.5), ("heading_delay", 1.5)],
)
def test_a_long_delay_that_the_model_knows_leaves_little(plant: Plant, name: str, seconds: float) -> None:
    """However late, and between full seconds too: less than a sample's noise is left."""
    own = CATALOGUE[name].apply(plant, {"seconds": seconds})
    log = a_log(own)
    linear = linear_model(log, own)
    middle = inside(log, 8)
    assert (np.abs(linear.defect[middle]) < 0.1 * SMALL).all()
    assert (np.sqrt((linear.observed[middle] ** 2).mean(axis=0)) < 0.05 * SMALL).all()


def own_report(log: Log, own: Plant) -> Floats:
    """What a plant's sensors report of the motion found again."""
    return sensor_readings(log, own, true_states(log, own))


@pytest.mark.parametrize("name", SENSORS)
def test_unreported_inverts_reported(plant: Plant, log: Log, name: str) -> None:
    own = typical(plant, name)
    states, middle = true_states(log, own), inside(log, 8)
    assert (np.abs(own_report(log, own) - log.nominal)[middle] < 0.05 * SMALL).all()
    assert (np.abs(states - log.nominal) > 1e-4).any()


def test_slopes_are_those_of_finer_integration(plant: Plant, log: Log) -> None:
    """A and B against one-sided differences of runs in steps of a hundredth of a second."""
    linear = linear_model(log, plant)

    def end(row: int, start: Floats, ship: Plant) -> Floats:
        air = np.repeat(log.wind[row : row + 1], STEPS_PER_SECOND, axis=0)
        return np.asarray(simulate(ship, start, log.controls[row], air, DT_S, 25)[-1])

    def slope(row: int, step: float, state: int | None, force: str = "") -> Floats:
        ends = []
        for times in (0.0, 1.0, 2.0):
            start = linear.origin[row].copy()
            if state is not None:
                start[state] += times * step
            ends.append(end(row, start, plant.shifted(**{force: times * step}) if force else plant))
        return (4.0 * ends[1] - 3.0 * ends[0] - ends[2]) / (2.0 * step)

    for row in (3, 40, 77):
        for column, step in enumerate([1.0, 1.0, 1e-4, 1e-3, 1e-3, 1e-5]):
            np.testing.assert_allclose(linear.A[row, :, column], slope(row, step, column), rtol=1e-4, atol=1e-4)
        for column, (name, size) in enumerate(
            {"constant_X_n": 1e2, "constant_Y_n": 1e2, "constant_N_nm": 1e3}.items()
        ):
            expected = slope(row, size, None, name)
            np.testing.assert_allclose(
                linear.B[row, :, column], expected, rtol=1e-3, atol=1e-3 * np.abs(expected).max()
            )


def test_a_force_moves_her_mass(plant: Plant, log: Log) -> None:
    """In a second a force brings its impulse over mass and added mass, but for what damping takes."""
    B = linear_model(log, plant).B
    surge = 1.0 / (plant.mass_kg - plant.Xud)
    assert (B[:, 3, 0] < surge).all()
    assert (B[:, 3, 0] > 0.9 * surge).all()
    np.testing.assert_allclose(B[:, 0, 0] ** 2 + B[:, 1, 0] ** 2, (0.5 * surge) ** 2, rtol=0.1)


@pytest.mark.parametrize("name", CATALOGUE)
def test_a_signature_is_what_a_small_effect_does(plant: Plant, log: Log, name: str) -> None:
    """Next states and reported ones with a little of the effect, less those without, over the little.

    Of what has one sign only the middle of the range is meant, so that much curvature is allowed there.
    """
    model, effect = ModelWithEffects(plant, CATALOGUE), CATALOGUE[name]
    if name == "low_speed_damping":  # under way there is none
        log = a_log(plant, controls=0.1 * orders(90), start=(10.0, -20.0, 0.4, 0.3, 0.1, 0.01), wind_mps=2.0)
    origin = true_states(log, plant)
    for each in signatures(log, model, origin, [name]):
        little = 1e-3 * effect.free_scale[each.coordinate]
        ends = []
        for times in (0.0, 1.0, 2.0):
            moved = model.plant_with_step(name, each.coordinate, times * little)
            assert moved is not None
            ends.append((next_states(log, moved, origin), sensor_readings(log, moved, origin)))
        for mine, k in ((each.D, 0), (each.E, 1)):
            slope = (4.0 * ends[1][k] - 3.0 * ends[0][k] - ends[2][k]) / (2.0 * little)
            size = np.sqrt((slope**2).mean(axis=0)).max()
            one_sided = effect.parameters[0].low == effect.parameters[0].neutral or effect.chart == "inverse_square"
            allowed = 0.35 if one_sided else 0.15 if name.startswith("wind") else 0.05  # wind tables have corners
            # At full speed little is left to lose, and a play of degrees is taken up later than a little one.
            allowed = 0.75 if name.startswith(("speed_loss", "backlash")) else allowed
            assert np.sqrt(((mine - slope) ** 2).mean(axis=0)).max() <= allowed * size + 1e-9


@pytest.mark.parametrize("name", ["hull_fouling", "thrust_loss_port", "speed_scale"])
@pytest.mark.parametrize("end", ["low", "high"])
def test_an_effect_at_the_end_of_its_range_has_a_signature_to_the_inside(
    plant: Plant, log: Log, name: str, end: str
) -> None:
    first = CATALOGUE[name].parameters[0]
    inside = 0.9 * getattr(first, end) + 0.1 * first.neutral
    at_end, near = (
        signatures(log, ModelWithEffects(plant, CATALOGUE, {name: (value - first.neutral,)}), log.nominal, [name])[
            0
        ]
        for value in (getattr(first, end), inside)
    )
    assert np.abs(at_end.D + at_end.E).max() > 0.0
    assert np.abs(at_end.D - near.D).max() < 0.7 * np.abs(near.D).max() + 1e-9


def test_what_an_effect_does_beyond_its_signature_is_of_second_order(plant: Plant, log: Log) -> None:
    model, name = ModelWithEffects(plant, CATALOGUE), "ocean_current"
    origin = true_states(log, plant)
    east = signatures(log, model, origin, [name])[1]
    none = next_states(log, plant, origin)

    def left(size: float) -> float:
        moved = model.plant_with_step(name, 1, size)
        assert moved is not None
        return float(np.abs(next_states(log, moved, origin) - none - size * east.D).max())

    assert left(0.4) == pytest.approx(4.0 * left(0.2), rel=0.3)
    assert left(0.4) < 0.2 * np.abs(0.4 * east.D).max()


def test_thrusters_that_lag_follow_by_their_time(plant: Plant, log: Log) -> None:
    """What acts at the start of each second against the exponential, step by step."""
    controls, acting = acting_settings(log, plant.shifted(thruster_lag_s=1.3))
    series, now, expected = log.controls.reshape(-1, 5), log.controls[0, 0].copy(), []
    for step in series:
        expected.append(now.copy())
        now += (1.0 - np.exp(-DT_S / 1.3)) * (step - now)
    np.testing.assert_allclose(acting, np.array(expected)[::STEPS_PER_SECOND], atol=1e-10)
    assert np.array_equal(controls, log.controls)


def test_a_late_record_acts_earlier_and_never_across_a_break(plant: Plant) -> None:
    log = a_log(plant, 60, edges=(30,), breaks=(30,))
    late = plant.shifted(command_delay_s=0.5)
    controls, _ = acting_settings(log, late)
    series = log.controls.reshape(-1, 5)
    np.testing.assert_allclose(controls.reshape(-1, 5)[:118], series[2:120], atol=1e-12)
    np.testing.assert_allclose(controls.reshape(-1, 5)[118:120], series[[119, 119]], atol=1e-12)
    other = replace(log, controls=log.controls.copy())
    other.controls[30:] += 0.5
    changed = acting_settings(other, late.shifted(thruster_lag_s=2.0))
    same = acting_settings(log, late.shifted(thruster_lag_s=2.0))
    assert np.array_equal(changed[0][:30], same[0][:30])
    np.testing.assert_array_equal(changed[1][:30], same[1][:30])
    assert np.array_equal(changed[1][30], changed[0][30, 0])


def test_azimuths_through_astern_do_not_turn_round(plant: Plant, log: Log) -> None:
    """The same angles, written with and without a jump at 180 degrees, act alike."""
    astern, wrapped = (replace(log, controls=log.controls.copy()) for _ in range(2))
    astern.controls[:, :, 1] += np.pi
    wrapped.controls[:, :, 1] = (astern.controls[:, :, 1] + np.pi) % (2.0 * np.pi) - np.pi
    assert (np.abs(np.diff(wrapped.controls[:, 0, 1])) > 6.0).any()
    for own in (plant.shifted(command_delay_s=0.3), plant.shifted(thruster_lag_s=1.5)):
        off = acting_settings(astern, own)[0][:, :, 1] - acting_settings(wrapped, own)[0][:, :, 1]
        np.testing.assert_allclose(off - 2.0 * np.pi * np.round(off / (2.0 * np.pi)), 0.0, atol=1e-9)
        states = true_states(log, own)
        np.testing.assert_allclose(next_states(astern, own, states), next_states(wrapped, own, states), atol=1e-9)


def test_a_second_out_of_the_models_range_says_nothing(plant: Plant, log: Log) -> None:
    states = log.nominal.copy()
    states[7, 3] = 40.0
    assert np.array_equal(next_states(log, plant, states)[7], states[7])


def test_a_missing_sample_stays_missing(plant: Plant, log: Log) -> None:
    holed = replace(log, measured=log.measured.copy())
    holed.measured[5, 2] = np.nan
    observed = linear_model(holed, plant).observed
    assert np.isnan(observed[5, 2])
    assert np.isnan(observed).sum() == 1
