"""Trials of the other simulator, diagnosed; each once in a session."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest
from threadpoolctl import threadpool_limits

from hybrid.diagnosis.estimate_noise import settled
from hybrid.diagnosis.linearise import Model
from hybrid.diagnosis.log import log_of
from hybrid.diagnosis.select_effects import Naming, named
from hybrid.effects import CATALOGUE
from hybrid.vessel.plant import Plant
from tests.benchmarks.other_ship.trial import make_trial

Diagnosed = Callable[..., Naming]
TOLERANCE = 0.01


@pytest.fixture(scope="module", autouse=True)
def one_thread() -> Iterator[None]:
    """Linear algebra on one thread: the matrices here are small, and threads that wait for each other are slow."""
    with threadpool_limits(1, user_api="blas"):
        yield


@pytest.fixture(scope="session")
def diagnosed(plant: Plant) -> Diagnosed:
    """What is named in a trial; keywords as those of the simulator, one asked for before is given again."""

    def naming(**trial: Any) -> Naming:
        table, _ = make_trial(**trial)
        model = Model(plant, CATALOGUE)
        log, noise = settled(log_of([table]), model, TOLERANCE)
        return named(log, model, TOLERANCE, noise)

    known: dict[str, Naming] = {}

    def once(**trial: Any) -> Naming:
        key = repr(trial)
        if key not in known:
            known[key] = naming(**trial)
        return known[key]

    return once
