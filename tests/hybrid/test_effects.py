"""Effects one by one: signs and sizes are those of the physics."""

from __future__ import annotations

import numpy as np
import pytest

from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.hybrid.effects import CATALOGUE, apply_effects, parse_effect, vessel_plant
from seatrial.hybrid.vessel.files import Vessel, load_vessel
from seatrial.hybrid.vessel.plant import Plant
from seatrial.hybrid.vessel.sensors import measure
from tests.hybrid.conftest import Held

CONTRACT = {
    "ocean_current": ("physics", ["speed_mps", "direction_deg"]),
    "wave_drift": ("physics", ["force_n", "direction_deg"]),
    "hull_lengthening": ("physics", ["length_m"]),
    "loading": ("physics", ["mass_factor"]),
    "hull_fouling": ("physics", ["resistance_factor"]),
    "cross_flow_drag": ("physics", ["factor"]),
    "yaw_damping": ("physics", ["factor"]),
    "wind_load": ("physics", ["factor"]),
    "towed_load": ("physics", ["force_n"]),
    "yaw_asymmetry": ("physics", ["moment_nm"]),
    "shallow_water": ("physics", ["depth_m"]),
    "thrust_loss_port": ("actuator", ["fraction"]),
    "thrust_loss_starboard": ("actuator", ["fraction"]),
    "thrust_loss_both": ("actuator", ["fraction"]),
    "azimuth_offset_port": ("actuator", ["angle_deg"]),
    "azimuth_offset_starboard": ("actuator", ["angle_deg"]),
    "azimuth_offset_both": ("actuator", ["angle_deg"]),
    "thruster_lag": ("actuator", ["time_constant_s"]),
    "heading_bias": ("sensor", ["angle_deg"]),
    "position_antenna_offset": ("sensor", ["forward_m", "starboard_m"]),
    "position_delay": ("sensor", ["seconds"]),
    "speed_scale": ("sensor", ["factor"]),
    "wind_direction_bias": ("sensor", ["angle_deg"]),
}


def test_the_catalogue_keeps_its_promised_names() -> None:
    """Names, kinds and parameters that other programs rely on are all there."""
    for name, (kind, parameters) in CONTRACT.items():
        effect = CATALOGUE[name]
        assert effect.kind == kind
        assert [each.name for each in effect.parameters] == parameters


def _end(held: Held, plant: Plant, name: str, values: dict[str, float], **options: object) -> np.ndarray:
    return held(CATALOGUE[name].apply(plant, values), **options)[-1]


def test_current_carries_the_drifting_ship_along(plant: Plant, held: Held) -> None:
    """A ship that drifts with the water keeps its speed; one at rest is taken along to where it goes."""
    east = {"speed_mps": 0.5, "direction_deg": 90.0}
    still = {"rpm": (0.0, 0.0), "start": (0.0, 0.0, 0.3, 0.0, 0.0, 0.0), "seconds": 60}
    windless = CATALOGUE["wind_load"].apply(plant, {"factor": 0.0})
    assert _end(held, windless, "ocean_current", east, **still)[1] > 1.0


@pytest.mark.parametrize(("name", "values", "channel", "sign"), [
    ("wave_drift", {"force_n": 5e3, "direction_deg": 90.0}, 4, +1),
    ("towed_load", {"force_n": 5e3}, 3, -1),
    ("hull_fouling", {"resistance_factor": 1.5}, 3, -1),
    ("yaw_asymmetry", {"moment_nm": 50e3}, 5, +1),
    ("thrust_loss_both", {"fraction": 0.2}, 3, -1),
    ("thrust_loss_port", {"fraction": 0.2}, 5, -1),
    ("thrust_loss_starboard", {"fraction": 0.2}, 5, +1),
    ("azimuth_offset_port", {"angle_deg": 5.0}, 5, -1),
    ("azimuth_offset_starboard", {"angle_deg": 5.0}, 5, -1),
    ("azimuth_offset_both", {"angle_deg": 5.0}, 5, -1),
])  # fmt: skip
def test_signs_on_a_straight_course(
    name: str, values: dict[str, float], channel: int, sign: int, plant: Plant, held: Held
) -> None:
    """Heading north at speed, each effect moves the speed it should in the direction it should."""
    base = held(plant)[-1]
    assert sign * (_end(held, plant, name, values)[channel] - base[channel]) > 1e-4


