"""The diagnosis in six stages: linearise, noise, evidence, selection, acceptance, verdict."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd
from threadpoolctl import threadpool_limits

from acquisition.core.errors import ConfigurationError
from acquisition.core.progress import Progress
from hybrid.diagnosis.acceptance import accept
from hybrid.diagnosis.coarse_model import untested_if_coarse
from hybrid.diagnosis.course import with_recordings
from hybrid.diagnosis.estimate_noise import choose_input_hold, estimate_noise
from hybrid.diagnosis.evidence import weigh_evidence
from hybrid.diagnosis.linearise import linearise, model_of
from hybrid.diagnosis.log import log_of
from hybrid.diagnosis.select_effects import select_effects
from hybrid.diagnosis.verdict import Conclusion, reach_verdict
from hybrid.effects import Catalogue
from hybrid.effects.catalogue import catalogue_of
from hybrid.vessel.parameters import Vessel

TOLERANCE = 0.01
"""The share of the force range that a reference model is granted to be off by, unless told otherwise."""


def diagnose(
    tables: Sequence[pd.DataFrame],
    vessel: Vessel,
    tolerance: float = TOLERANCE,
    catalogue: Catalogue | None = None,
    progress: Progress = lambda share: None,
) -> Conclusion:
    """Diagnose raw tables of the 13 channels against the model of ``vessel``.

    ``tolerance`` is the share of the force range that the model is granted. Raises :class:`ConfigurationError` for
    an impossible tolerance, :class:`DataShortageError` and :class:`InputError` for tables without what it takes.
    """
    if not 0.0 < tolerance < 1.0:
        raise ConfigurationError(
            f"a tolerance of {100.0 * tolerance:g} % is impossible", fix="give more than 0 and less than 100"
        )

    def part(first: float, last: float) -> Progress:
        return lambda share: progress(first + (last - first) * share)

    with threadpool_limits(1, user_api="blas"):  # the filter has its own threads, and more only wait for each other
        every = catalogue_of(vessel) if catalogue is None else catalogue
        log = log_of(tables)
        linearisation = linearise(log, model_of(vessel, with_recordings(every, log)), tolerance)
        estimate = estimate_noise(linearisation, part(0.1, 0.3))
        estimate = choose_input_hold(estimate, part(0.3, 0.4))
        evidence = weigh_evidence(estimate)
        selection = select_effects(evidence, part(0.4, 0.6))
        acceptance = untested_if_coarse(selection) or accept(selection)
        return reach_verdict(acceptance, part(0.6, 1.0))
