"""The input hold: how thruster settings are to be read between their records.

A drive moves from record to record, and a straight line between them is near the truth. A recorder, or a simulator,
that takes a setting and holds it until the next makes steps, half a record later or earlier in the mean than the
line: at one record a second enough to pass for what a ship lacks. The motion itself says which it is, and loudly.
"""

from __future__ import annotations

from acquisition.core.progress import Progress
from hybrid.diagnosis.acceptance import accept_names
from hybrid.diagnosis.estimate_noise import estimate_noise, spread_out
from hybrid.diagnosis.evidence import weigh_evidence
from hybrid.diagnosis.linearise import linearise
from hybrid.diagnosis.log import INPUT_HOLDS, SELDOM_S, InputHold
from hybrid.diagnosis.noise import NoiseEstimate
from hybrid.diagnosis.select_effects import log_density, search_effects, select_effects

_ENOUGH_S = 600.0  # of the log: it shows in every turn
_PLAIN = 20.0  # log likelihood by which steps have to be better than lines


def choose_input_hold(estimate: NoiseEstimate, progress: Progress = lambda share: None) -> NoiseEstimate:
    """The estimate with settings held as the motion asks for: as lines, or else as steps and the noise anew."""
    hold = max(INPUT_HOLDS, key=lambda each: _log_density(estimate, each))  # the first of equals: lines
    known = estimate.linearisation
    if hold == known.log.input_hold:
        return estimate
    return estimate_noise(linearise(known.log.with_input_hold(hold), known.model, known.tolerance), progress)


def _log_density(estimate: NoiseEstimate, hold: InputHold) -> float:
    """Of a part of the data with what is missing in the model so read, less what steps have to be better by.

    Where settings come seldom, a lag or a delay is as large as the difference: it has to be selected at its size.
    """
    known = estimate.linearisation
    as_it_is = hold == known.log.input_hold
    log = known.log if as_it_is else known.log.with_input_hold(hold)
    part = linearise(log.subset(spread_out(log, _ENOUGH_S)), known.model, known.tolerance)
    evidence = weigh_evidence(NoiseEstimate(part, estimate.noise))
    if log.setting_step_s > SELDOM_S:
        found = accept_names(select_effects(evidence))
        density = log_density(found.evidence, found.names)
    else:
        density = log_density(evidence, search_effects(evidence))
    return density if as_it_is else density - _PLAIN
