"""How far predictions are off before and after, on windows that took no part in naming or fitting.

The legs are dealt into folds. What is predicted on a fold's windows is predicted by the model with the effects that
the other folds ask for, at the sizes that they give, so that every window judges once and none judges itself.
Windows start from the smoothed motion and run with the measured thruster settings, held or not.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from acquisition.core.arrays import Floats, Ints
from analysis.estimation.process_models import decay
from hybrid.diagnosis.acceptance import FALSE_ALARM
from hybrid.diagnosis.disturbance_model import FORCE_UNITS, Columns, Noise, smooth_state
from hybrid.diagnosis.evidence import Evidence, NormalEquations, evidence_of
from hybrid.diagnosis.linearise import DT_S, Model, acting_settings, one_second_paths, sampling_offset, true_states
from hybrid.diagnosis.log import STEPS_PER_SECOND, Log
from hybrid.diagnosis.result import Gap, Tracks
from hybrid.diagnosis.select_effects import Coordinates, fitted_coordinates, search_effects
from hybrid.prediction.baselines import present_motion_held
from hybrid.prediction.scores import distances
from hybrid.vessel.plant import Plant
from hybrid.vessel.sensors import measure
from hybrid.vessel.simulate import simulate_batch

HORIZON_S = 15
FOLDS = 4


@dataclass(frozen=True, slots=True)
class HeldOutGap:
    """The gap, each named effect's share of it, the tracks, and what is named ``without`` the legs of each fold."""

    gap: Gap
    shares: Mapping[str, float]
    tracks: Tracks
    without: Mapping[int, Coordinates]


def fold_of(log: Log) -> Ints:
    """The fold that the leg of each second is dealt into [T]."""
    return np.asarray(log.leg % min(FOLDS, max(log.legs, 1)))


def window_starts(log: Log, horizon_s: int = HORIZON_S) -> Ints:
    """Rows at which a window of so many seconds begins that stays in one leg, one window after the other."""
    starts, row = [], 0
    while row + horizon_s < len(log):
        end = row + horizon_s
        if log.leg[row] == log.leg[end] and log.time_s[end] - log.time_s[row] == horizon_s:
            starts.append(row)
            row = end
        else:
            row += 1
    return np.array(starts, dtype=np.int64)


def predicted_tracks(log: Log, plant: Plant, origin: Floats, starts: Ints, horizon_s: int = HORIZON_S) -> Floats:
    """The track that the sensors of ``plant`` would report over each window [N, H+1, 3], NaN out of its range.

    ``origin`` [T, 6] is the motion that they would report as the log's (:func:`true_states`).
    """
    controls, acting = acting_settings(log, plant)
    rows = starts[:, None] + np.arange(horizon_s)
    settings = controls[rows].reshape(len(starts), horizon_s * STEPS_PER_SECOND, -1)
    wind = np.repeat(log.wind[rows], STEPS_PER_SECOND, axis=1)
    still = replace(plant, command_delay_s=0.0)
    runs = simulate_batch(still, origin[starts], settings, wind, DT_S, 1, acting[starts])
    return measure(runs.states[:, ::STEPS_PER_SECOND], plant, 1.0)[..., :3]


def measured_tracks(log: Log, plant: Plant, origin: Floats, starts: Ints, horizon_s: int = HORIZON_S) -> Floats:
    """What was measured over each window [N, H+1, 3], brought from the samples' times to full seconds."""
    at_seconds = log.measured - sampling_offset(log, one_second_paths(log, plant, origin))
    return at_seconds[starts[:, None] + np.arange(horizon_s + 1), :3]


def gap_on_unseen_legs(
    log: Log, evidence: Evidence, names: Sequence[str], final: Coordinates, barred: frozenset[str] = frozenset()
) -> HeldOutGap:
    """The gap on windows of legs that took no part, for what is named; ``final`` is what all legs together give.

    ``barred`` is what the other legs must not name either.
    """
    starts, model = window_starts(log), replace(evidence.equations.model, at={})
    base = model.plant()
    origin = true_states(log, base)
    seen, before = measured_tracks(log, base, origin, starts), predicted_tracks(log, base, origin, starts)
    after, lacking, without = _by_the_other_folds(log, evidence, names, starts, before, barred)
    best = _predicted_with(log, model, final, starts)
    known = np.all([np.isfinite(distances(track, seen)) for track in (before, after, best)], axis=0)

    def mean(track: Floats) -> float:
        return float(np.nanmean(distances(track, seen)[known])) if known.any() else 0.0

    floor = best if mean(best) < mean(after) else after
    gap = Gap(mean(before), mean(after), mean(floor), int(known.any(axis=1).sum()), HORIZON_S)
    shares = _shares(gap, {name: mean(track) for name, track in lacking.items()})
    present = present_motion_held(log.nominal[starts], HORIZON_S)
    tracks = Tracks(seen, before, after, floor, present, log.leg[starts], log.time_s[starts])
    return HeldOutGap(gap, shares, tracks, without)