@pytest.mark.parametrize(("name", "values", "sign"), [
    ("yaw_damping", {"factor": 1.3}, -1),
    ("hull_lengthening", {"length_m": 5.0}, -1),
    ("loading", {"mass_factor": 1.3}, -1),
    ("shallow_water", {"depth_m": 5.0}, -1),
])  # fmt: skip
def test_signs_in_the_start_of_a_turn(
    name: str, values: dict[str, float], sign: int, plant: Plant, held: Held
) -> None:
    """More damping, length or mass: after five seconds of helm the ship has turned less."""
    options = {"angle_deg": (20.0, 20.0), "seconds": 5}
    base = abs(held(plant, **options)[-1, 2])
    assert sign * (abs(_end(held, plant, name, values, **options)[2]) - base) > 1e-3


def test_cross_flow_drag_touches_two_coefficients_and_wind_load_the_wind(plant: Plant, held: Held) -> None:
    """Cross-flow drag scales Y|v|v and N|v|v alone; the wind's factor is nothing without air moving past."""
    more = CATALOGUE["cross_flow_drag"].apply(plant, {"factor": 2.0})
    changed = {name for name, value in plant.numbers().items() if more.number(name) != value}
    assert changed == {"Y_absv_v", "N_absv_v"}
    beam = {"wind": (90.0, 12.0), "rpm": (0.0, 0.0), "start": (0.0,) * 6}
    assert _end(held, plant, "wind_load", {"factor": 2.0}, **beam)[1] < 1.5 * held(plant, **beam)[-1, 1] < 0.0


def test_lag_makes_a_step_of_the_helm_act_late(plant: Plant) -> None:
    """With a lag of one second the turn after a step of the helm is what it was a second before."""
    from seatrial.hybrid.vessel.dynamics import simulate

    K = 300
    controls = np.tile([2.5, 0.0, 2.5, 0.0, 0.0], (K, 1))
    controls[20:, (1, 3)] = 0.2
    start, wind = [0.0, 0.0, 0.0, 4.5, 0.0, 0.0], np.zeros((K, 2))
    late = CATALOGUE["thruster_lag"].apply(plant, {"time_constant_s": 1.0})
    prompt_heading = simulate(plant, start, controls, wind, 0.1)[:, 2]
    late_heading = simulate(late, start, controls, wind, 0.1)[:, 2]
    assert late_heading[-1] == pytest.approx(prompt_heading[-11], rel=5e-3)


def test_lag_does_not_depend_on_the_step(plant: Plant) -> None:
    """The lag's update is exact, so that a run in two substeps is the run in eight."""
    from seatrial.hybrid.vessel.dynamics import simulate

    controls = np.zeros((20, 5))
    controls[:, ::2], controls[5:, 1::2] = 2.5, 0.3
    controls[:, 4] = 0.0
    late = CATALOGUE["thruster_lag"].apply(plant, {"time_constant_s": 1.5})
    runs = [simulate(late, [0, 0, 0, 4, 0, 0], controls, np.zeros((20, 2)), 1.0, steps) for steps in (4, 32)]
    assert np.abs(runs[0] - runs[1]).max() < 1e-2


def test_azimuth_offset_equals_pointing_the_pods_there(plant: Plant, held: Held) -> None:
    """True angle = reported + offset."""
    offset = CATALOGUE["azimuth_offset_both"].apply(plant, {"angle_deg": 7.0})
    pointed = held(plant, angle_deg=(10.0, 10.0))
    assert held(offset, angle_deg=(3.0, 3.0)) == pytest.approx(pointed, abs=1e-12)


def test_wind_vane_bias_is_taken_out_of_the_reported_direction(plant: Plant, held: Held) -> None:
    """Reported = true + bias, so the ship feels reported - bias."""
    biased = CATALOGUE["wind_direction_bias"].apply(plant, {"angle_deg": 30.0})
    assert held(biased, wind=(75.0, 10.0)) == pytest.approx(held(plant, wind=(45.0, 10.0)), abs=1e-12)


