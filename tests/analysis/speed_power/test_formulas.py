"""The corrections of a run against their equations in another form, published values and limits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from seatrial.acquisition.config.run_sheet import Conditions
from seatrial.acquisition.core.quantities import Floats
from seatrial.analysis.speed_power.formulas import (
    ideal_power_kw,
    lackenby_mps,
    raven_kw,
    viscosity_m2ps,
    water_resistance_n,
    wind_resistance_n,
)
from seatrial.hybrid.effects import vessel_plant
from seatrial.hybrid.vessel.files import conditions_of, load_vessel
from seatrial.hybrid.vessel.plant import pack
from tests.force_calls import wind_force

SHIP = Conditions(
    length_m=180.0, beam_m=32.0, draught_m=11.0, displacement_m3=48_000.0, midship_section_m2=345.0,
    wetted_area_m2=8_000.0, waterplane_area_m2=4_900.0, form_factor=1.2, bow_length_m=40.0,
    frontal_area_m2=620.0, wind_resistance=(0.8, 0.85, 0.7, 0.1, -0.5, -0.75, -0.65), propulsive_efficiency=0.7,
)  # fmt: skip


def arrays(*values: float) -> tuple[Floats, ...]:
    return tuple(np.array([value]) for value in values)


@pytest.mark.parametrize("vessel", ["gunnerus_short", "esso_osaka_3m"])
def test_wind_takes_what_the_vessel_file_says(vessel: str) -> None:
    """The air's force of the simulation, less that of still air, for every direction."""
    ship = load_vessel(vessel)
    plant = pack(vessel_plant(ship))[0]
    density = replace(conditions_of(ship), air_density_kgpm3=float(plant["air_density_kgpm3"]))
    for off in range(0, 360, 10):
        true, speed = 6.0, 4.0
        u = speed + true * np.cos(np.deg2rad(off))
        v = true * np.sin(np.deg2rad(off))
        force = wind_force(plant, u, v)[0] - wind_force(plant, speed, 0.0)[0]
        found = wind_resistance_n(density, *arrays(20.0, speed, (20.0 + off) % 360.0, true))
        assert found[0] == pytest.approx(-force, rel=0.02, abs=2e-3 * abs(wind_force(plant, speed, 0.0)[0]))


def test_still_air_asks_for_no_correction() -> None:
    assert wind_resistance_n(SHIP, *arrays(20.0, 7.0, 0.0, 0.0))[0] == pytest.approx(0.0, abs=1e-9)


def test_a_high_anemometer_measures_too_much() -> None:
    """Wind grows with the seventh root of the height (ISO 15016:2015)."""
    low = wind_resistance_n(SHIP, *arrays(0.0, 7.0, 0.0, 8.0))
    high = wind_resistance_n(
        replace(SHIP, anemometer_height_m=40.0), *arrays(0.0, 7.0, 0.0, 8.0 * 4.0 ** (1.0 / 7.0))
    )
    assert high == pytest.approx(low)


@pytest.mark.parametrize(
    ("temperature", "density", "published"),
    [(15.0, 1026.0, 1.1883e-6), (10.0, 1027.0, 1.3604e-6), (25.0, 1023.4, 0.9433e-6), (15.0, 999.1, 1.1386e-6)],
)
def test_viscosity_is_that_of_ittc(temperature: float, density: float, published: float) -> None:
    """ITTC 7.5-02-01-03 (2011), sea water of 3.5 % salt and fresh water."""
    assert viscosity_m2ps(temperature, density) == pytest.approx(published, rel=1e-2)


def test_water_of_the_reference_asks_for_no_correction_and_warm_water_flatters() -> None:
    here = replace(SHIP, water_temperature_degc=15.0)
    assert water_resistance_n(here, *arrays(7.0, 5000.0))[0] == pytest.approx(0.0, abs=1e-6)
    assert water_resistance_n(replace(here, water_temperature_degc=28.0), *arrays(7.0, 5000.0))[0] < 0.0
    wide = replace(here, water_density_kgpm3=1036.0, wetted_area_m2=1.0)  # no friction to speak of
    towed_n = 5e6 * 0.7 / 7.0
    assert water_resistance_n(wide, *arrays(7.0, 5000.0))[0] == pytest.approx(towed_n * 10.0 / 1036.0, rel=1e-3)


@pytest.mark.parametrize("variation", [0.0, -0.15])
def test_ideal_power_solves_the_equations_of_the_direct_power_method(variation: float) -> None:
    """P_id = P_ms - dR V / eta_id - P_ms (1 - eta_ms / eta_id), eta_ms / eta_id = 1 + xi dR / R_id."""
    given, speed, power, added = replace(SHIP, load_variation=variation), *arrays(7.2, 6000.0, 60_000.0)
    ideal = ideal_power_kw(given, power, added, speed)
    own_n = 1e3 * ideal * 0.7 / speed
    ratio = 1.0 + variation * added / own_n
    assert ideal == pytest.approx(power - 1e-3 * added * speed / 0.7 - power * (1.0 - ratio))


def test_shallow_water_slows_by_lackenby_s_formula() -> None:
    """His loss in percent: 12.42 (A_M / h^2 - 0.05) + 100 (1 - sqrt(tanh(g h / V^2)))."""
    percent = 12.42 * (345.0 / 900.0 - 0.05) + 100.0 * (1.0 - np.sqrt(np.tanh(9.80665 * 30.0 / 49.0)))
    assert lackenby_mps(SHIP, *arrays(7.0, 30.0))[0] == pytest.approx(0.07 * percent)
    assert lackenby_mps(SHIP, *arrays(7.0, 500.0))[0] == 0.0


def test_raven_s_correction_grows_as_the_water_gets_shallow_and_ends_in_deep() -> None:
    powers = [float(raven_kw(SHIP, *arrays(7.0, 6000.0, depth))[0]) for depth in (25.0, 35.0, 60.0, 1000.0)]
    assert powers == sorted(powers)
    assert powers[-1] == pytest.approx(6000.0, rel=2e-3)
    assert 5000.0 < powers[0] < 5800.0
