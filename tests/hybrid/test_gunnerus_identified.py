"""The lengthened R/V Gunnerus as identified: she turns and stops, and foretells what she was not made from."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import pytest

from seatrial.acquisition.core.ship import VESSELS
from seatrial.acquisition.tables.import_table import import_table
from seatrial.analysis.tables.resample import resample
from seatrial.analysis.windows.held import second_by_second
from seatrial.hybrid.effects import vessel_plant
from seatrial.hybrid.prediction.baselines import constant_velocity, score, simulate_reference
from seatrial.hybrid.prediction.dataset import dataset_of
from seatrial.hybrid.vessel.dynamics import simulate_batch
from seatrial.hybrid.vessel.files import load_vessel, ship_names_of_vessel
from seatrial.hybrid.workflows import usable_tables

PARTS = {
    "gunnerus_2019_docking": "docking_2019-11-09_part1.csv",
    "gunnerus_2022_trials": "trials_2022-10-27_part1.csv",
}
SHIP = load_vessel("gunnerus_identified")


def run(azimuth_deg: float, rpm: float, surge_mps: float, seconds: int = 120) -> np.ndarray:
    controls = np.zeros((1, seconds, 5))
    controls[..., [0, 2]], controls[..., [1, 3]] = rpm / 60.0, np.radians(azimuth_deg)
    start = np.array([[0.0, 0.0, 0.0, surge_mps, 0.0, 0.0]])
    return simulate_batch(vessel_plant(SHIP), start, controls, np.zeros((1, seconds, 2)), 1.0).states[0]


def test_she_is_a_model_of_the_lengthened_ship() -> None:
    assert "gunnerus_long" in ship_names_of_vessel(SHIP)
    assert SHIP.inertia.mass_kg == load_vessel("gunnerus_long").inertia.mass_kg  # type: ignore[union-attr]
    assert SHIP.provenance["identified_start"] == "gunnerus_long"


def test_she_turns_as_the_trials_of_2022_show_and_alike_to_both_sides() -> None:
    """Steady turns of the half that took no part: 2.13 deg/s under -8.8 deg, -2.35 under 10.3, both at 171 rpm."""
    port, starboard = (np.degrees(run(angle, 171.0, 4.8)[-1, 5]) for angle in (-8.8, 10.3))
    assert port == pytest.approx(2.13, rel=0.15)
    assert starboard == pytest.approx(-2.35, rel=0.15)
    assert run(8.8, 171.0, 4.8)[-1, 5] == pytest.approx(-run(-8.8, 171.0, 4.8)[-1, 5])


def test_she_keeps_her_course_comes_out_of_a_turn_and_stops_astern() -> None:
    ahead = run(0.0, 170.0, 5.0)
    assert ahead[-1, 3] == pytest.approx(5.4, abs=0.3)  # measured at 170 rpm: 5.2 to 5.6 m/s
    turning = run(20.0, 170.0, 5.0)[-1]
    controls = np.zeros((1, 120, 5))
    controls[..., [0, 2]] = 170.0 / 60.0
    after = simulate_batch(vessel_plant(SHIP), turning[None], controls, np.zeros((1, 120, 2)), 1.0).states[0]
    assert abs(np.degrees(after[-1, 5])) < 0.05
    assert (run(0.0, -150.0, 5.0)[:, 3] < 0.0).any()


@pytest.mark.slow
def test_she_foretells_the_halves_that_she_was_not_made_from(shared_data: Path, tmp_path: Path) -> None:
    for name, file in PARTS.items():
        columns = VESSELS.parent / "columns" / f"{name}.toml"
        import_table(shared_data / name / file, tmp_path / f"{name}.mcap", columns)
    paths = {name: tmp_path / f"{name}.mcap" for name in PARTS}
    tables, _ = usable_tables(paths, (50.0, 100.0), repaired=True, rebuild_positions=True)
    for name, most in (("gunnerus_2019_docking", 0.6), ("gunnerus_2022_trials", 1.0)):
        even = {name: second_by_second(partial(resample, tables[name]))}
        windows = dataset_of(even, 15, 5, any_commands=True, length_m=36.25).windows
        tracks = [constant_velocity(windows)]
        tracks += [
            simulate_reference(windows, vessel_plant(load_vessel(each))) for each in ("gunnerus_long", SHIP.name)
        ]
        inside = np.isfinite(np.stack([*tracks, windows.track])).all(axis=(0, 2, 3))
        held_m, before_m, after_m = (
            score(track[inside], windows.track[inside]).mean_distance_m for track in tracks
        )
        print(f"{name}: {held_m:.3f} m constant velocity, {before_m:.3f} m gunnerus_long, {after_m:.3f} m")  # noqa: T201
        assert after_m < most * held_m
        assert after_m < 0.75 * before_m
