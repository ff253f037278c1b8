"""Simulated trials with their noise-free truth as a table of its own; each is sailed once a session."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import pandas as pd
import pytest

from seatrial.hybrid.simulation.trial import SimulationNoise, simulate_trial
from seatrial.hybrid.vessel.sensors import states_as_table


@dataclass(frozen=True)
class Sailed:
    """A trial as recorded, and as perfect sensors at 10 Hz would have recorded it without waves."""

    recorded: pd.DataFrame
    truth: pd.DataFrame
    current_mps: tuple[float, float]


Sail = Callable[..., Sailed]


@pytest.fixture(scope="session")
def sail() -> Sail:
    """Vessel, sea state, manoeuvre, duration [s], seed; ``every`` tenth of a second a row, noise, heading."""

    @cache
    def sailed(
        vessel: str, sea: str, manoeuvre: str, duration_s: float, seed: int = 1, every: int = 5,
        noise: float = 1.0, heading_deg: float = 0.0,
    ) -> Sailed:  # fmt: skip
        table, truth = simulate_trial(
            vessel,
            sea,
            manoeuvre,
            duration_s,
            10.0,
            seed,
            noise=SimulationNoise().scaled(noise),
            heading_deg=heading_deg,
        )
        perfect = states_as_table(truth["states"], truth["controls"], truth["wind"], index=table.index)
        plant = truth["plant"]
        return Sailed(table.iloc[::every], perfect, (plant.current_north_mps, plant.current_east_mps))

    return sailed