def test_sensor_effects_report_what_they_promise(plant: Plant, held: Held) -> None:
    """Bias, factor, lever arm and delay change the recorded values and not the motion."""
    true = held(plant, angle_deg=(10.0, 10.0))

    def reported(name: str, **values: float) -> np.ndarray:
        changed = CATALOGUE[name].apply(plant, values)
        assert np.array_equal(held(changed, angle_deg=(10.0, 10.0)), true)
        return measure(true, changed, 1.0) - true

    assert reported("heading_bias", angle_deg=2.0)[:, 2] == pytest.approx(np.deg2rad(2.0))
    assert reported("speed_scale", factor=1.1)[:, 3] == pytest.approx(0.1 * true[:, 3])
    lever = reported("position_antenna_offset", forward_m=3.0, starboard_m=-1.0)
    heading = true[:, 2]
    assert lever[:, 0] == pytest.approx(3.0 * np.cos(heading) + np.sin(heading))
    assert lever[:, 1] == pytest.approx(3.0 * np.sin(heading) - np.cos(heading))


def test_a_late_position_is_where_the_ship_was(plant: Plant, held: Held) -> None:
    """A delay of two samples gives the positions of two samples before, and half a one lies between."""
    true = held(plant, angle_deg=(20.0, 20.0))
    two = measure(true, CATALOGUE["position_delay"].apply(plant, {"seconds": 2.0}), 1.0)
    assert two[2:, :2] == pytest.approx(true[:-2, :2], abs=1e-2)  # from speeds a second apart
    fine = held(plant, angle_deg=(20.0, 20.0), seconds=1, substeps=8)
    half = measure(true, CATALOGUE["position_delay"].apply(plant, {"seconds": 0.5}), 1.0)
    controls = np.tile([2.5, np.deg2rad(20.0)] * 2 + [0.0], (60, 1))
    from seatrial.hybrid.vessel.dynamics import simulate

    exact = simulate(plant, true[0], controls, np.zeros((60, 2)), 0.5)[1::2]
    assert half[1:, :2] == pytest.approx(exact[:, :2], abs=5e-3)
    assert fine[0] == pytest.approx(true[0])
    assert half[0, 0] == pytest.approx(-0.5 * true[0, 3])


def test_lengthening_scales_as_the_model_says(plant: Plant) -> None:
    """Mass with s, yaw inertia with s^3, resistance with s^0.8, each r one more lever arm."""
    s = (28.9 + 5.0) / 28.9
    long = CATALOGUE["hull_lengthening"].apply(plant, {"length_m": 5.0})
    powers = {"mass_kg": 1, "Yvd": 1, "Yrd": 2, "Nrd": 3, "Xuu": 0.8, "Xrr": 3, "Xu_absv": 1, "Yrrv": 3}
    powers |= {"Y_absr_r": 3, "Nuv": 2, "Nrrr": 5, "N_absv_r": 3}
    for name, power in powers.items():
        assert getattr(long, name) == pytest.approx(getattr(plant, name) * s**power), name
    assert (long.length_overall_m, long.number("port_x_m"), long.number("tunnel_x_m")) == pytest.approx(
        (36.25, -15.72, 15.58)
    )
    assert long.lateral_area_m2 == pytest.approx(192.0)


def test_shallow_water_tends_to_deep_water(plant: Plant) -> None:
    """Deeper water changes the derivatives less, and in a hundred draughts hardly at all."""

    def growth(depth: float) -> float:
        return CATALOGUE["shallow_water"].apply(plant, {"depth_m": depth}).Yvd / plant.Yvd - 1.0

    assert growth(4.0) > growth(8.0) > growth(20.0)
    assert abs(growth(260.0)) < 0.01


def test_the_long_ship_is_the_short_one_with_an_effect(vessel: Vessel) -> None:
    """Her file adds the lengthening to the short ship's model."""
    long = load_vessel("gunnerus_long")
    assert long.base == "gunnerus_short"
    assert vessel_plant(long) == apply_effects(vessel_plant(vessel), {"hull_lengthening": {"length_m": 5.0}})


@pytest.mark.parametrize(("text", "hint"), [
    ("hull_foulin:resistance_factor=1.2", "hull_fouling"),
    ("hull_fouling:factor=1.2", "resistance_factor"),
    ("hull_fouling:resistance_factor=heavy", "resistance_factor=1.2"),
    ("hull_fouling", "resistance_factor=1.2"),
    ("hull_fouling:resistance_factor=99", "0 to 5"),
    ("thrust_loss_port:fraction=nan", "-0.5 to 1"),
])  # fmt: skip
def test_wrong_effects_are_refused_with_what_is_possible(text: str, hint: str) -> None:
    """A wrong name, parameter or value says what may be given."""
    with pytest.raises(ConfigurationError, match=hint):
        parse_effect(text)
