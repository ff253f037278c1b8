"""The length that criteria and ship lengths count by is that of the model which sails."""

from __future__ import annotations

from pathlib import Path

import pytest

from seatrial.acquisition.config.declarations import length_of_ship
from seatrial.hybrid.effects import vessel_plant
from seatrial.hybrid.vessel.files import load_vessel

VESSELS = sorted(path.stem for path in (Path(__file__).parents[2] / "trials" / "vessels").glob("*.toml"))


@pytest.mark.parametrize("name", VESSELS)
def test_the_length_of_a_ship_is_that_of_her_model(name: str, tmp_path: Path) -> None:
    """Of R/V Gunnerus as lengthened, too, whose file builds on that of the ship before."""
    model_m = vessel_plant(load_vessel(name)).length_between_perpendiculars_m
    assert length_of_ship(name, tmp_path) == pytest.approx(model_m)


def test_a_lengthened_ship_is_as_long_as_published(tmp_path: Path) -> None:
    assert length_of_ship("gunnerus_long", tmp_path) == pytest.approx(33.9)
