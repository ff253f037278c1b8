"""The diagnosis in six stages: linearise, noise, evidence, selection, acceptance, verdict.

The noise is estimated for linear interpolation of the thruster settings between records, then again if the drives
moved in steps: a drive moves gradually from record to record, and a line is close to the truth; but a recorder or
simulator that holds each setting until the next record makes steps, which lead or lag the line by half a record: at
one record a second, enough to be mistaken for a missing effect. The motion shows clearly which of the two it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pandas as pd
from threadpoolctl import threadpool_limits

from seatrial.acquisition.core.errors import ConfigurationError, Progress, part_of
from seatrial.hybrid.diagnosis.acceptance import Acceptance, accept, accept_names
from seatrial.hybrid.diagnosis.change import likeliest_change, may_change
from seatrial.hybrid.diagnosis.coarse_model import preliminary_selection, selected, untested_if_coarse
from seatrial.hybrid.diagnosis.disturbance_model import NoiseEstimate
from seatrial.hybrid.diagnosis.estimate_noise import estimate_noise
from seatrial.hybrid.diagnosis.evidence import FEW, evidence_of, normal_equations, weigh_evidence
from seatrial.hybrid.diagnosis.linearise import Linearisation, linearise, model_of, with_recordings
from seatrial.hybrid.diagnosis.log import INPUT_HOLDS, SELDOM_S, InputHold, log_of
from seatrial.hybrid.diagnosis.select_effects import log_density, search_effects
from seatrial.hybrid.diagnosis.verdict import Conclusion, reach_verdict
from seatrial.hybrid.effects import Catalogue
from seatrial.hybrid.effects.catalogue import catalogue_of
from seatrial.hybrid.vessel.parameters import Vessel

CHANGES = 3
"""The largest number of effects that may vary over a trial."""

TOLERANCE = 0.01
"""The default model error allowed, as a share of the force range."""

_ENOUGH_S = 600.0  # seconds of the log: every turn shows the input hold
_PLAIN = 20.0  # margin in log likelihood by which steps must beat linear interpolation


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
        effects = catalogue_of(vessel) if catalogue is None else catalogue
        log = log_of(tables)
        model = model_of(vessel, with_recordings(effects, log))
        acceptance = accepted_of(linearise(log, model, tolerance), part(0.1, 0.6))
        return reach_verdict(add_time_varying_effects(acceptance), part(0.6, 1.0))


def accepted_of(linearisation: Linearisation, progress: Progress = lambda share: None) -> Acceptance:
    """Stages two to five: the effects that pass all tests, and what they leave unexplained."""
    estimate = estimate_noise(linearisation, part_of(progress, 0, 3))
    estimate = choose_input_hold(estimate, part_of(progress, 1, 3))
    selection = selected(weigh_evidence(estimate), part_of(progress, 2, 3))
    return untested_if_coarse(selection) or accept(selection)


def choose_input_hold(estimate: NoiseEstimate, progress: Progress = lambda share: None) -> NoiseEstimate:
    """The estimate with the input hold that fits the motion best; for steps the noise is estimated anew."""
    linearisation, best, most = estimate.linearisation, INPUT_HOLDS[0], -np.inf
    for hold in INPUT_HOLDS:  # of equals the first: linear
        density = _log_evidence(estimate, hold, most)
        if density > most:
            best, most = hold, density
    if best == linearisation.log.input_hold:
        return estimate
    return estimate_noise(
        linearise(linearisation.log.with_input_hold(best), linearisation.model, linearisation.tolerance), progress
    )


def _log_evidence(estimate: NoiseEstimate, hold: InputHold, least: float) -> float:
    """Log evidence of an input hold on part of the data, less the margin by which steps have to be better.

    With sparse settings the difference is as large as a lag or a delay, so such effects are selected first at
    their size, unless after two linearisations the density is below ``least``, so that steps would have to gain
    the whole margin: in 18 searches on simulated trials further linearisations gained 1 at most. For a coarse
    model none converges: the evidence changes by hundreds from one linearisation to the next, and that linearised
    about no effect is compared.
    """
    linearisation = estimate.linearisation
    margin = 0.0 if hold == linearisation.log.input_hold else _PLAIN
    log = linearisation.log.with_input_hold(hold) if margin else linearisation.log
    part = linearise(log.subset(log.spread_blocks(_ENOUGH_S)), linearisation.model, linearisation.tolerance)
    evidence = evidence_of(normal_equations(part, estimate.noise, number=FEW))
    if log.setting_step_s > SELDOM_S:
        preliminary = preliminary_selection(evidence)
        density = log_density(preliminary.evidence, preliminary.names) - margin
        if density + margin < least and not untested_if_coarse(preliminary):
            return density
        if not untested_if_coarse(selection := selected(evidence, preliminary=preliminary)):
            accepted = accept_names(selection)
            return log_density(accepted.evidence, accepted.names) - margin
    return log_density(evidence, search_effects(evidence)) - margin


def add_time_varying_effects(acceptance: Acceptance) -> Acceptance:
    """Add effects that vary over the trial, one after another, as long as they are accepted."""
    for _ in range(CHANGES):
        change = likeliest_change(acceptance) if may_change(acceptance) else None
        if change is None:
            break
        equations = acceptance.evidence.equations
        model = replace(equations.model, at={}, catalogue={**equations.model.catalogue, change.name: change})
        again = accepted_of(linearise(equations.log, model, equations.tolerance))
        if change.name not in again.names:
            break
        acceptance = again
    return acceptance
