"""A folder with the ship of another make in all its forms, and recordings of it."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from seatrial.hybrid.simulation.trial import SimulationNoise, record_trial, simulate_trial
from tests.hybrid.own_simulator import fmus

HERE = Path(__file__).parent
Sailed = Callable[..., Path]


@pytest.fixture(scope="session")
def shipyard(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The Python file of the ship and its map."""
    folder = tmp_path_factory.mktemp("shipyard")
    shutil.copy(HERE / "sailer.txt", folder / "sailer.py")
    (folder / "sailer.toml").write_text(fmus.without_variables(fmus.MAP))
    return folder


@pytest.fixture(scope="session")
def sailed(shipyard: Path) -> Sailed:
    """Recordings of one of the ships in that file; one that was asked for before is given again."""

    def recording(ship: str, seed: int = 0, duration_s: float = 300.0, noise: float = 1.0) -> Path:
        path = shipyard / f"{ship}_{seed}_{duration_s:g}_{noise:g}.mcap"
        if not path.exists():
            level = SimulationNoise().scaled(noise)
            name = f"{shipyard}/sailer.py:{ship}"
            record_trial(*simulate_trial(name, "calm", "paper", duration_s, 1.0, seed, noise=level), path)
        return path

    return recording
