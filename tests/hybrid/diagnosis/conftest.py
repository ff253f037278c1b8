"""Trials of the other simulator, diagnosed; each once in a session."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from seatrial.hybrid.diagnosis.acceptance import Acceptance, accept_names, select_effects
from seatrial.hybrid.diagnosis.estimate_noise import estimate_noise
from seatrial.hybrid.diagnosis.linearise import ModelWithEffects, linearise
from seatrial.hybrid.diagnosis.log import log_of
from seatrial.hybrid.diagnosis.regression import weigh_evidence
from seatrial.hybrid.effects import CATALOGUE
from seatrial.hybrid.vessel.plant import Plant
from tests.benchmarks.other_ship.trial import make_trial

Diagnosed = Callable[..., Acceptance]
TOLERANCE = 0.01


@pytest.fixture(scope="session")
def diagnosed(plant: Plant) -> Diagnosed:
    """What is named in a trial; keywords as those of the simulator, one asked for before is given again."""

    def naming(**trial: Any) -> Acceptance:
        table, _ = make_trial(**trial)
        model = ModelWithEffects(plant, CATALOGUE)
        estimate = estimate_noise(linearise(log_of([table]), model, TOLERANCE))
        return accept_names(select_effects(weigh_evidence(estimate)))

    known: dict[str, Acceptance] = {}

    def once(**trial: Any) -> Acceptance:
        key = repr(trial)
        if key not in known:
            known[key] = naming(**trial)
        return known[key]

    return once
