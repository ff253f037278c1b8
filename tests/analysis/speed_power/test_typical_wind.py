"""Typical coefficients of wind resistance, and those of a ship's own table."""

from __future__ import annotations

from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from seatrial.acquisition.config.run_sheet import Conditions, WindType
from seatrial.acquisition.core.errors import InputError
from seatrial.analysis.speed_power.formulas import (
    TYPICAL_WIND_RESISTANCE,
    read_wind_resistance,
    wind_resistance_n,
    wind_resistance_of,
)


def test_every_kind_of_ship_brakes_ahead_and_is_pushed_from_astern() -> None:
    assert set(TYPICAL_WIND_RESISTANCE) == set(get_args(WindType))
    for curve in TYPICAL_WIND_RESISTANCE.values():
        assert 180 % (len(curve) - 1) == 0  # equal steps of whole degrees
        assert 0.5 < curve[0] < 1.2
        assert -1.2 < curve[-1] < -0.5
        assert np.count_nonzero(np.diff(np.sign(curve))) == 1


def test_own_coefficients_stand_above_the_typical_ones() -> None:
    tanker = Conditions(wind_resistance_type="tanker_loaded", frontal_area_m2=1000.0)
    assert wind_resistance_of(tanker)[:2] == (0.96, 0.93)
    assert (
        wind_resistance_of(Conditions(wind_resistance=(1.0, -1.0), wind_resistance_type="tanker_loaded"))[0] == 1.0
    )
    # 0.5 * 1.225 * 1000 * 0.96 * (15^2 - 7^2) N, head wind of 8 m/s at 7 m/s
    found = wind_resistance_n(tanker, *(np.array([value]) for value in (0.0, 7.0, 0.0, 8.0)))
    assert found[0] == pytest.approx(0.5 * 1.225 * 1000.0 * 0.96 * (225.0 - 49.0))


def test_coefficients_come_from_a_table_in_any_order(tmp_path: Path) -> None:
    path = tmp_path / "wind.csv"
    path.write_text("angle [deg],C_AA\n180,-0.7\n0,0.9\n90,0.1\n")
    curve = read_wind_resistance(path)
    assert len(curve) == 37
    assert (curve[0], curve[18], curve[-1]) == (0.9, 0.1, -0.7)
    assert curve[9] == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("angle,C_X\n0,1\n180,-1\n90,0\n", "has no columns angle and C_AA"),
        ("angle,C_AA\n0,1\n90,0\n100,-1\n", "does not go from 0 to 180 deg"),
        ("angle,C_AA\n0,-0.9\n90,0\n180,0.7\n", "change the sign"),
        ("angle,C_AA\n0,much\n90,0\n180,0.7\n", "holds text among its numbers"),
    ],
)
def test_a_table_that_is_none_of_coefficients_is_refused(tmp_path: Path, text: str, why: str) -> None:
    path = tmp_path / "wind.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=why):
        read_wind_resistance(path)
