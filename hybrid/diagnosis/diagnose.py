"""The diagnosis in six stages: linearise, noise, evidence, selection, acceptance, verdict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import pandas as pd
from threadpoolctl import threadpool_limits

from acquisition.core.errors import ConfigurationError
from acquisition.core.progress import Progress, part_of
from hybrid.diagnosis.acceptance import Acceptance, accept
from hybrid.diagnosis.change import likeliest_change, may_change
from hybrid.diagnosis.coarse_model import selected, untested_if_coarse
from hybrid.diagnosis.course import with_recordings
from hybrid.diagnosis.estimate_noise import choose_input_hold, estimate_noise
from hybrid.diagnosis.evidence import weigh_evidence
from hybrid.diagnosis.linearise import Linearisation, linearise, model_of
from hybrid.diagnosis.log import log_of
from hybrid.diagnosis.verdict import Conclusion, reach_verdict
from hybrid.effects import Catalogue
from hybrid.effects.catalogue import catalogue_of
from hybrid.vessel.parameters import Vessel

CHANGES = 3
"""The largest number of effects that may vary over a trial."""

TOLERANCE = 0.01
"""The default model error allowed, as a share of the force range."""


def diagnose(
    tables: Sequence[pd.DataFrame],
    vessel: Vessel,
    tolerance: float = TOLERANCE,
    catalogue: Catalogue | None = None,
    progress: Progress = lambda share: None,
) -> Conclusion:
    """Diagnose tables of samples of the ship's channels against the model of ``vessel``.

    ``tolerance`` is the model error allowed, as a share of the force range. Raises :class:`ConfigurationError`
    for an impossible tolerance, :class:`DataShortageError` and :class:`InputError` for tables that lack what is
    needed.
    """
    if not 0.0 < tolerance < 1.0:
        raise ConfigurationError(
            f"a tolerance of {100.0 * tolerance:g} % is impossible", fix="give more than 0 and less than 100"
        )

    def part(first: float, last: float) -> Progress:
        return lambda share: progress(first + (last - first) * share)

    with threadpool_limits(1, user_api="blas"):  # nested in the filter's own threads they would only wait
        every = catalogue_of(vessel) if catalogue is None else catalogue
        log = log_of(tables)
        model = model_of(vessel, with_recordings(every, log))
        acceptance = accepted_of(linearise(log, model, tolerance), part(0.1, 0.6))
        return reach_verdict(with_changes(acceptance), part(0.6, 1.0))


def accepted_of(linearisation: Linearisation, progress: Progress = lambda share: None) -> Acceptance:
    """Stages two to five: the effects that pass all tests, and what they leave unexplained."""
    estimate = estimate_noise(linearisation, part_of(progress, 0, 3))
    estimate = choose_input_hold(estimate, part_of(progress, 1, 3))
    selection = selected(weigh_evidence(estimate), part_of(progress, 2, 3))
    return untested_if_coarse(selection) or accept(selection)


def with_changes(acceptance: Acceptance) -> Acceptance:
    """Add effects that vary over the trial, one after another, as long as they are accepted."""
    for _ in range(CHANGES):
        change = likeliest_change(acceptance) if may_change(acceptance) else None
        if change is None:
            break
        known = acceptance.evidence.equations
        model = replace(known.model, at={}, catalogue={**known.model.catalogue, change.name: change})
        again = accepted_of(linearise(known.log, model, known.tolerance))
        if change.name not in again.names:
            break
        acceptance = again
    return acceptance
