"""The reference ship, her plant, and runs of held controls."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from seatrial.acquisition.core.quantities import Floats
from seatrial.hybrid.vessel.dynamics import simulate
from seatrial.hybrid.vessel.files import Vessel, load_vessel
from seatrial.hybrid.vessel.plant import Plant, bare_plant

Held = Callable[..., Floats]


@pytest.fixture(scope="session")
def vessel() -> Vessel:
    """R/V Gunnerus before her elongation."""
    return load_vessel("gunnerus_short")


@pytest.fixture(scope="session")
def plant(vessel: Vessel) -> Plant:
    """Her plant, without any effect."""
    return bare_plant(vessel)


@pytest.fixture(scope="session")
def held() -> Held:
    """A run of held controls: rpm and degrees in, states [K+1, 6] out, a sample a second."""

    def run(
        plant: Plant,
        *,
        rpm: tuple[float, float] = (150.0, 150.0),
        angle_deg: tuple[float, float] = (0.0, 0.0),
        tunnel_rpm: float = 0.0,
        wind: tuple[float, float] = (0.0, 0.0),
        start: tuple[float, ...] = (0.0, 0.0, 0.0, 4.0, 0.0, 0.0),
        seconds: int = 30,
        **options: float,
    ) -> Floats:
        order = [rpm[0] / 60.0, np.deg2rad(angle_deg[0]), rpm[1] / 60.0, np.deg2rad(angle_deg[1]), tunnel_rpm]
        air = [np.deg2rad(wind[0]), wind[1]]
        return simulate(plant, start, np.tile(order, (seconds, 1)), np.tile(air, (seconds, 1)), 1.0, **options)

    return run