def _by_the_other_folds(
    log: Log, evidence: Evidence, names: Sequence[str], starts: Ints, before: Floats, barred: frozenset[str]
) -> tuple[Floats, dict[str, Floats], dict[int, Coordinates]]:
    """Tracks with what other folds name, the same lacking each effect, and what is named without each fold."""
    dealt, model = fold_of(log), evidence.equations.model
    after, lacking = before.copy(), {name: before.copy() for name in names}
    without: dict[int, Coordinates] = {}
    for number in np.unique(dealt[starts]).tolist():
        mine = dealt[starts] == number
        legs = np.isin(np.arange(log.legs), log.leg[dealt == number])
        at = without[number] = _named_without(evidence, legs, barred)
        after[mine] = _predicted_with(log, model, at, starts[mine])
        for name in names:
            less = {other: free for other, free in at.items() if other != name}
            lacking[name][mine] = _predicted_with(log, model, less, starts[mine])
    return after, lacking, without


def _predicted_with(log: Log, model: Model, at: Coordinates, starts: Ints) -> Floats:
    """What the model with the effects ``at`` these sizes, and no others, predicts over each window."""
    plant = replace(model, at=at).plant()
    return predicted_tracks(log, plant, true_states(log, plant), starts)


def _shares(gap: Gap, lacking_m: Mapping[str, float]) -> dict[str, float]:
    """Each effect's share of what the gap closes by, from how far predictions are off that lack it [m]."""
    shares = {name: max(off_m - gap.after_m, 0.0) for name, off_m in lacking_m.items()}
    whole, closed = sum(shares.values()), max(gap.closed, 0.0)
    return {name: closed * share / whole if whole > 0.0 else 0.0 for name, share in shares.items()}


def with_noise_floor(held: HeldOutGap, equations: NormalEquations) -> HeldOutGap:
    """The same with what noise alone would leave as the floor, for a trial of which no model knows everything."""
    floor_m = left_by_noise_m(equations, window_starts(equations.log), HORIZON_S)
    return replace(held, gap=replace(held.gap, floor_m=min(floor_m, held.gap.after_m)))


def _named_without(evidence: Evidence, legs: NDArray[np.bool_], barred: frozenset[str]) -> Coordinates:
    """What the other legs ask for, and how much of it."""
    equations = evidence.equations
    rest = evidence_of(replace(equations, gram=equations.gram[~legs]))
    names = search_effects(rest, barred)
    while names:
        gain = {name: rest.fit(names).gain - rest.fit([n for n in names if n != name]).gain for name in names}
        chance = {name: rest.chance(gain[name], len(rest.columns([name]))) for name in names}
        worst = max(names, key=lambda name: chance[name])
        if chance[worst] < FALSE_ALARM:
            break
        names = tuple(name for name in names if name != worst)
    return fitted_coordinates(rest, names)


def left_by_noise_m(equations: NormalEquations, starts: Ints, horizon_s: int) -> float:
    """The mean distance [m] over the seconds 1 to H of windows that begin at the rows ``starts``."""
    linear, noise = equations.linear, equations.noise
    data = Columns(linear.defect[:, :, None], linear.observed[:, :, None], np.zeros((len(linear.A), 0)))
    variance = smooth_state(linear, data, noise, equations.log.edges)[1]
    P = np.zeros((len(starts), 9, 9))
    P[:, range(6), range(6)] = variance[starts, :6]
    P[:, range(6, 9), range(6, 9)] = _slow(noise)
    compared = noise.position_m**2 + noise.drift[0] ** 2 + np.square(noise.waves[:2])
    distances = []
    for second in range(horizon_s):
        P = _later(linear.A[starts + second], linear.B[starts + second] * FORCE_UNITS, noise, P)
        # the mean length of a Gaussian vector in the plane, its two variances taken as alike
        distances.append(np.sqrt(0.25 * np.pi * (P[:, 0, 0] + P[:, 1, 1] + compared.sum())))
    return float(np.mean(distances))


def _slow(noise: Noise) -> Floats:
    return np.asarray((np.array(noise.slow) / FORCE_UNITS) ** 2)


def _later(A: Floats, B: Floats, noise: Noise, P: Floats) -> Floats:
    """The covariances [N, 9, 9] of motion and slow force a second later."""
    kept = decay(1.0, noise.slow_s)
    F, Q = np.zeros_like(P), np.zeros_like(P)
    F[:, :6, :6], F[:, :6, 6:] = A, B
    F[:, range(6, 9), range(6, 9)] = kept
    gust = (np.array(noise.gust) / FORCE_UNITS) ** 2
    Q[:, :6, :6] = (B * gust) @ B.transpose(0, 2, 1)
    Q[:, range(6, 9), range(6, 9)] = (1.0 - kept**2) * _slow(noise)
    return np.asarray(F @ P @ F.transpose(0, 2, 1) + Q)
